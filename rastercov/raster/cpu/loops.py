"""The loops of the CPU rasteriser, compiled by numba.

A mesh comes in clusters of up to 64 faces (`rastercov.raster.cpu.clusters`). A pose takes one at a
time, and leaves out those that lie outside the image or turn their back, without a look at their
faces. `project` brings the vertices of a cluster to the image, in steps of 1/256 of a sample.
`sift` looks at sixteen faces at once and keeps those that can own a sample. `set_up_lanes` makes
edge functions and planes of 1/z for sixteen that were kept. Those that reach at most 2 x 2 samples
are still taken together, by `fill_tiny`, and so are those that reach at most 2 x 2 blocks of 4 x 4
samples, by `fill_few`; of others `fill_blocks` takes one at a time, and sixteen samples, a block.
Faces that are large in the image, or reach behind the camera, go the same way with more digits.

A sample on a left or upper edge is inside, on a right or lower one outside, and all of it is
reckoned in whole numbers, so every sample belongs to exactly one of two triangles that share an
edge.

A sample counts for its face when it is written and is taken from the face that held it before, so
what remains at the end are the visible samples, and nobody has to look at the image again.

What is done to sixteen at once stands in `lane_kernels`, how things lie in memory in `layout`.
"""

import numpy as np

from rastercov._jit import compiled, part_of
from rastercov.raster.cpu.memory import (
    AHEAD,
    ALL_LANES,
    BEHIND,
    BITS,
    CLIP_CORNERS,
    EYE,
    FACE,
    FAR_OUT,
    FEW,
    FIRST_X,
    FIRST_Y,
    FOURFOLD,
    HALF,
    LANES,
    LARGE,
    LAST_X,
    LAST_Y,
    LENS,
    NEAR,
    ORIGIN,
    PATCH_BITS,
    ROOM,
    SAMPLES_A_CLUSTER,
    SIDE,
    SIDE_BITS,
    SLOPE_X,
    SLOPE_Y,
    STEP_X,
    STEP_Y,
    STEPS,
    VERTICES,
    WIDEST,
    Batch,
    Counts,
    Image,
    Lists,
    Placed,
    Shape,
    Window,
    aligned_zeros,
)  # fmt: skip
from rastercov.raster.cpu.stages import (
    align_stack,
    band_lanes,
    count_bits,
    cull_lanes,
    fetch_counts,
    fetch_lines,
    few_lanes,
    group_lanes,
    group_starts,
    inside_lanes,
    list_lanes,
    lowest_bit,
    own_lanes,
    owned_by,
    owned_lanes,
    owned_rows,
    pointer,
    project,
    set_up_edges,
    set_up_lanes,
    sift_lanes,
    tiny_lanes,
    tiny_owners,
    write_lanes,
)  # fmt: skip


@part_of
def sift(shape, begin, end, placed, window, is_plain, with_drawn, octets, lists):
    """List the faces of a cluster that can own a sample; returns the lengths of the lists.

    Parameters
    ----------
    begin, end : int
        Slots of the cluster's faces.
    is_plain : int
        Not 0 where none of them can be large or want clipping.
    with_drawn : bool
        Whether hidden faces are listed.
    octets : uint8
        See `list_lanes`.
    lists : Lists
        Out: slots, counted from `begin`, of faces that reach at most 2 x 2 samples and own one,
        that reach more, of such that are hidden, of others that are large, and that want clipping;
        and for each slot which of 2 x 2 samples its face owns.
    """
    tiny, small, tiny_hidden, hidden, large, clipped, owned = lists
    n_tiny = n_small = n_tiny_hidden = n_hidden = n_large = n_clipped = 0
    for at in range(0, end - begin, LANES):
        shown, back = sift_lanes(shape.corners, begin, at, placed, window, is_plain, owned)
        n_tiny = list_lanes(octets, shown & ALL_LANES, at, tiny, n_tiny)
        n_small = list_lanes(octets, shown >> LANES & ALL_LANES, at, small, n_small)
        if shown >> 2 * LANES:
            n_large = list_lanes(octets, shown >> 2 * LANES & ALL_LANES, at, large, n_large)
            n_clipped = list_lanes(octets, shown >> 3 * LANES & ALL_LANES, at, clipped, n_clipped)
        if with_drawn:
            if window.full_x == 0:  # samples outside the image are among those it owns
                back = (back | back << LANES) & ALL_LANES << LANES
            n_tiny_hidden = list_lanes(octets, back & ALL_LANES, at, tiny_hidden, n_tiny_hidden)
            n_hidden = list_lanes(octets, back >> LANES, at, hidden, n_hidden)
    return n_tiny, n_small, n_tiny_hidden, n_hidden, n_large, n_clipped


