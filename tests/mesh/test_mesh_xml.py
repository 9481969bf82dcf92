"""COLLADA and 3MF files: instances, transforms, primitives, units, and files that are broken."""

import zipfile

import numpy as np
import pytest
from mesh_files import FACES, POINTS, triangles
from repeated_parts import (
    HERE,
    ITEM,
    MESH,
    RELATIONSHIPS,
    SECOND,
    TRIANGLES,
    archive,
    components,
    dae,
    model,
    object_of,
    primitive,
    shared,
    source,
    threemf,
    words,
)

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


def requiring(name, prefix="q"):
    """Attributes of a model that requires an extension."""
    space = f"http://schemas.microsoft.com/3dmanufacturing/{name}"
    return f'xmlns:{prefix}="{space}" requiredextensions="{prefix}"'


UNITS = [
    ("a.dae", dae(unit='<unit name="inch" meter="0.0254"/>'), 0.0254),
    ("a.dae", dae(unit='<unit meter="0.01"/>'), 0.01),
    ("a.3mf", threemf(own=""), 1e-3),
    ("a.3mf", threemf(own='unit="inch"'), 0.0254),
    ("a.3mf", threemf(own='unit="micron"'), 1e-6),
]


@pytest.mark.parametrize(("name", "data", "metres"), UNITS)
def test_the_unit_is_that_of_the_file_where_it_states_one(name, data, metres, load):
    for unit in ("m", "mm"):
        mesh = load(name, data, unit=unit)
        np.testing.assert_allclose(triangles(mesh), POINTS[FACES] * metres)
        is_noted = any("ignored unit:" in note for note in mesh.notes)
        assert is_noted == (unit == "mm")
    np.testing.assert_allclose(load("a.dae", dae(), unit="mm").bounds[1], 1e-3)


def test_nodes_are_placed_by_their_transforms_in_order(load):
    matrix = "<matrix>1 0 0 1  0 1 0 0  0 0 1 0  0 0 0 1</matrix>"
    nodes = (
        '<node name="outer"><translate>10 0 0</translate><rotate>0 0 1 90</rotate>'
        f'<scale>2 2 2</scale><node name="inner">{matrix}{HERE}</node>{HERE}</node>'
    )
    mesh = load("a.dae", dae(nodes))
    assert sorted(names(mesh)) == ["outer", "outer/inner"]
    x, y, z = POINTS.T
    for name, shift in (("outer/inner", 1), ("outer", 0)):
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
            [
                "read skinned or morphed 'arm' without weights",
                "ignored 1 animations",
                "2 geometries, which belong to no node",
            ],
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
    with pytest.raises(MeshError, match="expected the file without a document type, got one"):
        load("a.dae", f"{prologue}{ENTITY}<COLLADA>&b;</COLLADA>".encode())
    assert load("a.dae", b"<!-- <!DOCTYPE a> -->" + dae()).n_faces


def at(url):
    return dae(f'<node><instance_geometry url="{url}"/></node>')


def with_rows(kind, content, count):
    return dae(NODE, primitive(kind, content, count))


BROKEN = [
    *((data, "to be XML|triangles, got") for data in (b"", b"<COLLADA", b"\0\1\2", dae()[:-200])),
    (b'<?xml version="1.0" encoding="nonsense"?><COLLADA/>', "to be XML, got: unknown encod"),
    (b'<?xml version="1.0" encoding="punycode"?><COLLADA/>', "to be XML, got: encoding puny"),
    *((dae(more=more), "expected the file to be XML, got: a namespace o")
      for more in (f'<a xmlns:b="{"c" * 300}"/>', f"<a xmlns:b{' ' * 300}='c'/>")),
    (DECLARED.encode("utf-16"), "without a document type"),
    (dae(head=ENTITY), "without a document type"),
    (b"<svg/>", "an element COLLADA, got 'svg'"),
    (b"<COLLADA/>", "expected one scene, or the name of one, got 0"),
    (dae(""), "expected triangles, got no faces"),
    (shared(1, '<instance_node url="#n"/>'), "node 'n' not to contain itself, got a cycle"),
    (dae("<node>" * 3000 + HERE + "</node>" * 3000), "got too many levels"),
    (dae(NODE * 2, library=NODE).replace(b'"n"', b'"g"'), "the id '#g' once, got it twice"),
    (at("#no"), "geometry, got nothing"),
    (at("#s"), "geometry, got an element source"),
    *((at(url), "is never opened") for url in ("../b.dae#g", "file:///etc/passwd")),
    (dae(f"<node><skew>1 2 3 4 5 6 7</skew>{HERE}</node>"), "node 'g', got lookat or skew"),
    (dae(f"<node><scale>1 2</scale>{HERE}</node>"), "3 finite numbers"),
    (dae(f"<node><matrix>{'1 ' * 16}</matrix></node>"), "last row is 0 0 0 1"),
    (dae(before=source(accessor='source="#f" count="4" stride="2"')), "4 points of 2 numbers"),
    *((with_rows("triangles", f"<p>{row}</p>", n), text) for row, n, text in (
        ("0 1 2", 2, "2 triangles, .*, got 1"), ("0 1", 0, "0 triangles, .*, got 0"),
        ("0 -1 2", 1, "indices in 0 ... 3"), (f"{9**30} 1 2", 1, "a whole number of 64 bits"))),
    (with_rows("polygons", "<ph><p>0 1 2</p><h>0 1 2</h></ph>", 1), "without holes, got holes"),
    (with_rows("polygons", "<p>0 1</p>", 1), "3 corners or more, got 2"),
    (with_rows("polylist", "<vcount>-3</vcount><p/>", 1), "1 polylist, as declared, got 1"),
]  # fmt: skip


