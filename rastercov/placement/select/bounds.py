"""Bounds: an objective that no selection can exceed, and the core of a problem on bits.

Each face f has a price u_f for every camera that it lacks. With the constraints

    sum of x_c over the cameras that cover f  >=  views_f z_f

priced instead of enforced, the problem separates and each camera and face is decided alone. Its
value is a bound for any prices; a subgradient method improves the prices. The best possible one is
the bound of the linear program. An angle between views is left out, which can only loosen the
bound.

Where the lists of all candidates do not fit into the memory, the prices come from a search on the
core, the best candidates that do, and one pass over the bits of all candidates gives the bound that
they prove. What candidates earn is linear in the prices, so the best prices between those of two
passes need no further one: they are never worse than the ones before. By them the next core is
chosen, until nothing is gained. Such prices are rounded down to multiples of a power of 2, so that
what each candidate earns is a sum of integers, equal in any order.

J. E. Beasley. A Lagrangian heuristic for set-covering problems. 1990.
G. B. Dantzig. Discrete-Variable Extremum Problems. 1957, for the fractional knapsack.
M. L. Fisher. The Lagrangian relaxation method for solving integer programming problems. 1981.
A. Caprara, M. Fischetti, P. Toth. A heuristic method for the set covering problem. 1999.
P. Wentges. Weighted Dantzig-Wolfe decomposition for linear mixed-integer programming. 1997.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from rastercov.base import AnyArray, FloatArray, Int32Array, IntArray, frozen_record, sort_order
from rastercov.engine import placement_lagrange as kernels
from rastercov.placement.select.cover import Cover, LazyCover
from rastercov.placement.select.presolve import Presolved, Reduced, ReducedProblem
from rastercov.placement.select.problem import BestCoverage, Problem

EFFORT = 300_000_000
"""Pairs to process, about a second; `FEWEST_STEPS` steps at least, for any number of pairs."""
FEWEST_STEPS, MOST_STEPS = 40, 1000
PATIENCE = 15
"""Steps without a better bound after which the step length is halved."""
LEAST_SCALE = 1e-4
"""Part of the first step length at which the search ends."""
LEAST_COST = 1e-300
"""Cost of a candidate, at least, in a quotient."""
BEYOND = 1.02
"""Cost that steps aim at, relative to that of a selection."""
BOUND_SAFETY_REL = 1e-9
"""Relative rounding error of the sum of a bound."""
MOST_CORE_PAIRS = 20_000_000
"""Pairs of the core: about 16 bytes each."""
MOST_ROUNDS = 10
"""Searches for prices, each with one pass over all candidates."""
LEAST_GAIN_REL = 1e-4
"""Relative improvement of the bound below which no round follows."""
PRICE_BITS = 61
"""Bits of the sum of all rounded prices."""
LINE_POINTS = 33
"""Prices that are tried from one to another, both among them."""


class TimeUpError(Exception):
    """A deadline has passed; caught by the search that it ends."""


@dataclass(frozen=True)
class Deadline:
    """A moment of the clock.

    Attributes
    ----------
    at : float
        Of `time.perf_counter`, seconds; inf for never.
    """

    at: float = math.inf

    @classmethod
    def after(cls, seconds: float) -> Self:
        """Deadline a number of seconds from now."""
        return cls(time.perf_counter() + seconds)

    def sooner(self, share: float) -> Self:
        """Deadline after a share of the remaining time."""
        late = (1 - share) * max(0.0, self.left)
        return type(self)(self.at - late) if late < math.inf else self

    def earlier(self, seconds: float) -> Self:
        """Deadline a number of seconds before this one."""
        return type(self)(self.at - seconds)

    @property
    def left(self) -> float:
        """Seconds left; negative once it has passed."""
        return self.at - time.perf_counter()

    @property
    def is_over(self) -> bool:
        """True once it has passed."""
        return self.left <= 0

    def check(self) -> None:
        """Raise TimeUpError once it has passed."""
        if time.perf_counter() >= self.at:
            raise TimeUpError


NEVER = Deadline()


def bound_of(reduced: ReducedProblem, state: Cover, deadline: Deadline = NEVER) -> float:
    """Lagrangian bound of the cost, or of the share, of any selection that meets the goal.

    Parameters
    ----------
    state : Cover
        A selection that meets it; sets the length of the steps.
    deadline : Deadline
        Ends the search for better prices, after its first steps.
    """
    if not _asks_for_any(reduced):
        is_share = isinstance(reduced.problem.goal, BestCoverage)
        return share_of(reduced.problem, 0.0) if is_share else 0.0
    return _proved_bound(reduced, best_prices(reduced, state, deadline=deadline)[0])


def _asks_for_any(reduced: ReducedProblem) -> bool:
    """True where the goal asks for any weight."""
    if isinstance(reduced.problem.goal, BestCoverage):
        return bool(reduced.integer_weights.any()) and limits_of(reduced)[0] > 0
    return bool(reduced.least.any())


def _proved_bound(among: Reduced, value: float) -> float:
    """Bound of the share or the cost from that of prices, with the rounding of its sum."""
    if not isinstance(among.problem.goal, BestCoverage):
        return round_up(value - BOUND_SAFETY_REL * abs(value), among.costs)
    whole = int(among.integer_weights.sum())
    weight = math.floor(value * (1 + BOUND_SAFETY_REL) * whole + BOUND_SAFETY_REL)
    return share_of(among.problem, min(whole, weight))


def share_of(problem: Problem, weight: float) -> float:
    """Integer weight as a share of the total."""
    total = int(problem.integer_weights.sum())
    return weight / total if total else 1.0


def limits_of(reduced: Reduced) -> tuple[int, float]:
    """Number of cameras and budget of `BestCoverage`; inf for no budget."""
    goal = reduced.problem.goal
    assert isinstance(goal, BestCoverage)
    cameras = reduced.n_candidates if goal.cameras is None else goal.cameras
    budget = math.inf if goal.budget is None else goal.budget * (1 + BOUND_SAFETY_REL)
    return min(cameras, reduced.n_candidates), budget


def best_prices(
    reduced: ReducedProblem,
    state: Cover,
    prices: FloatArray | None = None,
    deadline: Deadline = NEVER,
) -> tuple[float, FloatArray]:
    """Bound as a share of the weight, or of the cost, not rounded; the prices that prove it, (F,).

    Some weight must be asked for, and every face covered by a candidate. `prices` are those to
    start from; the others are as for `bound_of`.
    """
    pairs, costs = (reduced.indptr, reduced.face), reduced.costs
    relaxed = Relaxed.of(reduced, reduced.views, reduced.integer_weights, reduced.kind)
    views, most = relaxed.views, relaxed.most
    if isinstance(reduced.problem.goal, BestCoverage):
        sign, best, values = 1.0, math.inf, state.covered / int(reduced.integer_weights.sum())
        target = values
        if prices is None:  # lower for faces that many candidates cover
            degree = np.diff(reduced.starts)
            prices = most / (1 + degree / max(1.0, float(degree.mean())))
    else:
        sign, best, values, target = -1.0, 0.0, state.cost, BEYOND * state.cost
        if prices is None:
            sizes, prices = np.diff(reduced.indptr), np.full(reduced.n_faces, math.inf)
            np.minimum.at(prices, reduced.face, np.repeat(costs / np.maximum(sizes, 1), sizes))
    u = kept = np.minimum(prices, most)
    earned, cover = np.empty(len(costs)), np.empty(len(u))
    scale, waited = 1.0, 0
    n_pairs = max(1, 2 * len(reduced.face))  # of a step
    for _ in range(int(np.clip(EFFORT // n_pairs, FEWEST_STEPS, MOST_STEPS))):
        kernels.earn(*pairs, u, earned)
        value, amounts, wanted = relaxed.value(u, earned)
        if sign * value < sign * best - 1e-12:
            best, kept, waited = value, u, 0
        else:
            waited += 1
        if waited == PATIENCE:
            u, scale, waited = kept, scale / 2, 0
            continue
        kernels.take(*pairs, amounts, cover)
        slope = views * wanted - cover
        # A price at its limit cannot move beyond it.
        slope[((u <= 0) & (slope < 0)) | ((u >= most) & (slope > 0))] = 0.0
        norm = float(np.square(slope).sum())  # no BLAS, whose threads spin
        is_reached = sign * best <= sign * values * (1 + sign * 1e-12)
        if norm == 0 or is_reached or scale < LEAST_SCALE or deadline.is_over:
            break
        length = scale * max(sign * (value - target), 1e-9) / norm
        u = np.clip(u + length * slope, 0.0, most)
    return best, kept


@frozen_record
class Relaxed:
    """A problem whose faces have prices, for which each camera and each face is decided alone.

        best coverage   L(u) = sum_f max(0, w_f - views_f u_f) + max_x sum_c x_c sum_{f in c} u_f
        fewest cameras  L(u) = min_x sum_c x_c (cost_c - sum_{f in c} u_f)
                               + min_z sum_f views_f u_f z_f

    with z in [0, 1] covering the required weights: the faces of least price by weight first, for
    the inner requirements, then for those that they are in, from the faces that remain.

    Attributes
    ----------
    among : Reduced
    views, weights : (F,) float64
        Cameras that a face needs, 2 or more where rays must differ; weights as they are summed.
    kind : (F,) int32
    most : (F,) float64
        Greatest useful price of each face.
    """

    among: Reduced
    views: FloatArray
    weights: FloatArray
    kind: Int32Array
    most: FloatArray

    @classmethod
    def of(
        cls,
        among: Reduced,
        views: AnyArray,
        integer_weights: IntArray,
        kind: Int32Array,
    ) -> Self:
        """Of the remaining faces of a problem, in lists or in bits."""
        needed = np.maximum(views.astype(np.float64), 2.0 if among.is_spread else 1.0)
        weights = integer_weights.astype(np.float64)
        most = np.full(len(weights), math.inf)
        if isinstance(among.problem.goal, BestCoverage):
            weights /= int(integer_weights.sum())
            most = weights / needed
        return cls(among, needed, weights, kind, most)

    def value(self, price: FloatArray, earned: FloatArray) -> tuple[float, FloatArray, AnyArray]:
        """Bound of the prices; parts of candidates, (C,), and of faces, (F,), that give it.

        `earned`, (C,), is the sum of the prices of the faces of each candidate.
        """
        among = self.among
        if isinstance(among.problem.goal, BestCoverage):
            income, amounts = most_earned(earned, among.costs, *limits_of(among))
            spare = self.weights - self.views * price
            return income + float(np.maximum(spare, 0.0).sum()), amounts, spare > 0
        share = np.ones(len(price))
        if among.least[0] < self.weights.sum():
            by_weight = self.views * price / self.weights
            share = cheapest(by_weight, self.weights, self.kind, among.least, among.levels)
        saved = float(np.minimum(among.costs - earned, 0.0).sum())
        bound = saved + float((self.views * price * share).sum())
        return bound, (earned > among.costs).astype(np.float64), share


def most_earned(
    earned: FloatArray, costs: FloatArray, cameras: int, budget: float
) -> tuple[float, FloatArray]:
    """Most that any candidates within the limits earn, or more, and the part of each, (C,).

    That of the `cameras` most valuable candidates; with a budget, also of the most valuable by
    cost, the last one in part. Each is a bound under both limits; the lesser is taken.
    """
    amounts = np.zeros(len(earned))
    amounts[sort_order(-earned)[:cameras]] = 1.0
    income = float((amounts * earned).sum())
    if math.isinf(budget):
        return income, amounts
    order = sort_order(-earned / np.maximum(costs, LEAST_COST))
    own, parts = costs[order], np.ones(len(earned))
    np.divide(_first(own, budget), own, parts, where=own > 0)
    by_cost = float((parts * earned[order]).sum())
    if by_cost >= income:
        return income, amounts
    amounts[order] = parts
    return by_cost, amounts


def _first(amounts: FloatArray, total: AnyArray | float) -> FloatArray:
    """(N,) parts of successive amounts that add up to a total, or all; of N totals of runs."""
    before = np.cumsum(amounts) - amounts
    return np.clip(total - before, 0.0, amounts)


def cheapest(
    price: FloatArray,
    weights: FloatArray,
    kind: Int32Array,
    least: IntArray,
    levels: Sequence[IntArray],
) -> FloatArray:
    """(F,) fractions of faces that give the required weights at the least price.

    `least`, (G,), is the weight wanted by each requirement; `levels` as of `Reduced`.
    """
    share = np.zeros(len(price))
    for level in levels:
        rows = np.flatnonzero(level[kind] >= 0)
        rows = rows[np.lexsort((price[rows], level[kind[rows]]))]
        own, of = weights[rows], level[kind[rows]]
        rest = own * (1 - share[rows])
        first = np.searchsorted(of, np.arange(len(least)))
        before = np.concatenate(([0.0], np.cumsum(rest)))[first]
        lack = least - np.bincount(of, own * share[rows], len(least))
        share[rows] += _first(rest, (lack + before)[of]) / own
    return share


def round_up(cost: float, costs: FloatArray) -> float:
    """Lower bound of a sum of costs, rounded up to a multiple of what divides all; at least 0."""
    if len(costs) and bool((costs == np.floor(costs)).all()) and costs.max() < 1 << 53:
        step = int(np.gcd.reduce(costs.astype(np.int64))) or 1
        cost = step * math.ceil(cost / step - 1e-6)
    return max(0.0, float(cost))


@frozen_record
class Prices:
    """Prices of the remaining faces of a `Presolved`, and what they prove.

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
    large: Presolved, state: LazyCover, most_pairs: int = MOST_CORE_PAIRS
) -> tuple[ReducedProblem, IntArray, float]:
    """Core of a problem, its rows in `large`, (N,), and the bound of all candidates.

    Where all candidates fit, the bound is that of `bound_of`.

    Parameters
    ----------
    state : LazyCover
        A selection that meets the goal; its cameras are in the core, and those by which the greedy
        rule continues until every face is covered.
    most_pairs : int
        Pairs of the core; these cameras are in it beyond that.
    """
    earned, best = state.first.sum(axis=1).astype(np.float64), None
    chosen = set(state.chosen)
    while (camera := state.next_best()) >= 0:
        state.add(camera)
    needed = np.array(sorted(state.chosen), np.int64)
    state.become(chosen)
    for _ in range(MOST_ROUNDS):
        rows = core_rows(large, needed, earned, most_pairs)
        core = large.list_rows(rows)
        if len(rows) == large.n_candidates or not _asks_for_any(core):
            return core, rows, bound_of(core, state)
        result = _prices_of(
            large, best_prices(core, state, None if best is None else best.price)[1]
        )
        if best is None:
            # Prices of 0 prove nothing, but smaller ones than those of the core may.
            none = np.zeros(len(large.kept)), np.zeros(large.n_candidates)
            best = _between(large, Prices(_value(large, *none), *none), result)
            best = best if best.price.any() else result
        else:
            before, best = best.value, _between(large, best, result)
            if abs(best.value - before) <= LEAST_GAIN_REL * abs(best.value):
                break
        earned = best.earned
    assert best is not None
    core = large.list_rows(rows := core_rows(large, needed, best.earned, most_pairs))
    return core, rows, _proved_bound(large, best.value)


