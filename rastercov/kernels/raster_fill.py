"""Filling of triangles: the paths from the faces of a cluster to samples of the image.

| path | triangles | taken together |
|---|---|---|
| `fill_samples_2x2` | reach at most 2 x 2 samples | a vector |
| `fill_blocks_2x2` | reach at most 2 x 2 blocks of 4 x 4 samples | a vector |
| `fill_tiles` | any other of up to `LARGE` steps | one; 4 x 4 blocks of it |
| `fill_cells` | wide, or parts of a clipped face, in 64 bits | one; cells of the image |

Visible counts are kept incrementally: writing a sample increments the count of its face and
decrements that of the previous one. No pass over the image follows.
"""

import numpy as np

from rastercov.kernels.jit import compiled, part_of
from rastercov.kernels.raster_coverage import (
    blocks_of,
    blocks_of_tile,
    border_mask,
    count_covered,
    count_hidden_lanes,
    counts_in_blocks,
    mask_in_image,
    samples_of,
)
from rastercov.kernels.raster_memory import (
    ALL_LANES,
    FACE,
    FIRST_X,
    FIRST_Y,
    FOURFOLD,
    GREATEST,
    LANES,
    MIN_VECTOR_FACES,
    ORIGIN,
    SIDE,
    SIDE_BITS,
    SLOPE_X,
    SLOPE_Y,
    STEP_X,
    STEP_Y,
    BinSizes,
)
from rastercov.kernels.raster_occlusion import is_hidden
from rastercov.kernels.raster_stage_cover import (
    cover_block,
    cover_blocks,
    coverage_of_samples,
    start_blocks,
    whole_blocks,
)
from rastercov.kernels.raster_stage_cull import bin_faces
from rastercov.kernels.raster_stage_depth import (
    count_block,
    depth_of_samples,
    depth_test,
    hidden_blocks,
    least_in_tile,
    samples_of_face,
    samples_of_later_faces,
    weight_of,
    write_face,
)
from rastercov.kernels.raster_stage_setup import set_up_triangles
from rastercov.kernels.simd_kernel import align_stack, append_set_bits, count_bits, lowest_bit


@part_of
def cull_and_bin(faces, n_slots, window, is_plain, counts, bit_indices, bins):
    """List the slots of faces that can cover a sample, by path; returns the lengths of the lists.

    The cluster has `n_slots`, a multiple of `LANES`; `is_plain` is not 0 where no face can be wide
    or need clipping. `bins` gets the faces that cover a sample of at most 2 x 2; that reach more;
    those of either kind that are hidden, only `with_drawn`; faces for 64 bits; and faces to clip.
    """
    small, larger, hidden_small, hidden_larger, wide, clipped, _ = bins
    n_small = n_larger = n_hidden_small = n_hidden_larger = n_wide = n_clipped = 0
    for at in range(0, n_slots, LANES):
        shown, hidden = bin_faces(faces, at, window, is_plain)
        n_small = append_set_bits(bit_indices, shown & ALL_LANES, at, small, n_small)
        n_larger = append_set_bits(bit_indices, shown >> LANES & ALL_LANES, at, larger, n_larger)
        if shown >> 2 * LANES:
            bits = shown >> 2 * LANES & ALL_LANES
            n_wide = append_set_bits(bit_indices, bits, at, wide, n_wide)
            bits = shown >> 3 * LANES & ALL_LANES
            n_clipped = append_set_bits(bit_indices, bits, at, clipped, n_clipped)
        if counts.with_drawn:
            if counts_in_blocks(window, counts):  # the mask of 2 x 2 has no places
                hidden = (hidden | hidden << LANES) & ALL_LANES << LANES
            bits = hidden & ALL_LANES
            n_hidden_small = append_set_bits(bit_indices, bits, at, hidden_small, n_hidden_small)
            bits = hidden >> LANES
            n_hidden_larger = append_set_bits(bit_indices, bits, at, hidden_larger, n_hidden_larger)
    return BinSizes(n_small, n_larger, n_hidden_small, n_hidden_larger, n_wide, n_clipped)


