"""What a user does not lose: by a dead program, another tab, or a lost graphics device."""

import json

import numpy as np
import pytest
from browser import Program, Tab
from rigs_to_view import percent_covered, session_of_room

import rastercov as rc

pytestmark = pytest.mark.slow


def test_a_dead_program_is_told_and_nothing_is_lost(tab, program, tmp_path):
    """The file is that of "Save rig", cameras that are off included; figures are dimmed."""
    off = tab.state()["stations"][1]["id"]
    tab.js(f"rastercov.session.act({{do: 'switch', station: {off}, is_on: false}})")
    tab.press("ArrowLeft")
    tab.idle()
    edited = tab.state()["stations"][0]["pose"]
    saved = json.loads(tab.js("rastercov.session.server.texts().rig"))
    dimmed = "getComputedStyle(document.querySelector('.summary')).opacity < 1"
    assert not tab.js(dimmed)
    program.stop()
    tab.press("ArrowLeft")  # an edit that nobody hears
    tab.page.get_by_role("alert").filter(has_text="Your rig is kept in this page").wait_for()
    assert tab.js(dimmed)
    with tab.page.expect_download() as got:
        tab.page.get_by_role("button", name="Download the rig").click()
    got.value.save_as(tmp_path / got.value.suggested_filename)
    content = json.loads((tmp_path / "rig.json").read_text())
    assert content | {"world_from_camera": saved["world_from_camera"]} == saved
    poses = rc.read_poses(tmp_path / "rig.json")
    assert len(poses) == 2
    wanted = tab.js("rastercov.session.poseOf(rastercov.session.station())")
    assert wanted != edited
    np.testing.assert_allclose(np.ravel(poses[0]), wanted)
    program.start()
    tab.page.locator(".banner").wait_for(state="hidden")
    tab.idle()
    assert not tab.js(dimmed)
    np.testing.assert_allclose(tab.state()["stations"][0]["pose"], wanted)
    assert tab.area_percent() == pytest.approx(percent_covered(tab.state()), abs=1e-9)


@pytest.fixture
def left_alone(tab, program):
    """A tab with an edit, whose program has ended; starts another on its port."""
    running = []

    def again(**options):
        running.append(Program(session_of_room(), port=program.port, **options))
        running[0].start()  # with the rig as read from the file
        return running[0]

    tab.press("ArrowLeft")
    tab.idle()
    edited = tab.state()["stations"]
    program.stop()
    yield edited, again
    for each in running:
        each.stop()
        each.session.close()


@pytest.mark.every_day
def test_a_program_that_was_started_again_gets_the_rig_back(tab, left_alone):
    edited, again = left_alone
    tab.page.locator(".banner").wait_for()
    again()
    tab.page.get_by_text("the rig of this page was restored").wait_for()
    tab.idle()
    assert tab.state()["stations"] == edited
    assert tab.state()["can_undo"]


def test_another_key_of_the_program_leads_to_its_address(tab, left_alone, program):
    edited, again = left_alone
    other = again(token="another-" + program.token)
    tab.page.get_by_text("open the address that it printed").wait_for()
    tab.page.evaluate("url => location.assign(url)", other.url)
    tab.page.get_by_role("button", name="Restore the rig").click()
    tab.page.wait_for_function("rastercov.state().can_undo")
    assert tab.state()["stations"] == edited


def test_two_tabs_do_no_harm(tab, context, program):
    other, told = Tab(context, program.url), "Another tab changed the rig"
    stale = tab.js("rastercov.session.server.server.ping()")  # what the program says now
    tab.page.route("**/api/ping", lambda route: route.fulfill(json=stale))
    other.press("ArrowLeft")
    other.idle()
    moved = other.state()["stations"]
    # An act on the older state is refused, and the tab shows the state as it is.
    tab.press("ArrowRight")
    tab.page.get_by_text(told).first.wait_for()
    tab.idle()
    assert tab.state()["stations"] == moved
    tab.page.unroute("**/api/ping")
    tab.press("ArrowRight")
    tab.idle()
    other.page.get_by_text(told).first.wait_for()  # it learns of it by itself
    other.idle()
    assert other.state()["stations"] == tab.state()["stations"] != moved
    assert other.faults == []


def test_a_late_answer_to_a_ping_takes_no_edit_back(tab):
    tab.js("""async () => {
        const { session } = rastercov;
        const answer = await session.server.ping();
        session.server.ping = () => new Promise((give) => (window.giveAnswer = () => give(answer)));
        session.check();
    }""")
    tab.page.wait_for_function("Boolean(window.giveAnswer)")
    tab.press("ArrowLeft")
    tab.idle()
    edited = tab.state()["stations"]
    tab.js("window.giveAnswer()")
    tab.idle()
    assert tab.js("rastercov.session.reloads") == 0
    assert tab.state()["stations"] == edited


def test_the_picture_comes_back_after_the_device_was_lost(tab):
    tab.js("rastercov.setOption('isFlat', true)")
    centre = "rastercov.readPixel(rastercov.view.canvas.clientWidth / 2, 300)"
    before = tab.js(centre)
    tab.js("() => { window.loser = rastercov.view.gl.getExtension('WEBGL_lose_context'); }")
    for call, is_lost in (("loseContext", "true"), ("restoreContext", "false")):
        tab.js(f"window.loser.{call}()")
        tab.page.wait_for_function(f"rastercov.view.isLost === {is_lost}")
    tab.idle()
    assert tab.js(centre) == before
