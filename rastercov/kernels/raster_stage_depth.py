"""Stage 6 of the CPU rasteriser: depth tests, and the face index of each sample."""

from numba.core import types

from rastercov.kernels.raster_memory import (
    FIRST_X,
    FIRST_Y,
    GREATEST,
    LANE_X,
    LANE_Y,
    LANES,
    LEAST,
    LINE_BITS,
    MOST_WEIGHT,
    SIDE,
    SIDE_BITS,
    STEP_X,
    STEP_Y,
)
from rastercov.kernels.raster_stage_cover import block_starts, plane_rows
from rastercov.kernels.simd import LONG, SINGLE, WORD, pack
from rastercov.kernels.simd_kernel import Variable, loop, simd


@simd(returns=types.void)
def depth_of_samples(k, window, setup):
    """Write memory index and 1/z of sample k of the 2 x 2 samples of a vector of triangles.

    To row k of `setup.sample` and `setup.depth`.
    """
    x = setup.bounds[FIRST_X] + (k.to(WORD) & 1)
    y = setup.bounds[FIRST_Y] + (k.to(WORD) >> 1)
    in_x, in_y = x & (SIDE - 1), y & (SIDE - 1)
    block_x, block_y = x >> SIDE_BITS, y >> SIDE_BITS
    sample, start = block_starts(block_x, block_y, window, *plane_rows(setup))
    setup.sample[k] = sample + (in_y << SIDE_BITS) + in_x
    plane = setup.plane32
    depth = start + (plane[STEP_X] * in_x.to(SINGLE) + plane[STEP_Y] * in_y.to(SINGLE))
    setup.depth[k] = depth.maximum(plane[LEAST]).minimum(plane[GREATEST])


@simd(returns=types.int64)
def hidden_blocks(k, bound, setup):
    """Mask of the blocks of `start_blocks` where 1/z of triangle k is less than a bound throughout.

    A rounded product or sum does not decrease where an operand increases, so the greatest value is
    at a corner of the block, bit for bit. Where slopes are not finite it is at least `LEAST`, which
    the samples have then.
    """
    starts, plane = setup.depth[0], setup.plane32
    right, down = (plane.lane(row, k) * (SIDE - 1) for row in (STEP_X, STEP_Y))
    highest = starts + (right.maximum(0) + down.maximum(0))
    highest = highest.maximum(plane.lane(LEAST, k)).minimum(plane.lane(GREATEST, k))
    return (highest < bound).bits()


@simd(returns=types.float32)
def least_in_tile(k, setup):
    """Least 1/z of triangle k at the samples of the blocks of `start_blocks`, see `hidden_blocks`.

    Where a slope is not finite, its product with 0 is not a number, and the result is `LEAST`.
    """
    starts, plane = setup.depth[0], setup.plane32
    right, down = (
        (step * (SIDE - 1)).minimum(step * 0)
        for step in (plane.lane(row, k) for row in (STEP_X, STEP_Y))
    )
    lowest = (starts + (right + down)).maximum(plane.lane(LEAST, k))
    return lowest.minimum(plane.lane(GREATEST, k)).reduce("minimum")


@simd(returns=types.int64)
def depth_test(image, at, covered, setup, k, start):
    """Write the depth of triangle k to the covered samples of a block where it is nearest.

    `start` is 1/z at the first sample of the block, whose memory index is `at`. Returns 3 masks:
    samples that were written; those of them that were not empty; and samples of equal depth.
    """
    plane = setup.plane32
    step_x, step_y, least, greatest = (
        plane.lane(row, k) for row in (STEP_X, STEP_Y, LEAST, GREATEST)
    )
    depth = start + (step_x * LANE_X + step_y * LANE_Y)
    depth = depth.maximum(least).minimum(greatest)
    block = image.depth.at(at)
    old, active = block[0], covered.as_mask(LANES)
    wins = (depth > old) & active
    ties = depth.equals(old) & active
    block[0] = depth.where(wins, old)
    return pack(wins, wins & (old > 0), ties)


@simd(returns=types.float32)
def least_depth(depth, block, columns, n_rows):
    """Least 1/z of a cell: 4 blocks in each of at most 4 rows of `columns` blocks.

    `block` is the first one; of a cell at the lower rim only `n_rows` rows are in memory.
    """
    least = None
    for row in range(SIDE):
        start = (block + columns * n_rows.like(row).minimum(n_rows - 1)) << 2 * SIDE_BITS
        for k in range(SIDE):
            values = depth.at(start)[k]
            least = values if least is None else least.minimum(values)
    return least.reduce("minimum")


@simd(returns=types.float32)
def nearest_vertex(vertices, n):
    """Greatest 1/z of the first n vertices of a cluster."""
    lane = n.broadcast(LANES).like(range(LANES))
    nearest = Variable(vertices.w[0].like(0))
    with loop(n.like(0), n, LANES) as first:
        values = vertices.w.at(first)[0].where(lane < n - first, 0)
        nearest.now = nearest.now.maximum(values)
    return nearest.now.reduce("maximum").to(SINGLE)


@simd(returns=types.int64)
def samples_of_later_faces(faces, at, face):
    """Mask of the samples of a block of which a face of a higher index is the nearest."""
    return (faces.at(at)[0] > face).bits()


@simd(returns=types.int64)
def samples_of_face(faces, at, face):
    """Mask of the samples of a block of which a face is the nearest."""
    return faces.at(at)[0].equals(face).bits()


@simd(returns=types.void)
def write_face(faces, at, bits, face):
    """Write a face index to samples of a block."""
    block = faces.at(at)
    old = block[0]
    block[0] = old.like(face).where(bits.as_mask(LANES), old)


@simd(returns=types.int64)
def count_block(bits, at, weights):
    """Number of the samples of a block in a mask, by their weights if they have any."""
    if weights is None:
        return bits.count_bits()
    found = weights.at(at)[0].where(bits.as_mask(LANES), 0).zero_extended(WORD)
    return found.reduce("__add__").to(LONG)


@simd(returns=types.int64)
def weight_of(sample, weights):
    """Weight of a sample, 1 where there are none."""
    if weights is None:
        return sample.to(LONG).like(1)
    return weights.value(sample).to(LONG) & MOST_WEIGHT


@simd(returns=types.void)
def prefetch_counts(counts, lines, begin, end):
    """Request the cache lines of counts that `lines` lists from `begin` to `end`, for writing."""
    with loop(begin, end, 1) as at:
        counts.prefetch(lines.value(at) << LINE_BITS, is_written=True)
