"""Area under the image of a straight edge from n + 1 values of a lens, and a bound of its error.

With values U, V of u, v at the Gauss-Lobatto nodes of an edge, the area between the image of the
edge and its chord is

    bulge = sum over j < i of S_ij ((U_i - U_0) (V_j - V_0) - (U_j - U_0) (V_i - V_0)),

S constant and antisymmetric: S_ij = (w_i D_ij - w_j D_ji) / 2, w the weights and D the derivatives
of the Lagrange polynomials. It is exact where the degrees of u and v add up to 2 n at most.

Bound. Let u, v be analytic in the ellipse of Bernstein with sum of half axes rho around the edge,
and |u - u0| <= M_u, |v - v0| <= M_v in it. Their Chebyshev coefficients are at most 2 M rho^-k. The
integral of half (T_a dT_b - T_b dT_a) is at most a + b in size, because T_a varies by 2 a; the
rule's value at most sum |S_ij| <= 8 n. So a pair of degrees a + b = s > 2 n is off by at most
2 s + 8 n, there are s + 1 such pairs, and

    |error| <= 4 M_u M_v sum over s > 2 n of (s + 1) (2 s + 8 n) rho^-s.

Points of the ellipse are within R = h (rho + 1 / rho) / 2 of the middle of an edge, h half its
length.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from rastercov.errors import CameraError
from rastercov.lenses.planes import IdealPlane

FloatArray = NDArray[np.float64]

FEWEST, MOST = 2, 11
"""Least and largest n."""


def lobatto(n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Nodes in [0, 1], the matrix S, and Bernstein coefficients from values at the nodes.

    Nodes are symmetric: node k and node n - k add up to 1, to rounding.
    """
    unit = np.zeros(n + 1)
    unit[n] = 1
    inner = np.sort(legendre.legroots(legendre.legder(unit)).real) if n > 1 else np.empty(0)
    x = np.concatenate(([-1.0], inner, [1.0]))
    x = (x - x[::-1]) / 2
    values = legendre.legvander(x, n)
    slopes = np.column_stack([legendre.legval(x, legendre.legder(row)) for row in np.eye(n + 1)])
    weights = 2 / (n * (n + 1) * legendre.legval(x, unit) ** 2)
    product = weights[:, None] * (slopes @ np.linalg.inv(values))
    t = (x + 1) / 2
    basis = [math.comb(n, k) * t**k * t[::-1] ** (n - k) for k in range(n + 1)]
    return t, (product - product.T) / 2, np.linalg.inv(np.column_stack(basis))


def _tables() -> tuple[FloatArray, FloatArray, FloatArray]:
    nodes = np.zeros((MOST + 1, MOST + 1))
    rule, bernstein = np.zeros((2, MOST + 1, MOST + 1, MOST + 1))
    for n in range(1, MOST + 1):
        own = slice(n + 1)
        nodes[n, own], rule[n, own, own], bernstein[n, own, own] = lobatto(n)
    return nodes, rule, bernstein


NODES, RULE, BERNSTEIN = _tables()
"""By n: places of the nodes, S, and Bernstein coefficients from values."""
GAP = np.array([0.0, *(np.diff(NODES[n, : n + 1]).max() for n in range(1, MOST + 1))])
"""By n: largest distance of neighbouring nodes, in lengths of the edge."""
GROWTH = np.abs(BERNSTEIN).sum(axis=2).max(axis=1)
"""By n: largest Bernstein coefficient of a polynomial that is at most 1 at the nodes."""


def error_bound(reach_u: float, reach_v: float, radius: float, half: float, n: int) -> float:
    """Bound of the error of the bulge of an edge, px^2.

    Parameters
    ----------
    reach_u, reach_v : float
        M_u and M_v, px, of complex points within `radius` of the middle of the edge.
    radius : float
    half : float
        Half the length of the edge, in the unit of `radius`.
    n : int
        The rule has n + 1 nodes.

    Returns
    -------
    float
        Infinite where the edge is no shorter than twice `radius`.
    """
    ratio = radius / half if half > 0 else math.inf
    size = reach_u * reach_v
    if not ratio > 1 or not size < math.inf:
        return math.inf
    x = 1 / (ratio + math.sqrt(ratio * ratio - 1))
    # s = m + j, m = 2 n + 1: (m + 1 + j) (2 m + 8 n + 2 j), summed over j.
    m = 2 * n + 1
    first, second = m + 1, 2 * m + 8 * n
    rest = 1 - x
    series = first * second / rest
    series += (2 * first + second) * x / rest**2 + 2 * x * (1 + x) / rest**3
    return 4 * size * series * x**m


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


def edge_table(plane: IdealPlane, tolerance: float = 1e-9) -> EdgeTable:
    """Table of a plane for edges that are off by at most `tolerance`, px^2.

    Raises
    ------
    CameraError
        If no bound of the lens is found on its valid region: it reaches a pole, or nearly.
    """
    reaches = plane.reaches
    longest = np.zeros(MOST + 1)
    for n in range(FEWEST, MOST + 1):
        longest[n] = max((_longest(tolerance, n, *found) for found in reaches), default=0.0)
    if not longest[MOST] > 0:
        raise CameraError(
            "the lens must be bounded around its valid region, which reaches a pole of it, or "
            "89.9 degrees from the axis: give a smaller max_angle_deg"
        )
    # Cost of a length: values are n a part, and products n^2 / 2, which are a tenth of a value.
    cost = [n * (1 + n / 20) / max(longest[n], 1e-300) for n in range(FEWEST, MOST + 1)]
    return EdgeTable(tolerance, longest, FEWEST + int(np.argmin(cost)), plane.has_pole)


def _longest(tolerance: float, n: int, radius: float, reach_u: float, reach_v: float) -> float:
    """Half the longest edge that a rule integrates to the tolerance, by one radius; 0 if none."""
    low, high = 0.0, radius
    for _ in range(40):
        middle = (low + high) / 2
        if error_bound(reach_u, reach_v, radius, middle, n) <= tolerance:
            low = middle
        else:
            high = middle
    return low
