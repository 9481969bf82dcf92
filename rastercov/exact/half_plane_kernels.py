"""The loops of the analytic path, compiled by numba: exact visible areas of one pose.

A pose runs through four passes. `project` brings vertices to the image. `set_up` keeps the faces
that reach into the image, cuts those that reach behind the camera, and measures each. `fill_grid`
lists them by the cells of a grid over the image. `visible_areas` takes one face at a time, finds
the faces before it in the cells it touches, and takes from its image what each of them hides.

In the image 1/z is affine on a face, so what face M hides of face T is T n M n {1/z_M > 1/z_T}: a
convex polygon. Taking a convex polygon from a convex piece leaves convex pieces: each of its sides
slices off the part beyond it. The pieces of T partition what is visible, whatever the order of
the occluders; a misjudged cut misplaces area, it never loses any, so that rounding in does no more
than rounding out. There is no topology to break.

A. Appel. The Notion of Quantitative Invisibility and the Machine Rendering of Solids. 1967.
I. Sutherland, G. Hodgman. Reentrant Polygon Clipping. 1974, for the cuts.
"""

import numpy as np

from rastercov._double_double import add, exact_sum, minor, multiply
from rastercov._jit import compiled, inlined

TIE = 1e-10
"""Relative difference of 1/z up to which two surfaces count as one: the lower index is in front."""
RESIDUE = 4 * 2.0**-52
"""Largest rounding of a position in the image, as a part of the largest number it was made from;
of 1/z, as a part of the longest ray: some ten operations of 2^-53 each, of which not all err one
way."""
OUTLINE = 8
"""Pixels of extent that may be wrong along the outline of a face, for each of rounding and of width
and height: its perimeter is twice their sum at most. A part for its own image, one for what is seen
of it, one for corners that count as on a line, one for what is left of a face and counts as
nothing."""
MARGIN = 0.25
"""Of the image's size, and a pixel: what reaches farther out than this is cut in space, before it
is projected."""
PAIR = 2.0**-98
"""Relative error bound of the products of three vectors in pairs of doubles: 3 camera coordinates
of 12 * 2^-106 each, and 8 operations of 5 * 2^-106."""
LIVE, CUT, PARTLY = 1, 2, 4
"""Bits of a face's state: it reaches into the image; its image is a polygon made by cutting it in
space; it reaches out of the image."""
DOUBTFUL, THIN = 16, 32
"""More bits: rounding may decide which side is seen; its image rounds to nothing, so that it hides
nothing, and the bounds of the faces behind it take in what it may hide. 8 is taken by
`contour_kernels`."""
EDGE_ON = 4
"""A face is doubtful whose image has less than this many pixels of area for each pixel of extent
and of rounding: (u1 - u0)(v2 - v0) - (u2 - u0)(v1 - v0) is twice the area, each difference is off
by 2 roundings, and each side of the image is at most its extent."""
CORNERS = 12
"""Room for the corners of a face: cut by the near plane and the image border it has at most 8."""
SIDES = 4
"""Lines that bound the image of a face: its edges and, where it is cut there, the near plane."""
MOST_CORNERS = 20
"""Corners of a piece: one that gets more is halved."""
WIDTH = 64
"""Room for the corners of a piece: cuts on the way can add to `MOST_CORNERS`."""
MOST_OCCLUDERS = 24
"""Occluders of a part of a face taken away together; where there are more, it is halved first."""
STACK = 64
"""Parts that wait."""


@compiled
def project(vertices, rotation, eye, lens, near, pyramid, uvw):
    """Image positions and inverse depths of the vertices.

    Parameters
    ----------
    vertices : (V, 3) float64
        World points.
    rotation : (3, 3) float64
        world_from_camera.
    eye : (3,) float64
        Camera centre, from the same origin as the vertices.
    lens : (4,) float64
        fx, fy, cx, cy in pixels.
    near : float
        Depth of the near plane.
    pyramid : (4,) float64
        Least and greatest u, least and greatest v of what is kept in space: more than the image.
    uvw : (V, 3) float64
        Out: pixels and 1/z; 1/z is 0 where the vertex lies outside the pyramid or before the near
        plane, so that the faces and edges that use it must be cut in space.
    """
    for i in range(vertices.shape[0]):
        a = vertices[i, 0] - eye[0]
        b = vertices[i, 1] - eye[1]
        c = vertices[i, 2] - eye[2]
        z = a * rotation[0, 2] + b * rotation[1, 2] + c * rotation[2, 2]
        inverse = 1.0 / z if z >= near else 0.0
        right = a * rotation[0, 0] + b * rotation[1, 0] + c * rotation[2, 0]
        down = a * rotation[0, 1] + b * rotation[1, 1] + c * rotation[2, 1]
        u = lens[0] * (right * inverse) + lens[2]
        v = lens[1] * (down * inverse) + lens[3]
        if not (pyramid[0] <= u <= pyramid[1] and pyramid[2] <= v <= pyramid[3]):
            inverse = 0.0
        uvw[i, 0] = u
        uvw[i, 1] = v
        uvw[i, 2] = inverse


@compiled
def in_camera(point, rotation, eye, high, low):
    """One world point in camera axes, in pairs of doubles: the sums `high` + `low`, (3,) each."""
    a, a_low = exact_sum(point[0], -eye[0])
    b, b_low = exact_sum(point[1], -eye[1])
    c, c_low = exact_sum(point[2], -eye[2])
    for k in range(3):
        x, x_low = multiply(a, a_low, rotation[0, k], 0.0)
        y, y_low = multiply(b, b_low, rotation[1, k], 0.0)
        z, z_low = multiply(c, c_low, rotation[2, k], 0.0)
        x, x_low = add(x, x_low, y, y_low)
        high[k], low[k] = add(x, x_low, z, z_low)


