"""Laws of every lens: rays and pixels are inverse, and all arithmetics have one result."""

import math

import lens_cases
import numpy as np
import pytest
from lens_cases import HEIGHT, WIDTH, make_lens, of_all_kinds, pixels

from rastercov.base.errors import CameraError
from rastercov.reference.lenses import project

LENSES = of_all_kinds()


@pytest.fixture(params=LENSES)
def lens(request):
    return LENSES[request.param]


@pytest.mark.slow
def test_pixel_to_ray_and_back(lens):
    given = pixels(4000)
    rays = lens.unproject(given)
    assert np.isfinite(rays).all()
    assert lens.is_whole
    assert np.abs(np.linalg.norm(rays, axis=1) - 1).max() < 1e-15
    assert np.abs(lens.project(rays) - given).max() < 1e-9
    again = lens.unproject(lens.project(rays))
    assert np.abs(again - rays).max() <= 1e-11


def test_length_of_a_ray_does_not_matter(lens):
    rays = lens.unproject(pixels(50))
    scale = np.geomspace(1e-6, 1e9, 50)[:, None]
    assert np.abs(lens.project(scale * rays) - lens.project(rays)).max() < 1e-9


def test_jacobian_is_the_derivative(lens):
    rays = lens.unproject(pixels(200, margin=5.0))
    step, error = 1e-4, []
    for i in range(3):
        d = step * np.eye(3)[i]
        far = lens.project(rays + 2 * d) - lens.project(rays - 2 * d)
        near = lens.project(rays + d) - lens.project(rays - d)
        slope = (8 * near - far) / (12 * step)  # to the fourth power of the step
        error.append(np.abs(slope - lens.jacobian(rays)[:, :, i]))
    scale = np.abs(lens.jacobian(rays)).max()
    assert np.nanmax(error) < 1e-6 * scale
    # A pixel does not move along its ray.
    along = np.einsum("nij,nj->ni", lens.jacobian(rays), rays)
    assert np.abs(along).max() < 1e-12 * scale


def test_jacobian_on_the_axis(lens):
    if not np.isfinite(lens.project([0.0, 0.0, 1.0])).all():
        pytest.skip("its axis is beyond the valid region")
    at_axis = lens.jacobian([0.0, 0.0, 1.0])
    beside = lens.jacobian([1e-9, -1e-9, 1.0])
    assert np.abs(at_axis - beside).max() < 1e-5 * np.abs(at_axis).max()


def test_arrays_and_compiled_scalars_agree(lens):
    rays = lens.unproject(pixels(1000))
    u, v = project(lens.code, lens.params, *rays.T)
    assert np.abs(np.column_stack((u, v)) - lens.project(rays)).max() < 1e-9


def test_shapes_are_kept(lens):
    rays = lens.unproject(pixels(6).reshape(2, 3, 2))
    assert rays.shape == (2, 3, 3)
    assert lens.project(rays).shape == (2, 3, 2)
    assert lens.jacobian(rays).shape == (2, 3, 2, 3)
    assert lens.project(rays[0, 0]).shape == (2,)
    assert lens.project(np.empty((0, 3))).shape == (0, 2)


def test_rays_that_are_none_have_no_pixel(lens):
    bad = [[math.nan, 0, 1], [0, 0, 0], [math.inf, 0, 1], [0, math.nan, 0]]
    assert np.isnan(lens.project(bad)).all()
    assert np.isnan(lens.jacobian(bad)).all()
    assert np.isnan(lens.unproject([[math.nan, 3], [math.inf, 3]])).all()


PLAIN = {"width": WIDTH, "height": HEIGHT, "fx": 900, "fy": 900}


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (
            lambda: make_lens("pinhole", **PLAIN, max_angle_deg=1e-14),
            r"expected a lens that is valid to 1e-12 rad from the axis, got 1\.74532925e-16;",
        ),
        (
            lambda: make_lens("pinhole", **PLAIN, tangential=(1e12, 0)),
            "expected distortion that is one-to-one near the axis, got a fold",
        ),
        (
            lambda: make_lens("pinhole", **PLAIN, prism=(1e12, 1, 1, 1)),
            "expected distortion that is one-to-one near the axis, got a fold",
        ),
        (
            lambda: lens_cases.lens("equirectangular", max_angle_deg=90),
            "expected no max_angle_deg for an equirectangular image, got 90",
        ),
        (
            lambda: LENSES["opencv brown"].project([1, 2]),
            r"expected rays of shape \(\.\.\., 3\), got \(",
        ),
        (lambda: LENSES["opencv brown"].unproject(["a", "b"]), "pixels to be real numbers"),
        (
            lambda: LENSES["opencv brown"].project(3.0),
            r"expected rays of shape \(\.\.\., 3\), got \(",
        ),
    ],
)
def test_what_is_no_lens_is_refused_in_one_line(call, words):
    with pytest.raises(CameraError, match=words) as caught:
        call()
    assert "\n" not in str(caught.value)
