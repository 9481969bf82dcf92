"""Parts with hollows, made of cubes: every face is a half of a cube's side."""

import numpy as np

from rastercov.core.mesh import Mesh

# Corners of the side of a unit cube towards +axis and -axis, counter-clockwise seen from outside.
SIDES = {
    (1, 0, 0): [(1, 0, 0), (1, 1, 0), (1, 1, 1), (1, 0, 1)],
    (-1, 0, 0): [(0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0)],
    (0, 1, 0): [(0, 1, 0), (0, 1, 1), (1, 1, 1), (1, 1, 0)],
    (0, -1, 0): [(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)],
    (0, 0, 1): [(0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)],
    (0, 0, -1): [(0, 0, 0), (0, 1, 0), (1, 1, 0), (1, 0, 0)],
}


def of_cubes(solid, size=1.0):
    """The surface of the cubes (X, Y, Z) that are there; cube (i, j, k) begins at (i, j, k)."""
    solid = np.asarray(solid, bool)
    padded = np.pad(solid, 1)
    corners = []
    for towards, side in SIDES.items():
        beyond = np.roll(padded, [-step for step in towards], axis=(0, 1, 2))[1:-1, 1:-1, 1:-1]
        for cube in np.argwhere(solid & ~beyond):
            corners.append(cube + np.array(side))
    quads = np.array(corners)
    points, rows = np.unique(quads.reshape(-1, 3), axis=0, return_inverse=True)
    quads = rows.reshape(-1, 4)
    faces = np.concatenate((quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]))
    return Mesh(vertices=points * size, faces=faces)


def faces_at(mesh, point, normal, reach=0.5):
    """Rows of the faces with that normal whose centroids are near a point."""
    near = np.abs(mesh.centroids - point).max(axis=1) <= reach
    return np.flatnonzero(near & (mesh.normals @ normal > 0.99))


def block(shape=(5, 5, 5)):
    return np.ones(shape, bool)


def blind_hole():
    """A hole of one cube across and four deep in a block; its ground is at (2.5, 2.5, 1)."""
    solid = block()
    solid[2, 2, 1:] = False
    return of_cubes(solid)


def bottle():
    """A chamber of 5 x 5 x 3 cubes, open through a neck of 1 x 1 x 2, in a block of 7 x 7 x 6."""
    solid = block((7, 7, 6))
    solid[1:6, 1:6, 1:4] = False
    solid[3, 3, 4:] = False
    return of_cubes(solid)


def closed_cavity():
    """A chamber of 3 x 3 x 3 cubes within a block of 5 x 5 x 5."""
    solid = block()
    solid[1:4, 1:4, 1:4] = False
    return of_cubes(solid)


def overhang():
    """A roof of 5 x 5 cubes, one above the ground, on a wall at x < 1."""
    solid = block((5, 5, 3))
    solid[1:, :, 1] = False
    return of_cubes(solid)


def bent_channel(blind=False):
    """From (2.5, 2.5, 7) down to z = 1, then to x = 7, or to x = 6 where it is blind."""
    solid = block((7, 5, 7))
    solid[2, 2, 1:] = False
    solid[2 : 6 if blind else 7, 2, 1] = False
    return of_cubes(solid)
