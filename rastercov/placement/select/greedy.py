"""Greedy selection by marginal gains, then local search by swaps and by removal and repair.

Covers of every face by cameras of equal cost are searched by weights of faces, see
`search_by_weights`.

The gains of all candidates are updated incrementally, see `engine/placement/selection.cpp`, which
makes lazy evaluation unnecessary where their lists fit into the memory. Where one view per face is
enough, coverage is submodular and the first pass alone reaches 1 - 1/e of the best coverage, or the
logarithmic factor of set cover. The local search only improves on it.

G. L. Nemhauser, L. A. Wolsey, M. L. Fisher. An analysis of approximations for maximizing
submodular set functions. 1978.
L. A. Wolsey. An analysis of the greedy algorithm for the submodular set covering problem. 1982.
R. Ruiz, T. Stützle. A simple and effective iterated greedy algorithm. 2007.
C. Gao, X. Yao, T. Weise, J. Li. An efficient local search heuristic with row weighting for the
unicost set covering problem. 2015.
"""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import TypeVar

import numpy as np

from rastercov.base import ConfigError, check_seed
from rastercov.base.typed import typed
from rastercov.engine import placement_weighting as kernels
from rastercov.placement.select.bounds import (
    MOST_CORE_PAIRS,
    NEVER,
    Deadline,
    TimeUpError,
    bound_of,
    core_and_bound,
)
from rastercov.placement.select.cover import Cover, CoverState, LazyCover
from rastercov.placement.select.presolve import ReducedProblem, presolve
from rastercov.placement.select.problem import PROVED, BestCoverage, Problem, Selection, finish

EFFORT = 200_000_000
"""Elementary updates of the local search: half a second."""
MOST_LISTED_PAIRS = 50_000_000
"""Pairs up to which all are listed for the local search: 400 MB."""
MOST_KICKS, STEPS_A_KICK = 3000, 100
FIRST_LOSS = 0.02
"""Relative loss accepted in one step at the start; it decreases to 0 at the end."""


AnyCover = TypeVar("AnyCover", bound=Cover)


@typed
def select_greedy(
    problem: Problem, *, effort: int = EFFORT, seed: int = 0, core_pairs: int | None = None
) -> Selection:
    """Good selection in about a second, with a bound on its distance from the optimum.

    The local search works on lists of pairs of candidate and face. If these are too many for the
    memory, it works on the core, the best candidates that fit; the greedy rule and the bound still
    consider all candidates.

    Parameters
    ----------
    problem : Problem
        Result of `problem_of` or `problem_of_matrix`.
    effort : int
        Number of elementary updates of the local search; 0 for the plain greedy rule. The same
        effort gives the same selection on any machine.
    seed : int
        Seed of the cameras removed at random.
    core_pairs : int, optional
        Number of pairs in the core, about 16 bytes each. Unless given, all if there are up to 50
        million, otherwise 20 million. Rigs and an angle between views always use all.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import BestCoverage, problem_of_matrix, select_greedy
    >>> covers = [[1, 1, 0, 0], [0, 1, 1, 0], [0, 0, 1, 1]]
    >>> best = select_greedy(problem_of_matrix(covers, BestCoverage(cameras=2)))
    >>> best.chosen.tolist(), best.share, best.status
    ([0, 2], 1.0, 'optimal')
    """
    check_seed(seed)
    if core_pairs is not None and core_pairs < 0:
        raise ConfigError(f"expected core_pairs of 0 or more, got {core_pairs}; increase it")
    began = time.perf_counter()
    presolved = presolve(problem)
    most = MOST_LISTED_PAIRS if core_pairs is None else core_pairs
    if problem.has_rigs or problem.is_spread or int(presolved.sizes.sum()) <= most:
        core = presolved.list_rows()
        state = construct(core)
        bound = bound_of(core, state)
    else:
        chosen = construct_cover(lambda: LazyCover(presolved))
        most = MOST_CORE_PAIRS if core_pairs is None else core_pairs
        core, rows, bound = core_and_bound(presolved, chosen, most)
        state = CoverState(core)
        state.become(np.flatnonzero(np.isin(rows, list(chosen.chosen))).tolist())
    if effort > 0:
        state = improve(state, bound, effort, seed)
    return finish(
        "greedy", problem, core.candidates[state.rank()], bound, time.perf_counter() - began
    )


