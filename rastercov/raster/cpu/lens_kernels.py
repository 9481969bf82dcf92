"""Loops that draw faces on samples at any places of an ideal plane, compiled by numba.

A face a, b, c covers the ray r = (x, y, 1) where r is on the inner side of the planes through the
eye and its edges, and r = (r.(b x c) a + r.(c x a) b + r.(a x b) c) / a.(b x c); so

    1/z = n.r / n.a,    n = (b - a) x (c - a)

is the sum of the three weights, whatever lies behind the eye: no face is clipped. A product a x b
is -(b x a) to the bit, in IEEE arithmetic without contraction. So both faces of an edge compute a
number of one size for a sample, of opposite signs, and exactly one owns a sample where it is 0.

M. Olano, T. Greer. Triangle Scan Conversion using 2D Homogeneous Coordinates. 1997.
"""

import numpy as np

from rastercov._jit import allocation_free, part_with_arrays
from rastercov.lenses.lane_kernels import vertex_images
from rastercov.raster.cpu.lens_cells import cell_of
from rastercov.raster.cpu.lens_cover import (
    clear,
    count_covered,
    count_seen,
    cover,
    put_face,
    range_of_cells,
    request,
    same_face,
    tiles_met,
)
from rastercov.raster.cpu.lens_records import (
    FACES_AT_A_TIME,
    SAMPLES,
    TILE,
    TILES_AT_A_TIME,
    FacePlanes,
    Reach,
    Samples,
)
from rastercov.raster.cpu.memory import LANES
from rastercov.raster.cpu.simd_kernel import (
    append_set_bits,
    count_bits,
    lowest_bit,
    pointer,
    pointers,
)

AHEAD = 24
"""Tiles that are requested from memory before one is drawn."""
LOOKUPS = 4
"""Cells of a side, less one, that are looked up for a face."""
DOUBT_REL = 1e-14
"""Rounding of an edge at a sample relative to both its corners and the sample, with a factor of
5."""
DOUBT32_REL = 1e-6
"""Rounding to float32 of an edge at a sample relative to its change within a block, where the edge
crosses the block: 2^-24 for each of its value at the center, two products and two sums, all of them
at most three times the change, with a factor of 2."""
ROUNDING_REL = 1e-14
"""Rounding of n.a relative to the cube of the largest coordinate, with a factor of 5."""
CANVAS_MARGIN = 0.01
"""Samples: margin of the box of a face on the canvas, for rounding of places to float32, 1e-6, and
of the lens, 1e-9."""
MOST_STRAY = 8.0
"""Samples that sides of a face may leave their chords by, for its box to be made from its corners.
"""
MARGIN_REL = 1e-6
"""Margin of a tile beside an edge or a box, relative to 1 + |x| + |y|, for rounding to float32:
2^-24 for each of three numbers of an edge, the box, two products and two sums, with a factor of
2."""
SLACK = 1e-7
"""Margin of the box of a face for rounding, relative, in units of the plane."""
LEAST_DOUBT = 1e-30
"""Doubt of an edge at least: its inverse is a float32, and so are its slopes times that."""
MOST_SLOPE = 1e30
"""Change of 1/z at most, in 1/m to the unit of the plane: all sums of it are float32, never NaN. A
face beyond it is seen from its side, and its 1/z is that of its nearest corner."""
LEAST = 5e-324
"""Smallest positive number: e >= LEAST is e > 0."""


@allocation_free
def put_in_plane(vertices, eye, axes, points):
    """Write the points (V, 3) of a plane for vertices (V, 3) of the world.

    `axes`, (3, 3), is world_from_plane.
    """
    for i in range(vertices.shape[0]):
        x, y, z = vertices[i, 0] - eye[0], vertices[i, 1] - eye[1], vertices[i, 2] - eye[2]
        for k in range(3):
            points[i, k] = x * axes[0, k] + y * axes[1, k] + z * axes[2, k]


@allocation_free
def put_on_canvas(near, patch, seen):
    """Fill `seen.xy` and `seen.uv` from `seen.points`."""
    points, xy, uv, is_inside = seen.points, seen.xy, seen.uv, seen.is_inside
    for i in range(points.shape[0]):
        w = 1.0 / points[i, 2]
        x, y = points[i, 0] * w, points[i, 1] * w
        xy[i, 0], xy[i, 1] = x, y
        is_inside[i] = points[i, 2] >= near and x * x + y * y < patch.radius2
    vertex_images(patch.plane, xy, is_inside, seen.lanes, uv)
    to = patch.canvas
    for i in range(points.shape[0]):
        u, v = uv[i, 0], uv[i, 1]
        uv[i, 0] = to[0, 0] * u + to[0, 1] * v + to[0, 2]
        uv[i, 1] = to[1, 0] * u + to[1, 1] * v + to[1, 2]


