"""Cones of lenses: conics in faces and circles in images, by closed forms."""

import math

import numpy as np
import pytest
from cone_cases import area_in_cone, cone_camera, image_in_cone, triangle_case
from hypothesis import given
from hypothesis import strategies as st
from nightly import amount, examples

import rastercov as rc
from rastercov.core.camera.lenses.of_camera import blind_area, lens_of

DOWN = (0, 1, 0)


def sheet(side):
    s = side / 2
    return rc.Mesh([(-s, -s, 0), (s, -s, 0), (s, s, 0), (-s, s, 0)], [(0, 1, 2), (0, 2, 3)])


def diagonal(mesh):
    return float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))


def looking(height, tilt_deg):
    """Pose above the origin of z = 0, looking down, tilted."""
    t = math.radians(tilt_deg)
    eye = np.array([0, 0, height])
    towards = eye + np.array([math.sin(t), 0, -math.cos(t)])
    return rc.look_at(eye, towards, DOWN)


def check(result, true, mesh, length):
    """Area and bound of regions, whose arcs have a length of at most so much."""
    area, bound = result.area.sum(), result.bound.sum()
    assert abs(area - true) <= bound + 1e-12 * true
    assert bound <= 1.1e-6 * diagonal(mesh) * length + 1e-9


@pytest.mark.parametrize(
    ("half_deg", "tilt_deg"),
    [(60, 0), (30, 0), (1, 0), (80, 0), (30, 20), (30, 45), (15, 60), (5, 80), (75, 10), (10, 75)],
)
def test_a_cone_covers_an_ellipse(half_deg, tilt_deg):
    a, t, h, mesh = math.radians(half_deg), math.radians(tilt_deg), 2.0, sheet(100)
    true = math.pi * h**2 * math.sin(a) ** 2 * math.cos(a)
    true /= (math.cos(t) ** 2 - math.sin(a) ** 2) ** 1.5
    pose = looking(h, tilt_deg)
    reach = h * (math.tan(a + t) - math.tan(t - a))  # the longer axis
    planar = rc.Camera(width=4000, height=4000, fx=300, fy=300, max_angle_deg=half_deg)
    for camera in (cone_camera(half_deg), planar):
        if camera is planar and half_deg > 72:
            continue
        regions = rc.regions(mesh, camera, pose, rc.Task())
        check(regions, true, mesh, math.pi * reach)
    if tilt_deg == 0:
        assert true == pytest.approx(math.pi * (h * math.tan(a)) ** 2)


@pytest.mark.parametrize("half_deg", [40, 89, 91, 120, 175])
@pytest.mark.parametrize("tilt_deg", amount([0, 90, 130], at_night=[0, 50, 90, 130, 170]))
def test_parabolas_hyperbolas_and_what_is_outside_of_them(half_deg, tilt_deg):
    mesh, pose = sheet(12), looking(1.5, tilt_deg)
    eye, axis = pose[0, :3, 3], pose[0, :3, 2]
    regions = rc.regions(mesh, cone_camera(half_deg), pose, rc.Task())
    true = [area_in_cone(mesh.vertices[f], eye, axis, math.radians(half_deg)) for f in mesh.faces]
    check(regions, sum(true), mesh, 60)


@pytest.mark.slow
@examples(10)
@given(seed=st.integers(0, 2**32), half_deg=st.sampled_from([0.5, 20, 70, 100, 160]))
def test_random_faces_in_random_cones(seed, half_deg):
    corners, eye, pose = triangle_case(np.random.default_rng(seed))
    mesh = rc.Mesh(corners, [(0, 1, 2)])
    regions = rc.regions(mesh, cone_camera(half_deg), pose, rc.Task())
    true = area_in_cone(corners, eye, pose[0, :3, 2], math.radians(half_deg))
    check(regions, true, mesh, 4 * diagonal(mesh))


