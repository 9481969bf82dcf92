"""IFC files: a bungalow in any unit, its tree, its spaces as rooms, and what cannot be read."""

from contextlib import suppress

import numpy as np
import pytest
from bungalow import SPACES, WALLS, bungalow
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from nightly import examples

import rastercov as rc
from rastercov.base.errors import MeshError, RastercovError
from rastercov.mesh.formats import ifc
from rastercov.placement import Room, read_spaces
from rastercov.placement.candidates.rooms import wrong_side
from rastercov.placement.plan.file import PlanError, plan_of
from rastercov.placement.plan.scene import named_scene

HOUSE = bungalow()
PLAN = {
    "meshes": [{"path": "a.ifc", "role": "occluder"}],
    "rooms": {"kitchen": {"space": "Kitchen"}, "hall": {"space": "Ground/Hall"}},
    "targets": [
        {"above": "IfcSlab", "height": 1.5, "room": "kitchen", "name": "kitchen"},
        {"above": "Floor", "height": 1.5, "near": ["IfcDoor*"], "within": 1, "room": "hall"},
    ],
}


@pytest.fixture
def file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.ifc").write_bytes(HOUSE)
    return "a.ifc"


@pytest.mark.slow
@pytest.mark.parametrize(("metres", "origin"), [(1.0, (0, 0, 0)), (0.001, (4.5e6, 5.3e6, 300.0))])
def test_a_building_is_read_in_metres_as_a_tree_with_openings_cut(metres, origin, load):
    mesh = load("a.ifc", bungalow(metres, origin), unit="m")
    low, high = mesh.bounds - origin
    np.testing.assert_allclose([low, high], [(0, 0, -0.3), (10, 6, 3.2)], atol=1e-6)
    names = [group.name for group in mesh.groups]
    assert names[:5] == [f"Ground/IfcWall/{name.replace('/', '∕')}" for name in WALLS]
    assert names[5:7] == ["Ground/IfcDoor/Door 1", "Ground/IfcSlab/Floor"]
    assert names[7].startswith("Ground/IfcFurniture/")  # its GlobalId: it has no name
    assert names[8:] == ["Loft/IfcSlab/Ceiling"]
    volumes = [
        np.linalg.det(mesh.vertices[mesh.faces[mesh.face_group == row]] - origin).sum() / 6
        for row in range(9)
    ]
    expected = [6, 6, 3.36, 3.36, 3.36 - 0.9 * 2.1 * 0.2, 0.9 * 2.1 * 0.04, 18, 0.8, 12]
    np.testing.assert_allclose(volumes, expected, atol=1e-5)
    far = [note for note in mesh.notes if "km from the origin" in note]
    assert len(far) == (metres != 1)
    assert not far or "translation = [-4500000, -5300000, -300]" in far[0]


@pytest.mark.slow
def test_spaces_are_rooms_that_cameras_and_zones_are_held_to(file):
    spaces = read_spaces(file)
    assert [(each.name, each.long_name) for each in spaces] == list(SPACES)
    points = np.random.default_rng(5).uniform(-1, 7, (2000, 3)) * (1.5, 1, 0.7)
    for space, (low, high) in zip(spaces, SPACES.values(), strict=True):
        room = Room.of_solid(space.solid)
        is_inside = ((low < points) & (points < high)).all(axis=1)
        np.testing.assert_array_equal(room.contains(points), is_inside)
        assert room.outline(room.middle[2]).area == pytest.approx(
            np.prod(np.subtract(high, low)[:2])
        )
        assert room.contains(room.middle[None]).all()
    mesh, plan, _ = named_scene(plan_of(PLAN))
    kitchen, door = (mesh.areas[mesh.face_group == row].sum() for row in (9, 10))
    assert kitchen == pytest.approx(5.7 * 5.6, rel=1e-9)
    assert door == pytest.approx(0.9 * 0.92 + np.pi / 2 * 0.92**2, rel=0.1)
    eyes = np.array([(1, 1, 2.5), (9.5, 1, 2.5), (5, -0.3, 2.5)])
    (line,) = wrong_side(list(plan.built_rooms.values()), eyes)
    assert "1 camera is outside of the rooms (kitchen, hall) or behind a wall: 2 at" in line


@pytest.mark.slow
@pytest.mark.usefixtures("file")
@pytest.mark.parametrize(
    ("space", "words"),
    [
        ("Hall", "2 spaces are called 'Hall': Ground/2 Hall, Loft/3 Hall; name one"),
        ("Bath", "no space 'Bath'; spaces are Ground/1 Kitchen, Ground/2 Hall, Loft/3 Hall"),
    ],
)
def test_a_space_that_is_none_or_several_is_refused_with_the_list(space, words):
    with pytest.raises(PlanError, match=f"rooms.a: .*{words}"):
        named_scene(plan_of(PLAN | {"rooms": {"a": {"space": space}}, "targets": []}))
    with pytest.raises(PlanError, match="no mesh is an IFC file with spaces"):
        plan_of(PLAN | {"meshes": [{"built_in": "room"}]}).with_rooms(rc.shapes.box())


@pytest.mark.slow
@pytest.mark.parametrize(
    "data", [b"hello", b"ISO-10303-21;\n", HOUSE[:900], HOUSE.replace(b"IFC4", b"IFC9"),
             HOUSE.replace(b"IFCEXTRUDEDAREASOLID", b"IFCBLOCK")],
)  # fmt: skip
def test_what_is_no_building_is_refused_in_one_line_and_no_other_is_printed(data, load, capfd):
    with pytest.raises(MeshError, match=r"^[^\n]*a\.ifc: [^\n]*$"):
        load("a.ifc", data)
    assert capfd.readouterr() == ("", "")


@pytest.mark.slow
@settings(examples(5, at_night=20), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(cut=st.integers(1, len(HOUSE) - 1))
def test_cut_files_load_or_raise_our_errors_and_big_ones_are_refused(cut, load):
    with suppress(RastercovError):
        assert load("a.ifc", HOUSE[:cut]).n_faces <= 200
    with pytest.raises(rc.ResourceError, match="raise memory_budget"):
        load("a.ifc", HOUSE, memory_budget=3000)


def test_a_missing_library_is_named(load, monkeypatch):
    monkeypatch.setattr(ifc, "find_spec", lambda name: None)
    with pytest.raises(MeshError, match=r"needs ifcopenshell: pip install 'rastercov\[building\]'"):
        load("a.ifc", HOUSE)
