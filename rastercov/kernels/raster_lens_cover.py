"""Samples of a tile that a face covers, and their depth: a vector of `LANES` samples.

In float32 from the middle of the block, where that is sure, else in float64.
"""

from numba.core import types

from rastercov.kernels.raster_lens_records import CHORD_X, CORNER, SLOTS
from rastercov.kernels.raster_lens_records import SIDE as SIDE_ROW
from rastercov.kernels.raster_memory import LANES, SIDE
from rastercov.kernels.raster_targets import TIE_REL
from rastercov.kernels.simd import DOUBLE, LONG, SINGLE, WORD, joined, load, together
from rastercov.kernels.simd_kernel import Variable, loop, simd, when

SMALLEST = 5e-324
"""Smallest positive number: e >= SMALLEST is e > 0."""


def least_sum(a, b, c):
    """Least value that is inside an edge: its line is inside for one of two faces alone."""
    owns = (a > 0.0) | (a.equals(0.0) & ((b > 0.0) | (b.equals(0.0) & (c > 0.0))))
    return a.like(0.0).where(owns, SMALLEST)


def is_inside_exactly(planes, slot, x, y):
    """Mask of the samples inside the face of a slot, for those next to an edge.

    (p x q).(x, y, 1) is the product of the vectors from the sample to p and to q. Each vector is
    rounded once for all edges at its corner, so their signs say on which side of the sample each
    edge passes without contradiction: no sample falls between faces at a corner, or in two.

    Where all three vectors point the same way, as from a sample beside a face that is as thin as
    rounding, so do not the signs of their products: such a sample is outside.
    """
    corners = [
        [planes.value(slot + (CORNER + 3 * k + axis) * SLOTS) for axis in range(3)]
        for k in range(3)
    ]
    side = planes.value(slot + SIDE_ROW * SLOTS)
    away = [(-(x * pz) + px, -(y * pz) + py) for px, py, pz in corners]
    is_in = None
    for k in range(3):
        (px, py, pz), (qx, qy, qz) = corners[k], corners[(k + 1) % 3]
        least = least_sum(
            side * (py * qz - pz * qy), side * (pz * qx - px * qz), side * (px * qy - py * qx)
        )
        (ax, ay), (bx, by) = away[k], away[(k + 1) % 3]
        is_within = (ax * by - ay * bx) * side >= least
        is_in = is_within if is_in is None else is_in & is_within
    for a, b, c in zip(*away, strict=True):
        is_in = is_in & (a.minimum(b).minimum(c) <= 0.0) & (a.maximum(b).maximum(c) >= 0.0)
    return is_in


def values_at(e, n, centre_x, centre_y):
    """Value of the last n planes of a face at the centre of a block, in float32; 1/z is the last.

    Each is computed in float64 and rounded once.
    """
    planes = range(4 - n, 4)
    a, b, c = (together(*(getattr(e, f"{x}{k}") for k in planes)) for x in "abc")
    values = (a * centre_x + b * centre_y + c).to(SINGLE)
    return [values.lane(k).broadcast(LANES) for k in range(n)]


def inverse_depth(e, dx, dy, value):
    """1/z at samples by their distance from the centre of a block."""
    return e.a3.to(SINGLE) * dx + e.b3.to(SINGLE) * dy + value


def limited(e, w):
    """1/z no further than the corners."""
    return w.maximum(e.least.to(SINGLE)).minimum(e.greatest.to(SINGLE))


def lanes_of(e, tile, samples, planes, is_cut):
    """Return the mask of the samples of a tile that a face covers, and their 1/z.

    `is_cut` is False for faces that are wholly beyond the near plane.
    """
    at = tile.to(LONG)
    centre = samples.centres.value(at * 2), samples.centres.value(at * 2 + 1)
    dx, dy = samples.x[at], samples.y[at]
    *edges, value = values_at(e, 4, *centre)
    w = inverse_depth(e, dx, dy, value)
    own = [
        a.to(SINGLE) * dx + b.to(SINGLE) * dy + c
        for a, b, c in zip((e.a0, e.a1, e.a2), (e.b0, e.b1, e.b2), edges, strict=True)
    ]
    # A sample without a place is NaN in all three.
    least = own[0].minimum(own[1]).minimum(own[2])
    is_in, may_be_in = least > 1.0, least >= -1.0
    if is_cut:
        is_beyond = (w > e.behind.to(SINGLE)) & (w <= e.cut.to(SINGLE))
        is_in, may_be_in = is_in & is_beyond, may_be_in & is_beyond
    found = Variable(is_in)
    with when((may_be_in & ~is_in).bits() > 0, likely=False):
        place = dx.to(DOUBLE) + centre[0], dy.to(DOUBLE) + centre[1]
        found.now = may_be_in & is_inside_exactly(planes, e.slot, *place)
    return found.now, limited(e, w)


