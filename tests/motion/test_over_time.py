"""Figures over time: durations, presence, tables of poses, and what hides the parts missed."""

import json

import numpy as np
import pytest
import swept_arm as arm
from test_bodies import AROUND, CAMERA, shifted, two_bodies
from timed import evaluate_over_time, over_time, regions_over_time

import rastercov as rc
from rastercov.base.errors import ConfigError
from rastercov.core.area.regions import covering_poses
from rastercov.core.area.remedies import Allowed
from rastercov.core.area.table import join
from rastercov.core.area.zones import MOST_LINES, points_of, zone_line
from rastercov.core.coverage.task import NAMES
from rastercov.core.mesh.solids import in_solid
from rastercov.placement.candidates.rooms import NearestSurface

TASK = rc.Task()


def passing(durations=None, present=None):
    """A plate that passes before a part, seen from above."""
    part = rc.shapes.by_name("icosahedron")
    plate = rc.Mesh(
        [(-1, -1, 1.5), (1, -1, 1.5), (1, 1, 1.5), (-1, 1, 1.5)], [(0, 1, 2), (0, 2, 3)]
    )
    mesh = two_bodies(part, plate)
    moves = {"b": rc.conveyor(4, direction=(1, 0, 0), distance=6)}
    return rc.Motion(mesh, moves, present, durations)


ABOVE = rc.look_at(eyes=[(0.1, 0.1, 6)], targets=(0, 0, 0), up=(0, 1, 0))


def test_durations_are_weights_of_frames():
    motion, doubled = passing([1, 0.5, 0.5, 2]), passing()
    assert motion.units.tolist() == [2, 1, 1, 4]
    regions = regions_over_time(motion, CAMERA, ABOVE, TASK)
    for share in (0.25, 0.5, 0.6, 0.75, 1.0):
        frames = [regions.of_poses(np.arange(4) == row) for row in range(4)]
        rows = np.repeat(np.arange(4), motion.units)
        every = join([frames[row] for row in rows])
        expected = every.at_least(int(np.ceil(8 * share)), one_side=False).areas().sum()
        assert over_time(regions, motion, share).areas().sum() == pytest.approx(expected, abs=1e-9)
    assert doubled.units.tolist() == [1, 1, 1, 1]


def test_the_curve_falls_and_adds_up_to_the_frames():
    result = evaluate_over_time(passing([1, 2, 1, 1]), CAMERA, ABOVE, TASK, 0.9)
    curve, frames = result.curve(), result.table()
    areas = [each["m2"] for each in curve]
    assert areas == sorted(areas, reverse=True)
    assert len(curve) == 5
    weighted = sum(each["covered_m2"] * each["duration"] for each in frames)
    assert sum(areas) == pytest.approx(weighted, rel=1e-9)
    said = result.summary()
    assert said["ever_percent"] == pytest.approx(curve[0]["percent"])
    assert said["always_percent"] == pytest.approx(curve[-1]["percent"], abs=1e-9)
    assert said["always_percent"] <= said["covered"]["percent"] <= said["ever_percent"]
    shares = result.share_of_time()
    scored = result.motion.mesh.task_mask
    of_time = (shares * result.motion.mesh.areas)[scored].sum() * 5
    assert of_time == pytest.approx(weighted, rel=1e-9)


@pytest.mark.parametrize("over", [0.7, "all"])
def test_every_second_frame_is_the_motion_of_these_frames_alone(over):
    result = evaluate_over_time(passing([1, 1, 1, 2]), CAMERA, ABOVE, TASK, over)
    some = result.motion._of_frames(np.array([True, False, True, False]))
    alone = 100 * evaluate_over_time(some, CAMERA, ABOVE, TASK, over).share()
    others = result.motion._of_frames(np.array([False, True, False, True]))
    assert alone != evaluate_over_time(others, CAMERA, ABOVE, TASK, over).share() * 100
    assert result.half() == pytest.approx(alone, abs=1e-9)


def test_views_at_any_time_need_not_be_at_one_time():
    # The part is seen by one camera or by the other, when the plate is before this one.
    motion = passing()
    eyes = rc.look_at(eyes=[(0.1, 0.1, 6), (3.5, 0.1, 4)], targets=(0, 0, 0), up=(0, 1, 0))
    two = rc.Task(views=2)
    regions = regions_over_time(motion, CAMERA, eyes, two)
    one, any_time = (
        over_time(regions, motion, 0.75, views=2, views_at=at).area.sum()
        for at in ("one time", "any time")
    )
    assert any_time >= one - 1e-12
    by_hand = [
        over_time(regions_over_time(motion, CAMERA, eye[None], TASK), motion, 0.75) for eye in eyes
    ]
    assert any_time == pytest.approx(join(by_hand).at_least(2, one_side=False).area.sum())


