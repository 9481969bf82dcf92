"""IFC files: a bungalow, its tree, its spaces as rooms, and what cannot be read."""

import pickle
from contextlib import suppress

import numpy as np
import pytest
from bungalow import PARTS, SPACES, bungalow, on_earth
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from nightly import examples
from wheels import with_wheel

import rastercov as rc
from rastercov.base.errors import MeshError, RastercovError
from rastercov.formats.meshes import ifc
from rastercov.placement import Room
from rastercov.placement.candidates.rooms import wrong_side
from rastercov.placement.plan.file import PlanError, plan_of
from rastercov.placement.plan.scene import name_scene

HOUSE = bungalow()
NAMES = """Ground/IfcWall/South Ground/IfcWall/North Ground/IfcWall/West Ground/IfcWall/East
    Ground/IfcDoor/Door_1 Ground/IfcSlab/Floor Ground/IfcWall/Between∕1 Ground/IfcFurniture/ID
    Loft/IfcSlab/Ceiling"""
VOLUMES = [6, 6, 3.36, 3.36, 0.9 * 2.1 * 0.04, 18, 3.36 - 0.9 * 2.1 * 0.2, 0.8, 12]
SHEET = {"height": 1.5, "above": "IfcSlab"}
PLAN = {
    "meshes": [{"path": "a.ifc", "role": "occluder"}],
    "rooms": {"kitchen": {"space": "Kitchen"}, "hall": {"space": "Ground/Hall"}},
    "targets": [SHEET | {"room": "kitchen"}, SHEET | {"near": ["IfcDoor*"], "room": "hall"}],
}


@pytest.fixture(autouse=True)
def file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.ifc").write_bytes(HOUSE)


@pytest.mark.slow
@pytest.mark.parametrize("origin", [(0, 0, 0), (4.5e6, 5.3e6, 300)])
def test_a_building_is_a_tree_in_metres_with_openings_cut_wherever_it_is(origin, load):
    mesh = load("a.ifc", bungalow(origin), unit="m")
    corners = mesh.vertices[mesh.faces] - origin
    volumes = np.bincount(mesh.face_group, np.linalg.det(corners) / 6)
    np.testing.assert_allclose(volumes, VOLUMES, atol=1e-5)
    for own, name in zip(mesh.groups, NAMES.split(), strict=True):
        assert own.name == name.replace("_", " ") or (name[-2:] == "ID" and len(own.name) == 42)
    far = "translation = [-4500000, -5300000, -300] moves it to the origin"
    assert any(far in note for note in mesh.notes) == any(origin)


@pytest.mark.slow
def test_spaces_are_rooms_that_cameras_and_zones_are_held_to():
    points = np.random.default_rng(5).uniform(-1, 7, (2000, 3)) * (1.5, 1, 0.7)
    for (_, solid), (low, high) in zip(rc.Mesh.load("a.ifc").spaces, SPACES.values(), strict=True):
        room = Room.of_solid(solid)
        is_inside = ((low < points) & (points < high)).all(axis=1)
        np.testing.assert_array_equal(room.contains(points), is_inside)
        np.testing.assert_allclose(room.middle, np.add(low, high) / 2, atol=1e-9)
    mesh, plan, _ = name_scene(plan_of(PLAN))
    kitchen, door = (mesh.areas[mesh.face_group == row].sum() for row in (9, 10))
    assert kitchen == pytest.approx(5.7 * 5.6, rel=1e-9)
    assert door == pytest.approx(0.9 * 0.92 + np.pi / 2 * 0.92**2, rel=0.1)
    eyes = np.array([(1, 1, 2.5), (9.5, 1, 2.5), (5, -0.3, 2.5)])
    (line,) = wrong_side(list(plan.built_rooms.values()), eyes)
    assert "1 camera is outside of the rooms (kitchen, hall) or behind a wall: camera 3 at" in line
    camera, poses = rc.Camera.from_fov(64, 48, hfov_deg=80), rc.look_at(eyes, (3, 3, 1.0))
    for step in (0.0, 5.0):
        moved = mesh.moved(translation=(step, 0, 0))
        (line,) = rc.evaluate(moved, camera, poses, by="face").summary()["doubts"]
        assert line.startswith("1 camera is in none of the spaces of the building: camera 3 at")
        poses[:, 0, 3] += 5.0


