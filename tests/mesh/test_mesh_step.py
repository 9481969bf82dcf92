"""STEP files: solids written by hand, their units, their CAD faces, and what cannot be read."""

from contextlib import suppress
from itertools import product

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from nightly import examples

from rastercov.base.errors import MeshError, RastercovError
from rastercov.mesh.formats import gltf

HEADER = (
    "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\nFILE_NAME('','',(''),(''),'','','');\n"
    "FILE_SCHEMA(('AUTOMOTIVE_DESIGN'));\nENDSEC;\nDATA;\n"
)
SIDES = [
    ((0, 2, 3, 1), (0, 0, -1), (1, 0, 0)),
    ((4, 5, 7, 6), (0, 0, 1), (1, 0, 0)),
    ((0, 1, 5, 4), (0, -1, 0), (1, 0, 0)),
    ((2, 6, 7, 3), (0, 1, 0), (1, 0, 0)),
    ((0, 4, 6, 2), (-1, 0, 0), (0, 1, 0)),
    ((1, 3, 7, 5), (1, 0, 0), (0, 1, 0)),
]
"""Corners, normal and an axis of each side of a box; bits 0, 1, 2 of a corner are x, y, z."""


def crate(size=(1.0, 2.0, 3.0), prefix="$") -> bytes:
    """A box as a STEP file, in metres or another SI unit of length by its prefix."""
    lines: list[str] = []

    def add(text: str) -> str:
        lines.append(f"#{len(lines) + 1}={text};")
        return f"#{len(lines)}"

    def triple(kind: str, values) -> str:
        return add(f"{kind}('',({','.join(str(float(value)) for value in values)}))")

    def joined(items) -> str:
        return f"({','.join(items)})"

    corners = [np.array(bits[::-1]) * size for bits in product((0, 1), repeat=3)]
    points = [triple("CARTESIAN_POINT", corner) for corner in corners]
    faces = []
    for loop, normal, axis in SIDES:
        polygon = add(f"POLY_LOOP('',{joined(points[i] for i in loop)})")
        bound = add(f"FACE_OUTER_BOUND('',{polygon},.T.)")
        directions = [triple("DIRECTION", normal), triple("DIRECTION", axis)]
        frame = add(f"AXIS2_PLACEMENT_3D('',{points[loop[0]]},{','.join(directions)})")
        plane = add(f"PLANE('',{frame})")
        faces.append(add(f"FACE_SURFACE('',({bound}),{plane},.T.)"))
    shell = add(f"CLOSED_SHELL('',{joined(faces)})")
    solid = add(f"FACETED_BREP('',{shell})")
    length = add(f"(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT({prefix},.METRE.))")
    angle = add("(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.))")
    solid_angle = add("(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT())")
    context = add(
        "(GEOMETRIC_REPRESENTATION_CONTEXT(3)"
        f"GLOBAL_UNIT_ASSIGNED_CONTEXT({joined([length, angle, solid_angle])})"
        "REPRESENTATION_CONTEXT('',''))"
    )
    shape = add(f"FACETED_BREP_SHAPE_REPRESENTATION('',({solid}),{context})")
    application = add("APPLICATION_CONTEXT('')")
    product_context = add(f"PRODUCT_CONTEXT('',{application},'')")
    part = add(f"PRODUCT('crate','crate','',({product_context}))")
    formation = add(f"PRODUCT_DEFINITION_FORMATION('','',{part})")
    definition_context = add(f"PRODUCT_DEFINITION_CONTEXT('',{application},'')")
    definition = add(f"PRODUCT_DEFINITION('','',{formation},{definition_context})")
    defined = add(f"PRODUCT_DEFINITION_SHAPE('','',{definition})")
    add(f"SHAPE_DEFINITION_REPRESENTATION({defined},{shape})")
    return (HEADER + "\n".join(lines) + "\nENDSEC;\nEND-ISO-10303-21;\n").encode()


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
    assert any("the unit given was not applied" in note for note in mesh.notes)
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


@pytest.mark.slow
@pytest.mark.usefixtures("_cascadio")
@pytest.mark.parametrize("data", [b"hello", b"ISO-10303-21;\n", crate()[:1500], HEADER.encode()])
def test_what_is_no_step_file_is_refused_in_one_line_and_no_other_is_printed(data, load, capfd):
    with pytest.raises(MeshError, match=r"^[^\n]*a\.step: [^\n]*$"):
        load("a.step", data)
    assert capfd.readouterr() == ("", "")


@pytest.mark.usefixtures("_cascadio")
@pytest.mark.slow
@settings(examples(5, at_night=20), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(cut=st.integers(1, len(crate()) - 1))
def test_cut_files_load_whole_or_raise_mesh_error(cut, load):
    with suppress(RastercovError):
        assert load("a.step", crate()[:cut]).n_faces == 12


def test_a_converter_that_is_missing_or_crashes_is_named(load, monkeypatch):
    monkeypatch.setattr(gltf, "find_spec", lambda name: None)
    with pytest.raises(MeshError, match=r"needs cascadio: pip install 'rastercov\[formats\]'"):
        load("a.step", crate())
    monkeypatch.setattr(gltf, "find_spec", lambda name: True)
    monkeypatch.setattr(gltf, "CONVERT", "import os; os.kill(os.getpid(), 11)")
    with pytest.raises(MeshError, match="ended by signal 11"):
        load("a.step", crate())
