"""Points of a surface, and pixels of its pictures, that poses cover."""

import numpy as np
import pytest
from exact_views import SEEDS
from hypothesis import given
from nightly import examples
from surface_cases import hostile_scene, in_regions, room

import rastercov as rc
from rastercov.core.area.point_pass import PointPass
from rastercov.core.area.regions import covering_poses
from rastercov.core.camera import Poses
from rastercov.reference.regions import covers_points, points_on
from rastercov.report.overview import covered_pixels, nearest_covering
from rastercov.report.panorama import draw_scene, points_of_pixels

pytestmark = pytest.mark.native

TASK = rc.Task(max_incidence_deg=75)


def assert_as_in_pieces(mesh, camera, poses, task, n):
    poses = poses.reshape(-1, 4, 4)
    regions = rc.regions(mesh, camera, poses, task)
    points, face = points_on(mesh, n, 0)
    result = covering_poses(regions, face, points)
    assert result.shape == (len(points), len(poses))
    for row in range(len(poses)):
        # One is compared with a slack, the other is not.
        assert (result[:, row] != in_regions(regions, row, points, face)).sum() <= 2
    return result


def test_poses_cover_the_points_in_their_pieces():
    assert_as = assert_as_in_pieces(*room(), TASK, 5000)
    assert assert_as.any(axis=0).all()
    assert not assert_as.all(axis=0).any()


@pytest.mark.slow
@given(seed=SEEDS)
@examples(5, at_night=15)
def test_poses_cover_the_points_in_their_pieces_of_hostile_scenes(seed):
    assert_as_in_pieces(*hostile_scene(seed), rc.Task(), 500)


@pytest.mark.parametrize("n", [1, 63, 64, 65, 3000])
def test_the_poses_of_a_point_do_not_depend_on_the_points_before_it(n):
    mesh, camera, poses = room()
    regions = rc.regions(mesh, camera, poses.reshape(-1, 4, 4), TASK)
    points, face = points_on(mesh, n, 1)
    result = covering_poses(regions, face, points)
    for order in (np.argsort(face, kind="stable"), np.random.default_rng(n).permutation(len(face))):
        assert np.array_equal(covering_poses(regions, face[order], points[order]), result[order])
    for row in range(0, len(face), max(1, len(face) // 40)):
        alone = covering_poses(regions, face[row : row + 1], points[row : row + 1])
        assert np.array_equal(alone[0], result[row])


def test_no_points_and_no_poses_are_no_error():
    mesh, camera, poses = room()
    regions = rc.regions(mesh, camera, poses[:0], TASK)
    assert covering_poses(regions, [0], mesh.vertices[mesh.faces[:1, 0]]).shape == (1, 0)
    regions = rc.regions(mesh, camera, poses, TASK)
    assert covering_poses(regions, [], np.empty((0, 3))).shape == (0, len(poses))


@pytest.mark.slow
def test_pixels_show_the_area_that_is_covered_and_the_nearest_pose_is_one_that_covers():
    mesh, camera, poses = room()
    camera = camera.resized(0.25)
    regions, alone = (rc.regions(mesh, camera, some, TASK) for some in (poses, poses[:1]))
    with rc.open_rasterizer(mesh, camera, "cpu") as rasterizer:
        scene = draw_scene(mesh, camera, poses[0], rasterizer.render(poses[0]))
    face = scene.face
    rows, columns = np.nonzero(face >= 0)
    faces = face[rows, columns]
    points = points_of_pixels(mesh, camera, poses[0], faces, rows, columns)
    covers = covering_poses(regions, faces, points)
    best = nearest_covering(regions, poses[:, :3, 3], faces, points)
    assert np.array_equal(best >= 0, covers.any(axis=1))
    assert covers[np.arange(len(best)), best][best >= 0].all()
    shown = covered_pixels(alone, scene, face)
    assert not shown[face < 0].any()
    assert 0.1 < shown[rows, columns].mean() < 1
    assert shown[rows, columns].mean() == pytest.approx(covers[:, 0].mean(), abs=1e-3)


def stack(seed):
    """Boxes and sheets on a coarse grid, many of whose faces coincide, in any order; and an eye."""
    rng = np.random.default_rng(seed)
    parts = []
    for _ in range(rng.integers(2, 6)):
        low, size = rng.integers(0, 4, 3) / 4, rng.integers(1, 5, 3) / 4
        box = rc.shapes.box(tuple(size), centre=tuple(low + size / 2))
        side = (box.normals == rng.permutation(np.eye(3))[0]).all(axis=1)
        faces = box.faces[side] if rng.random() < 0.3 else box.faces
        parts.append(rc.Mesh(box.vertices, faces if rng.random() < 0.5 else faces[:, ::-1]))
    mesh = rc.Mesh.joined(parts)
    way = rng.normal(size=3)
    eye = (0.5, 0.5, 0.5) + way / np.linalg.norm(way) * rng.uniform(2, 4)
    return rc.Mesh(mesh.vertices, rng.permutation(mesh.faces)), rc.look_at(eye, (0.5, 0.5, 0.5))


@examples(15, at_night=400)
@given(seed=SEEDS)
def test_of_faces_that_coincide_points_of_the_first_are_seen(seed):
    """Nothing hid the others, so advice promised to cover a sheet that lies on another."""
    mesh, poses = stack(seed)
    points, face = points_on(mesh, 1500, seed)
    camera, poses = rc.Camera.from_fov(640, 480, hfov_deg=60), poses.reshape(-1, 4, 4)
    judge = PointPass(mesh, camera, TASK, points, face)
    expected = covers_points(mesh, camera, poses, TASK, points, face)
    np.testing.assert_array_equal(judge.covers(Poses.of(poses))[0], expected.reshape(-1))
