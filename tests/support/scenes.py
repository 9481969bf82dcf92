"""Flat scenes that several tests build on."""

import numpy as np

from rastercov.mesh import Mesh


def sheet(low, high, z):
    """Two triangles from corner `low` to corner `high` that face a camera looking along +z."""
    (x0, y0), (x1, y1) = low, high
    points = [(x0, y0, z), (x0, y1, z), (x1, y1, z), (x1, y0, z)]
    return Mesh(vertices=points, faces=[(0, 1, 2), (0, 2, 3)])


def square(half, z, centre=(0.0, 0.0)):
    u, v = centre
    return sheet((u - half, v - half), (u + half, v + half), z)


def joined(*meshes):
    starts = np.cumsum([0] + [mesh.n_vertices for mesh in meshes[:-1]])
    return Mesh(
        vertices=np.concatenate([mesh.vertices for mesh in meshes]),
        faces=np.concatenate([m.faces + start for m, start in zip(meshes, starts, strict=True)]),
    )
