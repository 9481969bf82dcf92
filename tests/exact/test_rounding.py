"""Whether computed areas are as good as they say, against exact rational arithmetic.

What rounding does is largest where lines are known least: where faces pierce each other at a tiny
angle, where an edge runs past the eye, where a face is a needle.
"""

import numpy as np
import pytest
from exact_cases import AHEAD, triangles
from exact_views import SEEDS, look, on_both_paths
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples

from rastercov.camera.camera import Camera
from rastercov.camera.viewpoints import sphere_of_poses
from rastercov.coverage.observer import open_observer
from rastercov.exact.half_planes import HalfPlaneSolver
from rastercov.mesh import Mesh, shapes
from rastercov.reference import rational

CAMERA = Camera(width=640, height=512, fx=500, fy=520)
few = examples(10)


def errors(mesh, camera, pose, path=HalfPlaneSolver):
    """How wrong the two areas of each face that was measured are, and how wrong at most."""
    view = look(mesh, camera, pose, path)
    measured = view.area_error > 0
    faces = np.flatnonzero(measured)
    visible = rational.visible_area(mesh, camera, pose, faces)
    area = rational.image_area(mesh, camera, pose, faces)
    off = np.abs(view.visible[faces] - visible) + np.abs(view.area[faces] - area)
    return off, view.area_error[faces]


def unit(vector):
    return vector / np.linalg.norm(vector)


def pierced(rng, angle, depth=(2, 6), thinnest=0.3):
    """Two triangles that share a vertex and lie across one another, their planes at an angle.

    That vertex is at some `depth`, and their angle there is `thinnest` or more.
    """
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
    return Mesh(vertices=tip + np.array([(0, 0, 0), *one, *two]), faces=[(0, 1, 2), (0, 3, 4)])


@pytest.mark.slow
@on_both_paths
@pytest.mark.parametrize("depth", [(2, 6), (-0.5, 0.5)], ids=["ahead", "cut"])
@pytest.mark.parametrize("thinnest", [0.3, 1e-2, 1e-4, 1e-6])
@few
@given(seed=SEEDS, power=st.floats(-9, 0))
def test_the_bound_grows_as_faces_pierce_each_other_at_smaller_angles(
    path, depth, thinnest, seed, power
):
    """Also where they are needles, and cut by the border and the near plane."""
    mesh = pierced(np.random.default_rng(seed), 10.0**power, depth, thinnest)
    off, bound = errors(mesh, CAMERA, AHEAD, path)
    assert (off <= bound).all()


@few
@given(seed=SEEDS, excess=st.floats(-1e-5, 1e-5))
def test_who_wins_at_the_limit_of_a_tie_is_not_known(seed, excess):
    # Two sheets as far apart as still counts as one: rounding decides which face is seen.
    rng = np.random.default_rng(seed)
    rear = rng.normal(size=(3, 3)) * (1, 1, 0.3) + (0, 0, rng.uniform(3, 8))
    mesh = triangles(rear, rear * (1 - 1e-10 * (1 + excess)))
    off, bound = errors(mesh, CAMERA, AHEAD)
    assert (off <= bound).all()


def test_each_occluder_adds_to_the_bound():
    wall = np.array([(-4, -4, 4), (4, -4, 4), (0, 6, 4)])
    tiles = [wall * (1 / 32, 1 / 32, 1 / 2) + (x / 3 - 0.5, 0, 0) for x in range(4)]
    scenes = (triangles(wall, *tiles[:n]) for n in range(4))
    bounds = [look(mesh, CAMERA, AHEAD, HalfPlaneSolver).area_error[0] for mesh in scenes]
    assert (np.diff(bounds) > 0.01 * bounds[0]).all()


@few
@given(seed=SEEDS, power=st.floats(-8, -1))
def test_the_bound_grows_as_edges_run_past_the_eye_closer(seed, power):
    rng = np.random.default_rng(seed)
    faces = []
    for closeness in (3, 1):
        along = unit(rng.normal(size=3) * (0.3, 0.3, 1))
        away = closeness * 10.0**power * unit(np.cross(along, rng.normal(size=3)))
        side = unit(np.cross(along, rng.normal(size=3)))
        third = side * rng.uniform(0.3, 2) + along * rng.uniform(-1, 1)
        ends = -along * rng.uniform(0.3, 2), along * rng.uniform(0.3, 2)
        faces.append(away + np.array((*ends, third)))
    off, bound = errors(triangles(*faces), CAMERA, AHEAD)
    assert (off <= bound).all()


def test_these_scenes_are_harder_than_a_constant_bound_allows():
    """Without what the bound adds for them, each kind would break it."""
    rng = np.random.default_rng(2)
    off, bound = zip(*(errors(pierced(rng, 1e-6), CAMERA, AHEAD) for _ in range(20)), strict=True)
    assert max(o.max(initial=0) for o in off) > 1e-8
    assert np.median([b.max(initial=0) for b in bound]) < 1e-2
    past = triangles([(1e-5, 0, -1), (2e-5, 1e-5, 1), (-0.5, 1.5, 0.2)])
    assert 1e-9 < errors(past, CAMERA, AHEAD)[1].max() < 1


def test_the_bound_of_a_solid_is_of_no_consequence():
    mesh = shapes.teapot(6)
    poses = sphere_of_poses(mesh.bounds.mean(axis=0), 0.4, 20)
    with open_observer(mesh, CAMERA, "exact") as observer:
        seen = observer.observe(poses)
    area, bound = seen.drawn_pixels, seen.area_error
    large = area > 1
    assert large.sum() > 5000
    assert (bound[large] / area[large]).max() < 1e-7
    assert np.median(bound[large]) < 1e-9


def test_rounding_grows_with_the_numbers_that_positions_are_made_from():
    # Telephoto: the image is 200 px wide and stands 1e6 or 1e8 px from the eye.
    bounds = []
    for focal in (1e6, 1e8):
        camera = Camera(width=200, height=200, fx=focal, fy=focal)
        half = 100 / focal
        mesh = triangles([(-half, -half, 4), (half, -half, 4), (half / 3, half, 4)])
        off, bound = errors(mesh, camera, AHEAD)
        assert (off <= bound).all()
        bounds.append(bound[0])
    assert bounds[1] == pytest.approx(100 * bounds[0], rel=1e-6)
