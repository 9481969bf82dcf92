"""Pages that are signed: whether they may be, under which conditions, and what changes give."""

import html
import re

import numpy as np
import pytest

import rastercov as rc
from rastercov.base import percent
from rastercov.core.coverage.task import NAMES, REASONS
from rastercov.core.mesh import shapes
from rastercov.placement.plan.network import Requirement
from rastercov.placement.required import HOLDS, SHARE_TOLERANCE, status_of
from rastercov.report import notebook
from rastercov.report.coverage import Options, network_of, regions_of, run
from rastercov.report.overview import _reason_keys
from rastercov.report.pages import _environment
from rastercov.report.placement import pages_of
from rastercov.report.plan import summary
from rastercov.report.verdict import mark_of
from rastercov.shards import silent
from rastercov.survey.flight import HIGHEST, Flight

CAMERA = {"width": 320, "height": 240, "fx": 160, "fy": 160}


@pytest.mark.parametrize("seed", range(60))
def test_a_goal_is_said_to_be_met_after_a_change_only_where_its_share_is_certain(seed):
    rng = np.random.default_rng(seed)
    share, limit, doubt, gain = rng.uniform((0, 0, 0, -0.3), (1, 1, 0.01, 0.3))
    is_most, is_about = (rng.random(2) < 0.3).tolist()
    ends = share - doubt, share, share + doubt
    status = status_of(ends[0], ends[2], limit, is_most=is_most)
    own = Requirement(None, limit, *ends, status, 4, 1, is_most=is_most)
    after, words = min(max(share + gain, 0), 1), own.after(gain, is_about=is_about)
    lack = after - limit if is_most else limit - after
    if words.endswith("the goal is then met"):
        assert not is_about
        assert lack + 2 * doubt <= SHARE_TOLERANCE * 1.01
    if "still" in words:
        assert lack > 0
    assert ("about" in words) == is_about == (" % or more is" in words)
    assert (": up to " in words) == (is_about and "still" in words)
    assert ("seen" in words) == is_most


@pytest.mark.parametrize(
    ("passed", "lines", "said"),
    [
        (True, [("door: 9 %", HOLDS)], "May be signed: all goals are met, under the conditions"),
        (False, [("door: 9 %", "fails"), ("hall: 1 %", HOLDS)], "Not to be signed: door fails."),
        (False, [("door: 9 %", "undecided")], "Not to be signed: door is undecided."),
        (False, ["text"], "Not to be signed: not all goals are met."),
        (None, ["text"], "No goal was set"),
    ],
)
def test_a_verdict_says_whether_it_may_be_signed(passed, lines, said):
    macro = _environment("rastercov.report").get_template("macros.html").module.verdict
    told = str(macro("answer", lines, passed, ["all is opaque", "b"]))
    assert said in re.sub("<[^>]*>", "", told)
    assert "<details" not in told  # conditions are not hidden
    assert told.index("All is opaque") > told.index(said)
    assert "sign" not in str(macro("answer", ["text"], passed)).replace('class="verdict', "")


@pytest.mark.parametrize(
    ("line", "sign"),
    [
        *((("a: 1 %", status), "✓") for status in (True, HOLDS, "holds under errors")),
        *((("a: 1 %", status), "✗") for status in (False, "fails")),
        *((("a: 1 %", status), "–") for status in (None, "undecided")),
        ("a: 1 %", ""),
    ],
)
def test_a_line_has_the_sign_of_its_status(line, sign):
    assert mark_of(line)[1:] == (sign, "a: 1 %")
    macro = _environment("rastercov.report").get_template("macros.html").module.verdict
    items = re.findall("<li>(.*?)</li>", str(macro("answer", [line])))
    assert [re.sub("<[^>]*>", "", item) for item in items] == [
        f"{sign} a: 1 %" if sign else "A: 1 %"
    ]


