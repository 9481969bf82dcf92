"""Candidates of a plan and their visibility matrix: the input of selection.

The visibility matrix is written to the disk as it is measured, so that an interrupted run can
continue. Its folder is named by a hash of all that it depends on.
"""

import hashlib
import json
import math
import re
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import field, replace
from functools import partial, reduce
from pathlib import Path
from typing import Any

import numpy as np

from rastercov.base import (
    BoolArray,
    ByName,
    ConfigError,
    FloatArray,
    IntArray,
    ResourceError,
    check_memory,
    frozen_record,
    name_file,
    percent,
    sort_order,
    suffix_of,
)
from rastercov.base.format import distance
from rastercov.base.locks import lock
from rastercov.base.output import is_own_folder, own_place
from rastercov.core.area.cells import Cells, cells, usual_size
from rastercov.core.area.features import unmet_lines
from rastercov.core.area.network import AreaNetwork
from rastercov.core.area.remedies import Allowed
from rastercov.core.area.stages import add_rows, failures_of_rows
from rastercov.core.area.zones import areas_by_reason
from rastercov.core.camera import Cameras, Poses, Rig, gates_of, renumber, unit_warnings
from rastercov.core.coverage.coverage import Observer, evaluate_batches, open_observer
from rastercov.core.coverage.network import engine_for
from rastercov.core.coverage.shards import INPUTS
from rastercov.core.coverage.task import NAMES, REASONS, TOO_FEW_VIEWS, Reason, Task, density_text
from rastercov.core.mesh import Mesh
from rastercov.placement.bits import n_words
from rastercov.placement.candidates.cavities import Openings, openings
from rastercov.placement.candidates.segments import Segmentation
from rastercov.placement.matrix import VisibilityMatrix, build_matrix
from rastercov.placement.matrix_folder import MatrixFolder, can_pack, describe, read_header
from rastercov.placement.mounts import Mounts
from rastercov.placement.plan.entries import no_limit
from rastercov.placement.plan.file import Plan, PlanError, errors_at
from rastercov.placement.plan.generators import PerCavity
from rastercov.placement.plan.goals import (
    NOTHING,
    OF_GOALS,
    OF_TASK,
    Objectives,
    WithGoals,
    permits_of,
    with_goals,
    without_candidates,
)
from rastercov.placement.plan.network import (
    OF,
    counting,
    goal_of,
    most_views,
    of_plan,
    views_by_group,
)
from rastercov.placement.plan.phases import Carrier, PlanPhases, carrier_of
from rastercov.placement.plan.scene import (
    CandidatePool,
    candidate_pool,
    filter_pool,
    framing_of,
    free_places,
    keep_outs,
    mounts_of_entry,
    places_of,
    places_of_candidates,
    segmentation_of,
)
from rastercov.placement.plan.sections import SelectionSection
from rastercov.placement.select.problem import (
    BestCoverage,
    FewestCameras,
    Problem,
    problem_of,
)
from rastercov.placement.uncovered import CandidateBounds
from rastercov.shards import Progress, Tally, Workers, silent
from rastercov.shards.store import remove, remove_halves

OF_CARRIED = "list links that may touch in 'allowed', move the base, "
"""Remedies where an arm carries the cameras."""
N_DIAGNOSED = 32
"""Number of candidates examined for the reason why none covers a face."""
N_OF_RULES = 256
"""Number of candidates of heads examined for the limit of a rule that none meets."""
OF_A_MATRIX = (
    "pairs/pairs-*.npz",
    "bounds/*.npz",
    "quarantine/shard-*.json",
    *INPUTS,
    "sha256/*.sha256",
)
"""Files of a matrix, see `matrix_folder`, in an order of removal that is safe to interrupt."""
STATES_UNIT = {".3mf", ".step", ".stp", ".ifc", ".asc", ".tif", ".tiff"}
"""Files that state their unit; most .dae do."""
FALLBACK_SHARE = 0.99
"""Share of the reachable weight to cover where a plan requires more than is reachable."""
MOST_LISTED_PAIRS = 50_000_000
"""Pairs up to which a matrix is held as lists in the memory."""
BYTES_A_PAIR = 16
"""Of lists: 8 for the matrix, 8 for the selection."""
MOST_VALUES = 20_000_000
"""Candidates times patches of a matrix that is kept: 80 MB as an array."""
Step = Callable[[str], Any]
"""Context manager by the name of a step, which yields its `Progress`."""


