"""Windows of ideal planes: few sides, and nothing that the image shows is left out."""

from itertools import pairwise

import numpy as np
import pytest
from lens_cases import (
    HEIGHT,
    WIDTH,
    heights,
    make_lens,
    of_all_kinds,
    on_planes,
    rays_of_image,
)

from rastercov import Camera
from rastercov.core.camera.lenses.of_camera import planes_of

LENSES = of_all_kinds()


def records(lens):
    """Planes of a lens."""
    return [each.record for each in lens.proved]


def check(lens):
    """Rays of all parts of the image, its border among them, against the windows; their number."""
    rays, n = rays_of_image(lens), 0
    for (plane, points), record in zip(on_planes(lens, rays), records(lens), strict=True):
        assert (heights(record.window, plane.region) > -1e-12).all()
        assert (heights(points, record.window) >= -1e-12).all()
        n += len(points)
    assert n >= len(rays) - 4  # corners of a region may be on its border
    return n


@pytest.mark.slow
@pytest.mark.parametrize("name", ["opencv brown", "opencv prism", "kalibr ds", "colmap FOV"])
def test_all_that_the_image_shows_is_in_the_window(name):
    assert check(LENSES[name]) > 8000
    assert max(len(record.window) for record in records(LENSES[name])) <= 8


def test_a_region_inside_the_image_is_its_own_window():
    lens = make_lens("pinhole", WIDTH, HEIGHT, fx=900, fy=900, max_angle_deg=20)
    (record,) = records(lens)
    assert not lens.is_whole
    np.testing.assert_array_equal(record.window, record.region)


def test_a_region_that_ends_in_the_image_keeps_its_sides_there():
    lens = make_lens("pinhole", WIDTH, HEIGHT, fx=900, fy=900, max_angle_deg=38)
    (record,) = records(lens)
    assert 8 < len(record.window) < len(record.region)
    check(lens)
    # The sides that are left out are beyond the image.
    for one, other in pairwise(record.region):
        middle = np.append((one + other) / 2, 1.0) @ record.frame.T
        if heights(middle[None, :2], record.window)[0] < -1e-9:
            u, v = lens.project(0.999 * middle * (1, 1, 1 / 0.999))
            assert not (0 < u < WIDTH and 0 < v < HEIGHT)


def test_side_planes_reach_as_far_as_the_image():
    low, high = (
        planes_of(Camera(width=1280, height=height, fx=focal, fy=focal, model="opencv_fisheye"))
        for height, focal in ((512, 450), (1024, 600))
    )
    assert [len(each.record.window) for each in low][3:] == [0, 0]  # it shows nothing of these
    sizes = [each.camera.width * each.camera.height for each in high]
    assert sum(sizes[1:3]) < 0.8 * sizes[0]  # the front is needed as a whole
