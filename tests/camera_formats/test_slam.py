"""Calibrations and trajectories of SLAM programs, against cv2 and published equations."""

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from view_files import (
    BASALT,
    KITTI,
    OKVIS,
    OPEN3D,
    ORB_SLAM,
    RAYS,
    cv_pixels,
    motion,
    projects,
    refused,
    same,
)

import rastercov as rc
from rastercov.formats.cameras import basalt, read_views
from rastercov.formats.cameras.camodocal import MODELS as VINS_MODELS

NUMBERS = st.floats(-0.05, 0.05, allow_subnormal=False)
TURNS = st.tuples(*[st.floats(-3, 3)] * 3)
SHIFTS = st.tuples(*[st.floats(-9, 9)] * 3)
CENTRAL = {"fx": 400.0, "fy": 401.0, "cx": 318.5, "cy": 241.25}
K = np.array([[400.0, 0, 318.5], [0, 401.0, 241.25], [0, 0, 1]])


def views_of(tmp_path_factory, name, text, **conventions):
    path = tmp_path_factory.mktemp("files") / name
    path.write_text(text)
    return read_views(path, conventions=rc.Conventions(**conventions))


def wxyz(matrix):
    """Unit quaternion of a rotation by its eigenvector, which is the axis of the 4 x 4 form."""
    r = matrix[:3, :3]
    k = np.array([
        [r[0, 0] - r[1, 1] - r[2, 2], 0, 0, 0],
        [r[1, 0] + r[0, 1], r[1, 1] - r[0, 0] - r[2, 2], 0, 0],
        [r[2, 0] + r[0, 2], r[2, 1] + r[1, 2], r[2, 2] - r[0, 0] - r[1, 1], 0],
        [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], np.trace(r)],
    ])  # fmt: skip
    x, y, z, w = np.linalg.eigh(k / 3)[1][:, -1]
    return w, x, y, z


@settings(max_examples=20, deadline=None)
@given(TURNS, SHIFTS)
def test_open3d_has_columns_and_camera_from_world(tmp_path_factory, turn, shift):
    matrix = motion(turn, shift)
    own = {"extrinsic": matrix.T.ravel().tolist(), "intrinsic": OPEN3D}
    file = {"class_name": "PinholeCameraTrajectory", "parameters": [own, own]}
    views = views_of(tmp_path_factory, "t.json", json.dumps(file), pose_unit="mm")
    wanted = np.linalg.inv(matrix)
    wanted[:3, 3] /= 1000
    same(views.poses.world_from_camera, [wanted] * 2)
    one = views_of(tmp_path_factory, "p.json", json.dumps(own))
    assert not one.has_unit
    assert one.camera() == views.camera()
    projects(
        one.camera(), cv_pixels(RAYS, np.array([[500, 0, 319.5], [0, 501, 239.5], [0, 0, 1.0]]), [])
    )


@settings(max_examples=20, deadline=None)
@given(TURNS, SHIFTS)
def test_a_trajectory_of_tum_has_world_from_camera_in_metres(tmp_path_factory, turn, shift):
    matrix = motion(turn, shift)
    w, *xyz = wxyz(matrix)
    line = " ".join(map(repr, map(float, (*shift, *xyz, w))))
    views = views_of(tmp_path_factory, "t.txt", f"# tx\n1305031102.1758 {line}\n\n2 {line}\n")
    same(views.poses.world_from_camera, [matrix] * 2, 1e-9)
    assert views.images == ("1305031102.1758", "2")
    assert views.has_unit
    assert views.rig is None


