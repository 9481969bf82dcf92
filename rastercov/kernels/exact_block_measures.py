"""SIMD over the faces of a block and the entries of a cell: for `exact_block`, `exact_grid`."""

import functools
import math

from llvmlite import ir
from numba.core import types

from rastercov.kernels.exact_records import BLOCK, U_MIN, V_MIN, W_MIN, W
from rastercov.kernels.simd import (
    DOUBLE,
    LONG,
    WORD,
    Scalar,
    Vector,
    gather,
    joined,
    load,
    together,
)
from rastercov.kernels.simd_kernel import Variable, loop, simd

AT_A_TIME = 8
"""Faces that are measured at a time: doubles of the longest registers."""


@simd(returns=types.UniTuple(types.float64, 10))
def measure_block(first, faces, uvw, narrow, measures):
    """Areas and bounds of the `BLOCK` faces from `first` on.

    Parameters
    ----------
    faces, uvw : pointers
        To the data of `Projected.faces` and `Projected.uvw`.
    narrow : float
        A face is wide enough where twice its area is at least that times its extent, the sum of
        its width and height.
    measures : pointer
        Out: twice the signed area of each face, and after them their extents.

    Returns
    -------
    least_u, most_u, least_v, most_v : float
        Bounds of the corners.
    least, most : float
        Bounds of twice the signed areas.
    margin : float
        Least of twice the areas less `narrow` times the extent.
    widths, heights, areas : float
        Sums over the boxes of the faces.
    """

    def everywhere(number):
        lanes = ir.VectorType(DOUBLE, AT_A_TIME)
        return Variable(Vector(first.builder, ir.Constant(lanes, [number] * AT_A_TIME)))

    least = {name: everywhere(math.inf) for name in ("u", "v", "twice", "margin")}
    most = {name: everywhere(-math.inf) for name in ("u", "v", "twice")}
    sums = {name: everywhere(0.0) for name in ("width", "height", "area")}
    with loop(first, first + BLOCK, AT_A_TIME) as f:
        vertices = faces.at(f * 3)
        (u0, v0), (u1, v1), (u2, v2) = (_corners(vertices, s, uvw) for s in range(3))
        twice = (u1 - u0) * (v2 - v0) - (u2 - u0) * (v1 - v0)
        low_u, high_u = _all((u0, u1, u2), "minimum"), _all((u0, u1, u2), "maximum")
        low_v, high_v = _all((v0, v1, v2), "minimum"), _all((v0, v1, v2), "maximum")
        width, height = high_u - low_u, high_v - low_v
        extent = width + height
        twice.store(measures.at(f - first).pointer)
        extent.store(measures.at(f - first + BLOCK).pointer)
        margin = twice.absolute() - extent * narrow
        for name, value in (("u", low_u), ("v", low_v), ("twice", twice), ("margin", margin)):
            least[name].now = value.minimum(least[name].now)
        for name, value in (("u", high_u), ("v", high_v), ("twice", twice)):
            most[name].now = value.maximum(most[name].now)
        for name, value in (("width", width), ("height", height), ("area", width * height)):
            sums[name].now = sums[name].now + value
    least_u, least_v, least_twice, margin = (each.now.reduce("minimum") for each in least.values())
    most_u, most_v, most_twice = (each.now.reduce("maximum") for each in most.values())
    totals = (each.now.reduce("__add__") for each in sums.values())
    return least_u, most_u, least_v, most_v, least_twice, most_twice, margin, *totals


@simd(returns=types.void)
def lay_box(f, faces, uvw, box):
    """Fill in the box of a face; the arguments are pointers to the data of `Projected`."""
    corners = [faces.value(f * 3 + s).to(LONG) * 3 for s in range(3)]
    places = [load(f.builder, uvw.at(at).pointer, 2) for at in corners]
    inverse = [uvw.value(at + W) for at in corners]
    low, high = (_all(places, name) for name in ("minimum", "maximum"))
    of_inverse = together(_all(inverse, "minimum"), _all(inverse, "maximum"))
    both = joined(low, high)
    for column, bounds in ((U_MIN, both.every(2, 0)), (V_MIN, both.every(2, 1))):
        bounds.store(box.at(f * 6 + column).pointer)
    of_inverse.store(box.at(f * 6 + W_MIN).pointer)


@simd(returns=types.int64)
def faces_near(first, faces, uvw, left, top, per_u, per_v, columns, rows, is_near):
    """Bits of those of `AT_A_TIME` faces whose boxes may touch a cell that is asked for.

    `is_near` is a pointer to the data of `CellGrid.is_near`; for the others of the grid see there.
    """
    vertices = faces.at(first * 3)
    u, v = zip(*(_corners(vertices, s, uvw) for s in range(3)), strict=True)

    def cells(positions, origin, per_pixel, n):
        """As `exact_grid.cell`, of the least and the greatest position of each face."""
        bounds = (_all(positions, name) for name in ("minimum", "maximum"))
        at = (((bound - origin) * per_pixel).to(WORD) for bound in bounds)
        return (place.maximum(0).minimum(n - 1) for place in at)

    low, high = cells(u, left, per_u, columns)
    upper, lower = cells(v, top, per_v, rows)
    is_large = (high - low > 1) | (lower - upper > 1)
    found = gather(is_near.pointer, upper * columns + low)
    return ((found > 0) | is_large).bits()


def _all(values, operation):
    """Fold of some vectors, or scalars, by `minimum` or `maximum`."""
    return functools.reduce(lambda one, other: getattr(one, operation)(other), values)


def _corners(vertices, s, uvw):
    """Positions u and v of one corner of `AT_A_TIME` faces; each is loaded by one instruction."""
    pairs = joined(
        *(
            load(uvw.builder, uvw.at(vertices.value(3 * k + s).to(LONG) * 3).pointer, 2)
            for k in range(AT_A_TIME)
        )
    )
    return pairs.every(2, 0), pairs.every(2, 1)


@simd(returns=types.int64)
def entries_that_touch(
    bounds, stride, first, n, left, right, top, bottom, least_near, least_far, most_far
):
    """Bits of those of n, up to 64, entries of a cell that `exact_grid.find_faces` finds.

    `bounds` is a pointer to the data of `CellGrid.bounds`, of rows of `stride` values. Entries are
    compared `AT_A_TIME`; bits above the lowest n mean nothing.
    """
    none = Scalar(n.builder, LONG(0))
    bits = Variable(none)
    with loop(none, n, AT_A_TIME) as k:
        low_u, high_u, low_v, high_v, low_w, high_w = (
            load(n.builder, bounds.at(stride * row + first + k).pointer, AT_A_TIME)
            for row in range(6)
        )
        touches = (low_u <= right) & (high_u >= left) & (low_v <= bottom) & (high_v >= top)
        touches = touches & (high_w >= least_near) & (low_w >= least_far) & (low_w <= most_far)
        bits.now = bits.now | touches.bits() << k
    return bits.now
