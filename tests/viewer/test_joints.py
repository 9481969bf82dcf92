"""Joints of a robot in the viewer: figures and the page are those of what is moved by hand."""

import numpy as np
import pytest
from edited import Session
from moving_scene import CAMERA, TASK
from robots import robot_by_hand, robot_scene
from test_moments import acted, assert_figures
from test_time import assert_shown, served

import rastercov as rc
from rastercov.base.errors import ConfigError

JOINTS = (0.2, 0.4, 1.2, -0.3, 0.1, 0.0)


@pytest.fixture
def cell(tmp_path):
    scene, robot, rows = robot_scene(tmp_path)
    session = Session(scene)
    yield session, robot, rows
    session.close()


def test_figures_of_joints_are_those_of_the_mesh_moved_by_hand(cell):
    session, robot, rows = cell
    for frame in (4, 0):
        head, levels = acted(session, [frame])
        assert_figures(head, levels, *robot_by_hand(robot, rows[frame]))
    head, levels = acted(session, [2, *JOINTS])
    mesh, poses = robot_by_hand(robot, JOINTS)
    assert_figures(head, levels, mesh, poses)
    assert head["state"]["at"] == [2, *JOINTS]
    exact = rc.unite(rc.regions(mesh, CAMERA, poses, TASK)).share()
    assert session.areas().summary()["percent"] == pytest.approx(100 * exact, abs=1e-6)


def test_joints_that_are_none_are_refused_and_change_nothing(cell):
    session, _, _ = cell
    for at in ([0, 1.0], [0, 99.0, *JOINTS[1:]]):
        with pytest.raises(ConfigError) as caught:
            acted(session, at)
        assert str(caught.value).isprintable()
        assert session.at == (0.0,)


@pytest.fixture
def live(context, tmp_path):
    scene, robot, rows = robot_scene(tmp_path)
    for page in served(context, scene):
        yield page, robot, rows


@pytest.mark.slow
def test_sliders_of_joints_move_the_robot(live):
    page, robot, rows = live
    page.page.get_by_role("slider", name="frame").fill("2")
    page.idle()
    assert float(page.page.locator('input.number[aria-label="elbow"]').input_value()) == (
        pytest.approx(np.degrees(rows[2, 2]), rel=1e-5)
    )
    page.type_number("pan", "-20")
    page.page.get_by_role("slider", name="elbow").focus()
    page.keys("PageUp")
    joints = page.js("rastercov.session.further")
    assert joints[0] == pytest.approx(np.radians(-20))
    assert joints[2] > rows[2, 2]
    assert_shown(page, *robot_by_hand(robot, joints))
    page.type_number("lift", "200")  # beyond its limit: one line, and nothing moves
    assert page.page.locator("p.fault:visible").count() == 1
    assert page.js("rastercov.session.further") == joints
    page.page.get_by_role("button", name="Reset to this frame").click()
    page.idle()
    assert_shown(page, *robot_by_hand(robot, rows[2]))
