import threading
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from rigs_to_view import CAMERA, acted, around, moved, part, session_of, state_of

import rastercov as rc
from rastercov.core.coverage.reasons import Reason
from rastercov.core.mesh import shapes
from rastercov.page.measurements import Measurements
from rastercov.page.scene import default_space, open_plan
from rastercov.page.session import Session
from rastercov.page.work import BusyError, Cancelled, Work, refined, tries, with_next
from rastercov.placement import NearestSurface, in_solid
from rastercov.placement.improve.pose_space import PoseSpace
from rastercov.placement.plan.run import place

MESH = part()
CUBE = shapes.box()


@pytest.fixture(scope="module")
def measurements():
    made = Measurements(MESH)
    yield made
    made.close()


def covered_area(state):
    """Area that `rc.evaluate` finds covered, and summed over the required views, m^2."""
    found = rc.evaluate(MESH, CAMERA, state.poses(), state.task, fields=())
    if found.areas is None:
        network = rc.Network(MESH, state.task)
        network.add(rc.evaluate(MESH, CAMERA, state.poses(), state.task, by="face"))
        views = np.minimum(network.views, state.task.views)
        return float(MESH.areas[network.covered].sum()), float(views @ MESH.areas)
    area = found.areas.summary()
    return area["m2"], sum(each["m2"] for each in area["by_views"])


TASKS = [rc.Task(), rc.Task(views=2), rc.Task(min_pixels=4), rc.Task(views=2, min_pixels=4)]
"""By area and by face."""


@pytest.mark.slow
@pytest.mark.parametrize("task", TASKS)
def test_the_next_camera_is_the_best_of_all_tried(measurements, task):
    state, candidates = state_of(MESH, 3, task=task), around(MESH, 40)
    made, gain = with_next(measurements, state, "eye", candidates)
    before = covered_area(state)[1]
    gains = [covered_area(state.with_new("eye", pose))[1] - before for pose in candidates]
    assert len(made.stations) == 4
    assert gain == pytest.approx(covered_area(made)[1] - before)
    assert gain >= 0.99 * max(gains)  # the best by cells are compared by area
    assert task.min_pixels == 1 or gain == pytest.approx(max(gains))


@pytest.mark.slow
@pytest.mark.parametrize("views", [1, 2, 3])
@pytest.mark.parametrize("by_face", [{}, {"min_pixels": 4}])
def test_refinement_never_loses_and_the_others_stay(measurements, views, by_face):
    angle = 30.0 * (views > 1 and bool(by_face))
    state = state_of(MESH, 4, task=rc.Task(views=views, min_angle_deg=angle, **by_face))
    if views == 1:  # aside, so that there is something to gain
        aside = state.station(2).pose.copy()
        aside[:3, :3] = aside[:3, :3] @ [[0.96, 0, 0.28], [0, 1, 0], [-0.28, 0, 0.96]]
        state = state.with_pose(2, aside)
    made, gain = refined(measurements, state, 2, default_space(MESH, state), budget=250)
    gained = covered_area(made)[0] - covered_area(state)[0]
    assert gained >= 0
    assert (gain > 0) == (made is not state)
    assert views > 1 or 0 < gain == pytest.approx(gained)
    assert all(made.stations[row] is state.stations[row] for row in (0, 1, 3))


@pytest.mark.slow
def test_places_tried_are_allowed_and_look_at_what_is_not_covered(measurements):
    state = state_of(MESH, 2)
    space = default_space(MESH, state)
    poses = tries(measurements, state, "eye", space, count=60)
    assert space.allows(poses[:, :3, 3]).all()
    assert not in_solid(MESH, poses[:, :3, 3]).any()
    assert (NearestSurface(MESH).query(poses[:, :3, 3]).distance >= 0.05).all()
    found = rc.evaluate(MESH, CAMERA, poses, by="face")
    assert (found.reason == Reason.COVERED).any(axis=1).mean() > 0.3
    assert np.array_equal(poses, tries(measurements, state, "eye", space, count=60))


def test_nothing_is_left_to_cover(measurements):
    state, whole = state_of(MESH, 2), state_of(CUBE, 40)
    with pytest.raises(rc.ConfigError, match="covers more"):
        with_next(measurements, state, "eye", state.poses().world_from_camera)
    cube = Measurements(CUBE)
    with closing(cube), pytest.raises(rc.ConfigError, match="expected uncovered area, got none"):
        tries(cube, whole, "eye", default_space(CUBE, whole))


