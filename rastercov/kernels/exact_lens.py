"""Figures of faces in an ideal plane of a lens; compiled by numba.

`HalfPlaneSolver` has divided the faces of an ideal pinhole into visible pieces. Faces that no other
one hides are measured by their vertices and edges; of the others `collect` lists the outlines and
pieces in units of the plane, cut to the region of the lens, `lens_polygons` measures their images,
and `add_areas` adds them up by face.

Edges are taken `AT_A_TIME`, laid out by SIMD as nodes of the rule that the longest of them needs,
and wait in the list of that rule until it is full: then all nodes are projected together. An edge
that two faces share is integrated once.
"""

import math
from collections import namedtuple
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import types
from numpy.typing import NDArray

from rastercov.kernels.exact_polygon import (
    copy_polygon,
    cut_in_space,
    extent_of,
    side_at,
    store_piece,
    twice_area,
)
from rastercov.kernels.exact_records import CLIPPED, LIVE, THIN, U, V, W
from rastercov.kernels.jit import allocation_free, part_with_arrays
from rastercov.kernels.lens_edges import FEWEST, MOST, NODES, RULE
from rastercov.kernels.lens_lanes import LANES, X, Y, project_lanes
from rastercov.kernels.lens_lanes import U as IMAGE_U
from rastercov.kernels.lens_lanes import V as IMAGE_V
from rastercov.kernels.lens_polygons import (
    MOST_CORNERS,
    beyond_side_of,
    cut_to_region,
    cut_to_side_of,
    is_in_region,
)
from rastercov.kernels.raster_memory import aligned_zeros
from rastercov.kernels.simd import LONG, Scalar, gather, joined, load
from rastercov.kernels.simd_kernel import Variable, loop, pointer, simd, when

AT_A_TIME = 8
"""Vertices or faces: doubles of the longest registers."""
BYTE = ir.IntType(8)


@simd(returns=types.int64)
def place_vertices(first, uvw, pinhole, window, n_sides, radius2, places, is_inside, at, x, y):
    """Fill in x and y of the places of `AT_A_TIME` vertices, and whether they are in the window.

    Parameters
    ----------
    uvw, window, places, is_inside : pointers
        To the data of the arrays of `lens_edges.vertex_images`.
    n_sides : int
        Sides of the window that they are compared with.
    radius2 : float
        Square of the radius of a disc that they must be in.
    at : int
    x, y : pointers
        Out, from `at` on: x and y of those in the window, 0 for the others.

    Returns
    -------
    int
        Not 0 if any is in the window.
    """
    to_x, to_y = x, y
    image = load(first.builder, uvw.at(first * 3).pointer, 3 * AT_A_TIME)
    u, v, w = (image.every(3, column) for column in (U, V, W))
    x, y = (u - pinhole.cx) / pinhole.fx, (v - pinhole.cy) / pinhole.fy
    least = Variable(x.like(math.inf))
    with loop(Scalar(first.builder, LONG(0)), n_sides, 1) as s:
        t = (s + 1).where(s + 1 < n_sides, 0)
        x0, y0 = window.value(s * 2), window.value(s * 2 + 1)
        dx, dy = window.value(t * 2) - x0, window.value(t * 2 + 1) - y0
        inner = dx * (y - y0) - dy * (x - x0)
        least.now = inner.minimum(least.now)
    is_in = (w > 0) & (least.now >= 0) & (x * x + y * y <= radius2)
    is_in.to(BYTE).store(is_inside.at(first).pointer)
    both = joined(x, y)
    for k in range(AT_A_TIME):
        both.every(AT_A_TIME, k).store(places.at((first + k) * 4 + X).pointer)
    x.where(is_in, 0.0).store(to_x.at(at).pointer)
    y.where(is_in, 0.0).store(to_y.at(at).pointer)
    return is_in.bits()


@simd(returns=types.void)
def put_images(first, at, u, v, is_inside, places):
    """Complete the places of `AT_A_TIME` vertices by their images; NaN outside the window."""
    builder = first.builder
    is_in = load(builder, is_inside.at(first).pointer, AT_A_TIME) > 0
    images = [
        load(builder, image.at(at).pointer, AT_A_TIME).where(is_in, math.nan) for image in (u, v)
    ]
    both = joined(*images)
    for k in range(AT_A_TIME):
        both.every(AT_A_TIME, k).store(places.at((first + k) * 4 + IMAGE_U).pointer)


