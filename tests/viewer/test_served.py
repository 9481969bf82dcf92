"""A served page: its engine computes, and Python answers what that cannot."""

from dataclasses import replace

import numpy as np
import pytest
from browser import Program, Tab
from edited import Session
from rigs_to_view import EYES, ROOM, WIDE, percent_covered, session_of_room

import rastercov as rc
from rastercov.report import live

WITHOUT = pytest.mark.skipif(live.engine() is None, reason="no engine.wasm; run: make wasm")
pytestmark = pytest.mark.slow


def asked_by(tab):
    """Questions of the page since the last time."""
    items = [url for url in tab.requests if url.endswith("/api/ask")]
    tab.requests.clear()
    return len(items)


def moved(tab, by):
    """Percent that the page shows after a move of the first camera, as `rc.evaluate` finds it."""
    pose = tab.pose()
    pose[:3, 3] += by
    given = pose.ravel().tolist()
    tab.js("pose => rastercov.session.act({ do: 'pose', station: 0, pose })", given)
    tab.idle()
    assert tab.area_percent() == pytest.approx(percent_covered(tab.state()), abs=1e-9)


@WITHOUT
@pytest.mark.every_day
def test_the_engine_of_the_page_computes_and_python_is_asked_beyond_its_limits(tab):
    asked_by(tab)
    moved(tab, (-0.1, 0.05, 0.0))
    tab.js("rastercov.session.server.zones()")
    tab.js("rastercov.session.server.why(5)")
    assert asked_by(tab) == 0
    for mode in ("angle", "single", "segments"):
        tab.js("mode => rastercov.session.setMode(mode)", mode)
        tab.idle()
        assert asked_by(tab) == 1
    tab.js("() => rastercov.session.setMode('reason')")
    tab.idle()
    tab.js("() => { rastercov.session.server.data.mostPairs = 0; }")  # as of a million faces
    asked_by(tab)
    moved(tab, (0.0, 0.1, 0.0))
    assert asked_by(tab) >= 1
    tab.js("() => { rastercov.session.server.data.mostPairs = 1e9; }")
    tab.js("() => rastercov.session.act({ do: 'task', changes: { min_pixels: 4 } })")
    tab.idle()
    result = rc.evaluate(
        ROOM, WIDE, [np.reshape(each["pose"], (4, 4)) for each in tab.state()["stations"]],
        rc.Task(min_pixels=4), by="face",
    )  # fmt: skip
    network = rc.Network(ROOM, rc.Task(min_pixels=4))
    network.add(result)
    assert tab.js("rastercov.summary().covered.faces") == network.summary()["covered"]["faces"]
    assert "min_pixels" in tab.js("rastercov.summary().by_face_because")


@WITHOUT
def test_what_is_lost_without_a_camera_is_known_where_groups_need_several(context):
    room = session_of_room().scene
    start = replace(room.start, needed={"crates": 2})
    session = Session(replace(room, start=start))
    program = Program(session)
    program.start()
    tab = Tab(context, program.url)
    told = session.figures().summary()["by_camera"]
    value = tab.js("rastercov.summary().by_camera")
    for own, wanted in zip(value, told, strict=True):
        assert own["alone_percent"] == pytest.approx(wanted["alone_percent"], abs=1e-9)
        assert own["area_percent"] == pytest.approx(wanted["area_percent"], rel=1e-9)
    assert tab.faults == []
    program.stop()
    session.close()


@WITHOUT
def test_python_answers_where_the_engine_fails(tab):
    tab.js("""() => {
      const { asking } = rastercov.session.server;
      asking.ask = () => Promise.reject(new RangeError("Array buffer allocation failed"));
    }""")
    asked_by(tab)
    moved(tab, (-0.1, 0.05, 0.0))
    assert asked_by(tab) >= 1
    assert tab.page.locator(".message.fault").count() == 0


def test_a_page_without_the_engine_says_so_and_is_edited_as_well(context, monkeypatch):
    monkeypatch.setattr(live, "engine", lambda name=live.ENGINE: None)
    session = session_of_room()
    program = Program(session)
    program.start()
    tab = Tab(context, program.url)
    tab.page.get_by_text(live.BY_PYTHON).wait_for()
    moved(tab, (-0.1, 0.05, 0.0))
    tab.button("Undo")
    np.testing.assert_array_equal(tab.pose()[:3, 3], EYES[0])
    tab.button("Add the best next camera")
    tab.page.wait_for_function("rastercov.state().stations.length === 3")
    tab.idle()
    assert tab.area_percent() == pytest.approx(percent_covered(tab.state()), abs=1e-9)
    assert tab.faults == []
    program.stop()
    session.close()


def test_what_was_done_is_there_after_the_page_was_opened_again(tab):
    for action in (
        {"do": "duplicate", "station": 0},
        {"do": "keep_variant", "name": "A"},
        {"do": "delete", "station": 1},
        {"do": "undo"},
    ):
        tab.js("action => rastercov.session.act(action)", action)
        tab.idle()
    before = tab.state()
    tab.page.reload()
    tab.page.wait_for_function("window.rastercov?.session.figures !== undefined")
    tab.idle()
    after = tab.state()
    for name in ("stations", "task", "can_undo", "can_redo", "undo_label", "redo_label"):
        assert after[name] == before[name], name
    assert [each["name"] for each in after["variants"]] == ["A"]
    assert after["variants"][0]["is_shown"]
    tab.button("Redo")
    assert len(tab.state()["stations"]) == 2
