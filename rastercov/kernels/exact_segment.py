"""Segments of the image: parts that cross a face, or are hidden, or where two faces meet; by numba.

A part is a range: 0 at the start of the segment, 1 at its end. A face that another one in contact
passes through is visible on one side of their intersection at most. In the image that is a line,
along which 1/z of the two is equal.
"""

import numpy as np

from rastercov.kernels.exact_half_plane import depth_order
from rastercov.kernels.exact_polygon import (
    clip,
    copy_polygon,
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
    CLIPPED,
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
    OFFSET,
    THIN,
    TIED,
    U_MAX,
    U_MIN,
    V_MAX,
    V_MIN,
    W_MAX,
    U,
    V,
    W,
)
from rastercov.kernels.jit import part_with_arrays

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
        if s == 0:
            p, q, up, vp, along_u, along_v = i, j, ui, vi, uj - ui, vj - vi
        elif s == 1:
            p, q, up, vp, along_u, along_v = j, k, uj, vj, uk - uj, vk - vj
        else:
            p, q, up, vp, along_u, along_v = k, i, uk, vk, ui - uk, vi - vk
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
def hidden_range(m, a, b, segment, first, last, tolerance, edges, is_event, camera, projected):
    """Part of first ... last where face m certainly hides a segment; (1, 0) if none.

    The face is shrunk by the tolerance, pixels, along its event edges; along the others, where the
    surface continues, it is grown by the rounding of a position.
    """
    faces = projected.faces
    i, j, k = faces[m, 0], faces[m, 1], faces[m, 2]
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
        margin = least if is_joined(m, s, n_lines, edges, is_event, projected) else most
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
def overlap_of(t, m, target, n, n_own, camera, projected, work):
    """Area that the images of two live faces have in common, px^2, and the sides of that of m.

    It is negative if one of them is so thin that rounding may decide. See `may_pass_through` for
    the arguments; the lines that bound the image of m are left in `work.lines`.
    """
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
    if separates(lines, n_sides, target, n) or separates(work.own, n_own, corners, k):
        return 0.0, n_sides
    copy_polygon(target, n, work.spare)
    n = clip(work.spare, n, lines, n_sides, other)
    if n < 3:
        return 0.0, n_sides
    return abs(twice_area(work.spare, n)) / 2, n_sides


@part_with_arrays
def take_intersection(t, m, n_sides, count, camera, projected, work):
    """Add the line of equal depth that `depth_order` left in `work.lines`; returns their number.

    Its range is that within the image of face m, which `n_sides` of `work.lines` bound, and within
    three times the box of face t. It may be too large, but not too small: the line may run along a
    side of m, so that rounding decides where it meets that side, and on which side of it it is.
    """
    lines, rows, box = work.lines, work.intersections, projected.box
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
def add_intersection(
    t, m, target, n, n_own, count, edges, is_event, camera, projected, work, area_error
):
    """Add the line along which a face in contact passes through a face; returns their number.

    It is `NOT_KNOWN` if the visibility of the face may change elsewhere: where the two coincide, or
    where the other, in front of it, continues behind it, beyond an edge that lies in it and is no
    event edge.

    Parameters
    ----------
    t, m : int
        The face, and the other.
    target, n, n_own : (24, 2) float64, int, int
        Image of face t; `work.own` has the lines that bound it.
    count : int
        Number of lines so far.
    edges, is_event, camera, projected
        As for `arrangement_areas`.
    work : Work
        The line is added to `work.intersections`.
    area_error : (F,) float64
        What rounding may decide along their contact is added to that of t.
    """
    box, state = projected.box, projected.state
    if not state[m] & LIVE:
        return np.int64(NOT_KNOWN) if state[m] & THIN else count
    for s in range(-1, 3):  # the other face itself; then, if it is in front, its neighbours
        other = np.int64(m)
        if s >= 0:
            e = edges.of_face[m, s]
            if is_event[e] or edges.faces[e, 1] < 0:
                continue
            other = np.int64(edges.faces[e, 0] if edges.faces[e, 0] != m else edges.faces[e, 1])
            if other == t or not state[other] & LIVE:
                continue
        overlap, n_sides = overlap_of(t, other, target, n, n_own, camera, projected, work)
        if overlap == 0 and s >= 0:
            continue
        if overlap == 0:
            return count
        if overlap < 0 or state[other] & DOUBTFUL:
            return np.int64(NOT_KNOWN)
        if s < 0:
            error = outline_error(m, camera, projected)
            across = min(box[t, U_MAX], box[m, U_MAX]) - max(box[t, U_MIN], box[m, U_MIN])
            down = min(box[t, V_MAX], box[m, V_MAX]) - max(box[t, V_MIN], box[m, V_MIN])
            if overlap <= SURE * error * (across + down):  # neighbours that abut, up to rounding
                area_error[t] += max(overlap, 4 * error * (across + down))
                return count
            area_error[t] += 4 * error * (across + down)
        order = depth_order(
            t, other, target, n, n_sides, camera, projected, work, s < 0, area_error
        )
        if order == IN_FRONT:
            continue
        if s >= 0 or order == TIED:
            return np.int64(NOT_KNOWN)
        if order == IN_FRONT_IN_PART:
            return take_intersection(t, m, n_sides, count, camera, projected, work)
        return count
    return count
