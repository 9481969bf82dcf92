"""Field of view, focus and resolution with its cosine, after Scott.

    V = 1 where all vertices are inside the image (3.7)
    F = 1 where all vertices are within the depth of field (3.10)-(3.12)
    R = f cos(theta) / z at the centroid, theta between the normal and the ray to the camera centre
    C = V F min(1, R / R_req)

with f the smaller of fx and fy, and R_req in pixels a metre, see `base.required_density`. Through
other lenses f / z is `base.facing_density`.

W. R. Scott. Model-based view planning. Machine Vision and Applications 20(1), 47-69, 2009.
W. R. Scott, G. Roth, J.-F. Rivest. View Planning for Automated Three-Dimensional Object
Reconstruction and Inspection. ACM Computing Surveys 35(1), 64-96, 2003.

Caveats
-------
- Scott plans for range sensors, and his measurability matrix is binary: a point is measured where
  sampling density and precision are sufficient. Here the density along the surface's worst
  direction is graded, for a plain camera and including the cosine; his precision is a property of
  triangulation and does not apply to one camera.
- The tables of the thesis (2.1, 3.1) mark no occlusion. His matrix excludes shadowed points, so the
  tables understate it; this file follows the tables.
- f cos(theta) / z is the density along the worst direction of a face on the optical axis; off it
  the exact one differs (`criteria.face_geometry` has it).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base.memory import FloatArray
from rastercov.camera.camera import Camera
from rastercov.camera.projection import to_camera
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.reference.criteria import measured_geometry as face_geometry
from rastercov.reference.models.base import (
    Criteria,
    ResolutionParameters,
    coverage_model,
    each_pose,
    facing_density,
    in_view_and_focus,
    required_density,
    share_of,
)


@dataclass(frozen=True, kw_only=True)
class ScottParameters(ResolutionParameters):
    """R_req of the model, applied to the worst direction on a face."""


@coverage_model(
    ScottParameters(),
    Criteria(field_of_view="yes", resolution="centroid", focus="yes", angle="in resolution"),
)
def coverage(
    mesh: Mesh, camera: Camera, poses: ArrayLike, task: Task, parameters: ScottParameters
) -> FloatArray:
    """Coverage of each face in each pose, (P, F) in [0, 1].

    Depends on `min_pixels`, `min_pixel_density`, `max_blur` and `focus_rule` of the task.
    """
    required = required_density(mesh, task, parameters.required_density)

    def strength(pose: FloatArray, near: float) -> FloatArray:
        view = face_geometry(mesh, camera, pose)
        seen = in_view_and_focus(camera, task, view)
        # A face of a two-sided group may be seen from either side.
        cosine = np.abs(np.cos(view.incidence))
        density = cosine * facing_density(to_camera(mesh.centroids, pose), camera)
        return np.where(seen, share_of(density, required), 0.0)

    return each_pose(mesh, camera, poses, strength)
