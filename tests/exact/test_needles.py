"""Needles whose corners lie on a line but for rounding: what they hide is in all bounds."""

import numpy as np
import pytest
from exact_views import SEEDS
from hypothesis import given
from nightly import examples

import rastercov as rc
from rastercov.core.raster.contract import BoundKind
from rastercov.reference import rational


def across(rng):
    """A face behind needles that pass close before the camera, which sees them many times larger.

    Rounding decides the place of the middle corner. The camera is the origin, or far away.
    """
    n = int(rng.integers(1, 4))
    depth, length = 10.0 ** rng.uniform(-3, 0, (n, 1)), 10.0 ** rng.uniform(-1, 2, (n, 1))
    way = rng.normal(size=(n, 3)) * (1, 1, 0.01)
    way /= np.linalg.norm(way, axis=1)[:, None]
    middle = depth * (rng.uniform(-0.2, 0.2, (n, 3)) + np.array((0, 0, 1)))
    start, end = (middle + sign * way * length * rng.random((n, 1)) for sign in (-1, 1))
    needles = np.stack([start, start + rng.random((n, 1)) * (end - start), end], axis=1)
    wall = np.array([(-9, -9, 5), (0, 9, 5), (9, -9, 5.0)])
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, rng.normal(size=3) * rng.choice((0.0, 1.0, 1e3))
    points = np.concatenate([wall, needles.reshape(-1, 3)]) @ turn.T + pose[:3, 3]
    camera = rc.Camera(width=1280, height=960, fx=rng.uniform(300, 3000), fy=800)
    return rc.Mesh(points, np.arange(3 * n + 3).reshape(-1, 3)), camera, pose


@pytest.mark.parametrize("method", ["certified", "exact"])
@given(seed=SEEDS)
@examples(40)
def test_needles_that_rounding_makes_flat_are_in_every_bound(method, seed):
    mesh, camera, pose = across(np.random.default_rng(seed))
    with rc.open_observer(mesh, camera, method, threads=1) as observer:
        seen = observer.observe(pose[None])
    visible, area = (of(mesh, camera, pose) for of in (rational.visible_area, rational.image_area))
    both = np.abs(seen.visible_pixels[0] - visible) + np.abs(seen.drawn_pixels[0] - area)
    computed = seen.kind[0] == BoundKind.EXACT
    assert (both <= seen.area_error[0])[computed].all()
    whole = np.where(seen.visible_pixels[0] > 0, area, 0.0)
    assert (np.abs(visible - whole) <= 1e-12)[~computed].all()
