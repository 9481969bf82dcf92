"""Union of regions in the planes of the faces, and how many cameras cover each part; by numba.

A face of few pieces is one cell, see `division`. The pieces of a cell are a partition: convex
polygons that do not overlap, each with its number of cameras. A new piece P of a camera changes a
piece Q of n cameras into Q n P of n + 1 and the parts of Q outside P of n; what no Q covers of P is
new, of one camera. Numbers stop at k, from where on pieces are not divided any more. All cuts are
those of `exact_polygon.clip_subtract`, which keeps no topology, so that nothing can become
inconsistent.

`halve_pieces` divides pieces by lines, for `division`.
"""

from collections import namedtuple

import numpy as np
from numpy.typing import NDArray

from rastercov.kernels.area_plane import lines_of, perimeter_of, without_needless
from rastercov.kernels.exact_polygon import (
    clip,
    clip_subtract,
    copy_part,
    copy_polygon,
    corners_of_part,
    extent_of,
    split,
    twice_area,
)
from rastercov.kernels.exact_records import (
    LINE_ERROR,
    PIECE_ROOM,
    U_MAX,
    U_MIN,
    V_MAX,
    V_MIN,
    Pieces,
    U,
    V,
)
from rastercov.kernels.jit import allocation_free, compiled, part_with_arrays

DONE, POOL_TOO_SMALL, PARTITION_TOO_SMALL = range(3)
"""Results of `unite_cells`."""
WHOLE_REL = 1e-9
"""Part of the area of a face that may be missing from what counts as all of it."""
SLACK_REL = 0.1
"""Distance from a line up to which a corner is on it, relative to that of coincident corners."""

FloatArray = NDArray[np.float64]


Partition = namedtuple("Partition", "xy starts cell views used")
"""Pieces ordered by cell, and their numbers of cameras; `used` has the pieces and corners."""


Pool = namedtuple("Pool", "pieces box views rest corners spare given values lines near")
"""Scratch memory: the pieces of one cell with their boxes and numbers, and rests of others.

`near` is the result of `find_near`.
"""


def room_for_partition(n: int, corners: int) -> Partition:
    """Memory for a partition of n pieces."""
    return Partition(
        np.empty((corners, 2)),
        np.zeros(n + 1, np.int64),
        np.empty(n, np.int64),
        np.empty(n, np.int32),
        np.zeros(2, np.int64),
    )


