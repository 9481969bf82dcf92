"""Rotations of every format: rounding up to 1e-3 is removed, more is refused with its image."""

import json
import struct
from itertools import permutations

import numpy as np
import pytest
from view_files import ANSWERS, METASHAPE, SCENE, motion, refused

import rastercov as rc
from rastercov.core.mesh.arrays import quaternions_of
from rastercov.formats.cameras import read_views

POSE = motion([0.3, -0.7, 0.4], [0.5, -1.0, 4.0])
TURN = POSE[:3, :3]
QUATERNION = quaternions_of(TURN[None])[0]
CAMERA_TEXT = "1 SIMPLE_PINHOLE 640 480 500 320 240\n"


def words(array):
    return " ".join(map(repr, np.ravel(array).tolist()))


def colmap_text(folder, q, rig=QUATERNION):
    (folder / "cameras.txt").write_text(CAMERA_TEXT + "2" + CAMERA_TEXT[1:])
    images = [
        f"1 {words(QUATERNION)} 1 2 3 1 good.jpg\n\n",
        f"2 {words(q)} 1 2 3 2 bad one.jpg\n\n",
    ]
    (folder / "images.txt").write_text("".join(images))
    (folder / "rigs.txt").write_text(f"1 2 CAMERA 1 CAMERA 2 1 {words(rig)} 0.1 0 0\n")
    return folder


def colmap_rig(folder, q):
    return colmap_text(folder, QUATERNION, q)


def colmap_binary(folder, q):
    camera = struct.pack("<IiQQ3d", 1, 0, 640, 480, 500, 320, 240)
    (folder / "cameras.bin").write_bytes(struct.pack("<Q", 1) + camera)
    image = struct.pack("<I7dI", 7, *q, 1, 2, 3, 1) + b"bad one.jpg\0" + struct.pack("<Q", 0)
    (folder / "images.bin").write_bytes(struct.pack("<Q", 1) + image)
    return folder


def gltf(folder, q):
    node = {"camera": 0, "name": "bad one", "rotation": np.roll(q, -1).tolist()}
    (folder / "s.gltf").write_text(json.dumps(SCENE | {"nodes": [node]}))
    return folder / "s.gltf"


def pose_of(r):
    return np.vstack([np.column_stack([r, [1, 2, 3]]), [0, 0, 0, 1]])


def metashape(folder, r):
    text = METASHAPE.replace("1 0 0 1 0 1 0 2 0 0 1 3 0 0 0 1", words(pose_of(r)))
    (folder / "m.xml").write_text(text.replace('label="a"', 'label="bad one"'))
    return folder / "m.xml"


def metashape_chunk(folder, r):
    rotation = f"<rotation>{words(r)}</rotation><scale>"
    text = METASHAPE.replace("<scale>", rotation).replace('label="a"', 'label="bad one"')
    (folder / "m.xml").write_text(text)
    return folder / "m.xml"


def bundler(folder, r):
    rows = "\n".join(map(words, r))
    (folder / "b.out").write_text(f"# Bundle file v0.3\n1 0\n500 0.1 0.02\n{rows}\n1 2 3\n")
    return folder / "b.out"


def mvsnet(folder, r):
    rows = "\n".join(map(words, pose_of(r)))
    text = f"extrinsic\n{rows}\n\nintrinsic\n5 0 3\n0 5 2\n0 0 1\n\n1 2\n"
    (folder / "bad one_cam.txt").write_text(text)
    return folder / "bad one_cam.txt"