@pytest.mark.parametrize("schema", ["IFC4", "IFC2X3", "IFC4X3"])
@pytest.mark.parametrize("seed", range(4))
def test_north_and_place_are_those_of_the_file_and_a_map_precedes(schema, seed):
    random = np.random.default_rng(seed)
    true, grid = random.uniform(-180, 180, 2)
    ways = np.stack((np.cos(np.radians((true, grid))), np.sin(np.radians((true, grid)))), axis=1)
    length = random.uniform(0.1, 9)
    north, axis = (length * way for way in ways)
    axis = np.array((axis[1], axis[0]))  # east and north of the local x axis, see below
    sign = random.choice((-1, 1), 2)
    parts = [(int(s * 31), int(s * 7), int(s * 59), int(s * 250000))[: 3 + seed % 2] for s in sign]
    place = sign * (31 + 7 / 60 + (59 + 0.25 * (seed % 2)) / 3600)
    for one in ({"north": north}, {"axis": axis}, {"north": north, "axis": axis}):
        way = {name: tuple(map(float, value)) for name, value in one.items()}
        site, notes = ifc._site(on_earth(schema=schema, place=parts, **way))
        if "axis" in way:
            # The local direction of north, turned as the map turns x, is (0, 1).
            x, y = np.cos(np.radians(site.north_deg)), np.sin(np.radians(site.north_deg))
            east, up = np.array(way["axis"]) / length
            np.testing.assert_allclose((x * east - y * up, x * up + y * east), (0, 1), atol=1e-9)
        else:
            assert site.north_deg == pytest.approx(true, abs=1e-9)
        np.testing.assert_allclose(site[1:], place, rtol=1e-12)
        (note,) = notes
        assert ("TrueNorth" in note, "IfcMapConversion" in note) == (
            "north" in way,
            "axis" in way,
        )
        assert note.index("north at") == 0
    assert ifc._site(on_earth(schema=schema)) == ((None, None, None), [])
    zero = {"north": (0.0, 0.0), "axis": (0.0, 0.0), "place": ((0, 0, 0), (0, 0, 0))}
    assert ifc._site(on_earth(schema=schema, **zero)) == ((None, None, None), [])


@pytest.mark.slow
def test_north_turns_with_the_mesh_and_is_of_files_that_agree(tmp_path):
    for name, north in {"a": (0.6, 0.8), "b": (1.0, 0.0)}.items():
        data = on_earth(HOUSE, north=north, place=((49, 6, 0), (8, 26, 24)))
        (tmp_path / f"{name}.ifc").write_bytes(data.to_string().encode())
    angle = np.degrees(np.arctan2(0.8, 0.6))
    places = [{}, {"angle_deg": angle, "translation": (90, 0, 0)}]
    mesh = rc.Mesh.load(["a.ifc", "b.ifc"], transforms=places)
    assert mesh.site == pytest.approx((angle, 49.1, 8.44))
    moved = mesh.moved(angle_deg=30, scale=2.0)
    assert moved.site.north_deg == pytest.approx(angle + 30)
    assert rc.Mesh.joined([mesh, moved]).site == pytest.approx((None, 49.1, 8.44))
    assert mesh.moved(axis=(0.8, -0.6, 0), angle_deg=90).site.north_deg is None
    assert pickle.loads(pickle.dumps(moved)).site == moved.site


@pytest.mark.slow
def test_the_layers_of_a_floor_are_one_zone_as_large_as_the_room(monkeypatch, tmp_path):
    """A finish that covers a part of the kitchen and one below it, on the slab of the house."""
    layers = {
        ("IfcSlab", "Screed"): ((0.2, 0.2, 0), (5.9, 5.8, 0.05)),
        ("IfcSlab", "Finish"): ((1, 0.2, 0.05), (4, 4, 0.07)),
    }
    monkeypatch.setattr("bungalow.PARTS", layers | PARTS)
    (tmp_path / "a.ifc").write_bytes(bungalow())
    mesh, _, _ = name_scene(plan_of(PLAN))
    is_zone = mesh.target_mask & (mesh.face_group == len(mesh.groups) - 2)
    assert mesh.areas[is_zone].sum() == pytest.approx(5.7 * 5.6, rel=1e-9)
    heights, row = np.unique(mesh.centroids[is_zone, 2].round(6), return_inverse=True)
    assert heights.tolist() == [1.55, 1.57]
    areas = np.bincount(row, mesh.areas[is_zone])
    np.testing.assert_allclose(areas, (5.7 * 5.6 - 3 * 3.8, 3 * 3.8), rtol=1e-9)
    assert sum("up to 0.3 m apart the highest counts" in note for note in mesh.notes) == 1


@pytest.mark.slow
def test_a_space_that_is_none_or_several_is_refused_with_the_list():
    two, every = r"got 2; spaces are Ground/1 Hall \(.{22}\), ", "Ground/0 Kitchen, Ground/1 Hall, "
    for space, words in {"Hall": two, "Bath": f"got none; spaces are {every}Loft/2 Hall$"}.items():
        with pytest.raises(
            PlanError, match=f"rooms.a: expected one space called '{space}', {words}"
        ):
            name_scene(plan_of(PLAN | {"rooms": {"a": {"space": space}}, "targets": []}))
    with pytest.raises(PlanError, match="in IFC files, and none is in the meshes"):
        plan_of(PLAN | {"meshes": [{"built_in": "room"}]}).with_rooms(rc.shapes.box())


