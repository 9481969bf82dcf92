"""Rasters of heights: one band of a GeoTIFF, and ESRI ASCII grids.

OGC 19-008r4, GeoTIFF Standard 1.1.
"""

import io
import re
import warnings
from typing import Any

import numpy as np

from rastercov.base import AnyArray, FloatArray, MeshError, ResourceError, shown
from rastercov.core.mesh.terrain import Raster, raster_of_array
from rastercov.formats.meshes.polygons import PEAK_BYTES_PER_FACE, Polygons, broken, check

COMPRESSION, SAMPLE_FORMAT, PIXEL_SCALE, TIE_POINT, TRANSFORM, KEYS, METADATA, NODATA = (
    259,
    339,
    33550,
    33922,
    34264,
    34735,
    42112,
    42113,
)
"""Tags of TIFF, of GeoTIFF, and the last two of GDAL."""
UNSIGNED, SIGNED = (1,), (2,)
"""Sample formats of integers: Pillow reads bytes as unsigned ones, and 32 bits as signed ones."""
MODEL, RASTER_TYPE, ANGULAR_UNIT, LINEAR_UNIT = 1024, 1025, 2054, 3076
CRS = {1: 3072, 2: 2048}
"""Code of a CRS by its model: projected, in degrees."""
MERCATOR = 3395, 3857
"""Projected CRSs of the whole earth, with 1.5 times the lengths at a latitude of 48 degrees."""
VERTICAL_CRS, VERTICAL_UNIT = 4096, 4099
"""Keys of GeoTIFF."""
FOOT, SURVEY_FOOT = 0.3048, 1200 / 3937
UNITS: dict[object, float] = {
    **dict.fromkeys((9001, 9102, "m", "metre", "meter", "metres", "meters"), 1.0),
    **dict.fromkeys((9002, "ft", "foot", "feet"), FOOT),
    **dict.fromkeys((9003, "us survey foot", "us-ft", "ftus"), SURVEY_FOOT),
}
"""Metres of a unit by its code or by its name in GDAL; degrees."""
VERTICAL_FEET = {5702: 9003, 6360: 9003, 8228: 9002}
"""Units of vertical CRSs in feet."""
CONVERT = "convert it: gdalwarp -ot Float32 -dstnodata -1e9 -co COMPRESS=DEFLATE"
LEAST_CELL = 0.01
"""Cells on places of degrees that are smaller are in degrees."""
LEAST_BUDGET = 2 << 30
"""Bytes that a surface may need, however well its file is compressed."""


def read(data: bytes, budget: int) -> Polygons:
    """Surface of a GeoTIFF or an ESRI ASCII grid, with curvature and refraction."""
    raster = raster_of(data)
    most = max(budget, LEAST_BUDGET) // (2 * PEAK_BYTES_PER_FACE)
    if raster.heights.size > most:
        raise ResourceError(
            f"expected at most {most:,} heights, got {raster.heights.size:,}; raise "
            "memory_budget, or cut the raster"
        )
    points, faces, cells, notes = raster.curved().surface()
    group = np.zeros(len(faces), np.int64)
    return Polygons(points, faces, cells, group, notes=notes, is_in_metres=True)


def raster_of(data: bytes) -> Raster:
    """Heights of a GeoTIFF or an ESRI ASCII grid."""
    return (_of_geotiff if data[:2] in (b"II", b"MM") else _of_ascii)(data)


def _opened(data: bytes) -> tuple[AnyArray, dict[int, Any]]:
    """Values of the first image of a TIFF, of the type of the file, and its tags."""
    from PIL import Image, TiffImagePlugin, UnidentifiedImageError

    try:
        with (
            warnings.catch_warnings(action="ignore"),  # of tags that it skips
            Image.open(io.BytesIO(data), formats=("TIFF",)) as image,
        ):
            assert isinstance(image, TiffImagePlugin.TiffImageFile)
            image.seek(image.n_frames - 1)  # an error for masks, which it does not know
            image.seek(0)
            tags: dict[int, Any] = dict(image.tag_v2)
            is_swapped = image.tag_v2.prefix == b"MM" and tags.get(COMPRESSION, 1) != 1
            mode = image.mode
            values = np.asarray(image)
    except UnidentifiedImageError:
        raise MeshError(f"expected numbers that Pillow reads, got others; {CONVERT}") from None
    except (Image.DecompressionBombError, OSError, SyntaxError, ValueError) as error:
        got = shown(str(error))
        raise MeshError(f"expected a GeoTIFF that Pillow reads, got: {got}; {CONVERT}") from None
    check(
        values.ndim == 2 and mode not in ("P", "1"),
        f"expected one band of heights, got an image of mode {mode}",
        "name the raster of heights",
    )
    # Pillow 12 swaps the bytes of these.
    check(not is_swapped, "expected a little-endian file, got a compressed big-endian one", CONVERT)
    sample = tags.get(SAMPLE_FORMAT, UNSIGNED)
    if values.dtype == np.uint8 and sample == SIGNED:
        values = values.view(np.int8)
    if values.dtype == np.int32 and sample == UNSIGNED:
        values = values.view(np.uint32)
    return values, tags


