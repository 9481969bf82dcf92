"""The loops of the CPU rasteriser, compiled by numba.

They stand in one file because numba keeps what it compiled by file: a loop that calls into another
file would not notice a change there.

A pose runs through four passes. `project` brings vertices to the image, in steps of 1/256 of a
sample. `set_up` keeps the triangles that can own a sample, clips those that reach behind the camera
or far outside the image, and counts the tiles each one touches. `bin_triangles` lists them by tile,
in the order of their faces. `fill_tiles` takes one tile at a time, small enough for the cache, and
fills each triangle row by row, sixteen samples at once.

A sample on a left or upper edge is inside, on a right or lower one outside, and all of it is
reckoned in whole numbers, so every sample belongs to exactly one of two triangles that share an
edge. Small triangles ask their three edge functions (Pineda). On the rows of large ones edges are
walked from their upper end to their lower (Bresenham), so that what lies between them is known
without looking at each sample.

No image is kept. A sample counts for its face when it is written and is taken from the face that
held it before, so what remains at the end of a tile are the visible samples.

J. Pineda. A Parallel Algorithm for Polygon Rasterization. 1988, for tiles and edge functions.
J. E. Bresenham. Algorithm for Computer Control of a Digital Plotter. 1965, for the edges.
"""

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from rastercov.compiled import compiled, inlined

TILE_BITS_X, TILE_BITS_Y = 7, 6
TILE_WIDTH, TILE_HEIGHT = 1 << TILE_BITS_X, 1 << TILE_BITS_Y
"""Samples of a tile: 32 KiB of depth and 32 KiB of faces."""
BITS = 8
STEPS = 1 << BITS
HALF = STEPS // 2
"""Sub-sample steps, as many as graphics devices have. Shifts divide: `//` would test for zero."""
FAR_OUT = 1 << 29
"""Steps from the origin beyond which a vertex is clipped: edges then fit 64 bits with room."""
CLIPPED = np.int32(2**31 - 1)
"""Steps of a vertex that is."""
CLIP_CORNERS = 8
"""A triangle cut by five planes has at most this many corners."""


# --- many samples at once -------------------------------------------------------------------------
# numba turns loops into vector code only where they are long. The rows of most triangles are not.

LANES, ALL_LANES = 16, 0xFFFF
LANE = ir.VectorType(ir.IntType(32), LANES)(list(range(LANES)))
DOUBLES = ir.VectorType(ir.DoubleType(), LANES)
FLOATS = ir.VectorType(ir.FloatType(), LANES)
WORDS = ir.VectorType(ir.IntType(32), LANES)
BITS_OF_LANES = ir.VectorType(ir.IntType(1), LANES)


def _all_lanes(builder, value, vector):
    """The same value in every lane."""
    one = builder.insert_element(ir.Constant(vector, ir.Undefined), value, ir.IntType(32)(0))
    return builder.shuffle_vector(one, one, WORDS([0] * LANES))


def _lanes_at(context, builder, kind, array, at, vector):
    """Pointer to the elements of an array from `at` on."""
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [at]), vector.as_pointer())


def _lanes_of_bits(builder, bits):
    return builder.bitcast(builder.trunc(bits, ir.IntType(LANES)), BITS_OF_LANES)


def _bits_of_lanes(builder, lanes):
    return builder.zext(builder.bitcast(lanes, ir.IntType(LANES)), ir.IntType(64))


def _inverse_depths(builder, start, slope, least, greatest):
    """1/z of the lanes, start + slope * lane as floats, between least and greatest."""
    lanes = builder.sitofp(LANE, DOUBLES)
    rise = builder.fmul(_all_lanes(builder, slope, DOUBLES), lanes)
    exact = builder.fadd(_all_lanes(builder, start, DOUBLES), rise)
    here = builder.fptrunc(exact, FLOATS)
    low, high = (_all_lanes(builder, value, FLOATS) for value in (least, greatest))
    here = builder.select(builder.fcmp_ordered(">", here, low), here, low)
    return builder.select(builder.fcmp_ordered("<", here, high), here, high)


