"""Pixel density of faces through a lens by its derivative at their vertices, compiled by numba.

These are the functions of `rastercov.kernels.criteria` for a lens that is no pinhole: the same
arguments, the same results.
"""

import math

from rastercov.kernels import lens as kernels
from rastercov.kernels.jit import called_whole, part_of, part_with_arrays
from rastercov.kernels.vertex_columns import BEHIND, STATE, X, Y, Z

SLOPES = 8
"""First of six columns of a vertex, behind those of `vertex_columns`: the derivative of the lens,
found when a density asks for it; NaN before."""


def pixel_density(points, i, j, k, normal, lens):
    """Least singular value of the derivative of the lens in the face's plane, px/m.

    The result is the worst of the vertices.
    """
    worst = math.inf
    for s in range(3):
        p = i if s == 0 else j if s == 1 else k
        least = _density(_slopes_at(points, p, lens), normal[0], normal[1], normal[2])
        if not least >= worst:
            worst = least
    return worst


@part_with_arrays
def _slopes_at(points, p, lens):
    """Derivative of the lens at a vertex, see `kernels.jacobian`; six faces share a vertex."""
    if math.isnan(points[p, SLOPES]):
        _find_slopes(points, p, lens.code, lens.params)
    return (
        points[p, SLOPES], points[p, SLOPES + 1], points[p, SLOPES + 2],
        points[p, SLOPES + 3], points[p, SLOPES + 4], points[p, SLOPES + 5],
    )  # fmt: skip


@called_whole
def _find_slopes(points, p, code, params):
    """Put the derivative of the lens at a vertex into its row."""
    ux, uy, uz, vx, vy, vz = kernels.jacobian(
        code, params, points[p, X], points[p, Y], points[p, Z]
    )
    points[p, SLOPES], points[p, SLOPES + 1], points[p, SLOPES + 2] = ux, uy, uz
    points[p, SLOPES + 3], points[p, SLOPES + 4], points[p, SLOPES + 5] = vx, vy, vz


@called_whole
def density_of_ray(lens, X_, Y_, Z_, x, y, z):
    """Least singular value of J (e_1 e_2), px/m.

    J is the (2, 3) derivative of pixels at the point (X_, Y_, Z_) in camera axes, and e_1, e_2 are
    tangents of a plane with the normal (x, y, z).
    """
    return _density(kernels.jacobian(lens.code, lens.params, X_, Y_, Z_), x, y, z)


@part_of
def _density(slopes, x, y, z):
    """Density by the derivative of a lens, in a plane with the normal (x, y, z)."""
    sign = math.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    ux, uy, uz, vx, vy, vz = slopes
    first = 1 + sign * x * x * a, sign * b, -sign * x
    second = b, sign + y * y * a, -y
    return _least_singular(
        ux * first[0] + uy * first[1] + uz * first[2],
        ux * second[0] + uy * second[1] + uz * second[2],
        vx * first[0] + vy * first[1] + vz * first[2],
        vx * second[0] + vy * second[1] + vz * second[2],
    )


@part_of
def _least_singular(a1, a2, b1, b2):
    """Least singular value of ((a1, a2), (b1, b2))."""
    total = a1 * a1 + a2 * a2 + b1 * b1 + b2 * b2
    det = abs(a1 * b2 - a2 * b1)
    gap = total * total - 4 * (det * det)
    greatest = math.sqrt((total + math.sqrt(gap if gap > 0 else 0.0)) / 2)
    return det / greatest if greatest > 0 else 0.0


def facing_density(points, i, j, k, lens):
    """Pixels a metre, worst direction, of a target that faces the camera at the worst vertex.

    The least singular value of the derivative J: J is 0 along the ray, so that is its least in the
    plane perpendicular to it. 0 for a face not wholly in the valid region.
    """
    if min(points[i, STATE], points[j, STATE], points[k, STATE]) == BEHIND:
        return 0.0
    worst = math.inf
    for s in range(3):
        p = i if s == 0 else j if s == 1 else k
        ux, uy, uz, vx, vy, vz = _slopes_at(points, p, lens)
        # Eigenvalues of J J^T.
        uu, vv = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz
        uv = ux * vx + uy * vy + uz * vz
        gap = math.sqrt((uu - vv) * (uu - vv) + 4 * uv * uv)
        det = uu * vv - uv * uv
        largest = (uu + vv + gap) / 2
        least = math.sqrt(max(det, 0.0) / largest) if largest > 0 else 0.0
        worst = min(worst, least)
    return worst


def pixels_per_m2(points, i, j, k, normal, lens):
    """Pixels on a square metre of a face at the vertex where they are fewest.

    |J_u x J_v . n|, J_u and J_v the rows of the derivative; 0 outside the valid region.
    """
    if min(points[i, STATE], points[j, STATE], points[k, STATE]) == BEHIND:
        return 0.0
    worst = math.inf
    for s in range(3):
        p = i if s == 0 else j if s == 1 else k
        ux, uy, uz, vx, vy, vz = _slopes_at(points, p, lens)
        det = (
            (uy * vz - uz * vy) * normal[0]
            + (uz * vx - ux * vz) * normal[1]
            + (ux * vy - uy * vx) * normal[2]
        )
        worst = min(worst, abs(det))
    return worst
