"""Work of the page: the best next camera, a better pose, cameras of a plan, each one step."""

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from edited import Saving, Session, Work
from rigs_to_view import CAMERA, acted, around, moved, part, session_of, state_of

import rastercov as rc
from rastercov.core.mesh import shapes
from rastercov.page.scene import Scene, open_plan
from rastercov.placement import NearestSurface, in_solid
from rastercov.placement.plan.file import read_plan
from rastercov.placement.plan.run import place

MESH = part()
CUBE = shapes.box()


def covered_area(state):
    """Area that `rc.evaluate` finds covered, summed over the required views, m^2."""
    poses, task = state.poses(), state.task
    result = rc.evaluate(MESH, CAMERA, poses, task, fields=())
    if result.areas is not None:
        return sum(each["m2"] for each in result.areas.summary()["by_views"])
    network = rc.Network(MESH, task)
    network.add(rc.evaluate(MESH, CAMERA, poses, task, by="face"))
    return float(np.minimum(network.views, task.views) @ MESH.areas)


def session_with(state, candidates=None):
    session = Session(Scene("part", MESH, state))
    if candidates is not None:
        session.more = {"candidates": {"eye": candidates.reshape(-1, 16).tolist()}}
    acted(session)
    return session


TASKS = [rc.Task(), rc.Task(views=2), rc.Task(min_pixels=4), rc.Task(views=2, min_pixels=4)]
"""By area and by face."""


@pytest.mark.slow
@pytest.mark.parametrize("task", TASKS)
def test_the_next_camera_is_the_best_of_all_tried(task):
    candidates = around(MESH, 12)
    with closing(session_with(state_of(MESH, 3, task=task), candidates)) as session:
        before, work = covered_area(session.state), Work(session)
        work.start({"kind": "add", "camera": "eye"})
        assert work.describe()["status"] == "done", work.describe()
        *_, added = session.state.stations
        gain = covered_area(session.state) - before
    assert any(np.array_equal(added.pose, pose) for pose in candidates)
    gains = [covered_area(state_of(MESH, 3, task=task, more=pose)) - before for pose in candidates]
    assert gain == pytest.approx(max(gains))


@pytest.mark.slow
@pytest.mark.parametrize("views", [1, 2])
@pytest.mark.parametrize("by_face", [{}, {"min_pixels": 4}])
def test_refinement_never_loses_and_the_others_stay(views, by_face):
    angle = 30.0 * (views > 1 and bool(by_face))
    state = state_of(MESH, 3, task=rc.Task(views=views, min_angle_deg=angle, **by_face))
    with closing(session_with(state)) as session:
        aside = state.stations[2].pose.copy()  # so that there is something to gain
        aside[:3, :3] = aside[:3, :3] @ [[0.96, 0, 0.28], [0, 1, 0], [-0.28, 0, 0.96]]
        acted(session, do="pose", station=2, pose=aside.ravel().tolist())
        before, work = session.state, Work(session)
        work.start({"kind": "refine", "station": 2})
        assert work.describe()["status"] == "done", work.describe()
        after = session.state
    gained = covered_area(after) - covered_area(before)
    assert gained >= 0
    assert views > 1 or gained > 0
    for one, other in zip(before.stations[:2], after.stations, strict=False):
        assert np.array_equal(one.pose, other.pose)


@pytest.mark.slow
def test_cameras_that_are_placed_are_outside_and_apart_from_surfaces():
    with closing(session_with(state_of(MESH, 0))) as session:
        work = Work(session)
        work.start({"kind": "place", "cameras": 2})
        assert work.describe()["status"] == "done", work.describe()
        eyes = session.state.eyes
    assert len(eyes) == 2
    assert not in_solid(MESH, eyes).any()
    assert (NearestSurface(MESH).query(eyes).distance >= 0.05 - 1e-9).all()


def test_nothing_is_left_to_cover():
    whole = Session(Scene("cube", CUBE, state_of(CUBE, 40)))
    with closing(whole), closing(session_with(state_of(MESH, 2), around(MESH, 2))) as session:
        for one, words in ((whole, "expected uncovered area"), (session, "poses tried covers")):
            acted(one)
            work = Work(one)
            work.start({"kind": "add", "camera": "eye"})
            assert words in work.describe()["words"]


WATCH_ROOM = Path(rc.__file__).parents[1] / "examples" / "plans" / "watch_room.toml"


@pytest.mark.slow
def test_cameras_placed_by_a_plan_are_those_of_place_and_cost_what_it_says(tmp_path):
    file = tmp_path / "plan.toml"  # few poses are tried
    file.write_text(WATCH_ROOM.read_text() + "refine_budget = 200\n")
    session = Session(open_plan(file))
    assert session.scene.placement["cameras"] == 6
    work = Work(session)
    work.start({"kind": "place", "cameras": 3})
    assert work.describe()["status"] == "done", work.describe()
    plan = session.scene.plan
    asked = plan.selection.model_copy(update={"cameras": 3})
    expected = place(plan.model_copy(update={"selection": asked}), None)
    poses = session.state.poses().world_from_camera
    np.testing.assert_array_equal(poses, expected.cameras.placed.world_from_camera)
    head, _ = acted(session)
    assert head["summary"]["cost"] == pytest.approx(expected.selection.cost)
    acted(session, do="undo")
    assert not session.state.stations
    session.work.start({"cameras": 3})  # as by a page that was closed meanwhile
    work.start({"isResumed": True})
    assert work.describe()["status"] == "done", work.describe()
    np.testing.assert_array_equal(session.state.poses().world_from_camera, poses)
    session.close()


