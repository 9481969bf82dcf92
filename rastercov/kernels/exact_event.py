"""Event edges and the faces that they cross, compiled by numba.

Seen from the camera, the set of surfaces in front of a point changes only across event edges:
silhouette edges, borders, edges of more than two faces, and the rims where the near plane clips.
`find_event_edges` finds them. Where a surface hides such an edge from the camera, it hides all that
is behind on both of its sides, so only the visible parts matter: `mark_crossed` finds them, by the
cells of the grid that an edge runs through, and the faces that they cross in the image, at or
before the face.

A part of a segment is a range: 0 at its start, 1 at its end. A face that another one in contact
passes through is visible on one side of their intersection at most. In the image that is a line,
along which 1/z of the two is equal.

A. Appel. The Notion of Quantitative Invisibility and the Machine Rendering of Solids. 1967.
"""

import numpy as np

from rastercov.kernels.exact_grid import (
    ENTRIES_AT_A_TIME,
    ask_for_cells,
    cell,
    cells_of_rectangle,
    find_faces,
    lay_bounds,
)
from rastercov.kernels.exact_half_plane import common_extent, depth_order
from rastercov.kernels.exact_polygon import (
    clip,
    copy_polygon,
    ends_of_side,
    is_joined,
    length,
    line_value,
    n_sides_of,
    outline,
    outline_error,
    plane_of,
    separates,
    side_of,
    twice_area,
)
from rastercov.kernels.exact_records import (
    BLOCK,
    CLIPPED,
    CONSISTENT,
    CORNERS,
    CROSSED,
    DEPTH_TIE_REL,
    DOUBTFUL,
    DU,
    DV,
    EDGE_ERROR,
    FIRST,
    IN_FRONT,
    IN_FRONT_IN_PART,
    LAST,
    LIVE,
    MIXED,
    NON_MANIFOLD,
    OFFSET,
    POSITION_ERROR,
    SLOPE_U,
    SLOPE_V,
    THIN,
    TIED,
    U_MAX,
    U_MIN,
    UNFIT,
    V_MAX,
    V_MIN,
    W_ERROR,
    W_MAX,
    W_MIN,
    U,
    V,
    W,
)
from rastercov.kernels.jit import allocation_free, part_with_arrays

START, END = 0, 1
"""Rows of a segment, which has u, v and w of both ends."""
IS_VISIBLE = 2
"""Row of `Segment.ends`: 1 for a segment that is not wholly hidden."""
NO_VERTEX = NO_EDGE = -1
"""End of a segment that is no vertex of the surface; no such edge."""
MOST_INTERSECTIONS = 24
"""Faces that pass through a face beyond which it is left to half planes."""
MOST_ERROR = 1e-6
"""Error of the image of an intersection, pixels, beyond which the face is left to them, too."""
SURE = 16
"""Distance from an edge, in roundings of a position, that makes a point lie on one side of it."""
THINNEST = 2**24
"""Width of a face, in the same, below which rounding may decide what is beside it."""
NOT_KNOWN = -1
"""Result of `add_intersection` where the visibility may change elsewhere, or rounding decides."""


@part_with_arrays
def narrowed(start, end, low, high, first, last):
    """Part of the range first ... last where a coordinate is in low ... high.

    The coordinate runs from `start` at 0 to `end` at 1. The range is empty, with the first above
    the last, if it is nowhere.
    """
    step = end - start
    if step == 0:
        return (first, last) if low <= start <= high else (1.0, 0.0)
    enters, leaves = (low - start) / step, (high - start) / step
    return max(first, min(enters, leaves)), min(last, max(enters, leaves))


@part_with_arrays
def narrowed_to_inside(start, end, first, last):
    """Part of the range first ... last where a value that runs from `start` to `end` is >= 0."""
    if start < 0 and end < 0:
        return 1.0, 0.0
    if start < 0:
        first = max(first, start / (start - end))
    elif end < 0:
        last = min(last, start / (start - end))
    return first, last


