"""Coverage under installation errors: its bounds, by draws and by single points."""

import math
import os
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from mounted import LENSES, case_of, drawn, lens_case_of, violations, violations_of
from nightly import amount
from surface_cases import room

import rastercov as rc
from rastercov.base.errors import ConfigError, PoseError
from rastercov.core.area.polygons import frames_of, rows_at
from rastercov.core.camera.lenses.of_camera import lens_of
from rastercov.core.camera.rule import gate_of
from rastercov.reference.regions import points_on
from rastercov.reference.tolerance import surely_covers
from rastercov.tolerances import passes as engine
from rastercov.tolerances import passes as inset
from rastercov.tolerances.passes import Errors, TolerancePass

pytestmark = pytest.mark.native

PART = rc.shapes.teapot(5)
CAMERA = rc.Camera.from_fov(1280, 1024, hfov_deg=36)
POSES = rc.sphere_of_poses(PART.bounds.mean(axis=0), 0.6, count=6)
TASK = rc.Task(max_incidence_deg=70)
TODAY = 0 if os.environ.get("CI") else int(f"{datetime.now(UTC):%y%m%d}")
FIRSTS = amount([1000 * TODAY], at_night=[0, 1000 * TODAY + 1000])
"""First seeds of draws: at a desk, and at night, those of the day."""


def result(mesh=PART, camera=CAMERA, poses=POSES, task=TASK, **errors):
    errors.setdefault("draws", 0)
    return rc.tolerance(mesh, camera, poses, task, **errors)


# --- draws ----------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("first", FIRSTS)
def test_no_draw_in_a_hostile_scene_breaks_a_bound(first):
    broken = {}
    for seed in range(first, first + amount(30, at_night=1000)):
        lost, more, _ = violations(seed)
        if max(lost, more) > 0:
            broken[seed] = lost, more
    assert not broken


def test_an_edge_that_ends_in_the_plane_of_a_face_casts_its_shadow_there():
    """Of an end at rounding above it, corners of the shadow coincided, and nothing was cut."""
    assert max(violations(261229)[:2]) <= 0


@pytest.mark.parametrize("seed", [261127156, 261127825], ids=["turn", "focal length"])
def test_a_camera_on_a_surface_or_with_one_before_its_near_plane_has_bounds(seed):
    assert max(violations(seed)[:2]) <= 0


@pytest.mark.slow
@pytest.mark.parametrize("first", FIRSTS)
def test_no_draw_through_a_lens_breaks_a_bound(first):
    broken = {}
    for seed in range(first, first + amount(4, at_night=60)):
        lost, more, _ = violations_of(*lens_case_of(seed), seed, 8)
        if max(lost, more) > 0:
            broken[seed] = lost, more
    assert not broken


@pytest.mark.slow
def test_draws_find_a_border_of_a_lens_that_is_too_narrow(monkeypatch):
    own = inset.pixels_a_radian
    monkeypatch.setattr(inset, "pixels_a_radian", lambda camera: 0.5 * own(camera))
    assert any(violations_of(*lens_case_of(seed), seed, 12)[0] > 0 for seed in range(10))


def test_a_lens_whose_image_is_all_within_reach_of_its_border_is_certain_of_nothing():
    lens = rc.Camera(width=640, height=480, fx=420, fy=420, **LENSES[0])
    sure = result(camera=lens, angle_deg=40)
    assert sure.sure.m2 == 0
    assert all("out of its image" in line for line in sure.warnings)


@pytest.mark.parametrize("lens", LENSES)
def test_a_turn_moves_a_pixel_by_no_more_than_the_bound(lens):
    camera = rc.Camera(width=640, height=480, fx=420, fy=420, **lens)
    rng = np.random.default_rng(0)
    pixels = rng.uniform((0, 0), (640, 480), (20_000, 2))
    near = pixels + rng.normal(0, 0.5, pixels.shape)
    rays, others = (lens_of(camera).unproject(each) for each in (pixels, near))
    angle = 2 * np.arcsin(np.linalg.norm(rays - others, axis=1) / 2)
    speed = np.linalg.norm(pixels - near, axis=1) / angle
    assert 0.8 * inset.pixels_a_radian(camera) < speed.max() <= inset.pixels_a_radian(camera)


