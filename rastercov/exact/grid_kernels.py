"""Regular grid over the image that lists the faces by cells, compiled by numba."""

import numpy as np

from rastercov._jit import allocation_free, inlined
from rastercov.exact.records import LIVE, THIN, U_MAX, U_MIN, V_MAX, V_MIN, W_MAX


@inlined
def cell(position, origin, per_pixel, n):
    """Row or column of the grid at a position; positions outside go to the first or the last."""
    return min(max(np.int64((position - origin) * per_pixel), 0), n - 1)


@inlined
def cells_of_box(box, f, grid):
    """First and last column, first and last row that the box of a face touches."""
    return (
        cell(box[f, U_MIN], grid.left, grid.per_u, grid.columns),
        cell(box[f, U_MAX], grid.left, grid.per_u, grid.columns),
        cell(box[f, V_MIN], grid.top, grid.per_v, grid.rows),
        cell(box[f, V_MAX], grid.top, grid.per_v, grid.rows),
    )


@allocation_free
def fill_grid(state, box, grid):
    """List the live and thin faces by the cells their boxes touch; returns the number of entries.

    `state` and `box` are those of `Projected`. Out: `starts`, `entries` and `is_sorted` of the
    grid; where `entries` has too little room, none is listed: call again with more.
    """
    columns, starts, entries = grid.columns, grid.starts, grid.entries
    n_cells = columns * grid.rows
    grid.is_sorted[:n_cells] = False
    for c in range(n_cells + 2):
        starts[c] = 0
    for f in range(state.shape[0]):
        if state[f] & (LIVE | THIN):
            left, right, top, bottom = cells_of_box(box, f, grid)
            for row in range(top, bottom + 1):
                for column in range(left, right + 1):
                    starts[row * columns + column + 2] += 1
    for c in range(2, n_cells + 2):
        starts[c] += starts[c - 1]
    total = starts[n_cells + 1]
    if total > entries.shape[0]:
        return total
    for f in range(state.shape[0]):
        if state[f] & (LIVE | THIN):
            left, right, top, bottom = cells_of_box(box, f, grid)
            for row in range(top, bottom + 1):
                for column in range(left, right + 1):
                    at = row * columns + column + 1
                    entries[starts[at]] = f
                    starts[at] += 1
    return total


@allocation_free
def sort_cell(at, box, grid):
    """Sort the faces listed in a cell from front to back by their nearest depth, the first time.

    D. Shell. A High-Speed Sorting Procedure. 1959.
    """
    grid.is_sorted[at] = True
    entries, nearest, first = grid.entries, grid.nearest, grid.starts[at]
    n = grid.starts[at + 1] - first
    for i in range(first, first + n):
        nearest[i] = box[entries[i], W_MAX]
    gap = np.int64(1)
    while 3 * gap + 1 < n:
        gap = 3 * gap + 1
    while gap > 0:
        for i in range(first + gap, first + n):
            w, f, j = nearest[i], entries[i], i
            while j >= first + gap and nearest[j - gap] < w:
                nearest[j], entries[j] = nearest[j - gap], entries[j - gap]
                j -= gap
            nearest[j], entries[j] = w, f
        gap //= 3
