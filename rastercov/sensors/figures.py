"""Figures of rigs with a rule: what each device sees, and what is lost by it alone."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np

from rastercov.base import ByName, FloatArray, ReadByName, size_in_words, with_bound
from rastercov.base.format import coordinates
from rastercov.core.area.feature import Feature, Judge, Points, Scene
from rastercov.core.area.figures import DOUBTFUL, Alone, Areas, Figures, most_off
from rastercov.core.area.gates import through
from rastercov.core.area.table import Regions
from rastercov.core.camera import Cameras, Gate, Poses, Rig, apparent, gates_of, names_of
from rastercov.core.camera.rule import Limited, limits_of
from rastercov.core.coverage.reasons import BASELINE, CONDITIONS, UNCERTAIN
from rastercov.core.coverage.task import Task
from rastercov.sensors.ray_limits import measure_limits, worst_deviations
from rastercov.sensors.sensor_limits import limit_advice, unmet_lines

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
                leads = poses[np.flatnonzero(own)[:: gate.n]]
                cuts = [each.cut_of(leads) for each in regions.conditions]
                for device, areas in without.items():
                    rest = _rule_without(gate, device)
                    other = -1 if device is None else max(device, -1)
                    if device is None and gate.has_deviation:
                        image = through(some, gate, other, cuts)
                        areas.add(image)
                        worst, place = worst_deviations(image, some, gate)
                        before = self.worst.get(first, np.zeros_like(worst))
                        if worst[0].max(initial=0.0) > before[0].max(initial=0.0):
                            self.places[first] = place
                        self.worst[first] = np.maximum(before, worst)
                    elif rest.k:
                        areas.add(through(some, rest, other, cuts))

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
                percent = 100 / whole["of_m2"] if whole["of_m2"] > 0 else 0.0
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
                            "percent": percent * lost,
                            "bound_percent": percent * bound,
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
