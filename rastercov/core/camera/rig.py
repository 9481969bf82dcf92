"""Rigs: several cameras that do one job, each with a name and its place on the rig; and views.

Wherever a camera is asked for, a sequence of cameras or a `Rig` may be given; `Poses.camera` then
says which of them is in each pose.

Views are cameras and poses as files of calibrations and reconstructions hold them together: between
`rastercov.formats.cameras`, which reads and writes them, and whatever takes a camera or poses. All
is in the conventions of this package: axes x right, y down, z forward, world_from_camera, centre of
the top-left pixel at (0.5, 0.5).
"""

import logging
import re
from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import asdict, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base import (
    AnyArray,
    BoolArray,
    ByName,
    CameraError,
    FloatArray,
    InOneLine,
    IntArray,
    MeshError,
    PoseError,
    ReadByName,
    StrPath,
    check_kind,
    first_of,
    frozen_record,
    hooks_of,
    image_side,
    matmul,
    members,
    owners_of,
    shown,
)
from rastercov.base.arguments import distinct, number, positive, two
from rastercov.base.format import distance
from rastercov.base.typed import typed
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.catalogue import head_of
from rastercov.core.camera.equipment import Equipment
from rastercov.core.camera.parallel import FAR
from rastercov.core.camera.pose import Poses, valid_poses
from rastercov.core.camera.rule import All, Gate, Rule, compile_rule, rename_devices
from rastercov.core.camera.rule import Any as AnyOf
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.arrays import inverse
from rastercov.core.mesh.files import NOWHERE, Site

LOG = logging.getLogger("rastercov")
MOST_CAMERAS = 100_000
"""Cameras of a rig: a reconstruction may have one for each image."""


