"""Stage 4 of the CPU rasteriser: edge functions and depth planes of a vector of triangles.

J. Pineda. A Parallel Algorithm for Polygon Rasterization. 1988.
"""

from contextlib import nullcontext

from numba.core import types

from rastercov.kernels.raster_memory import (
    BUFFER_SIZE,
    COVERAGE,
    EDGE,
    EDGE_DX,
    EDGE_DY,
    FACE,
    FACES,
    FIRST_X,
    FIRST_Y,
    GREATEST,
    HALF_SAMPLE,
    LANES,
    LAST_X,
    LAST_Y,
    LEAST,
    ORIGIN,
    SIDE_BITS,
    SLOPE_X,
    SLOPE_Y,
    STEP_BITS,
    STEP_X,
    STEP_Y,
    STEPS,
    VERTICES,
)
from rastercov.kernels.simd import DOUBLE, WORD, pack
from rastercov.kernels.simd_kernel import simd, when


def corners_of(packed, vertices, kind):
    """Corners of a vector of faces: (u, v, 1/z) and whole steps (x, y) of each of the three.

    In 32 bits these are vertices of the cluster. Triangles in 64 bits may be the result of clipping
    and have corners behind those.
    """
    n = VERTICES if kind == WORD else BUFFER_SIZE
    exact, whole = [], []
    for k in range(3):
        index = packed >> 8 * k & (BUFFER_SIZE - 1)
        rows = vertices.u, vertices.v, vertices.w, vertices.x, vertices.y
        u, v, w, x, y = (row.lookup(n, index) for row in rows)
        exact.append((u, v, w))
        whole.append((x.to(kind), y.to(kind)))
    return exact, whole


def sample_bounds(places, window):
    """First and last column, first and last row of the samples in reach; width, height in steps."""
    (ax, ay), (bx, by), (cx, cy) = places
    low_x, high_x = ax.minimum(bx).minimum(cx), ax.maximum(bx).maximum(cx)
    low_y, high_y = ay.minimum(by).minimum(cy), ay.maximum(by).maximum(cy)
    first_x = ((low_x + (HALF_SAMPLE - 1)) >> STEP_BITS).maximum(0)
    last_x = ((high_x - HALF_SAMPLE) >> STEP_BITS).minimum(window.right)
    first_y = ((low_y + (HALF_SAMPLE - 1)) >> STEP_BITS).maximum(window.top)
    last_y = ((high_y - HALF_SAMPLE) >> STEP_BITS).minimum(window.bottom)
    return first_x, last_x, first_y, last_y, high_x - low_x, high_y - low_y


