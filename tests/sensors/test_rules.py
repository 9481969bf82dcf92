"""Rigs with a rule: by area what their cameras cover together, against points, and by laws."""

from dataclasses import replace

import numpy as np
import pytest
from exact_cases import box
from exact_views import SEEDS
from hypothesis import given
from nightly import examples
from surface_cases import cut_at_random, hostile_scene, in_regions, room

import rastercov as rc
from rastercov.base.errors import CameraError, ConfigError, PoseError
from rastercov.reference.regions import points_on, rig_covers_points

TASK = rc.Task(max_incidence_deg=75)
CAMERA = rc.Camera(width=200, height=160, fx=150, fy=150)
PROJECTOR = rc.Camera(width=320, height=180, fx=200, fy=200, near=0.1)


def head(camera, baseline=0.12, rule=None, **more):
    """Two cameras side by side."""
    places = np.repeat(np.eye(4)[None], 2, axis=0)
    places[:, 0, 3] = (-baseline / 2, baseline / 2)
    return rc.Rig([camera, camera], ["left", "right"], places, rule=rule or rc.All(), **more)


def sheet(*, two_sided=True):
    r"""One square metre.

    3---2
    | / |
    0---1
    """
    corners, faces = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2), (0, 2, 3)]
    return rc.Mesh(corners, faces, [rc.Group("sheet", is_two_sided=two_sided)])


def assert_as_by_points(mesh, rig, places, task, n):
    regions = rc.regions(mesh, rig, rig.poses(places), task)
    points, face = points_on(mesh, n)
    truth = rig_covers_points(mesh, rig, np.asarray(places), task, points, face)
    assert len(regions.pose_ids) == len(truth)
    total = mesh.areas.sum()
    for row, covered in enumerate(truth):
        wrong = int((in_regions(regions, row, points, face) != covered).sum())
        assert wrong <= 2 + regions.bounds()[row].sum() / total * n
    return regions


def test_what_both_of_a_pair_see_is_as_by_points():
    mesh, camera, poses = room()
    regions = assert_as_by_points(mesh, head(camera, 0.3), poses, TASK, 4000)
    alone = rc.regions(mesh, camera, poses, TASK)
    assert (regions.areas().sum(axis=1) < alone.areas().sum(axis=1)).all()
    assert regions.area.sum() > 0.5 * alone.area.sum()


