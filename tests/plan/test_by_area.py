"""Plans whose result is by area: cameras are chosen on cells, networks judged by exact area."""

from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from surface_cases import room
from union_greedy import area_of, greedy_by_area, room_candidates

import rastercov as rc
from rastercov.camera.pose_file import write_poses
from rastercov.coverage.area.network import AreaNetwork
from rastercov.placement.plan import run as plan_run
from rastercov.placement.plan.check import check
from rastercov.placement.plan.file import PlanError, read_plan
from rastercov.placement.plan.network import FAILS, HOLDS, UNDECIDED, judge_areas
from rastercov.placement.plan.prepare import quiet
from rastercov.placement.plan.run import place
from rastercov.report import plan as report

PLAN = """
[[meshes]]
path = "room.obj"
[camera]
width = 1280
height = 960
fx = 700
fy = 700
focus_range = [0.3, 8.0]
[task]
max_incidence_deg = 75
min_pixels_per_m2 = 4000
resolution_of_result = 0.5
[[candidates]]
generator = "poses"
file = "candidates.json"
[selection]
goal = "best_coverage"
cameras = 4
[outputs]
page = false
"""
FEWEST = PLAN.replace('"best_coverage"\ncameras = 4', '"fewest_cameras"\ncoverage = 0.7')
TASK = rc.Task(max_incidence_deg=75, min_pixels_per_m2=4000)
MESH, CAMERA, RIG = room()
POSES = room_candidates(40)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A folder with the room as walls and boxes, and candidates under its ceiling."""
    monkeypatch.chdir(tmp_path)
    lines = ["v {!r} {!r} {!r}".format(*point) for point in MESH.vertices.tolist()]
    for row, face in enumerate((MESH.faces + 1).tolist()):
        lines += {0: ["g walls"], 12: ["g boxes"]}.get(row, [])
        lines.append("f {} {} {}".format(*face))
    Path("room.obj").write_text("\n".join(lines))
    write_poses("candidates.json", POSES)
    return tmp_path


def plan_of(text):
    Path("plan.toml").write_text(text)
    return read_plan("plan.toml")


def placed(text, step=quiet):
    return place(plan_of(text), Path("out"), step)


def exact_share(found):
    return area_of(MESH, CAMERA, found.cameras.poses, TASK)


# --- selection ------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_plan_by_area_chooses_about_as_well_as_greedy_on_exact_areas():
    found = placed(PLAN)
    _, best = greedy_by_area(MESH, CAMERA, POSES, TASK, 4)
    assert found.cameras.share == pytest.approx(exact_share(found), abs=1e-9)
    assert found.cameras.share >= best - 0.005
    assert found.cameras.curve[-1] == found.cameras.share
    assert (np.diff(found.cameras.curve) > 0).all()
    by_face = placed(PLAN.replace("resolution_of_result = 0.5", 'by = "face"'))
    assert exact_share(by_face) < found.cameras.share - 0.05
    told = report.summary(found)  # the shares of both are named
    n_cells = len(rc.cells(MESH, 0.5))
    matrix = {name: told["matrix"][name] for name in ("cells", "cell_m", "least_share")}
    assert matrix == {"cells": n_cells, "cell_m": 0.5, "least_share": 0.5}
    assert told["selection"]["share"] == found.selection.share != told["share"]
    assert told["share"] == pytest.approx(told["covered_area"]["percent"] / 100, abs=1e-12)
    text = "\n".join(report.lines(found))
    assert f"of the area on {n_cells:,} cells of 0.5 m (one counts where a camera" in text
    assert "\nexact area: " in text


@pytest.mark.slow
def test_a_plan_by_face_has_no_cells_and_names_what_it_leaves_out():
    by_face = PLAN.replace("resolution_of_result = 0.5", 'by = "face"')
    found = placed(by_face)
    told = report.summary(found)
    assert told["matrix"].keys() == {"poses", "pairs", "held_as"}
    assert "covered_area" not in told
    (line,) = [each for each in report.lines(found) if "point by point" in each]
    assert line.endswith('use by = "area" in [task]')
    share = float(line.split()[1]) / 100
    whole = exact_share(found)
    assert share == pytest.approx(whole - found.cameras.share, abs=0.03)
    assert "point by point" not in "\n".join(report.lines(placed(PLAN)))


@pytest.mark.slow
def test_a_matrix_is_used_again_and_one_of_other_cells_is_not():
    folders = []
    for size in (0.5, 0.5, 0.4):
        placed(PLAN.replace("= 0.5", f"= {size}"))
        (made,) = Path("out/matrix").iterdir()
        (shard,) = made.rglob("*.parquet")
        folders.append((made, shard.stat().st_mtime_ns))
    assert folders[0] == folders[1]
    assert folders[2][0] != folders[0][0]


# --- goals and requirements -----------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(("share", "size"), [(0.5, 0.5), (0.7, 0.5), (0.7, 2.0)])
def test_a_goal_that_can_be_reached_is_met_by_exact_area(share, size):
    found = placed(FEWEST.replace("= 0.5", f"= {size}").replace("0.7", f"{share}"))
    (required,) = found.requirements
    assert found.is_met
    assert required.low >= share - 1e-9
    assert required.share == pytest.approx(exact_share(found), abs=1e-9)
    is_raised = found.prepared.problem.goal.coverage > share
    assert is_raised <= ("stricter selection" in found.steps)
    assert is_raised == ("so that the exact area reaches it" in "\n".join(report.lines(found)))


def test_stricter_cells_promise_no_more_than_half_ones(monkeypatch):
    monkeypatch.setattr(plan_run, "RAISES", 0)
    half = placed(FEWEST.replace("= 0.5", "= 2.0").replace("0.7", "0.3")).prepared
    whole = half.stricter(0.999)
    assert whole.least_share == 0.999
    assert (whole.problem.reachable <= half.problem.reachable).all()
    reached = whole.problem.share(whole.problem.reachable)
    exact = area_of(MESH, CAMERA, POSES, TASK)
    assert reached <= exact


def test_a_goal_out_of_reach_gives_most_of_what_cells_reach():
    found = placed(FEWEST.replace("0.7", "1.0"))
    assert not found.is_met
    (required,) = found.requirements
    assert required.status == FAILS
    assert "cannot be reached" in found.prepared.notes[0]
    assert "m² uncovered" in required.words()


def test_nothing_that_can_be_covered_is_a_network_without_cameras():
    found = placed(PLAN.replace("4000", "1e12"))
    assert len(found.cameras.poses) == found.cameras.share == 0
    assert found.prepared.notes[0].startswith("no cell is covered")
    assert report.summary(found)["covered_area"]["m2"] == 0


OF_REACHABLE = FEWEST.replace("0.7", "0.9\nof_reachable = true")


@pytest.mark.slow
@pytest.mark.parametrize("views", ["1", "2", "{ boxes = 2 }"])
def test_a_share_of_what_is_reachable_is_of_the_exact_area_of_all_candidates(views):
    found = placed(
        OF_REACHABLE.replace("resolution_of_result", f"views = {views}\nresolution_of_result")
    )
    (required,) = found.requirements
    assert required.of_reachable
    covered = [
        rc.unite(rc.regions(MESH, CAMERA, poses, TASK), 2).area
        for poses in (found.cameras.poses, POSES)
    ]
    need = np.where(np.arange(MESH.n_faces) < 12, *{"1": (1, 1), "2": (2, 2)}.get(views, (1, 2)))
    own, most = (area[need - 1, np.arange(MESH.n_faces)].sum() for area in covered)
    assert required.share == pytest.approx(own / most, abs=1e-6)
    assert required.of_m2 == pytest.approx(most)
    assert required.low <= required.share <= required.high
    assert found.is_met
    assert "of the area that all candidates cover, 90.0 % wanted" in required.words()


@pytest.mark.slow
def test_a_share_of_what_is_reachable_is_judged_on_cells_where_the_area_is_not_known(monkeypatch):
    monkeypatch.setattr(plan_run, "MOST_PAIRS", 0)
    found = placed(OF_REACHABLE)
    (required,) = found.requirements
    assert required.of_reachable
    assert required.words().endswith("90.0 % wanted (on cells)")
    reached = found.prepared.problem.share(found.prepared.problem.reachable)
    assert 0.9 <= required.share == found.selection.share / reached


@pytest.mark.parametrize("views", [1, 2, {"boxes": 2}])
def test_a_required_area_holds_fails_or_is_not_decided(views):
    labels = (np.arange(MESH.n_faces) >= 12).astype(np.int32)
    mesh = rc.Mesh(MESH.vertices, MESH.faces, [rc.Group("walls"), rc.Group("boxes")], labels)
    areas = AreaNetwork(mesh, rc.Task(max_incidence_deg=75, min_pixels_per_m2=4000, views=2))
    regions = rc.regions(mesh, CAMERA, RIG, TASK)
    areas.add(regions)
    covered = rc.unite(regions, 2)
    for group in (None, "walls", "boxes"):
        (exact,) = judge_areas(areas, {group: 0.5}, views)
        level = [
            (views if isinstance(views, int) else views.get(n, 1)) - 1 for n in ("walls", "boxes")
        ]
        rows = [i for i, n in enumerate(("walls", "boxes")) if group in (None, n)]
        expected = sum(covered.area[level[i]][labels == i].sum() for i in rows)
        total = sum(mesh.areas[labels == i].sum() for i in rows)
        assert exact.share == pytest.approx(expected / total, abs=1e-12)
        assert exact.m2 == pytest.approx(expected)
        assert exact.low < exact.share < exact.high
        gap = exact.high - exact.share
        limits = {exact.low - 2 * gap: HOLDS, exact.share: UNDECIDED, exact.high + 2 * gap: FAILS}
        for limit, status in limits.items():
            (found,) = judge_areas(areas, {group: limit}, views)
            assert found.status == status
            assert ("not decided" in found.words()) == (status == UNDECIDED)


@pytest.mark.slow
def test_check_judges_by_exact_area_and_place_agrees():
    found = placed(FEWEST)
    write_poses("rig.json", found.cameras.poses)
    plan = plan_of(FEWEST)
    checked = check(plan, Path("rig.json"), {None: 0.7, "boxes": 1.0})
    assert checked.requirements[0].share == pytest.approx(found.requirements[0].share, abs=1e-12)
    assert [each.status for each in checked.requirements] == [HOLDS, FAILS]
    assert "not covered as a whole" in "\n".join(checked.lines())
    shares = {each.group: each.m2 for each in checked.groups}
    assert sum(shares.values()) == pytest.approx(checked.requirements[0].m2)


# --- later steps ----------------------------------------------------------------------------------

STEPS = """
refine = true
refine_budget = 600
[selection.optimise]
method = "random"
budget = 80
population = 4
[selection.tolerance]
position_mm = 20
angle_deg = 1
draws = 5
"""


@pytest.mark.slow
def test_later_steps_work_on_cells_and_never_lose_exact_area(monkeypatch):
    plain, short = plan_run.refine, {"halvings": 1}
    monkeypatch.setattr(plan_run, "refine", lambda *given, **more: plain(*given, **more, **short))
    alone = placed(PLAN)
    found = placed(PLAN.replace("cameras = 4", "cameras = 4" + STEPS))
    assert found.refined.share >= found.refined.start_share
    assert 4 < found.refined.evaluations <= 600
    assert found.cameras.share >= alone.cameras.share
    assert found.cameras.share == pytest.approx(exact_share(found), abs=1e-9)
    assert len(found.tolerance.face_chance) == len(rc.cells(MESH, 0.5))
    assert found.leftover.left.any()
    text = "\n".join(report.left_lines(found))
    assert text.startswith("Faces of which some part is not covered")


@pytest.mark.slow
def test_moves_that_lose_exact_area_are_not_taken(monkeypatch):
    def worse(objective, space, poses, **_):
        found = plain(objective, space, poses, budget=len(poses), seed=0)
        away = poses.world_from_camera.copy()
        away[:, :3, 3] = away[0, :3, 3]
        away[:, :3, :3] = away[0, :3, :3]
        object.__setattr__(found, "poses", away)
        return found

    plain = plan_run.refine
    monkeypatch.setattr(plan_run, "refine", worse)
    alone = placed(PLAN)
    found = placed(PLAN.replace("cameras = 4", "cameras = 4\nrefine = true"))
    assert found.kept_poses == ("refined",)
    np.testing.assert_array_equal(found.cameras.poses, alone.cameras.poses)
    assert "were not taken" in "\n".join(report.lines(found))
    assert report.summary(found)["improvement"]["refinement"]["taken"] is False


@pytest.mark.slow
def test_an_interrupt_while_the_area_is_measured_keeps_the_selection():
    @contextmanager
    def step(name):
        def progress(done, total):
            if name == "area":
                raise KeyboardInterrupt

        yield progress

    found = placed(PLAN, step)
    assert found.interrupted == "area"
    assert len(found.cameras.poses) == 4
    assert found.cameras.areas is None
    assert report.summary(found)["interrupted"] == "area"


# --- refusals -------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_size_that_is_named_fits():
    with pytest.raises(PlanError) as caught:
        placed(PLAN.replace("= 0.5", "= 1e-5"))
    size = float(str(caught.value).split("; ")[1].split(" m")[0])
    assert len(rc.cells(MESH, size)) <= 5_000_000


@pytest.mark.slow
def test_cells_larger_than_the_scene_are_whole_faces():
    found = placed(PLAN.replace("= 0.5", "= 1e6"))
    assert report.summary(found)["matrix"]["cells"] == MESH.n_faces
    assert "are whole faces" in found.prepared.notes[0]
    assert found.cameras.share == pytest.approx(exact_share(found), abs=1e-9)