@intrinsic
def lanes_inside(typing, e0, step0, e1, step1, e2, step2):
    """Bits of the lanes where e + step * lane >= 0 for all three int32 edge functions."""

    def generate(context, builder, signature, args):
        sign = None
        for k in range(3):
            value, stride = (_all_lanes(builder, x, WORDS) for x in args[2 * k : 2 * k + 2])
            edge_function = builder.add(value, builder.mul(stride, LANE))
            sign = edge_function if sign is None else builder.or_(sign, edge_function)
        inside = builder.icmp_signed(">=", sign, WORDS([0] * LANES))
        return _bits_of_lanes(builder, inside)

    return types.int64(*[types.int32] * 6), generate


@intrinsic
def lanes_nearer(typing, depth, at, active, start, slope, least, greatest):
    """Bits of the active lanes that are nearer than `depth`; above them those that are not empty.

    depth[at + LANES - 1] must exist. 1/z of a lane is start + slope * lane, between `least` and
    `greatest`.
    """

    def generate(context, builder, signature, args):
        where = _lanes_at(context, builder, signature.args[0], args[0], args[1], FLOATS)
        old = builder.load(where, align=4)
        here = _inverse_depths(builder, *args[3:])
        nearer = builder.fcmp_ordered(">", here, old)
        nearer = builder.and_(nearer, _lanes_of_bits(builder, args[2]))
        full = builder.and_(nearer, builder.fcmp_ordered(">", old, FLOATS([0.0] * LANES)))
        shifted = builder.shl(_bits_of_lanes(builder, full), ir.IntType(64)(LANES))
        return builder.or_(_bits_of_lanes(builder, nearer), shifted)

    numbers = types.float64, types.float64, types.float32, types.float32
    return types.int64(depth, types.uint64, types.int64, *numbers), generate


@intrinsic
def fill_lanes(typing, depth, owner, at, nearer, start, slope, least, greatest, face):
    """Put depth and face into the lanes whose bits are set; the others keep what they have."""

    def generate(context, builder, signature, args):
        lanes = _lanes_of_bits(builder, args[3])
        here = _inverse_depths(builder, *args[4:8])
        values = here, _all_lanes(builder, args[8], WORDS)
        for k, value in enumerate(values):
            where = _lanes_at(context, builder, signature.args[k], args[k], args[2], value.type)
            mixed = builder.select(lanes, value, builder.load(where, align=4))
            builder.store(mixed, where, align=4)
        return context.get_dummy_value()

    numbers = types.float64, types.float64, types.float32, types.float32
    return types.void(depth, owner, types.uint64, types.int64, *numbers, types.int32), generate


@intrinsic
def count_bits(typing, bits):
    """How many bits are set."""

    def generate(context, builder, signature, args):
        return builder.ctpop(args[0])

    return types.int64(types.int64), generate


@intrinsic
def take_lanes(typing, visible, owner, at, lost):
    """Uncount the samples whose bits are set for the faces that had them."""

    def generate(context, builder, signature, args):
        counts, owners = (
            context.make_array(signature.args[k])(context, builder, args[k]).data for k in range(2)
        )
        for i in range(LANES):
            bit = builder.and_(args[3], ir.IntType(64)(1 << i))
            with builder.if_then(builder.icmp_unsigned("!=", bit, ir.IntType(64)(0))):
                lane = builder.add(args[2], ir.IntType(64)(i))
                face = builder.load(builder.gep(owners, [lane]))
                count = builder.gep(counts, [builder.zext(face, ir.IntType(64))])
                builder.store(builder.sub(builder.load(count), ir.IntType(64)(1)), count)
        return context.get_dummy_value()

    return types.void(visible, owner, types.uint64, types.int64), generate


# --- the passes -----------------------------------------------------------------------------------