@pytest.mark.parametrize(("under", "has_room"), [("", False), ("", True), ("2 mm", False)])
def test_conditions_name_each_note_once_and_what_was_skipped(under, has_room):
    room = shapes.room()
    middle = room.bounds.mean(axis=0)
    result = rc.evaluate(
        room, rc.Camera(**CAMERA), rc.look_at([middle + np.array((1, 0, 0))], middle)
    )
    page = notebook.network_of(result)
    skipped = {"quarantined": {"7": "was killed"}}
    said = page._conditions(["far away", "far away"], skipped, under, has_room)
    assert said.count("far away") == 1
    assert said[-1] == "pose 7 was skipped: its process was killed"
    assert any("no mounting errors" in text for text in said) == (not under)
    assert any("room for bodies" in text for text in said) == (not under and not has_room)
    assert any("in focus at any distance" in text for text in said)
    assert any("light enough everywhere" in text for text in said)
    assert not any("frames" in text or "samples" in text or "straight" in text for text in said)


def test_a_page_names_glass_and_what_its_reader_left_out(tmp_path):
    room = shapes.room()
    groups = [rc.Group(name) for name in ("hall", "IfcWindow/east", "Glass door")]
    groups.append(rc.Group("outdoors", is_occluder=True))
    of_faces = np.where(np.arange(room.n_faces) < 9, np.arange(room.n_faces) % 3, 0)
    mesh = rc.Mesh(room.vertices, room.faces, groups, of_faces)
    middle = room.bounds.mean(axis=0)
    poses = rc.look_at([middle + np.array((1, 0, 0))], middle)
    run(mesh, rc.Camera(**CAMERA), poses, rc.Task(), tmp_path, Options(pictures=1))
    told = " ".join((tmp_path / "report.html").read_text("utf-8").split())
    verdict = told[told.index('class="verdict') :].partition("</div>")[0]
    assert "IfcWindow/east, Glass door" in verdict
    assert "outdoors" not in verdict  # it has no faces
    assert "no mounting errors" in verdict
    assert "none is modelled" in verdict
    assert "No goal was set" in verdict


@pytest.mark.parametrize("height", [50, 110, 121, 130])
def test_a_flight_names_the_limits_of_height_that_it_is_above(height):
    placement = rc.place(
        {
            "meshes": [{"built_in": "box", "transform": {"scale": 200}}],
            "camera": CAMERA,
            "task": {"resolution_of_result": 20.0},
            "candidates": [
                {"generator": "orbit", "radius": 40, "heights": [100 + height], "count": 4}
            ],
            "selection": {"goal": "all"},
            "outputs": {"page": False},
            "flight": {},
        }
    )
    flight = placement.product("flight")
    assert isinstance(flight, Flight)
    over = [text for most, text in HIGHEST.items() if height > most]
    (line,) = [note for note in flight.notes if "above ground" in note] or [""]
    assert all((text in line) == (text in over) for text in HIGHEST.values())
    assert any("no battery" in note for note in flight.notes)


def flown(height, **more):
    """Flight of strips over level ground, at a height."""
    ground = {"built_in": "box", "transform": {"scale": 400, "translation": [0, 0, -200]}}
    strips = {"generator": "strips", "height": height, "front": 0.7, "side": 0.5}
    placement = rc.place(
        {
            "meshes": [ground],
            "camera": CAMERA,
            "task": {"resolution_of_result": 40.0},
            "candidates": [strips | more],
            "selection": {"goal": "all"},
            "outputs": {"page": False},
            "flight": {},
        }
    )
    return placement, placement.product("flight")


@pytest.mark.parametrize("height", [119, 150, 200])
def test_a_flight_above_a_limit_is_not_signed_and_says_what_keeps_to_it(height):
    """The remedy, flown: below the limit, with the GSD that is said, and no more photographs."""
    placement, flight = flown(height)
    page = pages_of(placement, summary(placement), [], silent)["page.html"]
    verdict = page[: page.index("The figures hold under")]
    assert ("Not to be signed: height above ground fails" in verdict) == (height > 120)
    if not (said := " ".join(flight.refused)):
        return
    assert said in html.unescape(verdict)
    assert said not in page[page.index("The figures hold under") :]
    lower = int(re.search(r"fly (\d+) m lower", said)[1])
    gsd, times = re.search(r"about ([\d.]+) mm/px, and up to about ([\d.]+) times", said).groups()
    _, kept = flown(height - lower)
    assert not kept.refused
    assert 1e3 * kept.summary()["gsd_per_px"] == pytest.approx(float(gsd), rel=0.05)
    assert len(kept.rows) <= 1.1 * float(times) * len(flight.rows)


