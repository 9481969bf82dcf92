"""Areas of polygons of an ideal plane in the image of a lens, with bounds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rastercov.camera.lenses.lens import Lens
from rastercov.camera.lenses.planes import IdealPlane
from rastercov.camera.lenses.quadrature import EdgeTable, edge_table
from rastercov.camera.lenses.records import record_of
from rastercov.kernels.lens_polygons import edge_scratch, measure_polygons

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PolygonAreas:
    """Signed areas of polygons of an ideal plane in the image of a lens, px^2.

    Attributes
    ----------
    whole : (N,) float64
        Of the whole image of each polygon; positive where it runs from x to y.
    inside : (N,) float64
        Of the part within 0 <= u <= width and 0 <= v <= height.
    bound : (N,) float64
        Bound of the error of the quadrature of both. It leaves out rounding, about 1e-15 of the
        image size times the extent, and the error of the places where `inside` is cut at the
        border of the image.
    """

    whole: FloatArray
    inside: FloatArray
    bound: FloatArray


def polygon_areas(
    lens: Lens,
    plane: IdealPlane,
    polygons: Sequence[FloatArray],
    table: EdgeTable | None = None,
) -> PolygonAreas:
    """Areas of polygons in the image of a lens.

    Parameters
    ----------
    lens : Lens
    plane : IdealPlane
        One of `lens.planes`.
    polygons : sequence of (K, 2) float64
        Corners in units of the plane, within its region and outside its hole.
    table : EdgeTable, optional
        Of the plane; edges to 1e-9 px^2 each unless given.
    """
    table = table or edge_table(plane)
    starts = np.zeros(len(polygons) + 1, np.int64)
    np.cumsum([len(polygon) for polygon in polygons], out=starts[1:])
    corners = np.concatenate([np.empty((0, 2)), *polygons])
    out = np.empty((len(polygons), 3))
    record = record_of(plane, lens.width, lens.height, table)
    measure_polygons(record, corners, starts, edge_scratch(), out)
    return PolygonAreas(out[:, 0], out[:, 1], out[:, 2] * table.tolerance)


def blind_area(lens: Lens) -> float:
    """Area of the image whose pixels see nothing, px^2: no ray of the valid region meets them."""
    seen = 0.0
    for plane in lens.planes:
        seen += float(polygon_areas(lens, plane, plane.parts()).inside.sum())
    return lens.width * lens.height - seen