@compiled
def project(vertices, rotation, eye, lens, near, u, v, w, steps):
    """Image positions and inverse depths of the vertices; returns how many must be clipped.

    Parameters
    ----------
    vertices : (V, 3) float64
        World points.
    rotation : (3, 3) float64
        world_from_camera.
    eye : (3,) float64
        Camera centre, from the same origin as the vertices.
    lens : (4,) float64
        fx, fy, cx, cy in samples.
    near : float
        Depth below which a vertex is cut off.
    u, v : (V,) float64
        Out: steps of 1/256 sample, not rounded; infinite where a vertex needs clipping.
    w : (V,) float64
        Out: 1/z.
    steps : (V, 2) int32
        Out: u and v, rounded: where a vertex stands when samples are given out.
    """
    outside = 0
    for i in range(vertices.shape[0]):
        a = vertices[i, 0] - eye[0]
        b = vertices[i, 1] - eye[1]
        c = vertices[i, 2] - eye[2]
        z = a * rotation[0, 2] + b * rotation[1, 2] + c * rotation[2, 2]
        u[i] = np.inf
        steps[i, 0] = CLIPPED
        if z >= near:
            w[i] = 1.0 / z
            right = a * rotation[0, 0] + b * rotation[1, 0] + c * rotation[2, 0]
            down = a * rotation[0, 1] + b * rotation[1, 1] + c * rotation[2, 1]
            across = (lens[0] * right * w[i] + lens[2]) * STEPS
            along = (lens[1] * down * w[i] + lens[3]) * STEPS
            if abs(across) <= FAR_OUT and abs(along) <= FAR_OUT:
                u[i], v[i] = across, along
                steps[i, 0], steps[i, 1] = np.floor(across + 0.5), np.floor(along + 0.5)
        if u[i] > FAR_OUT:
            outside += 1
    return outside


@compiled
def count_clipped(faces, u):
    """How many faces have a vertex that needs clipping."""
    n = 0
    for f in range(faces.shape[0]):
        if u[faces[f, 0]] > FAR_OUT or u[faces[f, 1]] > FAR_OUT or u[faces[f, 2]] > FAR_OUT:
            n += 1
    return n


@compiled
def clip(corners, n, plane, offset, out):
    """Keep the part of a convex polygon where plane . p >= offset; returns its corner count.

    A cut is always reckoned from the corner inside to the corner outside, so the two faces that
    share an edge cut it at the same point, bit for bit.
    """
    kept = 0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        here = (
            plane[0] * corners[i, 0] + plane[1] * corners[i, 1] + plane[2] * corners[i, 2] - offset
        )
        there = (
            plane[0] * corners[j, 0] + plane[1] * corners[j, 1] + plane[2] * corners[j, 2] - offset
        )
        if here >= 0:
            if kept == CLIP_CORNERS:
                return kept
            out[kept] = corners[i]
            kept += 1
        if (here >= 0) != (there >= 0):
            if kept == CLIP_CORNERS:
                return kept
            p, q = (i, j) if here >= 0 else (j, i)
            inside, beyond = (here, there) if here >= 0 else (there, here)
            t = inside / (inside - beyond)
            for k in range(3):
                out[kept, k] = corners[p, k] + t * (corners[q, k] - corners[p, k])
            kept += 1
    return kept


@inlined
def whole(steps, a, b, c):
    """Corners of a triangle in whole steps, 64 bits wide."""
    ax, ay = np.int64(steps[a, 0]), np.int64(steps[a, 1])
    bx, by = np.int64(steps[b, 0]), np.int64(steps[b, 1])
    cx, cy = np.int64(steps[c, 0]), np.int64(steps[c, 1])
    return ax, ay, bx, by, cx, cy