@contextmanager
def quiet(name: str) -> Iterator[Progress]:
    """Step without progress display."""
    yield silent


class Clock:
    """Timer of the steps."""

    def __init__(self, step: Step) -> None:
        self.step = step
        self.seconds: dict[str, float] = {}

    @contextmanager
    def __call__(self, name: str) -> Iterator[Progress]:
        """Time a step, even one that fails."""
        began = time.perf_counter()
        try:
            with self.step(name) as progress:
                yield progress
        finally:
            self.seconds[name] = time.perf_counter() - began


@frozen_record
class Prepared:
    """Input of a selection: a plan with its values and its candidates.

    Attributes
    ----------
    pool : CandidatePool
        Candidates, and counts of dropped ones.
    openings : Openings or None
        Accessibility of the faces that no other candidate covers.
    bounds : CandidateBounds
        Of the candidates that were measured in this run.
    pairs : int
        Candidate-face pairs in the visibility matrix, or candidate-cell pairs.
    measured_by : dict
        Method and device of the visibility matrix.
    problem : Problem
        With the goal of the plan, or the nearest one that can be reached.
    cells : Cells or None
        Elements of the problem where the result is by area; None for faces.
    reachable : AreaNetwork or None
        Exact area that all candidates together cover, where the plan asks for a share of it and it
        is affordable.
    phases : PlanPhases or None
        Where the scene has several.
    carrier : Carrier or None
        Where something carries the cameras.
    quarantined : mapping of int to str
        Candidates that kill the process that measures them, and its end.
    is_of_bits : bool
        True where the pairs of the matrix are bits on the disk, not lists in the memory.
    tally : Tally
        Time of the workers that measured candidates, where there were any.
    is_beyond : bool
        True where it is proved that all candidates together do not reach the goal of the plan.
    permitted : mapping of str to (C,) float64
        Share that each candidate may cover of what a goal permits up to a limit, by its name.
    barred : (N,) int64
        Candidates that no selection takes: they cover more than a goal permits.
    matrix : VisibilityMatrix or None
        That of a static scene, where it is small.
    scene : Mesh or None
        The mesh with the groups of goals.
    eligible : Poses
        Places of all candidates but those that kill the process that measures them and those that
        cover more than a goal permits. None where the candidates are of something else than
        cameras.
    permits : callable or None
        True for a camera and its pose that cover alone no more of goals than they permit.
    """

    plan: Plan
    selection: SelectionSection
    mesh: Mesh
    mounts: Mounts
    task: Task
    pool: CandidatePool
    segmentation: Segmentation | None
    openings: Openings | None
    bounds: CandidateBounds
    pairs: int
    measured_by: ByName
    problem: Problem
    notes: tuple[str, ...]
    cells: Cells | None = None
    reachable: AreaNetwork | None = None
    phases: PlanPhases | None = None
    carrier: Carrier | None = None
    quarantined: Mapping[int, str] = field(default_factory=dict)
    is_of_bits: bool = False
    tally: Tally = field(default_factory=Tally)
    is_beyond: bool = False
    permitted: Mapping[str, FloatArray] = field(default_factory=dict)
    barred: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    matrix: VisibilityMatrix | None = None
    scene: Mesh | None = None
    eligible: Poses = Poses.of(np.zeros((0, 4, 4)))
    permits: Callable[[Cameras, Poses], bool] | None = None

    def without(self, rows: IntArray) -> "Prepared":
        """The same without some candidates; ConfigError where the rest does not reach the goal."""
        problem = without_candidates(self.problem, rows)
        return replace(self, problem=problem, barred=np.union1d(self.barred, rows))

    @property
    def of_mean(self) -> str:
        """Words on a problem that is of the mean over phases; "" for another."""
        is_mean = self.phases and self.phases.is_mean(self.task)
        return ", on average over time" if is_mean else ""

    @property
    def noun(self) -> str:
        """Word for what is chosen and moved."""
        has_rule = bool(gates_of(self.plan.rig))
        return "head" if has_rule else "mount" if self.mounts.has_rigs else "camera"

    @property
    def measured(self) -> Poses:
        """Cameras of the eligible candidates: of "all candidates" in words."""
        return self.mounts.cameras(self.eligible)[0]

    @property
    def allowed(self) -> Allowed:
        """Cameras that advice may name: at places of candidates, where their carrier reaches."""
        candidates = self.pool.candidates
        kind = int(self.mounts.starts[candidates.placed.camera[0]])
        places = places_of_candidates(candidates.poses[:, :3, 3])
        free = partial(free_places, self.plan)
        own = Allowed(places, kind, permits=self.permits, free=free)
        if self.carrier is not None:
            return own._replace(reaches=self.carrier.reaches)
        return own._replace(further=places_of(self.plan, self.mesh))

    @property
    def camera(self) -> Rig:
        """All cameras with their names."""
        return self.mounts.rig


