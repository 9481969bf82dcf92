"""Field of view, focus, resolution with its angle, and bivalent occlusion, after Zhang et al.

    V = 1 where all vertices are inside the image
    F = 1 where all vertices are within the depth of field
    R = mean over vertices of f cos(theta) / (z rho)
    O = 1 where no segment from a vertex to the camera centre meets another face
    C = V F O min(1, R / R_req)

with z the depth of a vertex, theta the angle between the normal and the reversed optical axis, f
the focal length and rho the larger side of a pixel: R is in pixels per length. R_req is in pixels a
metre, see `base.required_density`.

X. Zhang et al. Coverage optimization of visual sensor networks for observing 3-D objects: survey
and comparison. International Journal of Intelligent Robotics and Applications, 2019. doi
10.1007/s41315-019-00102-6. ([21] of the thesis, compared with in chapter 4.)
X. Zhang, X. Chen, J. L. Alarcon-Herrera, Y. Fang. 3-D Model-Based Multi-Camera Deployment: A
Recursive Convex Optimization Approach. IEEE/ASME Transactions on Mechatronics 20(6), 3157-3169,
2015. ([22]: resolution.)

Caveats
-------
- The test is bivalent: a face with one hidden vertex is hidden, and a face whose centre is hidden
  but none of its vertices is fully visible. Figures 4.2 to 4.6 of the thesis show such faces.
- The papers do not define the intersection of a segment with the faces that share its start vertex.
  These faces hide nothing here, see `line_of_sight`. Taken literally, every face of a mesh would be
  hidden by its neighbours.
- The angle is measured to the optical axis, as the thesis reports (2.2.4.2, 2.2.4.4). Away from the
  centre of the image it differs from the angle of incidence; a face seen from behind is not covered
  whatever this angle is.
- Zhang et al. maximise resolution in pixels per length, without a limit. For comparison with the
  other models it is divided by the required density and capped at 1, as in (3.8).
- There is no separate limit on the angle: `Task.max_incidence_deg` has no effect.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base.memory import BoolArray, FloatArray
from rastercov.camera.camera import Camera
from rastercov.camera.projection import to_camera
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.reference.criteria import FaceGeometry, depth_from_near
from rastercov.reference.criteria import measured_geometry as face_geometry
from rastercov.reference.models.base import (
    Criteria,
    ResolutionParameters,
    coverage_model,
    each_pose,
    in_view_and_focus,
    required_density,
    seen_normals,
    share_of,
)
from rastercov.reference.models.line_of_sight import LineOfSight, check_tracer


@dataclass(frozen=True, kw_only=True)
class ZhangParameters(ResolutionParameters):
    """R_req of the model, and the tracer of its segments.

    Parameters
    ----------
    tracer : {"auto", "embree", "own"}
        Implementation that traces the segments, see `LineOfSight`.
    """

    tracer: str = "auto"

    def __post_init__(self) -> None:
        super().__post_init__()
        check_tracer(self.tracer)


@coverage_model(
    ZhangParameters(),
    Criteria(
        field_of_view="yes",
        resolution="graded",
        focus="yes",
        occlusion="vertices",
        angle="in resolution",
    ),
    pinhole_because="its resolution is that of a plane across the optical axis",
)
def coverage(
    mesh: Mesh, camera: Camera, poses: ArrayLike, task: Task, parameters: ZhangParameters
) -> FloatArray:
    """Coverage of each face in each pose, (P, F) in [0, 1].

    Depends on `min_pixels`, `min_pixel_density`, `max_blur` and `focus_rule` of the task.
    """
    required = required_density(mesh, task, parameters.required_density)
    tracer = LineOfSight(mesh, parameters.tracer)

    def strength(pose: FloatArray, near: float) -> FloatArray:
        view = face_geometry(mesh, camera, pose)
        graded = share_of(_resolution(mesh, camera, pose, view), required)
        seen = in_view_and_focus(camera, task, view)
        return graded * _unhidden(mesh, tracer, camera, pose, near, seen)

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
    tracer = LineOfSight(mesh, parameters.tracer)

    def strength(pose: FloatArray, near: float) -> FloatArray:
        view = face_geometry(mesh, camera, pose)
        depth = depth_from_near(to_camera(mesh.vertices, pose), camera)
        ahead = view.is_front & (depth[mesh.faces] >= near).all(axis=1)
        return _unhidden(mesh, tracer, camera, pose, near, ahead)

    return each_pose(mesh, camera, poses, strength)


def _resolution(mesh: Mesh, camera: Camera, pose: FloatArray, view: FaceGeometry) -> FloatArray:
    """R in pixels a metre, (F,); 0 for faces turned away from the optical axis."""
    cosine = np.maximum(-seen_normals(mesh, pose)[:, 2], 0.0)
    ahead: BoolArray = np.all(view.depth > 0, axis=1)
    nearness = (1.0 / np.where(ahead[:, None], view.depth, np.inf)).mean(axis=1)
    return min(camera.fx, camera.fy) * cosine * nearness


def _unhidden(
    mesh: Mesh,
    tracer: LineOfSight,
    camera: Camera,
    pose: FloatArray,
    near: float,
    chosen: BoolArray,
) -> FloatArray:
    """1 for chosen faces none of whose vertices are hidden, 0 for all others, (F,)."""
    is_seen: BoolArray = chosen & ~tracer.hides(mesh, chosen, pose, near, camera).any(axis=1)
    return is_seen.astype(np.float64)
