"""Map of the number of images that cover each place: GeoTIFF, or PNG with a world file.

Each side of a footprint that crosses a row of cells adds 1 or -1 to the cell behind the crossing,
by its direction. The sums along the row are the number of footprints around the middle of each
cell.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from PIL import Image

from rastercov.base import (
    ConfigError,
    FloatArray,
    IntArray,
    check_choice,
    check_place,
    owners_of,
    write_bytes,
    write_text,
)
from rastercov.placement.georeference import GeoReference
from rastercov.report.images import png
from rastercov.survey.geo import geotiff
from rastercov.survey.geo.layer import Layer

SUFFIXES = (".tif", ".tiff", ".png")
USUAL_SIDE, MOST_CELLS = 1000, 100_000_000
"""Cells along the longer side unless a size is given, and in all at most."""
STEPS = (1.0, 2.0, 5.0, 10.0)
"""Sizes of cells: these times a power of ten."""


class OverlapMap(NamedTuple):
    """Number of images over cells, the upper left corner of the map, and the size of a cell, m."""

    images: NDArray[np.uint16]
    corner: FloatArray
    cell: float


def check_name(path: Path) -> None:
    """Raise `ConfigError` unless a map can be written to a file of this name."""
    check_choice("the suffix of --overlap-map", path.suffix.lower(), SUFFIXES)
    check_place(path)


def overlap_map(layer: Layer, cell: float | None = None) -> OverlapMap:
    """The map of a layer, with cells of a size in metres; by default about `USUAL_SIDE` of them.

    Raises
    ------
    ConfigError
        For footprints without area, and for too many cells.
    """
    bounds = shapely.total_bounds(layer.on_map)
    if not np.isfinite(bounds).all():
        raise ConfigError(
            "expected footprints with area for --overlap-map, got empty ones: no image sees the "
            "surface from above; name it with --surface, or check the poses"
        )
    extent = bounds[2:] - bounds[:2]
    size = _usual(float(extent.max())) if cell is None else cell
    low, high = np.floor(bounds[:2] / size), np.ceil(bounds[2:] / size)
    if not float(np.prod(high - low)) <= MOST_CELLS:
        raise ConfigError(
            f"expected at most {MOST_CELLS:,} cells of the map, got more at {size:g} m; increase "
            "--map-cell"
        )
    columns, rows = (high - low).astype(np.int64).tolist()
    corner = np.array((low[0], high[1])) * size
    count = np.zeros((rows, columns + 1), np.int32)
    for polygon in layer.on_map:  # as much work as its sides cross rows
        _add(count, polygon, corner, size)
    sums = count.cumsum(axis=1)[:, :-1]
    return OverlapMap(np.clip(sums, 0, 2**16 - 1).astype(np.uint16), corner, size)


def _usual(extent: float) -> float:
    least = extent / USUAL_SIDE
    power = 10.0 ** np.floor(np.log10(least))
    return float(next(power * step for step in STEPS if power * step >= least * (1 - 1e-9)))


def _add(count: IntArray, polygon: shapely.MultiPolygon, corner: FloatArray, cell: float) -> None:
    """Add the crossings of the sides of a polygon with the middles of rows."""
    rings = shapely.get_rings(shapely.orient_polygons(shapely.get_parts(polygon)))
    points, ring = shapely.get_coordinates(rings, return_index=True)
    at = (points - corner) * (1 / cell, -1 / cell)
    same = np.flatnonzero(ring[1:] == ring[:-1])
    start, end = at[same], at[same + 1]
    top, bottom = np.minimum(start[:, 1], end[:, 1]), np.maximum(start[:, 1], end[:, 1])
    first = np.ceil(top - 0.5).astype(np.int64)
    n = np.maximum(np.ceil(bottom - 0.5).astype(np.int64) - first, 0)
    side = owners_of(n)
    row = first[side] + np.arange(len(side)) - np.repeat(np.cumsum(n) - n, n)
    rise = end[side] - start[side]
    share = (row + 0.5 - start[side, 1]) / np.where(rise[:, 1] == 0, 1.0, rise[:, 1])
    x = start[side, 0] + share * rise[:, 0]
    column = np.clip(np.ceil(x - 0.5).astype(np.int64), 0, count.shape[1] - 1)
    # A border runs counter-clockwise with y up: down its left side, where y of rows grows.
    np.add.at(count, (row, column), np.where(rise[:, 1] > 0, 1, -1))


def write(overlap_map: OverlapMap, place: GeoReference | None, path: Path) -> None:
    """Write a map by its suffix; beside a PNG its world file, .pgw."""
    if path.suffix.lower() == ".png":
        pixels = overlap_map.images
        if pixels.max(initial=0) < 256:
            pixels = pixels.astype(np.uint8)
        write_bytes(path, png(Image.fromarray(pixels)))
        x, y = overlap_map.corner + np.array((0.5, -0.5)) * overlap_map.cell
        lines = [overlap_map.cell, 0.0, 0.0, -overlap_map.cell, x, y]
        write_text(path.with_suffix(".pgw"), "".join(f"{float(line)!r}\n" for line in lines))
        return
    crs = () if place is None else (place.epsg or geotiff.USER_DEFINED, place.map_crs.name)
    tags = geotiff.tags_of(overlap_map.corner.tolist(), (overlap_map.cell,) * 2, *crs)
    write_bytes(path, geotiff.encode(overlap_map.images, tags))
