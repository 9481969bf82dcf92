"""Faces that lie on others in one plane: once for a mesh, whatever the camera.

Serves the plans that draw with the graphics pipeline. A device interpolates depth from the corners
of each triangle, so two triangles of one plane differ in its last bits, and chance would decide
which of them is seen. The faces found here are drawn with a depth of their own, see `scene`: one
that is found though it lies on no other costs time, one that is missed is left to chance.

Faces are sorted by their planes. Those of one plane are sorted into strips, and in each strip along
the other direction, so that few pairs remain to be looked at. In numpy, because loading compiled
loops takes longer than all else that opens a rasteriser.
"""

from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from rastercov.mesh import Mesh
from rastercov.mesh.topology import first_equal_row

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

NEAR = 1e-7
"""Of the diagonal of the bounding box, between two faces of one plane: from a diagonal away, what
float32 just tells apart. From a thousand away it is 1e-10 of the depth, which counts as equal."""
ROUNDING = 4 * float(np.finfo(np.float64).eps)
"""Of the largest coordinate: what rounding may have moved corners by."""
TILT = 2e-5
"""Radians between the normals of two faces of one plane, at most: so much can rounding to
float32, as in files, tilt a face whose least altitude is a hundredth of the largest coordinate."""
DIRECTIONS = np.array([(0.36, 0.48, 0.8), (0.8, -0.6, 0.0), (-0.48, 0.64, 0.6)])
"""Unit vectors along which normals are compared; not those in which meshes are symmetric."""
GRIDS = 4
"""Grids of cells that planes are sorted into, each shifted by a quarter of a cell. Of planes that
differ by less than that in each of three numbers, at most three grids part any two."""
MOST_PAIRS = 1 << 24
"""Pairs to look at before all faces that are left are taken to overlap: a few seconds."""

_FOUND: WeakKeyDictionary[Mesh, BoolArray] = WeakKeyDictionary()


def coplanar_overlaps(mesh: Mesh) -> BoolArray:
    """(F,) faces that overlap another face of the same plane, to within `NEAR` and `TILT`.

    Not those that merely have the same three corners as another one: they reach the device as the
    same triangle (`rules.in_one_order`), so their depths are equal however they are computed. Nor
    those that share an edge or a part of it.

    Worked out at the first call: 2.5 s for a million faces, 15 ms for ten thousand.
    """
    if mesh not in _FOUND:
        same = first_equal_row(np.sort(mesh.positions, axis=1).view(np.uint64))
        is_first = same == np.arange(mesh.n_faces)
        found = _overlaps(mesh, np.flatnonzero(is_first & ~mesh.degenerate_mask))
        _FOUND[mesh] = found[same]
    return _FOUND[mesh]


def _overlaps(mesh: Mesh, chosen: IntArray) -> BoolArray:
    """`coplanar_overlaps` among some faces."""
    found = np.zeros(mesh.n_faces, dtype=bool)
    if len(chosen) < 2:
        return found
    extent = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
    reach = NEAR * extent + ROUNDING * float(np.abs(mesh.bounds).max())
    normals, first = mesh.normals[chosen], mesh.vertices[mesh.faces[chosen, 0]]
    offsets = np.einsum("fi,fi->f", normals, first - mesh.bounds.mean(axis=0)) / extent
    # Three numbers of a plane, whichever way its normal points. Where normals are no further apart
    # than `TILT`, the first two differ by 2 `TILT` at most, the last by `TILT` and the offset.
    along = normals @ DIRECTIONS.T
    numbers = np.stack((along[:, 0] ** 2, along[:, 1] ** 2, along[:, 2] * offsets), axis=1)
    numbers /= GRIDS * (2 * TILT + reach / extent)
    cell_before = np.arange(len(chosen))
    for shift in range(GRIDS):
        cells = np.floor(numbers + shift / GRIDS).astype(np.int64) + (1 << 20)
        keys = (cells[:, 0] << 42) + (cells[:, 1] << 21) + cells[:, 2]
        order = np.argsort(keys)
        starts = np.flatnonzero(np.diff(keys[order], prepend=-1))
        before = cell_before[order]
        # Whose pairs have not been looked at already: not all were in one cell of the first grid.
        is_new = np.minimum.reduceat(before, starts) < np.maximum.reduceat(before, starts)
        sizes = np.diff(starts, append=len(order))
        plane = np.repeat(np.arange(len(starts)), sizes)
        if shift == 0:
            cell_before[order] = plane
        pairs = chosen[order[starts[is_new & (sizes == 2)][:, None] + np.arange(2)]]
        found[pairs[_overlap(mesh, pairs[:, 0], pairs[:, 1], reach)]] = True
        among = (is_new & (sizes > 2))[plane]
        _mark_overlaps(mesh, chosen[order[among]], plane[among], reach, found)
    return found


