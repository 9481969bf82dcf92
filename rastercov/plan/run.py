"""Execution of a plan, `rastercov place`.

    plan -> scene -> candidates -> matrix -> selection -> search, refinement -> uncovered faces

The selection is saved before any step that may improve it.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rastercov.placement.explain.uncovered import Leftover
from rastercov.placement.improve.objective import Objective
from rastercov.placement.improve.refine import BUDGET, INTERRUPTED, Refined, refine
from rastercov.placement.improve.search import Optimised, optimise
from rastercov.placement.improve.tolerance import InstallationError, Tolerance, tolerance
from rastercov.placement.select.greedy import select_greedy
from rastercov.placement.select.integer import select_integer
from rastercov.placement.select.problem import Problem
from rastercov.placement.select.selection import Selection
from rastercov.plan.entry import value_of
from rastercov.plan.errors import PlanError
from rastercov.plan.file import Plan
from rastercov.plan.network import Measured, areas_of, left_over, measured, observer_of
from rastercov.plan.prepare import Clock, Prepared, Progress, Step, prepare, quiet
from rastercov.plan.requirements import HOLDS, Requirement, counting, judge, limits_of
from rastercov.plan.scene import scene
from rastercov.plan.sections import FewestSelection, SelectionSection

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Placement:
    """A network of cameras with its results; those of later steps are None unless done.

    Attributes
    ----------
    cameras : Measured
        The network: the selection, or its refinement.
    origin : tuple of str
        Source of each camera.
    steps : dict of str to float
        Seconds of each step.
    interrupted : str
        Step that Ctrl-C ended, or "".
    """

    prepared: Prepared
    selection: Selection
    cameras: Measured
    origin: tuple[str, ...]
    requirements: tuple[Requirement, ...]
    optimised: Optimised | None = None
    refined: Refined | None = None
    tolerance: Tolerance | None = None
    leftover: Leftover | None = None
    steps: dict[str, float] = field(default_factory=dict)
    interrupted: str = ""

    @property
    def is_met(self) -> bool:
        """True where every requirement holds."""
        return all(each.status == HOLDS for each in self.requirements)


def place(
    plan: Plan,
    folder: Path,
    step: Step = quiet,
    save: Callable[[Placement], None] = lambda placement: None,
) -> Placement:
    """Carry out a plan.

    An interrupt (Ctrl-C) before the selection is raised; finished shards of the matrix are kept.
    Later it ends the run with the results so far, those of a search or a refinement included, and
    `Placement.interrupted` names the step.

    The folder is for one run at a time; the caller holds its lock (`ReportFolder`).

    Parameters
    ----------
    plan : Plan
        With candidates and a selection.
    folder : Path
        Folder of the matrix; made when it is missing.
    step : callable
        Called with the name of each step; a context manager that yields its progress.
    save : callable
        Called with the results so far before each step after the selection, with the name of the
        step as `Placement.interrupted`: the saved state is then right if the run is killed.

    Raises
    ------
    PlanError
        For a plan without candidates or selection, or one that does not fit its meshes.
    ConfigError
        When no candidate is left.
    """
    selection = plan.selection
    missing = [] if plan.candidates else ["candidates: missing; place needs one entry or more"]
    missing += [] if selection else ["selection: missing; place needs a goal"]
    if selection is None or missing:
        raise PlanError(plan.name, missing)
    clock = Clock(step)
    with clock("scene"):
        mesh, task = scene(plan), plan.build_task()
    with observer_of(plan, mesh) as observer:
        prepared = prepare(plan, selection, observer, task, folder / "matrix", clock)
        with clock("selection"):
            chosen = _select(prepared.problem, selection)
        objective = Objective.of(observer, task, **counting(plan.task))
        left, rows = prepared.pool.candidates, chosen.chosen
        cameras = measured(objective, left.poses[rows])
        placement = Placement(
            prepared=prepared,
            selection=chosen,
            cameras=cameras,
            origin=tuple(
                source if index < 0 else f"{source} {index}"
                for source, index in zip(left.source[rows], left.index[rows], strict=True)
            ),
            requirements=_required(prepared, cameras.covered),
            steps=clock.seconds,
            interrupted="selection" if chosen.status == "interrupted" else "",
        )
        for name, work in _later_steps(plan, selection):
            if placement.interrupted:
                break
            try:
                save(replace(placement, interrupted=name))
                with clock(name) as progress:
                    placement = work(placement, objective, progress)
            except KeyboardInterrupt:
                placement = replace(placement, interrupted=name)
    return placement


def _watched(objective: Objective, progress: Progress, total: int) -> Objective:
    """The objective, which reports its measured poses of a total."""
    done = 0
    progress(0, total)

    def watch(count: int) -> None:
        nonlocal done
        done += count
        progress(done, max(done, total))

    return replace(objective, watch=watch)


def _select(problem: Problem, selection: SelectionSection) -> Selection:
    if selection.method == "greedy":
        return select_greedy(problem, seed=selection.seed)
    return select_integer(problem, time_limit=selection.time_limit, seed=selection.seed)


def _required(prepared: Prepared, covered: BoolArray) -> tuple[Requirement, ...]:
    selection, problem = prepared.selection, prepared.problem
    is_partial = isinstance(selection, FewestSelection) and selection.of_reachable
    reachable = problem.reachable if is_partial else None
    limits = limits_of(selection)
    return judge(prepared.mesh, problem.integer_weights, limits, covered, reachable=reachable)


Work = Callable[[Placement, Objective, Progress], Placement]


def _later_steps(plan: Plan, selection: SelectionSection) -> Iterator[tuple[str, Work]]:
    """Name and function of each step after selection that the plan requests."""
    if selection.optimise is not None:
        yield "search", _optimise
    if selection.refine:
        yield "refinement", _refine
    if selection.tolerance is not None:
        yield "tolerance", _tolerate
    if plan.unit_of_result()[0] == "area":
        yield "area", _measure_area
    yield "what is left", _explain_uncovered


def _optimise(placement: Placement, objective: Objective, progress: Progress) -> Placement:
    prepared, asked = placement.prepared, placement.prepared.selection.optimise
    assert asked is not None
    start = placement.cameras.poses
    if not len(start):
        return placement
    found = optimise(
        _watched(objective, progress, asked.budget),
        prepared.pool.space,
        len(start),
        asked.method,
        budget=max(asked.budget, len(start)),
        population=asked.population,
        seed=prepared.selection.seed,
        candidates=prepared.pool.candidates.poses,
        start=start,
    )
    moved = _moved(placement, objective, found.poses, "searched")
    return replace(moved, optimised=found, interrupted="search" if found.is_interrupted else "")


def _refine(placement: Placement, objective: Objective, progress: Progress) -> Placement:
    found = refine(
        _watched(objective, progress, BUDGET),
        placement.prepared.pool.space,
        placement.cameras.poses,
        seed=placement.prepared.selection.seed,
    )
    moved = _moved(placement, objective, found.poses, "refined")
    is_interrupted = found.status == INTERRUPTED
    return replace(moved, refined=found, interrupted="refinement" if is_interrupted else "")


def _tolerate(placement: Placement, objective: Objective, progress: Progress) -> Placement:
    selection, poses = placement.prepared.selection, placement.cameras.poses
    asked = selection.tolerance
    assert asked is not None
    error = value_of(asked, InstallationError)
    watched = _watched(objective, progress, len(poses) * (asked.draws + 1))
    found = tolerance(watched, poses, error, draws=asked.draws, seed=selection.seed)
    return replace(placement, tolerance=found)


def _explain_uncovered(placement: Placement, objective: Objective, progress: Progress) -> Placement:
    prepared = placement.prepared
    leftover = left_over(
        objective.observer,
        placement.cameras,
        progress,
        prepared.pool.candidates.poses,
        prepared.bounds,
    )
    return replace(placement, leftover=leftover)


def _measure_area(placement: Placement, objective: Objective, progress: Progress) -> Placement:
    prepared, cameras = placement.prepared, placement.cameras
    areas = areas_of(prepared.plan, prepared.mesh, cameras.poses, progress=progress)
    return replace(placement, cameras=replace(cameras, areas=areas))


def _moved(placement: Placement, objective: Objective, poses: FloatArray, how: str) -> Placement:
    """The placement with its cameras at new poses."""
    before = placement.cameras.poses
    origin = [
        name if (old == new).all() else f"{name}, {how}"
        for name, old, new in zip(placement.origin, before, poses, strict=True)
    ]
    cameras = measured(objective, poses)
    requirements = _required(placement.prepared, cameras.covered)
    return replace(placement, cameras=cameras, origin=tuple(origin), requirements=requirements)
