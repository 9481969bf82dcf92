"""The camera: its matrix, its depth of field, its files, and all that it refuses."""

import json
import math
from dataclasses import MISSING, fields
from itertools import product

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from nightly import amount

from rastercov.base.arguments import MAX_IMAGE_SIDE
from rastercov.base.errors import CameraError
from rastercov.core.camera import parallel
from rastercov.core.camera.camera import CHECKS, Camera
from rastercov.core.camera.catalogue import entries_of
from rastercov.core.camera.models import MODELS
from rastercov.core.camera.projection import angles_of_view, rays_of

INTRINSICS = {"width": 640, "height": 480, "fx": 500.0, "fy": 510.0}
LENS = {"width": 640, "height": 480, "focal_length": 8e-3, "pixel_size": 5e-6}
FOCUS = {"aperture": 4e-3, "focus_distance": 2.0}


def refused(match: str, **entries: object) -> None:
    """Camera refuses the entries in one line that holds `match`, as a table and as arguments."""
    make = Camera if "fx" in entries else Camera.from_lens
    for attempt in (lambda: make(**entries), lambda: Camera.from_dict(entries)):
        with pytest.raises(CameraError, match=match) as caught:
            attempt()
        assert "\n" not in str(caught.value)
        assert len(str(caught.value)) < 300


def angles_of(camera: Camera) -> tuple[float, float]:
    """Angles between left and right, and between top and bottom, radians."""
    sides = (camera.cx, camera.width, camera.fx), (camera.cy, camera.height, camera.fy)
    left, right = (math.atan(c / f) + math.atan((side - c) / f) for c, side, f in sides)
    return left, right


# --- K --------------------------------------------------------------------------------------------


def test_k_holds_focal_length_over_pixel_size_row_by_row():
    # (3.5) as printed has f and s_u on separate rows; it means f/s_u and f/s_v.
    camera = Camera.from_lens(width=600, height=400, focal_length=8e-3, pixel_size=(4e-6, 5e-6))
    assert np.allclose(camera.K, [[2000, 0, 300], [0, 1600, 200], [0, 0, 1]], rtol=1e-15)


def test_thesis_table_5_2_camera():
    camera = Camera.preset("icube-ns4133bu-8mm")
    assert (camera.width, camera.height) == (1280, 1024)
    assert np.allclose(camera.K, [[8e4 / 53, 0, 640], [0, 8e4 / 53, 512], [0, 0, 1]], rtol=1e-15)
    assert camera.fx == pytest.approx(1509.434, abs=1e-3)
    assert camera.depth_of_field() == (0, math.inf)


def test_thesis_figure_a_3_camera():
    camera = Camera.preset("khepra")
    assert (camera.width, camera.height) == (1280, 800)
    assert camera.width * camera.pixel_size[0] == pytest.approx(3.6e-3)
    assert camera.height * camera.pixel_size[1] == pytest.approx(2.01e-3)
    assert angles_of(camera)[0] == pytest.approx(2 * math.atan(1.80 / 1.93))
    assert angles_of(camera)[1] == pytest.approx(2 * math.atan(1.005 / 1.93))
    assert camera.depth_of_field() == (0.1, 5.0)


@pytest.mark.parametrize("name", ["kepra", None, {}])
def test_an_unknown_preset_names_the_known_ones(name):
    with pytest.raises(
        CameraError, match=r"expected a name among the \d+ cameras of the catalogue, got"
    ):
        Camera.preset(name)


def test_lens_and_intrinsics_make_the_same_camera():
    by_lens = Camera.from_lens(**LENS, principal_point=(1.5e-3, 1.25e-3))
    assert (by_lens.cx, by_lens.cy) == pytest.approx((300, 250))
    assert by_lens == Camera(
        width=640, height=480, fx=by_lens.fx, fy=by_lens.fy, cx=by_lens.cx, cy=by_lens.cy,
        focal_length=8e-3, pixel_size=(5e-6, 5e-6),
    )  # fmt: skip
    by_number = Camera.from_lens(**LENS, f_number=2.0, focus_distance=2.0)
    assert by_number == Camera.from_lens(**LENS | FOCUS)


