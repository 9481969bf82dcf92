"""Regular grid over the image that lists the faces by cells, compiled by numba."""

import numpy as np

from rastercov._jit import allocation_free, inlined
from rastercov.exact.records import BLOCK, LIVE, THIN, U_MAX, U_MIN, V_MAX, V_MIN, W_MAX

TILE = 8
"""Side of the tiles of cells by which blocks of faces are left out."""


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
def ask_for_faces(faces, box, grid):
    """Ask for the cells that the boxes of some faces touch; True if one had not been asked for."""
    is_new = False
    for index in range(faces.shape[0]):
        left, right, top, bottom = cells_of_box(box, faces[index], grid)
        for row in range(top, bottom + 1):
            for at in range(row * grid.columns + left, row * grid.columns + right + 1):
                is_new = is_new or not grid.is_asked[at]
                grid.is_asked[at] = True
    return is_new


@inlined
def mark_tiles(grid):
    """Mark the tiles of TILE x TILE cells of which one is asked for; returns columns of tiles."""
    across = (grid.columns - 1) // TILE + 1
    grid.is_tile_asked[: across * ((grid.rows - 1) // TILE + 1)] = False
    for row in range(grid.rows):
        for column in range(grid.columns):
            if grid.is_asked[row * grid.columns + column]:
                grid.is_tile_asked[row // TILE * across + column // TILE] = True
    return across


@inlined
def may_be_asked(box, f, across, grid):
    """True if a cell asked for is in a tile that a box touches."""
    left, right, top, bottom = cells_of_box(box, f, grid)
    for row in range(top // TILE, bottom // TILE + 1):
        for at in range(row * across + left // TILE, row * across + right // TILE + 1):
            if grid.is_tile_asked[at]:
                return True
    return False


@allocation_free
def fill_grid(projected, grid):
    """List the live and thin faces by the cells asked for; returns the number of entries.

    Out: `starts`, `entries`, `is_sorted`, `faces` and `is_whole` of the grid; where `entries` has
    too little room, none is listed: call again with more.
    """
    state, box, block_box = projected.state, projected.box, projected.block_box
    columns, starts, entries, is_asked = grid.columns, grid.starts, grid.entries, grid.is_asked
    n_cells = columns * grid.rows
    grid.is_sorted[:n_cells] = False
    grid.is_whole[:] = False
    for c in range(n_cells + 2):
        starts[c] = 0
    n, across = 0, mark_tiles(grid)
    for b in range(block_box.shape[0]):
        if not (
            block_box[b, U_MIN] <= block_box[b, U_MAX] and may_be_asked(block_box, b, across, grid)
        ):
            continue
        for f in range(b * BLOCK, min((b + 1) * BLOCK, state.shape[0])):
            if not state[f] & (LIVE | THIN):
                continue
            left, right, top, bottom = cells_of_box(box, f, grid)
            is_listed, is_whole = False, True
            for row in range(top, bottom + 1):
                for at in range(row * columns + left, row * columns + right + 1):
                    if is_asked[at]:
                        is_listed = True
                        starts[at + 2] += 1
                    else:
                        is_whole = False
            grid.is_whole[f] = is_whole
            if is_listed:
                grid.faces[n] = f
                n += 1
    for c in range(2, n_cells + 2):
        starts[c] += starts[c - 1]
    total = starts[n_cells + 1]
    if total > entries.shape[0]:
        return total
    for index in range(n):
        f = grid.faces[index]
        left, right, top, bottom = cells_of_box(box, f, grid)
        for row in range(top, bottom + 1):
            for at in range(row * columns + left, row * columns + right + 1):
                if is_asked[at]:
                    entries[starts[at + 1]] = f
                    starts[at + 1] += 1
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
