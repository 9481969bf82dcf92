"""Goals of a plan with groups, thresholds and views of their own, and cameras that stay."""

import html
import json
import re
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
import shapely
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from nightly import amount, examples

import rastercov as rc
from rastercov.base import json_text, percent
from rastercov.base.errors import ConfigError
from rastercov.base.format import points
from rastercov.core.area.cells import LEAST_CELLS, TOGETHER, USUAL_CELLS
from rastercov.core.area.remedies import ANY
from rastercov.core.area.stages import add_rows
from rastercov.core.camera import Poses
from rastercov.core.coverage.exact_pass import ExactPass
from rastercov.core.raster import open_rasterizer
from rastercov.placement.matrix import build_matrix
from rastercov.placement.plan import shortfall
from rastercov.placement.plan.baseline import compare
from rastercov.placement.plan.check import (
    MOST_GOALS,
    CheckedGoals,
    _check_rig,
    explain_goals,
    record,
    to_json,
)
from rastercov.placement.plan.file import PlanError, plan_of
from rastercov.placement.plan.goals import (
    OF_GOALS,
    OF_TASK,
    AlikeGoals,
    _stack_goals,
    open_objectives,
    permits_of,
    problems_of,
    separate_goals,
    with_goals,
)
from rastercov.placement.plan.network import counting
from rastercov.placement.plan.outcome import cases
from rastercov.placement.plan.prepare import quiet
from rastercov.placement.plan.run import _raise_goals
from rastercov.placement.plan.scene import name_scene
from rastercov.placement.select.methods import select_integer
from rastercov.placement.select.problem import (
    BestCoverage,
    FewestCameras,
    problem_of,
    problem_of_matrix,
)
from rastercov.report.check import html_of
from rastercov.report.network_page import MOST_CLOSE_UPS
from rastercov.report.placement import network_of, pages_of
from rastercov.report.plan import head_lines, lines, poses_of, summary
from rastercov.shards import silent

QUADS = {
    "floor": ((0, 0, 0), (4, 0, 0), (4, 4, 0), (0, 4, 0)),
    "north": ((0, 4, 0), (4, 4, 0), (4, 4, 3), (0, 4, 3)),
    "window": ((1, 3.99, 1), (2, 3.99, 1), (2, 3.99, 2), (1, 3.99, 2)),
    "west": ((0, 0, 0), (0, 4, 0), (0, 4, 3), (0, 0, 3)),
}
"""Walls of a room, seen from inside, with a window before one of them."""


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    lines, n = [], 0
    for name, corners in QUADS.items():
        lines += [f"v {x} {y} {z}" for x, y, z in corners]
        lines += [f"g {name}", f"f {n + 1} {n + 2} {n + 3}", f"f {n + 1} {n + 3} {n + 4}"]
        n += 4
    path = tmp_path_factory.mktemp("room") / "room.obj"
    path.write_text("\n".join(lines))
    return path


def plan(room, **entries):
    return {
        "meshes": [{"path": str(room)}],
        "camera": {"width": 1920, "height": 1080, "hfov_deg": 90.0},
        "task": {"min_facing_density": "observe"},
        "candidates": [{"generator": "on_walls", "spacing": 1.5, "aim": [{"middle": True}]}],
    } | entries


DOORS = {"groups": ["west"], "coverage": 0.7, "min_facing_density": "identify"}
PRIVATE = {"groups": ["window"], "at_most": 0.0, "min_facing_density": "recognise"}


def of(checked, name):
    (result,) = [each for each in checked.requirements if each.goal == name]
    return result


def test_a_goal_is_what_a_plan_of_its_groups_alone_answers(room):
    """Thresholds that a goal leaves out are those of the task; others hide and are not scored."""
    poses = rc.look_at([(3.5, 0.5, 2.5), (3.8, 3.0, 1.5)], [(1, 2.5, 1), (0, 2.0, 1)])
    task = {"min_facing_density": "observe", "max_incidence_deg": 50.0}
    asked = plan(room, task=task, goals={"doors": DOORS})
    checked = rc.check(asked, poses, min_coverage=0.5)
    alone = [{"path": str(room), "role": "occluder", "groups": ["floor", "north", "window"]}]
    own = plan(room, meshes=alone, task=task | {"min_facing_density": "identify"})
    (wanted,) = rc.check(own, poses, min_coverage=0.7).requirements
    result = of(checked, "doors")
    assert 0 < result.m2 == wanted.m2
    assert (result.low, result.high, result.status) == (wanted.low, wanted.high, wanted.status)
    rest = [{"path": str(room), "role": "occluder", "groups": ["west"]}]
    (others,) = rc.check(plan(room, meshes=rest, task=task), poses, min_coverage=0.5).requirements
    assert checked.requirements[0] == others


@pytest.mark.parametrize("first", [0, 1])
def test_targets_of_one_name_are_all_meant_by_it(room, first):
    """What must not be seen was the first of them alone, and proved."""
    zones = [
        {"name": "private", "box": [[x, 2, 1.0], [x + 0.2, 2.2, 1.2]], "count": [1, 1, 1]}
        for x in (1.0, 8.0)
    ]
    asked = plan(
        room,
        targets=[zones[first], zones[1 - first]],
        goals={"secret": {"groups": ["private"], "at_most": 0.0}},
    )
    poses = rc.look_at([(3.5, 0.5, 1.5)], [(1, 2, 1.1)])
    secret = of(rc.check(asked, poses, min_coverage=0.1), "secret")
    assert secret.status == "fails"


def test_views_of_a_check_are_those_of_goals_without_their_own(room):
    poses = rc.look_at([(3.5, 0.5, 2.5), (3.8, 3.0, 1.5)], [(1, 2.5, 1), (0, 2.0, 1)])
    goals = {"doors": DOORS, "one": DOORS | {"groups": ["floor"], "views": 1}, "window": PRIVATE}
    own = {"min_facing_density": "observe"}
    told = rc.check(plan(room, task=own, goals=goals), poses, min_coverage=0.5, views=2)
    task = own | {"views": 2}
    wanted = rc.check(plan(room, task=task, goals=goals), poses, min_coverage=0.5)
    assert told.requirements == wanted.requirements
    as_planned = rc.check(plan(room, task=own, goals=goals), poses, min_coverage=0.5)
    assert of(told, "doors").m2 < of(as_planned, "doors").m2
    assert of(told, "one").m2 == of(as_planned, "one").m2 > 0


@examples(5, at_night=40)
@given(seed=st.integers(0, 10**6))
def test_what_must_not_be_seen_holds_where_no_point_of_it_is_covered(room, seed):
    """Thresholds of the task are not those of what must not be seen."""
    rng = np.random.default_rng(seed)
    poses = rc.look_at(rng.uniform((0.2, 0.2, 0.5), (3.8, 3.5, 2.5), (2, 3)), (1.5, 2.0, 1.0))
    task = {"max_incidence_deg": 20.0}
    limit = float(rng.choice([0.0, 0.2]))
    goal = PRIVATE | {"at_most": limit}
    checked = rc.check(plan(room, task=task, goals={"window": goal}), poses)
    camera, result = checked.plan.rig.cameras[0], of(checked, "window")
    points = np.column_stack(
        (rng.uniform(1, 2, 4000), np.full(4000, 3.99), rng.uniform(1, 2, 4000))
    )
    ways = points - poses[:, None, :3, 3]
    depth = np.einsum("pni,pi->pn", ways, poses[:, :3, 2])
    u = np.einsum("pni,pi->pn", ways, poses[:, :3, 0]) / depth * camera.fx
    v = np.einsum("pni,pi->pn", ways, poses[:, :3, 1]) / depth * camera.fy
    is_in = (depth > 0) & (abs(u) < 960) & (abs(v) < 540) & (camera.fx / depth >= 125)
    share = is_in.any(axis=0).mean()  # nothing hides the window; 6 standard deviations
    assert abs(share - result.share) < 0.05
    assert result.status == ("holds" if result.share <= limit + 1e-9 else "fails")
    if result.status == "fails":
        assert result.lack > 0
        assert checked.reasons(result)[0].startswith("seen by camera ")


LIMITED = {
    "rule": {"rule": "all"},
    "own thresholds": {"task": {"max_incidence_deg": 5.0}},
    "focus": {"focus_range": [0.1, 0.2]},
    "lamps": {
        "lamps": {
            "key": {
                "kind": "spot",
                "intensity_cd": 900,
                "half_angle_deg": 20,
                "position": [3, 1, 2],
                "aim": [3, 1, 0],
            }
        }
    },
    "faces": {"of_task": {"min_pixels": 10**6}},
    "frames": {
        "of_task": {"over": "all"},
        "motion": {
            "conveyor": {"body": "west", "steps": 2, "direction": [1, 0, 0], "distance": 2.0}
        },
    },
    "unit": {"of_task": {"max_incidence_deg": 5.0, "weight_by": "area"}},
    "views": {"of_task": {"views": 2, "min_angle_deg": 20.0}},
}


