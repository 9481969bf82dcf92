"""Candidate poses square to convex corners, after Alarcon; called as the generators of placement.

J. L. Alarcon-Herrera, X. Chen, X. Zhang. Viewpoint Selection for Vision Systems in Industrial
Inspection. 2014 (averages over convex regions).
"""

import numpy as np

from rastercov.base.errors import ConfigError
from rastercov.base.memory import FloatArray, IntArray
from rastercov.camera.camera import Camera
from rastercov.mesh import Mesh
from rastercov.mesh.topology import edge_table
from rastercov.placement.candidates.pool import (
    DEFAULT,
    Candidates,
    Framing,
    candidates_of,
    square_views,
)

FOLDED_COSINE = -1 + 1e-9
"""Cosine between the normals of two faces back to back: the edge of a sheet, not of a corner."""
CONVEX_SINE_TOLERANCE = 1e-6
"""Sine of the angle by which an edge of a convex corner may be concave: rounding of a file."""


def per_convex_region(
    mesh: Mesh, camera: Camera, framing: Framing = DEFAULT, *, least_bend_deg: float = 10.0
) -> Candidates:
    """Average of the views of the faces around a convex corner, after Alarcon.

    His region is a pyramid whose sides are seen together from above its tip. Here it is the faces
    around a vertex where the surface is convex: no edge at the vertex is concave, and one is bent
    by `least_bend_deg` or more, so that a finely divided smooth surface gives few. Target and
    normal are averaged as for a segment, but weighted by the angles of the faces at the vertex,
    which makes the result independent of how a side is divided. The mean of pose matrices would not
    be a pose.

    Parameters
    ----------
    least_bend_deg : float
        Degrees between the normals of two faces, 0 ... 180.

    Returns
    -------
    Candidates
        In the order of the vertices; `index` is the vertex.
    """
    if not 0 <= least_bend_deg <= 180:
        raise ConfigError(f"least_bend_deg must lie in 0 ... 180, got {least_bend_deg}")
    corners = convex_corners(mesh, least_bend_deg)
    face = np.repeat(np.arange(mesh.n_faces), 3)
    vertex = mesh.welded_faces.reshape(-1)
    row = np.full(mesh.n_vertices, -1, np.int64)
    row[corners] = np.arange(len(corners))
    used = (row[vertex] >= 0) & ~mesh.degenerate_mask[face]
    angles = _corner_angles(mesh).reshape(-1)[used]
    views = square_views(mesh, camera, framing, face[used], row[vertex[used]], angles)
    return candidates_of(*views, "convex_region", corners, framing)


def convex_corners(mesh: Mesh, least_bend_deg: float) -> IntArray:
    """Vertices at which the surface is closed, consistently wound, convex and bent at an edge."""
    rows = np.flatnonzero(~mesh.degenerate_mask)
    faces, normals = mesh.welded_faces[rows], mesh.normals[rows]
    table = edge_table(faces, mesh.n_vertices)
    uses = table.uses.astype(np.int64)
    one, other = uses[table.first], uses[table.first + table.n_uses - 1]
    start, apex = faces[one // 3, one % 3], faces[other // 3, (other + 2) % 3]
    is_good = (table.n_uses == 2) & (start == faces[other // 3, (other + 1) % 3])
    across = mesh.vertices[apex] - mesh.vertices[start]
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    is_good &= np.einsum("ni,ni->n", normals[one // 3], across) <= CONVEX_SINE_TOLERANCE
    bend = np.einsum("ni,ni->n", normals[one // 3], normals[other // 3])
    is_good &= bend > FOLDED_COSINE
    is_bent = bend <= np.cos(np.radians(least_bend_deg))
    is_corner, is_bad = np.zeros((2, mesh.n_vertices), dtype=bool)
    for ends in table.vertices.astype(np.int64).T:
        is_corner[ends[is_bent]] = True
        is_bad[ends[~is_good]] = True
    return np.flatnonzero(is_corner & ~is_bad)


def _corner_angles(mesh: Mesh) -> FloatArray:
    """(F, 3) angle of each face at each of its corners, radians."""
    corners = mesh.vertices[mesh.faces]
    forth, back = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    across = np.linalg.norm(np.cross(forth, back), axis=2)
    angles: FloatArray = np.arctan2(across, np.einsum("fki,fki->fk", forth, back))
    return angles