@pytest.mark.slow
@given(seed=SEEDS)
@examples(5, at_night=15)
def test_rules_of_hostile_scenes_are_as_by_points(seed):
    mesh, camera, poses = hostile_scene(seed)
    rng = np.random.default_rng(seed)
    if seed % 2:
        mesh = mesh.with_groups([], [group.name for group in mesh.groups])
    size = np.linalg.norm(np.ptp(mesh.bounds, axis=0))
    places = np.repeat(np.eye(4)[None], 3, axis=0)
    places[1:, :3, 3] = rng.normal(size=(2, 3)) * size * 10 ** rng.uniform(-2, 0, (2, 1))
    rules = [rc.All(), rc.AtLeast(2), rc.AtLeast(2, needs=["c"]), rc.AtLeast(1)]
    rig = rc.Rig([camera] * 3, ["a", "b", "c"], places, rule=rules[seed // 2 % 4])
    assert_as_by_points(mesh, rig, poses, rc.Task(max_incidence_deg=80), 600)


def test_one_of_a_group_is_the_union_to_the_bit():
    mesh, camera, poses = room()
    regions = rc.regions(mesh, camera, poses, TASK)
    one, union = regions.at_least(1), rc.unite(regions)
    assert np.array_equal(one.xy, union.xy)
    assert np.array_equal(one.areas()[0], union.area[0])
    assert np.array_equal(one.bounds()[0], union.bound)


def test_gates_in_any_order_agree_and_their_areas_add_up():
    mesh, camera, poses = room()
    total, orders = mesh.areas.sum(), ([0, 1, 2, 3, 4, 5], [4, 5, 0, 1, 2, 3], [1, 0, 5, 4, 3, 2])
    areas = []
    for order in orders:
        regions = rc.regions(mesh, camera, poses[order], TASK)
        heads = regions.at_least(2, [0, 0, 1, 1, 2, 2])
        assert heads.pose_ids.tolist() == [0, 2, 4]
        areas.append(heads.at_least(2).area.sum())
    assert np.ptp(areas) <= 1e-12 * total
    by_number = [regions.at_least(k).area.sum() for k in range(1, 7)]
    assert by_number == sorted(by_number, reverse=True)
    assert sum(by_number) == pytest.approx(regions.area.sum(), abs=1e-12 * total)


def test_groups_below_0_are_left_out_and_empty_ones_are_rows():
    mesh, camera, poses = room()
    regions = rc.regions(mesh, camera, poses, TASK)
    some = regions.at_least(2, [-1, 7, -1, 7, 3, -1])
    assert some.pose_ids.tolist() == [4, 1]
    assert not some.areas()[0].any()
    pair = regions.of_poses(np.isin(np.arange(6), (1, 3))).at_least(2)
    assert np.array_equal(some.areas()[1], pair.areas()[0])


def test_devices_on_both_sides_of_a_sheet_do_not_count_together():
    eyes = [(0.5, 0.5, 2), (0.5, 0.5, -2), (0.4, 0.5, 2)]
    poses = rc.look_at(eyes=eyes, targets=(0.5, 0.5, 0), up=(0, 1, 0))
    regions = rc.regions(sheet(), CAMERA, poses)
    assert regions.at_least(2, [0, 0, -1]).area.sum() == 0
    assert regions.at_least(2, [0, 0, -1], one_side=False).area.sum() == pytest.approx(1)
    assert regions.at_least(2).area.sum() == pytest.approx(1)
    assert regions.at_least(3).area.sum() == 0
    rig = rc.Rig([CAMERA] * 3, list("abc"), poses, rule=rc.AtLeast(2, needs=["b"]))
    assert rc.regions(sheet(), rig, rig.poses(np.eye(4))).area.sum() == 0
    with pytest.raises(ConfigError, match="single cameras"):
        regions.at_least(2).at_least(2, [0])


def test_advice_for_a_side_that_a_head_is_behind_has_no_angles_of_the_other_side():
    rig = head(CAMERA, tasks={"right": rc.Task(max_incidence_deg=3)})
    behind = rc.look_at((0.4, 0.5, -1), (0.4, 0.5, 0), up=(0, 1, 0))
    found = rc.evaluate(sheet(two_sided=False), rig, rig.poses(behind), fields=()).summary()
    (zone,) = found["dead_zones"]
    assert (zone["reason"], zone["nearest"]) == ("back_facing", None)
    assert "incidence" not in zone["advice"]


def test_a_projector_in_a_closed_box_and_a_camera_outside_see_nothing_together():
    closed = box((-1, -1, -1), (1, 1, 1))
    poses = rc.look_at(eyes=[(0, 0, 0), (3, 0.1, 0.2)], targets=[(1, 0, 0), (0, 0, 0)])
    for two_sided in (False, True):
        mesh = closed.with_groups([], [g.name for g in closed.groups] if two_sided else [])
        regions = rc.regions(mesh, replace(CAMERA, near=0.01), poses)
        assert regions.at_least(2).area.sum() == 0


@pytest.mark.slow
def test_what_two_see_does_not_depend_on_the_triangles():
    mesh, camera, poses = room()
    cut, _ = cut_at_random(mesh, 3, 40)
    rig = head(camera, 0.3)
    areas = [rc.regions(each, rig, rig.poses(poses), TASK).areas().sum(1) for each in (mesh, cut)]
    assert np.abs(areas[0] - areas[1]).max() <= 1e-6 * mesh.areas.sum()


def test_each_device_has_thresholds_of_its_own():
    mesh, camera, poses = room()
    own = {"right": rc.Task(max_incidence_deg=40)}
    rig = head(camera, 0.3, tasks=own)
    regions = assert_as_by_points(mesh, rig, poses[:2], TASK, 3000)
    same = rc.regions(mesh, head(camera, 0.3), rig.poses(poses[:2]), TASK)
    assert regions.area.sum() < same.area.sum()
    by_words = head(camera, 0.3, tasks={"right": {"max_incidence_deg": 40}})
    again = rc.regions(mesh, by_words, rig.poses(poses[:2]), TASK)
    assert np.array_equal(regions.xy, again.xy)


def test_a_rig_without_a_rule_has_a_row_for_each_camera_as_before():
    mesh, camera, poses = room()
    rig = rc.Rig([camera, camera], ["left", "right"], rule=rc.Any())
    placed = rig.poses(poses)
    regions, before = (rc.regions(mesh, each, placed, TASK) for each in (rig, [camera, camera]))
    for name in ("xy", "starts", "face", "pose", "pair_pose", "pair_face", "area", "bound"):
        assert getattr(regions, name).tobytes() == getattr(before, name).tobytes()


def test_rigs_of_several_rules_keep_the_order_of_their_rows():
    mesh, camera, poses = room()
    pair, three = head(camera, 0.3), rc.Rig([PROJECTOR] * 3, rule=rc.AtLeast(2))
    lone = rc.Rig([camera])
    both = rc.Rig.of_several([pair, lone, three], [f"c{row}" for row in range(6)])
    parts = [
        pair.poses(poses[0]),
        lone.poses(poses[1]),
        three.poses(poses[2]),
        pair.poses(poses[3]),
    ]
    shift = [0, 2, 3, 0]
    index = np.concatenate([each.camera + s for each, s in zip(parts, shift, strict=True)])
    placed = rc.Poses.of(np.concatenate([each.world_from_camera for each in parts]), camera=index)
    regions = rc.regions(mesh, both, placed, TASK)
    for row, (rig, own) in enumerate(zip((pair, lone, three, pair), parts, strict=True)):
        assert np.array_equal(regions.areas()[row], rc.regions(mesh, rig, own, TASK).areas()[0])


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        ({"method": "sampled"}, "regions are exact"),
        ({"task": rc.Task(min_pixels=4)}, "min_pixels applies to faces"),
        ({"task": rc.Task(min_visibility=0.9)}, "min_visibility applies to faces"),
        ({"task": rc.Task(min_coverage=0.9)}, "min_coverage applies to faces"),
        ({"tasks": {"left": rc.Task(views=2)}}, "expected one view"),
        ({"tasks": {"left": {"min_pixels": 3}}}, "min_pixels applies to faces"),
        ({"tasks": {"left": {"lux": 3}}}, "'left'"),
    ],
)
def test_what_no_gate_has_is_refused_in_one_line(ask, words):
    rig = head(CAMERA, tasks=ask.get("tasks", {}))
    more = {name: value for name, value in ask.items() if name == "method"}
    with pytest.raises(ConfigError, match=words) as error:
        rc.regions(sheet(), rig, rig.poses(np.eye(4)), ask.get("task", TASK), **more)
    assert "\n" not in str(error.value)


