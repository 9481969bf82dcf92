"""Search for fewer cameras of equal cost that cover every face, by weights of faces.

Loops and rules are in `engine/placement/weighting.cpp`.

C. Gao, X. Yao, T. Weise, J. Li. An efficient local search heuristic with row weighting for the
unicost set covering problem. 2015.
"""

import math
from collections.abc import Iterator

import numpy as np

from rastercov.engine import placement_weighting as kernels
from rastercov.placement.select.bounds import Deadline
from rastercov.placement.select.cover import CoverState
from rastercov.placement.select.problem import PROVED, BestCoverage

STEPS_AT_ONCE = 1000
"""Steps between two checks of the clock: 20 ms."""


def is_for(state: CoverState) -> bool:
    """True for a cover of all faces that counts single cameras, each at the same cost."""
    reduced = state.reduced
    if isinstance(state.goal, BestCoverage) or not state.chosen:
        return False
    if reduced.is_spread or reduced.problem.has_rigs or np.ptp(reduced.costs) > 0:
        return False
    return bool((state.count >= reduced.views)[reduced.integer_weights > 0].all()) and (
        max(reduced.least_total, int(reduced.least.sum())) >= int(reduced.integer_weights.sum())
    )


def fewer(
    state: CoverState, bound: float, steps: int, effort: int, seed: int, deadline: Deadline
) -> Iterator[set[int]]:
    """Covers of a search, each of fewer cameras than the one before.

    Parameters
    ----------
    state : CoverState
        Of a problem that `is_for` accepts.
    bound : float
        Least cost that any cover has; the search ends there.
    steps, effort : int
        Most steps and elementary updates.
    """
    reduced, rng = state.reduced, np.random.default_rng(seed)
    views = np.where(reduced.integer_weights > 0, reduced.views, 0).astype(np.int32)
    lists = (reduced.camera_indptr, reduced.face, reduced.starts, reduced.covering, views)
    is_chosen = np.zeros(reduced.n_candidates, np.uint8)
    is_chosen[list(state.chosen)] = 1
    changed, best = np.zeros(len(is_chosen), np.int64), is_chosen.copy()
    weight, last = np.ones(len(views), np.int64), np.array([0, -1])
    sought = (is_chosen, weight, changed, np.zeros_like(is_chosen), last)
    enough = math.ceil(bound * (1 - PROVED) / max(float(reduced.costs[0]), 1e-300))
    n_best, work = len(state.chosen), 0
    while n_best > enough and last[0] < steps and work < effort:
        deadline.check()
        n = min(STEPS_AT_ONCE, steps - int(last[0]))
        numbers = rng.integers(0, 1 << 32, n, np.uint32)
        work += kernels.fewer_cameras(lists, reduced.rank, numbers, enough, sought, best)
        if best.sum() < n_best:
            n_best = int(best.sum())
            yield set(np.flatnonzero(best).tolist())
