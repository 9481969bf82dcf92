"""COLLADA files: nodes, transforms, primitives, units, and files that are broken."""

import numpy as np
import pytest
from mesh_files import FACES, POINTS, triangles
from repeated_parts import HERE, TRIANGLES, dae, primitive, shared, source, words

from rastercov.base.errors import MeshError, RastercovError

NODE = f'<node id="n" name="node">{HERE}</node>'


def names(mesh):
    return [group.name for group in mesh.groups]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "iso-8859-1", "windows-1252", "gbk"])
def test_a_declared_encoding_or_a_mark_is_read_and_a_node_is_a_group(encoding, load):
    name = "中" if encoding == "gbk" else "Gehäuse"
    nodes = NODE.replace('"node"', f'"{name}"')
    head = f'<?xml version="1.0" encoding="{encoding}"?>'
    for start, code in ((head, encoding), ("", "utf-8-sig"), ("", "utf-16")):
        mesh = load("a.dae", dae(nodes, head=start).decode().encode(code))
        np.testing.assert_array_equal(triangles(mesh), POINTS[FACES])
        assert names(mesh) == [name]
        assert mesh.warnings == ()


@pytest.mark.parametrize(
    ("unit", "given_unit", "metres", "is_noted"),
    [
        ('<unit name="inch" meter="0.0254"/>', "mm", 0.0254, True),
        ('<unit meter="0.01"/>', "m", 0.01, False),
        ("", "mm", 1e-3, False),
    ],
)
def test_the_unit_is_that_of_the_file_where_it_states_one(unit, given_unit, metres, is_noted, load):
    mesh = load("a.dae", dae(unit=unit), unit=given_unit)
    np.testing.assert_allclose(mesh.bounds[1], metres)
    assert any("the unit given was not applied" in note for note in mesh.notes) == is_noted


def test_nodes_are_placed_by_their_transforms_in_order(load):
    matrix = "<matrix>1 0 0 1  0 1 0 0  0 0 1 0  0 0 0 1</matrix>"
    nodes = (
        '<node name="outer"><translate>10 0 0</translate><rotate>0 0 1 90</rotate>'
        f'<scale>2 2 2</scale><node name="inner">{matrix}{HERE}</node>{HERE}</node>'
    )
    mesh = load("a.dae", dae(nodes))
    assert sorted(names(mesh)) == ["inner", "outer"]
    x, y, z = POINTS.T
    for name, shift in (("inner", 1), ("outer", 0)):
        placed = np.stack([10 - 2 * y, 2 * (x + shift), 2 * z], axis=1)
        corners = triangles(mesh)[mesh.face_group == names(mesh).index(name)]
        np.testing.assert_allclose(corners, placed[FACES], atol=1e-12)


def test_every_instance_of_a_node_is_a_group(load):
    mesh = load("a.dae", shared(2, HERE))
    assert names(mesh) == ["n", "n #2"]
    np.testing.assert_array_equal(triangles(mesh), np.tile(POINTS[FACES], (2, 1, 1)))


@pytest.mark.parametrize("scale", ["1 1 1", "-1 1 1"])
def test_a_mirrored_node_still_faces_outwards(scale, load):
    quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    corners = [[i & 1, i >> 1 & 1, i >> 2] for i in range(8)]
    box = primitive("polylist", f"<vcount>{words([4] * 6)}</vcount><p>{words(quads)}</p>", 6)
    mesh = load("a.dae", dae(f"<node><scale>{scale}</scale>{HERE}</node>", box, source(corners)))
    assert mesh.n_faces == 12
    assert mesh.is_closed_outward
    assert len(np.unique(mesh.source_face)) == 6


POLYGONS = [[0, 1, 3], [0, 3, 2], [0, 2, 1]]


