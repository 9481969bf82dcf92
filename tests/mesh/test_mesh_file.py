"""Mesh files: what is refused and how it is said, and that no face is lost or moved silently."""

import contextlib
import hashlib
import json
import os
import re
import socket
import struct
import sys
import time
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rastercov.errors import MeshError, ResourceError
from rastercov.mesh import Group, Mesh

MESHES = Path(__file__).resolve().parents[3] / "shared" / "meshes"

#    3---2      a tetrahedron over the triangle 0 1 2; its faces are wound outwards
#    |\ /|
#    0---1
POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


def binary_stl(corners: np.ndarray, header: bytes = b"", count: int | None = None) -> bytes:
    records = np.zeros(len(corners), [("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")])
    records["c"] = corners
    count = len(corners) if count is None else count
    return header.ljust(80, b"\0") + struct.pack("<I", count) + records.tobytes()


def ascii_stl(corners: np.ndarray) -> bytes:
    facets = [
        "facet normal 0 0 0\n outer loop\n"
        + "".join(f"  vertex {x!r} {y!r} {z!r}\n" for x, y, z in triangle)
        + " endloop\nendfacet\n"
        for triangle in np.asarray(corners).tolist()
    ]
    return f"solid a name\n{''.join(facets)}endsolid a name\n".encode()


def obj(points: np.ndarray, faces: np.ndarray) -> bytes:
    lines = ["# comment", "mtllib secret.mtl", "o thing"]
    lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in np.asarray(points).tolist()]
    lines += ["vn 0 0 1"] + [
        f"f {a}//1 {b}//1 {c}//1" for a, b, c in (np.asarray(faces) + 1).tolist()
    ]
    return "\n".join([*lines, ""]).encode()


def off(points: np.ndarray, faces: np.ndarray) -> bytes:
    lines = ["OFF # comment", f"{len(points)} {len(faces)} 0"]
    lines += [f"{x!r} {y!r} {z!r}" for x, y, z in np.asarray(points).tolist()]
    lines += [f"3 {a} {b} {c} 255 0 0" for a, b, c in np.asarray(faces).tolist()]
    return "\n".join(lines).encode()


PLY_FORMATS = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}


def ply(points: np.ndarray, polygons: list, order: str = "", index: str = "int") -> bytes:
    head = (
        f"ply\nformat {PLY_FORMATS[order]} 1.0\ncomment made by hand\n"
        f"element vertex {len(points)}\nproperty float64 x\nproperty double y\nproperty double z\n"
        f"property uchar red\nelement face {len(polygons)}\nproperty short flags\n"
        f"property list uchar {index} vertex_indices\nelement extra 1\nproperty int a\nend_header\n"
    ).encode()
    polygons = [list(map(int, p)) for p in polygons]
    if not order:
        body = "".join(f"{x!r} {y!r} {z!r} 7\n" for x, y, z in np.asarray(points).tolist())
        body += "".join(f"5 {len(p)} {' '.join(map(str, p))}\n" for p in polygons) + "9\n"
        return head + body.encode()
    rows = [struct.pack(order + "dddB", *p, 7) for p in points]
    code = {"int": "i", "uchar": "B", "uint": "I"}[index]
    rows += [struct.pack(f"{order}hB{len(p)}{code}", 5, len(p), *p) for p in polygons]
    return head + b"".join(rows) + struct.pack(order + "i", 9)


def glb(header: dict, binary: bytes = b"") -> bytes:
    text = json.dumps({"asset": {"version": "2.0"}, **header}).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    binary += b"\0" * (-len(binary) % 4)
    chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def glb_header(points: np.ndarray, corners: np.ndarray, **primitive) -> tuple[dict, bytes]:
    """One node with one mesh: float32 positions, then uint16 corners."""
    first = np.asarray(points, "<f4").tobytes()
    second = np.asarray(corners, "<u2").tobytes()
    header = {
        "buffers": [{"byteLength": len(first) + len(second)}],
        "bufferViews": [
            {"buffer": 0, "byteLength": len(first)},
            {"buffer": 0, "byteOffset": len(first), "byteLength": len(second)},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(points), "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": np.size(corners), "type": "SCALAR"},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, **primitive}]}],
        "nodes": [{"mesh": 0, "name": "part"}],
        "scenes": [{"nodes": [0]}],
    }
    return header, first + second


VALID = {
    "binary.stl": binary_stl(POINTS[FACES]),
    "ascii.stl": ascii_stl(POINTS[FACES]),
    "a.obj": obj(POINTS, FACES),
    "a.off": off(POINTS, FACES),
    "ascii.ply": ply(POINTS, FACES),
    "little.ply": ply(POINTS, FACES, "<"),
    "big.ply": ply(POINTS, FACES, ">"),
    "a.glb": glb(*glb_header(POINTS, FACES)),
}


@pytest.fixture
def load(tmp_path):
    """Write bytes under a name and load them."""

    def write_and_load(name: str, data: bytes, **options) -> Mesh:
        path = tmp_path / name
        path.write_bytes(data)
        return Mesh.load(path, **options)

    return write_and_load


def triangles(mesh: Mesh) -> np.ndarray:
    return mesh.vertices[mesh.faces]


# ---- valid files


@pytest.mark.parametrize("name", VALID)
def test_every_format_keeps_faces_corners_and_order(name, load, tmp_path):
    mesh = load(name, VALID[name])
    np.testing.assert_array_equal(triangles(mesh), POINTS[FACES])
    np.testing.assert_array_equal(mesh.source_face, np.arange(4))
    assert mesh.n_vertices == 4
    assert mesh.can_cull_back_faces
    assert mesh.warnings == ()
    (source,) = mesh.sources
    assert (source.name, source.n_faces) == (name, 4)
    assert source.sha256 == hashlib.sha256(VALID[name]).hexdigest()
    assert str(tmp_path) not in repr(mesh.sources)


