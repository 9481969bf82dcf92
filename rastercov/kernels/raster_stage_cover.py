"""Stage 5 of the CPU rasteriser: coverage masks from edge functions.

M. Abrash. Rasterization on Larrabee. 2009, for blocks within tiles, a vector at a time.
"""

from numba.core import types

from rastercov.kernels.raster_memory import (
    ALL_LANES,
    BLOCK_EDGE,
    COVERAGE,
    EDGE,
    EDGE_DX,
    EDGE_DY,
    FIRST_X,
    FIRST_Y,
    LANE_X,
    LANE_Y,
    LANES,
    LAST_X,
    LAST_Y,
    ORIGIN,
    SIDE,
    SIDE_BITS,
    SLOPE_X,
    SLOPE_Y,
    TILE_EDGE,
)
from rastercov.kernels.raster_stage_setup import signs
from rastercov.kernels.simd import DOUBLE, LONG, SINGLE, WORD, pack
from rastercov.kernels.simd_kernel import Variable, loop, simd

QUOTIENT_TOLERANCE = {SINGLE: 2.0**-14, DOUBLE: 2.0**-20}
"""Added to quotients: more than their rounding error, less than the least positive fraction. In
float32 for edges of up to 17 samples, in float64 for all triangles but wide ones."""
OUT_OF_REACH = 512.0
"""Half of it is more samples than any triangle reaches; times a value it fits 32 bits."""


@simd(returns=types.int64)
def coverage_of_samples(setup):
    """4 masks of the triangles that cover sample 0, 1, 2, 3 of their 2 x 2 samples."""
    coverage = setup.bounds[COVERAGE]
    return pack(*((coverage & (1 << k)) > 0 for k in range(4)))


@simd(returns=types.int64)
def cover_blocks(k, window, setup):
    """Mask of triangles that may cover samples of block k of their 2 x 2; above it, border blocks.

    Writes the coverage mask, the memory index of the block and 1/z at its first sample to row k of
    `setup.masks`, `setup.sample` and `setup.depth`.
    """
    edges = setup.edges
    i, j = k.to(WORD) & 1, k.to(WORD) >> 1
    block_x = (setup.bounds[FIRST_X] >> SIDE_BITS) + i
    block_y = (setup.bounds[FIRST_Y] >> SIDE_BITS) + j
    dx, dy = ([edges[row + n] for n in range(3)] for row in (EDGE_DX, EDGE_DY))
    first = [edges[EDGE + n] + (dx[n] * i + dy[n] * j << SIDE_BITS) for n in range(3)]
    outside = block_x.like(0)
    last = [first[n] + (dx[n] + dy[n]) * (SIDE - 1) for n in range(3)]
    for _ in range(SIDE):
        values = last
        for _ in range(SIDE):
            outside = outside.append_sign(signs(values))
            values = [value - step for value, step in zip(values, dx, strict=True)]
        last = [value - step for value, step in zip(last, dy, strict=True)]
    inside = outside.like(ALL_LANES) - outside
    setup.masks[k] = inside
    setup.sample[k], setup.depth[k] = block_starts(block_x, block_y, window, *plane_rows(setup))
    covered = (block_x <= setup.bounds[LAST_X] >> SIDE_BITS) & (inside > 0)
    covered = covered & (block_y <= setup.bounds[LAST_Y] >> SIDE_BITS)
    return pack(covered, (block_x >= window.full_x) | (block_y >= window.full_y))


def plane_rows(setup):
    """Origin and slopes of the depth planes of a vector of triangles."""
    return [setup.plane64[row] for row in (ORIGIN, SLOPE_X, SLOPE_Y)]


def block_starts(block_x, block_y, window, origin, slope_x, slope_y):
    """Memory index and 1/z of the first samples of blocks."""
    block = (block_y - (window.top >> SIDE_BITS)) * window.columns + block_x
    x, y = (block_x << SIDE_BITS).to(DOUBLE), (block_y << SIDE_BITS).to(DOUBLE)
    return block << 2 * SIDE_BITS, (origin + slope_y * y + slope_x * x).to(SINGLE)


def _last_covered(value, slope):
    """Steps for which an edge function stays non-negative: floor(value / |slope|); < 0 for none.

    For slope > 0 it is non-negative from minus that on. A quotient that is not an integer is at
    least 1/|slope| from one, much more than its rounding error and the tolerance.
    """
    kind = slope.kind
    value = value.to(kind)
    share = value * (slope.like(1) / slope.absolute()) + QUOTIENT_TOLERANCE[kind]
    # Along a level edge all samples are on the same side.
    level = (value + 0.5) * OUT_OF_REACH
    return share.where(slope.absolute() > 0, level).floor().to(WORD)


@simd(returns=types.int64)
def fit_count_samples(setup):
    """Mask of the triangles that reach at most `LANES` columns and rows of samples."""
    first_x, last_x, first_y, last_y = (setup.bounds[row] for row in range(4))
    return ((last_x - first_x < LANES) & (last_y - first_y < LANES)).bits()


