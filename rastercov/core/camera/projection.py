"""World to image and back: projection, clipping, rays of pixels, and boxes of pixels, in float64.

The thesis projects without clipping, which mirrors what lies behind the camera into the image
(29,805.6 px^2 become 444.4 in one example). Here a face is cut at the near plane first, and at
the image border where the part inside the image is asked for.

E. S. Eissa. Image Space Coverage Model. 2020, (3.2)-(3.5), (3.9).
"""

import numpy as np

from rastercov.base import FloatArray, arctan2, cos, matmul, norm, sin
from rastercov.core.camera.camera import Camera, border_of
from rastercov.core.camera.lenses.of_camera import lens_of, optics_of, unit_of
from rastercov.core.camera.models import MODELS


def to_camera(points: FloatArray, pose: FloatArray) -> FloatArray:
    """World points (..., 3) in camera axes: x right, y down, z forward (the depth), metres.

    The eye is subtracted first, so that far offsets cost no precision.
    """
    # R^T p written as p R: the rows of the result are points.
    return matmul(points - pose[:3, 3], pose[:3, :3])


def to_image(points: FloatArray, camera: Camera) -> FloatArray:
    """Image points (..., 2) of points (..., 3) in camera axes, px from the top-left corner.

    u = fx x/z + cx, v = fy y/z + cy, (3.2) with (3.5) put right. z must not be 0; points behind the
    camera come out mirrored: clip first. Of parallel rays u = fx x + cx. Other lenses give NaN
    outside their valid region.
    """
    if camera.is_curved:
        if camera.is_parallel:
            points = points.copy()
            points[..., 2] = unit_of(camera)
        return lens_of(camera).project(points)
    if camera.is_parallel:
        return points[..., :2] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    return points[..., :2] / points[..., 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)


def box_corners(bounds: FloatArray) -> FloatArray:
    """The eight corners of a bounding box, (2, 3) -> (8, 3)."""
    return bounds[(np.arange(8)[:, None] >> np.arange(3)) & 1, np.arange(3)]


def rays_of(pixels: FloatArray, camera: Camera) -> FloatArray:
    """Rays (..., 3), in camera axes, of points (..., 2) of the image, px; of any length.

    Those of a pinhole have z = 1, those of other lenses unit length; NaN for points that no ray of
    the lens meets. CameraError for parallel rays, see `starts_of`.
    """
    camera.check_central("rays through pixels")
    if not camera.is_pinhole:
        return lens_of(camera).unproject(pixels)
    slopes = (pixels - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
    return np.concatenate((slopes, np.ones((*slopes.shape[:-1], 1))), axis=-1)


def starts_of(pixels: FloatArray, camera: Camera) -> FloatArray:
    """Origins (..., 3) of parallel rays through pixels (..., 2), metres in camera axes.

    NaN for points that no ray of the lens meets.
    """
    if camera.is_curved:
        rays = lens_of(camera).unproject(pixels)
        return rays / rays[..., 2:] * (unit_of(camera), unit_of(camera), 0.0)
    places = (pixels - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
    return np.concatenate((places, np.zeros((*places.shape[:-1], 1))), axis=-1)


def view_border(camera: Camera, parts: int) -> FloatArray:
    """Rays (4 `parts`, 3) around the field of view, `parts` from each corner of the image on.

    They go around the image from its top left corner, clockwise: with z = 1 where the image is that
    of a plane, and of unit length otherwise. Where the image ends beyond the valid region of the
    lens, they are on the border of that. An image of all directions has no border; its rays go once
    around the horizon.
    """
    pixels = border_of(camera.width, camera.height, parts + 1)[:, :-1].reshape(-1, 2)
    if camera.model == "equirectangular":
        pixels = np.stack(
            (
                camera.width * np.arange(4 * parts) / (4 * parts),
                np.full(4 * parts, to_image(np.array((0.0, 0.0, 1.0)), camera)[1]),
            ),
            axis=1,
        )
    rays = rays_of(pixels, camera)
    if camera.is_pinhole:
        return rays
    lost = ~np.isfinite(rays).all(axis=1)
    if lost.any():
        angle = lens_of(camera).valid_angle
        away = (pixels[lost] - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
        away /= norm(away)[..., None]
        rays[lost, :2], rays[lost, 2] = sin(angle) * away, cos(angle)
    if MODELS[camera.model].is_planar:
        rays /= rays[:, 2:]
    return rays


def view_frame(camera: Camera, parts: int, length: float) -> tuple[FloatArray, FloatArray]:
    """Ends (4 `parts`, 3) of rays around the field of view, in camera axes: first and last.

    Those of `view_border` start in the camera centre, and the longest is of that length; parallel
    rays start before the front of the lens.
    """
    if camera.is_parallel:
        unit = unit_of(camera)
        starts = view_border(optics_of(camera), parts) * (unit, unit, 0.0)
        return starts, np.add(starts, (0.0, 0.0, length))
    rays = view_border(camera, parts)
    rays *= length / float(norm(rays).max())
    return np.zeros_like(rays), rays


def angles_of_view(camera: Camera) -> tuple[float, float]:
    """Angles between left and right, and top and bottom, through the principal point, degrees.

    Where the image ends beyond the valid region of the lens, that ends them.
    """
    centre = np.array((camera.cx, camera.cy))
    away = np.outer((0, 1), (camera.width, camera.height)) - centre
    rays = rays_of(centre + away[..., None] * np.eye(2), camera)
    angles = np.abs(arctan2(rays[:, (0, 1), (0, 1)], rays[..., 2]))
    if np.isnan(angles).any():
        most = lens_of(camera).valid_angle
        to_pole = most / (1 + (camera.model == "equirectangular"))
        angles = np.where(np.isnan(angles), (most, to_pole), angles)
    horizontal, vertical = np.degrees(np.diff(angles * np.sign(away), axis=0)[0]).tolist()
    return horizontal, vertical
