"""Incremental state of a cover: chosen cameras, covered faces, the gain of each candidate."""

from abc import ABC, abstractmethod
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from rastercov.kernels import placement_rigs
from rastercov.kernels import placement_selection as kernels
from rastercov.placement._arrays import IntArray
from rastercov.placement.select.presolve import Candidates, ReducedProblem

PROGRESS_BITS = 20
"""Fractional bits below the unit of weight, for progress that does not yet cover a face."""
NO_LIMIT = np.iinfo(np.int64).max


def worth_of_progress(
    integer_weights: IntArray, need: IntArray, finish: bool = False
) -> tuple[IntArray, IntArray]:
    """Worth of each step towards covering a face, (F,), and what the last step is worth more.

    A step is worth an equal part of the weight; with `finish` nearly nothing before the last step,
    so that faces are finished. Equal where one view is enough.
    """
    worth: IntArray = integer_weights << PROGRESS_BITS
    part = worth
    if finish:
        share = integer_weights / max(1, int(integer_weights.sum()))
        part = (share * (1 << PROGRESS_BITS)).astype(np.int64)
    step: IntArray = np.where(need > 1, part // need, 0)
    return step, worth if finish else worth - step * need


class Cover(ABC):
    """Cameras chosen so far, by their row in a problem after presolve, and the greedy rule.

    Attributes
    ----------
    chosen : set of int
    done : (G,) int64
        Weight of the covered faces, by requirement.
    barred : (C,) uint8
        1 for candidates that are chosen, or excluded for a while.
    """

    def __init__(self, among: Candidates) -> None:
        self.among = among
        self.chosen: set[int] = set()
        self.done = np.zeros(len(among.least), np.int64)
        self.barred = np.zeros(among.n_candidates, np.uint8)

    @property
    def covered(self) -> int:
        """Weight of the covered faces."""
        return int(self.done.sum())

    @property
    def cost(self) -> float:
        """Cost of the chosen cameras."""
        return float(self.among.costs[self.ranked()].sum())

    @property
    def is_met(self) -> bool:
        """True where the requirements of `FewestCameras` hold."""
        return bool((self.done >= self.among.least).all()) and (
            self.covered >= self.among.least_total
        )

    def ranked(self) -> list[int]:
        """Chosen cameras in an order that does not depend on their numbers."""
        return sorted(self.chosen, key=lambda camera: int(self.among.rank[camera]))

    def add(self, camera: int) -> None:
        """Add a camera."""
        self._change(camera, 1)
        self.chosen.add(camera)
        self.barred[camera] = 1

    def remove(self, camera: int) -> None:
        """Remove a chosen camera."""
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
        """Candidate with the greatest gain, -1 where no gain is positive."""
        nothing = np.zeros(len(self.among.least), np.int64)
        return self._next(nothing, NO_LIMIT, most_cost, by_cost)

    def next_needed(self) -> int:
        """Candidate with the greatest gain by cost towards the unmet requirements, -1 for none."""
        room = np.maximum(self.among.least - self.done, 0) << PROGRESS_BITS
        total = max(0, self.among.least_total - self.covered) << PROGRESS_BITS
        return self._next(room, total, np.inf, True)

    def next_first_half(self, most_cost: float = np.inf) -> int:
        """Candidate without a gain of its own that may have one with a second; -1 for none."""
        return -1

    @abstractmethod
    def _next(self, room: IntArray, total: int, most_cost: float, by_cost: bool) -> int:
        """Candidate of `kernels.next_camera`."""

    @abstractmethod
    def _change(self, camera: int, sign: int) -> None:
        """Add (sign 1) or remove (-1) the faces of a camera."""


class CoverState(Cover):
    """Cover of a `ReducedProblem` that knows the gains of all its candidates at any time.

    Parameters
    ----------
    finish : bool
        As for `worth_of_progress`.

    Attributes
    ----------
    worth : int
        Total over the progress of all faces.
    work : int
        Elementary updates so far.
    """

    def __init__(self, reduced: ReducedProblem, *, finish: bool = False) -> None:
        super().__init__(reduced)
        self.reduced = reduced
        integer_weights, need = reduced.integer_weights, reduced.need.astype(np.int64)
        step, bonus = worth_of_progress(integer_weights, need, finish)
        n_kinds = len(reduced.least)
        self.count = np.zeros(reduced.n_faces, np.int32)
        self.gain = np.zeros((reduced.n_candidates, n_kinds), np.int64)
        self._total = np.zeros(1, np.int64)
        pairs = (reduced.indptr, reduced.face, reduced.starts, reduced.covering)
        values = (reduced.views, reduced.need, step, bonus, reduced.kind, integer_weights)
        self._arguments = (*pairs, *values, self.count, self.gain, self.done, self._total)
        self._seen = np.empty((reduced.n_faces if reduced.is_spread else 0, 8), np.int32)
        self._is_spread = np.zeros(reduced.n_faces if reduced.is_spread else 0, np.bool_)
        if reduced.has_rigs:
            placement_rigs.first_gains(
                reduced.indptr, reduced.face, reduced.eye, reduced.views, reduced.need, step, bonus,
                reduced.kind, reduced.eyes, reduced.centroids, reduced.min_cosine, self.gain,
            )  # fmt: skip
            self._far = np.zeros(reduced.n_candidates, np.bool_)
        else:
            kernels.first_gains(
                reduced.indptr, reduced.face, reduced.need, step, bonus, reduced.kind, self.gain
            )
        self.work = len(reduced.face)

    @property
    def worth(self) -> int:
        """Worth of the progress of all faces."""
        return int(self._total[0])

    @property
    def covered_faces(self) -> NDArray[np.bool_]:
        """(F,) faces that are covered."""
        covered: NDArray[np.bool_] = self.count >= self.reduced.views
        return covered & self._is_spread if self.reduced.is_spread else covered

    def next_first_half(self, most_cost: float = np.inf) -> int:
        """Candidate without a gain of its own that may have one with a second; -1 for none.

        Where rays must differ, a face may need two more cameras that are each close to all its
        present ones and far from one another: neither alone is a step. Returns the candidate with
        the greatest weight of uncovered faces by cost.
        """
        reduced = self.reduced
        if not reduced.is_spread:
            return -1
        kind_waits = self.done < reduced.least
        if self.covered < reduced.least_total or not (reduced.least_total or reduced.least.any()):
            kind_waits[:] = True
        weight = np.empty((reduced.n_candidates, 1), np.int64)
        is_open = ~self.covered_faces & kind_waits[reduced.kind]
        kernels.open_weights(reduced.indptr, reduced.face, is_open, reduced.integer_weights, weight)
        self.work += len(reduced.face)
        return self._best(weight, np.zeros(1, np.int64), NO_LIMIT, most_cost, True)

    def _next(self, room: IntArray, total: int, most_cost: float, by_cost: bool) -> int:
        return self._best(self.gain, room, total, most_cost, by_cost)

    def _best(
        self, gain: IntArray, room: IntArray, total: int, most_cost: float, by_cost: bool
    ) -> int:
        self.work += gain.size
        reduced = self.reduced
        return int(
            kernels.next_camera(
                gain, room, total, reduced.costs, reduced.rank, self.barred, most_cost, by_cost
            )
        )

    def _change(self, camera: int, sign: int) -> None:
        reduced = self.reduced
        if not reduced.is_spread:
            change = placement_rigs.change if reduced.has_rigs else kernels.change
            self.work += change(camera, sign, *self._arguments)
            return
        if reduced.has_rigs:
            self._change_rig(camera, sign)
            return
        if len(self.chosen) + 1 >= self._seen.shape[1]:
            self._seen = np.concatenate((self._seen, np.empty_like(self._seen)), axis=1)
        self.work += kernels.change_spread(
            camera, sign, *self._arguments, reduced.eyes, reduced.centroids, reduced.min_cosine,
            self._seen, self._is_spread,
        )  # fmt: skip

    def _change_rig(self, camera: int, sign: int) -> None:
        """Add or remove a rig, where rays must differ."""
        reduced = self.reduced
        pairs = slice(reduced.indptr[camera], reduced.indptr[camera + 1])
        most = np.bincount(reduced.face[pairs]).max(initial=0) + self.count.max(initial=0)
        if most > self._seen.shape[1]:
            more = np.empty((len(self._seen), 2 * int(most) - self._seen.shape[1]), np.int32)
            self._seen = np.concatenate((self._seen, more), axis=1)
        self.work += placement_rigs.change_spread(
            camera, sign, *self._arguments, reduced.eyes, reduced.centroids, reduced.min_cosine,
            self._seen, self._is_spread, reduced.eye, reduced.covering_eye, self._far,
        )  # fmt: skip
