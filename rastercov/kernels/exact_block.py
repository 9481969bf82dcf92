"""Set-up of faces, compiled by numba: the second pass over a pose, block by block.

In most blocks all faces are wholly inside the image, or wholly outside: `set_up_plain` measures
them together. `set_up` measures the others one by one. Boxes of plain blocks are made by
`lay_boxes` where they are needed, which is near event edges. The faces of a block, and the entries
of a cell of `exact_grid`, are measured by SIMD.
"""

import functools
import math

import numpy as np
from llvmlite import ir
from numba.core import types

from rastercov.kernels.exact_polygon import clip, twice_area
from rastercov.kernels.exact_records import (
    ABSENT,
    BLOCK,
    CLIPPED,
    CORNERS,
    DOUBTFUL,
    LIVE,
    MIXED,
    OUTLINE_ERROR,
    PARTLY,
    SIDES,
    SUM_OF_AREAS,
    SUM_OF_HEIGHTS,
    SUM_OF_WIDTHS,
    THIN,
    U_MAX,
    U_MIN,
    UNEVEN,
    V_MAX,
    V_MIN,
    W_MAX,
    W_MIN,
    U,
    V,
    W,
)
from rastercov.kernels.exact_setup import (
    EDGE_ON_FACTOR,
    OUTLINE_ERROR_FACTOR,
    bounds_of_clipped,
    clip_in_space,
    side_if_out_of_sight,
    store_clipped,
    to_camera,
)
from rastercov.kernels.jit import allocation_free, compiled, part_with_arrays
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
from rastercov.kernels.simd_kernel import Variable, loop, pointer, simd

AT_A_TIME = 8
"""Faces that are measured at a time: doubles of the longest registers."""
NARROW_FACTOR = 2.0**25
"""A face that has less than this many pixels of twice its area for each pixel of extent and of
rounding is measured by itself: more than three times `certificate.THIN_TOLERANCE_REL`."""


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


@part_with_arrays
def lay_boxes_of_some(first, stop, projected):
    """Fill in the boxes of the faces `first` ... `stop` - 1; none is clipped."""
    faces, uvw, box = pointer(projected.faces), pointer(projected.uvw), pointer(projected.box)
    for f in range(first, stop):
        lay_box(f, faces, uvw, box)


@part_with_arrays
def lay_boxes_of_block(b, projected):
    """Fill in the boxes of the faces of a block, the first time. None of them is clipped."""
    if not projected.has_boxes[b]:
        projected.has_boxes[b] = True
        n_faces = projected.blocks.patch.shape[0]
        lay_boxes_of_some(b * BLOCK, min((b + 1) * BLOCK, n_faces), projected)


