import base64
import math
import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
from edited import Saving, Session
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples
from rigs_to_view import CAMERA, acted, around, looking, moved, part, session_of, state_of

import rastercov as rc
from rastercov.core.area.network import AreaNetwork
from rastercov.core.camera.pose import Poses
from rastercov.core.camera.rig import Rig
from rastercov.core.coverage.evaluation import regions
from rastercov.core.coverage.task import DORI, NEEDED, NO_CAMERAS, OF_SURFACE, Reason
from rastercov.page import measurements
from rastercov.page.rig_state import RigState
from rastercov.page.scene import Scene, task_fields
from rastercov.page.session import remove_head
from rastercov.placement.candidates.segments import segment
from rastercov.report.live import BY_FACE
from rastercov.report.modes import MODES, OCCLUDER_OF_REASONS

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
    shared.call("load")
    while shared.history.can_undo:
        acted(shared, do="undo")
    return shared


def covered_by(poses, task=None, camera=CAMERA):
    """Share of faces that a network covers, as the library says."""
    network = rc.Network(MESH, task or rc.Task())
    if len(poses):
        network.add(rc.evaluate(MESH, camera, poses, task, by="face"))
    return network.summary()


@pytest.mark.slow
@examples(4, at_night=12)
@given(
    st.lists(st.integers(0, 3), min_size=1, max_size=4), st.floats(-0.3, 0.3),
    st.fixed_dictionaries({
        "views": st.integers(1, 3), "min_angle_deg": st.sampled_from([0.0, 40.0]),
        "min_pixels": st.sampled_from([1.0, 20.0]), "max_incidence_deg": st.floats(10, 90),
    }),
)  # fmt: skip
def test_edits_give_what_the_library_says(rows, by, task):
    session, poses = session_of(MESH), POSES.copy()
    for row in rows:
        poses[row, :3, 3] += by * np.array([0.1, 0.2, -0.1])
        acted(session, do="pose", station=row, pose=moved(poses[row]))
    head, _ = acted(session, do="task", changes=task)
    expected = covered_by(poses, rc.Task(**task))
    assert head["summary"]["covered"] == expected["covered"]
    session.close()


def test_only_the_camera_that_moved_is_measured(session, monkeypatch):
    acted(session)
    measure = Mock(side_effect=session.measurements._measure)
    monkeypatch.setattr(session.measurements, "_measure", measure)
    acted(session, do="pose", station=2, pose=moved(POSES[2], (0.1, 0, 0)))
    acted(session, do="undo")
    acted(session, do="switch", station=1, is_on=False)
    acted(session, do="task", changes={"views": 2})
    assert [len(call.args[2]) for call in measure.call_args_list] == [1]


def test_reasons_are_those_of_a_network(session):
    head, levels = acted(session, "reason")
    network = rc.Network(MESH, rc.Task())
    network.add(rc.evaluate(MESH, CAMERA, POSES, by="face"))
    assert np.array_equal(levels == Reason.COVERED, network.covered)
    assert np.array_equal(levels[~network.covered], network.reason[~network.covered])
    shown = {each["level"]: each["label"] for each in head["legend"]}
    assert set(shown) == set(np.unique(levels).tolist())


def test_levels_of_each_mode_are_those_of_its_figure(session):
    result = rc.evaluate(MESH, CAMERA, POSES, by="face")
    covers = result.reason == Reason.COVERED
    views = covers.sum(axis=0)
    best = result.coverage.max(axis=0)
    for mode, values in (
        ("views", np.where(views > 0, 1 + views, 0)),
        ("camera", np.where(views > 0, 2 + result.coverage.argmax(axis=0), 0)),
        ("coverage", steps_of(best)),
        ("single", steps_of(result.coverage[2])),
        ("level", np.where(views > 0, 6, 0)),  # all of them nearer than 1.2 m
    ):
        _, levels = acted(session, mode, shown=2)
        np.testing.assert_array_equal(levels, values, err_msg=mode)
    head, levels = acted(session, "density")
    density = np.where(covers, result.pixel_density, 0).max(axis=0)
    is_seen, (low, high) = density > 0, (head["scale"]["low"], head["scale"]["high"])
    value = low * (high / low) ** ((levels[is_seen] - 2.0) / 253)
    shown = np.clip(density[is_seen], low, high)
    beyond = MESH.areas[is_seen][shown != density[is_seen]].sum()
    assert beyond <= 0.041 * MESH.areas[is_seen].sum()
    assert np.abs(np.log(value / shown)).max() <= 0.51 / 253 * math.log(high / low) + 1e-6


