"""Pixels of the models against OpenCV and COLMAP, which share no code with ours."""

import lens_cases
import numpy as np
import pytest
from lens_cases import BROWN, COLMAP, KANNALA, PRISM, RATIONAL, TILTED, K, rays
from lens_oracles import colmap_pixels, opencv_fisheye_pixels, opencv_pixels

N = 4000
TOLERANCE_PX = 2e-12


@pytest.mark.parametrize(
    "distortion", [(), BROWN[:4], BROWN, RATIONAL, PRISM, TILTED], ids=lambda d: str(len(d))
)
def test_pixels_are_those_of_opencv(distortion):
    lens = lens_cases.opencv(K, distortion)
    given = rays(N, least_z=np.cos(np.arctan(0.8)))
    ours = lens.project(given)
    assert np.abs(ours - opencv_pixels(K, distortion, given)).max() <= TOLERANCE_PX


def test_pixels_are_those_of_opencv_fisheye():
    matrix = K * [[0.5, 1, 1], [1, 0.5, 1], [1, 1, 1]]
    lens = lens_cases.opencv(matrix, KANNALA, fisheye=True)
    given = rays(N, least_z=0.2)
    theirs = opencv_fisheye_pixels(matrix, KANNALA, given)
    assert np.abs(lens.project(given) - theirs).max() <= TOLERANCE_PX


@pytest.mark.slow
@pytest.mark.parametrize("model", COLMAP)
def test_pixels_are_those_of_colmap(model):
    lens = lens_cases.colmap(model)
    given = rays(3 * N, least_z=-0.9)
    ours, theirs = lens.project(given), colmap_pixels(model, given)
    both = np.isfinite(ours).all(axis=1) & np.isfinite(theirs).all(axis=1)
    # COLMAP's fisheyes end at the image plane; the narrowest lens here sees a tenth of the sphere.
    assert both.sum() > N / 4
    assert np.abs(ours - theirs)[both].max() <= TOLERANCE_PX
    # COLMAP answers wherever we do, except behind the image plane.
    front = np.isfinite(ours).all(axis=1) & (given[:, 2] > 0)
    assert np.isfinite(theirs[front]).all(axis=1).mean() > 0.999
