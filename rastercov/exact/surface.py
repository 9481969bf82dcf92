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
from rastercov.mesh.topology import edge_table

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
    table = edge_table(faces, n_vertices, with_collapsed=True)
    n_uses, is_forward = table.n_uses, table.is_forward
    face_edges = np.empty(faces.size, np.int32)
    face_edges[table.uses] = np.repeat(np.arange(len(n_uses)), n_uses)
    edge_vertices = table.vertices.astype(np.int32)
    shared = table.first[n_uses >= 2]
    edge_faces = np.full((len(n_uses), 2), -1, np.int32)
    edge_faces[:, 0] = table.uses[table.first] // 3
    edge_faces[n_uses >= 2, 1] = table.uses[shared + 1] // 3
    turn = np.ones(len(n_uses), np.int8)
    turn[n_uses >= 2] = np.where(is_forward[shared] != is_forward[shared + 1], 1, -1)
    turn[(n_uses > 2) | (edge_vertices[:, 0] == edge_vertices[:, 1])] = MANY
    return face_edges.reshape(-1, 3), edge_vertices, edge_faces, turn
