import base64
import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rigs_to_view import CAMERA, acted, around, looking, moved, part, session_of, state_of

import rastercov as rc
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Rig
from rastercov.coverage.area.network import AreaNetwork
from rastercov.coverage.area.regions import regions
from rastercov.coverage.reasons import NO_CAMERAS
from rastercov.coverage.task import Reason
from rastercov.placement.candidates.segments import segment
from rastercov.reference.models import MODELS
from rastercov.report.modes import OCCLUDER_OF_REASONS
from rastercov.viewer import measurements
from rastercov.viewer.rig_state import RigState
from rastercov.viewer.scene import Scene, modes, task_fields
from rastercov.viewer.session import Session, StaleError

MESH = part()
POSES = around(MESH)


@pytest.fixture(scope="module")
def shared():
    """A session that tests may edit, and put back."""
    session = session_of(MESH)
    yield session
    session.close()


@pytest.fixture
def session(shared):
    while shared.history.undo_label:
        shared.history.undo()
    return shared


def covered_by(poses, task=None, camera=CAMERA):
    """Share of faces that a network covers, as the library says."""
    network = rc.Network(MESH, task or rc.Task())
    if len(poses):
        network.add(rc.evaluate(MESH, camera, poses, task))
    return network.summary()


def without_times(summary):
    return {k: v for k, v in summary.items() if k not in ("cpu_ms", "exact_area_percent")}


@pytest.mark.slow
@settings(max_examples=12)
@given(
    st.lists(st.integers(0, 3), min_size=1, max_size=4),
    st.floats(-0.3, 0.3), st.integers(1, 3), st.sampled_from([0.0, 40.0]),
    st.sampled_from([1.0, 20.0]), st.floats(10, 90),
)  # fmt: skip
def test_edits_give_what_the_library_says(rows, by, views, angle, pixels, incidence):
    session = session_of(MESH)
    task = {
        "views": views, "min_angle_deg": angle, "min_pixels": pixels,
        "max_incidence_deg": incidence,
    }  # fmt: skip
    poses = POSES.copy()
    for row in rows:
        poses[row, :3, 3] += by * np.array([0.1, 0.2, -0.1])
        acted(session, do="pose", station=row, pose=moved(poses[row]))
    head, _ = acted(session, do="task", changes=task)
    expected = covered_by(poses, rc.Task(**task))
    assert head["summary"]["covered"] == expected["covered"]
    assert head["summary"]["not_covered_because"] == expected["not_covered_because"]
    session.close()


def test_undo_restores_the_bytes(session):
    before_head, before = acted(session)
    acted(session, do="pose", station=0, pose=moved(POSES[0], (0, 0, 0.3)))
    acted(session, do="delete", station=1)
    acted(session, do="task", changes={"min_pixels": 30})
    for _ in range(3):
        head, levels = acted(session, do="undo")
    assert levels.tobytes() == before.tobytes()
    assert without_times(head["summary"]) == without_times(before_head["summary"])
    assert head["state"]["stations"] == before_head["state"]["stations"]


def test_only_the_camera_that_moved_is_measured(session, monkeypatch):
    acted(session)
    measured = []
    whole = session.measurements._measure
    monkeypatch.setattr(
        session.measurements,
        "_measure",
        lambda camera, task, poses: (measured.append(len(poses)), whole(camera, task, poses)),
    )
    acted(session, do="pose", station=2, pose=moved(POSES[2], (0.1, 0, 0)))
    acted(session, do="undo")
    acted(session, do="switch", station=1, is_on=False)
    acted(session, do="task", changes={"views": 2})
    assert measured == [1]


def test_reasons_are_those_of_a_network(session):
    head, levels = acted(session, "reason")
    network = rc.Network(MESH, rc.Task())
    network.add(rc.evaluate(MESH, CAMERA, POSES))
    assert np.array_equal(levels == Reason.COVERED, network.covered)
    assert np.array_equal(levels[~network.covered], network.reason[~network.covered])
    shown = {each["level"]: each["label"] for each in head["legend"]}
    assert set(shown) == set(np.unique(levels).tolist())


