"""Candidates of a plan and their visibility matrix: the input of selection.

The visibility matrix is written to the disk as it is measured, so that an interrupted run can
continue. Its folder is named by a hash of all that it depends on.
"""

import hashlib
import json
import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np

from rastercov.base.errors import ConfigError, ResourceError
from rastercov.base.format import percent
from rastercov.base.locks import locked
from rastercov.base.memory import BoolArray, check_memory
from rastercov.base.output import is_own_folder, named, own_place
from rastercov.camera.formats.doubts import unit_doubts
from rastercov.camera.pose import Poses, renumbered
from rastercov.camera.rig import Rig
from rastercov.cluster import Tally, Workers
from rastercov.cluster.inputs import INPUTS
from rastercov.cluster.store import remove, remove_halves
from rastercov.coverage.area.cells import Cells, cells, usual_size
from rastercov.coverage.area.network import AreaNetwork
from rastercov.coverage.coverage import evaluate_batches
from rastercov.coverage.observer import Observer
from rastercov.coverage.reasons import Reason
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.placement.candidates.cavities import Openings, openings
from rastercov.placement.candidates.pool import Candidates
from rastercov.placement.candidates.segments import Segmentation
from rastercov.placement.matrix import BitMatrix, VisibilityMatrix, build_matrix, measure_matrix
from rastercov.placement.matrix_folder import describe, read_header
from rastercov.placement.mounts import Mounts
from rastercov.placement.plan.arm import PlanArm
from rastercov.placement.plan.file import Plan, PlanError, errors_at
from rastercov.placement.plan.network import OF, counting, goal_of, most_views
from rastercov.placement.plan.over_time import PlanMotion, time_matrix
from rastercov.placement.plan.scene import (
    CandidatePool,
    candidate_pool,
    filtered_pool,
    framing_of,
    keep_outs,
    mounts_of_entry,
    segmentation_of,
)
from rastercov.placement.plan.sections import PerCavity, SelectionSection, no_limit
from rastercov.placement.select.problem import (
    BestCoverage,
    FewestCameras,
    Goal,
    Problem,
    grouped,
    problem_of,
)
from rastercov.placement.uncovered import CandidateBounds

N_DIAGNOSED = 32
"""Number of candidates examined for the reason why none covers a face."""
OF_A_MATRIX = (
    "pairs/pairs-*.npz", "bounds/*.npz", "quarantine/shard-*.json", *INPUTS, "sha256/*.sha256"
)  # fmt: skip
"""Files of a matrix, see `matrix_folder`, in an order of removal that is safe to interrupt."""
FALLBACK_SHARE = 0.99
"""Share of the reachable weight to cover where a plan requires more than is reachable."""
MOST_LISTED_PAIRS = 50_000_000
"""Pairs up to which a matrix is held as lists in the memory."""
BYTES_A_PAIR = 16
"""Of lists: 8 for the matrix, 8 for the selection."""
Matrix = VisibilityMatrix | BitMatrix
Progress = Callable[[int, int], None]
Step = Callable[[str], Any]
"""Context manager by the name of a step, which yields its `Progress`."""


@contextmanager
def quiet(name: str) -> Iterator[Progress]:
    """Step without progress display."""
    yield lambda done, total: None


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


@dataclass(frozen=True, eq=False)
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
    over_time : PlanMotion or None
        Where bodies move.
    arm : PlanArm or None
        Where a robot carries the cameras.
    quarantined : mapping of int to str
        Candidates that kill the process that measures them, and its end.
    is_of_bits : bool
        True where the pairs of the matrix are bits on the disk, not lists in the memory.
    tally : Tally
        Time of the workers that measured candidates, where there were any.
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
    measured_by: dict[str, Any]
    problem: Problem
    notes: tuple[str, ...]
    cells: Cells | None = None
    reachable: AreaNetwork | None = None
    over_time: PlanMotion | None = None
    arm: PlanArm | None = None
    quarantined: Mapping[int, str] = field(default_factory=dict)
    is_of_bits: bool = False
    tally: Tally = field(default_factory=Tally)

    @property
    def measured(self) -> Poses:
        """Cameras of all candidates, without those that kill the process that measures them.

        None of existing ones, whose candidates are of lamps.
        """
        if self.plan.existing is not None:
            return Poses.of(np.zeros((0, 4, 4)))
        return self.mounts.cameras(without(self.pool.candidates, self.quarantined))[0]

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
            raise PlanError(plan.name, f"{where}: the result is by face, because {reason}")
        return None
    with errors_at(plan.name, where, ResourceError):
        return cells(mesh, usual_size(mesh) if asked is None else asked)