def test_principal_point_is_the_image_centre_unless_given():
    assert (Camera(**INTRINSICS).cx, Camera(**INTRINSICS).cy) == (320, 240)
    moved = Camera(**INTRINSICS, cx=-5.0, cy=1000.0)  # a crop may not hold its principal point
    assert (moved.cx, moved.cy) == (-5, 1000)


@given(fx=st.floats(1, 1e5), fy=st.floats(1, 1e5), cx=st.floats(-1e4, 1e4), cy=st.floats(-1e4, 1e4))
def test_opencv_calibrations_survive_the_half_pixel_there_and_back(fx, fy, cx, cy):
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    camera = Camera.from_opencv(K, 640, 480)
    assert camera.opencv_K == pytest.approx(K, abs=1e-11)
    assert (camera.cx, camera.cy) == (cx + 0.5, cy + 0.5)


@pytest.mark.parametrize(
    ("K", "match"),
    [
        (np.eye(2), r"shape \(3, 3\), got \(2, 2\)"),
        ("K", "real numbers"),
        (np.eye(3) * 1j, "real numbers"),
        ([[1, 0, 0], [0, 1]], "unequal length"),
        (np.diag([1, 1, 2]), r"expected K to be \[\["),
        (np.diag([1, 0, 1]), "fy to be positive"),
        (np.diag([np.nan, 1, 1]), "fx to be finite"),
    ],
)
def test_a_matrix_that_is_no_calibration_is_refused(K, match):
    with pytest.raises(CameraError, match=match):
        Camera.from_opencv(K, 640, 480)


# --- depth of field -------------------------------------------------------------------------------


def lens(**others: object) -> Camera:
    """A = 20 mm, f = 50 mm, z_s - f = 2 m, s = 5 um: A f = 1e-3 and c s (z_s - f) = c 1e-5."""
    arguments = {
        "width": 100, "height": 100, "focal_length": 0.05, "pixel_size": 5e-6,
        "aperture": 0.02, "focus_distance": 2.05,
    }  # fmt: skip
    return Camera.from_lens(**arguments | others)


def blur_circle(camera: Camera, z: float) -> float:
    """Diameter of the blur circle of a point at depth z, from the thin lens, in metres.

    A point at z images at v = f z / (z - f), the sensor stands at v_s = f z_s / (z_s - f), and the
    cone of base A is cut there: A |v - v_s| / v = A f |z - z_s| / (z (z_s - f)).
    """
    f, z_s = camera.focal_length, camera.focus_distance
    v, v_s = f * z / (z - f), f * z_s / (z_s - f)
    return camera.aperture * abs(v - v_s) / v


def test_the_camera_has_its_own_limit_of_blur():
    assert lens(max_blur=10).depth_of_field() == lens().depth_of_field(10)


lenses = st.builds(
    lambda f, number, sides, z_s: lens(
        focal_length=f, aperture=f / number, pixel_size=sides, focus_distance=z_s
    ),
    st.floats(1e-3, 0.2),
    st.floats(0.25, 32),
    st.tuples(st.floats(1e-6, 2e-5), st.floats(1e-6, 2e-5)),
    st.floats(0.3, 20),
)


@given(lenses, st.floats(0.1, 20))
def test_blur_at_both_limits_is_c_pixels(camera, c):
    near, far = camera.depth_of_field(c)
    assume(near > 1.001 * camera.focal_length)
    limit = c * min(camera.pixel_size)
    assert near < camera.focus_distance < far
    assert blur_circle(camera, near) == pytest.approx(limit, rel=1e-6)
    if far < 1e6:
        assert blur_circle(camera, far) == pytest.approx(limit, rel=1e-6)
    if math.isinf(far):
        assert blur_circle(camera, 1e9) <= limit * (1 + 1e-6)


