"""Field of view of a lens in an ideal plane, as a tree of lines; compiled by numba.

The part of a plane that the image shows has curved borders. The tree divides the plane by straight
lines into convex cells that are wholly inside the image, wholly outside, or so narrow that they are
left undecided. A border through a cell is replaced by two parallel lines: the image of what is
beyond the first one is inside the border, of what is before the second one outside. What is between
them is halved, and each half has lines of its own, until it is narrower than a tolerance.

The lines are found from samples, and then verified: the images of both cells are measured by the
integrals along their edges (`lens_polygons`), so that samples decide about the cost alone. Where
a cell is not inside, or not outside, it is halved, too.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.kernels.jit import allocation_free
from rastercov.kernels.lens_field_cells import (
    MARGIN,
    SAFETY,
    area_and_extent,
    extremes,
    halving_line,
    keep_side,
    line_of_border,
    narrowest_border,
    side_of_image,
)
from rastercov.kernels.lens_polygons import MOST_CORNERS, EdgeScratch, edge_scratch

FloatArray = NDArray[np.float64]

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


class Tree(NamedTuple):
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

    lines: FloatArray
    children: NDArray[np.int32]
    kinds: NDArray[np.uint8]
    root: int


class Growing(NamedTuple):
    """A tree that is filled; `root` has its first node or leaf, and the number of nodes."""

    lines: FloatArray
    children: NDArray[np.int32]
    kinds: NDArray[np.uint8]
    root: NDArray[np.int64]


class TreeScratch(NamedTuple):
    """Stack of cells, and scratch for one.

    A cell has corners, the sides of region and hole that may still cut it, a bit for each border of
    the image that it may cross, its place in the tree, and the number of times it was halved.
    """

    corners: FloatArray
    n_corners: NDArray[np.int64]
    sides: NDArray[np.bool_]
    hole: NDArray[np.bool_]
    borders: NDArray[np.int64]
    owner: NDArray[np.int64]
    level: NDArray[np.int64]
    cell: FloatArray
    other: FloatArray
    spare: FloatArray
    fit: FloatArray
    line: FloatArray
    edges: EdgeScratch


def tree_scratch(n_sides: int, n_hole: int) -> TreeScratch:
    """Memory for a tree of a region and a hole, by the numbers of their sides."""
    n = STACK_ROOM
    return TreeScratch(
        corners=np.empty((n, MOST_CORNERS, 2)),
        n_corners=np.empty(n, np.int64),
        sides=np.empty((n, n_sides), np.bool_),
        hole=np.empty((n, n_hole), np.bool_),
        borders=np.empty(n, np.int64),
        owner=np.empty(n, np.int64),
        level=np.empty(n, np.int64),
        cell=np.empty((MOST_CORNERS, 2)),
        other=np.empty((MOST_CORNERS, 2)),
        spare=np.empty((MOST_CORNERS, 2)),
        fit=np.empty((4, 5)),
        line=np.empty(3),
        edges=edge_scratch(),
    )


def room_for_tree(n: int) -> Growing:
    """Memory for a tree of n nodes."""
    children, kinds = np.empty((n, 2), np.int32), np.empty(n, np.uint8)
    return Growing(np.empty((n, 3)), children, kinds, np.zeros(2, np.int64))


@allocation_free
def push(polygon, n, owner, borders, level, work, top):
    """Put a cell on the stack with the sides of the entry at `top`; the height of the stack."""
    for p in range(n):
        work.corners[top, p, 0], work.corners[top, p, 1] = polygon[p, 0], polygon[p, 1]
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
    for s in range(work.sides.shape[1]):
        work.sides[0, s] = True
    for s in range(work.hole.shape[1]):
        work.hole[0, s] = True
    top = push(box, 4, -1, ALL_BORDERS + (HOLE if hole_lines.shape[0] > 0 else 0), 0, work, 0)
    while top > 0:
        top -= 1
        n, owner = work.n_corners[top], work.owner[top]
        level, borders = work.level[top], work.borders[top]
        for p in range(n):
            cell[p, 0], cell[p, 1] = work.corners[top, p, 0], work.corners[top, p, 1]
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
                for p in range(n):
                    cell[p, 0], cell[p, 1] = other[p, 0], other[p, 1]
            line_of_border(plane, fit, k, -least, line)
            _, high = extremes(line, cell, n) if n >= 3 else (0.0, 0.0)
            m = keep_side(cell, n, line, 1.0, other) if high > 0.0 else 0
            if m >= 3:
                node = append_node(line, BORDER, owner, out)
                n = keep_side(cell, n, line, -1.0, work.spare)
                for p in range(n):
                    cell[p, 0], cell[p, 1] = work.spare[p, 0], work.spare[p, 1]
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
