"""Near plane: its depth, what it cuts away, and when back faces may be culled.

Surfaces nearer than `near_limit` are cut away by every method. Targets hide nothing, so they change
none of this: all is decided by the other faces, `Mesh.opaque`. Where nothing in view is cut and the
camera is outside a closed mesh, faces seen from behind cannot be the nearest surface.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from rastercov.base import BoolArray, FloatArray, IntArray, hypot, matmul, norm, read_only
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.pose import Poses
from rastercov.core.camera.projection import box_corners, to_camera
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.arrays import matrices_of
from rastercov.engine import camera_pose

NEAR_TO_FAR = camera_pose.NEAR_TO_FAR
"""Least depth that is seen, relative to the farthest depth, whatever `Camera.near` is."""


def limits(
    mesh: Mesh, camera: Camera, poses: FloatArray
) -> tuple[FloatArray, BoolArray, BoolArray]:
    """Near plane, whether back faces can be left out, and whether a surface is cut; (P,) each."""
    mesh = mesh.opaque
    if camera.is_parallel:
        return _parallel_limits(mesh, camera, poses)
    views = pinholes(camera, poses)
    clipped = near_cuts(mesh.vertices, mesh.faces, mesh.bounds, views)
    return near_limit(camera, mesh.bounds, poses), can_cull(mesh, poses, clipped), clipped


def _parallel_limits(
    mesh: Mesh, camera: Camera, poses: FloatArray
) -> tuple[FloatArray, BoolArray, BoolArray]:
    """`limits` of parallel rays: outside a closed mesh where they meet nothing before the plane.

    Back faces are left out as the engine has it: depths tie to a part of the farthest depth less
    theirs, and are rounded to a part of all that they come from.
    """
    limit, corners = near_limit(camera, mesh.bounds, poses), box_corners(mesh.bounds)
    if camera.is_curved:
        from rastercov.core.camera.lenses.of_camera import ideal_camera, planes_of

        camera = ideal_camera(camera, planes_of(camera)[0])
    cull, clipped = np.zeros((2, len(poses)), np.bool_)
    for row, (near, pose) in enumerate(zip(limit.tolist(), poses, strict=True)):
        local = to_camera(corners, pose)
        least, most = local[:, 2].min(), local[:, 2].max()
        scene = mesh.vertices, mesh.faces, camera, pose
        is_within = least < near and nearest_depth_in_view(*scene, -math.inf, near) < near
        clipped[row] = is_within and nearest_depth_in_view(*scene, 0.0, near) < near
        if is_within or not mesh.is_closed_outward:
            continue
        farthest = max(most, near) + max(mesh.diagonal, most - least)
        reach = norm(local).max()
        cull[row] = hides_its_back(mesh, farthest - min(least, near) + 1e-5 * (reach + farthest))
    return limit, cull, clipped


def pinholes(camera: Camera, poses: FloatArray) -> list[tuple[Camera, FloatArray]]:
    """Pinholes, each with its poses, that together see all that a camera sees.

    CameraError for parallel rays.
    """
    if camera.is_pinhole:
        return [(camera, poses)]
    return [(pinhole, matmul(poses, frame)) for pinhole, frame in _pinholes_of(camera)]


@lru_cache(maxsize=8)
def _pinholes_of(camera: Camera) -> tuple[tuple[Camera, FloatArray], ...]:
    """Pinholes and their frames (4, 4), lens_from_plane, of the planes of a camera."""
    from rastercov.core.camera.lenses.of_camera import planes_of

    table = {}
    for each in planes_of(camera):
        pinhole, frame = replace(each.camera, near=camera.near), each.record.frame
        table[frame.tobytes()] = pinhole, matrices_of(frame)
    return tuple(table.values())


def near_limits(cameras: Sequence[Camera], bounds: FloatArray, poses: Poses) -> FloatArray:
    """`near_limit` of poses that may have different cameras."""
    of_cameras = np.array([camera.near for camera in cameras], np.float64)[poses.camera]
    return _near_limits(of_cameras, bounds, poses.world_from_camera)


def picture_limits(mesh: Mesh, camera: Camera, poses: FloatArray) -> tuple[FloatArray, BoolArray]:
    """The first two of `limits`, which take less time without the third."""
    mesh = mesh.opaque
    if camera.is_parallel:
        return _parallel_limits(mesh, camera, poses)[:2]
    cull = can_cull(mesh, poses, np.zeros(len(poses), np.bool_))
    views = pinholes(camera, poses[cull])
    cull[cull] = ~near_cuts(mesh.vertices, mesh.faces, mesh.bounds, views)
    return near_limit(camera, mesh.bounds, poses), cull


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


def near_cuts(
    vertices: FloatArray,
    faces: IntArray,
    bounds: FloatArray,
    views: Sequence[tuple[Camera, FloatArray]],
) -> BoolArray:
    """Poses in which the near plane cuts away a surface in view, (P,) bool.

    Only faces within reach of the eye can: the depth of a point in view is never less than its
    distance times the cosine of the widest view ray. So the bounding box decides nearly always.

    Parameters
    ----------
    vertices, faces, bounds
        Of the opaque part of a mesh, metres.
    views : sequence of (Camera, (P, 4, 4) float64)
        Of `pinholes`: they differ in their rotations.
    """
    limit = near_limit(views[0][0], bounds, views[0][1])
    widest = max(
        float(
            hypot(
                max(camera.cx, camera.width - camera.cx) / camera.fx,
                max(camera.cy, camera.height - camera.cy) / camera.fy,
            )
        )
        for camera, _ in views
    )
    reach = (limit * np.sqrt(1 + widest**2))[:, None]
    eyes = views[0][1][:, :3, 3]
    close = ((eyes > bounds[0] - reach) & (eyes < bounds[1] + reach)).all(axis=1)
    cut = np.zeros(len(eyes), dtype=bool)
    for row in np.flatnonzero(close):
        cut[row] = any(
            nearest_depth_in_view(vertices, faces, camera, poses[row], 0.0, limit[row]) < limit[row]
            for camera, poses in views
        )
    return cut


def can_cull(mesh: Mesh, poses: FloatArray, clipped: BoolArray) -> BoolArray:
    """Poses in which culling back faces cannot change the nearest surface, (P,) bool.

    The mesh is closed and outward, and the camera is outside it with nothing cut open; and no two
    of its surfaces are so close together that they count as one from where the camera is. Outside
    is beyond the bounding box by more than `NEAR_TO_FAR` of the farthest distance: a camera that is
    mounted on a face looks through it, for the near plane cuts it away, which `clipped` cannot tell
    where the face is edge-on to within rounding error.
    """
    mesh = mesh.opaque
    if not mesh.is_closed_outward:
        return np.zeros(len(poses), bool)
    eyes = poses[:, :3, 3]
    reach = np.abs(mesh.bounds[None] - eyes[:, None]).max(axis=1)
    distance = norm(reach)
    margin = NEAR_TO_FAR * distance[:, None]
    is_beyond = (eyes < mesh.bounds[0] - margin) | (eyes > mesh.bounds[1] + margin)
    allowed: BoolArray = is_beyond.any(axis=1) & ~clipped
    if not (mesh.can_cull_back_faces and allowed.any()):
        return np.zeros(len(poses), bool)
    for row in np.flatnonzero(allowed & (distance > mesh.contacts.reach)):
        allowed[row] = hides_its_back(mesh, distance[row])
    return allowed


def hides_its_back(mesh: Mesh, distance: float) -> bool:
    """True if no camera outside, with no surface beyond a distance, sees a back; see `can_cull`."""
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


def nearest_depth_in_view(
    vertices: FloatArray,
    faces: IntArray,
    camera: Camera,
    pose: FloatArray,
    near: float,
    enough: float = math.inf,
) -> float:
    """Least depth of any surface inside the viewing pyramid beyond `near`, metres.

    `enough`, which is infinite unless given, where none is less deep.
    """
    from rastercov.engine.exact_depth import least_depth

    scene = read_only(vertices, np.float64), read_only(faces, np.int64), read_only(pose, np.float64)
    is_prism, sides = camera.is_parallel, np.array(sides_of(camera))
    return least_depth(*scene, sides, is_prism, float(near), float(enough))