def test_focused_at_the_hyperfocal_distance_all_from_half_of_it_is_sharp():
    # Powers of two, so that (3.11) divides by exactly 0.
    camera = lens(focal_length=2**-4, aperture=2**-5, focus_distance=2 + 2**-4, pixel_size=2.0**-17)
    assert camera.depth_of_field(128) == ((2 + 2**-4) / 2, math.inf)
    assert math.isfinite(camera.depth_of_field(127)[1])


def test_a_given_focus_range_is_the_depth_of_field():
    for far in (5, math.inf):
        assert Camera(**INTRINSICS, focus_range=(0, far)).depth_of_field(3) == (0, far)
    assert Camera(**INTRINSICS, focus_range=np.array([1, 2])).focus_range == (1, 2)


def test_thesis_focus_experiment():
    # Table 5.4: f/0.25, c = 5.755 px; the markers at 3 to 7 m are in focus, those at 2 m and at
    # 8 m and more are not. The thesis does not print z_s: 4 m, as in its other set-ups, gives that.
    camera = Camera.from_lens(
        **entries_of("icube-ns4133bu-8mm", {}), f_number=0.25, focus_distance=4.0, max_blur=5.755
    )
    near, far = camera.depth_of_field()
    assert (near, far) == pytest.approx((2.711, 7.628), abs=1e-3)
    markers = [*range(2, 14), 17, 18]
    assert [z for z in markers if near <= z <= far] == [3, 4, 5, 6, 7]


# --- values that describe no camera ---------------------------------------------------------------

NO_NUMBER = ["5", "", True, False, [], [1, 2, 3], {}, 1j, b"5", object()]
NOT_FINITE = [math.nan, math.inf, -math.inf, 10**400, np.float64("nan")]


SIDES = [0, -1, -4, 0.5, 640.5, MAX_IMAGE_SIDE + 1, 1e300, None, *NO_NUMBER, *NOT_FINITE]
LENGTHS = [0, -0.0, -5, *NO_NUMBER, *NOT_FINITE]
NO_PAIR = [5e-6, "ab", (1,), (1, 2, 3), (True, 2), ("1", "2"), (1, math.nan), {"u": 1, "v": 2}]
NO_RANGE = [
    5, "ab", "12", (), (1,), (1, 2, 3), (2, 1), (1, 1), (-1, 2), (math.nan, 2), (1, math.nan),
    (math.inf, math.inf), (True, 2), ("1", "2"), (10**400, 10**401), {"a": 1, "b": 2}, object(),
]  # fmt: skip
NO_COEFFICIENTS = ["k1", None, (0, "0"), (math.nan,), {"k1": 0.1}, [[0], "x"]]
NO_SIDES = [(5e-6,), (5e-6, 5e-6, 5e-6), (5e-6, 0), (5e-6, "5e-6")]


@pytest.mark.parametrize(
    ("base", "names", "values", "match"),
    [
        (INTRINSICS, ["width", "height"], SIDES, ""),
        (LENS, ["width", "height"], SIDES, ""),
        (INTRINSICS, ["fx", "fy"], LENGTHS, ""),
        (LENS | FOCUS, ["max_blur", "focal_length", "pixel_size", *FOCUS], LENGTHS, ""),
        (LENS | {"focus_distance": 2.0}, ["f_number"], LENGTHS, ""),
        (INTRINSICS, ["near"], [-1e-9, None, *NO_NUMBER, *NOT_FINITE], ""),
        (INTRINSICS, ["cx", "cy"], NO_NUMBER + NOT_FINITE, ""),
        (LENS, ["principal_point"], NO_PAIR, ""),
        (INTRINSICS, ["focus_range"], NO_RANGE, " to "),
        (LENS, ["pixel_size"], NO_SIDES, " to be"),
        (INTRINSICS, ["max_angle_deg"], [0, -1, 181, math.nan, "wide"], ""),
        (INTRINSICS, ["skew"], [None, *NO_NUMBER, *NOT_FINITE], " to be"),
        (INTRINSICS, ["distortion"], NO_COEFFICIENTS, ""),
    ],
)
def test_a_value_that_describes_no_camera_is_refused_by_name(base, names, values, match):
    for name, value in product(names, values):
        refused(f"{name}{match}", **base | {name: value})


