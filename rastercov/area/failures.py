"""Reasons why points of the surface are not covered: the first criterion that each camera fails.

The criteria are those of docs/area.md, in the order of `rastercov.Reason`. Occlusion is a segment
from the near plane to the point, traced through a tree of triangles; the first surface that it
meets is the one that hides. `rastercov.reference.regions` judges points without a tree.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.area.frames import frames_of
from rastercov.camera import Camera
from rastercov.mesh import Mesh
from rastercov.mesh.triangle_tree import TriangleTree
from rastercov.near_plane import near_limits
from rastercov.pose import Poses
from rastercov.rig import Cameras, cameras_of
from rastercov.task import Reason, Task

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
    frames, sight = frames_of(mesh), Sight(mesh)
    axes = [each[face] for each in (frames.normal, frames.x_axis, frames.y_axis)]
    cameras, placed = cameras_of(camera), Poses.of(poses)
    near_of = near_limits(cameras, mesh.bounds, placed)
    for pose, index, near in zip(placed.world_from_camera, placed.camera, near_of, strict=True):
        local = (points - pose[:3, 3]) @ pose[:3, :3]
        turned = [each @ pose[:3, :3] for each in axes]
        reason = _failures(mesh, cameras[index], task, near, local, face, turned)
        hidden_by = np.full(len(points), -1)
        rows = np.flatnonzero(reason >= Reason.OCCLUDED)
        hidden_by[rows] = sight.in_front(points[rows], face[rows], pose, float(near))
        reason[hidden_by >= 0] = Reason.OCCLUDED
        yield reason, hidden_by


def _failures(
    mesh: Mesh,
    camera: Camera,
    task: Task,
    near: float,
    local: FloatArray,
    face: IntArray,
    axes: list[FloatArray],
) -> NDArray[np.uint8]:
    """First criterion but occlusion that points in camera axes fail; `COVERED` for none."""
    normal, x_axis, y_axis = axes
    x, y, z = local.T
    z_n, z_f = camera.depth_of_field(task.max_blur)
    with np.errstate(all="ignore"):
        right, down = x / z, y / z
        u, v = camera.fx * right + camera.cx, camera.fy * down + camera.cy
        height = -np.einsum("ni,ni->n", normal, local)
        facing = np.where(mesh.two_sided_mask[face], np.abs(height), height)
        columns = [
            (camera.fx * (axis[:, 0] - right * axis[:, 2]) / z,
             camera.fy * (axis[:, 1] - down * axis[:, 2]) / z)
            for axis in (x_axis, y_axis)
        ]  # fmt: skip
        (a, b), (c, d) = columns
        det, total = np.abs(a * d - b * c), a * a + b * b + c * c + d * d
        greatest = np.sqrt((total + np.sqrt(np.maximum(total**2 - 4 * det**2, 0))) / 2)
        is_inside = (z >= near) & (u >= 0) & (u <= camera.width) & (v >= 0) & (v <= camera.height)
        is_dense = camera.fx * camera.fy * facing / z**3 >= task.min_pixels_per_m2
        is_dense &= min(camera.fx, camera.fy) / z >= task.min_facing_density
        is_dense &= det / greatest >= task.min_pixel_density
        distance = np.linalg.norm(local, axis=1)
        is_oblique = facing < distance * task.limits(camera).least_cosine
    failures = (
        (Reason.BACK_FACING, ~(facing > 0)),
        (Reason.OUTSIDE, ~is_inside),
        (Reason.OUT_OF_FOCUS, ~((z_n <= z) & (z <= z_f))),
        (Reason.TOO_COARSE, ~is_dense),
        (Reason.TOO_OBLIQUE, is_oblique & (task.max_incidence_deg < 90)),
    )
    found = np.full(len(local), Reason.COVERED, np.uint8)
    for reason, fails in reversed(failures):
        found[fails] = reason
    return found


class Sight:
    """Segments from the near plane of a camera to points of faces.

    Attributes
    ----------
    diagonal : float
        Of the mesh, metres.
    row : (F,) int64
        Triangle of each face in the tree; -1 for those that hide nothing.
    corners, nodes : (T, 3, 3), (2 L, 6) float64
        Tree over the faces that hide, see `rastercov.mesh.triangle_tree`, in the scene of
        `placed`.
    """

    def __init__(self, mesh: Mesh) -> None:
        from rastercov.area import failure_kernels

        self._kernels: Any = failure_kernels
        self._centre = mesh.bounds.mean(axis=0)
        self.diagonal = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0))) or 1.0
        solid = np.flatnonzero(~mesh.degenerate_mask & ~mesh.target_mask)
        self.row = np.full(mesh.n_faces, -1)
        self.corners, self.nodes = np.empty((0, 3, 3)), np.full((4, 6), np.inf)
        self._face = np.empty(0, np.int64)
        if len(solid):
            tree = TriangleTree.over(self.placed(mesh.vertices), mesh.faces[solid])
            self.corners, self.nodes, self._face = tree.corners, tree.nodes, solid[tree.order]
            self.row[self._face] = np.arange(len(self._face))

    def placed(self, points: FloatArray) -> FloatArray:
        """Points (N, 3) in a scene of diagonal 1 about the origin."""
        found: FloatArray = (points - self._centre) / self.diagonal
        return found

    def in_front(
        self, points: FloatArray, face: IntArray, pose: FloatArray, near: float
    ) -> IntArray:
        """(N,) face that a camera has in front of each point, which it has in view; -1 for none."""
        if not len(self._face):
            return np.full(len(points), -1)
        ray = points - pose[:3, 3]
        depth = ray @ pose[:3, 2]
        share = near / depth
        start = self.placed(pose[:3, 3] + share[:, None] * ray)
        length = np.linalg.norm(ray, axis=1)
        reach = length * (1 - share) / self.diagonal - MARGIN_REL
        hit = np.empty(len(points), np.int64)
        self._kernels.first_hits(
            start, ray / length[:, None], reach, self.corners, self.nodes,
            self.row[face], hit,
        )  # fmt: skip
        return np.where(hit >= 0, self._face[hit], -1)