def cells_of(plan: Plan, mesh: Mesh) -> Cells | None:
    """Cells to choose cameras on; None where the plan counts faces.

    Raises
    ------
    PlanError
        For a size that gives too many cells, or one where faces are counted.
    """
    unit, reason = plan.unit_of_result()
    asked, where = plan.task.resolution_of_result, "task.resolution_of_result"
    if unit == "face":
        if asked is not None:
            raise PlanError(
                plan.name, f"{where}: expected a result by area, got one by face: {reason}"
            )
        return None
    with errors_at(plan.name, where, ResourceError):
        return cells(mesh, usual_size(mesh) if asked is None else asked)


@frozen_record
class PlanJob:
    """Plan and scene by which candidates are made, measured and chosen.

    Attributes
    ----------
    whole : Mesh
        The scene with the groups of goals, which candidates are for, too.
    folder : Path or None
        Of the matrices, each in a folder named by a hash of all that it depends on; in memory where
        there is none.
    """

    plan: Plan
    selection: SelectionSection
    whole: Mesh
    folder: Path | None
    clock: Clock
    cells: Cells | None = None
    workers: Workers | None = None
    phases: PlanPhases | None = None


def prepare(job: PlanJob, objectives: Objectives) -> Prepared:
    """Candidates and their visibility matrix, with those into cavities where the plan has them.

    The elements of the matrix are the cells where there are some, and the faces otherwise.
    """
    plan, observer, cells = job.plan, objectives.faces.observer, job.cells
    mesh, task = observer.mesh, objectives.faces.task
    carrier = carrier_of(plan, mesh)
    with job.clock("candidates"):
        segmentation = segmentation_of(plan, job.whole)
        with_cavities = candidate_pool(plan, job.whole)
    measuring = _Measuring(job, observer, task, CandidateBounds(mesh.n_faces, mesh.task_mask))
    notes: list[str] = []
    opened: Openings | None = None
    reachable: AreaNetwork | None = None
    if job.phases is None:
        matrix, problem = measuring.problem(
            "visibility matrix", with_cavities, with_cavities.candidates.placed
        )
        with_cavities, opened, into, line = _with_cavities(measuring, with_cavities, problem)
        if into is not None:
            matrix, problem = into
            notes.append(line)
    else:
        matrix, problem, reachable = _in_phases(measuring, with_cavities)
    _check_some(plan, mesh, with_cavities, carrier)
    if job.folder is not None:
        _forget(job.folder, measuring.used)
    notes += _notes_on(plan, matrix)
    n_notes = len(notes)
    together = _for_goal(job, objectives, problem, with_cavities)
    excluded = [*matrix.quarantined, *together.barred]
    rows = np.setdiff1d(np.arange(len(with_cavities.candidates)), excluded)
    left = with_cavities.candidates.placed[rows]
    notes += _of_rules(objectives, plan.mounts, left)
    is_none = not together.problem.reachable[: problem.n_faces].any()  # of the task
    if is_none and len(left) and len(notes) == n_notes:
        notes.append(_why_nothing(job, objectives, observer, left, task))
    # The lists of a large matrix are freed here: the problem has their bits.
    is_kept = cells and job.phases is None and matrix.n_poses * matrix.n_faces <= MOST_VALUES
    return Prepared(
        plan=plan,
        selection=job.selection,
        mesh=mesh,
        scene=job.whole,
        mounts=plan.mounts,
        task=task,
        pool=with_cavities,
        segmentation=segmentation,
        openings=opened,
        bounds=measuring.bounds,
        pairs=matrix.n_pairs,
        is_of_bits=is_large(plan, matrix),
        measured_by=matrix.header["measured_by"],
        problem=together.problem,
        notes=(*notes, *together.notes),
        cells=cells,
        reachable=reachable,
        phases=job.phases,
        carrier=carrier,
        quarantined=matrix.quarantined,
        tally=measuring.tally,
        permitted=together.shares,
        barred=together.barred,
        matrix=matrix if is_kept else None,
        eligible=left,
        permits=permits_of([(each.goal, 0.0) for each in objectives.goals]),
    )


