"""What no selection can do better than, proved by Lagrange multipliers in about a second.

Give a face f a price u_f for every camera that it lacks. With the constraints

    sum of x_c over the cameras that cover f  >=  views_f z_f

priced instead of kept, cameras and faces fall apart and each is decided alone; the value of that
is a bound for any prices, and subgradient steps look for good ones. At its best it is the bound of
the linear program. An angle between views is left out, which can only loosen a bound.

J. E. Beasley. A Lagrangian heuristic for set-covering problems. 1990.
M. L. Fisher. The Lagrangian relaxation method for solving integer programming problems. 1981.
"""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rastercov.placement.select import lagrange_kernels as kernels
from rastercov.placement.select.deadline import NEVER, Deadline
from rastercov.placement.select.presolve import Merged
from rastercov.placement.select.problem import BestCoverage, FewestCameras

FloatArray = NDArray[np.float64]

EFFORT = 300_000_000
"""Pairs looked at, about a second; at least `FEWEST_STEPS` steps however many pairs there are."""
FEWEST_STEPS, MOST_STEPS = 40, 1000
PAIRS_A_LOOK = 5_000_000
"""Pairs looked at between two looks at the clock, 20 ms; at least those of a step."""
SAFETY = 1e-9
"""Part of a bound that rounding in its sum may have taken."""


def best_weight(
    merged: Merged, reached: int, effort: int = EFFORT, deadline: Deadline = NEVER
) -> int:
    """Weight in whole numbers that no selection within the goal's limits can exceed.

    Parameters
    ----------
    merged : Merged
        Of a problem whose goal is `BestCoverage`.
    reached : int
        Weight of a selection, for the length of the steps.
    effort : int
        Pairs to look at.
    deadline : Deadline
        Ends the search for better prices, but not before its first steps.
    """
    goal = merged.problem.goal
    assert isinstance(goal, BestCoverage)
    whole = int(merged.quanta.sum())
    cameras = merged.n_candidates if goal.cameras is None else goal.cameras
    cameras = min(cameras, merged.n_candidates)
    budget = math.inf if goal.budget is None else goal.budget * (1 + SAFETY)
    if not whole or not cameras:
        return 0
    views = _views(merged)
    weights = merged.quanta / whole
    prices = np.minimum(_first_prices(merged, weights / views), weights / views)
    best_prices = prices.copy()

    def search(progress: FloatArray, steps: int) -> None:
        kernels.best_weight(
            merged.indptr, merged.face, views, weights, merged.costs, cameras, budget,
            prices, best_prices, progress, reached / whole, steps,
        )  # fmt: skip

    top = _searched(search, math.inf, merged, effort, deadline)
    return min(whole, math.floor(top * (1 + SAFETY) * whole + SAFETY))


def least_cost(
    merged: Merged, cost: float, effort: int = EFFORT, deadline: Deadline = NEVER
) -> float:
    """Cost below which no selection meets the requirements.

    Parameters
    ----------
    merged : Merged
        Of a problem whose goal is `FewestCameras`.
    cost : float
        Of a selection that does, for the length of the steps.
    effort, deadline
        As for `best_weight`.
    """
    assert isinstance(merged.problem.goal, FewestCameras)
    if merged.least_total <= 0 and not (merged.least > 0).any():
        return 0.0
    views = _views(merged)
    prices = np.empty(merged.n_faces)
    kernels.cheapest_share(merged.indptr, merged.face, merged.costs, prices)
    best_prices = prices.copy()
    weights, least = merged.quanta.astype(np.float64), merged.least.astype(np.float64)

    def search(progress: FloatArray, steps: int) -> None:
        kernels.least_cost(
            merged.indptr, merged.face, views, weights, merged.costs, merged.kind, least,
            float(merged.least_total), prices, best_prices, progress, cost, steps,
        )  # fmt: skip

    bottom = _searched(search, 0.0, merged, effort, deadline)
    return rounded_up(bottom - SAFETY * abs(bottom), merged.costs)


def rounded_up(cost: float, costs: FloatArray) -> float:
    """A lower bound of a sum of costs: the next whole number where they are whole, at least 0."""
    if len(costs) and bool((costs == np.floor(costs)).all()):
        cost = math.ceil(cost - 1e-6)
    return max(0.0, float(cost))


def _views(merged: Merged) -> FloatArray:
    """(F,) cameras that a face needs; where rays must differ, two at least."""
    views = merged.views.astype(np.float64)
    return np.maximum(views, 2.0) if merged.is_spread else views


def _first_prices(merged: Merged, most: FloatArray) -> FloatArray:
    """Prices to start from: lower for faces that many candidates cover."""
    degree = np.diff(merged.starts) / max(1.0, float(np.diff(merged.starts).mean()))
    prices: FloatArray = most / (1 + degree)
    return prices


def _searched(
    search: Callable[[FloatArray, int], None],
    start: float,
    merged: Merged,
    effort: int,
    deadline: Deadline,
) -> float:
    """The best bound that a search finds in its steps, or before the deadline."""
    pairs = max(1, 2 * len(merged.face))  # of a step
    left = int(np.clip(effort // pairs, FEWEST_STEPS, MOST_STEPS))
    progress = np.array([start, 1.0, 0.0, 0.0])
    at_once = max(1, PAIRS_A_LOOK // pairs)
    while left > 0 and not progress[kernels.ENDED]:
        search(progress, min(at_once, left))
        left -= at_once
        if deadline.is_over:
            break
    return float(progress[kernels.BEST])
