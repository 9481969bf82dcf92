"""Pages without a server in Firefox: those that compute, recorded ones, the playground."""

import json

import pytest
from firefox import FIREFOX, XVFB, firefox
from rigs_to_view import session_of, session_of_room
from test_live import evaluated_of

from rastercov.page.saving import export_page
from rastercov.report import live

pytestmark = [
    pytest.mark.matter("page"),
    pytest.mark.slow,
    pytest.mark.skipif(
        None in (FIREFOX, XVFB), reason="no Firefox; as root: apt-get install -y firefox-esr xvfb"
    ),
]
WITHOUT = pytest.mark.skipif(live.engine() is None, reason="no engine.wasm; run: make wasm")
ASKED = "http://127.0.0.1:9/"
READY = "window.rastercov?.session.figures || document.querySelector('.failed[role=alert]')"


@pytest.fixture(scope="module")
def page():
    with firefox() as made:
        made.resize(1180, 700)
        yield made
        assert [
            each for each in made.faults if ASKED not in each
        ] == []  # which is the policy's line
        assert {each.split(":")[0] for each in made.requests if ASKED not in each} <= {
            "file",
            "blob",
            "data",
        }


def acted(page, **action):
    page.js(f"rastercov.session.act({json.dumps(action)})")
    page.js("rastercov.whenIdle().then(() => 1)")


@pytest.mark.every_day
@WITHOUT
def test_a_page_computes_the_figures_of_rastercov(page, tmp_path):
    session = session_of_room()
    page.goto(export_page(session, tmp_path / "page.html", is_still=False).as_uri())
    page.until(READY)
    for step in (0.1, 0.2, 0.35):
        pose = page.js("rastercov.state().stations[0].pose")
        pose[3] -= step
        acted(page, do="pose", station=0, pose=pose)
    acted(page, do="duplicate", station=1)
    acted(page, do="camera", camera="wide", changes={"hfov_deg": 82.5})
    expected = evaluated_of(page.js("rastercov.state()"))["covered_area"]
    assert page.js("rastercov.summary().covered_area.m2") == expected["m2"]
    assert page.js("rastercov.session.server.asking.worker !== null")
    shown = page.js("document.querySelector('.summary .covered').textContent")
    assert shown == f"{expected['percent']:.1f} %"
    zones = page.js("rastercov.session.server.zones()")
    assert sum(each["area"] for each in zones) > 0
    assert page.js(f"fetch('{ASKED}').then(() => 'out', () => 'kept')") == "kept"
    session.close()


def test_a_recorded_page_opens(page, tmp_path):
    session = session_of()
    page.goto(export_page(session, tmp_path / "page.html").as_uri())
    page.until(READY)
    percent = session.figures().summary()["covered_area"]["percent"]
    assert page.js("rastercov.summary().covered_area.percent") == percent
    session.close()


@WITHOUT
def test_the_playground_places_a_camera_in_its_room(page, tmp_path):
    path = tmp_path / "playground.html"
    path.write_text(live.playground(), encoding="utf-8")
    page.goto(path.as_uri())
    page.until("document.querySelector('.begin button')")
    page.js("document.querySelector('.begin .buttons button').click()")
    page.until(READY)
    assert page.js("rastercov.session.scene.is_room")
    page.js("rastercov.session.server.startJob({kind: 'add', camera: '100° lens'})")
    page.until("rastercov.session.server.history.state.stations.length === 1")
    page.js("rastercov.session.takeOver()")
    page.js("rastercov.whenIdle().then(() => 1)")
    assert page.js("rastercov.summary().covered_area.percent") > 20
