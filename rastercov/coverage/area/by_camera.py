"""Figures of each camera of a network, of each device of rigs with a rule, and of light.

A point counts for a camera where any of its poses covers it, whatever number of views the task
wants of all cameras together.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.base.format import percent, with_bound
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, cameras_of, gates_of, is_joint, lamps_of, names_of
from rastercov.camera.rule import Gate
from rastercov.coverage.area.light import Light
from rastercov.coverage.area.network import DOUBTFUL, AreaNetwork
from rastercov.coverage.area.rows import gated
from rastercov.coverage.area.sensors import through, worst_deviations
from rastercov.coverage.area.table import Regions
from rastercov.coverage.judging import JudgedPoses
from rastercov.coverage.network import Network, share_of_faces
from rastercov.coverage.reasons import CONDITIONS
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh

MOST_CAMERAS = 64
"""Cameras with figures of their own, which take 50 bytes a face and camera."""


def cameras_apart(camera: Cameras, poses: Poses) -> list[int]:
    """Indices of the cameras with figures of their own: none where there is one, or too many."""
    if len(cameras_of(camera)) == 1:
        return []
    used: list[int] = np.unique(poses.camera).tolist()
    return used if len(used) <= MOST_CAMERAS else []


def _most_off(figures: Mapping[str, Any], unit: str) -> float:
    """Largest error of a covered area, either way, "m2" or "percent"."""
    return float(figures[f"bound_{unit}"] + figures.get(f"doubtful_{unit}", 0.0))


UNITS_OF = ("percent", "m2")
OF_DEVICE = ("percent", "bound_percent", "m2", "bound_m2", *DOUBTFUL)
"""Figures of what a device covers by itself."""
ANGLE, UNCERTAINTY = -1, -2
"""Conditions of a rig with a rule, among its cameras, in the order of `CONDITIONS`."""


def _rule_without(gate: Gate, device: int | None) -> Gate:
    """The rule of a rig without one of its conditions; all of it for None."""
    if device is None:
        return gate
    if device == UNCERTAINTY:
        return gate._replace(most_deviation=0.0)
    return gate._replace(least_deg=0.0, most_deg=180.0) if device == ANGLE else gate.without(device)


def _worst_um(worst: NDArray[np.float64]) -> dict[str, float]:
    low, high = (1e6 * float(each.max(initial=0.0)) for each in worst)
    return {"worst_um": low, "worst_bound_um": high - low}


class ByCamera:
    """Figures of each camera alone; of no camera where there is one, or too many.

    A point, or a face, counts for a camera where any of its poses covers it, whatever number of
    views the task wants of all cameras together.

    Parameters
    ----------
    mesh, task, camera
        As of the network of all cameras.
    poses : Poses
        All of the run.
    by_area, by_face : bool
        Whether there are figures of areas, and of faces.

    Attributes
    ----------
    worst : dict of int to (2, F) float64
        Largest standard deviation of what a rig with a limit of it covers of each face, in any
        pose, by its first camera, metres, from below and above; see `worst_deviations`.
    """

    def __init__(
        self,
        mesh: Mesh,
        task: Task,
        camera: Cameras,
        poses: Poses,
        *,
        by_area: bool,
        by_face: bool = True,
    ) -> None:
        self.names, indices = names_of(camera), cameras_apart(camera, poses)
        self._camera = camera
        if indices or is_joint(camera):
            task = replace(task, views=1, min_angle_deg=0.0)
        self._areas = {index: AreaNetwork(mesh, task) for index in indices if by_area}
        self._networks = {index: Network(mesh, task) for index in indices if by_face}
        self._rigs: dict[int, tuple[Gate, dict[int | None, AreaNetwork]]] = {}
        self.worst: dict[int, NDArray[np.float64]] = {}
        is_used = set(indices)
        for first, gate in gates_of(camera).items() if by_area else ():
            if first in is_used:
                asked = {ANGLE: gate.has_baseline, UNCERTAINTY: gate.has_deviation}
                names = (
                    None,
                    *range(gate.n),
                    *(each for each, is_asked in asked.items() if is_asked),
                )
                self._rigs[first] = gate, {each: AreaNetwork(mesh, task) for each in names}
        self._lights: list[Light | None] = []
        # What the cameras see, what of it is lit, and what has as much light as the task asks.
        n = 2 + task.asks_for_light if by_area and lamps_of(camera) is not None else 0
        self._seen = [AreaNetwork(mesh, task) for _ in range(n)]

    @property
    def is_asked(self) -> bool:
        """True where there are figures of faces by camera."""
        return bool(self._networks)

    def closed(self, closed: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Those of some faces, (F,) bool, that no camera needs regions of any more.

        None where the largest deviation in any pose is asked for.
        """
        if any(gate.has_deviation for gate, _ in self._rigs.values()):
            return np.zeros_like(closed)
        further = (areas for _, own in self._rigs.values() for areas in own.values())
        for areas in (*self._areas.values(), *further, *self._seen):
            closed = closed & areas.closed
        return closed

    def add(self, regions: Regions, poses: Poses) -> None:
        """Take in the regions of further poses."""
        camera = poses.camera
        for index, areas in self._areas.items():
            if (own := camera == index).any():
                areas.add(regions.of_poses(own))
        light: Light | None = regions.light
        if light is not None and not self._lights:
            self._lights = [None, light.alone(), light][: len(self._seen)]
        cut = regions
        if self._rigs and light is not None:
            cut = light.without_highlights(regions, self._camera, poses)
        for areas, kept in zip(self._seen, self._lights, strict=True):
            areas.add(gated(replace(regions, light=kept), self._camera, poses))
        for first, (gate, without) in self._rigs.items():
            own = (camera >= first) & (camera < first + gate.n)
            if own.any():
                some = cut.of_poses(own)
                leads = poses[np.flatnonzero(own)[:: gate.n]]
                lit = None if light is None else light.cut_of(leads)
                for device, areas in without.items():
                    rest = _rule_without(gate, device)
                    other = -1 if device is None else max(device, -1)
                    if device is None and gate.has_deviation:
                        found = through(some, gate, other, lit)
                        areas.add(found)
                        worst = worst_deviations(found, some, gate)
                        self.worst[first] = np.maximum(self.worst.get(first, 0.0), worst)
                    elif rest.k:
                        areas.add(through(some, rest, other, lit))

    def add_batch(self, batch: JudgedPoses) -> None:
        """Take in a batch of poses, and their regions where the result is by area."""
        for index, network in self._networks.items():
            network.add(batch, index)
        if batch.regions is not None:
            self.add(batch.regions, batch.poses)

    @property
    def uncertainty_um(self) -> NDArray[np.float64] | None:
        """(2, F) largest standard deviation of what rigs cover of each face, and its bound, um.

        The true one is at most the bound above it. 0 where nothing is covered; None without a rig
        that has a limit of it.
        """
        if not self.worst:
            return None
        low, high = 1e6 * np.max(list(self.worst.values()), axis=0)
        return np.array([low, high - low])

    def summary(self) -> list[dict[str, Any]]:
        """Figures of each camera, ready for JSON."""
        found = []
        for index, network in self._networks.items():
            mesh, task = network.mesh, network.mesh.task_mask
            covered = share_of_faces(mesh, network.covered & task, task)
            entry = {"camera": self.names[index], "poses": len(network.pose_ids)}
            found.append(entry | {"covered": covered} | self.entry(index))
        return found

    def by_device(self) -> list[dict[str, Any]]:
        """Figures of each device of rigs with a rule, ready for JSON; none of other cameras.

        `sees` is what it covers by itself. `missed` is what the rig would cover besides, did this
        device cover everything: what is lost by it alone, by its shadow, and out of its image or
        its thresholds. Those without a name are the angle between their rays, and the uncertainty,
        with `worst_um`, the largest of what is covered, and by how much it may be larger.
        """
        found = []
        for first, (gate, without) in self._rigs.items():
            whole = without[None].summary()
            for device, areas in without.items():
                if device is None:
                    continue
                others = areas.summary()
                if not _rule_without(gate, device).k:
                    others |= {"m2": whole["of_m2"], "bound_m2": 0.0}
                lost = max(others["m2"] - whole["m2"], 0.0)
                bound = _most_off(whole, "m2") + _most_off(others, "m2")
                percent = 100 / whole["of_m2"] if whole["of_m2"] > 0 else 0.0
                own = None if device < 0 else self._areas[first + device].summary()
                found.append(
                    {
                        "device": None if own is None else self.names[first + device],
                        "condition": CONDITIONS[-1 - device] if device < 0 else None,
                        **(
                            _worst_um(self.worst[first])
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
        return found

    def of_light(self) -> dict[str, Any]:
        """Entry `light` of what cameras see and cannot use for its light; nothing without lamps.

        `unlit` is what no lamp reaches, `out_of_limits` what is lit, and too dark, too bright or in
        a highlight, where the task asks. `lit_percent` is the share of the task area that a lamp
        reaches, None of one on a rig.
        """
        if not self._lights or (light := self._lights[1]) is None:
            return {}
        seen = [areas.summary() for areas in self._seen]
        lost = [
            {name: max(more[name] - less[name], 0.0) for name in ("percent", "m2")}
            | {f"bound_{unit}": _most_off(more, unit) + _most_off(less, unit) for unit in UNITS_OF}
            for more, less in pairwise(seen)
        ]
        shares = [
            {"lamp": name, "lit_percent": None if math.isnan(share) else 100 * share}
            for name, share in zip(light.lamps.names, light.shares(), strict=True)
        ]
        named = dict(zip(("unlit", "out_of_limits"), lost, strict=False))
        found: dict[str, Any] = named | {"lamps": shares}
        if light.lamps.exposure is not None:
            found["exposure"] = light.lamps.exposure.in_words(light.lamps.unit)
        return {"light": found}

    def entry(self, index: int) -> dict[str, Any]:
        """Entry `covered_area` of a camera, ready for JSON; none where it has no areas."""
        return {"covered_area": self._areas[index].summary()} if index in self._areas else {}


def missed_lines(summary: Mapping[str, Any]) -> list[str]:
    """Lines on what is lost by one camera of a rig with a rule alone, and unlit; often none."""
    lines = [
        f"missed by {entry['device'] or entry['condition']} alone: {size} of the area"
        for entry in summary.get("by_device", ())
        for size in [with_bound(entry["missed"]["percent"], entry["missed"]["bound_percent"])]
    ]
    if "light" in summary:
        light = summary["light"]
        lines += [light["exposure"]] if "exposure" in light else []
        fixed = [lamp for lamp in light["lamps"] if lamp["lit_percent"] is not None]
        shares = [f"{percent(lamp['lit_percent'] / 100)} by {lamp['lamp']}" for lamp in fixed]
        for name, words in OF_LIGHT.items():
            if name in light:
                lost = with_bound(light[name]["percent"], light[name]["bound_percent"])
                by_lamp = f"; lit, seen or not: {', '.join(shares)}" if shares else ""
                lines.append(
                    f"seen, and {words}: {lost} of the area" + (by_lamp if name == "unlit" else "")
                )
    return lines


OF_LIGHT = {"unlit": "unlit", "out_of_limits": "too dark, too bright or in a highlight"}
"""Words for what the cameras see and cannot use for its light."""


def light_doubts(summary: Mapping[str, Any]) -> list[str]:
    """Lines on lamps that light nothing."""
    return [
        f"lamp {lamp['lamp']} lights no part of the task; it may be inside a wall or look away"
        for lamp in summary.get("light", {}).get("lamps", ())
        if lamp["lit_percent"] == 0
    ]
