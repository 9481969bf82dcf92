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

import numpy as np
from numpy.typing import NDArray

from rastercov.placement import bound_kernels as kernels
from rastercov.placement.merging import Merged
from rastercov.placement.problem import BestCoverage, FewestCameras

FloatArray = NDArray[np.float64]

EFFORT = 300_000_000
"""Pairs looked at, about a second; at least `FEWEST_STEPS` steps however many pairs there are."""
FEWEST_STEPS, MOST_STEPS = 40, 1000
SAFETY = 1e-9
"""Part of a bound that rounding in its sum may have taken."""


def best_weight(merged: Merged, reached: int, effort: int = EFFORT) -> int:
    """Weight in whole numbers that no selection within the goal's limits can exceed.

    Parameters
    ----------
    merged : Merged
        Of a problem whose goal is `BestCoverage`.
    reached : int
        Weight of a selection, for the length of the steps.
    effort : int
        Pairs to look at.
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
    top: float = kernels.best_weight(
        merged.indptr, merged.face, views, weights, merged.costs, cameras, budget,
        _first_prices(merged, weights / views), reached / whole, _steps(merged, effort),
    )  # fmt: skip
    return min(whole, math.floor(top * (1 + SAFETY) * whole + SAFETY))


def least_cost(merged: Merged, cost: float, effort: int = EFFORT) -> float:
    """Cost below which no selection meets the requirements.

    Parameters
    ----------
    merged : Merged
        Of a problem whose goal is `FewestCameras`.
    cost : float
        Of a selection that does, for the length of the steps.
    effort : int
        Pairs to look at.
    """
    assert isinstance(merged.problem.goal, FewestCameras)
    if merged.least_total <= 0 and not (merged.least > 0).any():
        return 0.0
    views = _views(merged)
    prices = np.empty(merged.n_faces)
    kernels.cheapest_share(merged.indptr, merged.face, merged.costs, prices)
    bottom: float = kernels.least_cost(
        merged.indptr, merged.face, views, merged.quanta.astype(np.float64), merged.costs,
        merged.kind, merged.least.astype(np.float64), float(merged.least_total), prices, cost,
        _steps(merged, effort),
    )  # fmt: skip
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


def _steps(merged: Merged, effort: int) -> int:
    return int(np.clip(effort // max(1, 2 * len(merged.face)), FEWEST_STEPS, MOST_STEPS))
