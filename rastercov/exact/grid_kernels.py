"""Regular grid over the image that lists the faces by cells, compiled by numba."""

import numpy as np

from rastercov._jit import allocation_free, part_with_arrays
from rastercov.exact.block_kernels import (
    lay_boxes_of_block,
    lay_boxes_of_some,
    rectangle_of_some,
)
from rastercov.exact.records import BLOCK, LIVE, THIN, U_MAX, U_MIN, V_MAX, V_MIN, W_MAX, W_MIN

NOT_ASKED, ASKED, LISTED = range(3)
"""States of a cell."""
ENTRIES_AT_A_TIME = 64
"""Entries of a cell that are compared at a time."""
GROUP = 8
"""Faces of a block, one after another, that are looked at together."""
BUCKETS = 64
"""Ranges of 1/z by which the faces of a cell are sorted first."""


@part_with_arrays
def cell(position, origin, per_pixel, n):
    """Row or column of the grid at a position; positions outside go to the first or the last."""
    return min(max(np.int64((position - origin) * per_pixel), 0), n - 1)


@part_with_arrays
def cell_at(u, v, grid):
    """Cell of the grid at a point."""
    row = cell(v, grid.top, grid.per_v, grid.rows)
    return row * grid.columns + cell(u, grid.left, grid.per_u, grid.columns)


@part_with_arrays
def cells_of_rectangle(u_min, u_max, v_min, v_max, grid):
    """First and last column, first and last row that a rectangle touches."""
    return (
        cell(u_min, grid.left, grid.per_u, grid.columns),
        cell(u_max, grid.left, grid.per_u, grid.columns),
        cell(v_min, grid.top, grid.per_v, grid.rows),
        cell(v_max, grid.top, grid.per_v, grid.rows),
    )


@part_with_arrays
def cells_of_box(box, f, grid):
    """First and last column, first and last row that the box of a face touches."""
    return cells_of_rectangle(box[f, U_MIN], box[f, U_MAX], box[f, V_MIN], box[f, V_MAX], grid)


@part_with_arrays
def likely_hider(f, box, grid):
    """Face that hid another one at the centre of the box of a face, -1 for none."""
    u, v = (box[f, U_MIN] + box[f, U_MAX]) / 2, (box[f, V_MIN] + box[f, V_MAX]) / 2
    return np.int64(grid.hider[cell_at(u, v, grid)])


@part_with_arrays
def ask_for_cells(left, right, top, bottom, grid):
    """Ask for the cells of a rectangle; True if one had not been asked for."""
    is_new = False
    for row in range(top, bottom + 1):
        for at in range(row * grid.columns + left, row * grid.columns + right + 1):
            if grid.asked[at] == NOT_ASKED:
                grid.asked[at] = ASKED
                is_new = True
    return is_new


@allocation_free
def ask_for_faces(faces, box, grid):
    """Ask for the cells that the boxes of some faces touch; True if one had not been asked for."""
    is_new = False
    for index in range(faces.shape[0]):
        left, right, top, bottom = cells_of_box(box, faces[index], grid)
        is_new |= ask_for_cells(left, right, top, bottom, grid)
    return is_new


@part_with_arrays
def count_asked(grid):
    """Number of the cells asked for, and in each rectangle of cells that starts at the first one.

    The table is left as it is if all are asked for.

    F. C. Crow. Summed-Area Tables for Texture Mapping. 1984.
    """
    sums, across, n_all = grid.n_asked, grid.columns + 1, 0
    for c in range(grid.columns * grid.rows):
        n_all += grid.asked[c] == ASKED
    if n_all == grid.columns * grid.rows:
        return n_all
    sums[:across] = 0
    for row in range(grid.rows):
        n, at = 0, (row + 1) * across
        sums[at] = 0
        for column in range(grid.columns):
            n += grid.asked[row * grid.columns + column] == ASKED
            sums[at + column + 1] = sums[at + column + 1 - across] + n
    return n_all


