"""Overlapping coplanar faces of a mesh, found once, for any camera.

A graphics pipeline interpolates depth from the corners of each triangle, so two triangles of one
plane differ in the last bits, and rounding would decide which of them is visible. `scene` draws the
faces found here with a depth computed from their plane. Conservative: a false positive costs time,
a false negative would be decided by rounding.

Faces are sorted by plane; those of one plane into strips, and those of a strip along the other
direction, which leaves few pairs to test. Written in numpy: loading compiled loops would take
longer than the rest of opening a rasteriser.
"""

from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from rastercov.mesh import Mesh
from rastercov.mesh.topology import first_equal_row

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

PLANE_DISTANCE_REL = 1e-7
"""Largest distance between two faces of one plane, in diagonals of the bounding box: the resolution
of float32 from one diagonal away. From a thousand away it is 1e-10 of the depth, which counts as
equal."""
POSITION_ROUNDING_REL = 4 * float(np.finfo(np.float64).eps)
"""Rounding error of a corner, relative to the largest coordinate."""
NORMAL_ANGLE = 2e-5
"""Largest angle between the normals of two faces of one plane, in radians: rounding to float32, as
in files, tilts a face by this if its least altitude is 1/100 of the largest coordinate."""
DIRECTIONS = np.array([(0.36, 0.48, 0.8), (0.8, -0.6, 0.0), (-0.48, 0.64, 0.6)])
"""Unit vectors along which normals are compared; none is an axis of symmetry of common meshes."""
GRIDS = 4
"""Grids of cells for sorting planes, each shifted by a quarter of a cell. Two planes whose three
numbers differ by less than that are separated by three grids at most."""
MAX_PAIRS = 1 << 24
"""Pairs tested before all remaining faces count as overlapping: a few seconds."""

_FOUND: WeakKeyDictionary[Mesh, BoolArray] = WeakKeyDictionary()


def coplanar_overlaps(mesh: Mesh) -> BoolArray:
    """Faces that overlap another face of the same plane, (F,) bool.

    Excluded are copies of a face: they reach the device as the same triangle, see `tie_order`, and
    get equal depths in any case. So are faces that share no more than an edge or a part of one.

    Computed on the first call for a mesh: 2.5 s for a million faces, 15 ms for ten thousand.
    """
    if mesh not in _FOUND:
        same = first_equal_row(np.sort(mesh.welded_faces, axis=1).view(np.uint64))
        is_first = same == np.arange(mesh.n_faces)
        found = _overlaps(mesh, np.flatnonzero(is_first & ~mesh.degenerate_mask))
        _FOUND[mesh] = found[same]
    return _FOUND[mesh]


def _overlaps(mesh: Mesh, chosen: IntArray) -> BoolArray:
    """`coplanar_overlaps` among the chosen faces."""
    found = np.zeros(mesh.n_faces, dtype=bool)
    if len(chosen) < 2:
        return found
    extent = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
    tolerance = PLANE_DISTANCE_REL * extent + POSITION_ROUNDING_REL * float(
        np.abs(mesh.bounds).max()
    )
    normals, first = mesh.normals[chosen], mesh.vertices[mesh.faces[chosen, 0]]
    offsets = np.einsum("fi,fi->f", normals, first - mesh.bounds.mean(axis=0)) / extent
    # Three numbers of a plane that do not depend on the sign of its normal. For normals within
    # NORMAL_ANGLE the first two differ by at most 2 NORMAL_ANGLE, the third by NORMAL_ANGLE and the
    # difference in offset.
    along = normals @ DIRECTIONS.T
    numbers = np.stack((along[:, 0] ** 2, along[:, 1] ** 2, along[:, 2] * offsets), axis=1)
    numbers /= GRIDS * (2 * NORMAL_ANGLE + tolerance / extent)
    cell_before = np.arange(len(chosen))
    for shift in range(GRIDS):
        cells = np.floor(numbers + shift / GRIDS).astype(np.int64) + (1 << 20)
        keys = (cells[:, 0] << 42) + (cells[:, 1] << 21) + cells[:, 2]
        order = np.argsort(keys)
        starts = np.flatnonzero(np.diff(keys[order], prepend=-1))
        before = cell_before[order]
        # Cells with new pairs: their faces were not all in one cell of the first grid.
        is_new = np.minimum.reduceat(before, starts) < np.maximum.reduceat(before, starts)
        sizes = np.diff(starts, append=len(order))
        plane = np.repeat(np.arange(len(starts)), sizes)
        if shift == 0:
            cell_before[order] = plane
        pairs = chosen[order[starts[is_new & (sizes == 2)][:, None] + np.arange(2)]]
        found[pairs[_overlap(mesh, pairs[:, 0], pairs[:, 1], tolerance)]] = True
        among = (is_new & (sizes > 2))[plane]
        _mark_overlaps(mesh, chosen[order[among]], plane[among], tolerance, found)
    return found


