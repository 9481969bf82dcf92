"""Map of a flight: every waypoint in its place to the scale of the bar, numbers that are readable,
north, and the outline of the surface against the union of its faces."""

from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
from nightly import amount

import rastercov as rc
from rastercov.core.mesh import Mesh, shapes
from rastercov.report.pages import render
from rastercov.report.plan_geometry import outline_from_above
from rastercov.survey.flight import Flight
from rastercov.survey.geo.route import MOST_NUMBERS, route_of
from rastercov.survey.plan_section import FlightSection

LETTER, HEIGHT = 1.7, 2.0
"""Width and height of a digit of the labels, mm."""


def flown(places, home, mesh, blocked=(), **asked):
    """Flight through (N, 3) places, some of whose legs are blocked, from 0."""
    n = len(places)
    over = [np.zeros((0, 3)) for _ in range(n + 1)]
    over[0] = over[-1] = np.array([[*home[:2], home[2] + 5.0]])
    over = [None if row in blocked else each for row, each in enumerate(over)]
    matrices = np.tile(np.eye(4), (n, 1, 1))
    matrices[:, :3, 3] = places
    section = FlightSection(**asked)
    return Flight(section, mesh, None, rc.Poses.of(matrices), np.arange(n), np.array(home), over)


def routes(rng):
    """Places (N, 3) of a random, a steep, a level, a dense or a lone route, in some unit."""
    n = int(rng.choice([1, 2, 3, 30, 61, 400, 1500]))
    places = rng.uniform(-20, 20, (n, 3))
    kind = rng.integers(5)
    if kind == 0:
        places[:, :2] = places[0, :2]
    elif kind == 1:
        places[:, 1] = 3.0
    elif kind == 2:
        places[:, 0] = np.linspace(-20, 20, n)
        places[:, 1] = np.sin(np.arange(n)) * rng.choice([1e-3, 1.0])
    elif kind == 3:
        places[:, :2] = np.round(places[:, :2] / 10) * 10
    return places * rng.choice([1e-3, 1.0, 1e4]) + rng.choice([0.0, 1e6]) * np.array((1, 5, 0))


def drawn(flight):
    """The drawing, its labels (x, y, text), and its scale by the bar, metres a millimetre."""
    root = ElementTree.fromstring(render("route.svg", "rastercov.survey", route=route_of(flight)))
    texts = [(float(each.get("x")), float(each.get("y")), each.text) for each in root.iter("text")]
    *labels, (zero, _, _), (end, _, bar), _ = texts
    return root, labels, float(bar.removesuffix(" m")) / (end - zero)


def multiples(every, n):
    """Numbers of waypoints on the map where every so many have one."""
    return (k for k in range(1, n + 1) if k in (1, n) or k % every == 0)


def lines_of(path):
    """Vertices (N, 2) of each line of a path."""
    lines = [each.split("L") for each in path.get("d").split("M")[1:]]
    return [np.array([list(map(float, xy.split(","))) for xy in line]) for line in lines]


@pytest.mark.parametrize("seed", range(amount(12, at_night=300)))
def test_waypoints_are_on_the_map_to_scale_and_numbers_ascend_without_touching(seed):
    rng = np.random.default_rng(seed)
    places = routes(rng)
    n, extent = len(places), np.ptp(places, axis=0).max() or 1.0
    mesh = shapes.aeroplane().moved(scale=extent / 20, translation=places.mean(axis=0))
    home = places[0] if rng.random() < 0.5 else places[-1] + rng.uniform(-1, 1, 3) * extent
    blocked = set(rng.integers(0, n + 1, rng.integers(3)).tolist())
    flight = flown(places, home, mesh, blocked)
    root, labels, scale = drawn(flight)
    circles = list(root.iter("circle"))
    at = np.array([(float(each.get("cx")), float(each.get("cy"))) for each in circles])
    assert [each.findtext("title").split(":")[0] for each in circles] == [
        str(row + 1) for row in range(n)
    ]
    _, _, *size = map(float, root.get("viewBox").split())
    assert ((at >= 0) & (at <= size)).all()
    np.testing.assert_allclose(
        (at - at[0]) * (scale, -scale), places[:, :2] - places[0, :2], atol=1e-3 * scale
    )
    # Numbers: first, last, every so many; beside their waypoints, and readable.
    assert labels[0][2] == "home"
    numbers = [int(text) for *_, text in labels[1:]]
    usual = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000)
    every = next(k for k in usual if list(multiples(k, n)) == numbers)
    assert len(numbers) <= MOST_NUMBERS + 2
    label = np.array([(x, y - HEIGHT / 2) for x, y, _ in labels])
    away = np.abs(label[1:] - at[np.array(numbers) - 1])
    assert (away <= (12 if every < n else 30)).all()
    width = np.array([LETTER * len(text) for *_, text in labels])
    apart = np.abs(label[:, None] - label)
    is_clear = (apart[..., 0] > (width[:, None] + width) / 2) | (apart[..., 1] > HEIGHT)
    assert (is_clear | np.eye(len(labels), dtype=bool)).all()
    # Legs end at their waypoints.
    items = [line for path in list(root.iter("path"))[2:5] for line in lines_of(path)]
    ends = np.array([(*line[0], *line[-1]) for line in items]).reshape(-1, 4)
    legs = np.hstack((at[:-1], at[1:]))
    legs = legs[np.linalg.norm(legs[:, :2] - legs[:, 2:], axis=1) > 1e-3]
    both = np.concatenate((ends, ends[:, [2, 3, 0, 1]]))
    assert all(np.abs(both - leg).max(axis=1).min() < 1e-3 for leg in legs)
    red = lines_of(list(root.iter("path"))[4])
    own = [flight.way_to(row) for row in blocked]
    assert sum(np.ptp(way[:, :2], axis=0).max() > 0 for way in own) <= len(red) <= len(blocked)


