"""Criteria of each face that follow from geometry, compiled by numba: (3.7), (3.9), and ours.

`project` transforms the vertices of a pose; the other functions measure one face, from the rows
that `project` leaves. `rastercov.reference.criteria` computes the same with whole arrays, in the
same order of operations.

I. Sutherland, G. Hodgman. Reentrant Polygon Clipping. 1974.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.kernels import lens_faces
from rastercov.kernels.cameras import (
    BEHIND,
    DOWN,
    INSIDE,
    RIGHT,
    STATE,
    Slopes,
    U,
    V,
    X,
    Y,
    Z,
    along,
    by_lens,
    facing,
    focus_depth,
    per_m2,
    project_vertices,
)
from rastercov.kernels.exact_polygon import keep_inside, twice_area
from rastercov.kernels.jit import allocation_free, part_of, part_with_arrays
from rastercov.kernels.simd_kernel import pointer

MOST_CORNERS = 20
"""Corners of a face after five cuts: n corners have c crossings, c even and at most n, and keep at
most n - c/2 of themselves, so that n becomes n + c/2 at most: 3, 4, 6, 9, 13, 19."""


SIDE_ROUNDING = 2.0**-47
"""Greater than the error of n . (a + b + c), relative to the sizes of the corners a, b, c and over
the sine of the angle between two edges: the normal n is off by 8 * 2^-53 over that sine."""
MOST_DOUBTFUL = 2.0**-6
"""Cosine above which a face inside the image, needle or not, is in doubt only if its area is."""


class Scene(NamedTuple):
    """Arrays of a mesh, read-only."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.uint64]  # unsigned: loops need not count negative indices from the end
    normals: NDArray[np.float64]
    degenerate: NDArray[np.bool_]
    two_sided: NDArray[np.bool_]
    offsets: NDArray[np.float64]
    reach: float  # greatest coordinate
    doubtful_cosine: float  # below which a face may be edge-on, see `SIDE_ROUNDING`


class Workspace(NamedTuple):
    """Memory of one thread: the projected vertices (V, 8), and two polygons (MOST_CORNERS, 2).

    And the measures of eight faces, see `rastercov.kernels.decision`.
    """

    points: NDArray[np.float64]
    polygon: NDArray[np.float64]
    spare: NDArray[np.float64]
    block: NDArray[np.float64]


@by_lens(lens_faces.project)
def project(vertices, pose, near, lens, points):
    """Transform the vertices to camera axes and project those beyond the near plane.

    The others have the image of a point on the optical axis, which no caller uses.
    """
    project_vertices(
        vertices.shape[0], pointer(vertices), pointer(pose), near, lens, pointer(points)
    )


@part_with_arrays
def turned(way, pose):
    """A direction of the world, or the way from the camera, in camera axes."""
    x, y, z = way[0], way[1], way[2]
    return (
        x * pose[0, 0] + y * pose[1, 0] + z * pose[2, 0],
        x * pose[0, 1] + y * pose[1, 1] + z * pose[2, 1],
        x * pose[0, 2] + y * pose[1, 2] + z * pose[2, 2],
    )


@part_with_arrays
def corner_sums(points, i, j, k):
    """Three times the centroid of a face, in camera axes."""
    return (
        points[i, X] + points[j, X] + points[k, X],
        points[i, Y] + points[j, Y] + points[k, Y],
        points[i, Z] + points[j, Z] + points[k, Z],
    )


@part_with_arrays
def incidence_cosine(points, i, j, k, normal, is_two_sided):
    """Cosine between the normal and the ray from the centroid to the camera centre.

    In camera axes the ray is minus the centroid itself, and three times that has its direction.
    """
    x, y, z = corner_sums(points, i, j, k)
    against = -(normal[0] * x + normal[1] * y + normal[2] * z)
    reach = math.sqrt(x * x + y * y + z * z)
    cosine = against / reach if reach > 0 else 0.0
    return abs(cosine) if is_two_sided else cosine


ARCSINE = (
    0.16666666666666669, 0.07499999999998433, 0.04464285714635543, 0.030381944138531247,
    0.02237217294214989, 0.017352392720869973, 0.013971212973552933, 0.011479177415184906,
    0.01032281435018578, 0.005457506718640358, 0.01740087944269402, -0.014851887071247204,
    0.028757851367421566,
)  # fmt: skip
"""Chebyshev fit of (arcsin(s) / s - 1) / s^2 by powers of s^2 up to 1/4; error 1.5e-17."""


@part_of
def incidence_angle(cosine):
    """Angle of incidence, radians: the arccosine, within an ulp.

    By arcsin s with s = |cosine| up to 1/2 and s = sin(angle / 2) beyond. Without branches, so that
    a loop over faces is vectorised; the arccosine of the C library took a sixth of all judging.
    """
    size = min(abs(cosine), 1.0)
    is_small = size <= 0.5
    x = size * size if is_small else 0.5 * (1.0 - size)
    s = size if is_small else math.sqrt(x)
    a, b, c, d, e, f, g, h, i, j, k, m, n = ARCSINE
    high = h + x * (i + x * (j + x * (k + x * (m + x * n))))
    series = a + x * (b + x * (c + x * (d + x * (e + x * (f + x * (g + x * high))))))
    angle = s + s * (x * series)
    if cosine < 0:
        angle = -angle
    return math.pi / 2 - angle if is_small else (0.0 if cosine >= 0 else math.pi) + 2 * angle


