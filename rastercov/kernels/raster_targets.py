"""Samples of faces one by one against an image that is drawn, compiled by numba.

Each face is filled by itself and nothing is written to the image, so it hides nothing: targets are
counted so, and what faces cover alone through a lens. Positions are rounded to 1/256 sample and
edge functions are integers, as in `rastercov.raster.cpu`: the samples that a face covers are the
same as those of a face that hides.

J. Pineda. A Parallel Algorithm for Polygon Rasterization. 1988.
"""

import numpy as np

from rastercov.kernels.jit import compiled, part_of
from rastercov.kernels.raster_clipping import clip, clip_to_guard_band, plane_of
from rastercov.kernels.raster_memory import CLIP_CORNERS, HALF_SAMPLE, STEP_BITS, STEPS

TIE_REL = 2.0**-20
"""Depth by which a surface must be in front of a target to hide it, relative: 8 roundings to
float32, by which the depths of one surface differ between devices."""
MOST_TESTED = 24
"""Samples of a row, at most, that are tested one by one."""


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


@compiled
def count_triangle(x, y, plane, least, greatest, tile, runs, depth, sums):
    """Samples of a tile that a triangle covers, and those of them that no surface is in front of.

    Parameters
    ----------
    x, y : (3,) int
        Corners, in steps of 1/256 sample on the canvas.
    plane : tuple of 3 float
        1/z at the centre of the first sample of the canvas, its steps to the next column and row.
    least, greatest : float
        1/z at the corners: a sample can lie beyond them by rounding, its depth must not.
    tile : tuple of 4 int
        First column and row, width and height.
    runs : tuple of two (H,) int32 arrays
        First sample of each row of the canvas that counts, and the one after the last.
    depth : (h, w) float32
        Depth of the nearest surface at each sample of the tile, metres; inf for none. Empty where
        what is in front does not matter: then none is counted as seen.
    sums : (h, w + 1) or (0, 0) int32
        How often the samples of each row of the tile count, those before each column together;
        empty where each counts once.
    """
    ax, ay, bx, by, cx, cy = x[0], y[0], x[1], y[1], x[2], y[2]
    area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    if area == 0:
        return 0, 0
    if area < 0:
        bx, by, cx, cy = cx, cy, bx, by
    left, top, width, height = tile
    first_row = max((min(ay, by, cy) + HALF_SAMPLE - 1) >> STEP_BITS, top)
    last_row = min((max(ay, by, cy) + HALF_SAMPLE - 1) >> STEP_BITS, top + height)
    first_column = max((min(ax, bx, cx) + HALF_SAMPLE - 1) >> STEP_BITS, left)
    last_column = min((max(ax, bx, cx) + HALF_SAMPLE - 1) >> STEP_BITS, left + width)
    covered = seen = 0
    is_weighted, sees = sums.shape[0] > 0, depth.size > 0
    # A sample on a left or upper edge is inside.
    a_in = 0 if by < ay or (by == ay and bx > ax) else 1
    b_in = 0 if cy < by or (cy == by and cx > bx) else 1
    c_in = 0 if ay < cy or (ay == cy and ax > cx) else 1
    a_step, b_step, c_step = (ay - by) << STEP_BITS, (by - cy) << STEP_BITS, (cy - ay) << STEP_BITS
    for row in range(first_row, last_row):
        begin = max(first_column, np.int64(runs[0][row]))
        end = min(last_column, np.int64(runs[1][row])) - 1
        v, u = (row << STEP_BITS) + HALF_SAMPLE, (begin << STEP_BITS) + HALF_SAMPLE
        a = (bx - ax) * (v - ay) - (by - ay) * (u - ax) - a_in
        b = (cx - bx) * (v - by) - (cy - by) * (u - bx) - b_in
        c = (ax - cx) * (v - cy) - (ay - cy) * (u - cx) - c_in
        if end - begin < MOST_TESTED:
            while begin <= end and (a | b | c) < 0:
                a, b, c, begin = a + a_step, b + b_step, c + c_step, begin + 1
            last = begin - 1
            while last < end and (a | b | c) >= 0:
                a, b, c, last = a + a_step, b + b_step, c + c_step, last + 1
            end = last
        else:
            first = begin
            begin, end = samples_right_of(a, a_step, begin, end)
            begin, end = samples_right_of(b + (begin - first) * b_step, b_step, begin, end)
            begin, end = samples_right_of(c + (begin - first) * c_step, c_step, begin, end)
        if begin > end:
            continue
        n = end - begin + 1
        if is_weighted:
            n = np.int64(sums[row - top, end + 1 - left] - sums[row - top, begin - left])
        covered += n
        if n == 0 or not sees:
            continue
        start = plane[0] + plane[2] * row
        for column in range(begin, end + 1):
            inverse = min(max(start + plane[1] * column, least), greatest)
            if inverse * depth[row - top, column - left] * (1 + TIE_REL) >= 1:
                at = column - left
                seen += (
                    np.int64(sums[row - top, at + 1] - sums[row - top, at]) if is_weighted else 1
                )
    return covered, seen