@pytest.mark.parametrize("limit", LIMITED)
@pytest.mark.parametrize("is_seen", [True, False])
def test_what_must_not_be_seen_is_what_any_camera_sees(room, limit, is_seen):
    """Alone, blurred, in the dark, and whatever its own thresholds: none proves that it is not."""
    own = dict(LIMITED[limit])
    camera = {"width": 960, "height": 540, "hfov_deg": 60.0}
    camera |= {key: own.pop(key) for key in ("focus_range",) if key in own}
    sensors = [
        {"camera": "one", "name": "left"} | ({"task": own.pop("task")} if "task" in own else {}),
        {"camera": "one", "name": "right", "angle_deg": 70.0},
    ]
    rigs = {"pair": {"cameras": sensors} | ({"rule": own.pop("rule")} if "rule" in own else {})}
    if limit == "own thresholds":
        sensors[1]["task"] = sensors[0]["task"]
    task = {"max_incidence_deg": 80.0} | own.pop("of_task", {})
    asked = plan(room, goals={"window": {"groups": ["window"], "at_most": 0.0}}, task=task)
    del asked["camera"], asked["candidates"]
    asked |= {"cameras": {"one": camera}} | own
    asked |= {"rigs": rigs} if limit not in ("faces", "frames", "views") else {}
    eye, to = (2.5, 1.0, 1.5), (1.5, 4.0, 1.5) if is_seen else (4.5, 0.0, 1.5)
    poses = rc.look_at([eye], [to])
    if "rigs" in asked:
        mounts = plan_of(asked).rig
        matrices = np.concatenate([poses @ each for each in mounts.rig_from_camera[-2:]])
        poses = rc.Poses.of(matrices, camera=np.arange(len(mounts) - 2, len(mounts)))
    checked = rc.check(asked, poses, min_coverage=0.01)
    result = of(checked, "window")
    (told,) = explain_goals([result], checked.goals)
    assert (result.status, told["is_unseen"]) == (("fails", False) if is_seen else ("holds", True))
    assert result.share == pytest.approx(float(is_seen), abs=0.02)
    assert ("no camera sees any of it (proved)" in told["lines"]) != is_seen


def test_what_must_not_be_seen_counts_from_either_side(room):
    """A window that is wound the other way is seen as well."""
    lines = room.read_text().splitlines()
    at = lines.index("g window") + 1
    for row in (at, at + 1):
        _, first, second, third = lines[row].split()
        lines[row] = f"f {first} {third} {second}"
    flipped = room.parent / "flipped.obj"
    flipped.write_text("\n".join(lines))
    pose = rc.look_at((2, 1, 1.5), (1.5, 4, 1.5))
    one, other = (
        of(rc.check(plan(path, goals={"window": PRIVATE}), pose), "window")
        for path in (room, flipped)
    )
    assert one.share == pytest.approx(other.share, abs=1e-9)
    assert one.share > 0.9
    assert one.status == other.status == "fails"


def advised(result, plan):
    """Cameras that advice for the dead zones of a result names."""
    zones = result.cameras.areas.dead_zones(plan.rig, result.cameras.placed)["dead_zones"]
    tried = [zone["tried"] for zone in zones if zone["tried"]]
    return [rc.look_at([each["position"]], [each["looking_at"]]) for each in tried]


def seen_of_window(room, poses):
    return of(rc.check(plan(room, goals={"window": PRIVATE}), poses), "window").share


def test_advice_of_check_covers_no_more_of_a_goal_than_it_permits(room):
    """Where the goal permits coarse images, a camera that recognises at the window is advised."""
    poses = rc.look_at([(2.0, 1.0, 1.5)], [(2.0, 0.5, 0.0)])
    most = []
    for density in ("recognise", 1e6):
        asked = plan(room, goals={"window": PRIVATE | {"min_facing_density": density}})
        checked = rc.check(asked, poses, min_coverage=0.5)
        named = advised(checked, checked.plan)
        most.append(max(seen_of_window(room, pose) for pose in named))
    assert most[0] == 0 < most[1]


def test_advice_of_place_covers_no_more_of_a_goal_than_it_permits(room):
    selection = {"goal": "fewest_cameras", "coverage": 0.95}
    placed = rc.place(plan(room, goals={"window": PRIVATE}, selection=selection))
    assert not placed.is_met
    assert {seen_of_window(room, pose) for pose in advised(placed, placed.prepared.plan)} == {0.0}


def test_a_baseline_holds_goals_of_their_own_too(room):
    """More of the doors and less of what must not be seen is better, and the reverse worse."""
    asked = plan(room, goals={"doors": DOORS, "window": PRIVATE | {"at_most": 0.9}})
    near = rc.look_at([(1.5, 2.5, 1.5)], [(1.5, 3.9, 1.5)])
    doors = rc.look_at([(1.5, 2.0, 1.5)], [(0.0, 2.0, 1.5)])
    told = [
        json.loads(json.dumps(record(rc.check(asked, poses, min_coverage=0.01))))
        for poses in (near, doors)
    ]
    for before, now, status in ((0, 1, "better"), (1, 0, "worse")):
        against = compare({**told[before], "file": "base.json"}, told[now])
        table = {each["name"]: each["status"] for each in against.shares}
        assert table["goal doors"] == table["goal window"] == status
    told[0]["requirements"] = []
    with pytest.raises(ConfigError, match=r"base\.json"):
        compare({**told[0], "file": "base.json"}, told[1])


@pytest.mark.parametrize("method", ["greedy", "integer"])
def test_cameras_are_chosen_for_the_task_and_all_goals(room, method):
    selection = {"goal": "fewest_cameras", "coverage": 0.6, "method": method}
    selection |= {"refine": True, "refine_budget": amount(300, 20_000)}
    asked = plan(room, goals={"doors": DOORS, "window": PRIVATE}, selection=selection)
    placed = rc.place(asked)
    assert placed.is_met
    assert [each.goal for each in placed.requirements] == ["", "doors", "window"]
    assert placed.requirements[2].high == 0
    checked = rc.check(asked, placed.cameras.placed)
    for one, other in zip(placed.requirements, checked.requirements, strict=True):
        assert one.share == pytest.approx(other.share, abs=1e-12)
    assert any(
        "covers more of goal window than it permits" in each for each in placed.prepared.notes
    )
    without = rc.place(plan(room, selection=selection))
    assert not rc.check(asked, without.cameras.placed).is_met


def test_groups_of_the_task_may_have_shares_beside_goals(room):
    groups = {"floor": 0.6, "north": 0.2}
    selection = {"goal": "fewest_cameras", "coverage": 0.4, "groups": groups}
    selection |= {"tolerance": {"position_mm": 1.0, "draws": 1}}
    placed = rc.place(plan(room, goals={"doors": DOORS, "window": PRIVATE}, selection=selection))
    assert placed.product("tolerance").drawn.nominal == pytest.approx(
        placed.cameras.share, abs=0.02
    )
    assert placed.is_met
    short = [replace(each, status="fails", low=0.0) for each in placed.requirements]
    goal = placed.prepared.problem.goal
    for requirements in (short, short[:1]):
        more = _raise_goals(replace(placed, requirements=tuple(requirements))).problem.goal
        assert all(more.groups[name] >= share for name, share in goal.groups.items())


def test_no_candidate_that_sees_what_must_not_be_seen_is_chosen_and_none_else_is_left_out(room):
    asked = plan(room, goals={"window": PRIVATE}, selection={"goal": "best_coverage", "cameras": 3})
    placed = rc.place(asked)
    candidates = placed.prepared.pool.candidates.placed
    shares = placed.prepared.permitted["window"]
    for row, share in enumerate(shares):
        result = of(rc.check(asked, candidates[row : row + 1]), "window")
        assert result.high == pytest.approx(share, abs=1e-9)
    assert (shares[placed.chosen] == 0).all()
    left = np.diff(placed.prepared.problem.bits.pairs()[0]) > 0
    assert (left == (shares == 0)).all()