@part_of
def fill_samples_2x2(chosen, setup, target):
    """Fill chosen triangles that reach at most 2 x 2 samples; returns how many were empty."""
    window, image, counts, _ = target
    filled = 0
    covered = coverage_of_samples(setup) & chosen * FOURFOLD
    for k in range(4):
        if covered >> k * LANES & ALL_LANES:
            depth_of_samples(k, window, setup)
    while covered:
        k = lowest_bit(covered)
        covered &= covered - 1
        lane = k & (LANES - 1)
        face, sample = setup.bounds[FACE * LANES + lane], setup.sample[k]
        n = weight_of(sample, counts.weights)
        if window.full_x == 0:
            x = np.int64(setup.bounds[FIRST_X * LANES + lane] + (k >> 4 & 1))
            y = setup.bounds[FIRST_Y * LANES + lane] + (k >> 5)
            if x < window.first[y] or x >= window.last[y]:
                continue
        if counts.with_drawn and counts_in_blocks(window, counts):
            counts.drawn[face] += n
        depth, old = setup.depth[k], image.depth[sample]
        if depth > old or (depth == old and image.face[sample] > face):
            if old > 0:
                counts.visible[image.face[sample]] -= n
            else:
                filled += 1
            counts.visible[face] += n
            image.depth[sample] = depth
            image.face[sample] = face
    return filled


@part_of
def fill_block(at, covered, setup, k, start, face, image, counts):
    """Write the nearer samples of a block; returns their count, and how many were empty."""
    found = depth_test(image, at, covered, setup, k, start)
    won = found & ALL_LANES
    lost = found >> LANES & ALL_LANES
    ties = found >> 2 * LANES
    if ties:  # the lower face wins
        ties &= samples_of_later_faces(image.face, at, face)
        won |= ties
        lost |= ties
    if won == 0:
        return 0, 0
    n_new = count_bits(won) - count_bits(lost)
    while lost:
        loser = image.face[at + lowest_bit(lost)]
        its = samples_of_face(image.face, at, loser) & lost
        counts.visible[loser] -= count_block(its, at, counts.weights)
        lost &= ~its
    write_face(image.face, at, won, face)
    return count_block(won, at, counts.weights), n_new


@part_of
def fill_blocks_2x2(chosen, wide, tall, setup, target):
    """Fill chosen triangles that reach at most 2 x 2 blocks; returns how many samples were empty.

    Those with bits in `wide` reach two columns, those with bits in `tall` two rows.
    """
    window, image, counts, _ = target
    filled, found, at_border = 0, 0, 0
    for k in range(4):
        if (k & 1 == 0 or chosen & wide) and (k >> 1 == 0 or chosen & tall):
            bits = cover_blocks(k, window, setup)
            found |= (bits & chosen) << k * LANES
            at_border |= (bits >> LANES) << k * LANES
    while found:
        k = lowest_bit(found)
        found &= found - 1
        lane = k & (LANES - 1)
        face, bits = setup.bounds[FACE * LANES + lane], np.int64(setup.masks[k])
        if at_border >> k & 1:
            block_x = np.int64(setup.bounds[FIRST_X * LANES + lane] >> SIDE_BITS) + (k >> 4 & 1)
            block_y = np.int64(setup.bounds[FIRST_Y * LANES + lane] >> SIDE_BITS) + (k >> 5)
            bits &= border_mask(block_x, block_y, window)
        at, start = np.int64(setup.sample[k]), setup.depth[k]
        if counts.with_drawn:
            counts.drawn[face] += count_block(bits, at, counts.weights)
        n_won, n_new = fill_block(at, bits, setup, lane, start, face, image, counts)
        counts.visible[face] += n_won
        filled += n_new
    return filled


