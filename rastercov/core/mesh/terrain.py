"""Rasters of heights as a surface on the round earth.

A sample is a vertex. The square between four samples is divided from its north-west to its
south-east corner; without one of its samples a triangle is a hole, which hides nothing. With the
curvature of the earth a vertex at (x, y) lies lower by

    (d^2) / (2 R'),    R' = R / (1 - k),

with its distance d from the middle of the raster and the coefficient of refraction k: a paraboloid,
on which straight lines of sight are right for every observer, because about another point it
differs by a tilt alone. From a sphere it differs by d^4 / (8 R'^3): 2 mm at 50 km.

F. K. Brunner (ed.). Geodetic Refraction. 1984, for k = 0.13.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    BoolArray,
    FloatArray,
    IntArray,
    MeshError,
    check_array,
    finite_number,
    frozen_record,
    shown,
)

EARTH_RADIUS = 6371000.0
"""Mean radius of the earth, m."""
REFRACTION = 0.13
"""Usual coefficient of terrestrial refraction."""
LOWEST = -1e5
"""Heights below it are values for no data, m."""


@frozen_record
class Raster:
    """Heights at the samples of a grid, north up.

    Attributes
    ----------
    heights : (H, W) float64
        Metres; NaN where there are none.
    spacing : (float, float)
        Distance of columns and of rows, metres.
    origin : (float, float)
        Map coordinates of the north-west sample, metres.
    crs : str
        Code such as "EPSG:32632", or "".
    inverse_radius : float
        Curvature of the earth with refraction, 1/m; 0 for a plane.
    """

    heights: FloatArray
    spacing: tuple[float, float]
    origin: tuple[float, float] = (0.0, 0.0)
    crs: str = ""
    inverse_radius: float = 0.0

    def __post_init__(self) -> None:
        rows, columns = self.heights.shape
        if min(rows, columns) < 2:
            raise MeshError(f"expected 2 x 2 heights or more, got {rows} x {columns}; add some")
        if not all(0 < finite_number(each) < 1e6 for each in self.spacing):
            raise MeshError(
                f"expected a spacing above 0, metres, got {shown(self.spacing)}; correct it"
            )
        if not all(abs(finite_number(each)) < 1e9 for each in self.origin):
            raise MeshError(f"expected an origin (x, y), metres, got {shown(self.origin)}")
        if not self.is_ground.any():
            raise MeshError("expected heights of neighbours, got none; check the value of no data")

    @property
    def xy(self) -> tuple[FloatArray, FloatArray]:
        """Map coordinates of columns, (W,), and of rows, (H,)."""
        rows, columns = self.heights.shape
        x = self.origin[0] + np.arange(columns, dtype=np.float64) * self.spacing[0]
        return x, self.origin[1] - np.arange(rows, dtype=np.float64) * self.spacing[1]

    @property
    def is_ground(self) -> BoolArray:
        """(H - 1, W - 1, 2) triangles of each cell that are no holes: south-west, north-east."""
        known = np.isfinite(self.heights)
        diagonal = known[:-1, :-1] & known[1:, 1:]
        return np.stack((diagonal & known[1:, :-1], diagonal & known[:-1, 1:]), axis=2)

    @property
    def slopes(self) -> FloatArray:
        """(H - 1, W - 1, 2) surface for each m^2 of the map, of the triangles of each cell."""
        down, right = np.diff(self.heights, axis=0), np.diff(self.heights, axis=1)
        along = np.stack((right[1:], right[:-1]), axis=2) / self.spacing[0]
        across = np.stack((down[:, :-1], down[:, 1:]), axis=2) / self.spacing[1]
        return np.sqrt(1 + along**2 + across**2)

    def curved(self, refraction: float = REFRACTION, *, curvature: bool = True) -> "Raster":
        """The raster on the earth, with refraction, or on a plane."""
        k = finite_number(refraction)
        if not -10 < k < 1:
            raise MeshError(f"expected refraction from -10 to below 1, got {shown(refraction)}")
        return replace(self, inverse_radius=(1 - k) / EARTH_RADIUS if curvature else 0.0)

    def surface(
        self, place: FloatArray | None = None
    ) -> tuple[FloatArray, IntArray, IntArray, list[str]]:
        """Vertices, (V, 3), faces, (F, 3), their numbers, (F,), two for each cell, and notes.

        Heights fall with the curvature of the earth from a place, (2,), or from the middle.
        """
        rows, columns = self.heights.shape
        x, y = self.xy
        fall = 0.5 * self.inverse_radius
        middle = np.array((x[0] + x[-1], y[0] + y[-1])) / 2 if place is None else place
        z = self.heights - fall * ((x - middle[0]) ** 2 + (y - middle[1])[:, None] ** 2)
        points = np.stack((*np.meshgrid(x, y), z), axis=2).reshape(-1, 3)
        number = np.arange(rows * columns).reshape(rows, columns)
        nw, ne, sw, se = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
        both = np.stack((nw, sw, se, nw, se, ne), axis=2).reshape(-1, 3)
        is_ground = self.is_ground.reshape(-1)
        faces, used = both[is_ground], np.zeros(rows * columns, np.bool_)
        used[faces] = True
        holes = int((~is_ground).sum())
        notes = [f"{holes} triangles without heights are holes, which hide nothing"] * (holes > 0)
        if fall:
            words = f"{middle[0]:.10g}, {middle[1]:.10g}"
            notes.append(f"heights fall with the earth's curvature from the middle, {words}")
        return points[used], (np.cumsum(used) - 1)[faces], np.flatnonzero(is_ground), notes


def raster_of_array(
    heights: ArrayLike,
    spacing: float | tuple[float, float] | None,
    origin: tuple[float, float] = (0.0, 0.0),
    crs: str = "",
) -> Raster:
    """Raster of an array (H, W), north up, with NaN where there are no heights."""
    with np.errstate(all="ignore"):  # what overflows is no height
        array = check_array("heights", heights, "iuf", "(H, W)", MeshError).astype(np.float64)
    if array.ndim != 2:
        raise MeshError(f"expected heights (H, W), got shape {array.shape}; reshape it")
    if spacing is None:
        raise MeshError("expected spacing with an array, got none; give it in metres")
    array[~(np.isfinite(array) & (array > LOWEST))] = np.nan
    return Raster(array, _pair("spacing", spacing), _pair("origin", origin), crs)


def _pair(name: str, values: ArrayLike) -> tuple[float, float]:
    """Two numbers, or one twice."""
    numbers = check_array(name, values, "iuf", "two numbers", MeshError).ravel().tolist()
    if len(numbers) not in (1, 2):
        raise MeshError(f"expected {name} to be two numbers, got {shown(values)}; give two")
    return float(numbers[0]), float(numbers[-1])
