"""Regions of a pose through a lens: what an ideal plane shows, cut by the criteria of the lens.

`area_region.cut_regions` finds what the pinhole of an ideal plane sees, within the largest angle
of incidence. Three loops follow, each from a list of pieces to another one; the first and the last
run only where a task asks for them:

- `cut_to_discs`: focus up to a distance;
- `cut_to_view`: the field of view of the lens, and focus by depth;
- `cut_to_densities`: densities through the lens, and focus from a distance.

The curved borders of the field of view make most pieces, so discs come first.

The field of view is a tree of lines of an ideal plane (`lens_field`). A line
a x + b y + c = 0 there is the plane a X + b Y + c Z = 0 through the camera, and so a line in the
plane of the face: polygons need not be projected.

Densities are decided piece by piece. Let A be the derivative of pixels by the place x = (x, y) in
the ideal plane, w = 1/z, T (3, 2) the tangents of the face as columns, and h its distance. Pixels
change with metres on the face by

    S = w A (I | -x) T,   S^-1 = Q A^-1 / (h w^2),   Q = adj((I | -x) T),

up to its sign, and with metres across the ray by an S of S^-1 = E A^-1 / w, E = (I - e e^T)(I 0)^T,
e the unit vector of the ray. The criteria at a point are

    pixels a m^2         w >= (R / h)^(1/3) |det A|^(-1/3)
    worst direction      w^2 >= (d / h) |Q A^-1|
    of a facing target   w >= d |E A^-1|
    distance             |P|^2 >= n^2

w is affine in x, and on the right are a scalar and norms of matrices that change little. With
|A'| <= a', |A''| <= a'' and |A^-1| <= b in a piece, the derivatives along lines of A^-1 are at most
b' = b^2 a', b'' = b^2 a'' + 2 b^3 a'^2, those of Q at most 1 and 0, of E 2 and 4.4 (|e'| <= 1,
|e''| <= 1.2), and those of det A at most 2 |A| a' and 2 |A| a'' + 2 a'^2. So in a piece of radius r
about its middle each differs from an affine function by K r^2 / 2 at most. The norm of an affine
matrix M is convex: it lies above u . M v with any unit vectors u, v, and the difference is greatest
at a corner; w^2 lies above its tangent. So a piece has two parallel lines, beyond which a criterion
holds and before which it fails. What is between them is halved until it is narrower than
`LensCriteria.strip_gap`; then it goes into the bound.
"""

import math

from rastercov.kernels.area_region import (
    COINCIDENT_REL,
    ERROR,
    FOOT_X,
    FOOT_Y,
    HEIGHT,
    LONGEST,
    MOST_HALVINGS,
    NORMAL,
    ORIGIN,
    STACK_ROOM,
    X_AXIS,
    Y_AXIS,
    append_piece,
    append_within_angle,
    cut_by_lines,
    extent_of,
    largest_singular,
    length2,
    perimeter_of,
    push_parts,
    set_line,
    set_plane,
)
from rastercov.kernels.exact_polygon import MOST_CORNERS, copy_polygon, keep_inside, twice_area
from rastercov.kernels.exact_records import U, V
from rastercov.kernels.jit import allocation_free, part_with_arrays
from rastercov.kernels.lens import plane_slopes
from rastercov.kernels.lens_field import (
    BAND,
    BORDER,
    INSIDE,
    UNDECIDED,
    bounds_within,
    sizes_within,
)

PER_M2, DENSE, FACING, DISTANT = 1, 2, 4, 8
"""Bits of the criteria that a piece still has to meet."""
MASK = 16
"""One more than all of them: pieces keep MASK times the number of halvings, and the bits."""
N_FIGURES = 13
KNOWN = 5
"""Column of a fitted criterion."""
STEP_REL, LARGEST_STEP = 1 / 64, 1e-5
"""Step of the differences that give an affine part, relative to the radius; in units of the
plane. A difference is off by K step / 2, and so the affine part by less than K r^2 / 40."""
HALF = 0.5 + 0.05
"""Of K r^2: the difference from an affine function."""
FAR_REL = 1e-6
"""Of a density: by more than it a piece is beyond the limit, or before it, for sure."""
ROUNDING = 2.0**-46
"""Of the size of a figure: its rounding and, times the radius over the step, that of its slopes."""


