"""Cameras that count together: what of a rig is covered where k of n of them see it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rastercov.base.memory import BoolArray, ByteArray, IntArray
from rastercov.camera.camera import Camera


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
        found: BoolArray = np.count_nonzero(sees, axis=0) >= self.k
        return found & sees[list(self.needs)].all(axis=0)

    def failing(self, reason: ByteArray) -> tuple[ByteArray, IntArray]:
        """Reason of the device that is missed most, (...), and the device, from (n, ...) of each.

        It is the lowest that must rise for it to hold; where that is "covered", it holds.
        """
        others = [row for row in range(self.n) if row not in self.needs]
        wanted = [*self.needs]
        rest = reason[others]
        order = np.argsort(-rest.astype(np.int64), axis=0, kind="stable")
        device, found = np.zeros(reason.shape[1:], np.int64), np.full(reason.shape[1:], 255)
        if (more := self.k - len(wanted)) > 0:
            device = np.array(others)[order[more - 1]]
            found = np.take_along_axis(rest, order[more - 1][None], axis=0)[0].astype(np.int64)
        for row in wanted:
            is_less = reason[row] < found
            device, found = np.where(is_less, row, device), np.where(is_less, reason[row], found)
        return found.astype(np.uint8), device

    def without(self, device: int) -> "Gate":
        """The same where a device sees everything: that of the others, with k = 0 where it is all.

        Numbers of devices are as before, of which the caller leaves out this one.
        """
        needs = tuple(row for row in self.needs if row != device)
        return replace(self, k=max(self.k - 1, len(needs)), needs=needs)

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
