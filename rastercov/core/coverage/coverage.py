"""Coverage of each face by each camera (3.6): all criteria of many poses, batch by batch.

E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. 2020, section 3.3.

Observers: one mesh through one camera or several, measured in many poses by three methods.

certified
    Regions of faces that no event edge crosses are proved wholly visible or wholly hidden; the
    faces that are crossed are computed. See `rastercov.core.exact`. Needs no rasteriser.
exact
    Every face is computed, see `rastercov.core.exact`: the same answers several times
    slower, to check with.
sampled
    Counts of a rasteriser, with a statistical bound; see `rastercov.core.raster.contract`.

Rasterisers of several cameras, counted as one.
"""

import math
import threading
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

import rastercov
from rastercov.base import (
    AnyArray,
    BoolArray,
    ByName,
    ByteArray,
    Closing,
    ConfigError,
    DeviceError,
    FloatArray,
    InNotebook,
    IntArray,
    ReadByName,
    check_kind,
    check_memory,
    frozen_record,
    plural,
    shown,
    sort_order,
    thread_count,
)
from rastercov.base.arguments import align_array
from rastercov.core.camera import Camera, Cameras, Poses, cameras_of, check_scene, eyes_of
from rastercov.core.coverage.exact_pass import ExactPass, room_for
from rastercov.core.coverage.face_pass import FIGURES, FacePass, Measured
from rastercov.core.coverage.task import Engine, Task
from rastercov.core.mesh import Mesh
from rastercov.core.raster import open_rasterizer
from rastercov.core.raster.contract import (
    Criteria,
    FaceCounts,
    Judged,
    Observation,
    Rasterizer,
    RasterizerInfo,
    add_bits,
    no_bits,
)
from rastercov.engine.solver_union import POSES_TOGETHER

MOST_OPEN = 16
"""Rasterisers that are open at a time."""


class Rasterizers:
    """A rasteriser for each of some cameras, opened when a pose has it.

    Parameters
    ----------
    mesh : Mesh
        The faces.
    cameras : sequence of Camera
        At least one; the first is opened at once.
    **options
        As for `open_rasterizer`.

    Attributes
    ----------
    info : RasterizerInfo
        Of the first.
    """

    def __init__(self, mesh: Mesh, cameras: Sequence[Camera], **options: Any) -> None:
        def open_one(index: int) -> Rasterizer:
            return open_rasterizer(mesh, cameras[index], **options)

        first = open_one(0)
        self.info, self._opened, self._open = first.info, open_one, {0: first}
        self._mesh = mesh
        self._lock = threading.Lock()

    def count(self, poses: Poses) -> FaceCounts:
        """Samples of each face in each pose, through the camera of the pose."""
        parts = list(poses.by_camera())
        if len(parts) <= 1:
            return self._of(parts[0][0] if parts else 0).count(poses)
        counts = [self._of(index).count(poses[rows]) for index, rows in parts]
        order = sort_order(np.concatenate([rows for _, rows in parts]))
        names = "visible", "drawn", "background", "clipped"
        joined: ByName = {
            name: np.concatenate([getattr(each, name) for each in counts])[order] for name in names
        }
        return replace(counts[0], **joined)

    def why_not_judged(self, poses: Poses, criteria: Sequence[Criteria]) -> str:
        """Reason why `judge` has to be left to the host, by the criteria of each camera; or ""."""
        used = [index for index, _ in poses.by_camera()]
        whys = (self._of(index)._why_not_judged(criteria[index]) for index in used)
        return next(filter(None, whys), "")

    def judge(self, poses: Poses, criteria: Sequence[Criteria]) -> Judged:
        """Faces that each pose covers, by the criteria of its camera; see `Rasterizer.judge`."""
        whole, clipped = no_bits(self._mesh, len(poses)), np.zeros(len(poses), bool)
        for index, rows in poses.by_camera():
            matrices = poses.world_from_camera[rows]
            bits, clipped[rows] = self._of(index)._judge(matrices, criteria[index])
            add_bits(whole, bits, rows)
        return whole, clipped

    def _of(self, index: int) -> Rasterizer:
        """Rasteriser of a camera; the one that was used least lately is closed for it."""
        with self._lock:
            one = self._open.pop(index, None)
            if one is None:
                if len(self._open) >= MOST_OPEN:
                    self._open.pop(next(iter(self._open))).close()
                one = self._opened(index)
            self._open[index] = one  # the latest is the last
            return one

    def close(self) -> None:
        """Close all of them."""
        for rasterizer in self._open.values():
            rasterizer.close()


