"""The question that `evaluate` asks, and its result.

A `Query` asks which part of a surface cameras cover, by a task; it is checked once, before the
work. An `Evaluation` has figures of all cameras together, of each camera (`ByCamera`), and of each
pair of pose and face. A point counts for a camera where any of its poses covers it, however many
views the task requires of all cameras together.

Phases of a scene are such as frames in which its bodies move; a feature may ask for them. What is
covered is counted over all phases. Regions of each are on the mesh of the query, which is the scene
at rest.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    AnyArray,
    BoolArray,
    ByName,
    ConfigError,
    FloatArray,
    IntArray,
    ReadByName,
    check_kind,
    frozen_record,
    matmul,
    shown,
    thread_count,
)
from rastercov.base.typed import guard_class
from rastercov.core.area import polygons
from rastercov.core.area.features import FEATURES, narrow
from rastercov.core.area.network import AreaNetwork, unit_of_result
from rastercov.core.area.polygons import to_world
from rastercov.core.area.regions import RegionPass, covering_poses
from rastercov.core.area.rows import with_rule
from rastercov.core.area.table import Regions
from rastercov.core.area.union import Covered, unite
from rastercov.core.camera import (
    Cameras,
    Poses,
    cameras_of,
    check_scene,
    equipment_on,
    equipment_words,
    is_joint,
    led_by,
    names_of,
)
from rastercov.core.camera.rig import phased_features, with_equipment
from rastercov.core.coverage.coverage import Coverage, arrays_for
from rastercov.core.coverage.doubts import dead_pixels, find_warnings
from rastercov.core.coverage.face_pass import NO_FIGURES, FacePass
from rastercov.core.coverage.judging import JudgedPoses
from rastercov.core.coverage.network import Network, share_of_faces
from rastercov.core.coverage.shards import is_long, provenance_of
from rastercov.core.coverage.task import Engine, Task
from rastercov.core.coverage.visibility import GroupViews, group_views
from rastercov.core.mesh import Mesh
from rastercov.core.raster.contract import COVERED, CoverageBits, FaceCounts
from rastercov.shards import Staff

if TYPE_CHECKING:
    from rastercov import OverTime

FIGURES = [each.figures for each in FEATURES]
"""Further figures, of features."""
LEAST_LOST_REL = 1e-9
"""Area, relative to the task, below which a camera could be left out: rounding of the union."""
MOST_CAMERAS = 64
"""Cameras with figures of their own; they take 50 bytes per face and camera."""


def cameras_apart(camera: Cameras, poses: Poses) -> list[int]:
    """Indices of the cameras with figures of their own: none for one camera, or too many."""
    if len(cameras_of(camera)) == 1:
        return []
    used: list[int] = np.unique(poses.camera).tolist()
    return used if len(used) <= MOST_CAMERAS else []


class ByCamera:
    """Figures per camera; of none if there is one camera, or too many.

    A point, or a face, counts for a camera where any of its poses covers it, however many views the
    task requires of all cameras together.

    Parameters
    ----------
    mesh, task, camera
        As of the network of all cameras.
    poses : Poses
        All of the run.
    by_area, by_face : bool
        Whether there are figures of areas, and of faces.
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
        of_several = is_joint(camera)
        if indices or of_several:
            task = replace(task, views=1, min_angle_deg=0.0)
        self._areas = {index: AreaNetwork(mesh, task) for index in indices if by_area}
        self._networks = {index: Network(mesh, task) for index in indices if by_face}
        new = partial(AreaNetwork, mesh, task)
        self._further = [
            each(new, camera, task, indices) for each in FIGURES if by_area and of_several
        ]

    @property
    def is_asked(self) -> bool:
        """True if faces have figures by camera."""
        return bool(self._networks)

    def closed_by_camera(self, closed: BoolArray) -> BoolArray:
        """Those of some faces, (F,) bool, that no camera needs regions of any more.

        None where figures of a feature need the regions of all.
        """
        if any(each.needs_all for each in self._further):
            return np.zeros_like(closed)
        further = (areas for each in self._further for areas in each.networks())
        for areas in (*self._areas.values(), *further):
            closed = closed & areas.closed
        return closed

    def add(self, regions: Regions, poses: Poses) -> None:
        """Add the regions of further poses."""
        camera = poses.camera
        for index, areas in self._areas.items():
            if (own := camera == index).any():
                areas.add(regions.of_poses(own))
        for each in self._further:
            each.add(regions, self._camera, poses)

    def add_batch(self, batch: JudgedPoses) -> None:
        """Add a batch of poses, with their regions if the result is by area."""
        for index, network in self._networks.items():
            network.add(batch, index)
        if batch.regions is not None:
            self.add(batch.regions, batch.poses)

    @property
    def of_faces(self) -> dict[str, FloatArray]:
        """(2, F) further figures of faces and their bounds by names with units; see `Figures`."""
        return {name: own for each in self._further for name, own in each.of_faces().items()}

    def summary(self) -> list[ByName]:
        """Figures of each camera, ready for JSON."""
        items = []
        for index, network in self._networks.items():
            mesh, task = network.mesh, network.mesh.task_mask
            covered = share_of_faces(mesh, network.covered & task, task)
            entry = {"camera": self.names[index], "poses": len(network.pose_ids)}
            items.append(entry | {"covered": covered} | self.entry(index))
        return items

    def further(self) -> ByName:
        """Entries of further figures of features, ready for JSON."""
        every = (each.summary(lambda at: self._areas[at].summary()) for each in self._further)
        return {name: own for some in every for name, own in some.items()}

    def entry(self, index: int) -> ByName:
        """Entry `covered_area` of a camera, ready for JSON; none where it has no areas."""
        return {"covered_area": self._areas[index].summary()} if index in self._areas else {}


