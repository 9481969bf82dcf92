"""Cameras of a plan on the arm of a robot: occlusion by the arm, and its joint angles.

Candidates are measured without the arm. The chosen poses are measured again with it in each of
their joint angles: where one hides too much, another solution of the same pose is tried. The moves
of a refinement are those of joints, so that every pose stays within reach.
"""

import time
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from rastercov.base.memory import BoolArray, FloatArray, IntArray
from rastercov.camera.pose import Poses
from rastercov.coverage.area.regions import RegionPass
from rastercov.coverage.area.rows import gated
from rastercov.coverage.area.table import Regions
from rastercov.coverage.evaluation import regions
from rastercov.mesh import Mesh, bodies
from rastercov.mesh.arrays import frozen
from rastercov.mesh.kinematics import pose_error
from rastercov.placement.candidates.arm import Arm
from rastercov.placement.improve.objective import Objective
from rastercov.placement.improve.refine import INTERRUPTED, Refined
from rastercov.placement.improve.tour import tour
from rastercov.placement.plan import carrier
from rastercov.placement.plan.carrier import CarriedPoses
from rastercov.placement.plan.file import Plan, PlanError

STEPS = (0.2, 0.1, 0.05, 0.025)
"""Moves of joints in a refinement, radians or metres, one after the other."""
SAME_POSE = 1e-6
"""Metres and radians within which joint angles are those of a pose."""


