"""COLLADA files: nodes, transforms, primitives, units, and files that are broken."""

import io
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mesh_files import FACES, POINTS, triangles

from rastercov.base.errors import MeshError, RastercovError

SCHEMA = "http://www.collada.org/2005/11/COLLADASchema"
METRE = '<unit name="meter" meter="1"/>'
INSTANCE = '<instance_geometry url="#part"/>'
NODE = f'<node id="n" name="node">{INSTANCE}</node>'


def words(values) -> str:
    return " ".join(str(value) for value in np.ravel(values).tolist())


def source(points=POINTS, count=None, accessor="") -> str:
    numbers = np.ravel(points)
    accessor = accessor or f'source="#a" count="{len(numbers) // 3}" stride="3"'
    return (
        f'<source id="s"><float_array id="a" count="{count or len(numbers)}">{words(numbers)}'
        f"</float_array><technique_common><accessor {accessor}>"
        '<param name="X" type="float"/><param name="Y" type="float"/>'
        '<param name="Z" type="float"/></accessor></technique_common></source>'
        '<vertices id="v"><input semantic="POSITION" source="#s"/></vertices>'
    )


def primitive(kind="triangles", content="", count=0, more="") -> str:
    inputs = f'<input semantic="VERTEX" source="#v" offset="0"/>{more}'
    return f'<{kind} count="{count}">{inputs}{content}</{kind}>'


TRIANGLES = primitive(content=f"<p>{words(FACES)}</p>", count=len(FACES))


def geometry(primitives=TRIANGLES, **changes) -> str:
    return f'<geometry id="part"><mesh>{source(**changes)}{primitives}</mesh></geometry>'


def dae(geometries=None, nodes=NODE, unit=METRE, more="", **changes) -> bytes:
    return (
        f'<?xml version="1.0"?><COLLADA xmlns="{SCHEMA}" version="1.4.1"><asset>{unit}</asset>'
        f"<library_geometries>{geometries or geometry(**changes)}</library_geometries>{more}"
        f'<library_visual_scenes><visual_scene id="scene">{nodes}</visual_scene>'
        '</library_visual_scenes><scene><instance_visual_scene url="#scene"/></scene></COLLADA>'
    ).encode()


def test_a_node_is_a_group(load):
    mesh = load("a.dae", dae())
    np.testing.assert_array_equal(triangles(mesh), POINTS[FACES])
    assert [group.name for group in mesh.groups] == ["node"]
    assert mesh.warnings == ()


@pytest.mark.parametrize("mark", ["utf-8-sig", "utf-16"])
def test_a_byte_order_mark_is_read(mark, load):
    text = dae().decode().removeprefix('<?xml version="1.0"?>')
    assert load("a.dae", text.encode(mark)).n_faces == 4


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "iso-8859-1", "windows-1252", "gbk"])
def test_a_declared_encoding_is_read(encoding, load):
    name = "中" if encoding == "gbk" else "Gehäuse"
    text = dae(nodes=NODE.replace('"node"', f'"{name}"')).decode()
    data = text.replace("?>", f' encoding="{encoding}"?>', 1).encode(encoding)
    assert [group.name for group in load("a.dae", data).groups] == [name]


@pytest.mark.parametrize(
    ("unit", "given_unit", "metres", "is_noted"),
    [
        ('<unit name="inch" meter="0.0254"/>', "mm", 0.0254, True),
        ('<unit meter="0.01"/>', "m", 0.01, False),
        ("", "mm", 1e-3, False),
        ("", "m", 1, False),
    ],
)
def test_the_unit_is_that_of_the_file_where_it_states_one(unit, given_unit, metres, is_noted, load):
    mesh = load("a.dae", dae(unit=unit), unit=given_unit)
    np.testing.assert_allclose(mesh.bounds[1], metres)
    assert any("the unit given was not applied" in note for note in mesh.notes) == is_noted


def test_nodes_are_placed_by_their_transforms_in_order(load):
    nodes = (
        '<node name="outer"><translate>10 0 0</translate><rotate>0 0 1 90</rotate>'
        f'<scale>2 2 2</scale><node name="inner"><matrix>1 0 0 1  0 1 0 0  0 0 1 0  0 0 0 1'
        f"</matrix>{INSTANCE}</node>{INSTANCE}</node>"
    )
    mesh = load("a.dae", dae(nodes=nodes))
    assert sorted(group.name for group in mesh.groups) == ["inner", "outer"]
    x, y, z = POINTS.T
    for name, shift in (("inner", 1), ("outer", 0)):
        (label,) = [i for i, group in enumerate(mesh.groups) if group.name == name]
        placed = np.stack([10 - 2 * y, 2 * (x + shift), 2 * z], axis=1)
        corners = triangles(mesh)[mesh.face_group == label]
        np.testing.assert_allclose(corners, placed[FACES], atol=1e-12)


