"""The loops of the certificate, compiled by numba: where visibility cannot change.

They stand in one file because numba keeps what it compiled by file: a loop that calls into another
file would not notice a change there.

Seen from the camera, the surfaces in front of a point change only across edges that do not have one
face on either side: contour edges, borders, edges of more than two faces, and the rims where the
near plane cuts. `find_jumps` finds these edges, `mark_crossed` the faces that one of them crosses
in the image, at or before the face. What is left falls into patches, faces joined by edges that no
such edge separates: of a patch all is seen or nothing. `find_patches` gathers them.

A. Appel. The Notion of Quantitative Invisibility and the Machine Rendering of Solids. 1967.
"""

import numpy as np

from rastercov._jit import compiled

TIE = 1e-10
"""As in `analytic_kernels`: relative difference of 1/z up to which two surfaces count as one."""
LIVE, CUT, PARTLY = 1, 2, 4
"""As in `analytic_kernels`."""
CROSSED = 8
"""Bit of a face's state: visibility may change within it."""
DOUBTFUL, THIN = 16, 32
"""As in `analytic_kernels`."""
RIM = 1e-6
"""Relative difference of 1/z up to which a corner counts as one on the near plane."""
MANY = 2
"""`edge_turn` of an edge that has more than two faces: always a jump."""


@compiled
def find_jumps(edge_faces, edge_turn, side, state, is_jump, jumps):
    """Edges whose two sides in the image may have different numbers of faces; how many there are.

    So has each edge of a face that is seen edge-on to rounding, and of one that holds the camera
    centre: which side of it is seen is not known.

    Parameters
    ----------
    edge_faces : (E, 2) int32
        Faces of each edge, the second -1 where there is none.
    edge_turn : (E,) int8
        1 where the two faces run along the edge in opposite directions, -1 where in the same,
        `MANY` where there are more than two.
    side : (F,) int8
        1 for a face seen from the front, -1 from behind, 0 for one that does not count.
    state : (F,) uint8
        As `analytic_kernels.set_up` left it.
    is_jump : (E,) bool
        Out.
    jumps : (E,) int32
        Out: the indices of the first so many.
    """
    n = 0
    for e in range(edge_faces.shape[0]):
        first, second = side[edge_faces[e, 0]], 0
        flags = state[edge_faces[e, 0]]
        if edge_faces[e, 1] >= 0:
            second = side[edge_faces[e, 1]]
            flags |= state[edge_faces[e, 1]]
        jump = first != second if edge_turn[e] == 1 else first != -second
        if edge_turn[e] == MANY or flags & DOUBTFUL:
            jump = True
        is_jump[e] = jump
        if jump:
            jumps[n] = e
            n += 1
    return n


@compiled
def mark_unfit(
    jumps, n_jumps, edge_vertices, faces, state, box, area, in_contact, thinnest, is_at_jump
):
    """Mark the live faces that are not to be certified, whether an edge crosses them or not.

    Those that are cut in space, in contact with another, or as thin as a line; and those that the
    image border cuts where a jump ends at one of their corners. There the face may be folded onto
    another one so that inside the image, but not beyond it, both are at one depth.

    Parameters
    ----------
    jumps, n_jumps, edge_vertices, faces
        As for `mark_crossed`.
    state, box, area
        As `analytic_kernels.set_up` left them; `CROSSED` is added to the state.
    in_contact : (F,) bool
        Faces that another one touches or cuts.
    thinnest : float
        Width in pixels below which rounding may decide on which side of a face an edge runs.
    is_at_jump : (V,) bool
        Scratch.
    """
    is_at_jump[:] = False
    for index in range(n_jumps):
        is_at_jump[edge_vertices[jumps[index], 0]] = True
        is_at_jump[edge_vertices[jumps[index], 1]] = True
    for f in range(state.shape[0]):
        if state[f] & LIVE:
            sides = box[f, 1] - box[f, 0] + box[f, 3] - box[f, 2]
            unfit = state[f] & CUT or in_contact[f] or area[f] < thinnest * sides
            if state[f] & PARTLY and not unfit:
                unfit = (
                    is_at_jump[faces[f, 0]] or is_at_jump[faces[f, 1]] or is_at_jump[faces[f, 2]]
                )
            if unfit:
                state[f] |= CROSSED
        elif state[f] & THIN:
            state[f] |= CROSSED  # so that its bound is worked out


@compiled
def cell(position, origin, per_cell, n):
    """As in `analytic_kernels`."""
    return min(max(np.int64((position - origin) * per_cell), 0), n - 1)


@compiled
def narrowed(start, end, low, high, first, last):
    """The part of first ... last where a coordinate that runs from start to end is in low ... high.

    Empty, with the first above the last, where there is none.
    """
    step = end - start
    if step == 0:
        return (first, last) if low <= start <= high else (1.0, 0.0)
    enters, leaves = (low - start) / step, (high - start) / step
    return max(first, min(enters, leaves)), min(last, max(enters, leaves))


