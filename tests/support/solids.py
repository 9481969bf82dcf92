"""Large parts with hollows, made of cubes, fixtures that hide them, and an irregular sheet."""

from itertools import product

import numpy as np
from cavity_scenes import block, of_cubes

from rastercov.core.mesh import Group, Mesh


def drilled_part(width, depth, size=0.01):
    """A block of width x width x depth cubes with hollows in a grid: narrow and wide blind holes,
    chambers with a neck, and closed chambers, of random depths."""
    solid = block((width, width, depth))
    rng = np.random.default_rng(0)
    for x in range(2, width - 6, 7):
        for y in range(2, width - 6, 7):
            bottom = int(rng.integers(1, depth - 4))
            kind = (x + 3 * y) // 7 % 4
            if kind == 0:
                solid[x + 2, y + 2, bottom:] = False
            elif kind == 1:
                solid[x + 1 : x + 4, y + 1 : y + 4, bottom:] = False
            elif kind == 2:
                solid[x : x + 5, y : y + 5, bottom : depth - 2] = False
                solid[x + 2, y + 2, depth - 2 :] = False
            else:
                solid[x + 1 : x + 4, y + 1 : y + 4, 1 : depth - 2] = False
    return of_cubes(solid, size)


def with_clamps(part, size=0.02):
    """The part, and four clamps at its corners that only hide it, each with a slot."""
    solid = block((6, 4, 12))
    solid[2:4, 1:3, 3:] = False
    clamp = of_cubes(solid, size)
    low, extent = part.bounds[0], np.ptp(part.bounds, axis=0)
    meshes = [part]
    for x, y in product((0.05, 0.75), (-0.25, 0.95)):
        shift = low + extent * (x, y, -0.2)
        meshes.append(Mesh(vertices=clamp.vertices + shift, faces=clamp.faces))
    starts = np.cumsum([0, *(mesh.n_vertices for mesh in meshes)])
    return Mesh(
        vertices=np.concatenate([mesh.vertices for mesh in meshes]),
        faces=np.concatenate(
            [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
        ),
        groups=[Group("part"), Group("fixture", is_occluder=True)],
        face_group=np.repeat([0, 1], [part.n_faces, 4 * clamp.n_faces]),
    )


def tessellated_plane(n_columns=10, n_rows=10, width=1.0, height=1.0, jitter=0.2, seed=0):
    """Irregular triangulation of a rectangle in the plane z = 0, facing +z, centred at 0.

    Inner vertices move by up to `jitter` of a cell, below 0.25, so that no face turns over.
    """
    row, column = np.indices((n_rows + 1, n_columns + 1))
    cells = np.stack([column, row], axis=-1).astype(np.float64)
    inner = cells[1:-1, 1:-1]
    inner += np.random.default_rng(seed).uniform(-jitter, jitter, size=inner.shape)
    flat = (cells / (n_columns, n_rows) - 0.5) * (width, height)
    index = np.arange(row.size).reshape(row.shape)
    a, b, d, c = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    faces = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    return Mesh(np.pad(flat.reshape(-1, 2), ((0, 0), (0, 1))), faces)
