"""Models of a `Camera` have the terms of the lenses that they are named for."""

import math

import pytest
from lens_cases import HEIGHT, WIDTH, make_lens

from rastercov.base.errors import CameraError
from rastercov.camera.camera import Camera
from rastercov.camera.lenses.of_camera import lens_of
from rastercov.camera.models import MODELS

K = (0.02, -0.01, 0.003, 1e-3, 2e-4, 1e-4)
P = (1e-3, -2e-3)
S = (1e-3, 2e-3, 3e-3, 4e-3)
POLYNOMIAL = {"radial": K[:4], "tangential": P[::-1]}  # Metashape's p1 and p2 are OpenCV's p2, p1
RADTAN = {"radial": K[:2], "tangential": P}
CASES = [
    ("pinhole", (), "pinhole", {}),
    ("opencv", (*K[:2], *P), "pinhole", RADTAN),
    ("opencv", (*K[:2], *P, K[2]), "pinhole", {"radial": K[:3], "tangential": P}),
    (
        *("opencv", (*K[:2], *P, *K[2:], *S, 0.06, -0.04), "pinhole"),
        {"radial": K[:3], "denominator": K[3:], "tangential": P, "prism": S, "tilt": (0.06, -0.04)},
    ),
    ("opencv_fisheye", K[:4], "equidistant", {"radial": K[:4]}),
    (
        *("thin_prism_fisheye", (*K[:2], *P, *K[2:4], *S[:2]), "equidistant"),
        {"radial": K[:4], "tangential": P, "prism": (S[0], 0, S[1])},
    ),
    (
        *("rad_tan_thin_prism_fisheye", (*K, *P, *S), "equidistant"),
        {"radial": K, "tangential": P[::-1], "prism": S, "is_late": True},
    ),
    ("fisheye62", (*K, *P), "equidistant", {"radial": K, "tangential": P}),
    ("fisheye62", (*K, *P, *S), "equidistant", {"radial": K, "tangential": P, "prism": S}),
    ("fov", (0.9,), "fov", {"of_base": (2 * math.tan(0.45), 2 * math.tan(0.45) / 0.9)}),
    ("fov", (0.0,), "pinhole", {}),
    ("division", (0.1,), "division", {"of_base": (0.1,)}),
    ("omni", (0.9, *K[:2], *P), "unified", {"of_base": (0.9, 1, 1), **RADTAN}),
    ("eucm", (0.6, 1.1, *K[:2], *P), "unified", {"of_base": (0.6, 1 - 0.6, 1.1), **RADTAN}),
    (
        "double_sphere",
        (-0.2, 0.55, *K[:2], *P),
        "double_sphere",
        {"of_base": (-0.2, 0.55), **RADTAN},
    ),
    ("metashape", (*K[:4], *P), "pinhole", POLYNOMIAL),
    ("metashape_fisheye", (*K[:4], *P), "equidistant", POLYNOMIAL),
    ("metashape_equisolid", (*K[:4], *P), "equisolid", POLYNOMIAL),
    ("equirectangular", (), "equirectangular", {"of_base": (0.0, 1.0)}),
]


@pytest.mark.parametrize(("model", "distortion", "base", "terms"), CASES)
def test_model_of_a_camera_has_these_terms(model, distortion, base, terms):
    fields = {"width": WIDTH, "height": HEIGHT, "fx": 600, "fy": 610, "cx": 640, "cy": 500}
    found = lens_of(Camera(**fields, model=model, distortion=distortion))
    assert found == make_lens(base, **fields, **terms)


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