BAD = [
    (lambda: rc.Rig([CAMERA], rule=rc.All()), "expected 2 to 64 sensors for a rule, got"),
    (lambda: head(CAMERA, rule="all"), "rule to be"),
    (lambda: head(CAMERA, rule=rc.AtLeast(3)), "1 to 2"),
    (lambda: head(CAMERA, rule=rc.AtLeast(1.5)), "whole number"),
    (lambda: head(CAMERA, rule=rc.AtLeast(1, needs=["proj"])), "some of 'left', 'right'"),
    (
        lambda: head(CAMERA, rule=rc.AtLeast(1, needs=["left", "right"])),
        "expected AtLeast to need at most k = 1 sensors, got 2",
    ),
    (lambda: head(CAMERA, tasks={"proj": rc.Task()}), "names of cameras"),
    (lambda: rc.Rig([CAMERA] * 65, rule=rc.All()), "expected 2 to 64 sensors for a rule, got"),
]


@pytest.mark.parametrize(("make", "words"), BAD)
def test_rules_that_cannot_be_are_refused_in_one_line(make, words):
    with pytest.raises(CameraError, match=words) as error:
        make()
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("index", [[0], [1, 0], [0, 0], [0, 1, 1], [0, 1, 0], [1]])
def test_poses_of_some_devices_alone_are_refused(index):
    rig, mesh = head(CAMERA), sheet()
    placed = rc.Poses.of(np.repeat(np.eye(4)[None], len(index), axis=0), camera=index)
    with pytest.raises(PoseError, match=r"Rig\.poses"):
        rc.regions(mesh, rig, placed)


@pytest.mark.parametrize(
    ("own", "words"),
    [({"views": 2}, "one view"), (5, "expected a Task"), ({"sharp": 1}, "sharp")],
)
def test_thresholds_that_no_device_can_have_are_refused(own, words):
    with pytest.raises(ConfigError, match=words):
        rc.regions(sheet(), rig := head(CAMERA, tasks={"left": own}), rig.poses(np.eye(4)))


@pytest.mark.parametrize("arguments", [(0,), (1.5,), (2, [0]), (2, [0.5, 1])])
def test_gates_that_cannot_be_are_refused(arguments):
    regions = rc.regions(sheet(), CAMERA, np.repeat(np.eye(4)[None], 2, axis=0))
    with pytest.raises(ConfigError):
        regions.at_least(*arguments)


def test_no_poses_give_no_rows():
    rig = head(CAMERA)
    assert len(rc.regions(sheet(), rig, rig.poses(np.zeros((0, 4, 4)))).pose_ids) == 0
