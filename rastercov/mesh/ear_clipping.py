"""Triangulation of concave polygons.

Readers triangulate every polygon as a fan about its first corner, which is correct for convex
polygons and for some others. This module finds the fans that fold over and triangulates those
polygons again, by ear clipping in their best-fitting plane. The number of triangles, n - 2, the
winding and the order of the polygons are unchanged.

Source: G. H. Meisters. Polygons Have Ears. 1975.
"""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

FOLD_TOLERANCE_REL = 1e-9  # share of a triangle's area that may be wound against its polygon
WHOLE_TURN = 2 * np.pi * (1 + 1e-9)
FLATNESS_TOLERANCE_REL = 0.01  # of the size; beyond it the surface depends on the triangulation


def cut_concave(vertices: FloatArray, faces: IntArray, source_face: IntArray) -> list[str]:
    """Replace, in place, the fans in `faces` that fold over by triangles that do not.

    A fan consists of consecutive triangles of one polygon that share their first corner and an
    edge. Seen along its normal (Newell's: the sum of the cross products of its fan), a polygon that
    does not cross itself is covered exactly once. A polygon that crosses itself keeps its fan,
    unless ear clipping gives triangles that do not fold over.

    Parameters
    ----------
    vertices : (V, 3) float64
        Finite.
    faces : (F, 3) int64
        Valid indices.
    source_face : (F,) int64
        Polygon of each face.

    Returns
    -------
    list of str
        Notes on polygons that are not flat, that cross or touch themselves, or that keep their fan
        because the search for ears exceeded its limit of steps.
    """
    is_first = np.ones(len(faces), dtype=bool)
    is_first[1:] = source_face[1:] != source_face[:-1]
    is_first[1:] |= (faces[1:, 1] != faces[:-1, 2]) | (faces[1:, 0] != faces[:-1, 0])
    start = np.flatnonzero(is_first)
    n_triangles = np.diff(start, append=len(faces))
    is_polygon = n_triangles > 1
    start, n_triangles = start[is_polygon], n_triangles[is_polygon]
    if not len(start):
        return []
    first_row = np.cumsum(n_triangles) - n_triangles  # of each polygon, in the arrays below
    polygon = np.repeat(np.arange(len(start)), n_triangles)
    row = np.arange(len(polygon)) - first_row[polygon] + start[polygon]

    sides = vertices[faces[row, 1:]] - vertices[faces[row, 0]][:, None]
    size = np.maximum.reduceat(np.abs(sides).max(axis=(1, 2)), first_row)
    sides /= np.where(size > 0, size, 1)[polygon, None, None]  # no square under- or overflows
    cross = np.cross(sides[:, 0], sides[:, 1])
    area = np.linalg.norm(cross, axis=1)
    normal = np.add.reduceat(cross, first_row)
    length, total = np.linalg.norm(normal, axis=1), np.add.reduceat(area, first_row)
    is_without_plane = length <= FOLD_TOLERANCE_REL * total
    largest = np.lexsort((area, polygon))[first_row + n_triangles - 1]
    normal[is_without_plane] = cross[largest][is_without_plane]
    length = np.linalg.norm(normal, axis=1)
    normal /= np.where(length > 0, length, 1)[:, None]

    is_folded = np.einsum("ij,ij->i", cross, normal[polygon]) < -FOLD_TOLERANCE_REL * area
    is_crossing = is_without_plane & (total > 0)
    # A polygon that does not cross itself subtends less than a whole turn at its first corner.
    long = np.flatnonzero(n_triangles[polygon] > 2)
    angle = np.arctan2(area[long], np.einsum("ij,ij->i", sides[long, 0], sides[long, 1]))
    winds = np.bincount(polygon[long], angle, len(start)) > WHOLE_TURN
    is_folded = np.logical_or.reduceat(is_folded, first_row)
    is_crossing |= winds & ~is_folded
    folded = np.flatnonzero(is_folded & ~is_crossing)
    is_given_up = np.zeros(len(start), bool)
    if len(folded):
        # Imported late: compiling takes seconds, and few files need it.
        from rastercov.kernels.mesh_ears import SIMPLE, TOO_INTRICATE

        verdict = _cut(vertices, faces, start[folded], n_triangles[folded], normal[folded])
        is_given_up[folded] = verdict == TOO_INTRICATE
        is_crossing[folded] = (verdict != SIMPLE) & (verdict != TOO_INTRICATE)

    height = np.einsum("ikj,ij->ik", sides, normal[polygon])
    bend = np.maximum(np.maximum.reduceat(height.max(axis=1), first_row), 0)
    bend -= np.minimum(np.minimum.reduceat(height.min(axis=1), first_row), 0)
    is_bent = (bend > FLATNESS_TOLERANCE_REL) & ~is_without_plane
    kinds = (
        (is_bent, "are not flat", "other triangles would be another surface"),
        (
            is_crossing,
            "cross or touch themselves",
            "their triangles may overlap, correct them in the modeller",
        ),
        (
            is_given_up,
            "are concave and too intricate to be cut",
            "their triangles fold over, cut them in the modeller",
        ),
    )
    return [
        f"{is_so.sum()} polygons {what}, the first is {source_face[start[is_so.argmax()]]}; {then}"
        for is_so, what, then in kinds
        if is_so.any()
    ]


