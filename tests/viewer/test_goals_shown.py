"""Goals of a plan in the viewer: their states are those of `rastercov.check`."""

import re

import numpy as np
import pytest
from browser import Program, Tab
from commands import done
from edited import Session, Work
from goals_to_view import PLAN, plan_in, session_in
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples
from rigs_to_view import acted
from test_live import act, downloaded

import rastercov as rc
from rastercov.page.saving import export_page
from rastercov.page.scene import open_plan
from rastercov.placement.plan.file import read_plan
from rastercov.report import live
from rastercov.report.modes import OCCLUDER_OF_REASONS


@pytest.fixture
def session(tmp_path):
    made, _ = session_in(tmp_path)
    yield made
    made.close()


@examples(4, at_night=150)
@given(seed=st.integers(0, 10**6), by_face=st.booleans())
def test_states_are_those_of_check(tmp_path_factory, seed, by_face):
    rng, folder = np.random.default_rng(seed), tmp_path_factory.mktemp("plan")
    eyes = rng.uniform((0.2, 0.2, 0.5), (3.8, 3.5, 2.5), (rng.integers(1, 4), 3))
    text = PLAN.replace("[task]", '[task]\nby = "face"') if by_face else PLAN
    session, plan = session_in(folder, eyes, text)
    said = acted(session)[0]["summary"]["required"]
    checked = rc.check(plan, session.state.poses().world_from_camera)
    assert [each["words"] for each in said] == [each.words() for each in checked.requirements]
    assert [each["status"] for each in said] == [each.status for each in checked.requirements]
    assert [each["goal"] for each in said] == ["", "doors", "window"]
    session.close()


DIM = """
[lamps.k]
kind = "spot"
intensity_cd = 5
half_angle_deg = 3
position = [0.1, 0.1, 2.9]
[[candidates]]"""
HEAD = """
[cameras.c]
width = 1920
height = 1080
hfov_deg = 90.0
[rigs.head]
rule = "all"
[[rigs.head.cameras]]
camera = "c"
name = "a"
[[rigs.head.cameras]]
camera = "c"
name = "b"
translation = [900.0, 0, 0]
[task]"""
LESS = {
    "blurred": ("hfov_deg = 90.0", "hfov_deg = 90.0\nfocus_range = [30, 40]"),
    "dark": ("[[candidates]]", DIM),
    "alone": ("[camera]\nwidth = 1920\nheight = 1080\nhfov_deg = 90.0\n[task]", HEAD),
}
"""Plans whose cameras cover nothing of what they see."""


@pytest.mark.slow
@pytest.mark.parametrize("name", LESS)
def test_all_that_a_camera_sees_counts_for_a_limit(context, tmp_path, name):
    """In the program and in the page, as for `rastercov check`; in the sheet, too."""
    text = PLAN.partition('min_facing_density = "recognise"')[0].replace(*LESS[name])
    plan = plan_in(tmp_path, text)
    pose = rc.look_at([(1.5, 2.0, 1.5)], (1.5, 4, 1.5))[0]
    rig = read_plan(plan).rig
    own = [row for row, each in enumerate(rig.names) if "/" in each] or [0]
    placed = rc.Poses.of(pose @ rig.rig_from_camera[own], camera=own)
    names = tuple(f"camera {row}" for row in own)
    session = Session(open_plan(plan, rc.Views(rig, placed, names)))
    checked = rc.check(plan, placed)
    wanted = [each.words() for each in checked.requirements]
    assert "100.0 % seen" in wanted[-1] or "100.0 % of the area" in wanted[-1]
    assert checked.requirements[-1].status == "fails"
    assert [each["words"] for each in acted(session)[0]["summary"]["required"]] == wanted
    program = Program(session)
    program.start()
    tab = Tab(context, program.url)
    assert [each["words"] for each in tab.js("rastercov.summary().required")] == wanted
    assert tab.faults == []
    program.stop()
    session.close()


def shown(session, goal, mode="reason", **action):
    from rastercov.page.session import remove_head

    head, levels = remove_head(session.act({
        "revision": session.history.revision, "mode": mode, "goal": goal,
        "action": action or {"do": "none"},
    }))  # fmt: skip
    return head, np.frombuffer(levels, np.uint8)


