"""Plans whose result is by area: cameras are chosen on cells, networks judged by exact area."""

import logging
import re
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from itertools import combinations
from logging.handlers import BufferingHandler
from pathlib import Path

import numpy as np
import plans
import pytest
from plans import told
from surface_cases import room
from union_greedy import area_of, greedy_by_area, room_candidates

import rastercov as rc
from rastercov.core.area.network import AreaNetwork
from rastercov.core.camera.conventions import write_poses
from rastercov.placement.plan import fewer, shortfall
from rastercov.placement.plan import run as plan_run
from rastercov.placement.plan.file import plan_of
from rastercov.placement.plan.network import classify_areas
from rastercov.placement.required import FAILS, HOLDS, UNDECIDED
from rastercov.report import plan as report

SIZED = {"max_incidence_deg": 75, "min_pixels_per_m2": 4000}
CELLS = SIZED | {"resolution_of_result": 0.5}
FOUR = {"goal": "best_coverage", "cameras": 4}
FEWEST = {"goal": "fewest_cameras", "coverage": 0.7}
PLAN = {
    "meshes": [{"path": "room.obj"}],
    "camera": {"width": 1280, "height": 960, "fx": 700, "fy": 700, "focus_range": [0.3, 8.0]},
    "task": CELLS,
    "candidates": [{"generator": "poses", "file": "candidates.json"}],
    "selection": FOUR,
    "outputs": {"page": False},
}
TASK = rc.Task(**SIZED)
MESH, CAMERA, RIG = room()
POSES = room_candidates(40)
placed = partial(plans.placed, PLAN)


@pytest.fixture(autouse=True)
def candidates(folder):
    """Candidates under the ceiling of the room."""
    write_poses("candidates.json", POSES)


@pytest.fixture(scope="module")
def beyond(tmp_path_factory):
    """Placement for a goal that all candidates together miss, and the messages of its log."""
    log, kept = logging.getLogger("rastercov"), BufferingHandler(1000)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("beyond"))
        patch.setattr(log, "handlers", [*log.handlers, kept])
        plans.write_obj("room.obj", MESH)
        write_poses("candidates.json", POSES)
        placement = placed(selection=FEWEST | {"coverage": 1.0})
    return placement, [record.getMessage() for record in kept.buffer]


def exact_share(result):
    return area_of(MESH, CAMERA, result.cameras.poses, TASK)


def text_of(result):
    return "\n".join(report.lines(result))


# --- selection ------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_plan_by_area_chooses_about_as_well_as_greedy_on_exact_areas():
    placement, (_, best) = placed(), greedy_by_area(MESH, CAMERA, POSES, TASK, 4)
    share = placement.cameras.share
    assert share == placement.cameras.curve[-1] == pytest.approx(exact_share(placement), abs=1e-9)
    assert share >= best - 0.005
    assert (np.diff(placement.cameras.curve) > 0).all()
    matrix, n_cells = told()["matrix"], len(rc.cells(MESH, 0.5))
    assert [matrix[name] for name in ("cells", "cell_m", "least_share")] == [n_cells, 0.5, 0.5]
    assert told()["selection"]["share"] == placement.selection.share != told()["share"]
    assert share == pytest.approx(told()["covered_area"]["percent"] / 100, abs=1e-12)
    assert f"of the area on {n_cells:,} patches up to 0.5 m long (a patch counts if a" in text_of(
        placement
    )
    assert report.head_lines(placement)[0].startswith("covered: ")
    (worst,) = (line for line in report.head_lines(placement) if line.startswith("dead zone "))
    assert worst not in report.lines(placement)
    assert worst in report.lines(placement, named=())
    assert "point by point" not in text_of(placement)
    by_face = placed(task=SIZED | {"by": "face"})
    whole = exact_share(by_face)
    assert whole < share - 0.05
    assert told()["matrix"].keys() == {"poses", "pairs", "held_as"}
    assert "covered_area" not in told()


@pytest.mark.slow
def test_a_matrix_is_used_again_and_one_of_other_cells_is_not():
    folders = []
    for size in (0.5, 0.5, 0.4):
        placed(task=SIZED | {"resolution_of_result": size})
        (shard,) = Path("out/matrix").rglob("pairs-*.npz")
        folders.append((shard, shard.stat().st_mtime_ns))
    assert folders[0] == folders[1]
    assert folders[2][0] != folders[0][0]


