"""Waypoints of a flight, and the way through them, as KML with heights above the ground."""

from xml.etree.ElementTree import Element, SubElement

import numpy as np

from rastercov.base.memory import FloatArray
from rastercov.placement.candidates.ground import heights_at
from rastercov.placement.plan.flight import Flight
from rastercov.report.geo.kml import bytes_of, coordinates, document_of


def content(flight: Flight) -> bytes:
    """The file, of a flight with a CRS."""
    at = _above_ground(flight, flight.places)
    root, document = document_of("flight")
    for row, point in enumerate(at):
        mark = SubElement(document, "Placemark")
        SubElement(mark, "name").text = str(row + 1)
        data = SubElement(mark, "ExtendedData")
        for name, values in (("heading", flight.headings_deg), ("pitch", flight.views[1])):
            own = SubElement(data, "Data", {"name": f"{name}_deg"})
            SubElement(own, "value").text = f"{values[row]:.4f}"
        _shape(mark, "Point", point[None])
    way = SubElement(document, "Placemark")
    SubElement(way, "name").text = "flight"
    SubElement(way, "styleUrl").text = "#outline"
    points = [flight.home[None], *(flight.way_to(row)[1:] for row in range(len(at) + 1))]
    _shape(way, "LineString", _above_ground(flight, np.concatenate(points)))
    return bytes_of(root)


def _above_ground(flight: Flight, points: FloatArray) -> FloatArray:
    """Longitudes, latitudes and heights above the ground of (N, 3) points."""
    assert flight.asked.place is not None
    ground = heights_at(flight.mesh, points[:, :2])
    ground = np.where(np.isnan(ground), flight.home[2], ground)
    at = flight.asked.place.geodetic(points)
    at[:, 2] = points[:, 2] - ground
    return at


def _shape(mark: Element, kind: str, points: FloatArray) -> None:
    shape = SubElement(mark, kind)
    SubElement(shape, "altitudeMode").text = "relativeToGround"
    SubElement(shape, "coordinates").text = coordinates(points)
