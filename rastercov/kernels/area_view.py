"""Field of view of a lens in the plane of a face: convex parts that the image shows; by numba.

The field of view is a tree of lines of an ideal plane (`lens_field`). A line
a x + b y + c = 0 there is the plane a X + b Y + c Z = 0 through the camera, and so a line in the
plane of the face: polygons need not be projected.
"""

import math

from rastercov.kernels.area_density import extent_of
from rastercov.kernels.area_plane import (
    COINCIDENT_REL,
    ERROR,
    LONGEST,
    ORIGIN,
    STACK_ROOM,
    X_AXIS,
    Y_AXIS,
    append_piece,
    length2,
    perimeter_of,
    push_parts,
)
from rastercov.kernels.exact_polygon import MOST_CORNERS, copy_polygon, keep_inside, twice_area
from rastercov.kernels.exact_records import U, V
from rastercov.kernels.jit import allocation_free, part_with_arrays
from rastercov.kernels.lens_field import BAND, BORDER, INSIDE, UNDECIDED


@part_with_arrays
def line_in_plane(line, plane):
    """Value, its slopes along x and y, and its error, of a line of the ideal plane."""
    a, b, c = line[0], line[1], line[2]
    return (
        a * plane[ORIGIN] + b * plane[ORIGIN + 1] + c * plane[ORIGIN + 2],
        a * plane[X_AXIS] + b * plane[X_AXIS + 1] + c * plane[X_AXIS + 2],
        a * plane[Y_AXIS] + b * plane[Y_AXIS + 1] + c * plane[Y_AXIS + 2],
        plane[ERROR] * (abs(a) + abs(b) + abs(c)),
    )


@allocation_free
def is_in_view(corners, n, plane, criteria):
    """True if a polygon lies in one cell of the tree that is inside the image, without a cut."""
    tree = criteria.tree
    node = tree.root
    while node >= 0:
        value, along_x, along_y, error = line_in_plane(tree.lines[node], plane)
        is_inside = is_outside = True
        for p in range(n):
            at = value + along_x * corners[p, U] + along_y * corners[p, V]
            is_inside = is_inside and at > error
            is_outside = is_outside and at < -error
        if not (is_inside or is_outside):
            return False
        node = tree.children[node, 0 if is_inside else 1]
    return node == INSIDE


@allocation_free
def append_in_view(face, polygon, n, criteria, scratch, out):
    """Append the part of a polygon that the image of the lens shows.

    Parameters
    ----------
    face, polygon, n, rules
        A convex polygon of the face; LensCriteria, whose undecided cells are added to the bound.
    scratch, out
        Scratch, with the face in `plane`; Found.
    """
    plane, views, nodes, part = scratch.plane, scratch.views, scratch.nodes, scratch.seen
    tree = criteria.tree
    nearest = max(COINCIDENT_REL * plane[LONGEST], plane[ERROR])
    top = push_parts(polygon, n, views)
    for p in range(top):
        nodes[p] = tree.root
    while top > 0:
        top -= 1
        node, n = nodes[top], views.n_corners[top]
        copy_polygon(views.corners[top], n, part)
        while node >= 0:
            kind = tree.kinds[node]
            if kind == BAND:
                area = twice_area(part, n) / 2
                if area <= criteria.strip_gap * extent_of(part, n):
                    node = UNDECIDED
                    break
            value, along_x, along_y, error = line_in_plane(tree.lines[node], plane)
            least, most = math.inf, -math.inf
            for p in range(n):
                at = value + along_x * part[p, U] + along_y * part[p, V]
                least, most = min(least, at), max(most, at)
            if kind == BORDER and least < error and most > -error:
                slope = length2(along_x, along_y)
                strip = twice_area(part, n) / 2
                if slope > 0:
                    strip = min(strip, error / slope * perimeter_of(part, n))
                out.bound[face] += max(strip, 0.0)
            if least >= 0:
                node = tree.children[node, 0]
            elif most <= 0:
                node = tree.children[node, 1]
            else:
                beyond = tree.children[node, 1]
                line = (0.0, 0.0, -along_y, along_x, -value)
                if beyond in (UNDECIDED, INSIDE) or beyond >= 0:
                    m = keep_inside(part, n, line, views.corners[top])
                    if m >= 3 and (beyond == UNDECIDED or top + 2 > STACK_ROOM):
                        out.bound[face] += max(twice_area(views.corners[top], m) / 2, 0.0)
                    elif m >= 3:
                        views.n_corners[top], nodes[top] = m, beyond
                        top += 1
                n = keep_inside(part, n, (0.0, 0.0, along_y, -along_x, value), scratch.spare)
                copy_polygon(scratch.spare, n, part)
                if n < 3:
                    break
                node = tree.children[node, 0]
                if n > 2 * MOST_CORNERS and top + 2 <= STACK_ROOM:
                    # A chord divides what has many corners.
                    half = n // 2
                    corners = views.corners[top]
                    for p in range(half, n):
                        corners[p - half, U], corners[p - half, V] = part[p, U], part[p, V]
                    corners[n - half, U], corners[n - half, V] = part[0, U], part[0, V]
                    views.n_corners[top], nodes[top] = n - half + 1, node
                    top += 1
                    n = half + 1
        if n < 3:
            continue
        if node == INSIDE:
            append_piece(face, part, n, nearest, scratch.tidy, out)
        elif node == UNDECIDED:
            out.bound[face] += max(twice_area(part, n) / 2, 0.0)