# --- goals and requirements -----------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(("share", "size"), [(0.5, 0.5), (0.7, 0.5), (0.7, 2.0)])
def test_a_goal_that_can_be_reached_is_met_by_exact_area(share, size):
    goal = FEWEST | {"coverage": share}
    placement = placed(selection=goal, task=SIZED | {"resolution_of_result": size})
    (required,) = placement.requirements
    assert placement.is_met
    assert required.low >= share - 1e-9
    assert required.share == pytest.approx(exact_share(placement), abs=1e-9)
    is_raised = placement.prepared.problem.goal.coverage > share
    assert is_raised <= ("stricter selection" in placement.steps)
    assert is_raised == ("so that the exact area reaches" in text_of(placement))


@pytest.mark.parametrize("method", ["greedy", "integer"])
@pytest.mark.parametrize(
    "goal", [{"coverage": 0.6}, {"coverage": 0.1, "groups": {"strip": 0.6}}], ids=["all", "group"]
)
def test_the_bound_of_a_goal_that_was_raised_is_of_the_goal_of_the_plan(goal, method):
    """The first of two cameras covers 55 % of the area, and more than 60 % on patches."""
    corners = ((0, 0), (10, 0), (10, 1), (0, 1))
    lines = ["g strip", *(f"v {x} {y} 0" for x, y in corners), "f 1 2 3 4"]
    Path("strip.obj").write_text("\n".join(lines))
    candidates = []
    for row, (x, height, cost) in enumerate([(2.0, 3.5, 1.0), (8.0, 3.0, 1.5)]):
        write_poses(f"{row}.json", rc.look_at((x, 0.5, height), (x, 0.5, 0), up=(0, 1, 0)))
        candidates.append({"generator": "poses", "file": f"{row}.json", "cost": cost})
    placement = placed(
        meshes=[{"path": "strip.obj"}],
        camera={"width": 400, "height": 400, "hfov_deg": 90.0},
        task={"resolution_of_result": 10.0},
        candidates=candidates,
        selection={"goal": "fewest_cameras", "method": method} | goal,
    )
    problem, selection = placement.prepared.problem, placement.selection
    assert placement.is_met
    assert selection.cost == 2.5
    assert max(problem.wanted.values()) > problem.share(problem.covered_by([0])[1]) >= 0.6
    assert selection.bound <= 1.0 + 1e-9
    assert selection.status == "feasible"


@pytest.mark.parametrize(("margin", "count"), [(-1e-4, 2), (1e-4, 3)])
@pytest.mark.parametrize("method", ["greedy", "integer"])
def test_the_fewest_candidates_are_those_of_all_sets_by_exact_area(margin, count, method):
    """On patches of 2 m no two of them reach what the best two cover of the area."""
    write_poses("candidates.json", POSES[:9])
    own = [rc.regions(MESH, CAMERA, POSES[row : row + 1], TASK) for row in range(9)]
    best = max(rc.unite([own[a], own[b]]).share() for a, b in combinations(range(9), 2))
    goal = FEWEST | {"coverage": best + margin, "method": method}
    placement = placed(selection=goal, task=SIZED | {"resolution_of_result": 2.0})
    assert placement.is_met
    assert len(placement.chosen) == count
    chosen = told()["selection"]
    assert (chosen["proved_on"], chosen["status"]) == ("exact area", "optimal")
    assert chosen["bound"] == count
    assert "no smaller set of candidates reaches the goal (proved for exact area)" in text_of(
        placement
    )


def test_candidates_that_reach_a_goal_are_among_the_sets_that_may(monkeypatch):
    write_poses("candidates.json", POSES[:8])
    goal = FEWEST | {"coverage": 0.2}
    prepared = placed(selection=goal, task=CELLS | {"views": 2}).prepared
    counts = []
    for rows in combinations(range(8), 3):
        own = rc.unite(rc.regions(MESH, CAMERA, POSES[list(rows)], TASK), views=2).share(2)
        wanted = prepared.selection.model_copy(update={"coverage": own})
        sets = fewer.sets_in_reach(replace(prepared, selection=wanted), 3)
        assert rows in sets
        counts.append(len(sets))
    assert min(counts) < 56
    wanted = prepared.selection.model_copy(update={"coverage": 1.0})
    assert fewer.sets_in_reach(replace(prepared, selection=wanted), 3) == []
    monkeypatch.setattr(fewer, "MOST_WORK", 1)
    assert fewer.sets_in_reach(prepared, 3) is None


