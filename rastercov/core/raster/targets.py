"""Targets of a rasteriser: faces that are counted and hide nothing.

A rasteriser draws the opaque faces of a mesh alone, so their counts are those of the mesh without
targets, bit for bit. Targets are then compared with the depths that were drawn, face by face, by
one loop for all devices (`native.solver_raster`): one face index per sample has no room for two
targets, one behind the other. The depths of each pose are drawn again for that and read back, which
takes about as long as counting it. Meshes without targets do nothing of this.
"""

from collections.abc import Callable, Iterator

import numpy as np

from rastercov.base import Float32Array, FloatArray, Int32Array, IntArray, frozen_record
from rastercov.core.mesh import Mesh
from rastercov.core.raster.sample_grid import Box, SampleGrid
from rastercov.engine import solver_raster as kernels

CountArray = Int32Array | IntArray
Depths = Callable[[int, int], Iterator[tuple[Box, Float32Array]]]
"""Tiles of one pose that together hold the rows from a first one up to a last one, each with the
depth of the nearest surface at its samples: metres, inf for none."""


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
    centre : (3,) float64
        That centre.
    """

    rows: IntArray
    opaque: IntArray
    corners: FloatArray
    centre: FloatArray

    @classmethod
    def of(cls, mesh: Mesh) -> "TargetFaces | None":
        """Targets of a mesh; None where it has none."""
        if not mesh.has_targets:
            return None
        rows = np.flatnonzero(mesh.target_mask)
        centre = mesh.opaque.centre
        corners = mesh.vertices[mesh.faces[rows]]
        # As in `tie_order`: the order decides how a clipped face is cut into triangles.
        order = np.lexsort(corners.transpose(2, 0, 1)[::-1], axis=1)
        corners = np.take_along_axis(corners, order[:, :, None], axis=1) - centre
        return cls(rows, np.flatnonzero(~mesh.target_mask), corners, centre)

    def count(
        self, grid: SampleGrid, pose: FloatArray, near: float, depths: Depths
    ) -> tuple[IntArray, IntArray]:
        """Samples of each target in one pose: visible and drawn, (N,) each.

        Parameters
        ----------
        grid : SampleGrid
        pose : (4, 4) float64
            world_from_camera.
        near : float
            Depth of the near plane, metres.
        depths : callable
            Called once if a target is in view.
        """
        axes = np.ascontiguousarray(grid.axes(pose[None])[0, :3, :3])
        view = self.corners, axes, pose[:3, 3] - self.centre, grid.lens, float(near)
        visible, drawn = np.zeros((2, len(self.rows)), np.int64)
        rows = np.empty((len(self.rows), 2), np.int64)
        kernels.rows_of_targets(view, grid.height, rows)
        in_view = rows[rows[:, 0] < rows[:, 1]]
        if len(in_view):
            runs = tuple(grid.runs)
            for tile, depth in depths(int(in_view[:, 0].min()), int(in_view[:, 1].max())):
                kernels.count_targets(view, rows, tile, runs, depth, visible, drawn)
        return visible, drawn

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
