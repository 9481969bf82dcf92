"""Reasons why points of the surface are not covered: the first criterion that each camera fails.

The criteria are those of docs/area.md, in the order of `rastercov.Reason`. Occlusion is a segment
from the near plane to the point, traced through a tree of triangles; the first surface that it
meets is the one that hides. `rastercov.reference.regions` judges points without a tree.

The cells whose centre a pose covers are an estimate of the cells that it covers. It takes a
fraction of the time of exact regions, and serves searches over poses, which measure the best of
them exactly.
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import groupby

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import ByteArray, FloatArray, IntArray, Lists, share_poses, thread_count
from rastercov.core.area.cells import Cells
from rastercov.core.area.features import conditions_at
from rastercov.core.area.frames import frames_of
from rastercov.core.area.point_pass import PointPass
from rastercov.core.area.regions import check_pointwise
from rastercov.core.area.rows import rule_lists, rule_reasons
from rastercov.core.camera import Cameras, Poses, near_limits, rows_of_result
from rastercov.core.coverage.reasons import BITS, Reason
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import Mesh


def first_failures(
    mesh: Mesh,
    camera: Cameras,
    task: Task,
    poses: ArrayLike | Poses,
    points: FloatArray,
    face: IntArray,
) -> Iterator[tuple[ByteArray, IntArray]]:
    """`Reason` of each point in each pose, (N,), and the face that hides it, or -1, (N,).

    Parameters
    ----------
    mesh, camera, task
        Scene, camera or cameras, thresholds of `rastercov.regions`.
    poses : (P, 4, 4) array_like, or Poses
        world_from_camera.
    points, face : (N, 3) float64, (N,) int
        Points of faces with an area, metres.
    """
    placed = Poses.of(poses)
    judge = PointPass(mesh, camera, task, points, face)
    near = near_limits(judge.cameras, mesh.bounds, placed)
    judge_pose = judge.worker(placed, near, is_nearest=True)
    for row in range(len(placed)):
        reason, hidden_by = np.empty(len(points), np.uint8), np.empty(len(points), np.int64)
        judge_pose(row, reason, hidden_by)
        yield reason, np.where(hidden_by >= 0, judge.faces[hidden_by], -1)


def failures_of_rows(
    mesh: Mesh,
    camera: Cameras,
    task: Task,
    poses: Poses,
    points: FloatArray,
    face: IntArray,
) -> Iterator[tuple[IntArray, ByteArray, IntArray]]:
    """As `first_failures` for each row of the result, and the pose that has each reason, (N,).

    Of a rig with a rule it is as of `rule_reasons`; of what its cameras see, that of a condition
    of a feature.
    """
    rows, normals = rows_of_result(camera, poses), frames_of(mesh).normal[face]
    conditions = conditions_at(mesh, camera, task, points, face)
    judged = enumerate(first_failures(mesh, camera, task, poses, points, face))
    for _, group in groupby(judged, lambda each: rows[each[0]]):
        own, result = zip(*group, strict=True)
        at, reason, hider = _of_row(camera, poses, own, result, points, normals)
        for condition in conditions:
            sees = np.array([each == Reason.COVERED for each, _ in result])
            seen = reason == Reason.COVERED
            reason = np.where(seen, condition.reasons(poses[np.array(own)], sees), reason)
        yield at, reason, hider


def _of_row(
    camera: Cameras,
    poses: Poses,
    own: Sequence[int],
    reasons: Sequence[tuple[ByteArray, IntArray]],
    points: FloatArray,
    normals: FloatArray,
) -> tuple[IntArray, ByteArray, IntArray]:
    """Pose, reason and hiding face of points in a row of the result, of its own poses."""
    if len(own) == 1:
        return np.full(len(points), own[0]), *reasons[0]
    reason, hider = (np.array(each) for each in zip(*reasons, strict=True))
    some = poses[np.array(own)]
    fails, at = rule_reasons(reason, camera, some, points, normals)
    at = np.maximum(at, 0)
    hidden_by = np.take_along_axis(hider, at, axis=0)[0]
    hidden_by[BITS[fails[0]] & BITS[Reason.OCCLUDED] == 0] = -1
    return own[0] + at[0], fails[0], hidden_by


class CentrePass:
    """Cells whose centre a pose covers, or a pose of a rig with a rule; for any number of threads.

    A point is judged as in `rastercov.core.area.failures`: coincident surfaces hide nothing.

    Parameters
    ----------
    cells : Cells
        Cells of the scene.
    camera, task
        Camera or cameras, and thresholds of `rastercov.regions`.
    threads : int, optional
        Poses judged in parallel; by default one per core.
    """

    def __init__(
        self, cells: Cells, camera: Cameras, task: Task, threads: int | None = None
    ) -> None:
        check_pointwise(task)
        self._n_cells, self._mesh, self._camera = len(cells), cells.mesh, camera
        centres = cells.vertices.reshape(-1, 3, 3).mean(axis=1)
        self._judge = PointPass(cells.mesh, camera, task, centres, cells.source_face)
        frames = frames_of(cells.mesh)
        self._planes = centres, frames.normal[cells.source_face]
        self._threads = thread_count(threads)
        self._conditions = conditions_at(cells.mesh, camera, task, centres, cells.source_face)

    def find(self, poses: ArrayLike | Poses) -> Lists:
        """Cells whose centre each row of the result of (P, 4, 4) poses covers."""
        placed, cameras = Poses.of(poses), self._judge.cameras
        placed.check_cameras(len(cameras))
        values = [np.empty(0, np.int32)] * len(placed)
        near = near_limits(cameras, self._mesh.opaque.bounds, placed)

        def worker() -> Callable[[slice], None]:
            judge = self._judge.worker(placed, near, is_nearest=False)
            reason, hider = np.empty(self._n_cells, np.uint8), np.empty(self._n_cells, np.int64)

            def work(turn: slice) -> None:
                for row in range(len(placed))[turn]:
                    judge(row, reason, hider)
                    values[row] = np.flatnonzero(reason == Reason.COVERED).astype(np.int32)

            return work

        n_workers = max(1, min(self._threads, len(placed)))
        share_poses(len(placed), [worker() for _ in range(n_workers)])
        gated = rule_lists(values, self._camera, placed, *self._planes)
        if self._conditions:
            rows = rows_of_result(self._camera, placed)
            for row, own in enumerate(gated):
                sees = np.zeros((int((rows == row).sum()), self._n_cells), np.bool_)
                for camera, pose in enumerate(np.flatnonzero(rows == row)):
                    sees[camera, values[pose]] = True
                every = [each.reasons(placed[rows == row], sees) for each in self._conditions]
                gated[row] = own[(np.array(every)[:, own] == Reason.COVERED).all(axis=0)]
        return Lists.of(gated)