def edge_functions(places, area, column, row):
    """Edge functions at samples: (value, step to the next column, step to the next row) of three.

    In units of `STEPS`, rounded down; not negative inside and on left and upper edges.
    """
    (ax, ay), (bx, by), (cx, cy) = places
    is_turned = area < 0
    px, py = cx.where(is_turned, bx), cy.where(is_turned, by)
    qx, qy = bx.where(is_turned, cx), by.where(is_turned, cy)
    x, y = (column << STEP_BITS) + HALF_SAMPLE, (row << STEP_BITS) + HALF_SAMPLE
    bits = area.kind.width
    rest = (-area).where(is_turned, area)  # the sum of the three
    found = []
    for from_x, from_y, to_x, to_y in ((ax, ay, px, py), (px, py, qx, qy), (qx, qy, ax, ay)):
        dx, dy = to_x - from_x, to_y - from_y
        value = rest if len(found) == 2 else dx * (y - from_y) - dy * (x - from_x)
        rest = rest - value
        # -1 on a left or an upper edge, where y falls, or stays while x grows; else 0.
        is_left_or_upper = ((dy << bits // 2) - dx) >> bits - 1
        found.append(((value - 1 - is_left_or_upper) >> STEP_BITS, -dy, dx))
    return found


def signs(values):
    """Negative where one of three values is."""
    return values[0] | values[1] | values[2]


def _put_planes(exact, places, area, setup):
    """Write planes of 1/z, which is affine in the image: w = w_a + slope . (position - a).

    Through the corners before rounding; through the rounded ones where the triangle is too thin.
    """
    (au, av, aw), (bu, bv, bw), (cu, cv, cw) = exact
    rounded = area.to(DOUBLE)
    change = ((bu - au) * (cv - av) - (cu - au) * (bv - av) - rounded).absolute()
    is_thin = change > rounded.absolute() * 0.25
    (au, av), (bu, bv), (cu, cv) = (
        (x.to(DOUBLE).where(is_thin, u), y.to(DOUBLE).where(is_thin, v))
        for (x, y), (u, v) in zip(places, ((au, av), (bu, bv), (cu, cv)), strict=True)
    )
    ab_x, ab_y, ac_x, ac_y = bu - au, bv - av, cu - au, cv - av
    w_ab, w_ac = bw - aw, cw - aw
    scale = aw.like(STEPS) / (ab_x * ac_y - ac_x * ab_y)
    slope_x = (w_ab * ac_y - w_ac * ab_y) * scale
    slope_y = (w_ac * ab_x - w_ab * ac_x) * scale
    change = slope_x * (au.like(HALF_SAMPLE) - au) + slope_y * (av.like(HALF_SAMPLE) - av)
    setup.plane64[ORIGIN] = aw + change * (1.0 / STEPS)
    setup.plane64[SLOPE_X] = setup.plane32[STEP_X] = slope_x
    setup.plane64[SLOPE_Y] = setup.plane32[STEP_Y] = slope_y
    # Rounding puts samples slightly outside the triangle; their depth stays within the corners'.
    setup.plane32[LEAST] = aw.minimum(bw).minimum(cw)
    setup.plane32[GREATEST] = aw.maximum(bw).maximum(cw)


@simd(returns=types.UniTuple(types.int64, 2))
def set_up_triangles(slots, at, wants_edges, faces, window, setup):
    """Edge functions, bounds and depth planes of a vector of triangles.

    Edge functions have the type of `setup.edges`, and are computed where `wants_edges` is not 0.
    Returns 3 masks: reaches at most 2 x 2 blocks, two columns of blocks, two rows of blocks; and 2
    masks: shown and may cover a sample, judged by its bounds; hidden likewise. The entries of the
    list `slots` from `at` on are the slots of the triangles. Writes all rows of `setup` but
    those of samples, blocks and tiles.
    """
    slot = slots.at(at)[0]
    (exact, places, area), bounds = _set_up(slot, wants_edges, faces, window, setup)
    setup.bounds[COVERAGE] = faces.coverage_2x2.lookup(FACES, slot)
    _put_planes(exact, places, area, setup)
    first_x, last_x, first_y, last_y = bounds
    columns = (last_x >> SIDE_BITS) - (first_x >> SIDE_BITS)
    rows = (last_y >> SIDE_BITS) - (first_y >> SIDE_BITS)
    hides = (window.hides_back > 0).broadcast(LANES)
    can_cover = (last_x >= first_x) & (last_y >= first_y)
    shown = can_cover & ((area < 0) | ((area > 0) & ~hides))
    hidden = can_cover & (area > 0) & hides
    return pack((columns <= 1) & (rows <= 1), columns > 0, rows > 0), pack(shown, hidden)


@simd(returns=types.void)
def set_up_edges(slots, at, faces, window, setup):
    """Edge functions and bounds of a vector of triangles, see `set_up_triangles`."""
    _set_up(slots.at(at)[0], None, faces, window, setup)


def _set_up(slot, wants_edges, faces, window, setup):
    """Write edge functions and bounds; returns (exact corners, whole corners, area) and bounds."""
    packed = faces.mesh.corners.at(faces.first_slot).lookup(FACES, slot)
    face = faces.mesh.faces.at(faces.first_slot).lookup(FACES, slot)
    edges = setup.edges
    exact, places = corners_of(packed, faces.vertices, edges.kind)
    bounds = sample_bounds(places, window)[:4]
    (ax, ay), (bx, by), (cx, cy) = places
    area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    column, row = (bounds[k] >> SIDE_BITS << SIDE_BITS for k in (0, 2))
    with when(~wants_edges.equals(0)) if wants_edges else nullcontext():
        for k, (value, dx, dy) in enumerate(edge_functions(places, area, column, row)):
            edges[EDGE + k], edges[EDGE_DX + k], edges[EDGE_DY + k] = value, dx, dy
    for k, bound in zip((FIRST_X, LAST_X, FIRST_Y, LAST_Y), bounds, strict=True):
        setup.bounds[k] = bound
    setup.bounds[FACE] = face
    return (exact, places, area), bounds
