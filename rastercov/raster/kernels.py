"""The loops of the CPU rasteriser, compiled by numba.

They stand in one file because numba keeps what it compiled by file: a loop that calls into another
file would not notice a change there.

A pose runs through four passes. `project` brings vertices to the image, in steps of 1/256 of a
sample. `set_up` keeps the triangles that can own a sample, clips those that reach behind the camera
or far outside the image, and counts the tiles each one touches. `bin_triangles` lists them by tile,
in the order of their faces. `fill_tiles` takes one tile at a time, small enough for the cache, and
fills each triangle row by row between its left and its right edge.

Edges are walked in whole numbers (Bresenham), from their upper end to their lower, so two triangles
that share an edge find the same first sample on each row, and every sample belongs to exactly one
of them: a sample on a left or upper edge is inside, on a right or lower one outside.

No image is kept. A sample counts for its face when it is written and is taken from the face that
held it before, so what remains at the end of a tile are the visible samples.

J. Pineda. A Parallel Algorithm for Polygon Rasterization. 1988, for tiles and edge functions.
J. E. Bresenham. Algorithm for Computer Control of a Digital Plotter. 1965, for the edges.
"""

import numba
import numpy as np

from rastercov.compiled import compiled

TILE_BITS_X, TILE_BITS_Y = 7, 6
TILE_WIDTH, TILE_HEIGHT = 1 << TILE_BITS_X, 1 << TILE_BITS_Y
"""Samples of a tile: 32 KiB of depth and 32 KiB of faces."""
BITS = 8
STEPS = 1 << BITS
HALF = STEPS // 2
"""Sub-sample steps, as many as graphics devices have. Shifts divide: `//` would test for zero."""
FAR_OUT = 1 << 29
"""Steps from the origin beyond which a vertex is clipped: edges then fit 64 bits with room."""
CLIP_CORNERS = 8
"""A triangle cut by five planes has at most this many corners."""