@pytest.mark.parametrize("name", VALID)
def test_trimesh_reads_the_same(name, tmp_path):
    trimesh = pytest.importorskip("trimesh")
    path = tmp_path / name
    path.write_bytes(VALID[name])
    theirs = trimesh.load(path, process=False, force="mesh")
    np.testing.assert_allclose(triangles(Mesh.load(path)), theirs.triangles, atol=1e-7)


def test_glb_scene_agrees_with_trimesh(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    scene = trimesh.Scene()
    box = trimesh.creation.box()
    turn = trimesh.transformations.euler_matrix(0.1, 0.5, 0.7)
    turn[:3, 3] = [1, 2, 3]
    scene.add_geometry(box, node_name="first", transform=turn)
    scene.add_geometry(trimesh.creation.icosphere(2), node_name="second", parent_node_name="first")
    path = tmp_path / "scene.glb"
    path.write_bytes(scene.export(file_type="glb"))
    mesh, theirs = Mesh.load(path), scene.to_mesh()
    assert {group.name for group in mesh.groups} == {"first", "second"}
    assert mesh.n_faces == len(theirs.faces)
    np.testing.assert_allclose(mesh.bounds, theirs.bounds, atol=1e-6)
    np.testing.assert_allclose(mesh.areas.sum(), theirs.area, rtol=1e-5)
    assert mesh.can_cull_back_faces


def test_binary_stl_that_begins_with_solid_is_binary(load):
    mesh = load("a.stl", binary_stl(POINTS[FACES], b"solid facet normal"))
    np.testing.assert_array_equal(triangles(mesh), POINTS[FACES])


def test_stl_merges_only_what_is_equal_bit_for_bit(load):
    corners = POINTS[FACES].astype(np.float32)
    corners[1, 0, 0] = np.nextafter(np.float32(0), np.float32(1))
    mesh = load("a.stl", binary_stl(corners))
    assert mesh.n_vertices == 5
    np.testing.assert_array_equal(triangles(mesh), corners)


def test_other_formats_merge_nothing(load):
    mesh = load("a.obj", obj(POINTS[FACES].reshape(-1, 3), np.arange(12).reshape(-1, 3)))
    assert mesh.n_vertices == 12
    assert mesh.is_closed


def test_tiny_models_keep_their_vertices_and_ask_for_the_unit(load):
    mesh = load("a.obj", obj(POINTS * 1e-9, FACES))
    assert mesh.n_vertices == 4
    assert any("check unit=" in line for line in mesh.warnings)


def test_faces_without_area_and_copies_are_kept(load):
    mesh = load("a.obj", obj(POINTS, [*FACES, [0, 0, 1], [1, 0, 2]]))
    assert mesh.n_faces == 6
    np.testing.assert_array_equal(mesh.degenerate_mask, [0, 0, 0, 0, 1, 0])
    np.testing.assert_array_equal(mesh.duplicate_mask, [0, 0, 0, 0, 0, 1])


# ---- units and scenes


@pytest.mark.parametrize(
    ("unit", "metres"),
    [("m", 1), ("mm", 1e-3), ("cm", 1e-2), ("um", 1e-6), ("µm", 1e-6), ("in", 0.0254),
     ("inch", 0.0254), ("ft", 0.3048), (2.5, 2.5), (1, 1)],
)  # fmt: skip
@pytest.mark.parametrize("name", ["a.obj", "a.glb"])
def test_unit_scales(unit, metres, name, load):
    np.testing.assert_array_equal(load(name, VALID[name], unit=unit).vertices, POINTS * metres)


@pytest.mark.parametrize("unit", ["yard", "M", "", 0, -1.0, float("nan"), float("inf"), True, None])
def test_unknown_unit_lists_the_known_ones(unit, load):
    with pytest.raises(MeshError, match=r"m, mm, cm, um, .*, in, inch, ft or metres per unit"):
        load("a.obj", VALID["a.obj"], unit=unit)


def test_several_files_are_one_scene_in_order(tmp_path):
    for name in ("a.stl", "b.obj", "c.glb"):
        data = VALID["binary.stl" if name == "a.stl" else f"a{Path(name).suffix}"]
        (tmp_path / name).write_bytes(data)
    paths = [tmp_path / name for name in ("a.stl", "b.obj", "c.glb")]
    mesh = Mesh.load(paths, occluders=["b/thing"], two_sided="all")
    assert mesh.groups == (
        Group("a", is_two_sided=True),
        Group("b/thing", is_occluder=True, is_two_sided=True),
        Group("c/part", is_two_sided=True),
    )
    np.testing.assert_array_equal(mesh.face_group, np.repeat([0, 1, 2], 4))
    np.testing.assert_array_equal(triangles(mesh), np.tile(POINTS[FACES], (3, 1, 1)))
    assert [source.name for source in mesh.sources] == ["a.stl", "b.obj", "c.glb"]
    np.testing.assert_array_equal(mesh.source_face, np.tile(np.arange(4), 3))


def test_same_file_twice_makes_two_groups(tmp_path):
    (tmp_path / "a.stl").write_bytes(VALID["binary.stl"])
    mesh = Mesh.load([tmp_path / "a.stl"] * 3)
    assert [group.name for group in mesh.groups] == ["a", "a #2", "a #3"]


def test_no_path_is_refused():
    with pytest.raises(MeshError, match="at least one mesh file wanted"):
        Mesh.load([])


@pytest.mark.parametrize("path", [3, [None], [b"a.stl"]])
def test_what_is_no_path_is_refused(path):
    with pytest.raises((MeshError, TypeError), match=r"path|iterable"):
        Mesh.load(path)


def test_unknown_occluder_lists_the_groups(tmp_path):
    (tmp_path / "a.stl").write_bytes(VALID["binary.stl"])
    with pytest.raises(MeshError, match=r"among \['a'\], got \['b'\]"):
        Mesh.load(tmp_path / "a.stl", occluders=["b"])


def test_warnings_name_the_file(load):
    mesh = load("a.stl", VALID["binary.stl"] + b"xyz")
    assert "a.stl: 3 trailing bytes" in mesh.warnings[0]


# ---- nothing in it


@pytest.mark.parametrize("name", VALID)
def test_empty_file_has_no_triangles(name, load):
    with pytest.raises(MeshError, match=rf"{name}: no triangles: the file is empty"):
        load(name, b"")


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.stl", binary_stl(np.zeros((0, 3, 3)))),
        ("a.stl", b"solid x\nendsolid x\n"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"),
        ("a.obj", b"\n"),
        ("a.off", b"OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n"),
        ("a.ply", ply(POINTS, [])),
        ("a.ply", ply(POINTS, [], "<")),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n0\n"),
        ("a.glb", glb({})),
        ("a.glb", glb(*glb_header(POINTS, []))),
        ("a.glb", glb(*glb_header(POINTS, FACES, mode=1))),
    ],
)
def test_file_without_faces_has_no_triangles(name, data, load):
    with pytest.raises(MeshError, match="no triangles"):
        load(name, data)


