"""Field of view, focus, resolution with its angle, and bivalent occlusion, after Zhang et al.

    V = 1 where all vertices are inside the image
    F = 1 where all vertices are within the depth of field
    R = mean over vertices of f cos(theta) / (z rho)
    O = 1 where no segment from a vertex to the camera centre meets another face
    C = V F O min(1, R / R_req)

with z the depth of a vertex, theta the angle between the normal and the reversed optical axis, f
the focal length and rho the larger side of a pixel: R is in pixels per length. R_req is in pixels a
metre, see `shared.required_density`.

X. Zhang et al. Coverage optimization of visual sensor networks for observing 3-D objects: survey
and comparison. International Journal of Intelligent Robotics and Applications, 2019. doi
10.1007/s41315-019-00102-6. ([21] of the thesis, and its rival in chapter 4.)
X. Zhang, X. Chen, J. L. Alarcon-Herrera, Y. Fang. 3-D Model-Based Multi-Camera Deployment: A
Recursive Convex Optimization Approach. IEEE/ASME Transactions on Mechatronics 20(6), 3157-3169,
2015. ([22]: resolution.)

Caveats
-------
- The bivalent test says what its words say: a face of which a speck hides one vertex is hidden, a
  face whose middle is hidden but no vertex is seen whole. Figures 4.2 to 4.6 of the thesis are
  about this.
- The papers leave open what a segment does at the vertex it starts from, where all the faces around
  it meet it. They hide nothing here: see `occlusion`. Read to the letter every face of a mesh would
  be hidden by its neighbours.
- The angle is taken to the optical axis, as the thesis reports (2.2.4.2, 2.2.4.4). Away from the
  middle of the image that is not the angle at which the face is seen; a face seen from behind is
  not covered whatever it says.
- Resolution is what Zhang et al. maximise, in pixels per length, without a limit. To compare it
  with the others it is divided by what the task asks for and capped at 1, as (3.8) is.
- There is no separate limit on the angle: `Task.max_incidence_deg` has no part in it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.camera import Camera
from rastercov.coverage import Task
from rastercov.criteria import ViewOfFaces, in_focus, view_faces
from rastercov.mesh import Mesh
from rastercov.models.base import (
    check_density,
    each_pose,
    required_density,
    seen_normals,
    share_of,
)
from rastercov.models.line_of_sight import LineOfSight, check_tracer

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class ZhangParameters:
    """What the model asks beyond a task.

    Parameters
    ----------
    required_density : float, optional
        R_req, pixels a metre; the task's unless given.
    tracer : {"auto", "embree", "own"}
        Who traces the segments, see `LineOfSight`.
    """

    required_density: float | None = None
    tracer: str = "auto"

    def __post_init__(self) -> None:
        check_density("required_density", self.required_density)
        check_tracer(self.tracer)


def coverage(
    mesh: Mesh,
    camera: Camera,
    poses: ArrayLike,
    task: Task | None = None,
    *,
    parameters: ZhangParameters = ZhangParameters(),
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
    parameters : ZhangParameters
        What a task does not say.
    """
    task = task or Task()
    required = required_density(mesh, task, parameters.required_density)
    limits = camera.depth_of_field(task.max_blur)
    sight = LineOfSight(mesh, parameters.tracer)

    def strength(pose: FloatArray, near: float) -> FloatArray:
        view = view_faces(mesh, camera, pose)
        seen = view.is_front & view.in_view & in_focus(view.depth, limits, task.focus_rule)
        graded = share_of(_resolution(mesh, camera, pose, view), required)
        return graded * _unhidden(mesh, sight, pose, near, seen)

    return each_pose(mesh, camera, poses, strength)


def visible(
    mesh: Mesh,
    camera: Camera,
    poses: ArrayLike,
    *,
    parameters: ZhangParameters = ZhangParameters(),
) -> FloatArray:
    """Bivalent visibility alone, (P, F): 1 for front faces none of whose vertices are hidden.

    Without field of view, focus and resolution; 0 where a vertex lies before the near plane.
    """
    sight = LineOfSight(mesh, parameters.tracer)

    def strength(pose: FloatArray, near: float) -> FloatArray:
        view = view_faces(mesh, camera, pose)
        ahead = view.is_front & (view.depth >= near).all(axis=1)
        return _unhidden(mesh, sight, pose, near, ahead)

    return each_pose(mesh, camera, poses, strength)


def _resolution(mesh: Mesh, camera: Camera, pose: FloatArray, view: ViewOfFaces) -> FloatArray:
    """R in pixels a metre, (F,); 0 for faces turned away from the optical axis."""
    cosine = -seen_normals(mesh, pose)[:, 2]
    cosine = np.maximum(cosine, 0.0)
    ahead: BoolArray = np.all(view.depth > 0, axis=1)
    nearness = (1.0 / np.where(ahead[:, None], view.depth, np.inf)).mean(axis=1)
    resolution: FloatArray = min(camera.fx, camera.fy) * cosine * nearness
    return resolution


def _unhidden(
    mesh: Mesh, sight: LineOfSight, pose: FloatArray, near: float, chosen: BoolArray
) -> FloatArray:
    """1 for chosen faces none of whose vertices are hidden, 0 for all others, (F,)."""
    wanted = np.unique(mesh.faces[chosen])
    hidden = np.zeros(mesh.n_vertices, dtype=bool)
    hidden[wanted] = sight.hidden(mesh.vertices[wanted], pose, near)
    unhidden: FloatArray = (chosen & ~np.any(hidden[mesh.faces], axis=1)).astype(np.float64)
    return unhidden
