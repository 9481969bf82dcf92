"""Faces that touch or cut another face, independent of the camera.

The certificate needs them: one point of a face represents the whole face only if no other face cuts
it or lies on it. So does `Mesh.can_cull_back_faces`, because a closed surface that cuts itself can
show its back. Conservative: a false positive costs time, a false negative would break both. A tree
of boxes finds the pairs, separating axes decide each; see `native/mesh/contacts.cpp`.

The tree has the queries of all others that search a mesh, too: `coverage.line_of_sight` asks for
segments that hit a triangle, `placement.candidates.clearance` for nearest points and winding
numbers.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from rastercov.base.memory import FloatArray, IntArray
from rastercov.base.threads import Once, share_poses, thread_count
from rastercov.mesh.arrays import bounds_of, normals_and_areas
from rastercov.mesh.topology import first_equal_row
from rastercov.native import mesh_contacts as kernels
from rastercov.native import mesh_tree

T = TypeVar("T")


LEAF = mesh_tree.LEAF
BOX_MARGIN = 2.0**-24
"""Margin of float32 boxes in a scene of diagonal 1 about the origin: twice the rounding of 1/2."""


@dataclass(frozen=True, eq=False)
class TriangleTree:
    """Triangles in Morton order and the boxes over them; see `rastercov/native/mesh/tree.hpp`.

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
        points = np.ascontiguousarray(points, np.float64)
        placed: NDArray[Any] = np.ascontiguousarray(faces)
        keys = np.empty(len(faces), np.uint64)
        mesh_tree.order_keys(points, placed, keys)
        order = np.argsort(keys, kind="stable")
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

    def winding_numbers(self, points: FloatArray) -> IntArray:
        """(N,) winding numbers of the triangles, a closed surface, about (N, 3) points.

        Each counts the crossings of a ray along +z; the boxes have no margin.
        """
        turns = np.empty(len(points), np.int64)
        points = np.ascontiguousarray(points)
        mesh_tree.winding(points, self.points, self.faces, self.nodes, turns)
        return turns


LEAST_TOLERANCE_REL = 1e-12
"""Least tolerance in diagonals of the bounding box: 200 times the rounding of a distance."""
ROUNDING_FACTOR = 1.01
"""Factor on the tolerance that covers that rounding where the tolerance is the least."""
STEPS_A_CALL = 20_000
"""Steps through the tree before a compiled loop returns: a few milliseconds, or a second if many
faces meet in one place."""
LEAVES_A_PART = 128
"""Leaves that a thread works on at a time, or a few times as many."""
FRAME_SAMPLES = 4096
"""Greatest number of faces on which two frames for the boxes are compared."""
MOST_PARTNERS = 24
"""Faces in contact with one face, beyond which they are not listed."""
PAIRS_A_FACE = 8
"""Pairs for each face in contact, beyond which none is listed: whole surfaces lie on each other."""
CONTACT = 1e-8
"""Contact distance in diagonals of the bounding box."""
REACH = 30.0
"""Camera distance in diagonals up to which `CONTACT` suffices: from farther away, surfaces farther
apart than that are still at equal depth to within the tie tolerance of the exact methods."""


class Partners(NamedTuple):
    """For each face, the faces in contact with it.

    Attributes
    ----------
    starts : (F + 1,) int64
        The partners of face f are faces[starts[f]] ... faces[starts[f + 1] - 1]. None are listed of
        a face with more than `MOST_PARTNERS`, and none at all if there are too many pairs.
    faces : (N,) int32
    """

    starts: IntArray
    faces: NDArray[np.int32]


