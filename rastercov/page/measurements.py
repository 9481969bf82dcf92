"""Coverage of faces by each camera of a viewer, measured once and kept while there is room.

Only a camera that moved, or whose lens changed, is measured again; another threshold measures all
of them. `NetworkFigures` adds up what the stations of a state cover, with the exact area where the
thresholds are of points. `why` is the reason of one face: what each camera gets of it, what hides
it, and what would help.
"""

import math
from collections import OrderedDict
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from rastercov.base import (
    TINY,
    BoolArray,
    ByName,
    ByteArray,
    ConfigError,
    Float32Array,
    FloatArray,
    IntArray,
    dots,
    frozen_record,
    norm,
    percent,
    read_only,
    with_bound,
)
from rastercov.base.format import area, number
from rastercov.core.area import polygons
from rastercov.core.area.advice import (
    advice,
    depth_in_words,
    general_advice,
    hidden_by,
    verdict_of,
    verdict_of_rigs,
)
from rastercov.core.area.feature import PointCondition
from rastercov.core.area.features import (
    conditions_at,
    deviations_of,
    device_of,
    values_of,
)
from rastercov.core.area.network import AreaNetwork, unit_of_result
from rastercov.core.area.regions import RegionPass
from rastercov.core.area.rows import rule_reasons, with_rule
from rastercov.core.area.stages import first_failures
from rastercov.core.area.table import Regions, join, take_rows
from rastercov.core.area.zones import DeadZones
from rastercov.core.camera import (
    Camera,
    Poses,
    Rig,
    equipment_words,
    led_by,
    rows_of_result,
)
from rastercov.core.coverage.coverage import Observer, evaluate_batches, in_batches, open_observer
from rastercov.core.coverage.evaluation import lose_without
from rastercov.core.coverage.network import ViewSpread, share_of_faces
from rastercov.core.coverage.task import (
    CONDITIONS,
    NAMES,
    REASONS,
    UNCERTAIN,
    Engine,
    Reason,
    Task,
    check_equipment,
    density_text,
    fails,
    nearer,
    nearness,
    reason_rows,
)
from rastercov.core.mesh import Mesh
from rastercov.engine.coverage_spread import widest_angles
from rastercov.page.rig_state import RigState, Station
from rastercov.report.live import POINTS_OF_FACE
from rastercov.report.modes import OF_EQUIPMENT, OF_GATES, OfCameras, OfUnit, of_devices
from rastercov.report.pages import figures_of
from rastercov.report.theme import camera_colours

MOST_BYTES = 1 << 30
"""Memory for rows that the present state does not need."""
BYTES_A_FACE = 14
"""Of a row."""
MOST_OBSERVERS = 8
"""Cameras that are kept ready to measure."""
MOST_JUDGED = 1_000
"""Poses of cameras whose conditions are kept."""
MOST_PAIRS = 4_000_000
"""Pairs of a face and a camera whose regions are kept: 1 GB with their union."""
LIVE_PAIRS = 1_000_000
"""Pairs up to which the exact area follows a drag: half a second."""
ROUGH = "exact when no camera moves"
"""Reason for which figures are of whole faces during a drag."""
FIELDS = ("coverage", "reason", "pixel_density", "facing_density")

Key = tuple[Camera, bytes, Task]


@frozen_record
class CameraFaces:
    """Coverage of faces by one camera; arrays are (F,).

    Attributes
    ----------
    coverage : float32
        (3.6).
    reason : uint8
        `rastercov.Reason`.
    density, facing : float32
        Pixels a metre along the worst direction, on the surface and of a target that faces the
        camera.
    fails : uint8 or None
        Reason of a condition at the centroid, `COVERED` where all hold; None without equipment.
    """

    coverage: Float32Array
    reason: ByteArray
    density: Float32Array
    facing: Float32Array
    fails: ByteArray | None = None

    @cached_property
    def covers(self) -> BoolArray:
        """(F,) faces that the camera covers, where conditions hold."""
        return self.failed == Reason.COVERED

    @cached_property
    def failed(self) -> ByteArray:
        """(F,) reason of each face, or of a condition where the camera covers it."""
        if self.fails is None:
            return self.reason
        return np.where(self.reason == Reason.COVERED, self.fails, self.reason)