def test_levels_of_densities_are_those_of_the_standard():
    density = np.exp(np.random.default_rng(3).uniform(0, 7, MESH.n_faces))
    density[:4] = list(DORI.values())
    painted = MODES["level"].paint(MESH, density)
    words = {each["level"]: each["label"] for each in painted.legend}
    for value, level in zip(density, painted.levels, strict=True):
        reached = [name for name, least in DORI.items() if value >= least]
        assert words[level].startswith(reached[-1] if reached else "below detect")
    assert [each["level"] for each in painted.legend] == [6, 5, 4, 3, 2]


def steps_of(values):
    """Levels of a scale from 0 to 1."""
    values = np.minimum(values.astype(np.float32), 1)
    return np.where(values > 0, 2 + np.rint(values * 253), 0)


def test_angles_between_views_by_all_pairs(session):
    head, levels = acted(session, "angle")
    covers = rc.evaluate(MESH, CAMERA, POSES, by="face").reason == Reason.COVERED
    rays = POSES[:, None, :3, 3] - MESH.centroids
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    cosines = np.where(covers[:, None] & covers, np.einsum("afi,bfi->abf", rays, rays), 1)
    widest = np.degrees(np.arccos(np.clip(cosines, -1, 1 - 1e-15).min(axis=(0, 1))))
    widest[covers.sum(axis=0) < 2] = 0
    assert head["scale"]["high"] == pytest.approx(widest.max())
    steps = np.where(widest > 0, 2 + np.rint(widest / widest.max() * 253), 0)
    assert np.abs(steps - levels).max() <= 1


def test_exact_area_is_that_of_the_regions(session):
    head, levels = acted(session, "area")
    network = AreaNetwork(MESH, rc.Task())
    network.add(regions(MESH, CAMERA, POSES))
    assert head["summary"]["covered_area"]["percent"] == pytest.approx(network.summary()["percent"])
    share = network.covered.area[0] / MESH.areas
    assert np.array_equal(levels > 0, share > 0)


def test_segments_are_those_of_the_thesis(session):
    for alpha, beta in ((20.0, 10.0), (60.0, 30.0)):
        options = {"alpha_deg": alpha, "beta_deg": beta}
        head, levels = acted(session, "segments", options=options)
        expected = segment(MESH, alpha, beta)
        assert np.array_equal(levels, np.where(expected.labels >= 0, 2 + expected.labels % 254, 0))
        assert f"{expected.n_segments:,} segment" in head["legend"][0]["label"]


def of_evaluate(state, task):
    """Figures of `rc.evaluate` by default of the stations that are on; None without any."""
    rig, poses = state.whole, state.cameras_that_count()[0]
    if not len(poses):
        return None
    result = rc.evaluate(MESH, rig, poses, task, fields=())
    said = {"covered": result.network.summary()["covered"]}
    said |= {} if result.areas is None else {"covered_area": result.areas.summary()}
    return said | {"by_face_because": result.by_face_because}


THRESHOLDS = st.fixed_dictionaries({
    "views": st.integers(1, 3), "max_incidence_deg": st.floats(20, 90),
    "min_pixels_per_m2": st.sampled_from([0.0, 1e5]),
    "min_pixels": st.sampled_from([1.0, 1.0, 9.0]),
    "min_angle_deg": st.sampled_from([0.0, 0.0, 30.0]),
})  # fmt: skip


OFF = st.lists(st.integers(0, 3), max_size=3, unique=True)


