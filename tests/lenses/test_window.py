"""Windows of ideal planes: few sides, and nothing that the image shows is left out."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lens_cases import (
    HEIGHT,
    WIDTH,
    heights,
    make_lens,
    of_all_kinds,
    on_planes,
    rays_of_image,
)
from nightly import examples

from rastercov import Camera
from rastercov.base.errors import CameraError
from rastercov.camera.lenses.areas import record_of
from rastercov.camera.lenses.of_camera import lens_of, planes_of
from rastercov.camera.lenses.quadrature import edge_table

LENSES = of_all_kinds()


def records(lens):
    """Planes of a lens and their records."""
    width, height = lens.width, lens.height
    return [(plane, record_of(plane, width, height, edge_table(plane))) for plane in lens.planes]


def check(lens):
    """Rays of all parts of the image, its border among them, against the windows; their number."""
    rays, n = rays_of_image(lens), 0
    for (plane, points), (_, record) in zip(on_planes(lens, rays), records(lens), strict=True):
        assert (heights(record.window, plane.region) > -1e-12).all()
        assert (heights(points, record.window) >= -1e-12).all()
        n += len(points)
    assert n >= len(rays) - 4  # corners of a region may be on its border
    return n


@pytest.mark.slow
@pytest.mark.parametrize("name", ["opencv brown", "opencv prism", "kalibr ds", "colmap FOV"])
def test_all_that_the_image_shows_is_in_the_window(name):
    assert check(LENSES[name]) > 8000
    assert max(len(record.window) for _, record in records(LENSES[name])) <= 8


def test_a_region_inside_the_image_is_its_own_window():
    lens = make_lens("pinhole", WIDTH, HEIGHT, fx=900, fy=900, max_angle_deg=20)
    ((plane, record),) = records(lens)
    assert not lens.is_whole
    np.testing.assert_array_equal(record.window, plane.region)


def test_a_region_that_ends_in_the_image_keeps_its_sides_there():
    lens = make_lens("pinhole", WIDTH, HEIGHT, fx=900, fy=900, max_angle_deg=38)
    ((plane, record),) = records(lens)
    assert 8 < len(record.window) < len(plane.region)
    check(lens)
    # The corners that are left out are beyond the image.
    kept = {tuple(corner) for corner in record.window}
    for one, other in pairwise(plane.region):
        middle = np.append((one + other) / 2, 1.0) @ plane.frame.T
        if tuple(one) not in kept or tuple(other) not in kept:
            u, v = lens.project(0.999 * middle * (1, 1, 1 / 0.999))
            assert not (0 < u < WIDTH and 0 < v < HEIGHT)


WIDE = {
    "fisheye": ("opencv_fisheye", 1280, 1024, 600, (0.03, -0.012, 0.004, -0.001)),
    "low fisheye": ("opencv_fisheye", 1280, 512, 450, (0.03, -0.012, 0.004, -0.001)),
    "beyond 90 degrees": ("opencv_fisheye", 640, 512, 200, ()),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", WIDE)
def test_pinholes_of_a_wide_lens_hold_what_the_image_shows(name):
    model, width, height, focal, distortion = WIDE[name]
    camera = Camera(
        width=width, height=height, fx=focal, fy=focal, model=model, distortion=distortion
    )
    lens, whole, seen, sizes = lens_of(camera), 0, 0, []
    rays, planes = rays_of_image(lens), planes_of(camera)
    for (_, points), (plane, record) in zip(on_planes(lens, rays), planes, strict=True):
        whole += len(points)
        pinhole = plane.camera
        sizes.append(pinhole.width * pinhole.height)
        if len(record.window) == 0:
            assert len(points) == 0
            continue
        pixels = points * (pinhole.fx, pinhole.fy) + (pinhole.cx, pinhole.cy)
        assert (heights(points, record.window) >= -1e-12).all()
        assert ((pixels >= 0) & (pixels <= (pinhole.width, pinhole.height))).all()
        seen += len(points)
    assert seen == whole > 0.9 * len(rays)
    if name == "fisheye":
        # The front is needed as a whole, the side planes up to where the image ends.
        assert sum(sizes[1:3]) < 0.8 * sizes[0]
    if name == "low fisheye":
        assert [len(record.window) for _, record in planes_of(camera)][3:] == [0, 0]


@pytest.mark.slow
@examples(8, at_night=20)
@given(
    k1=st.floats(-0.4, 0.4),
    k2=st.floats(-0.1, 0.2),
    p1=st.floats(-0.02, 0.02),
    focal=st.floats(500, 2000),
    cx=st.floats(0.2, 0.8),
)
def test_windows_of_random_lenses(k1, k2, p1, focal, cx):
    try:
        lens = make_lens(
            "pinhole", 640, 480, fx=focal / 2, fy=focal / 2, cx=640 * cx, cy=200,
            radial=(k1, k2), tangential=(p1, 0.0),
        )  # fmt: skip
    except CameraError:
        return
    check(lens)