# ---- STL


def test_lying_stl_count_is_refused_at_once(load):
    tracemalloc.start()
    start = time.process_time()
    with pytest.raises(MeshError, match=r"promises 4000000000 triangles .* the file has 134 bytes"):
        load("a.stl", binary_stl(POINTS[FACES[:1]], count=4_000_000_000))
    elapsed, (_, peak) = time.process_time() - start, tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert elapsed < 0.05
    assert peak < 10 << 20


@pytest.mark.parametrize("cut", [1, 49, 50, 99, 150])
def test_truncated_binary_stl_says_where(cut, load):
    data = VALID["binary.stl"][:-cut]
    text = f"ends in triangle {(len(data) - 84) // 50} at byte offset {len(data)};"
    with pytest.raises(MeshError, match=text):
        load("a.stl", data)


def test_stl_shorter_than_its_header(load):
    with pytest.raises(MeshError, match="has 84 bytes before its triangles, got 20"):
        load("a.stl", b"\0" * 20)


def test_trailing_bytes_load_with_a_warning(load):
    mesh = load("a.stl", VALID["binary.stl"] + b"\0" * 7)
    assert mesh.n_faces == 4
    assert mesh.warnings == (mesh.notes[0],)
    assert "7 trailing bytes" in mesh.warnings[0]


@pytest.mark.parametrize("seed", range(20))
def test_random_bytes_are_no_stl(seed, load):
    with pytest.raises(MeshError):
        load("a.stl", np.random.default_rng(seed).bytes(1000))


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        (b"  vertex 0.0 1.0 0.0\n", b"", 6),  # a facet with two vertices
        (b"  vertex 0.0 1.0 0.0\n", b"  vertex 0.0 1.0 0.0\n" * 2, 7),
        (b"vertex 0.0 1.0 0.0", b"vertex 0.0 1.0", 5),
        (b"vertex 0.0 1.0 0.0", b"vertex 0.0 one 0.0", 5),
        (b"vertex 0.0 1.0 0.0", b"vertx 0.0 1.0 0.0", 5),
        (b"endfacet\nfacet", b"endfacet\nfaced", 9),
        (b"solid a name\nfacet", b"solid a name\nouter", 2),
        (b"endsolid a name\n", b"endsolid\nfacet\n", 31),
        (b"endsolid a name\n", b"", 29),
        (b" endloop\nendfacet\nendsolid a name\n", b"", 27),
    ],
)
def test_broken_ascii_stl_says_the_line(old, new, line, load):
    data = VALID["ascii.stl"]
    assert old in data
    with pytest.raises(MeshError, match=rf"a.stl: (.* )?(after )?line {line}\b"):
        load("a.stl", data.replace(old, new, 1))


def test_ascii_stl_may_hold_several_solids_in_any_case(load):
    data = VALID["ascii.stl"]
    assert load("a.stl", data.upper() + data).n_faces == 8


def test_old_mac_line_ends_are_lines(load):
    assert load("a.stl", VALID["ascii.stl"].replace(b"\n", b"\r")).n_faces == 4


# ---- coordinates that are none


def spoilt(name: str, bad: float) -> bytes:
    """Four faces, of which 1 and 3 use a bad vertex."""
    points, faces = np.vstack([POINTS, POINTS[:1]]), FACES.copy()
    points[4] = [0, bad, 0]
    faces[1, 0] = faces[3, 1] = 4
    with np.errstate(over="ignore"):
        return {
            "binary.stl": lambda: binary_stl(points[faces]),
            "ascii.stl": lambda: ascii_stl(points[faces]),
            "a.obj": lambda: obj(points, faces),
            "a.off": lambda: off(points, faces),
            "ascii.ply": lambda: ply(points, faces),
            "little.ply": lambda: ply(points, faces, "<"),
            "big.ply": lambda: ply(points, faces, ">"),
            "a.glb": lambda: glb(*glb_header(points, faces)),
        }[name]()


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e38])
@pytest.mark.parametrize("name", VALID)
def test_unusable_coordinates_are_refused_with_their_faces(name, bad, load):
    with pytest.raises(MeshError, match=r"a?\w*\.\w+: coordinates .* faces \[1, 3\], 2 in all"):
        load(name, spoilt(name, bad))


@pytest.mark.parametrize("name", VALID)
def test_drop_invalid_keeps_the_rest_and_where_it_came_from(name, load):
    mesh = load(name, spoilt(name, np.nan), drop_invalid=True)
    np.testing.assert_array_equal(mesh.source_face, [0, 2])
    np.testing.assert_array_equal(triangles(mesh), POINTS[FACES[[0, 2]]])
    assert "faces [1, 3], 2 in all dropped" in mesh.warnings[0]
    assert mesh.sources[0].n_faces == 2


def test_drop_invalid_changes_no_valid_file(load):
    assert load("a.obj", VALID["a.obj"], drop_invalid=True).warnings == ()


def test_dropping_everything_is_an_error(load):
    with pytest.raises(MeshError, match="no triangles left"):
        load("a.obj", obj(POINTS * np.nan, FACES), drop_invalid=True)


def test_unit_may_not_overflow(load):
    with pytest.raises(MeshError, match="within ±1e\\+30"):
        load("a.obj", obj(POINTS * 1e20, FACES), unit=1e300)


