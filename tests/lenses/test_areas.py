"""Areas in the image of a lens: sums, references, and bounds."""

import math

import lens_cases
import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from lens_cases import (
    HEIGHT,
    WIDTH,
    make_lens,
    of_all_kinds,
    pixels_of_plane,
    points_of,
    polygon_areas,
)
from lens_rooms import on_plane, room
from nightly import amount, examples

from rastercov.base.errors import CameraError
from rastercov.core.camera.lenses.of_camera import blind_area

LENSES = of_all_kinds()


@pytest.mark.slow
@pytest.mark.parametrize("name", LENSES)
def test_walls_of_a_room_add_up_to_the_image(name):
    lens = LENSES[name]
    assert lens.is_whole
    triangles = room(amount(2, at_night=3), seed=len(name))
    total, bound = 0.0, 0.0
    for proved in lens.proved:
        areas = polygon_areas(proved, on_plane(proved.record, triangles))
        assert (areas.inside >= -1e-9).all()
        assert (areas.inside <= areas.whole + 1e-8).all()
        total += areas.inside.sum()
        bound += areas.bound.sum()
    assert abs(total - WIDTH * HEIGHT) <= 1e-6
    assert bound < 1e-4


@pytest.mark.slow
def test_a_room_seen_by_a_folding_lens_adds_up_to_what_is_not_blind():
    lens = make_lens("pinhole", WIDTH, HEIGHT, fx=900, fy=900, radial=(-0.2,))
    blind = blind_area(lens)
    # The image circle has radius 900 r (1 - 0.2 r^2) at the end of the region.
    edge = math.tan(lens.valid_angle)
    radius = 900 * edge * (1 - 0.2 * edge**2)
    circle = shapely.Point(WIDTH / 2, HEIGHT / 2).buffer(radius, quad_segs=4096)
    outside = WIDTH * HEIGHT - shapely.box(0, 0, WIDTH, HEIGHT).intersection(circle).area
    assert outside > 1000
    assert blind == pytest.approx(outside, abs=1e-5 * radius)  # of a circle of 16,384 sides
    total = 0.0
    for proved in lens.proved:
        total += polygon_areas(proved, on_plane(proved.record, room(3))).inside.sum()
    assert abs(total + blind - WIDTH * HEIGHT) <= 1e-6


def densified(plane, polygon, n):
    """Areas of the image of a polygon of a plane, by polygons of 3 n corners: whole and inside."""
    t = np.arange(n)[:, None] / n
    ends = np.roll(polygon, -1, axis=0)
    points = np.concatenate([a + t * (b - a) for a, b in zip(polygon, ends, strict=True)])
    whole = shapely.Polygon(pixels_of_plane(plane, points))
    inside = whole.intersection(shapely.box(0, 0, WIDTH, HEIGHT))
    return np.array((whole.area, inside.area))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["opencv prism", "kalibr omni", "wide equidistant"])
def test_areas_are_those_of_polygons_of_many_corners(name):
    lens = LENSES[name]
    rng = np.random.default_rng(5)
    for proved in lens.proved[:2]:
        plane, polygons = proved.record, []
        for _ in range(12):
            triangle = points_of(plane, 3, rng)
            one, two = triangle[1] - triangle[0], triangle[2] - triangle[0]
            polygons.append(triangle if one[0] * two[1] > one[1] * two[0] else triangle[::-1])
        areas = polygon_areas(proved, polygons)
        for polygon, whole, inside in zip(polygons, areas.whole, areas.inside, strict=True):
            coarse, fine = densified(plane, polygon, 1000), densified(plane, polygon, 2000)
            # Chords cut off a share of a bulge that falls with the square of their number.
            error = np.abs((4 * fine - coarse) / 3 - (whole, inside))
            # Areas end at the cone, which a plane on the side of a wide lens reaches out of.
            rays = np.column_stack((polygon, np.ones(len(polygon)))) @ plane.frame.T
            angles = np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2])
            assert error[0] <= 1e-6 or angles.max() > 0.999 * lens.valid_angle
            # Except where the border cuts them at an end of one of them.
            assert error[1] <= 0.1 * np.abs(fine - coarse).max() + 1e-6


def test_edges_along_the_border_of_the_image():
    """Corners of polygons on the border, and edges along it, count once."""
    lens = make_lens("pinhole", 1000, 1000, fx=500, fy=500)
    (proved,) = lens.proved
    square = np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
    areas = polygon_areas(proved, [square, square * 0.5, square[[0, 1, 2]], square + 0.015])
    assert np.abs(areas.whole - [1e6, 2.5e5, 5e5, 1e6]).max() <= 1e-8
    assert np.abs(areas.inside - [1e6, 2.5e5, 5e5, 992.5**2]).max() <= 1e-8


@pytest.mark.slow
@examples(8, at_night=25)
@given(st.integers(0, 2**32 - 1), st.sampled_from(sorted(LENSES)))
def test_parts_of_a_polygon_add_up(seed, name):
    lens = LENSES[name]
    rng = np.random.default_rng(seed)
    proved = lens.proved[rng.integers(len(lens.planes))]
    plane = proved.record
    if len(plane.hole):
        return
    triangle = points_of(plane, 3, rng)
    inner = rng.dirichlet(np.ones(3)) @ triangle
    parts = [np.array([triangle[i - 1], triangle[i], inner]) for i in range(3)]
    areas = polygon_areas(proved, [triangle, triangle[::-1], *parts])
    for values in (areas.whole, areas.inside):
        assert abs(values[0] + values[1]) <= 1e-8
        assert abs(values[0] - values[2:].sum()) <= areas.bound.sum() + 1e-8


def test_a_lens_with_a_pole_in_its_region_is_refused():
    lens = make_lens("division", 640, 480, fx=1, fy=1, of_base=(0.2,))
    with pytest.raises(CameraError, match="max_angle_deg"):
        lens.proved  # noqa: B018 - found when it is asked for


@pytest.mark.slow
def test_image_circle_of_a_fisheye_leaves_the_corners_blind():
    lens = make_lens("equidistant", 900, 800, fx=120, fy=120, max_angle_deg=95)
    circle = math.pi * (120 * math.radians(95)) ** 2
    assert 900 * 800 - blind_area(lens) == pytest.approx(circle, abs=1e-7)


@pytest.mark.slow
def test_pixels_beyond_a_panorama_see_nothing():
    whole = {"fx": 900 / (2 * np.pi), "fy": 450 / np.pi, "cx": 450, "cy": 225}
    lens = lens_cases.lens("equirectangular", size=(1000, 500), **whole)
    assert not lens.is_whole
    assert blind_area(lens) == pytest.approx(1000 * 500 - 900 * 450)
    assert np.isnan(lens.unproject([950.0, 200.0])).all()
    part = make_lens("equirectangular", 500, 400, fx=300, fy=300, of_base=(0, 1))
    assert part.is_whole
    assert abs(blind_area(part)) < 1e-8


@pytest.mark.slow
@pytest.mark.parametrize("name", LENSES)
def test_regions_and_holes_are_convex_with_edges_that_have_a_direction(name):
    for plane in LENSES[name].planes:
        for polygon in (plane.region, plane.hole):
            if not len(polygon):
                continue
            side = np.roll(polygon, -1, axis=0) - polygon
            assert np.hypot(*side.T).min() > 5e-10
            following = np.roll(side, -1, axis=0)
            turn = side[:, 0] * following[:, 1] - side[:, 1] * following[:, 0]
            assert (turn > -1e-12).all()
