"""Reasons why points of the surface are not covered: the first criterion that each camera fails.

The criteria are those of docs/area.md, in the order of `rastercov.Reason`. Occlusion is a segment
from the near plane to the point, traced through a tree of triangles; the first surface that it
meets is the one that hides. `rastercov.reference.regions` judges points without a tree.

The cells whose centre a pose covers are an estimate of the cells that it covers. It takes a
fraction of the time of exact regions, and serves searches over poses, which measure the best of
them exactly.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.memory import FloatArray, IntArray, Lists, read_only
from rastercov.base.threads import share_poses, thread_count
from rastercov.camera.lamps import Lamps, are_lit, illuminances, points_of
from rastercov.camera.near_plane import near_limits
from rastercov.camera.pose import Poses
from rastercov.camera.rig import (
    Cameras,
    Rig,
    cameras_of,
    lamps_of,
    rows_of_result,
)
from rastercov.camera.rule import Gate
from rastercov.coverage.area.cells import Cells
from rastercov.coverage.area.frames import frames_of, in_front
from rastercov.coverage.area.regions import check_pointwise
from rastercov.coverage.area.rows import gated_lists, gated_reasons, tasks_of
from rastercov.coverage.reasons import (
    HIGHLIGHT,
    TOO_BRIGHT,
    TOO_DARK,
    UNLIT,
    Reason,
)
from rastercov.coverage.surface import own_reasons
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.mesh.contacts import TriangleTree
from rastercov.native import area_point

TINY = np.finfo(float).tiny
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
    two_sided: NDArray[np.bool_]
    own: IntArray


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
) -> Iterator[tuple[IntArray, NDArray[np.uint8], IntArray]]:
    """As `first_failures` for each row of the result, and the pose that has each reason, (N,).

    Of a rig with a rule, it is that of the camera that is missed most, `BASELINE` or `UNCERTAIN`;
    of what its cameras see, a reason of light, such as `UNLIT`.
    """
    rows, normals = rows_of_result(camera, poses), frames_of(mesh).normal[face]
    light = LightOfPoints.of(mesh, camera, task, points, face)
    judged = enumerate(first_failures(mesh, camera, task, poses, points, face))
    for _, group in groupby(judged, lambda each: rows[each[0]]):
        own, found = zip(*group, strict=True)
        at, reason, hider = _of_row(camera, poses, own, found, points, normals)
        if light is not None:
            sees = np.array([each == Reason.COVERED for each, _ in found])
            seen = reason == Reason.COVERED
            reason = np.where(seen, light.reasons(poses[np.array(own)], sees), reason)
        yield at, reason, hider


def _of_row(
    camera: Cameras,
    poses: Poses,
    own: Sequence[int],
    found: Sequence[tuple[NDArray[np.uint8], IntArray]],
    points: FloatArray,
    normals: FloatArray,
) -> tuple[IntArray, NDArray[np.uint8], IntArray]:
    """Pose, reason and hiding face of points in a row of the result, of its own poses."""
    if len(own) == 1:
        return np.full(len(points), own[0]), *found[0]
    reason, hider = (np.array(each) for each in zip(*found, strict=True))
    some = poses[np.array(own)]
    fails, at = gated_reasons(reason, camera, some, points, normals)
    hidden_by = np.take_along_axis(hider, at, axis=0)[0]
    hidden_by[fails[0] != Reason.OCCLUDED] = -1
    return own[0] + at[0], fails[0], hidden_by


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
        face: NDArray[np.integer[Any]],
    ) -> None:
        from rastercov.coverage.records import lens_of

        self.cameras = cameras_of(camera)
        self._centre = mesh.bounds.mean(axis=0)
        self._diagonal = mesh.diagonal or 1.0
        solid = np.flatnonzero(~mesh.degenerate_mask & ~mesh.target_mask)
        self.faces, row = np.full(1, -1), np.full(mesh.n_faces, -1)
        corners, nodes = np.empty((0, 3, 3)), np.full((4, 6), np.inf)
        if len(solid):
            tree = TriangleTree.over(self._placed(mesh.vertices), mesh.faces[solid])
            corners, nodes, self.faces = tree.corners, tree.nodes, solid[tree.order]
            row[self.faces] = np.arange(len(self.faces))
        self._tree = read_only(corners, np.float64), read_only(nodes, np.float64)
        self._points = Points(
            points=read_only(self._placed(points), np.float64),
            normals=read_only(frames_of(mesh).normal[face], np.float64),
            two_sided=read_only(mesh.two_sided_mask[face], np.bool_),
            own=read_only(row[face], np.int64),
        )
        tasks = tasks_of(camera, task)
        of_surface = {each: own_reasons(mesh, each)[face] for each in tasks}
        self._of_camera = [
            (lens_of(each), own.rules(each).in_units_of(self._diagonal), of_surface[own])
            for each, own in zip(self.cameras, tasks, strict=True)
        ]

    def _placed(self, points: FloatArray) -> FloatArray:
        """Points (N, 3) in a scene of diagonal 1 about the origin."""
        return (points - self._centre) / self._diagonal

    def worker(
        self, poses: Poses, near: FloatArray, *, is_nearest: bool
    ) -> Callable[[int, NDArray[np.uint8], IntArray], None]:
        """Function of one thread that fills the reasons, and the triangles that hide, of a pose.

        It takes the row of the pose, (N,) `Reason` and (N,) rows of `faces`, -1 where nothing
        hides. `near`, (P,), are the depths of the near planes; see `judge_points` for the rest.
        """
        rotations = np.ascontiguousarray(poses.world_from_camera[:, :3, :3])
        eyes = self._placed(poses.world_from_camera[:, :3, 3])

        corners, nodes = self._tree

        def judge(row: int, reason: NDArray[np.uint8], hider: IntArray) -> None:
            lens, rules, own = self._of_camera[poses.camera[row]]
            area_point.judge_points(
                self._points,
                lens,
                rules,
                rotations[row],
                eyes[row],
                float(near[row]) / self._diagonal,
                MARGIN_REL,
                is_nearest,
                corners,
                nodes,
                reason,
                hider,
            )
            np.copyto(reason, own, where=reason == Reason.COVERED)

        return judge


class LightOfPoints:
    """Light of the lamps of cameras at points of faces, (N, 3) metres; one thread may use it."""

    def __init__(
        self,
        mesh: Mesh,
        rig: Rig,
        lamps: Lamps,
        task: Task,
        points: FloatArray,
        face: NDArray[np.integer[Any]],
    ) -> None:
        self.lamps, self.task, self._points, self._mesh = lamps, task, points, mesh
        self._gates = rig.gates
        self._normals = frames_of(mesh).normal[face]
        self._two_sided = mesh.two_sided_mask[face]
        self._judge = PointPass(mesh, lamps.eyes, Task(), points, face)
        self._camera_from_rig = np.linalg.inv(rig.rig_from_camera)
        self._dazzled = [own.max_highlight_deg for own in tasks_of(rig, task)]
        self._carried = lamps.carried_by(rig.names)
        self._rides = np.asarray(self._carried.any(axis=1))
        self._fixed = self._reached(points_of(lamps, ~self._rides))

    @classmethod
    def of(
        cls,
        mesh: Mesh,
        camera: Cameras,
        task: Task,
        points: FloatArray,
        face: NDArray[np.integer[Any]],
    ) -> "LightOfPoints | None":
        """Light of cameras; None where they have no lamps."""
        lamps = lamps_of(camera)
        if lamps is None or not isinstance(camera, Rig):
            return None
        return cls(mesh, camera, lamps, task, points, face)

    def of_cell(self) -> FloatArray:
        """(N,) illuminance by the lamps that are fixed, from the side that gets more."""
        poses, reached = self._fixed
        fronts = in_front(poses.world_from_camera[:, :3, 3], self._points, self._normals)
        on = self._points, self._normals
        sides = [illuminances(self.lamps, poses, reached & side, *on) for side in (fronts, ~fronts)]
        return np.where(self._two_sided, np.maximum(*sides), sides[0])

    def reasons(self, own: Poses, sees: NDArray[np.bool_] | None = None) -> NDArray[np.uint8]:
        """(N,) reason of light, for the poses of a row of the result: `COVERED` where none is.

        On the side of the face that the first pose is on; or, of points that cameras of a rig with
        a rule see, (n, N), on the side from which they meet it, the better of two.
        """
        poses, reached = self._fixed
        if self._rides.any():
            world = own.world_from_camera[:1] @ self._camera_from_rig[own.camera[:1]]
            on_rig = self._reached(points_of(self.lamps, self._rides, world))
            is_there = self._carried[on_rig[0].camera, own.camera[0]]
            reached = np.concatenate([reached, on_rig[1] & is_there[:, None]])
            camera = np.concatenate([poses.camera, on_rig[0].camera])
            matrices = np.concatenate([poses.world_from_camera, on_rig[0].world_from_camera])
            poses = Poses.of(matrices, camera=camera)
        fronts = in_front(own.world_from_camera[:, :3, 3], self._points, self._normals)
        gate = self._gates.get(int(own.camera[0]))
        if gate is None or sees is None:
            return self._on_side(own, poses, reached, fronts[0])
        front, rear = (gate.holds(sees & side) for side in (fronts, ~fronts))
        is_front = front | ~rear
        found = self._on_side(own, poses, reached, is_front, (gate, sees & (fronts == is_front)))
        if (both := front & rear).any():
            rest = gate, sees & (fronts == ~both)
            other = self._on_side(own, poses, reached, ~both, rest)
            found[both] = np.minimum(found, other)[both]  # reasons of light are above `COVERED`
        return found

    def _on_side(
        self,
        own: Poses,
        poses: Poses,
        reached: NDArray[np.bool_],
        is_front: NDArray[np.bool_],
        together: tuple[Gate, NDArray[np.bool_]] | None = None,
    ) -> NDArray[np.uint8]:
        """(N,) reason on a side of each point, by the points of lamps that reach it, (K, N).

        A camera that sees a lamp mirrored does not count; with a rule, and the points that each of
        its cameras sees, (n, N), the others may be enough.
        """
        on, task, eyes = (self._points, self._normals), self.task, poses.world_from_camera[:, :3, 3]
        sees = reached & ((in_front(eyes, *on) == is_front) | ~self._two_sided)
        found = np.full(len(self._points), Reason.COVERED, np.uint8)
        dazzled = np.zeros((len(own), len(self._points)), np.bool_)
        for row, (centre, index) in enumerate(
            zip(own.world_from_camera[:, :3, 3], own.camera, strict=True)
        ):
            if degrees := self._dazzled[index]:
                dazzled[row] = self._mirrored(centre, eyes, sees, degrees)
        is_lost = dazzled.any(axis=0)
        if together is not None:
            gate, covers = together
            is_lost &= ~gate.holds(covers & ~dazzled)
        found[is_lost] = HIGHLIGHT
        light = illuminances(self.lamps, poses, sees, *on)
        if task.max_illuminance is not None:
            found[light > task.max_illuminance] = TOO_BRIGHT
        found[light < task.min_illuminance] = TOO_DARK
        found[~are_lit(self.lamps, sees, poses.camera)] = UNLIT
        return found

    def _mirrored(
        self, centre: FloatArray, eyes: FloatArray, sees: NDArray[np.bool_], degrees: float
    ) -> NDArray[np.bool_]:
        """(N,) points with the half vector to a camera and a lamp within degrees of the normal."""
        to_camera = centre - self._points
        to_camera /= np.maximum(np.linalg.norm(to_camera, axis=1), TINY)[:, None]
        found = np.zeros(len(self._points), np.bool_)
        for eye, own in zip(eyes, sees, strict=True):
            half = eye - self._points
            half /= np.maximum(np.linalg.norm(half, axis=1), TINY)[:, None]
            half += to_camera
            along = np.abs(np.einsum("ni,ni->n", half, self._normals))
            found |= own & (along > math.cos(math.radians(degrees)) * np.linalg.norm(half, axis=1))
        return found

    def _reached(self, poses: Poses) -> tuple[Poses, NDArray[np.bool_]]:
        """Points of lamps by their poses, and (K, N) the points of faces that each reaches."""
        n = len(self._points)
        near = near_limits(self._judge.cameras, self._mesh.opaque.bounds, poses)
        judge = self._judge.worker(poses, near, is_nearest=False)
        found = np.zeros((len(poses), n), np.bool_)
        for row in range(len(poses)):  # as many as there are points of lamps, at most 64
            reason, hider = np.empty(n, np.uint8), np.empty(n, np.int64)
            judge(row, reason, hider)
            found[row] = reason == Reason.COVERED
        return poses, found


def illuminance_of_faces(mesh: Mesh, camera: Cameras) -> FloatArray | None:
    """(F,) illuminance of faces at their centroids by the lamps of the cell; None without lamps.

    From the side that gets more, of two-sided faces; 0 for occluders.
    """
    faces = np.flatnonzero(mesh.task_mask & ~mesh.degenerate_mask)
    light = LightOfPoints.of(mesh, camera, Task(), mesh.centroids[faces], faces)
    if light is None:
        return None
    found = np.zeros(mesh.n_faces)
    found[faces] = light.of_cell()
    return found


class CentrePass:
    """Cells whose centre a pose covers, or a pose of a rig with a rule; for any number of threads.

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
        self._n_cells, self._mesh, self._camera = len(cells), cells.mesh, camera
        centres = cells.vertices.reshape(-1, 3, 3).mean(axis=1)
        self._judge = PointPass(cells.mesh, camera, task, centres, cells.source_face)
        frames = frames_of(cells.mesh)
        self._planes = centres, frames.normal[cells.source_face]
        self._threads = thread_count(threads)
        self._light = LightOfPoints.of(cells.mesh, camera, task, centres, cells.source_face)

    def find(self, poses: ArrayLike | Poses) -> Lists:
        """Cells whose centre each row of the result of (P, 4, 4) poses covers."""
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
        gated = gated_lists(found, self._camera, placed, *self._planes)
        if self._light is not None:
            rows = rows_of_result(self._camera, placed)
            for row, own in enumerate(gated):
                sees = np.zeros((int((rows == row).sum()), self._n_cells), np.bool_)
                for camera, pose in enumerate(np.flatnonzero(rows == row)):
                    sees[camera, found[pose]] = True
                reason = self._light.reasons(placed[rows == row], sees)
                gated[row] = own[reason[own] == Reason.COVERED]
        return Lists.of(gated)
