"""Reasons why points of the surface are not covered: the first criterion that each camera fails.

The criteria are those of docs/area.md, in the order of `rastercov.Reason`. Occlusion is a segment
from the near plane to the point, traced through a tree of triangles; the first surface that it
meets is the one that hides. `rastercov.reference.regions` judges points without a tree.

The cells whose centre a pose covers are an estimate of the cells that it covers. It takes a
fraction of the time of exact regions, and serves searches over poses, which measure the best of
them exactly.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.memory import Lists, read_only
from rastercov.base.threads import share_poses, thread_count
from rastercov.camera.camera import Camera
from rastercov.camera.near_plane import near_limits
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, cameras_of
from rastercov.coverage.area.cells import Cells
from rastercov.coverage.area.frames import frames_of
from rastercov.coverage.area.regions import check_pointwise
from rastercov.coverage.reasons import Reason
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.mesh.contacts import TriangleTree

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


MARGIN_REL = 1e-9
"""Distance from the point up to which a surface hides nothing, relative to the diagonal of the
mesh: coincident surfaces are not found."""


def first_failures(
    mesh: Mesh,
    camera: Cameras,
    task: Task,
    poses: ArrayLike | Poses,
    points: FloatArray,
    face: IntArray,
) -> Iterator[tuple[NDArray[np.uint8], IntArray]]:
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
    judge = PointPass(mesh, cameras_of(camera), task, points, face)
    near = near_limits(judge.cameras, mesh.bounds, placed)
    judge_pose = judge.worker(placed, near, is_nearest=True)
    for row in range(len(placed)):
        reason, hidden_by = np.empty(len(points), np.uint8), np.empty(len(points), np.int64)
        judge_pose(row, reason, hidden_by)
        yield reason, np.where(hidden_by >= 0, judge.faces[hidden_by], -1)


class PointPass:
    """Points of faces, (N, 3) metres, held against the criteria of a task; for any threads.

    Attributes
    ----------
    cameras : sequence of Camera
    faces : (T,) int64
        Faces that hide, in the order of the tree; one -1 where there is none.
    """

    def __init__(
        self,
        mesh: Mesh,
        cameras: Sequence[Camera],
        task: Task,
        points: FloatArray,
        face: NDArray[np.integer[Any]],
    ) -> None:
        from rastercov.coverage.records import lens_of
        from rastercov.kernels import area_point

        self.cameras, self._kernels = cameras, area_point
        self._centre = mesh.bounds.mean(axis=0)
        self._diagonal = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0))) or 1.0
        solid = np.flatnonzero(~mesh.degenerate_mask & ~mesh.target_mask)
        self.faces, row = np.full(1, -1), np.full(mesh.n_faces, -1)
        corners, nodes = np.empty((0, 3, 3)), np.full((4, 6), np.inf)
        if len(solid):
            tree = TriangleTree.over(self._placed(mesh.vertices), mesh.faces[solid])
            corners, nodes, self.faces = tree.corners, tree.nodes, solid[tree.order]
            row[self.faces] = np.arange(len(self.faces))
        self._tree = read_only(corners, np.float64), read_only(nodes, np.float64)
        self._points = area_point.Points(
            points=read_only(self._placed(points), np.float64),
            normals=read_only(frames_of(mesh).normal[face], np.float64),
            two_sided=read_only(mesh.two_sided_mask[face], np.bool_),
            own=read_only(row[face], np.int64),
        )
        self._of_camera = [
            (lens_of(each), task.rules(each).in_units_of(self._diagonal)) for each in self.cameras
        ]

    def _placed(self, points: FloatArray) -> FloatArray:
        """Points (N, 3) in a scene of diagonal 1 about the origin."""
        found: FloatArray = (points - self._centre) / self._diagonal
        return found

    def worker(
        self, poses: Poses, near: FloatArray, *, is_nearest: bool
    ) -> Callable[[int, NDArray[np.uint8], IntArray], None]:
        """Function of one thread that fills the reasons, and the triangles that hide, of a pose.

        It takes the row of the pose, (N,) `Reason` and (N,) rows of `faces`, -1 where nothing
        hides. `near`, (P,), are the depths of the near planes; see `judge_points` for the rest.
        """
        from rastercov.kernels.mesh_tree import STACK_SIZE

        matrices, stack = poses.world_from_camera, np.empty(STACK_SIZE, np.int64)
        eyes = self._placed(matrices[:, :3, 3])

        def judge(row: int, reason: NDArray[np.uint8], hider: IntArray) -> None:
            lens, rules = self._of_camera[poses.camera[row]]
            self._kernels.judge_points(
                self._points, lens, rules, *self._tree,
                np.ascontiguousarray(matrices[row, :3, :3]), eyes[row],
                float(near[row]) / self._diagonal, MARGIN_REL, is_nearest, stack, reason, hider,
            )  # fmt: skip

        return judge


class CentrePass:
    """Cells whose centre a pose covers; any number of threads may use it.

    A point is judged as in `rastercov.coverage.area.failures`: coincident surfaces hide nothing.

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
        self._n_cells, self._mesh, cameras = len(cells), cells.mesh, cameras_of(camera)
        centres = cells.vertices.reshape(-1, 3, 3).mean(axis=1)
        self._judge = PointPass(cells.mesh, cameras, task, centres, cells.source_face)
        self._threads = thread_count(threads)

    def find(self, poses: ArrayLike | Poses) -> Lists:
        """Cells whose centre each of (P, 4, 4) poses covers."""
        placed, cameras = Poses.of(poses), self._judge.cameras
        placed.check_cameras(len(cameras))
        found = [np.empty(0, np.int32)] * len(placed)
        near = near_limits(cameras, self._mesh.opaque.bounds, placed)

        def worker() -> Callable[[slice], None]:
            judge = self._judge.worker(placed, near, is_nearest=False)
            reason, hider = np.empty(self._n_cells, np.uint8), np.empty(self._n_cells, np.int64)

            def work(turn: slice) -> None:
                for row in range(len(placed))[turn]:
                    judge(row, reason, hider)
                    found[row] = np.flatnonzero(reason == Reason.COVERED).astype(np.int32)

            return work

        n_workers = max(1, min(self._threads, len(placed)))
        share_poses(len(placed), [worker() for _ in range(n_workers)])
        return Lists.of(found)
