"""Coverage (3.6) of each face in some poses, compiled by numba.

`judge_poses` takes what an observer measured and gives every figure of `rastercov.Coverage`. Its
twin is in `rastercov.reference.coverage`.

E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. 2020, section 3.3.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.kernels.criteria import (
    AT_A_TIME,
    MOST_DOUBTFUL,
    SIDE_ROUNDING,
    by_lens,
    camera_normal,
    cut,
    facing_density,
    focus_depth,
    image_of_face,
    incidence_angle,
    incidence_cosine,
    perimeter,
    pixel_density,
    pixels_per_m2,
    project,
)
from rastercov.kernels.face_blocks import (
    BACK_FACING,
    COSINE_ROUNDING,
    COVERED,
    DEGENERATE,
    EXACT,
    LARGEST_RESOLUTION,
    OCCLUDED,
    OUT_OF_FOCUS,
    OUTSIDE,
    ROUNDING,
    STATISTICAL,
    TOO_COARSE,
    TOO_OBLIQUE,
    UNSAMPLED,
    copy_block,
    judge_block,
)
from rastercov.kernels.jit import allocation_free, part_of, part_with_arrays
from rastercov.kernels.vertex_columns import BEHIND, INSIDE, STATE, U, V, X, Y, Z

BORDER_ROUNDING = 2.0**-46
"""Greater than the error of a position in the image, relative to the numbers it is made from."""


class Seen(NamedTuple):
    """An observation, read-only; see `rastercov.Observation`.

    Areas are `visible / scale` and `drawn / scale`, px^2: counts of samples are float64 or int32.
    `kind` is (0, 0) where all figures are counted, and `area_error` where it is 0 everywhere.
    """

    poses: NDArray[np.float64]
    near: NDArray[np.float64]
    visible: NDArray[Any]
    drawn: NDArray[Any]
    scale: float
    kind: NDArray[np.uint8]
    area_error: NDArray[np.float64]
    samples_per_pixel: float


class Figures(NamedTuple):
    """The (P, F) arrays of `Coverage`, in its order; (0, 0) where a figure is not asked for."""

    in_view: NDArray[np.bool_]
    in_view_fraction: NDArray[np.float64]
    projected_area: NDArray[np.float64]
    visible_pixels: NDArray[np.float64]
    drawn_pixels: NDArray[np.float64]
    resolution: NDArray[np.float64]
    pixel_density: NDArray[np.float64]
    facing_density: NDArray[np.float64]
    in_focus: NDArray[np.bool_]
    visibility: NDArray[np.float64]
    visibility_bound: NDArray[np.float64]
    visibility_kind: NDArray[np.uint8]
    incidence: NDArray[np.float64]
    coverage: NDArray[np.float64]
    reason: NDArray[np.uint8]


_OTHER_TYPES: dict[str, type] = {
    "in_view": np.bool_,
    "in_focus": np.bool_,
    "visibility_kind": np.uint8,
    "reason": np.uint8,
}
"""Types of the figures that are not float64."""


def record(arrays: Mapping[str, NDArray[Any]]) -> Figures:
    """Record of the (P, F) arrays that are given, by their names."""
    none = np.empty((0, 0))
    return Figures(
        *(
            arrays[name] if name in arrays else none.astype(_OTHER_TYPES.get(name, np.float64))
            for name in Figures._fields
        )
    )


@part_of
def judge(limits, is_degenerate, is_front, is_inside, is_focused, is_sampled, figures, is_oblique):
    """Coverage (3.6) of a face and its `Reason`.

    `limits` is a `coverage.task.Limits`; `figures` are resolution, pixels a metre of the surface
    and of a target that faces the camera, pixels a square metre, and visibility. One factor at a
    time: the reason is the first that brings the product below the threshold.
    """
    resolution, density, facing, per_m2, visibility = figures
    if is_degenerate:
        return 0.0, DEGENERATE
    if not is_front:
        return 0.0, BACK_FACING
    if not is_inside:
        return 0.0, OUTSIDE
    if not is_focused:
        return 0.0, OUT_OF_FOCUS
    if not is_sampled:
        return 0.0, UNSAMPLED
    reason = COVERED
    product = 0.0
    is_dense = density >= limits.min_pixel_density and facing >= limits.min_facing_density
    if is_dense and per_m2 >= limits.min_pixels_per_m2:
        product = min(resolution, 1.0) if limits.cap_resolution else resolution
    if product < limits.min_coverage or product == 0:
        reason = TOO_COARSE
    product *= visibility if visibility >= limits.min_visibility else 0.0
    if reason == COVERED and (product < limits.min_coverage or product == 0):
        reason = OCCLUDED
    if is_oblique and product != 0:
        product = 0.0
        if reason == COVERED:
            reason = TOO_OBLIQUE
    return product, reason


@part_of
def exceeds_incidence(cosine, limits):
    """True if the angle of incidence is greater than the task allows.

    The arccosine takes long, so cosines decide, except where they are equal to rounding.
    """
    if abs(cosine - limits.least_cosine) < COSINE_ROUNDING:
        return not incidence_angle(cosine) <= limits.max_incidence
    return cosine < limits.least_cosine


@part_with_arrays
def in_focus(points, i, j, k, lens, limits):
    """True if a face is within the depth of field, (3.12), by the rule of the task."""
    a, b = focus_depth(points, i, lens), focus_depth(points, j, lens)
    c = focus_depth(points, k, lens)
    if limits.focus_of_centroid:
        centre = (a + b + c) / 3
        return limits.z_n <= centre and centre <= limits.z_f
    return limits.z_n <= min(a, b, c) and max(a, b, c) <= limits.z_f


@part_with_arrays
def kind_of(seen, row, f):
    """Kind of the bound of a visible fraction."""
    return int(seen.kind[row, f]) if seen.kind.size else STATISTICAL


@part_with_arrays
def bound_of_fraction(seen, row, f, drawn, points, i, j, k, is_cut):
    """Bound of visible / drawn of a face that is seen, at most 1.

    |v/d - v'/d'| <= (|v - v'| + |d - d'|) / d with d the true area; see `raster.observation`
    for counts. Nothing is known of a face whose image rounds to nothing, or that owns no sample.
    """
    bound = 1.0
    if drawn > 0:
        kind = kind_of(seen, row, f)
        if kind == EXACT:
            error = seen.area_error[row, f] if seen.area_error.size else 0.0
            least = drawn - error
            bound = (error / least if least > 0 else 1.0) + ROUNDING
        elif kind == STATISTICAL:
            samples = seen.samples_per_pixel
            length = math.inf if is_cut else perimeter(points, i, j, k) * math.sqrt(samples)
            deviation = 3 * 0.27 * math.sqrt(1.25 * length + 1) + length / 20
            bound = deviation / (drawn * samples)
        else:
            bound = 0.0
    return min(bound, 1.0)


@part_with_arrays
def cosine_of(scene, seen, points, row, f):
    """Cosine of the angle of incidence of a face in one pose."""
    i, j, k = scene.faces[f, 0], scene.faces[f, 1], scene.faces[f, 2]
    normal = camera_normal(scene.normals, f, seen.poses[row])
    return incidence_cosine(points, i, j, k, normal, scene.two_sided[f])


@part_with_arrays
def areas_of(seen, row, f):
    """Visible and drawn area of a face, px^2."""
    visible, drawn = float(seen.visible[row, f]), float(seen.drawn[row, f])
    if seen.scale != 1:
        visible, drawn = visible / seen.scale, drawn / seen.scale
    return visible, drawn


@part_with_arrays
def judge_face(
    scene, lens, seen, limits, work, row, f, is_front, is_oblique, asks_area, asks_density,
    asks_facing,
):  # fmt: skip
    """Figures of a face in one pose: geometry, areas, and the decision.

    A density that is not asked for is 0, and an area may be any positive number in place of itself.

    Returns the state of all vertices, the part of the image of the face that is in the image, its
    area and both densities; True if it is seen, by definition not from behind or outside the image;
    visible and drawn area, and visible fraction; resolution, focus, coverage and reason.
    """
    points, near = work.points, seen.near[row]
    i, j, k = scene.faces[f, 0], scene.faces[f, 1], scene.faces[f, 2]
    visible, drawn = areas_of(seen, row, f)
    # A count is no area.
    known = drawn if seen.kind.size or not asks_area else -1.0
    state, part, area = image_of_face(points, i, j, k, near, lens, work, known)
    density = 0.0
    if asks_density:
        density = density_of(scene, lens, seen, points, row, f, is_front, state, part)
    resolution = min(drawn / limits.min_pixels, LARGEST_RESOLUTION)
    is_seen = is_front and (part != 0 or state == INSIDE)
    visibility = visible / drawn if is_seen and drawn > 0 else 0.0
    is_focused = in_focus(points, i, j, k, lens, limits)
    per_m2 = 0.0
    if limits.min_pixels_per_m2 > 0:
        normal = camera_normal(scene.normals, f, seen.poses[row])
        per_m2 = pixels_per_m2(points, i, j, k, normal, lens)
    facing = facing_density(points, i, j, k, lens) if asks_facing else 0.0
    figures = resolution, density, facing, per_m2, visibility
    product, reason = judge(
        limits, scene.degenerate[f], is_front, state == INSIDE, is_focused, drawn > 0, figures,
        is_oblique,
    )  # fmt: skip
    geometry = state, part, area, density, facing
    return geometry, is_seen, (visible, drawn, visibility), resolution, is_focused, product, reason


@part_with_arrays
def density_of(scene, lens, seen, points, row, f, is_front, state, part):
    """Pixel density of a face, px/m; 0 unless it is seen and wholly beyond the near plane."""
    if not is_front or state == BEHIND or not part > 0:
        return 0.0
    i, j, k = scene.faces[f, 0], scene.faces[f, 1], scene.faces[f, 2]
    return pixel_density(points, i, j, k, camera_normal(scene.normals, f, seen.poses[row]), lens)


@part_with_arrays
def is_edge_on(scene, points, f, cosine, state):
    """True if rounding may decide which side of a face the camera sees."""
    if scene.degenerate[f]:
        return True
    i, j, k = scene.faces[f, 0], scene.faces[f, 1], scene.faces[f, 2]
    size = abs(points[i, X]) + abs(points[i, Y]) + abs(points[i, Z])
    size += abs(points[j, X]) + abs(points[j, Y]) + abs(points[j, Z])
    size += abs(points[k, X]) + abs(points[k, Y]) + abs(points[k, Z])
    x = points[i, X] + points[j, X] + points[k, X]
    y = points[i, Y] + points[j, Y] + points[k, Y]
    z = points[i, Z] + points[j, Z] + points[k, Z]
    height = abs(cosine) * math.sqrt(x * x + y * y + z * z)
    has_needles = scene.doubtful_cosine == MOST_DOUBTFUL
    if height > scene.doubtful_cosine * size and not (has_needles and state != INSIDE):
        return False
    corners = scene.vertices
    ax, ay, az = (
        corners[j, 0] - corners[i, 0], corners[j, 1] - corners[i, 1], corners[j, 2] - corners[i, 2],
    )  # fmt: skip
    bx, by, bz = (
        corners[k, 0] - corners[i, 0], corners[k, 1] - corners[i, 1], corners[k, 2] - corners[i, 2],
    )  # fmt: skip
    scale = max(abs(ax), abs(ay), abs(az), abs(bx), abs(by), abs(bz))
    ax, ay, az, bx, by, bz = ax / scale, ay / scale, az / scale, bx / scale, by / scale, bz / scale
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    cross = math.sqrt(nx * nx + ny * ny + nz * nz)
    product = math.sqrt((ax * ax + ay * ay + az * az) * (bx * bx + by * by + bz * bz))
    return height * cross <= SIDE_ROUNDING * size * product


def _through_lens(points, i, j, k, near, lens, work, is_edge_on):
    """See `may_reach_image`: areas through a lens have bounds that hold at the border, too."""
    return is_edge_on


@by_lens(_through_lens)
def may_reach_image(points, i, j, k, near, lens, work, is_edge_on):
    """True if a face without area in the image of a pinhole may have some within rounding.

    Through another lens: where it `is_edge_on`.
    """
    numbers = lens.width + lens.height + lens.fx + lens.fy + abs(lens.cx) + abs(lens.cy)
    numbers += lens.width * lens.width / lens.fx + lens.height * lens.height / lens.fy
    margin = BORDER_ROUNDING * numbers
    here, spare, n = work.polygon, work.spare, 0
    if min(points[i, STATE], points[j, STATE], points[k, STATE]) == BEHIND:
        least = near * (1 - BORDER_ROUNDING)
        for s in range(3):
            p = i if s == 0 else j if s == 1 else k
            q = j if s == 0 else k if s == 1 else i
            above, beyond = points[p, Z] - least, points[q, Z] - least
            if above >= 0:
                here[n, 0] = points[p, X] / points[p, Z] * lens.fx + lens.cx
                here[n, 1] = points[p, Y] / points[p, Z] * lens.fy + lens.cy
                n += 1
            if (above >= 0) != (beyond >= 0):
                t = above / (above - beyond)
                x = points[p, X] + t * (points[q, X] - points[p, X])
                y = points[p, Y] + t * (points[q, Y] - points[p, Y])
                here[n, 0], here[n, 1] = (
                    x / least * lens.fx + lens.cx,
                    y / least * lens.fy + lens.cy,
                )
                n += 1
    else:
        u0, v0, u1, v1 = points[i, U], points[i, V], points[j, U], points[j, V]
        u2, v2 = points[k, U], points[k, V]
        if (
            max(u0, u1, u2) < -1
            or max(v0, v1, v2) < -1
            or min(u0, u1, u2) > lens.width + 1
            or min(v0, v1, v2) > lens.height + 1
        ):
            return False
        for s in range(3):
            p = i if s == 0 else j if s == 1 else k
            here[n, 0], here[n, 1] = points[p, U], points[p, V]
            n += 1
    for p in range(n):
        margin = max(margin, BORDER_ROUNDING * max(abs(here[p, 0]), abs(here[p, 1])))
    n = cut(here, n, 0, -margin, 1.0, spare)
    n = cut(spare, n, 0, lens.width + margin, -1.0, here)
    n = cut(here, n, 1, -margin, 1.0, spare)
    return cut(spare, n, 1, lens.height + margin, -1.0, here) > 0


@part_with_arrays
def is_in_doubt(scene, lens, seen, points, row, f, drawn, cosine, state, part, work):
    """True if rounding may decide whether a face is seen from the front and in the image."""
    i, j, k = scene.faces[f, 0], scene.faces[f, 1], scene.faces[f, 2]
    has_part = part != 0 or state == INSIDE
    if not has_part and not drawn > 0:
        edge_on = is_edge_on(scene, points, f, cosine, state)
        return (cosine > 0 or edge_on) and may_reach_image(
            points, i, j, k, seen.near[row], lens, work, edge_on
        )
    is_computed = kind_of(seen, row, f) == EXACT and seen.area_error.size > 0
    if is_computed and drawn <= seen.area_error[row, f]:
        return True
    if cosine > 0 and (scene.two_sided[f] or not has_part):
        return not has_part
    return is_edge_on(scene, points, f, cosine, state)


@part_with_arrays
def bound_and_kind(scene, lens, seen, points, row, f, drawn, cosine, state, part, is_seen, work):
    """Bound of the visible fraction of a face, and its kind: 1 where rounding decides its side."""
    i, j, k = scene.faces[f, 0], scene.faces[f, 1], scene.faces[f, 2]
    bound, kind = 0.0, EXACT
    if is_seen:
        bound = bound_of_fraction(seen, row, f, drawn, points, i, j, k, state == BEHIND)
        kind = kind_of(seen, row, f)
    if is_in_doubt(scene, lens, seen, points, row, f, drawn, cosine, state, part, work):
        bound = 1.0
    return bound, kind


@allocation_free
def find_fractions(rows, scene, lens, seen, work, value, bound, kind):
    """Fill rows of visible fractions, their bounds and kinds; see `FacePass.fractions`."""
    points = work.points
    for row in range(rows[0], rows[1]):
        near = seen.near[row]
        project(scene.vertices, seen.poses[row], near, lens, points)
        for f in range(scene.faces.shape[0]):
            i, j, k = scene.faces[f, 0], scene.faces[f, 1], scene.faces[f, 2]
            cosine = cosine_of(scene, seen, points, row, f)
            visible, drawn = seen.visible[row, f] / seen.scale, seen.drawn[row, f] / seen.scale
            state, part, _ = image_of_face(points, i, j, k, near, lens, work, drawn)
            is_front = cosine > 0 and not scene.degenerate[f]
            is_seen = is_front and (part != 0 or state == INSIDE)
            value[row, f] = visible / drawn if is_seen and drawn > 0 else 0.0
            bound[row, f], kind[row, f] = bound_and_kind(
                scene, lens, seen, points, row, f, drawn, cosine, state, part, is_seen, work
            )


@allocation_free
def replace_by_angles(cosines):
    """Put angles of incidence in place of their cosines, (P, F): a loop that is vectorised."""
    for row in range(cosines.shape[0]):
        for f in range(cosines.shape[1]):
            cosines[row, f] = incidence_angle(cosines[row, f])


@allocation_free
def judge_poses(rows, scene, lens, seen, work, limits, out, skew):
    """Fill rows of `out` with the figures of poses `rows[0]` to `rows[1] - 1`.

    A `coverage.task.Limits` holds the thresholds. What is not asked for is not computed, unless
    the coverage depends on it. `incidence` becomes the cosine, see `replace_by_angles`.

    Blocks begin at cache lines: `skew` float64 lie between one and the arrays of float64 of `out`.
    """
    asks_area = out.projected_area.size > 0
    asks_density = out.pixel_density.size > 0 or limits.min_pixel_density > 0
    asks_facing = out.facing_density.size > 0 or limits.min_facing_density > 0
    asks_bound = out.visibility_bound.size > 0 or out.visibility_kind.size > 0
    n_faces = scene.faces.shape[0]
    for row in range(rows[0], rows[1]):
        project(scene.vertices, seen.poses[row], seen.near[row], lens, work.points)
        is_judged = False
        for f in range(n_faces):
            if (skew + row * n_faces + f) % AT_A_TIME == 0:
                is_judged = judge_block(
                    f, scene, lens, seen, row, limits, work, asks_density, asks_facing, asks_bound
                )
                if is_judged:
                    copy_block(work.block, row * n_faces + f, out)
            if is_judged:
                continue
            cosine = cosine_of(scene, seen, work.points, row, f)
            is_front = cosine > 0 and not scene.degenerate[f]
            geometry, is_seen, areas, resolution, is_focused, product, reason = judge_face(
                scene, lens, seen, limits, work, row, f, is_front,
                exceeds_incidence(cosine, limits), asks_area, asks_density, asks_facing,
            )  # fmt: skip
            state, part, area, density, facing = geometry
            visible, drawn, visibility = areas
            bound, kind = 0.0, EXACT
            if asks_bound:
                bound, kind = bound_and_kind(
                    scene, lens, seen, work.points, row, f, drawn, cosine, state, part, is_seen,
                    work,
                )  # fmt: skip
            if out.in_view.size:
                out.in_view[row, f] = state == INSIDE
            if out.in_view_fraction.size:
                out.in_view_fraction[row, f] = part
            if out.projected_area.size:
                out.projected_area[row, f] = area
            if out.visible_pixels.size:
                out.visible_pixels[row, f] = visible
            if out.drawn_pixels.size:
                out.drawn_pixels[row, f] = drawn
            if out.resolution.size:
                out.resolution[row, f] = resolution
            if out.pixel_density.size:
                out.pixel_density[row, f] = density
            if out.facing_density.size:
                out.facing_density[row, f] = facing
            if out.in_focus.size:
                out.in_focus[row, f] = is_focused
            if out.visibility.size:
                out.visibility[row, f] = visibility
            if out.visibility_bound.size:
                out.visibility_bound[row, f] = bound
            if out.visibility_kind.size:
                out.visibility_kind[row, f] = kind
            if out.incidence.size:
                out.incidence[row, f] = cosine
            if out.coverage.size:
                out.coverage[row, f] = product
            if out.reason.size:
                out.reason[row, f] = reason