@compiled
def planes_of_sides(high, low, normals, off):
    """Planes of a face, and of its edges with the camera centre.

    Parameters
    ----------
    high, low : (3, 3) float64
        The face in camera axes, in pairs of doubles.
    normals : (4, 3) float64
        Out: p x q for each edge p q, and the normal n of the face, rounded at the end.
    off : (5,) float64
        Out: largest errors of the four, as vectors, and of d.

    Returns
    -------
    d : float
        n . X of the face. (p x q) . ray has its sign for a ray on the inner side of edge p q.
    """
    sum_high, sum_low = np.zeros(3), np.zeros(3)
    d = d_low = 0.0
    for s in range(3):
        p, q = s, s + 1 if s < 2 else 0
        for k in range(3):
            i, j = k + 1 if k < 2 else 0, k - 1 if k > 0 else 2
            x, x_low = minor(
                high[p, i], low[p, i], high[q, j], low[q, j],
                high[p, j], low[p, j], high[q, i], low[q, i],
            )  # fmt: skip
            normals[s, k] = x
            sum_high[k], sum_low[k] = add(sum_high[k], sum_low[k], x, x_low)
            if s == 1:  # d = a . (b x c)
                x, x_low = multiply(high[0, k], low[0, k], x, x_low)
                d, d_low = add(d, d_low, x, x_low)
        far_p = length(high[p, 0], high[p, 1], high[p, 2])
        far_q = length(high[q, 0], high[q, 1], high[q, 2])
        off[s] = PAIR * far_p * far_q
    normals[3] = sum_high
    off[3] = off[0] + off[1] + off[2]
    off[4] = length(high[0, 0], high[0, 1], high[0, 2]) * off[1]
    return d


@inlined
def side_out_of_sight(vertices, i, j, k, rotation, eye, lens, near, size):
    """Side that is seen of a face, 1 or -1, if it is certain, and the face is out of sight; else 0.

    Out of sight: all of it before the near plane, or beyond one side of the image by `MARGIN`,
    which is more than any rounding.
    """
    wide, high = MARGIN * size[0] + 1, MARGIN * size[1] + 1
    before = left = right = above = below = True
    most = 0.0
    ax = ay = az = bx = by = bz = cx = cy = cz = 0.0
    for s in range(3):
        f = i if s == 0 else j if s == 1 else k
        x, y, z = vertices[f, 0] - eye[0], vertices[f, 1] - eye[1], vertices[f, 2] - eye[2]
        ax, ay, az, bx, by, bz, cx, cy, cz = bx, by, bz, cx, cy, cz, x, y, z
        u = lens[0] * (x * rotation[0, 0] + y * rotation[1, 0] + z * rotation[2, 0])
        v = lens[1] * (x * rotation[0, 1] + y * rotation[1, 1] + z * rotation[2, 1])
        w = x * rotation[0, 2] + y * rotation[1, 2] + z * rotation[2, 2]
        before = before and w < near
        left = left and u + (lens[2] + wide) * w < 0
        right = right and u + (lens[2] - size[0] - wide) * w > 0
        above = above and v + (lens[3] + high) * w < 0
        below = below and v + (lens[3] - size[1] - high) * w > 0
        most = max(most, abs(x) + abs(y) + abs(z))
    if not (before or left or right or above or below):
        return 0
    # a . ((b - a) x (c - a)) is negative for the front.
    bx, by, bz = bx - ax, by - ay, bz - az
    cx, cy, cz = cx - ax, cy - ay, cz - az
    nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
    d = nx * ax + ny * ay + nz * az
    b, c = abs(bx) + abs(by) + abs(bz), abs(cx) + abs(cy) + abs(cz)
    if not abs(d) > RESIDUE * most * (b * c + most * (b + c)):
        return 0
    return -1 if d > 0 else 1


@compiled
def keep_inside(polygon, n, line, out):
    """Keep the part of an image polygon on the inner side of a line; its corner count.

    A line is (x0, y0, dx, dy, c); its inner side is where dx (y - y0) - dy (x - x0) + c >= 0.
    """
    x, y, dx, dy, c = line[0], line[1], line[2], line[3], line[4]
    kept = 0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        here = dx * (polygon[i, 1] - y) - dy * (polygon[i, 0] - x) + c
        there = dx * (polygon[j, 1] - y) - dy * (polygon[j, 0] - x) + c
        if here >= 0 and kept < out.shape[0]:
            out[kept, 0] = polygon[i, 0]
            out[kept, 1] = polygon[i, 1]
            kept += 1
        crosses = (here > 0 and there < 0) or (here < 0 and there > 0)
        if crosses and kept < out.shape[0]:
            t = here / (here - there)
            out[kept, 0] = polygon[i, 0] + t * (polygon[j, 0] - polygon[i, 0])
            out[kept, 1] = polygon[i, 1] + t * (polygon[j, 1] - polygon[i, 1])
            kept += 1
    return kept


@compiled
def twice_area(polygon, n):
    """Twice the signed area, positive where the polygon runs clockwise in the image (v down)."""
    total = 0.0
    x, y = polygon[0, 0], polygon[0, 1]
    for i in range(1, n - 1):
        total += (polygon[i, 0] - x) * (polygon[i + 1, 1] - y) - (polygon[i + 1, 0] - x) * (
            polygon[i, 1] - y
        )
    return total


@compiled
def cut(polygon, n, lines, n_lines, spare):
    """Cut an image polygon, in place, to the inner side of some lines; its corner count."""
    for s in range(n_lines):
        n = keep_inside(polygon, n, lines[s], spare)
        for p in range(n):
            polygon[p, 0], polygon[p, 1] = spare[p, 0], spare[p, 1]
    return n


@compiled
def image_border(size):
    """The four sides of the image as lines."""
    lines = np.zeros((4, 5))
    lines[0, 2] = size[0]  # along the top: x to the right
    lines[1, 0], lines[1, 3] = size[0], size[1]
    lines[2, 0], lines[2, 1], lines[2, 2] = size[0], size[1], -size[0]
    lines[3, 1], lines[3, 3] = size[1], -size[1]
    return lines


@inlined
def length(x, y, z):
    """Length of a vector."""
    return np.sqrt(x * x + y * y + z * z)


@inlined
def longest_ray(lens, size):
    """Greatest length of a ray to the plane z = 1, through the image and half as far around it."""
    across, down = max(lens[2], size[0] - lens[2]), max(lens[3], size[1] - lens[3])
    return length(1.0, 1.5 * across / lens[0], 1.5 * down / lens[1])


