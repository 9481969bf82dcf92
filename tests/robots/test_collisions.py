"""Collisions of robots: the pairs of bodies that count, and their distances."""

from pathlib import Path

import numpy as np
import pytest

import rastercov as rc
from rastercov.base.errors import ConfigError

pytestmark = pytest.mark.native
ARM = Path(__file__).parents[2] / "examples" / "arm.urdf"


@pytest.fixture(scope="module")
def arm():
    return rc.Robot.load(ARM)


def box_at(*centre, size=(0.1, 0.1, 0.1)):
    return rc.shapes.box(size, 1, centre)


def test_a_box_beside_the_arm_is_as_far_as_it_is(arm):
    """At rest the head's face is at y = 0.343: arm, elbow and wrist have offsets along y."""
    still = arm.rest
    top = arm.mesh.bounds[1]
    for gap in (0.3, 0.02, 1e-6):
        scene = box_at(0, top[1] + gap + 0.05, 1.0, size=(5, 0.1, 5))
        clearance = rc.Collisions(arm, [scene]).clearance(still)[0]
        own = rc.Collisions(arm).clearance(still)[0]
        assert abs(clearance - min(gap, own)) <= 1e-12
    for gap in (0.0, 1e-12, -1e-6):
        scene = box_at(0, top[1] + gap + 0.05, 1.0, size=(5, 0.1, 5))
        assert rc.Collisions(arm, [scene]).clearance(still)[0] == 0


def test_what_is_inside_of_a_body_is_in_collision(arm):
    still = arm.rest
    assert rc.Collisions(arm).clearance(still, 0.01)[0] == 0.01
    assert rc.Collisions(arm, [box_at(0, 0, 0, size=(9, 9, 9))]).clearance(still)[0] == 0
    in_the_head = arm.frames(still)["head"][0] @ (0, 0, 0.025, 1)
    assert rc.Collisions(arm, [box_at(*in_the_head[:3], size=(0.01,) * 3)]).clearance(still)[0] == 0
    room = box_at(0, 0, 0, size=(9, 9, 9))
    inward = rc.Mesh(room.vertices, room.faces[:, ::-1])
    assert rc.Collisions(arm, [inward]).clearance(still, 0.01)[0] == 0.01
    outside = rc.Robot.load(ARM, base=np.eye(4) + np.eye(4, k=3) * 20)
    assert rc.Collisions(outside, [inward]).clearance(still)[0] == 0


def test_pairs_that_no_joint_moves_and_neighbours_do_not_count(arm):
    pairs = rc.Collisions(arm, [box_at(3, 3, 3)], [("head", "base")]).pairs
    assert ("base", "") not in pairs  # a base may stand on a table
    assert ("shoulder", "") in pairs
    assert ("base", "shoulder") not in pairs
    assert ("base", "upper_arm") in pairs
    assert ("wrist_3", "head") not in pairs
    assert ("wrist_2", "head") in pairs
    assert ("base", "head") not in pairs


def test_targets_are_no_obstacle(arm):
    sheet = box_at(0, 0, 0.7, size=(3, 3, 0.01)).with_groups(targets=["mesh"])
    assert rc.Collisions(arm, [sheet]).clearance(arm.rest, 0.01)[0] == 0.01


def test_folding_the_arm_into_itself_is_a_collision(arm):
    free = rc.Collisions(arm)
    joints = np.zeros((2, 6))
    joints[1, [1, 2, 3]] = 2.2, 2.7, 2.7  # the wrist into shoulder and base
    clearance = free.clearance(joints, 0.01)
    assert clearance.tolist() == [0.01, 0]
    assert free.clearance(joints, 0.01).tobytes() == clearance.tobytes()


def test_wrong_arguments_are_refused(arm):
    with pytest.raises(ConfigError, match="links of the robot, got 'hand'"):
        rc.Collisions(arm, allowed=[("hand", "head")])
    with pytest.raises(ConfigError, match="most to be above 0"):
        rc.Collisions(arm).clearance(arm.rest, 0)
