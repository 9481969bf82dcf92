"""One cell of a field of view: samples of the image, lines from them, and their proof; by numba.

See `rastercov.kernels.lens_field`. A cell is a convex polygon of an ideal plane.
"""

import math

from rastercov.kernels.jit import allocation_free, part_with_arrays
from rastercov.kernels.lens import project
from rastercov.kernels.lens_polygons import cut_to_side, polygon_image

SAMPLES = 4
"""Parts of a side of a triangle between samples."""
MARGIN = 1e-9
"""Pixels that a line keeps away from the border, for rounding."""
SAFETY = 0.05
"""Part of the range of the samples by which the lines are moved apart."""
ROUNDING = 2.0**-46
"""Rounding of the area under an edge, relative to its length and the size of the image."""


@part_with_arrays
def value_at(line, x, y):
    """Value of a line (a, b, c) at a point."""
    return line[0] * x + line[1] * y + line[2]


@allocation_free
def extremes(line, polygon, n):
    """Least and greatest value of a line at the corners of a polygon."""
    least, most = math.inf, -math.inf
    for p in range(n):
        value = value_at(line, polygon[p, 0], polygon[p, 1])
        least, most = min(least, value), max(most, value)
    return least, most


@allocation_free
def area_and_extent(polygon, n):
    """Area of a polygon, and its greatest distance of corners, to a factor of 2; far corners."""
    area = 0.0
    for p in range(1, n - 1):
        area += (polygon[p, 0] - polygon[0, 0]) * (polygon[p + 1, 1] - polygon[0, 1])
        area -= (polygon[p + 1, 0] - polygon[0, 0]) * (polygon[p, 1] - polygon[0, 1])
    far, other, extent = 0, 0, 0.0
    for p in range(n):
        away = math.hypot(polygon[p, 0] - polygon[0, 0], polygon[p, 1] - polygon[0, 1])
        if away > extent:
            far, extent = p, away
    extent = 0.0
    for p in range(n):
        away = math.hypot(polygon[p, 0] - polygon[far, 0], polygon[p, 1] - polygon[far, 1])
        if away > extent:
            other, extent = p, away
    return 0.5 * area, extent, far, other


@allocation_free
def keep_side(polygon, n, line, sign, out):
    """Part of a polygon where sign times a line is >= 0; its corner count."""
    a, b, c = sign * line[0], sign * line[1], sign * line[2]
    # The point of the line that is nearest to the origin; the inner side is on the left of (b, -a).
    return cut_to_side(polygon, n, -a * c, -b * c, b, -a, out)


@part_with_arrays
def pixel_of(plane, frame, x, y):
    """Pixel of a point of a plane."""
    return project(
        plane.code,
        plane.params,
        frame[0, 0] * x + frame[0, 1] * y + frame[0, 2],
        frame[1, 0] * x + frame[1, 1] * y + frame[1, 2],
        frame[2, 0] * x + frame[2, 1] * y + frame[2, 2],
    )