@frozen_record(init=False, repr=False)
class Rig(InOneLine):
    """Named cameras that are mounted together or used together.

    Parameters
    ----------
    cameras : sequence of Camera
        N cameras, at least one.
    names : sequence of str, optional
        Distinct names; "camera 1", ... unless given.
    rig_from_camera : (N, 4, 4) array_like, optional
        Pose of each camera on the rig; all at its origin unless given.
    rule : Any, All or AtLeast, optional
        Cameras that must see a point together; any one suffices unless given. With `All` or
        `AtLeast`, results are per pose of the rig, not of its cameras.
    tasks : mapping of str to Task, optional
        Thresholds by name of a sensor, such as a projector, that replace the task for it: a `Task`
        or a mapping of its arguments.
    fixed : sequence of str, optional
        Names of cameras that do not move with the rig, such as a projector of the work cell: their
        `rig_from_camera` is world_from_camera. What they cover is computed once.

    Attributes
    ----------
    gates : dict of int to Gate
        Number and rule of cameras that measure together, by the index of the first.
    equipment : dict of str to object
        Further equipment that affects what cameras see, by name of the feature.

    Raises
    ------
    CameraError
        For no camera, invalid names, a rule that the cameras cannot meet, or only fixed cameras.
    PoseError
        For a pose that is not a rigid transform.

    Examples
    --------
    >>> import numpy as np
    >>> import rastercov as rc
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> right = np.eye(4)
    >>> right[0, 3] = 0.1  # metres
    >>> stereo = rc.Rig([camera, camera], ["left", "right"], [np.eye(4), right])
    >>> poses = stereo.poses(rc.look_at((0, 0, 0.6), (0, 0, 0)))
    >>> poses.camera.tolist(), poses.world_from_camera[:, 0, 3].round(6).tolist()
    ([0, 1], [0.0, 0.1])
    """

    cameras: tuple[Camera, ...]
    names: tuple[str, ...]
    rig_from_camera: FloatArray
    rule: Rule
    tasks: ReadByName
    fixed: tuple[str, ...]
    gates: Mapping[int, Gate]
    equipment: Mapping[str, Equipment]

    def __init__(
        self,
        cameras: Sequence[Camera],
        names: Sequence[str] | None = None,
        rig_from_camera: ArrayLike | None = None,
        *,
        rule: Rule | None = None,
        tasks: ReadByName | None = None,
        fixed: Sequence[str] = (),
    ) -> None:
        result = _check_cameras(cameras)
        n = len(result)
        words = distinct("names", names_of(result) if names is None else names, n, CameraError)
        places = np.broadcast_to(np.eye(4), (n, 4, 4))
        if rig_from_camera is not None:
            places = valid_poses(rig_from_camera)
            if len(places) != n:
                raise CameraError(
                    f"expected rig_from_camera to have one pose for each of {n} cameras, got "
                    f"{len(places)}"
                )
        tasks = {} if tasks is None else tasks
        if not isinstance(tasks, Mapping) or not all(name in words for name in tasks):
            raise CameraError(
                f"expected tasks by names of cameras, {_name_list(words)}, got "
                f"{shown(list(tasks) if isinstance(tasks, Mapping) else tasks)}"
            )
        still = members("fixed", fixed, str, "names of cameras", CameraError)
        if not set(still) <= set(words) or set(still) == set(words):
            raise CameraError(
                f"expected fixed to be some of the cameras, {_name_list(words)}, but not all, got "
                f"{shown(list(still))}"
            )
        self.__dict__.update(
            cameras=result,
            names=words,
            rig_from_camera=places,
            tasks=dict(tasks),
            fixed=still,
            gates={},
            equipment={},
        )
        self.__dict__.update(compile_rule(rule, words, result))

    def __len__(self) -> int:
        return len(self.cameras)

    @property
    def is_one(self) -> bool:
        """True where all cameras measure together, by a rule."""
        return 0 in self.gates and self.gates[0].n == len(self)

    def poses(self, world_from_rig: ArrayLike) -> Poses:
        """Poses of all cameras in R poses of the rig: row r N + k is camera k in pose r.

        Parameters
        ----------
        world_from_rig : (R, 4, 4) or (4, 4) array_like
            Rigid transforms; cameras in `fixed` have the same pose in each.

        Examples
        --------
        >>> import numpy as np
        >>> import rastercov as rc
        >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
        >>> pair = rc.Rig([camera, camera], ["a", "b"], [np.eye(4), np.eye(4)])
        >>> len(pair.poses(rc.sphere_of_poses((0, 0, 0), distance=1, count=5)))
        10
        """
        rigs, n = valid_poses(world_from_rig), len(self)
        camera = np.tile(np.arange(n), len(rigs))
        return Poses.of(self._place(np.repeat(rigs, n, axis=0), camera), camera=camera)

    def _place(self, world_from_rig: AnyArray, camera: AnyArray) -> FloatArray:
        """(M, 4, 4) world_from_camera of cameras, (M,), each in a pose of the rig, (M, 4, 4)."""
        places = self.rig_from_camera[camera]
        matrices = matmul(world_from_rig, places)
        is_still = self.is_fixed[camera]
        matrices[is_still] = places[is_still]
        return matrices

    def _rigs(self, poses: Poses) -> FloatArray:
        """(P, 4, 4) poses of the rig by those of cameras that move with it."""
        return matmul(poses.world_from_camera, inverse(self.rig_from_camera)[poses.camera])

    @property
    def is_fixed(self) -> BoolArray:
        """(N,) mask of the cameras that do not move with the rig."""
        return np.isin(self.names, self.fixed)

    @classmethod
    def preset(cls, name: str) -> "Rig":
        """Sensor head from the catalogue: two cameras, or a camera and a projector.

        Parameters
        ----------
        name : str
            NAME, NAME:BASELINE or NAME:BASELINE:CAMERA, such as "stereo:0.12" or
            "stereo:0.3:rpi-gs+rpi-16mm"; metres between the centres. See `rastercov cameras`.

        Raises
        ------
        CameraError
            For an unknown head or camera, and an invalid baseline.
        """
        return preset_rig(name)

    @classmethod
    def line_scan(
        cls,
        width: int,
        lines: int,
        *,
        focal_length: float,
        pixel_size: float,
        vy: float,
        depths: tuple[float, float],
        strips: int = 64,
    ) -> "Rig":
        """Image of a part that moves past a line sensor with a pinhole lens, as a row of strips.

        A strip is the image of a pinhole at its middle line. K strips over a length L shift the
        shadow of a surface H above a background at depth Z by at most about (L / 2K) H / (Z - H);
        this estimate is logged. Limit the incidence: the sensor sees surfaces perpendicular to the
        travel edge-on, but the outer lines of a strip see them at an angle. Telecentric lenses need
        no strips: see `Camera.line_scan`.

        Parameters
        ----------
        width, lines : int
            Pixels of a line, and lines of the image.
        focal_length, pixel_size : float
            Metres; `pixel_size` is along the line.
        vy : float
            Motion of the part per line, across the sensor, metres; of either sign.
        depths : (float, float)
            Minimum and maximum depth of surfaces, Z - H and Z, metres.
        strips : int
            K, at most one per line.

        Examples
        --------
        >>> import rastercov as rc
        >>> lens = {"focal_length": 0.05, "pixel_size": 7e-6}
        >>> rig = rc.Rig.line_scan(4096, 2000, vy=1e-4, depths=(0.4, 0.5), strips=100, **lens)
        >>> len(rig), rig.cameras[0].height, rig.rig_from_camera[0, 1, 3].round(4).item()
        (100, 20, -0.099)
        """
        pace = positive("magnitude of vy", abs(number("vy", vy)))
        near, far = (positive("depths", each) for each in two("depths", depths))
        n, count = image_side("lines", lines), image_side("strips", strips)
        if not near < far or count > n:
            raise CameraError(
                f"expected increasing depths and up to {n} strips, got {shown(depths)} and "
                f"{count}; correct them"
            )
        fx = positive("focal_length", focal_length) / positive("pixel_size", pixel_size)
        edges = np.rint(np.linspace(0, n, count + 1)).astype(int)
        cameras = [
            Camera(width=width, height=height, fx=fx, fy=near / pace)
            for height in np.diff(edges).tolist()
        ]
        places = np.tile(np.eye(4), (count, 1, 1))
        places[:, 1, 3] = pace * ((edges[1:] + edges[:-1]) / 2 - n / 2)
        shift = pace * n / (2 * count) * (far - near) / near
        LOG.warning(
            "strips of the line scan shift shadows by up to %s (estimate); use more to reduce it",
            distance(shift),
        )
        return cls(cameras, [f"strip {row + 1}" for row in range(count)], places)

    @classmethod
    def of_several(cls, rigs: Sequence["Rig"], names: Sequence[str]) -> "Rig":
        """Combine several rigs into one with new camera names, where each keeps its rule.

        The rule of a single rig gets the new names, too.
        """
        cameras = [camera for rig in rigs for camera in rig.cameras]
        places = np.concatenate([np.zeros((0, 4, 4)), *(rig.rig_from_camera for rig in rigs)])
        made = cls(cameras, names, places)  # which checks the names
        first, names = 0, made.names
        tasks: ByName = {}
        gates: dict[int, Gate] = {}
        fixed: list[str] = []
        for rig in rigs:
            fixed += [names[first + rig.names.index(name)] for name in rig.fixed]
            gates |= {first + row: gate for row, gate in rig.gates.items()}
            tasks |= {names[first + rig.names.index(name)]: own for name, own in rig.tasks.items()}
            first += len(rig)
        rule = rename_devices(rigs[0].rule, rigs[0].names, names) if len(rigs) == 1 else AnyOf()
        return made._with(tasks=tasks, fixed=tuple(fixed), gates=gates, rule=rule)

    def _with(self, **changes: object) -> "Rig":
        """The rig with other values of some attributes, and everything else as it is."""
        result = copy(self)
        result.__dict__.update(changes)
        return result

    def _equip(self, word: str, own: Equipment | None) -> "Rig":
        """The same cameras with other equipment of a feature, or without any of it."""
        others = {name: each for name, each in self.equipment.items() if name != word}
        return self._with(equipment=others if own is None else others | {word: own})

    def _only(self, rows: Sequence[int]) -> "Rig":
        """Some of the cameras, by rising rows, with their places, thresholds and equipment.

        A rule stays where all of its cameras do; cameras are fixed where others move.
        """
        new = {row: at for at, row in enumerate(rows)}
        names = tuple(self.names[row] for row in rows)
        gates = {
            new[at]: gate
            for at, gate in self.gates.items()
            if all(row in new for row in range(at, at + gate.n))
        }
        fixed = tuple(name for name in self.fixed if name in names)
        return self._with(
            cameras=tuple(self.cameras[row] for row in rows),
            names=names,
            rig_from_camera=self.rig_from_camera[list(rows)],
            rule=self.rule if gates else AnyOf(),
            tasks={name: own for name, own in self.tasks.items() if name in names},
            fixed=fixed if len(fixed) < len(names) else (),
            gates=gates,
        )

    def _with_camera(self, name: str, camera: Camera) -> "Rig":
        """With a camera in place of that of a name, whose noise stays in pixels, or as the last."""
        if name not in self.names:
            places = np.concatenate([self.rig_from_camera, np.eye(4)[None]])
            own: ByName = {"names": (*self.names, name), "rig_from_camera": places}
            return self._with(cameras=(*self.cameras, camera), **own)
        row = self.names.index(name)
        gates = {
            at: gate.with_camera(row - at, self.cameras[row], camera)
            if at <= row < at + gate.n
            else gate
            for at, gate in self.gates.items()
        }
        cameras = (*self.cameras[:row], camera, *self.cameras[row + 1 :])
        return self._with(cameras=cameras, gates=gates)


