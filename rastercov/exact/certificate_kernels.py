"""The visibility certificate, compiled by numba: regions where visibility cannot change.

`event_kernels` finds the faces that a visible part of an event edge crosses in the image, at or
before the face. The remaining faces form regions, joined by edges that are no event edges: a region
is wholly visible or wholly hidden. `find_regions` collects them. See `certificate`.

A. Appel. The Notion of Quantitative Invisibility and the Machine Rendering of Solids. 1967.
"""

import numpy as np

from rastercov._jit import allocation_free, inlined, part_of
from rastercov.exact.block_kernels import lay_boxes_of_block
from rastercov.exact.records import (
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
    UNEVEN,
    UNFIT,
    V_MAX,
    V_MIN,
    U,
    V,
    W,
)

FEW_BLOCKS = 0.3
"""Share of blocks that can be certified as a whole below which regions are joined edge by edge."""
HIDDEN, VISIBLE, IN_DOUBT = range(3)
"""Decisions over a region."""


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
        `CROSSED` is added to the state, with `UNFIT` or `IN_CONTACT`. The faces in contact get
        boxes.
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
    order = projected.blocks.order
    is_at_event[:] = False
    for index in range(events.shape[0]):
        is_at_event[edges.vertices[events[index], 0]] = True
        is_at_event[edges.vertices[events[index], 1]] = True
    for b in range(has_contact.shape[0]):
        if not (has_contact[b] or projected.block_state[b] & ~np.uint16(LIVE | ABSENT)):
            continue
        lay_boxes_of_block(b, projected)
        for k in range(b * BLOCK, min((b + 1) * BLOCK, order.shape[0])):
            f = order[k]
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


@part_of
def is_inside(u, v, w, width, height):
    """True if a projected vertex lies in the image."""
    return w > 0 and 0 <= u <= width and 0 <= v <= height


@inlined
def root_of(parent, f):
    """Root of a node in the forest of regions; the path to it is halved on the way."""
    while parent[f] != f:
        parent[f] = parent[parent[f]]
        f = parent[f]
    return f


@inlined
def is_of_a_region(b, projected):
    """True if all faces of a block can be certified: they are live, uncrossed, of one side."""
    return projected.block_state[b] == LIVE and projected.block_side[b] != MIXED


@inlined
def is_one_patch(b, blocks):
    """True if a block has one patch only."""
    return blocks.patch_starts[b + 1] - blocks.patch_starts[b] == 1


@inlined
def node_of(f, parent, projected):
    """Node of a face in the forest of regions, -1 for a face in no region.

    Nodes are the patches, of blocks `is_of_a_region`, and after them the faces, of other blocks.
    """
    blocks = projected.blocks
    b = blocks.of_face[f]
    if is_of_a_region(b, projected):
        return blocks.patch[f]
    node = blocks.lowest.shape[0] + f
    is_in = projected.block_state[b] & LIVE and parent[node] >= 0
    return np.int32(node if is_in else -1)


@inlined
def join(f, g, parent):
    """Join the trees of two nodes."""
    f, g = root_of(parent, f), root_of(parent, g)
    parent[max(f, g)] = min(f, g)


@inlined
def join_along(e, edges, camera, projected, parent):
    """Join the regions on both sides of an edge along which visibility does not change."""
    uvw, state, width, height = projected.uvw, projected.state, camera.width, camera.height
    f, g = edges.faces[e, 0], edges.faces[e, 1]
    if g < 0:
        return
    if state[f] & PARTLY and state[g] & PARTLY:
        # Their common edge may lie outside the image, where nothing is checked.
        a, b = edges.vertices[e, 0], edges.vertices[e, 1]
        if not (
            is_inside(uvw[a, U], uvw[a, V], uvw[a, W], width, height)
            or is_inside(uvw[b, U], uvw[b, V], uvw[b, W], width, height)
        ):
            return
    f, g = node_of(f, parent, projected), node_of(g, parent, projected)
    if f >= 0 and g >= 0 and parent[f] != parent[g]:
        join(f, g, parent)


@inlined
def sort(numbers, n, key):
    """Sort the first n numbers by their keys.

    D. Shell. A High-Speed Sorting Procedure. 1959.
    """
    gap = np.int64(1)
    while 3 * gap + 1 < n:
        gap = 3 * gap + 1
    while gap > 0:
        for i in range(gap, n):
            number, j = numbers[i], i
            while j >= gap and key[numbers[j - gap]] > key[number]:
                numbers[j] = numbers[j - gap]
                j -= gap
            numbers[j] = number
        gap //= 3


