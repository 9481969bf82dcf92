"""Points in matter: in solids, beyond the walls of a room, or behind one-sided open components.

Winding numbers are those of rays, whose crossings a tree of boxes finds; behind open components
are points from which most directions first meet the back of one.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    BoolArray,
    FloatArray,
    IntArray,
    finite_points,
    matmul,
    offsets_of,
    once_each,
    owners_of,
    sort_order,
)
from rastercov.base.typed import typed
from rastercov.core.mesh.arrays import encloses_volume, rotation_about
from rastercov.core.mesh.contacts import TriangleTree
from rastercov.core.mesh.mesh import Mesh
from rastercov.core.mesh.topology import edge_table

ROOM_TOLERANCE_REL = 0.01
"""Length, in diagonals of the mesh, by which parts may extend beyond the walls of a room."""
RAY_FRAME = rotation_about((2.0, 3.0, 5.0), 0.3)
"""(3, 3) rotation to the frame of the rays, whose axes are parallel to no usual surface."""


@typed
def in_solid(mesh: Mesh, points: ArrayLike) -> BoolArray:
    """(N,) True for each of (N, 3) points in solid material, as defined by `filter_candidates`.

    The winding number is the median of those along three rays, and open components are judged by
    32 directions. The answer is arbitrary for a point on a closed surface.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import in_solid
    >>> in_solid(rc.shapes.box(), [(0, 0, 0), (2, 0, 0)]).tolist()
    [True, False]
    """
    wanted = finite_points(
        "points", points, (*np.shape(points)[:-1], 3), "finite and of shape (N, 3)"
    ).reshape(-1, 3)
    return matter_of(mesh).holds(wanted)


def rooms_at(mesh: Mesh, points: FloatArray) -> list[str]:
    """Label of the space of a building in which each of (N, 3) points is; "" for none."""
    values = np.zeros(len(points), object)
    for product, space in mesh.spaces:
        low, high = space.bounds
        near = np.flatnonzero((values == 0) & ((low < points) & (points < high)).all(axis=1))
        if len(near):
            values[near[in_solid(space, points[near])]] = product.label
    return [each or "" for each in values]


class Matter:
    """Matter of a mesh, as of `in_solid`, for several questions."""

    def __init__(self, mesh: Mesh) -> None:
        mesh = mesh.opaque
        solid = closed_parts(mesh)
        self._winding = Winding(mesh, solid.faces) if len(solid.faces) else None
        self._outside = -int(self._winding is not None and _is_room(mesh, solid))
        self._backs = Backs(mesh, solid.faces)

    def holds(self, points: FloatArray) -> BoolArray:
        """(N,) True for each of (N, 3) points in matter."""
        return self._backs.hold(points) | self.encloses(points)

    def encloses(self, points: FloatArray) -> BoolArray:
        """(N,) True for each of (N, 3) points in solid material of closed components."""
        if self._winding is None:
            return np.zeros(len(points), bool)
        return self._winding.numbers(points) > self._outside


class Hiders(NamedTuple):
    """Faces that hide, in a scene of diagonal 1 about the origin: their tree, None without any.

    Attributes
    ----------
    tree : TriangleTree or None
    solid : (T,) int64
        The faces, in the order of the mesh.
    centre, diagonal : (3,) float64, float
        Of the scene, metres.
    """

    tree: TriangleTree | None
    solid: IntArray
    centre: FloatArray
    diagonal: float

    def place(self, points: FloatArray) -> FloatArray:
        """Points (N, 3) in the scene of diagonal 1."""
        return (points - self.centre) / self.diagonal


@once_each
def hiders_of(mesh: Mesh) -> Hiders:
    """Faces of a mesh that hide; their tree is made at the first call."""
    solid = np.flatnonzero(~mesh.degenerate_mask & ~mesh.target_mask)
    hiders = Hiders(None, solid, mesh.opaque.centre, mesh.opaque.diagonal or 1.0)
    if not len(solid):
        return hiders
    return hiders._replace(tree=TriangleTree.over(hiders.place(mesh.vertices), mesh.faces[solid]))


class Backs:
    """Backs of one-sided faces of open components, which a camera must not look at.

    Where they enclose a point, see `engine/mesh/place.hpp`, it is within a body, whose front is
    all that its mesh has. All faces of the mesh block; (M,) faces are of closed components.
    """

    def __init__(self, mesh: Mesh, closed: IntArray) -> None:
        self._hiders = hiders_of(mesh)
        counts = ~mesh.two_sided_mask
        counts[closed] = False
        self._counts = counts[self._hiders.solid]
        own = mesh.vertices[mesh.faces[self._hiders.solid[self._counts]]].reshape(-1, 3)
        self._box = own.min(axis=0, initial=np.inf), own.max(axis=0, initial=-np.inf)

    def hold(self, points: FloatArray) -> BoolArray:
        """(N,) True for each of (N, 3) points that they enclose."""
        low, high = self._box
        is_held = np.asarray(((low < points) & (points < high)).all(axis=1))
        near = np.flatnonzero(is_held)
        if self._hiders.tree is not None:
            placed = self._hiders.place(points[near])
            is_held[near] = self._hiders.tree.behind(placed, self._counts)
        return is_held


@once_each
def matter_of(mesh: Mesh) -> Matter:
    """Matter of a mesh, kept as long as it."""
    return Matter(mesh)


class ClosedParts(NamedTuple):
    """Closed components of a mesh.

    Attributes
    ----------
    faces : (N,) int64
        Faces of component i are faces[starts[i]] ... faces[starts[i + 1] - 1].
    starts : (C + 1,) int64
    boxes : (C, 2, 3) float64
        Lowest and highest corner.
    """

    faces: IntArray
    starts: IntArray
    boxes: FloatArray


def closed_parts(mesh: Mesh) -> ClosedParts:
    """Components of `closed_faces`."""
    rows = np.flatnonzero(closed_faces(mesh))
    _, part = np.unique(mesh.topology.components()[rows], return_inverse=True)
    rows = rows[sort_order(part)]
    starts = offsets_of(np.bincount(part))
    corners = mesh.vertices[mesh.faces[rows]]
    low = np.minimum.reduceat(corners.min(axis=1), starts[:-1])
    high = np.maximum.reduceat(corners.max(axis=1), starts[:-1])
    return ClosedParts(rows, starts, np.stack((low, high), axis=1))


def _is_room(mesh: Mesh, solid: ClosedParts) -> bool:
    """True if a closed component that faces inward contains the mesh.

    A component in a two-sided group does not count: its winding is undefined.
    """
    low, high = solid.boxes.swapaxes(0, 1)
    slack = ROOM_TOLERANCE_REL * mesh.diagonal
    holds = (np.maximum(low - mesh.bounds[0], mesh.bounds[1] - high) <= slack).all(axis=1)
    part = owners_of(np.diff(solid.starts))
    inward = encloses_volume(mesh.vertices, mesh.faces[solid.faces, ::-1], part)
    two_sided = np.logical_or.reduceat(mesh.two_sided_mask[solid.faces], solid.starts[:-1])
    return bool((holds & inward & ~two_sided).any())


class Winding:
    """Winding numbers of closed surfaces, (M,) faces of a mesh.

    Each is the median of those along three rays, arbitrary for a point on a surface.
    """

    def __init__(self, mesh: Mesh, faces: IntArray) -> None:
        self._middle = mesh.centre
        vertices, corners = (
            matmul(mesh.vertices - self._middle, RAY_FRAME),
            mesh.welded_faces[faces],
        )
        self._trees = [  # a ray along each axis of the frame
            TriangleTree.over(np.roll(vertices, axis, axis=1), corners) for axis in range(3)
        ]

    def numbers(self, points: FloatArray) -> IntArray:
        """(N,) winding numbers about (N, 3) points."""
        turned = matmul(points - self._middle, RAY_FRAME)
        turns = [
            tree.winding_numbers(np.ascontiguousarray(np.roll(turned, axis, axis=1)))
            for axis, tree in enumerate(self._trees)
        ]
        return np.sort(turns, axis=0)[1]


def closed_faces(mesh: Mesh) -> BoolArray:
    """(F,) faces of components of which as many faces traverse every edge one way as the other.

    Faces with a repeated vertex do not count.
    """
    table = edge_table(mesh.welded_faces, mesh.n_vertices)
    turns = np.add.reduceat(np.where(table.is_forward, 1, -1), table.first)
    part = mesh.topology.components()
    is_open_part = np.zeros(mesh.n_faces, bool)
    is_open_part[part[table.faces[np.repeat(turns != 0, table.n_uses)]]] = True
    closed = np.zeros(mesh.n_faces, bool)
    closed[table.faces] = True
    return closed & ~is_open_part[part]
