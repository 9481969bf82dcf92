"""The loops that find which faces touch, compiled by numba.

They stand in one file because numba keeps what it compiled by file: a loop that calls into another
file would not notice a change there.

The faces stand in the order of a Morton curve. A complete binary tree over that order holds their
boxes: node n has children 2n and 2n + 1, its last row are the leaves, of `LEAF` faces each. It is
walked without a stack: after a node and all below it comes the sibling on its right, or on the
right of its nearest ancestor that has one. Each leaf looks only at those to its right.

G. M. Morton. A Computer Oriented Geodetic Data Base. 1966, for the curve.
S. Gottschalk, M. C. Lin, D. Manocha. OBBTree: A Hierarchical Structure for Rapid Interference
Detection. 1996, for separating axes.
T. Akenine-Möller. Fast 3D Triangle-Box Overlap Testing. 2001, for a plane and a box.
"""

import numpy as np

from rastercov._jit import compiled, inlined

LEAF = 4
"""Faces of a leaf."""
CURVE_BITS = 21
"""Bits of a position along each axis: three of them fill a key."""
SHORTEST_AXIS = 1e-200
"""Square of the length below which a separating axis is not tried."""
BOX_MARGIN = 2.0**-24
"""Added to boxes on each side: twice what float32 rounds off a number about 1/2."""
LONG_WALK = 256
"""Steps along the tree after which the planes of a leaf's faces are looked at, too."""


@compiled
def spread(value):
    """Move bit i of a whole number below 2^21 to bit 3 i."""
    v = np.uint64(value)
    v = (v | (v << np.uint64(32))) & np.uint64(0x001F00000000FFFF)
    v = (v | (v << np.uint64(16))) & np.uint64(0x001F0000FF0000FF)
    v = (v | (v << np.uint64(8))) & np.uint64(0x100F00F00F00F00F)
    v = (v | (v << np.uint64(4))) & np.uint64(0x10C30C30C30C30C3)
    return (v | (v << np.uint64(2))) & np.uint64(0x1249249249249249)


@compiled
def order_keys(placed, faces, keys):
    """Sort key of each face: where the middle of its box stands on a Morton curve.

    Parameters
    ----------
    placed : (V, 3) float64
        Vertices in a box of diagonal 1 about the origin, turned as suits the boxes.
    faces : (N, 3) int32
    keys : (N,) uint64
        Out.
    """
    cells = float(1 << CURVE_BITS)
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        key = np.uint64(0)
        for k in range(3):
            p, q, r = placed[a, k], placed[b, k], placed[c, k]
            low, high = min(p, min(q, r)), max(p, max(q, r))
            cell = min(max((0.5 * (low + high) + 0.5) * cells, 0.0), cells - 1.0)
            key |= spread(np.int64(cell)) << np.uint64(k)
        keys[f] = key


@compiled
def grow_boxes(placed, faces, boxes, nodes, done):
    """Boxes of the faces, of the leaves, and of the tree above them.

    Parameters
    ----------
    placed, faces
        As for `order_keys`, the faces in the order of their keys.
    boxes : (N, 6) float32
        Out: lowest coordinates, and highest ones negated; not rounded inwards.
    nodes : (2 L, 6) float32
        Out: the tree; L leaves, a power of two with L >= 2 and L * LEAF >= N. Node 0 is not used,
        empty leaves have boxes that overlap nothing.
    done : (2 L,) bool
        Out: nodes without an unmarked face, which are the empty ones.
    """
    leaves = nodes.shape[0] // 2
    nodes[:] = np.inf
    done[:] = True
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        for k in range(3):
            p, q, r = placed[a, k], placed[b, k], placed[c, k]
            boxes[f, k] = min(p, min(q, r)) - BOX_MARGIN
            boxes[f, 3 + k] = -max(p, max(q, r)) - BOX_MARGIN
        leaf = leaves + f // LEAF
        done[leaf] = False
        for k in range(6):
            nodes[leaf, k] = min(nodes[leaf, k], boxes[f, k])
    for n in range(leaves - 1, 0, -1):
        done[n] = done[2 * n] and done[2 * n + 1]
        for k in range(6):
            nodes[n, k] = min(nodes[2 * n, k], nodes[2 * n + 1, k])


@compiled
def overlap(boxes, i, others, j, reach):
    """Whether two boxes are within `reach` of each other along every axis."""
    f, g = np.uint64(i), np.uint64(j)  # unsigned: no test for counting from the end
    x = max(boxes[f, 0] + others[g, 3], others[g, 0] + boxes[f, 3])
    y = max(boxes[f, 1] + others[g, 4], others[g, 1] + boxes[f, 4])
    z = max(boxes[f, 2] + others[g, 5], others[g, 2] + boxes[f, 5])
    return max(x, max(y, z)) <= reach


@inlined
def dot(points, i, j):
    """Dot product of two rows."""
    return points[i, 0] * points[j, 0] + points[i, 1] * points[j, 1] + points[i, 2] * points[j, 2]


@compiled
def set_cross(points, i, j, k):
    """Row k becomes the cross product of rows i and j."""
    points[k, 0] = points[i, 1] * points[j, 2] - points[i, 2] * points[j, 1]
    points[k, 1] = points[i, 2] * points[j, 0] - points[i, 0] * points[j, 2]
    points[k, 2] = points[i, 0] * points[j, 1] - points[i, 1] * points[j, 0]