@allocation_free
def lay_boxes(faces, projected):
    """Fill in the boxes of some faces, and of the others of their blocks."""
    for index in range(faces.shape[0]):
        lay_boxes_of_block(faces[index] // BLOCK, projected)


@part_with_arrays
def describe_block(b, flags, projected):
    """Fill in `block_state` and `block_side` from the faces of a block, with some flags more."""
    state, side = projected.state, projected.side
    first, last = b * BLOCK, min((b + 1) * BLOCK, projected.blocks.patch.shape[0])
    common = side[first]
    for f in range(first, last):
        flags |= state[f]
        if not state[f] & LIVE:
            flags |= ABSENT
        if side[f] != common:
            common = MIXED
    projected.block_state[b] = flags
    projected.block_side[b] = MIXED if flags & DOUBTFUL else common


@part_with_arrays
def least_w_of_block(b, projected):
    """Least 1/z of the corners of a block: 0 where one of them has no image."""
    faces, uvw = projected.faces, projected.uvw
    least = np.inf
    for f in range(b * BLOCK, (b + 1) * BLOCK):
        least = min(least, uvw[faces[f, 0], W], uvw[faces[f, 1], W], uvw[faces[f, 2], W])
    return least


@allocation_free
def set_up_plain(camera, front_only, n_out, projected, area_error, extent, measures, rest):
    """Measure the faces of blocks that lie wholly inside or wholly outside the image.

    Parameters
    ----------
    n_out : int
        Of `project`: vertices without an image.
    front_only, projected, area_error, extent
        As for `set_up`, with what follows from these blocks.
    measures : (2 BLOCK,) float64
        Scratch: twice the areas of the faces of a block, and their extents.
    rest : (N,) int32
        Out: the other blocks, which `set_up` is for.

    Returns
    -------
    n_live, n_rest : int
        Live faces; other blocks.
    """
    side, state, area = projected.side, projected.state, projected.area
    blocks = projected.blocks
    width, height, pixel_error = camera.width, camera.height, camera.pixel_error
    extent[:] = 0.0
    extent[U_MIN] = extent[V_MIN] = np.inf
    extent[U_MAX] = extent[V_MAX] = -np.inf
    n_live = n_rest = 0
    faces_at, uvw_at = pointer(projected.faces), pointer(projected.uvw)
    narrow, most_error = NARROW_FACTOR * pixel_error, 2 * width * height
    for b in range(blocks.has_flat.shape[0]):
        first, last = b * BLOCK, min((b + 1) * BLOCK, blocks.patch.shape[0])
        is_plain = last - first == BLOCK and not blocks.has_flat[b]
        if is_plain:
            (
                low_u, high_u, low_v, high_v, least, most, margin, its_widths, its_heights,
                its_areas,
            ) = measure_block(first, faces_at, uvw_at, narrow, pointer(measures))  # fmt: skip
            is_out = high_u <= -pixel_error or low_u >= width + pixel_error
            is_out = is_out or high_v <= -pixel_error or low_v >= height + pixel_error
            is_in = low_u >= 0 and low_v >= 0 and high_u <= width and high_v <= height
            is_plain = (is_in or is_out) and margin > 0
            is_plain = is_plain and (n_out == 0 or least_w_of_block(b, projected) > 0)
        if not is_plain:
            rest[n_rest] = b
            n_rest += 1
            continue
        is_mixed, is_culled = least < 0 < most, front_only and least > 0
        is_live = not (is_out or is_culled)
        behind = 0 if front_only else -1
        common = 1 if least < 0 else behind
        flags, some = np.uint16(LIVE if is_live else 0), 0.0 if is_out else 0.5
        side[first:last], state[first:last] = common, flags
        its_area, its_error = area[first:last], area_error[first:last]
        its_error[:] = 0.0
        for lane in range(BLOCK):
            its_area[lane] = abs(measures[lane]) * some
        if is_mixed:
            for lane in range(BLOCK):
                side[first + lane] = 1 if measures[lane] < 0 else behind
        if front_only and most > 0 and not is_out:
            for lane in range(BLOCK):
                error = OUTLINE_ERROR_FACTOR * measures[BLOCK + lane] * pixel_error
                its_error[lane] = min(error, most_error) if measures[lane] > 0 else 0.0
                state[first + lane] = LIVE if measures[lane] < 0 else 0
        has_all = is_live and not (is_mixed and front_only)
        projected.block_state[b] = flags if has_all else flags | np.uint16(ABSENT)
        projected.block_side[b] = MIXED if is_mixed else common
        projected.has_boxes[b] = False
        projected.block_box[b, U_MIN] = projected.block_box[b, V_MIN] = np.inf
        projected.block_box[b, U_MAX] = projected.block_box[b, V_MAX] = -np.inf
        if is_live:
            projected.block_box[b, U_MIN], projected.block_box[b, U_MAX] = low_u, high_u
            projected.block_box[b, V_MIN], projected.block_box[b, V_MAX] = low_v, high_v
            extent[U_MIN], extent[U_MAX] = min(extent[U_MIN], low_u), max(extent[U_MAX], high_u)
            extent[V_MIN], extent[V_MAX] = min(extent[V_MIN], low_v), max(extent[V_MAX], high_v)
            n_live += BLOCK
            extent[SUM_OF_WIDTHS] += its_widths
            extent[SUM_OF_HEIGHTS] += its_heights
            extent[SUM_OF_AREAS] += its_areas
    return n_live, n_rest


@compiled
def set_up(vertices, is_flat, rest, camera, front_only, projected, area_error, extent):
    """Measure the faces of some blocks; returns how many are live, and how many clipped.

    If more are clipped than `projected.clipped` has room for, nothing is added to `extent`: call
    again with more room.

    Parameters
    ----------
    vertices : (V, 3) float64
    is_flat : (F,) bool
        Faces without area, which neither hide anything nor are visible.
    rest : (N,) int32
        Blocks that `set_up_plain` left.
    front_only : bool
        Leave out faces that are certainly seen from behind: they hide nothing.
    projected : Projected
        In: `faces`, `uvw` and `blocks`. Out: all others; `area` also of faces that are left out.
    area_error : (F,) float64
        Out: bound of the error of the area of faces that are left out, px^2, also where only
        rounding leaves them out; 0 for all others.
    extent : (7,) float64
        In and out: bounds of u and v of all live faces, within the image; and the sums of the
        widths, the heights and the areas of their boxes within it.
    """
    faces, uvw, side, state = projected.faces, projected.uvw, projected.side, projected.state
    box, area, clipped = projected.box, projected.area, projected.clipped
    block_box, n_faces = projected.block_box, projected.blocks.patch.shape[0]
    clipped_index = projected.clipped_index
    width, height, pixel_error = camera.width, camera.height, camera.pixel_error
    corners, low, normals = np.empty((3, 3)), np.empty((3, 3)), np.empty((5, 3))
    errors, polygon, spare = np.empty(5), np.empty((CORNERS, 2)), np.empty((CORNERS, 2))
    lines, plane, border = np.empty((SIDES, 6)), np.empty(7), camera.border
    n_live = n_clipped = 0
    low_u, high_u, low_v, high_v = extent[U_MIN], extent[U_MAX], extent[V_MIN], extent[V_MAX]
    widths = heights = areas = 0.0
    for index in range(rest.shape[0]):
        b = rest[index]
        projected.has_boxes[b] = True
        block_box[b, U_MIN] = block_box[b, V_MIN] = np.inf
        block_box[b, U_MAX] = block_box[b, V_MAX] = -np.inf
        for f in range(b * BLOCK, min((b + 1) * BLOCK, n_faces)):
            state[f] = 0
            side[f] = 0
            area[f] = area_error[f] = 0.0
            i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
            u0, v0, w0 = uvw[i, U], uvw[i, V], uvw[i, W]
            u1, v1, w1 = uvw[j, U], uvw[j, V], uvw[j, W]
            u2, v2, w2 = uvw[k, U], uvw[k, V], uvw[k, W]
            if w0 > 0 and w1 > 0 and w2 > 0:
                twice = (u1 - u0) * (v2 - v0) - (u2 - u0) * (v1 - v0)
                u_min, u_max = min(u0, u1, u2), max(u0, u1, u2)
                v_min, v_max = min(v0, v1, v2), max(v0, v1, v2)
                is_out = u_max <= 0 or v_max <= 0 or u_min >= width or v_min >= height
                if (is_out or is_flat[f]) and not (
                    u_max <= -pixel_error
                    or v_max <= -pixel_error
                    or u_min >= width + pixel_error
                    or v_min >= height + pixel_error
                ):
                    # Rounding may have moved it out of the image, or made it flat.
                    inner = (
                        min(u_max, width) - max(u_min, 0.0) + min(v_max, height) - max(v_min, 0.0)
                    )
                    area_error[f] = 4 * EDGE_ON_FACTOR * (inner + 2 * pixel_error) * pixel_error
                if is_flat[f]:
                    continue
                is_doubtful = abs(twice) <= EDGE_ON_FACTOR * pixel_error * (
                    u_max - u_min + v_max - v_min
                )
                is_culled = front_only and twice > 0 and not is_doubtful
                if not is_culled:
                    side[f] = 1 if twice < 0 else -1 if twice > 0 else 0
                if is_out:
                    continue
                w_min, w_max = min(w0, w1, w2), max(w0, w1, w2)
                inside, outline_error = abs(twice) / 2, pixel_error
                flags = LIVE | DOUBTFUL if is_doubtful else LIVE
                if inside > 0 and (u_min < 0 or v_min < 0 or u_max > width or v_max > height):
                    flags |= PARTLY
                    polygon[0, U], polygon[0, V] = u0, v0
                    polygon[1, U], polygon[1, V] = u1, v1
                    polygon[2, U], polygon[2, V] = u2, v2
                    n = clip(polygon, np.int64(3), border, border.shape[0], spare)
                    inside = abs(twice_area(polygon, n)) / 2 if n >= 3 else 0.0
            else:
                n, front = 0, side_if_out_of_sight(vertices, i, j, k, camera)
                if is_flat[f]:
                    if front == 0:
                        area_error[f] = 4 * EDGE_ON_FACTOR * (width + height) * pixel_error
                    continue
                if front == 0:
                    to_camera(vertices[i], camera, corners[0], low[0])
                    to_camera(vertices[j], camera, corners[1], low[1])
                    to_camera(vertices[k], camera, corners[2], low[2])
                    n, front = clip_in_space(
                        corners, low, camera, normals, errors, lines, plane, polygon, spare
                    )
                if front == 0:
                    # The camera centre is on its plane to 2^-98: nothing of it is wide enough
                    # to count.
                    state[f] = DOUBTFUL
                    area_error[f] = 4 * EDGE_ON_FACTOR * (width + height) * pixel_error
                    continue
                is_culled = front_only and front < 0
                if not is_culled:
                    side[f] = front
                if n == 0:
                    continue
                u_min, u_max, v_min, v_max, w_min, w_max = bounds_of_clipped(polygon, abs(n), plane)
                inside = max(twice_area(polygon, n) / 2, 0.0) if n >= 3 else 0.0
                outline_error = max(pixel_error, plane[OUTLINE_ERROR])
                flags = LIVE | CLIPPED | PARTLY
                if not is_culled:
                    if n_clipped < clipped.polygons.shape[0]:
                        clipped_index[f] = n_clipped
                        store_clipped(clipped, n_clipped, polygon, n, lines, plane)
                    n_clipped += 1
            if is_culled:
                area[f] = inside
                around = max(u_max - u_min + v_max - v_min, 2 * outline_error)
                error = OUTLINE_ERROR_FACTOR * around * outline_error
                area_error[f] = min(error, 2 * width * height)
                continue
            box[f, U_MIN], box[f, U_MAX], box[f, V_MIN], box[f, V_MAX] = u_min, u_max, v_min, v_max
            box[f, W_MIN], box[f, W_MAX] = w_min, w_max
            block_box[b, U_MIN] = min(block_box[b, U_MIN], u_min)
            block_box[b, U_MAX] = max(block_box[b, U_MAX], u_max)
            block_box[b, V_MIN] = min(block_box[b, V_MIN], v_min)
            block_box[b, V_MAX] = max(block_box[b, V_MAX], v_max)
            if not inside > 0:
                state[f] = THIN | DOUBTFUL | flags & CLIPPED
                continue
            state[f] = flags
            area[f] = inside
            n_live += 1
            u_min, u_max = max(u_min, 0.0), min(u_max, width)
            v_min, v_max = max(v_min, 0.0), min(v_max, height)
            widths += u_max - u_min
            heights += v_max - v_min
            areas += (u_max - u_min) * (v_max - v_min)
            low_u, high_u = min(low_u, u_min), max(high_u, u_max)
            low_v, high_v = min(low_v, v_min), max(high_v, v_max)
        describe_block(b, UNEVEN, projected)
    if n_clipped <= clipped.polygons.shape[0]:
        extent[U_MIN], extent[U_MAX], extent[V_MIN], extent[V_MAX] = low_u, high_u, low_v, high_v
        extent[SUM_OF_WIDTHS] += widths
        extent[SUM_OF_HEIGHTS] += heights
        extent[SUM_OF_AREAS] += areas
    return n_live, n_clipped