@examples(3, at_night=100)
@given(THRESHOLDS, OFF)
def test_headline_and_shares_are_those_of_evaluate(thresholds, off):
    """Shares by leaving each out."""
    assert_headline(thresholds, off, Rig([CAMERA], ["eye"]))


@examples(3, at_night=100)
@given(THRESHOLDS, OFF)
def test_headline_of_heads_is_that_of_evaluate(thresholds, off):
    """With a rule, cameras count where all of their rig are on."""
    if not thresholds["min_angle_deg"] and thresholds["min_pixels"] <= 1:  # refused by evaluate
        assert_headline(thresholds, off, Rig([CAMERA, CAMERA], ["left", "right"], rule=rc.All()))


def assert_headline(thresholds, off, rig):
    is_head = len(rig) > 1
    task, poses = rc.Task(**thresholds), Poses.of(POSES, camera=[0, 1] * 2 if is_head else None)
    session = Session(Scene("part", MESH, RigState.of(rig, poses, task=task)))
    for station in off:
        acted(session, do="switch", station=station, is_on=False)
    said, state = acted(session)[0]["summary"], session.state
    session.close()
    if (expected := of_evaluate(state, task)) is None:
        return
    because = expected["by_face_because"] if not is_head else ""
    assert said["by_face_because"] == because.partition(";")[0]
    assert ("covered_area" in said) == ("covered_area" in expected)
    if "covered_area" not in said:
        assert said["covered"] == expected["covered"]
        return
    whole = expected["covered_area"]
    for name in ("percent", "bound_percent", "m2"):
        assert said["covered_area"][name] == pytest.approx(whole[name], rel=1e-9, abs=1e-12)
    for entry in said["by_camera"]:
        others = tuple(each for each in state.stations if each.id != entry["station"])
        rest = of_evaluate(replace(state, stations=others), task)
        left = 0.0 if rest is None else rest["covered_area"]["percent"]
        assert entry["alone_percent"] == pytest.approx(whole["percent"] - left, abs=1e-6)
        if not is_head:
            only = replace(state, stations=(state.station(entry["station"]),))
            own = of_evaluate(only, replace(task, views=1))
            assert entry["area_percent"] == pytest.approx(own["covered_area"]["percent"], abs=1e-9)


def test_a_drag_of_many_pairs_is_by_whole_faces_until_it_ends(session, monkeypatch):
    monkeypatch.setattr("rastercov.page.session.LIVE_PAIRS", MESH.n_faces)
    pose = moved(POSES[0], (0.01, 0, 0))
    head, _ = acted(session, do="pose", station=0, pose=pose, drag=True)
    assert head["summary"]["by_face_because"] == "exact when no camera moves"
    assert "covered_area" not in head["summary"]
    for action in ({"do": "none"}, {"do": "pose", "station": 0, "pose": pose}):
        exact = acted(session, **action)[0]["summary"]["covered_area"]
        whole = of_evaluate(session.state, rc.Task())["covered_area"]
        assert exact["percent"] == pytest.approx(whole["percent"], abs=1e-9)


def test_regions_that_do_not_fit_leave_out_what_is_lost_alone(session, monkeypatch):
    before = acted(session)[0]["summary"]
    monkeypatch.setattr(measurements, "MOST_PAIRS", 2 * MESH.n_faces)
    acted(session, do="pose", station=0, pose=moved(POSES[0], (0.01, 0, 0)))
    acted(session, do="pose", station=0, pose=POSES[0].ravel().tolist())
    after = acted(session)[0]["summary"]
    assert after["covered_area"] == before["covered_area"]
    for one, other in zip(before["by_camera"], after["by_camera"], strict=True):
        assert other == one | {"alone_percent": None}


