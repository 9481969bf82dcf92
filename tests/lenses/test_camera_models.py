"""Models of a `Camera` are the lenses of the programs that they are named for."""

import numpy as np
import pytest
from lens_cases import BROWN, COLMAP, HEIGHT, KANNALA, PRISM, RATIONAL, TILTED, WIDTH, K, pixels

from rastercov.base.errors import CameraError
from rastercov.camera.camera import Camera
from rastercov.camera.lenses import make_lens, sources
from rastercov.camera.models import MODELS, lens_terms

SIZE = (WIDTH, HEIGHT)


def kalibr(model, parameters, distortion):
    return sources.kalibr(model, parameters, "radtan", distortion, SIZE)


def metashape(kind):
    lens = sources.metashape(
        *SIZE, f=600, k1=0.02, k2=-0.01, k3=0.002, k4=-1e-4, p1=1e-3, p2=-2e-3, kind=kind
    )
    return lens, (0.02, -0.01, 0.002, -1e-4, 1e-3, -2e-3)


def colmap(model):
    values = COLMAP[model]
    return sources.colmap(model, *SIZE, values), values[4:]


def opensfm():
    """fisheye624 of OpenSfM, whose equations tests/camera_formats compares."""
    values = (0.02, -0.01, 0.003, 1e-3, 2e-4, 1e-4, 1e-3, -2e-3, 1e-3, 2e-3, 3e-3, 4e-3)
    terms = {"radial": values[:6], "tangential": values[6:8], "prism": values[8:]}
    return make_lens("equidistant", *SIZE, fx=400, fy=410, cx=640, cy=500, **terms), values


RADTAN = (-0.1, 0.02, 1e-3, -5e-4)
MATRIX = K * [[0.6, 1, 1], [1, 0.6, 1], [1, 1, 1]]
CASES = [
    ("pinhole", sources.opencv(K, *SIZE), ()),
    *(("opencv", sources.opencv(K, *SIZE, d), d) for d in (BROWN[:4], BROWN, RATIONAL, PRISM)),
    ("opencv", sources.opencv(K, *SIZE, TILTED), TILTED),
    ("opencv_fisheye", sources.opencv_fisheye(MATRIX, *SIZE, KANNALA), KANNALA),
    ("thin_prism_fisheye", *colmap("THIN_PRISM_FISHEYE")),
    ("rad_tan_thin_prism_fisheye", *colmap("RAD_TAN_THIN_PRISM_FISHEYE")),
    ("fisheye62", *opensfm()),
    ("fov", *colmap("FOV")),
    ("division", *colmap("DIVISION")),
    ("omni", kalibr("omni", [0.9, 900, 900, 640, 512], RADTAN), (0.9, *RADTAN)),
    ("eucm", kalibr("eucm", [0.6, 1.1, 480, 480, 640, 512], RADTAN), (0.6, 1.1, *RADTAN)),
    (
        "double_sphere",
        kalibr("ds", [-0.2, 0.55, 480, 480, 640, 512], RADTAN),
        (-0.2, 0.55, *RADTAN),
    ),
    ("metashape", *metashape("frame")),
    ("metashape_fisheye", *metashape("fisheye")),
    ("metashape_equisolid", *metashape("equisolid_fisheye")),
    ("equirectangular", sources.equirectangular(*SIZE), ()),
]


@pytest.mark.parametrize(("model", "lens", "distortion"), CASES, ids=lambda c: str(c)[:30])
def test_model_of_a_camera_is_that_lens(model, lens, distortion):
    fx, fy, cx, cy = lens.params[:4]
    own = make_lens(
        width=WIDTH, height=HEIGHT, fx=fx, fy=fy, cx=cx, cy=cy, **lens_terms(model, distortion)
    )
    assert own == lens
    assert np.array_equal(own.unproject(pixels(50)), lens.unproject(pixels(50)))


def test_every_model_is_compared():
    assert {model for model, *_ in CASES} == set(MODELS)


@pytest.mark.parametrize(
    ("model", "distortion", "words"),
    [
        ("opencv", (1e13, 0, 0, 0), r"k1 of model opencv must be within 1e\+12, got 1e\+13"),
        ("opencv", (*[0] * 12, 1.3, 0), "tau_x of model opencv must be within 1.05 rad, got 1.3"),
        ("fov", (-1,), "omega of model fov must be 0 to below pi radians, got -1"),
        ("fov", (4,), "omega of model fov"),
        ("omni", (-0.5,), "xi of model omni must be 0 or more, got -0.5"),
        ("eucm", (2, 1), "alpha of model eucm must be 0 to 1, got 2; correct distortion"),
        ("eucm", (0.5, 0), "beta of model eucm must be positive, got 0"),
        ("double_sphere", (2, 0.5), "xi of model double_sphere must be above -1 and at most 1"),
        ("double_sphere", (0, -0.5), "alpha of model double_sphere must be 0 to 1, got -0.5"),
    ],
)
def test_a_coefficient_out_of_its_range_is_refused_by_its_own_name(model, distortion, words):
    with pytest.raises(CameraError, match=words):
        Camera(width=32, height=24, fx=30, fy=30, model=model, distortion=distortion)
