"""Compiled loops of `TriangleTree`: Morton order, boxes, and three queries.

The triangles lie in the order of a Morton curve. A complete binary tree over that order has their
boxes: node n has the children 2n and 2n + 1, the last L nodes are the leaves, of `LEAF` triangles
each. A box is six numbers: the lowest coordinates, then the highest ones negated, so that a union
is one minimum; an empty box is six times inf. Node 0 is not used.

G. M. Morton. A Computer Oriented Geodetic Data Base. 1966, for the curve.
A. Kensler and P. Shirley. Optimizing Ray-Triangle Intersection via Automated Search. 2006, for the
signs of volumes. S. Woop et al. Watertight Ray/Triangle Intersection. 2013, for equal arithmetic on
both sides of an edge.
C. Ericson. Real-Time Collision Detection. 2004, section 5.1.5, for the nearest point of a triangle.
"""

import numpy as np

from rastercov.kernels.jit import allocation_free, compiled, part_of, part_with_arrays

LEAF = 4
"""Triangles of a leaf."""
STACK_SIZE = 64
"""Nodes on the stack of a query: at most one for each level of the tree."""
CELLS = 2.0**20 - 1
"""Highest cell of the Morton curve along each axis."""
TINY = float(np.finfo(np.float64).tiny)
VOLUME_TOLERANCE = 1e-15
"""Rounding of a volume in a scene of diagonal 1: no line through a vertex passes between faces."""
LEAST_STEP = 1e-12
"""Least component of a direction in the test of a box."""
BOX_MARGIN = 1e-11
"""Growth of boxes on each side, for a segment of length 0 and again for each unit of its length:
more than rounding and `LEAST_STEP` move a point."""


@compiled
def spread_bits(value):
    """Move bit i of an integer below 2^21 to bit 3 i."""
    v = np.uint64(value)
    v = (v | (v << np.uint64(32))) & np.uint64(0x001F00000000FFFF)
    v = (v | (v << np.uint64(16))) & np.uint64(0x001F0000FF0000FF)
    v = (v | (v << np.uint64(8))) & np.uint64(0x100F00F00F00F00F)
    v = (v | (v << np.uint64(4))) & np.uint64(0x10C30C30C30C30C3)
    return (v | (v << np.uint64(2))) & np.uint64(0x1249249249249249)


@compiled
def box_centre(points, faces, f, k):
    """Coordinate k of the centre of a triangle's box."""
    p, q, r = points[faces[f, 0], k], points[faces[f, 1], k], points[faces[f, 2], k]
    return 0.5 * (min(p, min(q, r)) + max(p, max(q, r)))


