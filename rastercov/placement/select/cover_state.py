"""A set of chosen cameras that knows what each further one would add, and is quick to change."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from rastercov.placement.select import selection_kernels as kernels
from rastercov.placement.select.presolve import Merged

IntArray = NDArray[np.int64]

FINE = 20
"""Bits below the unit of weight, for progress that does not yet cover a face."""
NO_LIMIT = np.iinfo(np.int64).max


class Tally:
    """Cameras chosen so far, by their place in a `Merged` problem.

    Parameters
    ----------
    merged : Merged
        The problem.
    finish : bool
        What a step towards covering a face is worth: an even part of the face, or next to nothing
        until the last, so that faces are finished. Both are the same where one view is enough.

    Attributes
    ----------
    chosen : set of int
    worth : int
        Of the progress of all faces.
    work : int
        Elementary updates so far.
    """

    def __init__(self, merged: Merged, *, finish: bool = False) -> None:
        self.merged = merged
        quanta, need = merged.quanta, merged.need.astype(np.int64)
        worth: IntArray = quanta << FINE
        part = (quanta / max(1, int(quanta.sum())) * (1 << FINE)).astype(np.int64)
        step: IntArray = np.where(need > 1, (part if finish else worth) // need, 0)
        bonus = worth if finish else worth - step * need
        n_kinds = len(merged.least)
        self.count = np.zeros(merged.n_faces, np.int32)
        self.gain = np.zeros((merged.n_candidates, n_kinds), np.int64)
        self.done = np.zeros(n_kinds, np.int64)
        self.barred = np.zeros(merged.n_candidates, np.uint8)
        self._total = np.zeros(1, np.int64)
        self._values = (merged.views, merged.need, step, bonus, merged.kind, merged.quanta)
        self._seen = np.empty((merged.n_faces if merged.is_spread else 0, 8), np.int32)
        self._is_spread = np.zeros(merged.n_faces if merged.is_spread else 0, np.bool_)
        kernels.first_gains(
            merged.indptr, merged.face, merged.need, step, bonus, merged.kind, self.gain
        )
        self.chosen: set[int] = set()
        self.work = len(merged.face)

    @property
    def worth(self) -> int:
        """Worth of the progress of all faces."""
        return int(self._total[0])

    @property
    def covered(self) -> int:
        """Weight of the covered faces."""
        return int(self.done.sum())

    @property
    def covered_faces(self) -> NDArray[np.bool_]:
        """(F,) faces that are covered."""
        covered: NDArray[np.bool_] = self.count >= self.merged.views
        return covered & self._is_spread if self.merged.is_spread else covered

    @property
    def cost(self) -> float:
        """Cost of the chosen cameras."""
        return float(self.merged.costs[self.ranked()].sum())

    @property
    def is_met(self) -> bool:
        """Whether the requirements of `FewestCameras` hold."""
        return bool((self.done >= self.merged.least).all()) and (
            self.covered >= self.merged.least_total
        )

    def ranked(self) -> list[int]:
        """The chosen cameras in an order that does not depend on their numbers."""
        return sorted(self.chosen, key=lambda camera: int(self.merged.rank[camera]))

    def add(self, camera: int) -> None:
        """Choose a camera."""
        self._change(camera, 1)
        self.chosen.add(camera)
        self.barred[camera] = 1

    def remove(self, camera: int) -> None:
        """Give a chosen camera up."""
        self._change(camera, -1)
        self.chosen.remove(camera)
        self.barred[camera] = 0

    def become(self, chosen: Iterable[int]) -> None:
        """Change to another set of cameras."""
        wanted = set(chosen)
        for camera in self.chosen - wanted:
            self.remove(camera)
        for camera in wanted - self.chosen:
            self.add(camera)

    def next_best(self, most_cost: float = np.inf, *, by_cost: bool = False) -> int:
        """Candidate that adds most to the total, -1 where none adds anything."""
        nothing = np.zeros(len(self.merged.least), np.int64)
        return self._next(self.gain, nothing, NO_LIMIT, most_cost, by_cost)

    def next_needed(self) -> int:
        """Candidate that adds most for its cost to what is still required, -1 for none."""
        room = np.maximum(self.merged.least - self.done, 0) << FINE
        total = max(0, self.merged.least_total - self.covered) << FINE
        return self._next(self.gain, room, total, np.inf, True)

    def next_first_half(self, most_cost: float = np.inf) -> int:
        """Candidate that adds nothing yet, but may with another; -1 where none can.

        Where rays must differ, a face may need two more cameras that are near all it has, and far
        from one another: neither alone is a step. This is the candidate with the greatest weight of
        faces that wait, for its cost.
        """
        merged = self.merged
        if not merged.is_spread:
            return -1
        kind_waits = self.done < merged.least
        if self.covered < merged.least_total or not (merged.least_total or merged.least.any()):
            kind_waits[:] = True
        weight = np.empty((merged.n_candidates, 1), np.int64)
        is_open = ~self.covered_faces & kind_waits[merged.kind]
        kernels.open_weights(merged.indptr, merged.face, is_open, merged.quanta, weight)
        self.work += len(merged.face)
        return self._next(weight, np.zeros(1, np.int64), NO_LIMIT, most_cost, True)

    def _next(
        self, gain: IntArray, room: IntArray, total: int, most_cost: float, by_cost: bool
    ) -> int:
        self.work += gain.size
        merged = self.merged
        return int(
            kernels.next_camera(
                gain, room, total, merged.costs, merged.rank, self.barred, most_cost, by_cost
            )
        )

    def _change(self, camera: int, sign: int) -> None:
        merged = self.merged
        pairs = (merged.indptr, merged.face, merged.starts, merged.covering)
        state = (self.count, self.gain, self.done, self._total)
        if not merged.is_spread:
            self.work += kernels.change(camera, sign, *pairs, *self._values, *state)
            return
        if len(self.chosen) + 1 >= self._seen.shape[1]:
            self._seen = np.concatenate((self._seen, np.empty_like(self._seen)), axis=1)
        self.work += kernels.change_spread(
            camera, sign, *pairs, *self._values, *state, merged.eyes, merged.centroids,
            merged.min_cosine, self._seen, self._is_spread,
        )  # fmt: skip