def test_the_poses_of_a_placement_have_their_camera():
    placement = placed()
    views = rc.read_views("out/poses.json")
    assert views.camera() == CAMERA
    evaluation = rc.evaluate(MESH, views.rig, views.poses, TASK)
    m2 = told()["covered_area"]["m2"]
    assert evaluation.areas.summary()["m2"] == pytest.approx(m2, rel=1e-9)
    checked = rc.check(PLAN, "out/poses.json", min_coverage=0.1)
    assert checked.whole.share == pytest.approx(placement.cameras.share, abs=1e-9)


def test_a_best_coverage_is_proved_on_patches_alone():
    placed(selection=FOUR | {"method": "integer", "cameras": 2})
    assert told()["selection"]["status"] == "optimal"
    assert told()["selection"]["proved_on"] == "patches"
    placed(task=SIZED | {"by": "face"}, selection=FOUR | {"method": "integer", "cameras": 1})
    assert told()["selection"]["proved_on"] == "faces"


def test_what_is_out_of_reach_gives_most_of_what_cells_reach(beyond):
    result, _ = beyond
    (required,) = result.requirements
    assert required.status == FAILS
    assert "candidates together reach" in result.prepared.notes[0]
    assert "m² uncovered" in required.words()
    nothing = placed(task=CELLS | {"min_pixels_per_m2": 1e12})
    assert len(nothing.cameras.poses) == nothing.cameras.share == 0
    assert nothing.prepared.notes[0].startswith("no patch can be covered")
    assert told()["covered_area"]["m2"] == 0


def test_a_goal_out_of_reach_is_said_at_once_and_searched_for_once(beyond):
    """All candidates together leave the side that none looks at, and what is too coarse."""
    result, said = beyond
    start = "whole task out of reach: all candidates"
    (bound,) = [line for line in result.prepared.notes if line.startswith(start)]
    assert bound in said
    assert "stricter selection" not in result.steps
    assert result.prepared.is_beyond
    high = float(re.search(r"cover at most ([\d.]+) %", bound)[1])
    assert result.cameras.areas.summary()["percent"] <= high + 0.1 < 100
    missing = re.search(r"missing: (.*)", bound)[1]
    parts = [float(each) for each in re.findall(r"([\d.]+) % [a-z]", missing)]
    assert sum(parts) == pytest.approx(100 - high, abs=0.2)


def reached_by(line, task):
    """Share that all candidates cover after the change of a line, by the exact area."""
    camera = CAMERA
    if times := re.search(r"with ([\d.]+) times the (pixels|focal)", line):
        names = {"pixels": ("width", "height", "fx", "fy", "cx", "cy"), "focal": ("fx", "fy")}
        own = {name: float(times[1]) * getattr(camera, name) for name in names[times[2]]}
        size = {name: round(own[name]) for name in own.keys() & {"width", "height"}}
        camera = replace(camera, **own | size)
    else:
        angle = re.search(r"with max_incidence_deg = ([\d.]+) instead", line)[1]
        task = task | {"max_incidence_deg": float(angle)}
    return area_of(MESH, camera, POSES, rc.Task(**task))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("task", "limit", "kinds"),
    [({}, 0.77, "max_incidence"), ({"min_pixels_per_m2": 16_000}, 0.75, "pixels")],
)
def test_what_is_said_to_bring_a_goal_into_reach_does(task, limit, kinds):
    placement = placed(selection=FEWEST | {"coverage": limit}, task=CELLS | task)
    lines = [
        line for line in placement.prepared.notes if line.startswith("goal within reach with ")
    ]
    assert any(kinds in line for line in lines)
    assert any("candidates also at" in line for line in lines)
    for line in lines:
        views = re.findall(r"\(([^)]*)\) m, aimed at \(([^)]*)\) m", line)
        assert bool(views) == ("candidates also at" in line)
        if views:
            ends = np.array([[end.split(", ") for end in view] for view in views], float)
            more = np.concatenate((POSES, rc.look_at(ends[:, 0], ends[:, 1])))
            covered = area_of(MESH, CAMERA, more, rc.Task(**SIZED | task))
            assert covered >= limit - 0.01  # places are rounded
        else:
            share = reached_by(line, SIZED | task)
            assert share >= limit
            assert f": whole task {100 * share:.1f} %" in line


