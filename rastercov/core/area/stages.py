"""Parts that no camera covers, divided by the criteria that must be met to cover them: exact.

A stage is a set of criteria: what cameras, or rigs with a rule, cover without these. A part has the
smallest set that covers it, of equal ones the first in the order of `_sets`, so that its reason is
one criterion only where meeting it alone would cover it, in any camera. What no set covers lies
behind all cameras, or beyond their lenses (`OUTSIDE`), or all are behind it (`BACK_FACING`). Stages
of one criterion give the gain by it alone. Reasons have borders like covered areas, with bounds,
and the order of cameras does not matter.

Of steep views densities are judged at the largest angle that is allowed, see `Rules.without`: a
camera that meets the angle has more of them. The gain by the angle alone is without this.

`rastercov.reference.regions` has the same for single points.

Reasons why points of the surface are not covered: the first criterion that each camera fails.

The criteria are those of docs/area.md, in the order of `rastercov.Reason`. Occlusion is a segment
from the near plane to the point, traced through a tree of triangles; the first surface that it
meets is the one that hides. `rastercov.reference.regions` judges points without a tree.

The cells whose centre a pose covers are an estimate of the cells that it covers. It takes a
fraction of the time of exact regions, and serves searches over poses, which measure the best of
them exactly.
"""

from collections.abc import Callable, Iterator
from contextlib import closing
from itertools import combinations, islice, pairwise
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base import (
    BoolArray,
    ByteArray,
    FloatArray,
    Int32Array,
    IntArray,
    Lists,
    offsets_of,
    share_poses,
    thread_count,
)
from rastercov.core.area import polygons
from rastercov.core.area.cells import Cells
from rastercov.core.area.features import FEATURES, conditions_at
from rastercov.core.area.point_pass import PointPass
from rastercov.core.area.polygons import Overlay, frames_of, sides_of
from rastercov.core.area.regions import RegionPass, check_pointwise
from rastercov.core.area.rows import rule_lists, rule_reasons, with_rule
from rastercov.core.area.spread import SpreadUnion, union_of
from rastercov.core.area.table import Regions
from rastercov.core.area.union import Covered, RegionUnion
from rastercov.core.camera import (
    Cameras,
    Poses,
    by_gate,
    cameras_of,
    eyes_of,
    led_by,
    near_limits,
    rows_of_result,
)
from rastercov.core.coverage.coverage import in_batches
from rastercov.core.coverage.task import (
    BITS,
    CRITERIA,
    DENSITIES,
    NAMES,
    STEEP,
    TOO_FEW_VIEWS,
    Reason,
    Task,
    own_reasons,
    tasks_of,
)
from rastercov.core.mesh import Mesh
from rastercov.engine import area_reason

SLIVER_REL = 1e-9
"""Part of a face below which a reason is rounding."""
MOST_JUDGED = 2048
"""Pairs of point and row of a result that are judged at once: advice may end after any row."""
CodeArray = NDArray[np.uint32]


COLUMNS = ("xy", "face", "views", "reason")


class ReasonPieces(NamedTuple):
    """Convex pieces of faces in their planes, with the reason of each.

    Attributes
    ----------
    xy, starts, face, views
        As in `Covered`.
    reason : (N,) uint32
        Code of the reasons, see `rastercov.core.coverage.task.code_of`.
    """

    xy: FloatArray
    starts: IntArray
    face: Int32Array
    views: Int32Array
    reason: CodeArray

    def join(self, other: "ReasonPieces") -> "ReasonPieces":
        """These pieces, then those of another."""
        counts = np.concatenate([np.diff(self.starts), np.diff(other.starts)])
        own = {
            name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in COLUMNS
        }
        return ReasonPieces(starts=offsets_of(counts), **own)


class Stage(NamedTuple):
    """Criteria that are not asked, rows of `REASONS`, with what is needed for the others.

    Those are cameras, task, and names for `RegionPass`.
    """

    rows: tuple[int, ...]
    camera: Cameras
    task: Task
    relaxed: frozenset[str]

    @property
    def has_gain(self) -> bool:
        """True where what it covers is the gain of one criterion, or of none; not with `STEEP`."""
        return len(self.rows) < 2 and STEEP not in self.relaxed


