"""Footprints as GeoJSON: WGS 84 as RFC 7946 wants it; without a CRS local metres, `"crs": null`.

H. Butler and others. The GeoJSON Format. RFC 7946, 2016. The null CRS is of the GeoJSON Format
Specification of 2008: no CRS can be assumed.
"""

import numpy as np

from rastercov.base import ByName, json_bytes
from rastercov.survey.geo.layer import Layer, rings_of

DEGREES, METRES = 9, 9
"""Decimals of coordinates."""


def content(layer: Layer) -> bytes:
    """The file."""
    is_local = layer.place is None
    polygons = layer.on_map if is_local else layer.geodetic
    digits = METRES if is_local else DEGREES
    features = [
        {
            "type": "Feature",
            "properties": entry,
            "geometry": {
                "type": "MultiPolygon",
                "coordinates": [
                    [np.round(ring, digits).tolist() for ring in rings_of(part)]
                    for part in each.geoms
                ],
            },
        }
        for each, entry in zip(polygons, layer.attributes, strict=True)
    ]
    local: ByName = {"crs": None} if is_local else {}
    whole = {"type": "FeatureCollection", "name": "footprints"} | local | {"features": features}
    return json_bytes(whole) + b"\n"
