"""Compiled loops of `triangle_tree`: Morton order, boxes, and three queries.

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

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.kernels.jit import compiled

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

LEAF = 4
"""Triangles of a leaf."""
STACK_SIZE = 64
"""Nodes on the stack of a query: at most one for each level of the tree."""
CELLS = 2.0**20 - 1
"""Highest cell of the Morton curve along each axis."""
TINY = float(np.finfo(np.float64).tiny)
VOLUME_TOLERANCE = 1e-15
"""Rounding of a volume in a scene of diagonal 1: no line through a vertex passes between faces."""
SLAB_TOLERANCE = 1e-14
"""Relative and absolute rounding of the distance to a box: a triangle may lie in the side of it."""


@compiled
def spread_bits(value: Any) -> Any:
    """Move bit i of an integer below 2^21 to bit 3 i."""
    v = np.uint64(value)
    v = (v | (v << np.uint64(32))) & np.uint64(0x001F00000000FFFF)
    v = (v | (v << np.uint64(16))) & np.uint64(0x001F0000FF0000FF)
    v = (v | (v << np.uint64(8))) & np.uint64(0x100F00F00F00F00F)
    v = (v | (v << np.uint64(4))) & np.uint64(0x10C30C30C30C30C3)
    return (v | (v << np.uint64(2))) & np.uint64(0x1249249249249249)


@compiled
def box_centre(points: FloatArray, faces: NDArray[Any], f: int, k: int) -> Any:
    """Coordinate k of the centre of a triangle's box."""
    p, q, r = points[faces[f, 0], k], points[faces[f, 1], k], points[faces[f, 2], k]
    return 0.5 * (min(p, min(q, r)) + max(p, max(q, r)))


@compiled
def order_keys(points: FloatArray, faces: NDArray[Any], keys: NDArray[np.uint64]) -> None:
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
def grow_boxes(
    points: FloatArray, faces: NDArray[Any], margin: float, boxes: NDArray[Any], nodes: NDArray[Any]
) -> None:
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


@compiled
def volume(points: FloatArray, i: int, j: int, d: FloatArray) -> Any:
    """Triple product d . (p_i x p_j): its sign is the side of edge i j on which direction d passes.

    Swapping i and j changes the sign and no other bit: two faces agree about their edge.
    """
    return (
        d[0] * (points[i, 1] * points[j, 2] - points[i, 2] * points[j, 1])
        + d[1] * (points[i, 2] * points[j, 0] - points[i, 0] * points[j, 2])
        + d[2] * (points[i, 0] * points[j, 1] - points[i, 1] * points[j, 0])
    )


@compiled
def meets_triangle(points: FloatArray, d: FloatArray, reach: float) -> bool:
    """True if the segment from the origin to reach * d meets a triangle, including its edges.

    A triangle seen edge-on is not met.
    """
    u, v, w = volume(points, 1, 2, d), volume(points, 2, 0, d), volume(points, 0, 1, d)
    least, greatest = min(u, min(v, w)), max(u, max(v, w))
    # Both true: the line passes outside. Both false: all volumes are rounding, edge-on.
    if (least < -VOLUME_TOLERANCE) == (greatest > VOLUME_TOLERANCE):
        return False
    total = u + v + w
    along = 0.0
    for k in range(3):
        along += (u * points[0, k] + v * points[1, k] + w * points[2, k]) / total * d[k]
    return 0.0 <= along <= reach


@compiled
def meets_box(origin: FloatArray, direction: FloatArray, reach: float, box: FloatArray) -> bool:
    """True if a segment meets a box."""
    first, last = 0.0, reach
    for k in range(3):
        low, high = box[k] - origin[k], -box[3 + k] - origin[k]
        d = direction[k]
        if d == 0.0:
            if low > 0.0 or high < 0.0:
                return False
            continue
        # Ordered by the sign of d, not by size: an empty box must stay the wrong way round.
        near, far = (low / d, high / d) if d > 0.0 else (high / d, low / d)
        first = max(first, near * (1 - SLAB_TOLERANCE) - SLAB_TOLERANCE)
        last = min(last, far * (1 + SLAB_TOLERANCE) + SLAB_TOLERANCE)
        if first > last:
            return False
    return True


@compiled
def hit_segments(
    origins: FloatArray,
    directions: FloatArray,
    reaches: FloatArray,
    corners: FloatArray,
    nodes: FloatArray,
    hit: BoolArray,
) -> None:
    """Set `hit` for segments that meet a triangle, in a scene of diagonal 1 about the origin.

    Directions are unit vectors; a segment without a positive reach, its length, meets nothing. The
    (T, 3, 3) corners of the triangles are in the order of the tree.
    """
    leaves = nodes.shape[0] // 2
    stack = np.empty(STACK_SIZE, np.int64)
    points = np.empty((3, 3))
    for i in range(origins.shape[0]):
        hit[i] = False
        if not reaches[i] > 0.0:
            continue
        start, d = origins[i], directions[i]
        stack[0], depth = 1, 1
        while depth and not hit[i]:
            depth -= 1
            node = stack[depth]
            if not meets_box(start, d, reaches[i], nodes[node]):
                continue
            if node < leaves:
                stack[depth], stack[depth + 1] = 2 * node, 2 * node + 1
                depth += 2
                continue
            first = (node - leaves) * LEAF
            for t in range(first, min(first + LEAF, corners.shape[0])):
                for corner in range(3):
                    for k in range(3):
                        points[corner, k] = corners[t, corner, k] - start[k]
                if meets_triangle(points, d, reaches[i]):
                    hit[i] = True
                    break


# --- nearest point --------------------------------------------------------------------------------


@compiled
def dot(a: FloatArray, b: FloatArray) -> Any:
    """Dot product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def nearest_on_triangle(p: FloatArray, corners: FloatArray, out: FloatArray) -> float:
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
    return dot(gap, gap)  # type: ignore[no-any-return] # compiled: untyped


@compiled
def box_distance(p: FloatArray, box: FloatArray) -> float:
    """Squared distance of a point from a box; 0 inside."""
    total = 0.0
    for k in range(3):
        gap = max(box[k] - p[k], p[k] + box[3 + k], 0.0)
        total += gap * gap
    return total


@compiled
def nearest(
    points: FloatArray,
    corners: FloatArray,
    nodes: FloatArray,
    squared: FloatArray,
    triangle: IntArray,
    where: FloatArray,
) -> None:
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
def is_left(vertices: FloatArray, i: int, j: int, x: float, y: float) -> bool:
    """True if a point lies to the left of the line from vertex i to j, seen along z.

    Computed from the lower to the higher index, so the two faces of an edge always agree.
    """
    low, high = min(i, j), max(i, j)
    across = (vertices[high, 0] - vertices[low, 0]) * (y - vertices[low, 1])
    along = (vertices[high, 1] - vertices[low, 1]) * (x - vertices[low, 0])
    is_left_of = across >= along
    return is_left_of if i == low else not is_left_of


@compiled
def winding(
    points: FloatArray, vertices: FloatArray, faces: IntArray, nodes: FloatArray, turns: IntArray
) -> None:
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
