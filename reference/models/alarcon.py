"""Distance of a face from the ideal pose of a frustum, after Alarcon.

The frustum between the depths z_n and z_f has a centre c_cam, the mean of its eight corners, and
three axes, from there to the middle of its far, right and lower side; they are the columns of its
tensor T. A face has its centroid c_face and its normal a_face; a_cam is the unit axis of depth.

    S   = (sum of sigma_i^p)^(1/p), sigma the singular values of T: its Schatten norm
    d_e = max(0, 1 - |c_cam - c_face| / S^q)
    d_r = max(0, 1 - |a_cam + a_face| / sqrt 2)
    C   = V F O sqrt(d_e d_r)

with V and F as in `scott`, and O = 0 where the segment from the centroid to the camera centre meets
another face; p = 2, the Frobenius norm, and q = 1.

J. L. Alarcon-Herrera. PhD dissertation, University of Windsor ([17] of the thesis).
J. L. Alarcon-Herrera, X. Chen, X. Zhang. Viewpoint Selection for Vision Systems in Industrial
Inspection. Proc. IEEE Int. Conf. on Robotics and Automation, 2014.

Caveats
-------
- Our source for the formula is secondary and has S^2 under the distance: a length over an area,
  whose value depends on the unit of length. In metres it is 0 for all of a small part, in
  millimetres 1. S^2 is also a notation of the Schatten class of order 2, whose norm has the right
  dimension; therefore q = 1, p = 2 here.
- The thesis (2.2.4.1) mentions a Euclidean and a Frobenius norm between poses. The tensors of
  Adolphus, by the same author, weight one distance by the other and have no upper limit. The three
  sources give three formulas; this one is in [0, 1].
- Tables 2.1 and 3.1 mark occlusion as "self only", and Definition 3 calls a face self-occluding
  when it faces away. Here the segment of the centroid is also traced against all faces.
- d_r is measured along the optical axis, so a face seen from the front but off the axis can have 0.
  A face seen from behind is not covered whatever d_r is.
- The frustum ends at the limits of the depth of field. Where these are infinite, it ends at the
  nearest and farthest vertex: then the ideal distance is that of the centre of the part. Vertices
  of targets do not count, unless no other is ahead.
- The distance takes the place of the resolution of the tables: nearer than the ideal is as bad as
  farther. R_min and the density of a task have no effect.
"""

import math

import numpy as np

from rastercov.base import FloatArray
from rastercov.core.camera import Camera, to_camera
from rastercov.reference.models.base import ModelCriteria, ModelView, coverage_model


@coverage_model(
    ModelCriteria(
        field_of_view="image",
        resolution="distance from the frustum's centre, graded",
        focus="depth of field",
        occlusion="bivalent, centroid",
        angle="graded",
    ),
    pinhole_because="its frustum has flat sides",
)
def coverage(view: ModelView) -> FloatArray:
    """Coverage of each face, (F,) in [0, 1].

    Depends on `max_blur` and `focus_rule` of the task.
    """
    mesh = view.mesh
    seen = view.in_view_and_focus
    if not seen.any():
        return np.zeros(mesh.n_faces)
    centre, tensor = frustum(view.camera, *_depths(view))
    away = np.linalg.norm(to_camera(mesh.centroids, view.pose) - centre, axis=1)
    turned = np.linalg.norm(centre / np.linalg.norm(centre) + view.normals, axis=1)
    d_e = np.maximum(0.0, 1 - away / np.linalg.norm(tensor))
    d_r = np.maximum(0.0, 1 - turned / math.sqrt(2))
    graded = np.where(seen, np.sqrt(d_e * d_r), 0.0)
    wanted = np.flatnonzero(graded > 0)
    graded[wanted[view.hide_points(mesh.centroids[wanted])]] = 0.0
    return graded


def frustum(camera: Camera, z_n: float, z_f: float) -> tuple[FloatArray, FloatArray]:
    """Centre (3,) and tensor (3, 3) of the frustum between two depths, in camera axes, metres.

    The columns of the tensor are its half axes: depth, right, down.
    """
    sides = np.array(
        [
            (-camera.cx / camera.fx, (camera.width - camera.cx) / camera.fx),
            (-camera.cy / camera.fy, (camera.height - camera.cy) / camera.fy),
        ]
    )
    slopes = np.array([(x, y, 1.0) for x in sides[0] for y in sides[1]])
    corners = np.concatenate((z_n * slopes, z_f * slopes))
    centre = corners.mean(axis=0)
    by_end = corners.reshape(2, 2, 2, 3)  # by depth, x, y
    ends = (by_end[1], by_end[:, 1], by_end[:, :, 1])
    axes = [end.reshape(4, 3).mean(axis=0) - centre for end in ends]
    return centre, np.stack(axes, axis=1)


def _depths(view: ModelView) -> tuple[float, float]:
    """Depth of field (z_n, z_f), clipped to the nearest and farthest vertex ahead, metres."""
    z_n, z_f = view.camera.depth_of_field(view.task.max_blur)
    depth = view.faces.depth
    is_ahead = depth >= view.near
    of_surface = is_ahead & ~view.mesh.target_mask[:, None]
    ahead = depth[of_surface if of_surface.any() else is_ahead]
    return max(z_n, float(ahead.min())), min(z_f, float(ahead.max()))
