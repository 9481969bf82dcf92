"""Scenes that several tests build on."""

import numpy as np

from rastercov.core.camera.viewpoints import look_at, sphere_of_poses
from rastercov.core.mesh import Mesh, shapes


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


def large_and_small():
    """Triangles larger than the image, through the eye, and less than a pixel; and views of it."""
    corners = np.array([(-9, -9, 2), (9, -8, 2.5), (1, 18, 2)], float)
    through = np.array([(0.3, 0.2, 3), (-4, 0.4, 1), (2, 0.1, -5)])
    wall = Mesh(vertices=np.concatenate((corners, through)), faces=[(0, 1, 2), (3, 4, 5)])
    mesh = joined(shapes.torus(24, 12), wall, shapes.sphere(3), square(2.5, -1.5))
    poses = np.concatenate((sphere_of_poses((0, 0, 0), 4, 3), look_at((0.2, 0, 0.1), (1, 0.3, 1))))
    return mesh, poses


def soup(rng, n=150):
    """Triangles before, through and behind the near plane: of a hundredth of a sample to all."""
    size = 10 ** rng.uniform(-3.5, 0, (n, 1, 1))
    size[::50] = 10
    middle = rng.normal(size=(n, 1, 3)) + (0, 0, 2) + size * (0, 0, 0.7)
    points = middle + size * rng.normal(size=(n, 3, 3))
    return Mesh(vertices=points.reshape(-1, 3), faces=np.arange(3 * n).reshape(n, 3))
