"""Exact regions of the faces that a pose covers, in the planes of the faces; compiled by numba.

An image point (u, v) has the ray r = ((u - cx)/fx, (v - cy)/fy, 1) in camera axes and shows the
point P = z r of the plane n . P = -h at depth z = -h / (n . r). The visible pieces of
`rastercov.exact` are brought to the plane in this way; a face that is wholly visible in its part
of the image is cut in its own plane. Depth is affine in the plane, so focus and pixels per m^2 are
half planes, and so are the borders of the image and the near plane.

The pixel density is decided piece by piece. A step d (px) in the image moves the point P of the
plane by M d, with P = z r on the ray r and

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

The angle of incidence is at most theta within h tan(theta) of the foot of the camera's
perpendicular, h being its height above the plane. The disc is replaced by the regular polygon of N
corners inscribed in it, whose corners lie in directions that depend on the camera and the plane
alone, so that it does not matter how the plane is cut into faces. The area between the chords and
the arc goes into the bound.

A piece is taken apart from the inside outwards: what lies within 8 chords is covered; beyond each
chord only the rectangle around its segment of the circle is looked at again, with 8 chords of its
own, down to the sides of the polygon.

A polygon is counter-clockwise in the plane of its face, which `rastercov.kernels.exact_polygon`
calls clockwise: there v points down. Lines are those of `kernels.exact_records`, with the largest
error of their value in the column LINE_ERROR.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.kernels.cameras import Lens
from rastercov.kernels.exact_polygon import (
    MOST_CORNERS,
    copy_polygon,
    keep_inside,
    line_at,
    line_value,
    twice_area,
)
from rastercov.kernels.exact_records import (
    DOUBTFUL,
    DU,
    DV,
    LINE_ERROR,
    LIVE,
    OFFSET,
    PIECE_ROOM,
    THIN,
    Pieces,
    U,
    V,
)
from rastercov.kernels.jit import allocation_free, part_of, part_with_arrays
from rastercov.kernels.lens_field import Slopes, Tree

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


class Planes(NamedTuple):
    """Faces of a mesh, of `coverage.area.frames.Frames`; `is_asked` are those to be measured."""

    origin: FloatArray
    x_axis: FloatArray
    y_axis: FloatArray
    normal: FloatArray
    corners: FloatArray
    areas: FloatArray
    two_sided: NDArray[np.bool_]
    is_asked: NDArray[np.bool_]


class Criteria(NamedTuple):
    """Pointwise criteria of a task in the image of a pinhole.

    `rules` are a `coverage.task.Rules`; `gap` is the largest distance between the arc of the
    incidence criterion and its chords, and the mean width of the strips that no test decides,
    metres; `pixel_error` is the largest error of a position in the image, px.
    """

    lens: Lens
    rules: Any
    gap: float
    pixel_error: float


class LensCriteria(NamedTuple):
    """Pointwise criteria of a task in one ideal plane of a lens.

    `pinhole` has what a surface must meet in the plane itself: to be in its image, and the angle of
    incidence; `rules` has all. `by_distance` says whether distances are in focus; if not, depths
    along `axis` are, the axis of the lens in the axes of the plane. `strip_gap` is the mean width
    of the strips that no test decides, metres. `tree` is the field of view; `code`, `params` and
    `frame` are the lens, and `slopes` bounds of its derivatives.
    """

    pinhole: Criteria
    rules: Any
    by_distance: bool
    axis: FloatArray
    strip_gap: float
    tree: Tree
    code: int
    params: FloatArray
    frame: FloatArray
    slopes: Slopes


class Scratch(NamedTuple):
    """Memory of one thread.

    `base`, `part`, `spare`, `other`, `tidy`, `inner` and `seen` are polygons; `lines` bound the
    viewing pyramid and depths, `sides` the face; `arcs`, `levels` and `nodes` belong to the stacks
    `caps`, `strips` and `views`; `first` is the first piece of each face in the image; `plane` is
    the face in camera axes. For densities through a lens, `places` are corners in the ideal plane,
    and `fits` affine parts of the criteria.
    """

    base: FloatArray
    part: FloatArray
    spare: FloatArray
    other: FloatArray
    tidy: FloatArray
    inner: FloatArray
    values: FloatArray
    lines: FloatArray
    sides: FloatArray
    plane: FloatArray
    caps: Pieces
    arcs: NDArray[np.int64]
    strips: Pieces
    levels: NDArray[np.int64]
    views: Pieces
    nodes: NDArray[np.int64]
    seen: FloatArray
    places: FloatArray
    fits: FloatArray
    first: NDArray[np.int64]


class Found(NamedTuple):
    """Regions of a pose: corners, `starts` of N pieces, their faces; area and bound of each face.

    `used` has the pieces and the corners so far, also where there is no room for them.
    """

    xy: FloatArray
    starts: NDArray[np.int64]
    face: NDArray[np.int32]
    used: NDArray[np.int64]
    area: FloatArray
    bound: FloatArray


ORIGIN, X_AXIS, Y_AXIS, NORMAL = 0, 3, 6, 9
"""First columns of vectors in `Scratch.plane`: the frame of a face in camera axes."""
HEIGHT, FOOT_X, FOOT_Y, ERROR, LONGEST = range(12, 17)
"""Further columns: distance of the camera from the plane, negative from behind, and the foot of its
perpendicular; the largest error of a point of the face in camera axes; its longest edge."""


def scratch_for(n_faces: int) -> Scratch:
    """Scratch memory for a mesh."""
    base, part, spare, other, tidy, inner = np.empty((6, PIECE_ROOM, 2))
    return Scratch(
        base=base,
        part=part,
        spare=spare,
        other=other,
        tidy=tidy,
        inner=inner,
        values=np.empty(PIECE_ROOM),
        lines=np.empty((N_LINES, LINE_ERROR + 1)),
        sides=np.empty((3, LINE_ERROR + 1)),
        plane=np.empty(17),
        caps=_stack(),
        arcs=np.empty((STACK_ROOM, 2), np.int64),
        strips=_stack(),
        levels=np.empty(STACK_ROOM, np.int64),
        views=_stack(),
        nodes=np.empty(STACK_ROOM, np.int64),
        seen=np.empty((PIECE_ROOM, 2)),
        places=np.empty((PIECE_ROOM, 3)),
        fits=np.empty((8, 13)),
        first=np.empty(n_faces, np.int64),
    )


def room_for_found(n: int, corners: int, n_faces: int) -> Found:
    """Memory for the regions of a pose."""
    return Found(
        np.empty((corners, 2)),
        np.zeros(n + 1, np.int64),
        np.empty(n, np.int32),
        np.zeros(2, np.int64),
        *np.empty((2, n_faces)),
    )


def _stack() -> Any:
    return Pieces(np.empty((STACK_ROOM, PIECE_ROOM, 2)), np.empty(STACK_ROOM, np.int64))


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
def set_side(lines, s, x0, y0, x1, y1):
    """Store the line from one point to another, whose inner side is on the left."""
    lines[s, U], lines[s, V] = x0, y0
    lines[s, DU], lines[s, DV] = x1 - x0, y1 - y0
    lines[s, OFFSET] = lines[s, LINE_ERROR] = 0.0


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


@allocation_free
def without_needless(polygon, n, nearest, out):
    """Copy a polygon without corners that rounding may have put anywhere; returns their count.

    These are corners no farther than `nearest` from the one before, or from the line through both
    neighbours: a short side that continues a long one has a direction of few digits, and beyond its
    line may lie corners of the polygon itself.
    """
    kept = 0
    for p in range(n):
        if kept > 0:
            near_u = abs(polygon[p, U] - out[kept - 1, U])
            near_v = abs(polygon[p, V] - out[kept - 1, V])
            if max(near_u, near_v) <= nearest:
                continue
        out[kept, U], out[kept, V] = polygon[p, U], polygon[p, V]
        kept += 1
    while kept > 1 and (
        max(abs(out[0, U] - out[kept - 1, U]), abs(out[0, V] - out[kept - 1, V])) <= nearest
    ):
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
def push_parts(polygon, n, stack):
    """Put a polygon on an empty stack, in parts of at most `MOST_CORNERS` corners; their number."""
    first, top = 1, 0
    while first + 1 < n:
        last = min(first + MOST_CORNERS - 2, n - 1)
        corners = stack.corners[top]
        corners[0, U], corners[0, V] = polygon[0, U], polygon[0, V]
        for p in range(first, last + 1):
            corners[1 + p - first, U], corners[1 + p - first, V] = polygon[p, U], polygon[p, V]
        stack.n_corners[top] = last - first + 2
        first = last
        top += 1
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
        last = min(first + MOST_CORNERS - 2, kept - 1)
        piece, at = out.used[0], out.used[1]
        m = last - first + 2
        if piece < out.face.shape[0] and at + m <= out.xy.shape[0]:
            out.xy[at, U], out.xy[at, V] = tidy[0, U], tidy[0, V]
            for p in range(first, last + 1):
                out.xy[at + 1 + p - first, U] = tidy[p, U]
                out.xy[at + 1 + p - first, V] = tidy[p, V]
            out.face[piece] = face
            out.starts[piece + 1] = at + m
        out.used[0], out.used[1] = piece + 1, at + m
        first = last


BISECTIONS = 24
"""Halvings of a side to find a point of it that a test accepts."""
MOST_HALVINGS = 48
"""Halvings of a piece, after which it is undecided."""
MARGIN_REL = 1e-12
"""Greater than the rounding of both sides of either test."""
CHORDS = 8
"""Chords that an arc is divided by at a time."""
FEWEST_CHORDS, MOST_CHORDS = 16, 1 << 20
"""Corners of the polygon in the circle."""
LEAST_INNER_REL = math.cos(math.pi / FEWEST_CHORDS) * (1 - 1e-9)
"""Radius within the chords of any circle of incidence, relative to its own."""
FARTHEST = 2.0
"""Depth up to which a corner is brought back, relative to the deepest corner of its face."""


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


class Seen(NamedTuple):
    """A solved pose: `rotation` world_from_camera and `centre`; see `HalfPlaneSolver`."""

    rotation: NDArray[np.float64]
    centre: NDArray[np.float64]
    near: float
    state: NDArray[np.uint16]
    visible: NDArray[np.float64]
    area: NDArray[np.float64]
    area_error: NDArray[np.float64]
    is_certified: NDArray[np.bool_]
    kept: Any


@part_with_arrays
def to_camera(rotation, axis, f, plane, column):
    """Turn a vector of face f into camera axes, into three columns of `plane`."""
    for k in range(3):
        plane[column + k] = (
            axis[f, 0] * rotation[0, k] + axis[f, 1] * rotation[1, k] + axis[f, 2] * rotation[2, k]
        )


@part_with_arrays
def set_plane(planes, f, seen, plane):
    """Fill `plane` with a face in camera axes; returns the least and the greatest depth of it."""
    rotation, centre = seen.rotation, seen.centre
    to_camera(rotation, planes.x_axis, f, plane, X_AXIS)
    to_camera(rotation, planes.y_axis, f, plane, Y_AXIS)
    to_camera(rotation, planes.normal, f, plane, NORMAL)
    a = planes.origin[f, 0] - centre[0]
    b = planes.origin[f, 1] - centre[1]
    c = planes.origin[f, 2] - centre[2]
    for k in range(3):
        plane[ORIGIN + k] = a * rotation[0, k] + b * rotation[1, k] + c * rotation[2, k]
    # In the axes of the world: the products with a normal along one of them are exact.
    x_axis, y_axis, normal = planes.x_axis, planes.y_axis, planes.normal
    plane[HEIGHT] = -(a * normal[f, 0] + b * normal[f, 1] + c * normal[f, 2])
    plane[FOOT_X] = -(a * x_axis[f, 0] + b * x_axis[f, 1] + c * x_axis[f, 2])
    plane[FOOT_Y] = -(a * y_axis[f, 0] + b * y_axis[f, 1] + c * y_axis[f, 2])
    longest = planes.corners[f, 1, 0]
    plane[LONGEST] = longest
    plane[ERROR] = POSITION_ERROR_REL * (abs(a) + abs(b) + abs(c) + longest)
    least = most = plane[ORIGIN + 2]
    for p in range(1, 3):
        depth = (
            plane[ORIGIN + 2]
            + planes.corners[f, p, U] * plane[X_AXIS + 2]
            + planes.corners[f, p, V] * plane[Y_AXIS + 2]
        )
        least, most = min(least, depth), max(most, depth)
    return least, most


@part_with_arrays
def set_lines(plane, criteria, near, least, most, lines):
    """Fill `lines` with those of depth and of the viewing pyramid; returns the greatest depth."""
    z, z_x, z_y = plane[ORIGIN + 2], plane[X_AXIS + 2], plane[Y_AXIS + 2]
    error, height = plane[ERROR], abs(plane[HEIGHT])
    set_line(lines, NEAR_LINE, z - near, z_x, z_y, error)
    set_line(lines, FOCUS_LINE, z - criteria.rules.z_n, z_x, z_y, error)
    farthest, its_error = criteria.rules.z_f, error
    if criteria.rules.min_facing_density > 0:
        # min(fx, fy) / z, a half plane of depth as the end of the depth of field is.
        limit = min(criteria.lens.fx, criteria.lens.fy) / criteria.rules.min_facing_density
        farthest = min(farthest, limit)
    if criteria.rules.min_pixels_per_m2 > 0:
        limit = (
            criteria.lens.fx * criteria.lens.fy * height / criteria.rules.min_pixels_per_m2
        ) ** (1 / 3)
        if limit < farthest:
            farthest = limit
            its_error += limit * (error / height if height > error else 1.0)
    # Beyond the deepest corner there is nothing to cut, however far that is.
    limit = min(farthest, 2 * abs(most) + 2 * its_error)
    set_line(lines, FAR_LINE, limit - z, -z_x, -z_y, its_error)
    for side in range(4):
        axis = side // 2
        f = criteria.lens.fx if axis == 0 else criteria.lens.fy
        at = criteria.lens.cx if axis == 0 else criteria.lens.cy
        size = criteria.lens.width if axis == 0 else criteria.lens.height
        sign = 1.0 if side % 2 == 0 else -1.0
        ahead = at if side % 2 == 0 else size - at
        set_line(
            lines, LEFT + side,
            sign * f * plane[ORIGIN + axis] + ahead * z,
            sign * f * plane[X_AXIS + axis] + ahead * z_x,
            sign * f * plane[Y_AXIS + axis] + ahead * z_y,
            error * (f + abs(ahead)),
        )  # fmt: skip
    return farthest + its_error


@part_with_arrays
def bring_back(kept, piece, plane, criteria, deepest, out):
    """Bring a piece of the image to the plane of its face, counter-clockwise; its corner count."""
    n = kept.starts[piece + 1] - kept.starts[piece]
    normal_x, normal_y, normal_z = plane[NORMAL], plane[NORMAL + 1], plane[NORMAL + 2]
    is_reversed = plane[HEIGHT] > 0  # v points down, and the front is seen
    for p in range(n):
        at = kept.starts[piece] + (n - 1 - p if is_reversed else p)
        x = (kept.corners[at, U] - criteria.lens.cx) / criteria.lens.fx
        y = (kept.corners[at, V] - criteria.lens.cy) / criteria.lens.fy
        slope = normal_x * x + normal_y * y + normal_z
        # A corner near the horizon of the plane lies beyond the face.
        z = FARTHEST * deepest
        if slope * plane[HEIGHT] < 0:
            z = min(z, -plane[HEIGHT] / slope)
        along = plane[X_AXIS] * x + plane[X_AXIS + 1] * y + plane[X_AXIS + 2]
        across = plane[Y_AXIS] * x + plane[Y_AXIS + 1] * y + plane[Y_AXIS + 2]
        out[p, U], out[p, V] = plane[FOOT_X] + z * along, plane[FOOT_Y] + z * across
    return n


@part_with_arrays
def set_sides(planes, f, sides):
    """Fill `sides` with the lines along the edges of a face."""
    for p in range(3):
        q = p + 1 if p < 2 else 0
        set_side(
            sides, p, planes.corners[f, p, U], planes.corners[f, p, V],
            planes.corners[f, q, U], planes.corners[f, q, V],
        )  # fmt: skip


@part_with_arrays
def is_well_inside(corners, lines, plane, criteria):
    """True if a face meets all criteria of `lines` and of incidence by more than rounding.

    It is then a piece as it is: most faces of a fine mesh are decided here.
    """
    reach = abs(plane[HEIGHT]) * criteria.rules.tan_incidence * LEAST_INNER_REL
    reach -= plane[ERROR] * (2 + criteria.rules.tan_incidence)
    is_inside = True
    for p in range(3):
        u, v = corners[p, U], corners[p, V]
        for s in range(N_LINES):
            if not line_value(line_at(lines, s), u, v) > lines[s, LINE_ERROR]:
                is_inside = False
        x, y = u - plane[FOOT_X], v - plane[FOOT_Y]
        if criteria.rules.tan_incidence > 0 and not (reach > 0 and x * x + y * y < reach * reach):
            is_inside = False
    return is_inside


@allocation_free
def cut_regions(planes, criteria, seen, scratch, out):
    """Regions of all faces that one pose covers.

    Parameters
    ----------
    planes, criteria, seen, scratch
        Planes; Criteria; Seen; Scratch.
    out : Found
        Where `used` is more than there is room for, call again with that much.
    """
    plane, lines, sides, first = scratch.plane, scratch.lines, scratch.sides, scratch.first
    base, part, spare, kept = scratch.base, scratch.part, scratch.spare, seen.kept
    area, bound, corners = out.area, out.bound, planes.corners
    first[:] = -1
    for p in range(kept.used[0] - 1, -1, -1):
        first[kept.faces[p]] = p
    out.used[:] = 0
    for f in range(planes.areas.shape[0]):
        area[f] = bound[f] = 0.0
        state = seen.state[f]
        if not planes.is_asked[f] or not state & (LIVE | THIN | DOUBTFUL):
            continue
        image_error = 0.0 if seen.is_certified[f] else seen.area_error[f]
        if state & LIVE and seen.visible[f] == 0 and image_error == 0:
            continue
        least, most = set_plane(planes, f, seen, plane)
        height, error = plane[HEIGHT], plane[ERROR]
        if planes.two_sided[f]:
            height = abs(height)
        if height <= -error:
            continue
        farthest = set_lines(plane, criteria, seen.near, least, most, lines)
        nearest = max(seen.near, criteria.rules.z_n)
        if most < nearest - error or least > farthest:
            continue
        for p in range(3):
            base[p, U], base[p, V] = corners[f, p, U], corners[f, p, V]
        if (
            seen.visible[f] >= seen.area[f]
            and seen.visible[f] > 0
            and image_error == 0
            and height > error
            and criteria.rules.min_pixel_density == 0
            and is_well_inside(base, lines, plane, criteria)
        ):
            append_dense(f, base, 3, criteria, scratch, out)
            bound[f] = min(bound[f], planes.areas[f])
            continue
        n, strips = cut_by_lines(base, np.int64(3), lines, 0, N_LINES, spare)
        if n < 3:
            bound[f] = min(strips, planes.areas[f])
            continue
        deepest, shallowest = 0.0, np.inf
        for p in range(n):
            depth = (
                plane[ORIGIN + 2] + base[p, U] * plane[X_AXIS + 2] + base[p, V] * plane[Y_AXIS + 2]
            )
            deepest, shallowest = max(deepest, depth), min(shallowest, depth)
        if height + error < shallowest * criteria.rules.cos_incidence * (1 - POSITION_ERROR_REL):
            continue
        largest = min(twice_area(base, n) / 2 + strips, planes.areas[f])
        if height <= error:
            bound[f] = largest
            continue
        reach2 = 0.0
        for p in range(n):
            x, y = base[p, U] - plane[FOOT_X], base[p, V] - plane[FOOT_Y]
            reach2 = max(reach2, x * x + y * y + height * height)
        # One px^2 of the image is z^3 / (fx fy h) m^2 of the plane.
        bound[f] = (
            image_error
            * (deepest / criteria.lens.fx)
            * (deepest / criteria.lens.fy)
            * (deepest / height)
        )
        if seen.visible[f] >= seen.area[f] and seen.visible[f] > 0:
            bound[f] += strips
            append_within_angle(f, base, n, criteria.rules.tan_incidence, criteria, scratch, out)
        elif seen.visible[f] > 0 and first[f] >= 0:
            set_sides(planes, f, sides)
            # Rounding of the position, the height and the ray, brought to the plane.
            off = (
                2 * POSITION_ERROR_REL
                + 2 * criteria.pixel_error / min(criteria.lens.fx, criteria.lens.fy)
            ) * (reach2 / height)
            p = first[f]
            while p < kept.used[0] and kept.faces[p] == f:
                n = bring_back(kept, p, plane, criteria, most, part)
                for s in range(3):
                    if n >= 3:
                        n = keep_inside(part, n, line_at(sides, s), spare)
                        copy_polygon(spare, n, part)
                if n >= 3:
                    n, strips = cut_by_lines(part, n, lines, FOCUS_LINE, LEFT, spare)
                    bound[f] += strips
                if n >= 3:
                    bound[f] += off * perimeter_of(part, n)
                    append_within_angle(
                        f, part, n, criteria.rules.tan_incidence, criteria, scratch, out
                    )
                p += 1
        bound[f] = min(bound[f], largest)
