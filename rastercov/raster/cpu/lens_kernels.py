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
from rastercov.raster.cpu.lens_cover import (
    clear,
    count_covered,
    count_seen,
    cover,
    same_face,
    tiles_met,
)
from rastercov.raster.cpu.lens_records import SAMPLES, TILE, FacePlanes, Reach, Samples
from rastercov.raster.cpu.memory import LANES
from rastercov.raster.cpu.simd_kernel import (
    append_set_bits,
    count_bits,
    lowest_bit,
    pointer,
    pointers,
)

LOOKUPS = 2
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
MARGIN_REL = 1e-6
"""Margin of a tile beside an edge or a box, relative to 1 + |x| + |y|, for rounding to float32:
2^-24 for each of three numbers of an edge, the box, two products and two sums, with a factor of
2."""
SLACK = 1e-7
"""Margin of the box of a face for rounding, relative, in units of the plane."""
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
def cell_of(value, low, cells_a_unit, n):
    """Cell of the first level that holds a coordinate; that at the border for one beyond it."""
    return np.int64(min(max((value - low) * cells_a_unit, 0.0), n - 1.0))


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
    first_column = first_row = np.int64(1 << 30)
    last_column = last_row = np.int64(-1)
    for j in range(j0 >> level, (j1 >> level) + 1):
        row = patch.starts[level] + j * widths[level]
        for i in range(i0 >> level, (i1 >> level) + 1):
            first_column = min(first_column, np.int64(patch.cells[row + i, 0]))
            last_column = max(last_column, np.int64(patch.cells[row + i, 1]))
            first_row = min(first_row, np.int64(patch.cells[row + i, 2]))
            last_row = max(last_row, np.int64(patch.cells[row + i, 3]))
    return Reach(x0, x1, y0, y1, first_column, last_column, first_row, last_row)


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
    if not (np.isfinite(a3) and np.isfinite(b3) and np.isfinite(c3)):
        a3, b3, c3 = 0.0, 0.0, greatest
    return FacePlanes(
        a0, b0, c0, d0, a1, b1, c1, d1, a2, b2, c2, d2, a3, b3, c3, behind, cut, least, greatest,
        px, py, pz, qx, qy, qz, rx, ry, rz, side, t0, t1, t2,
    )  # fmt: skip


@part_with_arrays
def is_out_of_sight(x0, x1, y0, y1, patch):
    """True where a box of the plane has no sample."""
    low, high = patch.low, patch.high
    return x1 < low[0] or x0 > high[0] or y1 < low[1] or y0 > high[1]


@part_with_arrays
def list_tiles(e, at, patch, listed):
    """List the tiles that a face may cover; returns their number."""
    boxes, table, tiles = pointer(patch.boxes), pointer(listed.bit_indices), pointer(listed.tiles)
    n_boxes, margin, n = patch.boxes.shape[1], MARGIN_REL * patch.reach, 0
    for row in range(at.first_row, at.last_row + 1):
        end = row * patch.columns + at.last_column + 1
        for first in range(row * patch.columns + at.first_column, end, LANES):
            bits = tiles_met(e, at, boxes, n_boxes, first, end - first, margin)
            if bits:
                n = append_set_bits(table, bits, first, tiles, n)
    return n


@allocation_free
def draw(points, faces, near, front_only, patch, listed, image, drawn, with_drawn):
    """Draw all faces on the samples of a patch, and add to (F,) `drawn` what each covers.

    Parameters
    ----------
    points : (V, 3) float64
        Vertices, in axes of the plane.
    faces : (F, 3) int32
        Of equally near faces the first is drawn.
    near : float
        Depth of the near plane, metres.
    front_only : bool
        Faces that are seen from behind are counted, not drawn.
    patch, listed, image : Patch, Listed, Image
    drawn : (F,) int32
        Not used where `with_drawn` is False.
    """
    samples = pointers(Samples(patch.centres, patch.x, patch.y))
    inverse, face = pointer(image.inverse), pointer(image.face)
    for f in range(faces.shape[0]):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        if not max(points[i, 2], points[j, 2], points[k, 2]) >= near:
            continue
        height, rounding = height_of(points, i, j, k)
        is_drawn = not (front_only and height > rounding)
        if not is_drawn and not with_drawn:
            continue
        x0, x1, y0, y1 = box_of(points, i, j, k, near)
        if is_out_of_sight(x0, x1, y0, y1, patch):
            continue
        at = tiles_in(x0, x1, y0, y1, patch)
        # Edge-on the sign is not known; the samples where all three edges agree are the face.
        is_both = abs(height) <= rounding
        for turn in range(2 if is_both else 1):
            side = 1.0 if (height > 0.0) != (turn == 1) else -1.0
            e = planes_of(points, i, j, k, height, side, near, patch)
            covered = 0
            for n in range(list_tiles(e, at, patch, listed)):
                tile = listed.tiles[n]
                if is_drawn:
                    if not image.is_touched[tile]:
                        image.is_touched[tile] = True
                        clear(tile, inverse, face)
                    covered += cover(e, f, tile, samples, inverse, face)
                else:
                    covered += count_covered(e, tile, samples)
            if with_drawn:
                drawn[f] += covered


