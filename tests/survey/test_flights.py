"""Patterns of flight: overlap, sampling distance and order by plane geometry, and refusals."""

import numpy as np
import pytest
import shapely
from hypothesis import example, given
from hypothesis import strategies as st
from nightly import examples
from terrain import CAMERAS, ground, site

import rastercov as rc
from rastercov import placement
from rastercov.base.errors import ConfigError
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import Mesh, shapes
from rastercov.placement import Circles, Framing, Survey, facade
from rastercov.placement.candidates.ground import heights_at, outline
from rastercov.placement.footprints import footprints
from rastercov.survey.patterns import above_ground

AREA = [(-15, -12), (14, -8), (9, 13), (-12, 9)]


UPRIGHT = Framing()


def strips(mesh, camera, framing=UPRIGHT, **survey):
    return placement.strips(mesh, camera, framing, survey=Survey(**survey))


def orbit(mesh, camera, **circles):
    return placement.orbit(mesh, camera, circles=Circles(**circles))


def polygons(mesh, camera, result):
    """Footprints of candidates."""
    names = [str(row) for row in range(len(result))]
    return footprints(mesh, camera, rc.Poses.of(result.poses), Task(), names=names)


HEADINGS = st.floats(-180, 180).map(lambda angle: round(angle, 9))
"""Reciprocals of smaller angles overflow, which makes bounds wide."""


@examples(3, at_night=20)
@given(HEADINGS, st.floats(0, 0.85), st.floats(0, 0.85), st.sampled_from(CAMERAS))
def test_strips_overlap_as_asked_and_cover_their_polygon(heading, front, side, camera):
    plane = ground(3, 200, 0.0)
    result = strips(
        plane, camera, height=20, front=front, side=side, heading_deg=heading, polygon=AREA
    )
    eyes = result.poses[:, :3, 3]
    assert (eyes[:, 2] == 20).all()
    np.testing.assert_allclose(result.poses[:, :3, 2], [[0, 0, -1]] * len(result), atol=1e-12)
    seen = polygons(plane, camera, result)
    union = shapely.union_all(seen.polygons, grid_size=1e-6)
    assert (
        shapely.area(shapely.difference(shapely.Polygon(AREA), union)) < 1e-4
    )  # borders of fisheyes are chords
    # Neighbours in a strip differ along the heading, and so by a step at most.
    angle = np.radians(heading)
    ahead = np.array((np.sin(angle), np.cos(angle)))
    steps = np.diff(eyes[:, :2], axis=0)
    along, across = steps @ ahead, steps @ (ahead[1], -ahead[0])
    is_same = np.abs(across) < 1e-9
    whole = shapely.area(seen.polygons)
    for row in np.flatnonzero(is_same):
        shared = shapely.intersection(*seen.polygons[[row, row + 1]])
        assert shapely.area(shared) >= (front - 1e-6) * whole[row] or not camera.is_pinhole
        assert np.abs(along[row]) == pytest.approx(np.abs(along[is_same]).max())
    if camera.is_pinhole:
        width, height = 640 / camera.fx * 20, 480 / camera.fy * 20
        assert np.abs(across).max(initial=0) <= (1 - side) * width * (1 + 1e-9)
        assert np.abs(along[is_same]).max(initial=0) <= (1 - front) * height * (1 + 1e-9)


def test_strips_are_flown_to_and_fro():
    result = strips(ground(3, 50, 0.0), CAMERAS[0], height=20)
    y = result.poses[:, 1, 3]
    x = result.poses[:, 0, 3]
    ends = np.flatnonzero(np.diff(x))
    assert len(ends) > 3
    assert (y[ends] == y[ends + 1]).all()
    assert result.index.tolist() == list(range(len(result)))


def test_overlap_holds_at_the_highest_ground_and_gsd_at_the_mean():
    mesh, camera = ground(), CAMERAS[0]
    square = [(-20, -20), (20, -20), (20, 20), (-20, 20)]
    result = strips(mesh, camera, gsd=0.05, front=0.7, side=0.5, polygon=square)
    side = np.linspace(-20, 20, 64)
    xy = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    level = heights_at(mesh, xy).mean()
    assert result.poses[0, 2, 3] - level == pytest.approx(0.05 * camera.fx, abs=0.02)
    seen = polygons(mesh, camera, result).summary()
    assert seen["front_percent"] >= 70
    assert seen["side_percent"] >= 50
    assert seen["gsd_per_px"] == pytest.approx(0.05, rel=0.25)


def test_strips_without_evaluated_faces_need_a_polygon():
    mesh, (camera, *_) = ground().with_groups(occluders=["*"]), CAMERAS
    with pytest.raises(ConfigError, match="got occluders only; change a role, or give a polygon"):
        strips(mesh, camera, height=20)
    assert len(strips(mesh, camera, height=20, polygon=AREA))


