"""Incremental state of a cover: chosen candidates, covered faces, the gain of each candidate.

`CoverState` knows the gains of all candidates of a problem in lists at any time. `LazyCover` serves
problems whose lists do not fit into the memory: it reads the bits, and computes gains only where
they may be the greatest. The gain of a candidate only falls while cameras are added, so an earlier
one is an upper limit of the present one. Candidates are computed again in the order of these
limits, until the best gain is above all limits that are left. The choice is that of `CoverState`,
ties included.

M. Minoux. Accelerated greedy algorithms for maximizing submodular set functions. 1978.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable

import numpy as np

from rastercov.base import BoolArray, FloatArray, IntArray, offsets_of, sort_order
from rastercov.engine import placement_selection as kernels
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
        Weight of the covered faces, by kind.
    barred : (C,) uint8
        1 for candidates that are chosen, or excluded for a while.
    """

    def __init__(self, among: Reduced) -> None:
        self.among, self.goal = among, among.problem.goal
        self.chosen: set[int] = set()
        self.done = np.zeros(len(among.least), np.int64)
        self.barred = np.zeros(among.n_candidates, np.uint8)
        self._any_room = np.zeros(len(among.least), np.int64)
        self._any_room[0] = NO_LIMIT

    @property
    def covered(self) -> int:
        """Weight of the covered faces."""
        return int(self.done.sum())

    @property
    def cost(self) -> float:
        """Cost of the chosen cameras."""
        return float(self.among.costs[self.rank()].sum())

    @property
    def lack(self) -> IntArray:
        """(G,) weight that each requirement of `FewestCameras` lacks, 0 where it holds."""
        done = (self.among.is_of * self.done).sum(axis=1)
        return np.maximum(self.among.least - done, 0)

    @property
    def is_met(self) -> bool:
        """True where the requirements of `FewestCameras` hold."""
        return not self.lack.any()

    def rank(self) -> list[int]:
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
        return self._next(self._any_room, most_cost, by_cost)

    def next_face(self) -> int:
        """Candidate with the greatest gain by cost towards the unmet requirements, -1 for none."""
        return self._next(self.lack << PROGRESS_BITS, np.inf, True)

    def next_first_half(self, most_cost: float = np.inf) -> int:
        """Candidate without a gain of its own that may have one with a second; -1 for none."""
        return -1

    @abstractmethod
    def _next(self, room: IntArray, most_cost: float, by_cost: bool) -> int:
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
        lists = (reduced.camera_indptr, reduced.face, *pairs)
        faces = (reduced.views, reduced.need, step, bonus, reduced.kind, integer_weights)
        self._rays = (reduced.eyes, reduced.centroids, float(reduced.problem.min_cosine))
        kernels.first_gains(lists, faces, self._rays, self.gain)
        self._records = (lists, faces, (self.count, self.gain, self.done, self._total))
        self._has_angle = reduced.is_spread
        self._seen = np.empty((reduced.n_faces if self._has_angle else 0, 8), np.int32)
        self._is_spread = np.zeros(reduced.n_faces if self._has_angle else 0, bool)
        self.work = len(reduced.face)

    @property
    def worth(self) -> int:
        """Worth of the progress of all faces."""
        return int(self._total[0])

    @property
    def covered_faces(self) -> BoolArray:
        """(F,) faces that are covered."""
        covered: BoolArray = self.count >= self.reduced.views
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
        lacks = self.lack > 0
        lacks[0] |= not reduced.least.any()
        kind_waits = np.any(reduced.is_of[lacks], axis=0)
        is_open = ~self.covered_faces & kind_waits[reduced.kind]
        of_pair = np.where(is_open, reduced.integer_weights, 0)[reduced.face]
        sums = offsets_of(of_pair)[reduced.indptr]
        weight = np.zeros_like(self.gain)
        weight[:, 0] = np.diff(sums)
        self.work += len(reduced.face)
        return self._best(weight, self._any_room, most_cost, True)

    def _next(self, room: IntArray, most_cost: float, by_cost: bool) -> int:
        return self._best(self.gain, room, most_cost, by_cost)

    def _best(self, gain: IntArray, room: IntArray, most_cost: float, by_cost: bool) -> int:
        self.work += gain.size
        reduced, costs = self.reduced, self.reduced.costs
        return kernels.next_camera(
            gain, reduced.ends, room, costs, reduced.rank, self.barred, most_cost, by_cost
        )

    def _change(self, camera: int, sign: int) -> None:
        """Add or remove the cameras of a candidate, one after the other."""
        limits = self.reduced.limits
        for row in range(limits[camera], limits[camera + 1]):
            if not self._has_angle:
                self.work += kernels.change(row, sign, *self._records)
                continue
            if self.count.max(initial=0) >= self._seen.shape[1]:
                self._seen = np.concatenate((self._seen, np.empty_like(self._seen)), axis=1)
            seen = (self._seen, self._is_spread)
            self.work += kernels.change_spread(row, sign, *self._records, self._rays, seen)


