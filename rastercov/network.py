"""Coverage by a network of cameras: by face, by group, by count and by area.

E. S. Eissa. Image Space Coverage Model. 2020, section 6.4.1 and Table 6.1, where a face counts as
not covered when its coverage is 0 in every camera.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov._arguments import check_kind
from rastercov.coverage import Coverage
from rastercov.errors import ConfigError, MeshError
from rastercov.mesh import Mesh
from rastercov.observation import BoundKind
from rastercov.task import Reason, Task

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]


class Network:
    """Coverage of each face by all cameras, added up batch by batch.

    `add` changes it, so one thread at a time may use it: measure in several, add up in one.

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

    def add(self, coverage: Coverage) -> None:
        """Take in the next poses; ConfigError when they are of another mesh or task."""
        check_kind("coverage", coverage, Coverage, "what evaluate gives", ConfigError)
        if coverage.task != self.task or coverage.mesh.n_faces != self.mesh.n_faces:
            raise ConfigError("a network adds up coverage of one mesh and one task")
        if not len(coverage.pose_ids):
            return
        covers = coverage.reason == Reason.COVERED
        self.views += covers.sum(axis=0)
        leader = coverage.coverage.argmax(axis=0)
        top = np.take_along_axis(coverage.coverage, leader[None], axis=0)[0]
        better = top > self.best
        self.best[better] = top[better]
        self.best_pose[better] = coverage.pose_ids[leader[better]]
        self.reason = np.maximum(self.reason, coverage.reason.max(axis=0))
        task_faces = np.flatnonzero(self.mesh.task_mask)
        self.pose_ids += coverage.pose_ids.tolist()
        self.covered_faces += covers[:, task_faces].sum(axis=1).tolist()
        # `take` keeps a pose's faces together, so that its sum does not depend on its neighbours.
        total = coverage.coverage.take(task_faces, axis=1).sum(axis=1)
        self.mean_coverage += (total / max(1, len(task_faces))).tolist()
        images = coverage.drawn_pixels.take(task_faces, axis=1).sum(axis=1)
        self.largest_image = max(self.largest_image, float(images.max()))
        bounds = coverage.visibility_bound[:, task_faces]
        in_view = (coverage.in_view_fraction[:, task_faces] > 0) & (
            coverage.reason[:, task_faces] > Reason.BACK_FACING
        )
        kinds = coverage.visibility_kind[:, task_faces][in_view]
        self.kinds += np.bincount(kinds, minlength=len(BoundKind))
        self.largest_bound = max(self.largest_bound, float(bounds[in_view].max(initial=0.0)))
        covered = bounds[covers[:, task_faces]]
        self.largest_covered_bound = max(
            self.largest_covered_bound, float(covered.max(initial=0.0))
        )
        self.clipped_poses += coverage.pose_ids[coverage.clipped].tolist()

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
            "role": "occluder" if group.is_occluder else "task",
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
