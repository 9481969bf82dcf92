"""Deadline of a search, passed down to the loops that check it."""

import math
import time
from dataclasses import dataclass
from typing import Self


class TimeUpError(Exception):
    """A deadline has passed; caught by the search that it ends."""


@dataclass(frozen=True)
class Deadline:
    """A moment of the clock.

    Attributes
    ----------
    at : float
        Of `time.perf_counter`, seconds; inf for never.
    """

    at: float = math.inf

    @classmethod
    def after(cls, seconds: float) -> Self:
        """Deadline a number of seconds from now."""
        return cls(time.perf_counter() + seconds)

    def sooner(self, share: float) -> Self:
        """Deadline after a share of the remaining time."""
        late = (1 - share) * max(0.0, self.left)
        return type(self)(self.at - late) if late < math.inf else self

    def earlier(self, seconds: float) -> Self:
        """Deadline a number of seconds before this one."""
        return type(self)(self.at - seconds)

    @property
    def left(self) -> float:
        """Seconds left; negative once it has passed."""
        return self.at - time.perf_counter()

    @property
    def is_over(self) -> bool:
        """True once it has passed."""
        return self.left <= 0

    def check(self) -> None:
        """Raise TimeUpError once it has passed."""
        if self.is_over:
            raise TimeUpError


NEVER = Deadline()