def test_deep_elements_are_passed_over_and_small_ones_count_against_the_budget(load):
    assert load("a.dae", dae(more="<a>" * 100_000 + "</a>" * 100_000)).n_faces == 4
    data = dae(more="<a b=''/>" * 10_000)
    for content, budget in ((data, 30 * len(data)), (dae(), 1000)):
        with pytest.raises(
            RastercovError,
            match=r"expected at most \d+ bytes .*, got \d+ bytes",
        ):
            load("a.dae", content, memory_budget=budget)


# ---- 3MF


def test_every_instance_of_an_object_is_counted_and_placed(load):
    #  x' = 2 y + 10 and so on: rows of the stored matrix are images of the axes
    turned = 'objectid="1" transform="0 2 0  -2 0 0  0 0 2  10 0 0"'
    pair = components(1).replace("</c", f"<component {turned}/></c")
    build = '<item objectid="2"/><item objectid="1" transform="1 0 0 0 1 0 0 0 1 0 0 5"/>'
    mesh = load("a.3mf", threemf(object_of(2, pair), build))
    assert [group.name for group in mesh.groups] == ["object 2/part", "object 2/part #2", "part"]
    x, y, z = POINTS.T
    corners = [POINTS, np.stack([10 - 2 * y, 2 * x, 2 * z], axis=1), POINTS + np.array([0, 0, 5])]
    np.testing.assert_array_equal(triangles(mesh), np.concatenate([c[FACES] for c in corners]))


def test_an_object_of_another_part_is_read(load):
    away = components(1).replace("<component o", '<component path="/3D/b.model" o')
    own = f'unit="meter" {requiring("production/2015/06", "p")}'
    data = {"3D/a.model": model(object_of(2, away), SECOND, own=own)}
    assert load("a.3mf", archive(**data, **{"3D/b.model": model(build="")})).n_faces == 4


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"inside": MESH.replace("<triangle v1", "<triangel v1", 1)}, "not read: triangel"),
        ({"build": f"{ITEM}item"}, "not read: text"),
        ({"objects": object_of(2, MESH)}, "ignored 1 objects"),
        (
            {"build": ITEM.replace("<item", '<item printable="0"')},
            "read 1 item of the build marked as",
        ),
        (
            {
                "inside": MESH + "</object><object id='2' type='support'>" + MESH,
                "build": ITEM + "<item objectid='2'/>",
            },
            "read 1 support object, as part of the mesh",
        ),
    ],
)
def test_elements_of_3mf_that_are_not_read_are_noted(changes, text, load):
    assert text in "\n".join(load("a.3mf", threemf(**changes)).notes)


SLICES = "<slicestack id='9'><slice ztop='1'><vertices/><polygon startv='0'/></slice></slicestack>"
AWAY = model(
    object_of(2, components(1).replace("<component o", '<component path="/3D/b.model" o')),
    SECOND,
)


def beside(text):
    """A file whose object is in another part."""
    return archive(**{"3D/a.model": AWAY, "3D/b.model": text})


def sliced(own="s:meshresolution='lowres'", mesh=MESH):
    """An object of slices, whose mesh is a box around them."""
    names = f"xmlns:s='s' xmlns:p='p' s:slicestackid='9' {own}"
    return SLICES + object_of(2, mesh).replace("<object", f"<object {names}")


