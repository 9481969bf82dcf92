"""The thesis' own selection: the candidates with the greatest mean coverage, one after another.

It does not ask what the cameras before have covered already, so it chooses near copies of the best
one. It is here as the row to beat.

E. S. Eissa. Image Space Coverage Model. 2020, section 6.4.
"""

import time

import numpy as np

from rastercov.placement.select.cover_state import Tally
from rastercov.placement.select.presolve import merge
from rastercov.placement.select.problem import BestCoverage, Problem
from rastercov.placement.select.selection import Selection, bound_of, finish


def select_thesis(problem: Problem) -> Selection:
    """The first candidates by mean coverage: as many as allowed, or until enough is covered.

    Parameters
    ----------
    problem : Problem
        What covers what, and what is wanted. Of equal candidates, the first in the list comes
        first; one that the budget cannot pay for is passed over.
    """
    started = time.perf_counter()
    goal, merged = problem.goal, merge(problem)
    chosen: list[int] = []
    cost = 0.0
    for camera in np.argsort(-problem.mean_coverage, kind="stable"):
        if isinstance(goal, BestCoverage):
            if len(chosen) == goal.cameras:
                break
            if goal.budget is not None and cost + problem.costs[camera] > goal.budget:
                continue
        elif problem.is_met(problem.covered_by(chosen)[1]):
            break
        chosen.append(int(camera))
        cost += float(problem.costs[camera])
    tally = Tally(merged)
    tally.become(np.flatnonzero(np.isin(merged.candidates, chosen)).tolist())
    if not isinstance(goal, BestCoverage):
        # Steps towards the bound are sized by a selection that meets the requirements.
        tally.become(range(merged.n_candidates))
    bound = bound_of(merged, tally)
    return finish("thesis", merged, np.array(chosen), bound, time.perf_counter() - started)