class Divided(NamedTuple):
    """Parts that no camera covers, by reason.

    Attributes
    ----------
    parts : Parts
    doubt : (F,) float64
        Bound of the area of each reason, m^2.
    gains : dict of int to (2, F) float64
        Area that cameras would cover without the criterion of a row, and its bound, m^2.
    """

    parts: ReasonPieces
    doubt: FloatArray
    gains: dict[int, FloatArray]


def divide_by_reason(
    mesh: Mesh,
    rest: ReasonPieces,
    stages: Iterator[Stage],
    passes: Callable[[Stage, BoolArray], Covered],
    terminal: tuple[BoolArray, ByteArray],
) -> Divided:
    """Pieces that no camera covers, (N,), in parts of one reason.

    `rest` are these pieces, ordered by face, as of `with_rest`; `passes` gives what passes a stage
    of some faces, (F,), of which the first is without any criterion; and `terminal` are faces that
    cameras are in front of, (F,), and the reasons of the surface itself, (F,).
    """
    frames, (in_front, own) = frames_of(mesh), terminal
    overlay = Overlay(frames.corners, frames.areas, mesh.opaque.diagonal)
    sizes = polygons.polygon_areas(rest.xy, rest.starts)
    missing: FloatArray = np.bincount(rest.face, sizes, mesh.n_faces).astype(np.float64)
    faces = np.flatnonzero(missing).astype(np.int32)
    _add(overlay, 0, (rest.xy, rest.starts, rest.face), faces, missing[faces])
    rows_own = np.unique(own[own > Reason.COVERED]).tolist()
    every = next(stages)
    reached = passes(every, missing > 0)
    is_reached = reached.area[0] > 0
    doubt, is_open = reached.bound.copy(), is_reached.copy()
    added, gaining = list[Stage](), list[Stage]()
    gains: dict[int, FloatArray] = {}
    for stage in stages:
        # A face that a set covers as a whole needs no larger one.
        asked = is_reached if len(stage.rows) < 2 else is_open
        if not asked.any():
            continue
        passed = passes(stage, asked)
        doubt += passed.bound
        if stage.rows and stage.has_gain:
            gains[stage.rows[0]] = np.stack([0 * doubt, passed.bound])
        elif not stage.rows:
            gains |= {row: np.stack([0 * doubt, passed.bound * (own == row)]) for row in rows_own}
        is_open &= passed.area[0] < (1 - SLIVER_REL) * frames.areas
        if (passed.area[0] > 0).any():
            added.append(stage)
            number = polygons.DIVIDES_FIRST
            if stage.has_gain:
                gaining.append(stage)
                number = polygons.DIVIDES + len(gaining)
            _add_pass(overlay, polygons.PLACE * len(added) + number, passed)
    _add_pass(overlay, polygons.PLACE * (len(added) + 1) + polygons.DIVIDES_FIRST, reached)
    whole = overlay.partition()
    kept = np.flatnonzero(whole.area > 0)
    face, tag, areas = whole.face[kept], whole.tag[kept], whole.area[kept]
    for bit, stage in enumerate(gaining, 1):
        for row in stage.rows or rows_own:
            counts = (tag >> bit & 1 > 0) & (own[face] == (Reason.COVERED if stage.rows else row))
            gains[row][0] = np.bincount(face[counts], areas[counts], mesh.n_faces)
    views = 1 << len(CRITERIA)  # no criterion, but a reason of what is covered over time
    sets = [
        int(np.bitwise_or.reduce(BITS[[*stage.rows]])) | views * (TOO_FEW_VIEWS in stage.rows)
        for stage in (*added, every)
    ]
    facts = in_front, BITS[own] * (own > Reason.COVERED), doubt + SLIVER_REL * frames.areas
    reason = np.empty(len(kept), np.uint32)
    cut = polygons.choose_polygons(whole.xy, whole.starts, kept)
    area_reason.name_parts(
        ((*cut, face), tag, areas),
        np.array(sets, np.uint32),
        np.array((*CRITERIA, TOO_FEW_VIEWS), np.uint8),
        facts,
        reason,
    )
    parts = ReasonPieces(*cut, face, np.zeros(len(kept), np.int32), reason)
    return Divided(parts, doubt, gains)