@part_of
def is_beside(polygon, lens, tile):
    """True where a face is wholly beyond one side of a tile."""
    for axis in range(2):
        first = float(tile[axis]) - lens[2 + axis]
        last = first + tile[2 + axis]
        n_before = n_behind = 0
        for i in range(3):
            across, z = lens[axis] * polygon[3 * i + axis], polygon[3 * i + 2]
            n_before += across < first * z
            n_behind += across > last * z
        if n_before == 3 or n_behind == 3:
            return True
    return False


@compiled
def count_targets(corners, axes, eye, lens, near, rows, tile, runs, depth, sums, visible, drawn):
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
        Of `rows_of_targets`; empty where they are not known.
    tile, runs, depth, sums
        As for `count_triangle`.
    visible, drawn : (N,) int64
        Samples of each target, added to.
    """
    polygon, out = np.empty(3 * CLIP_CORNERS), np.empty(3 * CLIP_CORNERS)
    u, v, w = np.empty((3, CLIP_CORNERS))
    x, y = np.empty((2, 3), np.int64)
    for f in range(corners.shape[0]):
        if len(rows) and (rows[f, 1] <= tile[1] or rows[f, 0] >= tile[1] + tile[3]):
            continue
        put_in_camera(corners, f, axes, eye, polygon)
        if is_beside(polygon, lens, tile):
            continue
        plane = plane_of(polygon, lens)
        n = clip(polygon, 3, (0.0, 0.0, 1.0), near, out)
        n = clip_to_guard_band(polygon, n, lens, out)
        if n < 3:
            continue
        least, greatest = np.inf, 0.0
        for i in range(n):
            w[i] = 1.0 / out[3 * i + 2]
            u[i] = (lens[0] * out[3 * i] * w[i] + lens[2]) * STEPS
            v[i] = (lens[1] * out[3 * i + 1] * w[i] + lens[3]) * STEPS
            least, greatest = min(least, w[i]), max(greatest, w[i])
        origin, across, down = plane
        if not (np.isfinite(origin) and np.isfinite(across) and np.isfinite(down)):
            origin, across, down = greatest, 0.0, 0.0
        for k in range(n - 2):
            for i in range(3):
                at = 0 if i == 0 else k + i
                x[i], y[i] = np.int64(np.floor(u[at] + 0.5)), np.int64(np.floor(v[at] + 0.5))
            covered, seen = count_triangle(
                x, y, (origin, across, down), least, greatest, tile, runs, depth, sums
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
        n = clip_to_guard_band(polygon, clip(polygon, 3, (0.0, 0.0, 1.0), near, out), lens, out)
        least, most = np.inf, -np.inf
        for i in range(n if n >= 3 else 0):
            v = lens[1] * out[3 * i + 1] / out[3 * i + 2] + lens[3]
            least, most = min(least, v), max(most, v)
        rows[f] = 0
        if least <= most:
            rows[f, 0] = np.int64(min(max(least - 1.0, 0.0), np.float64(height)))
            rows[f, 1] = np.int64(min(max(most + 2.0, 0.0), np.float64(height)))


@compiled
def count_shown(face, sums, visible):
    """Add the samples that show each face of an image to (F,) counts; returns their number.

    Parameters
    ----------
    face : (h, w) int32
        Face at each sample, -1 for none.
    sums : (h, w + 1) int32
        As for `count_triangle`.
    """
    total = 0
    for row in range(face.shape[0]):
        before = sums[row, 0]
        for column in range(face.shape[1]):
            n = sums[row, column + 1] - before
            before += n
            if n > 0 and face[row, column] >= 0:
                visible[face[row, column]] += n
                total += n
    return total
