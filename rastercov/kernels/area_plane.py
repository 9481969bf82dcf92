"""Regions of one face in its own plane: half planes, outlines, densities and the pieces; by numba.

A polygon is counter-clockwise in the plane of its face, which `rastercov.kernels.exact_polygon`
calls clockwise: there v points down. Lines are those of `kernels.exact_records`, with the largest
error of their value in the column LINE_ERROR.

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
`gap` of the criteria; then it goes into the bound.

A pinhole is a lens whose A is constant.
"""

import math
from collections import namedtuple
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.kernels.exact_polygon import (
    copy_part,
    copy_polygon,
    corners_of_part,
    keep_inside,
    line_at,
    line_value,
    side_at,
    twice_area,
)
from rastercov.kernels.exact_polygon import extent_of as box_of
from rastercov.kernels.exact_records import (
    DU,
    DV,
    LINE_ERROR,
    OFFSET,
    PIECE_ROOM,
    U,
    V,
)
from rastercov.kernels.jit import allocation_free, by_type, part_of, part_with_arrays
from rastercov.kernels.lens import plane_slopes
from rastercov.kernels.lens_field import bounds_within, sizes_within

FloatArray = NDArray[np.float64]


POSITION_ERROR_REL = 8 * 2.0**-52
"""Largest error of a point in camera axes, relative to its distance and the size of its face: a
difference, two products of three terms, and their sum."""


COINCIDENT_REL = 1e-12
"""Distance, relative to the longest edge of the face, below which two corners are one: the side
between them would have no direction."""


NEAR_LINE, FOCUS_LINE, FAR_LINE, LEFT, RIGHT, TOP, BOTTOM = range(7)
"""Rows of `Scratch.lines`: before FOCUS_LINE and FAR_LINE a point is out of focus or too far away
for its pixels per m^2; the others bound the viewing pyramid."""


N_LINES = 7


STACK_ROOM = 96
"""Capacity for parts that are still to be divided."""


MOST_HALVINGS = 48
"""Halvings of a piece, after which it is undecided."""


PER_M2, DENSE, FACING, DISTANT = 1, 2, 4, 8
"""Bits of the criteria that a piece still has to meet: its first number in `Scratch.strips`. The
other one is how often it was halved."""


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


Planes = namedtuple("Planes", "origin x_axis y_axis normal corners areas two_sided is_asked")
"""Faces of a mesh, of `coverage.area.frames.Frames`; `is_asked` are those to be measured."""


Criteria = namedtuple("Criteria", "lens rules gap pixel_error")
"""Pointwise criteria of a task in the image of a pinhole.

`rules` are a `coverage.task.Rules`; `gap` is the largest distance between the arc of the
incidence criterion and its chords, and the mean width of the strips that no test decides,
metres; `pixel_error` is the largest error of a position in the image, px.
"""


LensCriteria = namedtuple(
    "LensCriteria", "pinhole rules by_distance axis gap tree code params frame slopes"
)
"""Pointwise criteria of a task in one ideal plane of a lens.

`pinhole` has what a surface must meet in the plane itself: to be in its image, and the angle of
incidence; `rules` has all. `by_distance` says whether distances are in focus; if not, depths
along `axis` are, the axis of the lens in the axes of the plane. `gap` is the mean width
of the strips that no test decides, metres. `tree` is the field of view; `code`, `params` and
`frame` are the lens, and `slopes` bounds of its derivatives.
"""


Scratch = namedtuple(
    "Scratch",
    "base part spare other tidy inner seen caps strips views lines sides plane places fits first",
)
"""Memory of one thread.

`base` to `seen` are polygons, (PIECE_ROOM, 2), and `caps`, `strips` and `views` stacks of them;
`lines` bound the viewing pyramid and depths, `sides` the face; `plane` is the face in camera axes;
`first` is the first piece of each face in the image. For densities, `places` are corners in the
ideal plane, and `fits` affine parts of the criteria.
"""

Stack = namedtuple("Stack", "corners n_corners tags")
"""Polygons that are still to be divided, and two numbers of each, (STACK_ROOM, 2) int64."""


Found = namedtuple("Found", "xy starts face used area bound")
"""Regions of a pose: corners, `starts` of N pieces, their faces; area and bound of each face.

`used` has the pieces and the corners so far, also where there is no room for them.
"""


ORIGIN, X_AXIS, Y_AXIS, NORMAL = 0, 3, 6, 9
"""First columns of vectors in `Scratch.plane`: the frame of a face in camera axes."""


