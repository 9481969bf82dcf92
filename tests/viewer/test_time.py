"""A result over time in Chromium: frames of bodies that move, and what is covered in each."""

import numpy as np
import pytest
import swept_arm as arm
from browser import Tab

import rastercov as rc
from rastercov.camera.rig import names_of_poses
from rastercov.report.pages import view_page

pytestmark = pytest.mark.slow


def result():
    mesh = arm.cell()
    there = np.arange(5) != 3
    motion = rc.Motion(mesh, arm.frames(arm.sweep(5)), {"link6": there}, [1, 1, 2, 1, 1])
    camera = rc.Camera(width=320, height=240, fx=300, fy=300)
    return rc.evaluate_over_time(motion, camera, arm.CAMERAS[:2], over=0.9)


@pytest.fixture
def tab(context, tmp_path):
    found = result()
    names = names_of_poses(found.poses)
    values = {"time": found.share_of_time()}
    page = view_page(
        "arm", found.motion.mesh, found.camera, found.poses, names, values, {}, timed=found
    )
    path = tmp_path / "view.html"
    path.write_text(page, encoding="utf-8")
    return Tab(context, path.as_uri()), found


def test_the_slider_moves_bodies_and_colours(tab):
    page, found = tab
    motion = found.motion
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
    page.open("Network")
    page.page.get_by_role("button", name="Play").click()
    page.page.wait_for_function("rastercov.session.frame >= 2")
    page.page.get_by_role("button", name="Stop").click()
    slider = page.page.get_by_role("slider", name="frame")
    slider.fill("4")
    assert page.js("rastercov.session.frame") == 4
    assert not page.faults
