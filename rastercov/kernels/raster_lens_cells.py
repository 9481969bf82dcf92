"""Grid of cells over an ideal plane, with the tiles of samples in each; compiled by numba.

See `lens_records.Patch.cells`.
"""

import numpy as np

from rastercov.kernels.jit import allocation_free, part_with_arrays
from rastercov.kernels.raster_lens_records import SAMPLES


@part_with_arrays
def cell_of(value, low, cells_a_unit, n):
    """Cell of the first level that holds a coordinate; that at the border for one beyond it."""
    return np.int64(min(max((value - low) * cells_a_unit, 0.0), n - 1.0))


@allocation_free
def fill_cells(x, y, columns, low, cells_a_unit, width, height, cells):
    """Fill the first level of `Patch.cells` from the places (T, 16) of samples."""
    cells[: width * height] = 1 << 30
    for tile in range(x.shape[0]):
        row, column = tile // columns, tile % columns
        for s in range(SAMPLES):
            if x[tile, s] == x[tile, s]:
                i = cell_of(x[tile, s], low[0], cells_a_unit, width)
                c = cell_of(y[tile, s], low[1], cells_a_unit, height) * width + i
                cells[c, 0], cells[c, 1] = min(cells[c, 0], column), min(cells[c, 1], -column)
                cells[c, 2], cells[c, 3] = min(cells[c, 2], row), min(cells[c, 3], -row)


@allocation_free
def merge_cells(cells, starts, widths, heights):
    """Fill the other levels of `Patch.cells`."""
    for level in range(1, starts.shape[0]):
        width, below = widths[level], starts[level - 1]
        cells[starts[level] : starts[level] + width * heights[level]] = 1 << 30
        for j in range(heights[level - 1]):
            for i in range(widths[level - 1]):
                a = starts[level] + (j >> 1) * width + (i >> 1)
                b = below + j * widths[level - 1] + i
                for k in range(4):
                    cells[a, k] = min(cells[a, k], cells[b, k])
