"""Greedy selection with marginal gains, then improvement by swaps and by small destructions.

The gain of every candidate is kept up to date while cameras come and go (`selection_kernels`), so
what lazy evaluation saves is never computed. Where one view a face is enough, coverage is
submodular and the first pass alone reaches 1 - 1/e of the best coverage, or the logarithmic factor
of set cover. Everything after it only improves on it.

G. L. Nemhauser, L. A. Wolsey, M. L. Fisher. An analysis of approximations for maximizing
submodular set functions. 1978.
L. A. Wolsey. An analysis of the greedy algorithm for the submodular set covering problem. 1982.
R. Ruiz, T. Stützle. A simple and effective iterated greedy algorithm. 2007.
"""

import time
from collections.abc import Iterator
from contextlib import suppress

import numpy as np

from rastercov._arguments import check_seed
from rastercov._typed import typed
from rastercov.placement.select.cover_state import Tally
from rastercov.placement.select.deadline import NEVER, Deadline, TimeUpError
from rastercov.placement.select.presolve import Merged, merge
from rastercov.placement.select.problem import BestCoverage, Problem
from rastercov.placement.select.selection import PROVED, Selection, bound_of, finish

EFFORT = 200_000_000
"""Elementary updates of the improvement: half a second."""
MOST_KICKS = 3000
LOSS = 0.02
"""Part of the value that may be lost at once at first; ever less, none at the end."""


@typed
def select_greedy(problem: Problem, *, effort: int = EFFORT, seed: int = 0) -> Selection:
    """Good selection in about a second, and how far from the best it can be at most.

    Parameters
    ----------
    problem : Problem
        What covers what, and what is wanted.
    effort : int
        Elementary updates to spend on improvement, 0 for the plain greedy rule. The same effort
        gives the same selection on any machine.
    seed : int
        Of the cameras that are given up at random.
    """
    check_seed(seed)
    started = time.perf_counter()
    merged = merge(problem)
    tally = construct(merged)
    bound = bound_of(merged, tally)
    if effort > 0:
        tally = improve(merged, tally, bound, effort, seed)
    chosen = merged.candidates[tally.ranked()]
    return finish("greedy", merged, chosen, bound, time.perf_counter() - started)


def construct(merged: Merged) -> Tally:
    """The cameras that the greedy rule chooses, one at a time."""
    tally = Tally(merged)
    goal = merged.problem.goal
    complete(tally, goal)
    if not isinstance(goal, BestCoverage):
        _prune(tally)
    elif goal.budget is not None:
        # By cost alone, many cheap cameras may keep out one that is better than all of them.
        other = Tally(merged)
        while goal.cameras is None or len(other.chosen) < goal.cameras:
            if (camera := other.next_best(_left(other, goal))) < 0:
                break
            other.add(camera)
        return other if other.covered > tally.covered else tally
    return tally


def complete(tally: Tally, goal: object, deadline: Deadline = NEVER) -> None:
    """Add the cameras that the greedy rule adds to those that are chosen."""
    while (camera := _next(tally, goal)) >= 0:
        deadline.check()
        tally.add(camera)


def improve(
    merged: Merged,
    tally: Tally,
    bound: float,
    effort: int,
    seed: int,
    deadline: Deadline = NEVER,
) -> Tally:
    """The best selection met while cameras are swapped, and given up and replaced, again and again.

    Parameters
    ----------
    merged, tally : Merged, Tally
        The problem, and a selection to start from.
    bound : float
        As `bound_of` gives it; the search ends when it is reached.
    effort, seed : int
        As for `select_greedy`.
    deadline : Deadline
        Ends the search, too; looked at between two changes of the selection.
    """
    goal = merged.problem.goal
    if isinstance(goal, BestCoverage):
        start, tally = tally.chosen, Tally(merged, finish=True)
        tally.become(start)
        with suppress(TimeUpError):  # each swap that is done is for the better
            _swap(tally, goal, deadline)
    best = set(tally.chosen)
    tally.work = 0
    with suppress(TimeUpError):
        for better in _kicked(merged, tally, bound, effort, seed, deadline):
            best = better
    tally.barred[:] = 0
    tally.barred[list(tally.chosen)] = 1
    tally.become(best)
    return tally


