"""Image of one polygon of an ideal plane: its area, and the part of it inside the image; by numba.

Most polygons are inside the image or outside it, and their area is the sum over their edges; only
those that may reach across the border are clamped to it (`lens_edges`).
"""

import math
from collections import namedtuple

import numpy as np
from numpy.typing import NDArray

from rastercov.kernels.exact_polygon import copy_polygon, keep_inside, side_at
from rastercov.kernels.jit import allocation_free, called_whole, part_of, part_with_arrays
from rastercov.kernels.lens_edges import (
    DEEPEST,
    GAP,
    MOST,
    MOST_CUTS,
    NODE_ROOM,
    NODES,
    clamped_edge,
    nodes_for,
    part_of_edge,
    point_of,
    under_edge,
)
from rastercov.kernels.lens_lanes import GROUP, U, V, X, Y, project_lanes

FloatArray = NDArray[np.float64]

MOST_CORNERS = 256
"""Room for a polygon of up to 64 corners cut by a region of up to 132 sides."""
MOST_WAITING = 64
"""Parts of an edge that wait to be halved, on a plane with a pole."""
MOST_NODES, MOST_PARTS = 512, 128
"""Nodes of a polygon that are projected together, and edges and parts of them that these are of."""


EdgeScratch = namedtuple(
    "EdgeScratch", "U V spare stack low cuts kinds waiting nodes x y z u v ends rules"
)
"""Scratch for one edge, and for the parts of all edges of a polygon.

The parts have `ends`, (x0, y0, x1, y1), `rules`, and all nodes in x ... v: the last of a part is
the first of the next.
"""


def edge_scratch() -> EdgeScratch:
    """Memory for one edge, and for the nodes of one polygon."""
    deep = DEEPEST + 2
    sizes = [(NODE_ROOM,)] * 3 + [(deep, MOST + 1), (deep, 2), (MOST_CUTS,)]
    kinds, waiting = np.empty(MOST_CUTS, np.int64), np.empty((MOST_WAITING, 2))
    of_polygon, ends = np.empty((5, MOST_NODES + GROUP)), np.empty((MOST_PARTS, 4))
    of_edge, rules = np.empty((3, NODE_ROOM)), np.empty(MOST_PARTS, np.int64)
    of_one = [*(np.empty(size) for size in sizes), kinds, waiting, of_edge]
    return EdgeScratch._make([*of_one, *of_polygon, ends, rules])


@part_of
def length2_of(edge):
    """Squared length of an edge (ax, ay, bx, by)."""
    ax, ay, bx, by = edge
    return (bx - ax) * (bx - ax) + (by - ay) * (by - ay)


@called_whole
def polygon_image(plane, corners, first, last, scratch, is_whole_asked):
    """Image of the polygon corners[first] ... corners[last - 1], in units of a plane.

    Parameters
    ----------
    plane : PlaneRecord
    corners : (N, 2) float64
        Within the region of the plane.
    scratch : EdgeScratch
    is_whole_asked : bool
        If not, `whole` may be NaN at the border of the image and beyond it.

    Returns
    -------
    whole, inside : float
        Signed area, px^2, positive for corners counter-clockwise in (x, y), and of its part inside
        the image.
    rules : int
        Edges and parts of them that were integrated.
    """
    waiting = scratch.waiting
    listed, nodes, longest, is_first = 0, 0, 0.0, True
    whole, inside, rules = 0.0, 0.0, 0
    for i in range(first, last):
        j = i + 1 if i + 1 < last else first
        edge = (corners[i, 0], corners[i, 1], corners[j, 0], corners[j, 1])
        length = math.sqrt(length2_of(edge))
        if length == 0.0:
            continue
        n, parts = plane.parts_of, 1
        if not plane.is_graded:
            n, parts = nodes_for(0.5 * length, plane.longest, plane.parts_of)
        for part in range(parts):
            top, waiting[0, 0], waiting[0, 1] = 1, part / parts, (part + 1) / parts
            while top > 0:
                top -= 1
                s, e = waiting[top, 0], waiting[top, 1]
                piece = part_of_edge(edge, s, e)
                if plane.is_graded and not _is_short(piece, plane.longest[n], top):
                    m = 0.5 * (s + e)
                    waiting[top, 0], waiting[top, 1] = m, e
                    waiting[top + 1, 0], waiting[top + 1, 1] = s, m
                    top += 2
                    continue
                if listed == MOST_PARTS or nodes + n > MOST_NODES:
                    own, part_inside, more = _sum_parts(
                        plane, listed, nodes, longest, False, is_whole_asked, scratch
                    )
                    whole, inside, rules = whole + own, inside + part_inside, rules + more
                    listed, nodes, is_first = 0, 0, False
                _lay_part(piece, n, listed, nodes, scratch)
                listed, nodes, longest = listed + 1, nodes + n, max(longest, (e - s) * length)
    if listed == 0:
        return whole, inside, rules
    own, part_inside, more = _sum_parts(
        plane, listed, nodes, longest, is_first, is_whole_asked, scratch
    )
    return whole + own, inside + part_inside, rules + more