HEIGHT, FOOT_X, FOOT_Y, ERROR, LONGEST = range(12, 17)
"""Further columns: distance of the camera from the plane, negative from behind, and the foot of its
perpendicular; the largest error of a point of the face in camera axes; its longest edge."""


def scratch_for(n_faces: int) -> Scratch:
    """Scratch memory for a mesh."""
    polygons = np.empty((7, PIECE_ROOM, 2))
    lines, sides = np.empty((N_LINES, LINE_ERROR + 1)), np.empty((3, LINE_ERROR + 1))
    places, fits = np.empty((PIECE_ROOM, 3)), np.empty((8, 13))
    first = np.empty(n_faces, np.int64)
    stacks = _stack(), _stack(), _stack()
    of_face = lines, sides, np.empty(17), places, fits, first
    return Scratch._make([*polygons, *stacks, *of_face])


def room_for_found(n: int, corners: int, n_faces: int) -> Found:
    """Memory for the regions of a pose."""
    return Found(
        np.empty((corners, 2)),
        np.zeros(n + 1, np.int64),
        np.empty(n, np.int32),
        np.zeros(2, np.int64),
        *np.empty((2, n_faces)),
    )


def _stack() -> Stack:
    corners, tags = np.empty((STACK_ROOM, PIECE_ROOM, 2)), np.empty((STACK_ROOM, 2), np.int64)
    return Stack(corners, np.empty(STACK_ROOM, np.int64), tags)


@part_of
def length2(x, y):
    """Length of a vector in the plane."""
    return np.sqrt(x * x + y * y)


@part_with_arrays
def perimeter_of(polygon, n):
    """Length of the outline of a polygon."""
    total = 0.0
    for p in range(n):
        q = p + 1 if p + 1 < n else 0
        total += length2(polygon[q, U] - polygon[p, U], polygon[q, V] - polygon[p, V])
    return total


@part_with_arrays
def set_line(lines, s, value, along_x, along_y, error):
    """Store the line value + along_x x + along_y y >= 0."""
    lines[s, U] = lines[s, V] = 0.0
    lines[s, DU], lines[s, DV], lines[s, OFFSET] = along_y, -along_x, value
    lines[s, LINE_ERROR] = error


@part_with_arrays
def lines_of(polygon, n, lines):
    """Store the lines along the sides of a polygon, whose inner side is on the left."""
    for p in range(n):
        x, y, dx, dy, _ = side_at(polygon, n, p)
        lines[p, U], lines[p, V], lines[p, DU], lines[p, DV] = x, y, dx, dy
        lines[p, OFFSET] = lines[p, LINE_ERROR] = 0.0


@allocation_free
def cut_by_lines(polygon, n, lines, first, last, spare):
    """Clip a polygon in place by the lines first ... last - 1.

    Returns the corner count, 0 for an empty polygon, and the area of the strips along the lines
    within which rounding decides on which side a point lies.
    """
    undecided = 0.0
    for s in range(first, last):
        line, error = line_at(lines, s), lines[s, LINE_ERROR]
        least, most = np.inf, -np.inf
        for p in range(n):
            value = line_value(line, polygon[p, U], polygon[p, V])
            least, most = min(least, value), max(most, value)
        if least > error:
            continue
        if most < -error:
            return 0, undecided
        slope = length2(lines[s, DU], lines[s, DV])
        area = max(twice_area(polygon, n) / 2, 0.0)
        strip = area
        if slope > 0:
            strip = min(area, error / slope * perimeter_of(polygon, n))
        undecided += strip
        if least < 0:
            n = keep_inside(polygon, n, line, spare)
            copy_polygon(spare, n, polygon)
        if n < 3:
            return 0, undecided
    return n, undecided


@part_with_arrays
def distance_in_axes(polygon, p, other, q):
    """Greater of the distances of two corners along the axes; of rows of arrays it takes longer."""
    return max(abs(polygon[p, U] - other[q, U]), abs(polygon[p, V] - other[q, V]))


@allocation_free
def without_needless(polygon, n, nearest, out):
    """Copy a polygon without corners that rounding may have put anywhere; returns their count.

    These are corners no farther than `nearest` from the one before, or from the line through both
    neighbours: a short side that continues a long one has a direction of few digits, and beyond its
    line may lie corners of the polygon itself.
    """
    kept = 0
    for p in range(n):
        if kept == 0 or distance_in_axes(polygon, p, out, kept - 1) > nearest:
            out[kept, U], out[kept, V] = polygon[p, U], polygon[p, V]
            kept += 1
    while kept > 1 and distance_in_axes(out, 0, out, kept - 1) <= nearest:
        kept -= 1
    n, kept = kept, 0
    for p in range(n):
        before, after = kept - 1 if kept > 0 else n - 1, p + 1 if p + 1 < n else 0
        x, y = out[after, U] - out[before, U], out[after, V] - out[before, V]
        away = (out[p, V] - out[before, V]) * x - (out[p, U] - out[before, U]) * y
        if kept + n - p > 3 and abs(away) <= nearest * length2(x, y):
            continue
        out[kept, U], out[kept, V] = out[p, U], out[p, V]
        kept += 1
    return kept


