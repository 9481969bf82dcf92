"""A session of bodies that move: figures are those of the frame, or joints, that are shown."""

from dataclasses import replace

import numpy as np
import pytest
from edited import Session, Work
from moving_scene import CAMERA, POSES, STEPS, TASK, by_hand, moving_scene
from rigs_to_view import moved
from timed import evaluate_over_time

import rastercov as rc
from rastercov.base.errors import ConfigError
from rastercov.page.saving import export_state
from rastercov.page.session import remove_head
from rastercov.report.modes import MODES


@pytest.fixture
def cell(tmp_path):
    session = Session(moving_scene(tmp_path))
    yield session
    session.close()


def acted(session, at, mode="reason", **action):
    request = {
        "revision": session.history.revision, "mode": mode, "at": at,
        "action": action or {"do": "none"},
    }  # fmt: skip
    head, levels = remove_head(session.act(request))
    return head, np.frombuffer(levels, np.uint8)


def assert_figures(head, levels, mesh, poses):
    result = rc.evaluate(mesh, CAMERA, poses, TASK, by="face")
    network = rc.Network(mesh, TASK)
    network.add(result)
    assert head["summary"]["covered"] == pytest.approx(network.summary()["covered"])
    scored = mesh.task_mask
    assert np.array_equal((levels == rc.Reason.COVERED)[scored], network.covered[scored])
    shown = [np.reshape(each["pose"], (4, 4)) for each in head["state"]["stations"]]
    assert np.allclose(shown, poses, atol=1e-12)


def test_figures_of_a_time_are_those_of_the_mesh_moved_by_hand(cell):
    session = cell
    for frame in (4, 0, 2):
        head, levels = acted(session, [frame])
        assert_figures(head, levels, *by_hand(frame))
        assert "bodies" not in head
    mesh, poses = by_hand(2)
    exact = rc.unite(rc.regions(mesh, CAMERA, poses, TASK)).share()
    assert session.areas().summary()["percent"] == pytest.approx(100 * exact, abs=1e-6)
    face = int(np.flatnonzero(levels != rc.Reason.COVERED)[0])
    assert session.why(face)["centre"] == pytest.approx(mesh.centroids[face].tolist())


def test_the_share_of_time_is_that_of_the_report(cell):
    session = cell
    motion, rig = session.scene.phases.motion, session.state.rig()
    for station in (None, 1):  # with both cameras, and without the one that is carried
        rows = [0, 1]
        if station is not None:
            acted(session, [1], do="switch", station=station, is_on=False)
            rows = [0]
        poses, body = rc.Poses.of(POSES[rows], camera=rows), ["world", "head"]
        result = evaluate_over_time(motion, rig, poses, TASK, body=body)
        painted = MODES["time"].paint(motion.mesh, result.share_of_time())
        for frame in (0, 3):
            head, levels = acted(session, [frame], "time")
            assert np.array_equal(levels, painted.levels)
            assert (head["legend"], head["scale"]) == (painted.legend, painted.scale)
    assert "time" in [each["id"] for each in session.describe()["modes"]]


def test_a_scene_that_is_still_has_no_share_of_time(cell):
    scene = replace(cell.scene, phases=None)
    assert "time" not in scene.modes
    still = Session(scene)
    with pytest.raises(ConfigError, match="expected a scene of several phases"):
        acted(still, [], "time")
    still.close()


def test_a_camera_that_is_moved_at_a_time_is_carried_from_there(cell):
    session = cell
    acted(session, [3])
    for station in (0, 1):
        pose = by_hand(3)[1][station]
        wanted = moved(pose, (0.02, 0.01, 0.03))
        head, _ = acted(session, [3], do="pose", station=station, pose=wanted)
        assert head["state"]["stations"][station]["pose"] == pytest.approx(wanted)
        back, _ = acted(session, [3], do="undo")
        assert back["state"]["stations"][station]["pose"] == pytest.approx(pose.ravel().tolist())
    carried = by_hand(3)[1][1]
    acted(session, [3], do="pose", station=1, pose=moved(carried, (0, 0, 0.1)))
    head, _ = acted(session, [0])
    rest = by_hand(3)[1][1] @ np.linalg.inv(by_hand(0)[1][1])
    expected = np.linalg.inv(rest) @ np.reshape(moved(carried, (0, 0, 0.1)), (4, 4))
    assert np.allclose(np.reshape(head["state"]["stations"][1]["pose"], (4, 4)), expected)
    kept = (each.stations[0].pose for each in (session.state, session.scene.start))
    assert np.array_equal(*kept)


def test_times_that_are_none_are_refused_and_change_nothing(cell):
    session = cell
    for at in ([STEPS], [0.5], [-1], [None]):
        with pytest.raises(ConfigError) as caught:
            acted(session, at)
        assert str(caught.value).isprintable()
        assert session.at == (0.0,)


def test_a_face_of_a_body_that_is_away_has_no_reason(cell):
    session = cell
    motion = session.scene.phases.motion
    there = motion.present.copy()
    link = motion.names.index("arm")
    there[2, link] = False
    object.__setattr__(motion, "present", there)
    head, levels = acted(session, [2])
    away = np.flatnonzero(motion.body == link)
    assert len(levels) == motion.mesh.n_faces
    with pytest.raises(ConfigError, match="absent body"):
        session.why(int(away[0]))
    after = int(away[-1]) + 1
    assert session.why(after)["area"] == pytest.approx(float(motion.mesh.areas[after]))
    occluders = ~motion.mesh.task_mask
    occluders[away] = False
    assert len(set(levels[occluders].tolist())) == 1
    assert levels[away].max() == 0
    assert head["summary"]["covered"]["faces"] > 0


def test_work_is_of_the_time_that_is_shown(cell):
    session = cell
    before, _ = acted(session, [4])
    work = Work(session)
    work.start({"kind": "add", "camera": "carried"})
    work.wait()
    assert work.describe()["status"] == "done", work.describe()
    head, levels = acted(session, [4])
    shown = np.reshape([each["pose"] for each in head["state"]["stations"]], (-1, 4, 4))
    areas = [each["summary"]["covered_area"]["m2"] for each in (before, head)]
    gain = float(work.describe()["words"].split(": ")[1].split()[0].replace(",", ""))
    assert 1e4 * (areas[1] - areas[0]) == pytest.approx(gain, rel=0.01)  # cm2
    assert gain > 0
    mesh, (fixed, carried) = by_hand(4)
    assert_figures(head, levels, mesh, shown)
    assert np.allclose(shown[:2], [fixed, carried])
    world_from_head = carried @ np.linalg.inv(by_hand(0)[1][1])
    assert np.allclose(world_from_head @ session.state.stations[2].pose, shown[2])


def test_measured_times_are_kept(cell):
    session = cell
    first = [acted(session, [frame]) for frame in range(3)]
    moments = dict(session._moments)
    for frame, (head, levels) in enumerate(first):
        again, same = acted(session, [frame])
        assert np.array_equal(levels, same)
        assert head["summary"] == again["summary"]
    assert dict(session._moments) == moments


def test_an_exported_page_has_the_frames(cell):
    session = cell
    page = export_state(session, session.state)
    assert page.count('"reason@') == STEPS
    assert session.at == (0.0,)