def _check_some(
    plan: Plan, mesh: Mesh, candidate_pool: CandidatePool, carrier: Carrier | None
) -> None:
    """Raise `ConfigError` where no candidate is left."""
    if len(candidate_pool.candidates):
        return
    reach = no_limit(plan.constraints.stand_off)[1]
    places, _ = plan.mounts.cameras(candidate_pool.proposed.placed)
    lines = unit_warnings(mesh, plan.rig, places, reach) if _has_open_unit(plan) else []
    raise ConfigError(
        f"{plan.name}: expected candidates, got none ({'; '.join(candidate_pool.lines())}); "
        f"relax constraints, {OF_CARRIED if carrier else ''}or add candidates"
        f"{''.join(f'; {line}' for line in of_plan(lines))}"
    )


@frozen_record
class _Measuring:
    """Matrices of candidates, one after the other.

    Attributes
    ----------
    used : list of Path
        Folders of the matrices so far, which are `parts`.
    """

    job: PlanJob
    observer: Observer
    task: Task
    bounds: CandidateBounds
    tally: Tally = field(default_factory=Tally)
    used: list[Path] = field(default_factory=list)
    parts: list[VisibilityMatrix] = field(default_factory=list)

    @property
    def counted(self) -> ByName:
        """Arguments of `problem_of`."""
        return counting(self.job.plan.task) | {"mounts": self.job.plan.mounts}

    def problem(
        self, name: str, candidate_pool: CandidatePool, poses: Poses
    ) -> tuple[VisibilityMatrix, Problem]:
        """Matrix of candidates, of which these poses are new, and their problem without a goal."""
        job, observer, task, mounts = self.job, self.observer, self.task, self.job.plan.mounts
        options: ByName = {"cells": job.cells, "bounds": self.bounds, "mounts": mounts}
        asked = job.plan.engine
        with ExitStack() as step:
            engine, scene = asked, (observer.mesh, observer.camera)
            if not mounts.has_rigs:
                engine = engine_for(asked, *scene, task, len(poses))
            if engine != asked:
                observer = step.enter_context(open_observer(*scene, engine))
            options["bits"] = bits = can_pack(observer, poses, task, job.cells, mounts)
            options["progress"] = step.enter_context(job.clock(name))
            if job.folder is not None and len(poses):
                described = describe(observer, poses, task, None, job.cells, mounts, bits)
                header = json.dumps(described, sort_keys=True)
                self.used.append(job.folder / hashlib.sha256(header.encode()).hexdigest()[:16])
                step.enter_context(name_file(self.used[-1]))
                options |= {"folder": own_place(self.used[-1]), "workers": job.workers}
                options["watch"] = self.tally.add
            self.parts.append(build_matrix(observer, poses, task, **options))
            matrix = reduce(VisibilityMatrix.joined, self.parts)
            if job.folder is not None:
                is_large(job.plan, matrix)
        elements: Mesh | Cells = observer.mesh if job.cells is None else job.cells
        return matrix, problem_of(
            matrix, elements, NOTHING, costs=candidate_pool.costs, **self.counted
        )