@part_with_arrays
def least_sum(a, b, c):
    """Least value that is inside an edge: its line is inside for one of two faces alone."""
    owns = a > 0.0 or (a == 0.0 and (b > 0.0 or (b == 0.0 and c > 0.0)))
    return 0.0 if owns else LEAST


@part_with_arrays
def box_of(points, i, j, k, near):
    """Box (x0, x1, y0, y1) of what of a face is beyond the near plane, in units of the plane."""
    x0 = y0 = np.inf
    x1 = y1 = -np.inf
    for side in range(3):
        p, q = (i, j) if side == 0 else ((j, k) if side == 1 else (k, i))
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        end = points[q, 2]
        if z >= near:
            u, v = x / z, y / z
            x0, x1, y0, y1 = min(x0, u), max(x1, u), min(y0, v), max(y1, v)
        if (z >= near) != (end >= near):
            t = (near - z) / (end - z)
            u, v = (x + t * (points[q, 0] - x)) / near, (y + t * (points[q, 1] - y)) / near
            x0, x1, y0, y1 = min(x0, u), max(x1, u), min(y0, v), max(y1, v)
    across, down = SLACK * (1.0 + abs(x0) + abs(x1)), SLACK * (1.0 + abs(y0) + abs(y1))
    return x0 - across, x1 + across, y0 - down, y1 + down


@part_with_arrays
def tiles_in(x0, x1, y0, y1, patch):
    """Tiles that have samples in a box of the plane, and perhaps more."""
    widths, heights = patch.widths, patch.heights
    i0 = cell_of(x0, patch.low[0], patch.cells_a_unit, widths[0])
    i1 = cell_of(x1, patch.low[0], patch.cells_a_unit, widths[0])
    j0 = cell_of(y0, patch.low[1], patch.cells_a_unit, heights[0])
    j1 = cell_of(y1, patch.low[1], patch.cells_a_unit, heights[0])
    level = 0
    while max((i1 >> level) - (i0 >> level), (j1 >> level) - (j0 >> level)) > LOOKUPS:
        level += 1
    i0, i1, j0, j1 = i0 >> level, i1 >> level, j0 >> level, j1 >> level
    width = widths[level]
    first_column, last_column, first_row, last_row = range_of_cells(
        pointer(patch.cells), patch.starts[level] + j0 * width + i0, i1 - i0 + 1, j1 - j0 + 1, width
    )
    return Reach(x0, x1, y0, y1, first_column, last_column, first_row, last_row)


@part_with_arrays
def tiles_between(u0, u1, first, n):
    """First and last of n tiles, from one on, with a sample between two places of the canvas."""
    low = max((u0 - CANVAS_MARGIN - 0.5) / TILE - first, -1.0)
    high = min((u1 + CANVAS_MARGIN - 0.5) / TILE - first, float(n))
    return np.int64(max(np.floor(low), 0.0)), np.int64(min(np.floor(high), n - 1.0))