@pytest.mark.parametrize("model", VINS_MODELS)
@settings(max_examples=10, deadline=None)
@given(st.lists(NUMBERS, min_size=9, max_size=9))
def test_lenses_of_vins_follow_their_equations(tmp_path_factory, model, values):
    ours, order, theirs = VINS_MODELS[model]
    names = (theirs or order).split()
    p = dict(zip(order.split(), [*CENTRAL.values(), *values], strict=False))
    p["xi"] = 1.5
    entries = "\n".join(
        f"  {theirs}: {p[name]!r}" for name, theirs in zip(order.split(), names, strict=True)
    )
    text = f"%YAML:1.0\n---\nmodel_type: {model}\nimage_width: 640\nimage_height: 480\n"
    camera = views_of(
        tmp_path_factory, "v.yaml", f"{text}projection_parameters:\n{entries}\n"
    ).camera()
    rays, d = (
        RAYS,
        np.array(
            [p[name] for name in ("k1", "k2")]
            + [p.get(name, 0) for name in ("p1", "p2", "k3", "k4", "k5", "k6")]
        ),
    )
    if model == "MEI":  # the sphere of radius 1, from a point at -xi
        ahead = RAYS[:, 2] + 1.5 * np.linalg.norm(RAYS, axis=1)
        rays, d = np.column_stack([RAYS[:, :2] / ahead[:, None], np.ones(20)]), d[:4]
    fisheye = ours == "opencv_fisheye"
    d = np.array([p[f"k{n}"] for n in range(1, 5)]) if fisheye else d
    projects(camera, cv_pixels(rays, K, d, fisheye=fisheye))


def test_the_rig_of_vins_fusion_is_read_with_the_files_of_its_cameras(tmp_path):
    steps = [motion([0.1, 0.2, 0.3], [1, 2, 3]), motion([0, 0.1, 0], [0.1, 0, 0])]
    camera = (
        "model_type: PINHOLE\ncamera_name: c\nimage_width: 640\nimage_height: 480\n"
        "distortion_parameters: {k1: 0.1, k2: 0, p1: 0, p2: 0}\n"
        "projection_parameters: {fx: 400, fy: 401, cx: 318.5, cy: 241.25}\n"
    )
    lines = ["%YAML:1.0", "num_of_cam: 2", "estimate_extrinsic: 0"]
    for row, step in enumerate(steps):
        lines += [f'cam{row}_calib: "c{row}.yaml"', f"body_T_cam{row}: !!opencv-matrix"]
        lines += ["  rows: 4", "  cols: 4", "  dt: d", f"  data: {step.ravel().tolist()}"]
        (tmp_path / f"c{row}.yaml").write_text(camera)
    path = tmp_path / "config.yaml"
    path.write_text("\n".join(lines))
    views = read_views(path)
    same(views.rig.rig_from_camera, steps)
    same(views.poses.world_from_camera, steps)
    assert views.rig.names == ("cam0", "cam1")
    assert views.has_unit
    path.write_text(path.read_text().replace("num_of_cam: 2", "num_of_cam: 1"))
    assert read_views(path).rig.names == ("cam0",)
    path.write_text(path.read_text().replace("num_of_cam: 1", "num_of_cam: 2"))
    (tmp_path / "c1.yaml").unlink()
    refused(path, "c1.yaml")
    mono = f"%YAML:1.0\n{camera}" + "".join(
        f"{name}: !!opencv-matrix\n  rows: 3\n  cols: 1\n  dt: d\n  data: {data.ravel().tolist()}\n"
        for name, data in (
            ("extrinsicRotation", steps[0][:3, :3]),
            ("extrinsicTranslation", steps[0][:3, 3]),
        )
    )
    path.write_text(mono)
    same(read_views(path).rig.rig_from_camera, steps[:1])


def test_okvis_has_its_cameras_on_the_imu(tmp_path):
    path = tmp_path / "o.yaml"
    path.write_text(OKVIS)
    views = read_views(path)
    turned = motion([0, 0, math.pi / 2], [-0.02, -0.06, 0.01])
    same(views.rig.rig_from_camera[0], turned)
    same(views.poses.world_from_camera[1, :3, 3], [-0.02, 0.05, 0.01])
    k = np.array([[458.6, 0, 367.2], [0, 457.3, 248.4], [0, 0, 1]])
    projects(views.cameras()[0], cv_pixels(RAYS, k, [-0.28, 0.07, 0.0002, 0.00002]))
    projects(views.cameras()[1], cv_pixels(RAYS, k, [0.01, 0.02, 0, 0], fisheye=True))
    path.write_text("imu0: {rostopic: /imu0, update_rate: 200.0}\n")
    refused(path, "got IMUs of Kalibr; name the camchain")


