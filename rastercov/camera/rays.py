"""Rays of points of an image, and around its field of view: for pinholes and any other lens."""

import numpy as np
from numpy.typing import NDArray

from rastercov.camera.camera import Camera
from rastercov.camera.models import MODELS
from rastercov.camera.projection import to_image

FloatArray = NDArray[np.float64]


def rays_of(pixels: FloatArray, camera: Camera) -> FloatArray:
    """Rays (..., 3), in camera axes, of points (..., 2) of the image, px; of any length.

    Those of a pinhole have z = 1, those of other lenses unit length; NaN for points that no ray of
    the lens meets.
    """
    if not camera.is_pinhole:
        from rastercov.camera.lenses.of_camera import lens_of  # loads numba

        return lens_of(camera).unproject(pixels)
    slopes = (pixels - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
    return np.concatenate((slopes, np.ones((*slopes.shape[:-1], 1))), axis=-1)


def border_of(camera: Camera, n: int) -> FloatArray:
    """Points (4, n, 2) on the borders of the image, px: top, right, bottom and left.

    Each border has its ends, at equal steps, in the order in which they go around the image.
    """
    steps = np.linspace(0.0, 1.0, n)[:, None]
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * (camera.width, camera.height)
    starts, ends = corners[:, None], np.roll(corners, -1, axis=0)[:, None]
    border: FloatArray = (1 - steps) * starts + steps * ends
    return border


def view_border(camera: Camera, parts: int) -> FloatArray:
    """Rays (4 `parts`, 3) around the field of view, `parts` from each corner of the image on.

    They go around the image from its top left corner, clockwise: with z = 1 where the image is that
    of a plane, and of unit length otherwise. Where the image ends beyond the valid region of the
    lens, they are on the border of that. An image of all directions has no border; its rays go once
    around the horizon.
    """
    pixels = border_of(camera, parts + 1)[:, :-1].reshape(-1, 2)
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
        from rastercov.camera.lenses.of_camera import lens_of  # loads numba

        angle = lens_of(camera).valid_angle
        away = (pixels[lost] - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        rays[lost, :2], rays[lost, 2] = np.sin(angle) * away, np.cos(angle)
    if MODELS[camera.model].is_planar:
        rays /= rays[:, 2:]
    return rays
