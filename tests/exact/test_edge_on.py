"""Cameras in the plane of a face, to rounding: no figure claims more than arithmetic knows."""

import numpy as np
import pytest
from exact_views import SEEDS, exact_sides
from hypothesis import assume, example, given
from nightly import examples
from scenes import square
from visible_fractions import fractions_of, visibility

import rastercov as rc
from rastercov.core.mesh import shapes
from rastercov.core.raster.contract import BoundKind
from rastercov.reference import rational

METHODS = ("certified", "exact")


def hostile_mesh(rng):
    """Faces of any size, at any distance from the origin; some are needles."""
    corners = rng.normal(size=(int(rng.integers(1, 5)), 3, 3)) * 10.0 ** rng.uniform(-10, 3)
    if rng.random() < 0.4:
        thin = 10.0 ** rng.uniform(-14, -1)
        corners[:, 2] = corners[:, 1] + (corners[:, 2] - corners[:, 1]) * thin
    if rng.random() < 0.4:
        corners += rng.normal(size=3) * 10.0 ** rng.uniform(0, 8)
    return rc.Mesh(
        vertices=corners.reshape(-1, 3), faces=np.arange(corners.size // 3).reshape(-1, 3)
    )


def hostile_camera(rng, **lens):
    width, height = (int(side) for side in rng.integers(64, 1500, 2))
    focal = width * 10 ** rng.uniform(-0.6, 0.8)
    return rc.Camera(width=width, height=height, fx=focal, fy=focal * rng.uniform(0.8, 1.2), **lens)


def hostile_pose(rng, mesh, camera):
    """In the plane of a face to a part of 1e-16 to 1e-9, or with a corner at the image border."""
    corners = mesh.vertices[mesh.faces[rng.integers(mesh.n_faces)]]
    away = rng.normal(size=2) * 10.0 ** rng.uniform(-1, 3)
    eye = corners[0] + away @ (corners[1:] - corners[0])
    if rng.random() < 0.7:
        eye += rng.normal(size=3) * 10.0 ** rng.uniform(-17, -8) * np.linalg.norm(eye - corners[0])
    if rng.random() < 0.3:
        eye = corners[0] + rng.normal(size=3) * 10.0 ** rng.uniform(-1, 9) * np.ptp(corners)
    target = corners.mean(axis=0)
    if np.linalg.norm(target - eye) <= 1e-12 * np.linalg.norm(target):
        eye = target + np.ptp(corners, axis=0).max()
    assume((eye != target).any())
    pose = rc.look_at(eye, target, rng.normal(size=3))[0]
    if rng.random() < 0.4:
        x, _, z = (corners[rng.integers(3)] - eye) @ pose[:3, :3]
        half = np.arctan2(camera.cx, camera.fx) * rng.choice((-1, 1))
        angle = np.arctan2(x, z) + half + rng.normal() * rng.choice((0, 1e-15, 1e-12))
        c, s = np.cos(angle), np.sin(angle)
        pose[:3, :3] = pose[:3, :3] @ np.array([(c, 0, s), (0, 1, 0), (-s, 0, c)])
    return pose


@pytest.mark.slow
@given(seed=SEEDS)
@examples(5)
@example(seed=112)  # seen from the front by 9e-6 px^2, and was "from behind"
def test_no_visible_fraction_breaks_its_bound_in_the_plane_of_a_face(seed):
    rng = np.random.default_rng(seed)
    mesh, camera = hostile_mesh(rng), hostile_camera(rng)
    poses = np.array([hostile_pose(rng, mesh, camera) for _ in range(3)])
    for method in METHODS:
        with rc.open_observer(mesh, camera, method, threads=1) as observer:
            seen, fractions = observer.observe(poses), fractions_of(observer, poses)
        for row, pose in enumerate(poses):
            visible, area = (
                of(mesh, camera, pose) for of in (rational.visible_area, rational.image_area)
            )
            side = exact_sides(mesh, pose)
            is_known = (side <= 0) | (area > 0)
            true = np.where(side > 0, visible / np.where(area > 0, area, 1), 0.0)
            off = np.abs(fractions.visibility[row] - true)[is_known]
            assert (off <= fractions.visibility_bound[row][is_known]).all()
            both = np.abs(seen.visible_pixels[row] - visible)
            both += np.abs(seen.drawn_pixels[row] - area)
            computed = seen.kind[row] == BoundKind.EXACT
            assert (both <= seen.area_error[row])[computed].all()
            assert (seen.drawn_pixels[row] + seen.area_error[row] == 0)[side == 0].all()
            assert (fractions.visibility_bound[row] == 0)[side == 0].all()


def beside(distance):
    """A pose that sees a square of a metre in z = 0 from its plane, `distance` m before it."""
    return rc.look_at((-3.0, 0.1, distance), (0.0, 0.0, 0.0))[0]


EDGE_ON = rc.Camera(width=640, height=480, fx=500, fy=500)
LENSES = (
    EDGE_ON,
    rc.Camera(
        width=640, height=480, fx=500, fy=500, model="opencv", distortion=(0.1, 0.01, 0.0, 0.0)
    ),
)


@pytest.mark.parametrize("method", [*METHODS, "sampled:cpu"])
@pytest.mark.parametrize("camera", LENSES, ids=("pinhole", "lens"))
@pytest.mark.parametrize("distance", [0.0, 1e-17, -1e-17])
def test_the_side_of_a_face_in_whose_plane_the_camera_is_decides_exactly(method, camera, distance):
    pose = beside(distance)
    observation = visibility(square(0.5, 0.0), camera, pose[None], method)
    is_before = exact_sides(square(0.5, 0.0), pose) > 0
    assert is_before.all() == (distance < 0)
    assert (observation.visibility_bound[0] == is_before).all()
    assert (observation.visibility == 0).all() or is_before.all()


@pytest.mark.parametrize("method", [*METHODS, "sampled:cpu"])
@pytest.mark.parametrize("camera", LENSES, ids=("pinhole", "lens"))
def test_a_face_that_is_a_little_off_the_plane_of_the_camera_is_known(method, camera):
    poses = np.array([beside(-1e-3), beside(1e-3)])
    observation = visibility(square(0.5, 0.0), camera, poses, method)
    assert observation.visibility_bound[1].max() == 0  # from behind, by definition not seen
    if method in METHODS:
        assert observation.visibility_bound[0].max() < 1e-6
        assert observation.visibility[0].min() == 1


def test_faces_that_are_certainly_outside_the_image_stay_known():
    mesh = shapes.torus()
    aside = rc.look_at((8.0, 0.0, 0.5), (8.0, 9.0, 0.5))
    observation = visibility(mesh, EDGE_ON, aside)
    assert (observation.visibility_bound == 0).all()
    assert (observation.visibility == 0).all()


def test_the_area_of_a_face_too_thin_for_the_plane_of_a_lens_has_a_bound():
    rng = np.random.default_rng(0)
    camera = rc.Camera(
        width=640, height=480, fx=500, fy=500, model="opencv", distortion=(1e-12, 0.0, 0.0, 0.0)
    )
    pinhole = rc.Camera(width=640, height=480, fx=500, fy=500)
    corners = rng.normal(size=(200, 3, 3)) * 1e-9 + rng.uniform(-0.3, 0.3, (200, 1, 3))
    mesh = rc.Mesh(vertices=corners.reshape(-1, 3), faces=np.arange(600).reshape(-1, 3))
    pose = rc.look_at((0, -3, 0), (0, 0, 0))
    true = np.asarray(rational.image_area(mesh, pinhole, pose[0]), float)
    with rc.open_observer(mesh, camera, threads=1) as observer:
        seen = observer.observe(pose)
    assert (np.abs(seen.drawn_pixels[0] - true) <= seen.area_error[0] + 1e-9 * true).all()