@inlined
def list_crossed(projected, targets):
    """List the crossed faces, and add the bit to their blocks; returns their number."""
    state, n = projected.state, 0
    for start in range(0, state.shape[0], BLOCK):
        stop = min(start + BLOCK, state.shape[0])
        flags = np.uint16(0)
        for f in range(start, stop):
            flags |= state[f]
        if flags & CROSSED:
            for f in range(start, stop):
                if state[f] & CROSSED:
                    targets[n] = f
                    n += 1
                    projected.block_state[projected.blocks.of_face[f]] |= CROSSED
    return n


@allocation_free
def find_largest(projected, is_listed, in_boxes, region, is_known, largest):
    """Find the largest face of each region, the lowest of equal ones.

    Parameters
    ----------
    is_listed : (F,) bool
        Faces that may be it, in blocks with boxes.
    in_boxes : bool
        Look for these; otherwise for any face, of the regions that have none yet.
    region : (C + F,) int32
        Of `find_regions`.
    is_known : (N,) int32
        Scratch.
    largest : (N,) int32
        In and out: -1 for a region of which none is known.
    """
    blocks, area, n_patches = projected.blocks, projected.area, projected.blocks.lowest.shape[0]
    for r in range(largest.shape[0]):
        is_known[r] = largest[r] >= 0
    for b in range(projected.block_state.shape[0]):
        if not projected.block_state[b] & LIVE or (in_boxes and not projected.has_boxes[b]):
            continue
        is_whole = is_of_a_region(b, projected)
        has_one = is_whole and not in_boxes and is_one_patch(b, blocks)
        if has_one and is_known[region[blocks.patch_starts[b]]]:
            continue
        for k in range(b * BLOCK, min((b + 1) * BLOCK, blocks.order.shape[0])):
            f = blocks.order[k]
            r = region[blocks.patch[f] if is_whole else n_patches + f]
            if r >= 0 and (is_listed[f] if in_boxes else not is_known[r]):
                g = largest[r]
                if g < 0 or area[f] > area[g] or (area[f] == area[g] and f < g):
                    largest[r] = f


@allocation_free
def find_regions(
    events,
    edges,
    is_event,
    is_hidden,
    camera,
    projected,
    is_listed,
    region,
    number,
    targets,
):
    """Collect the uncrossed faces into regions; number of crossed faces, and of regions.

    A forest of faces, whose roots have the lowest index of their region, is joined edge by edge;
    in blocks that no event edge comes near, patch by patch.

    Parameters
    ----------
    events : (N,) int32
        Event edges.
    is_event, is_hidden : (E,) bool
        Of `find_event_edges` and `mark_crossed`. What hides an event edge hides both of its faces.
    projected : Projected
        With `CROSSED` in the state; here it is added to `block_state`.
    is_listed : (F,) bool
        Faces that are preferred as the largest of a region. They are in blocks with boxes.
    region : (C + F,) int32
        Out: number of each patch's region, in blocks `is_of_a_region`; and of each face's region,
        -1 for none, in other blocks with a live face.
    number : (C + F,) int32
        Scratch.
    targets : (F,) int32
        Out: the crossed faces, and after them the largest face of each region, of those that are
        listed if any is.

    R. E. Tarjan. Efficiency of a Good but not Linear Set Union Algorithm. 1975.
    """
    state, parent, blocks = projected.state, region, projected.blocks
    order, lowest, joins = blocks.order, blocks.lowest, blocks.joins
    n_faces, n_patches, n_blocks = order.shape[0], lowest.shape[0], projected.block_state.shape[0]
    n_crossed = list_crossed(projected, targets)
    n_whole = 0
    for b in range(n_blocks):
        n_whole += is_of_a_region(b, projected)
    if n_whole < FEW_BLOCKS * n_blocks:
        n_whole = 0
        for b in range(n_blocks):
            projected.block_state[b] |= UNEVEN
    for b in range(n_blocks):
        if is_of_a_region(b, projected):
            for c in range(blocks.patch_starts[b], blocks.patch_starts[b + 1]):
                parent[c] = c
        elif projected.block_state[b] & LIVE:
            for k in range(b * BLOCK, min((b + 1) * BLOCK, n_faces)):
                node = n_patches + order[k]
                parent[node] = node if state[order[k]] & (LIVE | CROSSED) == LIVE else -1
        elif n_whole == 0:
            for k in range(b * BLOCK, min((b + 1) * BLOCK, n_faces)):
                parent[n_patches + order[k]] = -1
    for k in range(joins.shape[0] if n_whole > 0 else 0):
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
    if n_whole == 0:
        for e in range(edges.kind.shape[0]):
            f, g = n_patches + edges.faces[e, 0], n_patches + edges.faces[e, 1]
            if (
                g < n_patches
                or is_event[e]
                or parent[f] == parent[g]
                or min(parent[f], parent[g]) < 0
            ):
                continue
            join_along(e, edges, camera, projected, parent)
    else:
        for b in range(n_blocks):
            if projected.block_state[b] & LIVE and not is_of_a_region(b, projected):
                for k in range(b * BLOCK, min((b + 1) * BLOCK, n_faces)):
                    if parent[n_patches + order[k]] >= 0:
                        for s in range(3):
                            e = edges.of_face[order[k], s]
                            if not is_event[e]:
                                join_along(e, edges, camera, projected, parent)
    for index in range(events.shape[0]):
        if is_hidden[events[index]]:
            join_along(events[index], edges, camera, projected, parent)

    # Regions are numbered by their lowest faces.
    n = np.int64(0)
    for b in range(n_blocks):
        if is_of_a_region(b, projected):
            for c in range(blocks.patch_starts[b], blocks.patch_starts[b + 1]):
                if parent[c] == c:
                    targets[n_crossed + n], number[c] = c, lowest[c]
                    n += 1
        elif projected.block_state[b] & LIVE:
            for k in range(b * BLOCK, min((b + 1) * BLOCK, n_faces)):
                node = n_patches + order[k]
                if parent[node] == node:
                    targets[n_crossed + n], number[node] = node, order[k]
                    n += 1
    for b in range(n_blocks):
        if is_of_a_region(b, projected):
            for c in range(blocks.patch_starts[b], blocks.patch_starts[b + 1]):
                parent[c] = root_of(parent, c)
                number[parent[c]] = min(number[parent[c]], lowest[c])
        elif projected.block_state[b] & LIVE:
            for k in range(b * BLOCK, min((b + 1) * BLOCK, n_faces)):
                node = n_patches + order[k]
                if parent[node] >= 0:
                    parent[node] = root_of(parent, node)
                    number[parent[node]] = min(number[parent[node]], order[k])
    largest = targets[n_crossed : n_crossed + n]
    sort(largest, n, number)
    for r in range(n):
        number[largest[r]] = r
        largest[r] = -1
    for b in range(n_blocks):
        if is_of_a_region(b, projected):
            for c in range(blocks.patch_starts[b], blocks.patch_starts[b + 1]):
                region[c] = number[parent[c]]
        elif projected.block_state[b] & LIVE:
            for k in range(b * BLOCK, min((b + 1) * BLOCK, n_faces)):
                node = n_patches + order[k]
                region[node] = number[parent[node]] if parent[node] >= 0 else -1
    find_largest(projected, is_listed, True, region, number, largest)
    for r in range(n):
        if largest[r] < 0:
            find_largest(projected, is_listed, False, region, number, largest)
            break
    return n_crossed, n


