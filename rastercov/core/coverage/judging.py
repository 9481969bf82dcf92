"""Poses measured and judged face by face, a few at a time, in the threads that measure them."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rastercov.base import (
    TINY,
    AnyArray,
    BoolArray,
    ConfigError,
    FloatArray,
    IntArray,
    check_choice,
    frozen_record,
)
from rastercov.core.area.rows import rule_reasons, with_rule
from rastercov.core.camera import Cameras, Poses, eyes_of, is_joint, led_by, rows_of_result
from rastercov.core.coverage.coverage import Observer, arrays_for, batch_size, measurements
from rastercov.core.coverage.face_pass import (
    FIGURES,
    ROW_TYPES,
    FacePass,
    Measured,
    PairRows,
    Scope,
    Sink,
    Sums,
    Worker,
    figures_of,
    keeper,
    merge_sums,
    no_sums,
)
from rastercov.core.coverage.task import Reason, Task
from rastercov.core.mesh import Mesh
from rastercov.core.raster.contract import CoverageBits, FaceCounts, bits_of_pairs
from rastercov.engine.coverage_figures import judge_poses
from rastercov.engine.coverage_network import add_poses, add_rows

if TYPE_CHECKING:
    from rastercov.core.area.table import Regions

CHOICES = ("none", "covered", "seen", "all")
"""Pairs that a table may hold: those covered; those seen, that is with some part of the face in the
image and its front to the camera, though other faces may hide it; or every pair."""
SUMMED = ("coverage", "reason", "visibility_bound", "visibility_kind", "in_view_fraction")
"""Figures that a network adds up: the arguments of `add_rows` of the kernels."""
NO_ARRAYS: Mapping[str, AnyArray] = {}


@frozen_record
class JudgedPoses:
    """A few poses that a network has judged and not yet added; see `classify_poses`.

    Attributes
    ----------
    poses : Poses
        The poses.
    clipped : (P,) bool
        Whether the near plane cut away a surface in view.
    rows : PairRows
        Figures of the pairs that were asked for, by pose, then by face.
    counts : FaceCounts or None
        Counts of the poses `as_small`, where they are kept.
    sums : dict of int to Sums
        Sums of the poses of each camera where these are kept apart, otherwise of all as camera -1;
        none where bits are alone.
    regions : Regions or None
        Regions of the poses, where the observer finds any.
    eyes : (P, 3) float64
        As of `rig.eyes_of`, metres.
    leads : (P,) bool, or None
        Of rigs with a rule, the first pose of each, at which `RESULT` has the sums of the rig.
    bits : CoverageBits or None
        Covered pairs, where they are asked for.
    """

    poses: Poses
    clipped: BoolArray
    rows: PairRows
    counts: FaceCounts | None
    sums: dict[int, Sums]
    regions: "Regions | None"
    eyes: FloatArray
    leads: BoolArray | None = None
    bits: CoverageBits | None = None


OF_PARTS = (
    "expected a result by area for rigs with a rule or lamps, got one by face; leave out 'by'"
)
"""Reason why these are refused by face."""
RESULT = -1
"""Camera by which sums of all poses, or of rigs with a rule, are kept."""


def leads_of(camera: Cameras, poses: Poses) -> BoolArray | None:
    """`JudgedPoses.leads` of some poses; None where each camera counts alone."""
    if not is_joint(camera):
        return None
    leads = np.zeros(len(poses), bool)
    leads[led_by(camera, poses)] = True
    return leads


def sums_of(mesh: Mesh, figures: Mapping[str, AnyArray], rows: IntArray) -> Sums:
    """Sums of the figures of some poses, rows of (P, F) each."""
    coverage, reason, bound, kind, part = (
        np.ascontiguousarray(figures[name], FIGURES[name]) for name in SUMMED
    )
    sums = no_sums(mesh.n_faces, len(coverage))
    add_rows(rows, mesh.task_mask, coverage, reason, bound, kind, part, sums)
    return sums


def sums_of_rigs(
    mesh: Mesh,
    task: Task,
    camera: Cameras,
    poses: Poses,
    figures: Mapping[str, AnyArray],
    regions: "Regions",
) -> Sums:
    """Sums of rigs with a rule, or with equipment, from the figures of P poses and their `Regions`.

    A rig covers a face by the share of its area that its cameras cover together, and its
    reason is that of the camera that is missed most.
    """
    rows = led_by(camera, poses)
    shares = with_rule(regions, camera, poses).areas() / np.maximum(mesh.areas, TINY)
    shares[:, mesh.degenerate_mask] = 0.0
    folded = {name: np.zeros((len(poses), mesh.n_faces), FIGURES[name]) for name in SUMMED}
    folded["coverage"][rows] = np.minimum(shares, 1.0)
    folded["in_view_fraction"][rows] = figures["in_view_fraction"][rows]
    covered = (shares >= task.min_coverage) & (shares > 0)
    on = mesh.centroids, mesh.normals
    reason = rule_reasons(figures["reason"], camera, poses, *on, has_limits=False)[0]
    # Each camera may cover most of the face, and together they cover less: one is in the shadow.
    left = next((each.reason for each in regions.conditions), Reason.OCCLUDED)
    reason[~covered & (reason == Reason.COVERED)] = left
    reason[covered] = Reason.COVERED
    folded["reason"][rows] = reason
    return sums_of(mesh, folded, rows)


def _adder(
    judge: FacePass, sink: Sink, figures: Mapping[str, AnyArray], *, apart: bool
) -> tuple[dict[int, Sums], Worker]:
    """Sums of one thread, and the worker that judges poses of a batch and adds them to these.

    Parameters
    ----------
    judge : FacePass
    sink : Sink
        Memory for the rows of the batch.
    figures : dict of str to array
        Memory for figures of all its pairs, (P, F) each.
    apart : bool
        Keep the sums of each camera apart.
    """
    mesh, of_camera = judge.mesh, dict[int, Sums]()
    is_scored, coverage = mesh.task_mask, np.empty(mesh.n_faces)
    out = figures_of(figures) if figures else None

    def add(rows: slice, index: int, scope: Scope) -> None:
        camera, rules = index if apart else -1, judge.rules[index]
        if camera not in of_camera:
            of_camera[camera] = no_sums(mesh.n_faces, len(sink.pose_ids))
        sums = of_camera[camera]
        add_poses(rows.start, rows.stop, scope, rules, is_scored, sums, coverage, sink)
        if out is not None:
            judge_poses(rows.start, rows.stop, scope, rules, out)

    return of_camera, add


def classify_poses(
    mesh: Mesh,
    task: Task,
    observer: Observer,
    poses: Poses,
    *,
    pairs: str = "none",
    apart: bool = False,
    bits: bool = False,
    figures: Mapping[str, AnyArray] = NO_ARRAYS,
    counts: bool = False,
) -> Iterator[JudgedPoses]:
    """Measure poses, a few at a time; see `Network.judge`."""
    check_choice("pairs", pairs, CHOICES)
    faces = FacePass(observer.mesh, observer.camera, observer.threads, task)
    choice, n_faces = CHOICES.index(pairs), mesh.n_faces
    n_rows = min(len(poses), batch_size(n_faces, observer.threads)) * n_faces if choice else 0
    # Used again for each batch; what no row is written to is never taken from the system.
    memory = {name: np.empty(n_rows, kind) for name, kind in ROW_TYPES.items()}
    together = None
    further = ["reason"] if bits else []
    if is_joint(observer.camera):
        together, further = rows_of_result(observer.camera, poses), list(SUMMED)
    done = 0

    def classify(batch: Poses, seen: Measured) -> JudgedPoses:
        nonlocal done
        n = len(batch)
        own = arrays_for(further, (n, n_faces)) if further else {}
        own |= {name: array[done : done + n] for name, array in figures.items()}
        done += n
        sink = Sink(choice, batch.ids, np.zeros(n, np.int64), tuple(memory.values()))
        of_threads: list[dict[int, Sums]] = []
        small: dict[int, list[AnyArray]] = {}

        def worker() -> Worker:
            sums, add = _adder(faces, sink, own, apart=apart)
            of_threads.append(sums)
            return keeper(add, small) if counts else add

        if n:
            faces.share(seen, batch, worker)
        parts: dict[int, list[Sums]] = {}
        for camera, sums in (entry for part in of_threads for entry in part.items()):
            parts.setdefault(camera, []).append(sums)
        turns = np.flatnonzero(sink.counts)
        spans = np.stack([turns * n_faces, turns * n_faces + sink.counts[turns]], axis=1)
        columns = {
            name: np.concatenate([part[:0], *(part[start:stop] for start, stop in spans.tolist())])
            for name, part in memory.items()
            if choice
        } or memory
        whole = {camera: merge_sums(some) for camera, some in parts.items()}
        eyes, leads = eyes_of(observer.camera, batch), leads_of(observer.camera, batch)
        regions = getattr(seen, "regions", None)
        kept = None
        if small and isinstance(seen, FaceCounts):
            visible, drawn = map(np.concatenate, zip(*map(small.get, sorted(small)), strict=True))
            kept = replace(seen, visible=visible, drawn=drawn)
        result = JudgedPoses(batch, seen.clipped, columns, kept, whole, regions, eyes, leads)
        if bits:
            result = replace(result, bits=bits_of_pairs(mesh, own["reason"] == Reason.COVERED))
        if result.leads is not None and result.regions is None:
            raise ConfigError(OF_PARTS)
        if result.leads is not None and result.regions is not None and n:
            whole[RESULT] = sums_of_rigs(mesh, task, observer.camera, batch, own, result.regions)
            whole[RESULT].kinds[:] = sum(part.kinds for at, part in whole.items() if at >= 0)
        return result

    batches = measurements(observer, poses, together, 1 if choice else 2)
    return (classify(batch, seen) for batch, seen in batches)
