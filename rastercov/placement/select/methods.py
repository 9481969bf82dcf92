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

Optimal selection by integer programming with HiGHS, started from the greedy selection.

With x_c = 1 for a chosen camera and z_f = 1 for a covered face,

    FewestCameras   min sum cost_c x_c     BestCoverage   max sum w_f z_f
                    sum w_f z_f >= share                  sum x_c <= cameras
                                                          sum cost_c x_c <= budget
    both            sum over c that cover f of x_c  >=  views_f z_f

Where rays must differ, cameras that all see a face from about the same direction do not cover it:
for any set Q of cameras whose rays at f are pairwise closer than the angle,

    sum over c that cover f, not in Q, of x_c  >=  z_f.

There are too many such sets to enumerate. Those that a solution violates are added and the program
is solved again, until none is violated; the bound holds throughout, because the program without
some of the constraints is a relaxation.

Q. Huangfu, J. A. J. Hall. Parallelizing the dual revised simplex method. 2018 (HiGHS).
"""

import atexit
import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from itertools import pairwise
from threading import Lock, RLock
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from rastercov.base import (
    ByName,
    ConfigError,
    FloatArray,
    Int32Array,
    IntArray,
    ResourceError,
    check_seed,
    offsets_of,
)
from rastercov.base.limits import limit_time
from rastercov.base.streams import no_printing
from rastercov.base.typed import typed
from rastercov.engine import placement_selection as kernels
from rastercov.engine import placement_weighting
from rastercov.placement.select.bounds import (
    BOUND_SAFETY_REL,
    MOST_CORE_PAIRS,
    NEVER,
    Deadline,
    TimeUpError,
    bound_of,
    core_and_bound,
    round_up,
    share_of,
)
from rastercov.placement.select.cover import Cover, CoverState, LazyCover
from rastercov.placement.select.presolve import ReducedProblem, presolve
from rastercov.placement.select.problem import (
    PROVED,
    TOTAL_WEIGHT,
    BestCoverage,
    Problem,
    Selection,
    finish,
    relative_gap,
)

if TYPE_CHECKING:
    from rastercov.placement.plan.sections import SelectionBase

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
    is_covered = (state.count >= reduced.views)[reduced.integer_weights > 0].all()
    return bool(is_covered and reduced.is_mandatory.all())


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
        work += placement_weighting.fewer_cameras(
            lists, reduced.rank, numbers, enough, sought, best
        )
        if best.sum() < n_best:
            n_best = int(best.sum())
            yield set(np.flatnonzero(best).tolist())


MOST_PAIRS = 20_000_000
"""Greatest number of candidate-face pairs; HiGHS takes 4 GB for them."""
POLL = 0.1
"""Seconds between two checks for an interrupt."""
START_SHARE = 0.15
"""Share of the time for the bound and the local search of the greedy start; HiGHS has the rest."""
RESERVE = 0.03
"""Share of the time reserved for HiGHS to stop."""
FINISH_SHARE = 0.25
"""Greatest share of the time for ordering the selection."""
GRACE = 0.1
"""Seconds after the limit until a solver that has not stopped is abandoned."""
PATIENCE = 0.2
"""Seconds after an interrupt until the same."""
AT_EXIT = 10.0
"""Seconds that Python waits at exit for an abandoned solver."""
SETUP_SECONDS_A_PAIR = 3e-7
"""Seconds a pair to build a program and to start HiGHS on it: 0.6 s for two million pairs."""
PAIRS_A_LOOK = 5_000_000
"""Pairs of candidates compared between two checks of the clock when directions are separated."""


def select_by(asked: "SelectionBase", problem: Problem, seconds: float | None) -> Selection:
    """Selection by `method` of a section of a plan, its `seed`, and `time_limit` or `seconds`."""
    if asked.method == "greedy":
        return select_greedy(problem, seed=asked.seed)
    limit = seconds or asked.time_limit
    with limit_time("selection", limit):
        return select_integer(problem, time_limit=limit, seed=asked.seed)


@typed
def select_integer(
    problem: Problem, *, time_limit: float = 60.0, threads: int | None = None, seed: int = 0
) -> Selection:
    """Optimal selection, or the best one found in the time, with its bound.

    An interrupt (Ctrl-C) ends the search and returns the best so far, with status "interrupted".

    Parameters
    ----------
    problem : Problem
        Result of `problem_of` or `problem_of_matrix`.
    time_limit : float
        Seconds from the call, more than 0; exceeded by at most a tenth and 0.2 s. The bound and the
        local search of the greedy start have 15 % of it, HiGHS the rest; a longer limit than both
        need changes nothing. HiGHS does not check its clock in parts of its presolve: if it
        continues beyond the limit it is abandoned, and ends at its next check. The limit does not
        include the steps of every selection: presolve, the greedy rule and the order of the
        cameras, 0.1 s for a million pairs or for 1000 cameras of 10,000 candidates; nor loading the
        compiled loops in a new process.
    threads : int, optional
        Number of threads of HiGHS; its own choice unless given.
    seed : int
        Seed of the greedy start.

    Raises
    ------
    ConfigError
        If highspy is not installed, and for a time limit that is not positive.
    ResourceError
        For more than 20 million pairs of candidate and face; use `select_greedy` for these.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import FewestCameras, problem_of_matrix, select_integer
    >>> covers = [[1, 1, 0, 0], [0, 1, 1, 0], [0, 0, 1, 1]]
    >>> few = select_integer(problem_of_matrix(covers, FewestCameras()), time_limit=5)
    >>> few.chosen.tolist(), few.status
    ([0, 2], 'optimal')
    """
    check_seed(seed)
    if not time_limit > 0:
        raise ConfigError(f"expected time_limit above 0 s, got {time_limit!r}; give seconds")
    started, deadline = time.perf_counter(), Deadline.after(time_limit)
    reduced = presolve(problem).list_rows().merged
    if len(reduced.face) > MOST_PAIRS:
        raise ResourceError(
            f"expected at most {MOST_PAIRS} pairs of candidate and face, got {len(reduced.face)}; "
            "use select_greedy, which also has a bound"
        )
    before = time.perf_counter()
    state = construct(reduced)
    # Ordering the selection at the end takes about as long as the greedy rule.
    deadline = deadline.earlier(min(time.perf_counter() - before, FINISH_SHARE * time_limit))
    share = deadline.sooner(START_SHARE)
    bound = bound_of(reduced, state, share.sooner(0.5))
    state = improve(state, bound, EFFORT, seed, share)
    search = _Search(reduced, state, bound)
    status = "feasible"
    if not search.is_proved and reduced.n_candidates:
        status = search.run(deadline, threads)
    chosen = reduced.candidates[sorted(search.best)]
    seconds = time.perf_counter() - started
    return finish("integer", problem, chosen, search.bound, seconds, status)


class _Search:
    """Best selection and best bound so far of a reduced problem."""

    def __init__(self, reduced: ReducedProblem, state: CoverState, bound: float) -> None:
        self.reduced, self.state, self.bound = reduced, state, bound
        self.is_best_coverage = isinstance(reduced.problem.goal, BestCoverage)
        self.best, self.value = set(state.chosen), self._value()

    @property
    def is_proved(self) -> bool:
        """True where the gap is within the tolerance."""
        return relative_gap(self.value, self.bound) <= PROVED

    def run(self, deadline: Deadline, threads: int | None) -> str:
        """Solve until the optimum is proved, the time is up or an interrupt comes; the status."""
        setup = SETUP_SECONDS_A_PAIR * len(self.reduced.face)
        program = _Program(self.reduced, threads) if deadline.left > setup else None
        while True:
            if program is None or deadline.left <= setup:
                return "time_limit"
            chosen, bound, ended = program.solve(deadline, self.best)
            if ended == "infeasible":  # impossible by construction; proves nothing
                return "feasible"
            self._take_bound(bound)
            if chosen is not None:
                self._take(chosen)
            if ended != "optimal" or self.is_proved:
                return ended if ended != "optimal" else "feasible"
            try:
                if chosen is None or not program.forbid(chosen, deadline):
                    if program.has_begun_anew:
                        return "feasible"
                    program.begin_anew()
            except TimeUpError:
                return "time_limit"

    def _take(self, chosen: set[int]) -> None:
        """Complete a selection by the greedy rule, and keep it if it is the best."""
        self.state.become(chosen)
        complete(self.state)
        if not (self.is_best_coverage or self.state.is_met):
            return
        value = self._value()
        if (value > self.value) if self.is_best_coverage else (value < self.value):
            self.best, self.value = set(self.state.chosen), value

    def _take_bound(self, bound: float) -> None:
        if not np.isfinite(bound):  # stopped before the first bound
            return
        if not self.is_best_coverage:
            bound = round_up(bound - BOUND_SAFETY_REL * abs(bound), self.reduced.costs)
            self.bound = max(self.bound, bound)
            return
        integer_weights = self.reduced.integer_weights
        weight = bound * (1 + BOUND_SAFETY_REL) * float(integer_weights.sum())
        if int(integer_weights.sum()) < TOTAL_WEIGHT // 2:  # the weights are integers themselves
            weight = np.floor(weight + 1e-4)
        self.bound = min(self.bound, share_of(self.reduced.problem, weight))

    def _value(self) -> float:
        if self.is_best_coverage:
            return share_of(self.reduced.problem, self.state.covered)
        return self.state.cost


class _Program:
    """The integer program in HiGHS: columns are candidates, then faces."""

    def __init__(self, reduced: ReducedProblem, threads: int | None) -> None:
        try:
            import highspy
        except ImportError:
            raise ConfigError(
                "expected highspy, got none; pip install 'rastercov[place]', or use select_greedy"
            ) from None
        self.highspy, self.reduced = highspy, reduced
        self.is_best_coverage = isinstance(reduced.problem.goal, BestCoverage)
        self.columns = reduced.n_candidates + np.arange(reduced.n_faces)
        self.views = reduced.views.astype(np.int64)
        if reduced.is_spread:
            self.views = np.maximum(self.views, 2)
        # Slices of faces with about PAIRS_A_LOOK comparisons each.
        work = np.cumsum(np.diff(reduced.starts).astype(np.float64) ** 2) // PAIRS_A_LOOK
        ends = [*(np.flatnonzero(np.diff(work) > 0) + 1).tolist(), reduced.n_faces]
        self.parts = [slice(a, b) for a, b in pairwise([0, *ends])]
        # Weights scaled to a mean of 1, the range in which solvers are accurate.
        total = max(1, int(reduced.integer_weights.sum()))
        self.weights = reduced.integer_weights.astype(np.float64) * (reduced.n_faces / total)
        with no_printing():
            self.solver = highspy.Highs()
        # highspy keeps its locks in the class; an abandoned solver would hold them for ever.
        vars(self.solver).update(_Highs__solver_stopped=RLock(), _Highs__solver_started=Lock())
        options: ByName = {"output_flag": False, "mip_rel_gap": 0.0, "random_seed": 0}
        if threads is not None:
            options["threads"] = threads
        # Where objectives are integers, a gap below 1 is no gap.
        if self.is_best_coverage:
            unit = self.weights.sum() / total if total < TOTAL_WEIGHT // 2 else 0.0
        else:
            unit = 1.0 if bool((reduced.costs == np.floor(reduced.costs)).all()) else 0.0
        options["mip_abs_gap"] = max(0.999 * unit, 1e-7)
        for name, value in options.items():
            self.solver.setOptionValue(name, value)
        self._pass_model()
        self.solver.HandleUserInterrupt = True
        self.has_begun_anew = False
        # Latest bound and solution that HiGHS has reported, for when it has to be abandoned.
        self.last_bound = math.inf if self.is_best_coverage else -math.inf
        self.last_chosen: set[int] | None = None
        self.solver.cbMipInterrupt += self._take_bound
        self.solver.cbMipImprovingSolution += self._take_solution

    def _take_bound(self, event: Any) -> None:
        self.last_bound = float(event.data_out.mip_dual_bound)

    def _take_solution(self, event: Any) -> None:
        self.last_chosen = self._choice_of(event.data_out.mip_solution)

    def _choice_of(self, columns: Sequence[float]) -> set[int]:
        values = np.array(columns[: self.reduced.n_candidates])
        return set(np.flatnonzero(values > 0.5).tolist())

    def begin_anew(self) -> None:
        """Forget what was solved, and begin with no selection.

        HiGHS 1.16 may end with the objective of another solution than the one it began with.
        """
        self.has_begun_anew = True
        self.solver.clearSolver()

    def solve(self, deadline: Deadline, start: set[int]) -> tuple[set[int] | None, float, str]:
        """Chosen candidates, None where none were found; the bound; the status."""
        solver = self.solver
        if not self.has_begun_anew:
            solution = self.highspy.HighsSolution()
            solution.col_value = self._columns_of(start)
            solver.setSolution(solution)
        left = deadline.sooner(1 - RESERVE).left
        solver.setOptionValue("time_limit", solver.getRunTime() + max(0.0, left))
        interrupted = math.inf
        thread = solver.startSolve()
        while True:
            try:
                done, _ = solver.wait(min(POLL, max(0.01, deadline.left + GRACE)))
                if done:
                    break
                if deadline.is_over:
                    solver.cancelSolve()
                is_late = time.monotonic() - interrupted > PATIENCE
                if deadline.left < -GRACE or is_late:
                    atexit.register(thread.join, AT_EXIT)  # its callbacks need a live interpreter
                    ended = "interrupted" if is_late else "time_limit"
                    return self.last_chosen, self._bound(self.last_bound), ended
            except KeyboardInterrupt:
                interrupted = min(interrupted, time.monotonic())
                solver.cancelSolve()
        states = self.highspy.HighsModelStatus
        ends = {states.kOptimal: "optimal", states.kInfeasible: "infeasible"}
        ended = ends.get(solver.getModelStatus(), "time_limit")
        info = solver.getInfo()
        is_feasible = info.primal_solution_status == 2
        chosen = self._choice_of(solver.getSolution().col_value) if is_feasible else None
        bound = self._bound(info.mip_dual_bound)
        return chosen, bound, ended if interrupted == math.inf else "interrupted"

    def _bound(self, objective: float) -> float:
        """Bound of the cost, or of the share of the weight."""
        return objective / max(1, self.reduced.n_faces) if self.is_best_coverage else objective

    def forbid(self, chosen: set[int], deadline: Deadline) -> int:
        """Add the constraints that these cameras violate, one per face; their number.

        Raises TimeUpError when the deadline passes before all faces are checked.
        """
        reduced = self.reduced
        if not reduced.is_spread:
            return 0
        is_chosen = np.zeros(reduced.n_candidates, bool)
        is_chosen[list(chosen)] = True
        n_found = 0
        for part in self.parts:
            deadline.check()
            starts = np.empty(part.stop - part.start + 1, np.int64)
            columns = np.empty(len(reduced.covering), np.int32)
            kernels.missing_directions(
                reduced.starts[part.start : part.stop + 1], reduced.covering, reduced.owner,
                is_chosen, self.views[part],
                (reduced.eyes, reduced.centroids[part], reduced.problem.min_cosine),
                starts, columns,
            )  # fmt: skip
            for face in np.flatnonzero(np.diff(starts) > 0):  # a call each, microseconds
                row = np.append(columns[starts[face] : starts[face + 1]], self.columns[part][face])
                self._add_row(row, np.append(np.ones(len(row) - 1), -1.0), 0.0)
                n_found += 1
        return n_found

    def _columns_of(self, chosen: set[int]) -> FloatArray:
        """Values of all columns for a selection."""
        state = CoverState(self.reduced)
        state.become(chosen)
        values = np.zeros(self.reduced.n_candidates)
        values[list(chosen)] = 1.0
        return np.append(values, state.covered_faces)

    def _pass_model(self) -> None:
        """Pass the program to HiGHS, row by row: faces, then the limits of the goal."""
        highspy, reduced = self.highspy, self.reduced
        goal, n_candidates, n_faces = reduced.problem.goal, reduced.n_candidates, reduced.n_faces
        # One row per face: its candidates, times their cameras, and -views in its column z.
        counts, covering, times = _merge_pairs(reduced)
        ends = np.cumsum(counts)
        index, value = np.insert(covering, ends, self.columns), np.insert(times, ends, -self.views)
        starts = ends - counts + np.arange(n_faces)
        # With one view per face, z is an integer wherever x is.
        is_whole = np.append(np.ones(n_candidates, bool), (self.views > 1) | reduced.is_spread)
        kinds = int(highspy.HighsVarType.kContinuous), int(highspy.HighsVarType.kInteger)
        cost = np.append(reduced.costs, np.zeros(n_faces))
        if self.is_best_coverage:
            cost = np.append(np.zeros(n_candidates), self.weights)
        sense = highspy.ObjSense.kMaximize if self.is_best_coverage else highspy.ObjSense.kMinimize
        low = np.append(np.zeros(n_candidates), reduced.is_mandatory.astype(np.float64))
        self.solver.passModel(  # arrays, because lists of millions of numbers take seconds
            len(low), n_faces, len(index), int(highspy.MatrixFormat.kRowwise), int(sense), 0.0,
            cost, low, np.ones(len(low)), np.zeros(n_faces), np.full(n_faces, highspy.kHighsInf),
            starts.astype(np.int32), index.astype(np.int32), value,
            np.array(kinds, np.int32)[is_whole.astype(np.int64)],
        )  # fmt: skip
        if isinstance(goal, BestCoverage):
            cameras = np.arange(n_candidates)
            if goal.cameras is not None:
                self._add_row(cameras, -np.ones(n_candidates), -float(goal.cameras))
            if goal.budget is not None:
                self._add_row(cameras, -reduced.costs, -goal.budget)
            return
        scale = n_faces / max(1, int(reduced.integer_weights.sum()))
        for least, is_of in zip(reduced.least.tolist(), reduced.is_of, strict=True):
            rows = is_of[reduced.kind]
            if least > 0:
                self._add_row(self.columns[rows], self.weights[rows], least * scale)

    def _add_row(self, columns: IntArray, values: FloatArray, least: float) -> None:
        """Add a constraint: a sum that is at least a number."""
        inf = self.highspy.kHighsInf
        self.solver.addRow(least, inf, len(columns), columns.astype(np.int32), values)


def _merge_pairs(reduced: ReducedProblem) -> tuple[IntArray, Int32Array, FloatArray]:
    """Candidates of each face: their number, (F,), each once, (N,), and its cameras, (N,)."""
    starts, covering = reduced.starts, reduced.owner[reduced.covering]
    is_first = np.ones(len(covering), bool)
    is_first[1:] = covering[1:] != covering[:-1]
    is_first[starts[:-1][starts[:-1] < len(is_first)]] = True
    rows = np.flatnonzero(is_first)
    times = np.diff(np.append(rows, len(covering))).astype(np.float64)
    counts = np.diff(offsets_of(is_first)[starts])
    return counts, covering[rows], times