Cameras = Camera | Sequence[Camera] | Rig
"""Cameras as functions take them."""


def preset_rig(name: str, catalogue: StrPath | None = None) -> Rig:
    """Sensor head from the catalogue, or from a file beside it; see `Rig.preset`."""
    sold, projector, baseline = head_of(name, catalogue)
    names = ("left", "right") if projector is None else ("camera", "projector")
    eyes = [
        Camera.from_dict({"preset": each, "catalogue": catalogue})
        for each in (sold, projector or sold)
    ]
    places = np.repeat(np.eye(4)[None], 2, axis=0)
    places[1, 0, 3] = baseline
    return Rig(eyes, names, places, rule=All())


def cameras_of(cameras: object) -> tuple[Camera, ...]:
    """The cameras of a camera, a rig or a sequence of cameras; `CameraError` for anything else."""
    if isinstance(cameras, Camera):
        return (cameras,)
    return cameras.cameras if isinstance(cameras, Rig) else _check_cameras(cameras)


def check_central(cameras: Cameras, what: str) -> None:
    """Raise `CameraError` where a camera has parallel rays; see `Camera.check_central`."""
    for each in cameras_of(cameras):
        each.check_central(what)


def eyes_of(cameras: Cameras, poses: Poses) -> FloatArray:
    """Points (P, 3) that cameras see from, metres; of parallel rays at the distance `FAR`."""
    eyes = poses.world_from_camera[:, :3, 3].copy()
    return eyes if are_central(cameras) else eyes - FAR * axes_of(cameras, poses)


