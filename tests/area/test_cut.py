"""Limits of the angle between rays to the cameras of a rig: against points, and by their bounds."""

import numpy as np
import pytest
from exact_views import SEEDS
from hypothesis import given
from nightly import examples
from surface_cases import hostile_scene, in_regions, room

import rastercov as rc
from rastercov.base.errors import CameraError
from rastercov.core.area import cut
from rastercov.core.area.cells import cells
from rastercov.core.area.stages import CentrePass
from rastercov.reference.regions import points_on, rig_covers_points

pytestmark = pytest.mark.native

TASK = rc.Task(max_incidence_deg=75)
CAMERA = rc.Camera(width=200, height=160, fx=150, fy=150)


def assert_as_by_points(mesh, rig, places, task, n):
    regions = rc.regions(mesh, rig, rig.poses(places), task)
    points, face = points_on(mesh, n)
    truth = rig_covers_points(mesh, rig, np.asarray(places), task, points, face)
    total = mesh.areas.sum()
    for row, covered in enumerate(truth):
        e = regions.bounds()[row].sum() / total * n
        wrong = int((in_regions(regions, row, points, face) != covered).sum())
        assert wrong <= 2 + e + 6 * np.sqrt(e)
    return regions


LIMITS = [
    {"min_baseline_deg": 40},
    {"max_baseline_deg": 70},
    {"min_baseline_deg": 30, "max_baseline_deg": 80},
]


@pytest.mark.parametrize("limits", LIMITS)
def test_the_angle_between_rays_is_as_by_points(limits):
    mesh, camera, poses = room()
    for i, j in ((0, 1), (2, 5), (3, 4)):
        rig = rc.Rig([camera] * 2, rig_from_camera=poses[[i, j]], rule=rc.All(**limits))
        assert_as_by_points(mesh, rig, np.eye(4)[None], TASK, 6000)


@pytest.mark.slow
@given(seed=SEEDS)
@examples(7, at_night=20)
def test_the_angle_in_hostile_scenes_is_as_by_points(seed):
    mesh, camera, poses = hostile_scene(seed)
    rng = np.random.default_rng(seed)
    size = np.linalg.norm(np.ptp(mesh.bounds, axis=0))
    places = np.repeat(np.eye(4)[None], 2 + seed % 2, axis=0)
    places[1:, :3, 3] = rng.normal(size=(1 + seed % 2, 3)) * size * 10 ** rng.uniform(-1, 0)
    low, high = np.sort(rng.uniform(0, 90, 2))
    rule = rc.All(min_baseline_deg=low, max_baseline_deg=high)
    rig = rc.Rig([camera] * len(places), rig_from_camera=places, rule=rule)
    assert_as_by_points(mesh, rig, poses.reshape(-1, 4, 4)[:2], rc.Task(), 600)


def test_some_two_of_three_differ_enough_and_no_two_too_much():
    mesh, camera, poses = room()
    rule = rc.All(min_baseline_deg=25, max_baseline_deg=95)
    rig = rc.Rig([camera] * 3, rig_from_camera=poses[[0, 4, 5]], rule=rule)
    assert assert_as_by_points(mesh, rig, np.eye(4)[None], TASK, 6000).area.sum() > 0


def test_the_bound_falls_with_the_width_of_what_is_undecided(monkeypatch):
    mesh, camera, poses = room()
    rig = rc.Rig([camera] * 2, rig_from_camera=poses[[2, 5]], rule=rc.All())
    both = rc.regions(mesh, rig, rig.poses(np.eye(4)), TASK)
    eyes, items = poses[[2, 5], :3, 3][None], []
    for width in (2e-3, 2e-4, 2e-5):
        monkeypatch.setattr(cut, "STRIP_REL", width)
        items.append(both.where(rc.RayAngle(eyes, 40)))
    bounds = [each.bound.sum() - both.bound.sum() for each in items]
    assert bounds[0] > 3 * bounds[1] > 9 * bounds[2] > 0
    for each in items[:2]:
        assert abs(each.area.sum() - items[2].area.sum()) <= each.bound.sum() + items[2].bound.sum()


