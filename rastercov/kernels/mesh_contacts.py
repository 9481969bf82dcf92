"""Compiled loops that find faces in contact, over the boxes of a `TriangleTree`.

Conservative: a false positive costs time, a false negative would break the certificate.

The tree is traversed without a stack: a node and its descendants are followed by its right sibling,
or by that of its nearest ancestor with one. Each leaf is compared only with leaves to its right.

S. Gottschalk, M. C. Lin, D. Manocha. OBBTree: A Hierarchical Structure for Rapid Interference
Detection. 1996, for separating axes.
T. Akenine-Möller. Fast 3D Triangle-Box Overlap Testing. 2001, for a plane and a box.
"""

import numpy as np

from rastercov.kernels.jit import compiled, part_with_arrays
from rastercov.kernels.mesh_tree import LEAF

LEAST_AXIS_SQUARED = 1e-200
"""Squared length below which a separating axis is not tried."""
STEPS_BEFORE_SLABS = 256
"""Steps through the tree after which boxes are tested against the planes of a leaf's faces, too."""


@compiled
def overlap(boxes, i, others, j, reach):
    """True if two boxes are within `reach` of each other along every axis."""
    f, g = np.uint64(i), np.uint64(j)  # unsigned: no code for negative indices
    x = max(boxes[f, 0] + others[g, 3], others[g, 0] + boxes[f, 3])
    y = max(boxes[f, 1] + others[g, 4], others[g, 1] + boxes[f, 4])
    z = max(boxes[f, 2] + others[g, 5], others[g, 2] + boxes[f, 5])
    return max(x, max(y, z)) <= reach


@part_with_arrays
def dot(points, i, j):
    """Dot product of two rows."""
    return points[i, 0] * points[j, 0] + points[i, 1] * points[j, 1] + points[i, 2] * points[j, 2]


@compiled
def set_cross(points, i, j, k):
    """Set row k to the cross product of rows i and j."""
    points[k, 0] = points[i, 1] * points[j, 2] - points[i, 2] * points[j, 1]
    points[k, 1] = points[i, 2] * points[j, 0] - points[i, 0] * points[j, 2]
    points[k, 2] = points[i, 0] * points[j, 1] - points[i, 1] * points[j, 0]


@compiled
def is_gap(points, axis, reach):
    """True if rows 0-2 are more than `reach` away from rows 3-5 along the axis in row `axis`."""
    length = dot(points, axis, axis)
    if not length > LEAST_AXIS_SQUARED:
        return False
    a, b, c = dot(points, 0, axis), dot(points, 1, axis), dot(points, 2, axis)
    p, q, r = dot(points, 3, axis), dot(points, 4, axis), dot(points, 5, axis)
    gap = max(min(p, min(q, r)) - max(a, max(b, c)), min(a, min(b, c)) - max(p, max(q, r)))
    return gap > reach * np.sqrt(length)


@compiled
def are_apart(points, reach):
    """True if a separating axis proves that two triangles are more than `reach` apart.

    True is correct for any axis, whatever its rounding. False may be wrong where the nearest points
    are two corners: the axes tried underestimate that distance.

    Rows 0-2 and 3-5 of the (15, 3) `points` are the corners of the triangles; a segment is a
    triangle that repeats a corner. The other rows are scratch: edges, normals, and an axis.
    """
    for k in range(3):  # between the centroids: not a necessary axis, but the best first guess
        one = points[0, k] + points[1, k] + points[2, k]
        points[14, k] = points[3, k] + points[4, k] + points[5, k] - one
    if is_gap(points, 14, reach):
        return True
    for start in range(6):
        end = start + 1 if start % 3 < 2 else start - 2
        for k in range(3):
            points[6 + start, k] = points[end, k] - points[start, k]
    for side in range(2):
        normal = 12 + side
        set_cross(points, 6 + 3 * side, 7 + 3 * side, normal)
        if is_gap(points, normal, reach):
            return True
        for edge in range(6, 12):  # in the plane of one triangle, across the edges of both
            set_cross(points, normal, edge, 14)
            if is_gap(points, 14, reach):
                return True
    for edge in range(6, 9):
        for other in range(9, 12):
            set_cross(points, edge, other, 14)
            if is_gap(points, 14, reach):
                return True
    return False


