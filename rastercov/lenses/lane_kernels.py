"""Images of the vertices and edges of a surface in a lens, many at a time; compiled by numba.

Rays are projected in groups of `LANES`, step by step along arrays, which the compiler turns into
vector instructions. An edge that two faces share is integrated once.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov._jit import allocation_free, called_whole, part_of
from rastercov.lenses.formulas import (
    B0,
    B1,
    B2,
    BACKWARD,
    CX,
    CY,
    D1,
    D2,
    D3,
    DIVISION,
    DOUBLE_SPHERE,
    EQUIDISTANT,
    EQUIRECT,
    EQUISOLID,
    FOV,
    FX,
    FY,
    K1,
    K2,
    K3,
    K4,
    K5,
    K6,
    LATE,
    P1,
    P2,
    PINHOLE,
    S1,
    S2,
    S3,
    S4,
    SKEW,
    T00,
    T10,
    T11,
    T20,
    T21,
    T22,
    UNIFIED,
)
from rastercov.lenses.kernels import project
from rastercov.lenses.quadrature import FEWEST, MOST, NODES, RULE

LANES = 64
"""Rays that are projected together."""
GROUP = 8
"""Rays of a vector: a list is filled up to a multiple of it, so that no remainder is scalar."""
X, Y, U, V = range(4)
"""Columns of the places of vertices: in a plane, in its units, and in the image, px."""


class LaneScratch(NamedTuple):
    """Scratch for `LANES` rays or edges: nodes of edges are (MOST + 1, LANES).

    Edges wait by their rule: `ends`, (MOST + 1, 8, LANES), has the places of both ends of each,
    `row`, (MOST + 1, LANES), its number, and `waiting`, (MOST + 1,), counts them.
    """

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    z: NDArray[np.float64]
    total: NDArray[np.float64]
    u: NDArray[np.float64]
    v: NDArray[np.float64]
    X: NDArray[np.float64]
    Y: NDArray[np.float64]
    U: NDArray[np.float64]
    V: NDArray[np.float64]
    ends: NDArray[np.float64]
    row: NDArray[np.int64]
    waiting: NDArray[np.int64]


def lane_scratch() -> LaneScratch:
    """Memory for `LANES` rays or edges; all numbers are finite, also those of unused lanes."""
    x, y, z, u, v = np.zeros((5, (MOST + 1) * LANES))
    X, Y, U, V = (each.reshape(MOST + 1, LANES) for each in (x, y, u, v))
    ends, row = np.zeros((MOST + 1, 8, LANES)), np.zeros((MOST + 1, LANES), np.int64)
    waiting = np.zeros(MOST + 1, np.int64)
    return LaneScratch(x, y, z, np.zeros(LANES), u, v, X, Y, U, V, ends, row, waiting)


@part_of
def angle_over_r(r2, z):
    """Angle from the z axis over r, of a point at distance r = sqrt(r2) from the axis.

    tan(a / 2) = tan(a) / (1 + sqrt(1 + tan(a)^2)), twice, and a polynomial of SLEEF for atan up to
    1: without a branch, also at r = 0. The error is a few units in the last place.

    N. Shibata, F. Petrogalli. SLEEF: A Portable Vectorized Library of C Standard Mathematical
    Functions. 2020.
    """
    c = 1.0 / (z + math.sqrt(r2 + z * z))
    c = c / (1.0 + math.sqrt(1.0 + r2 * c * c))
    q = r2 * c * c  # tan^2 of a quarter, at most 1
    # Four chains, because the processor would wait for each step of one.
    r, s = q * q, (q * q) * (q * q)
    a = -0.333333333333311110369124 + s * (
        -0.090908995008245008229153
        + s
        * (
            -0.0523674852303482457616113
            + s * (-0.0254517624932312641616861 - s * 0.00110611831486672482563471)
        )
    )
    b = 0.199999999996591265594148 + s * (
        0.0769219538311769618355029
        + s
        * (
            0.0466667150077840625632675
            + s * (0.016599329773529201970117 + s * 0.000209850076645816976906797)
        )
    )
    d = -0.14285714266771329383765 + s * (
        -0.0666573579361080525984562
        + s
        * (
            -0.0407629191276836500001934
            + s * (-0.00889896195887655491740809 - s * 1.88796008463073496563746e-05)
        )
    )
    e = 0.111111105648261418443745 + s * (
        0.0587666392926673580854313
        + s * (0.0337852580001353069993897 + s * 0.00370026744188713119232403)
    )
    p = a + q * b + r * (d + q * e)
    return 4.0 * c * (1.0 + q * p)


@allocation_free
def base_lanes(code, b0, b1, b2, x, y, z, n):
    """Bases that have a closed form, see `formulas.based`; rays (x, y, z) in place."""
    if code == EQUIDISTANT:
        for i in range(n):
            g = angle_over_r(x[i] * x[i] + y[i] * y[i], z[i])
            x[i], y[i] = x[i] * g, y[i] * g
    elif code == EQUISOLID:
        for i in range(n):
            rho = math.sqrt(x[i] * x[i] + y[i] * y[i] + z[i] * z[i])
            g = 1.4142135623730951 / math.sqrt(rho * (rho + z[i]))
            x[i], y[i] = x[i] * g, y[i] * g
    elif code == UNIFIED:
        for i in range(n):
            r2 = x[i] * x[i] + y[i] * y[i]
            g = 1.0 / (b0 * math.sqrt(b2 * r2 + z[i] * z[i]) + b1 * z[i])
            x[i], y[i] = x[i] * g, y[i] * g
    elif code == DOUBLE_SPHERE:
        for i in range(n):
            r2 = x[i] * x[i] + y[i] * y[i]
            c = b0 * math.sqrt(r2 + z[i] * z[i]) + z[i]
            g = 1.0 / (b1 * math.sqrt(r2 + c * c) + (1.0 - b1) * c)
            x[i], y[i] = x[i] * g, y[i] * g
    else:
        for i in range(n):
            w = 1.0 / z[i]
            x[i], y[i] = x[i] * w, y[i] * w
        if code == FOV:
            for i in range(n):
                g = b1 * angle_over_r((x[i] * x[i] + y[i] * y[i]) * (b0 * b0), 1.0)
                x[i], y[i] = x[i] * g, y[i] * g
        elif code == DIVISION:
            for i in range(n):
                r2 = x[i] * x[i] + y[i] * y[i]
                g = 2.0 / (1.0 + math.sqrt(1.0 - 4.0 * b0 * r2))
                x[i], y[i] = x[i] * g, y[i] * g


@called_whole
def project_lanes(code, p, frame, x, y, z, m, u, v):
    """Project the first m points (x, y) of a plane into u, v; x, y and z are lost.

    The equations are those of `formulas.project`. The results depend on the point alone, not on its
    place in the list; arrays have room for a multiple of `GROUP`, all of it finite.
    """
    if code in (BACKWARD, EQUIRECT):
        for i in range(m):
            X = frame[0, 0] * x[i] + frame[0, 1] * y[i] + frame[0, 2]
            Y = frame[1, 0] * x[i] + frame[1, 1] * y[i] + frame[1, 2]
            Z = frame[2, 0] * x[i] + frame[2, 1] * y[i] + frame[2, 2]
            u[i], v[i] = project(code, p, X, Y, Z)
        return
    n = (m + GROUP - 1) & -GROUP
    f00, f01, f02 = frame[0, 0], frame[0, 1], frame[0, 2]
    f10, f11, f12 = frame[1, 0], frame[1, 1], frame[1, 2]
    f20, f21, f22 = frame[2, 0], frame[2, 1], frame[2, 2]
    # On the plane ahead a pinhole's base changes nothing.
    is_ahead = f00 == 1.0 and f11 == 1.0 and f22 == 1.0
    if not (is_ahead and code == PINHOLE):
        for i in range(n):
            X = f00 * x[i] + f01 * y[i] + f02
            Y = f10 * x[i] + f11 * y[i] + f12
            z[i] = f20 * x[i] + f21 * y[i] + f22
            x[i], y[i] = X, Y
        base_lanes(code, p[B0], p[B1], p[B2], x, y, z, n)
    k1, k2, k3, k4, k5, k6 = p[K1], p[K2], p[K3], p[K4], p[K5], p[K6]
    d1, d2, d3 = p[D1], p[D2], p[D3]
    is_polynomial = d1 == 0.0 and d2 == 0.0 and d3 == 0.0
    if is_polynomial and k4 == 0.0 and k5 == 0.0 and k6 == 0.0:
        for i in range(n):
            q = x[i] * x[i] + y[i] * y[i]
            f = 1.0 + q * (k1 + q * (k2 + q * k3))
            u[i], v[i] = x[i] * f, y[i] * f
    elif is_polynomial:
        for i in range(n):
            q = x[i] * x[i] + y[i] * y[i]
            f = 1.0 + q * (k1 + q * (k2 + q * (k3 + q * (k4 + q * (k5 + q * k6)))))
            u[i], v[i] = x[i] * f, y[i] * f
    else:
        for i in range(n):
            q = x[i] * x[i] + y[i] * y[i]
            f = 1.0 + q * (k1 + q * (k2 + q * (k3 + q * (k4 + q * (k5 + q * k6)))))
            f = f / (1.0 + q * (d1 + q * (d2 + q * d3)))
            u[i], v[i] = x[i] * f, y[i] * f
    p1, p2, s1, s2, s3, s4 = p[P1], p[P2], p[S1], p[S2], p[S3], p[S4]
    if p1 != 0.0 or p2 != 0.0 or s1 != 0.0 or s2 != 0.0 or s3 != 0.0 or s4 != 0.0:
        is_late = p[LATE] != 0.0
        for i in range(n):
            a = u[i] if is_late else x[i]
            b = v[i] if is_late else y[i]
            q = a * a + b * b
            ab = 2.0 * (a * b)
            u[i] += p1 * ab + p2 * (q + 2.0 * (a * a)) + q * (q * s2 + s1)
            v[i] += p1 * (q + 2.0 * (b * b)) + p2 * ab + q * (q * s4 + s3)
    if p[T20] != 0.0 or p[T21] != 0.0:
        t00, t10, t11, t20, t21, t22 = p[T00], p[T10], p[T11], p[T20], p[T21], p[T22]
        for i in range(n):
            w = 1.0 / (t20 * u[i] + t21 * v[i] + t22)
            b = (t10 * u[i] + t11 * v[i]) * w
            u[i] = t00 * u[i] * w
            v[i] = b
    fx, fy, cx, cy, skew = p[FX], p[FY], p[CX], p[CY], p[SKEW]
    for i in range(n):
        a = fx * u[i] + skew * v[i] + cx
        v[i] = fy * v[i] + cy
        u[i] = a


@allocation_free
def vertex_images(plane, places, is_inside, lanes):
    """Project vertices of a plane that are inside its region; NaN for the others.

    Parameters
    ----------
    plane : PlaneRecord
    places : (V, 4) float64
        In: x, y. Out: u, v.
    is_inside : (V,) bool
    lanes : LaneScratch
    """
    rows, last = lanes.row[0], places.shape[0] - 1
    m = 0
    for i in range(last + 1):
        if is_inside[i]:
            rows[m], lanes.x[m], lanes.y[m] = i, places[i, X], places[i, Y]
            m += 1
        else:
            places[i, U] = places[i, V] = math.nan
        if m == LANES or (m > 0 and i == last):
            project_lanes(
                plane.code,
                plane.params,
                plane.frame,
                lanes.x,
                lanes.y,
                lanes.z,
                m,
                lanes.u,
                lanes.v,
            )
            for k in range(m):
                places[rows[k], U], places[rows[k], V] = lanes.u[k], lanes.v[k]
            m = 0


@allocation_free
def bulges_of(plane, n, lanes):
    """Fill `lanes.total` with the bulges of the edges that wait for rule n."""
    ends = lanes.ends[n]
    ax, ay, u0, v0 = ends[X], ends[Y], ends[U], ends[V]
    bx, by, u1, v1 = ends[4 + X], ends[4 + Y], ends[4 + U], ends[4 + V]
    for k in range(1, n):
        t, s, x, y = NODES[n, k], NODES[n, n - k], lanes.X[k - 1], lanes.Y[k - 1]
        for i in range(LANES):
            x[i] = s * ax[i] + t * bx[i]
        for i in range(LANES):
            y[i] = s * ay[i] + t * by[i]
    # The nodes 1 ... n - 1 of all edges are projected together.
    inner = LANES * (n - 1)
    project_lanes(
        plane.code, plane.params, plane.frame, lanes.x, lanes.y, lanes.z, inner, lanes.u, lanes.v
    )
    nodes_u, nodes_v, total = lanes.U, lanes.V, lanes.total
    for i in range(LANES):
        nodes_u[n - 1, i] = u1[i]
    for i in range(LANES):
        nodes_v[n - 1, i] = v1[i]
    for k in range(n):
        u, v = nodes_u[k], nodes_v[k]
        for i in range(LANES):
            u[i] -= u0[i]
        for i in range(LANES):
            v[i] -= v0[i]
    for i in range(LANES):
        total[i] = 0.0
    for k in range(2, n + 1):
        for j in range(1, k):
            weight = RULE[n, k, j]
            ku, kv, ju, jv = nodes_u[k - 1], nodes_v[k - 1], nodes_u[j - 1], nodes_v[j - 1]
            for i in range(LANES):
                total[i] += weight * (ku[i] * jv[i] - ju[i] * kv[i])


@allocation_free
def edge_bulges(plane, ends, places, lanes, bulge, longer):
    """Area between the image of each edge and its chord, px^2, from its first end to its second.

    Edges of one rule are integrated together.

    Parameters
    ----------
    plane : PlaneRecord
        Without a pole.
    ends : (E, 2) int32
        Vertices of the edges.
    places : (V, 4) float64
        Of `vertex_images`.
    lanes : LaneScratch
    bulge : (E,) float64
        Out; NaN for an edge with an end outside the region, and for one too long for any rule.
    longer : (E,) int32
        Out: edges that are too long.

    Returns
    -------
    int
        Number of these.
    """
    longest, n_longer, last = plane.longest, 0, ends.shape[0] - 1
    lanes.waiting[:] = 0
    for e in range(last + 1):
        a, b = ends[e, 0], ends[e, 1]
        u0, u1, bulge[e] = places[a, U], places[b, U], math.nan
        if u0 + u1 != u0 + u1:
            continue
        ax, ay, bx, by = places[a, X], places[a, Y], places[b, X], places[b, Y]
        quarter2 = 0.25 * ((bx - ax) * (bx - ax) + (by - ay) * (by - ay))
        n = FEWEST
        while n <= MOST and quarter2 > longest[n] * longest[n]:
            n += 1
        if n > MOST:
            longer[n_longer] = e
            n_longer += 1
            continue
        at, m = lanes.ends[n], lanes.waiting[n]
        at[X, m], at[Y, m], at[U, m], at[V, m] = ax, ay, u0, places[a, V]
        at[4 + X, m], at[4 + Y, m], at[4 + U, m], at[4 + V, m] = bx, by, u1, places[b, V]
        lanes.row[n, m] = e
        m += 1
        if m == LANES:
            m = _integrate(plane, n, m, lanes, bulge)
        lanes.waiting[n] = m
    for n in range(FEWEST, MOST + 1):
        if lanes.waiting[n] > 0:
            _integrate(plane, n, lanes.waiting[n], lanes, bulge)
    return n_longer


@allocation_free
def _integrate(plane, n, m, lanes, bulge):
    """Fill in the bulges of the m edges that wait for rule n; returns 0 of them."""
    bulges_of(plane, n, lanes)
    for i in range(m):
        bulge[lanes.row[n, i]] = lanes.total[i]
    return 0