def test_images_follow_the_ground():
    mesh = ground()
    result = strips(mesh, CAMERAS[0], height=15, follow=True, polygon=AREA)
    eyes = result.poses[:, :3, 3]
    np.testing.assert_allclose(eyes[:, 2] - heights_at(mesh, eyes[:, :2]), 15, atol=1e-9)
    assert np.ptp(eyes[:, 2]) > 2


def test_images_beside_the_ground_are_above_the_nearest_of_the_others():
    """Of a slope that ends within the polygon, whose mean is far above its foot."""
    slope = rc.Mesh(
        [(-20, -30, 0), (20, -30, 0), (20, 30, 60), (-20, 30, 60)], [(0, 1, 2), (0, 2, 3)]
    )
    square = [(-45, -45), (45, -45), (45, 45), (-45, 45)]
    eyes = strips(slope, CAMERAS[0], height=15, follow=True, polygon=square).poses[:, :3, 3]
    below = heights_at(slope, eyes[:, :2])
    known = np.isfinite(below)
    assert 0 < known.sum() < len(eyes)
    for eye in eyes:
        nearest = np.square(eyes[known, :2] - eye[:2]).sum(axis=1)
        heights = below[known][nearest <= nearest.min() + 1e-9]
        assert np.isclose(eye[2] - 15, heights).any()
    away = np.add(square, (500, 0))
    level = strips(slope, CAMERAS[0], height=15, follow=True, polygon=away).poses[:, 2, 3]
    assert np.ptp(level) == 0


def test_views_are_tilted_forward_with_the_horizon_level():
    result = strips(ground(3, 50, 0.0), CAMERAS[0], height=20, heading_deg=30, tilt_deg=40)
    view, right = result.poses[0, :3, 2], result.poses[0, :3, 0]
    assert np.degrees(np.arccos(-view[2])) == pytest.approx(40)
    assert np.degrees(np.arctan2(view[0], view[1])) == pytest.approx(30)
    assert right[2] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize(("tilt", "front"), [(5, 0.3), (15, 0.7), (35, 0.7)])
def test_tilted_views_overlap_as_asked(tilt, front):
    """Their images are trapezoids, of which the wide end is left out of what neighbours share."""
    plane, camera = ground(3, 200, 0.0), rc.Camera(width=640, height=480, fx=500, fy=400, cx=240)
    result = strips(plane, camera, height=20, front=front, polygon=AREA, tilt_deg=tilt)
    seen = polygons(plane, camera, result)
    same = np.flatnonzero(np.diff(result.poses[:, 0, 3]) == 0)
    assert len(same) > 1
    for row in same:
        shared = shapely.intersection(*seen.polygons[[row, row + 1]])
        assert shapely.area(shared) >= (front - 1e-6) * shapely.area(seen.polygons[row])


def test_a_rolled_image_is_as_wide_as_the_other_is_high():
    plane, camera = ground(3, 50, 0.0), CAMERAS[0]
    upright, rolled = (
        strips(plane, camera, Framing(rolls_deg=(turn,)), height=20, front=0.5, side=0.5)
        for turn in (0.0, 90.0)
    )
    steps = [
        np.abs(np.diff(each.poses[:, :2, 3], axis=0)).max(axis=0) for each in (upright, rolled)
    ]
    assert steps[0] == pytest.approx(steps[1][::-1])


@given(st.floats(1, 60), st.floats(0, 0.9))
@examples(8)
def test_an_orbit_looks_at_its_centre_and_closes(radius, front):
    centre = np.array((3.0, -2.0, 1.0))
    poses = orbit(site(), CAMERAS[0], radius=radius, heights=[5.0, 9.0], centre=centre, front=front)
    eyes, views = poses.poses[:, :3, 3], poses.poses[:, :3, 2]
    np.testing.assert_allclose(np.hypot(*(eyes - centre).T[:2]), radius)
    np.testing.assert_allclose(np.cross(views, centre - eyes), 0, atol=1e-9 * radius)
    n = len(poses) // 2
    assert (eyes[:, 2] == np.repeat([5, 9], n)).all()
    step = 2 * np.pi * radius / n
    assert step <= (1 - front) * 640 / CAMERAS[0].fx * radius * (1 + 1e-9)
    np.testing.assert_allclose(eyes[n - 1, :2], eyes[n, :2], atol=1e-9)  # up, and back


def test_a_tilted_orbit_is_tilted_down():
    poses = orbit(site(), CAMERAS[0], radius=9, heights=4, tilt_deg=25, count=7)
    assert len(poses) == 7
    assert np.degrees(np.arcsin(poses.poses[:, 2, 2])) == pytest.approx([-25] * 7)


