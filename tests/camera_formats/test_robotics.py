"""Kalibr camchains and ROS camera_info, as their tools write them, against their equations."""

import cv2
import numpy as np
import pytest
import yaml
from view_files import lens_of

import rastercov as rc
from rastercov.camera.formats import read_views, write_views

RADTAN = [-0.28, 0.07, 0.0002, 0.00002]
EQUI = [-0.01, 0.02, -0.01, 0.003]
CAM0_FROM_IMU = [
    [0.01, -0.9999, 0.005, 0.02],
    [0.9999, 0.01, 0.02, -0.06],
    [-0.02, 0.005, 0.9998, 0.01],
    [0.0, 0.0, 0.0, 1.0],
]


def motion(rvec, translation):
    out = np.eye(4)
    out[:3, :3], _ = cv2.Rodrigues(np.array(rvec, dtype=float))
    out[:3, 3] = translation
    return out


def camchain(path, *cameras):
    """A chain as Kalibr's ConfigReader writes it."""
    content = {
        f"cam{row}": {
            "cam_overlaps": [1],
            "distortion_model": distortion,
            "distortion_coeffs": values,
            "camera_model": model,
            "intrinsics": intrinsics,
            "resolution": [752, 480],
            "rostopic": f"/cam{row}/image_raw",
            **others,
        }
        for row, (model, intrinsics, distortion, values, others) in enumerate(cameras)
    }
    path.write_text(yaml.dump(content, default_flow_style=None, width=2147483647))
    return path


def by_equations(model, intrinsics, distortion, values, ray):
    """Pixel of a ray, counted from centres, from the papers' equations."""
    X, Y, Z = ray
    d = np.sqrt(X * X + Y * Y + Z * Z)
    *own, fx, fy, cx, cy = intrinsics
    if model == "pinhole":
        x, y = X / Z, Y / Z
    elif model == "omni":
        x, y = X / (Z + own[0] * d), Y / (Z + own[0] * d)
    elif model == "eucm":
        alpha, beta = own
        w = alpha * np.sqrt(beta * (X * X + Y * Y) + Z * Z) + (1 - alpha) * Z
        x, y = X / w, Y / w
    else:
        xi, alpha = own
        c = xi * d + Z
        w = alpha * np.sqrt(X * X + Y * Y + c * c) + (1 - alpha) * c
        x, y = X / w, Y / w
    r2 = x * x + y * y
    if distortion == "radtan":
        k1, k2, p1, p2 = values
        f = 1 + k1 * r2 + k2 * r2 * r2
        x, y = (
            x * f + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * f + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        )
    elif distortion in ("equi", "equidistant"):
        t = np.arctan(np.sqrt(r2))
        f = t * (1 + sum(k * t ** (2 * i + 2) for i, k in enumerate(values))) / np.sqrt(r2)
        x, y = x * f, y * f
    elif distortion == "fov":
        (w,) = values
        r = np.sqrt(r2)
        f = np.arctan(2 * r * np.tan(w / 2)) / w / r
        x, y = x * f, y * f
    return np.array([fx * x + cx, fy * y + cy])


LENSES = [
    ("pinhole", [458.6, 457.3, 367.2, 248.4], "radtan", RADTAN),
    ("pinhole", [458.6, 457.3, 367.2, 248.4], "none", []),
    ("pinhole", [458.6, 457.3, 367.2, 248.4], "equi", EQUI),
    ("pinhole", [458.6, 457.3, 367.2, 248.4], "equidistant", EQUI),
    ("pinhole", [458.6, 457.3, 367.2, 248.4], "fov", [0.9]),
    ("omni", [1.5, 900.0, 905.0, 367.2, 248.4], "radtan", [-0.1, 0.05, 0.0002, 0.00002]),
    ("omni", [1.5, 900.0, 905.0, 367.2, 248.4], "none", []),
    ("eucm", [0.6, 1.1, 458.6, 457.3, 367.2, 248.4], "none", []),
    ("ds", [-0.2, 0.6, 358.6, 357.3, 367.2, 248.4], "none", []),
]


@pytest.mark.slow
@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: f"{lens[0]}-{lens[2]}")
def test_every_lens_of_kalibr_follows_its_equations(tmp_path, lens):
    views = read_views(camchain(tmp_path / "camchain.yaml", (*lens, {})))
    rng = np.random.default_rng(0)
    for ray in np.column_stack([rng.uniform(-0.4, 0.4, (20, 2)), np.ones(20)]):
        wanted = by_equations(*lens, ray) + 0.5
        np.testing.assert_allclose(lens_of(views.camera()).project(ray), wanted, rtol=0, atol=1e-9)