@part_with_arrays
def straddles(f, segment, tolerance, projected):
    """True if the line of a segment passes a face within the tolerance, pixels, or f is clipped."""
    faces, uvw = projected.faces, projected.uvw
    u0, v0 = segment[START, U], segment[START, V]
    du, dv = segment[END, U] - u0, segment[END, V] - v0
    reach = tolerance * (abs(du) + abs(dv))
    line = (u0, v0, du, dv, 0.0)
    i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
    si = line_value(line, uvw[i, U], uvw[i, V])
    sj = line_value(line, uvw[j, U], uvw[j, V])
    sk = line_value(line, uvw[k, U], uvw[k, V])
    is_beside = (min(si, sj, sk) > reach) | (max(si, sj, sk) < -reach)
    return not is_beside or projected.state[f] & CLIPPED != 0


@part_with_arrays
def crosses(f, a, b, segment, first, last, tolerance, projected):
    """Part of first ... last where a segment crosses a face at or before its depth, or (1, 0).

    The face f is not clipped in space, lies on the line of the segment, see `straddles`, and is
    grown by the tolerance, pixels. `segment` has u, v, w of both ends, a and b their vertices, or
    `NO_VERTEX`.
    """
    starts_within, ends_within = first > 0, last < 1
    faces, uvw = projected.faces, projected.uvw
    u0, v0, w0 = segment[START, U], segment[START, V], segment[START, W]
    u1, v1, w1 = segment[END, U], segment[END, V], segment[END, W]
    second, third = (1, 2) if projected.side[f] < 0 else (2, 1)
    i, j, k = faces[f, 0], faces[f, second], faces[f, third]
    du, dv = u1 - u0, v1 - v0
    ui, vi = uvw[i, U], uvw[i, V]
    uj, vj = uvw[j, U], uvw[j, V]
    uk, vk = uvw[k, U], uvw[k, V]
    has_a = a >= 0 and a in (i, j, k)
    has_b = b >= 0 and b in (i, j, k)
    if has_a and has_b:  # its own edge
        return 1.0, 0.0
    # The part of the segment within the face grown by the tolerance. For a segment that starts at a
    # corner of the face the two sides there are not tested by distance: it is within if its far end
    # is within their wedge.
    corner = a if has_a else b if has_b else np.int64(NO_VERTEX)
    for s in range(3):
        p, q = ends_of_side(f, s, projected)
        up, vp = uvw[p, U], uvw[p, V]
        along_u, along_v = uvw[q, U] - up, uvw[q, V] - vp
        line = (up, vp, along_u, along_v, tolerance * (abs(along_u) + abs(along_v)))
        start, end = line_value(line, u0, v0), line_value(line, u1, v1)
        if corner in (p, q):
            if (end if has_a else start) < 0:
                return 1.0, 0.0
            continue
        first, last = narrowed_to_inside(start, end, first, last)
        if first > last:
            return 1.0, 0.0
    # w is affine on both, so its difference is greatest at an end.
    w = uvw[i, W]
    wa, wb = uvw[j, W] - w, uvw[k, W] - w
    ua, va, ub, vb = uj - ui, vj - vi, uk - ui, vk - vi
    twice = ua * vb - ub * va
    slope_u, slope_v = (wa * vb - wb * va) / twice, (ua * wb - ub * wa) / twice
    tie = DEPTH_TIE_REL * projected.box[f, W_MAX]
    if starts_within or not has_a:
        its = w0 + first * (w1 - w0)
        mine = w + slope_u * (u0 + first * du - ui) + slope_v * (v0 + first * dv - vi)
        if its >= mine - tie:
            return first, last
    if ends_within or not has_b:
        its = w0 + last * (w1 - w0)
        mine = w + slope_u * (u0 + last * du - ui) + slope_v * (v0 + last * dv - vi)
        if its >= mine - tie:
            return first, last
    return 1.0, 0.0