@compiled
def cut_in_space(corners, low, lens, near, size, normals, off, sides, plane, polygon, spare):
    """Cut a face that reaches behind the camera or far out by the near plane and the image border.

    Nothing is projected: a side of the image is the plane through the camera centre and an edge of
    the face, and the near plane is the line in the image where 1/z = 1/near. The camera centre may
    lie on the face or on an edge of it, so planes are worked out in pairs of doubles.

    Parameters
    ----------
    corners, low : (3, 3) float64
        The face in camera axes, in pairs of doubles; scaled in place.
    lens, near, size
        As for `set_up`.
    normals, off : (4, 3), (5,) float64
        Scratch, for `planes_of_sides`.
    sides : (4, 6) float64
        Out: the lines that bound its image, and how many pixels each may be off.
    plane : (7,) float64
        Out: u, v, 1/z at the principal point, and the slope of 1/z; the largest error of 1/z in its
        image; how many pixels the lines around its image may be off.
    polygon, spare : (12, 2) float64
        Out and scratch: its image, clockwise.

    Returns
    -------
    n : int
        Corners of its image, 0 for none. Negative where lines as far off as they may be leave that
        many, but those that were found leave none: the image rounds to nothing.
    front : int
        1 or -1 for the front or the back, 0 where rounding decides over that.
    """
    # In units of the face's own reach, so that no product under- or overflows; a power of two, so
    # that nothing is rounded.
    reach = 2.0 ** np.floor(np.log2(np.abs(corners).max()))
    if not (reach > 0 and np.isfinite(1 / reach)):
        return 0, 0
    corners /= reach
    low /= reach
    near = near / reach
    # The plane n . X = d of the face: 1/z is n . ((u - cx)/fx, (v - cy)/fy, 1) / d.
    d = planes_of_sides(corners, low, normals, off)
    if not abs(d) > off[4]:
        return 0, 0
    front = 1 if d < 0 else -1
    if max(corners[0, 2], corners[1, 2], corners[2, 2]) < near:
        return 0, front
    spread = longest_ray(lens, size)
    across = max(abs(lens[2]), abs(size[0] - lens[2]))
    down = max(abs(lens[3]), abs(size[1] - lens[3]))
    plane[0], plane[1], plane[2] = lens[2], lens[3], normals[3, 2] / d
    plane[3], plane[4] = normals[3, 0] / d / lens[0], normals[3, 1] / d / lens[1]
    for s in range(SIDES):
        sides[s, 0], sides[s, 1] = lens[2], lens[3]
        if s < 3:
            a, b = normals[s, 0] / lens[0] * -front, normals[s, 1] / lens[1] * -front
            c = normals[s, 2] * -front
            error = off[s] * spread
        else:
            a, b, c = -plane[3], -plane[4], 1 / near - plane[2]
            error = (off[3] * spread + off[4] / near) / abs(d)
            error += RESIDUE * (1 / near + abs(plane[2]))
        error += RESIDUE * (abs(a) * across + abs(b) * down + abs(c))
        scale = max(abs(a), abs(b))
        if scale > 0:
            a, b, c, error = a / scale, b / scale, c / scale, error / scale
        sides[s, 2], sides[s, 3], sides[s, 4], sides[s, 5] = b, -a, c, error
    n = image_within(sides, size, polygon, spare)
    if n < 3:
        for s in range(SIDES):
            sides[s, 4] += sides[s, 5]
        n = -image_within(sides, size, polygon, spare)
        if n > -3:
            return 0, front
    # Only lines that touch its image matter, and 1/z within it.
    most = plane[6] = 0.0
    for s in range(SIDES):
        for p in range(abs(n)):
            u, v = polygon[p, 0] - sides[s, 0], polygon[p, 1] - sides[s, 1]
            if sides[s, 2] * v - sides[s, 3] * u + sides[s, 4] <= sides[s, 5]:
                plane[6] = max(plane[6], sides[s, 5])
            most = max(most, plane[2] + plane[3] * u + plane[4] * v)
    plane[5] = (off[3] * spread + off[4] * min(most, 1 / near)) / abs(d)
    plane[5] += RESIDUE * (abs(plane[2]) + abs(plane[3]) * across + abs(plane[4]) * down)
    for k in range(2, 6):
        plane[k] /= reach
    return n, front


@compiled
def image_within(lines, size, polygon, spare):
    """Part of the image on the inner side of all lines; corner count."""
    polygon[0, 0] = polygon[3, 0] = polygon[0, 1] = polygon[1, 1] = 0.0
    polygon[1, 0] = polygon[2, 0] = size[0]
    polygon[2, 1] = polygon[3, 1] = size[1]
    return cut(polygon, np.int64(4), lines, lines.shape[0], spare)


