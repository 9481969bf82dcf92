"""The visibility certificate, compiled by numba: regions where visibility cannot change.

`find_event_edges` finds the event edges, `mark_crossed` the faces that one of them crosses in the
image, at or before the face. The remaining faces form regions, joined by edges that are no event
edges: a region is wholly visible or wholly hidden. `find_regions` collects them. See `certificate`.

A. Appel. The Notion of Quantitative Invisibility and the Machine Rendering of Solids. 1967.
"""

import numpy as np

from rastercov._jit import allocation_free, inlined, part_of
from rastercov.exact.grid_kernels import cell
from rastercov.exact.polygon_kernels import line_value
from rastercov.exact.records import (
    CLIPPED,
    CONSISTENT,
    CROSSED,
    DEPTH_TIE_REL,
    DOUBTFUL,
    LIVE,
    NON_MANIFOLD,
    PARTLY,
    SLOPE_U,
    SLOPE_V,
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

    Out: `is_event`, (E,) bool, and their indices in `events`, (E,) int32. Returns their number.
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
    projected : Projected
        `CROSSED` is added to the state.
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
                state[f] |= CROSSED
        elif state[f] & THIN:
            state[f] |= CROSSED  # so that its area error is computed


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
def narrowed_to_inside(start, end, first, last):
    """Part of the range first ... last where a value that runs from `start` to `end` is >= 0."""
    if start < 0 and end < 0:
        return 1.0, 0.0
    if start < 0:
        first = max(first, start / (start - end))
    elif end < 0:
        last = min(last, start / (start - end))
    return first, last


@inlined
def crosses(f, a, b, segment, tolerance, projected):
    """True if a segment of the image crosses a face at or before its depth.

    The face f is not clipped in space, and is grown by the tolerance, pixels. `segment` has
    u, v, w of both ends, a and b their vertices, or `NO_VERTEX`.
    """
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
        return False
    has_a = a >= 0 and a in (i, j, k)
    has_b = b >= 0 and b in (i, j, k)
    if has_a and has_b:  # its own edge
        return False
    # The part of the segment within the face grown by the tolerance. For a segment that starts at a
    # corner of the face the two sides there are not tested by distance: it is within if its far end
    # is within their wedge.
    first, last = 0.0, 1.0
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
                return False
            continue
        first, last = narrowed_to_inside(start, end, first, last)
        if first > last:
            return False
    # w is affine on both, so its difference is greatest at an end.
    w = uvw[i, W]
    wa, wb = uvw[j, W] - w, uvw[k, W] - w
    ua, va, ub, vb = uj - ui, vj - vi, uk - ui, vk - vi
    twice = ua * vb - ub * va
    slope_u, slope_v = (wa * vb - wb * va) / twice, (ua * wb - ub * wa) / twice
    tie = DEPTH_TIE_REL * projected.box[f, W_MAX]
    if not has_a:
        its = w0 + first * (w1 - w0)
        mine = w + slope_u * (u0 + first * du - ui) + slope_v * (v0 + first * dv - vi)
        if its >= mine - tie:
            return True
    if not has_b:
        its = w0 + last * (w1 - w0)
        mine = w + slope_u * (u0 + last * du - ui) + slope_v * (v0 + last * dv - vi)
        if its >= mine - tie:
            return True
    return False


@inlined
def mark_segment(a, b, segment, tolerance, projected, grid, extent):
    """Mark the live faces that a segment of the image crosses, by the cells it runs through."""
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
        return
    ua, ub, va, vb = u + t0 * du, u + t1 * du, v + t0 * dv, v + t1 * dv
    low_u, high_u = min(ua, ub) - tolerance, max(ua, ub) + tolerance
    low_v, high_v = min(va, vb) - tolerance, max(va, vb) + tolerance
    nearest = max(segment[START, W], segment[END, W])
    top = cell(low_v, grid.top, grid.per_v, grid.rows)
    bottom = cell(high_v, grid.top, grid.per_v, grid.rows)
    for row in range(top, bottom + 1):
        # Range of u while the segment is in this row, which is widened by the tolerance.
        left, right = low_u, high_u
        if top < bottom:
            upper = grid.top + row / grid.per_v - tolerance
            lower = grid.top + (row + 1) / grid.per_v + tolerance
            enters = min(max((upper - va) / (vb - va), 0.0), 1.0)
            leaves = min(max((lower - va) / (vb - va), 0.0), 1.0)
            at, to = ua + enters * (ub - ua), ua + leaves * (ub - ua)
            left, right = min(at, to) - 2 * tolerance, max(at, to) + 2 * tolerance
        first = cell(left, grid.left, grid.per_u, grid.columns)
        last = cell(right, grid.left, grid.per_u, grid.columns)
        for c in range(row * grid.columns + first, row * grid.columns + last + 1):
            for entry in range(starts[c], starts[c + 1]):
                f = entries[entry]
                if (
                    state[f] & (LIVE | CROSSED) != LIVE
                    or box[f, U_MIN] > high_u
                    or box[f, U_MAX] < low_u
                    or box[f, V_MIN] > high_v
                    or box[f, V_MAX] < low_v
                    or nearest < box[f, W_MIN] * (1 - 2 * DEPTH_TIE_REL)
                ):
                    continue
                if crosses(f, a, b, segment, tolerance, projected):
                    state[f] |= CROSSED


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
    events, edges, vertices, camera, projected, grid, extent, tolerance, has_clipped, segment
):
    """Mark the live faces crossed by an event edge or by the rim of a face at the near plane.

    Parameters
    ----------
    events : (N,) int32
        Event edges.
    vertices : (V, 3) float64
    projected : Projected
        `CROSSED` is added to the state.
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
    for index in range(events.shape[0]):
        a, b = edges.vertices[events[index], 0], edges.vertices[events[index], 1]
        if uvw[a, W] > 0 and uvw[b, W] > 0:
            ends[START], ends[END] = a, b
            for k in range(3):
                uvw_of_ends[START, k], uvw_of_ends[END, k] = uvw[a, k], uvw[b, k]
        elif not project_clipped(a, b, vertices, camera, segment):
            continue
        mark_segment(ends[START], ends[END], uvw_of_ends, tolerance, projected, grid, extent)
    if not has_clipped:
        return
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
                mark_segment(
                    ends[START], ends[END], uvw_of_ends, tolerance, projected, grid, extent
                )


@part_of
def is_inside(u, v, w, width, height):
    """True if a projected vertex lies in the image."""
    return w > 0 and 0 <= u <= width and 0 <= v <= height


@allocation_free
def find_regions(edges, is_event, camera, projected, region, queue, targets):
    """Collect the faces that are not `CROSSED` into regions; number of crossed faces, of regions.

    Parameters
    ----------
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