@pytest.mark.parametrize("value", [1, 640.0, np.int32(7), np.float32(7), MAX_IMAGE_SIDE])
def test_an_image_side_may_be_any_whole_number(value):
    camera = Camera(**INTRINSICS | {"width": value})
    assert camera.width == value
    assert type(camera.width) is int
    assert (camera.near, Camera(**INTRINSICS, near=2).near) == (0, 2)


@pytest.mark.parametrize(
    ("match", "entries"),
    [
        (
            "expected aperture and focus_distance together, got one of them;",
            LENS | {"aperture": 1e-3},
        ),
        (
            "expected aperture and focus_distance together, got one of them;",
            LENS | {"focus_distance": 1.0},
        ),
        (
            "expected aperture and focus_distance together, got one of them;",
            LENS | {"f_number": 2.0},
        ),
        ("with (an|f_number or) aperture, got none", INTRINSICS | FOCUS),
        ("expected f_number or aperture, got both", LENS | FOCUS | {"f_number": 2.0}),
        ("expected focus_range or aperture, got both", LENS | FOCUS | {"focus_range": (1, 2)}),
        (
            "expected principal_point, or cx and cy, got both",
            LENS | {"principal_point": (1e-3, 1e-3), "cx": 3.0},
        ),
        (
            r"expected focus_distance above focal_length 0\.008 m, got 0\.00",
            LENS | FOCUS | {"focus_distance": 8e-3},
        ),
        (
            r"expected focus_distance above focal_length 0\.008 m, got 0\.00",
            LENS | FOCUS | {"focus_distance": 1e-3},
        ),
    ],
)
def test_entries_that_contradict_each_other_are_refused(match, entries):
    refused(match, **entries)


def test_a_blur_limit_is_checked_where_it_is_given():
    for value in (0, -1, math.nan, math.inf, "1", True):
        with pytest.raises(CameraError, match="max_blur"):
            lens().depth_of_field(value)


@pytest.mark.parametrize(
    "distortion", [0, (), (0, 0, 0, 0), [0.0] * 5, np.zeros((1, 5)), [[0], [0]]]
)
def test_no_distortion_may_be_said_in_zeros(distortion):
    assert Camera(**INTRINSICS, skew=0, distortion=distortion) == Camera(**INTRINSICS)
    K = Camera(**INTRINSICS).opencv_K
    assert Camera.from_opencv(K, 640, 480, distortion) == Camera(**INTRINSICS)


@pytest.mark.parametrize("distortion", [1e-9, (0, 0.1), [0.0] * 40 + [2], np.full((1, 5), 0.1)])
def test_distortion_needs_a_model(distortion):
    refused(r"expected no distortion for a pinhole, got \[", **INTRINSICS, distortion=distortion)


