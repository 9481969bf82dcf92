"""Projection of vertices, and of faces that are clipped in space, compiled by numba.

`project` is the first pass over a pose, `exact_block.set_up` the second. Faces that reach behind
the camera or far out of the image are clipped in space before they are projected.

Where the camera centre lies on a face to the last digit, doubles do not determine the plane of the
face through it; pairs of doubles do, with about 106 bits. A pair (high, low) is the number
high + low, where high is that sum rounded.

T. J. Dekker. A Floating-Point Technique for Extending the Available Precision. 1971.
M. Joldes, J.-M. Muller, V. Popescu. Tight and Rigorous Error Bounds for Basic Building Blocks of
Double-Word Arithmetic. 2017: the relative error of a sum is below 3 * 2^-106 of the greater term,
that of a product below 5 * 2^-106.
"""

import numpy as np

from rastercov.kernels.exact_polygon import clip, length
from rastercov.kernels.exact_records import (
    DU,
    DV,
    LINE_ERROR,
    OFFSET,
    OUTLINE_ERROR,
    SIDES,
    SLOPE_U,
    SLOPE_V,
    W_ERROR,
    U,
    V,
    W,
)
from rastercov.kernels.jit import allocation_free, part_of, part_with_arrays

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
    for k in range(3):
        normals[3, k] = normals[4, k] = 0.0
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
    u_min = v_min = w_min = np.inf
    u_max = v_max = w_max = -np.inf
    for p in range(n):
        u, v = polygon[p, U], polygon[p, V]
        u_min, u_max = min(u_min, u), max(u_max, u)
        v_min, v_max = min(v_min, v), max(v_max, v)
        along_u, along_v = plane[SLOPE_U] * (u - plane[U]), plane[SLOPE_V] * (v - plane[V])
        w = plane[W] + along_u + along_v
        size = abs(plane[W]) + abs(along_u) + abs(along_v)
        error = plane[W_ERROR] + W_ARITHMETIC_ERROR_REL * size
        w_min, w_max = min(w_min, w - error), max(w_max, w + error)
    return u_min, u_max, v_min, v_max, max(w_min, 0.0), w_max


@part_with_arrays
def store_clipped(clipped, s, polygon, n, sides, plane):
    """Copy what `clip_in_space` returned to row s."""
    clipped.n_corners[s] = max(n, 0)
    for p in range(n):
        clipped.polygons[s, p, U], clipped.polygons[s, p, V] = polygon[p, U], polygon[p, V]
    for q in range(SIDES):
        for column in range(OFFSET + 1):
            clipped.lines[s, q, column] = sides[q, column]
    for column in range(OUTLINE_ERROR + 1):
        clipped.planes[s, column] = plane[column]