@pytest.mark.parametrize("by", ["area", "face"])
@pytest.mark.parametrize("is_partial", [True, False], ids=["of reachable", "of all"])
@examples(4, at_night=40)
@given(seed=st.integers(0, 10**6))
def test_all_candidates_are_those_that_goals_permit(room, by, is_partial, seed):
    """A plan answers as one without the candidates that see what must not be seen."""
    rng = np.random.default_rng(seed)
    low, high = (0.3, 0.3, 0.3), (3.7, 2.0, 2.7)
    clear = rc.look_at(
        rng.uniform(low, high, (3, 3)), rng.uniform((0, 0, 0), (4, 0.5, 0.1), (3, 3))
    )
    seeing = rc.look_at(rng.uniform(low, high, (2, 3)), (1.5, 4.0, 1.5))
    files = [room.parent / f"{name}{by}{is_partial}.json" for name in ("every", "permitted")]
    rc.write_poses(files[0], np.concatenate((seeing, clear)))
    seen = np.array([seen_of_window(room, pose[None]) > 0 for pose in clear])
    assume(not seen.all())
    rc.write_poses(files[1], clear[~seen])
    selection = {"goal": "fewest_cameras", "coverage": 0.98, "of_reachable": is_partial}
    task = {"by": by} | ({"min_pixels": 1e4, "min_coverage": 0.3} if by == "face" else {})
    asked = plan(room, goals={"window": PRIVATE}, selection=selection, task=task)
    every, permitted = (
        rc.place(asked | {"candidates": [{"generator": "poses", "file": str(file)}]})
        for file in files
    )
    assert len(every.prepared.barred) == 2 + seen.sum()
    assert every.requirements == permitted.requirements
    assert every.leftover.summary() == permitted.leftover.summary()
    rows = np.setdiff1d(np.arange(5), every.prepared.barred)
    # Cameras may move to the places of all candidates.
    ends = r"advice: (candidate (\d+) comes closest)?.*"
    notes = [
        re.sub(ends, lambda found: f"{found[2] and rows[int(found[2]) - 1] + 1}", line)
        for line in permitted.prepared.notes
    ]
    own = [line for line in every.prepared.notes if "left out" not in line]
    assert [re.sub(ends, lambda found: f"{found[2]}", line) for line in own] == notes