@compiled
def border(block_x, block_y, window):
    """Bits of the samples of a block that are inside the image."""
    inside = 0
    for j in range(SIDE):
        row = (block_y << SIDE_BITS) + j
        if row < window.height:
            begin = min(max(np.int64(window.first[row]) - (block_x << SIDE_BITS), 0), SIDE)
            end = min(max(np.int64(window.last[row]) - (block_x << SIDE_BITS), 0), SIDE)
            inside |= (((1 << end) - 1) & ~((1 << begin) - 1)) << (SIDE * j)
    return inside


@part_of
def fill_tiny(tiny, window, batch, image, counts):
    """Fill those of sixteen triangles that have bits in `tiny`: they reach at most 2 x 2 samples.

    Returns how many samples were empty.
    """
    filled = 0
    owners = tiny_owners(batch) & tiny * FOURFOLD
    for k in range(4):
        if owners >> k * LANES & ALL_LANES:
            tiny_lanes(k, window, batch)
    while owners:
        k = lowest_bit(owners)
        owners &= owners - 1
        lane = k & (LANES - 1)
        face, sample = batch.whole[FACE * LANES + lane], batch.sample[k]
        if window.full_x == 0:
            x = np.int64(batch.whole[FIRST_X * LANES + lane] + (k >> 4 & 1))
            y = batch.whole[FIRST_Y * LANES + lane] + (k >> 5)
            if x < window.first[y] or x >= window.last[y]:
                continue
            if counts.with_drawn:
                counts.drawn[face] += 1
        here, old = batch.here[k], image.depth[sample]
        if here > old or (here == old and image.owner[sample] > face):
            if old > 0:
                counts.visible[image.owner[sample]] -= 1
            else:
                filled += 1
            counts.visible[face] += 1
            image.depth[sample] = here
            image.owner[sample] = face
    return filled


@part_of
def resolve(at, bits, batch, k, start, face, image, visible):
    """Write what is nearer in a block; returns how many samples, and how many were empty."""
    found = write_lanes(image, at, bits, batch, k, start)
    won = found & ALL_LANES
    lost = found >> LANES & ALL_LANES
    ties = found >> 2 * LANES
    while ties:  # the lower face wins
        lane = lowest_bit(ties)
        if image.owner[at + lane] > face:
            won |= 1 << lane
            lost |= 1 << lane
        ties &= ties - 1
    if won == 0:
        return 0, 0
    n_won = count_bits(won)
    n_new = n_won - count_bits(lost)
    while lost:
        loser = image.owner[at + lowest_bit(lost)]
        its = owned_by(image.owner, at, loser) & lost
        visible[loser] -= count_bits(its)
        lost &= ~its
    own_lanes(image.owner, at, won, face)
    return n_won, n_new


@part_of
def fill_few(few, wide, tall, window, edges, batch, image, counts):
    """Fill those of sixteen triangles that have bits in `few`: they reach at most 2 x 2 blocks.

    Those with bits in `wide` reach two columns, those with bits in `tall` two rows. Returns how
    many samples were empty.
    """
    filled, found, at_border = 0, 0, 0
    for k in range(4):
        if (k & 1 == 0 or few & wide) and (k >> 1 == 0 or few & tall):
            bits = few_lanes(k, window, edges, batch)
            found |= (bits & few) << k * LANES
            at_border |= (bits >> LANES) << k * LANES
    while found:
        k = lowest_bit(found)
        found &= found - 1
        lane = k & (LANES - 1)
        face, bits = batch.whole[FACE * LANES + lane], np.int64(batch.masks[k])
        if at_border >> k & 1:
            block_x = np.int64(batch.whole[FIRST_X * LANES + lane] >> SIDE_BITS) + (k >> 4 & 1)
            block_y = np.int64(batch.whole[FIRST_Y * LANES + lane] >> SIDE_BITS) + (k >> 5)
            bits &= border(block_x, block_y, window)
        if counts.with_drawn:
            counts.drawn[face] += count_bits(bits)
        n_won, n_new = resolve(
            np.int64(batch.sample[k]), bits, batch, lane, batch.here[k], face, image,
            counts.visible,
        )  # fmt: skip
        counts.visible[face] += n_won
        filled += n_new
    return filled


