"""Passes over poses and faces, in threads: what an observer measured becomes figures of each face.

A network adds them up. The loops are in `engine/coverage`; records of meshes, cameras,
observations, figures and sums have their fields in the order of its structs.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import groupby
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.base import (
    AnyArray,
    BoolArray,
    ByName,
    FloatArray,
    IntArray,
    once_each,
    read_only,
    share_poses,
)
from rastercov.base.arguments import align_array
from rastercov.core.camera import Camera, Cameras, Poses, near_limits
from rastercov.core.coverage.task import (
    Reason,
    Task,
    own_reasons,
    rules_of,
)
from rastercov.core.mesh import Mesh
from rastercov.core.raster.contract import BoundKind, Criteria, FaceCounts, Observation, as_small
from rastercov.engine.coverage_figures import (
    COLUMNS,
    CURVED_COLUMNS,
    MOST_DOUBTFUL,
    SIDE_ROUNDING,
    judge_poses,
)
from rastercov.engine.coverage_network import add_sums

if TYPE_CHECKING:
    from rastercov.core.camera.lenses.records import CurvedLens

Bytes = NDArray[np.uint8]


class PinholeRecord(NamedTuple):
    """Intrinsics and image size of a pinhole, pixels."""

    fx: float
    fy: float
    cx: float
    cy: float
    width: float
    height: float


class ParallelLens(NamedTuple):
    """Parallel rays along the axis: fx and fy are in pixels per unit of length."""

    scale: PinholeRecord


class SceneRecord(NamedTuple):
    """Arrays of a mesh, read-only."""

    vertices: FloatArray
    faces: NDArray[np.uint64]
    normals: FloatArray
    own: Bytes  # reason of the surface itself, `COVERED` where there is none
    two_sided: BoolArray
    offsets: FloatArray
    reach: float  # greatest coordinate
    doubtful_cosine: float  # below which a face may be edge-on


class ObservationRecord(NamedTuple):
    """An observation, read-only; see `rastercov.Observation`.

    Areas are `visible / scale` and `drawn / scale`, px^2: counts of samples are float64 or int32.
    `kind` is (0, 0) where all figures are counted, and `area_error` where it is 0 everywhere.
    """

    poses: FloatArray
    near: FloatArray
    visible: AnyArray
    drawn: AnyArray
    scale: float
    kind: Bytes
    area_error: FloatArray
    samples_per_pixel: float


FIGURES: ByName = {
    "in_view": np.bool_,
    "in_view_fraction": np.float64,
    "projected_area": np.float64,
    "visible_pixels": np.float64,
    "drawn_pixels": np.float64,
    "resolution": np.float64,
    "pixel_density": np.float64,
    "facing_density": np.float64,
    "in_focus": np.bool_,
    "visibility": np.float64,
    "visibility_bound": np.float64,
    "visibility_kind": np.uint8,
    "incidence": np.float64,
    "coverage": np.float64,
    "reason": np.uint8,
}
"""The (P, F) arrays of `Coverage` and their types, in the order of a report and of the engine."""
NO_FIGURES: ByName = {name: np.empty((0, 0), kind) for name, kind in FIGURES.items()}


def figures_of(arrays: Mapping[str, AnyArray]) -> tuple[Any, ...]:
    """The (P, F) arrays that are given, by their names, for the engine; (0, 0) for the others."""
    return tuple(arrays.get(name, none) for name, none in NO_FIGURES.items())


class Sums(NamedTuple):
    """Sums over poses of a batch, see `rastercov.Network`; (F,) unless noted.

    `best_row` is the row of the pose in its batch, and `alone` has bits of the criteria that some
    camera fails alone. `bounds` has the largest bound in view and the
    largest of a covered pair, (2,). For each pose, (P,), of which those that were not added are 0:
    the evaluated faces that it covers, and the total of their coverage.
    """

    views: IntArray
    best: FloatArray
    best_row: IntArray
    reason: Bytes
    alone: Bytes
    kinds: IntArray
    bounds: FloatArray
    covered_faces: IntArray
    totals: FloatArray


def no_sums(n_faces: int, n_poses: int) -> Sums:
    """Sums of poses before any is added."""
    return Sums(
        views=np.zeros(n_faces, np.int64),
        best=np.zeros(n_faces),
        best_row=np.zeros(n_faces, np.int64),
        reason=np.zeros(n_faces, np.uint8),
        alone=np.zeros(n_faces, np.uint8),
        kinds=np.zeros(len(BoundKind), np.int64),
        bounds=np.zeros(2),
        covered_faces=np.zeros(n_poses, np.int64),
        totals=np.zeros(n_poses),
    )


def merge(ours: Sums, theirs: Sums, first: int = 0) -> None:
    """Add the sums of other poses to `ours`; their row 0 is row `first` of these."""
    add_sums(ours, theirs, first, False)
    own = slice(first, first + len(theirs.totals))
    ours.covered_faces[own] += theirs.covered_faces
    ours.totals[own] += theirs.totals


def merge_sums(parts: Sequence[Sums]) -> Sums:
    """Sums of different poses of one batch together."""
    if len(parts) == 1:
        return parts[0]
    whole = no_sums(len(parts[0].views), len(parts[0].totals))
    for part in parts:
        merge(whole, part)
    return whole


PairRows = Mapping[str, AnyArray]
"""Columns of a table of pairs of pose and face, (R,) each, of `ROW_TYPES`."""
_SHORT = {np.bool_: np.bool_, np.float64: np.float32, np.uint8: np.int32}
ROW_TYPES: ByName = {"pose": np.int32, "face": np.int32} | {
    name: _SHORT[kind] for name, kind in FIGURES.items()
}
"""Types of the columns of a table of pairs: their indices, then the figures.