@compiled
def set_up(
    vertices, faces, flat, rotation, eye, lens, near, size, front_only, rounding, uvw, side, state,
    box, area, blur, slot, polygons, n_corners, sides, planes, region,
):  # fmt: skip
    """Keep and measure the faces that reach into the image; how many are kept, and how many cut.

    Where there are more cut faces than `polygons` has room for, make room and call again.

    Parameters
    ----------
    vertices, rotation, eye, lens, near, uvw
        As for `project`.
    faces : (F, 3) int32
    flat : (F,) bool
        Faces without area, which neither see nor hide anything.
    size : (2,) float64
        Width and height of the image.
    front_only : bool
        Leave out faces that are seen from behind beyond doubt: they hide nothing.
    rounding : float
        Largest error of a position in the image, pixels.
    side : (F,) int8
        Out: 1 for a face seen from the front, -1 from behind, 0 for one that is left out.
    state : (F,) uint8
        Out: `LIVE`, `CUT`, `PARTLY`, `DOUBTFUL`, or 0; or `THIN`, with `CUT` and `DOUBTFUL`.
    box : (F, 6) float64
        Out, of live and thin faces: least and greatest u, least and greatest v, least and greatest
        1/z.
    area : (F,) float64
        Out: px^2 inside the image, of faces that are left out, too.
    blur : (F,) float64
        Out: a bound of the error of the area of those that are left out, px^2; 0 for all others.
    slot, polygons, n_corners, sides, planes : (F,), (N, 12, 2), (N,), (N, 4, 5), (N, 7)
        Out, of cut faces: where in the others they stand, and what `cut_in_space` finds.
    region : (7,) float64
        Out: least and greatest u and v of all that is kept, within the image; and the sums of the
        widths, the heights and the areas of the boxes within it.
    """
    corners, low, normals, off = np.empty((3, 3)), np.empty((3, 3)), np.empty((4, 3)), np.empty(5)
    polygon, spare = np.empty((CORNERS, 2)), np.empty((CORNERS, 2))
    lines, plane, border = np.empty((SIDES, 6)), np.empty(7), image_border(size)
    live = n_cut = 0
    low_u = low_v = np.inf
    high_u = high_v = -np.inf
    widths = heights = boxes = 0.0
    for f in range(faces.shape[0]):
        state[f] = 0
        side[f] = 0
        area[f] = blur[f] = 0.0
        if flat[f]:
            continue
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        u0, v0, w0 = uvw[i, 0], uvw[i, 1], uvw[i, 2]
        u1, v1, w1 = uvw[j, 0], uvw[j, 1], uvw[j, 2]
        u2, v2, w2 = uvw[k, 0], uvw[k, 1], uvw[k, 2]
        if w0 > 0 and w1 > 0 and w2 > 0:
            twice = (u1 - u0) * (v2 - v0) - (u2 - u0) * (v1 - v0)
            x0, x1 = min(u0, u1, u2), max(u0, u1, u2)
            y0, y1 = min(v0, v1, v2), max(v0, v1, v2)
            is_doubtful = abs(twice) <= EDGE_ON * rounding * (x1 - x0 + y1 - y0)
            is_culled = front_only and twice > 0 and not is_doubtful
            if not is_culled:
                side[f] = 1 if twice < 0 else -1 if twice > 0 else 0
            if x1 <= 0 or y1 <= 0 or x0 >= size[0] or y0 >= size[1]:
                continue
            least, most = min(w0, w1, w2), max(w0, w1, w2)
            inside = abs(twice) / 2
            flags = LIVE | DOUBTFUL if is_doubtful else LIVE
            if inside > 0 and (x0 < 0 or y0 < 0 or x1 > size[0] or y1 > size[1]):
                flags |= PARTLY
                polygon[0, 0], polygon[0, 1] = u0, v0
                polygon[1, 0], polygon[1, 1] = u1, v1
                polygon[2, 0], polygon[2, 1] = u2, v2
                n = cut(polygon, np.int64(3), border, border.shape[0], spare)
                inside = abs(twice_area(polygon, n)) / 2 if n >= 3 else 0.0
        else:
            n, front = 0, side_out_of_sight(vertices, i, j, k, rotation, eye, lens, near, size)
            if front == 0:
                in_camera(vertices[i], rotation, eye, corners[0], low[0])
                in_camera(vertices[j], rotation, eye, corners[1], low[1])
                in_camera(vertices[k], rotation, eye, corners[2], low[2])
                n, front = cut_in_space(
                    corners, low, lens, near, size, normals, off, lines, plane, polygon, spare
                )
            if front == 0:
                # The camera centre is on its plane to 2^-98: nothing of it is wide enough to count.
                state[f] = DOUBTFUL
                continue
            is_culled = front_only and front < 0
            if not is_culled:
                side[f] = front
            if n == 0:
                continue
            x0 = y0 = least = np.inf
            x1 = y1 = most = -np.inf
            for p in range(abs(n)):
                u, v = polygon[p, 0], polygon[p, 1]
                x0, x1 = min(x0, u), max(x1, u)
                y0, y1 = min(y0, v), max(y1, v)
                along_u, along_v = plane[3] * (u - plane[0]), plane[4] * (v - plane[1])
                w = plane[2] + along_u + along_v
                doubt = plane[5] + 1e-14 * (abs(plane[2]) + abs(along_u) + abs(along_v))
                least, most = min(least, w - doubt), max(most, w + doubt)
            least = max(least, 0.0)
            flags = LIVE | CUT | PARTLY
            inside = twice_area(polygon, n) / 2 if n >= 3 else 0.0
            if is_culled:
                area[f] = max(inside, 0.0)
                blur[f] = OUTLINE * (x1 - x0 + y1 - y0) * max(rounding, plane[6])
                continue
            if n_cut < polygons.shape[0]:
                slot[f] = n_cut
                n_corners[n_cut] = max(n, 0)
                for p in range(n):
                    polygons[n_cut, p, 0], polygons[n_cut, p, 1] = polygon[p, 0], polygon[p, 1]
                for p in range(5):
                    for q in range(4):
                        sides[n_cut, q, p] = lines[q, p]
                for p in range(7):
                    planes[n_cut, p] = plane[p]
            n_cut += 1
        if is_culled:
            area[f] = inside
            blur[f] = OUTLINE * (x1 - x0 + y1 - y0) * rounding
            continue
        box[f, 0], box[f, 1], box[f, 2], box[f, 3] = x0, x1, y0, y1
        box[f, 4], box[f, 5] = least, most
        if not inside > 0:
            state[f] = THIN | DOUBTFUL | flags & CUT
            continue
        state[f] = flags
        area[f] = inside
        live += 1
        x0, x1 = max(x0, 0.0), min(x1, size[0])
        y0, y1 = max(y0, 0.0), min(y1, size[1])
        widths += x1 - x0
        heights += y1 - y0
        boxes += (x1 - x0) * (y1 - y0)
        low_u, high_u = min(low_u, x0), max(high_u, x1)
        low_v, high_v = min(low_v, y0), max(high_v, y1)
    region[0], region[1], region[2], region[3] = low_u, high_u, low_v, high_v
    region[4], region[5], region[6] = widths, heights, boxes
    return live, n_cut


@inlined
def cell(position, origin, per_cell, n):
    """Row or column of the grid that a position falls into; those outside go to the rim."""
    return min(max(np.int64((position - origin) * per_cell), 0), n - 1)


