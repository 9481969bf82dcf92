"""Execution of a plan, `rastercov place`.

    plan -> scene -> candidates -> matrix -> selection -> search, refinement -> uncovered faces

The selection is saved before any step that may improve it. Where the result is by area, cameras
are selected and moved on cells of the surface, and the network is measured by its exact area.
"""

import logging
import math
import time
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from rastercov.advice.headline import GoalChange
from rastercov.base import (
    ByName,
    ConfigError,
    FloatArray,
    InNotebook,
    InOneLine,
    IntArray,
    PoseError,
    frozen_record,
    hooks_of,
)
from rastercov.base.output import own_place
from rastercov.core.area.network import AreaNetwork, unit_of_result
from rastercov.core.area.regions import RegionPass
from rastercov.core.camera import (
    Poses,
    Views,
    is_joint,
    led_by,
    names_by_origin,
    names_of_poses,
    renumber,
    unit_warnings,
)
from rastercov.core.coverage.task import Engine
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.arrays import frozen
from rastercov.core.mesh.groups import list_names
from rastercov.formats.cameras import read_views
from rastercov.placement.candidates.pool import Refusal
from rastercov.placement.improve.objective import Objective
from rastercov.placement.improve.refine import INTERRUPTED, Optimised, Refined, optimise, refine
from rastercov.placement.plan.check import (
    Checked,
    CheckedGoals,
    PlacedCameras,
    best_change,
    plan_of_cameras,
)
from rastercov.placement.plan.fewer import sets_in_reach
from rastercov.placement.plan.file import NO_CAMERA, Plan, PlanError, PlanFeature, errors_at
from rastercov.placement.plan.generators import PoseFile
from rastercov.placement.plan.goals import (
    Objectives,
    OwnGoal,
    open_objectives,
    permits_of,
    place_of,
    requirements_of,
    separate_goals,
)
from rastercov.placement.plan.network import (
    CellRequirement,
    Measured,
    Requirement,
    classify_areas,
    classify_network,
    find_uncovered,
    limits_of,
    measure_network,
    most_views,
    of_plan,
    seeable_areas,
    summary_of,
    views_by_group,
    warnings_of,
    whole_faces,
    with_areas,
)
from rastercov.placement.plan.phases import CarriedPoses, Carrier, Product, carriers, phases_of
from rastercov.placement.plan.prepare import (
    Clock,
    PlanJob,
    Prepared,
    Step,
    cells_of,
    faces_with,
    prepare,
    quiet,
    sample_candidates,
)
from rastercov.placement.plan.scene import CandidatePool, name_scene
from rastercov.placement.plan.sections import AllSelection, FewestSelection
from rastercov.placement.plan.shortfall import (
    MOST_PAIRS,
    area_of_all,
    shortfall,
    views_for_zones,
    ways,
)
from rastercov.placement.required import HOLDS
from rastercov.placement.select.methods import select_by
from rastercov.placement.select.problem import FewestCameras, Problem, Selection, curve_of, finish
from rastercov.placement.uncovered import Leftover
from rastercov.shards import Progress, Workers, silent

LOG = logging.getLogger("rastercov")
MOST_TRIED = 16
"""Sets of fewer cameras whose exact area is computed, the best by their bounds."""
RAISES = 8
"""Times that the share to cover on half cells is raised where the exact area falls short of it."""
ROUNDING = 1e-9
"""Share of the area by which unions of the same regions in other orders differ at most."""


@frozen_record
class Choice:
    """Selection among candidates for cameras whose poses are known, by `Products.choose`.

    Attributes
    ----------
    plan : Plan
        That of the cameras with what is chosen.
    pool : CandidatePool
        Places of it.
    problem, selection : Problem, Selection
        Cells that single candidates do enough for, and the chosen ones.
    """

    plan: Plan
    pool: CandidatePool
    problem: Problem
    selection: Selection

    @property
    def pairs(self) -> int:
        """Pairs of candidate and cell that it does enough for."""
        bits = self.problem.bits
        return sum(len(bits.faces_of(row)) for row in range(bits.n_rows))

    @property
    def chosen(self) -> list[int]:
        """The chosen candidates."""
        return [*map(int, self.selection.chosen)]

    @abstractmethod
    def summary(self) -> ByName:
        """The choice, and figures, ready for JSON."""

    @abstractmethod
    def lines(self) -> list[str]:
        """The choice for people."""

    @abstractmethod
    def table(self) -> tuple[Sequence[str], list[list[str]]]:
        """Heads and lines of a table of what is chosen."""