@part_with_arrays
def line_in_plane(line, plane):
    """Value, its slopes along x and y, and its error, of a line of the ideal plane."""
    a, b, c = line[0], line[1], line[2]
    return (
        a * plane[ORIGIN] + b * plane[ORIGIN + 1] + c * plane[ORIGIN + 2],
        a * plane[X_AXIS] + b * plane[X_AXIS + 1] + c * plane[X_AXIS + 2],
        a * plane[Y_AXIS] + b * plane[Y_AXIS + 1] + c * plane[Y_AXIS + 2],
        plane[ERROR] * (abs(a) + abs(b) + abs(c)),
    )


@allocation_free
def is_in_view(corners, n, plane, criteria):
    """True if a polygon lies in one cell of the tree that is inside the image, without a cut."""
    tree = criteria.tree
    node = tree.root
    while node >= 0:
        value, along_x, along_y, error = line_in_plane(tree.lines[node], plane)
        is_inside = is_outside = True
        for p in range(n):
            at = value + along_x * corners[p, U] + along_y * corners[p, V]
            is_inside = is_inside and at > error
            is_outside = is_outside and at < -error
        if not (is_inside or is_outside):
            return False
        node = tree.children[node, 0 if is_inside else 1]
    return node == INSIDE


@allocation_free
def append_in_view(face, polygon, n, criteria, scratch, out):
    """Append the part of a polygon that the image of the lens shows.

    Parameters
    ----------
    face, polygon, n, rules
        A convex polygon of the face; LensCriteria, whose undecided cells are added to the bound.
    scratch, out
        Scratch, with the face in `plane`; Found.
    """
    plane, views, nodes, part = scratch.plane, scratch.views, scratch.nodes, scratch.seen
    tree = criteria.tree
    nearest = max(COINCIDENT_REL * plane[LONGEST], plane[ERROR])
    top = push_parts(polygon, n, views)
    for p in range(top):
        nodes[p] = tree.root
    while top > 0:
        top -= 1
        node, n = nodes[top], views.n_corners[top]
        copy_polygon(views.corners[top], n, part)
        while node >= 0:
            kind = tree.kinds[node]
            if kind == BAND:
                area = twice_area(part, n) / 2
                if area <= criteria.strip_gap * extent_of(part, n):
                    node = UNDECIDED
                    break
            value, along_x, along_y, error = line_in_plane(tree.lines[node], plane)
            least, most = math.inf, -math.inf
            for p in range(n):
                at = value + along_x * part[p, U] + along_y * part[p, V]
                least, most = min(least, at), max(most, at)
            if kind == BORDER and least < error and most > -error:
                slope = length2(along_x, along_y)
                strip = twice_area(part, n) / 2
                if slope > 0:
                    strip = min(strip, error / slope * perimeter_of(part, n))
                out.bound[face] += max(strip, 0.0)
            if least >= 0:
                node = tree.children[node, 0]
            elif most <= 0:
                node = tree.children[node, 1]
            else:
                beyond = tree.children[node, 1]
                line = (0.0, 0.0, -along_y, along_x, -value)
                if beyond in (UNDECIDED, INSIDE) or beyond >= 0:
                    m = keep_inside(part, n, line, views.corners[top])
                    if m >= 3 and (beyond == UNDECIDED or top + 2 > STACK_ROOM):
                        out.bound[face] += max(twice_area(views.corners[top], m) / 2, 0.0)
                    elif m >= 3:
                        views.n_corners[top], nodes[top] = m, beyond
                        top += 1
                n = keep_inside(part, n, (0.0, 0.0, along_y, -along_x, value), scratch.spare)
                copy_polygon(scratch.spare, n, part)
                if n < 3:
                    break
                node = tree.children[node, 0]
                if n > 2 * MOST_CORNERS and top + 2 <= STACK_ROOM:
                    # A chord divides what has many corners.
                    half = n // 2
                    corners = views.corners[top]
                    for p in range(half, n):
                        corners[p - half, U], corners[p - half, V] = part[p, U], part[p, V]
                    corners[n - half, U], corners[n - half, V] = part[0, U], part[0, V]
                    views.n_corners[top], nodes[top] = n - half + 1, node
                    top += 1
                    n = half + 1
        if n < 3:
            continue
        if node == INSIDE:
            append_piece(face, part, n, nearest, scratch.tidy, out)
        elif node == UNDECIDED:
            out.bound[face] += max(twice_area(part, n) / 2, 0.0)