@allocation_free
def count_targets(points, faces, near, patch, listed, image, visible, drawn):
    """Add the samples of targets to their counts, (N,) each; arguments as for `draw`."""
    samples = pointers(Samples(patch.centres, patch.x, patch.y))
    inverse = pointer(image.inverse)
    for f in range(faces.shape[0]):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        if not max(points[i, 2], points[j, 2], points[k, 2]) >= near:
            continue
        height, rounding = height_of(points, i, j, k)
        x0, x1, y0, y1 = box_of(points, i, j, k, near)
        if is_out_of_sight(x0, x1, y0, y1, patch):
            continue
        at = tiles_in(x0, x1, y0, y1, patch)
        for turn in range(2 if abs(height) <= rounding else 1):
            side = 1.0 if (height > 0.0) != (turn == 1) else -1.0
            e = planes_of(points, i, j, k, height, side, near, patch)
            for n in range(list_tiles(e, at, patch, listed)):
                tile = listed.tiles[n]
                covered = count_covered(e, tile, samples)
                drawn[f] += covered
                if image.is_touched[tile]:
                    covered = count_seen(e, tile, samples, inverse)
                visible[f] += covered


@allocation_free
def count_visible(image, visible):
    """Add the samples of each face to (F,) `visible`; returns how many samples have a face."""
    filled, face = 0, pointer(image.face)
    for tile in range(image.is_touched.shape[0]):
        if not image.is_touched[tile]:
            continue
        left = (1 << SAMPLES) - 1
        while left:
            f = image.face[tile, lowest_bit(left)]
            bits = same_face(face, tile, f)
            if f >= 0:
                n = count_bits(bits)
                visible[f] += n
                filled += n
            left &= ~bits
    return filled


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
            if image.face[tile, s] >= 0 and row < height and column < width:
                z = 1.0 / np.float64(image.inverse[tile, s])
                if by_ray:
                    x = patch.centres[tile, 0] + patch.x[tile, s]
                    y = patch.centres[tile, 1] + patch.y[tile, s]
                    z *= np.sqrt(1.0 + x * x + y * y)
                face[row, column], depth[row, column] = image.face[tile, s], z


@allocation_free
def fill_cells(x, y, columns, low, cells_a_unit, width, height, cells):
    """Fill the first level of `Patch.cells` from the places (T, 16) of samples."""
    for c in range(width * height):
        cells[c, 0] = cells[c, 2] = 1 << 30
        cells[c, 1] = cells[c, 3] = -1
    for tile in range(x.shape[0]):
        row, column = tile // columns, tile % columns
        for s in range(SAMPLES):
            if x[tile, s] == x[tile, s]:
                i = cell_of(x[tile, s], low[0], cells_a_unit, width)
                c = cell_of(y[tile, s], low[1], cells_a_unit, height) * width + i
                cells[c, 0], cells[c, 1] = min(cells[c, 0], column), max(cells[c, 1], column)
                cells[c, 2], cells[c, 3] = min(cells[c, 2], row), max(cells[c, 3], row)


@allocation_free
def merge_cells(cells, starts, widths, heights):
    """Fill the other levels of `Patch.cells`."""
    for level in range(1, starts.shape[0]):
        width, below = widths[level], starts[level - 1]
        for c in range(starts[level], starts[level] + width * heights[level]):
            cells[c, 0] = cells[c, 2] = 1 << 30
            cells[c, 1] = cells[c, 3] = -1
        for j in range(heights[level - 1]):
            for i in range(widths[level - 1]):
                a, b = (
                    starts[level] + (j >> 1) * width + (i >> 1),
                    below + j * widths[level - 1] + i,
                )
                cells[a, 0], cells[a, 1] = (
                    min(cells[a, 0], cells[b, 0]),
                    max(cells[a, 1], cells[b, 1]),
                )
                cells[a, 2], cells[a, 3] = (
                    min(cells[a, 2], cells[b, 2]),
                    max(cells[a, 3], cells[b, 3]),
                )
