"""Cameras on an arm in the light of lamps."""

import numpy as np
import pytest
from plans import told
from test_arms import ARM, PLAN, areas_with_arm, folder, part  # noqa: F401 # for every test

import rastercov as rc


def test_cameras_on_an_arm_cover_what_lamps_light():
    own = {"kind": "point", "intensity_cd": 100.0, "position": [0.3, 0.1, 0.9]}
    one = {"goal": "best_coverage", "cameras": 1}
    of_light = {"lamps": {"key": own}, "task": PLAN["task"] | {"min_illuminance": 160.0}}
    placed = rc.place(PLAN | of_light | {"selection": one}, out="out")
    robot, written = rc.Robot.load(ARM), told("poses.json")
    pose, joints = rc.read_poses("out/poses.json"), np.array(written["joints"])
    task, seen = rc.Task(max_incidence_deg=70), rc.Camera.from_fov(320, 256, hfov_deg=40)
    lamps = rc.Lamps([rc.Lamp.point(intensity=100)], rc.look_at((0.3, 0.1, 0.9), (0.5, 0.1, 0.2)))
    lit = rc.Task(max_incidence_deg=70, min_illuminance=160)
    with_arm = areas_with_arm(robot, pose, joints, seen, lit, lamps=lamps)[0]
    assert 0 < with_arm < 0.95 * areas_with_arm(robot, pose, joints, seen, task)[0]
    assert placed.cameras.areas.covered.share() == pytest.approx(
        with_arm / part().areas.sum(), abs=1e-5
    )
