"""transforms.json of nerfstudio and instant-ngp, against cv2 and the axes of OpenGL."""

import json
import math

import numpy as np
import pytest
from view_files import (
    RAYS,
    bent,
    cv_pixels,
    has_note,
    motion,
    pixels,
    pixels_of,
    projects,
    refused,
    same,
    slopes,
)

import rastercov as rc
from rastercov.formats.cameras import read_views, write_views

INTRINSICS = {"fl_x": 500.0, "fl_y": 505.0, "cx": 318.5, "cy": 242.0, "w": 640, "h": 480}
TURN = np.array([[0.0, 0, 1, 2], [1, 0, 0, 3], [0, 1, 0, 4], [0, 0, 0, 1]])


def write(path, frames=None, **entries):
    """A file with two frames, or these."""
    if frames is None:
        frames = [{"file_path": f"./images/{i}.png", "transform_matrix": pose(i)} for i in (0, 1)]
    path.write_text(json.dumps({**entries, "frames": frames}))
    return path


def pose(row):
    """A camera 4 from the origin on +z, moved to the side, that looks along -z with y up."""
    return [[1, 0, 0, 0.1 * row], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]


def test_axes_are_those_of_opengl(tmp_path):
    views = read_views(write(tmp_path / "transforms.json", **INTRINSICS))
    # A point to the right of the axis and above it, of a camera that looks along -z.
    pixels = pixels_of(views, np.array([(0.4, 0.8, 0.0)]))[0]
    same(pixels, [(318.5 + 500 * 0.1, 242 - 505 * 0.2)], 1e-9)
    assert views.images == ("./images/0.png", "./images/1.png")
    assert not views.has_unit


@pytest.mark.parametrize("given", ["k1", "distortion_params", "fisheye"])
def test_lenses_are_those_of_cv2(tmp_path, given):
    k, more = {"k1": 0.02, "k2": -0.01, "p1": 0.001, "p2": -0.002}, {}
    if given == "fisheye":
        k, more = {"k1": 0.02, "k2": -0.01, "k3": 0.003, "k4": 0.001}, {"is_fisheye": True}
    values = k
    if given == "distortion_params":
        values = {given: [0.02, -0.01, 0, 0, 0.001, -0.002]}
    views = read_views(write(tmp_path / "transforms.json", **INTRINSICS, **values, **more))
    matrix = np.array([[500, 0, 318], [0, 505, 241.5], [0, 0, 1]])
    wanted = cv_pixels(RAYS, matrix, list(k.values()), fisheye=given == "fisheye")
    projects(views.camera(), wanted)


@pytest.mark.parametrize(
    "given",
    [
        {"w": 1000, "h": 500},
        {"w": 1000, "h": 500, "fl_x": 500, "fl_y": 500, "cx": 500, "cy": 250},
        {"w": 1000, "h": 400, "fl_x": 500, "fl_y": 500, "cx": 480, "cy": 210},
        {"w": 640, "h": 480, "fl_x": 320, "fl_y": 480},
    ],
)
def test_panoramas_are_those_of_nerfstudio(tmp_path, given):
    path = write(tmp_path / "transforms.json", camera_model="EQUIRECTANGULAR", **given)
    views = read_views(path, conventions=rc.Conventions(pose_unit="m"))
    # nerfstudio, cameras.py: directions of pixels, y up and -z forward.
    w, h = given["w"], given["h"]
    u, v = np.meshgrid(np.linspace(0.1, 0.9, 7) * w, np.linspace(0.3, 0.7, 5) * h)
    x = (u - given.get("cx", w / 2)) / given.get("fl_x", w / 2)
    y = -(v - given.get("cy", h / 2)) / given.get("fl_y", h)
    theta, phi = -np.pi * x, np.pi * (0.5 - y)
    rays = [-np.sin(theta) * np.sin(phi), -np.cos(phi), np.cos(theta) * np.sin(phi)]
    wanted = np.stack([u, v], axis=-1).reshape(-1, 2)
    projects(views.camera(), wanted, np.stack(rays, axis=-1).reshape(-1, 3))
    write_views(tmp_path / "transforms_again.json", views)
    again = read_views(tmp_path / "transforms_again.json").camera()
    assert (again.width, again.height) == (w, h)
    assert list(again.to_json().values()) == pytest.approx([*views.camera().to_json().values()])


def test_k4_of_a_brown_lens_is_of_r8(tmp_path):
    k = {"k1": -0.1, "k2": 0.02, "k3": 0.003, "k4": 0.04, "p1": 0.001, "p2": -0.002}
    views = read_views(write(tmp_path / "transforms.json", **INTRINSICS, **k))
    xy = bent(slopes(RAYS), [k[f"k{i}"] for i in range(1, 5)], (k["p1"], k["p2"]))
    projects(views.camera(), pixels(xy, 500, 505, 318.5, 242))