# ---- OBJ


@pytest.mark.parametrize(
    ("face", "text"),
    [
        ("f 1 2 5", r"line 5: vertex indices must lie in 1 ... 4, got 5"),
        ("f 1 2 99999999999999999999999", "line 5: whole numbers"),
        ("f 0 1 2", r"line 5: vertex indices from 1, or from -1 to -4, wanted, got 'f 0 1 2'"),
        ("f -5 1 2", "line 5: vertex indices from 1, or from -1 to -4, wanted"),
        ("f 1 2", "line 5: a face of 3 or more vertices wanted, got 'f 1 2'"),
        ("f", "line 5: a face of 3 or more"),
        ("f 1 2 x", "line 5: whole numbers as vertex indices wanted"),
        ("f 1.5 2 3", "line 5: whole numbers"),
        ("v 1 2", "line 5: three coordinates wanted"),
        ("v 1 2 z", "line 5: three coordinates wanted"),
        ("face 1 2 3", "line 5: a keyword of polygonal OBJ files wanted, got 'face 1 2 3'"),
    ],
)
def test_broken_obj_says_the_line(face, text, load):
    vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
    with pytest.raises(MeshError, match=f"a.obj: {text}"):
        load("a.obj", f"{vertices}{face}\nf 1 2 3\n".encode())


def test_obj_beyond_the_end_names_the_line_of_the_right_face(load):
    text = "f 1 2 3 4\nv 0 0 0\nv 1 0 0\nf 1 2 3\nv 1 1 0\nv 0 1 0\nf 4 3 2 1 7\nf 9 1 2\n"
    with pytest.raises(MeshError, match=r"line 7: vertex indices must lie in 1 ... 4, got 7"):
        load("a.obj", text.encode())


#   4---3     6 is above
#  5 \ / |
#    1---2
def test_negative_indices_and_polygons_become_fans_with_their_source(load):
    mesh = load(
        "a.obj",
        b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv -.5 .5 0\n"
        b"f -5 -4 -3 -2 -1\nf 1 2 3\nv 0 0 1\nf 1 \\\n 2 -1\nf -6/1 -5//1 -4/1/1 -3\n",
    )
    np.testing.assert_array_equal(
        mesh.faces, [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 1, 2], [0, 1, 5], [0, 1, 2], [0, 2, 3]]
    )
    np.testing.assert_array_equal(mesh.source_face, [0, 0, 0, 1, 2, 3, 3])
    assert not any("concave" in line for line in mesh.warnings)


def test_obj_groups_last_name_wins_and_empty_ones_vanish(load):
    mesh = load(
        "part.obj",
        b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\no body\nf 1 2 3\ng lid  left\nf 1 2 3\n"
        b"g empty\no body\nf 1 2 3\ng\nf 1 2 3\ng part\nf 1 2 3\n",
    )
    assert [g.name for g in mesh.groups] == ["part", "body", "lid left", "part #2"]
    np.testing.assert_array_equal(mesh.face_group, [0, 1, 2, 1, 0, 3])


def test_group_names_are_printable_and_short(load):
    name = b"a\x1b[31m\x07" + "\u202eé\ud7ff".encode() + b"\xff" + b"b" * 400
    mesh = load("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\ng " + name + b"\nf 1 2 3\n")
    (group,) = mesh.groups
    assert group.name.isprintable()
    assert group.name.startswith("a[31mé")
    assert len(group.name) == 200


def test_long_names_stay_unique(load):
    long = "n" * 300
    text = f"v 0 0 0\nv 1 0 0\nv 0 1 0\ng {long}a\nf 1 2 3\ng {long}b\nf 1 2 3\n"
    names = [group.name for group in load("a.obj", text.encode()).groups]
    assert names == ["n" * 200, "n" * 197 + " #2"]


# ---- OFF and PLY


@pytest.mark.parametrize("name", ["a.off", "ascii.ply", "little.ply", "big.ply", "a.glb"])
def test_index_out_of_range_is_refused(name, load):
    faces = FACES.copy()
    faces[2, 1] = 4
    data = {
        "a.off": lambda: off(POINTS, faces),
        "ascii.ply": lambda: ply(POINTS, faces),
        "little.ply": lambda: ply(POINTS, faces, "<"),
        "big.ply": lambda: ply(POINTS, faces, ">", "uint"),
        "a.glb": lambda: glb(*glb_header(POINTS, faces)),
    }[name]()
    with pytest.raises(MeshError, match=r"vertex indices must lie in 0 ... 3, .*4"):
        load(name, data)


@pytest.mark.parametrize("order", PLY_FORMATS)
def test_negative_ply_index_is_refused(order, load):
    with pytest.raises(MeshError, match=r"face 1 has \[0, 1, -1\]"):
        load("a.ply", ply(POINTS, [[0, 1, 2], [0, 1, -1]], order))


@pytest.mark.parametrize("row", [0, 2])
def test_negative_count_in_a_binary_ply_is_refused(row, load):
    data = VALID["little.ply"].replace(b"list uchar", b"list  char")
    at = data.index(b"end_header\n") + 11 + 4 * 25 + row * 15 + 2
    assert data[at] == 3
    with pytest.raises(MeshError, match="element 'face' needs -1 values of 'vertex_indices'"):
        load("a.ply", data[:at] + b"\xff" + data[at + 1 :])


@pytest.mark.parametrize("order", PLY_FORMATS)
def test_ply_polygons_of_several_sizes_become_fans(order, load):
    polygons = [[0, 1, 2], [0, 1, 2, 3], [3, 2, 1], [2, 3, 0, 1, 2]]
    mesh = load("a.ply", ply(POINTS, polygons, order, "uchar"))
    np.testing.assert_array_equal(mesh.source_face, [0, 1, 1, 2, 3, 3, 3])
    np.testing.assert_array_equal(mesh.faces[[2, 6]], [[0, 2, 3], [2, 1, 2]])


