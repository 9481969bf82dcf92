"""3MF files: instances, transforms, units, and archives that are broken."""

import io
import zipfile
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mesh_files import FACES, POINTS, triangles

from rastercov.base.errors import MeshError, RastercovError

CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
KIND = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
RELATIONSHIPS = (
    '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    f'<Relationship Target="/3D/3dmodel.model" Id="rel0" Type="{KIND}"/></Relationships>'
)
VERTICES = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in POINTS)
TRIANGLES = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in FACES)
MESH = f"<mesh><vertices>{VERTICES}</vertices><triangles>{TRIANGLES}</triangles></mesh>"
PART = f'<object id="1" name="part">{MESH}</object>'
BUILD = '<item objectid="1"/>'


DECLARED = '<?xml version="1.0" encoding="utf-16"?><!DOCTYPE a [<!ENTITY b "c">]>'


def model(objects=PART, build=BUILD, attributes='unit="meter"') -> str:
    return (
        f'<?xml version="1.0"?><model xmlns="{CORE}" xmlns:p="{PRODUCTION}" {attributes}>'
        f"<resources>{objects}</resources><build>{build}</build></model>"
    )


def archive(text=None, **parts) -> bytes:
    content = {"_rels/.rels": RELATIONSHIPS, "3D/3dmodel.model": text or model(), **parts}
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as file:
        for name, part in content.items():
            file.writestr(name, part)
    return stream.getvalue()


def test_an_object_is_a_group(load):
    mesh = load("a.3mf", archive())
    np.testing.assert_array_equal(triangles(mesh), POINTS[FACES])
    assert [group.name for group in mesh.groups] == ["part"]
    assert mesh.warnings == ()


@pytest.mark.parametrize(
    ("attributes", "metres"),
    [("", 1e-3), ('unit="millimeter"', 1e-3), ('unit="inch"', 0.0254), ('unit="micron"', 1e-6)],
)
def test_the_unit_is_that_of_the_file(attributes, metres, load):
    mesh = load("a.3mf", archive(model(attributes=attributes)), unit="mm")
    np.testing.assert_allclose(mesh.bounds[1], metres)
    assert any("the unit given was not applied" in note for note in mesh.notes)


def test_every_instance_is_counted_and_placed(load):
    #  x' = 2 y + 10 and so on: rows of the stored matrix are images of the axes
    turned = "0 2 0  -2 0 0  0 0 2  10 0 0"
    pair = (
        '<object id="2"><components><component objectid="1"/>'
        f'<component objectid="1" transform="{turned}"/></components></object>'
    )
    build = '<item objectid="2"/><item objectid="1" transform="1 0 0 0 1 0 0 0 1 0 0 5"/>'
    mesh = load("a.3mf", archive(model(PART + pair, build)))
    assert [group.name for group in mesh.groups] == ["part", "part #2", "part #3"]
    x, y, z = POINTS.T
    corners = [POINTS, np.stack([10 - 2 * y, 2 * x, 2 * z], axis=1), POINTS + np.array([0, 0, 5])]
    np.testing.assert_array_equal(triangles(mesh), np.concatenate([c[FACES] for c in corners]))


def test_a_mirrored_instance_still_faces_outwards(load):
    build = '<item objectid="1" transform="-1 0 0 0 1 0 0 0 1 0 0 0"/>'
    assert load("a.3mf", archive(model(build=build))).is_closed_outward


def test_an_object_of_another_part_is_read(load):
    away = '<object id="2"><components><component p:path="/3D/b.model" objectid="1"/></components>'
    data = archive(
        model(f"{away}</object>", '<item objectid="2"/>', 'unit="meter" requiredextensions="p"'),
        **{"3D/b.model": model(build="")},
    )
    assert load("a.3mf", data).n_faces == 4


@pytest.mark.parametrize(
    ("objects", "build", "text"),
    [
        (PART.replace("</mesh>", "<beamlattice/></mesh>"), BUILD, "not read: beamlattice"),
        (PART.replace("</mesh>", "</mesh><booleanshape/>"), BUILD, "not read: booleanshape"),
        (PART.replace("<triangle v1", "<triangel v1", 1), BUILD, "not read: triangel"),
        (PART, f"{BUILD}item", "not read: text"),
        (PART + PART.replace('id="1"', 'id="2"'), BUILD, "1 objects are not in the build"),
    ],
)
def test_what_is_not_read_is_noted(objects, build, text, load):
    assert text in "\n".join(load("a.3mf", archive(model(objects, build))).notes)


LOOP = '<object id="1"><components><component objectid="1"/></components></object>'
DEEP = "".join(
    f'<object id="{i}"><components><component objectid="{i + 1}"/></components></object>'
    for i in range(1, 3000)
)


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"PK\3\4", "the ZIP archive cannot be read"),
        (archive("<model"), "its part '3D/3dmodel.model' is no XML"),
        (archive(model(build="")), "the file has no faces"),
        (archive(model(build='<item objectid="7"/>')), "object '7' is not there"),
        (archive(model(LOOP)), "object '1' is a part of itself"),
        (archive(model(DEEP)), "nested too deeply"),
        (archive(model(PART + PART)), "object '1' comes twice"),
        (archive(model(attributes='unit="furlong"')), "got 'furlong'"),
        (archive(model(attributes='requiredextensions="b"')), r"extensions \['b'\] are required"),
        (archive(model(PART.replace('v1="0"', 'v1="9"'))), "vertex indices must lie in 0 ... 3"),
        (archive(model(PART.replace('x="0.0"', 'x="one"'))), "contradicts its format"),
        (archive(model(PART.replace(' x="0.0"', ""))), "contradicts its format"),
        (archive(model(build='<item objectid="1" transform="1 2"/>')), "12 finite numbers wanted"),
        (archive('<!DOCTYPE a [<!ENTITY b "c">]>' + model()[21:]), "declares a document type"),
        (archive((DECLARED + model()[21:]).encode("utf-16")), "declares a document type"),
        (archive(model(PART.replace('x="1.0"', 'x="1_0"'))), "a number wanted, got '1_0'"),
        (archive(**{"_rels/.rels": "<Relationships/>"}), "names no 3D model"),
        (archive(**{"_rels/.rels": RELATIONSHIPS.replace("/3D/", "/4D/")}), "has no part"),
    ],
)
def test_a_broken_file_is_refused_in_one_line(data, text, load):
    with pytest.raises(MeshError, match=rf"^[^\n]*a\.3mf: [^\n]*{text}[^\n]*$"):
        load("a.3mf", data)


def test_only_the_two_compressions_of_the_format_are_read(load):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_BZIP2) as file:
        file.writestr("_rels/.rels", RELATIONSHIPS)
    with pytest.raises(MeshError, match="must be deflated or stored"):
        load("a.3mf", stream.getvalue())


@pytest.mark.slow
def test_a_bomb_is_not_unpacked(load):
    with pytest.raises(RastercovError, match="the budget is"):
        load("a.3mf", archive(" " * 40_000_000))


@pytest.mark.slow
@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_cut_and_damaged_files_load_whole_or_raise_mesh_error(data, load):
    content = bytearray(archive())
    if data.draw(st.booleans()):
        del content[data.draw(st.integers(0, len(content) - 1)) :]
    else:
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    with suppress(RastercovError):
        assert load("a.3mf", bytes(content)).n_faces == 4
