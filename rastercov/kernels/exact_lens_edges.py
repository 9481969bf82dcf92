"""Images of the vertices and edges of a surface in a plane of a lens; compiled by numba.

Edges are taken `AT_A_TIME`, laid out by SIMD as nodes of the rule that the longest of them needs,
and wait in the list of that rule until it is full: then all nodes are projected together. An edge
that two faces share is integrated once.
"""

import math
from typing import NamedTuple

import numpy as np
from numba.core import types
from numpy.typing import NDArray

from rastercov.kernels.exact_lens_measures import AT_A_TIME, columns_at, place_vertices, put_images
from rastercov.kernels.exact_records import U as IMAGE_X
from rastercov.kernels.exact_records import V as IMAGE_Y
from rastercov.kernels.exact_records import W
from rastercov.kernels.jit import allocation_free, part_with_arrays
from rastercov.kernels.lens_lanes import LANES, U, V, X, Y, project_lanes
from rastercov.kernels.lens_tables import FEWEST, MOST, NODES, RULE
from rastercov.kernels.raster_memory import aligned_zeros
from rastercov.kernels.simd import load
from rastercov.kernels.simd_kernel import Variable, loop, pointer, simd, when

FloatArray = NDArray[np.float64]

MOST_SIDES = 12
"""Sides of a window that a vertex is compared with; a window of more is nearly a disc."""
GROUPS = LANES // AT_A_TIME
U0, V0, U1, V1 = range(4)
"""Rows of the ends of edges in the image."""
TOO_LONG_BITS = 8
"""Bits of a result above which it has a bit for each edge that is too long."""
TABLE = MOST + 1
"""Rows of a table by n."""


class EdgeLists(NamedTuple):
    """Edges that wait to be integrated, by their rule n; a projection takes `LANES` of them.

    `x`, `y`, `z`, `u` and `v`, (MOST + 1, MOST LANES), are the inner nodes of edges, all first
    nodes first, `ends`, (MOST + 1, 4, LANES), the images of both ends, `first`, (MOST + 1, GROUPS),
    the first edge of each group, and `waiting`, (MOST + 1,), counts the groups. All nodes are
    finite, also those of unused lanes.
    """

    x: FloatArray
    y: FloatArray
    z: FloatArray
    u: FloatArray
    v: FloatArray
    ends: FloatArray
    first: NDArray[np.int64]
    waiting: NDArray[np.int64]


class Pinhole(NamedTuple):
    """Of a plane, px."""

    fx: float
    fy: float
    cx: float
    cy: float


def edge_lists() -> EdgeLists:
    """Lists without an edge."""
    x, y, z, u, v = aligned_zeros((5, TABLE, MOST * LANES), np.float64)
    ends, first = aligned_zeros((TABLE, 4, LANES), np.float64), np.zeros((TABLE, GROUPS), np.int64)
    return EdgeLists(x, y, z, u, v, ends, first, np.zeros(TABLE, np.int64))


def whole_groups(edges: NDArray[np.int32]) -> NDArray[np.int32]:
    """(E, 2) edges, and after them edges of no length up to a multiple of `AT_A_TIME`."""
    return np.pad(edges, ((0, -len(edges) % AT_A_TIME), (0, 0)))


@allocation_free
def vertex_images(uvw, plane, places, is_inside, lists):
    """Fill in the places of vertices, u and v NaN for those outside the window of a plane.

    Parameters
    ----------
    uvw : (V, 3) float64
        Of the pinhole of the plane.
    plane : PlaneRecord
    places : (V, 4) float64
        Out: x, y in the plane, and u, v.
    is_inside : (V,) bool
        Out: those in the window. A vertex next to a curved border of the window may count as
        outside; with a hole all do.
    lists : EdgeLists
        Scratch; no edge waits.
    """
    if plane.hole.shape[0] > 0:
        is_inside[:] = False
        places[:] = math.nan
        return
    window, pinhole = plane.window, Pinhole(plane.fx, plane.fy, plane.cx, plane.cy)
    n, m = uvw.shape[0], window.shape[0]
    is_disc = m > MOST_SIDES
    n_sides, radius2 = (0, inner_radius2(window)) if is_disc else (m, np.inf)
    x, y, z, u, v = lists.x[0], lists.y[0], lists.z[0], lists.u[0], lists.v[0]
    for first in range(0, n, LANES):
        last = min(first + LANES, n)
        whole, any_inside = last - (last - first) % AT_A_TIME, 0
        for i in range(first, whole, AT_A_TIME):
            any_inside |= place_vertices(
                i, pointer(uvw), pinhole, pointer(window), n_sides, radius2, pointer(places),
                pointer(is_inside), i - first, pointer(x), pointer(y),
            )  # fmt: skip
        for i in range(whole, last):
            place_vertex(i, uvw, pinhole, window, n_sides, radius2, places, is_inside)
            inside = is_inside[i]
            x[i - first] = places[i, X] if inside else 0.0
            y[i - first] = places[i, Y] if inside else 0.0
            any_inside |= np.int64(inside)
        if any_inside:
            project_lanes(plane.code, plane.params, plane.frame, x, y, z, last - first, u, v)
        for i in range(first, whole, AT_A_TIME):
            put_images(i, i - first, pointer(u), pointer(v), pointer(is_inside), pointer(places))
        for i in range(whole, last):
            places[i, U] = u[i - first] if is_inside[i] else math.nan
            places[i, V] = v[i - first] if is_inside[i] else math.nan


