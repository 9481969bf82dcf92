"""Legs of a flight: distances against points, ways over obstacles, and flights without a way."""

import csv
import json
from dataclasses import replace
from itertools import pairwise
from xml.etree import ElementTree

import numpy as np
import pytest
from commands import call, enter
from hypothesis import given
from hypothesis import strategies as st
from nightly import amount, examples
from short_search import short_search  # noqa: F401 # a fixture for every test
from test_flight_plan import KML, ORBIT, PLACE, PLAN, placed, waypoints
from test_lamp_choice import toml

import rastercov as rc
from rastercov.core.mesh import Mesh, shapes
from rastercov.placement import KeepOutBox, KeepOutSphere, NearestSurface
from rastercov.placement.plan.legs import Airspace, course_of, length_of
from rastercov.report.plan import summary
from rastercov.survey.flight import flight_of
from rastercov.survey.plan_section import FlightSection

SHARES = np.linspace(0, 1, 2001)[:, None]
TOWER = shapes.box((2, 30, 20)).moved(translation=(0, 0, 10))
VOLUMES = [
    KeepOutBox((-0.1, -0.2, -0.1), (0.2, 0.1, 0.1)),
    KeepOutBox((0, 0, 0), (0.3, 0.3, 0)),
    KeepOutSphere((0, 0.1, 0), 0.2),
]
ACROSS = ORBIT | {"radius": 22, "heights": [0.5], "count": 2}
"""Two places on either side of the aeroplane, which is in between."""


def points(stops):
    """Points of a way."""
    return np.concatenate([a + SHARES * (b - a) for a, b in pairwise(stops)])


@examples(20)
@given(st.integers(0, 2**32 - 1))
def test_distances_are_those_of_the_nearest_points(seed):
    rng = np.random.default_rng(seed)
    mesh = Mesh.joined(
        [shapes.teapot(2), shapes.box((0.1, 0.1, 0.1)).moved(translation=(0.3, 0, 0))]
    )
    stops = rng.uniform(-0.5, 0.5, (rng.integers(2, 5), 3))
    stops[1] = stops[0] if rng.random() < 0.1 else stops[1]
    distance = Airspace(mesh).distance(stops)
    near = NearestSurface(mesh).query(points(stops)).distance.min()
    step = np.linalg.norm(np.diff(stops, axis=0), axis=1).max() / 4000
    assert distance <= near * (1 + 1e-9)
    assert near <= distance + step + 1e-12
    assert Airspace(mesh).distance(stops, 0.01) == pytest.approx(min(distance, 0.01))


@pytest.mark.parametrize("volume", VOLUMES)
@examples(20)
@given(st.integers(0, 2**32 - 1))
def test_segments_meet_volumes_as_their_points_do(volume, seed):
    rng = np.random.default_rng(seed)
    starts, ends = rng.uniform(-0.4, 0.4, (2, 50, 3))
    ends[:10, 0] = starts[:10, 0]
    ends[:3] = starts[:3]
    starts[20:30] = ends[20:30] * (1, 1, -1)  # through the flat one
    inside = np.array(
        [volume.contains(points(way)).any() for way in zip(starts, ends, strict=True)]
    )
    met = volume.meets(starts, ends)
    assert (met | ~inside).all()
    grown = replace(volume, radius=0.201) if hasattr(volume, "radius") else replace(
        volume, low=tuple(np.subtract(volume.low, 1e-3)), high=tuple(np.add(volume.high, 1e-3))
    )  # fmt: skip
    near = np.array([grown.contains(points(way)).any() for way in zip(starts, ends, strict=True)])
    assert (near | ~met).all()


def test_positions_of_a_side_are_flown_together():
    home, space = np.array((-9.0, 0.0, 0.0)), Airspace(TOWER, 2.0)
    eyes = np.array([(-5, 1, 6), (5, 1, 6), (-5, 3, 6), (5, 3, 6), (-5, 5, 6)], float)
    course = course_of(space, home, eyes, np.arange(5))
    sides = np.sign(eyes[course.rows, 0])
    assert np.count_nonzero(np.diff(sides)) == 1
    assert [len(each) for each in course.over[1:-1]] == [*(2 * (np.diff(sides) != 0))]
    stops = np.array((home, *(at for row, over in zip(course.rows, course.over, strict=False)
                              for at in (*over, eyes[row])), *course.over[-1], home))  # fmt: skip
    assert NearestSurface(TOWER).query(points(stops)).distance.min() >= 2.0
    assert stops[:, 2].max() == 22.0
    assert stops[[0, 1, -2, -1], :2].tolist() == [[-9, 0]] * 4
    assert length_of(*stops) < 9 + 4 * 17 + 52