@dataclass(frozen=True, eq=False)
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
    faces: NDArray[np.integer[Any]]
    degenerate_mask: NDArray[np.bool_]
    diagonal: float
    components: Callable[[], NDArray[np.integer[Any]]]
    _known: dict[tuple[int, str], Once[Any]] = field(default_factory=dict, init=False)

    @property
    def reach(self) -> float:
        """Distance of cameras up to which one answer is valid for all, metres."""
        return REACH * self.diagonal

    def faces_for(self, distance: float = 0.0) -> NDArray[np.bool_]:
        """(F,) faces in contact, for cameras with no surface beyond `distance`, metres."""
        return self._once("all", distance, self._touching)

    def partners_for(self, distance: float = 0.0) -> Partners:
        """For each face in contact the others that it touches or cuts; see `faces_for`."""
        return self._once(
            "partners", distance,
            lambda tolerance: contact_partners(
                self.vertices, self.faces, tolerance, self.faces_for(distance)
            ),
        )  # fmt: skip

    def faces_within_components(self, distance: float = 0.0) -> NDArray[np.bool_]:
        """(F,) faces in contact with one of their own edge-connected component; see `faces_for`."""
        any_contact = self.faces_for(distance)
        if not any_contact.any():
            return any_contact
        return self._once(
            "within", distance, lambda tolerance: self._touching(tolerance, self.components())
        )

    def _touching(
        self, tolerance: float, labels: NDArray[np.integer[Any]] | None = None
    ) -> NDArray[np.bool_]:
        return touching_faces(
            self.vertices, self.faces, tolerance, degenerate_mask=self.degenerate_mask,
            labels=labels,
        )  # fmt: skip

    def _once(self, what: str, distance: float, make: Callable[[float], T]) -> T:
        """Answer for a distance, made of the tolerance in metres, once a decade of distances."""
        far = distance / self.reach if self.diagonal > 0 else 1.0
        decade = max(0, math.ceil(math.log10(max(far, 1.0))))
        once: Once[T] = self._known.setdefault((decade, what), Once())
        return once.get(lambda: make(CONTACT * 10**decade * self.diagonal))


