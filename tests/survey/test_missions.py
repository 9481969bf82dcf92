"""Missions of a flight: within a battery, in its order, the fewest, and each with its own files."""

import csv
from types import SimpleNamespace

import numpy as np
import pytest

import rastercov as rc
from rastercov.placement.plan.legs import Airspace, length_of
from rastercov.survey.flight import flight_of
from rastercov.survey.geo.flight import files_of
from rastercov.survey.geo.route import route_of
from rastercov.survey.plan_section import FlightSection


class Chosen:
    """Cameras that are chosen."""

    def __init__(self, matrices):
        self.mounted = rc.Poses.of(matrices)


def flown(places, mesh, **asked):
    """Flight through (N, 3) places with a camera that looks down."""
    matrices = np.tile(np.diag((1.0, -1.0, -1.0, 1.0)), (len(places), 1, 1))
    matrices[:, :3, 3] = places
    mounts = SimpleNamespace(names=["drone"])
    section = FlightSection(**asked)
    return flight_of(
        Chosen(matrices), section, Airspace(mesh, 0.0, []), mounts, np.arange(len(places))
    )


def seconds(flight, space, first, end):
    """Time of a mission through waypoints first ... end - 1, by its own ways."""
    out, back = (space.from_home(flight.home, flight.places[row]) for row in (first, end - 1))
    stops = [flight.home, *out, *flight.places[first:end], *back[::-1], flight.home]
    way = length_of(*np.array(stops))
    return way / flight.asked.speed + flight.asked.hover * (end - first)


def ground():
    return rc.shapes.box((400, 400, 2), centre=(0, 0, -1))


@pytest.mark.parametrize("seed", range(6))
def test_missions_are_the_fewest_in_the_order_that_a_battery_lasts_for(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 14))
    places = np.column_stack((rng.uniform(-90, 90, (n, 2)), rng.uniform(20, 40, n)))
    asked = {"speed": 5.0, "hover": float(rng.choice([0, 3])), "home": [0.0, 0.0, 0.0]}
    whole = flown(places, ground(), **asked)
    space = Airspace(whole.mesh, 0.0, [])
    alone = max(seconds(whole, space, row, row + 1) for row in range(n))
    limit = float(rng.uniform(alone, max(alone, whole.seconds) * 1.1))
    flight = flown(places, ground(), battery=limit / 60, **asked)
    assert np.array_equal(flight.places, whole.places)
    parts = [(each.first, each.first + len(each.rows)) for each in flight.flown]
    assert [0, *(end for _, end in parts)] == [*(first for first, _ in parts), n]
    for (first, end), each in zip(parts, flight.flown, strict=True):
        assert each.seconds == pytest.approx(seconds(flight, space, first, end))
        assert each.seconds <= limit * (1 + 1e-12)
        assert np.array_equal(each.places, flight.places[first:end])
    fewest = [0] + [n + 1] * n  # for the first waypoints, by all divisions
    for end in range(1, n + 1):
        for first in range(end):
            if seconds(flight, space, first, end) <= limit:
                fewest[end] = min(fewest[end], fewest[first] + 1)
    assert len(parts) == fewest[n]
    assert flight.seconds == pytest.approx(sum(each.seconds for each in flight.flown))
    assert not flight.too_far
    assert not flight.blocked


def test_a_waypoint_beyond_the_battery_leaves_no_files():
    places = [(0, 0, 30), (150, 0, 30), (10, 0, 30)]
    flight = flown(places, ground(), battery=0.5, speed=5.0, home=[0.0, 0.0, 0.0])
    far = [row + 1 for row, place in enumerate(flight.places) if place[0] == 150]
    assert flight.too_far == far
    assert files_of(flight) == {}


def test_each_mission_has_its_files_and_waypoints_keep_their_numbers():
    x, y = np.meshgrid(np.arange(-80, 81, 20.0), np.arange(-80, 81, 40.0), indexing="ij")
    places = np.column_stack((x.ravel(), y.ravel(), np.full(x.size, 30.0)))
    flight = flown(places, ground(), battery=2.0, speed=5.0)
    assert len(flight.missions) > 2
    files = files_of(flight)
    assert list(files) == [f"flight_{n}.csv" for n in range(1, len(flight.missions) + 1)]
    numbers, homes = [], 0
    for content in files.values():
        rows = list(csv.DictReader(content.decode().splitlines()))
        numbers += [int(row["waypoint"]) for row in rows if row["position"]]
        homes += sum(float(row["z_m"]) == flight.home[2] for row in rows)
    assert numbers == list(range(1, len(places) + 1))
    assert homes == 2 * len(flight.missions)
    route = route_of(flight)
    assert route["home_legs"].count("M") == 2 * len(flight.missions)
    assert len(route["waypoints"]) == len(places)
    (one,) = (each for each in [flown(places, ground(), speed=5.0)])
    assert list(files_of(one)) == ["flight.csv"]


@pytest.mark.parametrize("seed", range(5))
def test_lines_that_follow_the_ground_are_those_on_the_map(seed):
    """Each waypoint was a line of its own, because the height of steps differs."""
    rng = np.random.default_rng(seed)
    n_lines, n = rng.integers(2, 5), rng.integers(3, 8)
    across, along = np.meshgrid(np.arange(n_lines) * 20.0, np.arange(n) * 8.0, indexing="ij")
    along[1::2] = along[1::2, ::-1]
    level = np.column_stack((across.ravel(), along.ravel(), np.full(across.size, 30.0)))
    rough = level + np.outer(rng.uniform(0, 12, len(level)), (0, 0, 1))
    lines = [flown(places, ground(), speed=5.0).lines_flown for places in (level, rough)]
    assert lines[0] == lines[1]
    assert [end - first for first, end in lines[1]] == [n] * n_lines


def test_the_page_and_the_answer_list_photographs_and_heights_of_each_mission(tmp_path):
    ground_of = {"built_in": "box", "transform": {"scale": 60, "translation": [0, 0, -30]}}
    strips = {"generator": "strips", "height": 20, "front": 0.3, "side": 0.2}
    strips |= {"polygon": [[-20, -20], [20, -20], [20, 20], [-20, 20]]}
    plan = {
        "meshes": [ground_of], "camera": {"width": 600, "height": 400, "fx": 500, "fy": 500},
        "candidates": [strips], "selection": {"goal": "all"}, "task": {"resolution_of_result": 9.0},
        "flight": {"battery": 0.8, "speed": 5},
    }  # fmt: skip
    placement = rc.place(plan, out=tmp_path / "out")
    flight = placement.product("flight")
    missions = flight.summary()["missions"]
    assert len(missions) == len(flight.missions) > 1
    assert sum(each["images"] for each in missions) == len(flight.rows)
    for each, own in zip(missions, flight.missions, strict=True):
        assert each["images"] == sum(line["images"] for line in each["lines"]) == len(own.rows)
        assert each["above_ground_m"] == pytest.approx([20, 20])
        assert each["z_m"] == pytest.approx([20, 20])
        inner = sum(line["length_m"] for line in each["lines"])
        assert inner < each["length_m"] == pytest.approx(own.legs.sum())
    page = (tmp_path / "out" / "page.html").read_text(encoding="utf-8")
    assert f"{len(missions)} missions" in page
    assert "<p>flight.csv is in local metres" in page  # the name of a file, as it is
    home = ", ".join(f"{value:.2f}" for value in flight.home)
    assert f"at home, ({home}) m" in page
    assert f"Photographs of each of {sum(len(e['lines']) for e in missions)} lines" in page
    text = "\n".join(flight.lines())
    assert f"{len(missions)} missions within 0.8 min of a battery: " in text
