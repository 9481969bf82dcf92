"""Faces that touch or cut another face, independent of the camera.

The certificate needs them: one point of a face represents the whole face only if no other face cuts
it or lies on it. So does `Mesh.can_cull_back_faces`, because a closed surface that cuts itself can
show its back. Conservative: a false positive costs time, a false negative would break both. A tree
of boxes finds the pairs, separating axes decide each; see `engine/solver/contacts.cpp`.

The tree has the queries of all others that search a mesh, too: `coverage.line_of_sight` asks for
segments that hit a triangle, `placement.candidates.rooms` for nearest points and winding
numbers.
"""

from collections.abc import Callable
from dataclasses import field
from functools import cached_property
from typing import Any, NamedTuple, Self, TypeVar

import numpy as np

from rastercov.base import (
    AnyArray,
    BoolArray,
    FloatArray,
    Int32Array,
    IntArray,
    Once,
    WholeArray,
    frozen_record,
    read_only,
    sort_order,
    thread_count,
)
from rastercov.core.mesh.arrays import normals_and_areas
from rastercov.engine import mesh_tree, solver_contacts

T = TypeVar("T")


LEAF = mesh_tree.LEAF
MOST_AT_A_CORNER, LEAVES_A_PART = solver_contacts.MOST_AT_A_CORNER, solver_contacts.LEAVES_A_PART
CONTACT, REACH = solver_contacts.CONTACT, solver_contacts.REACH
MOST_PARTNERS, PAIRS_A_FACE = solver_contacts.MOST_PARTNERS, solver_contacts.PAIRS_A_FACE
ROUNDING_FACTOR, BOX_MARGIN = solver_contacts.ROUNDING_FACTOR, solver_contacts.BOX_MARGIN
"""Margin of float32 boxes in a scene of diagonal 1 about the origin: twice the rounding of 1/2."""