def test_a_clear_order_is_left_as_it_is():
    eyes = np.array([(-5, y, 6) for y in range(5)], float)
    course = course_of(Airspace(TOWER, 2.0), np.array((-5.0, -1, 0)), eyes, np.arange(5))
    assert course.rows.tolist() == [0, 1, 2, 3, 4]
    assert [each.tolist() for each in course.over] == [[[-5, -1, 6]], *[[]] * 4, [[-5, -1, 6]]]


def on_slope(slope, *bodies):
    """Ground that rises to +x from (0, 0, 0), with bodies on it."""
    corners = [(x, y, slope * x) for x, y in ((-90, -90), (90, -90), (90, 90), (-90, 90))]
    return Mesh.joined([Mesh(corners, [(0, 1, 2), (0, 2, 3)]), *bodies])


@pytest.mark.parametrize("clearance", [0.0, 0.3, 4.0])
@pytest.mark.parametrize("top", [1.0, 30.0])
def test_climbs_from_slopes_of_30_degrees_are_clear(clearance, top):
    home = np.array((3.0, 2.0, 3.0 * np.tan(np.radians(29.9))))
    space = Airspace(on_slope(np.tan(np.radians(29.9))), clearance)
    assert space.is_clear_climb(home, home[2] + top)
    # Below its ground.
    assert not space.is_clear_climb(home - (0, 0, 0.5), home[2] + top)


@examples(40)
@given(st.integers(0, 2**32 - 1))
def test_climbs_keep_half_their_height_up_to_the_clearance(seed):
    rng = np.random.default_rng(seed)
    size = rng.uniform(0.1, 4, 3)
    body = shapes.box(tuple(size)).moved(translation=(*rng.uniform(-4, 4, 2), rng.uniform(0, 8)))
    space = Airspace(on_slope(rng.uniform(0, 0.6), body), rng.choice((0.0, rng.uniform(0.1, 4))))
    home, top = np.zeros(3), rng.uniform(0.2, 12)
    climb = points(np.array([(0, 0, 0.05), (0, 0, top)]))
    away = NearestSurface(space.mesh).query(climb).distance
    keeps = (away >= np.minimum(space.clearance, climb[:, 2] / 2) * (1 - 1e-9)).all()
    steep = (away < np.minimum(space.clearance, climb[:, 2] * 0.526) + 0.01).any()
    is_clear = space.is_clear_climb(home, top)
    assert not is_clear or (keeps and away.min() > 0)
    assert is_clear or steep


def test_a_home_beside_the_edge_of_the_ground_is_clear_where_half_the_height_is_away():
    """4 m beside ground whose edge is 5 m above home, at a clearance of 10 m."""
    ground = Mesh([(0, -90, 5), (90, -90, 5), (90, 90, 5), (0, 90, 5)], [(0, 1, 2), (0, 2, 3)])
    space = Airspace(ground, 10.0)
    assert space.is_clear_climb(np.array((-4.0, 0, 0)), 60.0)
    assert not space.is_clear_climb(np.array((-2.0, 0, 0)), 60.0)  # 2 m at a height of 5 m


def test_climbs_have_a_height_of_their_own():
    eyes = np.array([(-5, 0, 0.2), (-5, 3, 0.2)])
    low = TOWER.moved(translation=(0, 0, -4))
    course = course_of(Airspace(low), np.array((-5.0, -3, 0)), eyes, np.arange(2))
    assert [each.tolist() for each in course.over] == [[[-5, -3, 1]], [], [[-5, -3, 1]]]