PLATE = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
SQUARE = [(0, 1, 2), (0, 2, 3)]


def plate(height=0.0, scale=1.0):
    return rc.Mesh(np.array(PLATE) * (scale, scale, 0) + (0, 0, height), SQUARE)


NEEDLE = rc.Mesh([(-0.8, 0.2, 0.4), (0.8, 0.2, 0.4), (0.1, 0.2 + 1e-9, 0.4)], [(0, 1, 2)])
SPECIAL = {
    "contact": [plate(), rc.shapes.box((0.4, 0.4, 0.4), centre=(0, 0, 0.2))],
    "coincident": [plate(), plate(0, 0.5), plate()],
    "stack": [plate(), *(rc.shapes.box([0.5] * 3, centre=(0, 0, 0.25 + 0.5 * k)) for k in (0, 1))],
    "needle": [plate(), NEEDLE],
    "edge in the plane of a face": [plate(), rc.Mesh(np.array(PLATE)[:, [0, 2, 1]], SQUARE)],
    "crossing": [plate(), rc.shapes.box((0.3, 0.3, 0.3), centre=(0.1, 0.2, 0.05))],
}


@pytest.mark.parametrize("kind", SPECIAL)
def test_no_draw_breaks_a_bound_in_a_special_case(kind):
    parts = SPECIAL[kind]
    mesh = rc.Mesh.joined(parts, [f"part {k}" for k in range(len(parts))])
    camera = rc.Camera(width=640, height=480, fx=400, fy=400)
    for seed in range(4):
        eye = np.random.default_rng(seed).uniform((-1, -1, 1.4), (1, 1, 2.5))
        poses = rc.Poses.of(rc.look_at(eye, (0, 0, 0), up=(0, 1, 0)))
        sizes = np.array([[0.03, 0.01, 0.0]])
        lost, more, _ = violations_of(mesh, camera, poses, rc.Task(), sizes, seed, 48)
        assert max(lost, more) <= 0


FISHEYE = {"model": "opencv_fisheye", "distortion": (0, 0, 0, 0)}
OFF_CENTRE = {"width": 800, "height": 600, "fx": 600, "fy": 600, "cx": -200.0}
OF_FOCUS = {
    "beyond 72 degrees": (rc.Camera(width=800, height=600, fx=420, fy=420, **FISHEYE), 0, 0.05),
    "behind": (rc.Camera(width=800, height=600, fx=440, fy=440, **FISHEYE), 0.02, 0.45),
    "nearly 72 degrees": (rc.Camera(width=800, height=600, fx=560, fy=560, **FISHEYE), 0.35, 0.2),
    "beside the principal point": (rc.Camera(**OFF_CENTRE), 0.01, 0.2),
    "above and left": (rc.Camera(**OFF_CENTRE | {"cx": 1000.0, "cy": 900.0}), 0, 0.2),
    "lens": (rc.Camera(**OFF_CENTRE, model="division", distortion=(0.02,)), 0, 0.2),
}
"""Cameras, errors of the angle, and of the focal length, that a pinhole may not hold."""


@pytest.mark.parametrize("kind", OF_FOCUS)
def test_no_draw_of_a_focal_length_breaks_a_bound(kind):
    camera, a, p = OF_FOCUS[kind]
    mesh = rc.Mesh.joined([plate(0, 9), rc.shapes.box((1, 1, 3), centre=(0, 0, 1))], ["a", "b"])
    poses = rc.Poses.of(rc.look_at((2, 0, 1), (2, 0, 0), up=(0, 1, 0)))
    for d in (0.0, 0.01):
        sizes = np.array([[d, a, p]])
        lost, more, _ = violations_of(mesh, camera, poses, rc.Task(), sizes, 0, 24)
        assert max(lost, more) <= 0


