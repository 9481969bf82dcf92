"""Horizontal sections of meshes: exact, the points in which a plane cuts the edges of the faces."""

from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from rastercov.base import FloatArray, IntArray


def section(vertices: FloatArray, faces: IntArray, height: float) -> FloatArray:
    """Segments (N, 2, 2) in which the plane z = `height` cuts faces (F, 3).

    Ends on one edge are equal bit by bit. The front of a face is to the right of its segment, so
    that the section of a solid is counter-clockwise. A vertex in the plane counts as above it: the
    section is the limit of those slightly below.
    """
    is_above = vertices[:, 2] >= height
    cut = faces[is_above[faces].any(axis=1) & ~is_above[faces].all(axis=1)]
    here, following = is_above[cut], np.roll(is_above[cut], -1, axis=1)
    rows, ends = np.arange(len(cut)), []
    for crosses in (here & ~following, ~here & following):
        side = crosses.argmax(axis=1)
        edge = np.sort(np.stack((cut[rows, side], cut[rows, (side + 1) % 3])), axis=0)
        low, high = vertices[edge]
        share = (height - low[:, 2]) / (high[:, 2] - low[:, 2])
        ends.append(low[:, :2] + share[:, None] * (high - low)[:, :2])
    return np.stack(ends, axis=1)


def solid(segments: FloatArray) -> Any:
    """Area that the segments of a section go around counter-clockwise, once or more.

    Within a shell that shows its inside, whose largest part they go around clockwise, once less.
    """
    lines = shapely.union_all(shapely.linestrings(segments))
    cells = shapely.get_parts(shapely.polygonize(shapely.get_parts(lines)))
    (start, end), turns = np.moveaxis(segments, 1, 0), np.zeros(len(cells), np.int64)
    for row, point in enumerate(shapely.get_coordinates(shapely.point_on_surface(cells))):
        # Upward crossings of the ray to the right of the point, less those downward.
        way = (end > point)[:, 1] * 1 - (start > point)[:, 1]
        turns[row] = way[way * cross(end - start, point - start) > 0].sum()
    largest = turns[np.argmax(shapely.area(cells))] if len(cells) else 0
    return shapely.union_all(cells[turns > min(0, largest)])


def polygons_in(geometry: shapely.Geometry) -> NDArray[np.object_]:
    """Polygons of a geometry, without its lines and points, and without empty ones."""
    parts = shapely.get_parts(geometry)
    is_area = shapely.get_type_id(parts) == shapely.GeometryType.POLYGON
    return parts[is_area & ~shapely.is_empty(parts)]


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross product of vectors in the plane, (..., 2)."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
