"""Images of faces through a lens, compiled by numba.

These are the functions of `rastercov.kernels.criteria` for a lens that is no pinhole: the same
arguments, the same results. The area and the field of view come from integrals along the edges.
"""

import math
from collections import namedtuple

import numpy as np
from numpy.typing import NDArray

from rastercov.kernels import lens as kernels
from rastercov.kernels.cameras import (
    AHEAD,
    BEHIND,
    INSIDE,
    STATE,
    CurvedSlopes,
    U,
    V,
    X,
    Y,
    Z,
    jacobian,
)
from rastercov.kernels.exact_polygon import cut_in_space, extent_of
from rastercov.kernels.jit import allocation_free, called_whole, part_with_arrays
from rastercov.kernels.lens_edges import NODES, bulge, nodes_for, point_of
from rastercov.kernels.lens_lanes import GROUP, project_lanes
from rastercov.kernels.lens_planes import PlaneRecord
from rastercov.kernels.lens_polygons import (
    MOST_CORNERS,
    beyond_side_of,
    cut_to_region,
    cut_to_side_of,
    edge_scratch,
    is_in_region,
    polygon_image,
)

FloatArray = NDArray[np.float64]

SLOPES = 8
"""First of six columns of a vertex, behind those of `cameras`: the derivative of the lens,
found when a density asks for it; NaN before."""
OUTSIDE_TOLERANCE = 1e-9
"""Area outside the image, px^2 and relative to the face, up to which a face is inside it."""


CurvedWorkspace = namedtuple(
    "CurvedWorkspace", "points polygon spare corners spare_corners edges block"
)
"""Memory of one thread: the projected vertices (V, 14), polygons of a plane, and a `block`.

The latter is as in `criteria.Workspace`.
"""


def curved_workspace(n_vertices: int, block: FloatArray) -> CurvedWorkspace:
    """Memory for one thread."""
    sizes = [(n_vertices, SLOPES + 6)] + [(MOST_CORNERS, 2)] * 2 + [(MOST_CORNERS, 3)] * 2
    return CurvedWorkspace._make([*(np.empty(size) for size in sizes), edge_scratch(), block])


def project(vertices, pose, near, lens, points):
    """Transform the vertices to camera axes and project those in the valid region of the lens."""
    _project(vertices, pose, near, lens, points)


@called_whole
def _project(vertices, pose, near, lens, points):
    """See `project`, which numba copies into its callers."""
    is_wide = lens.frames.shape[0] > 1
    for i in range(vertices.shape[0]):
        a = vertices[i, 0] - pose[0, 3]
        b = vertices[i, 1] - pose[1, 3]
        c = vertices[i, 2] - pose[2, 3]
        x = a * pose[0, 0] + b * pose[1, 0] + c * pose[2, 0]
        y = a * pose[0, 1] + b * pose[1, 1] + c * pose[2, 1]
        z = a * pose[0, 2] + b * pose[1, 2] + c * pose[2, 2]
        # A wide lens has a cube of near planes.
        depth = max(abs(x), abs(y), abs(z)) if is_wide else z
        state, u, v = BEHIND, math.nan, math.nan
        if depth >= near and kernels.is_valid(lens.params, x, y, z):
            state = AHEAD
            u, v = kernels.project(lens.code, lens.params, x, y, z)
            if 0 <= u <= lens.width and 0 <= v <= lens.height:
                state = INSIDE
        points[i, X], points[i, Y], points[i, Z] = x, y, z
        points[i, U], points[i, V] = u, v
        points[i, STATE], points[i, SLOPES] = state, math.nan


def image_of_face(points, i, j, k, near, lens, work, drawn):
    """Field of view of a face: state of all of it, part of its area in the image, area, px^2.

    The state is that of its worst vertex, but not `INSIDE` where an edge leaves the image. `drawn`
    is the area in the image where that is known; negative otherwise.
    """
    worst = min(points[i, STATE], points[j, STATE], points[k, STATE])
    if worst == INSIDE:
        n, longest2 = _plane_inside(points, i, j, k, near, lens, work.polygon)
        if n >= 0:
            area = drawn if drawn > 0 else _area_inside(points, i, j, k, lens, n, longest2, work)
            if area > 0:
                return worst, 1.0, area
    if worst == BEHIND and _is_out_of_sight(points, i, j, k, near, lens):
        return worst, 0.0, 0.0
    whole, inside = curved_areas(points, i, j, k, near, lens, work)
    if not whole > 0:
        return worst, 0.0, 0.0
    if worst == INSIDE:
        if whole - inside <= OUTSIDE_TOLERANCE * (1.0 + whole):
            return worst, 1.0, whole
        worst = AHEAD
    part = inside / whole
    return worst, min(1.0, max(0.0, part)), whole


