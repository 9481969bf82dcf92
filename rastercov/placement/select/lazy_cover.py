"""Cover of a problem on bits, whose gains are computed only where they may be the greatest.

The gain of a candidate only falls while cameras are added, so an earlier one is an upper limit of
the present one. Candidates are computed again in the order of these limits, until the best gain is
above all limits that are left. Only words with faces that were covered since the last time are
read: a few hundredths of a pass over the bits for each camera. The choice is that of `CoverState`,
ties included.

M. Minoux. Accelerated greedy algorithms for maximizing submodular set functions. 1978.
"""

import numpy as np

from rastercov.kernels import placement_bits
from rastercov.kernels import placement_selection as kernels
from rastercov.placement._arrays import IntArray
from rastercov.placement.bits import Words, spread_out
from rastercov.placement.select.bit_problem import LargeProblem
from rastercov.placement.select.cover_state import Cover, worth_of_progress

FEWEST_AT_ONCE = 16
"""Candidates that are computed at once; more where many were already, for threads."""
SHARE_AT_ONCE = 0.25
"""Further candidates at once, as a share of those computed for this camera."""


class LazyCover(Cover):
    """Cover of a `LargeProblem`.

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

    def __init__(self, large: LargeProblem) -> None:
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
        n_words = self.large.n_candidates * self.large.problem.bits.n_words
        return self.words_read / max(1, n_words)

    def _sums(self, values: IntArray, rows: IntArray) -> IntArray:
        """(N, G) sums over the faces of some candidates that are not covered."""
        self.words_read += len(rows) * self.large.problem.bits.n_words
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
        bits, candidates = self.large.problem.bits, self.large.candidates[rows]
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
        row = self.large.problem.bits.row(int(self.large.candidates[camera]))
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
