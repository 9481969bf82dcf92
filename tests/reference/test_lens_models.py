"""Models through lenses: those that measure in the image take any, the others say why not."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lens_cameras import CAMERAS
from nightly import examples
from scenes import joined, square

from rastercov import Camera, CameraError, Mesh, Task
from rastercov.core.camera.lenses.of_camera import lens_of
from rastercov.core.camera.viewpoints import sphere_of_poses
from rastercov.core.mesh import shapes
from rastercov.reference.models import MODELS
from rastercov.reference.models.base import facing_density, focus_depth
from rastercov.reference.models.line_of_sight import LineOfSight
from rastercov.reference.models.report import compare_models

PINHOLE = Camera(width=400, height=300, fx=200, fy=200)
ZERO = replace(PINHOLE, max_angle_deg=85)
"""A pinhole that is computed as a lens."""
ANY_LENS = [name for name, model in MODELS.items() if not model.pinhole_because]
AHEAD = np.eye(4)[None]
FISHEYE = CAMERAS["wide fisheye"]


@pytest.fixture
def rng():
    return np.random.default_rng(11)


@pytest.mark.parametrize("name", sorted(set(MODELS) - set(ANY_LENS)))
def test_the_others_refuse_in_one_line_with_the_reason(name):
    mesh, because = shapes.torus(8, 6), MODELS[name].pinhole_because
    with pytest.raises(CameraError) as caught:
        MODELS[name](mesh, ZERO, AHEAD)
    assert str(caught.value) == (
        f"expected a pinhole for model {name}, because {because}, got a lens of model pinhole; use "
        "image_space, scott or mavrinac"
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", ANY_LENS)
@examples(5, at_night=15)
@given(seed=st.integers(0, 10**9))
def test_without_distortion_coverage_is_that_of_the_pinhole(name, seed):
    rng = np.random.default_rng(seed)
    corners = rng.uniform((-2, -1.5, 2), (2, 1.5, 6), (12, 1, 3)) + rng.normal(0, 0.5, (12, 3, 3))
    mesh = Mesh(vertices=corners.reshape(-1, 3), faces=np.arange(36).reshape(-1, 3))
    task = Task(min_pixels=200.0)
    items = [MODELS[name](mesh, camera, AHEAD, task) for camera in (PINHOLE, ZERO)]
    np.testing.assert_allclose(items[1], items[0], atol=1e-9)


@pytest.mark.parametrize("lens", CAMERAS)
def test_facing_density_is_the_least_singular_value(lens, rng):
    camera = CAMERAS[lens]
    pixels = rng.uniform((5, 5), (camera.width - 5, camera.height - 5), (50, 2))
    points = 3.0 * lens_of(camera).unproject(pixels)
    slopes = lens_of(camera).jacobian(points)
    expected = np.linalg.svd(slopes, compute_uv=False)[:, 1]
    np.testing.assert_allclose(facing_density(points, camera), expected, rtol=1e-9)


def test_facing_density_of_a_pinhole_is_the_focal_length_by_the_depth(rng):
    points = rng.uniform((-1, -1, 1), (1, 1, 5), (50, 3))
    np.testing.assert_allclose(facing_density(points, PINHOLE), 200 / points[:, 2])
    np.testing.assert_allclose(facing_density(points, ZERO), 200 / points[:, 2])
    assert facing_density(np.array([(0.0, 0, -1)]), PINHOLE).tolist() == [0.0]


def test_lenses_without_a_plane_in_focus_are_in_focus_by_distance():
    point = np.array([(3.0, 0.0, 4.0)])
    assert focus_depth(point, ZERO).tolist() == [4.0]
    assert focus_depth(point, FISHEYE).tolist() == [5.0]


def test_what_is_behind_a_wide_lens_is_hidden_by_what_is_nearer():
    scene = joined(square(0.5, -1.0), square(0.3, -2.0), square(3.0, -3.0))
    expected = np.repeat([False, True, False], 4)
    hidden = LineOfSight(scene).find_hidden(scene.vertices, np.eye(4), 1e-3, FISHEYE)
    assert (hidden == expected).all()
    # To a pinhole all of it is behind the near plane, which hides nothing.
    assert not LineOfSight(scene).find_hidden(scene.vertices, np.eye(4), 1e-3, ZERO).any()


def test_a_wide_lens_covers_all_around_it_and_hides_what_is_behind_something():
    room = shapes.room(2)
    pose = np.eye(4)
    pose[:3, 3] = (0.1, 0.2, 2.0)
    panorama = CAMERAS["equirectangular"]
    task = Task(min_pixels=1e-9)
    graded = MODELS["mavrinac"](room, panorama, pose[None], task)[0]
    ours = MODELS["image_space"](room, panorama, pose[None], task)[0]
    assert (graded[ours > 0.999] > 0).mean() > 0.95
    assert (ours[graded == 0] == 0).mean() > 0.95
    assert 0.2 < (graded > 0).mean() < 1


def test_a_comparison_leaves_out_models_that_want_pinholes():
    mesh = shapes.torus(10, 8)
    poses = sphere_of_poses((0, 0, 0), 4.0, 2)
    result = compare_models(mesh, ZERO, poses)
    assert [score.name for score in result.models] == ["scott", "mavrinac", "image_space"]