@compiled
def is_gap(points, axis, reach):
    """Whether rows 0 to 2 lie more than `reach` from rows 3 to 5 along the axis in a row."""
    length = dot(points, axis, axis)
    if not length > SHORTEST_AXIS:
        return False
    a, b, c = dot(points, 0, axis), dot(points, 1, axis), dot(points, 2, axis)
    p, q, r = dot(points, 3, axis), dot(points, 4, axis), dot(points, 5, axis)
    gap = max(min(p, min(q, r)) - max(a, max(b, c)), min(a, min(b, c)) - max(p, max(q, r)))
    return gap > reach * np.sqrt(length)


@compiled
def are_apart(points, reach):
    """Whether an axis shows that two triangles are more than `reach` apart.

    True is right for any axis, however it was rounded. False may be wrong by what no axis sees of
    the distance between two corners.

    Parameters
    ----------
    points : (15, 3) float64
        Rows 0 to 5 are the corners of the one and of the other, a segment is a triangle that
        repeats a corner. The rest is scratch: edges, normals, and an axis.
    """
    for k in range(3):  # not an axis that must be tried, but the best first guess
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
        for edge in range(6, 12):  # in the plane of the one, across the edges of both
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
    """Whether two triangles with one common corner meet elsewhere, too.

    What they have in common is convex and holds that corner, so it ends on the edge that the one
    or the other has opposite the corner.

    Parameters
    ----------
    points : (15, 3) float64
        Corners from the common one, which is 0 and the first of each. Overwritten.
    """
    # At once, where a plane through the corner has one triangle on either side:
    for k in range(3):
        points[14, k] = points[4, k] + points[5, k] - points[1, k] - points[2, k]
    length = dot(points, 14, 14)
    above = min(dot(points, 4, 14), dot(points, 5, 14))
    below = max(dot(points, 1, 14), dot(points, 2, 14))
    if length > SHORTEST_AXIS and min(above, -below) > reach * np.sqrt(length):
        return False
    points[3] = points[4]
    if not are_apart(points, reach):
        return True
    points[3] = 0.0
    points[0] = points[1]
    return not are_apart(points, reach)


@compiled
def fold_touches(points, reach):
    """Whether two triangles with a common edge are folded onto each other.

    Seen along the edge they are two segments from one point. The gap between the triangles is
    widest at the lower apex.

    Parameters
    ----------
    points : (15, 3) float64
        Corners from the start of the edge, which is 0; rows 1, 2 and 5 are its end and both apexes.
        Overwritten.
    """
    length = dot(points, 1, 1)
    if not length > SHORTEST_AXIS:
        return True
    for apex in (2, 5):  # from here on as seen along the edge
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
    """Whether two faces come within `reach` of each other, other than where they are joined.

    Parameters
    ----------
    vertices : (V, 3) float64
        As they were given: the rounding of a shift would bend short edges.
    scale : float
        Inverse of their bounding box' diagonal.
    faces : (N, 3) int32
        Equal indices for vertices on the same point; three different ones a face.
    t, m : int
        Their rows in `faces`.
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
    # The first corner is one that both have; a second one comes next, so the apex is last.
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
    """Row i of `slabs`: the normal of a face, its length, and the face's interval along it."""
    for k in range(3):
        for j in range(3):
            points[j, k] = placed[faces[f, j], k]
        points[3, k] = points[1, k] - points[0, k]
        points[4, k] = points[2, k] - points[0, k]
    set_cross(points, 3, 4, 5)
    length = dot(points, 5, 5)
    if not length > SHORTEST_AXIS:
        points[5] = 0.0
    slabs[i, :3] = points[5]
    slabs[i, 3] = np.sqrt(length)
    # An interval, not a value: rounding may have turned the normal of a needle.
    p, q, r = dot(points, 0, 5), dot(points, 1, 5), dot(points, 2, 5)
    slabs[i, 4], slabs[i, 5] = min(p, min(q, r)), max(p, max(q, r))


@compiled
def slab_misses(slabs, i, boxes, j, reach):
    """Whether a box lies more than `reach` above or below a face."""
    middle, radius = 0.0, 0.0
    for k in range(3):
        middle += slabs[i, k] * 0.5 * (boxes[j, k] - boxes[j, 3 + k])
        radius -= abs(slabs[i, k]) * 0.5 * (boxes[j, k] + boxes[j, 3 + k])
    gap = max(middle - radius - slabs[i, 5], slabs[i, 4] - middle - radius)
    return gap > reach * slabs[i, 3]


@compiled
def mark(f, marks, done, leaf):
    """Mark a face, and note each node in which it was the last unmarked one."""
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
    """Mark the faces in contact, of pairs whose earlier leaf is in a range.

    Threads may work on other ranges meanwhile: marks that they see late cost them some work.

    Parameters
    ----------
    vertices, scale, reach
        As for `touch`.
    placed, faces, boxes, nodes, done
        As for `grow_boxes`.
    labels : (N,) or (0,) int32
        Faces with different labels are not in contact, whatever they do; none for no labels.
    first, last, budget : int
        The range, and the steps along the tree after which to return early.
    marks : (N,) bool
        Out: true for what is in contact; others stay as they are.

    Returns the leaf to go on from, `last` when all is done.
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
            if steps == LONG_WALK:  # a large face among small ones, or a box at a slant
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
                    if steps >= LONG_WALK and slab_misses(slabs, t - start, nodes, node, reach):
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