def _kicked(
    merged: Merged, tally: Tally, bound: float, effort: int, seed: int, deadline: Deadline
) -> Iterator[set[int]]:
    """Ever better selections that are met on the way of `improve`."""
    goal = merged.problem.goal
    rng = np.random.default_rng(seed)
    current = set(tally.chosen)
    best_value = value = _value(tally, goal)
    most_lost = 4 if isinstance(goal, BestCoverage) else 8
    for kick in range(MOST_KICKS):
        if tally.work > effort or not current or _reaches(merged, tally, best_value, bound):
            return
        deadline.check()
        ranked = tally.ranked()
        n_lost = int(rng.integers(1, min(most_lost, len(ranked)) + 1))
        lost = [ranked[place] for place in rng.choice(len(ranked), n_lost, replace=False)]
        for camera in lost:
            tally.remove(camera)
        # Half of the time what is given up stays away until all is replaced; else for one turn.
        tally.barred[lost] = 1
        if rng.integers(2):
            camera = _next(tally, goal)
            if camera >= 0:
                tally.add(camera)
        else:
            complete(tally, goal, deadline)
        tally.barred[[camera for camera in lost if camera not in tally.chosen]] = 0
        complete(tally, goal, deadline)
        if isinstance(goal, BestCoverage):
            _swap(tally, goal, deadline)
        else:
            _prune(tally, deadline)
        new_value = _value(tally, goal)
        # A little worse will do at first, so that the search leaves what no swap improves.
        left = 1 - max(tally.work / effort, kick / MOST_KICKS)
        patience = LOSS * abs(value[0]) * max(0.0, left)
        if new_value[0] < value[0] - patience:
            tally.become(current)
            continue
        current, value = set(tally.chosen), new_value
        if value > best_value:
            best_value = value
            yield current


def _value(tally: Tally, goal: object) -> tuple[float, float]:
    """What is to be made as great as possible."""
    if isinstance(goal, BestCoverage):
        return tally.covered, tally.worth
    return -tally.cost, 0


def _reaches(merged: Merged, tally: Tally, value: tuple[float, float], bound: float) -> bool:
    """Whether nothing is left to gain."""
    if isinstance(merged.problem.goal, BestCoverage):
        return value[0] >= bound * int(merged.problem.quanta.sum()) * (1 - PROVED)
    return -value[0] <= bound * (1 + PROVED)


def _next(tally: Tally, goal: object) -> int:
    """Camera that the greedy rule adds; -1 where the goal allows, or asks for, no more."""
    if not isinstance(goal, BestCoverage):
        if tally.is_met:
            return -1
        camera = tally.next_needed()
        return camera if camera >= 0 else tally.next_first_half()
    if goal.cameras is not None and len(tally.chosen) >= goal.cameras:
        return -1
    most_cost = _left(tally, goal)
    camera = tally.next_best(most_cost, by_cost=goal.budget is not None)
    return camera if camera >= 0 else tally.next_first_half(most_cost)


def _left(tally: Tally, goal: BestCoverage) -> float:
    """Budget that is not spent."""
    return np.inf if goal.budget is None else goal.budget * (1 + 1e-12) - tally.cost


def _swap(tally: Tally, goal: BestCoverage, deadline: Deadline) -> None:
    """Replace single cameras while that gains anything."""
    gains = True
    while gains:
        gains = False
        for camera in tally.ranked():
            deadline.check()
            before = tally.worth
            tally.remove(camera)
            other = tally.next_best(_left(tally, goal))
            if other < 0:
                tally.add(camera)
                continue
            tally.add(other)
            if tally.worth > before:
                gains = True
            elif other != camera:
                tally.remove(other)
                tally.add(camera)


def _prune(tally: Tally, deadline: Deadline = NEVER) -> None:
    """Give up cameras that the requirements do not need, the dearest first."""
    for camera in sorted(tally.ranked(), key=lambda camera: -float(tally.merged.costs[camera])):
        deadline.check()
        tally.remove(camera)
        if not tally.is_met:
            tally.add(camera)