@pytest.mark.parametrize(
    ("model", "distortion", "wanted"),
    [
        ("opencv", [0.1], r"expected 4 or 5 or 8 or 12 or 14 distortion coefficients \(k1 k2"),
        (
            "opencv_fisheye",
            [0.1] * 5,
            r"expected 0 or 4 distortion coefficients \(k1 k2 k3 k4\) for",
        ),
        ("fov", [], r"expected 1 distortion coefficients \(omega\) for model fov, got 0"),
        (
            "equirectangular",
            [0.1],
            "expected 0 distortion coefficients for model equirectangular, got",
        ),
        ("OPENCV", [0.1] * 4, "model to be one of pinhole, opencv"),
        (3, [0.1] * 4, "model to be one of"),
        ("opencv", (1e13, 0, 0, 0), r"k1 of model opencv to be within 1e\+12, got 1e\+13"),
        ("opencv", (*[0] * 12, 1.3, 0), "tau_x of model opencv to be within 1.05 rad, got 1.3"),
        ("fov", (-1,), "omega of model fov to be from 0 to below pi radians, got -1"),
        ("fov", (4,), "omega of model fov"),
        ("omni", (-0.5,), "xi of model omni to be 0 or more, got -0.5"),
        ("eucm", (2, 1), "alpha of model eucm to be from 0 to 1, got 2; correct distortion"),
        ("eucm", (0.5, 0), "beta of model eucm to be positive, got 0"),
        ("double_sphere", (2, 0.5), "xi of model double_sphere to be above -1 and at most 1"),
        ("double_sphere", (0, -0.5), "alpha of model double_sphere to be from 0 to 1, got -0.5"),
    ],
)
def test_a_model_has_its_coefficients_within_their_ranges(model, distortion, wanted):
    refused(wanted, **INTRINSICS, model=model, distortion=distortion)


@pytest.mark.parametrize("n", [4, 5, 8, 12, 14])
def test_an_opencv_calibration_keeps_its_coefficients(n):
    coefficients = tuple(0.01 * k for k in range(1, n + 1))
    K = [[500, 1.5, 319.5], [0, 490, 239.5], [0, 0, 1]]
    for fisheye, model in ((False, "opencv"), (True, "opencv_fisheye")):
        own = coefficients[:4] if fisheye else coefficients
        camera = Camera.from_opencv(K, 640, 480, own, fisheye=fisheye)
        assert (camera.model, camera.distortion, camera.skew) == (model, own, 1.5)


CENTRAL = {name: its for name, its in MODELS.items() if name not in parallel.MODELS}


@pytest.mark.parametrize(("model", "its"), CENTRAL.items())
def test_a_camera_of_any_model_survives_its_file(model, its, tmp_path):
    n = len(its.coefficients.split())
    limit = None if model == "equirectangular" else 80
    camera = Camera(**INTRINSICS, model=model, distortion=[0.01] * n, skew=0.5, max_angle_deg=limit)
    camera.save(tmp_path / "camera.json")
    assert Camera.load(tmp_path / "camera.json") == camera
    assert not camera.is_pinhole
    for other in (lens(), Camera(**INTRINSICS, cx=1 / 3, near=0.1, focus_range=(0.1, math.inf))):
        other.save(tmp_path / "camera.json")
        assert Camera.load(tmp_path / "camera.json") == other


def test_a_fisheye_and_a_tilted_sensor_have_no_plane_in_focus():
    focus = {"focal_length": 0.01, "pixel_size": 1e-5, "aperture": 0.005, "focus_distance": 2}
    refused(
        "expected a lens with a plane of focus for an aperture, got a lens of",
        **INTRINSICS,
        **focus,
        model="opencv_fisheye",
    )
    refused("tilted sensor", **INTRINSICS, **focus, model="opencv", distortion=[0] * 13 + [0.1])
    Camera(**INTRINSICS, **focus, model="opencv", distortion=[0.1] * 12 + [0, 0])
    Camera(**INTRINSICS, focus_range=(1, 2), model="opencv_fisheye")


# --- files ----------------------------------------------------------------------------------------


def test_json_and_toml_say_the_same_camera(tmp_path):
    (tmp_path / "c.json").write_text(
        '{"width": 640, "height": 480, "focal_length": 8e-3, "pixel_size": [5e-6, 6e-6], "near": 1}'
    )
    (tmp_path / "c.TOML").write_text(
        "width = 640\nheight = 480\nfocal_length = 8e-3\npixel_size = [5e-6, 6e-6]\nnear = 1"
    )
    expected = Camera.from_lens(**LENS | {"pixel_size": (5e-6, 6e-6)}, near=1)
    assert Camera.load(tmp_path / "c.json") == expected
    assert Camera.load(str(tmp_path / "c.TOML")) == expected


