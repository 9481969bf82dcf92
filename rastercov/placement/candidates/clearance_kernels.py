"""The loops that ask a surface where it is nearest and what it encloses, compiled by numba.

Triangles stand in some order, and a complete binary tree over it holds their boxes: node n has
children 2n and 2n + 1, its last row are the leaves, of `LEAF` triangles each.

C. Ericson. Real-Time Collision Detection. 2004, section 5.1.5, for the nearest point of a triangle.
"""

import numpy as np
from numpy.typing import NDArray

from rastercov._jit import compiled

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

LEAF = 4
"""Triangles of a leaf."""
DEEPEST = 64
"""Nodes that wait, at most: one for each row of the tree."""


@compiled
def dot(a: FloatArray, b: FloatArray) -> float:
    """Dot product of two triples."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]  # type: ignore[no-any-return] # numpy's item


@compiled
def nearest_on_triangle(p: FloatArray, corners: FloatArray, out: FloatArray) -> float:
    """Squared distance of a point from a triangle with an area; `out` is where it is nearest."""
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
    """Squared distance of a point from a box, lowest corner and then highest; 0 inside."""
    total = 0.0
    for k in range(3):
        gap = max(box[k] - p[k], p[k] - box[3 + k], 0.0)
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
    """Nearest point of the surface for each point.

    Parameters
    ----------
    points : (N, 3) float64
    corners : (T, 3, 3) float64
        Triangles with an area, in the order of the tree.
    nodes : (2 L, 6) float64
        Boxes: lowest corner, highest corner; infinite the wrong way round for empty ones.
    squared, triangle, where : (N,) float64, (N,) int64, (N, 3) float64
        Out: squared distance, triangle and point; the lowest triangle of several that are equally
        near on the way down the tree.
    """
    n_leaves = nodes.shape[0] // 2
    waiting = np.empty(DEEPEST, np.int64)
    found = np.empty(3)
    for i in range(points.shape[0]):
        p = points[i]
        best = np.inf
        triangle[i] = 0
        waiting[0], depth = 1, 1
        while depth:
            depth -= 1
            node = waiting[depth]
            if box_distance(p, nodes[node]) >= best:
                continue
            if node >= n_leaves:
                start = (node - n_leaves) * LEAF
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
            waiting[depth], waiting[depth + 1] = right, left
            depth += 2
        squared[i] = best


@compiled
def is_left(vertices: FloatArray, i: int, j: int, x: float, y: float) -> bool:
    """Whether a point lies to the left of the line from vertex i to j, seen along z.

    Reckoned from the lower to the higher index, so that the two faces of an edge never disagree.
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
    """How many times a surface encloses each point: signed crossings of a ray along +z.

    Parameters
    ----------
    points : (N, 3) float64
    vertices : (V, 3) float64
    faces : (T, 3) int64
        In the order of the tree; closed, or the number means nothing.
    nodes : (2 L, 6) float64
        As for `nearest`.
    turns : (N,) int64
        Out: 1 inside a surface that faces outward, -1 inside one that faces inward.
    """
    n_leaves = nodes.shape[0] // 2
    waiting = np.empty(DEEPEST, np.int64)
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        total = 0
        waiting[0], depth = 1, 1
        while depth:
            depth -= 1
            node = waiting[depth]
            box = nodes[node]
            if not (box[0] <= x <= box[3] and box[1] <= y <= box[4] and z <= box[5]):
                continue
            if node < n_leaves:
                waiting[depth], waiting[depth + 1] = 2 * node, 2 * node + 1
                depth += 2
                continue
            start = (node - n_leaves) * LEAF
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
