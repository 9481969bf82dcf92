"""Files of a viewshed: GeoTIFF, picture, table, and outlines of what is seen."""

import re
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from rastercov.base import ByName, ConfigError, FloatArray, write_bytes, write_text
from rastercov.base.files import file_text
from rastercov.base.format import text_with_bound
from rastercov.base.output import csv_text
from rastercov.core.mesh.columns import columns_of
from rastercov.core.mesh.terrain import Raster
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.report.images import Key, add_frame, png
from rastercov.survey.geo import geojson, geotiff
from rastercov.survey.viewshed import Viewshed, outlines_of

VIEWSHED = ReportKind(
    "viewshed", re.compile(r"viewshed\.(tif|png)|observers\.csv"), last="observers.csv"
)
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
        text = f"x,y\n{place}" if file is None else file_text(file)
        columns = columns_of(text, each="observer", first=1)
        if not {"x", "y"} <= set(columns):
            raise ConfigError(f"expected columns x and y, got {', '.join(columns)}")
        used = "x", "y", "height", "height_m"  # as it is written
        return np.column_stack([columns[k] for k in used if k in columns])
    except ValueError as error:
        wanted = "--from X,Y" if file is None else "--observers with a CSV file of x,y,height_m"
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


def write_files(viewshed: Viewshed, out: ReportFolder) -> None:
    """Write viewshed.tif, with NaN without ground, viewshed.png and observers.csv."""
    raster = viewshed.raster
    unnamed = "degrees" if raster.is_geographic else "local metres"
    crs = int(raster.crs.removeprefix("EPSG:") or 0) or None, raster.crs or unnamed
    tags = geotiff.tags_of(raster.origin, raster.spacing, *crs, raster.is_geographic)
    shares = geotiff.encode(viewshed.share.astype(np.float32), tags)
    write_bytes(out.file("viewshed.tif"), shares)
    write_bytes(out.file("viewshed.png"), picture_of(viewshed))
    entries = summary_of(viewshed)["observers"]
    write_text(out.file("observers.csv"), csv_text(entries[0], entries))
    out.publish()


def picture_of(viewshed: Viewshed) -> bytes:
    """PNG of the visible share over a shaded relief, within the radius, with a legend."""
    raster, most = viewshed.raster, len(viewshed.seen)
    known = np.isfinite(viewshed.share)
    left, right, top, bottom = (
        edge for axis in (0, 1) for edge in np.flatnonzero(known.any(axis=axis))[[0, -1]]
    )
    whole = np.array((right + 1 - left, bottom + 1 - top))
    step = 1 + whole.max() // 2400  # of the cells of a large raster, which would take memory
    used = np.s_[top : bottom + 1 : step, left : right + 1 : step]
    part = np.nan_to_num(viewshed.share[used] / most)[..., None]
    colours = UNSEEN + part * np.subtract(SEEN, UNSEEN)
    pixels = (colours * relief_of(raster)[used][..., None]).astype(np.uint8)
    pixels[~known[used]] = HOLE
    sides = whole * raster.sides
    size = np.maximum(1200 * sides / sides.max(), 1).astype(np.int64)
    image = Image.fromarray(pixels).resize(size.tolist(), 0)
    cells = abs(viewshed.observers[:, :2] - raster.origin) / raster.spacing
    for x, y in (size * (cells - (left, top)) / whole).tolist():
        ImageDraw.Draw(image).rectangle((x - 8, y - 8, x + 8, y + 8), OBSERVER)
    scale = np.linspace(UNSEEN, SEEN, 24).astype(np.uint8)
    title, name = f"{most} observers", "number of observers"
    if most == 1:
        title, name = lines_of(viewshed)[0].partition(":")[0], "visible share"
    keys = [Key.scale(name, scale, "0", str(most)), Key.of("observer", OBSERVER)]
    return png(add_frame(np.asarray(image), title, keys))


def relief_of(raster: Raster) -> FloatArray:
    """(H - 1, W - 1) brightness of slopes in light from the north-west, 0.6 to 1."""
    known = np.nan_to_num(raster.heights, nan=float(np.nanmean(raster.heights)))
    steep: FloatArray = np.add(*np.gradient(known))[:-1, :-1]
    return 0.8 + 0.1 * np.clip(steep / max(steep.std(), 1e-9), -2, 2)


def write_outlines(viewshed: Viewshed, path: Path) -> None:
    """Write the outlines as GeoJSON in map coordinates, with their CRS as a name."""
    crs = viewshed.raster.crs
    named = {"type": "name", "properties": {"name": crs}} if crs else None
    polygons, entries = outlines_of(viewshed), summary_of(viewshed)["observers"]
    write_bytes(path, geojson.collection("viewshed", polygons, entries, {"crs": named}))