def test_a_chain_gives_places_from_camera_to_camera(tmp_path):
    steps = [motion([0.01, 0.02, 0.0], [-0.11, 0, 0]), motion([0, 0.3, 0.1], [-0.2, 0.01, 0.02])]
    chain = [LENSES[0], LENSES[2], LENSES[7]]
    others = [{}, *({"T_cn_cnm1": step.tolist()} for step in steps)]
    path = camchain(tmp_path / "c.yaml", *((*lens, o) for lens, o in zip(chain, others)))  # noqa: B905
    views = read_views(path)
    assert views.has_unit
    assert views.images == ("cam0", "cam1", "cam2")
    # A point of camera 0 reaches camera 2 through both steps.
    point = np.array([0.1, 0.2, 3.0, 1.0])
    place = np.linalg.inv(views.rig.rig_from_camera[2])
    np.testing.assert_allclose(place @ point, steps[1] @ steps[0] @ point, atol=1e-12)
    np.testing.assert_array_equal(views.poses.world_from_camera, views.rig.rig_from_camera)
    assert views.poses.camera.tolist() == [0, 1, 2]


@pytest.mark.parametrize("name", ["T_cn_cnm1", "T_cam_imu"])
def test_a_matrix_may_be_one_row_of_numbers(tmp_path, name):
    steps = [motion([0, 0.2, 0.1 * i], [i, -0.1, 0.3]) for i in (1, 2)]
    found = []
    for flat in (False, True):
        others = [{name: (step.ravel() if flat else step).tolist()} for step in steps]
        path = camchain(tmp_path / f"{flat}.yaml", *((*LENSES[0], each) for each in others))
        found.append(read_views(path).poses.world_from_camera)
    np.testing.assert_array_equal(*found)
    assert (found[0][1] != np.eye(4)).any()


def test_places_come_from_the_imu_where_there_is_no_chain(tmp_path):
    others = [{"T_cam_imu": motion([0, 0, 0.1 * i], [i, 0, 0]).tolist()} for i in (1, 2)]
    path = camchain(tmp_path / "c.yaml", *((*LENSES[0], each) for each in others))
    views = read_views(path)
    np.testing.assert_allclose(
        views.rig.rig_from_camera @ [each["T_cam_imu"] for each in others],
        np.tile(np.eye(4), (2, 1, 1)),
        atol=1e-12,
    )
    assert any("frame of the IMU" in note for note in views.notes)


def test_places_on_the_imu_are_read_in_either_direction(tmp_path):
    # OpenVINS has the inverse of Kalibr's matrix.
    steps = [motion([0.2, 0, 0.1 * i], [i, -0.1, 0.3]) for i in (1, 2)]
    found = []
    for name, matrices in (("T_cam_imu", steps), ("T_imu_cam", map(np.linalg.inv, steps))):
        cameras = [(*LENSES[0], {name: matrix.tolist()}) for matrix in matrices]
        views = read_views(camchain(tmp_path / f"{name}.yaml", *cameras))
        found.append(views.poses.world_from_camera)
        assert any("frame of the IMU" in note for note in views.notes)
    np.testing.assert_allclose(*found, rtol=0, atol=1e-14)
    np.testing.assert_allclose(found[1] @ steps, np.tile(np.eye(4), (2, 1, 1)), atol=1e-14)


@pytest.mark.parametrize(
    ("names", "words"),
    [("cam0 cam2", "cam0, cam1 wanted, .* got cam0, cam2"), ("cam1", "cam0 wanted, .* got cam1")],
)
def test_no_camera_of_a_chain_with_a_gap_is_left_out(tmp_path, names, words):
    path = camchain(tmp_path / "c.yaml", (*LENSES[0], {}))
    (camera,) = yaml.safe_load(path.read_text()).values()
    path.write_text(yaml.safe_dump(dict.fromkeys(names.split(), camera | {"T_cn_cnm1": [[1]]})))
    with pytest.raises(rc.CameraError, match=rf"{words}; number them from 0 without a gap"):
        read_views(path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"camera_model": "pinhol"}, "camera_model must be one of pinhole, omni"),
        ({"camera_model": "omni"}, r"intrinsics must be 5 numbers \(xi fx fy cx cy\), got 4"),
        ({"camera_model": "eucm", "distortion_model": "equi"}, "comes with camera model pinhole"),
        ({"distortion_coeffs": [1, 2]}, "distortion_coeffs must be 4 numbers"),
        ({"resolution": [752]}, "resolution must be 2 finite numbers"),
        ({"resolution": [752, -480]}, "height must be a whole number"),
        ({"intrinsics": [458.6, 457.3, 367.2, float("nan")]}, "intrinsics must be 4 finite"),
        ({"intrinsics": "many"}, "intrinsics must be up to 100 numbers"),
        ({"T_cam_imu": [[1, 0], [0, 1]]}, "T_cam_imu must be 4 x 4 or 16 finite numbers"),
        ({"T_cam_imu": np.diag([1, 1, 2, 1]).tolist()}, "pose 0 is not a rotation"),
        ({"T_cam_imu": np.diag([1, 1, 1, 2]).tolist()}, "pose 0 must end in the row 0 0 0 1"),
    ],
)
def test_each_fault_of_a_chain_is_one_line(tmp_path, change, words):
    path = camchain(tmp_path / "c.yaml", (*LENSES[0], {}))
    content = yaml.safe_load(path.read_text())
    content["cam0"] |= change
    if "T_cam_imu" in change:
        content["cam1"] = dict(content["cam0"])
    path.write_text(yaml.safe_dump(content))
    with pytest.raises((rc.CameraError, rc.PoseError), match=rf"^[^\n]*{words}[^\n]*$"):
        read_views(path)