@compiled
def fill_cells(k, setup, target):
    """Fill triangle k, a large one; returns how many samples were empty.

    Its tiles are cells, so those behind what is drawn are skipped, and those that it covers
    wholly bound the depth of their cells.
    """
    window, image, counts, _ = target
    reached = blocks_of(k, setup)
    first_x, last_x, first_y, last_y = reached
    top = window.top >> SIDE_BITS
    face = setup.bounds[FACE * LANES + k]
    covered = gained = filled = 0
    for tile_y in range(first_y - ((first_y - top) & (SIDE - 1)), last_y + 1, SIDE):
        cells = ((tile_y - top) >> SIDE_BITS) * (window.columns >> SIDE_BITS)
        for tile_x in range(first_x & -SIDE, last_x + 1, SIDE):
            blocks = blocks_of_tile(k, tile_x, tile_y, reached, setup)
            if blocks == 0:
                continue
            cell = cells + (tile_x >> SIDE_BITS)
            start_blocks(k, tile_x, tile_y, window, setup)
            shown = blocks & ~hidden_blocks(k, image.cell_depth[cell], setup)
            if shown == 0 and not (counts.with_drawn and image.cell_depth[cell] < np.inf):
                continue
            is_cut = tile_x + SIDE > window.full_x or tile_y + SIDE > window.full_y
            is_whole = blocks == ALL_LANES and not is_cut
            if is_whole and whole_blocks(k, setup) == ALL_LANES:
                if counts.with_drawn:
                    for lane in range(LANES):
                        at = np.int64(setup.sample[lane])
                        covered += count_block(ALL_LANES, at, counts.weights)
                least = least_in_tile(k, setup)
                while shown:
                    lane = lowest_bit(shown)
                    shown &= shown - 1
                    at, start = np.int64(setup.sample[lane]), setup.depth[lane]
                    n_won, n_new = fill_block(at, ALL_LANES, setup, k, start, face, image, counts)
                    gained += n_won
                    filled += n_new
                image.cell_depth[cell] = max(image.cell_depth[cell], least)
                continue
            if not counts.with_drawn:
                blocks = shown
            while blocks:
                lane = lowest_bit(blocks)
                blocks &= blocks - 1
                bits = cover_block(lane, setup)
                if is_cut:
                    block_x, block_y = tile_x + (lane & (SIDE - 1)), tile_y + (lane >> SIDE_BITS)
                    bits = mask_in_image(bits, block_x, block_y, window)
                at, start = np.int64(setup.sample[lane]), setup.depth[lane]
                covered += count_block(bits, at, counts.weights)
                if bits and shown >> lane & 1:
                    n_won, n_new = fill_block(at, bits, setup, k, start, face, image, counts)
                    gained += n_won
                    filled += n_new
    if gained:
        counts.visible[face] += gained
    if counts.with_drawn:
        counts.drawn[face] += covered
    return filled


@compiled
def fill_tiles(chosen, setup, target):
    """Fill chosen triangles of any size; returns how many samples were empty."""
    window, image, counts, _ = target
    filled = 0
    while chosen:
        k = lowest_bit(chosen)
        chosen &= chosen - 1
        reached = blocks_of(k, setup)
        first_x, last_x, first_y, last_y = reached
        face = setup.bounds[FACE * LANES + k]
        is_cut = last_x >= window.full_x or last_y >= window.full_y
        gained, covered = 0, 0
        for tile_y in range(first_y, last_y + 1, SIDE):
            for tile_x in range(first_x, last_x + 1, SIDE):
                blocks = blocks_of_tile(k, tile_x, tile_y, reached, setup)
                start_blocks(k, tile_x, tile_y, window, setup)
                while blocks:
                    lane = lowest_bit(blocks)
                    blocks &= blocks - 1
                    bits = cover_block(lane, setup)
                    if is_cut:
                        block_x, block_y = (
                            tile_x + (lane & (SIDE - 1)),
                            tile_y + (lane >> SIDE_BITS),
                        )
                        bits = mask_in_image(bits, block_x, block_y, window)
                    if bits == 0:
                        continue
                    at, start = np.int64(setup.sample[lane]), setup.depth[lane]
                    if counts.with_drawn:
                        covered += count_block(bits, at, counts.weights)
                    n_won, n_new = fill_block(at, bits, setup, k, start, face, image, counts)
                    gained += n_won
                    filled += n_new
        if gained:
            counts.visible[face] += gained
        if counts.with_drawn:
            counts.drawn[face] += covered
    return filled


