"""Compiled loop that grows segments over a mesh.

A face joins when its normal is within an angle of every normal of the segment. The directions
within less than 90 degrees of a direction form a convex set on the sphere, so it contains all
normals of the segment if it contains the corners of their spherical convex hull: only those are
tested. Projected from the centre on the tangent plane at the first normal (gnomonic projection)
great circles are lines, and the hull is that of points in a plane. Their coordinates are integers,
in units of 2^-24 of the radius of the angle on that plane, and their hull is exact. The error is
the rounding to integers, at most 6e-8 tan(angle) radians; finer units would turn points on a line
or a flat arc into corners.

E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. 2020, (6.1), (6.2).
A. M. Andrew. Another Efficient Algorithm for Convex Hulls in Two Dimensions. 1979.
"""

import numpy as np
from numpy.typing import NDArray

from rastercov.kernels.jit import compiled

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

TASK, PASSED, BARRIER = 0, 1, 2
"""Role of a face in growing: labelled, passed through, or a barrier."""
UNITS = float(2**24)
"""Grid units per radius. Up to 2^28, cross products of differences fit 64 bits."""


@compiled
def turn(hull: IntArray, i: int, j: int, x: int, y: int) -> int:
    """Twice the area of the triangle of corners i and j and a point; positive to their left."""
    left = (hull[j, 0] - hull[i, 0]) * (y - hull[i, 1])
    right = (hull[j, 1] - hull[i, 1]) * (x - hull[i, 0])
    return left - right  # type: ignore[no-any-return] # numpy's item


@compiled
def holds(hull: IntArray, count: int, x: int, y: int) -> bool:
    """True where a point lies in a hull with an area, border included."""
    if count < 3:
        return False
    for i in range(count):  # noqa: SIM110 - numba compiles no generators
        if turn(hull, i, i + 1 if i + 1 < count else 0, x, y) < 0:
            return False
    return True


@compiled
def extend(hull: IntArray, count: int, x: int, y: int, face: int) -> int:
    """Number of corners of the hull after a point is added.

    `hull`, (N, 3) int64, has two coordinates and the face of each of `count` corners, in
    anticlockwise order; it is changed, and needs two rows more than there will be corners.
    """
    points = np.empty((count + 1, 3), np.int64)
    points[:count] = hull[:count]
    points[count, 0], points[count, 1], points[count, 2] = x, y, face
    points = points[np.argsort(points[:, 1], kind="mergesort")]
    points = points[np.argsort(points[:, 0], kind="mergesort")]
    size = 0
    for side in range(2):  # from left to right below, then back above
        start = size
        for step in range(count + 1):
            i = step if side == 0 else count - step
            p, q = points[i, 0], points[i, 1]
            while size - start >= 2 and turn(hull, size - 2, size - 1, p, q) <= 0:
                size -= 1
            hull[size] = points[i]
            size += 1
        size -= 1  # the last of each row is the first of the other
    if size == 2 and hull[0, 0] == hull[1, 0] and hull[0, 1] == hull[1, 1]:
        return 1
    return max(size, 1)


@compiled
def grow_segments(
    normals: FloatArray,
    role: NDArray[np.uint8],
    starts: IntArray,
    neighbours: IntArray,
    least_cosine: float,
    radius: float,
    labels: IntArray,
) -> int:
    """Grow segments over shared edges, each from the first unlabelled face; their number.

    Parameters
    ----------
    normals : (F, 3) float64
        Unit normals.
    role : (F,) uint8
        `TASK`, `PASSED` or `BARRIER`.
    starts : (F + 1,) int64
        Start of the row of each face in `neighbours`.
    neighbours : (N,) int64
        Faces across the edges of each face.
    least_cosine, radius : float
        Cosine of the largest angle, > 0, and its tangent, > 0.
    labels : (F,) int64
        Out: segment of each face, -1 for barriers; a passed face has the first segment that passed
        through it.
    """
    n_faces = len(role)
    queue = np.empty(n_faces, np.int64)
    refused = np.full(n_faces, -1, np.int64)  # last segment that rejected each face
    hull = np.empty((n_faces + 3, 3), np.int64)
    labels[:] = -1
    n_segments = 0
    for seed in range(n_faces):
        if role[seed] != TASK or labels[seed] >= 0:
            continue
        # Two axes of the tangent plane at the first normal n.
        n = normals[seed]
        small = np.argmin(np.abs(n))
        u = -n[small] * n
        u[small] += 1.0
        u /= np.sqrt((u * u).sum())
        v = np.array(
            (n[1] * u[2] - n[2] * u[1], n[2] * u[0] - n[0] * u[2], n[0] * u[1] - n[1] * u[0])
        )
        count = extend(hull, 0, 0, 0, seed)
        labels[seed] = n_segments
        queue[0], begin, end = seed, 0, 1
        while begin < end:
            face = queue[begin]
            begin += 1
            for at in range(starts[face], starts[face + 1]):
                other = neighbours[at]
                if role[other] == BARRIER or labels[other] >= 0 or refused[other] == n_segments:
                    continue
                if role[other] == TASK:
                    m = normals[other]
                    along = m[0] * n[0] + m[1] * n[1] + m[2] * n[2]
                    fits = along >= least_cosine
                    for i in range(count):
                        if not fits:
                            break
                        k = normals[hull[i, 2]]
                        fits = m[0] * k[0] + m[1] * k[1] + m[2] * k[2] >= least_cosine
                    if not fits:
                        refused[other] = n_segments
                        continue
                    unit = UNITS / (radius * along)
                    x = np.int64(np.rint(unit * (m[0] * u[0] + m[1] * u[1] + m[2] * u[2])))
                    y = np.int64(np.rint(unit * (m[0] * v[0] + m[1] * v[1] + m[2] * v[2])))
                    if not holds(hull, count, x, y):
                        count = extend(hull, count, x, y, other)
                labels[other] = n_segments
                queue[end] = other
                end += 1
        n_segments += 1
    return n_segments
