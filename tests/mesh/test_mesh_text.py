"""Meshes in text: cut files, words too many, numbers that are none, marks and line ends."""

import re

import numpy as np
import pytest
from test_mesh_file import FACES, POINTS, VALID, ascii_stl, obj, off, ply

from rastercov.errors import MeshError, ResourceError
from rastercov.mesh import Mesh

TRIANGLE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"
CUT = "the file ends inside a line"


@pytest.fixture
def load(tmp_path):
    def write_and_load(name: str, data: bytes, **options):
        path = tmp_path / name
        path.write_bytes(data)
        return Mesh.load(path, **options)

    return write_and_load


def long_obj() -> bytes:
    """An OBJ whose last corner, 12, has two digits."""
    return obj(np.tile(POINTS, (3, 1)), FACES + 8).replace(b"//1", b"")


def long_off() -> bytes:
    return off(np.tile(POINTS, (3, 1)), [[0, 1, 2], [9, 10, 11]]).replace(b" 255 0 0", b"")


def long_ply() -> bytes:
    data = ply(np.tile(POINTS, (3, 1)), [[0, 1, 2], [9, 10, 11]])
    return data.replace(b"element extra 1\nproperty int a\n", b"").removesuffix(b"9\n")


# ---- files that were cut


@pytest.mark.parametrize(
    ("name", "data"),
    [("a.obj", long_obj()), ("a.off", long_off() + b"\n"), ("a.ply", long_ply())],
)
def test_text_cut_inside_its_last_number_is_noted(name, data, load):
    assert data.endswith((b"1\n", b"2\n"))
    assert load(name, data).notes == ()
    whole = load(name, data)
    cut = load(name, data[:-2])
    assert (cut.faces != whole.faces).any(), "the cut is one that does harm"
    assert CUT in cut.notes[0]
    assert CUT in load(name, data[:-1]).notes[0], "nobody can know that this one is whole"


@pytest.mark.parametrize("name", ["ascii.stl", "a.obj", "a.off", "ascii.ply"])
def test_no_cut_loses_a_face_without_a_note(name, load):
    """At every byte; a cut after a whole line of an OBJ leaves a whole OBJ."""
    data = VALID[name] if name != "a.obj" else long_obj()
    n_faces = load(name, data).n_faces
    n_loaded = 0
    for size in range(len(data)):
        if name == "a.obj" and data[:size].endswith(b"\n"):
            continue
        try:
            mesh = load(name, data[:size])
        except MeshError:
            continue
        n_loaded += 1
        assert mesh.n_faces == n_faces or mesh.notes, data[:size][-30:]
    assert n_loaded


def test_obj_cut_between_the_corners_of_a_quad_is_noted(load):
    data = TRIANGLE + b"v 1 1 0\nf 1 2 4 3\n"
    for cut in (b"f 1 2 4 3", b"f 1 2 4 ", b"f 1 2 4"):
        assert CUT in load("a.obj", data.partition(b"f")[0] + cut).notes[0]


def test_stl_cut_inside_the_name_of_a_solid_is_noted(load):
    data = ascii_stl(POINTS[FACES])
    assert CUT in load("a.stl", data[:-3]).notes[0]
    assert load("a.stl", data[:-1]).notes == (), "the name is whole, so the line is"
    assert load("a.stl", data.removesuffix(b" a name\n")).notes == (), "as SolidWorks ends it"
    assert load("a.stl", data).notes == ()


def test_a_colour_that_is_cut_needs_no_note(load):
    data = VALID["a.off"]
    assert not data.endswith(b"\n")
    assert load("a.off", data).notes == ()


@pytest.mark.parametrize("end", [b"\\", b"\\\n", b"\\  \n", b"\\\r\n"])
def test_obj_that_ends_in_a_continued_line_is_noted(end, load):
    mesh = load("a.obj", TRIANGLE + b"f 1 2 3 " + end)
    assert mesh.n_faces == 1
    assert CUT in mesh.notes[0]
    assert load("a.obj", TRIANGLE + b"f 1 2 3 " + end.rstrip() + b"\n\n").notes == ()


def test_obj_cut_inside_a_comment_is_noted(load):
    for line in (b"f 1 2 3\n", b"f 1 2 \\\n3\n"):
        assert CUT in load("a.obj", TRIANGLE + line + b"# the oth").notes[0]


