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

from rastercov.kernels.jit import allocation_free, part_with_arrays
from rastercov.kernels.raster_lens_cover import (
    bound_tile,
    count_covered,
    count_seen,
    cover,
    cover_cut,
    cover_whole,
    put_face,
    request,
    same_face,
)
from rastercov.kernels.raster_lens_listing import (
    list_clusters,
    list_face,
    planes_of,
    prepare_cluster,
    prepare_faces,
    set_view,
    slots_of,
    tile_of,
)
from rastercov.kernels.raster_lens_records import (
    FACE,
    GREATEST,
    SAMPLES,
    SLOTS,
    TILE,
    TILES_AT_A_TIME,
    Samples,
)
from rastercov.kernels.raster_lens_setup import CANVAS_MARGIN, SLACK
from rastercov.kernels.raster_memory import FACES, LANES
from rastercov.kernels.simd_kernel import align_stack, count_bits, lowest_bit, pointer, pointers

AHEAD = 24
"""Tiles that are requested from memory before one is drawn."""


@part_with_arrays
def is_hidden(box, patch, image):
    """True where all tiles that a cluster may reach are nearer than its nearest vertex."""
    low_u, high_u, low_v, high_v, stray, nearest, unknown = box
    if unknown != 0.0:  # also NaN
        return False
    stray += np.float32(
        CANVAS_MARGIN + 1e-6 * max(abs(low_u), abs(high_u), abs(low_v), abs(high_v))
    )
    n_rows = patch.x.shape[0] // patch.columns
    left, top = TILE * patch.first_column, TILE * patch.first_row
    first_column = np.int64(max(np.floor(low_u - stray - 0.5) - left, 0.0)) // TILE
    last_column = (
        np.int64(min(max(np.floor(high_u + stray - 0.5) - left, -1.0), TILE * patch.columns - 1.0))
        // TILE
    )
    first_row = np.int64(max(np.floor(low_v - stray - 0.5) - top, 0.0)) // TILE
    last_row = (
        np.int64(min(max(np.floor(high_v + stray - 0.5) - top, -1.0), TILE * n_rows - 1.0)) // TILE
    )
    for row in range(first_row, last_row + 1):
        for tile in range(
            row * patch.columns + first_column, row * patch.columns + last_column + 1
        ):
            bound = image.bound[tile]
            if bound == 0.0:
                bound = bound_tile(tile, pointer(image.inverse), pointer(image.bound))
            if not bound > nearest:
                return False
    return True


@allocation_free
def draw(mesh, eye, axes, near, front_only, patch, work, image, visible, drawn, with_drawn):
    """Draw all faces on the samples of a patch; returns how many samples show one.

    Parameters
    ----------
    mesh : Clusters
        Of equally near faces the first is drawn.
    eye, axes : (3,), (3, 3) float64
        Pose: the eye in axes of the mesh, and world_from_plane.
    near : float
        Depth of the near plane, metres.
    front_only : bool
        Faces that are seen from behind are counted, not drawn.
    patch, work, image : Patch, Workspace, Image
    visible, drawn : (F,) int32
        In and out: samples that show a face, and those it covers; `drawn` is not used where
        `with_drawn` is False. A sample is counted when a face is put on it, and taken off the count
        of the face that it had.
    """
    align_stack()
    set_view(patch, eye, axes, near, work.pose)
    for tile in range(image.bound.shape[0]):
        image.bound[tile] = -1.0
    n_clusters = list_clusters(mesh, np.int64(front_only and not with_drawn), work)
    filled = 0
    for c in range(n_clusters):
        cluster = np.int64(work.ordered[c])
        box = prepare_cluster(mesh, cluster, patch, work)
        if not with_drawn and is_hidden(box, patch, image):
            continue
        sizes = np.int64(0), np.int64(0), np.int64(0)
        for at in range(0, slots_of(mesh, cluster), LANES):
            wanted, shown, twins, with_chords = prepare_faces(
                mesh, cluster, at, np.int64(front_only), near, patch, work
            )
            rest = wanted if with_drawn else shown
            while rest:
                k = lowest_bit(rest)
                rest &= rest - 1
                for turn in range(1 + (twins >> k & 1)):
                    slot, is_drawn = at + k + FACES * turn, (shown >> k & 1) != 0
                    nearest = np.float32(np.inf)
                    if not with_drawn:
                        nearest = work.setup.bounds[GREATEST * SLOTS + slot]
                    sizes = list_face(
                        work.setup, slot, is_drawn, with_chords >> k & 1, nearest, patch, image,
                        work.listed, sizes,
                    )  # fmt: skip
                if sizes[1] + sizes[2] >= TILES_AT_A_TIME:
                    filled += draw_listed(sizes, patch, work, image, visible, drawn, with_drawn)
                    sizes = np.int64(0), np.int64(0), np.int64(0)
        filled += draw_listed(sizes, patch, work, image, visible, drawn, with_drawn)
    return filled