@part_with_arrays
def reach_of(seen, i, j, k, near, patch):
    """Tiles that a face may reach; the first row is after the last if there are none.

    The image of a face whose corners may be put through the lens is inside the box of the images of
    its sides. Other faces are looked up on the plane.
    """
    xy, uv = seen.xy, seen.uv
    if seen.is_inside[i] and seen.is_inside[j] and seen.is_inside[k]:
        x0, x1 = min(xy[i, 0], xy[j, 0], xy[k, 0]), max(xy[i, 0], xy[j, 0], xy[k, 0])
        y0, y1 = min(xy[i, 1], xy[j, 1], xy[k, 1]), max(xy[i, 1], xy[j, 1], xy[k, 1])
        # No side is longer than the diagonal of the box.
        stray = patch.bend * ((x1 - x0) * (x1 - x0) + (y1 - y0) * (y1 - y0))
        if stray <= MOST_STRAY:
            u0, u1 = min(uv[i, 0], uv[j, 0], uv[k, 0]), max(uv[i, 0], uv[j, 0], uv[k, 0])
            v0, v1 = min(uv[i, 1], uv[j, 1], uv[k, 1]), max(uv[i, 1], uv[j, 1], uv[k, 1])
            n_rows = patch.x.shape[0] // patch.columns
            left, right = tiles_between(u0 - stray, u1 + stray, patch.first_column, patch.columns)
            top, bottom = tiles_between(v0 - stray, v1 + stray, patch.first_row, n_rows)
            across = SLACK * (1.0 + abs(x0) + abs(x1))
            down = SLACK * (1.0 + abs(y0) + abs(y1))
            if right < left:
                bottom = top - 1
            return Reach(x0 - across, x1 + across, y0 - down, y1 + down, left, right, top, bottom)
    x0, x1, y0, y1 = box_of(seen.points, i, j, k, near)
    if is_out_of_sight(x0, x1, y0, y1, patch):
        nothing = np.int64(0)
        return Reach(x0, x1, y0, y1, nothing, nothing, nothing + 1, nothing)
    return tiles_in(x0, x1, y0, y1, patch)


@part_with_arrays
def height_of(points, i, j, k):
    """Return n.a of a face, negative where it is seen from its front, and its rounding."""
    ax, ay, az = points[i, 0], points[i, 1], points[i, 2]
    bx, by, bz = points[j, 0] - ax, points[j, 1] - ay, points[j, 2] - az
    cx, cy, cz = points[k, 0] - ax, points[k, 1] - ay, points[k, 2] - az
    height = (by * cz - bz * cy) * ax + (bz * cx - bx * cz) * ay + (bx * cy - by * cx) * az
    size = max(
        max(abs(ax), abs(ay), abs(az)),
        max(abs(points[j, 0]), abs(points[j, 1]), abs(points[j, 2])),
        max(abs(points[k, 0]), abs(points[k, 1]), abs(points[k, 2])),
    )
    return height, ROUNDING_REL * size * size * size


@part_with_arrays
def scale_of(a, b, c):
    """Factor that brings a plane to the size of 1, the same for both faces of an edge."""
    size = abs(a) + abs(b) + abs(c)
    return 1.0 / size if size > 0.0 else 1.0


@part_with_arrays
def planes_of(points, i, j, k, height, side, near, patch):
    """Planes of a face, with the inner side of its edges where their sign is that of `side`."""
    px, py, pz = points[i, 0], points[i, 1], points[i, 2]
    qx, qy, qz = points[j, 0], points[j, 1], points[j, 2]
    rx, ry, rz = points[k, 0], points[k, 1], points[k, 2]
    a0, b0, c0 = side * (py * qz - pz * qy), side * (pz * qx - px * qz), side * (px * qy - py * qx)
    a1, b1, c1 = side * (qy * rz - qz * ry), side * (qz * rx - qx * rz), side * (qx * ry - qy * rx)
    a2, b2, c2 = side * (ry * pz - rz * py), side * (rz * px - rx * pz), side * (rx * py - ry * px)
    t0, t1, t2 = least_sum(a0, b0, c0), least_sum(a1, b1, c1), least_sum(a2, b2, c2)
    s0, s1, s2 = scale_of(a0, b0, c0), scale_of(a1, b1, c1), scale_of(a2, b2, c2)
    a0, b0, c0, a1, b1, c1 = a0 * s0, b0 * s0, c0 * s0, a1 * s1, b1 * s1, c1 * s1
    a2, b2, c2 = a2 * s2, b2 * s2, c2 * s2
    p, q = max(abs(px), abs(py), abs(pz)), max(abs(qx), abs(qy), abs(qz))
    r = max(abs(rx), abs(ry), abs(rz))
    doubt, doubt32 = DOUBT_REL * patch.reach, DOUBT32_REL * patch.half
    d0 = doubt * p * q * s0 + doubt32 * (abs(a0) + abs(b0))
    d1 = doubt * q * r * s1 + doubt32 * (abs(a1) + abs(b1))
    d2 = doubt * r * p * s2 + doubt32 * (abs(a2) + abs(b2))
    ux, uy, uz, vx, vy, vz = qx - px, qy - py, qz - pz, rx - px, ry - py, rz - pz
    a3, b3 = (uy * vz - uz * vy) / height, (uz * vx - ux * vz) / height
    c3 = (ux * vy - uy * vx) / height
    nearest, least = min(pz, qz, rz), 1.0 / max(pz, qz, rz)
    behind, cut, greatest = -np.inf, np.inf, 1.0 / max(nearest, near)
    if nearest < near:
        behind, cut = 0.0, greatest
    if not (abs(a3) <= MOST_SLOPE and abs(b3) <= MOST_SLOPE and abs(c3) <= MOST_SLOPE):
        a3, b3, c3 = 0.0, 0.0, greatest
    return FacePlanes(
        a0, b0, c0, d0, a1, b1, c1, d1, a2, b2, c2, d2, a3, b3, c3, behind, cut, least, greatest,
        px, py, pz, qx, qy, qz, rx, ry, rz, side, t0, t1, t2,
        1.0 / max(d0, LEAST_DOUBT), 1.0 / max(d1, LEAST_DOUBT), 1.0 / max(d2, LEAST_DOUBT),
    )  # fmt: skip


