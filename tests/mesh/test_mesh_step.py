"""STEP files: solids written by hand, their units, their CAD faces, and what cannot be read."""

import re
from contextlib import suppress

import numpy as np
import pytest
from bungalow import bungalow
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from nightly import examples
from step_crate import HEADER, SIDES, crate

from rastercov.base.errors import MeshError, RastercovError
from rastercov.mesh.formats import gltf, polygons


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
    named = gltf._with_product_names(data).decode().replace(f"{gap},{gap}", ",")
    found = re.findall(r"NEXT_ASSEMBLY_USAGE_OCCURRENCE\('1','(.*?)','',#\d+,#\d+,\$\);", named)
    assert found == list(NAMED.values())
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
    monkeypatch.setattr(gltf, "find_spec", lambda name: None)
    with pytest.raises(MeshError, match="expected the package cascadio for STEP files, got none"):
        load("a.step", crate())
    monkeypatch.setattr(gltf, "find_spec", lambda name: True)
    monkeypatch.setattr(gltf, "CONVERT", "import os; os.kill(os.getpid(), 11)")
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
