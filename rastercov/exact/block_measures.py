"""Areas and bounds of the faces of a block, eight at a time: a part of `block_kernels`."""

import math

from llvmlite import ir
from numba.core import types

from rastercov.exact.records import BLOCK
from rastercov.raster.cpu.simd import DOUBLE, LONG, Vector, joined, load
from rastercov.raster.cpu.simd_kernel import Variable, loop, simd

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
        low_u, high_u = u0.minimum(u1).minimum(u2), u0.maximum(u1).maximum(u2)
        low_v, high_v = v0.minimum(v1).minimum(v2), v0.maximum(v1).maximum(v2)
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


def _corners(vertices, s, uvw):
    """Positions u and v of one corner of `AT_A_TIME` faces; each is loaded by one instruction."""
    pairs = joined(
        *(
            load(uvw.builder, uvw.at(vertices.value(3 * k + s).to(LONG) * 3).pointer, 2)
            for k in range(AT_A_TIME)
        )
    )
    return pairs.every(2, 0), pairs.every(2, 1)