def touching_faces(
    vertices: FloatArray,
    faces: NDArray[np.integer[Any]],
    tolerance: float,
    *,
    degenerate_mask: NDArray[np.bool_] | None = None,
    labels: NDArray[np.integer[Any]] | None = None,
    threads: int | None = None,
) -> NDArray[np.bool_]:
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
        Number of threads, one a core by default; without influence on the result.

    Returns
    -------
    (F,) bool
        Time grows with F log F and the number of pairs whose boxes overlap.
    """
    touching = np.zeros(len(faces), dtype=bool)
    if degenerate_mask is None:
        degenerate_mask = ~np.any(normals_and_areas(vertices, faces)[0], axis=1)
    chosen = np.flatnonzero(~degenerate_mask)
    if len(chosen) < 2:
        return touching
    placed = _Placed.of(vertices, faces, chosen, tolerance)
    names = np.empty(0, np.int32) if labels is None else labels[placed.chosen].astype(np.int32)
    touching[placed.chosen[_marks(placed, names, threads)]] = True
    return touching


def contact_partners(
    vertices: FloatArray,
    faces: NDArray[np.integer[Any]],
    tolerance: float,
    touching: NDArray[np.bool_],
) -> Partners:
    """Faces in contact with each of the `touching_faces`.

    `touching` is the answer of `touching_faces` for the same mesh and tolerance.
    """
    chosen = np.flatnonzero(touching)
    pairs = np.empty((0, 2), np.int64)
    if len(chosen):
        placed = _Placed.of(vertices, faces, chosen, ROUNDING_FACTOR * tolerance)
        tree = placed.tree
        rows = np.empty((PAIRS_A_FACE * len(chosen), 2), np.int32)
        n = kernels.list_contacts(
            placed.vertices, placed.scale, tree.faces, tree.boxes, tree.nodes, placed.reach, rows
        )
        if n <= len(rows):
            pairs = placed.chosen[rows[:n]]
    both = np.concatenate((pairs, pairs[:, ::-1]))
    counts = np.bincount(both[:, 0], minlength=len(faces))
    both = both[(counts <= MOST_PARTNERS)[both[:, 0]]]
    both = both[np.lexsort(both.T[::-1])]
    counts[counts > MOST_PARTNERS] = 0
    starts = np.concatenate(([0], np.cumsum(counts)))
    return Partners(starts.astype(np.int64), np.ascontiguousarray(both[:, 1], np.int32))


@dataclass(frozen=True, eq=False)
class _Placed:
    """Chosen faces of a mesh, scaled to a bounding box of diagonal 1, in a tree.

    Attributes
    ----------
    chosen : (N,) int64
        The faces, in the order of the tree.
    vertices : (V, 3) float64
        Of the mesh.
    scale : float
        Inverse of the diagonal.
    reach : float
        Tolerance as a fraction of the diagonal, raised against rounding.
    """

    chosen: IntArray
    vertices: FloatArray
    scale: float
    reach: float
    tree: TriangleTree

    @classmethod
    def of(
        cls,
        vertices: FloatArray,
        faces: NDArray[np.integer[Any]],
        chosen: IntArray,
        tolerance: float,
    ) -> Self:
        vertices = np.ascontiguousarray(vertices, dtype=np.float64) + 0.0  # -0.0 + 0.0 is 0.0
        dtype = np.int32 if len(vertices) < 2**31 else np.int64
        position: NDArray[Any] = first_equal_row(vertices.view(np.uint64)).astype(dtype)
        corners = position[faces[chosen]]
        low, high = bounds_of(vertices, corners)
        extent = math.hypot(*(high - low))  # its squares may under- and overflow
        scale = 1 / max(extent, 1e-300)  # the inverse of a smaller number can be infinite
        reach = ROUNDING_FACTOR * max(float(tolerance), LEAST_TOLERANCE_REL * extent) * scale
        placed = (np.clip(vertices, low, high) - (low + high) / 2) * scale
        placed = placed @ _frame(placed, corners)
        tree = TriangleTree.over(placed, corners, margin=BOX_MARGIN, dtype=np.float32)
        return cls(chosen[tree.order], vertices, scale, reach, tree)


def _frame(placed: FloatArray, corners: NDArray[np.int32]) -> FloatArray:
    """(3, 3) rotation that makes boxes small: the identity, or the main directions of the edges.

    The box of a needle across the axes overlaps those of all needles beside it. A part of parallel
    needles, such as a cylinder, is rotated until they are parallel to an axis.
    """
    points = placed[corners[:: -(-len(corners) // FRAME_SAMPLES)]]
    edges = (np.roll(points, -1, axis=1) - points).reshape(-1, 3)
    length = np.linalg.norm(edges, axis=1)
    weighted = edges / np.sqrt(np.where(length > 0, length, 1))[:, None]
    turned = np.linalg.eigh(weighted.T @ weighted)[1]
    is_better = _box_area(points @ turned) < 0.5 * _box_area(points)
    return turned if is_better else np.eye(3)


def _box_area(points: FloatArray) -> float:
    """Half the surface area of the boxes of (N, 3, 3) triangles."""
    x, y, z = np.ptp(points, axis=1).T
    return float((x * y + y * z + z * x).sum())


def _marks(placed: _Placed, labels: NDArray[np.int32], threads: int | None) -> NDArray[np.bool_]:
    """(N,) faces in contact, in the order of the tree."""
    tree = placed.tree
    done, marks = tree.nodes[:, 0] == np.inf, np.zeros(len(tree.faces), dtype=bool)

    def mark(leaves: slice) -> None:
        start, end = leaves.start * LEAVES_A_PART, min(leaves.stop * LEAVES_A_PART, n_leaves)
        while start < end:
            start = kernels.mark_contacts(
                placed.vertices, placed.scale, tree.points, tree.faces, labels, tree.boxes,
                tree.nodes, done, placed.reach, start, end, STEPS_A_CALL, marks,
            )  # fmt: skip

    n_leaves = -(-len(tree.faces) // LEAF)
    n_parts = -(-n_leaves // LEAVES_A_PART)
    share_poses(n_parts, [mark] * min(thread_count(threads), n_parts))
    return marks