@compiled
def fan_touches(points, reach):
    """True if two triangles with one common corner also meet elsewhere.

    Their intersection is convex and contains that corner, so it ends on the edge of one of them
    opposite the corner. `points`, as in `are_apart`, are relative to the common corner, which is
    row 0 and row 3; they are overwritten.
    """
    # Quick answer, if a plane through the corner separates the triangles:
    for k in range(3):
        points[14, k] = points[4, k] + points[5, k] - points[1, k] - points[2, k]
    length = dot(points, 14, 14)
    above = min(dot(points, 4, 14), dot(points, 5, 14))
    below = max(dot(points, 1, 14), dot(points, 2, 14))
    if length > LEAST_AXIS_SQUARED and min(above, -below) > reach * np.sqrt(length):
        return False
    points[3] = points[4]
    if not are_apart(points, reach):
        return True
    points[3] = 0.0
    points[0] = points[1]
    return not are_apart(points, reach)


@compiled
def fold_touches(points, reach):
    """True if two triangles with a common edge are folded onto each other.

    Projected along the edge they are two segments from one point. The gap between the triangles is
    widest at the lower apex. `points`, as in `are_apart`, are relative to the start of the edge;
    row 1 is its end, rows 2 and 5 are the apexes; they are overwritten.
    """
    length = dot(points, 1, 1)
    if not length > LEAST_AXIS_SQUARED:
        return True
    for apex in (2, 5):  # projected along the edge
        along = dot(points, apex, 1) / length
        for k in range(3):
            points[apex, k] -= along * points[1, k]
    one, other = dot(points, 2, 2), dot(points, 5, 5)
    if min(one, other) <= reach * reach:
        return True
    if dot(points, 2, 5) <= 0.0:
        return False
    set_cross(points, 2, 5, 14)
    return dot(points, 14, 14) <= reach * reach * max(one, other)


@compiled
def touch(vertices, scale, faces, t, m, reach, points):
    """True if two faces come within `reach` of each other, except where they are joined.

    Parameters
    ----------
    vertices : (V, 3) float64
        Original coordinates: the rounding of a shift would bend short edges.
    scale : float
        Inverse of the diagonal of their bounding box.
    faces : (N, 3) int32
        Equal indices for vertices at the same point; three different indices a face.
    reach : float
        As a fraction of that diagonal.
    points : (15, 3) float64
        Scratch.
    """
    shared = at_t = at_m = 0
    for i in range(3):
        for j in range(3):
            if faces[t, i] == faces[m, j]:
                shared += 1
                at_t += i
                at_m += j
    if shared == 3:
        return True
    # Start at a common corner, followed by the second common corner, if any: the apex is last.
    first_t, first_m = at_t, at_m
    if shared == 2:
        first_t, first_m = (4 - at_t) % 3, (4 - at_m) % 3  # after the apex, which is 3 - at
    origin = faces[t, first_t]
    for i in range(3):
        p, q = faces[t, (first_t + i) % 3], faces[m, (first_m + i) % 3]
        for k in range(3):
            points[i, k] = (vertices[p, k] - vertices[origin, k]) * scale
            points[3 + i, k] = (vertices[q, k] - vertices[origin, k]) * scale
    if shared == 0:
        return not are_apart(points, reach)
    if shared == 1:
        return fan_touches(points, reach)
    return fold_touches(points, reach)


@compiled
def set_slab(placed, faces, f, points, slabs, i):
    """Set row i of `slabs`: the normal of a face, its length, and the face's interval along it."""
    for k in range(3):
        for j in range(3):
            points[j, k] = placed[faces[f, j], k]
        points[3, k] = points[1, k] - points[0, k]
        points[4, k] = points[2, k] - points[0, k]
    set_cross(points, 3, 4, 5)
    length = dot(points, 5, 5)
    if not length > LEAST_AXIS_SQUARED:
        points[5] = 0.0
    for k in range(3):
        slabs[i, k] = points[5, k]
    slabs[i, 3] = np.sqrt(length)
    # An interval, not a value: rounding may have rotated the normal of a needle.
    p, q, r = dot(points, 0, 5), dot(points, 1, 5), dot(points, 2, 5)
    slabs[i, 4], slabs[i, 5] = min(p, min(q, r)), max(p, max(q, r))


