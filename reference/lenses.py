"""Equations of the lenses, the twin of `engine/lens/formulas.hpp`.

A lens maps a ray (X, Y, Z) of the camera, x right, y down, z forward, to pixels in four steps:

    base         (X, Y, Z) -> (x, y)    law of the ideal lens: pinhole, equidistant, unified, ...
    distortion   (x, y) -> (a, b)       radial, tangential and thin-prism terms
    tilt         (a, b) -> (a, b)       homography of a tilted sensor
    pixels       u = fx a + skew b + cx,  v = fy b + cy

This module runs as it is on floats and numpy arrays. Branches depend on coefficients only, never on
rays, so that its equations hold in another arithmetic, such as of complex numbers.

D. C. Brown. Close-range camera calibration. 1971. J. Kannala, S. Brandt. A generic camera model.
2006. F. Devernay, O. Faugeras. Straight lines have to be straight. 2001. C. Mei, P. Rives. Single
view point omnidirectional camera calibration. 2007. B. Khomutenko et al. An enhanced unified camera
model. 2016. V. Usenko et al. The double sphere camera model. 2018. A. Fitzgibbon. Simultaneous
linear estimation of multiple view geometry and lens distortion. 2001.
"""

import numpy as np

from rastercov.base import FloatArray
from rastercov.engine.solver_lens import (
    B0,
    B1,
    B2,
    CX,
    CY,
    D1,
    D2,
    D3,
    DIVISION,
    DOUBLE_SPHERE,
    EQUIDISTANT,
    EQUIRECTANGULAR,
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

Plane = tuple[FloatArray, FloatArray]
"""x and y of points."""


def angle_over_r(r2: FloatArray, z: FloatArray) -> FloatArray:
    """Angle from the z axis over r, of a point at distance r = sqrt(r2) from the axis."""
    r = np.sqrt(r2)
    return np.where(r > 0, np.arctan2(r, z) / np.where(r > 0, r, 1.0), 1.0 / z)


sqrt = np.sqrt
atan2 = np.arctan2


def image_of_base(code: int, p: FloatArray, X: FloatArray, Y: FloatArray, Z: FloatArray) -> Plane:
    """Base of the lens: point (x, y) of its plane."""
    if code == EQUIDISTANT:
        g = angle_over_r(X * X + Y * Y, Z)
    elif code == EQUISOLID:  # 2 sin(theta / 2)
        rho = sqrt(X * X + Y * Y + Z * Z)
        g = 1.4142135623730951 / sqrt(rho * (rho + Z))
    elif code == UNIFIED:
        g = 1.0 / (p[B0] * sqrt(p[B2] * (X * X + Y * Y) + Z * Z) + p[B1] * Z)
    elif code == DOUBLE_SPHERE:
        r2 = X * X + Y * Y
        c = p[B0] * sqrt(r2 + Z * Z) + Z
        g = 1.0 / (p[B1] * sqrt(r2 + c * c) + (1.0 - p[B1]) * c)
    elif code == FOV:  # atan(B0 R / Z) B1 / (B0 R)
        g = angle_over_r((X * X + Y * Y) * (p[B0] * p[B0]), Z) * p[B1]
    elif code == DIVISION:
        g = 2.0 / (Z + sqrt(Z * Z - 4.0 * p[B0] * (X * X + Y * Y)))
    else:
        g = 1.0 / Z
    return X * g, Y * g


def radial_factor(p: FloatArray, q: FloatArray) -> FloatArray:
    """Radial distortion at squared radius q: distorted radius over radius."""
    factor = p[K6]
    factor = q * factor + p[K5]
    factor = q * factor + p[K4]
    factor = q * factor + p[K3]
    factor = q * factor + p[K2]
    factor = q * factor + p[K1]
    factor = q * factor + 1.0
    if p[D1] != 0.0 or p[D2] != 0.0 or p[D3] != 0.0:
        factor = factor / (q * (q * (q * p[D3] + p[D2]) + p[D1]) + 1.0)
    return factor


def distort(p: FloatArray, x: FloatArray, y: FloatArray) -> Plane:
    """Radial, tangential and thin-prism distortion of a point of the plane of the base."""
    radial = radial_factor(p, x * x + y * y)
    a = x * radial
    b = y * radial
    if p[P1] != 0.0 or p[P2] != 0.0 or p[S1] != 0.0 or p[S2] != 0.0 or p[S3] != 0.0 or p[S4] != 0.0:
        if p[LATE] != 0.0:
            x = a
            y = b
        q = x * x + y * y
        xy = 2.0 * (x * y)
        a = a + p[P1] * xy + p[P2] * (q + 2.0 * (x * x)) + q * (q * p[S2] + p[S1])
        b = b + p[P1] * (q + 2.0 * (y * y)) + p[P2] * xy + q * (q * p[S4] + p[S3])
    return a, b


def image_of(p: FloatArray, a: FloatArray, b: FloatArray) -> Plane:
    """Tilt and pixels of a distorted point."""
    if p[T20] != 0.0 or p[T21] != 0.0:
        w = 1.0 / (p[T20] * a + p[T21] * b + p[T22])
        b = (p[T10] * a + p[T11] * b) * w
        a = p[T00] * a * w
    return p[FX] * a + p[SKEW] * b + p[CX], p[FY] * b + p[CY]


def project(code: int, p: FloatArray, X: FloatArray, Y: FloatArray, Z: FloatArray) -> Plane:
    """Pixel (u, v) of a ray by the equations alone, wherever it is."""
    if code == EQUIRECTANGULAR:  # longitude is continuous within half a turn of B0
        a = p[B0] + atan2(X * p[B1] - Z * p[B2], Z * p[B1] + X * p[B2])
        b = atan2(Y, sqrt(X * X + Z * Z))
    else:
        x, y = image_of_base(code, p, X, Y, Z)
        a, b = distort(p, x, y)
    return image_of(p, a, b)