def more_room(partition: Partition, more: int) -> Partition:
    """The partition with room for half as much again, and some pieces more."""
    n, corners = partition.used.tolist()
    room = room_for_partition(n * 3 // 2 + more, corners * 3 // 2 + PIECE_ROOM * more)
    room.xy[:corners], room.starts[: n + 1] = partition.xy[:corners], partition.starts[: n + 1]
    room.cell[:n], room.views[:n] = partition.cell[:n], partition.views[:n]
    room.used[:] = partition.used
    return room


def pool_of(n: int) -> Pool:
    """Scratch memory for cells of up to n pieces."""
    corners, spare, given = np.empty((3, PIECE_ROOM, 2))
    return Pool(
        pieces=Pieces(np.empty((n, PIECE_ROOM, 2)), np.empty(n, np.int64)),
        box=np.empty((n, 4)),
        views=np.empty(n, np.int32),
        rest=Pieces(np.empty((n, PIECE_ROOM, 2)), np.empty(n, np.int64)),
        corners=corners,
        spare=spare,
        given=given,
        values=np.empty(PIECE_ROOM),
        lines=np.empty((PIECE_ROOM, LINE_ERROR + 1)),
        near=np.empty(n, np.int64),
    )


@part_with_arrays
def set_piece(at, n, views, pool):
    """Store the number of corners, the views and the box of a piece whose corners are stored."""
    pool.pieces.n_corners[at], pool.views[at] = n, views
    u_min, u_max, v_min, v_max = extent_of(pool.pieces.corners[at], n)
    pool.box[at, U_MIN], pool.box[at, U_MAX] = u_min, u_max
    pool.box[at, V_MIN], pool.box[at, V_MAX] = v_min, v_max


@allocation_free
def put_piece(polygon, n, views, at, count, nearest, pool):
    """Store a piece at index `at`, or, in parts of at most `MOST_CORNERS` corners, from `count` on.

    Returns the number of pieces, -1 where there is no room, and the area that is left out because
    it is a sliver. The first part is stored at `at`, which may be `count`.
    """
    pieces, tidy = pool.pieces, pool.spare
    before = max(twice_area(polygon, n) / 2, 0.0) if n >= 3 else 0.0
    kept = without_needless(polygon, n, nearest, tidy)
    area = twice_area(tidy, kept) / 2 if kept >= 3 else 0.0
    if kept < 3 or not area > nearest * perimeter_of(tidy, kept):
        if at < count:
            pieces.n_corners[at] = 0
        return count, before
    first = 1
    while first + 1 < kept:
        if first > 1 or at == count:
            at = count
            count += 1
        if count > pool.views.shape[0]:
            return np.int64(-1), 0.0
        m = corners_of_part(first, kept)
        copy_part(tidy, first, m, pieces.corners[at])
        set_piece(at, m, views, pool)
        first += m - 2
    return count, abs(area - before)


@part_with_arrays
def find_near(wanted, count, pool):
    """Fill `near` with the pieces, of `count`, that reach into a box; their number.

    `wanted` is (least u, greatest u, least v, greatest v); pieces without corners are left out.
    """
    box, n_corners, n = pool.box, pool.pieces.n_corners, 0
    for q in range(count):
        if (
            n_corners[q] > 0
            and box[q, U_MIN] < wanted[U_MAX]
            and box[q, U_MAX] > wanted[U_MIN]
            and box[q, V_MIN] < wanted[V_MAX]
            and box[q, V_MAX] > wanted[V_MIN]
        ):
            pool.near[n] = q
            n += 1
    return n


@allocation_free
def rest_of(polygon, n, n_near, nearest, pool):
    """Fill `pool.rest` with what the pieces near a polygon, of `find_near`, do not cover of it.

    Returns the number of parts, -1 for no room.
    """
    pieces, rest, lines, near = pool.pieces, pool.rest, pool.lines, pool.near
    copy_polygon(polygon, n, rest.corners[0])
    rest.n_corners[0], n_rest = n, np.int64(1)
    for index in range(n_near):
        q = near[index]
        m = pieces.n_corners[q]
        lines_of(pieces.corners[q], m, lines)
        n_rest = clip_subtract(
            rest, n_rest, lines, m, m, SLACK_REL * nearest, pool.spare, pool.values
        )
        if n_rest <= 0:
            break
    return n_rest


@allocation_free
def add_piece(polygon, n, k, count, nearest, pool):
    """Add a piece of one camera to the partition of a cell; its new number of pieces, and slivers.

    The number is -1 where there is too little room.
    """
    pieces, rest, lines, near = pool.pieces, pool.rest, pool.lines, pool.near
    slack, slivers = SLACK_REL * nearest, 0.0
    n_near = find_near(extent_of(polygon, n), count, pool)
    n_rest = rest_of(polygon, n, n_near, nearest, pool)
    if n_rest < 0:
        return np.int64(-1), 0.0
    for r in range(n_rest):
        count, sliver = put_piece(
            rest.corners[r], rest.n_corners[r], 1, count, count, nearest, pool
        )
        slivers += sliver
        if count < 0:
            return count, 0.0
    if k == 1:
        return count, slivers
    # The pieces that it covers.
    lines_of(polygon, n, lines)
    for index in range(n_near):
        q = near[index]
        m, views = pieces.n_corners[q], pool.views[q]
        if views == k:
            continue
        copy_polygon(pieces.corners[q], m, rest.corners[0])
        rest.n_corners[0] = m
        n_rest = clip_subtract(rest, np.int64(1), lines, n, n, slack, pool.spare, pool.values)
        if n_rest < 0:
            return np.int64(-1), 0.0
        outside = 0.0
        for r in range(n_rest):
            outside += max(twice_area(rest.corners[r], rest.n_corners[r]) / 2, 0.0)
        area = twice_area(pieces.corners[q], m) / 2
        if area - outside <= nearest * perimeter_of(pieces.corners[q], m):
            continue
        if n_rest == 0:
            pool.views[q] = views + 1
            continue
        copy_polygon(pieces.corners[q], m, pool.corners)
        m = clip(pool.corners, m, lines, n, pool.spare)
        count, sliver = put_piece(pool.corners, m, views + 1, q, count, nearest, pool)
        slivers += sliver
        for r in range(n_rest):
            if count >= 0:
                count, sliver = put_piece(
                    rest.corners[r], rest.n_corners[r], views, count, count, nearest, pool
                )
                slivers += sliver
        if count < 0:
            return count, 0.0
    return count, slivers


@part_with_arrays
def covered_area(pool, count, views):
    """Area of the pieces of at least `views` cameras."""
    total = 0.0
    for q in range(count):
        if pool.pieces.n_corners[q] > 0 and pool.views[q] >= views:
            total += twice_area(pool.pieces.corners[q], pool.pieces.n_corners[q]) / 2
    return total


@part_with_arrays
def store_partition(cell, pool, count, out):
    """Append the pieces of a cell to a partition; False, and nothing, where there is no room."""
    n_corners = pool.pieces.n_corners[:count].sum()
    if out.used[0] + count > out.cell.shape[0] or out.used[1] + n_corners > out.xy.shape[0]:
        return False
    for q in range(count):
        n = pool.pieces.n_corners[q]
        if n > 0:
            piece, at = out.used[0], out.used[1]
            copy_polygon(pool.pieces.corners[q], n, out.xy[at:])
            out.cell[piece], out.views[piece] = cell, pool.views[q]
            out.starts[piece + 1] = at + n
            out.used[0], out.used[1] = piece + 1, at + n
    return True


@part_with_arrays
def load_partition(old, first, last, pool):
    """Take the pieces first ... last - 1 of a partition into the pool."""
    for piece in range(first, last):
        q, n = piece - first, old.starts[piece + 1] - old.starts[piece]
        copy_polygon(old.xy[old.starts[piece] :], n, pool.pieces.corners[q])
        set_piece(q, n, old.views[piece], pool)


@allocation_free
def unite_cells(cells, nearest, k, old, new, order, whole, pool, is_closed, bound, out, span):
    """Add new pieces to a partition, cell by cell.

    Parameters
    ----------
    cells : tuple
        Corners, starts and areas of the cells.
    nearest : (C,) float64
        Least distance of two corners that do not coincide, metres.
    k : int
        Cameras up to which they are counted.
    old : Partition
        The pieces so far.
    new : tuple
        Corners, starts and cells of new pieces.
    order : (N,) int64
        The pieces to be added, by cell, large ones first.
    whole : (C,) int64
        Cameras that cover all of each cell, besides.
    pool : Pool
        Scratch.
    is_closed : (C,) bool
        Changed: cells that k cameras cover; nothing is added to them any more.
    bound : (C,) float64
        Added to: area that is left out because it is a sliver.
    out : Partition
        Added to.
    span : (4,) int64
        In and out: the first cell, and its first pieces in `old` and `order`; the cell to end at.

    Returns
    -------
    int
        `DONE`, or what there is too little of: call again with more, to continue.
    """
    polygons, polygon_starts, areas = cells
    xy, starts, cell = new
    room = pool.views.shape[0]
    pieces, given = pool.pieces, pool.given
    for f in range(span[0], span[3]):
        span[0], at_old, at_new = f, span[1], span[2]
        first = at_old
        while at_old < old.used[0] and old.cell[at_old] == f:
            at_old += 1
        first_new = at_new
        while at_new < order.shape[0] and cell[order[at_new]] == f:
            at_new += 1
        count, corners = at_old - first, polygons[polygon_starts[f] : polygon_starts[f + 1]]
        sides = corners.shape[0]
        if count + 4 > room:
            return POOL_TOO_SMALL
        load_partition(old, first, at_old, pool)
        slivers, closed = 0.0, False
        wanted, close = (1 - WHOLE_REL) * areas[f], nearest[f]
        if not is_closed[f]:
            if whole[f] > 0:
                for q in range(count):
                    pool.views[q] = min(pool.views[q] + whole[f], k)
                copy_polygon(corners, sides, given)
                n_near = find_near(extent_of(given, sides), count, pool)
                n_rest = rest_of(given, sides, n_near, close, pool)
                if n_rest < 0:
                    return POOL_TOO_SMALL
                for r in range(n_rest):
                    views = min(whole[f], k)
                    count, sliver = put_piece(
                        pool.rest.corners[r], pool.rest.n_corners[r], views, count, count, close,
                        pool,
                    )  # fmt: skip
                    slivers += sliver
                    if count < 0:
                        return POOL_TOO_SMALL
            # No more than a piece's own area is won by it, so that the sum need not be made each
            # time.
            most = covered_area(pool, count, k)
            closed = most >= wanted
            for index in range(first_new, at_new):
                if closed:
                    break
                piece = order[index]
                n = starts[piece + 1] - starts[piece]
                copy_polygon(xy[starts[piece] :], n, given)
                count, sliver = add_piece(given, n, k, count, close, pool)
                # A corner near a line counts as on it, on either side.
                slivers += sliver + 4 * SLACK_REL * close * perimeter_of(given, n)
                if count < 0:
                    return POOL_TOO_SMALL
                most += twice_area(given, n) / 2
                if most >= wanted:
                    most = covered_area(pool, count, k)
                    closed = most >= wanted
        if closed:
            slivers += max(areas[f] - covered_area(pool, count, k), 0.0)
            copy_polygon(corners, sides, pieces.corners[0])
            pieces.n_corners[0], pool.views[0], count = sides, k, np.int64(1)
        if not store_partition(f, pool, count, out):
            return PARTITION_TOO_SMALL
        is_closed[f] = is_closed[f] or closed
        bound[f] += slivers
        span[0], span[1], span[2] = f + 1, at_old, at_new
    return DONE


Halves = namedtuple("Halves", "xy starts row side used")
"""Parts of pieces on the two sides of lines: corners, starts, row of the piece, and side.

`used` has the parts and their corners.
"""


def room_for_halves(n: int, corners: int) -> Halves:
    """Memory for the parts of n pieces: a line adds 4 corners, and a part of too many 2."""
    row, side = np.empty((2, 4 * n), np.int64)
    return Halves(
        np.empty((corners + 8 * n, 2)), np.zeros(4 * n + 1, np.int64), row, side,
        np.zeros(2, np.int64),
    )  # fmt: skip


@part_with_arrays
def append_half(polygon, n, row, side, nearest, spare, out):
    """Append a part of a piece without needless corners; its area, 0 for a sliver, left out."""
    kept = without_needless(polygon, n, nearest, spare) if n >= 3 else 0
    area = twice_area(spare, kept) / 2 if kept >= 3 else 0.0
    if not area > nearest * perimeter_of(spare, kept):
        return 0.0
    first = 1
    while first + 1 < kept:
        m = corners_of_part(first, kept)
        copy_part(spare, first, m, out.xy[out.used[1] :])
        count_half(m, row, side, out)
        first += m - 2
    return area


@part_with_arrays
def count_half(n, row, side, out):
    """Count a part of n corners, which are stored."""
    part, end = out.used[0], out.used[1] + n
    out.row[part], out.side[part], out.starts[part + 1] = row, side, end
    out.used[0], out.used[1] = part + 1, end


@compiled
def halve_pieces(xy, starts, lines, nearest, change, out):
    """Divide pieces, each by a line of its own.

    Parameters
    ----------
    xy, starts : (C, 2) float64, (N + 1,) int64
        The pieces.
    lines : (N, 3) float64
        a, b, c: side 1 is where a x + b y > c.
    nearest : (N,) float64
        Least distance of two corners that do not coincide, metres.
    change : (N,) float64
        Out: bound of what that does to the area of a piece and its overlap with others.
    out : Halves
    """
    values, polygon, spare = (
        np.empty(PIECE_ROOM),
        np.empty((PIECE_ROOM, 2)),
        np.empty((PIECE_ROOM, 2)),
    )
    inside, outside = np.empty((PIECE_ROOM, 2)), np.empty((PIECE_ROOM, 2))
    out.used[:] = 0
    for row in range(starts.shape[0] - 1):
        n, close = starts[row + 1] - starts[row], nearest[row]
        slack = SLACK_REL * close
        a, b, c = lines[row, 0], lines[row, 1], lines[row, 2]
        least = most = 0.0
        for p in range(n):
            polygon[p, U], polygon[p, V] = xy[starts[row] + p, U], xy[starts[row] + p, V]
            value = a * polygon[p, U] + b * polygon[p, V] - c
            values[p] = value if abs(value) > slack else 0.0
            least, most = min(least, values[p]), max(most, values[p])
        change[row] = 0.0
        if least < 0 < most:
            before = twice_area(polygon, n) / 2
            kept, lost = split(polygon, n, values, inside, outside)
            after = append_half(outside, lost, row, 0, close, spare, out)
            after += append_half(inside, kept, row, 1, close, spare, out)
            change[row] = abs(before - after) + 4 * slack * perimeter_of(polygon, n)
            continue
        copy_polygon(polygon, n, out.xy[out.used[1] :])
        count_half(n, row, 1 if most > 0 else 0, out)
