"""Figures of faces in an ideal plane of a lens; compiled by numba.

`HalfPlaneSolver` has divided the faces of an ideal pinhole into visible pieces. Faces that no other
one hides are measured by their vertices and edges; of the others `collect` lists the outlines and
pieces in units of the plane, cut to the region of the lens, `camera.lenses` measures their images,
and `add_areas` adds them up by face.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.kernels.exact_lens_measures import AT_A_TIME, measure_faces
from rastercov.kernels.exact_polygon import twice_area
from rastercov.kernels.exact_records import CLIPPED, LIVE, THIN, U, V
from rastercov.kernels.jit import allocation_free, part_with_arrays
from rastercov.kernels.lens_lanes import X, Y
from rastercov.kernels.lens_polygons import (
    MOST_CORNERS,
    beyond_side_of,
    cut_to_region,
    cut_to_side_of,
    is_in_region,
)
from rastercov.kernels.lens_tables import MOST
from rastercov.kernels.simd_kernel import pointer

OUTLINE, PIECE = 0, 1
"""Kinds of polygons: the whole of a face in the plane, or a visible part of it."""
FloatArray = NDArray[np.float64]

EDGE_ROUNDING = 2.0**-46
"""Rounding of the area under an edge, relative to its length and the size of the image: positions
to 2^-50 of the size, some ten times over."""


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


class Seen(NamedTuple):
    """Images of the vertices and edges of a surface in one plane.

    `places`, (V, 4), are x, y in units of the plane and u, v in px, `is_inside`, (V,), vertices of
    its window, and `bulge`, (E,), areas between the image of an edge and its chord; NaN where
    unknown.
    """

    places: FloatArray
    is_inside: NDArray[np.bool_]
    bulge: FloatArray


class Figures(NamedTuple):
    """Sums over the planes of a camera, (F,): areas, px^2, and planes by the kind of their figure.

    `n_certified` counts planes with a certified figure, `n_visible` those of them in which the face
    is visible, `n_computed` the others that show it.
    """

    area: FloatArray
    visible: FloatArray
    area_error: FloatArray
    n_certified: NDArray[np.int8]
    n_visible: NDArray[np.int8]
    n_computed: NDArray[np.int8]


class FaceRule(NamedTuple):
    """Numbers of a plane by which faces are measured.

    `one` is the square of the length of the longest edge in one part; longer ones have parts of
    twice `part` at most. For the others see `PlaneRecord`.
    """

    width: float
    height: float
    bend: float
    tolerance: float
    one: float
    part: float


@part_with_arrays
def axis_of(pose, frame, k):
    """Axis k of a plane in the world."""
    a, b, c = frame[0, k], frame[1, k], frame[2, k]
    return (
        pose[0, 0] * a + pose[0, 1] * b + pose[0, 2] * c,
        pose[1, 0] * a + pose[1, 1] * b + pose[1, 2] * c,
        pose[2, 0] * a + pose[2, 1] * b + pose[2, 2] * c,
    )


@part_with_arrays
def are_beyond(points, pose, frame, image, margin):
    """True where all of some points are beyond one side of a plane, see `is_beside`.

    Sides are moved outwards by `margin` times the distance of the farthest point so far.
    """
    meets_front = meets_left = meets_right = meets_top = meets_bottom = False
    far = 0.0
    right, down = axis_of(pose, frame, 0), axis_of(pose, frame, 1)
    ahead = axis_of(pose, frame, 2)
    for i in range(points.shape[0]):
        a, b, c = points[i, 0] - pose[0, 3], points[i, 1] - pose[1, 3], points[i, 2] - pose[2, 3]
        x = a * right[0] + b * right[1] + c * right[2]
        y = a * down[0] + b * down[1] + c * down[2]
        z = a * ahead[0] + b * ahead[1] + c * ahead[2]
        far = max(far, abs(a), abs(b), abs(c))
        slack = margin * far
        meets_front = meets_front or z >= -slack
        meets_left = meets_left or x - image[0] * z >= -slack
        meets_right = meets_right or image[1] * z - x >= -slack
        meets_top = meets_top or y - image[2] * z >= -slack
        meets_bottom = meets_bottom or image[3] * z - y >= -slack
        if meets_front and meets_left and meets_right and meets_top and meets_bottom:
            return False
    return True


@allocation_free
def is_beside(box, points, pose, frame, image, margin):
    """True where all of some points (N, 3) are behind a plane, or beyond one side of its image.

    Parameters
    ----------
    box : (8, 3) float64
        Corners of a box around the points, which decide in most cases.
    pose, frame : (4, 4), (3, 3) float64
        World from camera, and camera from plane.
    image : (4,) float64
        Left, right, top and bottom of the image, in units of the plane.
    margin : float
        Distance relative to that of a point that is no rounding.
    """
    steep = 1 + max(abs(image[0]), abs(image[1]), abs(image[2]), abs(image[3]))
    slack = margin * steep
    return are_beyond(box, pose, frame, image, slack) or are_beyond(
        points, pose, frame, image, slack
    )


@allocation_free
def measure_simple(faces, sides, is_flat, state, seen, plane, own, is_done, out):
    """Measure the faces that are wholly inside the image or outside it, by shared edges.

    Parameters
    ----------
    faces : (O, 3) int32
        The opaque faces.
    sides : (O, 3) int32
        Edges of the faces, see `lens_solver.directed_sides`.
    seen : Seen
        Images of vertices and edges.
    own : (F,) float64
        Out: drawn area of each face in this plane; 0 for those that are not measured.
    is_done : (F,) bool
        Out: faces that are measured, or need not be.
    out : Figures
    """
    rounding = EDGE_ROUNDING * (plane.width + plane.height)
    rule = FaceRule(
        plane.width, plane.height, plane.bend, plane.tolerance,
        4 * plane.longest[MOST] * plane.longest[MOST], plane.longest[plane.parts_of],
    )  # fmt: skip
    n = faces.shape[0]
    whole = n - n % AT_A_TIME
    for first in range(0, whole, AT_A_TIME):
        measure_faces(
            first, pointer(faces), pointer(sides), pointer(is_flat), pointer(state),
            pointer(seen.places), pointer(seen.bulge), rule, rounding, pointer(own),
            pointer(is_done), pointer(out.area), pointer(out.area_error),
        )  # fmt: skip
    for f in range(whole, own.shape[0]):
        own[f], is_done[f] = 0.0, bool(is_flat[f]) or state[f] & THIN != 0
        if f < n and not is_done[f]:
            own[f], is_done[f], error = measure_face(f, faces, sides, seen, rule, rounding)
            out.area[f] += own[f]
            out.area_error[f] += error


@part_with_arrays
def measure_face(f, faces, sides, seen, rule, rounding):
    """Area of a face, px^2, 0 if it is not measured; whether it need not be; and its bound."""
    at, bulge = seen.places, seen.bulge
    i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
    u0, v0, u1, v1, u2, v2 = at[i, 2], at[i, 3], at[j, 2], at[j, 3], at[k, 2], at[k, 3]
    if u0 + u1 + u2 != u0 + u1 + u2:
        return 0.0, False, 0.0  # NaN for a vertex outside the window
    ax, ay, bx, by, cx, cy = at[i, X], at[i, Y], at[j, X], at[j, Y], at[k, X], at[k, Y]
    longest2 = max(
        (bx - ax) * (bx - ax) + (by - ay) * (by - ay),
        (cx - bx) * (cx - bx) + (cy - by) * (cy - by),
        (ax - cx) * (ax - cx) + (ay - cy) * (ay - cy),
    )
    total = 0.0
    for p in range(3):
        e = sides[f, p]
        total += bulge[e] if e >= 0 else -bulge[~e]
    low_u, high_u = min(u0, u1, u2), max(u0, u1, u2)
    low_v, high_v = min(v0, v1, v2), max(v0, v1, v2)
    stray, W_, H_ = longest2 * rule.bend / 8, rule.width, rule.height
    if high_u < -stray or high_v < -stray or low_u > W_ + stray or low_v > H_ + stray:
        return 0.0, True, 0.0
    is_in = low_u > stray and low_v > stray and high_u < W_ - stray and high_v < H_ - stray
    total += 0.5 * ((u1 - u0) * (v2 - v0) - (u2 - u0) * (v1 - v0))
    if not is_in or total != total:
        return 0.0, False, 0.0
    twice = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    # No side is longer than the box, and a bulge, is wide and high.
    around = 2.0 * ((high_u - low_u) + (high_v - low_v)) + 6.0 * stray
    parts = 1.0 if longest2 <= rule.one else np.ceil(0.5 * np.sqrt(longest2) / rule.part)
    bound = 3.0 * parts * rule.tolerance + rounding * around
    return total if twice > 0 else -total, True, bound


@part_with_arrays
def length_of(corners, first, last, plane):
    """Length of the outline of a polygon, px of the pinhole; at most twice its box is as good."""
    low_x = low_y = np.inf
    high_x = high_y = -np.inf
    for i in range(first, last):
        low_x, high_x = min(low_x, corners[i, 0]), max(high_x, corners[i, 0])
        low_y, high_y = min(low_y, corners[i, 1]), max(high_y, corners[i, 1])
    return 2 * ((high_x - low_x) * plane.fx + (high_y - low_y) * plane.fy)


@allocation_free
def add_areas(found, images, projected, kept, pinhole, plane, own, out):
    """Add the images of polygons to the figures of faces.

    Parameters
    ----------
    found : Polygons
    images : (M, 2) float64
        Of `rastercov.kernels.lens_polygons.measure_insides`.
    pinhole : tuple
        Visible area (F,), error (F,) and certificates (F,) of the pinhole, px^2 of its image.
    own : (F,) float64
        Of `measure_simple`, and lost.
    out : Figures
    """
    state, (visible, area_error, is_certified) = projected.state, pinhole
    n_faces = state.shape[0]
    rounding = EDGE_ROUNDING * (plane.width + plane.height) * plane.speed
    # A face with pieces is partly visible; one without is wholly visible or wholly hidden.
    for i in range(found.used[0]):
        f, inside = found.face[i], images[i, 0]
        out.area_error[f] += images[i, 1] * plane.tolerance + rounding * length_of(
            found.corners, found.starts[i], found.starts[i + 1], plane
        )
        if found.kind[i] == OUTLINE:
            own[f] += inside
            out.area[f] += inside
        else:
            out.visible[f] += inside
    for i in range(kept.used[0]):
        own[kept.faces[i]] = -1.0
    for f in range(n_faces):
        if not state[f] & (LIVE | THIN):
            continue
        if own[f] > 0.0 and visible[f] > 0.0:
            out.visible[f] += own[f]
        if is_certified[f]:
            out.n_certified[f] += 1
            if visible[f] > 0.0:
                out.n_visible[f] += 1
        else:
            out.n_computed[f] += 1
            out.area_error[f] += plane.stretch * area_error[f]


@allocation_free
def settle(figures, largest, is_certified):
    """Fill (F,) `is_certified` from the figures of all planes, and limit bounds to `largest`, px^2.

    A face is certified if all planes that show it certify it, with one answer.
    """
    visible, area_error = figures.visible, figures.area_error
    for f in range(is_certified.shape[0]):
        n, n_visible = figures.n_certified[f], figures.n_visible[f]
        is_one = n_visible == 0 or n_visible == n
        is_certified[f] = n > 0 and figures.n_computed[f] == 0 and is_one
        if is_certified[f] and n_visible > 0:
            visible[f] = figures.area[f]
        area_error[f] = min(area_error[f], largest)
