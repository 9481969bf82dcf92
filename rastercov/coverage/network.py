"""Coverage by a network of cameras: by face, by group, by count and by area.

E. S. Eissa. Image Space Coverage Model. 2020, section 6.4.1 and Table 6.1, where a face counts as
not covered when its coverage is 0 in every camera.
"""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.arguments import check_kind
from rastercov.base.checks import shown
from rastercov.base.errors import ConfigError, MeshError
from rastercov.base.memory import read_only
from rastercov.base.typed import typed
from rastercov.camera.pose import Poses
from rastercov.coverage.coverage import Coverage, batch_size, check_observer, measurements
from rastercov.coverage.face_pass import FacePass, Measured, Scope, Worker
from rastercov.coverage.observer import Observer
from rastercov.coverage.task import Reason, Rules, Task
from rastercov.kernels.direct import DirectCalls
from rastercov.mesh import Mesh
from rastercov.raster.observation import BoundKind

if TYPE_CHECKING:
    from rastercov.kernels.network import PairRows, Sink

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]


CHOICES = ("none", "covered", "seen", "all")
"""Pairs that a table may hold: those covered; those seen, that is with some part of the face in the
image and its front to the camera, though other faces may hide it; or every pair."""
SUMMED: dict[str, Any] = {
    "coverage": np.float64,
    "reason": np.uint8,
    "visibility_bound": np.float64,
    "visibility_kind": np.uint8,
    "in_view_fraction": np.float64,
    "drawn_pixels": np.float64,
}
"""Figures that a network adds up, and their types: the arguments of `add_rows` of the kernels, and
the pixels of each face."""


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
    kept : dict
        Coverage (F,) float64 of the poses to keep, by their ids.
    measured : Observation or FaceCounts, or None
        Measurement of the poses, of those that this process has measured.
    """

    poses: Poses
    clipped: BoolArray
    rows: "PairRows"
    kept: dict[int, FloatArray]
    measured: Measured | None
    parts: "list[tuple[int, Part]]"

    @property
    def pose_ids(self) -> IntArray:
        """(P,) row of each pose in the input."""
        return self.poses.ids


def joined(mesh: Mesh, poses: Poses, batches: "Sequence[JudgedPoses]") -> JudgedPoses:
    """Batches of some poses as one, whatever their sizes and the number of threads."""
    rows = [batch.rows for batch in batches]
    ends = np.cumsum([0] + [len(batch.poses) for batch in batches])
    whole: dict[int, Part] = {}
    for first, batch in zip(ends, batches, strict=False):
        for camera, part in batch.parts:
            whole.setdefault(camera, Part(mesh, int(ends[-1]))).merge(part, int(first))
    kept = {pose: values for batch in batches for pose, values in batch.kept.items()}
    return JudgedPoses(
        poses=poses,
        clipped=np.concatenate([batch.clipped for batch in batches]),
        rows=type(rows[0])(*map(np.concatenate, zip(*rows, strict=True))),
        kept=kept,
        measured=None,
        parts=sorted(whole.items(), key=lambda entry: entry[0]),
    )


def to_arrays(batch: JudgedPoses) -> dict[str, NDArray[Any]]:
    """Arrays of a batch by name; `from_arrays` has their meaning."""
    arrays = {f"rows.{name}": values for name, values in batch.rows._asdict().items()}
    arrays["clipped"] = batch.clipped
    arrays |= {f"kept.{pose}": values for pose, values in batch.kept.items()}
    for camera, part in batch.parts:
        of_part = part.sums._asdict() | {name: getattr(part, name) for name in OF_POSES}
        arrays |= {f"part.{camera}.{name}": values for name, values in of_part.items()}
    return arrays


def from_arrays(mesh: Mesh, poses: Poses, arrays: Mapping[str, NDArray[Any]]) -> JudgedPoses:
    """Batch of some poses from the arrays of `to_arrays`."""
    from rastercov.kernels.network import PairRows, Sums

    tree: dict[str, dict[str, Any]] = {"rows": {}, "kept": {}}
    parts: dict[int, dict[str, Any]] = {}
    for name, values in arrays.items():
        kind, _, rest = name.partition(".")
        if kind == "part":
            camera, _, figure = rest.partition(".")
            parts.setdefault(int(camera), {})[figure] = values
        elif kind in tree:
            tree[kind][rest] = values
    found = []
    for index, figures in parts.items():
        part = Part(mesh, len(poses))
        for name in OF_POSES:
            setattr(part, name, figures.pop(name))
        part.sums = Sums(**figures)
        found.append((index, part))
    return JudgedPoses(
        poses=poses,
        clipped=arrays["clipped"],
        rows=PairRows(**tree["rows"]),
        kept={int(pose): values for pose, values in tree["kept"].items()},
        measured=None,
        parts=found,
    )


OF_POSES = ("covered_faces", "totals", "images")
"""Arrays of a `Part` with a value for each pose."""


class Part:
    """Sums of some of the poses of a batch, made by one thread.

    `covered_faces`, `totals` of coverage and `images` are (P,), 0 for the poses of other parts.
    """

    def __init__(self, mesh: Mesh, n_poses: int) -> None:
        from rastercov.kernels import network  # loads numba

        self.kernels, n = network, mesh.n_faces
        self.sums = network.Sums(
            views=np.zeros(n, np.int64),
            best=np.zeros(n),
            best_row=np.zeros(n, np.int64),
            reason=np.zeros(n, np.uint8),
            kinds=np.zeros(len(BoundKind), np.int64),
            bounds=np.zeros(2),
        )
        self.covered_faces = np.zeros(n_poses, np.int64)
        self.totals, self.images = np.zeros((2, n_poses))
        self._is_scored = read_only(mesh.task_mask, np.bool_)
        self._scored = None if mesh.task_mask.all() else np.flatnonzero(mesh.task_mask)
        self._coverage, self._drawn = np.empty((2, n))
        self._calls: dict[int, DirectCalls] = {}

    def add_coverage(self, coverage: Coverage) -> None:
        """Add all poses of the batch."""
        arrays = [read_only(getattr(coverage, name), kind) for name, kind in SUMMED.items()]
        *added, drawn = arrays
        self.kernels.add_rows(self._is_scored, *added, self.sums, self.covered_faces)
        for row in range(len(drawn)):  # 10 us each
            self._add_sums(row, added[0][row], drawn[row])

    def add_poses(
        self,
        scope: Scope,
        rules: Sequence[Rules],
        sink: "Sink",
        kept: dict[int, FloatArray],
        rows: slice,
        index: int,
    ) -> None:
        """Judge some poses of one camera of the batch and add them; their rows go to `sink`."""
        arguments, coverage = scope(index), self._coverage
        seen = arguments[2]
        own = self._is_scored, self.sums, self.covered_faces, coverage
        call = self._calls.setdefault(index, DirectCalls())
        for row in range(rows.start, rows.stop):
            call(self.kernels.add_pose, row, rows.start, *arguments, rules[index], *own, sink)
            drawn = seen.drawn[row]
            if seen.scale != 1 or drawn.dtype != np.float64:
                drawn = np.divide(drawn, seen.scale, out=self._drawn)
            self._add_sums(row, coverage, drawn)
            pose_id = int(sink.pose_ids[row])
            if pose_id in kept:
                kept[pose_id][:] = coverage

    def _add_sums(self, row: int, coverage: FloatArray, drawn: FloatArray) -> None:
        """Sums over the scored faces of one pose."""
        if self._scored is not None:
            coverage, drawn = coverage.take(self._scored), drawn.take(self._scored)
        self.totals[row], self.images[row] = coverage.sum(), drawn.sum()

    def merge(self, other: "Part", first: int = 0) -> None:
        """Add the sums of other poses; their row 0 is row `first` of this one."""
        ours, theirs = self.sums, other.sums
        ours.views[:] += theirs.views
        rows = theirs.best_row + first
        better = (theirs.best > ours.best) | ((theirs.best == ours.best) & (rows < ours.best_row))
        ours.best[better], ours.best_row[better] = theirs.best[better], rows[better]
        np.maximum(ours.reason, theirs.reason, out=ours.reason)
        ours.kinds[:] += theirs.kinds
        np.maximum(ours.bounds, theirs.bounds, out=ours.bounds)
        own = slice(first, first + len(other.totals))
        for name in OF_POSES:
            getattr(self, name)[own] += getattr(other, name)


class PairBuffer:
    """Memory for the rows of a batch of poses, used again for each batch.

    Parameters
    ----------
    choice : {"none", "covered", "seen", "all"}
        Pairs to keep.
    n_poses, n_faces : int
        Size of the largest batch.

    Raises
    ------
    ConfigError
        For another choice.
    """

    def __init__(self, choice: str, n_poses: int, n_faces: int) -> None:
        from rastercov.kernels import network as kernels  # loads numba

        check_choice(choice)
        self.choice, self._kernels, self._n_faces = CHOICES.index(choice), kernels, n_faces
        size = n_poses * n_faces if self.choice else 0
        # Memory that no row is written to is never taken from the system.
        self._memory = kernels.PairRows(
            *(np.empty(size, kernels.ROW_TYPES[name]) for name in kernels.PairRows._fields)
        )
        self._counts: NDArray[np.int64] = np.zeros(0, np.int64)

    def sink(self, pose_ids: NDArray[np.int64]) -> "Sink":
        """Empty memory for the rows of these poses, (P,)."""
        self._counts = np.zeros(len(pose_ids), np.int64)
        return self._kernels.Sink(self.choice, pose_ids, self._counts, self._memory)

    def rows(self) -> "PairRows":
        """Copy of the rows of the batch, by pose, then by face."""
        starts = np.flatnonzero(self._counts)
        spans = [(at * self._n_faces, self._counts[at]) for at in starts.tolist()]
        return self._kernels.PairRows(*(_joined(column, spans) for column in self._memory))


def check_choice(choice: object) -> None:
    """Raise `ConfigError` for what is no choice of pairs."""
    if choice not in CHOICES:
        raise ConfigError(f"pairs must be one of {', '.join(CHOICES)}, got {shown(choice)}")


def _joined(column: NDArray[Any], spans: list[tuple[int, int]]) -> NDArray[Any]:
    return np.concatenate([column[:0], *(column[at : at + n] for at, n in spans)])


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
        self._centroids = np.array(centroids, np.float64)
        self._min_cosine, self._is_asked = least_cosine(min_angle), min_angle > 0
        self.is_spread = np.full(n, not self._is_asked)
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
        from rastercov.kernels.spread import add_rays

        self._eyes = _with_room(self._eyes, self._n_eyes + 1)
        self._before = _with_room(self._before, self._n_pairs + len(faces))
        self._camera = _with_room(self._camera, self._n_pairs + len(faces))
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
    grown = np.empty((max(n, 2 * len(array)), *array.shape[1:]), array.dtype)
    grown[: len(array)] = array
    return grown


class Network:
    """Coverage of each face by all cameras, added up batch by batch.

    `add` and `add_poses` change it, so one thread at a time may use it.

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
    largest_image : float
        Greatest sum of `drawn_pixels` over the task faces in one pose, px^2.
    clipped_poses : list of int
        Poses in which the near plane cut away a surface in view.
    """

    def __init__(self, mesh: Mesh, task: Task) -> None:
        check_kind("mesh", mesh, Mesh, "a Mesh", MeshError)
        check_kind("task", task, Task, "a Task", ConfigError)
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
        self.largest_image = 0.0
        self.clipped_poses: list[int] = []
        self._spread = ViewSpread(mesh.centroids, math.radians(task.min_angle_deg))

    def add(self, coverage: "Coverage | JudgedPoses", camera: int | None = None) -> None:
        """Take in the next poses; ConfigError when they are of another mesh or task.

        With `camera`, an index, only those of one camera, of poses that were judged apart.
        """
        if isinstance(coverage, JudgedPoses):
            self._take_judged(coverage, camera)
            return
        check_kind("coverage", coverage, Coverage, "what evaluate gives", ConfigError)
        if coverage.task != self.task or coverage.mesh.n_faces != self.mesh.n_faces:
            raise ConfigError("a network adds up coverage of one mesh and one task")
        if len(coverage.pose_ids):
            part = Part(self.mesh, len(coverage.pose_ids))
            part.add_coverage(coverage)
            self._spread_rays(coverage.eyes, coverage.reason == Reason.COVERED)
            self._take(coverage.pose_ids, coverage.clipped, part)

    def add_poses(
        self, observer: Observer, poses: ArrayLike | Poses, *, skip_bad_poses: bool = False
    ) -> None:
        """Measure further poses and take them in, as `add(evaluate(...))` would, bit for bit.

        The figures of a few poses at a time are added up in the threads that compute them. A batch
        of poses counts as a whole or, after an interrupt or an error, not at all.

        Parameters
        ----------
        observer : Observer
            Open, for the mesh of the network.
        poses : (P, 4, 4) array_like, or Poses
            world_from_camera.
        skip_bad_poses : bool
            Leave out poses that are no rigid motion instead of raising.

        Raises
        ------
        ConfigError
            For an observer of another mesh.
        PoseError
            For a pose that is no rigid motion.
        """
        for batch in self.judge(observer, Poses.of(poses, skip_bad=skip_bad_poses)):
            self.add(batch)

    @typed
    def judge(
        self,
        observer: Observer,
        poses: Poses,
        *,
        pairs: str = "none",
        keep: Collection[int] = (),
        apart: bool = False,
    ) -> "Iterator[JudgedPoses]":
        """Measure poses, a few at a time, for `add`; at least one batch, maybe empty.

        Parameters
        ----------
        observer : Observer
            Open, for the mesh of the network.
        poses : Poses
            World from camera.
        pairs : {"none", "covered", "seen", "all"}
            Pairs of pose and face whose figures are kept as rows; see `CHOICES`.
        keep : collection of int
            Ids of poses whose coverage is kept.
        apart : bool
            Keep the sums of each camera apart, so that networks may add those of one camera.

        Raises
        ------
        ConfigError
            For an observer of another mesh, or another choice of pairs.
        """
        check_observer(observer)
        if pairs == "none" and self.task.min_angle_deg > 0:
            pairs = "covered"  # the rays to them are needed
        if observer.mesh.n_faces != self.mesh.n_faces:
            raise ConfigError("a network adds up coverage of one mesh and one task")

        judge = FacePass(observer.mesh, observer.camera, observer.threads, self.task)
        n_faces = self.mesh.n_faces
        buffer = PairBuffer(pairs, min(len(poses), batch_size(n_faces, observer.threads)), n_faces)
        return (
            self._judged(judge, batch, seen, buffer, keep, apart)
            for batch, seen in measurements(observer, poses)
        )

    def _judged(
        self,
        judge: FacePass,
        poses: Poses,
        seen: Measured,
        buffer: PairBuffer,
        keep: Collection[int],
        apart: bool,
    ) -> "JudgedPoses":
        """Judge the poses of a measurement."""
        sink = buffer.sink(poses.ids)
        kept = {pose: np.empty(self.mesh.n_faces) for pose in poses.ids.tolist() if pose in keep}
        parts: list[tuple[int, Part]] = []

        def worker(scope: Scope) -> Worker:
            own: dict[int, Part] = {}

            def work(rows: slice, index: int) -> None:
                camera = index if apart else -1
                if camera not in own:
                    own[camera] = Part(self.mesh, len(poses))
                    parts.append((camera, own[camera]))
                own[camera].add_poses(scope, judge.rules, sink, kept, rows, index)

            return work

        if len(poses):
            judge.share(seen, poses, worker)
        return JudgedPoses(poses, seen.clipped, buffer.rows(), kept, seen, parts)

    def _spread_rays(self, eyes: FloatArray, covers: BoolArray) -> None:
        """Add the rays of cameras, (P, 3), that cover faces, (P, F)."""
        if self.task.min_angle_deg > 0:
            for eye, row in zip(eyes, covers, strict=True):
                self._spread.add(eye, np.flatnonzero(row))

    def _take_judged(self, batch: "JudgedPoses", camera: int | None) -> None:
        """Add the sums of a batch, or those of one of its cameras."""
        parts = [part for index, part in batch.parts if camera in (None, index)]
        if not parts:
            return
        whole, *others = parts
        if others:
            whole = Part(self.mesh, len(batch.poses))
            for part in parts:
                whole.merge(part)
        own = slice(None) if camera is None else batch.poses.camera == camera
        self._take(batch.pose_ids, batch.clipped, whole, own)
        if self.task.min_angle_deg > 0:
            placed, rows = batch.poses[own], batch.rows
            is_covered = rows.reason == Reason.COVERED
            for eye, pose in zip(placed.world_from_camera[:, :3, 3], placed.ids, strict=True):
                self._spread.add(eye, rows.face[is_covered & (rows.pose == pose)])

    def _take(
        self,
        pose_ids: IntArray,
        clipped: BoolArray,
        first: "Part",
        own: slice | BoolArray = slice(None),
    ) -> None:
        """Add the sums of a batch of poses; `own` are those that count."""
        sums = first.sums
        self.views += sums.views
        better = sums.best > self.best
        self.best[better] = sums.best[better]
        self.best_pose[better] = pose_ids[sums.best_row[better]]
        self.reason = np.maximum(self.reason, sums.reason)
        self.pose_ids += pose_ids[own].tolist()
        self.covered_faces += first.covered_faces[own].tolist()
        n_scored = max(1, int(self.mesh.task_mask.sum()))
        self.mean_coverage += (first.totals[own] / n_scored).tolist()
        self.largest_image = max(self.largest_image, float(first.images.max()))
        self.kinds += sums.kinds
        self.largest_bound = max(self.largest_bound, float(sums.bounds[0]))
        self.largest_covered_bound = max(self.largest_covered_bound, float(sums.bounds[1]))
        self.clipped_poses += pose_ids[own][clipped[own]].tolist()

    @property
    def covered(self) -> BoolArray:
        """(F,) faces covered by `Task.views` cameras, from directions that differ as asked."""
        covered: BoolArray = (self.views >= self.task.views) & self._spread.is_spread
        return covered

    def summary(self) -> dict[str, Any]:
        """Figures of the network, ready for JSON; every percentage by count and by area.

        Occluder-only groups are left out of all totals.
        """
        task_faces = self.mesh.task_mask
        unseen = task_faces & ~self.covered
        reasons = {
            name.name.lower() if name != Reason.COVERED else "too_few_views": share_of_faces(
                self.mesh, unseen & (self.reason == name), task_faces
            )
            for name in Reason
            if (unseen & (self.reason == name)).any()
        }
        if not self.pose_ids:
            reasons = {"no_cameras": share_of_faces(self.mesh, unseen, task_faces)}
        return {
            "poses": len(self.pose_ids),
            "faces": self.mesh.n_faces,
            "task_faces": int(task_faces.sum()),
            "required_views": self.task.views,
            "covered": share_of_faces(self.mesh, task_faces & self.covered, task_faces),
            "not_covered": share_of_faces(self.mesh, unseen, task_faces),
            "zero_in_every_camera": share_of_faces(
                self.mesh, task_faces & (self.best == 0), task_faces
            ),
            "not_covered_because": reasons,
            "mean_best_coverage": float(self.best[task_faces].mean()) if task_faces.any() else 0.0,
            "mean_views": float(self.views[task_faces].mean()) if task_faces.any() else 0.0,
            "visibility_figures": {
                kind.name.lower(): int(self.kinds[kind]) for kind in reversed(BoundKind)
            },
            "largest_visibility_bound": self.largest_bound,
            "largest_visibility_bound_of_covered": self.largest_covered_bound,
            "largest_image_pixels": self.largest_image,
            "near_clipped_poses": self.clipped_poses,
            "groups": [self._group(index) for index in range(len(self.mesh.groups))],
        }

    def _group(self, index: int) -> dict[str, Any]:
        group, members = self.mesh.groups[index], self.mesh.face_group == index
        entry: dict[str, Any] = {
            "name": group.name,
            "role": group.role,
            "two_sided": group.is_two_sided,
            "faces": int(members.sum()),
        }
        if not group.is_occluder:
            entry["covered"] = share_of_faces(self.mesh, members & self.covered, members)
            entry["zero_in_every_camera"] = share_of_faces(
                self.mesh, members & (self.best == 0), members
            )
        return entry


def share_of_faces(mesh: Mesh, part: BoolArray, whole: BoolArray) -> dict[str, float]:
    """Faces of a part, and its percentage of the whole by count and by area; masks are (F,)."""
    areas = mesh.areas
    by_count = 100 * part.sum() / max(1, whole.sum())
    by_area = 100 * areas[part].sum() / max(areas[whole].sum(), np.finfo(float).tiny)
    return {
        "faces": int(part.sum()),
        "percent": float(by_count),
        "area_percent": float(by_area),
    }
