"""Record of one comparison with an outside program, and the list of comparisons of a module."""

from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version

import numpy as np
from numpy.typing import ArrayLike, NDArray

BoolArray = NDArray[np.bool_]


@dataclass
class Compared:
    """Figures of one quantity, ours beside theirs."""

    quantity: str
    unit: str
    figures: int = 0
    largest: float = 0.0
    """Largest difference among figures that are within both bounds; NaN for indices."""
    beyond: int = 0
    """Figures that differ by more than both bounds together."""
    reasons: dict[str, int] = field(default_factory=dict)
    """Of these, the number with each explanation."""
    faults: list[str] = field(default_factory=list)
    """Of these, ones that are wrong here, each with its case."""
    note: str = ""

    def add(self, ours: ArrayLike, theirs: ArrayLike, bound: ArrayLike) -> BoolArray:
        """Add figures; true where they differ by more than the sum of both bounds."""
        off = np.abs(np.asarray(ours, float) - np.asarray(theirs, float))
        beyond = ~(off <= bound)  # NaN is beyond
        self.figures += off.size
        self.beyond += int(beyond.sum())
        self.largest = max(self.largest, float(off[~beyond].max(initial=0.0)))
        return beyond

    def explain(self, reason: str, count: int) -> None:
        """Attribute figures that differ to a reason."""
        if count:
            self.reasons[reason] = self.reasons.get(reason, 0) + int(count)

    @property
    def is_explained(self) -> bool:
        """True if every difference beyond the bounds has a reason and none is a fault."""
        return not self.faults and self.beyond == sum(self.reasons.values())


@dataclass(frozen=True)
class Comparison:
    """A program to compare with: its name, its package on PyPI, and the function that runs it.

    The function takes the part of the full campaign to run, 1 for all of it.
    """

    name: str
    package: str | None
    run: Callable[[float], list[Compared]]

    def version(self) -> str | None:
        """Name and version of the program; None where it is not installed."""
        if self.package is None:
            return self.name
        try:
            return f"{self.name} {version(self.package)}"
        except PackageNotFoundError:
            return None


def amount(full: int, effort: float, least: int = 1) -> int:
    """Part of a number, and at least `least`."""
    return max(least, round(full * effort))
