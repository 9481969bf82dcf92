"""Cells of faces by bisection of the longest side, and their shares of regions; compiled by numba.

The cells of a face are the leaves of a binary tree: a triangle with a side longer than the wanted
size is halved from the middle of its longest side. Nodes are numbered in preorder, so that the
left child of node i is i + 1 and the right one i + 2 n, n being the leaves below the left one; the
tree is stored as the number of leaves below each node.

M.-C. Rivara. Algorithms for Refining Triangular Grids Suitable for Adaptive and Multigrid
Techniques. 1984.
"""

from collections import namedtuple

import numpy as np
from numpy.typing import NDArray

from rastercov.kernels.exact_polygon import copy_polygon, keep_inside, twice_area
from rastercov.kernels.exact_records import PIECE_ROOM, Pieces, U, V
from rastercov.kernels.jit import allocation_free, part_with_arrays

DEEPEST = 128
"""Levels of a tree; each halves the area."""
WHOLE_REL = 1e-12
"""Part of the area of a node that may be missing from what counts as all of it."""

SMALLEST_SHARE = 1e-12
"""Of a cell: less is rounding along a side of it."""

FloatArray = NDArray[np.float64]


Trees = namedtuple("Trees", "corners first_cell first_node leaves areas")
"""Cells of all faces: `first_cell` and `first_node` of each face, (F + 1,); and the trees.

`corners` are the faces in their planes, (F, 3, 2); `leaves` those below each node, `areas` m^2
of each cell.
"""


CellScratch = namedtuple("CellScratch", "triangles nodes cells polygons spare covered")
"""Memory of one thread: a stack of triangles, nodes, cells and polygons; area by cell."""


def cell_scratch(n_cells: int) -> CellScratch:
    """Scratch memory for a number of cells."""
    return CellScratch(
        np.empty((DEEPEST + 2, 3, 2)),
        np.empty(DEEPEST + 2, np.int64),
        np.empty(DEEPEST + 2, np.int64),
        Pieces(np.empty((DEEPEST + 2, PIECE_ROOM, 2)), np.empty(DEEPEST + 2, np.int64)),
        np.empty((PIECE_ROOM, 2)),
        np.zeros(n_cells),
    )


@part_with_arrays
def squared(triangle, p, q):
    """Squared length of a side."""
    x, y = triangle[q, U] - triangle[p, U], triangle[q, V] - triangle[p, V]
    return x * x + y * y


@part_with_arrays
def longest_side(triangle):
    """Corner at the start of the longest side, the first of equals; and its squared length."""
    first, second, third = squared(triangle, 0, 1), squared(triangle, 1, 2), squared(triangle, 2, 0)
    if first >= second and first >= third:
        return 0, first
    if second >= third:
        return 1, second
    return 2, third


@part_with_arrays
def set_halves(triangles, at, start):
    """Replace the triangle at `at` by its second half and put the first above it."""
    i, j, k = start, (start + 1) % 3, (start + 2) % 3
    xi, yi = triangles[at, i, U], triangles[at, i, V]
    xj, yj = triangles[at, j, U], triangles[at, j, V]
    xk, yk = triangles[at, k, U], triangles[at, k, V]
    x, y = (xi + xj) / 2, (yi + yj) / 2
    for half in range(2):
        row = at + 1 - half
        triangles[row, 0, U], triangles[row, 0, V] = xk, yk
        if half == 0:
            triangles[row, 1, U], triangles[row, 1, V] = xi, yi
            triangles[row, 2, U], triangles[row, 2, V] = x, y
        else:
            triangles[row, 1, U], triangles[row, 1, V] = x, y
            triangles[row, 2, U], triangles[row, 2, V] = xj, yj


@allocation_free
def count_cells(corners, is_asked, size, most, triangles, counts):
    """Count the cells of each face; the number of all, or some number above `most`."""
    total = 0
    for f in range(corners.shape[0]):
        counts[f] = 0
        if not is_asked[f]:
            continue
        copy_polygon(corners[f], 3, triangles[0])
        top = 1
        while top > 0:
            start, length = longest_side(triangles[top - 1])
            if length > size * size and top <= DEEPEST:
                set_halves(triangles, top - 1, start)
                top += 1
                continue
            counts[f] += 1
            top -= 1
            if total + counts[f] > most:
                return total + counts[f]
        total += counts[f]
    return total