def lines_of(summary: ReadByName) -> list[str]:
    """Lines on further figures, such as what is lost by one camera alone; often none."""
    return [line for each in FIGURES for line in each.lines(summary)]


def warnings_of(summary: ReadByName) -> list[str]:
    """Warnings about further figures."""
    return [line for each in FIGURES for line in each.doubts(summary)]


def lose_without(parts: Regions, need: IntArray) -> FloatArray:
    """(P,) area that too few cameras cover without each one; `need`, (F,), are those wanted."""
    covered = unite(parts, int(need.max(initial=1)) + 1)
    tight = np.flatnonzero(covered.views == need[covered.face])
    xy, starts = polygons.choose_polygons(covered.xy, covered.starts, tight)
    areas, face = polygons.polygon_areas(xy, starts), covered.face[tight]
    points = to_world(parts.mesh, face, polygons.centroids(xy, starts, np.maximum(areas, 1e-300)))
    return matmul(areas, covering_poses(parts, face, points))


MOST_IMAGES = 10_000
"""Phases times cameras whose regions are held at once."""


class Phases(Protocol):
    """Phases of a scene, and the number of them in which a point must be covered."""

    def check(self, mesh: Mesh, camera: Cameras, poses: Poses, task: Task) -> None:
        """Raise `ConfigError` for phases of another mesh, and for what does not go with them."""

    def check_motion(self, placed: Poses) -> None:
        """Raise `ConfigError` for more than `MOST_IMAGES`."""

    def images(self, placed: Poses) -> int:
        """Number of images of placed cameras."""

    def regions(self, camera: Cameras, placed: Poses, task: Task, engine: Engine) -> Regions:
        """Regions of rows of cameras, phase after phase."""

    def network(
        self, scene: tuple[Cameras, Poses, Task], engine: Engine, folder: Path | None, staff: Staff
    ) -> AreaNetwork:
        """Area that is covered in enough phases, by way of shards in a folder if one is given."""


def question_in(summary: ReadByName) -> ReadByName:
    """Entry on phases of a summary; empty where the scene has one."""
    return next((summary[each.key] for each in phased_features() if each.key in summary), {})


OF_COMMANDS = {
    "skip_bad_poses": "give Poses.of(poses, skip_bad=True)",
    "threads": "give method=Engine(METHOD, threads=N)",
    "workers": "give shards=(FOLDER, workers)",
}
"""Options of commands, and what to give in Python."""


