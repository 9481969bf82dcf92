"""Intervals of real numbers that hold their exact results, and values with one derivative."""

import math
from dataclasses import dataclass
from typing import Any


def _down(x: float) -> float:
    return math.nextafter(x, -math.inf) if x == x else -math.inf


def _up(x: float) -> float:
    return math.nextafter(x, math.inf) if x == x else math.inf


@dataclass(frozen=True)
class Interval:
    """Numbers from `low` to `high`; each operation is rounded outwards."""

    low: float
    high: float

    @staticmethod
    def of(value: Any) -> "Interval":
        """The value itself, or a number as an interval."""
        return value if isinstance(value, Interval) else Interval(float(value), float(value))

    def __add__(self, other: Any) -> "Interval":
        other = Interval.of(other)
        return Interval(_down(self.low + other.low), _up(self.high + other.high))

    __radd__ = __add__

    def __neg__(self) -> "Interval":
        return Interval(-self.high, -self.low)

    def __sub__(self, other: Any) -> "Interval":
        return self + -Interval.of(other)

    def __rsub__(self, other: Any) -> "Interval":
        return Interval.of(other) + -self

    def __mul__(self, other: Any) -> "Interval":
        other = Interval.of(other)
        # A product with an exact 0 is 0, also of an unlimited interval.
        products = [
            0.0 if 0.0 in (a, b) else a * b
            for a in (self.low, self.high)
            for b in (other.low, other.high)
        ]
        return Interval(_down(min(products)), _up(max(products)))

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> "Interval":
        other = Interval.of(other)
        if other.low <= 0.0 <= other.high or other.low != other.low or other.high != other.high:
            return Interval(-math.inf, math.inf)
        return self * Interval(_down(1.0 / other.high), _up(1.0 / other.low))

    def __rtruediv__(self, other: Any) -> "Interval":
        return Interval.of(other) / self


class Jet:
    """A value and its derivative by one variable, over any numbers with + - * /."""

    __array_ufunc__ = None  # numpy leaves the operations to this class

    def __init__(self, value: Any, slope: Any) -> None:
        self.value, self.slope = value, slope

    @staticmethod
    def of(value: Any) -> "Jet":
        """The value itself, or a constant."""
        return value if isinstance(value, Jet) else Jet(value, 0.0)

    def __add__(self, other: Any) -> "Jet":
        other = Jet.of(other)
        return Jet(self.value + other.value, self.slope + other.slope)

    __radd__ = __add__

    def __neg__(self) -> "Jet":
        return Jet(-self.value, -self.slope)

    def __sub__(self, other: Any) -> "Jet":
        return self + -Jet.of(other)

    def __rsub__(self, other: Any) -> "Jet":
        return Jet.of(other) + -self

    def __mul__(self, other: Any) -> "Jet":
        other = Jet.of(other)
        return Jet(self.value * other.value, self.slope * other.value + self.value * other.slope)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> "Jet":
        other = Jet.of(other)
        value = self.value / other.value
        return Jet(value, (self.slope - value * other.slope) / other.value)

    def __rtruediv__(self, other: Any) -> "Jet":
        return Jet.of(other) / self