@pytest.mark.parametrize("name", ["fx", "fy"])
def test_one_focal_length_means_square_pixels(name):
    camera = Camera.from_dict({"width": 640, "height": 480, name: 900})
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (900, 900, 320, 240)


def test_a_camera_is_saved_only_where_it_can_be_loaded(tmp_path):
    with pytest.raises(CameraError, match=r"expected the suffix \.json for a camera, got '\.toml'"):
        Camera(**INTRINSICS).save(tmp_path / "camera.toml")
    assert not list(tmp_path.iterdir())


def test_a_file_may_start_from_a_preset_and_change_it(tmp_path):
    path = tmp_path / "camera.toml"
    path.write_text('preset = "khepra"\nwidth = 640\nnear = 0.25\nfocus_range = [1, inf]\n')
    camera = Camera.load(path)
    khepra = Camera.preset("khepra")
    assert (camera.width, camera.height, camera.near) == (640, 800, 0.25)
    assert (camera.fx, camera.fy, camera.cx) == (khepra.fx, khepra.fy, 320)
    assert camera.depth_of_field() == (1, math.inf)


FILES = {
    "number.json": ("640", "expected a table of the entries of a camera, got 640"),
    "large.json": (
        '{"width": 1' + "0" * 400 + ', "height": 1, "fx": 1, "fy": 1}',
        "width: expected a number within",
    ),
    "latin.json": (b'{"\xe9": 1}', "expected valid JSON, got"),
    "folder.json": (None, "expected a regular file, got a folder"),
    "cut.toml": ("width = ", r"expected valid TOML, got: Invalid value \(at end of document\)"),
    "empty.toml": ("", "expected image size and focal length, got no width"),
    "half.toml": ("height = 1\nfy = 1", "expected image size and focal length, got no width"),
    "lens.toml": (
        "width = 1\nheight = 1\nfocal_length = 1",
        "expected image size and focal length, got no",
    ),
    "typo.toml": ("widht = 1", "expected known entries of a camera .* got"),
    "date.toml": ("width = 1\nheight = 1\nfx = 1\nfy = 2020-01-01", "fy to be a number, got"),
    "mixed.toml": ("width = 1\nheight = 1\nfx = 1\nfy = 1\nf_number = 2", "give pixel_size"),
    "both.toml": (
        "width = 1\nheight = 1\nfx = 1\nfy = 1\nprincipal_point = [1, 1]",
        "expected fx and fy, or focal_length, pixel_size and principal_point, got both",
    ),
    "unfit.toml": (
        "width = 1\nheight = 1\nfx = 100\nfy = 200\npixel_size = 1e-6\nf_number = 2",
        r"expected one focal length from fx, fy and pixel_size, got 0\.0001 m and",
    ),
    "calibrated.toml": ('file = "a.yaml"', "expected a camera, got an entry file"),
    "sideless.toml": ("height = 1\nhfov_deg = 60", "expected width with hfov_deg, got none"),
    "outside.toml": (
        "width = 9\nheight = 9\nvfov_deg = 60\ncy = -1",
        "expected a principal point inside the image for vfov_deg, got -1 px",
    ),
    "preset.toml": (
        'preset = "leica"',
        r"expected a name among the \d+ cameras of the catalogue, got",
    ),
    "camera.yaml": ("width: 640", r"expected a camera file \.json or \.toml, got '\.yaml'"),
}


