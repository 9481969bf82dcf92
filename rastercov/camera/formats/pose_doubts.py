"""Poses that were probably given in another convention: they look away from the mesh.

A pose file of bare matrices does not state its convention. Where few cameras have a part of
the mesh in their images, and nearly all would in another convention, a line names that one.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.camera.camera import Camera
from rastercov.camera.formats.conventions import OPENGL_AXES, POSE_CONVENTIONS
from rastercov.camera.models import MODELS
from rastercov.camera.pose import Poses, inverse
from rastercov.camera.projection import to_camera, to_image
from rastercov.camera.rig import Cameras, cameras_of
from rastercov.mesh import Mesh

FloatArray = NDArray[np.float64]

MOST_SHARE_GIVEN = 0.5
"""Share of the poses that look at the mesh above which nothing is doubted; a third do by chance."""
LEAST_SHARE_OTHERWISE = 0.9
"""Share of the poses that must look at it in another convention."""
MOST_POSES, MOST_POINTS = 100, 500
"""Poses and vertices that are looked at, spread evenly: about 5 ms."""


def convention_doubts(mesh: Mesh, camera: Cameras, poses: ArrayLike | Poses) -> list[str]:
    """A line where the poses look away from the mesh and would not in another convention.

    Parameters
    ----------
    mesh : Mesh
        The scene.
    camera : Camera, or several
        Its image is what a part of the mesh must be in.
    poses : (P, 4, 4) array_like, or Poses
        world_from_camera as it was taken.
    """
    placed, cameras = Poses.of(poses), cameras_of(camera)
    if not len(placed):
        return []
    rows = np.linspace(0, len(placed) - 1, min(len(placed), MOST_POSES)).astype(np.int64)
    own = [cameras[index] for index in placed.camera[rows]]
    matrices = placed.world_from_camera[rows]
    used = np.unique(mesh.faces)
    points = mesh.vertices[used[:: max(1, len(used) // MOST_POINTS)]]
    seen = _looking(points, own, matrices)
    if seen > MOST_SHARE_GIVEN * len(rows):
        return []
    found = {}
    for name, (has_opengl_axes, is_inverse) in POSE_CONVENTIONS.items():
        taken = inverse(matrices) if is_inverse else matrices
        found[name] = _looking(points, own, taken @ OPENGL_AXES if has_opengl_axes else taken)
    name = max(found, key=found.__getitem__)
    if found[name] < LEAST_SHARE_OTHERWISE * len(rows):
        return []
    return [
        f"{seen} of {len(rows)} cameras look at the mesh, and {found[name]} would if the poses are "
        f"in another convention: --pose-convention {name}?"
    ]


def _looking(points: FloatArray, cameras: Sequence[Camera], poses: FloatArray) -> int:
    """Number of poses with a point in the image; in front, for a lens that is no plane."""
    count = 0
    for pose, camera in zip(poses, cameras, strict=True):  # 100 at most
        inside = to_camera(points, pose)
        ahead = inside[inside[:, 2] > 0]
        if MODELS[camera.model].is_planar:
            with np.errstate(all="ignore"):
                pixels = to_image(ahead, camera)
            ahead = ahead[((pixels >= 0) & (pixels <= (camera.width, camera.height))).all(axis=1)]
        count += len(ahead) > 0
    return count
