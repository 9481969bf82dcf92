"""Union of regions over cameras: against Clipper2, and by the laws of sets."""

from dataclasses import replace

import numpy as np
import pytest
from exact_views import SEEDS, soup
from hypothesis import example, given
from nightly import examples
from scenes import square
from surface_cases import building, hostile_scene, in_regions, off_clipper2, room

import rastercov as rc
from rastercov.base.errors import ConfigError
from rastercov.core.area.polygons import frames_of, to_plane
from rastercov.core.area.union import RegionUnion
from rastercov.reference.regions import points_on

pytestmark = pytest.mark.native

TASK = rc.Task(max_incidence_deg=75, min_pixels_per_m2=2000)
CAMERA = rc.Camera(width=200, height=200, fx=100, fy=100)


@pytest.mark.slow
@given(seed=SEEDS)
@examples(7, at_night=20)
def test_the_union_of_hostile_scenes_agrees_with_clipper2(seed):
    rng = np.random.default_rng(seed)
    mesh = soup(rng, n=30) if seed % 2 else hostile_scene(seed)[0]
    centre, size = mesh.bounds.mean(axis=0), np.linalg.norm(np.ptp(mesh.bounds, axis=0))
    eyes = centre + rng.normal(size=(6, 3)) * size * 10 ** rng.uniform(-1, 0.5, (6, 1))
    poses = rc.look_at(eyes=eyes, targets=centre)
    regions = rc.regions(mesh, CAMERA, poses, rc.Task(max_incidence_deg=80))
    off = off_clipper2(regions, rc.unite(regions).area[0])
    assert off.max() <= 1e-8 * mesh.areas.max()


def test_poses_added_one_by_one_cover_as_much_as_all_at_once():
    mesh, camera, poses = building()
    union = RegionUnion(mesh, 2)
    before = 0.0
    for pose in poses:
        union.add(rc.regions(mesh, camera, pose[None], TASK))
        share = union.covered().share()
        assert share >= before - 1e-12
        before = share
    at_once = rc.unite(rc.regions(mesh, camera, poses, TASK), 2)
    is_covered = union.covered()
    assert np.abs(is_covered.area - at_once.area).max() <= 1e-9 * mesh.areas.max()
    # Slivers aside, the bound is that of the same regions.
    assert np.allclose(is_covered.bound, at_once.bound, rtol=1e-3, atol=1e-9 * mesh.areas.max())


def test_a_face_that_k_cameras_cover_as_a_whole_is_closed():
    wall = square(0.5, 2)
    poses = np.repeat(np.eye(4)[None], 5, axis=0)
    poses[:, 0, 3] = np.linspace(-0.3, 0.3, 5)
    union = RegionUnion(wall, 3)
    for row in range(5):
        union.add(rc.regions(wall, CAMERA, poses[row : row + 1]))
        assert union.closed.all() == (row >= 2)
    covered = union.covered()
    assert len(covered) == 2
    assert np.allclose(covered.area, wall.areas, rtol=1e-12)
    assert covered.share(3) == pytest.approx(1, rel=1e-12)


@pytest.mark.slow
def test_what_is_whole_for_one_camera_and_a_part_for_another_is_counted():
    wall = square(0.5, 2)
    part = rc.regions(wall, CAMERA, np.eye(4), rc.Task(max_incidence_deg=10))
    whole = rc.regions(wall, CAMERA, np.eye(4))
    for order in ([part, whole], [whole, part]):
        covered = rc.unite(order, 2)
        assert np.allclose(covered.area[0], wall.areas, rtol=1e-12)
        assert covered.area[1].sum() == pytest.approx(part.area.sum(), rel=1e-9)