def test_why_a_face_is_hidden(session):
    result = rc.evaluate(MESH, CAMERA, POSES, by="face")
    hidden = np.argwhere(result.reason == Reason.OCCLUDED)
    row, face = hidden[len(hidden) // 2].tolist()
    cameras = session.why(face)["cameras"]
    figures = {each["label"]: each["value"] for each in cameras[row]["figures"]}
    visible = float(figures["visible fraction"].split()[0])
    assert visible == pytest.approx(100 * result.visibility[row, face], abs=0.06)
    assert cameras[row]["help"]
    reasons = [Reason(int(code)).name.lower() for code in result.reason[:, face]]
    assert [each["reason"] for each in cameras] == reasons


def test_why_names_the_group_in_the_way():
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    mesh = rc.Mesh(
        np.concatenate([square, square * 2 - 0.5 + [0, 0, 1]]),
        [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]],
        [rc.Group("floor"), rc.Group("lid", is_occluder=True)],
        [0, 0, 1, 1],
    )
    poses = Poses.of(looking((0.5, 0.5, 4), (0.5, 0.5, 0))[None])
    session = Session(Scene("lid", mesh, RigState.of(Rig([CAMERA], ["eye"]), poses)))
    (entry,) = session.why(0)["cameras"]
    assert entry["occluder"]["name"] == "lid"
    assert "occluded by lid" in entry["words"]
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
    for mode in session.describe()["modes"]:
        head, levels = acted(session, mode["id"])
        palette = np.frombuffer(base64.b64decode(head["palette"]), np.uint8).reshape(256, 3)
        for each in head["legend"]:
            assert palette[each["level"]].tolist() == each["colour"]
        shown = {each["level"] for each in head["legend"]}
        if head["scale"] is None and mode["id"] != "segments":
            assert shown == set(np.unique(levels).tolist())
        assert len(levels) == MESH.n_faces


def test_the_incidence_is_the_least_of_a_camera_that_covers_the_face(session):
    head, levels = acted(session, "incidence")
    result = rc.evaluate(MESH, CAMERA, POSES, by="face", fields=("reason", "incidence"))
    angle = np.where(result.reason == rc.Reason.COVERED, result.incidence, np.inf).min(axis=0)
    is_seen = np.isfinite(angle)
    assert 0 < is_seen.sum() < MESH.n_faces
    assert (levels[~is_seen] < 2).all()
    share = np.degrees(angle[is_seen]) / 90
    assert np.abs(levels[is_seen] - 2.0 - 253 * share).max() <= 0.5 + 1e-6
    assert (head["scale"]["low"], head["scale"]["high"]) == (0, 90)


def test_no_cameras_is_no_error(session):
    for station in range(4):
        head, levels = acted(session, do="delete", station=station)
    assert head["summary"]["covered"]["faces"] == 0
    assert (levels == NO_CAMERAS).all()
    assert session.why(0)["cameras"] == []
    for mode in ("coverage", "camera", "views", "density", "angle", "area"):
        acted(session, mode)


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
    assert again["state"]["stations"] == head["state"]["stations"]
    acted(other, do="undo")
    assert len(other.state.cameras) == 1
    other.close()


def test_variants_keep_a_rig_with_its_figures(session):
    head, first = acted(session)
    acted(session, do="keep_variant", name="A")
    acted(session, do="delete", station=2)
    changed, second = acted(session, do="task", changes={"min_pixels": 2})
    acted(session, do="keep_variant", name="B")
    state = session.described_state()
    shown = [[each[k] for k in ("name", "cameras", "is_shown", "is_of_task")]
             for each in state["variants"]]  # fmt: skip
    assert shown == [["A", 4, False, False], ["B", 3, True, True]]
    percents = [each["summary"]["covered"]["area_percent"] for each in (head, changed)]
    assert [each["covered"]["area_percent"] for each in state["variants"]] == percents
    for name, levels in (("A", first), ("B", second)):
        assert np.array_equal(acted(session, do="show_variant", name=name)[1], levels)
    acted(session, do="drop_variant", name="A")
    with pytest.raises(rc.ConfigError, match="a saved variant, got 'A'"):
        acted(session, do="show_variant", name="A")
    acted(session, do="undo")  # the rig of A is in the history
    assert np.array_equal(acted(session)[1], first)


