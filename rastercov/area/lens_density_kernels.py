"""Densities through a lens in the plane of a face, decided piece by piece; by numba.

Let A be the derivative of pixels by the place (x, y) in the ideal plane, w = 1/z, T the tangents of
the face as columns (3, 2), and

    S = A N,   N = w (I | -(x, y)) T,

so that S is the derivative of pixels by metres on the face; without T it is that by metres of
space. The criteria at a point are

    pixels a m^2         |det S| >= R
    worst direction      the least eigenvalue of S S^T >= d^2
    of a facing target   the same of S S^T without T
    distance             |P|^2 >= n^2

Each is a function of the place with second derivatives of at most K along lines (for the distance,
exactly 2 in the plane of the face): with |A| <= a, |A'| <= a', |A''| <= a'' in a piece, and bounds
of w and N alike, s = a n, s' = a' n + a n', s'' = a'' n + 2 a' n' + a n'', and

    |(S S^T)''| <= 2 s s'' + 2 s'^2 >= |(det S)''|.

So in a piece of radius r about its middle a scalar differs from an affine function by K r^2 / 2 at
most. The least eigenvalue of a matrix is concave: it lies below e . M e with any unit vector e, and
the difference of both, for the affine part of the matrix, is greatest at a corner. Either way a
piece has two parallel lines, beyond which the criterion holds, and before which it fails. What is
between them is halved until it is narrower than `LensRules.strip_gap`; then it goes into the bound.
"""

import math