def test_every_instance_of_a_node_is_a_group(load):
    library = f'<library_nodes><node id="shared" name="bolt">{INSTANCE}</node></library_nodes>'
    nodes = (
        '<node><instance_node url="#shared"/></node>'
        '<node><translate>0 0 5</translate><instance_node url="#shared"/></node>'
    )
    mesh = load("a.dae", dae(nodes=nodes, more=library))
    assert [group.name for group in mesh.groups] == ["bolt", "bolt #2"]
    np.testing.assert_array_equal(triangles(mesh)[4:], POINTS[FACES] + (0, 0, 5))


@pytest.mark.parametrize("kind", ["triangles", "polylist"])
def test_a_mirrored_node_still_faces_outwards(kind, load):
    #  3---2   a box, of quadrilaterals where the kind has them
    quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    corners = [[i & 1, i >> 1 & 1, i >> 2] for i in range(8)]
    content = f"<vcount>{words([4] * 6)}</vcount><p>{words(quads)}</p>"
    if kind == "triangles":
        content = f"<p>{words([[q[:3], [q[0], q[2], q[3]]] for q in quads])}</p>"
    shape = geometry(primitive(kind, content, 6 if kind == "polylist" else 12), points=corners)
    for scale in ("1 1 1", "-1 1 1"):
        mesh = load("a.dae", dae(shape, f"<node><scale>{scale}</scale>{INSTANCE}</node>"))
        assert mesh.n_faces == 12
        assert mesh.is_closed_outward
        assert len(np.unique(mesh.source_face)) == (6 if kind == "polylist" else 12)


@pytest.mark.parametrize(
    ("kind", "content", "count", "faces"),
    [
        ("polygons", "<p>0 1 3 2</p><p>0 2 1</p>", 2, [[0, 1, 3], [0, 3, 2], [0, 2, 1]]),
        ("polylist", "<vcount>4 3</vcount><p>0 1 3 2 0 2 1</p>", 2,
         [[0, 1, 3], [0, 3, 2], [0, 2, 1]]),
        ("trifans", "<p>0 1 3 2</p><p>0 2 1</p>", 2, [[0, 1, 3], [0, 3, 2], [0, 2, 1]]),
        ("tristrips", "<p>0 1 2 3</p>", 1, [[0, 1, 2], [1, 3, 2]]),
    ],
)  # fmt: skip
def test_every_kind_of_primitive_is_read(kind, content, count, faces, load):
    flat = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]
    mesh = load("a.dae", dae(geometry(primitive(kind, content, count), points=flat)))
    np.testing.assert_array_equal(mesh.faces, faces)


def test_indices_of_normals_are_passed_over(load):
    corners = np.stack([np.ravel(FACES), np.full(12, 7)], axis=1)
    normals = '<input semantic="NORMAL" source="#s" offset="1"/>'
    shape = geometry(primitive(content=f"<p>{words(corners)}</p>", count=4, more=normals))
    np.testing.assert_array_equal(load("a.dae", dae(shape)).faces, FACES)


def test_several_primitives_share_their_vertices(load):
    parts = [primitive(content=f"<p>{words(rows)}</p>", count=2) for rows in (FACES[:2], FACES[2:])]
    mesh = load("a.dae", dae(geometry("".join(parts))))
    assert (mesh.n_vertices, mesh.n_faces, len(mesh.groups)) == (4, 4, 1)


