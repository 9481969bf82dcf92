"""Surface of a mesh for the exact methods: welded vertices, edges with their faces, contacts.

It depends on the mesh alone, is built once, and is kept as long as the mesh exists.

Blocks are groups of 64 faces that the passes over a surface decide together. A pose sees most
blocks from one side, wholly inside or wholly outside the image, and no event edge near them. What
follows from that for all of their faces is then decided once. Blocks are consecutive faces of the
surface, in the order of the mesh where that is local, as generators and CAD programs write it, or
where the mesh is small; otherwise sorted along a curve that fills space.

G. M. Morton. A Computer Oriented Geodetic Data Base and a New Technique in File Sequencing. 1966.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from rastercov.base.memory import BoolArray, FloatArray, Int32Array
from rastercov.base.threads import Once
from rastercov.exact.records import BLOCK, CONSISTENT, NON_MANIFOLD, REVERSED, Blocks, Edges
from rastercov.mesh import Mesh
from rastercov.mesh.contacts import Contacts, Partners
from rastercov.mesh.topology import edge_table
from rastercov.native.exact_setup import check_surface, find_patches

Kept = TypeVar("Kept")


MOST_VERTICES = 96
"""Vertices of the faces of a block, on average, up to which the order of the mesh is local: a strip
of them has 66, faces in any order 192."""
LEAST_FACES = 1 << 14
"""Faces from which on they, and vertices, are sorted: figures of fewer fit the cache in any order.
"""
BITS = 10
"""Bits of each coordinate along the curve."""


def local_order(vertices: FloatArray, faces: Int32Array) -> Int32Array | None:
    """(F,) faces in an order in which neighbours are close; None where that of the mesh is."""
    n = len(faces) // BLOCK
    if len(faces) < LEAST_FACES:
        return None
    used = np.sort(faces[: n * BLOCK].reshape(n, 3 * BLOCK), axis=1)
    n_vertices = n + np.count_nonzero(used[:, 1:] != used[:, :-1])
    return _along_curve(vertices, faces) if n_vertices > MOST_VERTICES * n else None


def blocks_of(flat: BoolArray, edges: Edges) -> Blocks:
    """Blocks of the faces of a surface, which are in an order of `local_order`."""
    n = -(-len(flat) // BLOCK)
    has_flat = np.zeros(n, np.bool_)
    has_flat[np.flatnonzero(flat) // BLOCK] = True
    lowest_of = np.empty(len(flat), np.int32)
    find_patches(edges, lowest_of)
    lowest = np.flatnonzero(lowest_of == np.arange(len(flat))).astype(np.int32)
    number = np.empty(len(flat), np.int32)
    number[lowest] = np.arange(len(lowest))
    patch = number[lowest_of]
    patch_starts = np.searchsorted(lowest, np.arange(n + 1) * BLOCK).astype(np.int32)
    return Blocks(
        has_flat=has_flat, patch=patch, patch_starts=patch_starts, of_patch=lowest // BLOCK,
        lowest=lowest, joins=_joins(edges, patch), **_blocks_of_edges(edges),
    )  # fmt: skip


def _joins(edges: Edges, patch: Int32Array) -> Int32Array:
    """(J, 2) pairs of patches with a common edge of two faces, see `records.Blocks`."""
    has_two = (edges.faces[:, 1] >= 0) & (edges.kind != NON_MANIFOLD)
    one, other = np.sort(patch[edges.faces[has_two]], axis=1).T
    is_consistent, are_two = edges.kind[has_two] == CONSISTENT, one != other
    pairs = np.stack((one, np.where(is_consistent, other, ~other)), axis=1)[are_two]
    return np.unique(pairs.view(np.int64)).view(np.int32).reshape(-1, 2)


def _blocks_of_edges(edges: Edges) -> dict[str, Any]:
    """Blocks of the faces of each `BLOCK` consecutive edges, see `records.Blocks`."""
    n, rest = -(-len(edges.kind) // BLOCK), -len(edges.kind) % BLOCK
    is_plain = np.ones(n, np.bool_)
    is_odd = (edges.kind != CONSISTENT) | (edges.faces[:, 1] < 0)
    is_plain[np.flatnonzero(is_odd) // BLOCK] = False
    blocks = np.pad(edges.faces // BLOCK, ((0, rest), (0, 0)), "edge").reshape(n, 2 * BLOCK)
    blocks.sort(axis=1)
    is_new = np.diff(blocks, axis=1, prepend=-2) != 0
    is_new[~is_plain] = False
    starts = np.concatenate(([0], np.cumsum(is_new.sum(axis=1)))).astype(np.int32)
    return {"is_plain": is_plain, "starts": starts, "of_edges": blocks[is_new]}


def _along_curve(vertices: FloatArray, faces: Int32Array) -> Int32Array:
    """Faces in the order of their centroids along a curve that fills space."""
    centroids = vertices[faces].mean(axis=1)
    low, high = centroids.min(axis=0), centroids.max(axis=0)
    extent = float((high - low).max())
    cells = (1 << BITS) - 1
    place = (centroids - low) / extent * cells if extent > 0 else np.zeros_like(centroids)
    column = np.clip(np.nan_to_num(place), 0, cells).astype(np.uint32)
    key = np.zeros(len(faces), np.uint32)
    for bit in range(BITS):
        for axis in range(3):
            key |= (column[:, axis] >> np.uint32(bit) & np.uint32(1)) << np.uint32(3 * bit + axis)
    return np.argsort(key, kind="stable").astype(np.int32)


@dataclass(frozen=True, eq=False)
class Targets:
    """Faces that hide nothing. They share no vertex and no edge with the surface.

    Attributes
    ----------
    vertices, faces, flat, blocks, source
        As of `Surface`; faces in the order of the mesh.
    """

    vertices: FloatArray
    faces: Int32Array
    flat: BoolArray
    blocks: Blocks
    source: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class SortedContacts:
    """Contacts of the faces of a mesh, sorted as the faces of a surface are.

    Attributes
    ----------
    contacts : Contacts
        Of the mesh.
    order, place : (F,) int32
        Face of the mesh of each face of the surface, and the reverse.
    """

    contacts: Contacts
    order: Int32Array
    place: Int32Array
    _sorted: dict[int, tuple[Any, Once[Any]]] = field(default_factory=dict, init=False)

    def faces_for(self, distance: float = 0.0) -> BoolArray:
        """(F,) faces in contact; see `Contacts`."""
        return self._once(self.contacts.faces_for(distance), lambda own: own[self.order])

    def partners_for(self, distance: float = 0.0) -> Partners:
        """Faces in contact with each face; see `Contacts`."""
        return self._once(self.contacts.partners_for(distance), self._sort_partners)

    def _sort_partners(self, own: Partners) -> Partners:
        counts = np.diff(own.starts)[self.order]
        starts = np.concatenate(([0], np.cumsum(counts)))
        at = np.repeat(own.starts[self.order] - starts[:-1], counts) + np.arange(starts[-1])
        return Partners(starts, self.place[own.faces[at]])

    def _once(self, own: Kept, sort: Callable[[Kept], Kept]) -> Kept:
        """Sort what the mesh keeps, once; an entry holds it, so that no other has its id."""
        return self._sorted.setdefault(id(own), (own, Once()))[1].get(lambda: sort(own))


@dataclass(frozen=True, eq=False)
class Surface:
    """Faces and edges by position: vertices that files repeat along seams are merged.

    All attributes but the last two are those of the opaque faces, bit for bit as without targets.

    Attributes
    ----------
    centre : (3,) float64
        Centre of the bounding box, metres.
    diagonal : float
        Diagonal of the bounding box, metres.
    vertices : (V, 3) float64
        Positions that faces use, each once; of a large mesh in the order of their use. Not shifted:
        a difference of two positions is rounded once.
    faces : (F, 3) int32
        Vertices of each face. They are in the order of the mesh unless neighbours are far from one
        another there, see `blocks`.
    flat : (F,) bool
        Faces without area.
    edges : Edges
        Edges by position, see `records.Edges`.
    blocks : Blocks
        Groups of faces that are looked at together, see `records.Blocks`.
    rank : (F,) int32
        Index of each face among the opaque faces of the mesh, which decides where surfaces tie.
    contacts : Contacts or SortedContacts
        Faces that touch or cut another one.
    source : (V,) int64
        Vertex of the opaque part of the mesh that each vertex is.
    place : (F,) int64 or None
        Place of each face of the mesh among the faces of the surface and, after them, the targets;
        None where it is its own index.
    targets : Targets or None
        The other faces of the mesh, if it has any.
    """

    centre: FloatArray
    diagonal: float
    vertices: FloatArray
    faces: Int32Array
    flat: BoolArray
    edges: Edges
    blocks: Blocks
    rank: Int32Array
    contacts: Contacts | SortedContacts
    source: NDArray[np.int64]
    place: NDArray[np.int64] | None = None
    targets: Targets | None = None

    @property
    def n_faces(self) -> int:
        """Number of opaque faces and of targets together."""
        return len(self.faces) + (0 if self.targets is None else len(self.targets.faces))

    @property
    def rows(self) -> Any:
        """Index that puts figures of `n_faces` faces in the order of the mesh."""
        return slice(None) if self.place is None else self.place


_SURFACES: WeakKeyDictionary[Mesh, Once[Surface]] = WeakKeyDictionary()


def surface_of(mesh: Mesh) -> Surface:
    """Surface of a mesh, built at the first call: about 1 s for a million faces."""
    moved = mesh.moved_from
    if moved is None or not len(moved.poses):
        return _SURFACES.setdefault(mesh, Once()).get(lambda: _build(mesh))
    rest = surface_of(moved.rest.mesh)
    return _SURFACES.setdefault(mesh, Once()).get(lambda: _moved(rest, mesh))


def _moved(rest: Surface, mesh: Mesh) -> Surface:
    """Surface of a mesh that shares all but positions and contacts with one at rest."""
    opaque, targets = mesh.opaque, rest.targets
    contacts: Contacts | SortedContacts = opaque.contacts
    if isinstance(rest.contacts, SortedContacts):
        contacts = SortedContacts(opaque.contacts, rest.contacts.order, rest.contacts.place)
    if targets is not None:
        targets = replace(targets, vertices=mesh.vertices[targets.source])
    return replace(
        rest, vertices=opaque.vertices[rest.source], centre=opaque.bounds.mean(axis=0),
        diagonal=_diagonal(opaque), contacts=contacts, targets=targets,
    )  # fmt: skip


def _diagonal(mesh: Mesh) -> float:
    return float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))


def _build(mesh: Mesh) -> Surface:
    if mesh.has_targets:
        opaque = surface_of(mesh.opaque)
        return replace(opaque, targets=_targets(mesh), place=_place_of_all(mesh, opaque))
    contacts: Contacts | SortedContacts = mesh.contacts
    faces, source = _welded(mesh.welded_faces, mesh.n_vertices)
    vertices, flat = mesh.vertices[source], np.ascontiguousarray(mesh.degenerate_mask)
    rank, place = np.arange(len(faces), dtype=np.int32), None
    order = local_order(vertices, faces)
    if order is not None:
        rank, place = order, np.argsort(order)
        faces, flat = faces[order], flat[order]
        contacts = SortedContacts(mesh.contacts, order, place.astype(np.int32))
    if len(faces) >= LEAST_FACES:
        by_use, faces = _by_use(faces, len(source))
        vertices, source = vertices[by_use], source[by_use]
    edges = _edges(faces, len(vertices))
    blocks = blocks_of(flat, edges)
    check_surface(len(vertices), faces, edges, blocks)
    return Surface(
        centre=mesh.bounds.mean(axis=0),
        diagonal=_diagonal(mesh),
        vertices=vertices, faces=faces, flat=flat, edges=edges, blocks=blocks,
        rank=rank, contacts=contacts, source=source, place=place,
    )  # fmt: skip


def _welded(positions: NDArray[np.int64], n_vertices: int) -> tuple[Int32Array, NDArray[np.int64]]:
    """Faces by number of their positions, and the vertex that each number is."""
    is_used = np.zeros(n_vertices, dtype=bool)
    is_used[positions] = True
    row = np.cumsum(is_used) - 1
    return row[positions].astype(np.int32), np.flatnonzero(is_used)


def _by_use(faces: Int32Array, n_vertices: int) -> tuple[NDArray[np.int64], Int32Array]:
    """Vertices in the order in which faces use them first, and the faces by their new numbers.

    Those of a block are then close.
    """
    uses = faces.ravel()
    first = np.empty(n_vertices, np.int64)
    first[uses[::-1]] = np.arange(len(uses))[::-1]  # of equal indices the last one is kept
    by_use = np.argsort(first)
    number = np.empty(n_vertices, np.int32)
    number[by_use] = np.arange(n_vertices, dtype=np.int32)
    return by_use, number[faces]


def _targets(mesh: Mesh) -> Targets:
    is_target = mesh.target_mask
    faces, source = _welded(mesh.welded_faces[is_target], mesh.n_vertices)
    vertices, flat = mesh.vertices[source], np.ascontiguousarray(mesh.degenerate_mask[is_target])
    edges = _edges(faces, len(vertices))
    blocks = blocks_of(flat, edges)
    check_surface(len(vertices), faces, edges, blocks)
    return Targets(vertices, faces, flat, blocks, source)


def _place_of_all(mesh: Mesh, opaque: Surface) -> NDArray[np.int64]:
    """Place of each face of a mesh with targets, which follow the opaque faces."""
    is_target = mesh.target_mask
    place = np.empty(mesh.n_faces, np.int64)
    # The opaque part of a mesh of targets only has one face, which is no face of the mesh.
    place[~is_target] = np.arange(len(opaque.faces))[opaque.rows][: np.count_nonzero(~is_target)]
    place[is_target] = len(opaque.faces) + np.arange(np.count_nonzero(is_target))
    return place


def _edges(faces: Int32Array, n_vertices: int) -> Edges:
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
