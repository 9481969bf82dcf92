"""Clusters and faces of the rasteriser of lenses, and the tiles that they may cover; by numba.

See `raster_lens`.
"""

import numpy as np

from rastercov.kernels.jit import allocation_free, part_with_arrays
from rastercov.kernels.lens_lanes import project_lanes
from rastercov.kernels.raster_lens_cells import cell_of
from rastercov.kernels.raster_lens_cover import (
    append_tiles,
    bounds_in,
    chords_in,
    planes_in,
    range_of_cells,
    tiles_met,
    tiles_met_by_chords,
)
from rastercov.kernels.raster_lens_records import (
    AXES,
    BEND,
    CANVAS,
    EYE,
    FIRST_COLUMN,
    FIRST_ROW,
    HALF,
    HIGH,
    LAST_COLUMN,
    LAST_ROW,
    LOW,
    NEAR,
    RADIUS2,
    REACH,
    SAMPLES_HIGH,
    SAMPLES_LOW,
    SLOTS,
    TILE,
    Chords,
    FacePlanes,
)
from rastercov.kernels.raster_lens_setup import (
    SLACK,
    cull_clusters,
    place_vertices,
    put_on_canvas,
    put_twin,
    set_up_faces,
)
from rastercov.kernels.raster_memory import ALL_LANES, FACES, LANES, SIDE, Mesh
from rastercov.kernels.raster_occlusion import order_by_depth
from rastercov.kernels.simd_kernel import append_set_bits, lowest_bit, pointer, pointers

LOOKUPS = 4
"""Cells of a side, less one, that are looked up for a face."""


@part_with_arrays
def set_view(patch, eye, axes, near, view):
    """Fill `view` with a pose, world_from_plane (3, 3), and a patch; see `VIEW_VALUES`."""
    for i in range(3):
        view[EYE + i] = eye[i]
        for k in range(3):
            view[AXES + 3 * i + k] = axes[i, k]
            if i < 2:
                view[CANVAS + 3 * i + k] = patch.canvas[i, k]
    view[NEAR], view[RADIUS2], view[BEND] = near, patch.radius2, patch.bend
    view[REACH], view[HALF] = patch.reach, patch.half
    first = patch.first_column, patch.first_row
    count = patch.columns, patch.x.shape[0] // patch.columns
    for k in range(2):
        view[LOW + k], view[HIGH + k] = patch.low[k], patch.high[k]
        view[SAMPLES_LOW + k] = TILE * first[k]
        view[SAMPLES_HIGH + k] = TILE * (first[k] + count[k]) - 1


@part_with_arrays
def box_of(vertices, i, j, k, near):
    """Box (x0, x1, y0, y1) of what of a face is beyond the near plane, in units of the plane."""
    x0 = y0 = np.inf
    x1 = y1 = -np.inf
    for side in range(3):
        p, q = (i, j) if side == 0 else ((j, k) if side == 1 else (k, i))
        x, y, z = vertices.x[p], vertices.y[p], vertices.z[p]
        end = vertices.z[q]
        if z >= near:
            u, v = x / z, y / z
            x0, x1, y0, y1 = min(x0, u), max(x1, u), min(y0, v), max(y1, v)
        if (z >= near) != (end >= near):
            t = (near - z) / (end - z)
            u = (x + t * (vertices.x[q] - x)) / near
            v = (y + t * (vertices.y[q] - y)) / near
            x0, x1, y0, y1 = min(x0, u), max(x1, u), min(y0, v), max(y1, v)
    across, down = SLACK * (1.0 + abs(x0) + abs(x1)), SLACK * (1.0 + abs(y0) + abs(y1))
    return x0 - across, x1 + across, y0 - down, y1 + down


