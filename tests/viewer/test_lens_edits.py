import json
import math

import pytest
from edited import changed
from hypothesis import given
from hypothesis import strategies as st

from rastercov import Camera, CameraError
from rastercov.report.pages import describe_camera as described

PINHOLE = Camera(width=640, height=480, fx=500, fy=510, cx=300, cy=250)
LENS = Camera.from_lens(
    width=1280, height=1024, focal_length=8e-3, pixel_size=5.3e-6, f_number=4, focus_distance=1.0
)
FISHEYE = Camera(width=640, height=480, fx=200, fy=200, model="opencv_fisheye",
                 distortion=(0.01, 0, 0, 0))  # fmt: skip


@given(st.floats(1, 170))
def test_the_field_of_view_is_what_was_asked_for(angle):
    made = changed(PINHOLE, {"hfov_deg": angle})
    left, right = math.atan(made.cx / made.fx), math.atan((640 - made.cx) / made.fx)
    assert math.degrees(left + right) == pytest.approx(angle)
    assert made.fy / made.fx == pytest.approx(PINHOLE.fy / PINHOLE.fx)
    assert described(made)["hfov_deg"] == pytest.approx(angle)


@given(st.integers(64, 4000))
def test_another_width_keeps_the_field_of_view(width):
    made = changed(LENS, {"width": width})
    assert made.width == width
    assert described(made)["hfov_deg"] == pytest.approx(described(LENS)["hfov_deg"])


@given(st.sampled_from([PINHOLE, LENS]), st.integers(64, 4000))
def test_the_page_resizes_a_camera_as_python_does(camera, width):
    assert changed(camera, {"width": width}) == camera.resized(width / camera.width)


@given(st.floats(1, 170))
def test_the_page_takes_the_focal_length_of_an_angle_from_python(angle):
    wanted = Camera.from_fov(640, 480, hfov_deg=angle, cx=300, cy=250)
    assert changed(PINHOLE, {"hfov_deg": angle}).fx == pytest.approx(wanted.fx, rel=1e-14)


def test_focus_and_aperture():
    made = changed(LENS, {"focus_distance": 0.5})
    assert made.depth_of_field()[0] < 0.5 < made.depth_of_field()[1]
    wide = changed(made, {"f_number": 1.4})
    assert described(wide)["f_number"] == pytest.approx(1.4)
    span, narrow = made.depth_of_field(), wide.depth_of_field()
    assert span[0] < narrow[0] < narrow[1] < span[1]
    without = Camera.from_lens(width=640, height=480, focal_length=8e-3, pixel_size=5e-6)
    assert described(without)["depth_of_field"] is None
    assert changed(without, {"focus_distance": 0.4}).aperture is not None


def test_a_range_of_focus():
    made = changed(PINHOLE, {"focus_near": 0.2, "focus_far": 3})
    assert made.focus_range == (0.2, 3.0)
    assert changed(changed(LENS, {"focus_far": 2}), {"focus_distance": 1}).focus_range is None


@pytest.mark.parametrize(
    ("camera", "changes", "words"),
    [*((PINHOLE, {"hfov_deg": angle}, "hfov_deg") for angle in (200, None)),
     *((camera, {"focus_distance": 1}, "focal_length") for camera in (PINHOLE, FISHEYE)),
     (FISHEYE, {"hfov_deg": 90}, "pinhole"), (PINHOLE, {"width": 0}, "width"),
     (PINHOLE, {"near": -1}, "near"), (PINHOLE, {"zoom": 1}, "zoom"),
     (LENS, {"f_number": 0}, "f_number"), (LENS, {"focus_distance": 0.001}, "focus_distance")],
)  # fmt: skip
def test_a_wrong_value_is_one_line(camera, changes, words):
    with pytest.raises(CameraError, match=words) as error:
        changed(camera, changes)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("camera", [PINHOLE, LENS, FISHEYE, Camera.preset("khepra"),
    Camera(width=200, height=100, fx=32, fy=32, model="equirectangular")])  # fmt: skip
def test_a_camera_is_made_again_of_its_description(camera):
    text = json.dumps(described(camera), allow_nan=False)
    assert Camera.from_dict(json.loads(text)["plain"]) == camera
    assert len(json.loads(text)["border"]) >= 4


def test_a_camera_in_focus_as_far_as_infinity_is_json_and_comes_back():
    camera = Camera.preset("rpi-cm1")
    said = json.loads(json.dumps(described(camera), allow_nan=False))
    assert said["focus_far"] is None
    assert Camera.from_dict(said["plain"]) == camera
