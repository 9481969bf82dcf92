"""Footprints in files: equal polygons in every format, and a map that counts them."""

import io
import json
import sqlite3
from contextlib import closing
from dataclasses import replace
from xml.etree import ElementTree

import ezdxf
import numpy as np
import pytest
import shapely
import shapely.geometry
from PIL import Image
from terrain import CAMERAS, images, site

from rastercov.base.errors import ConfigError
from rastercov.core.coverage.task import Task
from rastercov.placement.footprints import footprints
from rastercov.placement.georeference import GeoReference
from rastercov.survey.geo import FORMATS, check
from rastercov.survey.geo.layer import Layer
from rastercov.survey.geo.overlap_map import overlap_map, write

pytest.importorskip("pyproj", reason="pyproj is missing: pip install 'rastercov[geo]'")
NAMES = ("a & <b>.jpg", "b.jpg", "c.jpg", "d.jpg")
PLACES = {
    "local": None,
    "UTM": GeoReference("EPSG:32632", (500_000.0, 5_300_000.0, 400.0)),
    "tangent": GeoReference("EPSG:4326", (-33.5, 151.0, 20.0)),
}
KML = "{http://www.opengis.net/kml/2.2}"


@pytest.fixture(scope="module")
def result():
    return footprints(site(), CAMERAS, images(), Task(), names=NAMES)


@pytest.fixture(params=PLACES)
def layer(request, result):
    return Layer(result, PLACES[request.param])


def test_geojson_is_what_shapely_reads_it_as(layer):
    whole = json.loads(FORMATS[".geojson"](layer))
    shapes = [shapely.geometry.shape(each["geometry"]) for each in whole["features"]]
    wanted = layer.on_map if layer.place is None else layer.geodetic
    assert shapely.is_valid(shapes).all()
    assert shapely.equals_exact(shapely.normalize(shapes), shapely.normalize(wanted), 1e-9).all()
    assert [each["properties"]["name"] for each in whole["features"]] == list(NAMES)
    assert whole.get("crs", "WGS 84") == ("WGS 84" if layer.place else None)
    for shape in shapes:  # the right-hand rule of RFC 7946
        assert all(part.exterior.is_ccw for part in shape.geoms)
        assert not any(hole.is_ccw for part in shape.geoms for hole in part.interiors)


def test_degrees_and_metres_are_of_the_same_place(layer):
    if layer.place is None:
        return
    from pyproj import Transformer

    way = Transformer.from_crs("EPSG:4326", layer.place.map_crs, always_xy=True)
    for degrees, metres in zip(layer.geodetic, layer.on_map, strict=True):
        corners = shapely.get_coordinates(degrees)
        back = np.stack(way.transform(*corners.T), axis=1)
        at = shapely.distance(shapely.boundary(metres), shapely.points(back))
        assert at.max(initial=0) < 1e-3
    assert shapely.area(layer.on_map) == pytest.approx(layer.found.area_m2, rel=1e-3)


def rings(text):
    return shapely.Polygon([[float(x) for x in each.split(",")] for each in text.split()])


@pytest.mark.parametrize("longitude", [180.0, -180.0, 179.9999])
def test_a_footprint_across_the_date_line_has_a_part_on_each_side(result, longitude):
    place = GeoReference("EPSG:4326", (-17.0, longitude, 0.0))
    polygons = Layer(result, place).geodetic
    beside = Layer(result, GeoReference("EPSG:4326", (-17.0, longitude - 1, 0.0))).geodetic
    assert shapely.area(polygons) == pytest.approx(shapely.area(beside), rel=1e-5)
    parts = shapely.get_parts(polygons)
    assert (np.abs(shapely.bounds(parts)[:, [0, 2]]) > 179.99).all()
    assert {*np.sign(shapely.bounds(parts)[:, 0]).tolist()} == {-1, 1}
    assert all(part.exterior.is_ccw for part in parts)


@pytest.mark.parametrize("latitude", [90.0, -90.0, 89.9996])
def test_a_footprint_at_a_pole_is_refused_in_degrees_in_one_line(result, latitude):
    layer = Layer(result, GeoReference("EPSG:4326", (latitude, 0.0, 0.0)))
    with pytest.raises(ConfigError, match=r"got one at a pole; write a \.dxf"):
        FORMATS[".kml"](layer)
    assert FORMATS[".dxf"](layer)