def _cut(
    vertices: FloatArray,
    faces: IntArray,
    start: IntArray,
    n_triangles: IntArray,
    normal: FloatArray,
) -> IntArray:
    """Triangulate the fans that begin at rows `start` by ear clipping; verdict of each polygon."""
    from rastercov.kernels.mesh_ears import SIMPLE, UNPROVEN, cut_polygons

    n_corners = n_triangles + 2
    starts = np.concatenate([[0], np.cumsum(n_corners)])
    polygon = np.repeat(np.arange(len(start)), n_corners)
    step = np.arange(len(polygon)) - starts[polygon]
    # corner 0, then the second corner of each triangle, then the third corner of the last one
    row = start[polygon] + np.clip(step - 1, 0, n_triangles[polygon] - 1)
    column = np.where(step == 0, 0, np.where(step > n_triangles[polygon], 2, 1))
    corners = faces[row, column]

    xy = _in_plane(vertices[corners], polygon, starts[:-1], normal)
    triangles = np.zeros((len(corners) - 2 * len(start), 3), np.int64)
    verdict = np.empty(len(start), np.int64)
    cut_polygons(xy, _along_curve(xy, polygon, starts), starts, triangles, verdict)
    of = np.repeat(np.arange(len(start)), n_triangles)
    target = np.arange(len(of)) - (starts[:-1] - 2 * np.arange(len(start)))[of] + start[of]
    is_cut = ((verdict == SIMPLE) | (verdict == UNPROVEN))[of]
    faces[target[is_cut]] = corners[starts[of][:, None] + triangles][is_cut]
    return verdict


def _in_plane(
    points: FloatArray, polygon: IntArray, first: IntArray, normal: FloatArray
) -> FloatArray:
    """(N, 2) corners in their polygon's plane, counter-clockwise, within ±2."""
    points = points - points[first][polygon]
    size = np.maximum.reduceat(np.abs(points).max(axis=1), first)
    points /= np.where(size > 0, size, 1)[polygon, None]
    x_axis = np.cross(normal, np.eye(3)[np.abs(normal).argmin(axis=1)])
    x_axis /= np.linalg.norm(x_axis, axis=1)[:, None]
    y_axis = np.cross(normal, x_axis)
    x, y = (np.einsum("ij,ij->i", points, axis[polygon]) for axis in (x_axis, y_axis))
    # Axes along most edges, where those meet at right angles, keep the boxes around corners thin:
    # 39 steps for a corner of a comb of 12,000 instead of 1,343.
    z = x + 1j * y
    edge = np.roll(z, -1) - z
    last = np.append(first[1:], len(z)) - 1
    edge[last] = z[first] - z[last]
    length = np.abs(edge)
    direction = np.add.reduceat(edge**4 / np.where(length > 0, length, 1) ** 3, first)
    z *= np.exp(-0.25j * np.angle(direction))[polygon]
    return np.stack([z.real, z.imag], axis=1)


def _along_curve(xy: FloatArray, polygon: IntArray, starts: IntArray) -> IntArray:
    """(N,) position of each corner of a polygon along a Morton curve over the ranks of x and y.

    Ranks, because distances between corners may differ by any factor.
    """
    key = np.zeros(len(xy), np.uint64)
    for axis in range(2):
        rank = _rank(xy[:, axis], polygon, starts).astype(np.uint64)
        for shift, mask in (  # bit i to bit 2 i
            (16, 0x0000FFFF0000FFFF),
            (8, 0x00FF00FF00FF00FF),
            (4, 0x0F0F0F0F0F0F0F0F),
            (2, 0x3333333333333333),
            (1, 0x5555555555555555),
        ):
            rank = (rank | (rank << np.uint64(shift))) & np.uint64(mask)
        key |= rank << np.uint64(axis)
    return _rank(key, polygon, starts)


def _rank(values: FloatArray | NDArray[np.uint64], polygon: IntArray, starts: IntArray) -> IntArray:
    """(N,) rank of each value among those of its polygon."""
    rank = np.empty(len(values), np.int64)
    rank[np.lexsort((values, polygon))] = np.arange(len(values)) - starts[polygon]
    return rank
