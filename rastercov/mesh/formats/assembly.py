"""Instances of shapes, in time and memory of the faces that they have: 3MF and COLLADA.

An element holds shapes and other elements, each with a place, and a file of n lines can ask for 2^n
of them. So each element is looked at once, what its instances come to is counted before any is
made, those without faces are left out, and a chain of elements that hold one other each is one
step. What remains has fewer elements than shapes.
"""

from collections.abc import Callable, Hashable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.base.errors import MeshError
from rastercov.mesh.formats.polygons import Polygons, check_budget, fan_polygons

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

BYTES_PER_INSTANCE = 1000
"""Memory and work that an instance counts for beside its faces."""


class Shape(NamedTuple):
    """Points, corners of all polygons, number of corners of each, number of triangles."""

    points: FloatArray
    corners: IntArray
    n_corners: IntArray
    n_faces: int


class Element(NamedTuple):
    """An element: its name, how it is called in errors, what it holds, in order, with its place.

    `pieces` are (element_from_piece, (4, 4), shape or key of an element). A place of None is one
    that is not supported, which `why_none` says.
    """

    name: str
    title: str
    pieces: Sequence[tuple[FloatArray | None, Shape | Hashable]]
    why_none: str = ""


class _Node(NamedTuple):
    """An element with faces, and what all its instances come to."""

    name: str
    pieces: "Sequence[tuple[FloatArray, Shape | _Node]]"
    n_faces: int
    n_vertices: int
    n_shapes: int


class Assembly:
    """Elements by their keys, made by `element_of` when they are first asked for."""

    def __init__(self, element_of: Callable[[Hashable], Element], budget: int) -> None:
        self._element_of, self._budget = element_of, budget
        self._nodes: dict[Hashable, _Node | None] = {}
        self._vertices, self._corners = [np.empty((0, 3))], [np.empty(0, np.int64)]
        self._n_corners, self._labels = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
        self._names: list[str | None] = []
        self._n_vertices = 0

    def polygons(
        self, roots: Iterable[tuple[FloatArray, Hashable]], metres: float | None
    ) -> Polygons:
        """All instances below these elements, one group each, by `metres` if they are known."""
        nodes = [(matrix, self._node(key)) for matrix, key in roots]
        self._count([node for _, node in nodes])
        for matrix, node in nodes:
            self._place(node, matrix)
        found = fan_polygons(
            np.concatenate(self._vertices) * (1.0 if metres is None else metres),
            np.concatenate(self._corners),
            np.concatenate(self._n_corners),
            self._budget,
        )
        return Polygons(
            found.vertices,
            found.faces,
            found.source_face,
            np.concatenate(self._labels)[found.source_face],
            self._names or [None],
            is_in_metres=metres is not None,
        )

    def _node(self, key: Hashable) -> _Node:
        """The element of a key, without what has no faces."""
        if key in self._nodes:
            known = self._nodes[key]
            if known is None:
                raise MeshError(f"{self._element_of(key).title} is a part of itself; correct it")
            return known
        self._nodes[key] = None
        element = self._element_of(key)
        pieces: list[tuple[FloatArray, Shape | _Node]] = []
        for matrix, each in element.pieces:
            piece = each if isinstance(each, Shape) else self._node(each)
            if not piece.n_faces:
                continue
            if matrix is None:
                raise MeshError(f"{element.title} {element.why_none}")
            if isinstance(piece, _Node) and len(piece.pieces) == 1:
                [(place, only)] = piece.pieces
                if isinstance(only, _Node):
                    matrix, piece = matrix @ place, only
            pieces.append((matrix, piece))
        totals = self._count([piece for _, piece in pieces])
        self._nodes[key] = node = _Node(element.name, pieces, *totals)
        return node

    def _count(self, pieces: Sequence[Shape | _Node]) -> tuple[int, int, int]:
        """Faces, vertices and shapes of these together, within the budget."""
        n_faces = sum(piece.n_faces for piece in pieces)
        n_vertices = sum(
            len(piece.points) if isinstance(piece, Shape) else piece.n_vertices for piece in pieces
        )
        n_shapes = sum(1 if isinstance(piece, Shape) else piece.n_shapes for piece in pieces)
        n_bytes = n_shapes * BYTES_PER_INSTANCE
        check_budget(n_faces, self._budget, n_vertices, n_bytes)
        return n_faces, n_vertices, n_shapes

    def _place(self, node: _Node, world_from_node: FloatArray) -> None:
        """Add the shapes of an instance, and those below it."""
        label = len(self._names)
        self._names.append(node.name)
        for matrix, piece in node.pieces:
            placed = world_from_node @ matrix
            if isinstance(piece, _Node):
                self._place(piece, placed)
                continue
            points, corners, n_corners, _ = piece
            if np.linalg.det(placed[:3, :3]) < 0:  # mirrored: it would face inwards
                corners = corners[_reversed_rows(n_corners)]
            self._vertices.append(points @ placed[:3, :3].T + placed[:3, 3])
            self._corners.append(corners + self._n_vertices)
            self._n_corners.append(n_corners)
            self._labels.append(np.full(len(n_corners), label))
            self._n_vertices += len(points)


def _reversed_rows(n_corners: IntArray) -> IntArray:
    """Indices that reverse the corners of each polygon but its first one."""
    polygon = np.repeat(np.arange(len(n_corners)), n_corners)
    first = (np.cumsum(n_corners) - n_corners)[polygon]
    place = np.arange(len(polygon)) - first
    return first + (n_corners[polygon] - place) % n_corners[polygon]