@part_with_arrays
def hidden_range(m, a, b, segment, first, last, tolerance, view):
    """Part of first ... last where face m certainly hides a segment; (1, 0) if none.

    The face is shrunk by the tolerance, pixels, along its event edges; along the others, where the
    surface continues, it is grown by the rounding of a position.
    """
    camera, projected = view.camera, view.projected
    i, j, k = projected.faces[m, 0], projected.faces[m, 1], projected.faces[m, 2]
    if a in (i, j, k) or b in (i, j, k):  # at the depth of the segment there
        return 1.0, 0.0
    u, v, w = segment[START, U], segment[START, V], segment[START, W]
    u1, v1, w1 = segment[END, U], segment[END, V], segment[END, W]
    n_lines = n_sides_of(m, projected)
    error = outline_error(m, camera, projected)
    for s in range(n_lines):
        line = side_of(m, s, projected)
        extent = abs(line[DU]) + abs(line[DV])
        start, end = line_value(line, u, v), line_value(line, u1, v1)
        least, most = -2 * error * extent, (2 * tolerance + error) * extent
        if start < least and end < least:
            return 1.0, 0.0
        if start >= most and end >= most:
            continue
        margin = least if is_joined(m, s, n_lines, view) else most
        first, last = narrowed_to_inside(start - margin, end - margin, first, last)
        if first > last:
            return 1.0, 0.0
    u_m, v_m, w_m, slope_u, slope_v, w_error = plane_of(m, camera, projected)
    margin = 2 * w_error + 4 * DEPTH_TIE_REL * projected.box[m, W_MAX]
    start = w_m + slope_u * (u - u_m) + slope_v * (v - v_m) - w - margin
    end = w_m + slope_u * (u1 - u_m) + slope_v * (v1 - v_m) - w1 - margin
    first, last = narrowed_to_inside(start, end, first, last)
    # The sides of a needle that is grown meet far beyond its tip.
    box = projected.box
    first, last = narrowed(u, u1, box[m, U_MIN] - 2 * error, box[m, U_MAX] + 2 * error, first, last)
    return narrowed(v, v1, box[m, V_MIN] - 2 * error, box[m, V_MAX] + 2 * error, first, last)


@part_with_arrays
def take_range(ranges, n, first, last):
    """Take first ... last out of n ranges; returns how many are left.

    Where there is no room for another range, the part stays in.
    """
    i = 0
    while i < n:
        start, end = ranges[i, 0], ranges[i, 1]
        if first <= start and last >= end:
            n -= 1
            ranges[i, 0], ranges[i, 1] = ranges[n, 0], ranges[n, 1]
            continue
        if last > start and first <= start:
            ranges[i, 0] = last
        elif first < end and last >= end:
            ranges[i, 1] = first
        elif first > start and last < end and n < ranges.shape[0]:
            ranges[n, 0], ranges[n, 1] = last, end
            ranges[i, 1] = first
            n += 1
        i += 1
    return n


@part_with_arrays
def overlap_of(t, m, n, n_own, view):
    """Area that the images of two live faces have in common, px^2, and the sides of that of m.

    It is negative if one of them is so thin that rounding may decide. See `add_intersection` for
    the arguments; the lines that bound the image of m are left in `work.lines`.
    """
    camera, projected, work = view.camera, view.projected, view.work
    box, lines, corners, other = projected.box, work.lines, work.corners, work.other
    k, n_sides = outline(m, projected, corners, lines)
    # Of a clipped needle rounding may leave a short piece.
    is_clipped = projected.state[m] & CLIPPED
    extent = camera.width + camera.height
    if not is_clipped:
        extent = box[m, U_MAX] - box[m, U_MIN] + box[m, V_MAX] - box[m, V_MIN]
    is_thin = twice_area(corners, k) < THINNEST * outline_error(m, camera, projected) * extent
    if is_clipped and is_thin:
        return -1.0, n_sides
    if (
        box[m, U_MIN] > box[t, U_MAX]
        or box[m, U_MAX] < box[t, U_MIN]
        or box[m, V_MIN] > box[t, V_MAX]
        or box[m, V_MAX] < box[t, V_MIN]
    ):
        return 0.0, n_sides
    if is_thin:
        return -1.0, n_sides
    if separates(lines, n_sides, work.target, n) or separates(work.own, n_own, corners, k):
        return 0.0, n_sides
    copy_polygon(work.target, n, work.spare)
    n = clip(work.spare, n, lines, n_sides, other)
    if n < 3:
        return 0.0, n_sides
    return abs(twice_area(work.spare, n)) / 2, n_sides