@simd(returns=types.void)
def measure_faces(
    first, faces, sides, is_flat, state, places, bulge, plane, rounding, own, is_done, error
):
    """Area of `AT_A_TIME` faces, px^2, its bound, and whether they need no more; 0 where unknown.

    Arrays are pointers to the data of the arguments of `measure_simple`.
    """
    builder = first.builder
    corners = [columns_at(faces.at(first * 3), 3, s, places) for s in range(3)]
    (x0, y0, u0, v0), (x1, y1, u1, v1), (x2, y2, u2, v2) = corners
    total = u0.like(0.0)
    for p in range(3):
        at = load(builder, sides.at(first * 3).pointer, 3 * AT_A_TIME).every(3, p)
        is_backwards = at < 0
        value = gather(bulge.pointer, (at.like(-1) - at).where(is_backwards, at))
        total = total + (value.like(0.0) - value).where(is_backwards, value)
    lengths2 = [
        (bx - ax) * (bx - ax) + (by - ay) * (by - ay)
        for ax, ay, bx, by in ((x0, y0, x1, y1), (x1, y1, x2, y2), (x2, y2, x0, y0))
    ]
    longest2 = lengths2[0].maximum(lengths2[1]).maximum(lengths2[2])
    low_u, high_u = u0.minimum(u1).minimum(u2), u0.maximum(u1).maximum(u2)
    low_v, high_v = v0.minimum(v1).minimum(v2), v0.maximum(v1).maximum(v2)
    stray = longest2 * plane.bend / 8
    is_out = (high_u < -stray) | (high_v < -stray)
    is_out = is_out | (low_u > stray + plane.width) | (low_v > stray + plane.height)
    is_in = (low_u > stray) & (low_v > stray)
    is_in = is_in & (high_u < -stray + plane.width) & (high_v < -stray + plane.height)
    total = total + ((u1 - u0) * (v2 - v0) - (u2 - u0) * (v1 - v0)) * 0.5
    # NaN for a vertex outside the window, or an edge without a bulge
    corner = u0 + u1 + u2
    left_out = load(builder, is_flat.at(first).pointer, AT_A_TIME) > 0
    left_out = left_out | ((load(builder, state.at(first).pointer, AT_A_TIME) & THIN) > 0)
    is_seen = corner.equals(corner) & ~left_out
    is_measured = is_seen & is_in & ~is_out & total.equals(total)
    (left_out | (is_seen & is_out) | is_measured).to(BYTE).store(is_done.at(first).pointer)
    twice = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    found = total.where(twice > 0, total.like(0.0) - total).where(is_measured, 0.0)
    found.store(own.at(first).pointer)
    # No side is longer than the box, and a bulge, is wide and high.
    around = ((high_u - low_u) + (high_v - low_v)) * 2.0 + stray * 6.0
    parts = longest2.sqrt() * 0.5 / plane.part
    parts = (parts.like(0.0) - (parts.like(0.0) - parts).floor()).where(longest2 > plane.one, 1.0)
    bound = (parts * 3.0 * plane.tolerance + around * rounding).where(is_measured, 0.0)
    bound.store(error.at(first).pointer)


def columns_at(rows, step, s, places):
    """Columns of the places of vertex s of `AT_A_TIME` rows of `step`, each a single load."""
    found = joined(
        *(
            load(places.builder, places.at(rows.value(step * k + s).to(LONG) * 4).pointer, 4)
            for k in range(AT_A_TIME)
        )
    )
    return tuple(found.every(4, column) for column in (X, Y, IMAGE_U, IMAGE_V))


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


EdgeLists = namedtuple("EdgeLists", "x y z u v ends first waiting")
"""Edges that wait to be integrated, by their rule n; a projection takes `LANES` of them.

`x`, `y`, `z`, `u` and `v`, (MOST + 1, MOST LANES), are the inner nodes of edges, all first nodes
first, `ends`, (MOST + 1, 4, LANES), the images of both ends, `first`, (MOST + 1, GROUPS), the first
edge of each group, and `waiting`, (MOST + 1,), counts the groups. All nodes are finite, also those
of unused lanes.
"""


Pinhole = namedtuple("Pinhole", "fx fy cx cy")
"""Of a plane, px."""


def edge_lists() -> EdgeLists:
    """Lists without an edge."""
    x, y, z, u, v = aligned_zeros((5, TABLE, MOST * LANES), np.float64)
    ends, first = aligned_zeros((TABLE, 4, LANES), np.float64), np.zeros((TABLE, GROUPS), np.int64)
    return EdgeLists(x, y, z, u, v, ends, first, np.zeros(TABLE, np.int64))


def whole_groups(rows: NDArray[Any]) -> NDArray[Any]:
    """(N, K) edges or faces, and after them rows of 0 up to a multiple of `AT_A_TIME`."""
    return np.pad(rows, ((0, -len(rows) % AT_A_TIME), (0, 0)))


