"""What the models of this package have in common: the requirement on resolution, and checks.

Every model answers (P, F) for the same `Task`, so that they can be laid side by side. Where a model
asks for a quantity that a task does not have, a density of pixels above all, it is worked out here
from what the task does have.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov._checks import shown
from rastercov._memory import check_memory
from rastercov.camera import Camera
from rastercov.coverage import Task
from rastercov.errors import ConfigError
from rastercov.mesh import Mesh
from rastercov.pose import valid_poses
from rastercov.projection import near_limit

FloatArray = NDArray[np.float64]


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
        Where the array takes more memory than is free, before any is taken.
    """
    matrices = valid_poses(poses)
    of_pose = shape or (mesh.n_faces,)
    check_memory(
        f"answers of {len(matrices):,} poses x {mesh.n_faces:,} faces",
        8 * len(matrices) * math.prod(of_pose),
        "take fewer poses at a time",
    )
    near = near_limit(camera, mesh.bounds, matrices)
    found = np.empty((len(matrices), *of_pose))
    for row, pose in enumerate(matrices):  # a few milliseconds for 10k faces
        found[row] = strength(pose, float(near[row]))
    return found


def required_density(mesh: Mesh, task: Task, density: float | None = None) -> FloatArray:
    """Pixels a metre that give a face resolution 1, (F,); inf for faces without area.

    The density at which a face seen head-on gets the R_min pixels of (3.8), sqrt(R_min / area), and
    at least `Task.min_pixel_density`; or the one given, for all faces.
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


def seen_normals(mesh: Mesh, pose: FloatArray) -> FloatArray:
    """Normals in camera axes, (F, 3); of two-sided groups that of the side that is seen."""
    ray = pose[:3, 3] - mesh.centroids
    is_back = mesh.two_sided_mask & (np.einsum("fi,fi->f", mesh.normals, ray) < 0)
    normals: FloatArray = np.where(is_back, -1.0, 1.0)[:, None] * (mesh.normals @ pose[:3, :3])
    return normals


def ramp(value: FloatArray, acceptable: ArrayLike, ideal: ArrayLike) -> FloatArray:
    """1 up to the ideal value, 0 from the acceptable one on, linear between; lower is better.

    Equal limits make a step, at which the value itself still counts as 1.
    """
    limit, best = np.broadcast_arrays(np.asarray(acceptable, np.float64), ideal)
    with np.errstate(invalid="ignore", divide="ignore"):
        between = np.clip((limit - value) / (limit - best), 0.0, 1.0)
    # From a finite ideal to no limit at all the line is flat.
    between = np.where(np.isinf(limit) & (limit > 0), 1.0, between)
    graded: FloatArray = np.where(value <= best, 1.0, np.where(value >= limit, 0.0, between))
    return graded


def check_number(name: str, value: Any, low: float, high: float, words: str) -> None:
    """Raise `ConfigError` unless the value is a number from `low` to `high`, as `words` say."""
    is_number = isinstance(value, int | float | np.integer | np.floating)
    if isinstance(value, bool) or not is_number or not low <= value <= high or math.isnan(value):
        raise ConfigError(f"{name} must be {words}, got {shown(value)}")


def check_density(name: str, value: float | None) -> None:
    """Raise `ConfigError` unless the value is None or a density of pixels."""
    if value is not None:
        check_number(name, value, 0.0, 1e300, "0 or more pixels a metre, or None for the task's")