ROLL = 0.4
"""Radians by which the grid of samples is turned against the image: 23 degrees, far from every
direction that is common in manufactured parts. Along rows of samples errors of counting add up."""
OBSERVED = 3 * 8 + 1
"""Bytes of a pair of pose and face in an `Observation`."""


class Observer(Closing, ABC):
    """Areas of one mesh that one camera, or several, see; open it with `open_observer`.

    Use it in a `with` block. Any number of threads may use one observer at once, except with method
    "sampled" on OpenGL: that observer belongs to the thread that opened it, and raises
    `DeviceError` in any other.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera(width=640, height=480, fx=600, fy=600)
    >>> with rc.open_observer(mesh, camera) as observer:
    ...     near = observer.observe(rc.look_at((0.7, 0, 0), (0, 0, 0)))
    ...     far = observer.observe(rc.look_at((1.3, 0, 0), (0, 0, 0)))
    >>> round(near.visible_pixels.sum()), round(far.visible_pixels.sum())
    (40000, 10000)
    """

    mesh: Mesh
    camera: Cameras
    info: RasterizerInfo
    threads: int
    """Threads that share the poses of a call."""
    _is_open = True

    @abstractmethod
    def observe(self, poses: ArrayLike | Poses) -> Observation:
        """Areas of every face in each pose, (P, 4, 4) or (4, 4) world_from_camera.

        Raises
        ------
        PoseError
            For a pose that is not a rigid transform, and a camera index that does not exist.
        ResourceError
            Where the arrays need more memory than is free; checked before allocation.
        DeviceError
            After `close`.

        Examples
        --------
        >>> import rastercov as rc
        >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
        >>> camera = rc.Camera(width=640, height=480, fx=600, fy=600)
        >>> with rc.open_observer(mesh, camera) as observer:
        ...     seen = observer.observe(rc.look_at((0.7, 0, 0), (0, 0, 0)))
        >>> seen.visible_pixels[0, 2:4].round(3).tolist()  # of the two faces of a side
        [20000.0, 20000.0]
        """

    def measure(self, poses: ArrayLike | Poses) -> Measured:
        """Result of `observe`, or the sample counts behind it where those are cheaper."""
        return self._measure(self._accept(poses))

    def _measure(self, poses: Poses) -> Measured:
        """`measure` of poses that it accepts."""
        return self.observe(poses)

    @abstractmethod
    def close(self) -> None:
        """Release its memory: later calls raise `DeviceError`; a second `close` does nothing.

        Calls running in other threads complete normally.
        """

    def _accept(self, poses: ArrayLike | Poses, n_bytes: float = OBSERVED) -> Poses:
        """Poses that this observer can measure, with room for what it finds of each face."""
        if not self._is_open:
            raise DeviceError("expected an open observer, got a closed one; open a new one")
        accepted = Poses.of(poses)
        accepted.check_cameras(len(cameras_of(self.camera)))
        check_memory(
            f"figures of {len(accepted):,} poses x {self.mesh.n_faces:,} faces",
            int(n_bytes * len(accepted) * self.mesh.n_faces),
            "observe fewer poses at a time",
        )
        return accepted