@pytest.mark.parametrize("width", [1920, 480], ids=["all see it", "finer ones would see it"])
def test_no_goal_is_within_reach_by_what_sees_what_must_not_be_seen(room, monkeypatch, width):
    """Neither by candidates, nor by other places and cameras."""
    rng = np.random.default_rng(5)
    seeing = rc.look_at(rng.uniform((0.3, 0.3, 1.0), (3.7, 1.0, 2.7), (6, 3)), (1.5, 4.0, 1.5))
    rc.write_poses(room.parent / "seeing.json", seeing)
    counted = []

    def add(finder, poses, *others):
        counted.extend((finder.camera, pose) for pose in poses.world_from_camera)
        add_rows(finder, poses, *others)

    monkeypatch.setattr(shortfall, "add_rows", add)
    camera = {"width": width, "height": width * 9 // 16, "hfov_deg": 90.0}
    placed = rc.place(
        plan(
            room,
            camera=camera,
            candidates=[{"generator": "poses", "file": str(room.parent / "seeing.json")}],
            goals={"window": PRIVATE},
            task={"min_facing_density": 100.0},
            selection={"goal": "fewest_cameras", "coverage": 0.6},
        )
    )
    assert len(placed.prepared.barred) == (6 if width == 1920 else 0)
    assert any("whole task out of reach" in note for note in placed.prepared.notes)
    assert counted
    goal = {"goals": {"window": PRIVATE}}
    for own, pose in counted:
        used = camera | {"width": own.cameras[0].width, "height": own.cameras[0].height}
        assert of(rc.check(plan(room, camera=used, **goal), pose[None]), "window").high == 0


def test_a_page_counts_the_candidates_that_a_goal_permits(room, tmp_path):
    asked = plan(room, goals={"window": PRIVATE}, selection={"goal": "best_coverage", "cameras": 2})
    placed = rc.place(asked, out=tmp_path)
    n = len(placed.prepared.eligible)
    assert 0 < n < len(placed.prepared.pool.candidates)
    page = re.sub(r"<[^>]*>", "", (tmp_path / "page.html").read_text())
    assert f"All {n} candidates together cover" in page


def test_cameras_that_together_cover_too_much_are_replaced(room):
    goal = {"window": {"groups": ["window"], "at_most": 0.35}}
    rc.write_poses(room.parent / "rig.json", rc.look_at(
        [(1.2, 3.2, 1.5), (1.8, 3.2, 1.5), (3.5, 0.5, 2.5), (1.5, 3.2, 0.2)],
        [(0.7, 4, 1.5), (2.35, 4, 1.5), (2, 0.5, 0), (1.5, 2.0, 0.0)],
    ))  # fmt: skip
    file = {"generator": "poses", "file": str(room.parent / "rig.json")}
    asked = plan(
        room, goals=goal, candidates=[file], task={},
        selection={"goal": "best_coverage", "cameras": 3},
    )  # fmt: skip
    placed = rc.place(asked)
    shares = placed.prepared.permitted["window"]
    both = of(rc.check(asked, placed.prepared.pool.candidates.placed), "window")
    assert both.share > 0.35
    assert placed.is_met
    assert (shares <= 0.35).sum() >= 3


TILES = {"a": (-1, 0), "b": (1, 0), "e": (0, 1), "p": (0, 0)}
"""Lower corners of squares of 1 m, of which the last is private."""


def tiles(folder, feet, **selection):
    """A plan of four squares and of cameras that look down on squares of 1 m around their feet."""
    lines = []
    for x, y in TILES.values():
        lines += [f"v {x + i} {y + j} 0" for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
    for n, name in enumerate(TILES):
        lines += [f"g {name}", f"f {4 * n + 1} {4 * n + 2} {4 * n + 3} {4 * n + 4}"]
    (folder / "tiles.obj").write_text("\n".join(lines))
    poses = np.array([[[1, 0, 0, x], [0, -1, 0, y], [0, 0, -1, 1], [0, 0, 0, 1]] for x, y in feet])
    rc.write_poses(folder / "down.json", poses.astype(float))
    return {
        "meshes": [{"path": str(folder / "tiles.obj")}],
        "camera": {"width": 100, "height": 100, "fx": 100, "fy": 100},
        "candidates": [{"generator": "poses", "file": str(folder / "down.json")}],
        "selection": selection,
    }


def covered_of(feet, names):
    """Area that cameras of `tiles` cover of some of them, m^2."""
    seen = shapely.union_all([shapely.box(x - 0.5, y - 0.5, x + 0.5, y + 0.5) for x, y in feet])
    squares = [shapely.box(x, y, x + 1, y + 1) for x, y in (TILES[name] for name in names)]
    return seen.intersection(shapely.union_all(squares)).area


@examples(12, at_night=300)
@given(
    feet=st.lists(
        st.tuples(st.integers(-8, 16), st.integers(-2, 14)), min_size=3, max_size=5, unique=True
    ),
    limit=st.sampled_from([0.3, 0.45, 0.6, 0.8]),
    is_fewest=st.booleans(),
)
@example(feet=[(9, 4), (0, 4), (0, 8)], limit=0.6, is_fewest=False)
@example(feet=[(9, 4), (0, 4), (0, 8)], limit=0.6, is_fewest=True)
def test_bounds_hold_for_all_sets_that_goals_permit(tmp_path_factory, feet, limit, is_fewest):
    """Each candidate may be permitted where all together are not; against all subsets."""
    feet = [(x / 8, y / 8) for x, y in feet]
    of_sets = {
        some: covered_of(some, "abe") / 3
        for n in range(1, len(feet) + 1)
        for some in combinations(feet, n)
        if covered_of(some, "p") <= limit - 0.02
    }
    goal = {"goal": "best_coverage", "cameras": len(feet)}
    if is_fewest:
        wanted = round(0.75 * max(of_sets.values(), default=0.0), 2)
        assume(wanted > 0.05)
        goal = {"goal": "fewest_cameras", "coverage": wanted}
    folder = tmp_path_factory.mktemp("tiles")
    asked = tiles(folder, feet, **goal)
    asked["goals"] = {"private": {"groups": ["p"], "at_most": limit}}
    try:
        placed = rc.place(asked)
    except ConfigError:  # no candidate, or too few, are permitted alone
        return
    chosen = [feet[each] for each in placed.selection.chosen]
    assert covered_of(chosen, "p") <= limit + 1e-9 or not placed.is_met
    bound, is_proved = placed.selection.bound, placed.selection.status == "optimal"
    if is_fewest:
        enough = [len(some) for some, share in of_sets.items() if share >= wanted + 0.03]
        assert bound <= min(enough, default=len(feet))
        assert placed.is_met or not enough
    else:
        best = max(of_sets.values(), default=0.0)
        assert bound >= best - 0.03
        assert not (is_proved and placed.is_met) or placed.cameras.share >= best - 0.03


def test_no_optimum_is_proved_where_a_goal_fails_without_what_was_left_out(tmp_path):
    """Of what is left of the candidates, those that are left cover all."""
    feet = [(1.0, 0.5), (0.0, 0.5)]
    shares = [covered_of([each], "p") for each in feet]
    assert covered_of(feet, "p") > max(shares) + 0.2
    goal = {"goal": "fewest_cameras", "coverage": 0.95, "of_reachable": True}
    asked = tiles(tmp_path, feet, **goal) | {"task": {"resolution_of_result": 0.1}}
    asked["goals"] = {"private": {"groups": ["p"], "at_most": max(shares) + 0.1}}
    placed = rc.place(asked)
    assert not placed.is_met
    assert (placed.selection.status, placed.proved_on) == ("feasible", None)
    assert "not every set of candidates within at_most was tried" in " ".join(lines(placed))


@examples(8, at_night=200)
@given(
    feet=st.lists(
        st.tuples(st.integers(-8, 16), st.integers(-2, 14)), min_size=2, max_size=5, unique=True
    ),
    share=st.sampled_from([1.0, 0.99, 0.9]),
    size=st.sampled_from([1.0, 0.3]),
)
@example(feet=[(-2, 0), (1, 8), (6, 3)], share=1.0, size=1.0)
def test_a_goal_that_all_candidates_meet_is_met(tmp_path_factory, feet, share, size):
    """Patches, half of which count as the whole, may hide what a candidate adds."""
    feet = [(x / 8, y / 8) for x, y in feet]
    all_of = covered_of(feet, TILES)
    assume(all_of > 0.5)
    goal = {"goal": "fewest_cameras", "coverage": share, "of_reachable": True}
    asked = tiles(tmp_path_factory.mktemp("tiles"), feet, **goal)
    try:
        placed = rc.place(asked | {"task": {"resolution_of_result": size}})
    except ConfigError:  # no candidate covers half of a patch
        return
    (required,) = placed.requirements
    assert required.status != "fails"
    chosen = [feet[each] for each in placed.selection.chosen]
    assert covered_of(chosen, TILES) >= share * all_of - 1e-9


@pytest.mark.parametrize("by", ["area", "face"])
@pytest.mark.parametrize("task", [{"views": 6}, {"views": {"a": 4, "*": 3}}, {"min_angle_deg": 30}])
def test_nothing_is_said_to_hide_what_too_few_cameras_see(tmp_path, by, task):
    asked = tiles(tmp_path, [(0.0, 0.5), (0.01, 0.5)], goal="best_coverage", cameras=2)
    asked["camera"] |= {"fx": 40, "fy": 40}
    (note, *_) = rc.place(asked | {"task": task | {"by": by}}).prepared.notes
    assert "too few cameras" in note
    assert "occluded" not in note


@pytest.mark.parametrize(("limit", "n"), [(0.0, 2), (0.35, 3)], ids=["each", "together"])
def test_every_candidate_is_one_of_those_that_a_goal_permits(room, limit, n):
    """Two see none of the window, two less than 0.35 each and more together."""
    rc.write_poses(room.parent / f"all{n}.json", rc.look_at(
        [(1.2, 3.2, 1.5), (1.8, 3.2, 1.5), (3.5, 0.5, 2.5), (1.5, 2.0, 2.5)],
        [(0.7, 4, 1.5), (2.35, 4, 1.5), (3.5, 0.5, 0), (1.5, 2.1, 0.0)],
    ))  # fmt: skip
    file = {"generator": "poses", "file": str(room.parent / f"all{n}.json")}
    goal = {"window": {"groups": ["window"], "at_most": limit}}
    placed = rc.place(plan(room, goals=goal, candidates=[file], task={}, selection={"goal": "all"}))
    assert len(placed.chosen) == n
    assert placed.is_met


def test_cameras_that_are_there_stay_and_cost_nothing(room):
    path = room.parent / "there.json"
    there = rc.look_at([(3.9, 0.1, 2.9), (0.1, 0.1, 2.9)], [(1, 2, 1)] * 2)
    rc.write_poses(path, there)
    for selection in (
        {"goal": "fewest_cameras", "coverage": 0.95, "method": "integer", "refine": True},
        {"goal": "best_coverage", "cameras": 1, "refine": True},
    ):
        asked = plan(room, existing=str(path), selection=selection)
        placed = rc.place(asked)
        new = [each for each in placed.origin if not each.startswith("existing")]
        assert len(placed.origin) - len(new) == 2
        assert placed.selection.cost == len(placed.selection.chosen) - 2
        for row, name in enumerate(placed.origin):
            if name.startswith("existing"):
                own = there[int(name.split()[-1])]
                assert (placed.cameras.placed.world_from_camera[row] == own).all()
        # No single other candidate is better beside them.
        if selection["goal"] == "best_coverage":
            cells = placed.prepared.problem
            shares = [
                cells.share(cells.covered_by([0, 1, row])[1])
                for row in range(2, cells.n_candidates)
            ]
            assert placed.selection.share == pytest.approx(max(shares), abs=1e-12)


def test_new_cameras_beside_those_that_stay_cost_what_the_plan_says(room):
    path = room.parent / "one.json"
    rc.write_poses(path, rc.look_at((3.9, 0.1, 2.9), (1, 2, 1)))
    walls = plan(room)["candidates"][0] | {"cost": 2.5}
    selection = {"goal": "best_coverage", "cameras": 2}
    placed = rc.place(plan(room, existing=str(path), candidates=[walls], selection=selection))
    assert len(placed.origin) == 3
    assert placed.selection.cost == 5.0
    assert "goal: best coverage with at most 2 more cameras" in head_lines(placed)


@pytest.mark.parametrize("move", [[0], [0, 1]])
@pytest.mark.parametrize(
    "selection",
    [
        {"goal": "best_coverage", "cameras": 2},
        {"goal": "best_coverage", "cameras": 2, "refine": True},
        {"goal": "best_coverage", "budget": 0.5},
        {"goal": "fewest_cameras", "coverage": 1.0, "of_reachable": True, "method": "integer"},
    ],
)
def test_no_result_is_worse_than_to_leave_those_that_may_move(room, tmp_path, move, selection):
    """Two that see much, and candidates that see little; nothing stays but what is placed."""
    there = rc.look_at([(3.9, 0.1, 2.9), (2.0, 0.1, 1.5)], [(0.5, 3, 1), (2, 4, 1.5)])
    poor = rc.look_at([(3.0, 3.0, 0.3), (0.5, 0.5, 0.3)], [(3.5, 3.0, 0.0), (0.6, 0.5, 0.0)])
    for name, poses in (("there", there), ("poor", poor)):
        rc.write_poses(tmp_path / f"{name}.json", poses)
    asked = plan(
        room,
        existing={"file": str(tmp_path / "there.json"), "move": move},
        candidates=[{"generator": "poses", "file": str(tmp_path / "poor.json")}],
        selection=selection,
    )
    placed = rc.place(asked, out=tmp_path / "out")
    left = rc.check(asked, there, min_coverage=0.1).cameras.share
    assert placed.cameras.share >= left - 1e-9
    for row, name in enumerate(placed.origin):
        if name.startswith("existing"):
            own = there[int(name.split()[-1])]
            assert (placed.cameras.placed.world_from_camera[row] == own).all()
    assert {"existing 0", "existing 1"} <= {*placed.origin}


def test_one_that_moves_may_leave_its_place(room):
    path = room.parent / "some.json"
    there = rc.look_at([(3.9, 0.1, 2.9), (0.1, 0.1, 2.9), (3.9, 3.9, 2.9)], [(1, 2, 1)] * 3)
    rc.write_poses(path, there)
    existing = {"file": str(path), "move": [1]}
    asked = plan(room, existing=existing, selection={"goal": "best_coverage", "cameras": 1})
    placed = rc.place(asked)
    assert len(placed.origin) == 3
    assert {"existing 0", "existing 2"} < set(placed.origin)
    with pytest.raises(
        PlanError, match=r"existing\.move\[0\]: expected one of 3 cameras .*, got 7"
    ):
        rc.place(asked | {"existing": {"file": str(path), "move": [7]}})


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6))
def test_a_problem_with_goals_has_the_optimum_of_all_subsets(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 8))
    sizes = rng.integers(1, 80, 3)
    covers = [rng.random((n, size)) < 0.4 for size in sizes]
    weights = [rng.integers(1, 9, size).astype(float) for size in sizes]
    nothing = BestCoverage(cameras=0)
    own = [problem_of_matrix(c, nothing, weights=w) for c, w in zip(covers, weights, strict=True)]
    shares = [float(rng.choice([0.3, 0.6, 0.8])) for _ in own]

    def reached(rows):
        items = [
            c[list(rows)].any(axis=0) @ w / w.sum() for c, w in zip(covers, weights, strict=True)
        ]
        return all(a >= b - 1e-9 for a, b in zip(items, shares, strict=True))

    asked = {OF_TASK: shares[0], f"{OF_GOALS}/a": shares[1], f"{OF_GOALS}/b": shares[2]}
    problem = _stack_goals(own[0], [("a", own[1]), ("b", own[2])])
    if not reached(range(n)):
        with pytest.raises(ConfigError, match="reach"):
            replace(problem, goal=FewestCameras(0.0, asked))
        return
    selection = select_integer(replace(problem, goal=FewestCameras(0.0, asked)), time_limit=10)
    least = next(k for k in range(n + 1) if any(map(reached, combinations(range(n), k))))
    assert reached(selection.chosen)
    assert len(selection.chosen) == least == round(selection.bound)