@compiled
def fill_grid(state, box, grid, columns, rows, starts, listed):
    """List the live faces by the cells their boxes touch; how many entries that makes.

    Where there are more than `listed` has room for, make room and call again.

    Parameters
    ----------
    state, box
        As `set_up` left them.
    grid : (4,) float64
        Least u, least v, columns a pixel, rows a pixel.
    starts : (columns * rows + 2 or more,) int64
        Out: entries of cell c stand at starts[c] ... starts[c + 1].
    listed : (N,) int32
        Out: faces, in the order of their index.
    """
    n_cells = columns * rows
    for c in range(n_cells + 2):
        starts[c] = 0
    for f in range(state.shape[0]):
        if state[f] & (LIVE | THIN):
            left = cell(box[f, 0], grid[0], grid[2], columns)
            right = cell(box[f, 1], grid[0], grid[2], columns)
            top = cell(box[f, 2], grid[1], grid[3], rows)
            bottom = cell(box[f, 3], grid[1], grid[3], rows)
            for y in range(top, bottom + 1):
                for x in range(left, right + 1):
                    starts[y * columns + x + 2] += 1
    for c in range(2, n_cells + 2):
        starts[c] += starts[c - 1]
    total = starts[n_cells + 1]
    if total > listed.shape[0]:
        return total
    for f in range(state.shape[0]):
        if state[f] & (LIVE | THIN):
            left = cell(box[f, 0], grid[0], grid[2], columns)
            right = cell(box[f, 1], grid[0], grid[2], columns)
            top = cell(box[f, 2], grid[1], grid[3], rows)
            bottom = cell(box[f, 3], grid[1], grid[3], rows)
            for y in range(top, bottom + 1):
                for x in range(left, right + 1):
                    at = y * columns + x + 1
                    listed[starts[at]] = f
                    starts[at] += 1
    return total


@inlined
def outline(f, faces, uvw, side, state, slot, polygons, n_corners, sides, corners, lines):
    """The image of a live face; how many corners and how many lines it has.

    Parameters
    ----------
    corners : (12, 2) float64
        Out: clockwise in the image; cut at its border only if the face is cut in space.
    lines : (4 or more, 5) float64
        Out: the lines that bound it, as `keep_inside` takes them.
    """
    if state[f] & CUT:
        s = slot[f]
        for p in range(n_corners[s]):
            corners[p, 0], corners[p, 1] = polygons[s, p, 0], polygons[s, p, 1]
        for p in range(SIDES):
            for q in range(5):
                lines[p, q] = sides[s, p, q]
        return n_corners[s], SIDES
    second, third = (1, 2) if side[f] < 0 else (2, 1)
    i, j, k = faces[f, 0], faces[f, second], faces[f, third]
    corners[0, 0], corners[0, 1] = uvw[i, 0], uvw[i, 1]
    corners[1, 0], corners[1, 1] = uvw[j, 0], uvw[j, 1]
    corners[2, 0], corners[2, 1] = uvw[k, 0], uvw[k, 1]
    for p in range(3):
        q = p + 1 if p < 2 else 0
        lines[p, 0], lines[p, 1] = corners[p, 0], corners[p, 1]
        lines[p, 2], lines[p, 3] = corners[q, 0] - corners[p, 0], corners[q, 1] - corners[p, 1]
        lines[p, 4] = 0.0
    return 3, 3


@inlined
def blur_of(f, state, slot, planes, rounding):
    """How many pixels the outline of a face may be off."""
    return max(rounding[0], planes[slot[f], 6]) if state[f] & CUT else rounding[0]


@compiled
def plane_of(f, faces, uvw, state, slot, planes, rounding):
    """A point of the face, u, v and 1/z, the slope of 1/z along u and v, and the error of 1/z.

    The error is that of corners and of the arithmetic here, anywhere in the face.
    """
    if state[f] & CUT:
        s = slot[f]
        return planes[s, 0], planes[s, 1], planes[s, 2], planes[s, 3], planes[s, 4], planes[s, 5]
    i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
    u, v, w = uvw[i, 0], uvw[i, 1], uvw[i, 2]
    u1, v1, w1 = uvw[j, 0] - u, uvw[j, 1] - v, uvw[j, 2] - w
    u2, v2, w2 = uvw[k, 0] - u, uvw[k, 1] - v, uvw[k, 2] - w
    twice = u1 * v2 - u2 * v1
    a, b = (w1 * v2 - w2 * v1) / twice, (u1 * w2 - u2 * w1) / twice
    # Of a needle, the slope across it says little.
    change = abs(w1) + abs(w2)
    skew = (abs(u1) + abs(u2)) * (abs(v1) + abs(v2)) / abs(twice)
    error = rounding[1] * (w + change * skew) + rounding[0] * (abs(a) + abs(b))
    return u, v, w, a, b, error


@inlined
def separated(lines, n_lines, corners, n):
    """Whether a line has all corners of a polygon beyond it.

    Exactly so for faces on both sides of an edge they share: the value at a shared corner is 0 to
    the bit, whatever the rounding elsewhere.
    """
    for s in range(n_lines):
        x, y, dx, dy, c = lines[s, 0], lines[s, 1], lines[s, 2], lines[s, 3], lines[s, 4]
        beyond = True
        for p in range(n):
            if dx * (corners[p, 1] - y) - dy * (corners[p, 0] - x) + c > 0:
                beyond = False
                break
        if beyond:
            return True
    return False


@compiled
def split(polygon, n, values, inside, outside):
    """Cut a convex polygon where `values` change sign; corner counts of the two parts."""
    kept = lost = 0
    room = min(inside.shape[0], outside.shape[0]) - 2
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        if kept >= room or lost >= room:
            break
        if values[i] >= 0:
            inside[kept, 0] = polygon[i, 0]
            inside[kept, 1] = polygon[i, 1]
            kept += 1
        if values[i] <= 0:
            outside[lost, 0] = polygon[i, 0]
            outside[lost, 1] = polygon[i, 1]
            lost += 1
        if (values[i] > 0 and values[j] < 0) or (values[i] < 0 and values[j] > 0):
            t = values[i] / (values[i] - values[j])
            x = polygon[i, 0] + t * (polygon[j, 0] - polygon[i, 0])
            y = polygon[i, 1] + t * (polygon[j, 1] - polygon[i, 1])
            inside[kept, 0] = outside[lost, 0] = x
            inside[kept, 1] = outside[lost, 1] = y
            kept += 1
            lost += 1
    return kept, lost


@compiled
def settle(pieces, n_of, at, count):
    """Halve a piece of too many corners along a chord; the number of pieces.

    The halves beyond the first go to the end. There is room for them: see `take_away`.
    """
    while n_of[at] > MOST_CORNERS:
        n = n_of[at]
        half = n // 2
        for p in range(half, n):
            pieces[count, p - half, 0] = pieces[at, p, 0]
            pieces[count, p - half, 1] = pieces[at, p, 1]
        pieces[count, n - half, 0] = pieces[at, 0, 0]
        pieces[count, n - half, 1] = pieces[at, 0, 1]
        n_of[count] = n - half + 1
        n_of[at] = half + 1
        count += 1
    return count


