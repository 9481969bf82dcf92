"""Binary STL and PLY: counts are compared with the bytes that are there."""

import time
import tracemalloc

import numpy as np
import pytest
import trimesh
from mesh_files import (
    FACES,
    PLY_FORMATS,
    POINTS,
    VALID,
    binary_stl,
    ply,
    strips,
    triangles,
)

from rastercov.base.errors import MeshError, ResourceError

every_order = pytest.mark.parametrize("order", PLY_FORMATS)


# ---- STL


def test_binary_stl_that_begins_with_solid_is_binary(load):
    mesh = load("a.stl", binary_stl(POINTS, FACES, b"solid facet normal"))
    np.testing.assert_array_equal(triangles(mesh), POINTS[FACES])


def test_stl_merges_only_what_is_equal_bit_for_bit(load):
    corners = POINTS[FACES].astype(np.float32)
    corners[1, 0, 0] = np.nextafter(np.float32(0), np.float32(1))
    mesh = load("a.stl", binary_stl(corners.reshape(-1, 3), np.arange(12).reshape(4, 3)))
    assert mesh.n_vertices == 5
    np.testing.assert_array_equal(triangles(mesh), corners)


def test_lying_stl_count_is_refused_at_once(load):
    tracemalloc.start()
    start = time.process_time()
    with pytest.raises(
        MeshError,
        match=r"expected 4000000000 triangles, .* got 134 bytes",
    ):
        load("a.stl", binary_stl(POINTS, FACES[:1], count=4_000_000_000))
    elapsed, (_, peak) = time.process_time() - start, tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert elapsed < 0.05
    assert peak < 10 << 20


@pytest.mark.parametrize("cut", [1, 49, 50, 99, 150])
def test_truncated_binary_stl_says_where(cut, load):
    data = VALID["binary.stl"][:-cut]
    text = f"got {len(data)} bytes, to triangle {(len(data) - 84) // 50};"
    with pytest.raises(MeshError, match=text):
        load("a.stl", data)


# ---- PLY


@pytest.mark.parametrize("row", [0, 2])
def test_negative_count_in_a_binary_ply_is_refused(row, load):
    data = VALID["little.ply"].replace(b"list uchar", b"list  char")
    at = data.index(b"end_header\n") + 11 + 4 * 25 + row * 15 + 2
    assert data[at] == 3
    with pytest.raises(
        MeshError, match="expected -1 values of 'vertex_indices' of element 'face' up to"
    ):
        load("a.ply", data[:at] + b"\xff" + data[at + 1 :])


@every_order
def test_ply_polygons_of_several_sizes_become_fans(order, load):
    polygons = [[0, 1, 2], [0, 1, 2, 3], [3, 2, 1], [2, 3, 0, 1, 2]]
    mesh = load("a.ply", ply(POINTS, polygons, order, "uchar"))
    np.testing.assert_array_equal(mesh.source_face, [0, 1, 1, 2, 3, 3, 3])
    np.testing.assert_array_equal(mesh.faces[[2, 6]], [[0, 2, 3], [2, 1, 2]])


@every_order
def test_ply_faces_of_two_vertices_are_refused(order, load):
    with pytest.raises(MeshError, match="face 1: expected 3 or more vertices, got 2"):
        load("a.ply", ply(POINTS, [[0, 1, 2], [0, 1]], order))


@pytest.mark.parametrize("name", ["ascii.ply", "little.ply", "big.ply"])
def test_ply_count_is_held_against_the_bytes(name, load):
    for element in (b"element vertex ", b"element face ", b"element extra "):
        data = VALID[name].replace(element, element + b"200000000")
        tracemalloc.start()
        with pytest.raises(
            MeshError, match=r"expected 200000000\d elements .*, as declared, of at least"
        ):
            load(name, data)
        assert tracemalloc.get_traced_memory()[1] < 10 << 20
        tracemalloc.stop()


@every_order
def test_ply_strips_are_unrolled_with_their_winding(order, load):
    lists = [[0, 1, 2, 3, 0, -1, 3, 2, 1, -1], [1, 2, 3]]
    mesh = load("a.ply", strips(lists, order))
    np.testing.assert_array_equal(
        mesh.faces, [[0, 1, 2], [1, 3, 2], [2, 3, 0], [3, 2, 1], [1, 2, 3]]
    )
    np.testing.assert_array_equal(mesh.source_face, np.arange(5))
    assert not mesh.notes


@pytest.mark.parametrize("order", ["", "<"])
@pytest.mark.parametrize("short", [[0, 1], [0, 1, 2, -1, 3], [0, 1, -1, 1, 2, 3]])
def test_ply_strips_of_less_than_a_triangle_are_refused(order, short, load):
    with pytest.raises(MeshError, match="a strip of 3 or more vertices"):
        load("a.ply", strips([[0, 1, 2], short], order))


@pytest.mark.slow
@every_order
@pytest.mark.parametrize("more", [[], [[0, 1, 2]]])
def test_list_rows_count_against_the_budget(order, more, load):
    """The header of these has 200 faces, their lists 47,600 triangles."""
    data = ply(POINTS, [[0, 1, 2] * 80] * 200 + more, order)
    assert load("a.ply", data).n_faces == 47_600 + len(more)
    contents = [data]
    if order:
        contents.append(data.replace(b"element face", b"element tristrips"))
    for content in contents:
        with pytest.raises(ResourceError, match=r"got \d+ bytes for"):
            load("a.ply", content, memory_budget=47_600 * 300 - 1)