def prepare(
    plan: Plan,
    selection: SelectionSection,
    observer: Observer,
    task: Task,
    folder: Path | None,
    clock: Clock,
    cells: Cells | None = None,
    workers: Workers | None = None,
    over_time: PlanMotion | None = None,
) -> Prepared:
    """Candidates and their visibility matrix, with those into cavities where the plan has them.

    The elements of the matrix are the cells where there are some, and the faces otherwise.
    """
    mesh, mounts = observer.mesh, plan.mounts
    arm = PlanArm.of(plan, mesh)
    elements: Mesh | Cells = mesh if cells is None else cells
    goal: Goal = BestCoverage(cameras=0)
    notes: list[str] = []
    used: list[Path] = []
    bounds = CandidateBounds(mesh.n_faces, mesh.task_mask)
    tally = Tally()

    parts: list[Matrix] = []

    def matrix_of(name: str, poses: Poses) -> Matrix:
        """Matrix of these poses after those of the calls before.

        In a folder named by a hash of all that it depends on, in memory where there is no folder.
        """
        options: dict[str, Any] = {"cells": cells, "bounds": bounds, "mounts": mounts}
        if folder is None:
            with clock(name) as progress:
                parts.append(build_matrix(observer, poses, task, progress=progress, **options))
                return held(plan, parts)
        header = json.dumps(describe(observer, poses, task, None, cells, mounts), sort_keys=True)
        used.append(folder / hashlib.sha256(header.encode()).hexdigest()[:16])
        with clock(name) as progress, named(used[-1]):
            measured = measure_matrix(
                observer, poses, task, own_place(used[-1]), workers=workers, progress=progress,
                watch=tally.add, **options,
            )  # fmt: skip
            parts.append(measured)
            return held(plan, parts, progress)

    with clock("candidates"):
        segmentation = segmentation_of(plan, mesh)
        found = candidate_pool(plan, mesh)
    counted = counting(plan.task) | {"mounts": mounts}
    cavities = [entry for entry in plan.candidates if isinstance(entry, PerCavity)]
    opened = reachable = None
    matrix: Matrix
    if over_time is None:
        matrix = matrix_of("visibility matrix", found.candidates.placed)
        problem = problem_of(matrix, elements, goal, costs=found.costs, **counted)
    else:
        assert cells is not None
        if cavities:
            raise PlanError(plan.name, "candidates: per_cavity is of a still scene; leave it out")
        with clock("visibility matrix") as progress:
            timed = time_matrix(
                plan, over_time, observer, cells, found.candidates.placed, task, progress,
                is_united=getattr(selection, "of_reachable", False),
            )  # fmt: skip
        matrix, problem = timed.matrix, timed.problem(goal, costs=found.costs, **counted)
        if timed.together is not None:
            of_all = over_time.result(plan.rig, found.candidates.placed, task, timed.together)
            reachable = of_all.areas
    missed = ~problem.reachable
    unseen = np.zeros(mesh.n_faces, np.bool_)
    if cavities:
        unseen = mesh.task_mask & ~mesh.degenerate_mask & _faces_with(missed, cells)
    if unseen.any():
        entry = cavities[0]
        with clock("cavities") as progress:
            into = list(found.parts)
            for index, cost in mounts_of_entry(plan, entry):
                opened = openings(
                    mesh,
                    mounts.first_camera(index),
                    framing_of(plan, entry),
                    faces=unseen,
                    clearance=plan.constraints.clearance,
                    keep_out=keep_outs(plan),
                    views=entry.views,
                    progress=progress,
                )
                into.append((opened.candidates.of_camera(index), cost))
            before = len(found.candidates)
            found = filtered_pool(plan, mesh, into)
            further = renumbered(found.candidates.placed[before:])
        del matrix
        matrix = matrix_of("visibility matrix of cavities", further)
        problem = problem_of(matrix, elements, goal, costs=found.costs, **counted)
        if cells is None:
            missed = unseen
        now = missed & problem.reachable
        n_now = int((unseen & ~_faces_with(missed & ~now, cells)).sum())
        notes.append(
            f"candidates of the other entries leave {'' if cells is None else 'parts of '}"
            f"{int(unseen.sum())} faces "
            f"({percent(problem.share(missed))} of {OF[plan.task.weight_by]}) uncovered; "
            f"{len(further)} into cavities cover {n_now} of these "
            f"({percent(problem.share(now))})"
        )
    if not len(found.candidates):
        raise ConfigError(
            f"{plan.name}: no candidate is left ({'; '.join(found.lines())}); "
            f"allow more, or add some{_of_unit(plan, mesh, found.proposed)}"
        )
    if folder is not None:
        _forget(folder, used)
    if isinstance(matrix, BitMatrix):
        size = matrix.bits.n_rows * matrix.bits.n_words * 8
        notes.append(
            f"the matrix has {matrix.n_pairs:,} pairs and is held as {size / 1e6:,.0f} MB of bits "
            "on the disk: exchanges of cameras are tried among the best candidates only"
        )
    notes += [
        f"candidate {pose} is left out: the process that measured it {end}"
        for pose, end in matrix.quarantined.items()
    ]
    if not problem.reachable.any():
        what = "no face" if cells is None else "no cell"
        some = mounts.cameras(without(found.candidates, matrix.quarantined))[0]
        notes.append(_why_nothing(observer, some, task, what))
    try:
        problem = grouped(problem, goal_of(selection))
    except ConfigError as error:
        on = "" if cells is None else f"on cells of {cells.size:g} m: "
        notes.append(
            f"{on}{error}; these cover {percent(FALLBACK_SHARE)} of what can be covered, or more"
        )
        problem = replace(problem, goal=FewestCameras(FALLBACK_SHARE, of_reachable=True))
    if cells is not None and cells.size >= mesh.diagonal:
        notes.append(
            f"cells of {cells.size:g} m are whole faces; a smaller resolution_of_result makes the "
            "choice more accurate"
        )
    # The lists of a matrix are freed here: the problem has their bits.
    return Prepared(
        plan=plan,
        selection=selection,
        mesh=mesh,
        mounts=mounts,
        task=task,
        pool=found,
        segmentation=segmentation,
        openings=opened,
        bounds=bounds,
        pairs=matrix.n_pairs,
        is_of_bits=isinstance(matrix, BitMatrix),
        measured_by=matrix.header["measured_by"],
        problem=problem,
        notes=tuple(notes),
        cells=cells,
        reachable=reachable,
        over_time=over_time,
        arm=arm,
        quarantined=matrix.quarantined,
        tally=tally,
    )


