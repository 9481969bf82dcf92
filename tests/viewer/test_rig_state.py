"""The history of a rig in the page, and what a rig is without its edits."""

import json

import numpy as np
import pytest
from edited import Saving
from hypothesis import given, settings
from hypothesis import strategies as st
from rigs_to_view import acted, around, part, session_of

from rastercov import ConfigError
from rastercov.page.session import TakenRig

MESH = part()
OTHER = around(MESH, 9).reshape(9, 16).tolist()
KINDS = ("pose", "add", "duplicate", "delete", "rename", "task", "camera", "switch", "aim")
STEPS = st.lists(
    st.sampled_from(("undo", "redo")) | st.tuples(st.sampled_from(KINDS), st.integers(0, 50)),
    max_size=12,
)  # fmt: skip


def rig_of(session):
    """What the page has, to the bit."""
    return session.call("asked")["rig"]


def edit(rig, kind, number):
    """One of the edits, of a rig that the page has."""
    if not rig["stations"] or kind == "add":
        return {"do": "add", "camera": "eye", "pose": OTHER[number % 9]}
    station = rig["stations"][number % len(rig["stations"])]["id"]
    more = {
        "pose": {"pose": OTHER[number % 9]},
        "duplicate": {},
        "delete": {},
        "rename": {"name": f"name {number} {len(rig['stations'])} {station}"},
        "switch": {"is_on": bool(number % 2)},
        "aim": {"point": [number / 100, 0.0, 0.1]},
    }
    if kind in more:
        return {"do": kind, "station": station, **more[kind]}
    if kind == "task":
        return {"do": "task", "changes": {"min_pixels": 1 + number}}
    return {"do": "camera", "camera": "eye", "changes": {"hfov_deg": 20 + number}}


@given(STEPS)
@settings(max_examples=6, deadline=None)
def test_undo_and_redo_walk_through_the_states_to_the_bit(steps):
    session = session_of(MESH)
    states, at = [rig_of(session)], 0
    for step in steps:
        if step in ("undo", "redo"):
            acted(session, do=step)
            at = max(0, at - 1) if step == "undo" else min(len(states) - 1, at + 1)
        else:
            acted(session, **edit(states[at], *step))
            states, at = [*states[: at + 1], rig_of(session)], at + 1
        assert rig_of(session) == states[at]
        history = session.history
        assert (history.can_undo, history.can_redo) == (at > 0, at + 1 < len(states))
    session.call("load")  # as another page of the program does
    assert rig_of(session) == states[at]
    assert session.history.can_undo == (at > 0)
    session.close()


@pytest.fixture
def fresh():
    made = session_of(MESH)
    yield made
    made.close()


def test_a_gesture_is_one_step_and_does_not_go_on_after_an_undo(fresh):
    start = rig_of(fresh)
    for number in range(5):
        acted(fresh, do="pose", station=0, pose=OTHER[number], drag=number < 4)
    made = rig_of(fresh)
    for number, is_drag in ((7, True), (8, False)):
        acted(fresh, do="pose", station=1, pose=OTHER[number], drag=is_drag)
    for state in (made, start):
        acted(fresh, do="undo")
        assert rig_of(fresh) == state
    for number, is_drag in ((1, True), (2, False)):
        acted(fresh, do="pose", station=0, pose=OTHER[number], drag=is_drag)
        acted(fresh, do="undo")
    assert rig_of(fresh) == start


def test_saved_is_a_state_and_not_a_number_of_edits(fresh, tmp_path):
    items = []
    for step in (
        lambda: None,
        lambda: acted(fresh, do="duplicate", station=0),
        lambda: Saving(fresh, tmp_path).save({"what": "rig"}),
        lambda: acted(fresh, do="undo"),
        lambda: acted(fresh, do="redo"),
        lambda: acted(fresh, do="undo"),
        lambda: acted(fresh, do="delete", station=0),  # what was saved is reached no more
        lambda: acted(fresh, do="undo"),
    ):
        step()
        items.append(fresh.history.is_saved)
    assert items == [True, False, True, False, True, False, False, False]


def test_stations_keep_their_ids_and_names_differ(fresh):
    acted(fresh, do="delete", station=1)
    acted(fresh, do="add", camera="eye", pose=OTHER[0])
    assert [each["id"] for each in rig_of(fresh)["stations"]] == [0, 2, 3, 4]
    with pytest.raises(ConfigError, match="no camera 1"):
        acted(fresh, do="pose", station=1, pose=OTHER[0])
    for _ in range(2):
        acted(fresh, do="duplicate", station=0)
    names = [each["name"] for each in rig_of(fresh)["stations"]]
    assert len(set(names)) == len(names)
    with pytest.raises(ConfigError, match="already"):
        acted(fresh, do="rename", station=0, name=names[1])
    acted(fresh, do="rename", station=0, name=names[0])
    assert rig_of(fresh)["stations"][0]["name"] == names[0]


def test_poses_have_their_cameras_and_those_that_are_off_are_left_out(fresh):
    acted(fresh, do="new_camera", name="wide", source="eye")
    acted(fresh, do="use", station=2, camera="wide")
    made = fresh.state
    assert made.poses().camera.tolist() == [0, 0, 1, 0]
    acted(fresh, do="switch", station=2, is_on=False)
    off = fresh.state
    saved = json.loads(Saving(fresh).content("rig"))
    counts = [len(off.poses()), len(off.poses(all_stations=True)), len(saved["images"])]
    assert counts == [3, 4, 4]


def test_equal_rigs_are_one_state_so_that_what_is_measured_stays(fresh):
    rig = TakenRig.model_validate(rig_of(fresh))
    again = TakenRig.model_validate(rig.model_dump())
    assert fresh.take(rig, [], "").state is fresh.take(again, [], "").state
    moved = again.model_copy(update={"stations": again.stations[1:]})
    other = fresh.take(moved, [], "").state
    assert other.whole is fresh.take(rig, [], "").state.whole
    assert np.array_equal(other.stations[0].pose, np.reshape(again.stations[1].pose, (4, 4)))
