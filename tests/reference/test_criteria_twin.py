"""The compiled criteria against their numpy twin, on scenes made to part them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rastercov import shapes
from rastercov.camera import Camera
from rastercov.criteria import face_geometry
from rastercov.mesh import Group, Mesh
from rastercov.reference import criteria as twin
from rastercov.viewpoints import look_at

SAME_BITS = ("is_front", "in_view", "perimeter", "pixel_density", "depth")
CLOSE = ("projected_area", "in_view_fraction", "incidence")
CUT = 1e-12
"""Relative difference of areas that numpy adds up in another order; angles, radians."""
NASTY = np.array([0.0, -0.0, 1.0, -1.0, 1e-12, 2.0, 3.0, 0.1, -0.1, 1e-6, 0.5])


def hostile(rng):
    """Mesh with coplanar, tiny, edge-on, repeated and huge faces, some of them two-sided."""
    n = int(rng.integers(3, 30))
    points = np.where(rng.random((n, 1)) < 0.5, rng.choice(NASTY, (n, 3)), rng.normal(size=(n, 3)))
    points *= 10.0 ** rng.choice([-30, -6, 0, 0, 0, 3, 20])
    faces = rng.integers(0, n, size=(40, 3))
    return Mesh(points, faces, [Group("one"), Group("two", False, True)], np.arange(40) % 2)


def hostile_pose(rng, mesh):
    """At a vertex, inside the bounds, along an axis, or anywhere near."""
    low, high = mesh.bounds
    if rng.random() < 0.3:
        pose = np.eye(4)
        pose[:3, 3] = mesh.vertices[rng.integers(mesh.n_vertices)]
        return pose
    size = max(float((high - low).max()), 1e-30)
    eye = low + (high - low) * rng.random(3) + size * rng.choice([0, 0.1, 2]) * rng.normal(size=3)
    return look_at(eye, eye + size * rng.normal(size=3), rng.normal(size=3))[0]


def hostile_camera(rng):
    width, height = rng.choice([1, 64, 640, 5000], 2)
    fx, fy = rng.choice([0.7, 50, 500, 1e5], 2)
    near = float(rng.choice([0, 1e-3, 0.1, 1.0]))
    return Camera(width=int(width), height=int(height), fx=float(fx), fy=float(fy), near=near)


def assert_same(mesh, camera, pose):
    found = face_geometry(mesh, camera, pose)
    with np.errstate(all="ignore"):
        expected = twin.face_geometry(mesh, camera, pose)
    for name in SAME_BITS:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)
    for name in CLOSE:
        one, other = getattr(found, name), getattr(expected, name)
        np.testing.assert_allclose(one, other, rtol=CUT, atol=1e-15, err_msg=name)
        assert np.array_equal(one == 0, other == 0), name


@given(st.integers(0, 2**32 - 1))
def test_the_loop_gives_what_its_twin_gives(seed):
    rng = np.random.default_rng(seed)
    mesh = hostile(rng)
    assert_same(mesh, hostile_camera(rng), hostile_pose(rng, mesh))


@pytest.mark.parametrize("name", ["torus", "room", "teapot"])
def test_a_part_has_the_same_geometry_from_its_twin(name):
    mesh, rng = getattr(shapes, name)(), np.random.default_rng(0)
    for _ in range(3):
        assert_same(mesh, Camera(width=640, height=480, fx=500, fy=450), hostile_pose(rng, mesh))
