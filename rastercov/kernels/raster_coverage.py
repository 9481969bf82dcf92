"""Samples that triangles cover: blocks in reach, the image border, and counts without depth."""

import numpy as np

from rastercov.kernels.jit import compiled, part_of
from rastercov.kernels.raster_memory import (
    ALL_LANES,
    FACE,
    FIRST_X,
    FIRST_Y,
    LANES,
    LAST_X,
    LAST_Y,
    MIN_VECTOR_FACES,
    SIDE,
    SIDE_BITS,
)
from rastercov.kernels.raster_stage_cover import (
    count_rows,
    count_samples,
    cover_block,
    fit_count_samples,
    reach_blocks,
)
from rastercov.kernels.raster_stage_depth import count_block
from rastercov.kernels.raster_stage_setup import set_up_edges
from rastercov.kernels.simd_kernel import align_stack, count_bits, lowest_bit


@compiled
def border_mask(block_x, block_y, window):
    """Mask of the samples of a block that are inside the image."""
    inside = 0
    for j in range(SIDE):
        row = (block_y << SIDE_BITS) + j
        if row < window.height:
            begin = min(max(np.int64(window.first[row]) - (block_x << SIDE_BITS), 0), SIDE)
            end = min(max(np.int64(window.last[row]) - (block_x << SIDE_BITS), 0), SIDE)
            inside |= (((1 << end) - 1) & ~((1 << begin) - 1)) << (SIDE * j)
    return inside


@part_of
def mask_in_image(bits, block_x, block_y, window):
    """Samples of a block inside the image."""
    if block_x < window.inner[2 * block_y] or block_x >= window.inner[2 * block_y + 1]:
        return bits & border_mask(block_x, block_y, window)
    return bits


@part_of
def samples_of(k, setup):
    """First and last column, first and last row of the samples that a triangle reaches."""
    bounds = setup.bounds
    return (
        np.int64(bounds[FIRST_X * LANES + k]), np.int64(bounds[LAST_X * LANES + k]),
        np.int64(bounds[FIRST_Y * LANES + k]), np.int64(bounds[LAST_Y * LANES + k]),
    )  # fmt: skip


@part_of
def blocks_of(k, setup):
    """The same of the blocks that it reaches."""
    first_x, last_x, first_y, last_y = samples_of(k, setup)
    return first_x >> SIDE_BITS, last_x >> SIDE_BITS, first_y >> SIDE_BITS, last_y >> SIDE_BITS


@part_of
def blocks_of_tile(k, tile_x, tile_y, blocks, setup):
    """Mask of the blocks of a tile that triangle k may cover samples of, see `reach_blocks`."""
    first_x, last_x, first_y, last_y = blocks
    found = reach_blocks(k, tile_x - first_x, tile_y - first_y, setup)
    n_columns, n_rows = min(last_x - tile_x + 1, SIDE), min(last_y - tile_y + 1, SIDE)
    return found & ((1 << n_columns) - 1) * 0x1111 & ((1 << (SIDE * n_rows)) - 1)


@compiled
def count_covered(k, window, weights, setup):
    """Number of samples that triangle k covers, of any size, by their weights."""
    reached = blocks_of(k, setup)
    first_x, last_x, first_y, last_y = reached
    is_cut = last_x >= window.full_x or last_y >= window.full_y
    covered = 0
    for tile_y in range(first_y, last_y + 1, SIDE):
        for tile_x in range(first_x, last_x + 1, SIDE):
            blocks = blocks_of_tile(k, tile_x, tile_y, reached, setup)
            while blocks:
                lane = lowest_bit(blocks)
                blocks &= blocks - 1
                bits = cover_block(lane, setup)
                block_x, block_y = tile_x + (lane & (SIDE - 1)), tile_y + (lane >> SIDE_BITS)
                if is_cut:
                    bits = mask_in_image(bits, block_x, block_y, window)
                block = (block_y - (window.top >> SIDE_BITS)) * window.columns + block_x
                covered += count_block(bits, block << 2 * SIDE_BITS, weights)
    return covered


@part_of
def counts_in_blocks(window, counts):
    """True where samples count by their places: at the border, and where they have weights."""
    return window.full_x == 0 or counts.weights is not None


@part_of
def count_samples_2x2(slots, n, faces, drawn):
    """Add the samples of triangles that reach at most 2 x 2 to `drawn`, all inside the image."""
    for i in range(n):
        slot = np.int64(slots[i])
        covered = np.int64(faces.coverage_2x2[slot])
        drawn[faces.mesh.faces[faces.first_slot + slot]] += count_bits(covered)


@part_of
def count_lanes(chosen, n, setup, target):
    """Add the samples of chosen ones of n triangles of up to `LARGE` steps to `drawn`."""
    window, counts = target.window, target.counts
    in_blocks = counts_in_blocks(window, counts)
    small = fit_count_samples(setup) & chosen
    if in_blocks or count_bits(small) < MIN_VECTOR_FACES:
        small = 0
    if small:
        count_samples(small, setup)
    for k in range(n):
        if chosen >> k & 1 == 0:
            continue
        covered = 0
        if small >> k & 1:
            covered = np.int64(setup.masks[k])
        elif in_blocks:
            covered = count_covered(k, window, counts.weights, setup)
        else:
            n_rows = setup.bounds[LAST_Y * LANES + k] - setup.bounds[FIRST_Y * LANES + k] + 1
            for start in range(0, n_rows, LANES):
                covered += count_rows(k, start, setup)
        counts.drawn[setup.bounds[FACE * LANES + k]] += covered


@compiled
def count_hidden(slots, n, faces, setup, target):
    """Add the samples of hidden triangles to `drawn`; their depths are not computed."""
    align_stack()
    for i in range(0, n, LANES):
        set_up_edges(slots, i, faces, target.window, setup)
        chosen = ALL_LANES >> max(LANES - (n - i), 0)
        count_lanes(chosen, min(n - i, LANES), setup, target)


@compiled
def count_hidden_lanes(chosen, setup, target):
    """`count_lanes` out of line, for callers that seldom need it."""
    align_stack()
    count_lanes(chosen, LANES, setup, target)
