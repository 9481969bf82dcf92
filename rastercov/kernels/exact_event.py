"""Event edges and the faces that they cross, compiled by numba.

Seen from the camera, the set of surfaces in front of a point changes only across event edges:
silhouette edges, borders, edges of more than two faces, and the rims where the near plane clips.
`find_event_edges` finds them. Where a surface hides such an edge from the camera, it hides all that
is behind on both of its sides, so only the visible parts matter: `mark_crossed` finds them, by the
cells of the grid that an edge runs through, and the faces that they cross in the image, at or
before the face.

A. Appel. The Notion of Quantitative Invisibility and the Machine Rendering of Solids. 1967.
"""

import numpy as np

from rastercov.kernels.exact_grid import (
    ENTRIES_AT_A_TIME,
    ask_for_cells,
    cell,
    find_faces,
    lay_bounds,
)
from rastercov.kernels.exact_polygon import length
from rastercov.kernels.exact_records import (
    BLOCK,
    CONSISTENT,
    CORNERS,
    CROSSED,
    DEPTH_TIE_REL,
    DOUBTFUL,
    DU,
    DV,
    EDGE_ERROR,
    FIRST,
    LAST,
    LIVE,
    MIXED,
    NON_MANIFOLD,
    POSITION_ERROR,
    SLOPE_U,
    SLOPE_V,
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
from rastercov.kernels.exact_segment import (
    END,
    IS_VISIBLE,
    NO_EDGE,
    NO_VERTEX,
    START,
    crosses,
    hidden_range,
    narrowed,
    narrowed_to_inside,
    straddles,
    take_range,
)
from rastercov.kernels.jit import allocation_free, part_with_arrays

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
    c, edge, is_doubtful, first, last, segment, ends, tolerance, edges, is_event, camera,
    projected, grid, work, crossings, n_crossings,
):  # fmt: skip
    """Mark the live faces of a cell that the visible parts of a segment there cross.

    first ... last is the part of the segment in cell c. See `mark_segment` for the others; returns
    the number of crossings.
    """
    state, box, found = projected.state, projected.box, grid.found
    ranges, a, b = work.ranges, ends[START], ends[END]
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
            begin, end = hidden_range(
                m, a, b, segment, first, last, tolerance, edges, is_event, camera, projected
            )
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
def mark_segment(
    edge, is_doubtful, segment, tolerance, edges, is_event, camera, projected, grid, extent, work,
    crossings, n_crossings,
):  # fmt: skip
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
    uvw, ends = segment.uvw, segment.ends
    u, v = uvw[START, U], uvw[START, V]
    du, dv = uvw[END, U] - u, uvw[END, V] - v
    t0, t1 = narrowed(u, u + du, extent[U_MIN] - tolerance, extent[U_MAX] + tolerance, 0.0, 1.0)
    t0, t1 = narrowed(v, v + dv, extent[V_MIN] - tolerance, extent[V_MAX] + tolerance, t0, t1)
    ends[IS_VISIBLE] = 1 if t0 > 0 or t1 < 1 else 0
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
                    row * grid.columns + column, edge, is_doubtful, enters, leaves, uvw, ends,
                    tolerance, edges, is_event, camera, projected, grid, work, crossings,
                    n_crossings,
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
            first = cell(left, grid.left, grid.per_u, grid.columns)
            last = cell(right, grid.left, grid.per_u, grid.columns)
            top = cell(upper, grid.top, grid.per_v, grid.rows)
            bottom = cell(lower, grid.top, grid.per_v, grid.rows)
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
    events, edges, is_event, vertices, camera, projected, grid, extent, tolerance, n_clipped,
    segment, work, crossings, is_hidden,
):  # fmt: skip
    """Mark the live faces crossed by a visible part of an event edge or of a rim at the near plane.

    Parameters
    ----------
    events : (N,) int32
        Event edges.
    is_event : (E,) bool
        Of `find_event_edges`.
    vertices : (V, 3) float64
    projected : Projected
        `CROSSED` is added to the states of faces and blocks, and `UNFIT` to those of faces where
        rounding decides what crosses.
    extent : (7,) float64
        Of `set_up`.
    tolerance : float
        Pixels within which an edge that passes a face counts as crossing it.
    n_clipped : int
        Of `set_up`: faces that are clipped in space.
    crossings : Crossings
        In: without a crossing. Out: all of them. `segment` and `work` are scratch.
    is_hidden : (E,) bool
        Out: event edges that faces in front hide from end to end.

    Returns
    -------
    int
        Number of crossings. If it is more than `crossings` has room for, call again with more.
    """
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
            e, is_doubtful, segment, tolerance, edges, is_event, camera, projected, grid, extent,
            work, crossings, n_crossings,
        )  # fmt: skip
        if e >= 0 and not segment.ends[IS_VISIBLE]:
            a, b = edges.vertices[e, 0], edges.vertices[e, 1]
            is_hidden[e] = uvw[a, W] > 0 and uvw[b, W] > 0
    return n_crossings