def test_a_hole_that_nearly_touches_a_side_may_cross_it_in_degrees(result):
    """A side of 200 km is a chord in degrees, 100 m beside the corners between its ends."""
    ring = [(-1e5, 0), (1e5, 0), (1e5, 1e5), (-1e5, 1e5)]
    hole = [(-100, 99_999), (0, 99_500), (100, 99_999)]
    polygon = shapely.multipolygons([shapely.Polygon(ring, [hole])])
    one = replace(result, polygons=np.array([polygon, None], object)[:1], height=np.zeros(1))
    (moved,) = Layer(one, GeoReference("EPSG:32632", (500_000.0, 7_000_000.0, 0.0))).geodetic
    assert moved.is_valid
    assert moved.area > 0


def test_kml_has_the_rings_of_geojson(layer):
    if layer.place is None:
        with pytest.raises(ConfigError, match="expected a CRS for KML, got local coordinates"):
            FORMATS[".kml"](layer)
        return
    marks = ElementTree.fromstring(FORMATS[".kml"](layer)).iter(f"{KML}Placemark")
    for mark, polygon, name in zip(marks, layer.geodetic, NAMES, strict=True):
        assert mark.findtext(f"{KML}name") == name
        outer = [
            each.findtext(f".//{KML}coordinates") for each in mark.iter(f"{KML}outerBoundaryIs")
        ]
        inner = [
            each.findtext(f".//{KML}coordinates") for each in mark.iter(f"{KML}innerBoundaryIs")
        ]
        area = sum(rings(each).area for each in outer) - sum(rings(each).area for each in inner)
        assert area == pytest.approx(polygon.area, rel=1e-9)


def test_names_beyond_xml_and_utf_8_are_in_kml(result):
    names = tuple(f"{name}\x01\udcff" for name in NAMES)
    place = next(each for each in PLACES.values() if each)
    text = FORMATS[".kml"](Layer(replace(result, names=names), place))
    marks = ElementTree.fromstring(text).iter(f"{KML}Placemark")
    assert [mark.findtext(f"{KML}name") for mark in marks] == [f"{name}??" for name in NAMES]


def test_dxf_has_the_rings_on_the_map(layer):
    drawing = ezdxf.read(io.StringIO(FORMATS[".dxf"](layer).decode()))
    areas = {"FOOTPRINTS": 0.0, "FOOTPRINT_HOLES": 0.0}
    for line in drawing.modelspace().query("LWPOLYLINE"):
        assert line.closed
        areas[line.dxf.layer] += shapely.Polygon([x[:2] for x in line.get_points()]).area
    outer, inner = areas.values()
    assert outer - inner == pytest.approx(shapely.area(layer.on_map).sum(), rel=1e-9)
    assert inner > 0
    assert {each.dxf.text for each in drawing.modelspace().query("TEXT")} == set(NAMES)
    assert drawing.units == 6  # metres


def dxf_entities(text):
    """Entities of a DXF file, each its kind and (code, value) pairs, and its unit."""
    lines = text.split("\n")
    pairs = [
        (int(code), value.strip()) for code, value in zip(lines[::2], lines[1::2], strict=False)
    ]
    unit = pairs[pairs.index((9, "$INSUNITS")) + 1]
    start = pairs.index((2, "ENTITIES")) + 1
    items = []
    for code, value in pairs[start : pairs.index((0, "ENDSEC"), start)]:
        if code == 0:
            items.append((value, []))
        else:
            items[-1][1].append((code, value))
    return items, unit


def shoelace(x, y):
    """Area of a ring, without the offset of its coordinates."""
    x, y = x - x[0], y - y[0]
    return abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def test_areas_of_dxf_by_its_codes_are_the_exact_ones(layer):
    """Read without a library: rings of an image are those before its name."""
    entities, unit = dxf_entities(FORMATS[".dxf"](layer).decode())
    assert unit == (70, "6")  # metres
    areas, names, area = [], [], 0.0
    for kind, pairs in entities:
        own = dict(pairs)
        if kind == "TEXT":
            areas, names, area = [*areas, area], [*names, own[1]], 0.0
            continue
        x, y = (np.array([float(v) for code, v in pairs if code == axis]) for axis in (10, 20))
        assert kind == "LWPOLYLINE"
        assert len(x) == len(y) == int(own[90])
        assert int(own[70]) & 1  # closed
        assert 42 not in own  # no arcs
        area += shoelace(x, y) * {"FOOTPRINTS": 1, "FOOTPRINT_HOLES": -1}[own[8]]
    assert names == list(NAMES)
    assert areas == pytest.approx(shapely.area(layer.on_map), rel=1e-9)
    # A map in metres is not that of the ground: 0.04 % of a length in the middle of a UTM zone.
    near = 1e-7 if layer.place is None else 1e-3
    assert areas == pytest.approx(layer.found.area_m2, rel=near)


