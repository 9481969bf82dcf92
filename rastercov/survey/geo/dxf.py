"""Footprints as DXF: closed polylines on the map in metres, holes on a layer of their own."""

import io
from typing import Any

import shapely

from rastercov.base import ConfigError
from rastercov.survey.geo.layer import Layer, rings_of

LAYERS = {"FOOTPRINTS": 5, "FOOTPRINT_HOLES": 1, "FOOTPRINT_NAMES": 7}
"""Layers and their colours."""
LETTER_REL = 0.03
"""Height of letters, in square roots of the area."""


def content(layer: Layer) -> bytes:
    """The file; ConfigError without ezdxf."""
    try:
        from ezdxf.document import Drawing
        from ezdxf.units import M
    except ImportError:
        raise ConfigError(
            "expected ezdxf for DXF, got no package; run: pip install 'rastercov[building]'"
        ) from None
    drawing: Any = Drawing.new("R2010")
    drawing.units, space = M, drawing.modelspace()
    for name, colour in LAYERS.items():
        drawing.layers.add(name, color=colour)
    borders, holes, names = LAYERS
    for polygon, name in zip(layer.on_map, layer.found.names, strict=True):
        for part in polygon.geoms:
            for row, ring in enumerate(rings_of(part)):
                style = {"layer": holes if row else borders}
                space.add_lwpolyline(ring[:-1].tolist(), close=True, dxfattribs=style)
        if polygon.geoms:
            at = shapely.get_coordinates(shapely.point_on_surface(polygon))[0]
            height = LETTER_REL * float(shapely.area(polygon)) ** 0.5
            space.add_text(name, height=height, dxfattribs={"layer": names}).set_placement(at)
    text = io.StringIO()
    drawing.write(text)
    return text.getvalue().encode()