@allocation_free
def _plane_inside(points, i, j, k, near, lens, polygon):
    """Plane that has all of a face whose image stays inside, and its longest edge squared.

    -1 where an edge may leave the image, or the face a plane. A line of length L in a plane leaves
    its chord in the image by at most bend L^2 / 8. `polygon` has the face in the plane.
    """
    low_u = min(points[i, U], points[j, U], points[k, U])
    high_u = max(points[i, U], points[j, U], points[k, U])
    low_v = min(points[i, V], points[j, V], points[k, V])
    high_v = max(points[i, V], points[j, V], points[k, V])
    for n in range(lens.frames.shape[0]):
        if _lay_in_plane(points, i, j, k, near, lens, n, polygon):
            longest2 = max(
                _length2(polygon, 0, 1), _length2(polygon, 1, 2), _length2(polygon, 2, 0)
            )
            stray = lens.bends[n] * longest2 / 8
            is_inside = (
                low_u >= stray
                and low_v >= stray
                and high_u <= lens.width - stray
                and high_v <= lens.height - stray
            )
            return n if is_inside else -1, longest2
    return -1, math.inf


@part_with_arrays
def _length2(polygon, p, q):
    """Squared distance of two corners."""
    x, y = polygon[p, 0] - polygon[q, 0], polygon[p, 1] - polygon[q, 1]
    return x * x + y * y


@called_whole
def _area_inside(points, i, j, k, lens, n, longest2, work):
    """Area of the image of a face that is all in plane n, px^2: its triangle and three bulges.

    0 where its longest edge is too long for one rule, on a plane with a pole, and where the image
    has no area.
    """
    frame, longest = lens.frames[n], lens.longest[n]
    rule, parts = nodes_for(0.5 * math.sqrt(longest2), longest, lens.parts_of[n])
    if parts > 1 or lens.is_graded[n]:
        return 0.0
    x, y, z, u, v = work.edges.x, work.edges.y, work.edges.z, work.edges.u, work.edges.v
    U_, V_, inner = work.edges.U, work.edges.V, rule - 1
    nodes, polygon = 3 * inner, work.polygon
    for p in range(3):
        q, at = p + 1 if p < 2 else 0, p * inner
        edge = (polygon[p, 0], polygon[p, 1], polygon[q, 0], polygon[q, 1])
        for m in range(inner):
            x[at + m], y[at + m] = point_of(edge, NODES[rule, inner - m], NODES[rule, m + 1])
    for m in range(nodes, nodes + GROUP):
        x[m], y[m] = x[0], y[0]
    project_lanes(lens.code, lens.own_params[n], frame, x, y, z, nodes, u, v)
    u0, v0 = points[i, U], points[i, V]
    u1, v1, u2, v2 = points[j, U], points[j, V], points[k, U], points[k, V]
    area = 0.5 * ((u1 - u0) * (v2 - v0) - (u2 - u0) * (v1 - v0))
    for s in range(3):
        p, q = (i, j) if s == 0 else (j, k) if s == 1 else (k, i)
        U_[0], V_[0], U_[rule], V_[rule] = points[p, U], points[p, V], points[q, U], points[q, V]
        for m in range(1, rule):
            U_[m], V_[m] = u[s * inner + m - 1], v[s * inner + m - 1]
        area += bulge(rule, U_, V_)
    return abs(area)


@part_with_arrays
def _lay_in_plane(points, i, j, k, near, lens, n, polygon):
    """Fill `polygon` with a face in a plane, in its units; False where some of it is not there.

    The valid vertices of a lens with one plane are in it.
    """
    least, is_one = math.inf, lens.frames.shape[0] == 1
    for s in range(3):
        p = i if s == 0 else j if s == 1 else k
        x, y, z = _turned(points, p, lens.frames[n])
        polygon[s, 0], polygon[s, 1] = x / z, y / z
        least = min(least, z)
    if is_one or not least > 0:
        return least > 0
    if least < near or lens.hole_sides[n] > 0:
        return False
    return is_in_region(polygon, 3, lens.regions[n, : lens.region_sides[n]])


