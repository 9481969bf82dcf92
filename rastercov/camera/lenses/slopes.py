"""Bounds of the second and third derivatives of a lens over parts of an ideal plane.

The region is divided into cells. The equations are evaluated at p + t d, d a direction and p all
points of a cell, as expansions in t up to t^5, whose coefficients are intervals that hold those of
each p (`quadrature.pixels_along_lines`); that of order m is the derivative over m!, and bounds
between directions follow as there. Where nothing is known by them, Cauchy's estimate bounds the
derivatives: a bound M of |u - u0| within R (`balls.reach`) gives m! M / R^m. Then each cell is
divided, differences give the derivatives in the middle of a part, and the bounds of the next orders
what they are off by, and how much they change in the part.

Next to a pole, and to the ray opposite to the axis of a fisheye, these bounds grow faster than what
they are used for, the derivatives of the inverse of the first derivative; so that has its own.
"""

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from rastercov.base.memory import FloatArray, read_only
from rastercov.camera.lenses import balls, formulas
from rastercov.camera.lenses.balls import ROUNDING, Ball
from rastercov.camera.lenses.planes import IdealPlane, cells_of
from rastercov.camera.lenses.quadrature import (
    DIRECTIONS,
    ROUNDING_REL,
    Expansion,
    pixels_along_lines,
)
from rastercov.camera.lenses.records import Slopes
from rastercov.native.lens_field import CELLS, PARTS
from rastercov.native.lens_rays import jacobian_many

STEP = 1e-3
"""Step of the differences, in units of the plane: far less than the least of the radii."""
ALMOST_NOTHING = 1e-300
"""Slope of the cone around -z that a lens is not evaluated in."""
ORDERS = (2, 3, 4, 5)
RADII = tuple(np.geomspace(0.01, 0.5, 12).tolist())
"""Radii, in units of the plane, at which bounds are tried."""
RINGS = 2048
"""Rings around an axis in which a fisheye is bounded."""
MOST_PLANES = 64
"""Planes whose slopes are kept from the record of a plane to its first use, 280 kB each."""


