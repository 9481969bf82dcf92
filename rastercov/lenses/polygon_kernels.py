"""Image of one polygon of an ideal plane: its area, and the part of it inside the image; by numba.

Most polygons are inside the image or outside it, and their area is the sum over their edges; only
those that may reach across the border are clamped to it (`edge_kernels`).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov._jit import allocation_free, inlined
from rastercov.lenses.edge_kernels import (
    DEEPEST,
    MOST_CUTS,
    clamped_edge,
    edge_values,
    nodes_for,
    under_edge,
)
from rastercov.lenses.quadrature import MOST

FloatArray = NDArray[np.float64]

MOST_CORNERS = 256
"""Room for a polygon of up to 64 corners cut by a region of up to 132 sides."""
MOST_WAITING = 64
"""Parts of an edge that wait to be halved, on a plane with a pole."""


class EdgeScratch(NamedTuple):
    """Scratch for one edge."""

    U: FloatArray
    V: FloatArray
    spare: FloatArray
    stack: FloatArray
    low: FloatArray
    cuts: FloatArray
    kinds: NDArray[np.int64]
    waiting: FloatArray


def edge_scratch() -> EdgeScratch:
    """Memory for one edge."""
    deep = DEEPEST + 2
    sizes = [(MOST + 1,)] * 3 + [(deep, MOST + 1), (deep, 2), (MOST_CUTS,)]
    kinds, waiting = np.empty(MOST_CUTS, np.int64), np.empty((MOST_WAITING, 2))
    return EdgeScratch._make([*(np.empty(size) for size in sizes), kinds, waiting])


@allocation_free
def polygon_image(plane, corners, first, last, scratch):
    """Image of the polygon corners[first] ... corners[last - 1], in units of a plane.

    Parameters
    ----------
    plane : PlaneRecord
    corners : (N, 2) float64
        Within the region of the plane.
    scratch : EdgeScratch

    Returns
    -------
    whole, inside : float
        Signed area, px^2, positive for corners counter-clockwise in (x, y), and of its part inside
        the image.
    rules : int
        Edges and parts of them that were integrated.
    """
    rules, u0, whole, stray = 0, 0.0, 0.0, 0.0
    low_u = low_v = math.inf
    high_u = high_v = -math.inf
    U, V = scratch.U, scratch.V
    for i in range(first, last):
        j = i + 1 if i + 1 < last else first
        ax, ay, bx, by = corners[i, 0], corners[i, 1], corners[j, 0], corners[j, 1]
        dx, dy = bx - ax, by - ay
        length = math.sqrt(dx * dx + dy * dy)
        if length == 0.0:
            continue
        n, parts = plane.parts_of, 1
        if not plane.is_graded:
            n, parts = nodes_for(0.5 * length, plane.longest, plane.parts_of)
        for part in range(parts):
            top, scratch.waiting[0, 0], scratch.waiting[0, 1] = 1, part / parts, (part + 1) / parts
            while top > 0:
                top -= 1
                s, e = scratch.waiting[top, 0], scratch.waiting[top, 1]
                x0, y0, x1, y1 = _ends(ax, ay, bx, by, s, e)
                if plane.is_graded and not _is_short(x0, y0, x1, y1, plane.longest[n], top):
                    top = _halve(scratch.waiting, top, s, e)
                    continue
                edge_values(plane.code, plane.params, plane.frame, x0, y0, x1, y1, n, U, V)
                if rules == 0:
                    u0 = U[0]
                rules += 1
                whole += under_edge(n, U, V, u0)
                stray = max(stray, (e - s) * length)
                for k in range(n + 1):
                    low_u, high_u = min(low_u, U[k]), max(high_u, U[k])
                    low_v, high_v = min(low_v, V[k]), max(high_v, V[k])
    if rules == 0:
        return 0.0, 0.0, 0
    stray = plane.bend * stray * stray / 8
    W, H = plane.width, plane.height
    if low_u > stray and low_v > stray and high_u < W - stray and high_v < H - stray:
        return whole, whole, rules
    if high_u < -stray or high_v < -stray or low_u > W + stray or low_v > H + stray:
        return whole, 0.0, rules
    inside, pieces = _clamped(plane, corners, first, last, scratch)
    return whole, inside, pieces


@allocation_free
def measure_polygons(plane, corners, starts, scratch, out):
    """Fill `out`, (M, 3), with the whole area, the area inside, and the edges of polygons.

    See `polygon_image`; the corners of polygon i are rows starts[i] ... starts[i + 1] - 1.
    """
    for i in range(out.shape[0]):
        whole, inside, rules = polygon_image(plane, corners, starts[i], starts[i + 1], scratch)
        out[i, 0], out[i, 1], out[i, 2] = whole, inside, rules


@allocation_free
def _clamped(plane, corners, first, last, scratch):
    """Area of the part inside the image, and the pieces of edges that were integrated."""
    inside, rules = 0.0, 0
    for i in range(first, last):
        j = i + 1 if i + 1 < last else first
        ax, ay, bx, by = corners[i, 0], corners[i, 1], corners[j, 0], corners[j, 1]
        length = math.hypot(bx - ax, by - ay)
        if length == 0.0:
            continue
        n, parts = plane.parts_of, 1
        if not plane.is_graded:
            n, parts = nodes_for(0.5 * length, plane.longest, plane.parts_of)
        for part in range(parts):
            top, scratch.waiting[0, 0], scratch.waiting[0, 1] = 1, part / parts, (part + 1) / parts
            while top > 0:
                top -= 1
                s, e = scratch.waiting[top, 0], scratch.waiting[top, 1]
                x0, y0, x1, y1 = _ends(ax, ay, bx, by, s, e)
                if plane.is_graded and not _is_short(x0, y0, x1, y1, plane.longest[n], top):
                    top = _halve(scratch.waiting, top, s, e)
                    continue
                edge_values(
                    plane.code, plane.params, plane.frame, x0, y0, x1, y1, n, scratch.U, scratch.V
                )
                own, pieces = clamped_edge(
                    plane.code, plane.params, plane.frame, x0, y0, x1, y1, n, plane.width,
                    plane.height, scratch.U, scratch.V, scratch.stack, scratch.low, scratch.spare,
                    scratch.cuts, scratch.kinds,
                )  # fmt: skip
                inside += own
                rules += pieces
    return inside, rules


@allocation_free
def _ends(ax, ay, bx, by, s, e):
    """Ends of the part s ... e of an edge."""
    return (
        *((1.0 - s) * ax + s * bx, (1.0 - s) * ay + s * by),
        *((1.0 - e) * ax + e * bx, (1.0 - e) * ay + e * by),
    )


@allocation_free
def _halve(waiting, top, s, e):
    """Put the halves of a part on the stack; returns its new size."""
    m = 0.5 * (s + e)
    waiting[top, 0], waiting[top, 1] = m, e
    waiting[top + 1, 0], waiting[top + 1, 1] = s, m
    return top + 2


@allocation_free
def _is_short(ax, ay, bx, by, longest, top):
    """True where an edge of a plane with a pole is short for its distance from the pole."""
    half = 0.5 * math.hypot(bx - ax, by - ay)
    distance = 0.5 * math.hypot(ax + bx, ay + by)
    return half <= longest * distance or half < 1e-15 or top >= MOST_WAITING - 2


@inlined
def is_in_region(polygon, n, region):
    """True where all corners lie inside a convex polygon, counter-clockwise in (x, y)."""
    m = region.shape[0]
    for i in range(m):
        j = i + 1 if i + 1 < m else 0
        x0, y0 = region[i, 0], region[i, 1]
        dx, dy = region[j, 0] - x0, region[j, 1] - y0
        for p in range(n):
            if dx * (polygon[p, 1] - y0) - dy * (polygon[p, 0] - x0) < 0:
                return False
    return True


@inlined
def cut_to_side(polygon, n, x0, y0, dx, dy, out):
    """Keep the part of a polygon to the left of a line; returns its corner count."""
    kept = 0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        here = dx * (polygon[i, 1] - y0) - dy * (polygon[i, 0] - x0)
        there = dx * (polygon[j, 1] - y0) - dy * (polygon[j, 0] - x0)
        if here >= 0 and kept < out.shape[0]:
            out[kept, 0], out[kept, 1] = polygon[i, 0], polygon[i, 1]
            kept += 1
        if ((here > 0 and there < 0) or (here < 0 and there > 0)) and kept < out.shape[0]:
            t = here / (here - there)
            out[kept, 0] = polygon[i, 0] + t * (polygon[j, 0] - polygon[i, 0])
            out[kept, 1] = polygon[i, 1] + t * (polygon[j, 1] - polygon[i, 1])
            kept += 1
    return kept


@inlined
def cut_to_region(polygon, n, region, spare):
    """Cut a polygon in place to a convex region; returns its corner count."""
    m = region.shape[0]
    for i in range(m):
        j = i + 1 if i + 1 < m else 0
        x0, y0 = region[i, 0], region[i, 1]
        n = cut_to_side(polygon, n, x0, y0, region[j, 0] - x0, region[j, 1] - y0, spare)
        for p in range(n):
            polygon[p, 0], polygon[p, 1] = spare[p, 0], spare[p, 1]
        if n < 3:
            return 0
    return n
