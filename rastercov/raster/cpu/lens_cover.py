"""Samples of a block that a face covers, and their depth: `LANES` samples at a time.

In float32 from the middle of the block, where that is sure, else in float64.
"""

from numba.core import types

from rastercov.raster.cpu.lens_records import SAMPLES
from rastercov.raster.cpu.memory import LANES
from rastercov.raster.cpu.simd import DOUBLE, LONG, SINGLE, WORD, pack
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


def lanes_of(e, centre, x, y):
    """Return the masks of the samples of a block that a face covers, and their 1/z, by rows.

    A generator over rows of `LANES` samples.
    """
    edges = [
        [*in_block(*plane, *centre), doubt.to(SINGLE)]
        for *plane, doubt in (
            (e.a0, e.b0, e.c0, e.d0),
            (e.a1, e.b1, e.c1, e.d1),
            (e.a2, e.b2, e.c2, e.d2),
        )
    ]
    a3, b3, c3 = in_block(e.a3, e.b3, e.c3, *centre)
    behind, cut = e.behind.to(SINGLE), e.cut.to(SINGLE)
    for k in range(SAMPLES // LANES):
        dx, dy = x[k], y[k]
        w = a3 * dx + b3 * dy + c3
        is_in = may_be_in = (w > behind) & (w <= cut)
        for a, b, c, doubt in edges:
            value = a * dx + b * dy + c
            is_in, may_be_in = is_in & (value > doubt), may_be_in & (value >= -doubt)
        found = Variable(is_in)
        with when((may_be_in & ~is_in).bits() > 0, likely=False):
            place = dx.to(DOUBLE) + centre[0], dy.to(DOUBLE) + centre[1]
            found.now = may_be_in & is_inside_exactly(e, *place)
        yield k, found.now, w.maximum(e.least.to(SINGLE)).minimum(e.greatest.to(SINGLE))


def rows_of(block, *arrays):
    """Rows of `LANES` samples of a block in each of some arrays."""
    start = block.to(LONG) * SAMPLES
    return [array.at(start) for array in arrays]


def centre_of(block, centres):
    """Centre of a block."""
    at = block.to(LONG) * 2
    return centres.value(at), centres.value(at + 1)


@simd(returns=types.int64)
def cover(e, f, block, samples, inverse, face):
    """Put a face on the samples of a block where nothing is nearer; returns how many it covers."""
    x, y, inverse, face = rows_of(block, samples.x, samples.y, inverse, face)
    masks = []
    for k, is_in, w in lanes_of(e, centre_of(block, samples.centres), x, y):
        before = inverse[k]
        is_nearer = is_in & (w > before)
        with when(is_nearer.bits() > 0):
            inverse[k] = w.where(is_nearer, before)
            face[k] = f.to(WORD).broadcast(LANES).where(is_nearer, face[k])
        masks.append(is_in)
    return pack(*masks).count_bits()


@simd(returns=types.int64)
def count_covered(e, block, samples):
    """Samples of a block that a face covers."""
    x, y = rows_of(block, samples.x, samples.y)
    found = lanes_of(e, centre_of(block, samples.centres), x, y)
    return pack(*(is_in for _, is_in, _ in found)).count_bits()


@simd(returns=types.int64)
def count_seen(e, block, samples, inverse):
    """Samples of a block that a target covers and that no surface hides."""
    x, y, inverse = rows_of(block, samples.x, samples.y, inverse)
    masks = []
    for k, is_in, w in lanes_of(e, centre_of(block, samples.centres), x, y):
        masks.append(is_in & (w.to(DOUBLE) * (1.0 + TIE_REL) >= inverse[k].to(DOUBLE)))
    return pack(*masks).count_bits()
