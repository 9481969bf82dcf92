"""Plans with several cameras and with rigs: each pose takes any of them, at its cost."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import plans
import pytest
from plans import told
from surface_cases import room

import rastercov as rc
from rastercov.core.camera.conventions import write_poses
from rastercov.formats.cameras import write_views
from rastercov.placement import Objective
from rastercov.placement.plan import run as plan_run
from rastercov.placement.plan.file import PlanError, plan_of
from rastercov.placement.plan.scene import candidate_pool, scene

MESH, _, _ = room()
WIDE = {"width": 160, "height": 120, "hfov_deg": 80}
LONG = WIDE | {"hfov_deg": 30}
EYE = WIDE | {"hfov_deg": 60}
WALLS = {"generator": "on_walls", "spacing": 3.0, "heights": [2.4, 2.6]}
BY_AREA = {"min_pixels_per_m2": 300, "resolution_of_result": 0.8}
BY_FACE = {"by": "face", "min_pixels": 4}
TWO = {"goal": "best_coverage", "cameras": 2}
FEWEST = {"goal": "fewest_cameras", "coverage": 0.3}
TOLERANCE = {"tolerance": {"draws": 2, "position_mm": 1}}
PLAN = {
    "meshes": [{"path": "room.obj"}],
    "task": BY_AREA,
    "candidates": [WALLS],
    "selection": TWO,
    "outputs": {"page": False},
}
placed = partial(plans.placed, PLAN)


def eye(name, angle_deg, x):
    return {"camera": "eye", "name": name, "angle_deg": angle_deg, "translation": [x, 0, 0]}


def pair(angle_deg, distance):
    """A rig of two cameras, turned away from each other."""
    return {"cameras": [eye("left", -angle_deg, -distance), eye("right", angle_deg, distance)]}


PAIR = {"cameras": {"eye": EYE}, "rigs": {"pair": pair(30, 0.1)}}
TWIN = {
    "cameras": {"eye": EYE},
    "rigs": {"twin": pair(2, 0.3)},
    "candidates": [WALLS | {"cameras": ["twin"]}],
}
"""Two cameras side by side, which see nearly the same."""


def costing(wide, long):
    return {"wide": WIDE | {"cost": wide}, "long": LONG | {"cost": long}}


def budget(cost):
    return {"goal": "best_coverage", "budget": cost}


def names_of(result):
    """Names of the chosen cameras and rigs."""
    return [result.prepared.mounts.names[row] for row in result.cameras.mounted.camera]


def exact_share(result):
    prepared = result.prepared
    return rc.unite(
        rc.regions(MESH, prepared.mounts.rig, result.cameras.placed, prepared.task)
    ).share()


def checked(**sections):
    """The network that was written, as `check` sees it with the cameras of the plan."""
    return rc.check(PLAN | sections, "out/poses.json", min_coverage=0.001).cameras


@pytest.mark.slow
def test_one_camera_is_placed_the_same_by_any_name_and_on_a_rig_of_its_own():
    goal = FEWEST | TOLERANCE | {"refine": True, "refine_budget": 300}
    alone = placed(camera=EYE, selection=goal)
    expected = told() | {"seconds": {}, "plan": ""}
    rig = {"one": {"cameras": [{"camera": "eye"}]}}
    for rigs in ({}, rig):
        placement = placed(cameras={"eye": EYE}, rigs=rigs, selection=goal)
        np.testing.assert_array_equal(alone.cameras.poses, placement.cameras.poses)
        assert alone.cameras.share == placement.cameras.share
        assert alone.selection.chosen.tolist() == placement.selection.chosen.tolist()
        assert rigs or told() | {"seconds": {}, "plan": ""} == expected
    assert placement.prepared.mounts.names == ("eye", "one")
    assert set(names_of(placement)) == {"one"}  # a camera on a rig is no candidate of its own


@pytest.mark.slow
@pytest.mark.parametrize("goal", [FEWEST, budget(3)])
def test_of_two_equal_cameras_the_cheap_one_is_chosen(goal):
    cameras = {"dear": WIDE | {"cost": 2}, "cheap": WIDE | {"cost": 1}}
    placement = placed(cameras=cameras, selection=goal)
    assert set(names_of(placement)) == {"cheap"}
    assert placement.selection.cost == len(placement.origin)
    assert placement.cameras.share == placed(camera=WIDE, selection=goal).cameras.share


@pytest.mark.slow
def test_cameras_and_rigs_are_chosen_by_what_they_give_for_their_cost():
    assert set(names_of(placed(cameras=costing(1, 4), selection=budget(4)))) == {"wide"}
    dense = BY_AREA | {"min_pixels_per_m2": 3000}  # only a long lens has so many pixels
    far = placed(cameras=costing(1, 2), selection=budget(4), task=dense)
    assert "long" in names_of(far)
    costs = {"wide": 1, "long": 2}
    assert far.selection.cost == sum(costs[name] for name in names_of(far)) <= 4
    own = PAIR | {"candidates": [WALLS | {"cameras": ["eye", "pair"]}], "selection": budget(2)}
    # Two cameras anywhere do better than two in one place.
    assert names_of(placed(**own | {"rigs": {"pair": pair(30, 0.1) | {"cost": 2.0}}})) != ["pair"]
    cheap = placed(**own | {"rigs": {"pair": pair(30, 0.1) | {"cost": 1.0}}})
    assert names_of(cheap) == ["pair", "pair"]


def test_a_candidate_has_a_pose_for_each_camera_of_its_entry():
    def pool_of(cameras, entry):
        plan = plan_of(PLAN | {"cameras": cameras, "candidates": [entry]})
        return candidate_pool(plan, scene(plan))

    types = {"wide": WIDE, "long": LONG | {"cost": 3}}
    every = pool_of(types, WALLS | {"cost": 0.5})
    n = len(every.candidates) // 2
    assert every.candidates.camera.tolist() == [0] * n + [1] * n
    assert every.costs.tolist() == [0.5] * n + [3.5] * n
    np.testing.assert_array_equal(every.candidates.poses[:n], every.candidates.poses[n:])
    some = pool_of(types, WALLS | {"cameras": ["long"]})
    assert some.candidates.camera.tolist() == [1] * n
    assert some.costs.tolist() == [3.0] * n
    assert set(pool_of({"wide": WIDE}, WALLS).costs) == {1.0}
    poses = rc.look_at([[1, 1, 2], [2, 1, 2], [3, 1, 2]], [[4, 3, 1]] * 3)
    write_poses("named.json", poses, ["long", "wide", "long"])
    named = pool_of(types, {"generator": "poses", "file": "named.json"}).candidates
    assert sorted(zip(named.index, named.camera, strict=True)) == [(0, 1), (1, 0), (2, 1)]


@pytest.mark.slow
def test_cameras_keep_their_kinds_when_moved_and_when_read_back():
    cameras, dense = costing(1, 2), BY_AREA | {"min_pixels_per_m2": 1500}
    moves = {"refine": True, "refine_budget": 500} | TOLERANCE
    moves |= {"optimise": {"budget": 50}}
    still = placed(cameras=cameras, selection=budget(5), task=dense)
    names = names_of(still)
    assert len(set(names)) == 2
    assert told("poses.json")["camera"] == names
    assert [each["camera"] for each in told()["cameras"]] == names
    apart = told()["network"]["by_camera"]
    assert [each["poses"] for each in apart] == [names.count(n) for n in cameras]
    views = rc.read_views("out/poses.json")
    assert views.cameras() == still.prepared.mounts.rig.cameras
    again = checked(cameras=cameras, task=dense)
    assert again.areas.summary()["percent"] == pytest.approx(100 * still.cameras.share, abs=1e-9)
    moved = placed(cameras=cameras, selection=budget(5) | moves, task=dense)
    assert names_of(moved) == names
    assert moved.refined.share >= moved.refined.start_share
    assert exact_share(moved) == pytest.approx(moved.cameras.share, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("task", [BY_AREA, BY_FACE])
def test_a_rig_that_adds_nothing_after_refinement_is_left_out_with_all_its_cameras(
    task, monkeypatch
):
    def onto_the_first(placement, objectives, poses, how):
        """A refinement that leaves the second rig where the first is."""
        return plan_run._of_rows(placement, objectives, [0, 0])

    monkeypatch.setattr(plan_run, "_move_cameras", onto_the_first)
    result = placed(**PAIR, task=task, selection=TWO | {"refine": True, "refine_budget": 3})
    assert result.left_out == (1,)
    assert (names_of(result), len(result.cameras.placed)) == (["pair"], 2)
    assert [each["camera"] for each in told()["cameras"]] == ["pair/left", "pair/right"]
    assert told()["improvement"]["refinement"]["left_out"] == [1]
    assert len(told("poses.json")["world_from_camera"]) == 2


@pytest.mark.slow
@pytest.mark.parametrize("task", [BY_AREA, BY_FACE])
def test_two_rigs_are_four_cameras(task):
    goal = TWO | TOLERANCE | {"refine": True, "refine_budget": 300}
    placement = placed(**PAIR, task=task, selection=goal, outputs={"page": task is BY_AREA})
    cameras, rig = placement.cameras, placement.prepared.mounts.rig
    assert names_of(placement) == ["pair", "pair"]
    assert cameras.owner.tolist() == [0, 0, 1, 1]
    for left, right in (cameras.poses[:2], cameras.poses[2:]):
        own, place = np.linalg.inv(left) @ right, rig.rig_from_camera
        np.testing.assert_allclose(own, np.linalg.inv(place[1]) @ place[2], atol=1e-9)
    assert placement.selection.cost == 4  # of two cameras each
    assert len(told()["tolerance"]["cameras"]) == told()["selection"]["cameras"] == 2
    sides = ["pair/left", "pair/right"]
    assert [each["mount"] for each in told()["cameras"]] == [0, 0, 1, 1]
    assert [each["camera"] for each in told()["cameras"]] == sides * 2
    assert {each["camera"] for each in told()["network"]["by_camera"]} == set(sides)
    if task is BY_AREA:
        assert cameras.share == pytest.approx(exact_share(placement), abs=1e-9)
        text = Path("out/page.html").read_text()
        assert all(name in text for name in sides)
        assert "Removing cameras 1, 2 " in text or "Removing cameras 3, 4 " in text


def test_poses_of_rigs_are_checked_by_their_names():
    placement = placed(**PAIR)
    mounted = {"world_from_camera": placement.cameras.mounted.world_from_camera.tolist()}
    Path("rigs.json").write_text(json.dumps(mounted | {"camera": names_of(placement)}))
    Path("bare.json").write_text(json.dumps(mounted))
    one, other = (
        rc.check(PLAN | PAIR, path, min_coverage=0.1).summary()
        for path in ("rigs.json", "out/poses.json")
    )
    assert one["covered_area"] == other["covered_area"]
    with pytest.raises(rc.PoseError, match=r"camera or rig of each pose, one of eye, pair, got"):
        rc.check(PLAN | PAIR, "bare.json", min_coverage=0.1)


def test_a_rig_may_be_a_file():
    camera = rc.Camera(width=160, height=120, fx=138.56, fy=138.56)
    places = [rc.look_at((x, 0, 0), (8 * x, 0, 2), (0, -1, 0))[0] for x in (-0.1, 0.1)]
    rig = rc.Rig([camera, camera], ["l", "r"], places)
    write_views("rig.json", rc.Views(rig=rig, poses=rc.Poses.of(np.zeros((0, 4, 4)))))
    placement = placed(rigs={"pair": {"file": "rig.json"}})
    mounts = placement.prepared.mounts
    assert (mounts.names, mounts.rig.names) == (("pair",), ("pair/l", "pair/r"))
    np.testing.assert_allclose(mounts.rig.rig_from_camera, places, atol=1e-12)
    assert placement.selection.cost == len(placement.cameras.placed) == 4


@pytest.mark.slow
@pytest.mark.parametrize(
    "task", [{"views": 2}, {"min_angle_deg": 4}, {"views": 2, "min_angle_deg": 6}]
)
@pytest.mark.parametrize("method", ["greedy", "integer"])
def test_two_cameras_of_a_rig_are_two_views_of_a_face(task, method):
    task = task | {"by": "face", "min_pixels": 20}
    goal = {"goal": "best_coverage", "cameras": 1, "method": method}
    placement = placed(**TWIN, selection=goal, task=task)
    prepared = placement.prepared
    candidates = prepared.pool.candidates.placed
    with rc.open_observer(MESH, prepared.mounts.rig) as observer:
        objective = Objective.of(observer, prepared.task, mounts=prepared.mounts)
        shares = [objective.share_of(candidates[row : row + 1]) for row in range(len(candidates))]
    assert placement.selection.share == placement.cameras.share == max(shares) > 0
    np.testing.assert_array_equal(checked(**TWIN, task=task).covered, placement.cameras.covered)


@pytest.mark.slow
def test_views_by_area_are_those_of_the_cameras():
    task = BY_AREA | {"views": 2}
    one = placed(**TWIN, selection=TWO | {"cameras": 1}, task=task)
    by_views = one.cameras.areas.summary()["by_views"]
    assert by_views[1]["m2"] > 0.5 * by_views[0]["m2"]
    two = placed(**TWIN, selection=TWO | {"refine": True, "refine_budget": 400}, task=task)
    assert two.cameras.share > one.cameras.share > 0
    content = told("poses.json")
    assert [each["name"] for each in content["mounts"]] == ["twin", "twin"]
    assert content["mount"] == two.cameras.owner.tolist()
    percent = checked(**TWIN, task=task).areas.summary()["percent"]
    assert percent == pytest.approx(100 * two.cameras.share, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("rig", [pair(30, 0.1), {"rule": "all"} | pair(2, 0.3)])
def test_rigs_that_were_placed_stay_and_others_are_placed_beside_them(rig):
    own = {"cameras": {"eye": EYE}, "rigs": {"pair": rig}}
    before = placed(**own)
    Path("out/poses.json").rename("there.json")
    there = {"existing": {"file": "there.json"}, "selection": TWO | {"cameras": 1}}
    after = placed(**own | there)
    assert after.origin[:2] == ("existing 0", "existing 2")
    assert after.cameras.share > before.cameras.share
    kept = after.cameras.placed.world_from_camera[:4]
    np.testing.assert_allclose(kept, before.cameras.placed.world_from_camera, atol=1e-12)
    percent = checked(**own).areas.summary()["percent"]
    assert percent == pytest.approx(100 * after.cameras.share, abs=1e-9)
    moves = {"file": "there.json", "move": [3]}  # by any of its cameras
    moved = placed(**own | there | {"existing": moves})
    assert moved.origin[0] == "existing 0"
    assert len(moved.origin) == 2
    assert moved.cameras.share >= before.cameras.share - 1e-9
    poses = before.cameras.mounted.world_from_camera
    write_poses("rigs.json", poses, ["pair", "pair"])
    again = placed(**own | there | {"existing": {"file": "rigs.json", "move": [1]}})
    assert again.origin[0] == "existing 0"
    assert again.cameras.share == pytest.approx(moved.cameras.share, abs=1e-9)
    content = json.loads(Path("there.json").read_text())
    content["world_from_camera"][1][0][3] += 0.01
    Path("there.json").write_text(json.dumps(content))
    with pytest.raises(PlanError, match="existing: expected all cameras of a rig in its order"):
        placed(**own | there)