@part_of
def blocks_of(k, batch):
    """Blocks that a triangle reaches: the first and last column, the first and last row."""
    return (
        np.int64(batch.whole[FIRST_X * LANES + k] >> SIDE_BITS),
        np.int64(batch.whole[LAST_X * LANES + k] >> SIDE_BITS),
        np.int64(batch.whole[FIRST_Y * LANES + k] >> SIDE_BITS),
        np.int64(batch.whole[LAST_Y * LANES + k] >> SIDE_BITS),
    )


@part_of
def group_blocks(k, group_x, group_y, reached, edges):
    """Bits of the blocks of a group that triangle k may have samples in, see `group_lanes`."""
    first_x, last_x, first_y, last_y = reached
    blocks = group_lanes(edges, k, group_x - first_x, group_y - first_y)
    n_columns, n_rows = min(last_x - group_x + 1, SIDE), min(last_y - group_y + 1, SIDE)
    return blocks & ((1 << n_columns) - 1) * 0x1111 & ((1 << (SIDE * n_rows)) - 1)


@part_of
def in_image(bits, block_x, block_y, window):
    """Of the samples of a block those inside the image."""
    if block_x < window.inner[2 * block_y] or block_x >= window.inner[2 * block_y + 1]:
        return bits & border(block_x, block_y, window)
    return bits


@compiled
def fill_blocks(chosen, window, edges, batch, image, counts):
    """Fill those of sixteen triangles whose bits are set, of any size.

    Returns how many samples were empty.
    """
    filled = 0
    while chosen:
        k = lowest_bit(chosen)
        chosen &= chosen - 1
        reached = blocks_of(k, batch)
        first_x, last_x, first_y, last_y = reached
        face = batch.whole[FACE * LANES + k]
        is_cut = last_x >= window.full_x or last_y >= window.full_y
        gained, owned = 0, 0
        for group_y in range(first_y, last_y + 1, SIDE):
            for group_x in range(first_x, last_x + 1, SIDE):
                blocks = group_blocks(k, group_x, group_y, reached, edges)
                group_starts(k, group_x, group_y, window, batch)
                while blocks:
                    lane = lowest_bit(blocks)
                    blocks &= blocks - 1
                    bits = inside_lanes(edges, lane)
                    if is_cut:
                        block_x, block_y = (
                            group_x + (lane & (SIDE - 1)),
                            group_y + (lane >> SIDE_BITS),
                        )
                        bits = in_image(bits, block_x, block_y, window)
                    if bits == 0:
                        continue
                    owned += count_bits(bits)
                    n_won, n_new = resolve(
                        np.int64(batch.sample[lane]), bits, batch, k, batch.here[lane], face, image,
                        counts.visible,
                    )  # fmt: skip
                    gained += n_won
                    filled += n_new
        if gained:
            counts.visible[face] += gained
        if counts.with_drawn:
            counts.drawn[face] += owned
    return filled


@compiled
def covered(k, window, edges, batch):
    """Samples that triangle k owns, of any size."""
    reached = blocks_of(k, batch)
    first_x, last_x, first_y, last_y = reached
    is_cut = last_x >= window.full_x or last_y >= window.full_y
    owned = 0
    for group_y in range(first_y, last_y + 1, SIDE):
        for group_x in range(first_x, last_x + 1, SIDE):
            blocks = group_blocks(k, group_x, group_y, reached, edges)
            while blocks:
                lane = lowest_bit(blocks)
                blocks &= blocks - 1
                bits = inside_lanes(edges, lane)
                if is_cut:
                    block_x, block_y = group_x + (lane & (SIDE - 1)), group_y + (lane >> SIDE_BITS)
                    bits = in_image(bits, block_x, block_y, window)
                owned += count_bits(bits)
    return owned