@allocation_free
def count_poses(
    mesh, box, eyes, axes, near, cull, patch, work, image, visible, drawn, with_drawn, filled
):
    """Draw all faces in poses, one after the other, and add to their counts.

    Parameters
    ----------
    mesh, patch, work, image
        As for `draw`.
    box : (8, 3) float64
        Corners of a box around the mesh, in its axes.
    eyes, axes, near, cull : (P, 3), (P, 3, 3), (P,) float64 and (P,) bool
        Of each pose, see `draw`.
    visible, drawn : (P, F) int32
        In and out; `drawn` has one row, that is not used, where `with_drawn` is False.
    filled : (P,) int64
        In and out: samples that show a face.
    """
    for p in range(near.shape[0]):
        if sees(patch, eyes[p], axes[p], near[p], box):
            filled[p] += draw(
                mesh, eyes[p], axes[p], near[p], cull[p], patch, work, image, visible[p],
                drawn[p if with_drawn else 0], with_drawn,
            )  # fmt: skip


@part_with_arrays
def settle(f, tile, bits, won, lost, inverse, face, bound, visible):
    """Put face f on the samples of a tile that it has won, and take those lost off their counts.

    Where it has not won all samples that it covers, the depth of the tile is bounded again.
    """
    while lost:
        loser = face[tile * SAMPLES + lowest_bit(lost)]
        its = same_face(face, tile, loser) & lost
        visible[loser] -= count_bits(its)
        lost &= ~its
    put_face(f, won, tile, face)
    if bits & ~won:
        bound_tile(tile, inverse, bound)


@allocation_free
def draw_listed(sizes, patch, work, image, visible, drawn, with_drawn):
    """Draw the faces that are listed; arguments and result as of `draw`."""
    samples, listed = pointers(Samples(patch.centres, patch.x, patch.y)), work.listed
    inverse, face, bound = pointer(image.inverse), pointer(image.face), pointer(image.bound)
    tiles, whole = pointer(listed.tiles), pointer(listed.whole)
    planes, filled = pointer(work.setup.planes), 0
    n_faces, n_tiles, n_whole = sizes
    for n in range(min(n_tiles, AHEAD)):
        request(tiles[n], samples, inverse, face)
    for n in range(min(n_whole, AHEAD)):
        request(whole[n], samples, inverse, face)
    at = at_whole = 0
    for row in range(n_faces):
        slot, is_drawn = listed.slots[row], listed.is_drawn[row]
        end, end_whole = listed.ends[row, 0], listed.ends[row, 1]
        e, f = planes_of(work.setup, slot), tile_of(work.setup, FACE, slot)
        covered = gained = 0
        if not is_drawn:
            for n in range(at, end):
                covered += count_covered(e, np.int64(tiles[n]), samples, planes)
            for n in range(at_whole, end_whole):
                covered += count_covered(e, np.int64(whole[n]), samples, planes)
        elif e.cut < np.inf:  # no tile is listed as a whole
            for n in range(at, end):
                tile = np.int64(tiles[n])
                bits, won, lost = cover_cut(e, f, tile, samples, planes, inverse, face, bound)
                covered, gained = covered + count_bits(bits), gained + count_bits(won)
                filled -= count_bits(lost)
                settle(f, tile, bits, won, lost, inverse, face, bound, visible)
        else:
            for n in range(at, end):
                if n + AHEAD < n_tiles:
                    request(tiles[n + AHEAD], samples, inverse, face)
                tile = np.int64(tiles[n])
                bits, won, lost = cover(e, f, tile, samples, planes, inverse, face, bound)
                covered, gained = covered + count_bits(bits), gained + count_bits(won)
                filled -= count_bits(lost)
                settle(f, tile, bits, won, lost, inverse, face, bound, visible)
            for n in range(at_whole, end_whole):
                if n + AHEAD < n_whole:
                    request(whole[n + AHEAD], samples, inverse, face)
                tile = np.int64(whole[n])
                bits, won, lost = cover_whole(e, f, tile, samples, inverse, face, bound)
                covered, gained = covered + count_bits(bits), gained + count_bits(won)
                filled -= count_bits(lost)
                settle(f, tile, bits, won, lost, inverse, face, bound, visible)
        at, at_whole = end, end_whole
        if gained:
            visible[f] += gained
            filled += gained
        if with_drawn:
            drawn[f] += covered
    return filled