@part_with_arrays
def inner_radius2(window):
    """Square of the radius of the largest disc around 0 in a window."""
    radius2, m = np.inf, window.shape[0]
    for s in range(m):
        t = s + 1 if s + 1 < m else 0
        dx, dy = window[t, 0] - window[s, 0], window[t, 1] - window[s, 1]
        height = dx * window[s, 1] - dy * window[s, 0]
        size = dx * dx + dy * dy
        if size > 0:
            radius2 = min(radius2, height * height / size)
    return radius2


@part_with_arrays
def place_vertex(i, uvw, pinhole, window, n_sides, radius2, places, is_inside):
    """As `place_vertices` for one."""
    x, y = (uvw[i, IMAGE_X] - pinhole.cx) / pinhole.fx, (uvw[i, IMAGE_Y] - pinhole.cy) / pinhole.fy
    places[i, X], places[i, Y] = x, y
    is_in = uvw[i, W] > 0 and x * x + y * y <= radius2
    for s in range(n_sides):
        t = s + 1 if s + 1 < n_sides else 0
        dx, dy = window[t, 0] - window[s, 0], window[t, 1] - window[s, 1]
        if not dx * (y - window[s, 1]) - dy * (x - window[s, 0]) >= 0:
            is_in = False
    is_inside[i] = is_in


@allocation_free
def edge_bulges(plane, ends, places, lists, bulge, longer):
    """Area between the image of each edge and its chord, px^2, from its first end to its second.

    Parameters
    ----------
    plane : PlaneRecord
        Without a pole.
    ends : (E, 2) int32
        Vertices of the edges; E is a multiple of `AT_A_TIME`, see `whole_groups`.
    places : (V, 4) float64
        Of `vertex_images`.
    lists : EdgeLists
    bulge : (E,) float64
        Out; NaN for an edge with an end outside the region, and for one too long for any rule.
    longer : (E,) int32
        Out: edges that are too long.

    Returns
    -------
    int
        Number of these.
    """
    n_longer = 0
    lists.waiting[:] = 0
    for first in range(0, ends.shape[0], AT_A_TIME):
        taken = take_edges(
            first, pointer(ends), pointer(places), pointer(plane.longest), pointer(NODES),
            pointer(lists.x), pointer(lists.y), pointer(lists.ends), pointer(lists.first),
            pointer(lists.waiting), pointer(bulge),
        )  # fmt: skip
        n, is_longer = taken & ((1 << TOO_LONG_BITS) - 1), taken >> TOO_LONG_BITS
        if is_longer:
            for k in range(AT_A_TIME):
                longer[n_longer] = first + k
                n_longer += is_longer >> k & 1
        if n and lists.waiting[n] == GROUPS:
            _integrate(plane, n, lists, bulge)
    for n in range(FEWEST, MOST + 1):
        if lists.waiting[n]:
            _integrate(plane, n, lists, bulge)
    return n_longer


@allocation_free
def _integrate(plane, n, lists, bulge):
    """Fill in the bulges of the edges that wait for rule n."""
    x, y, z, u, v = lists.x[n], lists.y[n], lists.z[n], lists.u[n], lists.v[n]
    project_lanes(plane.code, plane.params, plane.frame, x, y, z, LANES * (n - 1), u, v)
    for group in range(lists.waiting[n]):
        sum_up(
            group * AT_A_TIME, n, pointer(RULE), pointer(u), pointer(v), pointer(lists.ends),
            lists.first[n, group], pointer(bulge),
        )  # fmt: skip
    lists.waiting[n] = 0


