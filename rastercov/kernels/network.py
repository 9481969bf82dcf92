"""Sums over poses of the coverage (3.6) of each face, and rows of a table, compiled by numba.

`add_pose` judges the faces in a pose as `rastercov.kernels.coverage` does, adds the figures to the
sums of a network, and keeps those of chosen pairs as rows. Its twin is in
`rastercov.reference.coverage`.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.kernels.coverage import (
    bound_and_kind,
    cosine_of,
    density_of,
    exceeds_incidence,
    judge_face,
    kind_of,
)
from rastercov.kernels.criteria import (
    AT_A_TIME,
    facing_density,
    image_of_face,
    incidence_angle,
    project,
)
from rastercov.kernels.face_blocks import (
    AREA,
    BACK_FACING,
    BOUND,
    COSINE,
    COVERAGE,
    COVERED,
    DEGENERATE,
    DENSITY,
    DRAWN,
    EXACT,
    FACING,
    FOCUSED,
    KIND,
    PART,
    REASON,
    RESOLUTION,
    VISIBILITY,
    VISIBLE,
    add_backs,
    add_lanes,
    are_behind,
    judge_block,
)
from rastercov.kernels.jit import allocation_free, part_with_arrays
from rastercov.kernels.simd_kernel import pointer, pointers
from rastercov.kernels.vertex_columns import INSIDE, X, Y, Z

NO_PAIRS, COVERED_PAIRS, SEEN_PAIRS, ALL_PAIRS = range(4)
"""Indices of `rastercov.coverage.judged_poses.CHOICES`."""


PLANE_ROUNDING = 1e-12
"""Of the distance of a point from a plane, to the sum of their coordinates: greater than the error,
so that a point beyond it is behind the face in any order of operations."""
CLEAR_REL = 1e-5
"""Relative difference from which squares of cosines decide. Their own error is less where a tenth
of it, times the height of a camera above a plane, exceeds the rounding of that height."""


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


class PairRows(NamedTuple):
    """Columns of a table of pairs of pose and face, (R,) each: their indices, then the figures.

    Figures are named as in `Figures`, floats are float32, and what has a name is its code.
    """

    pose: NDArray[np.int32]
    face: NDArray[np.int32]
    in_view: NDArray[np.bool_]
    in_view_fraction: NDArray[np.float32]
    projected_area: NDArray[np.float32]
    visible_pixels: NDArray[np.float32]
    drawn_pixels: NDArray[np.float32]
    resolution: NDArray[np.float32]
    pixel_density: NDArray[np.float32]
    facing_density: NDArray[np.float32]
    in_focus: NDArray[np.bool_]
    visibility: NDArray[np.float32]
    visibility_bound: NDArray[np.float32]
    visibility_kind: NDArray[np.int32]
    incidence: NDArray[np.float32]
    coverage: NDArray[np.float32]
    reason: NDArray[np.int32]


ROW_TYPES: dict[str, type] = {
    name: np.bool_ if name in ("in_view", "in_focus") else np.float32 for name in PairRows._fields
} | dict.fromkeys(("pose", "face", "visibility_kind", "reason"), np.int32)
"""Types of the columns of `PairRows`."""


class Sink(NamedTuple):
    """Memory for the rows of a batch of P poses: room for all P * F pairs.

    The rows of the poses that a thread takes together, `turn` the first of them, are the
    `counts[turn]` from `turn * F` on.
    """

    choice: int  # NO_PAIRS, ...
    pose_ids: NDArray[np.int64]
    counts: NDArray[np.int64]
    rows: PairRows


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


@part_with_arrays
def add_row(at, pose_id, f, geometry, is_focused, resolution, areas, bound, kind, decision, rows):
    """Put the figures of a pair into row `at`.

    The bound includes the rounding of the visible fraction to float32, so that it still holds.
    """
    cosine, state, part, area, density, facing = geometry
    visible, drawn, visibility = areas
    rows.pose[at], rows.face[at] = pose_id, f
    rows.in_view[at], rows.in_focus[at] = state == INSIDE, is_focused
    rows.in_view_fraction[at], rows.projected_area[at] = part, area
    rows.visible_pixels[at], rows.drawn_pixels[at] = visible, drawn
    rows.resolution[at], rows.pixel_density[at] = resolution, density
    rows.facing_density[at] = facing
    short = np.float32(visibility)
    bound += abs(short - visibility)
    short_bound = np.float32(bound)
    if short_bound < bound:
        short_bound = np.nextafter(short_bound, np.float32(np.inf))
    rows.visibility[at], rows.visibility_bound[at] = short, short_bound
    rows.visibility_kind[at] = kind
    rows.incidence[at] = incidence_angle(cosine)
    rows.coverage[at], rows.reason[at] = decision


@part_with_arrays
def orientation(scene, seen, limits, points, row, f, height, rounding):
    """True if a face is seen from the front; True if its angle of incidence is too great.

    `height` is that of the camera centre above the plane of the face, which the cosine of the angle
    is to the distance of the centroid. Squares decide, without a root or a quotient, unless they
    are equal to `CLEAR_REL` or the height to its rounding: then the cosine does.
    """
    i, j, k = scene.faces[f, 0], scene.faces[f, 1], scene.faces[f, 2]
    x = points[i, X] + points[j, X] + points[k, X]
    y = points[i, Y] + points[j, Y] + points[k, Y]
    z = points[i, Z] + points[j, Z] + points[k, Z]
    squared = 9 * (height * height)
    least = limits.least_cosine * limits.least_cosine * (x * x + y * y + z * z)
    if 0.1 * CLEAR_REL * abs(height) > rounding and (
        squared > (1 + CLEAR_REL) * least or squared < (1 - CLEAR_REL) * least
    ):
        is_front = (height > 0 or scene.two_sided[f]) and not scene.degenerate[f]
        return is_front, squared < least
    cosine = cosine_of(scene, seen, points, row, f)
    return cosine > 0 and not scene.degenerate[f], exceeds_incidence(cosine, limits)


@part_with_arrays
def add_block(first, row, turn, scene, lens, seen, work, limits, is_scored, sums, covered_faces,
              coverage, sink, rounding):  # fmt: skip
    """Add `AT_A_TIME` faces from `first` on, as `add_pose` does each; False where it must."""
    choice, block, pose = sink.choice, work.block, seen.poses[row]
    has_rows, n_faces = choice != NO_PAIRS, scene.faces.shape[0]
    if choice != ALL_PAIRS and first + AT_A_TIME <= n_faces and are_behind(
        first, pointer(scene.normals), pointer(scene.offsets), pointer(scene.two_sided),
        pose[0, 3], pose[1, 3], pose[2, 3], rounding,
    ):  # fmt: skip
        add_backs(first, pointer(scene.degenerate), pointer(sums.reason), pointer(coverage))
        return True
    # The sums hold the largest bounds, and none exceeds 1.
    asks_bound = seen.kind.size > 0 or has_rows or min(sums.bounds[0], sums.bounds[1]) < 1
    if not judge_block(
        first, scene, lens, seen, row, limits, work, has_rows or limits.min_pixel_density > 0,
        has_rows or limits.min_facing_density > 0, asks_bound,
    ):  # fmt: skip
        return False
    covered_faces[row] += add_lanes(
        first, row, pointer(is_scored), pointers(sums), pointer(coverage), pointer(block)
    )
    for lane in range(AT_A_TIME if has_rows else 0):
        reason, part = np.int64(block[REASON, lane]), block[PART, lane]
        if (
            choice == ALL_PAIRS
            or reason == COVERED
            or (choice == SEEN_PAIRS and reason > BACK_FACING and part > 0)
        ):
            at = turn * n_faces + sink.counts[turn]
            sink.counts[turn] += 1
            geometry = (
                block[COSINE, lane], INSIDE, part, block[AREA, lane], block[DENSITY, lane],
                block[FACING, lane],
            )  # fmt: skip
            areas = block[VISIBLE, lane], block[DRAWN, lane], block[VISIBILITY, lane]
            add_row(
                at, sink.pose_ids[row], first + lane, geometry, block[FOCUSED, lane] > 0,
                block[RESOLUTION, lane], areas, block[BOUND, lane], np.int64(block[KIND, lane]),
                (block[COVERAGE, lane], reason), sink.rows,
            )  # fmt: skip
    return True


@allocation_free
def add_pose(row, turn, scene, lens, seen, work, limits, is_scored, sums, covered_faces, coverage,
             sink):  # fmt: skip
    """Judge the faces in one pose and add them to `sums`, as `judge_poses` and `add_rows` would.

    Out: an element of `covered_faces`, (P,), and `coverage`, (F,); and in `sink`, behind those of
    this turn, the rows of the pairs that it asks for.
    """
    points, pose, choice, n_faces = work.points, seen.poses[row], sink.choice, scene.faces.shape[0]
    asks_density, asks_facing = limits.min_pixel_density > 0, limits.min_facing_density > 0
    x, y, z = pose[0, 3], pose[1, 3], pose[2, 3]
    rounding = PLANE_ROUNDING * (abs(x) + abs(y) + abs(z) + scene.reach)
    project(scene.vertices, pose, seen.near[row], lens, points)
    normals, is_added = scene.normals, False
    for f in range(n_faces):
        if f % AT_A_TIME == 0:
            is_added = add_block(
                f, row, turn, scene, lens, seen, work, limits, is_scored, sums, covered_faces,
                coverage, sink, rounding,
            )  # fmt: skip
        if is_added:
            continue
        product, reason, bound, kind, part = 0.0, BACK_FACING, 0.0, EXACT, 0.0
        height = normals[f, 0] * x + normals[f, 1] * y + normals[f, 2] * z - scene.offsets[f]
        is_behind = height < -rounding and not scene.two_sided[f]
        if scene.degenerate[f]:
            is_behind, reason = True, DEGENERATE
        if not is_behind or choice == ALL_PAIRS:
            is_front, is_oblique = orientation(
                scene, seen, limits, points, row, f, height, rounding
            )
            geometry, is_seen, areas, resolution, is_focused, product, reason = judge_face(
                scene, lens, seen, limits, work, row, f, is_front, is_oblique, False,
                asks_density, asks_facing,
            )  # fmt: skip
            part = geometry[1]
            is_row = choice != NO_PAIRS and (
                choice == ALL_PAIRS
                or reason == COVERED
                or (choice == SEEN_PAIRS and reason > BACK_FACING and part > 0)
            )
            # The sums hold the largest bounds, and none exceeds 1.
            bound, kind = 1.0, kind_of(seen, row, f) if is_seen else EXACT
            if is_row or sums.bounds[0] < 1 or (reason == COVERED and sums.bounds[1] < 1):
                cosine = cosine_of(scene, seen, points, row, f)
                bound, kind = bound_and_kind(
                    scene, lens, seen, points, row, f, areas[1], cosine, geometry[0], part,
                    is_seen, work,
                )  # fmt: skip
            if is_row:
                state, part, area, density, facing = geometry
                i, j, k = scene.faces[f, 0], scene.faces[f, 1], scene.faces[f, 2]
                if not seen.kind.size:  # counted, and no area has been asked for
                    near = seen.near[row]
                    state, part, area = image_of_face(points, i, j, k, near, lens, work, -1.0)
                if not asks_facing:
                    facing = facing_density(points, i, j, k, lens)
                if not asks_density:
                    density = density_of(
                        scene, lens, seen, points, row, f, reason > BACK_FACING, state, part
                    )
                cosine = cosine_of(scene, seen, points, row, f)
                geometry = cosine, state, part, area, density, facing
                at = turn * n_faces + sink.counts[turn]
                sink.counts[turn] += 1
                add_row(
                    at, sink.pose_ids[row], f, geometry, is_focused, resolution, areas, bound,
                    kind, (product, reason), sink.rows,
                )  # fmt: skip
        coverage[f] = product
        covered_faces[row] += add_pair(row, f, is_scored, product, reason, bound, kind, part, sums)
