"""Files of a viewshed: GeoTIFF, picture, table, and outlines of what is seen."""

from pathlib import Path

import numpy as np

from rastercov.base import (
    ByName,
    ConfigError,
    FloatArray,
    write_bytes,
    write_text,
)
from rastercov.base.format import text_with_bound
from rastercov.base.output import csv_text, name_folder
from rastercov.core.mesh.columns import columns_of
from rastercov.core.mesh.terrain import Raster
from rastercov.report.images import Key, add_frame, png
from rastercov.survey.geo import geojson, geotiff
from rastercov.survey.viewshed import Viewshed, outlines_of

UNSEEN, SEEN, HOLE, OBSERVER = (140, 140, 150), (255, 190, 60), (255, 255, 255), (200, 0, 60)
"""Colours of no visible ground, of all, of none, and of an observer."""


def read_observers(place: str | None, file: Path | None) -> FloatArray:
    """(N, 2) or (N, 3) observers of a CSV file with columns x, y and, if it has it, height.

    Or one of text such as "500100,5300200".
    """
    if (place is None) == (file is None):
        given = "neither" if file is None else "both"
        raise ConfigError(f"expected --from or --observers, got {given}; give one")
    try:
        text = f"x,y\n{place}" if file is None else file.read_text(encoding="utf-8-sig")
        columns = columns_of(text, each="observer", first=1)
        if not {"x", "y"} <= set(columns):
            raise ConfigError(f"expected columns x and y, got {', '.join(columns)}")
        return np.column_stack([columns[k] for k in ("x", "y", "height") if k in columns])
    except (OSError, UnicodeDecodeError, ConfigError) as error:
        wanted = "--from X,Y" if file is None else "--observers with a CSV file of x,y,height"
        raise ConfigError(f"expected {wanted}, got: {error}") from None


def lines_of(viewshed: Viewshed) -> list[str]:
    """The answer: what each observer sees."""
    lines = []
    for n, each in enumerate(viewshed.seen):
        share, bound = 100 * each.area / each.of_area, 100 * each.area_bound / each.of_area
        x, y, height = viewshed.observers[n]
        name = f"{n + 1}: " if len(viewshed.seen) > 1 else ""
        lines.append(
            f"{name}{text_with_bound(share, bound)} % of the ground visible from {x:.10g}, "
            f"{y:.10g} at {height:g} m: {each.area:.6g} m2 on the map, {each.surface:.6g} m2 of "
            "slopes"
        )
    return lines


def summary_of(viewshed: Viewshed) -> ByName:
    """Figures for JSON."""
    return {
        "cells": list(viewshed.share.shape),
        "spacing_m": list(viewshed.raster.sides),
        "crs": viewshed.raster.crs or None,
        "observers": [
            {"x": x, "y": y, "height_m": height, "share": seen.area / seen.of_area}
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
    crs = code, raster.crs or "local metres"
    tags = geotiff.tags_of(raster.origin, raster.spacing, *crs, raster.is_geographic)
    return geotiff.encode(viewshed.share.astype(np.float32), "TIFF", tags)


def picture_of(viewshed: Viewshed) -> bytes:
    """PNG of the visible share over a shaded relief, within the radius, with a legend."""
    raster, most = viewshed.raster, len(viewshed.seen)
    known = np.isfinite(viewshed.share)
    sides = raster.sides
    used = [np.flatnonzero(known.any(axis=axis)) for axis in (0, 1)]
    pixel = max(len(each) * side for each, side in zip(used, sides, strict=True)) / 1200  # metres
    columns, rows = (
        each[0] + np.arange(max(1, int(len(each) * side / pixel))) * pixel / side
        for each, side in zip(used, sides, strict=True)
    )
    at = np.ix_(rows.astype(np.int64), columns.astype(np.int64))
    part = np.nan_to_num(viewshed.share[at] / most)[..., None]
    colours = np.array(UNSEEN) + part * (np.array(SEEN) - np.array(UNSEEN))
    image = (colours * relief_of(raster)[at][..., None]).astype(np.uint8)
    image[~known[at]] = HOLE
    for column, row in (abs(viewshed.observers[:, :2] - raster.origin) / raster.spacing).tolist():
        is_column = abs(columns - column) * sides[0] <= 8 * pixel
        image[np.ix_(abs(rows - row) * sides[1] <= 8 * pixel, is_column)] = OBSERVER
    scale = np.linspace(UNSEEN, SEEN, 24).astype(np.uint8)
    title, name = f"{most} observers", "number of observers"
    if most == 1:
        title, name = lines_of(viewshed)[0].partition(":")[0], "visible share"
    keys = [Key.scale(name, scale, "0", str(most)), Key.of("observer", OBSERVER)]
    return png(add_frame(image, title, keys))


def relief_of(raster: Raster) -> FloatArray:
    """(H - 1, W - 1) brightness of slopes in light from the north-west, 0.6 to 1."""
    known = np.nan_to_num(raster.heights, nan=float(np.nanmean(raster.heights)))
    steep = np.asarray(sum(np.gradient(known)))[:-1, :-1]
    return np.asarray(0.8 + 0.1 * np.clip(steep / max(float(np.std(steep)), 1e-9), -2, 2))


def write_outlines(viewshed: Viewshed, path: Path) -> None:
    """Write the outlines as GeoJSON in map coordinates, with their CRS as a name."""
    crs = viewshed.raster.crs
    named = {"type": "name", "properties": {"name": crs}} if crs else None
    polygons, entries = outlines_of(viewshed), summary_of(viewshed)["observers"]
    write_bytes(path, geojson.collection("viewshed", polygons, entries, {"crs": named}))
