"""Bounds of the Taylor coefficients of a lens along lines of an ideal plane.

The equations of the lens are evaluated at p + t d, p all points of a cell and d a unit vector, as
polynomials in t up to t^ORDER. Their coefficients are intervals that hold those of each p, around
those of the middle. A coefficient c_k, the k-th derivative over k!, is a form of degree k in d.
With C_k the greatest over all d,

    C_k at q <= sum over j < m of binomial(k + j, j) |q - p|^j C_(k+j) at p
                + binomial(k + m, m) |q - p|^m C_(k+m) on the way,

because derivatives along different directions are no greater than those along one [S. Banach. Über
homogene Polynome in (L^2). 1938]. Intervals get wider with each order, and so the best m counts:
the result is near the truth, while Cauchy's estimate from complex balls is a hundred times too
large.

In the plane a form of degree k is a trigonometric polynomial of degree k of the angle of d, so
DIRECTIONS of them bound all others: where such a polynomial is greatest, at M, it is at least
M cos(k a) at the angle a from there [M. Riesz. Eine trigonometrische Interpolationsformel. 1914],
and a direction is within half a step.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.camera.lenses.planes import IdealPlane
from rastercov.kernels import lens_expansions as kernels
from rastercov.kernels import lens_formulas

FloatArray = NDArray[np.float64]

ORDER = 18
DIRECTIONS = 20
"""In half a turn; the other half differs by a sign."""
CELLS = 12
"""Cells of a side of the box around a region."""
ROUNDING_REL = 2.0**-40
"""Rounding of a coefficient relative to its bound by Cauchy's estimate."""
UNKNOWN = (lens_formulas.BACKWARD, lens_formulas.EQUIRECT)
"""Bases without such a bound: one needs an inverse, the other has poles."""


class Expansion:
    """Coefficients of t^0 ... t^k in rows, intervals `centre` +- `radius`; those above are 0."""

    __array_ufunc__ = None  # numpy leaves the operations to this class

    def __init__(self, centre: FloatArray, radius: FloatArray) -> None:
        self.centre, self.radius = centre, radius

    def __add__(self, other: Any) -> "Expansion":
        if not isinstance(other, Expansion):
            centre = self.centre.copy()
            centre[0] += other
            return Expansion(centre, self.radius)
        one, two = (self, other) if len(self.centre) >= len(other.centre) else (other, self)
        n, centre, radius = len(two.centre), one.centre.copy(), one.radius.copy()
        centre[:n] += two.centre
        radius[:n] += two.radius
        return Expansion(centre, radius)

    __radd__ = __add__

    def __neg__(self) -> "Expansion":
        return Expansion(-self.centre, self.radius)

    def __sub__(self, other: Any) -> "Expansion":
        result: Expansion = self + -other
        return result

    def __rsub__(self, other: Any) -> "Expansion":
        result: Expansion = -self + other
        return result

    def __mul__(self, other: Any) -> "Expansion":
        if not isinstance(other, Expansion):
            return Expansion(self.centre * other, self.radius * abs(other))
        n = min(len(self.centre) + len(other.centre) - 1, ORDER + 1)
        centre, radius = np.zeros((2, n, self.centre.shape[1]))
        kernels.multiply(self.centre, self.radius, other.centre, other.radius, centre, radius)
        return Expansion(centre, radius)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> "Expansion":
        result: Expansion = self * (1.0 / other)
        return result

    def __rtruediv__(self, other: float) -> "Expansion":
        centre, radius = np.zeros((2, ORDER + 1, self.centre.shape[1]))
        centre[0], radius[0] = _inverse(self.centre[0], self.radius[0])
        kernels.invert(self.centre, self.radius, centre, radius)
        return Expansion(centre * other, radius * abs(other))


def _inverse(centre: FloatArray, radius: FloatArray) -> tuple[FloatArray, FloatArray]:
    """1 / x of intervals, as `Expansion`; without limit where one holds 0."""
    size = np.abs(centre)
    is_good = size > radius
    gap = np.where(is_good, size * (size - radius), 1.0)
    return np.where(is_good, 1.0 / centre, 0.0), np.where(is_good, radius / gap, np.inf)


def _sqrt(value: Any) -> Any:
    if not isinstance(value, Expansion):
        return np.sqrt(value)
    a, off = value.centre[0], value.radius[0]
    centre, radius = np.zeros((2, ORDER + 1, len(a)))
    centre[: len(value.centre)], radius[: len(value.centre)] = value.centre, value.radius
    is_good = a > off
    centre[0] = np.sqrt(np.where(is_good, a, 1.0))
    # |sqrt x - sqrt c| = |x - c| / (sqrt x + sqrt c)
    least = np.sqrt(np.where(is_good, a - off, 1.0))
    radius[0] = np.where(is_good, off / (centre[0] + least), np.inf)
    inverse, inverse_off = _inverse(2.0 * centre[0], 2.0 * radius[0])
    kernels.take_root(inverse, inverse_off, centre, radius)
    return Expansion(centre, radius)


