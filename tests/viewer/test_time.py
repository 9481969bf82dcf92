"""A result over time in Chromium: frames of bodies that move, and what is covered in each."""

import numpy as np
import pytest
import swept_arm as arm
from browser import TOKEN, Program, Tab
from edited import Session
from moving_scene import CAMERA, TASK, by_hand, moving_scene
from timed import evaluate_over_time

import rastercov as rc
from rastercov.core.camera.rig import names_of_poses
from rastercov.motion.frames import show_phases
from rastercov.page.saving import export_page
from rastercov.report.pages import view_page

pytestmark = pytest.mark.slow


def result():
    mesh = arm.cell()
    there = np.arange(5) != 3
    motion = rc.Motion(mesh, arm.frames(arm.sweep(5)), {"link6": there}, [1, 1, 2, 1, 1])
    camera = rc.Camera(width=320, height=240, fx=300, fy=300)
    return evaluate_over_time(motion, camera, arm.CAMERAS[:2], over=0.9)


@pytest.fixture
def tab(context, tmp_path):
    answer = result()
    names = names_of_poses(answer.poses)
    values = {"time": answer.share_of_time()}
    page = view_page(
        "arm",
        answer.motion.mesh,
        answer.camera,
        answer.poses,
        names,
        values,
        {},
        phases=show_phases(answer),
    )
    path = tmp_path / "view.html"
    path.write_text(page, encoding="utf-8")
    return Tab(context, path.as_uri()), answer


@pytest.mark.every_day
def test_the_slider_moves_bodies_and_colours(tab):
    page, result = tab
    motion = result.motion
    origin = np.array(page.js("rastercov.session.origin"))
    for frame in (0, 2, 3, 4):
        page.js("frame => rastercov.session.setFrame(frame)", frame)
        page.idle()
        corners = np.reshape(page.js("[...rastercov.session.corners]"), (-1, 3, 3)) + origin
        pose = motion.world_from_body[frame, motion.body]
        points = motion.mesh.vertices[motion.mesh.faces]
        moved = np.einsum("fij,fkj->fki", pose[:, :3, :3], points) + pose[:, None, :3, 3]
        own = motion.present[frame][motion.body]
        assert np.abs(corners[own] - moved[own]).max() < 1e-6
        assert np.ptp(corners[~own], axis=1).max(initial=0) == 0
    page.js("() => rastercov.session.setMode('now')")
    page.idle()
    levels = [page.levels()]
    page.js("frame => rastercov.session.setFrame(frame)", 1)
    page.idle()
    levels.append(page.levels())
    assert levels[0] != levels[1]
    assert not page.faults


def test_play_goes_through_the_frames(tab):
    page, _ = tab
    page.page.get_by_role("button", name="Play").click()  # whichever tab is shown
    page.page.wait_for_function("rastercov.session.frame >= 2")
    page.page.get_by_role("button", name="Stop").click()
    slider = page.page.get_by_role("slider", name="frame")
    slider.fill("4")
    assert page.js("rastercov.session.frame") == 4
    assert not page.faults


@pytest.fixture
def live(context, tmp_path):
    yield from served(context, moving_scene(tmp_path))


def served(context, scene):
    """Its page while it is served."""
    running = Program(Session(scene))
    running.start()
    page = Tab(context, running.url)
    page.open("All cameras")
    yield page
    running.stop()
    running.session.close()
    assert not page.faults


def assert_shown(page, mesh, poses):
    """Corners, cameras and figures of the page are those of a mesh moved by hand."""
    corners = np.reshape(page.js("[...rastercov.session.corners]"), (-1, 3, 3))
    corners += page.js("rastercov.session.origin")
    assert np.abs(corners - mesh.vertices[mesh.faces]).max() < 1e-6
    shown = np.reshape([each["pose"] for each in page.state()["stations"]], (-1, 4, 4))
    assert np.allclose(shown, poses)
    result = rc.evaluate(mesh, CAMERA, poses, TASK, fields=())
    assert page.area_percent() == pytest.approx(result.areas.summary()["percent"])


def test_the_served_page_shows_figures_of_the_frame(live):
    page = live
    page.page.get_by_role("slider", name="frame").fill("3")
    page.idle()
    mesh, poses = by_hand(3)
    assert_shown(page, mesh, poses)
    centre = poses[1].copy()
    centre[:3, 3] += (0.0, 0.0, 0.05)
    page.js(
        "pose => rastercov.session.act({ do: 'pose', station: 1, pose })", centre.ravel().tolist()
    )
    page.idle()
    assert_shown(page, mesh, np.stack([poses[0], centre]))
    page.page.get_by_role("button", name="Play").click()
    page.page.wait_for_function("rastercov.session.frame === 1")
    page.page.get_by_role("button", name="Stop").click()
    page.idle()


def test_another_tab_follows_the_time_that_is_shown(live, context):
    page = live
    other = Tab(context, page.page.url.split("#")[0] + f"#{TOKEN}")
    page.page.get_by_role("slider", name="frame").fill("4")
    page.idle()
    other.page.wait_for_function("rastercov.session.frame === 4")
    other.idle()
    assert_shown(other, *by_hand(4))


def test_an_exported_page_plays_the_figures(context, tmp_path):
    session = Session(moving_scene(tmp_path, steps=3))
    page = Tab(context, export_page(session, tmp_path / "page.html").as_uri())
    for frame in (2, 1):
        page.js("frame => rastercov.session.setFrame(frame)", frame)
        page.idle()
        assert_shown(page, *by_hand(frame, 3))
    assert not page.faults
    session.close()