def axes_of(cameras: Cameras, poses: Poses) -> FloatArray:
    """Directions (P, 3) of parallel rays; 0 where rays meet in a point."""
    is_parallel = np.array([each.is_parallel for each in cameras_of(cameras)])
    axes: FloatArray = poses.world_from_camera[:, :3, 2] * is_parallel[poses.camera][:, None]
    return axes


def apparent(cameras: Cameras, poses: Poses) -> FloatArray:
    """(P, 4, 4) world_from_camera with the points that cameras see from, see `eyes_of`."""
    world = poses.world_from_camera.copy()
    world[:, :3, 3] = eyes_of(cameras, poses)
    return world


def are_central(cameras: Cameras) -> bool:
    """True where the rays of each camera meet in a point."""
    return not any(each.is_parallel for each in cameras_of(cameras))


def gates_of(cameras: Cameras) -> Mapping[int, Gate]:
    """Cameras that measure together, see `Rig`; none of cameras that count by themselves."""
    return cameras.gates if isinstance(cameras, Rig) else {}


def equipment_on(cameras: Cameras) -> Mapping[str, Equipment]:
    """Equipment of cameras by its word, see `Rig`; none of cameras without a rig."""
    return cameras.equipment if isinstance(cameras, Rig) else {}


def with_equipment(cameras: Cameras, given: Mapping[str, object], mesh: Mesh) -> Cameras:
    """The cameras as a rig with equipment, or that of files, by its word; None is none."""
    table = {word: value for word, value in given.items() if value is not None}
    kinds = {each.word: each for each in hooks_of(EquipmentKind)}
    own = {word: kinds[word].of(value, mesh.site) for word, value in table.items()}
    if not own:
        return cameras
    rig = cameras if isinstance(cameras, Rig) else Rig(cameras_of(cameras))
    return rig._with(equipment={**rig.equipment, **own})


def is_joint(cameras: Cameras) -> bool:
    """True where parts count by more than one camera alone: by a rule, or by equipment."""
    return bool(gates_of(cameras) or equipment_on(cameras))


class Inputs:
    """Hooks of a feature with inputs of its own, as entries of files on the cameras of a rig."""

    names: tuple[str, ...] = ()
    """Of the entries."""

    def add_entries(self, rig: Rig, entries: ReadByName) -> Rig:
        """A rig with what is among entries of a file."""
        return rig

    def entries(self, rig: Rig) -> ByName:
        """Entries that make it again."""
        return {}

    def describe(self, rig: Rig) -> ByName:
        """The same for a live page."""
        return {}


class EquipmentKind(Inputs):
    """Hooks of a feature with equipment, whose word is its entry."""

    word: str
    """Its key in files, in `Rig.equipment`, the argument of `evaluate` and the option."""
    help: str
    """Words on the option."""
    entry: str
    """Entry of results that it has."""

    def of(self, given: object, site: Site = NOWHERE) -> Equipment:
        """Equipment of an argument, or of a file, at a site; `CameraError` for anything else."""
        raise NotImplementedError  # each feature has its own

    def of_json(self, entries: ReadByName) -> Equipment:
        """Equipment of `Equipment.to_json`; `CameraError` for other entries."""
        raise NotImplementedError  # each feature has its own

    def add_entries(self, rig: Rig, entries: ReadByName) -> Rig:
        """See `Inputs`."""
        if self.word not in entries:
            return rig
        own = {self.word: self.of_json(entries[self.word])}
        return rig._with(equipment={**rig.equipment, **own})


