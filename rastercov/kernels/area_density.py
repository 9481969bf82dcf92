"""The pixel density criterion in the plane of a face, decided piece by piece; by numba.

A step d (px) in the image moves the point P of the plane by M d, with P = z r on the ray r and

    M = z (D + P m^T / h),   D = diag(1/fx, 1/fy) over 0,   m = D^T n,   h = -n . P,

in camera axes. The density along the worst direction is 1 / |M|, |M| the largest singular value, so
that the criterion is |B| <= w^2 / rho with w = 1/z and B = w (D + P m^T / h) = M w^2. In the image
w and B are affine, hence |B| is convex, and so is w^2. At a point of a piece, with its w_0, and the
singular vectors u, v of its B,

    |B| <= (2 w_0 w - w_0^2) / rho   implies   |B| <= w^2 / rho   (a tangent lies below a parabola),
    u . B v > w^2 / rho              implies   |B| >  w^2 / rho.

Each is a convex function of at most 0: it holds in a piece if it holds at the corners. Both differ
from the criterion by the square of the distance from the point. A piece that is neither inside nor
outside is cut by a chord of the first region and one of the second. What is between them is halved
until its area is less than `Criteria.gap` times its length; then it goes into the bound.
"""

import math

from rastercov.kernels.area_plane import (
    COINCIDENT_REL,
    ERROR,
    HEIGHT,
    LONGEST,
    NORMAL,
    ORIGIN,
    STACK_ROOM,
    X_AXIS,
    Y_AXIS,
    append_piece,
    length2,
    push_parts,
)
from rastercov.kernels.exact_polygon import copy_polygon, keep_inside, twice_area
from rastercov.kernels.exact_records import U, V
from rastercov.kernels.jit import allocation_free, part_with_arrays

BISECTIONS = 24
"""Halvings of a side to find a point of it that a test accepts."""
MOST_HALVINGS = 48
"""Halvings of a piece, after which it is undecided."""
MARGIN_REL = 1e-12
"""Greater than the rounding of both sides of either test."""


@part_with_arrays
def image_of(x, y, plane, criteria):
    """W = 1/z and the columns of B at a point of the plane, (b11, b21, b31), (b12, b22, b32)."""
    p0 = plane[ORIGIN] + x * plane[X_AXIS] + y * plane[Y_AXIS]
    p1 = plane[ORIGIN + 1] + x * plane[X_AXIS + 1] + y * plane[Y_AXIS + 1]
    p2 = plane[ORIGIN + 2] + x * plane[X_AXIS + 2] + y * plane[Y_AXIS + 2]
    w, h = 1 / p2, plane[HEIGHT]
    m1, m2 = plane[NORMAL] / criteria.lens.fx / h, plane[NORMAL + 1] / criteria.lens.fy / h
    first = w * (1 / criteria.lens.fx + p0 * m1), w * (p1 * m1), w * (p2 * m1)
    second = w * (p0 * m2), w * (1 / criteria.lens.fy + p1 * m2), w * (p2 * m2)
    return w, first, second


@part_with_arrays
def dot(a, b):
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@part_with_arrays
def largest_singular(first, second):
    """Largest singular value of a matrix of two columns, and its right vector."""
    a, b, c = dot(first, first), dot(first, second), dot(second, second)
    half, apart = (a + c) / 2, (a - c) / 2
    root = math.sqrt(apart * apart + b * b)
    # The eigenvector of (a b; b c): (root + apart, b) or (b, root - apart), the longer.
    x, y = (root + apart, b) if apart >= 0 else (b, root - apart)
    size = length2(x, y)
    if not size > 0:
        x, y, size = 1.0, 0.0, 1.0
    return math.sqrt(half + root), x / size, y / size


@part_with_arrays
def too_thin(x, y, w0, plane, criteria):
    """First test at a point: negative or 0 where the criterion surely holds."""
    w, first, second = image_of(x, y, plane, criteria)
    size, _, _ = largest_singular(first, second)
    return criteria.rules.min_pixel_density * size * (1 + MARGIN_REL) - w0 * (2 * w - w0)


@part_with_arrays
def too_dense(x, y, left, right, plane, criteria):
    """Second test at a point: negative where the criterion surely fails."""
    w, first, second = image_of(x, y, plane, criteria)
    r1, r2 = right
    along = (
        left[0] * (first[0] * r1 + second[0] * r2)
        + left[1] * (first[1] * r1 + second[1] * r2)
        + left[2] * (first[2] * r1 + second[2] * r2)
    )
    return w * w * (1 + MARGIN_REL) - criteria.rules.min_pixel_density * along


@part_with_arrays
def value_of(is_first, x, y, w0, left, right, plane, criteria):
    """One of the two tests."""
    if is_first:
        return too_thin(x, y, w0, plane, criteria)
    return too_dense(x, y, left, right, plane, criteria)


