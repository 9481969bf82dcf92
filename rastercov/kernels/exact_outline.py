"""Images of faces - outline, plane of 1/z, and the errors of both -, compiled by numba."""

from rastercov.kernels.exact_polygon import copy_polygon, line_at
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
from rastercov.kernels.jit import part_with_arrays


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
    faces, uvw = projected.faces, projected.uvw
    second, third = (1, 2) if projected.side[f] < 0 else (2, 1)
    i, j, k = faces[f, 0], faces[f, second], faces[f, third]
    corners[0, U], corners[0, V] = uvw[i, U], uvw[i, V]
    corners[1, U], corners[1, V] = uvw[j, U], uvw[j, V]
    corners[2, U], corners[2, V] = uvw[k, U], uvw[k, V]
    for p in range(3):
        q = p + 1 if p < 2 else 0
        lines[p, U], lines[p, V] = corners[p, U], corners[p, V]
        lines[p, DU], lines[p, DV] = corners[q, U] - corners[p, U], corners[q, V] - corners[p, V]
        lines[p, OFFSET] = 0.0
    return 3, 3


@part_with_arrays
def n_sides_of(f, projected):
    """Number of lines that bound the image of a live face."""
    return SIDES if projected.state[f] & CLIPPED else 3


@part_with_arrays
def side_of(f, s, projected):
    """Line s of the outline of a live face, as `outline` fills it."""
    if projected.state[f] & CLIPPED:
        return line_at(projected.clipped.lines[projected.clipped_index[f]], s)
    faces, uvw = projected.faces, projected.uvw
    is_back = projected.side[f] < 0  # the corners of a face seen from the front in reverse
    p = faces[f, s if is_back or s == 0 else 3 - s]
    q = faces[f, (s + 1) % 3 if is_back else 2 - s]
    u, v = uvw[p, U], uvw[p, V]
    return u, v, uvw[q, U] - u, uvw[q, V] - v, 0.0


@part_with_arrays
def is_joined(f, s, n_lines, edges, is_event, projected):
    """True if the surface continues beyond line s of the outline of a face: it is no event edge.

    Never where one of the two faces is clipped in space: its lines may be known to few digits, and
    the near plane may cut it away.
    """
    if n_lines == SIDES:
        return False
    # The corners of a face seen from the front are taken in reverse.
    e = edges.of_face[f, s if projected.side[f] < 0 else 2 - s]
    if is_event[e] or edges.faces[e, 1] < 0:
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
