"""`min_angle_deg` by area: parts that two cameras see from directions that differ."""

import numpy as np
import pytest
from exact_views import SEEDS
from hypothesis import given
from nightly import examples
from surface_cases import building, hostile_scene, room
from timed import evaluate_over_time

import rastercov as rc
from rastercov.base.errors import ConfigError
from rastercov.core.area.network import unit_of_result
from rastercov.core.area.polygons import rows_at
from rastercov.core.area.spread import SpreadUnion
from rastercov.reference.regions import covers_points, points_on

pytestmark = pytest.mark.native


def numbers_by_points(mesh, camera, poses, task, points, face):
    """(N,) cameras that cover a point; 1 where no two of several differ by the angle."""
    sees = covers_points(mesh, camera, poses, task, points, face)
    rays = poses[:, None, :3, 3] - points
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    differ = np.zeros(len(points), bool)
    for i in range(len(poses)):
        for j in range(i):
            cosine = np.clip((rays[i] * rays[j]).sum(axis=1), -1, 1)
            differ |= sees[i] & sees[j] & (np.degrees(np.arccos(cosine)) >= task.min_angle_deg)
    count = sees.sum(axis=0)
    return np.where(differ, count, np.minimum(count, 1))


def assert_as_by_points(mesh, camera, poses, task, n):
    regions, views = rc.regions(mesh, camera, poses, task), max(task.views, 2)
    union = SpreadUnion(mesh, views, task.min_angle_deg)
    half = np.arange(len(poses)) < len(poses) // 2
    union.add(regions.of_poses(half))
    union.add(regions.of_poses(~half))
    covered = union.covered()
    points, face = points_on(mesh, n)
    truth = numbers_by_points(mesh, camera, poses, task, points, face)
    for k in range(1, views + 1):
        own = (covered.views >= k).astype(np.int32)
        is_inside = rows_at(covered, own, 2, face, points)[:, 1]
        e = covered.bound.sum() / mesh.areas.sum() * n
        assert (is_inside != (truth >= k)).sum() <= 2 + e + 6 * np.sqrt(e)
    assert (covered.area[:-1] >= covered.area[1:] - 1e-12).all()
    return covered


@pytest.mark.parametrize("views", [1, 2, 3])
def test_area_by_cameras_that_differ_is_as_by_points(views):
    task = rc.Task(max_incidence_deg=75, views=views, min_angle_deg=50)
    covered = assert_as_by_points(*room(), task, 4000)
    assert 0 < covered.area[1].sum() < covered.area[0].sum()


def test_a_building_is_as_by_points():
    assert_as_by_points(*building(), rc.Task(views=3, min_angle_deg=25), 4000)


@pytest.mark.slow
@examples(7, at_night=20)
@given(seed=SEEDS)
def test_hostile_scenes_are_as_by_points(seed):
    mesh, camera, pose = hostile_scene(seed)
    rng = np.random.default_rng(seed)
    poses = np.repeat(pose.reshape(-1, 4, 4)[:1], 4, axis=0)
    size = np.linalg.norm(np.ptp(mesh.bounds, axis=0))
    poses[1:, :3, 3] += rng.normal(size=(3, 3)) * size * 10 ** rng.uniform(-2, 0, (3, 1))
    assert_as_by_points(
        mesh, camera, poses, rc.Task(views=2, min_angle_deg=rng.uniform(1, 60)), 500
    )


def test_evaluate_counts_what_differs():
    mesh, camera, poses = room()
    shares = []
    for degrees in (0, 1e-3, 30, 60, 120):
        task = rc.Task(max_incidence_deg=75, views=2, min_angle_deg=degrees)
        result = rc.evaluate(mesh, camera, poses, task, by="area", fields=())
        summary = result.summary()
        shares.append(summary["covered_area"]["percent"])
        zones = [zone["percent"] for zone in summary["dead_zones"]]
        left = sum(zones) + summary["other_dead_zones"]["percent"]
        assert left == pytest.approx(100 - shares[-1], abs=summary["covered_area"]["bound_percent"])
        reasons = {zone["reason"] for zone in summary["dead_zones"]}
    assert shares[0] == pytest.approx(shares[1], abs=1e-2)
    assert sorted(shares, reverse=True) == pytest.approx(shares)
    assert shares[-1] < shares[1] - 5
    assert "too_few_views" in reasons


def test_faces_that_are_covered_need_no_more_regions():
    square = rc.Mesh([(-1, -1, 4), (1, -1, 4), (1, 1, 4), (-1, 1, 4)], [(0, 2, 1), (0, 3, 2)])
    wide = rc.Camera(width=200, height=160, fx=50, fy=50)
    poses = rc.look_at(eyes=[(-3, 0, 0), (3, 0, 0), (0, 1, 0)], targets=(0, 0, 4))
    union = SpreadUnion(square, 2, 20)
    regions = rc.regions(square, wide, poses)
    union.add(regions.of_poses(np.array([True, False, False])))
    assert not union.closed.any()
    union.add(regions.of_poses(np.array([False, True, False])))
    assert union.closed.all()
    assert union.covered().share(2) == 1


def test_by_area_is_up_to_50_poses():
    mesh, camera, _ = room()
    task = rc.Task(min_angle_deg=10)
    many = np.repeat(np.eye(4)[None], 51, axis=0)
    with pytest.raises(ConfigError, match=r"at most 50 poses .*, got 51"):
        rc.evaluate(mesh, camera, many, task, by="area")
    union = SpreadUnion(mesh, 2, 10)
    with pytest.raises(ConfigError, match="at most 50 poses"):
        union.add(rc.regions(mesh, camera, many))
    unit, reason = unit_of_result(None, task, rc.Engine())
    assert (unit, "request it with by area" in reason) == ("face", True)
    assert unit_of_result("area", task, rc.Engine(), camera, 50) == ("area", "")


def test_rigs_with_a_rule_have_a_baseline_of_their_own():
    mesh, camera, poses = room()
    rig = rc.Rig([camera] * 2, rig_from_camera=poses[:2], rule=rc.All())
    with pytest.raises(ConfigError, match="a rig with a rule"):
        rc.evaluate(mesh, rig, rig.poses(np.eye(4)), rc.Task(min_angle_deg=10), by="area")


def test_a_motion_refuses_an_angle_between_cameras():
    mesh, camera, poses = room()
    motion = rc.Motion(mesh, {"mesh": np.repeat(np.eye(4)[None], 2, axis=0)})
    with pytest.raises(ConfigError, match="min_angle_deg"):
        evaluate_over_time(motion, camera, poses, rc.Task(min_angle_deg=10))