@allocation_free
def figures_at(criteria, plane, x, y, n_figures, out):
    """Fill `out` with |det A|^(-1/3), the columns of Q A^-1, and those of E A^-1.

    The first alone where `n_figures` is 1. Returns the norm and the least singular value of A, and
    |det A|.
    """
    a, b, c, d = plane_slopes(criteria.code, criteria.params, criteria.frame, x, y)
    det = a * d - b * c
    total = a * a + b * b + c * c + d * d
    root = math.sqrt(max(total * total - 4 * det * det, 0.0))
    norm = math.sqrt(0.5 * (total + root))
    # A^-1, by rows
    i_11, i_12, i_21, i_22 = d / det, -b / det, -c / det, a / det
    out[0] = abs(det) ** (-1 / 3)
    if n_figures == 1:
        return norm, abs(det) / norm, abs(det)
    q_11 = plane[Y_AXIS + 1] - y * plane[Y_AXIS + 2]
    q_12 = x * plane[Y_AXIS + 2] - plane[Y_AXIS]
    q_21 = y * plane[X_AXIS + 2] - plane[X_AXIS + 1]
    q_22 = plane[X_AXIS] - x * plane[X_AXIS + 2]
    out[1], out[2] = q_11 * i_11 + q_12 * i_21, q_21 * i_11 + q_22 * i_21
    out[3] = 0.0
    out[4], out[5] = q_11 * i_12 + q_12 * i_22, q_21 * i_12 + q_22 * i_22
    out[6] = 0.0
    s2 = 1 + x * x + y * y
    e_11, e_12, e_22 = 1 - x * x / s2, -x * y / s2, 1 - y * y / s2
    e_31, e_32 = -x / s2, -y / s2
    out[7], out[8] = e_11 * i_11 + e_12 * i_21, e_12 * i_11 + e_22 * i_21
    out[9] = e_31 * i_11 + e_32 * i_21
    out[10], out[11] = e_11 * i_12 + e_12 * i_22, e_12 * i_12 + e_22 * i_22
    out[12] = e_31 * i_12 + e_32 * i_22
    return norm, abs(det) / norm, abs(det)


@allocation_free
def norm_along(here, by_x, by_y, first, dx, dy):
    """Norm of an affine matrix at a place, its columns from `first` on; and its right vector."""
    one = (
        here[first] + by_x[first] * dx + by_y[first] * dy,
        here[first + 1] + by_x[first + 1] * dx + by_y[first + 1] * dy,
        here[first + 2] + by_x[first + 2] * dx + by_y[first + 2] * dy,
    )
    two = (
        here[first + 3] + by_x[first + 3] * dx + by_y[first + 3] * dy,
        here[first + 4] + by_x[first + 4] * dx + by_y[first + 4] * dy,
        here[first + 5] + by_x[first + 5] * dx + by_y[first + 5] * dy,
    )
    return largest_singular(one, two)


