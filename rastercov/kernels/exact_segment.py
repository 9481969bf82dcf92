"""Segments of the image: the parts that cross a face or are hidden by one; compiled by numba.

A part is a range: 0 at the start of the segment, 1 at its end.
"""

import numpy as np

from rastercov.kernels.exact_outline import is_joined, n_sides_of, outline_error, plane_of, side_of
from rastercov.kernels.exact_polygon import line_value
from rastercov.kernels.exact_records import (
    CLIPPED,
    DEPTH_TIE_REL,
    DU,
    DV,
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