@part_with_arrays
def tiles_in(x0, x1, y0, y1, patch):
    """Tiles that have samples in a box of the plane, and perhaps more: columns and rows.

    The first row is after the last where there are none.
    """
    low, high, widths, heights = patch.low, patch.high, patch.widths, patch.heights
    if x1 < low[0] or x0 > high[0] or y1 < low[1] or y0 > high[1]:
        nothing = np.int64(0)
        return nothing, nothing, nothing + 1, nothing
    i0 = cell_of(x0, low[0], patch.cells_a_unit, widths[0])
    i1 = cell_of(x1, low[0], patch.cells_a_unit, widths[0])
    j0 = cell_of(y0, low[1], patch.cells_a_unit, heights[0])
    j1 = cell_of(y1, low[1], patch.cells_a_unit, heights[0])
    level = 0
    while max((i1 >> level) - (i0 >> level), (j1 >> level) - (j0 >> level)) > LOOKUPS:
        level += 1
    i0, i1, j0, j1 = i0 >> level, i1 >> level, j0 >> level, j1 >> level
    width = widths[level]
    return range_of_cells(
        pointer(patch.cells), patch.starts[level] + j0 * width + i0, i1 - i0 + 1, j1 - j0 + 1, width
    )


@part_with_arrays
def planes_of(setup, slot):
    """Planes of the face of a slot."""
    a0, a1, a2, a3, b0, b1, b2, b3, c0, c1, c2, c3 = planes_in(pointer(setup.planes), slot)
    least, greatest, behind, cut, l0, l1, l2 = bounds_in(pointer(setup.bounds), slot)
    return FacePlanes(
        a0, a1, a2, a3, b0, b1, b2, b3, c0, c1, c2, c3, least, greatest, behind, cut, l0, l1, l2,
        slot,
    )  # fmt: skip


@part_with_arrays
def tile_of(setup, row, slot):
    """Number of a row of `Setup.tiles`."""
    return np.int64(setup.tiles[row * SLOTS + slot])


@part_with_arrays
def list_face(setup, slot, is_drawn, has_chords, nearest, patch, image, listed, sizes):
    """List the face of a slot with the tiles that it may cover, if there are any.

    `nearest` is the greatest 1/z that may be seen behind `Image.bound`; `sizes` are the lengths of
    the lists of faces, tiles and whole tiles. Returns the new ones.
    """
    n_faces, n_tiles, n_whole = sizes
    end_tiles, end_whole = n_tiles, n_whole
    boxes, bound = pointer(patch.boxes), pointer(image.bound)
    tiles, whole = pointer(listed.tiles), pointer(listed.whole)
    table, columns = pointer(listed.bit_indices), patch.columns
    first_column, last_column = (
        tile_of(setup, FIRST_COLUMN, slot),
        tile_of(setup, LAST_COLUMN, slot),
    )
    first_row, last_row = tile_of(setup, FIRST_ROW, slot), tile_of(setup, LAST_ROW, slot)
    if has_chords:
        chords = Chords(*chords_in(pointer(setup.bounds), slot))
        for row in range(first_row, last_row + 1, SIDE):
            for column in range(first_column, last_column + 1, SIDE):
                met, own = tiles_met_by_chords(
                    chords, bound, columns, column, row, last_column, last_row, nearest
                )
                first = row * columns + column
                end_tiles = append_tiles(table, met & ~own, first, columns, tiles, end_tiles)
                if own:
                    end_whole = append_tiles(table, own, first, columns, whole, end_whole)
    else:
        e, n_boxes = planes_of(setup, slot), patch.boxes.shape[1]
        for row in range(first_row, last_row + 1):
            end = row * columns + last_column + 1
            for first in range(row * columns + first_column, end, LANES):
                met, own = tiles_met(e, boxes, n_boxes, bound, first, end - first, nearest)
                if met:
                    end_tiles = append_set_bits(table, met & ~own, first, tiles, end_tiles)
                    end_whole = append_set_bits(table, own, first, whole, end_whole)
    if end_tiles == n_tiles and end_whole == n_whole:
        return n_faces, n_tiles, n_whole
    listed.slots[n_faces], listed.is_drawn[n_faces] = slot, is_drawn
    listed.ends[n_faces, 0], listed.ends[n_faces, 1] = end_tiles, end_whole
    return n_faces + 1, end_tiles, end_whole


