"""Boxes of pixels that a mesh or a bounding box can reach in an image."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rastercov.camera.camera import Camera
from rastercov.camera.projection import to_image

if TYPE_CHECKING:
    from rastercov.camera.lenses.planes import IdealPlane

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

STEPS = 64
"""Parts of each side of a box whose image is bounded."""
INSIDE_REL = 1e-9
"""Distance of the samples of a border from it, relative to the box: less than the pixel that boxes
are wider than need be."""


def image_boxes(points: FloatArray, camera: Camera, poses: FloatArray) -> IntArray:
    """Pixels that anything within the convex hull of `points` (N, 3) can reach in each pose.

    The boxes (P, 4) are left, top, right, bottom in pixels, within the image, a pixel wider than
    need be; the whole image when a point lies behind the camera. So too where a point is out of the
    one ideal plane of another lens, or its image has several planes.
    """
    boxes = np.tile(np.array((0, 0, camera.width, camera.height)), (len(poses), 1))
    size = camera.width, camera.height
    planes = None
    if not camera.is_pinhole:
        from rastercov.camera.lenses.of_camera import lens_of  # loads numba

        planes = lens_of(camera).planes
        if len(planes) > 1:
            return boxes
    for row, pose in enumerate(poses):  # 10 us and 12 ns a point; all at once is no faster
        x, y, z = pose[:3, :3].T @ (points - pose[:3, 3]).T
        if not z.min() > 0:
            continue
        if planes is None:
            u, v = camera.fx * (x / z) + camera.cx, camera.fy * (y / z) + camera.cy
            low, high = np.array((u.min(), v.min())), np.array((u.max(), v.max()))
        else:
            slopes = np.stack((x / z, y / z), axis=1)
            low, high = _lens_box(camera, planes[0], slopes.min(axis=0), slopes.max(axis=0))
        boxes[row, :2] = np.clip(np.floor(low) - 1, 0, size)
        boxes[row, 2:] = np.clip(np.ceil(high) + 1, 0, size)
    return boxes


def _lens_box(
    camera: Camera, plane: "IdealPlane", low: FloatArray, high: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Bounds (2,) and (2,) in the image of what a lens makes of a box of its ideal plane.

    A lens maps the border of the part that it sees to the border of its image. The border is
    sampled; between samples a distance L apart its image leaves their chord by `bend` L^2 / 8.
    """
    from rastercov.camera.lenses.planes import keep

    part = plane.region
    for axis, limit, sign in ((0, low, 1.0), (1, low, 1.0), (0, high, -1.0), (1, high, -1.0)):
        if len(part) >= 3:
            side = sign * np.eye(2)[axis]
            part = keep(part, side[0], side[1], float(-sign * limit[axis]))
    if len(part) < 3:
        return np.zeros(2), np.zeros(2)
    steps = np.linspace(0.0, 1.0, STEPS, endpoint=False)[:, None]
    starts, ends = part, np.roll(part, -1, axis=0)
    slopes = (1 - steps) * starts[:, None] + steps * ends[:, None]
    # Slightly inside, so that rounding leaves no sample outside the region.
    slopes = part.mean(axis=0) + (1 - INSIDE_REL) * (slopes.reshape(-1, 2) - part.mean(axis=0))
    rays = np.concatenate((slopes, np.ones((len(slopes), 1))), axis=1)
    pixels = to_image(rays, camera)
    apart = plane.camera.fx * np.linalg.norm(ends - starts, axis=1).max() / STEPS
    bulge = plane.bend() * apart * apart / 8
    return pixels.min(axis=0) - bulge, pixels.max(axis=0) + bulge


def box_corners(bounds: FloatArray) -> FloatArray:
    """The eight corners of a bounding box, (2, 3) -> (8, 3)."""
    which: FloatArray = bounds[(np.arange(8)[:, None] >> np.arange(3)) & 1, np.arange(3)]
    return which
