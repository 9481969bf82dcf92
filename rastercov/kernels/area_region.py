"""Exact regions of the faces that a pose covers, in the planes of the faces; compiled by numba.

An image point (u, v) has the ray r = ((u - cx)/fx, (v - cy)/fy, 1) in camera axes and shows the
point P = z r of the plane n . P = -h at depth z = -h / (n . r). The visible pieces of
`rastercov.exact` are brought to the plane in this way; a face that is wholly visible in its part
of the image is cut in its own plane. Depth is affine in the plane, so focus and pixels per m^2 are
half planes, and so are the borders of the image and the near plane.

The angle of incidence is at most theta within h tan(theta) of the foot of the camera's
perpendicular, h being its height above the plane. The disc is replaced by the regular polygon of N
corners inscribed in it, whose corners lie in directions that depend on the camera and the plane
alone, so that it does not matter how the plane is cut into faces. The area between the chords and
the arc goes into the bound.

A piece is taken apart from the inside outwards: what lies within 8 chords is covered; beyond each
chord only the rectangle around its segment of the circle is looked at again, with 8 chords of its
own, down to the sides of the polygon.

Through a lens, `cut_regions` finds what the pinhole of an ideal plane sees, within the largest
angle of incidence. Three steps of `cut_pieces` follow, each from a list of pieces to another one;
the first and the last run only where a task asks for them:

- `TO_DISCS`: focus up to a distance;
- `TO_VIEW`: the field of view of the lens, and focus by depth;
- `TO_DENSITIES`: densities through the lens, and focus from a distance.

The curved borders of the field of view make most pieces, so discs come first.

The field of view is a tree of lines of an ideal plane (`lens_field`). A line
a x + b y + c = 0 there is the plane a X + b Y + c Z = 0 through the camera, and so a line in the
plane of the face: polygons need not be projected.
"""

import math
from collections import namedtuple

import numpy as np

from rastercov.kernels.area_plane import (
    COINCIDENT_REL,
    ERROR,
    FAR_LINE,
    FOCUS_LINE,
    FOOT_X,
    FOOT_Y,
    HEIGHT,
    LEFT,
    LONGEST,
    N_LINES,
    NEAR_LINE,
    NORMAL,
    ORIGIN,
    POSITION_ERROR_REL,
    STACK_ROOM,
    X_AXIS,
    Y_AXIS,
    append_dense,
    append_piece,
    cut_by_lines,
    extent_of,
    keep_beyond,
    least_and_most,
    length2,
    line_in_plane,
    lines_of,
    perimeter_of,
    push,
    push_parts,
    set_line,
)
from rastercov.kernels.exact_polygon import (
    MOST_CORNERS,
    copy_polygon,
    copy_second_half,
    keep_inside,
    line_at,
    line_value,
    twice_area,
)
from rastercov.kernels.exact_records import (
    DOUBTFUL,
    LINE_ERROR,
    LIVE,
    THIN,
    U,
    V,
)
from rastercov.kernels.jit import allocation_free, part_with_arrays
from rastercov.kernels.lens_field import BAND, BORDER, INSIDE, UNDECIDED

CHORDS = 8
"""Chords that an arc is divided by at a time."""


FEWEST_CHORDS, MOST_CHORDS = 16, 1 << 20
"""Corners of the polygon in the circle."""


LEAST_INNER_REL = math.cos(math.pi / FEWEST_CHORDS) * (1 - 1e-9)
"""Radius within the chords of any circle of incidence, relative to its own."""


TO_DISCS, TO_VIEW, TO_DENSITIES = range(3)
"""Steps of `cut_pieces`."""


FARTHEST = 2.0
"""Depth up to which a corner is brought back, relative to the deepest corner of its face."""


