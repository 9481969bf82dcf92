"""Damaged files of every format: views, or one line of our own; never another error, nor long."""

import json
import re
import struct
from copy import deepcopy
from functools import reduce
from itertools import product
from operator import getitem

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from nightly import amount
from view_files import ALICEVISION, ANSWERS, METASHAPE, OPENMVG, good_files, refused

import rastercov as rc
from rastercov.formats.cameras import READERS, WRITERS, read_views, write_views
from rastercov.formats.cameras.source import Source


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    files = good_files(tmp_path_factory.mktemp("good"))
    return {name: (path, path.read_bytes()) for name, path in files.items()}


@pytest.fixture
def file(good, name):
    """Path and content of a good file, which may be changed."""
    path, data = good[name]
    yield path, data
    path.write_bytes(data)


NAMES = sorted({*READERS, "ini", "rig"} - {"colmap"})
NAMES += [f"{kind} {name}" for kind in ("text", "binary") for name in ("cameras", "images")]
TREES = [
    *("alicevision", "azure", "basalt", "bop", "camodocal", "euroc", "kalibr", "nerfstudio"),
    *("odm", "okvis", "open3d", "opencv", "openmvg", "opensfm", "orbslam", "rastercov", "rig"),
    *("ros", "zivid"),
]
"""Formats of JSON and YAML."""
every_file = pytest.mark.parametrize("name", NAMES)


def read_or_one_line(path):
    try:
        views = read_views(path, conventions=ANSWERS)
    except (rc.CameraError, rc.PoseError, rc.ConfigError, rc.ResourceError) as error:
        text = str(error)
        assert "\n" not in text
        assert len(text) < 700
        assert path.name in text or path.parent.name in text
    else:
        assert np.isfinite(views.poses.world_from_camera).all()


@pytest.mark.parametrize("name", ["poses.npy", "poses_bounds.npy"])
def test_arrays_that_claim_more_than_memory_are_refused_in_one_line(tmp_path, name):
    with (tmp_path / name).open("wb") as file:
        header = {"descr": "<f8", "fortran_order": False, "shape": (99999999999, 17)}
        np.lib.format.write_array_header_1_0(file, header)
        file.write(bytes(136))
    with pytest.raises(
        rc.ResourceError, match=rf"{name}: expected .* that fit in memory, got more"
    ):
        read_views(tmp_path / name)


@every_file
def test_good_files_are_read(file):
    views = read_views(file[0], conventions=ANSWERS)
    assert views.rig or len(views.poses)


OTHERS = [None, "x", "", -1, 0, 1e300, [], {}, True, [[]], [1], [1, 2, 3], 2**70, [None], {"a": 1}]


def places_in(value, way=()):
    """Ways to all values in a tree; of a list to the first ones."""
    if way:
        yield way
    for key in value if isinstance(value, dict) else range(min(4, len(value))):
        below = value[key]
        if isinstance(below, dict | list):
            yield from places_in(below, (*way, key))
        else:
            yield (*way, key)


@pytest.mark.parametrize("name", TREES)
def test_long_texts_and_names_are_read_or_refused_in_a_short_line(file):
    path, _ = file
    read = Source(path).table
    for way in places_in(read):
        for is_name in (False, True):
            content = deepcopy(read)
            parent = reduce(getitem, way[:-1], content)
            value = parent[way[-1]]
            if is_name and isinstance(parent, dict):
                del parent[way[-1]]
                parent["x" * 9_000] = value
            elif isinstance(value, str):
                parent[way[-1]] = "x" * 9_000
            path.write_text(json.dumps(content))
            read_or_one_line(path)


@pytest.mark.parametrize("name", TREES)
def test_values_of_another_type_are_read_or_refused_in_one_line(file):
    path, data = file
    read = Source(path).table
    rng = np.random.default_rng(len(data))
    every = list(product(places_in(read), [*OTHERS, KeyError]))
    for row in rng.permutation(len(every))[: amount(40, 2_000)]:
        way, value = every[row]
        tree = deepcopy(read)
        inner = reduce(getitem, way[:-1], tree)
        inner[way[-1]] = value
        if value is KeyError:
            del inner[way[-1]]
        head = "%YAML:1.0\n---\n" if data.startswith(b"%") else ""
        path.write_text(head + json.dumps(tree))
        read_or_one_line(path)