def test_levels_of_each_mode_are_those_of_its_figure(session):
    found = rc.evaluate(MESH, CAMERA, POSES)
    covers = found.reason == Reason.COVERED
    views = covers.sum(axis=0)
    _, levels = acted(session, "views")
    assert np.array_equal(levels, np.where(views > 0, 1 + views, 0))
    _, levels = acted(session, "camera")
    best = found.coverage.argmax(axis=0)
    assert np.array_equal(levels, np.where(views > 0, 2 + best, 0))
    head, levels = acted(session, "coverage")
    best = found.coverage.max(axis=0).astype(np.float32)
    assert np.array_equal(levels > 0, best > 0)
    assert (
        np.abs((levels[best > 0] - 2.0) / 253 - np.minimum(best[best > 0], 1)).max() <= 0.51 / 253
    )
    head, levels = acted(session, "density")
    density = np.where(covers, found.pixel_density, 0).max(axis=0)
    scale = head["scale"]
    at = (levels[density > 0] - 2.0) / 253
    value = scale["low"] * (scale["high"] / scale["low"]) ** at
    shown = np.clip(density[density > 0], scale["low"], scale["high"])
    beyond = MESH.areas[density > 0][shown != density[density > 0]].sum()
    assert beyond <= 0.041 * MESH.areas[density > 0].sum()
    assert np.abs(np.log(value / shown)).max() <= (
        0.51 / 253 * math.log(scale["high"] / scale["low"]) + 1e-6
    )
    head, levels = acted(session, "single", shown=2)
    one = found.coverage[2].astype(np.float32)
    assert np.array_equal(levels, np.where(one > 0, 2 + np.rint(np.minimum(one, 1) * 253), 0))


def test_angles_between_views_by_all_pairs(session):
    head, levels = acted(session, "angle")
    found = rc.evaluate(MESH, CAMERA, POSES)
    covers = found.reason == Reason.COVERED
    rays = POSES[:, None, :3, 3] - MESH.centroids
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    widest = np.zeros(MESH.n_faces)
    for a in range(4):
        for b in range(a):
            both = covers[a] & covers[b]
            angle = np.degrees(np.arccos(np.clip((rays[a] * rays[b]).sum(-1), -1, 1)))
            widest = np.maximum(widest, np.where(both, angle, 0))
    assert head["scale"]["high"] == pytest.approx(widest.max())
    steps = np.where(widest > 0, 2 + np.rint(widest / widest.max() * 253), 0)
    assert np.abs(steps - levels).max() <= 1


def test_exact_area_is_that_of_the_regions(session):
    head, levels = acted(session, "area")
    network = AreaNetwork(MESH, rc.Task())
    network.add(regions(MESH, CAMERA, POSES))
    assert head["summary"]["exact_area_percent"] == pytest.approx(network.summary()["percent"])
    share = network.covered.area[0] / MESH.areas
    assert np.array_equal(levels > 0, share > 0)
    head, _ = acted(session, do="delete", station=0)
    assert head["summary"]["exact_area_percent"] is None


def test_models_of_the_literature(session):
    for name, model in MODELS.items():
        _, levels = acted(session, "model", options={"model": name})
        best = model(MESH, CAMERA, POSES).max(axis=0)
        assert np.array_equal(levels > 0, best > 0)


def test_segments_are_those_of_the_thesis(session):
    for alpha, beta in ((20.0, 10.0), (60.0, 30.0)):
        options = {"alpha_deg": alpha, "beta_deg": beta}
        head, levels = acted(session, "segments", options=options)
        expected = segment(MESH, alpha, beta)
        assert np.array_equal(levels, np.where(expected.labels >= 0, 2 + expected.labels % 254, 0))
        assert f"{expected.n_segments:,} segment" in head["legend"][0]["label"]


def test_contributions_of_cameras(session):
    head, _ = acted(session, do="switch", station=3, is_on=False)
    covers = rc.evaluate(MESH, CAMERA, POSES[:3]).reason == Reason.COVERED
    total = MESH.areas.sum()
    for row, entry in enumerate(head["summary"]["by_camera"]):
        alone = covers[row] & (covers.sum(axis=0) == 1)
        assert entry["station"] == row
        assert entry["faces"] == covers[row].sum()
        assert entry["area_percent"] == pytest.approx(100 * MESH.areas[covers[row]].sum() / total)
        assert entry["alone_percent"] == pytest.approx(100 * MESH.areas[alone].sum() / total)