@pytest.mark.parametrize(("name", "content"), FILES.items(), ids=FILES)
def test_a_file_that_holds_no_camera_is_named(tmp_path, name, content):
    text, match = content
    if text is None:
        (tmp_path / name).mkdir()
    else:
        (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(CameraError, match=match) as caught:
        Camera.load(tmp_path / name)
    assert str(caught.value).startswith(f"{tmp_path / name}: ")
    assert "\n" not in str(caught.value)


def test_fields_of_view_give_focal_lengths_also_of_a_preset():
    both = Camera.from_dict(
        {"width": 640, "height": 480, "hfov_deg": 70, "vfov_deg": 50, "cx": 100}
    )
    assert np.degrees(angles_of(both)) == pytest.approx((70, 50), rel=1e-12)
    camera = Camera.from_dict({"preset": "khepra", "vfov_deg": 40, "near": 0.2})
    assert math.degrees(angles_of(camera)[1]) == pytest.approx(40)
    assert (camera.width, camera.near, camera.focus_range) == (1280, 0.2, (0.1, 5.0))
    assert camera.focal_length is None


def test_a_calibrated_matrix_and_a_pixel_size_give_the_aperture_of_an_f_number():
    entries = INTRINSICS | {"pixel_size": 5e-6, "f_number": 4, "focus_distance": 1.0}
    camera = Camera.from_dict(entries)
    f = (INTRINSICS["fx"] + INTRINSICS["fy"]) / 2 * 5e-6
    assert camera.focal_length == pytest.approx(f)
    assert camera.aperture == pytest.approx(f / 4)
    assert (camera.fx, camera.fy) == (INTRINSICS["fx"], INTRINSICS["fy"])
    by_diameter = entries | {"aperture": f / 4}
    del by_diameter["f_number"]
    assert Camera.from_dict(by_diameter) == camera


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5)
    | st.just(10**400) | st.sampled_from(["khepra", "rpi-hq+rpi-6mm", 1, 640, 0.5]),
    lambda inner: st.lists(inner, max_size=3)
    | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=6,
)  # fmt: skip
keys = st.sampled_from(
    [field.name for field in fields(Camera)]
    + ["f_number", "principal_point", "preset", "", "fz", "hfov_deg", "vfov_deg"]
)


@given(
    st.sampled_from([{}, INTRINSICS, LENS, LENS | FOCUS, {"preset": "khepra"}]),
    st.dictionaries(keys, json_values, max_size=4),
    st.sets(keys, max_size=1),
)
@settings(max_examples=amount(15, 100))
def test_whatever_json_says_it_is_a_camera_or_a_camera_error(base, changes, dropped):
    entries = {k: v for k, v in (base | changes).items() if k not in dropped}
    try:
        camera = Camera.from_dict(json.loads(json.dumps(entries)))
    except CameraError as error:
        assert "\n" not in str(error)  # noqa: PT017 - most draws are refused, some are not
    else:
        assert np.isfinite(camera.K).all()
        assert camera.width >= 1
        assert camera.depth_of_field()[0] >= 0


def test_a_lens_of_no_size_divides_nothing_by_zero():
    camera = Camera(
        **INTRINSICS, focal_length=1e-300, aperture=1e-300, pixel_size=1e-300, focus_distance=1,
        max_blur=1e-300,
    )  # fmt: skip
    assert camera.depth_of_field()[0] >= 0


def test_a_table_whose_names_are_no_words_is_refused():
    with pytest.raises(CameraError, match=r"expected known entries of a camera .* got"):
        Camera.from_dict({1: 2, "b": 3, None: 4})


# --- angles of view -------------------------------------------------------------------------------


@pytest.mark.parametrize("angle", [1e-3, 20, 90, 170])
def test_an_angle_of_view_is_that_between_the_rays_at_the_sides(angle):
    sides = {"hfov_deg": (640, 0), "vfov_deg": (0, 480)}
    for name, (across, down) in sides.items():
        camera = Camera.from_fov(640, 480, **{name: angle}, near=0.5)
        assert camera.fx == camera.fy
        assert (camera.cx, camera.cy, camera.near) == (320, 240, 0.5)
        half = np.hypot(across, down) / 2 / camera.fx
        assert 2 * np.degrees(np.arctan(half)) == pytest.approx(angle, rel=1e-9)


