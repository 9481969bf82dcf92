"""Figures of what is lost for the light of lamps."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import pairwise

import numpy as np

from rastercov.base import ByName, ReadByName, percent, with_bound
from rastercov.base.format import number
from rastercov.core.area.figures import Alone, Areas, Figures, most_off
from rastercov.core.area.rows import with_rule
from rastercov.core.area.table import Regions
from rastercov.core.camera import Cameras, Poses, led_by, names_of
from rastercov.core.coverage.task import Task
from rastercov.light.lamp_rig import lamps_of
from rastercov.light.lamp_words import quantity
from rastercov.light.regions import RANGE, Light, asks_for_light

UNITS_OF = ("percent", "m2")
OF_LIGHT = {"unlit": "unlit", "out_of_limits": "badly lit"}
"""Words for what the cameras see and cannot use for its light."""


class LightFigures(Figures):
    """Figures of what cameras see, what of it is lit, and what has as much light as is asked."""

    def __init__(
        self, new: Callable[[], Areas], camera: Cameras, task: Task, used: Iterable[int]
    ) -> None:
        self._lights: list[Light] = []
        lamps = lamps_of(camera)
        n = 0 if lamps is None else 2 + asks_for_light(task)
        self._seen = [new() for _ in range(n)]
        self._carried: dict[str, Areas] = {}
        if lamps is not None:
            rides = lamps.carried_by(names_of(camera)).any(axis=1)
            self._carried = {lamps.names[row]: new() for row in np.flatnonzero(rides)}

    def networks(self) -> Iterable[Areas]:
        """See `Figures`."""
        return *self._seen, *self._carried.values()

    def add(self, regions: Regions, camera: Cameras, poses: Poses) -> None:
        """See `Figures`."""
        light = next((each for each in regions.conditions if isinstance(each, Light)), None)
        if light is None or not self._seen:
            return
        self._lights = self._lights or [light.alone(), light][: len(self._seen) - 1]
        rest = tuple(each for each in regions.conditions if each is not light)
        kept = [rest, *((*rest, each) for each in self._lights)]
        for areas, conditions in zip(self._seen, kept, strict=True):
            areas.add(with_rule(replace(regions, conditions=conditions), camera, poses))
        for name, own in self._lights[0].carry(poses[led_by(camera, poses)]):
            self._carried[name].add(own)

    def summary(self, alone: Alone) -> ByName:
        """Entry `light` of what cameras see and cannot use for its light.

        `unlit` is what no lamp reaches, `out_of_limits` what is lit, and too dark, too bright or in
        a highlight, where the task asks: both of what cameras see. `lit_percent` is the share of
        the whole evaluated area, seen or not, that a lamp reaches, of one on a rig from any of its
        poses. `illuminance` is that by the fixed lamps, at points at equal steps of the area.
        """
        if not self._lights:
            return {}
        light = self._lights[0]
        seen = [areas.summary() for areas in self._seen]
        lost = [
            {name: max(more[name] - less[name], 0.0) for name in ("percent", "m2")}
            | {f"bound_{unit}": most_off(more, unit) + most_off(less, unit) for unit in UNITS_OF}
            for more, less in pairwise(seen)
        ]
        carried = {name: areas.summary() for name, areas in self._carried.items()}
        shares = 100 * light.shares()
        for row, name in enumerate(light.lamps.names):
            if own := carried.get(name):
                shares[row] = own["by_views"][0]["percent"], most_off(own, "percent")
        lamps = [
            {"lamp": name, "lit_percent": lit, "bound_percent": bound}
            for name, (lit, bound) in zip(light.lamps.names, shares.tolist(), strict=True)
        ]
        named = dict(zip(("unlit", "out_of_limits"), lost, strict=False))
        figures: ByName = named | {"lamps": lamps}
        if (lux := light.sample()) is not None:
            low, middle, high = np.quantile(lux, (0, 0.5, 1)).tolist()
            own = {"least": low, "median": middle, "most": high, "unit": light.lamps.unit}
            figures["illuminance"] = own
        if light.lamps.has_range:
            figures["range"] = RANGE
        if light.lamps.exposure is not None:
            figures["exposure"] = light.lamps.exposure.in_words(light.lamps.unit)
        return {"light": figures}

    @staticmethod
    def lines(summary: ReadByName) -> list[str]:
        """See `Figures`."""
        if "light" not in summary:
            return []
        light = summary["light"]
        lines = [light[name] for name in ("range", "exposure") if name in light]
        if "illuminance" in light:
            lux = light["illuminance"]
            low, middle, high = (number(lux[name]) for name in ("least", "median", "most"))
            lines.append(
                f"{quantity(lux['unit'])} by fixed lamps and any ambient light: {low} to "
                f"{high} {lux['unit']}, median {middle}"
            )
        shares = [
            f"{percent(lamp['lit_percent'] / 100)} by {lamp['lamp']}" for lamp in light["lamps"]
        ]
        for name, words in OF_LIGHT.items():
            if name in light:
                lost = with_bound(light[name]["percent"], light[name]["bound_percent"])
                by_lamp = f"; lit (visible or not): {', '.join(shares)}" if shares else ""
                lines.append(
                    f"visible but {words}: {lost} of the area"
                    + (by_lamp if name == "unlit" else "")
                )
        return lines

    @staticmethod
    def doubts(summary: ReadByName) -> list[str]:
        """See `Figures`: lamps that light nothing."""
        return [
            f"lamp {lamp['lamp']} lights no evaluated surface; it may be inside a wall or face away"
            for lamp in summary.get("light", {}).get("lamps", ())
            if lamp["lit_percent"] == 0
        ]
