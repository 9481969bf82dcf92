"""Pixels of the models against OpenCV and COLMAP, which share no code with ours."""

import lens_cases
import numpy as np
import pytest
from lens_cases import BROWN, COLMAP, HEIGHT, KANNALA, PRISM, RATIONAL, TILTED, WIDTH, K, rays
from lens_oracles import colmap_camera, colmap_pixels, opencv_fisheye_pixels, opencv_pixels

from rastercov.camera.models import PROGRAMS

N = 4000
TOLERANCE_PX = 2e-12


@pytest.fixture(scope="module")
def cv2():
    return pytest.importorskip("cv2", reason="no OpenCV here: pip install opencv-python-headless")


@pytest.fixture(scope="module")
def pycolmap():
    return pytest.importorskip("pycolmap", reason="no COLMAP here: pip install pycolmap")


@pytest.mark.parametrize(
    "distortion", [(), BROWN[:4], BROWN, RATIONAL, PRISM, TILTED], ids=lambda d: str(len(d))
)
def test_pixels_are_those_of_opencv(cv2, distortion):
    lens = lens_cases.opencv(K, distortion)
    given = rays(N, least_z=np.cos(np.arctan(0.8)))
    ours = lens.project(given)
    assert np.abs(ours - opencv_pixels(K, distortion, given)).max() <= TOLERANCE_PX


def test_pixels_are_those_of_opencv_fisheye(cv2):
    matrix = K * [[0.5, 1, 1], [1, 0.5, 1], [1, 1, 1]]
    lens = lens_cases.opencv(matrix, KANNALA, fisheye=True)
    given = rays(N, least_z=0.2)
    theirs = opencv_fisheye_pixels(matrix, KANNALA, given)
    assert np.abs(lens.project(given) - theirs).max() <= TOLERANCE_PX


@pytest.mark.slow
@pytest.mark.parametrize("model", COLMAP)
def test_pixels_are_those_of_colmap(pycolmap, model):
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


def test_every_model_of_colmap_is_known(pycolmap):
    theirs = set(pycolmap.CameraModelId.__members__) - {"INVALID"}
    assert theirs <= set(PROGRAMS["colmap"])


@pytest.mark.parametrize("model", ["FULL_OPENCV", "OPENCV_FISHEYE", "FOV", "EUCM", "DIVISION"])
def test_rays_are_those_of_colmap(pycolmap, model):
    lens = lens_cases.colmap(model)
    camera = colmap_camera(model)
    given = np.random.default_rng(2).uniform((0, 0), (WIDTH, HEIGHT), (500, 2))
    ours = lens.unproject(given)
    is_front = ours[:, 2] > 0.05
    ours = (ours[:, :2] / ours[:, 2:])[is_front]
    theirs = np.array([camera.cam_from_img(pixel) for pixel in given[is_front]])
    # COLMAP's Newton steps end at 1e-10.
    assert np.abs(ours - theirs).max() <= 1e-7 * np.abs(theirs).max()