@pytest.mark.parametrize(
    ("data", "n_faces"),
    [
        (threemf(sliced("s:meshresolution='fullres'"), SECOND), 4),
        (threemf(sliced(""), SECOND), 4),
        (threemf(sliced(), '<item objectid="1"/>'), 4),
        (threemf(own=requiring("slice/2015/07")), 4),
        (threemf(own=requiring("material/2015/02", "beam")), 4),
        (beside(model(own=requiring("trianglesets/2021/07"))), 4),
    ],
)  # fmt: skip
def test_objects_in_full_resolution_are_read_beside_their_slices(data, n_faces, load):
    assert load("a.3mf", data).n_faces == n_faces


DEEP = "".join(object_of(i, components(i + 1)) for i in range(2, 3000))
DOCTYPE = '<!DOCTYPE a [<!ENTITY b "c">]>'
DECLARED_XML = f'<?xml version="1.0" encoding="utf-16"?>{DOCTYPE}'
BROKEN_3MF = [
    (b"PK\3\4", "expected a readable ZIP archive, got: File is not a"),
    (archive(**{"3D/a.model": "<model"}), "part '3D/a.model' to be XML"),
    (threemf(build=""), "expected an object in the build, got none"),
    (threemf(inside=components(1)), "expected object '1' not to contain itself, got a cycle"),
    (threemf(DEEP, SECOND), "got too many levels"),
    (threemf(object_of(1, MESH)), "expected object '1' once, got it twice"),
    (threemf(own='unit="furlong"'), "got 'furlong'"),
    (threemf(own='requiredextensions="p"'), r"expected supported extensions, got \['p'\]"),
    (threemf(own=requiring("beamlattice/2017/02")), r"expected supported extensions, got \['http://schem"),
    (threemf(own=requiring("beamlattice/2017/02", "m")), r"expected supported extensions, got \['http://schem"),
    (threemf(own=requiring("volumetric/2022/01", "s")), r"expected supported extensions, got \['http://schem"),
    (beside(model(own=requiring("implicit/2024/01"))), r"expected supported extensions, got \['http://schem"),
    (threemf(sliced(), SECOND), "got a placeholder"),
    (threemf(sliced(mesh=""), SECOND), "got a placeholder"),
    (threemf(sliced("p:modelresolution='obfuscated'"), SECOND), "'obfuscated'"),
    (threemf(sliced() + object_of(3, components(2)), '<item objectid="3"/>'), "got a placeholder"),
    (beside(model(own='xmlns:s="s"').replace("<object", "<object s:meshresolution='lowres'")),
     "got a placeholder"),
    (threemf(inside=MESH.replace("</mesh>", "<b:beamlattice xmlns:b='b'/></mesh>")),
     "expected triangles, got a beamlattice"),
    (threemf(inside=MESH + "<d:displacementmesh xmlns:d='d'/>"), "got a displacementmesh"),
    (threemf(inside="<booleanshape objectid='1'/>"), "expected triangles, got a booleanshape"),
    (archive(**{"3D/a.model": DOCTYPE + model()}), "without a document type"),
    (archive(**{"3D/a.model": (DECLARED_XML + model()).encode("utf-16")}), "a document type"),
    (archive(**{"_rels/.rels": "<Relationships/>"}), "a 3D model in the archive, got none"),
    (archive(**{"_rels/.rels": RELATIONSHIPS.replace("/3D/", "/4D/")}), "4D/a.model"),
    (archive(zipfile.ZIP_BZIP2), r"expected '_rels/\.rels' to be deflated or stored, got another"),
]  # fmt: skip


def test_what_a_damaged_file_has_for_names_is_not_shown_at_length(load):
    data = bytearray(archive(zipfile.ZIP_STORED, **{"3D/a.model": " " * 9_000}))
    data[26:28] = (8_000).to_bytes(2, "little")  # length of the first name
    with pytest.raises(MeshError, match=r"expected .*, got: .*; export it again") as caught:
        load("a.3mf", bytes(data))
    assert len(str(caught.value)) < 400


@pytest.mark.slow
def test_a_bomb_is_not_unpacked(load):
    with pytest.raises(
        RastercovError,
        match=r"expected at most \d+ bytes .*, got \d+ bytes",
    ):
        load("a.3mf", archive(**{"3D/a.model": " " * 40_000_000}))


REFUSED = [("a.dae", *each) for each in BROKEN] + [("a.3mf", *each) for each in BROKEN_3MF]


@pytest.mark.parametrize(("name", "data", "text"), REFUSED, ids=range(len(REFUSED)))
def test_a_broken_file_is_refused_in_one_line(name, data, text, load):
    with pytest.raises(MeshError, match=rf"^[^\n]*{name}: [^\n]*({text})[^\n]*$"):
        load(name, data)