@compiled
def order_keys(points, faces, keys):
    """Set `keys`, (T,): the position of the centre of each triangle's box along a Morton curve."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for f in range(faces.shape[0]):
        for k in range(3):
            centre = box_centre(points, faces, f, k)
            low[k], high[k] = min(low[k], centre), max(high[k], centre)
    size = max(TINY, max(high[0] - low[0], max(high[1] - low[1], high[2] - low[2])))
    for f in range(faces.shape[0]):
        key = np.uint64(0)
        for k in range(3):
            cell = np.uint64((box_centre(points, faces, f, k) - low[k]) / size * CELLS)
            key |= spread_bits(cell) << np.uint64(k)
        keys[f] = key


@compiled
def grow_boxes(points, faces, margin, boxes, nodes):
    """Set the (T, 6) boxes of the triangles, and the (2 L, 6) nodes of the tree above them.

    The faces are in the order of the keys; L is a power of two with L >= 2 and L * LEAF >= T. The
    margin, added on each side, is at least twice the rounding of a coordinate to the type of the
    boxes.
    """
    leaves = nodes.shape[0] // 2
    nodes[:] = np.inf
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        for k in range(3):
            p, q, r = points[a, k], points[b, k], points[c, k]
            boxes[f, k] = min(p, min(q, r)) - margin
            boxes[f, 3 + k] = -max(p, max(q, r)) - margin
        leaf = leaves + f // LEAF
        for k in range(6):
            nodes[leaf, k] = min(nodes[leaf, k], boxes[f, k])
    for n in range(leaves - 1, 0, -1):
        for k in range(6):
            nodes[n, k] = min(nodes[2 * n, k], nodes[2 * n + 1, k])


# --- segment hit ----------------------------------------------------------------------------------


@part_of
def volume(d_x, d_y, d_z, p_x, p_y, p_z, q_x, q_y, q_z):
    """Triple product d . (p x q): its sign is the side of edge p q on which direction d passes.

    Swapping p and q changes the sign and no other bit: two faces agree about their edge.
    """
    return (
        d_x * (p_y * q_z - p_z * q_y)
        + d_y * (p_z * q_x - p_x * q_z)
        + d_z * (p_x * q_y - p_y * q_x)
    )


@part_with_arrays
def distance_to(corners, t, x, y, z, d_x, d_y, d_z):
    """Distance along a unit vector d from (x, y, z) to triangle t, or to its edges; -1 for none.

    A triangle seen edge-on is not met.
    """
    a_x, a_y, a_z = corners[t, 0, 0] - x, corners[t, 0, 1] - y, corners[t, 0, 2] - z
    b_x, b_y, b_z = corners[t, 1, 0] - x, corners[t, 1, 1] - y, corners[t, 1, 2] - z
    c_x, c_y, c_z = corners[t, 2, 0] - x, corners[t, 2, 1] - y, corners[t, 2, 2] - z
    u = volume(d_x, d_y, d_z, b_x, b_y, b_z, c_x, c_y, c_z)
    v = volume(d_x, d_y, d_z, c_x, c_y, c_z, a_x, a_y, a_z)
    w = volume(d_x, d_y, d_z, a_x, a_y, a_z, b_x, b_y, b_z)
    least, greatest = min(u, min(v, w)), max(u, max(v, w))
    # Both true: the line passes outside. Both false: all volumes are rounding, edge-on.
    if (least < -VOLUME_TOLERANCE) == (greatest > VOLUME_TOLERANCE):
        return -1.0
    total = u + v + w
    along = (u * a_x + v * b_x + w * c_x) / total * d_x
    along += (u * a_y + v * b_y + w * c_y) / total * d_y
    along += (u * a_z + v * b_z + w * c_z) / total * d_z
    return along


@part_with_arrays
def slab(nodes, node, k, x, inverse, margin):
    """Distances between which a line is within the planes of a box across axis k, in any order."""
    low, high = nodes[node, k] - margin - x, margin - nodes[node, 3 + k] - x
    return low * inverse, high * inverse


@allocation_free
def hit_of(x, y, z, d_x, d_y, d_z, reach, own, is_nearest, corners, nodes, stack):
    """Triangle that a segment meets, other than `own`: the nearest, or any; -1 for none.

    Parameters
    ----------
    x, y, z, d_x, d_y, d_z, reach
        Start, unit vector and length, in a scene of diagonal 1 about the origin.
    own
        Triangle that does not count, in the order of the tree; -1 for none.
    is_nearest
        Search for the nearest one, which takes longer.
    corners, nodes : (T, 3, 3), (2 L, 6) float64
        Triangles in the order of the tree, and its boxes.
    stack : (STACK_SIZE,) int64
        Scratch.
    """
    leaves, hit = nodes.shape[0] // 2, -1
    # A direction along an axis has no reciprocal; boxes are grown by more than this moves a point.
    margin = BOX_MARGIN * (1.0 + reach)
    a = 1.0 / (d_x if abs(d_x) > LEAST_STEP else LEAST_STEP)
    b = 1.0 / (d_y if abs(d_y) > LEAST_STEP else LEAST_STEP)
    c = 1.0 / (d_z if abs(d_z) > LEAST_STEP else LEAST_STEP)
    stack[0], depth = 1, 1
    while depth:
        depth -= 1
        node = stack[depth]
        if nodes[node, 0] == np.inf:  # an empty box
            continue
        low, high = slab(nodes, node, 0, x, a, margin)
        first, last = min(low, high), max(low, high)
        low, high = slab(nodes, node, 1, y, b, margin)
        first, last = max(first, min(low, high)), min(last, max(low, high))
        low, high = slab(nodes, node, 2, z, c, margin)
        first, last = max(first, min(low, high)), min(last, max(low, high))
        if first > last or first > reach or last < 0.0:
            continue
        if node < leaves:
            stack[depth], stack[depth + 1] = 2 * node, 2 * node + 1
            depth += 2
            continue
        begin = (node - leaves) * LEAF
        for t in range(begin, min(begin + LEAF, corners.shape[0])):
            if t == own:
                continue
            along = distance_to(corners, t, x, y, z, d_x, d_y, d_z)
            if 0.0 <= along <= reach:
                hit = t
                if not is_nearest:
                    return hit
                reach = along
    return hit


@compiled
def first_hits(origins, directions, reaches, own, corners, nodes, hit):
    """Set `hit` to the first triangle of each segment, -1 for none, in a scene of diagonal 1.

    Directions are unit vectors; a segment without a positive reach, its length, meets nothing.
    Triangle `own` does not count, -1 for none. The (T, 3, 3) corners of the triangles are in the
    order of the tree.
    """
    stack, last = np.empty(STACK_SIZE, np.int64), -1
    for i in range(origins.shape[0]):
        x, y, z = origins[i, 0], origins[i, 1], origins[i, 2]
        d_x, d_y, d_z = directions[i, 0], directions[i, 1], directions[i, 2]
        reach, hit[i] = reaches[i], -1
        if last >= 0 and last != own[i]:  # what was hit before is often near this one, too
            along = distance_to(corners, last, x, y, z, d_x, d_y, d_z)
            if 0.0 <= along <= reach:
                reach = along
        if reaches[i] > 0.0:
            hit[i] = hit_of(x, y, z, d_x, d_y, d_z, reach, own[i], True, corners, nodes, stack)
        if hit[i] >= 0:
            last = hit[i]


# --- nearest point --------------------------------------------------------------------------------


@compiled
def dot(a, b):
    """Dot product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def nearest_on_triangle(p, corners, out):
    """Squared distance of a point from a triangle with an area; `out` is its nearest point."""
    a, b, c = corners[0], corners[1], corners[2]
    ab, ac, bc = b - a, c - a, c - b
    ap, bp, cp = p - a, p - b, p - c
    d1, d2, d3 = dot(ab, ap), dot(ac, ap), dot(ab, bp)
    d4, d5, d6 = dot(ac, bp), dot(ab, cp), dot(ac, cp)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0.0 and d2 <= 0.0:
        out[:] = a
    elif d3 >= 0.0 and d4 <= d3:
        out[:] = b
    elif d6 >= 0.0 and d5 <= d6:
        out[:] = c
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        out[:] = a + d1 / (d1 - d3) * ab
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        out[:] = a + d2 / (d2 - d6) * ac
    elif va <= 0.0 and d4 >= d3 and d5 >= d6:
        out[:] = b + (d4 - d3) / ((d4 - d3) + (d5 - d6)) * bc
    else:
        total = va + vb + vc
        out[:] = a + vb / total * ab + vc / total * ac
    gap = p - out
    return dot(gap, gap)


