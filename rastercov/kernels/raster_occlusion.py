"""Occlusion of clusters by what is drawn: order by depth, and bounds of depth in cells.

The image is divided into cells of 4 x 4 blocks. Each has a lower bound of 1/z at its samples, 0
while one of them is empty. Depths only ever come nearer, so a bound stays true when it is not
updated. A cluster whose vertices are all farther than the bounds of the cells that it reaches owns
no sample: not even a tie, because its 1/z is strictly less.

N. Greene, M. Kass, G. Miller. Hierarchical Z-Buffer Visibility. 1993.
"""

import numpy as np

from rastercov.kernels.jit import compiled, part_of
from rastercov.kernels.raster_memory import (
    CELL_BITS,
    DEPTH_BUCKETS,
    HALF_SAMPLE,
    RADIUS,
    SIDE,
    SIDE_BITS,
    STEP_BITS,
    STRIP_BITS,
)
from rastercov.kernels.raster_stage_depth import least_depth


@part_of
def order_by_depth(clusters, seen, n, forward, bucket_ends, ordered):
    """Write the clusters in `seen` to `ordered`, about by the nearest depth of their spheres.

    `forward` is the depth of their centres. Within one of `DEPTH_BUCKETS` ranges of equal length
    they keep their order.
    """
    radius = RADIUS * clusters.stride
    low, high = np.inf, -np.inf
    for i in range(n):
        nearest = forward[seen[i]] - clusters.bounds[radius + seen[i]]
        low, high = min(low, nearest), max(high, nearest)
    scale = (DEPTH_BUCKETS - 1) / (high - low) if high > low else 0.0
    for bucket in range(DEPTH_BUCKETS):
        bucket_ends[bucket] = 0
    for i in range(n):
        nearest = forward[seen[i]] - clusters.bounds[radius + seen[i]]
        bucket_ends[np.int64((nearest - low) * scale)] += 1
    end = 0
    for bucket in range(DEPTH_BUCKETS):
        begin, end = end, end + bucket_ends[bucket]
        bucket_ends[bucket] = begin
    for i in range(n):
        nearest = forward[seen[i]] - clusters.bounds[radius + seen[i]]
        bucket = np.int64((nearest - low) * scale)
        ordered[bucket_ends[bucket]] = seen[i]
        bucket_ends[bucket] += 1


@part_of
def samples_in_box(box, window):
    """First and last column, first and last row of the samples in a box in steps."""
    low_x, high_x, low_y, high_y = box
    return (
        max((np.int64(low_x) + HALF_SAMPLE - 1) >> STEP_BITS, 0),
        min((np.int64(high_x) - HALF_SAMPLE) >> STEP_BITS, np.int64(window.right)),
        max((np.int64(low_y) + HALF_SAMPLE - 1) >> STEP_BITS, np.int64(window.top)),
        min((np.int64(high_y) - HALF_SAMPLE) >> STEP_BITS, np.int64(window.bottom)),
    )


@part_of
def is_filled(image, first, last):
    """True where the first sample of a block and the last one before another are not empty."""
    sample = first << 2 * SIDE_BITS
    return image.depth[sample] > 0 and image.depth[(last << 2 * SIDE_BITS) - 1] > 0


@compiled
def bound_cells(window, image):
    """Bound the depth of the cells that have no bound yet by their samples."""
    n_rows = ((window.bottom - window.top) >> SIDE_BITS) + 1
    strips = window.columns >> STRIP_BITS
    for top in range(0, n_rows, SIDE):
        rows = min(n_rows - top, SIDE)
        for strip in range(strips):
            is_cleared = True
            for row in range(top, top + rows):
                is_cleared &= image.marks[row * strips + strip] != 0
            if is_cleared:
                for column in range(strip << STRIP_BITS, (strip + 1) << STRIP_BITS, SIDE):
                    block = top * window.columns + column
                    cell = (top * window.columns >> 2 * SIDE_BITS) + (column >> SIDE_BITS)
                    last = block + (rows - 1) * window.columns + SIDE
                    if image.cell_depth[cell] == 0 and is_filled(image, block, last):
                        bound = least_depth(image.depth, block, window.columns, rows)
                        image.cell_depth[cell] = bound


@part_of
def is_hidden(samples, nearest, window, image):
    """True where all cells of a range of samples are nearer than `nearest`, a greatest 1/z."""
    first_x, last_x, first_y, last_y = samples
    columns = window.columns >> SIDE_BITS
    for row in range((first_y - window.top) >> CELL_BITS, ((last_y - window.top) >> CELL_BITS) + 1):
        for column in range(first_x >> CELL_BITS, (last_x >> CELL_BITS) + 1):
            if image.cell_depth[row * columns + column] <= nearest:
                return False
    return True
