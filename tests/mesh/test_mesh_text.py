"""Meshes in text: broken and cut lines, numbers that are none, marks and line ends."""

import re

import numpy as np
import pytest
from mesh_files import FACES, POINTS, TEXT, VALID, obj, off, ply, refusal, triangles

from rastercov.base.errors import MeshError, ResourceError

TRIANGLE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"
CUT = "the file ends within a line"


def long_obj() -> bytes:
    """An OBJ whose last corner, 12, has two digits."""
    return obj(np.tile(POINTS, (3, 1)), FACES + 8).replace(b"//1", b"")


def long_off() -> bytes:
    return off(np.tile(POINTS, (3, 1)), [[0, 1, 2], [9, 10, 11]]).replace(b" 255 0 0", b"")


def long_ply() -> bytes:
    data = ply(np.tile(POINTS, (3, 1)), [[0, 1, 2], [9, 10, 11]])
    return data.replace(b"element extra 1\nproperty int a\n", b"").removesuffix(b"9\n")


# ---- one place that is wrong: test_mesh_damage has every word


PLACES = [
    ("ascii.stl", b"  vertex 0.0 1.0 0.0\n", b"", "line 6: "),  # a facet with two vertices
    ("ascii.stl", b"endfacet\nfacet", b"endfacet\nfaced", "line 9: "),
    ("ascii.stl", b"endloop", b"endloop endfacet", "line 7: "),
    ("ascii.stl", b"endsolid a name\n", b"endsolid\nfacet\n", "line 31: "),
    ("ascii.stl", b"endsolid a name\n", b"", "'endsolid' after line 29, got the end"),
    ("a.obj", b"v 1.0 0.0 0.0", b"v 1.0 0.0", "line 5: expected three coordinates"),
    ("a.obj", b"v 1.0 0.0 0.0", b"v 1.0 0.0 0.0 1 1", "line 5: expected three coordinates"),
    *(("a.obj", b"f 1//1 2//1 4//1", b"f " + corners, f"line 10: {text}") for corners, text in (
        (b"1 2 5", "expected vertex indices in 1 ... 4, got 5"), (b"1 2", "expected a face of 3"),
        (b"0 1 2", "expected vertex indices from 1, or from -1 to -4, got 'f 0 1 2'"),
        *((corner + b" 2 3", "expected corners of whole")
          for corner in (b"1/x/y", b"1/1/1/1", b"/1", b"1/1_0")))),
    ("a.off", b"4 4 0", b"4 4 0 0", "line 2: expected the counts of vertices, faces, edges"),
    *(("a.off", b"4 4 0", counts, r"expected -?\d+ (vertices|faces), as declared")
      for counts in (b"2000000000 4 0", b"4 2000000000 0", b"-4 4 0", b"4 -4 0")),
    ("a.off", b"1.0 0.0 0.0", b"1.0 0.0 0.0 5 5", "line 4: expected three coordinates"),
    *(("a.off", b"3 0 1 3 255 0 0", row, "line 8: expected a corner count of 3 or more")
      for row in (b"4 0 1 3", b"2 0 1 3", b"-3 0 1 3", b"3 0 1 3 255 0")),
    *(("ascii.ply", b"5 3 0 1 3", row, "line 20: expected values for")
      for row in (b"5 4 0 1 3", b"5 3 0 1 3 2", b"5 -1 0 1 3")),
    *((name, old, new, text) for name in ("ascii.ply", "big.ply") for old, new, text in (
        (b"ply\n", b"plz\n", "name a PLY file"), (b"format", b"comment", "'format' with one of"),
        (b"property double y\n", b"", r"expected a property 'y', got \['x', 'z', 'red'\]"),
        (b"list uchar int", b"list float int", "line 11: expected a format, element or property"),
        (b"list uchar int", b"list uchar float", "expected a property 'vertex_indices'"),
        (b"element extra", b"element face", "line 12: expected each element once"))),
]  # fmt: skip


def test_a_file_that_is_wrong_in_one_place_is_refused_with_its_line(load):
    for name, old, new, text in PLACES:
        assert old in VALID[name], old
        message = refusal(load, name, VALID[name].replace(old, new, 1))
        assert re.search(f"{name}: .*{text}", message), (old, new, message)


@pytest.mark.parametrize("word", ["+1", "01", "1.", "1E0", "10e-1", ".1e1", "+1.0e+00", "1e+000"])
def test_every_way_to_write_a_number_is_one(word, load):
    for name in TEXT:
        data = re.sub(rb"(?<!ascii )1\.0", word.encode(), VALID[name])
        np.testing.assert_array_equal(load(name, data).vertices, load(name, VALID[name]).vertices)


# ---- files that were cut