def test_a_home_below_something_is_refused(tmp_path, capsys, monkeypatch):
    volume = {"name": "trees", "low": [-23, -1, 0.2], "high": [-21, 1, 0.3]}
    own = {"candidates": [ACROSS], "constraints": {"keep_out": [volume]}}
    own |= {"flight": PLAN["flight"] | {"home": [-22, 0, 0]}}
    placement = placed(tmp_path / "out", **own)
    assert summary(placement)["flight"]["blocked"] == [1, 3]
    assert "first to waypoint 1" in placement.product("flight").unwritten[0]
    assert "move home in [flight]" in placement.product("flight").unwritten[0]
    assert not list((tmp_path / "out").glob("flight.*"))
    enter(tmp_path, monkeypatch)
    (tmp_path / "plan.toml").write_text(toml(PLAN | own))
    code, out, error = call(capsys, "place plan.toml --out again")
    assert (code, "first to waypoint 1" in out, "error" in error) == (1, True, False)


@pytest.mark.parametrize("distance", [0.1, 0.3, 4.1, 7.7])
def test_legs_at_the_clearance_itself_are_clear(distance):
    eyes = np.array([(-1 - distance, y, 6.3) for y in range(5)])
    for home in ((-1 - distance, -1, 0), (distance + 1, 0, 30)):
        course = course_of(Airspace(TOWER, distance), np.array(home), eyes, np.arange(5))
        assert [len(each) for each in course.over[1:-1]] == [0] * 4
    over = Airspace(TOWER, distance).between(eyes[0], eyes[0] * (-1, 1, 1))
    assert over[:, 2].tolist() == [20 + max(distance, 1)] * 2


@pytest.mark.parametrize("clearance", [0.0, 3.0])
def test_files_lead_over_the_part(tmp_path, clearance):
    changes = {"candidates": [ACROSS], "constraints": {"clearance": clearance}}
    placement = placed(tmp_path / "out", **changes)
    flight, out = placement.product("flight"), tmp_path / "out"
    surface = NearestSurface(flight.mesh)
    assert surface.query(points(flight.places)).distance.min() < 1e-3  # straight it would collide
    assert [len(each) for each in flight.over] == [1, 2, 2]
    home, first = flight.home, flight.places[0]
    assert flight.over[0].tolist() == [[*home[:2], first[2]]]
    stops = np.concatenate((flight.over[0], flight.way_to(1), flight.way_to(2)[1:-1]))
    away = surface.query(points(stops)).distance.min()
    assert away >= max(clearance, 1e-3)
    assert flight.clearance == (pytest.approx(away, abs=0.01), 1)
    figures = summary(placement)["flight"]
    assert (figures["detours"], figures["blocked"]) == (2, [])
    assert figures["length_m"] == pytest.approx(flight.legs.sum())
    assert flight.legs.sum() == pytest.approx(length_of(home, *stops, home))
    assert "2 legs over the scene" in flight.lines()[0]
    # The files.
    mission = json.loads((out / "flight.plan").read_text())["mission"]
    np.testing.assert_allclose(waypoints(flight, mission), stops[1:], atol=0.01)
    assert mission["items"][-1]["params"][4:] == [*mission["plannedHomePosition"][:2], 0]
    rows = list(csv.DictReader((out / "flight.csv").read_text().splitlines()))
    local = np.array([[float(row[f"{axis}_m"]) for axis in "xyz"] for row in rows])
    np.testing.assert_allclose(local, (home, *stops, home), atol=1e-5)
    assert [int(row["position"] or 0) > 0 for row in rows] == [each in (2, 5) for each in range(9)]
    root = ElementTree.parse(out / "flight.kml").getroot()
    line = next(root.iter(f"{KML}LineString")).findtext(f"{KML}coordinates").split()
    degrees = np.array([each.split(",")[:2] for each in line], float)
    np.testing.assert_allclose(degrees, PLACE.geodetic(local)[:, :2], atol=1e-6)


