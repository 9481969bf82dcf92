"""The command `groups`: names that other commands take, with faces, areas, boxes and rooms."""

import json
from pathlib import Path

import numpy as np
import pytest
from bungalow import SPACES, bungalow
from commands import call

import rastercov as rc


@pytest.fixture
def house(here):
    (here / "house.ifc").write_bytes(bungalow())
    return rc.Mesh.load("house.ifc")


def test_each_group_is_listed_with_its_faces_area_and_box(house, capsys):
    code, out, _ = call(capsys, "groups house.ifc --json --occluder *IfcSlab*")
    rows = json.loads(out)["groups"]
    assert code == 0
    assert [row["name"] for row in rows] == [group.name for group in house.groups]
    for number, row in enumerate(rows):
        own = house.face_group == number
        places = house.vertices[house.faces[own]].reshape(-1, 3)
        assert row["role"] == ("occluder" if "IfcSlab" in row["name"] else "task")
        assert (row["groups"], row["faces"]) == (1, own.sum())
        assert row["area_m2"] == pytest.approx(house.areas[own].sum())
        assert np.array([row["low"], row["high"]]) == pytest.approx(
            np.array([places.min(axis=0), places.max(axis=0)])
        )


def test_parts_add_up_to_their_groups_and_rooms_are_those_of_the_file(house, capsys):
    _, out, _ = call(capsys, "groups house.ifc --level 1 --json --occluder *Floor")
    listed = json.loads(out)
    rows = listed["groups"]
    assert sum(row["faces"] for row in rows) == house.n_faces
    assert sum(row["groups"] for row in rows) == len(house.groups)
    assert {row["name"] for row in rows} == {"Ground", "Loft"}
    assert {row["role"] for row in rows} == {"occluder and task", "task"}
    ends = sorted((row["low"], row["high"]) for row in listed["rooms"])
    for found, given in zip(ends, sorted(SPACES.values()), strict=True):
        assert np.array(found) == pytest.approx(np.array(given))
    _, out, _ = call(capsys, "groups house.ifc --level 1")
    for row in [*rows, *listed["rooms"]]:
        assert row["name"] in out
    assert "2 parts" in out
    assert "3 rooms" in out


def test_a_listed_name_is_taken_by_commands_that_ask_for_groups(house, capsys):
    _, out, _ = call(capsys, "groups house.ifc --json")
    for row in json.loads(out)["groups"][:3]:
        line = ["sun", "house.ifc", "--of", row["name"], "--latitude", "50", "--longitude", "14"]
        code, out, _ = call(capsys, [*line, "--day", "2026-03-21", "--step", "60", "-o", "s"])
        assert code == 0
        parts = json.loads(Path("s/sun.json").read_text(encoding="utf-8"))["parts"]
        assert row["name"] in [part["name"] for part in parts]


def test_a_mesh_without_names_is_one_group(capsys):
    code, out, _ = call(capsys, "groups box --json")
    listed = json.loads(out)
    assert (code, len(listed["groups"]), listed["rooms"]) == (0, 1, [])


def test_a_pipe_gets_a_line_a_row(here, capsys):
    """Names were folded at 80 columns, so that no line had all of one."""
    names = [f"storey_{n}/{'a_wall_of_a_building_with_long_names_' * 3}{n}" for n in range(3)]
    faces = [f"g {name}\nf 1 2 3" for name in names]
    Path("long.obj").write_text("\n".join(["v 0 0 0", "v 1 0 0", "v 0 1 0", *faces]))
    _, out, _ = call(capsys, "groups long.obj")
    rows = [line for line in out.splitlines() if line.startswith("storey_")]
    assert [row.split()[0] for row in rows] == names
    assert all(row.split()[1:3] == ["task", "1"] for row in rows)
