"""Footprints in the coordinates of a file: on the map, or as longitudes and latitudes.

Those on both sides of the date line have a part on each, as RFC 7946 (3.1.9) wants it.
"""

from collections.abc import Callable
from functools import cached_property, partial

import numpy as np
import shapely
from numpy.typing import NDArray

from rastercov.base import ByName, ConfigError, FloatArray, frozen_record
from rastercov.core.mesh.sections import polygons_in
from rastercov.placement.footprints import Footprints
from rastercov.placement.georeference import GeoReference

LOCAL = "local, without a CRS"
MAP_GRID, GEODETIC_GRID = 1e-6, 1e-9
"""Grids of coordinates: 1 um, and 0.1 mm in degrees, as files have them."""
MOST_DEG = 10.0
"""Longitudes of a footprint: its sides are then within 2 % of their lengths of chords."""
WORLD = shapely.box(-180, -90, 180, 90)


@frozen_record
class Layer:
    """Footprints, and their place on the Earth; None for local coordinates."""

    found: Footprints
    place: GeoReference | None = None

    @property
    def words(self) -> str:
        """CRS of `on_map`, for people."""
        return LOCAL if self.place is None else self.place.words

    @cached_property
    def on_map(self) -> NDArray[np.object_]:
        """(P,) multipolygons in the CRS of maps, metres; local ones without a place."""
        if self.place is None:
            return self.found.polygons
        return self._transform(self.place.on_map, MAP_GRID)

    @cached_property
    def geodetic(self) -> NDArray[np.object_]:
        """(P,) multipolygons in longitude and latitude of WGS 84, degrees."""
        place = self.place
        assert place is not None
        moved = self._transform(lambda points: _in_one_piece(place.geodetic(points)), GEODETIC_GRID)
        return np.array([*map(_within_world, moved), None], object)[:-1]

    def _transform(
        self, to: Callable[[FloatArray], FloatArray], grid: float
    ) -> NDArray[np.object_]:
        """Polygons at the mean height of each in other coordinates, on a grid of these."""
        moved = []
        for polygon, height in zip(self.found.polygons, self.found.height, strict=True):
            z = height if np.isfinite(height) else 0.0
            transform = shapely.transform(
                polygon, lambda xy, z=z: to(np.column_stack((xy, np.full(len(xy), z))))[:, :2]
            )
            if not shapely.is_valid(transform):  # sides that nearly touched are chords, and cross
                transform = shapely.make_valid(transform, method="structure", keep_collapsed=False)
            transform = shapely.set_precision(transform, grid)
            moved.append(shapely.multipolygons(shapely.orient_polygons(polygons_in(transform))))
        return np.array([*moved, None], object)[:-1]

    @cached_property
    def attributes(self) -> list[ByName]:
        """Name and figures of each image."""
        entries: list[ByName] = self.found.summary()["images"]
        return entries


def _in_one_piece(degrees: FloatArray) -> FloatArray:
    """Coordinates (N, 3) with longitudes near the first; ConfigError for some around a pole."""
    longitude = degrees[:, 0]
    longitude += 360 * np.round((longitude[:1] - longitude) / 360)
    if len(degrees) and not np.ptp(longitude) <= MOST_DEG:
        raise ConfigError("expected footprints away from poles, got one at a pole; write a .dxf")
    return degrees


def _within_world(polygon: shapely.MultiPolygon) -> shapely.MultiPolygon:
    """A polygon, of which what is beyond the date line is at its longitudes there."""
    if shapely.covers(WORLD, polygon):
        return polygon
    copies = [shapely.transform(polygon, partial(np.add, (360 * turn, 0))) for turn in (-1, 0, 1)]
    parts = shapely.union_all(shapely.intersection(copies, WORLD))
    return shapely.multipolygons(shapely.orient_polygons(polygons_in(parts)))


def rings_of(polygon: shapely.Polygon) -> list[FloatArray]:
    """Corners of the border of a polygon, and of its holes; the first corner again at the end."""
    rings = [polygon.exterior, *polygon.interiors]
    return [shapely.get_coordinates(each) for each in rings]