LONG = {
    "a.stl": VALID["ascii.stl"],
    "a.obj": long_obj(),
    "a.off": long_off() + b"\n",
    "a.ply": long_ply(),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", LONG)
def test_no_cut_changes_a_face_without_a_note(name, load):
    """At every byte; a cut after a whole line of an OBJ leaves a whole OBJ."""
    data, n_loaded = LONG[name], 0
    whole = load(name, data)
    assert whole.notes == ()
    for size in range(len(data)):
        if name == "a.obj" and data[:size].endswith(b"\n"):
            continue
        try:
            mesh = load(name, data[:size])
        except MeshError:
            continue
        n_loaded += 1
        is_same = np.array_equal(triangles(mesh), triangles(whole))
        assert is_same or CUT in mesh.notes[0], data[:size][-30:]
    assert n_loaded
    assert load("a.stl", VALID["ascii.stl"].removesuffix(b" a name\n")).notes == ()


@pytest.mark.parametrize("end", [b"\\", b"\\\n", b"\\  \n", b"\\\r\n"])
def test_obj_that_ends_in_a_continued_line_is_noted(end, load):
    mesh = load("a.obj", TRIANGLE + b"f 1 2 3 " + end)
    assert mesh.n_faces == 1
    assert CUT in mesh.notes[0]
    assert load("a.obj", TRIANGLE + b"f 1 2 3 " + end.rstrip() + b"\n\n").notes == ()


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [("a.off", b"12 2 0", b"11 2 0"), ("a.off", b"12 2 0", b"12 1 0"),
     ("a.ply", b"vertex 12", b"vertex 11"), ("a.ply", b"face 2", b"face 1")],
)  # fmt: skip
def test_a_header_that_promises_less_than_there_is_never_passes_silently(name, old, new, load):
    data = long_off() + b"\n" if name == "a.off" else long_ply()
    assert old in data
    try:
        mesh = load(name, data.replace(old, new))
    except MeshError:
        return
    assert "ignored the lines after" in mesh.notes[0]


# ---- OBJ


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
        TRIANGLE + b"f 1 2 3\no body\nf 1 2 3\ng lid  left\nf 1 2 3\n"
        b"g empty\no body\nf 1 2 3\ng\nf 1 2 3\ng part\nf 1 2 3\n",
    )
    assert [g.name for g in mesh.groups] == ["part", "body", "lid left", "part #2"]
    np.testing.assert_array_equal(mesh.face_group, [0, 1, 2, 1, 0, 3])


@pytest.mark.parametrize("keyword", ["f", "fo"])
@pytest.mark.parametrize("corner", ["1", "1/7", "1//7", "1/7/7", "-3/-1", "1//", "1/", "+1/2"])
def test_corners_of_an_obj_may_have_texture_and_normals(corner, keyword, load):
    """Version 2.11 of the format wrote fo."""
    mesh = load("a.obj", TRIANGLE + f"{keyword} {corner} 2 3\n".encode())
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2]])


@pytest.mark.parametrize("more", ["", " 1", " .1 .2 .3", " 1 .1 .2 .3"])
def test_obj_vertices_may_have_a_weight_and_a_colour(more, load):
    mesh = load("a.obj", TRIANGLE.replace(b"\n", f"{more}\n".encode()) + b"f 1 2 3\n")
    np.testing.assert_array_equal(mesh.vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0]])


# ---- OFF and STL


@pytest.mark.parametrize(
    ("kind", "more"),
    [("OFF", ""), ("OFF", " 255 0 0"), ("OFF", " 1 0 0 1"), ("COFF", " 1 0 0 1"),
     ("COFF", ""), ("NOFF", " 0 0 1"),
     ("CNOFF", " 0 0 1 9 9 9"), ("STOFF", " .5 .5"), ("STCNOFF", " 0 0 1 9 9 9 9 .5 .5")],
)  # fmt: skip
def test_off_vertices_may_have_what_the_header_says(kind, more, load):
    rows = "".join(f"{row}{more}\n" for row in ("0 0 0", "1 0 0", "0 1 0"))
    mesh = load("a.off", f"{kind}\n3 1 0\n{rows}3 0 1 2\n".encode())
    np.testing.assert_array_equal(mesh.vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0]])


# ---- marks and line ends


@pytest.mark.parametrize("name", [*TEXT, "little.ply"])
def test_a_byte_order_mark_is_no_word(name, load):
    mesh = load(name, b"\xef\xbb\xbf" + VALID[name])
    np.testing.assert_array_equal(triangles(mesh), POINTS[FACES])
    assert mesh.notes == ()


@pytest.mark.parametrize("name", TEXT)
def test_lines_end_as_on_any_system(name, load):
    for end in (b"\r", b"\r\n"):
        mesh = load(name, VALID[name].replace(b"\n", end))
        np.testing.assert_array_equal(mesh.faces, load(name, VALID[name]).faces)