@compiled
def crosses(f, a, b, segment, slack, faces, uvw, side, box):
    """Whether a segment of the image crosses a face at or before its depth.

    Parameters
    ----------
    f : int
        The face, not cut in space.
    a, b : int
        Vertices at the two ends, -1 for an end that is none.
    segment : (6,) float64
        u, v, 1/z of both ends.
    slack : float
        Pixels by which the face is grown.
    """
    u0, v0, w0 = segment[0], segment[1], segment[2]
    u1, v1, w1 = segment[3], segment[4], segment[5]
    second, third = (1, 2) if side[f] < 0 else (2, 1)
    i, j, k = faces[f, 0], faces[f, second], faces[f, third]
    du, dv = u1 - u0, v1 - v0
    reach = slack * (abs(du) + abs(dv))
    x0, y0 = uvw[i, 0], uvw[i, 1]
    x1, y1 = uvw[j, 0], uvw[j, 1]
    x2, y2 = uvw[k, 0], uvw[k, 1]
    s0 = du * (y0 - v0) - dv * (x0 - u0)
    s1 = du * (y1 - v0) - dv * (x1 - u0)
    s2 = du * (y2 - v0) - dv * (x2 - u0)
    if (s0 > reach and s1 > reach and s2 > reach) or (s0 < -reach and s1 < -reach and s2 < -reach):
        return False
    has_a = a >= 0 and a in (i, j, k)
    has_b = b >= 0 and b in (i, j, k)
    if has_a and has_b:  # its own edge
        return False
    # The part of the segment within the face, which is grown by the slack on each side. A segment
    # that starts at a corner of the face goes by the two sides there: it is within if its far end
    # is within their wedge.
    first, last = 0.0, 1.0
    corner = a if has_a else b if has_b else np.int64(-1)
    for s in range(3):
        if s == 0:
            p, q, x, y, dx, dy = i, j, x0, y0, x1 - x0, y1 - y0
        elif s == 1:
            p, q, x, y, dx, dy = j, k, x1, y1, x2 - x1, y2 - y1
        else:
            p, q, x, y, dx, dy = k, i, x2, y2, x0 - x2, y0 - y2
        margin = slack * (abs(dx) + abs(dy))
        start = dx * (v0 - y) - dy * (u0 - x) + margin
        end = dx * (v1 - y) - dy * (u1 - x) + margin
        if corner in (p, q):
            if (end if has_a else start) < 0:
                return False
            continue
        if start < 0 and end < 0:
            return False
        if start < 0:
            first = max(first, start / (start - end))
        elif end < 0:
            last = min(last, start / (start - end))
    if first > last:
        return False
    # 1/z is affine on both, so its difference is greatest at an end.
    w = uvw[i, 2]
    wa, wb = uvw[j, 2] - w, uvw[k, 2] - w
    ua, va, ub, vb = x1 - x0, y1 - y0, x2 - x0, y2 - y0
    twice = ua * vb - ub * va
    gu, gv = (wa * vb - wb * va) / twice, (ua * wb - ub * wa) / twice
    tie = TIE * box[f, 5]
    if not has_a:
        its = w0 + first * (w1 - w0)
        mine = w + gu * (u0 + first * du - x0) + gv * (v0 + first * dv - y0)
        if its >= mine - tie:
            return True
    if not has_b:
        its = w0 + last * (w1 - w0)
        mine = w + gu * (u0 + last * du - x0) + gv * (v0 + last * dv - y0)
        if its >= mine - tie:
            return True
    return False


