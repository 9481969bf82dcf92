"""Regular grid over the image that lists the faces by cells, compiled by numba."""

import numpy as np

from rastercov.kernels.exact_records import (
    BLOCK,
    LIVE,
    THIN,
    U_MAX,
    U_MIN,
    V_MAX,
    V_MIN,
    W_MAX,
    W_MIN,
)
from rastercov.kernels.exact_setup import (
    AT_A_TIME,
    entries_that_touch,
    faces_near,
    lay_box,
    lay_boxes_of_block,
)
from rastercov.kernels.jit import allocation_free, part_with_arrays
from rastercov.kernels.simd_kernel import lowest_bit, pointer

NOT_ASKED, ASKED, LISTED = range(3)
"""States of a cell."""
ENTRIES_AT_A_TIME = 64
"""Entries of a cell that are compared at a time."""
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
def bits_of_word(word, first, last):
    """Bits of 64-bit word `word` of a row that are those of columns first ... last."""
    bits = ~np.uint64(0)
    if word == first >> 6:
        bits &= ~np.uint64(0) << np.uint64(first & 63)
    if word == last >> 6:
        bits &= ~np.uint64(0) >> np.uint64(63 - (last & 63))
    return bits


@part_with_arrays
def mark_near(row, column, is_near, grid):
    """Mark a cell and those before it in its row, and the row above, in `grid.is_near`."""
    for i in range(max(row - 1, 0), row + 1):
        for j in range(max(column - 1, 0), column + 1):
            grid.is_near[i * grid.columns + j] = is_near


@part_with_arrays
def ask_for_cells(left, right, top, bottom, grid):
    """Ask for the cells of a rectangle."""
    fresh, n = grid.fresh, grid.n_fresh[0]
    for row in range(top, bottom + 1):
        for column in range(left, right + 1):
            at = row * grid.columns + column
            if grid.asked[at] == NOT_ASKED:
                grid.asked[at] = ASKED
                grid.fresh_bits[row, column >> 6] |= np.uint64(1) << np.uint64(column & 63)
                mark_near(row, column, True, grid)
                fresh[n] = at
                n += 1
    grid.n_fresh[0] = n


@allocation_free
def ask_for_all(grid):
    """Ask for all cells."""
    ask_for_cells(0, grid.columns - 1, 0, grid.rows - 1, grid)


@allocation_free
def ask_for_faces(faces, box, grid):
    """Ask for the cells that the boxes of some faces touch; True if one had not been asked for."""
    for index in range(faces.shape[0]):
        left, right, top, bottom = cells_of_box(box, faces[index], grid)
        ask_for_cells(left, right, top, bottom, grid)
    return grid.n_fresh[0] > 0


@part_with_arrays
def has_fresh(left, right, top, bottom, grid):
    """True if a cell of a rectangle is asked for and not listed."""
    for row in range(top, bottom + 1):
        for word in range(left >> 6, (right >> 6) + 1):
            if grid.fresh_bits[row, word] & bits_of_word(word, left, right):
                return True
    return False


@part_with_arrays
def list_pair(n, row, column, is_touched, f, grid):
    """Add a face and a cell to the first n of `grid.pairs` if it is asked for; their number then.

    Without a branch: which cells are asked for is not predictable.
    """
    at = row * grid.columns + column
    grid.pairs[n, 0], grid.pairs[n, 1] = at, f
    return n + (is_touched & (grid.asked[at] == ASKED))


@part_with_arrays
def list_pairs(n, f, box, grid):
    """Add a face and its cells that are asked for to the first n of `grid.pairs`; their number.

    If there is too little room, that is more than there is room for.
    """
    left, right, top, bottom = cells_of_box(box, f, grid)
    n_touched, room = (right - left + 1) * (bottom - top + 1), grid.pairs.shape[0]
    if n + max(n_touched, 4) > room:
        return room + n_touched
    before = n
    if right - left <= 1 and bottom - top <= 1:
        n = list_pair(n, top, left, True, f, grid)
        n = list_pair(n, top, right, right > left, f, grid)
        n = list_pair(n, bottom, left, bottom > top, f, grid)
        n = list_pair(n, bottom, right, (right > left) & (bottom > top), f, grid)
    else:
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                n = list_pair(n, row, column, True, f, grid)
    grid.is_whole[f] = n - before == n_touched
    return n


