"""Targets of a rasteriser: faces that are counted and hide nothing.

A rasteriser draws the opaque faces of a mesh alone, so their counts are those of the mesh without
targets, bit for bit. Targets are then compared with the depths that were drawn, face by face, by
loops on the CPU (`engine/raster/targets.cpp`): one face index per sample has no room for two
targets, one behind the other. The depths of each pose are drawn again for that, which takes about
as long as counting it. Meshes without targets do nothing of this.

Order of a face's corners that makes coincident faces come out at equal depth.
"""

import numpy as np

from rastercov.base import FloatArray, Int32Array, IntArray, frozen_record, sort_order
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
    order = sort_order(rank[mesh.faces])
    return np.take_along_axis(mesh.faces, order, axis=1)


def corners_of(mesh: Mesh) -> FloatArray:
    """Corners (F, 3, 3) of the faces in that order, from the centre of the mesh."""
    return (mesh.vertices - mesh.centre)[in_one_order(mesh)]


CountArray = Int32Array | IntArray


@frozen_record
class TargetFaces:
    """Targets of a mesh.

    Attributes
    ----------
    rows, opaque : (N,), (O,) int64
        The targets, and all other faces.
    corners : (N, 3, 3) float64
        Points of the targets from the centre of the opaque faces, metres: as in the CPU rasteriser,
        so that they are rounded alike.
    """

    rows: IntArray
    opaque: IntArray
    corners: FloatArray

    @classmethod
    def of(cls, mesh: Mesh) -> "TargetFaces | None":
        """Targets of a mesh; None where it has none."""
        if not mesh.has_targets:
            return None
        rows = np.flatnonzero(mesh.target_mask)
        # The order decides how a clipped face is cut into triangles.
        corners = mesh.vertices[by_position(mesh)[rows]] - mesh.opaque.centre
        return cls(rows, np.flatnonzero(~mesh.target_mask), corners)

    def face_of(self, face: Int32Array) -> Int32Array:
        """Faces of the mesh for faces of its opaque part; -1 stays."""
        names = np.append(self.opaque, -1).astype(np.int32)
        return names[face]

    def merge(self, opaque: CountArray, targets: IntArray) -> CountArray:
        """Counts of all faces from those of the opaque ones and of the targets, (P, N)."""
        n_faces = len(self.opaque) + len(self.rows)
        merged: CountArray = np.empty((len(targets), n_faces), opaque.dtype)
        merged[:, self.opaque] = opaque[:, : len(self.opaque)]
        merged[:, self.rows] = targets
        return merged
