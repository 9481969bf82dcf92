"""Visible areas by half planes, compiled by numba.

One pose runs through four passes: `setup_kernels.project` and `setup_kernels.set_up`;
`grid_kernels.fill_grid`; and `visible_areas`, which takes one face at a time, finds its occluders
in the grid cells it touches, and subtracts from its image the part that each of them hides.

In the image w = 1/z is affine on a face, so the part of face T that face M hides is
T n M n {w_M > w_T}: a convex polygon. Subtracting a convex polygon from a convex piece leaves
convex pieces: each of its sides slices off the part beyond it. The pieces of T partition its
visible part, whatever the order of the occluders; a misjudged cut misplaces area, it never loses
any, so that the error is of the order of the rounding. No topology is kept that could become
inconsistent.

A. Appel. The Notion of Quantitative Invisibility and the Machine Rendering of Solids. 1967.
"""

import numpy as np

from rastercov._jit import allocation_free, inlined
from rastercov.exact.grid_kernels import cells_of_box
from rastercov.exact.polygon_kernels import (
    clip,
    clip_subtract,
    contains,
    copy_polygon,
    keep_inside,
    length,
    separates,
    separates_box,
    twice_area,
)
from rastercov.exact.records import (
    BEHIND,
    CLIPPED,
    DEPTH_TIE_REL,
    DOUBTFUL,
    DU,
    DV,
    IN_FRONT,
    IN_FRONT_IN_PART,
    LIVE,
    OFFSET,
    OUTLINE_ERROR,
    PARTLY,
    SIDES,
    SLOPE_U,
    SLOPE_V,
    STACK_ROOM,
    THIN,
    U_MAX,
    U_MIN,
    V_MAX,
    V_MIN,
    W_ERROR,
    W_MAX,
    W_MIN,
    U,
    V,
    W,
)
from rastercov.exact.setup_kernels import EDGE_ON_FACTOR, OUTLINE_ERROR_FACTOR

MOST_OCCLUDERS = 24
"""Occluders of a part of a face subtracted together; where there are more, it is halved first."""
LARGE_CELLS = 4
"""Cells beyond which a face is tested against each cell before the faces listed there."""
LEAST_GAIN = 1.7
"""A part is not halved if its halves have more occluders together than this, relative to it."""
NO_ROOM, ALL_HIDDEN = -1, -2
"""Results of `find_occluders` other than a count."""


@inlined
def outline(f, projected, corners, lines):
    """Fill `corners` and `lines` with the image of a live face; number of corners and of lines.

    It is clipped to the border of the image only if the face is clipped in space.
    """
    if projected.state[f] & CLIPPED:
        s, clipped = projected.clipped_index[f], projected.clipped
        copy_polygon(clipped.polygons[s], clipped.n_corners[s], corners)
        for p in range(SIDES):
            for column in range(OFFSET + 1):
                lines[p, column] = clipped.lines[s, p, column]
        return clipped.n_corners[s], SIDES
    faces, uvw = projected.faces, projected.uvw
    second, third = (1, 2) if projected.side[f] < 0 else (2, 1)
    i, j, k = faces[f, 0], faces[f, second], faces[f, third]
    corners[0, U], corners[0, V] = uvw[i, U], uvw[i, V]
    corners[1, U], corners[1, V] = uvw[j, U], uvw[j, V]
    corners[2, U], corners[2, V] = uvw[k, U], uvw[k, V]
    for p in range(3):
        q = p + 1 if p < 2 else 0
        lines[p, U], lines[p, V] = corners[p, U], corners[p, V]
        lines[p, DU], lines[p, DV] = corners[q, U] - corners[p, U], corners[q, V] - corners[p, V]
        lines[p, OFFSET] = 0.0
    return 3, 3


@inlined
def outline_error(f, camera, projected):
    """Largest error of the outline of a face, pixels."""
    if not projected.state[f] & CLIPPED:
        return camera.pixel_error
    plane = projected.clipped_index[f]
    return max(camera.pixel_error, projected.clipped.planes[plane, OUTLINE_ERROR])


