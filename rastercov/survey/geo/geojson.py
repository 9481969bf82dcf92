"""Footprints as GeoJSON: WGS 84 as RFC 7946 wants it; without a CRS local metres, `"crs": null`.

H. Butler and others. The GeoJSON Format. RFC 7946, 2016. The null CRS is of the GeoJSON Format
Specification of 2008: no CRS can be assumed.
"""

from collections.abc import Iterable
from functools import partial

import numpy as np
import shapely

from rastercov.base import ByName, json_bytes
from rastercov.survey.geo.layer import Layer

rounded = partial(np.round, decimals=9)
"""Coordinates as written."""


def content(layer: Layer) -> bytes:
    """The file of footprints."""
    is_local = layer.place is None
    polygons = layer.on_map if is_local else layer.geodetic
    return collection("footprints", polygons, layer.attributes, {"crs": None} if is_local else {})


def collection(
    name: str, polygons: Iterable[shapely.Geometry], entries: Iterable[ByName], more: ByName
) -> bytes:
    """File of polygons with the entries of each, and more of all."""
    features = [
        {
            "type": "Feature",
            "properties": entry,
            "geometry": shapely.geometry.mapping(shapely.transform(each, rounded)),
        }
        for each, entry in zip(polygons, entries, strict=True)
    ]
    whole = {"type": "FeatureCollection", "name": name} | more | {"features": features}
    return json_bytes(whole) + b"\n"
