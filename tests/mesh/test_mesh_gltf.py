"""glTF in JSON: buffers in files and data URIs, and what is never opened."""

import json

import numpy as np
import pytest
from mesh_files import FACES, POINTS, Glb, refusal, triangles

from rastercov.base.errors import MeshError


@pytest.fixture
def part():
    """A tetrahedron in two nodes, its buffer without a place."""
    glb = Glb()
    glb.nodes({"mesh": 0, "name": "part"}, {"mesh": 0, "name": "copy", "translation": [5, 0, 0]})
    return glb


@pytest.mark.parametrize("name", ["part.bin", "a folder/part%201.bin", "data"])
def test_a_buffer_beside_the_file_is_read(name, part, load, tmp_path):
    path = tmp_path / name.replace("%20", " ")
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(part.binary)
    mesh = load("a.gltf", part.json(name))
    np.testing.assert_array_equal(triangles(mesh)[:4], POINTS[FACES])
    np.testing.assert_array_equal(triangles(mesh)[4:], POINTS[FACES] + [5, 0, 0])
    assert [group.name for group in mesh.groups] == ["part", "copy"]
    assert mesh.warnings == ()


def test_a_gltf_is_the_same_scene_as_its_glb(part, load):
    inside = load("b.glb", part.data())
    mesh = load("a.gltf", part.json())
    np.testing.assert_array_equal(mesh.vertices, inside.vertices)
    np.testing.assert_array_equal(mesh.faces, inside.faces)


def test_several_buffers_are_read_each_from_its_place(load, tmp_path):
    glb = Glb()
    cut = glb.header["bufferViews"][1]["byteOffset"]
    (tmp_path / "corners.bin").write_bytes(glb.binary[cut:])
    glb.header["bufferViews"][1].update(buffer=1, byteOffset=0)
    header = json.loads(glb.json())
    header["buffers"].append({"byteLength": len(glb.binary) - cut, "uri": "corners.bin"})
    mesh = load("a.gltf", json.dumps(header).encode())
    np.testing.assert_array_equal(triangles(mesh), POINTS[FACES])


def test_the_hash_covers_the_buffers(part, load, tmp_path):
    hashes = set()
    for last in (0, 1):
        (tmp_path / "part.bin").write_bytes(part.binary + bytes([last]))
        hashes.add(load("a.gltf", part.json("part.bin")).sources[0].sha256)
    assert len(hashes) == 2


@pytest.mark.parametrize(
    "uri",
    ["../part.bin", "a/../../part.bin", "/etc/passwd", "file:///etc/passwd", "..\\part.bin",
     "https://example.org/part.bin", "%2e%2e/part.bin", "C:\\part.bin"],
)  # fmt: skip
def test_a_buffer_outside_the_folder_is_never_opened(uri, part, load):
    with pytest.raises(MeshError, match="a buffer in the folder of the file, got"):
        load("a.gltf", part.json(uri))


@pytest.mark.parametrize(
    ("uri", "text"),
    [
        ("missing.bin", r"expected the buffer 'missing\.bin', got: no such file"),
        ("", "expected a regular file, got a folder"),
        (7, "buffer 0: expected a file name or a data URI, got 7"),
        ("data:,abc", "buffer 0: expected a data URI in base64"),
        ("data:a/b;base64,A", "buffer 0: expected a data URI in base64"),
        ("data:a/b;base64,AAAA", "expected 72 bytes, as declared, got 3 in its URI"),
    ],
)
def test_a_buffer_that_is_not_there_is_refused(uri, text, part, load):
    with pytest.raises(MeshError, match=text):
        load("a.gltf", part.json(uri))


def test_buffers_count_against_the_largest_file(part, load, tmp_path):
    (tmp_path / "part.bin").write_bytes(part.binary + bytes(100_000))
    data = part.json("part.bin")
    with pytest.raises(MeshError, match=r"part\.bin.*raise max_bytes"):
        load("a.gltf", data, max_bytes=len(data) + 1000)


def test_no_json_is_refused(load):
    for data in (b"glTF", b"[]", b"{", b"{}", b'{"asset": {"version": "1.0"}}'):
        assert refusal(load, "a.gltf", data)