@inlined  # a call would pass every field of every array
def keep(a, b, c, face, steps, width, height, side, triangles, n, tiles, starts):
    """Note a triangle if it can own a sample; returns the new number of triangles."""
    ax, ay, bx, by, cx, cy = whole(steps, a, b, c)
    area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    if area == 0 or side * area < 0:
        return n
    left = max((min(ax, min(bx, cx)) + HALF - 1) >> BITS, 0)
    right = min((max(ax, max(bx, cx)) - HALF) >> BITS, width - 1)
    top = max((min(ay, min(by, cy)) + HALF - 1) >> BITS, 0)
    bottom = min((max(ay, max(by, cy)) - HALF) >> BITS, height - 1)
    if left > right or top > bottom:
        return n
    triangles[n, 0] = a
    triangles[n, 1] = b
    triangles[n, 2] = c
    triangles[n, 3] = face
    if side == 1:  # only counted, not filled
        return n + 1
    tiles[n, 0] = left >> TILE_BITS_X
    tiles[n, 1] = top >> TILE_BITS_Y
    tiles[n, 2] = right >> TILE_BITS_X
    tiles[n, 3] = bottom >> TILE_BITS_Y
    columns = (width + TILE_WIDTH - 1) >> TILE_BITS_X
    for row in range(tiles[n, 1], tiles[n, 3] + 1):
        for column in range(tiles[n, 0], tiles[n, 2] + 1):
            starts[row * columns + column + 1] += 1
    return n + 1


@compiled
def set_up(
    vertices, faces, rotation, eye, lens, near, size, side, u, v, w, steps, triangles, tiles, starts
):
    """Keep the triangles that can own a sample, clipped where they must be; returns their number.

    Parameters
    ----------
    vertices, rotation, eye, lens, near
        As for `project`.
    faces : (F, 3) int32
        Vertices of each face.
    size : (2,) int64
        Width and height of the image in samples.
    side : int
        -1 keeps what faces the camera, 1 what turns its back (positive area with rows running
        down), 0 both.
    u, v, w, steps
        From `project`, with room for `CLIP_CORNERS` vertices more for each clipped face.
    triangles : (N, 4) int32
        Out: vertices and face; room for F and `CLIP_CORNERS` more for each clipped face.
    tiles : (N, 4) int32
        Out: first and last tile column and row.
    starts : (T + 1,) int64
        Out: 1 + tile -> triangles in that tile.
    """
    width, height = size[0], size[1]
    starts[:] = 0
    n = 0
    extra = vertices.shape[0]
    polygon = np.empty((CLIP_CORNERS, 3))
    other = np.empty((CLIP_CORNERS, 3))
    plane = np.empty(3)
    reach = 0.99 * FAR_OUT / STEPS
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        if max(steps[a, 0], max(steps[b, 0], steps[c, 0])) != CLIPPED:
            n = keep(a, b, c, f, steps, width, height, side, triangles, n, tiles, starts)
            continue
        for i in range(3):
            p = faces[f, i]
            d0 = vertices[p, 0] - eye[0]
            d1 = vertices[p, 1] - eye[1]
            d2 = vertices[p, 2] - eye[2]
            for k in range(3):
                polygon[i, k] = d0 * rotation[0, k] + d1 * rotation[1, k] + d2 * rotation[2, k]
        if max(polygon[0, 2], max(polygon[1, 2], polygon[2, 2])) < near:
            continue  # all behind, as most of these are for a camera in a room
        plane[0], plane[1], plane[2] = 0.0, 0.0, 1.0
        corners = clip(polygon, 3, plane, near, other)
        for border in range(4):
            # |u| <= reach, |v| <= reach: +-(f x + c z) <= reach z
            sign = 1.0 if border % 2 == 0 else -1.0
            axis = border // 2
            plane[:] = 0.0
            plane[axis] = sign * lens[axis]
            plane[2] = sign * lens[2 + axis] + reach
            for i in range(corners):
                polygon[i] = other[i]
            corners = clip(polygon, corners, plane, 0.0, other)
        if corners < 3:
            continue
        for i in range(corners):
            w[extra + i] = 1.0 / other[i, 2]
            u[extra + i] = (lens[0] * other[i, 0] * w[extra + i] + lens[2]) * STEPS
            v[extra + i] = (lens[1] * other[i, 1] * w[extra + i] + lens[3]) * STEPS
            steps[extra + i, 0] = np.floor(u[extra + i] + 0.5)
            steps[extra + i, 1] = np.floor(v[extra + i] + 0.5)
        for i in range(1, corners - 1):
            n = keep(
                extra, extra + i, extra + i + 1, f, steps, width, height, side, triangles, n,
                tiles, starts,
            )  # fmt: skip
        extra += corners
    for tile in range(1, starts.shape[0]):
        starts[tile] += starts[tile - 1]
    return n


