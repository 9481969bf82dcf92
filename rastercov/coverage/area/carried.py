"""What devices on cameras see, see `rastercov.coverage.device`: conditions on covered parts."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rastercov.base.memory import BoolArray, FloatArray
from rastercov.camera.camera import Camera
from rastercov.camera.near_plane import near_limits
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, Rig, equipment_on, eyes_of
from rastercov.coverage.area.feature import Faces, Feature
from rastercov.coverage.area.frames import frames_of, in_front
from rastercov.coverage.area.point_pass import PointPass
from rastercov.coverage.area.table import Cut, Finder, Regions, joined
from rastercov.coverage.device import Carried, Device
from rastercov.coverage.reasons import NAMES, Reason
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh


def _placed(rig: Rig, own: Carried, leads: Poses) -> Poses:
    """Poses of a device by the first poses of rows."""
    camera_from_rig = np.linalg.inv(rig.rig_from_camera)[leads.camera]
    return Poses.of(leads.world_from_camera @ camera_from_rig @ own.places[0], camera=0)


class Seen:
    """What a device sees of one mesh; a `Condition`."""

    def __init__(
        self,
        rig: Rig,
        own: Carried,
        reason: int,
        finder: Finder,
        find: Callable[[Finder, Poses], Regions] | None = None,
    ) -> None:
        self._rig, self._own, self.reason, self._finder = rig, own, reason, finder
        self._find = finder.find if find is None else partial(find, finder)

    def cut_of(self, leads: Poses) -> Cut:
        """See `Condition`."""
        sides = self._find(_placed(self._rig, self._own, leads))._sides()

        def cut(regions: Regions, is_rear: bool) -> Regions:
            none = np.arange(0)
            seen = sides[is_rear] if is_rear < len(sides) else sides[0]._with(none, none)
            row = np.tile(np.arange(len(leads)), 2)
            both = [replace(each, devices=None) for each in (regions, seen)]
            return joined(both).at_least(2, row, one_side=False)

        return cut

    def of_rows(self, regions: Regions, camera: Cameras, poses: Poses, leads: Poses) -> Regions:
        """See `Condition`."""
        cut = regions._by_side(self.cut_of(leads))
        return replace(cut, eyes=regions.eyes, columns=regions.columns)

    def of_cameras(self, regions: Regions, camera: Cameras, poses: Poses) -> Regions:
        """See `Condition`: nothing before a rule counts."""
        return regions

    def in_scene(self, mesh: Mesh) -> "Seen":
        """See `Condition`."""
        self._finder.set_mesh(mesh)
        return self

    def found_by(self, find: Callable[[Finder, Poses], Regions]) -> "Seen":
        """See `Condition`."""
        return Seen(self._rig, self._own, self.reason, self._finder, find)

    def close(self) -> None:
        """See `Condition`."""
        self._finder.close()


class SeenAtPoints:
    """What a device sees of points of faces, (N, 3); a `PointCondition`."""

    def __init__(
        self, mesh: Mesh, rig: Rig, own: Carried, reason: int, points: FloatArray, face: Faces
    ) -> None:
        self._rig, self._own, self._reason, self._points = rig, own, reason, points
        self._normals, self._two_sided = frames_of(mesh).normal[face], mesh.two_sided_mask[face]
        self._judge = PointPass(mesh, own.eye, Task(), points, face)
        self._bounds = mesh.opaque.bounds

    def reasons(self, own: Poses, sees: BoolArray | None = None) -> NDArray[np.uint8]:
        """See `PointCondition`."""
        pose, n = _placed(self._rig, self._own, own[:1]), len(self._points)
        judge = self._judge.worker(
            pose, near_limits(self._judge.cameras, self._bounds, pose), is_nearest=False
        )
        found, hider = np.empty(n, np.uint8), np.empty(n, np.int64)
        judge(0, found, hider)
        on = self._points, self._normals
        is_beside = in_front(eyes_of(self._rig, own), *on) == in_front(
            pose.world_from_camera[:, :3, 3], *on
        )
        gate = self._rig.gates.get(int(own.camera[0]))
        holds = is_beside[0] if gate is None or sees is None else gate.holds(sees & is_beside)
        is_seen = (found == Reason.COVERED) & (holds | ~self._two_sided)
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
    ) -> Seen | None:
        """See `Feature`."""
        if (on := self._on(camera)) is None:
            return None
        return Seen(*on, self._reason, find((on[1].eye,)))

    def stages(self, camera: Cameras, task: Task) -> Iterator[tuple[int, Cameras, Task]]:
        """See `Feature`."""
        if (on := self._on(camera)) is not None:
            yield self._reason, on[0]._equipped(self._word, None), task

    def at_points(
        self, mesh: Mesh, camera: Cameras, task: Task, points: FloatArray, face: Faces
    ) -> SeenAtPoints | None:
        """See `Feature`."""
        on = self._on(camera)
        return None if on is None else SeenAtPoints(mesh, *on, self._reason, points, face)

    def device(
        self, camera: Cameras, lead: Poses, point: FloatArray, normal: FloatArray, reason: int
    ) -> str | None:
        """See `Feature`."""
        return self._word if reason == self._reason and self._on(camera) else None