@pytest.mark.parametrize("name", ["a.off", "a.ply"])
@pytest.mark.parametrize("what", ["vertex", "face"])
def test_a_header_that_promises_less_than_there_is_never_passes_silently(name, what, load):
    data = long_off() + b"\n" if name == "a.off" else long_ply()
    old, new = {
        ("a.off", "vertex"): (b"12 2 0", b"11 2 0"),
        ("a.off", "face"): (b"12 2 0", b"12 1 0"),
        ("a.ply", "vertex"): (b"vertex 12", b"vertex 11"),
        ("a.ply", "face"): (b"face 2", b"face 1"),
    }[name, what]
    assert old in data
    try:
        mesh = load(name, data.replace(old, new))
    except MeshError:
        return
    assert "were not read" in mesh.notes[0]


# ---- words too many, numbers that are none


@pytest.mark.parametrize(
    ("name", "old", "new", "line"),
    [
        ("a.obj", b"v 1.0 0.0 0.0", b"v 1.0 0.0 0.0 1 1", 5),
        ("a.obj", b"v 1.0 0.0 0.0", b"v 1.0 0.0 0.0 1 1 1 1 1", 5),
        ("a.obj", b"v 1.0 0.0 0.0", b"v 1.0 0.0 0.0 red", 5),
        ("a.obj", b"v 1.0 0.0 0.0", b"v 1.0 0.0 0.0 v 0 1 0", 5),
        ("a.off", b"1.0 0.0 0.0", b"1.0 0.0 0.0 5", 4),
        ("a.off", b"1.0 0.0 0.0", b"1.0 0.0 0.0 5 5", 4),
        ("a.off", b"1.0 0.0 0.0", b"1.0 0.0 0.0 r g b", 4),
        ("a.off", b"3 0 1 3 255 0 0", b"3 0 1 3 255 0", 8),
        ("a.off", b"3 0 1 3 255 0 0", b"3 0 1 3 255 0 0 1 1", 8),
        ("a.off", b"3 0 1 3 255 0 0", b"3 0 1 3 red 0 0", 8),
        ("a.off", b"4 4 0", b"4 4 0 0", 2),
        ("ascii.ply", b"1.0 0.0 0.0 7", b"1.0 0.0 0.0 7 7", 16),
        ("ascii.ply", b"5 3 0 1 3", b"5 3 0 1 3 2", 20),
        ("ascii.stl", b"vertex 0.0 1.0 0.0", b"vertex 0.0 1.0 0.0 0.0", 5),
        ("ascii.stl", b"vertex 0.0 1.0 0.0", b"vertex 0.0 1.0 0.0 1 1", 5),
        ("ascii.stl", b"endfacet", b"endfacet facet", 8),
        ("ascii.stl", b"endloop", b"endloop endfacet", 7),
        ("ascii.stl", b"outer loop", b"outer loop vertex", 3),
    ],
)
def test_words_too_many_are_refused_with_their_line(name, old, new, line, load):
    assert old in VALID[name]
    with pytest.raises(MeshError, match=rf"line {line}: "):
        load(name, VALID[name].replace(old, new, 1))


NO_NUMBERS = ["1_0", "0x1", "1d5", "1,5", "1.0.0", "--1", "1e", "e5", "½", "١", "1f", "+", "1 _"]


@pytest.mark.parametrize("word", NO_NUMBERS)
@pytest.mark.parametrize(
    ("name", "old", "line"),
    [("a.obj", b"v 1.0 ", 5), ("a.off", b"\n1.0 ", 4), ("ascii.ply", b"\n1.0 ", 16),
     ("ascii.stl", b"vertex 1.0 ", 6)],
)  # fmt: skip
def test_what_is_no_number_is_no_coordinate(name, old, line, word, load):
    assert old in VALID[name]
    new = old.replace(b"1.0", word.encode())
    with pytest.raises(MeshError, match=rf"line {line}: "):
        load(name, VALID[name].replace(old, new, 1))


@pytest.mark.parametrize("word", [*NO_NUMBERS, "1.0", "1e0", "nan", "inf", "0b1"])
@pytest.mark.parametrize(
    ("name", "old"), [("a.obj", b"f 1//1"), ("a.off", b"3 0 "), ("ascii.ply", b"5 3 0 ")]
)
def test_what_is_no_whole_number_is_no_index(name, old, word, load):
    assert old in VALID[name]
    new = re.sub(rb"[01](//1)?( ?)$", word.encode() + rb"\2", old)
    with pytest.raises(MeshError, match=r"line \d+: "):
        load(name, VALID[name].replace(old, new, 1))


