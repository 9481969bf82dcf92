"""Common parts of the coverage models: the signature, the loop over poses, the required density.

Every model answers (P, F) for the same `Task`, so that models can be compared. A quantity that a
model needs and a task does not have, such as a density of pixels, is derived here from the task.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from inspect import cleandoc
from typing import Any, Protocol, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base.checks import shown
from rastercov.base.errors import ConfigError
from rastercov.base.memory import BoolArray, FloatArray, check_memory
from rastercov.camera.camera import Camera
from rastercov.camera.models import MODELS as LENSES
from rastercov.camera.near_plane import near_limit
from rastercov.camera.pose import valid_poses
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.reference.criteria import FaceGeometry, in_focus

P = TypeVar("P")
P_contra = TypeVar("P_contra", contravariant=True)


@dataclass(frozen=True, kw_only=True)
class Criteria:
    """Criteria of a model in a word or two each, empty for one that it does not have."""

    field_of_view: str = ""
    resolution: str = ""
    focus: str = ""
    occlusion: str = ""
    angle: str = ""


class CoverageModel(Protocol[P_contra]):
    """Signature of all models."""

    criteria: Criteria
    pinhole_because: str
    """Reason why it wants pinholes, or ""."""

    def __call__(
        self,
        mesh: Mesh,
        camera: Camera,
        poses: ArrayLike,
        task: Task | None = None,
        *,
        parameters: P_contra = ...,
    ) -> FloatArray:
        """Coverage of each face in each pose, (P, F)."""
        ...


def coverage_model(
    defaults: P, criteria: Criteria | None = None, *, pinhole_because: str = ""
) -> Callable[[Callable[[Mesh, Camera, ArrayLike, Task, P], FloatArray]], CoverageModel[P]]:
    """Decorator that gives `answers(mesh, camera, poses, task, parameters)` the public signature.

    Parameters
    ----------
    defaults : dataclass
        Parameters of the model unless a call gives others.
    criteria : Criteria, optional
        For the table of a comparison.
    pinhole_because : str
        Reason why the model wants pinholes; any lens is taken without one.
    """

    def decorate(
        answers: Callable[[Mesh, Camera, ArrayLike, Task, P], FloatArray],
    ) -> CoverageModel[P]:
        def coverage(
            mesh: Mesh,
            camera: Camera,
            poses: ArrayLike,
            task: Task | None = None,
            *,
            parameters: P = defaults,
        ) -> FloatArray:
            if pinhole_because and isinstance(camera, Camera):
                name = answers.__module__.rpartition(".")[2]
                camera.check_pinhole(
                    f"the model {name} wants a pinhole, because {pinhole_because}",
                    "take image_space, scott or mavrinac",
                )
            return answers(mesh, camera, poses, task or Task(), parameters)

        coverage.__doc__ = f"""{cleandoc(answers.__doc__ or "")}

Parameters
----------
mesh : Mesh
camera : Camera
poses : (P, 4, 4) array_like
    world_from_camera.
task : Task, optional
    Thresholds; `Task()` unless given.
parameters : {type(defaults).__name__}
    Quantities that a task does not have.

Raises
------
PoseError
    For a pose that is no rigid motion.
ResourceError
    Where the result takes more memory than is free.