@examples(6, at_night=60)
@given(
    st.integers(0, 10**6), st.sampled_from(["face", "face", "area"]),
    st.sampled_from(["greedy", "integer"]),
)  # fmt: skip
def test_goals_in_goals_have_the_bound_and_the_optimum_of_all_subsets(
    tmp_path_factory, seed, by, method
):
    """Squares in a row, of which each candidate sees some in sequence."""
    rng, folder = np.random.default_rng(seed), tmp_path_factory.mktemp("row")
    n, leaves = 20, ["a/b/c", "a/b/d", "a/e", "f", "door"]
    group = np.concatenate((np.arange(5), rng.integers(0, 5, n - 5)))
    lines = []
    for row in range(n):
        corners = ((0, 0), (1, 0), (1, 1), (0, 1))
        lines += [f"g {leaves[group[row]]}", *(f"v {2 * row + x} {y} 0" for x, y in corners)]
        lines.append(f"f {' '.join(str(4 * row + k) for k in range(1, 5))}")
    (folder / "row.obj").write_text("\n".join(lines))
    ends = np.sort(rng.integers(0, n, (int(rng.integers(3, 7)), 2)), axis=1)
    costs, candidates = rng.integers(1, 4, len(ends)) * rng.choice([1.0, 1.1]), []
    for row, (first, last) in enumerate(ends.tolist()):
        eye = (first + last + 0.5, 0.5, last - first + 0.6)
        rc.write_poses(folder / f"{row}.json", rc.look_at(eye, (eye[0], 0.5, 0), up=(0, 1, 0)))
        entry = {"generator": "poses", "file": str(folder / f"{row}.json")}
        candidates.append(entry | {"cost": costs[row]})
    sees = (np.arange(n) >= ends[:, :1]) & (np.arange(n) <= ends[:, 1:])
    is_of = {
        place: np.array([f"{leaves[k]}/".startswith(f"{place}/") for k in group])
        for place in (*leaves, "a", "a/b")
        if rng.random() < 0.7
    }
    is_of = {place: own for place, own in is_of.items() if sees[:, own].any()}
    is_of[None] = group < 4 if "door" in is_of else group < 5
    shares = {
        place: float(rng.choice([0.3, 0.6, 0.9, 1.0])) * sees[:, own].any(axis=0).mean()
        for place, own in is_of.items()
    }
    if not shares[None]:
        return

    def is_met(rows):
        seen = sees[list(rows)].any(axis=0)
        return all(seen[is_of[place]].mean() >= share - 1e-9 for place, share in shares.items())

    subsets = [rows for k in range(len(ends) + 1) for rows in combinations(range(len(ends)), k)]
    least = min(costs[list(rows)].sum() for rows in subsets if is_met(rows))
    door = shares.pop("door", 0.0)
    asked = {
        "meshes": [{"path": str(folder / "row.obj")}],
        "camera": {"width": 400, "height": 400, "hfov_deg": 90.0}, "task": {"by": by},
        "candidates": candidates,
        "goals": {"door": {"groups": ["door"], "coverage": door}} if door else {},
        "selection": {
            "goal": "fewest_cameras", "coverage": shares.pop(None), "groups": shares,
            "method": method,
        },
    }  # fmt: skip
    placed = rc.place(asked)
    assert placed.is_met
    selection = placed.selection
    assert selection.bound <= least + 1e-9
    assert selection.cost >= least - 1e-9
    if selection.status == "optimal" or method == "integer":
        assert selection.cost == pytest.approx(least)


@pytest.mark.parametrize(
    ("entries", "line"),
    [
        ({"goals": {"a": {"groups": ["west"]}}}, "goals.a: expected one of coverage, at_most"),
        ({"goals": {"a": DOORS | {"at_most": 0.0}}}, "got coverage and at_most; give exactly one"),
        ({"goals": {"a": DOORS | {"at_most": 1.0}}}, "goals.a.at_most: expected a number below 1"),
        ({"goals": {"a": PRIVATE | {"groups": ["wets"]}}}, "a.groups: expected a mesh file"),
        ({"goals": {"a": PRIVATE | {"groups": list(QUADS)}}}, "of one as selection.coverage"),
        ({"goals": {"a": DOORS}}, "goals.a.coverage: expected goal ="),
    ],
)  # fmt: skip
def test_wrong_goals_are_refused_in_one_line(room, entries, line):
    selection = {"goal": "best_coverage", "cameras": 1}
    with pytest.raises(PlanError) as caught:
        rc.place(plan_of(plan(room, selection=selection, **entries)))
    assert line in str(caught.value)
    assert "\n" not in str(caught.value)


def of_squares(n, tmp_path, task=None, **goal):
    """A plan of n + 1 squares side by side, and the n goals of all but the first."""
    lines = []
    for row in range(n + 1):
        lines += [
            f"v {row} 0 0",
            f"v {row + 1} 0 0",
            f"v {row + 1} 1 0",
            f"v {row} 1 0",
            f"g g{row}",
        ]
        lines += ["f -4 -3 -2", "f -4 -2 -1"]
    path = tmp_path / f"{n}.obj"
    path.write_text("\n".join(lines))
    goal = goal or {"coverage": 0.5}
    goals = {f"of {row}": {"groups": [f"g{row}"]} | goal for row in range(1, n + 1)}
    return name_scene(plan_of(plan(path, goals=goals, **({"task": task} if task else {}))))[:2]


def test_twice_as_many_goals_make_twice_as_many_groups(tmp_path, monkeypatch):
    """The scene of a goal differs from that of another in the groups of both alone."""
    made, check = [], rc.Group.__post_init__
    monkeypatch.setattr(rc.Group, "__post_init__", lambda group: made.append(check(group)))
    counts = []
    for n in (20, 40, 80):
        whole, asked = of_squares(n, tmp_path)
        made.clear()
        mesh, goals = separate_goals(asked, whole)
        counts.append(len(made))
        assert [group.role for group in mesh.groups] == ["task", *["occluder"] * n]
        assert whole.with_groups(["g1"]).groups[2] is whole.groups[2]
        for row, goal in enumerate(goals, start=1):
            assert [g.name for g in goal.mesh.groups if g.role == "task"] == [f"g{row}"]
    assert counts[2] - counts[1] <= 2.5 * (counts[1] - counts[0])


