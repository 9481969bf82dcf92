"""Bounds of the second and third derivatives of a lens over parts of an ideal plane.

By Cauchy's estimate a bound M of |f - k|, f the first derivatives and k any number, within R of a
point bounds the derivatives there: that of order m is at most (m - 1)! M / R^(m-1). M is found by
the equations on complex balls (`balls.slope_reach`), for each cell of a grid over the region; the
best of some radii counts. These bounds are some ten to a hundred times too large. So each cell is
divided, differences give the derivatives in the middle of a part, and the bounds of the next orders
what they are off by, and how much they change in the part. Third derivatives have bounds of their
own: the equations are evaluated at p + t d, d a direction and p all points of a cell, as series in
t up to t^3, whose coefficients are balls that hold those of each p. Balls of the size of a cell are
so small that these bounds are near the truth, unlike those of Cauchy's estimate, which needs balls
of the size of its radius.
"""

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.camera.lenses import balls
from rastercov.camera.lenses.balls import ROUNDING, Arithmetic, Ball, _sqrt
from rastercov.camera.lenses.planes import IdealPlane
from rastercov.kernels import lens_formulas
from rastercov.kernels.lens import jacobian_many
from rastercov.kernels.lens_field import CELLS, PARTS, Slopes

FloatArray = NDArray[np.float64]

ORDER = 3
BASES = (
    lens_formulas.PINHOLE,
    lens_formulas.EQUISOLID,
    lens_formulas.UNIFIED,
    lens_formulas.DOUBLE_SPHERE,
    lens_formulas.DIVISION,
)
"""Bases that have a formula without angles."""
STEP = 1e-3
"""Step of the differences, in units of the plane: far less than the least of the radii."""
ALMOST_NOTHING = 1e-300
"""Slope of the cone around -z that a lens is not evaluated in."""
ORDERS = (2, 3, 4, 5)
RADII = tuple(np.geomspace(0.01, 0.5, 12).tolist())
"""Radii, in units of the plane, at which bounds are tried."""
MOST_PLANES = 64
"""Planes whose slopes are kept from the record of a plane to its first use, 280 kB each."""


class Series(Arithmetic):
    """Coefficients of t^0 ... t^ORDER, balls or numbers, of which the last may be left out."""

    def __init__(self, *terms: Any) -> None:
        self.terms = terms

    @classmethod
    def constant(cls, value: Any) -> "Series":
        """A constant."""
        return cls(value)

    def __add__(self, other: Any) -> "Series":
        one, two = self.terms, Series.of(other).terms
        if len(one) < len(two):
            one, two = two, one
        return Series(*(a + b for a, b in zip(one, two, strict=False)), *one[len(two) :])

    def __neg__(self) -> "Series":
        return Series(*(-a for a in self.terms))

    def __mul__(self, other: Any) -> "Series":
        one, two = self.terms, Series.of(other).terms
        sums: list[Any] = [None] * min(len(one) + len(two) - 1, ORDER + 1)
        for i, a in enumerate(one):
            for j, b in enumerate(two[: len(sums) - i]):
                sums[i + j] = a * b if sums[i + j] is None else sums[i + j] + a * b
        return Series(*sums)

    def __truediv__(self, other: Any) -> "Series":
        # q b = a, from the lowest term on.
        a, b = self.terms, Series.of(other).terms
        found: list[Any] = []
        for k in range(ORDER + 1):
            rest: Any = a[k] if k < len(a) else 0.0
            for j in range(1, min(k, len(b) - 1) + 1):
                rest = rest - b[j] * found[k - j]
            found.append(rest / b[0])
        return Series(*found)


def _root(value: Any) -> Series:
    # s s = a, from the lowest term on.
    a = Series.of(value).terms
    found = [_sqrt(a[0])]
    for k in range(1, ORDER + 1):
        rest: Any = a[k] if k < len(a) else 0.0
        for j in range(1, k):
            rest = rest - found[j] * found[k - j]
        found.append(rest / (2.0 * found[0]))
    return Series(*found)


_project: Any = lens_formulas.bound_to({"sqrt": _root})["project"]


def derivatives_in_cells(
    code: int,
    params: FloatArray,
    frame: FloatArray,
    x: FloatArray,
    y: FloatArray,
    half: tuple[float, float],
) -> tuple[FloatArray, FloatArray]:
    """Third derivatives of pixels along lines in cells of a plane, and determinants of the first.

    Parameters
    ----------
    code, params, frame
        As of `balls.reach`.
    x, y, half
        Middles (N,) of the cells, and half their sides, in units of the plane.

    Returns
    -------
    (N,) float64
        Bounds of the third derivatives, px; infinite where nothing is known: for the bases that are
        not in `BASES`, and at poles.
    (2, N) float64
        Least and greatest size of the determinant, px^2: 0 and infinite where nothing is known.
    """
    if code not in BASES:
        unknown = np.full((3, *np.shape(x)), np.inf)
        unknown[1] = 0.0
        return unknown[0], unknown[1:]
    zero = np.zeros(np.shape(x))

    def along(dx: float, dy: float) -> list[Ball]:
        X, Y = Series(Ball(x, half[0] + zero), dx), Series(Ball(y, half[1] + zero), dy)
        rays = [float(f[0]) * X + float(f[1]) * Y + float(f[2]) for f in frame]
        return [Ball.of(pixel.terms[k]) for pixel in _project(code, params, *rays) for k in (3, 1)]

    total = zero
    with np.errstate(all="ignore"):
        ways = [along(*d) for d in ((1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, -1.0))]
        for pixel in (0, 2):
            xxx, yyy, up, down = (6.0 * way[pixel] for way in ways)
            # (1, 1): xxx + 3 xxy + 3 xyy + yyy; (1, -1): xxx - 3 xxy + 3 xyy - yyy.
            xxy, xyy = 0.5 * (up - down) - yyy, 0.5 * (up + down) - xxx
            for ball, weight in ((xxx, 1.0), (yyy, 1.0), (xxy, 1 / 3), (xyy, 1 / 3)):
                total = total + weight * (np.abs(ball.centre) + ball.radius) ** 2
        bound = np.sqrt(total) * ROUNDING
        (_, u_x, _, v_x), (_, u_y, _, v_y) = ways[:2]
        det = u_x * v_y - u_y * v_x
        size = np.abs(det.centre)
        most = (size + det.radius) * ROUNDING
        sizes = np.stack((np.maximum(size - det.radius * ROUNDING, 0.0) / ROUNDING, most))
    is_known = np.isfinite(bound) & np.isfinite(most)
    sizes = np.where(is_known, sizes, [[0.0], [np.inf]])
    return np.where(is_known, bound, np.inf), sizes


