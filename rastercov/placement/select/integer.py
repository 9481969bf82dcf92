"""The best selection there is, by integer programming with HiGHS, started from the greedy one.

With x_c = 1 for a chosen camera and z_f = 1 for a covered face,

    FewestCameras   min sum cost_c x_c     BestCoverage   max sum w_f z_f
                    sum w_f z_f >= share                  sum x_c <= cameras
                                                          sum cost_c x_c <= budget
    both            sum over c that cover f of x_c  >=  views_f z_f

Where rays must differ, a face may not be covered by cameras that all see it from about the same
direction: for any set Q of cameras whose rays at f are pairwise closer than the angle,

    sum over c that cover f, not in Q, of x_c  >=  z_f.

There are too many such sets to write down, so those that an answer runs into are added and the
program is solved again, until none is left; the bound holds all the while, because leaving some out
only makes the program easier.

Q. Huangfu, J. A. J. Hall. Parallelizing the dual revised simplex method. 2018 (HiGHS).
"""

import atexit
import math
import time
from itertools import pairwise
from threading import Lock, RLock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov._typed import typed
from rastercov.errors import ConfigError, ResourceError
from rastercov.placement.select import selection_kernels as kernels
from rastercov.placement.select.cover_state import Tally
from rastercov.placement.select.deadline import Deadline, TimeUpError
from rastercov.placement.select.greedy import EFFORT, complete, construct, improve
from rastercov.placement.select.lagrange import SAFETY, rounded_up
from rastercov.placement.select.presolve import Merged, merge
from rastercov.placement.select.problem import WHOLE, BestCoverage, Problem
from rastercov.placement.select.selection import (
    PROVED,
    Selection,
    bound_of,
    finish,
    relative_gap,
    share_of,
)

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MOST_PAIRS = 20_000_000
"""Pairs of candidate and face that fit into memory with what HiGHS makes of them: 4 GB."""
POLL = 0.1
"""Seconds between two looks for an interrupt."""
START_SHARE = 0.15
"""Part of the time for the bound and the improvement of the greedy start; HiGHS has the rest."""
RESERVE = 0.03
"""Part of the time in which HiGHS stops."""
LAST = 0.25
"""Part of the time for putting the selection in order, at most."""
GRACE = 0.1
"""Seconds after the limit until HiGHS is left behind when it has not stopped."""
AT_EXIT = 10.0
"""Seconds that Python waits at its end for a solver that was left behind."""
SETUP = 3e-7
"""Seconds a pair to make a program and to start HiGHS on it: 0.6 s for two million pairs."""
PAIRS_A_LOOK = 5_000_000
"""Pairs of candidates compared between two looks at the clock when directions are separated."""


@typed
def select_integer(
    problem: Problem, *, time_limit: float = 60.0, threads: int | None = None, seed: int = 0
) -> Selection:
    """Best selection, or the best found in the time and what is proved about it.

    An interrupt (Ctrl-C) ends the search and gives what was found, with status "interrupted".

    Parameters
    ----------
    problem : Problem
        What covers what, and what is wanted.
    time_limit : float
        Seconds from the call, more than 0; kept to a tenth and 0.2 s. Of it, the greedy start has
        15 % for its bound and its improvement, HiGHS the rest; a limit that is longer than what
        both need changes nothing. HiGHS does not look at its clock in parts of its presolve: where
        it goes on beyond the limit it is left behind, and ends by itself when it comes to look.
        No limit shortens what every selection needs: merging, the greedy rule and the order of the
        cameras, 0.1 s for a million pairs or for 1000 cameras of 10,000 candidates; nor loading the
        compiled loops in a new process, or compiling them once after installation.
    threads : int, optional
        Of HiGHS; its own choice unless given.
    seed : int
        Of the greedy start.

    Raises
    ------
    ConfigError
        When highspy is not installed, or for a time limit that is none.
    ResourceError
        For more pairs than `MOST_PAIRS`.
    """
    if not time_limit > 0:
        raise ConfigError(f"time_limit must be more than 0 seconds, got {time_limit!r}")
    started, deadline = time.perf_counter(), Deadline.after(time_limit)
    merged = merge(problem)
    if len(merged.face) > MOST_PAIRS:
        raise ResourceError(
            f"{len(merged.face)} pairs of candidate and face are more than the {MOST_PAIRS} that "
            "an integer program is made of; use select_greedy, which has a bound, too"
        )
    before = time.perf_counter()
    tally = construct(merged)
    # To put the selection in order at the end takes about as long as to choose it by this rule.
    deadline = deadline.earlier(min(time.perf_counter() - before, LAST * time_limit))
    share = deadline.sooner(START_SHARE)
    bound = bound_of(merged, tally, share.sooner(0.5))
    tally = improve(merged, tally, bound, EFFORT, seed, share)
    search = _Search(merged, tally, bound)
    status = "feasible"
    if not search.is_proved and merged.n_candidates:
        status = search.run(deadline, threads)
    chosen = merged.candidates[sorted(search.best)]
    seconds = time.perf_counter() - started
    return finish("integer", merged, chosen, search.bound, seconds, status)


