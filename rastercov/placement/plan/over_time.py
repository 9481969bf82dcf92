"""Placement over time: cameras chosen on cells of the surface in each frame.

A candidate covers a cell in some frames. Where some frame is enough, the elements of the problem
are the cells; where a share of the time is asked for, they are the cells of every frame, weighted
by its duration, and the exact share is measured of what is chosen.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from pydantic import Field, ValidationError

from rastercov.base.errors import ConfigError, RastercovError
from rastercov.base.files import UnreadableError, printable, read_toml, suffix_of
from rastercov.base.memory import FloatArray, IntArray
from rastercov.camera.pose import Poses, renumbered
from rastercov.camera.rig import Cameras, led_by
from rastercov.coverage.area.cells import Cells
from rastercov.coverage.area.motion import (
    MotionQuery,
    by_time,
    carried_by,
    carriers,
    regions_of_frames,
)
from rastercov.coverage.area.network import AreaNetwork
from rastercov.coverage.area.over_time import OverTime, TimeAreas, never_seeable
from rastercov.coverage.area.table import Regions, joined, taken
from rastercov.coverage.engine import Engine
from rastercov.coverage.moving import OfFrames
from rastercov.coverage.observer import Observer
from rastercov.coverage.phases import MOST_IMAGES
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.mesh.bodies import Jointed, JointPath
from rastercov.mesh.motion import described_motion
from rastercov.mesh.motion_file import load_motion
from rastercov.placement.matrix import VisibilityMatrix
from rastercov.placement.matrix_folder import NOT_ON_RIGS, Pairs, describe
from rastercov.placement.plan.entries import Entry, Name, Over
from rastercov.placement.plan.file import Plan, PlanError, errors_at, lines_of, robots_of
from rastercov.placement.plan.generators import OnArm
from rastercov.placement.plan.phases import Phase, PhaseMatrix, PlanPhased, Table
from rastercov.placement.plan.sections import BodyEntry, MotionSection
from rastercov.placement.select.problem import weights_of
from rastercov.shards import Progress

CANDIDATES_A_TURN = 32
"""Candidates whose regions in all frames are in memory at a time."""


class MotionFile(Entry):
    """Motion file for `rastercov evaluate`: bodies, their poses, and the time to be covered.

    Robots, bodies with `urdf`, join the mesh.
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
    """Time of several required cameras: the same for all, or any for each."""


