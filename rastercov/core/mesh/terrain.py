"""Rasters of heights as a surface on the round earth.

A sample is a vertex. The square between four samples is divided from its north-west to its
south-east corner; without one of its samples a triangle is a hole, which hides nothing. With the
curvature of the earth a vertex at (x, y) lies lower by

    (d^2) / (2 R'),    R' = R / (1 - k),

with its distance d from the middle of the raster and the coefficient of refraction k: a paraboloid,
on which straight lines of sight are right for every observer, because about another point it
differs by a tilt alone. From a sphere it differs by d^4 / (8 R'^3): 2 mm at 50 km.

A raster in degrees is seen on the ellipsoid WGS 84, by points on the horizontal plane of a place:
directions are right, distances short by d^3 / (6 R^2): 0.5 m at 50 km.

F. K. Brunner (ed.). Geodetic Refraction. 1984, for k = 0.13. J. P. Snyder. Map Projections: A
Working Manual. 1987, for radii of the ellipsoid.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    FloatArray,
    IntArray,
    MeshError,
    check_array,
    cos,
    finite_number,
    frozen_record,
    shown,
    sin,
)
from rastercov.base.arguments import own_array

EARTH_RADIUS = 6371000.0
"""Mean radius of the earth, m."""
EQUATOR, ECCENTRICITY_2 = 6378137.0, 0.0066943799901413165
"""Largest radius of WGS 84, m, and the square of its eccentricity."""
REFRACTION = 0.13
"""Usual coefficient of terrestrial refraction."""
LARGEST_HEIGHT = 1e5
"""Larger ones, and their negatives, are values for no data, m."""


@frozen_record
class Raster:
    """Heights at the samples of a grid, north up.

    Attributes
    ----------
    heights : (H, W) float64
        Metres; NaN where there are none.
    spacing : (float, float)
        Distance of columns and of rows, metres or degrees.
    origin : (float, float)
        Map coordinates of the north-west sample, metres, or longitude and latitude.
    crs : str
        Code such as "EPSG:32632", or "".
    is_geographic : bool
        In degrees.
    inverse_radius : float
        Curvature of the earth with refraction, 1/m; 0 for a plane.
    """

    heights: FloatArray
    spacing: tuple[float, float]
    origin: tuple[float, float] = (0.0, 0.0)
    crs: str = ""
    is_geographic: bool = False
    inverse_radius: float = 0.0

    def __post_init__(self) -> None:
        rows, columns = self.heights.shape
        if min(rows, columns) < 2:
            raise MeshError(f"expected 2 x 2 heights or more, got {rows} x {columns}; add some")
        if not all(1e-9 < finite_number(each) < 1e6 for each in self.spacing):
            raise MeshError(
                f"expected a spacing from 1e-9 to 1e6, got {shown(self.spacing)}; correct it"
            )
        if not all(abs(finite_number(each)) < 1e9 for each in self.origin):
            raise MeshError(f"expected an origin (x, y), metres, got {shown(self.origin)}")
        degrees = self.origin[1] + self.xy[1][[0, -1]]
        extent = max(self.xy[0][-1], np.ptp(degrees))
        if self.is_geographic and not (abs(degrees).max() < 89 and extent < 60):
            raise MeshError(
                "expected latitudes within 89 degrees and less than 60 each way, got more; cut it, "
                "such as gdalwarp -te"
            )
        if not np.isfinite(self.heights).any():
            raise MeshError("expected heights, got none; check the value of no data")

    @property
    def xy(self) -> tuple[FloatArray, FloatArray]:
        """Map coordinates of columns, (W,), and of rows, (H,), from the origin."""
        rows, columns = (np.arange(n, dtype=np.float64) for n in self.heights.shape)
        return columns * self.spacing[0], -rows * self.spacing[1]

    def about(
        self, x: ArrayLike, y: ArrayLike, place: Sequence[ArrayLike]
    ) -> tuple[FloatArray, FloatArray]:
        """Metres east and north of a place to points; both from the origin; all broadcast."""
        if not self.is_geographic:
            return np.subtract(x, place[0]), np.subtract(y, place[1])
        turn = np.radians(np.subtract(x, place[0]))
        here, there = (np.radians(np.add(self.origin[1], each)) for each in (place[1], y))
        own, radius = (
            EQUATOR / np.sqrt(1 - ECCENTRICITY_2 * sin(each) ** 2) for each in (here, there)
        )
        rise = (1 - ECCENTRICITY_2) * (radius * sin(there) - own * sin(here))
        from_axis = radius * cos(there)
        away = from_axis * cos(turn) - own * cos(here)
        return from_axis * sin(turn), rise * cos(here) - away * sin(here)

    @property
    def sides(self) -> tuple[float, float]:
        """Width and height of a cell in the middle, metres."""
        (dx, dy), middle = self.spacing, self.xy[1].mean()
        east, north = self.about((dx, 0.0), (middle, middle + dy), (0.0, middle))
        return float(east[0]), float(north[1])

    def areas(self) -> tuple[FloatArray, FloatArray]:
        """Areas of the triangles of cells, m^2: on the map, (H - 1, 1, 2), and on the slopes.

        Those on the slopes, (H - 1, W - 1, 2), are NaN for holes: south-west, north-east.
        """
        x, y = self.xy
        across = self.about(x[0], y[:-1], (x[0], y[1:]))[1][:, None, None]
        sides = np.broadcast_to(self.about(x[1], y, (x[0], y))[0], y.shape)
        along = np.stack((sides[1:], sides[:-1]), axis=1)[:, None]
        down, right = np.diff(self.heights, axis=0), np.diff(self.heights, axis=1)
        east = np.stack((right[1:], right[:-1]), axis=2) / along
        north = np.stack((down[:, :-1], down[:, 1:]), axis=2) / across
        on_map = along * across / 2
        return on_map, on_map * np.sqrt(1 + east**2 + north**2)

    def curved(self, refraction: float = REFRACTION, *, curvature: bool = True) -> "Raster":
        """The raster on the earth, with refraction, or on a plane."""
        k = finite_number(refraction)
        if not -10 < k < 1:
            raise MeshError(f"expected refraction from -10 to below 1, got {shown(refraction)}")
        return replace(self, inverse_radius=(1 - k) / EARTH_RADIUS if curvature else 0.0)

    def triangles(
        self, place: Sequence[float], part: slice = slice(None)
    ) -> tuple[FloatArray, IntArray]:
        """Samples of some columns, (V, 3), metres from a place, and triangles, (F, 3), with holes.

        Heights fall with the curvature of the earth from the place, which is from the origin.
        """
        x, y = self.xy
        heights = self.heights[:, part]
        east, north = self.about(x[part], y[:, None], place)
        z = heights - 0.5 * self.inverse_radius * (east**2 + north**2)
        points = np.stack(np.broadcast_arrays(east, north, z), axis=2).reshape(-1, 3)
        number = np.arange(z.size).reshape(z.shape)
        nw, ne, sw, se = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
        return points, np.stack((nw, sw, se, nw, se, ne), axis=2).reshape(-1, 3)

    def surface(
        self, place: Sequence[float] | None = None
    ) -> tuple[FloatArray, IntArray, IntArray, list[str]]:
        """Vertices, (V, 3), faces, (F, 3), their numbers, (F,), two for each cell, and notes.

        On the map, or in metres from a place; in degrees, from the middle.
        """
        x, y = self.xy
        at = (x[-1] / 2, y[-1] / 2) if place is None else place
        points, both = self.triangles(at)
        if place is None and not self.is_geographic:
            on_map = np.meshgrid(x + self.origin[0], y + self.origin[1])
            points[:, 0], points[:, 1] = (each.ravel() for each in on_map)
        is_known = np.isfinite(points[both, 2]).all(axis=1)
        faces, used = both[is_known], np.zeros(len(points), bool)
        used[faces] = True
        holes = len(both) - len(faces)
        notes = [f"{holes} triangles without heights are holes, which hide nothing"] * (holes > 0)
        words = f"the middle, {at[0] + self.origin[0]:.10g}, {at[1] + self.origin[1]:.10g}"
        if self.is_geographic:
            notes.append(f"the map is in degrees: x and y are metres from {words}")
        if self.inverse_radius:
            notes.append(f"heights fall with the earth's curvature from {words}")
        return points[used], (np.cumsum(used) - 1)[faces], np.flatnonzero(is_known), notes


def raster_of_array(
    heights: ArrayLike,
    spacing: float | tuple[float, float] | None,
    origin: tuple[float, float],
    crs: str = "",
    *,
    is_geographic: bool = False,
) -> Raster:
    """Raster of an array (H, W), north up, with NaN where there are no heights."""
    given = check_array("heights", heights, "iuf", "(H, W)", MeshError)
    array = own_array("heights", given, np.float64)
    if array.ndim != 2:
        raise MeshError(f"expected heights (H, W), got shape {array.shape}; reshape it")
    if spacing is None:
        raise MeshError("expected spacing with an array, got none; give it in metres")
    array[~(abs(array) < LARGEST_HEIGHT)] = np.nan
    pairs = _pair("spacing", spacing), _pair("origin", origin)
    return Raster(array, *pairs, crs, is_geographic)


def _pair(name: str, values: ArrayLike) -> tuple[float, float]:
    """Two numbers, or one twice."""
    array = check_array(name, values, "iuf", "two numbers", MeshError)
    if array.size not in (1, 2):
        raise MeshError(f"expected {name} to be two numbers, got {shown(values)}; give two")
    numbers = array.ravel().tolist()
    return float(numbers[0]), float(numbers[-1])
