"""Samples of a tile that a face covers, and their depth: a vector of `LANES` samples.

In float32 from the middle of the block, where that is sure, else in float64.
"""

from numba.core import types

from rastercov.raster.cpu.memory import LANES
from rastercov.raster.cpu.simd import DOUBLE, LONG, SINGLE, WORD, load, together
from rastercov.raster.cpu.simd_kernel import Variable, loop, simd, when
from rastercov.raster.target_kernels import TIE_REL


def is_inside_exactly(e, x, y):
    """Mask of the samples inside a face, for those next to an edge.

    (p x q).(x, y, 1) is the product of the vectors from the sample to p and to q. Each vector is
    rounded once for all edges at its corner, so their signs say on which side of the sample each
    edge passes without contradiction: no sample falls between faces at a corner, or in two.

    Where all three vectors point the same way, as from a sample beside a face that is as thin as
    rounding, so do not the signs of their products: such a sample is outside.
    """
    ax, ay = -(x * e.pz) + e.px, -(y * e.pz) + e.py
    bx, by = -(x * e.qz) + e.qx, -(y * e.qz) + e.qy
    cx, cy = -(x * e.rz) + e.rx, -(y * e.rz) + e.ry
    is_in = (ax * by - ay * bx) * e.side >= e.t0
    is_in = is_in & ((bx * cy - by * cx) * e.side >= e.t1)
    is_in = is_in & ((cx * ay - cy * ax) * e.side >= e.t2)
    for a, b, c in ((ax, bx, cx), (ay, by, cy)):
        is_in = is_in & (a.minimum(b).minimum(c) <= 0.0) & (a.maximum(b).maximum(c) >= 0.0)
    return is_in


def in_block(planes, centre_x, centre_y):
    """Slopes and values at the centre of a block, in float32, of four planes (a, b, c)."""
    a, b, c = (together(*numbers) for numbers in zip(*planes, strict=True))
    values = (a * centre_x + b * centre_y + c).to(SINGLE)
    return [
        (own_a.to(SINGLE), own_b.to(SINGLE), values.lane(k).broadcast(LANES))
        for k, (own_a, own_b, _) in enumerate(planes)
    ]


def lanes_of(e, tile, samples):
    """Return the mask of the samples of a tile that a face covers, and their 1/z.

    Edges are scaled so that their doubt is 1.
    """
    at = tile.to(LONG)
    centre = samples.centres.value(at * 2), samples.centres.value(at * 2 + 1)
    dx, dy = samples.x[at], samples.y[at]
    edges = (
        (e.a0 * e.scale0, e.b0 * e.scale0, e.c0 * e.scale0),
        (e.a1 * e.scale1, e.b1 * e.scale1, e.c1 * e.scale1),
        (e.a2 * e.scale2, e.b2 * e.scale2, e.c2 * e.scale2),
    )
    w, *values = (
        a * dx + b * dy + c for a, b, c in in_block(((e.a3, e.b3, e.c3), *edges), *centre)
    )
    # A sample without a place is NaN in all three.
    least = values[0].minimum(values[1]).minimum(values[2])
    is_beyond = (w > e.behind.to(SINGLE)) & (w <= e.cut.to(SINGLE))
    is_in, may_be_in = is_beyond & (least > 1.0), is_beyond & (least >= -1.0)
    found = Variable(is_in)
    with when((may_be_in & ~is_in).bits() > 0, likely=False):
        place = dx.to(DOUBLE) + centre[0], dy.to(DOUBLE) + centre[1]
        found.now = may_be_in & is_inside_exactly(e, *place)
    return found.now, w.maximum(e.least.to(SINGLE)).minimum(e.greatest.to(SINGLE))


