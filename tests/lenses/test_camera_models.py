"""Models of a `Camera` have the terms of the lenses that they are named for."""

import math

import pytest
from lens_cases import HEIGHT, WIDTH, make_lens

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