class Phased(Inputs):
    """Hooks of a feature that asks for phases, see `rastercov.core.coverage.evaluation`."""

    word = ""
    """Its argument of `evaluate`."""
    help = ""
    """Words of its file, an option of the same name."""
    key = ""
    """Its entry of a summary: `in_words`, on the phases in which parts are covered, and `lines`."""

    def phases_of(self, mesh: Mesh, value: object) -> Any:
        """The `Phases` of that argument; ConfigError for another value."""
        raise NotImplementedError  # each feature has its own

    def read(self, path: Path, mesh: Mesh, method: str) -> Any:
        """Phases of a scene by that file, `PlanPhases`; ConfigError where it is none."""
        raise NotImplementedError  # each feature has its own


def phased_features() -> tuple[Phased, ...]:
    """Hooks of all features that ask for phases."""
    return hooks_of(Phased)


def equipment_words() -> tuple[str, ...]:
    """Words of the equipment that there is."""
    return tuple(each.word for each in hooks_of(EquipmentKind))


def entries_of_rig() -> tuple[str, ...]:
    """Entries of a file of cameras on what these are together."""
    of_features = (name for each in hooks_of(Inputs) for name in each.names)
    return (*of_features, "tasks", "fixed", *equipment_words())


def rig_with(rig: Rig, entries: ReadByName) -> Rig:
    """A rig with thresholds, fixed cameras, equipment and what else entries of a file have."""
    more = {name: entries[name] for name in ("tasks", "fixed") if name in entries}
    if more:
        own: ByName = {"tasks": rig.tasks, "fixed": rig.fixed} | more
        checked = Rig(rig.cameras, rig.names, rig.rig_from_camera, **own)
        rig = rig._with(tasks=checked.tasks, fixed=checked.fixed)
    for each in hooks_of(Inputs):
        rig = each.add_entries(rig, entries)
    return rig


def entries_of(rig: Rig) -> ByName:
    """Entries of a file on the cameras of a rig together, without its equipment."""
    tasks = {  # thresholds of a device, a `Task` or a mapping of some of them
        name: asdict(task) if is_dataclass(task) and not isinstance(task, type) else dict(task)
        for name, task in rig.tasks.items()
    }
    more: ByName = {"tasks": tasks, "fixed": list(rig.fixed)}
    own = {name: value for each in hooks_of(Inputs) for name, value in each.entries(rig).items()}
    return own | {name: value for name, value in more.items() if value}


def rig_to_json(cameras: Cameras) -> ByName:
    """Rule, tasks and equipment of the cameras of a rig, ready for JSON; or nothing.

    See `rig_of_json`.
    """
    if not isinstance(cameras, Rig) or not (cameras.tasks or cameras.fixed or is_joint(cameras)):
        return {}
    own: ByName = {word: each.to_json() for word, each in cameras.equipment.items()}
    if own:
        own["places"] = cameras.rig_from_camera.tolist()
    return own | entries_of(cameras) | {"names": list(cameras.names)}


def rig_of_json(cameras: Sequence[Camera], entries: ReadByName) -> Cameras:
    """Cameras with what `rig_to_json` has."""
    if not entries:
        return tuple(cameras)
    return rig_with(Rig(cameras, entries["names"], entries.get("places")), entries)


def with_places(cameras: Cameras, rig_from_camera: ArrayLike | None) -> Rig:
    """The cameras as a rig with these places, with their rules and equipment."""
    placed = Rig(cameras_of(cameras), names_of(cameras), rig_from_camera)  # which checks the places
    if not isinstance(cameras, Rig):
        return placed
    return cameras._with(rig_from_camera=placed.rig_from_camera)


def shared_rows(cameras: Cameras, poses: Poses) -> IntArray:
    """(P,) row of the first pose of the same fixed camera at the same place; otherwise its own."""
    result = np.arange(len(poses))
    if not isinstance(cameras, Rig) or not cameras.fixed:
        return result
    first: dict[tuple[int, bytes], int] = {}
    # 1 us per pose of a fixed camera.
    for row in np.flatnonzero(cameras.is_fixed[poses.camera]).tolist():
        key = int(poses.camera[row]), poses.world_from_camera[row].tobytes()
        result[row] = first.setdefault(key, row)
    return result


