"""World to image: projection, clipping and projected area, in float64.

The thesis projects without clipping, which mirrors what lies behind the camera into the image
(29,805.6 px^2 become 444.4 in one example). Here a face is cut at the near plane first, and at
the image border where the part inside the image is asked for.

E. S. Eissa. Image Space Coverage Model. 2020, (3.2)-(3.5), (3.9).
"""

import numpy as np
from numpy.typing import NDArray

from rastercov.camera.camera import Camera

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]


def to_camera(points: FloatArray, pose: FloatArray) -> FloatArray:
    """World points (..., 3) in camera axes: x right, y down, z forward (the depth), metres.

    The eye is subtracted first, so that far offsets cost no precision.
    """
    # R^T p written as p R: the rows of the result are points.
    return (points - pose[:3, 3]) @ pose[:3, :3]


def to_image(points: FloatArray, camera: Camera) -> FloatArray:
    """Image points (..., 2) of points (..., 3) in camera axes, px from the top-left corner.

    u = fx x/z + cx, v = fy y/z + cy, (3.2) with (3.5) put right. z must not be 0; points behind the
    camera come out mirrored: clip first. Other lenses give NaN outside their valid region.
    """
    if not camera.is_pinhole:
        from rastercov.camera.lenses.of_camera import lens_of  # loads numba

        return lens_of(camera).project(points)
    return points[..., :2] / points[..., 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)


def clip_polygons(
    corners: FloatArray, counts: IntArray, distance: FloatArray
) -> tuple[FloatArray, IntArray]:
    """Clip each convex polygon to where `distance` is not negative (Sutherland-Hodgman).

    Parameters
    ----------
    corners : (N, K, D) float64
        Corners in order; rows past a polygon's count repeat its last corner.
    counts : (N,) int
        Corners in use, 0 for an empty polygon.
    distance : (N, K) float64
        Signed distance of each corner from the clipping plane, affine along the edges.

    Returns
    -------
    corners : (N, K + 1 or more, D) float64
        Padded like the input.
    counts : (N,) int
    """
    n, k, d = corners.shape
    used = np.arange(k) < counts[:, None]
    following = np.where(np.arange(k) + 1 < counts[:, None], np.arange(k) + 1, 0)
    next_corner = np.take_along_axis(corners, following[:, :, None], axis=1)
    next_distance = np.take_along_axis(distance, following, axis=1)
    kept = used & (distance >= 0)
    crossed = used & ((distance >= 0) != (next_distance >= 0))
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(crossed, distance / (distance - next_distance), 0.0)
    cut = corners + t[:, :, None] * (next_corner - corners)

    # Each corner is followed by the cut on the edge that leaves it; then close the gaps.
    both = np.stack((corners, cut), axis=2).reshape(n, 2 * k, d)
    alive = np.stack((kept, crossed), axis=2).reshape(n, 2 * k)
    new_counts = alive.sum(axis=1)
    # A convex polygon gains a corner at most; one that lies in the cut itself, where rounding
    # decides the signs, can gain more.
    width = max(k + 1, int(new_counts.max(initial=0)))
    order = np.argsort(~alive, axis=1, kind="stable")[:, :width]
    last = np.maximum(new_counts - 1, 0)[:, None]
    order = np.take_along_axis(order, np.minimum(np.arange(width), last), axis=1)
    return np.take_along_axis(both, order[:, :, None], axis=1), new_counts


def polygon_area(corners: FloatArray, counts: IntArray) -> FloatArray:
    """Area of each polygon by (3.9), px^2, positive where it runs clockwise in the image (v down).

    Corners are padded as `clip_polygons` returns them, (N, K, 2); fewer than 3 have no area.
    """
    local = corners - corners[:, :1]  # differences first: no cancellation far from the origin
    ahead = np.roll(local, -1, axis=1)
    twice = (local[..., 0] * ahead[..., 1] - local[..., 1] * ahead[..., 0]).sum(axis=1)
    return np.where(counts >= 3, twice / 2, 0.0)


def clip_near(corners: FloatArray, near: float) -> tuple[FloatArray, IntArray]:
    """Faces cut at the near plane: (N, 3, 3) in camera axes -> (N, 4, 3) and their counts."""
    counts = np.full(len(corners), 3)
    return clip_polygons(corners, counts, corners[..., 2] - near)


def clip_to_image(
    corners: FloatArray, counts: IntArray, camera: Camera
) -> tuple[FloatArray, IntArray]:
    """Image polygons cut at the image border: (N, K, 2) -> (N, K + 4, 2) and their counts."""
    for axis, side in ((0, camera.width), (1, camera.height)):
        corners, counts = clip_polygons(corners, counts, corners[..., axis])
        corners, counts = clip_polygons(corners, counts, side - corners[..., axis])
    return corners, counts