@pytest.mark.parametrize("order", PLY_FORMATS)
def test_ply_faces_of_two_vertices_are_refused(order, load):
    with pytest.raises(MeshError, match="face 1: 3 or more vertices wanted, got 2"):
        load("a.ply", ply(POINTS, [[0, 1, 2], [0, 1]], order))


@pytest.mark.parametrize("old", [b"element vertex 4", b"element face 4", b"element extra 1"])
@pytest.mark.parametrize("name", ["ascii.ply", "little.ply", "big.ply"])
def test_ply_count_is_held_against_the_bytes(name, old, load):
    tracemalloc.start()
    with pytest.raises(MeshError, match=r"promises 2000000000 elements .* \d+ bytes are there"):
        load(name, VALID[name].replace(old, old.rsplit(b" ", 1)[0] + b" 2000000000"))
    assert tracemalloc.get_traced_memory()[1] < 10 << 20
    tracemalloc.stop()


@pytest.mark.parametrize("counts", ["2000000000 4 0", "4 2000000000 0", "-4 4 0", "4 -4 0"])
def test_off_count_is_held_against_the_bytes(counts, load):
    with pytest.raises(MeshError, match=r"promises -?\d+ (vertices|faces)"):
        load("a.off", VALID["a.off"].replace(b"4 4 0", counts.encode()))


@pytest.mark.parametrize("name", ["a.off", "ascii.ply", "little.ply", "big.ply", "a.glb"])
@pytest.mark.parametrize("cut", [20, 60, 110])
def test_truncated_files_are_refused(name, cut, load):
    with pytest.raises(MeshError, match=r"truncated|wanted|promises"):
        load(name, VALID[name][:-cut])


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        (b"OFF", b"OF", "line 1: 'OFF'"),
        (b"OFF", b"4OFF", "line 1: 'OFF'"),
        (b"OFF", b"OFF BINARY", "line 1: 'OFF'"),
        (b"4 4 0", b"4 x 0", "line 2: the counts of vertices, faces, edges wanted"),
        (b"4 4 0", b"4", "line 2: the counts"),
        (b"1.0 0.0 0.0", b"1.0 0.0", "line 4: three coordinates"),
        (b"3 0 1 3", b"4 0 1 3", "line 8: "),
        (b"3 0 1 3", b"2 0 1 3", "line 8: a corner count of 3 or more"),
        (b"3 0 1 3", b"-3 0 1 3", "line 8: a corner count of 3 or more"),
        (b"3 0 1 3", b"3 0 1 3.5", "line 8: a corner count and vertex indices"),
    ],
)
def test_broken_off_says_the_line(old, new, text, load):
    data = VALID["a.off"].replace(b" 255 0 0", b"")
    with pytest.raises(MeshError, match=text):
        load("a.off", data.replace(old, new, 1))


def test_off_with_colours_counts_on_the_first_line_and_more_lines(load):
    data = VALID["a.off"].replace(b"OFF # comment\n", b"COFF ") + b"\nmore\n"
    mesh = load("a.off", data)
    assert mesh.n_faces == 4
    assert "lines after line 9 were not read" in mesh.warnings[0]


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        (b"ply\n", b"plz\n", "no PLY file"),
        (b"end_header", b"and_header", "no PLY file"),
        (b"1.0\n", b"2.0\n", "line 2: a format, element or property wanted"),
        (b"property double y\n", b"", r"wants a property 'y', has \['x', 'z', 'red'\]"),
        (b"vertex_indices", b"indices", "wants a property 'vertex_indices'"),
        (b"list uchar int", b"list float int", "line 11: a format, element or property"),
        (b"list uchar int", b"list uchar float", "wants a property 'vertex_indices'"),
        (b"element extra", b"element face", "line 12: each element once"),
        (b"element extra 1", b"element extra -1", "line 12: a format, element"),
        (b"property short", b"property half", "line 10: a format, element"),
        (b"property int a", b"int a", "line 13: a format, element"),
    ],
)
@pytest.mark.parametrize("name", ["ascii.ply", "big.ply"])
def test_broken_ply_header_says_what_is_wanted(name, old, new, text, load):
    assert old in VALID[name]
    with pytest.raises(MeshError, match=text):
        load(name, VALID[name].replace(old, new, 1))


def test_ply_without_a_format_is_refused(load):
    with pytest.raises(MeshError, match="a line 'format' with one of"):
        load("a.ply", VALID["ascii.ply"].replace(b"format ascii 1.0\n", b""))


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [(b"1.0 0.0 0.0 7", b"1.0 0.0 0.0", 16), (b"5 3 0 1 3", b"5 4 0 1 3", 20),
     (b"5 3 0 1 3", b"5 3 0 1 x", 20), (b"5 3 0 1 3", b"5 -1 0 1 3", 20)],
)  # fmt: skip
def test_broken_text_ply_says_the_line(old, new, line, load):
    with pytest.raises(MeshError, match=f"line {line}: values for"):
        load("a.ply", VALID["ascii.ply"].replace(old, new, 1))


@pytest.mark.parametrize("name", ["ascii.ply", "little.ply"])
def test_trailing_ply_data_loads_with_a_warning(name, load):
    mesh = load(name, VALID[name] + b"1 2 3\n")
    assert mesh.n_faces == 4
    assert "not read" in mesh.warnings[0]


# ---- GLB


def one_node(**node) -> bytes:
    header, binary = glb_header(POINTS, FACES)
    header["nodes"][0].update(node)
    return glb(header, binary)


def test_nodes_are_groups_with_their_transforms(load):
    header, binary = glb_header(POINTS, FACES)
    turn = [0, 0, np.sqrt(0.5), np.sqrt(0.5)]  # 90 degrees about z
    header["nodes"] = [
        {"children": [2, 1], "translation": [10, 0, 0], "rotation": turn, "scale": [2, 2, 2]},
        {"mesh": 0, "name": "part", "matrix": np.diag([1, 2, 3, 1.0]).ravel().tolist()},
        {"mesh": 0, "name": "part", "translation": [1, 0, 0]},
        {"mesh": 0, "name": "not in the scene"},
    ]
    mesh = load("a.glb", glb(header, binary))
    assert [group.name for group in mesh.groups] == ["part", "part #2"]
    quarter = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    first = 2 * (POINTS + np.array([1, 0, 0])) @ quarter.T + [10, 0, 0]
    second = 2 * (POINTS * [1, 2, 3]) @ quarter.T + [10, 0, 0]
    np.testing.assert_allclose(triangles(mesh)[:4], first[FACES], atol=1e-12)
    np.testing.assert_allclose(triangles(mesh)[4:], second[FACES], atol=1e-12)