def lanes_of_whole(e, tile, samples):
    """As `lanes_of`, of a face that is not cut, on a tile all of whose samples are inside it."""
    at = tile.to(LONG)
    centre = samples.centres.value(at * 2), samples.centres.value(at * 2 + 1)
    dx, dy = samples.x[at], samples.y[at]
    (value,) = values_at(e, 1, *centre)
    w = inverse_depth(e, dx, dy, value)
    return w.equals(w), limited(e, w)


@simd(returns=types.UniTuple(types.int64, 2))
def tiles_met(e, boxes, n_boxes, bound, first, n, nearest):
    """Bits of the tiles, of `LANES` from the first on, at most n, that a face may cover; in whole.

    A tile is left out that is on the outer side of an edge by more than the margin, which is more
    than float32 rounds, or of which all samples are nearer than `nearest`. Those that are on the
    inner side of all edges by as much are wholly covered, unless the face is cut.
    """
    is_met = n.to(WORD).broadcast(LANES) > list(range(LANES))
    is_met = is_met & (bound.at(first)[0] <= nearest.to(SINGLE))
    is_whole = is_met
    for a, b, c, limit in (
        (e.a0, e.b0, e.c0, e.limit0),
        (e.a1, e.b1, e.c1, e.limit1),
        (e.a2, e.b2, e.c2, e.limit2),
    ):
        # The furthest corner of a box along the edge, and the nearest: low or high x and y.
        x, y = (a > 0.0).to(LONG) & 1, (b > 0.0).to(LONG) & 1
        far_x, near_x = (boxes.at(first + n_boxes * k)[0] for k in (x, -(x - 1)))
        far_y, near_y = (boxes.at(first + n_boxes * (k + 2))[0] for k in (y, -(y - 1)))
        a, b, c = (number.to(SINGLE) for number in (a, b, c))
        is_met = is_met & (far_x * a + far_y * b + c >= -limit.to(SINGLE))
        is_whole = is_whole & (near_x * a + near_y * b + c > limit.to(SINGLE))
    can_be_whole = (e.cut.to(SINGLE) > 3e38).broadcast(LANES)
    return is_met.bits(), (is_whole & is_met & can_be_whole).bits()


