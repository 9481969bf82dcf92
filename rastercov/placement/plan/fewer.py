"""Sets of few candidates that may reach the goal of a plan, by a bound of their exact area.

A patch counts as covered where a camera covers half of it, so the fewest cameras on patches may be
more than the area needs. The area that some cameras cover is at most

    sum over patches of area * min(1, (sum of their shares of the patch) / views).

Branch and bound: each further candidate adds at most what it adds to fewer.
"""

import numpy as np

from rastercov.base import Float32Array, FloatArray, matmul, owners_of
from rastercov.placement.plan.network import limits_of
from rastercov.placement.plan.prepare import Prepared

MOST_WORK = 200_000_000
"""Values that are added up in one search: about 1 s on an idle core."""
SLACK = 1e-6
"""Share of the area that rounding of the shares may hide."""


def sets_in_reach(prepared: Prepared, count: int) -> list[tuple[int, ...]] | None:
    """Sets of `count` candidates that may reach the goal with the cameras that stay.

    Those with the greatest bounds come first; None where a search would take too long.
    """
    on, matrix = prepared.cells, prepared.matrix
    assert on is not None
    assert matrix is not None
    shares = np.zeros((matrix.n_poses, len(on)), np.float32)
    row = owners_of(matrix.pairs.counts)
    shares[row, matrix.face] = matrix.coverage
    shares /= prepared.problem.views.astype(np.float32)[None]
    n_given = prepared.plan.n_given
    least = (limits_of(prepared.selection)[None] - SLACK) * on.area.sum()
    result, work = list[tuple[float, tuple[int, ...]]](), 0

    def beyond(covered: Float32Array) -> FloatArray:
        """Area beyond the goal, m^2."""
        nonlocal work
        work += covered.size
        return matmul(np.minimum(covered, 1), on.area) - least

    def grow(chosen: tuple[int, ...], covered: Float32Array, own: float) -> None:
        left, first = count - len(chosen), chosen[-1] + 1 if chosen else n_given
        if not left and own >= 0:
            result.append((own, chosen))
        if not left or first == len(shares) or work > MOST_WORK:
            return
        with_one = beyond(covered + shares[first:])
        # All of the `left` further ones add no more than that many times the best gain of one.
        gains = np.maximum.accumulate((with_one - own)[::-1])[::-1]
        for at in np.flatnonzero(with_one + (left - 1) * gains >= 0).tolist():
            grow((*chosen, first + at), covered + shares[first + at], float(with_one[at]))

    start = shares[:n_given].sum(axis=0)
    grow((), start, float(beyond(start)))
    return None if work > MOST_WORK else [chosen for _, chosen in sorted(result, reverse=True)]