def held(
    plan: Plan,
    parts: Sequence[Matrix],
    progress: Progress = lambda done, total: None,
) -> Matrix:
    """Matrix of all parts, as lists up to `MOST_LISTED_PAIRS` and as bits beyond.

    An angle between views, several views from rigs and the integer program need lists of any size.

    Parameters
    ----------
    parts : sequence of BitMatrix or of VisibilityMatrix
        Of consecutive candidates.

    Raises
    ------
    ResourceError
        Where lists are needed and the memory has no room, or the disk has none for bits.
    """
    matrix: Matrix = reduce(type(parts[0]).joined, parts)  # type: ignore[arg-type] # of one type
    if isinstance(matrix, VisibilityMatrix):
        return matrix
    n_pairs = matrix.n_pairs
    is_integer = plan.selection is not None and plan.selection.method == "integer"
    reasons = [
        *(["task.min_angle_deg"] if plan.task.min_angle_deg > 0 else []),
        *(["selection.method integer"] if is_integer else []),
        *(["several views from rigs"] if plan.mounts.has_rigs and most_views(plan) > 1 else []),
    ]
    if n_pairs > MOST_LISTED_PAIRS and not reasons:
        for folder in matrix.folders:
            folder.covered(matrix.task.min_coverage, progress)
        return matrix
    if n_pairs > MOST_LISTED_PAIRS:
        what = f"{n_pairs:,} pairs, which {' and '.join(reasons)} need in the memory,"
        remedy = "leave them out, or use fewer candidates"
        check_memory(what, BYTES_A_PAIR * n_pairs, remedy)
    return VisibilityMatrix.of(matrix)


def _faces_with(elements: BoolArray, cells: Cells | None) -> BoolArray:
    """(F,) faces with one of some elements: cells, or faces."""
    if cells is None:
        return elements
    faces = np.zeros(cells.mesh.n_faces, np.bool_)
    faces[cells.source_face[elements]] = True
    return faces


def _of_unit(plan: Plan, mesh: Mesh, proposed: Candidates) -> str:
    """End of a line about candidates that are all rejected: the unit, where it is in doubt."""
    reach = no_limit(plan.constraints.stand_off)[1]
    lines = unit_doubts(mesh, plan.rig, plan.mounts.cameras(proposed.placed)[0], reach)
    return "".join(f"; {line}" for line in lines).replace("--unit", "unit of [[meshes]]")


def _why_nothing(observer: Observer, poses: Poses, task: Task, what: str) -> str:
    """Reasons why the candidates cover nothing, from a sample of them."""
    some = poses[np.unique(np.linspace(0, len(poses) - 1, N_DIAGNOSED).astype(np.int64))]
    counts = np.zeros(len(Reason), np.int64)
    for batch in evaluate_batches(observer, some, task, fields=("reason",)):
        counts += np.bincount(batch.reason[:, batch.mesh.task_mask].ravel(), minlength=len(Reason))
    counts[[Reason.DEGENERATE, Reason.BACK_FACING, Reason.COVERED]] = 0
    shares = counts / max(1, counts.sum())
    order = np.argsort(-shares, kind="stable")
    why = ", ".join(
        f"{percent(float(shares[row]))} {Reason(row).name.lower().replace('_', ' ')}"
        for row in order
        if counts[row]
    )
    return (
        f"{what} is covered, whichever candidates are chosen; of the faces before a camera: "
        f"{why or 'none'}; the scene measures {observer.mesh.size_in_words}, see meshes.unit"
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
            with locked(old):
                remove_halves(old)
                remove(old, OF_A_MATRIX)
        except (ConfigError, OSError):  # not a matrix, in use, or write-protected
            continue


def without(candidates: Candidates, quarantined: Mapping[int, str]) -> Poses:
    """Poses of candidates without some."""
    is_left = np.ones(len(candidates), np.bool_)
    is_left[list(quarantined)] = False
    return renumbered(candidates.take(is_left).placed)
