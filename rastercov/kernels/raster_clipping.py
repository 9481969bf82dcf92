"""Clipping of faces at the near plane and at the guard band.

I. Sutherland and G. Hodgman. Reentrant Polygon Clipping. 1974.
"""

import numpy as np

from rastercov.kernels.jit import compiled, part_of
from rastercov.kernels.raster_memory import (
    BUFFER_SIZE,
    CLIP_CORNERS,
    EYE,
    GUARD_BAND,
    INTRINSICS,
    NEAR,
    STEPS,
    VERTICES,
    Plane,
)
from rastercov.kernels.simd_kernel import offset

REACH = 0.99 * GUARD_BAND / STEPS
"""Samples from the origin of the canvas beyond which faces are clipped."""


@part_of
def _height(corners, i, normal, offset):
    """Value of normal . p - offset at corner i."""
    x, y, z = corners[3 * i], corners[3 * i + 1], corners[3 * i + 2]
    return normal[0] * x + normal[1] * y + normal[2] * z - offset


@compiled
def clip(corners, n, normal, offset, out):
    """Keep the part of a convex polygon where normal . p >= offset; returns its corner count.

    A cut is always computed from the corner inside to the corner outside, so two faces that share
    an edge cut it at the same point, bit for bit.
    """
    kept = 0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        here = _height(corners, i, normal, offset)
        there = _height(corners, j, normal, offset)
        if here >= 0:
            if kept == CLIP_CORNERS:
                return kept
            for k in range(3):
                out[3 * kept + k] = corners[3 * i + k]
            kept += 1
        if (here >= 0) != (there >= 0):
            if kept == CLIP_CORNERS:
                return kept
            p, q = (i, j) if here >= 0 else (j, i)
            inside, beyond = (here, there) if here >= 0 else (there, here)
            t = inside / (inside - beyond)
            for k in range(3):
                out[3 * kept + k] = corners[3 * p + k] + t * (
                    corners[3 * q + k] - corners[3 * p + k]
                )
            kept += 1
    return kept


@part_of
def clip_to_guard_band(polygon, n, lens, out):
    """Clip `out`, of n corners, to |u| and |v| of at most `REACH` samples; returns their number.

    `lens` has fx, fy, cx, cy in samples; `polygon` is overwritten.
    """
    is_far = False
    for axis in range(2):
        for i in range(n):
            position = lens[axis] * out[3 * i + axis] + lens[2 + axis] * out[3 * i + 2]
            is_far |= abs(position) > REACH * out[3 * i + 2]
    for side in range(4 if is_far else 0):
        # |u| <= REACH, |v| <= REACH: +-(f x + c z) <= REACH z
        sign, axis = 1.0 - 2.0 * (side & 1), side >> 1
        across, along = sign * lens[axis], sign * lens[2 + axis] + REACH
        normal = (across, 0.0, along) if axis == 0 else (0.0, across, along)
        for i in range(3 * n):
            polygon[i] = out[i]
        n = clip(polygon, n, normal, 0.0, out)
    return n


@compiled
def plane_of(corners, lens):
    """Plane of 1/z of a face with these corners, not finite where it contains the camera centre.

    1/z = n . r / (n . a) is affine in the image. Corners of a face cut at the near plane can be
    much nearer than the part in camera that a plane through them has lost half of its digits.
    """
    ax, ay, az = corners[0], corners[1], corners[2]
    ab_x, ab_y, ab_z = corners[3] - ax, corners[4] - ay, corners[5] - az
    ac_x, ac_y, ac_z = corners[6] - ax, corners[7] - ay, corners[8] - az
    x, y, z = ab_y * ac_z - ab_z * ac_y, ab_z * ac_x - ab_x * ac_z, ab_x * ac_y - ab_y * ac_x
    height = x * ax + y * ay + z * az
    slope_x, slope_y = x / (height * lens[0]), y / (height * lens[1])
    origin = z / height + slope_x * (0.5 - lens[2]) + slope_y * (0.5 - lens[3])
    return Plane(origin, slope_x, slope_y)


@compiled
def clip_face(mesh, cluster, packed, camera, window, vertices, polygon, out):
    """Clip a face to the half space beyond the near plane and to the guard band.

    The corners follow the vertices of the cluster, from `VERTICES` on. Returns their number, and
    the plane of 1/z of the whole face.
    """
    stride = cluster.end_vertex - cluster.first_vertex
    for i in range(3):
        vertex = 3 * cluster.first_vertex + (packed >> (8 * i) & (BUFFER_SIZE - 1))
        x = mesh.points[vertex] - camera[EYE]
        y = mesh.points[vertex + stride] - camera[EYE + 1]
        z = mesh.points[vertex + 2 * stride] - camera[EYE + 2]
        for k in range(3):
            polygon[3 * i + k] = x * camera[k] + y * camera[3 + k] + z * camera[6 + k]
    lens = offset(camera, INTRINSICS)
    plane = plane_of(polygon, lens)
    n = clip(polygon, 3, (0.0, 0.0, 1.0), camera[NEAR], out)
    # Beyond the border of the window nothing covers a sample.
    lows, highs = (0.0, float(window.top)), (window.right + 1.0, window.bottom + 1.0)
    for axis in range(2):
        n_below, n_above = 0, 0
        for i in range(n):
            z = out[3 * i + 2]
            position = lens[axis] * out[3 * i + axis] + lens[2 + axis] * z
            n_below += position < lows[axis] * z
            n_above += position > highs[axis] * z
        if n_below == n or n_above == n:
            return 0, plane
    n = clip_to_guard_band(polygon, n, lens, out)
    for i in range(n):
        to = VERTICES + i
        w = 1.0 / out[3 * i + 2]
        u = (lens[0] * out[3 * i] * w + lens[2]) * STEPS
        v = (lens[1] * out[3 * i + 1] * w + lens[3]) * STEPS
        vertices.u[to], vertices.v[to], vertices.w[to] = u, v, w
        vertices.x[to], vertices.y[to] = np.floor(u + 0.5), np.floor(v + 0.5)
    return n, plane


@compiled
def clip_and_triangulate(mesh, slot, cluster, camera, window, vertices, fan, polygon, out):
    """Write the triangles of a clipped face to `fan`; returns their number and the face's plane."""
    packed = mesh.corners[slot]
    n, plane = clip_face(mesh, cluster, packed, camera, window, vertices, polygon, out)
    for k in range(n - 2):
        fan.corners[k] = VERTICES | (VERTICES + k + 1) << 8 | (VERTICES + k + 2) << 16
        fan.faces[k] = mesh.faces[slot]
    return max(n - 2, 0), plane
