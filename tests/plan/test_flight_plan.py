"""Flight of a plan: its order, its files against its poses, and what QGroundControl expects."""

import csv
import json
import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from nightly import amount
from plans import write_obj
from pydantic import ValidationError
from short_search import short_search  # noqa: F401 # a fixture for every test

import rastercov as rc
from rastercov.core.mesh import Mesh
from rastercov.placement import NearestSurface
from rastercov.placement.candidates.ground import heights_at
from rastercov.placement.georeference import GeoReference
from rastercov.placement.plan.file import PlanError, plan_of
from rastercov.report.plan import lines as plan_lines
from rastercov.report.plan import summary
from rastercov.survey.geo.flight import files_of
from rastercov.survey.plan_section import FlightSection

pytest.importorskip("pyproj", reason="pyproj is missing: pip install 'rastercov[geo]'")
KML = "{http://www.opengis.net/kml/2.2}"
PLACE = GeoReference("EPSG:32632", (700_000.0, 5_300_000.0, 400.0))
STRIPS = {
    "generator": "strips", "height": 10, "front": 0.6, "side": 0.4, "heading_deg": 20,
    "polygon": [[-9, -9], [9, -9], [9, 9], [-9, 9]],
}  # fmt: skip
PLAN = {
    "meshes": [{"built_in": "aeroplane"}],
    "camera": {"width": 600, "height": 400, "fx": 500, "fy": 500},
    "task": {"resolution_of_result": 2.0},
    "candidates": [STRIPS],
    "selection": {"goal": "all"},
    "outputs": {"page": False},
    "flight": {"crs": "EPSG:32632", "origin": [700_000, 5_300_000, 400]},
}
GROUND = {"built_in": "box", "transform": {"scale": 200, "translation": [0, 0, -104]}}
ORBIT = {"generator": "orbit", "radius": 12, "heights": [4, 8], "count": 9}
SIMPLE = {"autoContinue", "command", "doJumpId", "frame", "params", "type"}
AT_PLACE = SIMPLE | {"AMSLAltAboveTerrain", "Altitude", "AltitudeMode"}
KEYS = {
    22: AT_PLACE,
    16: AT_PLACE,
    178: SIMPLE,
    205: SIMPLE,
    206: SIMPLE,
    2000: SIMPLE,
    21: AT_PLACE,
}
"""Keys of the simple items of QGroundControl's own plans, by command."""


def placed(out=None, **changes):
    return rc.place(PLAN | changes, out=out)


def waypoints(flight, mission):
    """Places (N, 3) of the waypoints of a mission, in local metres."""
    from pyproj import Transformer

    way = Transformer.from_crs("EPSG:4326", "EPSG:32632", always_xy=True)
    own = [item["params"][4:] for item in mission["items"] if item["command"] == 16]
    latitude, longitude, height = np.array(own).T
    x, y = way.transform(longitude, latitude)
    x0, y0, _ = PLACE.origin
    return np.stack((x - x0, y - y0, height + flight.home[2]), axis=1)


def flown(flight, mission):
    """Place and pitch of each picture that a vehicle takes, which measures steps on the map."""
    at, images = waypoints(flight, mission), []
    n, step, pitch, left = -1, None, None, 0.0
    for item in mission["items"]:
        if item["command"] == 205:
            pitch = item["params"][0]
            assert item["params"][6] == 2
        elif item["command"] == 16:
            n += 1
            way, done = at[n] - at[n - 1], 0.0
            length = np.linalg.norm(way[:2])
            while step and length - done >= left:
                done += left
                left = step
                images.append((at[n - 1] + way * done / length, pitch))
            left -= length - done
        elif item["command"] == 2000:
            images.append((at[n], pitch))
        elif item["command"] == 206:
            step = left = item["params"][0]
            images += [(at[n], pitch)] if step else []
    return images


@pytest.mark.parametrize("heading", [0.0, 31.0, 90.0])
def test_the_plan_of_qgroundcontrol_follows_the_ground(tmp_path, heading):
    """Over a ridge lines on the map are none through the air."""
    ridge = 400 + 50 * np.exp(-(((np.arange(0.0, 121, 4) - 60) / 20) ** 2))
    mesh = Mesh.terrain(np.broadcast_to(ridge, (21, 31)), 4.0, curvature=False)
    write_obj("ridge.obj", mesh)
    follow = {"generator": "strips", "height": 30.0, "follow": True, "heading_deg": heading}
    own = [[10, -70], [110, -70], [110, -10], [10, -10]]
    placement = placed(
        tmp_path / "out",
        meshes=[{"path": "ridge.obj"}],
        candidates=[follow | {"polygon": own}],
    )
    flight = placement.product("flight")
    assert np.ptp(flight.places[:, 2]) > 30
    images = flown(flight, json.loads((tmp_path / "out/flight.plan").read_text())["mission"])
    assert len(images) == len(flight.places)
    np.testing.assert_allclose([eye for eye, _ in images], flight.places, atol=0.1)


