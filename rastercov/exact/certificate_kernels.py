"""The visibility certificate, compiled by numba: regions where visibility cannot change.

`event_kernels` finds the faces that a visible part of an event edge crosses in the image, at or
before the face. The remaining faces form regions, joined by edges that are no event edges: a region
is wholly visible or wholly hidden. `find_regions` collects them. See `certificate`.

A. Appel. The Notion of Quantitative Invisibility and the Machine Rendering of Solids. 1967.
"""

from rastercov._jit import allocation_free, inlined, part_of
from rastercov.exact.records import (
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
    U,
    V,
    W,
)


@allocation_free
def mark_uncertifiable(events, edges, projected, in_contact, partners, thinnest, is_at_event):
    """Mark the live faces that cannot be certified, whether an edge crosses them or not.

    These are faces that are clipped in space, in contact with another, or as thin as a line; and
    faces across the image border with a corner on an event edge. There the face may be folded onto
    another one so that inside the image, but not beyond it, both have the same depth.

    Parameters
    ----------
    events : (N,) int32
        Event edges.
    projected : Projected
        `CROSSED` is added to the state, with `UNFIT` or `IN_CONTACT`.
    in_contact : (F,) bool
        Faces that another one touches or cuts.
    partners : Partners
        The others.
    thinnest : float
        Width in pixels below which rounding may decide on which side of a face an edge runs.
    is_at_event : (V,) bool
        Scratch.
    """
    faces, state, box, area = projected.faces, projected.state, projected.box, projected.area
    is_at_event[:] = False
    for index in range(events.shape[0]):
        is_at_event[edges.vertices[events[index], 0]] = True
        is_at_event[edges.vertices[events[index], 1]] = True
    for f in range(state.shape[0]):
        if state[f] & LIVE:
            extent = box[f, U_MAX] - box[f, U_MIN] + box[f, V_MAX] - box[f, V_MIN]
            unfit = state[f] & CLIPPED or area[f] < thinnest * extent
            if state[f] & PARTLY and not unfit:
                unfit = (
                    is_at_event[faces[f, 0]] or is_at_event[faces[f, 1]] or is_at_event[faces[f, 2]]
                )
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
    """Root of a face in the forest of regions; the path to it is halved on the way."""
    while parent[f] != f:
        parent[f] = parent[parent[f]]
        f = parent[f]
    return f


@allocation_free
def find_regions(edges, is_event, is_hidden, camera, projected, is_listed, region, number, targets):
    """Collect the uncrossed faces into regions; number of crossed faces, and of regions.

    A forest of faces, whose roots have the lowest index of their region, is joined edge by edge.

    Parameters
    ----------
    is_event, is_hidden : (E,) bool
        Of `find_event_edges` and `mark_crossed`. What hides an event edge hides both of its faces.
    projected : Projected
        With `CROSSED` in the state.
    is_listed : (F,) bool
        Faces that are preferred as the largest of a region.
    region : (F,) int32
        Out: number of each face's region, -1 for faces in none.
    number : (F,) int32
        Scratch.
    targets : (F,) int32
        Out: the crossed faces, and after them the largest face of each region, of those that are
        listed if any is.

    R. E. Tarjan. Efficiency of a Good but not Linear Set Union Algorithm. 1975.
    """
    uvw, state, area = projected.uvw, projected.state, projected.area
    ends, edge_faces, parent = edges.vertices, edges.faces, region
    width, height = camera.width, camera.height
    n_crossed = 0
    for f in range(state.shape[0]):
        parent[f] = f if state[f] & (LIVE | CROSSED) == LIVE else -1
        if state[f] & CROSSED:
            targets[n_crossed] = f
            n_crossed += 1
    for e in range(edge_faces.shape[0]):
        f, g = edge_faces[e, 0], edge_faces[e, 1]
        if is_event[e] and not is_hidden[e]:
            continue
        if g < 0 or parent[f] < 0 or parent[g] < 0 or parent[f] == parent[g]:
            continue
        if state[f] & PARTLY and state[g] & PARTLY:
            # Their common edge may lie outside the image, where nothing is checked.
            a, b = ends[e, 0], ends[e, 1]
            if not (
                is_inside(uvw[a, U], uvw[a, V], uvw[a, W], width, height)
                or is_inside(uvw[b, U], uvw[b, V], uvw[b, W], width, height)
            ):
                continue
        f, g = root_of(parent, f), root_of(parent, g)
        if f < g:
            parent[g] = f
        else:
            parent[f] = g
    n = 0
    for f in range(state.shape[0]):
        if parent[f] < 0:
            continue
        root = f
        if parent[f] != f:  # the parents of lower faces are roots by now
            root = parent[f] = parent[parent[f]]
        else:
            number[f] = n
            targets[n_crossed + n] = f
            n += 1
        at = n_crossed + number[root]
        largest = targets[at]
        if is_listed[f] != is_listed[largest]:
            if is_listed[f]:
                targets[at] = f
        elif area[f] > area[largest]:
            targets[at] = f
    for f in range(state.shape[0]):
        if parent[f] >= 0:
            region[f] = number[parent[f]]
    return n_crossed, n


@allocation_free
def classify_regions(region, largest, area, visible, doubtful, certain):
    """Classify each face of a region like its largest; number of faces that remain in doubt.

    Parameters
    ----------
    region : (F,) int32
        Of `find_regions`; faces in doubt are taken out of their region.
    largest : (N,) int32
        Largest face of each region.
    area : (F,) float64
        px^2 inside the image.
    visible : (F,) float64
        In: of the largest faces, px^2. Out: of all faces of regions that are not in doubt.
    doubtful : (F,) int32
        Out: faces of regions whose largest face is neither wholly visible nor wholly hidden.
    certain : float
        Tolerance of that decision, relative to the area of the largest face.
    """
    n = 0
    for f in range(region.shape[0]):
        if region[f] < 0:
            continue
        t = largest[region[f]]
        if visible[t] >= (1 - certain) * area[t]:
            visible[f] = area[f]
        elif visible[t] <= certain * area[t]:
            visible[f] = 0.0
        else:
            region[f] = -1
            if f != t:
                doubtful[n] = f
                n += 1
    return n
