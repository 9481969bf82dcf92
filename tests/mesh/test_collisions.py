"""Collisions of robots: distances of bodies, and the pairs of them that count."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

import rastercov as rc
from rastercov.base.errors import ConfigError
from rastercov.mesh.contacts import TriangleTree
from rastercov.native import mesh_clearance

pytestmark = pytest.mark.native
ARM = Path(__file__).parents[2] / "examples" / "arm.urdf"


@pytest.fixture(scope="module")
def arm():
    return rc.Robot.load(ARM)


def rigid(rng, away=1.0):
    pose = np.eye(4)
    pose[:3, :3] = Rotation.random(random_state=int(rng.integers(1 << 30))).as_matrix()
    pose[:3, 3] = rng.normal(size=3) * away
    return pose


def soup(rng, n):
    return (rng.normal(size=(n, 1, 3)) + 0.3 * rng.normal(size=(n, 3, 3))).reshape(-1, 3)


def distances(one, other, poses, reach=np.inf):
    """Distances of triangles (N, 3) of corners each."""
    trees = [TriangleTree.over(p, np.arange(len(p)).reshape(-1, 3)) for p in (one, other)]
    found = np.full(len(poses), float(reach))
    mesh_clearance.distances(
        trees[0].corners, trees[0].nodes, trees[1].corners, trees[1].nodes, poses, found
    )
    return found


def of_two_triangles(a, b):
    """Distance as least squares over the weights of corners, none negative, of sum 1 each."""
    heavy = 1e4
    rows = np.zeros((5, 6))
    rows[:3, :3], rows[:3, 3:], rows[3, :3], rows[4, 3:] = a.T, -b.T, heavy, heavy
    weights = nnls(rows, np.array([0, 0, 0, heavy, heavy]))[0]
    first, second = weights[:3] / weights[:3].sum(), weights[3:] / weights[3:].sum()
    return np.linalg.norm(first @ a - second @ b)


def test_distances_are_those_of_all_pairs_of_triangles():
    rng, n_apart = np.random.default_rng(0), 0
    for _ in range(40):
        one, other, pose = soup(rng, 6), soup(rng, 5), rigid(rng, 1.5)
        turned = other @ pose[:3, :3].T + pose[:3, 3]
        wanted = min(
            of_two_triangles(a, b) for a in one.reshape(-1, 3, 3) for b in turned.reshape(-1, 3, 3)
        )
        found = distances(one, other, pose[None])[0]
        assert abs(found - wanted) <= 1e-6
        n_apart += found > 0
        back = np.linalg.inv(pose)[None]
        assert abs(distances(other, one, np.ascontiguousarray(back))[0] - found) <= 1e-13
        assert distances(one, other, pose[None], found / 2)[0] == found / 2
        assert distances(one, other, pose[None], -1.0)[0] == -1
    assert 5 < n_apart < 40


def test_larger_bodies_are_as_far_as_their_parts():
    rng = np.random.default_rng(1)
    one, other = soup(rng, 60), soup(rng, 50) * 0.2
    poses = np.stack([rigid(rng, 3.0) for _ in range(20)])
    parts = [
        distances(a, b, poses)
        for a in np.split(one, 4)  # 15 triangles each
        for b in np.split(other, 5)
    ]
    assert np.abs(distances(one, other, poses) - np.min(parts, axis=0)).max() <= 1e-13


def box_at(*centre, size=(0.1, 0.1, 0.1)):
    return rc.shapes.box(size, 1, centre)


def test_a_box_beside_the_arm_is_as_far_as_it_is(arm):
    """At rest the head's face is at y = 0.343: arm, elbow and wrist have offsets along y."""
    still = arm.rest
    top = arm.mesh.bounds[1]
    for gap in (0.3, 0.02, 1e-6):
        scene = box_at(0, top[1] + gap + 0.05, 1.0, size=(5, 0.1, 5))
        found = rc.Collisions(arm, [scene]).clearance(still)[0]
        own = rc.Collisions(arm).clearance(still)[0]
        assert abs(found - min(gap, own)) <= 1e-12
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
    found = free.clearance(joints, 0.01)
    assert found.tolist() == [0.01, 0]
    assert free.clearance(joints, 0.01).tobytes() == found.tobytes()


def test_wrong_arguments_are_refused(arm):
    with pytest.raises(ConfigError, match="links of the robot, got 'hand'"):
        rc.Collisions(arm, allowed=[("hand", "head")])
    with pytest.raises(ConfigError, match="most to be above 0"):
        rc.Collisions(arm).clearance(arm.rest, 0)
