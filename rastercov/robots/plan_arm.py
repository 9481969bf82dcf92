"""Cameras of a plan on the arm of a robot: occlusion by the arm, and its joint angles.

Candidates are measured without the arm. The chosen poses are measured again with it in each of
their joint angles: where one hides too much, another solution of the same pose is tried. The moves
of a refinement are those of joints, so that every pose stays within reach.
"""

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from rastercov.base import (
    BoolArray,
    ByName,
    FloatArray,
    IntArray,
    StrPath,
    frozen_record,
    norm,
    owners_of,
    plural,
    sort_order,
)
from rastercov.base.format import distance, text_with_sign
from rastercov.base.output import csv_text
from rastercov.core.area.regions import RegionPass
from rastercov.core.area.rows import with_rule
from rastercov.core.area.table import Regions
from rastercov.core.camera import Poses
from rastercov.core.coverage.evaluation import regions
from rastercov.core.mesh import Mesh, bodies
from rastercov.core.mesh.arrays import frozen, inverse
from rastercov.core.mesh.groups import Group
from rastercov.placement.candidates.pool import Candidates
from rastercov.placement.improve.objective import Objective
from rastercov.placement.improve.pose_space import PoseSpace
from rastercov.placement.improve.refine import INTERRUPTED, Refined
from rastercov.placement.improve.tour import tour
from rastercov.placement.plan.file import Plan, PlanError, errors_at
from rastercov.placement.plan.generator import Generator
from rastercov.placement.plan.phases import PlanScene
from rastercov.placement.plan.scene import keep_outs, space_of
from rastercov.placement.plan.sections import BodyEntry
from rastercov.robots.arm import Arm, on_arm
from rastercov.robots.collisions import SORTS, Contact, Of
from rastercov.robots.generators import OnArm
from rastercov.robots.kinematics import pose_error
from rastercov.robots.robot import Robot

STEPS = (0.2, 0.1, 0.05, 0.025)
"""Moves of joints in a refinement, radians or metres, one after the other."""
STATIONARY = "beside the turntable"
"""Group of the stationary scene."""
SAME_POSE = 1e-6
"""Metres and radians within which joint angles are those of a pose."""


SHARED = ("body", "mount", "clearance", "link_clearance", "allowed")
"""Entries of `OnArm` that all of a plan have in common."""
JOINTS = "joints.csv"
"""File of joint angles."""
MOST_LOST = 0.5
"""Percentage points of the evaluated area that it may occlude in the image of its camera."""
MOST_TRIED = 8
"""Joint angles of a pose with which its image is measured."""
MOST_OPTIONS = 48
"""Joint angles of a pose in the search for a tour, whole turns included."""
MOST_NODES = 600
"""Joint angles of all poses there."""


