"""Rooms of a building: candidates on their walls, targets in them, cameras outside of them."""

import numpy as np
import pytest
from houses import HALL, KITCHEN, house
from plans import write_obj

import rastercov as rc
from rastercov.placement import NearestSurface, Room, in_room
from rastercov.placement.candidates.rooms import wrong_side
from rastercov.placement.plan.file import PlanError, plan_of
from rastercov.placement.plan.scene import candidate_pool, name_scene

CAMERA = rc.Camera.from_fov(1280, 720, hfov_deg=90)
SHEET = {"above": "floor", "height": 1.6}
ROOMS = {
    "kitchen": {"inside": [2.0, 2.0, 1.2]},
    "hall": {"polygon": [[6.1, 0.2], [9.8, 0.2], [9.8, 5.8], [6.1, 5.8]], "z": [0.0, 2.8]},
}
CANDIDATES = {"generator": "in_room", "spacing": 2.0, "heights": [2.2, 2.6], "on": ["walls"]}
PLAN = {
    "meshes": [{"path": "house.obj", "role": "occluder"}],
    "rooms": ROOMS,
    "targets": [SHEET | {"room": name} for name in ROOMS] + [SHEET | {"near": ["door"]}],
    "camera": {"width": 640, "height": 360, "hfov_deg": 90.0},
    "candidates": [CANDIDATES | {"room": name, "groups": ["walls"]} for name in ROOMS],
    "selection": {"goal": "best_coverage", "cameras": 2, "refine": True, "refine_budget": 200},
}


@pytest.fixture(autouse=True)
def file(folder):
    mesh = house()
    firsts = np.unique(mesh.face_group, return_index=True)[1]
    write_obj("house.obj", mesh, zip([group.name for group in mesh.groups], firsts, strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("angle_deg", [0.0, 30.0])
@pytest.mark.parametrize(("middle", "walls"), [((2, 2, 1.2), KITCHEN), ((8, 3, 1.2), HALL)])
def test_candidates_are_in_their_room_on_its_walls_and_more_with_less_spacing(
    angle_deg, middle, walls
):
    mesh = house().moved(angle_deg=angle_deg)
    turn = rc.Mesh(np.eye(3), [(0, 1, 2)]).moved(angle_deg=angle_deg).vertices
    room, before = Room.at(mesh, middle @ turn), np.zeros((0, 3))
    # With the reveals of door and window; the border in a door is a quarter of it off at most.
    low, high = np.add(walls, [[-0.3, 0, 0], [0.3, 0, 0]])
    corners = np.stack(np.meshgrid(*np.transpose(walls)), -1).reshape(-1, 3) @ turn
    for spacing in (2.0, 1.0, 1.0):
        eyes = in_room(mesh, CAMERA, room=room, spacing=spacing, inset=0.15).poses[:, :3, 3]
        placed = eyes @ turn.T
        np.testing.assert_array_equal(eyes[: len(before)], before)
        np.testing.assert_allclose(NearestSurface(mesh).query(eyes).distance, 0.15, rtol=1e-6)
        assert ((low <= placed) & (placed <= high)).all()
        assert np.linalg.norm(corners[:, None] - eyes, axis=-1).min(axis=1).max() <= spacing + 0.5
        grown, before = len(eyes) > len(before) or spacing == 1.0, eyes
        assert grown
    beside = np.array([(-0.2, 3, 1), middle, (3, 0.1, 1)]) @ turn  # in the garden, and in a wall
    (line,) = wrong_side([room], beside)
    assert "2 cameras are outside of the rooms (room) or behind a wall: camera 1 at (" in line
    assert wrong_side([room], eyes) == wrong_side([], beside) == []


def test_sheets_end_at_the_walls_and_at_a_distance_from_the_door():
    mesh, _, _ = name_scene(plan_of(PLAN))
    kitchen, hall, door = (mesh.areas[mesh.face_group == row].sum() for row in (5, 6, 7))
    assert hall == pytest.approx(3.7 * 5.6, rel=1e-12)
    assert kitchen == pytest.approx(5.7 * 5.6 + 0.9 * 0.1, abs=0.25)
    assert door == pytest.approx(0.9 * 0.04 + 2 * 0.94 + np.pi, rel=0.01)
    assert (mesh.normals[mesh.target_mask, 2] > 0.999).all()


@pytest.mark.parametrize("seed", range(6))
def test_the_middle_of_a_solid_is_in_it_whatever_gaps_it_has(seed):
    random = np.random.default_rng(seed)
    heights = np.sort(random.uniform(0, 9, (random.integers(1, 5), 2)).ravel()).reshape(-1, 2)
    boxes = [rc.shapes.box((*random.uniform(1, 3, 2), high - low)) for low, high in heights]
    moved = [
        rc.Mesh(np.add(box.vertices, (*random.uniform(-9, 9, 2), ends.mean())), box.faces)
        for box, ends in zip(boxes, heights, strict=True)
    ]
    room = Room.of_solid(rc.Mesh.joined(moved))
    assert room.contains(room.middle[None]).all()
    assert room.outline(room.middle[2]).area > 0


@pytest.mark.slow
def test_refined_cameras_stay_at_their_places():
    pool = candidate_pool(*name_scene(plan_of(PLAN))[1::-1]).candidates
    eyes = rc.place(PLAN).cameras.placed.world_from_camera[:, :3, 3]
    assert {tuple(eye) for eye in eyes} <= {tuple(eye) for eye in pool.poses[:, :3, 3]}
    assert ((eyes[:, 2] >= 2.2) & (eyes[:, 2] <= 2.6)).all()


REFUSED = {
    "a wider opening leads outside": {"rooms": {"r": {"inside": [2.0, 2.0, 9.0]}}},
    "rooms.r: inside: .* it is narrower": {"rooms": {"r": {"inside": [2.0, 2.0, 2.9]}}},
    "rooms.r: .* got 1 corners": {"rooms": {"r": {"polygon": [[0.0, 0.0]], "z": [0.0, 1.0]}}},
    "rooms.r: expected one of inside, polygon": {"rooms": {"r": {"z": [0.0, 1.0]}}},
    "expected a room, got 'kitchen'; rooms are none": {"rooms": {}},
    "got 'gate'.*groups: floor": {"targets": [SHEET | {"near": ["gate"]}]},
    "expected faces in the room": {"targets": [SHEET | {"room": "hall", "height": 3.0}]},
}


@pytest.mark.parametrize("words", REFUSED)
def test_a_room_that_is_none_is_refused_in_one_line(words):
    with pytest.raises(PlanError, match=words):
        name_scene(plan_of(PLAN | REFUSED[words]))


def test_heights_are_from_and_to():
    entry = CANDIDATES | {"room": "hall", "heights": [2.2, 2.4, 2.6]}
    with pytest.raises(PlanError, match=r"heights: expected \[lowest, highest\] or one number"):
        plan_of(PLAN | {"candidates": [entry]})
