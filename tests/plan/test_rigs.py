"""Plans with rigs: cameras that move together are one choice."""

import json
from pathlib import Path

import numpy as np
import pytest
from coarse_pictures import coarse_pictures  # noqa: F401 # a fixture for every test
from surface_cases import room

import rastercov as rc
from rastercov.camera.formats import write_views
from rastercov.placement import Objective
from rastercov.placement.plan import run as plan_run
from rastercov.placement.plan.check import check, limits
from rastercov.placement.plan.file import read_plan
from rastercov.placement.plan.network import observer_of
from rastercov.placement.plan.prepare import counting
from rastercov.placement.plan.run import place
from rastercov.report import plan as report

MESH, _, _ = room()
EYE = "[cameras.eye]\nwidth = 160\nheight = 120\nhfov_deg = 60\n"
PAIR = """
[[rigs.pair.cameras]]
camera = "eye"
name = "left"
angle_deg = -30
translation = [-0.1, 0, 0]
[[rigs.pair.cameras]]
camera = "eye"
name = "right"
angle_deg = 30
translation = [0.1, 0, 0]
"""
PLAN = """
[[meshes]]
path = "room.obj"
{cameras}
[task]
{task}
[[candidates]]
generator = "on_walls"
spacing = 3.0
heights = [2.4, 2.6]
{entry}
[selection]
{goal}
[outputs]
page = {page}
"""
BY_AREA = "min_pixels_per_m2 = 300\nresolution_of_result = 0.8"
TWO = 'goal = "best_coverage"\ncameras = 2'


def plan_of(cameras, goal=TWO, task=BY_AREA, entry="", page="false"):
    Path("plan.toml").write_text(
        PLAN.format(cameras=cameras, goal=goal, task=task, entry=entry, page=page)
    )
    return read_plan("plan.toml")


def placed(*arguments, **named):
    return place(plan_of(*arguments, **named), None)


def figures(found):
    summary = report.summary(found)
    return json.loads(json.dumps(summary, default=lambda value: np.asarray(value).tolist()))


@pytest.mark.slow
def test_a_rig_of_one_camera_is_placed_as_that_camera():
    goal = TWO + "\nrefine = true\nrefine_budget = 300"
    alone = placed(EYE, goal)
    rig = placed(EYE + '[[rigs.one.cameras]]\ncamera = "eye"\n', goal)
    np.testing.assert_array_equal(alone.cameras.poses, rig.cameras.poses)
    assert alone.cameras.share == rig.cameras.share
    assert alone.selection.chosen.tolist() == rig.selection.chosen.tolist()
    assert rig.prepared.mounts.names == ("eye", "one")
    assert set(rig.cameras.placed.camera) == {1}  # a camera on a rig is no candidate of its own


@pytest.mark.slow
@pytest.mark.parametrize("task", [BY_AREA, 'by = "face"\nmin_pixels = 4'])
def test_a_rig_that_adds_nothing_after_refinement_is_left_out_with_all_its_cameras(
    task, monkeypatch
):
    def onto_the_first(placement, objectives, poses, how):
        """A refinement that leaves the second rig where the first is."""
        return plan_run._of_rows(placement, objectives, [0, 0])

    monkeypatch.setattr(plan_run, "_moved", onto_the_first)
    found = placed(EYE + PAIR, TWO + "\nrefine = true\nrefine_budget = 3", task=task)
    assert found.left_out == (1,)
    assert (len(found.cameras.mounted), len(found.cameras.placed)) == (1, 2)
    names = found.prepared.mounts.rig.names
    assert [names[row] for row in found.cameras.placed.camera] == ["pair/left", "pair/right"]
    summary = report.summary(found)
    assert summary["improvement"]["refinement"]["left_out"] == [1]
    assert len(report.poses_of(found)["world_from_camera"]) == 2
    assert any("added nothing after refinement" in line for line in report.lines(found))


@pytest.mark.slow
@pytest.mark.parametrize("task", [BY_AREA, 'by = "face"\nmin_pixels = 4'])
def test_two_rigs_are_four_cameras(task):
    goal = TWO + "\nrefine = true\nrefine_budget = 300\n[selection.tolerance]\ndraws = 2"
    found = placed(EYE + PAIR, goal, task=task)
    cameras = found.cameras
    assert (len(cameras.mounted), len(cameras.placed)) == (2, 4)
    assert cameras.owner.tolist() == [0, 0, 1, 1]
    rig = found.prepared.mounts.rig
    assert [rig.names[row] for row in cameras.placed.camera] == ["pair/left", "pair/right"] * 2
    for row in (0, 2):
        left, right = cameras.poses[row : row + 2]
        own = np.linalg.inv(left) @ right
        place = rig.rig_from_camera
        np.testing.assert_allclose(own, np.linalg.inv(place[1]) @ place[2], atol=1e-9)
    assert found.selection.cost == 4  # of two cameras each
    if cameras.areas is not None:
        exact = rc.unite(rc.regions(found.prepared.mesh, rig, cameras.placed, found.prepared.task))
        assert cameras.share == pytest.approx(exact.share(), abs=1e-9)
    summary = figures(found)
    assert [each["mount"] for each in summary["cameras"]] == [0, 0, 1, 1]
    assert len(summary["tolerance"]["cameras"]) == 2
    assert summary["selection"]["cameras"] == 2
    assert {each["camera"] for each in summary["network"]["by_camera"]} == {
        "pair/left", "pair/right",
    }  # fmt: skip


