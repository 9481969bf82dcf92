"""Kalibr camchains and ROS camera_info, as their tools write them, against their equations."""

import numpy as np
import pytest
import yaml
from view_files import (
    RAYS,
    bent,
    by_angle,
    cv_pixels,
    has_note,
    motion,
    pixels,
    projects,
    refused,
    same,
)

from rastercov.core.camera.models import PROGRAMS
from rastercov.formats.cameras import read_views, write_views

RADTAN = [-0.28, 0.07, 0.0002, 0.00002]
EQUI = [-0.01, 0.02, -0.01, 0.003]
CENTRAL = [458.6, 457.3, 367.2, 248.4]


def camchain(path, *cameras):
    """A chain with what Kalibr's ConfigReader writes."""
    names = "camera_model", "intrinsics", "distortion_model", "distortion_coeffs"
    content = {}
    for row, (*values, others) in enumerate(cameras):
        own = {"cam_overlaps": [1], "resolution": [752, 480], "rostopic": f"/cam{row}/image_raw"}
        content[f"cam{row}"] = dict(zip(names, values, strict=True)) | own | others
    path.write_text(yaml.dump(content, default_flow_style=None, width=2147483647))
    return path


def by_equations(model, intrinsics, distortion, values):
    """Pixels of `RAYS`, counted from centres, from the papers' equations."""
    X, Y, Z = RAYS.T
    d = np.linalg.norm(RAYS, axis=1)
    own = intrinsics[:-4]
    w = Z
    if model == "omni":
        w = Z + own[0] * d
    elif model == "eucm":
        w = own[0] * np.sqrt(own[1] * (X * X + Y * Y) + Z * Z) + (1 - own[0]) * Z
    elif model == "ds":
        c = own[0] * d + Z
        w = own[1] * np.sqrt(X * X + Y * Y + c * c) + (1 - own[1]) * c
    xy = X / w, Y / w
    if distortion == "radtan":
        xy = bent(xy, values[:2], values[2:])
    elif distortion in ("equi", "equidistant"):
        xy = by_angle(RAYS, lambda t: t + sum(k * t ** (2 * i + 3) for i, k in enumerate(values)))
    elif distortion == "fov":
        r, (omega,) = np.hypot(*xy), values
        f = np.arctan(2 * r * np.tan(omega / 2)) / omega / r
        xy = xy[0] * f, xy[1] * f
    return pixels(xy, *intrinsics[-4:])


LENSES = [
    ("pinhole", CENTRAL, "radtan", RADTAN),
    ("pinhole", CENTRAL, "none", []),
    ("pinhole", CENTRAL, "equi", EQUI),
    ("pinhole", CENTRAL, "equidistant", EQUI),
    ("pinhole", CENTRAL, "fov", [0.9]),
    ("omni", [1.5, 900.0, 905.0, 367.2, 248.4], "radtan", [-0.1, 0.05, 0.0002, 0.00002]),
    ("omni", [1.5, 900.0, 905.0, 367.2, 248.4], "none", []),
    ("eucm", [0.6, 1.1, *CENTRAL], "none", []),
    ("eucm", [0.6, 1.1, *CENTRAL], "radtan", RADTAN),
    ("ds", [-0.2, 0.6, 358.6, 357.3, 367.2, 248.4], "none", []),
    ("ds", [-0.2, 0.6, 358.6, 357.3, 367.2, 248.4], "radtan", RADTAN),
]


def test_every_lens_of_kalibr_is_tested():
    assert {f"{model}-{distortion}" for model, _, distortion, _ in LENSES} == set(
        PROGRAMS["kalibr"]
    )


@pytest.mark.slow
@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: f"{lens[0]}-{lens[2]}")
def test_every_lens_of_kalibr_follows_its_equations(tmp_path, lens):
    views = read_views(camchain(tmp_path / "camchain.yaml", (*lens, {})))
    projects(views.camera(), by_equations(*lens) + 0.5)


def test_a_chain_gives_places_from_camera_to_camera(tmp_path):
    steps = [motion([0.01, 0.02, 0.0], [-0.11, 0, 0]), motion([0, 0.3, 0.1], [-0.2, 0.01, 0.02])]
    others = [{}, *({"T_cn_cnm1": step.tolist()} for step in steps)]
    chain = zip([LENSES[0], LENSES[2], LENSES[7]], others, strict=True)
    views = read_views(camchain(tmp_path / "c.yaml", *((*lens, its) for lens, its in chain)))
    assert views.has_unit
    assert views.images == ("cam0", "cam1", "cam2")
    # A point of camera 0 reaches camera 2 through both steps.
    same(np.linalg.inv(views.rig.rig_from_camera[2]), steps[1] @ steps[0])
    np.testing.assert_array_equal(views.poses.world_from_camera, views.rig.rig_from_camera)
    assert views.poses.camera.tolist() == [0, 1, 2]


@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize("name", ["T_cam_imu", "T_imu_cam"])
def test_places_on_the_imu_are_read_in_either_direction(tmp_path, name, flat):
    # OpenVINS has the inverse of Kalibr's matrix; some tools write one row of numbers.
    steps = np.array([motion([0.2, 0, 0.1 * i], [i, -0.1, 0.3]) for i in (1, 2)])
    given = steps if name == "T_cam_imu" else np.linalg.inv(steps)
    own = [{name: (each.ravel() if flat else each).tolist()} for each in given]
    views = read_views(camchain(tmp_path / "c.yaml", *((*LENSES[0], each) for each in own)))
    same(views.poses.world_from_camera @ steps, np.tile(np.eye(4), (2, 1, 1)))
    assert has_note(views, "frame of the IMU")