@allocation_free
def _is_out_of_sight(points, i, j, k, near, lens):
    """True where all of a face is before the near plane, or beyond one side, in every plane."""
    for n in range(lens.frames.shape[0]):
        frame = lens.frames[n]
        sides = lens.region_sides[n]
        low_x, high_x, low_y, high_y = extent_of(lens.regions[n], sides)
        before = left = right = above = below = True
        for s in range(3):
            p = i if s == 0 else j if s == 1 else k
            x, y, z = _turned(points, p, frame)
            before = before and z < near
            left, right = left and x < low_x * z, right and x > high_x * z
            above, below = above and y < low_y * z, below and y > high_y * z
        if not (before or left or right or above or below):
            return False
    return True


@allocation_free
def _turned(points, p, frame):
    """Vertex in the axes of a plane."""
    a, b, c = points[p, X], points[p, Y], points[p, Z]
    return (
        frame[0, 0] * a + frame[1, 0] * b + frame[2, 0] * c,
        frame[0, 1] * a + frame[1, 1] * b + frame[2, 1] * c,
        frame[0, 2] * a + frame[1, 2] * b + frame[2, 2] * c,
    )


@allocation_free
def _with_image(plane, polygon, n, edges, whole, inside):
    """Sums of areas, and of those inside the image, with those of one more polygon."""
    area, part, _ = polygon_image(plane, polygon, 0, n, edges, True)
    sign = -1.0 if area < 0 else 1.0
    return whole + sign * area, inside + sign * part


@called_whole
def curved_areas(points, i, j, k, near, lens, work):
    """Area of the image of a face in the valid region, and of its part in the image, px^2."""
    whole = inside = 0.0
    corners, spare, polygon = work.corners, work.spare_corners, work.polygon
    for n in range(lens.frames.shape[0]):
        for s in range(3):
            p = i if s == 0 else j if s == 1 else k
            corners[s, 0], corners[s, 1], corners[s, 2] = _turned(points, p, lens.frames[n])
        m = cut_in_space(corners, np.int64(3), 0.0, 0.0, 1.0, near, spare)
        if m < 3:
            continue
        for p in range(m):
            polygon[p, 0] = corners[p, 0] / corners[p, 2]
            polygon[p, 1] = corners[p, 1] / corners[p, 2]
        plane = PlaneRecord(
            lens.code, lens.own_params[n], lens.frames[n], 1.0, 1.0, 0.0, 0.0,
            lens.regions[n, : lens.region_sides[n]], lens.holes[n, : lens.hole_sides[n]],
            lens.regions[n, : lens.region_sides[n]], lens.longest[n], lens.parts_of[n],
            lens.is_graded[n], lens.width, lens.height, lens.bends[n], 1.0, 1.0, lens.tolerance,
        )  # fmt: skip
        m = cut_to_region(polygon, m, plane.region, work.spare)
        if m < 3:
            continue
        sides = lens.hole_sides[n]
        if sides == 0:
            whole, inside = _with_image(plane, polygon, m, work.edges, whole, inside)
        for side in range(sides):  # what is outside the hole, as in `exact_lens.append_cut`
            beyond = beyond_side_of(polygon, m, plane.hole, side, work.spare)
            if beyond >= 3:
                whole, inside = _with_image(plane, work.spare, beyond, work.edges, whole, inside)
            m = cut_to_side_of(polygon, m, plane.hole, side, work.spare)
            if m < 3:
                break
    return whole, inside


def slopes_at(points, p, lens):
    """Derivative of the lens at a vertex in its valid region; six faces share a vertex."""
    if math.isnan(points[p, SLOPES]):
        ux, uy, uz, vx, vy, vz = jacobian(lens, points[p, X], points[p, Y], points[p, Z])
        points[p, SLOPES], points[p, SLOPES + 1], points[p, SLOPES + 2] = ux, uy, uz
        points[p, SLOPES + 3], points[p, SLOPES + 4], points[p, SLOPES + 5] = vx, vy, vz
    return CurvedSlopes(
        points[p, SLOPES], points[p, SLOPES + 1], points[p, SLOPES + 2],
        points[p, SLOPES + 3], points[p, SLOPES + 4], points[p, SLOPES + 5],
    )  # fmt: skip