def construct(reduced: ReducedProblem) -> CoverState:
    """Cover built by the greedy rule, one camera at a time."""
    return construct_cover(lambda: CoverState(reduced))


def construct_cover(empty: Callable[[], AnyCover]) -> AnyCover:
    """Cover built by the greedy rule from an empty one; `empty` may be called twice."""
    state = empty()
    goal = state.goal
    complete(state)
    if not isinstance(goal, BestCoverage):
        _prune(state)
    elif goal.budget is not None:
        # By gain per cost alone, many cheap cameras may exclude one that is better than all.
        other = empty()
        while goal.cameras is None or len(other.chosen) < goal.cameras:
            if (camera := other.next_best(_lacking_views(other))) < 0:
                break
            other.add(camera)
        return other if other.covered > state.covered else state
    return state


def complete(state: Cover, deadline: Deadline = NEVER) -> None:
    """Add cameras by the greedy rule until the goal is met or nothing is gained."""
    while (camera := _next(state)) >= 0:
        deadline.check()
        state.add(camera)


def improve(
    state: CoverState, bound: float, effort: int, seed: int, deadline: Deadline = NEVER
) -> CoverState:
    """Best selection of a local search that swaps cameras, and removes and replaces some.

    Starts from `state`; ends at the bound of `bound_of`, after the effort, or at the deadline,
    which is checked between two changes of the selection.
    """
    if isinstance(state.goal, BestCoverage):
        start, state = state.chosen, CoverState(state.reduced, finish=True)
        state.become(start)
        with suppress(TimeUpError):  # every completed swap is an improvement
            _swap(state, deadline)
    best = set(state.chosen)
    state.work = 0
    with suppress(TimeUpError):
        if has_equal_cameras(state):
            steps = STEPS_A_KICK * MOST_KICKS
            fewer = search_by_weights(state, bound, steps, effort, seed, deadline)
        else:
            fewer = _kick(state, bound, effort, seed, deadline)
        for better in fewer:
            best = better
    state.barred[:] = 0
    state.barred[list(state.chosen)] = 1
    state.become(best)
    return state


def _kick(
    state: CoverState, bound: float, effort: int, seed: int, deadline: Deadline
) -> Iterator[set[int]]:
    """Selections of `improve`, each better than the one before."""
    rng = np.random.default_rng(seed)
    current = set(state.chosen)
    best_value = value = _value(state)
    most_lost = 4 if isinstance(state.goal, BestCoverage) else 8
    for kick in range(MOST_KICKS):
        if state.work > effort or not current or _reaches(state, best_value, bound):
            return
        deadline.check()
        ranked = state.rank()
        n_lost = int(rng.integers(1, min(most_lost, len(ranked)) + 1))
        lost = [ranked[place] for place in rng.choice(len(ranked), n_lost, replace=False)]
        for camera in lost:
            state.remove(camera)
        # Removed cameras are excluded for one step, or half of the time until all are replaced.
        state.barred[lost] = 1
        if rng.integers(2):
            camera = _next(state)
            if camera >= 0:
                state.add(camera)
        else:
            complete(state, deadline)
        state.barred[[camera for camera in lost if camera not in state.chosen]] = 0
        complete(state, deadline)
        if isinstance(state.goal, BestCoverage):
            _swap(state, deadline)
        else:
            _prune(state, deadline)
        new_value = _value(state)
        # Slightly worse selections are accepted at first, to leave local optima of swaps.
        left = 1 - max(state.work / effort, kick / MOST_KICKS)
        patience = FIRST_LOSS * abs(value[0]) * max(0.0, left)
        if new_value[0] < value[0] - patience:
            state.become(current)
            continue
        current, value = set(state.chosen), new_value
        if value > best_value:
            best_value = value
            yield current


def _value(state: CoverState) -> tuple[float, float]:
    """Value to maximise; the second number breaks ties."""
    if isinstance(state.goal, BestCoverage):
        return state.covered, state.worth
    return -state.cost, 0


