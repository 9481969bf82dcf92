"""Bounds of the second and third derivatives of a lens over parts of an ideal plane.

The region is divided into cells. The equations are evaluated at p + t d, d a direction and p all
points of a cell, as expansions in t up to t^5, whose coefficients are intervals that hold those of
each p (`quadrature.pixels_along_lines`); that of order m is the derivative over m!, and bounds
between directions follow as there. Where nothing is known by them, Cauchy's estimate bounds the
derivatives: a bound M of |u - u0| within R (`balls.reach`) gives m! M / R^m. Then each cell is
divided, differences give the derivatives in the middle of a part, and the bounds of the next orders
what they are off by, and how much they change in the part.
"""

import math
from functools import lru_cache

import numpy as np

from rastercov.base.memory import FloatArray, read_only
from rastercov.camera.lenses import balls, formulas
from rastercov.camera.lenses.balls import ROUNDING, Ball
from rastercov.camera.lenses.planes import IdealPlane, cells_of
from rastercov.camera.lenses.quadrature import DIRECTIONS, ROUNDING_REL, pixels_along_lines
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
    centre, radii = np.zeros((2, 2, ORDERS[-1] + 1, DIRECTIONS, len(x)))
    for k, pixel in enumerate(pixels_along_lines(plane, x, y, half, ORDERS[-1])):
        n = len(pixel.centre)
        centre[k, :n] = pixel.centre.reshape(n, DIRECTIONS, -1)
        radii[k, :n] = pixel.radius.reshape(n, DIRECTIONS, -1)
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
    pole = 0.0, 0.0
    if plane.has_pole:
        pole = _near_pole(plane)
    elif not is_affine(plane):
        rows = np.flatnonzero(plane.meets(x, y, half))
        sizes[0], sizes[1] = np.inf, 0.0  # which is no limit beyond the region
        bounds[:, rows], sizes[:, rows] = derivatives_in_cells(plane, x[rows], y[rows], half)
    # Of each part of a cell.
    coarse = bounds.reshape(-1, CELLS, CELLS).repeat(PARTS, axis=1).repeat(PARTS, axis=2)
    second, third = coarse[:2]
    low = plane.region.min(axis=0)
    if bounds.any():
        second, third = _sharpened(plane, coarse, low, np.array(half) / PARTS)
    return Slopes(
        low_x=float(low[0]),
        low_y=float(low[1]),
        per_x=PARTS / (2 * half[0]),
        per_y=PARTS / (2 * half[1]),
        second=read_only(second),
        third=read_only(third),
        sizes=read_only(sizes.reshape(2, CELLS, CELLS)),
        is_graded=plane.has_pole,
        near_pole_2=pole[0],
        near_pole_3=pole[1],
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
        (i, j): _first_derivatives(plane, middle + STEP * np.array((i, j)))
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


def _first_derivatives(plane: IdealPlane, points: FloatArray) -> FloatArray:
    """(N, 4) u_x, u_y, v_x, v_y at points (N, 2) of a plane."""
    everywhere = plane.params.copy()
    everywhere[formulas.SLOPE] = -ALMOST_NOTHING  # also a step beyond the region
    rays = points @ plane.frame[:, :2].T + plane.frame[:, 2]
    out = np.empty((len(points), 2, 3))
    jacobian_many(plane.code, everywhere, np.ascontiguousarray(rays), out)
    return (out @ plane.frame[:, :2]).reshape(-1, 4)


def _near_pole(plane: IdealPlane) -> tuple[float, float]:
    """Bounds of second and third derivatives times d^2 and d^3, d <= 2^(1/2) that from the pole.

    Longitude is the imaginary part of log(x + i y), whose derivatives are at most 1 / d^2 and
    2 / d^3. Latitude is 90 degrees less F(d^2), F(s) = atan(s^(1/2)). Its second derivative along a
    line is at most 1 / d; its third, F_3 s_1^3 + 3 F_2 s_1 s_2 with s_1 <= 2 d and s_2 = 2 the
    derivatives of s, at most 11 / d^2, for |F_2| <= 9/32 s^(-3/2) and |F_3| <= 0.95 s^(-5/2).
    """
    p = plane.params
    across, down, skew = (abs(float(p[k])) for k in (formulas.FX, formulas.FY, formulas.SKEW))
    farthest = math.sqrt(2)
    second = math.hypot(across + skew * farthest, down * farthest)
    third = math.hypot(2 * across + 11 * skew * farthest, 11 * down * farthest)
    return second, third
