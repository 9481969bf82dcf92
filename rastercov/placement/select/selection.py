"""What a selection is, whatever made it: the cameras, what they cover, and how good that is."""

import heapq
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.placement.select import lagrange as bounds
from rastercov.placement.select import selection_kernels as kernels
from rastercov.placement.select.cover_state import Tally
from rastercov.placement.select.deadline import NEVER, Deadline
from rastercov.placement.select.presolve import Merged
from rastercov.placement.select.problem import BestCoverage, Problem

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

PROVED = 1e-6
"""Relative gap up to which a selection counts as the best there is: the tolerance of HiGHS."""
ROUNDING = 1e-9
"""Relative error of a sum of weights, with room."""


@dataclass(frozen=True, eq=False)
class Selection:
    """Chosen cameras, and a bound that no others can pass.

    Attributes
    ----------
    method : str
        What chose them: "greedy", "integer" or "thesis".
    chosen : (K,) int64
        Candidates, such that each adds the most to those before it.
    curve : (K,) float64
        Share of the weight that the first so many cover.
    views : (F,) int64
        Chosen cameras that cover each face.
    covered : (F,) bool
        Faces that are covered: by enough of them, and from directions that differ enough.
    share : float
        Part of the weight that is covered, [0, 1].
    cost : float
        Of the chosen cameras.
    objective : float
        `cost` for `FewestCameras`, `share` for `BestCoverage`.
    bound : float
        No selection has a lower cost, or a greater share, than this.
    gap : float
        Relative distance of the two; 0 for the best there is.
    seconds : float
        Time taken.
    status : {"optimal", "feasible", "time_limit", "interrupted"}
        Whether it is proved to be the best, is what a heuristic found, or what an exact method
        had when it was stopped.
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


def bound_of(merged: Merged, tally: Tally, deadline: Deadline = NEVER) -> float:
    """Bound by Lagrange multipliers: of the cost, or of the share.

    Parameters
    ----------
    merged : Merged
        The problem.
    tally : Tally
        A selection that meets its requirements.
    deadline : Deadline
        As for `bounds.best_weight`.
    """
    if isinstance(merged.problem.goal, BestCoverage):
        weight = bounds.best_weight(merged, tally.covered, deadline=deadline)
        return share_of(merged.problem, weight)
    return bounds.least_cost(merged, tally.cost, deadline=deadline)


def share_of(problem: Problem, weight: float) -> float:
    """Part of the whole that a weight in whole numbers is."""
    total = int(problem.quanta.sum())
    return weight / total if total else 1.0


def finish(
    method: str,
    merged: Merged,
    chosen: IntArray,
    bound: float,
    seconds: float,
    status: str = "feasible",
) -> Selection:
    """Selection of the chosen candidates of the problem, judged there and not in the merged one.

    `status` becomes "optimal" where the bound says so.
    """
    problem = merged.problem
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
    """|objective - bound| as a part of the objective; 0 for equal ones, inf where it is 0."""
    if objective == bound:
        return 0.0
    return abs(objective - bound) / abs(objective) if objective else math.inf


def in_order(problem: Problem, chosen: IntArray) -> tuple[IntArray, FloatArray]:
    """The chosen candidates, the one that adds most always next, and the shares they add up to."""
    order: list[int] = []
    curve: list[float] = []
    # Progress per face, so that with several views a face the first camera counts, too.
    count = np.zeros(problem.n_faces, np.int64)
    part = problem.quanta / problem.views
    spread = _Spread(problem, np.asarray(chosen, np.int64))

    def gain(camera: int) -> float:
        faces = problem.face[problem.indptr[camera] : problem.indptr[camera + 1]]
        return float(part[faces[count[faces] < problem.views[faces]]].sum())

    # Gains only fall as cameras are added, so only those are looked at again that were greater than
    # the greatest is now: few each time. Equal gains go by number, and 0 stays 0.
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
        count[problem.face[problem.indptr[camera] : problem.indptr[camera + 1]]] += 1
        order.append(camera)
        curve.append(problem.share((count >= problem.views) & spread.after(camera)))
    return np.array(order, np.int64), np.array(curve, np.float64)


class _Spread:
    """Faces whose rays to two of the cameras so far differ by the angle of a problem."""

    def __init__(self, problem: Problem, chosen: IntArray) -> None:
        self.problem = problem
        self.is_spread = np.full(problem.n_faces, problem.min_angle == 0)
        if problem.min_angle > 0:
            n_pairs = int((problem.indptr[chosen + 1] - problem.indptr[chosen]).sum())
            self.last = np.full(problem.n_faces, -1, np.int64)
            self.before = np.empty(n_pairs, np.int64)
            self.camera = np.empty(n_pairs, np.int64)
            self.n_seen = 0

    def after(self, camera: int) -> BoolArray:
        """(F,) whether they do once a camera has been added."""
        problem = self.problem
        if problem.min_angle > 0:
            self.n_seen = kernels.spread_with(
                camera, problem.indptr, problem.face, problem.eyes, problem.centroids,
                problem.min_cosine, self.last, self.before, self.camera, self.n_seen,
                self.is_spread,
            )  # fmt: skip
        return self.is_spread
