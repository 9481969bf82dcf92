"""Rows of a result, from the regions of single cameras.

A row is a pose of a camera, or of the cameras that count together by the rule of their rig, see
`rastercov.camera.rig.rows_of_result`, where conditions of features hold.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from rastercov.base.checks import shown
from rastercov.base.errors import ConfigError, errors_as
from rastercov.base.memory import ByteArray, FloatArray, Int32Array, IntArray
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, Rig, apparent, by_gate, gates_of, led_by, names_of
from rastercov.coverage.area.frames import in_front
from rastercov.coverage.area.gates import failed_limits, fewest, through
from rastercov.coverage.area.table import Regions, joined, taken
from rastercov.coverage.reasons import ORDER, RANK, Reason
from rastercov.coverage.task import NEEDED, Task


def tasks_of(cameras: Cameras, task: Task) -> tuple[Task, ...]:
    """Thresholds of each camera: its own if its rig has some, otherwise those of the task.

    Raises
    ------
    ConfigError
        For invalid thresholds, and for a number of views, which does not apply to one camera.
    """
    own = cameras.tasks if isinstance(cameras, Rig) else {}
    found = {}
    for name, given in own.items():
        if not isinstance(given, Task | Mapping):
            raise ConfigError(
                f"tasks of a rig: expected a Task of {shown(name)}, got {shown(given)}; give one"
            )
        with errors_as(ConfigError, f"tasks of a rig: {shown(name)}", (ConfigError, TypeError)):
            found[name] = given if isinstance(given, Task) else Task(**given)
        if found[name].views > 1 or found[name].min_angle_deg > 0:
            raise ConfigError(
                f"tasks of a rig: expected one view of {shown(name)}, got more or an angle; leave "
                "it out"
            )
        for each in NEEDED:
            if getattr(found[name], each):
                raise ConfigError(
                    f"tasks of a rig: expected no {each} of {shown(name)}, got some; give it for "
                    "all"
                )
    return tuple(found.get(name, task) for name in names_of(cameras))


def gated(regions: Regions, camera: Cameras, poses: Poses) -> Regions:
    """Regions of rows of the result from those of each of P poses, in their order.

    Conditions of features cut them, too.
    """
    conditions = regions.conditions
    if not gates_of(camera) and not conditions:
        return regions
    parts, rows = [], []
    for gate, own, row in by_gate(camera, poses):
        chosen = np.zeros(len(poses), np.bool_)
        chosen[own.ravel()] = True
        part, some, leads = regions.of_poses(chosen), poses[chosen], poses[own[:, 0]]
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
    return taken(joined(parts), np.argsort(np.concatenate(rows))) if parts else regions


def gated_lists(
    found: Sequence[Int32Array],
    camera: Cameras,
    poses: Poses,
    points: FloatArray,
    normals: FloatArray,
) -> list[Int32Array]:
    """Points of rows of the result, (N, 3) with normals, from those that each of P poses covers."""
    if not gates_of(camera):
        return list(found)
    seen_from = apparent(camera, poses)
    rows: dict[int, Int32Array] = {}
    for gate, own, row in by_gate(camera, poses):
        for at, of_rig in zip(row.tolist(), own, strict=True):
            if gate is None:
                rows[at] = found[of_rig[0]]
                continue
            sees = np.zeros((gate.n, len(points)), np.bool_)
            for device, pose in enumerate(of_rig):
                sees[device, found[pose]] = True
            fronts = in_front(seen_from[of_rig, :3, 3], points, normals)
            holds = gate.holds(sees & fronts) | gate.holds(sees & ~fronts)
            for _, fails in failed_limits(gate, seen_from[of_rig], points):
                holds &= ~fails
            rows[at] = np.flatnonzero(holds).astype(np.int32)
    return [rows[at] for at in range(len(rows))]


def gated_reasons(
    reason: ByteArray,
    camera: Cameras,
    poses: Poses,
    points: FloatArray,
    normals: FloatArray,
    *,
    has_limits: bool = True,
) -> tuple[ByteArray, IntArray]:
    """(R, N) `Reason` of each row of the result and the pose that has it, from (P, N) of each pose.

    Of a rig, that of the camera that is missed most, see `Gate.failing`; from one side of a face,
    cameras on the other see it from behind. With limits it is the reason of one that fails
    where the devices see the point.
    """
    n_rows = len(led_by(camera, poses))
    seen_from = apparent(camera, poses)
    rank, from_behind = RANK[reason].astype(np.uint8), np.uint8(RANK[Reason.BACK_FACING])
    found = np.empty((n_rows, reason.shape[1]), np.uint8)
    pose = np.empty(found.shape, np.int64)
    for gate, own, row in by_gate(camera, poses):
        if gate is None:
            found[row], pose[row] = reason[own[:, 0]], own[:, :1]
            continue
        for at, of_rig in zip(row, own, strict=True):
            front = in_front(seen_from[of_rig, :3, 3], points, normals)
            behind = np.minimum(rank[of_rig], from_behind)
            best, device = gate.failing(np.where(front, rank[of_rig], behind))
            other, of_other = gate.failing(np.where(front, behind, rank[of_rig]))
            pose[at] = of_rig[np.where(other > best, of_other, device)]
            last = np.array(ORDER, np.uint8)[np.maximum(best, other)]
            found[at] = fewest(gate, reason[of_rig], front, last)
            placed = seen_from[of_rig]
            for failed, fails in failed_limits(gate, placed, points) if has_limits else ():
                found[at][fails & (found[at] == Reason.COVERED)] = failed
    return found, pose