def test_a_chain_may_have_no_places(tmp_path):
    views = read_views(camchain(tmp_path / "c.yaml", *[(*LENSES[0], {})] * 2))
    assert (len(views.rig), len(views.poses)) == (2, 0)
    assert has_note(views, "cameras without poses")


CAMERA_INFO = """image_width: 640
image_height: 480
camera_name: narrow_stereo
camera_matrix: {{rows: 3, cols: 3, data: [616.77, 0, 322.28, 0, 617.28, 241.43, 0, 0, 1.0]}}
distortion_model: {model}
distortion_coefficients: {{rows: 1, cols: {n}, data: {data}}}
projection_matrix: {{rows: 3, cols: 4, data: [610.0, 0, 320, 0, 0, 612, 240, 0, 0, 0, 1, 0]}}
"""
MESSAGE = """header: {{seq: 0}}
height: 480
width: 640
distortion_model: "{model}"
D: {data}
K: [616.77, 0.0, 322.28, 0.0, 617.28, 241.43, 0.0, 0.0, 1.0]
P: [610.0, 0.0, 320.0, 0.0, 0.0, 612.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0]
binning_x: 1
roi: {{width: 0}}
---
"""
INFO = {
    "plumb_bob": [-0.2, 0.05, 0.001, -0.002, 0.01],
    "rational_polynomial": [-0.2, 0.05, 0.001, -0.002, 0.01, 0.02, 0.003, 0.001],
    "equidistant": EQUI,
}


@pytest.mark.parametrize("model", INFO)
@pytest.mark.parametrize("form", [CAMERA_INFO, MESSAGE], ids=["file", "message"])
def test_camera_info_projects_as_cv2_does_and_is_written_as_it_was(tmp_path, model, form):
    values = INFO[model]
    path, out = tmp_path / "info.yaml", tmp_path / "out.yaml"
    path.write_text(form.format(model=model, n=len(values), data=values))
    views = read_views(path)
    k = np.array([[616.77, 0, 322.28], [0, 617.28, 241.43], [0, 0, 1]])
    projects(views.camera(), cv_pixels(RAYS, k, values, fisheye=model == "equidistant"))
    assert has_note(views, "raw image")
    write_views(out, views, format="ros")
    assert yaml.safe_load(out.read_text())["distortion_model"] == model
    again = read_views(out)
    assert again.camera() == views.camera()
    assert again.rig.names == (("narrow_stereo",) if form is CAMERA_INFO else ("camera",))


@pytest.mark.parametrize(
    ("model", "n", "values", "kept"),
    [
        ("plumb_bob", 8, [-0.03, 0.03, -0.0001, -0.0001, -0.01, 0, 0, 0], 5),  # as Orbbec writes
        ("plumb_bob", 8, [-0.03, 0.03, -0.0001, -0.0001, -0.01, 0.02, 0.01, 0.003], 8),
        ("rational_polynomial", 5, [-0.03, 0.03, -0.0001, -0.0001, -0.01], 5),
        ("plumb_bob", 5, [0, 0, 0, 0, 0], 0),
    ],
)
def test_the_number_of_coefficients_decides_as_in_opencv(tmp_path, model, n, values, kept):
    path = tmp_path / "info.yaml"
    path.write_text(MESSAGE.format(model=model, n=n, data=values))
    views = read_views(path)
    k = np.array([[616.77, 0, 322.28], [0, 617.28, 241.43], [0, 0, 1]])
    projects(views.camera(), cv_pixels(RAYS, k, values))
    assert len(views.camera().distortion) == kept
    assert has_note(views, "is rational_polynomial") == (kept == 8)


def test_binning_and_a_region_of_interest_give_the_pixels_of_the_image_that_was_taken(tmp_path):
    path = tmp_path / "info.yaml"
    values = INFO["plumb_bob"]
    text = MESSAGE.format(model="plumb_bob", data=values)
    roi = "roi: {x_offset: 100, y_offset: 40, width: 401, height: 300, do_rectify: false}"
    text = text.replace("binning_x: 1", "binning_x: 4\nbinning_y: 2").replace(
        "roi: {width: 0}", roi
    )
    path.write_text(text)
    views = read_views(path)
    camera = views.camera()
    assert (camera.width, camera.height) == (100, 150)
    assert has_note(views, "100 x 150 px, of 640 x 480")
    k = np.array([[616.77, 0, 322.28], [0, 617.28, 241.43], [0, 0, 1]])
    rays = RAYS / (2, 2, 1) - (0.1, 0.1, 0)
    projects(camera, (cv_pixels(rays, k, values) - (100, 40)) / (4, 2), rays)
    path.write_text(text.replace("x_offset: 100", "x_offset: 300"))
    refused(path, "expected roi to be within 640 x 480 px")


def test_one_camera_on_an_imu_is_in_the_frame_of_the_imu(tmp_path):
    place = motion([0.2, 0, 0.1], [1, -0.1, 0.3])
    views = read_views(camchain(tmp_path / "c.yaml", (*LENSES[0], {"T_imu_cam": place.tolist()})))
    same(views.poses.world_from_camera, [place])


def test_what_a_calibration_lacks_stands_beside_it_for_each_of_its_cameras(tmp_path):
    camchain(tmp_path / "c.yaml", *[(*LENSES[4], {})] * 2)
    (tmp_path / "c.toml").write_text('file = "c.yaml"\nmax_angle_deg = 40\nnear = 0.25\n')
    for camera in read_views(tmp_path / "c.toml").cameras():
        assert (camera.max_angle_deg, camera.near, camera.model) == (40, 0.25, "fov")