@pytest.mark.parametrize("n", [1, TOGETHER, 3 * TOGETHER])
def test_goals_share_the_cells_of_a_few(n, tmp_path):
    whole, asked = of_squares(n, tmp_path)
    mesh, goals = separate_goals(asked, whole)
    with open_objectives(asked, mesh, None, goals) as opened:
        counts = [len(each.of.cells.cells) for each in opened.goals]
    assert sum(counts) <= TOGETHER * USUAL_CELLS + n * (LEAST_CELLS + 2 * 2)
    assert min(counts) >= min(USUAL_CELLS, TOGETHER * USUAL_CELLS // n) / 4


@examples(3, at_night=30)
@given(seed=st.integers(0, 10**6))
def test_a_goal_is_explained_by_the_cameras_that_cover_it(room, seed):
    """Areas of single cameras are those of rigs of one, and losses those of rigs without one."""
    rng = np.random.default_rng(seed)
    eyes = rng.uniform((0.5, 0.5, 0.5), (3.8, 3.5, 2.5), (3, 3))
    poses = rc.look_at(eyes, rng.uniform((0, 2, 0.5), (2, 4, 2), (3, 3)))
    asked = plan(room, goals={"doors": DOORS | {"views": 1}, "window": PRIVATE})
    checked = rc.check(asked, poses, min_coverage=0.5)
    for told in explain_goals(checked.requirements, checked.goals):
        result = of(checked, told["goal"])
        table = {each["pose"]: each for each in told["cameras"]}
        for row in range(3):
            alone = of(rc.check(asked, poses[[row]], min_coverage=0.5), told["goal"])
            rest = of(
                rc.check(asked, np.delete(poses, row, axis=0), min_coverage=0.5), told["goal"]
            )
            own = table.get(row, {"m2": 0.0, "lost_m2": 0.0})
            assert own["m2"] == pytest.approx(alone.m2, abs=1e-9)
            assert own["lost_m2"] == pytest.approx(result.m2 - rest.m2, abs=1e-7)
        if told["goal"] == "window":
            assert not told["is_unseen"]  # by its density a camera may see it from far away
            assert bool(table) != ("no camera covers any of it (proved)" in told["lines"])
            continue
        is_short = result.status != "holds"
        assert any("dead zone " in line for line in told["lines"]) == is_short
        assert bool(told["dead_zones"]) >= is_short
        advice = [line for line in told["lines"] if line.startswith("advice: ")]
        assert not any("aim the camera at" in line or "move the camera" in line for line in advice)


@pytest.mark.parametrize("seed", range(4))
def test_a_mask_that_is_advised_hides_all_of_a_goal_and_loses_what_it_says(room, seed):
    """No pixel beside the mask shows the window; the loss is what the masked part alone covers."""
    rng = np.random.default_rng(seed)
    eye = rng.uniform((0.8, 0.5, 1.0), (3.0, 1.5, 2.0))
    poses = rc.look_at([eye], [rng.uniform((1.0, 4.0, 1.2), (2.5, 4.0, 1.8))])
    checked = rc.check(plan(room, goals={"window": PRIVATE}), poses, min_coverage=0.01)
    own = checked.goals["window"]
    _, (left, top, right, bottom), words, _ = own._turned(of(checked, "window"))
    camera = checked.plan.rig.cameras[0]
    with open_rasterizer(own.mesh, camera, "cpu") as rasterizer:
        face = rasterizer.render(poses[0]).face
    rows, columns = np.nonzero(own.mesh.task_mask[face] & (face >= 0))
    assert len(rows)
    assert left <= columns.min() <= columns.max() < right
    assert top <= rows.min() <= rows.max() < bottom
    assert f"columns {left} to {right}, rows {top} to {bottom}" in words
    part = replace(
        camera, width=right - left, height=bottom - top, cx=camera.cx - left, cy=camera.cy - top
    )
    alone = rc.regions(checked.mesh, part, poses, checked.task).area.sum()
    (whole,) = [each for each in checked.requirements if not each.goal]
    line = checked.best_change.line
    assert f"{percent(whole.share - alone / whole.of_m2)}, {percent(whole.limit)} req" in line
    assert f"lost by the mask: {points(alone / whole.of_m2)} of the whole task" in line


def test_advice_for_a_goal_covers_no_more_of_another_than_it_permits(room):
    """Doors beside the window: the camera that is named for them does not see it."""
    poses = rc.look_at([(2.0, 1.0, 1.5)], [(2.0, 0.5, 0.0)])
    most = []
    for own in ({}, {"window": PRIVATE | {"min_facing_density": 20}}):
        goals = {"north": {"groups": ["north"], "coverage": 0.9}} | own
        checked = rc.check(plan(room, goals=goals), poses, min_coverage=0.5)
        named = advised(checked.goals["north"], checked.plan)
        coarse = plan(room, goals={"window": PRIVATE | {"min_facing_density": 20}})
        most.append(max([of(rc.check(coarse, pose), "window").share for pose in named], default=0))
    assert most[1] == 0 < most[0]


def test_the_goal_that_lacks_most_has_its_zone_in_the_first_lines_and_on_the_page(room, tmp_path):
    poses = rc.look_at([(2.0, 1.0, 1.5)], [(1.5, 4.0, 1.5)])
    asked = plan(room, goals={"doors": DOORS, "window": PRIVATE})
    checked = rc.check(asked, poses, min_coverage=0.01)
    first, others = checked.first_lines(), checked.other_lines()
    assert first[1] == checked.best_change.line
    assert first[1].startswith("best change known: ")
    assert first[3].startswith("seen by camera 1 (")
    assert first[3] not in "\n".join(others)
    words = checked.goals["window"]._turned(of(checked, "window"))[2]
    assert words.startswith("mask camera 1, columns ")
    said = f"advice: {words}: none of it would be seen"
    assert ([said] == first[4:]) != (f"  {said}" in others)
    assert any(line.startswith("  dead zone ") and "west" in line for line in others)
    junit = {case.name: case.lines for case in cases(checked)}
    assert junit["coverage of goal window"][-2:] == [first[3], said]
    page = html_of(checked)
    assert page.index("<h2>Goals</h2>") < page.index("Seen by camera 1 (")
    assert "doors: lost without it" in page
    away = rc.check(asked, rc.look_at([(2.0, 3.0, 1.5)], [(2.0, 0.0, 1.0)]), min_coverage=0.01)
    assert "  no camera covers any of it (proved)" in away.other_lines()


def test_a_page_says_first_that_kept_cameras_fail_a_goal_whatever_is_chosen(room, tmp_path):
    path, said = tmp_path / "old.json", "than it permits, for any selection"
    selection = {"goal": "fewest_cameras", "coverage": 0.6}
    shown = {}
    for sees, aim in {"window": (2.0, 4.0, 1.5), "none": (0.0, 0.5, 1.0)}.items():
        rc.write_poses(path, rc.look_at([(2.0, 1.0, 1.5)], [aim]))
        asked = plan(room, existing=str(path), goals={"window": PRIVATE}, selection=selection)
        placed = rc.place(asked)
        shown[sees] = pages_of(placed, summary(placed), [], silent)["page.html"]
        assert placed.is_met == (sees == "none")
    for sees, page in shown.items():
        head = page[: page.index("The figures hold under these conditions")]
        assert (said in head) == (sees == "window")
        assert ("without those that kept cameras fail" in page) == (sees == "window")


def test_a_camera_that_is_kept_is_drawn_and_named_as_kept(room, tmp_path):
    path = tmp_path / "old.json"
    rc.write_poses(path, rc.look_at([(3.5, 0.5, 2.5)], [(1.0, 2.5, 0.5)]))
    selection = {"goal": "best_coverage", "cameras": 1}
    placed = rc.place(plan(room, existing=str(path), selection=selection))
    shown = network_of(placed, summary(placed))
    (row,) = [row for row, name in enumerate(shown.names) if name.endswith(" (kept)")]
    assert placed.origin[placed.cameras.owner[row]] == "existing 0"
    full = replace(shown, names=[name.replace("(kept)", "(here)") for name in shown.names])
    dashed, full = np.asarray(shown.overview()), np.asarray(full.overview())
    drawn = slice(60, -150)  # without title and legend
    assert np.any(dashed[drawn] != full[drawn])
    assert "kept: existing 0" in pages_of(placed, summary(placed), [], silent)["page.html"]
    rc.write_poses(tmp_path / "new.json", placed.cameras.placed.world_from_camera)
    written = json.loads(json_text(poses_of(placed)))
    (tmp_path / "placed.json").write_text(json.dumps(written))
    views = rc.read_views(tmp_path / "placed.json")
    kept = [each.startswith("existing") for each in written["origin"]]
    assert [name.endswith(" (kept)") for name in views.images] == kept
    assert not any("kept" in name for name in rc.read_views(tmp_path / "new.json").images)
    checked = rc.check(plan(room), tmp_path / "placed.json", min_coverage=0.5)
    assert checked.names == placed.names == tuple(views.images)
    assert f"{checked.names[row]}" in html_of(checked)


def gains_of(checked):
    """Gains by each change that was tried for a goal that is not met: zone, share and goal."""
    told = {
        each["goal"]: each["dead_zones"]
        for each in to_json(checked)["goals"]
        if "dead_zones" in each
    }
    told[""] = checked.summary()["dead_zones"]
    return [
        (zone["tried"], zone["tried"]["gain_m2"] / each.of_m2, each)
        for each in checked.requirements
        for zone in (told[each.goal] if each.lack and not each.is_most else ())
        if zone["tried"]
    ]


@pytest.mark.parametrize("seed", range(6))
def test_the_change_that_gains_most_comes_second_and_gains_what_it_says(room, seed):
    """Of any cameras: no change that was tried gains more; made, it gains at least about that."""
    rng = np.random.default_rng(seed)
    eyes = rng.uniform((0.5, 0.5, 0.5), (3.5, 3.5, 2.5), (rng.integers(1, 4), 3))
    poses = rc.look_at(eyes, rng.uniform(0, (4, 4, 2), eyes.shape))
    asked = plan(room, goals={"doors": DOORS, "window": PRIVATE} if seed % 2 else {"doors": DOORS})
    checked = rc.check(asked, poses, min_coverage=0.99)
    best, tried = checked.best_change, gains_of(checked)
    window = [each.share for each in checked.requirements if each.is_most and each.lack]
    assert checked.is_met == (best is None)
    assert checked.first_lines()[1:2] == [best.line]
    assert to_json(checked)["best_change"]["line"] == best.line
    assert best.line in html.unescape(html_of(checked)).replace("Change that", "change that")
    assert best.share >= max([share for _, share, _ in tried] + [0.0]) - 1e-12
    assert f"{100 * best.share:.1f} percentage points" in best.line
    for change, share, required in tried:
        if "focal_length_times" in change or share < best.share or max(window, default=0) >= share:
            continue
        added = rc.look_at([change["position"]], [change["looking_at"]])
        row = change["pose"]
        with_it = np.concatenate((poses if row is None else np.delete(poses, row, 0), added))
        after = rc.check(asked, with_it, min_coverage=0.99)
        (own,) = [
            e for e in after.requirements if (e.goal, e.group) == (required.goal, required.group)
        ]
        assert own.share - required.share >= 0.75 * share


def lost_in(line):
    """Percentage points by requirement after "lost" in a line."""
    _, _, words = line.partition("; lost")
    found = re.findall(r"([\d.]+) percentage points of (?:the )?([^,]+)", words)
    return {name: float(points) for points, name in found}


def drop(before, after):
    """Percentage points that requirements to cover lose, by name."""
    pairs = zip(before.requirements, after.requirements, strict=True)
    shares = {own.name: 100 * (own.share - rest.share) for own, rest in pairs if not own.is_most}
    return {name: share for name, share in shares.items() if share > 1e-6}


@pytest.mark.parametrize("seed", range(8))
def test_a_change_names_what_others_lose_by_it(room, seed):
    """Moved for one group, cameras lose of others what the line says, and gain what it says."""
    rng = np.random.default_rng(seed)
    eyes = rng.uniform((0.5, 0.5, 0.5), (3.5, 3.5, 2.5), (2, 3))
    poses = rc.look_at(eyes, rng.uniform(0, (4, 4, 2), eyes.shape))
    limits = {"west": 0.99, "floor": 0.99, "north": 0.99}
    checked = rc.check(plan(room), poses, min_coverage=0.99, groups=limits)
    best = checked.best_change
    for zone in checked.summary()["dead_zones"]:
        tried = zone["tried"]
        if tried is None or tried["pose"] is None or "focal_length_times" in tried:
            continue
        moved = poses.copy()
        moved[tried["pose"]] = rc.look_at([tried["position"]], [tried["looking_at"]])[0]
        after = rc.check(plan(room), moved, min_coverage=0.99, groups=limits)
        m2 = {each.group: each.m2 for each in checked.groups}
        changes = {each.group: each.m2 - m2[each.group] for each in after.groups}
        assert tried["group_gains_m2"] == pytest.approx(
            {name: change for name, change in changes.items() if abs(change) > 1e-7}, abs=1e-7
        )
        for name, change in changes.items():
            assert (f"{name} would lose" in zone["advice"]) == (change < -1e-7)
        if best.advised == tried["change"]:
            assert lost_in(best.line) == pytest.approx(drop(checked, after), rel=0.1, abs=0.06)
            gains = [
                a.share - b.share
                for a, b in zip(after.requirements, checked.requirements, strict=True)
            ]
            assert best.share == pytest.approx(max(gains), abs=1e-7)
            own = after.requirements[int(np.argmax(gains))]
            then = re.search(r"then ([\d.]+) % is covered: (.*?)(;|$)", best.line)
            assert float(then[1]) == pytest.approx(100 * own.share, abs=0.051)
            assert ("met" in then[2]) <= (own.status == "holds")
            assert ("missing" in then[2]) == (own.status != "holds")


@pytest.mark.parametrize("seed", range(4))
def test_cameras_that_are_turned_away_name_what_is_lost_without_them(room, seed):
    rng = np.random.default_rng(seed)
    eyes = rng.uniform((0.5, 0.5, 0.5), (3.5, 2.5, 2.5), (3, 3))
    poses = rc.look_at(eyes, [(1.5, 4.0, 1.5), (0.5, 4.0, 0.5), (2.0, 0.0, 0.5)])
    asked = plan(room, goals={"doors": DOORS | {"coverage": 0.01}, "window": PRIVATE})
    checked = rc.check(asked, poses, min_coverage=0.01, groups={"floor": 0.01})
    window = of(checked, "window")
    named = [int(n) - 1 for n in re.findall(r"camera (\d+)", checked.best_change.advised)]
    assert named == [row for row in named if seen_of_window(room, poses[[row]])] != []
    rest = np.delete(poses, named, axis=0)
    without = rc.check(asked, rest, min_coverage=0.01, groups={"floor": 0.01})
    line = checked.best_change.line
    assert lost_in(line) == pytest.approx(drop(checked, without), rel=0.1, abs=0.06)
    assert ("lost without them" in line) <= (len(named) > 1)
    assert checked.best_change.share == pytest.approx(window.share - of(without, "window").share)


@pytest.mark.parametrize("seed", range(6))
def test_no_place_of_a_camera_is_advised_for_another(room, seed):
    """A further camera at a place that is taken is a second one there, and is said to be."""
    rng = np.random.default_rng(seed)
    eyes = rng.uniform((0.5, 0.5, 0.5), (3.5, 3.5, 2.5), (1, 3))
    poses = rc.look_at(eyes, rng.uniform(0, (4, 4, 2), eyes.shape))
    first = rc.check(plan(room), poses, min_coverage=0.99)
    for tried in [each for each, _, _ in gains_of(first)]:
        there = rc.look_at([tried["position"]], [(2.0, 2.0, 3.0)])  # looks up, and sees nothing
        checked = rc.check(plan(room), np.concatenate((poses, there)), min_coverage=0.99)
        for change, _, _ in gains_of(checked):
            taken = np.concatenate((eyes, [tried["position"]]))
            is_taken = bool((np.abs(taken - change["position"]).max(axis=1) < 1e-9).any())
            words = "at the same place", "aim the camera at", "times the focal length"
            assert is_taken == any(each in change["change"] for each in words)


@examples(8, at_night=60)
@given(seed=st.integers(0, 10**6), by=st.sampled_from(["area", "face"]))
def test_a_goal_counts_each_of_its_groups_by_its_views(tmp_path_factory, seed, by):
    """As a plan does in which only the groups of the goal are evaluated; own views replace them."""
    rng = np.random.default_rng(seed)
    n, path = int(rng.integers(2, 5)), tmp_path_factory.mktemp("squares")
    of_squares(n, path)
    every = [f"g{row}" for row in range(n + 1)]
    views = {name: int(rng.integers(1, 4)) for name in every if rng.random() < 0.6}
    views = [views, {"*": 2}, {"g1*": 3}][rng.integers(3)]
    own = sorted({f"g{each}" for each in rng.integers(1, n + 1, 2)})
    rest = [name for name in every if name not in own]
    goals = {
        "own": {"groups": own, "coverage": 0.5},
        "rest": {"coverage": 0.5},
        "two": {"groups": own, "coverage": 0.5, "views": 2},
        "most": {"groups": own, "at_most": 0.5},
    }
    task = {"views": views, "by": by, "max_incidence_deg": 85.0}
    eyes = rng.uniform((0, 0, 1), (n + 1, 1, 3), (5, 3))
    poses = rc.look_at(eyes, eyes - (0, 0.01, 1))
    mesh = str(path / f"{n}.obj")
    checked = rc.check(plan(mesh, task=task, goals=goals), poses)
    for name, scored, number in (
        ("own", own, views),
        ("rest", rest, views),
        ("two", own, 2),
        ("most", own, 1),
    ):
        others = [each for each in every if each not in scored]
        meshes = [{"path": mesh, "role": "occluder", "groups": others}]
        kept = {key: each for key, each in task.items() if name != "most" or key == "by"}
        alone = plan(mesh, meshes=meshes, task=kept | {"views": number})
        (wanted,) = rc.check(alone, poses, min_coverage=0.5).requirements
        result = of(checked, name)
        found = result.low, result.share, result.high
        assert found == pytest.approx((wanted.low, wanted.share, wanted.high), abs=1e-9)


@pytest.mark.parametrize("by", ["area", "face"])
@pytest.mark.parametrize("views", [{"g2": 2}, {"g2*": 2}, {"*": 2}])
def test_cameras_are_chosen_by_the_views_of_the_groups_of_a_goal(tmp_path, views, by):
    of_squares(2, tmp_path)
    goals = {"door": {"groups": ["g2"], "coverage": 1.0}}
    eyes = [(x + 0.5, y, 1.0) for x in range(3) for y in (0.4, 0.5, 0.6)]
    rc.write_poses(tmp_path / "some.json", rc.look_at(eyes, np.array(eyes) - (0, 0.001, 1)))
    asked = plan(tmp_path / "2.obj", task={"views": views, "by": by}, goals=goals)
    asked["camera"] = {"width": 1000, "height": 1000, "hfov_deg": 90.0}
    asked["candidates"] = [{"generator": "poses", "file": str(tmp_path / "some.json")}]
    asked["selection"] = {"goal": "fewest_cameras", "coverage": 0.9}
    placed = rc.place(asked)
    over = placed.cameras.placed.world_from_camera[:, 0, 3] > 2
    assert over.sum() == 2
    assert of(placed, "door").status == "holds"


MIXED = (
    {"coverage": 0.5},
    {"coverage": 0.8, "max_incidence_deg": 40},
    {"coverage": 0.5, "views": 2},
    {"at_most": 0.4},
    {"at_most": 0.4, "max_incidence_deg": 40},
)
KINDS = {"area": {}, "count": {"weight_by": "count"}, "seeable": {"weight_by": "seeable"}}


def of_random_squares(rng, n, tmp_path, task):
    """A plan of n + 1 squares of one scene, any of them in a goal of its own or with others."""
    of_squares(n, tmp_path)
    goals = {}
    for row in range(n):
        some = rng.choice(np.arange(1, n + 1), rng.integers(1, 3), replace=False)
        goals[f"own {row}"] = {"groups": [f"g{each}" for each in some]} | MIXED[rng.integers(5)]
    asked = plan(tmp_path / f"{n}.obj", goals=goals)
    asked["task"] = asked.get("task", {}) | task
    scene, named, _ = name_scene(plan_of(asked))
    return named, separate_goals(named, scene)[1]


def over_squares(rng, n, n_poses):
    """Poses above n + 1 squares in a row that look down at some of them, from any side."""
    eyes = rng.uniform((0, -1, -2), (n + 1, 2, 2), (n_poses, 3))
    return Poses.of(rc.look_at(eyes, rng.uniform((0, 0, 0), (n + 1, 1, 0), (n_poses, 3))))


@examples(6, at_night=60)
@given(seed=st.integers(0, 10**6), kind=st.sampled_from([*KINDS]))
def test_goals_measured_together_have_the_figures_of_each_alone(tmp_path_factory, seed, kind):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 7))
    path = tmp_path_factory.mktemp("squares")
    _, goals = of_random_squares(rng, n, path, KINDS[kind])
    poses = over_squares(rng, n, 4)
    together = CheckedGoals(goals, poses, ["a", "b", "c", "d"])
    assert [*together] == [goal.name for goal in goals]
    for goal in goals:
        alone = _check_rig(goal.plan, goal.mesh, poses, {None: goal.limit}, ANY)
        assert together.requirements[goal.name] == goal.requirement_of(alone.requirements[0])
        assert together[goal.name].requirements == (together.requirements[goal.name],)