@allocation_free
def sees(patch, near, corners):
    """False where a box, by its 8 corners in axes of the plane, has no sample of a patch.

    True where rounding may decide.
    """
    low, high = patch.low, patch.high
    size = 0.0
    left = right = above = below = behind = True
    for i in range(corners.shape[0]):
        x, y, z = corners[i, 0], corners[i, 1], corners[i, 2]
        size = max(size, abs(x), abs(y), abs(z))
    margin = SLACK * patch.reach * size
    for i in range(corners.shape[0]):
        x, y, z = corners[i, 0], corners[i, 1], corners[i, 2]
        left, right = left and x - low[0] * z < -margin, right and x - high[0] * z > margin
        above, below = above and y - low[1] * z < -margin, below and y - high[1] * z > margin
        behind = behind and z < near
    return not (left or right or above or below or behind)


@part_with_arrays
def is_out_of_sight(x0, x1, y0, y1, patch):
    """True where a box of the plane has no sample."""
    low, high = patch.low, patch.high
    return x1 < low[0] or x0 > high[0] or y1 < low[1] or y0 > high[1]


@part_with_arrays
def list_tiles(e, at, patch, listed, n):
    """List the tiles that a face may cover, from place n on; returns their end."""
    boxes, table, tiles = pointer(patch.boxes), pointer(listed.bit_indices), pointer(listed.tiles)
    n_boxes, margin = patch.boxes.shape[1], MARGIN_REL * patch.reach
    for row in range(at.first_row, at.last_row + 1):
        end = row * patch.columns + at.last_column + 1
        for first in range(row * patch.columns + at.first_column, end, LANES):
            bits = tiles_met(e, at, boxes, n_boxes, first, end - first, margin)
            if bits:
                n = append_set_bits(table, bits, first, tiles, n)
    return n


@allocation_free
def draw(seen, faces, near, front_only, patch, listed, image, visible, drawn, with_drawn):
    """Draw all faces on the samples of a patch; returns how many samples show one.

    Parameters
    ----------
    seen : Seen
        The vertices, by `put_in_plane` and `put_on_canvas`.
    faces : (F, 3) int32
        Of equally near faces the first is drawn.
    near : float
        Depth of the near plane, metres.
    front_only : bool
        Faces that are seen from behind are counted, not drawn.
    patch, listed, image : Patch, Listed, Image
    visible, drawn : (F,) int32
        In and out: samples that show a face, and those it covers; `drawn` is not used where
        `with_drawn` is False. A sample is counted when a face is put on it, and taken off the count
        of the face that it had.
    """
    filled = n_listed = n_tiles = 0
    points = seen.points
    for f in range(faces.shape[0]):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        if not max(points[i, 2], points[j, 2], points[k, 2]) >= near:
            continue
        height, rounding = height_of(points, i, j, k)
        is_drawn = not (front_only and height > rounding)
        if not is_drawn and not with_drawn:
            continue
        at = reach_of(seen, i, j, k, near, patch)
        if at.first_row > at.last_row:
            continue
        # Edge-on the sign is not known; the samples where all three edges agree are the face.
        for turn in range(2 if abs(height) <= rounding else 1):
            side = 1.0 if (height > 0.0) != (turn == 1) else -1.0
            e = planes_of(points, i, j, k, height, side, near, patch)
            end = list_tiles(e, at, patch, listed, n_tiles)
            if end == n_tiles:
                continue
            listed.faces[n_listed], listed.ends[n_listed] = f, end
            listed.heights[n_listed], listed.sides[n_listed] = height, side
            listed.is_drawn[n_listed] = is_drawn
            n_listed, n_tiles = n_listed + 1, end
            if n_listed == FACES_AT_A_TIME or n_tiles >= TILES_AT_A_TIME:
                filled += draw_listed(
                    n_listed, points, faces, near, patch, listed, image, visible, drawn, with_drawn
                )
                n_listed = n_tiles = 0
    return filled + draw_listed(
        n_listed, points, faces, near, patch, listed, image, visible, drawn, with_drawn
    )


