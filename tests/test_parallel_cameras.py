"""Cameras with parallel rays: entries, depth of field, files, and what refuses them."""

import math

import numpy as np
import pytest

import rastercov as rc
from rastercov.base.errors import CameraError
from rastercov.reference.models import MODELS

LENS = {"magnification": 0.073, "pixel_size": 3.45e-6, "working_distance": 0.4928}
SIZE = {"width": 2448, "height": 2048}
BOX = rc.shapes.box((0.02, 0.02, 0.02))
VIEW = rc.Camera.orthographic(64, 48, px_per_m=1000)
POSES = rc.look_at((0.2, 0.1, 0.1), (0, 0, 0))
VIEWS = rc.Views(rc.Rig([VIEW]), rc.Poses.of(POSES), images=["a"])


def telecentric(**changes):
    return rc.Camera.telecentric(**(SIZE | LENS | changes))


def test_a_data_sheet_and_an_f_number_give_the_depth_of_field():
    printed = telecentric(depth_of_field=0.0777).depth_of_field()
    assert printed == pytest.approx((0.4928 - 0.0777 / 2, 0.4928 + 0.0777 / 2))
    lens = telecentric(f_number=8)
    assert np.ptp(lens.depth_of_field(7.5)) == pytest.approx(0.0777, abs=5e-5)
    assert np.ptp(lens.depth_of_field()) == pytest.approx(2 * 3.45e-6 * 8 / 0.073**2)
    assert lens.working_distance == pytest.approx(sum(lens.depth_of_field()) / 2)
    assert lens.magnification == pytest.approx(0.073)
    assert lens.resized(0.5).magnification == pytest.approx(0.073)
    assert telecentric().depth_of_field() == VIEW.depth_of_field() == (0.0, math.inf)
    assert (VIEW.magnification, rc.Camera.from_fov(9, 9, hfov_deg=9).magnification) == (None, None)


@pytest.mark.parametrize(
    "camera",
    [
        telecentric(f_number=8, near=0.1),
        telecentric(distortion=(3.4,), skew=2.0),
        telecentric(model="telecentric_division", distortion=(-3.4,)),
        VIEW,
    ],
)
def test_a_camera_with_parallel_rays_survives_its_file(camera, tmp_path):
    camera.save(tmp_path / "camera.json")
    assert rc.Camera.load(tmp_path / "camera.json") == camera
    assert camera.is_parallel
    assert not camera.is_pinhole


def test_a_toml_file_has_the_names_of_the_constructor(tmp_path):
    lines = [f"{name} = {value}" for name, value in (SIZE | LENS).items()]
    (tmp_path / "camera.toml").write_text(
        "\n".join(['model = "telecentric"', "f_number = 8", "distortion = [3.4, 0]", *lines])
    )
    load = rc.Camera.load(tmp_path / "camera.toml")
    assert load == telecentric(f_number=8, distortion=(3.4, 0.0))


@pytest.mark.parametrize(
    ("entries", "line"),
    [
        ({"magnification": 0}, "expected magnification to be positive, got 0"),
        ({"magnification": math.nan}, "expected magnification"),
        ({"pixel_size": -1e-6}, "expected pixel_size to be positive"),
        ({"pixel_size": 1e-15}, "expected fx to be from 1e-12 to 1e+12 px, got"),
        ({"f_number": 8, "depth_of_field": 0.01}, "expected f_number or depth_of_field, got both"),
        ({"f_number": 8, "working_distance": None}, "expected working_distance and pixel_size"),
        ({"depth_of_field": 0.1, "working_distance": None}, "expected working_distance with"),
        ({"px_per_m": 100}, "expected one of magnification, px_per_m and fx for parallel rays"),
        ({"focal_length": 0.01}, "expected no focal_length for parallel rays, got 0.01; remove it"),
        ({"aperture": 0.01}, "expected no aperture for parallel rays"),
        ({"hfov_deg": 40}, "expected no hfov_deg for parallel rays"),
        ({"max_angle_deg": 40}, "expected no max_angle_deg for parallel rays"),
        ({"distortion": [1.0, 2.0, 3.0]}, "expected 0 or 1 or 2 or 4 or 5 distortion coefficients"),
        ({"distortion": [1e13]}, "expected k1 of model telecentric to be within 1e+12, got 1e+13"),
        (
            {"magnification": None, "fx": 100, "fy": 200, "distortion": [1.0]},
            "expected equal magnification in x and y with distortion of parallel rays",
        ),
        (
            {"magnification": None, "px_per_m": 9, "pixel_size": None, "distortion": [1.0]},
            "expected pixel_size with distortion of parallel rays, got none; give it in metres",
        ),
        ({"skew": 1e6}, "expected skew of parallel rays up to 10 times fx, got 1e+06 with 21159.4"),
        (
            {"model": "telecentric_division", "distortion": [1.0, 2.0]},
            "expected 1 distortion coefficients (kappa) for model telecentric_division, got 2",
        ),
    ],
)
def test_entries_that_no_such_lens_has_are_refused_in_one_line(entries, line):
    with pytest.raises(CameraError) as raises:
        telecentric(**entries)
    assert line in str(raises.value)
    assert "\n" not in str(raises.value)


def test_entries_of_telecentric_lenses_are_refused_of_other_models():
    for name in ("magnification", "working_distance", "depth_of_field", "px_per_m"):
        with pytest.raises(CameraError, match=f"with {name}, got 'pinhole'"):
            rc.Camera.from_dict(SIZE | {"fx": 100, name: 1.0})
    with pytest.raises(CameraError, match="expected f_number only for a telecentric lens"):
        rc.Camera(**SIZE, fx=100, fy=100, f_number=8)
    with pytest.raises(CameraError, match="expected px_per_m to be positive"):
        rc.Camera.orthographic(64, 48, px_per_m=-1)


@pytest.mark.parametrize(
    "call",
    [
        lambda: rc.write_views("views", VIEWS, format="colmap"),
        lambda: rc.write_views("transforms.json", VIEWS, format="nerfstudio"),
        lambda: MODELS["mavrinac"](BOX, VIEW, POSES),
    ],
    ids=range(3),
)
def test_what_needs_rays_that_meet_in_a_point_refuses_in_one_line(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(CameraError) as raises:
        call()
    assert "telecentric" in str(raises.value)
    assert "\n" not in str(raises.value)
