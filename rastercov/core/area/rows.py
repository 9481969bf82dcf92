"""Rows of a result, from the regions of single cameras.

A row is a pose of a camera, or of the cameras that count together by the rule of their rig, see
`rastercov.core.camera.rig.rows_of_result`, where conditions of features hold. Cameras that count
together, see `rastercov.core.camera.rule`, are on one side of the face, by the sign of their height
over its plane.
"""

from collections.abc import Sequence

import numpy as np

from rastercov.base import ByteArray, FloatArray, Int32Array, hooks_of, sort_order
from rastercov.core.area.feature import Feature
from rastercov.core.area.table import Cut, Regions, join, take_rows
from rastercov.core.camera import Cameras, Gate, Poses, apparent, by_gate, gates_of, led_by, movers
from rastercov.core.coverage.task import Reason


def through(
    regions: Regions,
    gate: Gate,
    without: int = -1,
    cuts: Sequence[Cut] = (),
    *,
    one_side: bool = True,
) -> Regions:
    """Regions of rigs of one gate, whose cameras follow one another.

    With `without`, a camera, by the others: as if that camera covered everything. `cuts` are those
    of conditions, see `Condition.cut_of`.
    Without `one_side`, devices on both sides of a face count together.
    """
    n_rigs = len(regions.pose_ids) // gate.n
    rig, device = np.divmod(np.arange(len(regions.pose_ids)), gate.n)
    needs = np.isin(device, gate.needs)
    needed = np.where(needs, rig, -1)
    others = np.where(needs | (device == without), -1, rig)
    k = gate.k - len(gate.needs)

    def count(part: Regions, is_rear: bool) -> Regions:
        parts = count_part(part)
        for cut in cuts:
            parts = cut(parts, is_rear)
        for each in hooks_of(Feature):
            parts = each.cut_rigs(parts, gate, regions)
        return parts

    def count_part(part: Regions) -> Regions:
        if not gate.needs:
            return part.at_least(k, others, one_side=False)
        at_least = part.at_least(len(gate.needs), needed, one_side=False)
        if k <= 0:
            return at_least
        both = join([at_least, part.at_least(k, others, one_side=False)])
        return both.at_least(2, np.tile(np.arange(n_rigs), 2), one_side=False)

    return regions._by_side(count) if one_side else count(regions, False)


def with_rule(regions: Regions, camera: Cameras, poses: Poses) -> Regions:
    """Regions of rows of the result from those of each of P poses, in their order.

    Conditions of features cut them, too.
    """
    conditions = regions.conditions
    if not gates_of(camera) and not conditions:
        return regions
    parts, rows, moving = [], [], movers(camera, poses)
    for gate, own, row in by_gate(camera, poses):
        chosen = np.zeros(len(poses), bool)
        chosen[own.ravel()] = True
        part, some, leads = regions.of_poses(chosen), poses[chosen], moving[own[:, 0]]
        for each in conditions:
            part = each.of_cameras(part, camera, some)
        if gate is not None:
            part = through(part, gate, cuts=[each.cut_of(leads) for each in conditions])
        for each in conditions if gate is None else ():
            part = each.of_rows(part, camera, some, leads)
        parts.append(part)
        rows.append(row)
    if len(parts) == 1:
        return parts[0]
    return take_rows(join(parts), sort_order(np.concatenate(rows))) if parts else regions


def rule_lists(
    result: Sequence[Int32Array],
    camera: Cameras,
    poses: Poses,
    points: FloatArray,
    normals: FloatArray,
) -> list[Int32Array]:
    """Points of rows of the result, (N, 3) with normals, from those that each of P poses covers."""
    if not gates_of(camera):
        return list(result)
    rows: dict[int, Int32Array] = {}
    for _, own, row in by_gate(camera, poses):
        for at, of_rig in zip(row.tolist(), own, strict=True):
            sees = np.full((len(of_rig), len(points)), Reason.OCCLUDED, np.uint8)
            for device, pose in enumerate(of_rig):
                sees[device, result[pose]] = Reason.COVERED
            (reason,), _ = rule_reasons(sees, camera, poses[of_rig], points, normals)
            rows[at] = np.flatnonzero(reason == Reason.COVERED).astype(np.int32)
    return [rows[at] for at in range(len(rows))]


def rule_reasons(
    reason: ByteArray,
    camera: Cameras,
    poses: Poses,
    points: FloatArray,
    normals: FloatArray,
    *,
    has_limits: bool = True,
) -> tuple[ByteArray, Int32Array]:
    """(R, N) `Reason` of each row of the result and the pose that has it, from (P, N) of each pose.

    Of a rig with a rule, the fewest criteria that its cameras must meet, or a limit; and the pose
    of the camera that is missed most, -1 where none is: see `engine/area/rule.hpp`.
    """
    from rastercov.engine import area_rule as kernels

    seen_from, at = apparent(camera, poses), (points, normals)
    values = np.empty((len(led_by(camera, poses)), len(points)), np.uint8)
    device = np.empty(values.shape, np.int32)
    for gate, own, row in by_gate(camera, poses):
        if gate is None:
            values[row], device[row] = reason[own[:, 0]], own[:, :1]
            continue
        rule = gate._for_kernels()
        if not has_limits:
            rule = rule._replace(least_deg=0.0, most_deg=180.0, most_deviation=0.0)
        for one, of_rig in zip(row, own, strict=True):
            placed, given = seen_from[of_rig], reason[of_rig]
            kernels.find_failures(rule, placed, *at, given, values[one], device[one])
            device[one][device[one] >= 0] += of_rig[0]
    return values, device
