"""Scenes with targets, and the same scenes without some of them."""

import numpy as np

from rastercov.core.mesh import Group, Mesh


def some_as_targets(mesh, is_target):
    """The mesh with each chosen face a target of its own, named by its index."""
    rows = np.flatnonzero(is_target)
    groups = [Group("surface"), *[Group(f"target {row}", is_target=True) for row in rows]]
    labels = np.zeros(mesh.n_faces, np.int64)
    labels[rows] = 1 + np.arange(len(rows))
    return Mesh(vertices=mesh.vertices, faces=mesh.faces, groups=groups, face_group=labels)


def only(mesh, wanted):
    """Mesh of the chosen faces, with the vertices they use, as a file of them would have them."""
    wanted = np.asarray(wanted)
    is_used = np.zeros(mesh.n_vertices, bool)
    is_used[mesh.faces[wanted]] = True
    return Mesh(
        vertices=mesh.vertices[is_used],
        faces=(np.cumsum(is_used) - 1)[mesh.faces[wanted]],
        groups=mesh.groups,
        face_group=mesh.face_group[wanted],
    )


def beside(surface, *targets, **flags):
    """A surface and targets, each a mesh and a group of its own."""
    parts = [surface, *targets]
    n_vertices = np.cumsum([0, *(part.n_vertices for part in parts)])
    labels = [surface.face_group]
    labels += [np.full(t.n_faces, len(surface.groups) + k) for k, t in enumerate(targets)]
    return Mesh(
        vertices=np.concatenate([part.vertices for part in parts]),
        faces=np.concatenate([p.faces + n for p, n in zip(parts, n_vertices, strict=False)]),
        groups=[
            *surface.groups,
            *[Group(f"target {k}", is_target=True, **flags) for k in range(len(targets))],
        ],
        face_group=np.concatenate(labels),
    )


def sheet_at(low, high, z):
    """Horizontal rectangle of two faces that faces up."""
    (x0, y0), (x1, y1) = low, high
    points = [(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)]
    return Mesh(vertices=points, faces=[(0, 1, 2), (0, 2, 3)])