@pytest.mark.slow
@every_file
def test_cut_files_are_read_or_refused_in_one_line(file):
    path, data = file
    for cut in np.linspace(0, len(data), amount(20, at_night=60)).astype(int).tolist():
        path.write_bytes(data[:cut])
        read_or_one_line(path)


PIECES = b'\0 \xff - 9 e999 nan { [ < ] " null 1e400 \n true &a_*a_ : !!x_'.split(b" ")
PIECES += [b" ", struct.pack("<d", float("nan")), struct.pack("<Q", 2**63)]


@pytest.mark.slow
@every_file
@settings(
    max_examples=amount(15, 100),
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    st.lists(
        st.tuples(st.floats(0, 1), st.integers(0, 8), st.sampled_from(PIECES)),
        min_size=1, max_size=4,
    )
)  # fmt: skip
def test_damaged_files_are_read_or_refused_in_one_line(file, damage):
    path, whole = file
    broken = bytearray(whole)
    for place, length, piece in damage:
        at = int(place * len(broken))
        broken[at : at + length] = piece.replace(b"_", b" ")
    path.write_bytes(bytes(broken))
    read_or_one_line(path)


TURNED = [[0, 0, 1, 0]] * 4
CAMERA = {"name": "a", "width": 9, "height": 9, "fx": 9, "fy": 9}
RING = [{"children": [1]}, {"children": [0], "camera": 0}]
IMAGE = "1 1.0 0.0 0.0 0.0 0.0 0.0 1.0 1 a.png"
FAULTS = [
    ("kalibr", ("pinhole", "pinhol"), "camera_model to be one of pinhole, omni"),
    ("kalibr", ("pinhole", "omni"), "intrinsics (xi fx fy cx cy) to be 5 finite"),
    ("kalibr", ("radtan", "fov"), "distortion_coeffs (omega) to be 1 finite"),
    ("kalibr", ("ds\n", "ds\n  distortion_model: equi\n"), "distortion_model"),
    ("kalibr", ("none", "equi"), "camera_model to be pinhole"),
    ("kalibr", ("[752, 480]", "[752, -480]"), "height to be a whole number"),
    ("kalibr", ("[458.6, 457.3, 367.2, 248.4]", "many"), "intrinsics (fx fy cx cy) to be 4"),
    ("kalibr", ("[0, 0, 1, 0], ", ""), "T_cn_cnm1 to be 4 x 4 or 16 finite numbers"),
    ("kalibr", ("[0, 0, 1, 0]", "[0, 0, 2, 0]"), "pose 1 (from 0): expected a rigid transform"),
    ("kalibr", ("[0, 0, 0, 1]", "[0, 0, 0, 2]"), "got one that does not end in the row"),
    ("kalibr", ("cam1", "cam2"), "cam0, cam1, ..., got cam0, cam2; number them"),
    ("kalibr", ("cam0", "cam1_"), ", got a table"),
    ("azure", ("BrownConrady", "Rational6KT"), "ModelType to be one of CALIBRATION_LensDist"),
    ("azure", ("1.3, 0, 0,", "1.3, 0.1, 0,"), "without a center of distortion, got [0.1, 0.0]"),
    ("realsense", ("0  \t0  \t0  \t0  \t0", "1  \t0  \t0  \t0  \t0"), "stream Color: expected"),
    ("realsense", ("PPX", "QQX"), "stream Depth: expected ppx, got none"),
    ("zivid", ("K3: -0.03, ", ""), "CameraIntrinsics, Distortion: expected K3, got none"),
    ("pix4d", ("0 0 1\n", ""), "expected 9 lines of numbers for each image"),
    ("pix4d", ("21.5", "x"), "DJI 0954.JPG: expected the numbers to be 3 finite numbers"),
    ("open3d", {"intrinsic_matrix": [1, 2]}, "intrinsic_matrix to be 9 finite numbers, got [1, 2]"),
    ("basalt", ('"ds"', '"spline"'), "camera_type to be one of pinhole, pinhole-radtan8, kb4"),
    ("basalt", ("[[640, 480]]", "[]"), "resolution to be 2 finite numbers, got"),
    ("basalt", ('"px": 1.0, ', ""), "T_imu_cam 0: expected px, got none"),
    ("camodocal", ("KANNALA_BRANDT", "SCARAMUZZA"), "model_type to be one of PINHOLE"),
    ("camodocal", ("k2: -0.02, ", ""), "expected k2, got none"),
    ("orbslam", ("KannalaBrandt8", "Omni"), "to be one of PinHole, KannalaBrandt8, Rectified"),
    ("orbslam", ("Camera2.cy", "camera2.cy"), "expected Camera2.cy, got none"),
    ("euroc", ("camera\n", "imu\n"), "expected sensor_type camera, got imu"),
    ("tum", ("0 0 0 1", "0 0 1"), "8 numbers per line"),
    ("tum", ("0 0 0 1", "0 0 0 x"), "the lines to be 2 x 7 finite numbers"),
    ("ros", ("plumb_bob", "barrel"), "distortion_model to be one of none, plumb_bob"),
    ("ros", ("[0.1, ", "["), "distortion_coefficients: expected 1 x 5 numbers, got 4"),
    ("ros", ("500.0", ".nan"), "camera_matrix to be 9 finite numbers"),
    ("ros", ("image_height: 480\n", ""), "expected image_height, got none"),
    ("metashape", ('type="frame"', 'type="rpc"'), "its type to be one of frame"),
    ("metashape", ("<f>500</f>", ""), "expected f, got none"),
    ("metashape", ("<f>500</f>", "<fx>500</fx>"), "expected fy, got none"),
    ("metashape", ('480"/><f', '-480"/><f'), "height to be a whole number"),
    ("metashape", ("0.5", "-1"), "scale to be positive"),
    ("metashape", ("<k1>", "<p3>0.25</p3><k1>"), "expected no term p3"),
    ("metashape", ('"frame"', '"spherical"'), "a spherical image of 2:1"),
    ("metashape", ("<chunk", "<nothing"), "XML"),
    ("metashape", ("<document", "<!DOCTYPE o><document"), "without a document type"),
    ("opensfm", ("brown", "dual"), "projection_type to be one of"),
    ("opensfm", ('"focal_x": 0.8, ', ""), "expected focal, got none"),
    ("opensfm", ('"camera": "c"', '"camera": "v3"'), "camera to be one of c, got 'v3'"),
    ("opensfm", ("0.1, 0.2, 0.3", "0.1, 0.2"), "rotation to be 3 finite numbers"),
    ("opensfm", {"cameras": {}}, "a reconstruction with cameras"),
    ("bundler", ("500", "5_0"), "numbers of cameras to be 15 finite numbers"),
    ("bundler", ("500", "-5"), "expected fx to be positive, got -5"),
    ("bundler", ("500", "0"), "cameras with a focal length, got none"),
    ("bundler", ("1 0", "999999999 0"), "999999999 cameras, got numbers for fewer"),
    ("bal", ("1 1 1", "999999999 1 1"), "999999999 cameras, got numbers for fewer"),
    ("bal", ("1 1 1", "1 1 999999999"), "999999999 lines of observations, got"),
    ("bal", ("500", "nan"), "numbers of cameras to be 9 finite numbers"),
    ("mvsnet", ("5 0 3\n0", "5 0 3\n1"), "intrinsic to be [[fx, skew, cx]"),
    ("scene", {"nodes": [{}]}, "a node with a camera"),
    ("scene", {"nodes": [{"camera": 3}]}, "the objects of 'cameras', got 3"),
    ("scene", {"nodes": RING}, "expected nodes that form a tree, got a cycle"),
    ("scene", {"nodes": [{"camera": 0, "matrix": [0] * 15 + [1]}]}, "pose 0 (from 0): expected"),
    ("scene", {"nodes": [{"camera": 0, "rotation": [0] * 4}]}, "quaternion of length 1, got"),
    ("scene", ('"yfov": 1.0', '"yfov": 4'), "yfov to be above 0"),
    ("scene", ('"aspectRatio": 1.3', '"aspectRatio": 2.3'), "give one that fits"),
    ("scene", ('"perspective",', '"orthographic",'), "expected orthographic, got none"),
    ("nerfstudio", {"w": 640.5}, "w to be a whole number"),
    ("nerfstudio", {"fl_x": "500"}, "fl_x to be a finite number, got '500'"),
    ("nerfstudio", {"fl_x": None, "fl_y": None}, "expected fl_x, got none"),
    ("nerfstudio", {"fl_x": None, "fl_y": None, "x_fov": 180}, "x_fov to be above 0"),
    ("nerfstudio", {"camera_model": "THIN"}, "camera_model to be one of"),
    ("nerfstudio", {"camera_model": "OPENCV_FISHEYE", "p1": 1}, "p1 and p2 to be 0"),
    ("nerfstudio", {"camera_model": "FISHEYE624"}, "expected distortion_params, got none"),
    ("nerfstudio", {"is_latlong": True}, "expected a pinhole, opencv or fisheye lens, got f-theta"),
    ("nerfstudio", {"frames": []}, "frames with a transform_matrix"),
    ("nerfstudio", {"frames": [3]}, "frames 0: expected a table"),
    ("nerfstudio", {"frames": [{"transform_matrix": [[1, 2]]}]}, "4 x 4 or 3 x 4 finite numbers"),
    ("nerfstudio", {"frames": [{"transform_matrix": TURNED, "file_path": 3}]}, "to be a string"),
    ("nerfstudio", {"applied_transform": [[0] * 4] * 3}, "got a singular one"),
    ("rastercov", {"cameras": []}, "at least one camera"),
    ("rastercov", {"cameras": {"a": {"width": 3}}}, "cameras to be a list of tables"),
    ("rastercov", {"cameras": [{"name": "a", "width": 3}]}, "'a': expected image size"),
    ("rastercov", {"cameras": [CAMERA] * 2}, "each name of a camera once, got 'a' twice"),
    ("rastercov", {"camera": [0, 1]}, "camera to be 2 indices or names of 1 cameras"),
    ("rastercov", {"cameras": None, "camera": [0, 0]}, "camera to be 2 names of cameras"),
    ("rastercov", {"camera": None, "cameras": [CAMERA, CAMERA | {"name": "b"}]},
     "expected the camera of each pose, one of 2, got none"),
    ("rastercov", {"images": ["a"]}, "images to be 2 strings"),
    ("rastercov", {"rig_from_camera": [[1]]}, "rig_from_camera to be 1 x 4 x 4"),
    ("rastercov", {"world_from_camera": [[1]]}, "expected poses of shape (P, 4, 4), got (1, 1)"),
    ("text cameras", ("OPENCV", "PINHOL"), "the model to be one of SIMPLE_PINHOLE"),
    ("text cameras", ("OPENCV", "PINHOLE"), "for PINHOLE, got 8"),
    ("text cameras", ("480 500.0 500.0 320.0 240.0 0.1 0.0 0.0 0.0", ""), "the height, got"),
    ("text cameras", ("0.1", "1_0"), "a parameter to be a number"),
    ("text cameras", ("500.0", "nan"), "fx to be finite"),
    ("text cameras", ("1 OPENCV", "#"), "expected 1 cameras, as the header says, got 0"),
    ("text images", ("1 a.png", "7 a.png"), "for image 'a.png', got 7"),
    ("text images", ("\n2 ", "\n1 "), "expected each image once, got 1 twice"),
    # A line of 12 words whose every third could be the id of a point, but for the last.
    ("text images", ("1 a.png\n", f"1 a.png a b\n{IMAGE[:-7]}7 a.png a b"), "the points of image"),
    ("opencv", ("500.0", ".Nan"), "camera_matrix to have finite numbers"),
    ("opencv", ("0.1, ", ""), "distortion_coefficients: expected 5 x 1 numbers, got 4"),
    ("opencv", ("fisheye_model: 0", "fisheye_model: 2"), "fisheye_model to be 0 or 1, got 2"),
    ("opencv", ("fisheye_model: 0", "N: [[7, 0, 3], [0, 7, 2], [0, 0, 1]]"), "one camera matrix"),
    ("opencv", ("fisheye_model: 0", "D: [0, 0, 0, 0, 0]"), "one vector of distortion"),
    ("opencv", ("fisheye_model: 0", "camera_model: equidistant"), "of a fisheye, got 5"),
    ("opencv", ("fisheye_model: 0", "image_width: 3"), "'image_width' twice in one"),
    ("opencv", ("fisheye_model: 0", "a: !!python/object/apply:os.system ['true']"), "with tag"),
    ("opencv", ("fisheye_model: 0", "a: &a [*a]"), "an alias 'a' that repeats"),
    ("opencv", ("fisheye_model: 0", "a: [1"), "expected valid YAML"),
    ("opencv", ("fisheye_model: 0", "? [1]\n: 2"), "got: a collection as a name"),
    ("opencv", ("fisheye_model: 0", "a: 1\n---\nb: 2"), "got: several documents"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "change", "words"), FAULTS)