@allocation_free
def _sum_parts(plane, parts, nodes, longest, is_all, is_whole_asked, scratch):
    """Integrals along the parts of edges that are listed, as the results of `polygon_image`.

    `is_all` says that they are a whole polygon. If not, they are a piece of its border, and the
    integral of u dv along it is a summand of both areas.
    """
    x, y, u, v, ends, rules = (
        scratch.x, scratch.y, scratch.u, scratch.v, scratch.ends, scratch.rules,
    )  # fmt: skip
    for k in range(nodes, nodes + GROUP):
        x[k], y[k] = ends[parts - 1, 2], ends[parts - 1, 3]
    asked = nodes if is_all else nodes + 1
    project_lanes(plane.code, plane.params, plane.frame, x, y, scratch.z, asked, u, v)
    if is_all:
        u[nodes], v[nodes] = u[0], v[0]
    is_in, is_out, _ = _where(plane, u, v, 0, nodes, plane.bend * longest * longest / 8)
    whole, at = math.nan, 0
    if is_in or is_whole_asked or not is_all:
        whole = 0.0
        for part in range(parts):
            n = rules[part]
            whole += under_edge(n, u[at : at + n + 1], v[at : at + n + 1], u[0] if is_all else 0.0)
            at += n
    if is_all and is_in:
        return whole, whole, parts
    if is_all and is_out:
        return whole, 0.0, parts
    inside, pieces, at = 0.0, 0, 0
    for part in range(parts):
        own, more = _part_inside(plane, part, at, scratch)
        inside += own
        pieces += more
        at += rules[part]
    return whole, inside, pieces


@part_with_arrays
def _where(plane, u, v, at, n, stray):
    """True for an image inside that of the lens, beyond one side of it, beyond u = W alone.

    It has n + 1 nodes from `at` on, and leaves the chords between them by the stray at most.
    """
    low_u, high_u, low_v, high_v = u[at], u[at], v[at], v[at]
    for k in range(at + 1, at + n + 1):
        low_u, high_u = min(low_u, u[k]), max(high_u, u[k])
        low_v, high_v = min(low_v, v[k]), max(high_v, v[k])
    W, H = plane.width, plane.height
    is_in = low_u > stray and low_v > stray and high_u < W - stray and high_v < H - stray
    is_beside = high_u < -stray or high_v < -stray or low_v > H + stray
    is_right = not is_beside and low_u > W + stray
    return is_in, is_beside or is_right, is_right


@allocation_free
def _part_inside(plane, part, at, scratch):
    """Integral of clamp(u, 0, W) d clamp(v, 0, H) along a part of an edge, px^2, and its pieces.

    `at` is its first node. An arc between two nodes leaves its chord by bend L^2 / 8 at most; so
    most parts are known to be inside the image, or beyond one side of it. Beyond u = W the integral
    is W times the change of the clamped v, beyond the other sides it is 0.
    """
    u, v, ends, n = scratch.u, scratch.v, scratch.ends, scratch.rules[part]
    edge = (ends[part, 0], ends[part, 1], ends[part, 2], ends[part, 3])
    # An arc between two nodes of an edge leaves its chord by that much.
    stray = plane.bend * length2_of(edge) * GAP[n] * GAP[n] / 8
    is_in, is_out, is_right = _where(plane, u, v, at, n, stray)
    if is_right:
        H = plane.height
        return plane.width * (min(max(v[at + n], 0.0), H) - min(max(v[at], 0.0), H)), 1
    if is_out:
        return 0.0, 1
    if is_in:
        return under_edge(n, u[at : at + n + 1], v[at : at + n + 1], 0.0), 1
    for k in range(n + 1):
        scratch.U[k], scratch.V[k] = u[at + k], v[at + k]
    return clamped_edge(plane, edge, n, stray, scratch)


