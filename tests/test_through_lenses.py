"""Projection, aim and bounds of images through any lens: what the pinhole has, and laws for all."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lens_cameras import CAMERAS, SIDE
from nightly import examples

from rastercov import Camera, CameraError, ConfigError
from rastercov.core.camera.camera import border_of
from rastercov.core.camera.lenses.of_camera import lens_of
from rastercov.core.camera.models import MODELS
from rastercov.core.camera.projection import rays_of, to_camera, to_image, view_border
from rastercov.core.camera.viewpoints import (
    WIDEST_DEG,
    enclosing_distance,
    half_angles,
    sphere_of_poses,
)
from rastercov.core.mesh import shapes
from rastercov.reference import polygons, rational, samples
from rastercov.reference.coverage import depth_from_near

PINHOLE = Camera(width=640, height=480, fx=500, fy=510, cx=300, cy=222.25)
ZERO = replace(PINHOLE, max_angle_deg=85)
"""A pinhole that is computed as a lens."""
FOLDING = Camera(**SIDE, fx=900, fy=900, model="opencv", distortion=(-0.35, 0, 0, 0))
every_lens = pytest.mark.parametrize("lens", [*CAMERAS])
seeds = st.integers(0, 2**32 - 1)


def is_in_image(camera, points):
    pixels = to_image(points, camera)
    return ((pixels >= 0) & (pixels <= (camera.width, camera.height))).all(axis=-1)


@pytest.fixture
def rng():
    return np.random.default_rng(11)


def test_without_distortion_all_is_as_through_the_pinhole(rng):
    points = rng.uniform((-1, -1, 0.5), (1, 1, 4), (200, 3))
    in_view = points[is_in_image(PINHOLE, points)]
    assert len(in_view) > 20
    np.testing.assert_allclose(to_image(in_view, ZERO), to_image(in_view, PINHOLE), atol=1e-9)
    assert half_angles(ZERO) == pytest.approx(half_angles(PINHOLE), rel=1e-12)
    border = view_border(ZERO, 5)
    np.testing.assert_allclose(border, view_border(PINHOLE, 5), atol=1e-12)
    np.testing.assert_array_equal(depth_from_near(points, ZERO), points[:, 2])


@pytest.mark.slow
@every_lens
@examples(5, at_night=15)
@given(seed=seeds)
def test_all_of_the_pyramid_of_half_angles_is_in_the_image(lens, seed):
    camera, rng = CAMERAS[lens], np.random.default_rng(seed)
    across, down = half_angles(camera)
    sides = rng.uniform(-1, 1, (400, 2))
    sides[:100] /= np.abs(sides[:100]).max(axis=1, keepdims=True)  # on its surface
    rays = np.column_stack((sides * (across, down), np.ones(400)))
    assert is_in_image(camera, rays * (1 - 1e-9, 1 - 1e-9, 1)).all()


@every_lens
def test_the_pyramid_of_half_angles_is_the_widest(lens):
    camera, t = CAMERAS[lens], half_angles(CAMERAS[lens])
    widest = math.tan(math.radians(WIDEST_DEG))
    for axis, borders in ((0, (1, 3)), (1, (0, 2))):
        if t[axis] == widest and not MODELS[camera.model].is_planar:
            continue
        rays = rays_of(border_of(camera.width, camera.height, 4001)[list(borders)], camera)
        tangents = np.abs(rays[..., axis] / rays[..., 2])
        assert tangents.min() == pytest.approx(t[axis], rel=1e-6)


def test_a_lens_that_ends_within_its_image_is_aimed_within_its_region():
    lens = lens_of(FOLDING)
    assert not lens.is_whole
    across, down = half_angles(FOLDING)
    assert math.hypot(across, down) <= math.tan(lens.valid_angle)
    corners = np.array([(x * across, y * down, 1) for x in (-1, 1) for y in (-1, 1)])
    assert np.isfinite(to_image(corners * (1 - 1e-9, 1 - 1e-9, 1), FOLDING)).all()


@pytest.mark.parametrize("model", ["opencv", "opencv_fisheye"])
def test_a_lens_whose_axis_is_outside_its_image_cannot_be_aimed(model):
    camera = replace(PINHOLE, cx=-20.0, model=model, distortion=(0.01, 0, 0, 0))
    with pytest.raises(
        ConfigError,
        match=r"expected the optical axis inside the image of 640 x 480 px, got \(-20, 222\.25\)",
    ):
        half_angles(camera)


@every_lens
def test_a_sphere_of_poses_sees_all_of_the_mesh(lens):
    mesh, camera = shapes.torus(8, 6), CAMERAS[lens]
    centre = mesh.bounds.mean(axis=0)
    _, distance = enclosing_distance(mesh, camera, centre)
    for pose in sphere_of_poses(centre, distance * (1 + 1e-9), 4):
        assert is_in_image(camera, to_camera(mesh.vertices, pose)).all()


@every_lens
def test_the_border_of_a_view_is_that_of_the_image(lens):
    camera = CAMERAS[lens]
    rays = view_border(camera, 6)
    assert rays.shape == (24, 3)
    if MODELS[camera.model].is_planar:
        assert rays[:, 2] == pytest.approx(1.0)
    if lens == "equirectangular":
        assert rays[:, 1] == pytest.approx(0.0)  # the horizon
        return
    pixels = to_image(rays * (1 - 1e-12), camera)
    expected = border_of(camera.width, camera.height, 7)[:, :-1].reshape(-1, 2)
    np.testing.assert_allclose(pixels, expected, atol=1e-6)


def test_the_border_of_a_view_ends_with_the_region_of_the_lens():
    rays = view_border(FOLDING, 6)
    away = np.arccos(rays[:, 2] / np.linalg.norm(rays, axis=1))
    limit = lens_of(FOLDING).valid_angle
    assert away.max() == pytest.approx(limit)
    assert away.min() < 0.99 * limit


@pytest.mark.slow
def test_wide_lenses_have_a_cube_of_near_planes():
    points = np.array([(0.1, 0.2, -3.0), (-2.0, 0.1, 0.5)])
    assert depth_from_near(points, CAMERAS["wide fisheye"]).tolist() == [3.0, 2.0]
    assert depth_from_near(points, CAMERAS["brown"]).tolist() == [-3.0, 0.5]


@pytest.mark.parametrize("camera", [ZERO, FOLDING, replace(PINHOLE, skew=1e-9)])
def test_what_wants_a_pinhole_names_itself(camera):
    mesh, pose = shapes.torus(8, 6), np.eye(4)
    for function in (polygons.visible_area, rational.visible_area, samples.render):
        with pytest.raises(
            CameraError, match=r"expected a pinhole for a reference, got .*(rational|undistort)"
        ):
            function(mesh, camera, pose)
