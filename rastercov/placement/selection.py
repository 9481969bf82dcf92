"""What a selection is, whatever made it: the cameras, what they cover, and how good that is."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.placement import bounds
from rastercov.placement.merging import Merged
from rastercov.placement.problem import BestCoverage, Problem
from rastercov.placement.tally import Tally

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

PROVED = 1e-6
"""Relative gap up to which a selection counts as the best there is: the tolerance of HiGHS."""


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


def bound_of(merged: Merged, tally: Tally) -> float:
    """Bound by Lagrange multipliers: of the cost, or of the share.

    Parameters
    ----------
    merged : Merged
        The problem.
    tally : Tally
        A selection that meets its requirements.
    """
    if isinstance(merged.problem.goal, BestCoverage):
        weight = bounds.best_weight(merged, tally.covered)
        return share_of(merged.problem, weight)
    return bounds.least_cost(merged, tally.cost)


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
    order, curve = _in_order(problem, chosen)
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


def _in_order(problem: Problem, chosen: IntArray) -> tuple[IntArray, FloatArray]:
    """The chosen candidates, the one that adds most always next, and the shares they add up to."""
    left = sorted(int(camera) for camera in chosen)
    order: list[int] = []
    curve: list[float] = []
    # Progress per face, so that with several views a face the first camera counts, too.
    count = np.zeros(problem.n_faces, np.int64)
    part = problem.quanta / problem.views
    while left:  # K^2 / 2 looks at the faces of a camera, microseconds each
        gains = []
        for camera in left:
            faces = problem.face[problem.indptr[camera] : problem.indptr[camera + 1]]
            gains.append(float(part[faces[count[faces] < problem.views[faces]]].sum()))
        camera = left.pop(int(np.argmax(gains)))
        count[problem.face[problem.indptr[camera] : problem.indptr[camera + 1]]] += 1
        order.append(camera)
        is_plain = problem.min_angle == 0
        covered = count >= problem.views if is_plain else problem.covered_by(order)[1]
        curve.append(problem.share(covered))
    return np.array(order, np.int64), np.array(curve, np.float64)