def test_a_cone_past_an_edge_covers_a_segment_of_its_circle():
    """A board at half the height hides all beyond twice the distance of its edge."""
    h, half, edge, s = 2.0, math.radians(50), 0.4, 6.0
    board = [(edge, -s, 1), (s, -s, 1), (s, s, 1), (edge, s, 1)]
    floor = sheet(2 * s)
    mesh = rc.Mesh([*floor.vertices, *board], [*floor.faces, (4, 5, 6), (4, 6, 7)])
    regions = rc.regions(mesh, cone_camera(50), looking(h, 0), rc.Task())
    area, bound = (
        np.bincount(regions.pair_face, each, 4)[:2].sum() for each in (regions.area, regions.bound)
    )
    radius, x = h * math.tan(half), 2 * edge
    hidden = radius**2 * math.acos(x / radius) - x * math.sqrt(radius**2 - x**2)
    assert abs(area - (math.pi * radius**2 - hidden)) <= bound
    assert bound <= 1.1e-6 * diagonal(mesh) * 2 * math.pi * radius


@pytest.mark.parametrize("angle_deg", amount([20, 90, 130], at_night=[20, 60, 80, 90, 100, 130]))
def test_an_image_circle_has_the_area_of_a_circle(angle_deg):
    room = np.array([(x, y, z) for x in (-2, 2) for y in (-3, 2) for z in (-2, 4)], float)
    faces = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)]
    faces += [(2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]
    mesh = rc.Mesh(room, faces, [rc.Group("room", is_two_sided=True)])
    camera = rc.Camera(
        width=1400, height=1400, fx=250, fy=250, model="opencv_fisheye", max_angle_deg=angle_deg
    )
    true = math.pi * (250 * math.radians(angle_deg)) ** 2
    assert 1400**2 - blind_area(lens_of(camera)) == pytest.approx(true, abs=1e-7)
    for pose in rc.look_at(np.zeros((2, 3)), [(0, 0, 1), (0.3, -0.8, 0.4)]):
        seen = rc.open_observer(mesh, camera, "certified").observe(pose[None])
        assert seen.visible_pixels.sum() == pytest.approx(true, abs=1e-6)


@pytest.mark.slow
@examples(10)
@given(
    seed=st.integers(0, 2**32),
    angle_deg=st.sampled_from([3, 40, 85, 120]),
    k=st.sampled_from([0, 0.02]),
)
def test_random_faces_in_image_circles(seed, angle_deg, k):
    corners, _, pose = triangle_case(np.random.default_rng(seed))
    mesh = rc.Mesh(corners, [(0, 1, 2)])
    camera = rc.Camera(
        width=3000, height=3000, fx=300, fy=300, model="opencv_fisheye",
        distortion=(k, 0, 0, 0), max_angle_deg=angle_deg,
    )  # fmt: skip
    angle = lens_of(camera).valid_angle
    if 300 * angle * (1 + k * angle**2) > 1490:
        return
    own = (corners - pose[0, :3, 3]) @ pose[0, :3, :3]
    true = image_in_cone(own, angle, lambda t: 300 * t * (1 + k * t**2))
    seen = rc.open_observer(mesh, camera, "exact").observe(pose)
    assert seen.visible_pixels[0, 0] == pytest.approx(true, rel=1e-8, abs=1e-6)


def test_valid_rays_are_those_of_the_cone():
    turn = np.linspace(0, 2 * np.pi, 1001)
    for angle_deg in (30, 90, 140):
        camera = rc.Camera(
            width=1600, height=1600, fx=300, fy=300, model="opencv_fisheye",
            max_angle_deg=angle_deg,
        )  # fmt: skip
        for off, is_valid in ((-1e-9, True), (1e-9, False)):
            a = math.radians(angle_deg) + off
            rays = np.column_stack(
                (math.sin(a) * np.cos(turn), math.sin(a) * np.sin(turn), 0 * turn + math.cos(a))
            )
            result = np.isfinite(lens_of(camera).project(rays)).all(axis=1)
            assert (result == is_valid).all()