def _of_geotiff(data: bytes) -> Raster:
    """Heights, metres, of a GeoTIFF, on a map in metres, feet or degrees."""
    samples, tags = _opened(data)
    values, keys = samples.astype(np.float64), _keys(tags)
    model = keys.get(MODEL, 1)
    is_geographic = model == 2
    code = keys.get(*((ANGULAR_UNIT, 9102) if is_geographic else (LINEAR_UNIT, 9001)))
    unit = UNITS.get(code, 0.0) * (model in CRS)
    check(unit > 0, f"expected metres, feet or degrees, got unit {code}", "reproject it")
    check(
        TRANSFORM not in tags and PIXEL_SCALE in tags and TIE_POINT in tags,
        "expected a scale and a tie point of GeoTIFF, got a transformation or none",
        "write it again with gdalwarp",
    )
    nodata = str(tags.get(NODATA, "")).strip("\0 ")
    if nodata:
        number = float(nodata)
        # Of float32 the text has more digits than its samples.
        number = float(samples.dtype.type(number)) if samples.dtype.kind == "f" else number
        values[values == number] = np.nan
    dx, dy = (float(each) * unit for each in tags[PIXEL_SCALE][:2])
    column, row, _, x, y = (float(each) for each in tags[TIE_POINT][:5])
    to_sample = 0.5 if keys.get(RASTER_TYPE, 1) == 1 else 0.0  # a pixel is an area: its middle
    origin = x * unit + (to_sample - column) * dx, y * unit - (to_sample - row) * dy
    if not is_geographic:
        _check_metres(dx, *origin)
    code = keys.get(CRS[model], 0)
    crs = f"EPSG:{code}" if 0 < code < 32767 and unit == 1.0 else ""  # the surface is in metres
    check(
        code not in MERCATOR,
        f"expected a map with the lengths of the ground, got Mercator's, EPSG:{code}",
        "reproject it, such as gdalwarp -t_srs EPSG:32632",
    )
    heights = _heights(values, tags, keys, unit)
    return raster_of_array(heights, (dx, dy), origin, crs, is_geographic=is_geographic)


def _heights(
    values: FloatArray, tags: dict[int, Any], keys: dict[int, int], unit: float
) -> FloatArray:
    """Heights, metres, by GDAL's scale, offset and unit, or the vertical unit of GeoTIFF."""
    said = dict(re.findall(r'sample="0" role="(\w+)">([^<]*)<', str(tags.get(METADATA, ""))))
    vertical = VERTICAL_FEET.get(keys[VERTICAL_CRS], 9001) if VERTICAL_CRS in keys else None
    given = said.get("unittype", "").casefold() or keys.get(VERTICAL_UNIT) or vertical
    check(
        given is not None or unit == 1.0,
        "expected the unit of heights of a map in feet, got none",
        "give it, such as gdal_edit.py -units ft",
    )
    upwards = UNITS.get(given or 9001, 0.0)
    check(upwards > 0, f"expected heights in metres or feet, got unit {shown(given)}")
    return (values * float(said.get("scale", 1)) + float(said.get("offset", 0))) * upwards


def _keys(tags: dict[int, Any]) -> dict[int, int]:
    """Short values of the keys of GeoTIFF."""
    values = [int(each) for each in tags.get(KEYS, ())]
    rows = range(4, len(values) - 3, 4)
    return {values[k]: values[k + 3] for k in rows if values[k + 1] == 0}


def _of_ascii(data: bytes) -> Raster:
    """Heights of an ESRI ASCII grid."""
    text = data.decode("ascii", "replace")
    _, head, body = re.split(r"\A((?:\s*[A-Za-z]\w*[ \t]+\S+[ \t\r]*\n)*)", text, maxsplit=1)
    words = head.lower().split()
    header: dict[str, float] = dict(zip(words[::2], map(float, words[1::2]), strict=True))
    missing = sorted({"ncols", "nrows"} - set(header))
    check(not missing, f"expected {' and '.join(missing)} in the header, got none")
    columns, rows = header["ncols"], header["nrows"]
    cell = header.get("cellsize", 0.0)
    dx, dy = header.get("dx", cell), header.get("dy", cell)
    try:
        with warnings.catch_warnings(action="ignore"):  # numpy 1 ends at what is no number
            values = np.fromstring(body, sep=" ")
    except ValueError:
        raise broken("expected numbers, got a word") from None
    check(
        len(values) == rows * columns > 0,
        f"expected {rows:g} x {columns:g} heights, got {len(values)} numbers",
    )
    heights = values.reshape(int(rows), -1)
    heights[heights == header.get("nodata_value", -9999.0)] = np.nan
    x = header.get("xllcenter", header.get("xllcorner", 0.0) + dx / 2)
    y = header.get("yllcenter", header.get("yllcorner", 0.0) + dy / 2)
    _check_metres(dx, x, y)
    return raster_of_array(heights, (dx, dy), (x, y + (rows - 1) * dy))


def _check_metres(cell: float, x: float, y: float) -> None:
    """Refuse cells that are of degrees, on a map that is of metres by its file."""
    check(
        not (0 < cell < LEAST_CELL and abs(x) <= 361 and abs(y) <= 91),
        f"expected metres, got cells of {cell:g} as of degrees",
        "say so: gdal_translate -a_srs EPSG:4326",
    )