def _mark_overlaps(
    mesh: Mesh, faces: IntArray, plane: IntArray, tolerance: float, found: BoolArray
) -> None:
    """Set `found` for faces that overlap another face of the same plane; `plane` is sorted."""
    rows, strips, along = _in_strips(mesh, faces, plane)
    order = np.lexsort((along[rows, 0], strips))
    rows, strips = rows[order], strips[order]
    low, high = along[rows].T
    at, ahead, n_pairs = np.arange(len(rows)), 0, 0
    while at.size:
        # Pairs of a face and the one `ahead` places later, while both overlap along one strip.
        ahead += 1
        at = at[: np.searchsorted(at, len(rows) - ahead)]
        at = at[(strips[at + ahead] == strips[at]) & (low[at + ahead] < high[at])]
        one, other = faces[rows[at]], faces[rows[at + ahead]]
        is_open = ~(found[one] & found[other])
        one, other = one[is_open], other[is_open]
        overlapping = _overlap(mesh, one, other, tolerance)
        found[one[overlapping]] = found[other[overlapping]] = True
        n_pairs += at.size
        if n_pairs > MAX_PAIRS:
            found[faces[rows[np.isin(strips, strips[at])]]] = True
            return


def _in_strips(
    mesh: Mesh, faces: IntArray, plane: IntArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Rows of `faces`, one for each strip that a face meets; the strips; extents along them.

    Strips run along the axis of the largest extent of a plane's faces and divide the second largest
    into about sqrt(n) parts, so a strip has about as many faces as there are strips.
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
    n_met = ends[:, 1] - ends[:, 0] + 1
    rows = np.repeat(rows, n_met)
    nth = np.arange(len(rows)) - np.repeat(np.cumsum(n_met) - n_met, n_met)
    strips = (np.cumsum(n_strips) - n_strips)[index][rows] + ends[rows, 0] + nth
    return rows, strips, along


def _overlap(mesh: Mesh, one: IntArray, other: IntArray, tolerance: float) -> BoolArray:
    """Pairs of faces that lie in one plane and overlap, (N,) bool, by separating axes.

    A face lies in the plane of the other when all its corners do. Faces that share no more than a
    border are separated along an axis perpendicular to an edge.
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
            remains = np.abs(heights).max(axis=2).min(axis=0) <= tolerance
        else:
            face, end = edge // 3, edge % 3
            axis = np.cross(normals[face], corners[face, :, end] - corners[face, :, end - 1])
            axis /= np.linalg.norm(axis, axis=1, keepdims=True)
            at = np.einsum("fnki,ni->fnk", corners, axis)
            common = at.max(axis=2).min(axis=0) - at.min(axis=2).max(axis=0)
            remains = common > tolerance
        rows, corners, normals = rows[remains], corners[:, remains], normals[:, remains]
    overlapping[rows] = True
    return overlapping