@examples(4, at_night=40)
@given(seed=st.integers(0, 10**6), kind=st.sampled_from(["area", "seeable"]))
def test_candidates_measured_together_have_the_bits_of_each_goal_alone(
    tmp_path_factory, seed, kind
):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 7))
    named, goals = of_random_squares(rng, n, tmp_path_factory.mktemp("squares"), KINDS[kind])
    placed = over_squares(rng, n, 6)
    with open_objectives(named, goals[0].mesh, None, goals) as opened:
        every = [each for each in opened.goals if not each.goal.is_most]
        found = problems_of(every, placed, quiet)
        for each in every:
            on = each.of.cells
            alone = build_matrix(each.of.faces.observer, placed, on.task, cells=on.cells)
            wanted = problem_of(alone, on.cells, BestCoverage(cameras=0), **counting(named.task))
            own = found[each.goal.name]
            assert [*map(bytes, own.bits.parts)] == [*map(bytes, wanted.bits.parts)]
            assert own.weights.tobytes() == wanted.weights.tobytes()


@pytest.mark.parametrize("goal", [{"coverage": 0.5}, {"at_most": 0.4}])
@pytest.mark.parametrize("unit", ["area", "count"])
def test_poses_are_measured_once_for_any_number_of_goals(tmp_path, monkeypatch, goal, unit):
    """Passes, and poses in them, of a check and of the choice among candidates do not grow."""
    measured, run = [], ExactPass._run
    monkeypatch.setattr(
        ExactPass,
        "_run",
        lambda own, poses, *more: measured.append(len(poses)) or run(own, poses, *more),
    )
    rng, counts = np.random.default_rng(1), []
    for n in (5, 10, 40):
        asked = of_squares(n, tmp_path, KINDS[unit], **goal)
        mesh, goals = separate_goals(*reversed(asked))
        placed = over_squares(rng, n, 3)
        measured.clear()
        CheckedGoals(goals, placed, ["a", "b", "c"])
        task, wanted = problem_of_matrix(np.ones((3, 2)), BestCoverage(0)), FewestCameras()
        with open_objectives(goals[0].plan, mesh, None, goals) as opened:
            with_goals(task, wanted, opened.goals, placed, (), quiet)
        counts.append((len(measured), sum(measured)))
    assert counts == [counts[0]] * 3
    assert counts[0][1] == 3 * 2  # of cameras, by face and by area at once, and of candidates