@compiled
def take_away(pieces, n_of, count, lines, n_sides, n_lines, rounding, spare, values):
    """Take a convex occluder from every piece; how many pieces remain, or -1 for want of room.

    Parameters
    ----------
    pieces, n_of : (N, WIDTH, 2) float64, (N,) int64
        Convex polygons, clockwise in the image, and their corner counts; changed in place.
    count : int
        Pieces in use.
    lines : (L, 5) float64
        The occluder is where dx (y - y0) - dy (x - x0) + c >= 0 for each line (x0, y0, dx, dy, c):
        first its sides, then, where it hides only a part, the line where the depths are equal.
    n_sides, n_lines : int
        Lines that are sides, and all in use.
    rounding : float
        Pixels from a line up to which a corner is on it. Without it the slivers that rounding
        leaves along the common side of two occluders are cut by every line near them, and double
        with each.
    spare, values : (WIDTH, 2), (WIDTH,) float64
        Scratch.
    """
    old, i = count, 0
    while i < old:
        n = n_of[i]
        # Which lines cut the piece? One that has all of it beyond settles the matter.
        cutting, missed = 0, False
        for s in range(n_lines):
            x, y, dx, dy, c = lines[s, 0], lines[s, 1], lines[s, 2], lines[s, 3], lines[s, 4]
            slack = rounding * (abs(dx) + abs(dy))
            least, most = 0.0, 0.0
            for p in range(n):
                value = dx * (pieces[i, p, 1] - y) - dy * (pieces[i, p, 0] - x) + c
                least = min(least, value)
                most = max(most, value)
            if most <= slack and s < n_sides:
                missed = True
                break
            if least < -slack:
                cutting |= 1 << s
        if missed:
            i += 1
            continue
        if count + 4 * n_lines + 4 > pieces.shape[0]:
            return -1
        hidden = True
        for s in range(n_lines):
            if not cutting >> s & 1:
                continue
            x, y, dx, dy, c = lines[s, 0], lines[s, 1], lines[s, 2], lines[s, 3], lines[s, 4]
            slack = rounding * (abs(dx) + abs(dy))
            n = n_of[i]
            least, most = 0.0, 0.0
            for p in range(n):
                value = dx * (pieces[i, p, 1] - y) - dy * (pieces[i, p, 0] - x) + c
                values[p] = value if abs(value) > slack else 0.0
                least = min(least, values[p])
                most = max(most, values[p])
            if most == 0:
                hidden = False
                break
            if least < 0:
                kept, lost = split(pieces[i], n, values, spare, pieces[count])
                if lost >= 3:
                    n_of[count] = lost
                    count = settle(pieces, n_of, count, count + 1)
                for p in range(kept):
                    pieces[i, p, 0] = spare[p, 0]
                    pieces[i, p, 1] = spare[p, 1]
                n_of[i] = kept
                if kept < 3:
                    break
        if not hidden:
            count = settle(pieces, n_of, i, count)
            i += 1
            continue
        # Piece i is gone: a new piece takes its place, or else an old one that is still to come.
        is_new = count > old
        last = count - 1
        if i < last:
            n_of[i] = n_of[last]
            for p in range(n_of[last]):
                pieces[i, p, 0] = pieces[last, p, 0]
                pieces[i, p, 1] = pieces[last, p, 1]
        count = last
        if is_new:
            i += 1
        else:
            old = last
    return count


@compiled
def before(
    t, m, target, n, lines, n_sides, faces, uvw, box, state, slot, planes, rounding, spare, other,
    blur,
):  # fmt: skip
    """How face m stands to face t where their images meet: 1 before it, 0 not, 2 before in part.

    Who is nearer is not known where 1/z differs by less than its error, which is a strip along the
    line of equal depth. The smaller the angle at which faces pierce each other, the wider it is.

    Parameters
    ----------
    target, n : (24, 2) float64, int
        The image of t.
    lines, n_sides : (5 or more, 5) float64, int
        The lines that bound the image of m; where the answer is 2, the line of equal depth is put
        after them.
    rounding : (2,) float64
        As for `visible_areas`.
    blur : (F,) float64
        The area of that strip is added to that of t, px^2.
    """
    if box[m, 4] > box[t, 5] * (1 + 2 * TIE):
        return 1
    # What the two have in common, and by how much m is nearer at its corners.
    for p in range(n):
        spare[p, 0], spare[p, 1] = target[p, 0], target[p, 1]
    n = cut(spare, n, lines, n_sides, other)
    if n < 3:
        return 0
    u_t, v_t, w_t, a_t, b_t, error_t = plane_of(t, faces, uvw, state, slot, planes, rounding)
    u_m, v_m, w_m, a_m, b_m, error_m = plane_of(m, faces, uvw, state, slot, planes, rounding)
    least, most, first, apart = np.inf, -np.inf, 0.0, -np.inf
    x0 = y0 = np.inf
    x1 = y1 = -np.inf
    for p in range(n):
        x, y = spare[p, 0], spare[p, 1]
        x0, x1, y0, y1 = min(x0, x), max(x1, x), min(y0, y), max(y1, y)
        mine = w_t + a_t * (x - u_t) + b_t * (y - v_t)
        its = w_m + a_m * (x - u_m) + b_m * (y - v_m)
        nearer = its - mine
        if p == 0:
            first = nearer
        apart = max(apart, abs(nearer) - TIE * max(mine, its))
        least, most = min(least, nearer), max(most, nearer)
    # Two planes meet along an edge that the faces share, and nowhere else.
    i, j, k = faces[t, 0], faces[t, 1], faces[t, 2]
    shared = 0
    for p in range(3):
        if faces[m, p] in (i, j, k):
            shared += 1
    error = error_t + error_m
    common = abs(twice_area(spare, n)) / 2
    if abs(apart) <= error or (apart > 0 and max(most, -least) <= error):
        blur[t] += common
    elif apart > 0 and shared < 2 and least <= error and most >= -error:
        strip = error / length(a_m - a_t, b_m - b_t, 0.0) * length(x1 - x0, y1 - y0, 0.0)
        blur[t] += min(strip, common)
    if apart <= 0:
        return 1 if m < t else 0
    if shared >= 2:
        return 1 if most > -least else 0
    if most <= 0:
        return 0
    if least >= 0:
        return 1
    # first + (a_m - a_t)(x - x0) + (b_m - b_t)(y - y0) >= 0
    lines[n_sides, 0], lines[n_sides, 1] = spare[0, 0], spare[0, 1]
    lines[n_sides, 2], lines[n_sides, 3], lines[n_sides, 4] = b_m - b_t, a_t - a_m, first
    return 2


