"""Files that a person names: only regular ones are read, at once, and text only one way."""

import json
import os
import re
import signal
import socket
import warnings
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rastercov.base.errors import CameraError, ConfigError, MeshError, PoseError, RastercovError
from rastercov.base.files import (
    UnreadableError,
    UnwritableError,
    file_bytes,
    read_json,
    read_toml,
    write_file,
)
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.conventions import read_poses, write_poses
from rastercov.core.camera.viewpoints import look_at
from rastercov.core.mesh import Mesh
from rastercov.placement.plan.file import read_plan

READERS = {
    "camera.json": (Camera.load, CameraError),
    "camera.toml": (Camera.load, CameraError),
    "poses.json": (read_poses, PoseError),
    "poses.npy": (read_poses, PoseError),
    "plan.toml": (read_plan, ConfigError),
    "mesh.obj": (Mesh.load, MeshError),
}
CAMERA = {"width": 64, "height": 48, "fx": 50.0, "fy": 50.0}


@contextmanager
def at_once():
    """Fail where the block waits, after ten seconds."""

    def late(*_):
        raise TimeoutError("it waits")

    before = signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, 10)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def listening(path):
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(path))


def sparse(path):
    with path.open("wb") as file:
        file.truncate(10 << 30)


KINDS = {
    "pipe": (os.mkfifo, "a regular file, got a pipe"),
    "endless": (lambda path: path.symlink_to("/dev/zero"), "a regular file, got a device"),
    "silent": (lambda path: path.symlink_to("/dev/null"), "a regular file, got a device"),
    "folder": (Path.mkdir, "a regular file, got a folder"),
    "loop": (lambda path: path.symlink_to(path.name), "too many levels of symbolic links"),
    "nowhere": (lambda path: path.symlink_to("nothing"), "no such file or directory"),
    "sparse": (sparse, "bytes, got 10737418240"),
    "listening": (listening, "a regular file, got a socket"),
}


@pytest.mark.parametrize("name", READERS)
@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_regular_file_is_refused_at_once_in_one_line(tmp_path, monkeypatch, name, kind):
    monkeypatch.chdir(tmp_path)  # names of sockets are short
    make, words = KINDS[kind]
    make(Path(name))
    read, error = READERS[name]
    with at_once(), pytest.raises(error) as caught:
        read(name)
    text = str(caught.value)
    assert text.startswith(f"{name}: ")
    assert text.isprintable()
    assert words in text


def test_a_file_that_becomes_a_pipe_after_it_was_looked_at_is_not_waited_for(tmp_path, monkeypatch):
    path = tmp_path / "poses.npy"
    write_poses(path, np.eye(4))
    regular = path.stat()
    path.unlink()
    os.mkfifo(path)
    monkeypatch.setattr(Path, "stat", lambda *_, **__: regular)
    with at_once(), pytest.raises(UnreadableError, match="got a pipe"):
        file_bytes(path, 1000)


def test_a_link_to_a_regular_file_is_followed(tmp_path):
    Camera(**CAMERA).save(tmp_path / "a.json")
    (tmp_path / "b.json").symlink_to("a.json")
    assert Camera.load(tmp_path / "b.json") == Camera(**CAMERA)


@pytest.mark.parametrize("size", [0, 1, 99, 100])
def test_as_many_bytes_as_allowed_are_read(tmp_path, size):
    (tmp_path / "file").write_bytes(b"x" * size)
    assert file_bytes(tmp_path / "file", 100) == b"x" * size
    (tmp_path / "file").write_bytes(b"x" * 101)
    with pytest.raises(UnreadableError, match="expected at most 100 bytes, got 101"):
        file_bytes(tmp_path / "file", 100)


NO_PATHS = (None, 3, 0, True, b"camera.json", ["camera.json"], 1.5, object())
STRANGE = ("a\0b", "a\nb", "\x1b[31m", "x" * 5000, "\ud800", "")


@pytest.mark.parametrize("read", [Camera.load, read_poses, read_plan])
def test_what_is_no_path_or_a_strange_one_is_refused_in_one_printable_line(read):
    for path in (*NO_PATHS, *(name + end for name in STRANGE for end in (".json", ".npy", ""))):
        with pytest.raises(RastercovError) as caught:
            read(path)
        assert str(caught.value).isprintable()
        assert len(str(caught.value)) < 500
        assert isinstance(path, str) or "a path, got" in str(caught.value)


# --- text -----------------------------------------------------------------------------------------

GOOD = json.dumps(CAMERA)
TABLE = "width = 64\nheight = 48\nfx = 50.0\nfy = 50.0\n"
DEEP = "[" * 10_000 + "]" * 10_000
ENCODED = "save it as UTF-8|expected valid JSON"
JSON = [
    (GOOD.replace("{", '{"width": 32, '), "'width' twice"),
    (GOOD.replace("64", "NaN"), "width to be finite"),
    *((GOOD.replace("50.0", word), "fx to be finite") for word in ("Infinity", "1e400")),
    (GOOD.replace("64", "1" * 400), "width: expected a number within"),
    *((GOOD.replace("64", word), "expected valid JSON|width") for word in ("1" * 5000, DEEP)),
    *((text, "expected valid JSON, got") for text in (
        "[" * 1_000_000, '{"a":' * 10_000, "", "\0", GOOD[:-1], GOOD + GOOD)),
    *((text, ENCODED) for text in (
        GOOD.encode("utf-16"), GOOD.encode("utf-32"), b"\xff\xfe\x00")),
]  # fmt: skip
TOML = [
    (TABLE.replace("64", "nan"), "width to be finite"),
    *((TABLE.replace("50.0", word), "fx to be finite") for word in ("inf", "1e400")),
    *((TABLE.replace("64", word), "expected valid TOML|width") for word in ("1" * 5000, DEEP)),
    *((text, "expected valid TOML, got") for text in (
        TABLE + "fx = 3\n", "x = " + "{a=" * 10_000, TABLE.encode("utf-16"), "\0", TABLE + "[")),
]  # fmt: skip
TEXTS = [("camera.json", *each) for each in JSON] + [("camera.toml", *each) for each in TOML]