def test_what_is_sure_of_a_group_is_less_by_its_own_bound():
    groups = [plate(), rc.shapes.box((0.2, 0.2, 0.2), centre=(9, 9, 1))]
    mesh = rc.Mesh.joined(groups, ["floor", "far"])
    sure = result(mesh, poses=POSES[:2], task=rc.Task(views=2, min_angle_deg=5), position_mm=1)
    assert sure.sure.bound > 0
    assert sure.sure_by_group[1] == 0
    assert sure.sure.m2 - sure.sure_by_group.sum() == pytest.approx(sure.sure.bound, rel=1e-3)


@pytest.mark.parametrize(("away", "is_sure"), [(0.29, False), (0.34, True)])
def test_a_surface_may_come_before_the_near_plane_with_some_errors(away, is_sure):
    """Before it a surface hides nothing, so what is beyond depends on the error."""
    mesh = rc.Mesh.joined([plate(), plate(2 - away, 0.1)], ["floor", "sign"])
    camera = rc.Camera(width=640, height=480, fx=400, fy=400, near=0.2)
    pose = rc.look_at((0, 0, 2), (0, 0, 0), up=(0, 1, 0))
    sure = result(mesh, camera, pose, rc.Task(), position_mm=10)
    assert (sure.sure.m2 > 0) == is_sure
    assert len(sure.warnings) == (not is_sure)
    sizes = np.array([[0.01, 0.0, 0.0]])
    assert max(violations_of(mesh, camera, rc.Poses.of(pose), rc.Task(), sizes)[:2]) <= 0


# --- rules and angles -----------------------------------------------------------------------------

BESIDE = rc.look_at((0.1, 0, 0), (0.1, 0, 1), up=(0, -1, 0))[0]


def pair(rule):
    return rc.Rig([CAMERA, CAMERA], ["left", "right"], [np.eye(4), BESIDE], rule=rule)


@pytest.mark.parametrize(
    "rule",
    [rc.All(), rc.AtLeast(1), rc.All(min_baseline_deg=9.5), rc.All(max_baseline_deg=10.5)],
    ids=["all", "one", "least angle", "most angle"],
)
def test_no_draw_of_a_rig_with_a_rule_leaves_the_bounds(rule):
    rig = pair(rule)
    sure = result(
        camera=rig, poses=rig.poses(POSES), position_mm=1, angle_deg=0.1, draws=amount(20, 2000)
    )
    assert sure.sure.m2 - sure.sure.bound <= sure.least < sure.nominal.m2 < sure.most
    assert sure.most <= sure.possible.m2 + sure.possible.bound
    if rule.__class__ is rc.All and rule != rc.All():
        assert "baseline" in {zone["reason"] for zone in sure.list_losses(50)}


def test_nothing_is_certain_where_errors_exceed_the_greatest_angle_of_sensors_at_one_place():
    """Their rays differ by no angle as planned, and by that of the errors at worst."""
    poses = np.repeat(rc.look_at((0, 0, 0.6), PART.bounds.mean(axis=0)), 2, axis=0)
    rig = rc.Rig([CAMERA] * 2, ["camera", "projector"], rule=rc.All(max_baseline_deg=0.5))
    beside = rc.Poses.of(poses, camera=[0, 1])
    sure = result(camera=rig, poses=beside, task=rc.Task(), position_mm=10, draws=10)
    assert sure.least < sure.nominal.m2
    assert sure.sure.m2 - sure.sure.bound <= sure.least
    assert sure.sure.m2 == 0
    assert result(camera=rig, poses=beside, position_mm=0.5).sure.m2 > 0