@compiled
def bin_triangles(n, tiles, columns, starts, places, listed):
    """List the triangles of each tile, in order; `places` is a copy of `starts` to count up."""
    for k in range(n):
        for row in range(tiles[k, 1], tiles[k, 3] + 1):
            for column in range(tiles[k, 0], tiles[k, 2] + 1):
                tile = row * columns + column
                listed[places[tile]] = k
                places[tile] += 1


@compiled
def divide(numerator, divisor, inverse):
    """Quotient, rounded down, and remainder of whole numbers, by their rough product in floats.

    Quotients stay below 2^32, so it is right to within one, and the remainder says which way.
    """
    quotient = np.int64(np.floor(numerator * inverse))
    rest = numerator - quotient * divisor
    if rest < 0:
        return quotient - 1, rest + divisor
    if rest >= divisor:
        return quotient + 1, rest - divisor
    return quotient, rest


@compiled
def edge(xa, ya, xb, yb, row):
    """First sample on a row at or right of an edge that runs down from a to b.

    With X the crossing of the edge and the row's samples, it is ceil((X - 128) / 256), kept as a
    quotient and a remainder; the stride to the next row likewise.

    Returns
    -------
    (sample, remainder, stride a row, its remainder, divisor) : int64
    """
    dy = yb - ya
    divisor = dy << BITS
    inverse = 1.0 / divisor
    across = (xb - xa) * ((row << BITS) + HALF - ya)
    sample, rest = divide((xa - HALF) * dy + across + divisor - 1, divisor, inverse)
    stride, stride_rest = divide((xb - xa) << BITS, divisor, inverse)
    return sample, rest, stride, stride_rest, divisor


@compiled
def from_top(ax, ay, bx, by, cx, cy):
    """Corners of a triangle from top to bottom: a above b above c."""
    if by < ay:
        ax, ay, bx, by = bx, by, ax, ay
    if cy < ay:
        ax, ay, cx, cy = cx, cy, ax, ay
    if cy < by:
        bx, by, cx, cy = cx, cy, bx, by
    return ax, ay, bx, by, cx, cy


@compiled
def inner_edge(ax, ay, bx, by, column, row):
    """Edge function of a to b at a sample, its step to the next sample and to the next row.

    It is 0 or more inside a triangle whose area is positive with rows running down; 1 is taken from
    it on right and lower edges, whose samples are outside.
    """
    dx, dy = bx - ax, by - ay
    value = dx * ((row << BITS) + HALF - ay) - dy * ((column << BITS) + HALF - ax)
    is_left_or_upper = dy < 0 or (dy == 0 and dx > 0)
    return value if is_left_or_upper else value - 1, -dy << BITS, dx << BITS