@examples(4, at_night=40)
@given(seed=st.integers(0, 10**6), kind=st.sampled_from([*KINDS]))
def test_shares_of_candidates_measured_together_are_those_of_each_goal_alone(
    tmp_path_factory, seed, kind
):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 7))
    _, goals = of_random_squares(rng, n, tmp_path_factory.mktemp("squares"), KINDS[kind])
    placed = over_squares(rng, n, 6)
    for alike in AlikeGoals.of([each for each in goals if each.is_most]):
        found = alike.most_shares(placed, lambda *_: None)
        for goal in alike.goals:
            alone = AlikeGoals([goal]).most_shares(placed, lambda *_: None)
            assert found[goal.name].tobytes() == alone[goal.name].tobytes()
            asked = AlikeGoals([goal]), {goal.name: goal.limit}, goal.plan.rig
            permits = [AlikeGoals.permits(*asked, placed[[row]]) for row in range(6)]
            if kind == "area":
                assert [*(found[goal.name] <= goal.limit + 1e-9)] == permits


DENSE = {"at_most": 0.5, "min_facing_density": 1e6}


@pytest.mark.parametrize("goal", [{"coverage": 0.5}, DENSE])
def test_of_many_goals_the_worst_alone_are_explained(tmp_path, monkeypatch, goal):
    """The lines of a check, and its record, examine as many goals as they list."""
    examined, check = [], _check_rig
    monkeypatch.setattr(
        "rastercov.placement.plan.check._check_rig",
        lambda *own, **more: examined.append(own[1]) or check(*own, **more),
    )
    n = MOST_GOALS + 10
    of_squares(n, tmp_path)
    goals = {f"of {row}": {"groups": [f"g{row}"]} | goal for row in range(1, n + 1)}
    asked = plan(tmp_path / f"{n}.obj", goals=goals, task={})
    checked = rc.check(asked, rc.look_at([(0.5 * n, 0.5, 2.0 * n)], (0.5 * n, 0.5, 0.0)))
    assert all(each.status == "holds" for each in checked.requirements)
    checked.first_lines()
    assert len(examined) == 1  # the task
    checked.lines()
    record(checked)
    assert len(cases(checked)) >= n  # also those without reasons
    assert len(examined) == 1 + MOST_GOALS
    one, other = examined[1:3]
    assert one.contacts is other.contacts  # of all scenes of goals
    with pytest.raises(KeyError):
        checked.goals["none"]


def test_goals_of_a_page_have_pictures_and_groups_that_must_not_be_seen_a_proof(room):
    """What is seen by none is said to be proved; what is seen is said to fail."""
    private = PRIVATE | {"groups": ["window", "north"]}
    goals = {"doors": DOORS | {"coverage": 0.01}, "private": private}
    ends = []
    for eye, target in (((3.0, 1.0, 1.5), (0.5, 4.0, 1.5)), ((2.0, 3.0, 1.5), (1.0, 0.0, 1.0))):
        checked = rc.check(plan(room, goals=goals), rc.look_at([eye], [target]), min_coverage=0.01)
        shown = network_of(checked, to_json(checked))
        assert all(goal.picture() for goal in shown.goals)
        own = {goal.name: goal for goal in shown.goals}["private"]
        lines, ranked = own.of_groups(), sorted(own.groups, key=lambda each: -each.high)
        for line, each in zip(lines, ranked, strict=True):
            assert line.startswith(f"{each.group}: ")
            ends.append(line.endswith(", proved: 0 % at most"))
            assert ends[-1] == (each.share == 0)
            assert line.endswith("seen, fails") == (each.share > 0)
    assert ends == [False, False, True, True]


def test_no_more_pictures_are_drawn_and_no_more_is_measured_for_more_goals(tmp_path, monkeypatch):
    """A page has pictures of the worst goals alone; advice is tried on all of a kind at once."""
    runs, run = [], ExactPass._run
    for n in (MOST_CLOSE_UPS + 2, 30):
        of_squares(n, tmp_path)
        goals = {f"of {row}": {"groups": [f"g{row}"], "at_most": 0.0} for row in range(1, n + 1)}
        rig = rc.look_at([(0.5 * n, 0.5, 2.0 * n)], (0.5 * n, 0.5, 0.0))
        checked = rc.check(plan(tmp_path / f"{n}.obj", goals=goals, task={}), rig)
        page = network_of(checked, to_json(checked))
        assert len(page.goals) == n
        assert [part.status for part in page.goals] == ["fails"] * n
        drawn = [name for name in page.draw() if name.startswith("goal_")]
        assert drawn == [f"goal_{part.name}" for part in page.goals[:MOST_CLOSE_UPS]]
        _, apart = separate_goals(checked.plan, checked.scene)
        permits = permits_of([(goal, 0.0) for goal in apart])
        with monkeypatch.context() as patch:
            patch.setattr(ExactPass, "_run", lambda *own: runs.append(1) or run(*own))
            assert not permits(checked.plan.rig, checked.cameras.placed)
            away = Poses.of(rc.look_at([(0.5 * n, 0.5, -1)], (0.5 * n, 0.5, -2)))
            assert permits(checked.plan.rig, away)
    assert len(runs) == 4
