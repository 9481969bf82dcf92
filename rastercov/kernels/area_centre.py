"""Cells whose centre a pose covers: criteria point by point and a segment each; by numba.

The criteria are those of `rastercov.coverage.area.failures`, without the order of reasons.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.kernels.jit import allocation_free, by_type, compiled, part_with_arrays
from rastercov.kernels.lens import is_valid, jacobian, project
from rastercov.kernels.mesh_tree import LEAF, STACK_SIZE

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


class LensPointRules(NamedTuple):
    """The same through a lens, `code` and `params`.

    Depths along its axis from `z_n` to `z_f` are in focus, and distances from `nearest` to
    `farthest`; one of the two is without limits.
    """

    code: int
    params: FloatArray
    width: float
    height: float
    is_wide: bool
    z_n: float
    z_f: float
    nearest: float
    farthest: float
    min_per_m2: float
    min_density: float
    min_facing: float
    cos_incidence: float
    margin: float


@part_with_arrays
def meets_one(x, y, z, a, b, c, reach, triangles, t):
    """True if a segment from (x, y, z) along the unit vector (a, b, c) meets triangle t."""
    e_x, e_y, e_z = triangles[t, 3], triangles[t, 4], triangles[t, 5]
    f_x, f_y, f_z = triangles[t, 6], triangles[t, 7], triangles[t, 8]
    p_x, p_y, p_z = b * f_z - c * f_y, c * f_x - a * f_z, a * f_y - b * f_x
    det = e_x * p_x + e_y * p_y + e_z * p_z
    s_x, s_y, s_z = x - triangles[t, 0], y - triangles[t, 1], z - triangles[t, 2]
    u = (s_x * p_x + s_y * p_y + s_z * p_z) / det
    is_met = False
    if 0.0 <= u <= 1.0:
        q_x, q_y, q_z = s_y * e_z - s_z * e_y, s_z * e_x - s_x * e_z, s_x * e_y - s_y * e_x
        v = (a * q_x + b * q_y + c * q_z) / det
        if v >= 0.0 and u + v <= 1.0:
            is_met = 0.0 <= (f_x * q_x + f_y * q_y + f_z * q_z) / det <= reach
    return is_met


@compiled
def hider_of(x, y, z, d_x, d_y, d_z, reach, own, triangles, nodes, stack):
    """Some triangle that a segment meets, other than `own`; -1 for none."""
    leaves = nodes.shape[0] // 2
    # A direction along an axis has no reciprocal; the box is grown by more than this moves it.
    a = 1.0 / (d_x if abs(d_x) > LEAST_STEP else LEAST_STEP)
    b = 1.0 / (d_y if abs(d_y) > LEAST_STEP else LEAST_STEP)
    c = 1.0 / (d_z if abs(d_z) > LEAST_STEP else LEAST_STEP)
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
        begin = (node - leaves) * LEAF
        for t in range(begin, min(begin + LEAF, triangles.shape[0])):
            if t != own and meets_one(x, y, z, d_x, d_y, d_z, reach, triangles, t):
                return t
    return -1


def depth_through_lens(rules, rotation, near, x, y, z, normals, i, is_two_sided):
    """The same through a lens, whose near planes are a cube if it is wide."""
    X = x * rotation[0, 0] + y * rotation[1, 0] + z * rotation[2, 0]
    Y = x * rotation[0, 1] + y * rotation[1, 1] + z * rotation[2, 1]
    Z = x * rotation[0, 2] + y * rotation[1, 2] + z * rotation[2, 2]
    depth = max(abs(X), abs(Y), abs(Z)) if rules.is_wide else Z
    length = math.sqrt(x * x + y * y + z * z)
    if not (depth >= near and rules.z_n <= Z <= rules.z_f):
        return 0.0
    if not (rules.nearest <= length <= rules.farthest):
        return 0.0
    height = -(x * normals[i, 0] + y * normals[i, 1] + z * normals[i, 2])
    if is_two_sided:
        height = abs(height)
    if not (height > 0.0 and height >= length * rules.cos_incidence):
        return 0.0
    if not is_valid(rules.params, X, Y, Z):
        return 0.0
    u, v = project_ray(rules.code, rules.params, X, Y, Z)
    if not (0.0 <= u <= rules.width and 0.0 <= v <= rules.height):
        return 0.0
    if rules.min_per_m2 > 0.0 or rules.min_density > 0.0 or rules.min_facing > 0.0:
        n_x = n_y = n_z = 0.0
        for k in range(3):
            n_x += normals[i, k] * rotation[k, 0]
            n_y += normals[i, k] * rotation[k, 1]
            n_z += normals[i, k] * rotation[k, 2]
        per_m2, along, facing = densities_of_ray(rules, X, Y, Z, n_x, n_y, n_z)
        if not (
            per_m2 >= rules.min_per_m2 and along >= rules.min_density and facing >= rules.min_facing
        ):
            return 0.0
    return depth


@allocation_free
def project_ray(code, params, X, Y, Z):
    """Pixel of a ray of the valid region."""
    return project(code, params, X, Y, Z)


@allocation_free
def densities_of_ray(rules, X, Y, Z, n_x, n_y, n_z):
    """Pixels a square metre, a metre along the worst direction, and a metre of a facing target."""
    ux, uy, uz, vx, vy, vz = jacobian(rules.code, rules.params, X, Y, Z)
    uu, vv = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz
    uv = ux * vx + uy * vy + uz * vz
    a, b, c = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    per_m2 = abs(a * n_x + b * n_y + c * n_z)
    # Squares of both singular values: their product is a determinant, their sum a trace.
    largest = 0.5 * (uu + vv + math.sqrt((uu - vv) ** 2 + 4.0 * uv * uv))
    facing = math.sqrt((a * a + b * b + c * c) / largest)
    # In the plane, without the part along its normal.
    un, vn = ux * n_x + uy * n_y + uz * n_z, vx * n_x + vy * n_y + vz * n_z
    uu, vv, uv = uu - un * un, vv - vn * vn, uv - un * vn
    largest = 0.5 * (uu + vv + math.sqrt((uu - vv) ** 2 + 4.0 * uv * uv))
    return per_m2, per_m2 / math.sqrt(largest), facing


@by_type("rules", LensPointRules, depth_through_lens)
def depth_if_met(rules, rotation, near, x, y, z, normals, i, is_two_sided):
    """Depth of a point from the camera if it meets all criteria but occlusion, otherwise 0."""
    depth = x * rotation[0, 2] + y * rotation[1, 2] + z * rotation[2, 2]
    if not (depth >= near and rules.z_n <= depth <= rules.z_f):
        return 0.0
    right = (x * rotation[0, 0] + y * rotation[1, 0] + z * rotation[2, 0]) / depth
    down = (x * rotation[0, 1] + y * rotation[1, 1] + z * rotation[2, 1]) / depth
    u, v = rules.fx * right + rules.cx, rules.fy * down + rules.cy
    if not (0.0 <= u <= rules.width and 0.0 <= v <= rules.height):
        return 0.0
    height = -(x * normals[i, 0] + y * normals[i, 1] + z * normals[i, 2])
    if is_two_sided:
        height = abs(height)
    if not height > 0.0:
        return 0.0
    length = math.sqrt(x * x + y * y + z * z)
    if height < length * rules.cos_incidence:
        return 0.0
    det = rules.fx * rules.fy * height / (depth * depth * depth)
    if det < rules.min_per_m2:
        return 0.0
    if rules.min_density > 0.0:
        # Squares of both singular values of the map from the plane to the image: their product is
        # det^2, their sum that of the lengths of two rows along the plane.
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
            return 0.0
    return depth


@compiled
def list_covered(centres, rules, triangles, nodes, rotation, eye, near, out):
    """List the points that a pose covers, in ascending order; their number.

    Parameters
    ----------
    centres, rules
        Centres; PointRules or LensPointRules.
    triangles, nodes : (T, 9), (2 L, 6) float64
        Tree of the triangles that hide: a corner of each, and the edges from it.
    rotation, eye : (3, 3), (3,) float64
        world_from_camera of the pose; `eye` in the scene of diagonal 1.
    near : float
        Depth of the near plane.
    out : (N,) int32
        Out: rows of the points.
    """
    stack = np.empty(STACK_SIZE, np.int64)
    points, normals = centres.points, centres.normals
    count, last = 0, -1
    for i in range(points.shape[0]):
        x, y, z = points[i, 0] - eye[0], points[i, 1] - eye[1], points[i, 2] - eye[2]
        depth = depth_if_met(rules, rotation, near, x, y, z, normals, i, centres.two_sided[i])
        if not depth > 0.0:
            continue
        length = math.sqrt(x * x + y * y + z * z)
        share = near / depth
        reach = length * (1.0 - share) - rules.margin
        if reach > 0.0:
            at_x, at_y, at_z = eye[0] + share * x, eye[1] + share * y, eye[2] + share * z
            x, y, z = x / length, y / length, z / length
            own = centres.own[i]
            # What hides the point before it often hides this one, too.
            hider = -1
            if last >= 0 and last != own:
                is_met = meets_one(at_x, at_y, at_z, x, y, z, reach, triangles, last)
                hider = last if is_met else -1
            if hider < 0:
                hider = hider_of(at_x, at_y, at_z, x, y, z, reach, own, triangles, nodes, stack)
            if hider >= 0:
                last = hider
                continue
        out[count] = i
        count += 1
    return count
