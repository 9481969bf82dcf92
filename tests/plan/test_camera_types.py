"""Plans with several types of cameras: each pose of a candidate takes any of them, at its cost."""

import json
from pathlib import Path

import numpy as np
import pytest
from surface_cases import room

import rastercov as rc
from rastercov.camera.pose_file import write_poses
from rastercov.placement.plan.check import check, limits
from rastercov.placement.plan.file import read_plan
from rastercov.placement.plan.run import place
from rastercov.placement.plan.scene import candidate_pool, scene
from rastercov.report import plan as report

MESH, _, _ = room()
WIDE = "width = 160\nheight = 120\nhfov_deg = 80\n"
LONG = "width = 160\nheight = 120\nhfov_deg = 30\n"
PLAN = """
[[meshes]]
path = "room.obj"
{cameras}
[task]
min_pixels_per_m2 = {density}
resolution_of_result = 0.8
method = "exact"
[[candidates]]
generator = "on_walls"
spacing = 3.0
heights = [2.4, 2.6]
{entry}
[selection]
{goal}
[outputs]
page = false
"""
BUDGET = 'goal = "best_coverage"\nbudget = {}'
FEWEST = 'goal = "fewest_cameras"\ncoverage = 0.3'


def types(**entries):
    return "".join(f"[cameras.{name}]\n{text}\n" for name, text in entries.items())


def plan_of(cameras, goal=FEWEST, density=400, entry=""):
    Path("plan.toml").write_text(
        PLAN.format(cameras=cameras, goal=goal, density=density, entry=entry)
    )
    return read_plan("plan.toml")


def placed(*arguments, **named):
    return place(plan_of(*arguments, **named), Path("out"))


def names_of(found):
    return [found.prepared.camera.names[row] for row in found.cameras.placed.camera]


@pytest.mark.slow
def test_a_plan_of_one_type_is_the_plan_of_its_camera():
    refined = FEWEST + "\nrefine = true\nrefine_budget = 400\n[selection.tolerance]\ndraws = 3"
    one = placed("[camera]\n" + WIDE, refined)
    other = placed(types(wide=WIDE), refined)
    np.testing.assert_array_equal(one.cameras.poses, other.cameras.poses)
    a, b = (json.loads(json.dumps(report.summary(each), default=plain)) for each in (one, other))
    for summary in (a, b):
        del summary["plan"], summary["seconds"]
    assert a == b
    assert report.poses_of(one).keys() == report.poses_of(other).keys()


def plain(value):
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


@pytest.mark.slow
@pytest.mark.parametrize("goal", [FEWEST, BUDGET.format(3)])
def test_of_two_equal_types_the_cheap_one_is_chosen(goal):
    dear, cheap = f"{WIDE}cost = 2", f"{WIDE}cost = 1"
    found = placed(types(dear=dear, cheap=cheap), goal)
    assert set(names_of(found)) == {"cheap"}
    assert found.selection.cost == len(found.origin)
    alone = placed(types(cheap=cheap), goal)
    assert found.cameras.share == alone.cameras.share


@pytest.mark.slow
def test_types_are_chosen_by_what_they_give_for_their_cost():
    cameras = types(wide=f"{WIDE}cost = 1", long=f"{LONG}cost = {{}}")
    near = placed(cameras.format(4), BUDGET.format(4))
    assert set(names_of(near)) == {"wide"}
    # Only a long lens has so many pixels.
    far = placed(cameras.format(2), BUDGET.format(4), density=3000)
    assert "long" in names_of(far)
    assert far.selection.cost <= 4
    costs = {"wide": 1, "long": 2}
    assert far.selection.cost == sum(costs[name] for name in names_of(far))


def test_a_candidate_has_a_pose_for_each_type_of_its_entry():
    cameras = types(wide=WIDE, long=f"{LONG}cost = 3")
    every = plan_of(cameras, entry="cost = 0.5")
    pool = candidate_pool(every, scene(every))
    n = len(pool.candidates) // 2
    assert pool.candidates.camera.tolist() == [0] * n + [1] * n
    assert pool.costs.tolist() == [0.5] * n + [3.5] * n
    np.testing.assert_array_equal(pool.candidates.poses[:n], pool.candidates.poses[n:])
    some = plan_of(cameras, entry='cameras = ["long"]')
    pool = candidate_pool(some, scene(some))
    assert pool.candidates.camera.tolist() == [1] * n
    assert pool.costs.tolist() == [3.0] * n
    free = plan_of(types(wide=WIDE))
    assert set(candidate_pool(free, scene(free)).costs) == {1.0}


def test_poses_of_a_file_may_name_their_cameras():
    poses = rc.look_at([[1, 1, 2], [2, 1, 2], [3, 1, 2]], [[4, 3, 1]] * 3)
    write_poses("named.json", poses, ["long", "wide", "long"])
    text = (
        '[[meshes]]\npath = "room.obj"\n[[candidates]]\ngenerator = "poses"\nfile = "named.json"\n'
    )
    Path("plan.toml").write_text(text + types(wide=WIDE, long=LONG))
    plan = read_plan("plan.toml")
    pool = candidate_pool(plan, scene(plan))
    assert sorted(zip(pool.candidates.index, pool.candidates.camera, strict=True)) == [
        (0, 1), (1, 0), (2, 1),
    ]  # fmt: skip


@pytest.mark.slow
def test_check_and_evaluate_read_back_what_place_has_written():
    cameras = types(wide=f"{WIDE}cost = 1", long=f"{LONG}cost = 2")
    found = placed(cameras, BUDGET.format(5), density=1500)
    assert len(set(names_of(found))) == 2
    content = json.loads(json.dumps(report.poses_of(found), default=plain))
    assert content["camera"] == names_of(found)
    entries = report.summary(found)["cameras"]
    assert [each["camera"] for each in entries] == names_of(found)
    Path("poses.json").write_text(json.dumps(content))
    plan = read_plan("plan.toml")
    again = check(plan, Path("poses.json"), limits(plan, 0.1, []))
    assert again.cameras.areas.summary()["percent"] == pytest.approx(
        100 * found.cameras.share, abs=1e-9
    )
    views = rc.read_views("poses.json")
    assert views.cameras() == plan.rig.cameras
    assert [views.rig.names[row] for row in views.poses.camera] == names_of(found)
    apart = report.summary(found)["network"]["by_camera"]
    assert [each["poses"] for each in apart] == [names_of(found).count(n) for n in plan.rig.names]


@pytest.mark.slow
def test_moved_cameras_keep_their_types():
    cameras = types(wide=f"{WIDE}cost = 1", long=f"{LONG}cost = 2")
    goal = BUDGET.format(5) + "\nrefine = true\nrefine_budget = 500\n[selection.tolerance]\ndraws=2"
    goal += '\nposition_mm = 1\n[selection.optimise]\nmethod = "random"\nbudget = 50'
    still, moved = (placed(cameras, each, density=1500) for each in (BUDGET.format(5), goal))
    assert names_of(moved) == names_of(still)
    assert moved.refined.share >= moved.refined.start_share
    measured = rc.unite(
        rc.regions(MESH, moved.prepared.camera, moved.cameras.placed, moved.prepared.task)
    )
    assert measured.share() == pytest.approx(moved.cameras.share, abs=1e-9)
