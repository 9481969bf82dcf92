"""Coverage of each face by each camera (3.6), and why a face is not covered.

    coverage = field of view * min(1, resolution) * focus * visibility, and ours: * incidence
               * pixel density, which are 1 within their limits and 0 beyond.

E. S. Eissa. Image Space Coverage Model. 2020, section 3.3.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov._arguments import check_choice, check_kind, check_scene, flag
from rastercov._checks import finite_number, shown
from rastercov.camera import Camera
from rastercov.criteria import in_focus, view_faces
from rastercov.errors import ConfigError, ResourceError
from rastercov.mesh import Mesh
from rastercov.observer import Observation, Observer, figures, open_observer
from rastercov.pose import check_poses, valid_poses
from rastercov.raster.contract import RasterizerInfo

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


class Reason(IntEnum):
    """Why a camera does not cover a face: the first criterion that fails, in this order."""

    DEGENERATE = 0
    """The face has no area."""
    BACK_FACING = 1
    """The camera is behind it."""
    OUTSIDE = 2
    """A vertex is outside the image or before the near plane."""
    OUT_OF_FOCUS = 3
    """It is not within the depth of field."""
    UNSAMPLED = 4
    """It is in view but so small or thin that no sample falls on it, or that it has no image to
    within rounding; occlusion is unknown."""
    TOO_COARSE = 5
    """Too few pixels, or too few a metre."""
    OCCLUDED = 6
    """Too much of it is hidden."""
    TOO_OBLIQUE = 7
    """It is seen at too flat an angle."""
    COVERED = 8
    """Nothing: it is covered."""


@dataclass(frozen=True, kw_only=True)
class Task:
    """What it takes for a face to be covered.

    Parameters
    ----------
    min_pixels : float
        R_min of (3.8): pixels that give resolution 1.
    min_visibility : float
        V_min: a face less visible than this counts as hidden, [0, 1].
    max_blur : float, optional
        c of (3.10): largest blur circle in pixels; the camera's own unless given.
    max_incidence_deg : float
        Largest angle between normal and ray, degrees, (0, 90].
    min_pixel_density : float
        Least pixels a metre on the surface, along its worst direction.
    min_coverage : float
        A camera covers a face when coverage is at least this and not 0, [0, 1].
    views : int
        Cameras that must cover a face for the network to cover it.
    focus_rule : {"vertices", "centroid"}
        Whether all vertices must be in focus (Definition 1) or the centroid (3.12).
    cap_resolution : bool
        Whether resolution enters the product as min(1, C_R).
    """

    min_pixels: float = 1.0
    min_visibility: float = 0.0
    max_blur: float | None = None
    max_incidence_deg: float = 90.0
    min_pixel_density: float = 0.0
    min_coverage: float = 0.5
    views: int = 1
    focus_rule: str = "vertices"
    cap_resolution: bool = True

    def __post_init__(self) -> None:
        limits = {
            "min_pixels": (0, math.inf, "more than 0"),
            "min_visibility": (0, 1, "0 to 1"),
            "max_blur": (0, math.inf, "more than 0"),
            "max_incidence_deg": (0, 90, "more than 0, up to 90"),
            "min_pixel_density": (0, math.inf, "0 or more"),
            "min_coverage": (0, 1, "0 to 1"),
            "views": (1, math.inf, "a whole number, 1 or more"),
        }
        for name, (low, high, words) in limits.items():
            value = getattr(self, name)
            if name == "max_blur" and value is None:
                continue
            number = finite_number(value)
            too_low = number < low or (number == 0 and words.startswith("more"))
            if too_low or not number <= high:
                raise ConfigError(f"{name} must be {words}, got {shown(value)}")
            object.__setattr__(self, name, number)
        if self.views != int(self.views):
            raise ConfigError(f"views must be a whole number, 1 or more, got {self.views}")
        object.__setattr__(self, "views", int(self.views))
        check_choice("focus_rule", self.focus_rule, ("vertices", "centroid"))
        object.__setattr__(self, "cap_resolution", flag("cap_resolution", self.cap_resolution))

    @classmethod
    def thesis(cls, **changes: Any) -> Self:
        """(3.6) to the letter: resolution uncapped, focus of the centroid, any coverage counts."""
        literal: dict[str, Any] = {
            "cap_resolution": False,
            "focus_rule": "centroid",
            "min_coverage": 0.0,
        }
        return cls(**(literal | changes))


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
        `rastercov.Kind` of each bound.
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
    in_view: BoolArray
    in_view_fraction: FloatArray
    projected_area: FloatArray
    visible_pixels: FloatArray
    drawn_pixels: FloatArray
    resolution: FloatArray
    pixel_density: FloatArray
    in_focus: BoolArray
    visibility: FloatArray
    visibility_bound: FloatArray
    visibility_kind: NDArray[np.uint8]
    incidence: FloatArray
    coverage: FloatArray
    reason: NDArray[np.uint8]


FIGURES = {
    "in_view": np.bool_,
    "in_view_fraction": np.float64,
    "projected_area": np.float64,
    "visible_pixels": np.float64,
    "drawn_pixels": np.float64,
    "resolution": np.float64,
    "pixel_density": np.float64,
    "in_focus": np.bool_,
    "visibility": np.float64,
    "visibility_bound": np.float64,
    "visibility_kind": np.uint8,
    "incidence": np.float64,
    "coverage": np.float64,
    "reason": np.uint8,
}
"""The (P, F) arrays of `Coverage` and their types, in the order of a report."""


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
    poses : (P, 4, 4) array_like
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
    shape = (len(_accepted(poses, skip_bad_poses)[1]), mesh.n_faces)
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
        for batch in evaluate_batches(observer, poses, task, skip_bad_poses=skip_bad_poses):
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
    matrices, pose_ids = _accepted(poses, skip_bad_poses)
    if not isinstance(getattr(observer, "mesh", None), Mesh) or not hasattr(observer, "observe"):
        raise ConfigError(
            f"observer must be what open_observer gives, got {shown(observer)}; open one"
        )
    task = Task() if task is None else task
    check_kind("task", task, Task, "a Task or None", ConfigError)
    step = max(1, min(POSES_A_BATCH, PAIRS_A_BATCH // observer.mesh.n_faces))
    batches = (pose_ids[at : at + step] for at in range(0, max(1, len(pose_ids)), step))
    return (_judge(observer, task, matrices[rows], rows) for rows in batches)


def _accepted(poses: ArrayLike, skip_bad_poses: bool) -> tuple[FloatArray, IntArray]:
    """All poses, (P, 4, 4), and the rows to evaluate."""
    if not flag("skip_bad_poses", skip_bad_poses):
        matrices = valid_poses(poses)
        return matrices, np.arange(len(matrices))
    matrices, faults = check_poses(poses)
    return matrices, np.delete(np.arange(len(matrices)), list(faults))


def _judge(observer: Observer, task: Task, poses: FloatArray, pose_ids: IntArray) -> Coverage:
    mesh, camera = observer.mesh, observer.camera
    seen = observer.observe(poses)
    shape = (len(poses), mesh.n_faces)
    values: dict[str, NDArray[Any]] = {n: np.zeros(shape, kind) for n, kind in FIGURES.items()}
    focus_limits = camera.depth_of_field(task.max_blur)
    for row, pose in enumerate(poses):
        for name, of_pose in _judge_pose(mesh, camera, task, focus_limits, pose, seen, row).items():
            values[name][row] = of_pose
    return Coverage(mesh, camera, task, observer.info, pose_ids, seen.clipped, **values)


def _judge_pose(
    mesh: Mesh,
    camera: Camera,
    task: Task,
    focus_limits: tuple[float, float],
    pose: FloatArray,
    seen: Observation,
    row: int,
) -> dict[str, NDArray[Any]]:
    """Every figure of one pose, by the names of `FIGURES`."""
    view = view_faces(mesh, camera, pose)
    visibility, bound, kind = figures(view, seen, row)
    drawn = seen.drawn_pixels[row]
    with np.errstate(over="ignore"):  # for the least R_min; sums over faces stay finite
        resolution = np.minimum(drawn / task.min_pixels, _LARGEST_RESOLUTION)
    focus = in_focus(view.depth, focus_limits, task.focus_rule)
    enough = resolution if not task.cap_resolution else np.minimum(resolution, 1.0)

    # The product of the criteria, one factor at a time: the reason is the first that brings it
    # below the threshold.
    no = np.zeros(mesh.n_faces)
    factors = (
        (Reason.DEGENERATE, ~mesh.degenerate_mask),
        (Reason.BACK_FACING, view.is_front),
        (Reason.OUTSIDE, view.in_view),
        (Reason.OUT_OF_FOCUS, focus),
        (Reason.UNSAMPLED, drawn > 0),
        (Reason.TOO_COARSE, np.where(view.pixel_density >= task.min_pixel_density, enough, no)),
        (Reason.OCCLUDED, np.where(visibility >= task.min_visibility, visibility, no)),
        (Reason.TOO_OBLIQUE, view.incidence <= math.radians(task.max_incidence_deg)),
    )
    product = np.ones(mesh.n_faces)
    reason = np.full(mesh.n_faces, Reason.COVERED, np.uint8)
    for name, factor in factors:
        product = product * factor
        fails = (product < task.min_coverage) | (product == 0)
        reason[fails & (reason == Reason.COVERED)] = name
    return {
        "in_view": view.in_view,
        "in_view_fraction": view.in_view_fraction,
        "projected_area": view.projected_area,
        "visible_pixels": seen.visible_pixels[row],
        "drawn_pixels": drawn,
        "resolution": resolution,
        "pixel_density": view.pixel_density,
        "in_focus": focus,
        "visibility": visibility,
        "visibility_bound": bound,
        "visibility_kind": kind,
        "incidence": view.incidence,
        "coverage": product,
        "reason": reason,
    }
