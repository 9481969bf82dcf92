"""Regions of a pose through a lens: what an ideal plane shows, cut by the criteria of the lens.

`area_region.cut_regions` finds what the pinhole of an ideal plane sees, within the largest angle
of incidence. Three loops follow, each from a list of pieces to another one; the first and the last
run only where a task asks for them:

- `cut_to_discs`: focus up to a distance;
- `cut_to_view`: the field of view of the lens, and focus by depth;
- `cut_to_densities`: densities through the lens, and focus from a distance.

The curved borders of the field of view make most pieces, so discs come first.
"""

import math

from rastercov.kernels.area_arc import append_within_angle
from rastercov.kernels.area_lens_density import append_dense_through_lens
from rastercov.kernels.area_plane import (
    COINCIDENT_REL,
    ERROR,
    HEIGHT,
    LONGEST,
    ORIGIN,
    X_AXIS,
    Y_AXIS,
    append_piece,
    cut_by_lines,
    set_line,
)
from rastercov.kernels.area_region import set_plane
from rastercov.kernels.area_view import append_in_view, is_in_view
from rastercov.kernels.exact_polygon import twice_area
from rastercov.kernels.exact_records import U, V
from rastercov.kernels.jit import allocation_free, part_with_arrays


@part_with_arrays
def start_from(source, out):
    """Start a list with the bounds of another one."""
    out.used[0] = out.used[1] = 0
    for f in range(out.area.shape[0]):
        out.area[f], out.bound[f] = 0.0, source.bound[f]


@part_with_arrays
def copy_piece(source, piece, polygon):
    """Copy the corners of a piece; their number."""
    first = source.starts[piece]
    n = source.starts[piece + 1] - first
    for p in range(n):
        polygon[p, U], polygon[p, V] = source.xy[first + p, U], source.xy[first + p, V]
    return n


@part_with_arrays
def limit_bounds(planes, out):
    """No bound exceeds its face."""
    for f in range(out.bound.shape[0]):
        out.bound[f] = min(out.bound[f], planes.areas[f])


@allocation_free
def cut_to_discs(planes, criteria, seen, scratch, source, out):
    """Cut pieces to the greatest distance in focus, and to the largest angle of incidence.

    Both are discs around the foot of the perpendicular from the camera; the smaller one counts.

    Parameters
    ----------
    planes, criteria, seen, scratch
        Planes; LensCriteria; Seen of the ideal plane; Scratch.
    source : Found
        Pieces in the ideal plane, by face.
    out : Found
        Where `used` is more than there is room for, call again with that much.
    """
    plane, polygon, farthest = scratch.plane, scratch.base, criteria.rules.z_f
    start_from(source, out)
    last, slope, square, is_grazed = -1, 0.0, 0.0, False
    for piece in range(source.used[0]):
        f = source.face[piece]
        if f != last:
            set_plane(planes, f, seen, plane)
            last, slope, is_grazed = f, criteria.rules.tan_incidence, False
            height = abs(plane[HEIGHT])
            square = farthest * farthest - height * height
            if slope == 0 or square < slope * slope * height * height:
                # The radius of the circle at that distance is off by height / radius times the
                # error of the height; one that is hardly there is left undecided.
                is_grazed = square <= 16 * farthest * plane[ERROR]
                radius = math.sqrt(max(square, 0.0))
                if not is_grazed:
                    slope = radius / height
                    plane[ERROR] *= 1 + height / radius
        if is_grazed:
            if square > -16 * farthest * plane[ERROR]:
                n = copy_piece(source, piece, polygon)
                area = twice_area(polygon, n) / 2
                out.bound[f] += min(area, 128 * farthest * plane[ERROR])
            continue
        n = copy_piece(source, piece, polygon)
        append_within_angle(f, polygon, n, slope, criteria.pinhole, scratch, out)
    limit_bounds(planes, out)


@allocation_free
def cut_to_view(planes, criteria, seen, scratch, source, out):
    """Cut pieces to the field of view of a lens and to the depths that are in focus.

    Parameters are those of `cut_to_discs`.
    """
    plane, lines, polygon = scratch.plane, scratch.lines, scratch.base
    has_depths = not criteria.by_distance and (
        criteria.rules.z_n > 0 or criteria.rules.z_f < math.inf
    )
    start_from(source, out)
    last = -1
    for piece in range(source.used[0]):
        f = source.face[piece]
        if f != last:
            set_plane(planes, f, seen, plane)
            last = f
            if has_depths:
                z = z_x = z_y = 0.0
                for k in range(3):
                    z += criteria.axis[k] * plane[ORIGIN + k]
                    z_x += criteria.axis[k] * plane[X_AXIS + k]
                    z_y += criteria.axis[k] * plane[Y_AXIS + k]
                set_line(lines, 0, z - criteria.rules.z_n, z_x, z_y, plane[ERROR])
                # What is infinitely far away needs no line.
                set_line(lines, 1, 1.0, 0.0, 0.0, 0.0)
                if criteria.rules.z_f < math.inf:
                    set_line(lines, 1, criteria.rules.z_f - z, -z_x, -z_y, plane[ERROR])
        n = copy_piece(source, piece, polygon)
        if has_depths:
            n, strips = cut_by_lines(polygon, n, lines, 0, 2, scratch.spare)
            out.bound[f] += strips
            if n < 3:
                continue
        if is_in_view(polygon, n, plane, criteria):
            nearest = max(COINCIDENT_REL * plane[LONGEST], plane[ERROR])
            append_piece(f, polygon, n, nearest, scratch.tidy, out)
        else:
            append_in_view(f, polygon, n, criteria, scratch, out)
    limit_bounds(planes, out)


@allocation_free
def cut_to_densities(planes, criteria, seen, scratch, source, out):
    """Cut pieces to where densities through a lens are large enough; as `cut_to_discs`."""
    plane, polygon = scratch.plane, scratch.base
    start_from(source, out)
    last = -1
    for piece in range(source.used[0]):
        f = source.face[piece]
        if f != last:
            set_plane(planes, f, seen, plane)
            last = f
        n = copy_piece(source, piece, polygon)
        append_dense_through_lens(f, polygon, n, criteria, scratch, out)
    limit_bounds(planes, out)