def _add_pass(overlay: Overlay, number: int, passed: Covered) -> None:
    """Add what a stage covers."""
    listed = np.flatnonzero(passed.area[0] > 0).astype(np.int32)
    rows = np.flatnonzero(passed.area[0][passed.face] > 0)
    pieces = *polygons.choose_polygons(passed.xy, passed.starts, rows), passed.face[rows]
    _add(overlay, number, pieces, listed, passed.area[0][listed])


def _add(
    overlay: Overlay,
    number: int,
    pieces: tuple[FloatArray, IntArray, Int32Array],
    faces: Int32Array,
    areas: FloatArray,
) -> None:
    """Add pieces, ordered by face, as those of the camera of a number."""
    zero, row = np.zeros(len(faces)), np.zeros(len(pieces[2]), np.int32)
    pairs = np.zeros(len(faces), np.int32), faces, areas, zero, zero
    overlay.add((*pieces, row), pairs, np.array([number]))


def stages_of(mesh: Mesh, camera: Cameras, task: Task) -> Iterator[Stage]:
    """Without any criterion; then each set of those that are asked, small ones first.

    A criterion that includes others, as light includes enough of it, counts with these.
    """
    tasks = tasks_of(camera, task)
    rules = [each.rules(own) for own, each in zip(cameras_of(camera), tasks, strict=True)]
    has = {
        Reason.TOO_OBLIQUE: any(each.cos_incidence > 0 for each in rules),
        Reason.OCCLUDED: True,
        Reason.TOO_COARSE: any(getattr(each, name) > 0 for each in rules for name in DENSITIES),
        Reason.OUT_OF_FOCUS: any(each.z_n > 0 or each.z_f < np.inf for each in rules),
        Reason.OUTSIDE: any(not each.is_curved for each in cameras_of(camera)),
    }
    is_foreshortened = any(each.min_pixel_density + each.min_pixels_per_m2 > 0 for each in rules)
    of_features = {row: (c, t) for each in FEATURES for row, c, t in each.stages(camera, task)}
    asked = (
        *reversed([row for row in CRITERIA if row in of_features]),
        *(r for r in has if has[r]),
    )
    includes = {}
    for row, scene in of_features.items():
        left = {other for each in FEATURES for other, *_ in each.stages(*scene)}
        includes[row] = of_features.keys() - left - {row}
    sets = [rows for n in range(1, len(asked) + 1) for rows in combinations(asked, n)
            if not any(includes[row] & {*rows} for row in rows if row in includes)]  # fmt: skip
    sets.sort(key=lambda rows: sum(1 + len(includes.get(row, ())) for row in rows))
    free = [row for row in asked if not any(row in each for each in includes.values())]
    yield _stage(tuple(free), camera, task)
    if any((own_reasons(mesh, each) > Reason.COVERED).any() for each in tasks):
        yield _stage((), camera, task)
    for rows in sets:
        stage = _stage(rows, camera, task)
        yield stage
        if Reason.TOO_OBLIQUE in rows and is_foreshortened and Reason.TOO_COARSE not in rows:
            yield stage._replace(relaxed=stage.relaxed | {STEEP})


def _stage(rows: tuple[int, ...], camera: Cameras, task: Task) -> Stage:
    """Stage without some criteria."""
    for row in rows:
        for each in FEATURES:
            camera, task = next(
                ((c, t) for own, c, t in each.stages(camera, task) if own == row), (camera, task)
            )
    return Stage(rows, camera, task, frozenset(NAMES[row] for row in rows))


def passes(mesh: Mesh, poses: Poses, stage: Stage, asked: BoolArray, views: int = 1) -> Covered:
    """Area of faces, (F,), that up to `views` cameras cover without the criteria of a stage."""
    finder = RegionPass(mesh, stage.camera, stage.task, only_task=True, relaxed=stage.relaxed)
    degrees = stage.task.min_angle_deg if views > 1 else 0.0
    return unite_regions(finder, poses, asked, union_of(mesh, views, degrees))