@compiled
def slab_misses(slabs, i, boxes, j, reach):
    """True if a box is more than `reach` above or below the plane of a face."""
    middle, radius = 0.0, 0.0
    for k in range(3):
        middle += slabs[i, k] * 0.5 * (boxes[j, k] - boxes[j, 3 + k])
        radius -= abs(slabs[i, k]) * 0.5 * (boxes[j, k] + boxes[j, 3 + k])
    gap = max(middle - radius - slabs[i, 5], slabs[i, 4] - middle - radius)
    return gap > reach * slabs[i, 3]


@compiled
def mark(f, marks, done, leaf):
    """Mark a face, and set `done` of each node where it was the last unmarked one."""
    marks[f] = True
    start = (leaf - done.shape[0] // 2) * LEAF
    for other in range(start, min(start + LEAF, marks.shape[0])):
        if not marks[other]:
            return
    done[leaf] = True
    while leaf > 1 and done[leaf ^ 1]:
        leaf >>= 1
        done[leaf] = True


@compiled
def mark_contacts(
    vertices, scale, placed, faces, labels, boxes, nodes, done, reach, first, last, budget, marks
):
    """Mark the faces in contact, for pairs whose first leaf is in a range.

    Other threads may work on other ranges: a mark seen late costs time, nothing else.

    Parameters
    ----------
    vertices, scale, reach
        See `touch`.
    placed, faces, boxes, nodes
        A `TriangleTree` in a scene of diagonal 1: points, faces, boxes, nodes.
    labels : (N,) or (0,) int32
        Faces with different labels are never in contact; empty for no labels.
    done : (2 L,) bool
        Nodes without an unmarked face; updated.
    first, last, budget : int
        Range of leaves, and the number of steps through the tree after which to return early: with
        the leaf to continue from, which is `last` when the range is finished.
    marks : (N,) bool
        Out: True for faces in contact; others are not changed.
    """
    leaves = nodes.shape[0] // 2
    n = faces.shape[0]
    points = np.empty((15, 3))
    slabs = np.empty((LEAF, 6))
    spent = 0
    for leaf in range(first, last):
        if spent > budget:
            return leaf
        start, end = leaf * LEAF, min((leaf + 1) * LEAF, n)
        here = node = leaves + leaf
        steps = 0
        while node != 1:
            steps += 1
            if steps == STEPS_BEFORE_SLABS:  # a large face among small ones, or a slanted face
                for t in range(start, end):
                    set_slab(placed, faces, t, points, slabs, t - start)
            while overlap(nodes, here, nodes, node, reach) and not (done[here] and done[node]):
                if node < leaves:
                    node *= 2
                    continue
                other, other_end = (node - leaves) * LEAF, min((node - leaves + 1) * LEAF, n)
                for t in range(start, end):
                    if not overlap(boxes, t, nodes, node, reach):
                        continue
                    if steps >= STEPS_BEFORE_SLABS and slab_misses(
                        slabs, t - start, nodes, node, reach
                    ):
                        continue
                    for m in range(max(other, t + 1), other_end):
                        if (
                            overlap(boxes, t, boxes, m, reach)
                            and not (marks[t] and marks[m])
                            and (labels.shape[0] == 0 or labels[t] == labels[m])
                            and touch(vertices, scale, faces, t, m, reach, points)
                        ):
                            mark(t, marks, done, here)
                            mark(m, marks, done, node)
                break
            node += 1
            while node & 1 == 0:
                node >>= 1
        spent += steps
    return last


@compiled
def list_contacts(vertices, scale, faces, boxes, nodes, reach, pairs):
    """List all pairs of faces in contact; returns their number, or one more than there is room for.

    Parameters
    ----------
    vertices, scale, faces, boxes, nodes, reach
        As for `mark_contacts`.
    pairs : (N, 2) int32
        Out: rows of `faces`, the lower first.
    """
    leaves, n_faces, n = nodes.shape[0] // 2, faces.shape[0], 0
    points = np.empty((15, 3))
    for t in range(n_faces):
        node = leaves + t // LEAF
        while node != 1:
            while overlap(boxes, t, nodes, node, reach):
                if node < leaves:
                    node *= 2
                    continue
                start = (node - leaves) * LEAF
                for m in range(max(start, t + 1), min(start + LEAF, n_faces)):
                    if overlap(boxes, t, boxes, m, reach) and touch(
                        vertices, scale, faces, t, m, reach, points
                    ):
                        if n == pairs.shape[0]:
                            return n + 1
                        pairs[n, 0], pairs[n, 1] = t, m
                        n += 1
                break
            node += 1
            while node & 1 == 0:
                node >>= 1
    return n