@compiled
def box_distance(p, box):
    """Squared distance of a point from a box; 0 inside."""
    total = 0.0
    for k in range(3):
        gap = max(box[k] - p[k], p[k] + box[3 + k], 0.0)
        total += gap * gap
    return total


@compiled
def nearest(points, corners, nodes, squared, triangle, where):
    """Set squared distance, triangle and (N, 3) nearest point of the triangles for each point.

    Of several triangles at the same distance it is the first one that the traversal reaches. They
    have an area; their (T, 3, 3) corners are in the order of the tree, and nodes have no margin.
    """
    leaves = nodes.shape[0] // 2
    stack = np.empty(STACK_SIZE, np.int64)
    found = np.empty(3)
    for i in range(points.shape[0]):
        p = points[i]
        best = np.inf
        triangle[i] = 0
        stack[0], depth = 1, 1
        while depth:
            depth -= 1
            node = stack[depth]
            if box_distance(p, nodes[node]) >= best:
                continue
            if node >= leaves:
                start = (node - leaves) * LEAF
                for t in range(start, min(start + LEAF, corners.shape[0])):
                    distance = nearest_on_triangle(p, corners[t], found)
                    if distance < best:
                        best = distance
                        triangle[i] = t
                        where[i] = found
                continue
            left, right = 2 * node, 2 * node + 1
            if box_distance(p, nodes[left]) > box_distance(p, nodes[right]):
                left, right = right, left
            stack[depth], stack[depth + 1] = right, left
            depth += 2
        squared[i] = best


# --- winding number -------------------------------------------------------------------------------


@compiled
def is_left(vertices, i, j, x, y):
    """True if a point lies to the left of the line from vertex i to j, seen along z.

    Computed from the lower to the higher index, so the two faces of an edge always agree.
    """
    low, high = min(i, j), max(i, j)
    across = (vertices[high, 0] - vertices[low, 0]) * (y - vertices[low, 1])
    along = (vertices[high, 1] - vertices[low, 1]) * (x - vertices[low, 0])
    is_left_of = across >= along
    return is_left_of if i == low else not is_left_of


@compiled
def winding(points, vertices, faces, nodes, turns):
    """Set `turns` to the winding number of a surface about each point.

    These are the signed crossings of a ray along +z: 1 inside a surface that faces outward, -1
    inside one that faces inward, undefined unless the surface is closed. The faces are in the order
    of the tree, and nodes have no margin.
    """
    leaves = nodes.shape[0] // 2
    stack = np.empty(STACK_SIZE, np.int64)
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        total = 0
        stack[0], depth = 1, 1
        while depth:
            depth -= 1
            node = stack[depth]
            box = nodes[node]
            if not (box[0] <= x <= -box[3] and box[1] <= y <= -box[4] and z <= -box[5]):
                continue
            if node < leaves:
                stack[depth], stack[depth + 1] = 2 * node, 2 * node + 1
                depth += 2
                continue
            start = (node - leaves) * LEAF
            for t in range(start, min(start + LEAF, faces.shape[0])):
                a, b, c = faces[t, 0], faces[t, 1], faces[t, 2]
                side = is_left(vertices, a, b, x, y)
                if is_left(vertices, b, c, x, y) != side or is_left(vertices, c, a, x, y) != side:
                    continue
                ab, ac = vertices[b] - vertices[a], vertices[c] - vertices[a]
                above = (
                    (vertices[a, 0] - x) * (ab[1] * ac[2] - ab[2] * ac[1])
                    + (vertices[a, 1] - y) * (ab[2] * ac[0] - ab[0] * ac[2])
                    + (vertices[a, 2] - z) * (ab[0] * ac[1] - ab[1] * ac[0])
                )
                sign = 1 if side else -1
                if above * sign > 0.0:
                    total += sign
        turns[i] = total
