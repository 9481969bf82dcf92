"""Place of a scene on the Earth: transformations against their equations, files of programs."""

import json
import math

import numpy as np
import pytest

import rastercov as rc
from rastercov.base.errors import ConfigError
from rastercov.core.mesh import Mesh
from rastercov.placement.georeference import GeoReference, given_reference, reference_of

pyproj = pytest.importorskip("pyproj", reason="pyproj is missing: pip install 'rastercov[geo]'")
A, F = 6378137.0, 1 / 298.257223563
POINTS = np.array([(0.0, 0, 0), (120, -40, 7), (-3000, 5000, 250)])


def geocentric(latitude, longitude, height):
    """Earth-centred coordinates on the ellipsoid of WGS 84."""
    phi, lam, e2 = math.radians(latitude), math.radians(longitude), F * (2 - F)
    n = A / math.sqrt(1 - e2 * math.sin(phi) ** 2)
    return np.array([
        (n + height) * math.cos(phi) * math.cos(lam),
        (n + height) * math.cos(phi) * math.sin(lam),
        (n * (1 - e2) + height) * math.sin(phi),
    ])  # fmt: skip


def axes(latitude, longitude):
    """Rows: east, north and up."""
    phi, lam = math.radians(latitude), math.radians(longitude)
    return np.array([
        (-math.sin(lam), math.cos(lam), 0),
        (-math.sin(phi) * math.cos(lam), -math.sin(phi) * math.sin(lam), math.cos(phi)),
        (math.cos(phi) * math.cos(lam), math.cos(phi) * math.sin(lam), math.sin(phi)),
    ])  # fmt: skip


@pytest.mark.parametrize("at", [(47.3, 8.5, 410.0), (-33.5, 151.2, 0.0), (69.6, -178.9, 12.0)])
def test_a_tangent_frame_is_east_north_up(at):
    geodetic = GeoReference("EPSG:4326", at).geodetic(POINTS)
    for (longitude, latitude, height), local in zip(geodetic, POINTS, strict=True):
        away = axes(*at[:2]) @ (geocentric(latitude, longitude, height) - geocentric(*at))
        np.testing.assert_allclose(away, local, atol=1e-6)


def test_a_projected_crs_adds_its_origin():
    place = GeoReference("EPSG:32632", (5e5, 5.3e6, 400.0))
    np.testing.assert_allclose(place.on_map(POINTS), POINTS + np.array((5e5, 5.3e6, 400.0)))
    way = pyproj.Transformer.from_crs("EPSG:32632", "EPSG:4326", always_xy=True)
    wanted = np.stack(way.transform(*(POINTS[:, :2] + (5e5, 5.3e6)).T), axis=1)
    np.testing.assert_allclose(place.geodetic(POINTS)[:, :2], wanted, rtol=1e-12)
    assert (place.epsg, place.words) == (32632, "WGS 84 / UTM zone 32N (EPSG:32632)")


@pytest.mark.parametrize(
    ("origin", "first", "words"),
    [
        ((5e5, 5.3e6), (0, 0), ""),
        ((0, 0), (5e5, 5.3e6), ""),
        ((9.5e5, 5.3e6), (0, 0), ""),  # of the next zone
        ((0, 0), (0, 0), "expected an origin with ETRS89 / UTM zone 32N"),
        ((5e5, 5.3e6), (5e5, 5.3e6), "got longitude 149.2, latitude 83; correct"),
        ((5.3e6, 5e5), (0, 0), "where 'EPSG:25832' is used, got longitude 48.62"),
    ],
)
def test_a_scene_far_from_where_its_crs_is_used_is_refused(origin, first, words):
    """Without an origin, twice with it, and with easting and northing exchanged."""
    place = GeoReference("EPSG:25832", (*origin, 0.0))
    bounds = np.array([(0, 0, 400), (240, 180, 440)]) + np.array((*first, 0))
    if not words:
        place.check_scene(bounds)
        return
    with pytest.raises(ConfigError) as error:
        place.check_scene(bounds)
    assert words in str(error.value)
    assert len(str(error.value)) <= 160


def test_scenes_beside_the_antimeridian_and_in_a_crs_of_their_own_are_not_refused():
    bounds = np.array([(-200.0, -200, 0), (200, 200, 10)])
    for zone in (32601, 32660):
        GeoReference(f"EPSG:{zone}", (5e5, 5.3e6, 0.0)).check_scene(bounds)
    GeoReference("+proj=tmerc +lat_0=48 +lon_0=11 +units=m").check_scene(bounds)
    GeoReference("EPSG:4326", (0.0, 11.0, 0.0)).check_scene(bounds)


@pytest.mark.parametrize("crs", ["EPSG:4326", "EPSG:4979", "EPSG:4258", "+proj=longlat"])
@pytest.mark.parametrize("away", [0.0, 5e5])
def test_a_geographic_crs_needs_an_origin_wherever_the_scene_is(crs, away):
    bounds = np.add([(-200.0, -200, 0), (200, 200, 10)], (away, 0, 0))
    with pytest.raises(ConfigError, match="expected an origin with"):
        GeoReference(crs).check_scene(bounds)
    GeoReference(crs, (48.0, 11.0, 0.0)).check_scene(bounds)