@simd(returns=types.int64)
def tiles_met(e, at, boxes, n_boxes, first, n, margin):
    """Bits of the tiles, of `LANES` from the first on, at most n, that a face may cover.

    A tile is left out that is on the outer side of an edge, or beside the box of the face, by more
    than the margin, which is more than float32 rounds.
    """
    x0, x1, y0, y1 = (boxes.at(first + n_boxes * k)[0] for k in range(4))
    is_met = n.to(WORD).broadcast(LANES) > list(range(LANES))
    is_met = is_met & (x1 >= (at.x0 - margin).to(SINGLE)) & (x0 <= (at.x1 + margin).to(SINGLE))
    is_met = is_met & (y1 >= (at.y0 - margin).to(SINGLE)) & (y0 <= (at.y1 + margin).to(SINGLE))
    for a, b, c, doubt in (
        (e.a0, e.b0, e.c0, e.d0),
        (e.a1, e.b1, e.c1, e.d1),
        (e.a2, e.b2, e.c2, e.d2),
    ):
        a, b, c = (slope.to(SINGLE) for slope in (a, b, c))
        furthest = (x0 * a).maximum(x1 * a) + (y0 * b).maximum(y1 * b)  # no branch by the signs
        is_met = is_met & (furthest + c >= (-doubt - margin).to(SINGLE))
    return is_met.bits()


@simd(returns=types.void)
def request(tile, samples, inverse, face):
    """Request the cache lines of a tile that `cover` reads."""
    at = tile.to(LONG)
    samples.centres.prefetch(at * 2)
    for rows in (samples.x, samples.y, inverse, face):
        rows.prefetch(at * LANES, is_written=rows is inverse or rows is face)


@simd(returns=types.UniTuple(types.int64, 3))
def cover(e, tile, samples, inverse):
    """Put the depth of a face on the samples of a tile where nothing is nearer.

    Returns the bits of the samples that it covers, of those where it is nearest now, and of those
    of them that had another face.
    """
    at = tile.to(LONG)
    is_in, w = lanes_of(e, tile, samples)
    before = inverse[at]
    is_nearer = is_in & (w > before)
    inverse[at] = w.where(is_nearer, before)
    is_lost = is_nearer & (before > 0.0)
    return is_in.bits(), is_nearer.bits(), is_lost.bits()


@simd(returns=types.void)
def put_face(f, bits, tile, face):
    """Put a face on those samples of a tile whose bits are set."""
    at = tile.to(LONG)
    face[at] = f.to(WORD).broadcast(LANES).where(bits.as_mask(LANES), face[at])


@simd(returns=types.UniTuple(types.int64, 4))
def range_of_cells(cells, first, columns, rows, width):
    """First column and last column, first and last row of tiles in a rectangle of cells.

    The rectangle has its first cell at `first` and a number of columns and rows; `width` is that of
    its level. See `Patch.cells`.
    """
    least = Variable(load(cells.builder, cells.at(first * 4).pointer, 4))
    with loop(first, first + rows * width, width) as row, loop(row, row + columns, 1) as cell:
        least.now = least.now.minimum(load(cells.builder, cells.at(cell * 4).pointer, 4))
    found = least.now.to(LONG)
    return found.lane(0), -found.lane(1), found.lane(2), -found.lane(3)


@simd(returns=types.int64)
def count_covered(e, tile, samples):
    """Samples of a tile that a face covers."""
    is_in, _ = lanes_of(e, tile, samples)
    return is_in.bits().count_bits()


@simd(returns=types.int64)
def count_seen(e, tile, samples, inverse):
    """Samples of a tile that a target covers and that no surface hides."""
    is_in, w = lanes_of(e, tile, samples)
    before = inverse[tile.to(LONG)].to(DOUBLE)
    return (is_in & (w.to(DOUBLE) * (1.0 + TIE_REL) >= before)).bits().count_bits()


@simd(returns=types.int64)
def same_face(face, tile, f):
    """Bits of the samples of a tile that show a face."""
    return face[tile.to(LONG)].equals(f.to(WORD)).bits()


@simd(returns=types.void)
def clear(tile, inverse):
    """Empty a tile: a sample of depth 0 has no face, whatever its number."""
    at = tile.to(LONG)
    inverse[at] = inverse[at].like(0.0)
