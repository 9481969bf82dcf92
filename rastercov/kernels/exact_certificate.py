"""Faces that cannot be certified, regions of the others, and decisions over them; by numba.

`exact_event` finds the faces that a visible part of an event edge crosses in the image, at or
before the face. The remaining faces, joined by edges that are no event edges, form regions: a
region is wholly visible or wholly hidden. Blocks without a crossed face are joined by patches,
and only the others face by face; see `certificate`.

A. Appel. The Notion of Quantitative Invisibility and the Machine Rendering of Solids. 1967.
R. E. Tarjan. Efficiency of a Good but not Linear Set Union Algorithm. 1975.
"""

import numpy as np

from rastercov.kernels.exact_records import (
    ABSENT,
    BLOCK,
    CLIPPED,
    CROSSED,
    IN_CONTACT,
    LIVE,
    MIXED,
    PARTLY,
    THIN,
    U_MAX,
    U_MIN,
    UNFIT,
    V_MAX,
    V_MIN,
    U,
    V,
    W,
)
from rastercov.kernels.exact_setup import join, lay_boxes_of_block, root_of
from rastercov.kernels.jit import allocation_free, part_with_arrays

HIDDEN, VISIBLE, IN_DOUBT = range(3)
"""Decisions over a region."""


@part_with_arrays
def is_of_a_region(b, projected):
    """True if all faces of a block can be certified: they are live, uncrossed, of one side."""
    return projected.block_state[b] == LIVE and projected.block_side[b] != MIXED


@part_with_arrays
def is_one_patch(b, blocks):
    """True if a block has one patch only."""
    return blocks.patch_starts[b + 1] - blocks.patch_starts[b] == 1


@part_with_arrays
def nodes_of(b, projected):
    """Nodes of a block in the forest of regions, from the first to before the last.

    Nodes are the patches, of blocks `is_of_a_region`, and after them the faces, of other blocks
    with a live face.
    """
    blocks = projected.blocks
    if is_of_a_region(b, projected):
        return np.int64(blocks.patch_starts[b]), np.int64(blocks.patch_starts[b + 1])
    first = np.int64(blocks.lowest.shape[0] + b * BLOCK)
    if not projected.block_state[b] & LIVE:
        return first, first
    return first, np.int64(blocks.lowest.shape[0]) + min((b + 1) * BLOCK, blocks.patch.shape[0])


@part_with_arrays
def node_of(f, parent, projected):
    """Node of a face in the forest of regions, -1 for a face in no region."""
    blocks = projected.blocks
    b = f // BLOCK
    if is_of_a_region(b, projected):
        return blocks.patch[f]
    node = blocks.lowest.shape[0] + f
    is_in = projected.block_state[b] & LIVE and parent[node] >= 0
    return node if is_in else -1


@part_with_arrays
def is_joint(e, view):
    """True if visibility does not change across an edge that is no event edge.

    It may if both of its faces leave the image and it lies outside, where nothing is checked.
    """
    edges, camera, uvw, state = view.edges, view.camera, view.projected.uvw, view.projected.state
    if not state[edges.faces[e, 0]] & state[edges.faces[e, 1]] & PARTLY:
        return True
    is_inside = False
    for end in range(2):
        i = edges.vertices[e, end]
        is_in_image = 0 <= uvw[i, U] <= camera.width and 0 <= uvw[i, V] <= camera.height
        is_inside = is_inside or (is_in_image and uvw[i, W] > 0)
    return is_inside


@part_with_arrays
def join_across(node, e, g, view, parent):
    """Join the region of a node with that of face g beyond an edge, -1 for none, if it may be.

    A root takes the lower parent of both without a jump; nearly always they have the same then.
    """
    if g < 0:
        return
    other = node_of(g, parent, view.projected)
    if other < 0 or not is_joint(e, view):
        return
    p, q = parent[node], parent[other]
    lower = min(p, q)
    p, q = lower if p == node else p, lower if q == other else q
    parent[node], parent[other] = p, q
    if p != q:
        join(node, other, parent)


@part_with_arrays
def list_crossed(projected, targets):
    """List the crossed faces; returns their number."""
    state, n = projected.state, 0
    for b in range(projected.block_state.shape[0]):
        if projected.block_state[b] & CROSSED:
            for f in range(b * BLOCK, min((b + 1) * BLOCK, state.shape[0])):
                if state[f] & CROSSED:
                    targets[n] = f
                    n += 1
    return n


@part_with_arrays
def take_larger(f, r, area, largest):
    """Make f the largest face of region r if it is larger, or equal and lower."""
    g = largest[r]
    if g < 0 or area[f] > area[g] or (area[f] == area[g] and f < g):
        largest[r] = f