@pytest.mark.slow
def test_pieces_of_a_partition_do_not_overlap_and_know_their_views():
    mesh, camera, poses = room()
    regions = rc.regions(mesh, camera, poses, TASK)
    covered = rc.unite(regions, 6)
    points, face = points_on(mesh, 5000)
    views = sum(in_regions(regions, row, points, face).astype(int) for row in range(6))
    xy = to_plane(mesh, face, points)
    values, times = np.zeros(len(points), int), np.zeros(len(points), int)
    for piece in range(len(covered)):
        rows = np.flatnonzero(face == covered.face[piece])
        polygon = covered.xy[covered.starts[piece] : covered.starts[piece + 1]]
        sides = np.roll(polygon, -1, axis=0) - polygon
        away = xy[rows, None] - polygon
        inside = (sides[:, 0] * away[..., 1] - sides[:, 1] * away[..., 0] >= 0).all(axis=1)
        values[rows[inside]] = covered.views[piece]
        times[rows[inside]] += 1
    assert times.max() == 1
    assert np.array_equal(values, views)


@pytest.mark.slow
@given(seed=SEEDS)
@example(seed=8287)  # a needle with a short side along a long one: 1.3e-5 too much
@examples(8, at_night=25)
def test_hostile_scenes_keep_the_laws_of_sets(seed):
    rng = np.random.default_rng(seed)
    mesh, camera, pose = hostile_scene(seed)
    centre, size = mesh.bounds.mean(axis=0), np.linalg.norm(np.ptp(mesh.bounds, axis=0))
    poses = [pose]
    for _ in range(5):
        eye = centre + rng.normal(size=3) * size * 10.0 ** rng.uniform(-1, 0.5)
        poses.append(rc.look_at(eyes=[eye], targets=[centre + rng.normal(size=3) * size * 0.1])[0])
    camera = rc.Camera(width=320, height=240, fx=200, fy=200)
    regions = rc.regions(mesh, camera, poses, rc.Task(max_incidence_deg=85))
    one, all_views = rc.unite(regions), rc.unite(regions, 6)
    other_way = rc.unite(rc.regions(mesh, camera, poses[::-1], rc.Task(max_incidence_deg=85)), 2)
    # 1e-9 of a face may miss of a whole one, and what is that near to an edge of a needle.
    longest = frames_of(mesh).corners[:, 1, 0]
    slack = 3e-9 * mesh.areas + 1e-11 * longest**2
    assert (one.area[0] <= mesh.areas + slack).all()
    assert (np.abs(one.area[0] - all_views.area[0]) <= slack).all()
    assert (np.abs(other_way.area - all_views.area[:2]) <= slack).all()
    total = np.bincount(regions.pair_face, regions.area, minlength=mesh.n_faces)
    assert (np.abs(all_views.area.sum(axis=0) - total) <= 6 * slack).all()


def test_several_cameras_cover_what_each_does_and_more_views_no_more():
    mesh, camera, poses = room()
    cameras = camera, replace(camera, fx=400, fy=400)
    parts = [rc.regions(mesh, each, poses[:3], TASK) for each in cameras]
    both = rc.unite(parts, 6)
    assert (np.diff(both.area, axis=0) <= 1e-12).all()
    assert 0 < both.share(6) < both.share(2) < both.share(1)
    for part in parts:
        assert (both.area[0] >= rc.unite(part).area[0] - 1e-9).all()


def test_no_cameras_cover_nothing():
    mesh, camera, _ = room()
    covered = rc.unite(rc.regions(mesh, camera, np.empty((0, 4, 4))), 2)
    assert len(covered) == 0
    assert covered.share() == 0
    assert covered.area.shape == (2, mesh.n_faces)


def test_regions_of_another_mesh_and_no_regions_are_refused():
    mesh, camera, poses = room()
    other = rc.regions(square(1, 2), CAMERA, np.eye(4))
    with pytest.raises(ConfigError, match="got two of 48 and 2 faces"):
        rc.unite([rc.regions(mesh, camera, poses), other])
    with pytest.raises(ConfigError, match="got none"):
        rc.unite([])
    with pytest.raises(ConfigError, match=r"views from 1 to .*; give a whole number"):
        rc.unite(other, 0)
    with pytest.raises(ConfigError, match=r"views of 1, got 2"):
        rc.unite(other).share(2)
