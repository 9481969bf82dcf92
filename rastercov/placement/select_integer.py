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

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.errors import ConfigError, ResourceError
from rastercov.placement import selection_kernels as kernels
from rastercov.placement.bounds import SAFETY, rounded_up
from rastercov.placement.merging import Merged, merge
from rastercov.placement.problem import WHOLE, BestCoverage, Problem
from rastercov.placement.select_greedy import EFFORT, complete, construct, improve
from rastercov.placement.selection import (
    PROVED,
    Selection,
    bound_of,
    finish,
    relative_gap,
    share_of,
)
from rastercov.placement.tally import Tally

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MOST_PAIRS = 20_000_000
"""Pairs of candidate and face that fit into memory with what HiGHS makes of them: 4 GB."""
POLL = 0.1
"""Seconds between two looks for an interrupt."""


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
        Seconds, more than 0.
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
    started = time.perf_counter()
    merged = merge(problem)
    if len(merged.face) > MOST_PAIRS:
        raise ResourceError(
            f"{len(merged.face)} pairs of candidate and face are more than the {MOST_PAIRS} that "
            "an integer program is made of; use select_greedy, which has a bound, too"
        )
    tally = construct(merged)
    bound = bound_of(merged, tally)
    tally = improve(merged, tally, bound, EFFORT, seed)
    search = _Search(merged, tally, bound)
    status = "feasible"
    if not search.is_proved and merged.n_candidates:
        status = search.run(started + time_limit, threads)
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

    def run(self, deadline: float, threads: int | None) -> str:
        """Solve until the best is proved, the time is up, or someone interrupts; the status."""
        program = _Program(self.merged, threads)
        while True:
            left = deadline - time.perf_counter()
            if left <= 0:
                return "time_limit"
            chosen, bound, ended = program.solve(left, self.best)
            if ended == "infeasible":  # cannot be, and says nothing about what is best
                return "feasible"
            self._take_bound(bound)
            if chosen is not None:
                self._take(chosen)
            if ended != "optimal" or self.is_proved:
                return ended if ended != "optimal" else "feasible"
            if chosen is None or not program.forbid(chosen):
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
        # Weights as parts of the whole, on average 1 a face: solvers like numbers near 1.
        total = max(1, int(merged.quanta.sum()))
        self.weights = merged.quanta.astype(np.float64) * (merged.n_faces / total)
        self.solver = highspy.Highs()
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
        self.solver.passModel(self._model(optional))
        self.solver.HandleUserInterrupt = True

    def solve(self, seconds: float, start: set[int]) -> tuple[set[int] | None, float, str]:
        """The chosen candidates, if any were found, the bound, and how it ended."""
        solver = self.solver
        solver.setOptionValue("time_limit", solver.getRunTime() + seconds)
        solution = self.highspy.HighsSolution()
        solution.col_value = self._columns_of(start)
        solver.setSolution(solution)
        interrupted = False
        solver.startSolve()
        while True:
            try:
                done, _ = solver.wait(POLL)
                if done:
                    break
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
        bound = info.mip_dual_bound
        if self.is_best_coverage:
            bound /= max(1, self.merged.n_faces)
        return chosen, float(bound), "interrupted" if interrupted else ended

    def forbid(self, chosen: set[int]) -> int:
        """Rows that the faces lack which only look covered by these cameras; how many."""
        merged = self.merged
        if not merged.is_spread:
            return 0
        is_chosen = np.zeros(merged.n_candidates, bool)
        is_chosen[list(chosen)] = True
        starts, columns = kernels.missing_directions(
            merged.starts, merged.covering, is_chosen, self.views, merged.eyes,
            merged.centroids, merged.min_cosine,
        )  # fmt: skip
        faces = np.flatnonzero(np.diff(starts) > 0)
        for face in faces:  # a call each, microseconds
            row = columns[starts[face] : starts[face + 1]].astype(np.int32)
            values, least = np.ones(len(row)), 1.0
            if self.column_of_face[face] >= 0:
                row = np.append(row, np.int32(self.column_of_face[face]))
                values, least = np.append(values, -1.0), 0.0
            self.solver.addRow(least, self.highspy.kHighsInf, len(row), row, values)
        return len(faces)

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

    def _model(self, optional: IntArray) -> Any:
        """The program as HiGHS takes it, row by row: faces, then the limits of the goal."""
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

        model = highspy.HighsLp()
        model.num_col_, model.num_row_ = self.n_columns, sum(map(len, lower))
        model.sense_ = (
            highspy.ObjSense.kMaximize if self.is_best_coverage else highspy.ObjSense.kMinimize
        )
        model.col_cost_ = cost
        model.col_lower_, model.col_upper_ = np.zeros(self.n_columns), np.ones(self.n_columns)
        model.row_lower_, model.row_upper_ = np.concatenate(lower), np.concatenate(upper)
        matrix = model.a_matrix_
        matrix.format_ = highspy.MatrixFormat.kRowwise
        counts = np.concatenate(n_entries)
        matrix.start_ = np.concatenate(([0], np.cumsum(counts))).astype(np.int32)
        matrix.index_ = np.concatenate([row[0] for row in rows]).astype(np.int32)
        matrix.value_ = np.concatenate([row[1] for row in rows]).astype(np.float64)
        # With one view a face, z is whole by itself where x is.
        integer, continuous = highspy.HighsVarType.kInteger, highspy.HighsVarType.kContinuous
        needs_whole = (self.views[optional] > 1) | merged.is_spread
        model.integrality_ = [integer] * n_candidates + [
            integer if whole else continuous for whole in needs_whole
        ]
        return model