@frozen_record
class CarriedPoses:
    """Joint angles of K chosen poses.

    Attributes
    ----------
    joint_names : tuple of str
    joints : (K, J) float64
    near : dict of str to sequence of Contact
        Nearest pair of each pose, and last at rest: of links with the scene, "scene", and of links,
        "links".
    lost : (K,) float64
        Percentage points of the task's area that it hides.
    cameras : sequence of str
        Name of the camera or rig of each.
    order : (K,) int64
        Poses in the order of a short tour from rest.
    length : float
        Of the tour: the largest move of a joint, of all its ways together.
    turning : (J,) bool
        Joints with angles; the others have lengths.
    rest : (J,) float64
        Joints where the tour starts.
    flips : int
        Ways in which a wrist joint, of the last three that turn, moves by more than 90 degrees.
    """

    joint_names: tuple[str, ...]
    joints: FloatArray
    near: Mapping[Of, Sequence[Contact]]
    lost: FloatArray
    cameras: Sequence[str]
    order: IntArray
    length: float
    turning: BoolArray
    flips: int
    rest: FloatArray

    @property
    def unit(self) -> str:
        """Unit of the length."""
        units = ("rad",) * bool(self.turning.any()) + ("m",) * (not self.turning.all())
        return " or ".join(units)

    def table(self) -> tuple[Sequence[str], list[list[str]]]:
        """See `CarriedPoses`: to what can be set, with clearances."""
        kinds = [of for of in SORTS if self.near[of]]
        names = {"scene": "clearance to the scene", "links": "between links"}
        heads = [*self.joint_names, *(names[of] for of in kinds)]
        rows = [[_gap(self.near[of][row]) for of in kinds] for row in (-1, *self.order.tolist())]
        for joints, own in zip([self.rest, *self.joints[self.order]], rows, strict=True):
            own[:0] = [
                f"{text_with_sign(math.degrees(value), 1)}°" if is_angle else distance(value)
                for value, is_angle in zip(joints.tolist(), self.turning, strict=True)
            ]
        return heads, rows

    @property
    def is_hidden(self) -> BoolArray:
        """(K,) True where too much is hidden, whichever solution is taken."""
        return self.lost > MOST_LOST

    def to_json(self) -> ByName:
        """Joint angles of each pose, its clearance, what is hidden, and the tour."""
        return {
            "joint_names": self.joint_names,
            "joints": self.joints,
            **{
                f"{word}_{name}": value
                for word, of in zip(("clearance", "link_clearance"), SORTS, strict=True)
                for name, value in (
                    ("m", [each.distance for each in self.near[of][:-1]]),
                    ("pair", [[each.link, each.body] for each in self.near[of][:-1]]),
                )
            },
            "hidden_by_arm_percent": self.lost,
            "tour": self.order,
            "tour_length": self.length,
            "tour_length_unit": self.unit,
            "wrist_flips": self.flips,
        }

    def hides(self) -> str:
        """Note where it hides too much of an image."""
        most = f"{self.lost.max():.2f} % of the area"
        return (
            f"the arm hides up to {most} from its camera: check its mount; reasons and advice "
            "of dead zones ignore the arm"
        )

    def with_joints(self, joints: FloatArray) -> "CarriedPoses":
        """See `Carried`."""
        return replace(self, joints=joints)

    def files(self) -> dict[str, str]:
        """See `Carried`: joint angles in the order of the tour, as `Robot.read_path` reads them."""
        labels = [name for name in ("position", "camera") if name not in self.joint_names]
        rows = (
            {"position": row + 1, "camera": self.cameras[row]}
            | dict(zip(self.joint_names, self.joints[row].tolist(), strict=True))
            for row in self.order.tolist()
        )
        return {JOINTS: csv_text((*labels, *self.joint_names), rows)}

    def line(self) -> str:
        """Joint angles in words."""
        if not len(self.lost):
            return f"no pose was chosen, so {JOINTS} is empty"
        most = float(self.lost.max(initial=0.0))
        flips = plural(self.flips, "wrist flip")
        text = f"joint angles along a tour of {self.length:.3g} {self.unit} with {flips}: {JOINTS}"
        for of, words in zip(SORTS, ("; minimum clearance", ", between links"), strict=True):
            if self.near[of]:
                *near, rest = self.near[of]
                text += f"{words} {_gap(min(near, key=lambda each: each.distance))}"
                text += f"; at rest {rest.link} collides with {rest.body}" * (not rest.distance)
        text += f"; the arm hides up to {most:.2f} % of the area from one image"
        better = ", and no alternative is better"
        return text + (better if most > MOST_LOST else "")


def _gap(near: Contact) -> str:
    """A clearance with its bodies; how deep they are in each other where it is a collision."""
    deep = f", {distance(near.depth)} deep" * (near.depth > 0)
    away = distance(near.distance) if near.distance else f"collision{deep}"
    return f"{away} ({near.link} to {near.body})"


@frozen_record
class _Choices:
    """Joint angles of a pose, (S, J), and what the arm hides in those that are measured."""

    joints: FloatArray
    lost: dict[int, float] = field(default_factory=dict)
    found: dict[int, Regions] = field(default_factory=dict)

    @property
    def left(self) -> IntArray:
        """Rows that a tour may take: none that hides too much, unless all that are tried do."""
        good = [row for row, lost in self.lost.items() if lost <= MOST_LOST]
        if len(self.lost) < min(MOST_TRIED, len(self.joints)):
            good += [row for row in range(len(self.joints)) if row not in self.lost]
        return np.array(good or [min(self.lost, key=self.lost.__getitem__)])