def _reaches(state: CoverState, value: tuple[float, float], bound: float) -> bool:
    """True where the value reaches the bound."""
    if isinstance(state.goal, BestCoverage):
        return value[0] >= bound * int(state.among.problem.integer_weights.sum()) * (1 - PROVED)
    return -value[0] <= bound * (1 + PROVED)


def _next(state: Cover) -> int:
    """Next camera of the greedy rule; -1 where the goal is met or allows no more."""
    goal = state.goal
    if not isinstance(goal, BestCoverage):
        if state.is_met:
            return -1
        camera = state.next_face()
        return camera if camera >= 0 else state.next_first_half()
    if goal.cameras is not None and len(state.chosen) >= goal.cameras:
        return -1
    most_cost = _lacking_views(state)
    camera = state.next_best(most_cost, by_cost=goal.budget is not None)
    return camera if camera >= 0 else state.next_first_half(most_cost)


def _lacking_views(state: Cover) -> float:
    """Remaining budget."""
    budget = getattr(state.goal, "budget", None)
    return np.inf if budget is None else budget * (1 + 1e-12) - state.cost


def _swap(state: CoverState, deadline: Deadline) -> None:
    """Replace single cameras until no replacement gains."""
    gains = True
    while gains:
        gains = False
        for camera in state.rank():
            deadline.check()
            before = state.worth
            state.remove(camera)
            other = state.next_best(_lacking_views(state))
            if other < 0:
                state.add(camera)
                continue
            state.add(other)
            if state.worth > before:
                gains = True
            elif other != camera:
                state.remove(other)
                state.add(camera)


def _prune(state: Cover, deadline: Deadline = NEVER) -> None:
    """Remove cameras that the requirements do not need, the most expensive first."""
    for camera in sorted(state.rank(), key=lambda camera: -float(state.among.costs[camera])):
        deadline.check()
        state.remove(camera)
        if not state.is_met:
            state.add(camera)


STEPS_AT_ONCE = 1000
"""Steps between two checks of the clock: 20 ms."""


def has_equal_cameras(state: CoverState) -> bool:
    """True for a cover of all faces that counts single cameras, each at the same cost."""
    reduced = state.reduced
    if isinstance(state.goal, BestCoverage) or not state.chosen:
        return False
    if reduced.is_spread or reduced.problem.has_rigs or np.ptp(reduced.costs) > 0:
        return False
    return bool((state.count >= reduced.views)[reduced.integer_weights > 0].all()) and (
        max(reduced.least_total, int(reduced.least.sum())) >= int(reduced.integer_weights.sum())
    )


def search_by_weights(
    state: CoverState, bound: float, steps: int, effort: int, seed: int, deadline: Deadline
) -> Iterator[set[int]]:
    """Covers of a search, each of fewer cameras than the one before.

    Parameters
    ----------
    state : CoverState
        Of a problem that `has_equal_cameras` accepts.
    bound : float
        Least cost that any cover has; the search ends there.
    steps, effort : int
        Most steps and elementary updates.
    """
    reduced, rng = state.reduced, np.random.default_rng(seed)
    views = np.where(reduced.integer_weights > 0, reduced.views, 0).astype(np.int32)
    lists = (reduced.camera_indptr, reduced.face, reduced.starts, reduced.covering, views)
    is_chosen = np.zeros(reduced.n_candidates, np.uint8)
    is_chosen[list(state.chosen)] = 1
    changed, best = np.zeros(len(is_chosen), np.int64), is_chosen.copy()
    weight, last = np.ones(len(views), np.int64), np.array([0, -1])
    sought = (is_chosen, weight, changed, np.zeros_like(is_chosen), last)
    enough = math.ceil(bound * (1 - PROVED) / max(float(reduced.costs[0]), 1e-300))
    n_best, work = len(state.chosen), 0
    while n_best > enough and last[0] < steps and work < effort:
        deadline.check()
        n = min(STEPS_AT_ONCE, steps - int(last[0]))
        numbers = rng.integers(0, 1 << 32, n, np.uint32)
        work += kernels.fewer_cameras(lists, reduced.rank, numbers, enough, sought, best)
        if best.sum() < n_best:
            n_best = int(best.sum())
            yield set(np.flatnonzero(best).tolist())
