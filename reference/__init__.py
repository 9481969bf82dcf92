"""The authority: what the fast paths must agree with, written to be read and not to be fast."""

from rastercov.reference.polygons import image_area, visible_area, visible_polygons

__all__ = ["image_area", "visible_area", "visible_polygons"]