@simd(returns=types.int64)
def take_edges(first, ends, places, longest, nodes, x, y, images, firsts, waiting, bulge):
    """Let `AT_A_TIME` edges wait for the rule that the longest of them needs.

    Parameters
    ----------
    ends, places, longest, nodes, bulge : pointers
        To the data of the arrays of `edge_bulges` and of `NODES`.
    x, y, images, firsts, waiting : pointers
        To those of `EdgeLists`.

    Returns
    -------
    int
        The rule, 0 where no edge can be integrated, and above `TOO_LONG_BITS` a bit for each edge
        that is too long for any.
    """
    builder = first.builder
    ax, ay, u0, v0 = columns_at(ends.at(first * 2), 2, 0, places)
    bx, by, u1, v1 = columns_at(ends.at(first * 2), 2, 1, places)
    dx, dy = bx - ax, by - ay
    quarter2 = (dx * dx + dy * dy) * 0.25
    has_image = (u0 + u1).equals(u0 + u1)
    limit = longest.value(MOST)
    is_longer = has_image & (quarter2 > limit * limit)
    is_taken = has_image & (quarter2 <= limit * limit)
    greatest = quarter2.where(is_taken, 0.0).reduce("maximum")
    lengths = load(builder, longest.pointer, TABLE)
    # Each rule takes longer edges than the one before, so that too short ones are counted.
    rule = (greatest.broadcast(TABLE) > lengths * lengths).bits().count_bits()
    rule = rule.where(rule > FEWEST, rule.like(FEWEST))
    is_any = is_taken.bits() > 0
    with when(~is_any):
        u0.like(math.nan).store(bulge.at(first).pointer)
    with when(is_any):
        group = waiting.value(rule)
        firsts.put(rule * GROUPS + group, first)
        at = rule * (MOST * LANES) + group * AT_A_TIME
        own = rule * TABLE
        # A lane that is not taken has a place of the plane, and ends in NaN.
        ax, ay, bx, by = (each.where(is_taken, 0.0) for each in (ax, ay, bx, by))
        with loop(rule.like(1), rule, 1) as k:
            t, s = nodes.value(own + k), nodes.value(own + rule - k)
            row = at + (k - 1) * LANES
            (ax * s + bx * t).store(x.at(row).pointer)
            (ay * s + by * t).store(y.at(row).pointer)
        row = rule * (4 * LANES) + group * AT_A_TIME
        for k, image in enumerate((u0.where(is_taken, math.nan), v0, u1, v1)):
            image.store(images.at(row + k * LANES).pointer)
        waiting.put(rule, group + 1)
    none = rule.like(0)
    return rule.where(is_any, none) | is_longer.bits() << TOO_LONG_BITS


@simd(returns=types.void)
def sum_up(at, n, rule, u, v, images, first, bulge):
    """Bulges of `AT_A_TIME` edges from the images of their n - 1 inner nodes, see `quadrature`."""
    builder = at.builder
    row = n * (4 * LANES) + at

    def image(k):
        return load(builder, images.at(row + k * LANES).pointer, AT_A_TIME)

    u0, v0 = image(U0), image(V0)
    du, dv = image(U1) - u0, image(V1) - v0
    weights = rule.at(n * (TABLE * TABLE))
    last = weights.at(n * TABLE)
    total = Variable(u0 - u0)
    with loop(n.like(1), n, 1) as k:
        inner = at + (k - 1) * LANES
        ku = load(builder, u.at(inner).pointer, AT_A_TIME) - u0
        kv = load(builder, v.at(inner).pointer, AT_A_TIME) - v0
        total.now = total.now + (du * kv - ku * dv) * last.value(k)
        with loop(k.like(1), k, 1) as j:
            inner = at + (j - 1) * LANES
            ju = load(builder, u.at(inner).pointer, AT_A_TIME) - u0
            jv = load(builder, v.at(inner).pointer, AT_A_TIME) - v0
            total.now = total.now + (ku * jv - ju * kv) * weights.value(k * TABLE + j)
    total.now.store(bulge.at(first).pointer)
