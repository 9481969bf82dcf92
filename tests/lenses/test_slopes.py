"""Bounds of second and third derivatives: never below differences, and not far above them."""

import numpy as np
import pytest
from lens_cameras import CAMERAS
from lens_cases import heights, pixels_of_plane, rays_of_plane

from rastercov import Camera
from rastercov.core.camera.lenses.of_camera import lens_of, planes_of
from rastercov.engine.lens_field import CELLS, bounds_within, sizes_within

pytestmark = pytest.mark.native
STEP = 2e-3


def differences(plane, points):
    """(2, N) second and third derivatives, the greatest of some directions, px."""
    most = np.zeros((2, len(points)))
    for angle in np.linspace(0, np.pi, 9):
        d = STEP * np.array([np.cos(angle), np.sin(angle)])
        far, near, here, back, behind = (
            pixels_of_plane(plane, points + k * d) for k in (2, 1, 0, -1, -2)
        )
        second = (near + back - 2 * here) / STEP**2
        third = (far - 2 * near + 2 * back - behind) / (2 * STEP**3)
        most = np.fmax(most, [np.hypot(*second.T), np.hypot(*third.T)])
    return most


@pytest.mark.slow
@pytest.mark.parametrize("name", CAMERAS)
def test_no_difference_is_above_its_bound(name):
    camera, rng = CAMERAS[name], np.random.default_rng(2)
    lens, ratios = lens_of(camera), []
    for proved in planes_of(camera):
        plane, slopes = proved.record, proved.slopes
        low, high = plane.region.min(axis=0), plane.region.max(axis=0)
        points = rng.uniform(low, high, (600, 2))
        # Differences around a point must stay in the region, and away from a pole.
        around = points[:, None] + 3 * STEP * np.array([(1, 1), (1, -1), (-1, 1), (-1, -1)])
        is_in = (heights(around, plane.region) >= 0).all(axis=1)
        is_in &= np.isfinite(lens.project(rays_of_plane(plane, around))).all(axis=(1, 2))
        is_in &= (np.hypot(*points.T) > 0.1) | (not plane.is_graded)
        points = points[is_in]
        if not len(points):
            continue
        t = np.array([bounds_within(slopes, x, x, y, y)[0] for x, y in points]).T
        true = differences(plane, points)
        # Differences themselves are off by rounding and by their step.
        slack = 1e-2 * true + np.array([[1e-5], [1e-1]]) + np.array([[0.01], [0.02]]) * t
        assert (true <= t + slack).all()
        ratios.append(np.median(t[0] / np.maximum(true[0], 1e-3)))
    assert ratios
    assert min(ratios) < 100


def test_a_lens_without_distortion_has_no_second_derivative():
    camera = Camera(width=640, height=480, fx=500, fy=500, skew=2)
    slopes = planes_of(camera)[0].slopes
    assert not slopes.second.any()
    assert not slopes.third.any()


@pytest.mark.parametrize("name", CAMERAS)
def test_determinants_are_in_the_range_of_their_cells(name):
    camera, rng = CAMERAS[name], np.random.default_rng(4)
    for proved in planes_of(camera):
        plane, slopes = proved.record, proved.slopes
        low, high = plane.region.min(axis=0), plane.region.max(axis=0)
        points = rng.uniform(low, high, (400, 2))
        jacobian = lens_of(camera).jacobian(rays_of_plane(plane, points)) @ plane.frame[:, :2]
        is_in = np.isfinite(jacobian).all(axis=(1, 2))
        sizes = np.abs(np.linalg.det(jacobian[is_in]))
        result = [sizes_within(slopes, x, x, y, y) for x, y in points[is_in]]
        least, most = np.array(result).reshape(-1, 2).T
        assert (least <= sizes * (1 + 1e-12)).all()
        assert (most >= sizes * (1 - 1e-12)).all()
    if name == "brown":
        middle = slopes.sizes[:, CELLS // 2, CELLS // 2]
        assert middle[1] < 1.2 * middle[0]