@part_of
def fill(lists, n_tiny, n_small, shape, begin, placed, window, edges, batch, image, counts):
    """Fill the small triangles that `sift` listed; returns how many samples were empty."""
    listed = lists.tiny  # and the others behind them, so that few lanes stay empty
    for i in range(n_small):
        listed[n_tiny + i] = lists.small[i]
    n = n_tiny + n_small
    filled = 0
    for i in range(0, n, LANES):
        wants_edges = np.int64(i + LANES > n_tiny)
        sizes, _ = set_up_lanes(
            listed, i, wants_edges, shape, begin, lists.owned, placed, window, edges, batch
        )
        tiny = ALL_LANES >> min(max(LANES - (n_tiny - i), 0), LANES)
        others = (ALL_LANES >> max(LANES - (n - i), 0)) & ~tiny
        if tiny:
            filled += fill_tiny(tiny, window, batch, image, counts)
        few = sizes & others
        if count_bits(few) < FEW:
            few = 0
        else:
            wide, tall = sizes >> LANES, sizes >> 2 * LANES
            filled += fill_few(few, wide, tall, window, edges, batch, image, counts)
        many = others & ~few
        if many:
            filled += fill_blocks(many, window, edges, batch, image, counts)
    return filled


@part_of
def count_tiny(listed, n, faces, begin, owned, drawn):
    """Add the samples of triangles that reach at most 2 x 2 to `drawn`, all inside the image."""
    for i in range(n):
        slot = np.int64(listed[i])
        drawn[faces[begin + slot]] += count_bits(np.int64(owned[slot]))


@compiled
def count_hidden(lists, n, shape, begin, placed, window, edges, batch, counts):
    """Add the samples of the hidden triangles to `drawn`, without a look at their depths."""
    align_stack()
    for i in range(0, n, LANES):
        few, _ = set_up_edges(
            lists.hidden, i, np.int64(1), shape, begin, lists.owned, placed, window, edges, batch
        )
        few &= ALL_LANES >> max(LANES - (n - i), 0)
        if window.full_x == 0 or count_bits(few) < FEW:
            few = 0
        if few:
            owned_lanes(few, edges, batch)
        for k in range(min(n - i, LANES)):
            owned = 0
            if few >> k & 1:
                owned = np.int64(batch.masks[k])
            elif window.full_x == 0:
                owned = covered(k, window, edges, batch)
            else:
                n_rows = batch.whole[LAST_Y * LANES + k] - batch.whole[FIRST_Y * LANES + k] + 1
                for start in range(0, n_rows, LANES):
                    owned += owned_rows(edges, k, start, batch)
            counts.drawn[batch.whole[FACE * LANES + k]] += owned


@compiled
def frustum(view, width, top, bottom, planes):
    """Planes around what can own a sample of the rows from `top` to `bottom`: (5, 4) float64.

    A normal and its length. A point p from the eye is outside where normal . p < 0; by the last
    plane, where it is < near.
    """
    for i in range(3):
        right, down, forward = view[3 * i], view[3 * i + 1], view[3 * i + 2]
        planes[0, i] = view[LENS] * right + view[LENS + 2] * forward
        planes[1, i] = (width - view[LENS + 2]) * forward - view[LENS] * right
        planes[2, i] = view[LENS + 1] * down + (view[LENS + 3] - top) * forward
        planes[3, i] = (bottom - view[LENS + 3]) * forward - view[LENS + 1] * down
        planes[4, i] = forward
    for k in range(5):
        planes[k, 3] = np.sqrt(planes[k, 0] ** 2 + planes[k, 1] ** 2 + planes[k, 2] ** 2)


@part_of
def clear(low_x, high_x, low_y, high_y, window, is_clear, marks, depth):
    """Clear the blocks that a box reaches, unless they are; returns whether there are any."""
    first_x = max((np.int64(low_x) + HALF - 1) >> BITS, 0)
    last_x = min((np.int64(high_x) - HALF) >> BITS, np.int64(window.right))
    first_y = max((np.int64(low_y) + HALF - 1) >> BITS, np.int64(window.top))
    last_y = min((np.int64(high_y) - HALF) >> BITS, np.int64(window.bottom))
    if first_x > last_x or first_y > last_y:
        return False
    if is_clear:
        return True
    shift = SIDE_BITS + PATCH_BITS
    for row in range((first_y - window.top) >> SIDE_BITS, ((last_y - window.top) >> SIDE_BITS) + 1):
        for patch in range(first_x >> shift, (last_x >> shift) + 1):
            block = row * window.columns + (patch << PATCH_BITS)
            if marks[block >> PATCH_BITS] == 0:
                marks[block >> PATCH_BITS] = 1
                for sample in range(
                    block << (2 * SIDE_BITS), (block << (2 * SIDE_BITS)) + (LANES << PATCH_BITS)
                ):
                    depth[sample] = 0.0
    return True


