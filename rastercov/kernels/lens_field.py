"""Field of view of a lens in an ideal plane, as a tree of lines; compiled by numba.

The part of a plane that the image shows has curved borders. The tree divides the plane by straight
lines into convex cells that are wholly inside the image, wholly outside, or so narrow that they are
left undecided. A border through a cell is replaced by two parallel lines: the image of what is
beyond the first one is inside the border, of what is before the second one outside. What is between
them is halved, and each half has lines of its own, until it is narrower than a tolerance.

The lines are found from samples, and then verified: the images of both cells are measured by the
integrals along their edges (`lens_polygons`), so that samples decide about the cost alone. Where
a cell is not inside, or not outside, it is halved, too.

Beside it, bounds of the derivatives of a lens over a box of an ideal plane, from the grid of
`rastercov.camera.lenses.slopes`.
"""

import math
from collections import namedtuple

import numpy as np
from numpy.typing import NDArray

from rastercov.kernels.exact_polygon import copy_polygon, keep_inside
from rastercov.kernels.jit import allocation_free, part_with_arrays
from rastercov.kernels.lens_edges import plane_value
from rastercov.kernels.lens_polygons import MOST_CORNERS, edge_scratch, polygon_image

FloatArray = NDArray[np.float64]

CELLS, PARTS = 32, 4
"""Cells of a side of the grid for balls, and parts of the side of a cell."""


Slopes = namedtuple(
    "Slopes", "low_x low_y per_x per_y second third sizes is_graded near_pole_2 near_pole_3"
)
"""Bounds of derivatives along lines of a plane, px per unit^2 and unit^3.

Attributes
----------
low_x, low_y, per_x, per_y : float
    Corner of the grid, and cells a unit.
second, third : (CELLS PARTS, CELLS PARTS) float64
    By row (y) and column (x); 0 beyond the region.
sizes : (2, CELLS, CELLS) float64
    Least and greatest |det A|, A the first derivative of pixels, px^2, of each cell of PARTS x
    PARTS parts; infinite and 0 beyond the region; 0 and infinite where nothing is known.
is_graded : bool
    The plane has a pole at (0, 0): bounds at a distance d from it are the next two numbers,
    over d^2 and d^3.
near_pole_2, near_pole_3 : float
"""


@part_with_arrays
def parts_within(slopes, low_x, high_x, low_y, high_y):
    """First and last column, and first and last row, of the parts that meet a box of a plane."""
    last = slopes.second.shape[0] - 1
    return (
        min(max(int((low_x - slopes.low_x) * slopes.per_x), 0), last),
        min(max(int((high_x - slopes.low_x) * slopes.per_x), 0), last),
        min(max(int((low_y - slopes.low_y) * slopes.per_y), 0), last),
        min(max(int((high_y - slopes.low_y) * slopes.per_y), 0), last),
    )


@allocation_free
def bounds_within(slopes, low_x, high_x, low_y, high_y):
    """Bounds of the second and third derivatives in the region within a box of a plane."""
    second = third = 0.0
    if slopes.is_graded:
        x = max(low_x, -high_x, 0.0)
        y = max(low_y, -high_y, 0.0)
        d2 = x * x + y * y
        return slopes.near_pole_2 / d2, slopes.near_pole_3 / (d2 * np.sqrt(d2))
    left, right, top, bottom = parts_within(slopes, low_x, high_x, low_y, high_y)
    for row in range(top, bottom + 1):
        for column in range(left, right + 1):
            second = max(second, slopes.second[row, column])
            third = max(third, slopes.third[row, column])
    return second, third


