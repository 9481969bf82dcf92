"""Faces in contact with a face: where they may change what is visible of it, compiled by numba.

A face that another one in contact passes through is visible on one side of their intersection at
most. In the image that is a line, along which 1/z of the two is equal.
"""

import numpy as np

from rastercov.kernels.exact_half_plane import depth_order
from rastercov.kernels.exact_outline import outline, outline_error, plane_of
from rastercov.kernels.exact_polygon import clip, copy_polygon, length, separates, twice_area
from rastercov.kernels.exact_records import (
    CLIPPED,
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
    U,
    V,
)
from rastercov.kernels.exact_segment import narrowed
from rastercov.kernels.jit import part_with_arrays

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