@part_of
def hidden_lanes(chosen, setup, target):
    """Mask of the chosen triangles that are behind what is drawn in all cells that they reach."""
    hidden = 0
    while chosen:
        k = lowest_bit(chosen)
        chosen &= chosen - 1
        nearest = setup.plane32[GREATEST * LANES + k]
        hidden |= (
            np.int64(is_hidden(samples_of(k, setup), nearest, target.window, target.image)) << k
        )
    return hidden


@part_of
def fill_small(bins, n_small, n_larger, faces, setup, target):
    """Fill listed triangles of up to `LARGE` steps; returns how many samples were empty."""
    slots = bins.samples_2x2  # and the larger ones behind them, so that few lanes stay empty
    for i in range(n_larger):
        slots[n_small + i] = bins.larger[i]
    n = n_small + n_larger
    filled = 0
    for i in range(0, n, LANES):
        wants_edges = np.int64(i + LANES > n_small)
        sizes, _ = set_up_triangles(slots, i, wants_edges, faces, target.window, setup)
        small = ALL_LANES >> min(max(LANES - (n_small - i), 0), LANES)
        others = (ALL_LANES >> max(LANES - (n - i), 0)) & ~small
        if target.tests_cells:
            hidden = hidden_lanes(others, setup, target)
            others &= ~hidden
            if hidden and target.counts.with_drawn:
                count_hidden_lanes(hidden, setup, target)
        if small:
            filled += fill_samples_2x2(small, setup, target)
        in_blocks = sizes & others
        if count_bits(in_blocks) < MIN_VECTOR_FACES:
            in_blocks = 0
        else:
            wide, tall = sizes >> LANES, sizes >> 2 * LANES
            filled += fill_blocks_2x2(in_blocks, wide, tall, setup, target)
        in_tiles = others & ~in_blocks
        if in_tiles:
            filled += fill_tiles(in_tiles, setup, target)
    return filled


@part_of
def use_plane(plane, n, setup):
    """Give the first n triangles of a vector the depth plane of the face that they are parts of."""
    for k in range(n):
        setup.plane64[ORIGIN * LANES + k] = plane.origin
        setup.plane64[SLOPE_X * LANES + k] = plane.slope_x
        setup.plane64[SLOPE_Y * LANES + k] = plane.slope_y
        setup.plane32[STEP_X * LANES + k] = np.float32(plane.slope_x)
        setup.plane32[STEP_Y * LANES + k] = np.float32(plane.slope_y)


@compiled
def fill_any(slots, n, faces, setup, target, plane):
    """Fill triangles of any size in 64 bits; returns how many samples were empty.

    `plane` is that of the face of which all are parts; each has its own where it is not finite.
    """
    align_stack()
    filled = 0
    has_plane = (
        np.isfinite(plane.origin) and np.isfinite(plane.slope_x) and np.isfinite(plane.slope_y)
    )
    for i in range(0, n, LANES):
        _, sides = set_up_triangles(slots, i, np.int64(1), faces, target.window, setup)
        if has_plane:
            use_plane(plane, min(n - i, LANES), setup)
        valid = ALL_LANES >> max(LANES - (n - i), 0)
        shown = sides & valid
        while shown:
            filled += fill_cells(lowest_bit(shown), setup, target)
            shown &= shown - 1
        hidden = sides >> LANES & valid
        while hidden and target.counts.with_drawn:
            k = lowest_bit(hidden)
            drawn = count_covered(k, target.window, target.counts.weights, setup)
            target.counts.drawn[setup.bounds[FACE * LANES + k]] += drawn
            hidden &= hidden - 1
    return filled
