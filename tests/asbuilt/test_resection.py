"""Poses from pixels of known points: exact starts, errors as the covariance says, and refusals."""

import numpy as np
import pytest

import rastercov as rc
from rastercov.asbuilt import resection

CAMERAS = {
    "pinhole": rc.Camera.from_fov(1280, 960, hfov_deg=60),
    "distorted": rc.Camera(
        width=1280, height=960, fx=900, fy=910, model="opencv", distortion=(-0.2, 0.05, 1e-3, 0)
    ),
    "fisheye": rc.Camera(
        width=1000, height=1000, fx=320, fy=320, model="opencv_fisheye", distortion=(0.01, 0, 0, 0)
    ),
}


def scene(seed: int, camera: rc.Camera, n: int, sigma: float) -> tuple[np.ndarray, ...]:
    """Pose, points in a cube of 2 m around the origin, and their pixels with errors."""
    rng = np.random.default_rng(seed)
    eye = rng.normal(size=3)
    eye *= rng.uniform(2.6, 5) / np.linalg.norm(eye)
    pose = np.asarray(rc.look_at(eye, rng.normal(size=3) * 0.1)[0])
    points = rng.uniform(-0.8, 0.8, (n, 3))
    pixels = resection.pixels_of(points, camera, pose) + rng.normal(size=(n, 2)) * sigma
    return pose, points, pixels


def error_of(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Rotation vector and translation, in camera axes, from a found pose to the true one."""
    turn = resection.rotation_vector(found[:3, :3].T @ true[:3, :3])
    return np.concatenate((turn, found[:3, :3].T @ (true[:3, 3] - found[:3, 3])))


@pytest.mark.parametrize("seed", range(20))
def test_three_points_have_the_true_pose_among_theirs(seed: int) -> None:
    camera = CAMERAS["pinhole"]
    pose, points, pixels = scene(seed, camera, 3, 0)
    rays = np.linalg.inv(pose)[:3, :3] @ (points - pose[:3, 3]).T
    found = resection.p3p(points, (rays / np.linalg.norm(rays, axis=0)).T)
    assert min(np.abs(each - pose).max() for each in found) < 1e-6
    for each in found:  # all of them lie on the rays
        assert np.nanmax(np.abs(resection.pixels_of(points, camera, each) - pixels)) < 1e-4


@pytest.mark.parametrize("kind", CAMERAS)
def test_errors_are_those_that_the_covariance_says(kind: str) -> None:
    camera, distances = CAMERAS[kind], []
    for seed in range(40):
        pose, points, pixels = scene(seed, camera, 8, 1.0)
        starts = resection.starts_of(points, pixels, camera, None, 1.0)
        best = resection.fit(points, pixels, camera, starts, 1.0)[0]
        error = error_of(best.pose, pose)
        distances.append(error @ np.linalg.solve(best.covariance, error))
    # Chi-squared of six degrees: median 5.35, 95 % below 12.59; errors by chance of 40 scenes.
    assert 3.5 < np.median(distances) < 7.5
    assert 34 <= np.sum(np.array(distances) < 12.59) <= 40


def test_wrong_pairs_are_found(  # each by itself, and both
) -> None:
    camera = CAMERAS["pinhole"]
    for seed in range(15):
        _, points, pixels = scene(seed, camera, 10, 1.0)
        wrong = np.zeros(10, bool)
        wrong[[seed % 10, (3 * seed + 1) % 10]] = True
        pixels[wrong] += np.random.default_rng(seed).choice((-60, 60), (int(wrong.sum()), 2))
        starts = resection.starts_of(points, pixels, camera, None, 1.0)
        best = resection.fit(points, pixels, camera, starts, 1.0)[0]
        assert not best.is_inlier[wrong].any()
        assert best.is_inlier.sum() >= 7


def located(camera: rc.Camera, pairs: np.ndarray, near: np.ndarray | None = None) -> rc.Located:
    """Pose by points."""
    grey = np.ones((camera.height, camera.width))
    return rc.locate(rc.shapes.box((2, 2, 2)), camera, grey, near, pairs)


def test_points_that_do_not_fix_a_pose_are_refused() -> None:
    camera = CAMERAS["pinhole"]
    pose, points, _ = scene(3, camera, 8, 0)
    line = points[0] + np.linspace(0, 1, 8)[:, None] * (points[1] - points[0])
    for bad in (line, points[0] + 1e-3 * (points - points[0])):
        pixels = resection.pixels_of(bad, camera, pose)
        pixels += np.random.default_rng(0).normal(size=pixels.shape)
        found = located(camera, np.column_stack((pixels, bad)), pose)
        assert not found.accepted
        assert "line" in found.why or "explain" in found.why


def test_a_plane_seen_from_afar_has_two_poses() -> None:
    camera = rc.Camera.from_fov(1280, 960, hfov_deg=0.8)
    square = 0.1 * np.array(((-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)))
    pose = np.asarray(rc.look_at((100, 25, 150), (0, 0, 0))[0])
    pixels = resection.pixels_of(square, camera, pose)
    found = located(
        camera,
        np.column_stack((pixels + 0.3 * np.random.default_rng(0).normal(size=(4, 2)), square)),
    )
    assert not found.accepted
    assert len(found.poses) >= 2
    assert "explain the points as well" in found.why


def test_parallel_rays_leave_the_distance_open() -> None:
    camera = rc.Camera.telecentric(640, 480, magnification=0.01, pixel_size=5e-6)
    pose = np.asarray(rc.look_at((0.1, 0.2, 1.0), (0, 0, 0))[0])
    rng = np.random.default_rng(1)
    points = rng.uniform(-0.1, 0.1, (9, 3))
    pixels = resection.pixels_of(points, camera, pose)
    start = resection.displaced(pose, np.array((0.01, -0.01, 0.02, 2e-3, 1e-3, 0)))
    found = located(camera, np.column_stack((pixels, points)), start)
    assert found.accepted, found.why
    error = error_of(found.pose, pose)
    assert np.abs(error[:5]).max() < 1e-6
    assert np.isinf(found.covariance[5, 5])
    assert np.isfinite(np.diag(found.covariance)[:5]).all()


def test_pairs_are_checked() -> None:
    camera = CAMERAS["pinhole"]
    _, points, pixels = scene(0, camera, 4, 0)
    pairs = np.column_stack((pixels, points))
    for bad in (pairs[:3], pairs[:, :4], np.where(pairs == pairs[0, 0], np.nan, pairs)):
        with pytest.raises(rc.ConfigError, match="points"):
            located(camera, bad)


def test_the_robust_fit_is_nearly_as_exact_as_its_covariance_says() -> None:
    """Variance of the estimate of a place from normal errors, relative to that of the mean."""
    lengths = np.random.default_rng(0).rayleigh(size=200_000)  # of errors in two coordinates
    limit = resection.HUBER
    bent = np.minimum(lengths, limit)
    slope = np.where(lengths < limit, 1, limit / lengths / 2)
    assert np.mean(bent**2) / 2 / np.mean(slope) ** 2 < 1.025


def test_two_wrong_of_eight_points_are_undecided() -> None:
    """Six that are right leave too little to tell which two are wrong."""
    camera = CAMERAS["pinhole"]
    pose, points, pixels = scene(3, camera, 8, 0.1)
    pixels[5] += (40, -60)
    assert located(camera, np.hstack((pixels, points)), pose).accepted
    pixels[2] += (-50, 30)
    found = located(camera, np.hstack((pixels, points)), pose)
    assert not found.accepted
    assert found.why == "only 6 of 8 points agree with one pose; check 3, 6"