@part_with_arrays
def corner_of(mesh, slot, k):
    """Index in its cluster of corner k of a face."""
    return np.int64(mesh.corners[slot]) >> 8 * k & 255


@part_with_arrays
def slots_of(mesh, cluster):
    """Slots of the faces of a cluster, a multiple of `LANES`."""
    return np.int64(mesh.face_starts[cluster + 1] - mesh.face_starts[cluster])


@allocation_free
def prepare_cluster(mesh, cluster, patch, work):
    """Place the vertices of a cluster in a plane and on the canvas; see `put_on_canvas`."""
    view, lanes, vertices = pointer(work.pose), work.lanes, pointers(work.vertices)
    first = np.int64(mesh.vertex_starts[cluster])
    n = np.int64(mesh.vertex_starts[cluster + 1]) - first
    points, plane = pointer(mesh.points), patch.plane
    place_vertices(points, first, n, view, vertices, pointer(lanes.x), pointer(lanes.y))
    project_lanes(
        plane.code, plane.params, plane.frame, lanes.x, lanes.y, lanes.z, n, lanes.u, lanes.v
    )
    return put_on_canvas(n, view, vertices, pointer(lanes.u), pointer(lanes.v))


@allocation_free
def prepare_faces(mesh, cluster, at, front_only, near, patch, work):
    """Set up a vector of faces of a cluster.

    Returns the masks of those that are wanted, of those drawn, with twins, and with chords.
    See `set_up_faces`, whose faces without tiles get theirs by their boxes in the plane. Twins are
    in slots `FACES` after.
    """
    vertices, setup = pointers(work.vertices), pointers(work.setup)
    first = np.int64(mesh.face_starts[cluster])
    lists = Mesh(
        pointer(mesh.points), pointer(mesh.corners), pointer(mesh.faces), pointer(mesh.lines)
    )
    wanted, drawn, unplaced, edge_on, with_chords = set_up_faces(
        lists, first, at, front_only, vertices, pointer(work.pose), setup
    )
    rest, tiles = unplaced, work.setup.tiles
    while rest:
        k = at + lowest_bit(rest)
        rest &= rest - 1
        i, j = corner_of(mesh, first + k, 0), corner_of(mesh, first + k, 1)
        box = box_of(work.vertices, i, j, corner_of(mesh, first + k, 2), near)
        first_column, last_column, first_row, last_row = tiles_in(*box, patch)
        tiles[FIRST_COLUMN * SLOTS + k], tiles[LAST_COLUMN * SLOTS + k] = first_column, last_column
        tiles[FIRST_ROW * SLOTS + k], tiles[LAST_ROW * SLOTS + k] = first_row, last_row
    rest = edge_on
    while rest:
        k = at + lowest_bit(rest)
        rest &= rest - 1
        put_twin(k, FACES + k, setup)
    return wanted, drawn, edge_on, with_chords


@allocation_free
def list_clusters(mesh, hides_backs, work):
    """List the clusters that may be seen, about by depth, in `work.ordered`; their number."""
    bounds, view, forward = pointer(mesh.bounds), pointer(work.pose), pointer(work.forward)
    n = 0
    for at in range(0, mesh.n, LANES):
        found = cull_clusters(bounds, mesh.stride, at, view, hides_backs, forward)
        found &= ALL_LANES >> max(LANES - (mesh.n - at), 0)
        n = append_set_bits(pointer(work.listed.bit_indices), found, at, pointer(work.seen), n)
    lists = pointers(mesh)
    order_by_depth(
        lists, pointer(work.seen), n, forward, pointer(work.bucket_ends), pointer(work.ordered)
    )
    return n
