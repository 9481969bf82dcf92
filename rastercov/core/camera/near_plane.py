"""Near plane: its depth, what it cuts away, and when back faces may be culled.

Surfaces nearer than `near_limit` are cut away by every method. Targets hide nothing, so they change
none of this: all is decided by the other faces, `Mesh.opaque`. Where nothing in view is cut and the
camera is outside a closed mesh, faces seen from behind cannot be the nearest surface. The engine
decides, see `engine/solver/limits.hpp`, of cameras as it takes them: pinholes, parallel rays, and
lenses with ideal planes.
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from rastercov.base import BoolArray, FloatArray, read_only
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.pose import Poses
from rastercov.core.mesh import Mesh
from rastercov.engine import camera_pose, solver_visibility

NEAR_TO_FAR = camera_pose.NEAR_TO_FAR
"""Least depth that is seen, relative to the farthest depth, whatever `Camera.near` is."""


@lru_cache(maxsize=8)
def engine_camera(camera: Camera) -> solver_visibility.Camera:
    """Camera for the solvers of the engine; that of a lens takes seconds the first time."""
    kind = float(camera.near), camera.is_parallel
    own = solver_visibility.Camera(pinhole_numbers(camera), *kind)
    if camera.is_curved:
        from rastercov.core.camera.lenses.of_camera import ideal_camera, planes_of

        for each in planes_of(camera):
            own.add_plane(each.record, pinhole_numbers(ideal_camera(camera, each)))
    return own


def pinhole_numbers(camera: Camera) -> tuple[float, float, float, float, float, float]:
    """Focal lengths, principal point and size of an image, px; of parallel rays px/m first."""
    focal, centre = (float(camera.fx), float(camera.fy)), (float(camera.cx), float(camera.cy))
    return *focal, *centre, float(camera.width), float(camera.height)


def limits(
    mesh: Mesh, camera: Camera, poses: FloatArray, *, asks_cut: bool = True
) -> tuple[FloatArray, BoolArray, BoolArray]:
    """Near plane, whether back faces can be left out, and whether a surface is cut; (P,) each.

    Back faces can be where this cannot change the nearest surface: the mesh is closed and outward,
    and the camera is outside it with nothing cut open; and no two of its surfaces are so close
    together that they count as one from where the camera is. Unless `asks_cut`, which takes longer,
    the last is not known of all cameras inside the bounding box.
    """
    mesh, clipped = mesh.opaque, np.empty(len(poses), np.bool_)
    near, away = np.empty((2, len(poses)))
    solver_visibility.find_limits(
        (read_only(mesh.vertices, np.float64), read_only(mesh.faces, np.int64)),
        np.ascontiguousarray(mesh.bounds),
        engine_camera(camera),
        np.ascontiguousarray(poses),
        asks_cut,
        near,
        away,
        clipped,
    )
    cull = (away > 0) & mesh.can_cull_back_faces
    for row in np.flatnonzero(cull & (away > mesh.contacts.reach)):
        cull[row] = hides_its_back(mesh, away[row])
    return near, cull, clipped


def near_limits(cameras: Sequence[Camera], bounds: FloatArray, poses: Poses) -> FloatArray:
    """`near_limit` of poses that may have different cameras."""
    of_cameras = np.array([camera.near for camera in cameras], np.float64)[poses.camera]
    return _near_limits(of_cameras, bounds, poses.world_from_camera)


def near_limit(camera: Camera, bounds: FloatArray, poses: FloatArray) -> FloatArray:
    """Depth of the near plane of each pose, (P,), metres: surfaces nearer than it are cut away.

    It is max(camera.near, 1e-6 times the distance to the farthest corner of `bounds`), which are
    those of the opaque part of a mesh.
    """
    return _near_limits(np.full(len(poses), float(camera.near)), bounds, poses)


def _near_limits(of_cameras: FloatArray, bounds: FloatArray, poses: FloatArray) -> FloatArray:
    """`near_limit` of poses with the `near` of the camera of each."""
    near_limits, matrices = np.empty(len(poses)), np.ascontiguousarray(poses)
    camera_pose.find_near_limits(matrices, np.ascontiguousarray(bounds), of_cameras, near_limits)
    return near_limits


def hides_its_back(mesh: Mesh, distance: float) -> bool:
    """True if no camera outside, with no surface beyond a distance, sees a back; see `limits`."""
    mesh = mesh.opaque
    if not mesh.can_cull_back_faces:
        return False
    is_near = distance <= mesh.contacts.reach
    return is_near or not mesh.contacts.faces_within_components(distance).any()


def sides_of(camera: Camera) -> list[tuple[float, float, float]]:
    """Half-spaces of the viewing pyramid: a point (x, y, z) is in view where none is below 0."""
    return [
        (camera.fx, 0, camera.cx),
        (-camera.fx, 0, camera.width - camera.cx),
        (0, camera.fy, camera.cy),
        (0, -camera.fy, camera.height - camera.cy),
    ]
