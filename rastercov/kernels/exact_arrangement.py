"""Visible areas by the arrangement of event edges on a face, compiled by numba.

The visibility of a face changes only where an event edge that is visible itself crosses it, or
where another face passes through it. These lines divide its image into convex cells; in each cell
the face is wholly visible or wholly hidden, which the faces in front of one point of it decide. A
face has few such lines, two in the median, whatever number of faces is in front of it.

A face that nothing crosses is one cell. It decides over its region, so three points of it are
asked, which must agree.

Where rounding could decide - a point that lies too near to an edge or to another surface - the face
is left to `exact_half_plane`.

A. Appel. The Notion of Quantitative Invisibility and the Machine Rendering of Solids. 1967.
"""

import numpy as np

from rastercov.kernels.exact_event import NOT_KNOWN, SURE, add_intersection
from rastercov.kernels.exact_grid import (
    ENTRIES_AT_A_TIME,
    cell_at,
    find_faces,
    lay_bounds,
)
from rastercov.kernels.exact_half_plane import is_hidden_by_one, settle_area, take_target
from rastercov.kernels.exact_polygon import (
    copy_polygon,
    drop_pieces,
    is_joined,
    line_value,
    n_sides_of,
    outline_error,
    plane_of,
    side_of,
    split,
    store_piece,
    values_on_line,
)
from rastercov.kernels.exact_records import (
    CROSSED,
    DEPTH_TIE_REL,
    DU,
    DV,
    EDGE_ERROR,
    FIRST,
    IN_CONTACT,
    LAST,
    LIVE,
    U_MAX,
    U_MIN,
    UNFIT,
    V_MAX,
    V_MIN,
    W_MAX,
    U,
    V,
)
from rastercov.kernels.jit import allocation_free, part_with_arrays

MOST_CROSSINGS = 24
"""Crossings of a face beyond which it is left to half planes, which divide the image by cells."""
MOST_CELLS = 128
"""Cells of a face beyond which it is left to them, too."""
VISIBLE, HIDDEN, UNSURE = range(3)
"""Results of `point_visibility`."""


@part_with_arrays
def comes_before(segment, other):
    """True if the first of u, v, du, dv that differ is less in a segment than in another."""
    for column in range(FIRST):
        if segment[column] != other[column]:
            return segment[column] < other[column]
    return False


@part_with_arrays
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


@part_with_arrays
def divide_piece(pieces, p, count, segment, work):
    """Divide a piece by the line of a crossing that runs through it; returns the piece count.

    Parameters
    ----------
    pieces : Pieces
        Changed in place; the part beyond the line is appended.
    p, count : int
        The piece, and the number of pieces.
    segment : (7,) float64
        The crossing, as in `Crossings.segments`.
    work : Work
        Scratch.
    """
    corners, n, values = pieces.corners[p], pieces.n_corners[p], work.values
    u, v, du, dv, tolerance = segment[U], segment[V], segment[DU], segment[DV], segment[EDGE_ERROR]
    slack = tolerance * (abs(du) + abs(dv))
    line = (u, v, du, dv, 0.0)
    least, most = values_on_line(corners, n, line, slack, values)
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


@part_with_arrays
def covers(m, u, v, view):
    """`HIDDEN` if the image of a face covers a point, `VISIBLE` if it does not, or `UNSURE`."""
    projected = view.projected
    n_lines = n_sides_of(m, projected)
    error = outline_error(m, view.camera, projected)
    result = HIDDEN
    for s in range(n_lines):
        line = side_of(m, s, projected)
        value = line_value(line, u, v)
        margin = SURE * error * (abs(line[DU]) + abs(line[DV]))
        if value < -margin:
            return VISIBLE
        if value < margin and not is_joined(m, s, n_lines, view):
            result = UNSURE
    return result


@part_with_arrays
def point_visibility(t, u, v, plane, view):
    """`VISIBLE`, `HIDDEN` or `UNSURE` for a point of face t, pixels, whose `plane_of` is given."""
    camera, projected, grid = view.camera, view.projected, view.grid
    box, state = projected.box, projected.state
    u_t, v_t, w_t, a_t, b_t, error_t = plane
    w = w_t + a_t * (u - u_t) + b_t * (v - v_t)
    farthest = w - error_t - 4 * DEPTH_TIE_REL * w
    at = cell_at(u, v, grid)
    lay_bounds(at, box, grid)
    rectangle, depths = (u, u, v, v), (farthest, -np.inf, np.inf)
    result, entry, stop, m = VISIBLE, grid.starts[at], grid.stops[at], np.int64(grid.hider[at])
    index, n = np.int64(-1), np.int64(0)
    while index < n or entry < stop:
        if index == n:
            following = min(entry + ENTRIES_AT_A_TIME, stop)
            n = find_faces(entry, following, rectangle, depths, grid, np.int64(0))
            entry, index = following, np.int64(0)
            continue
        if index >= 0:
            m = np.int64(grid.found[index])
        index += 1
        if m < 0 or m == t or box[m, W_MAX] < farthest or not state[m] & LIVE:
            continue
        if not (box[m, U_MIN] <= u <= box[m, U_MAX] and box[m, V_MIN] <= v <= box[m, V_MAX]):
            continue
        covered = covers(m, u, v, view)
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
        grid.hider[at] = m
        return HIDDEN
    return result