def test_a_home_beside_the_surface_is_said_with_what_its_height_is():
    wide = {"polygon": [[-300, -100], [300, -100], [300, 100], [-300, 100]]}
    (_, beside), (_, over) = flown(60, **wide), flown(60, polygon=[[-90, -90], [90, -90], [0, 90]])
    assert any("home, for take-off" in note for note in beside.notes)
    assert not any("home, for take-off" in note for note in over.notes)


def test_each_sensor_of_a_head_and_each_change_has_its_position_and_angles():
    place = np.eye(4)
    place[:3, 3] = 0.1, 0.02, 0
    eye = rc.Camera(**CAMERA)
    rig = rc.Rig([eye, eye], ["left", "right"], [np.eye(4), place], rule=rc.All())
    mesh = shapes.box((0.2, 0.2, 0.2))
    places = rc.look_at([(0.7, 0.1, 0.3), (0.1, 0.8, 0.2)], (0, 0, 0))
    heads = rig.poses(places)
    result = rc.evaluate(mesh, rig, heads)
    shown = network_of(result, result.summary(), parts=regions_of(result))
    heads_of, rows = shown.sensors
    assert heads_of[:5] == ["head", "sensor", "x, m", "y, m", "z, m"]
    assert [row[1] for row in rows] == ["left", "right"] * 2
    for row, pose in zip(rows, heads.world_from_camera, strict=True):
        assert [float(each) for each in row[2:5]] == pytest.approx(pose[:3, 3], abs=6e-4)
        heading, down = np.radians([float(each.rstrip("°")) for each in row[5:7]])
        ahead = np.cos(down) * np.cos(heading), np.cos(down) * np.sin(heading), -np.sin(down)
        assert pose[:3, 2] == pytest.approx(ahead, abs=3e-3)
    lone = rc.evaluate(mesh, eye, places)
    assert network_of(lone, lone.summary()).sensors is None
    tried = {"position": [1, 1, 1], "looking_at": [0, 0, 1]}
    assert shown.turned({"tried": tried}) == (
        "Its heading is then -135.0°, its tilt down 0.0°, its roll 0.0°."
    )
    assert shown.turned({"tried": None}) == ""


def test_equal_colours_have_one_key_that_names_all_their_reasons():
    names = [row for row, name in enumerate(NAMES) if "oblique" in name]
    labels = [each.name for each in _reason_keys(names, {"left fails": 1})]
    every = " or ".join(labels)
    assert all(REASONS[NAMES[row]].label in every for row in names)
    colours = [REASONS[NAMES[row]].colour for row in names]
    assert len(labels) == 2 + len({*colours} - {REASONS["covered"].colour})
    assert len(labels) < 2 + len(names)


def test_equipment_that_rides_on_cameras_has_its_place_on_them():
    lamps = rc.Lamps([rc.Lamp.ring(0.08, 40, points=8)], [np.eye(4)], ["ring"], rides=[True])
    mesh, pose = shapes.box((0.2, 0.2, 0.2)), rc.look_at([(0.7, 0, 0)], (0, 0, 0))
    result = rc.evaluate(mesh, rc.Camera(**CAMERA), pose, lamps=lamps)
    (said,) = [each for each in network_of(result, result.summary())._rules() if "ring" in each]
    assert "at (0.000, 0.000, 0.000) m from each camera, facing (0.00, 0.00, 1.00)" in said


def test_a_page_of_a_flight_says_how_far_and_how_long_apart_photographs_are():
    placement, flight = flown(60)
    page = pages_of(placement, summary(placement), [], silent)["page.html"]
    (mission,) = flight.table()
    line = mission["lines"][0]
    apart = line["length_m"] / (line["images"] - 1)
    cells = [f"{line['length_m']:.0f}", f"{apart:.1f}", f"{apart / flight.asked.speed:.1f}"]
    assert re.search(r"\s*".join(f"<td[^>]*>{each}</td>" for each in cells), page)


PLATES = [((1, 1, 0.5), (0, 0, 0)), ((1, 1, 0.5), (4, 0, 0)), ((1, 1, 0.5), (8, 0, 0))]
"""Sizes and places of plates, of which a camera sees the first from above."""


def plates_page(task=None, **more):
    """Mesh, cameras, and page of plates under a camera above the first."""
    plates = [shapes.box(size, centre=at) for size, at in PLATES]
    mesh = rc.Mesh.joined(plates, ["a", "b", "c"])
    eye, pose = rc.Camera(**CAMERA), rc.look_at([(0, 0, 2)], [(0, 1e-3, 0)])
    result = rc.evaluate(mesh, eye, pose, task, **more)
    return mesh, eye, pose, network_of(result, result.summary(), parts=regions_of(result))