def is_affine(plane: IdealPlane) -> bool:
    """True for a lens without distortion: pixels are affine in its plane."""
    p = plane.params
    is_flat = not p[lens_formulas.K1 : lens_formulas.T00].any()
    is_flat = is_flat and p[lens_formulas.T20] == 0.0 and p[lens_formulas.T21] == 0.0
    return bool(plane.code == lens_formulas.PINHOLE and is_flat)


@lru_cache(maxsize=MOST_PLANES)
def slopes_in(plane: IdealPlane) -> Slopes:
    """Bounds in the region of a plane."""
    low, high = plane.region.min(axis=0), plane.region.max(axis=0)
    half = (high - low) / (2 * CELLS)
    middle = low[:, None] + half[:, None] * (2 * np.arange(CELLS) + 1)
    x, y = (grid.ravel() for grid in np.meshgrid(*middle))
    bounds, sizes = np.zeros((len(ORDERS), CELLS * CELLS)), np.zeros((2, CELLS * CELLS))
    sizes[1] = np.inf
    pole = 0.0, 0.0
    if plane.has_pole:
        pole = _near_pole(plane)
    elif not is_affine(plane):
        rows = np.flatnonzero(plane.meets(x, y, (float(half[0]), float(half[1]))))
        bounds[:, rows] = np.inf
        for radius in RADII:
            # All points of a cell have the ball of its middle within theirs.
            ball = radius + float(half.max())
            change = balls.slope_reach(
                plane.code, plane.params, plane.frame, x[rows], y[rows], ball
            )
            for bound, order in zip(bounds, ORDERS, strict=True):
                own = math.factorial(order - 1) * change / radius ** (order - 1)
                bound[rows] = np.minimum(bound[rows], own)
        sizes[0], sizes[1] = np.inf, 0.0  # which is no limit beyond the region
        in_cells, sizes[:, rows] = derivatives_in_cells(
            plane.code,
            plane.params,
            plane.frame,
            x[rows],
            y[rows],
            (float(half[0]), float(half[1])),
        )
        bounds[1, rows] = np.minimum(bounds[1, rows], in_cells)
    # Of each part of a cell.
    coarse = bounds.reshape(-1, CELLS, CELLS).repeat(PARTS, axis=1).repeat(PARTS, axis=2)
    second, third = coarse[:2]
    if bounds.any():
        second, third = _sharpened(plane, coarse, low, half / PARTS)
    found = Slopes(
        low_x=float(low[0]),
        low_y=float(low[1]),
        per_x=PARTS / (2 * float(half[0])),
        per_y=PARTS / (2 * float(half[1])),
        second=np.ascontiguousarray(second),
        third=np.ascontiguousarray(third),
        sizes=np.ascontiguousarray(sizes.reshape(2, CELLS, CELLS)),
        is_graded=plane.has_pole,
        near_pole_2=pole[0],
        near_pole_3=pole[1],
    )
    for grid in (found.second, found.third, found.sizes):
        grid.flags.writeable = False
    return found


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
    everywhere[lens_formulas.SLOPE] = -ALMOST_NOTHING  # also a step beyond the region
    rays = points @ plane.frame[:, :2].T + plane.frame[:, 2]
    out = np.empty((len(points), 2, 3))
    jacobian_many(plane.code, everywhere, np.ascontiguousarray(rays), out)
    slopes: FloatArray = (out @ plane.frame[:, :2]).reshape(-1, 4)
    return slopes


def _near_pole(plane: IdealPlane) -> tuple[float, float]:
    """Bounds of second and third derivatives times d^2 and d^3, d <= 2^(1/2) that from the pole.

    Longitude is the imaginary part of log(x + i y), whose derivatives are at most 1 / d^2 and
    2 / d^3. Latitude is 90 degrees less F(d^2), F(s) = atan(s^(1/2)). Its second derivative along a
    line is at most 1 / d; its third, F_3 s_1^3 + 3 F_2 s_1 s_2 with s_1 <= 2 d and s_2 = 2 the
    derivatives of s, at most 11 / d^2, for |F_2| <= 9/32 s^(-3/2) and |F_3| <= 0.95 s^(-5/2).
    """
    p = plane.params
    across, down, skew = (
        abs(float(p[k])) for k in (lens_formulas.FX, lens_formulas.FY, lens_formulas.SKEW)
    )
    farthest = math.sqrt(2)
    second = math.hypot(across + skew * farthest, down * farthest)
    third = math.hypot(2 * across + 11 * skew * farthest, 11 * down * farthest)
    return second, third