from rastercov._jit import allocation_free, part_with_arrays
from rastercov.area.density_kernels import MOST_HALVINGS, extent_of
from rastercov.area.plane_kernels import (
    COINCIDENT_REL,
    ERROR,
    FOOT_X,
    FOOT_Y,
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
from rastercov.exact.polygon_kernels import copy_polygon, keep_inside, twice_area
from rastercov.exact.records import U, V
from rastercov.lenses.kernels import plane_slopes
from rastercov.lenses.slopes import bounds_within

PER_M2, DENSE, FACING, DISTANT = 1, 2, 4, 8
"""Bits of the criteria that a piece still has to meet."""
MASK = 16
"""One more than all of them: pieces keep MASK times the number of halvings, and the bits."""
STEP_REL, LARGEST_STEP = 1 / 64, 1e-5
"""Step of the differences that give an affine part, relative to the radius; in units of the
plane. Its error is less than K r^2 / 40."""
HALF = 0.5 + 0.05
"""Of K r^2: the difference from an affine function."""
ROUNDING = 2.0**-46
"""Of s^2: rounding of the criteria and, times the radius over the step, of differences."""


@allocation_free
def figures_at(rules, plane, x, y, w, out):
    """Fill `out` with |det S|, and the entries (11, 12, 22) of S S^T with T and without."""
    a, b, c, d = plane_slopes(rules.code, rules.params, rules.frame, x, y)
    # N without T, by columns: (w, 0), (0, w), (-w x, -w y)
    u_1, u_2, u_3 = w * a, w * b, -w * (a * x + b * y)
    v_1, v_2, v_3 = w * c, w * d, -w * (c * x + d * y)
    s_11 = u_1 * plane[X_AXIS] + u_2 * plane[X_AXIS + 1] + u_3 * plane[X_AXIS + 2]
    s_12 = u_1 * plane[Y_AXIS] + u_2 * plane[Y_AXIS + 1] + u_3 * plane[Y_AXIS + 2]
    s_21 = v_1 * plane[X_AXIS] + v_2 * plane[X_AXIS + 1] + v_3 * plane[X_AXIS + 2]
    s_22 = v_1 * plane[Y_AXIS] + v_2 * plane[Y_AXIS + 1] + v_3 * plane[Y_AXIS + 2]
    # The frame of a face seen from the front turns the other way round in an image with v down.
    out[0] = s_12 * s_21 - s_11 * s_22 if plane[HEIGHT] > 0 else s_11 * s_22 - s_12 * s_21
    out[1], out[2] = s_11 * s_11 + s_12 * s_12, s_11 * s_21 + s_12 * s_22
    out[3] = s_21 * s_21 + s_22 * s_22
    out[4], out[5] = u_1 * u_1 + u_2 * u_2 + u_3 * u_3, u_1 * v_1 + u_2 * v_2 + u_3 * v_3
    out[6] = v_1 * v_1 + v_2 * v_2 + v_3 * v_3


@part_with_arrays
def least_eigenvalue(a, b, d):
    """Least eigenvalue of (a b; b d), and its unit vector."""
    half, apart = 0.5 * (a + d), 0.5 * (a - d)
    root = math.sqrt(apart * apart + b * b)
    x, y = (-b, root + apart) if apart >= 0 else (root - apart, -b)
    size = length2(x, y)
    if not size > 0:
        x, y, size = 1.0, 0.0, 1.0
    least = half - root
    if half > 0 and least < 0.5 * half:  # without cancellation
        least = (a * d - b * b) / (half + root)
    return least, x / size, y / size


@allocation_free
def place_corners(polygon, n, plane, places):
    """Fill `places` with the corners (x, y, 1/z) of a polygon in the ideal plane."""
    for p in range(n):
        a, b = polygon[p, U], polygon[p, V]
        x = plane[ORIGIN] + a * plane[X_AXIS] + b * plane[Y_AXIS]
        y = plane[ORIGIN + 1] + a * plane[X_AXIS + 1] + b * plane[Y_AXIS + 1]
        z = plane[ORIGIN + 2] + a * plane[X_AXIS + 2] + b * plane[Y_AXIS + 2]
        places[p, 0], places[p, 1], places[p, 2] = x / z, y / z, 1 / z


@part_with_arrays
def depth_line(plane):
    """1/z of the plane of the face as c + a x + b y: (a, b, c)."""
    h = -plane[HEIGHT]
    return plane[NORMAL] / h, plane[NORMAL + 1] / h, plane[NORMAL + 2] / h


@allocation_free
def fit_criteria(polygon, n, mask, plane, rules, places, fits):
    """Fill `fits` with what each criterion is in a polygon, up to a remainder.

    Row i of `fits` is of bit i of `mask`: c + a x + b y is the affine part, with x and y those of
    the ideal plane (of the face, for the distance), in columns 0 to 2; the criterion less that is
    at least column 3 and at most column 4, and column 5 is 1 where that is known.
    """
    place_corners(polygon, n, plane, places)
    low_x = low_y = math.inf
    high_x = high_y = -math.inf
    x = y = 0.0
    most_w = 0.0
    for p in range(n):
        low_x, high_x = min(low_x, places[p, 0]), max(high_x, places[p, 0])
        low_y, high_y = min(low_y, places[p, 1]), max(high_y, places[p, 1])
        x, y = x + places[p, 0] / n, y + places[p, 1] / n
        most_w = max(most_w, places[p, 2])
    r = 0.0
    for p in range(n):
        r = max(r, length2(places[p, 0] - x, places[p, 1] - y))
    for i in range(4):
        fits[i, 5] = 0.0
    if mask & DISTANT:
        mean_x = mean_y = 0.0
        for p in range(n):
            mean_x, mean_y = mean_x + polygon[p, U] / n, mean_y + polygon[p, V] / n
        over = 0.0
        for p in range(n):
            over = max(over, length2(polygon[p, U] - mean_x, polygon[p, V] - mean_y) ** 2)
        a, b = mean_x - plane[FOOT_X], mean_y - plane[FOOT_Y]
        h = plane[HEIGHT]
        off = 4 * plane[ERROR] * (length2(a, b) + math.sqrt(over) + abs(h))
        fits[3, 0], fits[3, 1] = 2 * a, 2 * b
        fits[3, 2] = a * a + b * b + h * h - rules.nearest * rules.nearest
        fits[3, 2] -= 2 * a * mean_x + 2 * b * mean_y
        fits[3, 3], fits[3, 4], fits[3, 5] = -off, over + off, 1.0
    if not mask & (PER_M2 | DENSE | FACING) or not r > 0:
        return
    w_x, w_y, w_0 = depth_line(plane)
    step = min(STEP_REL * r, LARGEST_STEP)
    second, third = bounds_within(
        rules.slopes, low_x - step, high_x + step, low_y - step, high_y + step
    )
    # Next to the region by a step the bounds are greater by less than 5 %.
    second, third = 1.05 * second, 1.05 * third
    if not (second < math.inf and third < math.inf):
        return
    here = fits[4]
    figures_at(rules, plane, x, y, w_0 + w_x * x + w_y * y, here)
    a, b, c, d = plane_slopes(rules.code, rules.params, rules.frame, x, y)
    most_a = math.sqrt(a * a + b * b + c * c + d * d) + second * r
    tall = math.sqrt(1 + (length2(x, y) + r) ** 2)
    steep = length2(w_x, w_y)
    # N = w (I | -(x, y)): its norm and those of its derivatives.
    n_0, n_1, n_2 = most_w * tall, steep * tall + most_w, 2 * steep
    s_0, s_1 = most_a * n_0, second * n_0 + most_a * n_1
    s_2 = third * n_0 + 2 * second * n_1 + most_a * n_2
    off = HALF * (2 * s_0 * s_2 + 2 * s_1 * s_1) * r * r
    off += s_0 * s_0 * (ROUNDING * (1 + r / step) + 4 * plane[ERROR] / abs(plane[HEIGHT]))
    by_x, by_y = fits[7], fits[8]
    for axis in range(2):
        dx, dy = (step, 0.0) if axis == 0 else (0.0, step)
        slope = by_x if axis == 0 else by_y
        for sign in (1.0, -1.0):
            there_x, there_y = x + sign * dx, y + sign * dy
            w = w_0 + w_x * there_x + w_y * there_y
            figures_at(rules, plane, there_x, there_y, w, fits[5])
            for k in range(7):
                before = 0.0 if sign > 0 else slope[k]
                slope[k] = before + sign * 0.5 * fits[5, k] / step
    if mask & PER_M2:
        fits[0, 0], fits[0, 1] = by_x[0], by_y[0]
        fits[0, 2] = here[0] - by_x[0] * x - by_y[0] * y - rules.min_per_m2
        fits[0, 3], fits[0, 4] = -off, off
        known_0 = 1.0
    else:
        known_0 = 0.0
    for i in range(1, 3):
        if not mask >> i & 1:
            continue
        first = 1 if i == 1 else 4
        wanted = rules.min_density if i == 1 else rules.min_facing
        _, e, f = least_eigenvalue(here[first], here[first + 1], here[first + 2])
        a = e * e * by_x[first] + 2 * e * f * by_x[first + 1] + f * f * by_x[first + 2]
        b = e * e * by_y[first] + 2 * e * f * by_y[first + 1] + f * f * by_y[first + 2]
        at = e * e * here[first] + 2 * e * f * here[first + 1] + f * f * here[first + 2]
        over = 0.0
        for p in range(n):
            dx, dy = places[p, 0] - x, places[p, 1] - y
            least, _, _ = least_eigenvalue(
                here[first] + by_x[first] * dx + by_y[first] * dy,
                here[first + 1] + by_x[first + 1] * dx + by_y[first + 1] * dy,
                here[first + 2] + by_x[first + 2] * dx + by_y[first + 2] * dy,
            )
            over = max(over, at + a * dx + b * dy - least)
        fits[i, 0], fits[i, 1], fits[i, 2] = a, b, at - a * x - b * y - wanted * wanted
        fits[i, 3], fits[i, 4] = -off - over, off
    # The rows of scratch end with the flags.
    fits[0, 5] = known_0
    fits[1, 5] = 1.0 if mask & DENSE else 0.0
    fits[2, 5] = 1.0 if mask & FACING else 0.0


@part_with_arrays
def line_of(fits, i, offset, plane):
    """Line in the plane of the face along criterion i, moved by an offset: value, slopes."""
    a, b, c = fits[i, 0], fits[i, 1], fits[i, 2] + offset
    if i == 3:
        return c, a, b
    return (
        a * plane[ORIGIN] + b * plane[ORIGIN + 1] + c * plane[ORIGIN + 2],
        a * plane[X_AXIS] + b * plane[X_AXIS + 1] + c * plane[X_AXIS + 2],
        a * plane[Y_AXIS] + b * plane[Y_AXIS + 1] + c * plane[Y_AXIS + 2],
    )


@allocation_free
def keep_beyond(polygon, n, line, sign, out):
    """Part of a polygon where sign times a line (value, slopes) is >= 0; its corner count."""
    value, along_x, along_y = sign * line[0], sign * line[1], sign * line[2]
    return keep_inside(polygon, n, (0.0, 0.0, along_y, -along_x, value), out)


@allocation_free
def least_and_most(polygon, n, line):
    """Extremes of a line (value, slopes) at the corners of a polygon."""
    least, most = math.inf, -math.inf
    for p in range(n):
        at = line[0] + line[1] * polygon[p, U] + line[2] * polygon[p, V]
        least, most = min(least, at), max(most, at)
    return least, most


@allocation_free
def append_dense_through_lens(face, polygon, n, rules, scratch, out):
    """Append the part of a polygon that meets all criteria of densities; see the module."""
    plane, strips, levels = scratch.plane, scratch.strips, scratch.levels
    part, spare, fits, other = scratch.inner, scratch.spare, scratch.fits, scratch.other
    nearest = max(COINCIDENT_REL * plane[LONGEST], plane[ERROR])
    mask = 0
    if rules.min_per_m2 > 0:
        mask |= PER_M2
    if rules.min_density > 0:
        mask |= DENSE
    if rules.min_facing > 0:
        mask |= FACING
    if rules.nearest > 0:
        mask |= DISTANT
    if mask == 0:
        append_piece(face, polygon, n, nearest, scratch.tidy, out)
        return
    top = push_parts(polygon, n, strips)
    for p in range(top):
        levels[p] = mask
    while top > 0:
        top -= 1
        n, mask, level = strips.n_corners[top], levels[top] % MASK, levels[top] // MASK
        copy_polygon(strips.corners[top], n, part)
        area = twice_area(part, n) / 2
        if not area > 0:
            continue
        fit_criteria(part, n, mask, plane, rules, scratch.places, fits)
        best, narrowest, is_out = -1, math.inf, False
        for i in range(4):
            if not mask >> i & 1 or fits[i, 5] == 0:
                continue
            inner = line_of(fits, i, fits[i, 3], plane)
            least, most = least_and_most(part, n, inner)
            if least > 0:
                mask -= 1 << i
                continue
            outer = line_of(fits, i, fits[i, 4], plane)
            if least_and_most(part, n, outer)[1] < 0:
                is_out = True
                break
            # Share of the range of the criterion in the piece that is undecided.
            share = (fits[i, 4] - fits[i, 3]) / max(range_of(fits, i, part, n, scratch), 1e-300)
            if share < narrowest:
                best, narrowest = i, share
        if is_out:
            continue
        if mask == 0:
            append_piece(face, part, n, nearest, scratch.tidy, out)
            continue
        if best >= 0 and narrowest < 0.5 and top + 3 <= STACK_ROOM:
            inner = line_of(fits, best, fits[best, 3], plane)
            outer = line_of(fits, best, fits[best, 4], plane)
            m = keep_beyond(part, n, inner, 1.0, strips.corners[top])
            if m >= 3:
                if mask == 1 << best:
                    copy_polygon(strips.corners[top], m, other)
                    append_piece(face, other, m, nearest, scratch.tidy, out)
                else:
                    strips.n_corners[top] = m
                    levels[top] = level * MASK + mask - (1 << best)
                    top += 1
            n = keep_beyond(part, n, inner, -1.0, spare)
            if n >= 3:
                n = keep_beyond(spare, n, outer, 1.0, part)
            if n < 3:
                continue
        rest = max(twice_area(part, n) / 2, 0.0)
        if (
            rest <= rules.strip_gap * extent_of(part, n)
            or level == MOST_HALVINGS
            or top + 2 > STACK_ROOM
        ):
            out.bound[face] += rest
            continue
        top = halve_part(part, n, scratch, top, (level + 1) * MASK + mask)


@allocation_free
def range_of(fits, i, polygon, n, scratch):
    """Range of the affine part of criterion i over the corners of a polygon."""
    least, most = math.inf, -math.inf
    for p in range(n):
        x, y = scratch.places[p, 0], scratch.places[p, 1]
        if i == 3:
            x, y = polygon[p, U], polygon[p, V]
        at = fits[i, 0] * x + fits[i, 1] * y
        least, most = min(least, at), max(most, at)
    return most - least


@allocation_free
def halve_part(polygon, n, scratch, top, level):
    """Push both halves of a polygon across its longest extent in the image; height of the stack."""
    strips, levels, places = scratch.strips, scratch.levels, scratch.places
    place_corners(polygon, n, scratch.plane, places)
    far = other = 0
    for side in range(2):
        extent, start = -1.0, 0 if side == 0 else far
        for p in range(n):
            away = length2(places[p, 0] - places[start, 0], places[p, 1] - places[start, 1])
            if away > extent:
                extent = away
                if side == 0:
                    far = p
                else:
                    other = p
    a = places[far, 0] - places[other, 0]
    b = places[far, 1] - places[other, 1]
    c = -0.5 * (a * (places[far, 0] + places[other, 0]) + b * (places[far, 1] + places[other, 1]))
    scratch.fits[0, 0], scratch.fits[0, 1], scratch.fits[0, 2] = a, b, c
    line = line_of(scratch.fits, 0, 0.0, scratch.plane)
    for side in range(2):
        m = keep_beyond(polygon, n, line, 1.0 if side == 0 else -1.0, strips.corners[top])
        if m >= 3:
            strips.n_corners[top], levels[top] = m, level
            top += 1
    return top
