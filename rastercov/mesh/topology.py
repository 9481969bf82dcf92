"""How faces meet: equal rows, edges, and edge-connected components.

Serves `mesh`: integers in, counts out, whole arrays at a time. Equal rows and edges are found by
sorting, components by hooking roots together and jumping along pointers.

Source: Y. Shiloach, U. Vishkin. An O(log n) Parallel Connectivity Algorithm. 1982.
"""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from rastercov.mesh.arrays import blocks, frozen

ODD_MULTIPLIERS = (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9)


def first_equal_row(rows: NDArray[np.uint64]) -> NDArray[np.int64]:
    """Index of the first row that equals each row.

    Parameters
    ----------
    rows : (N, 2) or (N, 3) uint64
        N > 0, any bits; floats viewed as integers, for example.

    Returns
    -------
    (N,) int64
        At most the row's own index, which it is for a row that has no earlier twin.
    """
    digest = np.zeros(len(rows), dtype=np.uint64)
    for column, multiplier in zip(rows.T, ODD_MULTIPLIERS, strict=False):
        digest = (digest ^ column) * np.uint64(multiplier)
        digest ^= digest >> np.uint64(29)
    order = np.argsort(digest)
    is_first = np.ones(len(rows), dtype=bool)
    is_first[1:] = digest[order[1:]] != digest[order[:-1]]
    if not _equals_previous(rows, order)[~is_first].all():  # two rows with one digest
        order = np.lexsort(rows.T)
        is_first = ~_equals_previous(rows, order)
    starts = np.flatnonzero(is_first)
    lowest = np.minimum.reduceat(order, starts)
    first = np.empty(len(rows), dtype=np.int64)
    first[order] = np.repeat(lowest, np.diff(starts, append=len(rows)))
    return first


def _equals_previous(rows: NDArray[np.uint64], order: NDArray[np.int64]) -> NDArray[np.bool_]:
    equals = np.ones(len(rows), dtype=bool)
    equals[0] = False
    for column in rows.T:
        in_order = column[order]
        equals[1:] &= in_order[1:] == in_order[:-1]
    return equals


def _sorted_edges(
    faces: NDArray[np.int64], n_vertices: int
) -> tuple[NDArray[np.uint64], NDArray[Any], NDArray[np.bool_]]:
    """Edges in order, each with its face, and whether the face runs along it upwards.

    Equal keys are equal edges. Faces with a repeated vertex are left out.
    """
    n_bits = len(faces).bit_length()
    key = np.empty(3 * len(faces), np.uint64)
    # 2 face + is forward
    code: NDArray[Any] = np.empty(len(key), np.uint32 if n_bits < 32 else np.uint64)
    n = 0
    for block in blocks(len(faces)):
        start = faces[block]
        index = 2 * np.arange(block.start, block.start + len(start))[:, None]
        end = start[:, [1, 2, 0]]
        has_edges = (start != end).all(axis=1)
        start, end, index = start[has_edges], end[has_edges], index[has_edges]
        part = slice(n, n + start.size)
        key[part] = (np.minimum(start, end) * n_vertices + np.maximum(start, end)).ravel()
        code[part] = (index + (start < end)).ravel()
        n = part.stop
    key, code = key[:n], code[:n]
    if (n_vertices**2).bit_length() + n_bits + 1 <= 64:  # in one number, which sorts quicker
        key <<= np.uint64(n_bits + 1)
        key |= code
        key.sort()
        np.bitwise_and(key, np.uint64(2 ** (n_bits + 1) - 1), out=code, casting="unsafe")
        key >>= np.uint64(n_bits + 1)
    else:
        order = np.argsort(key, kind="stable")
        key, code = key[order], code[order]
    is_forward = np.bitwise_and(code, 1, out=np.empty(n, bool), casting="unsafe")
    code >>= 1
    return key, code, is_forward


@dataclass(frozen=True)
class Topology:
    """Edges of a mesh, counted by how many faces they have.

    Attributes
    ----------
    n_faces : int
        Faces of the mesh.
    n_boundary_edges, n_shared_edges, n_nonmanifold_edges : int
        Edges with one, two and more faces.
    n_inconsistent_edges : int
        Edges with two faces that run along them in the same direction.
    neighbours : (N, 2) int64
        Pairs of faces that share an edge, enough of them to connect all that meet there.
    """

    n_faces: int
    n_boundary_edges: int
    n_shared_edges: int
    n_nonmanifold_edges: int
    n_inconsistent_edges: int
    neighbours: NDArray[np.int64]

    @classmethod
    def of(cls, faces: NDArray[np.int64], n_vertices: int) -> Self:
        """Topology of `faces`, (F, 3) indices below `n_vertices`.

        A face with a repeated vertex is a flap on an edge that its neighbours share, so it does
        not count; one without area between three points closes a T-junction, so it does.
        """
        key, face, is_forward = _sorted_edges(faces, n_vertices)
        is_first = np.ones(len(key), dtype=bool)
        is_first[1:] = key[1:] != key[:-1]
        del key  # large, like all that is deleted here: half of what meshes need at most
        first = np.flatnonzero(is_first)
        n_uses = np.diff(first, append=len(face))
        n_boundary, n_nonmanifold = int((n_uses == 1).sum()), int((n_uses > 2).sum())
        shared = first[n_uses == 2]
        del first, n_uses
        n_shared = len(shared)
        n_inconsistent = int((is_forward[shared] == is_forward[shared + 1]).sum())
        del shared, is_forward
        later = np.flatnonzero(~is_first)
        neighbours = np.empty((len(later), 2), np.int64)
        neighbours[:, 1] = face[later]
        later -= 1
        neighbours[:, 0] = face[later]
        return cls(
            n_faces=len(faces),
            n_boundary_edges=n_boundary,
            n_shared_edges=n_shared,
            n_nonmanifold_edges=n_nonmanifold,
            n_inconsistent_edges=n_inconsistent,
            neighbours=frozen(neighbours),
        )

    @property
    def is_closed(self) -> bool:
        """Whether there are edges, each with exactly two faces."""
        return self.n_shared_edges > 0 and not (self.n_boundary_edges or self.n_nonmanifold_edges)

    def components(self) -> NDArray[np.int64]:
        """(F,) number of each face's edge-connected component, from 0 in order of first face."""
        # Half the memory, unless faces are too many.
        whole = np.int32 if self.n_faces < 2**31 else np.int64
        root = np.arange(self.n_faces, dtype=whole)
        left, right = self.neighbours.T.astype(whole)
        while True:  # about log F rounds: each joins every root that has a lower neighbour
            a, b = root[left], root[right]
            apart = a != b
            if not apart.any():
                break
            left, right, a, b = left[apart], right[apart], a[apart], b[apart]
            root[np.maximum(a, b)] = np.minimum(a, b)
            while not np.array_equal(root, jumped := root[root]):
                root = jumped
        number = np.cumsum(root == np.arange(self.n_faces)) - 1
        part: NDArray[np.int64] = number[root]
        return part
