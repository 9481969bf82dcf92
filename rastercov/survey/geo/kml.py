"""Footprints as KML 2.2, with their figures: OGC 07-147r2."""

from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from rastercov.base import ConfigError, FloatArray
from rastercov.base.format import xml_text
from rastercov.survey.geo.layer import Layer, rings_of

NAMESPACE = "http://www.opengis.net/kml/2.2"
STYLE = {"LineStyle": ("ff2d7fff", "width", "2"), "PolyStyle": ("332d7fff", "fill", "1")}
"""Colour, aabbggrr, and another entry of each style."""


def content(layer: Layer) -> bytes:
    """The file; ConfigError without a CRS."""
    if layer.place is None:
        raise ConfigError(
            "expected a CRS for KML, got local coordinates; give --crs, or write .geojson"
        )
    root, document = document_of("footprints")
    for polygon, entry in zip(layer.geodetic, layer.attributes, strict=True):
        mark = SubElement(document, "Placemark")
        SubElement(mark, "name").text = xml_text(entry["name"])
        SubElement(mark, "styleUrl").text = "#outline"
        data = SubElement(mark, "ExtendedData")
        for name, value in entry.items():
            own = SubElement(data, "Data", {"name": name})
            SubElement(own, "value").text = "" if value is None else xml_text(str(value))
        many = SubElement(mark, "MultiGeometry")
        for part in polygon.geoms:
            area = SubElement(many, "Polygon")
            for row, ring in enumerate(rings_of(part)):
                border = SubElement(area, "outerBoundaryIs" if row == 0 else "innerBoundaryIs")
                line = SubElement(border, "LinearRing")
                SubElement(line, "coordinates").text = coordinates(ring)
    return bytes_of(root)


def document_of(name: str) -> tuple[Element, Element]:
    """Root and document of a KML file with the style "outline"."""
    root = Element("kml", {"xmlns": NAMESPACE})
    document = SubElement(root, "Document")
    SubElement(document, "name").text = name
    style = SubElement(document, "Style", {"id": "outline"})
    for kind, (colour, entry, value) in STYLE.items():
        own = SubElement(style, kind)
        SubElement(own, "color").text = colour
        SubElement(own, entry).text = value
    return root, document


def coordinates(points: FloatArray) -> str:
    """Longitude, latitude and, of (N, 3) points, height."""
    return " ".join(",".join(f"{value:.9f}" for value in row) for row in np.asarray(points))


def bytes_of(root: Element) -> bytes:
    """The file of a document."""
    text: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return text + b"\n"
