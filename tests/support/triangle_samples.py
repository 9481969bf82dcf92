"""Samples of a triangle of a raster, one by one; a twin of `engine/raster/targets.cpp`.

A triangle is its corners, `places` (..., 3, 2), in whole steps, STEPS to a sample.
"""

import numpy as np

from rastercov.base import BoolArray, Float32Array, IntArray
from rastercov.engine.raster_parts import STEPS
from rastercov.engine.solver_raster import TIE_REL


def covers(places: IntArray, column: IntArray, row: IntArray) -> BoolArray:
    """Samples that triangles cover, by the sign of three exact edge functions.

    A sample on an edge is inside where a point just right of it, or else just below it, is inside.
    """
    a, b, c = np.moveaxis(places, -2, 0)
    area = (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1])
    area = area - (c[..., 0] - a[..., 0]) * (b[..., 1] - a[..., 1])
    b, c = (np.where(area[..., None] < 0, one, two) for one, two in ((c, b), (b, c)))
    x, y = column * STEPS + STEPS // 2, row * STEPS + STEPS // 2
    inside: BoolArray = area != 0
    for p, q in ((a, b), (b, c), (c, a)):
        dx, dy = p[..., 1] - q[..., 1], q[..., 0] - p[..., 0]
        value = dx * (x - p[..., 0]) + dy * (y - p[..., 1])
        inside = inside & ((value > 0) | ((value == 0) & ((dx > 0) | ((dx == 0) & (dy > 0)))))
    return inside


def count_triangle(
    x: IntArray,
    y: IntArray,
    plane: tuple[float, float, float],
    least: float,
    greatest: float,
    runs: IntArray,
    top: int,
    inverse: Float32Array,
) -> tuple[int, int]:
    """Samples that a part of a face covers, and those of them with no surface in front of it.

    Arguments as of `rastercov.engine.raster_parts.count_triangle`.
    """
    height, width = inverse.shape
    rows, columns = np.mgrid[top : top + height, :width]
    covered = covers(np.stack((x, y), axis=-1), columns, rows)
    covered &= (columns >= runs[0][rows]) & (columns < runs[1][rows])
    own = np.clip(plane[0] + plane[2] * rows + plane[1] * columns, least, greatest)
    with np.errstate(divide="ignore"):
        depth = (1 / inverse.astype(np.float64)).astype(np.float32)
    seen = covered & (own * depth * (1 + TIE_REL) >= 1)
    return int(covered.sum()), int(seen.sum())
