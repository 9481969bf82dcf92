"""Loops of `clusters`, compiled by numba."""

import numpy as np

from rastercov.kernels.jit import compiled, part_with_arrays
from rastercov.kernels.raster_memory import (
    ALTITUDE,
    CONE_AXIS,
    CONE_COS,
    CONE_SIN,
    FACES,
    LANES,
    LINE_BITS,
    PLANE_OFFSET,
    RADIUS,
    VERTICES,
)

VERTEX_STEP = 8
"""The vertices of a cluster are padded to a multiple of this, by the last one."""


@compiled
def face_centroids(vertices, faces, low, scale, is_wound, centroids, directions):
    """Write centroids of faces, (3, F) float32 in 0..1, and main directions of normals, 0..5."""
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        widest = -1.0
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            normal = (vertices[b, i] - vertices[a, i]) * (vertices[c, j] - vertices[a, j]) - (
                vertices[c, i] - vertices[a, i]
            ) * (vertices[b, j] - vertices[a, j])
            if abs(normal) > widest:
                widest, directions[f] = abs(normal), 2 * k + (is_wound and normal > 0)
            centroid = (vertices[a, k] + vertices[b, k] + vertices[c, k]) / 3
            centroids[k, f] = (centroid - low[k]) * scale


@part_with_arrays
def is_before(centroids, f, g):
    """Compare faces by centroid along an axis, ties by index."""
    return centroids[f] < centroids[g] or (centroids[f] == centroids[g] and f < g)


@compiled
def nth_element(order, begin, end, first, centroids):
    """Reorder a part of the order so that its first `first` faces are the least along an axis.

    C. A. R. Hoare. Algorithm 65: Find. 1961.
    """
    low, high, at = begin, end - 1, begin + first
    while low < high:
        # Pseudo-random pivot: no quadratic time on sorted or adversarial input.
        pivot = order[low + (np.uint64(high - low) * np.uint64(2654435769) >> np.uint64(32))]
        i, j = low, high
        while i <= j:
            while is_before(centroids, order[i], pivot):
                i += 1
            while is_before(centroids, pivot, order[j]):
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if at <= j:
            high = j
        elif at >= i:
            low = i
        else:
            return


@compiled
def n_vertices_of(faces, order, begin, end, marks, mark):
    """Number of distinct vertices of some faces; sets their `marks` to the unused value `mark`."""
    n = 0
    for i in range(begin, end):
        for j in range(3):
            n += marks[faces[order[i], j]] != mark
            marks[faces[order[i], j]] = mark
    return n


