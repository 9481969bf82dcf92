"""Whether computed areas are as good as they say, against exact rational arithmetic.

What rounding does is largest where lines are known least: where faces pierce each other at a tiny
angle, where an edge runs past the eye, where a face is a needle.
"""

import numpy as np
import pytest
from exact_cases import AHEAD, box, triangles
from exact_views import SEEDS, assert_within_bounds
from hypothesis import given
from nightly import examples
from scenes import joined, square

from rastercov.core.camera.camera import Camera
from rastercov.core.camera.viewpoints import look_at, sphere_of_poses
from rastercov.core.coverage.coverage import open_observer
from rastercov.core.mesh import Mesh, shapes

CAMERA = Camera(width=640, height=512, fx=500, fy=520)


def unit(vector):
    return vector / np.linalg.norm(vector)


def pierced(rng):
    """Two triangles that share a vertex and lie across one another at a small angle.

    They are ahead, or cut by the border and the near plane; their angles may be those of needles.
    """
    angle, depth = 10.0 ** rng.uniform(-9, 0), ((2, 6), (-0.5, 0.5))[rng.integers(2)]
    thinnest = rng.choice((0.3, 1e-2, 1e-4, 1e-6))
    normal = unit(rng.normal(size=3))
    first = unit(np.cross(normal, rng.normal(size=3)))
    second = np.cross(normal, first)
    turn = rng.uniform(0, 2 * np.pi)
    axis = np.cos(turn) * first + np.sin(turn) * second
    other = normal * np.cos(angle) + np.cross(axis, normal) * np.sin(angle)
    first_of_other = unit(first - other * (first @ other))

    def two_corners(a, b, start):
        end = start + np.exp(rng.uniform(np.log(thinnest), np.log(2.5)))
        return [rng.uniform(0.3, 1.5) * (np.cos(at) * a + np.sin(at) * b) for at in (start, end)]

    start = rng.uniform(0, 2 * np.pi)
    one = two_corners(first, second, start)
    two = two_corners(first_of_other, np.cross(other, first_of_other), start + rng.uniform(-0.8, 1))
    tip = np.array((0, 0, rng.uniform(*depth))) + rng.normal(size=3) * 0.3
    points = tip + np.array([(0, 0, 0), *one, *two])
    return Mesh(vertices=points, faces=[(0, 1, 2), (0, 3, 4)]), AHEAD


def tied(rng):
    """Two sheets as far apart as still counts as one: rounding decides which face is seen."""
    rear = rng.normal(size=(3, 3)) * (1, 1, 0.3) + (0, 0, rng.uniform(3, 8))
    return triangles(rear, rear * (1 - 1e-10 * (1 + rng.uniform(-1e-5, 1e-5)))), AHEAD


def past_the_eye(rng):
    """Two faces with an edge that runs past the eye, closer and closer."""
    power, faces = rng.uniform(-8, -1), []
    for closeness in (3, 1):
        along = unit(rng.normal(size=3) * (0.3, 0.3, 1))
        away = closeness * 10.0**power * unit(np.cross(along, rng.normal(size=3)))
        side = unit(np.cross(along, rng.normal(size=3)))
        third = side * rng.uniform(0.3, 2) + along * rng.uniform(-1, 1)
        ends = -along * rng.uniform(0.3, 2), along * rng.uniform(0.3, 2)
        faces.append(away + np.array((*ends, third)))
    return triangles(*faces), AHEAD


def before_a_wall(rng):
    """From 1e-8 to 1e-20 of the size of a wall before it or behind: a strip, then of nothing."""
    wall = triangles([(-3, 0, -1), (3, 0, -1), (0, 0, 6)])
    mesh = joined(wall, square(2, 4), square(1, 3, (0.3, 0.2)))
    pose = look_at((0, 0, 0), (0, 0, 1), (rng.uniform(-0.3, 0.3), -1, 0))[0]
    pose[:3, 3] = rng.uniform(-0.5, 0.5), rng.choice((-1, 1)) * 10.0 ** rng.uniform(-20, -8), 0
    return mesh, pose


def on_a_solid(rng):
    """From a vertex, a point of an edge or of a face, and sometimes its neighbour in float64."""
    solid = (shapes.torus(6, 4), shapes.sphere(1), box((-1, -1, -1), (1, 0.5, 2)))[rng.integers(3)]
    corners = solid.vertices[solid.faces[rng.integers(solid.n_faces)]]
    weights = ((1, 0, 0), (0.5, 0.5, 0), (1 / 3, 1 / 3, 1 / 3), rng.dirichlet((1, 1, 1)))
    eye = np.array(weights[rng.integers(4)]) @ corners
    if rng.random() < 0.5:
        axis = rng.integers(3)
        eye[axis] = np.nextafter(eye[axis], rng.choice((-np.inf, np.inf)))
    mesh = joined(solid, triangles(*rng.normal(size=(3, 3, 3)) * 2))
    return mesh, look_at(eye, eye + rng.normal(size=3), rng.normal(size=3))[0]


@pytest.mark.slow
@pytest.mark.parametrize("scene", [pierced, tied, past_the_eye, before_a_wall, on_a_solid])
@given(seed=SEEDS)
@examples(7)
def test_the_bound_holds_where_lines_are_known_least(scene, seed):
    rng = np.random.default_rng(seed)
    mesh, pose = scene(rng)
    assert_within_bounds(mesh, CAMERA, pose, rng.permutation(mesh.n_faces)[:10])


@pytest.mark.parametrize("mesh", [shapes.teapot(6), shapes.room()], ids=["teapot", "room"])
def test_the_bound_of_a_solid_or_a_room_is_of_no_consequence(mesh):
    poses = sphere_of_poses(mesh.bounds.mean(axis=0), 0.4, 20)
    with open_observer(mesh, CAMERA, "exact") as observer:
        seen = observer.observe(poses)
    area, bound = seen.drawn_pixels, seen.area_error
    large = area > 1
    assert large.sum() > 1500
    assert (bound[large] / area[large]).max() < 1e-6
    assert (bound[large] <= 1e-10 * area[large]).mean() > 0.9


def test_rounding_grows_with_the_numbers_that_positions_are_made_from():
    # Telephoto: the image is 200 px wide and stands 1e6 or 1e8 px from the eye.
    bounds = []
    for focal in (1e6, 1e8):
        camera = Camera(width=200, height=200, fx=focal, fy=focal)
        half = 100 / focal
        mesh = triangles([(-half, -half, 4), (half, -half, 4), (half / 3, half, 4)])
        bounds.append(assert_within_bounds(mesh, camera, AHEAD)[0].area_error[0])
    assert bounds[1] == pytest.approx(100 * bounds[0], rel=1e-6)