@part_with_arrays
def take_intersection(t, m, n_sides, count, view):
    """Add the line of equal depth that `depth_order` left in `work.lines`; returns their number.

    Its range is that within the image of face m, which `n_sides` of `work.lines` bound, and within
    three times the box of face t. It may be too large, but not too small: the line may run along a
    side of m, so that rounding decides where it meets that side, and on which side of it it is.
    """
    camera, projected = view.camera, view.projected
    lines, rows, box = view.work.lines, view.work.intersections, projected.box
    line = lines[n_sides]
    slope = length(line[DU], line[DV], 0.0)
    error = plane_of(t, camera, projected)[5] + plane_of(m, camera, projected)[5]
    if count == MOST_INTERSECTIONS or not error <= MOST_ERROR * slope:
        return np.int64(NOT_KNOWN)
    du, dv, offset = line[DU] / slope, line[DV] / slope, line[OFFSET] / slope
    u, v = line[U] + offset * dv, line[V] - offset * du
    reach = box[t, U_MAX] - box[t, U_MIN] + box[t, V_MAX] - box[t, V_MIN]
    first, last = narrowed(u, u + du, box[t, U_MIN] - reach, box[t, U_MAX] + reach, -np.inf, np.inf)
    first, last = narrowed(v, v + dv, box[t, V_MIN] - reach, box[t, V_MAX] + reach, first, last)
    error = max(error / slope, camera.pixel_error)
    slack = SURE * max(error, outline_error(m, camera, projected))
    for s in range(n_sides):
        along = lines[s, DU] * dv - lines[s, DV] * du
        at = lines[s, DU] * (v - lines[s, V]) - lines[s, DV] * (u - lines[s, U]) + lines[s, OFFSET]
        at += slack * (abs(lines[s, DU]) + abs(lines[s, DV]))
        if along > 0:
            first = max(first, -at / along)
        elif along < 0:
            last = min(last, -at / along)
    row = rows[count]
    row[U], row[V], row[DU], row[DV] = u, v, du, dv
    row[FIRST], row[LAST], row[EDGE_ERROR] = first, last, error
    return count + 1 if first < last else count


@part_with_arrays
def add_intersection(t, m, n, n_own, count, view):
    """Add the line along which a face in contact passes through a face; returns their number.

    It is `NOT_KNOWN` if the visibility of the face may change elsewhere: where the two coincide, or
    where the other, in front of it, continues behind it, beyond an edge that lies in it and is no
    event edge.

    Parameters
    ----------
    t, m : int
        The face, and the other.
    n, n_own : int
        Corners of face t in `work.target`, and lines that bound it in `work.own`.
    count : int
        Number of lines so far.
    view : View
        The line is added to `work.intersections`, and what rounding may decide along their contact
        to the bound of t.
    """
    camera, projected, edges, area_error = view.camera, view.projected, view.edges, view.area_error
    state = projected.state
    if not state[m] & LIVE:
        return np.int64(NOT_KNOWN) if state[m] & THIN else count
    for s in range(-1, 3):  # the other face itself; then, if it is in front, its neighbours
        other = np.int64(m)
        if s >= 0:
            e = edges.of_face[m, s]
            if view.is_event[e] or edges.faces[e, 1] < 0:
                continue
            other = np.int64(edges.faces[e, 0] if edges.faces[e, 0] != m else edges.faces[e, 1])
            if other == t or not state[other] & LIVE:
                continue
        overlap, n_sides = overlap_of(t, other, n, n_own, view)
        if overlap == 0 and s >= 0:
            continue
        if overlap == 0:
            return count
        if overlap < 0 or state[other] & DOUBTFUL:
            return np.int64(NOT_KNOWN)
        if s < 0:
            error = outline_error(m, camera, projected)
            around = common_extent(t, m, projected.box)
            if overlap <= SURE * error * around:  # neighbours that abut, up to rounding
                area_error[t] += max(overlap, 4 * error * around)
                return count
            area_error[t] += 4 * error * around
        order = depth_order(t, other, n, n_sides, view, s < 0)
        if order == IN_FRONT:
            continue
        if s >= 0 or order == TIED:
            return np.int64(NOT_KNOWN)
        if order == IN_FRONT_IN_PART:
            return take_intersection(t, m, n_sides, count, view)
        return count
    return count