class LazyCover(Cover):
    """Cover of a `Presolved` problem whose candidates are single cameras.

    Attributes
    ----------
    count : (F,) int64
        Cameras that cover each face.
    first : (C, G) int64
        Gains of each candidate before any camera.
    limit : (C, G) int64
        Upper limits of the gains.
    """

    def __init__(self, large: Presolved) -> None:
        super().__init__(large)
        self.large, views = large, large.problem.views
        self._step, self._bonus = worth_of_progress(large.integer_weights, views)
        self.count = np.zeros(len(views), np.int64)
        self.first = self._gains(np.arange(large.n_candidates))
        # The last of several steps may be worth a few units of rounding more than those before.
        rounding = np.where(views > 1, self._bonus, 0)
        self._slack = np.array([rounding[large.kind == k].sum() for k in range(len(large.least))])
        self.limit = self.first + self._slack

    def _gains(self, rows: IntArray) -> IntArray:
        """(N, G) gains of some candidates."""
        missing = self.large.problem.views - self.count
        now = self._step + np.where(missing == 1, self._bonus, 0)
        return self.large.sums(now, missing > 0, rows)

    def _next(self, room: IntArray, most_cost: float, by_cost: bool) -> int:
        costs, rank, ends = self.large.costs, self.large.rank, self.large.ends

        def scores(gains: IntArray, rows: IntArray | slice) -> FloatArray:
            result = np.empty(len(gains))
            kernels.scores(
                gains, ends, room, costs[rows], self.barred[rows], most_cost, by_cost, result
            )
            return result

        most = scores(self.limit, slice(None))
        order = sort_order(-most)[: np.count_nonzero(most)]
        best, best_score, at = -1, 0.0, 0
        while at < len(order) and most[order[at]] >= best_score:
            n = max(FEWEST_AT_ONCE, int(SHARE_AT_ONCE * at))
            rows = np.sort(order[at : at + n])
            gains = self._gains(rows)
            self.limit[rows] = gains + self._slack
            for row, score in zip(rows.tolist(), scores(gains, rows).tolist(), strict=True):
                is_tie = score == best_score and best >= 0 and rank[row] < rank[best]
                if score > best_score or is_tie:
                    best, best_score = row, score
            at += n
        return best

    def _change(self, camera: int, sign: int) -> None:
        faces = self.large.bits.faces_of(int(self.large.candidates[camera]))
        self.count[faces] += sign
        missing = self.large.problem.views[faces] - self.count[faces]
        moved = faces[missing == (0 if sign > 0 else 1)]
        weights, kind = self.large.integer_weights[moved], self.large.kind[moved]
        self.done += sign * np.bincount(kind, weights, len(self.done)).astype(np.int64)
        if sign < 0:  # gains rise: only the first ones are limits again
            self.limit = self.first + self._slack