def test_mirrored_nodes_still_face_outwards(load):
    mesh = load("a.glb", one_node(scale=[-1, 1, 1]))
    assert mesh.can_cull_back_faces
    np.testing.assert_array_equal(triangles(mesh), (POINTS * [-1, 1, 1])[FACES[:, [0, 2, 1]]])


def test_scene_is_the_default_one_and_roots_are_found_without(load):
    header, binary = glb_header(POINTS, FACES)
    header["nodes"] = [{"mesh": 0, "name": "zero"}, {"children": [0], "name": "root"}]
    header["scenes"], header["scene"] = [{"nodes": []}, {"nodes": [1]}], 1
    assert load("a.glb", glb(header, binary)).n_faces == 4
    del header["scenes"]
    assert load("a.glb", glb(header, binary)).n_faces == 4


@pytest.mark.parametrize(
    ("mode", "corners", "expected"),
    [
        (5, [0, 1, 2, 3, 0], [[0, 1, 2], [1, 3, 2], [2, 3, 0]]),
        (6, [0, 1, 2, 3], [[1, 2, 0], [2, 3, 0]]),
    ],
)
def test_strips_and_fans_are_unrolled(mode, corners, expected, load):
    mesh = load("a.glb", glb(*glb_header(POINTS, corners, mode=mode)))
    np.testing.assert_array_equal(mesh.faces, expected)


def test_primitives_without_indices_take_vertices_in_turn(load):
    header, binary = glb_header(POINTS[FACES].reshape(-1, 3), [])
    del header["meshes"][0]["primitives"][0]["indices"]
    mesh = load("a.glb", glb(header, binary))
    np.testing.assert_array_equal(triangles(mesh), POINTS[FACES])


def test_primitives_of_a_node_share_vertices_and_points_are_noted(load):
    header, binary = glb_header(POINTS, FACES)
    primitive = header["meshes"][0]["primitives"][0]
    header["meshes"][0]["primitives"] = [primitive, {**primitive, "mode": 0}, primitive]
    mesh = load("a.glb", glb(header, binary))
    assert (mesh.n_vertices, mesh.n_faces) == (4, 8)
    assert any("1 primitives of points or lines" in line for line in mesh.warnings)


def test_normalised_integers_are_dequantised(load):
    header, _ = glb_header(POINTS, FACES)
    packed = np.zeros((4, 4), "<i2")  # a stride of 8 bytes: three components and padding
    packed[:, :3] = POINTS * 32767
    header["bufferViews"][0].update(byteLength=32, byteStride=8)
    header["bufferViews"][1].update(byteOffset=32)
    header["accessors"][0].update(componentType=5122, normalized=True)
    header["extensionsRequired"] = ["KHR_mesh_quantization"]
    mesh = load("a.glb", glb(header, packed.tobytes() + FACES.astype("<u2").tobytes()))
    np.testing.assert_array_equal(triangles(mesh), POINTS[FACES])


def glb_with(*keys, value) -> bytes:
    header, binary = glb_header(POINTS, FACES)
    owner = header
    for key in keys[:-1]:
        owner = owner[key]
    owner[keys[-1]] = value
    return glb(header, binary)


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (glb_with("extensionsRequired", value=["KHR_draco_mesh_compression"]), "not supported"),
        (glb_with("accessors", 0, "sparse", value={}), "accessor 0 is sparse or compressed"),
        (glb_with("accessors", 0, "count", value=5), "promises 5 elements of 12 bytes"),
        (glb_with("accessors", 0, "count", value=-1), "'count' must be a whole number"),
        (glb_with("accessors", 0, "count", value=1.5), "'count' must be a whole number"),
        (glb_with("accessors", 0, "type", value="VEC2"), "accessor 0 must be VEC3, got 'VEC2'"),
        (glb_with("accessors", 1, "componentType", value=5126), "accessor 1 must be SCALAR"),
        (glb_with("accessors", 1, "componentType", value=[]), "contradicts its format"),
        (glb_with("accessors", 1, "count", value=11), "triangles need 3 corners each, got 11"),
        (glb_with("bufferViews", 0, "byteStride", value=1), "12 bytes every 1"),
        (glb_with("bufferViews", 0, "byteOffset", value=10**30), "view holds 0 bytes"),
        (glb_with("bufferViews", 0, "buffer", value=1), "'buffers' has 1 objects, number 1"),
        (glb_with("nodes", 0, "children", value=[0]), "node 0 has two parents"),
        (glb_with("nodes", 0, "children", value=[-1]), "'nodes' has 1 objects, number -1"),
        (glb_with("nodes", 0, "mesh", value=True), "'meshes' has 1 objects, number True"),
        (glb_with("nodes", 0, "matrix", value=[1, 2]), "contradicts its format"),
        (glb_with("nodes", 0, "matrix", value=[10**400] * 16), "contradicts its format"),
        (glb_with("nodes", 0, "scale", value="big"), "contradicts its format"),
        (glb_with("nodes", 0, "translation", value=[1e300, 0, 0]), "coordinates must be finite"),
        (glb_with("nodes", value={}), "'nodes' must be a list, got dict"),
        (glb_with("meshes", 0, "primitives", value=[7]), "contradicts its format"),
        (glb({})[:4] + b"\1" + glb({})[5:], "version 2 wanted, got 1"),
        (b"glTG" + glb({})[4:], "begins with 'glTF'"),
        (b"glTF" + struct.pack("<IIII", 2, 24, 4, 0x4E4F534A) + b"{[}]", "no readable JSON"),
        (b"glTF" + struct.pack("<IIII", 2, 24, 4, 0x4E4F534A) + b"null", "must be an object"),
        (b"glTF" + struct.pack("<IIII", 2, 24, 99, 0x4E4F534A) + b"null", "promises 99 bytes"),
        (b"glTF" + struct.pack("<IIII", 2, 24, 4, 0) + b"null", "no readable JSON"),
        (b"glTF" + struct.pack("<IIII", 2, 200020, 200000, 0x4E4F534A) + b"[" * 200000, "JSON"),
    ],
)
def test_broken_glb_says_what_is_wrong(data, text, load):
    with pytest.raises(MeshError, match=text):
        load("a.glb", data)