@compiled
def project(vertices, rotation, eye, lens, near, u, v, w):
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
    """
    outside = 0
    for i in range(vertices.shape[0]):
        a = vertices[i, 0] - eye[0]
        b = vertices[i, 1] - eye[1]
        c = vertices[i, 2] - eye[2]
        z = a * rotation[0, 2] + b * rotation[1, 2] + c * rotation[2, 2]
        u[i] = np.inf
        if z >= near:
            w[i] = 1.0 / z
            right = a * rotation[0, 0] + b * rotation[1, 0] + c * rotation[2, 0]
            down = a * rotation[0, 1] + b * rotation[1, 1] + c * rotation[2, 1]
            across = (lens[0] * right * w[i] + lens[2]) * STEPS
            along = (lens[1] * down * w[i] + lens[3]) * STEPS
            if abs(across) <= FAR_OUT and abs(along) <= FAR_OUT:
                u[i] = across
                v[i] = along
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


@compiled
def step(position):
    """Nearest whole step: where a vertex stands when samples are given out."""
    return np.int64(np.floor(position + 0.5))


@numba.njit(
    nogil=True, error_model="numpy", inline="always"
)  # a call would pass every field of every array
def keep(a, b, c, face, u, v, width, height, side, triangles, n, tiles, starts):
    """Note a triangle if it can own a sample; returns the new number of triangles."""
    ax, ay, bx, by, cx, cy = step(u[a]), step(v[a]), step(u[b]), step(v[b]), step(u[c]), step(v[c])
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
    tiles[n, 0] = left >> TILE_BITS_X
    tiles[n, 1] = top >> TILE_BITS_Y
    tiles[n, 2] = right >> TILE_BITS_X
    tiles[n, 3] = bottom >> TILE_BITS_Y
    columns = (width + TILE_WIDTH - 1) // TILE_WIDTH
    for row in range(tiles[n, 1], tiles[n, 3] + 1):
        for column in range(tiles[n, 0], tiles[n, 2] + 1):
            starts[row * columns + column + 1] += 1
    return n + 1


@compiled
def set_up(
    vertices, faces, rotation, eye, lens, near, size, side, u, v, w, triangles, tiles, starts
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
    u, v, w
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
        if u[a] <= FAR_OUT and u[b] <= FAR_OUT and u[c] <= FAR_OUT:
            n = keep(a, b, c, f, u, v, width, height, side, triangles, n, tiles, starts)
            continue
        for i in range(3):
            p = faces[f, i]
            d0 = vertices[p, 0] - eye[0]
            d1 = vertices[p, 1] - eye[1]
            d2 = vertices[p, 2] - eye[2]
            for k in range(3):
                polygon[i, k] = d0 * rotation[0, k] + d1 * rotation[1, k] + d2 * rotation[2, k]
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
        for i in range(1, corners - 1):
            n = keep(
                extra, extra + i, extra + i + 1, f, u, v, width, height, side,
                triangles, n, tiles, starts,
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
def count_drawn(n, u, v, size, first, last, triangles, drawn):
    """Add the samples of each triangle, hidden or not, to the count of its face.

    Parameters
    ----------
    n, u, v, size, triangles
        From the passes before.
    first, last : (height,) int32
        Samples of each row that count: from the first up to the last.
    drawn : (F,) int64
        Out: samples to add to.
    """
    for k in range(n):
        a, b, c = triangles[k, 0], triangles[k, 1], triangles[k, 2]
        ax, ay, bx, by, cx, cy = from_top(
            step(u[a]), step(v[a]), step(u[b]), step(v[b]), step(u[c]), step(v[c])
        )
        row = max((ay + HALF - 1) >> BITS, 0)
        middle = min((by + HALF - 1) >> BITS, size[1])
        bottom = min((cy + HALF - 1) >> BITS, size[1])
        long_is_left = (bx - ax) * (cy - ay) > (cx - ax) * (by - ay)
        long, long_rest, long_step, long_step_rest, long_divisor = edge(ax, ay, cx, cy, row)
        covered = 0
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
    u, v, w, size, first, last, triangles, starts, listed, depth, depth_bits, owner, visible, drawn,
    image_face, image_depth,
):  # fmt: skip
    """Fill all tiles; count visible and drawn samples of each face, and keep the image if asked.

    Parameters
    ----------
    u, v, w, size, triangles, starts, listed
        From the passes before.
    first, last : (height,) int32
        Samples of each row to fill, from the first up to the last: those that count.
    depth : (tile samples,) float32
        Scratch: 1/z, 0 where nothing is.
    depth_bits : (tile samples,) int32
        The same memory, so that "nothing here yet" is an integer test.
    owner : (tile samples,) int32
        Scratch: face at each sample.
    visible, drawn : (F,) int64
        Out: samples to add to.
    image_face : (H, W) int32, image_depth : (H, W) float32
        Out: face and depth, or of size 0.
    """
    width, height = size[0], size[1]
    columns = (width + TILE_WIDTH - 1) // TILE_WIDTH
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
            ax, ay, bx, by = step(u[a]), step(v[a]), step(u[b]), step(v[b])
            cx, cy = step(u[c]), step(v[c])
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
            ax, ay, bx, by, cx, cy = from_top(ax, ay, bx, by, cx, cy)
            long_is_left = (bx - ax) * (cy - ay) > (cx - ax) * (by - ay)
            row = max((ay + HALF - 1) >> BITS, tile_y)
            middle = min((by + HALF - 1) >> BITS, end_y)
            bottom = min((cy + HALF - 1) >> BITS, end_y)
            if row >= bottom:
                continue
            far, far_rest, far_step, far_step_rest, far_divisor = edge(ax, ay, cx, cy, row)
            gained = 0
            covered = 0
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
                    if begin < end:
                        at = np.uint64((row - tile_y) * TILE_WIDTH + begin - tile_x)
                        n = np.uint64(end - begin)
                        start = origin + slope_x * begin + slope_y * row
                        taken = np.int32(0)
                        for i in range(n):
                            taken |= depth_bits[at + i]
                        if taken == 0:
                            for i in range(n):
                                here = np.float32(start + slope_x * np.float64(np.int32(i)))
                                depth[at + i] = min(max(here, least), greatest)
                                owner[at + i] = face
                            gained += end - begin
                        else:
                            for i in range(n):
                                here = np.float32(start + slope_x * np.float64(np.int32(i)))
                                here = min(max(here, least), greatest)
                                if here > depth[at + i]:
                                    if depth_bits[at + i] != 0:
                                        visible[owner[at + i]] -= 1
                                    depth[at + i] = here
                                    owner[at + i] = face
                                    gained += 1
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
    poses, nears, culls, begin, end, vertices, faces, lens, size, first, last, u, v, w, triangles,
    tiles, starts, places, listed, depth, depth_bits, owner, room, visible, drawn, with_drawn,
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
        outside = project(vertices, rotation, eye, lens, nears[p], u, v, w)
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
                vertices, faces, rotation, eye, lens, nears[p], size, side, u, v, w, triangles,
                tiles, starts,
            )  # fmt: skip
            if starts[-1] > listed.shape[0]:
                return p
            if side == 1:
                count_drawn(n, u, v, size, first, last, triangles, drawn[row])
                continue
            places[:] = starts
            bin_triangles(n, tiles, columns, starts, places, listed)
            fill_tiles(
                u, v, w, size, first, last, triangles, starts, listed, depth, depth_bits, owner,
                visible[p], drawn[row], image_face, image_depth,
            )  # fmt: skip
    return end