def test_pieces_are_what_is_not_covered_of_each_face(session):
    head, payload = remove_head(session.pieces())
    numbers = np.frombuffer(payload, np.uint32)
    n = int(numbers[0])
    faces, reasons, counts = numbers[1 : 3 * n + 1].reshape(3, n)
    corners = np.split(np.frombuffer(payload[4 + 12 * n :], np.float32).reshape(-1, 3),
                       np.cumsum(counts)[:-1])  # fmt: skip
    sizes = [
        np.linalg.norm(np.cross(c[1:-1] - c[0], c[2:] - c[0]).sum(axis=0)) / 2 for c in corners
    ]
    dead = np.bincount(faces, sizes, MESH.n_faces)
    network = session.areas().network
    np.testing.assert_allclose(
        dead, MESH.areas - network.covered.area[0], atol=1e-5 * MESH.areas.max()
    )
    assert head == {}
    assert np.array_equal(reasons, session.areas().zones.reason)
    acted(session, do="task", changes={"min_pixels": 9})
    assert "min_pixels applies to faces" in remove_head(session.pieces())[0]["fault"]


def test_sliders_have_the_limits_of_the_task():
    fields = {each["name"]: each for each in task_fields()}
    known = rc.Task.__dataclass_fields__.keys() - NEEDED
    assert set(fields) == known - {*OF_SURFACE, *BY_FACE}  # of a page without a program
    fields = {each["name"]: each for each in task_fields(Rig([CAMERA], ["eye"]))}
    assert set(fields) == known
    assert (fields["min_visibility"]["low"], fields["min_visibility"]["high"]) == (0.0, 1.0)
    assert fields["max_blur"]["is_optional"]
    assert fields["focus_rule"]["choices"] == ("vertices", "centroid")
    kinds = [fields[name]["kind"] for name in ("max_blur", "cap_resolution", "views")]
    assert kinds == ["float", "bool", "int"]


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
    is_lower = MESH.centroids[:, 2] < MESH.centroids[:, 2].mean()
    groups = [rc.Group("upper"), rc.Group("lower")]
    mesh = rc.Mesh(MESH.vertices, MESH.faces, groups, is_lower.astype(int))
    start = state_of(mesh)
    state = replace(start, needed={"lower": 2})
    session = Session(Scene("groups", mesh, state))
    head, levels = acted(session)
    views = (rc.evaluate(mesh, CAMERA, POSES, by="face").reason == Reason.COVERED).sum(axis=0)
    covered = views >= 1 + is_lower
    assert np.array_equal(levels == Reason.COVERED, covered)
    assert head["summary"]["covered"]["faces"] == covered.sum()
    network = AreaNetwork(mesh, rc.Task(views=2))
    network.add(regions(mesh, CAMERA, POSES))
    percent = network.summary({"lower": 2})["percent"]
    assert acted(session, "area")[0]["summary"]["covered_area"]["percent"] == pytest.approx(percent)
    _, levels = acted(session, do="task", changes={"views": 3})
    assert np.array_equal(levels == Reason.COVERED, views >= 3)
    session.close()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("task", "words"),
    [({"min_pixels": 1e4}, " px needs"), ({"min_pixel_density": 1e5}, " px/mm needs"),
     ({"min_facing_density": 1e5}, " px/mm needs"),
     ({"max_incidence_deg": 5.0}, "closer to the face normal")],
)  # fmt: skip
def test_help_says_how_far_a_threshold_is_off(session, task, words):
    acted(session, do="task", changes=task)
    face = int(np.flatnonzero(acted(session)[1] == acted(session)[0]["legend"][0]["level"])[0])
    helps = [entry["help"] for entry in session.why(face)["cameras"]]
    assert any(words in text for text in helps), helps
    advice = r"(\S+) (\S+) at (\S+) (mm|m); (\S+) (\S+) needs (\S+) (mm|m)"
    for text in helps:  # lengths grow with nearness, areas with its square
        if result := re.search(advice, text):
            best, unit, place, length, needs, needs_unit, near, near_length = result.groups()
            scale = {"px": 1.0, "px/m": 1.0, "px/mm": 1e3, "m": 1.0, "mm": 1e-3}
            missing = float(needs) * scale[needs_unit] / (float(best) * scale[unit])
            wanted = math.sqrt(missing) if unit == "px" else missing
            nearness = float(place) * scale[length] / (float(near) * scale[near_length])
            assert nearness == pytest.approx(wanted, rel=0.06)


