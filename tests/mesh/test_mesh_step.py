"""STEP files: solids written by hand, their units, their CAD faces, and what cannot be read."""

import re
from contextlib import suppress

import numpy as np
import pytest
from bungalow import bungalow
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from nightly import examples
from step_crate import HEADER, SIDES, crate, rod

from rastercov.base.errors import MeshError, RastercovError
from rastercov.formats.meshes import polygons, step


@pytest.fixture
def _cascadio():
    # The other process imports it; here only its presence matters.
    pytest.importorskip("cascadio", reason="cascadio is not installed", exc_type=ImportError)


@pytest.mark.slow
@pytest.mark.usefixtures("_cascadio")
@pytest.mark.parametrize(
    ("name", "prefix", "metres"),
    [("a.step", "$", 1), ("a.STP", ".MILLI.", 1e-3)],
)
def test_a_solid_is_read_in_its_own_unit(name, prefix, metres, load):
    mesh = load(name, crate(np.array([1, 2, 3]) / metres, prefix), unit="mm")
    assert any("ignored unit:" in note for note in mesh.notes)
    np.testing.assert_allclose(mesh.bounds, [[0, 0, 0], [1, 2, 3]], atol=1e-6)
    assert mesh.n_faces == 12
    assert mesh.can_cull_back_faces  # closed, wound outwards
    assert "triangulated by Open CASCADE" in mesh.notes[0]
    assert len(mesh.warnings) == 2


@pytest.mark.slow
@pytest.mark.usefixtures("_cascadio")
def test_every_cad_face_is_a_group(load):
    mesh = load("a.step", crate())
    assert [group.name for group in mesh.groups] == [f"crate/face {i}" for i in range(1, 7)]
    for side, (_, normal, _) in enumerate(SIDES):
        np.testing.assert_allclose(mesh.normals[mesh.face_group == side], [normal] * 2, atol=1e-6)


NAMED = {
    **dict.fromkeys(("''", "$", "'12'", "'NAUO7'", "'=>[0:1:1:2]'", "'Occurrence_3'"), "hinge"),
    **{"'hinge:2'": "hinge:2", "'HINGE 7'": "HINGE 7", "'left'": "hinge (left)"},
    "' le\nft '": "hinge (left)",
}
"""Names of occurrences of a product "hinge" in a file, and those of its groups."""


@pytest.mark.parametrize("gap", ["", " ", "\n  ", "/* not * 'this' */"])
def test_occurrences_have_the_names_of_their_products(gap):
    data = crate(name="hinge", occurrences=NAMED).replace(b",", f"{gap},{gap}".encode())
    named = step.with_product_names(data).decode().replace(f"{gap},{gap}", ",")
    matches = re.findall(r"NEXT_ASSEMBLY_USAGE_OCCURRENCE\('1','(.*?)','',#\d+,#\d+,\$\);", named)
    assert matches == list(NAMED.values())
    rest = re.sub(r"('1',).*?(,'',)", r"\1\2", named)  # nothing else is changed
    assert rest == re.sub(
        r"('1',)[^#]*?(,'',)", r"\1\2", data.decode().replace(f"{gap},{gap}", ",")
    )


@pytest.mark.slow
@pytest.mark.usefixtures("_cascadio")
@pytest.mark.parametrize(
    "schema", ["CONFIG_CONTROL_DESIGN", "AUTOMOTIVE_DESIGN",
               "AP242_MANAGED_MODEL_BASED_3D_ENGINEERING_MIM_LF { 1 0 10303 442 3 1 4 }"]
)  # fmt: skip
def test_parts_of_an_assembly_are_named_and_numbered(schema, load):
    occurrences = ["''", "'NAUO2'", "'left'", "''"]
    data = crate(name="Überbau", occurrences=occurrences).decode()
    data = re.sub(r"FILE_SCHEMA\(\('[^']*'", f"FILE_SCHEMA(('{schema}'", data)
    mesh = load("a.step", data.encode("latin-1"))
    names = list(dict.fromkeys(group.name.split("/")[0] for group in mesh.groups))
    assert names == ["Überbau", "Überbau #2", "Überbau (left)", "Überbau #3"]
    for at, name in enumerate(names):
        rows = [row for row, g in enumerate(mesh.groups) if g.name.startswith(f"{name}/")]
        corners = mesh.vertices[mesh.faces[np.isin(mesh.face_group, rows)]]
        assert corners[..., 0].min() == pytest.approx(10 * (at + 1))