def gains_of_views(
    covered: Covered, wanted: IntArray, network: tuple[Cameras, Task, Poses]
) -> dict[int, FloatArray]:
    """Gains as of `Divided` where several cameras are wanted of faces, (F,).

    That by "too few cameras" is what one covers besides.
    """
    mesh, (camera, task, poses), k = covered.mesh, network, int(wanted.max())
    row, every = wanted - 1, np.arange(len(wanted))
    own = own_reasons(mesh, tasks_of(camera, task)[0])
    has_more = mesh.task_mask & (own == Reason.COVERED)
    has_more &= covered.area[row, every] < (1 - SLIVER_REL) * frames_of(mesh).areas
    more = np.where(mesh.task_mask, covered.area[0] - covered.area[row, every], 0.0)
    gains = {TOO_FEW_VIEWS: np.stack([more, np.where(wanted > 1, covered.bound, 0.0)])}
    for stage in stages_of(mesh, camera, task):
        if stage.rows and stage.has_gain:
            passed = passes(mesh, poses, stage, has_more, k)
            gain = np.where(has_more, passed.area[row, every] - covered.area[row, every], 0.0)
            bound = np.where(has_more, passed.bound + covered.bound, 0.0)
            gains[stage.rows[0]] = np.stack([np.maximum(gain, 0.0), bound])
    return gains


def unite_regions(
    finder: RegionPass, poses: Poses, asked: BoolArray, union: RegionUnion | SpreadUnion
) -> Covered:
    """Area of faces, (F,), that rows of the result cover, added to a union; the pass is closed."""
    with closing(finder):
        add_rows(finder, poses, union, asked=asked)
    return union.covered()


class GrowingUnion(Protocol):
    """A union that grows, such as a `RegionUnion`."""

    @property
    def closed(self) -> BoolArray:
        """(F,) faces that need no further regions."""

    def add(self, regions: Regions) -> None:
        """Add the regions of further poses."""


def add_rows(
    finder: RegionPass,
    poses: Poses,
    union: GrowingUnion,
    did: Callable[[int], object] = lambda n_poses: None,
    asked: BoolArray | None = None,
) -> None:
    """Add rows of the result to a union; `did` is called with the poses that are done.

    With `asked`, (F,), faces that are False may be left out.
    """
    mesh, camera = finder.mesh, finder.camera
    rows = rows_of_result(camera, poses)
    for part in in_batches(poses, mesh.n_faces, finder.threads, rows):
        closed = union.closed if asked is None else union.closed | ~asked
        union.add(with_rule(finder.find(part, closed), camera, part))
        did(len(part))


def any_in_front(mesh: Mesh, camera: Cameras, poses: Poses, asked: BoolArray) -> BoolArray:
    """(F,) faces of which enough cameras of a row of the result are in front, not edge-on."""
    frames, eyes = frames_of(mesh), eyes_of(camera, poses)
    mask = np.zeros(mesh.n_faces, bool)
    for gate, own, _ in by_gate(camera, poses):
        for rows in own:
            left = np.flatnonzero(asked & ~mask)
            sides = sides_of(eyes[rows], frames.origin[left], frames.normal[left])
            front, rear = (side[0] if gate is None else gate.holds(side) for side in sides)
            mask[left] = front | (rear & mesh.two_sided_mask[left])
    return mask


def first_failures(
    mesh: Mesh,
    camera: Cameras,
    task: Task,
    poses: ArrayLike | Poses,
    points: FloatArray,
    face: IntArray,
) -> Iterator[tuple[ByteArray, IntArray]]:
    """`Reason` of each point in each pose, (N,), and the face that hides it, or -1, (N,).

    Parameters
    ----------
    mesh, camera, task
        Scene, camera or cameras, thresholds of `rastercov.regions`.
    poses : (P, 4, 4) array_like, or Poses
        world_from_camera.
    points, face : (N, 3) float64, (N,) int
        Points of faces with an area, metres.
    """
    placed = Poses.of(poses)
    judge = PointPass(mesh, camera, task, points, face)
    near = near_limits(judge.cameras, mesh.opaque.bounds, placed)
    judge_pose = judge.worker(placed, near, is_nearest=True)
    for row in range(len(placed)):
        reason, hidden_by = np.empty(len(points), np.uint8), np.empty(len(points), np.int64)
        judge_pose(row, reason, hidden_by)
        yield reason, np.where(hidden_by >= 0, judge.faces[hidden_by], -1)


