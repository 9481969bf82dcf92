"""Faces that cannot be certified, and decisions over regions, compiled by numba.

`exact_event` finds the faces that a visible part of an event edge crosses in the image, at or
before the face. The remaining faces form regions, see `exact_region`: a region is wholly visible
or wholly hidden. See `certificate`.

A. Appel. The Notion of Quantitative Invisibility and the Machine Rendering of Solids. 1967.
"""

import numpy as np

from rastercov.kernels.exact_block import lay_boxes_of_block
from rastercov.kernels.exact_records import (
    ABSENT,
    BLOCK,
    CLIPPED,
    CROSSED,
    IN_CONTACT,
    LIVE,
    PARTLY,
    THIN,
    U_MAX,
    U_MIN,
    UNFIT,
    V_MAX,
    V_MIN,
)
from rastercov.kernels.exact_region import is_of_a_region, is_one_patch
from rastercov.kernels.jit import allocation_free

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