@part_with_arrays
def anchor(plane):
    """Direction in the plane of a face that the polygon's first corner lies in, (x, y).

    A tangent of the plane, in camera axes: continuous except for a plane seen exactly from behind.
    """
    x, y, z = plane[NORMAL], plane[NORMAL + 1], plane[NORMAL + 2]
    if plane[HEIGHT] < 0:
        x, y, z = -x, -y, -z
    a = 1.0 / max(1.0 - z, 1e-9)
    first = 1.0 - x * x * a
    second = -x * y * a
    along = first * plane[X_AXIS] + second * plane[X_AXIS + 1] + x * plane[X_AXIS + 2]
    across = first * plane[Y_AXIS] + second * plane[Y_AXIS + 1] + x * plane[Y_AXIS + 2]
    size = length2(along, across)
    return along / size, across / size


@part_with_arrays
def corner_of_circle(k, n, plane, radius, towards):
    """Corner k of the polygon of n corners in the circle."""
    angle = 2 * math.pi * k / n
    c, s = radius * math.cos(angle), radius * math.sin(angle)
    x = plane[FOOT_X] + (c * towards[0] - s * towards[1])
    y = plane[FOOT_Y] + (c * towards[1] + s * towards[0])
    return x, y


@part_with_arrays
def cap_of_chord(part, n, x0, y0, x1, y1, height, out, spare):
    """Part of a polygon in the rectangle beyond a chord that holds its segment; corner count.

    The segment must be less than half of the circle, `height` its greatest distance from the chord.
    """
    dx, dy = x1 - x0, y1 - y0
    # Beyond the chord, between its ends, and not beyond the tangent.
    n = keep_inside(part, n, (x0, y0, -dx, -dy, 0.0), spare)
    if n >= 3:
        n = keep_inside(spare, n, (x0, y0, dy, -dx, 0.0), out)
    if n >= 3:
        n = keep_inside(out, n, (x1, y1, -dy, dx, 0.0), spare)
    if n >= 3:
        size = length2(dx, dy)
        n = keep_inside(spare, n, (x0, y0, dx, dy, height * size), out)
    return n if n >= 3 else 0


@part_with_arrays
def append_within_angle(face, polygon, n, slope, criteria, scratch, out):
    """Append the part of a polygon within the largest angle of incidence.

    Parameters
    ----------
    face : int
        The face.
    polygon, n
        Convex, in the plane of the face.
    slope : float
        Tangent of the largest angle; 0 for no limit.
    criteria, scratch, out
        Criteria; Scratch, with the face in `plane`; Found, to whose bound the area is added that
        the polygon in the circle leaves undecided.
    """
    plane = scratch.plane
    height, error = abs(plane[HEIGHT]), plane[ERROR]
    radius = height * slope
    error *= 2 + slope
    wanted = math.pi * math.sqrt(radius / (2 * criteria.gap))
    n_chords = np.int64(min(max(math.ceil(wanted), FEWEST_CHORDS), MOST_CHORDS))
    farthest = 0.0
    for p in range(n):
        away = length2(polygon[p, U] - plane[FOOT_X], polygon[p, V] - plane[FOOT_Y])
        farthest = max(farthest, away)
    if slope == 0 or farthest < radius * math.cos(math.pi / n_chords) - error:
        append_dense(face, polygon, n, criteria, scratch, out)
    else:
        append_within_circle(face, polygon, n, radius, error, n_chords, criteria, scratch, out)