@pytest.mark.slow
@pytest.mark.parametrize(
    "data", [b"hello", b"ISO-10303-21;\n", HOUSE[:900], HOUSE.replace(b"IFC4", b"IFC9")]
)
def test_what_is_no_building_is_refused_in_one_line_and_no_other_is_printed(data, load, capfd):
    with pytest.raises(MeshError, match=r"^[^\n]*a\.ifc: [^\n]*$"):
        load("a.ifc", data)
    assert capfd.readouterr() == ("", "")


@pytest.mark.slow
@settings(examples(3, at_night=20), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(cut=st.integers(1, len(HOUSE) - 1))
def test_cut_files_load_in_part_or_are_refused_as_is_what_exceeds_the_budget(cut, load):
    with suppress(RastercovError):
        assert load("b.ifc", HOUSE[:cut]).n_faces <= 200
    with pytest.raises(rc.ResourceError, match="raise memory_budget"):
        load("b.ifc", HOUSE, memory_budget=3000)


def test_a_missing_library_is_named(monkeypatch):
    monkeypatch.setattr(ifc, "find_spec", lambda name: None)
    with pytest.raises(
        MeshError, match=r"ifcopenshell .*got none; pip install 'rastercov\[building\]'"
    ):
        rc.Mesh.load("a.ifc")


@pytest.mark.slow
def test_what_has_no_name_is_called_by_its_number_or_type(load):
    ifcopenshell = with_wheel("ifcopenshell")
    file = ifcopenshell.file.from_string(bungalow().decode())
    (door,), (table,) = file.by_type("IfcDoor"), file.by_type("IfcFurniture")
    door.Name, door.Tag, door.ObjectType = None, "D-101", "Steel door"
    table.ObjectType = "Table"
    (ground,) = (each for each in file.by_type("IfcBuildingStorey") if each.Name == "Ground")
    ground.Name, ground.LongName = None, "Ground floor"
    names = {group.name for group in load("a.ifc", file.to_string().encode()).groups}
    assert {"Ground floor/IfcDoor/D-101", "Ground floor/IfcFurniture/Table"} <= names


@pytest.mark.parametrize(
    ("name", "long_name", "label"),
    [
        ("1 - Living room", "Living room", "1 - Living room"),
        ("Hall", "Hall", "Hall"),
        ("A101", "Foyer", "A101 Foyer"),
        ("", "Foyer", "Foyer"),
        ("A101", "", "A101"),
        ("", "", "0aGlobalId"),
    ],
)
def test_a_long_name_that_a_name_ends_with_is_said_once(name, long_name, label):
    product = ifc.Product("Ground", "IfcSpace", name, long_name, "0aGlobalId")
    assert product.label == f"Ground/{label}"
    assert product.is_called(product.label)


@pytest.mark.slow
def test_rooms_of_half_storeys_with_slab_finish_and_covering_count_once(monkeypatch, tmp_path):
    """A raised hall over the slab of the house, on layers that overlap in part, as in public files.

    The sheet above the slab of the house passes through the hall, whose floor is another one.
    """
    layers = {
        ("IfcSlab", "Screed"): ((0.2, 0.2, 0), (5.9, 5.8, 0.05)),
        ("IfcSlab", "Finish"): ((1, 0.2, 0.05), (4, 4, 0.07)),
        ("IfcSlab", "Carpet"): ((3, 3, 0.05), (5, 5, 0.08)),
        ("IfcSlab", "Podium"): ((6.1, 0.2, 1.0), (9.8, 5.8, 1.2)),
        ("IfcSlab", "Parquet"): ((6.5, 1, 1.2), (9, 4, 1.23)),
    }
    monkeypatch.setattr("bungalow.PARTS", layers | PARTS)
    raised = SPACES | {"Hall": ((6.1, 0.2, 1.2), (9.8, 5.8, 3))}
    monkeypatch.setattr("bungalow.SPACES", raised)
    (tmp_path / "a.ifc").write_bytes(bungalow())
    for number, (name, whole) in enumerate({"0 Kitchen": 5.7 * 5.6, "1 Hall": 3.7 * 5.6}.items()):
        rooms = {"a": {"space": f"Ground/{name}"}}
        target = {"above": "IfcSlab", "height": 1.5, "room": "a"}
        mesh, _, _ = name_scene(plan_of(PLAN | {"rooms": rooms, "targets": [target]}))
        assert mesh.areas[mesh.target_mask].sum() == pytest.approx(whole, rel=1e-9), number