@pytest.mark.parametrize("word", ["1_0", "1_", "_1"])
@pytest.mark.parametrize(
    ("name", "old", "new"),
    [("a.off", b"4 4 0", b"4 % 0"), ("a.off", b"\n3 0", b"\n% 0"), ("ascii.ply", b"5 3", b"5 %"),
     ("ascii.ply", b"face 4", b"face %")],
)  # fmt: skip
def test_counts_have_no_underscores(name, old, new, word, load):
    assert old in VALID[name]
    with pytest.raises(MeshError):
        load(name, VALID[name].replace(old, new.replace(b"%", word.encode()), 1))


@pytest.mark.parametrize("word", ["+1", "01", "1.", "1E0", "10e-1", ".1e1", "+1.0e+00", "1e+000"])
def test_every_way_to_write_a_number_is_one(word, load):
    for name in ("a.obj", "a.off", "ascii.ply", "ascii.stl"):
        data = re.sub(rb"(?<!ascii )1\.0", word.encode(), VALID[name])
        np.testing.assert_array_equal(load(name, data).vertices, load(name, VALID[name]).vertices)


def test_underscores_in_names_and_comments_are_no_numbers(load):
    data = b"# my_mesh\no left_part\nusemtl a_b\n" + TRIANGLE + b"f 1 2 3\n"
    assert load("a.obj", data).groups[0].name == "left_part"


@pytest.mark.parametrize(
    "corner", ["1/x/y", "1/x", "1//x", "1/1/1/1", "1/2.5", "/1", "//1", "1/1_0", "1/-", "1/+/1"]
)
def test_corners_of_an_obj_are_numbers_throughout(corner, load):
    with pytest.raises(MeshError, match="line 4: corners of whole numbers, as 1, 1/2, 1//3"):
        load("a.obj", TRIANGLE + f"f {corner} 2 3\n".encode())


@pytest.mark.parametrize("corner", ["1", "1/7", "1//7", "1/7/7", "-3/-1", "1//", "1/", "+1/2"])
def test_corners_of_an_obj_may_have_texture_and_normals(corner, load):
    mesh = load("a.obj", TRIANGLE + f"f {corner} 2 3\n".encode())
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2]])


@pytest.mark.parametrize("more", ["", " 1", " .1 .2 .3", " 1 .1 .2 .3"])
def test_obj_vertices_may_have_a_weight_and_a_colour(more, load):
    mesh = load("a.obj", TRIANGLE.replace(b"\n", f"{more}\n".encode()) + b"f 1 2 3\n")
    np.testing.assert_array_equal(mesh.vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0]])


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


@pytest.mark.parametrize("data", [b"OFF\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", b"OFF\n3 0 1 2\n"])
def test_off_without_counts_is_refused(data, load):
    with pytest.raises(MeshError, match=r"no triangles|line 2: the counts|no faces"):
        load("a.off", data)


# ---- marks and line ends


@pytest.mark.parametrize("name", ["ascii.stl", "a.obj", "a.off", "ascii.ply", "little.ply"])
def test_a_byte_order_mark_is_no_word(name, load):
    mesh = load(name, b"\xef\xbb\xbf" + VALID[name])
    np.testing.assert_array_equal(mesh.vertices[mesh.faces], POINTS[FACES])
    assert mesh.notes == ()


@pytest.mark.parametrize("start", [b"v 0 0 0\n", b"# comment\nv 0 0 0\n", b"\nv 0 0 0\n"])
def test_a_byte_order_mark_before_any_first_line_of_an_obj(start, load):
    data = b"\xef\xbb\xbf" + start + b"v 1 0 0\nv 0 1 0\nf 1 2 3\n"
    assert load("a.obj", data).n_faces == 1


@pytest.mark.parametrize("end", [b"\r", b"\r\n", b"\n"])
@pytest.mark.parametrize("name", ["ascii.stl", "a.obj", "a.off", "ascii.ply"])
def test_lines_end_as_on_any_system(name, end, load):
    data = VALID[name].replace(b"\n", end)
    np.testing.assert_array_equal(load(name, data).faces, load(name, VALID[name]).faces)


def test_line_ends_may_be_mixed_and_are_counted(load):
    data = b"v 0 0 0\rv 1 0 0\r\nv 0 1 0\n\rf 1 2 3\rf 1 2 x\n"
    with pytest.raises(MeshError, match="line 6: whole numbers"):
        load("a.obj", data)
    assert load("a.obj", data.replace(b"x", b"3")).n_faces == 2


