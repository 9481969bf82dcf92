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
    likely_hider,
)
from rastercov.kernels.exact_half_plane import hides_all
from rastercov.kernels.exact_polygon import (
    clip,
    copy_polygon,
    drop_pieces,
    is_joined,
    line_value,
    n_sides_of,
    outline,
    outline_error,
    plane_of,
    side_of,
    split,
    store_piece,
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
    PARTLY,
    U_MAX,
    U_MIN,
    UNFIT,
    V_MAX,
    V_MIN,
    W_MAX,
    U,
    V,
)
from rastercov.kernels.exact_setup import OUTLINE_ERROR_FACTOR
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


@part_with_arrays
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


@part_with_arrays
def point_visibility(t, u, v, plane, edges, is_event, camera, projected, grid, work):
    """`VISIBLE`, `HIDDEN` or `UNSURE` for a point of a face.

    Parameters
    ----------
    t : int
        The face.
    u, v : float
        The point, pixels.
    plane : tuple
        Of `plane_of` the face.
    edges, is_event, camera, projected, grid, work
        As for `arrangement_areas`.
    """
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
    """Visible areas of faces; returns how many are left to half planes.

    Parameters
    ----------
    targets : (N,) int32
        Crossed faces, and faces that decide over their regions.
    crossings, edges : Crossings, Edges
    partners : Partners
        Faces in contact with each.
    is_event : (E,) bool
        Event edges.
    camera, projected, grid
        Pinhole; Projected; CellGrid.
    pieces, work : Pieces, Work
        Scratch; `MOST_CELLS` pieces or more. `work.kept` may be too small: call again with more.
    visible, area_error : (F,) float64
        Out: as of `exact_half_plane.visible_areas`.
    left : (N,) int32
        Out: faces that are left to half planes.
    """
    state, box, area = projected.state, projected.box, projected.area
    target, border, order, n_left = work.target, camera.border, work.levels, 0
    for index in range(targets.shape[0]):
        t = targets[index]
        n_crossings = order_crossings(t, crossings, order)
        is_crossed = state[t] & CROSSED != 0
        if (
            state[t] & UNFIT
            or n_crossings > MOST_CROSSINGS
            or (is_crossed and n_crossings == 0 and not state[t] & IN_CONTACT)
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
        hider = likely_hider(t, box, grid)
        if hider >= 0 and hides_all(hider, t, target, n, camera, projected, work, area_error):
            continue
        fits, n_lines = True, np.int64(0)
        if state[t] & IN_CONTACT:
            for k in range(partners.starts[t], partners.starts[t + 1]):
                m = partners.faces[k]
                n_lines = add_intersection(
                    t, m, target, n, n_own, n_lines, edges, is_event, camera, projected, work,
                    area_error,
                )  # fmt: skip
                if n_lines == NOT_KNOWN:
                    fits = False
                    break
        if is_crossed:
            copy_polygon(target, n, pieces.corners[0])
            pieces.n_corners[0], count = n, np.int64(1)
        else:
            count = divide_about_centre(target, n, pieces)
        for k in range(n_crossings + n_lines if fits else 0):
            segment = work.intersections[k - n_crossings]
            if k < n_crossings:
                segment = crossings.segments[order[k]]
            area_error[t] += (
                4 * (abs(segment[DU]) + abs(segment[DV])) * (segment[LAST] - segment[FIRST])
                * segment[EDGE_ERROR]
            )  # fmt: skip
            for p in range(count):
                if count == MOST_CELLS:
                    fits = False
                    break
                count = divide_piece(pieces, p, count, segment, work)
        plane = plane_of(t, camera, projected)
        n_kept, n_kept_corners = work.kept.used[0], work.kept.used[1]
        n_hidden, twice = 0, 0.0
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
            seen = point_visibility(t, u, v, plane, edges, is_event, camera, projected, grid, work)
            if seen == UNSURE:
                fits = False
            elif seen == HIDDEN:
                n_hidden += 1
            else:
                twice += twice_piece
                store_piece(t, corners, n, work.kept)
        if not fits or (not is_crossed and n_hidden > 0 and twice > 0):
            drop_pieces(work.kept, n_kept, n_kept_corners)
            left[n_left] = t
            n_left += 1
            continue
        tolerance = camera.pixel_error * (
            box[t, U_MAX] - box[t, U_MIN] + box[t, V_MAX] - box[t, V_MIN]
        )
        seen_area = twice / 2
        if seen_area > tolerance:
            visible[t] = area[t] if seen_area >= area[t] - tolerance else seen_area
        if visible[t] == 0 or visible[t] == area[t]:
            drop_pieces(work.kept, n_kept, n_kept_corners)
    return n_left