def test_what_is_above_and_below_an_angle_is_all():
    mesh, camera, poses = room()
    rig = rc.Rig([camera] * 2, rig_from_camera=poses[[2, 5]], rule=rc.All())
    both = rc.regions(mesh, rig, rig.poses(np.eye(4)), TASK)
    eyes = poses[[2, 5], :3, 3][None]
    parts = [both.where(rc.RayAngle(eyes, 40, is_least=each)) for each in (True, False)]
    assert all(part.area.sum() > 0 for part in parts)
    lost = both.area.sum() - sum(part.area.sum() for part in parts)
    assert -1e-9 <= lost <= sum(part.bound.sum() for part in parts)


def test_limits_that_nothing_fails_cut_nothing():
    mesh, camera, poses = room()
    wide = [rc.All(), rc.All(min_baseline_deg=1e-3), rc.All(max_baseline_deg=179.999)]
    rigs = [rc.Rig([camera] * 2, rig_from_camera=poses[[2, 5]], rule=rule) for rule in wide]
    areas = [rc.regions(mesh, rig, rig.poses(np.eye(4)), TASK).area.sum() for rig in rigs]
    assert np.ptp(areas) <= 1e-9 * areas[0]


def test_cameras_at_one_place_have_no_baseline_and_eyes_on_a_face_are_undecided_at_most():
    square = rc.Mesh([(0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)], [(0, 2, 1), (0, 3, 2)])
    rig = rc.Rig([CAMERA] * 2, rule=rc.All(min_baseline_deg=1))
    assert rc.regions(square, rig, rig.poses(np.eye(4))).area.sum() == 0
    seen = rc.regions(square, CAMERA, np.eye(4)[None])
    on_it = np.array([[(0.3, 0.2, 1.0), (0.3, 0.2, 1.0)]])
    part = seen.where(rc.RayAngle(on_it, 1, is_least=False))
    assert abs(part.area.sum() - seen.area.sum()) <= part.bound.sum() + 1e-12
    assert part.bound.sum() <= 1e-3 * seen.area.sum()


def test_a_zone_that_only_the_angle_leaves_is_named_for_it():
    square = rc.Mesh([(-1, -1, 4), (1, -1, 4), (1, 1, 4), (-1, 1, 4)], [(0, 2, 1), (0, 3, 2)])
    places = np.repeat(np.eye(4)[None], 2, axis=0)
    places[1, 0, 3] = 0.2
    rig = rc.Rig([CAMERA] * 2, None, places, rule=rc.All(min_baseline_deg=20))
    summary = rc.evaluate(square, rig, rig.poses(np.eye(4))).summary()
    assert summary["covered_area"]["m2"] == 0
    assert summary["dead_zones"][0]["reason"] == "baseline"
    missed = {each["device"]: each["missed"]["percent"] for each in summary["by_device"]}
    assert missed[None] > 90
    assert missed["camera 1"] == missed["camera 2"] == 0  # both see what the angle leaves out


def test_centres_are_within_the_angle_too():
    mesh, camera, poses = room()
    rule = rc.All(min_baseline_deg=30, max_baseline_deg=80)
    rig = rc.Rig([camera] * 2, rig_from_camera=poses[[2, 5]], rule=rule)
    own = cells(mesh, 0.5)
    result = CentrePass(own, rig, TASK).find(rig.poses(np.eye(4)))
    centres = own.vertices.reshape(-1, 3, 3).mean(axis=1)
    face = own.source_face.astype(np.int64)
    truth = rig_covers_points(mesh, rig, np.eye(4)[None], TASK, centres, face)[0]
    assert result.row(0).tolist() == np.flatnonzero(truth).tolist()


@pytest.mark.parametrize("limits", [(50, 40), (-1, 40), (0, 181), (float("nan"), 40), ("a", 40)])
def test_limits_that_cannot_be_are_refused(limits):
    with pytest.raises(CameraError, match="180"):
        rc.Rig([CAMERA] * 2, rule=rc.All(*limits))