def failures_of_rows(
    mesh: Mesh,
    camera: Cameras,
    task: Task,
    poses: Poses,
    points: FloatArray,
    face: IntArray,
) -> Iterator[tuple[IntArray, ByteArray, IntArray]]:
    """As `first_failures` for each row of the result, and the pose that has each reason, (N,).

    Of a rig with a rule it is as of `rule_reasons`; of what its cameras see, that of a condition
    of a feature.
    """
    on = points, frames_of(mesh).normal[face]
    conditions = conditions_at(mesh, camera, task, points, face)
    judged = first_failures(mesh, camera, task, poses, points, face)
    leads = [*led_by(camera, poses).tolist(), len(poses)]
    step = max(1, MOST_JUDGED // max(1, len(points)))
    for some in (leads[at : at + step + 1] for at in range(0, len(leads) - 1, step)):
        first, own = some[0], poses[some[0] : some[-1]]
        given, hiders = map(np.array, zip(*islice(judged, len(own)), strict=True))
        fails, at = rule_reasons(given, camera, own, *on)
        at = np.maximum(at, np.subtract(some[:-1], first)[:, None])
        hidden_by = np.take_along_axis(hiders, at, axis=0)
        hidden_by[BITS[fails] & BITS[Reason.OCCLUDED] == 0] = -1
        for row, (lead, end) in enumerate(pairwise(some)):
            reason = fails[row]
            for condition in conditions:
                sees = given[lead - first : end - first] == Reason.COVERED
                of_what_sees = condition.reasons(poses[lead:end], sees)
                reason = np.where(reason == Reason.COVERED, of_what_sees, reason)
            yield first + at[row], reason, hidden_by[row]


class CentrePass:
    """Cells whose centre a pose covers, or a pose of a rig with a rule; for any number of threads.

    A point is judged as in `rastercov.core.area.stages`: coincident surfaces hide nothing.

    Parameters
    ----------
    cells : Cells
        Cells of the scene.
    camera, task
        Camera or cameras, and thresholds of `rastercov.regions`.
    threads : int, optional
        Poses judged in parallel; by default one per core.
    """

    def __init__(
        self, cells: Cells, camera: Cameras, task: Task, threads: int | None = None
    ) -> None:
        check_pointwise(task)
        self._n_cells, self._mesh, self._camera = len(cells), cells.mesh, camera
        centres = cells.vertices.reshape(-1, 3, 3).mean(axis=1)
        self._judge = PointPass(cells.mesh, camera, task, centres, cells.source_face)
        frames = frames_of(cells.mesh)
        self._planes = centres, frames.normal[cells.source_face]
        self._threads = thread_count(threads)
        self._conditions = conditions_at(cells.mesh, camera, task, centres, cells.source_face)

    def find(self, poses: ArrayLike | Poses) -> Lists:
        """Cells whose centre each row of the result of (P, 4, 4) poses covers."""
        placed, cameras = Poses.of(poses), self._judge.cameras
        placed.check_cameras(len(cameras))
        values = [np.empty(0, np.int32)] * len(placed)
        near = near_limits(cameras, self._mesh.opaque.bounds, placed)

        def worker() -> Callable[[slice], None]:
            judge = self._judge.worker(placed, near, is_nearest=False)
            reason, hider = np.empty(self._n_cells, np.uint8), np.empty(self._n_cells, np.int64)

            def work(turn: slice) -> None:
                for row in range(len(placed))[turn]:
                    judge(row, reason, hider)
                    values[row] = np.flatnonzero(reason == Reason.COVERED).astype(np.int32)

            return work

        n_workers = max(1, min(self._threads, len(placed)))
        share_poses(len(placed), [worker() for _ in range(n_workers)])
        gated = rule_lists(values, self._camera, placed, *self._planes)
        if self._conditions:
            rows = rows_of_result(self._camera, placed)
            for row, own in enumerate(gated):
                sees = np.zeros((int((rows == row).sum()), self._n_cells), bool)
                for camera, pose in enumerate(np.flatnonzero(rows == row)):
                    sees[camera, values[pose]] = True
                every = [each.reasons(placed[rows == row], sees) for each in self._conditions]
                gated[row] = own[(np.array(every)[:, own] == Reason.COVERED).all(axis=0)]
        return Lists.of(gated)
