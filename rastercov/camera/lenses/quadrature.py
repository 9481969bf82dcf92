"""Bounds of the error of the areas under the images of edges by `native.lens_edges`.

With Chebyshev coefficients u_a and v_b of u and v along the edge, the rule is off by

    sum over a, b of e_ab u_a v_b,

e_ab what it is off by for T_a and T_b. That is 0 for a + b <= 2 n; for a + b even, where both the
rule and the integral are 0, because the nodes are symmetric and the ends change the sign; and for a
or b = 0. For the others up to DEGREES it is computed, and beyond it is at most 2 (a + b) + 8 n: the
integral of half (T_a dT_b - T_b dT_a) is at most a + b in size, because T_a varies by 2 a, and the
rule's value at most sum |S_ij| <= 8 n.

h half the length of an edge, |u_a| <= 2 (h / 2)^a C_a, C_a a bound of the derivative of order a
over a! on it (`coefficient_bounds`). And where u is analytic in the ellipse of Bernstein with sum
of half axes rho around it, and |u - u0| <= M in there, |u_a| <= 2 M rho^-a. Points of the ellipse
are within R = h (rho + 1 / rho) / 2 of the middle of the edge, so a bound M of what is within R is
enough.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.polynomial import legendre

from rastercov.base.errors import CameraError
from rastercov.base.memory import FloatArray
from rastercov.camera.lenses import formulas
from rastercov.camera.lenses.balls import Arithmetic
from rastercov.camera.lenses.planes import IdealPlane
from rastercov.native import lens_edges
from rastercov.native import lens_expansions as native
from rastercov.native.lens_edges import FEWEST, MOST

NODES, RULE = np.empty((MOST + 1, MOST + 1)), np.empty((MOST + 1, MOST + 1, MOST + 1))
"""By n: places of the nodes, and the matrix S of the rule, see `lens/rules.hpp`."""
lens_edges.rules(NODES, RULE)
ORDER = 18
DIRECTIONS = 20
"""In half a turn; the other half differs by a sign."""
CELLS = 12
"""Cells of a side of the box around a region."""
ROUNDING_REL = 2.0**-40
"""Rounding of a coefficient relative to its bound by Cauchy's estimate."""
DEGREES = 60
"""Degrees a + b up to which e_ab is computed."""
PAIR_ROUNDING = 1e-10
"""More than the rounding of e_ab."""
MOST_TABLES = 256
"""Tables of planes that are kept."""
HALVINGS = 24


class Expansion(Arithmetic):
    """Coefficients of t^0 ... t^k in rows, intervals `centre` +- `radius`; those above are 0.

    Those above t^`order` are left out.
    """

    def __init__(self, centre: FloatArray, radius: FloatArray, order: int) -> None:
        self.centre, self.radius, self.order = centre, radius, order

    def __add__(self, other: object) -> "Expansion":
        if not isinstance(other, Expansion):
            centre = self.centre.copy()
            centre[0] += other
            return Expansion(centre, self.radius, self.order)
        one, two = (self, other) if len(self.centre) >= len(other.centre) else (other, self)
        n, centre, radius = len(two.centre), one.centre.copy(), one.radius.copy()
        centre[:n] += two.centre
        radius[:n] += two.radius
        return Expansion(centre, radius, self.order)

    def __neg__(self) -> "Expansion":
        return Expansion(-self.centre, self.radius, self.order)

    def __mul__(self, other: Any) -> "Expansion":
        if not isinstance(other, Expansion):
            return Expansion(self.centre * other, self.radius * abs(other), self.order)
        n = min(len(self.centre) + len(other.centre) - 1, self.order + 1)
        centre, radius = np.zeros((2, n, self.centre.shape[1]))
        native.multiply(self.centre, self.radius, other.centre, other.radius, centre, radius)
        return Expansion(centre, radius, self.order)

    def __truediv__(self, other: Any) -> Any:
        return self * (1.0 / other)

    def __rtruediv__(self, other: float) -> "Expansion":
        centre, radius = np.zeros((2, self.order + 1, self.centre.shape[1]))
        centre[0], radius[0] = _inverse(self.centre[0], self.radius[0])
        native.invert(self.centre, self.radius, centre, radius)
        return Expansion(centre * other, radius * abs(other), self.order)


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
    centre, radius = np.zeros((2, value.order + 1, len(a)))
    centre[: len(value.centre)], radius[: len(value.centre)] = value.centre, value.radius
    is_good = a > off
    centre[0] = np.sqrt(np.where(is_good, a, 1.0))
    # |sqrt x - sqrt c| = |x - c| / (sqrt x + sqrt c)
    least = np.sqrt(np.where(is_good, a - off, 1.0))
    radius[0] = np.where(is_good, off / (centre[0] + least), np.inf)
    inverse, inverse_off = _inverse(2.0 * centre[0], 2.0 * radius[0])
    native.take_root(inverse, inverse_off, centre, radius)
    return Expansion(centre, radius, value.order)


