"""Coverage by a network of cameras: by face, by group, by count and by area.

E. S. Eissa. Image Space Coverage Model. 2020, section 6.4.1 and Table 6.1, where a face counts as
not covered when its coverage is 0 in every camera.

Poses that an observer judges where it counts: bits of pairs alone, and what follows of them.
"""

import logging
import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base import (
    TINY,
    AnyArray,
    BoolArray,
    ByName,
    ByteArray,
    ConfigError,
    DeviceError,
    FloatArray,
    InNotebook,
    IntArray,
    ReadByName,
    ResourceError,
    cos,
)
from rastercov.base.arguments import ray_angle
from rastercov.base.typed import typed
from rastercov.core.camera import Cameras, Poses, cameras_of, eyes_of, is_joint
from rastercov.core.coverage.coverage import Coverage, Observer, SampledObserver, batch_size
from rastercov.core.coverage.face_pass import ROW_TYPES, FacePass, Sums, merge_sums, no_sums
from rastercov.core.coverage.judging import (
    RESULT,
    SUMMED,
    JudgedPoses,
    classify_poses,
    sums_of,
)
from rastercov.core.coverage.task import (
    BITS,
    NAMES,
    UNSEEABLE,
    Engine,
    Reason,
    Task,
    reason_rows,
)
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.groups import parts_of
from rastercov.core.raster import drawer
from rastercov.core.raster.contract import BoundKind
from rastercov.engine.coverage_network import add_sums
from rastercov.engine.coverage_spread import add_rays

UNSEEABLE_WORDS = "inside closed bodies of the mesh or in full contact with them (proved)"
"""Reason of faces that no camera outside the bodies can see."""
OF_ONE_TASK = (
    "expected coverage of the mesh and task of the network, got another; make a new network"
)


def least_cosine(min_angle: float) -> float:
    """Largest cosine of two rays that differ by an angle, radians; 2 where any two do."""
    ray_angle("min_angle_deg", math.degrees(min_angle))
    return cos(min_angle) + 1e-12 if min_angle > 0 else 2.0


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
        self._is_near = np.ones(n, bool)
        self._before: AnyArray = np.empty(0, np.int64)
        self._camera: AnyArray = np.empty(0, np.int64)
        self._eyes: AnyArray = np.empty((0, 3))
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
            self._n_eyes,
            faces.astype(np.int32),
            (self._eyes, self._centroids, self._min_cosine),
            (
                *(self._first, self._is_near, self._last),
                *(self._before, self._camera, self.is_spread),
            ),
            self._n_pairs,
        )
        self._n_eyes += 1


