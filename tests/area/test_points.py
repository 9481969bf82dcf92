"""Points of a surface, and pixels of its pictures, that poses cover."""

import numpy as np
import pytest
from exact_views import SEEDS
from hypothesis import given, settings
from surface_cases import hostile_scene, in_regions, room

import rastercov as rc
from rastercov.coverage.area.points import covering_poses
from rastercov.reference.regions import points_on

TASK = rc.Task(max_incidence_deg=75)


def assert_as_in_pieces(mesh, camera, poses, task, n):
    poses = poses.reshape(-1, 4, 4)
    regions = rc.regions(mesh, camera, poses, task)
    points, face = points_on(mesh, n, 0)
    found = covering_poses(regions, face, points)
    assert found.shape == (len(points), len(poses))
    for row in range(len(poses)):
        # One is compared with a slack, the other is not.
        assert (found[:, row] != in_regions(regions, row, points, face)).sum() <= 2
    return found


def test_poses_cover_the_points_in_their_pieces():
    found = assert_as_in_pieces(*room(), TASK, 5000)
    assert found.any(axis=0).all()
    assert not found.all(axis=0).any()


@pytest.mark.slow
@given(seed=SEEDS)
@settings(max_examples=15)
def test_poses_cover_the_points_in_their_pieces_of_hostile_scenes(seed):
    assert_as_in_pieces(*hostile_scene(seed), rc.Task(), 500)


def test_no_points_and_no_poses_are_no_error():
    mesh, camera, poses = room()
    regions = rc.regions(mesh, camera, poses[:0], TASK)
    assert covering_poses(regions, [0], mesh.vertices[mesh.faces[:1, 0]]).shape == (1, 0)
    regions = rc.regions(mesh, camera, poses, TASK)
    assert covering_poses(regions, [], np.empty((0, 3))).shape == (0, len(poses))
