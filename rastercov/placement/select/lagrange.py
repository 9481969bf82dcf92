"""Lagrangian bound: an objective that no selection can exceed, found in about a second.

Each face f has a price u_f for every camera that it lacks. With the constraints

    sum of x_c over the cameras that cover f  >=  views_f z_f

priced instead of enforced, the problem separates and each camera and face is decided alone. Its
value is a bound for any prices; a subgradient method improves the prices. The best possible one is
the bound of the linear program. An angle between views is left out, which can only loosen the
bound.

J. E. Beasley. A Lagrangian heuristic for set-covering problems. 1990.
M. L. Fisher. The Lagrangian relaxation method for solving integer programming problems. 1981.
"""

import math
from collections.abc import Callable

import numpy as np

from rastercov.kernels import placement_lagrange as kernels
from rastercov.placement._arrays import FloatArray
from rastercov.placement.select.deadline import NEVER, Deadline
from rastercov.placement.select.presolve import Candidates, ReducedProblem
from rastercov.placement.select.problem import BestCoverage, FewestCameras

EFFORT = 300_000_000
"""Pairs to process, about a second; `FEWEST_STEPS` steps at least, for any number of pairs."""
FEWEST_STEPS, MOST_STEPS = 40, 1000
PAIRS_A_LOOK = 5_000_000
"""Pairs processed between two checks of the clock, 20 ms; at least those of a step."""
BOUND_SAFETY_REL = 1e-9
"""Relative rounding error of the sum of a bound."""


def best_weight(
    reduced: ReducedProblem, reached: int, effort: int = EFFORT, deadline: Deadline = NEVER
) -> int:
    """Upper bound of the integer weight of any selection within the limits of the goal.

    Parameters
    ----------
    reduced : ReducedProblem
        Its goal is `BestCoverage`.
    reached : int
        Weight of a known selection; sets the length of the steps.
    effort : int
        Pairs to process.
    deadline : Deadline
        Ends the search for better prices, after its first steps.
    """
    whole = int(reduced.integer_weights.sum())
    if not whole or not limits_of(reduced)[0]:
        return 0
    return weight_below(weight_prices(reduced, reached, effort, deadline)[0], whole)


def weight_below(top: float, whole: int) -> int:
    """Greatest integer weight up to a share of the whole, with the rounding of its sum."""
    return min(whole, math.floor(top * (1 + BOUND_SAFETY_REL) * whole + BOUND_SAFETY_REL))


def limits_of(reduced: Candidates) -> tuple[int, float]:
    """Number of cameras and budget of `BestCoverage`; inf for no budget."""
    goal = reduced.problem.goal
    assert isinstance(goal, BestCoverage)
    cameras = reduced.n_candidates if goal.cameras is None else goal.cameras
    budget = math.inf if goal.budget is None else goal.budget * (1 + BOUND_SAFETY_REL)
    return min(cameras, reduced.n_candidates), budget


def weight_prices(
    reduced: ReducedProblem,
    reached: int,
    effort: int = EFFORT,
    deadline: Deadline = NEVER,
    prices: FloatArray | None = None,
) -> tuple[float, FloatArray]:
    """Upper bound of `best_weight` as a share of the weight, and the prices that prove it, (F,).

    `prices` are those to start from. Weight and number of cameras must be more than 0.
    """
    cameras, budget = limits_of(reduced)
    whole = int(reduced.integer_weights.sum())
    views = _views(reduced)
    weights = reduced.integer_weights / whole
    if prices is None:
        prices = _first_prices(reduced, weights / views)
    prices = np.minimum(prices, weights / views)
    best_prices = prices.copy()

    def search(progress: FloatArray, steps: int) -> None:
        kernels.best_weight(
            reduced.indptr, reduced.face, views, weights, reduced.costs, cameras, budget,
            prices, best_prices, progress, reached / whole, steps,
        )  # fmt: skip

    return _searched(search, math.inf, reduced, effort, deadline), best_prices


def least_cost(
    reduced: ReducedProblem, cost: float, effort: int = EFFORT, deadline: Deadline = NEVER
) -> float:
    """Lower bound of the cost of any selection that meets the requirements.

    Parameters
    ----------
    reduced : ReducedProblem
        Its goal is `FewestCameras`; effort and deadline as for `best_weight`.
    cost : float
        Cost of a known selection that does; sets the length of the steps.
    """
    if not asks_for_any(reduced):
        return 0.0
    return cost_above(cost_prices(reduced, cost, effort, deadline)[0], reduced.costs)


def asks_for_any(reduced: Candidates) -> bool:
    """True where `FewestCameras` asks for any weight."""
    assert isinstance(reduced.problem.goal, FewestCameras)
    return reduced.least_total > 0 or bool((reduced.least > 0).any())


def cost_above(bottom: float, costs: FloatArray) -> float:
    """Lower bound of a cost from its sum, with the rounding of the sum."""
    return rounded_up(bottom - BOUND_SAFETY_REL * abs(bottom), costs)


def cost_prices(
    reduced: ReducedProblem,
    cost: float,
    effort: int = EFFORT,
    deadline: Deadline = NEVER,
    prices: FloatArray | None = None,
) -> tuple[float, FloatArray]:
    """Lower bound of `least_cost`, not rounded, and the prices that prove it, (F,).

    `prices` are those to start from. Every face must be covered by a candidate.
    """
    views = _views(reduced)
    if prices is None:
        prices = np.empty(reduced.n_faces)
        kernels.cheapest_share(reduced.indptr, reduced.face, reduced.costs, prices)
    prices = prices.copy()
    best_prices = prices.copy()
    weights, least = reduced.integer_weights.astype(np.float64), reduced.least.astype(np.float64)

    def search(progress: FloatArray, steps: int) -> None:
        kernels.least_cost(
            reduced.indptr, reduced.face, views, weights, reduced.costs, reduced.kind, least,
            float(reduced.least_total), prices, best_prices, progress, cost, steps,
        )  # fmt: skip

    return _searched(search, 0.0, reduced, effort, deadline), best_prices


def rounded_up(cost: float, costs: FloatArray) -> float:
    """Lower bound of a sum of costs, rounded up to an integer where all costs are; at least 0."""
    if len(costs) and bool((costs == np.floor(costs)).all()):
        cost = math.ceil(cost - 1e-6)
    return max(0.0, float(cost))


def _views(reduced: ReducedProblem) -> FloatArray:
    """(F,) cameras that a face needs, two at least where rays must differ."""
    views = reduced.views.astype(np.float64)
    return np.maximum(views, 2.0) if reduced.is_spread else views


def _first_prices(reduced: ReducedProblem, most: FloatArray) -> FloatArray:
    """Initial prices, lower for faces that many candidates cover."""
    degree = np.diff(reduced.starts) / max(1.0, float(np.diff(reduced.starts).mean()))
    prices: FloatArray = most / (1 + degree)
    return prices


def _searched(
    search: Callable[[FloatArray, int], None],
    start: float,
    reduced: ReducedProblem,
    effort: int,
    deadline: Deadline,
) -> float:
    """Best bound of a search within its steps and the deadline."""
    pairs = max(1, 2 * len(reduced.face))  # of a step
    left = int(np.clip(effort // pairs, FEWEST_STEPS, MOST_STEPS))
    progress = np.array([start, 1.0, 0.0, 0.0])
    at_once = max(1, PAIRS_A_LOOK // pairs)
    while left > 0 and not progress[kernels.ENDED]:
        search(progress, min(at_once, left))
        left -= at_once
        if deadline.is_over:
            break
    return float(progress[kernels.BEST])