@pytest.mark.parametrize(("model", "its"), CENTRAL.items())
@given(
    limit=st.floats(5, 20), cx=st.floats(0, 640), cy=st.floats(0, 480), seed=st.integers(0, 2**32)
)
@settings(max_examples=amount(15, 200), deadline=None)
def test_an_angle_of_view_ends_with_the_valid_region(model, its, limit, cx, cy, seed):
    if model == "equirectangular":
        return
    n = len(its.coefficients.split())
    own = {"cx": cx, "cy": cy, "model": model, "distortion": [0.01] * n, "max_angle_deg": limit}
    camera = Camera(width=640, height=480, fx=500.0, fy=510.0, **own)
    places = np.random.default_rng(seed).uniform((0, 0), (640, 480), (400, 2))
    places[:200, 1], places[200:, 0] = cy, cx
    rays = rays_of(places, camera)
    for view, side in zip(angles_of_view(camera), (0, 1), strict=True):
        mine = np.degrees(np.arctan2(rays[:, side], rays[:, 2]))[200 * side : 200 * side + 200]
        assert np.nanmax(mine) - np.nanmin(mine) <= view + 1e-6
        assert view <= 2 * limit + 1e-6
        centre, size = (cx, cy)[side], (640, 480)[side]
        if size / 4 < centre < 3 * size / 4 and limit < 8:
            assert view == pytest.approx(2 * limit, abs=1e-6)


@pytest.mark.parametrize(
    ("own", "wanted"),
    [
        ({"model": "opencv_fisheye", "fx": 150, "fy": 150, "distortion": (0,) * 4}, (350, 350)),
        ({"max_angle_deg": 19}, (38, 38)),
        ({"max_angle_deg": 19, "cx": -500}, (0, 38)),
        ({"model": "equirectangular", "fx": 500 / math.pi, "fy": 500 / math.pi}, (360, 180)),
        (
            {"model": "equirectangular", "fx": 500 / math.pi, "fy": 500 / math.pi, "cx": 300},
            (288, 180),
        ),
    ],
)
def test_an_image_may_end_in_no_rays(own, wanted):
    camera = Camera(**{"width": 1000, "height": 1100, "fx": 1000, "fy": 1000} | own)
    assert angles_of_view(camera) == pytest.approx(wanted, abs=1e-6)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({}, "expected image size and focal length, got no"),
        ({"hfov_deg": 180}, "expected hfov_deg above 0 and below 180 degrees, got 180"),
        ({"vfov_deg": 5e-324}, "expected vfov_deg above 0 and below 180 degrees, got"),
        ({"hfov_deg": 0}, "expected hfov_deg above 0 and below 180 degrees, got 0"),
        ({"hfov_deg": 60, "fx": 3}, "expected hfov_deg and vfov_deg, or fx, got both"),
        (
            {"hfov_deg": 60, "model": "opencv", "distortion": (0.1,) * 4},
            "expected hfov_deg and vfov_deg for a pinhole, got 'opencv'",
        ),
        ({"hfov_deg": "60"}, "hfov_deg to be a number, got '60'"),
        (
            {"hfov_deg": 60, "colour": 1},
            "expected known entries of a camera .* got",
        ),
    ],
)
def test_other_angles_of_view_are_refused(arguments, words):
    with pytest.raises(CameraError, match=words):
        Camera.from_fov(640, 480, **arguments)


def test_defaults_are_what_their_checks_make_of_them():
    defaults = {each.name: each.default for each in fields(Camera) if each.name in CHECKS}
    known = {k: v for k, v in defaults.items() if v is not None and v is not MISSING}
    assert known
    assert all(repr(CHECKS[name](name, value)) == repr(value) for name, value in known.items())
