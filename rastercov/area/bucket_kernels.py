"""Pieces of a face listed by the cells of a grid that their boxes touch; compiled by numba.

A new piece is compared with the pieces near it instead of all: a floor under clutter has ten
thousand. A list names older pieces first, because large ones are added first and hide most.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov._jit import allocation_free, part_with_arrays
from rastercov.exact.records import U_MAX, U_MIN, V_MAX, V_MIN

SIDE = 32
"""Columns, and rows, of the grid over the triangle of a face."""
FEWEST = 64
"""Pieces up to which there is no grid."""
ENTRIES_A_PIECE = 8
"""Room for entries, relative to that for pieces."""


class Buckets(NamedTuple):
    """Lists of the pieces in each cell, and scratch for a search.

    `first`, `last` are entries of each cell, `following` the next entry of each, -1 for none, and
    `piece` its piece. `seen` is the last search that met a piece, `near` the result of one. `used`
    is the number of entries and of searches; `per` the cells a metre along x and y, 0 without grid.
    """

    first: NDArray[np.int64]
    last: NDArray[np.int64]
    following: NDArray[np.int64]
    piece: NDArray[np.int64]
    seen: NDArray[np.int64]
    near: NDArray[np.int64]
    used: NDArray[np.int64]
    per: NDArray[np.float64]


def room_for_buckets(n: int) -> Buckets:
    """Memory for n pieces."""
    return Buckets(
        first=np.empty(SIDE * SIDE, np.int64),
        last=np.empty(SIDE * SIDE, np.int64),
        following=np.empty(ENTRIES_A_PIECE * n + SIDE * SIDE, np.int64),
        piece=np.empty(ENTRIES_A_PIECE * n + SIDE * SIDE, np.int64),
        seen=np.zeros(n, np.int64),
        near=np.empty(n, np.int64),
        used=np.zeros(2, np.int64),
        per=np.zeros(2),
    )


@part_with_arrays
def cell_of(x, per):
    """Column or row of a coordinate."""
    return min(max(np.int64(x * per), 0), SIDE - 1)


@allocation_free
def lay_grid(corners, n, buckets):
    """Empty the lists for a face that gets about n pieces, with a grid if these are many."""
    buckets.per[0] = buckets.per[1] = 0.0
    if n > FEWEST:
        buckets.per[0], buckets.per[1] = SIDE / corners[1, 0], SIDE / corners[2, 1]
        buckets.first[:] = -1
        buckets.used[0] = 0


@allocation_free
def list_piece(q, box, buckets):
    """List a piece in the cells that its box touches; False where there is no room."""
    per_x, per_y = buckets.per[0], buckets.per[1]
    if per_x == 0:
        return True
    first, last, following = buckets.first, buckets.last, buckets.following
    for row in range(cell_of(box[q, V_MIN], per_y), cell_of(box[q, V_MAX], per_y) + 1):
        for column in range(cell_of(box[q, U_MIN], per_x), cell_of(box[q, U_MAX], per_x) + 1):
            cell, entry = row * SIDE + column, buckets.used[0]
            if entry == following.shape[0]:
                return False
            buckets.piece[entry], following[entry] = q, -1
            if first[cell] < 0:
                first[cell] = entry
            else:
                following[last[cell]] = entry
            last[cell] = entry
            buckets.used[0] = entry + 1
    return True


@part_with_arrays
def reaches(box, q, wanted):
    """True if a piece reaches into a box."""
    return (
        box[q, U_MIN] < wanted[U_MAX]
        and box[q, U_MAX] > wanted[U_MIN]
        and box[q, V_MIN] < wanted[V_MAX]
        and box[q, V_MAX] > wanted[V_MIN]
    )


@allocation_free
def find_near(wanted, count, box, n_corners, buckets):
    """Fill `near` with the pieces, of `count`, that reach into a box; their number.

    `wanted` is (least u, greatest u, least v, greatest v); pieces without corners are left out.
    """
    near, seen, n = buckets.near, buckets.seen, 0
    per_x, per_y = buckets.per[0], buckets.per[1]
    if per_x == 0:
        for q in range(count):
            if n_corners[q] > 0 and reaches(box, q, wanted):
                near[n] = q
                n += 1
        return n
    buckets.used[1] += 1
    search = buckets.used[1]
    for row in range(cell_of(wanted[V_MIN], per_y), cell_of(wanted[V_MAX], per_y) + 1):
        for column in range(cell_of(wanted[U_MIN], per_x), cell_of(wanted[U_MAX], per_x) + 1):
            entry = buckets.first[row * SIDE + column]
            while entry >= 0:
                q = buckets.piece[entry]
                if seen[q] != search:
                    seen[q] = search
                    if n_corners[q] > 0 and reaches(box, q, wanted):
                        near[n] = q
                        n += 1
                entry = buckets.following[entry]
    return n
