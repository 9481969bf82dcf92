"""Stages of the CPU rasteriser in numpy, with the names of `rastercov/native/raster`.

Each function takes any number of vertices, faces or clusters and returns what the SIMD stage
writes. Integer stages are exact; floating-point stages have the same order of operations, so
results are equal bit for bit. Faces are `places` (N, 3, 2) int64, their corners in whole steps.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.native.engine_raster import ALTITUDE, GUARD_BAND, RADIUS, SIDE, STEPS, TIE_REL
from rastercov.native.raster_stages import BEHIND, LARGE, NEEDS_CLIPPING

EYE, INTRINSICS, NEAR, MAGNIFICATION = 9, 12, 16, 17
"""Values of a camera: rotation world_from_camera (9, by rows), camera centre (3), fx, fy, cx, cy in
samples, depth of the near plane in metres, and the greatest magnification of a length parallel to
the image over its depth, in samples."""
CONE_COS, CONE_SIN, PLANE_OFFSET = 7, 8, 9
"""Rows of `Clusters.bounds`."""


class Window(NamedTuple):
    """Band of an image.

    Attributes
    ----------
    right, top, bottom : int
        Last column, first row, last row.
    hides_back : bool
    columns, height : int
        Blocks in a row of memory, and rows of the image.
    full_x, full_y : int
        Columns and rows of blocks below which every block is wholly inside the image.
    """

    right: int
    top: int
    bottom: int
    hides_back: bool
    columns: int
    height: int
    full_x: int
    full_y: int


Array = NDArray[Any]
Arrays = tuple[Array, ...]


def project_vertices(points: Array, camera: Array, is_safe: bool) -> Arrays:
    """Positions (u, v) in steps, 1/z, and whole steps (x, y) of points (3, N)."""
    rotation, (ex, ey, ez) = camera[:EYE].reshape(3, 3), camera[EYE:][:3]
    fx, fy, cx, cy = STEPS * camera[INTRINSICS:NEAR]
    dx, dy, dz = points[0] - ex, points[1] - ey, points[2] - ez
    right, down, z = (dx * a + dy * b + dz * c for a, b, c in rotation.T)
    w = 1 / z
    u, v = fx * right * w + cx, fy * down * w + cy
    x, y = np.floor(u + 0.5), np.floor(v + 0.5)
    if not is_safe:
        is_front = z >= camera[NEAR]
        is_seen = is_front & (np.abs(u) <= GUARD_BAND) & (np.abs(v) <= GUARD_BAND)
        unseen = np.where(is_front, NEEDS_CLIPPING, BEHIND)
        x, y = np.where(is_seen, x, unseen), np.where(is_seen, y, unseen)
    return u, v, w, x.astype(np.int32), y.astype(np.int32)


def cull_clusters(
    bounds: Array, camera: Array, frustum: Array, magnification: float, hides_backs: bool
) -> Arrays:
    """Clusters (N,) to be drawn, those that are safe, and down and forward of their centres."""
    dx, dy, dz = bounds[:3] - camera[EYE:][:3, None]
    radius, near = bounds[RADIUS], camera[NEAR]
    is_outside = radius < 0
    for plane, limit in zip(frustum, (0, 0, 0, 0, near), strict=True):
        forward = dx * plane[0] + dy * plane[1] + dz * plane[2]
        is_outside |= forward + radius * plane[3] < limit
    down = dx * camera[1] + dy * camera[4] + dz * camera[7]
    squared = dx * dx + dy * dy + dz * dz
    axis, cosine, sine = bounds[4:7], bounds[CONE_COS], bounds[CONE_SIN]
    along = dx * axis[0] + dy * axis[1] + dz * axis[2]
    across = np.sqrt(np.maximum(squared - along * along, 0))
    distance = np.sqrt(squared)
    highest = np.where(-along >= distance * cosine, distance, across * sine - along * cosine)
    height, reach = highest - bounds[PLANE_OFFSET], distance + radius
    is_back = height * bounds[ALTITUDE] * (magnification * STEPS) < reach * reach * -3.1
    is_safe = (forward - radius >= near) & (
        reach * camera[MAGNIFICATION] <= (forward - radius) * (GUARD_BAND // STEPS // 2)
    )
    return ~(is_outside | (is_back & is_safe & hides_backs)), is_safe, np.stack((down, forward))


def clusters_in_band(
    radius: Array,
    centres: Array,
    fy: float,
    up: float,
    up_length: float,
    down: float,
    down_length: float,
) -> Any:
    """Clusters (N,) whose spheres reach into a band of rows."""
    below, forward = centres[0] * fy, centres[1]
    is_below_rim = below + up * forward + radius * up_length >= 0
    return is_below_rim & (down * forward - below + radius * down_length >= 0)


def covers(places: Array, column: Any, row: Any) -> Any:
    """Coverage of samples by triangles, by the sign of three exact edge functions.

    A sample on an edge is inside where a point just right of it, or else just below it, is inside.
    """
    a, b, c = np.moveaxis(places, -2, 0)
    area = (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1])
    area = area - (c[..., 0] - a[..., 0]) * (b[..., 1] - a[..., 1])
    b, c = (np.where(area[..., None] < 0, one, two) for one, two in ((c, b), (b, c)))
    x, y = column * STEPS + STEPS // 2, row * STEPS + STEPS // 2
    inside = area != 0
    for p, q in ((a, b), (b, c), (c, a)):
        dx, dy = p[..., 1] - q[..., 1], q[..., 0] - p[..., 0]
        value = dx * (x - p[..., 0]) + dy * (y - p[..., 1])
        inside = inside & ((value > 0) | ((value == 0) & ((dx > 0) | ((dx == 0) & (dy > 0)))))
    return inside


def sample_bounds(places: Array, right: int, top: int, bottom: int) -> Any:
    """First and last column, first and last row of the samples in reach, (4, N)."""
    low, high = places.min(axis=1), places.max(axis=1)
    first, last = -((STEPS // 2 - low) // STEPS), (high - STEPS // 2) // STEPS
    return np.stack(
        (
            first[:, 0].clip(0),
            last[:, 0].clip(None, right),
            first[:, 1].clip(top),
            last[:, 1].clip(None, bottom),
        )
    )


def signed_area(places: Array) -> Any:
    """Twice the area of triangles in square steps, < 0 where they face the camera."""
    ab, ac = places[:, 1] - places[:, 0], places[:, 2] - places[:, 0]
    return ab[:, 0] * ac[:, 1] - ac[:, 0] * ab[:, 1]


def bin_faces(
    places: Array, is_face: Array, window: Window, is_plain: bool
) -> tuple[Arrays, Array]:
    """Four masks (N,) of shown faces, two of hidden ones, and coverage of 2 x 2 samples as bits."""
    first_x, last_x, first_y, last_y = sample_bounds(places, *window[:3])
    columns, rows, area = last_x - first_x, last_y - first_y, signed_area(places)
    covered = np.zeros(len(places), int)
    for k, (i, j) in enumerate(((0, 0), (1, 0), (0, 1), (1, 1))):
        in_reach = (i <= columns) & (j <= rows)
        covered |= (covers(places, first_x + i, first_y + j) & in_reach) << k
    can_cover, is_2x2 = (columns >= 0) & (rows >= 0), np.maximum(columns, rows) <= 1
    small, larger = is_2x2 & (covered > 0), can_cover & ~is_2x2
    wide = clipped = rest = np.zeros(len(places), bool)
    if not is_plain:
        x = places[..., 0]
        rest = (x >= BEHIND).any(axis=1) & is_face
        clipped = rest & ~(x == BEHIND).all(axis=1)
        wide = (np.ptp(places, axis=1).max(axis=1) >= LARGE) & can_cover & ~rest
    usual, hides = ~(wide | rest), bool(window.hides_back)
    shown = usual & ((area < 0) | ((area > 0) & (not hides)))
    hidden = usual & (area > 0) & hides
    masks = small & shown, larger & shown, wide, clipped, small & hidden, larger & hidden
    return masks, covered


def set_up_triangles(exact: Array, places: Array, window: Window) -> Arrays:
    """Edge functions (9, N), bounds (4, N) and planes of 1/z in float64 and in float32."""
    bounds = sample_bounds(places, *window[:3])
    x, y = (bounds[k] // SIDE * SIDE * STEPS + STEPS // 2 for k in (0, 2))
    a, b, c = places.swapaxes(0, 1)
    is_turned = signed_area(places)[:, None] < 0
    b, c = np.where(is_turned, c, b), np.where(is_turned, b, c)
    edges = []
    for p, q in ((a, b), (b, c), (c, a)):
        dx, dy = (q - p).T
        is_left_or_upper = (dy < 0) | ((dy == 0) & (dx > 0))
        value = dx * (y - p[:, 1]) - dy * (x - p[:, 0])
        edges.append(((value - 1 + is_left_or_upper) // STEPS, -dy, dx))
    rows = np.swapaxes(edges, 0, 1).reshape(9, -1)
    u, v, w = exact
    area = signed_area(np.stack((u.T, v.T), axis=-1))
    whole = signed_area(places)
    is_thin = np.abs(area - whole) > np.abs(whole) * 0.25
    (au, bu, cu), (av, bv, cv) = np.where(is_thin, places.T, (u, v))
    scale = STEPS / ((bu - au) * (cv - av) - (bv - av) * (cu - au))
    w_ab, w_ac = w[1] - w[0], w[2] - w[0]
    slope_x = (w_ab * (cv - av) - w_ac * (bv - av)) * scale
    slope_y = (w_ac * (bu - au) - w_ab * (cu - au)) * scale
    origin = w[0] + (slope_x * (STEPS / 2 - au) + slope_y * (STEPS / 2 - av)) * (1 / STEPS)
    plane64 = np.stack((origin, slope_x, slope_y))
    plane32 = np.stack((slope_x, slope_y, w.min(axis=0), w.max(axis=0))).astype(np.float32)
    return rows, bounds, plane64, plane32


def block_starts(block_x: Array, block_y: Array, window: Window, plane64: Array) -> Arrays:
    """Memory index and 1/z of the first samples of blocks."""
    origin, slope_x, slope_y = plane64
    sample = ((block_y - window.top // SIDE) * window.columns + block_x) * SIDE * SIDE
    depth = origin + slope_y * (block_y * SIDE) + slope_x * (block_x * SIDE)
    return sample, depth.astype(np.float32)


def cover_block(places: Array, block_x: Array, block_y: Array) -> Any:
    """Coverage masks (N,) of a block of each triangle, as bits."""
    k = np.arange(SIDE * SIDE)
    column, row = block_x[:, None] * SIDE + k % SIDE, block_y[:, None] * SIDE + k // SIDE
    return (covers(places[:, None], column, row) << k).sum(axis=1)


def cover_blocks(k: int, places: Array, bounds: Array, window: Window, plane64: Array) -> Arrays:
    """Triangles with samples in block k of 2 x 2, border blocks, coverage, index and 1/z."""
    first_x, last_x, first_y, last_y = bounds // SIDE
    block_x, block_y = first_x + k % 2, first_y + k // 2
    masks = cover_block(places, block_x, block_y)
    has_samples = (masks > 0) & (block_x <= last_x) & (block_y <= last_y)
    at_border = (block_x >= window.full_x) | (block_y >= window.full_y)
    return has_samples, at_border, masks, *block_starts(block_x, block_y, window, plane64)


def reach_blocks(edges: Array, right: int, down: int) -> Any:
    """Blocks (16,) of a tile where no edge function (9,) of a triangle is negative throughout."""
    value, dx, dy = edges.reshape(3, 3, 1)
    k = np.arange(SIDE * SIDE)
    x, y = (right + k % SIDE) * SIDE, (down + k // SIDE) * SIDE
    highest = value + dx * x + dy * y + (np.maximum(dx, 0) + np.maximum(dy, 0)) * (SIDE - 1)
    return (highest >= 0).all(axis=0)


def whole_blocks(edges: Array, right: int, down: int) -> Any:
    """Blocks (16,) of a tile where no edge function (9,) of a triangle is negative anywhere."""
    value, dx, dy = edges.reshape(3, 3, 1)
    k = np.arange(SIDE * SIDE)
    x, y = (right + k % SIDE) * SIDE, (down + k // SIDE) * SIDE
    lowest = value + dx * x + dy * y + (np.minimum(dx, 0) + np.minimum(dy, 0)) * (SIDE - 1)
    return (lowest >= 0).all(axis=0)


def fit_count_samples(bounds: Array) -> Any:
    """Triangles (N,) that reach at most 16 columns and rows of samples."""
    return (bounds[[1, 3]] - bounds[[0, 2]] < SIDE * SIDE).all(axis=0)


def count_rows(places: Array, bounds: Array, start: int) -> Any:
    """Number of samples of a triangle (3, 2) in 16 rows of its bounds from row `start` on."""
    first_x, last_x, first_y, last_y = bounds
    rows = np.arange(first_y + start, min(first_y + start + SIDE * SIDE, last_y + 1))
    return covers(places, np.arange(first_x, last_x + 1), rows[:, None]).sum()


def count_samples(places: Array, bounds: Array) -> Any:
    """Number of samples within its bounds that each triangle covers."""
    rows = [range(0, last - first + 1, SIDE * SIDE) for first, last in bounds[2:].T]
    return np.array(
        [
            sum(count_rows(corners, limits, start) for start in starts)
            for corners, limits, starts in zip(places, bounds.T, rows, strict=True)
        ]
    )


def depth_of_samples(
    k: int, bounds: Array, window: Window, plane64: Array, plane32: Array
) -> Arrays:
    """Memory index and 1/z of sample k of the 2 x 2 samples of each triangle."""
    x, y = bounds[0] + k % 2, bounds[2] + k // 2
    sample, start = block_starts(x // SIDE, y // SIDE, window, plane64)
    step_x, step_y, least, greatest = plane32
    in_x, in_y = np.float32(x % SIDE), np.float32(y % SIDE)
    depth = start + (step_x * in_x + step_y * in_y)
    return sample + y % SIDE * SIDE + x % SIDE, np.minimum(np.maximum(depth, least), greatest)


def depth_test(old: Array, covered: Array, plane32: Array, start: object) -> Arrays:
    """Depths of a block after a triangle is drawn: new ones, where written, written over, equal."""
    k = np.arange(SIDE * SIDE)
    step_x, step_y, least, greatest = plane32
    depth = start + (step_x * np.float32(k % SIDE) + step_y * np.float32(k // SIDE))
    depth = np.minimum(np.maximum(depth, least), greatest)
    wins = (depth > old) & covered
    return np.where(wins, depth, old), wins, wins & (old > 0), (depth == old) & covered


def _depths(plane32: Array, starts: Array) -> Any:
    """1/z (N, 16) at the samples of blocks."""
    k = np.arange(SIDE * SIDE)
    step_x, step_y, least, greatest = plane32
    depth = starts[:, None] + (step_x * np.float32(k % SIDE) + step_y * np.float32(k // SIDE))
    return np.minimum(np.maximum(depth, least), greatest)


def hidden_blocks(plane32: Array, starts: Array, bound: object) -> Any:
    """Blocks (N,) at whose samples 1/z of a triangle is less than a bound."""
    return (_depths(plane32, starts) < bound).all(axis=1)


def least_in_tile(plane32: Array, starts: Array) -> Any:
    """Least 1/z of a triangle at the samples of blocks."""
    return _depths(plane32, starts).min()


def least_depth(depth: Array, block: int, columns: int, n_rows: int) -> Any:
    """Least 1/z of 4 blocks in each of some rows of blocks."""
    rows = depth.reshape(-1, columns, SIDE * SIDE)
    row, column = divmod(block, columns)
    return rows[row : row + n_rows, column : column + SIDE].min()


def nearest_vertex(w: Array) -> Any:
    """Greatest 1/z of the vertices of a cluster."""
    return w.max().astype(np.float32)


def append_set_bits(listed: Array, bits: Array, base: int) -> Any:
    """List with base + index of each set bit behind it."""
    return np.append(listed, base + np.flatnonzero(bits))


def count_triangle(
    x: Array,
    y: Array,
    plane: tuple[float, float, float],
    least: float,
    greatest: float,
    tile: tuple[int, int, int, int],
    runs: tuple[Array, Array],
    depth: Array,
) -> tuple[int, int]:
    """Samples that a part of a face covers, and those of them with no surface in front of it.

    Arguments as of `rastercov.native.engine_raster.count_triangle`.
    """
    left, top, width, height = tile
    rows, columns = np.mgrid[top : top + height, left : left + width]
    covered = covers(np.stack((x, y), axis=-1), columns, rows)
    covered &= (columns >= runs[0][rows]) & (columns < runs[1][rows])
    inverse = np.clip(plane[0] + plane[2] * rows + plane[1] * columns, least, greatest)
    seen = covered & (inverse * depth * (1 + TIE_REL) >= 1) if depth.size else np.False_
    return int(covered.sum()), int(seen.sum())
