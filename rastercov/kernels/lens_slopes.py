"""Bounds of the derivatives of a lens over a box of an ideal plane, looked up in a grid.

`rastercov.camera.lenses.slopes` makes the grid.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.kernels.jit import allocation_free

FloatArray = NDArray[np.float64]

CELLS, PARTS = 32, 4
"""Cells of a side of the grid for balls, and parts of the side of a cell."""


class Slopes(NamedTuple):
    """Bounds of derivatives along lines of a plane, px per unit^2 and unit^3.

    Attributes
    ----------
    low_x, low_y, per_x, per_y : float
        Corner of the grid, and cells a unit.
    second, third : (CELLS PARTS, CELLS PARTS) float64
        By row (y) and column (x); 0 beyond the region.
    sizes : (2, CELLS, CELLS) float64
        Least and greatest |det A|, A the first derivative of pixels, px^2, of each cell of PARTS x
        PARTS parts; infinite and 0 beyond the region; 0 and infinite where nothing is known.
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
    sizes: FloatArray
    is_graded: bool
    near_pole_2: float
    near_pole_3: float


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


@allocation_free
def sizes_within(slopes, low_x, high_x, low_y, high_y):
    """Least and greatest `Slopes.sizes` in the region within a box of a plane; 0 at a pole."""
    if slopes.is_graded:
        return 0.0, math.inf
    least, most = math.inf, 0.0
    n = slopes.sizes.shape[1]
    left = min(max(int((low_x - slopes.low_x) * slopes.per_x) // PARTS, 0), n - 1)
    right = min(max(int((high_x - slopes.low_x) * slopes.per_x) // PARTS, 0), n - 1)
    top = min(max(int((low_y - slopes.low_y) * slopes.per_y) // PARTS, 0), n - 1)
    bottom = min(max(int((high_y - slopes.low_y) * slopes.per_y) // PARTS, 0), n - 1)
    for row in range(top, bottom + 1):
        for column in range(left, right + 1):
            least = min(least, slopes.sizes[0, row, column])
            most = max(most, slopes.sizes[1, row, column])
    return least, most