def test_skins_and_trailing_bytes_are_noted(load):
    lines = load("a.glb", one_node(skin=0) + b"junk").warnings
    assert "4 trailing bytes" in lines[0]
    assert "has a skin" in lines[1]


# ---- what must never be opened


@pytest.fixture
def opened(monkeypatch):
    """Names of the files that were opened since, and no network."""
    names: list[str] = []
    watch = True

    def hook(event: str, arguments: tuple) -> None:
        if watch and event == "open" and isinstance(arguments[0], (str, os.PathLike)):
            names.append(Path(arguments[0]).name)

    def refuse(*arguments: object, **options: object) -> None:
        raise AssertionError("the network was asked")

    monkeypatch.setattr(socket, "socket", refuse)
    monkeypatch.setattr(socket, "getaddrinfo", refuse)
    sys.addaudithook(hook)
    yield names
    watch = False  # an audit hook cannot be removed


@pytest.mark.parametrize(
    "uri", ["secret.bin", "../secret.bin", "/etc/passwd", "file:///etc/passwd"]
)
def test_external_buffers_are_refused_and_never_opened(uri, load, opened, tmp_path):
    (tmp_path / "secret.bin").write_bytes(bytes(1000))
    del opened[:]
    with pytest.raises(MeshError, match="outside the file"):
        load("a.glb", glb_with("buffers", 0, "uri", value=uri))
    assert set(opened) == {"a.glb"}


def test_images_and_material_libraries_are_never_opened(load, opened, tmp_path):
    for name in ("secret.mtl", "secret.png"):
        (tmp_path / name).write_text("secret")
    del opened[:]
    load("a.glb", glb_with("images", value=[{"uri": "secret.png"}]))
    load("a.obj", b"mtllib secret.mtl\nmtllib ../../../etc/passwd\n" + VALID["a.obj"])
    assert set(opened) == {"a.glb", "a.obj"}


@pytest.mark.parametrize(
    "url",
    ["http://example.org/a.stl", "https://example.org/a.glb", "file:///a.stl", "s3://b/a.ply"],
)
@pytest.mark.parametrize("make", [str, Path])
def test_urls_are_refused_without_a_network_call(url, make, opened):
    with pytest.raises(MeshError, match="got a URL; download it first"):
        Mesh.load(make(url))
    assert not opened


@pytest.mark.parametrize(
    "name", ["a.zip", "a.3mf", "a.dae", "a.gltf", "a.xml", "a.stl.gz", "a", ".stl", "a.npy"]
)
def test_other_formats_are_refused_unopened(name, load, opened):
    with pytest.raises(MeshError, match=r"formats are \.glb, \.obj, \.off, \.ply, \.stl, got"):
        load(name, b"PK\3\4")
    assert opened in ([], [name])  # once, when the test wrote it


def test_pipe_device_and_folder_are_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "pipe.stl")
    (tmp_path / "zero.stl").symlink_to("/dev/zero")
    (tmp_path / "folder.stl").mkdir()
    for name in ("pipe.stl", "zero.stl", "folder.stl"):
        with pytest.raises(MeshError, match=f"{name}: a regular file wanted"):
            Mesh.load(tmp_path / name)


def test_link_to_a_regular_file_is_followed(tmp_path):
    (tmp_path / "a.stl").write_bytes(VALID["binary.stl"])
    (tmp_path / "link.stl").symlink_to("a.stl")
    mesh = Mesh.load(tmp_path / "link.stl")
    assert mesh.sources[0].name == "link.stl"
    assert mesh.n_faces == 4


@pytest.mark.parametrize("name", ["missing.stl", "no/folder.stl", "zero\0byte.stl"])
def test_missing_files_are_named(name, tmp_path):
    with pytest.raises(MeshError, match=r"\.stl: a readable file wanted, got: .*; check the path"):
        Mesh.load(tmp_path / name)


def test_size_is_capped_before_reading(tmp_path, opened):
    with (tmp_path / "big.stl").open("wb") as file:
        file.truncate(3 << 30)  # a hole: takes no room
    del opened[:]
    with pytest.raises(MeshError, match="at most 2147483648 bytes wanted, got 3221225472"):
        Mesh.load(tmp_path / "big.stl")
    assert not opened


def test_file_is_read_once_and_hashed_as_read(load, opened):
    mesh = load("a.stl", VALID["binary.stl"])
    assert opened == ["a.stl", "a.stl"], "one by the test that writes, one by the loader"
    assert mesh.sources[0].sha256 == hashlib.sha256(VALID["binary.stl"]).hexdigest()


@pytest.mark.parametrize("change", [-1, 1])
def test_file_that_changes_while_it_is_read_is_refused(change, tmp_path, monkeypatch):
    path = tmp_path / "a.stl"
    path.write_bytes(VALID["binary.stl"])
    before = path.stat()
    grown = os.stat_result([*before[:6], before.st_size + change, *before[7:]])
    monkeypatch.setattr(Path, "stat", lambda *a, **k: grown)
    with pytest.raises(MeshError, match="the file changed while it was read"):
        Mesh.load(path)


# ---- memory


@pytest.mark.parametrize("name", [name for name in VALID if name != "ascii.stl"])
def test_budget_is_held_against_an_estimate(name, load):
    assert load(name, VALID[name], memory_budget=4 * 300).n_faces == 4
    with pytest.raises(ResourceError, match=rf"{name}: 4 triangles need about 1200 bytes, the bud"):
        load(name, VALID[name], memory_budget=1199)


