"""Greedy selection on bits: the rule, the improvement and the bound of `select_greedy`.

The rule evaluates gains lazily (`lazy_cover`); swaps, removal and repair work on the core, the best
candidates that fit into the memory (`pricing`); the bound is that of all candidates. Where all
candidates fit, the selection is that of `select_greedy`.
"""

import numpy as np

from rastercov.base.arguments import check_seed
from rastercov.base.errors import ConfigError
from rastercov.base.typed import typed
from rastercov.kernels.stopwatch import Stopwatch
from rastercov.placement.select.bit_problem import BitProblem, presolve_bits
from rastercov.placement.select.cover_state import CoverState
from rastercov.placement.select.greedy import EFFORT, constructed, improve
from rastercov.placement.select.lazy_cover import LazyCover
from rastercov.placement.select.pricing import MOST_CORE_PAIRS, core_and_bound
from rastercov.placement.select.selection import Selection, finish


@typed
def select_lazy(
    problem: BitProblem,
    *,
    effort: int = EFFORT,
    seed: int = 0,
    core_pairs: int = MOST_CORE_PAIRS,
) -> Selection:
    """Good selection from more pairs than fit into the memory, with a bound as `select_greedy`.

    Parameters
    ----------
    effort, seed : int
        As for `select_greedy`.
    core_pairs : int
        Pairs of the candidates among which the local search works; about 16 bytes each.
    """
    check_seed(seed)
    if core_pairs < 0:
        raise ConfigError(f"core_pairs must be 0 or more, got {core_pairs}")
    clock = Stopwatch()
    large = presolve_bits(problem)
    state = constructed(lambda: LazyCover(large), problem.goal)
    core, rows, bound = core_and_bound(large, state, core_pairs)
    better = CoverState(core)
    better.become(np.flatnonzero(np.isin(rows, list(state.chosen))).tolist())
    if effort > 0:
        better = improve(core, better, bound, effort, seed)
    chosen = core.candidates[better.ranked()]
    return finish("greedy", core, chosen, bound, clock.seconds)
