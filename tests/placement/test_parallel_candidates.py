"""Candidates of cameras with parallel rays: working distance, images side by side, angles."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples
from scenes import joined, square

import rastercov as rc
from rastercov.base.errors import ConfigError
from rastercov.core.camera.projection import to_camera, to_image
from rastercov.core.camera.viewpoints import enclosing_distance
from rastercov.core.mesh import Mesh, shapes
from rastercov.placement import Framing, Objective, openings, per_segment, segment
from rastercov.placement.candidates.mounting import on_sphere
from rastercov.placement.uncovered import in_front
from rastercov.survey.patterns import Survey, facade, strips

LENS = {"magnification": 0.02, "pixel_size": 5e-6, "working_distance": 0.3, "depth_of_field": 0.1}
CAMERA = rc.Camera.telecentric(400, 300, **LENS)  # 100 x 75 mm
VIEW = rc.Camera.orthographic(400, 300, px_per_m=4000)


@given(seed=st.integers(0, 10**6))
@examples(5)
def test_images_side_by_side_hold_every_point_of_a_segment(seed):
    rng = np.random.default_rng(seed)
    size = rng.uniform(0.01, 0.5, 3)
    mesh = shapes.box(size)
    turn = rc.look_at(rng.normal(size=3), np.zeros(3))[0]
    mesh = Mesh(mesh.vertices @ turn[:3, :3].T + turn[:3, 3], mesh.faces)
    segments = segment(mesh, 15, 25)
    assert segments.n_segments == 6
    framing = Framing(rolls_deg=(0.0, float(rng.uniform(0, 90))))
    result = per_segment(mesh, CAMERA, framing, segmentation=segments)
    weights = rng.dirichlet(np.ones(3), 200)
    for label in range(6):
        poses = result.poses[result.index == label]
        corners = mesh.vertices[mesh.faces[segments.labels == label]]
        points = (weights @ corners).reshape(-1, 3)
        pixels = np.array([to_image(to_camera(points, pose), CAMERA) for pose in poses])
        inside = ((pixels >= -1e-6) & (pixels <= np.add((400, 300), 1e-6))).all(axis=2)
        for roll in range(2):  # either roll alone
            same = np.abs(poses[:, :3, 0] @ poses[(0, -1)[roll], :3, 0]) > 1 - 1e-12
            assert inside[same].any(axis=0).all()
        depth = np.array([to_camera(points, pose)[:, 2] for pose in poses])
        assert depth == pytest.approx(0.3)


def test_a_square_larger_than_the_image_gets_the_fewest_images():
    mesh = square(0.145, 0)
    segments = per_segment(mesh, CAMERA, segmentation=segment(mesh, 15, 25))
    assert len(segments) == 3 * 4
    assert len(per_segment(mesh, VIEW, segmentation=segment(mesh, 15, 25))) == 3 * 4
    with pytest.raises(ConfigError, match="expected at most 1,000,000 views"):
        per_segment(square(1e4, 0), CAMERA, segmentation=segment(square(1e4, 0), 15, 25))


def test_no_image_is_made_where_a_segment_has_no_face():
    mesh = joined(square(0.025, 0), square(0.025, 0, (1, 1)))
    segments = per_segment(mesh, CAMERA, segmentation=segment(mesh, 15, 25))
    assert 2 <= len(segments) <= 4


def test_depths_of_a_step_lie_around_the_working_distance_of_each_image():
    mesh = joined(square(0.03, 0), square(0.03, 0.04, (0.4, 0)))
    segments = per_segment(mesh, CAMERA, segmentation=segment(mesh, 15, 25))
    z = np.unique(segments.poses[:, 2, 3].round(9))
    assert z == pytest.approx([-0.3, -0.26])  # it faces down


def test_spheres_are_at_the_working_distance_and_outside_of_what_has_none():
    part = shapes.box((0.06, 0.05, 0.04))
    eyes = on_sphere(part, CAMERA, count=5).poses[:, :3, 3]
    assert np.linalg.norm(eyes, axis=1) == pytest.approx(0.3)
    radius, away = enclosing_distance(part, VIEW, np.zeros(3))
    assert away == radius == pytest.approx(np.linalg.norm((0.03, 0.025, 0.02)))
    narrow = Framing(stand_off=(0.31, 0.32))
    assert np.linalg.norm(on_sphere(part, CAMERA, narrow, count=3).poses[:, :3, 3], axis=1) == (
        pytest.approx(0.31)
    )
    with pytest.raises(ConfigError, match="expected a stand-off in the depth of field"):
        on_sphere(part, CAMERA, Framing(stand_off=(0.5, 0.6)), count=3)


@pytest.mark.parametrize("camera", [CAMERA, VIEW])
def test_faces_of_a_cavity_get_views_that_see_them(camera):
    shaft = shapes.box((0.04, 0.04, 0.04))
    inner = Mesh(shaft.vertices, shaft.faces[:, ::-1])
    lid = inner.centroids[:, 2] > 0.019
    pit = Mesh(inner.vertices, inner.faces[~lid])
    floor = np.flatnonzero(pit.centroids[:, 2] < -0.019)
    result = openings(pit, camera, faces=floor)
    assert (result.candidates.index[:, None] == floor).any(axis=0).all()
    seen = rc.evaluate(pit, camera, result.candidates.poses, by="face")
    assert len(result.candidates)
    assert (seen.network.covered[floor]).all()


def test_neighbours_of_a_flight_are_as_far_apart_as_the_image_is_wide():
    ground = square(0.5, 0)
    x = np.unique(strips(ground, VIEW, survey=Survey(height=2.0)).poses[:, 0, 3].round(9))
    assert np.diff(x) == pytest.approx(0.4 * 0.1)
    turned = rc.look_at((1, 0, 0), (0, 0, 0))[0]
    wall = Mesh(ground.vertices @ turned[:3, :3].T, ground.faces[:, ::-1])
    z = np.unique(facade(wall, VIEW, distance=3.0).poses[:, 2, 3].round(9))
    assert np.diff(z).max() <= 0.4 * 0.075 + 1e-9
    with pytest.raises(ConfigError, match="expected height with parallel rays, got gsd"):
        strips(ground, VIEW, survey=Survey(gsd=0.01))


def test_what_hides_a_face_is_found_along_the_rays():
    """A plate above the face hides it from straight above, and one beside it from the eye.

       eye
    ___     ___   plates at z = 1
       ____       face at z = 0
    """
    mesh = joined(square(0.25, 0), square(0.25, 1), square(0.25, 1, (2, 0)))
    mesh = Mesh(
        mesh.vertices, mesh.faces, [rc.Group(name) for name in ("face", "over", "beside")],
        np.arange(6) // 2,
    )  # fmt: skip
    eye, down, faces = np.array([[4.0, 0, 2]]), np.array([[0.0, 0, -1]]), np.array([0])
    assert in_front(mesh, eye, faces)[0].argmax() == 2
    assert in_front(mesh, eye, faces, axes=np.zeros((1, 3)))[0].argmax() == 2
    assert in_front(mesh, eye, faces, axes=down)[0] == pytest.approx([0, 1, 0])
    before = np.array([[4.0, 0, 0.5]])  # the front of the lens is below the plate
    assert not in_front(mesh, before, faces, axes=down).any()


def test_the_angle_between_two_cameras_is_that_of_their_axes():
    mesh, at = square(0.005, 0), np.radians(15)
    eyes = [(0, 0, -0.3), (0.3 * np.sin(at), 0, -0.3 * np.cos(at))]
    poses = rc.look_at(eyes, (0, 0, 0))
    poses[1, :3, 3] += 0.1 * poses[1, :3, 2]  # along the axis nothing changes
    for least, share in ((14.999, 1.0), (15.001, 0.0)):
        task = rc.Task(views=2, min_angle_deg=least)
        with rc.open_observer(mesh, VIEW, "certified") as observer:
            assert Objective.of(observer, task).share_of(poses) == share