@allocation_free
def form_of(matrix, first, left, right):
    """Bilinear form left . M right of a matrix of two columns, from `first` on."""
    total = 0.0
    for k in range(3):
        total += left[k] * (matrix[first + k] * right[0] + matrix[first + 3 + k] * right[1])
    return total


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
def fit_criteria(polygon, n, mask, plane, criteria, places, fits):
    """Fill `fits` with what each criterion is in a polygon, up to a remainder.

    Row i of `fits` is of bit i of `mask`: c + a x + b y is the affine part, with x and y those of
    the ideal plane (of the face, for the distance), in columns 0 to 2; the criterion less that is
    at least column 3 and at most column 4, and column KNOWN is 1 where that is known.
    """
    place_corners(polygon, n, plane, places)
    low_x = low_y = math.inf
    high_x = high_y = -math.inf
    x = y = 0.0
    least_w, most_w = math.inf, 0.0
    for p in range(n):
        low_x, high_x = min(low_x, places[p, 0]), max(high_x, places[p, 0])
        low_y, high_y = min(low_y, places[p, 1]), max(high_y, places[p, 1])
        x, y = x + places[p, 0] / n, y + places[p, 1] / n
        least_w, most_w = min(least_w, places[p, 2]), max(most_w, places[p, 2])
    r = 0.0
    for p in range(n):
        r = max(r, length2(places[p, 0] - x, places[p, 1] - y))
    for i in range(4):
        fits[i, KNOWN] = 0.0
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
        fits[3, 2] = a * a + b * b + h * h - criteria.rules.z_n * criteria.rules.z_n
        fits[3, 2] -= 2 * a * mean_x + 2 * b * mean_y
        fits[3, 3], fits[3, 4], fits[3, KNOWN] = -off, over + off, 1.0
    if not mask & (PER_M2 | DENSE | FACING) or not r > 0:
        return
    if mask & PER_M2:
        # Most pieces are far from the border of this criterion: its range in the piece is enough.
        least_det, most_det = sizes_within(criteria.slopes, low_x, high_x, low_y, high_y)
        h = abs(plane[HEIGHT])
        doubt = FAR_REL + 8 * plane[ERROR] / h
        # w >= (R / h)^(1/3) |det A|^(-1/3)
        if least_w**3 * h * least_det > criteria.rules.min_pixels_per_m2 * (1 + doubt):
            set_known(fits, 0, 1.0)
        elif most_w**3 * h * most_det < criteria.rules.min_pixels_per_m2 * (1 - doubt):
            set_known(fits, 0, -1.0)
        if fits[0, KNOWN] > 0:
            mask -= PER_M2
    if not mask & (PER_M2 | DENSE | FACING):
        return
    w_x, w_y, w_0 = depth_line(plane)
    step = min(STEP_REL * r, LARGEST_STEP)
    second, third = bounds_within(
        criteria.slopes, low_x - step, high_x + step, low_y - step, high_y + step
    )
    here, by_x, by_y, there = fits[4], fits[5], fits[6], fits[7]
    n_figures = N_FIGURES if mask & (DENSE | FACING) else 1
    norm, least, det = figures_at(criteria, plane, x, y, n_figures, here)
    norm += second * r
    least -= second * r
    least_det = det - 2 * norm * second * r
    if not (least > 0 and least_det > 0 and third < math.inf):
        return
    for axis in range(2):
        dx, dy = (step, 0.0) if axis == 0 else (0.0, step)
        slope = by_x if axis == 0 else by_y
        figures_at(criteria, plane, x + dx, y + dy, n_figures, there)
        for k in range(n_figures):
            slope[k] = (there[k] - here[k]) / step
    b = 1 / least
    b_1 = b * b * second
    b_2 = b * b * third + 2 * b * b_1 * second
    tall, h = math.sqrt(1 + (length2(x, y) + r) ** 2), abs(plane[HEIGHT])
    w = w_0 + w_x * x + w_y * y
    # Rounding of the figures, of their differences, and of the height.
    rounding = ROUNDING * (1 + r / step) + 4 * plane[ERROR] / h
    if mask & PER_M2:
        c = (criteria.rules.min_pixels_per_m2 / h) ** (1 / 3)
        det_1, det_2 = 2 * norm * second, 2 * norm * third + 2 * second * second
        bend = least_det ** (-1 / 3)
        bend *= det_2 / (3 * least_det) + 4 / 9 * (det_1 / least_det) ** 2
        off = HALF * c * bend * r * r + rounding * (c * here[0] + most_w)
        fits[0, 0], fits[0, 1] = w_x - c * by_x[0], w_y - c * by_y[0]
        fits[0, 2] = w - c * here[0] - fits[0, 0] * x - fits[0, 1] * y
        fits[0, 3], fits[0, 4] = -off, off
    for i in range(1, 3):
        if not mask >> i & 1:
            continue
        first = 1 if i == 1 else 7
        bend = 2 * b_1 + tall * b_2 if i == 1 else 4.4 * b + 4 * b_1 + b_2
        c = criteria.rules.min_pixel_density / h if i == 1 else criteria.rules.min_facing_density
        size, right_x, right_y = norm_along(here, by_x, by_y, first, 0.0, 0.0)
        right = (right_x, right_y)
        left = (
            (here[first] * right_x + here[first + 3] * right_y) / size,
            (here[first + 1] * right_x + here[first + 4] * right_y) / size,
            (here[first + 2] * right_x + here[first + 5] * right_y) / size,
        )
        at = form_of(here, first, left, right)
        slope_x, slope_y = form_of(by_x, first, left, right), form_of(by_y, first, left, right)
        over = square = 0.0
        for p in range(n):
            dx, dy = places[p, 0] - x, places[p, 1] - y
            own, _, _ = norm_along(here, by_x, by_y, first, dx, dy)
            over = max(over, own - at - slope_x * dx - slope_y * dy)
            if i == 1:
                square = max(square, (w_x * dx + w_y * dy) ** 2)
        off = HALF * c * bend * r * r + rounding * (c * (size + over) + most_w * (most_w + 1))
        value, along_x, along_y = w, w_x, w_y
        if i == 1:
            value, along_x, along_y = w * w, 2 * w * w_x, 2 * w * w_y
        fits[i, 0], fits[i, 1] = along_x - c * slope_x, along_y - c * slope_y
        fits[i, 2] = value - c * at - fits[i, 0] * x - fits[i, 1] * y
        fits[i, 3], fits[i, 4] = -off - c * over, off + square
    for i in range(3):
        if mask >> i & 1:
            fits[i, KNOWN] = 1.0