def _in_phases(
    measuring: _Measuring, candidate_pool: CandidatePool
) -> tuple[VisibilityMatrix, Problem, AreaNetwork | None]:
    """Matrix and problem of candidates in all phases, and what all cover if that is asked."""
    job, placed = measuring.job, candidate_pool.candidates.placed
    phases, plan = job.phases, job.plan
    assert phases is not None
    assert job.cells is not None
    if any(isinstance(entry, PerCavity) for entry in plan.candidates):
        raise PlanError(
            plan.name,
            "candidates: expected a static scene for per_cavity, got moving bodies; remove one",
        )
    with job.clock("visibility matrix") as progress:
        matrix, elements, weights, reachable = phases.matrix(
            plan, measuring.observer, job.cells, placed, measuring.task, progress
        )
    counted = problem_of(matrix, elements, NOTHING, costs=candidate_pool.costs, **measuring.counted)
    return matrix, replace(counted, weights=weights), reachable


def _with_cavities(
    measuring: _Measuring, candidate_pool: CandidatePool, problem: Problem
) -> tuple[CandidatePool, Openings | None, tuple[VisibilityMatrix, Problem] | None, str]:
    """Candidates with those into cavities, their matrix and problem, and a line on them."""
    job, mesh, plan = measuring.job, measuring.observer.mesh, measuring.job.plan
    cavities = [entry for entry in plan.candidates if isinstance(entry, PerCavity)]
    missed = ~problem.reachable
    unseen = mesh.task_mask & ~mesh.degenerate_mask & faces_with(missed, job.cells)
    if not cavities or not unseen.any():
        return candidate_pool, None, None, ""
    entry = cavities[0]
    with job.clock("cavities") as progress:
        into = list(candidate_pool.parts)
        for index, cost in mounts_of_entry(plan, entry):
            opened = openings(
                mesh,
                plan.mounts.first_camera(index),
                framing_of(plan, entry),
                faces=unseen,
                clearance=plan.constraints.clearance,
                keep_out=keep_outs(plan),
                views=entry.views,
                progress=progress,
            )
            into.append((opened.candidates.of_camera(index), cost))
        before = len(candidate_pool.candidates)
        candidate_pool = filter_pool(plan, job.whole, into)
        further = renumber(candidate_pool.candidates.placed[before:])
    matrix, problem = measuring.problem("visibility matrix of cavities", candidate_pool, further)
    if job.cells is None:
        missed = unseen
    now = missed & problem.reachable
    n_now = int((unseen & ~faces_with(missed & ~now, job.cells)).sum())
    line = (
        f"without candidates that look into cavities, {'' if job.cells is None else 'parts of '}"
        f"{int(unseen.sum())} faces "
        f"({percent(problem.share(missed))} of {OF[plan.task.weight_by]}) stay uncovered; "
        f"the {len(further)} candidates that look into cavities cover {n_now} of them "
        f"({percent(problem.share(now))})"
    )
    return candidate_pool, opened, (matrix, problem), line


def _notes_on(plan: Plan, matrix: VisibilityMatrix) -> list[str]:
    """Lines on a matrix of bits, and on candidates that are left out."""
    notes = []
    if is_large(plan, matrix):
        size = matrix.n_poses * n_words(matrix.n_faces) * 8
        notes.append(
            f"the matrix has {matrix.n_pairs:,} pairs, stored as {size / 1e6:,.0f} MB of bits "
            "on disk; local search considers only the best candidates"
        )
    return notes + [
        f"candidate {pose} was skipped: its process {end}"
        for pose, end in matrix.quarantined.items()
    ]


