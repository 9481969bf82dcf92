"""Images of the vertices and edges of a surface in a lens, many at a time; compiled by numba.

Rays are projected in groups of `LANES`, step by step along arrays, which the compiler turns into
vector instructions. An edge that two faces share is integrated once.
"""

import math

from rastercov.kernels import lens_formulas
from rastercov.kernels.jit import allocation_free, called_whole, part_of, part_with_arrays
from rastercov.kernels.lens import based, project
from rastercov.kernels.lens_formulas import (
    B0,
    B1,
    B2,
    DIVISION,
    DOUBLE_SPHERE,
    EQUIDISTANT,
    EQUIRECT,
    EQUISOLID,
    FOV,
    LATE,
    P1,
    P2,
    PINHOLE,
    PLANAR,
    S1,
    S2,
    S3,
    S4,
    UNIFIED,
)

LANES = 64
"""Rays that are projected together."""
GROUP = 8
"""Rays of a vector: a list is filled up to a multiple of it, so that no remainder is scalar."""
X, Y, U, V = range(4)
"""Columns of the places of vertices: in a plane, in its units, and in the image, px."""


ATAN = (
    (-0.333333333333311110369124, -0.090908995008245008229153, -0.0523674852303482457616113,
     -0.0254517624932312641616861, -0.00110611831486672482563471),
    (0.199999999996591265594148, 0.0769219538311769618355029, 0.0466667150077840625632675,
     0.016599329773529201970117, 0.000209850076645816976906797),
    (-0.14285714266771329383765, -0.0666573579361080525984562, -0.0407629191276836500001934,
     -0.00889896195887655491740809, -1.88796008463073496563746e-05),
    (0.111111105648261418443745, 0.0587666392926673580854313, 0.0337852580001353069993897,
     0.00370026744188713119232403, 0.0),
)  # fmt: skip
"""Coefficients of q, q^2, q^3 and q^4 in `atan_over`, each by powers of q^4."""


@part_of
def quartic(s, coefficients):
    """Polynomial of degree 4 at s."""
    c0, c1, c2, c3, c4 = coefficients
    return c0 + s * (c1 + s * (c2 + s * (c3 + s * c4)))


@part_of
def atan_over(q):
    """atan(t) / t for q = t^2 <= 1, by a polynomial of SLEEF; without a branch, also at 0.

    The error is a unit in the last place.

    N. Shibata, F. Petrogalli. SLEEF: A Portable Vectorized Library of C Standard Mathematical
    Functions. 2020.
    """
    # Four chains, because the processor would wait for each step of one.
    r, s = q * q, (q * q) * (q * q)
    a, b, d, e = quartic(s, ATAN[0]), quartic(s, ATAN[1]), quartic(s, ATAN[2]), quartic(s, ATAN[3])
    return 1.0 + q * (a + q * b + r * (d + q * e))


@part_of
def angle_over_r(r2, z):
    """Angle from the z axis over r, of a point at distance r = sqrt(r2) from the axis.

    tan(a / 2) = tan(a) / (1 + sqrt(1 + tan(a)^2)), twice: a quarter of an angle is at most 45
    degrees. The error is a few units in the last place.
    """
    c = 1.0 / (z + math.sqrt(r2 + z * z))
    c = c / (1.0 + math.sqrt(1.0 + r2 * c * c))
    return 4.0 * c * atan_over(r2 * c * c)


@part_of
def angle_ahead_over_r(r2):
    """`angle_over_r` for z = 1: the angle is less than 90 degrees, and halved once."""
    c = 1.0 / (1.0 + math.sqrt(r2 + 1.0))
    return 2.0 * c * atan_over(r2 * c * c)


@allocation_free
def base_lanes(code, p, is_ahead, x, y, z, n):
    """Bases that have a closed form, see `formulas.based`; rays (x, y, z) in place.

    All z are 1 where `is_ahead`.
    """
    b0, b1, b2 = p[B0], p[B1], p[B2]
    if code == EQUIDISTANT and is_ahead:
        for i in range(n):
            g = angle_ahead_over_r(x[i] * x[i] + y[i] * y[i])
            x[i], y[i] = x[i] * g, y[i] * g
    elif code == EQUIDISTANT:
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
    elif code not in PLANAR:  # one that has no vector instructions yet
        for i in range(n):
            x[i], y[i] = based(code, p, x[i], y[i], z[i])
    else:
        for i in range(n):
            w = 1.0 / z[i]
            x[i], y[i] = x[i] * w, y[i] * w
        if code == FOV:
            for i in range(n):
                g = b1 * angle_ahead_over_r((x[i] * x[i] + y[i] * y[i]) * (b0 * b0))
                x[i], y[i] = x[i] * g, y[i] * g
        elif code == DIVISION:
            for i in range(n):
                r2 = x[i] * x[i] + y[i] * y[i]
                g = 2.0 / (1.0 + math.sqrt(1.0 - 4.0 * b0 * r2))
                x[i], y[i] = x[i] * g, y[i] * g


_equations = lens_formulas.bound_to(
    {}, part_of, (lens_formulas.radial_factor, lens_formulas.imaged)
)
radial_factor, imaged = _equations["radial_factor"], _equations["imaged"]


@part_with_arrays
def values_of(p):
    """Parameters of a lens as a tuple: numbers that no store to an array can change."""
    return (
        p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8], p[9], p[10], p[11], p[12], p[13],
        p[14], p[15], p[16], p[17], p[18], p[19], p[20], p[21], p[22], p[23], p[24], p[25], p[26],
        p[27], p[28], p[29], p[30], p[31],
    )  # fmt: skip


@called_whole
def project_lanes(code, p, frame, x, y, z, m, u, v):
    """Project the first m points (x, y) of a plane into u, v; x, y and z are lost.

    The equations are those of `formulas.project`. The results depend on the point alone, not on its
    place in the list; arrays have room for a multiple of `GROUP`, all of it finite.
    """
    if code == EQUIRECT:
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
        base_lanes(code, p, is_ahead, x, y, z, n)
    values = values_of(p)
    for i in range(n):
        f = radial_factor(values, x[i] * x[i] + y[i] * y[i])
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
    for i in range(n):
        u[i], v[i] = imaged(values, u[i], v[i])