@part_with_arrays
def push(top, n, one, other, stack):
    """Count a polygon of n corners as the top of a stack, with its numbers; the new height."""
    stack.n_corners[top], stack.tags[top, 0], stack.tags[top, 1] = n, one, other
    return top + 1


@part_with_arrays
def push_parts(polygon, n, one, other, stack):
    """Put a polygon on an empty stack, in parts of at most `MOST_CORNERS` corners; their number."""
    first, top = 1, 0
    while first + 1 < n:
        m = corners_of_part(first, n)
        copy_part(polygon, first, m, stack.corners[top])
        top = push(top, m, one, other, stack)
        first += m - 2
    return top


@allocation_free
def append_piece(face, polygon, n, nearest, tidy, out):
    """Append a convex polygon to the regions, in pieces of at most `MOST_CORNERS` corners.

    The difference that leaving out needless corners makes is added to the bound of the face.
    """
    before = twice_area(polygon, n) / 2 if n >= 3 else 0.0
    kept = without_needless(polygon, n, nearest, tidy)
    area = twice_area(tidy, kept) / 2 if kept >= 3 else 0.0
    if not area > 0:
        out.bound[face] += max(before, 0.0)
        return
    out.area[face] += area
    out.bound[face] += abs(area - before)
    first = 1
    while first + 1 < kept:
        piece, at, m = out.used[0], out.used[1], corners_of_part(first, kept)
        if piece < out.face.shape[0] and at + m <= out.xy.shape[0]:
            copy_part(tidy, first, m, out.xy[at:])
            out.face[piece] = face
            out.starts[piece + 1] = at + m
        out.used[0], out.used[1] = piece + 1, at + m
        first += m - 2


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
def extent_of(polygon, n):
    """Greatest distance of a corner from the first: between half the diameter and all of it."""
    extent = 0.0
    for p in range(1, n):
        away = length2(polygon[p, U] - polygon[0, U], polygon[p, V] - polygon[0, V])
        extent = max(extent, away)
    return extent


def by_criteria(curved: Any) -> Any:
    """Function of the criteria of a pinhole that is `curved` for those of other lenses."""
    return by_type("criteria", LensCriteria, curved)


def _mask_through_lens(criteria):
    mask = DENSE if criteria.rules.min_pixel_density > 0 else 0
    if criteria.rules.min_pixels_per_m2 > 0:
        mask |= PER_M2
    if criteria.rules.min_facing_density > 0:
        mask |= FACING
    if criteria.by_distance and criteria.rules.z_n > 0:
        mask |= DISTANT
    return mask


@by_criteria(_mask_through_lens)
def mask_of(criteria):
    """Criteria that are decided piece by piece; the others of a pinhole are half planes."""
    return DENSE if criteria.rules.min_pixel_density > 0 else 0


def _slopes_through_lens(criteria, x, y):
    return plane_slopes(criteria.code, criteria.params, criteria.frame, x, y)


@by_criteria(_slopes_through_lens)
def slopes_of(criteria, x, y):
    """Derivatives of the pixel by the place (x, y) in the plane, (u_x, u_y, v_x, v_y)."""
    return criteria.lens.fx, 0.0, 0.0, criteria.lens.fy


def _bounds_through_lens(criteria, low_x, high_x, low_y, high_y):
    return bounds_within(criteria.slopes, low_x, high_x, low_y, high_y)


@by_criteria(_bounds_through_lens)
def bounds_of(criteria, low_x, high_x, low_y, high_y):
    """Bounds of the second and third derivatives within a box of the plane."""
    return 0.0, 0.0


def _sizes_through_lens(criteria, low_x, high_x, low_y, high_y):
    return sizes_within(criteria.slopes, low_x, high_x, low_y, high_y)


@by_criteria(_sizes_through_lens)
def sizes_of(criteria, low_x, high_x, low_y, high_y):
    """Least and greatest |det A| within a box of the plane."""
    return criteria.lens.fx * criteria.lens.fy, criteria.lens.fx * criteria.lens.fy


