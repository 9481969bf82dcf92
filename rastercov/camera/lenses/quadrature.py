"""Bounds of the error of the areas under the images of edges by `kernels.lens_tables`.

With Chebyshev coefficients u_a and v_b of u and v along the edge, the rule is off by

    sum over a, b of e_ab u_a v_b,

e_ab what it is off by for T_a and T_b. That is 0 for a + b <= 2 n; for a + b even, where both the
rule and the integral are 0, because the nodes are symmetric and the ends change the sign; and for a
or b = 0. For the others up to DEGREES it is computed, and beyond it is at most 2 (a + b) + 8 n: the
integral of half (T_a dT_b - T_b dT_a) is at most a + b in size, because T_a varies by 2 a, and the
rule's value at most sum |S_ij| <= 8 n.

h half the length of an edge, |u_a| <= 2 (h / 2)^a C_a, C_a a bound of the derivative of order a
over a! on it (`expansions`). And where u is analytic in the ellipse of Bernstein with sum of half
axes rho around it, and |u - u0| <= M in there, |u_a| <= 2 M rho^-a. Points of the ellipse are
within R = h (rho + 1 / rho) / 2 of the middle of the edge, so a bound M of what is within R is
enough.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from rastercov.base.errors import CameraError
from rastercov.camera.lenses.expansions import coefficient_bounds
from rastercov.camera.lenses.planes import IdealPlane
from rastercov.kernels.lens_tables import FEWEST, MOST, NODES, RULE

FloatArray = NDArray[np.float64]

DEGREES = 60
"""Degrees a + b up to which e_ab is computed."""
PAIR_ROUNDING = 1e-10
"""More than the rounding of e_ab."""
MOST_TABLES = 256
"""Tables of planes that are kept."""
HALVINGS = 24


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
            "the lens must be bounded around its valid region, which reaches a pole of it, or "
            "89.9 degrees from the axis: give a smaller max_angle_deg"
        )
    # Cost of a length: values are n a part, and products n^2 / 2, which are a tenth of a value.
    cost = [n * (1 + n / 20) / max(longest[n], 1e-300) for n in range(FEWEST, MOST + 1)]
    return EdgeTable(tolerance, longest, FEWEST + int(np.argmin(cost)), plane.has_pole)