@allocation_free
def vertex_images(uvw, plane, places, is_inside, lists):
    """Fill in the places of vertices, u and v NaN for those outside the window of a plane.

    Parameters
    ----------
    uvw : (V, 3) float64
        Of the pinhole of the plane, with `SPARE_ENTRIES` values behind them.
    plane : PlaneRecord
    places : (V', 4) float64
        Out: x, y in the plane, and u, v; V' is V or more, a multiple of `AT_A_TIME`.
    is_inside : (V',) bool
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
    n, m = places.shape[0], window.shape[0]
    is_disc = m > MOST_SIDES
    n_sides, radius2 = (0, inner_radius2(window)) if is_disc else (m, np.inf)
    x, y, z, u, v = lists.x[0], lists.y[0], lists.z[0], lists.u[0], lists.v[0]
    for first in range(0, n, LANES):
        last, any_inside = min(first + LANES, n), 0
        for i in range(first, last, AT_A_TIME):
            any_inside |= place_vertices(
                i, pointer(uvw), pinhole, pointer(window), n_sides, radius2, pointer(places),
                pointer(is_inside), i - first, pointer(x), pointer(y),
            )  # fmt: skip
        if any_inside:
            project_lanes(plane.code, plane.params, plane.frame, x, y, z, last - first, u, v)
        for i in range(first, last, AT_A_TIME):
            put_images(i, i - first, pointer(u), pointer(v), pointer(is_inside), pointer(places))


@part_with_arrays
def inner_radius2(window):
    """Square of the radius of the largest disc around 0 in a window."""
    radius2, m = np.inf, window.shape[0]
    for s in range(m):
        x, y, dx, dy, _ = side_at(window, m, s)
        height = dx * y - dy * x
        size = dx * dx + dy * dy
        if size > 0:
            radius2 = min(radius2, height * height / size)
    return radius2


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


EDGE_ROUNDING = 2.0**-46
"""Rounding of the area under an edge, relative to its length and the size of the image: positions
to 2^-50 of the size, some ten times over."""


Scratch = namedtuple("Scratch", "polygon spare points spare_points")
"""Scratch for one polygon: (MOST_CORNERS, 2) and (MOST_CORNERS, 3) float64."""


def scratch() -> Scratch:
    """Memory for one polygon."""
    return Scratch(*np.empty((2, MOST_CORNERS, 2)), *np.empty((2, MOST_CORNERS, 3)))


@part_with_arrays
def append_cut(polygon, n, face, plane, spare, found):
    """Append the parts of a convex polygon in the window and outside the hole of a plane."""
    if not is_in_region(polygon, n, plane.window):
        n = cut_to_region(polygon, n, plane.window, spare)
    if n < 3:
        return
    # Nothing in the hole is ever put through the lens, which may have a pole or fold there: the
    # rest is listed side by side, what is beyond the first side, then beyond the second, ...
    sides = plane.hole.shape[0]
    if sides == 0:
        store_piece(face, polygon, n, found)
        return
    for i in range(sides):
        m = beyond_side_of(polygon, n, plane.hole, i, spare)
        if m >= 3:
            store_piece(face, spare, m, found)
        n = cut_to_side_of(polygon, n, plane.hole, i, spare)
        if n < 3:
            return


@part_with_arrays
def outline_in_space(vertices, faces, f, camera, region, points, spare, polygon):
    """Fill `polygon` with the part of a face beyond the near plane and in a region of the plane.

    In units of the plane, counter-clockwise in (x, y). Returns the corner count, 0 for none.
    """
    rotation, eye = camera.rotation, camera.centre
    for p in range(3):
        i = faces[f, p]
        x, y, z = vertices[i, 0] - eye[0], vertices[i, 1] - eye[1], vertices[i, 2] - eye[2]
        for k in range(3):
            points[p, k] = x * rotation[0, k] + y * rotation[1, k] + z * rotation[2, k]
    if max(points[0, 2], points[1, 2], points[2, 2]) < camera.near:
        return np.int64(0)
    # On which side of the plane of the face the camera is decides the direction of its image.
    ax, ay, az = points[0, 0], points[0, 1], points[0, 2]
    bx, by, bz = points[1, 0] - ax, points[1, 1] - ay, points[1, 2] - az
    cx, cy, cz = points[2, 0] - ax, points[2, 1] - ay, points[2, 2] - az
    height = (by * cz - bz * cy) * ax + (bz * cx - bx * cz) * ay + (bx * cy - by * cx) * az
    n = cut_in_space(points, np.int64(3), 0.0, 0.0, 1.0, camera.near, spare)
    m = region.shape[0]
    for i in range(m):
        if n < 3:
            return np.int64(0)
        x0, y0, dx, dy, _ = side_at(region, m, i)
        n = cut_in_space(points, n, -dy, dx, dy * x0 - dx * y0, 0.0, spare)
    if n < 3:
        return np.int64(0)
    for p in range(n):
        q = p if height > 0 else n - 1 - p
        polygon[p, 0], polygon[p, 1] = points[q, 0] / points[q, 2], points[q, 1] / points[q, 2]
    return np.int64(n)


@part_with_arrays
def to_plane(corners, n, is_reversed, camera, polygon):
    """Fill `polygon` with corners in the image of the pinhole of a plane, in its units."""
    for p in range(n):
        q = n - 1 - p if is_reversed else p
        polygon[p, 0] = (corners[q, U] - camera.cx) / camera.fx
        polygon[p, 1] = (corners[q, V] - camera.cy) / camera.fy


@allocation_free
def collect(vertices, is_done, projected, kept, camera, plane, scratch, found):
    """List the outlines of the other faces, and the kept pieces, in units of an ideal plane.

    Returns the number of outlines, which come first.

    Parameters
    ----------
    vertices : (V, 3) float64
    is_done : (F,) bool
        Of `measure_simple`.
    projected : Projected
    kept : VisiblePieces
    camera : Pinhole
    plane : PlaneRecord
    scratch : Scratch
    found : VisiblePieces
        Out: the polygons.
    """
    faces, uvw, state = projected.faces, projected.uvw, projected.state
    polygon, spare = scratch.polygon, scratch.spare
    points, spare_points = scratch.points, scratch.spare_points
    found.used[:] = 0
    for f in range(state.shape[0]):
        if is_done[f]:
            continue
        if not state[f] & LIVE:
            # Seen from behind and left out; others have nothing in the image of the pinhole.
            if projected.area[f] > 0.0:
                n = outline_in_space(
                    vertices, faces, f, camera, plane.window, points, spare_points, polygon
                )
                if n >= 3:
                    append_cut(polygon, n, f, plane, spare, found)
            continue
        if state[f] & CLIPPED:
            s = projected.clipped_index[f]
            n = np.int64(projected.clipped.n_corners[s])
            copy_polygon(projected.clipped.polygons[s], n, spare)
        else:
            n = np.int64(3)
            for p in range(3):
                spare[p, U], spare[p, V] = uvw[faces[f, p], U], uvw[faces[f, p], V]
        if n >= 3:
            to_plane(spare, n, twice_area(spare, n) < 0, camera, polygon)
            append_cut(polygon, n, f, plane, spare, found)
    n_outlines = found.used[0]
    for i in range(kept.used[0]):
        start = kept.starts[i]
        n = kept.starts[i + 1] - start
        to_plane(kept.corners[start:], n, False, camera, polygon)
        append_cut(polygon, n, kept.faces[i], plane, spare, found)
    return n_outlines


Seen = namedtuple("Seen", "places is_inside bulge n_faces")
"""Images of the vertices and edges of a surface of `n_faces` in one plane.