@allocation_free
def draw_listed(n_listed, points, faces, near, patch, listed, image, visible, drawn, with_drawn):
    """Draw the first faces that are listed; arguments and result as of `draw`."""
    samples = pointers(Samples(patch.centres, patch.x, patch.y))
    inverse, face, is_touched = pointer(image.inverse), pointer(image.face), image.is_touched
    tiles = pointer(listed.tiles)
    filled, at = 0, 0
    n_tiles = listed.ends[n_listed - 1] if n_listed > 0 else 0
    for n in range(min(n_tiles, AHEAD)):
        request(tiles[n], samples, inverse, face)
    for row in range(n_listed):
        f, end, is_drawn = listed.faces[row], listed.ends[row], listed.is_drawn[row]
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        e = planes_of(points, i, j, k, listed.heights[row], listed.sides[row], near, patch)
        covered = gained = 0
        for n in range(at, end):
            if n + AHEAD < n_tiles:
                request(tiles[n + AHEAD], samples, inverse, face)
            tile = np.int64(tiles[n])
            if not is_drawn:
                covered += count_covered(e, tile, samples)
                continue
            if not is_touched[tile]:
                is_touched[tile] = True
                clear(tile, inverse)
            bits, won, lost = cover(e, tile, samples, inverse)
            if with_drawn:
                covered += count_bits(bits)
            gained += count_bits(won)
            while lost:
                loser = face[tile * SAMPLES + lowest_bit(lost)]
                its = same_face(face, tile, loser) & lost
                visible[loser] -= count_bits(its)
                filled -= count_bits(its)
                lost &= ~its
            put_face(f, won, tile, face)
        at = end
        if gained:
            visible[f] += gained
            filled += gained
        if with_drawn:
            drawn[f] += covered
    return filled


@allocation_free
def count_targets(seen, faces, near, patch, listed, image, visible, drawn):
    """Add the samples of targets to their counts, (N,) each; arguments as for `draw`."""
    points = seen.points
    samples = pointers(Samples(patch.centres, patch.x, patch.y))
    inverse = pointer(image.inverse)
    for f in range(faces.shape[0]):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        if not max(points[i, 2], points[j, 2], points[k, 2]) >= near:
            continue
        height, rounding = height_of(points, i, j, k)
        at = reach_of(seen, i, j, k, near, patch)
        if at.first_row > at.last_row:
            continue
        for turn in range(2 if abs(height) <= rounding else 1):
            side = 1.0 if (height > 0.0) != (turn == 1) else -1.0
            e = planes_of(points, i, j, k, height, side, near, patch)
            for n in range(list_tiles(e, at, patch, listed, 0)):
                tile = listed.tiles[n]
                covered = count_covered(e, tile, samples)
                drawn[f] += covered
                if image.is_touched[tile]:
                    covered = count_seen(e, tile, samples, inverse)
                visible[f] += covered


@allocation_free
def read_image(image, patch, by_ray, face, depth):
    """Write faces (H, W) and depths (H, W) float32, in metres, of samples that have a face.

    `by_ray`: depth is the distance along the ray, otherwise z.
    """
    height, width = face.shape
    for tile in range(image.is_touched.shape[0]):
        if not image.is_touched[tile]:
            continue
        top = TILE * (patch.first_row + tile // patch.columns)
        left = TILE * (patch.first_column + tile % patch.columns)
        for s in range(SAMPLES):
            row, column = top + s // TILE, left + s % TILE
            if image.inverse[tile, s] > 0.0 and row < height and column < width:
                z = 1.0 / np.float64(image.inverse[tile, s])
                if by_ray:
                    x = patch.centres[tile, 0] + patch.x[tile, s]
                    y = patch.centres[tile, 1] + patch.y[tile, s]
                    z *= np.sqrt(1.0 + x * x + y * y)
                face[row, column], depth[row, column] = image.face[tile, s], z