@dataclass(frozen=True, eq=False)
class PlanArm:
    """The arm that carries all cameras of a plan, a `Carrier`."""

    plan: Plan
    arm: Arm

    def __post_init__(self) -> None:
        if self.plan.unit_of_result()[0] != "area":
            words = (
                "candidates: expected a result by area on an arm, got by face; leave out task.by"
            )
            raise PlanError(self.plan.name, words)

    @cached_property
    def scene(self) -> Mesh:
        """The scene and the robot."""
        return Mesh.joined([self.arm.mesh, self.arm.robot.mesh])

    def measured(
        self, finder: RegionPass, mounted: Poses, known: FloatArray | None
    ) -> tuple[list[Regions], CarriedPoses]:
        """See `Carrier`."""
        known = np.zeros((0, len(self.arm.robot.joint_names))) if known is None else known
        reached = self.arm.reach(mounted.world_from_camera)
        found: list[Regions] = []
        joints: list[FloatArray] = []
        lost: list[float] = []
        ends = self.arm.poses(known) if len(known) else np.zeros((0, 4, 4))
        for row in range(len(mounted)):
            one = mounted[row : row + 1]
            error = pose_error(ends, np.broadcast_to(one.world_from_camera, ends.shape))
            own = known[np.linalg.norm(error, axis=1) <= SAME_POSE]
            own = np.concatenate([own, reached.joints[reached.pose == row]])
            if not len(own):  # inverse kinematics found it for the candidate of the same pose
                raise PlanError(
                    self.plan.name,
                    f"camera {row + 1}: expected a pose in reach, got another; run place again",
                )
            placed, _ = self.plan.mounts.cameras(one)
            alone = _area(gated(finder.find(placed), finder.camera, placed))
            best: tuple[float, int, Regions] | None = None
            for index, angles in enumerate(own):
                regions = self._with_arm(finder, placed, angles)
                share = (alone - _area(regions)) / max(self._whole, 1e-300)
                if best is None or share < best[0]:
                    best = share, index, regions
                if 100 * best[0] <= carrier.MOST_LOST:
                    break
            assert best is not None
            found.append(best[2])
            joints.append(own[best[1]])
            lost.append(max(0.0, 100 * best[0]))
        table = np.array(joints).reshape(-1, len(self.arm.robot.joint_names))
        clearance = self.arm.clear(table) if len(table) else np.zeros(0)
        found_tour = self._tour(table)
        names = self.arm.robot.joint_names
        return found, CarriedPoses(names, table, clearance, np.array(lost), *found_tour)

    def reaches(self, pose: FloatArray, camera: int) -> bool:
        """See `Carrier`."""
        mount = pose @ np.linalg.inv(self.plan.mounts.rig.rig_from_camera[camera])
        return len(self.arm.reach(mount[None]).pose) > 0

    @cached_property
    def _whole(self) -> float:
        """Area of the task, m^2."""
        mesh = self.arm.mesh
        return float(mesh.areas[mesh.task_mask].sum())

    def _with_arm(self, finder: RegionPass, placed: Poses, joints: FloatArray) -> Regions:
        """Regions of the scene with the arm in one configuration."""
        poses = {name: table[0] for name, table in self.arm.robot.poses(joints).items()}
        mesh, kept = bodies.placed(self.scene, poses)
        found = regions(mesh, finder.camera, placed, finder.task, method=self.plan.task.method)
        found = found._at_rest(self.scene, kept)
        own = np.arange(self.scene.n_faces) < self.arm.mesh.n_faces
        return replace(found._of_faces(own), mesh=self.arm.mesh)

    def _tour(self, joints: FloatArray) -> tuple[IntArray, float, int]:
        """Rows in the order of a tour, its length, and its wrist flips.

        Joints without limits take the shorter way round: their angles in `joints` are changed by
        whole turns.
        """
        robot = self.arm.robot
        is_endless = np.isinf(robot.limits).all(axis=1) & robot.kinematics.is_turning
        stops = np.concatenate([robot.rest[None], joints])
        ways = stops[:, None] - stops[None]
        turns = np.round(ways / (2 * np.pi)) * is_endless
        order = tour(np.abs(ways - 2 * np.pi * turns).max(axis=2, initial=0.0))
        here, length, flips = robot.rest, 0.0, 0
        chain = robot.kinematics.chain(self.arm.link)
        wrist = [each.column for each in chain if each.column >= 0 and each.kind != "prismatic"][
            -3:
        ]
        for row in order:
            turns_back = np.round((joints[row] - here) / (2 * np.pi)) * is_endless
            joints[row] -= 2 * np.pi * turns_back
            way = np.abs(joints[row] - here)
            length += float(way.max(initial=0.0))
            flips += bool((way[wrist] > np.pi / 2).any())
            here = joints[row]
        return order, length, flips

    def refined(
        self, objective: Objective, mounted: Poses, joints: FloatArray, budget: int
    ) -> tuple[Refined, FloatArray]:
        """See `Carrier`.

        Each pose is within reach, clear of obstacles, and at an allowed position. An interrupt ends
        it with the best so far.
        """
        began, joints = time.perf_counter(), joints.copy()
        start, poses = mounted.world_from_camera, mounted.world_from_camera.copy()
        covers, eyes = objective.covers(mounted), objective.eyes(mounted)
        width = objective.width

        def worth(rows: BoolArray, centres: FloatArray) -> int:
            return int(objective.worth(objective.covered(rows, centres)))

        trace, spent, status = [worth(covers, eyes)], 0, "local optimum"
        try:
            for step in STEPS:
                has_gained = True
                while has_gained and status != "budget spent":
                    has_gained = False
                    for row in range(len(joints)):
                        trials = self._moves(joints[row], step)
                        if spent + len(trials) > budget:
                            status = "budget spent"
                            break
                        spent += len(trials)
                        if not len(trials):
                            continue
                        ends = self.arm.poses(trials)
                        placed = Poses.of(ends, camera=np.full(len(ends), mounted.camera[row]))
                        new, centres = objective.covers(placed), objective.eyes(placed)
                        own = slice(row * width, (row + 1) * width)
                        found = []
                        for trial in range(len(trials)):
                            at = slice(trial * width, (trial + 1) * width)
                            rows, where = covers.copy(), eyes.copy()
                            rows[own], where[own] = new[at], centres[at]
                            found.append(worth(rows, where))
                        best = int(np.argmax(found))
                        if found[best] > trace[-1]:
                            at = slice(best * width, (best + 1) * width)
                            covers[own], eyes[own] = new[at], centres[at]
                            joints[row], poses[row] = trials[best], ends[best]
                            trace.append(found[best])
                            has_gained = True
        except KeyboardInterrupt:
            status = INTERRUPTED
        shares = objective.share(np.array(trace, np.int64))
        moved = (poses != start).any(axis=(1, 2))
        found_: dict[str, Any] = {"evaluations": spent, "seconds": time.perf_counter() - began}
        return Refined(
            frozen(poses),
            float(shares[-1]),
            float(shares[0]),
            frozen(shares),
            frozen(moved),
            status,
            **found_,
        ), joints

    def _moves(self, joints: FloatArray, step: float) -> FloatArray:
        """(M, J) configurations with one joint moved, within the limits and free."""
        n, limits = len(joints), self.arm.robot.limits
        trials = joints + step * np.concatenate([np.eye(n), -np.eye(n)])
        trials = trials[((trials >= limits[:, 0]) & (trials <= limits[:, 1])).all(axis=1)]
        return trials[self.arm.is_free(self.arm.clear(trials))] if len(trials) else trials


def _area(regions: Regions) -> float:
    """Area of what some row covers, m^2."""
    rows = np.zeros(len(regions.pose_ids), np.int64)
    return float(regions.at_least(1, rows, one_side=False).area.sum()) if len(rows) else 0.0
