"""Visible areas by the arrangement of event edges on a face, compiled by numba.

The visibility of a face changes only where an event edge that is visible itself crosses it. The
lines of these edges divide its image into convex cells; in each cell the face is wholly visible or
wholly hidden, which the faces in front of one point of it decide. A face has few such edges, two in
the median, whatever number of faces is in front of it.

Where rounding could decide - a point that lies too near to an edge or to another surface - the face
is left to `half_plane_kernels`.

A. Appel. The Notion of Quantitative Invisibility and the Machine Rendering of Solids. 1967.
"""

import numpy as np

from rastercov._jit import allocation_free, inlined
from rastercov.exact.grid_kernels import cell
from rastercov.exact.half_plane_kernels import depth_order, hides_all
from rastercov.exact.outline_kernels import (
    is_joined,
    n_sides_of,
    outline,
    outline_error,
    plane_of,
    side_of,
)
from rastercov.exact.polygon_kernels import (
    clip,
    copy_polygon,
    line_value,
    separates,
    split,
    twice_area,
)
from rastercov.exact.records import (
    CLIPPED,
    DEPTH_TIE_REL,
    DOUBTFUL,
    DU,
    DV,
    EDGE_ERROR,
    FIRST,
    IN_CONTACT,
    IN_FRONT,
    IN_FRONT_IN_PART,
    LAST,
    LIVE,
    PARTLY,
    THIN,
    TIED,
    U_MAX,
    U_MIN,
    UNFIT,
    V_MAX,
    V_MIN,
    W_MAX,
    U,
    V,
)
from rastercov.exact.setup_kernels import OUTLINE_ERROR_FACTOR

MOST_CROSSINGS = 24
"""Crossings of a face beyond which it is left to half planes, which divide the image by cells."""
MOST_CELLS = 128
"""Cells of a face beyond which it is left to them, too."""
SURE = 16
"""Distance from an edge, in roundings of a position, that makes a point lie on one side of it."""
THINNEST = 2**24
"""Width of a face, in the same, below which rounding may decide what is beside it."""
VISIBLE, HIDDEN, UNSURE = range(3)
"""Results of `point_visibility`."""


@inlined
def comes_before(segment, other):
    """True if the first of u, v, du, dv that differ is less in a segment than in another."""
    for column in range(FIRST):
        if segment[column] != other[column]:
            return segment[column] < other[column]
    return False


@inlined
def order_crossings(t, crossings, order):
    """Fill `order` with the crossings of a face from left to right; returns their number.

    The order must not depend on the numbers of vertices, which decide the order in the list. It is
    `MOST_CROSSINGS` + 1 if there are more than `MOST_CROSSINGS`.
    """
    segments, n, c = crossings.segments, 0, crossings.last[t]
    while c >= 0:
        if n == MOST_CROSSINGS:
            return n + 1
        at = n
        while at > 0 and comes_before(segments[c], segments[order[at - 1]]):
            order[at] = order[at - 1]
            at -= 1
        order[at] = c
        n += 1
        c = crossings.before[c]
    return n


@inlined
def divide_piece(pieces, p, count, crossings, c, work):
    """Divide a piece by the line of a crossing that runs through it; returns the piece count.

    Parameters
    ----------
    pieces : Pieces
        Changed in place; the part beyond the line is appended.
    p, count : int
        The piece, and the number of pieces.
    crossings, c : Crossings, int
        The crossing.
    work : Work
        Scratch.
    """
    corners, n, values = pieces.corners[p], pieces.n_corners[p], work.values
    segment = crossings.segments[c]
    u, v, du, dv, tolerance = segment[U], segment[V], segment[DU], segment[DV], segment[EDGE_ERROR]
    slack = tolerance * (abs(du) + abs(dv))
    line = (u, v, du, dv, 0.0)
    least = most = 0.0
    for k in range(n):
        value = line_value(line, corners[k, U], corners[k, V])
        values[k] = value if abs(value) > slack else 0.0
        least, most = min(least, values[k]), max(most, values[k])
    if least == 0 or most == 0:
        return count
    # The part of the line within the piece must hold a part of the crossing.
    squared = du * du + dv * dv
    low, high = np.inf, -np.inf
    for k in range(n):
        m = k + 1 if k + 1 < n else 0
        if values[k] == 0:
            at_u, at_v = corners[k, U], corners[k, V]
        elif values[k] * values[m] < 0:
            t = values[k] / (values[k] - values[m])
            at_u = corners[k, U] + t * (corners[m, U] - corners[k, U])
            at_v = corners[k, V] + t * (corners[m, V] - corners[k, V])
        else:
            continue
        t = ((at_u - u) * du + (at_v - v) * dv) / squared
        low, high = min(low, t), max(high, t)
    reach = tolerance * (abs(du) + abs(dv)) / squared
    if min(high, segment[LAST]) - max(low, segment[FIRST]) <= reach:
        return count
    kept, lost = split(corners, n, values, work.spare, pieces.corners[count])
    if kept < 3 or lost < 3:
        return count
    copy_polygon(work.spare, kept, corners)
    pieces.n_corners[p], pieces.n_corners[count] = kept, lost
    return count + 1


