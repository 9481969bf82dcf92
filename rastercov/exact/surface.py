"""A mesh as the exact methods want it: welded vertices, edges with their faces, self-contacts.

Serves `analytic` and `contour`: what depends on the mesh alone is worked out once and kept as long
as the mesh lives.
"""

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from rastercov._once import Once
from rastercov.mesh import Mesh
from rastercov.mesh.contacts import Contacts

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int32]

MANY = 2
"""`edge_turn` of an edge with more than two faces."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Faces and edges by position, so that vertices that files repeat along seams are one.

    Attributes
    ----------
    centre : (3,) float64
        The middle of the bounding box, metres.
    diagonal : float
        Of the bounding box, metres.
    vertices : (V, 3) float64
        Those that faces use, each position once. Not shifted: a difference of two positions is
        rounded once.
    faces : (F, 3) int32
        In the order of the mesh.
    flat : (F,) bool
        Faces without area.
    face_edges : (F, 3) int32
        Edge from each corner to the next.
    edge_vertices : (E, 2) int32
        Lower index first.
    edge_faces : (E, 2) int32
        Two of its faces; the second is -1 where there is one only.
    edge_turn : (E,) int8
        1 for one face, or two that run along the edge in opposite directions; -1 for two that run
        in the same; `MANY` for more than two.
    contacts : Contacts
        Faces that touch or cut another one.
    """

    centre: FloatArray
    diagonal: float
    vertices: FloatArray
    faces: IntArray
    flat: BoolArray
    face_edges: IntArray
    edge_vertices: IntArray
    edge_faces: IntArray
    edge_turn: NDArray[np.int8]
    contacts: Contacts


_SURFACES: WeakKeyDictionary[Mesh, Once[Surface]] = WeakKeyDictionary()


def surface_of(mesh: Mesh) -> Surface:
    """Surface of a mesh: worked out at the first call, about 1 s for a million faces."""
    return _SURFACES.setdefault(mesh, Once()).get(lambda: _build(mesh))


def _build(mesh: Mesh) -> Surface:
    is_used = np.zeros(mesh.n_vertices, dtype=bool)
    is_used[mesh.positions] = True
    row = np.cumsum(is_used) - 1
    faces = row[mesh.positions].astype(np.int32)
    face_edges, edge_vertices, edge_faces, edge_turn = _edges(faces, int(is_used.sum()))
    return Surface(
        centre=mesh.bounds.mean(axis=0),
        diagonal=float(np.linalg.norm(np.ptp(mesh.bounds, axis=0))),
        vertices=mesh.vertices[is_used],
        faces=faces,
        flat=np.ascontiguousarray(mesh.degenerate_mask),
        face_edges=face_edges,
        edge_vertices=edge_vertices,
        edge_faces=edge_faces,
        edge_turn=edge_turn,
        contacts=mesh.contacts,
    )


def _edges(
    faces: IntArray, n_vertices: int
) -> tuple[IntArray, IntArray, IntArray, NDArray[np.int8]]:
    """The four edge arrays of `Surface`, in its order.

    A face with a repeated vertex has an edge of no length: one with `MANY` faces, whatever meets
    there, so that no answer spreads along it.
    """
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    key = np.minimum(start, end).astype(np.int64) * n_vertices + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    key = key[order]
    is_first = np.ones(len(key), dtype=bool)
    is_first[1:] = key[1:] != key[:-1]
    first = np.flatnonzero(is_first)
    n_faces = np.diff(first, append=len(key))
    face_edges = np.empty(len(key), np.int32)
    face_edges[order] = np.cumsum(is_first) - 1
    low, high = key[first] // n_vertices, key[first] % n_vertices
    shared = first[n_faces >= 2]
    edge_faces = np.full((len(first), 2), -1, np.int32)
    edge_faces[:, 0] = order[first] // 3
    edge_faces[n_faces >= 2, 1] = order[shared + 1] // 3
    turn = np.ones(len(first), np.int8)
    is_forward = (start < end)[order]
    turn[n_faces >= 2] = np.where(is_forward[shared] != is_forward[shared + 1], 1, -1)
    turn[(n_faces > 2) | (low == high)] = MANY
    edge_vertices = np.stack((low, high), axis=1).astype(np.int32)
    return face_edges.reshape(-1, 3), edge_vertices, edge_faces, turn
