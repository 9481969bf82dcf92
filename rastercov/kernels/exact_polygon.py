"""Convex polygons in the image and in space: clipping, splitting, outlines; compiled by numba.

A polygon is an array of corners, clockwise in the image (v down), with a corner count. A line is
(u0, v0, du, dv, offset), see `rastercov.kernels.exact_records`. The image of a face is its outline
and the plane of 1/z, with the errors of both.

I. Sutherland, G. Hodgman. Reentrant Polygon Clipping. 1974.
"""

import numpy as np

from rastercov.kernels.exact_records import (
    CLIPPED,
    DOUBTFUL,
    DU,
    DV,
    LIVE,
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

MOST_CORNERS = 20
"""Corners of a piece; one that gets more is split."""


@part_with_arrays
def length(x, y, z):
    """Length of a vector."""
    return np.sqrt(x * x + y * y + z * z)


@part_with_arrays
def line_at(lines, s):
    """Row of `lines` as a tuple."""
    return lines[s, U], lines[s, V], lines[s, DU], lines[s, DV], lines[s, OFFSET]


@part_of
def line_value(line, u, v):
    """Signed value of a line at a point: positive on its inner side."""
    u0, v0, du, dv, offset = line
    return du * (v - v0) - dv * (u - u0) + offset


@part_with_arrays
def copy_polygon(source, n, target):
    """Copy the first n corners."""
    for p in range(n):
        target[p, U], target[p, V] = source[p, U], source[p, V]


@part_with_arrays
def corners_of_part(first, n):
    """Corners of the part of a polygon from corner `first` on, see `copy_part`."""
    return min(MOST_CORNERS, n - first + 1)


@part_with_arrays
def copy_part(polygon, first, m, target):
    """Copy corner 0 and m - 1 corners from `first` on; the next part begins at `first` + m - 2.

    Parts of at most `MOST_CORNERS` corners divide a convex polygon from 1 on.
    """
    target[0, U], target[0, V] = polygon[0, U], polygon[0, V]
    copy_polygon(polygon[first:], m - 1, target[1:])


@part_with_arrays
def store_piece(face, polygon, n, kept):
    """Append a polygon to the pieces that are handed out, if anyone asks for them."""
    if kept.corners.shape[0] > 0:
        piece, at = kept.used[0], kept.used[1]
        if piece < kept.faces.shape[0] and at + n <= kept.corners.shape[0]:
            copy_polygon(polygon, n, kept.corners[at:])
            kept.faces[piece] = face
            kept.starts[piece + 1] = at + n
        else:
            kept.used[2] = 1
        kept.used[0], kept.used[1] = piece + 1, at + n


@part_with_arrays
def drop_pieces(kept, n_pieces, n_corners):
    """Take back all pieces after the first `n_pieces`, which have `n_corners` corners."""
    kept.used[0], kept.used[1] = n_pieces, n_corners


@allocation_free
def keep_inside(polygon, n, line, out):
    """Clip a polygon to the inner side of a line; returns the corner count of `out`."""
    kept = 0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        here = line_value(line, polygon[i, U], polygon[i, V])
        there = line_value(line, polygon[j, U], polygon[j, V])
        if here >= 0 and kept < out.shape[0]:
            out[kept, U] = polygon[i, U]
            out[kept, V] = polygon[i, V]
            kept += 1
        crosses = (here > 0 and there < 0) or (here < 0 and there > 0)
        if crosses and kept < out.shape[0]:
            t = here / (here - there)
            out[kept, U] = polygon[i, U] + t * (polygon[j, U] - polygon[i, U])
            out[kept, V] = polygon[i, V] + t * (polygon[j, V] - polygon[i, V])
            kept += 1
    return kept


@allocation_free
def clip(polygon, n, lines, n_lines, spare):
    """Clip a polygon in place to the inner side of some lines; returns its corner count."""
    for s in range(n_lines):
        n = keep_inside(polygon, n, line_at(lines, s), spare)
        copy_polygon(spare, n, polygon)
    return n


@allocation_free
def twice_area(polygon, n):
    """Twice the signed area, positive for a clockwise polygon."""
    total = 0.0
    u, v = polygon[0, U], polygon[0, V]
    for i in range(1, n - 1):
        total += (polygon[i, U] - u) * (polygon[i + 1, V] - v) - (polygon[i + 1, U] - u) * (
            polygon[i, V] - v
        )
    return total


@part_with_arrays
def extent_of(polygon, n):
    """Bounds of a polygon: least and greatest u, least and greatest v."""
    u_min = u_max = polygon[0, U]
    v_min = v_max = polygon[0, V]
    for p in range(1, n):
        u_min, u_max = min(u_min, polygon[p, U]), max(u_max, polygon[p, U])
        v_min, v_max = min(v_min, polygon[p, V]), max(v_max, polygon[p, V])
    return u_min, u_max, v_min, v_max


@part_with_arrays
def side_at(polygon, n, i):
    """Side i of a polygon of n corners as a line through its first corner: (x, y, dx, dy, 0)."""
    j = i + 1 if i + 1 < n else 0
    x, y = polygon[i, 0], polygon[i, 1]
    return x, y, polygon[j, 0] - x, polygon[j, 1] - y, 0.0


@part_with_arrays
def values_on_line(polygon, n, line, slack, values):
    """Fill `values` with those of a line at the corners, 0 within the slack; least and greatest.

    Neither is beyond 0, so that it is 0 for a polygon on one side of the line.
    """
    least = most = 0.0
    for p in range(n):
        value = line_value(line, polygon[p, U], polygon[p, V])
        values[p] = value if abs(value) > slack else 0.0
        least, most = min(least, values[p]), max(most, values[p])
    return least, most


@part_with_arrays
def separates(lines, n_lines, corners, n):
    """True if one of the lines has all corners of a polygon on its outer side or on itself.

    Exact for two faces on both sides of an edge they share: the value at a shared corner is 0 to
    the bit, whatever the rounding elsewhere.
    """
    for s in range(n_lines):
        line = line_at(lines, s)
        is_beyond = True
        for p in range(n):
            if line_value(line, corners[p, U], corners[p, V]) > 0:
                is_beyond = False
                break
        if is_beyond:
            return True
    return False


@part_with_arrays
def separates_box(lines, n_lines, u_min, u_max, v_min, v_max):
    """True if one of the lines has a whole rectangle on its outer side or on itself."""
    for s in range(n_lines):
        line = line_at(lines, s)
        u = u_min if lines[s, DV] > 0 else u_max
        v = v_max if lines[s, DU] > 0 else v_min
        if line_value(line, u, v) <= 0:
            return True
    return False


@allocation_free
def contains(lines, n_lines, corners, n):
    """True if all corners of a polygon are on the inner side of all lines."""
    for s in range(n_lines):
        line = line_at(lines, s)
        for p in range(n):
            if line_value(line, corners[p, U], corners[p, V]) < 0:
                return False
    return True


@allocation_free
def split(polygon, n, values, inside, outside):
    """Split a convex polygon where `values` change sign; corner counts of the two parts."""
    kept = lost = 0
    room = min(inside.shape[0], outside.shape[0]) - 2
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        if kept >= room or lost >= room:
            break
        if values[i] >= 0:
            inside[kept, U] = polygon[i, U]
            inside[kept, V] = polygon[i, V]
            kept += 1
        if values[i] <= 0:
            outside[lost, U] = polygon[i, U]
            outside[lost, V] = polygon[i, V]
            lost += 1
        if (values[i] > 0 and values[j] < 0) or (values[i] < 0 and values[j] > 0):
            t = values[i] / (values[i] - values[j])
            u = polygon[i, U] + t * (polygon[j, U] - polygon[i, U])
            v = polygon[i, V] + t * (polygon[j, V] - polygon[i, V])
            inside[kept, U] = outside[lost, U] = u
            inside[kept, V] = outside[lost, V] = v
            kept += 1
            lost += 1
    return kept, lost


@part_with_arrays
def copy_second_half(polygon, n, target):
    """Copy the part of a polygon beyond the chord from corner n // 2 to corner 0; its corners."""
    half = n // 2
    copy_polygon(polygon[half:], n - half, target)
    target[n - half, U], target[n - half, V] = polygon[0, U], polygon[0, V]
    return n - half + 1


@allocation_free
def limit_corners(pieces, at, count):
    """Split a piece of more than `MOST_CORNERS` corners along chords; returns the piece count.

    The parts after the first are appended. `clip_subtract` makes sure that there is room for them.
    """
    corners, n_corners = pieces.corners, pieces.n_corners
    while n_corners[at] > MOST_CORNERS:
        n = n_corners[at]
        n_corners[count] = copy_second_half(corners[at], n, corners[count])
        n_corners[at] = n // 2 + 1
        count += 1
    return count


@allocation_free
def clip_subtract(pieces, count, lines, n_sides, n_lines, tolerance, spare, values):
    """Subtract a convex occluder from `count` pieces; returns their new count, -1 for lack of room.

    Each line of the occluder slices off the part of a piece beyond it; these parts stay, the rest
    is hidden.

    Parameters
    ----------
    lines : (n_lines or more, 5) float64
        Lines with the occluder on their inner side: first its `n_sides` sides, then, where it is in
        front only in part, the line of equal depth.
    tolerance : float
        Pixels from a line up to which a corner is on it. Without it the slivers that rounding
        leaves along the common side of two occluders are split by every line near them, and double
        with each.
    spare, values : (PIECE_ROOM, 2), (PIECE_ROOM,) float64
        Scratch.
    """
    corners, n_corners = pieces.corners, pieces.n_corners
    old, i = count, 0
    while i < old:
        n = n_corners[i]
        # Bit mask of the lines that split the piece. A side that has all of it beyond ends the
        # search: the piece is not hidden.
        splitting, missed = 0, False
        for s in range(n_lines):
            line = line_at(lines, s)
            slack = tolerance * (abs(lines[s, DU]) + abs(lines[s, DV]))
            least, most = 0.0, 0.0
            for p in range(n):
                value = line_value(line, corners[i, p, U], corners[i, p, V])
                least = min(least, value)
                most = max(most, value)
            if most <= slack and s < n_sides:
                missed = True
                break
            if least < -slack:
                splitting |= 1 << s
        if missed:
            i += 1
            continue
        if count + 4 * n_lines + 4 > corners.shape[0]:
            return -1
        is_hidden = True
        for s in range(n_lines):
            if not splitting >> s & 1:
                continue
            line = line_at(lines, s)
            slack = tolerance * (abs(lines[s, DU]) + abs(lines[s, DV]))
            n = n_corners[i]
            least, most = values_on_line(corners[i], n, line, slack, values)
            if most == 0:
                is_hidden = False
                break
            if least < 0:
                kept, lost = split(corners[i], n, values, spare, corners[count])
                if lost >= 3:
                    n_corners[count] = lost
                    count = limit_corners(pieces, count, count + 1)
                copy_polygon(spare, kept, corners[i])
                n_corners[i] = kept
                if kept < 3:
                    break
        if not is_hidden:
            count = limit_corners(pieces, i, count)
            i += 1
            continue
        # Piece i is gone: the last piece takes its place, a new one or an old one still to be done.
        is_new = count > old
        last = count - 1
        if i < last:
            n_corners[i] = n_corners[last]
            copy_polygon(corners[last], n_corners[last], corners[i])
        count = last
        if is_new:
            i += 1
        else:
            old = last
    return count


@part_with_arrays
def outline(f, projected, corners, lines):
    """Fill `corners` and `lines` with the image of a live face; number of corners and of lines.

    It is clipped to the border of the image only if the face is clipped in space.
    """
    if projected.state[f] & CLIPPED:
        s, clipped = projected.clipped_index[f], projected.clipped
        copy_polygon(clipped.polygons[s], clipped.n_corners[s], corners)
        for p in range(SIDES):
            for column in range(OFFSET + 1):
                lines[p, column] = clipped.lines[s, p, column]
        return clipped.n_corners[s], SIDES
    for p in range(3):
        line = side_of(f, p, projected)
        corners[p, U], corners[p, V] = line[U], line[V]
        for column in range(OFFSET + 1):
            lines[p, column] = line[column]
    return 3, 3


@part_with_arrays
def n_sides_of(f, projected):
    """Number of lines that bound the image of a live face."""
    return SIDES if projected.state[f] & CLIPPED else 3


@part_with_arrays
def ends_of_side(f, s, projected):
    """Vertices at the ends of side s of a live face, clockwise in the image.

    The corners of a face seen from the front are taken in reverse.
    """
    faces = projected.faces
    if projected.side[f] < 0:
        return faces[f, s], faces[f, (s + 1) % 3]
    return faces[f, s if s == 0 else 3 - s], faces[f, 2 - s]


@part_with_arrays
def side_of(f, s, projected):
    """Line s of the outline of a live face, as `outline` fills it."""
    if projected.state[f] & CLIPPED:
        return line_at(projected.clipped.lines[projected.clipped_index[f]], s)
    p, q = ends_of_side(f, s, projected)
    uvw = projected.uvw
    u, v = uvw[p, U], uvw[p, V]
    return u, v, uvw[q, U] - u, uvw[q, V] - v, 0.0


@part_with_arrays
def is_joined(f, s, n_lines, view):
    """True if the surface continues beyond line s of the outline of a face: it is no event edge.

    Never where one of the two faces is clipped in space: its lines may be known to few digits, and
    the near plane may cut it away.
    """
    if n_lines == SIDES:
        return False
    edges, projected = view.edges, view.projected
    # The corners of a face seen from the front are taken in reverse.
    e = edges.of_face[f, s if projected.side[f] < 0 else 2 - s]
    if view.is_event[e] or edges.faces[e, 1] < 0:
        return False
    other = edges.faces[e, 0] if edges.faces[e, 0] != f else edges.faces[e, 1]
    return projected.state[other] & (LIVE | CLIPPED | DOUBTFUL) == LIVE


@part_with_arrays
def outline_error(f, camera, projected):
    """Largest error of the outline of a face, pixels."""
    if not projected.state[f] & CLIPPED:
        return camera.pixel_error
    plane = projected.clipped_index[f]
    return max(camera.pixel_error, projected.clipped.planes[plane, OUTLINE_ERROR])


@part_with_arrays
def plane_of(f, camera, projected):
    """Plane of a face: a point (u, v, w), the slopes of w along u and v, and the error of w.

    The error includes that of the corners and of the arithmetic here, anywhere in the face.
    """
    if projected.state[f] & CLIPPED:
        planes, s = projected.clipped.planes, projected.clipped_index[f]
        return (
            planes[s, U], planes[s, V], planes[s, W],
            planes[s, SLOPE_U], planes[s, SLOPE_V], planes[s, W_ERROR],
        )  # fmt: skip
    faces, uvw = projected.faces, projected.uvw
    i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
    u, v, w = uvw[i, U], uvw[i, V], uvw[i, W]
    u1, v1, w1 = uvw[j, U] - u, uvw[j, V] - v, uvw[j, W] - w
    u2, v2, w2 = uvw[k, U] - u, uvw[k, V] - v, uvw[k, W] - w
    twice = u1 * v2 - u2 * v1
    a, b = (w1 * v2 - w2 * v1) / twice, (u1 * w2 - u2 * w1) / twice
    # The slope across a needle is known to few digits.
    change = abs(w1) + abs(w2)
    skew = (abs(u1) + abs(u2)) * (abs(v1) + abs(v2)) / abs(twice)
    error = camera.w_error_rel * (w + change * skew) + camera.pixel_error * (abs(a) + abs(b))
    return u, v, w, a, b, error


@part_with_arrays
def cut_in_space(points, n, a, b, c, d, spare):
    """Keep the part of a polygon in space with a X + b Y + c Z >= d, in place; its corner count."""
    kept = 0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        here = a * points[i, 0] + b * points[i, 1] + c * points[i, 2] - d
        there = a * points[j, 0] + b * points[j, 1] + c * points[j, 2] - d
        if here >= 0 and kept < spare.shape[0]:
            for k in range(3):
                spare[kept, k] = points[i, k]
            kept += 1
        if ((here > 0 and there < 0) or (here < 0 and there > 0)) and kept < spare.shape[0]:
            t = here / (here - there)
            for k in range(3):
                spare[kept, k] = points[i, k] + t * (points[j, k] - points[i, k])
            kept += 1
    for i in range(kept):
        for k in range(3):
            points[i, k] = spare[i, k]
    return kept


@part_with_arrays
def along(pose, axis, vertices, vertex):
    """Coordinate of a vertex along an axis of a camera, metres."""
    total = 0.0
    for k in range(3):
        total += (vertices[vertex, k] - pose[k, 3]) * pose[k, axis]
    return total


@allocation_free
def least_depth(vertices, faces, pose, sides, near, enough, polygon, spare):
    """Least depth of faces beyond `near` inside a pyramid, metres; `enough` where none is less.

    On each face it lies on a corner of what the pyramid cuts from it: a vertex, an edge through a
    side of the pyramid, or the face where an edge of the pyramid pierces it.

    Parameters
    ----------
    vertices, faces : (V, 3) float64, (F, 3) int64
    pose : (4, 4) float64
        world_from_camera.
    sides : (S, 3) float64
        Normals of the sides in camera axes, inwards.
    near, enough : float
    polygon, spare : (16, 3) float64
        Scratch.
    """
    least = enough
    for f in range(faces.shape[0]):
        for corner in range(3):
            polygon[corner, 2] = along(pose, 2, vertices, faces[f, corner])
        depths = polygon[0, 2], polygon[1, 2], polygon[2, 2]
        if not (min(depths) < least and max(depths) >= near):
            continue
        for corner in range(3):
            for axis in range(2):
                polygon[corner, axis] = along(pose, axis, vertices, faces[f, corner])
        n = cut_in_space(polygon, np.int64(3), 0.0, 0.0, 1.0, near, spare)
        for side in range(sides.shape[0]):
            n = cut_in_space(polygon, n, sides[side, 0], sides[side, 1], sides[side, 2], 0.0, spare)
        for corner in range(n):
            least = min(least, polygon[corner, 2])
    return least