@part_with_arrays
def set_known(fits, i, value):
    """Let a criterion have one value everywhere."""
    fits[i, 0] = fits[i, 1] = fits[i, 3] = fits[i, 4] = 0.0
    fits[i, 2], fits[i, KNOWN] = value, 1.0


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
def append_dense_through_lens(face, polygon, n, criteria, scratch, out):
    """Append the part of a polygon that meets all criteria of densities; see the module."""
    plane, strips, levels = scratch.plane, scratch.strips, scratch.levels
    part, spare, fits, other = scratch.inner, scratch.spare, scratch.fits, scratch.other
    nearest = max(COINCIDENT_REL * plane[LONGEST], plane[ERROR])
    mask = 0
    if criteria.rules.min_pixels_per_m2 > 0:
        mask |= PER_M2
    if criteria.rules.min_pixel_density > 0:
        mask |= DENSE
    if criteria.rules.min_facing_density > 0:
        mask |= FACING
    if criteria.by_distance and criteria.rules.z_n > 0:
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
        fit_criteria(part, n, mask, plane, criteria, scratch.places, fits)
        best, narrowest, is_out = -1, math.inf, False
        for i in range(4):
            if not mask >> i & 1 or fits[i, KNOWN] == 0:
                continue
            inner = line_of(fits, i, fits[i, 3], plane)
            least, _ = least_and_most(part, n, inner)
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
            rest <= criteria.strip_gap * extent_of(part, n)
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


@part_with_arrays
def start_from(source, out):
    """Start a list with the bounds of another one."""
    out.used[0] = out.used[1] = 0
    for f in range(out.area.shape[0]):
        out.area[f], out.bound[f] = 0.0, source.bound[f]


@part_with_arrays
def copy_piece(source, piece, polygon):
    """Copy the corners of a piece; their number."""
    first = source.starts[piece]
    n = source.starts[piece + 1] - first
    for p in range(n):
        polygon[p, U], polygon[p, V] = source.xy[first + p, U], source.xy[first + p, V]
    return n


@part_with_arrays
def limit_bounds(planes, out):
    """No bound exceeds its face."""
    for f in range(out.bound.shape[0]):
        out.bound[f] = min(out.bound[f], planes.areas[f])