@compiled
def count_drawn(n, steps, size, first, last, triangles, drawn):
    """Add the samples of each triangle, hidden or not, to the count of its face.

    Parameters
    ----------
    n, steps, size, triangles
        From the passes before.
    first, last : (height,) int32
        Samples of each row that count: from the first up to the last.
    drawn : (F,) int64
        Out: samples to add to.
    """
    least, greatest = 0, size[0]  # samples that count on every row
    for row in range(size[1]):
        least, greatest = max(least, first[row]), min(greatest, last[row])
    for k in range(n):
        a, b, c = triangles[k, 0], triangles[k, 1], triangles[k, 2]
        ax, ay, bx, by, cx, cy = whole(steps, a, b, c)
        covered = 0
        left = (min(ax, min(bx, cx)) + HALF - 1) >> BITS
        right = (max(ax, max(bx, cx)) - HALF) >> BITS
        row = (min(ay, min(by, cy)) + HALF - 1) >> BITS
        end_row = ((max(ay, max(by, cy)) - HALF) >> BITS) + 1
        if right - left < LANES and end_row - row <= TILE_HEIGHT:
            row, end_row = max(row, 0), min(end_row, size[1])
            if (bx - ax) * (cy - ay) < (cx - ax) * (by - ay):
                bx, by, cx, cy = cx, cy, bx, by
            e0, across0, down0 = inner_edge(ax, ay, bx, by, left, row)
            e1, across1, down1 = inner_edge(bx, by, cx, cy, left, row)
            e2, across2, down2 = inner_edge(cx, cy, ax, ay, left, row)
            while row < end_row:
                inside = lanes_inside(
                    np.int32(e0), np.int32(across0), np.int32(e1), np.int32(across1),
                    np.int32(e2), np.int32(across2),
                )  # fmt: skip
                if left < least or right >= greatest:
                    begin = min(max(first[np.uint64(row)] - left, 0), LANES)
                    end = min(max(last[np.uint64(row)] - left, 0), LANES)
                    inside &= (ALL_LANES << begin) & (ALL_LANES >> (LANES - end))
                covered += count_bits(inside)
                row += 1
                e0 += down0
                e1 += down1
                e2 += down2
            drawn[triangles[k, 3]] += covered
            continue
        ax, ay, bx, by, cx, cy = from_top(ax, ay, bx, by, cx, cy)
        row = max((ay + HALF - 1) >> BITS, 0)
        middle = min((by + HALF - 1) >> BITS, size[1])
        bottom = min((cy + HALF - 1) >> BITS, size[1])
        long_is_left = (bx - ax) * (cy - ay) > (cx - ax) * (by - ay)
        long, long_rest, long_step, long_step_rest, long_divisor = edge(ax, ay, cx, cy, row)
        for part in range(2):
            end_row = middle if part == 0 else bottom
            if row >= end_row:
                continue
            if part == 0:
                short, rest, stride, stride_rest, divisor = edge(ax, ay, bx, by, row)
            else:
                short, rest, stride, stride_rest, divisor = edge(bx, by, cx, cy, row)
            while row < end_row:
                left = max(long if long_is_left else short, first[np.uint64(row)])
                right = min(short if long_is_left else long, last[np.uint64(row)])
                covered += max(right - left, 0)
                row += 1
                long += long_step
                long_rest += long_step_rest
                if long_rest >= long_divisor:
                    long_rest -= long_divisor
                    long += 1
                short += stride
                rest += stride_rest
                if rest >= divisor:
                    rest -= divisor
                    short += 1
        drawn[triangles[k, 3]] += covered