@compiled
def mark_segment(
    a, b, segment, slack, faces, uvw, side, state, box, grid, columns, rows, starts, listed, region
):
    """Mark the live faces that a segment of the image crosses, by the cells it runs through."""
    u, v, du, dv = segment[0], segment[1], segment[3] - segment[0], segment[4] - segment[1]
    t0, t1 = narrowed(u, segment[3], region[0] - slack, region[1] + slack, 0.0, 1.0)
    t0, t1 = narrowed(v, segment[4], region[2] - slack, region[3] + slack, t0, t1)
    if t0 > t1:
        return
    ua, ub, va, vb = u + t0 * du, u + t1 * du, v + t0 * dv, v + t1 * dv
    low_u, high_u = min(ua, ub) - slack, max(ua, ub) + slack
    low_v, high_v = min(va, vb) - slack, max(va, vb) + slack
    front = max(segment[2], segment[5])
    top = cell(low_v, grid[1], grid[3], rows)
    bottom = cell(high_v, grid[1], grid[3], rows)
    for row in range(top, bottom + 1):
        # Where the segment runs while it is in this row, a slack wider.
        left, right = low_u, high_u
        if top < bottom:
            upper, lower = grid[1] + row / grid[3] - slack, grid[1] + (row + 1) / grid[3] + slack
            enters = min(max((upper - va) / (vb - va), 0.0), 1.0)
            leaves = min(max((lower - va) / (vb - va), 0.0), 1.0)
            at, to = ua + enters * (ub - ua), ua + leaves * (ub - ua)
            left, right = min(at, to) - 2 * slack, max(at, to) + 2 * slack
        first = cell(left, grid[0], grid[2], columns)
        last = cell(right, grid[0], grid[2], columns)
        for c in range(row * columns + first, row * columns + last + 1):
            for entry in range(starts[c], starts[c + 1]):
                f = listed[entry]
                if (
                    state[f] & (LIVE | CROSSED) != LIVE
                    or box[f, 0] > high_u
                    or box[f, 1] < low_u
                    or box[f, 2] > high_v
                    or box[f, 3] < low_v
                    or front < box[f, 4] * (1 - 2 * TIE)
                ):
                    continue
                if crosses(f, a, b, segment, slack, faces, uvw, side, box):
                    state[f] |= CROSSED


@compiled
def bring_into_view(a, b, vertices, rotation, eye, lens, near, pyramid, segment, ends):
    """Image of an edge that reaches before the near plane or far out; False where nothing is left.

    Parameters
    ----------
    a, b : int
        Its vertices.
    vertices, rotation, eye, lens, near, pyramid
        As for `analytic_kernels.project`.
    segment : (6,) float64
        Out: u, v, 1/z of both ends.
    ends : (2,) int64
        Out: a and b, -1 where the end was cut off.
    """
    p, q = np.empty(3), np.empty(3)
    for k in range(3):
        p[k] = q[k] = 0.0
        for i in range(3):
            p[k] += (vertices[a, i] - eye[i]) * rotation[i, k]
            q[k] += (vertices[b, i] - eye[i]) * rotation[i, k]
    first, last = 0.0, 1.0
    for s in range(5):
        if s == 0:
            start, end = p[2] - near, q[2] - near
        elif s == 1:
            start = lens[0] * p[0] + (lens[2] - pyramid[0]) * p[2]
            end = lens[0] * q[0] + (lens[2] - pyramid[0]) * q[2]
        elif s == 2:
            start = -lens[0] * p[0] + (pyramid[1] - lens[2]) * p[2]
            end = -lens[0] * q[0] + (pyramid[1] - lens[2]) * q[2]
        elif s == 3:
            start = lens[1] * p[1] + (lens[3] - pyramid[2]) * p[2]
            end = lens[1] * q[1] + (lens[3] - pyramid[2]) * q[2]
        else:
            start = -lens[1] * p[1] + (pyramid[3] - lens[3]) * p[2]
            end = -lens[1] * q[1] + (pyramid[3] - lens[3]) * q[2]
        if start < 0 and end < 0:
            return False
        if start < 0:
            first = max(first, start / (start - end))
        elif end < 0:
            last = min(last, start / (start - end))
    if first > last:
        return False
    ends[0] = a if first == 0 else -1
    ends[1] = b if last == 1 else -1
    for end in range(2):
        t = first if end == 0 else last
        z = max(p[2] + t * (q[2] - p[2]), near)
        segment[3 * end] = lens[0] * ((p[0] + t * (q[0] - p[0])) / z) + lens[2]
        segment[3 * end + 1] = lens[1] * ((p[1] + t * (q[1] - p[1])) / z) + lens[3]
        segment[3 * end + 2] = 1.0 / z
    return True


