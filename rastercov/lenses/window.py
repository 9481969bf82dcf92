"""Window of an ideal plane: few sides around all that the image shows of its region.

The border of a region is a circle of 128 sides, nearly all of whose images are outside the image.
A chord from corner i to corner j of the region cuts off a piece of it. The lens is a homeomorphism,
so a piece whose border misses the image has either all of the image or nothing of it, and nothing
if a point of the rest of the region has its pixel in the image.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.lenses import formulas
from rastercov.lenses.planes import IdealPlane

FloatArray = NDArray[np.float64]

PARTS = 64
"""Parts of a segment whose images are compared with the image, each with its bend."""
ROUNDING_PX = 1e-9
"""More than the rounding of a pixel."""
FEW_SIDES = 8
"""A region of so few sides is its own window."""


def window_of(plane: IdealPlane, width: float, height: float, bend: float) -> FloatArray:
    """Convex polygon within the region that holds every point of it whose pixel is in the image.

    Parameters
    ----------
    plane : IdealPlane
    width, height : float
        Size of the image, px.
    bend : float
        Bound of the second derivative of pixels along lines of the plane, px; infinite for a plane
        with a pole.

    Returns
    -------
    (K, 2) float64
        Some corners of the region, in its order; all of them if nothing is proved.
    """
    region, n = plane.region, len(plane.region)
    if n <= FEW_SIDES or not bend < math.inf:
        return region
    index = np.arange(n)

    def misses(first: NDArray[np.int64], last: NDArray[np.int64]) -> NDArray[np.bool_]:
        """True for chords from corners to corners whose images are outside the image."""
        start, end = region[first % n], region[last % n]
        t = np.linspace(0.0, 1.0, PARTS + 1)[:, None, None]
        u, v = _pixels(plane, (1 - t) * start + t * end)
        stray = bend * ((end - start) ** 2).sum(axis=1) / (8 * PARTS**2) + ROUNDING_PX
        is_out: Any = False
        for value, size in ((u, width), (v, height)):
            low, high = np.minimum(value[1:], value[:-1]), np.maximum(value[1:], value[:-1])
            is_out = is_out | (high < -stray) | (low > size + stray)
        result: NDArray[np.bool_] = is_out.all(axis=0)
        return result

    # A chord is good if it misses the image, and if all sides that it cuts off do. Then so does any
    # chord between corners of the piece that it cuts off.
    is_free = np.tile(misses(index, index + 1), 2)
    next_met = np.minimum.accumulate(np.where(is_free, 2 * n, np.arange(2 * n))[::-1])[::-1]
    low, high = np.ones(n, np.int64), np.maximum(np.minimum(next_met[:n] - index, n - 2), 1)
    while (low < high).any():
        middle = (low + high + 1) // 2
        is_good = misses(index, index + middle)
        low, high = np.where(is_good, middle, low), np.where(is_good, high, middle - 1)
        low = np.minimum(low, np.maximum(high, 1))
    fewest = min((_walk(int(first), low) for first in index), key=len)
    window: FloatArray = region[sorted(fewest)]
    return window if _shows(plane, window, width, height) else region


def _walk(first: int, farthest: NDArray[np.int64]) -> list[int]:
    """Corners of the region that the longest good chords from one of them meet."""
    n, at, corners = len(farthest), first, [first]
    while (at := at + int(farthest[at % n])) < first + n:
        corners.append(at % n)
    return corners


def _shows(plane: IdealPlane, window: FloatArray, width: float, height: float) -> bool:
    """True where some point of a polygon has its pixel in the image."""
    if len(window) < 3:
        return False
    middle = window.mean(axis=0)
    u, v = _pixels(plane, middle + np.linspace(0.0, 0.99, 12)[:, None, None] * (window - middle))
    return bool(((u > 1) & (u < width - 1) & (v > 1) & (v < height - 1)).any())


def _pixels(plane: IdealPlane, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pixels u, v (...) of points (..., 2) of a plane."""
    project: Any = formulas.project  # which has no types
    x, y, z = np.moveaxis(points @ plane.frame[:, :2].T + plane.frame[:, 2], -1, 0)
    with np.errstate(all="ignore"):
        u, v = project(plane.code, plane.params, x, y, z)
    return u, v