def test_what_both_cameras_cover_for_certain_is_certain_of_both():
    rig = pair(rc.All())
    poses = rig.poses(POSES)
    both = result(camera=rig, poses=poses, position_mm=1).sure.m2
    alone = result(camera=[CAMERA, CAMERA], poses=poses, position_mm=1).regions
    every = alone.at_least(2, np.repeat(np.arange(6), 2))
    assert both == pytest.approx(rc.unite(every).area.sum(), rel=1e-9)


@pytest.mark.parametrize("degrees", [88, 95])
def test_no_draw_with_an_angle_between_rays_leaves_the_bounds(degrees):
    task = rc.Task(max_incidence_deg=80, views=2, min_angle_deg=degrees)
    sure = result(task=task, position_mm=3, angle_deg=0.1, draws=amount(6, 500))
    assert sure.sure.m2 - sure.sure.bound <= sure.least < sure.nominal.m2
    assert sure.most <= sure.possible.m2 + sure.possible.bound
    assert result(task=replace(task, min_angle_deg=0), position_mm=3).sure.m2 > sure.sure.m2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "factor"),
    [(0, 0.0), (1, 0.0), (1, 0.8), (2, 0.8), (3, 0.7), (4, 0.4), (5, 0.5)],
    ids=["nominal event edges", "no shadows", "shadows", "cap", "disc", "density", "focal"],
)
def test_draws_find_each_margin_that_is_too_small(monkeypatch, number, factor):
    margins = np.ones(6)
    margins[number] = factor
    monkeypatch.setattr(engine, "MARGINS", margins)
    assert any(violations(seed)[0] > 0 for seed in range(400))


@pytest.mark.slow
def test_no_draw_of_a_rig_leaves_the_bounds():
    sure = result(position_mm=2, angle_deg=0.2, draws=amount(200, at_night=100_000))
    assert sure.sure.m2 - sure.sure.bound <= sure.least <= sure.nominal.m2
    assert sure.nominal.m2 <= sure.most <= sure.possible.m2 + sure.possible.bound


def test_an_installation_drawn_again_covers_its_area():
    sure = result(position_mm=2, angle_deg=0.2, focal_percent=0.5, draws=8, seed=3)
    for row in (0, 7):
        poses, scale = sure.installation(row)
        cameras = [replace(CAMERA, fx=CAMERA.fx * s, fy=CAMERA.fy * s) for s in scale.tolist()]
        placed = rc.Poses.of(poses.world_from_camera, camera=np.arange(6))
        share = rc.unite(rc.regions(PART, cameras, placed, TASK)).share()
        assert share * sure.nominal.whole == pytest.approx(sure.draws[row], rel=1e-9)


# --- points ---------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("first", [0, 30])
def test_sure_points_are_sure_by_the_pyramids_of_single_faces(first):
    n_sure = n_both = 0
    for seed in range(first, first + amount(24, at_night=200)):
        mesh, camera, poses, task, sizes = case_of(seed)
        task, sizes[0, 0] = (
            replace(task, min_pixel_density=0),
            max(sizes[0, 0], 1e-7 * mesh.diagonal),
        )
        finder = TolerancePass(mesh, camera, task, threads=1)
        regions = finder.sure(poses, sizes, finder.nominal.find(poses)).regions
        points, face = points_on(mesh, 200, seed)
        inside = rows_at(regions, regions.pose, 1, face, points)[:, 0]
        nominal = rc.regions(mesh, camera, poses, task)
        rows = np.flatnonzero(rows_at(nominal, nominal.pose, 1, face, points)[:, 0])
        pose = poses.world_from_camera[0]
        sure = surely_covers(mesh, camera, pose, task, sizes[0], points[rows], face[rows])
        wrong = inside[rows] & ~sure
        # Coincident surfaces, of which the tie decides, and rounding.
        assert wrong.sum() <= 0.02 * max(len(rows), 50), seed
        n_sure, n_both = n_sure + sure.sum(), n_both + (inside[rows] & sure).sum()
    assert n_both >= 0.9 * n_sure


