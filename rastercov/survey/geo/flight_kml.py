"""Waypoints of a flight, and the way through them, as KML.

Heights are above the ground; those of a point beside it, and of a way with such points, absolute.
"""

from xml.etree.ElementTree import Element, SubElement

import numpy as np

from rastercov.base import FloatArray
from rastercov.placement.candidates.ground import heights_at
from rastercov.survey.flight import Flight
from rastercov.survey.geo.kml import bytes_of, coordinates, document_of


def content(flight: Flight) -> bytes:
    """The file, of a flight with a CRS."""
    root, document = document_of("flight")
    for row, point in enumerate(flight.places):
        mark = SubElement(document, "Placemark")
        SubElement(mark, "name").text = str(flight.first + row + 1)
        data = SubElement(mark, "ExtendedData")
        for name, values in (("heading", flight.headings_deg), ("pitch", flight.views[1])):
            own = SubElement(data, "Data", {"name": f"{name}_deg"})
            SubElement(own, "value").text = f"{values[row]:.4f}"
        _shape(mark, "Point", flight, point[None])
    way = SubElement(document, "Placemark")
    SubElement(way, "name").text = "flight"
    SubElement(way, "styleUrl").text = "#outline"
    points = [flight.home[None], *(flight.way_to(row)[1:] for row in range(len(flight.legs)))]
    _shape(way, "LineString", flight, np.concatenate(points))
    return bytes_of(root)


def _shape(mark: Element, kind: str, flight: Flight, points: FloatArray) -> None:
    """Add the geometry of (N, 3) points."""
    assert flight.asked.place is not None
    at, ground = flight.asked.place.geodetic(points), heights_at(flight.mesh, points[:, :2])
    is_above = not np.isnan(ground).any()
    if is_above:
        at[:, 2] = points[:, 2] - ground
    shape = SubElement(mark, kind)
    SubElement(shape, "altitudeMode").text = "relativeToGround" if is_above else "absolute"
    SubElement(shape, "coordinates").text = coordinates(at)
