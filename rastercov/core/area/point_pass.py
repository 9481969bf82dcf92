"""Points of faces in poses of cameras: the first criterion that each fails, and what hides it."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from rastercov.base import BoolArray, ByteArray, FloatArray, IntArray, WholeArray, read_only
from rastercov.core.area.polygons import frames_of
from rastercov.core.camera import Cameras, Poses, cameras_of, near_limits
from rastercov.core.coverage.face_pass import lens_of
from rastercov.core.coverage.task import Reason, Task, own_reasons, tasks_of
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.solids import hiders_of
from rastercov.engine import area_point

MARGIN_REL = 1e-9
"""Distance from the point up to which a surface hides nothing, relative to the diagonal of the
mesh: coincident surfaces are not found."""


class Points(NamedTuple):
    """Points in a scene of diagonal 1 about the origin, their unit normals, and their triangles.

    `own` is the triangle of each point in the order of the tree, -1 where it is not in it;
    `two_sided` says whether either side counts.
    """

    points: FloatArray
    normals: FloatArray
    two_sided: BoolArray
    own: IntArray


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
        camera: Cameras,
        task: Task,
        points: FloatArray,
        face: WholeArray,
    ) -> None:
        self.cameras = cameras_of(camera)
        hiders, self._bounds = hiders_of(mesh), mesh.opaque.bounds
        self._placed, self._diagonal = hiders.place, hiders.diagonal
        self.faces, row = np.full(1, -1), np.full(mesh.n_faces, -1)
        corners, nodes = np.empty((0, 3, 3)), np.full((4, 6), np.inf)
        if (tree := hiders.tree) is not None:
            corners, nodes, self.faces = tree.corners, tree.nodes, hiders.solid[tree.order]
            row[self.faces] = np.arange(len(self.faces))
        numbers = read_only(self.faces[: len(corners)], np.int64)
        self._tree = read_only(corners, np.float64), read_only(nodes, np.float64), numbers
        self._points = Points(
            points=read_only(self._placed(points), np.float64),
            normals=read_only(frames_of(mesh).normal[face], np.float64),
            two_sided=read_only(mesh.two_sided_mask[face], np.bool_),
            own=read_only(row[face], np.int64),
        )
        tasks = tasks_of(camera, task)
        of_surface = {each: own_reasons(mesh, each)[face] for each in tasks}
        self._of_camera = [
            (
                lens_of(each, self._diagonal),
                own.rules(each).in_units_of(self._diagonal),
                of_surface[own],
            )
            for each, own in zip(self.cameras, tasks, strict=True)
        ]

    def covers(self, poses: Poses) -> BoolArray:
        """(P, N) points that each of a few poses covers."""
        judge = self.worker(poses, near_limits(self.cameras, self._bounds, poses), is_nearest=False)
        n = len(self._points.points)
        mask = np.zeros((len(poses), n), bool)
        for row in range(len(poses)):
            reason, hider = np.empty(n, np.uint8), np.empty(n, np.int64)
            judge(row, reason, hider)
            mask[row] = reason == Reason.COVERED
        return mask

    def worker(
        self, poses: Poses, near: FloatArray, *, is_nearest: bool
    ) -> Callable[[int, ByteArray, IntArray], None]:
        """Function of one thread that fills the reasons, and the triangles that hide, of a pose.

        It takes the row of the pose, (N,) `Reason` and (N,) rows of `faces`, -1 where nothing
        hides. `near`, (P,), are the depths of the near planes; see `judge_points` for the rest.
        """
        rotations = np.ascontiguousarray(poses.world_from_camera[:, :3, :3])
        eyes = self._placed(poses.eyes)

        def judge(row: int, reason: ByteArray, hider: IntArray) -> None:
            lens, rules, own = self._of_camera[poses.camera[row]]
            area_point.judge_points(
                self._points,
                lens,
                rules,
                (rotations[row], eyes[row], float(near[row]) / self._diagonal, MARGIN_REL),
                (*self._tree, is_nearest),
                reason,
                hider,
            )
            np.copyto(reason, own, where=reason == int(Reason.COVERED))

        return judge
