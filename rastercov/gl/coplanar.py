"""Overlapping coplanar faces of a mesh, found once, for any camera.

A graphics pipeline interpolates depth from the corners of each triangle, so two triangles of one
plane differ in the last bits, and rounding would decide which of them is visible. `scene` draws the
faces found here with a depth computed from their plane. Conservative: a false positive costs time,
a false negative would be decided by rounding.

Faces that overlap are in contact, so the pairs to test are those of `Mesh.contacts`.
"""

import numpy as np

from rastercov.base import BoolArray, IntArray
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.topology import first_equal_row

PLANE_DISTANCE_REL = 1e-7
"""Largest distance between two faces of one plane, in diagonals of the bounding box: the resolution
of float32 from one diagonal away. From a thousand away it is 1e-10 of the depth, which counts as
equal."""
REACHES = 10
"""Distance, in those for which contacts are found by default, that makes them as wide."""


def coplanar_overlaps(mesh: Mesh) -> BoolArray:
    """Faces that overlap another face of the same plane, (F,) bool.

    Excluded are copies of a face: they reach the device as the same triangle, see `tie_order`, and
    get equal depths in any case. So are faces that share no more than an edge or a part of one.
    Included are those in contact with more faces than `Mesh.contacts` lists.

    The first call for a mesh finds its contacts: 2 s for a million faces, 0.1 s for ten thousand.
    """
    mask = np.zeros(mesh.n_faces, dtype=bool)
    contacts, distance = mesh.contacts, REACHES * mesh.contacts.reach
    partners = contacts.partners_for(distance)
    n_partners = np.diff(partners.starts)
    same = first_equal_row(np.sort(mesh.welded_faces, axis=1).view(np.uint64))
    mask[contacts.faces_for(distance) & (n_partners == 0)] = True
    one, other = np.repeat(np.arange(mesh.n_faces), n_partners), partners.faces
    is_copy = same[one] == same[other]
    pairs = np.stack((one, other))[:, ~is_copy]
    mask[pairs[:, _overlap(mesh, *pairs)]] = True
    is_any = np.zeros_like(mask)
    is_any[same[mask]] = True
    return is_any[same]


def _overlap(mesh: Mesh, one: IntArray, other: IntArray) -> BoolArray:
    """Pairs of faces that lie in one plane and overlap, (N,) bool, by separating axes.

    A face lies in the plane of the other when all its corners do. Faces that share no more than a
    border are separated along an axis perpendicular to an edge.
    """
    tolerance = PLANE_DISTANCE_REL * float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
    overlapping = np.zeros(len(one), dtype=bool)
    rows = np.arange(len(one))
    corners = mesh.vertices[mesh.faces[np.stack((one, other))]]
    corners -= corners[:1, :, :1].copy()  # from the first corner of the first face
    normals = mesh.normals[np.stack((one, other))]
    for edge in range(-1, 6):
        if edge < 0:
            heights = np.einsum("fnki,fni->fnk", corners[::-1], normals)
            heights[1] -= np.einsum("ni,ni->n", corners[1, :, 0], normals[1])[:, None]
            remains = np.abs(heights).max(axis=2).min(axis=0) <= tolerance
        else:
            face, end = edge // 3, edge % 3
            axis = np.cross(normals[face], corners[face, :, end] - corners[face, :, end - 1])
            axis /= np.linalg.norm(axis, axis=1, keepdims=True)
            at = np.einsum("fnki,ni->fnk", corners, axis)
            common = at.max(axis=2).min(axis=0) - at.min(axis=2).max(axis=0)
            remains = common > tolerance
        rows, corners, normals = rows[remains], corners[:, remains], normals[:, remains]
    overlapping[rows] = True
    return overlapping
