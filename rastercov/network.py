"""Coverage by a network of cameras: by face, by group, by count and by area.

E. S. Eissa. Image Space Coverage Model. 2020, section 6.4.1 and Table 6.1, where a face counts as
not covered when its coverage is 0 in every camera.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov._arguments import check_kind
from rastercov._threads import threads_of
from rastercov.coverage import Coverage, batch_size, check_observer, measurements
from rastercov.coverage_pass import CoveragePass
from rastercov.errors import ConfigError, MeshError
from rastercov.face_pass import Measured, Scope, Worker
from rastercov.mesh import Mesh
from rastercov.observation import BoundKind
from rastercov.observer import Observer
from rastercov.pairs import PairBuffer
from rastercov.pose import Poses
from rastercov.task import Limits, Reason, Task

if TYPE_CHECKING:
    from rastercov.network_kernels import PairRows, Sink

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

_ADDED: dict[str, Any] = {
    "coverage": np.float64,
    "reason": np.uint8,
    "visibility_bound": np.float64,
    "visibility_kind": np.uint8,
    "in_view_fraction": np.float64,
    "drawn_pixels": np.float64,
}
"""Figures that a network adds up, and their types: the arguments of `add_rows` of the kernels, and
the pixels of each face."""


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

    def add(self, coverage: "Coverage | JudgedPoses") -> None:
        """Take in the next poses; ConfigError when they are of another mesh or task."""
        if isinstance(coverage, JudgedPoses):
            self._take(coverage.pose_ids, coverage.clipped, coverage.parts)
            return
        check_kind("coverage", coverage, Coverage, "what evaluate gives", ConfigError)
        if coverage.task != self.task or coverage.mesh.n_faces != self.mesh.n_faces:
            raise ConfigError("a network adds up coverage of one mesh and one task")
        if len(coverage.pose_ids):
            part = _Part(self.mesh, len(coverage.pose_ids))
            part.add_coverage(coverage)
            self._take(coverage.pose_ids, coverage.clipped, [part])

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

    def judge(
        self, observer: Observer, poses: Poses, *, pairs: str = "none", keep: Collection[int] = ()
    ) -> "Iterator[JudgedPoses]":
        """Measure poses, a few at a time, for `add`; at least one batch, maybe empty.

        Parameters
        ----------
        observer : Observer
            Open, for the mesh of the network.
        poses : Poses
            World from camera.
        pairs : {"none", "covered", "seen", "all"}
            Pairs of pose and face whose figures are kept as rows; see `rastercov.pairs`.
        keep : collection of int
            Ids of poses whose coverage is kept.

        Raises
        ------
        ConfigError
            For an observer of another mesh, or another choice of pairs.
        """
        check_observer(observer)
        if observer.mesh.n_faces != self.mesh.n_faces:
            raise ConfigError("a network adds up coverage of one mesh and one task")
        from rastercov import network_kernels  # loads numba
        from rastercov._jit import announce_compilation

        judge = CoveragePass(observer, self.task)
        announce_compilation(network_kernels.add_pose)
        n_faces = self.mesh.n_faces
        buffer = PairBuffer(
            pairs, min(len(poses), batch_size(n_faces, threads_of(observer))), n_faces
        )
        return (
            self._judged(judge, batch, seen, buffer, keep)
            for batch, seen in measurements(observer, poses)
        )

    def _judged(
        self,
        judge: CoveragePass,
        poses: Poses,
        seen: Measured,
        buffer: PairBuffer,
        keep: Collection[int],
    ) -> "JudgedPoses":
        """Judge the poses of a measurement."""
        sink = buffer.sink(poses.ids)
        kept = {pose: np.empty(self.mesh.n_faces) for pose in poses.ids.tolist() if pose in keep}
        parts: list[_Part] = []

        def worker(scope: Scope) -> Worker:
            parts.append(_Part(self.mesh, len(poses)))
            return partial(parts[-1].add_poses, scope, judge.limits, sink, kept)

        if len(poses):
            judge.share(seen, poses, worker)
        return JudgedPoses(poses.ids, seen.clipped, buffer.rows(), kept, seen, parts)

    def _take(self, pose_ids: IntArray, clipped: BoolArray, parts: "list[_Part]") -> None:
        """Add the sums of the parts of a batch of poses."""
        if not parts:
            return
        first, *others = parts
        for other in others:
            first.merge(other)
        sums = first.sums
        self.views += sums.views
        better = sums.best > self.best
        self.best[better] = sums.best[better]
        self.best_pose[better] = pose_ids[sums.best_row[better]]
        self.reason = np.maximum(self.reason, sums.reason)
        self.pose_ids += pose_ids.tolist()
        self.covered_faces += first.covered_faces.tolist()
        n_scored = max(1, int(self.mesh.task_mask.sum()))
        self.mean_coverage += (first.totals / n_scored).tolist()
        self.largest_image = max(self.largest_image, float(first.images.max()))
        self.kinds += sums.kinds
        self.largest_bound = max(self.largest_bound, float(sums.bounds[0]))
        self.largest_covered_bound = max(self.largest_covered_bound, float(sums.bounds[1]))
        self.clipped_poses += pose_ids[clipped].tolist()

    @property
    def covered(self) -> BoolArray:
        """Faces covered by at least `Task.views` cameras, (F,)."""
        return self.views >= self.task.views

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


@dataclass(frozen=True, eq=False)
class JudgedPoses:
    """A few poses that a network has judged and not yet added; see `Network.judge`.

    Attributes
    ----------
    pose_ids : (P,) int64
        Row of each pose in the input.
    clipped : (P,) bool
        Whether the near plane cut away a surface in view.
    rows : PairRows
        Figures of the pairs that were asked for, by pose, then by face.
    kept : dict
        Coverage (F,) float64 of the poses to keep, by their ids.
    measured : Observation or FaceCounts
        Measurement of the poses.
    """

    pose_ids: IntArray
    clipped: BoolArray
    rows: "PairRows"
    kept: dict[int, FloatArray]
    measured: Measured
    parts: "list[_Part]"


class _Part:
    """Sums of some of the poses of a batch, made by one thread.

    `covered_faces`, `totals` of coverage and `images` are (P,), 0 for the poses of other parts.
    """

    def __init__(self, mesh: Mesh, n_poses: int) -> None:
        from rastercov import criteria_kernels, network_kernels  # load numba

        self.kernels, n = network_kernels, mesh.n_faces
        self._read_only = criteria_kernels.read_only
        self.sums = network_kernels.Sums(
            views=np.zeros(n, np.int64),
            best=np.zeros(n),
            best_row=np.zeros(n, np.int64),
            reason=np.zeros(n, np.uint8),
            kinds=np.zeros(len(BoundKind), np.int64),
            bounds=np.zeros(2),
        )
        self.covered_faces = np.zeros(n_poses, np.int64)
        self.totals, self.images = np.zeros((2, n_poses))
        self._is_scored = self._read_only(mesh.task_mask, np.bool_)
        self._scored = None if mesh.task_mask.all() else np.flatnonzero(mesh.task_mask)
        self._coverage, self._drawn = np.empty((2, n))

    def add_coverage(self, coverage: Coverage) -> None:
        """Add all poses of the batch."""
        from rastercov._jit import announce_compilation

        announce_compilation(self.kernels.add_rows)
        arrays = [self._read_only(getattr(coverage, name), kind) for name, kind in _ADDED.items()]
        *added, drawn = arrays
        self.kernels.add_rows(self._is_scored, *added, self.sums, self.covered_faces)
        for row in range(len(drawn)):  # 10 us each
            self._add_sums(row, added[0][row], drawn[row])

    def add_poses(
        self,
        scope: Scope,
        limits: Sequence[Limits],
        sink: "Sink",
        kept: dict[int, FloatArray],
        rows: slice,
        index: int,
    ) -> None:
        """Judge some poses of one camera of the batch and add them; their rows go to `sink`."""
        arguments, coverage = scope(index), self._coverage
        seen = arguments[2]
        own = self._is_scored, self.sums, self.covered_faces, coverage
        for row in range(rows.start, rows.stop):
            self.kernels.add_pose(row, rows.start, *arguments, limits[index], *own, sink)
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

    def merge(self, other: "_Part") -> None:
        """Add the sums of other poses of the same batch."""
        ours, theirs = self.sums, other.sums
        ours.views[:] += theirs.views
        better = (theirs.best > ours.best) | (
            (theirs.best == ours.best) & (theirs.best_row < ours.best_row)
        )
        ours.best[better], ours.best_row[better] = theirs.best[better], theirs.best_row[better]
        np.maximum(ours.reason, theirs.reason, out=ours.reason)
        ours.kinds[:] += theirs.kinds
        np.maximum(ours.bounds, theirs.bounds, out=ours.bounds)
        self.covered_faces += other.covered_faces
        self.totals += other.totals
        self.images += other.images


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
