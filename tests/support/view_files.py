"""Samples of camera files and the pixels that their views give, for the tests of formats."""

import numpy as np

from rastercov.camera.lenses.of_camera import lens_of
from rastercov.camera.pose import inverse


def pixels_of(views, points):
    """(P, N, 2) pixels of world points (N, 3) in each pose of views."""
    lenses = [lens_of(camera) for camera in views.cameras()]
    out = []
    for pose, row in zip(inverse(views.poses.world_from_camera), views.poses.camera, strict=True):
        out.append(lenses[row].project(points @ pose[:3, :3].T + pose[:3, 3]))
    return np.array(out)


def same_pixels(one, other, points):
    """Assert that two views give the same pixels of these points, and that some are seen."""
    a, b = pixels_of(one, points), pixels_of(other, points)
    both = np.isfinite(a).all(axis=-1) & np.isfinite(b).all(axis=-1)
    # At the border of the valid region one may end earlier; inside the image none does.
    sizes = np.array([(c.width, c.height) for c in one.cameras()])[one.poses.camera][:, None]
    inside = np.isfinite(a).all(axis=-1) & (a >= 0).all(axis=-1) & (a <= sizes).all(axis=-1)
    assert inside.any()
    assert both[inside].all()
    np.testing.assert_allclose(a[inside], b[inside], rtol=0, atol=1e-6)


def some_points(rng, n=60):
    """Points around the origin, for cameras some metres away."""
    return rng.uniform(-1, 1, (n, 3))
