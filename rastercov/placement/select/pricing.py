"""Bound of a problem on bits, and its core: the best candidates, as many as fit into the memory.

Any prices of the faces prove a bound (`lagrange`), and one pass over all candidates computes it.
Good prices come from a search on the core alone. Candidates that would earn more than those of the
core then enter it, and the search continues from there, until the bound over all candidates is that
of the core or no longer better.

Prices are rounded down to multiples of a power of 2, so that what each candidate earns is a sum of
integers, equal in any order.

A. Caprara, M. Fischetti, P. Toth. A heuristic method for the set covering problem. 1999.
"""

import math
from dataclasses import dataclass

import numpy as np

from rastercov.placement import bit_kernels
from rastercov.placement._arrays import BoolArray, FloatArray, IntArray
from rastercov.placement.bits import spread_out
from rastercov.placement.select import lagrange, lagrange_kernels
from rastercov.placement.select.bit_problem import LargeProblem
from rastercov.placement.select.lazy_cover import LazyCover
from rastercov.placement.select.presolve import ReducedProblem
from rastercov.placement.select.problem import BestCoverage
from rastercov.placement.select.selection import bound_of, share_of

MOST_CORE_PAIRS = 20_000_000
"""Pairs of the core: about 16 bytes each."""
MOST_ROUNDS = 6
"""Searches for prices, each with one pass over all candidates."""
NEAR_REL = 1e-3
"""Relative distance of the bound from that of the core at which no round follows."""
PRICE_BITS = 61
"""Bits of the sum of all rounded prices."""


@dataclass(frozen=True, eq=False)
class Priced:
    """What some prices prove for all candidates.

    Attributes
    ----------
    value : float
        Upper bound as a share of the weight, or lower bound of the cost, as in `lagrange`.
    prices : (K,) float64
        Of the remaining faces.
    profit : (C,) float64
        Value of each candidate at these prices, by which the core is chosen.
    """

    value: float
    prices: FloatArray
    profit: FloatArray


def core_and_bound(
    large: LargeProblem, state: LazyCover, most_pairs: int = MOST_CORE_PAIRS
) -> tuple[ReducedProblem, IntArray, float]:
    """Core of a problem, its rows in `large`, (N,), and the bound of all candidates.

    Where all candidates fit, the bound is that of `bound_of`.

    Parameters
    ----------
    state : LazyCover
        A selection that meets the goal; its cameras are in the core.
    most_pairs : int
        Pairs of the core; those that cover each face are in it beyond that.
    """
    is_best_coverage = isinstance(large.problem.goal, BestCoverage)
    first = state.first.sum(axis=1).astype(np.float64)
    profit = first if is_best_coverage else first / np.maximum(large.costs, 1e-12)
    best: Priced | None = None
    for _ in range(MOST_ROUNDS):
        rows = core_rows(large, state, profit if best is None else best.profit, most_pairs)
        core = large.reduced(rows)
        if len(rows) == large.n_candidates or not _asks_for_any(core):
            return core, rows, bound_of(core, state)
        of_core, prices = _prices(core, state, None if best is None else best.prices)
        found = _priced(large, prices)
        sign = -1.0 if is_best_coverage else 1.0
        gained = math.inf if best is None else sign * (found.value - best.value)
        if gained > 0:
            best = found
        near = NEAR_REL * abs(of_core)
        assert best is not None
        if gained < near or abs(best.value - of_core) <= near:
            break
    assert best is not None
    rows = core_rows(large, state, best.profit, most_pairs)
    core = large.reduced(rows)
    if is_best_coverage:
        weight = lagrange.weight_below(best.value, int(core.integer_weights.sum()))
        return core, rows, share_of(large.problem, weight)
    return core, rows, lagrange.cost_above(best.value, large.costs)


