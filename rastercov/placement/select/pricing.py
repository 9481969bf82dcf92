"""Bound of a problem on bits, and its core: the best candidates, as many as fit into the memory.

Any prices of the faces prove a bound (`lagrange`), and one pass over all candidates computes it.
A search on the core alone gives the prices. What candidates earn is linear in the prices, so the
best prices between those of two passes need no further one: they are never worse than the ones
before. By them the next core is chosen, until nothing is gained.

Prices are rounded down to multiples of a power of 2, so that what each candidate earns is a sum of
integers, equal in any order.

A. Caprara, M. Fischetti, P. Toth. A heuristic method for the set covering problem. 1999.
P. Wentges. Weighted Dantzig-Wolfe decomposition for linear mixed-integer programming. 1997.
"""

import math
from dataclasses import dataclass

import numpy as np

from rastercov.kernels import placement_bits, placement_lagrange
from rastercov.placement._arrays import BoolArray, FloatArray, IntArray
from rastercov.placement.bits import spread_out
from rastercov.placement.select import lagrange
from rastercov.placement.select.bit_problem import LargeProblem
from rastercov.placement.select.lazy_cover import LazyCover
from rastercov.placement.select.presolve import ReducedProblem
from rastercov.placement.select.problem import BestCoverage
from rastercov.placement.select.selection import bound_of, share_of

MOST_CORE_PAIRS = 20_000_000
"""Pairs of the core: about 16 bytes each."""
MOST_ROUNDS = 10
"""Searches for prices, each with one pass over all candidates."""
LEAST_GAIN_REL = 1e-4
"""Relative improvement of the bound below which no round follows."""
PRICE_BITS = 61
"""Bits of the sum of all rounded prices."""
LINE_STEPS = 16
"""Steps of a search between two prices: to 1 / 2000 of their distance."""
GOLDEN = (math.sqrt(5) - 1) / 2


@dataclass(frozen=True, eq=False)
class Prices:
    """Prices of the remaining faces of a `LargeProblem`, and what they prove.

    Attributes
    ----------
    value : float
        Upper bound as a share of the weight, or lower bound of the cost, as in `lagrange`.
    price : (K,) float64
    earned : (C,) float64
        Sum of the prices of the faces of each candidate.
    """

    value: float
    price: FloatArray
    earned: FloatArray


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
    earned, best = state.first.sum(axis=1).astype(np.float64), None
    for _ in range(MOST_ROUNDS):
        rows = core_rows(large, state, earned, most_pairs)
        core = large.reduced(rows)
        if len(rows) == large.n_candidates or not _asks_for_any(core):
            return core, rows, bound_of(core, state)
        found = _priced(large, _core_prices(core, state, None if best is None else best.price))
        if best is None:
            # Prices of 0 prove nothing, but smaller ones than those of the core may.
            none = np.zeros(len(large.kept)), np.zeros(large.n_candidates)
            best = _between(large, Prices(_value(large, *none), *none), found)
            best = best if best.price.any() else found
        else:
            before, best = best.value, _between(large, best, found)
            if abs(best.value - before) <= LEAST_GAIN_REL * abs(best.value):
                break
        earned = best.earned
    assert best is not None
    core = large.reduced(rows := core_rows(large, state, best.earned, most_pairs))
    if isinstance(large.problem.goal, BestCoverage):
        weight = lagrange.weight_below(best.value, int(core.integer_weights.sum()))
        return core, rows, share_of(large.problem, weight)
    return core, rows, lagrange.cost_above(best.value, large.costs)


def _asks_for_any(core: ReducedProblem) -> bool:
    """True where the goal asks for any weight."""
    if isinstance(core.problem.goal, BestCoverage):
        return bool(core.integer_weights.any()) and lagrange.limits_of(core)[0] > 0
    return lagrange.asks_for_any(core)