@allocation_free
def append_within_circle(face, polygon, n, radius, error, n_chords, criteria, scratch, out):
    """Append the part of a polygon within a polygon of `n_chords` corners in a circle."""
    plane, caps, part = scratch.plane, scratch.caps, scratch.inner
    towards = anchor(plane)
    top = push_parts(polygon, n, 0, n_chords, caps)
    while top > 0:
        top -= 1
        start, end, n = caps.tags[top, 0], caps.tags[top, 1], caps.n_corners[top]
        copy_polygon(caps.corners[top], n, part)
        area = max(twice_area(part, n) / 2, 0.0)
        if end - start == 1:
            out.bound[face] += area + error * perimeter_of(part, n)
            continue
        if top + CHORDS > STACK_ROOM or not area > 0:
            out.bound[face] += area
            continue
        n_parts = min(CHORDS, end - start)
        copy_polygon(part, n, scratch.other)
        m = n
        x0, y0 = corner_of_circle(start, n_chords, plane, radius, towards)
        for c in range(n_parts):
            first = start + (end - start) * c // n_parts
            last = start + (end - start) * (c + 1) // n_parts
            x1, y1 = corner_of_circle(last, n_chords, plane, radius, towards)
            over = radius * (1 - math.cos(math.pi * (last - first) / n_chords)) + error
            k = cap_of_chord(part, n, x0, y0, x1, y1, over, caps.corners[top], scratch.spare)
            if k >= 3:
                top = push(top, k, first, last, caps)
            if m >= 3:
                m = keep_inside(scratch.other, m, (x0, y0, x1 - x0, y1 - y0, 0.0), scratch.spare)
                copy_polygon(scratch.spare, m, scratch.other)
            x0, y0 = x1, y1
        if m >= 3:
            append_dense(face, scratch.other, m, criteria, scratch, out)


Seen = namedtuple("Seen", "rotation centre near state visible area area_error is_certified kept")
"""A solved pose: `rotation` world_from_camera and `centre`; see `HalfPlaneSolver`."""


@part_with_arrays
def to_camera(rotation, axis, f, plane, column):
    """Turn a vector of face f into camera axes, into three columns of `plane`."""
    for k in range(3):
        plane[column + k] = (
            axis[f, 0] * rotation[0, k] + axis[f, 1] * rotation[1, k] + axis[f, 2] * rotation[2, k]
        )


@part_with_arrays
def set_plane(planes, f, seen, plane):
    """Fill `plane` with a face in camera axes; returns the least and the greatest depth of it."""
    rotation, centre = seen.rotation, seen.centre
    to_camera(rotation, planes.x_axis, f, plane, X_AXIS)
    to_camera(rotation, planes.y_axis, f, plane, Y_AXIS)
    to_camera(rotation, planes.normal, f, plane, NORMAL)
    a = planes.origin[f, 0] - centre[0]
    b = planes.origin[f, 1] - centre[1]
    c = planes.origin[f, 2] - centre[2]
    for k in range(3):
        plane[ORIGIN + k] = a * rotation[0, k] + b * rotation[1, k] + c * rotation[2, k]
    # In the axes of the world: the products with a normal along one of them are exact.
    x_axis, y_axis, normal = planes.x_axis, planes.y_axis, planes.normal
    plane[HEIGHT] = -(a * normal[f, 0] + b * normal[f, 1] + c * normal[f, 2])
    plane[FOOT_X] = -(a * x_axis[f, 0] + b * x_axis[f, 1] + c * x_axis[f, 2])
    plane[FOOT_Y] = -(a * y_axis[f, 0] + b * y_axis[f, 1] + c * y_axis[f, 2])
    longest = planes.corners[f, 1, 0]
    plane[LONGEST] = longest
    plane[ERROR] = POSITION_ERROR_REL * (abs(a) + abs(b) + abs(c) + longest)
    least = most = plane[ORIGIN + 2]
    for p in range(1, 3):
        depth = (
            plane[ORIGIN + 2]
            + planes.corners[f, p, U] * plane[X_AXIS + 2]
            + planes.corners[f, p, V] * plane[Y_AXIS + 2]
        )
        least, most = min(least, depth), max(most, depth)
    return least, most


