"""Tree of boxes over triangles, with the queries of all that search a mesh.

`contacts` walks the boxes itself, to find pairs; models of the reference ask for segments that
hit a triangle, `placement.candidates.clearance` for nearest points and winding numbers.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from rastercov.kernels import mesh_tree as kernels

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

LEAF = kernels.LEAF
BOX_MARGIN = 2.0**-24
"""Margin of float32 boxes in a scene of diagonal 1 about the origin: twice the rounding of 1/2."""


@dataclass(frozen=True, eq=False)
class TriangleTree:
    """Triangles in Morton order and the boxes over them; see `kernels.mesh_tree`.

    Attributes
    ----------
    points : (V, 3) float64
    order : (T,) int64
        Row that each triangle had before sorting.
    faces : (T, 3) int
        Indices into `points`, in the order of the tree.
    boxes : (T, 6) float
        Boxes of the triangles.
    nodes : (2 L, 6) float
        Boxes of the nodes.
    """

    points: FloatArray
    order: IntArray
    faces: NDArray[Any]
    boxes: NDArray[Any]
    nodes: NDArray[Any]

    @classmethod
    def over(
        cls,
        points: FloatArray,
        faces: NDArray[np.integer[Any]],
        *,
        margin: float = 0.0,
        dtype: type[np.floating[Any]] = np.float64,
    ) -> Self:
        """Tree over (T, 3) faces, T > 0, of (V, 3) finite points.

        Boxes of another type than float64 need a margin on each side, at least twice the rounding
        of a coordinate.
        """
        points = np.ascontiguousarray(points)
        keys = np.empty(len(faces), np.uint64)
        kernels.order_keys(points, faces, keys)
        order = np.argsort(keys, kind="stable")
        del keys
        faces = np.ascontiguousarray(faces[order])
        leaves = 1 << max((-(-len(faces) // LEAF) - 1).bit_length(), 1)
        boxes, nodes = np.empty((len(faces), 6), dtype), np.empty((2 * leaves, 6), dtype)
        kernels.grow_boxes(points, faces, margin, boxes, nodes)
        return cls(points, order, faces, boxes, nodes)

    @cached_property
    def corners(self) -> FloatArray:
        """(T, 3, 3) corners of the triangles, in the order of the tree."""
        corners: FloatArray = self.points[self.faces]
        return corners

    def hit_segments(
        self, origins: FloatArray, directions: FloatArray, reaches: FloatArray
    ) -> BoolArray:
        """(N,) segments that meet a triangle: start (N, 3), unit vector (N, 3), length (N,).

        The tolerances are those of a scene of diagonal 1 about the origin.
        """
        hit = np.empty(len(origins), dtype=bool)
        kernels.hit_segments(origins, directions, reaches, self.corners, self.nodes, hit)
        return hit

    def nearest(self, points: FloatArray) -> tuple[FloatArray, IntArray, FloatArray]:
        """Distance (N,), row (N,) before sorting, and (N, 3) nearest point, for (N, 3) points.

        The triangles have areas, the boxes no margin.
        """
        squared, triangle = np.empty(len(points)), np.empty(len(points), np.int64)
        where = np.empty((len(points), 3))
        kernels.nearest(points, self.corners, self.nodes, squared, triangle, where)
        return np.sqrt(squared), self.order[triangle], where

    def winding_numbers(self, points: FloatArray) -> IntArray:
        """(N,) winding numbers of the triangles, a closed surface, about (N, 3) points.

        Each counts the crossings of a ray along +z; the boxes have no margin.
        """
        turns = np.empty(len(points), np.int64)
        kernels.winding(points, self.points, self.faces, self.nodes, turns)
        return turns