def test_the_body_that_hides_a_dead_zone_is_named():
    # From four sides: the rest is where the plate is in between.
    eyes = [(0.1, 0.1, 6), (0.1, 0.1, -6), (0.1, 6, 0.1), (0.1, -6, 0.1)]
    eyes = rc.look_at(eyes=eyes, targets=(0, 0, 0), up=(0.3, 1, 0.2))
    result = evaluate_over_time(passing(), CAMERA, eyes, TASK, "all")
    zones = result.dead_zones()["dead_zones"]
    hidden = [zone for zone in zones if zone["hidden_by"] == "b"]
    assert hidden
    for zone in hidden:
        assert zone["reason"] == "occluded"
        assert zone["advice"].startswith('"b" blocks the view')
    assert result.table()[0]["hidden_by"] == "b"
    assert "of the area in all frames; " in result.lines()[0]


def test_only_what_is_occluded_is_hidden_by_a_body():
    # The part turns: below, and behind it, it is seen from behind at most times.
    mesh = two_bodies(rc.shapes.by_name("teapot"), rc.shapes.by_name("icosahedron"))
    motion = rc.Motion(mesh, {"a": rc.turntable(6)})
    pose = rc.look_at(eyes=[(3, 0.1, 2)], targets=(0, 0, 0), up=(0, 0, 1))
    for over in ("some", 0.5, "all"):
        result = evaluate_over_time(motion, CAMERA, pose, TASK, over)
        zones = result.dead_zones()["dead_zones"]
        assert zones
        for zone in zones:
            assert (zone["hidden_by"] is None) or zone["reason"] == "occluded"
            assert not set("{}") & set(zone["advice"])
    reasons = {zone["reason"] for zone in zones}
    assert "back_facing" in reasons


def test_what_hides_itself_is_another_part_of_it():
    # The inner side of a torus, from outside on all sides.
    torus = rc.shapes.by_name("torus")
    name = torus.groups[0].name
    motion = rc.Motion(torus, {"ring": rc.turntable(8)}, groups={"ring": [name]})
    eyes = [(10, 0, 1), (10, 0, -1), (-10, 0, 1), (-10, 0, -1)]
    eyes = rc.look_at(eyes=eyes, targets=(0, 0, 0), up=(0, 0, 1))
    zones = evaluate_over_time(motion, CAMERA, eyes, TASK).dead_zones()["dead_zones"]
    assert zones[0]["hidden_by"] == name
    assert zone_line(zones[0]).endswith(": self-occluded")
    assert zones[0]["advice"].startswith("another part of the same body blocks the view; ")


def test_the_camera_that_covers_longest_is_that_of_most_area_and_time():
    motion = passing([1, 2, 1, 4])
    eyes = rc.look_at(eyes=[(0.1, 0.1, 6), (3.5, 0.1, 4)], targets=(0, 0, 0), up=(0, 1, 0))
    result = evaluate_over_time(motion, CAMERA, eyes, TASK)
    areas = result.regions.areas().reshape(4, 2, -1)
    worth = (areas * motion.durations[:, None, None]).sum(axis=0)
    row = result.longest()
    assert (row[worth.sum(axis=0) == 0] == -1).all()
    covered = np.flatnonzero(row >= 0)
    assert len(covered)
    assert np.allclose(worth[row[covered], covered], worth.max(axis=0)[covered])


def test_reasons_over_time_are_those_of_dead_zones():
    result = evaluate_over_time(passing(), CAMERA, ABOVE, TASK, "all")
    mesh = result.motion.mesh
    summary = rc.evaluate(mesh, CAMERA, ABOVE, TASK, motion=result.asked).summary()
    assert summary["not_covered_because"] == summary["seeable_not_covered_because"]
    wanted = dict.fromkeys([zone["reason"] for zone in summary["dead_zones"]], 0.0)
    for zone in summary["dead_zones"]:
        wanted[zone["reason"]] += zone["area_m2"]
    answer = summary["seeable_not_covered_because"]
    assert {name: each["m2"] for name, each in answer.items()} == pytest.approx(wanted)
    part, plate = summary["groups"]
    assert part["seeable_not_covered_because"].keys() == answer.keys()
    assert "seeable_not_covered_because" not in plate