def test_reasons_of_points_are_those_of_the_twin(monkeypatch):
    """Nothing but a shadow is left where the twin without shadows is sure."""
    monkeypatch.setattr("rastercov.reference.tolerance.is_hidden", lambda *_: False)
    seen, wrong = set(), 0
    for seed in range(60):
        mesh, camera, poses, task, sizes = case_of(seed)
        task = replace(task, min_pixel_density=0)
        points, face = points_on(mesh, 100, seed)
        nominal = rc.regions(mesh, camera, poses, task)
        rows = np.flatnonzero(rows_at(nominal, nominal.pose, 1, face, points)[:, 0])
        points, face, pose = points[rows], face[rows], poses.world_from_camera[0]
        frames = frames_of(mesh)
        away = (points - frames.origin[face])[:, None]
        flat = (away * np.stack([frames.x_axis[face], frames.y_axis[face]], axis=1)).sum(axis=2)

        def reasons(camera, task):
            given = mesh, camera, task.rules(camera), pose, sizes[0]  # noqa: B023
            return engine.unmet(*given, flat, face)  # noqa: B023

        found = reasons(camera, task)
        sure = surely_covers(mesh, camera, pose, task, sizes[0], points, face)
        wrong += int((sure != (found == rc.Reason.OCCLUDED)).sum())
        seen |= set(found.tolist())
        # Without a criterion no point fails it, and what fails another first fails it still.
        for reason, own_camera, own_task in (
            (rc.Reason.OUT_OF_FOCUS, replace(camera, focus_range=None), task),
            (
                rc.Reason.TOO_COARSE,
                camera,
                replace(task, min_facing_density=0, min_pixels_per_m2=0),
            ),
            (rc.Reason.TOO_OBLIQUE, camera, replace(task, max_incidence_deg=90)),
        ):
            without = reasons(own_camera, own_task)
            assert (without != reason).all()
            assert np.array_equal(without[found != reason], found[found != reason])
    assert wrong == 0
    assert seen == {1, 2, 3, 5, 6, 7}


# --- laws -----------------------------------------------------------------------------------------


def test_no_error_changes_no_bit():
    sure = result()
    nominal = rc.regions(PART, CAMERA, POSES, TASK)
    assert np.array_equal(sure.regions.xy, nominal.xy)
    assert sure.sure == sure.nominal


def test_smaller_errors_leave_more():
    few, more = (result(position_mm=d, angle_deg=0.1 * d) for d in (1, 3))
    slack = few.sure.bound + more.sure.bound
    assert more.sure.m2 < few.sure.m2 + slack < few.nominal.m2
    assert few.possible.m2 < more.possible.m2
    outside = rc.unite([few.regions, more.regions]).area.sum() - rc.unite(few.regions).area.sum()
    assert outside <= slack


def test_threads_change_no_bit():
    one, two = (result(position_mm=2, angle_deg=0.2, threads=n) for n in (1, 2))
    assert np.array_equal(one.regions.xy, two.regions.xy)
    assert one.possible == two.possible


def test_other_triangles_have_the_same_sure_area():
    mesh, camera, poses = room()
    middle = mesh.vertices[mesh.faces].mean(axis=1)
    a, b, c = mesh.faces.T
    new = mesh.n_vertices + np.arange(mesh.n_faces)
    faces = np.concatenate(
        [np.stack(each, axis=1) for each in ((a, b, new), (b, c, new), (c, a, new))]
    )
    fine = rc.Mesh(np.concatenate([mesh.vertices, middle]), faces)
    coarse = rc.Mesh(mesh.vertices, mesh.faces)
    task = rc.Task(max_incidence_deg=75)
    areas = [
        result(each, camera, poses, task, position_mm=5, angle_deg=0.2).sure
        for each in (coarse, fine)
    ]
    assert abs(areas[0].m2 - areas[1].m2) <= sum(each.bound for each in areas) + 1e-4