def _with_room(array: AnyArray, n: int) -> AnyArray:
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
        Number of cameras that cover the face as a whole: with a coverage of at least
        `Task.min_coverage`, and not 0.
    best : (F,) float64
        Maximum coverage of the face by any camera.
    best_pose : (F,) int64
        The pose with this coverage, the first of equals; -1 where `best` is 0.
    reason : (F,) uint8
        `Reason` of the camera that comes nearest to covering the face.
    pose_ids : list of int
        Row in the input of each pose so far.
    covered_faces, mean_coverage : list
        For each of these poses: number of evaluated faces that it covers, and mean coverage over
        the evaluated faces.
    kinds : (3,) int64
        Number of pairs of pose and evaluated face, front-facing and at least partly in view, by
        `BoundKind`.
    largest_bound : float
        Maximum `visibility_bound` of these pairs.
    largest_covered_bound : float
        Maximum `visibility_bound` of any pair that counts as covered.
    clipped_poses : list of int
        Poses in which the near plane cuts away a surface in view.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> poses = rc.look_at([(0.6, 0, 0), (0.6, 0.05, 0), (0, 0, 0.6)], (0, 0, 0))
    >>> network = rc.evaluate(mesh, camera, poses).network
    >>> network.views.tolist()  # cameras that cover each face as a whole
    [0, 0, 2, 2, 0, 0, 0, 0, 0, 0, 1, 1]
    >>> round(network.summary()["covered"]["area_percent"], 1)
    33.3
    """

    def __init__(self, mesh: Mesh, task: Task) -> None:
        self.mesh, self.task = mesh, task
        self._sums = no_sums(mesh.n_faces, 0)
        self.views, self.best, self.best_pose, self.reason, self.alone, self.kinds, *_ = self._sums
        self.best_pose[:] = -1
        self.pose_ids: list[int] = []
        self.covered_faces: list[int] = []
        self.mean_coverage: list[float] = []
        self.largest_bound = 0.0
        self.largest_covered_bound = 0.0
        self.clipped_poses: list[int] = []
        self._spread = ViewSpread(mesh.centroids, math.radians(task.min_angle_deg))

    def add(self, coverage: "Coverage | JudgedPoses", camera: int | None = None) -> None:
        """Add further poses; ConfigError for those of another mesh or task.

        With `camera`, an index, only poses of that camera count; they must come from
        `classify_poses` with `apart=True`.
        """
        if isinstance(coverage, JudgedPoses):
            self._add_classified(coverage, camera)
            return
        if coverage.task != self.task or coverage.mesh.n_faces != self.mesh.n_faces:
            raise ConfigError(OF_ONE_TASK)
        if n := len(coverage.pose_ids):
            figures = {name: getattr(coverage, name) for name in SUMMED}
            self._take(
                coverage.pose_ids, coverage.clipped, sums_of(self.mesh, figures, np.arange(n))
            )
            self._spread_out(coverage.eyes, coverage.reason == Reason.COVERED)

    def _spread_out(self, eyes: FloatArray, covers: BoolArray) -> None:
        """Add the directions of cameras, (P, 3), to the faces that they cover, (P, F)."""
        if self.task.min_angle_deg > 0:
            for eye, row in zip(eyes, covers, strict=True):
                self._spread.add(eye, np.flatnonzero(row))

    @typed
    def judge(
        self,
        observer: Observer,
        poses: Poses,
        *,
        pairs: str = "none",
        apart: bool = False,
        bits: bool = False,
    ) -> "Iterator[JudgedPoses]":
        """Evaluate poses in batches for `add`; at least one batch, possibly empty.

        The figures are added up in the threads that compute them, as `add(evaluate(...))` would,
        bit for bit. A batch counts as a whole or, after an interrupt or an error, not at all.

        Parameters
        ----------
        observer : Observer
            Open, for the mesh of the network.
        poses : Poses
            world_from_camera.
        pairs : {"none", "covered", "seen", "all"}
            Pairs of pose and face whose figures are kept as rows.
        apart : bool
            Keep sums per camera, so that a network can `add` those of one camera.
        bits : bool
            Keep the covered pairs of each pose as `CoverageBits`.

        Raises
        ------
        ConfigError
            For an observer of another mesh, or another choice of pairs.
        """
        return self._judge(observer, poses, {"pairs": pairs, "apart": apart, "bits": bits})

    def _judge(self, observer: Observer, poses: Poses, kept: ReadByName) -> "Iterator[JudgedPoses]":
        """`judge`; `kept` are the further arguments of `classify_poses`."""
        own: ByName = dict(kept)
        if own["pairs"] == "none" and self.task.min_angle_deg > 0:
            own["pairs"] = "covered"  # the rays to them are needed
        if observer.mesh.n_faces != self.mesh.n_faces:
            raise ConfigError(OF_ONE_TASK)
        return classify_poses(self.mesh, self.task, observer, poses, **own)

    def _add_classified(self, batch: JudgedPoses, camera: int | None) -> None:
        """Add the sums of a batch, or those of one of its cameras."""
        wanted = RESULT if camera is None and batch.leads is not None else camera
        parts = [sums for index, sums in batch.sums.items() if wanted in (None, index)]
        if not parts:
            return
        own = slice(None) if camera is None else batch.poses.camera == camera
        if wanted == RESULT:
            own = batch.leads
        self._take(batch.poses.ids, batch.clipped, merge_sums(parts), own)
        if self.task.min_angle_deg > 0:
            rows = batch.rows
            is_covered = rows["reason"] == Reason.COVERED
            for eye, pose in zip(batch.eyes[own], batch.poses[own].ids, strict=True):
                self._spread.add(eye, rows["face"][is_covered & (rows["pose"] == pose)])

    def _take(
        self,
        pose_ids: IntArray,
        clipped: BoolArray,
        sums: Sums,
        own: slice | BoolArray = slice(None),
    ) -> None:
        """Add the sums of a batch of poses; `own` are those that count."""
        add_sums(self._sums, sums._replace(best_row=pose_ids[sums.best_row]), 0, True)
        self.largest_bound, self.largest_covered_bound = self._sums.bounds.tolist()
        self.pose_ids += pose_ids[own].tolist()
        self.covered_faces += sums.covered_faces[own].tolist()
        n_scored = max(1, int(self.mesh.task_mask.sum()))
        self.mean_coverage += (sums.totals[own] / n_scored).tolist()
        self.clipped_poses += pose_ids[own][clipped[own]].tolist()

    @property
    def covered(self) -> BoolArray:
        """(F,) mask of the faces covered by `Task.views` cameras, `Task.min_angle_deg` apart."""
        return (self.views >= self.task.views) & self._spread.is_spread

    def summary(self) -> ByName:
        """Figures of the network, ready for JSON; every percentage by count and by area.

        Occluders are left out of all totals.
        """
        mesh, task_faces, covered = self.mesh, self.mesh.task_mask, self.covered
        why = reasons_of(self, covered)
        hidden, is_zero = self.unseeable_areas, self.best == 0
        gained = self.alone if self.task.views == 1 and not self.task.min_angle_deg else None
        is_left = ~covered & (hidden == 0)

        def figures(members: AnyArray) -> ByName:
            areas = mesh.areas[members]
            table = {"area_m2": float(areas.sum()), "unseeable_m2": float(hidden[members].sum())}
            covered_m2 = float(areas[covered[members]].sum())
            faces = share_of_faces(mesh, covered, members)
            return {
                "covered_faces": faces,
                "covered": faces,  # its name in earlier versions
                "zero_in_every_camera": share_of_faces(mesh, is_zero, members),
                "seeable_not_covered_because": shares_by_reason(
                    mesh, why, is_left, members, gained
                ),
                **table,
                "covered_of_seeable_percent": percent_of_seeable(covered_m2, table),
            }

        def entry(name: str, rows: list[int]) -> ByName:
            scored = [row for row in rows if not mesh.groups[row].is_occluder]
            roles = {mesh.groups[row].role for row in scored or rows}
            return {
                "name": name,
                "role": roles.pop() if len(roles) == 1 else "task",
                "two_sided": all(mesh.groups[row].is_two_sided for row in rows),
                "faces": sum(len(mesh._by_group[row]) for row in scored or rows),
                **(figures(mesh._faces_of(scored)) if scored else {}),
            }

        return {
            "poses": len(self.pose_ids),
            "faces": mesh.n_faces,
            "task_faces": int(task_faces.sum()),
            "required_views": self.task.views,
            "not_covered": share_of_faces(mesh, ~covered, task_faces),
            "not_covered_because": shares_by_reason(mesh, why, ~covered, task_faces, gained),
            "mean_best_coverage": float(self.best[task_faces].mean()) if task_faces.any() else 0.0,
            "mean_views": float(self.views[task_faces].mean()) if task_faces.any() else 0.0,
            "visibility_figures": {
                kind.name.lower(): int(self.kinds[kind]) for kind in reversed(BoundKind)
            },
            "largest_visibility_bound": self.largest_bound,
            "largest_visibility_bound_of_covered": self.largest_covered_bound,
            "near_clipped_poses": self.clipped_poses,
            **figures(task_faces),
            "unseeable_because": UNSEEABLE_WORDS if hidden.any() else "",
            "groups": [entry(group.name, [row]) for row, group in enumerate(mesh.groups)],
            "parts": [
                entry(name, rows) | {"level": 1 + name.count("/"), "groups": len(rows)}
                for name, rows in parts_of(mesh.groups).items()
            ],
        }

    @property
    def unseeable_areas(self) -> FloatArray:
        """(F,) area that no pose can see (proved), m^2; see `rastercov.core.mesh.unseeable`."""
        from rastercov.core.mesh.unseeable import unseeable_in_view

        return unseeable_in_view(self.mesh, self.best)


def reasons_of(network: Network, covered: BoolArray) -> ByteArray:
    """(F,) row of `REASONS` of each face, of which some are covered."""
    rows = reason_rows(network.reason, covered, len(network.pose_ids))
    rows[(network.unseeable_areas > 0) & ~covered] = UNSEEABLE
    return rows


def percent_of_seeable(covered_m2: float, entry: Mapping[str, float]) -> float | None:
    """Covered percentage of the coverable area; None if there is none."""
    seeable = entry["area_m2"] - entry["unseeable_m2"]
    return min(100 * covered_m2 / seeable, 100.0) if seeable > 0 else None


def share_of_faces(mesh: Mesh, part: BoolArray, whole: AnyArray) -> dict[str, float]:
    """Faces of a whole, by a mask (F,) or rows, that are in a part, (F,), and their percentage."""
    return _share(mesh.areas[whole], part[whole])


def _share(areas: FloatArray, part: BoolArray) -> dict[str, float]:
    """Faces of a part, and its percentage by count and by area."""
    n = int(part.sum())
    by_area = 100 * areas[part].sum() / max(areas.sum(), TINY)
    return {"faces": n, "percent": 100 * n / max(1, len(part)), "area_percent": float(by_area)}


def shares_by_reason(
    mesh: Mesh, why: ByteArray, left: BoolArray, whole: AnyArray, alone: ByteArray | None = None
) -> dict[str, ByName]:
    """Share of the faces of a whole that are left, by the names of the `reason_rows` of all.

    With bits of the criteria that a camera fails alone, `gain` has the faces that one of them
    would add if it were met.
    """
    areas, why, left = mesh.areas[whole], why[whole], left[whole]
    figures_by_key: dict[str, ByName] = {}
    for row in np.unique(why[left]).tolist():
        figures_by_key[NAMES[row]] = _share(areas, left & (why == row))
        if alone is not None and BITS[row] and Reason.OUTSIDE < row < Reason.COVERED:
            gain = _share(areas, left & (alone[whole] & BITS[row] > 0))
            figures_by_key[NAMES[row]] |= {"gain": gain}
    return figures_by_key


LOG = logging.getLogger("rastercov")
MOST_JUDGED, BYTES_JUDGED, SECONDS_JUDGED = 1 << 14, 64 << 20, 0.2
"""Most poses that are judged at a time, and the memory and time of these."""
BITS_OF_TARGET = 128
"""Memory of a target in a pose while it is judged, bits: two counts."""
LEAST_PAIRS = 1 << 26
"""Pairs of pose and face from which on a GPU is tested: an estimate, for none was at hand.

