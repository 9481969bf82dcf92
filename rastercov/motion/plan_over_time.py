"""Placement over time: cameras chosen on cells of the surface in each frame.

A candidate covers a cell in some frames. Where some frame is enough, the elements of the problem
are the cells; where a share of the time is asked for, they are the cells of every frame, weighted
by its duration, and the exact share is measured of what is chosen.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from pydantic import Field, ValidationError

from rastercov.base import (
    ByName,
    ConfigError,
    FloatArray,
    IntArray,
    RastercovError,
    UnreadableError,
    frozen_record,
    owners_of,
    printable,
    read_toml,
    suffix_of,
)
from rastercov.core.area.cells import Cells
from rastercov.core.area.network import AreaNetwork
from rastercov.core.area.table import Regions, join, take_rows
from rastercov.core.camera import Cameras, Poses, led_by, renumber
from rastercov.core.coverage.coverage import Observer
from rastercov.core.coverage.evaluation import MOST_IMAGES
from rastercov.core.coverage.task import Engine, Task
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.bodies import Jointed, JointPath
from rastercov.motion.motion import Motion, conveyor, describe_motion, turntable
from rastercov.motion.motion_file import OF_GLTF, load_motion, read_gltf_motion, read_motion
from rastercov.motion.over_time import (
    OfFrames,
    OverTime,
    TimeAreas,
    never_seeable,
    regions_in_shards,
)
from rastercov.motion.plan_section import MotionSection, Over
from rastercov.motion.regions import (
    MotionQuery,
    MovingFrames,
    by_time,
    carriers,
    move_with_carrier,
    regions_of_frames,
)
from rastercov.placement.matrix import VisibilityMatrix
from rastercov.placement.matrix_folder import NOT_ON_RIGS, Pairs, describe
from rastercov.placement.plan.entries import Entry, Name, Table
from rastercov.placement.plan.file import (
    Plan,
    PlanError,
    errors_at,
    lines_of,
    moving_bodies,
)
from rastercov.placement.plan.phases import Phase, PhaseMatrix, PlanScene
from rastercov.placement.plan.rig_parts import Kept
from rastercov.placement.plan.sections import BodyEntry, MeshEntry
from rastercov.placement.select.problem import weights_of
from rastercov.shards import Progress

CANDIDATES_A_TURN = 32
"""Candidates whose regions in all frames are in memory at a time."""


class MotionFile(Entry):
    """Motion file for `rastercov evaluate`: bodies, their poses, and the time to be covered.

    Bodies with joints join the mesh.
    """

    bodies: list[BodyEntry] = Field(default_factory=list)
    """Groups that move together."""
    motion: MotionSection
    """Poses of the bodies."""
    body: Name = "world"
    """Body that carries the cameras; poses are those at rest."""
    over: Over = "some"
    """Time in which a point must be covered: some, all, or a share."""
    views_at: Literal["one time", "any time"] = "one time"
    """Times at which the required cameras must cover a point: one for all, or any for each."""


@frozen_record(repr=False)
class PlanMotion(MotionQuery):
    """Motion of a plan and its question.

    Attributes
    ----------
    jointed : sequence of Jointed
        Bodies with joints.
    path : JointPath or None
        Of the one that follows one.
    cameras : sequence of str
        Names of the cameras that a list `body` is of.
    """

    method: str = "certified"
    jointed: Sequence[Jointed] = ()
    path: JointPath | None = None
    cameras: Sequence[str] = ()

    @classmethod
    def of(cls, plan: Plan, mesh: Mesh) -> "PlanMotion | None":
        """The motion of a plan, None where nothing moves; PlanError for one that is none.

        A turntable below a part is an axis of what carries the cameras, see `PlanScene.table`.
        Figures over time are by exact area.
        """
        section, task = plan.motion, plan.task
        if section is None or any(each.is_carried for each in plan.candidates):
            return None
        unit, reason = plan.unit_of_result()
        if unit != "area":
            why = reason or "leave out task.by"
            raise PlanError(plan.name, f"motion: expected a result by area, got one by face; {why}")
        jointed = moving_bodies(plan.bodies, plan.folder, plan.name)
        bodies = bodies_of_cameras(plan)
        with errors_at(plan.name, "motion"):
            motion = motion_of(section, mesh, plan.bodies, jointed, plan.folder, plan.meshes)
            for name in bodies:
                motion.poses_of(name)
        own = task.over or "some", task.views_at, bodies, task.method
        path = path_of(section, jointed, plan.folder)
        return cls(motion, *own, jointed, path, plan.rig.names)

    @classmethod
    def read(cls, path: Path, mesh: Mesh, method: str = "certified") -> "PlanMotion":
        """The motion of a mesh by a file, TOML as of `MotionFile`, or a table of poses.

        The mesh of `motion` has bodies with joints of the file, too.

        Raises
        ------
        ConfigError
            In one line with the name of the file; a `PlanError` with a line for each entry.
        """
        if suffix_of(path) != ".toml":
            return cls(load_motion(mesh, path), method=method)
        try:
            table = read_toml(path)
            own = MotionFile.model_validate(table, context={"folder": path.parent})
            jointed = moving_bodies(own.bodies, path.parent, printable(path.name))
            mesh = Mesh.joined([mesh, *(each.mesh for each in jointed)]) if jointed else mesh
            motion = motion_of(own.motion, mesh, own.bodies, jointed, path.parent)
            joints = path_of(own.motion, jointed, path.parent)
        except ValidationError as error:
            raise PlanError(path.name, lines_of(error, table, MotionFile)) from None
        except PlanError:
            raise
        except (UnreadableError, RastercovError) as error:
            raise PlanError(printable(path.name), str(error)) from None
        return cls(motion, own.over, own.views_at, own.body, method, jointed, joints)

    def body_of(self, camera: str) -> str:
        """Body that carries a camera, by its name."""
        if isinstance(self.body, str):
            return self.body
        return dict(zip(self.cameras, self.body, strict=True)).get(camera, "world")

    @property
    def count(self) -> int:
        """See `PlanPhases`."""
        return len(self.motion)

    @property
    def asked(self) -> OfFrames:
        """See `PlanPhases`."""
        return OfFrames(self)

    @property
    def mesh(self) -> Mesh:
        """See `PlanPhases`."""
        return self.motion.mesh

    def carrying(self, cameras: Sequence[str]) -> Self:
        """See `PlanPhases`."""
        return replace(self, body=[self.body_of(name) for name in cameras], cameras=cameras)

    def place(self, at: Sequence[float]) -> tuple[Mesh, IntArray, dict[str, FloatArray]]:
        """See `PlanPhases`."""
        motion, (frame, *joints) = self.motion, at or (0.0,)
        number: Any = frame  # whole, or refused
        mesh, kept = motion.frame(number)
        poses, row = motion.world_from_body[int(frame)], 0
        if joints:
            poses = poses.copy()
            for body in self.jointed:
                own = joints[row : (row := row + len(body.joint_names))]
                for link, pose in body.poses(own).items():
                    poses[motion.names.index(link)] = pose[0]
            mesh, kept = motion._place(poses, motion.present[int(frame)])
        return mesh, kept, dict(zip(motion.names, poses, strict=True))

    def describe(self) -> ByName:
        """See `PlanPhases`."""
        fields = []
        for body in self.jointed:
            of_joints = zip(body.joint_names, body.joint_kinds, body.limits, strict=True)
            for name, kind, limits in of_joints:
                low, high = np.where(np.isfinite(limits), limits, (-math.pi, math.pi)).tolist()
                unit = "m" if kind == "prismatic" else "°"
                fields.append({"name": name, "low": low, "high": high, "words": "", "unit": unit})
        joints = np.concatenate([*(each.rest for each in self.jointed), []])
        joints = joints[None] if self.path is None else self.path.joints
        frames = np.broadcast_to(joints, (len(self.motion), joints.shape[1]))
        return {
            "motion": describe_motion(self.motion),
            "joints": {"fields": fields, "frames": frames.tolist()},
        }

    def values(self, camera: Cameras, placed: Poses, task: Task) -> dict[str, FloatArray]:
        """See `PlanPhases`."""
        return {"time": self.areas(camera, placed, task).over_time.share_of_time()}

    def each(self, camera: Cameras, placed: Poses) -> Iterator[Phase]:
        """Scene and cameras of each frame."""
        carried = carriers(self, camera, placed)
        for row in range(len(self.motion)):
            mesh, kept = self.motion._at(row, of_occluders=False)
            back = partial(Regions._at_rest, mesh=self.motion.mesh, kept=kept)
            yield Phase(mesh, move_with_carrier(carried[:, row], placed), back)

    def areas(
        self,
        camera: Cameras,
        placed: Poses,
        task: Task,
        regions: Regions | None = None,
        kept: Kept | None = None,
    ) -> TimeAreas:
        """Area of placed cameras over time, of the regions of frames where they are known."""
        own = self, camera, placed, task, Engine.of(self.method)
        if kept is not None:
            regions = regions_in_shards(MovingFrames.of(*own), *kept)
        if regions is None:
            regions = regions_of_frames(*own)
        return OverTime(self, camera, placed, task, regions).areas

    def first(self, areas: AreaNetwork, count: int) -> TimeAreas:
        """The same of the first cameras."""
        assert isinstance(areas, TimeAreas)
        whole = areas.over_time
        rows = np.arange(len(whole.regions.pose_ids)).reshape(len(self.motion), -1)
        return replace(whole, regions=take_rows(whole.regions, rows[:, :count].ravel())).areas

    def is_mean(self, task: Task) -> bool:
        """See `PlanPhases`."""
        return self.over != "some" or task.views > 1

    def matrix(
        self,
        plan: Plan,
        observer: Observer,
        cells: Cells,
        poses: Poses,
        task: Task,
        progress: Progress,
    ) -> PhaseMatrix:
        """Cells that candidates cover over time."""
        motion, mounts = self.motion, plan.mounts
        is_of_frames = self.is_mean(task)
        n_frames, n_cells = (len(motion) if is_of_frames else 1), len(cells)
        counts: list[IntArray] = [np.zeros(0, np.int64)]
        elements, shares = [np.zeros(0, np.int32)], [np.zeros(0)]
        together: Regions | None = None
        width = int(np.diff(mounts.starts).max()) * len(motion)
        at_once = max(1, min(CANDIDATES_A_TURN, MOST_IMAGES // width))
        for first in range(0, len(poses), at_once):
            some = renumber(poses[first : first + at_once])
            placed, owner = mounts.cameras(some)
            regions = regions_of_frames(self, plan.rig, placed, task, Engine.of(self.method))
            of_row = owner[led_by(plan.rig, placed)]
            regions = _of_mounts(regions, len(motion), of_row, len(some))
            if getattr(plan.selection, "of_reachable", False):
                frames = by_time(regions, motion)
                both = frames if together is None else join([together, frames])
                rows = np.arange(len(both.pose_ids)) % len(motion)
                together = both.at_least(1, rows, one_side=False)
            if not is_of_frames:
                regions = regions.at_least(
                    1, np.tile(np.arange(len(some)), len(motion)), one_side=False
                )
            rows = np.arange(n_frames * len(some)).reshape(n_frames, -1).T.ravel()
            of_cells = cells.share(take_rows(regions, rows))
            sizes = np.diff(of_cells.starts)
            counts.append(sizes.reshape(-1, n_frames).sum(axis=1))
            cell = of_cells.cell + n_cells * (owners_of(sizes) % n_frames)
            elements.append(cell.astype(np.int32))
            shares.append(of_cells.share)
            progress(min(first + at_once, len(poses)), len(poses))
        pairs = Pairs(
            np.concatenate(counts),
            np.concatenate(elements),
            np.concatenate(shares).astype(np.float32),
            NOT_ON_RIGS,
        )
        header = describe(observer, poses, task, None, cells, mounts)
        n_elements = dict.fromkeys(("n_faces", "n_task_faces"), n_frames * n_cells)
        own = {name: header[name] for name in header.keys() - {"cells", "mounts"}}
        matrix = VisibilityMatrix(placed=poses, header=own | n_elements, parts=(pairs,))
        hidden = never_seeable(motion) if plan.task.weight_by == "seeable" else None
        weights = weights_of(cells, plan.task.weight_by, hidden)
        if is_of_frames:
            there = motion.present[:, motion.body[cells.source_face]] * motion.durations[:, None]
            weights = (there * weights).ravel()
        reachable = None if together is None else self.areas(plan.rig, poses, task, together)
        return PhaseMatrix(matrix, _repeat_mesh(cells.elements, n_frames), weights, reachable)


def path_of(section: MotionSection, jointed: Sequence[Jointed], folder: Path) -> JointPath | None:
    """Path of the one body with joints; None without joints."""
    if section.joints is None:
        return None
    if len(jointed) != 1:
        raise ConfigError(f"expected one body with joints, got {len(jointed)}; give one")
    return jointed[0].read_path(folder / section.joints)


def motion_of(
    section: MotionSection,
    mesh: Mesh,
    bodies: Sequence[BodyEntry],
    jointed: Sequence[Jointed],
    folder: Path,
    files: Sequence[MeshEntry] = (),
) -> Motion:
    """The motion of a mesh, of some files; ConfigError or MeshError where there is none.

    Bodies with joints that no path moves stay.
    """
    tables: ByName = {}
    others: ByName = {}

    def add(name: str, table: object) -> None:
        if name in tables:
            raise ConfigError(f"expected one motion of body {name!r}, got two; leave out one")
        tables[name] = table

    if (table := section.turntable) is not None:
        axis, centre = table.axis, table.centre
        add(table.body, turntable(table.steps, axis=axis, centre=centre, degrees=table.degrees))
    if (belt := section.conveyor) is not None:
        way = conveyor(belt.steps, direction=belt.direction, distance=belt.distance)
        add(belt.body, way)
    if section.poses is not None:
        others = read_motion(folder / section.poses)
        for name, poses in others.pop("bodies").items():
            add(name, poses)
    if (path := path_of(section, jointed, folder)) is not None:
        others.setdefault("durations", path.duration)
        for name, poses in jointed[0].poses(path.joints).items():
            add(name, poses)
    groups = {body.name: body.groups for body in bodies if body.groups}
    if section.animation is not None:
        result = _animate(section, mesh, folder, files)
        others["present"] = others.get("present", {}) | result["present"]
        groups |= result["groups"]
        for name, poses in result["bodies"].items():
            add(name, poses)
    own = {each.name for each in jointed}
    still = [body.name for body in bodies if body.name not in own]
    for name in [*still, *(link for each in jointed for link in each.poses(each.rest))]:
        tables.setdefault(name, np.eye(4))
    if not tables:
        raise ConfigError(
            "expected a body that moves, got none; give turntable, conveyor, poses or joints"
        )
    return Motion(mesh, tables, groups=groups, **others)


def _animate(
    section: MotionSection, mesh: Mesh, folder: Path, files: Sequence[MeshEntry]
) -> ByName:
    of_gltf = [each for each in files if suffix_of(each.path or "") in OF_GLTF]
    if len(of_gltf) != 1 or of_gltf[0].path is None:
        raise ConfigError(f"expected one glTF file to animate, got {len(of_gltf)}; give poses")
    place, path = of_gltf[0].transform, folder / of_gltf[0].path
    matrix = place.matrix()
    matrix[:3, :3] *= place.scale
    name = section.animation or ""
    return read_gltf_motion(mesh, path, name, section.steps, of_gltf[0].unit, matrix)


def bodies_of_cameras(plan: Plan) -> list[str]:
    """Body that carries each of the cameras of the rig of a plan."""
    if plan.camera is not None:
        return [plan.camera.body] * len(plan.rig)
    texts: list[str] = []
    mounts = plan.mounts
    for name, n in zip(mounts.names, np.diff(mounts.starts).tolist(), strict=False):
        rig = plan.rigs.get(name)
        types = [name] if rig is None else [each.camera for each in rig.cameras or []]
        own = [plan.cameras[each].body for each in types if each in plan.cameras]
        texts += own if len(own) == n else ["world"] * n
    return texts


class OfPlanMotion(PlanScene):
    """Motion in a plan."""

    sections = ("motion", "bodies", "task")

    def phases(self, plan: Plan, mesh: Mesh) -> PlanMotion | None:
        """See `PlanScene`."""
        return PlanMotion.of(plan, mesh)

    def is_still(self, plan: Plan) -> bool:
        """See `PlanFeature`."""
        return plan.motion is None

    def check(self, plan: Plan, folder: Path) -> None:
        """See `PlanFeature`."""
        motion, task = plan.motion, plan.task
        if any(each.is_carried for each in plan.candidates):
            if task.over is not None:
                raise ValueError("task.over: expected a motion, got none; leave it out")
            if motion is not None and motion.model_fields_set != {"turntable"}:
                raise ValueError(
                    "motion: expected a turntable alone for cameras that are carried, got others; "
                    "leave them out"
                )
            return
        if motion is None:
            if task.over is not None or plan.bodies:
                raise ValueError("expected a motion for task.over and bodies, got none; give one")
            return
        if isinstance(task.views, dict):
            raise ValueError("task.views: expected one number over time, got groups; give one")
        if task.views > 1 and getattr(plan.selection, "of_reachable", False):
            raise ValueError(
                "selection.of_reachable: expected one view over time, got more; leave it out"
            )
        plan.refuse(("refine", "optimise", "tolerance"), "over time")

    def table(self, plan: Plan, mesh: Mesh) -> tuple[Mesh, Table] | None:
        """See `PlanScene`."""
        if plan.motion is None or (table := plan.motion.turntable) is None:
            return None
        groups = {body.name: body.groups for body in plan.bodies if body.groups}
        turns = Motion(mesh, {table.body: np.eye(4)}, groups=groups).body > 0
        if (wrong := ~turns & mesh.task_mask).any():
            name = mesh.groups[mesh.face_group[wrong.argmax()]].name
            raise ConfigError(
                f"expected group {name} on the turntable or as an occluder, got it elsewhere; give "
                f'it to body {table.body}, to what carries the cameras, or role = "occluder"'
            )
        stationary = None if turns.all() else mesh._of_faces(~turns)
        own = mesh if stationary is None else mesh._of_faces(turns)
        return own, Table(table.axis, table.centre, table.degrees, stationary)


HOOKS = OfPlanMotion()


def _of_mounts(regions: Regions, n_frames: int, of_row: IntArray, n: int) -> Regions:
    """Regions of mounts in each frame, from those of the rows of their cameras."""
    if len(of_row) == n:
        return regions
    of = (np.arange(n_frames)[:, None] * n + of_row).ravel()
    return regions.at_least(1, of, one_side=False)


def _repeat_mesh(mesh: Mesh, n: int) -> Mesh:
    """Mesh with its faces n times."""
    if n == 1:
        return mesh
    return Mesh(
        mesh.vertices, np.tile(mesh.faces, (n, 1)), mesh.groups, np.tile(mesh.face_group, n)
    )
