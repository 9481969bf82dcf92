"""Surface in front of points, as seen from a camera centre; by numba."""

import numpy as np

from rastercov.kernels.jit import compiled
from rastercov.kernels.mesh_tree import LEAF, STACK_SIZE, meets_box, meets_triangle


@compiled
def first_hits(origins, directions, reaches, corners, nodes, own, hit):
    """Set `hit` to the triangle that each segment meets first, -1 for none.

    As `rastercov.kernels.mesh_tree.hit_segments`, in a scene of diagonal 1 about the
    origin; `own` (N,) are triangles that do not count, in the order of the tree.
    """
    leaves = nodes.shape[0] // 2
    stack = np.empty(STACK_SIZE, np.int64)
    points = np.empty((3, 3))
    for i in range(origins.shape[0]):
        hit[i] = -1
        reach = reaches[i]
        if not reach > 0.0:
            continue
        start, d = origins[i], directions[i]
        stack[0], depth = 1, 1
        while depth:
            depth -= 1
            node = stack[depth]
            if not meets_box(start, d, reach, nodes[node]):
                continue
            if node < leaves:
                stack[depth], stack[depth + 1] = 2 * node, 2 * node + 1
                depth += 2
                continue
            first = (node - leaves) * LEAF
            for t in range(first, min(first + LEAF, corners.shape[0])):
                if t == own[i]:
                    continue
                for corner in range(3):
                    for k in range(3):
                        points[corner, k] = corners[t, corner, k] - start[k]
                if meets_triangle(points, d, reach):
                    # From here on only what is nearer: distance along d to the plane.
                    a = points[1] - points[0]
                    b = points[2] - points[0]
                    x = a[1] * b[2] - a[2] * b[1]
                    y = a[2] * b[0] - a[0] * b[2]
                    z = a[0] * b[1] - a[1] * b[0]
                    slope = x * d[0] + y * d[1] + z * d[2]
                    at = x * points[0, 0] + y * points[0, 1] + z * points[0, 2]
                    hit[i] = t
                    if slope != 0.0:
                        reach = min(reach, max(at / slope, 0.0))
