"""Rules that every rasteriser keeps: when back faces may be left out, and who wins a tie."""

import numpy as np
from numpy.typing import NDArray

from rastercov.camera import Camera
from rastercov.mesh import Mesh
from rastercov.projection import NEAR_TO_FAR, near_cuts, near_limit

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def can_cull(mesh: Mesh, poses: FloatArray, clipped: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether back faces can be left out without changing which surface is nearest, (P,).

    The mesh is closed and outward, and the camera is outside it with nothing cut open; and no two
    of its surfaces are so close together that they count as one from where the camera is. Outside
    is beyond the bounding box by more than `NEAR_TO_FAR` of the farthest distance: a camera that is
    mounted on a face looks through it, for the near plane cuts it away, which `clipped` cannot tell
    where the face is edge-on to rounding.
    """
    eyes = poses[:, :3, 3]
    reach = np.abs(mesh.bounds[None] - eyes[:, None]).max(axis=1)
    distance = np.sqrt((reach**2).sum(axis=1))
    margin = NEAR_TO_FAR * distance[:, None]
    is_beyond = (eyes < mesh.bounds[0] - margin) | (eyes > mesh.bounds[1] + margin)
    allowed: NDArray[np.bool_] = is_beyond.any(axis=1) & ~clipped
    if not (allowed.any() and mesh.can_cull_back_faces):
        return np.zeros(len(poses), bool)
    for row in np.flatnonzero(allowed & (distance > mesh.contacts.reach)):
        allowed[row] = not mesh.contacts.faces_within_components(distance[row]).any()
    return allowed


def limits(
    mesh: Mesh, camera: Camera, poses: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_], NDArray[np.bool_]]:
    """Near plane, whether back faces can be left out, and whether a surface is cut; (P,) each."""
    clipped = near_cuts(mesh.vertices, mesh.faces, mesh.bounds, camera, poses)
    return near_limit(camera, mesh.bounds, poses), can_cull(mesh, poses, clipped), clipped


def in_one_order(mesh: Mesh) -> IntArray:
    """Faces with their corners in an order that depends on position alone.

    Coincident faces then reach the device as the same three points in the same order and come out
    at bitwise equal depth, where the lowest index wins. Winding is lost, so a mesh whose back faces
    may be culled keeps its order; being closed and manifold, it has no coincident faces.
    """
    if mesh.can_cull_back_faces:
        return mesh.faces
    x, y, z = mesh.vertices.T
    rank = np.empty(mesh.n_vertices, np.int64)
    rank[np.lexsort((z, y, x))] = np.arange(mesh.n_vertices)
    order = np.argsort(rank[mesh.faces], axis=1)
    return np.take_along_axis(mesh.faces, order, axis=1)