CAMERA_INFO = """image_width: 640
image_height: 480
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [616.77, 0.0, 322.28, 0.0, 617.28, 241.43, 0.0, 0.0, 1.0]
distortion_model: {model}
distortion_coefficients:
  rows: 1
  cols: {n}
  data: {data}
rectification_matrix:
  rows: 3
  cols: 3
  data: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
projection_matrix:
  rows: 3
  cols: 4
  data: [610.0, 0.0, 320.0, 0.0, 0.0, 612.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0]
"""
MESSAGE = """header:
  seq: 0
  frame_id: camera
height: 480
width: 640
distortion_model: "{model}"
D: {data}
K: [616.77, 0.0, 322.28, 0.0, 617.28, 241.43, 0.0, 0.0, 1.0]
R: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
P: [610.0, 0.0, 320.0, 0.0, 0.0, 612.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0]
binning_x: 0
roi:
  x_offset: 0
  width: 0
---
"""
INFO = {
    "plumb_bob": [-0.2, 0.05, 0.001, -0.002, 0.01],
    "rational_polynomial": [-0.2, 0.05, 0.001, -0.002, 0.01, 0.02, 0.003, 0.001],
    "equidistant": EQUI,
}


@pytest.mark.parametrize("model", INFO)
@pytest.mark.parametrize("form", [CAMERA_INFO, MESSAGE], ids=["file", "message"])
def test_camera_info_projects_as_cv2_does(tmp_path, model, form):
    values = INFO[model]
    path = tmp_path / "info.yaml"
    path.write_text(form.format(model=model, n=len(values), data=values))
    views = read_views(path)
    rng = np.random.default_rng(0)
    rays = np.column_stack([rng.uniform(-0.4, 0.4, (20, 2)), np.ones(20)])
    k, zero = np.array([[616.77, 0, 322.28], [0, 617.28, 241.43], [0, 0, 1]]), np.zeros(3)
    if model == "equidistant":
        wanted, _ = cv2.fisheye.projectPoints(rays[None], zero, zero, k, np.array(values))
    else:
        wanted, _ = cv2.projectPoints(rays, zero, zero, k, np.array(values))
    found = lens_of(views.camera()).project(rays)
    np.testing.assert_allclose(found, wanted.reshape(-1, 2) + 0.5, rtol=0, atol=1e-9)
    assert any("raw images" in note for note in views.notes)


@pytest.mark.parametrize("model", INFO)
def test_what_we_write_for_ros_is_read_again(tmp_path, model):
    path = tmp_path / "info.yaml"
    values = INFO[model]
    path.write_text(CAMERA_INFO.format(model=model, n=len(values), data=values))
    views = read_views(path)
    out = tmp_path / "out.yaml"
    write_views(out, views, format="ros")
    assert yaml.safe_load(out.read_text())["distortion_model"] == model
    again = read_views(out)
    assert again.camera() == views.camera()
    assert again.rig.names == ("narrow_stereo",)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("plumb_bob", "barrel", "distortion_model must be one of none, plumb_bob"),
        ("[-0.2, 0.05", "[0.05", "distortion_coefficients: 1 x 5 numbers wanted, got 4"),
        ("616.77", ".nan", "camera_matrix must be 9 finite numbers"),
        ("image_width: 640", "image_width: 0", "image_width must be a whole number"),
        ("image_height: 480\n", "", "image_height is missing"),
    ],
)
def test_each_fault_of_a_camera_info_is_one_line(tmp_path, old, new, words):
    text = CAMERA_INFO.format(model="plumb_bob", n=5, data=INFO["plumb_bob"])
    path = tmp_path / "info.yaml"
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(rc.CameraError, match=rf"^[^\n]*{words}[^\n]*$"):
        read_views(path)