@inlined
def plane_of(f, camera, projected):
    """Plane of a face: a point (u, v, w), the slopes of w along u and v, and the error of w.

    The error includes that of the corners and of the arithmetic here, anywhere in the face.
    """
    if projected.state[f] & CLIPPED:
        planes, s = projected.clipped.planes, projected.clipped_index[f]
        return (
            planes[s, U], planes[s, V], planes[s, W],
            planes[s, SLOPE_U], planes[s, SLOPE_V], planes[s, W_ERROR],
        )  # fmt: skip
    faces, uvw = projected.faces, projected.uvw
    i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
    u, v, w = uvw[i, U], uvw[i, V], uvw[i, W]
    u1, v1, w1 = uvw[j, U] - u, uvw[j, V] - v, uvw[j, W] - w
    u2, v2, w2 = uvw[k, U] - u, uvw[k, V] - v, uvw[k, W] - w
    twice = u1 * v2 - u2 * v1
    a, b = (w1 * v2 - w2 * v1) / twice, (u1 * w2 - u2 * w1) / twice
    # The slope across a needle is known to few digits.
    change = abs(w1) + abs(w2)
    skew = (abs(u1) + abs(u2)) * (abs(v1) + abs(v2)) / abs(twice)
    error = camera.w_error_rel * (w + change * skew) + camera.pixel_error * (abs(a) + abs(b))
    return u, v, w, a, b, error


@inlined
def depth_order(t, m, target, n, n_sides, camera, projected, work, area_error):
    """Depth order of face m relative to face t, over the overlap of their images.

    The order is unknown where w differs by less than its error, a strip along the line of equal
    depth. The smaller the angle at which faces pierce each other, the wider the strip. Its area is
    added to `area_error` of t.

    `target` and n are the image of t; `work.lines` has the `n_sides` lines that bound that of m.
    The result is `BEHIND`, `IN_FRONT` or `IN_FRONT_IN_PART`; for the last, the line of equal depth
    is appended to `work.lines`.
    """
    faces, box, lines, spare = projected.faces, projected.box, work.lines, work.spare
    if box[m, W_MIN] > box[t, W_MAX] * (1 + 2 * DEPTH_TIE_REL):
        return IN_FRONT
    # The overlap, and the difference of w at its corners.
    copy_polygon(target, n, spare)
    n = clip(spare, n, lines, n_sides, work.other)
    if n < 3:
        return BEHIND
    u_t, v_t, w_t, a_t, b_t, error_t = plane_of(t, camera, projected)
    u_m, v_m, w_m, a_m, b_m, error_m = plane_of(m, camera, projected)
    least, most, first, apart = np.inf, -np.inf, 0.0, -np.inf
    u_min = v_min = np.inf
    u_max = v_max = -np.inf
    for p in range(n):
        u, v = spare[p, U], spare[p, V]
        u_min, u_max, v_min, v_max = min(u_min, u), max(u_max, u), min(v_min, v), max(v_max, v)
        mine = w_t + a_t * (u - u_t) + b_t * (v - v_t)
        its = w_m + a_m * (u - u_m) + b_m * (v - v_m)
        nearer = its - mine
        if p == 0:
            first = nearer
        apart = max(apart, abs(nearer) - DEPTH_TIE_REL * max(mine, its))
        least, most = min(least, nearer), max(most, nearer)
    # The planes of two faces that share an edge meet along that edge and nowhere else.
    i, j, k = faces[t, 0], faces[t, 1], faces[t, 2]
    shared = 0
    for p in range(3):
        if faces[m, p] in (i, j, k):
            shared += 1
    error = error_t + error_m
    common = abs(twice_area(spare, n)) / 2
    if abs(apart) <= error or (apart > 0 and max(most, -least) <= error):
        area_error[t] += common
    elif apart > 0 and shared < 2 and least <= error and most >= -error:
        extent = length(u_max - u_min, v_max - v_min, 0.0)
        strip = error / length(a_m - a_t, b_m - b_t, 0.0) * extent
        area_error[t] += min(strip, common)
    if apart <= 0:
        return IN_FRONT if m < t else BEHIND
    if shared >= 2:
        return IN_FRONT if most > -least else BEHIND
    if most <= 0:
        return BEHIND
    if least >= 0:
        return IN_FRONT
    # first + (a_m - a_t)(u - u0) + (b_m - b_t)(v - v0) >= 0
    lines[n_sides, U], lines[n_sides, V] = spare[0, U], spare[0, V]
    lines[n_sides, DU], lines[n_sides, DV], lines[n_sides, OFFSET] = b_m - b_t, a_t - a_m, first
    return IN_FRONT_IN_PART


