"""Distance of a face from the ideal pose of a frustum, after Alarcon.

The frustum between the depths z_n and z_f has a centre c_cam, the mean of its eight corners, and
three axes, from there to the middle of its far, right and lower side; they are the columns of its
tensor T. A face has its centroid c_face and its normal a_face; a_cam is the unit axis of depth.

    S   = (sum of sigma_i^p)^(1/p), sigma the singular values of T: its Schatten norm
    d_e = max(0, 1 - |c_cam - c_face| / S^q)
    d_r = max(0, 1 - |a_cam + a_face| / sqrt 2)
    C   = V F O sqrt(d_e d_r)

with V and F as in `scott`, and O = 0 where the segment from the centroid to the camera centre meets
another face. By default p = 2, the Frobenius norm, and q = 1.

J. L. Alarcon-Herrera. PhD dissertation, University of Windsor ([17] of the thesis).
J. L. Alarcon-Herrera, X. Chen, X. Zhang. Viewpoint Selection for Vision Systems in Industrial
Inspection. Proc. IEEE Int. Conf. on Robotics and Automation, 2014.

Caveats
-------
- Our source for the formula is secondary and has S^2 under the distance: a length over an area,
  whose value depends on the unit of length. In metres it is 0 for all of a small part, in
  millimetres 1. S^2 is also a notation of the Schatten class of order 2, whose norm has the right
  dimension; the defaults are therefore q = 1, p = 2. `norm_power=2` is the other reading.
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
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base.errors import ConfigError
from rastercov.base.memory import BoolArray, FloatArray
from rastercov.camera.camera import Camera
from rastercov.camera.projection import to_camera
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.reference.criteria import measured_geometry as face_geometry
from rastercov.reference.models.base import (
    Criteria,
    check_number,
    coverage_model,
    each_pose,
    in_view_and_focus,
    seen_normals,
)
from rastercov.reference.models.line_of_sight import LineOfSight, check_tracer


@dataclass(frozen=True, kw_only=True)
class AlarconParameters:
    """Frustum, norm and tracer of the model.

    Parameters
    ----------
    depth_range : (float, float), optional
        z_n and z_f of the frustum, metres; unless given, the depth of field, and the extent of the
        part where that has no limit.
    schatten_order : float
        p of the norm, 1 or more; inf is the longest axis.
    norm_power : float
        q, exponent of the norm by which the distance is divided.
    tracer : {"auto", "embree", "own"}
        Implementation that traces the segments, see `LineOfSight`.

    Raises
    ------
    ConfigError
        For a value outside its range.
    """

    depth_range: tuple[float, float] | None = None
    schatten_order: float = 2.0
    norm_power: float = 1.0
    tracer: str = "auto"

    def __post_init__(self) -> None:
        check_number("schatten_order", self.schatten_order, 1.0, math.inf, "1 or more")
        check_number("norm_power", self.norm_power, 0.0, 10.0, "0 to 10")
        if self.depth_range is not None:
            z_n, z_f = self.depth_range
            for depth in (z_n, z_f):
                check_number("depth_range", depth, 0.0, 1e300, "two depths in metres, 0 or more")
            if not z_n < z_f:
                raise ConfigError(f"depth_range must satisfy near < far, got {z_n:g} and {z_f:g}")
        check_tracer(self.tracer)


@coverage_model(
    AlarconParameters(),
    Criteria(
        field_of_view="yes",
        resolution="distance",
        focus="yes",
        occlusion="centroid",
        angle="graded",
    ),
    pinhole_because="its frustum has flat sides",
)
def coverage(
    mesh: Mesh, camera: Camera, poses: ArrayLike, task: Task, parameters: AlarconParameters
) -> FloatArray:
    """Coverage of each face in each pose, (P, F) in [0, 1].

    Depends on `max_blur` and `focus_rule` of the task.
    """
    limits = camera.depth_of_field(task.max_blur)
    tracer = LineOfSight(mesh, parameters.tracer)
    is_surface = ~mesh.target_mask

    def strength(pose: FloatArray, near: float) -> FloatArray:
        view = face_geometry(mesh, camera, pose)
        seen = in_view_and_focus(camera, task, view)
        if not seen.any():
            return np.zeros(mesh.n_faces)
        z_n, z_f = parameters.depth_range or _depths_in_focus(limits, view.depth, is_surface, near)
        centre, tensor = frustum(camera, z_n, z_f)
        size = schatten_norm(tensor, parameters.schatten_order) ** parameters.norm_power
        away = np.linalg.norm(to_camera(mesh.centroids, pose) - centre, axis=1)
        axis = centre / np.linalg.norm(centre)
        normals = seen_normals(mesh, pose)
        turned = np.linalg.norm(axis + normals, axis=1)
        d_e = np.maximum(0.0, 1 - away / size)
        d_r = np.maximum(0.0, 1 - turned / math.sqrt(2))
        graded = np.where(seen, np.sqrt(d_e * d_r), 0.0)
        wanted = np.flatnonzero(graded > 0)
        graded[wanted[tracer.hidden(mesh.centroids[wanted], pose, near)]] = 0.0
        return graded

    return each_pose(mesh, camera, poses, strength)


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


def schatten_norm(tensor: FloatArray, order: float) -> float:
    """(sum of sigma^p)^(1/p) over the singular values of a matrix; the greatest for p = inf."""
    values = np.linalg.svd(tensor, compute_uv=False)
    return float(np.linalg.norm(values, order))


def _depths_in_focus(
    limits: tuple[float, float], depth: FloatArray, is_surface: BoolArray, near: float
) -> tuple[float, float]:
    """Depth of field (z_n, z_f), clipped to the nearest and farthest vertex ahead, metres."""
    ahead = depth[is_surface][depth[is_surface] >= near]
    if not ahead.size:
        ahead = depth[depth >= near]
    return max(limits[0], float(ahead.min())), min(limits[1], float(ahead.max()))