def test_what_is_left_out_is_noted(load):
    lines = primitive("lines", "<p>0 1</p>", 1)
    unused = '<geometry id="other"><mesh/></geometry><geometry id="third"><spline/></geometry>'
    skin = (
        '<library_controllers><controller id="c" name="arm"><skin source="#part">'
        "<bind_shape_matrix>2 0 0 0 0 2 0 0 0 0 2 0 0 0 0 1</bind_shape_matrix></skin>"
        "</controller></library_controllers><library_animations><animation/></library_animations>"
    )
    nodes = '<node><instance_controller url="#c"/></node>'
    mesh = load("a.dae", dae(geometry(TRIANGLES + lines) + unused, nodes, more=skin))
    np.testing.assert_array_equal(triangles(mesh), 2 * POINTS[FACES])
    notes = "\n".join(mesh.notes)
    for text in (
        "'arm' is skinned or morphed",
        "1 sets of lines",
        "1 animations were not played",
        "2 geometries belong to no node",
    ):
        assert text in notes


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (dae(geometry(TRIANGLES + "<bricks/>")), "not read: bricks of 'part'"),
        (dae(geometry(TRIANGLES).replace("</mesh>", "</mesh><brep/>")), "not read: brep of 'part'"),
        (dae(nodes=f"<node name='n'>{INSTANCE}<instance_door/></node>"), "instance_door of 'n'"),
        (dae(nodes=f"{NODE} node"), "not read: text of 'scene'"),
    ],
)
def test_unknown_elements_are_noted(data, text, load):
    mesh = load("a.dae", data)
    assert mesh.n_faces == 4
    assert text in "\n".join(mesh.notes)


ENTITY = '<!DOCTYPE COLLADA [<!ENTITY a "0 0 0"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
DECLARED = f'<?xml version="1.0" encoding="utf-16"?>{ENTITY}'
PROLOGUES = ("\ufeff", "<!-- a -- > <?b?> -->", "<?c <!-- ?>\n", '<?xml version="1.0"?> <!---->')
DEEP = "<node>" * 3000 + INSTANCE + "</node>" * 3000
LOOP = '<node id="n"><instance_node url="#n"/></node>'
HOLE = "<ph><p>0 1 2</p><h>0 1 2</h></ph>"
HERE = '<instance_geometry url="{}"/>'


@pytest.mark.parametrize("prologue", PROLOGUES)
def test_a_document_type_is_refused_whatever_precedes_it(prologue, load):
    with pytest.raises(MeshError, match=r"declares a document type|is no XML"):
        load("a.dae", f"{prologue}{ENTITY}<COLLADA>&b;</COLLADA>".encode())
    assert load("a.dae", b"<!-- <!DOCTYPE a> -->" + dae().split(b"?>", 1)[-1]).n_faces


@pytest.mark.slow
@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"", "the file is empty"),
        (b"<COLLADA", "the file is no XML"),
        (b"\0\1\2", "the file is no XML"),
        (b'<?xml version="1.0" encoding="nonsense"?><COLLADA/>', "the file is no XML"),
        (dae(more=f'<a xmlns:b="{"c" * 300}"/>'), "a namespace is longer than 255 characters"),
        (dae(more=f"<a xmlns:b{' ' * 300}='c'/>"), "a namespace is longer than 255 characters"),
        (b'<?xml version="1.0" encoding="punycode"?><COLLADA/>', "punycode is not read"),
        ((DECLARED + "<COLLADA/>").encode("utf-16"), "declares a document type"),
        (b"<svg/>", "an element COLLADA wanted, got 'svg'"),
        (b"<COLLADA/>", "one scene wanted, got 0"),
        (dae(nodes=""), "the file has no faces"),
        (dae()[:-200], "the file is no XML"),
        (dae().replace(b"<COLLADA", ENTITY.encode() + b"<COLLADA"), "declares a document type"),
        (dae(nodes=LOOP), "node 'n' is a part of itself"),
        (dae(nodes=DEEP), "nested too deeply"),
        (dae(geometry() * 2), "the id 'part' comes twice"),
        (dae(nodes=f"<node>{HERE.format('#no')}</node>"), "geometry wanted, got nothing"),
        (dae(nodes=f"<node>{HERE.format('#s')}</node>"), "geometry wanted, got an element source"),
        (dae(nodes=f"<node>{HERE.format('../b.dae#part')}</node>"), "is never opened"),
        (dae(nodes=f"<node>{HERE.format('file:///etc/passwd')}</node>"), "is never opened"),
        (dae(nodes=f"<node><skew>1 2 3 4 5 6 7</skew>{INSTANCE}</node>"), "by lookat or skew"),
        (dae(nodes=f"<node><scale>1 2</scale>{INSTANCE}</node>"), "3 finite numbers wanted"),
        (dae(nodes=f"<node><matrix>{'1 ' * 16}</matrix></node>"), "last row is 0 0 0 1 wanted"),
        (dae(unit='<unit meter="-1"/>'), "positive number of metres wanted, got '-1'"),
        (dae(unit='<unit meter="one"/>'), "contradicts its format"),
        (dae(count=13), "promises 13 numbers, 12 are there"),
        (dae(accessor='source="#a" count="5" stride="3"'), "5 points of 3 numbers"),
        (dae(accessor='source="#a" count="-1" stride="3"'), "-1 points of 3 numbers"),
        (dae(accessor='source="#a" count="4" stride="2"'), "4 points of 2 numbers"),
        (dae(geometry(primitive(content="<p>0 1 2</p>", count=2))), "promises 2 triangles, 1 with"),
        (dae(geometry(primitive(content="<p>0 1</p>", count=0))), "promises 0 triangles"),
        (dae(geometry(primitive(content="<p>0 1 9</p>", count=1))), "indices must lie in 0 ... 3"),
        (dae(geometry(primitive(content="<p>0 -1 2</p>", count=1))), "indices must lie in 0 ... 3"),
        (dae(geometry(primitive(content="<p>0 1_0 2</p>", count=1))), "got '1_0'"),
        (dae(geometry(primitive(content="<p>0 1.5 2</p>", count=1))), "contradicts its format"),
        (dae(geometry(primitive(content=f"<p>{9**30} 1 2</p>", count=1))), "contradicts its"),
        (dae(geometry(primitive("polygons", HOLE, 1))), "polygons with holes"),
        (dae(geometry(primitive("polygons", "<p>0 1</p>", 1))), "3 corners or more wanted, got 2"),
        (dae(geometry(primitive("polylist", "<vcount>-3</vcount><p/>", 1))), "promises 1 polylist"),
        (dae(points=[*POINTS[:3], [0, 0, np.nan]]), "coordinates must be finite"),
    ],
)  # fmt: skip
def test_a_broken_file_is_refused_in_one_line(data, text, load):
    with pytest.raises(MeshError, match=rf"^[^\n]*a\.dae: [^\n]*{text}[^\n]*$"):
        load("a.dae", data)