@compiled
def mark_crossed(
    jumps, n_jumps, edge_vertices, vertices, faces, rotation, eye, lens, near, pyramid, uvw, side,
    state, box, slot, polygons, n_corners, planes, grid, columns, rows, starts, listed, region,
    slack, has_cuts,
):  # fmt: skip
    """Mark the live faces that a jump crosses, or the rim of a face cut by the near plane.

    Parameters
    ----------
    jumps, n_jumps
        As `find_jumps` left them.
    edge_vertices : (E, 2) int32
        Vertices of each edge.
    vertices ... region
        As for `analytic_kernels`.
    slack : float
        Pixels within which an edge that passes a face counts as crossing it.
    has_cuts : bool
        Whether any face is cut in space.
    """
    segment, ends = np.empty(6), np.empty(2, np.int64)
    for index in range(n_jumps):
        a, b = edge_vertices[jumps[index], 0], edge_vertices[jumps[index], 1]
        if uvw[a, 2] > 0 and uvw[b, 2] > 0:
            ends[0], ends[1] = a, b
            for k in range(3):
                segment[k], segment[3 + k] = uvw[a, k], uvw[b, k]
        elif not bring_into_view(a, b, vertices, rotation, eye, lens, near, pyramid, segment, ends):
            continue
        mark_segment(
            ends[0], ends[1], segment, slack, faces, uvw, side, state, box, grid, columns, rows,
            starts, listed, region,
        )  # fmt: skip
    if not has_cuts:
        return
    rim = (1 - RIM) / near
    ends[0] = ends[1] = -1
    for f in range(state.shape[0]):
        if not (state[f] & LIVE and state[f] & CUT):
            continue
        s = slot[f]
        for p in range(n_corners[s]):
            q = p + 1 if p + 1 < n_corners[s] else 0
            for end in range(2):
                corner = p if end == 0 else q
                u, v = polygons[s, corner, 0], polygons[s, corner, 1]
                w = (
                    planes[s, 2]
                    + planes[s, 3] * (u - planes[s, 0])
                    + planes[s, 4] * (v - planes[s, 1])
                )
                # As near as it may be: 1/z of a face that all but holds the camera centre is known
                # to few digits.
                w = min(w + planes[s, 5], 1 / near)
                segment[3 * end], segment[3 * end + 1], segment[3 * end + 2] = u, v, w
            if segment[2] >= rim and segment[5] >= rim:
                mark_segment(
                    ends[0], ends[1], segment, slack, faces, uvw, side, state, box, grid, columns,
                    rows, starts, listed, region,
                )  # fmt: skip


@compiled
def is_inside(point, size):
    """Whether a vertex, by its row of `uvw`, lies in the image."""
    u, v = point[0], point[1]
    return point[2] > 0 and 0 <= u <= size[0] and 0 <= v <= size[1]


@compiled
def find_patches(
    face_edges, edge_faces, edge_turn, edge_vertices, is_jump, uvw, size, state, area, patch,
    queue, targets,
):  # fmt: skip
    """Gather what is left into patches; how many faces are crossed, and how many patches there are.

    Parameters
    ----------
    face_edges : (F, 3) int32
        Edges of each face.
    edge_faces, edge_turn, edge_vertices, is_jump
        As for `find_jumps` and `mark_crossed`.
    uvw, size, state, area
        As for `analytic_kernels`; `CROSSED` is in the state.
    patch : (F,) int32
        Out: number of each face's patch, -1 for faces in none.
    queue : (F,) int32
        Scratch.
    targets : (F,) int32
        Out: the crossed faces, and after them the largest face of each patch.
    """
    n_crossed = 0
    for f in range(state.shape[0]):
        patch[f] = -1
        if state[f] & CROSSED:
            targets[n_crossed] = f
            n_crossed += 1
    n = 0
    for seed in range(state.shape[0]):
        if not state[seed] & LIVE or state[seed] & CROSSED or patch[seed] >= 0:
            continue
        queue[0], head, tail, largest = seed, 0, 1, seed
        patch[seed] = n
        while head < tail:
            f = queue[head]
            head += 1
            if area[f] > area[largest]:
                largest = f
            for corner in range(3):
                e = face_edges[f, corner]
                if is_jump[e] or edge_turn[e] == MANY:
                    continue
                g = edge_faces[e, 0] if edge_faces[e, 0] != f else edge_faces[e, 1]
                if g < 0 or patch[g] >= 0 or not state[g] & LIVE or state[g] & CROSSED:
                    continue
                if state[f] & PARTLY and state[g] & PARTLY:
                    # What they share may lie outside the image, where nothing is checked.
                    a, b = edge_vertices[e, 0], edge_vertices[e, 1]
                    if not (is_inside(uvw[a], size) or is_inside(uvw[b], size)):
                        continue
                patch[g] = n
                queue[tail] = g
                tail += 1
        targets[n_crossed + n] = largest
        n += 1
    return n_crossed, n


@compiled
def decide(patch, targets, n_crossed, n_patches, area, visible, doubtful, sure):
    """Give each face of a patch the answer of its largest; how many faces that leaves in doubt.

    Parameters
    ----------
    patch, targets, n_crossed, n_patches
        As `find_patches` left them; faces in doubt leave their patch.
    area : (F,) float64
        px^2 inside the image.
    visible : (F,) float64
        In: of the targets, px^2. Out: of all live faces that are not in doubt.
    doubtful : (F,) int32
        Out: faces of patches whose largest face is neither all visible nor all hidden.
    sure : float
        Part of a face up to which its visible area counts as all or nothing.
    """
    n = 0
    for f in range(patch.shape[0]):
        if patch[f] < 0:
            continue
        largest = targets[n_crossed + patch[f]]
        if visible[largest] >= (1 - sure) * area[largest]:
            visible[f] = area[f]
        elif visible[largest] <= sure * area[largest]:
            visible[f] = 0.0
        else:
            patch[f] = -1
            if f != largest:
                doubtful[n] = f
                n += 1
    return n
