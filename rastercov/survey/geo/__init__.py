"""Files for geographic information systems: footprints, maps and flights.

A format is a module with `content`, and its line in `FORMATS` here, or in `flight.FORMATS`.
"""

from collections.abc import Callable
from pathlib import Path

from rastercov.base import check_choice, check_place, write_bytes
from rastercov.placement.footprints import Footprints
from rastercov.placement.georeference import GeoReference
from rastercov.survey.geo import dxf, geojson, gpkg, kml
from rastercov.survey.geo.layer import Layer

FORMATS: dict[str, Callable[[Layer], bytes]] = {
    ".geojson": geojson.content,
    ".kml": kml.content,
    ".dxf": dxf.content,
    ".gpkg": gpkg.content,
}
"""Content of a file of footprints by its suffix."""


def check(path: Path, place: GeoReference | None) -> None:
    """Raise `ConfigError` unless footprints at a place can be written to a file of this name."""
    check_choice("the suffix of --footprints", path.suffix.lower(), tuple(FORMATS))
    check_place(path)
    FORMATS[path.suffix.lower()](Layer(Footprints.empty(), place))


def write(layer: Layer, path: Path) -> None:
    """Write footprints in the format of the suffix."""
    write_bytes(path, FORMATS[path.suffix.lower()](layer))