def _core_prices(core: ReducedProblem, state: LazyCover, start: FloatArray | None) -> FloatArray:
    """Best prices of the core, from a search that starts at some."""
    if isinstance(core.problem.goal, BestCoverage):
        return lagrange.weight_prices(core, state.covered, prices=start)[1]
    return lagrange.cost_prices(core, state.cost, prices=start)[1]


def _priced(large: LargeProblem, price: FloatArray) -> Prices:
    """Bound of prices over all candidates; one pass."""
    unit = 2.0 ** (PRICE_BITS - math.ceil(math.log2(float(price.sum()) + 1.0)))
    rounded = np.floor(price * unit).astype(np.int64)
    values = np.zeros(large.problem.n_faces, np.int64)
    values[large.kept] = rounded
    mask = np.bitwise_or.reduce(large.masks, axis=0)
    earned = large.sums(spread_out(values)[None], mask[None])[:, 0] / unit
    return Prices(_value(large, rounded / unit, earned), rounded / unit, earned)


def _value(large: LargeProblem, price: FloatArray, earned: FloatArray) -> float:
    """Bound that prices prove, with what each candidate earns."""
    problem, kept = large.problem, large.kept
    needed = problem.views[kept] * price
    integer_weights = large.integer_weights[kept]
    whole = int(integer_weights.sum())
    if isinstance(problem.goal, BestCoverage):
        cameras, budget = lagrange.limits_of(large)
        if budget == math.inf:
            income = float(np.partition(earned, len(earned) - cameras)[-cameras:].sum())
        else:
            amounts = np.empty(len(earned))
            income = placement_lagrange.most_earned(earned, large.costs, cameras, budget, amounts)
        return income + float(np.maximum(integer_weights / whole - needed, 0.0).sum())
    share = np.ones(len(kept))
    if large.least_total < whole:
        weights, least = integer_weights.astype(np.float64), large.least.astype(np.float64)
        total = float(large.least_total)
        placement_lagrange.cheapest(
            needed / weights, weights, large.kind[kept], least, total, share
        )
    return float(np.minimum(large.costs - earned, 0.0).sum() + (needed * share).sum())


def _between(large: LargeProblem, one: Prices, other: Prices) -> Prices:
    """Prices of the best bound between two; no worse than either.

    The bound is convex or concave on the way from one to the other.
    """
    sign = -1.0 if isinstance(large.problem.goal, BestCoverage) else 1.0

    def at(part: float) -> Prices:
        price = (1 - part) * one.price + part * other.price
        earned = (1 - part) * one.earned + part * other.earned
        return Prices(_value(large, price, earned), price, earned)

    best = max(one, other, key=lambda prices: sign * prices.value)
    low, high = 0.0, 1.0
    ends = [high - GOLDEN * (high - low), low + GOLDEN * (high - low)]
    inner = [at(part) for part in ends]
    for _ in range(LINE_STEPS):
        best = max(best, *inner, key=lambda prices: sign * prices.value)
        if sign * inner[0].value >= sign * inner[1].value:
            high, ends[1], inner[1] = ends[1], ends[0], inner[0]
            ends[0] = high - GOLDEN * (high - low)
            inner[0] = at(ends[0])
        else:
            low, ends[0], inner[0] = ends[0], ends[1], inner[1]
            ends[1] = low + GOLDEN * (high - low)
            inner[1] = at(ends[1])
    return best


def core_rows(
    large: LargeProblem, state: LazyCover, earned: FloatArray, most_pairs: int
) -> IntArray:
    """(N,) rows of the core, ascending.

    These are the chosen cameras, then candidates that together cover each face as often as it
    needs, then those that earn most, by their cost unless their number is limited; ties by rank.
    """
    if int(large.sizes.sum()) <= most_pairs:
        return np.arange(large.n_candidates)
    goal = large.problem.goal
    is_by_cost = not isinstance(goal, BestCoverage) or goal.budget is not None
    profit = earned / np.maximum(large.costs, 1e-12) if is_by_cost else earned
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
        placement_bits.complete_cover(words, rows, lacking, count, views, is_needed[at])
        if not lacking.any():
            break
    return is_needed
