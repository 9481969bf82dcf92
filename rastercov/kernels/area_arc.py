"""The incidence criterion in the plane of a face: inside a regular polygon in a circle; by numba.

The angle of incidence is at most theta within h tan(theta) of the foot of the camera's
perpendicular, h being its height above the plane. The disc is replaced by the regular polygon of N
corners inscribed in it, whose corners lie in directions that depend on the camera and the plane
alone, so that it does not matter how the plane is cut into faces. The area between the chords and
the arc goes into the bound.

A piece is taken apart from the inside outwards: what lies within 8 chords is covered; beyond each
chord only the rectangle around its segment of the circle is looked at again, with 8 chords of its
own, down to the sides of the polygon.
"""

import math

import numpy as np

from rastercov.kernels.area_density import append_dense
from rastercov.kernels.area_plane import (
    ERROR,
    FOOT_X,
    FOOT_Y,
    HEIGHT,
    NORMAL,
    STACK_ROOM,
    X_AXIS,
    Y_AXIS,
    length2,
    perimeter_of,
    push_parts,
)
from rastercov.kernels.exact_polygon import copy_polygon, keep_inside, twice_area
from rastercov.kernels.exact_records import U, V
from rastercov.kernels.jit import allocation_free, part_with_arrays

CHORDS = 8
"""Chords that an arc is divided by at a time."""
FEWEST_CHORDS, MOST_CHORDS = 16, 1 << 20
"""Corners of the polygon in the circle."""


@part_with_arrays
def anchor(plane):
    """Direction in the plane of a face that the polygon's first corner lies in, (x, y).

    A tangent of the plane, in camera axes: continuous except for a plane seen exactly from behind.
    """
    x, y, z = plane[NORMAL], plane[NORMAL + 1], plane[NORMAL + 2]
    if plane[HEIGHT] < 0:
        x, y, z = -x, -y, -z
    a = 1.0 / max(1.0 - z, 1e-9)
    first = 1.0 - x * x * a
    second = -x * y * a
    along = first * plane[X_AXIS] + second * plane[X_AXIS + 1] + x * plane[X_AXIS + 2]
    across = first * plane[Y_AXIS] + second * plane[Y_AXIS + 1] + x * plane[Y_AXIS + 2]
    size = length2(along, across)
    return along / size, across / size


@part_with_arrays
def corner_of_circle(k, n, plane, radius, towards):
    """Corner k of the polygon of n corners in the circle."""
    angle = 2 * math.pi * k / n
    c, s = radius * math.cos(angle), radius * math.sin(angle)
    x = plane[FOOT_X] + (c * towards[0] - s * towards[1])
    y = plane[FOOT_Y] + (c * towards[1] + s * towards[0])
    return x, y


@part_with_arrays
def cap_of_chord(part, n, x0, y0, x1, y1, height, out, spare):
    """Part of a polygon in the rectangle beyond a chord that holds its segment; corner count.

    The segment must be less than half of the circle, `height` its greatest distance from the chord.
    """
    dx, dy = x1 - x0, y1 - y0
    # Beyond the chord, between its ends, and not beyond the tangent.
    n = keep_inside(part, n, (x0, y0, -dx, -dy, 0.0), spare)
    if n >= 3:
        n = keep_inside(spare, n, (x0, y0, dy, -dx, 0.0), out)
    if n >= 3:
        n = keep_inside(out, n, (x1, y1, -dy, dx, 0.0), spare)
    if n >= 3:
        size = length2(dx, dy)
        n = keep_inside(spare, n, (x0, y0, dx, dy, height * size), out)
    return n if n >= 3 else 0


@allocation_free
def append_within_angle(face, polygon, n, slope, criteria, scratch, out):
    """Append the part of a polygon within the largest angle of incidence.

    Parameters
    ----------
    face : int
        The face.
    polygon, n
        Convex, in the plane of the face.
    slope : float
        Tangent of the largest angle; 0 for no limit.
    criteria, scratch, out
        Criteria; Scratch, with the face in `plane`; Found, to whose bound the area is added that
        the polygon in the circle leaves undecided.
    """
    plane, caps, arcs, part = scratch.plane, scratch.caps, scratch.arcs, scratch.inner
    if slope == 0:
        append_dense(face, polygon, n, criteria, scratch, out)
        return
    height, error = abs(plane[HEIGHT]), plane[ERROR]
    radius = height * slope
    error *= 2 + slope
    wanted = math.pi * math.sqrt(radius / (2 * criteria.gap))
    n_chords = np.int64(min(max(math.ceil(wanted), FEWEST_CHORDS), MOST_CHORDS))
    inner = radius * math.cos(math.pi / n_chords)
    farthest = 0.0
    for p in range(n):
        away = length2(polygon[p, U] - plane[FOOT_X], polygon[p, V] - plane[FOOT_Y])
        farthest = max(farthest, away)
    if farthest < inner - error:
        append_dense(face, polygon, n, criteria, scratch, out)
        return
    towards = anchor(plane)
    top = push_parts(polygon, n, caps)
    for p in range(top):
        arcs[p, 0], arcs[p, 1] = 0, n_chords
    while top > 0:
        top -= 1
        start, end, n = arcs[top, 0], arcs[top, 1], caps.n_corners[top]
        copy_polygon(caps.corners[top], n, part)
        area = max(twice_area(part, n) / 2, 0.0)
        if end - start == 1:
            out.bound[face] += area + error * perimeter_of(part, n)
            continue
        if top + CHORDS > STACK_ROOM or not area > 0:
            out.bound[face] += area
            continue
        n_parts = min(CHORDS, end - start)
        copy_polygon(part, n, scratch.other)
        m = n
        x0, y0 = corner_of_circle(start, n_chords, plane, radius, towards)
        for c in range(n_parts):
            first = start + (end - start) * c // n_parts
            last = start + (end - start) * (c + 1) // n_parts
            x1, y1 = corner_of_circle(last, n_chords, plane, radius, towards)
            over = radius * (1 - math.cos(math.pi * (last - first) / n_chords)) + error
            k = cap_of_chord(part, n, x0, y0, x1, y1, over, caps.corners[top], scratch.spare)
            if k >= 3:
                caps.n_corners[top] = k
                arcs[top, 0], arcs[top, 1] = first, last
                top += 1
            if m >= 3:
                m = keep_inside(scratch.other, m, (x0, y0, x1 - x0, y1 - y0, 0.0), scratch.spare)
                copy_polygon(scratch.spare, m, scratch.other)
            x0, y0 = x1, y1
        if m >= 3:
            append_dense(face, scratch.other, m, criteria, scratch, out)