def derivatives_in_cells(
    plane: IdealPlane, x: FloatArray, y: FloatArray, half: tuple[float, float]
) -> tuple[FloatArray, FloatArray]:
    """Derivatives of pixels along lines in cells of a plane, and determinants of the first.

    Parameters
    ----------
    plane : IdealPlane
        Without a pole.
    x, y, half
        Middles (N,) of the cells, and half their sides, in units of the plane.

    Returns
    -------
    (4, N) float64
        Bounds of the derivatives of `ORDERS`, px.
    (2, N) float64
        Least and greatest size of the determinant, px^2: 0 and infinite where nothing is known.
    """
    bounds, sizes = np.full((len(ORDERS), len(x)), np.inf), np.zeros((2, len(x)))
    sizes[1] = np.inf
    for radius in RADII:
        # All points of a cell have the ball of its middle within theirs.
        reach = balls.reach(plane.code, plane.params, plane.frame, x, y, radius + max(half))
        for bound, order in zip(bounds, ORDERS, strict=True):
            cauchy = math.factorial(order) * np.hypot(*reach) / radius**order
            np.minimum(bound, cauchy, out=bound)
    centre, radii = pixels_along_lines(plane, x, y, half, ORDERS[-1])
    with np.errstate(all="ignore"):
        most = (np.abs(centre) + radii).max(axis=2)
        for bound, order in zip(bounds, ORDERS, strict=True):
            own = math.factorial(order) * np.hypot(*most[:, order]) * ROUNDING
            own /= math.cos(order * np.pi / (2 * DIRECTIONS))  # between directions
            bound[:] = np.fmin(bound, own + ROUNDING_REL * bound)
        (u_x, v_x), (u_y, v_y) = (
            [Ball(centre[k, 1, d], radii[k, 1, d]) for k in (0, 1)] for d in (0, DIRECTIONS // 2)
        )
        det = u_x * v_y - u_y * v_x
        size = np.abs(det.centre)
        most = (size + det.radius) * ROUNDING
        least = np.maximum(size - det.radius * ROUNDING, 0.0) / ROUNDING
    is_known = np.isfinite(most)
    return bounds, np.where(is_known, (least, most), sizes)


def is_affine(plane: IdealPlane) -> bool:
    """True for a lens without distortion: pixels are affine in its plane."""
    p = plane.params
    is_flat = not p[formulas.K1 : formulas.T00].any()
    is_flat = is_flat and p[formulas.T20] == 0.0 and p[formulas.T21] == 0.0
    return bool(plane.code == formulas.PINHOLE and is_flat)


@lru_cache(maxsize=MOST_PLANES)
def slopes_in(plane: IdealPlane) -> Slopes:
    """Bounds in the region of a plane."""
    x, y, half = cells_of(plane.region, CELLS)
    bounds, sizes = np.zeros((len(ORDERS), CELLS * CELLS)), np.zeros((2, CELLS * CELLS))
    sizes[1] = np.inf
    if plane.has_pole:
        bounds[:] = np.inf
    elif not is_affine(plane):
        rows = np.flatnonzero(plane.meets(x, y, half))
        sizes[0], sizes[1] = np.inf, 0.0  # which is no limit beyond the region
        bounds[:, rows], sizes[:, rows] = derivatives_in_cells(plane, x[rows], y[rows], half)
    # Of each part of a cell.
    coarse = bounds.reshape(-1, CELLS, CELLS).repeat(PARTS, axis=1).repeat(PARTS, axis=2)
    second, third = coarse[:2]
    low = plane.region.min(axis=0)
    if bounds.any() and not plane.has_pole:
        second, third = _sharpened(plane, coarse, low, np.array(half) / PARTS)
    return Slopes(
        low_x=float(low[0]),
        low_y=float(low[1]),
        per_x=PARTS / (2 * half[0]),
        per_y=PARTS / (2 * half[1]),
        second=read_only(second),
        third=read_only(third),
        sizes=read_only(sizes.reshape(2, CELLS, CELLS)),
        near_axis=read_only(_near_axis(plane)),
    )


def _sharpened(
    plane: IdealPlane, coarse: FloatArray, low: FloatArray, half: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Bounds of second and third derivatives by differences in the middle of each part.

    `coarse` are bounds of `ORDERS` in parts of half sides `half`. With a step h a difference of
    first derivatives is off by h^2 / 6 times the fourth derivative, one of second order by h^2 / 12
    times the fifth, or h^2 / 3 for a mixed one.
    """
    n = CELLS * PARTS
    rows, columns = np.nonzero(coarse[0])
    middle = low + half * (2 * np.column_stack((columns, rows)) + 1)
    at = {
        (i, j): first_derivatives(plane, middle + STEP * np.array((i, j)))
        for i in (-1, 0, 1)
        for j in (-1, 0, 1)
    }
    by_x, by_y = (at[1, 0] - at[-1, 0]) / (2 * STEP), (at[0, 1] - at[0, -1]) / (2 * STEP)
    by_xx = (at[1, 0] - 2 * at[0, 0] + at[-1, 0]) / STEP**2
    by_yy = (at[0, 1] - 2 * at[0, 0] + at[0, -1]) / STEP**2
    by_xy = (at[1, 1] - at[1, -1] - at[-1, 1] + at[-1, -1]) / (4 * STEP**2)
    second, third, fourth, fifth = coarse[:, rows, columns]
    reach = math.hypot(*half)
    size = np.sqrt((by_x**2 + by_y**2).sum(axis=1))
    sharp_2 = size + third * reach + fourth * STEP**2
    size = np.sqrt((by_xx**2 + 2 * by_xy**2 + by_yy**2).sum(axis=1))
    sharp_3 = size + fourth * reach + fifth * STEP**2
    found = np.zeros((2, n, n))
    found[0, rows, columns] = np.fmin(second, sharp_2)
    found[1, rows, columns] = np.fmin(third, sharp_3)
    return found[0], found[1]


def first_derivatives(plane: IdealPlane, points: FloatArray) -> FloatArray:
    """(N, 4) u_x, u_y, v_x, v_y at points (N, 2) of a plane."""
    everywhere = plane.params.copy()
    everywhere[formulas.SLOPE] = -ALMOST_NOTHING  # also a step beyond the region
    rays = points @ plane.frame[:, :2].T + plane.frame[:, 2]
    out = np.empty((len(points), 2, 3))
    jacobian_many(plane.code, everywhere, np.ascontiguousarray(rays), out)
    return (out @ plane.frame[:, :2]).reshape(-1, 4)


def _near_axis(plane: IdealPlane) -> FloatArray:
    """`Slopes.near_axis`.

    Let d be the distance from (0, 0), e_d and e_phi the directions along and across it. Of a
    panorama, pixels are M (longitude, latitude), and A^-1 = (d e_phi, (1 + d^2) e_d) M^-1,
    det A = det M / (d (1 + d^2)): for d <= 2^(1/2), (A^-1)' is at most (1, 4 / d) by columns and
    (A^-1)'' (0, 4 / d^2). Of a fisheye without tangential terms pixels are M F(d) e_d, and

        A^-1 = (a (I - P) + b P) M^-1,   a = d / F,   b = 1 / F',   P = e_d e_d^T,

    |P'| <= 1 / d, |P''| <= 2 / d^2. `Expansion` bounds F, and so a and b, in rings.
    """
    p = plane.params
    M = np.array([[p[formulas.FX], p[formulas.SKEW]], [0.0, p[formulas.FY]]])
    if plane.has_pole:
        inverse = np.array((math.sqrt(18.0), 4.0)) * np.linalg.norm(np.linalg.inv(M), 2)
        return np.append(inverse, (7.0 / 3, 7.0 / 3))
    is_radial = not p[formulas.P1 : formulas.T00].any() and not p[formulas.T20 : formulas.T22].any()
    if plane.hole is None or abs(plane.frame[2, 2]) < 1 or not is_radial:
        return np.full(4, np.inf)
    ends = np.geomspace(0.99 * abs(p[formulas.SLOPE]), 1.001 * math.sqrt(2), RINGS + 1)
    d, half = (ends[1:] + ends[:-1]) / 2, (ends[1:] - ends[:-1]) / 2
    own = p.copy()
    own[: formulas.K1] = 1.0, 1.0, 0.0, 0.0, 0.0
    pixels = pixels_along_lines(replace(plane, params=own), d, np.zeros(RINGS), (half, 0.0), 3)
    along = plane.frame[:2, 0]
    centre, radius = (
        np.ascontiguousarray(np.tensordot(each, of_pixels[:, :, 0], 1))
        for each, of_pixels in zip((along, np.abs(along)), pixels, strict=True)
    )
    found = _around_axis(centre, radius, d, half)
    return found * np.append(np.full(2, np.linalg.norm(np.linalg.inv(M), 2)), (1.0, 1.0)) * ROUNDING


def _around_axis(
    centre: FloatArray, radius: FloatArray, d: FloatArray, half: FloatArray
) -> FloatArray:
    """`Slopes.near_axis` in rings d +- half for pixels F(d) e_d, of intervals of F, (4, N)."""
    far, k, one = d + half, np.arange(1, 4)[:, None], np.ones_like(d)
    line = Expansion(np.array((d, one)), np.array((half, 0 * one)), 2)
    with np.errstate(all="ignore"):
        a = line / Expansion(centre[:3], radius[:3], 2)
        b = 1.0 / Expansion(centre[1:] * k, radius[1:] * k, 2)
        (_, a_1, a_2), (_, b_1, b_2), (h_0, h_1, _) = (
            (np.abs(each.centre) + each.radius) * ((1.0,), (1.0,), (2.0,)) for each in (a, b, b - a)
        )
        least_a, least_b = (np.abs(each.centre[0]) - each.radius[0] for each in (a, b))
        slope, change = np.maximum(a_1, b_1), a_1 / least_a + b_1 / least_b
        bend = (a_2 + a_1**2 / least_a) / least_a + (b_2 + b_1**2 / least_b) / least_b
        found = np.array(
            (
                np.hypot(slope * far, h_0),
                np.maximum(a_2, b_2) * far**2 + (slope + h_1) * far + 2 * h_0,
                change * far,
                np.maximum(bend * far**2, change * far),
            )
        )
    is_good = np.isfinite(found) & (np.minimum(least_a, least_b) > 0)
    return np.where(is_good, found, np.inf).max(axis=1)
