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
from rastercov.mesh.topology import edge_table

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
    table = edge_table(faces, n_vertices, with_collapsed=True)
    n_uses, is_forward = table.n_uses, table.is_forward
    face_edges = np.empty(faces.size, np.int32)
    face_edges[table.uses] = np.repeat(np.arange(len(n_uses)), n_uses)
    edge_vertices = table.vertices.astype(np.int32)
    shared = table.first[n_uses >= 2]
    edge_faces = np.full((len(n_uses), 2), -1, np.int32)
    edge_faces[:, 0] = table.uses[table.first] // 3
    edge_faces[n_uses >= 2, 1] = table.uses[shared + 1] // 3
    kind = np.full(len(n_uses), CONSISTENT, np.int8)
    is_consistent = is_forward[shared] != is_forward[shared + 1]
    kind[n_uses >= 2] = np.where(is_consistent, CONSISTENT, REVERSED)
    kind[(n_uses > 2) | (edge_vertices[:, 0] == edge_vertices[:, 1])] = NON_MANIFOLD
    return Edges(edge_vertices, edge_faces, kind, face_edges.reshape(-1, 3))