@frozen_record
class StationAreas:
    """Exact area that the stations of a state cover together.

    Attributes
    ----------
    network : AreaNetwork
    state : RigState
    poses, stations : Poses, tuple of Station
        Those that count: cameras, and rigs with a rule all of whose cameras are on.
    seen, lost : (N,) float64, or None
        m^2 that each of them, or its rig, covers, and that is not covered without it, which is
        not known of more than `MOST_PAIRS`, and with an angle between views.
    """

    network: AreaNetwork
    state: RigState
    poses: Poses
    stations: tuple[Station, ...]
    seen: FloatArray | None = None
    lost: FloatArray | None = None

    @property
    def zones(self) -> DeadZones:
        """Zones that too few cameras cover."""
        return self.network.zones(self.state.whole, self.poses, self.state.needed)

    def dead_zones(self) -> ByName:
        """The same with reasons, ready for JSON."""
        return self.network.dead_zones(self.state.whole, self.poses, self.state.needed)

    def summary(self) -> ByName:
        """Covered area, ready for JSON."""
        return self.network.summary(self.state.needed)


class Measurements:
    """Rows of cameras at their poses, measured on demand; one thread at a time may use it.

    `by` is the unit of results, as of `evaluate`. ConfigError for a method that does not exist.
    """

    def __init__(self, mesh: Mesh, method: str = "certified", by: str | None = None) -> None:
        self.mesh, self.method, self.by = mesh, method, by
        self._engine = Engine.of(method)  # refuses what is no method before anything is served
        self._observers: OrderedDict[Camera, Observer] = OrderedDict()
        self._rows: OrderedDict[Key, CameraFaces] = OrderedDict()
        self._regions: OrderedDict[Key, Regions] = OrderedDict()
        self._finder: tuple[Rig, RegionPass] | None = None
        self._conditions: tuple[Any, list[PointCondition], dict[Any, ByteArray]] | None = None
        self.progress = [0, 0]  # poses measured of those that an answer needs now, and their number

    def rows(self, state: RigState, stations: Sequence[Station]) -> list[CameraFaces]:
        """Row of each of some stations of a state."""
        keys = [
            (state.camera_of(each), each.pose.tobytes(), state.task_of(each.camera))
            for each in stations
        ]
        missing: dict[tuple[Camera, Task], dict[Key, FloatArray]] = {}
        for key, station in zip(keys, stations, strict=True):
            if key not in self._rows:
                missing.setdefault((key[0], key[2]), {})[key] = station.pose
        self.progress = [0, sum(map(len, missing.values()))]
        for (camera, task), poses in missing.items():
            self._measure(camera, task, poses)
        self.progress = [0, 0]
        result = [self._rows[key] for key in keys]
        for key in keys:
            self._rows.move_to_end(key)
        kept = max(MOST_BYTES // (BYTES_A_FACE * self.mesh.n_faces), len(set(keys)))
        while len(self._rows) > kept:  # those that were used longest ago go
            self._rows.popitem(last=False)
        if not state.whole.equipment:
            return result
        return [
            replace(row, fails=fails, coverage=np.where(fails == Reason.COVERED, row.coverage, 0))
            for row, station in zip(result, stations, strict=True)
            for fails in [self.fails(state, station.camera, station.pose)]
        ]

    def areas(self, state: RigState) -> StationAreas:
        """Exact area that the stations of a state that are on cover.

        Raises
        ------
        ConfigError
            Where a result is by face: for a threshold of a face or of pairs of poses.
        """
        poses, stations = state.cameras_that_count()
        unit, why = unit_of_result(self.by, state.task, self._engine, None, len(poses))
        if unit == "face":
            raise ConfigError(why.partition(";")[0] or "results per face were requested")
        rig, task, n = state.whole, replace(state.task, views=state.most_views), len(poses)
        if self._finder is None or self._finder[0] is not rig or self._finder[1].task != task:
            self._finder = rig, RegionPass(self.mesh, rig, task, method=self._engine)
        finder, network = self._finder[1], AreaNetwork(self.mesh, task)
        rows = rows_of_result(rig, poses)
        is_kept, done = n * self.mesh.n_faces <= MOST_PAIRS and not task.min_angle_deg, 0
        seen: list[FloatArray] = []
        parts: list[Regions] = []
        for part in in_batches(poses, self.mesh.n_faces, finder.threads, rows):
            self.progress = [done, n]
            own = self._keep_regions(finder, state, part) if is_kept else finder.find(part)
            regions = with_rule(own, rig, part)
            network.add(regions)
            own_m2 = np.bincount(regions.pair_pose, regions.area, len(regions.pose_ids))
            seen.append(own_m2.astype(np.float64))
            parts += [regions] if is_kept else []
            done += len(part)
        self.progress = [0, 0]
        if not n:
            return StationAreas(network, state, poses, stations)
        lost = lose_without(join(parts), state.need(self.mesh))[rows] if is_kept else None
        return StationAreas(network, state, poses, stations, np.concatenate(seen)[rows], lost)

    def _keep_regions(self, finder: RegionPass, state: RigState, poses: Poses) -> Regions:
        """Regions of poses of the cameras of a state, each found once."""
        keys: list[Key] = []
        for row, pose in zip(poses.camera.tolist(), poses.world_from_camera, strict=True):
            name = state.whole.names[row]
            keys.append((state.cameras[name], pose.tobytes(), state.task_of(name)))
        new = [row for row, key in enumerate(keys) if key not in self._regions]
        if new:
            copy = replace(finder.find(poses[np.array(new)]), conditions=())
            for at, row in enumerate(new):
                self._regions[keys[row]] = take_rows(copy, np.array([at]))
        for key in keys:
            self._regions.move_to_end(key)
        while len(self._regions) > MOST_PAIRS // self.mesh.n_faces:
            self._regions.popitem(last=False)
        if not keys:
            return finder.find(poses)
        every = join([self._regions[key] for key in keys])
        every = replace(every, camera=finder.camera, task=finder.task, conditions=finder.conditions)
        return replace(every, pose_ids=poses.ids)

    def fails(self, state: RigState, camera: str, pose: FloatArray) -> ByteArray:
        """(F,) reason of conditions of what a camera sees at a pose, `COVERED` where all hold."""
        names, mesh = tuple(state.cameras), self.mesh
        key = state.whole.equipment, state.task, names
        faces = np.flatnonzero(mesh.task_mask & ~mesh.degenerate_mask)
        if self._conditions is None or self._conditions[0] != key:
            points = mesh.centroids[faces]
            on = mesh, state.rig(), state.task, points, faces
            check_equipment(*on[1:3])
            self._conditions = key, conditions_at(*on), {}
        _, conditions, known = self._conditions
        place = camera, pose.tobytes()
        if place not in known:
            values = np.full(mesh.n_faces, Reason.COVERED, np.uint8)
            for judge in conditions if len(faces) else ():
                own = judge.reasons(Poses.of(pose[None], camera=[names.index(camera)]))
                values[faces] = np.where(values[faces] == Reason.COVERED, own, values[faces])
            while len(known) >= MOST_JUDGED:
                del known[next(iter(known))]
            known[place] = values
        return known[place]

    def observer(self, camera: Camera) -> Observer:
        """An open observer; it stays open while it is among the last that were used."""
        if camera not in self._observers:
            self._observers[camera] = open_observer(self.mesh, camera, self.method)
        self._observers.move_to_end(camera)
        while len(self._observers) > MOST_OBSERVERS:
            self._observers.popitem(last=False)[1].close()
        return self._observers[camera]

    def close(self) -> None:
        """Give back the observers."""
        with ExitStack() as closing:
            if self._finder is not None:
                closing.callback(self._finder[1].close)
            for each in self._observers.values():
                closing.callback(each.close)
            self._observers.clear()
            self._finder = None

    def _measure(self, camera: Camera, task: Task, poses: dict[Key, FloatArray]) -> None:
        keys = iter(poses)
        matrices = Poses.of(np.array(list(poses.values())))
        for batch in evaluate_batches(self.observer(camera), matrices, task, fields=FIELDS):
            for reason, *figures in zip(
                batch.reason, batch.coverage, batch.pixel_density, batch.facing_density, strict=True
            ):
                coverage, *densities = (each.astype(np.float32) for each in figures)
                self._rows[next(keys)] = CameraFaces(coverage, reason.copy(), *densities)
            self.progress[0] += len(batch.pose_ids)


class NetworkFigures:
    """Coverage of faces by the stations of a state that are on; arrays are (F,).

    Attributes
    ----------
    state : RigState
    rows : list of CameraFaces
        Of the stations that are on, in their order.
    heads, of_heads : list of Head, list of CameraFaces
        Heads and single cameras that count, and their rows.
    sights : (H, 3) float64
        Points that these see from, by their first sensors.
    views : int32
        Heads and cameras that cover the face.
    need : int64
        Cameras that must cover it.
    best : float32
        Greatest coverage.
    best_row : int32
        Row in `heads` of what gives it, -1 where it is 0.
    reason : uint8
        `Reason` of what came nearest to covering the face.
    covered : bool
        Faces that enough cameras cover, from directions that differ as asked.
    areas : Areas or None
        Exact area, where the result is by area.
    by_face_because : str
        Why it is by face, "" by area.
    """

    def __init__(
        self,
        mesh: Mesh,
        state: RigState,
        rows: list[CameraFaces],
        areas: StationAreas | None = None,
        by_face_because: str = "",
    ) -> None:
        self.mesh, self.state, self.rows = mesh, state, rows
        self.areas, self.by_face_because = areas, by_face_because
        n, task = mesh.n_faces, state.task
        self.views = np.zeros(n, np.int32)
        self.best = np.zeros(n, np.float32)
        self.best_row = np.full(n, -1, np.int32)
        self.reason = np.zeros(n, np.uint8)
        spread = ViewSpread(mesh.centroids, math.radians(task.min_angle_deg))
        self.heads = [each for each in state.heads if each.counts]
        place = {each.id: at for at, each in enumerate(state.on)}
        self._own = [[place[each.id] for each in head.stations] for head in self.heads]
        self.sights = state.sights[np.array([own[0] for own in self._own], int)]
        self.of_heads = self._join_rows() if state.whole.gates else rows
        for index, (eye, row) in enumerate(zip(self.sights, self.of_heads, strict=True)):
            self.views += row.covers
            better = row.coverage > self.best
            self.best[better] = row.coverage[better]
            self.best_row[better] = index
            self.reason = nearer(self.reason, row.failed)
            if task.min_angle_deg > 0:
                spread.add(eye, np.flatnonzero(row.covers))
        self.need = state.need(mesh)
        self.covered = (self.views >= self.need) & spread.is_spread

    @property
    def values(self) -> dict[str, Callable[[], Any]]:
        """Values of the modes of `rastercov.report.modes` that colour by the whole network."""
        return {
            "reason": lambda: self.reasons,
            "coverage": lambda: self.best,
            "camera": self._cameras,
            "views": lambda: self.views,
            "density": lambda: OfUnit(self._best("density"), f"px/{self.state.unit}"),
            "level": lambda: self._best("facing"),
            "incidence": self._least_incidence,
            "angle": self.widest_angle,
            "device": self._devices,
            **dict.fromkeys(OF_GATES, lambda: OfUnit(1e6 * self._judged[2], "um")),
            **{name: partial(self._of_feature, name) for name in OF_EQUIPMENT},
        }

    @cached_property
    def reasons(self) -> ByteArray:
        """(F,) row of `rastercov.core.coverage.task.REASONS`."""
        return reason_rows(self.reason, self.covered, len(self.heads))

    def _cameras(self) -> OfCameras:
        """The camera or head that covers each face best; the first of equals."""
        every = camera_colours(max(1, len(self.state.heads)))
        row = np.where(self.views > 0, self.best_row, -1)
        counts = [each.counts for each in self.state.heads]
        return OfCameras(row, [each.name for each in self.heads], every[: len(counts)][counts])

    def _join_rows(self) -> list[CameraFaces]:
        """A row for each head: the best of its sensors on faces that its rule covers."""
        return [
            _join_sensors([self.rows[row] for row in own], reason)
            for own, reason in zip(self._own, self._judged[0], strict=False)  # one more for none
        ]

    @cached_property
    def _judged(self) -> tuple[IntArray, IntArray, FloatArray, tuple[str, ...]]:
        """Reasons of each face for each of H heads, sensors, both (H, F), deviations, and names.

        Rows of `REASONS`, and of the names; -1 for no sensor. Each sensor is judged by its reason
        of the face, and the angle and uncertainty are those at its centroid. The deviation, (F,),
        is the largest at the corners by heads that measure the face, metres; 0 for none.
        """
        mesh, rig, worst = self.mesh, self.state.whole, np.zeros(self.mesh.n_faces)
        if all(len(own) < 2 for own in self._own):
            none = np.zeros((len(self._own) + 1, mesh.n_faces), int)
            return none, none - 1, worst, ()
        poses, _ = self.state.cameras_that_count()
        own = np.array([self.rows[row].reason for some in self._own for row in some])
        result, row = rule_reasons(own, rig, poses, mesh.centroids, mesh.normals)
        reason, device = result.astype(np.int64), poses.camera[row].astype(np.int64)
        device[row < 0] = -1
        for at, lead in enumerate(led_by(rig, poses).tolist()):
            faces = np.flatnonzero(reason[at] == Reason.COVERED)
            corners = mesh.vertices[mesh.faces[faces]].reshape(-1, 3)
            of_head = poses[lead : lead + len(self._own[at])]
            if (most := deviations_of(rig, of_head, corners)) is not None:
                worst[faces] = np.maximum(worst[faces], most.reshape(-1, 3).max(axis=1, initial=0))
        return reason, device, worst, rig.names

    @property
    def failing(self) -> tuple[IntArray, IntArray, tuple[str, ...]]:
        """Reason of each face for the rig that comes nearest, its device, (F,), and their names."""
        reason, device, _, names = self._judged
        best, every = nearness(reason).argmax(axis=0), np.arange(self.mesh.n_faces)
        return reason[best, every], device[best, every], names

    def _devices(self) -> OfCameras:
        """The device for which each face is not measured."""
        reason, device, names = self.failing
        n = len(names)  # the conditions follow the devices
        row = np.where(device < 0, n + (reason == UNCERTAIN), device)
        row = np.where(reason == Reason.COVERED, n + len(CONDITIONS), row)
        return of_devices(row if names else device, [*map(fails, (*names, *CONDITIONS))])

    def _of_feature(self, name: str) -> object:
        """Values of faces by the mode of a feature."""
        values = values_of(self.mesh, self.state.rig(), self.state.task)
        if name not in values:
            words = " or ".join(f"--{word}" for word in equipment_words())
            raise ConfigError(f"expected equipment for mode {name}, got none; give {words}")
        return values[name]

    def _best(self, name: str) -> Float32Array:
        """Greatest of a density of `CameraFaces` by a camera that covers the face, px/m."""
        best = np.zeros(self.mesh.n_faces, np.float32)
        for row in self.of_heads:
            np.maximum(best, np.where(row.covers, getattr(row, name), np.float32(0)), out=best)
        return best

    def _least_incidence(self) -> FloatArray:
        """Least angle of incidence at which a camera covers each face; see `by_incidence`."""
        mesh, least = self.mesh, np.full(self.mesh.n_faces, np.inf)
        for eye, row in zip(self.sights, self.of_heads, strict=True):
            away = eye - mesh.centroids
            against = np.abs(dots(away, mesh.normals))
            cosine = against / np.maximum(norm(away), TINY)
            angle = np.degrees(np.arccos(np.minimum(cosine, 1.0)))
            least[row.covers] = np.minimum(least, angle)[row.covers]
        return least

    def widest_angle(self) -> FloatArray:
        """Greatest angle between rays to two cameras that cover the face, degrees; 0 for none."""
        n, points = self.mesh.n_faces, read_only(self.mesh.centroids, np.float64)
        covers = np.array([row.covers for row in self.of_heads]).reshape(-1, n)
        face, camera = np.nonzero(covers.T)
        starts, widest = np.searchsorted(face, np.arange(n + 1)), np.zeros(n)
        widest_angles(starts, camera.astype(np.int32), points, self.sights, widest)
        return np.where(self.views > 1, np.degrees(widest), 0.0)

    def summary(self) -> ByName:
        """Figures of the network and of its stations, ready for JSON; see `pages.figures_of`."""
        mesh, task_faces, areas = self.mesh, self.mesh.task_mask, np.asarray(self.mesh.areas)
        network: ByName = {
            "covered": share_of_faces(mesh, task_faces & self.covered, task_faces),
            "by_face_because": self.by_face_because,
        }
        total = max(float(areas[task_faces].sum()), TINY)
        if (exact := self.areas) is not None:
            network["covered_area"] = exact.summary()
            stations, nothing = exact.stations, np.zeros(len(exact.stations))
            ids = [each.id for each in stations]
            return figures_of(network, nothing, exact.seen, exact.lost, total, ids)
        single = self.views == 1
        covers = (row.covers & task_faces for row in self.rows)
        own = [(each.sum(), areas[each].sum(), areas[each & single].sum()) for each in covers]
        faces, seen, lost = np.array(own).reshape(-1, 3).T
        return figures_of(network, faces, seen, lost, total, [each.id for each in self.state.on])


def _join_sensors(rows: Sequence[CameraFaces], reason: ByteArray) -> CameraFaces:
    """Row of a head by the reason of its rule, and the best of its sensors where that covers."""
    if len(rows) < 2:
        return rows[0]
    result = replace(rows[0], reason=reason.astype(np.uint8))
    best = {
        name: np.max([np.where(row.covers, getattr(row, name), 0) for row in rows], axis=0)
        for name in ("coverage", "density", "facing")
    }
    return replace(result, **{name: each * result.covers for name, each in best.items()})


OF_A_FACE = (
    "coverage",
    "reason",
    "visibility",
    "visibility_bound",
    "drawn_pixels",
    "incidence",
    "pixel_density",
    "facing_density",
    "in_view_fraction",
)
"""Figures that say why a camera does not cover a face."""


def why(measurements: Measurements, figures: NetworkFigures, face: int) -> ByName:
    """Reason of a face in each camera that is on, ready for JSON.

    `cameras` are in the order of the stations; `occluder` is the group that hides most of the
    face's image (`rastercov.placement.uncovered`), where the face is hidden.

    Raises
    ------
    ConfigError
        For a face that does not exist.
    """
    mesh = measurements.mesh
    if not 0 <= face < mesh.n_faces:
        raise ConfigError(
            f"expected a face index from 0 to {mesh.n_faces - 1}, got {face}; correct it"
        )
    state, group = figures.state, mesh.groups[mesh.face_group[face]]
    asked = [] if group.is_occluder else state.on
    return {
        "face": face,
        "group": group.name,
        "area": float(mesh.areas[face]),
        "centre": mesh.centroids[face].tolist(),
        "normal": mesh.normals[face].tolist(),
        "words": _words(mesh, figures, face),
        "cameras": [_of_station(measurements, figures, each, face) for each in asked],
    }


def _words(mesh: Mesh, figures: NetworkFigures, face: int) -> str:
    """One line on the face."""
    size = area(float(mesh.areas[face]), figures.state.unit)
    if not mesh.task_mask[face]:
        return f"Occluder of {size}: not evaluated."
    task = figures.state.task
    reason, device, names = figures.failing
    if names:
        why = "" if reason[face] == Reason.COVERED else REASONS[NAMES[reason[face]]].label
        return verdict_of_rigs(size, names[device[face]] if device[face] >= 0 else "", why)
    return verdict_of(
        size,
        int(figures.views[face]),
        int(figures.need[face]),
        len(figures.heads),
        REASONS[NAMES[figures.reasons[face]]].label,
        is_covered=bool(figures.covered[face]),
        apart=f" at least {task.min_angle_deg:g} deg apart" if task.min_angle_deg > 0 else "",
    )


def _of_station(
    measurements: Measurements, figures: NetworkFigures, station: Station, face: int
) -> ByName:
    """Figures of the face in one camera."""
    mesh, state = measurements.mesh, figures.state
    camera, task = state.camera_of(station), state.task_of(station.camera)
    observer = measurements.observer(camera)
    batch = next(evaluate_batches(observer, station.pose[None], task, fields=OF_A_FACE))
    table = {name: float(getattr(batch, name)[0, face]) for name in OF_A_FACE}
    name = NAMES[int(table["reason"])]
    depth = (mesh.vertices[mesh.faces[face]] - station.pose[:3, 3]) @ station.pose[:3, 2]
    table["distance"] = float(norm(mesh.centroids[face] - station.pose[:3, 3]))
    words, (row,) = REASONS[name].label, measurements.rows(state, [station])
    failed = int(row.failed[face])
    occluder = _occluder(mesh, camera, station, face) if "occluded" in name else None
    if occluder is not None:
        own = occluder["group"] == mesh.face_group[face]
        words = hidden_by(words, "its own group" if own else occluder["name"], occluder["share"])
    visible, bound = table["visibility"], table["visibility_bound"]
    facing = table["facing_density"]
    entries = {
        "visible fraction": with_bound(100 * visible, 100 * bound),
        "coverage score": f"{table['coverage']:.3g}",
        "pixels without occlusion": f"{number(table['drawn_pixels'])} px",
        "angle of incidence": f"{math.degrees(table['incidence']):.3g}°",
        "pixel density": density_text(table["pixel_density"], f"px/{state.unit}", facing),
        "facing density": density_text(facing, f"px/{state.unit}"),
        "depth": depth_in_words(depth, state.unit),
        "inside the image": percent(table["in_view_fraction"]),
    }
    hider = "" if occluder is None else occluder["name"]
    if figures.areas is not None:
        table["drawn_pixels"] = 0.0  # a result by area does not ask for pixels of whole faces
    tip = advice(name, table, depth, task, camera, hider, state.unit)
    rig = state.rig()
    lead = Poses.of(station.pose[None], camera=[rig.names.index(station.camera)])
    device = device_of(rig, lead, mesh.centroids[face], mesh.normals[face], failed)
    if device is not None:
        name = NAMES[failed]
        words = f"{REASONS[name].label} ({REASONS[name].nearest}{device})"
        tip = general_advice(name)
    return {
        "station": station.id,
        "name": station.name,
        "reason": name,
        "words": words,
        "help": tip,
        "figures": [{"label": label, "value": value} for label, value in entries.items()],
        "occluder": occluder,
    }


def _occluder(mesh: Mesh, camera: Camera, station: Station, face: int) -> ByName | None:
    """Group that hides most of some points of a face; None where nothing hides one."""
    faces = np.full(POINTS_OF_FACE, face)
    on = polygons.points_on(mesh, faces), faces
    ((_, hiders),) = first_failures(mesh, camera, Task(), station.pose[None], *on)
    hidden = np.bincount(mesh.face_group[hiders[hiders >= 0]], minlength=len(mesh.groups))
    group = int(hidden.argmax())
    if not hidden[group]:
        return None
    return {
        "group": group,
        "name": mesh.groups[group].name,
        "share": int(hidden[group]) / POINTS_OF_FACE,
    }