@allocation_free
def sizes_within(slopes, low_x, high_x, low_y, high_y):
    """Least and greatest `Slopes.sizes` in the region within a box of a plane; 0 at a pole."""
    if slopes.is_graded:
        return 0.0, math.inf
    least, most = math.inf, 0.0
    left, right, top, bottom = parts_within(slopes, low_x, high_x, low_y, high_y)
    for row in range(top // PARTS, bottom // PARTS + 1):
        for column in range(left // PARTS, right // PARTS + 1):
            least = min(least, slopes.sizes[0, row, column])
            most = max(most, slopes.sizes[1, row, column])
    return least, most


SAMPLES = 4
"""Parts of a side of a triangle between samples."""
MARGIN = 1e-9
"""Pixels that a line keeps away from the border, for rounding."""
SAFETY = 0.05
"""Part of the range of the samples by which the lines are moved apart."""
ROUNDING = 2.0**-46
"""Rounding of the area under an edge, relative to its length and the size of the image."""


@part_with_arrays
def value_at(line, x, y):
    """Value of a line (a, b, c) at a point."""
    return line[0] * x + line[1] * y + line[2]


@allocation_free
def extremes(line, polygon, n):
    """Least and greatest value of a line at the corners of a polygon."""
    least, most = math.inf, -math.inf
    for p in range(n):
        value = value_at(line, polygon[p, 0], polygon[p, 1])
        least, most = min(least, value), max(most, value)
    return least, most


@part_with_arrays
def farthest_from(polygon, n, start):
    """Corner that is farthest from another one, and how far it is."""
    far, extent = start, 0.0
    for p in range(n):
        away = math.hypot(polygon[p, 0] - polygon[start, 0], polygon[p, 1] - polygon[start, 1])
        if away > extent:
            far, extent = p, away
    return far, extent


@allocation_free
def area_and_extent(polygon, n):
    """Area of a polygon, and its greatest distance of corners, to a factor of 2; far corners."""
    area = 0.0
    for p in range(1, n - 1):
        area += (polygon[p, 0] - polygon[0, 0]) * (polygon[p + 1, 1] - polygon[0, 1])
        area -= (polygon[p + 1, 0] - polygon[0, 0]) * (polygon[p, 1] - polygon[0, 1])
    far, extent = farthest_from(polygon, n, 0)
    other, extent = farthest_from(polygon, n, far)
    return 0.5 * area, extent, far, other


@allocation_free
def keep_side(polygon, n, line, sign, out):
    """Part of a polygon where sign times a line is >= 0; its corner count."""
    a, b, c = sign * line[0], sign * line[1], sign * line[2]
    # The point of the line that is nearest to the origin; the inner side is on the left of (b, -a).
    return keep_inside(polygon, n, (-a * c, -b * c, b, -a, 0.0), out)


@allocation_free
def fit_borders(plane, polygon, n, fit):
    """Fill `fit` with an affine map u = a x + b y + c, and least and greatest u less that; and v.

    Rows are (a, b, c, least, greatest) of u and v, from samples in the polygon; then the least
    u, width - u, v, height - v of the samples, and the greatest of each.
    """
    cx = cy = 0.0
    for p in range(n):
        cx += polygon[p, 0] / n
        cy += polygon[p, 1] / n
    reach = 0.0
    for p in range(n):
        reach = max(reach, math.hypot(polygon[p, 0] - cx, polygon[p, 1] - cy))
    step = 1e-3 * reach
    for axis in range(2):
        dx, dy = (step, 0.0) if axis == 0 else (0.0, step)
        u1, v1 = plane_value(plane, cx + dx, cy + dy)
        u0, v0 = plane_value(plane, cx - dx, cy - dy)
        fit[0, axis], fit[1, axis] = 0.5 * (u1 - u0) / step, 0.5 * (v1 - v0) / step
    u, v = plane_value(plane, cx, cy)
    fit[0, 2], fit[1, 2] = u - fit[0, 0] * cx - fit[0, 1] * cy, v - fit[1, 0] * cx - fit[1, 1] * cy
    fit[0, 3] = fit[1, 3] = fit[0, 4] = fit[1, 4] = 0.0
    low_u = high_u = u
    low_v = high_v = v
    for p in range(n):
        q = p + 1 if p + 1 < n else 0
        for i in range(SAMPLES + 1):
            for j in range(SAMPLES + 1 - i):
                if i + j == 0:
                    continue
                s, t = i / SAMPLES, j / SAMPLES
                x = cx + s * (polygon[p, 0] - cx) + t * (polygon[q, 0] - cx)
                y = cy + s * (polygon[p, 1] - cy) + t * (polygon[q, 1] - cy)
                u, v = plane_value(plane, x, y)
                low_u, high_u = min(low_u, u), max(high_u, u)
                low_v, high_v = min(low_v, v), max(high_v, v)
                u -= fit[0, 0] * x + fit[0, 1] * y + fit[0, 2]
                v -= fit[1, 0] * x + fit[1, 1] * y + fit[1, 2]
                fit[0, 3], fit[0, 4] = min(fit[0, 3], u), max(fit[0, 4], u)
                fit[1, 3], fit[1, 4] = min(fit[1, 3], v), max(fit[1, 4], v)
    fit[2, 0], fit[2, 1], fit[2, 2], fit[2, 3] = (
        low_u, plane.width - high_u, low_v, plane.height - high_v,
    )  # fmt: skip
    fit[3, 0], fit[3, 1], fit[3, 2], fit[3, 3] = (
        high_u, plane.width - low_u, high_v, plane.height - low_v,
    )  # fmt: skip


@allocation_free
def side_of_image(plane, polygon, n, slope, edges):
    """1 where a cell is inside the image, -1 where it is outside, otherwise 0; by its areas.

    `slope` is about the pixels to a unit of the plane.
    """
    whole, inside, rules = polygon_image(plane, polygon, 0, n, edges, True)
    whole, inside = abs(whole), abs(inside)
    _, extent, _, _ = area_and_extent(polygon, n)
    spill = rules * plane.tolerance
    spill += ROUNDING * (plane.width + plane.height) * 4 * slope * extent
    if whole - inside <= spill and inside > spill:
        return 1
    return -1 if inside <= spill else 0


@allocation_free
def line_of_border(plane, fit, k, offset, out):
    """Line, of unit normal, along border k of an affine fit, moved inwards by an offset, px."""
    row = k // 2
    sign = 1.0 if k % 2 == 0 else -1.0
    at = 0.0 if k % 2 == 0 else (plane.width if row == 0 else plane.height)
    size = math.hypot(fit[row, 0], fit[row, 1])
    out[0], out[1] = sign * fit[row, 0] / size, sign * fit[row, 1] / size
    out[2] = (sign * (fit[row, 2] - at) - offset) / size


@allocation_free
def halving_line(polygon, far, other, out):
    """Line across the longest extent of a polygon, through its middle."""
    dx, dy = polygon[far, 0] - polygon[other, 0], polygon[far, 1] - polygon[other, 1]
    size = math.hypot(dx, dy)
    x, y = 0.5 * (polygon[far, 0] + polygon[other, 0]), 0.5 * (polygon[far, 1] + polygon[other, 1])
    out[0], out[1] = dx / size, dy / size
    out[2] = -(dx * x + dy * y) / size


@allocation_free
def narrowest_border(plane, cell, n, borders, fit):
    """Borders that samples do not have all of a cell inside of, and the one of the narrowest band.

    That one is -1 for none, and -2 where samples have all of the cell outside.
    """
    fit_borders(plane, cell, n, fit)
    best, narrowest = -1, math.inf
    for k in range(4):
        if not borders >> k & 1:
            continue
        row = k // 2
        if fit[2, k] >= -MARGIN:
            borders -= 1 << k
        elif fit[3, k] <= MARGIN:
            return borders, -2, 0.0
        else:
            slope = math.hypot(fit[row, 0], fit[row, 1])
            width = fit[row, 4] - fit[row, 3]
            width = (width + 2.0 * (SAFETY * width + MARGIN)) / slope
            if width < narrowest:
                best, narrowest = k, width
    return borders, best, narrowest


INSIDE, OUTSIDE, UNDECIDED = -1, -2, -3
"""Leaves of the tree, in place of nodes."""
HALVING, BAND, BORDER = range(3)
"""Kinds of nodes: a line without meaning, one that halves the band along a border, and a border of
the region or one side of the band, where rounding of a position counts."""
DEEPEST = 60
"""Halvings, after which a cell is undecided."""
MOST_SIDES = 16
"""Straight sides of the region that a cell is cut by before it is halved."""
STACK_ROOM = 512
ON_LINE = 1e-13
"""Distance from a side of the region, in units of the plane, up to which a corner is on it."""
LEAST_AREA = 1e-26
"""Area of a cell, in units of the plane, that no border divides."""
ALL_BORDERS, HOLE = 15, 16
"""Bits of the borders u = 0, u = width, v = 0, v = height; of a hole that a cell may reach."""


Tree = namedtuple("Tree", "lines children kinds root")
"""Field of view of a plane: rays (x, y, 1) with a x + b y + c >= 0 are inside a line.

Attributes
----------
lines : (N, 3) float64
    a, b, c of each node, (a, b) of unit length.
children : (N, 2) int32
    What follows inside and outside: a node or a leaf.
kinds : (N,) uint8
root : int
    Node 0 or a leaf.
"""


Growing = namedtuple("Growing", "lines children kinds root")
"""A tree that is filled; `root` has its first node or leaf, and the number of nodes."""


TreeScratch = namedtuple(
    "TreeScratch",
    "corners n_corners sides hole borders owner level cell other spare fit line edges",
)
"""Stack of cells, and scratch for one.

A cell has corners, the sides of region and hole that may still cut it, a bit for each border of the
image that it may cross, its place in the tree, and the number of times it was halved.
"""


def tree_scratch(n_sides: int, n_hole: int) -> TreeScratch:
    """Memory for a tree of a region and a hole, by the numbers of their sides."""
    n, edges = STACK_ROOM, edge_scratch()
    sides, hole = np.empty((n, n_sides), np.bool_), np.empty((n, n_hole), np.bool_)
    n_corners, borders, owner, level = np.empty((4, n), np.int64)
    corners, polygons = np.empty((n, MOST_CORNERS, 2)), np.empty((3, MOST_CORNERS, 2))
    of_cells = corners, n_corners, sides, hole, borders, owner, level
    return TreeScratch._make([*of_cells, *polygons, np.empty((4, 5)), np.empty(3), edges])


def room_for_tree(n: int) -> Growing:
    """Memory for a tree of n nodes."""
    children, kinds = np.empty((n, 2), np.int32), np.empty(n, np.uint8)
    return Growing(np.empty((n, 3)), children, kinds, np.zeros(2, np.int64))


@allocation_free
def push(polygon, n, owner, borders, level, work, top):
    """Put a cell on the stack with the sides of the entry at `top`; the height of the stack."""
    copy_polygon(polygon, n, work.corners[top])
    work.n_corners[top], work.level[top] = n, level
    work.owner[top], work.borders[top] = owner, borders
    return top + 1


@allocation_free
def copy_sides(work, source, target):
    """Copy the sides of region and hole that an entry of the stack may still be cut by."""
    for s in range(work.sides.shape[1]):
        work.sides[target, s] = work.sides[source, s]
    for s in range(work.hole.shape[1]):
        work.hole[target, s] = work.hole[source, s]


@allocation_free
def attach(what, owner, out):
    """Make a node or a leaf a child of its owner, 2 times a node and 1 for its outer side."""
    if owner < 0:
        out.root[0] = what
    elif owner // 2 < out.children.shape[0]:
        out.children[owner // 2, owner % 2] = what


@allocation_free
def append_node(line, kind, owner, out):
    """Append a node to the tree; its number."""
    node = out.root[1]
    if node < out.children.shape[0]:
        out.lines[node, 0], out.lines[node, 1], out.lines[node, 2] = line[0], line[1], line[2]
        out.kinds[node] = kind
        out.children[node, 0] = out.children[node, 1] = UNDECIDED
    out.root[1] = node + 1
    attach(node, owner, out)
    return node


@allocation_free
def first_cutting(lines, is_open, polygon, n):
    """First of the open sides that cuts a polygon, or -1, their number, and whether one is beyond.

    Sides that have all of the polygon inside are closed. -2 where the polygon is beyond a side.
    """
    first, count = -1, 0
    for s in range(lines.shape[0]):
        if is_open[s]:
            least, most = extremes(lines[s], polygon, n)
            if most <= ON_LINE:
                return -2, 0
            if least >= -ON_LINE:
                is_open[s] = False
            else:
                if first < 0:
                    first = s
                count += 1
    return first, count


@allocation_free
def split_cell(cell, n, line, kind, owner, borders, level, work, top, out):
    """Append a node and push the parts of a cell on both of its sides; the height of the stack."""
    node = append_node(line, kind, owner, out)
    copy_sides(work, top, top + 1)
    m = keep_side(cell, n, line, -1.0, work.other)
    n = keep_side(cell, n, line, 1.0, work.spare)
    if m >= 3:
        top = push(work.other, m, 2 * node + 1, borders, level, work, top)
    if n >= 3:
        top = push(work.spare, n, 2 * node, borders, level, work, top)
    return top


@allocation_free
def divide(plane, box, region_lines, hole_lines, tolerance, work, out):
    """Fill a tree with the field of view of a plane within a box.

    Parameters
    ----------
    plane : PlaneRecord
    box : (4, 2) float64
        Corners, counter-clockwise.
    region_lines, hole_lines : (K, 3), (M, 3) float64
        Sides of the region that cut the box, and of the hole: the hole is inside all of its own.
    tolerance : float
        Mean width of undecided cells, in units of the plane.
    work : TreeScratch
    out : Growing
        Out: the tree; `root` has the first node or leaf, and the number of nodes, which may be more
        than there is room for.
    """
    cell, other, fit, line = work.cell, work.other, work.fit, work.line
    out.root[0], out.root[1] = OUTSIDE, 0
    work.sides[0, :] = work.hole[0, :] = True
    top = push(box, 4, -1, ALL_BORDERS + (HOLE if hole_lines.shape[0] > 0 else 0), 0, work, 0)
    while top > 0:
        top -= 1
        n, owner = work.n_corners[top], work.owner[top]
        level, borders = work.level[top], work.borders[top]
        copy_polygon(work.corners[top], n, cell)
        area, extent, far, near = area_and_extent(cell, n)
        if area <= LEAST_AREA or level >= DEEPEST or top + 4 > STACK_ROOM:
            attach(UNDECIDED, owner, out)
            continue
        first, count = first_cutting(region_lines, work.sides[top], cell, n)
        if first == -2:
            attach(OUTSIDE, owner, out)
            continue
        if first >= 0:
            if count > MOST_SIDES:
                halving_line(cell, far, near, line)
                top = split_cell(cell, n, line, HALVING, owner, borders, level + 1, work, top, out)
                continue
            node = append_node(region_lines[first], BORDER, owner, out)
            attach(OUTSIDE, 2 * node + 1, out)
            work.sides[top, first] = False
            m = keep_side(cell, n, region_lines[first], 1.0, other)
            if m >= 3:
                top = push(other, m, 2 * node, borders, level, work, top)
            continue
        if borders & HOLE:
            first, count = first_cutting(hole_lines, work.hole[top], cell, n)
            if first == -1:
                attach(OUTSIDE, owner, out)
                continue
            if first == -2:
                borders -= HOLE
            elif count > MOST_SIDES:
                halving_line(cell, far, near, line)
                top = split_cell(cell, n, line, HALVING, owner, borders, level + 1, work, top, out)
                continue
            else:
                top = split_cell(
                    cell, n, hole_lines[first], BORDER, owner, borders, level, work, top, out
                )
                continue
        borders, k, width = narrowest_border(plane, cell, n, borders, fit)
        slope = math.hypot(math.hypot(fit[0, 0], fit[0, 1]), math.hypot(fit[1, 0], fit[1, 1]))
        if k < 0:
            # The samples have decided; the image of the cell must agree.
            wanted = 1 if k == -1 else -1
            if side_of_image(plane, cell, n, slope, work.edges) == wanted:
                attach(INSIDE if wanted == 1 else OUTSIDE, owner, out)
                continue
        elif width <= 0.5 * extent:
            row = k // 2
            spread = SAFETY * (fit[row, 4] - fit[row, 3]) + MARGIN
            # u = fit + rest, rest from least to greatest; of width - u it is the other way round.
            least = (fit[row, 3] if k % 2 == 0 else -fit[row, 4]) - spread
            most = (fit[row, 4] if k % 2 == 0 else -fit[row, 3]) + spread
            line_of_border(plane, fit, k, -most, line)
            low, _ = extremes(line, cell, n)
            m = keep_side(cell, n, line, -1.0, other) if low < 0.0 else 0
            if m >= 3 and side_of_image(plane, other, m, slope, work.edges) == -1:
                node = append_node(line, BORDER, owner, out)
                attach(OUTSIDE, 2 * node + 1, out)
                owner = 2 * node
                n = keep_side(cell, n, line, 1.0, other)
                copy_polygon(other, n, cell)
            line_of_border(plane, fit, k, -least, line)
            _, high = extremes(line, cell, n) if n >= 3 else (0.0, 0.0)
            m = keep_side(cell, n, line, 1.0, other) if high > 0.0 else 0
            if m >= 3:
                node = append_node(line, BORDER, owner, out)
                n = keep_side(cell, n, line, -1.0, work.spare)
                copy_polygon(work.spare, n, cell)
                copy_sides(work, top, top + 1)
                top = push(other, m, 2 * node, borders - (1 << k), level + 1, work, top)
                owner = 2 * node + 1
            area, extent, far, near = area_and_extent(cell, n)
        # What the samples have said so far may be wrong: halves start with all borders.
        if n < 3 or area <= tolerance * extent:
            attach(UNDECIDED, owner, out)
            continue
        halving_line(cell, far, near, line)
        kind = BAND if k >= 0 and width <= 0.5 * extent else HALVING
        top = split_cell(
            cell, n, line, kind, owner, borders | ALL_BORDERS, level + 1, work, top, out
        )