@allocation_free
def fill_grid(projected, grid):
    """List the live and thin faces by the cells asked for; returns the number of entries.

    Cells that are listed already keep their entries, and those of the others follow. Out: `asked`,
    `starts`, `stops`, `entries`, `is_sorted`, `has_bounds` and `hider` of these cells; `faces`,
    `n_faces` and `is_whole`; `n_entries`. Where `entries` has too little room, none is listed, and
    the result is more than that: call again with more. The faces that are listed have boxes.
    """
    state, box, block_box = projected.state, projected.box, projected.block_box
    faces, uvw, boxes = pointer(projected.faces), pointer(projected.uvw), pointer(box)
    is_near, n_faces = pointer(grid.is_near), state.shape[0]
    starts, stops, pairs, room = grid.starts, grid.stops, grid.pairs, grid.entries.shape[0]
    fresh = grid.fresh[: grid.n_fresh[0]]
    is_all = fresh.shape[0] == grid.columns * grid.rows
    for index in range(grid.n_faces[0]):
        grid.is_whole[grid.faces[index]] = False
    n_pairs = n_listed = 0
    for b in range(block_box.shape[0]):
        if not block_box[b, U_MIN] <= block_box[b, U_MAX]:
            continue
        if is_all:
            lay_boxes_of_block(b, projected)
        else:
            left, right, top, bottom = cells_of_box(block_box, b, grid)
            if not has_fresh(left, right, top, bottom, grid):
                continue
        has_boxes = projected.has_boxes[b]
        for first in range(b * BLOCK, min((b + 1) * BLOCK, n_faces), AT_A_TIME):
            # A block without boxes is full.
            near = (1 << min(AT_A_TIME, n_faces - first)) - 1
            if not has_boxes:
                near = faces_near(
                    first, faces, uvw, grid.left, grid.top, grid.per_u, grid.per_v, grid.columns,
                    grid.rows, is_near,
                )  # fmt: skip
            while near:
                f = first + lowest_bit(near)
                near &= near - 1
                if not state[f] & (LIVE | THIN):
                    continue
                if not has_boxes:
                    lay_box(f, faces, uvw, boxes)
                before = n_pairs
                n_pairs = list_pairs(n_pairs, f, box, grid)
                grid.faces[n_listed] = f
                n_listed += n_pairs > before
                if n_pairs > pairs.shape[0]:
                    grid.n_faces[0] = n_listed
                    return 2 * room
    grid.n_faces[0], total = n_listed, grid.n_entries[0] + n_pairs
    if total > room:
        return total
    for k in range(fresh.shape[0]):
        c = fresh[k]
        grid.is_sorted[c] = grid.has_bounds[c] = False
        grid.hider[c], stops[c] = -1, 0
    for k in range(n_pairs):
        stops[pairs[k, 0]] += 1
    at = grid.n_entries[0]
    for k in range(fresh.shape[0]):
        c = fresh[k]
        starts[c] = at
        at += stops[c]
        stops[c] = starts[c]
        grid.asked[c] = LISTED
        row, column = c // grid.columns, c % grid.columns
        grid.fresh_bits[row, column >> 6] = 0
        mark_near(row, column, False, grid)
    for k in range(n_pairs):
        c = pairs[k, 0]
        grid.entries[stops[c]] = pairs[k, 1]
        stops[c] += 1
    grid.n_fresh[0], grid.n_entries[0] = 0, total
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
    bits = entries_that_touch(
        pointer(grid.bounds), grid.bounds.shape[1], first, last - first, left, right, top, bottom,
        least_near, least_far, most_far,
    )  # fmt: skip
    if last - first < ENTRIES_AT_A_TIME:
        bits &= (np.int64(1) << (last - first)) - 1
    while bits:
        grid.found[n] = grid.entries[first + lowest_bit(bits)]
        bits &= bits - 1
        n += 1
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
