"""Faces that no camera outside the bodies of a mesh can ever see: proved, not assumed.

The closed surfaces among the opaque faces, declared two-sided ones left out, enclose the bodies:
the points about which their winding number is positive. A way of sight from a point outside to one
inside crosses an opaque face. A face counts as never seen where all of it, moved by `GAP_REL` of
the diagonal towards the side that is to be seen, is inside: it lies in a body, or on one. The moved
face, drawn in from its edges by four times that, touches no surface of a body, so the winding
number is the same all over it, and one ray to one of its points decides. Both
sides of a two-sided face must pass. A face that is enclosed in part is not among them, nor
is one of a sealed cavity, where a camera could be: as in a room. Where all else lies in a closed
surface that faces inwards, a room, what is outside of it is a body.

A. A. G. Requicha, H. B. Voelcker. Boolean Operations in Solid Modeling. 1985.
"""

import numpy as np

from rastercov.base import BoolArray, FloatArray, IntArray, dots, norm, once_each
from rastercov.core.mesh.arrays import frozen
from rastercov.core.mesh.contacts import TriangleTree, touching_faces
from rastercov.core.mesh.mesh import Mesh
from rastercov.core.mesh.solids import closed_faces

GAP_REL = 1e-6
"""Width of a gap, in diagonals of the bounding box, in which there is no camera. Files in float32
have bodies in contact that far apart."""
INSET_REL = 4 * GAP_REL
"""Margin along the edges of a face that is not looked at; more than the gap, so that the moved
faces of a concave edge do not meet."""
CONTACT_REL = 1e-9
ROUNDING_REL = 1e-9


@once_each
def unseeable_areas(mesh: Mesh) -> FloatArray:
    """(F,) area of each evaluated face of which it is proved, m^2: 0, or all but its margin.

    Computed at the first call.
    """
    return frozen(_compute(mesh))


def unseeable_in_view(mesh: Mesh, seen: FloatArray) -> FloatArray:
    """The same where cameras see a share, (F,), of each face: 0 of all if they see into a body.

    That is more than twice the margin of a face, which perspective may enlarge: the camera is
    inside a surface that is no body, then.
    """
    return areas_in_view(mesh, unseeable_areas(mesh), seen)


def areas_in_view(mesh: Mesh, areas: FloatArray, seen: FloatArray) -> FloatArray:
    """Areas of faces, (F,), of which it is proved, or 0 of all, as of `unseeable_in_view`."""
    with np.errstate(over="ignore"):  # a share of 1e10 of a face of 1e300 m^2 is seen, too
        is_seen = seen * mesh.areas > 2 * (mesh.areas - areas) + ROUNDING_REL * mesh.areas
    return np.zeros_like(areas) if is_seen[areas > 0].any() else areas


def _compute(mesh: Mesh) -> FloatArray:
    result = np.zeros(mesh.n_faces)
    bodies = _bodies(mesh)
    if not len(bodies):
        return result
    middle, size = mesh.opaque.centre, mesh.opaque.diagonal
    points = (mesh.vertices - middle) / size
    chosen = np.flatnonzero(mesh.task_mask & ~mesh.degenerate_mask)
    corners = points[mesh.faces[chosen]]
    opposite = norm(np.roll(corners, 1, axis=1) - np.roll(corners, 2, axis=1))
    around = opposite.sum(axis=1)
    incentre = (opposite[..., None] * corners).sum(axis=1) / around[:, None]
    inset = INSET_REL * around * size**2 / (2 * mesh.areas[chosen])  # in radii of the incircle
    tree = TriangleTree.over(points, mesh.welded_faces[bodies])
    rows = np.flatnonzero(inset < 0.5)
    for side in (1, -1):
        both = np.ones(len(rows), bool) if side == 1 else mesh.two_sided_mask[chosen[rows]]
        own = rows[both]
        is_inside = ~both
        moved = incentre[own] + GAP_REL * side * mesh.normals[chosen[own]]
        drawn_in = (corners[own] - incentre[own, None]) * (1 - inset[own, None, None])
        is_inside[both] = _lie_inside(mesh, bodies, tree, moved, drawn_in)
        rows = rows[is_inside]
    result[chosen[rows]] = mesh.areas[chosen[rows]] * (1 - inset[rows]) ** 2
    return result


def _lie_inside(
    mesh: Mesh, bodies: IntArray, tree: TriangleTree, middle: FloatArray, corners: FloatArray
) -> BoolArray:
    """(N,) True for faces that are inside bodies, of corners (N, 3, 3) about a middle, (N, 3)."""
    turns, points = tree.winding_numbers(middle), tree.points
    is_inside = turns >= (0 if (turns == 0).any() and _has_room(mesh, points, bodies) else 1)
    rows = np.flatnonzero(is_inside)
    if not len(rows):
        return is_inside
    drawn_in = corners[rows] + middle[rows, None]
    own = np.arange(3 * len(rows)).reshape(-1, 3)
    touches = touching_faces(
        np.concatenate([drawn_in.reshape(-1, 3), points]),
        np.concatenate([own, mesh.welded_faces[bodies] + own.size]),
        CONTACT_REL,
    )
    is_inside[rows[touches[: len(rows)]]] = False
    return is_inside


def _has_room(mesh: Mesh, points: FloatArray, bodies: IntArray) -> bool:
    """True where a body whose normals point inwards holds all other faces, as the walls of a room.

    Then all that is outside of it counts as a body. `points` are the vertices in diagonals.
    """
    part = mesh.topology.components()
    corners = points[mesh.faces]
    volumes = dots(corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    signed = np.bincount(part[bodies], volumes[bodies], int(part.max()) + 1)
    behind = corners.mean(axis=1) - GAP_REL * mesh.normals
    for number in np.flatnonzero(signed < 0).tolist():
        own, others = corners[part == number], behind[(part != number) & ~mesh.degenerate_mask]
        low, high = own.min(axis=(0, 1)), own.max(axis=(0, 1))
        if not len(others) or (others < low).any() or (others > high).any():
            continue
        shell = TriangleTree.over(points, mesh.welded_faces[part == number])
        if (shell.winding_numbers(others) < 0).all():
            return True
    return False


def _bodies(mesh: Mesh) -> IntArray:
    """Faces of closed opaque components without two-sided faces.

    None of a single component with two faces per edge, which encloses none of its own faces unless
    it cuts itself; that is not looked into.
    """
    if not (mesh.topology.components().any() or mesh.topology.n_nonmanifold_edges):
        return np.empty(0, np.int64)
    whole = mesh.opaque
    part = whole.topology.components()
    is_body = closed_faces(whole) & ~np.isin(part, part[whole.two_sided_mask])
    return np.flatnonzero(~mesh.target_mask)[np.flatnonzero(is_body)]