def test_frames_may_have_their_own_intrinsics(tmp_path):
    frames = [
        {"file_path": "a", "transform_matrix": pose(0)},
        {"file_path": "b", "transform_matrix": pose(1), "fl_x": 900},
        {"file_path": "c", "transform_matrix": pose(2)},
    ]
    views = read_views(write(tmp_path / "transforms.json", frames, **INTRINSICS))
    assert [views.cameras()[row].fx for row in views.poses.camera] == [500, 900, 500]
    assert len(views.rig) == 2


@pytest.mark.parametrize(
    ("shared", "own"),
    [
        ({"fl_x": 500.0, "fl_y": 500.0}, {"camera_angle_x": 0.9}),
        ({"fl_x": 500.0, "fl_y": 480.0}, {"fl_x": 600.0}),
        ({"camera_angle_x": 0.9, "camera_angle_y": 0.6}, {"x_fov": 40.0}),
        ({"fl_x": 500.0, "distortion_params": [0.1, 0, 0, 0, 0, 0]}, {"k1": 0.2, "p2": 0.01}),
        ({"fl_x": 500.0, "k1": 0.1}, {"distortion_params": [0.2, 0, 0, 0, 0, 0]}),
        ({"fl_x": 500.0, "is_fisheye": True}, {"camera_model": "OPENCV", "k1": 0.1}),
        ({"fl_x": 500.0, "camera_model": "OPENCV"}, {"is_fisheye": True, "k1": 0.1}),
    ],
    ids=lambda entries: " ".join(entries),
)
def test_an_entry_of_a_frame_replaces_its_alternatives_in_the_file(tmp_path, shared, own):
    size = {"w": 640, "h": 480}
    frame = {"file_path": "a.png", "transform_matrix": pose(0)}
    mixed = read_views(write(tmp_path / "transforms.json", [frame | own], **size, **shared))
    rest = {"fl_x": 500.0} if not {"fl_x", "camera_angle_x", "x_fov"} & own.keys() else {}
    alone = read_views(write(tmp_path / "transforms.json", [frame | own | rest], **size))
    assert mixed.cameras() == alone.cameras()


def test_angles_give_the_focal_length(tmp_path):
    path = write(tmp_path / "t.json", w=640, h=480, camera_angle_x=2 * math.atan(0.5))
    camera = read_views(path).camera()
    assert (camera.fx, camera.fy) == pytest.approx((640, 640))
    path = write(tmp_path / "t.json", camera_angle_x=1.0)
    refused(path, "expected an image size, got none in")
    assert read_views(path, conventions=rc.Conventions(image_size=(640, 480))).camera().cx == 320


def test_an_applied_transform_is_said_and_undone_on_demand(tmp_path):
    path = write(
        tmp_path / "t.json", **INTRINSICS, applied_transform=TURN[:3].tolist(), applied_scale=2.0
    )
    views = read_views(path)
    assert has_note(views, "undoes its applied_transform")
    assert has_note(views, "applied_scale 2")
    original = read_views(path, conventions=rc.Conventions(original_world=True))
    assert original.notes == ()
    plain = read_views(write(tmp_path / "u.json", **INTRINSICS)).poses.world_from_camera
    wanted = np.linalg.inv(TURN) @ plain
    wanted[:, :3, 3] /= 2
    same(original.poses.world_from_camera, wanted)


def test_matrices_in_float32_are_made_orthonormal_and_skewed_ones_refused(tmp_path):
    matrix = motion([0.3, -0.2, 0.5], [0, 0, 0]).astype(np.float32).astype(float)
    matrix[:3, :3] *= 1 + 3e-6
    frames = [{"file_path": "a", "transform_matrix": matrix.tolist()}]
    views = read_views(write(tmp_path / "t.json", frames, **INTRINSICS))
    assert has_note(views, "made orthonormal, off by up to 6e-06")
    matrix[0, 0] += 0.1
    frames = [{"file_path": "a", "transform_matrix": matrix.tolist()}]
    refused(
        write(tmp_path / "t.json", frames, **INTRINSICS),
        "pose 0 (from 0): expected a rigid transform",
    )


@pytest.mark.parametrize(
    ("model", "distortion"), [("eucm", (0.5, 1.0)), ("opencv", (0.1, 0, 0, 0, 0, 0.2, 0, 0))]
)
def test_a_lens_without_a_model_is_refused_by_name(tmp_path, model, distortion):
    camera = rc.Camera(width=640, height=480, fx=400, fy=400, model=model, distortion=distortion)
    views = rc.Views(rc.Rig([camera], ["left"]), rc.Poses.of(np.eye(4)), ("a",))
    path = tmp_path / "transforms.json"
    with pytest.raises(rc.CameraError, match=f"left: expected a lens of nerfstudio, got {model}"):
        write_views(path, views)
    assert not path.exists()
