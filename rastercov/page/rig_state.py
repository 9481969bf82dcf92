"""State of a viewer: cameras with their poses, the thresholds, and the history of both.

States are immutable and share what did not change, so that undo has no end and costs nothing: an
edit makes a new state, and `History` is a list of states with a place in it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property
from pathlib import Path
from threading import RLock
from types import MappingProxyType

import numpy as np

from rastercov.base.checks import shown
from rastercov.base.errors import ConfigError, PoseError
from rastercov.base.format import ByName, first_of, frozen_record
from rastercov.base.memory import FloatArray, IntArray
from rastercov.core.area.rows import tasks_of
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.pose import Poses, valid_poses
from rastercov.core.camera.rig import Rig, Views, eyes_of, names_of_poses, rows_of_result
from rastercov.core.coverage.task import NEEDED, Task
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


def checked_pose(pose: FloatArray) -> FloatArray:
    """The pose, read-only; PoseError unless it is a rigid transform."""
    return frozen(valid_poses(pose)[0].copy())


@frozen_record
class RigState:
    """Stations, their cameras, and thresholds; edits return another state.

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

        Names of the stations are as of `names_of_poses`.

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

    def of_rules(self) -> tuple[Rig, Poses, list[Station]]:
        """Cameras with the rules of their rigs, and stations of rigs whose cameras are all on.

        A rig is stations that follow one another, in the order of its cameras.
        """
        gates = sorted(self.whole.gates.items())
        rig = self.whole._only([at + row for at, gate in gates for row in range(gate.n)])
        found: list[Station] = []
        for row in range(len(self.stations)):
            for at, gate in rig.gates.items():
                own, some = rig.names[at : at + gate.n], self.stations[row : row + gate.n]
                if tuple(each.camera for each in some) == own and all(each.is_on for each in some):
                    found += some
        return rig, _placed(rig, found), found

    def counted(self) -> tuple[Poses, tuple[Station, ...]]:
        """Stations that are on and count, with their poses; `Poses.camera` counts those of `whole`.

        A camera of a rig with a rule counts where all cameras of the rig are on.
        """
        ruled = {at + row for at, gate in self.whole.gates.items() for row in range(gate.n)}
        of_rule = {self.whole.names[at] for at in ruled}
        whole = {each.id for each in self.of_rules()[2]} if ruled else set()
        found = tuple(e for e in self.on if e.camera not in of_rule or e.id in whole)
        return _placed(self.whole, found), found

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

    def row(self, station: int) -> int:
        """Row of a station by its id; ConfigError where it is gone."""
        for row, each in enumerate(self.stations):
            if each.id == station:
                return row
        raise ConfigError(
            f"expected a camera of the rig, got station {shown(station)}; reload the page"
        )

    def station(self, station: int) -> Station:
        """A station by its id; ConfigError where it is gone."""
        return self.stations[self.row(station)]

    def camera_of(self, station: Station) -> Camera:
        """The camera of a station."""
        return self.cameras[station.camera]

    def task_of(self, camera: str) -> Task:
        """The thresholds that decide what a camera covers, by its name."""
        return self.whole.tasks.get(camera) or of_one_camera(self.task)

    def with_station(self, station: Station) -> "RigState":
        """With a station in place of the one of its id."""
        row = self.row(station.id)
        changed = (*self.stations[:row], station, *self.stations[row + 1 :])
        return replace(self, stations=changed)

    def with_pose(self, station: int, pose: FloatArray) -> "RigState":
        """With another pose of a station; PoseError unless it is a rigid transform."""
        return self.with_station(replace(self.station(station), pose=checked_pose(pose)))

    def with_new(self, camera: str, pose: FloatArray, name: str = "") -> "RigState":
        """With a further station, whose id is the greatest.

        Raises
        ------
        ConfigError
            For an unknown camera, or too many stations.
        PoseError
            For a pose that is not a rigid transform.
        """
        self.camera(camera)
        if len(self.stations) >= MOST_STATIONS:
            raise ConfigError(f"expected up to {MOST_STATIONS:,} cameras, got more; delete some")
        new = max((each.id for each in self.stations), default=-1) + 1
        station = Station(new, self._free(name or f"camera {new + 1}"), camera, checked_pose(pose))
        return replace(self, stations=(*self.stations, station))

    def with_copy(self, station: int) -> "RigState":
        """With a further station like one of them."""
        own = self.station(station)
        return self.with_new(own.camera, own.pose, own.name)

    def carried(self, bodies: Mapping[str, FloatArray]) -> "RigState":
        """With the stations of some cameras, by their names, moved by poses (4, 4) of bodies."""
        stations = [
            replace(each, pose=frozen(bodies[each.camera] @ each.pose))
            if each.camera in bodies
            else each
            for each in self.stations
        ]
        return replace(self, stations=tuple(stations)) if bodies else self

    def without(self, station: int) -> "RigState":
        """Without a station."""
        row = self.row(station)
        return replace(self, stations=self.stations[:row] + self.stations[row + 1 :])

    def renamed(self, station: int, name: str) -> "RigState":
        """With another name of a station; ConfigError for one that is taken or is none."""
        words = name.strip()
        if not words or len(words) > LONGEST_NAME or not words.isprintable():
            raise ConfigError(
                f"expected a name of 1 to {LONGEST_NAME} printable characters, got {shown(name)}; "
                "change it"
            )
        own = self.station(station)
        if words != own.name and words in {each.name for each in self.stations}:
            raise ConfigError(f"expected a new name, got {shown(words)}, which is taken; change it")
        return self.with_station(replace(own, name=words))

    def using(self, station: int, camera: str) -> "RigState":
        """With another camera at a station."""
        self.camera(camera)
        return self.with_station(replace(self.station(station), camera=camera))

    def with_camera(self, name: str, camera: Camera) -> "RigState":
        """With a camera of that name, new or changed."""
        return replace(self, whole=self.whole._with_camera(name, camera))

    def with_type(self, name: str) -> "RigState":
        """With a camera of the catalogue, unless there is a camera of that name."""
        if name in self.cameras:
            return self
        sold = Camera.from_dict({"preset": name, "catalogue": self.catalogue})
        return self.with_camera(name, sold)

    def with_task(self, task: Task) -> "RigState":
        """With other thresholds; other views are those of all groups."""
        needed = self.needed if task.views == self.task.views else None
        return replace(self, task=task, needed=needed)

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
        found = self.whole._only([at for at, name in enumerate(names) if has_all or name in used])
        try:
            if rule_of is not None:
                rows_of_result(found, rule_of)
                return found
        except PoseError:
            pass
        return found._with(gates={})

    def poses(self, *, all_stations: bool = False) -> Poses:
        """Poses of the stations that are on, or of all; `Poses.camera` counts those of `rig`."""
        return _placed(self.rig(), self.stations if all_stations else self.on)

    def check_whole(self, stations: Sequence[Station]) -> None:
        """Raise `ConfigError` unless stations are those of whole rigs where cameras have rules."""
        try:
            rows_of_result(self.whole, _placed(self.whole, stations))
        except PoseError:
            raise ConfigError(
                "expected all cameras of each rig with a rule, in its order, got others; complete "
                "the rig, or delete it"
            ) from None

    def views(self) -> Views:
        """All stations as `Views`, for files; ConfigError for a part of a rig with a rule."""
        names, has_unit = tuple(each.name for each in self.stations), self.unit == "m"
        self.check_whole(self.stations)
        poses = self.poses(all_stations=True)
        return Views(self.rig(poses), poses, names, has_unit=has_unit)

    def camera(self, name: str) -> Camera:
        """A camera by its name; ConfigError where there is none."""
        if name not in self.cameras:
            known = first_of(list(self.cameras))
            raise ConfigError(f"expected one of {known}, got camera {shown(name)}; correct it")
        return self.cameras[name]

    def _free(self, name: str) -> str:
        """The name, or the first of "name 2", "name 3", ... that is not taken."""
        taken, free, number = {each.name for each in self.stations}, name, 2
        while free in taken:
            free, number = f"{name} {number}", number + 1
        return free


