"""Surface of a mesh for the exact methods: welded vertices, edges with their faces, contacts.

It depends on the mesh alone, is built once, and is kept as long as the mesh exists.
"""

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from rastercov._once import Once
from rastercov.exact.records import CONSISTENT, NON_MANIFOLD, REVERSED, Edges
from rastercov.mesh import Mesh
from rastercov.mesh.contacts import Contacts

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Surface:
    """Faces and edges by position: vertices that files repeat along seams are merged.

    Attributes
    ----------
    centre : (3,) float64
        Centre of the bounding box, metres.
    diagonal : float
        Diagonal of the bounding box, metres.
    vertices : (V, 3) float64
        Positions that faces use, each once. Not shifted: a difference of two positions is rounded
        once.
    faces : (F, 3) int32
        Vertices of each face, in the order of the mesh.
    flat : (F,) bool
        Faces without area.
    edges : Edges
        Edges by position, see `records.Edges`.
    contacts : Contacts
        Faces that touch or cut another one.
    """

    centre: FloatArray
    diagonal: float
    vertices: FloatArray
    faces: IntArray
    flat: BoolArray
    edges: Edges
    contacts: Contacts


_SURFACES: WeakKeyDictionary[Mesh, Once[Surface]] = WeakKeyDictionary()


def surface_of(mesh: Mesh) -> Surface:
    """Surface of a mesh, built at the first call: about 1 s for a million faces."""
    return _SURFACES.setdefault(mesh, Once()).get(lambda: _build(mesh))


def _build(mesh: Mesh) -> Surface:
    is_used = np.zeros(mesh.n_vertices, dtype=bool)
    is_used[mesh.positions] = True
    row = np.cumsum(is_used) - 1
    faces = row[mesh.positions].astype(np.int32)
    return Surface(
        centre=mesh.bounds.mean(axis=0),
        diagonal=float(np.linalg.norm(np.ptp(mesh.bounds, axis=0))),
        vertices=mesh.vertices[is_used],
        faces=faces,
        flat=np.ascontiguousarray(mesh.degenerate_mask),
        edges=_edges(faces, int(is_used.sum())),
        contacts=mesh.contacts,
    )


def _edges(faces: IntArray, n_vertices: int) -> Edges:
    """Build the edges of all faces.

    A face with a repeated vertex has an edge of no length, which is `NON_MANIFOLD` whatever its
    number of faces, so that no result spreads along it.
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
    kind = np.full(len(first), CONSISTENT, np.int8)
    is_forward = (start < end)[order]
    is_consistent = is_forward[shared] != is_forward[shared + 1]
    kind[n_faces >= 2] = np.where(is_consistent, CONSISTENT, REVERSED)
    kind[(n_faces > 2) | (low == high)] = NON_MANIFOLD
    edge_vertices = np.stack((low, high), axis=1).astype(np.int32)
    return Edges(edge_vertices, edge_faces, kind, face_edges.reshape(-1, 3))