@pytest.mark.parametrize(
    ("kind", "content", "count", "faces"),
    [
        ("polygons", "<p>0 1 3 2</p><p>0 2 1</p>", 2, POLYGONS),
        ("polylist", "<vcount>4 3</vcount><p>0 1 3 2 0 2 1</p>", 2, POLYGONS),
        ("trifans", "<p>0 1 3 2</p><p>0 2 1</p>", 2, POLYGONS),
        ("tristrips", "<p>0 1 2 3</p>", 1, [[0, 1, 2], [1, 3, 2]]),
    ],
)
def test_every_kind_of_primitive_is_read(kind, content, count, faces, load):
    flat = source([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    mesh = load("a.dae", dae(NODE, primitive(kind, content, count), flat))
    np.testing.assert_array_equal(mesh.faces, faces)


def test_indices_of_normals_are_passed_over_and_primitives_share_vertices(load):
    normals = '<input semantic="NORMAL" source="#s" offset="1"/>'
    rows = [np.stack([np.ravel(part), np.full(6, 7)], axis=1) for part in (FACES[:2], FACES[2:])]
    parts = [primitive("triangles", f"<p>{words(row)}</p>", 2, normals) for row in rows]
    mesh = load("a.dae", dae(NODE, "".join(parts)))
    np.testing.assert_array_equal(mesh.faces, FACES)
    assert (mesh.n_vertices, len(mesh.groups)) == (4, 1)


SKIN = (
    '<library_controllers><controller id="c" name="arm"><skin source="#g">'
    "<bind_shape_matrix>2 0 0 0 0 2 0 0 0 0 2 0 0 0 0 1</bind_shape_matrix></skin>"
    "</controller></library_controllers><library_animations><animation/></library_animations>"
)
OTHERS = '<geometry id="other"><mesh/></geometry><geometry id="third"><spline/></geometry>'


@pytest.mark.parametrize(
    ("data", "texts"),
    [
        (dae(NODE, TRIANGLES + "<bricks/>"), ["not read: bricks of 'g'"]),
        (dae(f"<node name='n'>{HERE}<instance_door/></node>"), ["instance_door of 'n'"]),
        (dae(f"{NODE} node"), ["not read: text of 'a'"]),
        (dae(NODE, TRIANGLES + primitive("lines", "<p>0 1</p>", 1)), ["1 sets of lines"]),
        (
            dae('<node><instance_controller url="#c"/></node>', more=SKIN).replace(
                b"</library_g", OTHERS.encode() + b"</library_g"
            ),
            ["'arm' is skinned", "1 animations were not", "2 geometries belong to no node"],
        ),
    ],
)
def test_what_is_left_out_is_noted(data, texts, load):
    mesh = load("a.dae", data)
    np.testing.assert_array_equal(triangles(mesh), POINTS[FACES] * mesh.bounds[1, 0])
    assert all(text in "\n".join(mesh.notes) for text in texts)


ENTITY = '<!DOCTYPE COLLADA [<!ENTITY a "0 0 0"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
DECLARED = f'<?xml version="1.0" encoding="utf-16"?>{ENTITY}<COLLADA/>'
PROLOGUES = ("\ufeff", "<!-- a -- > <?b?> -->", "<?c <!-- ?>\n", '<?xml version="1.0"?> <!---->')


@pytest.mark.parametrize("prologue", PROLOGUES)
def test_a_document_type_is_refused_whatever_precedes_it(prologue, load):
    with pytest.raises(MeshError, match=r"declares a document type|is no XML"):
        load("a.dae", f"{prologue}{ENTITY}<COLLADA>&b;</COLLADA>".encode())
    assert load("a.dae", b"<!-- <!DOCTYPE a> -->" + dae()).n_faces


def at(url):
    return dae(f'<node><instance_geometry url="{url}"/></node>')


def with_rows(kind, content, count):
    return dae(NODE, primitive(kind, content, count))


BROKEN = [
    *((data, "is no XML|no triangles") for data in (b"", b"<COLLADA", b"\0\1\2", dae()[:-200])),
    (b'<?xml version="1.0" encoding="nonsense"?><COLLADA/>', "the file is no XML"),
    (b'<?xml version="1.0" encoding="punycode"?><COLLADA/>', "punycode is not read"),
    *((dae(more=more), "a namespace is longer than 255 characters")
      for more in (f'<a xmlns:b="{"c" * 300}"/>', f"<a xmlns:b{' ' * 300}='c'/>")),
    (DECLARED.encode("utf-16"), "declares a document type"),
    (dae(head=ENTITY), "declares a document type"),
    (b"<svg/>", "an element COLLADA wanted, got 'svg'"),
    (b"<COLLADA/>", "one scene wanted, got 0"),
    (dae(""), "the file has no faces"),
    (shared(1, '<instance_node url="#n"/>'), "node 'n' is a part of itself"),
    (dae("<node>" * 3000 + HERE + "</node>" * 3000), "nested too deeply"),
    (dae(NODE * 2, library=NODE).replace(b'"n"', b'"g"'), "comes twice"),
    (at("#no"), "geometry wanted, got nothing"),
    (at("#s"), "geometry wanted, got an element source"),
    *((at(url), "is never opened") for url in ("../b.dae#g", "file:///etc/passwd")),
    (dae(f"<node><skew>1 2 3 4 5 6 7</skew>{HERE}</node>"), "by lookat or skew"),
    (dae(f"<node><scale>1 2</scale>{HERE}</node>"), "3 finite numbers wanted"),
    (dae(f"<node><matrix>{'1 ' * 16}</matrix></node>"), "last row is 0 0 0 1 wanted"),
    (dae(before=source(accessor='source="#f" count="4" stride="2"')), "4 points of 2 numbers"),
    *((with_rows("triangles", f"<p>{row}</p>", n), text) for row, n, text in (
        ("0 1 2", 2, "promises 2 triangles, 1 with"), ("0 1", 0, "promises 0 triangles"),
        ("0 -1 2", 1, "indices must lie in 0 ... 3"), (f"{9**30} 1 2", 1, "contra"))),
    (with_rows("polygons", "<ph><p>0 1 2</p><h>0 1 2</h></ph>", 1), "polygons with holes"),
    (with_rows("polygons", "<p>0 1</p>", 1), "3 corners or more wanted, got 2"),
    (with_rows("polylist", "<vcount>-3</vcount><p/>", 1), "promises 1 polylist"),
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("data", "text"), BROKEN, ids=range(len(BROKEN)))
def test_a_broken_file_is_refused_in_one_line(data, text, load):
    with pytest.raises(MeshError, match=rf"^[^\n]*a\.dae: [^\n]*({text})[^\n]*$"):
        load("a.dae", data)


def test_deep_elements_are_passed_over_and_small_ones_count_against_the_budget(load):
    assert load("a.dae", dae(more="<a>" * 100_000 + "</a>" * 100_000)).n_faces == 4
    data = dae(more="<a b=''/>" * 10_000)
    for content, budget in ((data, 30 * len(data)), (dae(), 1000)):
        with pytest.raises(RastercovError, match="the budget is"):
            load("a.dae", content, memory_budget=budget)