MOST_CELLS_OF_EDGE = 256
"""Cells in the bounding box of an event edge beyond which all cells are asked for."""
MARGIN = 4
"""Width of the margin around an event edge in which cells are asked for, in tolerances: more than
`mark_segment` looks at."""
NEAR_PLANE_TOLERANCE_REL = 1e-6
"""Relative difference of 1/z up to which a corner counts as one on the near plane."""


@part_with_arrays
def is_of_one_side(m, blocks, block_side):
    """True if all faces of a block of edges are seen from one side, so that none is an event."""
    if not blocks.is_plain[m]:
        return False
    start, stop = blocks.starts[m], blocks.starts[m + 1]
    common = block_side[blocks.of_edges[start]]
    is_common = common != MIXED
    for k in range(start + 1, stop):
        is_common &= block_side[blocks.of_edges[k]] == common
    return is_common


@allocation_free
def find_event_edges(edges, projected, is_event, events):
    """Find the edges whose two sides in the image may have different numbers of faces.

    They include each edge of a face that is seen edge-on up to rounding, and of one that contains
    the camera centre: the visible side of it is unknown.

    Out: `is_event`, (E,) bool, and their indices in `events`, (E,) int32. Returns their number.
    """
    edge_faces, kind, side, state = edges.faces, edges.kind, projected.side, projected.state
    n, blocks = 0, projected.blocks
    is_event[:] = False
    for m in range(blocks.is_plain.shape[0]):
        if is_of_one_side(m, blocks, projected.block_side):
            continue
        for e in range(m * BLOCK, min((m + 1) * BLOCK, edge_faces.shape[0])):
            first, second = side[edge_faces[e, 0]], 0
            flags = state[edge_faces[e, 0]]
            if edge_faces[e, 1] >= 0:
                second = side[edge_faces[e, 1]]
                flags |= state[edge_faces[e, 1]]
            event = first != second if kind[e] == CONSISTENT else first != -second
            if kind[e] == NON_MANIFOLD or flags & DOUBTFUL:
                event = True
            if event:
                is_event[e] = True
                events[n] = e
                n += 1
    return n


@part_with_arrays
def record_crossing(f, edge, segment, first, last, crossings, n):
    """Add the crossing of a face and an edge to the list of the face; returns the number of all.

    The edge runs towards greater u, or v, whatever its vertices. Crossings beyond the room in
    `crossings` are counted, not added.
    """
    start, end = START, END
    du, dv = segment[END, U] - segment[START, U], segment[END, V] - segment[START, V]
    if du < 0 or (du == 0 and dv < 0):
        start, end, first, last = end, start, 1 - last, 1 - first
    previous = crossings.last[f]
    if previous >= 0 and crossings.edge[previous] == edge:
        row = crossings.segments[previous]
        row[FIRST], row[LAST] = min(row[FIRST], first), max(row[LAST], last)
        return n
    if n < crossings.edge.shape[0]:
        crossings.last[f], crossings.before[n], crossings.edge[n] = n, previous, edge
        row = crossings.segments[n]
        row[U], row[V] = segment[start, U], segment[start, V]
        row[DU], row[DV] = segment[end, U] - row[U], segment[end, V] - row[V]
        row[FIRST], row[LAST] = first, last
        row[EDGE_ERROR] = max(segment[START, POSITION_ERROR], segment[END, POSITION_ERROR])
    return n + 1


