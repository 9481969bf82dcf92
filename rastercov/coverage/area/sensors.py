"""Rigs with a rule: what their cameras cover together, from what each of them covers.

A rule is a nest of gates "k of n", see `rastercov.camera.rule`. Cameras that count together are on
one side of the face, by the sign of their height over its plane. Results have a row for each pose
of such a rig, and one for each pose of another camera: `rastercov.camera.rig.rows_of_result`.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from rastercov.base.checks import shown
from rastercov.base.errors import ConfigError, errors_as
from rastercov.base.format import distance
from rastercov.base.memory import FloatArray, IntArray
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, Rig, gates_of, led_by, names_of, rows_of_result
from rastercov.camera.rule import Gate
from rastercov.coverage.area.criteria import (
    RayAngle,
    baseline_holds,
    deviations,
    smallest_cosines,
    uncertainty_of,
)
from rastercov.coverage.area.cut import values_of
from rastercov.coverage.area.frames import to_world
from rastercov.coverage.area.light import Light, Lit, lit_within
from rastercov.coverage.area.polygons import following
from rastercov.coverage.area.table import Regions, joined, taken
from rastercov.coverage.reasons import Reason
from rastercov.coverage.task import Task

MOST_INFORMATION = 1e7
"""Largest limit of a deviation, in that of one ray at a diagonal of the mesh: its square is the
information of rays beside 1, and rounded by 1e-16."""
MOST_HALVINGS = 8
"""Of triangles in which the largest deviation is looked for."""
QUARTERS = np.array([
    [(2, 0, 0), (1, 1, 0), (1, 0, 1)], [(1, 1, 0), (0, 2, 0), (0, 1, 1)],
    [(1, 0, 1), (0, 1, 1), (0, 0, 2)], [(1, 1, 0), (0, 1, 1), (1, 0, 1)],
]) / 2  # fmt: skip
"""Corners of the quarters of a triangle by its corners."""


def tasks_of(cameras: Cameras, task: Task) -> tuple[Task, ...]:
    """Thresholds of each camera: its own where its rig has some, otherwise those of the task.

    Raises
    ------
    ConfigError
        For thresholds that are none, and for a number of views, which is of no single camera.
    """
    own = cameras.tasks if isinstance(cameras, Rig) else {}
    found = {}
    for name, given in own.items():
        if not isinstance(given, Task | Mapping):
            raise ConfigError(f"tasks of a rig: {shown(name)} must have a Task, got {shown(given)}")
        with errors_as(ConfigError, f"tasks of a rig: {shown(name)}", (ConfigError, TypeError)):
            found[name] = given if isinstance(given, Task) else Task(**given)
        if found[name].views > 1 or found[name].min_angle_deg > 0:
            raise ConfigError(
                f"tasks of a rig: {shown(name)} is one camera; leave out views and min_angle_deg"
            )
        if found[name].asks_for_light:
            raise ConfigError(
                f"tasks of a rig: light is the same for all; leave it out of {shown(name)}"
            )
    return tuple(found.get(name, task) for name in names_of(cameras))


def gated(regions: Regions, camera: Cameras, poses: Poses) -> Regions:
    """Regions of rows of the result from those of each of P poses, in their order.

    Where the cameras have lamps, they are what these light, too.
    """
    light: Light | None = regions.light
    if not gates_of(camera) and light is None:
        return regions
    parts, rows = [], []
    for gate, own, row in _by_gate(camera, poses):
        chosen = np.zeros(len(poses), np.bool_)
        chosen[own.ravel()] = True
        part = without_highlights(regions.of_poses(chosen), camera, poses[chosen])
        lit = () if light is None else light.rows(poses[own[:, 0]])
        if gate is not None:
            part = through(part, gate, lit=lit)
        elif light is not None and not _limits_highlights(camera, light, poses[chosen]).all():
            part = _lit(part, lit)
        parts.append(part)
        rows.append(row)
    if len(parts) == 1:
        return parts[0]
    return taken(joined(parts), np.argsort(np.concatenate(rows))) if parts else regions


def _lit(regions: Regions, lit: Sequence[Lit]) -> Regions:
    """Parts of single cameras that lamps on the same side of the face light."""
    found = regions._by_side(lambda part, is_rear: lit_within(part, lit, is_rear=is_rear))
    return replace(found, eyes=regions.eyes, columns=regions.columns)


def without_highlights(regions: Regions, camera: Cameras, poses: Poses) -> Regions:
    """Lit parts in which P poses see no lamp mirrored, of cameras whose task limits highlights."""
    light: Light | None = regions.light
    if light is None:
        return regions
    is_asked = _limits_highlights(camera, light, poses)
    if not is_asked.any():
        return regions
    some = regions.of_poses(is_asked)
    (lit,) = light.rows(poses[is_asked])
    limit = light.task.max_highlight_deg
    cut = some._by_side(lambda part, is_rear: lit.without_highlights(part, limit, is_rear=is_rear))
    cut = replace(cut, eyes=some.eyes, columns=some.columns)
    both = joined([cut, regions.of_poses(~is_asked)])
    order = np.argsort(np.concatenate([np.flatnonzero(is_asked), np.flatnonzero(~is_asked)]))
    return taken(both, order)


def _limits_highlights(camera: Cameras, light: Light, poses: Poses) -> NDArray[np.bool_]:
    """(P,) poses of cameras whose own task limits highlights."""
    tasks = tasks_of(camera, light.task)
    return np.array([task.max_highlight_deg > 0 for task in tasks])[poses.camera]


def through(regions: Regions, gate: Gate, without: int = -1, lit: Sequence[Lit] = ()) -> Regions:
    """Regions of rigs of one rule, whose cameras follow one another.

    With `without`, a camera, by the rule of the others: as if that camera covered everything. An
    uncertainty is that by all of them. `lit` is what lamps light, of `Light.rows`.
    """
    n_rigs = len(regions.pose_ids) // gate.n
    rig, device = np.divmod(np.arange(len(regions.pose_ids)), gate.n)
    needs = np.isin(device, gate.needs)
    needed = np.where(needs, rig, -1)
    others = np.where(needs | (device == without), -1, rig)
    k = gate.k - len(gate.needs)
    eyes = regions.eyes.reshape(n_rigs, gate.n, 3)[:, [at for at in range(gate.n) if at != without]]

    def count(part: Regions, is_rear: bool) -> Regions:
        found = counted(part)
        if lit:
            found = lit_within(found, lit, is_rear=is_rear)
        found = _within_baseline(found, gate, eyes) if gate.has_baseline else found
        if not gate.has_deviation or regions.columns is None:
            return found
        most = MOST_INFORMATION * min(gate.noise) * part.mesh.diagonal
        if gate.most_deviation > most > 0:
            raise ConfigError(
                f"max_uncertainty must be {most:.2g} m or less with this noise and a mesh of this "
                f"size, got {gate.most_deviation:g} m: rounding would decide"
            )
        placed = (each.reshape(n_rigs, gate.n, 3) for each in (regions.eyes, regions.columns))
        return found.where(uncertainty_of(gate, *placed))

    def counted(part: Regions) -> Regions:
        if not gate.needs:
            return part.at_least(k, others, one_side=False)
        found = part.at_least(len(gate.needs), needed, one_side=False)
        if k <= 0:
            return found
        both = joined([found, part.at_least(k, others, one_side=False)])
        return both.at_least(2, np.tile(np.arange(n_rigs), 2), one_side=False)

    return regions._by_side(count)


def _within_baseline(regions: Regions, gate: Gate, eyes: FloatArray) -> Regions:
    """Parts where the rays to cameras (P, n, 3) of a gate differ as it asks.

    By at least its least angle in some two of them, and by at most its greatest in any two.
    """
    pairs = list(combinations(range(eyes.shape[1]), 2))
    for pair in pairs if gate.most_deg < 180 else ():
        regions = regions.where(RayAngle(eyes[:, pair], gate.most_deg, is_least=False))
    if gate.least_deg <= 0 or not pairs:
        return regions
    parts = [regions.where(RayAngle(eyes[:, pair], gate.least_deg)) for pair in pairs]
    if len(parts) == 1:
        return parts[0]
    row = np.arange(len(regions.pose_ids))
    return joined(parts).at_least(1, np.tile(row, len(parts)))


def gated_lists(
    found: Sequence[NDArray[np.int32]],
    camera: Cameras,
    poses: Poses,
    points: FloatArray,
    normals: FloatArray,
) -> list[NDArray[np.int32]]:
    """Points of rows of the result, (N, 3) with normals, from those that each of P poses covers."""
    if not gates_of(camera):
        return list(found)
    rows: dict[int, NDArray[np.int32]] = {}
    for gate, own, row in _by_gate(camera, poses):
        for at, of_rig in zip(row.tolist(), own, strict=True):
            if gate is None:
                rows[at] = found[of_rig[0]]
                continue
            sees = np.zeros((gate.n, len(points)), np.bool_)
            for device, pose in enumerate(of_rig):
                sees[device, found[pose]] = True
            fronts = in_front(poses.world_from_camera[of_rig, :3, 3], points, normals)
            holds = gate.holds(sees & fronts) | gate.holds(sees & ~fronts)
            if gate.has_baseline:
                holds &= baseline_holds(gate, poses.world_from_camera[of_rig, :3, 3], points)
            if gate.has_deviation:
                holds &= is_certain(gate, poses.world_from_camera[of_rig], points)
            rows[at] = np.flatnonzero(holds).astype(np.int32)
    return [rows[at] for at in range(len(rows))]


def gated_reasons(
    reason: NDArray[np.uint8],
    camera: Cameras,
    poses: Poses,
    points: FloatArray,
    normals: FloatArray,
) -> tuple[NDArray[np.uint8], IntArray]:
    """(R, N) `Reason` of each row of the result and the pose that has it, from (P, N) of each pose.

    Of a rig, that of the camera that is missed most, see `Gate.failing`; from one side of a face,
    cameras on the other see it from behind.
    """
    n_rows = len(led_by(camera, poses))
    found = np.empty((n_rows, reason.shape[1]), np.uint8)
    pose = np.empty(found.shape, np.int64)
    for gate, own, row in _by_gate(camera, poses):
        if gate is None:
            found[row], pose[row] = reason[own[:, 0]], own[:, :1]
            continue
        for at, of_rig in zip(row, own, strict=True):
            front = in_front(poses.world_from_camera[of_rig, :3, 3], points, normals)
            behind = np.minimum(reason[of_rig], np.uint8(Reason.BACK_FACING))
            best, device = gate.failing(np.where(front, reason[of_rig], behind))
            other, of_other = gate.failing(np.where(front, behind, reason[of_rig]))
            found[at] = np.maximum(best, other)
            pose[at] = of_rig[np.where(other > best, of_other, device)]
    return found, pose


def worst_deviations(covered: Regions, regions: Regions, gate: Gate) -> FloatArray:
    """(2, F) largest standard deviation of what rigs cover of each face, from below and above, m.

    The first is that of some point, and the second at most 1.001 times as much, or what is certain
    of triangles of 2^-`MOST_HALVINGS` of a piece. 0 where nothing is covered. `covered` is
    `through` of `regions`, those of single cameras.
    """
    mesh, found = covered.mesh, np.zeros((2, covered.mesh.n_faces))
    if regions.columns is None:
        return found
    placed = (each.reshape(-1, gate.n, 3) for each in (regions.eyes, regions.columns))
    (cut,) = uncertainty_of(gate, *placed)._cuts(len(covered.pose_ids))
    counts = np.diff(covered.starts)
    row, face = (np.repeat(each, counts).astype(np.int64) for each in (covered.pose, covered.face))
    fan = covered.xy[np.repeat(covered.starts[:-1], counts)], covered.xy
    triangles = np.stack([*fan, covered.xy[following(covered.starts)]], axis=1)

    def deviation(value: FloatArray) -> FloatArray:
        """Value of the least eigenvalue of the criterion, g + 1 = (limit / deviation)^2."""
        return np.asarray(gate.most_deviation / np.sqrt(1 + np.maximum(value, 0.0)))

    for halving in range(MOST_HALVINGS + 1):  # a few us a triangle
        centre = triangles.mean(axis=1)
        off = triangles - centre[:, None]
        radius = np.linalg.norm(off, axis=2).max(axis=1, initial=0.0)
        value = values_of(mesh, cut, face, centre, row=row, radius=radius)
        linear = np.einsum("nki,ni->nk", off, value[:, 1:3])
        at = triangles[np.arange(len(face)), linear.argmin(axis=1)]
        np.maximum.at(found[0], face, deviation(values_of(mesh, cut, face, at, row=row)[:, 0]))
        most = deviation(value[:, 0] + linear.min(axis=1) - value[:, 3])
        is_open = most > 1.001 * found[0, face]
        ends = ~is_open if halving < MOST_HALVINGS else np.ones(len(face), np.bool_)
        np.maximum.at(found[1], face[ends], most[ends])
        row, face = (np.repeat(each[is_open], 4) for each in (row, face))
        triangles = np.einsum("qij,njk->nqik", QUARTERS, triangles[is_open]).reshape(-1, 3, 2)
    found[1] = found.max(axis=0)
    return found


def rule_lines(regions: Regions, camera: Cameras, poses: Poses) -> list[str]:
    """Limits of rigs with a rule that nothing their devices see meets: baseline, uncertainty.

    A line for each limit that no corner of a part that all devices see meets, with the best value
    and what would help; `regions` are those of each pose.
    """
    lines = []
    for gate, own, _ in _by_gate(camera, poses):
        if gate is None or not (gate.has_baseline or gate.has_deviation):
            continue
        is_own = np.zeros(len(poses), np.bool_)
        is_own[own.ravel()] = True
        free = gate._replace(least_deg=0.0, most_deg=180.0, most_deviation=0.0)
        seen = through(regions.of_poses(is_own), free)
        if not len(seen.xy):
            continue
        counts = np.diff(seen.starts)
        row, face = (np.repeat(each, counts).astype(np.int64) for each in (seen.pose, seen.face))
        points, placed = to_world(seen.mesh, face, seen.xy), poses.world_from_camera[own[row]]
        rig = names_of(camera)[poses.camera[own[0, 0]]].rpartition("/")[0] or "with a rule"
        if gate.least_deg > 0:
            least = float(smallest_cosines(placed[:, :, :3, 3], points).min())
            widest = math.degrees(math.acos(min(max(least, -1.0), 1.0)))
            if widest < gate.least_deg:
                wider = math.tan(math.radians(gate.least_deg / 2)) / math.tan(
                    math.radians(max(widest, 1e-6) / 2)
                )
                lines.append(
                    f"rig {rig}: rays to its devices differ by {widest:.3g} degrees at most, "
                    f"{gate.least_deg:g} wanted: a baseline {wider:.2g} times as wide"
                )
        if gate.has_deviation:
            best = float(deviations(gate, placed[..., :3, 3], placed[..., :3, 1], points).min())
            if best > gate.most_deviation:
                times = best / gate.most_deviation
                lines.append(
                    f"rig {rig}: uncertainty {distance(best)} at best, "
                    f"{distance(gate.most_deviation)} wanted: a baseline {times:.2g} times as "
                    f"wide, noise {1 / times:.2g} times as large, or less distance"
                )
    return lines


def is_certain(gate: Gate, placed: FloatArray, points: FloatArray) -> NDArray[np.bool_]:
    """(N,) points (N, 3) whose deviation, by cameras (n, 4, 4) of a gate, is within its limit."""
    eyes, columns = placed[:, :3, 3], placed[:, :3, 1]
    return deviations(gate, eyes, columns, points) <= gate.most_deviation


def in_front(eyes: FloatArray, points: FloatArray, normals: FloatArray) -> NDArray[np.bool_]:
    """(n, N) cameras, by their centres (n, 3), in front of the planes of points (N, 3)."""
    height = eyes @ normals.T - np.einsum("ni,ni->n", points, normals)
    return height >= 0


def _by_gate(camera: Cameras, poses: Poses) -> Iterator[tuple[Gate | None, IntArray, IntArray]]:
    """Each rule, its poses (R, n) and their rows of the result (R,); None for single cameras."""
    gates, rows = gates_of(camera), rows_of_result(camera, poses)
    leads = np.flatnonzero(np.diff(rows, prepend=-1))
    index = poses.camera[leads]
    for gate in dict.fromkeys((None, *gates.values())):
        firsts = [at for at, own in gates.items() if own == gate]
        is_own = np.isin(index, firsts) if gate else ~np.isin(index, list(gates))
        if is_own.any():
            own = leads[is_own]
            width = gate.n if gate else 1
            yield gate, own[:, None] + np.arange(width), rows[own]