def test_what_one_camera_covers_long_enough_has_too_few_views():
    eyes = rc.look_at(eyes=[(0.1, 0.1, 6), (3.5, 0.1, 4)], targets=(0, 0, 0), up=(0, 1, 0))
    for at in ("one time", "any time"):
        two = evaluate_over_time(passing(), CAMERA, eyes, rc.Task(views=2), 0.5, views_at=at)
        one = evaluate_over_time(passing(), CAMERA, eyes, TASK, 0.5, views_at=at)
        values, same = (
            np.bincount(each.zones.reason, each.zones.piece_area, len(NAMES)) for each in (two, one)
        )
        gained = one.long_enough.area.sum() - two.long_enough.area.sum()
        assert gained > 0.1
        assert values[NAMES.index("too_few_views")] == pytest.approx(gained)
        values[NAMES.index("too_few_views")] = 0
        assert values == pytest.approx(same, abs=1e-9)


def test_what_is_proved_unseeable_is_so_in_every_frame():
    # A box on a box: their contact cannot be seen at rest, and can where one is lifted.
    boxes = two_bodies(rc.shapes.box((1, 1, 1)), rc.shapes.box((1, 1, 1), 1, (0, 0, 1)))
    boxes = rc.Mesh(boxes.vertices, boxes.faces, boxes.groups, boxes.face_group)
    contact = np.flatnonzero((boxes.normals[:, 2] > 0.9) & (boxes.centroids[:, 2] < 0.6))
    pose = rc.look_at(eyes=[(5, 0.1, 0.3)], targets=(0, 0, 0))
    for lift, wanted in ((0.0, {"unseeable"}), (1.0, {"back_facing"})):
        moves = {name: rc.conveyor(2, direction=(0, 0, 1), distance=lift) for name in "b"}
        result = evaluate_over_time(rc.Motion(boxes, moves), CAMERA, pose)
        own = np.isin(result.zones.face, contact)
        assert {NAMES[row] for row in result.zones.reason[own]} == wanted
        summary = rc.evaluate(boxes, CAMERA, pose, motion=result.asked).summary()
        assert (summary["unseeable_m2"] > 0.9) == (lift == 0)


def test_what_is_never_there_cannot_be_seen():
    mesh = two_bodies(rc.shapes.box((1, 1, 1)), rc.shapes.box((1, 1, 1), 1, (4, 0, 0)))
    motion = rc.Motion(mesh, {"a": np.eye(4)}, {"a": np.zeros(1, bool)})
    result = evaluate_over_time(motion, CAMERA, ABOVE)
    own = np.isin(result.zones.face, np.flatnonzero(mesh.face_group == 0))
    assert {NAMES[row] for row in result.zones.reason[own]} == {"unseeable"}


def test_absent_frames_do_not_count_for_what_is_absent():
    motion = passing(present={"b": [False, False, True, True]})
    assert motion._rows_for("all")[:20].tolist() == [4] * 20
    assert motion._rows_for("all")[20:].tolist() == [2, 2]
    assert motion._rows_for(0.5)[20:].tolist() == [1, 1]


def quaternion_rows():
    half = np.sqrt(0.5)
    return f"time,b.x,b.qw,b.qz,b.present\n0,0,1,0,1\n0.1,1,{half},{half},1\n0.3,2,1.0009,0,0\n"