class SampledObserver(Observer):
    """Observer that counts samples of a rasteriser, whose options it takes."""

    def __init__(
        self, mesh: Mesh, camera: Cameras, judging: int | None = None, /, **options: object
    ) -> None:
        self.threads, self.mesh, self.camera = thread_count(judging), mesh, camera
        self._supersample = options.get("supersample", 1)
        self._open(options)

    def _open(self, options: ReadByName) -> None:
        self._rasterizers = Rasterizers(self.mesh, cameras_of(self.camera), roll=ROLL, **options)
        self.info = self._rasterizers.info

    def observe(self, poses: ArrayLike | Poses) -> Observation:
        """Areas from the counts of samples, see `Observer`."""
        return Observation.of_counts(self._measure(self._accept(poses)))

    def _measure(self, poses: Poses) -> FaceCounts:
        return self._rasterizers.count(poses)

    def why_not_judged(self, poses: Poses, criteria: Sequence[Criteria]) -> str:
        """Reason why the host has to judge what is counted; "" if `judge` can."""
        return self._rasterizers.why_not_judged(poses, criteria)

    def judge(self, poses: ArrayLike | Poses, criteria: Sequence[Criteria]) -> Judged:
        """Faces that poses cover, judged where they are counted.

        `measure` and `FacePass`, whose `criteria` these are, give the same bits.
        """
        return self._rasterizers.judge(self._accept(poses, n_bytes=1 / 8), criteria)

    def fall_back(self) -> None:
        """Count on the CPU from now on, in place of a device that fails."""
        with suppress(DeviceError):
            self._rasterizers.close()
        own = {"threads": self.threads, "supersample": self._supersample}
        self._open({"backend": "cpu", **own})

    def close(self) -> None:
        """Release the memory."""
        self._rasterizers.close()  # refuses in a thread that may not, and all stays open
        self._is_open = False


class ExactObserver(Observer):
    """Observer that computes areas by half planes, all of them or where no proof decides."""

    def __init__(self, solvers: ExactPass) -> None:
        self.mesh, self.camera, method = solvers.mesh, solvers.camera, solvers.method
        renderer = f"{method}, rastercov {rastercov.__version__}"
        self.info = RasterizerInfo("analytic", method, renderer, "", "cpu", "float64", "")
        self._pass, self.threads = solvers, solvers.threads

    def observe(self, poses: ArrayLike | Poses) -> Observation:
        """Exact or certified areas, see `Observer`."""
        return self._measure(self._accept(poses))

    def _measure(self, poses: Poses) -> Observation:
        seen = room_for(len(poses), self.mesh.n_faces)
        self._pass.observe(poses, seen)
        return seen

    def close(self) -> None:
        """Release the memory."""
        self._is_open = False
        self._pass.close()


def open_observer(
    mesh: Mesh,
    camera: Cameras,
    method: str | Engine = "certified",
    *,
    threads: int | None = None,
) -> Observer:
    """Observer of a mesh through a camera, or several; use it in a `with` block.

    Parameters
    ----------
    mesh : Mesh
        The scene.
    camera : Camera, Rig or sequence of Camera
        For several, `Poses.camera` has the index of the camera of each pose.
    method : {"certified", "exact", "sampled"}, or Engine
        "certified" proves most faces visible or hidden, and computes the others; "exact" computes
        every face, several times slower, as a check; "sampled" counts samples in the image, with a
        statistical bound. Or an `Engine`, or its text form, such as "sampled:cpu@4".
    threads : int, optional
        Number of threads on the CPU; that of the engine, or one per core, unless given.

    Raises
    ------
    ConfigError
        For an unknown method.
    DeviceError
        When the device of method "sampled" cannot be opened.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera(width=640, height=480, fx=600, fy=600)
    >>> with rc.open_observer(mesh, camera, "exact", threads=1) as observer:
    ...     seen = observer.observe(rc.sphere_of_poses((0, 0, 0), distance=0.7, count=3))
    >>> seen.visible_pixels.shape
    (3, 12)
    """
    check_scene(mesh, camera)
    engine = Engine.of(method, threads)
    if engine.method == "sampled":
        options = engine.rasterizer_options | {"supersample": engine.supersample}
        return SampledObserver(mesh, camera, engine.threads, **options)
    return ExactObserver(ExactPass(mesh, camera, engine))


PAIRS_A_BATCH = 1 << 19
"""Pose-face pairs evaluated at a time: about 50 MB of figures.

`POSES_A_BATCH` poses, which a union of few faces adds at once, are as many of these or fewer."""
LEAST_ALIGNED = 1 << 14
"""Pairs from which on figures start at a cache line."""
POSES_A_BATCH = POSES_TOGETHER
"""Most poses evaluated at a time: a second or two of work between two signs of progress."""


