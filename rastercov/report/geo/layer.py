"""Footprints in the coordinates of a file: on the map, or as longitudes and latitudes."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from rastercov.base.memory import FloatArray
from rastercov.camera.georeference import GeoReference
from rastercov.coverage.area.footprints import Footprints, polygons_in

LOCAL = "local metres, without a CRS"
MAP_GRID, GEODETIC_GRID = 1e-6, 1e-9
"""Grids of coordinates: 1 um, and 0.1 mm in degrees, as files have them."""


@dataclass(frozen=True, eq=False)
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
        return self._moved(self.place.on_map, MAP_GRID)

    @cached_property
    def geodetic(self) -> NDArray[np.object_]:
        """(P,) multipolygons in longitude and latitude of WGS 84, degrees."""
        assert self.place is not None
        return self._moved(self.place.geodetic, GEODETIC_GRID)

    def _moved(self, to: Callable[[FloatArray], FloatArray], grid: float) -> NDArray[np.object_]:
        """Polygons at the mean height of each in other coordinates, on a grid of these."""
        moved = []
        for polygon, height in zip(self.found.polygons, self.found.height, strict=True):
            z = height if np.isfinite(height) else 0.0
            place = _at_height(to, float(z))
            found = shapely.set_precision(shapely.transform(polygon, place), grid)
            moved.append(shapely.multipolygons(shapely.orient_polygons(polygons_in(found))))
        return np.array([*moved, None], object)[:-1]

    @cached_property
    def attributes(self) -> list[dict[str, Any]]:
        """Name and figures of each image."""
        entries: list[dict[str, Any]] = self.found.summary()["images"]
        return entries


def _at_height(to: Callable[[FloatArray], FloatArray], z: float) -> Callable[[Any], Any]:
    return lambda xy: to(np.column_stack((xy, np.full(len(xy), z))))[:, :2]


def rings_of(polygon: shapely.Polygon) -> list[FloatArray]:
    """Corners of the border of a polygon, and of its holes; the first corner again at the end."""
    rings = [polygon.exterior, *polygon.interiors]
    return [shapely.get_coordinates(each) for each in rings]