def test_tables_of_json_and_csv_are_the_same_motion(tmp_path):
    mesh = passing().mesh
    turn = rc.turntable(4)[1]
    turn[0, 3] = 1
    last = shifted((2, 0, 0))
    content = {
        "times": [0, 0.1, 0.3],
        "bodies": {
            "b": {
                "poses": [np.eye(4).tolist(), turn.tolist(), last.tolist()],
                "present": [True, True, False],
            }
        },
    }
    (tmp_path / "m.json").write_text(json.dumps(content))
    (tmp_path / "m.csv").write_text(quaternion_rows())
    one, other = (rc.load_motion(mesh, tmp_path / name) for name in ("m.json", "m.csv"))
    assert np.allclose(one.world_from_body, other.world_from_body, atol=1e-12)
    assert np.array_equal(one.present, other.present)
    assert one.durations.tolist() == other.durations.tolist() == pytest.approx([0.1, 0.2, 0.2])
    assert one.units.tolist() == [1, 2, 2]


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("m.json", "{", "expected valid JSON"),
        ("m.json", "{}", "bodies"),
        (
            "m.json",
            '{"bodies": {"b": {}}, "times": [0.7, 0.5]}',
            "times to be strictly increasing",
        ),
        (
            "m.json",
            '{"bodies": {"b": {}}, "times": [0], "durations": [1]}',
            "times or durations, got both",
        ),
        ("m.json", '{"bodies": {"b": {}}, "durations": [-1]}', "above 0"),
        ("m.json", '{"bodies": {"b": {}}, "durations": [1e99]}', "at most"),
        ("m.json", '{"bodies": {"b": {}}, "durations": [1, 2]}', "durations to be"),
        ("m.json", '{"bodies": {"b": {"poses": [[1]]}}}', "rigid"),
        ("m.json", '{"bodies": {"b": {"pose": 1}}}', "expected poses and present of body"),
        ("m.json", '{"bodies": {"lid": {}}}', "lid"),
        ("m.json", '{"bodies": {"b": {}}, "x": 1}', "expected entries"),
        ("m.csv", "b.x\n", "1 to"),
        ("m.csv", "b.x,b.x\n1,2\n", "different names"),
        ("m.csv", "b.x\n1,2\n", "expected 1 numbers"),
        ("m.csv", "b.x\nfar\n", "a number within .*"),
        ("m.csv", "b.w\n1\n", "expected columns"),
        ("m.csv", "time\n1\n", "column of a body"),
        (
            "m.csv",
            "time,b.x\n1,0\n1,0\n",
            "times to be strictly increasing, got 1 after 1 in frame 1",
        ),
        ("m.csv", "b.qw\n0\n", "'b', frame 0: expected a quaternion of length 1, got 0"),
        ("m.csv", "b.qw,b.qx\n1,0\n2.69,-4.16\n", "frame 1: expected a quaternion of length 1"),
        ("m.csv", "b.qw\n1e90\n", "frame 0: expected a quaternion of length 1, got"),
        ("m.csv", "b.qw,b.qz\n.6,.803\n", "quaternion of length 1"),
        ("m.txt", "b.x\n0\n", "expected a motion in"),
    ],
)
def test_files_that_are_no_motion_are_refused_in_one_line(tmp_path, name, text, words):
    (tmp_path / name).write_text(text)
    with pytest.raises((ConfigError, rc.MeshError), match=words) as error:
        rc.load_motion(passing().mesh, tmp_path / name)
    assert "\n" not in str(error.value)
    assert name in str(error.value)


@pytest.mark.parametrize("seed", range(40))
def test_durations_are_multiples_of_a_unit_to_rounding(seed, tmp_path):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 60))
    whole = rng.integers(1, 150, n)
    unit = 0.1 if seed < 3 else float(1 / rng.integers(1, 1000) * 10.0 ** rng.integers(-12, 12))
    units = whole // np.gcd.reduce(whole)
    mesh = passing().mesh
    poses = np.tile(np.eye(4), (n, 1, 1))
    assert rc.Motion(mesh, {"b": poses}, durations=unit * whole).units.tolist() == units.tolist()
    ends = np.cumsum(unit * whole)
    near = whole * unit * (1 + rng.uniform(-2e-16, 2e-16, n))
    assert rc.Motion(mesh, {"b": poses}, durations=near).units.tolist() == units.tolist()
    times = [0.0, *ends.tolist()]
    bodies = {"b": {"poses": [np.eye(4).tolist()] * (n + 1)}}
    for name, given in (
        ("times", times),
        ("durations", np.diff(times, append=times[-1] + near[-1])),
    ):
        (tmp_path / "m.json").write_text(json.dumps({"bodies": bodies, name: list(given)}))
        motion = rc.load_motion(mesh, tmp_path / "m.json")
        assert motion.units.tolist() == [*units.tolist(), units[-1]]


@pytest.mark.parametrize(
    "durations",
    [
        [0.033331, 0.05, 0.1, 0.1],
        [1, 1 + 1e-8, 1, 1],
        [1, 1, 1, 1e30],
        [5e-324, 1e30, 1, 1],
        [1, 3000, 3000, 4000],
        [1, 2**0.5, 1, 1],
    ],
)
def test_durations_without_a_common_unit_are_refused(durations):
    with pytest.raises(ConfigError, match="whole multiples of one unit within 1e-09, 10,000 in"):
        passing(durations)