def test_a_cancelled_search_changes_nothing(measurements):
    state = state_of(MESH, 2)

    def cancel(done, total):
        if done:
            raise Cancelled

    with pytest.raises(Cancelled):
        with_next(measurements, state, "eye", around(MESH, 100), cancel)
    with pytest.raises(Cancelled):
        refined(measurements, state, 0, default_space(MESH, state), cancel)


WATCH_ROOM = Path(rc.__file__).parents[1] / "examples" / "plans" / "watch_room.toml"


@pytest.mark.slow
def test_cameras_placed_by_a_plan_are_those_of_place_and_cost_what_it_says(tmp_path):
    file = tmp_path / "plan.toml"  # few poses are tried
    file.write_text(WATCH_ROOM.read_text() + "refine_budget = 200\n")
    session = Session(open_plan(file))
    assert session.scene.placement["cameras"] == 6
    work = Work(session)
    work.start({"kind": "place", "cameras": 3})
    assert set(work.described()) >= {"seconds", "step_seconds"}
    assert finished(work)["status"] == "done"
    plan = session.scene.plan
    asked = plan.selection.model_copy(update={"cameras": 3})
    expected = place(plan.model_copy(update={"selection": asked}), None)
    poses = session.state.poses().world_from_camera
    np.testing.assert_array_equal(poses, expected.cameras.placed.world_from_camera)
    head, _ = acted(session)
    assert head["summary"]["cost"] == pytest.approx(expected.selection.cost)
    acted(session, do="undo")
    assert session.state is session.scene.start
    session.close()


def finished(work):
    work.wait(120)
    return work.described()


@pytest.fixture
def work():
    session = session_of(MESH, 2)
    yield Work(session)
    session.close()


@pytest.mark.slow
def test_work_becomes_one_step_of_the_history(work):
    session, before = work.session, work.session.state
    assert work.described() == {"id": None}
    work.start({"kind": "add", "camera": "eye"})
    said = finished(work)
    assert (said["status"], said["done"]) == ("done", said["total"])
    assert len(session.state.stations) == 3
    assert session.history.undo_label == "add the best next camera"
    acted(session, do="undo")
    assert session.state is before


@pytest.mark.slow
def test_work_that_was_overtaken_is_dropped(work, monkeypatch):
    session, goes_on, progress = work.session, threading.Event(), Work._progress
    monkeypatch.setattr(
        Work, "_progress", lambda self, *done: (progress(self, *done), goes_on.wait(20))
    )
    work.start({"kind": "add", "camera": "eye"})
    with pytest.raises(BusyError):
        work.start({"kind": "refine", "station": 0})
    pose = moved(session.state.station(0).pose, (0.01, 0, 0))
    acted(session, do="pose", station=0, pose=pose)  # the session answers meanwhile
    goes_on.set()
    said = finished(work)
    assert said["status"] == "failed"
    assert "edits meanwhile" in said["words"]
    assert len(session.state.stations) == 2


def test_work_can_be_cancelled(work):
    work.start({"kind": "add", "camera": "eye"})
    work.cancel()
    assert finished(work)["status"] == "cancelled"
    assert len(work.session.state.stations) == 2
    work.start({"kind": "place", "cameras": 1})  # without a plan
    assert finished(work)["status"] == "done"
    assert len(work.session.state.stations) == 1


@pytest.mark.parametrize(
    ("asked", "words"),
    [({"kind": "refine", "station": 9}, "got station 9"),
     ({"kind": "add", "camera": "none"}, "got camera 'none'"),
     *((bad, None) for bad in ({}, {"kind": "fly"}, {"kind": "refine"}, [],
                               {"kind": "refine", "station": "0"}))],
)  # fmt: skip
def test_work_that_does_not_exist_or_on_what_is_gone_is_said(work, asked, words):
    if words is None:
        with pytest.raises(rc.ConfigError, match="work"):
            work.start(asked)
        return
    work.start(asked)
    said = finished(work)
    assert said["status"] == "failed"
    assert words in said["words"]


@pytest.mark.slow
def test_a_camera_at_a_forbidden_place_is_refined_from_the_nearest_allowed_one(measurements):
    state = state_of(MESH, 3)
    low, high = np.asarray(MESH.bounds)
    space = PoseSpace(mesh=MESH, boxes=np.stack((np.add(low, (-1, -1, 0.5)), high + 1)))
    row = int(np.argmin([each.pose[2, 3] for each in state.stations]))
    assert not space.allows(state.stations[row].pose[None, :3, 3])[0]
    made, gain = refined(measurements, state, row, space, budget=200)
    assert gain <= 0 or space.allows(made.stations[row].pose[None, :3, 3])[0]
    assert covered_area(made) >= covered_area(state)