@frozen_record
class TriangleTree:
    """Triangles in Morton order and the boxes over them; see `rastercov/engine/mesh/tree.hpp`.

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
    faces: AnyArray
    boxes: AnyArray
    nodes: AnyArray

    @classmethod
    def over(
        cls,
        points: FloatArray,
        faces: WholeArray,
        *,
        margin: float = 0.0,
        dtype: type[np.floating[Any]] = np.float64,
    ) -> Self:
        """Tree over (T, 3) faces, T > 0, of (V, 3) finite points.

        Boxes of another type than float64 need a margin on each side, at least twice the rounding
        of a coordinate.
        """
        points = np.ascontiguousarray(points, np.float64)
        placed: AnyArray = np.ascontiguousarray(faces)
        keys = np.empty(len(faces), np.uint64)
        mesh_tree.order_keys(points, placed, keys)
        order = sort_order(keys)
        del keys
        placed = placed[order]
        leaves = 1 << max((-(-len(faces) // LEAF) - 1).bit_length(), 1)
        boxes, nodes = np.empty((len(faces), 6), dtype), np.empty((2 * leaves, 6), dtype)
        mesh_tree.grow_boxes(points, placed, margin, boxes, nodes)
        return cls(points, order, placed, boxes, nodes)

    @cached_property
    def corners(self) -> FloatArray:
        """(T, 3, 3) corners of the triangles, in the order of the tree."""
        return self.points[self.faces]

    def first_hits(
        self, origins: FloatArray, directions: FloatArray, reaches: FloatArray, own: IntArray
    ) -> IntArray:
        """(N,) first triangle of segments, other than `own`; rows before sorting, -1 for none.

        Segments have a start (N, 3), a unit vector (N, 3) and a length (N,). The tolerances are
        those of a scene of diagonal 1 about the origin.
        """
        place, hit = np.empty(len(self.order) + 1, np.int64), np.empty(len(origins), np.int64)
        place[self.order], place[-1] = np.arange(len(self.order)), -1
        mesh_tree.first_hits(
            origins, directions, reaches, place[own], True, self.corners, self.nodes, hit
        )
        return np.append(self.order, -1)[hit]

    def nearest(self, points: FloatArray) -> tuple[FloatArray, IntArray, FloatArray]:
        """Distance (N,), row (N,) before sorting, and (N, 3) nearest point, for (N, 3) points.

        The triangles have areas, the boxes no margin.
        """
        squared, triangle = np.empty(len(points)), np.empty(len(points), np.int64)
        where = np.empty((len(points), 3))
        points = np.ascontiguousarray(points)
        mesh_tree.nearest(points, self.corners, self.nodes, squared, triangle, where)
        return np.sqrt(squared), self.order[triangle], where

    def behind(self, points: FloatArray, counts: BoolArray) -> BoolArray:
        """(N,) points, (N, 3), from which most directions first meet the back of a triangle.

        Only the backs of triangles of `counts`, (T,) by rows before sorting, are such, but all
        triangles block. In a scene of diagonal 1 about the origin.
        """
        mask = np.empty(len(points), bool)
        own = np.ascontiguousarray(counts[self.order])
        points = np.ascontiguousarray(points)
        mesh_tree.behind(points, own, self.corners, self.nodes, mask)
        return mask

    def winding_numbers(self, points: FloatArray) -> IntArray:
        """(N,) winding numbers of the triangles, a closed surface, about (N, 3) points.

        Each counts the crossings of a ray along +z; the boxes have no margin.
        """
        turns = np.empty(len(points), np.int64)
        points = np.ascontiguousarray(points)
        mesh_tree.winding(points, self.points, self.faces, self.nodes, turns)
        return turns


class Partners(NamedTuple):
    """For each face, the faces in contact with it.

    Attributes
    ----------
    starts : (F + 1,) int64
        The partners of face f are faces[starts[f]] ... faces[starts[f + 1] - 1]. None are listed of
        a face with more than 24, and none at all if there are too many pairs.
    faces : (N,) int32
    """

    starts: IntArray
    faces: Int32Array


@frozen_record
class Contacts:
    """Faces of a mesh in contact with another face, computed at the first query.

    Parameters
    ----------
    vertices : (V, 3) float64
        Metres.
    faces : (F, 3) int
        Vertex indices.
    degenerate_mask : (F,) bool
        Faces without area, which touch nothing.
    diagonal : float
        Diagonal of the bounding box, metres.
    components : callable
        Returns the (F,) number of each face's edge-connected component.
    """

    vertices: FloatArray
    faces: WholeArray
    degenerate_mask: BoolArray
    diagonal: float
    components: Callable[[], WholeArray]
    _known: dict[tuple[int, str], Once[Any]] = field(default_factory=dict, init=False)

    @property
    def reach(self) -> float:
        """Distance of cameras up to which one answer is valid for all, metres."""
        return REACH * self.diagonal

    def faces_for(self, distance: float = 0.0) -> BoolArray:
        """(F,) faces in contact, for cameras with no surface beyond `distance`, metres."""
        return self._once("all", distance, self._touching)

    def partners_for(self, distance: float = 0.0) -> Partners:
        """For each face in contact the others that it touches or cuts; see `faces_for`."""
        return self._once(
            "partners",
            distance,
            lambda tolerance: contact_partners(
                self.vertices, self.faces, tolerance, self.faces_for(distance)
            ),
        )

    def faces_within_components(self, distance: float = 0.0) -> BoolArray:
        """(F,) faces in contact with one of their own edge-connected component; see `faces_for`."""
        any_contact = self.faces_for(distance)
        if not any_contact.any():
            return any_contact
        return self._once(
            "within", distance, lambda tolerance: self._touching(tolerance, self.components())
        )

    def _touching(self, tolerance: float, labels: WholeArray | None = None) -> BoolArray:
        return touching_faces(
            self.vertices,
            self.faces,
            tolerance,
            degenerate_mask=self.degenerate_mask,
            labels=labels,
        )

    def _once(self, what: str, distance: float, make: Callable[[float], T]) -> T:
        """Answer for a distance, made of the tolerance in metres, once a decade of distances."""
        decade = solver_contacts.decade_of(float(distance), self.diagonal)
        once: Once[T] = self._known.setdefault((decade, what), Once())
        return once.get(lambda: make(CONTACT * 10**decade * self.diagonal))


def touching_faces(
    vertices: FloatArray,
    faces: WholeArray,
    tolerance: float,
    *,
    degenerate_mask: BoolArray | None = None,
    labels: WholeArray | None = None,
    threads: int | None = None,
) -> BoolArray:
    """Faces with another face within `tolerance`, except where the two are joined.

    Two faces are joined at corners with the same position, whatever their indices. Depending on the
    number of common corners they touch:

    - none: if their distance is at most `tolerance`;
    - one: if the edge opposite to it in one face is within `tolerance` of the other face;
    - two: if the gap between them, at the height of the lower apex over the common edge, is at most
      `tolerance`, as when they are folded onto each other;
    - three: always.

    No contact outside a joint is missed: the intersection of two triangles is convex, so it reaches
    one of the places above. Rounding, below 5e-15 of the bounding box' diagonal, hides none:
    `tolerance` is raised to at least 1e-12 of the diagonal, and by 1 %. A face may be marked at a
    larger distance if two corners are the nearest points: the separating axes underestimate that.

    Parameters
    ----------
    vertices : (V, 3) float64
        Finite, at most 1e30 in magnitude.
    faces : (F, 3) int
        Vertex indices.
    tolerance : float
        In the units of the vertices; at least 0.
    degenerate_mask : (F,) bool, optional
        Faces without area, as `Mesh.degenerate_mask`: they touch nothing. Computed by default.
    labels : (F,) int, optional
        Only faces with the same label can touch.
    threads : int, optional
        Number of threads, one per core by default; without influence on the result.

    Returns
    -------
    (F,) bool
        Time grows with F log F and the number of pairs whose boxes overlap.
    """
    touching = np.zeros(len(faces), bool)
    if degenerate_mask is None:
        degenerate_mask = ~np.any(normals_and_areas(vertices, faces)[0], axis=1)
    names = np.empty(0, np.int32) if labels is None else labels
    solver_contacts.find_touching(
        _positions(vertices, faces),
        read_only(degenerate_mask, np.bool_),
        read_only(names, np.int32),
        float(tolerance),
        thread_count(threads),
        MOST_AT_A_CORNER,
        LEAVES_A_PART,
        touching,
    )
    return touching


def _positions(vertices: FloatArray, faces: AnyArray) -> tuple[FloatArray, IntArray]:
    return read_only(vertices, np.float64), read_only(faces, np.int64)


def contact_partners(
    vertices: FloatArray,
    faces: WholeArray,
    tolerance: float,
    touching: BoolArray,
) -> Partners:
    """Faces in contact with each of the `touching_faces`.

    `touching` is the answer of `touching_faces` for the same mesh and tolerance.
    """
    starts = np.empty(len(faces) + 1, np.int64)
    partners = np.empty(solver_contacts.MOST_PARTNERS * np.count_nonzero(touching), np.int32)
    n, _ = solver_contacts.find_partners(
        _positions(vertices, faces),
        float(tolerance),
        touching,
        MOST_AT_A_CORNER,
        starts,
        partners,
    )
    return Partners(starts, partners[:n])