@allocation_free
def fit_borders(plane, polygon, n, fit):
    """Fill `fit` with an affine map u = a x + b y + c, and least and greatest u less that; and v.

    Rows are (a, b, c, least, greatest) of u and v, from samples in the polygon; then the least
    u, width - u, v, height - v of the samples, and the greatest of each.
    """
    cx = cy = 0.0
    for p in range(n):
        cx += polygon[p, 0] / n
        cy += polygon[p, 1] / n
    frame = plane.frame
    reach = 0.0
    for p in range(n):
        reach = max(reach, math.hypot(polygon[p, 0] - cx, polygon[p, 1] - cy))
    step = 1e-3 * reach
    for axis in range(2):
        dx, dy = (step, 0.0) if axis == 0 else (0.0, step)
        u1, v1 = pixel_of(plane, frame, cx + dx, cy + dy)
        u0, v0 = pixel_of(plane, frame, cx - dx, cy - dy)
        fit[0, axis], fit[1, axis] = 0.5 * (u1 - u0) / step, 0.5 * (v1 - v0) / step
    u, v = pixel_of(plane, frame, cx, cy)
    fit[0, 2], fit[1, 2] = u - fit[0, 0] * cx - fit[0, 1] * cy, v - fit[1, 0] * cx - fit[1, 1] * cy
    fit[0, 3] = fit[1, 3] = fit[0, 4] = fit[1, 4] = 0.0
    low_u = high_u = u
    low_v = high_v = v
    for p in range(n):
        q = p + 1 if p + 1 < n else 0
        for i in range(SAMPLES + 1):
            for j in range(SAMPLES + 1 - i):
                if i + j == 0:
                    continue
                s, t = i / SAMPLES, j / SAMPLES
                x = cx + s * (polygon[p, 0] - cx) + t * (polygon[q, 0] - cx)
                y = cy + s * (polygon[p, 1] - cy) + t * (polygon[q, 1] - cy)
                u, v = pixel_of(plane, frame, x, y)
                low_u, high_u = min(low_u, u), max(high_u, u)
                low_v, high_v = min(low_v, v), max(high_v, v)
                u -= fit[0, 0] * x + fit[0, 1] * y + fit[0, 2]
                v -= fit[1, 0] * x + fit[1, 1] * y + fit[1, 2]
                fit[0, 3], fit[0, 4] = min(fit[0, 3], u), max(fit[0, 4], u)
                fit[1, 3], fit[1, 4] = min(fit[1, 3], v), max(fit[1, 4], v)
    fit[2, 0], fit[2, 1], fit[2, 2], fit[2, 3] = (
        low_u, plane.width - high_u, low_v, plane.height - high_v,
    )  # fmt: skip
    fit[3, 0], fit[3, 1], fit[3, 2], fit[3, 3] = (
        high_u, plane.width - low_u, high_v, plane.height - low_v,
    )  # fmt: skip


@allocation_free
def side_of_image(plane, polygon, n, slope, edges):
    """1 where a cell is inside the image, -1 where it is outside, otherwise 0; by its areas.

    `slope` is about the pixels to a unit of the plane.
    """
    whole, inside, rules = polygon_image(plane, polygon, 0, n, edges)
    whole, inside = abs(whole), abs(inside)
    _, extent, _, _ = area_and_extent(polygon, n)
    spill = rules * plane.tolerance
    spill += ROUNDING * (plane.width + plane.height) * 4 * slope * extent
    if whole - inside <= spill and inside > spill:
        return 1
    return -1 if inside <= spill else 0


@allocation_free
def line_of_border(plane, fit, k, offset, out):
    """Line, of unit normal, along border k of an affine fit, moved inwards by an offset, px."""
    row = k // 2
    sign = 1.0 if k % 2 == 0 else -1.0
    at = 0.0 if k % 2 == 0 else (plane.width if row == 0 else plane.height)
    size = math.hypot(fit[row, 0], fit[row, 1])
    out[0], out[1] = sign * fit[row, 0] / size, sign * fit[row, 1] / size
    out[2] = (sign * (fit[row, 2] - at) - offset) / size


@allocation_free
def halving_line(polygon, far, other, out):
    """Line across the longest extent of a polygon, through its middle."""
    dx, dy = polygon[far, 0] - polygon[other, 0], polygon[far, 1] - polygon[other, 1]
    size = math.hypot(dx, dy)
    x, y = 0.5 * (polygon[far, 0] + polygon[other, 0]), 0.5 * (polygon[far, 1] + polygon[other, 1])
    out[0], out[1] = dx / size, dy / size
    out[2] = -(dx * x + dy * y) / size


@allocation_free
def narrowest_border(plane, cell, n, borders, fit):
    """Borders that samples do not have all of a cell inside of, and the one of the narrowest band.

    That one is -1 for none, and -2 where samples have all of the cell outside.
    """
    fit_borders(plane, cell, n, fit)
    best, narrowest = -1, math.inf
    for k in range(4):
        if not borders >> k & 1:
            continue
        row = k // 2
        if fit[2, k] >= -MARGIN:
            borders -= 1 << k
        elif fit[3, k] <= MARGIN:
            return borders, -2, 0.0
        else:
            slope = math.hypot(fit[row, 0], fit[row, 1])
            width = fit[row, 4] - fit[row, 3]
            width = (width + 2.0 * (SAFETY * width + MARGIN)) / slope
            if width < narrowest:
                best, narrowest = k, width
    return borders, best, narrowest