def test_the_gain_of_added_cameras_together_is_that_of_all_of_them():
    mesh, eye, pose, page = plates_page()
    poses, numbers, n_said = [pose], [], 0
    for zone, row, _, said, _ in page.shown_zones:
        tried = zone["tried"]
        if tried is None:
            assert said == []
            continue
        if tried["pose"] is not None:  # what the others lose counts; none is added
            (words,) = said
            gain = sum(tried["group_gains_m2"].values()) / page.task_m2
            share = page.figures["covered_area"]["percent"] / 100 + gain
            assert words == f"then about {percent(share)} of the area or more is covered"
            continue
        numbers.append(row[0])
        poses.append(rc.look_at([tried["position"]], [tried["looking_at"]]))
        assert len(said) == min(len(numbers), 2)
        if len(numbers) > 1:
            before = f"with what is added for zones {', '.join(numbers)} about "
            words, share, after = re.split(r"([\d.]+)(?= %)", said[1].replace(before, "", 1))
            assert (words, after) == ("", " % of the area or more is covered")
            every = rc.evaluate(mesh, eye, np.concatenate(poses)).summary()["covered_area"]
            assert float(share) <= every["percent"] + 1.5  # which cover other zones, too
            assert float(share) > float(re.search(r"([\d.]+) %", said[0])[1])
            n_said += 1
    assert n_said


@pytest.mark.parametrize("rides", [None, True, False])
def test_a_camera_that_is_added_has_the_lamps_that_ride(rides):
    more = {}
    if rides is not None:
        lamp, at = rc.Lamp.ring(0.08, 4000, points=8), np.eye(4)
        at[:3, 3] = np.zeros(3) if rides else (0, 0, 3)
        more["lamps"] = rc.Lamps([lamp], [at], ["ring"], rides=[rides])
    *_, page = plates_page(**more)
    advised = [zone["advice"] for zone, *_ in page.shown_zones if "add a" in zone["advice"]]
    assert advised
    assert all(("camera and its lamps at" in text) == bool(rides) for text in advised)


@pytest.mark.parametrize("sharp", [(), (0,), (1,), (0, 1)])
def test_a_page_names_the_sensors_that_have_no_depth_of_field(sharp):
    blurred = CAMERA | {"focus_range": (0.1, 5.0)}
    eyes = [rc.Camera(**(CAMERA if row in sharp else blurred)) for row in range(2)]
    place = np.eye(4)
    place[0, 3] = 0.1
    rig = rc.Rig(eyes, ["left", "right"], [np.eye(4), place], rule=rc.All())
    heads = rig.poses(rc.look_at([(0.7, 0.1, 0.3)], (0, 0, 0)))
    result = rc.evaluate(shapes.box((0.2, 0.2, 0.2)), rig, heads)
    page = network_of(result, result.summary())
    said = [
        each for each in page._conditions([], {"quarantined": {}}, "", False) if "focus" in each
    ]
    who = {(): [], (0,): ["left"], (1,): ["right"], (0, 1): ["each head"]}[sharp]
    assert said == [f"in focus at any distance, without a depth of field: {each}" for each in who]
    rules = " ".join(page._rules())
    wanted = [f"{name} must be in focus" for name in ("left", "right")]
    wanted = ["It must be in focus"] if not sharp else wanted
    assert [each in rules for each in wanted] == [row not in sharp for row in range(len(wanted))]


def test_a_proved_number_of_cameras_is_of_the_candidates_on_patches(tmp_path):
    plan = {
        "meshes": [{"built_in": "icosahedron"}],
        "camera": CAMERA,
        "candidates": [{"generator": "on_sphere", "count": 30, "distances": [4.0]}],
        "selection": {"goal": "fewest_cameras", "coverage": 0.9},
    }
    rc.place(plan, out=tmp_path / "out")
    page = (tmp_path / "out" / "page.html").read_text()
    assert re.search(
        r"At least \d+ cameras? (is|are) needed of these candidates, on patches of the surface "
        r"\(proved\), for 90.0 % of the area[^<]*; other poses may do with fewer\.",
        page,
    )
