"""Connected parts of a surface: convex pieces that share a part of their boundary; by numba.

Pieces are the leaves of a forest of parents (union-find). Candidates come from sweeps over sorted
intervals: pieces of a face along one direction of its plane, sides of pieces along the edge of the
mesh that they lie on, and sides on open edges along one direction in space. No direction is that of
an axis, along which built surfaces have many sides at one coordinate.

R. Tarjan. Efficiency of a Good But Not Linear Set Union Algorithm. 1975.
"""

import math

import numpy as np

from rastercov.kernels.exact_setup import join, root_of
from rastercov.kernels.jit import allocation_free, part_with_arrays


@part_with_arrays
def side_overlap(xy, p, q, r, s, tolerance):
    """Length along which the side p q of one polygon and r s of another run within a tolerance.

    The sides are of two polygons that turn the same way, so that a common side has opposite
    directions.
    """
    x, y = xy[q, 0] - xy[p, 0], xy[q, 1] - xy[p, 1]
    length = math.sqrt(x * x + y * y)
    if not length > 0:
        return 0.0
    x, y = x / length, y / length
    a, b = xy[r, 0] - xy[p, 0], xy[r, 1] - xy[p, 1]
    c, d = xy[s, 0] - xy[p, 0], xy[s, 1] - xy[p, 1]
    start, end = a * x + b * y, c * x + d * y
    if not end < start:
        return 0.0
    off, off_end = b * x - a * y, d * x - c * y
    # Part of r s whose distance from the line is within the tolerance, from 0 to 1.
    first, last = 0.0, 1.0
    slope = off_end - off
    if abs(slope) > 0:
        one, other = (-tolerance - off) / slope, (tolerance - off) / slope
        first, last = max(first, min(one, other)), min(last, max(one, other))
    elif abs(off) > tolerance:
        return 0.0
    if last <= first:
        return 0.0
    high, low = start + first * (end - start), start + last * (end - start)
    return min(high, length) - max(low, 0.0)


@part_with_arrays
def are_adjacent(xy, starts, i, j, tolerance, least):
    """True if two convex pieces of a face share a part of their boundary longer than `least`."""
    for p in range(starts[i], starts[i + 1]):
        q = p + 1 if p + 1 < starts[i + 1] else starts[i]
        for r in range(starts[j], starts[j + 1]):
            s = r + 1 if r + 1 < starts[j + 1] else starts[j]
            if side_overlap(xy, p, q, r, s, tolerance) > least:
                return True
    return False


@allocation_free
def link_in_faces(xy, starts, face, boxes, interval, order, tolerance, least, parent):
    """Link the pieces of each face that share a part of their boundary.

    Parameters
    ----------
    xy, starts, face
        Convex pieces, as in `rastercov.coverage.area.union.Covered`.
    boxes : (N, 4) float64
        Least and greatest coordinates of each piece: u, u, v, v.
    interval : (N, 2) float64
        Extent of each piece along the direction of the sweep.
    order : (N,) int64
        Pieces by face, then by the start of their interval.
    tolerance, least : float
        Distance of lines that are one, and length of contact from which pieces are connected, m.
    parent : (N,) int64
        In and out.
    """
    for a in range(order.shape[0]):
        i = order[a]
        for b in range(a + 1, order.shape[0]):
            j = order[b]
            if face[j] != face[i] or interval[j, 0] > interval[i, 1] + tolerance:
                break
            if (
                boxes[j, 0] > boxes[i, 1] + tolerance
                or boxes[i, 0] > boxes[j, 1] + tolerance
                or boxes[j, 2] > boxes[i, 3] + tolerance
                or boxes[i, 2] > boxes[j, 3] + tolerance
                or root_of(parent, i) == root_of(parent, j)
            ):
                continue
            if are_adjacent(xy, starts, i, j, tolerance, least):
                join(i, j, parent)


@allocation_free
def link_along_edges(edge, interval, piece, face, least, parent):
    """Link the pieces of different faces whose sides overlap on an edge of the mesh.

    Sides, (N,) each, are sorted by edge, then by the start of their interval along it.
    """
    for a in range(edge.shape[0]):
        for b in range(a + 1, edge.shape[0]):
            if edge[b] != edge[a] or interval[b, 0] > interval[a, 1] - least:
                break
            i, j = piece[a], piece[b]
            if face[i] != face[j] and interval[b, 1] > interval[b, 0] + least:
                join(i, j, parent)


@part_with_arrays
def overlap_in_space(ends, a, b, tolerance):
    """Length along which two segments run within a tolerance; `ends` is (N, 2, 3)."""
    x, y, z = (
        ends[a, 1, 0] - ends[a, 0, 0],
        ends[a, 1, 1] - ends[a, 0, 1],
        ends[a, 1, 2] - ends[a, 0, 2],
    )
    length = math.sqrt(x * x + y * y + z * z)
    if not length > 0:
        return 0.0
    x, y, z = x / length, y / length, z / length
    low, high = np.inf, -np.inf
    for k in range(2):
        u = ends[b, k, 0] - ends[a, 0, 0]
        v = ends[b, k, 1] - ends[a, 0, 1]
        w = ends[b, k, 2] - ends[a, 0, 2]
        along = u * x + v * y + w * z
        u, v, w = u - along * x, v - along * y, w - along * z
        if u * u + v * v + w * w > tolerance * tolerance:
            return 0.0
        low, high = min(low, along), max(high, along)
    return min(high, length) - max(low, 0.0)


@allocation_free
def link_in_space(ends, interval, piece, face, tolerance, least, parent):
    """Link the pieces of different faces whose sides overlap, sorted by the start of `interval`."""
    for a in range(piece.shape[0]):
        for b in range(a + 1, piece.shape[0]):
            if interval[b, 0] > interval[a, 1] + tolerance:
                break
            i, j = piece[a], piece[b]
            if face[i] == face[j] or root_of(parent, i) == root_of(parent, j):
                continue
            apart = False
            for k in range(3):
                low, high = min(ends[a, 0, k], ends[a, 1, k]), max(ends[a, 0, k], ends[a, 1, k])
                first, last = min(ends[b, 0, k], ends[b, 1, k]), max(ends[b, 0, k], ends[b, 1, k])
                if first > high + tolerance or low > last + tolerance:
                    apart = True
            if apart:
                continue
            if (
                overlap_in_space(ends, a, b, tolerance) > least
                or overlap_in_space(ends, b, a, tolerance) > least
            ):
                join(i, j, parent)


@allocation_free
def find_sides(xy, starts, face, corners, tolerance, side):
    """Side of its face, 0 to 2 or -1, on which each side of each piece lies; `side` is (C,)."""
    for i in range(face.shape[0]):
        f = face[i]
        for p in range(starts[i], starts[i + 1]):
            q = p + 1 if p + 1 < starts[i + 1] else starts[i]
            side[p] = -1
            for k in range(3):
                m = k + 1 if k < 2 else 0
                x, y = corners[f, m, 0] - corners[f, k, 0], corners[f, m, 1] - corners[f, k, 1]
                length = math.sqrt(x * x + y * y)
                if not length > 0:
                    continue
                u, v = xy[p, 0] - corners[f, k, 0], xy[p, 1] - corners[f, k, 1]
                here = abs(x * v - y * u) / length
                u, v = xy[q, 0] - corners[f, k, 0], xy[q, 1] - corners[f, k, 1]
                if here <= tolerance and abs(x * v - y * u) / length <= tolerance:
                    side[p] = k


@allocation_free
def find_roots(parent, root):
    """Root of each piece."""
    for i in range(parent.shape[0]):
        root[i] = root_of(parent, i)
