"""3MF files: instances, transforms, units, and archives that are broken."""

import zipfile

import numpy as np
import pytest
from mesh_files import FACES, POINTS, triangles
from repeated_parts import (
    ITEM,
    MESH,
    RELATIONSHIPS,
    archive,
    components,
    model,
    object_of,
    threemf,
)

from rastercov.base.errors import MeshError, RastercovError


@pytest.mark.parametrize(
    ("own", "metres"),
    [("", 1e-3), ('unit="meter"', 1), ('unit="inch"', 0.0254), ('unit="micron"', 1e-6)],
)
def test_an_object_is_a_group_in_the_unit_of_the_file(own, metres, load):
    mesh = load("a.3mf", threemf(own=own), unit="mm")
    np.testing.assert_allclose(triangles(mesh), POINTS[FACES] * metres)
    assert [group.name for group in mesh.groups] == ["part"]
    assert any("the unit given was not applied" in note for note in mesh.notes)
    assert load("a.3mf", threemf()).warnings == ()


def test_every_instance_is_counted_and_placed(load):
    #  x' = 2 y + 10 and so on: rows of the stored matrix are images of the axes
    turned = 'objectid="1" transform="0 2 0  -2 0 0  0 0 2  10 0 0"'
    pair = components(1).replace("</c", f"<component {turned}/></c")
    build = '<item objectid="2"/><item objectid="1" transform="1 0 0 0 1 0 0 0 1 0 0 5"/>'
    mesh = load("a.3mf", threemf(object_of(2, pair), build))
    assert [group.name for group in mesh.groups] == ["part", "part #2", "part #3"]
    x, y, z = POINTS.T
    corners = [POINTS, np.stack([10 - 2 * y, 2 * x, 2 * z], axis=1), POINTS + np.array([0, 0, 5])]
    np.testing.assert_array_equal(triangles(mesh), np.concatenate([c[FACES] for c in corners]))


def test_a_mirrored_instance_still_faces_outwards(load):
    build = '<item objectid="1" transform="-1 0 0 0 1 0 0 0 1 0 0 0"/>'
    assert load("a.3mf", threemf(build=build)).is_closed_outward


def test_an_object_of_another_part_is_read(load):
    away = components(1).replace("<component o", '<component path="/3D/b.model" o')
    own = 'unit="meter" requiredextensions="p"'
    data = {"3D/a.model": model(object_of(2, away), '<item objectid="2"/>', own=own)}
    assert load("a.3mf", archive(**data, **{"3D/b.model": model(build="")})).n_faces == 4


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"inside": MESH.replace("</mesh>", "<beamlattice/></mesh>")}, "not read: beamlattice"),
        ({"inside": MESH.replace("<triangle v1", "<triangel v1", 1)}, "not read: triangel"),
        ({"build": f"{ITEM}item"}, "not read: text"),
        ({"objects": object_of(2, MESH)}, "1 objects are not in the build"),
    ],
)
def test_what_is_not_read_is_noted(changes, text, load):
    assert text in "\n".join(load("a.3mf", threemf(**changes)).notes)


DEEP = "".join(object_of(i, components(i + 1)) for i in range(2, 3000))
DOCTYPE = '<!DOCTYPE a [<!ENTITY b "c">]>'
DECLARED = f'<?xml version="1.0" encoding="utf-16"?>{DOCTYPE}'
BROKEN = [
    (b"PK\3\4", "the ZIP archive cannot be read"),
    (archive(**{"3D/a.model": "<model"}), "its part '3D/a.model' is no XML"),
    (threemf(build=""), "the file has no faces"),
    (threemf(inside=components(1)), "object '1' is a part of itself"),
    (threemf(DEEP, '<item objectid="2"/>'), "nested too deeply"),
    (threemf(object_of(1, MESH)), "object '1' comes twice"),
    (threemf(own='unit="furlong"'), "got 'furlong'"),
    (threemf(own='requiredextensions="b"'), r"extensions \['b'\] are required"),
    (archive(**{"3D/a.model": DOCTYPE + model()}), "declares a document type"),
    (archive(**{"3D/a.model": (DECLARED + model()).encode("utf-16")}), "declares a document type"),
    (archive(**{"_rels/.rels": "<Relationships/>"}), "names no 3D model"),
    (archive(**{"_rels/.rels": RELATIONSHIPS.replace("/3D/", "/4D/")}), "has no part"),
    (archive(zipfile.ZIP_BZIP2), "must be deflated or stored"),
]  # fmt: skip


@pytest.mark.parametrize(("data", "text"), BROKEN, ids=range(len(BROKEN)))
def test_a_broken_file_is_refused_in_one_line(data, text, load):
    with pytest.raises(MeshError, match=rf"^[^\n]*a\.3mf: [^\n]*{text}[^\n]*$"):
        load("a.3mf", data)


@pytest.mark.slow
def test_a_bomb_is_not_unpacked(load):
    with pytest.raises(RastercovError, match="the budget is"):
        load("a.3mf", archive(**{"3D/a.model": " " * 40_000_000}))
