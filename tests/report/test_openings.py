"""Openings of buildings: which way they face, their rooms, and the numbers on plans."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely

import rastercov as rc
from rastercov.formats.meshes.ifc import Product
from rastercov.report.openings import COMPASS, Openings, compass
from rastercov.report.pages import render

PANES = {
    "S": ((0, -2, 1), (1, 0.1, 1)),
    "E": ((3, 0, 1), (0.1, 1, 1)),
    "N": ((1, 2, 1), (1, 0.1, 1)),
}
"""Middle and size of windows of a house of 6 x 4 x 3 m, by the side that they face."""


def wall(x, y, dx, dy, low=0.0, high=3.0):
    return rc.shapes.box((dx, dy, high - low), centre=(x, y, (low + high) / 2))


def house(turn_deg, *, with_rooms, storeys=1):
    """Mesh of walls around windows, its pieces, and the middles of the windows."""
    parts, names, panes, rooms = [], [], [], []
    for level in range(storeys):
        up = (0, 0, 3.5 * level)
        own = [wall(0, -2.2, 6.6, 0.3, high=0.4), wall(0, 2.2, 6.6, 0.3, high=0.4)]
        own += [wall(-3.2, 0, 0.3, 4.6), wall(3.2, 0, 0.3, 4.6, high=0.4)]
        own += [wall(0, y, 6.6, 0.3, 1.6) for y in (-2.2, 2.2)] + [wall(3.2, 0, 0.3, 4.6, 1.6)]
        own += [wall(0, 0, 6.8, 4.8, 3, 3.2), wall(0, 0, 6.8, 4.8, -0.2, 0)]
        parts += [each.moved(translation=up) for each in own]
        names += [f"L{level}/IfcWall/w{row}" for row in range(len(own))]
        for side, (at, size) in PANES.items():
            parts.append(rc.shapes.box(size, centre=at).moved(translation=up))
            names.append(f"L{level}/IfcWindow/{side}")
            panes.append(names[-1])
        inside = rc.shapes.box((5.8, 3.8, 2.9), centre=(0, 0, 1.5)).moved(translation=up)
        rooms.append((Product(f"L{level}", "IfcSpace", "1", "Hall", "g"), inside))
    mesh = rc.Mesh.joined(parts, names).moved(axis=(0, 0, 1), angle_deg=turn_deg)
    spaces = [(p, each.moved(axis=(0, 0, 1), angle_deg=turn_deg)) for p, each in rooms]
    mesh = rc.Mesh(
        mesh.vertices, mesh.faces, mesh.groups, mesh.face_group, spaces=spaces * with_rooms
    )
    piece = np.full(mesh.n_faces, -1)
    order = [mesh.groups.index(next(g for g in mesh.groups if g.name == name)) for name in panes]
    for row, group in enumerate(order):
        piece[mesh.face_group == group] = row
    at = np.array([mesh.centroids[piece == row].mean(axis=0) for row in range(len(panes))])
    return Openings(mesh, piece, at), panes


@pytest.mark.parametrize("with_rooms", [True, False])
def test_windows_face_away_from_their_rooms_however_the_house_is_turned(with_rooms):
    for turn in np.random.default_rng(1).uniform(0, 360, 6):
        openings, panes = house(turn, with_rooms=with_rooms)
        normals, rooms = openings.sides()
        assert np.linalg.norm(normals, axis=1) == pytest.approx(1)
        own = compass(normals, 90 + turn)  # north turns with the house
        assert own == [name.split("/")[-1] for name in panes]
        assert rooms == ["L0/1 Hall" * with_rooms] * len(panes)


def test_a_pane_alone_or_behind_a_screen_faces_no_side_that_is_known():
    pane, screen = rc.shapes.box((1, 0.1, 1)), rc.shapes.box((3, 0.1, 3), centre=(0, -0.5, 0))
    for scene in (rc.Mesh.joined([pane], ["a"]), rc.Mesh.joined([pane, screen], ["a", "b"])):
        piece = np.where(scene.face_group == 0, 0, -1)
        normals, rooms = Openings(scene, piece, np.zeros((1, 3))).sides()
        assert (normals.tolist(), rooms, compass(normals, 90.0)) == ([[0, 0, 0]], [""], [""])


def test_a_pane_of_one_side_faces_where_its_light_comes_from():
    """And not away from a wall before it, which shades it."""
    corners = np.array([(-0.5, 0, 0), (0.5, 0, 0), (0.5, 0, 1), (-0.5, 0, 1)], float)
    pane = rc.Mesh(corners, [(0, 1, 2), (0, 2, 3)])  # its normal is -y
    wall = rc.shapes.box((6, 0.1, 6), centre=(0, -0.2, 0))
    scene = rc.Mesh.joined([pane, wall], ["window", "wall"])
    piece = np.where(scene.face_group == 0, 0, -1)
    both = scene.with_groups(two_sided=["window"])
    for mesh, side in ((scene, "S"), (both, "N")):  # of a pane without a front, the wall is behind
        normals, _ = Openings(mesh, piece, np.array([(0, 0, 0.5)])).sides()
        assert compass(normals, 90.0) == [side]


def test_the_compass_is_clockwise_from_north():
    turn = np.radians(np.arange(8) * 45)
    vectors = np.stack((np.sin(turn), np.cos(turn), np.zeros(8)), axis=1)
    assert compass(vectors, 90.0) == list(COMPASS)
    assert compass(vectors, 0.0)[0] == "W"  # +y is left of a north along +x
    assert compass(np.array([(0, 0, 1.0)]), 90.0) == [""]


def test_names_have_storey_room_and_name_without_types_of_the_file():
    openings, _ = house(0, with_rooms=True)
    names = openings.names(openings.sides()[1])
    assert names == ["L0, 1 Hall, S", "L0, 1 Hall, E", "L0, 1 Hall, N"]


def np_line(numbers):
    return shapely.linestrings(np.array(numbers, float).reshape(-1, 2))


def test_each_storey_has_a_plan_with_its_numbers_in_their_places():
    openings, _ = house(0, with_rooms=True, storeys=3)
    n = len(openings.at)
    numbers = (1 + np.random.default_rng(2).permutation(n)).tolist()
    plans = openings.plans(numbers, openings.names(openings.sides()[1]), 90.0)
    assert [plan["title"] for plan in plans] == ["L0", "L1", "L2"]
    seen = []
    for row, plan in enumerate(plans):
        root = ElementTree.fromstring(render("floor_plan.svg", plan=plan))
        texts = [each.text for each in root.iter("text")]
        assert texts.count("Hall") == 1
        own = numbers[3 * row : 3 * row + 3]
        assert {int(text) for text in texts if text.isdigit()} - {0} == set(own)
        seen += own
        scale = plan["bar"][0] / float(plan["bar"][1].split()[0])
        at = np.array([each[:2] for each in plan["parts"]])
        steps = np.diff(at, axis=0) / scale * (1, -1)
        assert steps == pytest.approx(np.diff(openings.at[3 * row : 3 * row + 3, :2], axis=0))
        parts = [re.findall(r"[-\d.]+", part) for part in plan["walls"].split("M")[1:]]
        walls = shapely.union_all([np_line(part) for part in parts])
        for x, y, text in plan["labels"]:
            half = (0.9 * len(text), 1.3)
            assert not walls.intersects(
                shapely.box(x - half[0], y - half[1], x + half[0], y + half[1])
            )
    assert sorted(seen) == sorted(numbers)


@pytest.mark.parametrize("raised", [0.0, 0.6])
def test_the_point_of_a_window_is_over_floor_and_sill_whatever_storey(raised):
    openings, panes = house(0, with_rooms=True, storeys=2)
    mesh = openings.mesh
    part = np.unique(mesh.faces[openings.piece == 0])
    corners = mesh.vertices.copy()
    corners[part, 2] += raised
    moved = rc.Mesh(corners, mesh.faces, mesh.groups, mesh.face_group, spaces=mesh.spaces)
    at = openings.at.copy()
    at[0, 2] += raised
    opened = Openings(moved, openings.piece, at)
    rooms = opened.sides()[1]
    floors = {product.label: space.bounds[0][2] for product, space in mesh.spaces}
    for row, (point, name) in enumerate(zip(opened.prescribed(rooms), panes, strict=True)):
        sill = corners[mesh.faces[openings.piece == row], 2].min()
        level = int(name[1])
        assert point[:2] == at[row, :2].tolist()
        assert floors[rooms[row]] == pytest.approx(0.05 + 3.5 * level)
        assert point[2] == pytest.approx(max(1.25 + 3.5 * level, sill + 0.3))
    assert opened.prescribed([""] * len(panes)) == [None] * len(panes)
