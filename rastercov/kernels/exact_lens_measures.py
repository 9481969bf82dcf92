"""SIMD over the vertices and the faces of a surface in a plane of a lens: for `exact_lens`."""

import math

from llvmlite import ir
from numba.core import types

from rastercov.kernels.exact_records import THIN, U, V, W
from rastercov.kernels.lens_lanes import U as IMAGE_U
from rastercov.kernels.lens_lanes import V as IMAGE_V
from rastercov.kernels.lens_lanes import X, Y
from rastercov.kernels.simd import LONG, Scalar, gather, joined, load
from rastercov.kernels.simd_kernel import Variable, loop, simd

AT_A_TIME = 8
"""Vertices or faces: doubles of the longest registers."""
BYTE = ir.IntType(8)


@simd(returns=types.int64)
def place_vertices(first, uvw, pinhole, window, n_sides, radius2, places, is_inside, at, x, y):
    """Fill in x and y of the places of `AT_A_TIME` vertices, and whether they are in the window.

    Parameters
    ----------
    uvw, window, places, is_inside : pointers
        To the data of the arrays of `lens_edges.vertex_images`.
    n_sides : int
        Sides of the window that they are compared with.
    radius2 : float
        Square of the radius of a disc that they must be in.
    at : int
    x, y : pointers
        Out, from `at` on: x and y of those in the window, 0 for the others.

    Returns
    -------
    int
        Not 0 if any is in the window.
    """
    to_x, to_y = x, y
    image = load(first.builder, uvw.at(first * 3).pointer, 3 * AT_A_TIME)
    u, v, w = (image.every(3, column) for column in (U, V, W))
    x, y = (u - pinhole.cx) / pinhole.fx, (v - pinhole.cy) / pinhole.fy
    least = Variable(x.like(math.inf))
    with loop(Scalar(first.builder, LONG(0)), n_sides, 1) as s:
        t = (s + 1).where(s + 1 < n_sides, 0)
        x0, y0 = window.value(s * 2), window.value(s * 2 + 1)
        dx, dy = window.value(t * 2) - x0, window.value(t * 2 + 1) - y0
        inner = dx * (y - y0) - dy * (x - x0)
        least.now = inner.minimum(least.now)
    is_in = (w > 0) & (least.now >= 0) & (x * x + y * y <= radius2)
    is_in.to(BYTE).store(is_inside.at(first).pointer)
    both = joined(x, y)
    for k in range(AT_A_TIME):
        both.every(AT_A_TIME, k).store(places.at((first + k) * 4 + X).pointer)
    x.where(is_in, 0.0).store(to_x.at(at).pointer)
    y.where(is_in, 0.0).store(to_y.at(at).pointer)
    return is_in.bits()


@simd(returns=types.void)
def put_images(first, at, u, v, is_inside, places):
    """Complete the places of `AT_A_TIME` vertices by their images; NaN outside the window."""
    builder = first.builder
    is_in = load(builder, is_inside.at(first).pointer, AT_A_TIME) > 0
    images = [
        load(builder, image.at(at).pointer, AT_A_TIME).where(is_in, math.nan) for image in (u, v)
    ]
    both = joined(*images)
    for k in range(AT_A_TIME):
        both.every(AT_A_TIME, k).store(places.at((first + k) * 4 + IMAGE_U).pointer)


@simd(returns=types.void)
def measure_faces(
    first, faces, sides, is_flat, state, places, bulge, plane, rounding, own, is_done, area, error
):
    """Measure `AT_A_TIME` faces as `exact_lens.measure_simple` does each.

    Arrays are pointers to the data of its arguments; the results are the same bits.
    """
    builder = first.builder
    corners = [columns_at(faces.at(first * 3), 3, s, places) for s in range(3)]
    (x0, y0, u0, v0), (x1, y1, u1, v1), (x2, y2, u2, v2) = corners
    total = u0.like(0.0)
    for p in range(3):
        at = load(builder, sides.at(first * 3).pointer, 3 * AT_A_TIME).every(3, p)
        is_backwards = at < 0
        value = gather(bulge.pointer, (at.like(-1) - at).where(is_backwards, at))
        total = total + (value.like(0.0) - value).where(is_backwards, value)
    lengths2 = [
        (bx - ax) * (bx - ax) + (by - ay) * (by - ay)
        for ax, ay, bx, by in ((x0, y0, x1, y1), (x1, y1, x2, y2), (x2, y2, x0, y0))
    ]
    longest2 = lengths2[0].maximum(lengths2[1]).maximum(lengths2[2])
    low_u, high_u = u0.minimum(u1).minimum(u2), u0.maximum(u1).maximum(u2)
    low_v, high_v = v0.minimum(v1).minimum(v2), v0.maximum(v1).maximum(v2)
    stray = longest2 * plane.bend / 8
    is_out = (high_u < -stray) | (high_v < -stray)
    is_out = is_out | (low_u > stray + plane.width) | (low_v > stray + plane.height)
    is_in = (low_u > stray) & (low_v > stray)
    is_in = is_in & (high_u < -stray + plane.width) & (high_v < -stray + plane.height)
    total = total + ((u1 - u0) * (v2 - v0) - (u2 - u0) * (v1 - v0)) * 0.5
    # NaN for a vertex outside the window, or an edge without a bulge
    corner = u0 + u1 + u2
    left_out = load(builder, is_flat.at(first).pointer, AT_A_TIME) > 0
    left_out = left_out | ((load(builder, state.at(first).pointer, AT_A_TIME) & THIN) > 0)
    is_seen = corner.equals(corner) & ~left_out
    is_measured = is_seen & is_in & ~is_out & total.equals(total)
    (left_out | (is_seen & is_out) | is_measured).to(BYTE).store(is_done.at(first).pointer)
    twice = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    found = total.where(twice > 0, total.like(0.0) - total).where(is_measured, 0.0)
    found.store(own.at(first).pointer)
    (load(builder, area.at(first).pointer, AT_A_TIME) + found).store(area.at(first).pointer)
    # No side is longer than the box, and a bulge, is wide and high.
    around = ((high_u - low_u) + (high_v - low_v)) * 2.0 + stray * 6.0
    parts = longest2.sqrt() * 0.5 / plane.part
    parts = (parts.like(0.0) - (parts.like(0.0) - parts).floor()).where(longest2 > plane.one, 1.0)
    bound = (parts * 3.0 * plane.tolerance + around * rounding).where(is_measured, 0.0)
    (load(builder, error.at(first).pointer, AT_A_TIME) + bound).store(error.at(first).pointer)


def columns_at(rows, step, s, places):
    """Columns of the places of vertex s of `AT_A_TIME` rows of `step`, each a single load."""
    found = joined(
        *(
            load(places.builder, places.at(rows.value(step * k + s).to(LONG) * 4).pointer, 4)
            for k in range(AT_A_TIME)
        )
    )
    return tuple(found.every(4, column) for column in (X, Y, IMAGE_U, IMAGE_V))