`places`, (V', 4), are x, y in units of the plane and u, v in px, `is_inside`, (V',), vertices
of its window, and `bulge`, (E,), areas between the image of an edge and its chord; NaN where
unknown.
"""


Figures = namedtuple("Figures", "area visible area_error n_certified n_visible n_computed")
"""Sums over the planes of a camera, (F,): areas, px^2, and planes by the kind of their figure.

`n_certified` counts planes with a certified figure, `n_visible` those of them in which the face
is visible, `n_computed` the others that show it.
"""


FaceRule = namedtuple("FaceRule", "width height bend tolerance one part")
"""Numbers of a plane by which faces are measured.

`one` is the square of the length of the longest edge in one part; longer ones have parts of
twice `part` at most. For the others see `PlaneRecord`.
"""


@allocation_free
def are_beyond(points, eye, sides, margin):
    """True where all of some points, (N, 3), are on the outer side of one plane through the eye.

    Parameters
    ----------
    eye, sides : (3,), (5, 3) float64
        Camera centre, and the inner normals of the planes.
    margin : float
        Distance from a plane that is no rounding, relative to that of the farthest point so far.
    """
    met, far = 0, 0.0
    for i in range(points.shape[0]):
        a, b, c = points[i, 0] - eye[0], points[i, 1] - eye[1], points[i, 2] - eye[2]
        far = max(far, abs(a), abs(b), abs(c))
        for s in range(5):
            if a * sides[s, 0] + b * sides[s, 1] + c * sides[s, 2] >= -margin * far:
                met |= 1 << s
        if met == 31:
            return False
    return True


@allocation_free
def measure_simple(faces, sides, is_flat, state, seen, plane, own, own_error, is_done, out):
    """Measure the faces that are wholly inside the image or outside it, by shared edges.

    Parameters
    ----------
    faces : (O', 3) int32
        The O opaque faces, of `whole_groups`.
    sides : (O', 3) int32
        Edges of the faces, see `lens_solver.directed_sides`.
    is_flat, state : (F,) bool, (F,) uint16
        With `SPARE_ENTRIES` values behind them.
    seen : Seen
        Images of vertices and edges.
    own, own_error : (F + SPARE_ENTRIES,) float64
        Out: drawn area of each face in this plane, and its bound; 0 for those that are not
        measured.
    is_done : (F + SPARE_ENTRIES,) bool
        Out: faces that are measured, or need not be.
    out : Figures
    """
    rounding = EDGE_ROUNDING * (plane.width + plane.height)
    rule = FaceRule(
        plane.width, plane.height, plane.bend, plane.tolerance,
        4 * plane.longest[MOST] * plane.longest[MOST], plane.longest[plane.parts_of],
    )  # fmt: skip
    n_opaque = seen.n_faces
    for first in range(0, faces.shape[0], AT_A_TIME):
        measure_faces(
            first, pointer(faces), pointer(sides), pointer(is_flat), pointer(state),
            pointer(seen.places), pointer(seen.bulge), rule, rounding, pointer(own),
            pointer(is_done), pointer(own_error),
        )  # fmt: skip
    for f in range(n_opaque):
        out.area[f] += own[f]
        out.area_error[f] += own_error[f]
    for f in range(n_opaque, state.shape[0]):
        own[f], is_done[f] = 0.0, bool(is_flat[f]) or state[f] & THIN != 0


@part_with_arrays
def length_of(corners, first, last, plane):
    """Length of the outline of a polygon, px of the pinhole; at most twice its box is as good."""
    low_x, high_x, low_y, high_y = extent_of(corners[first:last], last - first)
    return 2 * ((high_x - low_x) * plane.fx + (high_y - low_y) * plane.fy)


@allocation_free
def add_areas(found, n_outlines, images, projected, kept, pinhole, plane, own, out):
    """Add the images of polygons to the figures of faces.

    Parameters
    ----------
    found, n_outlines : VisiblePieces, int
        Of `collect`.
    images : (M, 2) float64
        Of `rastercov.kernels.lens_polygons.measure_polygons`.
    pinhole : tuple
        Visible area (F,), error (F,) and certificates (F,) of the pinhole, px^2 of its image.
    own : (F,) float64
        Of `measure_simple`, and lost.
    out : Figures
    """
    state, (visible, area_error, is_certified) = projected.state, pinhole
    n_faces = state.shape[0]
    rounding = EDGE_ROUNDING * (plane.width + plane.height) * plane.speed
    # A face with pieces is partly visible; one without is wholly visible or wholly hidden.
    for i in range(found.used[0]):
        f, inside = found.faces[i], images[i, 0]
        out.area_error[f] += images[i, 1] * plane.tolerance + rounding * length_of(
            found.corners, found.starts[i], found.starts[i + 1], plane
        )
        if i < n_outlines:
            own[f] += inside
            out.area[f] += inside
        else:
            out.visible[f] += inside
    for i in range(kept.used[0]):
        own[kept.faces[i]] = -1.0
    for f in range(n_faces):
        if not state[f] & (LIVE | THIN):
            continue
        if own[f] > 0.0 and visible[f] > 0.0:
            out.visible[f] += own[f]
        if is_certified[f]:
            out.n_certified[f] += 1
            if visible[f] > 0.0:
                out.n_visible[f] += 1
        else:
            out.n_computed[f] += 1
            out.area_error[f] += plane.stretch * area_error[f]


@allocation_free
def settle(figures, largest, is_certified):
    """Fill (F,) `is_certified` from the figures of all planes, and limit bounds to `largest`, px^2.

    A face is certified if all planes that show it certify it, with one answer.
    """
    visible, area_error = figures.visible, figures.area_error
    for f in range(is_certified.shape[0]):
        n, n_visible = figures.n_certified[f], figures.n_visible[f]
        is_one = n_visible == 0 or n_visible == n
        is_certified[f] = n > 0 and figures.n_computed[f] == 0 and is_one
        if is_certified[f] and n_visible > 0:
            visible[f] = figures.area[f]
        area_error[f] = min(area_error[f], largest)