@inlined
def find_occluders(
    t, target, n, own, n_own, camera, projected, grid, marks, occluders, work, area_error
):
    """Fill `faces`, `order` and `lines` of `occluders` with the faces that hide a part of face t.

    `target` and n are the image of t, `own` the `n_own` lines that bound it. `marks` has the last
    face whose search visited each face. The effect of rounding along the outlines of the faces
    found, and on their depth order, is added to `area_error` of t.

    The result is their number; `NO_ROOM` if `occluders` is too small; `ALL_HIDDEN` if one face
    hides all of t.
    """
    box, state, lines, corners = projected.box, projected.state, work.lines, work.corners
    starts, entries = grid.starts, grid.entries
    farthest = box[t, W_MIN] * (1 - 2 * DEPTH_TIE_REL)
    u_min, u_max, v_min, v_max = box[t, U_MIN], box[t, U_MAX], box[t, V_MIN], box[t, V_MAX]
    left, right, top, bottom = cells_of_box(box, t, grid)
    is_large = (right - left) * (bottom - top) > LARGE_CELLS
    count = 0
    for row in range(top, bottom + 1):
        for column in range(left, right + 1):
            if is_large and separates_box(
                own, n_own, grid.left + column / grid.per_u, grid.left + (column + 1) / grid.per_u,
                grid.top + row / grid.per_v, grid.top + (row + 1) / grid.per_v,
            ):  # fmt: skip
                continue
            at = row * grid.columns + column
            for entry in range(starts[at], starts[at + 1]):
                m = entries[entry]
                if box[m, W_MAX] < farthest or box[m, U_MIN] >= u_max or box[m, U_MAX] <= u_min:
                    continue
                if box[m, V_MIN] >= v_max or box[m, V_MAX] <= v_min or marks[m] == t or m == t:
                    continue
                marks[m] = t
                if separates_box(
                    own, n_own, box[m, U_MIN], box[m, U_MAX], box[m, V_MIN], box[m, V_MAX]
                ):
                    continue
                across = min(u_max, box[m, U_MAX]) - max(u_min, box[m, U_MIN])
                down = min(v_max, box[m, V_MAX]) - max(v_min, box[m, V_MIN])
                if state[m] & DOUBTFUL:
                    error = outline_error(m, camera, projected)
                    area_error[t] += 4 * EDGE_ON_FACTOR * (across + down) * error
                    if state[m] & THIN:
                        continue
                k, n_sides = outline(m, projected, corners, lines)
                if separates(lines, n_sides, target, n) or separates(own, n_own, corners, k):
                    continue
                order = depth_order(t, m, target, n, n_sides, camera, projected, work, area_error)
                if order == BEHIND:
                    continue
                if order == IN_FRONT and contains(lines, n_sides, target, n):
                    return ALL_HIDDEN
                if count == occluders.faces.shape[0]:
                    return NO_ROOM
                area_error[t] += 4 * (across + down) * outline_error(m, camera, projected)
                occluders.faces[count] = m
                occluders.order[count] = order
                for p in range(OFFSET + 1):
                    occluders.lines[count, p] = lines[n_sides, p]
                count += 1
    return count


@inlined
def subtract_occluders(polygon, n, first, last, camera, projected, occluders, pieces, work):
    """Twice the area that some occluders leave of a polygon, or -1 for lack of room.

    They are rows chosen[first] ... chosen[last - 1] of `occluders`; `pieces` and `work` are
    scratch.
    """
    lines = work.lines
    copy_polygon(polygon, n, pieces.corners[0])
    pieces.n_corners[0], count = n, np.int64(1)
    for index in range(first, last):
        row = occluders.chosen[index]
        _, n_lines = outline(occluders.faces[row], projected, work.corners, lines)
        n_sides = n_lines
        if occluders.order[row] == IN_FRONT_IN_PART:
            for p in range(OFFSET + 1):
                lines[n_sides, p] = occluders.lines[row, p]
            n_lines += 1
        count = clip_subtract(
            pieces, count, lines, n_sides, n_lines, camera.pixel_error, work.spare, work.values
        )
        if count == 0:
            return 0.0
        if count < 0:
            return -1.0
    twice = 0.0
    for p in range(count):
        twice += max(twice_area(pieces.corners[p], pieces.n_corners[p]), 0.0)
    return twice


@allocation_free
def halve(top, occluders, box, work):
    """Replace the part on top of the stack by its halves; returns how many that are.

    0 if that separates few occluders.
    """
    parts, ranges, spare = work.parts, work.ranges, work.spare
    chosen = occluders.chosen
    n, low, high = parts.n_corners[top], ranges[top, 0], ranges[top, 1]
    u_min = v_min = np.inf
    u_max = v_max = -np.inf
    copy_polygon(parts.corners[top], n, spare)
    for p in range(n):
        u_min, u_max = min(u_min, spare[p, U]), max(u_max, spare[p, U])
        v_min, v_max = min(v_min, spare[p, V]), max(v_max, spare[p, V])
    is_across = u_max - u_min >= v_max - v_min
    middle = (u_min + u_max) / 2 if is_across else (v_min + v_max) / 2
    least, greatest = (U_MIN, U_MAX) if is_across else (V_MIN, V_MAX)
    end = high
    n_halves = 0
    for half in range(2):
        start = end
        for k in range(low, high):
            m = occluders.faces[chosen[k]]
            if (box[m, least] < middle) if half == 0 else (box[m, greatest] > middle):
                chosen[end] = chosen[k]
                end += 1
        ranges[top + half, 0], ranges[top + half, 1] = start, end
    if end - high > LEAST_GAIN * (high - low):
        ranges[top, 0], ranges[top, 1] = low, high
        return 0
    for half in range(2):
        inward = -1.0 if half == 0 else 1.0
        du, dv = (0.0, -inward) if is_across else (inward, 0.0)
        first, last = ranges[top + half, 0], ranges[top + half, 1]
        line = (middle, middle, du, dv, 0.0)
        kept = keep_inside(spare, n, line, parts.corners[top + n_halves])
        if kept >= 3:
            parts.n_corners[top + n_halves] = kept
            ranges[top + n_halves, 0], ranges[top + n_halves, 1] = first, last
            n_halves += 1
    return n_halves