def test_what_nothing_that_is_tried_reaches_is_said(beyond):
    notes = beyond[0].prepared.notes
    (line,) = [each for each in notes if each.startswith("tried without reaching the goal: ")]
    assert re.search(
        r"changes of camera and thresholds, further positions; nearest: .* short$", line
    )


@pytest.mark.parametrize("selection", [FOUR, FEWEST | {"coverage": 0.4}])
def test_cameras_that_differ_by_an_angle_are_chosen_and_judged_by_area(selection):
    task = CELLS | {"by": "area", "min_angle_deg": 40}
    placement = placed(selection=selection, task=task)
    angled = rc.Task(**SIZED, min_angle_deg=40)
    exact = rc.evaluate(MESH, CAMERA, placement.cameras.poses, angled, by="area", fields=())
    percent = exact.areas.summary()["percent"]
    assert told()["covered_area"]["percent"] == pytest.approx(percent, abs=1e-6)
    assert percent > 25
    assert placement.is_met


OF_REACHABLE = FEWEST | {"coverage": 0.9, "of_reachable": True}


@pytest.mark.slow
@pytest.mark.parametrize("views", [1, 2, {"boxes": 2}])
def test_a_share_of_what_is_reachable_is_of_the_exact_area_of_all_candidates(views):
    placement = placed(selection=OF_REACHABLE, task=CELLS | {"views": views})
    (required,) = placement.requirements
    covered = [
        rc.unite(rc.regions(MESH, CAMERA, poses, TASK), 2).area
        for poses in (placement.cameras.poses, POSES)
    ]
    of_walls, of_boxes = (views, views) if isinstance(views, int) else (1, 2)
    need = np.where(np.arange(MESH.n_faces) < 12, of_walls, of_boxes)
    own, most = (area[need - 1, np.arange(MESH.n_faces)].sum() for area in covered)
    assert required.share == pytest.approx(own / most, abs=1e-6)
    assert required.of_m2 == pytest.approx(most)
    assert required.low <= required.share <= required.high
    assert placement.is_met
    assert "of the area that candidates can cover, 90.0 % required" in required.words()


@pytest.mark.slow
def test_a_share_of_what_is_reachable_is_judged_on_cells_where_the_area_is_not_known(monkeypatch):
    monkeypatch.setattr(shortfall, "MOST_PAIRS", 0)
    placement = placed(selection=OF_REACHABLE)
    (required,) = placement.requirements
    assert required.of_reachable
    assert required.words().endswith("90.0 % required (on patches)")
    reached = placement.prepared.problem.share(placement.prepared.problem.reachable)
    assert 0.9 <= required.share == pytest.approx(placement.selection.share / reached, abs=1e-12)


@pytest.mark.parametrize("views", [1, 2, {"boxes": 2}])
def test_a_required_area_holds_fails_or_is_not_decided(views):
    is_box = np.arange(MESH.n_faces) >= 12
    groups = [rc.Group("walls"), rc.Group("boxes")]
    mesh = rc.Mesh(MESH.vertices, MESH.faces, groups, is_box.astype(np.int32))
    areas = AreaNetwork(mesh, rc.Task(**SIZED, views=2))
    regions = rc.regions(mesh, CAMERA, RIG, TASK)
    areas.add(regions)
    of_walls, of_boxes = (views, views) if isinstance(views, int) else (1, 2)
    covered = np.where(is_box, *rc.unite(regions, 2).area[[of_boxes - 1, of_walls - 1]])
    for group, rows in {None: is_box | ~is_box, "walls": ~is_box, "boxes": is_box}.items():
        (exact,) = classify_areas(areas, {group: 0.5}, views)
        assert exact.m2 == pytest.approx(covered[rows].sum())
        assert exact.share == pytest.approx(covered[rows].sum() / mesh.areas[rows].sum(), abs=1e-12)
        assert exact.low < exact.share < exact.high
        gap = exact.high - exact.share
        limits = {exact.low - 2 * gap: HOLDS, exact.share: UNDECIDED, exact.high + 2 * gap: FAILS}
        for limit, status in limits.items():
            (result,) = classify_areas(areas, {group: limit}, views)
            assert result.status == status
            assert ("undecided" in result.words()) == (status == UNDECIDED)


