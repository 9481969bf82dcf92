"""Area that a network of cameras covers: exact, with its bound, for 1 ... k views and by group.

There are figures of each camera of a rig, and of all cameras together. A point counts for a
camera where any of its poses covers it, whatever number of views the task wants of all.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.checks import is_one_of, shown
from rastercov.base.errors import ConfigError
from rastercov.base.format import area as area_text
from rastercov.base.format import percent, plural, with_bound
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, cameras_of, gates_of, is_joint, lamps_of, names_of
from rastercov.camera.rule import Gate
from rastercov.coverage.area.frames import frames_of
from rastercov.coverage.area.light import Light
from rastercov.coverage.area.regions import check_pointwise
from rastercov.coverage.area.sensors import (
    gated,
    through,
    without_highlights,
    worst_deviations,
)
from rastercov.coverage.area.spread import SpreadUnion, check_poses
from rastercov.coverage.area.table import Regions
from rastercov.coverage.area.union import Covered, RegionUnion
from rastercov.coverage.area.zones import DeadZones, dead_zones, summary_of
from rastercov.coverage.engine import Engine
from rastercov.coverage.network import (
    OF_PARTS,
    JudgedPoses,
    Network,
    percent_of_seeable,
    share_of_faces,
)
from rastercov.coverage.reasons import CONDITIONS
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.mesh.groups import parts_of

UNITS = ("area", "face")
"""Units of a result: exact area, or whole faces as in the thesis."""


def unit_of_result(
    by: str | None,
    task: Task,
    engine: Engine,
    camera: Cameras | None = None,
    n_poses: int | None = None,
) -> tuple[str, str]:
    """Unit of a result, "area" or "face"; and the reason for "face" where it was not chosen.

    Without a choice it is "area", unless a threshold of the task is of a face or of pairs of poses,
    or the method counts samples. Rigs with a rule among the cameras, and lamps, need "area".

    Raises
    ------
    ConfigError
        For an unknown unit, or by area where that cannot be.
    """
    if by is not None and not is_one_of(by, UNITS):
        raise ConfigError(f"by must be one of {', '.join(UNITS)}, got {shown(by)}")
    is_gated = camera is not None and is_joint(camera)
    if is_gated and by == "face":
        raise ConfigError(OF_PARTS)
    if by == "face":
        return by, ""
    obstacle = ""
    try:
        if engine.method == "sampled":
            raise ConfigError("method sampled counts whole faces; by area, use certified or exact")
        check_pointwise(task)
        if task.min_angle_deg > 0:
            _check_pairs(by, is_gated, n_poses)
    except ConfigError as error:
        if by == "area" or is_gated:
            raise
        obstacle = str(error)
    return "face" if obstacle else "area", obstacle


def _check_pairs(by: str | None, is_gated: bool, n_poses: int | None) -> None:
    if is_gated:
        raise ConfigError(
            "min_angle_deg is between single cameras; of a rig with a rule, give min_baseline_deg"
        )
    if by is None:
        raise ConfigError("min_angle_deg takes all pairs of poses by area; ask for by area")
    check_poses(n_poses or 0)


class AreaNetwork:
    """Area that cameras cover together, added up batch by batch.

    Faces that enough cameras cover as a whole are closed, so that the cost of further poses falls.

    Parameters
    ----------
    mesh : Mesh
        Mesh of all regions.
    task : Task
        Its `views` is the largest number of views that is counted.

    Attributes
    ----------
    least, views : int
        Least and largest number of cameras that may be wanted: 2 and more with `min_angle_deg`.
    cut_short : float
        Sum of `Regions.cut_short`, m^2.
    """

    def __init__(self, mesh: Mesh, task: Task) -> None:
        check_pointwise(task)
        self.mesh, self.task = mesh, task
        self.least = 2 if task.min_angle_deg > 0 else 1
        self.views = max(task.views, self.least)
        self.cut_short = 0.0
        self._union: RegionUnion | SpreadUnion = RegionUnion(mesh, self.views)
        if task.min_angle_deg > 0:
            self._union = SpreadUnion(mesh, self.views, task.min_angle_deg)
        self._kept: dict[Any, Any] = {}
        """Figures computed since regions were added."""

    @property
    def closed(self) -> NDArray[np.bool_]:
        """(F,) faces that need no further regions."""
        return self._union.closed

    @property
    def covered(self) -> Covered:
        """Area of each face that the regions so far cover, and its pieces."""
        return self._once("covered", self._union.covered)

    def add(self, regions: Regions) -> None:
        """Take in the regions of further poses."""
        self._union.add(regions)
        # Rows of light that cameras share may count twice there, in the bound they do not.
        self.cut_short += min(regions.cut_short, float(regions.bound.sum()))
        self._kept.clear()

    def doubts(self) -> list[str]:
        """A line on criteria that were not decided as finely as others; often none."""
        if not self.cut_short > 0:
            return []
        line = (
            f"criteria: {area_text(self.cut_short)} of the views of all cameras undecided, as "
            "divisions of a face end"
        )
        return [f"{line}: it is in the bound; divide large faces, or relax a threshold"]

    def _once(self, key: Any, make: Callable[[], Any]) -> Any:
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]

    def summary(
        self, views: Mapping[str, int] | None = None, rows: Iterable[int] | None = None
    ) -> dict[str, Any]:
        """Covered area of all task faces, or of those of the groups of some rows, ready for JSON.

        `views` are those of groups by name, 1 for the others; those of the task unless given.
        """
        every = self.mesh.groups
        scored = [i for i in rows or range(len(every)) if not every[i].is_occluder]
        whole = self.of_faces(np.isin(self.mesh.face_group, scored))
        if views is None:
            return whole
        parts = [
            self.of_faces(self.mesh.face_group == i, views.get(every[i].name, 1)) for i in scored
        ]
        area = sum(part["m2"] for part in parts)
        percent = 100 / whole["of_m2"] if whole["of_m2"] > 0 else 0.0
        own = {every[i].name: views[every[i].name] for i in scored if every[i].name in views}
        found = whole | {"percent": percent * area, "m2": area, "views": own}
        doubtful = sum(part.get("doubtful_m2", 0.0) for part in parts)
        return {name: found[name] for name in found if name not in DOUBTFUL} | _doubtful(
            doubtful, percent
        )

    def add_to(self, summary: dict[str, Any], views: Mapping[str, int] | None = None) -> None:
        """Add `covered_area` to the summary of a `Network`, and to its scored groups and parts."""
        summary["covered_area"] = self.summary(views)
        for index, group in enumerate(summary["groups"]):
            if "covered" in group:
                wanted = None if views is None else views.get(group["name"], 1)
                members = self.mesh.face_group == index
                group["covered_area"] = self.of_faces(members, wanted)
        for part, rows in zip(summary["parts"], parts_of(self.mesh.groups).values(), strict=True):
            if "covered" in part:
                part["covered_area"] = self.summary(views, rows)
        for entry in (summary, *summary["groups"], *summary["parts"]):
            if "covered_area" in entry:
                m2 = entry["covered_area"]["m2"]
                entry["covered_of_seeable_percent"] = percent_of_seeable(m2, entry)

    def dead_zones(
        self, camera: Cameras, poses: ArrayLike | Poses, views: Mapping[str, int] | None = None
    ) -> dict[str, Any]:
        """Dead zones with their reasons, ready for JSON; see `rastercov.coverage.area.zones`.

        `camera`, one or several, and `poses`, (P, 4, 4) or `Poses`, are those of the regions;
        `views` as for `summary`. The result is kept until regions are added.
        """
        zones = self.zones(views)
        return self._once(zones, lambda: summary_of(zones, camera, self.task, poses))

    def zones(self, views: Mapping[str, int] | None = None) -> DeadZones:
        """Dead zones, kept like their summary; `views` as for `summary`."""
        names = [group.name for group in self.mesh.groups]
        wanted = [self.views if views is None else views.get(name, 1) for name in names]
        of_face = np.clip(wanted, self.least, self.views)[self.mesh.face_group]
        return self._once(tuple(wanted), lambda: dead_zones(self.covered, of_face))

    def of_faces(self, members: NDArray[np.bool_], views: int | None = None) -> dict[str, Any]:
        """Covered area of some faces, (F,) bool: by at least `views` cameras, and by 1 ... views.

        Percentages are of the area of the faces. The true area is within `bound_m2` of each, except
        for faces that a camera sees edge-on to rounding: of these up to `doubtful_m2` may be
        covered besides, where it is given.
        `views` is that of the task unless given.
        """
        views = self.views if views is None else max(views, self.least)
        covered, every = self.covered, frames_of(self.mesh).areas[members]
        total = float(every.sum())
        found, bound = covered.area[:views], float(covered.excess[members].sum())
        square_metres = [min(float(row[members].sum()), total) for row in found]
        bound = min(bound, total)
        percent = 100 / total if total > 0 else 0.0
        top, ends = found[-1][members], (covered.bound[members], covered.excess[members])
        most, surely = (np.minimum(top + each, every) for each in ends)
        doubtful = float((most - surely).sum())
        return {
            "percent": percent * square_metres[-1],
            "bound_percent": percent * bound,
            "m2": square_metres[-1],
            "bound_m2": bound,
            "of_m2": total,
            "views": views,
            "by_views": [
                {"views": number, "percent": percent * area, "m2": area}
                for number, area in enumerate(square_metres, start=1)
            ],
            **_doubtful(doubtful, percent),
        }


DOUBTFUL = ("doubtful_percent", "doubtful_m2")


def _doubtful(m2: float, percent: float) -> dict[str, float]:
    """Entries of what may be covered besides, where there is any; `percent` of a m^2."""
    return dict(zip(DOUBTFUL, (percent * m2, m2), strict=True)) if m2 > 0 else {}


def _most_off(figures: Mapping[str, Any], unit: str) -> float:
    """Largest error of a covered area, either way, "m2" or "percent"."""
    return float(figures[f"bound_{unit}"] + figures.get(f"doubtful_{unit}", 0.0))


def in_words(figures: Mapping[str, Any]) -> str:
    """Covered area with its bound, in words."""
    text = f"{with_bound(figures['percent'], figures['bound_percent'])} of the area"
    if "doubtful_percent" in figures:
        text += f", up to {percent(figures['doubtful_percent'] / 100)} more is seen edge-on"
    if isinstance(figures["views"], int) and figures["views"] > 1:
        fewer = [(each["percent"] / 100, each["views"]) for each in figures["by_views"][:-1]]
        text += f", by {plural(figures['views'], 'camera')} or more; "
        text += ", ".join(f"{percent(share)} by {views}" for share, views in fewer)
    return text


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


MOST_CAMERAS = 64
"""Cameras with figures of their own, which take 50 bytes a face and camera."""


def cameras_apart(camera: Cameras, poses: Poses) -> list[int]:
    """Indices of the cameras with figures of their own: none where there is one, or too many."""
    if len(cameras_of(camera)) == 1:
        return []
    used: list[int] = np.unique(poses.camera).tolist()
    return used if len(used) <= MOST_CAMERAS else []


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
        self, mesh: Mesh, task: Task, camera: Cameras, poses: Poses, *,
        by_area: bool, by_face: bool = True,
    ) -> None:  # fmt: skip
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
        cut = without_highlights(regions, self._camera, poses) if self._rigs else regions
        for areas, kept in zip(self._seen, self._lights, strict=True):
            areas.add(gated(replace(regions, light=kept), self._camera, poses))
        for first, (gate, without) in self._rigs.items():
            own = (camera >= first) & (camera < first + gate.n)
            if own.any():
                some = cut.of_poses(own)
                lit = () if light is None else light.rows(poses[np.flatnonzero(own)[:: gate.n]])
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
                found.append({
                    "device": None if own is None else self.names[first + device],
                    "condition": CONDITIONS[-1 - device] if device < 0 else None,
                    **(_worst_um(self.worst[first])
                       if device == UNCERTAINTY and first in self.worst else {}),
                    "sees": own and {name: own[name] for name in OF_DEVICE if name in own},
                    "missed": {
                        "percent": percent * lost, "bound_percent": percent * bound,
                        "m2": lost, "bound_m2": bound,
                    },
                })  # fmt: skip
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