@allocation_free
def accepted_part(is_first, polygon, n, tests, plane, criteria, values, out):
    """Hull of the points of a polygon's outline that a test accepts; its corner count.

    0 where none of the corners is accepted, or those that are do not follow one another.

    Parameters
    ----------
    is_first : bool
        The first test or the second.
    tests : tuple
        w_0, and the singular vectors.
    values, out
        Scratch; and the polygon, whose last two corners, where not all of `polygon` is accepted,
        are those of the chord.
    """
    w0, left, right = tests
    changes, start = 0, -1
    if n + 2 > out.shape[0]:
        return 0
    for p in range(n):
        values[p] = value_of(
            is_first, polygon[p, U], polygon[p, V], w0, left, right, plane, criteria
        )
    for p in range(n):
        before = values[p - 1] if p > 0 else values[n - 1]
        if (values[p] <= 0) != (before <= 0):
            changes += 1
            if values[p] <= 0:
                start = p
    if changes == 0 and values[0] <= 0:
        copy_polygon(polygon, n, out)
        return n
    if changes != 2:
        return 0
    kept, p = 0, start
    while values[p] <= 0:
        out[kept, U], out[kept, V] = polygon[p, U], polygon[p, V]
        kept += 1
        p = p + 1 if p + 1 < n else 0
    last = p - 1 if p > 0 else n - 1
    before = start - 1 if start > 0 else n - 1
    for side in range(2):
        a, b = (last, p) if side == 0 else (start, before)
        low, high = 0.0, 1.0
        for _ in range(BISECTIONS):
            t = (low + high) / 2
            x = polygon[a, U] + t * (polygon[b, U] - polygon[a, U])
            y = polygon[a, V] + t * (polygon[b, V] - polygon[a, V])
            if value_of(is_first, x, y, w0, left, right, plane, criteria) <= 0:
                low = t
            else:
                high = t
        out[kept, U] = polygon[a, U] + low * (polygon[b, U] - polygon[a, U])
        out[kept, V] = polygon[a, V] + low * (polygon[b, V] - polygon[a, V])
        kept += 1
    return kept


@part_with_arrays
def tests_at_centre(polygon, n, plane, criteria):
    """w_0 and the singular vectors at the mean of the corners."""
    x = y = 0.0
    for p in range(n):
        x += polygon[p, U] / n
        y += polygon[p, V] / n
    w, first, second = image_of(x, y, plane, criteria)
    size, r1, r2 = largest_singular(first, second)
    left = (
        (first[0] * r1 + second[0] * r2) / size,
        (first[1] * r1 + second[1] * r2) / size,
        (first[2] * r1 + second[2] * r2) / size,
    )
    return w, left, (r1, r2)


@allocation_free
def halve(polygon, n, scratch, top, level):
    """Push both halves of a polygon across its longest extent; returns the height of the stack."""
    strips, levels = scratch.strips, scratch.levels
    # The longest way from the first corner to another, roughly the length.
    far = 1
    for p in range(2, n):
        here = length2(polygon[p, U] - polygon[0, U], polygon[p, V] - polygon[0, V])
        there = length2(polygon[far, U] - polygon[0, U], polygon[far, V] - polygon[0, V])
        if here > there:
            far = p
    other = 0
    for p in range(n):
        here = length2(polygon[p, U] - polygon[far, U], polygon[p, V] - polygon[far, V])
        there = length2(polygon[other, U] - polygon[far, U], polygon[other, V] - polygon[far, V])
        if here > there:
            other = p
    x, y = (polygon[far, U] + polygon[other, U]) / 2, (polygon[far, V] + polygon[other, V]) / 2
    dx, dy = polygon[far, U] - polygon[other, U], polygon[far, V] - polygon[other, V]
    for sign in (-1.0, 1.0):
        kept = keep_inside(polygon, n, (x, y, sign * dy, -sign * dx, 0.0), strips.corners[top])
        if kept >= 3:
            strips.n_corners[top], levels[top] = kept, level
            top += 1
    return top


@part_with_arrays
def extent_of(polygon, n):
    """Greatest distance of a corner from the first: between half the diameter and all of it."""
    extent = 0.0
    for p in range(1, n):
        away = length2(polygon[p, U] - polygon[0, U], polygon[p, V] - polygon[0, V])
        extent = max(extent, away)
    return extent


@allocation_free
def append_dense(face, polygon, n, criteria, scratch, out):
    """Append the part of a polygon whose pixel density is large enough; see the module."""
    plane, strips, levels = scratch.plane, scratch.strips, scratch.levels
    nearest = max(COINCIDENT_REL * plane[LONGEST], plane[ERROR])
    if criteria.rules.min_pixel_density == 0:
        append_piece(face, polygon, n, nearest, scratch.tidy, out)
        return
    part, chosen, spare = scratch.inner, scratch.other, scratch.spare
    top = push_parts(polygon, n, strips)
    levels[:top] = 0
    while top > 0:
        top -= 1
        n, level = strips.n_corners[top], levels[top]
        copy_polygon(strips.corners[top], n, part)
        area = twice_area(part, n) / 2
        if not area > 0:
            continue
        tests = tests_at_centre(part, n, plane, criteria)
        length = extent_of(part, n)
        is_decided = False
        for turn in range(2):
            kept = accepted_part(turn == 0, part, n, tests, plane, criteria, scratch.values, chosen)
            if kept < 3:
                continue
            x0, y0 = chosen[kept - 2, U], chosen[kept - 2, V]
            x1, y1 = chosen[kept - 1, U], chosen[kept - 1, V]
            is_whole = kept == n and chosen[0, U] == part[0, U] and chosen[0, V] == part[0, V]
            is_whole = is_whole and twice_area(chosen, kept) >= 2 * area
            # A short chord has no direction.
            if not is_whole and length2(x1 - x0, y1 - y0) <= 1e-6 * length:
                continue
            if turn == 0:
                append_piece(face, chosen, kept, nearest, scratch.tidy, out)
            if is_whole:
                is_decided = True
                break
            n = keep_inside(part, n, (x0, y0, x0 - x1, y0 - y1, 0.0), spare)
            copy_polygon(spare, n, part)
            if n < 3:
                is_decided = True
                break
        if is_decided:
            continue
        rest = max(twice_area(part, n) / 2, 0.0)
        if (
            rest <= criteria.gap * extent_of(part, n)
            or level == MOST_HALVINGS
            or top + 2 > STACK_ROOM
        ):
            out.bound[face] += rest
            continue
        top = halve(part, n, scratch, top, level + 1)
