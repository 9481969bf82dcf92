"""Calibrations that depth cameras and photogrammetry programs write, against cv2 and equations."""

import json
import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from view_files import (
    AZURE,
    LLFF,
    PIX4D,
    RAYS,
    REALSENSE,
    ZIVID,
    cv_pixels,
    has_note,
    motion,
    projects,
    refused,
    same,
)

import rastercov as rc
from rastercov.formats.cameras import read_views


def views_of(folder, name, text, **conventions):
    path = folder / name
    path.write_text(text)
    return read_views(path, conventions=rc.Conventions(**conventions))


def test_azure_kinect_has_parts_of_the_sides_and_a_metric_radius(tmp_path):
    text = json.dumps({"CalibrationInformation": {"Cameras": [AZURE]}})
    views = views_of(tmp_path, "a.json", text)
    camera = views.camera()
    cx, cy, fx, fy, *k, _, _, p2, p1 = AZURE["Intrinsics"]["ModelParameters"]
    # The SDK subtracts 0.5 from cx times the width, and counts pixels from their centres.
    matrix = np.array([[fx * 4096, 0, cx * 4096 - 0.5], [0, fy * 3072, cy * 3072 - 0.5], [0, 0, 1]])
    projects(camera, cv_pixels(RAYS, matrix, [*k[:2], p1, p2, *k[2:]]))
    assert math.isclose(math.tan(math.radians(camera.max_angle_deg)), 1.7)
    place = np.eye(4)
    place[:3, :3] = np.array(AZURE["Rt"]["Rotation"]).reshape(3, 3)
    place[:3, 3] = AZURE["Rt"]["Translation"]
    same(views.rig.rig_from_camera, [np.linalg.inv(place)])
    assert views.rig.names == ("LocationPV0",)
    assert has_note(views, "full sensor")


def test_realsense_has_a_camera_for_each_stream(tmp_path):
    views = views_of(tmp_path, "r.txt", REALSENSE)
    assert views.rig.names == ("Depth 640x480", "Color 1280x720")
    depth, color = views.cameras()
    k = np.array([[390.25, 0, 324.5], [0, 390.5, 233.5], [0, 0, 1]])
    projects(depth, cv_pixels(RAYS, k, [0.1, 0, 0.01, 0, 0]))
    assert color.is_pinhole
    assert (color.cx, color.cy, color.fx, color.height) == (642, 370, 912.75, 720)
    own = {"width": 640, "height": 480, "ppx": 324.5, "ppy": 233.5, "fx": 390.25, "fy": 390.5}
    own |= {"model": "distortion.brown_conrady", "coeffs": [0.1, 0, 0.01, 0, 0]}
    assert views_of(tmp_path, "r.json", json.dumps(own)).camera() == depth
    fisheye = own | {"model": "RS2_DISTORTION_KANNALA_BRANDT4", "coeffs": [0, 0, 0, 0, 0]}
    text = json.dumps(fisheye).replace("RS2_DISTORTION", "distortion")
    refused_model = tmp_path / "f.json"
    refused_model.write_text(text)
    refused(refused_model, "one of none, brown conrady, kannala brandt4")
    fisheye["model"] = "kannala_brandt4"
    camera = views_of(tmp_path, "f.json", json.dumps(fisheye)).camera()
    projects(camera, cv_pixels(RAYS, k, [0.0] * 4, fisheye=True))


def test_zivid_has_the_terms_of_opencv_and_no_image_size(tmp_path):
    camera = views_of(tmp_path, "z.yml", ZIVID, image_size=(1944, 1200)).camera()
    k = np.array([[2765, 0, 957.25], [0, 2767, 594.5], [0, 0, 1]])
    rays = RAYS / (2, 2, 1)
    projects(camera, cv_pixels(rays, k, [-0.27, 0.12, 0.0001, -0.0002, -0.03]), rays)
    refused(tmp_path / "z.yml", "--image-size")


@settings(max_examples=20, deadline=None)
@given(st.tuples(*[st.floats(-3, 3)] * 3), st.tuples(*[st.floats(-99, 99)] * 3))
def test_pix4d_has_the_center_and_camera_from_world(tmp_path_factory, turn, center):
    r = motion(turn, (0, 0, 0))[:3, :3]
    *head, _, _, _, _ = PIX4D.splitlines()
    lines = [*head, " ".join(map(repr, center)), *(" ".join(map(repr, row)) for row in r.tolist())]
    text = "\n".join([*lines, *lines[8:]])
    folder = tmp_path_factory.mktemp("files")
    views = views_of(folder, "p.txt", text, pixel_centre=0)
    wanted = np.eye(4)
    wanted[:3, :3], wanted[:3, 3] = r.T, center
    same(views.poses.world_from_camera, [wanted] * 2, 1e-9)
    assert views.images == ("DJI 0954.JPG",) * 2
    assert views.has_unit
    k = np.array([[3952.5, 0, 2233.25], [0, 3953.5, 1667.75], [0, 0, 1]])
    projects(views.camera(), cv_pixels(RAYS, k, [0.038, -0.017, 0.0024, 0.0029, 0.02]))
    refused(folder / "p.txt", "--pixel-centre")


def test_llff_has_columns_down_right_and_backward(tmp_path):
    path = tmp_path / "poses_bounds.npy"
    np.save(path, LLFF)
    for place in (path, tmp_path):
        views = read_views(place, conventions=rc.Conventions(pose_unit="m"))
        (pose,) = views.poses.world_from_camera
        down, right, back, center, hwf = LLFF[0, :15].reshape(3, 5).T
        same(pose[:3], np.column_stack([right, down, -back, center]))
        camera = views.camera()
        assert [camera.height, camera.width, camera.fx] == hwf.tolist()
    np.save(path, LLFF[:, :16])
    refused(path, "rows of 17 finite numbers, got (1, 16)")
