"""Surfaces made as targets: sheets above a floor, grids of boxes."""

import numpy as np
import pytest
from scenes import joined
from target_scenes import sheet_at

from rastercov.base.errors import MeshError, RastercovError
from rastercov.core.mesh import Group, Mesh, shapes
from rastercov.placement.targets import MOST_BOXES, box_grid, count_for, sheet_above, with_target

ROOM = shapes.room(4)


def test_a_sheet_has_the_faces_that_face_up_lifted():
    sheet = sheet_above(ROOM, "room", 1.6)
    is_floor = (ROOM.face_group == 0) & (ROOM.normals[:, 2] > 0.5)
    assert sheet.n_faces == is_floor.sum()
    np.testing.assert_allclose(
        sheet.vertices[sheet.faces], ROOM.vertices[ROOM.faces[is_floor]] + (0, 0, 1.6)
    )
    assert (sheet.normals == (0, 0, 1)).all()
    assert sheet.areas.sum() == pytest.approx(6 * 5)


def test_slopes_stay_slopes_and_walls_are_left_out():
    #    /|
    #   / |  a ramp of 30 degrees, and the wall behind it
    ramp = Mesh(
        [(0, 0, 0), (2, 0, 2 * np.tan(np.pi / 6)), (0, 1, 0), (2, 0, 0), (2, 1, 0)],
        [(0, 1, 2), (3, 4, 1)],
    )
    sheet = sheet_above(ramp, "mesh", 0.5)
    assert sheet.n_faces == 1
    np.testing.assert_allclose(sheet.normals[0], ramp.normals[0])


def test_a_two_sided_floor_may_face_down():
    floor = sheet_at((0, 0), (1, 1), 0)
    turned = Mesh(floor.vertices, floor.faces[:, ::-1])
    with pytest.raises(
        MeshError, match="expected a face of group 'mesh' that faces up within 45 degrees, got"
    ):
        sheet_above(turned, "mesh", 1.6)
    sheet = sheet_above(turned.with_groups(two_sided="all"), "mesh", 1.6)
    assert (sheet.normals[:, 2] == 1).all()


@pytest.mark.parametrize("size", [None, 0.3])
def test_boxes_are_closed_apart_and_in_the_middle_of_their_cells(size):
    low, high, count = (-1.0, 0.0, 2.0), (1.0, 3.0, 3.0), (2, 3, 1)
    mesh = box_grid(low, high, count, size)
    assert mesh.n_faces == 12 * 6
    assert mesh.can_cull_back_faces  # closed, outward, and none touches another
    middles = mesh.vertices.reshape(-1, 8, 3).mean(axis=1)
    expected = [(x, y, 2.5) for x in (-0.5, 0.5) for y in (0.5, 1.5, 2.5)]
    np.testing.assert_allclose(middles, expected)
    edges = np.ptp(mesh.vertices.reshape(-1, 8, 3), axis=1)
    np.testing.assert_allclose(edges, np.broadcast_to(size or 0.5, (6, 3)))


LOW, HIGH = (0, 0, 0), (1, 1, 1)
REFUSED = [
    *((LOW, high) for high in ((1, 1, 0), (1, 1), (1, 1, np.nan), "abc")),
    *((LOW, HIGH, count) for count in ((1, 1), (1, 1, 0), (1.5, 1, 1), (100, 100, 11))),
    *((LOW, HIGH, (2, 2, 2), size) for size in (0.6, 0.0)),
]


def test_what_cannot_be_made_is_refused_in_one_line():
    calls = [lambda each=each: box_grid(*each) for each in REFUSED]
    calls += [lambda: sheet_above(ROOM, "flor", 1.6), lambda: sheet_above(ROOM, "room", np.inf)]
    calls += [lambda: count_for(LOW, HIGH, 0.0)]
    for call in calls:
        with pytest.raises(RastercovError, match=r"^[^\n]+$"):
            call()


def test_cells_are_no_longer_than_the_spacing():
    assert count_for((0, 0, 0), (1, 2, 0.3), 0.5).tolist() == [2, 4, 1]
    assert count_for((0, 0, 0), (0.3, 0.7, 2.1), 0.1).tolist() == [3, 7, 21]
    assert (count_for((0, 0, 0), (1, 1, 1), 1e-300) > MOST_BOXES).all()


def test_a_target_is_added_behind_the_scene():
    sheet = joined(sheet_at((0, 0), (1, 1), 1), sheet_at((0, 0), (1, 1), 2))
    mesh = with_target(ROOM, sheet, "eyes", two_sided=True)
    np.testing.assert_array_equal(mesh.faces[: ROOM.n_faces], ROOM.faces)
    assert mesh.groups[-1] == Group("eyes", is_two_sided=True, is_target=True)
    np.testing.assert_array_equal(mesh.vertices[mesh.faces[-4:]], sheet.vertices[sheet.faces])
    with pytest.raises(MeshError, match="unique"):
        with_target(mesh, sheet, "eyes")