"""
        for name in ("__module__", "__name__", "__qualname__"):
            setattr(coverage, name, getattr(answers, name))
        model = cast("CoverageModel[P]", coverage)
        model.criteria = criteria or Criteria()
        model.pinhole_because = pinhole_because
        return model

    return decorate


@dataclass(frozen=True, kw_only=True)
class ResolutionParameters:
    """Parameters of a model that divides a pixel density by a required one.

    Parameters
    ----------
    required_density : float, optional
        R_req, pixels a metre; by `required_density` from the task unless given.
    """

    required_density: float | None = None

    def __post_init__(self) -> None:
        if self.required_density is not None:
            words = "0 or more pixels a metre, or None for the task's"
            check_number("required_density", self.required_density, 0.0, 1e300, words)


def each_pose(
    mesh: Mesh,
    camera: Camera,
    poses: ArrayLike,
    strength: Callable[[FloatArray, float], FloatArray],
    shape: tuple[int, ...] = (),
) -> FloatArray:
    """`strength(pose, near)` of every pose, (P, F) or (P, *shape); near: depth of the near plane.

    Raises
    ------
    PoseError
        For a pose that is no rigid motion.
    ResourceError
        Where the array takes more memory than is free, before any is allocated.
    """
    matrices = valid_poses(poses)
    of_pose = shape or (mesh.n_faces,)
    check_memory(
        f"answers of {len(matrices):,} poses x {mesh.n_faces:,} faces",
        8 * len(matrices) * math.prod(of_pose),
        "take fewer poses at a time",
    )
    near = near_limit(camera, mesh.opaque.bounds, matrices)
    found = np.empty((len(matrices), *of_pose))
    for row, pose in enumerate(matrices):  # a few milliseconds for 10k faces
        found[row] = strength(pose, float(near[row]))
    return found


def required_density(mesh: Mesh, task: Task, density: float | None = None) -> FloatArray:
    """Pixels a metre that give a face resolution 1, (F,); inf for faces without area.

    The density at which a face seen head-on gets the R_min pixels of (3.8), sqrt(R_min / area), and
    at least `Task.min_pixel_density`; or the given `density` for all faces.
    """
    if density is not None:
        return np.full(mesh.n_faces, density)
    areas = np.asarray(mesh.areas)
    with np.errstate(divide="ignore"):
        needed: FloatArray = np.sqrt(task.min_pixels / areas)
    return np.maximum(needed, task.min_pixel_density)


def share_of(density: FloatArray, required: FloatArray) -> FloatArray:
    """min(1, density / required); 1 where nothing is required."""
    share = np.divide(density, required, out=np.ones_like(density), where=required > 0)
    return np.minimum(share, 1.0)


def in_view_and_focus(camera: Camera, task: Task, view: FaceGeometry) -> BoolArray:
    """(F,) front faces in the image (3.7) and within the depth of field (3.10)-(3.12)."""
    limits = camera.depth_of_field(task.max_blur)
    focused: BoolArray = in_focus(view.depth, limits, task.focus_rule)
    return view.is_front & view.in_view & focused


def facing_density(points: FloatArray, camera: Camera) -> FloatArray:
    """(...) pixels a metre along the worst direction of a surface that faces the camera.

    At points (..., 3) in camera axes: min(fx, fy) / z of a pinhole, and of other lenses the least
    singular value of the derivative of the image; 0 behind a pinhole, and outside the valid region.
    """
    if camera.is_pinhole:
        z = points[..., 2]
        return np.where(z > 0, min(camera.fx, camera.fy) / np.where(z > 0, z, 1.0), 0.0)
    from rastercov.camera.lenses.of_camera import lens_of

    slopes = lens_of(camera).jacobian(points)
    across, down = np.moveaxis(np.nan_to_num(slopes), -2, 0)
    a, b, c = (
        np.einsum("...i,...i->...", *pair)
        for pair in ((across, across), (down, down), (across, down))
    )
    greatest = np.sqrt((a + b + np.hypot(a - b, 2 * c)) / 2)
    product = np.linalg.norm(np.cross(across, down), axis=-1)  # of both singular values
    return np.divide(product, greatest, out=np.zeros_like(a), where=greatest > 0)


def focus_depth(points: FloatArray, camera: Camera) -> FloatArray:
    """(...) depth of points (..., 3) in camera axes that their sharpness depends on, metres.

    z for a lens with a plane in focus, the distance for others.
    """
    if LENSES[camera.model].is_planar:
        return points[..., 2]
    return np.linalg.norm(points, axis=-1)


def seen_normals(mesh: Mesh, pose: FloatArray) -> FloatArray:
    """Normals in camera axes, (F, 3); for two-sided groups the normal of the side that is seen."""
    ray = pose[:3, 3] - mesh.centroids
    is_back = mesh.two_sided_mask & (np.einsum("fi,fi->f", mesh.normals, ray) < 0)
    return np.where(is_back, -1.0, 1.0)[:, None] * (mesh.normals @ pose[:3, :3])


def ramp(value: FloatArray, acceptable: ArrayLike, ideal: ArrayLike) -> FloatArray:
    """1 up to the ideal value, 0 from the acceptable one on, linear between; lower is better.

    Equal limits make a step; a value equal to the limits is 1.
    """
    limit, best = np.broadcast_arrays(np.asarray(acceptable, np.float64), ideal)
    with np.errstate(invalid="ignore", divide="ignore"):
        between = np.clip((limit - value) / (limit - best), 0.0, 1.0)
    # Between a finite ideal value and no limit at all the line is flat.
    between = np.where(np.isinf(limit) & (limit > 0), 1.0, between)
    return np.where(value <= best, 1.0, np.where(value >= limit, 0.0, between))


def check_number(name: str, value: Any, low: float, high: float, words: str) -> None:
    """Raise `ConfigError` unless the value is a number from `low` to `high`, as `words` say."""
    is_number = isinstance(value, int | float | np.integer | np.floating)
    if isinstance(value, bool) or not is_number or not low <= value <= high or math.isnan(value):
        raise ConfigError(f"{name} must be {words}, got {shown(value)}")
