"""Targets of a rasteriser: faces that are counted and hide nothing.

A rasteriser draws the opaque faces of a mesh alone, so their counts are those of the mesh without
targets, bit for bit. Targets are then compared with the depths that were drawn, face by face, by
loops on the CPU (`engine/raster/targets.cpp`): one face index per sample has no room for two
targets, one behind the other. The depths of each pose are drawn again for that, which takes about
as long as counting it. Meshes without targets do nothing of this.
"""

import numpy as np

from rastercov.base import FloatArray, Int32Array, IntArray, frozen_record
from rastercov.core.mesh import Mesh
from rastercov.core.raster.tie_order import by_position

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