@pytest.mark.parametrize(("side", "every"), [(3, 1), (7, 1), (8, 2), (20, 10), (40, 50)])
def test_as_many_numbers_are_on_the_map_as_have_room(side, every):
    places = np.stack((*np.indices((side, side)), np.full((side, side), 9))).reshape(3, -1).T
    _, labels, _ = drawn(flown(places, (-1.0, -1, 0), shapes.box()))
    assert [int(text) for *_, text in labels[1:]] == list(multiples(every, side**2))


@pytest.mark.parametrize("crs", ["EPSG:32632", "EPSG:4326", "EPSG:32761", None])
def test_the_arrow_points_north_where_it_is_known(crs):
    rng = np.random.default_rng(3)
    origin = {"EPSG:32632": [7e5, 5.3e6], "EPSG:4326": [-33.0, 151.0], "EPSG:32761": [2.3e6, 1.8e6]}
    asked = {} if crs is None else {"crs": crs, "origin": origin[crs]}
    flight = flown(rng.uniform(-20, 20, (5, 3)), (1.0, 2.0, -30.0), shapes.aeroplane(), **asked)
    part = route_of(flight)
    ahead = np.array((part["up"][0], -part["up"][1], 0))
    if crs is None:
        assert (part["up_words"], *ahead.round(12)) == ("y", 0, 1, 0)
        return
    here, there = flight.asked.place.geodetic(flight.home + np.outer((0, 1e3), ahead))
    assert part["up_words"] == "N"
    assert there[1] > here[1]
    assert abs(there[0] - here[0]) * np.cos(np.radians(here[1])) < 1e-3 * (there[1] - here[1])


def surfaces(rng):
    """Boxes, spheres, terrain, crumpled and upright faces, in any direction."""
    x, y = np.indices((12, 12)).reshape(2, -1)
    rows = np.arange(144).reshape(12, 12)
    a, b, c, d = (
        each.ravel() for each in (rows[:-1, :-1], rows[1:, :-1], rows[1:, 1:], rows[:-1, 1:])
    )
    faces = np.concatenate((np.stack((a, b, c), 1), np.stack((a, c, d), 1)))
    sheet = np.column_stack((x, y, rng.normal(0, 1, 144))).astype(float)
    crumpled = sheet + rng.normal(0, 1, (144, 3)) * (1, 1, 0)
    upright = sheet * (1, 0, 1) + y[:, None] * (0, 0, 1)
    made = [shapes.box(), shapes.sphere(2), shapes.aeroplane(), shapes.room()]
    made += [Mesh(each, faces) for each in (sheet, crumpled, upright)]
    some = [made[row] for row in rng.integers(0, len(made), 3)]
    some = [
        each.moved(
            axis=rng.normal(size=3),
            angle_deg=rng.choice([0, 90, rng.uniform(0, 360)]),
            translation=rng.uniform(-3, 3, 3),
        )
        for each in some
    ]
    return Mesh.joined([*some, made[int(rng.integers(len(made)))]])


@pytest.mark.parametrize("seed", range(amount(12, at_night=300)))
def test_a_surface_from_above_is_the_union_of_its_faces(seed):
    mesh = surfaces(np.random.default_rng(seed))
    mesh = mesh.moved(scale=10.0 ** (seed % 5 - 2))
    if seed % 5 > 1 and seed % 2:
        mesh = mesh.moved(translation=(7e5, 5.3e6, 0))
    parts = shapely.polygons(mesh.vertices[mesh.faces][..., :2])
    whole = shapely.union_all(shapely.make_valid(parts))
    difference = outline_from_above(mesh).symmetric_difference(whole)
    assert difference.area <= 1e-4 * whole.area


def test_the_page_of_a_flight_has_its_route(tmp_path):
    """And that of a plan without a flight has none."""
    plan = {
        "meshes": [{"built_in": "box"}],
        "camera": {"width": 60, "height": 40, "fx": 50, "fy": 50},
        "candidates": [{"generator": "orbit", "radius": 5, "heights": [2], "count": 4}],
        "selection": {"goal": "all"},
    }
    placement = rc.place(plan | {"flight": {}}, out=tmp_path / "flown")
    page = (tmp_path / "flown/page.html").read_text()
    assert (
        page.count(
            render(
                "route.svg", "rastercov.survey", route=route_of(placement.product("flight"))
            ).strip()
        )
        == 1
    )
    rc.place(plan, out=tmp_path / "still")
    assert "route" not in (tmp_path / "still/page.html").read_text().partition("<body>")[2][:20_000]
