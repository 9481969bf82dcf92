"""Regions of one face in its own plane: half planes, outlines and the list of pieces; by numba.

A polygon is counter-clockwise in the plane of its face, which `rastercov.kernels.exact_polygon`
calls clockwise: there v points down. Lines are those of `kernels.exact_records`, with the largest
error of their value in the column LINE_ERROR.
"""

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
from rastercov.kernels.exact_records import DU, DV, LINE_ERROR, OFFSET, PIECE_ROOM, Pieces, U, V
from rastercov.kernels.jit import allocation_free, part_of, part_with_arrays
from rastercov.kernels.lens_field import Tree
from rastercov.kernels.lens_slopes import Slopes

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