@part_with_arrays
def divide_about_centre(target, n, pieces):
    """Divide a face into triangles about its centre; returns their number."""
    u = v = 0.0
    for p in range(n):
        u, v = u + target[p, U] / n, v + target[p, V] / n
    for p in range(n):
        q, corners = p + 1 if p + 1 < n else 0, pieces.corners[p]
        corners[0, U], corners[0, V] = u, v
        corners[1, U], corners[1, V] = target[p, U], target[p, V]
        corners[2, U], corners[2, V] = target[q, U], target[q, V]
        pieces.n_corners[p] = 3
    return n


@part_with_arrays
def list_intersections(t, n, n_own, partners, view):
    """List the lines along which faces in contact pass through a face; see `add_intersection`."""
    n_lines = np.int64(0)
    if view.projected.state[t] & IN_CONTACT:
        for k in range(partners.starts[t], partners.starts[t + 1]):
            n_lines = add_intersection(t, partners.faces[k], n, n_own, n_lines, view)
            if n_lines == NOT_KNOWN:
                break
    return n_lines


@part_with_arrays
def divide_target(t, n, n_crossings, n_lines, crossings, view, pieces):
    """Divide a face by its crossings and `n_lines` intersections; its cells, -1 for too many.

    What the error of a line may move is added to the bound of the face.
    """
    work, order, count = view.work, view.work.levels, np.int64(1)
    if view.projected.state[t] & CROSSED:
        copy_polygon(work.target, n, pieces.corners[0])
        pieces.n_corners[0] = n
    else:
        count = divide_about_centre(work.target, n, pieces)
    for k in range(n_crossings + n_lines):
        segment = work.intersections[k - n_crossings]
        if k < n_crossings:
            segment = crossings.segments[order[k]]
        view.area_error[t] += (
            4 * (abs(segment[DU]) + abs(segment[DV])) * (segment[LAST] - segment[FIRST])
            * segment[EDGE_ERROR]
        )  # fmt: skip
        for p in range(count):
            if count == MOST_CELLS:
                return np.int64(NOT_KNOWN)
            count = divide_piece(pieces, p, count, segment, work)
    return count


@part_with_arrays
def sum_cells(t, count, error, view, pieces):
    """Twice the area of the visible ones of the cells of a face, and the number of hidden ones.

    It is `NOT_KNOWN` where rounding could decide. A sliver, without a point that surely lies
    inside, goes into the bound of the face; one of more than `error` decides.
    """
    pixel_error, plane = view.camera.pixel_error, plane_of(t, view.camera, view.projected)
    n_hidden, twice = 0, 0.0
    for p in range(count):
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
        if twice_piece <= 4 * SURE * pixel_error * around:
            if twice_piece > error:
                return float(NOT_KNOWN), n_hidden
            view.area_error[t] += max(twice_piece, 0.0)
            continue
        u, v = u + mean_u / (3 * twice_piece), v + mean_v / (3 * twice_piece)
        seen = point_visibility(t, u, v, plane, view)
        if seen == UNSURE:
            return float(NOT_KNOWN), n_hidden
        if seen == HIDDEN:
            n_hidden += 1
        else:
            twice += twice_piece
            store_piece(t, corners, n, view.work.kept)
    return twice, n_hidden


@part_with_arrays
def measure_by_cells(t, crossings, partners, view, pieces):
    """Find the visible area of a face; False where it is left to half planes."""
    state, kept = view.projected.state, view.work.kept
    n_crossings = order_crossings(t, crossings, view.work.levels)
    is_crossed = state[t] & CROSSED != 0
    if state[t] & UNFIT or n_crossings > MOST_CROSSINGS:
        return False
    if is_crossed and n_crossings == 0 and not state[t] & IN_CONTACT:
        return False
    view.visible[t] = 0.0
    n, n_own = take_target(t, view)
    if n < 3 or is_hidden_by_one(t, n, view):
        return True
    error, count, twice, n_hidden = view.area_error[t], np.int64(NOT_KNOWN), 0.0, 0
    n_kept, n_kept_corners = kept.used[0], kept.used[1]
    n_lines = list_intersections(t, n, n_own, partners, view)
    if n_lines >= 0:
        count = divide_target(t, n, n_crossings, n_lines, crossings, view, pieces)
    if count >= 0:
        twice, n_hidden = sum_cells(t, count, error, view, pieces)
    if count < 0 or twice < 0 or (not is_crossed and n_hidden > 0 and twice > 0):
        drop_pieces(kept, n_kept, n_kept_corners)
        return False
    settle_area(t, twice / 2, view, n_kept, n_kept_corners)
    return True


@allocation_free
def arrangement_areas(targets, crossings, partners, view, pieces, left):
    """Visible areas of faces; returns how many are left to half planes.

    Parameters
    ----------
    targets : (N,) int32
        Crossed faces, and faces that decide over their regions.
    crossings : Crossings
    partners : Partners
        Faces in contact with each.
    view : View
        Out: as of `exact_half_plane.visible_areas`. `work.kept` may be too small: call again with
        more.
    pieces : Pieces
        Scratch, `MOST_CELLS` or more.
    left : (N,) int32
        Out: faces that are left to half planes.
    """
    n_left = 0
    for index in range(targets.shape[0]):
        if not measure_by_cells(targets[index], crossings, partners, view, pieces):
            left[n_left] = targets[index]
            n_left += 1
    return n_left