def _for_goal(
    job: PlanJob, objectives: Objectives, problem: Problem, candidate_pool: CandidatePool
) -> WithGoals:
    """The problem with the goal of the plan, and with goals of its own, or the nearest in reach."""
    plan, cells = job.plan, job.cells
    wanted = goal_of(job.selection)
    if isinstance(wanted, BestCoverage) and wanted.cameras is not None and plan.n_given:
        costs = np.ones(problem.n_candidates)
        costs[: plan.n_given] = 0.0
        problem = replace(problem, costs=costs)
        wanted = BestCoverage(budget=float(wanted.cameras))
    placed, given = candidate_pool.candidates.placed, plan.there.ids[: plan.n_given].tolist()
    all_of = with_goals(problem, wanted, objectives.goals, placed, given, job.clock)
    notes = list(all_of.notes)
    try:
        problem = replace(all_of.problem, goal=all_of.wanted)
    except ConfigError as error:
        on = "" if cells is None else f" (on patches up to {distance(cells.size)} long)"
        if job.phases and job.phases.is_mean(objectives.faces.task):
            on += " on average over time, which the goal may not need"
        said = (
            str(error).replace(f"of {OF_GOALS}/", "of ").replace(f"of {OF_TASK},", "of the task,")
        )
        chosen = "no camera is chosen by them"
        if all_of.problem.reachable.any():
            share = percent(FALLBACK_SHARE)
            chosen = f"this selection covers at least {share} of what the candidates can cover"
        notes.append(f"{said}{on}; {chosen}")
        nearest = FewestCameras(FALLBACK_SHARE, of_reachable=True)
        problem = replace(all_of.problem, goal=nearest)
    if cells is not None and cells.size >= objectives.faces.observer.mesh.diagonal:
        notes.append(
            f"patches up to {distance(cells.size)} long are whole faces; a smaller "
            "resolution_of_result makes the choice more accurate"
        )
    return replace(all_of, problem=problem, notes=tuple(notes))


def is_large(plan: Plan, matrix: VisibilityMatrix) -> bool:
    """True for a matrix whose pairs stay on the disk, more than `MOST_LISTED_PAIRS`.

    An angle between views, several views from rigs and the integer program need lists of any size.

    Raises
    ------
    ResourceError
        Where lists are needed and the memory has no room.
    """
    is_integer = plan.selection is not None and plan.selection.method == "integer"
    reasons = [
        *(["task.min_angle_deg"] if plan.task.min_angle_deg > 0 else []),
        *(["selection.method integer"] if is_integer else []),
        *(["several views from rigs"] if plan.mounts.has_rigs and most_views(plan) > 1 else []),
    ]
    if matrix.n_pairs <= MOST_LISTED_PAIRS or not isinstance(matrix.parts[0], MatrixFolder):
        return False
    if reasons:
        what = f"{matrix.n_pairs:,} pairs, which {' and '.join(reasons)} need in the memory,"
        remedy = "leave them out, or use fewer candidates"
        check_memory(what, BYTES_A_PAIR * matrix.n_pairs, remedy)
    return not reasons


def faces_with(elements: BoolArray, cells: Cells | None) -> BoolArray:
    """(F,) faces with one of some elements: cells, or faces."""
    if cells is None:
        return elements
    faces = np.zeros(cells.mesh.n_faces, bool)
    faces[cells.source_face[elements]] = True
    return faces


def _sample(poses: Poses, most: int = N_DIAGNOSED) -> Poses:
    """Some of the poses, evenly spread."""
    n = len(poses)
    return poses[np.linspace(0, n - 1, min(n, most)).astype(int)]


def _of_rules(objectives: Objectives, mounts: Mounts, left: Poses) -> list[str]:
    """Lines on limits of rigs with a rule that no candidate meets, or none of a sample."""
    if objectives.cells is None or not len(left) or not gates_of(mounts.rig):
        return []
    finder, sampled = objectives.cells.finder, _sample(left, N_OF_RULES)
    some = mounts.cameras(sampled)[0]
    result = finder.find(some)
    scene = result.mesh, finder.camera, finder.task
    lines = unmet_lines(failures_of_rows, result, scene, some)
    if len(sampled) < len(left):
        lines = [f"{line} (of {len(sampled)} of {len(left):,} candidates)" for line in lines]
    return lines


def sample_candidates(plan: Plan, candidates: Poses) -> Poses:
    """Cameras of some candidates, by which reasons are given."""
    return plan.mounts.cameras(_sample(candidates))[0]


