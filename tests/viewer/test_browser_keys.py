"""The page by keys and by names, and what it says where it does not do as it is told."""

import re
import unicodedata
from functools import reduce
from operator import getitem
from pathlib import Path

import numpy as np
import pytest
from browser import Program, Tab
from edited import Session
from nightly import amount
from rigs_to_view import ROOM, WIDE, percent_covered
from test_time import live  # noqa: F401 # a fixture

import rastercov as rc
from rastercov.core.camera.pose import Poses
from rastercov.core.camera.rig import Rig
from rastercov.page.rig_state import RigState
from rastercov.page.scene import Scene, open_plan
from rastercov.report.pages import plan_cut

pytestmark = pytest.mark.slow
PLAN = Path(rc.__file__).parents[1] / "examples" / "plans" / "watch_room.toml"
UNDO, REDO = "Control+z", "Control+Shift+z"


@pytest.fixture
def opened(context):
    """Function that opens the page of a session."""
    made = []

    def opened_of(session):
        program = Program(session)
        program.start()
        made.append((program, session, Tab(context, program.url)))
        return made[-1][2]

    yield opened_of
    for program, session, tab in made:
        assert tab.faults == []
        program.stop()
        session.close()


FIELDS = {
    "Max incidence": (("task", "max_incidence_deg"), ("120", "x", "", "45", "7,5")),
    "Min pixels per m²": (("task", "min_pixels_per_m2"), ("-1", "1e", "30", "400")),
    "x": (("stations", 0, "pose", 3), ("1e", "2.25", "-1")),
    "Name of the camera": (("stations", 0, "name"), ("", "door", "gate 2")),
}
"""What the rig has of a field, and texts, some of which it refuses."""


@pytest.mark.parametrize("seed", range(amount(1, at_night=3)))
def test_a_field_never_shows_what_is_not_the_rigs(tab, seed):
    """After undo, redo, Esc and each edit that is taken, by any order of keys."""
    rng, steps = np.random.default_rng(seed), 0
    for _ in range(25):
        label = str(rng.choice(list(FIELDS)))
        place, texts = FIELDS[label]
        tab.keys("2" if "Min" not in label and "Max" not in label else "4")
        box = tab.page.locator(f'input[aria-label="{label}"]:visible').first
        box.focus()
        for _ in range(rng.integers(1, 4)):
            deed = rng.choice(
                ["type", "Enter", UNDO, REDO, "Escape"], p=[0.35, 0.25, 0.2, 0.1, 0.1]
            )
            if deed == "type":
                box.select_text()
                tab.page.keyboard.press("Delete")
                tab.page.keyboard.insert_text(str(rng.choice(texts)))
                continue
            tab.keys(str(deed))
            if deed == "Enter" and (
                box.get_attribute("aria-invalid") == "true" or not box.input_value()
            ):
                continue
            shown, wanted = box.input_value(), reduce(getitem, place, tab.state())
            if isinstance(wanted, str):
                assert shown == wanted
            else:
                assert float(shown) == pytest.approx(wanted, rel=1e-4, abs=1e-4)
            steps += 1
            box.focus()
        tab.keys("Escape")
        tab.page.locator("canvas.scene").focus()
    assert steps > 15


def test_undo_in_a_field_takes_back_the_text_and_then_the_rig(tab):
    tab.open("All cameras")
    box = tab.type_number("Max incidence", "45")
    box.focus()
    tab.page.keyboard.insert_text("1")
    tab.keys(UNDO)
    assert (box.input_value(), tab.state()["task"]["max_incidence_deg"]) == ("45", 45)
    tab.keys(UNDO)
    assert (box.input_value(), tab.state()["task"]["max_incidence_deg"]) == ("90", 90)
    tab.keys(REDO)
    assert (box.input_value(), tab.state()["task"]["max_incidence_deg"]) == ("45", 45)


def test_a_place_that_the_plan_moves_is_said(opened):
    session = Session(open_plan(PLAN, rc.read_views(PLAN.parent / "rig.json")))
    tab = opened(session)
    before = tab.pose()[:3, 3]
    tab.type_number("z", "50")
    line = tab.page.locator(".message.notice").filter(has_text="does not allow this place")
    place = tab.pose()[:3, 3]
    moved = re.search(r"moved ([\d.]+) m to the nearest allowed place", line.inner_text())
    wanted = np.array((*before[:2], 50))
    assert float(moved[1]) == pytest.approx(np.linalg.norm(place - wanted), rel=0.01)
    assert float(tab.page.locator('input[aria-label="z"]').input_value()) == pytest.approx(
        place[2], abs=1e-3
    )
    line.get_by_role("button").click()
    tab.type_number("z", f"{place[2]:.3f}")
    assert line.count() == 0


