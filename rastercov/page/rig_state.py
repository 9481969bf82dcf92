"""State of a viewer: cameras with their poses, and the thresholds; the page edits it."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import field, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from rastercov.base import (
    ConfigError,
    FloatArray,
    IntArray,
    PoseError,
    first_of,
    frozen_record,
    shown,
)
from rastercov.core.camera import (
    Camera,
    Poses,
    Rig,
    eyes_of,
    names_of_poses,
    rows_of_result,
    valid_poses,
)
from rastercov.core.coverage.task import NEEDED, Task, tasks_of
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.arrays import frozen
from rastercov.placement.select.problem import views_of

MOST_STATIONS = 5_000
"""Cameras that a viewer takes."""
LONGEST_NAME = 120
"""Characters of a name."""


@frozen_record
class Station:
    """A camera at its place.

    Attributes
    ----------
    id : int
        Number that stays the same whatever is edited.
    name : str
    camera : str
        Name of its camera in `RigState.whole`.
    pose : (4, 4) float64
        world_from_camera.
    is_on : bool
        False leaves it out of the network.
    """

    id: int
    name: str
    camera: str
    pose: FloatArray
    is_on: bool = True


class Head(NamedTuple):
    """Stations that measure together by a rule, or a single one; those that are on count."""

    name: str
    stations: tuple[Station, ...]
    counts: bool


def check_pose(pose: FloatArray) -> FloatArray:
    """The pose, read-only; PoseError unless it is a rigid transform."""
    return frozen(valid_poses(pose)[0].copy())


@frozen_record
class RigState:
    """Stations, their cameras, and thresholds.

    Attributes
    ----------
    stations : tuple of Station
    whole : Rig
        All cameras, with their rules, places, own thresholds and equipment.
    task : Task
    needed : mapping of str to int, or None
        Cameras that faces of a group need, 1 for groups that are not named; those of the task for
        all of them unless given.
    catalogue : Path or None
        Catalogue of the plan, beside that of the package.
    unit : {"m", "unit"}
        Of lengths; "unit" is that of a reconstruction without a scale.
    """

    stations: tuple[Station, ...]
    whole: Rig
    task: Task = field(default_factory=Task)
    needed: Mapping[str, int] | None = None
    catalogue: Path | None = None
    unit: str = "m"

    @classmethod
    def of(
        cls, rig: Rig, poses: Poses, names: tuple[str, ...] = (), task: Task | None = None
    ) -> "RigState":
        """State of the cameras of a rig and their poses.

        Names of the stations are as of `names_of_poses`; those of heads, with a rule, and of their
        sensors where they have none.

        Raises
        ------
        ConfigError
            For more poses than `MOST_STATIONS`.
        """
        if len(poses) > MOST_STATIONS:
            raise ConfigError(
                f"expected up to {MOST_STATIONS:,} poses in the viewer, got {len(poses):,}; "
                "give fewer"
            )
        words = names_of_poses(poses, names)
        if rig.gates and words == names_of_poses(poses):
            with suppress(PoseError):  # of a rig that is not whole
                pairs = zip(rows_of_result(rig, poses) + 1, poses.camera, strict=True)
                words = tuple(f"head {n}/{rig.names[index]}" for n, index in pairs)
        stations = tuple(
            Station(row, words[row], rig.names[index], frozen(pose.copy()))
            for row, (index, pose) in enumerate(
                zip(poses.camera.tolist(), poses.world_from_camera, strict=True)
            )
        )
        task = task or Task()
        every = dict(zip(rig.names, tasks_of(rig, task), strict=True))
        own = rig._with(tasks={name: every[name] for name in rig.tasks})
        return cls(stations, own, task)

    @cached_property
    def heads(self) -> list[Head]:
        """Heads and single cameras, in the order of their stations.

        Sensors of a head follow one another, in the order of its rule; others do not count.
        """
        names, at = self.whole.names, 0
        heads: list[Head] = []
        sensors = {
            name: names[row : row + gate.n]
            for row, gate in self.whole.gates.items()
            for name in names[row : row + gate.n]
        }
        while at < len(self.stations):
            first = self.stations[at]
            own = sensors.get(first.camera, (first.camera,))
            some = self.stations[at : at + len(own)]
            counts = tuple(each.camera for each in some) == own
            some = some if counts else (first,)
            common = first.name.rpartition("/")[0] or f"head {len(heads) + 1}"
            name = common if len(some) > 1 else first.name
            heads.append(Head(name, some, counts and all(each.is_on for each in some)))
            at += len(some)
        return heads

    def cameras_that_count(self) -> tuple[Poses, tuple[Station, ...]]:
        """Stations of heads that count, and their poses; `Poses.camera` counts those of `whole`."""
        values = tuple(one for each in self.heads if each.counts for one in each.stations)
        return _place_rig(self.whole, values), values

    @cached_property
    def cameras(self) -> Mapping[str, Camera]:
        """Cameras by name."""
        return MappingProxyType(dict(zip(self.whole.names, self.whole.cameras, strict=True)))

    @property
    def on(self) -> tuple[Station, ...]:
        """Stations of the network."""
        return tuple(each for each in self.stations if each.is_on)

    @property
    def eyes(self) -> FloatArray:
        """(N, 3) positions of all stations."""
        return np.array([each.pose[:3, 3] for each in self.stations]).reshape(-1, 3)

    @property
    def sights(self) -> FloatArray:
        """(P, 3) points that the stations that are on see from, see `rig.eyes_of`."""
        return eyes_of(self.rig(), self.poses())

    def station(self, station: int) -> Station:
        """A station by its id; ConfigError where it is gone."""
        for each in self.stations:
            if each.id == station:
                return each
        raise ConfigError(
            f"expected a camera of the rig, got station {shown(station)}; reload the page"
        )

    def camera_of(self, station: Station) -> Camera:
        """The camera of a station."""
        return self.cameras[station.camera]

    def task_of(self, camera: str) -> Task:
        """The thresholds that decide what a camera covers, by its name."""
        return self.whole.tasks.get(camera) or replace(
            self.task._without(NEEDED), views=1, min_angle_deg=0.0
        )

    def carry_bodies(self, bodies: Mapping[str, FloatArray]) -> "RigState":
        """With the stations of some cameras, by their names, moved by poses (4, 4) of bodies."""
        stations = [
            replace(each, pose=frozen(bodies[each.camera] @ each.pose))
            if each.camera in bodies
            else each
            for each in self.stations
        ]
        return replace(self, stations=tuple(stations)) if bodies else self

    @property
    def most_views(self) -> int:
        """Largest number of cameras that a face needs."""
        return self.task.views if self.needed is None else max([1, *self.needed.values()])

    def need(self, mesh: Mesh) -> IntArray:
        """(F,) cameras that must cover each face."""
        return views_of(mesh, self.task.views if self.needed is None else self.needed)

    def rig(self, rule_of: Poses | None = None) -> Rig:
        """The cameras that stations use, all where none does, and with equipment.

        Each counts by itself, unless their rules hold of poses, which are then those of whole rigs.
        """
        used = {each.camera for each in self.stations} or set(self.cameras)
        names, has_all = self.whole.names, bool(self.whole.equipment)
        only = self.whole._only([at for at, name in enumerate(names) if has_all or name in used])
        try:
            if rule_of is not None:
                rows_of_result(only, rule_of)
                return only
        except PoseError:
            pass
        return only._with(gates={})

    def poses(self, *, all_stations: bool = False) -> Poses:
        """Poses of the stations that are on, or of all; `Poses.camera` counts those of `rig`."""
        return _place_rig(self.rig(), self.stations if all_stations else self.on)

    def check_whole(self, stations: Sequence[Station]) -> None:
        """Raise `ConfigError` unless stations are those of whole rigs where cameras have rules."""
        try:
            rows_of_result(self.whole, _place_rig(self.whole, stations))
        except PoseError:
            raise ConfigError(
                "expected all cameras of each rig with a rule, in its order, got others; complete "
                "the rig, or delete it"
            ) from None

    def camera(self, name: str) -> Camera:
        """A camera by its name; ConfigError where there is none."""
        if name not in self.cameras:
            known = first_of(list(self.cameras))
            raise ConfigError(f"expected one of {known}, got camera {shown(name)}; correct it")
        return self.cameras[name]


def _place_rig(rig: Rig, stations: Sequence[Station]) -> Poses:
    """Poses of stations, with the rows of their cameras in a rig."""
    row = {name: at for at, name in enumerate(rig.names)}
    matrices = np.array([each.pose for each in stations]).reshape(-1, 4, 4)
    return Poses.of(matrices, camera=[row[each.camera] for each in stations])
