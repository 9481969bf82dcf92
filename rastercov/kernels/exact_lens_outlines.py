"""Polygons of an ideal plane whose images in a lens are measured; compiled by numba.

`HalfPlaneSolver` has divided the faces of an ideal pinhole into visible pieces. `collect` lists the
outlines of the faces and these pieces in units of the plane, cut to the region of the lens.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.kernels.exact_polygon import twice_area
from rastercov.kernels.exact_records import CLIPPED, LIVE, U, V
from rastercov.kernels.jit import allocation_free, part_with_arrays
from rastercov.kernels.lens_polygons import (
    MOST_CORNERS,
    beyond_side_of,
    cut_to_region,
    cut_to_side_of,
    is_in_region,
)

FloatArray = NDArray[np.float64]

OUTLINE, PIECE = 0, 1
"""Kinds of polygons: the whole of a face in the plane, or a visible part of it."""


class Polygons(NamedTuple):
    """Polygons of an ideal plane: corners (C, 2), starts (N + 1,), and face and kind (N,) of each.

    `used`, (2,), counts the polygons and the corners.
    """

    corners: FloatArray
    starts: NDArray[np.int64]
    face: NDArray[np.int32]
    kind: NDArray[np.int8]
    used: NDArray[np.int64]


class Scratch(NamedTuple):
    """Scratch for one polygon: (MOST_CORNERS, 2) and (MOST_CORNERS, 3) float64."""

    polygon: FloatArray
    spare: FloatArray
    points: FloatArray
    spare_points: FloatArray


def room_for_polygons(n: int, corners: int) -> Polygons:
    """Memory for n polygons of a number of corners together."""
    return Polygons(
        np.empty((corners, 2)),
        np.empty(n + 1, np.int64),
        np.empty(n, np.int32),
        np.empty(n, np.int8),
        np.zeros(2, np.int64),
    )


def scratch() -> Scratch:
    """Memory for one polygon."""
    return Scratch(*np.empty((2, MOST_CORNERS, 2)), *np.empty((2, MOST_CORNERS, 3)))


@part_with_arrays
def append(polygon, n, face, kind, found):
    """Append a polygon to the list; counts it only where there is no room."""
    at, corner = found.used[0], found.used[1]
    if at < found.face.shape[0] and corner + n <= found.corners.shape[0]:
        for p in range(n):
            found.corners[corner + p, 0] = polygon[p, 0]
            found.corners[corner + p, 1] = polygon[p, 1]
        found.face[at], found.kind[at] = face, kind
        found.starts[at + 1] = corner + n
    found.used[0], found.used[1] = at + 1, corner + n


@part_with_arrays
def append_cut(polygon, n, face, kind, plane, spare, found):
    """Append the parts of a convex polygon in the window and outside the hole of a plane."""
    if not is_in_region(polygon, n, plane.window):
        n = cut_to_region(polygon, n, plane.window, spare)
    if n < 3:
        return
    # Nothing in the hole is ever put through the lens, which may have a pole or fold there: the
    # rest is listed side by side, what is beyond the first side, then beyond the second, ...
    sides = plane.hole.shape[0]
    if sides == 0:
        append(polygon, n, face, kind, found)
        return
    for i in range(sides):
        m = beyond_side_of(polygon, n, plane.hole, i, spare)
        if m >= 3:
            append(spare, m, face, kind, found)
        n = cut_to_side_of(polygon, n, plane.hole, i, spare)
        if n < 3:
            return


@part_with_arrays
def cut_in_space(points, n, a, b, c, d, spare):
    """Keep the part of a polygon in space with a X + b Y + c Z >= d, in place; its corner count."""
    kept = 0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        here = a * points[i, 0] + b * points[i, 1] + c * points[i, 2] - d
        there = a * points[j, 0] + b * points[j, 1] + c * points[j, 2] - d
        if here >= 0 and kept < spare.shape[0]:
            for k in range(3):
                spare[kept, k] = points[i, k]
            kept += 1
        if ((here > 0 and there < 0) or (here < 0 and there > 0)) and kept < spare.shape[0]:
            t = here / (here - there)
            for k in range(3):
                spare[kept, k] = points[i, k] + t * (points[j, k] - points[i, k])
            kept += 1
    for i in range(kept):
        for k in range(3):
            points[i, k] = spare[i, k]
    return kept


@part_with_arrays
def outline_in_space(vertices, faces, f, camera, region, points, spare, polygon):
    """Fill `polygon` with the part of a face beyond the near plane and in a region of the plane.

    In units of the plane, counter-clockwise in (x, y). Returns the corner count, 0 for none.
    """
    rotation, eye = camera.rotation, camera.centre
    for p in range(3):
        i = faces[f, p]
        x, y, z = vertices[i, 0] - eye[0], vertices[i, 1] - eye[1], vertices[i, 2] - eye[2]
        for k in range(3):
            points[p, k] = x * rotation[0, k] + y * rotation[1, k] + z * rotation[2, k]
    if max(points[0, 2], points[1, 2], points[2, 2]) < camera.near:
        return np.int64(0)
    m = region.shape[0]
    for i in range(m):
        j = i + 1 if i + 1 < m else 0
        x0, y0 = region[i, 0], region[i, 1]
        dx, dy = region[j, 0] - x0, region[j, 1] - y0
        d = dx * y0 - dy * x0
        if (
            dx * points[0, 1] - dy * points[0, 0] < d * points[0, 2]
            and dx * points[1, 1] - dy * points[1, 0] < d * points[1, 2]
            and dx * points[2, 1] - dy * points[2, 0] < d * points[2, 2]
        ):
            return np.int64(0)
    # On which side of the plane of the face the camera is decides the direction of its image.
    ax, ay, az = points[0, 0], points[0, 1], points[0, 2]
    bx, by, bz = points[1, 0] - ax, points[1, 1] - ay, points[1, 2] - az
    cx, cy, cz = points[2, 0] - ax, points[2, 1] - ay, points[2, 2] - az
    height = (by * cz - bz * cy) * ax + (bz * cx - bx * cz) * ay + (bx * cy - by * cx) * az
    n = cut_in_space(points, np.int64(3), 0.0, 0.0, 1.0, camera.near, spare)
    for i in range(m):
        if n < 3:
            return np.int64(0)
        j = i + 1 if i + 1 < m else 0
        x0, y0 = region[i, 0], region[i, 1]
        dx, dy = region[j, 0] - x0, region[j, 1] - y0
        n = cut_in_space(points, n, -dy, dx, dy * x0 - dx * y0, 0.0, spare)
    if n < 3:
        return np.int64(0)
    for p in range(n):
        q = p if height > 0 else n - 1 - p
        polygon[p, 0], polygon[p, 1] = points[q, 0] / points[q, 2], points[q, 1] / points[q, 2]
    return np.int64(n)


@allocation_free
def collect(vertices, is_done, projected, kept, camera, plane, scratch, found):
    """List the outlines of the other faces, and the kept pieces, in units of an ideal plane.

    Parameters
    ----------
    vertices : (V, 3) float64
    is_done : (F,) bool
        Of `measure_simple`.
    projected : Projected
    kept : VisiblePieces
    camera : Pinhole
    plane : PlaneRecord
    scratch : Scratch
    found : Polygons
        Out: the polygons; `used` counts them and their corners also where there is no room.
    """
    faces, uvw, state = projected.faces, projected.uvw, projected.state
    polygon, spare = scratch.polygon, scratch.spare
    points, spare_points = scratch.points, scratch.spare_points
    found.used[0] = found.used[1] = 0
    found.starts[0] = 0
    for f in range(state.shape[0]):
        if is_done[f]:
            continue
        if not state[f] & LIVE:
            # Seen from behind and left out; others have nothing in the image of the pinhole.
            if projected.area[f] > 0.0:
                n = outline_in_space(
                    vertices, faces, f, camera, plane.window, points, spare_points, polygon
                )
                if n >= 3:
                    append_cut(polygon, n, f, OUTLINE, plane, spare, found)
            continue
        if state[f] & CLIPPED:
            s = projected.clipped_index[f]
            n = np.int64(projected.clipped.n_corners[s])
            for p in range(n):
                polygon[p, U] = projected.clipped.polygons[s, p, U]
                polygon[p, V] = projected.clipped.polygons[s, p, V]
        else:
            n = np.int64(3)
            for p in range(3):
                polygon[p, U], polygon[p, V] = uvw[faces[f, p], U], uvw[faces[f, p], V]
        if n < 3:
            continue
        is_reversed = twice_area(polygon, n) < 0
        for p in range(n):
            q = n - 1 - p if is_reversed else p
            spare[p, 0] = (polygon[q, U] - camera.cx) / camera.fx
            spare[p, 1] = (polygon[q, V] - camera.cy) / camera.fy
        for p in range(n):
            polygon[p, 0], polygon[p, 1] = spare[p, 0], spare[p, 1]
        append_cut(polygon, n, f, OUTLINE, plane, spare, found)
    for i in range(kept.used[0]):
        start = kept.starts[i]
        n = kept.starts[i + 1] - start
        for p in range(n):
            polygon[p, 0] = (kept.corners[start + p, U] - camera.cx) / camera.fx
            polygon[p, 1] = (kept.corners[start + p, V] - camera.cy) / camera.fy
        append_cut(polygon, n, kept.faces[i], PIECE, plane, spare, found)