@pytest.fixture
def work():
    session = session_of(MESH, 2)
    session.more = {"candidates": {"eye": around(MESH, 6).reshape(-1, 16).tolist()}}
    acted(session)
    yield Work(session)
    session.close()


def test_work_becomes_one_step_of_the_history(work):
    session = work.session
    work.start({"kind": "add", "camera": "eye"})
    said = work.describe()
    assert (said["status"], said["done"]) == ("done", said["total"])
    assert len(session.state.stations) == 3
    assert session.history.undo_label == "add the best next camera"
    acted(session, do="undo")
    assert len(session.state.stations) == 2
    assert not session.history.can_undo


def test_work_that_was_overtaken_is_dropped(work):
    pose = moved(work.session.state.stations[0].pose, (0.01, 0, 0))
    work.start({"kind": "add", "camera": "eye"}, edit={"do": "pose", "station": 0, "pose": pose})
    said = work.describe()
    assert said["status"] == "failed"
    assert "edited meanwhile" in said["words"]
    assert len(work.session.state.stations) == 2


def test_work_can_be_cancelled(work):
    work.start({"kind": "add", "camera": "eye"}, isCancelled=True)
    assert work.describe()["status"] == "cancelled"
    assert len(work.session.state.stations) == 2
    work.start({"kind": "place", "cameras": 1})  # without a plan
    assert work.describe()["status"] == "done"
    assert len(work.session.state.stations) == 1


@pytest.mark.parametrize(
    ("asked", "words"),
    [({"kind": "refine", "station": 9}, "no camera 9"),
     ({"kind": "add", "camera": "none"}, "no camera none"),
     ({"kind": "refine"}, "no camera undefined"), ({"kind": "fly"}, None), ({}, None)],
)  # fmt: skip
def test_work_that_does_not_exist_or_on_what_is_gone_is_said(work, asked, words):
    if words is None:
        with pytest.raises(rc.ConfigError, match="not available"):
            work.start(asked)
        return
    work.start(asked)
    said = work.describe()
    assert said["status"] == "failed"
    assert words in said["words"]


BOXED = """
meshes = [{ built_in = "teapot-5" }]
[camera]
width = 320
height = 240
fx = 300.0
fy = 300.0
[constraints]
clearance = 0.01
[[constraints.spaces]]
low = [-2.0, -2.0, 0.2]
high = [2.0, 2.0, 2.0]
"""


@pytest.mark.slow
def test_a_camera_at_a_forbidden_place_is_refined_from_the_nearest_allowed_one(tmp_path):
    (tmp_path / "plan.toml").write_text(BOXED)
    with closing(Session(open_plan(tmp_path / "plan.toml"))) as session:
        acted(session, do="constraints", is_kept=False)
        pose = rc.look_at((0.6, 0.3, 0.1), np.asarray(MESH.bounds).mean(axis=0))[0]
        acted(session, do="add", camera="camera", pose=pose.ravel().tolist())
        space = session.scene.space(session.state)
        assert not space.allows(session.state.eyes)[0]
        before, work = covered_area(session.state), Work(session)
        work.start({"kind": "refine", "station": 0})
        said = work.describe()
        assert said["status"] == "done", said
        if "no better" not in said["words"]:
            assert space.allows(session.state.eyes)[0]
        assert covered_area(session.state) >= before


HEADS = """
meshes = [{ built_in = "teapot-5" }]
[cameras.eye]
width = 320
height = 240
fx = 300.0
fy = 300.0
[rigs.head]
rule = "all"
[[rigs.head.cameras]]
camera = "eye"
name = "a"
[[rigs.head.cameras]]
camera = "eye"
name = "b"
translation = [0.5, 0, 0]
[[constraints.spaces]]
low = [-0.1, -0.1, 0.6]
high = [0.1, 0.1, 0.9]
[[candidates]]
generator = "on_sphere"
count = 9
"""


def test_constraints_apply_to_the_place_of_a_rig(tmp_path):
    (tmp_path / "plan.toml").write_text(HEADS)
    plan = read_plan(tmp_path / "plan.toml")
    for at, words in ((0.0, "allowed"), (0.5, "outside the mounting boxes")):
        pose = rc.look_at((at, 0, 0.7), (at, 0, 0), up=(0, 1, 0))
        poses = plan.rig.poses(pose)[1:]
        views = rc.Views(plan.rig, poses, ("a", "b"))
        with closing(Session(open_plan(tmp_path / "plan.toml", views))) as session:
            assert session.scene.places(session.state) == [words, words]


def test_a_saved_rig_says_that_cameras_are_off(tmp_path):
    with closing(session_of()) as session:
        acted(session)
        assert "off here" not in Saving(session, tmp_path).save({"what": "rig"})["words"]
        acted(session, do="switch", station=1, is_on=False)
        assert "are off here, too (1)" in Saving(session, tmp_path).save({"what": "rig"})["words"]
