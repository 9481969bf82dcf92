"""Bounds of the second and third derivatives of a lens over parts of an ideal plane.

By Cauchy's estimate a bound M of |u' - k|, with any k, within R of a point bounds the derivatives
there: |u''| <= M / R and |u'''| <= 2 M / R^2. M is found by the equations on complex balls
(`balls.slope_reach`), for each cell of a grid over the region; the best of some radii counts.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov._jit import allocation_free
from rastercov.camera import Camera
from rastercov.lenses import balls, formulas
from rastercov.lenses.of_camera import MOST_LENSES, planes_of
from rastercov.lenses.planes import IdealPlane

FloatArray = NDArray[np.float64]

CELLS = 32
"""Cells of a side of the grid."""
RADII = tuple(np.geomspace(0.01, 0.5, 12).tolist())
"""Radii, in units of the plane, at which bounds are tried; of a plane with a pole, in units of the
distance from it."""


class Slopes(NamedTuple):
    """Bounds of derivatives along lines of a plane, px per unit^2 and unit^3.

    Attributes
    ----------
    low_x, low_y, per_x, per_y : float
        Corner of the grid, and cells a unit.
    second, third : (CELLS, CELLS) float64
        By row (y) and column (x); 0 beyond the region.
    is_graded : bool
        The plane has a pole at (0, 0): bounds at a distance d from it are the next two numbers,
        over d^2 and d^3.
    near_pole_2, near_pole_3 : float
    """

    low_x: float
    low_y: float
    per_x: float
    per_y: float
    second: FloatArray
    third: FloatArray
    is_graded: bool
    near_pole_2: float
    near_pole_3: float


@lru_cache(maxsize=MOST_LENSES)
def slopes_of(camera: Camera) -> tuple[Slopes, ...]:
    """Bounds for each plane of a camera, in the order of `planes_of`."""
    return tuple(_slopes(plane) for plane, _ in planes_of(camera))


def is_affine(plane: IdealPlane) -> bool:
    """True for a lens without distortion: pixels are affine in its plane."""
    p = plane.params
    is_flat = not p[formulas.K1 : formulas.T00].any()
    is_flat = is_flat and p[formulas.T20] == 0.0 and p[formulas.T21] == 0.0
    return bool(plane.code == formulas.PINHOLE and is_flat)


def _slopes(plane: IdealPlane) -> Slopes:
    low, high = plane.region.min(axis=0), plane.region.max(axis=0)
    half = (high - low) / (2 * CELLS)
    middle = low[:, None] + half[:, None] * (2 * np.arange(CELLS) + 1)
    x, y = (grid.ravel() for grid in np.meshgrid(*middle))
    second, third = np.zeros((2, CELLS * CELLS))
    pole = 0.0, 0.0
    if plane.has_pole:
        pole = _near_pole(plane, x, y, float(half.max()))
    elif not is_affine(plane):
        rows = np.flatnonzero(plane.meets(x, y, (float(half[0]), float(half[1]))))
        second[rows] = third[rows] = np.inf
        for radius in RADII:
            # All points of a cell have the ball of its middle within theirs.
            ball = radius + float(half.max())
            change = balls.slope_reach(
                plane.code, plane.params, plane.frame, x[rows], y[rows], ball
            )
            second[rows] = np.minimum(second[rows], change / radius)
            third[rows] = np.minimum(third[rows], 2 * change / radius**2)
    grids = [array.reshape(CELLS, CELLS) for array in (second, third)]
    for grid in grids:
        grid.flags.writeable = False
    per = 1 / (2 * half)
    return Slopes(*low.tolist(), *per.tolist(), *grids, plane.has_pole, *pole)


def _near_pole(plane: IdealPlane, x: FloatArray, y: FloatArray, half: float) -> tuple[float, float]:
    """Bounds of second and third derivatives times d^2 and d^3, d the distance from the pole.

    Longitude is the same along a ray from the pole, so that its derivatives are those at d = 1 over
    powers of d; the derivatives of latitude grow less. So the ring from 1/2 outwards bounds those
    of all smaller ones.
    """
    is_near = plane.meets(x, y, (half, half)) & (np.hypot(x, y) >= 0.5 - 2 * half)
    x, y = x[is_near], y[is_near]
    second = third = np.inf
    size = np.hypot(x, y)
    for radius in RADII:
        change = balls.slope_reach(
            plane.code, plane.params, plane.frame, x, y, radius * size + 2 * half
        )
        second = min(second, float((change * size / radius).max(initial=0.0)) * 1.2)
        third = min(third, float((2 * change * size / radius**2).max(initial=0.0)) * 1.4)
    return second, third


@allocation_free
def bounds_within(slopes, low_x, high_x, low_y, high_y):
    """Bounds of the second and third derivatives in the region within a box of a plane."""
    second = third = 0.0
    if slopes.is_graded:
        x = max(low_x, -high_x, 0.0)
        y = max(low_y, -high_y, 0.0)
        d2 = x * x + y * y
        return slopes.near_pole_2 / d2, slopes.near_pole_3 / (d2 * np.sqrt(d2))
    n = slopes.second.shape[0]
    first = min(max(int((low_x - slopes.low_x) * slopes.per_x), 0), n - 1)
    last = min(max(int((high_x - slopes.low_x) * slopes.per_x), 0), n - 1)
    top = min(max(int((low_y - slopes.low_y) * slopes.per_y), 0), n - 1)
    bottom = min(max(int((high_y - slopes.low_y) * slopes.per_y), 0), n - 1)
    for row in range(top, bottom + 1):
        for column in range(first, last + 1):
            second = max(second, slopes.second[row, column])
            third = max(third, slopes.third[row, column])
    return second, third