def test_each_fault_is_one_line_that_names_it(file, change, words):
    path, data = file
    if isinstance(change, dict):
        data = json.dumps(json.loads(data) | change).encode()
    else:
        old, new = (each.encode() for each in change)
        assert old in data
        data = data.replace(old, new, 1)
    path.write_bytes(data)
    answers = rc.Conventions(
        image_size=(640, 480), original_world=True, lens_model="brown", pixel_centre=0
    )
    refused(path, words, str(path.parent), conventions=answers)


def twice(content, name):
    """JSON of a table whose list has each entry twice."""
    return json.dumps(content | {name: content[name] * 2})


REPEATED_IDS = {
    "openmvg intrinsics": ("a.json", twice(OPENMVG, "intrinsics")),
    "openmvg extrinsics": ("a.json", twice(OPENMVG, "extrinsics")),
    "alicevision intrinsics": ("a.sfm", twice(ALICEVISION, "intrinsics")),
    "alicevision poses": ("a.sfm", twice(ALICEVISION, "poses")),
    "metashape sensors": (
        "m.xml",
        re.sub(r"(<sensor .*</sensor>)", r"\1\1", METASHAPE, flags=re.S),
    ),
    "metashape cameras": (
        "m.xml",
        re.sub(r"(<camera .*</camera>)", r"\1\1", METASHAPE, flags=re.S),
    ),
}


