"""Field of view, focus and resolution with its cosine, after Scott.

    V = 1 where all vertices are inside the image (3.7)
    F = 1 where all vertices are within the depth of field (3.10)-(3.12)
    R = f cos(theta) / z at the centroid, theta between the normal and the ray to the camera centre
    C = V F min(1, R / R_req)

with f the smaller of fx and fy, and R_req in pixels a metre, see `shared.required_density`.

W. R. Scott. Model-based view planning. Machine Vision and Applications 20(1), 47-69, 2009.
W. R. Scott, G. Roth, J.-F. Rivest. View Planning for Automated Three-Dimensional Object
Reconstruction and Inspection. ACM Computing Surveys 35(1), 64-96, 2003.

Caveats
-------
- Scott plans for range sensors, and his measurability matrix is binary: a point is measured where
  sampling density and precision are good enough. What is graded here is the density along the
  surface's worst direction for a plain camera, with the cosine that is in it; his precision,
  a property of triangulation, has no meaning for one.
- The tables of the thesis (2.1, 3.1) mark no occlusion. His matrix does leave out what is shadowed,
  so they understate it; this file follows them.
- f cos(theta) / z is the density along the worst direction of a face on the optical axis; off it
  the exact one differs (`criteria.view_faces` has it).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.camera import Camera
from rastercov.coverage import Task
from rastercov.criteria import in_focus, view_faces
from rastercov.mesh import Mesh
from rastercov.models.base import check_density, each_pose, required_density, share_of

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ScottParameters:
    """What the model asks beyond a task.

    Parameters
    ----------
    required_density : float, optional
        R_req, pixels a metre; the task's unless given.
    """

    required_density: float | None = None

    def __post_init__(self) -> None:
        check_density("required_density", self.required_density)


def coverage(
    mesh: Mesh,
    camera: Camera,
    poses: ArrayLike,
    task: Task | None = None,
    *,
    parameters: ScottParameters = ScottParameters(),
) -> FloatArray:
    """Coverage of each face in each pose, (P, F) in [0, 1].

    Parameters
    ----------
    mesh, camera
        What is looked at, and by what.
    poses : (P, 4, 4) array_like
        world_from_camera.
    task : Task, optional
        Its `min_pixels`, `min_pixel_density`, `max_blur` and `focus_rule` count here.
    parameters : ScottParameters
        What a task does not say.
    """
    task = task or Task()
    required = required_density(mesh, task, parameters.required_density)
    limits = camera.depth_of_field(task.max_blur)

    def strength(pose: FloatArray, near: float) -> FloatArray:
        view = view_faces(mesh, camera, pose)
        seen = view.is_front & view.in_view & in_focus(view.depth, limits, task.focus_rule)
        depth = np.where(seen, view.depth.mean(axis=1), 1.0)
        # A face of a two-sided group is seen from either side.
        cosine = np.abs(np.cos(view.incidence))
        density = min(camera.fx, camera.fy) * cosine / depth
        return np.where(seen, share_of(density, required), 0.0)

    return each_pose(mesh, camera, poses, strength)