NAMES = {
    "i1": ("char", "int8"), "u1": ("uchar", "uint8"), "i2": ("short", "int16"),
    "u2": ("ushort", "uint16"), "i4": ("int", "int32"), "u4": ("uint", "uint32"),
    "i8": ("int64",), "u8": ("uint64",), "f2": ("float16",), "f4": ("float", "float32"),
    "f8": ("double", "float64"),
}  # fmt: skip
WORDS = [(name, kind) for kind, names in NAMES.items() for name in names]
WHOLE = [each for each in WORDS if each[1][0] != "f"]


def typed(rows, order):
    """A PLY file of elements, each a name, properties and rows of lists of values.

    A property is a name, its type and, of a list, the type of its count, as (word, numpy's).
    """
    head, body, sign = ["ply", f"format {PLY_FORMATS[order]} 1.0"], b"", order or "<"
    for element, properties, values in rows:
        head.append(f"element {element} {len(values)}")
        for name, (word, _), *count in properties:
            head.append("property " + (f"list {count[0][0]} " if count else "") + f"{word} {name}")
        for row in values:
            words = []
            for (_, (_, kind), *count), value in zip(properties, row, strict=True):
                if count:
                    words.append(np.array([len(value)], sign + count[0][1]))
                words.append(np.atleast_1d(np.array(value)).astype(sign + kind))
            if not order:
                body += (
                    " ".join(repr(each.item()) for part in words for each in part).encode() + b"\n"
                )
            else:
                body += b"".join(part.tobytes() for part in words)
    return "\n".join([*head, "end_header", ""]).encode() + body


@every_order
@pytest.mark.parametrize("axis", WORDS, ids=lambda each: each[0])
def test_ply_numbers_of_every_type_are_read_and_passed_over(axis, order, load):
    rng = np.random.default_rng(len(axis[0]))
    kind = np.dtype(axis[1])
    points = rng.integers(0, 90, (5, 3)).astype(kind)
    if kind.kind == "f":
        points = rng.normal(size=(5, 3)).astype(kind)
        points[0] = (
            np.finfo(kind).tiny / 4,
            -min(float(np.finfo(kind).max), 1e29),
            np.finfo(kind).eps,
        )
    some = [rng.integers(0, 9, rng.integers(0, 4)).tolist() for _ in range(5)]
    for count in WHOLE:
        own = [("x", axis), ("other", axis), ("y", axis), ("more", axis, count), ("z", axis)]
        rows = [(x, 7, y, more, z) for (x, y, z), more in zip(points, some, strict=True)]
        faces = [([0, 1, 2], 3), ([0, 2, 3, 4], 1)]
        corners = [("vertex_indices", count, count), ("source", axis)]
        mesh = load("a.ply", typed([("vertex", own, rows), ("face", corners, faces)], order))
        np.testing.assert_array_equal(mesh.vertices, points.astype(float))
        assert mesh.n_faces == 3


@every_order
@pytest.mark.parametrize(
    ("kind", "index"),
    [(word, index) for word in WHOLE for index in (5, np.iinfo(word[1]).max)]
    + [(word, np.iinfo(word[1]).min) for word in WHOLE if word[1][0] == "i"],
)
def test_a_ply_index_beyond_the_vertices_is_refused_in_a_line(kind, index, order, load):
    own = [(axis, ("float", "f4")) for axis in "xyz"]
    corners = [("vertex_indices", kind, ("uchar", "u1"))]
    faces = [([0, 1, 2],), (np.array([0, 1, index], kind[1]),)]
    with pytest.raises(MeshError, match=r"^[^\n]*expected[^\n]*$"):
        load("a.ply", typed([("vertex", own, POINTS[:5]), ("face", corners, faces)], order))


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("count", [2**62, 2**63 - 1, 2**63, 2**64 - 1])
def test_a_ply_count_beyond_all_memory_is_refused_in_a_line(count, order, load):
    own = [(axis, ("float", "f4")) for axis in "xyz"]
    corners = [("vertex_indices", ("int64", "i8"), ("uint64", "u8"))]
    data = typed([("vertex", own, POINTS), ("face", corners, [([0, 1, 2],)])], order)
    at = len(data) - 4 * 8
    with pytest.raises(MeshError, match=r"^[^\n]*expected \d+ values of 'vertex_indices'[^\n]*$"):
        load("a.ply", data[:at] + np.array([count], order + "u8").tobytes() + data[at + 8 :])


def test_what_trimesh_writes_is_read(load):

    mesh = trimesh.Trimesh(POINTS, FACES, process=False)
    rng = np.random.default_rng(0)
    for kind in NAMES:
        mesh.face_attributes[f"f{kind}"] = rng.integers(0, 9, len(FACES)).astype(kind)
        mesh.vertex_attributes[f"v{kind}"] = rng.integers(0, 9, len(POINTS)).astype(kind)
    for encoding in ("ascii", "binary"):
        data = mesh.export(file_type="ply", encoding=encoding, include_attributes=True)
        np.testing.assert_array_equal(triangles(load("a.ply", data)), POINTS[FACES])
