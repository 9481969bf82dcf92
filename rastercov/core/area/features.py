"""Features that add to what cameras see: calls to all of them.

Views of devices on cameras, `rastercov.core.coverage.device`, as conditions on regions.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from rastercov.base import BoolArray, ByName, ByteArray, FloatArray, WholeArray, hooks_of
from rastercov.core.area.feature import Feature, Judge, PointCondition, Points, Scene
from rastercov.core.area.point_pass import PointPass
from rastercov.core.area.polygons import frames_of, in_front
from rastercov.core.area.table import Condition, Cut, Finder, Regions, join
from rastercov.core.camera import Camera, Cameras, Poses, Rig, equipment_on, eyes_of, movers
from rastercov.core.coverage.device import Carried, Device, devices
from rastercov.core.coverage.task import NAMES, Reason, Task
from rastercov.core.mesh import Mesh


class DeviceView(Condition):
    """The view of a device on one mesh."""

    def __init__(
        self, rig: Rig, reason: int, finder: Finder, find: Callable[[Poses], Regions]
    ) -> None:
        self._rig, self.reason, self._finder, self._find = rig, reason, finder, find

    def cut_of(self, leads: Poses) -> Cut:
        """See `Condition`."""
        sides = self._find(Poses.of(self._rig._rigs(leads)))._sides()

        def cut(regions: Regions, is_rear: bool) -> Regions:
            none = np.arange(0)
            seen = sides[is_rear] if is_rear < len(sides) else sides[0]._with(none, none)
            both = join([replace(each, devices=None) for each in (regions, seen)])
            return both.at_least(2, np.tile(np.arange(len(leads)), 2), one_side=False)

        return cut

    def in_scene(self, mesh: Mesh) -> "DeviceView":
        """See `Condition`."""
        self._finder.set_mesh(mesh)
        return self

    def find_by(self, find: Callable[[Finder, Poses], Regions]) -> "DeviceView":
        """See `Condition`."""
        return DeviceView(self._rig, self.reason, self._finder, partial(find, self._finder))


class SeenAtPoints:
    """The view of a device on points of faces, (N, 3); a `PointCondition`."""

    def __init__(
        self, mesh: Mesh, rig: Rig, eye: Camera, reason: int, points: FloatArray, face: WholeArray
    ) -> None:
        self._rig, self._reason, self._on = rig, reason, (points, frames_of(mesh).normal[face])
        self._two_sided = mesh.two_sided_mask[face]
        self._judge = PointPass(mesh, eye, Task(), points, face)

    def reasons(self, own: Poses, sees: BoolArray | None = None) -> ByteArray:
        """See `PointCondition`."""
        pose = Poses.of(self._rig._rigs(movers(self._rig, own)[:1]))
        eyes = eyes_of(self._rig, own), pose.eyes
        cameras, device = (in_front(each, *self._on) for each in eyes)
        is_beside = cameras == device
        gate = self._rig.gates.get(int(own.camera[0]))
        holds = is_beside[0] if gate is None or sees is None else gate.holds(sees & is_beside)
        is_seen = self._judge.covers(pose)[0] & (holds | ~self._two_sided)
        return np.where(is_seen, np.uint8(Reason.COVERED), np.uint8(self._reason))


class OfDevice(Feature):
    """A device on cameras as a feature."""

    def __init__(self, device: Device) -> None:
        self._word, (name,) = device.word, device.reasons
        self._reason = NAMES.index(name)

    def _on(self, camera: Cameras) -> tuple[Rig, Carried] | None:
        own = equipment_on(camera).get(self._word)
        return (camera, own) if isinstance(camera, Rig) and isinstance(own, Carried) else None

    def condition(
        self, mesh: Mesh, camera: Cameras, task: Task, find: Callable[[Sequence[Camera]], Finder]
    ) -> DeviceView | None:
        """See `Feature`."""
        if (on := self._on(camera)) is None:
            return None
        finder = find((on[1].eye,))
        return DeviceView(on[0], self._reason, finder, finder.find)

    def stages(self, camera: Cameras, task: Task) -> Iterator[tuple[int, Cameras, Task]]:
        """See `Feature`."""
        if (on := self._on(camera)) is not None:
            yield self._reason, on[0]._equip(self._word, None), task

    def at_points(
        self, mesh: Mesh, camera: Cameras, task: Task, points: FloatArray, face: WholeArray
    ) -> SeenAtPoints | None:
        """See `Feature`."""
        on = self._on(camera)
        return on and SeenAtPoints(mesh, on[0], on[1].eye, self._reason, points, face)

    def device(
        self, camera: Cameras, lead: Poses, point: FloatArray, normal: FloatArray, reason: int
    ) -> str | None:
        """See `Feature`."""
        return self._word if reason == self._reason and self._on(camera) else None


FEATURES = (*hooks_of(Feature), *map(OfDevice, devices()))


def narrow(camera: Cameras, task: Task) -> Task:
    """The task within the limits that the equipment of cameras has."""
    for each in FEATURES:
        task = each.narrow(camera, task)
    return task


def conditions_at(
    mesh: Mesh, camera: Cameras, task: Task, points: FloatArray, face: WholeArray
) -> list[PointCondition]:
    """Conditions at points of faces, (N, 3) metres."""
    at_points = (each.at_points(mesh, camera, task, points, face) for each in FEATURES)
    return [each for each in at_points if each is not None]


def device_of(
    camera: Cameras, lead: Poses, point: FloatArray, normal: FloatArray, reason: int
) -> str | None:
    """Name of the device that fails a point, (3,), for a row of `REASONS`, in one pose."""
    devices = (each.device(camera, lead, point, normal, reason) for each in FEATURES)
    return next((name for name in devices if name is not None), None)


def measure_at(
    scene: Scene, points: FloatArray, face: WholeArray, lead: Poses, reason: int
) -> tuple[str, ByName]:
    """Words and entries on what points miss, (N, 3), for a row of `REASONS`, in one pose."""
    measures = (each.measure(scene, points, face, lead, reason) for each in FEATURES)
    return next((own for own in measures if own[0]), ("", {}))


def unmet_lines(judge: Judge, regions: Regions, scene: Scene, poses: Poses) -> list[str]:
    """Lines on limits that nothing meets, by the regions of each pose."""
    return [line for each in FEATURES for line in each.unmet(judge, regions, scene, poses)]


def limit_advice(
    judge: Judge, scene: Scene, poses: Poses, on: Points, *, is_tried: bool = True
) -> str:
    """Text on how far rigs in these poses miss limits, and what helps; "" for no limit."""
    further = (each.advice(judge, scene, poses, on, is_tried=is_tried) for each in FEATURES)
    return next((text for text in further if text), "")


def deviations_of(camera: Cameras, own: Poses, points: FloatArray) -> FloatArray | None:
    """(N,) standard deviations of points, metres, by the poses of a row; None for no limit."""
    deviations = (each.deviations(camera, own, points) for each in FEATURES)
    return next((own for own in deviations if own is not None), None)


def values_of(mesh: Mesh, camera: Cameras, task: Task) -> ByName:
    """Values of faces by the names of modes."""
    every = (each.values(mesh, camera, task).items() for each in FEATURES)
    return {name: own for some in every for name, own in some}