@frozen_record
class PlanArm:
    """The arm that carries all cameras of a plan, a `Carrier`."""

    plan: Plan
    arm: Arm

    def __post_init__(self) -> None:
        if self.plan.unit_of_result()[0] != "area":
            words = "candidates: expected a result by area on an arm, got one by face; omit task.by"
            raise PlanError(self.plan.name, words)

    @cached_property
    def scene(self) -> Mesh:
        """The scene, the robot, and the scene beside its turntable."""
        stationary = [] if self._stationary is None else [self._stationary]
        return Mesh.joined([self.arm.mesh, self.arm.robot.mesh, *stationary])

    @cached_property
    def _space(self) -> PoseSpace:
        return space_of(self.plan, self.arm.mesh)

    @property
    def _stationary(self) -> Mesh | None:
        """Stationary scene, as one group."""
        own = self.arm.stationary
        return own and Mesh(own.vertices, own.faces, [Group(STATIONARY, is_occluder=True)])

    def measure(
        self, finder: RegionPass, mounted: Poses, known: FloatArray | None
    ) -> tuple[list[Regions], CarriedPoses]:
        """See `Carrier`."""
        choices = [_Choices(own) for own in self._solve(mounted, known)]
        placed = [
            self.plan.mounts.cameras(mounted[row : row + 1])[0] for row in range(len(choices))
        ]
        alone = [_area(with_rule(finder.find(each), finder.camera, each)) for each in placed]
        has_new = True
        while has_new:
            has_new = False
            order, joints, taken = self._tour([own.joints[own.left] for own in choices])
            taken = np.array(
                [own.left[at] for own, at in zip(choices, taken, strict=True)], np.int64
            )
            for row, (own, at) in enumerate(zip(choices, taken.tolist(), strict=True)):
                if at not in own.lost:
                    has_new = True
                    own.found[at] = self._with_arm(finder, placed[row], own.joints[at])
                    share = (alone[row] - _area(own.found[at])) / max(self._whole, 1e-300)
                    own.lost[at] = max(0.0, 100 * share)
        pairs = list(zip(choices, taken.tolist(), strict=True))
        find_near = self.arm.collisions.contacts
        stops = np.concatenate((joints, self.arm.robot.rest[None]))
        near = {of: find_near(stops, of) for of in SORTS}
        names = [self.plan.mounts.names[index] for index in mounted.camera]
        length, flips = self._walk(order, joints)
        lost = np.array([own.lost[at] for own, at in pairs])
        turning = self.arm.robot.kinematics.is_turning
        carried = CarriedPoses(
            self.arm.robot.joint_names,
            joints,
            near,
            lost,
            names,
            order,
            length,
            turning,
            flips,
            self.arm.robot.rest,
        )
        return [own.found[at] for own, at in pairs], carried

    def _solve(self, mounted: Poses, known: FloatArray | None) -> list[FloatArray]:
        """(S, J) joint angles of each of K mounts, those that are known first."""
        poses, kinematics = mounted.world_from_camera, self.arm.robot.kinematics
        reached, further = self.arm.reach(poses), self.arm.solved(poses)
        known = reached.joints[:0] if known is None else known
        ends = self.arm.poses(known) if len(known) else np.zeros((0, 4, 4))
        solution = []
        for row, pose in enumerate(poses):
            error = pose_error(ends, np.broadcast_to(pose, ends.shape))
            own = known[norm(error) <= SAME_POSE]
            others = [each.joints[each.pose == row] for each in (reached, further)]
            own = kinematics.distinct(np.concatenate([own, *others]), self.arm.link, MOST_OPTIONS)
            if not len(own):  # inverse kinematics found it for the candidate of the same pose
                raise PlanError(
                    self.plan.name,
                    f"camera {row + 1}: expected a pose in reach, got one beyond; run place again",
                )
            solution.append(own)
        return solution

    def reaches(self, pose: FloatArray, camera: int) -> bool:
        """See `Carrier`."""
        mount = pose @ inverse(self.plan.mounts.rig.rig_from_camera[camera])
        return len(self.arm.reach(mount[None]).pose) > 0

    @cached_property
    def _whole(self) -> float:
        """Area of the task, m^2."""
        mesh = self.arm.mesh
        return float(mesh.areas[mesh.task_mask].sum())

    def _with_arm(self, finder: RegionPass, placed: Poses, joints: FloatArray) -> Regions:
        """Regions of the scene with the arm in one configuration."""
        mesh, kept = self._posed(self.scene, joints)
        at_rest = regions(mesh, finder.camera, placed, finder.task, method=self.plan.task.method)
        at_rest = at_rest._at_rest(self.scene, kept)
        own = np.arange(self.scene.n_faces) < self.arm.mesh.n_faces
        return replace(at_rest._of_faces(own), mesh=self.arm.mesh)

    @cached_property
    def _is_endless(self) -> BoolArray:
        """(J,) True for joints that may turn without end, and take the shorter way round."""
        robot = self.arm.robot
        return np.isinf(robot.limits).all(axis=1) & robot.kinematics.is_turning

    def _ways(self, joints: FloatArray) -> FloatArray:
        """Moves of joints, less the whole turns of those without limits."""
        return joints - 2 * np.pi * np.round(joints / (2 * np.pi)) * self._is_endless

    def _repeat(self, joints: FloatArray, most: int) -> tuple[FloatArray, IntArray]:
        """Up to `most` of the same postures, by whole turns of joints, and the row of each."""
        robot, rows = self.arm.robot, np.arange(len(joints))
        low, high = robot.limits.T
        for joint in np.flatnonzero(robot.kinematics.is_turning & ~self._is_endless):
            turned = np.repeat(joints[None], 3, axis=0)
            turned[:, :, joint] += 2 * np.pi * np.array([[0], [1], [-1]])
            is_within = (turned[..., joint] >= low[joint]) & (turned[..., joint] <= high[joint])
            joints, rows = turned[is_within], np.tile(rows, (3, 1))[is_within]
        away = np.abs(self._ways(joints - robot.rest)).max(axis=1, initial=0.0)
        away[: len(np.unique(rows))] = -1.0  # as they were found
        chosen = sort_order(away)[:most]
        return joints[chosen], rows[chosen]

    def _tour(self, options: Sequence[FloatArray]) -> tuple[IntArray, FloatArray, IntArray]:
        """Poses in the order of a tour from rest, their joint angles, and which option each is.

        Each of K poses has options, (S, J). The order and the options are chosen together.
        """
        most = int(np.clip(MOST_NODES // max(len(options), 1), 1, MOST_OPTIONS))
        nodes = [self._repeat(own, most) for own in options]
        joints = np.concatenate([self.arm.robot.rest[None], *(each for each, _ in nodes)])
        stop = owners_of([len(rows) for _, rows in nodes])
        costs = np.abs(self._ways(joints[:, None] - joints[None])).max(axis=2, initial=0.0)
        best = tour(costs, stop)
        at = best[sort_order(stop[best])]
        rows = np.concatenate([np.zeros(0, np.int64), *(rows for _, rows in nodes)])
        return stop[best], joints[at + 1], rows[at]

    def _walk(self, order: IntArray, joints: FloatArray) -> tuple[float, int]:
        """Length of a tour, and its wrist flips.

        Joints without limits take the shorter way round: their angles in `joints` are changed by
        whole turns.
        """
        here, length, flips = self.arm.robot.rest, 0.0, 0
        chain = self.arm.robot.kinematics.chain(self.arm.link)
        wrist = [each.column for each in chain if each.column >= 0 and each.kind != "prismatic"][
            -3:
        ]
        for row in order:
            move = self._ways(joints[row] - here)
            joints[row] = here + move
            length += float(np.abs(move).max(initial=0.0))
            flips += bool((np.abs(move[wrist]) > np.pi / 2).any())
            here = joints[row]
        return length, flips

    def parts(self, joints: FloatArray) -> list[Mesh | None]:
        """See `Carrier`: links in turn, and the link that holds the camera."""
        robot = self.arm.robot
        mesh, chain = self._posed(robot.mesh, joints)[0], robot.kinematics.chain(self.arm.link)
        turn_of = {
            each.child: sum(e.column >= 0 for e in chain[: row + 1]) % 2
            for row, each in enumerate(chain)
        }
        turn_of[self.arm.link] = 2
        links = [turn_of.get(group.name.rpartition("/")[2], 0) for group in mesh.groups]
        of_face = np.array(links)[mesh.face_group]
        kept = [mesh.faces[of_face == each] for each in range(3)]
        return [Mesh(mesh.vertices, faces) if len(faces) else None for faces in kept]

    def _posed(self, scene: Mesh, joints: FloatArray) -> tuple[Mesh, IntArray]:
        """A scene with the arm in one configuration, as of `place_bodies`."""
        poses = {name: table[0] for name, table in self.arm.robot.poses(joints).items()}
        if self.arm.stationary is not None and scene is self.scene:
            poses[STATIONARY] = self.arm.stationary_poses(joints)[0]
        return bodies.place_bodies(scene, poses)

    def refine(
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
                        items = []
                        for trial in range(len(trials)):
                            at = slice(trial * width, (trial + 1) * width)
                            rows, where = covers.copy(), eyes.copy()
                            rows[own], where[own] = new[at], centres[at]
                            items.append(worth(rows, where))
                        best = int(np.argmax(items))
                        if items[best] > trace[-1]:
                            at = slice(best * width, (best + 1) * width)
                            covers[own], eyes[own] = new[at], centres[at]
                            joints[row], poses[row] = trials[best], ends[best]
                            trace.append(items[best])
                            has_gained = True
        except KeyboardInterrupt:
            status = INTERRUPTED
        shares = objective.share(np.array(trace, np.int64))
        moved = (poses != start).any(axis=(1, 2))
        found_: ByName = {"evaluations": spent, "seconds": time.perf_counter() - began}
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
        trials = trials[self.arm.is_free(trials)]
        return trials[self._space.allows(self.arm.poses(trials)[:, :3, 3])]


def _area(regions: Regions) -> float:
    """Area of what some row covers, m^2."""
    rows = np.zeros(len(regions.pose_ids), np.int64)
    return float(regions.at_least(1, rows, one_side=False).area.sum()) if len(rows) else 0.0


def arms_of(plan: Plan, mesh: Mesh) -> list[Arm]:
    """Arm of each entry `on_arm` of a plan; PlanError where it cannot be made."""
    arms = []
    for row, entry in enumerate(plan.candidates):
        if isinstance(entry, OnArm):
            robot = _robot(plan, entry)
            with errors_at(plan.name, f"candidates[{row}]"):
                arms.append(_arm(plan, mesh, entry, robot))
    return arms


def _robot(plan: Plan, entry: OnArm) -> Robot:
    row = [each.name for each in plan.bodies].index(entry.body.partition("/")[0])
    with errors_at(plan.name, f"bodies[{row}]"):
        robot = HOOKS.read_joints(plan.bodies[row], plan.folder)
    assert robot is not None
    return robot


def _arm(plan: Plan, mesh: Mesh, entry: OnArm, robot: Robot) -> Arm:
    _, _, link = entry.body.partition("/")
    pairs = [(one, other) for one, other in entry.allowed]
    if (table := plan.table) is not None:
        robot = robot.on_turntable(table.axis, table.centre, table.degrees)
    return Arm(
        robot,
        link,
        mesh,
        entry.mount.matrix(),
        entry.clearance,
        keep_outs(plan),
        pairs,
        entry.link_clearance,
        table and table.stationary,
        plan.constraints.clearance,
        [(each.low, each.high) for each in plan.constraints.spaces if table],
    )


class OfArms(PlanScene):
    """Arms of robots."""

    key, files = "arm", (JOINTS,)

    def check(self, plan: Plan, folder: Path) -> None:
        """See `PlanFeature`."""
        own = [each for each in plan.candidates if isinstance(each, OnArm)]
        if not own:
            return
        others = [each.generator for each in plan.candidates if not isinstance(each, OnArm)]
        if others:
            raise ValueError(
                f"candidates: expected only on_arm, got {others[0]}; move it into its 'of'"
            )
        if len({repr([getattr(e, name) for name in SHARED]) for e in own}) > 1:
            raise ValueError(
                f"candidates: expected one {', '.join(SHARED)} on_arm, got several; keep one"
            )
        name = own[0].body.partition("/")[0]
        if [body.name for body in plan.bodies if body.urdf is not None] != [name]:
            raise ValueError(
                f"candidates: expected {name!r} as the only body with urdf, got others; correct it"
            )
        plan.refuse(("optimise", "tolerance"), "on an arm")

    def is_still(self, plan: Plan) -> bool:
        """See `PlanFeature`."""
        return not any(each.is_carried for each in plan.candidates)

    def read_joints(self, body: BodyEntry, folder: Path) -> Robot | None:
        """See `PlanFeature`."""
        if body.urdf is None:
            return None
        folders: dict[str, StrPath] = {name: folder / each for name, each in body.packages.items()}
        path, base = folder / body.urdf, body.base.matrix()
        return Robot.load(path, folders, body.geometry, base=base, name=body.name)

    def make(
        self,
        plan: Plan,
        mesh: Mesh,
        entry: Generator,
        make: Callable[[Generator], Iterator[Candidates]],
    ) -> Iterator[Candidates]:
        """See `PlanScene`."""
        assert isinstance(entry, OnArm)
        arm = _arm(plan, mesh, entry, _robot(plan, entry))
        return (on_arm(part, arm) for part in make(entry.views()))

    def carrier(self, plan: Plan, mesh: Mesh) -> PlanArm | None:
        """See `PlanScene`."""
        arms = arms_of(plan, mesh)
        return PlanArm(plan, arms[0]) if arms else None


HOOKS = OfArms()