def box(low, high, *, inwards=True):
    """Vertices and faces of a box."""
    low, high = np.array(low, float), np.array(high, float)
    corners = np.array([[k & 1, k >> 1 & 1, k >> 2] for k in range(8)])
    faces = np.array([(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
                      (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7),
                      (1, 7, 3)])  # fmt: skip
    return low + corners * (high - low), faces if inwards else faces[:, ::-1]


def building(task):
    """Three storeys of 3 m with a step in each, of which some are the task."""
    vertices, faces, group = [], [], []
    for storey in range(3):
        floor = 3 * storey
        room, step = ((0, 0, floor), (8, 6, floor + 2.9)), ((1, 1, floor), (2, 2, floor + 0.8))
        for (low, high), is_in in ((room, True), (step, False)):
            points, own = box(low, high, inwards=is_in)
            faces.append(own + 8 * len(vertices))
            vertices.append(points)
            group += [storey] * 12
    groups = [rc.Group(f"storey {row}", is_occluder=row not in task) for row in range(3)]
    return rc.Mesh(np.concatenate(vertices), np.concatenate(faces), groups, group)


@pytest.mark.parametrize("task", [(0,), (1,), (2,), (0, 1, 2)])
@pytest.mark.parametrize("eye", [None, 0, 1, 2])
def test_a_floor_plan_is_cut_in_the_storey_of_the_task(task, eye):
    eyes = (
        [] if eye is None else [rc.look_at((4.0, 3.0, 3 * eye + 2.5), (7.0, 3.0, 3 * eye + 1.5))[0]]
    )
    result = plan_cut(building(task), eyes)
    own = eye if eye in task else task[0]
    if eye is None and len(task) > 1:
        assert result % 3 < 2.9
        return
    assert 3 * own + 0.8 < result < 3 * own + 2.9


def test_the_floor_plan_shows_the_floor_of_the_task(opened):
    pose = rc.look_at((4.0, 3.0, 5.5), (7.0, 3.0, 4.0))
    state = RigState.of(Rig([WIDE], ["wide"]), Poses.of(pose))
    tab = opened(Session(Scene("building", building((1,)), state)))
    tab.button("Floor plan")
    assert tab.js("rastercov.pick(...rastercov.screenOf([6, 4, 3]))")["point"][2] == pytest.approx(
        3.0, abs=1e-4
    )


def screened():
    """A room whose camera is behind a screen, which hides the far wall from it."""
    points, faces = box((2.0, -2.0, 0.05), (2.1, 2.0, 2.7), inwards=False)
    mesh = rc.Mesh(
        np.concatenate([ROOM.vertices, points]),
        np.concatenate([ROOM.faces, faces + len(ROOM.vertices)]),
        [*ROOM.groups, rc.Group("screen", is_occluder=True)],
        np.concatenate([ROOM.face_group, np.full(12, len(ROOM.groups))]),
    )
    pose = rc.look_at((-2.5, 0.0, 2.0), (3.0, 0.0, 1.0))
    return Session(Scene("screened", mesh, RigState.of(Rig([WIDE], ["wide"]), Poses.of(pose))))


def test_what_hides_a_dead_zone_is_left_out_of_the_picture_and_shown_again(opened):
    tab = opened(screened())
    far = np.flatnonzero(ROOM.centroids[:, 0] > 2.99).tolist()
    zone = {"faces": far, "centre": [3, 0, 1.2], "normal": [-1, 0, 0], "area": 4}
    tab.js("zone => rastercov.tools.showZone(zone)", zone)  # from farther away than the screen is
    tab.idle()
    assert "screen" in tab.page.locator(".message.notice").inner_text()
    tab.open("Object")
    box_of = tab.page.get_by_label("screen")
    assert box_of.is_visible()  # its section is open
    assert not box_of.is_checked()
    picked = "[rastercov.view.canvas.clientWidth / 2, rastercov.view.canvas.clientHeight / 2]"
    assert tab.js(f"rastercov.pick(...{picked})")["face"] < ROOM.n_faces
    face = int(np.linalg.norm(ROOM.centroids - zone["centre"], axis=1).argmin())
    tab.js("face => rastercov.tools.pickFace({ face, point: [0, 0, 0] })", face)
    tab.page.locator(".occluder").first.click()
    assert box_of.is_checked()
    assert tab.js("rastercov.view.highlighted") == len(ROOM.groups)


@pytest.mark.every_day
def test_a_measure_by_keys(tab):
    tab.press("Escape")  # no camera: arrows turn the view
    tab.press("Escape")
    tab.keys("r", "Enter", "ArrowLeft", "ArrowLeft", "Enter")
    points = np.array(tab.js("rastercov.tools.points"))
    assert points.shape == (2, 3)
    length = np.linalg.norm(points[1] - points[0])
    assert length > 0.1
    value, unit = tab.page.locator(".measure").inner_text().split(" ")[:2]
    assert float(value) * {"mm": 1e-3, "m": 1}[unit] == pytest.approx(length, rel=0.01)


def test_the_page_is_downloaded_by_keys_with_what_was_just_typed(tab, context, tmp_path):
    tab.open("All cameras")
    box_of = tab.page.locator('input.number[aria-label="Max incidence"]')
    box_of.fill("50")
    with tab.page.expect_download() as download:
        tab.page.keyboard.press("Control+Shift+s")
    download.value.save_as(tmp_path / "page.html")
    page = Tab(context, (tmp_path / "page.html").as_uri())
    expected = percent_covered(tab.state(), max_incidence_deg=50)
    assert page.area_percent() == pytest.approx(expected, abs=1e-9)
    assert page.state()["task"]["max_incidence_deg"] == 50


def test_a_menu_goes_by_keys(tab):
    head = tab.page.locator(".menu > summary").filter(has_text="Save")
    head.focus()
    tab.keys("Enter", "Tab")
    assert tab.js("document.activeElement.textContent") == "Save rig"
    tab.keys("Escape")
    assert tab.page.get_by_role("button", name="Save rig").is_hidden()
    assert tab.js("document.activeElement.tagName") == "SUMMARY"


def test_frames_are_stepped_by_keys(live):  # noqa: F811
    page = live
    for key, frame in ((".", 1), (".", 2), (",", 1), (",", 0), (",", 0)):
        page.press(key)
        page.idle()
        assert page.js("rastercov.session.frame") == frame
    page.press(" ")
    page.page.wait_for_function("rastercov.session.frame > 0")
    page.press(" ")


def is_sign(character):
    return unicodedata.category(character) in ("So", "Sm", "Pi", "Pf") and character not in "+±×<>−"


def test_names_of_controls_have_no_arrows_and_the_scene_comes_early(tab):
    for panel in ("Object", "Cameras", "One camera", "All cameras"):
        tab.open(panel)
        tree = tab.page.locator("body").aria_snapshot()
        names = re.findall(
            r'- (?:button|tab|link|checkbox|combobox|slider|text|img)[^"\n]*"([^"]*)"', tree
        )
        assert len(names) > 20
        assert [each for each in names if any(map(is_sign, each))] == []
    tab.page.reload()
    tab.page.wait_for_function("window.rastercov?.session.figures !== undefined")
    for _ in range(5):
        tab.page.keyboard.press("Tab")
        if tab.js("document.activeElement === rastercov.view.canvas"):
            return
    pytest.fail("the scene is not among the first five stops")


def test_why_there_are_no_exact_pieces_is_said(tab):
    words, draw = (
        tab.page.locator(".unit-of-legend"),
        tab.page.get_by_role("button", name="Draw exact"),
    )
    tab.page.wait_for_function("rastercov.session.pieces !== undefined")
    assert words.inner_text() == "Percentages refer to exact areas."
    tab.js("rastercov.session.scene.n_faces = 1e6")
    tab.press("ArrowLeft")
    tab.idle()
    tab.page.wait_for_timeout(1_000)
    assert "1,000,000 faces and 2 cameras" in words.inner_text()
    assert tab.area_percent() == pytest.approx(percent_covered(tab.state()), abs=1e-9)
    draw.click()
    tab.page.get_by_text("Percentages refer to exact areas.").wait_for()
    assert draw.is_hidden()
    tab.open("All cameras")
    tab.type_number("Min pixels", "9")
    summary = tab.page.locator(".summary").inner_text()
    assert "by whole faces (min_pixels applies to faces)" in summary
    assert "min_pixels applies to faces" in words.inner_text()