class _Search:
    """The best selection and the best bound so far, of a merged problem."""

    def __init__(self, merged: Merged, tally: Tally, bound: float) -> None:
        self.merged, self.tally, self.bound = merged, tally, bound
        self.is_best_coverage = isinstance(merged.problem.goal, BestCoverage)
        self.best, self.value = set(tally.chosen), self._value()

    @property
    def is_proved(self) -> bool:
        """Whether nothing is better."""
        return relative_gap(self.value, self.bound) <= PROVED

    def run(self, deadline: Deadline, threads: int | None) -> str:
        """Solve until the best is proved, the time is up, or someone interrupts; the status."""
        try:
            return self._run(deadline, threads)
        except TimeUpError:
            return "time_limit"

    def _run(self, deadline: Deadline, threads: int | None) -> str:
        setup = SETUP * len(self.merged.face)
        program = _Program(self.merged, threads) if deadline.left > setup else None
        while True:
            if program is None or deadline.left <= setup:
                return "time_limit"
            chosen, bound, ended = program.solve(deadline, self.best)
            if ended == "infeasible":  # cannot be, and says nothing about what is best
                return "feasible"
            self._take_bound(bound)
            if chosen is not None:
                self._take(chosen)
            if ended != "optimal" or self.is_proved:
                return ended if ended != "optimal" else "feasible"
            if chosen is None or not program.forbid(chosen, deadline):
                return "feasible"

    def _take(self, chosen: set[int]) -> None:
        """Keep a selection, completed where it falls short, if it is better than the best."""
        self.tally.become(chosen)
        complete(self.tally, self.merged.problem.goal)
        if not (self.is_best_coverage or self.tally.is_met):
            return
        value = self._value()
        if (value > self.value) if self.is_best_coverage else (value < self.value):
            self.best, self.value = set(self.tally.chosen), value

    def _take_bound(self, bound: float) -> None:
        if not np.isfinite(bound):  # stopped before there was one
            return
        if not self.is_best_coverage:
            bound = rounded_up(bound - SAFETY * abs(bound), self.merged.costs)
            self.bound = max(self.bound, bound)
            return
        quanta = self.merged.quanta
        weight = bound * (1 + SAFETY) * float(quanta.sum())
        if int(quanta.sum()) < WHOLE // 2:  # the weights' own whole numbers
            weight = np.floor(weight + 1e-4)
        self.bound = min(self.bound, share_of(self.merged.problem, weight))

    def _value(self) -> float:
        if self.is_best_coverage:
            return share_of(self.merged.problem, self.tally.covered)
        return self.tally.cost


class _Seen:
    """Solution and bound that HiGHS has reported so far, for when it has to be left behind."""

    def __init__(self, n_candidates: int, is_best_coverage: bool) -> None:
        self.n_candidates = n_candidates
        self.bound = math.inf if is_best_coverage else -math.inf
        self.chosen: set[int] | None = None

    def progress(self, event: Any) -> None:
        """Take the bound."""
        self.bound = float(event.data_out.mip_dual_bound)

    def improvement(self, event: Any) -> None:
        """Take a better solution."""
        values = np.array(event.data_out.mip_solution)[: self.n_candidates]
        self.chosen = set(np.flatnonzero(values > 0.5).tolist())


