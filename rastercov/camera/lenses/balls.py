"""Numbers with bounds, and bounds of lenses over complex numbers: `reach`.

The equations of `formulas` run on any numbers. A ball is a centre and a radius, complex numbers
within the radius of the centre; an operation gives a ball that holds all its results. Values are
arrays: many balls are computed at once. Where a ball meets a pole or a branch, the radius is
infinite. Real constants remain plain numbers, so that what is 0, as most coefficients of a lens
are, costs nothing.

By Cauchy's estimate a bound M of |u - u0| within R of a point bounds the derivatives there: the
second is at most 2 M / R^2. By Bernstein's, it bounds the error of a quadrature (`edge_rule`).
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike, NDArray

from rastercov.base.memory import FloatArray
from rastercov.camera.lenses import formulas

ROUNDING = 1 + 1e-9
"""Factor on a bound, for the rounding of the operations on centres and radii."""


class Arithmetic:
    """Operations of a number that follow from its +, -x, * and /."""

    __array_ufunc__ = None  # numpy leaves the operations to this class

    __add__: Any
    __neg__: Any
    __mul__: Any

    def __radd__(self, other: object) -> Any:
        return self + other

    def __sub__(self, other: Any) -> Any:
        return self + -other

    def __rsub__(self, other: Any) -> Any:
        return -self + other

    def __rmul__(self, other: object) -> Any:
        return self * other


class Ball(Arithmetic):
    """Complex numbers within `radius` of `centre`, arrays of one shape."""

    def __init__(self, centre: ArrayLike, radius: ArrayLike) -> None:
        self.centre = np.asarray(centre, np.complex128)
        self.radius = np.asarray(radius, np.float64)

    @staticmethod
    def of(value: "Ball | ArrayLike") -> "Ball":
        """The ball itself, or numbers as balls of radius 0."""
        return value if isinstance(value, Ball) else Ball(value, 0.0)

    def __add__(self, other: "Ball | ArrayLike") -> "Ball":
        if isinstance(other, float):
            return self if other == 0.0 else Ball(self.centre + other, self.radius)
        other = Ball.of(other)
        return Ball(self.centre + other.centre, self.radius + other.radius)

    def __neg__(self) -> "Ball":
        return Ball(-self.centre, self.radius)

    def __mul__(self, other: "Ball | ArrayLike") -> Any:
        """Product; the number 0.0 for a factor of 0.0, where no ball is without limit."""
        if isinstance(other, float):
            if other != 0.0:
                return Ball(self.centre * other, self.radius * abs(other))
            is_limited = self.radius < np.inf
            return 0.0 if is_limited.all() else Ball(0.0, np.where(is_limited, 0.0, np.inf))
        other = Ball.of(other)
        a, b = np.abs(self.centre), np.abs(other.centre)
        radius = a * other.radius + b * self.radius + self.radius * other.radius
        return _ball(self.centre * other.centre, radius, radius < np.inf)

    def _inverse(self) -> "Ball":
        size = np.abs(self.centre)
        is_good = size > self.radius
        return _ball(1 / self.centre, self.radius / (size * (size - self.radius)), is_good)

    def __truediv__(self, other: "Ball | ArrayLike") -> Any:
        return self * Ball.of(other)._inverse()

    def __rtruediv__(self, other: "Ball | ArrayLike") -> Any:
        return self._inverse() * other


Operand = Ball | ArrayLike


def _ball(centre: ArrayLike, radius: ArrayLike, is_good: ArrayLike) -> Ball:
    """A ball where it is good, else one without limit."""
    return Ball(np.where(is_good, centre, 0), np.where(is_good, radius, np.inf))


def _smaller(one: Ball, other: Ball) -> Ball:
    is_one = one.radius <= other.radius
    return Ball(
        np.where(is_one, one.centre, other.centre), np.where(is_one, one.radius, other.radius)
    )


def _sqrt(z: Operand) -> Any:
    if not isinstance(z, Ball):
        return np.sqrt(z)
    # |sqrt z - sqrt c| = |z - c| / |sqrt z + sqrt c|; both roots are within 45 degrees of 1.
    is_good = z.centre.real > z.radius
    return _ball(np.sqrt(z.centre), z.radius / np.sqrt(np.abs(z.centre)), is_good)


def _atan(z: Ball) -> Ball:
    # The derivative is 1 / ((z - i)(z + i)); the cuts are on the imaginary axis beyond i and -i.
    to_i = np.abs(z.centre - 1j) - z.radius
    to_minus_i = np.abs(z.centre + 1j) - z.radius
    is_good = (to_i > 0) & (to_minus_i > 0)
    is_good &= (np.abs(z.centre.imag) + z.radius < 1) | (np.abs(z.centre.real) > z.radius)
    return _ball(np.arctan(z.centre), z.radius / (to_i * to_minus_i), is_good)


def _angle_over_r(r2: Operand, z: Operand) -> Ball:
    """Theta / r, the integral of 1 / (r^2 + t^2) over t > z."""
    r2, z = Ball.of(r2), Ball.of(z)
    # First along z at each r2, where the derivative is -1 / (r2 + z^2); then along r2 at the centre
    # of z, where it is the integral of -1 / (r2 + t^2)^2, whose size is largest at the least real
    # part of r2, because |r2 + t^2| is at least that and t^2.
    c, least = z.centre.real, r2.centre.real - r2.radius
    square = r2 + z * z
    is_good = (least + np.where(c > 0, c * c, 0.0) > 0) & (z.centre.imag == 0)
    is_good &= np.abs(square.centre) > square.radius
    radius = z.radius / np.where(is_good, np.abs(square.centre) - square.radius, 1.0)
    radius = radius + r2.radius * _steepest(np.where(is_good, least, 1.0), c)
    found = _ball(_angle(r2.centre, c), radius, is_good)
    r = _sqrt(r2)
    return _smaller(found, (np.pi / 2 - _atan(z / r)) / r)


def _angle(r2: NDArray[Any], z: FloatArray) -> Any:
    """Theta / r of complex r^2 and real z."""
    is_small = (np.abs(r2) < 1e-8 * z * z) & (z > 0)
    t = r2 / np.where(is_small, z * z, 1.0)
    r = np.sqrt(np.where(is_small, 1.0, r2) + 0j)
    series = (1 - t / 3 + t * t / 5) / np.where(is_small, z, 1.0)
    return np.where(is_small, series, (np.pi / 2 - np.arctan(z / r)) / r)


def _steepest(r2: FloatArray, z: FloatArray) -> FloatArray:
    """Integral of 1 / (r^2 + t^2)^2 over t > z, for real r^2 > -z^2, or > 0 where z <= 0."""
    square = z * z
    is_small = (np.abs(r2) < 0.01 * square) & (z > 0)
    away, s = np.where(is_small, 1.0, r2), r2 / np.where(is_small, square, 1.0)
    slope = (_angle(away, z).real - z / (away + square)) / (2 * away)
    series = 1 / 3 - s * (2 / 5 - s * (3 / 7 - s * (4 / 9 - s * 5 / 11)))
    return np.where(is_small, series / np.where(is_small, square * z, 1.0), slope)


def _atan2(y: Operand, x: Operand) -> Ball:
    y, x = Ball.of(y), Ball.of(x)
    # Valid on the half plane x > 0 and around the y axis; a base turns the longitude to be there.
    right = _atan(y / x)
    right = _ball(right.centre, right.radius, x.centre.real > x.radius)
    side = np.where(y.centre.real >= 0, np.pi / 2, -np.pi / 2) - _atan(x / y)
    side = _ball(side.centre, side.radius, np.abs(y.centre.real) > y.radius)
    return _smaller(right, side)


def _polynomial(coefficients: Sequence[float], x: Operand) -> Ball:
    """Polynomial of a ball by its expansion at the centre, so that no root near it is lost."""
    x, term = Ball.of(x), Polynomial(coefficients)
    centre, radius, scale = term(x.centre), np.zeros_like(x.radius), 1.0
    for k in range(1, len(coefficients)):
        term, scale = term.deriv(), scale * k
        radius = radius + np.abs(term(x.centre)) / scale * x.radius**k
    return Ball(centre, radius)


def _radial_factor(p: FloatArray, q: Operand) -> Ball:
    numerator = _polynomial([1.0, *p[formulas.K1 : formulas.K6 + 1]], q)
    return numerator / _polynomial([1.0, *p[formulas.D1 : formulas.D3 + 1]], q)


_PLAIN = {"sqrt": _sqrt, "atan2": _atan2, "angle_over_r": _angle_over_r}
_project = formulas.project_on(_PLAIN)
_project_near_pole = formulas.project_on(_PLAIN | {"radial_factor": _radial_factor})


def reach(
    code: int,
    params: FloatArray,
    frame: FloatArray,
    x: FloatArray,
    y: FloatArray,
    radius: float | FloatArray,
    *,
    is_near_pole: bool = False,
) -> tuple[FloatArray, FloatArray]:
    """Bounds of |u - u0| and |v - v0|, px, over complex points near points of an ideal plane.

    Parameters
    ----------
    code, params
        The lens.
    frame : (3, 3) float64
        Axes of the plane's camera, as columns, in axes of the lens.
    x, y : (N,) float64
        Points of the plane, X / Z and Y / Z.
    radius : float or (N,) float64
        Both coordinates of a complex point are within it of those of its (x, y).
    is_near_pole : bool
        Bound a rational lens by expansions, which are narrower where its denominator is small.

    Returns
    -------
    (N,) float64, (N,) float64
        u0, v0 is the pixel of (x, y); infinite where the lens has a pole or a branch that near.
    """
    zero = np.zeros(np.shape(x))
    X, Y = Ball(x, radius + zero), Ball(y, radius + zero)
    rays = [float(f[0]) * X + float(f[1]) * Y + float(f[2]) for f in frame]
    project = _project_near_pole if is_near_pole else _project
    with np.errstate(all="ignore"):
        pixels = (Ball.of(each).radius + zero for each in project(code, params, *rays))
        across, down = (np.where(r < np.inf, r * ROUNDING, np.inf) for r in pixels)
    return across, down