def _shares(
    objectives: Objectives,
    observer: Observer,
    some: Poses,
    task: Task,
    views: dict[str, int] | None,
) -> tuple[str, dict[str, float]]:
    """Words on what the shares are of that cameras miss, by the name of the reason, and these.

    By area what all of them together miss; by face, of the faces in front of each.
    """
    if objectives.cells is not None:
        finder = objectives.cells.finder
        areas = AreaNetwork(finder.mesh, finder.task)
        add_rows(finder, some, areas)
        zones = areas.zones(finder.camera, some, views)
        why = areas_by_reason(zones, finder.mesh.task_mask)
        m2 = {name: each["m2"] for name, each in why.items() if each["m2"] > 0}
        return "reasons of its area", {name: each / sum(m2.values()) for name, each in m2.items()}
    counts = np.zeros(len(NAMES), np.int64)
    for batch in evaluate_batches(observer, some, task, fields=("reason",)):
        counts += np.bincount(batch.reason[:, batch.mesh.task_mask].ravel(), minlength=len(NAMES))
    counts[TOO_FEW_VIEWS] = counts[Reason.COVERED]
    counts[[Reason.DEGENERATE, Reason.BACK_FACING, Reason.COVERED]] = 0
    order, total = sort_order(-counts), max(1, counts.sum())
    table = {NAMES[row]: float(counts[row] / total) for row in order.tolist() if counts[row]}
    return "reasons of faces in front of a camera", table


def _why_nothing(
    job: PlanJob, objectives: Objectives, observer: Observer, left: Poses, task: Task
) -> str:
    """Reasons why the candidates cover nothing, from a sample of them."""
    what = "no face" if job.cells is None else "no patch"
    some, views = sample_candidates(job.plan, left), views_by_group(job.plan, None)
    of_what, shares = _shares(objectives, observer, some, task, views)
    why = ", ".join(f"{percent(share)} {REASONS[name].label}" for name, share in shares.items())
    is_blurred = next(iter(shares), "") == "out_of_focus"
    is_given = all("unit" in entry.model_fields_set for entry in job.plan.meshes)
    is_open = _has_open_unit(job.plan) and not (is_blurred and is_given)
    if is_blurred:
        fields = (each.depth_of_field(task.max_blur) for each in job.plan.rig.cameras)
        limits = {(float(near), float(far)) for near, far in fields}
        words = (
            f"{distance(near)} {'or more' if math.isinf(far) else f'to {distance(far)}'}"
            for near, far in sorted(limits)
        )
        why += f" (depth of field {', '.join(words)})"
    return (
        f"{what} can be covered by any candidate; {of_what}: "
        f"{why or 'none'}{_clash(job, task)}; the scene measures {observer.mesh.size_in_words}"
        f"{', see meshes.unit' if is_open else ''}"
    )


def _clash(job: PlanJob, task: Task) -> str:
    """End of a line on a camera that is in focus only where its images are too coarse."""
    density = max(task.min_pixel_density, task.min_facing_density)
    for name, camera in zip(job.plan.rig.names, job.plan.rig.cameras, strict=True):
        near, _ = camera.depth_of_field(task.max_blur)
        if camera.is_pinhole and density * near > (focal := min(camera.fx, camera.fy)):
            who = name if len(job.plan.rig) > 1 else "the camera"
            has = f"{density_text(density)} up to {distance(focal / density)}"
            return f"; {who} is in focus from {distance(near)} on, and has {has}"
    return ""


def _has_open_unit(plan: Plan) -> bool:
    """True where a mesh is of a file that may not state its unit."""
    paths = [plan.folder / entry.path for entry in plan.meshes if entry.path is not None]
    return any(
        suffix_of(path) not in STATES_UNIT
        and not (suffix_of(path) == ".dae" and b"meter=" in path.read_bytes())
        for path in paths
    )


def _forget(folder: Path, used: list[Path]) -> None:
    """Remove the matrices of earlier plans.

    Only files of a matrix are removed, and no matrix that another process is writing.
    """
    for old in folder.iterdir() if folder.exists() else ():
        if old in used or not re.fullmatch("[0-9a-f]{16}", old.name):
            continue
        try:
            if not is_own_folder(old) or read_header(old) is None:
                continue
            with lock(old):
                remove_halves(old)
                remove(old, OF_A_MATRIX)
        except (ConfigError, OSError):  # not a matrix, in use, or write-protected
            continue
