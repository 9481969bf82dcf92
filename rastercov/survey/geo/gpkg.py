"""Footprints as a GeoPackage, in the CRS of maps.

OGC 12-128r18, GeoPackage Encoding Standard 1.3.1: tables of clause 1.1, geometries of 2.1.3.
"""

import datetime
import sqlite3
import struct
from contextlib import closing
from typing import Any

import shapely

from rastercov.survey.geo.layer import Layer

APPLICATION, VERSION = 0x47504B47, 10301
"""Identifier "GPKG", and version 1.3.1."""
CARTESIAN, GEOGRAPHIC, WGS84, OWN = -1, 0, 4326, 100000
"""Reference systems that every file has, and that of a CRS without a code."""
WGS84_WKT = (
    'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563,AUTHORITY["EPSG",'
    '"7030"]],AUTHORITY["EPSG","6326"]],PRIMEM["Greenwich",0,AUTHORITY["EPSG","8901"]],UNIT'
    '["degree",0.0174532925199433,AUTHORITY["EPSG","9122"]],AUTHORITY["EPSG","4326"]]'
)
TABLES = """
CREATE TABLE gpkg_spatial_ref_sys (
    srs_name TEXT NOT NULL, srs_id INTEGER PRIMARY KEY, organization TEXT NOT NULL,
    organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL, description TEXT);
CREATE TABLE gpkg_contents (
    table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL, identifier TEXT UNIQUE,
    description TEXT DEFAULT '', last_change DATETIME NOT NULL DEFAULT
    (strftime('%Y-%m-%dT%H:%M:%fZ','now')), min_x DOUBLE, min_y DOUBLE, max_x DOUBLE, max_y DOUBLE,
    srs_id INTEGER, CONSTRAINT fk_gc_r_srs_id FOREIGN KEY (srs_id) REFERENCES
    gpkg_spatial_ref_sys(srs_id));
CREATE TABLE gpkg_geometry_columns (
    table_name TEXT NOT NULL, column_name TEXT NOT NULL, geometry_type_name TEXT NOT NULL,
    srs_id INTEGER NOT NULL, z TINYINT NOT NULL, m TINYINT NOT NULL,
    CONSTRAINT pk_geom_cols PRIMARY KEY (table_name, column_name),
    CONSTRAINT uk_gc_table_name UNIQUE (table_name),
    CONSTRAINT fk_gc_tn FOREIGN KEY (table_name) REFERENCES gpkg_contents(table_name),
    CONSTRAINT fk_gc_srs FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys (srs_id));
CREATE TABLE footprints (
    fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, geom MULTIPOLYGON, name TEXT, plan_m2 DOUBLE,
    surface_m2 DOUBLE, gsd_per_px DOUBLE, front_percent DOUBLE, side_percent DOUBLE,
    at_edge BOOLEAN);
"""


def content(layer: Layer) -> bytes:
    """The file."""
    rows: list[tuple[Any, ...]] = [
        ("Undefined cartesian SRS", CARTESIAN, "NONE", CARTESIAN, "undefined", None),
        ("Undefined geographic SRS", GEOGRAPHIC, "NONE", GEOGRAPHIC, "undefined", None),
        ("WGS 84 geodetic", WGS84, "EPSG", WGS84, WGS84_WKT, None),
    ]
    srs = CARTESIAN
    if (place := layer.place) is not None:
        srs, body = (OWN, "NONE") if place.epsg is None else (place.epsg, "EPSG")
        rows.append((place.map_crs.name, srs, body, srs, place.map_crs.to_wkt("WKT1_GDAL"), None))
    bounds = shapely.bounds(shapely.GeometryCollection(list(layer.on_map))).tolist()
    now = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%dT%H:%M:%S.000Z")
    with closing(sqlite3.connect(":memory:")) as base:
        base.execute(f"PRAGMA application_id = {APPLICATION}")
        base.execute(f"PRAGMA user_version = {VERSION}")
        base.executescript(TABLES)
        base.executemany("INSERT INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, ?)", rows)
        name = "footprints"
        whole = (name, "features", name, layer.words, now, *bounds, srs)
        base.execute("INSERT INTO gpkg_contents VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", whole)
        column = (name, "geom", "MULTIPOLYGON", srs, 0, 0)
        base.execute("INSERT INTO gpkg_geometry_columns VALUES (?, ?, ?, ?, ?, ?)", column)
        features = [
            (_blob(polygon, srs), *entry.values())
            for polygon, entry in zip(layer.on_map, layer.attributes, strict=True)
        ]
        base.executemany(
            "INSERT INTO footprints (geom, name, plan_m2, surface_m2, gsd_per_px, front_percent, "
            "side_percent, at_edge) VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
            features,
        )
        base.commit()
        return base.serialize()


def _blob(polygon: shapely.MultiPolygon, srs: int) -> bytes:
    """Header of a geometry, with its envelope unless it is empty, and its WKB."""
    is_empty = polygon.is_empty
    flags = 0b010001 if is_empty else 0b000011
    low_x, low_y, high_x, high_y = (0.0,) * 4 if is_empty else polygon.bounds
    box = b"" if is_empty else struct.pack("<4d", low_x, high_x, low_y, high_y)
    head = b"GP" + struct.pack("<BBi", 0, flags, srs) + box
    return head + bytes(shapely.to_wkb(polygon, byte_order=1))