def test_an_error_of_one_camera_changes_its_regions_alone():
    sure = result(position_mm=[0, 5, 0, 0, 0, 0])
    nominal = rc.regions(PART, CAMERA, POSES, TASK).areas().sum(axis=1)
    lost = nominal - sure.regions.areas().sum(axis=1)
    assert lost[1] > 1e-6
    assert np.abs(np.delete(lost, 1)).max() <= 1e-12


def test_errors_by_name_are_of_the_cameras_of_a_rig():
    rig = rc.Rig([CAMERA, CAMERA], ["tripod", "bracket"])
    poses = rc.Poses.of(POSES[:4], camera=[0, 1, 0, 1])
    sure = rc.tolerance(PART, rig, poses, TASK, position_mm={"tripod": 5}, draws=0)
    assert sure.sizes[:, 0].tolist() == [0.005, 0, 0.005, 0]


def test_an_error_of_the_part_is_one_of_all_cameras():
    sure = result(part_mm=1, part_deg=1)
    away = np.linalg.norm(POSES[:, :3, 3] - PART.bounds.mean(axis=0), axis=1)
    wanted = 1e-3 + 2 * math.sin(math.radians(0.5)) * away
    assert sure.sizes[:, 0] == pytest.approx(wanted)
    assert sure.sizes[:, 1] == pytest.approx(math.radians(1))
    assert sure.sure.m2 < sure.nominal.m2


def test_normal_errors_hold_with_their_probability():
    errors = Errors(position_mm=1, angle_deg=0.1, distribution="normal", chance=0.9)
    sizes = errors.sizes(CAMERA, rc.Poses.of(POSES), np.zeros(3))
    draws = np.random.default_rng(0).normal(size=(20_000, 6, 2, 3)) * [[1e-3], [math.radians(0.1)]]
    within = np.linalg.norm(draws, axis=-1) <= sizes[:, :2]
    assert within.all(axis=(1, 2)).mean() == pytest.approx(0.9, abs=0.01)


def test_nothing_is_sure_of_a_camera_that_a_surface_may_reach():
    eyes = [(0, 0, 0.101), (0, 0, 0.6)]
    mesh = rc.shapes.box((0.2, 0.2, 0.2))
    poses = rc.look_at(eyes, (0, 0, 0), up=(0, 1, 0))
    sure = result(mesh, CAMERA, poses, position_mm=2)
    assert sure.regions.areas().sum(axis=1)[0] == 0
    assert sure.regions.areas().sum(axis=1)[1] > 0
    assert any(line.startswith("camera 1: with its error of") for line in sure.warnings)


def test_shadows_and_border_are_the_reasons_of_what_is_lost():
    plate = rc.Mesh([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2), (0, 2, 3)])
    block = rc.shapes.box((0.1, 0.1, 0.1), centre=(0.6, 0.5, 0.3))
    mesh = rc.Mesh.joined([plate, block], ["plate", "block"]).with_groups(occluders=["block"])
    camera = rc.Camera.from_fov(640, 480, hfov_deg=50)
    pose = rc.look_at((0.5, 0.5, 1.0), (0.5, 0.5, 0), up=(0, 1, 0))
    sure = result(mesh, camera, pose, rc.Task(), position_mm=10)
    lost = sure.list_losses(3)
    assert {zone["reason"] for zone in lost} == {"outside", "occluded"}
    assert "block" in {zone["hidden_by"] for zone in lost}
    area = sum(zone["area_m2"] for zone in sure.list_losses(100))
    assert area == pytest.approx(sure.nominal.m2 - sure.sure.m2, rel=1e-3)


