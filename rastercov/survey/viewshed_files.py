"""Files of a viewshed: GeoTIFF, picture, table, and outlines of what is seen."""

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely

from rastercov.base import (
    ByName,
    ConfigError,
    FloatArray,
    hypot,
    json_bytes,
    norm,
    write_bytes,
    write_text,
)
from rastercov.base.format import text_with_bound
from rastercov.base.output import csv_text, name_folder
from rastercov.report.images import Key, add_frame, png
from rastercov.survey.geo import geotiff
from rastercov.survey.viewshed import Viewshed, pieces_of

UNSEEN, SEEN, HOLE = (140, 140, 150), (255, 190, 60), (255, 255, 255)
"""Colours of no visible ground, of all, and of none."""
MOST_PIECES = 200_000
"""Visible pieces whose outlines are joined: about a minute."""
LIGHT = (-1.0, 1.0, 1.5)
"""Direction to the light of the relief: from the north-west."""


def read_observers(path: Path) -> FloatArray:
    """(N, 2) or (N, 3) observers of a CSV file with columns x, y and, if it has it, height."""
    try:
        rows = list(csv.DictReader(io.StringIO(path.read_text(encoding="utf-8-sig"))))
        names = [name for name in ("x", "y", "height") if rows and name in rows[0]]
        values = [[float(row[name]) for name in names] for row in rows]
    except (OSError, UnicodeDecodeError, TypeError, ValueError) as error:
        raise ConfigError(
            f"--observers: expected a CSV file of numbers x,y,height, got: {error}; correct it"
        ) from None
    if names[:2] != ["x", "y"]:
        raise ConfigError("--observers: expected columns x, y and height, got others; name them so")
    return np.array(values)


def lines_of(viewshed: Viewshed) -> list[str]:
    """The answer: what each observer sees."""
    lines = []
    for n, (observer, seen) in enumerate(zip(viewshed.observers, viewshed.seen, strict=True), 1):
        share = 100 * seen.area / seen.of_area if seen.of_area else 0.0
        bound = 100 * seen.area_bound / seen.of_area if seen.of_area else 0.0
        x, y, height = observer.tolist()
        name = f"{n}: " if len(viewshed.seen) > 1 else ""
        lines.append(
            f"{name}{text_with_bound(share, bound)} % of the ground visible from {x:.10g}, "
            f"{y:.10g} at {height:g} m: {seen.area:.6g} m2 on the map, {seen.surface:.6g} m2 of "
            "slopes"
        )
    return lines


def summary_of(viewshed: Viewshed) -> ByName:
    """Figures for JSON."""
    return {
        "cells": list(viewshed.share.shape),
        "spacing_m": list(viewshed.raster.spacing),
        "crs": viewshed.raster.crs or None,
        "observers": [
            {"x": x, "y": y, "height_m": height}
            | {"share": seen.area / seen.of_area if seen.of_area else 0.0}
            | {f"{name}_m2": value for name, value in seen._asdict().items()}
            for (x, y, height), seen in zip(viewshed.observers.tolist(), viewshed.seen, strict=True)
        ],
    }


def write_files(viewshed: Viewshed, out: Path) -> None:
    """Write viewshed.tif, viewshed.png and observers.csv."""
    name_folder(out)
    write_bytes(out / "viewshed.tif", tif_of(viewshed))
    write_bytes(out / "viewshed.png", picture_of(viewshed))
    entries = summary_of(viewshed)["observers"]
    write_text(out / "observers.csv", csv_text(entries[0], entries))


def tif_of(viewshed: Viewshed) -> bytes:
    """GeoTIFF of the visible share of each cell, or of the number of observers; NaN elsewhere."""
    raster = viewshed.raster
    code = int(raster.crs.removeprefix("EPSG:")) if raster.crs else None
    tags = geotiff.tags_of(raster.origin, raster.spacing, code, raster.crs or "local metres")
    return geotiff.encode(viewshed.share.astype(np.float32), "TIFF", tags)


def picture_of(viewshed: Viewshed) -> bytes:
    """PNG of the visible share over a shaded relief, with observers and legend."""
    most = max(1, len(viewshed.seen))
    part = np.nan_to_num(viewshed.share / most)[..., None]
    colours = np.array(UNSEEN) + part * (np.array(SEEN) - np.array(UNSEEN))
    pixels = colours * relief_of(viewshed.raster.heights)[..., None]
    pixels[np.isnan(viewshed.share)] = HOLE
    step = -(-max(part.shape) // 2000)
    image = np.clip(pixels[::step, ::step], 0, 255).astype(np.uint8)
    for x, y, _ in viewshed.observers.tolist():
        column = int((x - viewshed.raster.origin[0]) / viewshed.raster.spacing[0] / step)
        row = int((viewshed.raster.origin[1] - y) / viewshed.raster.spacing[1] / step)
        size = max(1, max(image.shape) // 150)
        image[max(0, row - size) : row + size + 1, max(0, column - size) : column + size + 1] = (
            200,
            0,
            60,
        )
    scale = np.linspace(UNSEEN, SEEN, 24).astype(np.uint8)
    title = lines_of(viewshed)[0].partition(":")[0] if most == 1 else f"{most} observers"
    name = "visible share" if most == 1 else "number of observers"
    keys = [Key.scale(name, scale, "0", str(most)), Key.of("observer", (200, 0, 60))]
    return png(add_frame(image, title, keys))


def relief_of(heights: FloatArray) -> FloatArray:
    """(H - 1, W - 1) brightness of slopes, 0.6 to 1."""
    known = np.nan_to_num(heights, nan=float(np.nanmin(heights)))
    east, north = np.gradient(known, axis=1)[:-1, :-1], -np.gradient(known, axis=0)[:-1, :-1]
    unit = 2 * max(float(np.std(hypot(east, north))), 1e-9)
    lit = -LIGHT[0] * east / unit - LIGHT[1] * north / unit + LIGHT[2]
    steep = np.sqrt((east / unit) ** 2 + (north / unit) ** 2 + 1)
    light = np.clip(lit / steep / norm(LIGHT), 0, 1)
    return np.asarray(0.6 + 0.4 * light)


def outlines_of(
    viewshed: Viewshed, target: float, radius: float | None
) -> Sequence[shapely.Geometry]:
    """Outlines of the ground that each observer sees, on the map.

    ConfigError for more pieces than can be joined.
    """
    outlines = []
    for observer in viewshed.observers:
        pieces = pieces_of(viewshed.raster, observer, target=target, radius=radius)
        if len(pieces) > MOST_PIECES:
            raise ConfigError(
                f"--outlines: expected at most {MOST_PIECES:,} visible pieces, got "
                f"{len(pieces):,}; give a --radius"
            )
        polygons = shapely.make_valid(shapely.polygons(pieces))
        outlines.append(shapely.union_all(polygons, grid_size=1e-6))
    return outlines


def write_outlines(viewshed: Viewshed, target: float, radius: float | None, path: Path) -> None:
    """Write the outlines as GeoJSON in map coordinates, with their CRS as a name."""
    features = [
        {
            "type": "Feature",
            "properties": entry,
            "geometry": shapely.geometry.mapping(outline),
        }
        for outline, entry in zip(
            outlines_of(viewshed, target, radius), summary_of(viewshed)["observers"], strict=True
        )
    ]
    crs = viewshed.raster.crs
    named = {"type": "name", "properties": {"name": crs}} if crs else None
    whole = {"type": "FeatureCollection", "name": "viewshed", "crs": named, "features": features}
    write_bytes(path, json_bytes(whole) + b"\n")
