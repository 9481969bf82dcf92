"""Coverage by a network of cameras: by face, by group, by count and by area.

E. S. Eissa. Image Space Coverage Model. 2020, section 6.4.1 and Table 6.1, where a face counts as
not covered when its coverage is 0 in every camera.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.arguments import check_choice
from rastercov.base.errors import ConfigError
from rastercov.base.format import InNotebook
from rastercov.base.memory import BoolArray, FloatArray, IntArray
from rastercov.base.typed import typed
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, is_joint, lamps_of, led_by, rows_of_result
from rastercov.coverage.area.rows import gated, gated_reasons
from rastercov.coverage.coverage import (
    Coverage,
    arrays_for,
    batch_size,
    check_observer,
    measurements,
)
from rastercov.coverage.face_pass import FacePass, Measured, Scope, Worker
from rastercov.coverage.observer import Observer
from rastercov.coverage.reasons import NAMES, UNLIT, Reason, reason_rows
from rastercov.coverage.records import ROW_TYPES, PairRows, Sink, Sums
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.mesh.groups import parts_of
from rastercov.native.coverage_network import add_poses, add_rows
from rastercov.native.coverage_spread import add_rays
from rastercov.raster.observation import BoundKind

if TYPE_CHECKING:
    from rastercov.coverage.area.table import Regions


CHOICES = ("none", "covered", "seen", "all")
"""Pairs that a table may hold: those covered; those seen, that is with some part of the face in the
image and its front to the camera, though other faces may hide it; or every pair."""
SUMMED: dict[str, Any] = {
    "coverage": np.float64,
    "reason": np.uint8,
    "visibility_bound": np.float64,
    "visibility_kind": np.uint8,
    "in_view_fraction": np.float64,
}
"""Figures that a network adds up, and their types: the arguments of `add_rows` of the kernels."""


UNSEEABLE = "inside closed bodies of the mesh, or in contact with them all over: proved"
"""Reason of faces that no camera outside the bodies can ever see."""


@dataclass(frozen=True, eq=False)
class JudgedPoses:
    """A few poses that a network has judged and not yet added; see `Network.judge`.

    Attributes
    ----------
    poses : Poses
        The poses.
    clipped : (P,) bool
        Whether the near plane cut away a surface in view.
    rows : PairRows
        Figures of the pairs that were asked for, by pose, then by face.
    measured : Observation or FaceCounts, or None
        Measurement of the poses, of those that this process has measured.
    sums : dict of int to Sums
        Sums of the poses of each camera where these are kept apart, otherwise of all as camera -1.
    regions : Regions or None
        Regions of the poses, where the observer finds any.
    leads : (P,) bool, or None
        Of rigs with a rule, the first pose of each, at which `RESULT` has the sums of the rig.
    """

    poses: Poses
    clipped: BoolArray
    rows: PairRows
    measured: Measured | None
    sums: dict[int, Sums]
    regions: "Regions | None"
    leads: BoolArray | None = None

    @classmethod
    def of(
        cls, poses: Poses, measured: Measured, rows: PairRows, sums: Any, camera: Cameras
    ) -> "JudgedPoses":
        """Poses of a camera or several that this process has measured."""
        found, leads = getattr(measured, "regions", None), leads_of(camera, poses)
        return cls(poses, measured.clipped, rows, measured, sums, found, leads)


OF_PARTS = "rules of rigs and lamps are of parts of faces; give by area"
"""Reason why these are refused by face."""
RESULT = -1
"""Camera by which sums of all poses, or of rigs with a rule, are kept."""


def leads_of(camera: Cameras, poses: Poses) -> BoolArray | None:
    """`JudgedPoses.leads` of some poses; None where no rig has a rule and no lamp counts."""
    if not is_joint(camera):
        return None
    found = np.zeros(len(poses), np.bool_)
    found[led_by(camera, poses)] = True
    return found


def no_sums(n_faces: int, n_poses: int) -> Sums:
    """Sums of poses before any is added."""
    return Sums(
        views=np.zeros(n_faces, np.int64),
        best=np.zeros(n_faces),
        best_row=np.zeros(n_faces, np.int64),
        reason=np.zeros(n_faces, np.uint8),
        kinds=np.zeros(len(BoundKind), np.int64),
        bounds=np.zeros(2),
        covered_faces=np.zeros(n_poses, np.int64),
        totals=np.zeros(n_poses),
    )


def merge(ours: Sums, theirs: Sums, first: int = 0) -> None:
    """Add the sums of other poses to `ours`; their row 0 is row `first` of these."""
    ours.views[:] += theirs.views
    rows = theirs.best_row + first
    better = (theirs.best > ours.best) | ((theirs.best == ours.best) & (rows < ours.best_row))
    ours.best[better], ours.best_row[better] = theirs.best[better], rows[better]
    np.maximum(ours.reason, theirs.reason, out=ours.reason)
    ours.kinds[:] += theirs.kinds
    np.maximum(ours.bounds, theirs.bounds, out=ours.bounds)
    own = slice(first, first + len(theirs.totals))
    ours.covered_faces[own] += theirs.covered_faces
    ours.totals[own] += theirs.totals


def _merged(parts: Sequence[Sums]) -> Sums:
    """Sums of different poses of one batch together."""
    if len(parts) == 1:
        return parts[0]
    whole = no_sums(len(parts[0].views), len(parts[0].totals))
    for part in parts:
        merge(whole, part)
    return whole


def sums_of(
    mesh: Mesh, figures: Mapping[str, NDArray[Any]], camera: NDArray[np.int32], *, apart: bool
) -> dict[int, Sums]:
    """Sums of the figures of poses, (P, F) each: of each camera (P,), or of all as camera -1."""
    found = {}
    for index in np.unique(camera).tolist() if apart else [-1]:
        own = np.flatnonzero((camera == index) | (index < 0))
        found[index] = _sums_of_rows(mesh, figures, own)
    return found


def _sums_of_rows(mesh: Mesh, figures: Mapping[str, NDArray[Any]], rows: IntArray) -> Sums:
    """Sums of the figures of some poses, rows of (P, F) each."""
    coverage, reason, bound, kind, part = (
        np.ascontiguousarray(figures[name], dtype) for name, dtype in SUMMED.items()
    )
    sums = no_sums(mesh.n_faces, len(coverage))
    add_rows(rows, mesh.task_mask, coverage, reason, bound, kind, part, sums)
    return sums


def sums_of_rigs(
    mesh: Mesh, task: Task, camera: Cameras, poses: Poses, figures: Mapping[str, Any], found: Any
) -> Sums:
    """Sums of rigs with a rule, or with lamps, from the figures of P poses and their `Regions`.

    A rig covers a face by the share of its area that its cameras cover together, lit, and its
    reason is that of the camera that is missed most.
    """
    rows = led_by(camera, poses)
    shares = gated(found, camera, poses).areas() / np.maximum(mesh.areas, np.finfo(float).tiny)
    shares[:, mesh.degenerate_mask] = 0.0
    folded = {name: np.zeros((len(poses), mesh.n_faces), kind) for name, kind in SUMMED.items()}
    folded["coverage"][rows] = np.minimum(shares, 1.0)
    folded["in_view_fraction"][rows] = figures["in_view_fraction"][rows]
    covered = (shares >= task.min_coverage) & (shares > 0)
    on = mesh.centroids, mesh.normals
    reason = gated_reasons(figures["reason"], camera, poses, *on, has_limits=False)[0]
    # Each camera may cover most of the face, and together they cover less: one is in the shadow.
    left = Reason.OCCLUDED if lamps_of(camera) is None else UNLIT
    reason[~covered & (reason == Reason.COVERED)] = left
    reason[covered] = Reason.COVERED
    folded["reason"][rows] = reason
    return _sums_of_rows(mesh, folded, rows)


def _adder(judge: FacePass, sink: Sink, *, apart: bool) -> tuple[dict[int, Sums], Worker]:
    """Sums of one thread, and the worker that judges poses of a batch and adds them to these.

    Parameters
    ----------
    judge : FacePass
    sink : Sink
        Memory for the rows of the batch.
    apart : bool
        Keep the sums of each camera apart.
    """
    mesh, of_camera = judge.mesh, dict[int, Sums]()
    is_scored, coverage = mesh.task_mask, np.empty(mesh.n_faces)

    def add(rows: slice, index: int, scope: Scope) -> None:
        camera, rules = index if apart else -1, judge.rules[index]
        if camera not in of_camera:
            of_camera[camera] = no_sums(mesh.n_faces, len(sink.pose_ids))
        sums = of_camera[camera]
        add_poses(rows.start, rows.stop, *scope, rules, is_scored, sums, coverage, sink)

    return of_camera, add


def least_cosine(min_angle: float) -> float:
    """Largest cosine of two rays that differ by an angle, radians; 2 where any two do."""
    return math.cos(min_angle) + 1e-12 if min_angle > 0 else 2.0


class ViewSpread:
    """Faces with two views from directions that differ by an angle, as cameras are added.

    Memory grows with the pairs of camera and face until the face has two such views.

    Parameters
    ----------
    centroids : (F, 3) float64
        Centroids of the faces, metres.
    min_angle : float
        Least angle at the centroid between two rays, radians; with 0 any face has it.

    Attributes
    ----------
    is_spread : (F,) bool
        Faces with two views that differ by it.
    """

    def __init__(self, centroids: FloatArray, min_angle: float) -> None:
        n = len(centroids)
        self._min_cosine, self._is_asked = least_cosine(min_angle), min_angle > 0
        self.is_spread = np.full(n, not self._is_asked)
        if not self._is_asked:
            return
        self._centroids = np.array(centroids, np.float64)
        self._first, self._last = np.full((2, n), -1, np.int64)
        self._is_near = np.ones(n, np.bool_)
        self._before: NDArray[Any] = np.empty(0, np.int64)
        self._camera: NDArray[Any] = np.empty(0, np.int64)
        self._eyes: NDArray[Any] = np.empty((0, 3))
        self._n_eyes = self._n_pairs = 0

    def add(self, eye: ArrayLike, faces: NDArray[np.integer]) -> None:
        """Add a camera at `eye`, (3,), that covers faces (N,), none of them twice."""
        if not self._is_asked:
            return
        self._eyes = _with_room(self._eyes, self._n_eyes + 1)
        self._before, self._camera = (
            _with_room(each, self._n_pairs + len(faces)) for each in (self._before, self._camera)
        )
        self._eyes[self._n_eyes] = eye
        self._n_pairs = add_rays(
            self._n_eyes, faces.astype(np.int32), self._eyes, self._centroids, self._min_cosine,
            self._first, self._is_near, self._last, self._before, self._camera, self._n_pairs,
            self.is_spread,
        )  # fmt: skip
        self._n_eyes += 1


def _with_room(array: NDArray[Any], n: int) -> NDArray[Any]:
    """The array with room for n rows or more; twice as much as it had where it grows."""
    if len(array) >= n:
        return array
    return np.resize(array, (max(n, 2 * len(array)), *array.shape[1:]))


class Network(InNotebook):
    """Coverage of each face by all cameras, added up batch by batch.

    `add` changes it, so one thread at a time may use it.

    Attributes
    ----------
    views : (F,) int64
        Cameras that cover the face: coverage of at least `Task.min_coverage`, and not 0.
    best : (F,) float64
        Greatest coverage by any camera.
    best_pose : (F,) int64
        The pose that gives it, the first of equals; -1 where `best` is 0.
    reason : (F,) uint8
        `Reason` of the camera that came nearest to covering the face.
    pose_ids : list of int
        The poses so far.
    covered_faces, mean_coverage : list
        For each of them: task faces it covers, and mean coverage over task faces.
    kinds : (3,) int64
        Pairs of pose and task face, any part of which is in view from the front, by the
        `BoundKind` of their visibility.
    largest_bound : float
        Greatest `visibility_bound` of these.
    largest_covered_bound : float
        Greatest `visibility_bound` of any pair that counts as covered.
    clipped_poses : list of int
        Poses in which the near plane cut away a surface in view.
    """

    def __init__(self, mesh: Mesh, task: Task) -> None:
        self.mesh, self.task = mesh, task
        self.views: IntArray = np.zeros(mesh.n_faces, np.int64)
        self.best: FloatArray = np.zeros(mesh.n_faces)
        self.best_pose: IntArray = np.full(mesh.n_faces, -1, np.int64)
        self.reason: NDArray[np.uint8] = np.zeros(mesh.n_faces, np.uint8)
        self.pose_ids: list[int] = []
        self.covered_faces: list[int] = []
        self.mean_coverage: list[float] = []
        self.kinds: IntArray = np.zeros(len(BoundKind), np.int64)
        self.largest_bound = 0.0
        self.largest_covered_bound = 0.0
        self.clipped_poses: list[int] = []
        self._spread = ViewSpread(mesh.centroids, math.radians(task.min_angle_deg))

    def add(self, coverage: "Coverage | JudgedPoses", camera: int | None = None) -> None:
        """Take in the next poses; ConfigError when they are of another mesh or task.

        With `camera`, an index, only those of one camera, of poses that were judged apart.
        """
        if isinstance(coverage, JudgedPoses):
            self._add_judged(coverage, camera)
            return
        if coverage.task != self.task or coverage.mesh.n_faces != self.mesh.n_faces:
            raise ConfigError("a network adds up coverage of one mesh and one task")
        if len(coverage.pose_ids):
            if self.task.min_angle_deg > 0:
                for eye, reason in zip(coverage.eyes, coverage.reason, strict=True):
                    self._spread.add(eye, np.flatnonzero(reason == Reason.COVERED))
            figures = {name: getattr(coverage, name) for name in SUMMED}
            cameras = np.zeros(len(coverage.pose_ids), np.int32)
            sums = sums_of(self.mesh, figures, cameras, apart=False)[-1]
            self._take(coverage.pose_ids, coverage.clipped, sums)

    @typed
    def judge(
        self,
        observer: Observer,
        poses: Poses,
        *,
        pairs: str = "none",
        apart: bool = False,
    ) -> "Iterator[JudgedPoses]":
        """Measure poses, a few at a time, for `add`; at least one batch, maybe empty.

        The figures are added up in the threads that compute them, as `add(evaluate(...))` would,
        bit for bit. A batch counts as a whole or, after an interrupt or an error, not at all.

        Parameters
        ----------
        observer : Observer
            Open, for the mesh of the network.
        poses : Poses
            World from camera.
        pairs : {"none", "covered", "seen", "all"}
            Pairs of pose and face whose figures are kept as rows; see `CHOICES`.
        apart : bool
            Keep the sums of each camera apart, so that networks may add those of one camera.

        Raises
        ------
        ConfigError
            For an observer of another mesh, or another choice of pairs.
        """
        check_observer(observer)
        check_choice("pairs", pairs, CHOICES)
        if pairs == "none" and self.task.min_angle_deg > 0:
            pairs = "covered"  # the rays to them are needed
        if observer.mesh.n_faces != self.mesh.n_faces:
            raise ConfigError("a network adds up coverage of one mesh and one task")
        judge = FacePass(observer.mesh, observer.camera, observer.threads, self.task)
        choice, n_faces = CHOICES.index(pairs), self.mesh.n_faces
        n_rows = min(len(poses), batch_size(n_faces, observer.threads)) * n_faces if choice else 0
        # Used again for each batch; what no row is written to is never taken from the system.
        memory = PairRows(*(np.empty(n_rows, ROW_TYPES[name]) for name in PairRows._fields))

        def judged(batch: Poses, seen: Measured) -> JudgedPoses:
            sink = Sink(choice, batch.ids, np.zeros(len(batch), np.int64), memory)
            of_threads: list[dict[int, Sums]] = []

            def worker() -> Worker:
                sums, add = _adder(judge, sink, apart=apart)
                of_threads.append(sums)
                return add

            if len(batch):
                judge.share(seen, batch, worker)
            parts: dict[int, list[Sums]] = {}
            for camera, sums in (entry for part in of_threads for entry in part.items()):
                parts.setdefault(camera, []).append(sums)
            turns = np.flatnonzero(sink.counts)
            spans = np.stack([turns * n_faces, turns * n_faces + sink.counts[turns]], axis=1)
            columns = (
                np.concatenate([part[:0], *(part[start:stop] for start, stop in spans.tolist())])
                for part in memory
            )
            whole = {camera: _merged(some) for camera, some in parts.items()}
            rows = PairRows(*columns)
            found = JudgedPoses.of(batch, seen, rows, whole, observer.camera)
            if found.leads is not None and found.regions is None:
                raise ConfigError(OF_PARTS)
            if found.leads is not None and len(batch):
                figures = arrays_for(list(SUMMED), (len(batch), n_faces))
                judge.fill(seen, batch, figures)
                whole[RESULT] = sums_of_rigs(
                    self.mesh, self.task, observer.camera, batch, figures, found.regions
                )
                whole[RESULT].kinds[:] = sum(part.kinds for at, part in whole.items() if at >= 0)
            return found

        together = rows_of_result(observer.camera, poses)
        return (judged(batch, seen) for batch, seen in measurements(observer, poses, together))

    def _add_judged(self, batch: JudgedPoses, camera: int | None) -> None:
        """Add the sums of a batch, or those of one of its cameras."""
        wanted = RESULT if camera is None and batch.leads is not None else camera
        parts = [sums for index, sums in batch.sums.items() if wanted in (None, index)]
        if not parts:
            return
        own = slice(None) if camera is None else batch.poses.camera == camera
        if wanted == RESULT:
            own = batch.leads
        self._take(batch.poses.ids, batch.clipped, _merged(parts), own)
        if self.task.min_angle_deg > 0:
            placed, rows = batch.poses[own], batch.rows
            is_covered = rows.reason == Reason.COVERED
            for eye, pose in zip(placed.world_from_camera[:, :3, 3], placed.ids, strict=True):
                self._spread.add(eye, rows.face[is_covered & (rows.pose == pose)])

    def _take(
        self,
        pose_ids: IntArray,
        clipped: BoolArray,
        sums: Sums,
        own: slice | BoolArray = slice(None),
    ) -> None:
        """Add the sums of a batch of poses; `own` are those that count."""
        self.views += sums.views
        better = sums.best > self.best
        self.best[better] = sums.best[better]
        self.best_pose[better] = pose_ids[sums.best_row[better]]
        self.reason = np.maximum(self.reason, sums.reason)
        self.pose_ids += pose_ids[own].tolist()
        self.covered_faces += sums.covered_faces[own].tolist()
        n_scored = max(1, int(self.mesh.task_mask.sum()))
        self.mean_coverage += (sums.totals[own] / n_scored).tolist()
        self.kinds += sums.kinds
        self.largest_bound = max(self.largest_bound, float(sums.bounds[0]))
        self.largest_covered_bound = max(self.largest_covered_bound, float(sums.bounds[1]))
        self.clipped_poses += pose_ids[own][clipped[own]].tolist()

    @property
    def covered(self) -> BoolArray:
        """(F,) faces covered by `Task.views` cameras, from directions that differ as asked."""
        return (self.views >= self.task.views) & self._spread.is_spread

    def summary(self) -> dict[str, Any]:
        """Figures of the network, ready for JSON; every percentage by count and by area.

        Occluder-only groups are left out of all totals.
        """
        mesh, task_faces, covered = self.mesh, self.mesh.task_mask, self.covered
        why = reason_rows(self.reason, covered, len(self.pose_ids))
        hidden, is_zero = self.unseeable_areas, self.best == 0
        is_left = ~covered & (hidden == 0)

        def figures(members: BoolArray) -> dict[str, Any]:
            area, unseeable = float(mesh.areas[members].sum()), float(hidden[members].sum())
            found = {"area_m2": area, "unseeable_m2": unseeable}
            covered_m2 = float(mesh.areas[members & covered].sum())
            return {
                "covered": share_of_faces(mesh, members & covered, members),
                "zero_in_every_camera": share_of_faces(mesh, members & is_zero, members),
                "seeable_not_covered_because": shares_by_reason(
                    mesh, why, members & is_left, members
                ),
                **found,
                "covered_of_seeable_percent": percent_of_seeable(covered_m2, found),
            }

        def entry(name: str, rows: list[int]) -> dict[str, Any]:
            scored = [row for row in rows if not mesh.groups[row].is_occluder]
            roles = {mesh.groups[row].role for row in scored or rows}
            members = np.isin(mesh.face_group, scored or rows)
            return {
                "name": name,
                "role": roles.pop() if len(roles) == 1 else "task",
                "two_sided": all(mesh.groups[row].is_two_sided for row in rows),
                "faces": int(members.sum()),
                **(figures(members) if scored else {}),
            }

        return {
            "poses": len(self.pose_ids),
            "faces": mesh.n_faces,
            "task_faces": int(task_faces.sum()),
            "required_views": self.task.views,
            "not_covered": share_of_faces(mesh, task_faces & ~covered, task_faces),
            "not_covered_because": shares_by_reason(mesh, why, task_faces & ~covered, task_faces),
            "mean_best_coverage": float(self.best[task_faces].mean()) if task_faces.any() else 0.0,
            "mean_views": float(self.views[task_faces].mean()) if task_faces.any() else 0.0,
            "visibility_figures": {
                kind.name.lower(): int(self.kinds[kind]) for kind in reversed(BoundKind)
            },
            "largest_visibility_bound": self.largest_bound,
            "largest_visibility_bound_of_covered": self.largest_covered_bound,
            "near_clipped_poses": self.clipped_poses,
            **figures(task_faces),
            "unseeable_because": UNSEEABLE if hidden.any() else "",
            "groups": [entry(group.name, [row]) for row, group in enumerate(mesh.groups)],
            "parts": [
                entry(name, rows) | {"level": 1 + name.count("/"), "groups": len(rows)}
                for name, rows in parts_of(mesh.groups).items()
            ],
        }

    @property
    def unseeable_areas(self) -> FloatArray:
        """(F,) area that no camera can ever see: proved, m^2; see `rastercov.mesh.unseeable`."""
        from rastercov.mesh.unseeable import unseeable_where_seen

        return unseeable_where_seen(self.mesh, self.best)


def percent_of_seeable(covered_m2: float, entry: Mapping[str, float]) -> float | None:
    """Covered percentage of the area that can be seen; None where none can be."""
    seeable = entry["area_m2"] - entry["unseeable_m2"]
    return min(100 * covered_m2 / seeable, 100.0) if seeable > 0 else None


def share_of_faces(mesh: Mesh, part: BoolArray, whole: BoolArray) -> dict[str, float]:
    """Faces of a part, and its percentage of the whole by count and by area; masks are (F,)."""
    areas = mesh.areas
    by_count = 100 * part.sum() / max(1, whole.sum())
    by_area = 100 * areas[part].sum() / max(areas[whole].sum(), np.finfo(float).tiny)
    return {"faces": int(part.sum()), "percent": float(by_count), "area_percent": float(by_area)}


def shares_by_reason(
    mesh: Mesh, why: NDArray[np.uint8], left: BoolArray, whole: BoolArray
) -> dict[str, dict[str, float]]:
    """Share of the faces that are left of a whole, by the names of the `reason_rows` of all."""
    return {
        NAMES[row]: share_of_faces(mesh, left & (why == row), whole)
        for row in np.unique(why[left]).tolist()
    }