@part_with_arrays
def set_lines(plane, criteria, near, least, most, lines):
    """Fill `lines` with those of depth and of the viewing pyramid; returns the greatest depth."""
    z, z_x, z_y = plane[ORIGIN + 2], plane[X_AXIS + 2], plane[Y_AXIS + 2]
    error, height = plane[ERROR], abs(plane[HEIGHT])
    set_line(lines, NEAR_LINE, z - near, z_x, z_y, error)
    set_line(lines, FOCUS_LINE, z - criteria.rules.z_n, z_x, z_y, error)
    farthest, its_error = criteria.rules.z_f, error
    if criteria.rules.min_facing_density > 0:
        # min(fx, fy) / z, a half plane of depth as the end of the depth of field is.
        limit = min(criteria.lens.fx, criteria.lens.fy) / criteria.rules.min_facing_density
        farthest = min(farthest, limit)
    if criteria.rules.min_pixels_per_m2 > 0:
        limit = (
            criteria.lens.fx * criteria.lens.fy * height / criteria.rules.min_pixels_per_m2
        ) ** (1 / 3)
        if limit < farthest:
            farthest = limit
            its_error += limit * (error / height if height > error else 1.0)
    # Beyond the deepest corner there is nothing to cut, however far that is.
    limit = min(farthest, 2 * abs(most) + 2 * its_error)
    set_line(lines, FAR_LINE, limit - z, -z_x, -z_y, its_error)
    for side in range(4):
        axis = side // 2
        f = criteria.lens.fx if axis == 0 else criteria.lens.fy
        at = criteria.lens.cx if axis == 0 else criteria.lens.cy
        size = criteria.lens.width if axis == 0 else criteria.lens.height
        sign = 1.0 if side % 2 == 0 else -1.0
        ahead = at if side % 2 == 0 else size - at
        set_line(
            lines, LEFT + side,
            sign * f * plane[ORIGIN + axis] + ahead * z,
            sign * f * plane[X_AXIS + axis] + ahead * z_x,
            sign * f * plane[Y_AXIS + axis] + ahead * z_y,
            error * (f + abs(ahead)),
        )  # fmt: skip
    return farthest + its_error


@part_with_arrays
def bring_back(kept, piece, plane, criteria, deepest, out):
    """Bring a piece of the image to the plane of its face, counter-clockwise; its corner count."""
    n = kept.starts[piece + 1] - kept.starts[piece]
    normal_x, normal_y, normal_z = plane[NORMAL], plane[NORMAL + 1], plane[NORMAL + 2]
    is_reversed = plane[HEIGHT] > 0  # v points down, and the front is seen
    for p in range(n):
        at = kept.starts[piece] + (n - 1 - p if is_reversed else p)
        x = (kept.corners[at, U] - criteria.lens.cx) / criteria.lens.fx
        y = (kept.corners[at, V] - criteria.lens.cy) / criteria.lens.fy
        slope = normal_x * x + normal_y * y + normal_z
        # A corner near the horizon of the plane lies beyond the face.
        z = FARTHEST * deepest
        if slope * plane[HEIGHT] < 0:
            z = min(z, -plane[HEIGHT] / slope)
        along = plane[X_AXIS] * x + plane[X_AXIS + 1] * y + plane[X_AXIS + 2]
        across = plane[Y_AXIS] * x + plane[Y_AXIS + 1] * y + plane[Y_AXIS + 2]
        out[p, U], out[p, V] = plane[FOOT_X] + z * along, plane[FOOT_Y] + z * across
    return n


@part_with_arrays
def is_well_inside(corners, lines, plane, criteria):
    """True if a face meets all criteria of `lines` and of incidence by more than rounding.

    It is then a piece as it is: most faces of a fine mesh are decided here.
    """
    reach = abs(plane[HEIGHT]) * criteria.rules.tan_incidence * LEAST_INNER_REL
    reach -= plane[ERROR] * (2 + criteria.rules.tan_incidence)
    is_inside = True
    for p in range(3):
        u, v = corners[p, U], corners[p, V]
        for s in range(N_LINES):
            if not line_value(line_at(lines, s), u, v) > lines[s, LINE_ERROR]:
                is_inside = False
        x, y = u - plane[FOOT_X], v - plane[FOOT_Y]
        if criteria.rules.tan_incidence > 0 and not (reach > 0 and x * x + y * y < reach * reach):
            is_inside = False
    return is_inside