@simd(returns=types.UniTuple(types.int64, 2))
def tiles_met_by_chords(chords, bound, columns, column, row, last_column, last_row, nearest):
    """As `tiles_met`, by the chords of a face: of the 4 x 4 tiles from a column and a row on."""
    x, y = [k % SIDE for k in range(LANES)], [k // SIDE for k in range(LANES)]
    first = row * columns + column
    bounds = [load(bound.builder, bound.at(first + columns * k).pointer, SIDE) for k in range(SIDE)]
    is_met = (last_column - column).to(WORD).broadcast(LANES) >= x
    is_met = is_met & ((last_row - row).to(WORD).broadcast(LANES) >= y)
    is_met = is_met & (joined(*bounds) <= nearest.to(SINGLE))
    is_whole = is_met
    for k in range(3):
        by_x, by_y, start = (getattr(chords, f"{name}{k}") for name in "abc")
        value = by_x.broadcast(LANES) * x + by_y.broadcast(LANES) * y
        value = value + (start + by_x * column + by_y * row)
        is_met, is_whole = is_met & (value >= -1.0), is_whole & (value > 1.0)
    return is_met.bits(), is_whole.bits()


@simd(returns=types.int64)
def append_tiles(bit_indices, bits, first, columns, tiles, n):
    """Append those of 4 x 4 tiles whose bits are set to a list of length n; its new length.

    See `append_set_bits`; `first` is the first tile, and a row has some `columns`.
    """
    half = LANES // 2
    for k in range(2):
        byte = bits >> k * half & 0xFF
        index = load(bits.builder, bit_indices.at(byte * half).pointer, half).zero_extended(WORD)
        row = (index > SIDE - 1).to(WORD)
        place = (index & (SIDE - 1)) + row * columns + (first + columns * (2 * k))
        place.store(tiles.at(n).pointer)
        n = n + byte.count_bits()
    return n


@simd(returns=types.void)
def request(tile, samples, inverse, face):
    """Request the cache lines of a tile that `cover` reads."""
    at = tile.to(LONG)
    samples.centres.prefetch(at * 2)
    for rows in (samples.x, samples.y, inverse, face):
        rows.prefetch(at * LANES, is_written=rows is inverse or rows is face)


def put_depth(is_in, w, f, tile, inverse, face, bound):
    """Put the depth of face f on those samples of a tile where nothing is nearer.

    Of equally near faces the first one is put there. Returns the bits of the samples that it
    covers, of those where it is put, and of those of them that have another face, until `put_face`.
    """
    at = tile.to(LONG)
    known = bound.value(at)
    before = inverse[at]
    before = before.where((known >= 0.0).broadcast(LANES), 0.0)
    bound.put(at, known.maximum(0.0))
    won = Variable(is_in & (w > before))
    ties = is_in & w.equals(before)
    with when(ties.bits() > 0, likely=False):
        won.now = won.now | (ties & (before > 0.0) & (face[at] > f.to(WORD)))
    is_won = won.now
    inverse[at] = w.where(is_won, before)
    return is_in.bits(), is_won.bits(), (is_won & (before > 0.0)).bits()


@simd(returns=types.UniTuple(types.int64, 3))
def cover(e, f, tile, samples, planes, inverse, face, bound):
    """Draw face f, which is not cut, on a tile; see `put_depth`."""
    is_in, w = lanes_of(e, tile, samples, planes, is_cut=False)
    return put_depth(is_in, w, f, tile, inverse, face, bound)


@simd(returns=types.UniTuple(types.int64, 3))
def cover_cut(e, f, tile, samples, planes, inverse, face, bound):
    """As `cover`, of a face that may reach before the near plane."""
    is_in, w = lanes_of(e, tile, samples, planes, is_cut=True)
    return put_depth(is_in, w, f, tile, inverse, face, bound)


@simd(returns=types.UniTuple(types.int64, 3))
def cover_whole(e, f, tile, samples, inverse, face, bound):
    """As `cover`, on a tile that the face covers as a whole."""
    is_in, w = lanes_of_whole(e, tile, samples)
    return put_depth(is_in, w, f, tile, inverse, face, bound)


@simd(returns=types.void)
def put_face(f, bits, tile, face):
    """Put a face on those samples of a tile whose bits are set."""
    at = tile.to(LONG)
    face[at] = f.to(WORD).broadcast(LANES).where(bits.as_mask(LANES), face[at])


@simd(returns=types.float32)
def bound_tile(tile, inverse, bound):
    """Bound the depth of a tile that something is drawn on by its samples: least 1/z, or 0."""
    at = tile.to(LONG)
    least = inverse[at].reduce("minimum")
    bound.put(at, least)
    return least


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
def count_covered(e, tile, samples, planes):
    """Samples of a tile that a face covers."""
    is_in, _ = lanes_of(e, tile, samples, planes, is_cut=True)
    return is_in.bits().count_bits()


@simd(returns=types.int64)
def count_seen(e, tile, samples, planes, inverse):
    """Samples of a tile that a target covers and that no surface hides."""
    is_in, w = lanes_of(e, tile, samples, planes, is_cut=True)
    before = inverse[tile.to(LONG)].to(DOUBLE)
    return (is_in & (w.to(DOUBLE) * (1.0 + TIE_REL) >= before)).bits().count_bits()


@simd(returns=types.int64)
def same_face(face, tile, f):
    """Bits of the samples of a tile that show a face."""
    return face[tile.to(LONG)].equals(f.to(WORD)).bits()


@simd(returns=types.UniTuple(types.float64, 12))
def planes_in(planes, slot):
    """The numbers a, b and c of the four planes of the face of a slot."""
    return tuple(planes.value(slot + row * SLOTS) for row in range(12))


@simd(returns=types.UniTuple(types.float32, 9))
def chords_in(bounds, slot):
    """The numbers a, b and c of the chords of the face of a slot."""
    return tuple(bounds.value(slot + (CHORD_X + row) * SLOTS) for row in range(9))


@simd(returns=types.UniTuple(types.float32, 7))
def bounds_in(bounds, slot):
    """Rows of `Setup.bounds` of the face of a slot."""
    return tuple(bounds.value(slot + row * SLOTS) for row in range(7))
