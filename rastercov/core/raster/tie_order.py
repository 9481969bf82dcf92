"""Order of a face's corners that makes coincident faces come out at equal depth."""

import numpy as np

from rastercov.base import FloatArray, IntArray
from rastercov.core.mesh import Mesh


def in_one_order(mesh: Mesh) -> IntArray:
    """Faces with their corners in an order that depends on position alone.

    Coincident faces then reach the device as the same three points in the same order and come out
    at bitwise equal depth, where the lowest index wins. Winding is lost, so a mesh whose back faces
    may be culled keeps its order; being closed and manifold, it has no coincident faces.
    """
    return mesh.faces if mesh.can_cull_back_faces else by_position(mesh)


def by_position(mesh: Mesh) -> IntArray:
    """Faces with their corners in the order of x, then y, then z."""
    x, y, z = mesh.vertices.T
    rank = np.empty(mesh.n_vertices, np.int64)
    rank[np.lexsort((z, y, x))] = np.arange(mesh.n_vertices)
    order = np.argsort(rank[mesh.faces], axis=1)
    return np.take_along_axis(mesh.faces, order, axis=1)


def corners_of(mesh: Mesh) -> FloatArray:
    """Corners (F, 3, 3) of the faces in that order, from the centre of the mesh."""
    return (mesh.vertices - mesh.centre)[in_one_order(mesh)]
