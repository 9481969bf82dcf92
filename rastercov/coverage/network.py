"""Coverage by a network of cameras: by face, by group, by count and by area.

E. S. Eissa. Image Space Coverage Model. 2020, section 6.4.1 and Table 6.1, where a face counts as
not covered when its coverage is 0 in every camera.
"""

import math
from collections.abc import Collection, Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.arguments import check_kind
from rastercov.base.errors import ConfigError, MeshError
from rastercov.base.typed import typed
from rastercov.camera.pose import Poses
from rastercov.coverage.coverage import Coverage, batch_size, check_observer, measurements
from rastercov.coverage.face_pass import CoveragePass, Measured, Scope, Worker
from rastercov.coverage.judged_poses import JudgedPoses, PairBuffer, Part
from rastercov.coverage.observer import Observer
from rastercov.coverage.spread import ViewSpread
from rastercov.coverage.task import Reason, Task
from rastercov.mesh import Mesh
from rastercov.raster.observation import BoundKind

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]


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

        judge = CoveragePass(observer, self.task)
        n_faces = self.mesh.n_faces
        buffer = PairBuffer(pairs, min(len(poses), batch_size(n_faces, observer.threads)), n_faces)
        return (
            self._judged(judge, batch, seen, buffer, keep, apart)
            for batch, seen in measurements(observer, poses)
        )

    def _judged(
        self,
        judge: CoveragePass,
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
