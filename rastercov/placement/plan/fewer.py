"""Bound of the exact area of few candidates, from their shares of patches.

A patch counts as covered where a camera covers half of it, so the fewest cameras on patches may be
more than the area needs. The area that some cameras cover is at most

    sum over patches of area * min(1, (sum of their shares of the patch) / views).

Branch and bound: each further candidate adds at most what it adds to fewer.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rastercov.base.memory import FloatArray, IntArray
from rastercov.coverage.area.cells import Cells
from rastercov.mesh.groups import rows_of
from rastercov.placement.matrix import VisibilityMatrix

MOST_VALUES = 20_000_000
"""Candidates times patches that are held as an array: 80 MB."""
MOST_WORK = 1_000_000_000
"""Values that are added up in one search: about 1 s."""
SLACK = 1e-6
"""Share of the area that rounding of the shares may hide."""


@dataclass(frozen=True, eq=False)
class Reach:
    """Upper bounds of the area of sets of C candidates on E patches.

    Attributes
    ----------
    shares : (C, E) float32
        Covered share of each patch over its views.
    weights : (L, E) float64
        Weight of each patch in each of L limits, with a sum of 1.
    least : (L,) float64
        Shares to reach.
    """

    shares: NDArray[np.float32]
    weights: FloatArray
    least: FloatArray

    @classmethod
    def of(
        cls,
        matrix: VisibilityMatrix,
        on: Cells,
        views: IntArray,
        limits: Mapping[str | None, float],
    ) -> "Reach | None":
        """Of the candidates of a matrix of patches; None where there are too many.

        `views` are those of each patch, and `limits` the shares to reach of groups, of all by None.
        """
        if matrix.n_poses * matrix.n_faces > MOST_VALUES:
            return None
        names = [group.name for group in on.mesh.groups]
        group = on.mesh.face_group[on.source_face]
        rows = [range(len(names)) if place is None else rows_of(names, place) for place in limits]
        weights = np.array([on.area * np.isin(group, own) for own in rows])
        weights /= np.maximum(weights.sum(axis=1, keepdims=True), np.finfo(float).tiny)
        shares = np.zeros((matrix.n_poses, matrix.n_faces), np.float32)
        first = 0
        for pairs in (each for part in matrix.parts for each in part.pairs()):
            row = first + np.repeat(np.arange(pairs.n_poses), pairs.counts)
            shares[row, pairs.face] = pairs.coverage
            first += pairs.n_poses
        shares /= views.astype(np.float32)[None]
        return cls(shares, weights, np.array([*limits.values()]))

    def sets(self, given: Sequence[int], count: int) -> list[tuple[int, ...]] | None:
        """Sets of `count` candidates beside `given` ones that may reach all shares, the best first.

        None where a search would take too long.
        """
        n, found, work = len(self.shares), list[tuple[float, tuple[int, ...]]](), 0

        def beyond(covered: NDArray[np.float32]) -> FloatArray:
            """Weight above what each limit asks for, (..., L)."""
            nonlocal work
            work += covered.size
            return np.asarray(np.minimum(covered, 1) @ self.weights.T - self.least + SLACK)

        def grow(chosen: tuple[int, ...], covered: NDArray[np.float32], own: FloatArray) -> None:
            left, first = count - len(chosen), chosen[-1] + 1 if chosen else 0
            if not left:
                found.append((float(own.min()), chosen))
            rows = np.setdiff1d(np.arange(first, n), given)
            if not left or not len(rows) or work > MOST_WORK:
                return
            with_one = beyond(covered + self.shares[rows])
            # All of the `left` further ones add no more than that many times the best gain of one.
            gains = np.maximum.accumulate((with_one - own)[::-1])[::-1]
            is_open = (with_one + (left - 1) * gains >= 0).all(axis=1)
            for row, value in zip(rows[is_open].tolist(), with_one[is_open], strict=True):
                grow((*chosen, row), covered + self.shares[row], value)

        start = self.shares[list(given)].sum(axis=0)
        own = beyond(start)
        if count or (own >= 0).all():
            grow((), start, own)
        if work > MOST_WORK:
            return None
        return [chosen for _, chosen in sorted(found, key=lambda each: (-each[0], each[1]))]
