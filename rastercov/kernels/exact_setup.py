"""Projection of vertices and set-up of faces, the first two passes over a pose, compiled by numba.

`project` is the first, and the second goes block by block. In most blocks all faces are wholly
inside the image, or wholly outside: `set_up_plain` measures them together. `set_up` measures the
others one by one; faces that reach behind the camera or far out of the image are clipped in space
before they are projected. Boxes of plain blocks are made by `lay_boxes` where they are needed,
which is near event edges. The faces of a block, and the entries of a cell of `exact_grid`, are
measured by SIMD.

Where the camera centre lies on a face to the last digit, doubles do not determine the plane of the
face through it; pairs of doubles do, with about 106 bits. A pair (high, low) is the number
high + low, where high is that sum rounded.

T. J. Dekker. A Floating-Point Technique for Extending the Available Precision. 1971.
M. Joldes, J.-M. Muller, V. Popescu. Tight and Rigorous Error Bounds for Basic Building Blocks of
Double-Word Arithmetic. 2017: the relative error of a sum is below 3 * 2^-106 of the greater term,
that of a product below 5 * 2^-106.

The patches of blocks depend on no camera. As other parts that are joined, they are disjoint sets in
a forest: each set is a tree whose root names it.

R. E. Tarjan. Efficiency of a Good But Not Linear Set Union Algorithm. 1975.
"""

import functools
import math

import numpy as np
from llvmlite import ir
from numba.core import types

from rastercov.kernels.exact_polygon import clip, copy_polygon, extent_of, length, twice_area
from rastercov.kernels.exact_records import (
    ABSENT,
    BLOCK,
    CLIPPED,
    CONSISTENT,
    CORNERS,
    DOUBTFUL,
    DU,
    DV,
    LINE_ERROR,
    LIVE,
    MIXED,
    OFFSET,
    OUTLINE_ERROR,
    PARTLY,
    SIDES,
    SLOPE_U,
    SLOPE_V,
    SUM_OF_AREAS,
    SUM_OF_HEIGHTS,
    SUM_OF_WIDTHS,
    THIN,
    U_MAX,
    U_MIN,
    UNEVEN,
    V_MAX,
    V_MIN,
    W_ERROR,
    W_MAX,
    W_MIN,
    U,
    V,
    W,
)
from rastercov.kernels.jit import allocation_free, compiled, part_of, part_with_arrays
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