@allocation_free
def cut_regions(planes, criteria, seen, scratch, out):
    """Regions of all faces that one pose covers.

    Parameters
    ----------
    planes, criteria, seen, scratch
        Planes; Criteria; Seen; Scratch.
    out : Found
        Where `used` is more than there is room for, call again with that much.
    """
    plane, lines, sides, first = scratch.plane, scratch.lines, scratch.sides, scratch.first
    base, part, spare, kept = scratch.base, scratch.part, scratch.spare, seen.kept
    area, bound, corners = out.area, out.bound, planes.corners
    first[:] = -1
    for p in range(kept.used[0] - 1, -1, -1):
        first[kept.faces[p]] = p
    out.used[:] = 0
    for f in range(planes.areas.shape[0]):
        area[f] = bound[f] = 0.0
        state = seen.state[f]
        if not planes.is_asked[f] or not state & (LIVE | THIN | DOUBTFUL):
            continue
        image_error = 0.0 if seen.is_certified[f] else seen.area_error[f]
        if state & LIVE and seen.visible[f] == 0 and image_error == 0:
            continue
        least, most = set_plane(planes, f, seen, plane)
        height, error = plane[HEIGHT], plane[ERROR]
        if planes.two_sided[f]:
            height = abs(height)
        if height <= -error:
            continue
        farthest = set_lines(plane, criteria, seen.near, least, most, lines)
        nearest = max(seen.near, criteria.rules.z_n)
        if most < nearest - error or least > farthest:
            continue
        for p in range(3):
            base[p, U], base[p, V] = corners[f, p, U], corners[f, p, V]
        if (
            seen.visible[f] >= seen.area[f]
            and seen.visible[f] > 0
            and image_error == 0
            and height > error
            and criteria.rules.min_pixel_density == 0
            and is_well_inside(base, lines, plane, criteria)
        ):
            append_dense(f, base, 3, criteria, scratch, out)
            bound[f] = min(bound[f], planes.areas[f])
            continue
        n, strips = cut_by_lines(base, np.int64(3), lines, 0, N_LINES, spare)
        if n < 3:
            bound[f] = min(strips, planes.areas[f])
            continue
        deepest, shallowest = 0.0, np.inf
        for p in range(n):
            depth = (
                plane[ORIGIN + 2] + base[p, U] * plane[X_AXIS + 2] + base[p, V] * plane[Y_AXIS + 2]
            )
            deepest, shallowest = max(deepest, depth), min(shallowest, depth)
        if height + error < shallowest * criteria.rules.cos_incidence * (1 - POSITION_ERROR_REL):
            continue
        largest = min(twice_area(base, n) / 2 + strips, planes.areas[f])
        if height <= error:
            bound[f] = largest
            continue
        reach2 = 0.0
        for p in range(n):
            x, y = base[p, U] - plane[FOOT_X], base[p, V] - plane[FOOT_Y]
            reach2 = max(reach2, x * x + y * y + height * height)
        # One px^2 of the image is z^3 / (fx fy h) m^2 of the plane.
        bound[f] = (
            image_error
            * (deepest / criteria.lens.fx)
            * (deepest / criteria.lens.fy)
            * (deepest / height)
        )
        if seen.visible[f] >= seen.area[f] and seen.visible[f] > 0:
            bound[f] += strips
            append_within_angle(f, base, n, criteria.rules.tan_incidence, criteria, scratch, out)
        elif seen.visible[f] > 0 and first[f] >= 0:
            lines_of(corners[f], 3, sides)
            # Rounding of the position, the height and the ray, brought to the plane.
            off = (
                2 * POSITION_ERROR_REL
                + 2 * criteria.pixel_error / min(criteria.lens.fx, criteria.lens.fy)
            ) * (reach2 / height)
            p = first[f]
            while p < kept.used[0] and kept.faces[p] == f:
                n = bring_back(kept, p, plane, criteria, most, part)
                for s in range(3):
                    if n >= 3:
                        n = keep_inside(part, n, line_at(sides, s), spare)
                        copy_polygon(spare, n, part)
                if n >= 3:
                    n, strips = cut_by_lines(part, n, lines, FOCUS_LINE, LEFT, spare)
                    bound[f] += strips
                if n >= 3:
                    bound[f] += off * perimeter_of(part, n)
                    append_within_angle(
                        f, part, n, criteria.rules.tan_incidence, criteria, scratch, out
                    )
                p += 1
        bound[f] = min(bound[f], largest)