@allocation_free
def fill_cells(corners, is_asked, size, scratch, trees, parents, cells):
    """Fill the trees of all faces, and `cells` (C, 3, 2) with their corners.

    `parents` is scratch for the nodes of one face.
    """
    triangles, above = scratch.triangles, scratch.nodes
    for f in range(corners.shape[0]):
        if not is_asked[f]:
            continue
        first, cell, node, top = trees.first_node[f], trees.first_cell[f], 0, 1
        copy_polygon(corners[f], 3, triangles[0])
        above[0] = -1
        while top > 0:
            parents[node] = above[top - 1]
            trees.leaves[first + node] = 0
            start, length = longest_side(triangles[top - 1])
            if length > size * size and top <= DEEPEST:
                set_halves(triangles, top - 1, start)
                above[top - 1] = above[top] = node
                top += 1
            else:
                top -= 1
                trees.leaves[first + node] = 1
                copy_polygon(triangles[top], 3, cells[cell])
                trees.areas[cell] = twice_area(triangles[top], 3) / 2
                cell += 1
            node += 1
        for n in range(node - 1, 0, -1):
            trees.leaves[first + parents[n]] += trees.leaves[first + n]


@allocation_free
def add_to_cells(face, polygon, n, trees, scratch):
    """Add a piece of a face to the covered area of its cells."""
    triangles, nodes, cells = scratch.triangles, scratch.nodes, scratch.cells
    corners, n_corners = scratch.polygons.corners, scratch.polygons.n_corners
    copy_polygon(trees.corners[face], 3, triangles[0])
    copy_polygon(polygon, n, corners[0])
    n_corners[0], nodes[0], cells[0] = n, trees.first_node[face], trees.first_cell[face]
    top = 1
    while top > 0:
        at = top - 1
        node, cell, n = nodes[at], cells[at], n_corners[at]
        leaves = trees.leaves[node]
        area = twice_area(corners[at], n) / 2
        if leaves == 1:
            scratch.covered[cell] += max(area, 0.0)
            top -= 1
            continue
        if area >= (1 - WHOLE_REL) * twice_area(triangles[at], 3) / 2:
            for c in range(cell, cell + leaves):
                scratch.covered[c] += trees.areas[c]
            top -= 1
            continue
        start, _ = longest_side(triangles[at])
        set_halves(triangles, at, start)
        # The first half is on the right of the line from the opposite corner to the middle.
        k, m = triangles[at + 1, 0], triangles[at + 1, 2]
        dx, dy = m[U] - k[U], m[V] - k[V]
        first = trees.leaves[node + 1]
        copy_polygon(corners[at], n, scratch.spare)
        kept = keep_inside(scratch.spare, n, (k[U], k[V], -dx, -dy, 0.0), corners[at + 1])
        n_corners[at] = keep_inside(scratch.spare, n, (k[U], k[V], dx, dy, 0.0), corners[at])
        n_corners[at + 1] = kept
        nodes[at], cells[at] = node + 2 * first, cell + first
        nodes[at + 1], cells[at + 1] = node + 1, cell
        top += 1
        if kept < 3 or n_corners[at] < 3:
            # One of the two is left out: the other takes the lower place.
            if kept >= 3:
                copy_polygon(triangles[at + 1], 3, triangles[at])
                copy_polygon(corners[at + 1], kept, corners[at])
                n_corners[at], nodes[at], cells[at] = kept, node + 1, cell
            top -= 1
            if n_corners[at] < 3:
                top -= 1


@allocation_free
def find_shares(xy, starts, face, first, last, trees, scratch, out_cell, out_share, used):
    """Shares of the pieces first ... last - 1, ordered by face; the number of cells with one.

    Where it is more than `out_cell` has room for from `used` on, call again with that much.
    """
    at, count = first, used
    while at < last:
        f = face[at]
        while at < last and face[at] == f:
            add_to_cells(f, xy[starts[at] :], starts[at + 1] - starts[at], trees, scratch)
            at += 1
        for c in range(trees.first_cell[f], trees.first_cell[f + 1]):
            covered = scratch.covered[c]
            if covered > SMALLEST_SHARE * trees.areas[c]:
                if count < out_cell.shape[0]:
                    out_cell[count] = c
                    out_share[count] = min(covered / trees.areas[c], 1.0)
                count += 1
            scratch.covered[c] = 0.0
    return count