@pytest.fixture
def base(layer, tmp_path):
    """A GeoPackage as a database."""
    (tmp_path / "f.gpkg").write_bytes(FORMATS[".gpkg"](layer))
    with closing(sqlite3.connect(tmp_path / "f.gpkg")) as opened:
        yield opened


def test_geopackage_is_that_of_the_standard(layer, base):
    assert base.execute("PRAGMA application_id").fetchone() == (0x47504B47,)
    assert base.execute("PRAGMA integrity_check").fetchone() == ("ok",)
    assert base.execute("PRAGMA foreign_key_check").fetchall() == []
    srs = -1 if layer.place is None else layer.place.epsg
    ids = [row[0] for row in base.execute("SELECT srs_id FROM gpkg_spatial_ref_sys")]
    assert {-1, 0, 4326, srs} == set(ids)
    assert base.execute("SELECT * FROM gpkg_geometry_columns").fetchall() == [
        ("footprints", "geom", "MULTIPOLYGON", srs, 0, 0)
    ]
    content = base.execute("SELECT data_type, min_x, max_y, srs_id FROM gpkg_contents").fetchone()
    bounds = shapely.total_bounds(layer.on_map)
    assert content == ("features", bounds[0], bounds[3], srs)
    rows = base.execute("SELECT geom, name, plan_m2 FROM footprints").fetchall()
    for (blob, name, area), polygon, wanted in zip(rows, layer.on_map, NAMES, strict=True):
        # Magic, version, flags (little-endian, envelope of x and y), reference system, envelope.
        assert blob[:4] == b"GP\0\x03"
        assert int.from_bytes(blob[4:8], "little", signed=True) == srs
        box = np.frombuffer(blob[8:40])
        assert tuple(box[[0, 2, 1, 3]]) == polygon.bounds
        assert shapely.equals(shapely.from_wkb(blob[40:]), polygon)
        assert (name, area > 0) == (wanted, True)


def test_the_map_counts_the_footprints_over_the_middle_of_each_cell(layer, tmp_path):
    counted = overlap_map(layer, 0.7)
    rows, columns = np.indices(counted.images.shape)
    x = counted.corner[0] + (columns + 0.5) * counted.cell
    y = counted.corner[1] - (rows + 0.5) * counted.cell
    wanted = sum(shapely.contains_xy(each, x, y).astype(int) for each in layer.on_map)
    assert (counted.images == wanted).all()
    assert counted.images.max() >= 3
    for name in ("map.tif", "map.png"):
        write(counted, layer.place, tmp_path / name)
        with Image.open(tmp_path / name) as picture:
            assert (np.asarray(picture) == counted.images).all()
            tags = dict(getattr(picture, "tag_v2", {}))
    world = [float(line) for line in (tmp_path / "map.pgw").read_text().split()]
    assert world == [0.7, 0, 0, -0.7, x[0, 0], y[0, 0]]
    with Image.open(tmp_path / "map.tif") as picture:
        tags = dict(picture.tag_v2)
    assert tags[33550] == (0.7, 0.7, 0)
    assert tags[33922] == (0, 0, 0, *counted.corner, 0)
    keys = np.reshape(tags[34735], (-1, 4)).tolist()
    assert keys[0] == [1, 1, 1, len(keys) - 1]
    projected = [[3072, 0, 1, layer.place.epsg]] if layer.place else []
    assert [key for key in keys if key[0] == 3072] == projected


@pytest.mark.parametrize("suffix", FORMATS)
def test_right_names_pass_before_the_work(suffix, tmp_path):
    check(tmp_path / f"f{suffix}", PLACES["UTM"])


def test_wrong_names_are_refused_before_the_work(tmp_path):
    for name, words in (
        ("f.shp", "to be .geojson, .kml"),
        ("f.kml", "a CRS for KML"),
        ("no/f.dxf", "a file in"),
    ):
        with pytest.raises(ConfigError, match=words):
            check(tmp_path / name, None)
