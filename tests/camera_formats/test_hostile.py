"""Damaged files of every format: views, or one line of our own; never another error, nor long."""

import json
import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import rastercov as rc
from rastercov.camera.formats import READERS, WRITERS, read_views, write_views
from rastercov.camera.formats.conventions import Conventions

ANSWERS = Conventions(image_size=(640, 480), pixel_centre=0.5, lens_model="brown", pose_unit="m")
KALIBR = """cam0:
  camera_model: pinhole
  intrinsics: [458.6, 457.3, 367.2, 248.4]
  distortion_model: radtan
  distortion_coeffs: [-0.28, 0.07, 0.0002, 0.00002]
  resolution: [752, 480]
cam1:
  camera_model: ds
  intrinsics: [-0.2, 0.6, 458.6, 457.3, 367.2, 248.4]
  distortion_model: none
  distortion_coeffs: []
  resolution: [752, 480]
  T_cn_cnm1: [[1.0, 0, 0, -0.1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
"""
METASHAPE = """<document version="2.0.0"><chunk label="c"><sensors><sensor id="0" label="s"
type="frame"><resolution width="640" height="480"/><calibration class="adjusted">
<resolution width="640" height="480"/><f>500</f><k1>-0.1</k1></calibration></sensor></sensors>
<cameras><camera id="0" sensor_id="0" label="a">
<transform>1 0 0 1 0 1 0 2 0 0 1 3 0 0 0 1</transform></camera></cameras></chunk></document>"""
OPENSFM = {
    "cameras": {"c": {"projection_type": "brown", "width": 640, "height": 480, "focal_x": 0.8,
                      "focal_y": 0.8, "k1": 0.1}},
    "shots": {"a": {"rotation": [0.1, 0.2, 0.3], "translation": [1, 2, 3], "camera": "c"}},
}  # fmt: skip
BUNDLER = "# Bundle file v0.3\n1 0\n500 0.1 0.02\n1 0 0\n0 1 0\n0 0 1\n1 2 3\n"
BAL = "1 1 1\n0 0 1.5 2.5\n0.1\n0.2\n0.3\n1\n2\n3\n500\n0.1\n0.02\n0\n0\n1\n"
MVSNET = "extrinsic\n1 0 0 1\n0 1 0 2\n0 0 1 3\n0 0 0 1\n\nintrinsic\n5 0 3\n0 5 2\n0 0 1\n\n1 2\n"


def all_files(folder):
    """A good file of each format, by the format."""
    camera = rc.Camera(
        width=640, height=480, fx=500, fy=500, model="opencv", distortion=(0.1, 0, 0, 0)
    )
    poses = rc.look_at(eyes=[(1.0, 2, 3), (3, 2, 1)], targets=(0, 0, 0))
    views = rc.Views(rc.Rig([camera]), rc.Poses.of(poses), ("a.png", "b.png"))
    names = {
        "rastercov": "own.json",
        "nerfstudio": "transforms.json",
        "opencv": "cv.yaml",
        "ros": "ros.yaml",
        "gltf": "rig.glb",
    }
    for form, name in names.items():
        write_views(folder / name, views, format=form)
    write_views(folder / "text", views, format="colmap-text")
    write_views(folder / "binary", views, format="colmap")
    texts = {
        "kalibr": ("k.yaml", KALIBR),
        "metashape": ("m.xml", METASHAPE),
        "opensfm": ("o.json", json.dumps(OPENSFM)),
        "bundler": ("b.out", BUNDLER),
        "bal": ("bal.txt", BAL),
        "mvsnet": ("cam.txt", MVSNET),
    }
    for form, (name, text) in texts.items():
        (folder / name).write_text(text)
        names[form] = name
    files = {form: folder / name for form, name in names.items()}
    files |= {f"text {n}": folder / "text" / f"{n}.txt" for n in ("cameras", "images")}
    return files | {f"binary {n}": folder / "binary" / f"{n}.bin" for n in ("cameras", "images")}


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    folder = tmp_path_factory.mktemp("good")
    files = all_files(folder)
    return {name: (path, path.read_bytes()) for name, path in files.items()}