@examples(6)
@given(st.floats(-180, 180), st.sampled_from(CAMERAS), st.floats(0, 0.8))
@example(1e-303, CAMERAS[0], 0.0)  # bounds are wide where reciprocals overflow
def test_a_facade_is_covered_from_the_front(angle, camera, overlap):
    wall = shapes.box((20, 1, 9)).moved(translation=(0, 0.5, 4.5)).moved(angle_deg=angle)
    way = np.array((np.sin(np.radians(angle)), -np.cos(np.radians(angle)), 0))
    chosen = wall.normals @ way > 0.5
    sheet = Mesh(wall.vertices, wall.faces[chosen])
    result = facade(sheet, camera, distance=4, front=overlap, side=overlap)
    np.testing.assert_allclose(result.poses[:, :3, 2], [-way] * len(result), atol=1e-9)
    seen = rc.regions(sheet, camera, result.poses)
    undecided = seen.at_least(1).bounds().sum()
    assert seen.at_least(1).areas().sum() == pytest.approx(20 * 9, rel=1e-6, abs=undecided)
    lengths = np.linalg.norm(np.diff(result.poses[:, :3, 3], axis=0), axis=1)
    width, height = 640 / CAMERAS[0].fx, 480 / CAMERAS[0].fy
    if camera.is_pinhole:
        assert lengths.max() <= (1 - overlap) * 4 * max(width, height) * (1 + 1e-9)


def test_the_outline_is_that_of_the_task():
    hull = outline(site().with_groups(occluders=["ground"]))
    assert hull.bounds == pytest.approx((-17, -2, -3, 12))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda m, c: strips(m, c), "expected height or gsd, got none"),
        (lambda m, c: strips(m, c, height=9, gsd=1), "expected height or gsd, got both"),
        (lambda m, c: strips(m, c, height=9, front=1), "expected front from 0 to below 1"),
        (lambda m, c: strips(m, c, height=3), "expected a height above the highest ground"),
        (lambda m, c: strips(m, c, height=9, tilt_deg=90), "expected tilt_deg from 0 to below 90"),
        (lambda m, c: strips(m, c, height=30, front=0.99999), "expected at most 100,000 images"),
        (lambda m, c: strips(m, c, height=30, polygon=[(0, 0), (1, 1), (1, 0), (0, 1)]),
         "expected a polygon without crossings"),
        (lambda m, c: orbit(m, c, radius=0, heights=1), "expected radius above 0"),
        (lambda m, c: orbit(m, c, radius=1, heights=1, tilt_deg=90), "expected tilt_deg within 90"),
        (lambda m, c: facade(m, c, distance=5, groups=["house"]), "expected faces of one side"),
        (lambda m, c: facade(m, c), "expected distance or gsd, got none"),
    ],
)  # fmt: skip
def test_wrong_patterns_are_refused(make, words):
    with pytest.raises(ConfigError, match=words):
        make(site(), CAMERAS[0])


@examples(8)
@given(st.floats(-3, 3), st.floats(0, 2), st.sampled_from(["none", "sheet", "box", "canopy"]),
       st.floats(2, 30))  # fmt: skip
def test_no_view_of_a_facade_is_below_the_ground_and_its_clearance(base, clearance, kind, away):
    """Whatever the ground is made of; the wall begins below it. A row that is left out is said."""
    wall = shapes.box((20, 1, 9)).moved(translation=(0, 0.5, 4.5 + base))
    sheet = Mesh(wall.vertices, wall.faces[wall.normals[:, 1] < -0.5])
    grounds = {
        "none": [],
        "sheet": [Mesh([(-90, -90, 0), (90, -90, 0), (0, 90, 0)], [(0, 1, 2)])],
        "box": [shapes.box((180, 180, 1)).moved(translation=(0, 0, -0.5))],
    }
    grounds["canopy"] = [*grounds["sheet"], shapes.box((99, 99, 0.1)).moved(translation=(0, 0, 40))]
    scene = Mesh.joined([sheet, *grounds[kind]], ["wall", *"abc"[: len(grounds[kind])]])
    result = facade(scene, CAMERAS[0], distance=away, groups=["wall"])
    raised = above_ground(scene, result, clearance)
    least = {"none": float(sheet.bounds[0, 2]), "box": -1.0}.get(kind, 0.0)  # base, rounded
    assert raised.poses[:, 2, 3].min() >= least + clearance
    assert len(raised) + len(raised.refused) == len(result) + len(result.refused)
    assert len(np.unique(raised.poses, axis=0)) == len(raised)
    assert {each.words for each in raised.refused} <= {"below the ground"}
    above = result.poses[result.poses[:, 2, 3] > least + clearance]
    assert {each.tobytes() for each in above} <= {each.tobytes() for each in raised.poses}
