"""Reasons of points over time, by those of each frame."""

import numpy as np

from rastercov.base.memory import AnyArray, ByteArray, FloatArray, IntArray
from rastercov.camera.camera import Camera
from rastercov.camera.rig import Rig
from rastercov.coverage.area.motion import MotionQuery
from rastercov.coverage.reasons import ORDER, RANK
from rastercov.coverage.task import Task
from rastercov.reference.regions import reasons_of_points


def reasons_over_time(
    asked: MotionQuery,
    camera: Camera | Rig,
    world_from_camera: AnyArray,
    task: Task,
    points: FloatArray,
    face: IntArray,
) -> ByteArray:
    """(N,) row of `REASONS` of points at rest: the criterion that fails last for long enough.

    In each frame as of `reasons_of_points`: a point has met the criteria before a reason for the
    time in which it has this reason or a later one. At any time, of each pose by itself.
    """
    motion, placed = asked.motion, np.asarray(world_from_camera)
    carrier, body = motion.poses_of(str(asked.body)), motion.body[face]
    groups = [placed] if asked.views_at == "one time" else np.split(placed, len(placed))
    needed, best = motion._needed(asked.over)[face], np.zeros(len(points), np.int64)
    for own in groups:
        ranks = np.full((len(motion), len(points)), -1)
        for row, is_there in enumerate(motion.present[:, body]):
            mesh, kept = motion.frame(row)
            pose = motion.world_from_body[row, body[is_there]]
            moved = np.einsum("nij,nj->ni", pose[:, :3, :3], points[is_there]) + pose[:, :3, 3]
            at = np.searchsorted(kept, face[is_there])
            found = reasons_of_points(mesh, camera, carrier[row] @ own, task, moved, at)
            ranks[row, is_there] = RANK[found]
        order = np.argsort(-ranks, axis=0)
        is_enough = np.cumsum(motion.units[order], axis=0) >= needed
        last = np.take_along_axis(ranks, order, axis=0)[
            is_enough.argmax(axis=0), range(len(points))
        ]
        best = np.maximum(best, np.where(is_enough.any(axis=0), last, 0))
    return np.array(ORDER, np.uint8)[best]