def _mark_overlaps(
    mesh: Mesh, faces: IntArray, plane: IntArray, reach: float, found: BoolArray
) -> None:
    """Set `found` of the faces that overlap another one of the same plane; planes are sorted."""
    rows, strips, along = _in_strips(mesh, faces, plane)
    order = np.lexsort((along[rows, 0], strips))
    rows, strips = rows[order], strips[order]
    low, high = along[rows].T
    at, ahead, n_pairs = np.arange(len(rows)), 0, 0
    while at.size:
        # Of each face and the one so many places ahead: while they are in one strip, and overlap
        # along it.
        ahead += 1
        at = at[: np.searchsorted(at, len(rows) - ahead)]
        at = at[(strips[at + ahead] == strips[at]) & (low[at + ahead] < high[at])]
        one, other = faces[rows[at]], faces[rows[at + ahead]]
        is_open = ~(found[one] & found[other])
        one, other = one[is_open], other[is_open]
        overlapping = _overlap(mesh, one, other, reach)
        found[one[overlapping]] = found[other[overlapping]] = True
        n_pairs += at.size
        if n_pairs > MOST_PAIRS:
            found[faces[rows[np.isin(strips, strips[at])]]] = True
            return


def _in_strips(
    mesh: Mesh, faces: IntArray, plane: IntArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Rows of `faces`, each as often as it reaches a strip; the strips; and reach along them.

    The faces of a plane are between the axes along which they reach farthest: strips run along one,
    as many as leave about as many faces in each.
    """
    if not len(faces):
        return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2))
    corners = mesh.vertices[mesh.faces[faces]]
    boxes = np.stack((corners.min(axis=1), corners.max(axis=1)), axis=2)  # (N, 3, 2)
    starts = np.flatnonzero(np.diff(plane, prepend=-1))
    index = np.repeat(np.arange(len(starts)), np.diff(starts, append=len(plane)))
    low = np.minimum.reduceat(boxes[..., 0], starts)
    width = np.maximum.reduceat(boxes[..., 1], starts) - low
    axes = np.argsort(-width, axis=1)[index]
    along, across = (
        np.take_along_axis(boxes, axes[:, k, None, None], axis=1)[:, 0] for k in (0, 1)
    )
    rows = np.arange(len(faces))
    n_strips = np.ceil(np.sqrt(np.bincount(index))).astype(np.int64)
    second = axes[:, 1]
    scale = n_strips[index] / np.maximum(width[index, second], np.finfo(float).tiny)
    ends = np.floor((across - low[index, second][:, None]) * scale[:, None]).astype(np.int64)
    ends = np.clip(ends, 0, n_strips[index][:, None] - 1)
    n_reached = ends[:, 1] - ends[:, 0] + 1
    rows = np.repeat(rows, n_reached)
    nth = np.arange(len(rows)) - np.repeat(np.cumsum(n_reached) - n_reached, n_reached)
    strips = (np.cumsum(n_strips) - n_strips)[index][rows] + ends[rows, 0] + nth
    return rows, strips, along


def _overlap(mesh: Mesh, one: IntArray, other: IntArray, reach: float) -> BoolArray:
    """Pairs of faces that lie in one plane and on each other, (N,) bool, by separating axes.

    One lies in the plane of the other when its corners do. Faces that have no more than a border in
    common are apart along an axis at right angles to an edge.
    """
    overlapping = np.zeros(len(one), dtype=bool)
    rows = np.arange(len(one))
    corners = mesh.vertices[mesh.faces[np.stack((one, other))]]
    corners -= corners[:1, :, :1].copy()  # from the first corner of the first face
    normals = mesh.normals[np.stack((one, other))]
    for edge in range(-1, 6):
        if edge < 0:
            heights = np.einsum("fnki,fni->fnk", corners[::-1], normals)
            heights[1] -= np.einsum("ni,ni->n", corners[1, :, 0], normals[1])[:, None]
            remains = np.abs(heights).max(axis=2).min(axis=0) <= reach
        else:
            face, end = edge // 3, edge % 3
            axis = np.cross(normals[face], corners[face, :, end] - corners[face, :, end - 1])
            axis /= np.linalg.norm(axis, axis=1, keepdims=True)
            at = np.einsum("fnki,ni->fnk", corners, axis)
            common = at.max(axis=2).min(axis=0) - at.min(axis=2).max(axis=0)
            remains = common > reach
        rows, corners, normals = rows[remains], corners[:, remains], normals[:, remains]
    overlapping[rows] = True
    return overlapping
