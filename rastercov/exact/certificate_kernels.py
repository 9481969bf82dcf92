"""The visibility certificate, compiled by numba: regions where visibility cannot change.

Seen from the camera, the set of surfaces in front of a point changes only across event edges:
silhouette edges, borders, edges of more than two faces, and the rims where the near plane clips.
`find_event_edges` finds them, `mark_crossed` the faces that one of them crosses in the image, at or
before the face. The remaining faces form regions, joined by edges that are no event edges: a region
is wholly visible or wholly hidden. `find_regions` collects them.

A. Appel. The Notion of Quantitative Invisibility and the Machine Rendering of Solids. 1967.
"""

import numpy as np

from rastercov._jit import allocation_free, inlined, part_of
from rastercov.exact.grid_kernels import cell, sort_cell
from rastercov.exact.half_plane_kernels import is_joined, outline, outline_error, plane_of
from rastercov.exact.polygon_kernels import line_at, line_value
from rastercov.exact.records import (
    CLIPPED,
    CONSISTENT,
    CROSSED,
    DEPTH_TIE_REL,
    DOUBTFUL,
    DU,
    DV,
    LIVE,
    NON_MANIFOLD,
    PARTLY,
    SLOPE_U,
    SLOPE_V,
    THIN,
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

NEAR_PLANE_TOLERANCE_REL = 1e-6
"""Relative difference of 1/z up to which a corner counts as one on the near plane."""
START, END = 0, 1
"""Rows of a segment, which has u, v and w of both ends."""
NO_VERTEX = -1
"""End of a segment that is no vertex of the surface."""


@allocation_free
def find_event_edges(edges, projected, is_event, events):
    """Find the edges whose two sides in the image may have different numbers of faces.

    They include each edge of a face that is seen edge-on up to rounding, and of one that contains
    the camera centre: the visible side of it is unknown.

    Parameters
    ----------
    edges, projected
        Edges and Projected.
    is_event : (E,) bool
        Out.
    events : (E,) int32
        Out: indices of the event edges.

    Returns
    -------
    int
        Number of event edges.
    """
    edge_faces, kind, side, state = edges.faces, edges.kind, projected.side, projected.state
    n = 0
    for e in range(edge_faces.shape[0]):
        first, second = side[edge_faces[e, 0]], 0
        flags = state[edge_faces[e, 0]]
        if edge_faces[e, 1] >= 0:
            second = side[edge_faces[e, 1]]
            flags |= state[edge_faces[e, 1]]
        event = first != second if kind[e] == CONSISTENT else first != -second
        if kind[e] == NON_MANIFOLD or flags & DOUBTFUL:
            event = True
        is_event[e] = event
        if event:
            events[n] = e
            n += 1
    return n


@allocation_free
def mark_uncertifiable(events, edges, projected, in_contact, thinnest, is_at_event):
    """Mark the live faces that cannot be certified, whether an edge crosses them or not.

    These are faces that are clipped in space, in contact with another, or as thin as a line; and
    faces across the image border with a corner on an event edge. There the face may be folded onto
    another one so that inside the image, but not beyond it, both have the same depth.

    Parameters
    ----------
    events : (N,) int32
        Event edges.
    edges, projected
        Edges and Projected; `CROSSED` is added to the state.
    in_contact : (F,) bool
        Faces that another one touches or cuts.
    thinnest : float
        Width in pixels below which rounding may decide on which side of a face an edge runs.
    is_at_event : (V,) bool
        Scratch.
    """
    faces, state, box, area = projected.faces, projected.state, projected.box, projected.area
    is_at_event[:] = False
    for index in range(events.shape[0]):
        is_at_event[edges.vertices[events[index], 0]] = True
        is_at_event[edges.vertices[events[index], 1]] = True
    for f in range(state.shape[0]):
        if state[f] & LIVE:
            extent = box[f, U_MAX] - box[f, U_MIN] + box[f, V_MAX] - box[f, V_MIN]
            unfit = state[f] & CLIPPED or in_contact[f] or area[f] < thinnest * extent
            if state[f] & PARTLY and not unfit:
                unfit = (
                    is_at_event[faces[f, 0]] or is_at_event[faces[f, 1]] or is_at_event[faces[f, 2]]
                )
            if unfit:
                state[f] |= CROSSED | UNFIT
        elif state[f] & THIN:
            state[f] |= CROSSED | UNFIT  # so that its area error is computed


@inlined
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


@inlined
def crosses(f, a, b, segment, first, last, tolerance, projected):
    """Part of a segment of the image that crosses a face at or before its depth.

    Empty, with the first above the last, if there is none.

    Parameters
    ----------
    f : int
        The face, not clipped in space.
    a, b : int
        Vertices at the two ends, or `NO_VERTEX`.
    segment : (2, 3) float64
        u, v, w of both ends.
    first, last : float
        The part, from 0 at the start to 1 at the end.
    tolerance : float
        Pixels by which the face is grown.
    projected : Projected
    """
    starts_within, ends_within = first > 0, last < 1
    faces, uvw = projected.faces, projected.uvw
    u0, v0, w0 = segment[START, U], segment[START, V], segment[START, W]
    u1, v1, w1 = segment[END, U], segment[END, V], segment[END, W]
    second, third = (1, 2) if projected.side[f] < 0 else (2, 1)
    i, j, k = faces[f, 0], faces[f, second], faces[f, third]
    du, dv = u1 - u0, v1 - v0
    reach = tolerance * (abs(du) + abs(dv))
    ui, vi = uvw[i, U], uvw[i, V]
    uj, vj = uvw[j, U], uvw[j, V]
    uk, vk = uvw[k, U], uvw[k, V]
    line = (u0, v0, du, dv, 0.0)
    si, sj, sk = line_value(line, ui, vi), line_value(line, uj, vj), line_value(line, uk, vk)
    if (si > reach and sj > reach and sk > reach) or (si < -reach and sj < -reach and sk < -reach):
        return 1.0, 0.0
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
        if start < 0 and end < 0:
            return 1.0, 0.0
        if start < 0:
            first = max(first, start / (start - end))
        elif end < 0:
            last = min(last, start / (start - end))
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


@inlined
def hidden_range(
    m, a, b, segment, first, last, tolerance, edges, is_event, camera, projected, work
):
    """Part of a segment of the image that a face certainly hides; empty if the first is the last.

    Parameters
    ----------
    m : int
        The face.
    a, b : int
        Vertices at the two ends of the segment, or `NO_VERTEX`.
    segment : (2, 3) float64
        u, v, w of both ends.
    first, last : float
        Part of the segment that matters.
    tolerance : float
        Pixels by which the face is shrunk along its event edges. Along the others, where the
        surface goes on, it is grown by the rounding of a position.
    edges, is_event, camera, projected, work
        As for `mark_crossed`.
    """
    faces, lines = projected.faces, work.lines
    i, j, k = faces[m, 0], faces[m, 1], faces[m, 2]
    if a in (i, j, k) or b in (i, j, k):  # as near as the segment
        return first, first
    u, v, w = segment[START, U], segment[START, V], segment[START, W]
    u1, v1, w1 = segment[END, U], segment[END, V], segment[END, W]
    _, n_lines = outline(m, projected, work.corners, lines)
    error = outline_error(m, camera, projected)
    for s in range(n_lines):
        goes_on = is_joined(m, s, n_lines, edges, is_event, projected)
        margin = -2 * error if goes_on else 2 * tolerance + error
        line = line_at(lines, s)
        margin *= abs(lines[s, DU]) + abs(lines[s, DV])
        start, end = line_value(line, u, v) - margin, line_value(line, u1, v1) - margin
        if start < 0 and end < 0:
            return first, first
        if start < 0:
            first = max(first, start / (start - end))
        elif end < 0:
            last = min(last, start / (start - end))
    if first >= last:
        return first, first
    u_m, v_m, w_m, slope_u, slope_v, w_error = plane_of(m, camera, projected)
    margin = 2 * w_error + 4 * DEPTH_TIE_REL * projected.box[m, W_MAX]
    start = w_m + slope_u * (u - u_m) + slope_v * (v - v_m) - w - margin
    end = w_m + slope_u * (u1 - u_m) + slope_v * (v1 - v_m) - w1 - margin
    if start < 0 and end < 0:
        return first, first
    if start < 0:
        first = max(first, start / (start - end))
    elif end < 0:
        last = min(last, start / (start - end))
    return first, max(first, last)


@inlined
def take_range(ranges, n, first, last):
    """Take a range out of n ranges; returns how many are left.

    It stays in where there is no room for another range.
    """
    i = 0
    while i < n:
        start, end = ranges[i, 0], ranges[i, 1]
        if last <= start or first >= end:
            i += 1
        elif first <= start and last >= end:
            n -= 1
            ranges[i, 0], ranges[i, 1] = ranges[n, 0], ranges[n, 1]
        elif first <= start:
            ranges[i, 0] = last
            i += 1
        elif last >= end:
            ranges[i, 1] = first
            i += 1
        else:
            if n < ranges.shape[0]:
                ranges[n, 0], ranges[n, 1] = last, end
                ranges[i, 1] = first
                n += 1
            i += 1
    return n


@inlined
def mark_segment(
    a,
    b,
    segment,
    tolerance,
    edges,
    is_event,
    camera,
    projected,
    grid,
    extent,
    work,
    ranges,
    edge,
    is_doubtful,
    crossings,
    n_crossings,
):
    """Mark the live faces that the visible part of a segment crosses, by the cells it runs through.

    Returns true if any of it is visible.
    """
    state, box, starts, entries = projected.state, projected.box, grid.starts, grid.entries
    u, v = segment[START, U], segment[START, V]
    du, dv = segment[END, U] - u, segment[END, V] - v
    t0, t1 = narrowed(
        u, segment[END, U], extent[U_MIN] - tolerance, extent[U_MAX] + tolerance, 0.0, 1.0
    )
    t0, t1 = narrowed(
        v, segment[END, V], extent[V_MIN] - tolerance, extent[V_MAX] + tolerance, t0, t1
    )
    if t0 > t1:
        return False, n_crossings
    ua, ub, va, vb = u + t0 * du, u + t1 * du, v + t0 * dv, v + t1 * dv
    low_u, high_u = min(ua, ub) - tolerance, max(ua, ub) + tolerance
    low_v, high_v = min(va, vb) - tolerance, max(va, vb) + tolerance
    nearest = max(segment[START, W], segment[END, W])
    farthest = min(segment[START, W], segment[END, W])
    top = cell(low_v, grid.top, grid.per_v, grid.rows)
    bottom = cell(high_v, grid.top, grid.per_v, grid.rows)
    is_visible = False
    for row in range(top, bottom + 1):
        # Range of u while the segment is in this row, which is widened by the tolerance.
        left, right = low_u, high_u
        enters_row, leaves_row = t0, t1
        if top < bottom:
            upper = grid.top + row / grid.per_v - tolerance
            lower = grid.top + (row + 1) / grid.per_v + tolerance
            enters = min(max((upper - va) / (vb - va), 0.0), 1.0)
            leaves = min(max((lower - va) / (vb - va), 0.0), 1.0)
            at, to = ua + enters * (ub - ua), ua + leaves * (ub - ua)
            left, right = min(at, to) - 2 * tolerance, max(at, to) + 2 * tolerance
            enters_row = t0 + min(enters, leaves) * (t1 - t0)
            leaves_row = t0 + max(enters, leaves) * (t1 - t0)
        first = cell(left, grid.left, grid.per_u, grid.columns)
        last = cell(right, grid.left, grid.per_u, grid.columns)
        for column in range(first, last + 1):
            c = row * grid.columns + column
            enters, leaves = enters_row, leaves_row
            if first < last:
                cell_left = grid.left + column / grid.per_u - tolerance
                cell_right = grid.left + (column + 1) / grid.per_u + tolerance
                # The first and the last cell hold all that is beyond them.
                enters, leaves = narrowed(
                    u,
                    u + du,
                    cell_left if column > 0 else -np.inf,
                    cell_right if column + 1 < grid.columns else np.inf,
                    enters,
                    leaves,
                )
            if enters > leaves:
                continue
            ranges[0, 0], ranges[0, 1], n = enters, leaves, 1
            least_u = min(u + enters * du, u + leaves * du) - tolerance
            most_u = max(u + enters * du, u + leaves * du) + tolerance
            least_v = min(v + enters * dv, v + leaves * dv) - tolerance
            most_v = max(v + enters * dv, v + leaves * dv) + tolerance
            if not grid.is_sorted[c]:
                sort_cell(c, box, grid)
            for entry in range(starts[c], starts[c + 1]):
                if grid.nearest[entry] < farthest:
                    break
                m = entries[entry]
                if (
                    state[m] & (LIVE | DOUBTFUL) != LIVE
                    or box[m, U_MIN] > most_u
                    or box[m, U_MAX] < least_u
                    or box[m, V_MIN] > most_v
                    or box[m, V_MAX] < least_v
                ):
                    continue
                begin, end = hidden_range(
                    m, a, b, segment, enters, leaves, tolerance, edges, is_event, camera,
                    projected, work,
                )  # fmt: skip
                if begin < end:
                    n = take_range(ranges, n, begin, end)
                    if n == 0:
                        break
            if n == 0:
                continue
            is_visible = True
            for entry in range(starts[c], starts[c + 1]):
                f = entries[entry]
                if (
                    state[f] & (LIVE | UNFIT) != LIVE
                    or box[f, U_MIN] > most_u
                    or box[f, U_MAX] < least_u
                    or box[f, V_MIN] > most_v
                    or box[f, V_MAX] < least_v
                    or nearest < box[f, W_MIN] * (1 - 2 * DEPTH_TIE_REL)
                ):
                    continue
                for i in range(n):
                    begin, end = crosses(
                        f, a, b, segment, ranges[i, 0], ranges[i, 1], tolerance, projected
                    )
                    if begin > end:
                        continue
                    state[f] |= CROSSED
                    if is_doubtful:
                        state[f] |= UNFIT
                        break
                    last_of_face = crossings.last[f]
                    if last_of_face >= 0 and crossings.edge[last_of_face] == edge:
                        row_of_face = last_of_face
                        crossings.segments[row_of_face, 4] = min(
                            crossings.segments[row_of_face, 4], begin
                        )
                        crossings.segments[row_of_face, 5] = max(
                            crossings.segments[row_of_face, 5], end
                        )
                    else:
                        if n_crossings < crossings.edge.shape[0]:
                            crossings.before[n_crossings] = last_of_face
                            crossings.edge[n_crossings] = edge
                            crossings.segments[n_crossings, 0] = u
                            crossings.segments[n_crossings, 1] = v
                            crossings.segments[n_crossings, 2] = du
                            crossings.segments[n_crossings, 3] = dv
                            crossings.segments[n_crossings, 4] = begin
                            crossings.segments[n_crossings, 5] = end
                            crossings.last[f] = n_crossings
                        n_crossings += 1
    return is_visible, n_crossings


@allocation_free
def project_clipped(a, b, vertices, camera, segment):
    """Project an edge that reaches before the near plane or far out; False if nothing is left.

    Parameters
    ----------
    a, b : int
        Its vertices.
    vertices : (V, 3) float64
    camera : Pinhole
    segment : Segment
        Out: `ends` are a and b, `NO_VERTEX` for an end that was clipped.
    """
    p, q, ends, uvw = segment.points[START], segment.points[END], segment.ends, segment.uvw
    for k in range(3):
        p[k] = q[k] = 0.0
        for i in range(3):
            p[k] += (vertices[a, i] - camera.centre[i]) * camera.rotation[i, k]
            q[k] += (vertices[b, i] - camera.centre[i]) * camera.rotation[i, k]
    fx, fy, cx, cy, near = camera.fx, camera.fy, camera.cx, camera.cy, camera.near
    first, last = 0.0, 1.0
    for s in range(5):
        if s == 0:
            start, end = p[2] - near, q[2] - near
        elif s == 1:
            start = fx * p[0] + (cx - camera.u_min) * p[2]
            end = fx * q[0] + (cx - camera.u_min) * q[2]
        elif s == 2:
            start = -fx * p[0] + (camera.u_max - cx) * p[2]
            end = -fx * q[0] + (camera.u_max - cx) * q[2]
        elif s == 3:
            start = fy * p[1] + (cy - camera.v_min) * p[2]
            end = fy * q[1] + (cy - camera.v_min) * q[2]
        else:
            start = -fy * p[1] + (camera.v_max - cy) * p[2]
            end = -fy * q[1] + (camera.v_max - cy) * q[2]
        if start < 0 and end < 0:
            return False
        if start < 0:
            first = max(first, start / (start - end))
        elif end < 0:
            last = min(last, start / (start - end))
    if first > last:
        return False
    ends[START] = a if first == 0 else NO_VERTEX
    ends[END] = b if last == 1 else NO_VERTEX
    for end in range(2):
        t = first if end == START else last
        z = max(p[2] + t * (q[2] - p[2]), near)
        uvw[end, U] = fx * ((p[0] + t * (q[0] - p[0])) / z) + cx
        uvw[end, V] = fy * ((p[1] + t * (q[1] - p[1])) / z) + cy
        uvw[end, W] = 1.0 / z
    return True


@allocation_free
def mark_crossed(
    events,
    edges,
    is_event,
    vertices,
    camera,
    projected,
    grid,
    extent,
    tolerance,
    has_clipped,
    segment,
    work,
    ranges,
    is_hidden,
    crossings,
):
    """Mark the live faces crossed by an event edge or by the rim of a face at the near plane.

    Parameters
    ----------
    events : (N,) int32
        Event edges.
    edges, vertices, camera, projected, grid
        Edges; (V, 3) float64; Pinhole; Projected, with `CROSSED` added to the state; CellGrid.
    extent : (7,) float64
        Of `set_up`.
    tolerance : float
        Pixels within which an edge that passes a face counts as crossing it.
    has_clipped : bool
        Whether any face is clipped in space.
    segment : Segment
        Scratch.
    """
    uvw, state, clipped = projected.uvw, projected.state, projected.clipped
    uvw_of_ends, ends = segment.uvw, segment.ends
    crossings.last[:] = -1
    n_crossings = 0
    for index in range(events.shape[0]):
        a, b = edges.vertices[events[index], 0], edges.vertices[events[index], 1]
        if uvw[a, W] > 0 and uvw[b, W] > 0:
            ends[START], ends[END] = a, b
            for k in range(3):
                uvw_of_ends[START, k], uvw_of_ends[END, k] = uvw[a, k], uvw[b, k]
        elif not project_clipped(a, b, vertices, camera, segment):
            continue
        e = events[index]
        flags = state[edges.faces[e, 0]]
        if edges.faces[e, 1] >= 0:
            flags |= state[edges.faces[e, 1]]
        is_visible, n_crossings = mark_segment(
            ends[START], ends[END], uvw_of_ends, tolerance, edges, is_event, camera, projected,
            grid, extent, work, ranges, e, flags & DOUBTFUL, crossings, n_crossings,
        )  # fmt: skip
        is_hidden[e] = not is_visible
    if not has_clipped:
        return n_crossings
    polygons, planes = clipped.polygons, clipped.planes
    rim = (1 - NEAR_PLANE_TOLERANCE_REL) / camera.near
    ends[START] = ends[END] = NO_VERTEX
    for f in range(state.shape[0]):
        if not (state[f] & LIVE and state[f] & CLIPPED):
            continue
        s = projected.clipped_index[f]
        for p in range(clipped.n_corners[s]):
            q = p + 1 if p + 1 < clipped.n_corners[s] else 0
            for end in range(2):
                corner = p if end == START else q
                u, v = polygons[s, corner, U], polygons[s, corner, V]
                w = (
                    planes[s, W]
                    + planes[s, SLOPE_U] * (u - planes[s, U])
                    + planes[s, SLOPE_V] * (v - planes[s, V])
                )
                # As near as it may be: 1/z of a face that almost contains the camera centre is
                # known to few digits.
                w = min(w + planes[s, W_ERROR], 1 / camera.near)
                uvw_of_ends[end, U], uvw_of_ends[end, V], uvw_of_ends[end, W] = u, v, w
            if uvw_of_ends[START, W] >= rim and uvw_of_ends[END, W] >= rim:
                _, n_crossings = mark_segment(
                    ends[START], ends[END], uvw_of_ends, tolerance, edges, is_event, camera,
                    projected, grid, extent, work, ranges, -1 - f, DOUBTFUL, crossings,
                    n_crossings,
                )  # fmt: skip
    return n_crossings


@part_of
def is_inside(u, v, w, width, height):
    """True if a projected vertex lies in the image."""
    return w > 0 and 0 <= u <= width and 0 <= v <= height


@allocation_free
def find_regions(edges, is_event, camera, projected, region, queue, targets):
    """Collect the uncrossed faces into regions; number of crossed faces, and of regions.

    Parameters
    ----------
    edges, camera, projected
        Edges; Pinhole; Projected, with `CROSSED` in the state.
    is_event : (E,) bool
        Of `find_event_edges`.
    region : (F,) int32
        Out: number of each face's region, -1 for faces in none.
    queue : (F,) int32
        Scratch.
    targets : (F,) int32
        Out: the crossed faces, and after them the largest face of each region.
    """
    uvw, state, area = projected.uvw, projected.state, projected.area
    ends, edge_faces, of_face, kind = edges.vertices, edges.faces, edges.of_face, edges.kind
    width, height = camera.width, camera.height
    n_crossed = 0
    for f in range(state.shape[0]):
        region[f] = -1
        if state[f] & CROSSED:
            targets[n_crossed] = f
            n_crossed += 1
    n = 0
    for seed in range(state.shape[0]):
        if not state[seed] & LIVE or state[seed] & CROSSED or region[seed] >= 0:
            continue
        queue[0], head, tail, largest = seed, 0, 1, seed
        region[seed] = n
        while head < tail:
            f = queue[head]
            head += 1
            if area[f] > area[largest]:
                largest = f
            for corner in range(3):
                e = of_face[f, corner]
                if is_event[e] or kind[e] == NON_MANIFOLD:
                    continue
                g = edge_faces[e, 0] if edge_faces[e, 0] != f else edge_faces[e, 1]
                if g < 0 or region[g] >= 0 or not state[g] & LIVE or state[g] & CROSSED:
                    continue
                if state[f] & PARTLY and state[g] & PARTLY:
                    # Their common edge may lie outside the image, where nothing is checked.
                    a, b = ends[e, 0], ends[e, 1]
                    if not (
                        is_inside(uvw[a, U], uvw[a, V], uvw[a, W], width, height)
                        or is_inside(uvw[b, U], uvw[b, V], uvw[b, W], width, height)
                    ):
                        continue
                region[g] = n
                queue[tail] = g
                tail += 1
        targets[n_crossed + n] = largest
        n += 1
    return n_crossed, n


@allocation_free
def classify_regions(region, largest, area, visible, doubtful, certain):
    """Classify each face of a region like its largest; number of faces that remain in doubt.

    Parameters
    ----------
    region : (F,) int32
        Of `find_regions`; faces in doubt are taken out of their region.
    largest : (N,) int32
        Largest face of each region.
    area : (F,) float64
        px^2 inside the image.
    visible : (F,) float64
        In: of the largest faces, px^2. Out: of all faces of regions that are not in doubt.
    doubtful : (F,) int32
        Out: faces of regions whose largest face is neither wholly visible nor wholly hidden.
    certain : float
        Tolerance of that decision, relative to the area of the largest face.
    """
    n = 0
    for f in range(region.shape[0]):
        if region[f] < 0:
            continue
        t = largest[region[f]]
        if visible[t] >= (1 - certain) * area[t]:
            visible[f] = area[f]
        elif visible[t] <= certain * area[t]:
            visible[f] = 0.0
        else:
            region[f] = -1
            if f != t:
                doubtful[n] = f
                n += 1
    return n
