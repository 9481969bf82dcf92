"""The loop that asks whether a segment meets a triangle, compiled by numba.

Triangles stand in the order of a complete binary tree of boxes, which `contact_kernels.grow_boxes`
makes: node n has children 2n and 2n + 1, its last row are the leaves.

A. Kensler and P. Shirley. Optimizing Ray-Triangle Intersection via Automated Search. 2006 (signs of
volumes). S. Woop et al. Watertight Ray/Triangle Intersection. 2013 (why both sides of an edge must
reckon alike).
"""

import numpy as np

from rastercov._jit import compiled

ROUNDING = 1e-15
"""Of a volume in a scene that measures 1: a line through a vertex slips between no two faces."""
DEEPEST = 64
"""Nodes that wait, at most: one for each row of the tree."""


@compiled
def volume(points, i, j, d):
    """Side of the edge from i to j on which the line along d passes: the sign of d . (p_i x p_j).

    Swapping i and j changes the sign and not a bit more: two faces agree about their edge.
    """
    return (
        d[0] * (points[i, 1] * points[j, 2] - points[i, 2] * points[j, 1])
        + d[1] * (points[i, 2] * points[j, 0] - points[i, 0] * points[j, 2])
        + d[2] * (points[i, 0] * points[j, 1] - points[i, 1] * points[j, 0])
    )


@compiled
def meets(points, d, reach):
    """Whether the segment from the origin to `reach` times d meets a triangle, its edges included.

    A triangle that is seen edge-on is met by nothing.
    """
    u, v, w = volume(points, 1, 2, d), volume(points, 2, 0, d), volume(points, 0, 1, d)
    least, greatest = min(u, min(v, w)), max(u, max(v, w))
    # On the border where both signs are but rounding, edge-on where nothing else is there.
    if (least < -ROUNDING) == (greatest > ROUNDING):
        return False
    total = u + v + w
    along = 0.0
    for k in range(3):
        along += (u * points[0, k] + v * points[1, k] + w * points[2, k]) / total * d[k]
    return 0.0 <= along <= reach


@compiled
def crosses(origin, direction, reach, box):
    """Whether a segment meets a box: lowest coordinates, then highest ones negated."""
    first, last = 0.0, reach
    for k in range(3):
        low, high = box[k] - origin[k], -box[3 + k] - origin[k]
        d = direction[k]
        if d == 0.0:
            if low > 0.0 or high < 0.0:
                return False
            continue
        # Not swapped by size: an empty box is the wrong way round, and must stay so.
        near, far = (low / d, high / d) if d > 0.0 else (high / d, low / d)
        # Rounding must not lose a triangle that lies flat against the side of its box.
        first, last = max(first, near * (1 - 1e-14) - 1e-14), min(last, far * (1 + 1e-14) + 1e-14)
        if first > last:
            return False
    return True


@compiled
def mark_hidden(origins, directions, reaches, corners, nodes, leaf, hidden):
    """Which segments meet a triangle.

    Parameters
    ----------
    origins, directions : (N, 3) float64
        Where segments start, and unit vectors along them; the scene measures about 1.
    reaches : (N,) float64
        Their lengths; where it is not positive the segment meets nothing.
    corners : (T, 3, 3) float64
        Triangles, in the order of the tree.
    nodes : (2 L, 6) float64
        Boxes, see `crosses`.
    leaf : int
        Triangles of a leaf.
    hidden : (N,) bool
        Out.
    """
    leaves = nodes.shape[0] // 2
    waiting = np.empty(DEEPEST, np.int64)
    points = np.empty((3, 3))
    for i in range(origins.shape[0]):
        hidden[i] = False
        if not reaches[i] > 0.0:
            continue
        start, d = origins[i], directions[i]
        waiting[0], depth = 1, 1
        while depth and not hidden[i]:
            depth -= 1
            node = waiting[depth]
            if not crosses(start, d, reaches[i], nodes[node]):
                continue
            if node < leaves:
                waiting[depth], waiting[depth + 1] = 2 * node, 2 * node + 1
                depth += 2
                continue
            first = (node - leaves) * leaf
            for t in range(first, min(first + leaf, corners.shape[0])):
                for corner in range(3):
                    for k in range(3):
                        points[corner, k] = corners[t, corner, k] - start[k]
                if meets(points, d, reaches[i]):
                    hidden[i] = True
                    break
