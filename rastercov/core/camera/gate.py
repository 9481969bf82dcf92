"""Cameras that count together: what of a rig is covered where k of n of them see it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from rastercov.base import BoolArray, ByteArray, FloatArray
from rastercov.core.camera.camera import Camera


class RigRule(NamedTuple):
    """A rule with its limits for kernels, `area/rule.hpp`: n marks, angles, metres and radians."""

    k: int
    needs: ByteArray
    stripes: ByteArray
    least_deg: float
    most_deg: float
    most_deviation: float
    noise: FloatArray


@dataclass(frozen=True)
class Gate:
    """Devices that count together: k of n of them, and those of `needs` among these.

    A feature derives from it gates that ask for more, as the functions at the end say.

    Attributes
    ----------
    n, k : int
    needs : tuple of int
        In ascending order.
    """

    n: int
    k: int
    needs: tuple[int, ...] = ()

    def in_words(self, names: Sequence[str]) -> str:
        """Sentence on what is measured, with the names of the devices."""
        if self.k == self.n:
            said = [f"{' and '.join(names)} see it"]
        else:
            needed = " and ".join(names[row] for row in self.needs)
            said = [f"{self.k} of {', '.join(names)} see it"]
            said += [f"{needed} among them"] if needed else []
        return f"A point is measured if {', '.join((*said, *self.further()))}."

    def holds(self, sees: BoolArray) -> BoolArray:
        """(...) whether it holds where each of the devices sees, (n, ...)."""
        mask: BoolArray = np.count_nonzero(sees, axis=0) >= self.k
        return mask & sees[list(self.needs)].all(axis=0)

    def without(self, device: int) -> "Gate":
        """The same where a device sees everything: that of the others, with k = 0 where it is all.

        Numbers of devices are as before, of which the caller leaves out this one.
        """
        needs = tuple(row for row in self.needs if row != device)
        return replace(self, k=max(self.k - 1, len(needs)), needs=needs)

    def _for_kernels(self) -> RigRule:
        """The rule for kernels."""
        return RigRule(
            self.k, self._marks(self.needs), self._marks(()), 0.0, 180.0, 0.0, np.zeros(0)
        )

    def _marks(self, devices: Sequence[int]) -> ByteArray:
        """(n,) 1 for some devices."""
        return np.isin(np.arange(self.n), devices).astype(np.uint8)

    def further(self) -> list[str]:
        """Words on what it asks for beside the count."""
        return []

    @property
    def modes(self) -> tuple[str, ...]:
        """Modes of `rastercov.report.modes` that it has values of."""
        return ()

    @property
    def unproved(self) -> str:
        """Refusal where nothing is known of it with installation errors."""
        return ""

    def off_by(self, degrees: float) -> "Gate":
        """The same with limits of angles that hold for all changes, or for some if below 0."""
        return self

    def with_camera(self, device: int, before: Camera, after: Camera) -> "Gate":
        """The same with another camera of a device."""
        return self