def rows_of_result(cameras: Cameras, poses: Poses) -> IntArray:
    """(P,) row of the result that each pose belongs to: its own, or one with others of its rig.

    Raises
    ------
    PoseError
        Where a pose of cameras that measure together comes without those of the others.
    """
    gates = gates_of(cameras)
    if not gates:
        return np.arange(len(poses))
    first = np.arange(len(cameras_of(cameras)))
    size = np.ones(len(first), np.int64)
    for at, gate in gates.items():
        first[at : at + gate.n], size[at] = at, gate.n
    index = poses.camera
    starts = np.flatnonzero(first[index] == index)
    leads = index[starts]
    wanted = np.repeat(leads, size[leads])
    within = np.arange(len(wanted)) - np.repeat(np.cumsum(size[leads]) - size[leads], size[leads])
    if not np.array_equal(wanted + within, index):
        n = min(len(wanted), len(index))
        off = np.flatnonzero((wanted + within)[:n] != index[:n])
        row = int(off[0]) if len(off) else min(n, len(index) - 1)
        name = names_of(cameras)[index[row]]
        raise PoseError(
            f"expected poses of all cameras of a rig in turn, got pose {poses.ids[row]} of "
            f"{shown(name)} out of order; use Rig.poses",
            (int(poses.ids[row]),),
        )
    return owners_of(size[leads])


def led_by(cameras: Cameras, poses: Poses) -> IntArray:
    """(R,) the first pose of each row of the result; PoseError as of `rows_of_result`."""
    return np.flatnonzero(np.diff(rows_of_result(cameras, poses), prepend=-1))


def movers(cameras: Cameras, poses: Poses) -> Poses:
    """P poses with that of the rig: of a fixed camera, the first that measures with it and moves.

    Its own where there is none; rows of the result are whole.
    """
    if not isinstance(cameras, Rig):
        return poses
    index = np.arange(len(cameras))
    for at, gate in cameras.gates.items():
        own = index[at : at + gate.n]
        is_fixed = cameras.is_fixed[own]
        own[is_fixed] = own[is_fixed.argmin()]
    rows = np.arange(len(poses)) + index[poses.camera] - poses.camera
    return poses[np.clip(rows, 0, len(poses) - 1)]


def by_gate(camera: Cameras, poses: Poses) -> Iterator[tuple[Gate | None, IntArray, IntArray]]:
    """Each rule, its poses (R, n) and their rows of the result (R,); None for single cameras."""
    gates, leads = gates_of(camera), led_by(camera, poses)
    index = poses.camera[leads]
    for gate in dict.fromkeys((None, *gates.values())):
        firsts = [at for at, own in gates.items() if own == gate]
        is_own = np.isin(index, firsts) if gate else ~np.isin(index, list(gates))
        if is_own.any():
            rows = np.flatnonzero(is_own)
            width = gate.n if gate else 1
            yield gate, leads[rows, None] + np.arange(width), rows


def names_of(cameras: Cameras) -> tuple[str, ...]:
    """Names of the cameras; "camera 1", ... where they have none of their own."""
    if isinstance(cameras, Rig):
        return cameras.names
    return tuple(f"camera {row + 1}" for row in range(len(cameras_of(cameras))))


def names_of_poses(poses: Poses, images: Sequence[str] = ()) -> tuple[str, ...]:
    """Names of placed cameras, in tables, pictures, plan sheets and the viewer.

    They are those of their images, (P,), where all differ; "camera 1", ... by the rows of their
    file otherwise.
    """
    if len(set(images)) == len(poses) and all(images):
        return tuple(images)
    return tuple(f"camera {row + 1}" for row in poses.ids.tolist())


KEPT = " (kept)"
"""End of the name of a camera that a plan has kept."""


def names_by_origin(origins: Sequence[str]) -> tuple[str, ...]:
    """Names of placed cameras where some were there before; none elsewhere."""
    kept = [origin.startswith("existing") for origin in origins]
    names = (f"camera {row + 1}{KEPT * each}" for row, each in enumerate(kept))
    return tuple(names) if any(kept) else ()


def short_names(names: Sequence[str]) -> list[str]:
    """Names for a column or a legend of cameras or heads: the number alone of "camera 1"."""
    return [re.sub(r"^(camera|head) (?=\d+( \(kept\))?$)", "", name) for name in names]


def heads_of(
    camera: Cameras, poses: Poses, names: Sequence[str]
) -> tuple[IntArray, list[str], str]:
    """Rows of poses that count as one each, their names, and a word for one.

    Of a rig with a rule, those of its first camera, which are named without it.
    """
    leads, cameras = led_by(camera, poses), names_of(camera)
    own = zip(leads.tolist(), poses.camera[leads].tolist(), strict=True)
    is_head = len(leads) < len(poses) or (not len(poses) and bool(gates_of(camera)))
    said = [names[row].removesuffix(f"/{cameras[index]}") for row, index in own]
    said = [
        f"head {n}" if is_head and text in names else text for n, text in enumerate(said, start=1)
    ]
    return leads, said if is_head else list(names), "head" if is_head else "camera"


def check_scene(mesh: object, camera: object) -> None:
    """Raise MeshError or CameraError unless they are a Mesh and a camera, or several."""
    check_kind("mesh", mesh, Mesh, "a Mesh (Mesh.load reads a file)", MeshError)
    cameras_of(camera)


