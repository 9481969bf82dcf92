"""Coverage of each face by each camera (3.6): all criteria of many poses, batch by batch.

E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. 2020, section 3.3.
"""

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    AnyArray,
    BoolArray,
    ByName,
    ByteArray,
    ConfigError,
    FloatArray,
    InNotebook,
    IntArray,
    check_kind,
    frozen_record,
    plural,
    shown,
)
from rastercov.base.memory import align_array
from rastercov.core.camera import Cameras, Poses, eyes_of
from rastercov.core.coverage.face_pass import FIGURES, FacePass, Measured
from rastercov.core.coverage.observer import Observer
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import Mesh
from rastercov.core.raster.contract import RasterizerInfo

PAIRS_A_BATCH = 1 << 19
"""Pose-face pairs evaluated at a time: about 50 MB of figures."""
LEAST_ALIGNED = 1 << 14
"""Pairs from which on figures start at a cache line."""
POSES_A_BATCH = 256
"""Most poses evaluated at a time: a second or two of work between two signs of progress."""


@frozen_record
class Coverage(InNotebook):
    """Values for each pose and face; arrays are (P, F) unless noted.

    The arrays from `in_view` to `reason` are those that `fields` of `evaluate` chooses. Numbers of
    equations are those of E. S. Eissa (2020), docs/appendix/equations.md.

    Attributes
    ----------
    in_view : bool
        (3.7): True if all three vertices are inside the image and in front of the camera.
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
        kept = vars(self).keys() | self._later()
        names = ", ".join(name for name in FIGURES if name in kept) or "no arrays"
        shape = f"{plural(len(self.pose_ids), 'pose')} x {plural(self.mesh.n_faces, 'face')}"
        return f"{type(self).__name__}({shape}: {names})"

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
    check_observer(observer)
    task = Task() if task is None else task
    judge = FacePass(observer.mesh, observer.camera, observer.threads, task)
    batches = measurements(observer, accepted)
    return (classify(observer, judge, task, part, seen, names) for part, seen in batches)


def check_observer(observer: object) -> None:
    """Raise `ConfigError` unless it is an observer."""
    if not isinstance(observer, Observer):
        raise ConfigError(f"expected an observer of open_observer, got {shown(observer)}; open one")


def measurements(
    observer: Observer, poses: Poses, rows: IntArray | None = None
) -> Iterator[tuple[Poses, Measured]]:
    """Poses and what is measured of them, a few at a time, see `in_batches`."""
    for part in in_batches(poses, observer.mesh.n_faces, observer.threads, rows):
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