def test_views_at_other_times_are_refused():
    motion = passing()
    regions = regions_over_time(motion, CAMERA, ABOVE, TASK)
    with pytest.raises(ConfigError, match="views_at"):
        over_time(regions, motion, views_at="soon")


def test_a_robot_over_a_part_is_evaluated_over_time():
    motion = rc.Motion(arm.cell(), arm.frames(arm.sweep(12)))
    result = evaluate_over_time(motion, CAMERA, arm.CAMERAS, TASK, "all")
    assert 0 < result.summary()["always_percent"] < result.summary()["ever_percent"]
    assert any(each["hidden_by"] for each in result.table())
    assert AROUND.shape == (4, 4, 4)


@pytest.mark.parametrize("over", ["some", 0.75, "all"])
def test_cameras_that_advice_adds_cover_half_of_a_zone_for_long_enough(over):
    other = rc.shapes.by_name("icosahedron").moved(translation=(-2, 0, 1.2))
    mesh = two_bodies(rc.shapes.by_name("teapot"), other)
    motion = rc.Motion(mesh, {"b": rc.conveyor(4, direction=(1, 0, 0), distance=4.0)})
    pose = rc.look_at(eyes=[(3, 0.1, 2)], targets=(0, 0, 0), up=(0, 0, 1))
    result = evaluate_over_time(motion, CAMERA, pose, TASK, over)
    tried = [zone for zone in result.dead_zones()["dead_zones"] if zone["tried"]]
    assert tried
    for row, zone in enumerate(result.dead_zones()["dead_zones"][:MOST_LINES]):
        if not zone["tried"]:
            continue
        change = zone["tried"]
        added = rc.look_at([change["position"]], [change["looking_at"]])
        alone = evaluate_over_time(motion, CAMERA, added, TASK, over)
        points, piece = points_of(result.zones, row + 1, 400)
        own = result.zones.zone[piece] == row
        face = result.zones.face[piece][own].astype(np.int64)
        assert covering_poses(alone.long_enough, face, points[own]).mean() >= 0.5, zone["advice"]


def turned(least=0.0):
    """Advice for a block on a plate that turns, at places with a clearance in every frame."""
    plate = rc.shapes.box((0.12, 0.08, 0.01), centre=(0.06, 0.04, 0.005))
    block = rc.shapes.box((0.04, 0.04, 0.03), centre=(0.06, 0.04, 0.025))
    mesh = two_bodies(plate, block)
    turn = {"part": rc.turntable(36, centre=(0.06, 0.04, 0))}
    motion = rc.Motion(mesh, turn, groups={"part": ["a", "b"]})
    pose = rc.look_at([(0.06, -0.3, 0.25), (0.35, 0.04, 0.25)], (0.06, 0.04, 0.02))
    camera, task = rc.Camera.from_fov(640, 480, hfov_deg=40), rc.Task(max_incidence_deg=70)
    result = evaluate_over_time(motion, camera, pose, task)

    def free(mesh, kept):
        surface = NearestSurface(mesh)
        return lambda eyes: surface.query(eyes).distance >= least

    allowed = Allowed(free=free) if least else Allowed()
    return motion, result._advise(allowed)["dead_zones"]


def test_advice_names_no_place_that_a_body_passes():
    """The base below the block is seen from inside the block alone, which turns."""
    motion, zones = turned()
    places = [zone["tried"]["position"] for zone in zones if zone["tried"]]
    assert places
    for row in range(len(motion)):
        assert not in_solid(motion.frame(row)[0], places).any()
    words = "that are clear of bodies would cover at least half of it in some frame"
    assert [zone["reason"] for zone in zones if words in zone["advice"]] == ["occluded"]


def test_advice_keeps_the_clearance_in_every_frame():
    near = [zone["tried"] for zone in turned()[1]]
    motion, zones = turned(least=0.25)
    places = [zone["tried"]["position"] for zone in zones if zone["tried"]]
    assert sum(each is not None for each in near) > 0
    for row in range(len(motion)):
        if places:
            assert NearestSurface(motion.frame(row)[0]).query(places).distance.min() >= 0.25
    assert near != [zone["tried"] for zone in zones]