@part_with_arrays
def line_of_node(node, criteria, plane):
    """Line of a node of the field of view in the plane of a face: value, slopes; and its error."""
    lines = criteria.tree.lines
    a, b, c = lines[node, 0], lines[node, 1], lines[node, 2]
    return line_in_plane(a, b, c, plane), plane[ERROR] * (abs(a) + abs(b) + abs(c))


@part_with_arrays
def is_in_view(corners, n, plane, criteria):
    """True if a polygon lies in one cell of the tree that is inside the image, without a cut."""
    tree = criteria.tree
    node = tree.root
    while node >= 0:
        line, error = line_of_node(node, criteria, plane)
        least, most = least_and_most(corners, n, line)
        if not (least > error or most < -error):
            return False
        node = tree.children[node, 0 if least > error else 1]
    return node == INSIDE


@allocation_free
def append_in_view(face, polygon, n, criteria, scratch, out):
    """Append the part of a polygon that the image of the lens shows.

    Parameters
    ----------
    face, polygon, n, criteria
        A convex polygon of the face; LensCriteria, whose undecided cells are added to the bound.
    scratch, out
        Scratch, with the face in `plane`; Found.
    """
    plane, views, part = scratch.plane, scratch.views, scratch.seen
    tree = criteria.tree
    nearest = max(COINCIDENT_REL * plane[LONGEST], plane[ERROR])
    if is_in_view(polygon, n, plane, criteria):
        append_piece(face, polygon, n, nearest, scratch.tidy, out)
        return
    top = push_parts(polygon, n, tree.root, 0, views)
    while top > 0:
        top -= 1
        node, n = views.tags[top, 0], views.n_corners[top]
        copy_polygon(views.corners[top], n, part)
        while node >= 0:
            kind = tree.kinds[node]
            if kind == BAND:
                area = twice_area(part, n) / 2
                if area <= criteria.gap * extent_of(part, n):
                    node = UNDECIDED
                    break
            line, error = line_of_node(node, criteria, plane)
            least, most = least_and_most(part, n, line)
            if kind == BORDER and least < error and most > -error:
                slope = length2(line[1], line[2])
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
                if beyond in (UNDECIDED, INSIDE) or beyond >= 0:
                    m = keep_beyond(part, n, line, -1.0, views.corners[top])
                    if m >= 3 and (beyond == UNDECIDED or top + 2 > STACK_ROOM):
                        out.bound[face] += max(twice_area(views.corners[top], m) / 2, 0.0)
                    elif m >= 3:
                        top = push(top, m, beyond, 0, views)
                n = keep_beyond(part, n, line, 1.0, scratch.spare)
                copy_polygon(scratch.spare, n, part)
                if n < 3:
                    break
                node = tree.children[node, 0]
                if n > 2 * MOST_CORNERS and top + 2 <= STACK_ROOM:
                    # A chord divides what has many corners.
                    m = copy_second_half(part, n, views.corners[top])
                    top = push(top, m, node, 0, views)
                    n = n // 2 + 1
        if n < 3:
            continue
        if node == INSIDE:
            append_piece(face, part, n, nearest, scratch.tidy, out)
        elif node == UNDECIDED:
            out.bound[face] += max(twice_area(part, n) / 2, 0.0)