def test_the_zone_of_a_map_is_that_of_the_origin():
    for latitude, longitude, code in ((47, 8.5, 32632), (-33, 151, 32756), (0.1, -179.9, 32601)):
        assert GeoReference("EPSG:4326", (latitude, longitude, 0.0)).epsg == code


def test_headings_are_from_true_north():
    place = GeoReference("EPSG:32632", (700_000.0, 5_300_000.0, 0.0))  # east of the meridian
    longitude, latitude, _ = place.geodetic(np.zeros((1, 3)))[0]
    convergence = math.degrees(
        math.atan(math.tan(math.radians(longitude - 9)) * math.sin(math.radians(latitude)))
    )
    north = place.headings_deg(np.zeros((1, 3)), np.array([(0, 10.0, 0)]))[0]
    assert north == pytest.approx(convergence, abs=0.02)
    assert convergence > 1.5


def test_earth_centred_scenes_are_levelled():
    at = (47.0, 8.0, 400.0)
    corners = POINTS @ axes(*at[:2]) + geocentric(*at)
    mesh, poses = Mesh(corners, [(0, 1, 2)]), rc.Poses.of(rc.look_at(corners[:1] + 1.0, corners[1]))
    place, level, placed = GeoReference("EPSG:32632", is_geocentric=True).level(mesh, poses)
    np.testing.assert_allclose(
        place.geodetic(level.vertices), GeoReference("EPSG:4326", at).geodetic(POINTS), atol=1e-5
    )
    assert (place.epsg, len(placed)) == (32632, 1)
    # The scene is moved as a whole: cameras see the same.
    first, second = (
        (scene.vertices - own.world_from_camera[0, :3, 3]) @ own.world_from_camera[0, :3, :3]
        for scene, own in ((mesh, poses), (level, placed))
    )
    np.testing.assert_allclose(second, first, atol=1e-6)


def test_odm_and_opensfm_state_their_place(tmp_path):
    folder, coords = tmp_path / "opensfm", tmp_path / "odm_georeferencing" / "coords.txt"
    folder.mkdir()
    coords.parent.mkdir()
    (folder / "reconstruction.json").write_text('[{"cameras": {}, "shots": {}}]')
    assert reference_of(folder) is None
    lla = {"latitude": 47.1, "longitude": 8.2, "altitude": 300.0}
    (folder / "reconstruction.json").write_text(json.dumps([{"reference_lla": lla}]))
    assert reference_of(folder).origin == (47.1, 8.2, 300.0)
    (folder / "reference_lla.json").write_text(json.dumps(lla | {"altitude": 0.0}))
    assert reference_of(folder / "reconstruction.json").origin == (47.1, 8.2, 0.0)
    coords.write_text("WGS84 UTM 17N\n322263 5157982\n1.0 2.0 3.0\n")
    assert reference_of(folder).crs == "EPSG:4326"  # still in the tangent frame
    (folder / "reconstruction.topocentric.json").write_text("[]")
    reference = reference_of(folder)
    assert (reference.crs, reference.origin) == ("EPSG:32617", (322263.0, 5157982.0, 0.0))
    assert reference_of(folder / "reconstruction.topocentric.json").crs == "EPSG:4326"
    assert reference_of(tmp_path / "rig.json") is None
    shots = reference_of(tmp_path / "odm_report" / "shots.geojson")
    assert (shots.crs, shots.origin) == ("EPSG:32617", (0.0, 0.0, 0.0))  # of whole coordinates
    coords.unlink()
    assert reference_of(tmp_path / "odm_report" / "shots.geojson") is None


def test_metashape_states_its_crs(tmp_path):
    file = tmp_path / "cameras.xml"
    chunk = "<document><chunk enabled='true'><reference>{}</reference></chunk></document>"
    file.write_text(chunk.format(pyproj.CRS.from_epsg(32633).to_wkt("WKT1_GDAL")))
    reference = reference_of(file)
    assert (reference.is_geocentric, reference.epsg) == (True, 32633)
    file.write_text(chunk.format('LOCAL_CS["Local Coordinates (m)",UNIT["metre",1]]'))
    assert reference_of(file) is None


@pytest.mark.parametrize(
    ("crs", "origin", "words"),
    [
        ("EPSG:99999", None, "expected a CRS, got 'EPSG:99999'"),
        ("EPSG:2263", None, "expected a CRS in metres"),
        ("EPSG:4978", None, "expected a projected or geographic CRS"),
        ("EPSG:4326", "151,-120", "expected a latitude and longitude"),
        ("EPSG:32632", "1;2", "--origin: expected 2 or 3 numbers"),
        ("EPSG:32632", "1,nan", "--origin: expected 2 or 3 numbers"),
        (None, "1,2", "expected --crs with --origin"),
    ],
)
def test_what_is_no_place_is_refused(crs, origin, words):
    with pytest.raises(ConfigError, match=words):
        given_reference(crs, origin)


def test_options_are_a_place():
    assert given_reference(None, None) is None
    assert given_reference("EPSG:32632", "5e5, 5.3e6").origin == (5e5, 5.3e6, 0.0)
    assert given_reference("EPSG:32632", None).origin == (0.0, 0.0, 0.0)