@inlined
def is_beyond(lines, n_lines, x0, x1, y0, y1):
    """Whether a line has a whole rectangle beyond it."""
    for s in range(n_lines):
        dx, dy = lines[s, 2], lines[s, 3]
        x = x0 if dy > 0 else x1
        y = y1 if dx > 0 else y0
        if dx * (y - lines[s, 1]) - dy * (x - lines[s, 0]) + lines[s, 4] <= 0:
            return True
    return False


@compiled
def covers(lines, n_lines, corners, n):
    """Whether all corners of a polygon are on the inner side of all lines."""
    for s in range(n_lines):
        x, y, dx, dy, c = lines[s, 0], lines[s, 1], lines[s, 2], lines[s, 3], lines[s, 4]
        for p in range(n):
            if dx * (corners[p, 1] - y) - dy * (corners[p, 0] - x) + c < 0:
                return False
    return True


@compiled
def find_occluders(
    t, mark, target, n, own, n_own, faces, uvw, side, state, box, slot, polygons, n_corners, sides,
    planes, grid, columns, rows, starts, listed, rounding, marks, found, found_lines, corners,
    lines, spare, other, blur,
):  # fmt: skip
    """Faces that hide a part of face t; how many, -1 for want of room, -2 if one hides all of it.

    Parameters
    ----------
    t, target, n, own, n_own
        The face, its image and the lines that bound it.
    mark, marks : int, (F,) int64
        Number of the search, and that of the last one that looked at each face.
    found : (N,) int32
        Out: the faces.
    found_lines : (N, 6) float64
        Out: 1, or 2 and the line of equal depth for a face that is nearer only on one side of it.
    blur : (F,) float64
        What rounding may do along the outlines of the faces found, and to who is nearer, is added
        to that of t, px^2.
    """
    behind = box[t, 4] * (1 - 2 * TIE)
    x0, x1, y0, y1 = box[t, 0], box[t, 1], box[t, 2], box[t, 3]
    left, right = cell(x0, grid[0], grid[2], columns), cell(x1, grid[0], grid[2], columns)
    top, bottom = cell(y0, grid[1], grid[3], rows), cell(y1, grid[1], grid[3], rows)
    is_large = (right - left) * (bottom - top) > 4
    count = 0
    for row in range(top, bottom + 1):
        for column in range(left, right + 1):
            if is_large and is_beyond(
                own, n_own, grid[0] + column / grid[2], grid[0] + (column + 1) / grid[2],
                grid[1] + row / grid[3], grid[1] + (row + 1) / grid[3],
            ):  # fmt: skip
                continue
            at = row * columns + column
            for entry in range(starts[at], starts[at + 1]):
                m = listed[entry]
                if box[m, 5] < behind or box[m, 0] >= x1 or box[m, 1] <= x0:
                    continue
                if box[m, 2] >= y1 or box[m, 3] <= y0 or marks[m] == mark or m == t:
                    continue
                marks[m] = mark
                if is_beyond(own, n_own, box[m, 0], box[m, 1], box[m, 2], box[m, 3]):
                    continue
                across = min(x1, box[m, 1]) - max(x0, box[m, 0])
                down = min(y1, box[m, 3]) - max(y0, box[m, 2])
                if state[m] & DOUBTFUL:
                    outline_off = blur_of(m, state, slot, planes, rounding)
                    blur[t] += 4 * EDGE_ON * (across + down) * outline_off
                    if state[m] & THIN:
                        continue
                k, n_sides = outline(
                    m, faces, uvw, side, state, slot, polygons, n_corners, sides, corners, lines
                )
                if separated(lines, n_sides, target, n) or separated(own, n_own, corners, k):
                    continue
                relation = before(
                    t, m, target, n, lines, n_sides, faces, uvw, box, state, slot, planes, rounding,
                    spare, other, blur,
                )  # fmt: skip
                if relation == 0:
                    continue
                if relation == 1 and covers(lines, n_sides, target, n):
                    return -2
                if count == found.shape[0]:
                    return -1
                blur[t] += 4 * (across + down) * blur_of(m, state, slot, planes, rounding)
                found[count] = m
                found_lines[count, 0] = relation
                for p in range(5):
                    found_lines[count, 1 + p] = lines[n_sides, p]
                count += 1
    return count


@compiled
def subtract(
    polygon, n, pool, first, last, found, found_lines, faces, uvw, side, state, slot, polygons,
    n_corners, sides, pieces, n_of, rounding, corners, lines, spare, values,
):  # fmt: skip
    """Twice the area of a polygon that some of the faces found leave, -1 for want of room.

    Parameters
    ----------
    pool, first, last : (N,) int32, int, int
        Which of the faces found, by their place there, are to be taken from the polygon.
    """
    for p in range(n):
        pieces[0, p, 0], pieces[0, p, 1] = polygon[p, 0], polygon[p, 1]
    n_of[0], count = n, np.int64(1)
    for index in range(first, last):
        which = pool[index]
        _, n_lines = outline(
            found[which], faces, uvw, side, state, slot, polygons, n_corners, sides, corners, lines
        )
        n_sides = n_lines
        if found_lines[which, 0] == 2:
            for p in range(5):
                lines[n_sides, p] = found_lines[which, 1 + p]
            n_lines += 1
        count = take_away(pieces, n_of, count, lines, n_sides, n_lines, rounding, spare, values)
        if count == 0:
            return 0.0
        if count < 0:
            return -1.0
    twice = 0.0
    for p in range(count):
        twice += max(twice_area(pieces[p], n_of[p]), 0.0)
    return twice