def test_waypoints_beside_the_surface_are_counted():
    wide = STRIPS | {"front": 0.4, "side": 0.2}
    wide |= {"polygon": [[-30, -5], [30, -5], [30, 5], [-30, 5]]}
    placement = placed(candidates=[wide])
    flight = placement.product("flight")
    x = np.abs(flight.places[:, 0])
    assert (x > 20).sum() <= flight.n_beside < len(x)
    assert summary(placement)["flight"]["beside_surface"] == flight.n_beside
    (line,) = (line for line in flight.lines() if "beside the surface" in line)
    assert line.startswith(f"{flight.n_beside} of {len(x)} waypoints look down beside the surface")
    over = placed(meshes=[*PLAN["meshes"], GROUND], candidates=[STRIPS, ORBIT]).product("flight")
    assert over.n_beside == 0
    assert not any("beside the surface" in note for note in over.notes)


@pytest.mark.parametrize("hover", [0.0, 2.0])
def test_the_plan_of_qgroundcontrol_has_its_fields_and_flies_the_poses(tmp_path, hover):
    asked = PLAN["flight"] | {"hover": hover}
    placement = placed(tmp_path / "out", candidates=[STRIPS, ORBIT], flight=asked)
    flight = placement.product("flight")
    whole = json.loads((tmp_path / "out/flight.plan").read_text())
    assert {name: type(value) for name, value in whole.items()} == {
        "fileType": str, "geoFence": dict, "groundStation": str, "mission": dict,
        "rallyPoints": dict, "version": int,
    }  # fmt: skip
    assert (whole["fileType"], whole["version"]) == ("Plan", 1)
    assert whole["geoFence"] == {"circles": [], "polygons": [], "version": 2}
    assert whole["rallyPoints"] == {"points": [], "version": 2}
    mission = whole["mission"]
    assert mission.keys() == {
        "cruiseSpeed", "firmwareType", "globalPlanAltitudeMode", "hoverSpeed", "items",
        "plannedHomePosition", "vehicleType", "version",
    }  # fmt: skip
    assert (mission["version"], mission["vehicleType"], mission["firmwareType"]) == (2, 2, 12)
    for row, item in enumerate(mission["items"]):
        assert item.keys() == KEYS[item["command"]]
        assert (item["doJumpId"], item["type"], len(item["params"])) == (row + 1, "SimpleItem", 7)
        assert item["frame"] == (3 if "Altitude" in item else 2)
        if "Altitude" in item:
            assert (item["AltitudeMode"], item["params"][6]) == (1, item["Altitude"])
    commands = [item["command"] for item in mission["items"]]
    assert (commands[0], commands[-1]) == (22, 21)
    images = flown(flight, mission)
    assert len(images) == len(flight.rows) == len(placement.cameras.mounted)
    np.testing.assert_allclose([eye for eye, _ in images], flight.places, atol=0.03)
    np.testing.assert_allclose([pitch for _, pitch in images], flight.views[1], atol=0.01)
    assert (206 in commands) == (hover == 0)
    assert {item["params"][0] for item in mission["items"] if item["command"] == 16} >= {hover}


def test_headings_turn_with_the_meridian(tmp_path):
    flight = placed().product("flight")
    at = PLACE.geodetic(flight.places[:1])[0]
    convergence = np.degrees(np.tan(np.radians(at[0] - 9)) * np.sin(np.radians(at[1])))
    turned = (flight.headings_deg - 20 + 90) % 180 - 90  # to and fro
    np.testing.assert_allclose(turned, convergence, atol=0.05)
    assert convergence > 1.5


