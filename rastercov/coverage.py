"""Coverage of each face by each camera (3.6): all criteria of many poses, batch by batch.

E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. 2020, section 3.3.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov._arguments import check_kind, check_scene
from rastercov._checks import shown
from rastercov.camera import Camera
from rastercov.criteria import FaceGeometry, face_geometry, in_focus
from rastercov.errors import ConfigError, ResourceError
from rastercov.mesh import Mesh
from rastercov.observation import Observation, visible_fraction
from rastercov.observer import Observer, open_observer
from rastercov.pose import Poses
from rastercov.raster.contract import RasterizerInfo
from rastercov.task import Task

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

PAIRS_A_BATCH = 1 << 19
"""Pose-face pairs evaluated at a time: about 50 MB of figures."""
POSES_A_BATCH = 256
"""Most poses evaluated at a time: a second or two of work between two signs of progress."""
_LARGEST_RESOLUTION = 1e300
"""Of one face; a smaller R_min gives no more."""
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
    """

    mesh: Mesh
    camera: Camera
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
    in_focus: BoolArray = field(metadata=_figure(np.bool_))
    visibility: FloatArray = field(metadata=_figure(np.float64))
    visibility_bound: FloatArray = field(metadata=_figure(np.float64))
    visibility_kind: NDArray[np.uint8] = field(metadata=_figure(np.uint8))
    incidence: FloatArray = field(metadata=_figure(np.float64, "rad"))
    coverage: FloatArray = field(metadata=_figure(np.float64))
    reason: NDArray[np.uint8] = field(metadata=_figure(np.uint8))


FIGURES: dict[str, Any] = {
    each.name: each.metadata["dtype"] for each in fields(Coverage) if "dtype" in each.metadata
}
"""The (P, F) arrays of `Coverage` and their types, in the order of a report."""
UNITS: dict[str, str] = {
    each.name: each.metadata["unit"] for each in fields(Coverage) if each.metadata.get("unit")
}


def evaluate(
    mesh: Mesh,
    camera: Camera,
    poses: ArrayLike,
    task: Task | None = None,
    *,
    method: str = "certified",
    backend: str = "auto",
    supersample: int = 1,
    skip_bad_poses: bool = False,
    **options: Any,
) -> Coverage:
    """Coverage of each face in each pose, all at once.

    Parameters
    ----------
    mesh, camera
        What is looked at, and by what.
    poses : (P, 4, 4) array_like, or Poses
        world_from_camera.
    task : Task, optional
        Thresholds; `Task()` unless given.
    method, backend, supersample, **options
        How visibility is found; as for `open_observer`.
    skip_bad_poses : bool
        Leave out poses that are no rigid motion instead of raising; see `Coverage.pose_ids`.

    Raises
    ------
    PoseError
        For a pose that is no rigid motion.
    ResourceError
        When the arrays would exceed `EVALUATE_BUDGET`; use `evaluate_batches`.
    """
    check_scene(mesh, camera)
    accepted = Poses.of(poses, skip_bad=skip_bad_poses)
    shape = (len(accepted), mesh.n_faces)
    size = shape[0] * shape[1] * sum(np.dtype(kind).itemsize for kind in FIGURES.values())
    if size > EVALUATE_BUDGET:
        raise ResourceError(
            f"{shape[0]} poses x {shape[1]} faces would take {size / 2**30:.1f} GiB; "
            "use evaluate_batches, which holds a few poses at a time"
        )
    with open_observer(
        mesh, camera, method, backend=backend, supersample=supersample, **options
    ) as observer:
        whole: dict[str, NDArray[Any]] = {n: np.empty(shape, kind) for n, kind in FIGURES.items()}
        whole |= {"pose_ids": np.empty(shape[0], np.int64), "clipped": np.empty(shape[0], bool)}
        done = 0
        for batch in evaluate_batches(observer, accepted, task):
            for name, array in whole.items():
                array[done : done + len(batch.pose_ids)] = getattr(batch, name)
            done += len(batch.pose_ids)
    return Coverage(mesh=mesh, camera=camera, task=batch.task, info=observer.info, **whole)


def evaluate_batches(
    observer: Observer,
    poses: ArrayLike,
    task: Task | None = None,
    *,
    skip_bad_poses: bool = False,
) -> Iterator[Coverage]:
    """Coverage a few poses at a time, for runs of any length; at least one batch, maybe empty.

    Parameters
    ----------
    observer : Observer
        Open, for the mesh and camera to evaluate.
    poses, task, skip_bad_poses
        As for `evaluate`.

    Returns
    -------
    Iterator of Coverage
        Of consecutive poses, at most `PAIRS_A_BATCH` pairs and `POSES_A_BATCH` poses each. The
        arguments are checked at once; each batch is measured when it is asked for. Any number of
        threads may have an iterator each over one observer, but not share an iterator.
    """
    accepted = Poses.of(poses, skip_bad=skip_bad_poses)
    if not isinstance(getattr(observer, "mesh", None), Mesh) or not hasattr(observer, "observe"):
        raise ConfigError(
            f"observer must be what open_observer gives, got {shown(observer)}; open one"
        )
    task = Task() if task is None else task
    check_kind("task", task, Task, "a Task or None", ConfigError)
    step = max(1, min(POSES_A_BATCH, PAIRS_A_BATCH // observer.mesh.n_faces))
    starts = range(0, max(1, len(accepted)), step)
    return (_judge(observer, task, accepted[at : at + step]) for at in starts)


def _judge(observer: Observer, task: Task, poses: Poses) -> Coverage:
    """Coverage of a batch."""
    mesh, camera = observer.mesh, observer.camera
    seen = observer.observe(poses)
    shape = (len(poses), mesh.n_faces)
    values: dict[str, NDArray[Any]] = {n: np.zeros(shape, kind) for n, kind in FIGURES.items()}
    focus_limits = camera.depth_of_field(task.max_blur)
    for row, pose in enumerate(poses.world_from_camera):
        geometry = face_geometry(mesh, camera, pose)
        for name, of_pose in _criteria(mesh, task, focus_limits, geometry, seen, row).items():
            values[name][row] = of_pose
    return Coverage(mesh, camera, task, observer.info, poses.ids, seen.clipped, **values)


def _criteria(
    mesh: Mesh,
    task: Task,
    focus_limits: tuple[float, float],
    geometry: FaceGeometry,
    seen: Observation,
    row: int,
) -> dict[str, NDArray[Any]]:
    """Every figure of one pose, by the names of `FIGURES`."""
    visibility, bound, kind = visible_fraction(geometry, seen, row)
    drawn = seen.drawn_pixels[row]
    with np.errstate(over="ignore"):  # for the least R_min; sums over faces stay finite
        resolution = np.minimum(drawn / task.min_pixels, _LARGEST_RESOLUTION)
    figures: dict[str, NDArray[Any]] = {
        "in_view": geometry.in_view,
        "in_view_fraction": geometry.in_view_fraction,
        "projected_area": geometry.projected_area,
        "visible_pixels": seen.visible_pixels[row],
        "drawn_pixels": drawn,
        "resolution": resolution,
        "pixel_density": geometry.pixel_density,
        "in_focus": in_focus(geometry.depth, focus_limits, task.focus_rule),
        "visibility": visibility,
        "visibility_bound": bound,
        "visibility_kind": kind,
        "incidence": geometry.incidence,
    }
    coverage, reason = task.judge(mesh.degenerate_mask, geometry, figures)
    return figures | {"coverage": coverage, "reason": reason}