def _placed(rig: Rig, stations: Sequence[Station]) -> Poses:
    """Poses of stations, with the rows of their cameras in a rig."""
    row = {name: at for at, name in enumerate(rig.names)}
    matrices = np.array([each.pose for each in stations]).reshape(-1, 4, 4)
    return Poses.of(matrices, camera=[row[each.camera] for each in stations])


def of_one_camera(task: Task) -> Task:
    """The thresholds that decide what one camera covers, whatever the equipment."""
    return replace(task._without(NEEDED), views=1, min_angle_deg=0.0)


class History:
    """States in the order of the edits, with the present one among them; any thread may use it.

    An edit during a gesture replaces the state of the gesture, so that a drag is one step.

    Attributes
    ----------
    revision : int
        Number of changes of the present state so far.
    """

    def __init__(self, state: RigState) -> None:
        self._lock = RLock()
        self._steps = [(state, "")]  # states, and words for the edits that made them
        self._at = self._saved = 0
        self._gesture = ""
        self.revision = 0

    @property
    def state(self) -> RigState:
        """The present state."""
        return self._steps[self._at][0]

    @property
    def undo_label(self) -> str:
        """Edit that `undo` takes back; "" where there is none."""
        return self._steps[self._at][1]

    @property
    def redo_label(self) -> str:
        """Edit that `redo` makes again; "" where there is none."""
        return self._steps[self._at + 1][1] if self._at + 1 < len(self._steps) else ""

    @property
    def is_saved(self) -> bool:
        """True where the present state is the one that was saved last, or the first."""
        return self._at == self._saved

    def take(self, state: RigState, words: str, *, is_drag: bool = False) -> None:
        """Make a state the present one; what was undone is gone."""
        with self._lock:
            if self._gesture == words and words:
                self._steps[self._at] = (state, words)
            else:
                del self._steps[self._at + 1 :]
                if self._saved > self._at:
                    self._saved = -1
                self._steps.append((state, words))
                self._at += 1
            self._gesture = words if is_drag else ""
            self.revision += 1

    def described(self) -> tuple[RigState, ByName]:
        """The present state, and what may be undone, ready for JSON; both of one moment."""
        with self._lock:
            return self.state, {
                "revision": self.revision,
                "can_undo": bool(self.undo_label),
                "can_redo": bool(self.redo_label),
                "undo_label": self.undo_label,
                "redo_label": self.redo_label,
                "is_saved": self.is_saved,
            }

    def undo(self) -> None:
        """Go back by an edit; nothing where there is none."""
        self._go(-1)

    def redo(self) -> None:
        """Make the edit again that was undone last; nothing where there is none."""
        self._go(1)

    def saved(self) -> None:
        """Note that the present state is on the disk."""
        self._saved = self._at

    def _go(self, by: int) -> None:
        with self._lock:
            self._gesture = ""
            if 0 <= self._at + by < len(self._steps):
                self._at += by
                self.revision += 1