@part_with_arrays
def n_asked_in(left, right, top, bottom, grid):
    """Number of the cells in a rectangle that are asked for, after `count_asked`."""
    sums, across = grid.n_asked, grid.columns + 1
    above, below = top * across, (bottom + 1) * across
    return (
        sums[below + right + 1] - sums[below + left] - sums[above + right + 1] + sums[above + left]
    )


@allocation_free
def fill_grid(projected, grid):
    """List the live and thin faces by the cells asked for; returns the number of entries.

    Cells that are listed already keep their entries, and those of the others follow. Out: `asked`,
    `starts`, `stops`, `entries`, `is_sorted`, `has_bounds` and `hider` of these cells; `faces`,
    `n_faces` and `is_whole`; `n_entries`. Where `entries` has too little room, none is listed: call
    again with more. The faces that are listed have boxes.
    """
    state, box, block_box = projected.state, projected.box, projected.block_box
    n_faces, places, asked = projected.blocks.patch.shape[0], grid.places, grid.asked
    columns, starts, stops, entries = grid.columns, grid.starts, grid.stops, grid.entries
    n_cells, n = columns * grid.rows, 0
    for c in range(n_cells):
        if asked[c] == ASKED:
            grid.is_sorted[c] = grid.has_bounds[c] = False
            grid.hider[c], stops[c] = -1, 0
    grid.is_whole[:] = False
    is_all = count_asked(grid) == n_cells
    for b in range(block_box.shape[0]):
        if not block_box[b, U_MIN] <= block_box[b, U_MAX]:
            continue
        if not is_all:
            left, right, top, bottom = cells_of_box(block_box, b, grid)
            if n_asked_in(left, right, top, bottom, grid) == 0:
                continue
        if is_all:
            lay_boxes_of_block(b, projected)
        for first in range(b * BLOCK, min((b + 1) * BLOCK, n_faces), GROUP):
            stop = min(first + GROUP, n_faces)
            if not projected.has_boxes[b]:
                u_min, u_max, v_min, v_max = rectangle_of_some(first, stop, projected)
                left, right, top, bottom = cells_of_rectangle(u_min, u_max, v_min, v_max, grid)
                if n_asked_in(left, right, top, bottom, grid) == 0:
                    continue
                lay_boxes_of_some(first, stop, projected)
            for f in range(first, stop):
                if not state[f] & (LIVE | THIN):
                    continue
                left, right, top, bottom = cells_of_box(box, f, grid)
                n_found = n_touched = (right - left + 1) * (bottom - top + 1)
                if not is_all:
                    n_found = n_asked_in(left, right, top, bottom, grid)
                    if n_found == 0:
                        continue
                grid.is_whole[f] = n_found == n_touched
                grid.faces[n] = f
                places[n, 0], places[n, 1], places[n, 2], places[n, 3] = left, right, top, bottom
                n += 1
                for row in range(top, bottom + 1):
                    for at in range(row * columns + left, row * columns + right + 1):
                        if n_found == n_touched or asked[at] == ASKED:
                            stops[at] += 1
    grid.n_faces[0], total = n, grid.n_entries[0]
    for c in range(n_cells):
        if asked[c] == ASKED:
            starts[c] = total
            total += stops[c]
            stops[c] = starts[c]
    if total > entries.shape[0]:
        return total
    for index in range(n):
        f, left, right = grid.faces[index], places[index, 0], places[index, 1]
        is_whole = grid.is_whole[f]
        for row in range(places[index, 2], places[index, 3] + 1):
            for at in range(row * columns + left, row * columns + right + 1):
                if is_whole or asked[at] == ASKED:
                    entries[stops[at]] = f
                    stops[at] += 1
    for c in range(n_cells):
        if asked[c] == ASKED:
            asked[c] = LISTED
    grid.n_entries[0] = total
    return total