@dataclass(frozen=True, eq=False, repr=False)
class PlanMotion(MotionQuery):
    """Motion of a plan and its question.

    Attributes
    ----------
    robots : sequence of Robot
        Whose links are bodies.
    path : JointPath or None
        Of the one robot.
    cameras : sequence of str
        Names of the cameras that a list `body` is of.
    """

    method: str = "certified"
    robots: Sequence[Jointed] = ()
    path: JointPath | None = None
    cameras: Sequence[str] = ()

    @classmethod
    def of(cls, plan: Plan, mesh: Mesh) -> "PlanMotion | None":
        """The motion of a plan, None where nothing moves; PlanError for one that is none.

        A turntable below a part that an arm inspects is an axis of the arm, see `scene.arms_of`.
        Figures over time are by exact area.
        """
        section, task = plan.motion, plan.task
        if section is None or any(isinstance(each, OnArm) for each in plan.candidates):
            return None
        unit, reason = plan.unit_of_result()
        if unit != "area":
            why = reason or "leave out task.by"
            raise PlanError(plan.name, f"motion: expected a result by area, got by face; {why}")
        robots = robots_of(plan.bodies, plan.folder, plan.name)
        bodies = bodies_of_cameras(plan)
        with errors_at(plan.name, "motion"):
            motion = section.build(mesh, plan.bodies, robots, plan.folder, plan.meshes)
            for name in bodies:
                motion.poses_of(name)
        own = task.over or "some", task.views_at, bodies, task.method
        path = section.path(robots, plan.folder)
        return cls(motion, *own, robots, path, plan.rig.names)

    @classmethod
    def read(cls, path: Path, mesh: Mesh, method: str = "certified") -> "PlanMotion":
        """The motion of a mesh by a file, TOML as of `MotionFile`, or a table of poses.

        The mesh of `motion` has the robots of the file, too.

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
            robots = robots_of(own.bodies, path.parent, printable(path.name))
            mesh = Mesh.joined([mesh, *(each.mesh for each in robots)]) if robots else mesh
            motion = own.motion.build(mesh, own.bodies, robots, path.parent)
            joints = own.motion.path(robots, path.parent)
        except ValidationError as error:
            raise PlanError(path.name, lines_of(error, table, MotionFile)) from None
        except PlanError:
            raise
        except (UnreadableError, RastercovError) as error:
            raise PlanError(printable(path.name), str(error)) from None
        return cls(motion, own.over, own.views_at, own.body, method, robots, joints)

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

    def placed(self, at: Sequence[float]) -> tuple[Mesh, IntArray, dict[str, FloatArray]]:
        """See `PlanPhases`."""
        motion, (frame, *joints) = self.motion, at or (0.0,)
        number: Any = frame  # whole, or refused
        mesh, kept = motion.frame(number)
        poses, row = motion.world_from_body[int(frame)], 0
        if joints:
            poses = poses.copy()
            for robot in self.robots:
                own = joints[row : (row := row + len(robot.joint_names))]
                for link, pose in robot.poses(own).items():
                    poses[motion.names.index(link)] = pose[0]
            mesh, kept = motion._placed(poses, motion.present[int(frame)])
        return mesh, kept, dict(zip(motion.names, poses, strict=True))

    def described(self) -> dict[str, Any]:
        """See `PlanPhases`."""
        fields = []
        for robot in self.robots:
            of_joints = zip(robot.joint_names, robot.joint_kinds, robot.limits, strict=True)
            for name, kind, limits in of_joints:
                low, high = np.where(np.isfinite(limits), limits, (-math.pi, math.pi)).tolist()
                unit = "m" if kind == "prismatic" else "°"
                fields.append({"name": name, "low": low, "high": high, "words": "", "unit": unit})
        joints = np.concatenate([*(each.rest for each in self.robots), []])
        joints = joints[None] if self.path is None else self.path.joints
        frames = np.broadcast_to(joints, (len(self.motion), joints.shape[1]))
        return {
            "motion": described_motion(self.motion),
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
            yield Phase(mesh, carried_by(carried[:, row], placed), back)

    def areas(
        self, camera: Cameras, placed: Poses, task: Task, found: Regions | None = None
    ) -> TimeAreas:
        """Area of placed cameras over time, of the regions of frames where they are known."""
        if found is None:
            found = regions_of_frames(self, camera, placed, task, Engine.of(self.method))
        return OverTime(self, camera, placed, task, found).areas

    def first(self, areas: AreaNetwork, count: int) -> TimeAreas:
        """The same of the first cameras."""
        assert isinstance(areas, TimeAreas)
        whole = areas.over_time
        rows = np.arange(len(whole.regions.pose_ids)).reshape(len(self.motion), -1)
        return replace(whole, regions=taken(whole.regions, rows[:, :count].ravel())).areas

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
        is_of_cells = self.over == "some" and task.views == 1
        n_frames, n_cells = (1 if is_of_cells else len(motion)), len(cells)
        counts: list[IntArray] = [np.zeros(0, np.int64)]
        elements, shares = [np.zeros(0, np.int32)], [np.zeros(0)]
        together: Regions | None = None
        width = int(np.diff(mounts.starts).max()) * len(motion)
        at_once = max(1, min(CANDIDATES_A_TURN, MOST_IMAGES // width))
        for first in range(0, len(poses), at_once):
            some = renumbered(poses[first : first + at_once])
            placed, owner = mounts.cameras(some)
            found = regions_of_frames(self, plan.rig, placed, task, Engine.of(self.method))
            of_row = owner[led_by(plan.rig, placed)]
            found = _of_mounts(found, len(motion), of_row, len(some))
            if getattr(plan.selection, "of_reachable", False):
                frames = by_time(found, motion)
                both = frames if together is None else joined([together, frames])
                rows = np.arange(len(both.pose_ids)) % len(motion)
                together = both.at_least(1, rows, one_side=False)
            if is_of_cells:
                found = found.at_least(
                    1, np.tile(np.arange(len(some)), len(motion)), one_side=False
                )
            of_cells = cells.share(found)
            limits = of_cells.starts
            counts.append(np.diff(limits).reshape(n_frames, -1).sum(axis=0))
            for mount in range(len(some)):
                for frame in range(n_frames):
                    row = frame * len(some) + mount
                    part = slice(limits[row], limits[row + 1])
                    cell = of_cells.cell[part].astype(np.int32)
                    elements.append(cell + np.int32(frame * n_cells))
                    shares.append(of_cells.share[part])
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
        if not is_of_cells:
            there = motion.present[:, motion.body[cells.source_face]] * motion.durations[:, None]
            weights = (there * weights).ravel()
        reachable = None if together is None else self.areas(plan.rig, poses, task, together)
        return PhaseMatrix(matrix, _repeated(cells.elements, n_frames), weights, reachable)


def bodies_of_cameras(plan: Plan) -> list[str]:
    """Body that carries each of the cameras of the rig of a plan."""
    if plan.camera is not None:
        return [plan.camera.body] * len(plan.rig)
    found, mounts = [], plan.mounts
    for name, n in zip(mounts.names, np.diff(mounts.starts).tolist(), strict=False):
        rig = plan.rigs.get(name)
        types = [name] if rig is None else [each.camera for each in rig.cameras or []]
        own = [plan.cameras[each].body for each in types if each in plan.cameras]
        found += own if len(own) == n else ["world"] * n
    return found


class OfPlanMotion(PlanPhased):
    """Motion in a plan."""

    sections = ("motion", "bodies", "task")

    def phases(self, plan: Plan, mesh: Mesh) -> PlanMotion | None:
        """See `PlanPhased`."""
        return PlanMotion.of(plan, mesh)

    def table(self, plan: Plan, mesh: Mesh) -> Table | None:
        """See `PlanPhased`."""
        if plan.motion is None or (table := plan.motion.turntable) is None:
            return None
        if still := plan.motion.beside_turntable(mesh, plan.bodies):
            raise ConfigError(
                f"expected group {still[0]} on the turntable, got it beside; give it to body "
                f"{table.body}, or make it a shape of a link of the urdf"
            )
        return Table(table.axis, table.centre, table.degrees)


HOOKS = OfPlanMotion()


def _of_mounts(found: Regions, n_frames: int, of_row: IntArray, n: int) -> Regions:
    """Regions of mounts in each frame, from those of the rows of their cameras."""
    if len(of_row) == n:
        return found
    of = (np.arange(n_frames)[:, None] * n + of_row).ravel()
    return found.at_least(1, of, one_side=False)


def _repeated(mesh: Mesh, n: int) -> Mesh:
    """Mesh with its faces n times."""
    if n == 1:
        return mesh
    return Mesh(
        mesh.vertices, np.tile(mesh.faces, (n, 1)), mesh.groups, np.tile(mesh.face_group, n)
    )