def test_csv_and_kml_have_every_pose_in_order(tmp_path):
    placement = placed(tmp_path / "out", candidates=[ORBIT])
    flight, poses = (
        placement.product("flight"),
        json.loads((tmp_path / "out/poses.json").read_text()),
    )
    text = (tmp_path / "out/flight.csv").read_text()
    whole = list(csv.DictReader(text.splitlines()))
    rows = [row for row in whole if row["position"]]
    assert [int(row["waypoint"]) for row in rows] == list(range(1, 19))
    for row, eye in zip(rows, flight.places, strict=True):
        matrix = np.array(poses["world_from_camera"][int(row["position"]) - 1])
        local = [float(row[f"{axis}_m"]) for axis in "xyz"]
        np.testing.assert_allclose(local, eye, atol=1e-6)
        np.testing.assert_allclose(local, matrix[:3, 3], atol=1e-6)
        pitch = np.degrees(np.arcsin(matrix[2, 2]))
        assert float(row["pitch_deg"]) == pytest.approx(pitch, abs=1e-3)
        degrees = [float(row[name]) for name in ("longitude", "latitude", "height_m")]
        np.testing.assert_allclose(degrees, PLACE.geodetic(eye[None])[0], atol=1e-3)
    legs = np.array([float(row["leg_m"]) for row in whole if row["leg_m"]])
    np.testing.assert_allclose(legs, flight.legs, atol=1e-3)
    root = ElementTree.parse(tmp_path / "out/flight.kml").getroot()
    points = [each.findtext(f"{KML}coordinates") for each in root.iter(f"{KML}Point")]
    line = next(root.iter(f"{KML}LineString")).findtext(f"{KML}coordinates")
    ends = line.split(" ")
    assert [each.rsplit(",", 1)[0] for each in ends[2:-2]] == [
        each.rsplit(",", 1)[0] for each in points
    ]
    assert ends[0] == ends[-1]
    first = list(map(float, points[0].split(",")))
    assert first[:2] == pytest.approx([float(rows[0]["longitude"]), float(rows[0]["latitude"])])


def test_the_flight_is_audited_by_its_footprints(tmp_path):
    placement = placed(meshes=[*PLAN["meshes"], GROUND])
    figures = summary(placement)["flight"]
    assert figures["waypoints"] == figures["images"] == len(placement.cameras.placed)
    assert sorted(figures["order"]) == list(range(figures["waypoints"]))
    assert figures["front_percent"] >= 60 - 1e-6  # less where the aeroplane hides the ground
    assert figures["side_percent"] >= 40 - 1e-6
    assert 0 < figures["front_least_percent"] < figures["front_percent"]
    assert figures["length_m"] == pytest.approx(placement.product("flight").legs.sum())
    assert figures["duration_s"] == pytest.approx(figures["length_m"] / 5)
    lines = placement.product("flight").lines()
    assert lines[0].startswith(f"flight: {figures['waypoints']} waypoints")
    assert "GSD" in lines[1]
    assert "median overlap: front 76.5 % (least 52.6 %), side 69.6 % (least " in lines[1]
    without = placed()
    assert summary(without)["flight"]["front_percent"] is None
    assert (
        "overlap unknown, as each image of a strip reaches the edge"
        in without.product("flight").lines()[1]
    )


def test_a_shorter_order_is_flown_where_there_is_one():
    apart = [{**ORBIT, "heights": [4.0, 30.0, 5.0, 29.0, 6.0], "count": 4}]
    flight = placed(candidates=apart).product("flight")
    by_pattern = np.argsort(flight.rows)
    assert flight.legs.sum() < 0.8 * lengths(flight.places[by_pattern], flight.home)


def lengths(places, home):
    stops = np.concatenate((home[None], places, home[None]))
    return np.linalg.norm(np.diff(stops, axis=0), axis=1).sum()


def test_legs_through_the_part_are_seen():
    wall = Mesh(
        [(-1, -20, -20), (-1, 20, -20), (-1, 20, 20), (-1, -20, 20)], [(0, 1, 2), (0, 2, 3)]
    )
    flight = placed(candidates=[{**ORBIT, "count": 2, "heights": [9]}]).product("flight")
    other = replace(flight, mesh=wall)
    assert other.clearance == (pytest.approx(0, abs=2e-3), 1)
    # Against points of the leg.
    share = np.linspace(0, 1, 2001)[:, None]
    points = (1 - share) * flight.places[0] + share * flight.places[1]
    away = NearestSurface(flight.mesh).query(points).distance.min()
    assert flight.clearance[0] == pytest.approx(away, rel=0.02)