@part_with_arrays
def lay_bounds(at, box, grid):
    """Lay the bounds of the faces of a cell one after another in memory, the first time."""
    bounds, entries = grid.bounds, grid.entries
    if not grid.has_bounds[at]:
        grid.has_bounds[at] = True
        for entry in range(grid.starts[at], grid.stops[at]):
            f = entries[entry]
            bounds[U_MIN, entry], bounds[U_MAX, entry] = box[f, U_MIN], box[f, U_MAX]
            bounds[V_MIN, entry], bounds[V_MAX, entry] = box[f, V_MIN], box[f, V_MAX]
            bounds[W_MIN, entry], bounds[W_MAX, entry] = box[f, W_MIN], box[f, W_MAX]


@part_with_arrays
def find_faces(first, last, rectangle, depths, grid, n):
    """Add the entries first ... last - 1 in a rectangle and a range of depths to `grid.found`.

    Parameters
    ----------
    rectangle : tuple
        Left, right, top, bottom: the box of the face touches it.
    depths : tuple
        Least W_MAX, least and greatest W_MIN of the face.
    n : int
        They follow the first n there.

    Returns how many there are then. `lay_bounds` comes before.
    """
    left, right, top, bottom = rectangle
    least_near, least_far, most_far = depths
    low_u, high_u = grid.bounds[U_MIN, first:last], grid.bounds[U_MAX, first:last]
    low_v, high_v = grid.bounds[V_MIN, first:last], grid.bounds[V_MAX, first:last]
    low_w, high_w = grid.bounds[W_MIN, first:last], grid.bounds[W_MAX, first:last]
    n_touching = 0
    for k in range(last - first):
        touches = (low_u[k] <= right) & (high_u[k] >= left) & (low_v[k] <= bottom)
        touches &= (high_v[k] >= top) & (high_w[k] >= least_near)
        touches &= (low_w[k] >= least_far) & (low_w[k] <= most_far)
        grid.touches[k] = touches
        n_touching += touches
    if n_touching == 0:
        return n
    for k in range(last - first):
        # Without a branch: which boxes touch is not predictable.
        grid.found[n] = grid.entries[first + k]
        n += grid.touches[k]
    return n


@allocation_free
def sort_cell(at, box, grid):
    """Sort the faces listed in a cell from front to back by their nearest depth, the first time.

    They are sorted into `BUCKETS` equal ranges of 1/z first, which leaves little to do.

    D. Shell. A High-Speed Sorting Procedure. 1959.
    """
    grid.is_sorted[at], grid.has_bounds[at] = True, False
    first, last = grid.starts[at], grid.stops[at]
    entries, nearest, n = grid.entries[first:last], grid.nearest[first:last], last - first
    key, found, ends = grid.bounds[0, first:last], grid.found, grid.buckets
    least, most = np.inf, -np.inf
    for i in range(n):
        w = box[entries[i], W_MAX]
        key[i], found[i] = w, entries[i]
        least, most = min(least, w), max(most, w)
    per_w = BUCKETS / (most - least) if most > least else 0.0
    ends[:] = 0
    for i in range(n):
        ends[cell(-key[i], -most, per_w, BUCKETS) + 1] += 1
    for bucket in range(1, BUCKETS + 1):
        ends[bucket] += ends[bucket - 1]
    for i in range(n):
        bucket = cell(-key[i], -most, per_w, BUCKETS)
        nearest[ends[bucket]], entries[ends[bucket]] = key[i], found[i]
        ends[bucket] += 1
    gap = np.int64(1)
    while 3 * gap + 1 < n:
        gap = 3 * gap + 1
    while gap > 0:
        for i in range(gap, n):
            w, f, j = nearest[i], entries[i], i
            while j >= gap and nearest[j - gap] < w:
                nearest[j], entries[j] = nearest[j - gap], entries[j - gap]
                j -= gap
            nearest[j], entries[j] = w, f
        gap //= 3