@frozen_record(repr=False)
class Placement(InOneLine, InNotebook):
    """Placed cameras with their results, as `rastercov.place` returns them.

    Results of optional steps are None unless the plan has the step.

    Attributes
    ----------
    prepared : Prepared
        The plan with its mesh, candidates and selection problem.
    selection : Selection
        Choice among the candidates, with its bound.
    cameras : Measured
        The placed cameras: the selection, or its refinement, and what they cover.
    origin : tuple of str
        Source of each camera, such as the generator of its candidate.
    requirements : tuple of Requirement
        Required shares of the whole task and of groups; empty for a goal "best_coverage".
    optimised, refined, leftover : Optimised, Refined and Leftover, or None
        Results of the search, the refinement, and the analysis of uncovered faces.
    steps : dict of str to float
        Time of each step, seconds.
    interrupted : str
        Step that Ctrl-C ended, or "".
    kept_poses : tuple of str
        Improvements on patches, "searched" or "refined", that were not adopted because they would
        have lost exact area.
    left_out : tuple of int
        Rows of the selection whose cameras or rigs were left out, because they added nothing after
        refinement, or because a goal of a moving scene is met without them.
    carried : Carried or None
        The network as it is carried, if something carries the cameras.
    choices : dict of str to Choice
        Choices among the candidates of equipment, by its name.
    made : dict of str to Product
        Results of steps of features, by the name of the step.
    withheld : list of list of Refusal
        For each of the first dead zones, rejected views that would cover half of it.
    is_least : bool
        True if it is proved that no fewer candidates reach the goal in exact area.
    certified : AreaNetwork or None
        Exact covered area of cameras that were chosen by samples of faces.
    """

    prepared: Prepared
    selection: Selection
    cameras: Measured
    origin: tuple[str, ...]
    requirements: tuple[Requirement, ...]
    optimised: Optimised | None = None
    refined: Refined | None = None
    leftover: Leftover | None = None
    steps: dict[str, float] = field(default_factory=dict)
    interrupted: str = ""
    kept_poses: tuple[str, ...] = ()
    left_out: tuple[int, ...] = ()
    carried: CarriedPoses | None = None
    choices: Mapping[str, Choice] = field(default_factory=dict)
    made: Mapping[str, Product] = field(default_factory=dict)
    withheld: list[list[Refusal]] = field(default_factory=list)
    is_least: bool = False
    certified: AreaNetwork | None = None

    @property
    def proved_on(self) -> str | None:
        """Basis on which the optimum is proved: "exact area", "patches" or "faces"; or None."""
        if self.selection.status != "optimal":
            return None
        on = "faces" if self.prepared.cells is None else "patches"
        return "exact area" if self.is_least else on

    @cached_property
    def doubts(self) -> list[str]:
        """Warnings about likely mistakes in the input."""
        plan, prepared = self.prepared.plan, self.prepared
        if not len(self.cameras.placed):  # nothing is covered from any candidate
            return of_plan(unit_warnings(prepared.mesh, plan.rig, prepared.pool.candidates.placed))
        return warnings_of(plan, self.cameras)

    @cached_property
    def goals(self) -> Mapping[str, Checked]:
        """Check of each goal of the plan by its name; none of an interrupted placement."""
        plan, scene = self.prepared.plan, self.prepared.scene
        if not plan.goals or self.interrupted or scene is None:
            return {}
        return CheckedGoals(separate_goals(plan, scene)[1], self.cameras.placed, self.names)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the placed cameras."""
        of_rows = names_by_origin([self.origin[row] for row in self.cameras.owner])
        return names_of_poses(self.cameras.placed, of_rows)

    @cached_property
    def best_change(self) -> GoalChange | None:
        """As of `check.best_change`."""
        plan, mesh = self.prepared.plan, self.prepared.mesh
        task, views = plan.build_task(most_views(plan, None)), plan.task.views
        placed = PlacedCameras(mesh, plan.rig, self.cameras.placed, task, views)
        return best_change(self.requirements, self.goals, placed, summary_of(plan, self.cameras))

    @property
    def chosen(self) -> IntArray:
        """Indices of the candidates of the placed cameras or rigs."""
        return np.delete(self.selection.chosen, self.left_out)

    @cached_property
    def products(self) -> list[Product]:
        """Products of features for the placed cameras, such as a flight along them."""
        made = (each.of(self) for each in hooks_of(Products))
        return [each for each in made if each is not None]

    def product(self, word: str) -> Product | None:
        """One of them, or of `made`, by its word, if it is made."""
        every = (*self.made.values(), *self.products)
        return next((each for each in every if each.word == word), None)

    @property
    def is_met(self) -> bool:
        """True if every requirement holds."""
        return all(each.status == HOLDS for each in self.requirements)

    @property
    def worth(self) -> tuple[float, float]:
        """Rank among placements of a plan: what its requirements lack, less than 0, then share."""
        return -sum(each.lack for each in self.requirements), self.cameras.share


Work = Callable[[Placement, Objectives, Progress], Placement]
Improvement = tuple[str, Callable[[Placement], object], Work]
"""Name of a step after the selection, whether a placement asks for it, and its function."""


class Products(PlanFeature):
    """Hooks of a feature that makes something of placed cameras, or chooses places of its own."""

    steps: Sequence[Improvement] = ()
    """Steps that add to `Placement.made`, by their names."""

    def check_before(self, plan: Plan) -> None:
        """ConfigError for what cannot be made, before the work."""

    def check_scene(self, plan: Plan, mesh: Mesh) -> None:
        """PlanError for what cannot be made in a scene."""

    def of(self, placement: Placement) -> Product | None:
        """The product without a step, where the plan asks for it."""

    def choose(self, job: "Run", plan: Plan, eyes: Poses | None) -> Placement:
        """Choice for cameras that are there; with cameras, too, for None."""
        raise NotImplementedError  # each feature with a word has its own


def place(
    plan: Plan,
    folder: Path | None,
    step: Step = quiet,
    save: Callable[[Placement], None] = lambda placement: None,
    workers: Workers | None = None,
) -> Placement:
    """Carry out a plan.

    An interrupt (Ctrl-C) before the selection is raised; finished shards of the matrix are kept.
    Later it ends the run with the results so far, those of a search or a refinement included, and
    `Placement.interrupted` names the step.

    One run at a time may use a folder; the caller holds its lock (`ReportFolder`).

    Parameters
    ----------
    plan : Plan
        With candidates and a selection.
    folder : Path, optional
        Folder of the matrix, made when it is missing; None holds it in memory.
    step : callable
        Called with the name of each step; a context manager that yields its progress.
    save : callable
        Called with the results so far before each step after the selection, with the name of the
        step as `Placement.interrupted`: the saved state is then right if the run is killed.
    workers : Workers, optional
        Processes that measure the candidates; this one unless given.

    Raises
    ------
    PlanError
        For a plan without candidates or selection, or one that does not fit its meshes.
    ConfigError
        If no candidate remains.
    """
    chooser = next((each for each in hooks_of(Products) if each.is_chosen(plan)), None)
    beside = "" if chooser is None else chooser.word
    is_there = plan.existing or any(each.is_of_cameras for each in plan.candidates)
    why = f"existing: expected cameras for {beside}, got none; give poses, or candidates of cameras"
    why = why if beside else "candidates: expected one entry or more, got none; add one"
    missing = [] if is_there else [why]
    missing += [] if plan.has_cameras or plan.existing else [NO_CAMERA]
    missing += [] if plan.selection else ["selection: expected a goal, got none; add one"]
    if missing:
        raise PlanError(plan.name, missing)
    eyes: Poses | None = None
    if plan.existing is not None:
        try:
            views = read_views(plan.folder / plan.existing.file)
            plan, given = plan_of_cameras(plan, views)
        except PoseError as error:
            why = str(error).partition(", or choose")[0]
            raise PlanError(plan.name, f"existing: {why}") from None
        if plan._stated:
            raise PlanError(
                plan.name,
                "existing: expected cameras of the plan, got another of the same name; rename it",
            )
        given.check_cameras(len(plan.rig))
        eyes = renumber(given)
        if plan.chooses_cameras:
            plan, eyes = _with_existing(plan, eyes, views), None
    _check_goals(plan)
    _check_before_work(plan)
    clock = Clock(step)
    with clock("scene"):
        whole, plan, _ = name_scene(plan)
        mesh, goals = separate_goals(plan, whole)
    for each in hooks_of(Products):
        each.check_scene(plan, mesh)
    job = Run(mesh, folder, clock, save, workers, whole, goals)
    if chooser is None:
        return job.cameras(plan, (*own_steps(), *last_steps()))
    chosen = chooser.choose(job, plan, eyes)
    if chosen.interrupted:
        return chosen
    with open_objectives(chosen.prepared.plan, mesh, chosen.prepared.cells) as objectives:
        return job.improve(chosen, objectives, last_steps())


def _with_existing(plan: Plan, given: Poses, views: Views) -> Plan:
    """The plan with existing cameras; PlanError for one to move that is not there."""
    assert plan.existing is not None
    with errors_at(plan.name, "existing", PoseError):
        mounted, owner = plan.mounts.mounted(given)
    if len(views.poses) < len(given):  # of rigs
        given = mounted = renumber(mounted)
        owner = given.ids
    names = names_of_poses(given, views.images)
    rows = {each: row for row, name in enumerate(names) for each in (row, name)}
    for row, each in enumerate(plan.existing.move):
        if each not in rows:
            known = f"{len(given)} cameras" + (
                f" ({list_names(names, str(each))})" if views.images else ""
            )
            raise PlanError(
                plan.name,
                f"existing.move[{row}]: expected one of {known}, got {each!r}; correct it",
            )
    moves = np.isin(np.arange(len(mounted)), owner[[rows[each] for each in plan.existing.move]])
    return plan.with_there(mounted[moves.argsort(kind="stable")], int((~moves).sum()))


def _check_before_work(plan: Plan) -> None:
    """Errors of thresholds, pose files of candidates and products, which come late without this."""
    plan.build_task()
    for row, each in enumerate(plan.candidates):
        if isinstance(entry := getattr(each, "of", each), PoseFile):
            with errors_at(plan.name, f"candidates[{row}]"):
                read_views(plan.folder / entry.file)
    for hooks in hooks_of(Products):
        hooks.check_before(plan)


def _check_goals(plan: Plan) -> None:
    """PlanError for goals of their own that cameras cannot be chosen for."""
    if not plan.goals:
        return
    lines = []
    if not plan.is_still or not all(each.is_of_cameras for each in plan.candidates):
        lines.append("goals: expected only cameras in a static scene, got more; leave goals out")
    asked = plan.selection
    is_partial = getattr(asked, "of_reachable", False)
    for name, goal in plan.goals.items():
        if goal.coverage is not None and (is_partial or not isinstance(asked, FewestSelection)):
            wanted = 'goal = "fewest_cameras" without of_reachable'
            lines.append(
                f"goals.{name}.coverage: expected {wanted}, got "
                f"{'of_reachable' if is_partial else asked and asked.goal}; change selection"
            )
    if lines:
        raise PlanError(plan.name, lines)


@dataclass(frozen=True)
class Run:
    """The scene of a placement and the arguments of `place`."""

    mesh: Mesh
    folder: Path | None
    clock: Clock
    save: Callable[[Placement], None]
    workers: Workers | None
    whole: Mesh
    goals: Sequence[OwnGoal]

    def cameras(self, plan: Plan, steps: Sequence[Improvement]) -> Placement:
        """Cameras chosen among the candidates of a plan, after some steps."""
        with self.clock("scene"):
            selection, cells = plan.selection, cells_of(plan, self.mesh)
            assert selection is not None
            phases = phases_of(plan, self.mesh)
        folder = None if self.folder is None else own_place(self.folder / "matrix")
        job = PlanJob(plan, selection, self.whole, folder, self.clock, cells, self.workers, phases)
        with open_objectives(plan, self.mesh, cells, self.goals) as objectives:
            prepared = prepare(job, objectives)
            finder = None
            if objectives.cells is not None and phases is None:
                finder = objectives.cells.finder
                if _is_of_reachable(prepared):
                    with self.clock("area of all candidates") as progress:
                        reachable = area_of_all(prepared, finder, progress)
                    prepared = replace(prepared, reachable=reachable)
            if is_lowered(prepared):
                prepared = _with_shortfall(prepared, finder, self.clock)
            with self.clock("selection"):
                chosen = _select(prepared)
            placement = _make_placement(prepared, chosen, objectives, self.clock.seconds)
            return self.improve(placement, objectives, steps)

    def improve(
        self, placement: Placement, objectives: Objectives, steps: Sequence[Improvement]
    ) -> Placement:
        """The placement after the steps that it asks for."""
        for name, is_asked, work in steps:
            if placement.interrupted:
                break
            if not is_asked(placement):
                continue
            try:
                self.save(replace(placement, interrupted=name))
                with self.clock(name) as progress:
                    placement = _as_proved(work(placement, objectives, progress))
            except KeyboardInterrupt:
                placement = replace(placement, interrupted=name)
        return placement


def _select(
    prepared: Prepared, seconds: float | None = None, bound: float | None = None
) -> Selection:
    """Selection of a problem, with the cameras that stay, which cost nothing.

    `bound` is that of the plan where the problem is a stricter one, whose optimum proves nothing.
    """
    if isinstance(prepared.selection, AllSelection):
        every = np.setdiff1d(np.arange(prepared.problem.n_candidates), prepared.barred)
        selection = finish("all", prepared.problem, every, 0.0, 0.0)
        return replace(selection, chosen=every, curve=curve_of(prepared.problem, every))
    selection = select_by(prepared.selection, prepared.problem, seconds)
    missing = np.setdiff1d(np.arange(prepared.plan.n_given), selection.chosen)
    if bound is None and prepared.of_mean:  # any other goal may need less, or cover more
        is_fewest = isinstance(prepared.problem.goal, FewestCameras)
        bound = float(prepared.problem.costs.min()) if is_fewest else 1.0
    if bound is None and not len(missing):
        return selection
    is_proved = bound is None or selection.status != "optimal"
    return finish(
        selection.method,
        prepared.problem,
        np.concatenate((selection.chosen, missing)),
        selection.bound if bound is None else bound,
        selection.seconds,
        selection.status if is_proved else "feasible",
    )


def _as_proved(placement: Placement) -> Placement:
    """The placement without an optimum on cells that does not meet the goals of the plan."""
    chosen = placement.selection
    if placement.is_met or chosen.status != "optimal" or is_lowered(placement.prepared):
        return placement
    return replace(placement, selection=replace(chosen, status="feasible"))


def _make_placement(
    prepared: Prepared, chosen: Selection, objectives: Objectives, steps: dict[str, float]
) -> Placement:
    """The network of a selection, measured by face."""
    left, rows = prepared.pool.candidates, chosen.chosen
    # Beside cameras that stay, those of the problem count cameras.
    chosen = replace(chosen, cost=float(np.sort(prepared.pool.costs[rows]).sum()))
    cameras, requirements = measure_by_face(prepared, left.placed[rows], objectives)
    return Placement(
        prepared=prepared,
        selection=chosen,
        cameras=cameras,
        origin=tuple(
            source if index < 0 else f"{source} {index}"
            for source, index in zip(left.source[rows].tolist(), left.index[rows], strict=True)
        ),
        requirements=requirements,
        steps=steps,
        interrupted="selection" if chosen.status == "interrupted" else "",
    )


def measure_by_face(
    prepared: Prepared, mounted: Poses, objectives: Objectives
) -> tuple[Measured, tuple[Requirement, ...]]:
    """Cameras or rigs measured by face, and the requirements of a plan by face."""
    cameras = measure_network(objectives.faces, mounted)
    seeable_areas(prepared.plan, cameras.network)  # refuses cameras that see into bodies
    is_part = _is_of_reachable(prepared) and prepared.cells is None
    reachable = prepared.problem.reachable if is_part else None
    weights, limits = objectives.faces.integer_weights, limits_of(prepared.selection)
    required = classify_network(
        prepared.mesh, weights, limits, cameras.covered, reachable=reachable
    )
    goals = [each.goal for each in objectives.goals]
    of_goals = requirements_of(goals, cameras.placed, quiet)
    return cameras, (*required, *of_goals.values())


def _by_area(
    placement: Placement,
    objectives: Objectives,
    progress: Progress = silent,
) -> Placement:
    """The placement with the exact area of its network, and requirements by it.

    Shares of what all candidates cover are judged on cells where the exact area of all candidates
    is not known.
    """
    assert objectives.cells is not None
    prepared, on_cells = placement.prepared, objectives.cells
    plan, limits = prepared.plan, limits_of(prepared.selection)
    carried: CarriedPoses | None = None
    if prepared.carrier is not None:
        cameras, carried = _measure_carried(placement, prepared.carrier, on_cells.finder)
    elif (phases := prepared.phases) is None:
        finder = on_cells.finder
        cameras = with_areas(plan, placement.cameras, finder, None, progress, has_curve=True)
    else:
        placed = placement.cameras.placed
        areas = phases.areas(plan.rig, placed, plan.build_task())
        counts = range(1, len(led_by(plan.rig, placed)) + 1)
        shares = [phases.first(areas, count).summary()["percent"] / 100 for count in counts]
        curve = np.array(shares, np.float64)
        cameras = replace(placement.cameras, areas=areas, curve=curve, share=[0.0, *shares][-1])
    assert cameras.areas is not None
    of_goals = tuple(each for each in placement.requirements if each.goal)
    pairs = zip(objectives.goals, of_goals, strict=True)
    permits = permits_of([(own.goal, each.high) for own, each in pairs])
    cameras.areas.allowed = prepared.allowed._replace(permits=permits, adds_only=bool(plan.goals))
    if not prepared.problem.reachable.any() and not len(cameras.placed):
        cameras.areas.instead = sample_candidates(plan, prepared.eligible)
    required: tuple[Requirement, ...]
    if _is_of_reachable(prepared) and prepared.reachable is None:
        problem, covers = prepared.problem, on_cells.covers(cameras.mounted)
        covered = on_cells.covered(covers, on_cells.eyes(cameras.mounted))
        cells, reachable = on_cells.elements, problem.reachable
        result = classify_network(
            cells, problem.integer_weights, limits, covered, reachable=reachable
        )
        required = tuple(CellRequirement(**asdict(each)) for each in result)
    else:
        seeable = seeable_areas(plan, cameras.network, cameras.areas)
        required = classify_areas(
            cameras.areas, limits, plan.task.views, prepared.reachable, seeable=seeable
        )
    return replace(placement, cameras=cameras, requirements=(*required, *of_goals), carried=carried)


def _measure_carried(
    placement: Placement, own: Carrier, finder: RegionPass
) -> tuple[Measured, CarriedPoses]:
    """The network with its exact area, as each camera sees the scene and what carries it."""
    plan, known = placement.prepared.plan, placement.carried
    joints = None if known is None else known.joints
    parts, carried = own.measure(finder, placement.cameras.mounted, joints)
    areas, curve = AreaNetwork(finder.mesh, finder.task), [0.0]
    for part, count in zip(parts, np.bincount(placement.cameras.owner), strict=True):
        areas.add(part)
        curve += [curve[-1]] * int(count - 1)
        curve.append(areas.summary(views_by_group(plan, None))["percent"] / 100)
    covered = whole_faces(areas, plan.task.views)
    placement.cameras.network.is_covered = covered
    cameras = replace(
        placement.cameras,
        areas=areas,
        curve=np.array(curve[1:]),
        share=curve[-1],
        covered=covered,
        certain=covered,
        possible=covered,
    )
    return cameras, carried


def _look_past_carrier(
    placement: Placement, objectives: Objectives, progress: Progress
) -> Placement:
    """The placement with other candidates for those whose images the carrier hides too much of.

    A candidate that no solution of its pose frees is left out, and cameras are selected anew, a few
    times. The best of all is kept, as the carrier is in the figures of each.
    """
    areas = best = placement
    for tried in range(RAISES):
        if not _is_hidden(areas) or areas.carried is None:
            break
        progress(tried, RAISES)
        try:
            prepared = areas.prepared.without(areas.chosen[areas.carried.is_hidden])
        except ConfigError:  # the rest does not reach the goal
            break
        chosen = _select(prepared, bound=placement.selection.bound)
        areas = _make_placement(prepared, chosen, objectives, placement.steps)
        areas = _by_area(areas, objectives)
        best = max(best, areas, key=lambda each: each.worth)
    if best.carried is None or not _is_hidden(best):
        return best
    notes = (*best.prepared.notes, best.carried.hides())
    return replace(best, prepared=replace(best.prepared, notes=notes))


def _is_hidden(placement: Placement) -> bool:
    """True where what carries a camera hides too much of its image."""
    return placement.carried is not None and bool(placement.carried.is_hidden.any())


def _is_of_reachable(prepared: Prepared) -> bool:
    """True where the required shares are of what all candidates cover."""
    selection = prepared.selection
    return isinstance(selection, FewestSelection) and selection.of_reachable


def _with_shortfall(prepared: Prepared, finder: RegionPass | None, clock: Clock) -> Prepared:
    """With lines on a goal that cells do not reach, and what would reach it; said at once.

    `finder` is None where no area of all candidates is known.
    """
    result = None if finder is None else shortfall(prepared, finder, clock)
    lines = [*prepared.notes, *(result.lines if result else ())]
    for line in lines:
        LOG.warning(line)
    if result is None or finder is None:
        return prepared
    for line in ways(prepared, result, finder, clock):
        LOG.warning(line)
        lines.append(line)
    return replace(prepared, notes=tuple(lines), is_beyond=True)


def _is_short(placement: Placement) -> bool:
    """True where cells meet the goal of the plan, and the exact area of the network does not."""
    goal = placement.prepared.problem.goal
    return isinstance(goal, FewestCameras) and not placement.is_met


def _select_anew(placement: Placement, objectives: Objectives, progress: Progress) -> Placement:
    """The placement with cameras selected anew until its exact area meets the goal.

    Each time as much more of the cells is wanted as the area falls short. Where that does not help,
    it is that of all candidates that add area, or the placement that lacks least. The bound is of
    the goal of the plan, as it was at first.
    """
    areas = best = placement
    until = time.perf_counter() + placement.prepared.selection.time_limit
    for _ in range(RAISES):
        tighter = _raise_goals(areas)
        if tighter.problem.goal == areas.prepared.problem.goal:  # all that candidates reach
            break
        left = max(until - time.perf_counter(), 1.0)
        chosen = _select(tighter, left, placement.selection.bound)
        areas = _by_area(_make_placement(tighter, chosen, objectives, placement.steps), objectives)
        best = max(best, areas, key=lambda each: each.worth)
        if not _is_short(areas):
            return areas
    rest = _with_the_rest(best, objectives)
    return placement if is_lowered(placement.prepared) and not rest.is_met else rest


def _with_the_rest(placement: Placement, objectives: Objectives) -> Placement:
    """The placement with all other candidates that add exact area, if that meets the goal."""
    prepared, before = placement.prepared, placement.selection
    n_candidates, n_faces = prepared.problem.n_candidates, prepared.mesh.n_faces
    if prepared.phases or prepared.carrier or n_candidates * n_faces > MOST_PAIRS:
        return placement
    gone = [*placement.chosen, *prepared.barred, *prepared.quarantined]
    rows = np.append(before.chosen, np.setdiff1d(np.arange(n_candidates), gone))
    result = placement
    for _ in range(2):
        chosen = finish(before.method, prepared.problem, rows, before.bound, before.seconds)
        areas = _make_placement(prepared, chosen, objectives, placement.steps)
        areas = _by_area(areas, objectives)
        if not areas.is_met:
            break
        result, adds = areas, np.diff(areas.cameras.curve, prepend=0.0) > 0
        rows = chosen.chosen[np.unique(areas.cameras.owner[adds])]
    return result


def _within_limits(placement: Placement, objectives: Objectives, progress: Progress) -> Placement:
    """The placement within what goals permit, the best of those that are tried.

    Cameras that exceed a limit exceed it beside any others, so one of them must go: cameras are
    selected anew without each of them. Deeper ones are tried first, and those without the camera
    that covers most; once the goals are met, the least deep.
    """
    best, left = placement, _that_may_go(placement)
    is_fewest = isinstance(placement.prepared.problem.goal, FewestCameras)
    for tried in range(MOST_TRIED):
        progress(tried, MOST_TRIED)
        if not left or (best.is_met and best.selection.status == "optimal"):
            break
        sign = -1 if best.is_met else 1
        at = max(range(len(left)), key=lambda at: (sign * left[at][0], left[at][1]))
        *_, row, prepared = left.pop(at)
        try:
            prepared = prepared.without(np.array([row]))
        except ConfigError:  # the rest does not reach the goal
            continue
        chosen = _select(prepared, bound=placement.selection.bound)
        areas = _make_placement(prepared, chosen, objectives, placement.steps)
        areas = areas if objectives.cells is None else _by_area(areas, objectives)
        best = max(
            best,
            areas,
            key=lambda each: (each.worth[0], -each.selection.cost * is_fewest, each.worth[1]),
        )
        left += _that_may_go(areas)
    return best


def _that_may_go(placement: Placement) -> list[tuple[int, float, int, Prepared]]:
    """Cameras of which one must go for a goal of what is permitted, after how many others.

    With the share that each alone covers of it.
    """
    prepared, chosen = placement.prepared, placement.chosen
    for each in placement.requirements:
        if each.is_most and each.status != HOLDS:
            shares, depth = prepared.permitted[each.goal], len(prepared.barred)
            new = chosen[chosen >= prepared.plan.n_given].tolist()
            return [(depth, float(shares[row]), row, prepared) for row in new]
    return []


def _is_met_in_phases(placement: Placement) -> bool:
    """True where cameras are chosen for a goal over the phases of a scene, and meet it."""
    is_fewest = isinstance(placement.prepared.problem.goal, FewestCameras)
    return placement.prepared.phases is not None and is_fewest and placement.is_met


def _shortest(placement: Placement, objectives: Objectives, progress: Progress) -> Placement:
    """The placement with the first cameras or rigs that meet its goal.

    They are chosen on cells of each phase for all phases as a whole, which may need more.
    """
    prepared, cameras = placement.prepared, placement.cameras
    phases, areas, n = prepared.phases, cameras.areas, len(cameras.mounted)
    assert phases is not None
    assert areas is not None
    limits = limits_of(prepared.selection)
    of_row = cameras.owner[led_by(prepared.mounts.rig, cameras.placed)]
    for count in range(1, n):
        first = phases.first(areas, int(np.count_nonzero(of_row < count)))
        result = classify_areas(first, limits, 1, prepared.reachable)
        if all(each.status == HOLDS for each in result):
            shorter = _of_rows(placement, objectives, list(range(count)))
            return replace(shorter, left_out=tuple(range(count, n)))
        progress(count, n)
    return placement


def _may_be_fewer(placement: Placement) -> bool:
    """True where fewer candidates may reach a goal of exact area than one on cells."""
    prepared, plan = placement.prepared, placement.prepared.plan
    others = plan.goals, plan.mounts.has_rigs, plan.task.min_angle_deg, prepared.carrier
    is_simple = plan.task.weight_by == "area" and not any(others)
    costs = {*prepared.pool.costs[plan.n_given :].tolist()}
    is_asked = isinstance(prepared.selection, FewestSelection) and placement.is_met
    return (
        prepared.matrix is not None
        and is_asked
        and is_simple
        and len(costs) == 1
        and not _is_of_reachable(prepared)
    )


def _fewest(placement: Placement, objectives: Objectives, progress: Progress) -> Placement:
    """The placement with the fewest candidates whose exact area meets the goal, where it is found.

    One fewer is tried, and again, while few sets of that many may reach it by their bound.
    """
    prepared, before, best = placement.prepared, placement.selection, placement
    given = [*range(prepared.plan.n_given)]
    count = len(before.chosen) - len(given)

    def of(chosen: ArrayLike, bound: float) -> Selection:
        rows = np.array(chosen, np.int64)
        return finish(before.method, prepared.problem, rows, bound, before.seconds)

    while True:
        sets = sets_in_reach(prepared, count - 1) if count else []
        if sets is None:
            return best
        for tried, each in enumerate(sets[:MOST_TRIED]):
            progress(tried, MOST_TRIED)
            chosen = of([*given, *each], 0.0 if given else prepared.pool.costs[-1])
            areas = _by_area(
                _make_placement(prepared, chosen, objectives, placement.steps), objectives
            )
            if areas.is_met:
                best, count = areas, count - 1
                break
        else:
            if len(sets) > MOST_TRIED:
                return best
            return replace(best, selection=of(best.selection.chosen, math.inf), is_least=True)


def is_lowered(prepared: Prepared) -> bool:
    """True where cells do not reach the goal of a plan, and another took its place."""
    goal = prepared.problem.goal
    is_partial = isinstance(goal, FewestCameras) and goal.of_reachable
    return is_partial and not _is_of_reachable(prepared)


def _raise_goals(placement: Placement) -> Prepared:
    """The same task, with more to cover than now by as much as the exact area falls short.

    Goals on cells are raised from what the selection reaches, which may be more than they are: to
    raise them by less changes nothing. They end at what all candidates together reach.
    """
    prepared, problem = placement.prepared, placement.prepared.problem
    assert isinstance(problem.goal, FewestCameras)
    if is_lowered(prepared):
        goal = replace(problem.goal, coverage=1.0)
        return replace(prepared, problem=replace(problem, goal=goal))
    whole = problem.required[0].clip(1)
    now = problem.by_requirement(problem.covered_by(placement.selection.chosen)[1]) / whole
    most = problem.by_requirement(problem.reachable) / whole
    short = {
        place_of(each, problem): 1.05 * each.lack
        for each in placement.requirements
        if not each.is_most
    }
    shares = [
        max(share, float(min(reached + lack, limit))) if (lack := short.get(place)) else share
        for (place, share), reached, limit in zip(problem.wanted.items(), now, most, strict=True)
    ]
    groups = dict(zip(problem.places, shares[1:], strict=True))
    goal = replace(problem.goal, coverage=shares[0], groups=groups)
    return replace(prepared, problem=replace(problem, goal=goal))


def with_progress(objective: Objective, progress: Progress, total: int) -> Objective:
    """The objective, which reports its measured poses of a total."""
    done = 0
    progress(0, total)

    def watch(count: int) -> None:
        nonlocal done
        done += count
        progress(done, max(done, total))

    return replace(objective, watch=watch)


def _optimise(placement: Placement, objectives: Objectives, progress: Progress) -> Placement:
    prepared, asked = placement.prepared, placement.prepared.selection.optimise
    assert asked is not None
    start = placement.cameras.mounted.world_from_camera
    if not len(start):
        return placement
    result = optimise(
        with_progress(objectives.moved, progress, asked.budget),
        prepared.pool.space,
        len(start),
        budget=max(asked.budget, len(start)),
        seed=prepared.selection.seed,
        start=start,
        camera=placement.cameras.mounted.camera,
    )
    moved = _move_cameras(placement, objectives, result.poses, "searched")
    return replace(moved, optimised=result, interrupted="search" if result.is_interrupted else "")


def _refine(placement: Placement, objectives: Objectives, progress: Progress) -> Placement:
    selection, start = placement.prepared.selection, placement.cameras.mounted
    watched = with_progress(objectives.moved, progress, selection.refine_budget)
    budget, own = max(selection.refine_budget, len(start)), placement.prepared.carrier
    if own is not None and (carried := placement.carried) is not None:
        refinement, joints = own.refine(watched, start, carried.joints, budget)
        known = replace(placement, carried=carried.with_joints(joints))
        moved = _move_cameras(known, objectives, refinement.poses, "refined")
        if moved.cameras is placement.cameras:
            moved = replace(moved, carried=carried)
    else:
        space, seed = placement.prepared.pool.space, selection.seed
        stays = placement.chosen < len(placement.prepared.plan.there)
        refinement = refine(watched, space, start, budget=budget, seed=seed, fixed=stays)
        moved = _move_cameras(placement, objectives, refinement.poses, "refined")
    is_interrupted = refinement.status == INTERRUPTED
    if not is_interrupted:
        moved = _without_idle(moved, objectives)
    return replace(moved, refined=refinement, interrupted="refinement" if is_interrupted else "")


def _is_sampled(placement: Placement) -> bool:
    """True where cameras were chosen by samples, for a task that areas can be computed for."""
    plan, is_carried = placement.prepared.plan, placement.prepared.carrier is not None
    if plan.task.method != "sampled" or is_carried or not (plan.is_still and plan.chooses_cameras):
        return False
    return unit_of_result(None, plan.build_task(), Engine(), plan.rig)[0] == "area"


def _certify(placement: Placement, objectives: Objectives, progress: Progress) -> Placement:
    """The placement with the exact area of its cameras."""
    plan, mesh = placement.prepared.plan, placement.prepared.mesh
    with closing(RegionPass(mesh, plan.rig, plan.build_task(most_views(plan)))) as finder:
        areas = with_areas(plan, placement.cameras, finder, None, progress).areas
    return replace(placement, certified=areas)


def _without_idle(placement: Placement, objectives: Objectives) -> Placement:
    """The placement without the cameras or rigs that add nothing, one after the other.

    Those that stay are kept.

    By area, those that add no cell and no exact area. All goals take a number of cameras as the
    greatest. One camera is kept.
    """
    objective, rows = objectives.moved, list(range(len(placement.cameras.mounted)))
    poses, width = placement.cameras.mounted, objective.width
    covers, eyes = objective.covers(poses), objective.eyes(poses)

    def worth(chosen: list[int]) -> int:
        own = (np.array(chosen, np.int64)[:, None] * width + np.arange(width)).ravel()
        return int(objective.worth(objective.covered(covers[own], eyes[own])))

    all_of = worth(rows)
    may_go = placement.chosen >= placement.prepared.plan.n_given
    for row in reversed(np.flatnonzero(may_go).tolist()):  # the first cover most
        rest = [each for each in rows if each != row]
        if not rest or worth(rest) < all_of:
            continue
        of_rows = _of_rows(placement, objectives, [rows.index(each) for each in rest])
        loss = placement.cameras.share - of_rows.cameras.share
        if loss <= ROUNDING and of_rows.worth[0] >= placement.worth[0] - ROUNDING:
            placement, rows = replace(of_rows, left_out=(*placement.left_out, row)), rest
    return replace(placement, left_out=tuple(sorted(placement.left_out)))


def _of_rows(placement: Placement, objectives: Objectives, rows: list[int]) -> Placement:
    """The placement with some of its cameras or rigs."""
    mounted = placement.cameras.mounted[np.array(rows, np.int64)]
    return place_at(placement, objectives, mounted, [placement.origin[row] for row in rows])


def place_at(
    placement: Placement, objectives: Objectives, mounted: Poses, origin: Sequence[str]
) -> Placement:
    """The placement with other cameras or rigs, measured, each with its source."""
    cameras, required = measure_by_face(placement.prepared, mounted, objectives)
    copy = replace(placement, cameras=cameras, origin=tuple(origin), requirements=required)
    return copy if objectives.cells is None else _by_area(copy, objectives)


def _explain_uncovered(
    placement: Placement, objectives: Objectives, progress: Progress
) -> Placement:
    prepared, observer = placement.prepared, objectives.faces.observer
    bounds = None if len(prepared.barred) else prepared.bounds
    wanted = progress, prepared.measured, bounds, prepared.plan.task.views
    rest = find_uncovered(observer, placement.cameras, *wanted)
    if prepared.cells is not None and is_joint(prepared.mounts.rig):
        # Not faces that single cameras of a rig with a rule cover.
        is_covered = prepared.problem.bits.counts_up_to(1)[: len(prepared.cells)] > 0
        covering = faces_with(is_covered, prepared.cells).astype(np.int64)
        rest = replace(rest, n_covering=frozen(covering))
    areas, refused = placement.cameras.areas, prepared.pool.refused
    if areas is None or prepared.phases is not None or not prepared.plan.chooses_cameras:
        return replace(placement, leftover=rest)
    network = prepared.plan.rig, placement.cameras.placed, views_by_group(prepared.plan, None)
    areas.dead_zones(*network, progress)
    zones = areas.zones(*network)
    withheld = views_for_zones(prepared.mounts, areas.task, zones, refused)
    return replace(placement, leftover=rest, withheld=withheld)


def _move_cameras(
    placement: Placement, objectives: Objectives, poses: FloatArray, how: str
) -> Placement:
    """The placement with its cameras at new poses.

    Cameras stay where that loses a goal, or where moves that gain on cells lose in exact area.
    """
    before = placement.cameras.mounted.world_from_camera
    origin = [
        name if (old == new).all() else f"{name}, {how}"
        for name, old, new in zip(placement.origin, before, poses, strict=True)
    ]
    mounted = Poses.of(poses, camera=placement.cameras.mounted.camera)
    moved = place_at(placement, objectives, mounted, origin)
    if moved.worth < placement.worth:
        return replace(placement, kept_poses=(*placement.kept_poses, how))
    return moved


def own_steps() -> tuple[Improvement, ...]:
    """Steps after the selection, in their order; after them come `last_steps`."""
    return (
        ("area", lambda result: result.prepared.cells is not None, _by_area),
        *((each.key, _is_hidden, _look_past_carrier) for each in carriers()),
        (
            "stricter selection",
            lambda result: (
                result.cameras.areas and _is_short(result) and not result.prepared.is_beyond
            ),
            _select_anew,
        ),
        (
            "limits of goals",
            lambda result: any(
                each.is_most and each.status != HOLDS for each in result.requirements
            ),
            _within_limits,
        ),
        ("fewer cameras", _is_met_in_phases, _shortest),
        ("fewest by area", _may_be_fewer, _fewest),
        ("search", lambda result: result.prepared.selection.optimise, _optimise),
        ("refinement", lambda result: result.prepared.selection.refine, _refine),
        ("certified area", _is_sampled, _certify),
    )


def last_steps() -> list[Improvement]:
    """Steps that come after a `Choice`, where there is one: those of features, and reasons."""
    made = [step for each in hooks_of(Products) for step in each.steps]
    return [*made, ("uncovered faces", lambda result: True, _explain_uncovered)]