@frozen_record
class Coverage(InNotebook):
    """Values for each pose and face; arrays are (P, F) unless noted.

    The arrays from `in_view` to `reason` are those that `fields` of `evaluate` chooses. Numbers of
    equations are those of E. S. Eissa (2020), docs/appendix/equations.md.

    Attributes
    ----------
    in_view : bool
        (3.7): True if all three vertices, and of lenses with distortion the curved edges, are
        inside the image and in front of the camera.
    in_view_fraction : float64
        Part of the projected area that is inside the image, [0, 1].
    projected_area : float64
        (3.9): projected area, px^2, of the part beyond the near plane; computed, not counted.
    visible_pixels, drawn_pixels : float64
        Area of the face inside the image that the camera sees, and that it would see without
        occlusion, px^2: computed, or counted as samples over S^2.
    resolution : float64
        (3.8): drawn_pixels / R_min, not capped, with R_min `Task.min_pixels`.
    pixel_density : float64
        Pixels per metre on the surface along its worst direction.
    facing_density : float64
        Pixels per metre of a target that faces the camera at the deepest vertex.
    in_focus : bool
        True if all vertices are in focus, or the centroid, (3.12), with `focus_rule="centroid"`.
    visibility, visibility_bound : float64
        Visible fraction of the part inside the image, (3.14), [0, 1], and the bound of its error.
    visibility_kind : uint8
        `rastercov.BoundKind` of each bound.
    incidence : float64
        Angle between the normal and the ray to the camera centre, radians.
    coverage : float64
        Product of the criteria, (3.6), [0, 1] unless the resolution is uncapped.
    reason : uint8
        `rastercov.Reason` of each pair.
    clipped : (P,) bool
        True where the near plane cuts away a surface in view.
    pose_ids : (P,) int64
        Row of each pose in the input, from which invalid poses may have been left out.
    eyes : (P, 3) float64
        Centre of the camera of each pose, metres.
    info : RasterizerInfo
        Method and device that measured it.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> result = rc.evaluate(mesh, camera, rc.look_at((0.6, 0, 0), (0, 0, 0)))
    >>> result.coverage.shape  # poses, faces
    (1, 12)
    >>> int((result.coverage > 0).sum())
    2
    >>> sorted({rc.Reason(each).name for each in result.reason.ravel().tolist()})
    ['BACK_FACING', 'COVERED']
    """

    mesh: Mesh
    camera: Cameras
    task: Task
    info: RasterizerInfo
    pose_ids: IntArray
    clipped: BoolArray
    in_view: BoolArray
    in_view_fraction: FloatArray
    projected_area: FloatArray
    visible_pixels: FloatArray
    drawn_pixels: FloatArray
    resolution: FloatArray
    pixel_density: FloatArray
    facing_density: FloatArray
    in_focus: BoolArray
    visibility: FloatArray
    visibility_bound: FloatArray
    visibility_kind: ByteArray
    incidence: FloatArray
    coverage: FloatArray
    reason: ByteArray
    eyes: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))

    def __post_init__(self) -> None:
        check_kind("mesh", self.mesh, Mesh, "a Mesh", ConfigError)
        if np.ndim(self.pose_ids) != 1:
            raise ConfigError(
                f"expected pose_ids (P,), got {shown(self.pose_ids)}; give one per pose"
            )
        for name in FIGURES:
            if vars(self)[name] is None:  # not asked for
                object.__delattr__(self, name)

    def __repr__(self) -> str:
        names = ", ".join(name for name in FIGURES if self._has(name)) or "no arrays"
        shape = f"{plural(len(self.pose_ids), 'pose')} x {plural(self.mesh.n_faces, 'face')}"
        return f"{type(self).__name__}({shape}: {names})"

    def _has(self, name: str) -> bool:
        """True for a figure that was asked for."""
        return name in vars(self) or name in self._later()

    def _later(self) -> Collection[str]:
        """Names of figures that are derived when they are first read, see `_derive`."""
        return ()

    def _derive(self, name: str) -> AnyArray:
        """A figure of `_later`."""
        raise NotImplementedError  # never called here, where `_later` has no names

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            if name in FIGURES and name in self._later():
                object.__setattr__(self, name, self._derive(name))
                return vars(self)[name]
            if name in FIGURES:
                raise ConfigError(
                    f"expected {name} among the fields of this coverage, got none; add it to fields"
                )
            raise AttributeError(f"{type(self).__name__} has no attribute {name!r}")