def _check_cameras(cameras: object) -> tuple[Camera, ...]:
    wanted = "a Camera (Camera.load reads a file), a Rig, or a list of Camera values"
    result = members("camera", cameras, Camera, wanted, CameraError)
    if not 1 <= len(result) <= MOST_CAMERAS:
        raise CameraError(f"expected 1 to {MOST_CAMERAS:,} cameras, got {len(result) or 'none'}")
    return result


MOST_NAMES = 8
"""Names of cameras that a message lists."""


@frozen_record(repr=False)
class Views(InOneLine):
    """Cameras with names, poses, and a name for the image of each pose.

    Parameters
    ----------
    rig : Rig, optional
        The cameras, with their names and poses; None for a file with only poses.
    poses : Poses
        world_from_camera, with the index of the camera of each; none for a file with only cameras.
    images : tuple of str
        Name of the image of each pose.
    notes : tuple of str
        Conversions made, and data that could not be kept.
    has_unit : bool
        True where lengths are metres; False where the file does not state its unit.
    camera_names : tuple of str
        Names of the cameras that `Poses.camera` indexes, if the file names cameras without defining
        them; with a rig, those of the rig.
    frames : tuple of str
        Name of the frame of each pose, where the file has frames: the images of one frame were
        taken at the same instant. Empty where it has none.

    Raises
    ------
    CameraError
        For arguments of another type.
    PoseError
        For a pose with a camera that the rig does not have, or another number of images or frames.

    Examples
    --------
    >>> import rastercov as rc
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> poses = rc.Poses.of(rc.sphere_of_poses((0, 0, 0), distance=0.6, count=2))
    >>> views = rc.Views(rc.Rig([camera]), poses, images=("a.jpg", "b.jpg"))
    >>> views.camera() == camera, len(views.poses), views.images
    (True, 2, ('a.jpg', 'b.jpg'))
    """

    rig: Rig | None
    poses: Poses
    images: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    has_unit: bool = True
    camera_names: tuple[str, ...] = ()
    frames: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_kind("poses", self.poses, Poses, "Poses (Poses.of makes them)", PoseError)
        if self.rig is not None:
            check_kind("rig", self.rig, Rig, "a Rig, or None", CameraError)
            self.poses.check_cameras(len(self.rig))
            self.__dict__["camera_names"] = self.rig.names
        elif self.camera_names:
            self.poses.check_cameras(len(self.camera_names))
        for name in ("images", "notes", "camera_names", "frames"):
            words = members(name, getattr(self, name), str, "strings", CameraError)
            self.__dict__[name] = words
        n = len(self.poses)
        for name, words in (("images", self.images), ("frames", self.frames or self.images)):
            if len(words) != n:
                raise PoseError(
                    f"expected {name} to have a name for each of {n} poses, got {len(words)}"
                )

    @typed
    def camera(self, name: str | None = None) -> Camera:
        """The camera of that name; the only one if no name is given.

        Raises
        ------
        CameraError
            If there is none of that name, or several and no name.

        Examples
        --------
        >>> import rastercov as rc
        >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
        >>> poses = rc.Poses.of(rc.sphere_of_poses((0, 0, 0), distance=1, count=2), camera=[0, 1])
        >>> views = rc.Views(rc.Rig([camera, camera.resized(0.5)], ["a", "b"]), poses, ("1", "2"))
        >>> views.camera("b").width, views.of_camera("b").images
        (320, ('2',))
        """
        return self.cameras()[self._index(name)]

    def cameras(self) -> tuple[Camera, ...]:
        """All cameras; CameraError for a file with only poses."""
        if self.rig is None:
            raise CameraError("expected cameras, got only poses; give a camera as well")
        return self.rig.cameras

    @typed
    def of_camera(self, name: str | None = None) -> "Views":
        """Views of one camera: the camera and its poses.

        Without a name it is the only camera that has poses, or the only one. `Poses.ids` and
        `Poses.rejected` still refer to rows of the file.

        Raises
        ------
        CameraError
            For no camera of that name, and for several without a name.
        """
        is_alone = self.rig is not None and name is None and self.n_used == 1
        index = int(self.poses.camera[0]) if is_alone else self._index(name)
        assert self.rig is not None
        rows = np.flatnonzero(self.poses.camera == index)
        return self._with_rows(rows, self.rig._only([index]))

    def _with_rows(self, rows: NDArray[np.intp], rig: "Rig | None") -> "Views":
        """These poses, all of the only camera of a rig; `Poses.rejected` is kept."""
        camera, rejected = np.zeros(len(rows), np.int32), self.poses.rejected
        return replace(
            self,
            rig=rig,
            poses=replace(self.poses[rows], camera=camera, rejected=rejected),
            images=tuple(self.images[row] for row in rows),
            frames=tuple(self.frames[row] for row in rows) if self.frames else (),
        )

    def check_unit(self) -> None:
        """Raise `PoseError` unless lengths are metres."""
        if not self.has_unit:
            raise PoseError(
                "expected poses with a unit, got none; read them with Conventions(pose_unit=), 1 "
                "for metres"
            )

    @typed
    def with_cameras(self, rig: Rig) -> "Views":
        """The same poses, each with the camera of its name in a rig.

        With a rule, poses that name no cameras are taken as poses of the rig.

        Raises
        ------
        PoseError
            Where the poses name no cameras, or one that the rig does not have.
        """
        known = _name_list(rig.names)
        if not self.camera_names and rig.is_one:
            return self._of_rig(rig)
        if not self.camera_names:
            raise PoseError(
                f"expected the camera of each pose, one of {known}, got none; add "
                '"camera" to the pose file, or choose one with --camera-name'
            )
        row_of = {name: row for row, name in enumerate(rig.names)}
        index = np.zeros(len(self.camera_names), np.int32)
        for row in np.unique(self.poses.camera):
            if (name := self.camera_names[row]) not in row_of:
                raise PoseError(
                    f"expected poses of cameras {known}, got camera {shown(name)}; add it, or "
                    "correct the name"
                )
            index[row] = row_of[name]
        poses = replace(self.poses, camera=index[self.poses.camera])
        return replace(self, rig=rig, poses=poses)

    def _of_rig(self, rig: Rig) -> "Views":
        """Poses of all cameras of a rig with a rule, where these are poses of the rig."""
        given, n = self.poses, len(rig)
        ids = (given.ids[:, None] * n + np.arange(n)).ravel()
        placed = rig.poses(given)
        matrices = np.repeat(given.given, n, axis=0)
        matrices[ids] = placed.world_from_camera
        rejected = {row * n + k: text for row, text in given.rejected.items() for k in range(n)}
        poses = Poses(placed.world_from_camera, ids, matrices, rejected, placed.camera)
        images = tuple(f"{image}/{name}" for image in self.images for name in rig.names)
        frames = tuple(np.repeat(self.frames or self.images, n).tolist())
        return replace(self, rig=rig, poses=poses, images=images, frames=frames)

    @typed
    def through(
        self, cameras: "Views", name: str | None = None, *, by_name: bool = False
    ) -> "Views":
        """The same poses with cameras of another file; a rule of theirs stays.

        Parameters
        ----------
        cameras : Views
            Cameras; their notes come before those of the poses.
        name : str, optional
            The camera to take: for the poses that name it, or for all poses where none does. The
            only camera unless given.
        by_name : bool
            Without `name`, take all cameras, each for the poses that name it.

        Raises
        ------
        CameraError, PoseError
            As `of_camera` and `with_cameras` do.
        """
        notes = (*cameras.notes, *self.notes)
        if by_name and name is None:
            cameras.cameras()  # refuses poses alone
            assert cameras.rig is not None
            placed, rig = self.with_cameras(cameras.rig), self.rig
            if rig is not None and rig.gates and not cameras.rig.gates:
                for each, camera in zip(cameras.rig.names, cameras.rig.cameras, strict=True):
                    rig = rig._with_camera(each, camera)
                placed = replace(self, rig=rig)
            return replace(placed, notes=notes)
        chosen = cameras.of_camera(name)
        rows = np.arange(len(self.poses))
        if name in self.camera_names:
            rows = np.flatnonzero(self.poses.camera == self.camera_names.index(name))
        elif self.rig is not None and self.rig.gates:
            known = [self.camera_names[row] for row in np.unique(self.poses.camera)]
            raise CameraError(
                f"expected a camera for each of a rig with a rule, {_name_list(known)}, got one; "
                "name them"
            )
        return replace(self._with_rows(rows, chosen.rig), notes=notes)

    @property
    def n_used(self) -> int:
        """Number of cameras that have poses."""
        return len(np.unique(self.poses.camera))

    def _index(self, name: str | None) -> int:
        n = len(self.cameras())
        assert self.rig is not None
        if name is None and n == 1:
            return 0
        known = _name_list(self.rig.names)
        if name is None:
            raise CameraError(
                f"expected one of {n} cameras, {known}, got no name; choose one with --camera-name"
            )
        if name not in self.rig.names:
            raise CameraError(f"expected camera name to be one of {known}, got {shown(name)}")
        return self.rig.names.index(name)


def _name_list(names: Sequence[str]) -> str:
    """Names for a message, at most `MOST_NAMES`."""
    return first_of(list(map(shown, names)), MOST_NAMES)