@compiled
def halve(parts, n_part, ranges, top, line, pool, found, box, spare):
    """Put the two halves of the part on top of the stack in its place; 0 if that separates little.

    Parameters
    ----------
    parts, n_part : (STACK, 24, 2) float64, (STACK,) int64
        Convex parts of one face, and their corner counts.
    ranges : (STACK, 2) int64
        Their occluders: pool[ranges[s, 0]] ... pool[ranges[s, 1] - 1]. What lies above the range of
        the top part is free.
    line, spare : (5,) float64, (64, 2) float64
        Scratch; c of the line is 0.
    """
    n, low, high = n_part[top], ranges[top, 0], ranges[top, 1]
    x0 = y0 = np.inf
    x1 = y1 = -np.inf
    for p in range(n):
        spare[p, 0], spare[p, 1] = parts[top, p, 0], parts[top, p, 1]
        x0, x1 = min(x0, spare[p, 0]), max(x1, spare[p, 0])
        y0, y1 = min(y0, spare[p, 1]), max(y1, spare[p, 1])
    axis = 0 if x1 - x0 >= y1 - y0 else 1
    middle = (x0 + x1) / 2 if axis == 0 else (y0 + y1) / 2
    end = high
    n_halves = 0
    for half in range(2):
        start = end
        for k in range(low, high):
            m = found[pool[k]]
            if (box[m, 2 * axis] < middle) if half == 0 else (box[m, 2 * axis + 1] > middle):
                pool[end] = pool[k]
                end += 1
        ranges[top + half, 0], ranges[top + half, 1] = start, end
    if end - high > 1.7 * (high - low):
        ranges[top, 0], ranges[top, 1] = low, high
        return 0
    for half in range(2):
        inward = -1.0 if half == 0 else 1.0
        line[0] = line[1] = middle
        line[2], line[3] = (0.0, -inward) if axis == 0 else (inward, 0.0)
        first, last = ranges[top + half, 0], ranges[top + half, 1]
        kept = keep_inside(spare, n, line, parts[top + n_halves])
        if kept >= 3:
            n_part[top + n_halves] = kept
            ranges[top + n_halves, 0], ranges[top + n_halves, 1] = first, last
            n_halves += 1
    return n_halves


@compiled
def visible_areas(
    targets, first, faces, uvw, side, state, box, area, slot, polygons, n_corners, sides, planes,
    size, rounding, grid, columns, rows, starts, listed, marks, found, found_lines, pool, pieces,
    n_of, visible, blur,
):  # fmt: skip
    """Visible px^2 of faces; how many of `targets` are done.

    Where it stops short there is too little scratch memory: give more and go on from there.

    Parameters
    ----------
    targets : (N,) int32
        Faces to measure.
    first : int
        Those before this one are done.
    faces ... planes
        As `set_up` left them.
    size : (2,) float64
        Width and height of the image.
    rounding : (2,) float64
        Largest error of a position in the image, in pixels, and of 1/z, relative.
    grid, columns, rows, starts, listed
        As `fill_grid` left them.
    marks : (F,) int64
        Scratch: anything below 0 at the start of each pose.
    found, found_lines, pool : (N,) int32, (N, 6) float64, (8 N,) int32
        Scratch, for N occluders of one face.
    pieces, n_of : (M, WIDTH, 2) float64, (M,) int64
        Scratch, for M pieces of one face.
    visible : (F,) float64
        Out: px^2 inside the image, for the targets.
    blur : (F,) float64
        Out: a bound of the errors of `visible` and `area` together, px^2, for the targets.
    """
    target, corners = np.empty((2 * CORNERS, 2)), np.empty((CORNERS, 2))
    spare, other, values = np.empty((WIDTH, 2)), np.empty((WIDTH, 2)), np.empty(WIDTH)
    lines, own, border = np.empty((SIDES + 1, 5)), np.empty((SIDES, 5)), image_border(size)
    parts, n_part = np.empty((STACK, 2 * CORNERS, 2)), np.empty(STACK, np.int64)
    ranges, line = np.empty((STACK, 2), np.int64), np.zeros(5)
    for index in range(first, targets.shape[0]):
        t = targets[index]
        visible[t] = blur[t] = 0.0
        if not state[t] & (LIVE | THIN):
            continue
        width = min(box[t, 1], size[0]) - max(box[t, 0], 0.0)
        height = min(box[t, 3], size[1]) - max(box[t, 2], 0.0)
        if state[t] & THIN:
            blur[t] = 4 * EDGE_ON * (width + height) * blur_of(t, state, slot, planes, rounding)
            continue
        blur[t] = OUTLINE * (width + height) * blur_of(t, state, slot, planes, rounding)
        n, n_own = outline(
            t, faces, uvw, side, state, slot, polygons, n_corners, sides, target, own
        )
        if state[t] & PARTLY:
            n = cut(target, n, border, border.shape[0], spare)
        count = find_occluders(
            t, t, target, n, own, n_own, faces, uvw, side, state, box, slot, polygons, n_corners,
            sides, planes, grid, columns, rows, starts, listed, rounding, marks, found, found_lines,
            corners, lines, spare, other, blur,
        )  # fmt: skip
        if count == -1:
            marks[:] = -1
            return index
        if count == -2:
            continue
        if count == 0:
            visible[t] = area[t]
            continue
        for p in range(n):
            parts[0, p, 0], parts[0, p, 1] = target[p, 0], target[p, 1]
        for k in range(count):
            pool[k] = k
        n_part[0], ranges[0, 0], ranges[0, 1] = n, 0, count
        top, twice = 1, 0.0
        while top > 0:
            top -= 1
            n, low, high = n_part[top], ranges[top, 0], ranges[top, 1]
            n_halves = 0
            if (
                high - low > MOST_OCCLUDERS
                and top + 2 < STACK
                and high + 2 * (high - low) <= (pool.shape[0])
            ):
                n_halves = halve(parts, n_part, ranges, top, line, pool, found, box, spare)
            if n_halves > 0:
                top += n_halves
                continue
            rest = subtract(
                parts[top], n, pool, low, high, found, found_lines, faces, uvw, side, state, slot,
                polygons, n_corners, sides, pieces, n_of, rounding[0], corners, lines, spare,
                values,
            )  # fmt: skip
            if rest < 0:
                marks[:] = -1
                return index
            twice += rest
        # What rounding leaves of a face that is all hidden is nothing, and of one that is not, all.
        residue = rounding[0] * (box[t, 1] - box[t, 0] + box[t, 3] - box[t, 2])
        seen = twice / 2
        visible[t] = 0.0 if seen <= residue else area[t] if seen >= area[t] - residue else seen
    return targets.shape[0]