def test_a_goal_that_is_shown_has_its_own_figures(session):
    task = session.state.task
    head, levels = shown(session, "")
    groups = session.scene.mesh.face_group
    of_others = levels == OCCLUDER_OF_REASONS
    assert np.array_equal(np.unique(groups[of_others]), [2, 3])
    own, levels = shown(session, "doors")
    assert np.array_equal(np.unique(groups[levels != OCCLUDER_OF_REASONS]), [3])
    assert own["summary"]["covered_area"]["of_m2"] == pytest.approx(12)
    assert own["state"]["goal"] == "doors"
    words = [each["words"] for each in own["summary"]["required"]]
    assert words == [each["words"] for each in head["summary"]["required"]]
    assert f"{own['summary']['covered_area']['percent']:.1f} %" in words[1]
    pose = session.state.station(0).pose.copy()
    pose[0, 3] -= 0.5
    shown(session, "doors", do="pose", station=0, pose=pose.ravel().tolist())
    assert session.state.task == task  # thresholds of a goal are not those of the rig
    with pytest.raises(rc.ConfigError, match="expected the task to be shown"):
        shown(session, "doors", do="task", changes={"views": 3})
    with pytest.raises(rc.ConfigError, match="goal to be doors or window"):
        shown(session, "attic")
    assert shown(session, "")[0]["state"]["goal"] == ""


@pytest.mark.slow
def test_work_serves_the_goal_that_is_shown(session):
    before = shown(session, "doors")[0]["summary"]
    work = Work(session)
    work.start({"kind": "add", "camera": next(iter(session.state.cameras))})
    work.wait(120)
    after = shown(session, "doors")[0]["summary"]
    views = [
        sum(each["m2"] for each in said["covered_area"]["by_views"]) for said in (before, after)
    ]
    assert views[1] > views[0]
    shown(session, "window")
    work.start({"kind": "refine", "station": 0})
    work.wait(120)
    assert "which limits it" in work.describe()["words"]


@pytest.mark.slow
def test_goals_are_listed_and_shown_by_their_buttons(context, session):
    program = Program(session)
    program.start()
    tab = Tab(context, program.url)
    tab.open("All cameras")
    rows = tab.page.locator(".goals li")
    said = tab.js("rastercov.summary().required")
    buttons = rows.get_by_role("button")
    assert [each.inner_text() for each in buttons.all()] == [each["words"] for each in said]
    asked = rows.nth(1).locator(".soft").inner_text()
    assert asked.startswith(
        "For west: A point is covered if 2 cameras see it, with 250 px/m or more"
    )
    tab.page.get_by_role("button", name="goal doors").click()
    tab.idle()
    assert "of goal doors" in tab.page.locator(".summary").inner_text()
    assert tab.js("rastercov.summary().covered_area.of_m2") == pytest.approx(12)
    tab.open("Cameras")
    tab.type_number("x", "3")
    assert tab.state()["goal"] == "doors"
    tab.page.wait_for_timeout(2_500)  # a look of the page at the program
    assert tab.page.get_by_text("Another tab").count() == 0
    assert tab.js("rastercov.session.pieces !== undefined")
    tab.open("All cameras")
    rows.first.get_by_role("button").click()
    tab.idle()
    assert "of goal" not in tab.page.locator(".summary").inner_text()
    assert tab.faults == []
    program.stop()


BOARD = """v 2 1 0.5
v 3 1 0.5
v 3 1 1.5
v 2 1 1.5
g board
f 1 2 3
f 1 3 4
"""
OF_BOARD = '[[meshes]]\npath = "board.obj"\nrole = "target"\ntwo_sided = ["board"]\n[camera]'
PLANS = {
    "shares": PLAN.partition("[goals.doors]")[0]
    + "groups = { west = 0.99, floor = 0.05, north = 0.8 }",
    "goals": PLAN,
    "targets": PLAN.replace("[camera]", OF_BOARD)
    + '[goals.board]\ngroups = ["board"]\ncoverage = 0.5\n',
}


def assert_same_goals(session, page):
    """Figures, colours and dead zones of the task and each goal, and their states, of both."""
    for name in (*session.scene.goal_names[1:], ""):
        head, levels = shown(session, name)
        page.js("name => rastercov.session.setGoal(name)", name)
        page.idle()
        value, told = page.js("rastercov.summary()"), head["summary"]
        for entry in ("m2", "of_m2"):
            wanted = told["covered_area"][entry]
            assert value["covered_area"][entry] == pytest.approx(wanted, rel=1e-12, abs=1e-12)
        assert np.array_equal(np.frombuffer(page.levels(), np.uint8), levels), name
        zones = page.js("rastercov.session.server.zones()"), session.zones()
        open_m2, wanted = (sum(each["area"] for each in own) for own in zones)
        assert open_m2 == pytest.approx(wanted, rel=1e-9)
    for own, wanted in zip(value["required"], told["required"], strict=True):
        assert own | {"asked": ""} == wanted | {"asked": ""}
        assert own["asked"] == (wanted["asked"] if own["goal"] else "")
    return {each["status"] for each in told["required"]}


