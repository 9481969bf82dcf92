"""Field of view, focus, resolution with its angle, and bivalent occlusion, after Zhang et al.

    V = 1 where all vertices are inside the image
    F = 1 where all vertices are within the depth of field
    R = mean over vertices of f cos(theta) / (z rho)
    O = 1 where no segment from a vertex to the camera centre meets another face
    C = V F O min(1, R / R_req)

with z the depth of a vertex, theta the angle between the normal and the reversed optical axis, f
the focal length and rho the larger side of a pixel: R is in pixels per length. R_req is in pixels
per metre, see `base.required_density`.

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

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import BoolArray, FloatArray
from rastercov.core.camera import Camera
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import Mesh
from rastercov.reference.coverage import depth_from_near
from rastercov.reference.models.base import ModelCriteria, ModelView, coverage_model, each_view


@coverage_model(
    ModelCriteria(
        field_of_view="image",
        resolution="px/m over the vertices, graded",
        focus="depth of field",
        occlusion="bivalent, all vertices",
        angle="part of resolution",
    ),
    pinhole_because="its resolution is that of a plane across the optical axis",
)
def coverage(view: ModelView) -> FloatArray:
    """Coverage of each face, (F,) in [0, 1].

    Depends on `min_pixels`, `min_pixel_density`, `max_blur` and `focus_rule` of the task.
    """
    # 0 for faces turned away from the optical axis.
    cosine = np.maximum(-view.normals[:, 2], 0.0)
    depth = view.faces.depth
    ahead: BoolArray = np.all(depth > 0, axis=1)
    nearness = (1.0 / np.where(ahead[:, None], depth, np.inf)).mean(axis=1)
    density = min(view.camera.fx, view.camera.fy) * cosine * nearness
    return view.share(density) * _unhidden(view, view.in_view_and_focus)


def visible(mesh: Mesh, camera: Camera, poses: ArrayLike) -> FloatArray:
    """Bivalent visibility alone, (P, F): 1 for front faces none of whose vertices are hidden.

    Without field of view, focus and resolution; 0 where a vertex lies before the near plane.
    """

    def strength(view: ModelView) -> FloatArray:
        ahead = depth_from_near(view.points, view.camera) >= view.near
        return _unhidden(view, view.faces.is_front & ahead[mesh.faces].all(axis=1))

    return each_view(mesh, camera, poses, Task(), strength)


def _unhidden(view: ModelView, chosen: BoolArray) -> FloatArray:
    """1 for chosen faces none of whose vertices are hidden, 0 for all others, (F,)."""
    is_seen: BoolArray = chosen & ~view.find_hidden(chosen).any(axis=1)
    return is_seen.astype(np.float64)