@pytest.mark.slow
def test_many_instances_are_refused_before_they_are_made(load):
    #  each node of a library holds the next one twice: 2^60 instances in a few kilobytes
    twice = '<instance_node url="#m{0}"/><instance_node url="#m{0}"/>'
    nodes = "".join(f'<node id="m{i}">{twice.format(i + 1)}</node>' for i in range(60))
    library = f'<library_nodes>{nodes}<node id="m60">{INSTANCE}</node></library_nodes>'
    shown = '<node><instance_node url="#m0"/></node>'
    with pytest.raises(RastercovError, match="the budget is"):
        load("a.dae", dae(nodes=shown, more=library), memory_budget=10_000_000)


def test_deep_elements_are_passed_over(load):
    assert load("a.dae", dae(more="<a>" * 100_000 + "</a>" * 100_000)).n_faces == 4


def test_many_small_elements_count_against_the_budget(load):
    data = dae(more="<a b=''/>" * 10_000)
    with pytest.raises(RastercovError, match="the budget is"):
        load("a.dae", data, memory_budget=30 * len(data))


def test_an_own_budget_bounds_the_text(load):
    with pytest.raises(RastercovError, match="the budget is"):
        load("a.dae", dae(), memory_budget=1000)


@pytest.mark.slow
@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_cut_and_damaged_files_load_whole_or_raise_mesh_error(data, load):
    content = bytearray(dae())
    if data.draw(st.booleans()):
        del content[data.draw(st.integers(0, len(content) - 1)) :]
    else:
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    with suppress(RastercovError):
        assert load("a.dae", bytes(content)).n_faces == 4


def test_the_reader_of_trimesh_finds_the_same_triangles(load):
    pytest.importorskip("collada", reason="pycollada is not installed", exc_type=ImportError)
    import trimesh

    quads = "<vcount>4 3</vcount><p>0 1 3 2 0 2 1</p>"
    shape = geometry(TRIANGLES + primitive("polylist", quads, 2))
    # Theirs keeps matrices in float32 and takes an axis as it is, so it gets one of length 1.
    moved = "<translate>1 2 3</translate><rotate>0.6 0 0.8 40</rotate><scale>1 2 3</scale>"
    data = dae(shape, f'<node>{moved}<node name="a">{INSTANCE}</node></node>{NODE}')
    theirs = trimesh.load(io.BytesIO(data), file_type="dae", process=False).to_mesh()
    ours = load("a.dae", data)
    assert ours.n_faces == len(theirs.faces)
    np.testing.assert_allclose(triangles(ours), theirs.vertices[theirs.faces], atol=1e-6)
