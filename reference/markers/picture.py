"""Pictures of plates, with the depth of field of a lens and the noise of a sensor.

Depth of field is no blur filter: the images from many points of the lens are added up. Each has its
own perspective, in which the plane in focus is fixed, and its own shift by a part of a pixel, which
also smooths edges. From the point (a, b) of a lens of diameter 1, a point at depth z is displaced
by reach (a, b) (1 / z_s - 1 / z) px, where reach |1 / z_s - 1 / z| is its blur circle.

P. Haeberli, K. Akeley. The Accumulation Buffer: Hardware Support for High-Quality Rendering. 1990.
"""

from collections.abc import Sequence

import numpy as np

from rastercov.base import ByteArray, FloatArray, IntArray
from rastercov.core.camera import Camera
from rastercov.reference.coverage import blur_circle
from rastercov.reference.markers.scene import CELLS, MARKER_SIDE, Plate

BLACK, WHITE = 0.05, 0.9
"""Reflectance of ink, and of paper and the wall behind everything."""
IMAGES = 256
"""Points of the lens."""
FULL_SCALE = 255 / 1.05
"""Grey levels of reflectance 1."""


def reflect(
    plates: Sequence[Plate], patterns: ByteArray, camera: Camera, images: int = IMAGES
) -> FloatArray:
    """Reflected light in each pixel, 0 to 1, (H, W).

    Parameters
    ----------
    plates, camera
        Plates and a pinhole; its aperture and focus distance blur the image.
    patterns : (M, 8, 8) uint8
        Cells of each marker, 1 is white.
    images : int
        Points of the lens.
    """
    camera.check_pinhole("expected a pinhole for images of plates")
    drawn = sorted(plates, key=lambda plate: -plate.centre[2])
    boards = [np.pad(patterns[plate.marker], 1, constant_values=1) for plate in drawn]
    greys = [np.where(board, WHITE, BLACK) for board in boards]
    blur = blur_circle(camera, np.array([plate.centre[2] for plate in drawn]))
    total = np.zeros((camera.height, camera.width))
    image = np.empty_like(total)
    for lens, shift in zip(*ray_bundles(images), strict=True):
        image.fill(WHITE)
        for plate, grey, circle in zip(drawn, greys, blur, strict=True):
            across, down = shift + lens * circle
            x, y, z = plate.centre
            columns, u = _cells(camera.width, camera.cx + across, camera.fx / z, x)
            rows, v = _cells(camera.height, camera.cy + down, camera.fy / z, y)
            image[rows, columns] = grey[v][:, u]
        total += image
    return total / images


def _cells(size: int, middle: float, scale: float, centre: float) -> tuple[slice, IntArray]:
    """Pixels along a side whose centres a board covers, and its cell at each of them."""
    place = (np.arange(size) + 0.5 - middle) / scale - centre
    cell = np.floor(place * CELLS / MARKER_SIDE).astype(np.int64) + CELLS // 2 + 1
    is_on = (cell >= 0) & (cell < CELLS + 2)
    first = int(is_on.argmax())
    return slice(first, first + int(is_on.sum())), cell[is_on]


def ray_bundles(count: int) -> tuple[FloatArray, FloatArray]:
    """Points of the lens, a disc of diameter 1, and of the pixel, +-1/2: (count, 2) each.

    A lattice that fills four dimensions evenly: powers of the real root of x^5 = x + 1, after M.
    Roberts. The Unreasonable Effectiveness of Quasirandom Sequences. 2018.
    """
    steps = 1.1673039782614187 ** -np.arange(1.0, 5.0)
    points = (0.5 + np.arange(1, count + 1)[:, None] * steps) % 1.0
    radius, angle = np.sqrt(points[:, 0]) / 2, 2 * np.pi * points[:, 1]
    lens = np.stack((radius * np.cos(angle), radius * np.sin(angle)), axis=1)
    # Relative to their mean; edges would move by a few hundredths of a pixel otherwise.
    return lens, points[:, 2:] - points[:, 2:].mean(axis=0)


def sensor(light: FloatArray, rng: np.random.Generator) -> ByteArray:
    """Grey levels of a sensor, linear, with noise, (H, W).

    The read-out has a standard deviation of 1.5 grey levels; grey level 255 is 1e4 electrons, and
    the standard deviation of electrons is the root of their number.

    Parameters
    ----------
    light : (H, W) float64
        Reflected light, 0 to 1.
    rng : Generator
        Source of the noise.
    """
    level = FULL_SCALE * light
    spread = np.sqrt(1.5**2 + level * 255 / 1e4)
    noisy = level + spread * rng.standard_normal(light.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
