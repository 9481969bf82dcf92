"""Reasons why points of the surface are not covered: the first criterion that each camera fails.

The criteria are those of docs/area.md, in the order of `rastercov.Reason`. Occlusion is a segment
from the near plane to the point, traced through a tree of triangles; the first surface that it
meets is the one that hides. `rastercov.reference.regions` judges points without a tree.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.camera.camera import Camera
from rastercov.camera.models import MODELS
from rastercov.camera.near_plane import near_limits
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, cameras_of
from rastercov.coverage.area.frames import frames_of
from rastercov.coverage.task import Reason, Task
from rastercov.mesh import Mesh
from rastercov.mesh.triangle_tree import TriangleTree

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
        share = float(near) / depth_of(cameras[index], local[rows])
        hidden_by[rows] = sight.in_front(points[rows], face[rows], pose, share)
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
    z_n, z_f = camera.depth_of_field(task.max_blur)
    with np.errstate(all="ignore"):
        height = -np.einsum("ni,ni->n", normal, local)
        facing = np.where(mesh.two_sided_mask[face], np.abs(height), height)
        distance = np.linalg.norm(local, axis=1)
        sharp = local[:, 2]
        if camera.is_pinhole:
            pixels, columns = _through_pinhole(camera, local, x_axis, y_axis)
            towards = min(camera.fx, camera.fy) / local[:, 2]
        else:
            from rastercov.camera.lenses.of_camera import lens_of  # loads numba

            lens = lens_of(camera)
            pixels, slopes = lens.project(local), lens.jacobian(local)
            columns = np.stack(
                [np.einsum("nij,nj->ni", slopes, axis) for axis in (x_axis, y_axis)], axis=2
            )
            towards = _least(slopes @ slopes.transpose(0, 2, 1))
            sharp = sharp if MODELS[camera.model].is_planar else distance
        u, v = pixels.T
        per_m2 = pixels_per_m2(camera, local, normal)
        is_inside = (depth_of(camera, local) >= near) & (u >= 0) & (u <= camera.width)
        is_inside &= (v >= 0) & (v <= camera.height)
        is_dense = (per_m2 >= task.min_pixels_per_m2) & (towards >= task.min_facing_density)
        is_dense &= _least(columns @ columns.transpose(0, 2, 1)) >= task.min_pixel_density
        is_oblique = facing < distance * task.rules(camera).cos_incidence
    failures = (
        (Reason.BACK_FACING, ~(facing > 0)),
        (Reason.OUTSIDE, ~is_inside),
        (Reason.OUT_OF_FOCUS, ~((z_n <= sharp) & (sharp <= z_f))),
        (Reason.TOO_COARSE, ~is_dense),
        (Reason.TOO_OBLIQUE, is_oblique & (task.max_incidence_deg < 90)),
    )
    found = np.full(len(local), Reason.COVERED, np.uint8)
    for reason, fails in reversed(failures):
        found[fails] = reason
    return found


def _through_pinhole(
    camera: Camera, local: FloatArray, x_axis: FloatArray, y_axis: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Pixels (N, 2) of points, and their derivatives (N, 2, 2) along two axes, px/m."""
    x, y, z = local.T
    right, down = x / z, y / z
    columns = [
        np.stack(
            (
                camera.fx * (axis[:, 0] - right * axis[:, 2]) / z,
                camera.fy * (axis[:, 1] - down * axis[:, 2]) / z,
            ),
            axis=1,
        )
        for axis in (x_axis, y_axis)
    ]
    pixels = np.stack((camera.fx * right + camera.cx, camera.fy * down + camera.cy), axis=1)
    return pixels, np.stack(columns, axis=2)


def _least(squares: FloatArray) -> FloatArray:
    """Least singular values (N,) of matrices by their products (N, 2, 2) with the transposed."""
    a, b, d = squares[:, 0, 0], squares[:, 0, 1], squares[:, 1, 1]
    largest = (a + d + np.sqrt((a - d) ** 2 + 4 * b * b)) / 2
    least: FloatArray = np.sqrt(np.maximum(a * d - b * b, 0) / largest)
    return least


def pixels_per_m2(camera: Camera, local: FloatArray, normal: FloatArray) -> FloatArray:
    """Pixels (N,) on a square metre of surfaces at points of the image, in camera axes."""
    found: FloatArray
    with np.errstate(all="ignore"):
        if camera.is_pinhole:
            height = np.abs(np.einsum("ni,ni->n", normal, local))
            found = camera.fx * camera.fy * height / local[:, 2] ** 3
        else:
            from rastercov.camera.lenses.of_camera import lens_of  # loads numba

            slopes = lens_of(camera).jacobian(local)
            across = np.cross(slopes[:, 0], slopes[:, 1])
            found = np.abs(np.einsum("ni,ni->n", across, normal))
    return found


def depth_of(camera: Camera, local: FloatArray) -> FloatArray:
    """Depth (N,) of points in camera axes that the near plane cuts; a wide lens has a cube."""
    is_wide = False
    if not camera.is_pinhole:
        from rastercov.camera.lenses.of_camera import lens_of  # loads numba

        is_wide = len(lens_of(camera).planes) > 1
    depth: FloatArray = np.abs(local).max(axis=1) if is_wide else local[:, 2]
    return depth


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
        from rastercov.kernels import area_failure

        self._kernels: Any = area_failure
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
        self, points: FloatArray, face: IntArray, pose: FloatArray, share: FloatArray
    ) -> IntArray:
        """(N,) face that a camera has in front of each point, which it has in view; -1 for none.

        `share`, (N,), is the part of each segment from the camera that the near plane cuts off.
        """
        if not len(self._face):
            return np.full(len(points), -1)
        ray = points - pose[:3, 3]
        start = self.placed(pose[:3, 3] + share[:, None] * ray)
        length = np.linalg.norm(ray, axis=1)
        reach = length * (1 - share) / self.diagonal - MARGIN_REL
        hit = np.empty(len(points), np.int64)
        self._kernels.first_hits(
            start, ray / length[:, None], reach, self.corners, self.nodes,
            self.row[face], hit,
        )  # fmt: skip
        return np.where(hit >= 0, self._face[hit], -1)