@pytest.mark.parametrize(("name", "content", "match"), TEXTS, ids=range(len(TEXTS)))
def test_text_says_one_thing_or_is_refused(tmp_path, name, content, match):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    for read in (Camera.load, read_plan):
        with pytest.raises(RastercovError) as caught:
            read(path)
        assert read == read_plan or re.search(match, str(caught.value))
        assert str(caught.value).startswith((str(path), path.name))
        assert str(caught.value).isprintable()
        assert len(str(caught.value)) < 600


def test_a_byte_order_mark_is_no_content(tmp_path):
    (tmp_path / "camera.json").write_text(GOOD, encoding="utf-8-sig")
    (tmp_path / "camera.toml").write_text(TABLE, encoding="utf-8-sig")
    text = json.dumps({"world_from_camera": [np.eye(4).tolist()]})
    (tmp_path / "poses.json").write_text(text, encoding="utf-8-sig")
    assert Camera.load(tmp_path / "camera.json") == Camera(**CAMERA)
    assert Camera.load(tmp_path / "camera.toml") == Camera(**CAMERA)
    assert np.array_equal(read_poses(tmp_path / "poses.json"), np.eye(4)[None])


@given(st.binary(max_size=80))
def test_any_bytes_are_content_or_unreadable(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("text") / "file"
    path.write_bytes(data)
    for read in (read_json, read_toml):
        try:
            read(path)
        except UnreadableError as error:
            assert str(error).isprintable()  # noqa: PT017 - some bytes are content


# --- pose files -----------------------------------------------------------------------------------


def header(text, version=b"\x01\x00"):
    body = text.encode() + b" " * (63 - (10 + len(text)) % 64 + 1)
    body = body[:-1] + b"\n"
    return b"\x93NUMPY" + version + len(body).to_bytes(2, "little") + body


HEADERS = ["{}", "__import__('os').abort()"]
HEADERS += [
    f"{{'descr': {kind!r}, 'fortran_order': False, 'shape': {shape}, }}"
    for kind, shape in (
        *(("<f8", shape) for shape in ((1 << 60, 4, 4), (10**7, 4, 4), (-5, 4, 4), 7)),
        *((kind, (1, 4, 4)) for kind in ("|O", "<U9")),
    )
]


@pytest.mark.parametrize("text", HEADERS)
def test_an_npy_header_promises_nothing(tmp_path, text):
    path = tmp_path / "poses.npy"
    path.write_bytes(header(text) + np.eye(4).tobytes())
    if "(-5," in text and np.lib.NumpyVersion(np.__version__) < "2.0.0":
        # That numpy takes a length below 0 for all that follows.
        assert np.array_equal(read_poses(path), np.eye(4)[None])
        return
    with at_once(), pytest.raises(PoseError) as caught:
        read_poses(path)
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("dtype", ["<f8", ">f8", "<f4", ">i2", np.longdouble])
def test_any_layout_of_an_npy_gives_the_same_poses(tmp_path, order, dtype):
    poses = np.array(look_at([(3, 0, 0), (0, 0, 3)], (0, 0, 0), (0, 1, 0)), dtype, order=order)
    np.save(tmp_path / "poses.npy", poses)
    assert np.array_equal(read_poses(tmp_path / "poses.npy"), poses.astype(np.float64))


def test_a_file_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "folder.json").mkdir()
    camera = Camera(**CAMERA)
    for write, error in (
        (camera.save, CameraError),
        (lambda p: write_poses(p, np.eye(4)), PoseError),
    ):
        with pytest.raises(error, match="expected a file in an existing folder, got a folder that"):
            write(tmp_path / "no" / "file.json")
        with pytest.raises(
            error, match=r"folder\.json: expected a file in an existing folder, got a folder"
        ):
            write(tmp_path / "folder.json")
        with pytest.raises(error, match=r"expected the suffix|expected a pose file"):
            write(tmp_path / "file.xml")
    (tmp_path / "link.json").symlink_to("/dev/full")
    with pytest.raises(PoseError, match="expected a file, got a symb"):
        write_poses(tmp_path / "link.json", np.eye(4))
    with pytest.raises(UnwritableError, match="no space left"), write_file("/dev/full") as file:
        file.write(bytes(1 << 20))


def test_numbers_beyond_float64_are_infinite_without_a_warning(tmp_path):
    np.save(tmp_path / "poses.npy", np.full((1, 4, 4), np.longdouble("1e4000")))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.isinf(read_poses(tmp_path / "poses.npy")).all()