@pytest.mark.parametrize("name", REPEATED_IDS)
def test_an_id_that_repeats_is_refused_for_the_first_would_be_lost(tmp_path, name):
    path, content = REPEATED_IDS[name]
    (tmp_path / path).write_text(content)
    refused(tmp_path / path, " once, got ", str(tmp_path), conventions=rc.Conventions())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a.json", "a.yaml", "a.xml", "a.txt", "a.npy", "a.glb", "a.out"])
@pytest.mark.parametrize(
    "content",
    [b"", b"\0" * 100, b"[" * 100_000, b"{" * 100_000, b'{"a":' * 100_000, b"<a>" * 100_000,
     b"\xff\xfe" + b"a" * 99, b"1 " * 1000, b"- " * 50_000, b"a: " * 50_000, b"3", b"null", b"[]",
     b"# Bundle file v0.3\n", b"extrinsic " * 50, b"{}", b'{"cameras": 3}', b'{"frames": 3}'],
    ids=lambda content: repr(content[:12]),
)  # fmt: skip
def test_texts_that_are_no_camera_are_one_line(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    refused(path, conventions=ANSWERS)


@pytest.mark.parametrize("path", ["", "nothing.json", "/proc", "/dev/zero", "\0", "a" * 5000])
def test_what_is_no_file_is_one_line(path):
    refused(path)
    refused(3, "a path, got int")


@pytest.mark.parametrize("name", ["nerfstudio", "opencv", "ros", "kalibr", "bundler", "mvsnet"])
def test_text_in_utf_16_is_said_to_be_so(file):
    path, data = file
    path.write_bytes(data.decode().encode("utf-16"))
    refused(path, "save it as UTF-8", conventions=ANSWERS)


@pytest.mark.parametrize("form", sorted({*READERS} - {"rastercov", "colmap"}))
def test_a_file_named_for_another_format_is_one_line_of_that_format(good, form):
    path, _ = good["rastercov"]
    wanted = "expected"  # and no error of what is done later
    with pytest.raises(rc.CameraError, match=rf"^[^\n]*({wanted})[^\n]*$"):
        read_views(path, format=form, conventions=ANSWERS)


def test_a_folder_without_cameras_is_told_what_was_looked_for(tmp_path):
    refused(tmp_path, "COLMAP model, transforms.json", ", got a folder")


def test_names_from_a_file_lead_nowhere(tmp_path):
    frames = [
        {"file_path": "../../../etc/passwd\n\x1b[31m", "transform_matrix": np.eye(4).tolist()}
    ]
    content = {"w": 640, "h": 480, "fl_x": 500, "frames": frames}
    path = tmp_path / "transforms.json"
    path.write_text(json.dumps(content))
    views = read_views(path, conventions=rc.Conventions(pose_unit="m"))
    assert views.images == ("../../../etc/passwd[31m",)  # a text, never opened
    for form in WRITERS:
        write_views(tmp_path / f"out {form}", views, format=form)
    assert sorted(each.name for each in tmp_path.iterdir()) == sorted(
        [*(f"out {form}" for form in WRITERS), "transforms.json"]
    )
    assert read_views(tmp_path / "out colmap-text").images == views.images
