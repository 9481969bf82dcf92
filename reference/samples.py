"""The sampled result by definition: one ray per sample, one test per face, in float64.

What a rasteriser must give, worked out another way: nothing is projected, clipped or rounded to a
grid. A sample is the ray r = ((u - cx)/fx, (v - cy)/fy, 1) from the camera centre, so that t r has
depth t. With a face's corners a, b, c in camera axes and n = (b - a) x (c - a),

    1/t = (n . r) / (n . a),   affine in the image,
    the ray is inside edge (p, q) where  ((p x q) . r) (n . a) >= 0,   a half plane of the image,
    and the hit counts where t >= near, which takes the place of clipping.

So what a camera can see of a face is the common part of four half planes, and the distance of a
sample from their borders says how far it is from being ambiguous. Of two surfaces at equal depth
the face with the lower index wins; a sample on an edge belongs to the face on its right, or below.
A target is no nearest surface: it is visible at each sample where no other face is in front of it.

For images of some thousand samples: the cost is faces times samples. Shares nothing with the
rasterisers but the mesh, the camera and the pose convention.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base import BoolArray, FloatArray, Int32Array, IntArray, frozen_record
from rastercov.core.camera import Camera
from rastercov.core.mesh import Mesh

TIE = 1e-10
"""Relative difference up to which two depths are equal."""


@frozen_record
class SampledView:
    """Surfaces that the samples of one pose meet; arrays (...) have the shape of the samples.

    Attributes
    ----------
    face : (...) int32
        Index of the nearest face that is no target, -1 for background.
    depth : (...) float64
        Its camera z in metres, inf for background.
    edge_distance : (...) float64
        Pixels from the sample to the nearest border of what is in view of any face, or less: it may
        fall short beyond the tip of a needle. Hidden faces count too, so the answer to "which face"
        is at least this far from changing.
    depth_gap : (...) float64
        Depth of the second surface over that of the first, less 1; inf where there is none.
    visible : (F,) int64
        Samples at which each face is the nearest, or a target with nothing in front of it.
    drawn : (F,) int64
        Samples that each face would own alone.
    """

    face: Int32Array
    depth: FloatArray
    edge_distance: FloatArray
    depth_gap: FloatArray
    visible: IntArray
    drawn: IntArray


def render(
    mesh: Mesh, camera: Camera, pose: ArrayLike, supersample: int = 1, near: float | None = None
) -> SampledView:
    """Nearest face at each sample of an image, in arrays of (height * S, width * S).

    Parameters
    ----------
    mesh, camera, pose
        Scene and camera; world_from_camera, (4, 4).
    supersample : int
        S: a pixel has S x S samples, in the middle of S x S equal squares.
    near : float, optional
        Depth in metres below which nothing is seen. `camera.near` unless given, but at least a
        millionth of the distance to the farthest corner of the bounding box of the mesh.
    """
    u = (np.arange(camera.width * supersample) + 0.5) / supersample
    v = (np.arange(camera.height * supersample) + 0.5) / supersample
    return at_points(mesh, camera, pose, np.stack(np.meshgrid(u, v), axis=-1), near)


def count(
    mesh: Mesh,
    camera: Camera,
    pose: ArrayLike,
    supersample: int = 1,
    near: float | None = None,
    roll: float = 0.0,
) -> tuple[IntArray, IntArray]:
    """Samples of each face, (F,) visible and (F,) drawn.

    Arguments as for `render`, and the roll of the samples as for `grid_points`.
    """
    view = at_points(mesh, camera, pose, grid_points(camera, supersample, roll), near)
    return view.visible, view.drawn


def grid_points(
    camera: Camera,
    supersample: int = 1,
    roll: float = 0.0,
    box: tuple[float, float, float, float] | None = None,
) -> FloatArray:
    """Points in the image of a square grid, S^2 per px^2, turned about the image centre, (N, 2).

    The grid has as many rows and columns as the turned image is high and wide, in whole spacings,
    and the same middle. Rows and columns are not distinguished: a quarter turn changes nothing.

    Points are 1 / S px apart; `roll` is in radians from the u axis to the rows, towards the v axis.
    With a `box` (left, top, right, bottom) only those in it, px.
    """
    roll = np.remainder(roll + np.pi / 4, np.pi / 2) - np.pi / 4
    along = np.array((np.cos(roll), np.sin(roll)))
    across = np.array((-np.sin(roll), np.cos(roll)))
    size = np.array((camera.width, camera.height))
    n_along, n_across = (
        int(np.ceil(supersample * (np.abs(axis) @ size) - 1e-9)) for axis in (along, across)
    )
    x = (np.arange(n_along) - (n_along - 1) / 2) / supersample
    y = (np.arange(n_across) - (n_across - 1) / 2) / supersample
    low, high = np.array(box or (0, 0, *size), np.float64).reshape(2, 2).clip(0, size)
    middle, reach = (low + high - size) / 2, np.linalg.norm(high - low) / 2
    x = x[np.abs(x - middle @ along) <= reach]
    y = y[np.abs(y - middle @ across) <= reach]
    points = size / 2 + x[:, None] * along + y[:, None, None] * across
    points = points.reshape(-1, 2)
    return points[((points >= low) & (points <= high)).all(axis=1)]


def at_points(
    mesh: Mesh, camera: Camera, pose: ArrayLike, points: FloatArray, near: float | None = None
) -> SampledView:
    """Nearest face at points (..., 2) of the image, in pixels; other arguments as for `render`."""
    camera.check_pinhole("expected a pinhole for a reference")
    matrix = np.asarray(pose, np.float64)
    eye, rotation = matrix[:3, 3], matrix[:3, :3]
    if near is None:
        farthest = np.linalg.norm(np.abs(mesh.opaque.bounds - eye).max(axis=0))
        near = max(camera.near, 1e-6 * float(farthest))
    x, y = np.moveaxis((points - (camera.cx, camera.cy)) / (camera.fx, camera.fy), -1, 0)
    rays = np.stack((x.ravel(), y.ravel(), np.ones(x.size)))

    nearest, second = np.full((2, x.size), np.inf)
    edge_distance = np.full(x.size, np.inf)
    face = np.full(x.size, -1, np.int32)
    drawn = np.zeros(mesh.n_faces, np.int64)
    targets: list[tuple[int, NDArray[np.intp], FloatArray]] = []
    corners = (mesh.vertices - eye)[mesh.faces] @ rotation
    # A loop over faces: about 60 us each for a thousand samples, and 10 ns a sample beyond that.
    for index, face_planes in enumerate(_half_planes(corners, near)):
        hit, depth, distance = _meet(face_planes, rays, camera, near)
        drawn[index] = len(hit)
        if mesh.target_mask[index]:
            targets.append((index, hit, depth))
            continue
        np.minimum(edge_distance, distance, out=edge_distance)
        former = nearest[hit]
        is_nearer = depth < former * (1 - TIE)
        second[hit] = np.minimum(second[hit], np.where(is_nearer, former, depth))
        nearest[hit] = np.where(is_nearer, depth, former)
        face[hit[is_nearer]] = index
    gap = np.full(nearest.shape, np.inf)
    np.divide(second, nearest, out=gap, where=np.isfinite(nearest))
    visible = np.bincount(face[face >= 0], minlength=mesh.n_faces)
    for index, hit, depth in targets:
        visible[index] = (depth <= nearest[hit] * (1 + TIE)).sum()
    return SampledView(
        face.reshape(x.shape),
        nearest.reshape(x.shape),
        edge_distance.reshape(x.shape),
        gap.reshape(x.shape) - 1,
        visible,
        drawn,
    )


def _half_planes(
    corners: FloatArray, near: float
) -> Iterator[tuple[float, FloatArray, FloatArray, FloatArray]]:
    """Of each face |n . a|, and n, the horizon of the near plane and three edges for a ray to meet.

    Corners (F, 3, 3) are in camera axes. The products of all five vectors with r are positive where
    the ray meets the face.
    """
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    # Six times the volume of the tetrahedron with the eye; 0 is edge-on.
    volumes = np.sum(normals * corners[:, 0], axis=1)
    is_front = volumes >= 0
    normals *= np.where(is_front, 1, -1)[:, None]
    # t >= near, as a half plane: |volume| - near |n . r| >= 0 where n . r is on the face's side
    horizons = -near * normals
    horizons[:, 2] += np.abs(volumes)
    lines = np.empty_like(corners)
    for edge, (p, q) in enumerate(((0, 1), (1, 2), (2, 0))):
        # Both faces of an edge must get the same numbers, so the ends are put in a fixed order.
        same_way = _is_before(corners[:, p], corners[:, q])
        first, last = (
            np.where(same_way[:, None], corners[:, ends[0]], corners[:, ends[1]])
            for ends in ((p, q), (q, p))
        )
        lines[:, edge] = np.cross(first, last - first)
        lines[:, edge] *= np.where(same_way == is_front, 1, -1)[:, None]
    yield from zip(np.abs(volumes).tolist(), normals, horizons, lines, strict=True)


def _is_before(p: FloatArray, q: FloatArray) -> BoolArray:
    """Lexical order of points (F, 3)."""
    less, same = p < q, p == q
    return less[:, 0] | same[:, 0] & (less[:, 1] | same[:, 1] & less[:, 2])


def _meet(
    face_planes: tuple[float, FloatArray, FloatArray, FloatArray],
    rays: FloatArray,
    camera: Camera,
    near: float,
) -> tuple[NDArray[np.intp], FloatArray, FloatArray]:
    """Indices of the rays that meet a face, their depths there, and pixels of all to its border.

    Rays (3, N) are in camera axes and have z = 1.
    """
    volume, normal, horizon, lines = face_planes
    towards = normal @ rays
    margin = _pixels(horizon @ rays, horizon, camera)
    covered = (towards > 0) & (volume >= near * towards) & (volume != 0)
    for line in lines:
        value = line @ rays
        is_right_or_below = line[0] > 0 or (line[0] == 0 and line[1] > 0)
        covered &= (value >= 0) if is_right_or_below else (value > 0)
        np.minimum(margin, _pixels(value, line, camera), out=margin)
    hit = np.flatnonzero(covered)
    return hit, volume / towards[hit], np.abs(margin)


def _pixels(value: FloatArray, line: FloatArray, camera: Camera) -> FloatArray:
    """Signed distance from the line of the image where line . r = 0, given its value at r."""
    slope = float(np.hypot(line[0] / camera.fx, line[1] / camera.fy))
    return value / slope if slope > 0 else np.where(value >= 0, np.inf, -np.inf)
