"""Grid of cells over the image, in which `kernels.exact_grid` lists the faces near a place."""

import math

import numpy as np
from numpy.typing import NDArray

from rastercov.kernels.exact_grid import BUCKETS, NOT_ASKED
from rastercov.kernels.exact_records import SPARE_ENTRIES, CellGrid

MOST_CELLS = 1 << 14
"""Columns, or rows, of the grid."""
LEAST_EXTENT = 1e-100
"""Pixels; width and height that the grid covers at least."""
CELLS_PER_FACE = 1
"""Cells of the grid for each face, unless that makes more entries than `ENTRIES_PER_FACE`."""
ENTRIES_PER_FACE = 3


def first_grid(n_faces: int) -> CellGrid:
    """Grid for a mesh, of no cells yet."""
    return CellGrid(
        left=0.0,
        top=0.0,
        per_u=1.0,
        per_v=1.0,
        columns=1,
        rows=1,
        asked=np.empty(0, np.uint8),
        is_near=np.empty(0, np.bool_),
        fresh_bits=np.empty((0, 0), np.uint64),
        fresh=np.empty(0, np.int32),
        n_fresh=np.zeros(1, np.int64),
        starts=np.empty(0, np.int64),
        stops=np.empty(0, np.int64),
        entries=np.empty(2 * n_faces, np.int32),
        n_entries=np.zeros(1, np.int64),
        nearest=np.empty(2 * n_faces),
        is_sorted=np.empty(0, np.bool_),
        bounds=np.empty((6, 2 * n_faces + SPARE_ENTRIES)),
        has_bounds=np.empty(0, np.bool_),
        hider=np.empty(0, np.int32),
        buckets=np.empty(BUCKETS + 1, np.int64),
        faces=np.empty(n_faces, np.int32),
        n_faces=np.zeros(1, np.int64),
        found=np.empty(n_faces, np.int32),
        pairs=np.empty((2 * n_faces + SPARE_ENTRIES, 2), np.int32),
        is_whole=np.zeros(n_faces, np.bool_),
    )


def grid_over(grid: CellGrid, n_live: int, extent: NDArray[np.float64]) -> CellGrid:
    """Lay the grid over the live faces, of as many cells as the entries of large ones allow.

    No cell of it is asked for, and no face listed.

    Parameters
    ----------
    grid : CellGrid
        The grid of the last pose; its memory is used again.
    n_live : int
        Faces with an image.
    extent : (7,) float64
        Left, right, top and bottom of their boxes, px, and sums of the widths, heights and areas of
        these; not looked at without faces.
    """
    limits = extent.tolist() if n_live else (0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    left, right, top, bottom, widths, heights, areas = limits
    wide, high = max(right - left, LEAST_EXTENT), max(bottom - top, LEAST_EXTENT)
    cells = CELLS_PER_FACE * n_live + 1.0
    while True:
        columns = int(min(max(1.0, math.sqrt(cells * (wide / high))), MOST_CELLS))
        rows = int(min(max(1.0, cells / columns), MOST_CELLS))
        per_u, per_v = columns / wide, rows / high
        # A box w wide and h high touches (1 + w per_u)(1 + h per_v) cells, on average.
        entries = n_live + widths * per_u + heights * per_v + areas * per_u * per_v
        if entries <= ENTRIES_PER_FACE * n_live or columns * rows == 1:
            break
        cells /= 2
    grid = grid._replace(
        left=left,
        top=top,
        per_u=per_u,
        per_v=per_v,
        columns=columns,
        rows=rows,
        fresh_bits=np.zeros((rows, (columns + 63) // 64), np.uint64),
    )
    n_cells = columns * rows
    if len(grid.is_sorted) < n_cells:
        grid = grid._replace(
            starts=np.empty(n_cells, np.int64),
            stops=np.empty(n_cells, np.int64),
            is_sorted=np.empty(n_cells, np.bool_),
            has_bounds=np.empty(n_cells, np.bool_),
            hider=np.empty(n_cells, np.int32),
            asked=np.empty(n_cells, np.uint8),
            is_near=np.empty(n_cells, np.bool_),
            fresh=np.empty(n_cells, np.int32),
        )
    grid.asked[:n_cells], grid.is_near[:n_cells] = NOT_ASKED, False
    grid.n_fresh[0] = grid.n_entries[0] = 0
    return grid


def with_room(grid: CellGrid, room: int) -> CellGrid:
    """Return the grid with the entries it has, and room for a number of them."""
    n = int(grid.n_entries[0])
    entries, nearest = np.empty(room, np.int32), np.empty(room)
    bounds = np.empty((6, room + SPARE_ENTRIES))
    entries[:n], nearest[:n], bounds[:, :n] = (
        grid.entries[:n], grid.nearest[:n], grid.bounds[:, :n],
    )  # fmt: skip
    pairs = np.empty((room + SPARE_ENTRIES, 2), np.int32)
    return grid._replace(entries=entries, nearest=nearest, bounds=bounds, pairs=pairs)