def test_poses_of_kitti_are_rows_of_world_from_camera(tmp_path):
    path = tmp_path / "00.txt"
    path.write_text(KITTI)
    views = read_views(path)
    wanted = [[1, 0, 0, 1.5], [0, 0, -1, 2.5], [0, 1, 0, 3.5], [0, 0, 0, 1]]
    same(views.poses.world_from_camera[0], wanted)
    assert views.images == ("line 1", "line 2")
    assert views.has_unit
    path.write_text(KITTI + "1 2 3\n")
    refused(path, "expected a line to be 12 finite numbers")


@pytest.mark.parametrize("seed", range(20))
def test_poses_of_kitti_may_begin_with_whole_numbers(tmp_path, seed):
    """A trajectory begins at the identity, which %g writes without points."""
    rng = np.random.default_rng(seed)
    turns = rng.choice([-math.pi / 2, 0, math.pi / 2], (4, 3)) * (rng.random((4, 1)) < 0.7)
    poses = np.array([motion(turn, rng.integers(0, 900, 3)) for turn in turns])
    poses[0] = np.eye(4) if seed % 2 else poses[0]
    path = tmp_path / "00.txt"
    end = str(rng.choice(["\n", "\r\n", " \n"]))
    lines = [
        " ".join(f"{abs(x):g}" if x == 0 else f"{x:g}" for x in row.ravel())
        for row in poses[:, :3].round(9)
    ]
    path.write_bytes("".join(line + end for line in lines).encode())
    same(read_views(path).poses.world_from_camera, poses, 1e-6)


@pytest.mark.parametrize("stereo", [True, False])
def test_settings_of_orb_slam_have_the_second_camera_in_the_frame_of_the_first(tmp_path, stereo):
    path = tmp_path / "o.yaml"
    text = ORB_SLAM if stereo else ORB_SLAM.replace("Stereo.T", "Other.T")
    path.write_text(text)
    views = read_views(path)
    first, second = views.cameras()
    k = np.array([[190.9, 0, 254.9], [0, 190.8, 256.8], [0, 0, 1]])
    projects(first, cv_pixels(RAYS, k, [0.0034, 0, 0, 0], fisheye=True))
    assert (second.cx, second.fy, second.width) == (253.0, 190.3, 512)
    assert len(views.poses) == 2 * stereo
    if stereo:
        same(views.rig.rig_from_camera[1], motion([0, 0, 0], [0.1, 0.02, 0]))


def test_older_settings_of_orb_slam_are_a_pinhole_and_may_lack_the_image_size(tmp_path):
    path = tmp_path / "TUM1.yaml"
    values = dict(CENTRAL, k1=0.26, k2=-0.95, p1=-0.005, p2=0.003, k3=1.16)
    path.write_text("%YAML:1.0\n" + "".join(f"Camera.{k}: {v}\n" for k, v in values.items()))
    refused(path, "--image-size")
    camera = read_views(path, conventions=rc.Conventions(image_size=(640, 480))).camera()
    projects(camera, cv_pixels(RAYS, K, [0.26, -0.95, -0.005, 0.003, 1.16]))


def test_a_rectified_pair_of_orb_slam_is_one_camera_and_says_so(tmp_path):
    path = tmp_path / "KITTI.yaml"
    values = {f"Camera1.{k}": v for k, v in CENTRAL.items()} | {"Stereo.b": 0.53}
    lines = ['Camera.type: "Rectified"', *(f"{k}: {v}" for k, v in values.items())]
    path.write_text("%YAML:1.0\n" + "\n".join(lines) + "\n")
    views = read_views(path, conventions=rc.Conventions(image_size=(640, 480)))
    assert len(views.cameras()) == 1
    assert any(note.startswith("left out Stereo.b") for note in views.notes)


def test_opencv_needs_no_space_after_a_colon(tmp_path):
    path = tmp_path / "stereo.yaml"
    lines = [f"Camera.{name}: {value}" for name, value in CENTRAL.items()]
    lines += ["Viewer.PointSize:2", "LEFT.height: 480", "LEFT.width:640", "LEFT.D: !!opencv-matrix"]
    lines += ["   rows: 1", "   cols: 4", "   dt: d", "   data:[0.1, 0, 0, 0]"]
    path.write_text("\n".join(["%YAML:1.0", *lines]))
    camera = read_views(path).camera()
    assert (camera.width, camera.height, camera.fx) == (640, 480, 400)
    path.write_text("\n".join(["# YAML", *lines]))
    refused(path, "expected valid YAML")