def asked(
    mesh: Mesh, camera: Cameras, task: Task | None, given: Mapping[str, object]
) -> tuple[Cameras, Task, Phases | None]:
    """Cameras, task and phases by the arguments of features; ConfigError for other arguments."""
    task, phases = Task() if task is None else task, None
    if given:
        left, words = dict(given), equipment_words()
        camera = with_equipment(camera, {word: left.pop(word, None) for word in words}, mesh)
        for each in phased_features():
            if (value := left.pop(each.word, None)) is not None:
                phases = each.phases_of(mesh, value)
        for name in left:
            known = ", ".join([*(each.word for each in phased_features()), *words])
            advice = "give it in task" if hasattr(Task, name) else "correct the name"
            raise ConfigError(
                f"expected further arguments {known}, got {shown(name)}; "
                f"{OF_COMMANDS.get(name, advice)}"
            )
    return camera, narrow(camera, task) if equipment_on(camera) else task, phases


@frozen_record
class Query:
    """Scene, cameras, poses and task of an evaluation.

    Attributes
    ----------
    camera : Camera, Rig or sequence of Camera
        With equipment on which it depends what they see.
    phases : Phases or None
        Those of the scene, whose mesh is at rest.
    by : {"area", "face"} or None
        Unit that is asked for.
    by_area : bool
        Basis of the result; see `unit_of_result` for the choice, and for errors.
    by_face_because : str
        Why the result is by face, where that was not requested.
    """

    mesh: Mesh
    camera: Cameras
    poses: Poses
    task: Task
    engine: Engine = field(default_factory=Engine)
    phases: Phases | None = None
    by: str | None = None
    by_area: bool = field(init=False)
    by_face_because: str = field(init=False)

    def __post_init__(self) -> None:
        task = self.task
        self.poses.check_cameras(len(cameras_of(self.camera)))
        unit, why = unit_of_result(self.by, task, self.engine, self.camera, len(self.poses))
        self.__dict__.update(by_area=unit == "area", by_face_because=why)
        if self.phases is not None:
            self.phases.check(self.mesh, self.camera, self.poses, task)
            if not self.by_area:
                raise ConfigError(
                    "expected a result by area, got one by face; " + (why or "leave out 'by'")
                )

    @property
    def is_long(self) -> bool:
        """True for a run that is kept in shards; see `shards.is_long`."""
        if self.phases is None:
            return is_long(len(self.poses), self.mesh.n_faces)
        n = self.phases.images(self.poses)
        return n > MOST_IMAGES or is_long(n, self.mesh.n_faces)

    def of_phases(self, poses: Poses, folder: Path | None, staff: Staff) -> AreaNetwork | None:
        """Area by some of the poses in all phases; None where the scene has one."""
        scene = self.camera, poses, self.task
        if self.phases is None:
            return None
        return self.phases.network(scene, self.engine, folder, staff)


def bits_of_a_pair(names: Collection[str], engine: Engine) -> int:
    """Memory that figures of a pair take, bits: of samples that of the two counts."""
    if engine.method == "sampled":
        each = 64 if {*names} - {COVERED} else 0
    else:
        each = sum(8 * NO_FIGURES[name].itemsize for name in names if name != COVERED)
    return each + (COVERED in names)


