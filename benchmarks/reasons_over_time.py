"""Reasons of points over time, by those of each frame."""

import numpy as np
from numpy.typing import NDArray

from rastercov.base import AnyArray, BoolArray, FloatArray, IntArray
from rastercov.core.camera import Camera, Rig
from rastercov.core.coverage.task import Task, own_reasons, tasks_of
from rastercov.motion.regions import MotionQuery
from rastercov.reference.regions import passing, reasons_by


def reasons_over_time(
    asked: MotionQuery,
    camera: Camera | Rig,
    world_from_camera: AnyArray,
    task: Task,
    points: FloatArray,
    face: IntArray,
) -> NDArray[np.uint32]:
    """(N,) code of the reasons of points at rest: criteria without which they are covered in time.

    In each frame as of `reasons_of_points`: for as long as is asked for, by all rows of the
    result, or by one of them.
    """
    motion, placed = asked.motion, np.asarray(world_from_camera)
    carrier, body = motion.poses_of(str(asked.body)), motion.body[face]
    needed, frames = motion._rows_for(asked.over)[face], []
    for row, is_there in enumerate(motion.present[:, body]):
        mesh, kept = motion.frame(row)
        pose = motion.world_from_body[row, body[is_there]]
        moved = np.einsum("nij,nj->ni", pose[:, :3, :3], points[is_there]) + pose[:, :3, 3]
        at = np.searchsorted(kept, face[is_there])
        own = passing(mesh, camera, carrier[row] @ placed, task, moved, at)
        frames.append((motion.units[row], is_there, own))

    def passes(left: tuple[int, ...] | None) -> BoolArray:
        times = np.zeros((1, len(points)), np.int64)
        for units, is_there, own in frames:
            sees = own(left)  # of each row of the result
            if asked.views_at == "one time":
                sees = np.atleast_2d(sees.any(axis=0))
            times = np.broadcast_to(times, (len(sees), len(points))).copy()
            times[:, is_there] += units * sees
        return np.asarray((times >= needed).any(axis=0))

    return reasons_by(passes, own_reasons(motion.mesh, tasks_of(camera, task)[0])[face])
