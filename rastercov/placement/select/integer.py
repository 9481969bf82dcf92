"""Optimal selection by integer programming with HiGHS, started from the greedy selection.

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
from collections.abc import Sequence
from itertools import pairwise
from threading import Lock, RLock
from typing import TYPE_CHECKING, Any

import numpy as np

from rastercov.base import (
    ByName,
    ConfigError,
    FloatArray,
    Int32Array,
    IntArray,
    ResourceError,
    check_seed,
)
from rastercov.base.limits import limit_time
from rastercov.base.streams import no_printing
from rastercov.base.typed import typed
from rastercov.engine import placement_selection as kernels
from rastercov.placement.select.bounds import (
    BOUND_SAFETY_REL,
    Deadline,
    TimeUpError,
    bound_of,
    round_up,
    share_of,
)
from rastercov.placement.select.cover import CoverState
from rastercov.placement.select.greedy import EFFORT, complete, construct, improve, select_greedy
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


def select_by(asked: "SelectionBase", problem: Problem, seconds: float | None = None) -> Selection:
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
    reduced = presolve(problem).list_rows()
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
        for kind, least in enumerate((reduced.least_total, *reduced.least[1:].tolist())):
            rows = (reduced.kind == kind) | (kind == 0)  # in total: those of all kinds
            if least > 0:
                self._add_row(self.columns[rows], self.weights[rows], least * scale)

    def _add_row(self, columns: IntArray, values: FloatArray, least: float) -> None:
        """Add a constraint: a sum that is at least a number."""
        inf = self.highspy.kHighsInf
        self.solver.addRow(least, inf, len(columns), columns.astype(np.int32), values)


def _merge_pairs(reduced: ReducedProblem) -> tuple[IntArray, Int32Array, FloatArray]:
    """Candidates of each face: their number, (F,), each once, (N,), and its cameras, (N,)."""
    starts, covering = reduced.starts, reduced.owner[reduced.covering]
    is_first = np.ones(len(covering), np.bool_)
    is_first[1:] = covering[1:] != covering[:-1]
    is_first[starts[:-1][starts[:-1] < len(is_first)]] = True
    rows = np.flatnonzero(is_first)
    times = np.diff(np.append(rows, len(covering))).astype(np.float64)
    counts = np.diff(np.concatenate(([0], np.cumsum(is_first)))[starts])
    return counts, covering[rows], times
