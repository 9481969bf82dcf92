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
def sort_by_depth(state, box, order, buckets):
    """List the live and thin faces from front to back by their nearest depth 1/w.

    Parameters
    ----------
    state, box
        Of `Projected`.
    order : (F,) int32
        Out: the faces, in the order of the buckets of depth that they fall in.
    buckets : (B,) int64
        Scratch: B - 2 buckets of equal depth.

    Returns
    -------
    n : int
        Number of faces listed.
    depth : float
        Depth of a bucket: no face is listed before one that is farther by more than this.
    """
    n = 0
    nearest, farthest = np.inf, 0.0
    for f in range(state.shape[0]):
        if state[f] & (LIVE | THIN):
            z = 1 / box[f, W_MAX]
            nearest, farthest = min(nearest, z), max(farthest, z)
            n += 1
    if n == 0:
        return 0, 0.0
    n_buckets = buckets.shape[0] - 2
    depth = (farthest - nearest) / n_buckets
    per_depth = 1 / depth if depth > 0 and np.isfinite(1 / depth) else 0.0
    buckets[:] = 0
    for f in range(state.shape[0]):
        if state[f] & (LIVE | THIN):
            at = min(np.int64((1 / box[f, W_MAX] - nearest) * per_depth), n_buckets - 1)
            buckets[at + 2] += 1
    for at in range(2, n_buckets + 2):
        buckets[at] += buckets[at - 1]
    for f in range(state.shape[0]):
        if state[f] & (LIVE | THIN):
            at = min(np.int64((1 / box[f, W_MAX] - nearest) * per_depth), n_buckets - 1)
            order[buckets[at + 1]] = f
            buckets[at + 1] += 1
    return n, depth if per_depth > 0 else farthest - nearest


@allocation_free
def fill_grid(box, order, n, grid):
    """List faces by the cells their boxes touch; returns the number of entries.

    Where that is more than `grid.entries` has room for, none is listed: call again with more room.

    Parameters
    ----------
    box : (F, 6) float64
        Of `Projected`.
    order, n : (F,) int32, int
        Of `sort_by_depth`: faces to list, and their number.
    grid : CellGrid
        Out: `starts` and `entries`.
    """
    columns, starts, entries = grid.columns, grid.starts, grid.entries
    n_cells = columns * grid.rows
    for c in range(n_cells + 2):
        starts[c] = 0
    for index in range(n):
        left, right, top, bottom = cells_of_box(box, order[index], grid)
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                starts[row * columns + column + 2] += 1
    for c in range(2, n_cells + 2):
        starts[c] += starts[c - 1]
    total = starts[n_cells + 1]
    if total > entries.shape[0]:
        return total
    for index in range(n):
        f = order[index]
        left, right, top, bottom = cells_of_box(box, f, grid)
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                at = row * columns + column + 1
                entries[starts[at]] = f
                starts[at] += 1
    return total
