"""Selection rule of the thesis: candidates in descending order of mean coverage.

The rule ignores the coverage of the cameras chosen before, so it chooses near copies of the best
one. It is the baseline of the comparison.

E. S. Eissa. Image Space Coverage Model. 2020, section 6.4.
"""

import time

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import finite_points
from rastercov.base.typed import typed
from rastercov.placement.select.bounds import bound_of
from rastercov.placement.select.cover import CoverState
from rastercov.placement.select.presolve import presolve
from rastercov.placement.select.problem import BestCoverage, Problem, Selection, finish


@typed
def select_thesis(problem: Problem, mean_coverage: ArrayLike) -> Selection:
    """Candidates in order of mean coverage, up to the allowed number or the required coverage.

    Ties go by position; a candidate beyond the budget is skipped. `mean_coverage`, (C,), is that of
    the matrix of the problem.
    """
    began = time.perf_counter()
    n = problem.n_candidates
    mean = finite_points("mean_coverage", mean_coverage, (n,), f"{n} numbers")
    goal, reduced = problem.goal, presolve(problem).list_rows()
    chosen: list[int] = []
    cost = 0.0
    for camera in np.argsort(-mean, kind="stable"):
        if isinstance(goal, BestCoverage):
            if len(chosen) == goal.cameras:
                break
            if goal.budget is not None and cost + problem.costs[camera] > goal.budget:
                continue
        else:
            reached = problem.by_requirement(problem.covered_by(chosen)[1])
            if (reached >= problem.required[1]).all():
                break
        chosen.append(int(camera))
        cost += float(problem.costs[camera])
    state = CoverState(reduced)
    state.become(np.flatnonzero(np.isin(reduced.candidates, chosen)).tolist())
    if not isinstance(goal, BestCoverage):
        # The step length of the bound needs a selection that meets the requirements.
        state.become(range(reduced.n_candidates))
    bound = bound_of(reduced, state)
    return finish("thesis", problem, np.array(chosen), bound, time.perf_counter() - began)
