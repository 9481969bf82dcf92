"""Incremental state of a cover: chosen candidates, covered faces, the gain of each candidate.

`CoverState` knows the gains of all candidates of a problem in lists at any time. `LazyCover` serves
problems whose lists do not fit into the memory: it reads the bits, and computes gains only where
they may be the greatest. The gain of a candidate only falls while cameras are added, so an earlier
one is an upper limit of the present one. Candidates are computed again in the order of these
limits, until the best gain is above all limits that are left. Only words with faces that were
covered since the last time are read: a few hundredths of a pass over the bits for each camera. The
choice is that of `CoverState`, ties included.

M. Minoux. Accelerated greedy algorithms for maximizing submodular set functions. 1978.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from rastercov.base.memory import IntArray
from rastercov.kernels import placement_bits
from rastercov.kernels import placement_selection as kernels
from rastercov.placement.bits import Words, spread_out
from rastercov.placement.select.presolve import Presolved, Reduced, ReducedProblem
from rastercov.placement.select.problem import PROGRESS_BITS

NO_LIMIT = np.iinfo(np.int64).max
FEWEST_AT_ONCE = 16
"""Candidates that `LazyCover` computes at once; more where many were already, for threads."""
SHARE_AT_ONCE = 0.25
"""Further candidates at once, as a share of those computed for this camera."""


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
    """Candidates chosen so far, by their row in a problem after presolve, and the greedy rule.

    Attributes
    ----------
    chosen : set of int
    done : (G,) int64
        Weight of the covered faces, by requirement.
    barred : (C,) uint8
        1 for candidates that are chosen, or excluded for a while.
    """

    def __init__(self, among: Reduced) -> None:
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
        self.count = np.zeros(reduced.n_faces, np.int32)
        self.gain = np.zeros((reduced.n_candidates, len(reduced.least)), np.int64)
        self._total = np.zeros(1, np.int64)
        pairs = (reduced.starts, reduced.covering, reduced.owner)
        values = (reduced.views, reduced.need, step, bonus, reduced.kind)
        self._directions = (reduced.eyes, reduced.centroids, reduced.problem.min_cosine)
        kernels.first_gains(*pairs, *values, *self._directions, self.gain)
        state = (self.count, self.gain, self.done, self._total)
        rows = (reduced.camera_indptr, reduced.face)
        self._arguments = (*rows, *pairs, *values, integer_weights, *state)
        self._seen = np.empty((reduced.n_faces if reduced.is_spread else 0, 8), np.int32)
        self._is_spread = np.zeros(reduced.n_faces if reduced.is_spread else 0, np.bool_)
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
        kernels.open_weights(
            reduced.camera_indptr, reduced.face, reduced.owner, is_open, reduced.integer_weights,
            weight,
        )  # fmt: skip
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
        """Add or remove the cameras of a candidate, one after the other."""
        limits = self.reduced.limits
        for row in range(limits[camera], limits[camera + 1]):
            if not self.reduced.is_spread:
                self.work += kernels.change(row, sign, *self._arguments)
                continue
            if self.count.max(initial=0) >= self._seen.shape[1]:
                self._seen = np.concatenate((self._seen, np.empty_like(self._seen)), axis=1)
            self.work += kernels.change_spread(
                row, sign, *self._arguments, *self._directions, self._seen, self._is_spread
            )


class LazyCover(Cover):
    """Cover of a `Presolved` problem whose candidates are single cameras.

    Where several views are needed, the last step towards a face may be worth a few units of
    rounding more than the ones before it, so limits count every step with its bonus.

    Attributes
    ----------
    count : (64 W,) int32
        Cameras that cover each face.
    first : (C, G) int64
        Gains of each candidate before any camera, or upper limits of them.
    limit : (C, G) int64
        Upper limits of the gains.
    words_read : int
        Words of the bits that were read to compute gains.
    """

    def __init__(self, large: Presolved) -> None:
        super().__init__(large)
        self.large = large
        views = large.problem.views
        step, bonus = worth_of_progress(large.integer_weights, views)
        self._need = spread_out(views, np.int32)
        self._kind = spread_out(large.kind, np.int32)
        self._weights = spread_out(large.integer_weights)
        self._step, self._bonus = spread_out(step), spread_out(bonus)
        self._most = self._step + self._bonus
        """Upper limit of what one more camera is worth at a face."""
        self._now = np.where(self._need == 1, self._most, self._step)
        self._is_exact = bool((self._need[large.kept] == 1).all())
        """True where upper limits are gains."""
        self._masks = large.masks.copy()
        """Faces of each kind that are not covered."""
        self._remaining = np.bitwise_or.reduce(large.masks, axis=0)
        self.count = np.zeros(len(self._need), np.int32)
        self.words_read = 0
        self.first = self._sums(self._most, np.arange(large.n_candidates))
        self.limit = self.first.copy()
        self._known = [self._masks.copy()]
        """Faces of each kind that were not covered, after each change."""
        self._since = np.zeros(large.n_candidates, np.int64)
        """Change after which the limit of each candidate was computed."""
        self._closed: dict[int, tuple[IntArray, Words]] = {}
        """Words with faces that were covered since a change, and these faces by kind."""

    @property
    def passes(self) -> float:
        """Words that were read, in passes over the bits of all candidates."""
        n_words = self.large.n_candidates * self.large.bits.n_words
        return self.words_read / max(1, n_words)

    def _sums(self, values: IntArray, rows: IntArray) -> IntArray:
        """(N, G) sums over the faces of some candidates that are not covered."""
        self.words_read += len(rows) * self.large.bits.n_words
        return self.large.sums(np.stack([values] * len(self._masks)), self._masks, rows)

    def _lower(self, rows: IntArray) -> None:
        """Lower the limits of some candidates to the present state."""
        now = len(self._known) - 1
        rows = rows[self._since[rows] < now]
        if not len(rows):
            return
        changes, which = np.unique(self._since[rows], return_inverse=True)
        for change in changes.tolist():
            if change not in self._closed:
                closed = self._known[change] & ~self._masks
                index = np.flatnonzero(closed.any(axis=0))
                self._closed[change] = index, np.ascontiguousarray(closed[:, index].T)
        sets = [self._closed[change] for change in changes.tolist()]
        self.words_read += int(np.array([len(index) for index, _ in sets])[which].sum())
        bits, candidates = self.large.bits, self.large.candidates[rows]
        self.limit[rows] -= bits.sums_of_words(self._most, candidates, which, sets)
        self._since[rows] = now

    def _next(self, room: IntArray, total: int, most_cost: float, by_cost: bool) -> int:
        costs, rank = self.large.costs, self.large.rank

        def scores(gains: IntArray, rows: IntArray | slice) -> IntArray:
            found: IntArray = kernels.scores(
                gains, room, total, costs[rows], self.barred[rows], most_cost, by_cost
            )
            return found

        most = scores(self.limit, slice(None))
        left = np.flatnonzero(most > 0)
        best, best_score, n_done = -1, 0.0, 0
        while len(left):
            n = max(FEWEST_AT_ONCE, int(SHARE_AT_ONCE * n_done))
            part = left
            if len(left) > n:
                order = np.argpartition(-most[left], n)
                part, left = left[order[:n]], left[order[n:]]
            else:
                left = left[:0]
            rows = np.sort(part)
            self._lower(rows)
            found = scores(self.limit[rows], rows)
            if not self._is_exact:
                rows = rows[found >= best_score]
                found = scores(self._sums(self._now, rows), rows)
            for row in np.flatnonzero(found >= max(found.max(initial=0.0), best_score)):
                candidate, score = int(rows[row]), float(found[row])
                if score > best_score or (best >= 0 and rank[candidate] < rank[best]):
                    best, best_score = candidate, score
            n_done += n
            left = left[most[left] >= max(best_score, np.nextafter(0.0, 1.0))]
        return best

    def _change(self, camera: int, sign: int) -> None:
        row = self.large.bits.row(int(self.large.candidates[camera]))
        moved = np.empty(int(self.large.sizes[camera]), np.int64)
        n_moved = placement_bits.change(
            row, sign, self._remaining, self._need, self._weights, self._kind, self.count,
            self.done, moved,
        )  # fmt: skip
        faces = moved[:n_moved]
        missing = self._need[faces] - self.count[faces]
        self._now[faces] = self._step[faces] + np.where(missing == 1, self._bonus[faces], 0)
        placement_bits.take_out(faces[missing <= 0], self._masks)
        self._closed.clear()
        if sign > 0:
            self._known.append(self._masks.copy())
            return
        placement_bits.put_in(faces[missing > 0], self._kind, self._masks)
        # Gains rise: only the first ones are limits again.
        self.limit = self.first.copy()
        self._known = [self._known[0], self._masks.copy()]
        self._since[:] = 0
