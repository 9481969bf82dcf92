"""Result of every selection method: cameras, covered faces, bound and gap."""

import heapq
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from rastercov.placement._arrays import BoolArray, FloatArray, IntArray
from rastercov.placement.select.problem import BestCoverage, Problem

PROVED = 1e-6
"""Relative gap up to which a selection counts as optimal: the tolerance of HiGHS."""
ROUNDING = 1e-9
"""Relative error of a sum of weights, with a margin."""


@dataclass(frozen=True, eq=False)
class Selection:
    """Chosen cameras, and a bound on the objective of any other choice.

    Attributes
    ----------
    method : str
        "greedy", "integer" or "thesis".
    chosen : (K,) int64
        Candidates, in greedy order: each adds the most to those before it.
    curve : (K,) float64
        Share of the weight covered by the first 1, 2, ..., K cameras.
    views : (F,) int64
        Chosen cameras that cover each face.
    covered : (F,) bool
        Faces covered by the required number of cameras, from directions that differ as required.
    share : float
        Part of the weight that is covered, [0, 1].
    cost : float
        Total cost of the chosen cameras.
    objective : float
        `cost` for `FewestCameras`, `share` for `BestCoverage`.
    bound : float
        No selection has a lower cost, or a greater share, than this.
    gap : float
        Relative distance of objective and bound; 0 for the optimum.
    seconds : float
        Time taken.
    status : {"optimal", "feasible", "time_limit", "interrupted"}
        Proved to be the optimum; found by a heuristic; or the best of an exact method when it was
        stopped.
    """

    method: str
    chosen: IntArray
    curve: FloatArray
    views: IntArray
    covered: BoolArray
    share: float
    cost: float
    objective: float
    bound: float
    gap: float
    seconds: float
    status: str

    def summary(self) -> dict[str, Any]:
        """Figures and cameras, ready for JSON, without the arrays over faces."""
        return {
            "method": self.method,
            "status": self.status,
            "cameras": len(self.chosen),
            "chosen": self.chosen.tolist(),
            "curve": self.curve.tolist(),
            "faces_covered": int(self.covered.sum()),
            "share": self.share,
            "cost": self.cost,
            "objective": self.objective,
            "bound": self.bound,
            "gap": self.gap,
            "seconds": self.seconds,
        }


def finish(
    method: str,
    problem: Problem,
    chosen: IntArray,
    bound: float,
    seconds: float,
    status: str = "feasible",
) -> Selection:
    """Selection of candidates of a problem, evaluated in it and not after presolve.

    `status` becomes "optimal" where the bound proves it.
    """
    order, curve = in_order(problem, chosen)
    views, covered = problem.covered_by(order)
    share, cost = problem.share(covered), float(np.sort(problem.costs[order]).sum())
    if isinstance(problem.goal, BestCoverage):
        objective, bound = share, max(bound, share)
    else:
        objective, bound = cost, min(bound, cost)
    gap = relative_gap(objective, bound)
    return Selection(
        method=method,
        chosen=order,
        curve=curve,
        views=views,
        covered=covered,
        share=share,
        cost=cost,
        objective=objective,
        bound=bound,
        gap=gap,
        seconds=seconds,
        status="optimal" if gap <= PROVED else status,
    )


def relative_gap(objective: float, bound: float) -> float:
    """|objective - bound| / |objective|; 0 where both are equal, inf where the objective is 0."""
    if objective == bound:
        return 0.0
    return abs(objective - bound) / abs(objective) if objective else math.inf


def in_order(problem: Problem, chosen: IntArray) -> tuple[IntArray, FloatArray]:
    """Chosen candidates in greedy order, and the cumulative shares they cover."""
    order: list[int] = []
    curve: list[float] = []
    # Progress per face, so that the first of several required cameras counts too.
    count = np.zeros(problem.n_faces, np.int64)
    part = problem.integer_weights / problem.views
    spread = problem.spread()

    def gain(camera: int) -> float:
        faces = problem.faces_of(camera)
        if problem.has_rigs:
            faces, times = np.unique(faces, return_counts=True)
            left = np.maximum(problem.views[faces] - count[faces], 0)
            return float((part[faces] * np.minimum(times, left)).sum())
        return float(part[faces[count[faces] < problem.views[faces]]].sum())

    # Lazy evaluation: gains only fall as cameras are added, so only gains above the current maximum
    # are computed again. Ties go by number, and 0 stays 0.
    rounding = 0.0 if bool((part == np.floor(part)).all()) else ROUNDING
    stale = [(-gain(camera), camera) for camera in map(int, chosen)]
    heapq.heapify(stale)
    while stale:
        fresh, best = [], (math.inf, -1)
        while stale and (stale[0][0] * (1 + rounding), stale[0][1]) < best:
            loss, camera = heapq.heappop(stale)
            fresh.append((-gain(camera) if loss else loss, camera))
            best = min(best, fresh[-1])
            if not loss:
                break
        for other in fresh:
            if other is not best:
                heapq.heappush(stale, other)
        camera = best[1]
        problem.add(camera, count, spread)
        order.append(camera)
        covered = (count >= problem.views) & spread.is_spread
        curve.append(problem.share(covered))
    return np.array(order, np.int64), np.array(curve, np.float64)