def test_line_ends_may_be_mixed_and_are_counted(load):
    data = b"v 0 0 0\rv 1 0 0\r\nv 0 1 0\n\rf 1 2 3\rf 1 2 x\n"
    with pytest.raises(MeshError, match="line 6: expected whole numbers"):
        load("a.obj", data)
    assert load("a.obj", data.replace(b"x", b"3")).n_faces == 2


def test_continued_lines_are_joined_counted_and_end_in_comments(load):
    data = b"v 0 0 \\\n 0\nv 1 0 0 # not joined \\\nv 0 1\\\r\n0\nf 1 \\ \n2 \\\n\\\n3\nf 1 2 x\n"
    with pytest.raises(
        MeshError, match=r"line 10: expected whole numbers as vertex indices, got '1 2 x'"
    ):
        load("a.obj", data)
    mesh = load("a.obj", data.replace(b"x", b"3"))
    assert (mesh.n_vertices, mesh.n_faces) == (3, 2)


def test_a_long_line_counts_against_the_budget(load):
    data = VALID["a.obj"] + b"vt" + b" 1" * 100_000 + b"\n"
    assert load("a.obj", data).n_faces == 4
    with pytest.raises(ResourceError, match="expected at most 2621440 bytes, got 200003 charact"):
        load("a.obj", data, memory_budget=1_000_000)


def solid_text(name: str, height: float) -> bytes:
    """A solid of an ASCII STL: one triangle at that height."""
    corners = "".join(f"vertex {x} {y} {height}\n" for x, y in ((0, 0), (1, 0), (0, 1)))
    return f"solid {name}\nfacet\nouter loop\n{corners}endloop\nendfacet\nendsolid\n".encode()


def test_several_solids_of_an_ascii_stl_are_groups_and_a_lone_one_is_its_file(load):
    solids = [solid_text(*each) for each in (("lid", 0), ("", 1), ("lid", 2))]
    solids.insert(1, b"solid nothing\nendsolid nothing\n")
    mesh = load("part.stl", b"".join(solids).replace(b"outer", b"OUTER"))
    assert [group.name for group in mesh.groups] == ["lid", "part", "lid #2"]
    assert mesh.face_group.tolist() == [0, 1, 2]
    np.testing.assert_array_equal(triangles(mesh)[:, 0, 2], [0, 1, 2])
    assert [group.name for group in load("part.stl", solids[0]).groups] == ["part"]


def test_an_ascii_stl_that_ends_within_a_word_has_a_note(load):
    """It was read as one whole solid of two, without a word."""
    both = solid_text("one", 0) + solid_text("two", 1)
    first = both.index(b"endsolid")
    for end in range(first + 1, first + 8):
        try:
            mesh = load("part.stl", both[:end])
        except MeshError:
            continue
        assert mesh.notes, both[:end]


@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf", b"# made by hand\n"])
def test_an_off_without_its_first_line_is_read(mark, load):
    bare = VALID["a.off"].removeprefix(b"OFF # comment\n")
    np.testing.assert_array_equal(load("a.off", mark + bare).faces, FACES)


def test_strips_with_restarts_after_a_confidence_are_read(load):
    # As scanners of the nineties wrote them: one list for the whole mesh.
    head = (
        "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\n"
        "property float z\nproperty float confidence\nelement tristrips 1\n"
        "property list int int vertex_indices\nend_header\n"
    )
    rows = "0 0 0 1\n1 0 0 1\n0 1 0 1\n1 1 0 1\n0 2 0 1\n"
    mesh = load("a.ply", f"{head}{rows}8 0 1 2 3 -1 2 3 4\n".encode())
    assert mesh.faces.tolist() == [[0, 1, 2], [1, 3, 2], [2, 3, 4]]
    np.testing.assert_array_equal(mesh.normals, [[0, 0, 1]] * 3)


def test_lines_and_points_of_obj_are_noted(load):
    mesh = load("a.obj", TRIANGLE + b"f 1 2 3\nl 1 2 3\np 1\np 2 3\n")
    assert mesh.n_faces == 1
    wanted = ["ignored 1 polyline: no surface", "ignored 2 point elements: no surface"]
    assert [note.partition("a.obj: ")[2] for note in mesh.notes] == wanted


@pytest.mark.parametrize("order", ["", "<"])
def test_spaces_in_the_header_of_ply_are_passed_over(order, load):
    data = ply([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)], order)
    head, end, body = data.partition(b"end_header\n")
    spaced = head.replace(b"\nformat ", b"\n  format  ") + b"\t " + end.replace(b"\n", b" \n")
    assert spaced + body != data
    assert load("a.ply", spaced + body).areas.tolist() == [0.5]