def _prices_of(large: Presolved, price: FloatArray) -> Prices:
    """Bound of prices over all candidates; one pass."""
    unit = 2.0 ** (PRICE_BITS - math.frexp(float(price.sum()) + 1.0)[1])
    rounded = np.floor(price * unit).astype(np.int64)
    values = np.zeros(large.problem.n_faces, np.int64)
    values[large.kept] = rounded
    earned = large.sums(values, large.remains).sum(axis=1) / unit
    return Prices(_value(large, rounded / unit, earned), rounded / unit, earned)


def _value(large: Presolved, price: FloatArray, earned: FloatArray) -> float:
    """Bound that prices prove, with what each candidate earns."""
    kept = large.kept
    on_faces = large.problem.views[kept], large.integer_weights[kept], large.kind[kept]
    return Relaxed.of(large, *on_faces).value(price, earned)[0]


def _between(large: Presolved, one: Prices, other: Prices) -> Prices:
    """Prices of the best bound between two; no worse than either.

    The bound is convex or concave on the way from one to the other.
    """
    sign = -1.0 if isinstance(large.problem.goal, BestCoverage) else 1.0

    def at(part: float) -> Prices:
        price = (1 - part) * one.price + part * other.price
        earned = (1 - part) * one.earned + part * other.earned
        return Prices(_value(large, price, earned), price, earned)

    return max(
        map(at, np.linspace(0, 1, LINE_POINTS).tolist()), key=lambda result: sign * result.value
    )


def core_rows(large: Presolved, needed: IntArray, earned: FloatArray, most_pairs: int) -> IntArray:
    """(N,) rows of the core, ascending.

    These are some that it needs, (K,), then those that earn most, by their cost unless their number
    is limited; ties by rank.
    """
    goal = large.problem.goal
    is_by_cost = not isinstance(goal, BestCoverage) or goal.budget is not None
    profit = earned / np.maximum(large.costs, 1e-12) if is_by_cost else earned
    order = np.lexsort((large.rank, -profit))
    is_needed = np.isin(order, needed)
    left = most_pairs - int(large.sizes[needed].sum())
    fits = np.cumsum(np.where(is_needed, 0, large.sizes[order])) <= left
    return np.sort(order[is_needed | fits])
