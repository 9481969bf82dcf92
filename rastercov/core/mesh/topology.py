"""Mesh topology: equal rows, the edge table, edge-connected components, faults of a surface.

Edges are found by sorting, components by hooking and pointer jumping.

Source: Y. Shiloach, U. Vishkin. An O(log n) Parallel Connectivity Algorithm. 1982.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from rastercov.base import AnyArray, BoolArray, IntArray, WholeArray, frozen_record, sort_order
from rastercov.core.mesh.arrays import blocks, frozen
from rastercov.engine import solver_surface


def first_equal_row(rows: NDArray[np.uint64]) -> IntArray:
    """(N,) index of the first of (N, 2) or (N, 3) rows that equals each row; its own if none does.

    The rows may have any bits; floats viewed as integers, for example.
    """
    first = np.empty(len(rows), np.int64)
    solver_surface.find_first_equal(np.ascontiguousarray(rows), first)
    return first


@frozen_record
class EdgeTable:
    """Edges of faces, sorted by their lower and then their higher vertex, each with its uses.

    Use number h is the edge of face h // 3 from corner h % 3 to the next corner.

    Attributes
    ----------
    key : (E,) uint64
        Lower vertex times `n_vertices` plus higher vertex.
    n_vertices : int
    first : (E,) int64
        Row of the first use of each edge in `uses`.
    n_uses : (E,) int64
        Uses of each edge, at least 1.
    uses : (U,) uint32 or uint64
        Uses of the first edge, then of the second, and so on; faces ascend within an edge.
    is_forward : (U,) bool
        True where the face runs along the edge from the lower to the higher vertex.
    """

    key: NDArray[np.uint64]
    n_vertices: int
    first: IntArray
    n_uses: IntArray
    uses: AnyArray
    is_forward: BoolArray

    @property
    def vertices(self) -> NDArray[np.uint64]:
        """(E, 2) lower and higher vertex of each edge."""
        return np.stack(np.divmod(self.key, np.uint64(self.n_vertices)), axis=1)

    @property
    def faces(self) -> IntArray:
        """(U,) face of each use."""
        return (self.uses // 3).astype(np.int64)


def edge_table(faces: WholeArray, n_vertices: int) -> EdgeTable:
    """Table of the edges of `faces`, (F, 3) indices below `n_vertices`.

    A collapsed face, which repeats a vertex, is left out.
    """
    n_bits = (6 * len(faces)).bit_length()  # of 2 use + is_forward
    key = np.empty(3 * len(faces), np.uint64)
    code: AnyArray = np.empty(len(key), np.uint32 if n_bits <= 32 else np.uint64)
    n = 0
    for block in blocks(len(faces)):
        start = faces[block].astype(np.int64, copy=False)
        index = np.arange(6 * block.start, 6 * (block.start + len(start)), 2).reshape(-1, 3)
        end = start[:, [1, 2, 0]]
        has_edges = (start != end).all(axis=1)
        if not has_edges.all():
            start, end, index = start[has_edges], end[has_edges], index[has_edges]
        part = slice(n, n + start.size)
        key[part] = (np.minimum(start, end) * n_vertices + np.maximum(start, end)).ravel()
        code[part] = (index + (start < end)).ravel()
        n = part.stop
    key, code = key[:n], code[:n]
    if (n_vertices**2).bit_length() + n_bits <= 64:  # in one number, which sorts faster
        key <<= np.uint64(n_bits)
        key |= code
        key.sort()
        np.bitwise_and(key, np.uint64(2**n_bits - 1), out=code, casting="unsafe")
        key >>= np.uint64(n_bits)
    else:
        order = sort_order(key)
        key, code = key[order], code[order]
    is_forward = np.bitwise_and(code, 1, out=np.empty(n, bool), casting="unsafe")
    code >>= 1
    is_first = np.ones(n, bool)
    is_first[1:] = key[1:] != key[:-1]
    first = np.flatnonzero(is_first)
    n_uses = np.diff(first, append=n)
    return EdgeTable(key[first], n_vertices, first, n_uses, code, is_forward)


@dataclass(frozen=True)
class Topology:
    """Counts of a mesh's edges by their number of faces, and its face adjacency.

    Attributes
    ----------
    n_faces : int
        Faces of the mesh.
    n_boundary_edges, n_shared_edges, n_nonmanifold_edges : int
        Edges with one, two and more faces.
    n_inconsistent_edges : int
        Edges with two faces that run along them in the same direction.
    neighbours : (N, 2) int64
        Pairs of faces that share an edge; at an edge of n faces, n - 1 pairs that connect them.
    """

    n_faces: int
    n_boundary_edges: int
    n_shared_edges: int
    n_nonmanifold_edges: int
    n_inconsistent_edges: int
    neighbours: IntArray

    @classmethod
    def of(cls, faces: IntArray, n_vertices: int) -> Self:
        """Topology of `faces`, (F, 3) indices below `n_vertices`.

        A face with a repeated vertex does not count: its neighbours share an edge without it. A
        face without area between three points counts: it closes a T-junction.
        """
        table = edge_table(faces, n_vertices)
        n_uses = table.n_uses
        shared = table.first[n_uses == 2]
        is_later = np.ones(len(table.uses), bool)
        is_later[table.first] = False
        later = np.flatnonzero(is_later)
        neighbours = np.empty((len(later), 2), np.int64)
        neighbours[:, 1] = table.uses[later] // 3
        later -= 1
        neighbours[:, 0] = table.uses[later] // 3
        is_forward = table.is_forward
        return cls(
            n_faces=len(faces),
            n_boundary_edges=int((n_uses == 1).sum()),
            n_shared_edges=len(shared),
            n_nonmanifold_edges=int((n_uses > 2).sum()),
            n_inconsistent_edges=int((is_forward[shared] == is_forward[shared + 1]).sum()),
            neighbours=frozen(neighbours),
        )

    @property
    def is_closed(self) -> bool:
        """True if there are edges, each with exactly two faces."""
        return self.n_shared_edges > 0 and not (self.n_boundary_edges or self.n_nonmanifold_edges)

    def components(self) -> IntArray:
        """(F,) number of each face's edge-connected component, from 0 in order of first face."""
        return components_of(self.n_faces, self.neighbours)


def components_of(count: int, pairs: WholeArray) -> IntArray:
    """(N,) number of the component of each of N things, (M, 2) pairs of which are neighbours.

    From 0, in the order of the first of each component.
    """
    dtype = np.int32 if count < 2**31 else np.int64  # int32 halves the memory
    root = np.arange(count, dtype=dtype)
    left, right = pairs.T.astype(dtype)
    while True:  # about log N rounds: each joins every root that has a lower neighbour
        a, b = root[left], root[right]
        apart = a != b
        if not apart.any():
            break
        left, right, a, b = left[apart], right[apart], a[apart], b[apart]
        root[np.maximum(a, b)] = np.minimum(a, b)
        while not np.array_equal(root, jumped := root[root]):
            root = jumped
    number = np.cumsum(root == np.arange(count)) - 1
    return number[root]