A self-test takes a second or two; the CPU judges these pairs meanwhile, at 12 ns a pair and core on
images of 256 x 256. `benchmarks/gpu.py` measures the border where there is a GPU."""
NO_ROWS = {name: np.empty(0, kind) for name, kind in ROW_TYPES.items()}
LATER = (
    *("best", "best_pose", "reason", "alone", "covered_faces", "mean_coverage", "kinds"),
    *("largest_bound", "largest_covered_bound"),
)
"""Figures of a `Network` that bits of pairs do not have."""


def engine_for(engine: Engine, mesh: Mesh, camera: Cameras, task: Task, n_poses: int) -> Engine:
    """Engine for poses of which bits alone are wanted: on a GPU, where "auto" is of use for many.

    The GPU has passed its self-test, in a process of its own.
    """
    is_open = engine.method == "sampled" and engine.device == "auto"
    is_large = n_poses * mesh.n_faces >= LEAST_PAIRS
    has_lens = any(each.is_curved for each in cameras_of(camera))
    is_judged = not (mesh.has_targets or has_lens or _needs_rows(camera, task))
    label = drawer().find_gpu() if is_open and is_large and is_judged else ""
    if not label:
        return engine
    LOG.warning("device auto is %s, for %s poses", label, f"{n_poses:,}")
    return replace(engine, device=label)


def _needs_rows(camera: Cameras, task: Task) -> bool:
    """True where pairs need more than bits tell."""
    return is_joint(camera) or task.min_angle_deg > 0


def can_judge(observer: Observer, poses: Poses, task: Task) -> bool:
    """True where the observer judges what it counts; a device that does not is named."""
    if not isinstance(observer, SampledObserver):
        return False
    criteria = FacePass(observer.mesh, observer.camera, 1, task).criteria()
    why = observer.why_not_judged(poses, criteria)
    if _needs_rows(observer.camera, task):
        why = "rigs with a rule, and angles of views, need more than bits"
    if why and observer.info.backend == "gl":
        LOG.warning("the CPU judges what the device counts: %s", why)
    return not why


class NetworkOfBits(Network):
    """Network of poses that are judged where they are counted: views, from their bits.

    Its other figures are those that `measure` gives, called when one of them is first read.
    """

    def __init__(self, mesh: Mesh, task: Task, measure: Callable[[], Network] | None) -> None:
        super().__init__(mesh, task)
        self._measure = measure
        for name in LATER:
            delattr(self, name)

    def _judge(self, observer: Observer, poses: Poses, kept: ReadByName) -> Iterator[JudgedPoses]:
        """Bits of poses: more at a time, while it is quick, and fewer where memory is short.

        In place of a device that fails, the CPU counts the rest.
        """
        assert isinstance(observer, SampledObserver)
        n_faces = self.mesh.n_faces
        criteria = FacePass(self.mesh, observer.camera, observer.threads, self.task).criteria()
        n_bits = n_faces + BITS_OF_TARGET * int(self.mesh.target_mask.sum())
        most = max(1, min(MOST_JUDGED, 8 * BYTES_JUDGED // n_bits))
        step, at = min(most, batch_size(n_faces, observer.threads)), 0
        while at < max(1, len(poses)):
            batch, began = poses[at : at + step], time.perf_counter()
            try:
                bits, clipped = observer.judge(batch, criteria)
            except ResourceError:
                if step == 1:
                    raise
                step //= 2
                continue
            except DeviceError as error:
                if observer.info.backend != "gl":
                    raise
                observer.fall_back()
                LOG.warning("the CPU continues in place of a device: %s", error)
                yield from super()._judge(observer, poses[at:], {**kept, "bits": True})
                return
            is_quick = time.perf_counter() - began < SECONDS_JUDGED
            eyes = eyes_of(observer.camera, batch)
            yield JudgedPoses(batch, clipped, NO_ROWS, None, {}, None, eyes, bits=bits)
            at += step
            step = min(most, 2 * step) if is_quick else max(1, step // 2)

    def add(self, coverage: Coverage | JudgedPoses, camera: int | None = None) -> None:
        """Add the bits of a batch."""
        assert isinstance(coverage, JudgedPoses)
        assert coverage.bits is not None
        self.views += coverage.bits.views
        self.pose_ids += coverage.poses.ids.tolist()
        self.clipped_poses += coverage.poses.ids[coverage.clipped].tolist()

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            if name not in LATER:
                raise AttributeError(f"{type(self).__name__} has no attribute {name!r}")
            measured = vars(self._measure())
            vars(self).update({each: measured[each] for each in LATER})
            return measured[name]
