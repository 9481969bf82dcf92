"""Common parts of the coverage models: the signature, the view of a pose, the required density.

Every model answers (P, F) for the same `Task`, so that models can be compared. A quantity that a
model needs and a task does not have, such as a density of pixels, is derived here from the task.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import BoolArray, FloatArray, check_memory
from rastercov.core.camera import Camera, near_limit, to_camera, valid_poses
from rastercov.core.camera.models import MODELS as LENSES
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import Mesh
from rastercov.reference.coverage import FaceGeometry, in_focus, measure_geometry
from rastercov.reference.models.line_of_sight import LineOfSight


@dataclass(frozen=True, kw_only=True)
class ModelCriteria:
    """Criteria of a model in a word or two each, empty for one that it does not have."""

    field_of_view: str = ""
    resolution: str = ""
    focus: str = ""
    occlusion: str = ""
    angle: str = ""


@dataclass(frozen=True)
class ModelView:
    """A scene as one pose has it, for a model."""

    mesh: Mesh
    camera: Camera
    task: Task
    sight: LineOfSight
    pose: FloatArray  # world_from_camera, (4, 4)
    near: float  # depth of the near plane, metres

    @cached_property
    def faces(self) -> FaceGeometry:
        """Geometry of every face."""
        return measure_geometry(self.mesh, self.camera, self.pose)

    @cached_property
    def points(self) -> FloatArray:
        """Vertices in camera axes, (V, 3)."""
        return to_camera(self.mesh.vertices, self.pose)

    @property
    def in_view_and_focus(self) -> BoolArray:
        """(F,) front faces in the image (3.7) and within the depth of field (3.10)-(3.12)."""
        limits = self.camera.depth_of_field(self.task.max_blur)
        focused: BoolArray = in_focus(self.faces, limits, self.task.focus_rule)
        return self.faces.is_front & self.faces.in_view & focused

    @property
    def normals(self) -> FloatArray:
        """Normals in camera axes, (F, 3); for two-sided groups that of the side that is seen."""
        mesh = self.mesh
        ray = self.pose[:3, 3] - mesh.centroids
        is_back = mesh.two_sided_mask & (np.einsum("fi,fi->f", mesh.normals, ray) < 0)
        return np.where(is_back, -1.0, 1.0)[:, None] * (mesh.normals @ self.pose[:3, :3])

    def find_hidden(self, wanted: BoolArray) -> BoolArray:
        """(F, 3) corners at hidden vertices; only those of wanted corners, (F,) or (F, 3)."""
        vertices = np.unique(self.mesh.faces[wanted])
        hidden = np.zeros(self.mesh.n_vertices, bool)
        hidden[vertices] = self.hide_points(self.mesh.vertices[vertices])
        return hidden[self.mesh.faces]

    def hide_points(self, points: FloatArray) -> BoolArray:
        """(N,) world points, (N, 3), with a face between them and the camera centre."""
        return self.sight.find_hidden(points, self.pose, self.near, self.camera)

    def share(self, density: FloatArray) -> FloatArray:
        """min(1, density / required); 1 where nothing is required."""
        required = required_density(self.mesh, self.task)
        share = np.divide(density, required, out=np.ones_like(density), where=required > 0)
        return np.minimum(share, 1.0)


@dataclass(frozen=True)
class CoverageModel:
    """Coverage of each face in each pose by a function of one view."""

    name: str
    strength: Callable[[ModelView], FloatArray]
    criteria: ModelCriteria
    pinhole_because: str
    """Reason why it needs a pinhole, or ""."""

    def __call__(
        self, mesh: Mesh, camera: Camera, poses: ArrayLike, task: Task | None = None
    ) -> FloatArray:
        """Coverage of each face in each pose, (P, F).

        Parameters
        ----------
        mesh, camera
            Scene and camera.
        poses : (P, 4, 4) array_like
            world_from_camera.
        task : Task, optional
            Thresholds; `Task()` unless given.

        Raises
        ------
        CameraError
            For another lens if the model needs a pinhole, and for parallel rays.
        PoseError
            For a pose that is not a rigid transform.
        ResourceError
            Where the result takes more memory than is free.
        """
        if self.pinhole_because and isinstance(camera, Camera):
            camera.check_pinhole(
                f"expected a pinhole for model {self.name}, because {self.pinhole_because}",
                "use image_space, scott or mavrinac",
            )
        camera.check_central("a coverage model")
        return each_view(mesh, camera, poses, task or Task(), self.strength)


def coverage_model(
    criteria: ModelCriteria, *, pinhole_because: str = ""
) -> Callable[[Callable[[ModelView], FloatArray]], CoverageModel]:
    """Decorator that makes a model, named after its module, of its strength in a view, (F,)."""

    def decorate(strength: Callable[[ModelView], FloatArray]) -> CoverageModel:
        name = strength.__module__.rpartition(".")[2]
        return CoverageModel(name, strength, criteria, pinhole_because)

    return decorate


def each_view(
    mesh: Mesh,
    camera: Camera,
    poses: ArrayLike,
    task: Task,
    strength: Callable[[ModelView], FloatArray],
) -> FloatArray:
    """`strength` of the view of every pose, (P, F)."""
    matrices = valid_poses(poses)
    check_memory(
        f"answers of {len(matrices):,} poses x {mesh.n_faces:,} faces",
        8 * len(matrices) * mesh.n_faces,
        "use fewer poses at a time",
    )
    near = near_limit(camera, mesh.opaque.bounds, matrices)
    sight = LineOfSight(mesh)
    result = np.empty((len(matrices), mesh.n_faces))
    for row, pose in enumerate(matrices):  # a few milliseconds for 10k faces
        result[row] = strength(ModelView(mesh, camera, task, sight, pose, float(near[row])))
    return result


def required_density(mesh: Mesh, task: Task) -> FloatArray:
    """Pixels per metre that give a face resolution 1, (F,); inf for faces without area.

    The density at which a face seen head-on gets the R_min pixels of (3.8), sqrt(R_min / area), and
    at least `Task.min_pixel_density`.
    """
    with np.errstate(divide="ignore"):
        needed: FloatArray = np.sqrt(task.min_pixels / np.asarray(mesh.areas))
    return np.maximum(needed, task.min_pixel_density)


def facing_density(points: FloatArray, camera: Camera) -> FloatArray:
    """(...) pixels per metre along the worst direction of a surface that faces the camera.

    At points (..., 3) in camera axes: min(fx, fy) / z of a pinhole, and of other lenses the least
    singular value of the derivative of the image; 0 behind a pinhole, and outside the valid region.
    """
    if camera.is_pinhole:
        z = points[..., 2]
        return np.where(z > 0, min(camera.fx, camera.fy) / np.where(z > 0, z, 1.0), 0.0)
    from rastercov.core.camera.lenses.of_camera import lens_of

    slopes = np.nan_to_num(lens_of(camera).jacobian(points))
    return np.asarray(np.linalg.svd(slopes, compute_uv=False)[..., 1], np.float64)


def focus_depth(points: FloatArray, camera: Camera) -> FloatArray:
    """(...) depth of points (..., 3) in camera axes that their sharpness depends on, metres.

    z for a lens with a plane in focus, the distance for others.
    """
    if LENSES[camera.model].is_planar:
        return points[..., 2]
    return np.linalg.norm(points, axis=-1)


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