@compiled
def clip(corners, n, plane, offset, out):
    """Keep the part of a convex polygon where plane . p >= offset; returns its corner count.

    A cut is always reckoned from the corner inside to the corner outside, so the two faces that
    share an edge cut it at the same point, bit for bit.
    """
    kept = 0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        here = (
            plane[0] * corners[i, 0] + plane[1] * corners[i, 1] + plane[2] * corners[i, 2] - offset
        )
        there = (
            plane[0] * corners[j, 0] + plane[1] * corners[j, 1] + plane[2] * corners[j, 2] - offset
        )
        if here >= 0:
            if kept == CLIP_CORNERS:
                return kept
            out[kept] = corners[i]
            kept += 1
        if (here >= 0) != (there >= 0):
            if kept == CLIP_CORNERS:
                return kept
            p, q = (i, j) if here >= 0 else (j, i)
            inside, beyond = (here, there) if here >= 0 else (there, here)
            t = inside / (inside - beyond)
            for k in range(3):
                out[kept, k] = corners[p, k] + t * (corners[q, k] - corners[p, k])
            kept += 1
    return kept


@compiled
def plane_of_corners(polygon, view):
    """Put the plane of 1/z of a face, whose corners the first rows have, into the last row.

    1/z at the first sample of the image, its steps to the next sample and row; not finite where the
    eye is in the plane. Of a face that is cut, the corners at the near plane can be so much nearer
    than what is in view that a plane through these has lost half of its digits.
    """
    a, b, c = polygon[0], polygon[1], polygon[2]
    plane = polygon[CLIP_CORNERS]
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        plane[k] = (b[i] - a[i]) * (c[j] - a[j]) - (b[j] - a[j]) * (c[i] - a[i])
    height = plane[0] * a[0] + plane[1] * a[1] + plane[2] * a[2]
    step_x, step_y = plane[0] / (height * view[LENS]), plane[1] / (height * view[LENS + 1])
    first = plane[2] / height + step_x * (0.5 - view[LENS + 2]) + step_y * (0.5 - view[LENS + 3])
    plane[ORIGIN], plane[SLOPE_X], plane[SLOPE_Y] = first, step_x, step_y


@compiled
def take_plane(plane, n, batch):
    """Give the first n of sixteen triangles the plane of the face that they are parts of."""
    if not np.isfinite(plane).all():
        return
    for k in range(n):
        for row in (ORIGIN, SLOPE_X, SLOPE_Y):
            batch.exact[row * LANES + k] = plane[row]
        batch.plane[STEP_X * LANES + k] = np.float32(plane[SLOPE_X])
        batch.plane[STEP_Y * LANES + k] = np.float32(plane[SLOPE_Y])


@compiled
def clip_face(points, begin, stride, packed, view, window, placed, polygon, other):
    """Clip a face to what is in front of the near plane and not far out; returns its corners.

    They are placed from `VERTICES` on. The last row of `polygon` gets the plane of 1/z of the face
    as it was, see `take_plane`.
    """
    for i in range(3):
        vertex = 3 * begin + (packed >> (8 * i) & (ROOM - 1))
        away = (
            points[vertex] - view[EYE],
            points[vertex + stride] - view[EYE + 1],
            points[vertex + 2 * stride] - view[EYE + 2],
        )
        for k in range(3):
            polygon[i, k] = away[0] * view[k] + away[1] * view[3 + k] + away[2] * view[6 + k]
    plane_of_corners(polygon, view)
    plane = other[CLIP_CORNERS]
    plane[0], plane[1], plane[2] = 0.0, 0.0, 1.0
    n = clip(polygon, 3, plane, view[NEAR], other)
    # The border of what is drawn, beyond which nothing owns a sample; and that of what is far out.
    reach = 0.99 * FAR_OUT / STEPS
    lows, highs = (0.0, float(window.top)), (window.right + 1.0, window.bottom + 1.0)
    is_far = False
    for axis in range(2):
        n_below, n_above = 0, 0
        for i in range(n):
            z = other[i, 2]
            at = view[LENS + axis] * other[i, axis] + view[LENS + 2 + axis] * z
            n_below += at < lows[axis] * z
            n_above += at > highs[axis] * z
            is_far |= abs(at) > reach * z
        if n_below == n or n_above == n:
            return 0
    for side in range(4 if is_far else 0):
        # |u| <= reach, |v| <= reach: +-(f x + c z) <= reach z
        sign, axis = 1.0 - 2.0 * (side & 1), side >> 1
        plane[0], plane[1] = 0.0, 0.0
        plane[axis] = sign * view[LENS + axis]
        plane[2] = sign * view[LENS + 2 + axis] + reach
        for i in range(n):
            polygon[i] = other[i]
        n = clip(polygon, n, plane, 0.0, other)
    for i in range(n):
        to = VERTICES + i
        w = 1.0 / other[i, 2]
        u = (view[LENS] * other[i, 0] * w + view[LENS + 2]) * STEPS
        v = (view[LENS + 1] * other[i, 1] * w + view[LENS + 3]) * STEPS
        placed.u[to], placed.v[to], placed.w[to] = u, v, w
        placed.x[to], placed.y[to] = np.floor(u + 0.5), np.floor(v + 0.5)
    return n


