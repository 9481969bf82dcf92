"""Images with their place on a map. OGC 19-008r4, GeoTIFF Standard 1.1."""

import io
from collections.abc import Mapping
from typing import Any

from PIL import Image, TiffImagePlugin

from rastercov.base import AnyArray

PIXEL_SCALE, TIE_POINT, KEYS, ASCII_KEYS = 33550, 33922, 34735, 34737
"""Tags of GeoTIFF."""
USER_DEFINED, METRE = 32767, 9001
SHORT, TEXT, DOUBLE = 3, 2, 12
"""Types of values."""


def encode(pixels: AnyArray, tags: Mapping[int, Any]) -> bytes:
    """TIFF of pixels, (H, W); tags are pairs of type and values."""
    file, own = io.BytesIO(), TiffImagePlugin.ImageFileDirectory_v2()
    for tag, (type_of_tag, values) in tags.items():
        own.tagtype[tag] = type_of_tag
        own[tag] = values
    Image.fromarray(pixels).save(file, "TIFF", compression="tiff_adobe_deflate", tiffinfo=own)
    return file.getvalue()


def tags_of(
    corner: tuple[float, float],
    cell: tuple[float, float],
    code: int | None = None,
    name: str = "local metres",
    is_geographic: bool = False,
) -> dict[int, tuple[int, Any]]:
    """Tags of GeoTIFF and their types.

    Parameters
    ----------
    corner : (float, float)
        Map coordinates of the upper left corner of the image, metres; longitude and latitude of a
        geographic CRS.
    cell : (float, float)
        Width and height of a pixel, metres or degrees.
    code : int, optional
        EPSG code of the CRS; `USER_DEFINED` for one that has a name alone, None for local metres.
    name : str
        Name of the CRS.
    """
    citation = f"{name}|"
    model = USER_DEFINED if code is None and not is_geographic else 1 + is_geographic
    entries = [(1024, 0, 1, model), (1025, 0, 1, 1), (1026, ASCII_KEYS, len(citation), 0)]
    entries += [] if code is None else [(2048 if is_geographic else 3072, 0, 1, code)]
    entries += [] if is_geographic else [(3076, 0, 1, METRE)]
    keys = [1, 1, 1, len(entries), *(value for entry in entries for value in entry)]
    return {
        PIXEL_SCALE: (DOUBLE, (*cell, 0.0)),
        TIE_POINT: (DOUBLE, (0.0, 0.0, 0.0, *corner, 0.0)),
        KEYS: (SHORT, tuple(keys)),
        ASCII_KEYS: (TEXT, citation),
    }
