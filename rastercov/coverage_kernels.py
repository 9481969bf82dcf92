"""Coverage (3.6) of each face in some poses, and its sums over poses, compiled by numba.

`judge_poses` takes what an observer measured and gives every figure of `rastercov.Coverage`; its
twins are `observation.visible_fraction` and `Task.judge`. `add_up` adds rows of it to a network.

E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. 2020, section 3.3.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov._jit import allocation_free, part_of, part_with_arrays
from rastercov.criteria_kernels import (
    BEHIND,
    INSIDE,
    Z,
    against_ray,
    camera_normal,
    image_of_face,
    incidence_angle,
    incidence_cosine,
    perimeter,
    pixel_density,
    project,
)

STATISTICAL, EXACT = 0, 2
"""Values of `rastercov.BoundKind`."""
ROUNDING = 2.0**-52
"""Rounding of a quotient."""
COSINE_ROUNDING = 1e-14
"""Greater than the error of a cosine, and of the cosine of its arccosine."""
LARGEST_RESOLUTION = 1e300
"""Of one face; a smaller R_min gives no more."""
DEGENERATE, BACK_FACING, OUTSIDE, OUT_OF_FOCUS = 0, 1, 2, 3
UNSAMPLED, TOO_COARSE, OCCLUDED, TOO_OBLIQUE, COVERED = 4, 5, 6, 7, 8
"""Values of `rastercov.Reason`."""


class Seen(NamedTuple):
    """An observation, read-only; see `rastercov.Observation`.

    `area_error` is (0, 0) where it is 0 everywhere.
    """

    poses: NDArray[np.float64]
    near: NDArray[np.float64]
    visible: NDArray[np.float64]
    drawn: NDArray[np.float64]
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


class Sums(NamedTuple):
    """Sums of one thread over poses, see `rastercov.Network`; (F,) unless noted.

    `best_row` is the row of the pose in its batch. `bounds` has the largest bound in view and the
    largest of a covered pair, (2,).
    """

    views: NDArray[np.int64]
    best: NDArray[np.float64]
    best_row: NDArray[np.int64]
    reason: NDArray[np.uint8]
    kinds: NDArray[np.int64]
    bounds: NDArray[np.float64]


@part_of
def judge(limits, is_degenerate, is_front, is_inside, is_focused, is_sampled, figures, cosine):
    """Coverage (3.6) of a face and its `Reason`, as `Task.judge` decides.

    `limits` is a `rastercov.task.Limits`; `figures` are resolution, density and visibility. One
    factor at a time: the reason is the first that brings the product below the threshold.
    """
    resolution, density, visibility = figures
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
    if density >= limits.min_pixel_density:
        product = min(resolution, 1.0) if limits.cap_resolution else resolution
    if product < limits.min_coverage or product == 0:
        reason = TOO_COARSE
    product *= visibility if visibility >= limits.min_visibility else 0.0
    if reason == COVERED and (product < limits.min_coverage or product == 0):
        reason = OCCLUDED
    # The arccosine takes longest here, so cosines decide, except where they are equal to rounding.
    is_oblique = cosine < limits.least_cosine
    if abs(cosine - limits.least_cosine) < COSINE_ROUNDING:
        is_oblique = not incidence_angle(cosine) <= limits.max_incidence
    if is_oblique and product != 0:
        product = 0.0
        if reason == COVERED:
            reason = TOO_OBLIQUE
    return product, reason


@part_with_arrays
def in_focus(points, i, j, k, limits):
    """True if a face is within the depth of field, (3.12), by the rule of the task."""
    a, b, c = points[i, Z], points[j, Z], points[k, Z]
    if limits.focus_of_centroid:
        centre = (a + b + c) / 3
        return limits.z_n <= centre and centre <= limits.z_f
    return limits.z_n <= min(a, b, c) and max(a, b, c) <= limits.z_f


@part_with_arrays
def bound_of_fraction(seen, row, f, drawn, points, i, j, k, is_cut):
    """Bound of visible / drawn of a face that has an image; see `observation.visible_fraction`."""
    if seen.kind[row, f] == EXACT:
        error = seen.area_error[row, f] if seen.area_error.size else 0.0
        least = drawn - error
        return (error / least if least > 0 else 1.0) + ROUNDING
    if seen.kind[row, f] == STATISTICAL:
        samples = seen.samples_per_pixel
        length = math.inf if is_cut else perimeter(points, i, j, k) * math.sqrt(samples)
        return (3 * 0.27 * math.sqrt(1.25 * length + 1) + length / 20) / (drawn * samples)
    return 0.0


@part_with_arrays
def judge_face(scene, lens, seen, limits, work, row, f, asks_density):
    """Figures of a face in one pose: geometry, visible fraction, and the decision.

    Returns the cosine of the angle of incidence, the state of all vertices, the part of the image
    of the face that is in the image, its area and density; the visible fraction, its bound and
    kind; resolution, focus, coverage and reason.
    """
    points, pose, near = work.points, seen.poses[row], seen.near[row]
    i, j, k = scene.faces[f, 0], scene.faces[f, 1], scene.faces[f, 2]
    normal = camera_normal(scene.normals, f, pose)
    cosine = incidence_cosine(points, i, j, k, normal, scene.two_sided[f])
    is_front = cosine > 0 and not scene.degenerate[f]
    state, part, area = image_of_face(points, i, j, k, near, lens, work)
    density = 0.0
    if asks_density and is_front and state != BEHIND and part > 0:
        density = pixel_density(points, i, j, k, normal, lens)
    drawn = seen.drawn[row, f]
    resolution = min(drawn / limits.min_pixels, LARGEST_RESOLUTION)
    visibility, bound, kind = 0.0, 0.0, EXACT
    if is_front and (part != 0 or state == INSIDE):
        kind = int(seen.kind[row, f])
        bound = 1.0
        if drawn > 0:
            visibility = seen.visible[row, f] / drawn
            bound = bound_of_fraction(seen, row, f, drawn, points, i, j, k, state == BEHIND)
            bound = min(bound, 1.0)
    is_focused = in_focus(points, i, j, k, limits)
    figures = resolution, density, visibility
    product, reason = judge(
        limits, scene.degenerate[f], is_front, state == INSIDE, is_focused, drawn > 0, figures,
        cosine,
    )  # fmt: skip
    geometry = cosine, state, part, area, density
    return geometry, (visibility, bound, kind), resolution, is_focused, product, reason


@allocation_free
def judge_poses(rows, scene, lens, seen, limits, work, out):
    """Fill rows of `out` with the figures of poses `rows[0]` to `rows[1] - 1`.

    A `rastercov.task.Limits` holds the thresholds. What is not asked for is not computed, unless
    the coverage depends on it.
    """
    asks_density = out.pixel_density.size > 0 or limits.min_pixel_density > 0
    for row in range(rows[0], rows[1]):
        project(scene.vertices, seen.poses[row], seen.near[row], lens, work.points)
        for f in range(scene.faces.shape[0]):
            geometry, fraction, resolution, is_focused, product, reason = judge_face(
                scene, lens, seen, limits, work, row, f, asks_density
            )
            cosine, state, part, area, density = geometry
            visibility, bound, kind = fraction
            if out.in_view.size:
                out.in_view[row, f] = state == INSIDE
            if out.in_view_fraction.size:
                out.in_view_fraction[row, f] = part
            if out.projected_area.size:
                out.projected_area[row, f] = area
            if out.visible_pixels.size:
                out.visible_pixels[row, f] = seen.visible[row, f]
            if out.drawn_pixels.size:
                out.drawn_pixels[row, f] = seen.drawn[row, f]
            if out.resolution.size:
                out.resolution[row, f] = resolution
            if out.pixel_density.size:
                out.pixel_density[row, f] = density
            if out.in_focus.size:
                out.in_focus[row, f] = is_focused
            if out.visibility.size:
                out.visibility[row, f] = visibility
            if out.visibility_bound.size:
                out.visibility_bound[row, f] = bound
            if out.visibility_kind.size:
                out.visibility_kind[row, f] = kind
            if out.incidence.size:
                out.incidence[row, f] = incidence_angle(cosine)
            if out.coverage.size:
                out.coverage[row, f] = product
            if out.reason.size:
                out.reason[row, f] = reason


@part_with_arrays
def add_pair(row, f, is_scored, coverage, reason, bound, kind, fraction, sums):
    """Add the figures of a face in one pose; returns 1 if it is scored and covered.

    Of equal coverages the least row of the batch is the best, whatever the order in which rows
    come. A pair that fails no later than for its back is not in view.
    """
    covers = reason == COVERED
    if covers:
        sums.views[f] += 1
    if coverage > 0:
        best = sums.best[f]
        if coverage > best or (coverage == best and row < sums.best_row[f]):
            sums.best[f], sums.best_row[f] = coverage, row
    if reason > sums.reason[f]:
        sums.reason[f] = reason
    if is_scored[f] and reason > BACK_FACING and fraction > 0:
        sums.kinds[min(kind, EXACT)] += 1
        sums.bounds[0] = max(sums.bounds[0], bound)
    if is_scored[f] and covers:
        sums.bounds[1] = max(sums.bounds[1], bound)
        return 1
    return 0


@allocation_free
def add_rows(is_scored, coverage, reason, bound, kind, fraction, sums, covered_faces):
    """Add rows of figures, (P, F) each, to `sums`.

    Out: `covered_faces`, (P,), the scored faces that each pose covers.
    """
    for row in range(coverage.shape[0]):
        for f in range(coverage.shape[1]):
            covered_faces[row] += add_pair(
                row, f, is_scored, coverage[row, f], reason[row, f], bound[row, f],
                int(kind[row, f]), fraction[row, f], sums,
            )  # fmt: skip


@allocation_free
def add_pose(row, scene, lens, seen, limits, work, is_scored, sums, covered_faces, coverage):
    """Judge the faces in one pose and add them to `sums`, as `judge_poses` and `add_rows` would.

    Out: an element of `covered_faces`, (P,), and `coverage`, (F,).
    """
    points, pose = work.points, seen.poses[row]
    asks_density = limits.min_pixel_density > 0
    project(scene.vertices, pose, seen.near[row], lens, points)
    for f in range(scene.faces.shape[0]):
        product, reason, bound, kind, part = 0.0, BACK_FACING, 0.0, EXACT, 0.0
        if scene.degenerate[f]:
            reason = DEGENERATE
        elif scene.two_sided[f] or faces_camera(scene, points, pose, f):
            geometry, fraction, _, _, product, reason = judge_face(
                scene, lens, seen, limits, work, row, f, asks_density
            )
            _, bound, kind = fraction
            part = geometry[2]
        coverage[f] = product
        covered_faces[row] += add_pair(row, f, is_scored, product, reason, bound, kind, part, sums)


@part_with_arrays
def faces_camera(scene, points, pose, f):
    """False if the cosine of incidence is not positive: quicker, for many faces are behind."""
    i, j, k = scene.faces[f, 0], scene.faces[f, 1], scene.faces[f, 2]
    against, _ = against_ray(points, i, j, k, camera_normal(scene.normals, f, pose))
    return against > 0
