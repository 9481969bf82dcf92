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
- We had the formula at second hand, with S^2 under the distance: a length over an area, whose value
  hangs on the unit of length. In metres it is 0 for all of a small part, in millimetres 1. S^2 is
  also how the Schatten class of order 2 is written, and its norm has the right dimension; so the
  default is q = 1, p = 2. `norm_power=2` is the other reading.
- The thesis (2.2.4.1) tells of a Euclidean and a Frobenius norm between poses. The tensors of
  Adolphus, by the same author, weigh the one distance by the other and have no upper limit. Three
  sources, three formulas; this one is in [0, 1].
- Tables 2.1 and 3.1 mark occlusion as "self only", and Definition 3 calls a face self-occluding
  when it faces away. Here the segment of the centroid is traced, too, against all faces.
- d_r looks along the optical axis, so that a face seen from the front off the axis can have 0. A
  face seen from behind is not covered whatever it says.
- The frustum ends where the depth of field does. Where that is open, it ends where the part does,
  nearest and farthest vertex: then the ideal distance is that of the middle of the part.
- What the tables call resolution is the distance: nearer than the ideal is as bad as farther. R_min
  and the density of a task have no part in it.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.camera import Camera
from rastercov.coverage import Task
from rastercov.criteria import in_focus, view_faces
from rastercov.errors import ConfigError
from rastercov.mesh import Mesh
from rastercov.models.base import check_number, each_pose, seen_normals
from rastercov.models.line_of_sight import LineOfSight, check_tracer
from rastercov.projection import to_camera

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class AlarconParameters:
    """What the model asks beyond a task.

    Parameters
    ----------
    depth_range : (float, float), optional
        z_n and z_f of the frustum, metres; the depth of field, and the part where that is open,
        unless given.
    schatten_order : float
        p of the norm, 1 or more; inf is the longest axis.
    norm_power : float
        q, the power of the norm that the distance is divided by.
    tracer : {"auto", "embree", "own"}
        Who traces the segments, see `LineOfSight`.

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


def coverage(
    mesh: Mesh,
    camera: Camera,
    poses: ArrayLike,
    task: Task | None = None,
    *,
    parameters: AlarconParameters = AlarconParameters(),
) -> FloatArray:
    """Coverage of each face in each pose, (P, F) in [0, 1].

    Parameters
    ----------
    mesh, camera
        What is looked at, and by what.
    poses : (P, 4, 4) array_like
        world_from_camera.
    task : Task, optional
        Its `max_blur` and `focus_rule` count here.
    parameters : AlarconParameters
        What a task does not say.
    """
    task = task or Task()
    limits = camera.depth_of_field(task.max_blur)
    sight = LineOfSight(mesh, parameters.tracer)

    def strength(pose: FloatArray, near: float) -> FloatArray:
        view = view_faces(mesh, camera, pose)
        seen = view.is_front & view.in_view & in_focus(view.depth, limits, task.focus_rule)
        if not seen.any():
            return np.zeros(mesh.n_faces)
        z_n, z_f = parameters.depth_range or _part_of(limits, view.depth, near)
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
        graded[wanted[sight.hidden(mesh.centroids[wanted], pose, near)]] = 0.0
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
    right, lower = slopes[:, 0] == sides[0, 1], slopes[:, 1] == sides[1, 1]
    far, right, lower = (
        np.repeat((False, True), 4),
        np.concatenate((right, right)),
        np.concatenate((lower, lower)),
    )
    axes = [corners[side].mean(axis=0) - centre for side in (far, right, lower)]
    return centre, np.stack(axes, axis=1)


def schatten_norm(tensor: FloatArray, order: float) -> float:
    """(sum of sigma^p)^(1/p) over the singular values of a matrix; the greatest for p = inf."""
    values = np.linalg.svd(tensor, compute_uv=False)
    return float(np.linalg.norm(values, order))


def _part_of(limits: tuple[float, float], depth: FloatArray, near: float) -> tuple[float, float]:
    """Depths where the depth of field ends, or the part where it does so first."""
    ahead = depth[depth >= near]
    return max(limits[0], float(ahead.min())), min(limits[1], float(ahead.max()))