def _angle_over_r(r2: Any, z: Any) -> Any:
    """Angle from the z axis over r, see `lens/formulas.hpp`."""
    if isinstance(z, Expansion) and (z.centre[0] + z.radius[0] < 0).all():
        return math.pi / _sqrt(r2) - _angle_over_r(r2, -z)  # z + sqrt(r2 + z * z) would cancel
    c = 1.0 / (z + _sqrt(r2 + z * z))
    for _ in range(3):
        c = c / (1.0 + _sqrt(1.0 + r2 * (c * c)))
    q = r2 * (c * c)
    series: Any = 1.0 / 21.0
    for odd in range(19, 0, -2):
        series = 1.0 / odd - q * series
    return 16.0 * (c * series)


def _atan2(y: Expansion, x: object) -> Any:
    """Angle of (x, y) from the x axis, within half a turn, as longitudes of a plane are."""
    return y * _angle_over_r(y * y, x)


_PRIMITIVES = {"sqrt": _sqrt, "angle_over_r": _angle_over_r, "atan2": _atan2}
_project = formulas.project_on(_PRIMITIVES)


def coefficient_bounds(plane: IdealPlane) -> FloatArray:
    """Bounds of the Taylor coefficients of u and v along all lines, at points of the region.

    The equations of the lens are evaluated at p + t d, p all points of a cell and d a unit vector,
    as polynomials in t up to t^ORDER. Their coefficients are intervals that hold those of each p,
    around those of the middle. A coefficient c_k, the k-th derivative over k!, is a form of degree
    k in d. With C_k the greatest over all d,

        C_k at q <= sum over j < m of binomial(k + j, j) |q - p|^j C_(k+j) at p
                    + binomial(k + m, m) |q - p|^m C_(k+m) on the way,

    because derivatives along different directions are no greater than those along one [S. Banach.
    Über homogene Polynome in (L^2). 1938]. Intervals get wider with each order, and so the best m
    counts: the result is near the truth, while Cauchy's estimate from complex balls is a hundred
    times too large.

    In the plane a form of degree k is a trigonometric polynomial of degree k of the angle of d, so
    DIRECTIONS of them bound all others: where such a polynomial is greatest, at M, it is at least
    M cos(k a) at the angle a from there [M. Riesz. Eine trigonometrische Interpolationsformel.
    1914], and a direction is within half a step.

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
    extent = np.ptp(plane.region, axis=0)
    x, y, half = plane.cells(np.ceil(extent / (math.sqrt(float(np.prod(extent))) / CELLS)))
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


def _in_cells(
    plane: IdealPlane, x: FloatArray, y: FloatArray, half: tuple[float, float]
) -> tuple[FloatArray, FloatArray]:
    """(2, ORDER + 1, N) coefficients of u and v, the greatest over all lines, at some points.

    The first are those at the points, the second those at any point of the cells around them.
    """
    least = np.cos(np.arange(ORDER + 1) * np.pi / (2 * DIRECTIONS))
    centre, radius = pixels_along_lines(plane, x, y, half, ORDER)
    with np.errstate(all="ignore"):
        size = np.abs(centre)
        found = np.stack((size, size + radius)).max(axis=3) / least[:, None]
    # Where an interval has no limit, its centre means nothing.
    middle, everywhere = np.where(np.isfinite(found[1]), found, np.inf)
    return middle, everywhere


def pixels_along_lines(
    plane: IdealPlane,
    x: FloatArray,
    y: FloatArray,
    half: tuple[float | FloatArray, float],
    order: int,
) -> tuple[FloatArray, FloatArray]:
    """Expansions of u and v at all points of N cells: centres and radii of their coefficients.

    (2, `order` + 1, DIRECTIONS, N) each. The first direction is along x, that after half of the
    DIRECTIONS along y.
    """
    turn = np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    one = np.ones((DIRECTIONS, len(x)))

    def line(at: FloatArray, width: float | FloatArray, slope: FloatArray) -> Expansion:
        centre = np.stack((at * one, slope[:, None] * one)).reshape(2, -1)
        return Expansion(centre, np.stack((width * one, 0 * one)).reshape(2, -1), order)

    X, Y = line(x, half[0], np.cos(turn)), line(y, half[1], np.sin(turn))
    rays = [float(f[0]) * X + float(f[1]) * Y + float(f[2]) for f in plane.frame]
    centre, radius = np.zeros((2, 2, order + 1, DIRECTIONS, len(x)))
    with np.errstate(all="ignore"):
        pixels = _project(plane.code, plane.params, *rays)
    for k, pixel in enumerate(pixels):
        n = len(pixel.centre)
        centre[k, :n] = pixel.centre.reshape(n, DIRECTIONS, -1)
        radius[k, :n] = pixel.radius.reshape(n, DIRECTIONS, -1)
    return centre, radius


def _pair_errors(n: int) -> FloatArray:
    """(DEGREES + 1, DEGREES + 1) bounds of |e_ab| of a rule, 0 beyond a + b = DEGREES."""
    degree = np.arange(DEGREES + 1)
    places, weights = legendre.leggauss(DEGREES + 2)  # exact for products of T_a and T_b'
    angle = np.arccos(places)
    values, slopes = np.cos(degree[:, None] * angle), np.sin(degree[:, None] * angle)
    slopes *= degree[:, None] / np.sin(angle)
    first = (-1.0) ** degree[:, None]
    whole = (weights * (values - first)) @ slopes.T
    own = np.arccos(np.clip(2 * NODES[n, : n + 1] - 1, -1, 1))
    at = np.cos(degree[:, None] * own) - first
    # u_j v_i - u_i v_j with j < i, as the rule has it, of S antisymmetric
    error = np.abs(at @ RULE[n, : n + 1, : n + 1] @ at.T - (whole - whole.T) / 2) + PAIR_ROUNDING
    total = degree[:, None] + degree
    is_off = (total > 2 * n) & (total % 2 == 1) & (total <= DEGREES)
    is_off &= (degree[:, None] > 0) & (degree > 0)
    return np.where(is_off, error, 0.0)


PAIR_ERRORS = np.stack(
    [np.zeros((DEGREES + 1,) * 2)] + [_pair_errors(n) for n in range(1, MOST + 1)]
)
"""By n: bounds of |e_ab|."""


class EdgeBounds:
    """Bounds of a lens along the edges of a plane, and of the error of their rules.

    Parameters
    ----------
    reaches : sequence of (float, float, float)
        Radii, and M_u and M_v, px, of complex points within them of a point of the edge.
    coefficients : (2, K) float64
        C_a of u and v in column a, px per (unit of the radii)^a; they may be infinite.
    """

    def __init__(
        self, reaches: Sequence[tuple[float, float, float]], coefficients: FloatArray
    ) -> None:
        self._radii, *sizes = np.array(reaches, np.float64).reshape(-1, 3).T
        self._sizes = np.stack(sizes)
        self._coefficients = coefficients

    def error(self, half: float, n: int) -> float:
        """Bound of the error of the bulge of an edge of half a length by rule n, px^2.

        Infinite where the edge is no shorter than twice all radii.
        """
        is_wide = self._radii > half
        if not is_wide.any():
            return math.inf
        ratio, sizes = self._radii[is_wide] / max(half, 1e-300), self._sizes[:, is_wide]
        degree = np.arange(DEGREES + 1)
        own = slice(1, self._coefficients.shape[1])
        with np.errstate(all="ignore"):  # what is infinite bounds nothing, nor what is no number
            x = 1 / (ratio + np.sqrt(ratio - 1) * np.sqrt(ratio + 1))
            bounds = 2 * (sizes[:, :, None] * x[:, None] ** degree).min(axis=1)
            by_order = 2 * (half / 2) ** degree[own] * self._coefficients[:, own]
            bounds[:, own] = np.fmin(bounds[:, own], by_order)
            beyond = 4 * sizes[0] * sizes[1] * _tail(n, x)
            error = float(bounds[0] @ PAIR_ERRORS[n] @ bounds[1] + beyond.min())
        return error if error >= 0 else math.inf

    def longest(self, tolerance: float, n: int) -> float:
        """Half the longest edge that a rule integrates to the tolerance; 0 if none."""
        low, high = 0.0, float(self._radii.max(initial=0.0))
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            if self.error(middle, n) <= tolerance:
                low = middle
            else:
                high = middle
        return low


def _tail(n: int, x: FloatArray) -> FloatArray:
    """Sum over s > DEGREES of (s + 1) (2 s + 8 n) x^s, 0 < x < 1."""
    # s = m + j: (m + 1 + j) (2 m + 8 n + 2 j), summed over j.
    m = DEGREES + 1
    first, second = m + 1, 2 * m + 8 * n
    rest = 1 - x
    series: FloatArray = first * second / rest
    series += (2 * first + second) * x / rest**2 + 2 * x * (1 + x) / rest**3
    series *= x**m
    return series


@dataclass(frozen=True, eq=False)
class EdgeTable:
    """Number of nodes by the length of an edge, for one ideal plane.

    Attributes
    ----------
    tolerance : float
        Bound of the error of each edge or part of an edge, px^2.
    longest : (MOST + 1,) float64
        By n: half the longest edge that n + 1 nodes integrate to the tolerance, in units of the
        plane; of a plane with a pole, in units of the distance of its middle from the pole.
    parts_of : int
        The n of the parts of longer edges.
    is_graded : bool
        The plane has a pole at its center.
    """

    tolerance: float
    longest: FloatArray
    parts_of: int
    is_graded: bool


@lru_cache(maxsize=MOST_TABLES)
def edge_table(plane: IdealPlane, tolerance: float = 1e-9) -> EdgeTable:
    """Table of a plane for edges that are off by at most `tolerance`, px^2.

    Raises
    ------
    CameraError
        If no bound of the lens is found on its valid region: it reaches a pole, or nearly.
    """
    bounds = EdgeBounds(plane.reaches, coefficient_bounds(plane))
    longest = np.zeros(MOST + 1)
    for n in range(FEWEST, MOST + 1):
        longest[n] = bounds.longest(tolerance, n)
    # More nodes are good for all edges that fewer are good for.
    longest[FEWEST:] = np.minimum.accumulate(longest[: FEWEST - 1 : -1])[::-1]
    if not longest[MOST] > 0:
        raise CameraError(
            "expected a lens without a pole in its valid region, below 89.9 degrees, got one; give "
            "a smaller max_angle_deg"
        )
    # Cost of a length: values are n a part, and products n^2 / 2, which are a tenth of a value.
    cost = [n * (1 + n / 20) / max(longest[n], 1e-300) for n in range(FEWEST, MOST + 1)]
    return EdgeTable(tolerance, longest, FEWEST + int(np.argmin(cost)), plane.has_pole)