@inlined
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


@inlined
def may_pass_through(t, m, target, n, n_own, edges, is_event, camera, projected, work, area_error):
    """True if the visibility of a face may change where another one in contact meets it.

    That is where the other passes through it or coincides with it; or where the other, in front of
    it, continues behind it, beyond an edge that lies in it and is no event edge. `target` and n are
    the image of face t, `work.own` the `n_own` lines that bound it. Where the answer is no, what
    rounding may decide along their contact is added to `area_error` of t.
    """
    box, state = projected.box, projected.state
    if not state[m] & LIVE:
        return state[m] & THIN != 0
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
            return False
        if overlap < 0 or state[other] & DOUBTFUL:
            return True
        if s < 0:
            error = outline_error(m, camera, projected)
            across = min(box[t, U_MAX], box[m, U_MAX]) - max(box[t, U_MIN], box[m, U_MIN])
            down = min(box[t, V_MAX], box[m, V_MAX]) - max(box[t, V_MIN], box[m, V_MIN])
            if overlap <= SURE * error * (across + down):  # neighbours that abut, up to rounding
                area_error[t] += max(overlap, 4 * error * (across + down))
                return False
            area_error[t] += 4 * error * (across + down)
        order = depth_order(
            t, other, target, n, n_sides, camera, projected, work, s < 0, area_error
        )
        if order != IN_FRONT:
            return s >= 0 or order in (IN_FRONT_IN_PART, TIED)
    return False


@inlined
def covers(m, u, v, edges, is_event, camera, projected):
    """`HIDDEN` if the image of a face covers a point, `VISIBLE` if it does not, or `UNSURE`."""
    n_lines = n_sides_of(m, projected)
    error = outline_error(m, camera, projected)
    result = HIDDEN
    for s in range(n_lines):
        line = side_of(m, s, projected)
        value = line_value(line, u, v)
        margin = SURE * error * (abs(line[DU]) + abs(line[DV]))
        if value < -margin:
            return VISIBLE
        if value < margin and not is_joined(m, s, n_lines, edges, is_event, projected):
            result = UNSURE
    return result


@inlined
def point_visibility(t, u, v, hider, plane, edges, is_event, camera, projected, grid, work):
    """`VISIBLE`, `HIDDEN` or `UNSURE` for a point of a face; and a face that hides it.

    Parameters
    ----------
    t : int
        The face.
    u, v : float
        The point, pixels.
    hider : int
        A face to look at first, -1 for none.
    plane : tuple
        Of `plane_of` the face.
    edges, is_event, camera, projected, grid, work
        As for `arrangement_areas`.
    """
    box, state = projected.box, projected.state
    u_t, v_t, w_t, a_t, b_t, error_t = plane
    w = w_t + a_t * (u - u_t) + b_t * (v - v_t)
    farthest = w - error_t - 4 * DEPTH_TIE_REL * w
    column = cell(u, grid.left, grid.per_u, grid.columns)
    row = cell(v, grid.top, grid.per_v, grid.rows)
    at = row * grid.columns + column
    result = VISIBLE
    for entry in range(grid.starts[at] - 1, grid.starts[at + 1]):
        is_guess = entry < grid.starts[at]
        m = np.int64(hider) if is_guess else np.int64(grid.entries[entry])
        if m < 0 or m == t or box[m, W_MAX] < farthest:
            continue
        if not (box[m, U_MIN] <= u <= box[m, U_MAX] and box[m, V_MIN] <= v <= box[m, V_MAX]):
            continue
        if not state[m] & LIVE:
            continue
        covered = covers(m, u, v, edges, is_event, camera, projected)
        if covered == VISIBLE:
            continue
        u_m, v_m, w_m, a_m, b_m, error_m = plane_of(m, camera, projected)
        nearer = w_m + a_m * (u - u_m) + b_m * (v - v_m) - w
        margin = error_t + error_m + 2 * DEPTH_TIE_REL * (w + abs(nearer))
        if nearer < -margin:
            continue
        if nearer <= margin or covered == UNSURE:
            result = UNSURE
            continue
        return HIDDEN, m
    return result, np.int64(-1)


