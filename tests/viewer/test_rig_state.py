from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rigs_to_view import CAMERA, around, part, state_of

from rastercov import ConfigError, Task
from rastercov.page.rig_state import History

MESH = part()
START = state_of(MESH)
OTHER = around(MESH, 9)


def bits(state):
    """A state, which equals another one where they are the same to the bit."""
    stations = [(s.id, s.name, s.camera, s.pose.tobytes(), s.is_on) for s in state.stations]
    return stations, dict(state.cameras), state.task


def edited(state, kind, number):
    """A state after one of the edits."""
    if not state.stations:
        return state.with_new("eye", OTHER[number % 9])
    station = state.stations[number % len(state.stations)].id
    edits = {
        "pose": lambda: state.with_pose(station, OTHER[number % 9]),
        "new": lambda: state.with_new("eye", OTHER[number % 9]),
        "copy": lambda: state.with_copy(station),
        "without": lambda: state.without(station),
        "name": lambda: state.renamed(station, f"name {number} {len(state.stations)} {station}"),
        "task": lambda: state.with_task(Task(min_pixels=1 + number)),
        "camera": lambda: state.with_camera("eye", CAMERA.resized(1 + number / 7)),
    }
    return edits[kind]()


KINDS = ("pose", "new", "copy", "without", "name", "task", "camera")
STEPS = st.lists(
    st.sampled_from(("undo", "redo")) | st.tuples(st.sampled_from(KINDS), st.integers(0, 50)),
    max_size=30,
)  # fmt: skip


@given(STEPS)
@settings(max_examples=60)
def test_undo_and_redo_walk_through_the_states_to_the_bit(steps):
    history, states, at = History(START), [START], 0
    for number, step in enumerate(steps):
        if step == "undo":
            history.undo()
            at = max(0, at - 1)
        elif step == "redo":
            history.redo()
            at = min(len(states) - 1, at + 1)
        else:
            made = edited(history.state, *step)
            history.take(made, f"step {number}")
            states, at = [*states[: at + 1], made], at + 1
        assert bits(history.state) == bits(states[at])
        assert bool(history.undo_label) == (at > 0)
        assert bool(history.redo_label) == (at + 1 < len(states))


def test_a_gesture_is_one_step_and_does_not_go_on_after_an_undo():
    history = History(START)
    for number in range(5):
        made = START.with_pose(0, OTHER[number])
        history.take(made, "move", is_drag=number < 4)
    history.take(START.with_pose(1, OTHER[7]), "turn", is_drag=True)
    history.take(START.with_pose(1, OTHER[8]), "turn")
    for state in (made, START):
        history.undo()
        assert bits(history.state) == bits(state)
    for number, is_drag in ((1, True), (2, False)):
        history.take(START.with_pose(0, OTHER[number]), "move", is_drag=is_drag)
        history.undo()
    assert bits(history.state) == bits(START)


def test_saved_is_a_state_and_not_a_number_of_edits():
    history, found = History(START), []
    for step in (
        lambda: None,
        lambda: history.take(START.with_copy(0), "duplicate"),
        history.saved,
        history.undo,
        history.redo,
        history.undo,
        lambda: history.take(START.without(0), "delete"),  # what was saved is reached no more
        history.undo,
    ):
        step()
        found.append(history.is_saved)
    assert found == [True, False, True, False, True, False, False, False]


def test_stations_keep_their_ids_and_names_differ():
    made = START.without(1).with_new("eye", OTHER[0])
    assert [each.id for each in made.stations] == [0, 2, 3, 4]
    with pytest.raises(ConfigError, match="got station 1"):
        made.station(1)
    made = START.with_copy(0).with_copy(0)
    names = [each.name for each in made.stations]
    assert len(set(names)) == len(names)
    with pytest.raises(ConfigError, match="which is taken"):
        made.renamed(0, names[1])
    assert made.renamed(0, names[0]).stations[0].name == names[0]


def test_poses_have_their_cameras_and_those_that_are_off_are_left_out():
    made = START.with_camera("wide", CAMERA.resized(2)).using(2, "wide")
    assert made.poses().camera.tolist() == [0, 0, 1, 0]
    off = made.with_station(replace(made.station(2), is_on=False))
    counts = [len(off.poses()), len(off.poses(all_stations=True)), len(off.views().images)]
    assert counts == [3, 4, 4]
