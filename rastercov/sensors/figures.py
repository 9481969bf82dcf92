"""Figures of rigs with a rule: what each device sees, and what is lost by it alone.

Remedies where the devices of a rig see a point, and a limit of its rule is missed there.

Each remedy is carried out before it is named: the devices are moved, and the points are judged
again by all criteria.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import chain, islice, pairwise

import numpy as np

from rastercov.base import (
    ByName,
    FloatArray,
    IntArray,
    ReadByName,
    frozen_record,
    norm,
    size_in_words,
    sort_order,
    with_bound,
)
from rastercov.base.format import coordinates, number, percent_of
from rastercov.core.area.feature import (
    DOUBTFUL,
    NEEDS,
    Alone,
    Areas,
    Feature,
    Figures,
    Judge,
    Points,
    Scene,
    most_off,
)
from rastercov.core.area.polygons import even_points, polygon_areas, to_world
from rastercov.core.area.rows import through
from rastercov.core.area.table import Regions
from rastercov.core.camera import (
    Cameras,
    Gate,
    Poses,
    Rig,
    apparent,
    by_gate,
    cameras_of,
    gates_of,
    led_by,
    movers,
    names_of,
)
from rastercov.core.camera.rig import are_central
from rastercov.core.camera.rule import Limited, limits_of
from rastercov.core.coverage.task import BASELINE, CONDITIONS, UNCERTAIN, Reason, Task, tasks_of
from rastercov.core.mesh.arrays import cross_matrix
from rastercov.sensors.ray_limits import measure_limits, within_limits, worst_deviations

WIDER = (
    1.1,
    1.2,
    1.3,
    1.4,
    1.5,
    1.6,
    1.7,
    1.8,
    1.9,
    2.0,
    2.2,
    2.5,
    2.8,
    3.2,
    3.6,
    4.0,
    5.0,
    7.0,
    10.0,
    14.0,
    20.0,
)
"""Baselines that are tried, in that of the rig."""
NEARER = (0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.15, 0.1)
"""Distances that are tried, in that of the rig."""
ENOUGH = 0.5
"""Share of the points that a remedy covers, or more."""
MOST_ROWS = 3
"""Places of a rig that are tried."""
MOST_POINTS = 64
"""Points of the best place on which remedies are tried where nothing meets a limit, and of each
triangle at which its best value is looked for."""


def unmet_lines(judge: Judge, regions: Regions, scene: Scene, poses: Poses) -> list[str]:
    """Lines on limits of rigs with a rule that nothing their devices see meets.

    With the best value, and what would cover half of what they see at the best place. `regions` are
    those of each pose.
    """
    lines: list[str] = []
    camera = scene[1]
    for gate, own, _ in by_gate(camera, poses) if are_central(camera) else ():
        if not isinstance(gate, Limited) or not (gate.has_baseline or gate.has_deviation):
            continue
        is_own = np.zeros(len(poses), bool)
        is_own[own.ravel()] = True
        seen = through(regions.of_poses(is_own), Gate(gate.n, gate.k, gate.needs))
        counts = np.diff(seen.starts)
        row, face = (np.repeat(each, counts).astype(np.int64) for each in (seen.pose, seen.face))
        points = to_world(seen.mesh, face, seen.xy)
        angle, _, lack = _lacks(gate, poses.world_from_camera[own][row], points)
        if not len(lack) or (lack <= 1).any():
            continue
        best = int(lack.argmin())
        placed = poses[own[row[best]]]
        is_narrow = angle[best] < gate.least_deg or angle[best] > gate.most_deg
        why = BASELINE if is_narrow else UNCERTAIN
        middle = np.add.reduceat(points, seen.starts[:-1]) / counts[:, None]
        areas = polygon_areas(seen.xy, seen.starts)
        pieces = np.flatnonzero(seen.pose == row[best])
        pieces = pieces[sort_order(-areas[pieces])[:MOST_POINTS]]
        at = np.concatenate([points[row == row[best]], _inside(seen, pieces)])
        _, words = _missed_limit(gate, placed.world_from_camera, at, why)
        head = _Head(judge, scene, gate, placed, middle[pieces], seen.face[pieces].astype(np.int64))
        remedies = list(head.remedies(-(-len(pieces) // 2), of_limit=True))
        rig = names_of(camera)[poses.camera[own[0, 0]]].rpartition("/")[0] or "with a rule"
        needs = f": half of the area in view needs {'; or '.join(remedies)}" if remedies else ""
        if remedies and not any("baseline" in each for each in remedies):
            most = _metres(WIDER[-1] * _baseline(placed.world_from_camera))
            needs += f"; no baseline up to {most} is enough"
        lines.append(f"rig {rig}: {words}{needs}")
    return lines


def _inside(seen: Regions, pieces: IntArray) -> FloatArray:
    """Points of some pieces, evenly over each of the triangles that they are fans of."""
    counts = np.diff(seen.starts)[pieces] - 2
    number = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    first = np.repeat(seen.starts[pieces], counts)
    a, b, c = (seen.xy[at][:, None] for at in (first, first + number + 1, first + number + 2))
    x, y = (each[:, None] for each in even_points(MOST_POINTS))
    at = (a + x * (b - a) + y * (c - a)).reshape(-1, 2)
    face = np.repeat(seen.face[pieces].astype(np.int64), counts)
    return to_world(seen.mesh, np.repeat(face, MOST_POINTS), at)


def limit_advice(
    judge: Judge, scene: Scene, poses: Poses, on: Points, *, is_tried: bool = True
) -> str:
    """Factors by which limits are missed at points, and what makes a rig cover some share of them.

    Parameters
    ----------
    judge : callable
        `failures_of_rows`.
    scene
        Mesh, devices and thresholds.
    poses : Poses
        Of all devices of rigs with a rule, as of a result; the best rows of it are tried.
    on
        Points of faces that no row covers.
    is_tried : bool
        False for the factors alone.

    Returns
    -------
    str
        "" where no limit is missed at points that the devices see.
    """
    camera, (points, face) = scene[1], on
    values: list[tuple[float, str, _Head]] = []
    if not are_central(camera):
        return ""
    leads = led_by(camera, poses).tolist()
    for first, last in pairwise([*leads, len(poses)]):
        own = poses[first:last]
        gate = gates_of(camera).get(int(own.camera[0]))
        if not isinstance(gate, Limited) or not (gate.has_baseline or gate.has_deviation):
            continue
        head = _Head(judge, scene, gate, own, points, face)
        reason = head.reason(own.world_from_camera)
        for why in (UNCERTAIN, BASELINE):
            if (at := np.flatnonzero(reason == why)).size:
                values.append((*_missed_limit(gate, own.world_from_camera, points[at], why), head))
    said = list[str]()
    for _, words, head in sorted(values, key=lambda each: each[0])[:MOST_ROWS]:
        if not is_tried:
            return words
        if remedies := list(head.remedies(max(1, math.ceil(ENOUGH * len(points))))):
            return f"{words}{NEEDS}{'; or '.join(remedies)}"
        said.append(words)
    return said[0] if said else ""


@frozen_record
class _Head:
    """A rig with a rule in one pose, and points that it does not cover."""

    judge: Judge
    scene: Scene
    gate: Limited
    poses: Poses
    points: FloatArray
    face: IntArray

    def reason(self, placed: FloatArray) -> IntArray:
        """(N,) reason of the points with the devices in other poses (n, 4, 4)."""
        own = Poses.of(placed, camera=self.poses.camera)
        ((_, reason, _),) = self.judge(*self.scene, own, self.points, self.face)
        return reason.astype(np.int64)

    def covers(self, placed: FloatArray, least: int) -> bool:
        """True where at least some number of the points are covered from other poses."""
        return int(np.count_nonzero(self.reason(placed) == Reason.COVERED)) >= least

    def _meets(self, placed: FloatArray, least: int) -> bool:
        """True where at least some number of the points meet the limits from other poses."""
        return int(np.count_nonzero(_lacks(self.gate, placed, self.points)[2] <= 1)) >= least

    def _focus_starts(self) -> float:
        """Distance from which on all devices are in focus, metres."""
        cameras, tasks = cameras_of(self.scene[1]), tasks_of(*self.scene[1:])
        own = set(self.poses.camera.tolist())
        return max(cameras[row].depth_of_field(tasks[row].max_blur)[0] for row in own)

    def remedies(self, least: int, *, of_limit: bool = False) -> Iterator[str]:
        """The least change of each kind that covers some number of the points.

        With `of_limit` that with which these meet the limit, whatever else fails, where none covers
        them.
        """
        placed, off = self.poses.world_from_camera, self.points - self.points.mean(axis=0)
        target = self.points[norm(off).argmin()]
        away = float(norm(target - placed[:, :3, 3].mean(axis=0)))
        base = _baseline(placed)
        wider = [
            (
                f"a baseline of {_metres(factor * base)} instead of {_metres(base)}{words}",
                _wider(placed, factor, at),
            )
            for factor in WIDER
            for words, at in (("", None), (", its sensors aimed at it", target))
        ]
        nearer = [
            (
                f"a distance of {_metres(factor * away)} instead of {_metres(away)}",
                _nearer(placed, factor, target),
            )
            for factor in NEARER
            if factor * away >= self._focus_starts()
        ]
        for kind in (wider, nearer):
            within = [each for each in kind if self._meets(each[1], least)]
            covers = (words for words, moved in within if self.covers(moved, least))
            alone = (f"{words} (for this limit alone)" for words, _ in within if of_limit)
            yield from islice(chain(covers, alone), 1)
        is_sharp = self.reason(placed) == UNCERTAIN
        values = np.sort(_lacks(self.gate, placed, self.points[is_sharp])[2])
        if len(values) >= least and 0 < values[least - 1] < np.inf:
            yield f"noise {_below(1 / values[least - 1])} times as large"


def _lacks(gate: Limited, placed: FloatArray, points: FloatArray) -> tuple[FloatArray, ...]:
    """(N,) largest angle of rays in degrees, deviation, and factor by which limits are missed.

    At points (N, 3), by devices (n, 4, 4) or (N, n, 4, 4); up to 1 where they are met.
    """
    angle, deviation = measure_limits(gate, placed, points)
    lack = np.maximum(gate.least_deg / np.maximum(angle, 1e-9), angle / max(gate.most_deg, 1e-9))
    if gate.has_deviation:
        lack = np.maximum(lack, deviation / gate.most_deviation)
    return angle, deviation, lack


def _missed_limit(
    gate: Limited, placed: FloatArray, points: FloatArray, why: int
) -> tuple[float, str]:
    """Factor by which a limit is missed at the best of some points, and words on it."""
    angle, deviation, lack = _lacks(gate, placed, points)
    if why == UNCERTAIN:
        best, limit = _metres(float(deviation.min())), _metres(gate.most_deviation)
        best = f"just above {best}" if best == limit else best
        best += f" at the best point (median {_metres(float(np.median(deviation)))})"
        return float(lack.min()), f"uncertainty {best}, {limit} required"
    is_less = angle.max() < gate.least_deg
    degrees = (
        f"at most {angle.max():.3g} degrees" if is_less else f"at least {angle.min():.3g} degrees"
    )
    limit = f"{gate.least_deg:g} required" if is_less else f"{gate.most_deg:g} allowed"
    return float(lack.min()), f"rays to its sensors are {degrees} apart, {limit}"


def _baseline(placed: FloatArray) -> float:
    """Largest distance between devices (n, 4, 4)."""
    eyes = placed[:, :3, 3]
    return float(norm(eyes[:, None] - eyes).max())


def _metres(value: float) -> str:
    return size_in_words(value) if math.isfinite(value) else "inf m"


def _below(value: float) -> str:
    """A factor in two digits that is not above the value."""
    digits = 1 - math.floor(math.log10(value))
    return number(math.floor(value * 10**digits) / 10**digits)


def _wider(placed: FloatArray, factor: float, target: FloatArray | None = None) -> FloatArray:
    """Devices (n, 4, 4) apart by a factor, and turned as their rays to a target if there is one."""
    wider, eyes = placed.copy(), placed[:, :3, 3]
    wider[:, :3, 3] = eyes.mean(axis=0) + factor * (eyes - eyes.mean(axis=0))
    if target is not None:
        for row, (before, after) in enumerate(
            zip(target - eyes, target - wider[:, :3, 3], strict=True)
        ):
            wider[row, :3, :3] = _turn(before, after) @ placed[row, :3, :3]
    return wider


def _nearer(placed: FloatArray, factor: float, target: FloatArray) -> FloatArray:
    """Devices (n, 4, 4) moved together towards a target, to a share of their distance."""
    nearer = placed.copy()
    nearer[:, :3, 3] += (1 - factor) * (target - placed[:, :3, 3].mean(axis=0))
    return nearer


def _turn(before: FloatArray, after: FloatArray) -> FloatArray:
    """(3, 3) least rotation of one direction to another."""
    a, b = (each / max(float(norm(each)), 1e-300) for each in (before, after))
    axis, cosine = np.cross(a, b), float(a @ b)
    cross = cross_matrix(axis)
    return np.eye(3) + cross + cross @ cross / max(1 + cosine, 1e-12)


OF_DEVICE = ("percent", "bound_percent", "m2", "bound_m2", *DOUBTFUL)
"""Figures of what a device covers by itself."""
ANGLE, UNCERTAINTY = -1, -2
"""Conditions of a rig with a rule, among its cameras, in the order of `CONDITIONS`."""


def _rule_without(gate: Limited, device: int | None) -> Gate:
    """The rule of a rig without one of its conditions; all of it for None."""
    if device is None:
        return gate
    if device == UNCERTAINTY:
        return replace(gate, most_deviation=0.0)
    if device == ANGLE:
        return replace(gate, least_deg=0.0, most_deg=180.0)
    return gate.without(device)


def _worst_um(worst: FloatArray, place: FloatArray | None) -> ByName:
    low, high = (1e6 * float(each.max(initial=0.0)) for each in worst)
    at = None if place is None else place.tolist()
    return {"worst_um": low, "worst_bound_um": high - low, "worst_at": at}


class RigFigures(Figures):
    """Figures of each device of rigs with a rule.

    Attributes
    ----------
    worst : dict of int to (2, F) float64
        Largest standard deviation of what a rig with a limit of it covers of each face, in any
        pose, by its first camera, metres, from below and above; see `worst_deviations`.
    places : dict of int to (3,) float64 or None
        Point of the largest of them.
    """

    def __init__(
        self, new: Callable[[], Areas], camera: Cameras, task: Task, used: Iterable[int]
    ) -> None:
        self._rigs: dict[int, tuple[Limited, dict[int | None, Areas]]] = {}
        self._names, is_used = names_of(camera), set(used)
        self.worst: dict[int, FloatArray] = {}
        self.places: dict[int, FloatArray | None] = {}
        for first, gate in gates_of(camera).items():
            if first in is_used and isinstance(gate, Limited):
                asked = {ANGLE: gate.has_baseline, UNCERTAINTY: gate.has_deviation}
                names = (
                    None,
                    *range(gate.n),
                    *(each for each, is_asked in asked.items() if is_asked),
                )
                self._rigs[first] = gate, {each: new() for each in names}

    @property
    def needs_all(self) -> bool:
        """See `Figures`: the largest deviation is that in any pose."""
        return any(gate.has_deviation for gate, _ in self._rigs.values())

    def networks(self) -> Iterable[Areas]:
        """See `Figures`."""
        return (areas for _, own in self._rigs.values() for areas in own.values())

    def add(self, regions: Regions, camera: Cameras, poses: Poses) -> None:
        """See `Figures`."""
        for each in regions.conditions if self._rigs else ():
            regions = each.of_cameras(regions, camera, poses)
        for first, (gate, without) in self._rigs.items():
            own = (poses.camera >= first) & (poses.camera < first + gate.n)
            if own.any():
                some = regions.of_poses(own)
                leads = movers(camera, poses[own])[:: gate.n]
                cuts = [each.cut_of(leads) for each in regions.conditions]
                for device, areas in without.items():
                    rest = _rule_without(gate, device)
                    other = -1 if device is None else max(device, -1)
                    if not rest.k:
                        continue
                    image = through(some, rest, other, cuts)
                    areas.add(image)
                    if device is None and gate.has_deviation:
                        worst, place = worst_deviations(image, some, gate)
                        before = self.worst.get(first, np.zeros_like(worst))
                        if worst[0].max(initial=0.0) > before[0].max(initial=0.0):
                            self.places[first] = place
                        self.worst[first] = np.maximum(before, worst)

    def of_faces(self) -> dict[str, FloatArray]:
        """See `Figures`: the largest standard deviation of what rigs with a limit of it cover."""
        if not self.worst:
            return {}
        low, high = 1e6 * np.max(list(self.worst.values()), axis=0)
        return {"uncertainty_um": np.array([low, high - low])}

    def summary(self, alone: Alone) -> ByName:
        """Entry `by_device`, figures of each device.

        `sees` is what it covers by itself. `missed` is what the rig would cover besides, did this
        device cover everything: what is lost by it alone, by its shadow, and out of its image or
        its thresholds. Those without a name are the angle between their rays, and the uncertainty,
        with `worst_um`, the largest of what is covered, its point, and how much it may be larger.
        """
        items = []
        for first, (gate, without) in self._rigs.items():
            whole = without[None].summary()
            for device, areas in without.items():
                if device is None:
                    continue
                others = areas.summary()
                if not _rule_without(gate, device).k:
                    others |= {"m2": whole["of_m2"], "bound_m2": 0.0}
                lost = max(others["m2"] - whole["m2"], 0.0)
                bound = most_off(whole, "m2") + most_off(others, "m2")
                own = None if device < 0 else alone(first + device)
                items.append(
                    {
                        "device": None if own is None else self._names[first + device],
                        "condition": [*CONDITIONS][-1 - device] if device < 0 else None,
                        **(
                            _worst_um(self.worst[first], self.places.get(first))
                            if device == UNCERTAINTY and first in self.worst
                            else {}
                        ),
                        "sees": own and {name: own[name] for name in OF_DEVICE if name in own},
                        "missed": {
                            "percent": percent_of(lost, whole["of_m2"]),
                            "bound_percent": percent_of(bound, whole["of_m2"]),
                            "m2": lost,
                            "bound_m2": bound,
                        },
                    }
                )
        return {"by_device": items} if items else {}

    @staticmethod
    def lines(summary: ReadByName) -> list[str]:
        """See `Figures`."""
        lines = []
        for entry in summary.get("by_device", ()):
            size = with_bound(entry["missed"]["percent"], entry["missed"]["bound_percent"])
            why = f"by {entry['device']}" if entry["device"] else f"because of {entry['condition']}"
            lines.append(f"missed only {why}: {size} of the area")
            if (at := entry.get("worst_at")) is not None:
                place = coordinates(at, 4)
                worst = size_in_words(1e-6 * entry["worst_um"])
                lines.append(f"largest uncertainty of what is covered: {worst} at ({place}) m")
        return lines


class OfRules(Feature):
    """Rules of rigs, see `rastercov.core.camera.rule`."""

    figures = RigFigures

    def stages(self, camera: Cameras, task: Task) -> Iterator[tuple[int, Cameras, Task]]:
        """See `Feature`."""
        gates = limits_of(gates_of(camera).values())
        if isinstance(camera, Rig) and any(gate.has_deviation for gate in gates):
            yield UNCERTAIN, _without_limits(camera, most_deviation=0.0), task
        if isinstance(camera, Rig) and any(gate.has_baseline for gate in gates):
            yield BASELINE, _without_limits(camera, least_deg=0.0, most_deg=180.0), task

    def cut_rigs(self, regions: Regions, gate: Gate, devices: Regions) -> Regions:
        """See `Feature`."""
        return within_limits(regions, gate, devices)

    def unmet(self, judge: Judge, regions: Regions, scene: Scene, poses: Poses) -> list[str]:
        """See `Feature`."""
        return unmet_lines(judge, regions, scene, poses)

    def advice(
        self, judge: Judge, scene: Scene, poses: Poses, on: Points, *, is_tried: bool
    ) -> str:
        """See `Feature`."""
        return limit_advice(judge, scene, poses, on, is_tried=is_tried)

    def deviations(self, camera: Cameras, own: Poses, points: FloatArray) -> FloatArray | None:
        """See `Feature`."""
        gate = gates_of(camera).get(int(own.camera[0]))
        if not isinstance(gate, Limited) or not gate.has_deviation:
            return None
        return measure_limits(gate, apparent(camera, own), points)[1]


def _without_limits(rig: Rig, **limits: float) -> Rig:
    """The rig with other limits of its rules."""
    gates = {at: replace(gate, **limits) for at, gate in rig.gates.items()}  # type: ignore[arg-type] # fields of its gate
    return rig._with(gates=gates)


HOOKS = OfRules()