@pytest.mark.slow
@pytest.mark.parametrize("goal", ['goal = "all"', 'goal = "fewest_cameras"\ncoverage = 0.5'])
def test_a_result_opens_again_and_its_sheet_has_its_share(tmp_path, monkeypatch, capsys, goal):
    """Without the target of a goal, which is not of the task."""
    monkeypatch.chdir(tmp_path)
    people = '[[targets]]\nname = "people"\nabove = "floor"\nheight = 1.6\n'
    own = "" if "all" in goal else '[goals.people]\ngroups = ["people"]\ncoverage = 0.1\n'
    text = PLAN.partition("[selection]")[0] + f"{people}[selection]\n{goal}\n{own}"
    share = rc.place(plan_in(tmp_path, text), out="placed").cameras.share
    assert "page.html" in done(capsys, "view placed --export page.html --still")[0]
    done(capsys, "sheet placed --out placed.svg")
    done(capsys, "sheet plan.toml --poses placed/poses.json --out plan.svg")
    for name in ("placed.svg", "plan.svg"):
        shown = re.findall(r">([\d.]+) % of the area<", (tmp_path / name).read_text())
        assert [float(each) for each in shown] == pytest.approx([100 * share], abs=0.05)


@pytest.mark.slow
@pytest.mark.skipif(live.engine() is None, reason="no engine.wasm; run: make wasm")
@pytest.mark.parametrize("seed", range(3))
def test_a_page_adds_no_camera_beyond_the_limit_of_a_goal(context, tmp_path, seed):
    """Cameras are added while the limit holds; a rig beyond it is one line."""
    eyes = np.random.default_rng(seed).uniform((3, 0.2, 1), (3.9, 1.0, 2.5), (1, 3))
    session, _ = session_in(tmp_path, eyes, PLAN)
    page = Tab(context, export_page(session, tmp_path / "page.html", is_still=False).as_uri())
    page.open("Cameras")
    window = "rastercov.summary().required.find(each => each.goal === 'window').status"
    down = rc.look_at(np.array([(3.5, 0.5, 2.9)]), (3.5, 0.4, 0.0))[0]  # at the floor
    act(page, do="pose", station=0, pose=down.ravel().tolist())
    assert page.js(window) == "holds"
    for _ in range(3):
        page.page.get_by_role("button", name="Add the best next camera").click()
        page.page.wait_for_function("!rastercov.session.isWorking")
        page.idle()
        assert page.js(window) == "holds"
    count = len(page.state()["stations"])
    assert count > 1
    at_it = rc.look_at(np.array([(1.5, 2.0, 1.5)]), (1.5, 3.99, 1.5))[0]
    page.js("rastercov.session.choose(0)")
    act(page, do="pose", station=0, pose=at_it.ravel().tolist())
    assert page.js(window) == "fails"
    for name in ("Add the best next camera", "Refine this camera"):
        page.page.get_by_role("button", name=name).click()
        page.page.get_by_text("within the limits of the goals").wait_for()
        page.page.get_by_role("button", name="close").last.click()
    assert len(page.state()["stations"]) == count
    session.close()


@pytest.mark.slow
@pytest.mark.skipif(live.engine() is None, reason="no engine.wasm; run: make wasm")
@pytest.mark.parametrize("text", PLANS.values(), ids=PLANS)
def test_a_page_that_computes_judges_what_a_plan_asks_and_saves_it(
    context, tmp_path, monkeypatch, text
):
    (tmp_path / "board.obj").write_text(BOARD)
    session, _ = session_in(tmp_path, text=text)
    path = export_page(session, tmp_path / "page.html", is_still=False)
    page, heard = Tab(context, path.as_uri()), set()
    rng = np.random.default_rng(5)
    for _ in range(6):
        heard |= assert_same_goals(session, page)
        pose = rc.look_at(rng.uniform((2, 0.2, 1), (3.9, 3.8, 2.9)), (1.0, 2.5, 1.0))[0]
        acted(session, do="pose", station=0, pose=pose.ravel().tolist())
        settled = session.state.stations[0].pose.ravel().tolist()
        act(page, do="pose", station=0, pose=settled)
    assert {"holds", "fails"} <= heard
    required = page.js("rastercov.summary().required")
    page.open("All cameras")
    assert page.page.locator("ul.goals li").count() == len(required)
    if session.scene.goals:
        page.js("rastercov.session.setGoal('window')")
        assert act(page, do="task", changes={"views": 3}) is None
        assert "choose the task" in page.page.locator(".message.fault").inner_text()
    folder = tmp_path / "saved"
    folder.mkdir()
    monkeypatch.chdir(folder)
    for name, content in downloaded(page).items():
        (folder / name).write_text(content)
    checked = rc.check("plan.toml", "rig.json")
    assert {each.words() for each in checked.requirements} == {each["words"] for each in required}
    assert page.faults == []
    session.close()