def test_why_a_face_is_hidden(session):
    found = rc.evaluate(MESH, CAMERA, POSES)
    hidden = np.argwhere(found.reason == Reason.OCCLUDED)
    row, face = hidden[len(hidden) // 2].tolist()
    said = session.why(face)
    entry = said["cameras"][row]
    assert entry["reason"] == "occluded"
    figures = {each["label"]: each["value"] for each in entry["figures"]}
    assert figures["visible part"].startswith(f"{100 * found.visibility[row, face]:.1f}")
    assert entry["help"]
    reasons = [rc.Reason(int(code)).name.lower() for code in found.reason[:, face]]
    assert [each["reason"] for each in said["cameras"]] == reasons


def test_why_names_the_group_in_the_way():
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    mesh = rc.Mesh(
        vertices=np.concatenate([square, square * 2 - 0.5 + [0, 0, 1]]),
        faces=[[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]],
        groups=[rc.Group("floor"), rc.Group("lid", is_occluder=True)],
        face_group=[0, 0, 1, 1],
    )
    state = RigState.of(
        Rig([CAMERA], ["eye"]), Poses.of(looking((0.5, 0.5, 4), (0.5, 0.5, 0))[None])
    )
    session = Session(Scene("lid", mesh, state))
    entry = session.why(0)["cameras"][0]
    assert entry["occluder"]["name"] == "lid"
    assert "hidden by lid" in entry["words"]
    assert session.why(2)["cameras"] == []
    head, levels = acted(session)
    assert levels[2] == levels[3] == OCCLUDER_OF_REASONS
    assert {each["label"]: each["percent"] for each in head["legend"]}["occluder"] is None


def test_dead_zones_are_those_of_the_area(session):
    zones = session.zones()
    network = AreaNetwork(MESH, rc.Task())
    network.add(regions(MESH, CAMERA, POSES))
    expected = network.dead_zones(CAMERA, POSES)["dead_zones"]
    assert [each["area"] for each in zones] == [each["area_m2"] for each in expected]
    assert all(each["faces"] for each in zones)


def test_every_mode_has_a_legend_whose_colours_are_of_the_palette(session):
    for mode in modes(session.scene.models):
        head, levels = acted(session, mode["id"])
        palette = np.frombuffer(base64.b64decode(head["palette"]), np.uint8).reshape(256, 3)
        for each in head["legend"]:
            assert palette[each["level"]].tolist() == each["colour"]
        shown = {each["level"] for each in head["legend"]}
        if head["scale"] is None and mode["id"] != "segments":
            assert shown == set(np.unique(levels).tolist())
        assert len(levels) == MESH.n_faces


def test_no_cameras_is_no_error(session):
    for station in range(4):
        head, levels = acted(session, do="delete", station=station)
    assert head["summary"]["covered"]["faces"] == 0
    assert (levels == NO_CAMERAS).all()
    for mode in ("coverage", "camera", "views", "density", "angle", "area"):
        acted(session, mode)
    assert session.why(0)["cameras"] == []


def test_a_stale_edit_is_refused_and_changes_nothing(session):
    acted(session, do="duplicate", station=0)
    revision = session.history.revision
    entries = {"revision": revision - 1, "mode": "reason", "action": {"do": "delete", "station": 0}}
    with pytest.raises(StaleError):
        session.act(entries)
    assert len(session.state.stations) == 5
    assert session.history.revision == revision


@pytest.mark.parametrize(
    ("action", "words"),
    [
        ({"do": "fly"}, "action"),
        ({}, "action"),
        ({"do": "pose", "station": 0, "pose": [1, 2]}, "pose"),
        ({"do": "pose", "station": 0, "pose": [math.nan] * 16}, "pose"),
        ({"do": "pose", "station": 0, "pose": [2.0] * 16}, "pose 0"),
        ({"do": "pose", "station": 77, "pose": POSES[0].ravel().tolist()}, "no station 77"),
        ({"do": "pose", "station": "0", "pose": POSES[0].ravel().tolist()}, "station"),
        ({"do": "camera", "camera": "eye", "changes": {"fx": -1}}, "fx"),
        ({"do": "camera", "camera": "eye", "changes": {"colour": 1}}, "colour"),
        ({"do": "camera", "camera": "no", "changes": {}}, "no camera"),
        ({"do": "task", "changes": {"min_visibility": 7}}, "min_visibility"),
        ({"do": "task", "changes": {"nothing": 7}}, "nothing"),
        ({"do": "new_camera", "name": "eye", "source": "khepra"}, "already"),
        ({"do": "new_camera", "name": "x", "source": "nope"}, "source"),
        ({"do": "constraints", "is_kept": True}, "no constraints"),
        ({"do": "aim", "station": 0, "point": POSES[0, :3, 3].tolist()}, "apart"),
        ({"do": "delete", "station": 0, "more": 1}, "more"),
    ],
)  # fmt: skip
def test_a_wrong_edit_is_one_line_and_changes_nothing(session, action, words):
    before = session.state
    entries = {"revision": session.history.revision, "mode": "reason", "action": action}
    with pytest.raises(rc.RastercovError, match=words) as error:
        session.act(entries)
    assert "\n" not in str(error.value)
    assert session.state is before


def test_aim_puts_the_point_into_the_middle(session):
    target = MESH.centroids[7]
    acted(session, do="aim", station=1, point=target.tolist())
    pose = session.state.station(1).pose
    seen = np.linalg.inv(pose) @ [*target, 1]
    assert np.abs(seen[:2]).max() < 1e-9 * seen[2]
    assert np.array_equal(pose[:3, 3], POSES[1, :3, 3])


def test_a_rig_that_was_kept_comes_back(session):
    acted(session, do="pose", station=0, pose=moved(POSES[0], (0.1, 0, 0)))
    acted(session, do="camera", camera="eye", changes={"fx": 350, "near": 0.01})
    head, kept = acted(session, do="task", changes={"min_pixels": 3})
    other = session_of(MESH)
    again, levels = acted(other, do="restore", rig=head["state"])
    assert levels.tobytes() == kept.tobytes()
    assert [s["pose"] for s in again["state"]["stations"]] == [
        s["pose"] for s in head["state"]["stations"]
    ]
    acted(other, do="undo")
    assert len(other.state.cameras) == 1
    other.close()


def test_sliders_have_the_limits_of_the_task():
    fields = {each["name"]: each for each in task_fields()}
    assert set(fields) == set(rc.Task.__dataclass_fields__)
    assert (fields["min_visibility"]["low"], fields["min_visibility"]["high"]) == (0.0, 1.0)
    assert fields["max_blur"]["is_optional"]
    assert fields["max_blur"]["kind"] == "float"
    assert fields["focus_rule"]["choices"] == ["vertices", "centroid"]
    assert fields["cap_resolution"]["kind"] == "bool"
    assert fields["views"]["kind"] == "int"


@pytest.mark.slow
def test_rows_are_forgotten_where_memory_runs_out(session, monkeypatch):
    monkeypatch.setattr(measurements, "MOST_BYTES", 12 * 10 * MESH.n_faces)
    for step in range(30):
        acted(session, do="pose", station=0, pose=moved(POSES[0], (step / 100, 0, 0)))
    assert len(session.measurements._rows) <= 12
    head, _ = acted(session)
    poses = POSES.copy()
    poses[0, :3, 3] += (0.29, 0, 0)
    assert head["summary"]["covered"] == covered_by(poses)["covered"]


def test_groups_that_need_several_cameras():
    mesh = rc.Mesh(
        vertices=MESH.vertices,
        faces=MESH.faces,
        groups=[rc.Group("upper"), rc.Group("lower")],
        face_group=(MESH.centroids[:, 2] < MESH.centroids[:, 2].mean()).astype(int),
    )
    start = state_of(mesh)
    state = RigState(start.stations, start.cameras, start.task, {"lower": 2})
    session = Session(Scene("groups", mesh, state))
    head, levels = acted(session)
    views = (rc.evaluate(mesh, CAMERA, POSES).reason == Reason.COVERED).sum(axis=0)
    covered = views >= 1 + mesh.face_group
    assert np.array_equal(levels == Reason.COVERED, covered)
    assert head["summary"]["covered"]["faces"] == covered.sum()
    head, levels = acted(session, "area")
    network = AreaNetwork(mesh, rc.Task(views=2))
    network.add(regions(mesh, CAMERA, POSES))
    expected = network.summary({"lower": 2})["percent"]
    assert head["summary"]["exact_area_percent"] == pytest.approx(expected)
    head, levels = acted(session, do="task", changes={"views": 3})
    assert np.array_equal(levels == Reason.COVERED, views >= 3)
    session.close()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("task", "words"),
    [({"min_pixels": 1e4}, " px: come"), ({"min_pixel_density": 1e5}, " px/m: come"),
     ({"min_facing_density": 1e5}, " px/m: come"),
     ({"max_incidence_deg": 5.0}, "towards its normal")],
)  # fmt: skip
def test_help_says_how_far_a_threshold_is_off(session, task, words):
    acted(session, do="task", changes=task)
    face = int(np.flatnonzero(acted(session)[1] == acted(session)[0]["legend"][0]["level"])[0])
    helps = [entry["help"] for entry in session.why(face)["cameras"]]
    assert any(words in text for text in helps), helps
    for text in helps:  # lengths grow with nearness, areas with its square
        if found := re.search(r"([\d.e+-]+) of ([\d.e+]+) px(/m)?: .*?([\d.e+]+) times", text):
            missing = float(found[2]) / float(found[1])
            wanted = missing if found[3] else math.sqrt(missing)
            assert float(found[4]) == pytest.approx(wanted, rel=0.06)


def test_the_state_is_told_while_something_is_measured(session):
    import threading

    told = threading.Event()
    with session.lock:  # as a measurement holds it, and as the first compilation does for minutes
        thread = threading.Thread(target=lambda: (session.described_state(), told.set()))
        thread.start()
        assert told.wait(10)
    thread.join()