@compiled
def split_at_medians(faces, order, direction_starts, centroids, marks, starts):
    """Split groups of faces into clusters; returns the numbers of clusters and of face slots.

    Median splits across the longest side, at multiples of a cluster or of a vector of faces.
    """
    n, n_slots, mark = 0, 0, 0
    stack = np.empty((64, 2), np.int64)
    for group in range(len(direction_starts) - 1):
        stack[0] = direction_starts[group], direction_starts[group + 1]
        n_left = int(stack[0, 0] < stack[0, 1])
        while n_left:
            n_left -= 1
            begin, end = stack[n_left]
            size = end - begin
            if size <= FACES:
                mark += 1
                if n_vertices_of(faces, order, begin, end, marks, mark) <= VERTICES:
                    starts[n] = begin
                    n += 1
                    n_slots += (size + LANES - 1) // LANES * LANES
                    continue
            whole = FACES if size > FACES else LANES
            first = max(whole, (size + whole) // (2 * whole) * whole)
            longest, axis = np.float32(-1.0), 0
            for k in range(3):
                least = greatest = centroids[k, order[begin]]
                for i in range(begin, end):
                    least = min(least, centroids[k, order[i]])
                    greatest = max(greatest, centroids[k, order[i]])
                if greatest - least > longest:
                    longest, axis = greatest - least, k
            nth_element(order, begin, end, first, centroids[axis])
            stack[n_left] = begin + first, end
            stack[n_left + 1] = begin, begin + first
            n_left += 2
    starts[n] = len(order)
    return n, n_slots


@compiled
def index_local_vertices(
    faces, order, starts, n, marks, local, corners, face_of, face_starts, vertex_starts, lines,
    line_starts,
):  # fmt: skip
    """Index the vertices of each cluster from 0; `marks` holds the last cluster of a vertex."""
    slot, vertex, line = 0, 0, 0
    for k in range(n):
        count = 0
        for i in range(starts[k], starts[k + 1]):
            f = order[i]
            place = line
            for at in range(line_starts[k], line):
                if lines[at] == f >> LINE_BITS:
                    place = at
                    break
            lines[place] = f >> LINE_BITS
            line += place == line
            packed = 0
            for j in range(3):
                v = faces[f, j]
                if marks[v] != k:
                    marks[v] = k
                    local[v] = count
                    count += 1
                packed |= np.int64(local[v]) << (8 * j)
            corners[slot] = packed
            face_of[slot] = f
            slot += 1
        slot = (slot + LANES - 1) // LANES * LANES
        vertex += (count + VERTEX_STEP - 1) // VERTEX_STEP * VERTEX_STEP
        line_starts[k + 1] = line
        face_starts[k + 1] = slot
        vertex_starts[k + 1] = vertex


@compiled
def gather_positions(vertices, faces, order, starts, n, marks, vertex_starts, points):
    """Copy vertex positions to their clusters, in the order of the local indices."""
    for k in range(n):
        begin, width = 3 * np.int64(vertex_starts[k]), vertex_starts[k + 1] - vertex_starts[k]
        count = 0
        for i in range(starts[k], starts[k + 1]):
            for j in range(3):
                v = faces[order[i], j]
                if marks[v] != k:
                    marks[v] = k
                    for axis in range(3):
                        points[begin + axis * width + count] = vertices[v, axis]
                    count += 1
        while count < width:
            for axis in range(3):
                at = begin + axis * width + count
                points[at] = points[at - 1]
            count += 1


@part_with_arrays
def difference(vertices, p, q):
    """Vector from vertex q to vertex p."""
    return (
        vertices[p, 0] - vertices[q, 0],
        vertices[p, 1] - vertices[q, 1],
        vertices[p, 2] - vertices[q, 2],
    )


@part_with_arrays
def dot(p, q):
    """Dot product of two vectors."""
    return p[0] * q[0] + p[1] * q[1] + p[2] * q[2]


@compiled
def cluster_bounds(vertices, faces, order, starts, n, vertex_starts, points, bounds):
    """Write sphere, cone of normals, planes and altitudes of clusters, see `Clusters.bounds`."""
    normals = np.empty((FACES, 3))
    for k in range(n):
        begin, width = 3 * np.int64(vertex_starts[k]), vertex_starts[k + 1] - vertex_starts[k]
        for axis in range(3):
            low = high = points[begin + axis * width]
            for i in range(1, width):
                low = min(low, points[begin + axis * width + i])
                high = max(high, points[begin + axis * width + i])
            bounds[axis, k] = 0.5 * (low + high)
        squared = 0.0
        for i in range(width):
            x = points[begin + i] - bounds[0, k]
            y = points[begin + width + i] - bounds[1, k]
            z = points[begin + 2 * width + i] - bounds[2, k]
            squared = max(squared, x * x + y * y + z * z)
        bounds[RADIUS, k] = np.sqrt(squared)
        sum_x = sum_y = sum_z = 0.0
        offset = altitude = np.inf
        for i in range(starts[k], starts[k + 1]):
            a, b, c = faces[order[i], 0], faces[order[i], 1], faces[order[i], 2]
            ab, ac = difference(vertices, b, a), difference(vertices, c, a)
            bc = ac[0] - ab[0], ac[1] - ab[1], ac[2] - ab[2]
            x, y, z = (
                ab[1] * ac[2] - ab[2] * ac[1],
                ab[2] * ac[0] - ab[0] * ac[2],
                ab[0] * ac[1] - ab[1] * ac[0],
            )
            doubled = np.sqrt(x * x + y * y + z * z)
            longest = max(dot(ab, ab), dot(ac, ac), dot(bc, bc))
            altitude = min(altitude, doubled / np.sqrt(longest) if longest > 0 else 0.0)
            scale = 1.0 / doubled if doubled > 0 else 0.0
            x, y, z = x * scale, y * scale, z * scale
            row = normals[i - starts[k]]
            row[0], row[1], row[2] = x, y, z
            sum_x, sum_y, sum_z = sum_x + x, sum_y + y, sum_z + z
            middle = bounds[0, k], bounds[1, k], bounds[2, k]
            corner = vertices[a, 0], vertices[a, 1], vertices[a, 2]
            away = corner[0] - middle[0], corner[1] - middle[1], corner[2] - middle[2]
            offset = min(offset, dot((x, y, z), away))
        length = np.sqrt(sum_x * sum_x + sum_y * sum_y + sum_z * sum_z)
        scale = 1.0 / length if length > 0 else 0.0
        sum_x, sum_y, sum_z = sum_x * scale, sum_y * scale, sum_z * scale
        cosine = 1.0 if length > 0 else -1.0
        for i in range(starts[k + 1] - starts[k]):
            cosine = min(cosine, dot(normals[i], (sum_x, sum_y, sum_z)))
        angle = np.arccos(max(-1.0, cosine)) + 1e-7  # rounding, of cosines near 1 above all
        for axis, value in enumerate((sum_x, sum_y, sum_z)):
            bounds[CONE_AXIS + axis, k] = value
        bounds[CONE_COS, k], bounds[CONE_SIN, k] = np.cos(angle), np.sin(angle)
        bounds[PLANE_OFFSET, k] = offset
        bounds[ALTITUDE, k] = altitude if cosine > 0.01 else 0.0