@pytest.mark.slow
def test_check_judges_by_exact_area_and_place_agrees():
    placement = placed(selection=FEWEST)
    checked = rc.check(PLAN, placement.cameras.poses, min_coverage=0.7, groups={"boxes": 1.0})
    whole, _ = checked.requirements
    assert whole.share == pytest.approx(placement.requirements[0].share, abs=1e-12)
    assert [each.status for each in checked.requirements] == [HOLDS, FAILS]
    (line,) = [each for each in checked.lines() if each.startswith("  group boxes: ")]
    assert re.search(r"m² (occluded|too few|too oblique|back-facing|not fully)", line)
    assert " face" not in "\n".join(checked.lines())
    assert sum(each.m2 for each in checked.groups) == pytest.approx(whole.m2)


# --- later steps ----------------------------------------------------------------------------------

STEPS = {
    "refine": True,
    "refine_budget": 600,
    "optimise": {"budget": 80},
    "tolerance": {"position_mm": 20, "angle_deg": 1, "draws": 5},
}


@pytest.mark.slow
def test_later_steps_work_on_cells_and_never_lose_exact_area(monkeypatch):
    alone, plain = placed(), plan_run.refine
    monkeypatch.setattr(plan_run, "refine", partial(plain, halvings=1))
    placement = placed(selection=FOUR | STEPS)
    assert placement.refined.share >= placement.refined.start_share
    assert 4 < placement.refined.evaluations <= 600
    assert placement.cameras.share == pytest.approx(exact_share(placement), abs=1e-9)
    assert placement.cameras.share >= alone.cameras.share
    assert len(placement.product("tolerance").drawn.face_chance) == len(rc.cells(MESH, 0.5))
    assert placement.leftover.left.any()
    (line,) = report.lines_of_uncovered(placement)
    words = " of the uncovered area is visible to none of the candidates (proved)"
    assert re.fullmatch(rf"[\d.]+ m²{re.escape(words)}", line)

    def worse(objective, space, poses, **_):
        """Moves of all cameras to the first one, said to be a gain."""
        result = plain(objective, space, poses, budget=len(poses), seed=0)
        away = np.repeat(poses.world_from_camera[:1], len(poses), axis=0)
        object.__setattr__(result, "poses", away)
        return result

    monkeypatch.setattr(plan_run, "refine", worse)
    kept = placed(selection=FOUR | {"refine": True})
    assert kept.kept_poses == ("refined",)
    np.testing.assert_array_equal(kept.cameras.poses, alone.cameras.poses)
    assert "were discarded" in text_of(kept)
    assert told()["improvement"]["refinement"]["taken"] is False


@pytest.mark.slow
def test_an_interrupt_while_the_area_is_measured_keeps_the_selection():
    @contextmanager
    def step(name):
        def progress(done, total):
            if name == "area":
                raise KeyboardInterrupt

        yield progress

    into = report.run_into(plan_of(PLAN), Path("out"), step)
    assert into.interrupted == told()["interrupted"] == "area"
    assert len(into.cameras.poses) == 4
    assert into.cameras.areas is None


@pytest.mark.slow
def test_cells_larger_than_the_scene_are_whole_faces():
    placement = placed(task=SIZED | {"resolution_of_result": 1e6})
    assert told()["matrix"]["cells"] == MESH.n_faces
    assert "are whole faces" in placement.prepared.notes[0]
    assert placement.cameras.share == pytest.approx(exact_share(placement), abs=1e-9)


def test_place_and_check_give_the_same_advice_where_no_candidate_serves(tmp_path):
    """Place tried the positions of candidates alone: none of 4 was said to cover half."""
    around = {"generator": "on_sphere", "count": 6, "distances": [0.5]}
    selection = {"goal": "fewest_cameras", "coverage": 0.95}
    plan = {
        "meshes": [{"built_in": "box", "transform": {"scale": 0.1}}],
        "camera": {"width": 640, "height": 480, "fx": 700, "fy": 700},
        "task": {"max_incidence_deg": 55.0},
        "candidates": [around],
        "selection": selection | {"of_reachable": True},
        "outputs": {"page": False},
    }
    placed = rc.place(plan, out=tmp_path)
    change = rc.check(plan, tmp_path / "poses.json").best_change
    (zone,) = placed.cameras.areas.dead_zones(placed.prepared.plan.rig, placed.cameras.placed)[
        "dead_zones"
    ]
    assert zone["advice"].count(change.advised) == 1
    assert "move the camera" in change.advised