def test_the_first_leg_leads_over_the_part(tmp_path):
    changes = {
        "flight": PLAN["flight"] | {"home": [40, 0, 0]},
        "candidates": [ACROSS | {"count": 1}],
    }
    opposite = changes | {"flight": changes["flight"] | {"home": [-40, 0, -1]}}
    assert len(placed(**changes).product("flight").over[0]) == 1
    flight = placed(tmp_path / "out", **opposite).product("flight")
    top = flight.mesh.bounds[1, 2] + 1 - flight.home[2]
    items = json.loads((tmp_path / "out/flight.plan").read_text())["mission"]["items"]
    assert items[0]["Altitude"] == pytest.approx(top, abs=1e-3)
    heights = [each["Altitude"] for each in items if each["command"] == 16]
    assert heights == pytest.approx([top, 1.5, top, top], abs=1e-3)
    assert (items[-1]["command"], items[-1]["Altitude"]) == (21, 0)


def test_no_file_is_written_of_a_flight_without_a_way(tmp_path):
    wall = {"name": "wall", "low": [-0.1, -99, -99], "high": [0.1, 99, 99]}
    placement = placed(tmp_path / "out", candidates=[ACROSS], constraints={"keep_out": [wall]})
    assert not list((tmp_path / "out").glob("flight.*"))
    assert summary(placement)["flight"]["blocked"] == [2, 3]
    (line,) = placement.product("flight").unwritten
    assert line.startswith("flight: none is written, the scene or a no-fly zone blocks 2 legs, ")
    assert ", the first to waypoint 2, " in line
    assert "; move the positions, or decrease clearance" in line


@pytest.mark.parametrize(
    ("home", "words"),
    [({}, "give home = [x, y, z] in [flight]"), ({"home": [30, 3, -6]}, "move home")],
)
def test_a_page_says_first_that_no_flight_is_written_and_what_home_lacks(tmp_path, home, words):
    """It was only in the last lines on the flight."""
    lid = {"name": "lid", "low": [-99, -99, -5], "high": [99, 99, 0]}
    flight = {key: value for key, value in PLAN["flight"].items() if key != "home"}
    changes = {"candidates": [ACROSS], "constraints": {"keep_out": [lid]}}
    placed(tmp_path, flight=flight | home, outputs={"page": True}, **changes)
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    first = page[page.index("<ul>") :].partition("</li>")[0]
    assert "flight: none is written, the scene or a no-fly zone blocks" in first
    assert f"; {words}" in first
    assert "Not to be signed: flight fails." in page


class Mounted:
    """Cameras that look straight down, by their poses."""

    def __init__(self, eyes):
        matrices = np.tile(np.diag((1.0, -1, -1, 1)), (len(eyes), 1, 1))
        matrices[:, :3, 3] = eyes
        self.mounted = rc.Poses.of(matrices)


def test_home_is_below_the_waypoint_that_is_flown_first():
    """Whichever of random positions that is: of many flights, not that of the pattern."""
    rng, others = np.random.default_rng(15), 0
    ground = shapes.box((120, 120, 1))
    for _ in range(amount(30, at_night=500)):
        sides = rng.uniform(3, 25, 3)
        tower = shapes.box(sides).moved(translation=(*rng.uniform(-20, 20, 2), sides[2] / 2))
        mesh = Mesh.joined([ground, tower])
        eyes = rng.uniform((-30, -30, 2), (30, 30, 40), (rng.integers(2, 10), 3))
        rows = np.arange(len(eyes))
        space = Airspace(mesh, 0.5)
        flight = flight_of(Mounted(eyes), FlightSection(), space, None, rows)
        assert np.array_equal(flight.home[:2], flight.places[0, :2])
        others += flight.rows[0] != 0
    assert others > 2


def test_home_moves_on_until_its_own_course_begins_above_it():
    """The course from the second home begins elsewhere again."""
    tower = shapes.box((6, 17, 22)).moved(translation=(-11, 16, 11))
    space = Airspace(Mesh.joined([shapes.box((120, 120, 1)), tower]), 0.5)
    eyes = [(-2, -13, 17), (12, 12, 5), (-22, 21, 11), (4, 13, 8), (-2, -11, 12), (-21, -3, 3)]
    eyes = np.array([*eyes, (22, -16, 11), (-17, -25, 36), (30, -2, 15)], np.float64)
    flight = flight_of(Mounted(eyes), FlightSection(), space, None, np.arange(9))
    assert flight.home[:2].tolist() == flight.places[0, :2].tolist() == [-21, -3]