@simd(returns=types.void)
def count_samples(chosen, setup):
    """Write the number of samples that the chosen triangles cover to `setup.masks`.

    They are those of `fit_count_samples`, and taken a row at a time.
    """
    edges = setup.edges
    first_x, last_x, first_y, last_y = (setup.bounds[row] for row in range(4))
    in_block = first_x & (SIDE - 1)
    left, right = in_block, last_x - first_x + in_block
    dx, dy = ([edges[row + n] for n in range(3)] for row in (EDGE_DX, EDGE_DY))
    slopes = [step.to(SINGLE) for step in dx]
    rows = (last_y - first_y + 1).where(chosen.as_mask(LANES), 0)
    n_rows = rows.reduce("maximum").to(LONG)
    values = [Variable(edges[EDGE + n] + dy[n] * (first_y & (SIDE - 1))) for n in range(3)]
    total = Variable(rows.like(0))
    with loop(n_rows.like(0), n_rows, 1) as y:
        begin, end = left, right
        for value, slope, step in zip(values, slopes, dy, strict=True):
            bound = _last_covered(value.now, slope)
            begin = begin.maximum(-bound).where(slope > 0, begin)
            end = end.where(slope > 0, end.minimum(bound))
            value.now = value.now + step
        covered = total.now + (end - begin + 1).maximum(0)
        total.now = covered.where(rows > y, total.now)
    setup.masks[0] = total.now


@simd(returns=types.int64)
def count_rows(k, start, setup):
    """Number of samples that triangle k covers in `LANES` rows from row `start` of its own on."""
    edges = setup.edges
    first_x, last_x, first_y, last_y = (setup.bounds.lane(row, k) for row in range(4))
    corner_x, corner_y = (first >> SIDE_BITS << SIDE_BITS for first in (first_x, first_y))
    y = first_y + start + range(LANES)
    left, right = first_x - corner_x, last_x - corner_x
    for n in range(3):
        value, dx, dy = (edges.lane(row + n, k) for row in (EDGE, EDGE_DX, EDGE_DY))
        bound = _last_covered(value + dy * (y - corner_y), dx.to(DOUBLE))
        left = left.maximum(-bound).where(dx > 0, left)
        right = right.where(dx > 0, right.minimum(bound))
    covered = (right - left + 1).maximum(0).where(y <= last_y, 0)
    return covered.reduce("__add__").to(LONG)


@simd(returns=types.int64)
def reach_blocks(k, right, down, setup):
    """Mask of the blocks of a tile that triangle k reaches, and a few more near its corners.

    The tile starts `right` and `down` blocks from the first one of the triangle. Its edge functions
    go to the rows `TILE_EDGE` and `BLOCK_EDGE`.
    """
    edges = setup.edges
    x = (right.to(edges.kind) + LANE_X) * SIDE
    y = (down.to(edges.kind) + LANE_Y) * SIDE
    highest = []
    for n in range(3):
        value, dx, dy = (edges.lane(row + n, k) for row in (EDGE, EDGE_DX, EDGE_DY))
        value = value + (dx * x + dy * y)
        edges[TILE_EDGE + n] = value
        edges[BLOCK_EDGE + n] = dx * LANE_X + dy * LANE_Y
        highest.append(value + (dx.maximum(0) + dy.maximum(0)) * (SIDE - 1))
    return (signs(highest) >= 0).bits()


@simd(returns=types.int64)
def whole_blocks(k, setup):
    """Mask of the blocks of the tile of `reach_blocks` that triangle k covers wholly."""
    edges = setup.edges
    lowest = []
    for n in range(3):
        dx, dy = (edges.lane(row + n, k) for row in (EDGE_DX, EDGE_DY))
        lowest.append(edges[TILE_EDGE + n] + (dx.minimum(0) + dy.minimum(0)) * (SIDE - 1))
    return (signs(lowest) >= 0).bits()


@simd(returns=types.void)
def start_blocks(k, tile_x, tile_y, window, setup):
    """Write memory index and 1/z of triangle k at the first samples of the blocks of a tile."""
    x, y = tile_x.to(WORD) + LANE_X, tile_y.to(WORD) + LANE_Y
    plane = [setup.plane64.lane(row, k) for row in (ORIGIN, SLOPE_X, SLOPE_Y)]
    setup.sample[0], setup.depth[0] = block_starts(x, y, window, *plane)


@simd(returns=types.int64)
def cover_block(block, setup):
    """Coverage mask of a block of the tile of `reach_blocks`."""
    edges = setup.edges
    values = [
        edges.value(block + (TILE_EDGE + n) * LANES) + edges[BLOCK_EDGE + n] for n in range(3)
    ]
    return (signs(values) >= 0).bits()