NAMES = sorted({*READERS} - {"colmap"})
NAMES += [f"{kind} {name}" for kind in ("text", "binary") for name in ("cameras", "images")]


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


@pytest.mark.parametrize("name", NAMES)
def test_good_files_are_read(good, name):
    path, _ = good[name]
    views = read_views(path, conventions=ANSWERS)
    assert views.cameras()


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_cut_files_are_read_or_refused_in_one_line(good, name):
    path, data = good[name]
    try:
        for cut in np.linspace(0, len(data), 60).astype(int).tolist():
            path.write_bytes(data[:cut])
            read_or_one_line(path)
    finally:
        path.write_bytes(data)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_damaged_files_are_read_or_refused_in_one_line(good, name, data):
    path, whole = good[name]
    broken = bytearray(whole)
    try:
        for _ in range(data.draw(st.integers(1, 4))):
            at = data.draw(st.integers(0, len(broken) - 1))
            what = data.draw(
                st.sampled_from(
                    [
                        *(
                            b"\0",
                            b"\xff",
                            b"-",
                            b"9",
                            b"e999",
                            b"nan",
                            b"{",
                            b"[",
                            b"<",
                            b"]",
                            b'"',
                        ),
                        *(b"null", b"1e400", b"\n", b" ", b"true", b"&a *a ", b": ", b"!!x "),
                        struct.pack("<d", float("nan")),
                        struct.pack("<Q", 2**63),
                    ]
                )
            )
            length = data.draw(st.integers(0, 8))
            broken[at : at + length] = what
        path.write_bytes(bytes(broken))
        read_or_one_line(path)
    finally:
        path.write_bytes(whole)


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
    with pytest.raises((rc.CameraError, rc.PoseError), match=r"^[^\n]*$"):
        read_views(path, conventions=ANSWERS)


@pytest.mark.parametrize("path", ["", "nothing.json", "/proc", "/dev/zero", "\0", "a" * 5000])
def test_what_is_no_file_is_one_line(path):
    with pytest.raises((rc.CameraError, rc.PoseError), match=r"^[^\n]*$"):
        read_views(path)
    with pytest.raises(rc.CameraError, match="a path wanted, got int"):
        read_views(3)


def test_text_in_utf_16_is_said_to_be_so(good):
    for name in ("nerfstudio", "opencv", "ros", "kalibr", "bundler", "mvsnet"):
        path, data = good[name]
        try:
            path.write_bytes(data.decode().encode("utf-16"))
            with pytest.raises(
                (rc.CameraError, rc.PoseError), match=r"^[^\n]*save it as UTF-8\)?$"
            ):
                read_views(path, conventions=ANSWERS)
        finally:
            path.write_bytes(data)


@pytest.mark.parametrize("form", sorted({*READERS} - {"rastercov", "colmap"}))
def test_a_file_named_for_another_format_is_one_line_of_that_format(good, form):
    path, _ = good["rastercov"]
    wanted = "wanted, got|is missing|must be|is no XML"  # and no error of what is done later
    with pytest.raises(rc.CameraError, match=rf"^[^\n]*({wanted})[^\n]*$"):
        read_views(path, format=form, conventions=ANSWERS)


def test_a_folder_without_cameras_is_told_what_was_looked_for(tmp_path):
    with pytest.raises(
        rc.CameraError, match=r"COLMAP model, transforms\.json, .* wanted, got a fold"
    ):
        read_views(tmp_path)


def test_names_from_a_file_lead_nowhere(tmp_path):
    frames = [
        {"file_path": "../../../etc/passwd\n\x1b[31m", "transform_matrix": np.eye(4).tolist()}
    ]
    content = {"w": 640, "h": 480, "fl_x": 500, "frames": frames}
    path = tmp_path / "transforms.json"
    path.write_text(json.dumps(content))
    views = read_views(path, conventions=Conventions(pose_unit="m"))
    assert views.images == ("../../../etc/passwd[31m",)  # a text, never opened
    for form in WRITERS:
        write_views(tmp_path / f"out {form}", views, format=form)
    assert sorted(each.name for each in tmp_path.iterdir()) == sorted(
        [*(f"out {form}" for form in WRITERS), "transforms.json"]
    )
    assert read_views(tmp_path / "out colmap-text").images == views.images
