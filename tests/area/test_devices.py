"""Partitions by sets of poses: which of them cover each piece."""

import numpy as np
import pytest
from exact_views import SEEDS
from hypothesis import given
from nightly import examples
from surface_cases import hostile_scene, in_regions, room, turned

import rastercov as rc
from rastercov.base.errors import ConfigError
from rastercov.coverage.area.polygons import polygon_areas
from rastercov.reference.regions import points_on

pytestmark = pytest.mark.native
TASK = rc.Task(max_incidence_deg=75)


def assert_sets(regions, found, points, face, of):
    """Points lie in a piece of exactly the poses of a group that cover them, up to the bound."""
    total, n = regions.mesh.areas.sum(), len(points)
    for row, group in enumerate(np.unique(of[of >= 0])):
        own = np.flatnonzero(of == group)
        sees = np.array([in_regions(regions, pose, points, face) for pose in own])
        wrong = np.zeros(n, bool)
        for device in range(len(own)):
            has = (found.devices >> device & 1).astype(bool) & (found.pose == row)
            part = found._with(np.flatnonzero(has), np.arange(len(found.pair_face)))
            wrong |= in_regions(part, row, points, face) != sees[device]
        e = found.bounds()[row].sum() / total * n
        assert wrong.sum() <= 2 + e + 6 * np.sqrt(e)


def test_pieces_have_the_poses_that_cover_them():
    mesh, camera, poses = room()
    regions = rc.regions(mesh, camera, poses, TASK)
    of = np.array([0, 1, 0, -1, 1, 0])
    found = regions.by_devices(of)
    points, face = points_on(mesh, 6000)
    assert_sets(regions, found, points, face, of)
    assert set(np.unique(found.devices[found.pose == 0])) == {1, 2, 3, 4, 5, 6, 7}
    assert found.pose_ids.tolist() == [0, 1]


@pytest.mark.slow
@examples(10, at_night=30)
@given(seed=SEEDS)
def test_sets_in_hostile_scenes_are_as_by_points(seed):
    mesh, camera, pose = hostile_scene(seed)
    rng = np.random.default_rng(seed)
    poses = np.repeat(pose.reshape(-1, 4, 4)[:1], 4, axis=0)
    size = np.linalg.norm(np.ptp(mesh.bounds, axis=0))
    poses[1:, :3, 3] += rng.normal(size=(3, 3)) * size * 10 ** rng.uniform(-2, 0, (3, 1))
    regions = rc.regions(mesh, camera, poses)
    points, face = points_on(mesh, 400)
    of = np.zeros(4, np.int64)
    assert_sets(regions, regions.by_devices(of), points, face, of)


def test_areas_by_number_of_devices_are_those_of_counts():
    mesh, poses = turned(*[room()[at] for at in (0, 2)])
    regions = rc.regions(mesh, room()[1], poses, TASK)
    found = regions.by_devices()
    number = np.bitwise_count(found.devices.astype(np.uint64))
    areas = polygon_areas(found.xy, found.starts)
    covered = rc.unite(regions, 6)
    for k in range(1, 7):
        assert areas[number >= k].sum() == pytest.approx(covered.area[k - 1].sum(), rel=1e-9)
    for device in range(6):
        own = areas[found.devices >> device & 1 > 0].sum()
        assert own == pytest.approx(regions.areas()[device].sum(), rel=1e-9)
    assert (found.bound <= covered.bound[found.pair_face] * (1 + 1e-6) + 1e-12).all()


def test_parts_without_a_device_that_is_needed_are_left_out():
    mesh, camera, poses = room()
    regions = rc.regions(mesh, camera, poses, TASK)
    every, found = regions.by_devices(), regions.by_devices(needs=[2, 4])
    is_kept = (every.devices >> 2 & 1 > 0) & (every.devices >> 4 & 1 > 0)
    areas = polygon_areas(every.xy, every.starts)[is_kept].sum()
    assert found.area.sum() == pytest.approx(areas, rel=1e-12)
    assert set(found.devices & 20) == {20}
    both = regions.at_least(2, np.array([-1, -1, 0, -1, 0, -1]))
    assert both.area.sum() == pytest.approx(areas, rel=1e-9)


def test_64_devices_have_a_bit_each():
    square = rc.Mesh([(-1, -1, 4), (1, -1, 4), (1, 1, 4), (-1, 1, 4)], [(0, 2, 1), (0, 3, 2)])
    camera = rc.Camera(width=200, height=160, fx=300, fy=300)
    poses = np.repeat(np.eye(4)[None], 65, axis=0)
    poses[:, 0, 3] = np.linspace(0, 0.2, 65)
    regions = rc.regions(square, camera, poses[:64])
    found = regions.by_devices(needs=[63])
    assert set(found.devices.tolist()) >= {-1}
    assert (found.devices < 0).all()
    assert found.area.sum() == pytest.approx(regions.areas()[63].sum(), rel=1e-9)
    with pytest.raises(ConfigError, match="up to 64 poses"):
        rc.regions(square, camera, poses).by_devices()


def test_a_face_that_devices_cover_as_a_whole_is_one_piece():
    square = rc.Mesh([(-1, -1, 4), (1, -1, 4), (1, 1, 4), (-1, 1, 4)], [(0, 2, 1), (0, 3, 2)])
    wide = rc.Camera(width=200, height=160, fx=50, fy=50)
    found = rc.regions(square, wide, np.repeat(np.eye(4)[None], 3, axis=0)).by_devices()
    assert found.devices.tolist() == [7, 7]
    assert found.area.sum() == pytest.approx(4)


@pytest.mark.parametrize(
    ("of", "needs", "text"),
    [([0, 1], (), "whole number for each"), (None, [64], "0 to 63"), (None, "a", "numbers")],
)
def test_groups_and_numbers_that_are_none_are_refused(of, needs, text):
    mesh, camera, poses = room()
    with pytest.raises(ConfigError, match=text):
        rc.regions(mesh, camera, poses[:3]).by_devices(of, needs=needs)