@part_with_arrays
def disc_of(criteria, plane):
    """Tangent of the angle up to which a face is in focus and not too oblique, 0 for any.

    Both are discs around the foot of the perpendicular from the camera; the smaller one counts. Of
    a disc that is hardly there the result is -1, and the area within which it may be.
    """
    farthest, slope, height = criteria.rules.z_f, criteria.rules.tan_incidence, abs(plane[HEIGHT])
    square = farthest * farthest - height * height
    if slope == 0 or square < slope * slope * height * height:
        if square <= 16 * farthest * plane[ERROR]:
            is_near = square > -16 * farthest * plane[ERROR]
            return -1.0, 128 * farthest * plane[ERROR] if is_near else 0.0
        # The radius of the circle at that distance is off by height / radius times the error of
        # the height.
        radius = math.sqrt(square)
        slope = radius / height
        plane[ERROR] *= 1 + height / radius
    return slope, 0.0


@part_with_arrays
def set_depths(criteria, plane, lines):
    """Fill the first two of `lines` with the depths in focus; False where any depth is."""
    rules, axis = criteria.rules, criteria.axis
    z, z_x, z_y = line_in_plane(axis[0], axis[1], axis[2], plane)
    set_line(lines, 0, z - rules.z_n, z_x, z_y, plane[ERROR])
    # What is infinitely far away needs no line.
    set_line(lines, 1, 1.0, 0.0, 0.0, 0.0)
    if rules.z_f < math.inf:
        set_line(lines, 1, rules.z_f - z, -z_x, -z_y, plane[ERROR])
    return not criteria.by_distance and (rules.z_n > 0 or rules.z_f < math.inf)


@allocation_free
def cut_pieces(planes, criteria, seen, scratch, source, step, out):
    """Cut pieces by one of the steps for lenses, see the module.

    Parameters
    ----------
    planes, criteria, seen, scratch
        Planes; LensCriteria; Seen of the ideal plane; Scratch.
    source : Found
        Pieces in the ideal plane, by face.
    step : int
        `TO_DISCS`, `TO_VIEW` or `TO_DENSITIES`.
    out : Found
        Where `used` is more than there is room for, call again with that much.
    """
    plane, polygon, last = scratch.plane, scratch.base, -1
    has_depths, slope, undecided = False, 0.0, 0.0
    out.used[0] = out.used[1] = 0
    for f in range(out.area.shape[0]):
        out.area[f], out.bound[f] = 0.0, source.bound[f]
    for piece in range(source.used[0]):
        f = source.face[piece]
        if f != last:
            set_plane(planes, f, seen, plane)
            last = f
            if step == TO_DISCS:
                slope, undecided = disc_of(criteria, plane)
            elif step == TO_VIEW:
                has_depths = set_depths(criteria, plane, scratch.lines)
        first = source.starts[piece]
        n = source.starts[piece + 1] - first
        copy_polygon(source.xy[first:], n, polygon)
        if step == TO_DENSITIES:
            append_dense(f, polygon, n, criteria, scratch, out)
        elif step == TO_DISCS and slope < 0:
            out.bound[f] += min(twice_area(polygon, n) / 2, undecided)
        elif step == TO_DISCS:
            append_within_angle(f, polygon, n, slope, criteria.pinhole, scratch, out)
        else:
            if has_depths:
                n, strips = cut_by_lines(polygon, n, scratch.lines, 0, 2, scratch.spare)
                out.bound[f] += strips
            if n >= 3:
                append_in_view(f, polygon, n, criteria, scratch, out)
    for f in range(out.bound.shape[0]):
        out.bound[f] = min(out.bound[f], planes.areas[f])