@allocation_free
def arrangement_areas(
    targets,
    crossings,
    partners,
    edges,
    is_event,
    camera,
    projected,
    grid,
    pieces,
    work,
    visible,
    area_error,
    left,
):
    """Visible areas of crossed faces; returns how many are left to half planes.

    Parameters
    ----------
    targets : (N,) int32
        Crossed faces.
    crossings, edges : Crossings, Edges
    partners : Partners
        Faces in contact with each.
    is_event : (E,) bool
        Event edges.
    camera, projected, grid
        Pinhole; Projected; CellGrid.
    pieces, work : Pieces, Work
        Scratch; `MOST_CELLS` pieces or more.
    visible, area_error : (F,) float64
        Out: as of `half_plane_kernels.visible_areas`.
    left : (N,) int32
        Out: faces that are left to half planes.
    """
    state, box, area = projected.state, projected.box, projected.area
    target, border, order, n_left = work.target, camera.border, work.levels, 0
    hider = np.int64(-1)
    for index in range(targets.shape[0]):
        t = targets[index]
        n_crossings = order_crossings(t, crossings, order)
        if (
            state[t] & UNFIT
            or n_crossings > MOST_CROSSINGS
            or (n_crossings == 0 and not state[t] & IN_CONTACT)
        ):
            left[n_left] = t
            n_left += 1
            continue
        width = min(box[t, U_MAX], camera.width) - max(box[t, U_MIN], 0.0)
        height = min(box[t, V_MAX], camera.height) - max(box[t, V_MIN], 0.0)
        visible[t] = 0.0
        error = OUTLINE_ERROR_FACTOR * (width + height) * camera.pixel_error
        area_error[t] = error
        n, n_own = outline(t, projected, target, work.own)
        if state[t] & PARTLY:
            n = clip(target, n, border, border.shape[0], work.spare)
            if n < 3:
                continue
        if hider >= 0 and hides_all(hider, t, target, n, camera, projected, work, area_error):
            continue
        fits = True
        if state[t] & IN_CONTACT:
            for k in range(partners.starts[t], partners.starts[t + 1]):
                m = partners.faces[k]
                if may_pass_through(
                    t, m, target, n, n_own, edges, is_event, camera, projected, work, area_error
                ):
                    fits = False
                    break
        copy_polygon(target, n, pieces.corners[0])
        pieces.n_corners[0], count = n, np.int64(1)
        for k in range(n_crossings if fits else 0):
            c = order[k]
            segment = crossings.segments[c]
            area_error[t] += (
                4 * (abs(segment[DU]) + abs(segment[DV])) * (segment[LAST] - segment[FIRST])
                * segment[EDGE_ERROR]
            )  # fmt: skip
            for p in range(count):
                if count == MOST_CELLS:
                    fits = False
                    break
                count = divide_piece(pieces, p, count, crossings, c, work)
        plane = plane_of(t, camera, projected)
        twice = 0.0
        for p in range(count):
            if not fits:
                break
            corners, n = pieces.corners[p], pieces.n_corners[p]
            u, v, around = corners[0, U], corners[0, V], 0.0
            twice_piece = mean_u = mean_v = 0.0
            for k in range(1, n):
                u1, v1 = corners[k, U] - u, corners[k, V] - v
                around += abs(corners[k, U] - corners[k - 1, U])
                around += abs(corners[k, V] - corners[k - 1, V])
                if k + 1 < n:
                    u2, v2 = corners[k + 1, U] - u, corners[k + 1, V] - v
                    part = u1 * v2 - u2 * v1
                    twice_piece += part
                    mean_u += part * (u1 + u2)
                    mean_v += part * (v1 + v2)
            if twice_piece <= 4 * SURE * camera.pixel_error * around:
                # A sliver without a point that surely lies inside.
                if twice_piece > error:
                    fits = False
                area_error[t] += max(twice_piece, 0.0)
                continue
            u, v = u + mean_u / (3 * twice_piece), v + mean_v / (3 * twice_piece)
            seen, face = point_visibility(
                t, u, v, hider, plane, edges, is_event, camera, projected, grid, work
            )
            if seen == UNSURE:
                fits = False
            elif seen == VISIBLE:
                twice += twice_piece
            else:
                hider = face
        if not fits:
            left[n_left] = t
            n_left += 1
            continue
        tolerance = camera.pixel_error * (
            box[t, U_MAX] - box[t, U_MIN] + box[t, V_MAX] - box[t, V_MIN]
        )
        seen_area = twice / 2
        if seen_area > tolerance:
            visible[t] = area[t] if seen_area >= area[t] - tolerance else seen_area
    return n_left
