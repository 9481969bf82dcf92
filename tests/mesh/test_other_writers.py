"""Files as other programs write them: decimal commas, UTF-16, weights, names after endfacet."""

import json

import numpy as np
import pytest
from mesh_files import FACES, POINTS, WRITERS, Glb, ascii_stl, obj, off, ply, triangles
from repeated_parts import dae, source, threemf

import rastercov as rc
from rastercov.base.errors import MeshError

TEXTS = ("a.obj", "a.off", "ascii.ply", "ascii.stl")


@pytest.mark.parametrize("encoding", ["utf-16-le", "utf-16-be"])
@pytest.mark.parametrize("name", TEXTS)
def test_a_text_with_a_mark_of_utf_16_is_read(name, encoding, load):
    data = WRITERS[name](POINTS, FACES)
    mesh = load(name, ("\ufeff" + data.decode()).encode(encoding))
    np.testing.assert_array_equal(triangles(mesh), triangles(load(name, data)))
    assert mesh.notes == ()


@pytest.mark.parametrize("mark", [b"\xff\xfe", b"\xfe\xff"])
def test_a_binary_file_that_begins_like_a_mark_stays_one(mark, load):
    data = WRITERS["binary.stl"](POINTS, FACES, header=mark + b"a program")
    assert load("a.stl", data).n_faces == 4
    assert load("a.stl", data + b"\0").n_faces == 4  # of a length that is not that of the faces


UNUSED = np.array([*POINTS, [np.nan, 0, 0], [0, np.inf, 0]])


@pytest.mark.parametrize("write", [obj, off, ply])
def test_a_vertex_without_a_face_that_is_no_number_is_named(write, load):
    name = f"a.{write.__name__}"
    data = write(UNUSED, FACES)
    with pytest.raises(MeshError, match=r"in vertices \[4, 5\], 2 in all, without a face; repair"):
        load(name, data)
    mesh = load(name, data, drop_invalid=True)
    assert "dropped vertices [4, 5], 2 in all, without a face" in mesh.notes[0]
    used = UNUSED.copy()
    used[0] = np.nan
    with pytest.raises(MeshError, match=r"in faces \[0, 1, 3\], 3 in all; repair"):
        load(name, write(used, FACES))


COMMA = POINTS * 1.5


def with_comma(data):
    return data.decode().replace("1.5", "1,5").encode()


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.dae", dae(before=source(COMMA))),
        ("a.dae", dae("<node><translate>1.5 0 0</translate></node>")),
        ("a.dae", dae(unit='<unit meter="1.5"/>')),
        ("a.obj", obj(COMMA, FACES)),
        ("a.off", off(COMMA, FACES)),
        ("a.ply", ply(COMMA, FACES)),
        ("a.stl", ascii_stl(COMMA, FACES)),
    ],
)
def test_a_decimal_comma_is_named_without_words_of_python(name, data, load):
    with pytest.raises(MeshError) as caught:
        load(name, with_comma(data))
    line = str(caught.value)
    assert "1,5" in line
    assert "Error" not in line
    if name == "a.dae":
        assert "expected a number, got '1,5'; write decimals with a point" in line


def test_a_decimal_comma_of_3mf_is_named(load):
    data = threemf()
    assert load("a.3mf", data).n_faces == 4
    words = "1 0 0 0 1 0 0 0 1 0,5 0 0"
    with pytest.raises(MeshError, match="expected a number, got '0,5'; write decimals with a"):
        load("a.3mf", threemf("", f'<item objectid="1" transform="{words}"/>'))


@pytest.mark.parametrize("more", ["", " a", " facet 7"])
def test_words_after_endfacet_are_names(more, load):
    data = ascii_stl(POINTS, FACES).replace(b"endfacet", f"endfacet{more}".encode())
    np.testing.assert_array_equal(triangles(load("a.stl", data)), POINTS[FACES])


def test_weights_of_vertices_are_noted_unless_they_are_1(load):
    lines = obj(POINTS, FACES).decode().splitlines()
    for weights, n in (([1, 1, 1, 1], 0), ([1, 2, 1, 0.5], 2), ([1, 1, 1, 0], 1)):
        own = iter(weights)
        text = "\n".join(f"{line} {next(own)}" if line[:2] == "v " else line for line in lines)
        mesh = load("a.obj", text.encode() + b"\n")
        np.testing.assert_array_equal(triangles(mesh), POINTS[FACES])
        assert len(mesh.notes) == (n > 0)
        if n:
            assert f"ignored the weights of {n} vert" in mesh.notes[0]
            assert f"the first in line {5 if n == 2 else 7}" in mesh.notes[0]
    colours = [f"{line} 0.5 0.5 0.5" if line[:2] == "v " else line for line in lines]
    assert load("b.obj", "\n".join([*colours, ""]).encode()).notes == ()


@pytest.mark.parametrize(("axis", "is_noted"), [("X_UP", 1), ("Y_UP", 1), ("Z_UP", 0), ("", 0)])
def test_an_up_axis_that_is_not_z_is_noted_also_of_a_robot(axis, is_noted, load, tmp_path):
    words = f"<up_axis>{axis}</up_axis>" if axis else ""
    mesh = load("a.dae", dae(unit=words))
    assert len(mesh.notes) == is_noted
    (tmp_path / "a.urdf").write_text(
        '<robot name="r"><link name="base"><collision><geometry><mesh filename="a.dae"/></geometry>'
        "</collision></link></robot>"
    )
    notes = rc.Robot.load(tmp_path / "a.urdf").mesh.notes
    assert notes == mesh.notes
    assert not is_noted or f"its up axis, {axis[0]}, is not turned to z" in notes[0]


@pytest.mark.parametrize("extension", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
@pytest.mark.parametrize("is_required", [False, True])
@pytest.mark.parametrize("kind", ["glb", "gltf"])
def test_compressed_data_without_the_rest_is_named(extension, is_required, kind, load):
    glb = Glb()
    view = glb.header["bufferViews"][0]
    own = {"buffer": 0, "byteLength": view["byteLength"], "byteStride": 12, "count": 4}
    view |= {"buffer": 1, "extensions": {extension: own | {"mode": "ATTRIBUTES"}}}
    if is_required:
        glb.header["extensionsRequired"] = [extension]
    empty = {"byteLength": view["byteLength"], "extensions": {extension: {"fallback": True}}}
    glb.header["buffers"].append(empty)
    data = glb.data()
    if kind == "gltf":
        header = json.loads(glb.json())
        header["buffers"].append(empty)
        data = json.dumps(header).encode()
    with pytest.raises(MeshError, match=rf"expected (supported|plain) .*'{extension}'"):
        load(f"a.{kind}", data)


def test_parallel_cameras_of_a_scene_are_read_without_a_note(tmp_path):
    camera = {"type": "orthographic", "orthographic": {"xmag": 2, "ymag": 1.5, "znear": 0,
              "zfar": 9}}  # fmt: skip
    given = rc.Conventions(image_size=(800, 600))
    content = {"asset": {"version": "2.0"}, "cameras": [camera], "nodes": [{"camera": 0}]}
    (tmp_path / "a.gltf").write_text(json.dumps(content))
    assert rc.read_views(tmp_path / "a.gltf", conventions=given).notes == ()
    both = Glb()
    both.header["cameras"] = [camera]
    (tmp_path / "b.glb").write_bytes(both.data())
    assert rc.Mesh.load(tmp_path / "b.glb").notes == ()
