"""Derivatives of a lens over cells of an ideal plane: Taylor series with balls as numbers.

The equations of the lens are evaluated at p + t d, d a direction and p all points of a cell, as
series in t up to t^3, whose coefficients are balls (`balls`) that hold those of each p. Balls of
the size of a cell are so small that the bounds are near the truth, unlike those of Cauchy's
estimate, which needs balls of the size of its radius.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.camera.lenses.balls import ROUNDING, Ball, _sqrt
from rastercov.kernels import lens_formulas

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


class Series:
    """Coefficients of t^0 ... t^ORDER, balls or numbers, of which the last may be left out."""

    __array_ufunc__ = None  # numpy leaves the operations to this class

    def __init__(self, *terms: Any) -> None:
        self.terms = terms

    @staticmethod
    def of(value: Any) -> "Series":
        """The value itself, or a constant."""
        return value if isinstance(value, Series) else Series(value)

    def __add__(self, other: Any) -> "Series":
        one, two = self.terms, Series.of(other).terms
        if len(one) < len(two):
            one, two = two, one
        return Series(*(a + b for a, b in zip(one, two, strict=False)), *one[len(two) :])

    __radd__ = __add__

    def __neg__(self) -> "Series":
        return Series(*(-a for a in self.terms))

    def __sub__(self, other: Any) -> "Series":
        return self + -Series.of(other)

    def __rsub__(self, other: Any) -> "Series":
        return Series.of(other) + -self

    def __mul__(self, other: Any) -> "Series":
        one, two = self.terms, Series.of(other).terms
        sums: list[Any] = [None] * min(len(one) + len(two) - 1, ORDER + 1)
        for i, a in enumerate(one):
            for j, b in enumerate(two[: len(sums) - i]):
                sums[i + j] = a * b if sums[i + j] is None else sums[i + j] + a * b
        return Series(*sums)

    __rmul__ = __mul__

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

    def __rtruediv__(self, other: Any) -> "Series":
        return Series.of(other) / self


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