def test_budget_is_checked_before_anything_is_allocated(tmp_path):
    n = 1_000_000
    with (tmp_path / "a.stl").open("wb") as file:
        file.write(bytes(80) + struct.pack("<I", n))
        file.truncate(84 + 50 * n)
    tracemalloc.start()
    with pytest.raises(ResourceError, match="1000000 triangles need about 300000000 bytes"):
        Mesh.load(tmp_path / "a.stl", memory_budget=100_000_000)
    assert tracemalloc.get_traced_memory()[1] < 84 + 50 * n + (1 << 20)
    tracemalloc.stop()


def test_instances_of_one_mesh_count_against_the_budget(load):
    header, binary = glb_header(POINTS, FACES)
    header["nodes"] = [{"mesh": 0}] * 1000
    header["scenes"] = [{"nodes": list(range(1000))}]
    assert load("a.glb", glb(header, binary)).n_faces == 4000
    with pytest.raises(ResourceError, match="triangles need about"):
        load("a.glb", glb(header, binary), memory_budget=300 * 3999)


# ---- laws


TMP_PATH_IS_SHARED = [HealthCheck.function_scoped_fixture]  # each example writes it anew


def promised(name: str, content: bytes) -> int | None:
    """Polygons that a file claims to have, found without the loader; None if that is unclear."""
    lines = [line.split() for line in content.split(b"\n")]
    match name.partition(".")[2], name.partition(".")[0]:
        case "stl", "binary":
            return int.from_bytes(content[80:84], "little")
        case "stl", _:
            return sum(words[:1] == [b"endfacet"] for words in lines)
        case "obj", _:
            is_plain = b"\\" not in content and b"#" not in content[9:]
            return sum(words[:1] == [b"f"] for words in lines) if is_plain else None
        case "off", _:
            words = b" ".join(line.partition(b"#")[0] for line in content.split(b"\n")).split()
            return int(words[2])
        case "ply", _:
            (count,) = re.findall(rb"\nelement\s+face\s+(\d+)", content)
            return int(count)
    size = int.from_bytes(VALID[name][12:16], "little") + 20
    return 4 if content[:size] == VALID[name][:size] else None


@pytest.mark.parametrize("name", VALID)
@settings(deadline=None, max_examples=150, suppress_health_check=TMP_PATH_IS_SHARED)
@given(data=st.data())
def test_corrupt_files_load_whole_or_raise_mesh_error(name, data, tmp_path):
    content = bytearray(VALID[name])
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(content)))
        kind = data.draw(st.sampled_from(["change", "delete", "insert", "cut"]))
        piece = data.draw(st.binary(min_size=1, max_size=8))
        if kind == "change":
            content[at : at + len(piece)] = piece[: len(content) - at]
        elif kind == "delete":
            del content[at : at + len(piece)]
        elif kind == "insert":
            content[at:at] = piece
        else:
            del content[at:]
    path = tmp_path / name
    path.write_bytes(content)
    message = ""
    try:
        mesh = Mesh.load(path)
    except MeshError as error:
        message = str(error)
    if message:
        assert name in message
        assert message.isprintable()
        return
    count = promised(name, bytes(content))
    polygons = np.unique(mesh.source_face)
    assert count in (None, len(polygons))
    np.testing.assert_array_equal(polygons, np.arange(len(polygons)))
    assert mesh.n_faces == mesh.sources[0].n_faces
    assert isinstance(mesh.warnings, tuple)


@pytest.mark.parametrize("extension", ["stl", "obj", "off", "ply", "glb"])
@settings(deadline=None, max_examples=60, suppress_health_check=TMP_PATH_IS_SHARED)
@given(content=st.binary(max_size=300))
def test_random_bytes_never_raise_anything_else(extension, content, tmp_path):
    start = {"glb": b"glTF\2\0\0\0", "ply": b"ply\nformat "}.get(extension, b"")
    path = tmp_path / f"a.{extension}"
    path.write_bytes(start + content)
    with contextlib.suppress(MeshError):
        Mesh.load(path)


@pytest.mark.parametrize("name", VALID)
@settings(deadline=None, max_examples=30, suppress_health_check=TMP_PATH_IS_SHARED)
@given(seed=st.integers(0, 2**32 - 1))
def test_random_meshes_come_back_face_for_face(name, seed, tmp_path):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(rng.integers(3, 9), 3)).astype(np.float32).astype(float)
    faces = rng.integers(0, len(points), (rng.integers(1, 20), 3))
    content = {
        "binary.stl": lambda: binary_stl(points[faces]),
        "ascii.stl": lambda: ascii_stl(points[faces]),
        "a.obj": lambda: obj(points, faces),
        "a.off": lambda: off(points, faces),
        "ascii.ply": lambda: ply(points, faces),
        "little.ply": lambda: ply(points, faces, "<"),
        "big.ply": lambda: ply(points, faces, ">", "uchar"),
        "a.glb": lambda: glb(*glb_header(points, faces)),
    }[name]()
    path = tmp_path / name
    path.write_bytes(content)
    np.testing.assert_array_equal(triangles(Mesh.load(path)), points[faces])


REAL = {
    "spot.obj": (5856, 0),
    "stanford-bunny.obj": (69451, 223),
    "bunny_1602_closed.ply": (1602, 0),
    "bunny_5122_closed.ply": (5122, 0),
    "featuretype.STL": (3476, 576),
    "ADIS16480.STL": (7436, 0),
    "warehouse.ply": (15003, None),
}


@pytest.mark.skipif(not MESHES.is_dir(), reason="the folder of real meshes is not there")
@pytest.mark.parametrize("name", REAL)
def test_real_meshes_have_their_published_counts(name):
    n_faces, n_boundary_edges = REAL[name]
    mesh = Mesh.load(MESHES / name)
    assert mesh.n_faces == n_faces
    if n_boundary_edges is not None:
        assert mesh.n_boundary_edges == n_boundary_edges
        assert mesh.can_cull_back_faces == (n_boundary_edges == 0)
    else:
        assert mesh.duplicate_mask.any()