@part_with_arrays
def root_of(parent, i):
    """Root of the tree of i; the path to it is halved on the way."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@part_with_arrays
def join(f, g, parent):
    """Join the trees of two nodes."""
    f, g = root_of(parent, f), root_of(parent, g)
    parent[max(f, g)] = min(f, g)


@compiled
def find_patches(edges, lowest):
    """Fill `lowest`, (F,), with the lowest face of the patch of each face.

    A patch is a part of a block whose faces are joined by edges that two of them use consistently.
    """
    for f in range(lowest.shape[0]):
        lowest[f] = f
    for e in range(edges.kind.shape[0]):
        f, g = edges.faces[e, 0], edges.faces[e, 1]
        if g >= 0 and edges.kind[e] == CONSISTENT and f // BLOCK == g // BLOCK:
            join(f, g, lowest)
    for f in range(lowest.shape[0]):
        lowest[f] = root_of(lowest, f)


SPLITTER = 2.0**27 + 1
UNIT_ROUNDING = 4 * 2.0**-52
"""Largest rounding of a position in the image, relative to the largest number it is computed from;
of 1/z, relative to the longest ray: some ten operations of 2^-53 each, of which not all err one
way."""
OUTLINE_ERROR_FACTOR = 8
"""Pixels of extent that may be wrong along the outline of a face, for each pixel of rounding and of
width and height: its perimeter is twice their sum at most. One part for its own image, one for its
visible part, one for corners that count as on a line, one for remainders that count as nothing."""
CLIP_MARGIN = 0.25
"""Relative to the size of the image: faces that reach farther out than this and a pixel are clipped
in space before they are projected."""
PAIR_ERROR_REL = 2.0**-98
"""Relative error bound of the products of three vectors in pairs of doubles: 3 camera coordinates
of 12 * 2^-106 each, and 8 operations of 5 * 2^-106."""
UNDERFLOW = 2.0**-1000
"""Greater than what products of numbers up to 2 lose to underflow."""
EDGE_ON_FACTOR = 4
"""A face is doubtful if its image has less than this many pixels of area for each pixel of extent
and of rounding: (u1 - u0)(v2 - v0) - (u2 - u0)(v1 - v0) is twice the area, each difference is off
by 2 roundings, and each side of the image is at most its extent."""
W_ARITHMETIC_ERROR_REL = 1e-14
"""Relative error of 1/z evaluated at the corner of a clipped face."""


@part_of
def exact_sum(a, b):
    """Pair equal to the sum of two doubles (Knuth's TwoSum)."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


@part_of
def exact_product(a, b):
    """Pair equal to the product of two doubles below 2^500 (Dekker), except for underflow."""
    product = a * b
    scaled = SPLITTER * a
    a_high = scaled - (scaled - a)
    a_low = a - a_high
    scaled = SPLITTER * b
    b_high = scaled - (scaled - b)
    b_low = b - b_high
    rest = ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low
    return product, rest


@part_of
def add(a_high, a_low, b_high, b_low):
    """Sum of two pairs."""
    high, low = exact_sum(a_high, b_high)
    more, less = exact_sum(a_low, b_low)
    low += more
    total = high + low
    low += high - total
    low += less
    return exact_sum(total, low)


@part_of
def multiply(a_high, a_low, b_high, b_low):
    """Product of two pairs."""
    high, low = exact_product(a_high, b_high)
    low += a_high * b_low + a_low * b_high
    return exact_sum(high, low)


@part_of
def minor(a_high, a_low, d_high, d_low, b_high, b_low, c_high, c_low):
    """2 x 2 determinant a d - b c of pairs; exchanging its rows negates it to the bit."""
    first, first_low = multiply(a_high, a_low, d_high, d_low)
    second, second_low = multiply(b_high, b_low, c_high, c_low)
    return add(first, first_low, -second, -second_low)


@allocation_free
def project(vertices, camera, uvw):
    """Project (V, 3) world points to (V, 3) `uvw`, pixels and 1/z.

    w is 0 for a vertex before the near plane or beyond `camera.u_min` ... `camera.v_max`; returns
    the number of these.
    """
    rotation, eye, n_out = camera.rotation, camera.centre, 0
    for i in range(vertices.shape[0]):
        a = vertices[i, 0] - eye[0]
        b = vertices[i, 1] - eye[1]
        c = vertices[i, 2] - eye[2]
        z = a * rotation[0, 2] + b * rotation[1, 2] + c * rotation[2, 2]
        w = 1.0 / z if z >= camera.near else 0.0
        right = a * rotation[0, 0] + b * rotation[1, 0] + c * rotation[2, 0]
        down = a * rotation[0, 1] + b * rotation[1, 1] + c * rotation[2, 1]
        u = camera.fx * (right * w) + camera.cx
        v = camera.fy * (down * w) + camera.cy
        if not (camera.u_min <= u <= camera.u_max and camera.v_min <= v <= camera.v_max):
            w = 0.0
        n_out += w == 0
        uvw[i, U] = u
        uvw[i, V] = v
        uvw[i, W] = w
    return n_out


@allocation_free
def to_camera(point, camera, high, low):
    """Transform a world point to camera axes, in pairs of doubles: `high` + `low`, (3,) each."""
    rotation, eye = camera.rotation, camera.centre
    a, a_low = exact_sum(point[0], -eye[0])
    b, b_low = exact_sum(point[1], -eye[1])
    c, c_low = exact_sum(point[2], -eye[2])
    for k in range(3):
        x, x_low = multiply(a, a_low, rotation[0, k], 0.0)
        y, y_low = multiply(b, b_low, rotation[1, k], 0.0)
        z, z_low = multiply(c, c_low, rotation[2, k], 0.0)
        x, x_low = add(x, x_low, y, y_low)
        high[k], low[k] = add(x, x_low, z, z_low)


@allocation_free
def normals_of_sides(high, low, underflow, normals, errors):
    """Normals of a face and of the planes through its edges and the camera centre; returns d.

    For corners in camera axes, in pairs of doubles `high` and `low`, with what underflow may have
    taken from them. Out: `normals`, p x q for each edge p q, and the normal n of the face as a
    pair, in two rows; `errors`, the largest of the four, as vectors, and of d.

    d is n . X of the face. (p x q) . ray has its sign for a ray on the inner side of edge p q.
    """
    d = d_low = 0.0
    normals[3:] = 0.0
    for s in range(3):
        p, q = s, s + 1 if s < 2 else 0
        for k in range(3):
            i, j = k + 1 if k < 2 else 0, k - 1 if k > 0 else 2
            x, x_low = minor(
                high[p, i], low[p, i], high[q, j], low[q, j],
                high[p, j], low[p, j], high[q, i], low[q, i],
            )  # fmt: skip
            normals[s, k] = x
            normals[3, k], normals[4, k] = add(normals[3, k], normals[4, k], x, x_low)
            if s == 1:  # d = a . (b x c)
                x, x_low = multiply(high[0, k], low[0, k], x, x_low)
                d, d_low = add(d, d_low, x, x_low)
        far_p = length(high[p, 0], high[p, 1], high[p, 2])
        far_q = length(high[q, 0], high[q, 1], high[q, 2])
        errors[s] = PAIR_ERROR_REL * far_p * far_q + underflow
    errors[3] = errors[0] + errors[1] + errors[2]
    errors[4] = length(high[0, 0], high[0, 1], high[0, 2]) * errors[1] + underflow
    return d


@part_with_arrays
def side_if_out_of_sight(vertices, i, j, k, camera):
    """Visible side of a face that is out of sight, 1 or -1; 0 if it is not, or rounding decides.

    Out of sight: all of it before the near plane, or beyond one side of the image by `CLIP_MARGIN`,
    which is more than any rounding.
    """
    rotation, eye = camera.rotation, camera.centre
    wide, high = CLIP_MARGIN * camera.width + 1, CLIP_MARGIN * camera.height + 1
    before = left = right = above = below = True
    most = 0.0
    ax = ay = az = bx = by = bz = cx = cy = cz = 0.0
    for s in range(3):
        f = i if s == 0 else j if s == 1 else k
        x, y, z = vertices[f, 0] - eye[0], vertices[f, 1] - eye[1], vertices[f, 2] - eye[2]
        ax, ay, az, bx, by, bz, cx, cy, cz = bx, by, bz, cx, cy, cz, x, y, z
        u = camera.fx * (x * rotation[0, 0] + y * rotation[1, 0] + z * rotation[2, 0])
        v = camera.fy * (x * rotation[0, 1] + y * rotation[1, 1] + z * rotation[2, 1])
        depth = x * rotation[0, 2] + y * rotation[1, 2] + z * rotation[2, 2]
        before = before and depth < camera.near
        left = left and u + (camera.cx + wide) * depth < 0
        right = right and u + (camera.cx - camera.width - wide) * depth > 0
        above = above and v + (camera.cy + high) * depth < 0
        below = below and v + (camera.cy - camera.height - high) * depth > 0
        most = max(most, abs(x) + abs(y) + abs(z))
    if not (before or left or right or above or below):
        return 0
    # a . ((b - a) x (c - a)) is negative for the front.
    bx, by, bz = bx - ax, by - ay, bz - az
    cx, cy, cz = cx - ax, cy - ay, cz - az
    nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
    d = nx * ax + ny * ay + nz * az
    b, c = abs(bx) + abs(by) + abs(bz), abs(cx) + abs(cy) + abs(cz)
    if not abs(d) > UNIT_ROUNDING * most * (b * c + most * (b + c)):
        return 0
    return -1 if d > 0 else 1


@allocation_free
def image_within(lines, camera, polygon, spare):
    """Clip the image to the inner side of all lines; returns the corner count of `polygon`."""
    polygon[0, U] = polygon[3, U] = polygon[0, V] = polygon[1, V] = 0.0
    polygon[1, U] = polygon[2, U] = camera.width
    polygon[2, V] = polygon[3, V] = camera.height
    return clip(polygon, np.int64(4), lines, lines.shape[0], spare)


@allocation_free
def clip_in_space(corners, low, camera, normals, errors, sides, plane, polygon, spare):
    """Clip a face that reaches behind the camera or far out to the near plane and the image.

    Nothing is projected: a side of the image is the plane through the camera centre and an edge of
    the face, and the near plane is the line in the image where 1/z = 1/near. The camera centre may
    lie on the face or on an edge of it, so planes are computed in pairs of doubles.

    Parameters
    ----------
    corners, low : (3, 3) float64
        Corners in camera axes, in pairs of doubles; scaled in place.
    normals, errors : (5, 3), (5,) float64
        Scratch, for `normals_of_sides`.
    sides : (SIDES, 6) float64
        Out: lines that bound its image, with their errors in pixels.
    plane : (7,) float64
        Out: 1/z, as in `Clipped.planes`, at the principal point.
    polygon, spare : (CORNERS, 2) float64
        Out and scratch: its image, clockwise.

    Returns
    -------
    n : int
        Corners of its image, 0 for none. Negative if only lines moved outwards by their errors
        leave that many: the image rounds to nothing.
    front : int
        1 or -1 for the front or the back, 0 if rounding decides.
    """
    # In units of the face's own reach, so that no product under- or overflows; a power of two, so
    # that nothing is rounded.
    reach = 0.0
    for k in range(9):
        reach = max(reach, abs(corners[k // 3, k % 3]))
    reach = 2.0 ** np.floor(np.log2(reach))
    if not (reach > 0 and np.isfinite(1 / reach)):
        return 0, 0
    for k in range(9):
        corners[k // 3, k % 3] /= reach
        low[k // 3, k % 3] /= reach
    near = camera.near / reach
    # The plane n . X = d of the face: 1/z is n . ((u - cx)/fx, (v - cy)/fy, 1) / d.
    underflow = UNDERFLOW * max(1.0, 1 / reach)
    d = normals_of_sides(corners, low, underflow, normals, errors)
    if not abs(d) > errors[4]:
        return 0, 0
    front = 1 if d < 0 else -1
    if max(corners[0, 2], corners[1, 2], corners[2, 2]) < near:
        return 0, front
    spread = camera.longest_ray
    across = max(abs(camera.cx), abs(camera.width - camera.cx))
    down = max(abs(camera.cy), abs(camera.height - camera.cy))
    plane[U], plane[V], plane[W] = camera.cx, camera.cy, normals[3, 2] / d
    plane[SLOPE_U], plane[SLOPE_V] = normals[3, 0] / d / camera.fx, normals[3, 1] / d / camera.fy
    for s in range(SIDES):
        sides[s, U], sides[s, V] = camera.cx, camera.cy
        if s < 3:
            a, b = normals[s, 0] / camera.fx * -front, normals[s, 1] / camera.fy * -front
            c = normals[s, 2] * -front
            error = errors[s] * spread
        else:
            a, b, c = -plane[SLOPE_U], -plane[SLOPE_V], 1 / near - plane[W]
            error = (errors[3] * spread + errors[4] / near) / abs(d)
            error += UNIT_ROUNDING * (1 / near + abs(plane[W]))
        error += UNIT_ROUNDING * (abs(a) * across + abs(b) * down + abs(c))
        scale = max(abs(a), abs(b))
        if scale > 0:
            a, b, c, error = a / scale, b / scale, c / scale, error / scale
        sides[s, DU], sides[s, DV], sides[s, OFFSET], sides[s, LINE_ERROR] = b, -a, c, error
    n = image_within(sides, camera, polygon, spare)
    if n < 3:
        for s in range(SIDES):
            sides[s, OFFSET] += sides[s, LINE_ERROR]
        n = -image_within(sides, camera, polygon, spare)
        if n > -3:
            return 0, front
    # Only lines that touch its image matter, and 1/z within it.
    most = plane[OUTLINE_ERROR] = 0.0
    for s in range(SIDES):
        for p in range(abs(n)):
            u, v = polygon[p, U] - sides[s, U], polygon[p, V] - sides[s, V]
            if sides[s, DU] * v - sides[s, DV] * u + sides[s, OFFSET] <= sides[s, LINE_ERROR]:
                plane[OUTLINE_ERROR] = max(plane[OUTLINE_ERROR], sides[s, LINE_ERROR])
            most = max(most, plane[W] + plane[SLOPE_U] * u + plane[SLOPE_V] * v)
    plane[W_ERROR] = (errors[3] * spread + errors[4] * min(most, 1 / near)) / abs(d)
    plane[W_ERROR] += UNIT_ROUNDING * (
        abs(plane[W]) + abs(plane[SLOPE_U]) * across + abs(plane[SLOPE_V]) * down
    )
    for k in range(W, W_ERROR + 1):
        plane[k] /= reach
    return n, front


@part_with_arrays
def bounds_of_clipped(polygon, n, plane):
    """Box of a clipped face: least and greatest u, v and w."""
    w_min, w_max = np.inf, -np.inf
    for p in range(n):
        u, v = polygon[p, U], polygon[p, V]
        along_u, along_v = plane[SLOPE_U] * (u - plane[U]), plane[SLOPE_V] * (v - plane[V])
        w = plane[W] + along_u + along_v
        size = abs(plane[W]) + abs(along_u) + abs(along_v)
        error = plane[W_ERROR] + W_ARITHMETIC_ERROR_REL * size
        w_min, w_max = min(w_min, w - error), max(w_max, w + error)
    return (*extent_of(polygon, n), max(w_min, 0.0), w_max)


@part_with_arrays
def store_clipped(clipped, s, polygon, n, sides, plane):
    """Copy what `clip_in_space` returned to row s."""
    clipped.n_corners[s] = max(n, 0)
    copy_polygon(polygon, n, clipped.polygons[s])
    for q in range(SIDES):
        for column in range(OFFSET + 1):
            clipped.lines[s, q, column] = sides[q, column]
    for column in range(OUTLINE_ERROR + 1):
        clipped.planes[s, column] = plane[column]


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
def lay_boxes_of_block(b, projected):
    """Fill in the boxes of the faces of a block, the first time. None of them is clipped."""
    if not projected.has_boxes[b]:
        projected.has_boxes[b] = True
        faces, uvw, box = pointer(projected.faces), pointer(projected.uvw), pointer(projected.box)
        for f in range(b * BLOCK, min((b + 1) * BLOCK, projected.blocks.patch.shape[0])):
            lay_box(f, faces, uvw, box)


@allocation_free
def lay_boxes(faces, projected):
    """Fill in the boxes of some faces, and of the others of their blocks."""
    for index in range(faces.shape[0]):
        lay_boxes_of_block(faces[index] // BLOCK, projected)


@part_with_arrays
def clear_box(box):
    """Let a box hold nothing."""
    box[U_MIN] = box[V_MIN] = np.inf
    box[U_MAX] = box[V_MAX] = -np.inf


@part_with_arrays
def widen_box(box, u_min, u_max, v_min, v_max):
    """Let a box hold a rectangle, too."""
    box[U_MIN], box[U_MAX] = min(box[U_MIN], u_min), max(box[U_MAX], u_max)
    box[V_MIN], box[V_MAX] = min(box[V_MIN], v_min), max(box[V_MAX], v_max)


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
    clear_box(extent)
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
        clear_box(projected.block_box[b])
        if is_live:
            widen_box(projected.block_box[b], low_u, high_u, low_v, high_v)
            widen_box(extent, low_u, high_u, low_v, high_v)
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
    widths, heights, areas, bounds = 0.0, 0.0, 0.0, extent.copy()
    for index in range(rest.shape[0]):
        b = rest[index]
        projected.has_boxes[b] = True
        clear_box(block_box[b])
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
            widen_box(block_box[b], u_min, u_max, v_min, v_max)
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
            widen_box(bounds, u_min, u_max, v_min, v_max)
        describe_block(b, UNEVEN, projected)
    if n_clipped <= clipped.polygons.shape[0]:
        extent[:] = bounds
        extent[SUM_OF_WIDTHS] += widths
        extent[SUM_OF_HEIGHTS] += heights
        extent[SUM_OF_AREAS] += areas
    return n_live, n_clipped