@part_with_arrays
def find_largest_listed(projected, grid, region, largest):
    """Find the largest face of each region among those that the grid lists in all their cells."""
    blocks, n_patches = projected.blocks, projected.blocks.lowest.shape[0]
    block, is_whole, of_block = np.int64(-1), False, np.int64(-1)
    for index in range(grid.n_faces[0]):
        f = grid.faces[index]
        if f // BLOCK != block:  # the faces of a block follow one another
            block, of_block = np.int64(f // BLOCK), np.int64(-1)
            is_whole = is_of_a_region(block, projected)
            if is_whole and is_one_patch(block, blocks):
                of_block = np.int64(region[blocks.patch_starts[block]])
        if grid.is_whole[f] and projected.block_state[block] & LIVE:
            r = of_block
            if r < 0:
                r = np.int64(region[blocks.patch[f] if is_whole else n_patches + f])
            if r >= 0:
                take_larger(f, r, projected.area, largest)


@allocation_free
def find_largest(projected, region, is_known, largest):
    """Find the largest face of each region that has none yet, the lowest of equal ones.

    Parameters
    ----------
    region : (C + F,) int32
        Of `find_regions`.
    is_known : (N,) int32
        Scratch.
    largest : (N,) int32
        In and out: -1 for a region of which none is known.
    """
    blocks, n_patches = projected.blocks, projected.blocks.lowest.shape[0]
    for r in range(largest.shape[0]):
        is_known[r] = largest[r] >= 0
    for b in range(projected.block_state.shape[0]):
        if not projected.block_state[b] & LIVE:
            continue
        is_whole = is_of_a_region(b, projected)
        if is_whole and is_one_patch(b, blocks) and is_known[region[blocks.patch_starts[b]]]:
            continue
        for f in range(b * BLOCK, min((b + 1) * BLOCK, blocks.patch.shape[0])):
            r = region[blocks.patch[f] if is_whole else n_patches + f]
            if r >= 0 and not is_known[r]:
                take_larger(f, r, projected.area, largest)


@part_with_arrays
def join_blocks(projected, parent, region):
    """Plant the forest of regions, without numbers; join the patches of blocks that are whole."""
    state, blocks = projected.state, projected.blocks
    joins, n_patches = blocks.joins, blocks.lowest.shape[0]
    for b in range(projected.block_state.shape[0]):
        first, stop = nodes_of(b, projected)
        for node in range(first, stop):
            is_in = node < n_patches or state[node - n_patches] & (LIVE | CROSSED) == LIVE
            parent[node] = node if is_in else -1
            region[node] = -1
    for k in range(joins.shape[0]):
        is_reversed = joins[k, 1] < 0
        c, d = joins[k, 0], ~joins[k, 1] if is_reversed else joins[k, 1]
        its, other = blocks.of_patch[c], blocks.of_patch[d]
        side = projected.block_side[other]
        if (
            projected.block_side[its] == (-side if is_reversed else side)
            and is_of_a_region(its, projected)
            and is_of_a_region(other, projected)
            and parent[c] != parent[d]
        ):
            join(c, d, parent)


@part_with_arrays
def join_faces(view, parent):
    """Join the faces of other blocks with those beside them along edges that are no event edges."""
    projected, edges, n_patches = view.projected, view.edges, view.projected.blocks.lowest.shape[0]
    for b in range(projected.block_state.shape[0]):
        first, stop = nodes_of(b, projected)
        for node in range(max(first, n_patches), stop):
            f = node - n_patches
            for s in range(3 if parent[node] >= 0 else 0):
                e = edges.of_face[f, s]
                g, h = edges.faces[e, 0], edges.faces[e, 1]
                # Once: from the first of its faces, unless the block of that is whole.
                if (g == f or is_of_a_region(g // BLOCK, projected)) and not view.is_event[e]:
                    join_across(node, e, h if g == f else g, view, parent)


@part_with_arrays
def number_regions(projected, parent, region):
    """Number the trees of the forest by their lowest faces; returns how many there are."""
    n = np.int64(0)
    # Nodes come in the order of their lowest faces.
    for b in range(projected.block_state.shape[0]):
        first, stop = nodes_of(b, projected)
        for node in range(first, stop):
            if parent[node] >= 0:
                root = root_of(parent, node)
                if region[root] < 0:
                    region[root] = n
                    n += 1
                region[node] = region[root]
    return n


@allocation_free
def find_regions(events, is_hidden, view, parent, region, out):
    """Collect the uncrossed faces into regions; number of crossed faces, and of regions.

    A forest of faces, whose roots have the lowest index of their region, is joined edge by edge; in
    blocks that no event edge comes near, patch by patch.

    Parameters
    ----------
    events : (N,) int32
        Event edges.
    is_hidden : (E,) bool
        Of `mark_crossed`. What hides an event edge hides both of its faces.
    view : View
        With `CROSSED` in the states of faces and blocks. Faces that the grid lists in all their
        cells are preferred as the largest of a region.
    parent : (C + F,) int32
        Scratch.
    region : (C + F,) int32
        Out: number of each patch's region, in blocks `is_of_a_region`; and of each face's region,
        -1 for none, in other blocks with a live face.
    out : (F,) int32
        Out: the crossed faces, and after them the largest face of each region, of those that are
        listed if any is.
    """
    projected, edges = view.projected, view.edges
    n_crossed = list_crossed(projected, out)
    join_blocks(projected, parent, region)
    join_faces(view, parent)
    for index in range(events.shape[0]):
        if is_hidden[events[index]]:
            node = node_of(edges.faces[events[index], 0], parent, projected)
            if node >= 0:
                join_across(node, events[index], edges.faces[events[index], 1], view, parent)
    n = number_regions(projected, parent, region)
    largest = out[n_crossed : n_crossed + n]
    largest[:] = -1
    find_largest_listed(projected, view.grid, region, largest)
    for r in range(n):
        if largest[r] < 0:
            find_largest(projected, region, parent, largest)
            break
    return n_crossed, n


@allocation_free
def mark_uncertifiable(
    events, edges, projected, in_contact, has_contact, partners, thinnest, is_at_event
):
    """Mark the live faces that cannot be certified, whether an edge crosses them or not.

    These are faces that are clipped in space, in contact with another, or as thin as a line; and
    faces across the image border with a corner on an event edge. There the face may be folded onto
    another one so that inside the image, but not beyond it, both have the same depth.

    Parameters
    ----------
    events : (N,) int32
        Event edges.
    projected : Projected
        `CROSSED` is added to the states of blocks and, with `UNFIT` or `IN_CONTACT`, of faces.
        The faces in contact get boxes.
    in_contact, has_contact : (F,), (B,) bool
        Faces that another one touches or cuts; blocks with such a face.
    partners : Partners
        The others.
    thinnest : float
        Width in pixels below which rounding may decide on which side of a face an edge runs.
    is_at_event : (V,) bool
        Scratch.
    """
    faces, state, box, area = projected.faces, projected.state, projected.box, projected.area
    n_faces = projected.blocks.patch.shape[0]
    is_at_event[:] = False
    for index in range(events.shape[0]):
        is_at_event[edges.vertices[events[index], 0]] = True
        is_at_event[edges.vertices[events[index], 1]] = True
    for b in range(has_contact.shape[0]):
        if not (has_contact[b] or projected.block_state[b] & ~np.uint16(LIVE | ABSENT)):
            continue
        lay_boxes_of_block(b, projected)
        for f in range(b * BLOCK, min((b + 1) * BLOCK, n_faces)):
            if state[f] & LIVE:
                extent = box[f, U_MAX] - box[f, U_MIN] + box[f, V_MAX] - box[f, V_MIN]
                unfit = state[f] & CLIPPED or area[f] < thinnest * extent
                if state[f] & PARTLY and not unfit:
                    i, j, m = faces[f, 0], faces[f, 1], faces[f, 2]
                    unfit = is_at_event[i] or is_at_event[j] or is_at_event[m]
                if in_contact[f]:
                    state[f] |= CROSSED | IN_CONTACT
                    unfit = unfit or partners.starts[f] == partners.starts[f + 1]
                if unfit:
                    state[f] |= CROSSED | UNFIT
            elif state[f] & THIN:
                state[f] |= CROSSED | UNFIT  # so that its area error is computed
            projected.block_state[b] |= state[f] & CROSSED


@allocation_free
def classify_regions(
    projected, visible, region, largest, decision, is_certified, doubtful, certain
):
    """Classify each face of a region like its largest; number of faces that remain in doubt.

    Parameters
    ----------
    visible : (F,) float64
        In: visible areas of the largest faces, px^2. Out: of all faces of regions that are not in
        doubt, and 0 of those that are not in view.
    region : (C + F,) int32
        Of `find_regions`.
    largest : (N,) int32
        Largest face of each region.
    decision : (N,) int32
        Scratch.
    is_certified : (F,) bool
        Out: these faces.
    doubtful : (F,) int32
        Out: faces of regions whose largest face is neither wholly visible nor wholly hidden.
    certain : float
        Tolerance of that decision, relative to the area of the largest face.
    """
    n, blocks, area = 0, projected.blocks, projected.area
    n_patches = blocks.lowest.shape[0]
    is_certified[:] = False
    for r in range(largest.shape[0]):
        t = largest[r]
        is_visible = visible[t] >= (1 - certain) * area[t]
        is_hidden = visible[t] <= certain * area[t]
        decision[r] = VISIBLE if is_visible else HIDDEN if is_hidden else IN_DOUBT
    for b in range(projected.block_state.shape[0]):
        first, last = b * BLOCK, min((b + 1) * BLOCK, blocks.patch.shape[0])
        if not projected.block_state[b] & LIVE:
            for f in range(first, last):
                if not projected.state[f] & THIN:
                    visible[f] = 0.0
            continue
        is_whole = is_of_a_region(b, projected)
        if is_whole and is_one_patch(b, blocks):
            decided = decision[region[blocks.patch_starts[b]]]
            if decided != IN_DOUBT:
                is_certified[first:last] = True
                for f in range(first, last):
                    visible[f] = area[f] if decided == VISIBLE else 0.0
                continue
        for f in range(first, last):
            r = region[blocks.patch[f] if is_whole else n_patches + f]
            if r < 0:
                if not projected.state[f] & (LIVE | THIN):
                    visible[f] = 0.0
                continue
            if decision[r] != IN_DOUBT:
                visible[f] = area[f] if decision[r] == VISIBLE else 0.0
                is_certified[f] = True
            elif f != largest[r]:
                doubtful[n] = f
                n += 1
    return n
