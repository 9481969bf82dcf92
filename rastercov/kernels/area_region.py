"""Exact regions of the faces that a pose covers, in the planes of the faces; compiled by numba.

An image point (u, v) has the ray r = ((u - cx)/fx, (v - cy)/fy, 1) in camera axes and shows the
point P = z r of the plane n . P = -h at depth z = -h / (n . r). The visible pieces of
`rastercov.exact` are brought to the plane in this way; a face that is wholly visible in its part
of the image is cut in its own plane. Depth is affine in the plane, so focus and pixels per m^2 are
half planes, and so are the borders of the image and the near plane.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.kernels.area_arc import FEWEST_CHORDS, append_within_angle
from rastercov.kernels.area_density import append_dense
from rastercov.kernels.area_plane import (
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
    X_AXIS,
    Y_AXIS,
    cut_by_lines,
    perimeter_of,
    set_line,
    set_side,
)
from rastercov.kernels.exact_polygon import (
    copy_polygon,
    keep_inside,
    line_at,
    line_value,
    twice_area,
)
from rastercov.kernels.exact_records import DOUBTFUL, LINE_ERROR, LIVE, THIN, U, V
from rastercov.kernels.jit import allocation_free, part_with_arrays

LEAST_INNER_REL = math.cos(math.pi / FEWEST_CHORDS) * (1 - 1e-9)
"""Radius within the chords of any circle of incidence, relative to its own."""
FARTHEST = 2.0
"""Depth up to which a corner is brought back, relative to the deepest corner of its face."""


class Seen(NamedTuple):
    """A solved pose: `rotation` world_from_camera and `centre`; see `HalfPlaneSolver`."""

    rotation: NDArray[np.float64]
    centre: NDArray[np.float64]
    near: float
    state: NDArray[np.uint16]
    visible: NDArray[np.float64]
    area: NDArray[np.float64]
    area_error: NDArray[np.float64]
    is_certified: NDArray[np.bool_]
    kept: Any


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
def set_sides(planes, f, sides):
    """Fill `sides` with the lines along the edges of a face."""
    for p in range(3):
        q = p + 1 if p < 2 else 0
        set_side(
            sides, p, planes.corners[f, p, U], planes.corners[f, p, V],
            planes.corners[f, q, U], planes.corners[f, q, V],
        )  # fmt: skip


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
            set_sides(planes, f, sides)
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
