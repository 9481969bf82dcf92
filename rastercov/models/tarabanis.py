"""Field of view and resolution, after Tarabanis et al.

    V = 1 where |x| <= t z and |y| <= t z at every vertex, t the tangent of half the smaller angle
    R = min over edges AB of w(AB) / |AB|,   w(AB) = f |((A - o) x u) x v| / ((A - o).v (B - o).v)
    C = V min(1, R / R_req)

with o the camera centre, v the optical axis, u the direction of the edge, and w the length of the
edge in the image, in pixels. Reckoned here as the distance of its end points in the image, which is
the same. R_req is what the task asks for, see `shared.required_density`.

K. A. Tarabanis, R. Y. Tsai, P. K. Allen. The MVP Sensor Planning System for Robotic Vision Tasks.
IEEE Transactions on Robotics and Automation 11(1), 72-85, 1995.
K. A. Tarabanis, P. K. Allen, R. Y. Tsai. A Survey of Sensor Planning in Computer Vision. The same,
86-104, 1995.

Caveats
-------
- The tables of the thesis (2.1, 3.1) mark field of view and resolution only, and this file follows
  them. The MVP system itself plans for focus and for occlusion, too; so the tables understate it.
- In its papers resolution is a constraint, met or not, on edges that somebody chose. It is graded
  here, because the tables say so, and asked of all three edges of a face.
- The field of view is the pyramid of the smaller angle of view (thesis, 2.2.4.1), so a face at the
  long sides of the image is outside. With a principal point off the centre it is the widest such
  pyramid within the image.
- A face seen from behind is not covered: ours; the tables mark no criterion that would say so.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.camera import Camera
from rastercov.coverage import Task
from rastercov.criteria import view_faces
from rastercov.mesh import Mesh
from rastercov.models.base import check_density, each_pose, required_density, share_of
from rastercov.projection import to_camera, to_image

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class TarabanisParameters:
    """What the model asks beyond a task.

    Parameters
    ----------
    required_density : float, optional
        R_req, pixels a metre along an edge; the task's unless given.
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
    parameters: TarabanisParameters = TarabanisParameters(),
) -> FloatArray:
    """Coverage of each face in each pose, (P, F) in [0, 1].

    Parameters
    ----------
    mesh, camera
        What is looked at, and by what.
    poses : (P, 4, 4) array_like
        world_from_camera.
    task : Task, optional
        Its `min_pixels` and `min_pixel_density` count here.
    parameters : TarabanisParameters
        What a task does not say.
    """
    required = required_density(mesh, task or Task(), parameters.required_density)
    slope = min(
        min(camera.cx, camera.width - camera.cx) / camera.fx,
        min(camera.cy, camera.height - camera.cy) / camera.fy,
    )

    def strength(pose: FloatArray, near: float) -> FloatArray:
        points = to_camera(mesh.vertices, pose)
        within = np.abs(points[:, :2]).max(axis=1) <= slope * points[:, 2]
        within &= points[:, 2] >= near
        seen = view_faces(mesh, camera, pose).is_front & within[mesh.faces].all(axis=1)
        safe = np.where((points[:, 2] >= near)[:, None], points, (0.0, 0.0, 1.0))
        image = to_image(safe, camera)[mesh.faces]
        corners = points[mesh.faces]
        length = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        pixels = np.linalg.norm(np.roll(image, -1, axis=1) - image, axis=2)
        density = np.divide(pixels, length, out=np.zeros_like(pixels), where=length > 0)
        return np.where(seen, share_of(density.min(axis=1), required), 0.0)

    return each_pose(mesh, camera, poses, strength)