class KeptCounts:
    """Counts of samples of all pairs, in place of figures that are derived from them.

    A pair takes 2 to 16 bytes, by the largest counts of a batch, and all of its figures 95.

    Parameters
    ----------
    names : sequence of str
        Figures that may be asked for.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self.names = names
        self._batches: list[FaceCounts] = []

    def add(self, batch: FaceCounts) -> None:
        """Keep the counts of further poses."""
        self._batches.append(batch)

    def fill(self, judge: FacePass, poses: Poses, figures: Mapping[str, AnyArray]) -> None:
        """Fill (P, F) arrays with the figures of the poses that were added."""
        at = 0
        for batch in self._batches:
            rows = slice(at, at + len(batch.visible))
            judge.fill(batch, poses[rows], {name: all_of[rows] for name, all_of in figures.items()})
            at = rows.stop


@guard_class
@frozen_record(repr=False, kw_only=True)
class Evaluation(Coverage):
    """Result of `evaluate`: values for each pose and face, and for all cameras together.

    The (P, F) arrays are those of `Coverage`.

    Attributes
    ----------
    poses : Poses
        Evaluated poses: all of them, unless the run was interrupted.
    engine : Engine
        Method and device.
    options : mapping or None
        Options of the run, recorded with the result.
    network : Network
        Coverage of each face by all cameras together.
    by_face_because : str
        Reason why the result is by face although `by="face"` was not given; otherwise "".
    areas : AreaNetwork or None
        Covered area of a result by area; see `covered`; of all frames if bodies move.
    per_camera : ByCamera
        Results of each camera where there are several.
    kept_counts : KeptCounts
        Of method "sampled": arrays of `Coverage` are derived from counts when they are first read.
    kept_bits : CoverageBits or None
        See `bits`.
    pairs : str
        Pairs of pose and face that a command wrote to a table; "none" for `evaluate`.
    n_rows : int
        Number of these pairs.
    quarantined : dict of int to str
        Poses that were skipped because they crash a worker, and how the worker ended.
    seconds : float
        Time of the evaluation.
    interrupted : bool
        True if poses are missing because the run was interrupted.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> poses = rc.sphere_of_poses((0, 0, 0), distance=0.6, count=6)
    >>> result = rc.evaluate(mesh, camera, poses, rc.Task(views=2))
    >>> result.by, len(result.poses), result.interrupted
    ('area', 6, False)
    >>> round(result.covered.share(views=2), 3)
    1.0
    >>> result.network.views.tolist()  # cameras that cover each face as a whole
    [2, 2, 3, 3, 2, 2, 2, 2, 2, 2, 2, 2]
    """

    poses: Poses
    engine: Engine
    options: ReadByName | None
    network: Network
    by_face_because: str
    areas: AreaNetwork | None
    per_camera: ByCamera
    kept_counts: KeptCounts
    kept_bits: CoverageBits | None
    pairs: str
    n_rows: int
    quarantined: Mapping[int, str]
    seconds: float
    interrupted: bool

    def __post_init__(self) -> None:
        super().__post_init__()
        check_kind("kept_counts", self.kept_counts, KeptCounts, "counts of a run", ConfigError)

    def _later(self) -> Collection[str]:
        return self.kept_counts.names

    def _derive(self, name: str) -> AnyArray:
        out = arrays_for([name], (len(self.pose_ids), self.mesh.n_faces))
        judge = FacePass(self.mesh, self.camera, thread_count(self.engine.threads), self.task)
        self.kept_counts.fill(judge, self.poses, out)
        return out[name]

    @property
    def by(self) -> str:
        """Basis of the result: "area" or "face"."""
        return "face" if self.areas is None else "area"

    @property
    def covered(self) -> Covered:
        """Exact area of each face that at least 1 to k cameras cover, with k `Task.views`.

        ConfigError for a result by face.

        Examples
        --------
        >>> import rastercov as rc
        >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
        >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
        >>> result = rc.evaluate(mesh, camera, rc.look_at((0, 0, 0.6), (0, 0, 0)))
        >>> result.covered.area[0].round(4).tolist()  # m^2 of each of the 12 faces
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.02, 0.02]
        """
        if self.areas is None:
            why = self.by_face_because or 'give by="area", with method certified or exact'
            raise ConfigError(f"expected an evaluation by area, got one by face; {why}")
        return self.areas.covered

    @property
    def bits(self) -> CoverageBits:
        """Pairs of pose and face that are covered, one bit each; see `CoverageBits`.

        ConfigError unless "covered" is among the fields.
        """
        if self.kept_bits is None:
            raise ConfigError(f"expected bits of pairs, got none; add {COVERED!r} to fields")
        return self.kept_bits

    @property
    def over_time(self) -> "OverTime":
        """Coverage over time, if bodies move; ConfigError for a static scene.

        Examples
        --------
        >>> import rastercov as rc
        >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
        >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
        >>> eye = rc.look_at((0.6, 0, 0), (0, 0, 0))
        >>> motion = rc.Motion(mesh, {"mesh": rc.turntable(4)})
        >>> round(rc.evaluate(mesh, camera, eye, motion=motion).over_time.share(), 3)  # the sides
        0.667
        """
        if (found := getattr(self.areas, "over_time", None)) is None:
            raise ConfigError("expected an evaluation over time, got a static scene; give motion=")
        return found

    def group_views(self) -> GroupViews:
        """Silhouette of each group in each image: areas, px^2, visible and truncated shares.

        The arrays are (P, G). Computed at each call; ConfigError for method "sampled".

        Examples
        --------
        >>> import rastercov as rc
        >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
        >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
        >>> result = rc.evaluate(mesh, camera, rc.look_at((0.6, 0, 0), (0, 0, 0)))
        >>> result.group_views().visible.round(6).tolist()
        [[49152.0]]
        """
        return group_views(self.mesh, self.camera, self.poses, self.engine)

    def summary(self) -> ByName:
        """Content of `summary.json`: figures of the network and of each pose, warnings, inputs.

        Examples
        --------
        >>> import rastercov as rc
        >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
        >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
        >>> summary = rc.evaluate(mesh, camera, rc.look_at((0, 0, 0.6), (0, 0, 0))).summary()
        >>> round(summary["covered_area"]["percent"], 2), summary["by"]
        (16.67, 'area')
        >>> {zone["reason"] for zone in summary["dead_zones"]}
        {'back_facing'}
        """
        network, placed = self.network, self.poses
        result = network.summary() | {"by": self.by, "by_face_because": self.by_face_because}
        of_phases = {} if self.areas is None else self.areas.of_phases()
        if self.areas is not None:
            self.areas.add_to(result, self.camera, placed)
            result |= self.areas.dead_zones(self.camera, placed)
            result |= {} if of_phases else self.per_camera.further()
        per_pose = [
            {"pose": pose, "covered_faces": covered, "mean_coverage": mean}
            for pose, covered, mean in zip(
                network.pose_ids, network.covered_faces, network.mean_coverage, strict=True
            )
        ]
        result |= {
            "interrupted": self.interrupted,
            "table": {"pairs": self.pairs, "rows": self.n_rows},
            "quarantined": {str(pose): end for pose, end in self.quarantined.items()},
            "skipped_poses": {str(row): text for row, text in placed.rejected.items()},
            "seconds": self.seconds,
            "poses_per_second": len(placed) / self.seconds if len(placed) else 0.0,
            "run": provenance_of(
                self.mesh, self.camera, placed.given, self.task, self.options, self.info
            ),
            "size_m": np.ptp(self.mesh.bounds, axis=0).tolist(),
            "warnings": list(self.mesh.warnings),
            "dead_pixels": dead_pixels(self.camera),
            "result_warnings": [
                *find_warnings(network, self.camera, placed),
                *warnings_of(result),
                *(self.areas.doubts() if self.areas is not None else ()),
            ],
            "per_pose": per_pose,
        }
        result["doubts"] = result["result_warnings"]
        if of_phases:
            return result | of_phases
        if len(cameras_of(self.camera)) > 1:
            result["by_camera"] = self.per_camera.summary()
            leads = led_by(self.camera, placed)
            for entry, index in zip(per_pose, placed.camera[leads].tolist(), strict=True):
                entry["camera"] = self.per_camera.names[index]
        return result


def regions(
    mesh: Mesh,
    camera: Cameras,
    poses: ArrayLike | Poses,
    task: Task | None = None,
    *,
    method: str | Engine = "certified",
    threads: int | None = None,
    **given: object,
) -> Regions:
    """Parts of the evaluated faces that each pose covers, as convex polygons in their planes.

    Mesh, camera, poses, task and optional inputs are as for `evaluate`, method and threads as for
    `open_observer`. For a `Rig` with a rule, a row of the result is a pose of the rig, with the
    parts that its cameras cover together. With a motion and R rows per frame, row t * R + r is row
    r in frame t, on the mesh at rest; `pose_ids` are repeated for each frame, and absent bodies
    have no regions. Thresholds of whole faces must have their defaults: `min_pixels`,
    `min_visibility`, `min_coverage`, `focus_rule`, `cap_resolution`. `views` and `min_angle_deg`
    apply to several poses, and are ignored here.

    Raises
    ------
    ConfigError
        For a threshold that applies to whole faces, method "sampled", or an unknown argument.
    PoseError
        For a pose that is not a rigid transform.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> seen = rc.regions(mesh, camera, rc.look_at((0.6, 0, 0), (0, 0, 0)))
    >>> seen.areas().round(4).tolist()  # m^2 of each face in each pose
    [[0.0, 0.0, 0.02, 0.02, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]]
    """
    check_scene(mesh, camera)
    placed, engine = Poses.of(poses), Engine.of(method, threads)
    camera, task, phases = asked(mesh, camera, task, given)
    if phases is not None:
        return phases.regions(camera, placed, task, engine)
    return with_rule(RegionPass(mesh, camera, task, method=engine).find(placed), camera, placed)