def test_continued_lines_are_joined_counted_and_end_in_comments(load):
    data = b"v 0 0 \\\n 0\nv 1 0 0 # not joined \\\nv 0 1\\\r\n0\nf 1 \\ \n2 \\\n\\\n3\nf 1 2 x\n"
    with pytest.raises(
        MeshError, match=r"line 10: whole numbers as vertex indices wanted, got '1 2 x'"
    ):
        load("a.obj", data)
    mesh = load("a.obj", data.replace(b"x", b"3"))
    assert (mesh.n_vertices, mesh.n_faces) == (3, 2)


def test_ascii_stl_without_its_end_is_refused(load):
    with pytest.raises(MeshError, match="'endsolid' wanted after line 29, the file ends"):
        load("a.stl", VALID["ascii.stl"].replace(b"endsolid a name\n", b""))


# ---- strips of a PLY


def strips(order: str, lists: list[list[int]], index: str = "int") -> bytes:
    data = ply(POINTS, lists, order, index)
    return data.replace(b"element face", b"element tristrips")


@pytest.mark.parametrize("order", ["", "<", ">"])
def test_ply_strips_are_unrolled_with_their_winding(order, load):
    lists = [[0, 1, 2, 3, 0, -1, 3, 2, 1, -1], [1, 2, 3]]
    mesh = load("a.ply", strips(order, lists))
    np.testing.assert_array_equal(
        mesh.faces, [[0, 1, 2], [1, 3, 2], [2, 3, 0], [3, 2, 1], [1, 2, 3]]
    )
    np.testing.assert_array_equal(mesh.source_face, np.arange(5))
    assert not mesh.notes


@pytest.mark.parametrize("order", ["", "<"])
@pytest.mark.parametrize("short", [[0, 1], [0, 1, 2, -1, 3], [0, 1, -1, 1, 2, 3]])
def test_ply_strips_of_less_than_a_triangle_are_refused(order, short, load):
    with pytest.raises(MeshError, match="a strip of 3 or more vertices wanted"):
        load("a.ply", strips(order, [[0, 1, 2], short]))


def test_ply_strip_indices_are_checked(load):
    with pytest.raises(MeshError, match=r"vertex indices must lie in 0 ... 3"):
        load("a.ply", strips("", [[0, 1, 2, 4]]))


# ---- memory


@pytest.mark.parametrize(
    "name", ["ascii.stl", "a.obj", "a.off", "ascii.ply", "little.ply", "a.glb"]
)
def test_vertices_count_against_the_budget(name, load):
    """Vertices that no face uses; in an STL there are none, so faces count there."""
    points = np.vstack([POINTS, np.random.default_rng(0).normal(size=(20_000, 3))])
    faces = FACES if name != "ascii.stl" else np.random.default_rng(0).integers(0, 9, (9_000, 3))
    from test_mesh_file import glb, glb_header

    data = {
        "ascii.stl": lambda: ascii_stl(points[faces]),
        "a.obj": lambda: obj(points, faces),
        "a.off": lambda: off(points, faces),
        "ascii.ply": lambda: ply(points, faces),
        "little.ply": lambda: ply(points, faces, "<"),
        "a.glb": lambda: glb(*glb_header(points, faces)),
    }[name]()
    assert load(name, data, memory_budget=4_000_000).n_faces == len(faces)
    with pytest.raises(ResourceError, match=r"triangles.* need about"):
        load(name, data, memory_budget=2_000_000)


@pytest.mark.parametrize("order", ["", "<", ">"])
@pytest.mark.parametrize("more", [[], [[0, 1, 2]]])
def test_list_rows_count_against_the_budget(order, more, load):
    """The header of these has 200 faces, their lists 47,600 triangles."""
    data = ply(POINTS, [[0, 1, 2] * 80] * 200 + more, order)
    assert load("a.ply", data).n_faces == 47_600 + len(more)
    with pytest.raises(ResourceError, match=r"triangles.* need about"):
        load("a.ply", data, memory_budget=47_600 * 300 - 1)
    if order:
        body = data.replace(b"element face", b"element tristrips")
        with pytest.raises(ResourceError, match=r"triangles.* need about"):
            load("a.ply", body, memory_budget=47_600 * 300 - 1)


def test_a_long_line_counts_against_the_budget(load):
    data = VALID["a.obj"] + b"vt" + b" 1" * 100_000 + b"\n"
    assert load("a.obj", data).n_faces == 4
    with pytest.raises(ResourceError, match=r"line 13: 200003 characters need about \d+ bytes"):
        load("a.obj", data, memory_budget=1_000_000)
