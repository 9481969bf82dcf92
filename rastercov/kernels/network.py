"""Sums over poses of the coverage (3.6) of each face, and rows of a table, compiled by numba.

`add_pose` judges the faces in a pose as `rastercov.kernels.coverage` does, adds the figures to the
sums of a network, and keeps those of chosen pairs as rows. Its twin is in
`rastercov.reference.coverage`.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.kernels import decision as code
from rastercov.kernels.coverage import (
    cosine_of,
    density_of,
    exceeds_incidence,
    measure_face,
    put_bound,
)
from rastercov.kernels.criteria import (
    facing_density,
    image_of_face,
    incidence_angle,
    project,
)
from rastercov.kernels.decision import AT_A_TIME, decide_block
from rastercov.kernels.face_blocks import add_backs, add_lanes, are_behind, judge_eight
from rastercov.kernels.jit import allocation_free, part_with_arrays
from rastercov.kernels.simd_kernel import pointer, pointers
from rastercov.kernels.vertex_blocks import INSIDE, X, Y, Z

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
    covers = reason == code.COVERED
    if covers:
        sums.views[f] += 1
    if coverage > 0:
        best = sums.best[f]
        if coverage > best or (coverage == best and row < sums.best_row[f]):
            sums.best[f], sums.best_row[f] = coverage, row
    if reason > sums.reason[f]:
        sums.reason[f] = reason
    if is_scored[f] and reason > code.BACK_FACING and fraction > 0:
        sums.kinds[min(kind, code.EXACT)] += 1
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
def add_row(at, pose_id, f, block, lane, rows):
    """Put the figures of a pair, a lane of a block, into row `at`.

    The bound includes the rounding of the visible fraction to float32, so that it still holds.
    """
    rows.pose[at], rows.face[at] = pose_id, f
    rows.in_view[at], rows.in_focus[at] = (
        block[code.IN_VIEW, lane] > 0,
        block[code.FOCUSED, lane] > 0,
    )
    rows.in_view_fraction[at] = block[code.PART, lane]
    rows.projected_area[at] = block[code.AREA, lane]
    rows.visible_pixels[at], rows.drawn_pixels[at] = (
        block[code.VISIBLE, lane],
        block[code.DRAWN, lane],
    )
    rows.resolution[at] = block[code.RESOLUTION, lane]
    rows.pixel_density[at], rows.facing_density[at] = (
        block[code.DENSITY, lane],
        block[code.FACING, lane],
    )
    visibility = block[code.VISIBILITY, lane]
    short = np.float32(visibility)
    bound = block[code.BOUND, lane] + abs(short - visibility)
    short_bound = np.float32(bound)
    if short_bound < bound:
        short_bound = np.nextafter(short_bound, np.float32(np.inf))
    rows.visibility[at], rows.visibility_bound[at] = short, short_bound
    rows.visibility_kind[at] = np.int64(block[code.KIND, lane])
    rows.incidence[at] = incidence_angle(block[code.COSINE, lane])
    rows.coverage[at] = block[code.COVERAGE, lane]
    rows.reason[at] = np.int64(block[code.REASON, lane])


@part_with_arrays
def orientation(scene, seen, rules, points, row, f, height, rounding):
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
    least = rules.cos_incidence * rules.cos_incidence * (x * x + y * y + z * z)
    if 0.1 * CLEAR_REL * abs(height) > rounding and (
        squared > (1 + CLEAR_REL) * least or squared < (1 - CLEAR_REL) * least
    ):
        is_front = (height > 0 or scene.two_sided[f]) and not scene.degenerate[f]
        return is_front, squared < least
    cosine = cosine_of(scene, seen, points, row, f)
    return cosine > 0 and not scene.degenerate[f], exceeds_incidence(cosine, rules)


@part_with_arrays
def measure_each(first, n, row, scene, lens, seen, work, rules, rounding, measures_all):
    """Measure n faces one by one; unless all are asked for, those seen from behind are left out."""
    block, pose, normals = work.block, seen.poses[row], scene.normals
    for lane in range(n):
        f = first + lane
        height = normals[f, 0] * pose[0, 3] + normals[f, 1] * pose[1, 3]
        height = height + normals[f, 2] * pose[2, 3] - scene.offsets[f]
        is_behind = height < -rounding and not scene.two_sided[f]
        if (is_behind or scene.degenerate[f]) and not measures_all:
            block[code.SIDE, lane], block[code.PART, lane] = (
                -1.0 if scene.degenerate[f] else 0.0,
                0.0,
            )
            continue
        is_front, is_oblique = orientation(
            scene, seen, rules, work.points, row, f, height, rounding
        )
        measure_face(
            lane, f, scene, lens, seen, row, rules, work, is_front, is_oblique, False,
            rules.min_pixel_density > 0, rules.min_facing_density > 0,
        )  # fmt: skip


@part_with_arrays
def complete_row(lane, f, row, scene, lens, seen, work, rules):
    """Fill what `measure_each` leaves out of the figures of a face."""
    points, block, near = work.points, work.block, seen.near[row]
    i, j, k = scene.faces[f, 0], scene.faces[f, 1], scene.faces[f, 2]
    state, part = block[code.STATE_OF_FACE, lane], block[code.PART, lane]
    if not seen.kind.size:  # counted, and no area has been asked for
        state, part, area = image_of_face(points, i, j, k, near, lens, work, -1.0)
        block[code.IN_VIEW, lane], block[code.PART, lane] = (
            1.0 if state == INSIDE else 0.0,
            part,
        )
        block[code.AREA, lane] = area
    if not rules.min_facing_density > 0:
        block[code.FACING, lane] = facing_density(points, i, j, k, lens)
    if not rules.min_pixel_density > 0:
        block[code.DENSITY, lane] = density_of(
            scene, lens, seen, points, row, f, block[code.SIDE, lane] > 0, state, part
        )


@allocation_free
def add_pose(row, turn, scene, lens, seen, work, rules, is_scored, sums, covered_faces, coverage,
             sink):  # fmt: skip
    """Judge the faces in one pose and add them to `sums`, as `judge_poses` and `add_rows` would.

    Out: an element of `covered_faces`, (P,), and `coverage`, (F,); and in `sink`, behind those of
    this turn, the rows of the pairs that it asks for.
    """
    choice, n_faces, block, pose = sink.choice, scene.faces.shape[0], work.block, seen.poses[row]
    has_rows, has_kinds = choice != NO_PAIRS, seen.kind.size > 0
    x, y, z = pose[0, 3], pose[1, 3], pose[2, 3]
    rounding = PLANE_ROUNDING * (abs(x) + abs(y) + abs(z) + scene.reach)
    project(scene.vertices, pose, seen.near[row], lens, work.points)
    for first in range(0, n_faces, AT_A_TIME):
        n = min(AT_A_TIME, n_faces - first)
        is_whole = n == AT_A_TIME
        if is_whole and choice != ALL_PAIRS and are_behind(
            first, pointer(scene.normals), pointer(scene.offsets), pointer(scene.two_sided),
            x, y, z, rounding,
        ):  # fmt: skip
            add_backs(first, pointer(scene.degenerate), pointer(sums.reason), pointer(coverage))
            continue
        # The sums hold the largest bounds, and none exceeds 1.
        has_bounds = is_whole and judge_eight(
            first, scene, lens, seen, row, rules, work, has_rows or rules.min_pixel_density > 0,
            has_rows or rules.min_facing_density > 0,
            has_kinds or has_rows or min(sums.bounds[0], sums.bounds[1]) < 1,
        )  # fmt: skip
        if has_bounds and not has_rows:
            covered_faces[row] += add_lanes(
                first, row, pointer(is_scored), pointers(sums), pointer(coverage), pointer(block)
            )
            continue
        if not has_bounds:
            measure_each(
                first, n, row, scene, lens, seen, work, rules, rounding, choice == ALL_PAIRS
            )
            decide_block(rules, pointer(block))
        for lane in range(n):
            f, reason, part = first + lane, block[code.REASON, lane], block[code.PART, lane]
            covers, in_view = reason == code.COVERED, reason > code.BACK_FACING and part > 0
            is_row = choice == ALL_PAIRS or (
                (has_rows and covers) or (choice == SEEN_PAIRS and in_view)
            )
            if not has_bounds and (
                is_row or (in_view and sums.bounds[0] < 1) or (covers and sums.bounds[1] < 1)
            ):
                cosine = cosine_of(scene, seen, work.points, row, f)
                put_bound(lane, f, scene, lens, seen, row, work, cosine)
                block[code.COSINE, lane] = cosine
            if is_row:
                if not has_bounds:
                    complete_row(lane, f, row, scene, lens, seen, work, rules)
                at = turn * n_faces + sink.counts[turn]
                sink.counts[turn] += 1
                add_row(at, sink.pose_ids[row], f, block, lane, sink.rows)
        if is_whole:
            covered_faces[row] += add_lanes(
                first, row, pointer(is_scored), pointers(sums), pointer(coverage), pointer(block)
            )
            continue
        for lane in range(n):
            f = first + lane
            coverage[f] = block[code.COVERAGE, lane]
            covered_faces[row] += add_pair(
                row, f, is_scored, block[code.COVERAGE, lane], np.int64(block[code.REASON, lane]),
                block[code.BOUND, lane], np.int64(block[code.KIND, lane]), block[code.PART, lane],
                sums,
            )  # fmt: skip
