"""The time by which a search has to end, passed down to the loops that look at it."""

import math
import time
from dataclasses import dataclass
from typing import Self


class TimeUpError(Exception):
    """The time is up; never leaves the search that it ends."""


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
        """The moment so many seconds from now."""
        return cls(time.perf_counter() + seconds)

    def sooner(self, share: float) -> Self:
        """The moment when a part of the time that is left has passed."""
        late = (1 - share) * max(0.0, self.left)
        return type(self)(self.at - late) if late < math.inf else self

    def earlier(self, seconds: float) -> Self:
        """The moment so many seconds before."""
        return type(self)(self.at - seconds)

    @property
    def left(self) -> float:
        """Seconds left; negative once it has passed."""
        return self.at - time.perf_counter()

    @property
    def is_over(self) -> bool:
        """True when it has passed."""
        return self.left <= 0

    def check(self) -> None:
        """TimeUpError once it has passed."""
        if self.is_over:
            raise TimeUpError


NEVER = Deadline()
