"""Arrays of the surface of a mesh, by name."""

from collections import namedtuple
from dataclasses import dataclass

import numpy as np

from rastercov.base.arguments import FloatArray, Int32Array, IntArray
from rastercov.base.threads import once_each
from rastercov.core.exact import surface
from rastercov.core.mesh.contacts import Partners
from rastercov.engine import solver_parts, solver_surface

Blocks = namedtuple(
    "Blocks", "has_flat patch patch_starts of_patch lowest joins is_plain starts of_edges"
)
"""Blocks of `BLOCK` faces of a surface, and of `BLOCK` consecutive edges.

A patch is a part of a block whose faces are joined by edges that two of them use in opposite
directions.

Attributes
----------
has_flat : (N,) bool
    Blocks with a face without area.
patch : (F,) int32
    Patch of each face.
patch_starts : (N + 1,) int32
    The patches of block b are patch_starts[b] ... patch_starts[b + 1] - 1.
of_patch : (C,) int32
    Block of each patch.
lowest : (C,) int32
    Lowest face of each patch.
joins : (J, 2) int32
    Pairs of patches with a common edge of two faces, the lower one first; the complement ~c of the
    other where both faces run along the edge in the same direction.
is_plain : (M,) bool
    Blocks of edges that all have two faces which run along them in opposite directions.
starts : (M + 1,) int32
    The blocks of the faces of edges m are of_edges[starts[m]] ... of_edges[starts[m + 1] - 1], of
    those that are plain.
of_edges : (Q,) int32
"""

Edges = namedtuple("Edges", "vertices faces kind of_face")
"""Edges of a surface.

Attributes
----------
vertices : (E, 2) int32
    Lower index first.
faces : (E, 2) int32
    Two of its faces; the second is -1 where there is only one.
kind : (E,) int8
    `CONSISTENT`, `REVERSED` or `NON_MANIFOLD`.
of_face : (F, 3) int32
    Edge from each corner of a face to the next.
"""


@dataclass(frozen=True, eq=False)
class Targets:
    """Faces that hide nothing. They share no vertex and no edge with the surface.

    Attributes
    ----------
    vertices, faces, blocks, source
        As of `Surface`; faces in the order of the mesh.
    """

    vertices: FloatArray
    faces: Int32Array
    blocks: Blocks
    source: IntArray


class Surface:
    """Faces and edges by position: vertices that files repeat along seams are merged.

    All attributes but the last two are those of the opaque faces, bit for bit as without targets.

    Attributes
    ----------
    native : solver_surface.Surface
        What the engine takes.
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
    edges : Edges
        Edges by position, see `Edges`.
    blocks : Blocks
        Groups of faces that are looked at together, see `Blocks`.
    rank : (F,) int32
        Index of each face among the opaque faces of the mesh, which decides where surfaces tie.
    source : (V,) int64
        Vertex of the opaque part of the mesh that each vertex is.
    place : (F,) int64 or None
        Place of each face of the mesh among the faces of the surface and, after them, the targets;
        None where it is its own index.
    targets : Targets or None
        The other faces of the mesh, if it has any.
    """

    def __init__(self, native: solver_surface.Surface):
        self.native, self.rank = native, solver_parts.rank(native)
        self.centre, self.diagonal = np.array(solver_parts.centre(native)), native.diagonal
        self.vertices, self.faces, self.blocks, self.source = _part(solver_parts.opaque(native))
        self.edges = Edges(*solver_parts.edges(native))
        place = solver_parts.place(native)
        self.place = place if len(place) else None
        targets = Targets(*_part(solver_parts.targets(native)))
        self.targets = targets if len(targets.faces) else None

    @property
    def n_faces(self):
        """Number of opaque faces and of targets together."""
        return len(self.faces) + (0 if self.targets is None else len(self.targets.faces))

    @property
    def rows(self):
        """Index that puts figures of `n_faces` faces in the order of the mesh."""
        return slice(None) if self.place is None else self.place

    def contacts(self, distance: float):
        """Faces in contact, (F,), and with which; see `mesh.contacts.Contacts`."""
        faces, *partners = solver_parts.contacts(self.native, distance)
        return faces, Partners(*partners)


def _part(part):
    vertices, faces, blocks, source = part
    return vertices, faces, Blocks(*blocks), source


@once_each
def surface_of(mesh, least_sorted=surface.LEAST_SORTED):
    """Surface of a mesh, which the engine has, too."""
    return Surface(surface.surface_of(mesh, least_sorted))