def evaluate_batches(
    observer: Observer,
    poses: ArrayLike,
    task: Task | None = None,
    *,
    fields: Sequence[str] | None = None,
) -> Iterator[Coverage]:
    """Coverage a few poses at a time, for runs of any length; at least one batch, maybe empty.

    The observer is open; the other arguments are those of `rastercov.evaluate`, and checked at
    once. Each batch, of `batch_size` consecutive poses, is measured on demand. Any number of
    threads may have an iterator each over one observer, but not share an iterator.
    """
    accepted, names = Poses.of(poses), check_fields(fields)
    if not isinstance(observer, Observer):
        raise ConfigError(f"expected an observer of open_observer, got {shown(observer)}; open one")
    task = Task() if task is None else task
    judge = FacePass(observer.mesh, observer.camera, observer.threads, task)
    batches = measurements(observer, accepted)
    return (classify(observer, judge, task, part, seen, names) for part, seen in batches)


def measurements(
    observer: Observer, poses: Poses, rows: IntArray | None = None, times: int = 1
) -> Iterator[tuple[Poses, Measured]]:
    """Poses and what is measured of them, a few at a time, see `in_batches`.

    Counts take a third of the memory of an observation: `times` as many poses are counted together.
    """
    n_faces = observer.mesh.n_faces
    if isinstance(observer, SampledObserver):
        n_faces = -(-n_faces // times)
    for part in in_batches(poses, n_faces, observer.threads, rows):
        yield part, observer.measure(part)


def in_batches(
    poses: Poses, n_faces: int, threads: int, rows: IntArray | None = None
) -> Iterator[Poses]:
    """Poses a few at a time, see `batch_size`; at least once, maybe none.

    Poses of one of the `rows` of the result, (P,), come together.
    """
    step, at = batch_size(n_faces, threads), 0
    while at < max(1, len(poses)):
        end = min(at + step, len(poses))
        if rows is not None and end < len(poses) and rows[end] == rows[end - 1]:
            end = int(np.searchsorted(rows, rows[end]))
            end = end if end > at else int(np.searchsorted(rows, rows[at], side="right"))
        yield poses[at:end]
        at = max(end, at + 1)


def batch_size(n_faces: int, threads: int) -> int:
    """Most poses that are measured together.

    `PAIRS_A_BATCH` pairs, rounded up so that each of the threads has as many poses, but at most
    `POSES_A_BATCH` poses: with fewer than one for each thread of a million faces, one would work.
    """
    poses = max(1, PAIRS_A_BATCH // n_faces)
    return min(POSES_A_BATCH, -(-poses // threads) * threads)


def classify(
    observer: Observer,
    judge: FacePass,
    task: Task,
    poses: Poses,
    seen: Measured,
    names: Sequence[str],
) -> Coverage:
    """Coverage of poses from their measurement, with the named figures."""
    values = arrays_for(names, (len(poses), observer.mesh.n_faces))
    judge.fill(seen, poses, values)
    head = observer.mesh, observer.camera, task, observer.info, poses.ids, seen.clipped
    figures: ByName = dict.fromkeys(FIGURES)
    return Coverage(*head, **(figures | values), eyes=eyes_of(observer.camera, poses))


def arrays_for(names: Sequence[str], shape: tuple[int, int]) -> dict[str, AnyArray]:
    """Memory for the named figures, (P, F) each."""
    # To align an array takes 3 us, more than it saves in a loop over a few faces.
    make = np.empty if math.prod(shape) < LEAST_ALIGNED else align_array
    return {name: make(shape, FIGURES[name]) for name in names}


def check_fields(names: Sequence[str] | None, *others: str) -> list[str]:
    """Names of figures that were asked for, in the order of `FIGURES`, and of `others`."""
    if names is None:
        return list(FIGURES)
    known = isinstance(names, list | tuple | set | frozenset | dict)
    if not known or not all(
        isinstance(name, str) and name in (*FIGURES, *others) for name in names
    ):
        raise ConfigError(
            f"expected arrays of Coverage, got {shown(names)}; name some, such as reason"
        )
    return [name for name in (*FIGURES, *others) if name in names]