def _asks_for_any(core: ReducedProblem) -> bool:
    """True where the goal asks for any weight."""
    if isinstance(core.problem.goal, BestCoverage):
        return bool(core.integer_weights.any()) and lagrange.limits_of(core)[0] > 0
    return lagrange.asks_for_any(core)


def _prices(
    core: ReducedProblem, state: LazyCover, start: FloatArray | None
) -> tuple[float, FloatArray]:
    """Bound of the core, and its best prices."""
    if isinstance(core.problem.goal, BestCoverage):
        return lagrange.weight_prices(core, state.covered, prices=start)
    return lagrange.cost_prices(core, state.cost, prices=start)


def _priced(large: LargeProblem, prices: FloatArray) -> Priced:
    """Bound over all candidates; one pass.

    `prices` are those of the remaining faces, (K,).
    """
    problem, kept = large.problem, large.kept
    unit = 2.0 ** (PRICE_BITS - math.ceil(math.log2(float(prices.sum()) + 1.0)))
    rounded = np.floor(prices * unit).astype(np.int64)
    prices = rounded / unit
    values = np.zeros(problem.n_faces, np.int64)
    values[kept] = rounded
    mask = np.bitwise_or.reduce(large.masks, axis=0)
    earned = large.sums(spread_out(values)[None], mask[None])[:, 0] / unit
    views = problem.views[kept].astype(np.float64)
    integer_weights = large.integer_weights[kept]
    if isinstance(problem.goal, BestCoverage):
        cameras, budget = lagrange.limits_of(large)
        amounts = np.empty(len(earned))
        income = lagrange_kernels.most_earned(earned, large.costs, cameras, budget, amounts)
        weights = integer_weights / int(integer_weights.sum())
        value = income + float(np.maximum(weights - views * prices, 0.0).sum())
        return Priced(value, prices, earned if budget == math.inf else _by_cost(large, earned))
    share = np.ones(len(kept))
    whole = int(integer_weights.sum())
    if large.least_total < whole:
        weights, least = integer_weights.astype(np.float64), large.least.astype(np.float64)
        kind = large.kind[kept]
        price = views * prices / weights
        lagrange_kernels.cheapest(price, weights, kind, least, float(large.least_total), share)
    value = float(np.minimum(large.costs - earned, 0.0).sum() + (views * prices * share).sum())
    return Priced(value, prices, _by_cost(large, earned))


def _by_cost(large: LargeProblem, earned: FloatArray) -> FloatArray:
    return earned / np.maximum(large.costs, 1e-12)


def core_rows(
    large: LargeProblem, state: LazyCover, profit: FloatArray, most_pairs: int
) -> IntArray:
    """(N,) rows of the core, ascending.

    These are the chosen cameras, then candidates that together cover each face as often as it
    needs, then those of the greatest profit; ties by rank.
    """
    if int(large.sizes.sum()) <= most_pairs:
        return np.arange(large.n_candidates)
    order = np.lexsort((large.rank, -profit))
    is_chosen = np.zeros(large.n_candidates, np.bool_)
    is_chosen[list(state.chosen)] = True
    order = np.concatenate((order[is_chosen[order]], order[~is_chosen[order]]))
    is_needed = _complete(large, order) | is_chosen[order]
    left = most_pairs - int(large.sizes[order[is_needed]].sum())
    fits = np.cumsum(np.where(is_needed, 0, large.sizes[order])) <= left
    return np.sort(order[is_needed | fits])


def _complete(large: LargeProblem, order: IntArray) -> BoolArray:
    """(N,) candidates in an order that cover a face with fewer before them than it needs."""
    is_needed = np.zeros(len(order), np.bool_)
    views = spread_out(large.problem.views, np.int32)
    lacking = np.bitwise_or.reduce(large.masks, axis=0)
    count = np.zeros_like(views)
    for words, rows, at in large.problem.bits.runs(large.candidates[order]):
        bit_kernels.complete_cover(words, rows, lacking, count, views, is_needed[at])
        if not lacking.any():
            break
    return is_needed
