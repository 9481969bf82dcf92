"""Moving bodies through cameras with parallel rays, frame by frame and point by point."""

import numpy as np
import pytest
from exact_views import SEEDS
from hypothesis import given
from nightly import examples
from scenes import joined as joined_meshes
from surface_cases import in_regions, moved, points_on
from timed import regions_over_time

import rastercov as rc
from rastercov.motion.regions import ViewKeys
from rastercov.reference.regions import covers_points

PART = rc.shapes.icosahedron()
TASK = rc.Task(max_incidence_deg=75)
LENS = {"magnification": 60 * 2e-5, "pixel_size": 2e-5}
CAMERAS = {
    "plain": rc.Camera.orthographic(200, 180, px_per_m=60),
    "near": rc.Camera.orthographic(200, 180, px_per_m=60, near=4.2, focus_range=(4.0, 6.0)),
    "distorted": rc.Camera.telecentric(200, 180, **LENS, distortion=(900.0,)),
    "skewed": rc.Camera.telecentric(200, 180, **LENS, skew=12.0),
}


def scene(occluder):
    """A part, and a body that only hides it."""
    mesh = joined_meshes(PART, occluder)
    labels = np.repeat([0, 1], [PART.n_faces, occluder.n_faces])
    groups = [rc.Group("part"), rc.Group("body", is_occluder=True)]
    return rc.Mesh(mesh.vertices, mesh.faces, groups, labels)


def random_motion(rng, frames=12):
    """Frames in which the body is anywhere, turned at random, and the part is turned."""
    poses, turns = np.tile(np.eye(4), (2, frames, 1, 1))
    for each in poses:
        q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        each[:3, :3] = q * np.sign(np.linalg.det(q))
        each[:3, 3] = rng.normal(size=3) * 2.5
    if rng.integers(2):
        turns = rc.turntable(frames, axis=rng.normal(size=3))
    return {"body": poses, "part": turns}


def views(rng, count=2):
    away = rng.normal(size=(count, 3))
    return rc.look_at(5 * away / np.linalg.norm(away, axis=1, keepdims=True), (0, 0, 0))


@pytest.mark.parametrize("name", CAMERAS)
@given(seed=SEEDS)
@examples(3, at_night=40)
def test_each_frame_holds_the_points_that_are_covered_then(name, seed):
    rng = np.random.default_rng(seed)
    motion = rc.Motion(scene(rc.shapes.torus(8, 6)), random_motion(rng, 4))
    camera, poses = CAMERAS[name], views(rng)
    regions = regions_over_time(motion, camera, poses, TASK, threads=1)
    points, face = points_on(motion.mesh, 400, seed % 1000)
    own = motion.mesh.task_mask[face]
    points, face = points[own], face[own]
    for row in range(len(motion)):
        mesh, places = moved(motion, row, points, face)
        truth = covers_points(mesh, camera, poses, TASK, places, face)
        for k in range(len(poses)):
            at = row * len(poses) + k
            wrong = int((in_regions(regions, at, points, face) != truth[k]).sum())
            expected = regions.bounds()[at].sum() / motion.mesh.areas.sum() * 400
            assert wrong <= 2 + expected + 6 * np.sqrt(expected)


@given(seed=SEEDS)
@examples(5, at_night=60)
def test_frames_of_equal_keys_have_equal_areas(seed):
    """The body is often beside the part along the rays, where the key leaves it out."""
    rng = np.random.default_rng(seed)
    camera, pose = CAMERAS["plain"], views(rng, 1)
    # Before the part, where an eye 5 m away would see many of them beside it.
    bodies = np.tile(np.eye(4), (12, 1, 1))
    away = np.column_stack((rng.normal(size=(12, 2)), rng.uniform(1, 3.5, 12)))
    bodies[:, :3, 3] = pose[0, :3, 3] + away @ pose[0, :3, :3].T
    motion = rc.Motion(scene(rc.shapes.box((0.7, 0.5, 0.6))), {"body": bodies})
    placed = rc.Poses.of(pose)
    sights, near = ViewKeys(motion), np.zeros(1)
    keys = [sights.of(row, placed, near, pose[:, :3, 2])[0] for row in range(len(motion))]
    first = {}
    for row, key in enumerate(keys):
        areas = rc.regions(moved(motion, row)[0], camera, pose, TASK).areas()[0, : PART.n_faces]
        assert np.allclose(first.setdefault(key, areas), areas, atol=1e-8)


def test_a_body_beside_the_rays_is_left_out_of_the_key_and_one_before_them_is_not():
    mesh = scene(rc.shapes.box((0.4, 0.4, 0.4)))
    poses = np.tile(np.eye(4), (4, 1, 1))
    # An eye at (0, 0, 5) would see the first two behind the part, and the others beside it.
    poses[:, :3, 3] = [(1.6, 0, -3), (1.6, 0.1, -3.1), (0.8, 0, 3), (0.8, 0.1, 3.1)]
    motion = rc.Motion(mesh, {"body": poses})
    above = rc.look_at(eyes=[(0, 0, 5)], targets=(0, 0, 0), up=(0, 1, 0))
    placed, near = rc.Poses.of(above), np.full(1, 1e-9)
    sights = ViewKeys(motion)
    keys = [sights.of(row, placed, near, above[:, :3, 2])[0] for row in range(4)]
    assert keys[0] == keys[1]
    assert len(set(keys)) == 3


@pytest.mark.parametrize("name", CAMERAS)
def test_a_part_on_a_turntable_is_a_camera_that_is_turned(name):
    mesh, steps = rc.shapes.by_name("torus"), 6
    size = mesh.diagonal
    table = rc.turntable(steps, axis=(0.2, 0.1, 1))
    pose = rc.look_at((1.1 * size, 0.7 * size, 0.5 * size), (0, 0, 0))
    motion = rc.Motion(mesh, {"mesh": table})
    result = rc.evaluate(mesh, CAMERAS[name], pose, TASK, motion=motion)
    turned = rc.regions(mesh, CAMERAS[name], np.linalg.inv(table) @ pose, TASK)
    expected = turned.at_least(1, one_side=False).area.sum()
    assert result.over_time.share() == pytest.approx(expected / mesh.areas.sum(), abs=1e-6)
    assert result.over_time.dead_zones()["dead_zones"]
    assert result.over_time.lines()


@pytest.mark.parametrize("name", CAMERAS)
def test_a_camera_on_a_body_moves_with_it(name):
    mesh = scene(rc.shapes.box((0.7, 0.5, 0.6)).moved(translation=(0.5, 0, 2)))
    table = rc.turntable(5, axis=(0.2, 1, 0))
    motion = rc.Motion(mesh, {"part": table, "body": table})
    above = rc.look_at(eyes=[(0.2, 0.1, 5)], targets=(0, 0, 0), up=(0, 1, 0))
    areas = regions_over_time(motion, CAMERAS[name], above, TASK, body="part").areas()
    assert areas[0].sum() > 0
    assert np.abs(areas - areas[0]).max() <= 1e-7 * mesh.areas.sum()