@pytest.mark.slow
@pytest.mark.usefixtures("_cascadio")
@pytest.mark.parametrize("data", [b"hello", b"ISO-10303-21;\n", crate()[:1500], HEADER.encode()])
def test_what_is_no_step_file_is_refused_in_one_line_and_no_other_is_printed(data, load, capfd):
    with pytest.raises(MeshError, match=r"^[^\n]*a\.step: [^\n]*$"):
        load("a.step", data)
    assert capfd.readouterr() == ("", "")


@pytest.mark.usefixtures("_cascadio")
@pytest.mark.slow
@settings(examples(3, at_night=20), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(cut=st.integers(1, len(crate()) - 1))
def test_cut_files_load_whole_or_raise_mesh_error(cut, load):
    with suppress(RastercovError):
        assert load("a.step", crate()[:cut]).n_faces == 12


def test_a_converter_that_is_missing_or_crashes_is_named(load, monkeypatch):
    monkeypatch.setattr(step, "find_spec", lambda name: None)
    with pytest.raises(MeshError, match="expected the package cascadio for STEP files, got none"):
        load("a.step", crate())
    monkeypatch.setattr(step, "find_spec", lambda name: True)
    monkeypatch.setattr(step, "CONVERT", "import os; os.kill(os.getpid(), 11)")
    with pytest.raises(MeshError, match="ended by signal 11"):
        load("a.step", crate())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a.step", "a.ifc"])
@pytest.mark.parametrize(
    ("limit", "value", "words"),
    [
        ("SECONDS", (0.05, 0.0), "in 0 s, got no end"),
        (
            "MEMORY",
            (150 << 20, 0),
            r", got: it (needs more than 0\.1 GiB of memory|was ended by signal \d+)",
        ),
    ],
)
def test_a_converter_ends_at_its_limits_in_one_line(name, limit, value, words, load, monkeypatch):
    for package in ("cascadio", "ifcopenshell"):
        pytest.importorskip(package)
    monkeypatch.setattr(polygons, limit, value)
    with pytest.raises(
        MeshError, match=rf"^[^\n]*expected an? \w+ file that [\w ]+ reads,? ?{words}; export"
    ):
        load(name, crate() if name == "a.step" else bungalow())


@pytest.mark.slow
@pytest.mark.usefixtures("_cascadio")
@pytest.mark.parametrize("encoding", ["utf-8", "cp1252"])
def test_names_of_products_are_read_in_either_encoding(encoding, load):
    mesh = load("a.step", crate(name="Überbau–1").decode().encode(encoding))
    assert mesh.groups[0].name == "Überbau–1/face 1"
    noted = any("as Windows-1252" in note for note in mesh.notes)
    assert noted == (encoding == "cp1252")


def number_of(data, kind, nth=0):
    """Number of the nth element of a type."""
    return re.findall(rf"#(\d+)={kind}\(".encode(), data)[nth].decode()


def with_lines(data, *lines):
    return data.replace(b"ENDSEC;\nEND-ISO", "\n".join([*lines, "ENDSEC;\nEND-ISO"]).encode())


def painted(data, *items):
    """The file with a colour of each of these elements, in a presentation."""
    lines, styles = [], []
    for row, item in enumerate(items):
        at = 5000 + 10 * row
        lines += [
            f"#{at}=COLOUR_RGB('',1.,{row / 9},0.);",
            f"#{at + 1}=FILL_AREA_STYLE_COLOUR('',#{at});",
            f"#{at + 2}=FILL_AREA_STYLE('',(#{at + 1}));",
            f"#{at + 3}=SURFACE_STYLE_FILL_AREA(#{at + 2});",
            f"#{at + 4}=SURFACE_SIDE_STYLE('',(#{at + 3}));",
            f"#{at + 5}=SURFACE_STYLE_USAGE(.BOTH.,#{at + 4});",
            f"#{at + 6}=PRESENTATION_STYLE_ASSIGNMENT((#{at + 5}));",
        ]
        kind = f"OVER_RIDING_STYLED_ITEM('',(#{at + 6}),#{item},#5007)"
        if not row:
            kind = f"STYLED_ITEM ('',(#{at + 6}),#{item})"
        lines.append(f"#{at + 7}={kind};")
        styles.append(f"#{at + 7}")
    context = re.search(rb",(#\d+)\)", re.search(rb"SHAPE_REPRESENTATION\('',.*", data)[0])[1]
    lines.append(
        f"#5999=MECHANICAL_DESIGN_GEOMETRIC_PRESENTATION_REPRESENTATION('',"
        f"({','.join(styles)}),{context.decode()});"
    )
    return with_lines(data, *lines)


PAINTED = {
    "a body and two faces": lambda d: painted(
        d, number_of(d, "FACETED_BREP"), number_of(d, "FACE_SURFACE", 1),
        number_of(d, "FACE_SURFACE", 4),
    ),
    "faces alone": lambda d: painted(d, *(number_of(d, "FACE_SURFACE", i) for i in (0, 3, 5))),
    "a shell and a layer of faces": lambda d: with_lines(
        painted(d, number_of(d, "CLOSED_SHELL"), number_of(d, "FACE_SURFACE")),
        f"#6000=PRESENTATION_LAYER_ASSIGNMENT('1','',(#{number_of(d, 'FACE_SURFACE', 2)}));",
        "#6001=INVISIBILITY((#6000));",
    ),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.usefixtures("_cascadio")
def test_colours_and_layers_leave_the_cad_faces_as_they_are(load):
    plain = crate(occurrences=["''", "'left'"])
    expected = load("b.step", plain)
    assert len(expected.groups) == 12
    for what, paint in PAINTED.items():
        mesh = load("a.step", paint(plain))
        names = [group.name for group in mesh.groups]
        assert names == [group.name for group in expected.groups], what
        np.testing.assert_array_equal(mesh.face_group, expected.face_group)
        np.testing.assert_array_equal(mesh.vertices, expected.vertices)
        assert not any("accessors" in note for note in mesh.notes)


def hidden(data, *items):
    return with_lines(data, f"#7000=INVISIBILITY(({','.join(items)}));")


def test_bodies_that_the_file_hides_are_named():
    data = crate(name="hinge")
    body = number_of(data, "FACETED_BREP")
    said = "read bodies that the file marks as invisible: 'hinge'"
    assert step._left_out_names(hidden(painted(data, body), "#5007")) == [said]
    for item in (body, number_of(data, "CLOSED_SHELL"), number_of(data, "FACE_SURFACE")):
        layer = f"#6000=PRESENTATION_LAYER_ASSIGNMENT('1','',(#{item}));"
        assert step._left_out_names(hidden(with_lines(data, layer), "#6000")) == [said]
    named = data.replace(b"FACETED_BREP(''", b"FACETED_BREP('pin'")
    assert step._left_out_names(hidden(painted(named, body), "#5007"))[0].endswith("'pin'")
    curve = hidden(painted(data, number_of(data, "CARTESIAN_POINT")), "#5007")
    assert step._left_out_names(curve) == []
    assert step._left_out_names(painted(data, body)) == []


def test_products_of_an_assembly_without_geometry_are_named_with_their_files():
    data = crate(name="hinge", occurrences=["''"])
    assert step._left_out_names(data) == []
    used = re.search(rb"NEXT_ASSEMBLY_USAGE_OCCURRENCE\('1','','',#(\d+),#(\d+)", data)
    whole, part = used[1].decode(), used[2].decode()
    context = number_of(data, "PRODUCT_CONTEXT")

    def further(row, name, kind="", more="", above=whole):
        return [
            f"#{row}=PRODUCT('{name}','{name}','',(#{context}));",
            f"#{row + 1}=PRODUCT_DEFINITION_FORMATION('','',#{row});",
            f"#{row + 2}=PRODUCT_DEFINITION{kind}('','',#{row + 1},#{context}{more});",
            f"#{row + 3}=NEXT_ASSEMBLY_USAGE_OCCURRENCE('2','','',#{above},#{row + 2},$);",
        ]

    file = ["#8100=DOCUMENT_TYPE('geometry');", "#8101=DOCUMENT_FILE('bolt.stp','','',#8100,'',$);"]
    with_file = further(8000, "bolt", "_WITH_ASSOCIATED_DOCUMENTS", ",(#8101)") + file
    said = "products without geometry in this file: "
    assert step._left_out_names(with_lines(data, *with_file)) == [f"{said}'bolt' (bolt.stp)"]
    assert step._left_out_names(with_lines(data, *further(8000, "bolt"))) == [f"{said}'bolt'"]
    nested = [*further(8000, "frame"), *further(8010, "nut", above="8002")]
    assert step._left_out_names(with_lines(data, *nested)) == [f"{said}'nut'"]
    holds = f"#8030=NEXT_ASSEMBLY_USAGE_OCCURRENCE('3','','',#8002,#{part},$);"
    assert step._left_out_names(with_lines(data, *further(8000, "frame"), holds)) == []
    axis = number_of(data, "AXIS2_PLACEMENT_3D")
    shape = [
        "#8040=PRODUCT_DEFINITION_SHAPE('','',#8002);",
        f"#8041=SHAPE_REPRESENTATION('',(#{axis}),#{context});",
        "#8042=SHAPE_DEFINITION_REPRESENTATION(#8040,#8041);",
    ]
    frame = with_lines(data, *further(8000, "bolt"), *shape)
    assert step._left_out_names(frame) == [f"{said}'bolt'"]
    own = number_of(data, "FACETED_BREP_SHAPE_REPRESENTATION")
    link = f"#8043=SHAPE_REPRESENTATION_RELATIONSHIP('','',#8041,#{own});"
    assert step._left_out_names(with_lines(frame, link)) == []


@pytest.mark.slow
@pytest.mark.usefixtures("_cascadio")
def test_a_loaded_file_has_hidden_bodies_and_notes_on_them_and_on_products_elsewhere(load):
    data = crate(name="hinge", occurrences=["''"])
    plain = load("a.step", data)
    body = number_of(data, "FACETED_BREP")
    whole = re.search(rb"NEXT_ASSEMBLY_USAGE_OCCURRENCE\('1','','',#(\d+)", data)[1].decode()
    context = number_of(data, "PRODUCT_CONTEXT")
    bolt = [
        f"#8000=PRODUCT('bolt','bolt','',(#{context}));",
        "#8001=PRODUCT_DEFINITION_FORMATION('','',#8000);",
        f"#8002=PRODUCT_DEFINITION('','',#8001,#{context});",
        f"#8003=NEXT_ASSEMBLY_USAGE_OCCURRENCE('2','','',#{whole},#8002,$);",
    ]
    mesh = load("b.step", with_lines(hidden(painted(data, body), "#5007"), *bolt))
    said = {"read bodies that the file marks as invisible: 'hinge'",
            "products without geometry in this file: 'bolt'"}  # fmt: skip
    assert said <= {note.partition("b.step: ")[2] or note for note in mesh.notes}
    assert not said & {note.partition("a.step: ")[2] or note for note in plain.notes}
    np.testing.assert_array_equal(mesh.vertices, plain.vertices)
    np.testing.assert_array_equal(mesh.faces, plain.faces)


@pytest.mark.slow
@pytest.mark.usefixtures("_cascadio")
def test_parts_that_have_no_name_in_the_file_have_that_of_their_product(load):
    data = crate(name="bracket")
    shape = number_of(data, "FACETED_BREP_SHAPE_REPRESENTATION")
    axis = number_of(data, "AXIS2_PLACEMENT_3D", 6)
    context = number_of(data, r"\(GEOMETRIC_REPRESENTATION_CONTEXT\(3\)\w*")
    lines = [f"#9000=REPRESENTATION_MAP(#{axis},#{shape});"]
    for row in (9010, 9020):
        lines += [
            f"#{row}=CARTESIAN_POINT('',(0.,0.,{row}.));",
            f"#{row + 1}=AXIS2_PLACEMENT_3D('',#{row},$,$);",
            f"#{row + 2}=MAPPED_ITEM('',#9000,#{row + 1});",
        ]
    lines.append(f"#9030=SHAPE_REPRESENTATION('',(#{axis},#9012,#9022),#{context});")
    old = re.search(rb"SHAPE_DEFINITION_REPRESENTATION\((#\d+),#\d+\)", data)
    new = b"SHAPE_DEFINITION_REPRESENTATION(" + old[1] + b",#9030)"
    mesh = load("a.step", with_lines(data.replace(old[0], new), *lines))
    names = list(dict.fromkeys(group.name.split("/")[0] for group in mesh.groups))
    assert names == ["bracket", "bracket #2"]
    assert len(mesh.groups) == 12


def said_error(mesh):
    """Deflection, distance and degrees of facets, and change of the area, from the note."""
    note = next(note for note in mesh.notes if "triangulated by" in note)
    result = re.search(
        r"within (\S+) mm \(facets are about (\S+) mm .*, (\S+) degrees .* by (\S+) %\)", note
    )
    return tuple(map(float, result.groups()))


@pytest.mark.slow
@pytest.mark.usefixtures("_cascadio")
@pytest.mark.parametrize(
    ("radius", "given", "used"), [(0.5, None, 0.0008), (5, 0.05, 0.05), (600, None, 0.1)]
)
def test_facets_are_as_fine_as_asked_or_as_the_part_needs_and_say_their_error(
    radius, given, used, load
):
    mesh = load("a.step", rod(radius, 4 * radius), deflection_mm=given)
    deflection, distance, degrees, percent = said_error(mesh)
    assert deflection == used
    corners = 1e3 * mesh.vertices[mesh.faces]
    middles = (corners + np.roll(corners, 1, axis=1)).reshape(-1, 3) / 2
    side = np.repeat(np.abs(mesh.normals[:, 2]) < 0.5, 3)
    sag = radius - np.hypot(*middles[side, :2].T).min()
    assert sag <= distance * 1.05 <= 1.6 * sag
    assert sag <= deflection * 1.05
    lost = 1 - mesh.areas.sum() / (2e-6 * np.pi * radius * 5 * radius)
    assert percent == pytest.approx(100 * lost, rel=0.05)
    step_deg = np.degrees(2 * np.arccos(1 - sag / radius))
    assert degrees == pytest.approx(step_deg, rel=0.06)


@pytest.mark.parametrize("value", [0, -1, np.nan, np.inf, "fine", 1e9])
def test_a_deflection_that_is_none_is_refused(value, load):
    with pytest.raises(MeshError, match="expected deflection_mm from 1e-6 to 1e6, got"):
        load("a.step", crate(), deflection_mm=value)


@pytest.mark.slow
@pytest.mark.usefixtures("_cascadio")
@pytest.mark.parametrize("offset", [400.0, 5000.0001, 500_000.2, 5_300_000.33])
def test_coordinates_that_are_rounded_are_refused_or_said(offset, load):
    """Cascadio writes float32: a wall of 0.2 m had no thickness on a map."""

    def moved(point):
        x, y, z = map(float, point[1].split(b","))
        return b"CARTESIAN_POINT('',(%r,%r,%r))" % (x + offset, y, z)

    at = 2 * offset  # of the corners, and of their frame
    data = re.sub(rb"CARTESIAN_POINT\('[^']*',\(([^)]*)\)\)", moved, crate())
    if offset < 1000:
        mesh = load("a.step", data)
        said = re.search(r"to within (\S+) mm", " ".join(mesh.notes))
        assert abs(mesh.bounds[0, 0] - at) <= 1e-3 * float(said[1])
        return
    with pytest.raises(MeshError, match=r"rounds by 0.1 mm at most, got \d[^ ]*, as") as refused:
        load("a.step", data)
    allowed = float(str(refused.value).split()[-1])
    mesh = load("b.step", data, deflection_mm=allowed)
    assert abs(mesh.bounds[0, 0] - at) <= 1e-3 * allowed