def test_rigs_of_different_cameras_fly_as_one():
    cameras = {
        "small": {"width": 300, "height": 200, "fx": 250, "fy": 250},
        "wide": {"width": 400, "height": 400, "fx": 150, "fy": 150, "model": "opencv_fisheye",
                 "distortion": [0, 0, 0, 0], "max_angle_deg": 70},
    }  # fmt: skip
    rig = {"cameras": [{"camera": "small"}, {"camera": "wide", "translation": [0.1, 0, 0]}]}
    plan = {name: value for name, value in PLAN.items() if name != "camera"}
    plan |= {"cameras": cameras, "rigs": {"pair": rig}, "meshes": [GROUND]}
    placement = rc.place(plan)
    figures = summary(placement)["flight"]
    assert figures["images"] == 2 * figures["waypoints"]
    assert figures["front_least_percent"] >= 60 - 1e-3  # borders of fisheyes are chords


def test_without_a_crs_only_local_files_are_written(tmp_path):
    placement = placed(tmp_path / "out", flight={"speed": 3.0})
    names = {path.name for path in (tmp_path / "out").glob("flight.*")}
    assert names == {"flight.csv"}
    assert "local metres" in placement.product("flight").lines()[-1]
    header = (tmp_path / "out/flight.csv").read_text().splitlines()[0]
    assert header.endswith("leg_m")


def test_goal_all_takes_every_candidate():
    placement = placed(flight={})
    n = len(placement.prepared.pool.candidates)
    assert placement.selection.chosen.tolist() == list(range(n))  # in the order of the patterns
    assert (np.diff(placement.selection.curve) >= 0).all()
    assert placement.selection.curve[-1] == placement.selection.share
    assert placement.selection.status == "optimal"


def test_a_flight_far_from_where_its_crs_is_used_is_refused(tmp_path):
    """A local scene without an origin; one in coordinates of the CRS has none."""
    with pytest.raises(PlanError, match=r"flight\.origin: expected an origin with WGS 84 / UTM"):
        rc.place(PLAN | {"flight": {"crs": "EPSG:32632"}}, out=tmp_path)
    assert not list(tmp_path.glob("flight*"))


def test_heights_of_kml_are_of_the_ground_or_absolute(tmp_path):
    """Each point of the file is where it is flown; none is above a ground that is not there."""
    out = tmp_path / "out"
    flight = placed(out, candidates=[ORBIT]).product("flight")
    root = ElementTree.parse(out / "flight.kml").getroot()
    way = np.concatenate([flight.home[None], *(flight.way_to(row)[1:]
                          for row in range(len(flight.legs)))])  # fmt: skip
    points = [*flight.places[:, None], way]
    shapes = [*root.iter(f"{KML}Point"), *root.iter(f"{KML}LineString")]
    modes = [each.findtext(f"{KML}altitudeMode") for each in shapes]
    for shape, mode, own in zip(shapes, modes, points, strict=True):
        words = shape.findtext(f"{KML}coordinates").split()
        heights = np.array([float(each.split(",")[2]) for each in words])
        ground = heights_at(flight.mesh, own[:, :2])
        assert (mode == "absolute") == np.isnan(ground).any()
        above = PLACE.geodetic(own)[:, 2] if mode == "absolute" else own[:, 2] - ground
        np.testing.assert_allclose(heights, above, atol=1e-3)
    assert set(modes) == {"absolute", "relativeToGround"}


def test_home_may_be_given():
    given = placed(candidates=[ORBIT], flight=PLAN["flight"] | {"home": [0, -30, -5]}).product(
        "flight"
    )
    assert given.home.tolist() == [0, -30, -5]
    assert given.blocked == []
    for above in (30.0, 0.5, -30.0):
        own = {"mesh": rc.shapes.box((300, 300, 2)), "home": np.array((0.0, -30, 1 + above))}
        moved = replace(given, **own)
        told = (
            f"home, for take-off and landing, is {above:.3g} m above the surface below; its height"
        )
        assert any(each.startswith(told) for each in moved.notes) == (abs(above) > 1)


def test_the_result_says_at_which_ground_a_gsd_holds():
    own = {k: v for k, v in STRIPS.items() if k != "height"} | {"gsd": 0.02}
    for changes, words in (
        ({}, "gsd of strips, 20 mm/px, holds at the mean height of the ground, "),
        ({"follow": True}, "gsd of strips, 20 mm/px, holds at the height of the ground below each"),
    ):
        placement = placed(candidates=[own | changes], meshes=[*PLAN["meshes"], GROUND])
        (line,) = (each for each in plan_lines(placement, 0) if each.startswith("gsd of"))
        assert line.startswith(words)
        if not changes:
            level = float(line.split()[-2])
            eyes = placement.product("flight").places
            assert eyes[:, 2] == pytest.approx(level + 0.02 * 500, abs=1e-2)