@allocation_free
def figures_at(criteria, plane, x, y, n_figures, out):
    """Fill `out` with |det A|^(-1/3), the columns of Q A^-1, and those of E A^-1.

    The first alone where `n_figures` is 1. Returns the norm and the least singular value of A, and
    |det A|.
    """
    a, b, c, d = slopes_of(criteria, x, y)
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
    low_x, high_x, low_y, high_y = box_of(places, n)
    x = y = 0.0
    least_w, most_w = math.inf, 0.0
    for p in range(n):
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
        least_det, most_det = sizes_of(criteria, low_x, high_x, low_y, high_y)
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
    second, third = bounds_of(criteria, low_x - step, high_x + step, low_y - step, high_y + step)
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
def line_in_plane(a, b, c, plane):
    """Value, and its slopes along x and y in the plane of the face, of a line of the ideal plane.

    The line is a x + b y + c, or a X + b Y + c Z in camera axes.
    """
    return (
        a * plane[ORIGIN] + b * plane[ORIGIN + 1] + c * plane[ORIGIN + 2],
        a * plane[X_AXIS] + b * plane[X_AXIS + 1] + c * plane[X_AXIS + 2],
        a * plane[Y_AXIS] + b * plane[Y_AXIS + 1] + c * plane[Y_AXIS + 2],
    )


@part_with_arrays
def line_of(fits, i, offset, plane):
    """Line in the plane of the face along criterion i, moved by an offset: value, slopes."""
    a, b, c = fits[i, 0], fits[i, 1], fits[i, 2] + offset
    if i == 3:
        return c, a, b
    return line_in_plane(a, b, c, plane)


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


@part_with_arrays
def append_dense(face, polygon, n, criteria, scratch, out):
    """Append the part of a polygon that meets all criteria of densities; see the module."""
    mask = mask_of(criteria)
    if mask == 0:  # here: a call with all these arrays takes as long as the rest
        append_piece(face, polygon, n, nearest_corners(scratch.plane), scratch.tidy, out)
    else:
        append_by_densities(face, polygon, n, mask, criteria, scratch, out)


@part_with_arrays
def nearest_corners(plane):
    """Distance below which corners in the plane of a face are the same, metres."""
    return max(COINCIDENT_REL * plane[LONGEST], plane[ERROR])


@allocation_free
def append_by_densities(face, polygon, n, mask, criteria, scratch, out):
    """Append the part of a polygon that meets the criteria of a mask."""
    plane, strips = scratch.plane, scratch.strips
    part, spare, fits, other = scratch.inner, scratch.spare, scratch.fits, scratch.other
    nearest = nearest_corners(plane)
    top = push_parts(polygon, n, mask, 0, strips)
    while top > 0:
        top -= 1
        n, mask, level = strips.n_corners[top], strips.tags[top, 0], strips.tags[top, 1]
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
                    top = push(top, m, mask - (1 << best), level, strips)
            n = keep_beyond(part, n, inner, -1.0, spare)
            if n >= 3:
                n = keep_beyond(spare, n, outer, 1.0, part)
            if n < 3:
                continue
        rest = max(twice_area(part, n) / 2, 0.0)
        if (
            rest <= criteria.gap * extent_of(part, n)
            or level == MOST_HALVINGS
            or top + 2 > STACK_ROOM
        ):
            out.bound[face] += rest
            continue
        top = halve_part(part, n, scratch, top, mask, level + 1)


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
def halve_part(polygon, n, scratch, top, mask, level):
    """Push both halves of a polygon across its longest extent in the image; height of the stack."""
    strips, places = scratch.strips, scratch.places
    place_corners(polygon, n, scratch.plane, places)
    far = farthest_from(places, n, 0)
    other = farthest_from(places, n, far)
    a = places[far, 0] - places[other, 0]
    b = places[far, 1] - places[other, 1]
    c = -0.5 * (a * (places[far, 0] + places[other, 0]) + b * (places[far, 1] + places[other, 1]))
    scratch.fits[0, 0], scratch.fits[0, 1], scratch.fits[0, 2] = a, b, c
    line = line_of(scratch.fits, 0, 0.0, scratch.plane)
    for side in range(2):
        m = keep_beyond(polygon, n, line, 1.0 if side == 0 else -1.0, strips.corners[top])
        if m >= 3:
            top = push(top, m, mask, level, strips)
    return top


@part_with_arrays
def farthest_from(places, n, start):
    """Corner that is farthest from another one, the first of equals."""
    far, extent = 0, -1.0
    for p in range(n):
        away = length2(places[p, 0] - places[start, 0], places[p, 1] - places[start, 1])
        if away > extent:
            far, extent = p, away
    return far
