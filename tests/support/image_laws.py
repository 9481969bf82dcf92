"""Images and counts beside those of the reference, up to samples where either face may win.

The device rounds corners to 1/256 px, so a sample within 1/128 px of a projected edge may fall to
either side, and where two surfaces are within 1e-4 of each other in depth either may win. Such
samples are called ambiguous here; everywhere else the laws hold without exception.
"""

from functools import lru_cache

import numpy as np
import pytest

from rastercov.reference import samples

EDGE, GAP = 1 / 128, 1e-4
FEW = 0.005
"""Most of an image that may differ at ambiguous samples; they are 1 % of these scenes or less."""
shown_by_two = pytest.mark.parametrize("open_raster", ["pipeline", "cpu"], indirect=True)
"""For laws of images: those of all plans equal the reference's, and so each other's."""


@lru_cache(maxsize=64)
def _view(mesh, camera, pose):
    return samples.render(mesh, camera, np.frombuffer(pose).reshape(4, 4))


def reference_view(mesh, camera, pose):
    """The image by the reference: kept, for it costs far more than the images held against it."""
    return _view(mesh, camera, np.asarray(pose, np.float64).tobytes())


def is_ambiguous(view):
    return (view.edge_distance <= EDGE) | (view.depth_gap <= GAP)


def ambiguous(mesh, camera, pose):
    return is_ambiguous(reference_view(mesh, camera, pose))


def assert_same_image(result, expected, mesh, camera, pose):
    """Two images of face indices are equal except at a few ambiguous samples."""
    rows, columns = np.nonzero(result != expected)
    if not rows.size:
        return
    points = np.stack((columns, rows), axis=-1) + 0.5
    wrong = ~is_ambiguous(samples.at_points(mesh, camera, pose, points))
    assert not wrong.any(), (
        f"{wrong.sum()} of {rows.size} differing samples are not ambiguous, the first at row "
        f"{rows[wrong][0]}, column {columns[wrong][0]}"
    )
    assert rows.size <= FEW * result.size, f"{rows.size} of {result.size} samples differ"


def assert_same_counts(result, expected):
    for name in ("visible", "drawn", "background", "clipped"):
        np.testing.assert_array_equal(getattr(result, name), getattr(expected, name), err_msg=name)


def everything(rasterizer, poses):
    """All counts with and without `drawn`, and all images, as named arrays."""
    both, alone = rasterizer.count(poses), rasterizer.count(poses, drawn=False)
    images = [rasterizer.render(pose) for pose in poses]
    assert alone.drawn is None
    np.testing.assert_array_equal(alone.visible, both.visible)
    return {
        "visible": both.visible,
        "drawn": both.drawn,
        "background": both.background,
        "clipped": both.clipped,
        "face": np.array([image.face for image in images]),
        "depth": np.array([image.depth for image in images]),
    }


def assert_same(result, expected):
    for name, values in expected.items():
        np.testing.assert_array_equal(result[name], values, err_msg=name)