Floats are float32, and what has a name is its code.
"""


class Sink(NamedTuple):
    """Memory for the rows of a batch of P poses: room for all P * F pairs.

    The rows of the poses that a thread takes together, `turn` the first of them, are the
    `counts[turn]` from `turn * F` on.
    """

    choice: int  # index of `network.CHOICES`
    pose_ids: IntArray
    counts: IntArray
    rows: tuple[Any, ...]  # of `ROW_TYPES`


@once_each
def scene_of(mesh: Mesh) -> SceneRecord:
    """Arrays of a `Mesh`, whatever a task asks of its surface."""
    return SceneRecord(
        read_only(mesh.vertices, np.float64),
        read_only(mesh.faces.view(np.uint64), np.uint64),
        read_only(mesh.normals, np.float64),
        read_only(own_reasons(mesh), np.uint8),
        read_only(mesh.two_sided_mask, np.bool_),
        read_only(mesh.plane_offsets, np.float64),
        float(np.abs(mesh.bounds).max()),
        float(min(SIDE_ROUNDING / mesh.least_sine, MOST_DOUBTFUL)),
    )


def lens_of(camera: Camera, unit: float = 1.0) -> "PinholeRecord | ParallelLens | CurvedLens":
    """Numbers of a `Camera` in a scene whose lengths are in units of a size, metres."""
    if camera.is_pinhole:
        return pinhole_of(camera)
    if not camera.is_curved:
        own = pinhole_of(camera)
        return ParallelLens(own._replace(fx=own.fx * unit, fy=own.fy * unit))
    from rastercov.core.camera.lenses.of_camera import curved_lens

    curved = curved_lens(camera)
    return curved._replace(unit=curved.unit / unit)


def pinhole_of(camera: Camera) -> PinholeRecord:
    """Numbers of a `Camera` without distortion, or of an ideal plane."""
    size = float(camera.width), float(camera.height)
    return PinholeRecord(
        float(camera.fx), float(camera.fy), float(camera.cx), float(camera.cy), *size
    )


def workspace(n_vertices: int, lens: "PinholeRecord | ParallelLens | CurvedLens") -> FloatArray:
    """Memory of one thread for the projected vertices."""
    columns = COLUMNS if isinstance(lens, PinholeRecord | ParallelLens) else CURVED_COLUMNS
    return align_array((n_vertices, columns), np.float64)


TASK, NONE = Task(), np.empty((0, 0))
"""Thresholds that leave out no face; and no figures."""
Measured = Observation | FaceCounts
"""Measurement of some poses: areas, or the counts of a rasteriser, which become areas face by face:
arrays of them would take as long as half the judging."""
Scope = tuple[Any, Any, Any, Any]
"""Arguments scene, lens, seen and points of the loops."""
Worker = Callable[[slice, int, Scope], None]
"""Does the work of consecutive poses of one camera, given by its index."""


def keeper(work: Worker, kept: dict[int, list[AnyArray]]) -> Worker:
    """The worker, which then keeps visible and drawn counts, by the first of their poses."""

    def work_and_keep(rows: slice, index: int, scope: Scope) -> None:
        work(rows, index, scope)
        counts = scope[2].visible, scope[2].drawn
        kept[rows.start] = [as_small(each[rows]) for each in counts]

    return work_and_keep


class FacePass:
    """Figures of faces by a task, through the cameras of an observer; for any number of threads.

    The poses of a call are shared among `threads`.
    """

    def __init__(self, mesh: Mesh, camera: Cameras, threads: int, task: Task = TASK) -> None:
        self.mesh, self._threads = mesh, threads
        self.cameras, tasks, self.rules = zip(*rules_of(camera, task), strict=True)
        scene = scene_of(mesh)
        own = {each: read_only(own_reasons(mesh, each), np.uint8) for each in tasks}
        self._scenes = [scene._replace(own=own[each]) for each in tasks]
        self._lenses = [lens_of(each) for each in self.cameras]

    def fill(self, measured: Measured, poses: Poses, figures: Mapping[str, AnyArray]) -> None:
        """Fill (P, F) arrays with the figures of the poses of a measurement."""
        out = figures_of(figures)

        def work(rows: slice, index: int, scope: Scope) -> None:
            judge_poses(rows.start, rows.stop, scope, self.rules[index], out)

        self.share(measured, poses, lambda: work)

    def criteria(self) -> list[Criteria]:
        """Criteria of each camera for `SampledObserver.judge`."""
        return [
            Criteria(rules._asdict(), scene.own == Reason.COVERED)
            for rules, scene in zip(self.rules, self._scenes, strict=True)
        ]

    def share(self, measured: Measured, poses: Poses, make_worker: Callable[[], Worker]) -> None:
        """Share poses among workers, one made for each thread."""
        seen = self._record_of(measured, poses)

        def worker() -> Callable[[slice], None]:
            work, spaces = make_worker(), dict[type, Any]()

            def work_in_turn(turn: slice) -> None:
                start = turn.start
                for index, run in groupby(poses.camera[turn].tolist()):
                    stop = start + len(list(run))
                    lens = self._lenses[index]
                    if type(lens) not in spaces:
                        spaces[type(lens)] = workspace(self.mesh.n_vertices, lens)
                    scope = self._scenes[index], lens, seen, spaces[type(lens)]
                    work(slice(start, stop), index, scope)
                    start = stop

            return work_in_turn

        n = len(poses)
        share_poses(n, [worker() for _ in range(max(1, min(self._threads, n)))])

    def _record_of(self, measured: Measured, poses: Poses) -> ObservationRecord:
        """Measurement of an observer, for the loops."""
        visible: AnyArray
        drawn: AnyArray
        kind: AnyArray
        kind = error = NONE
        if isinstance(measured, FaceCounts):
            assert measured.drawn is not None
            visible, drawn = measured.visible, measured.drawn
            # Larger counts than int32 are rare, and not worth loops of their own.
            dtype: type = np.int32 if np.can_cast(visible.dtype, np.int32) else np.float64
            scale = samples = float(measured.supersample**2)
        else:
            visible, drawn, dtype = measured.visible_pixels, measured.drawn_pixels, np.float64
            scale, samples, kind = 1.0, float(measured.samples_per_pixel), measured.kind
            if any(measured.area_error.strides):
                error = measured.area_error
        near = near_limits(self.cameras, self.mesh.opaque.bounds, poses)
        dense = np.ascontiguousarray
        matrices = dense(poses.world_from_camera, np.float64)
        visible, drawn = dense(visible, dtype), dense(drawn, dtype)
        errors = dense(kind, np.uint8), dense(error, np.float64)
        return ObservationRecord(matrices, near, visible, drawn, scale, *errors, samples)