def _angle_over_r(r2: Any, z: Any) -> Any:
    """Angle from the z axis over r, see `kernels.lens_lanes.angle_over_r`."""
    c = 1.0 / (z + _sqrt(r2 + z * z))
    for _ in range(3):
        c = c / (1.0 + _sqrt(1.0 + r2 * (c * c)))
    q = r2 * (c * c)
    series: Any = 1.0 / 21.0
    for odd in range(19, 0, -2):
        series = 1.0 / odd - q * series
    return 16.0 * (c * series)


_project: Any = lens_formulas.bound_to({"sqrt": _sqrt, "angle_over_r": _angle_over_r})["project"]


def coefficient_bounds(plane: IdealPlane) -> FloatArray:
    """Bounds of the Taylor coefficients of u and v along all lines, at points of the region.

    Returns
    -------
    (2, ORDER + 1) float64
        Of t^k in column k, px per (unit of the plane)^k. Infinite for k = 0, which changes nothing,
        and where nothing is known: for a plane with a pole, whose reach is not in its units.
    """
    order = np.arange(ORDER + 1)
    found = np.full((2, ORDER + 1), np.inf)
    if plane.has_pole or not plane.reaches:
        return found
    radii, *reach = (np.array(each) for each in zip(*plane.reaches, strict=True))
    by_cauchy = np.stack([(each / radii ** order[:, None]).min(axis=1) for each in reach])
    if plane.code not in UNKNOWN:
        x, y, half = _cells(plane)
        middle, everywhere = _in_cells(plane, x, y, half)
        rounding = ROUNDING_REL * by_cauchy[:, :, None]
        best = np.minimum(everywhere + rounding, by_cauchy[:, :, None])
        middle, away = middle + rounding, math.hypot(*half)
        for k in range(ORDER):
            total = np.zeros_like(best[:, k])
            rest = best.copy()
            for j in range(ORDER + 1 - k):
                weight = math.comb(k + j, j) * away**j
                rest[:, k] = np.minimum(rest[:, k], total + weight * best[:, k + j])
                total += weight * middle[:, k + j]
            best[:, k] = rest[:, k]
        by_cauchy = best.max(axis=2)
    found[:, 1:] = by_cauchy[:, 1:]
    return found


def _cells(plane: IdealPlane) -> tuple[FloatArray, FloatArray, tuple[float, float]]:
    """Middles of cells that cover the region of a plane, and half their sides."""
    low, high = plane.region.min(axis=0), plane.region.max(axis=0)
    counts = np.ceil((high - low) / (math.sqrt(float(np.prod(high - low))) / CELLS))
    half = (high - low) / (2 * counts)
    own = (float(half[0]), float(half[1]))
    across, down = (
        first + side * (2 * np.arange(int(n)) + 1)
        for first, side, n in zip(low, half, counts, strict=True)
    )
    x, y = (grid.ravel() for grid in np.meshgrid(across, down))
    is_near = plane.meets(x, y, own)
    return x[is_near], y[is_near], own


def _in_cells(
    plane: IdealPlane, x: FloatArray, y: FloatArray, half: tuple[float, float]
) -> tuple[FloatArray, FloatArray]:
    """(2, ORDER + 1, N) coefficients of u and v, the greatest over all lines, at some points.

    The first are those at the points, the second those at any point of the cells around them.
    """
    turn = np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    one = np.ones((DIRECTIONS, len(x)))

    def line(at: FloatArray, width: float, slope: FloatArray) -> Expansion:
        centre = np.stack((at * one, slope[:, None] * one)).reshape(2, -1)
        return Expansion(centre, np.stack((width * one, 0 * one)).reshape(2, -1))

    X, Y = line(x, half[0], np.cos(turn)), line(y, half[1], np.sin(turn))
    rays = [float(f[0]) * X + float(f[1]) * Y + float(f[2]) for f in plane.frame]
    least = np.cos(np.arange(ORDER + 1) * np.pi / (2 * DIRECTIONS))
    found = np.zeros((2, 2, ORDER + 1, len(x)))
    with np.errstate(all="ignore"):
        for k, pixel in enumerate(_project(plane.code, plane.params, *rays)):
            size, n = np.abs(pixel.centre), len(pixel.centre)
            for out, most in zip(found, (size, size + pixel.radius), strict=True):
                out[k, :n] = most.reshape(n, DIRECTIONS, -1).max(axis=1)
    found /= least[:, None]
    # Where an interval has no limit, its centre means nothing.
    middle, everywhere = np.where(np.isfinite(found[1]), found, np.inf)
    return middle, everywhere