@allocation_free
def classify_regions(
    projected, region, largest, decision, visible, is_certified, doubtful, certain
):
    """Classify each face of a region like its largest; number of faces that remain in doubt.

    Parameters
    ----------
    projected : Projected
        With the areas inside the image, px^2.
    region : (C + F,) int32
        Of `find_regions`.
    largest : (N,) int32
        Largest face of each region.
    decision : (N,) int32
        Scratch.
    visible : (F,) float64
        In: of the largest faces, px^2. Out: of all faces of regions that are not in doubt, and 0 of
        those that are not in view.
    is_certified : (F,) bool
        Out: these faces.
    doubtful : (F,) int32
        Out: faces of regions whose largest face is neither wholly visible nor wholly hidden.
    certain : float
        Tolerance of that decision, relative to the area of the largest face.
    """
    n, blocks, area = 0, projected.blocks, projected.area
    order, n_patches = blocks.order, blocks.lowest.shape[0]
    is_certified[:] = False
    for r in range(largest.shape[0]):
        t = largest[r]
        is_visible = visible[t] >= (1 - certain) * area[t]
        is_hidden = visible[t] <= certain * area[t]
        decision[r] = VISIBLE if is_visible else HIDDEN if is_hidden else IN_DOUBT
    for b in range(projected.block_state.shape[0]):
        first, last = b * BLOCK, min((b + 1) * BLOCK, order.shape[0])
        if not projected.block_state[b] & LIVE:
            for k in range(first, last):
                if not projected.state[order[k]] & THIN:
                    visible[order[k]] = 0.0
            continue
        is_whole = is_of_a_region(b, projected)
        if is_whole and blocks.is_in_order and is_one_patch(b, blocks):
            decided = decision[region[blocks.patch_starts[b]]]
            if decided != IN_DOUBT:
                is_certified[first:last] = True
                for f in range(first, last):
                    visible[f] = area[f] if decided == VISIBLE else 0.0
                continue
        for k in range(first, last):
            f = order[k]
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