@allocation_free
def cut_to_discs(planes, criteria, seen, scratch, source, out):
    """Cut pieces to the greatest distance in focus, and to the largest angle of incidence.

    Both are discs around the foot of the perpendicular from the camera; the smaller one counts.

    Parameters
    ----------
    planes, criteria, seen, scratch
        Planes; LensCriteria; Seen of the ideal plane; Scratch.
    source : Found
        Pieces in the ideal plane, by face.
    out : Found
        Where `used` is more than there is room for, call again with that much.
    """
    plane, polygon, farthest = scratch.plane, scratch.base, criteria.rules.z_f
    start_from(source, out)
    last, slope, square, is_grazed = -1, 0.0, 0.0, False
    for piece in range(source.used[0]):
        f = source.face[piece]
        if f != last:
            set_plane(planes, f, seen, plane)
            last, slope, is_grazed = f, criteria.rules.tan_incidence, False
            height = abs(plane[HEIGHT])
            square = farthest * farthest - height * height
            if slope == 0 or square < slope * slope * height * height:
                # The radius of the circle at that distance is off by height / radius times the
                # error of the height; one that is hardly there is left undecided.
                is_grazed = square <= 16 * farthest * plane[ERROR]
                radius = math.sqrt(max(square, 0.0))
                if not is_grazed:
                    slope = radius / height
                    plane[ERROR] *= 1 + height / radius
        if is_grazed:
            if square > -16 * farthest * plane[ERROR]:
                n = copy_piece(source, piece, polygon)
                area = twice_area(polygon, n) / 2
                out.bound[f] += min(area, 128 * farthest * plane[ERROR])
            continue
        n = copy_piece(source, piece, polygon)
        append_within_angle(f, polygon, n, slope, criteria.pinhole, scratch, out)
    limit_bounds(planes, out)


@allocation_free
def cut_to_view(planes, criteria, seen, scratch, source, out):
    """Cut pieces to the field of view of a lens and to the depths that are in focus.

    Parameters are those of `cut_to_discs`.
    """
    plane, lines, polygon = scratch.plane, scratch.lines, scratch.base
    has_depths = not criteria.by_distance and (
        criteria.rules.z_n > 0 or criteria.rules.z_f < math.inf
    )
    start_from(source, out)
    last = -1
    for piece in range(source.used[0]):
        f = source.face[piece]
        if f != last:
            set_plane(planes, f, seen, plane)
            last = f
            if has_depths:
                z = z_x = z_y = 0.0
                for k in range(3):
                    z += criteria.axis[k] * plane[ORIGIN + k]
                    z_x += criteria.axis[k] * plane[X_AXIS + k]
                    z_y += criteria.axis[k] * plane[Y_AXIS + k]
                set_line(lines, 0, z - criteria.rules.z_n, z_x, z_y, plane[ERROR])
                # What is infinitely far away needs no line.
                set_line(lines, 1, 1.0, 0.0, 0.0, 0.0)
                if criteria.rules.z_f < math.inf:
                    set_line(lines, 1, criteria.rules.z_f - z, -z_x, -z_y, plane[ERROR])
        n = copy_piece(source, piece, polygon)
        if has_depths:
            n, strips = cut_by_lines(polygon, n, lines, 0, 2, scratch.spare)
            out.bound[f] += strips
            if n < 3:
                continue
        if is_in_view(polygon, n, plane, criteria):
            nearest = max(COINCIDENT_REL * plane[LONGEST], plane[ERROR])
            append_piece(f, polygon, n, nearest, scratch.tidy, out)
        else:
            append_in_view(f, polygon, n, criteria, scratch, out)
    limit_bounds(planes, out)


@allocation_free
def cut_to_densities(planes, criteria, seen, scratch, source, out):
    """Cut pieces to where densities through a lens are large enough; as `cut_to_discs`."""
    plane, polygon = scratch.plane, scratch.base
    start_from(source, out)
    last = -1
    for piece in range(source.used[0]):
        f = source.face[piece]
        if f != last:
            set_plane(planes, f, seen, plane)
            last = f
        n = copy_piece(source, piece, polygon)
        append_dense_through_lens(f, polygon, n, criteria, scratch, out)
    limit_bounds(planes, out)
