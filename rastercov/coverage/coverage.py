"""Coverage of each face by each camera (3.6): all criteria of many poses, batch by batch.

E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. 2020, section 3.3.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.arguments import check_kind
from rastercov.base.checks import shown
from rastercov.base.errors import ConfigError, ResourceError
from rastercov.base.memory import aligned_array
from rastercov.base.threads import threads_of
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, check_scene
from rastercov.coverage.coverage_pass import CoveragePass
from rastercov.coverage.face_pass import Measured
from rastercov.coverage.observer import Observer, open_observer
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.raster.contract import RasterizerInfo

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

PAIRS_A_BATCH = 1 << 19
"""Pose-face pairs evaluated at a time: about 50 MB of figures."""
POSES_A_BATCH = 256
"""Most poses evaluated at a time: a second or two of work between two signs of progress."""
EVALUATE_BUDGET = 4 << 30
"""Bytes `evaluate` may return; larger runs go through `evaluate_batches`."""


def _figure(dtype: type, unit: str = "") -> dict[str, Any]:
    """Metadata of a field of `Coverage` that is a (P, F) array."""
    return {"dtype": dtype, "unit": unit}


@dataclass(frozen=True, eq=False)
class Coverage:
    """Every figure of every pose and face; arrays are (P, F) unless noted.

    Attributes
    ----------
    in_view : bool
        (3.7): all three vertices inside the image and before the camera.
    in_view_fraction : float64
        Part of the projected area inside the image.
    projected_area : float64
        (3.9), px^2, of the part beyond the near plane; computed, not counted.
    visible_pixels, drawn_pixels : float64
        What the camera gets of the face inside the image, and would get were it alone, px^2:
        computed, or counted as samples over S^2.
    resolution : float64
        (3.8): drawn_pixels / R_min, not capped; times `visibility` it is visible_pixels / R_min
        for faces seen from the front.
    pixel_density : float64
        Pixels a metre on the surface along its worst direction.
    facing_density : float64
        Pixels a metre of a target that faces the camera at the deepest vertex.
    in_focus : bool
        (3.12).
    visibility, visibility_bound : float64
        (3.14), and how far it may be off.
    visibility_kind : uint8
        `rastercov.BoundKind` of each bound.
    incidence : float64
        Angle between normal and ray to the camera centre, radians.
    coverage : float64
        (3.6).
    reason : uint8
        `Reason` of each pair.
    clipped : (P,) bool
        Whether the near plane cut away a surface in view.
    pose_ids : (P,) int64
        Row of each pose in the input; they skip poses that were at fault.
    eyes : (P, 3) float64
        Centre of each camera, metres.
    """

    mesh: Mesh
    camera: Cameras
    task: Task
    info: RasterizerInfo
    pose_ids: IntArray
    clipped: BoolArray
    in_view: BoolArray = field(metadata=_figure(np.bool_))
    in_view_fraction: FloatArray = field(metadata=_figure(np.float64))
    projected_area: FloatArray = field(metadata=_figure(np.float64, "px^2"))
    visible_pixels: FloatArray = field(metadata=_figure(np.float64, "px"))
    drawn_pixels: FloatArray = field(metadata=_figure(np.float64, "px"))
    resolution: FloatArray = field(metadata=_figure(np.float64))
    pixel_density: FloatArray = field(metadata=_figure(np.float64, "px/m"))
    facing_density: FloatArray = field(metadata=_figure(np.float64, "px/m"))
    in_focus: BoolArray = field(metadata=_figure(np.bool_))
    visibility: FloatArray = field(metadata=_figure(np.float64))
    visibility_bound: FloatArray = field(metadata=_figure(np.float64))
    visibility_kind: NDArray[np.uint8] = field(metadata=_figure(np.uint8))
    incidence: FloatArray = field(metadata=_figure(np.float64, "rad"))
    coverage: FloatArray = field(metadata=_figure(np.float64))
    reason: NDArray[np.uint8] = field(metadata=_figure(np.uint8))
    eyes: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))

    def __post_init__(self) -> None:
        for name in FIGURES:
            if vars(self)[name] is None:  # not asked for
                object.__delattr__(self, name)

    def __repr__(self) -> str:
        return f"Coverage({', '.join(f'{name}={value!r}' for name, value in vars(self).items())})"

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            if name in FIGURES:
                raise ConfigError(
                    f"this coverage has no {name}, which was not asked for; add it to fields"
                )
            raise AttributeError(f"Coverage has no attribute {name!r}")


FIGURES: dict[str, Any] = {
    each.name: each.metadata["dtype"]
    for each in dataclasses.fields(Coverage)
    if "dtype" in each.metadata
}
"""The (P, F) arrays of `Coverage` and their types, in the order of a report."""
UNITS: dict[str, str] = {
    each.name: each.metadata["unit"]
    for each in dataclasses.fields(Coverage)
    if each.metadata.get("unit")
}


def evaluate(
    mesh: Mesh,
    camera: Cameras,
    poses: ArrayLike,
    task: Task | None = None,
    *,
    method: str = "certified",
    backend: str = "auto",
    supersample: int = 1,
    skip_bad_poses: bool = False,
    fields: Sequence[str] | None = None,
    **options: Any,
) -> Coverage:
    """Coverage of each face in each pose, all at once.

    Parameters
    ----------
    mesh : Mesh
        What is looked at.
    camera : Camera, Rig or sequence of Camera
        What looks; where there are several, `Poses.camera` says which of them is in each pose.
    poses : (P, 4, 4) array_like, or Poses
        world_from_camera.
    task : Task, optional
        Thresholds; `Task()` unless given.
    method, backend, supersample, **options
        How visibility is found; as for `open_observer`.
    skip_bad_poses : bool
        Leave out poses that are no rigid motion instead of raising; see `Coverage.pose_ids`.
    fields : sequence of str, optional
        Names of the (P, F) arrays to compute, such as ("coverage", "reason"); all unless given.
        Any other array of the result raises `ConfigError` when it is read.

    Raises
    ------
    ConfigError
        For a field that does not exist.
    PoseError
        For a pose that is no rigid motion.
    ResourceError
        When the arrays would exceed `EVALUATE_BUDGET`; use `evaluate_batches`.
    """
    check_scene(mesh, camera)
    accepted, names = Poses.of(poses, skip_bad=skip_bad_poses), _checked_fields(fields)
    task = _checked_task(task)
    shape = len(accepted), mesh.n_faces
    size = shape[0] * shape[1] * sum(np.dtype(FIGURES[name]).itemsize for name in names)
    if size > EVALUATE_BUDGET:
        raise ResourceError(
            f"{shape[0]} poses x {shape[1]} faces would take {size / 2**30:.1f} GiB; "
            "use evaluate_batches, which holds a few poses at a time"
        )
    with open_observer(
        mesh, camera, method, backend=backend, supersample=supersample, **options
    ) as observer:
        whole, clipped = _arrays(names, shape), np.empty(shape[0], np.bool_)
        judge = CoveragePass(observer, task)
        for rows in _batches(len(accepted), observer):
            part = accepted[rows]
            seen = _measured(observer, part)
            judge.fill(seen, part, {name: array[rows] for name, array in whole.items()})
            clipped[rows] = seen.clipped
        return _coverage(observer, task, accepted, clipped, whole)


def evaluate_batches(
    observer: Observer,
    poses: ArrayLike,
    task: Task | None = None,
    *,
    skip_bad_poses: bool = False,
    fields: Sequence[str] | None = None,
) -> Iterator[Coverage]:
    """Coverage a few poses at a time, for runs of any length; at least one batch, maybe empty.

    Parameters
    ----------
    observer : Observer
        Open, for the mesh and camera to evaluate.
    poses, task, skip_bad_poses, fields
        As for `evaluate`.

    Returns
    -------
    Iterator of Coverage
        Of consecutive poses, as many each as `batch_size` says. The arguments are checked at once;
        each batch is measured when it is asked for. Any number of threads may have an iterator each
        over one observer, but not share an iterator.
    """
    accepted, names = Poses.of(poses, skip_bad=skip_bad_poses), _checked_fields(fields)
    check_observer(observer)
    task = _checked_task(task)
    judge = CoveragePass(observer, task)
    batches = measurements(observer, accepted)
    return (judged(observer, judge, task, part, seen, names) for part, seen in batches)


def check_observer(observer: object) -> None:
    """Raise `ConfigError` for what cannot observe."""
    if not isinstance(getattr(observer, "mesh", None), Mesh) or not hasattr(observer, "observe"):
        raise ConfigError(
            f"observer must be what open_observer gives, got {shown(observer)}; open one"
        )


def measurements(observer: Observer, poses: Poses) -> Iterator[tuple[Poses, Measured]]:
    """Poses and what is measured of them, a few at a time; at least once, maybe of none."""
    for rows in _batches(len(poses), observer):
        yield poses[rows], _measured(observer, poses[rows])


def _measured(observer: Observer, poses: Poses) -> Measured:
    """Observation, or the counts that it would be made of where an observer gives these."""
    measured: Measured = getattr(observer, "measure", observer.observe)(poses)
    return measured


def batch_size(n_faces: int, threads: int) -> int:
    """Most poses that are measured together.

    `PAIRS_A_BATCH` pairs, rounded up so that each of the threads has as many poses, but at most
    `POSES_A_BATCH` poses: with fewer than one for each thread of a million faces, one would work.
    """
    poses = max(1, PAIRS_A_BATCH // n_faces)
    return min(POSES_A_BATCH, -(-poses // threads) * threads)


def _batches(n_poses: int, observer: Observer) -> Iterator[slice]:
    """Slices of poses that are measured together; at least one, maybe empty."""
    step = batch_size(observer.mesh.n_faces, threads_of(observer))
    return (slice(at, at + step) for at in range(0, max(1, n_poses), step))


def judged(
    observer: Observer,
    judge: CoveragePass,
    task: Task,
    poses: Poses,
    seen: Measured,
    names: Sequence[str],
) -> Coverage:
    """Coverage of poses from their measurement, with the named figures."""
    values = _arrays(names, (len(poses), observer.mesh.n_faces))
    judge.fill(seen, poses, values)
    return _coverage(observer, task, poses, seen.clipped, values)


def _arrays(names: Sequence[str], shape: tuple[int, int]) -> dict[str, NDArray[Any]]:
    return {name: aligned_array(shape, FIGURES[name]) for name in names}


def _coverage(
    observer: Observer, task: Task, poses: Poses, clipped: BoolArray, values: dict[str, Any]
) -> Coverage:
    """Coverage with some of the figures."""
    head = observer.mesh, observer.camera, task, observer.info, poses.ids, clipped
    figures: dict[str, Any] = dict.fromkeys(FIGURES)
    return Coverage(*head, **(figures | values), eyes=poses.world_from_camera[:, :3, 3])


def _checked_fields(names: Sequence[str] | None) -> list[str]:
    """Names of figures that were asked for, in the order of `FIGURES`."""
    if names is None:
        return list(FIGURES)
    known = isinstance(names, list | tuple | set | frozenset | dict)
    if not known or not all(isinstance(name, str) and name in FIGURES for name in names):
        raise ConfigError(f"fields must be a sequence of {', '.join(FIGURES)}, got {shown(names)}")
    return [name for name in FIGURES if name in names]


def _checked_task(task: Task | None) -> Task:
    task = Task() if task is None else task
    check_kind("task", task, Task, "a Task or None", ConfigError)
    return task