@by_lens(lens_faces.image_of_face)
def image_of_face(points, i, j, k, near, lens, work, drawn):
    """Field of view of a face: state of all its vertices, part of its area in the image, area.

    The state is that of its worst vertex. The area, px^2, is that of the part beyond the near
    plane, (3.9). `drawn` is not looked at.
    """
    worst = min(points[i, STATE], points[j, STATE], points[k, STATE])
    if worst == BEHIND:
        if max(points[i, STATE], points[j, STATE], points[k, STATE]) == BEHIND:
            return worst, 0.0, 0.0
    else:
        u0, v0, u1, v1 = points[i, U], points[i, V], points[j, U], points[j, V]
        u2, v2 = points[k, U], points[k, V]
        area = abs((u1 - u0) * (v2 - v1) - (v1 - v0) * (u2 - u1)) / 2
        if not area > 0:
            return worst, 0.0, area
        if worst == INSIDE:
            return worst, 1.0, area
        if not (
            max(u0, u1, u2) > 0
            and min(u0, u1, u2) < lens.width
            and max(v0, v1, v2) > 0
            and min(v0, v1, v2) < lens.height
        ):
            return worst, 0.0, area
    whole, shown = clipped_areas(points, i, j, k, near, lens, work.polygon, work.spare)
    part = shown / whole if whole > 0 else 0.0
    return worst, 1.0 if part > 1 else part, whole


@allocation_free
def clipped_areas(points, i, j, k, near, lens, polygon, spare):
    """Area of the image of a face beyond the near plane, and of its part in the image, px^2."""
    n = image_beyond(points, i, j, k, near, lens, polygon)
    whole = abs(twice_area(polygon, n) / 2) if n >= 3 else 0.0
    n = cut_to_image(polygon, n, lens, 0.0, spare)
    return whole, abs(twice_area(polygon, n) / 2) if n >= 3 else 0.0


@part_with_arrays
def image_beyond(points, i, j, k, near, lens, polygon):
    """Fill `polygon` with the image of a face beyond the near plane; its corner count."""
    n = 0
    for s in range(3):
        p = i if s == 0 else j if s == 1 else k
        q = j if s == 0 else k if s == 1 else i
        here, there = points[p, Z] - near, points[q, Z] - near
        if here >= 0:
            polygon[n, 0] = points[p, X] / points[p, Z] * lens.fx + lens.cx
            polygon[n, 1] = points[p, Y] / points[p, Z] * lens.fy + lens.cy
            n += 1
        if (here >= 0) != (there >= 0):
            t = here / (here - there)
            x = points[p, X] + t * (points[q, X] - points[p, X])
            y = points[p, Y] + t * (points[q, Y] - points[p, Y])
            z = points[p, Z] + t * (points[q, Z] - points[p, Z])
            polygon[n, 0] = x / z * lens.fx + lens.cx
            polygon[n, 1] = y / z * lens.fy + lens.cy
            n += 1
    return n


@part_with_arrays
def cut_to_image(polygon, n, lens, margin, spare):
    """Cut a polygon in place to the image grown by a margin, px; its corner count."""
    n = keep_inside(polygon, n, (-margin, 0.0, 0.0, -1.0, 0.0), spare)
    n = keep_inside(spare, n, (lens.width + margin, 0.0, 0.0, 1.0, 0.0), polygon)
    n = keep_inside(polygon, n, (0.0, -margin, 1.0, 0.0, 0.0), spare)
    return keep_inside(spare, n, (0.0, lens.height + margin, -1.0, 0.0, 0.0), polygon)


@by_lens(lens_faces.slopes_at)
def slopes_at(points, p, lens):
    """Derivative of the image at a vertex beyond the near plane."""
    return Slopes(lens.fx, lens.fy, points[p, RIGHT], points[p, DOWN], points[p, Z])


@part_with_arrays
def densities(points, i, j, k, normal, lens, asks_density, asks_facing, asks_per_m2):
    """Pixels a metre along the worst direction and of a facing target, and pixels a square metre.

    Each at the worst vertex, see `cameras.along`, `facing`, `per_m2`; 0 where it is not asked for,
    and for a face not wholly beyond the near plane, or not in the valid region of the lens.
    """
    if min(points[i, STATE], points[j, STATE], points[k, STATE]) == BEHIND:
        return 0.0, 0.0, 0.0
    density = math.inf if asks_density else 0.0
    least_facing, least_per_m2 = math.inf if asks_facing else 0.0, math.inf if asks_per_m2 else 0.0
    for s in range(3):
        slopes = slopes_at(points, i if s == 0 else j if s == 1 else k, lens)
        if asks_density:
            here = along(slopes, normal[0], normal[1], normal[2])
            density = density if here >= density else here
        if asks_facing:
            least_facing = min(least_facing, facing(slopes))
        if asks_per_m2:
            least_per_m2 = min(least_per_m2, per_m2(slopes, normal[0], normal[1], normal[2]))
    return density, least_facing, least_per_m2


@part_with_arrays
def focus_depth_of(points, p, lens):
    """Depth of a vertex that its sharpness depends on, metres."""
    return focus_depth(lens, points[p, X], points[p, Y], points[p, Z])