@compiled
def fill_tiles(
    u, v, w, steps, size, first, last, triangles, starts, listed, depth, owner, visible, drawn,
    image_face, image_depth,
):  # fmt: skip
    """Fill all tiles; count visible and drawn samples of each face, and keep the image if asked.

    Parameters
    ----------
    u, v, w, steps, size, triangles, starts, listed
        From the passes before.
    first, last : (height,) int32
        Samples of each row to fill, from the first up to the last: those that count.
    depth : (tile samples + LANES,) float32
        Scratch: 1/z, 0 where nothing is.
    owner : (tile samples + LANES,) int32
        Scratch: face at each sample.
    visible, drawn : (F,) int64
        Out: samples to add to.
    image_face : (H, W) int32, image_depth : (H, W) float32
        Out: face and depth, or of size 0.
    """
    width, height = size[0], size[1]
    columns = (width + TILE_WIDTH - 1) >> TILE_BITS_X
    for tile in range(starts.shape[0] - 1):
        if starts[tile] == starts[tile + 1]:
            continue
        tile_x = (tile % columns) * TILE_WIDTH
        tile_y = (tile // columns) * TILE_HEIGHT
        end_x = min(width, tile_x + TILE_WIDTH)
        end_y = min(height, tile_y + TILE_HEIGHT)
        is_cut = False  # by the slanted border of an image whose samples are rolled
        for row in range(tile_y, end_y):
            is_cut |= first[row] > tile_x or last[row] < end_x
        depth[:] = 0.0
        for place in range(starts[tile], starts[tile + 1]):
            k = listed[place]
            a, b, c = triangles[k, 0], triangles[k, 1], triangles[k, 2]
            face = triangles[k, 3]
            ax, ay, bx, by, cx, cy = whole(steps, a, b, c)
            # 1/z is affine in the image: w = w_a + slope_x (u - u_a) + slope_y (v - v_a), from the
            # corners as they are; as rounded where the triangle is too thin for that.
            ab_x, ab_y, ac_x, ac_y = u[b] - u[a], v[b] - v[a], u[c] - u[a], v[c] - v[a]
            from_x, from_y = u[a], v[a]
            area = ab_x * ac_y - ac_x * ab_y
            rounded = float((bx - ax) * (cy - ay) - (cx - ax) * (by - ay))
            if abs(area - rounded) > 0.25 * abs(rounded):
                ab_x, ab_y, ac_x, ac_y = bx - ax, by - ay, cx - ax, cy - ay
                from_x, from_y = ax, ay
                area = rounded
            w_ab, w_ac = w[b] - w[a], w[c] - w[a]
            slope_x = (w_ab * ac_y - w_ac * ab_y) * (STEPS / area)
            slope_y = (w_ac * ab_x - w_ab * ac_x) * (STEPS / area)
            origin = w[a] + (slope_x * (HALF - from_x) + slope_y * (HALF - from_y)) / STEPS
            # Rounding lets a sample lie a hair beyond the corners; its depth does not.
            least = np.float32(min(w[a], min(w[b], w[c])))
            greatest = np.float32(max(w[a], max(w[b], w[c])))
            gained = 0
            covered = 0
            left = (min(ax, min(bx, cx)) + HALF - 1) >> BITS
            right = (max(ax, max(bx, cx)) - HALF) >> BITS
            row = (min(ay, min(by, cy)) + HALF - 1) >> BITS
            end_row = ((max(ay, max(by, cy)) - HALF) >> BITS) + 1
            is_whole = left >= tile_x and right < end_x and row >= tile_y and end_row <= end_y
            if right - left < LANES and is_whole and not is_cut:
                if rounded < 0:
                    bx, by, cx, cy = cx, cy, bx, by
                e0, across0, down0 = inner_edge(ax, ay, bx, by, left, row)
                e1, across1, down1 = inner_edge(bx, by, cx, cy, left, row)
                e2, across2, down2 = inner_edge(cx, cy, ax, ay, left, row)
                while row < end_row:
                    active = lanes_inside(
                        np.int32(e0), np.int32(across0), np.int32(e1), np.int32(across1),
                        np.int32(e2), np.int32(across2),
                    )  # fmt: skip
                    if active:
                        covered += count_bits(active)
                        at = np.uint64((row - tile_y) * TILE_WIDTH + left - tile_x)
                        start = origin + slope_x * left + slope_y * row
                        found = lanes_nearer(depth, at, active, start, slope_x, least, greatest)
                        if found >> LANES:
                            take_lanes(visible, owner, at, found >> LANES)
                        nearer = found & ALL_LANES
                        fill_lanes(depth, owner, at, nearer, start, slope_x, least, greatest, face)
                        gained += count_bits(nearer)
                    row += 1
                    e0 += down0
                    e1 += down1
                    e2 += down2
                visible[face] += gained
                drawn[face] += covered
                continue
            ax, ay, bx, by, cx, cy = from_top(ax, ay, bx, by, cx, cy)
            long_is_left = (bx - ax) * (cy - ay) > (cx - ax) * (by - ay)
            row = max((ay + HALF - 1) >> BITS, tile_y)
            middle = min((by + HALF - 1) >> BITS, end_y)
            bottom = min((cy + HALF - 1) >> BITS, end_y)
            if row >= bottom:
                continue
            far, far_rest, far_step, far_step_rest, far_divisor = edge(ax, ay, cx, cy, row)
            for part in range(2):
                end_row = middle if part == 0 else bottom
                if row >= end_row:
                    continue
                if part == 0:
                    turn, rest, stride, stride_rest, divisor = edge(ax, ay, bx, by, row)
                else:
                    turn, rest, stride, stride_rest, divisor = edge(bx, by, cx, cy, row)
                while row < end_row:
                    begin = max(far if long_is_left else turn, tile_x)
                    end = min(turn if long_is_left else far, end_x)
                    if is_cut:
                        begin = max(begin, np.int64(first[np.uint64(row)]))
                        end = min(end, np.int64(last[np.uint64(row)]))
                    covered += max(end - begin, 0)
                    at = np.uint64((row - tile_y) * TILE_WIDTH + begin - tile_x)
                    while begin < end:
                        active = ALL_LANES >> max(LANES - (end - begin), 0)
                        start = origin + slope_x * begin + slope_y * row
                        found = lanes_nearer(depth, at, active, start, slope_x, least, greatest)
                        if found >> LANES:
                            take_lanes(visible, owner, at, found >> LANES)
                        nearer = found & ALL_LANES
                        fill_lanes(depth, owner, at, nearer, start, slope_x, least, greatest, face)
                        gained += count_bits(nearer)
                        begin += LANES
                        at += np.uint64(LANES)
                    row += 1
                    far += far_step
                    far_rest += far_step_rest
                    if far_rest >= far_divisor:
                        far_rest -= far_divisor
                        far += 1
                    turn += stride
                    rest += stride_rest
                    if rest >= divisor:
                        rest -= divisor
                        turn += 1
            visible[face] += gained
            drawn[face] += covered
        if image_face.size:
            for j in range(tile_y, end_y):
                for i in range(tile_x, end_x):
                    at_sample = (j - tile_y) * TILE_WIDTH + i - tile_x
                    if depth[at_sample] > 0:
                        image_face[j, i] = owner[at_sample]
                        image_depth[j, i] = np.float32(1.0 / depth[at_sample])


@compiled
def count_poses(
    poses, nears, culls, begin, end, vertices, faces, lens, size, first, last, u, v, w, steps,
    triangles, tiles, starts, places, listed, depth, owner, room, visible, drawn, with_drawn,
    image_face, image_depth,
):  # fmt: skip
    """Count the poses from `begin` on; returns the first one that was not counted.

    That is `end`, or a pose for which the scratch memory is too small: `room` clipped corners, or
    the triangles listed by tile. Call again from it with more: its rows start from 0 again.

    Parameters
    ----------
    poses : (P, 4, 4) float64
        world_from_camera, from the same origin as the vertices. The first two axes need not be at
        right angles to each other: `rastercov.raster.grid` mixes them to roll the samples.
    nears : (P,) float64
        Near plane of each pose.
    culls : (P,) bool
        Whether the faces that turn their back can be left out.
    visible, drawn : (P, F) int64
        Out: samples; with `with_drawn` false, all poses share the one row of `drawn`.
    image_face, image_depth
        As for `fill_tiles`.

    The other arguments are those of the passes.
    """
    columns = (size[0] + TILE_WIDTH - 1) >> TILE_BITS_X
    rotation = np.empty((3, 3))
    eye = np.empty(3)
    for p in range(begin, end):
        for i in range(3):
            eye[i] = poses[p, i, 3]
            for j in range(3):
                rotation[i, j] = poses[p, i, j]
        outside = project(vertices, rotation, eye, lens, nears[p], u, v, w, steps)
        if outside and CLIP_CORNERS * count_clipped(faces, u) > room:
            return p
        row = p if with_drawn else 0
        visible[p] = 0
        drawn[row] = 0
        # What turns its back hides nothing where it can be culled, but owns samples all the same.
        for side in range(1, -2, -1):
            if (side == 0) == culls[p] or (side == 1 and not with_drawn):
                continue
            n = set_up(
                vertices, faces, rotation, eye, lens, nears[p], size, side, u, v, w, steps,
                triangles, tiles, starts,
            )  # fmt: skip
            if starts[-1] > listed.shape[0]:
                return p
            if side == 1:
                count_drawn(n, steps, size, first, last, triangles, drawn[row])
                continue
            places[:] = starts
            bin_triangles(n, tiles, columns, starts, places, listed)
            fill_tiles(
                u, v, w, steps, size, first, last, triangles, starts, listed, depth, owner,
                visible[p], drawn[row], image_face, image_depth,
            )  # fmt: skip
    return end