@pytest.mark.parametrize("model", basalt.MODELS)
@settings(max_examples=10, deadline=None)
@given(st.lists(NUMBERS, min_size=8, max_size=8), TURNS, SHIFTS)
def test_calibrations_of_basalt_follow_their_equations(
    tmp_path_factory, model, values, turn, shift
):
    names = basalt.MODELS[model].parameters.split()
    p = dict(zip(names, values, strict=False))
    p |= {name: 0.6 + p[name] for name in ("alpha", "beta", "w") if name in p}
    place = motion(turn, shift)
    w, x, y, z = wxyz(place)
    own = CENTRAL | p | ({"rpmax": 0.75} if model == "pinhole-radtan8" else {})
    content = BASALT | {
        "T_imu_cam": [
            dict(
                zip(
                    ("px", "py", "pz", "qw", "qx", "qy", "qz"),
                    map(float, (*shift, w, x, y, z)),
                    strict=True,
                )
            )
        ],
        "intrinsics": [{"camera_type": model, "intrinsics": own}],
    }
    views = views_of(tmp_path_factory, "b.json", json.dumps({"value0": content}))
    same(views.rig.rig_from_camera, [place], 1e-9)
    camera = views.camera()
    X, Y, Z = RAYS.T
    d = np.linalg.norm(RAYS, axis=1)
    a, depth = p.get("alpha", 0.0), Z
    if model == "ds":
        c = p["xi"] * d + Z
        depth = a * np.sqrt(X * X + Y * Y + c * c) + (1 - a) * c
    elif model in ("ucm", "eucm"):
        depth = a * np.sqrt(p.get("beta", 1) * (X * X + Y * Y) + Z * Z) + (1 - a) * Z
    elif model == "fov":
        r = np.hypot(X, Y)
        depth = r * p["w"] / np.arctan2(2 * r * math.tan(p["w"] / 2), Z)
    rays = np.column_stack([X / depth, Y / depth, np.ones(20)])
    names = ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"]
    fisheye = model == "kb4"
    k = [p[f"k{n}"] for n in range(1, 5)] if fisheye else [p.get(name, 0.0) for name in names]
    if model == "pinhole-radtan8":
        assert math.isclose(camera.max_angle_deg, math.degrees(math.atan(0.75)))
    projects(camera, cv_pixels(rays, K, k, fisheye=fisheye))


def test_a_sensor_of_euroc_is_at_its_place_on_the_body(tmp_path):
    place = motion([0.1, 0.2, 1.5], [-0.02, -0.06, 0.01])
    path = tmp_path / "sensor.yaml"
    for model, values in (
        ("radial-tangential", [-0.28, 0.07, 0.0002, 0.00002]),
        ("equidistant", [0.01, 0.02, 0, 0]),
    ):
        path.write_text(
            f"sensor_type: camera\nT_BS: {{rows: 4, cols: 4, data: {place.ravel().tolist()}}}\n"
            "resolution: [640, 480]\ncamera_model: pinhole\nintrinsics: [400, 401, 318.5, 241.25]\n"
            f"distortion_model: {model}\ndistortion_coefficients: {values}\n"
        )
        views = read_views(path)
        same(views.poses.world_from_camera, [place])
        projects(views.camera(), cv_pixels(RAYS, K, values, fisheye=model == "equidistant"))


LINE = "1 0 0 0 0 1 0 0 0 0 1 -2.5e-3"
CUT = "it ends within a line: its last number may be cut, and lines missing"


@pytest.mark.parametrize(
    ("name", "text"),
    [("00.txt", LINE), ("a.tum", "0 1 2 3 0 0 0 1.00000"),
     ("bundle.out", "# Bundle file v0.3\n1 0\n800 0 0\n1 0 0\n0 1 0\n0 0 1\n0 0 -1.25e-4")],
)  # fmt: skip
def test_a_file_that_ends_within_a_line_says_so(tmp_path, name, text):
    path, given = tmp_path / name, rc.Conventions(image_size=(9, 9), pose_unit=1.0)
    path.write_text(f"{text}\n")
    assert CUT not in "".join(read_views(path, conventions=given).notes)
    path.write_text(text[:-3])
    assert CUT in read_views(path, conventions=given).notes