@part_with_arrays
def _lay_part(edge, n, listed, nodes, scratch):
    """List a part of an edge, and its nodes but the last, behind those that are listed."""
    x, y, ends = scratch.x, scratch.y, scratch.ends
    ends[listed, 0], ends[listed, 1], ends[listed, 2], ends[listed, 3] = edge
    scratch.rules[listed] = n
    for k in range(n):
        x[nodes + k], y[nodes + k] = point_of(edge, NODES[n, n - k], NODES[n, k])


@allocation_free
def measure_polygons(plane, corners, starts, scratch, out):
    """Fill `out`, (M, 3), with the whole area, the area inside, and the edges of polygons.

    See `polygon_image`; the corners of polygon i are rows starts[i] ... starts[i + 1] - 1. Without
    the first column, (M, 2), the whole area is not found.
    """
    first = out.shape[1] - 2
    for i in range(out.shape[0]):
        whole, inside, rules = polygon_image(
            plane, corners, starts[i], starts[i + 1], scratch, first > 0
        )
        out[i, 0] = whole
        out[i, first], out[i, first + 1] = inside, rules


@allocation_free
def bulges_by_parts(plane, edges, ends, places, scratch, bulge):
    """Fill in what `lens_lanes.edge_bulges` left: edges too long for one rule.

    Parameters
    ----------
    plane : PlaneRecord
    edges : (N,) int32
        The edges.
    ends : (E, 2) int32
    places : (V, 4) float64
        Of `lens_lanes.vertex_images`.
    scratch : EdgeScratch
    bulge : (E,) float64
        In and out; NaN remains for an edge of too many parts, and on a plane with a pole.
    """
    x, y, u, v = scratch.x, scratch.y, scratch.u, scratch.v
    if plane.is_graded:
        return
    for index in range(edges.shape[0]):
        e = edges[index]
        a, b = ends[e, 0], ends[e, 1]
        edge = (places[a, X], places[a, Y], places[b, X], places[b, Y])
        half = 0.5 * math.sqrt(length2_of(edge))
        n, parts = nodes_for(half, plane.longest, plane.parts_of)
        nodes = n * parts
        if parts > MOST_PARTS or nodes > MOST_NODES:
            continue
        for part in range(parts):
            piece = part_of_edge(edge, part / parts, (part + 1) / parts)
            _lay_part(piece, n, part, part * n, scratch)
        for k in range(nodes, nodes + GROUP):
            x[k], y[k] = places[b, X], places[b, Y]
        project_lanes(
            plane.code, plane.params, plane.frame, x, y, scratch.z, nodes + 1, u, v
        )  # fmt: skip
        total = 0.0
        for at in range(0, nodes, n):
            total += under_edge(n, u[at : at + n + 1], v[at : at + n + 1], places[a, U])
        bulge[e] = total - 0.5 * (places[b, U] - places[a, U]) * (places[b, V] - places[a, V])


@allocation_free
def _is_short(edge, longest, top):
    """True where an edge of a plane with a pole is short for its distance from the pole."""
    ax, ay, bx, by = edge
    half = 0.5 * math.hypot(bx - ax, by - ay)
    distance = 0.5 * math.hypot(ax + bx, ay + by)
    return half <= longest * distance or half < 1e-15 or top >= MOST_WAITING - 2


@part_with_arrays
def is_in_region(polygon, n, region):
    """True where all corners lie inside a convex polygon, counter-clockwise in (x, y)."""
    for i in range(region.shape[0]):
        x0, y0, dx, dy, _ = side_at(region, region.shape[0], i)
        for p in range(n):
            if dx * (polygon[p, 1] - y0) - dy * (polygon[p, 0] - x0) < 0:
                return False
    return True


@part_with_arrays
def cut_to_region(polygon, n, region, spare):
    """Cut a polygon in place to a convex region; returns its corner count."""
    for i in range(region.shape[0]):
        n = cut_to_side_of(polygon, n, region, i, spare)
        if n < 3:
            return 0
    return n


@part_with_arrays
def cut_to_side_of(polygon, n, region, i, spare):
    """Cut a polygon in place to one side of a convex region; returns its corner count."""
    n = keep_inside(polygon, n, side_at(region, region.shape[0], i), spare)
    copy_polygon(spare, n, polygon)
    return n


@part_with_arrays
def beyond_side_of(polygon, n, region, i, out):
    """Copy the part of a polygon beyond one side of a convex region; returns its corner count.

    Its corners on that side are those of `cut_to_side_of`, bit for bit.
    """
    x0, y0, dx, dy, _ = side_at(region, region.shape[0], i)
    return keep_inside(polygon, n, (x0, y0, -dx, -dy, 0.0), out)
