"""Samples of a tile that a face covers, and their depth: a vector of `LANES` samples.

In float32 from the middle of the block, where that is sure, else in float64.
"""

from numba.core import types

from rastercov.raster.cpu.memory import LANES
from rastercov.raster.cpu.simd import DOUBLE, LONG, SINGLE, WORD
from rastercov.raster.cpu.simd_kernel import Variable, simd, when
from rastercov.raster.target_kernels import TIE_REL


def is_inside_exactly(e, x, y):
    """Mask of the samples inside a face, for those next to an edge.

    (p x q).(x, y, 1) is the product of the vectors from the sample to p and to q. Each vector is
    rounded once for all edges at its corner, so their signs say on which side of the sample each
    edge passes without contradiction: no sample falls between faces at a corner, or in two.
    """
    ax, ay = -(x * e.pz) + e.px, -(y * e.pz) + e.py
    bx, by = -(x * e.qz) + e.qx, -(y * e.qz) + e.qy
    cx, cy = -(x * e.rz) + e.rx, -(y * e.rz) + e.ry
    is_in = (ax * by - ay * bx) * e.side >= e.t0
    is_in = is_in & ((bx * cy - by * cx) * e.side >= e.t1)
    return is_in & ((cx * ay - cy * ax) * e.side >= e.t2)


def in_block(a, b, c, centre_x, centre_y):
    """Slopes and value at the centre of a block, in float32, of a plane."""
    return (each.to(SINGLE) for each in (a, b, a * centre_x + b * centre_y + c))


def lanes_of(e, tile, samples):
    """Return the mask of the samples of a tile that a face covers, and their 1/z."""
    at = tile.to(LONG)
    centre = samples.centres.value(at * 2), samples.centres.value(at * 2 + 1)
    dx, dy = samples.x[at], samples.y[at]
    a3, b3, c3 = in_block(e.a3, e.b3, e.c3, *centre)
    w = a3 * dx + b3 * dy + c3
    is_in = may_be_in = (w > e.behind.to(SINGLE)) & (w <= e.cut.to(SINGLE))
    for *plane, doubt in (
        (e.a0, e.b0, e.c0, e.d0),
        (e.a1, e.b1, e.c1, e.d1),
        (e.a2, e.b2, e.c2, e.d2),
    ):
        a, b, c = in_block(*plane, *centre)
        value = a * dx + b * dy + c
        is_in = is_in & (value > doubt.to(SINGLE))
        may_be_in = may_be_in & (value >= -doubt.to(SINGLE))
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


@simd(returns=types.int64)
def cover(e, f, tile, samples, inverse, face):
    """Put a face on the samples of a tile where nothing is nearer; returns how many it covers."""
    at = tile.to(LONG)
    is_in, w = lanes_of(e, tile, samples)
    before = inverse[at]
    is_nearer = is_in & (w > before)
    inverse[at] = w.where(is_nearer, before)
    face[at] = f.to(WORD).broadcast(LANES).where(is_nearer, face[at])
    return is_in.bits().count_bits()


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
def clear(tile, inverse, face):
    """Empty a tile."""
    at = tile.to(LONG)
    inverse[at] = inverse[at].like(0.0)
    face[at] = face[at].like(-1)
