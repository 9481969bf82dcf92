"""Rules for the area under the image of a straight edge from n + 1 values of a lens.

With values U, V of u, v at the Gauss-Lobatto nodes of an edge, the area between the image of the
edge and its chord is

    bulge = sum over j < i of S_ij ((U_i - U_0) (V_j - V_0) - (U_j - U_0) (V_i - V_0)),

S constant and antisymmetric: S_ij = (w_i D_ij - w_j D_ji) / 2, w the weights and D the derivatives
of the Lagrange polynomials. It is exact where the degrees of u and v add up to 2 n at most.
"""

import math

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

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