HOSTILE = [0, 5e5, 5.3e6, -4e7, 1e9, -1e9, 1e12, 1e18, 1e30, 1e300, 89.9999, -180, 5e-324]
SYSTEMS = ["EPSG:32632", "EPSG:3857", "EPSG:2056", "EPSG:4326", "EPSG:32761", "+proj=geos +h=3.6e7"]


def test_every_number_of_every_file_is_finite_or_nothing_is_written():
    """Of flights at random and hostile origins, and of scenes in other units than metres."""
    known, rng, n_written = (
        placed(candidates=[ORBIT]).product("flight"),
        np.random.default_rng(14),
        0,
    )
    for _ in range(amount(20, at_night=2000)):
        origin = rng.choice(HOSTILE, 3) * rng.choice((1, -1, 0.9), 3)
        if rng.random() < 0.4:
            origin = np.array((7e5, 5.3e6, 400)) * rng.uniform(0.9, 1.1, 3)
        scale = rng.choice((1, 1, 1e3, 1e6, 1e9, 1e150))
        matrices = known.poses.world_from_camera.copy()
        matrices[:, :3, 3] *= scale
        try:
            asked = FlightSection(crs=str(rng.choice(SYSTEMS)), origin=origin.tolist())
            poses = rc.Poses.of(matrices, camera=known.poses.camera)
            own = {"mesh": known.mesh.moved(scale=scale), "poses": poses}
            files = files_of(replace(known, asked=asked, home=known.home * scale, **own))
        except (rc.RastercovError, ValidationError):
            continue
        n_written += 1
        for content in files.values():
            words = re.split(rb"[\s,:<>\[\]{}\"]+", content.lower())
            assert not {each.strip(b"+-") for each in words} & {b"nan", b"inf", b"infinity"}
        for item in json.loads(files["flight.plan"])["mission"]["items"]:
            assert all(each is None or np.isfinite(each) for each in item["params"])
            assert None not in item["params"][4:]
        rows = csv.DictReader(files["flight.csv"].decode().splitlines())
        for row in rows:
            assert abs(float(row["latitude"])) <= 90
            assert abs(float(row["longitude"])) <= 180
            assert np.isfinite(float(row["height_m"]))
    assert n_written > 2


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"flight": PLAN["flight"] | {"origin": [1e9, 1e9]}}, "flight.origin: expected places on"),
        ({"flight": PLAN["flight"] | {"home": [3e7, 0, 0]}}, "flight: expected a scene of up to"),
        ({"flight": PLAN["flight"] | {"home": [9e5, 9e5, 0], "origin": [9e5, 9e6]}}, "flight.orig"),
        (
            {"meshes": [{"built_in": "aeroplane", "transform": {"scale": 1e6}}]},
            r"flight.origin: expected a scene of up to 1,000 km on a map, got .* km; correct its",
        ),
        (
            {"meshes": [{"built_in": "aeroplane", "transform": {"scale": 1e6}}],
             "flight": {"crs": "EPSG:4326", "origin": [47, 8]}},
            r"flight.origin: expected a scene of up to 1,000 km on a map",
        ),
        (
            {"flight": {"crs": "EPSG:3857", "origin": [1e6, 6e6]}},
            r"expected a map with the lengths of the ground, got 'EPSG:3857', with 1\.4\d times",
        ),
    ],
)  # fmt: skip
def test_a_flight_that_is_on_no_map_is_refused_and_nothing_is_written(tmp_path, changes, words):
    with pytest.raises(rc.RastercovError, match=words):
        placed(tmp_path / "out", **changes)
    assert not list(tmp_path.rglob("flight*"))
    assert not list(tmp_path.rglob("plan.json"))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"flight": {"origin": [1, 2]}}, "expected crs with origin, got none"),
        ({"flight": {"crs": "EPSG:99999"}}, "expected a CRS, got 'EPSG:99999'"),
        ({"flight": {"speed": 0}}, "flight.speed: expected a number above 0"),
        ({"candidates": [{"generator": "strips"}]}, "expected one of height, gsd, got none"),
        ({"candidates": [{"generator": "facade", "gsd": 1, "distance": 1}]}, "exactly one"),
        ({"candidates": [{**ORBIT, "front": 1.0}]}, "front: expected a number below 1"),
        ({"selection": {"goal": "all", "refine": True}}, "expected neither refine nor optimise"),
    ],
)
def test_wrong_entries_are_refused(changes, words):
    with pytest.raises(PlanError, match=words):
        plan_of(PLAN | changes)
