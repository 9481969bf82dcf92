"""Samples of targets against the depths of an image, compiled by numba.

Each target is filled by itself and nothing is written to the image, so it hides nothing. Positions
are rounded to 1/256 sample and edge functions are integers, as in `rastercov.raster.cpu`: the
samples that a face covers are the same as those of a face that hides.

J. Pineda. A Parallel Algorithm for Polygon Rasterization. 1988.
"""

import numpy as np

from rastercov.kernels.jit import compiled, part_of
from rastercov.kernels.raster_clipping import clip
from rastercov.kernels.raster_memory import CLIP_CORNERS, GUARD_BAND, HALF_SAMPLE, STEP_BITS, STEPS

TIE_REL = 2.0**-20
"""Depth by which a surface must be in front of a target to hide it, relative: 8 roundings to
float32, by which the depths of one surface differ between devices."""
REACH = 0.99 * GUARD_BAND / STEPS
"""Samples from the origin of the canvas beyond which targets are clipped."""


@part_of
def samples_right_of(value, step, first, last):
    """Range of samples first ... last in which value + step x >= 0, x counted from `first`."""
    if step > 0:
        if value < 0:
            first += (-value + step - 1) // step
    elif step < 0:
        last = min(last, first + value // -step) if value >= 0 else first - 1
    elif value < 0:
        last = first - 1
    return first, last


@part_of
def put_in_camera(corners, f, axes, eye, polygon):
    """Write the corners of a face in camera axes."""
    for i in range(3):
        x, y, z = corners[f, i, 0] - eye[0], corners[f, i, 1] - eye[1], corners[f, i, 2] - eye[2]
        for k in range(3):
            polygon[3 * i + k] = x * axes[0, k] + y * axes[1, k] + z * axes[2, k]


@part_of
def clip_to_canvas(polygon, lens, near, out):
    """Clip a face to the near plane and the guard band; returns the corner count of `out`.

    `polygon` is overwritten.
    """
    n = clip(polygon, 3, (0.0, 0.0, 1.0), near, out)
    is_far = False
    for axis in range(2):
        for i in range(n):
            position = lens[axis] * out[3 * i + axis] + lens[2 + axis] * out[3 * i + 2]
            is_far |= abs(position) > REACH * out[3 * i + 2]
    for side in range(4 if is_far else 0):
        # |u| <= REACH, |v| <= REACH: +-(f x + c z) <= REACH z
        sign, axis = 1.0 - 2.0 * (side & 1), side >> 1
        across, along = sign * lens[axis], sign * lens[2 + axis] + REACH
        normal = (across, 0.0, along) if axis == 0 else (0.0, across, along)
        for i in range(3 * n):
            polygon[i] = out[i]
        n = clip(polygon, n, normal, 0.0, out)
    return n


@compiled
def count_triangle(x, y, plane, least, greatest, corner, runs, depth):
    """Samples of a tile that a triangle covers, and those of them that no surface is in front of.

    Parameters
    ----------
    x, y : (3,) int
        Corners, in steps of 1/256 sample on the canvas.
    plane : tuple of 3 float
        1/z at the centre of the first sample of the canvas, its steps to the next column and row.
    least, greatest : float
        1/z at the corners: a sample can lie beyond them by rounding, its depth must not.
    corner : tuple of 2 int
        First column and row of the tile.
    runs : tuple of two (H,) int32 arrays
        First sample of each row of the canvas that counts, and the one after the last.
    depth : (h, w) float32
        Depth of the nearest surface at each sample of the tile, metres; inf for none.
    """
    ax, ay, bx, by, cx, cy = x[0], y[0], x[1], y[1], x[2], y[2]
    area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    if area == 0:
        return 0, 0
    if area < 0:
        bx, by, cx, cy = cx, cy, bx, by
    left, top = corner
    height, width = depth.shape
    first_row = max((min(ay, by, cy) + HALF_SAMPLE - 1) >> STEP_BITS, top)
    last_row = min((max(ay, by, cy) + HALF_SAMPLE - 1) >> STEP_BITS, top + height)
    first_column = max((min(ax, bx, cx) + HALF_SAMPLE - 1) >> STEP_BITS, left)
    last_column = min((max(ax, bx, cx) + HALF_SAMPLE - 1) >> STEP_BITS, left + width)
    covered = seen = 0
    for row in range(first_row, last_row):
        begin = max(first_column, np.int64(runs[0][row]))
        end = min(last_column, np.int64(runs[1][row])) - 1
        v = (row << STEP_BITS) + HALF_SAMPLE
        for side in range(3):
            if side == 0:
                px, py, qx, qy = ax, ay, bx, by
            elif side == 1:
                px, py, qx, qy = bx, by, cx, cy
            else:
                px, py, qx, qy = cx, cy, ax, ay
            u = (begin << STEP_BITS) + HALF_SAMPLE
            value = (qx - px) * (v - py) - (qy - py) * (u - px)
            # A sample on a left or upper edge is inside.
            is_inside = qy < py or (qy == py and qx > px)
            value -= 0 if is_inside else 1
            begin, end = samples_right_of(value, (py - qy) << STEP_BITS, begin, end)
        if begin > end:
            continue
        covered += end - begin + 1
        start = plane[0] + plane[2] * row
        for column in range(begin, end + 1):
            inverse = min(max(start + plane[1] * column, least), greatest)
            seen += inverse * depth[row - top, column - left] * (1 + TIE_REL) >= 1
    return covered, seen


@compiled
def count_targets(corners, axes, eye, lens, near, rows, corner, runs, depth, visible, drawn):
    """Add the samples of targets in a tile of one pose to their counts.

    Parameters
    ----------
    corners : (N, 3, 3) float64
        Points, metres.
    axes, eye : (3, 3), (3,) float64
        Rotation world_from_camera with its first two axes mixed as by `SampleGrid.axes`, and camera
        centre, from the same origin as the points.
    lens : (4,) float64
        Of `SampleGrid`.
    near : float
        Depth of the near plane, metres.
    rows : (N, 2) int64
        Of `rows_of_targets`.
    corner, runs, depth
        The tile, as for `count_triangle`.
    visible, drawn : (N,) int64
        Samples of each target, added to.
    """
    polygon, out = np.empty(3 * CLIP_CORNERS), np.empty(3 * CLIP_CORNERS)
    u, v, w = np.empty((3, CLIP_CORNERS))
    x, y = np.empty((2, 3), np.int64)
    for f in range(corners.shape[0]):
        if rows[f, 1] <= corner[1] or rows[f, 0] >= corner[1] + depth.shape[0]:
            continue
        put_in_camera(corners, f, axes, eye, polygon)
        ax, ay, az = polygon[0], polygon[1], polygon[2]
        dx, dy, dz = polygon[3] - ax, polygon[4] - ay, polygon[5] - az
        ex, ey, ez = polygon[6] - ax, polygon[7] - ay, polygon[8] - az
        nx, ny, nz = dy * ez - dz * ey, dz * ex - dx * ez, dx * ey - dy * ex
        height = nx * ax + ny * ay + nz * az
        n = clip_to_canvas(polygon, lens, near, out)
        if n < 3:
            continue
        least, greatest = np.inf, 0.0
        for i in range(n):
            w[i] = 1.0 / out[3 * i + 2]
            u[i] = (lens[0] * out[3 * i] * w[i] + lens[2]) * STEPS
            v[i] = (lens[1] * out[3 * i + 1] * w[i] + lens[3]) * STEPS
            least, greatest = min(least, w[i]), max(greatest, w[i])
        # 1/z = n . r / height is affine in the image.
        across, down = nx / (height * lens[0]), ny / (height * lens[1])
        origin = nz / height + across * (0.5 - lens[2]) + down * (0.5 - lens[3])
        if not (np.isfinite(origin) and np.isfinite(across) and np.isfinite(down)):
            origin, across, down = greatest, 0.0, 0.0
        for k in range(n - 2):
            for i in range(3):
                at = 0 if i == 0 else k + i
                x[i], y[i] = np.int64(np.floor(u[at] + 0.5)), np.int64(np.floor(v[at] + 0.5))
            covered, seen = count_triangle(
                x, y, (origin, across, down), least, greatest, corner, runs, depth
            )
            drawn[f] += covered
            visible[f] += seen


@compiled
def rows_of_targets(corners, axes, eye, lens, near, height, rows):
    """Find the rows of samples that each target may reach in one pose.

    Out: `rows`, (N, 2) int64, the first one and the one after the last; both 0 for none.
    """
    polygon, out = np.empty(3 * CLIP_CORNERS), np.empty(3 * CLIP_CORNERS)
    for f in range(corners.shape[0]):
        put_in_camera(corners, f, axes, eye, polygon)
        n = clip_to_canvas(polygon, lens, near, out)
        least, most = np.inf, -np.inf
        for i in range(n if n >= 3 else 0):
            v = lens[1] * out[3 * i + 1] / out[3 * i + 2] + lens[3]
            least, most = min(least, v), max(most, v)
        rows[f] = 0
        if least <= most:
            rows[f, 0] = np.int64(min(max(least - 1.0, 0.0), np.float64(height)))
            rows[f, 1] = np.int64(min(max(most + 2.0, 0.0), np.float64(height)))