@part_with_arrays
def mark_in_cell(
    c, edge, is_doubtful, first, last, segment, tolerance, view, crossings, n_crossings
):
    """Mark the live faces of a cell that the visible parts of a segment there cross.

    first ... last is the part of the segment in cell c. See `mark_segment` for the others; returns
    the number of crossings.
    """
    projected, grid, ranges = view.projected, view.grid, view.work.ranges
    state, box, found = projected.state, projected.box, grid.found
    ends, segment = segment.ends, segment.uvw
    a, b = ends[START], ends[END]
    du, dv = segment[END, U] - segment[START, U], segment[END, V] - segment[START, V]
    ua, ub = segment[START, U] + first * du, segment[START, U] + last * du
    va, vb = segment[START, V] + first * dv, segment[START, V] + last * dv
    left, right = min(ua, ub) - tolerance, max(ua, ub) + tolerance
    top, bottom = min(va, vb) - tolerance, max(va, vb) + tolerance
    nearest = max(segment[START, W], segment[END, W])
    farthest = min(segment[START, W], segment[END, W])
    rectangle = (left, right, top, bottom)
    ranges[0, 0], ranges[0, 1], n, n_found = first, last, 1, np.int64(0)
    lay_bounds(c, box, grid)
    entry, stop, n_kept = grid.starts[c], grid.stops[c], np.int64(0)
    # Faces wholly in front of the edge come first: they can hide it, and it crosses none of them.
    in_front = nearest * (1 + 4 * DEPTH_TIE_REL)
    is_first, depths = True, (farthest, in_front, np.inf)
    # Edges beside each other are often hidden by one face.
    index, m = np.int64(-1), np.int64(grid.hider[c])
    while True:
        if index == n_found:
            if entry == stop:
                if not is_first:
                    break
                is_first, depths, entry = False, (-np.inf, -np.inf, in_front), grid.starts[c]
                n_kept = np.int64(0)
            following = min(entry + ENTRIES_AT_A_TIME, stop)
            n_found = find_faces(entry, following, rectangle, depths, grid, n_kept)
            entry, index = following, n_kept
            for k in range(index, n_found):
                # Without a branch: which of them straddle is not predictable.
                found[n_kept] = found[k]
                n_kept += straddles(found[k], segment, tolerance, projected)
            n_found = n_kept
            continue
        if index >= 0:
            m = np.int64(found[index])
        index += 1
        if m >= 0 and box[m, W_MAX] >= farthest and state[m] & (LIVE | DOUBTFUL) == LIVE:
            begin, end = hidden_range(m, a, b, segment, first, last, tolerance, view)
            if begin < end:
                n = take_range(ranges, n, begin, end)
                if n == 0:
                    grid.hider[c] = m
                    return n_crossings
    ends[IS_VISIBLE] = 1
    for index in range(n_kept):
        f = found[index]
        if state[f] & (LIVE | UNFIT) == LIVE and nearest >= box[f, W_MIN] * (1 - 2 * DEPTH_TIE_REL):
            for i in range(n):
                begin, end = crosses(
                    f, a, b, segment, ranges[i, 0], ranges[i, 1], tolerance, projected
                )
                if begin <= end:
                    state[f] |= CROSSED | UNFIT if is_doubtful else CROSSED
                    projected.block_state[f // BLOCK] |= CROSSED
                    n_crossings = record_crossing(
                        f, edge, segment, begin, end, crossings, n_crossings
                    )
    return n_crossings


@part_with_arrays
def mark_segment(edge, is_doubtful, segment, tolerance, view, extent, crossings, n_crossings):
    """Mark the live faces that the visible parts of a segment cross, by the cells it runs through.

    Parameters
    ----------
    edge : int
        A number for the segment.
    is_doubtful : bool
        The segment bounds a doubtful face, so that what it crosses is `UNFIT`.
    segment : Segment
    n_crossings : int
        Number of crossings so far.

    See `mark_crossed` for the others; returns the number of crossings.
    """
    uvw, grid = segment.uvw, view.grid
    u, v = uvw[START, U], uvw[START, V]
    du, dv = uvw[END, U] - u, uvw[END, V] - v
    t0, t1 = narrowed(u, u + du, extent[U_MIN] - tolerance, extent[U_MAX] + tolerance, 0.0, 1.0)
    t0, t1 = narrowed(v, v + dv, extent[V_MIN] - tolerance, extent[V_MAX] + tolerance, t0, t1)
    segment.ends[IS_VISIBLE] = 1 if t0 > 0 or t1 < 1 else 0
    if t0 > t1:
        return n_crossings
    ua, ub, va, vb = u + t0 * du, u + t1 * du, v + t0 * dv, v + t1 * dv
    low_u, high_u = min(ua, ub) - tolerance, max(ua, ub) + tolerance
    top = cell(min(va, vb) - tolerance, grid.top, grid.per_v, grid.rows)
    bottom = cell(max(va, vb) + tolerance, grid.top, grid.per_v, grid.rows)
    for row in range(top, bottom + 1):
        # Range of u while the segment is in this row, which is widened by the tolerance.
        left, right, t_row, t_next = low_u, high_u, t0, t1
        if top < bottom:
            upper = grid.top + row / grid.per_v - tolerance
            lower = grid.top + (row + 1) / grid.per_v + tolerance
            enters = min(max((upper - va) / (vb - va), 0.0), 1.0)
            leaves = min(max((lower - va) / (vb - va), 0.0), 1.0)
            at, to = ua + enters * (ub - ua), ua + leaves * (ub - ua)
            left, right = min(at, to) - 2 * tolerance, max(at, to) + 2 * tolerance
            t_row = t0 + min(enters, leaves) * (t1 - t0)
            t_next = t0 + max(enters, leaves) * (t1 - t0)
        first = cell(left, grid.left, grid.per_u, grid.columns)
        last = cell(right, grid.left, grid.per_u, grid.columns)
        for column in range(first, last + 1):
            # The outermost cells hold all that is beyond them.
            left = grid.left + column / grid.per_u - tolerance if column > first else -np.inf
            right = grid.left + (column + 1) / grid.per_u + tolerance if column < last else np.inf
            enters, leaves = narrowed(u, u + du, left, right, t_row, t_next)
            if enters <= leaves:
                n_crossings = mark_in_cell(
                    row * grid.columns + column, edge, is_doubtful, enters, leaves, segment,
                    tolerance, view, crossings, n_crossings,
                )  # fmt: skip
    return n_crossings


@allocation_free
def project_clipped(a, b, vertices, camera, segment):
    """Project edge a b, which reaches before the near plane or far out; False if nothing is left.

    Out: `segment`, with `NO_VERTEX` for an end that was clipped.
    """
    p, q, ends, uvw = segment.points[START], segment.points[END], segment.ends, segment.uvw
    for k in range(3):
        p[k] = q[k] = 0.0
        for i in range(3):
            p[k] += (vertices[a, i] - camera.centre[i]) * camera.rotation[i, k]
            q[k] += (vertices[b, i] - camera.centre[i]) * camera.rotation[i, k]
    fx, fy, cx, cy, near = camera.fx, camera.fy, camera.cx, camera.cy, camera.near
    first, last = narrowed_to_inside(p[2] - near, q[2] - near, 0.0, 1.0)
    for axis, focal, offset in (
        (0, fx, cx - camera.u_min),
        (0, -fx, camera.u_max - cx),
        (1, fy, cy - camera.v_min),
        (1, -fy, camera.v_max - cy),
    ):
        start, end = focal * p[axis] + offset * p[2], focal * q[axis] + offset * q[2]
        first, last = narrowed_to_inside(start, end, first, last)
    if first > last:
        return False
    reach = length(p[0], p[1], p[2]) + length(q[0], q[1], q[2])
    ends[START] = a if first == 0 else NO_VERTEX
    ends[END] = b if last == 1 else NO_VERTEX
    for end in range(2):
        t = first if end == START else last
        z = max(p[2] + t * (q[2] - p[2]), near)
        uvw[end, U] = fx * ((p[0] + t * (q[0] - p[0])) / z) + cx
        uvw[end, V] = fy * ((p[1] + t * (q[1] - p[1])) / z) + cy
        uvw[end, W] = 1.0 / z
        uvw[end, POSITION_ERROR] = camera.pixel_error * max(1.0, 2 * reach / z)
    return True


@part_with_arrays
def project_event(e, edges, vertices, camera, uvw, segment):
    """Fill `segment` with the image of an event edge; False if nothing of it is in front."""
    a, b, its = edges.vertices[e, 0], edges.vertices[e, 1], segment.uvw
    if not (uvw[a, W] > 0 and uvw[b, W] > 0):
        return project_clipped(a, b, vertices, camera, segment)
    segment.ends[START], segment.ends[END] = a, b
    for k in range(3):
        its[START, k], its[END, k] = uvw[a, k], uvw[b, k]
    its[START, POSITION_ERROR] = its[END, POSITION_ERROR] = camera.pixel_error
    return True


@allocation_free
def ask_for_events(events, edges, vertices, camera, projected, tolerance, grid, segment):
    """Ask for the cells around event edges; False, before the last, if one has too many.

    They are those of its bounding box with a margin.
    """
    uvw = segment.uvw
    for index in range(events.shape[0]):
        if project_event(events[index], edges, vertices, camera, projected.uvw, segment):
            margin = MARGIN * tolerance
            left = min(uvw[START, U], uvw[END, U]) - margin
            right = max(uvw[START, U], uvw[END, U]) + margin
            upper = min(uvw[START, V], uvw[END, V]) - margin
            lower = max(uvw[START, V], uvw[END, V]) + margin
            first, last, top, bottom = cells_of_rectangle(left, right, upper, lower, grid)
            if (last - first + 1) * (bottom - top + 1) > MOST_CELLS_OF_EDGE:
                return False
            ask_for_cells(first, last, top, bottom, grid)
    return True


@part_with_arrays
def take_rim(s, p, camera, clipped, segment):
    """Fill `segment` with side p of the image of a clipped face if the near plane cut it there."""
    if p >= clipped.n_corners[s]:
        return False
    polygons, planes, its = clipped.polygons, clipped.planes, segment.uvw
    q = p + 1 if p + 1 < clipped.n_corners[s] else 0
    for end in range(2):
        corner = p if end == START else q
        u, v = polygons[s, corner, U], polygons[s, corner, V]
        w = (
            planes[s, W]
            + planes[s, SLOPE_U] * (u - planes[s, U])
            + planes[s, SLOPE_V] * (v - planes[s, V])
        )
        # As near as it may be: 1/z of a face that almost contains the camera centre is known to few
        # digits.
        its[end, U], its[end, V] = u, v
        its[end, W] = min(w + planes[s, W_ERROR], 1 / camera.near)
        its[end, POSITION_ERROR], segment.ends[end] = camera.pixel_error, NO_VERTEX
    rim = (1 - NEAR_PLANE_TOLERANCE_REL) / camera.near
    return its[START, W] >= rim and its[END, W] >= rim


@allocation_free
def mark_crossed(
    events, vertices, view, extent, tolerance, n_clipped, segment, crossings, is_hidden
):
    """Mark the live faces crossed by a visible part of an event edge or of a rim at the near plane.

    Parameters
    ----------
    events : (N,) int32
        Event edges.
    vertices : (V, 3) float64
    view : View
        `CROSSED` is added to the states of faces and blocks, and `UNFIT` to those of faces where
        rounding decides what crosses.
    extent : (7,) float64
        Of `set_up`.
    tolerance : float
        Pixels within which an edge that passes a face counts as crossing it.
    n_clipped : int
        Of `set_up`: faces that are clipped in space.
    crossings : Crossings
        In: without a crossing. Out: all of them. `segment` is scratch.
    is_hidden : (E,) bool
        Out: event edges that faces in front hide from end to end.

    Returns
    -------
    int
        Number of crossings. If it is more than `crossings` has room for, call again with more.
    """
    camera, projected, edges = view.camera, view.projected, view.edges
    uvw, state, clipped = projected.uvw, projected.state, projected.clipped
    n_events, n_crossings = events.shape[0], 0
    for index in range(n_events + n_clipped * CORNERS):
        e, is_doubtful = np.int64(NO_EDGE), True
        if index < n_events:
            e = np.int64(events[index])
            is_hidden[e] = False
            if not project_event(e, edges, vertices, camera, uvw, segment):
                continue
            flags = state[edges.faces[e, 0]]
            if edges.faces[e, 1] >= 0:
                flags |= state[edges.faces[e, 1]]
            is_doubtful = flags & DOUBTFUL != 0
        else:
            s = (index - n_events) // CORNERS
            if not take_rim(s, (index - n_events) % CORNERS, camera, clipped, segment):
                continue
        n_crossings = mark_segment(
            e, is_doubtful, segment, tolerance, view, extent, crossings, n_crossings
        )
        if e >= 0 and not segment.ends[IS_VISIBLE]:
            a, b = edges.vertices[e, 0], edges.vertices[e, 1]
            is_hidden[e] = uvw[a, W] > 0 and uvw[b, W] > 0
    return n_crossings