@compiled
def fan_out(shape, slot, begin, stride, view, window, placed, fan, polygon, other):
    """Clip a face and put the triangles that are left into a shape of their own: how many."""
    packed = shape.corners[slot]
    n = clip_face(shape.points, begin, stride, packed, view, window, placed, polygon, other) - 2
    for k in range(n):
        fan.corners[k] = VERTICES | (VERTICES + k + 1) << 8 | (VERTICES + k + 2) << 16
        fan.faces[k] = shape.faces[slot]
    return max(n, 0)


@compiled
def fill_large(listed, n, shape, begin, owned, placed, window, edges, batch, image, counts, plane):
    """Fill triangles of any size; returns how many samples were empty.

    `plane` is that of the face of which all of them are parts, or not finite.
    """
    align_stack()
    filled = 0
    for i in range(0, n, LANES):
        _, sides = set_up_lanes(
            listed, i, np.int64(1), shape, begin, owned, placed, window, edges, batch
        )
        take_plane(plane, min(n - i, LANES), batch)
        valid = ALL_LANES >> max(LANES - (n - i), 0)
        filled += fill_blocks(sides & valid, window, edges, batch, image, counts)
        hidden = sides >> LANES & valid
        while hidden and counts.with_drawn:
            k = lowest_bit(hidden)
            counts.drawn[batch.whole[FACE * LANES + k]] += covered(k, window, edges, batch)
            hidden &= hidden - 1
    return filled


def make_scratch():
    """Memory for `count_poses` in one thread, as it takes it apart."""
    return (
        aligned_zeros((15, ROOM), np.int32),
        aligned_zeros(ROOM, np.int64),
        aligned_zeros((5, ROOM), np.float64),
        aligned_zeros((2, ROOM), np.float32),
        np.array(
            [sorted(range(8), key=lambda k: not bits >> k & 1) for bits in range(256)], np.uint8
        ).ravel(),
        *np.zeros((2, CLIP_CORNERS + 1, 3)),
        np.zeros((5, 4)),
    )


