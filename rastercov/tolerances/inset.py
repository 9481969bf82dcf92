"""Images of lenses less a border, whose rays stay in the image whatever the errors of a camera.

A turn of a ray by an angle t moves its pixel by at most K t, K the most pixels per radian that the
lens has in its image, as long as the pixel stays there. The image alone bounds what such a lens
sees, so what an image less a border of K t shows is in the image with all errors. A focal length
that is longer by a share p is an image that is smaller by 1 + p. See docs/appendix/tolerance.md.
"""

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from rastercov.base import TINY, BoolArray, ConfigError, FloatArray, shown
from rastercov.core.camera import Camera
from rastercov.core.camera.lenses.of_camera import lens_of, planes_of
from rastercov.core.camera.lenses.planes import first_derivatives

MOST_LENSES = 256
STEPS = 8
"""Widths of borders are whole pixels, rounded up to an eighth of a power of two: cameras share
lenses."""


def check_lens(name: str, camera: Camera) -> None:
    """ConfigError for a lens of which more than the border of its image bounds what it sees."""
    if len(lens_of(camera).planes) > 1:
        raise ConfigError(
            "expected lenses up to 72 degrees off their axis with installation errors, got "
            f"{shown(name)}; check it without installation errors"
        )
    if any(each.record.arc_half > 0 for each in planes_of(camera)) or not lens_of(camera).is_whole:
        raise ConfigError(
            "expected lenses that are valid in all of the image with installation errors, got "
            f"{shown(name)}; crop its image"
        )


def around_lens(camera: Camera, focal: float) -> Camera:
    """Pinhole whose image holds what a lens shows with errors of its focal length up to a share."""
    wide = replace(camera, fx=camera.fx * (1 - focal), fy=camera.fy * (1 - focal))
    result = planes_of(replace(wide, skew=camera.skew * (1 - focal)))[0].camera
    return replace(result, near=camera.near)


@lru_cache(maxsize=MOST_LENSES)
def pixels_a_radian(camera: Camera) -> float:
    """Bound of the pixels by which a turn of a ray moves it, a radian, where the image shows it.

    In parts of the ideal plane. A turn at the distance r from its middle moves the place by
    T = (1 + r^2)^(1/2) across and 1 + r^2 along; within a distance e, T changes by at most
    4 (r + e) e, and the first derivative J of pixels by e times the bound of the second.
    """
    plane, slopes = planes_of(camera)[0].record, planes_of(camera)[0].slopes
    rows, columns = np.indices(slopes.second.shape).reshape(2, -1)
    per = np.array([slopes.per_x, slopes.per_y])
    middle = np.column_stack([columns, rows]) + 0.5
    middle = np.array([slopes.low_x, slopes.low_y]) + middle / per
    is_met = plane.meets(middle[:, 0], middle[:, 1], (0.5 / per[0], 0.5 / per[1]))
    middle, second = middle[is_met], slopes.second[rows[is_met], columns[is_met]]
    e = float(np.hypot(*(0.5 / per)))
    J = first_derivatives(plane, middle).reshape(-1, 2, 2)
    size = np.linalg.norm(J, 2, axis=(1, 2)) if len(J) else np.zeros(0)
    pixels = lens_of(camera).project(np.column_stack([middle, np.ones(len(middle))]))
    reach = (size + second * e) * e
    beyond = np.maximum(-pixels, pixels - (camera.width, camera.height)).max(axis=1)
    is_shown = ~(beyond > reach)
    r = np.hypot(*middle.T)
    along = middle / np.maximum(r, TINY)[:, None]
    s = np.sqrt(1 + r * r)
    T = s[:, None, None] * np.eye(2)
    T = T + ((1 + r * r) - s)[:, None, None] * along[:, :, None] * along[:, None, :]
    most = np.linalg.norm(J @ T, 2, axis=(1, 2)) + second * e * (1 + (r + e) ** 2)
    most += size * 4 * (r + e) * e
    value = float(most[is_shown].max(initial=0.0))
    if not value < math.inf:
        raise ConfigError(
            "expected a lens of bounded pixels per radian, got none; omit the installation errors"
        )
    return value


def inset(camera: Camera, size: FloatArray, nearest: float) -> Camera | None:
    """The lens with the part of its image that stays in the image of points that far, or farther.

    `size` are errors of a pose, (3,); None where no part does.
    """
    d, a, p = size.tolist()
    turn = a + (math.asin(min(1.0, d / nearest)) if nearest > 0 else math.pi / 2)
    border = math.ceil(pixels_a_radian(camera) * turn)
    step = max(1, 2 ** (border.bit_length() - 1) // STEPS)
    border = step * math.ceil(border / step)
    left, top = camera.cx / (1 + p) - border, camera.cy / (1 + p) - border
    width = math.floor(left + (camera.width - camera.cx) / (1 + p) - border)
    height = math.floor(top + (camera.height - camera.cy) / (1 + p) - border)
    is_inside = 0 < camera.cx < camera.width and 0 < camera.cy < camera.height
    if min(width, height) < 1 or (p > 0 and not is_inside):
        return None
    return replace(camera, width=width, height=height, cx=left, cy=top)


def shows(camera: Camera, points: FloatArray) -> BoolArray:
    """(N,) points in camera axes, (N, 3), that are in the image of a lens."""
    pixels = lens_of(camera).project(points)
    u, v = pixels[:, 0], pixels[:, 1]
    return (u >= 0) & (u <= camera.width) & (v >= 0) & (v <= camera.height)