def test_what_is_stored_is_told_while_something_is_measured(session):
    with session.lock, ThreadPoolExecutor() as pool:  # as a compilation of minutes holds it
        assert pool.submit(session.load).result(10)


def test_thresholds_of_single_cameras_count_in_each_figure(tmp_path):
    """In the exact area, what is saved, and the search for the next camera."""
    mesh, poses = part(), Poses.of(around(part(), 4), camera=[0, 1, 0, 1])
    own, task = {"strict": rc.Task(max_incidence_deg=30)}, rc.Task(max_incidence_deg=75)
    rig = Rig([CAMERA, CAMERA], ["plain", "strict"], tasks=own)
    session = Session(Scene("part", mesh, RigState.of(rig, poses, task=task)))
    exact = rc.unite(regions(mesh, rig, poses, task)).share()
    without = rc.unite(regions(mesh, (CAMERA, CAMERA), poses, task)).share()
    assert exact < without - 0.05
    assert session.areas().summary()["percent"] == pytest.approx(100 * exact, abs=1e-9)
    Saving(session, tmp_path).save({"what": "rig"})
    saved = rc.read_views(tmp_path / "rig.json")
    shares = rc.unite(regions(mesh, saved.rig, saved.poses, task)).share()
    assert shares == pytest.approx(exact, abs=1e-12)
    session.close()


def test_a_rule_is_saved_where_the_stations_are_whole_rigs(tmp_path):
    rule, mesh = rc.All(min_baseline_deg=3), part()
    rig = Rig([CAMERA, CAMERA], ["left", "right"], rule=rule)
    session = Session(
        Scene("part", mesh, RigState.of(rig, Poses.of(around(mesh), camera=[0, 1] * 2)))
    )
    Saving(session, tmp_path).save({"what": "rig"})
    saved = rc.read_views(tmp_path / "rig.json")
    assert (saved.rig.rule, saved.rig.gates) == (rule, rig.gates)
    before = (tmp_path / "rig.json").read_bytes()
    acted(session, do="delete", station=1)
    for what in ("rig", "report"):
        with pytest.raises(rc.ConfigError, match="all cameras of each rig with a rule"):
            Saving(session, tmp_path).save({"what": what})
    assert (tmp_path / "rig.json").read_bytes() == before
    session.close()


def test_several_rules_are_saved_and_read_back_to_the_last_bit(tmp_path):
    mesh, places = part(), rc.look_at([(0, 0, 0), (0.02, 0, 0)], [(0, 0, 1), (0.02, 0, 1)])
    noise = {"left": 0.1, "right": 0.3}
    stereo = rc.All(min_baseline_deg=0.3, max_uncertainty=1e-4, noise_px=noise, stripes=["right"])
    head = Rig([CAMERA] * 2, ["left", "right"], places, rule=stereo)
    scanner = Rig([CAMERA] * 3, ["a", "b", "laser"], rule=rc.AtLeast(2, needs=["laser"]))
    names = ["left", "right", "lone", "a", "b", "laser"]
    rig = Rig.of_several([head, Rig([CAMERA]), scanner], names)
    poses = np.concatenate([head.poses(around(mesh)[0]).world_from_camera, around(mesh)])
    index = [0, 1, 2, 3, 4, 5]
    session = Session(Scene("part", mesh, RigState.of(rig, Poses.of(poses, camera=index))))
    Saving(session, tmp_path).save({"what": "rig"})
    saved = rc.read_views(tmp_path / "rig.json")
    assert saved.rig.gates == rig.gates
    shown = session.measurements.areas(session.state).network
    summary = rc.evaluate(mesh, saved.rig, saved.poses).areas.summary()
    assert summary["m2"] == pytest.approx(shown.summary()["m2"], rel=1e-12)
    alone = rc.evaluate(mesh, saved.rig.cameras, saved.poses).areas.summary()
    assert summary["m2"] < alone["m2"]
    session.close()