@inlined
def visible_twice_area(target, n, count, camera, projected, occluders, pieces, work):
    """Twice the area that the first `count` occluders leave of `target`, or -1 for lack of room.

    A part with more than `MOST_OCCLUDERS` is halved first. `pieces` and `work` are scratch.
    """
    parts, ranges = work.parts, work.ranges
    copy_polygon(target, n, parts.corners[0])
    for k in range(count):
        occluders.chosen[k] = k
    parts.n_corners[0], ranges[0, 0], ranges[0, 1] = n, 0, count
    top, twice = 1, 0.0
    while top > 0:
        top -= 1
        low, high = ranges[top, 0], ranges[top, 1]
        if (
            high - low > MOST_OCCLUDERS
            and top + 2 < STACK_ROOM
            and high + 2 * (high - low) <= occluders.chosen.shape[0]
        ):
            n_halves = halve(top, occluders, projected.box, work)
            if n_halves > 0:
                top += n_halves
                continue
        rest = subtract_occluders(
            parts.corners[top], parts.n_corners[top], low, high, camera, projected, occluders,
            pieces, work,
        )  # fmt: skip
        if rest < 0:
            return -1.0
        twice += rest
    return twice


@allocation_free
def visible_areas(
    targets, first, camera, projected, grid, marks, occluders, pieces, work, visible, area_error
):
    """Visible areas of some faces; returns how many of `targets` are done.

    If not all are, there is too little scratch memory: call again with more and that number.

    Parameters
    ----------
    targets : (N,) int32
        Faces.
    first : int
        Those before this one are done.
    projected : Projected
        As filled by `set_up`.
    marks : (F,) int64
        Scratch: below 0 at the start of each pose. `occluders`, `pieces`, `work` are scratch, too.
    visible : (F,) float64
        Out: visible px^2 inside the image, for the targets.
    area_error : (F,) float64
        Out: bound of the errors of `visible` and `area` together, px^2, for the targets.
    """
    state, box, area = projected.state, projected.box, projected.area
    target, own, border = work.target, work.own, camera.border
    for index in range(first, targets.shape[0]):
        t = targets[index]
        visible[t] = area_error[t] = 0.0
        if not state[t] & (LIVE | THIN):
            continue
        width = min(box[t, U_MAX], camera.width) - max(box[t, U_MIN], 0.0)
        height = min(box[t, V_MAX], camera.height) - max(box[t, V_MIN], 0.0)
        error = outline_error(t, camera, projected)
        if state[t] & THIN:
            area_error[t] = 4 * EDGE_ON_FACTOR * (width + height) * error
            continue
        area_error[t] = OUTLINE_ERROR_FACTOR * (width + height) * error
        n, n_own = outline(t, projected, target, own)
        if state[t] & PARTLY:
            n = clip(target, n, border, border.shape[0], work.spare)
        count = find_occluders(
            t, target, n, own, n_own, camera, projected, grid, marks, occluders, work, area_error
        )
        if count == NO_ROOM:
            marks[:] = -1
            return index
        if count == ALL_HIDDEN:
            continue
        if count == 0:
            visible[t] = area[t]
            continue
        twice = visible_twice_area(target, n, count, camera, projected, occluders, pieces, work)
        if twice < 0:
            marks[:] = -1
            return index
        # Remainders up to the rounding count as nothing, both of the visible and the hidden part.
        tolerance = camera.pixel_error * (
            box[t, U_MAX] - box[t, U_MIN] + box[t, V_MAX] - box[t, V_MIN]
        )
        seen = twice / 2
        if seen <= tolerance:
            visible[t] = 0.0
        else:
            visible[t] = area[t] if seen >= area[t] - tolerance else seen
    return targets.shape[0]
