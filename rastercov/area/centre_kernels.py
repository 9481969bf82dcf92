"""Cells whose centre a pose covers: criteria point by point and a segment each; by numba.

The criteria are those of `rastercov.area.failures`, without the order of reasons.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov._jit import compiled
from rastercov.mesh.triangle_tree_kernels import LEAF, STACK_SIZE, meets_triangle

FloatArray = NDArray[np.float64]

LEAST_STEP = 1e-12
"""Least component of a direction in the test of a box."""
BOX_MARGIN = 1e-11
"""Growth of boxes on each side in a scene of diagonal 1: more than `LEAST_STEP` moves a point."""


class Centres(NamedTuple):
    """Points in a scene of diagonal 1 about the origin, their unit normals, and their criteria.

    `own` is the triangle of each point in the order of the tree, -1 where it is not in it;
    `two_sided` says whether either side counts.
    """

    points: FloatArray
    normals: FloatArray
    two_sided: NDArray[np.bool_]
    own: NDArray[np.int64]


class PointRules(NamedTuple):
    """Thresholds at a point; lengths relative to the diagonal of the scene.

    `near` is not among them: it differs from pose to pose. `cos_incidence` is 0 without a limit,
    and so are `min_per_m2` and `min_density`.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: float
    height: float
    z_n: float
    z_f: float
    min_per_m2: float
    min_density: float
    cos_incidence: float
    margin: float


@compiled
def meets_one(origin, direction, reach, corners, t, points):
    """True if a segment meets triangle t; `points` (3, 3) is scratch."""
    for corner in range(3):
        for k in range(3):
            points[corner, k] = corners[t, corner, k] - origin[k]
    return meets_triangle(points, direction, reach)


@compiled
def hider_of(origin, direction, reach, own, corners, nodes, stack, points):
    """Some triangle that a segment meets, other than `own`; -1 for none."""
    leaves = nodes.shape[0] // 2
    x, y, z = origin[0], origin[1], origin[2]
    # A direction along an axis has no reciprocal; the box is grown by more than this moves it.
    a = 1.0 / (direction[0] if abs(direction[0]) > LEAST_STEP else LEAST_STEP)
    b = 1.0 / (direction[1] if abs(direction[1]) > LEAST_STEP else LEAST_STEP)
    c = 1.0 / (direction[2] if abs(direction[2]) > LEAST_STEP else LEAST_STEP)
    stack[0], depth = 1, 1
    while depth:
        depth -= 1
        node = stack[depth]
        # Six quotients of `meets_box` as products.
        low, high = (nodes[node, 0] - BOX_MARGIN - x) * a, (BOX_MARGIN - nodes[node, 3] - x) * a
        first, last = min(low, high), max(low, high)
        low, high = (nodes[node, 1] - BOX_MARGIN - y) * b, (BOX_MARGIN - nodes[node, 4] - y) * b
        first, last = max(first, min(low, high)), min(last, max(low, high))
        low, high = (nodes[node, 2] - BOX_MARGIN - z) * c, (BOX_MARGIN - nodes[node, 5] - z) * c
        first, last = max(first, min(low, high)), min(last, max(low, high))
        if first > last or first > reach or last < 0.0 or nodes[node, 0] == np.inf:
            continue
        if node < leaves:
            stack[depth], stack[depth + 1] = 2 * node, 2 * node + 1
            depth += 2
            continue
        first = (node - leaves) * LEAF
        for t in range(first, min(first + LEAF, corners.shape[0])):
            if t != own and meets_one(origin, direction, reach, corners, t, points):
                return t
    return -1


@compiled
def list_covered(centres, rules, corners, nodes, rotation, eye, near, out):
    """List the points that a pose covers, in ascending order; their number.

    Parameters
    ----------
    centres, rules
        Centres; PointRules.
    corners, nodes : (T, 3, 3), (2 L, 6) float64
        Tree of the triangles that hide.
    rotation, eye : (3, 3), (3,) float64
        world_from_camera of the pose; `eye` in the scene of diagonal 1.
    near : float
        Depth of the near plane.
    out : (N,) int32
        Out: rows of the points.
    """
    stack, scratch = np.empty(STACK_SIZE, np.int64), np.empty((3, 3))
    start, d = np.empty(3), np.empty(3)
    points, normals = centres.points, centres.normals
    count, last = 0, -1
    for i in range(points.shape[0]):
        x, y, z = points[i, 0] - eye[0], points[i, 1] - eye[1], points[i, 2] - eye[2]
        depth = x * rotation[0, 2] + y * rotation[1, 2] + z * rotation[2, 2]
        if not (depth >= near and rules.z_n <= depth <= rules.z_f):
            continue
        right = (x * rotation[0, 0] + y * rotation[1, 0] + z * rotation[2, 0]) / depth
        down = (x * rotation[0, 1] + y * rotation[1, 1] + z * rotation[2, 1]) / depth
        u, v = rules.fx * right + rules.cx, rules.fy * down + rules.cy
        if not (0.0 <= u <= rules.width and 0.0 <= v <= rules.height):
            continue
        height = -(x * normals[i, 0] + y * normals[i, 1] + z * normals[i, 2])
        if centres.two_sided[i]:
            height = abs(height)
        if not height > 0.0:
            continue
        length = math.sqrt(x * x + y * y + z * z)
        if height < length * rules.cos_incidence:
            continue
        det = rules.fx * rules.fy * height / (depth * depth * depth)
        if det < rules.min_per_m2:
            continue
        if rules.min_density > 0.0:
            # Squares of both singular values of the map from the plane to the image: their
            # product is det^2, their sum that of the lengths of two rows along the plane.
            n_x, n_y, n_z = 0.0, 0.0, 0.0
            for k in range(3):
                n_x += normals[i, k] * rotation[k, 0]
                n_y += normals[i, k] * rotation[k, 1]
                n_z += normals[i, k] * rotation[k, 2]
            across, along = n_x - right * n_z, n_y - down * n_z
            total = (rules.fx / depth) ** 2 * (1.0 + right * right - across * across)
            total += (rules.fy / depth) ** 2 * (1.0 + down * down - along * along)
            root = math.sqrt(max(total * total - 4.0 * det * det, 0.0))
            if det * det < rules.min_density**2 * 0.5 * (total + root):
                continue
        share = near / depth
        start[0], start[1], start[2] = eye[0] + share * x, eye[1] + share * y, eye[2] + share * z
        d[0], d[1], d[2] = x / length, y / length, z / length
        reach = length * (1.0 - share) - rules.margin
        if reach > 0.0:
            # What hides the point before it often hides this one, too.
            if (
                last >= 0
                and last != centres.own[i]
                and meets_one(start, d, reach, corners, last, scratch)
            ):
                continue
            hider = hider_of(start, d, reach, centres.own[i], corners, nodes, stack, scratch)
            if hider >= 0:
                last = hider
                continue
        out[count] = i
        count += 1
    return count