class _Program:
    """The integer program in HiGHS: columns are candidates, then faces that may stay uncovered."""

    def __init__(self, merged: Merged, threads: int | None) -> None:
        try:
            import highspy
        except ImportError:
            raise ConfigError(
                "select_integer needs highspy; pip install 'rastercov[place]', or use select_greedy"
            ) from None
        self.highspy, self.merged = highspy, merged
        self.is_best_coverage = isinstance(merged.problem.goal, BestCoverage)
        optional = np.flatnonzero(~merged.is_mandatory)
        self.column_of_face = np.full(merged.n_faces, -1, np.int64)
        self.column_of_face[optional] = merged.n_candidates + np.arange(len(optional))
        self.n_columns = merged.n_candidates + len(optional)
        self.views = merged.views.astype(np.int64)
        if merged.is_spread:
            self.views = np.maximum(self.views, 2)
        # Faces that take about as many comparisons as are made between two looks at the clock.
        work = np.cumsum(np.diff(merged.starts).astype(np.float64) ** 2) // PAIRS_A_LOOK
        ends = [*(np.flatnonzero(np.diff(work) > 0) + 1).tolist(), merged.n_faces]
        self.parts = [slice(a, b) for a, b in pairwise([0, *ends])]
        # Weights as parts of the whole, on average 1 a face: solvers like numbers near 1.
        total = max(1, int(merged.quanta.sum()))
        self.weights = merged.quanta.astype(np.float64) * (merged.n_faces / total)
        self.solver = highspy.Highs()
        # highspy keeps its locks in the class; a solver that was left behind would keep them.
        vars(self.solver).update(_Highs__solver_stopped=RLock(), _Highs__solver_started=Lock())
        options: dict[str, Any] = {"output_flag": False, "mip_rel_gap": 0.0, "random_seed": 0}
        if threads is not None:
            options["threads"] = threads
        # Where objectives are whole numbers, a gap below one of them is none.
        if self.is_best_coverage:
            unit = self.weights.sum() / total if total < WHOLE // 2 else 0.0
        else:
            unit = 1.0 if bool((merged.costs == np.floor(merged.costs)).all()) else 0.0
        options["mip_abs_gap"] = max(0.999 * unit, 1e-7)
        for name, value in options.items():
            self.solver.setOptionValue(name, value)
        self._pass_model(optional)
        self.solver.HandleUserInterrupt = True
        self.seen = _Seen(self.merged.n_candidates, self.is_best_coverage)
        self.solver.cbMipInterrupt += self.seen.progress
        self.solver.cbMipImprovingSolution += self.seen.improvement

    def solve(self, deadline: Deadline, start: set[int]) -> tuple[set[int] | None, float, str]:
        """The chosen candidates, if any were found, the bound, and how it ended."""
        solver = self.solver
        solution = self.highspy.HighsSolution()
        solution.col_value = self._columns_of(start)
        solver.setSolution(solution)
        left = deadline.sooner(1 - RESERVE).left
        solver.setOptionValue("time_limit", solver.getRunTime() + max(0.0, left))
        interrupted = False
        thread = solver.startSolve()
        while True:
            try:
                done, _ = solver.wait(min(POLL, max(0.01, deadline.left + GRACE)))
                if done:
                    break
                if deadline.is_over:
                    solver.cancelSolve()
                if deadline.left < -GRACE:
                    atexit.register(thread.join, AT_EXIT)  # its callbacks need a Python that runs
                    return self.seen.chosen, self._bound(self.seen.bound), "time_limit"
            except KeyboardInterrupt:
                interrupted = True
                solver.cancelSolve()
        states = self.highspy.HighsModelStatus
        ended = {
            states.kOptimal: "optimal",
            states.kInfeasible: "infeasible",
        }.get(solver.getModelStatus(), "time_limit")
        info = solver.getInfo()
        chosen = None
        if info.primal_solution_status == 2:  # feasible
            values = np.array(solver.getSolution().col_value[: self.merged.n_candidates])
            chosen = set(np.flatnonzero(values > 0.5).tolist())
        bound = self._bound(info.mip_dual_bound)
        return chosen, bound, "interrupted" if interrupted else ended

    def _bound(self, objective: float) -> float:
        """Bound of the cost, or of the share of the weight."""
        return objective / max(1, self.merged.n_faces) if self.is_best_coverage else objective

    def forbid(self, chosen: set[int], deadline: Deadline) -> int:
        """Rows that the faces lack which only look covered by these cameras; how many.

        TimeUpError when the deadline passes before all faces are looked at.
        """
        merged = self.merged
        if not merged.is_spread:
            return 0
        is_chosen = np.zeros(merged.n_candidates, bool)
        is_chosen[list(chosen)] = True
        n_found = 0
        for part in self.parts:
            deadline.check()
            starts, columns = kernels.missing_directions(
                merged.starts[part.start : part.stop + 1], merged.covering, is_chosen,
                self.views[part], merged.eyes, merged.centroids[part], merged.min_cosine,
            )  # fmt: skip
            for face in np.flatnonzero(np.diff(starts) > 0):  # a call each, microseconds
                row = columns[starts[face] : starts[face + 1]].astype(np.int32)
                values, least = np.ones(len(row)), 1.0
                if self.column_of_face[part][face] >= 0:
                    row = np.append(row, np.int32(self.column_of_face[part][face]))
                    values, least = np.append(values, -1.0), 0.0
                self.solver.addRow(least, self.highspy.kHighsInf, len(row), row, values)
                n_found += 1
        return n_found

    def _columns_of(self, chosen: set[int]) -> FloatArray:
        """Values of all columns for a selection."""
        merged = self.merged
        tally = Tally(merged)
        tally.become(chosen)
        covered = tally.covered_faces
        values = np.zeros(self.n_columns)
        values[list(chosen)] = 1.0
        optional = self.column_of_face >= 0
        values[self.column_of_face[optional]] = covered[optional]
        return values

    def _pass_model(self, optional: IntArray) -> None:
        """Give HiGHS the program, row by row: faces, then the limits of the goal."""
        highspy, merged = self.highspy, self.merged
        goal, n_candidates = merged.problem.goal, merged.n_candidates
        cameras = np.arange(n_candidates)
        column_of = self.column_of_face
        is_optional = (column_of >= 0).astype(np.int64)

        # One row a face: its candidates, and -views in the column that says it is covered.
        lengths = np.diff(merged.starts) + is_optional
        ends = np.cumsum(lengths)
        index = np.empty(int(lengths.sum()), np.int64)
        value = np.ones(len(index))
        own = ends[optional] - 1
        of_pairs = np.ones(len(index), bool)
        of_pairs[own] = False
        index[of_pairs] = merged.covering
        index[own], value[own] = column_of[optional], -self.views[optional]
        rows = [(index, value)]
        lower = [np.where(is_optional, 0.0, self.views)]
        upper = [np.full(merged.n_faces, highspy.kHighsInf)]
        n_entries = [lengths]

        def add_row(columns: IntArray, values: FloatArray, low: float, high: float) -> None:
            rows.append((columns, values))
            lower.append(np.array([low]))
            upper.append(np.array([high]))
            n_entries.append(np.array([len(columns)]))

        inf, cost = highspy.kHighsInf, np.zeros(self.n_columns)
        if isinstance(goal, BestCoverage):
            cost[column_of[optional]] = self.weights[optional]
            if goal.cameras is not None:
                add_row(cameras, np.ones(n_candidates), -inf, float(goal.cameras))
            if goal.budget is not None:
                add_row(cameras, merged.costs, -inf, goal.budget)
        else:
            cost[:n_candidates] = merged.costs
            scale = merged.n_faces / max(1, int(merged.quanta.sum()))
            for kind in (None, *range(1, len(merged.least))):
                of_kind = optional if kind is None else optional[merged.kind[optional] == kind]
                certain = column_of < 0
                if kind is not None:
                    certain &= merged.kind == kind
                least = merged.least_total if kind is None else int(merged.least[kind])
                missing = least - int(merged.quanta[certain].sum())
                if missing > 0:
                    add_row(column_of[of_kind], self.weights[of_kind], missing * scale, inf)

        # With one view a face, z is whole by itself where x is.
        integer, continuous = highspy.HighsVarType.kInteger, highspy.HighsVarType.kContinuous
        is_whole = np.ones(self.n_columns, bool)
        is_whole[n_candidates:] = (self.views[optional] > 1) | merged.is_spread
        counts = np.concatenate(n_entries)
        columns = np.concatenate([row[0] for row in rows]).astype(np.int32)
        sense = highspy.ObjSense.kMaximize if self.is_best_coverage else highspy.ObjSense.kMinimize
        self.solver.passModel(  # arrays as they are: lists of millions of numbers take seconds
            self.n_columns, len(counts), len(columns), int(highspy.MatrixFormat.kRowwise),
            int(sense), 0.0, cost, np.zeros(self.n_columns), np.ones(self.n_columns),
            np.concatenate(lower), np.concatenate(upper),
            np.concatenate(([0], np.cumsum(counts)[:-1])).astype(np.int32), columns,
            np.concatenate([row[1] for row in rows]).astype(np.float64),
            np.where(is_whole, int(integer), int(continuous)).astype(np.int32),
        )  # fmt: skip
