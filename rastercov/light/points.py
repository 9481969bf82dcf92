"""Light of lamps at points of faces: the reason why each is not lit as a task asks; the feature.

Figures of what is lost for the light of lamps.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from rastercov.base import (
    TINY,
    BoolArray,
    ByName,
    ByteArray,
    ConfigError,
    FloatArray,
    ReadByName,
    WholeArray,
    dots,
    norm,
    percent,
    with_bound,
)
from rastercov.base.format import number
from rastercov.core.area.feature import Alone, Areas, Feature, Figures, Scene, most_off
from rastercov.core.area.point_pass import PointPass
from rastercov.core.area.polygons import frames_of, in_front
from rastercov.core.area.rows import with_rule
from rastercov.core.area.table import Finder, Regions
from rastercov.core.camera import Camera, Cameras, Poses, Rig, eyes_of, led_by, movers, names_of
from rastercov.core.coverage.task import Reason, Task, tasks_of
from rastercov.core.mesh import Mesh
from rastercov.light.lamp_file import lamps_on
from rastercov.light.lamp_words import quantity
from rastercov.light.lamps import Lamps, are_lit, illuminances, points_of
from rastercov.light.regions import (
    HIGHLIGHT,
    OF_LIGHT,
    RANGE,
    TOO_BRIGHT,
    TOO_DARK,
    UNLIT,
    Light,
    asks_for_light,
    brighter_side,
    carried_on,
    failing_lamp,
    known_light,
    narrow_to_lamps,
)

UNITS_OF = ("percent", "m2")
WORDS_OF_LIGHT = {"unlit": "unlit", "out_of_limits": "badly lit"}
"""Words for what the cameras see and cannot use for its light."""


class LightFigures(Figures):
    """Figures of what cameras see, what of it is lit, and what has as much light as is asked."""

    def __init__(
        self, new: Callable[[], Areas], camera: Cameras, task: Task, used: Iterable[int]
    ) -> None:
        self._lights: list[Light] = []
        lamps = lamps_on(camera)
        n = 0 if lamps is None else 2 + asks_for_light(task)
        self._seen = [new() for _ in range(n)]
        self._carried: dict[str, Areas] = {}
        if lamps is not None:
            own = zip(lamps.names, lamps.rides, strict=True)
            self._carried = {name: new() for name, rides in own if rides}

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
        for name, own in self._lights[0].carry(movers(camera, poses)[led_by(camera, poses)]):
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
        figures: ByName = dict(zip(WORDS_OF_LIGHT, lost, strict=False)) | {"lamps": lamps}
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
                f"{quantity(lux['unit'])} by fixed lamps and any ambient light, at 1024 points: "
                f"{low} to {high} {lux['unit']}, median {middle}"
            )
        shares = [
            f"{percent(lamp['lit_percent'] / 100)} by {lamp['lamp']}" for lamp in light["lamps"]
        ]
        for name, words in WORDS_OF_LIGHT.items():
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


class LightOfPoints:
    """Light of the lamps of cameras at points of faces, (N, 3) metres; one thread may use it."""

    def __init__(
        self,
        mesh: Mesh,
        rig: Rig,
        lamps: Lamps,
        task: Task,
        points: FloatArray,
        face: WholeArray,
    ) -> None:
        lamps = lamps._around(mesh.bounds)
        self.lamps, self.task, self._rig = lamps, task, rig
        self._on = points, frames_of(mesh).normal[face]
        self._two_sided = mesh.two_sided_mask[face]
        self._judge = PointPass(mesh, lamps.eyes, Task(), points, face)
        self._dazzled = [own.max_highlight_deg for own in tasks_of(rig, task)]
        self._carried, self._rides = carried_on(rig, lamps)
        self._fixed = self._reach(points_of(lamps, ~self._rides))

    def of_cell(self) -> FloatArray:
        """(N,) illuminance by the lamps that are fixed, from the side that gets more."""
        return brighter_side(self.lamps, *self._fixed, self._on, self._two_sided)

    def illuminance(self, lead: Poses) -> FloatArray:
        """(N,) illuminance on the side of a pose by all lamps, those that it carries too."""
        poses, reached = self._lamps_of(lead)
        is_front = in_front(eyes_of(self._rig, lead), *self._on)[0]
        side = in_front(eyes_of(self.lamps.eyes, poses), *self._on) == is_front
        return illuminances(self.lamps, poses, reached & (side | ~self._two_sided), *self._on)

    def _lamps_of(self, own: Poses) -> tuple[Poses, BoolArray]:
        """Points of lamps for the first of some poses, and (K, N) what each reaches."""
        poses, reached = self._fixed
        if self._rides.any():
            lead = movers(self._rig, own)[:1]
            on_rig = self._reach(points_of(self.lamps, self._rides, self._rig._rigs(lead)))
            is_there = self._carried[on_rig[0].camera, lead.camera]
            reached = np.concatenate([reached, on_rig[1] & is_there[:, None]])
            camera = np.concatenate([poses.camera, on_rig[0].camera])
            matrices = np.concatenate([poses.world_from_camera, on_rig[0].world_from_camera])
            poses = Poses.of(matrices, camera=camera)
        return poses, reached

    def reasons(self, own: Poses, sees: BoolArray | None = None) -> ByteArray:
        """See `PointCondition`."""
        poses, reached = self._lamps_of(own)
        fronts = in_front(eyes_of(self._rig, own), *self._on)
        gate = self._rig.gates.get(int(own.camera[0]))
        if gate is None or sees is None:
            return self._on_side(own, poses, reached, fronts[0])
        front, rear = (gate.holds(sees & side) for side in (fronts, ~fronts))
        is_front = front | ~rear
        on_side = self._on_side(
            own, poses, reached, is_front, (gate.holds, sees & (fronts == is_front))
        )
        if (both := front & rear).any():
            rest = gate.holds, sees & (fronts == ~both)
            other = self._on_side(own, poses, reached, ~both, rest)
            on_side[both] = np.minimum(on_side, other)[both]  # reasons of light are above `COVERED`
        return on_side

    def _on_side(
        self,
        own: Poses,
        poses: Poses,
        reached: BoolArray,
        is_front: BoolArray,
        together: tuple[Callable[[BoolArray], BoolArray], BoolArray] | None = None,
    ) -> ByteArray:
        """(N,) reason on a side of each point, by the points of lamps that reach it, (K, N).

        A camera that sees a lamp mirrored does not count; with a function whether a rule holds, and
        the points that each of its cameras sees, (n, N), the others may be enough.
        """
        task, eyes, n = self.task, eyes_of(self.lamps.eyes, poses), reached.shape[1]
        sees = reached & ((in_front(eyes, *self._on) == is_front) | ~self._two_sided)
        on_side = np.full(n, Reason.COVERED, np.uint8)
        dazzled = np.zeros((len(own), n), bool)
        for row, (centre, index) in enumerate(
            zip(eyes_of(self._rig, own), own.camera, strict=True)
        ):
            if degrees := self._dazzled[index]:
                dazzled[row] = self._mirror(centre, eyes, sees, degrees)
        is_lost = dazzled.any(axis=0)
        if together is not None:
            holds, covers = together
            is_lost &= ~holds(covers & ~dazzled)
        on_side[is_lost] = HIGHLIGHT
        light = illuminances(self.lamps, poses, sees, *self._on)
        if task.max_illuminance is not None:
            on_side[light > task.max_illuminance] = TOO_BRIGHT
        on_side[light < task.min_illuminance] = TOO_DARK
        on_side[~are_lit(self.lamps, sees, poses.camera)] = UNLIT
        return on_side

    def _mirror(
        self, centre: FloatArray, eyes: FloatArray, sees: BoolArray, degrees: float
    ) -> BoolArray:
        """(N,) points with the half vector to a camera and a lamp within degrees of the normal."""
        points, normals = self._on
        to_camera = centre - points
        to_camera /= np.maximum(norm(to_camera), TINY)[:, None]
        mask = np.zeros(len(points), bool)
        for eye, own in zip(eyes, sees, strict=True):
            half = eye - points
            half /= np.maximum(norm(half), TINY)[:, None]
            half += to_camera
            along = np.abs(dots(half, normals))
            mask |= own & (along > math.cos(math.radians(degrees)) * norm(half))
        return mask

    def _reach(self, poses: Poses) -> tuple[Poses, BoolArray]:
        """Points of lamps by their poses, and (K, N) the points of faces that each reaches."""
        return poses, self._judge.covers(poses)


class OfLight(NamedTuple):
    """Illuminances of faces, (F,), their unit, and the limits of the task."""

    values: FloatArray
    unit: str
    least: float = 0.0
    most: float | None = None


class PointLamps(Feature):
    """Lamps of rigs, see `rastercov.light.lamps`."""

    figures = LightFigures

    def narrow(self, camera: Cameras, task: Task) -> Task:
        """See `Feature`: within what the lamps ask for."""
        return narrow_to_lamps(task, lamps_on(camera))

    def check_bodies(self, camera: Cameras, bodies: Sequence[str]) -> None:
        """See `Feature`."""
        lamps = lamps_on(camera)
        for own in () if lamps is None else lamps.carried_by(names_of(camera)):
            if len(used := {bodies[at]: 0 for at in np.flatnonzero(own).tolist()}) > 1:
                raise ConfigError(
                    f"expected cameras that share a lamp to be on one body, got {', '.join(used)}; "
                    "place the lamp in the world"
                )

    def condition(
        self,
        mesh: Mesh,
        camera: Cameras,
        task: Task,
        find: Callable[[Sequence[Camera]], Finder],
    ) -> Light | None:
        """See `Feature`."""
        lamps = lamps_on(camera)
        if lamps is None or not isinstance(camera, Rig):
            return None
        around = lamps._around(mesh.bounds)
        finder = find(around.eyes)
        own = tuple(getattr(task, name) for name in OF_LIGHT)
        known = known_light(lamps, mesh, (camera.names, finder.method, own))
        return Light(around, task, camera, finder.find, finder, known)

    def stages(self, camera: Cameras, task: Task) -> Iterator[tuple[int, Cameras, Task]]:
        """See `Feature`."""
        if lamps_on(camera) is None or not isinstance(camera, Rig):
            return
        if any(own.max_highlight_deg > 0 for own in tasks_of(camera, task)):
            yield HIGHLIGHT, camera, task._without(["max_highlight_deg"])
        if task.max_illuminance is not None:
            yield TOO_BRIGHT, camera, task._without(["max_illuminance"])
        if task.min_illuminance > 0:
            yield TOO_DARK, camera, task._without(["min_illuminance"])
        yield UNLIT, camera._equip("lamps", None), task._without(OF_LIGHT)

    def at_points(
        self, mesh: Mesh, camera: Cameras, task: Task, points: FloatArray, face: WholeArray
    ) -> LightOfPoints | None:
        """See `Feature`."""
        lamps = lamps_on(camera)
        if lamps is None or not isinstance(camera, Rig):
            return None
        return LightOfPoints(mesh, camera, lamps, task, points, face)

    def device(
        self, camera: Cameras, lead: Poses, point: FloatArray, normal: FloatArray, reason: int
    ) -> str | None:
        """See `Feature`: the nearest lamp, or the one that is mirrored."""
        if not UNLIT <= reason <= HIGHLIGHT or not isinstance(camera, Rig):
            return None
        return failing_lamp(camera, lead, point, normal, reason)

    def measure(
        self, scene: Scene, points: FloatArray, face: WholeArray, lead: Poses, reason: int
    ) -> tuple[str, ByName]:
        """See `Feature`: least and greatest illuminance."""
        mesh, camera, task = scene
        if reason not in (TOO_DARK, TOO_BRIGHT):
            return "", {}
        light = self.at_points(mesh, camera, task, points, face)
        assert light is not None
        illuminance, unit = light.illuminance(lead), light.lamps.unit
        least, most = float(illuminance.min()), float(illuminance.max())
        words = f"down to {number(least)} {unit}, {number(task.min_illuminance)} {unit} required"
        if reason == TOO_BRIGHT:
            limit = number(task.max_illuminance or 0.0)
            words = f"up to {number(most)} {unit}, {limit} {unit} allowed"
        return words, {"illuminance": {"least": least, "most": most, "unit": unit}}

    def values(self, mesh: Mesh, camera: Cameras, task: Task) -> dict[str, OfLight]:
        """See `Feature`: `lux`, illuminance by the fixed lamps, its unit and its limits."""
        faces = np.flatnonzero(mesh.task_mask & ~mesh.degenerate_mask)
        light = self.at_points(mesh, camera, Task(), mesh.centroids[faces], faces)
        if light is None or light._rides.all():
            return {}
        values = np.zeros(mesh.n_faces)
        values[faces] = light.of_cell()
        light_of = OfLight(values, light.lamps.unit, task.min_illuminance, task.max_illuminance)
        return {"lux": light_of}


HOOKS = PointLamps()