def test_the_shadow_of_an_edge_is_as_wide_as_the_ball_makes_it():
    plate = rc.Mesh([(0, 0, 0), (4, 0, 0), (4, 4, 0), (0, 4, 0)], [(0, 1, 2), (0, 2, 3)])
    wall = rc.Mesh([(-9, 2, 1), (9, 2, 1), (9, 9, 1), (-9, 9, 1)], [(0, 1, 2), (0, 2, 3)])
    mesh = rc.Mesh.joined([plate, wall], ["plate", "wall"]).with_groups(occluders=["wall"])
    camera = rc.Camera.from_fov(640, 480, hfov_deg=120)
    pose = rc.look_at((2, 2, 3), (2, 2, 0), up=(0, 1, 0))
    # Beyond the edge, which is straight below, a cone of sine 0.1 / 2; ends make it a little wider.
    sure = result(mesh, camera, pose, rc.Task(), position_mm=100)
    edge = math.tan(math.asin(0.1 / 2))
    assert sure.nominal.m2 == pytest.approx(8, abs=1e-6)
    assert 4 * (2 - 1.03 * edge) < sure.sure.m2 < 4 * (2 - edge)


# --- what is refused ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("errors", "word"),
    [
        ({"position_mm": -1}, "position_mm"),
        ({"angle_deg": math.nan}, "angle_deg"),
        ({"angle_deg": 45}, "45"),
        ({"focal_percent": 50}, "50"),
        ({"position_mm": [1, 2]}, "6 poses"),
        ({"position_mm": {"other": 1}}, "other"),
        ({"distribution": "flat"}, "uniform"),
        ({"distribution": "normal", "chance": 1.0}, "chance"),
        ({"part_mm": math.inf}, "part_mm"),
        ({"draws": -1}, "draws"),
    ],
)
def test_wrong_errors_are_refused(errors, word):
    with pytest.raises(ConfigError, match=word):
        result(**errors)


def test_what_has_no_proof_is_refused_in_one_line():
    lens, fisheye = (rc.Camera(width=640, height=480, fx=420, fy=420, **own) for own in LENSES)
    exact = pair(rc.All(max_uncertainty=1e-4, noise_px=0.2))
    cases = [
        (lens, rc.Task(min_pixels_per_m2=1e4), POSES, "density"),
        (replace(fisheye, focus_range=(0.1, 2)), TASK, POSES, "no focus"),
        (replace(fisheye, max_angle_deg=30), TASK, POSES, "valid in all of the image"),
        (replace(fisheye, fx=150, fy=150), TASK, POSES, "72 degrees"),
        (rc.Camera.orthographic(640, 480, px_per_m=2000), TASK, POSES, "parallel rays"),
        (exact, TASK, exact.poses(POSES), "max_uncertainty"),
        (CAMERA, rc.Task(min_visibility=0.5), POSES, "min_visibility"),
    ]
    for camera, task, poses, word in cases:
        with pytest.raises(ConfigError, match=word) as caught:
            result(PART, camera, poses, task, position_mm=1)
        assert "\n" not in str(caught.value)
        assert len(str(caught.value)) <= 160
    with pytest.raises(PoseError):
        result(poses=np.ones((1, 4, 4)), position_mm=1)


def test_draws_are_within_their_errors():
    size = np.array([0.01, 0.02, 0.03])
    cameras, poses = drawn(CAMERA, rc.Poses.of(POSES[:1]), size, np.random.default_rng(0), 200)
    away = np.linalg.norm(poses.world_from_camera[:, :3, 3] - POSES[0, :3, 3], axis=1)
    assert away.max() == pytest.approx(0.01)
    assert max(each.fx for each in cameras) <= 1.03 * CAMERA.fx + 1e-9


@pytest.mark.parametrize("error_deg", [1e-9, 5e-4, 2e-3])
def test_small_errors_of_a_limit_of_angles_widen_what_is_possible(error_deg):
    gate = gate_of(rc.All(max_baseline_deg=0.0), ["a", "b"], [CAMERA] * 2)
    assert gate.off_by(-error_deg).most_deg >= error_deg
    assert gate.off_by(error_deg).least_deg == 180  # nothing is sure
