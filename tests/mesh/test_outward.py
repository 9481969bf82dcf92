"""Closed meshes of hosts without Python: what hides its back does so in Python, too."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import joined

from rastercov.core.camera.pose import hides_its_back
from rastercov.core.mesh import Group, Mesh, shapes
from rastercov.engine import solver_parts

SHAPES = shapes.sphere(2), shapes.torus(16, 8), shapes.box(), shapes.room()
GROUPS = Group("a"), Group("b", is_occluder=True), Group("c", is_target=True)
FLAT = np.array([(0, 1, 2), (2, 1, 0)])


def body(rng):
    """Vertices and faces of a body of extent 1 that may be inside out, open, flat or cut itself."""
    own = SHAPES[rng.choice(4, p=(0.4, 0.3, 0.2, 0.1))]
    points = own.vertices / own.diagonal
    points = points + rng.normal(size=points.shape) * rng.choice((0, 0, 1e-3, 1e-2))
    faces = own.faces[:, :: rng.choice((1, -1), p=(0.9, 0.1))]
    chance = rng.random()
    if chance < 0.1:  # open
        faces = faces[1:]
    elif chance < 0.3:  # faces with a repeated vertex, which have no edges
        faces = np.concatenate((faces, [(0, 0, faces[0, 1]), (0, faces[0, 1], 0)]))
    elif chance < 0.4:  # a second part of it without volume
        faces = np.concatenate((faces, len(points) + FLAT))
        points = np.concatenate((points, rng.normal(size=(3, 3)) / 3 + (0, 2, 0)))
    elif chance < 0.5:  # squeezed to a sheet, with contacts for cameras that are far enough
        points = points * (1, 1, 10 ** rng.uniform(-12, -3))
    return points, faces


@st.composite
def meshes(draw):
    """Some bodies, apart, in contact or one in another, in groups by the face."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    place, parts = 0.0, []
    for _ in range(rng.integers(1, 4)):
        points, faces = body(rng)
        parts.append(Mesh(np.add(points, (place, 0, 0)), faces))
        place += rng.choice((0.1, 0.7, 1.5))
    mesh = joined(*parts)
    last = 3 if rng.random() < 0.2 else 2  # with targets, whose faces do not hide
    vertices = mesh.vertices * 10.0 ** rng.integers(-3, 4) + rng.choice((0, 100))
    return Mesh(vertices, mesh.faces, GROUPS, rng.integers(0, last, mesh.n_faces))


@given(mesh=meshes(), far=st.sampled_from((1, 31, 500, 1e4, 1e6)))
@settings(max_examples=300, deadline=None)
def test_a_host_without_python_leaves_out_the_same_backs(mesh, far):
    roles = mesh.face_group.astype(np.uint8)  # 1 of an occluder, 2 of a target
    distance = far * mesh.opaque.diagonal
    expected = hides_its_back(mesh, distance)
    found = solver_parts.hides_its_back(mesh.vertices, mesh.faces.astype(np.int32), roles, distance)
    assert found == expected
