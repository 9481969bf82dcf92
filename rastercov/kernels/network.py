"""Sums over poses of the coverage (3.6) of each face, and rows of a table, compiled by numba.

`add_pose` judges the faces in a pose as `rastercov.kernels.coverage` does, adds the figures to the
sums of a network, and keeps those of chosen pairs as rows. Its twin is in
`rastercov.reference.coverage`.
"""

from collections import namedtuple
from typing import NamedTuple

import numpy as np
from numba.core import types
from numpy.typing import NDArray

from rastercov.kernels import decision as code
from rastercov.kernels.coverage import (
    ROWS,
    TYPES,
    measure_face,
)
from rastercov.kernels.criteria import (
    incidence_angle,
    project,
)
from rastercov.kernels.decision import AT_A_TIME, decide_block
from rastercov.kernels.face_blocks import add_backs, add_lanes, are_behind, judge_eight
from rastercov.kernels.face_bounds import put_bound
from rastercov.kernels.jit import allocation_free, part_with_arrays
from rastercov.kernels.simd_kernel import pointer, pointers, simd

NO_PAIRS, COVERED_PAIRS, SEEN_PAIRS, ALL_PAIRS = range(4)
"""Indices of `rastercov.coverage.network.CHOICES`."""


PLANE_ROUNDING = 1e-12
"""Of the distance of a point from a plane, to the sum of their coordinates: greater than the error,
so that a point beyond it is behind the face in any order of operations."""


class Sums(NamedTuple):
    """Sums over poses of a batch, see `rastercov.Network`; (F,) unless noted.

    `best_row` is the row of the pose in its batch. `bounds` has the largest bound in view and the
    largest of a covered pair, (2,). For each pose, (P,), of which those that were not added are 0:
    the scored faces that it covers, and the total of their coverage.
    """

    views: NDArray[np.int64]
    best: NDArray[np.float64]
    best_row: NDArray[np.int64]
    reason: NDArray[np.uint8]
    kinds: NDArray[np.int64]
    bounds: NDArray[np.float64]
    covered_faces: NDArray[np.int64]
    totals: NDArray[np.float64]


PairRows = namedtuple(
    "PairRows",
    "pose face in_view in_view_fraction projected_area visible_pixels drawn_pixels resolution "
    "pixel_density facing_density in_focus visibility visibility_bound visibility_kind incidence "
    "coverage reason",
)
"""Columns of a table of pairs of pose and face, (R,) each: their indices, then the figures.

Figures are named as in `Figures`, floats are float32, and what has a name is its code.
"""
_SHORT = {np.bool_: np.bool_, np.float64: np.float32, np.uint8: np.int32}
ROW_TYPES: dict[str, type] = {"pose": np.int32, "face": np.int32} | {
    name: _SHORT[kind] for name, kind in TYPES.items()
}
"""Types of the columns of `PairRows`."""
_COPIED = {
    name: row
    for name, row in ROWS.items()
    if name not in ("visibility", "visibility_bound", "incidence")
}


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
    """Add the figures of a face in one pose.

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
        sums.covered_faces[row] += 1


@allocation_free
def add_rows(rows, is_scored, coverage, reason, bound, kind, fraction, sums):
    """Add some rows of figures, (P, F) each, to `sums`."""
    for row in rows:
        for f in range(coverage.shape[1]):
            add_pair(
                row, f, is_scored, coverage[row, f], reason[row, f], bound[row, f],
                int(kind[row, f]), fraction[row, f], sums,
            )  # fmt: skip


@simd(returns=types.void)
def copy_lane(at, block, lane, rows):
    """Put the figures that need no change from a lane of a block into row `at`; by pointers."""
    for name, row in _COPIED.items():
        getattr(rows, name).put(at, block.value(lane + row * AT_A_TIME))


@part_with_arrays
def add_row(at, pose_id, f, block, lane, rows):
    """Put the figures of a pair, a lane of a block, into row `at`.

    The bound includes the rounding of the visible fraction to float32, so that it still holds.
    """
    copy_lane(at, pointer(block), lane, pointers(rows))
    rows.pose[at], rows.face[at] = pose_id, f
    visibility = block[code.VISIBILITY, lane]
    short = np.float32(visibility)
    bound = block[code.BOUND, lane] + abs(short - visibility)
    short_bound = np.float32(bound)
    if short_bound < bound:
        short_bound = np.nextafter(short_bound, np.float32(np.inf))
    rows.visibility[at], rows.visibility_bound[at] = short, short_bound
    rows.incidence[at] = incidence_angle(block[code.COSINE, lane])


@part_with_arrays
def measure_each(first, n, row, scene, lens, seen, work, rules, rounding, choice):
    """Measure n faces one by one; unless all are asked for, those seen from behind are left out."""
    block, pose, normals = work.block, seen.poses[row], scene.normals
    has_rows = choice != NO_PAIRS
    for lane in range(n):
        f = first + lane
        height = normals[f, 0] * pose[0, 3] + normals[f, 1] * pose[1, 3]
        height = height + normals[f, 2] * pose[2, 3] - scene.offsets[f]
        is_behind = height < -rounding and not scene.two_sided[f]
        if (is_behind or scene.degenerate[f]) and choice != ALL_PAIRS:
            block[code.SIDE, lane] = -1.0 if scene.degenerate[f] else 0.0
            block[code.PART, lane] = 0.0
            continue
        measure_face(
            lane, f, scene, lens, seen, row, rules, work, has_rows,
            has_rows or rules.min_pixel_density > 0, has_rows or rules.min_facing_density > 0,
        )  # fmt: skip


@allocation_free
def add_pose(row, turn, scene, lens, seen, work, rules, is_scored, sums, coverage, sink):
    """Judge the faces in one pose and add them to `sums`, as `judge_poses` and `add_rows` would.

    Out: `coverage`, (F,); and in `sink`, behind those of this turn, the rows of the pairs that it
    asks for.
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
            sums.covered_faces[row] += add_lanes(
                first, row, pointer(is_scored), pointers(sums), pointer(coverage), pointer(block)
            )
            continue
        if not has_bounds:
            measure_each(first, n, row, scene, lens, seen, work, rules, rounding, choice)
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
                put_bound(lane, f, scene, lens, seen, row, work)
            if is_row:
                at = turn * n_faces + sink.counts[turn]
                sink.counts[turn] += 1
                add_row(at, sink.pose_ids[row], f, block, lane, sink.rows)
        if is_whole:
            sums.covered_faces[row] += add_lanes(
                first, row, pointer(is_scored), pointers(sums), pointer(coverage), pointer(block)
            )
            continue
        for lane in range(n):
            f = first + lane
            coverage[f] = block[code.COVERAGE, lane]
            add_pair(
                row, f, is_scored, block[code.COVERAGE, lane], np.int64(block[code.REASON, lane]),
                block[code.BOUND, lane], np.int64(block[code.KIND, lane]), block[code.PART, lane],
                sums,
            )  # fmt: skip