@pytest.mark.slow
def test_rigs_compete_with_lone_cameras_by_cost():
    def names(cost):
        rigs = PAIR + f"[rigs.pair]\ncost = {cost}\n"
        goal = 'goal = "best_coverage"\nbudget = 2'
        found = placed(EYE + rigs, goal, entry='cameras = ["eye", "pair"]')
        return [found.prepared.mounts.names[row] for row in found.cameras.mounted.camera]

    assert names(2.0) != ["pair"]  # two cameras anywhere do better than two in one place
    assert names(1.0) == ["pair", "pair"]


def test_a_rig_may_be_a_file():
    camera = rc.Camera(width=160, height=120, fx=138.56, fy=138.56)
    places = [rc.look_at((x, 0, 0), (8 * x, 0, 2), (0, -1, 0))[0] for x in (-0.1, 0.1)]
    rig = rc.Rig([camera, camera], ["l", "r"], places)
    write_views("rig.json", rc.Views(rig=rig, poses=rc.Poses.of(np.zeros((0, 4, 4)))))
    plan = plan_of('[rigs.pair]\nfile = "rig.json"')
    assert plan.mounts.names == ("pair",)
    assert plan.rig.names == ("pair/l", "pair/r")
    np.testing.assert_allclose(plan.rig.rig_from_camera, places, atol=1e-12)
    assert plan.cost_of("pair", None) == 2
    assert len(place(plan, None).cameras.placed) == 4


@pytest.mark.slow
def test_the_page_has_the_cameras_of_rigs(tmp_path):
    goal = TWO + "\n[selection.tolerance]\ndraws = 2"
    plan = plan_of(EYE + PAIR, goal, page="true")
    report.run_into(plan, tmp_path / "out")
    text = (tmp_path / "out" / "page.html").read_text()
    assert "pair/left" in text
    assert "pair/right" in text
    assert "without camera 0, 1" in text or "without camera 2, 3" in text


TWIN = PAIR.replace("pair", "twin").replace("30", "2").replace("0.1", "0.3")
"""Two cameras side by side, which see nearly the same."""
ONE = 'goal = "best_coverage"\ncameras = 1\n'


def seen_again(found):
    """The network of a placement as `check` sees it."""
    content = report.poses_of(found)
    assert [each["name"] for each in content["mounts"]] == ["twin"] * len(found.cameras.mounted)
    assert list(content["mount"]) == found.cameras.owner.tolist()
    text = json.dumps(content, default=lambda value: np.asarray(value).tolist())
    Path("poses.json").write_text(text)
    plan = read_plan("plan.toml")
    return check(plan, Path("poses.json"), limits(plan, 0.001, [])).cameras


@pytest.mark.slow
@pytest.mark.parametrize("task", ["views = 2", "min_angle_deg = 4", "views = 2\nmin_angle_deg = 6"])
@pytest.mark.parametrize("method", ["greedy", "integer"])
def test_two_cameras_of_a_rig_are_two_views_of_a_face(task, method):
    entry = 'cameras = ["twin"]'
    task = f'{task}\nby = "face"\nmin_pixels = 20'
    found = placed(EYE + TWIN, f'{ONE}method = "{method}"', task=task, entry=entry)
    candidates = found.prepared.pool.candidates.placed
    plan = found.prepared.plan
    with observer_of(plan, MESH) as observer:
        objective = Objective.of(
            observer, found.prepared.task, mounts=plan.mounts, **counting(plan.task)
        )
        shares = [objective.share_of(candidates[row : row + 1]) for row in range(len(candidates))]
    assert found.selection.share == max(shares) > 0
    assert found.cameras.share == max(shares)
    np.testing.assert_array_equal(seen_again(found).covered, found.cameras.covered)


@pytest.mark.slow
def test_views_by_area_are_those_of_the_cameras():
    task = BY_AREA + "\nviews = 2"
    one = placed(EYE + TWIN, ONE, task=task, entry='cameras = ["twin"]')
    assert one.cameras.share > 0
    by_views = one.cameras.areas.summary()["by_views"]
    assert by_views[1]["m2"] > 0.5 * by_views[0]["m2"]
    found = placed(EYE + TWIN, TWO + "\nrefine = true\nrefine_budget = 400", task=task)
    assert len(found.cameras.mounted) == 2
    assert found.cameras.share > one.cameras.share
    assert seen_again(found).areas.summary()["percent"] == pytest.approx(
        100 * found.cameras.share, abs=1e-9
    )
