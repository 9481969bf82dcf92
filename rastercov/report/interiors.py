"""Interiors in exterior pictures: whether a scene is one, and the faces that are left out of it."""

from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.mesh import Mesh
from rastercov.report.images import facing

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

MOST_EYES = 16
"""Cameras that are asked for the surfaces around them, spread evenly."""
ENCLOSED = 4
"""Directions of six in which a surface must be around a camera that is indoors."""
SKIN_REL = 0.02
"""Distance from the hull of a building up to which a face is of its skin, relative to the
diagonal."""
NORMALS_AT_A_TIME = 64
_SKINS: WeakKeyDictionary[Mesh, tuple[bytes, BoolArray]] = WeakKeyDictionary()


def is_inside(mesh: Mesh, eyes: ArrayLike) -> bool:
    """True if most of some cameras, (P, 3), are in the bounding box of the opaque faces."""
    points = np.asarray(eyes, np.float64).reshape(-1, 3)
    low, high = mesh.opaque.bounds
    inside = ((points > low) & (points < high)).all(axis=1)
    return 2 * int(inside.sum()) > len(points)


def turned_away(mesh: Mesh, viewer: ArrayLike, eyes: ArrayLike = ()) -> BoolArray:
    """(F,) faces that turn away from a viewer (3,).

    A two-sided face does where the viewer is on one side of it and all cameras, (P, 3), on the
    other, which is the side that they may cover.
    """
    pose = np.eye(4)
    pose[:3, 3] = np.asarray(viewer, np.float64)
    away = ~facing(mesh, pose)[0]
    two_sided = np.flatnonzero(mesh.two_sided_mask)
    points = np.asarray(eyes, np.float64).reshape(-1, 3)
    if len(two_sided) and len(points):
        normals, middles = mesh.normals[two_sided], mesh.centroids[two_sided]
        own = np.einsum("fi,fi->f", normals, pose[:3, 3] - middles)
        is_other = np.ones(len(two_sided), np.bool_)
        for eye in points:
            is_other &= np.einsum("fi,fi->f", normals, eye - middles) * own < 0
        away[two_sided] = is_other
    return away


def is_enclosed(mesh: Mesh, eyes: ArrayLike) -> bool:
    """True if most of some cameras, (P, 3), have opaque faces around them, as indoors.

    Around means in at least four of the directions +x, -x, +y, -y, +z, -z.
    """
    points = np.asarray(eyes, np.float64).reshape(-1, 3)
    if not is_inside(mesh, points):
        return False
    some = points[np.unique(np.linspace(0, len(points) - 1, MOST_EYES).astype(int))]
    corners = mesh.vertices[mesh.faces[~mesh.target_mask]]
    around = np.array([_directions_of_surfaces(corners, eye) for eye in some])
    return bool(2 * (around >= ENCLOSED).sum() > len(some))


def _directions_of_surfaces(corners: FloatArray, eye: FloatArray) -> int:
    """Number of the six directions along the axes in which a point has triangles (N, 3, 3)."""
    count = 0
    away = corners - eye
    for axis in range(3):
        flat, along = np.delete(away, axis, axis=2), away[..., axis]
        following = np.roll(flat, -1, axis=1)
        # Twice the areas of the triangles that the point makes with each side.
        twice = flat[..., 0] * following[..., 1] - flat[..., 1] * following[..., 0]
        hit = (twice >= 0).all(axis=1) | (twice <= 0).all(axis=1)
        hit &= twice.any(axis=1)
        weights = np.roll(twice[hit], -1, axis=1)
        place = (weights * along[hit]).sum(axis=1) / weights.sum(axis=1)
        count += int((place > 0).any()) + int((place < 0).any())
    return count


def outer_skin(mesh: Mesh, eyes: ArrayLike) -> BoolArray:
    """(F,) faces on the hull of a building that no camera, (P, 3), is in front of.

    None unless the cameras are indoors: then the outside of its walls and roof, which would hide
    all that is inside. The last answer for each mesh is kept.
    """
    key = np.asarray(eyes, np.float64).tobytes()
    kept = _SKINS.get(mesh)
    if kept is None or kept[0] != key:
        kept = _SKINS[mesh] = (key, _outer_skin(mesh, eyes))
    return kept[1]


def _outer_skin(mesh: Mesh, eyes: ArrayLike) -> BoolArray:
    """See `outer_skin`."""
    found = np.zeros(mesh.n_faces, np.bool_)
    if not is_enclosed(mesh, eyes):
        return found
    points = np.asarray(eyes, np.float64).reshape(-1, 3)
    normals = mesh.normals
    first = np.einsum("fi,fi->f", normals, mesh.vertices[mesh.faces[:, 0]])
    is_behind = np.ones(mesh.n_faces, np.bool_)
    for eye in points:
        is_behind &= normals @ eye < first
    rows = np.flatnonzero(is_behind & ~mesh.target_mask & ~mesh.degenerate_mask)
    slack = SKIN_REL * float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
    kinds, kind = np.unique(normals[rows].round(2), axis=0, return_inverse=True)
    reach = np.empty(len(kinds))
    for at in range(0, len(kinds), NORMALS_AT_A_TIME):
        part = slice(at, at + NORMALS_AT_A_TIME)
        reach[part] = (kinds[part] @ mesh.vertices.T).max(axis=1)
    found[rows] = first[rows] >= reach[kind.ravel()] - slack
    return found