def nerfstudio(folder, r):
    frames = [{"transform_matrix": pose_of(r).tolist(), "file_path": "bad one.png"}]
    content = {"w": 640, "h": 480, "fl_x": 500, "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(content))
    return folder / "transforms.json"


def kalibr(folder, r):
    cameras = "".join(
        f"cam{row}:\n  camera_model: pinhole\n  intrinsics: [458, 457, 367, 248]\n"
        f"  distortion_model: none\n  distortion_coeffs: []\n  resolution: [752, 480]\n"
        f"  T_cam_imu: {json.dumps(pose_of(turn).tolist())}\n"
        for row, turn in enumerate((TURN, r))
    )
    (folder / "k.yaml").write_text(cameras)
    return folder / "k.yaml"


def opencv(folder, r):
    def matrix(name, value):
        rows, cols = np.shape(value)
        data = [float(each) for each in np.ravel(value)]
        return f"{name}: !!opencv-matrix\n  rows: {rows}\n  cols: {cols}\n  dt: d\n  data: {data}\n"

    k = [[500, 0, 320], [0, 500, 240], [0, 0, 1]]
    text = "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\n" + matrix("M1", k)
    text += matrix("M2", k) + matrix("D1", np.zeros((1, 5))) + matrix("D2", np.zeros((1, 5)))
    (folder / "stereo.yml").write_text(text + matrix("R", r) + matrix("T", [[0.1], [0], [0]]))
    return folder / "stereo.yml"


def bare(folder, r):
    np.save(folder / "poses.npy", pose_of(r)[None])
    return folder / "poses.npy"


OF_QUATERNIONS = {
    colmap_text: "image 'bad one.jpg'", colmap_binary: "image 'bad one.jpg'",
    colmap_rig: "rig_from_camera of 'camera 2'", gltf: "node 0",
}  # fmt: skip
OF_MATRICES = {
    metashape: "image 'bad one'", metashape_chunk: "image 'bad one'", bundler: "pose 0",
    mvsnet: "image 'bad one'", nerfstudio: "image 'bad one.png'", kalibr: "image 'cam1'",
    opencv: "image 'camera 2'", bare: "pose 0",
}  # fmt: skip
WRONG = {
    "larger": 1.0006 * np.eye(3), "smaller": 0.9993 * np.eye(3), "twice": 2 * np.eye(3),
    "mirrored": -np.eye(3), "sheared": np.eye(3) + 1.2e-3 * np.eye(3, k=1),
    "of no size": np.zeros((3, 3)),
}  # fmt: skip
SWAPPED = {
    "columns of another file": [2.69382, -4.16628, -0.620812, 0.996875],
    "zero": [0, 0, 0, 0],
    "a translation": [0.2, 0.1, 0.9, -3],
    "huge": [1e90, 0, 1e90, 0],
    "tiny": [1e-200, 0, 0, 0],
}


@pytest.mark.parametrize("scale", [1.0012, 0.9988, 2, -5])
@pytest.mark.parametrize("write", OF_QUATERNIONS)
def test_quaternions_of_another_length_are_refused_with_their_image(tmp_path, write, scale):
    path = write(tmp_path, scale * QUATERNION)
    refused(path, OF_QUATERNIONS[write], conventions=ANSWERS)


@pytest.mark.parametrize("name", SWAPPED)
@pytest.mark.parametrize("write", OF_QUATERNIONS)
def test_numbers_that_are_no_quaternion_are_refused_with_their_image(tmp_path, write, name):
    path = write(tmp_path, np.array(SWAPPED[name], float))
    refused(path, OF_QUATERNIONS[write], conventions=ANSWERS)


@pytest.mark.parametrize("name", WRONG)
@pytest.mark.parametrize("write", OF_MATRICES)
def test_matrices_that_are_no_rotation_are_refused_with_their_image(tmp_path, write, name):
    refused(write(tmp_path, TURN @ WRONG[name]), OF_MATRICES[write], conventions=ANSWERS)


@pytest.mark.parametrize("write", OF_MATRICES)
def test_columns_and_rows_that_are_not_square_are_refused_in_any_axes(tmp_path, write):
    for one, other in permutations(range(3), 2):
        shear = np.eye(3)
        shear[one, other] = 1.01e-3
        for r in (TURN @ shear, shear @ TURN):
            refused(write(tmp_path, r), OF_MATRICES[write], conventions=ANSWERS)


@pytest.mark.parametrize("off", [8e-4, -8e-4, 1e-5, 1e-9, 0])
@pytest.mark.parametrize("write", [*OF_QUATERNIONS, *OF_MATRICES])
def test_rotations_of_few_digits_are_those_they_round(tmp_path, write, off):
    if write is bare:
        off /= 1e3  # in our own files the limit is 1e-6
    exact, near = TURN, TURN * np.sqrt(1 + off)
    if write in OF_QUATERNIONS:
        exact, near = QUATERNION, QUATERNION * (1 + off)
    items, true = (
        read_views(write(tmp_path, each), conventions=ANSWERS).poses.world_from_camera
        for each in (near, exact)
    )
    np.testing.assert_allclose(items[:, :3, :3], true[:, :3, :3], rtol=0, atol=1e-12)
    np.testing.assert_allclose(items[:, :3, 3], true[:, :3, 3], rtol=0, atol=5 * abs(off) + 1e-12)


def test_images_of_another_length_are_left_out_where_that_is_asked_for(tmp_path):
    answers = rc.Conventions(pose_unit="m", skip_bad_poses=True)
    views = read_views(colmap_text(tmp_path, 5 * QUATERNION), conventions=answers)
    assert views.images == ("good.jpg",)