@compiled
def count_poses(
    poses, nears, culls, focal, lens, size, bands, clusters, inner, first, last, is_rolled, marks,
    depth, owner, visible, drawn, filled, with_drawn, kept, middles, seen, scratch,
):  # fmt: skip
    """Count the samples of poses.

    Parameters
    ----------
    poses : (P, 4, 4) float64
        world_from_camera, from the same origin as the vertices. The first two axes need not be at
        right angles to each other: `rastercov.raster.sample_grid` mixes them to roll the samples.
    nears : (P,) float64
        Near plane of each pose.
    culls : (P,) bool
        Whether the faces that turn their back can be left out.
    focal : (2,) float64
        The least and the most that a length parallel to the image, over its depth, is magnified to,
        in samples.
    lens : (4,) float64
        fx, fy, cx, cy in samples.
    size : (2,) int64
        Width and height in samples.
    bands : (B, 2) int64
        First row of each band of the image, and the row after its last. They are multiples of
        `SIDE`, but for the end of the image.
    clusters : tuple of arrays
        Those of `Clusters`, in its order.
    inner : (rows of blocks, 2) int64
        The first block of each row that is wholly inside the image, and the one after the last.
    first, last : (height,) int32
        Samples of each row that count: from the first up to the last.
    is_rolled : bool
        Whether other samples than those beyond the width and the height do not count.
    marks : (M,) uint8
        Scratch: whether the blocks of a patch are cleared.
    depth, owner : (M * samples of a patch,) float32, int32
        Scratch; afterwards the last band of the last pose, in blocks: 1/z where it is marked, 0
        where nothing is, and the face.
    visible, drawn : (P, F) int32
        Out: samples; `drawn` only with `with_drawn`, else one row that is left alone.
    filled : (P,) int64
        Out: samples with a face in them.
    kept : (K / LANES,) int64
        Scratch: bits of clusters that are drawn in some band, and of safe ones, see `cull_lanes`.
    middles : (2, K) float64
        Scratch: where clusters are.
    seen : (K + LANES,) int32
        Scratch: the clusters that are looked at.
    scratch : tuple of arrays
        From `make_scratch`.
    """
    align_stack()
    points, corners, faces, all_lines, vertex_starts, face_starts, line_starts, bounds = clusters
    lines = pointer(all_lines)
    shape = Shape(pointer(points), pointer(corners), pointer(faces))
    words, longs, doubles, singles, lane_octets, polygon, clipped, sides = scratch
    octets = pointer(lane_octets)
    placed = Placed(
        pointer(doubles[0]), pointer(doubles[1]), pointer(doubles[2]), pointer(words[0]),
        pointer(words[1]),
    )  # fmt: skip
    lists = Lists(
        pointer(words[2]), pointer(words[3]), pointer(words[4]), pointer(words[5]),
        pointer(words[6]), pointer(words[7]), pointer(words[14]),
    )  # fmt: skip
    fan = Shape(shape.points, pointer(words[8]), pointer(words[9]))
    one_by_one = pointer(words[10])
    for k in range(LANES):
        one_by_one[k] = k
    edges, long_edges = pointer(words[11]), pointer(longs)
    batch = Batch(
        pointer(words[12]), pointer(doubles[3]), pointer(singles[0]),
        pointer(words[13, : 4 * LANES]), pointer(singles[1]), pointer(words[13, 4 * LANES :]),
    )  # fmt: skip
    figures = doubles[4]
    view = pointer(figures)
    no_plane = np.full(3, np.nan)
    n_clusters = len(vertex_starts) - 1
    image = Image(pointer(depth), pointer(owner))
    columns = np.int32(
        (size[0] + (SIDE << PATCH_BITS) - 1) >> (SIDE_BITS + PATCH_BITS) << PATCH_BITS
    )
    is_tame = np.int64(max(abs(lens[2]), abs(lens[3])) < FAR_OUT >> BITS >> 1)
    full_x = 0 if is_rolled else size[0] >> SIDE_BITS
    full_y = 0 if is_rolled else size[1] >> SIDE_BITS
    for p in range(len(poses)):
        figures[:EYE] = poses[p, :3, :3].ravel()
        figures[EYE:LENS] = poses[p, :3, 3]
        figures[LENS:NEAR] = lens
        figures[NEAR], figures[WIDEST] = nears[p], focal[1]
        counts = Counts(pointer(visible[p]), pointer(drawn[p if with_drawn else 0]), with_drawn)
        visible[p] = 0
        if with_drawn:
            drawn[p] = 0
        new = 0
        frustum(view, size[0], bands[0, 0], bands[-1, 1], sides)
        leaves_out_backs = ALL_LANES if culls[p] and not with_drawn else 0
        for at in range(0, n_clusters, LANES):
            kept[at // LANES] = cull_lanes(
                pointer(bounds), bounds.shape[1], at, view, pointer(sides), focal[0],
                leaves_out_backs, pointer(middles),
            ) & ((ALL_LANES >> max(LANES - (n_clusters - at), 0)) | ALL_LANES << LANES)  # fmt: skip
        for band in range(len(bands)):
            top, bottom = bands[band]
            window = Window(
                np.int32(size[0] - 1), np.int32(top), np.int32(bottom - 1), np.int32(culls[p]),
                columns, size[1], np.int32(full_x), np.int32(full_y), pointer(inner),
                pointer(first), pointer(last),
            )  # fmt: skip
            frustum(view, size[0], top, bottom, sides)
            n_seen = 0
            for at in range(0, n_clusters, LANES):
                found = kept[at // LANES] & ALL_LANES
                if found and len(bands) > 1:
                    found &= band_lanes(
                        pointer(bounds), bounds.shape[1], at, pointer(middles), lens[1],
                        lens[3] - top, sides[2, 3], bottom - lens[3], sides[3, 3],
                    )  # fmt: skip
                n_seen = list_lanes(octets, found, at, pointer(seen), n_seen)
            is_clear = len(depth) < SAMPLES_A_CLUSTER * n_seen
            marks[:] = is_clear
            if is_clear:
                depth[:] = 0.0
            for i in range(n_seen):
                cluster = seen[i]
                if i + AHEAD < n_seen:
                    following = seen[i + AHEAD]
                    begin, end = vertex_starts[following], vertex_starts[following + 1]
                    fetch_lines(shape.points, 3 * np.int64(begin), 3 * np.int64(end))
                    begin, end = face_starts[following], face_starts[following + 1]
                    fetch_lines(shape.corners, np.int64(begin), np.int64(end))
                    fetch_lines(shape.faces, np.int64(begin), np.int64(end))
                begin, end = np.int64(vertex_starts[cluster]), np.int64(vertex_starts[cluster + 1])
                first_line, end_of_lines = line_starts[cluster], line_starts[cluster + 1]
                if with_drawn:
                    fetch_counts(counts.drawn, lines, np.int64(first_line), np.int64(end_of_lines))
                is_safe = kept[cluster // LANES] >> (LANES + (cluster & (LANES - 1))) & is_tame
                box = project(shape.points, begin, end, view, is_safe, placed)
                if box[0] == BEHIND and box[1] == BEHIND:
                    continue
                is_plain = np.int64(max(box[1] - box[0], box[3] - box[2]) < LARGE)
                if box[1] >= BEHIND:
                    is_plain = 0
                    box = (
                        0,
                        np.int32(size[0] << BITS),
                        np.int32(top << BITS),
                        np.int32(bottom << BITS),
                    )
                if not clear(
                    box[0], box[1], box[2], box[3], window, is_clear, pointer(marks), image.depth
                ):
                    continue
                first_slot = np.int64(face_starts[cluster])
                n_tiny, n_small, n_tiny_hidden, n_hidden, n_large, n_clipped = sift(
                    shape, first_slot, np.int64(face_starts[cluster + 1]), placed, window, is_plain,
                    with_drawn, octets, lists,
                )  # fmt: skip
                if with_drawn and full_x > 0:
                    for listed, n in ((lists.tiny, n_tiny), (lists.tiny_hidden, n_tiny_hidden)):
                        count_tiny(listed, n, shape.faces, first_slot, lists.owned, counts.drawn)
                if n_tiny + n_small:
                    fetch_counts(
                        counts.visible, lines, np.int64(first_line), np.int64(end_of_lines)
                    )
                new += fill(
                    lists, n_tiny, n_small, shape, first_slot, placed, window, edges, batch, image,
                    counts,
                )  # fmt: skip
                if n_hidden:
                    count_hidden(
                        lists, n_hidden, shape, first_slot, placed, window, edges, batch, counts
                    )
                if n_large:
                    new += fill_large(
                        lists.large, n_large, shape, first_slot, lists.owned, placed, window,
                        long_edges, batch, image, counts, no_plane,
                    )  # fmt: skip
                for k in range(n_clipped):
                    n = fan_out(
                        shape, first_slot + lists.clipped[k], begin, end - begin, view, window,
                        placed, fan, polygon, clipped,
                    )  # fmt: skip
                    new += fill_large(
                        one_by_one, n, fan, 0, lists.owned, placed, window, long_edges, batch,
                        image, counts, polygon[CLIP_CORNERS],
                    )  # fmt: skip
        filled[p] = new


@compiled
def read_band(top, bottom, columns, marks, depth, owner, image_face, image_depth):
    """Put what `count_poses` left in its memory into the rows of an image."""
    for row in range(top, bottom):
        for column in range(image_face.shape[1]):
            block = ((row - top) >> SIDE_BITS) * columns + (column >> SIDE_BITS)
            if marks[block >> PATCH_BITS]:
                sample = (block << SIDE_BITS) + (row & (SIDE - 1))
                sample = (sample << SIDE_BITS) + (column & (SIDE - 1))
                if depth[sample] > 0:
                    image_face[row, column] = owner[sample]
                    image_depth[row, column] = np.float32(1.0 / depth[sample])