def test_a_check_has_the_share_of_the_area_as_place_has():
    placement = placed()
    checked = rc.check(plan_of(PLAN, Path("plan.toml")), placement.cameras.placed, min_coverage=0.1)
    assert checked.cameras.share == placement.cameras.share
    assert checked.cameras.share != checked.cameras.network.summary()["covered"]["percent"] / 100


@pytest.mark.parametrize("coverage", [0.3, 0.43, 0.5])
def test_a_goal_is_met_by_candidates_that_cover_no_patch(coverage):
    """Through a grating that hides more than half of each."""
    square = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], float)
    faces = np.array([(0, 1, 2), (0, 2, 3)])
    bars = [
        rc.Mesh(square * (0.012, 4.8, 1) + (x, -2.4, 0.005), faces)
        for x in np.arange(-2.4, 2.4, 0.02)
    ]
    plans.write_obj("floor.obj", rc.Mesh(square * 4 - (2, 2, 0), faces))
    plans.write_obj("bars.obj", rc.Mesh.joined(bars))
    write_poses("above.json", rc.look_at([(0, 0, 6), (1, 0, 6)], [(0, 0, 0), (1, 0, 0)], (0, 1, 0)))
    placement = placed(
        meshes=[{"path": "floor.obj"}, {"path": "bars.obj", "role": "occluder"}],
        camera={"width": 2000, "height": 2000, "hfov_deg": 60},
        task={},
        candidates=[{"generator": "poses", "file": "above.json"}],
        selection={"goal": "fewest_cameras", "coverage": coverage},
    )
    assert not placement.prepared.problem.reachable.any()
    assert placement.is_met == (coverage < 0.45)
    assert len(placement.chosen) == {0.3: 1, 0.43: 2, 0.5: 0}[coverage]


@pytest.mark.parametrize("degrees", [0.0, 90.0, 180.0])
def test_advice_for_a_camera_that_is_rolled_says_that_its_image_is_upright(degrees):
    """It promised a goal that the camera missed as it was mounted."""
    box = rc.shapes.box((8.0, 6.0, 3.0), centre=(4, 3, 1.5))
    plans.write_obj("inside.obj", rc.Mesh(box.vertices, box.faces[:, ::-1]))
    table = {
        "meshes": [{"path": "inside.obj"}],
        "camera": {"width": 1920, "height": 1080, "hfov_deg": 80},
        "task": {"min_facing_density": "observe"},
    }
    turn, angle = np.eye(4), np.radians(degrees)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    poses = rc.look_at([(0.2, 0.2, 2.7)], [(2.0, 5.9, 1.0)]) @ turn
    checked = rc.check(plan_of(table, Path("plan.toml")), poses, min_coverage=0.6)
    zones = [each["tried"] for each in checked.summary()["dead_zones"] if each["tried"]]
    for tried in zones:
        is_moved = tried["pose"] is not None
        assert ("with its image upright" in tried["change"]) == (is_moved and degrees > 0)
        if is_moved:
            after = rc.look_at([tried["position"]], [tried["looking_at"]])
            share = rc.check(
                plan_of(table, Path("plan.toml")), after, min_coverage=0.6
            ).cameras.share
            more = sum(tried["group_gains_m2"].values()) / checked.mesh.areas.sum()
            assert share - checked.cameras.share == pytest.approx(more, abs=1e-9)
    assert zones


def test_where_gains_are_not_known_the_best_change_is_left_to_the_advice():
    """It was said that none is known, above advice on a camera that adds a view."""
    checked = rc.check(plan_of(PLAN, Path("plan.toml")), POSES[:3], min_coverage=0.9, views=2)
    _, change, _, _, advice, *_ = checked.first_lines()
    assert change == "best change known: see the advice, whose gain is not known"
    assert "would gain a view, 2 required" in advice