@allocation_free
def count_targets(mesh, eye, axes, near, patch, work, image, visible, drawn):
    """Add the samples of targets to their counts, (N,) each; arguments as for `draw`."""
    set_view(patch, eye, axes, near, work.pose)
    samples = pointers(Samples(patch.centres, patch.x, patch.y))
    inverse, planes = pointer(image.inverse), pointer(work.setup.planes)
    for c in range(list_clusters(mesh, np.int64(0), work)):
        cluster = np.int64(work.ordered[c])
        prepare_cluster(mesh, cluster, patch, work)
        for at in range(0, slots_of(mesh, cluster), LANES):
            rest, _, twins, with_chords = prepare_faces(
                mesh, cluster, at, np.int64(0), near, patch, work
            )
            while rest:
                k = lowest_bit(rest)
                rest &= rest - 1
                for turn in range(1 + (twins >> k & 1)):
                    slot = at + k + FACES * turn
                    e, f = planes_of(work.setup, slot), tile_of(work.setup, FACE, slot)
                    sizes = np.int64(0), np.int64(0), np.int64(0)
                    _, n_tiles, n_whole = list_face(
                        work.setup, slot, True, with_chords >> k & 1, np.float32(np.inf), patch,
                        image, work.listed, sizes,
                    )  # fmt: skip
                    for n in range(n_tiles + n_whole):
                        tile = np.int64(
                            work.listed.tiles[n] if n < n_tiles else work.listed.whole[n - n_tiles]
                        )
                        covered = count_covered(e, tile, samples, planes)
                        drawn[f] += covered
                        if image.bound[tile] >= 0.0:
                            covered = count_seen(e, tile, samples, planes, inverse)
                        visible[f] += covered


@allocation_free
def sees(patch, eye, axes, near, corners):
    """False where a patch has no sample of a box, by its 8 corners in axes of the mesh.

    True where rounding may decide; `eye`, `axes` and `near` are those of `draw`.
    """
    low, high = patch.low, patch.high
    size = 0.0
    left = right = above = below = behind = True
    for i in range(corners.shape[0]):
        for k in range(3):
            size = max(size, 3.0 * abs(corners[i, k] - eye[k]))
    margin = SLACK * patch.reach * size
    for i in range(corners.shape[0]):
        x = y = z = 0.0
        for k in range(3):
            away = corners[i, k] - eye[k]
            x, y, z = x + away * axes[k, 0], y + away * axes[k, 1], z + away * axes[k, 2]
        left, right = left and x - low[0] * z < -margin, right and x - high[0] * z > margin
        above, below = above and y - low[1] * z < -margin, below and y - high[1] * z > margin
        behind = behind and z < near - margin
    return not (left or right or above or below or behind)


@allocation_free
def read_image(image, patch, by_ray, face, depth):
    """Write faces (H, W) and depths (H, W) float32, in metres, of samples that have a face.

    `by_ray`: depth is the distance along the ray, otherwise z.
    """
    height, width = face.shape
    for tile in range(patch.x.shape[0]):
        if image.bound[tile] < 0.0:
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
