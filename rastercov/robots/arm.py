"""Candidates on the arm of a robot: poses that it reaches without a collision, with joint angles.

A pose of another generator is kept where inverse kinematics finds joint angles for it at which no
link touches the scene, a keep-out volume, or another link. Sampling joint angles instead would
leave hardly any candidate that looks at the part.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    BoolArray,
    ByteArray,
    ConfigError,
    FloatArray,
    IntArray,
    check_kind,
    dots,
    frozen_record,
    shown,
)
from rastercov.core.mesh import Mesh, shapes
from rastercov.core.mesh.arrays import frozen, inverse
from rastercov.core.mesh.groups import Group
from rastercov.placement.candidates.pool import Candidates, Refusal
from rastercov.placement.candidates.rooms import (
    KeepOut,
    KeepOutBox,
    KeepOutSphere,
    NearestSurface,
    Place,
    check_clearance,
    nearest_obstacle,
    place_of,
)
from rastercov.robots.collisions import SORTS, Collisions, Contact
from rastercov.robots.kinematics import Solutions
from rastercov.robots.robot import FLOOR, Robot

ENOUGH = 0.1
"""Clearance, metres, beyond which solutions of a pose count as equal, unless more is asked."""
TOUCH = 1e-3
"""Distance of links, metres, beyond which none is computed, unless more is asked."""

MORE_STARTS = 128
"""Of inverse kinematics for poses whose first solutions collide."""
VOLUME = "keep-out volume"
"""Start of the name of a body."""
EXAMINED = 3
"""Solutions of a pose whose collisions are looked into."""


class Missed(NamedTuple):
    """Reason why an arm does not reach a pose; attributes as of `Refusal`."""

    reason: str
    words: str
    lack: float = 0.0
    unit: str = "m"


class Reached(NamedTuple):
    """Joint angles that bring a camera to poses, without a collision.

    Attributes
    ----------
    pose : (S,) int64
        Row of the pose of each solution, ascending; a pose that is not reached has none.
    joints : (S, J) float64
        Joint angles of each solution; those of a pose with the greatest clearance come first.
    clearance : (S,) float64
        Clearance of each solution, as of `Arm.clear`.
    missed : dict of int to Missed
        Reason for each row whose pose is not reached.
    """

    pose: IntArray
    joints: FloatArray
    clearance: FloatArray
    missed: dict[int, Missed]


@frozen_record
class Arm:
    """A robot that carries a camera or a rig.

    Attributes
    ----------
    robot : Robot
        The robot.
    link : str
        Link to which the camera is fixed; a joint must move it.
    mesh : Mesh
        The scene without the robot; on a turntable what turns with it.
    link_from_mount : (4, 4) float64, optional
        Pose of the camera or rig on the link; the frame of the link unless given.
    clearance : float
        Minimum distance of links from the scene and keep-out volumes, metres.
    keep_out : sequence of KeepOutBox or KeepOutSphere
        Volumes that neither links nor the camera may enter; a turntable does not turn them.
    allowed : sequence of (str, str)
        Pairs of links that may touch, in addition to adjacent ones.
    link_clearance : float
        Minimum distance of links from each other, metres; at 0 they may not touch.
    stationary : Mesh, optional
        Scene that the turntable of `Robot.on_turntable` does not turn, as it is at angle 0.
    camera_clearance : float
        Minimum distance of the camera centre from it, metres.
    spaces : sequence of (2, 3) array_like
        Boxes that may hold the camera centre, which a turntable does not turn; anywhere if empty.

    Raises
    ------
    ConfigError
        For an unknown link or one that does not move, and for a negative clearance.

    Examples
    --------
    >>> from pathlib import Path
    >>> import rastercov as rc
    >>> from rastercov.placement import Arm
    >>> box = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
    >>> _ = Path("gate.urdf").write_text(
    ...     f'<robot name="gate"><link name="rail"/><link name="head">{box}</link>'
    ...     '<joint name="x" type="prismatic"><parent link="rail"/><child link="head"/>'
    ...     '<axis xyz="1 0 0"/><limit lower="0" upper="3"/></joint></robot>'
    ... )
    >>> arm = Arm(rc.Robot.load("gate.urdf"), "head", rc.shapes.box(), clearance=0.02)
    >>> arm.link, arm.clearance
    ('head', 0.02)
    """

    robot: Robot
    link: str
    mesh: Mesh
    link_from_mount: ArrayLike | None = None
    clearance: float = 0.0
    keep_out: Sequence[KeepOut] = ()
    allowed: Sequence[tuple[str, str]] = ()
    link_clearance: float = 0.0
    stationary: Mesh | None = None
    camera_clearance: float = 0.0
    spaces: Sequence[ArrayLike] = ()

    def __post_init__(self) -> None:
        check_kind("robot", self.robot, Robot, "a Robot", ConfigError)
        check_kind("mesh", self.mesh, Mesh, "a Mesh", ConfigError)
        if not self.robot.is_moving(self.link):
            raise ConfigError(
                f"expected a link that a joint moves, got {shown(self.link)}; name one"
            )
        if self.stationary is not None:
            check_kind("stationary", self.stationary, Mesh, "a Mesh", ConfigError)
        for each in (self.clearance, self.link_clearance, self.camera_clearance):
            check_clearance(each)

    @cached_property
    def collisions(self) -> Collisions:
        """Distances of the robot from the scene and the keep-out volumes."""
        stationary = [*self._volumes, *([] if self.stationary is None else [self.stationary])]
        return Collisions(self.robot, [self.mesh], list(self.allowed), stationary)

    @cached_property
    def _volumes(self) -> list[Mesh]:
        """Keep-out volumes as meshes."""
        return [_volume(each) for each in self.keep_out]

    @cached_property
    def _mount(self) -> FloatArray:
        given = np.eye(4) if self.link_from_mount is None else self.link_from_mount
        return np.asarray(given, np.float64)

    def poses(self, joints: ArrayLike) -> FloatArray:
        """(N, 4, 4) world_from_mount in (N, J) configurations, see `Robot.frames`."""
        return self.robot.frames(joints)[self.link] @ self._mount

    def stationary_poses(self, joints: ArrayLike) -> FloatArray:
        """(N, 4, 4) motion of the stationary scene in (N, J) configurations."""
        frames = self.robot.frames(joints)
        if FLOOR not in frames:
            return np.tile(np.eye(4), (len(frames[self.link]), 1, 1))
        return frames[FLOOR] @ inverse(self.robot.frames(self.robot.rest)[FLOOR])

    def clear(self, joints: ArrayLike) -> FloatArray:
        """(N,) clearance of (N, J) configurations from the scene, metres; 0 in collision.

        Computed up to 0.1 m, or twice the required clearance if that is more.
        """
        return self.collisions.clearance(joints, max(ENOUGH, 2 * self.clearance), "scene")

    def is_free(self, joints: FloatArray) -> BoolArray:
        """(N,) True for (N, J) configurations that keep all clearances and volumes."""
        return self._classify(joints)[1]

    def _classify(self, joints: FloatArray) -> tuple[FloatArray, BoolArray]:
        """(N,) clearance and (N,) True where a configuration is free."""
        if not len(joints):
            return np.zeros(0), np.zeros(0, bool)
        clearance = self.clear(joints)
        free = (clearance > 0) & (clearance >= self.clearance)
        if len(rows := np.flatnonzero(free)):
            most = max(TOUCH, 2 * self.link_clearance)
            apart = self.collisions.clearance(joints[rows], most, "links")
            free[rows] = (apart > 0) & (apart >= self.link_clearance)
        if len(rows := np.flatnonzero(free)):
            free[rows] = self._places(self._eyes(joints[rows])) == Place.ALLOWED
        return clearance, free

    def _eyes(self, joints: FloatArray) -> FloatArray:
        """(N, 3) camera centres in the stationary scene."""
        beside = inverse(self.stationary_poses(joints)) @ self.poses(joints)
        return np.ascontiguousarray(beside[:, :3, 3])

    def _places(self, eyes: FloatArray) -> ByteArray:
        """(N,) `Place` of camera centres in the stationary scene."""
        own = self._surface, self.camera_clearance, self.keep_out
        place = place_of(self.stationary, eyes, *own)
        if len(self.spaces):
            low, high = np.moveaxis(np.asarray(self.spaces, np.float64), 1, 0)
            is_in = (eyes[:, None] >= low) & (eyes[:, None] <= high)
            place[~is_in.all(axis=2).any(axis=1)] = Place.OUTSIDE
        return place

    @cached_property
    def _surface(self) -> NearestSurface | None:
        return None if self.stationary is None else nearest_obstacle(self.stationary)

    def reach(self, poses: ArrayLike) -> Reached:
        """Joint angles of (N, 4, 4) world_from_mount, without a collision."""
        given = np.asarray(poses)
        if not len(given):
            none = np.zeros((0, len(self.robot.joint_names)))
            return Reached(np.zeros(0, np.int64), none, np.zeros(0), {})
        solution = self.robot.solve(given, self.link, self._mount)
        pose, joints = solution.pose, solution.joints
        clearance, is_free = self._classify(joints)
        hits = np.setdiff1d(pose, pose[is_free])
        if len(hits):
            own = given[hits], self.link, self._mount
            more = self.robot.kinematics.solve(*own, (MORE_STARTS,), 0, MORE_STARTS)
            pose = np.concatenate([pose, hits[more.pose]])
            joints = np.concatenate([joints, more.joints])
            further = self._classify(more.joints)
            clearance = np.concatenate([clearance, further[0]])
            is_free = np.concatenate([is_free, further[1]])
        order = np.lexsort((-clearance, pose))
        pose, joints, clearance = pose[order], joints[order], clearance[order]
        is_free = is_free[order]
        hits = np.setdiff1d(pose, pose[is_free])
        missed = self._beyond(solution.beyond) | self._hit(hits, pose, joints)
        return Reached(pose[is_free], joints[is_free], clearance[is_free], missed)

    def solved(self, poses: FloatArray) -> Solutions:
        """Further joint angles of (N, 4, 4) world_from_mount, without a collision."""
        starts, most = (MORE_STARTS,), MORE_STARTS
        solution = self.robot.kinematics.solve(poses, self.link, self._mount, starts, 0, most)
        is_free = self.is_free(solution.joints)
        return solution._replace(pose=solution.pose[is_free], joints=solution.joints[is_free])

    def _beyond(self, beyond: FloatArray) -> dict[int, Missed]:
        """Poses without a solution, by how far the nearest is beyond the limits of joints."""
        kinds = {each.column: each.kind for each in self.robot.kinematics.joints}
        table = {}
        for row in np.flatnonzero(beyond.max(axis=1, initial=0.0) > 0).tolist():
            joint = int(beyond[row].argmax())
            if not np.isfinite(beyond[row, joint]):
                table[row] = Missed("out_of_reach", "out of reach")
                continue
            words, over = f"{self.robot.joint_names[joint]} beyond its limit", beyond[row, joint]
            is_length = kinds[joint] == "prismatic"
            lack, unit = (over, "m") if is_length else (np.degrees(over), "deg")
            table[row] = Missed("joint_limits", words, float(lack), unit)
        return table

    def _hit(self, hits: IntArray, pose: IntArray, joints: FloatArray) -> dict[int, Missed]:
        """Poses whose solutions all collide, by the bodies of the one that is nearest to free."""
        starts = np.searchsorted(pose, hits)
        ends = np.minimum(np.searchsorted(pose, hits, "right"), starts + EXAMINED)
        rows = [row for ends_of in zip(starts, ends, strict=True) for row in range(*ends_of)]
        misseds: dict[int, Missed] = {}
        if not rows:
            return misseds
        limits = {"scene": self.clearance, "links": self.link_clearance}
        near = {of: self.collisions.contacts(joints[rows], of) for of in SORTS}
        for at, row in enumerate(rows):
            each = [_missed_limit(own[at], limits[of]) for of, own in near.items() if own]
            causes = [cause for cause in each if cause is not None]
            new = max(causes, key=_rank) if causes else self._misplacement(joints[row])
            known = misseds.get(int(pose[row]), new)
            misseds[int(pose[row])] = min(known, new, key=_rank)
        return misseds

    def _misplacement(self, joints: FloatArray) -> Missed:
        """Reason why a camera centre is not where it may be."""
        eye = self._eyes(joints[None])
        place = self._places(eye)[0]
        if place == Place.KEPT_OUT:
            name = next(each.name for each in self.keep_out if each.contains(eye)[0])
            return Missed("keep_out", f"camera in {VOLUME} {name}")
        if place == Place.OUTSIDE:
            return Missed("outside", "camera outside the spaces")
        if self.stationary is None or self._surface is None:
            return Missed("clearance", "a link too close")  # by rounding
        near = self._surface.query(eye)
        what = self.stationary.groups[self.stationary.face_group[near.face[0]]].name
        if place == Place.IN_SOLID:
            return Missed("collision", f"camera in or behind {what}")
        lack = max(0.0, self.camera_clearance - float(near.distance[0]))
        return Missed("clearance", f"camera too close to {what}", lack)


def _rank(missed: Missed) -> tuple[bool, float]:
    """Order of reasons, the one that is mended most easily first."""
    return missed.reason != "clearance", missed.lack


def _missed_limit(contact: Contact, limit: float) -> Missed | None:
    """Reason of a pair that is nearer than a limit."""
    if contact.distance > 0 and contact.distance >= limit:
        return None
    link, body, distance, depth = contact
    if distance > 0:
        return Missed("clearance", f"{link} too close to {body}", limit - distance)
    if body.startswith(VOLUME):
        return Missed("keep_out", f"{link} in {body}", depth)
    return Missed("collision", f"{link} collides with {body}", depth)


def on_arm(candidates: Candidates, arm: Arm) -> Candidates:
    """Candidates that an arm reaches without a collision, in their order.

    Parameters
    ----------
    candidates : Candidates
        Candidates of any other generator, which keep their rolls.
    arm : Arm
        The robot with its mount and scene.

    Returns
    -------
    Candidates
        Their source is "SOURCE on ROBOT"; `Arm.reach` finds the joint angles of each. `refused` has
        the others, with reasons.

    Examples
    --------
    >>> from pathlib import Path
    >>> import numpy as np
    >>> import rastercov as rc
    >>> from rastercov.placement import Arm, from_poses, on_arm
    >>> box = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
    >>> _ = Path("gate.urdf").write_text(
    ...     f'<robot name="gate"><link name="rail"/><link name="head">{box}</link>'
    ...     '<joint name="x" type="prismatic"><parent link="rail"/><child link="head"/>'
    ...     '<axis xyz="1 0 0"/><limit lower="0" upper="3"/></joint></robot>'
    ... )
    >>> mesh, camera = rc.shapes.box(centre=(0, 0, 5)), rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> poses = np.tile(np.eye(4), (3, 1, 1))
    >>> poses[:, 0, 3] = (0.5, 2, 4)
    >>> result = from_poses(mesh, camera, poses=poses)
    >>> kept = on_arm(result, Arm(rc.Robot.load("gate.urdf"), "head", mesh))
    >>> kept.index.tolist()  # the rail ends at 3 m
    [0, 1]
    """
    check_kind("candidates", candidates, Candidates, "Candidates", ConfigError)
    check_kind("arm", arm, Arm, "an Arm", ConfigError)
    reached = arm.reach(candidates.poses)
    sources = tuple(f"{each} on {arm.robot.name}" for each in candidates.sources)
    proposed = replace(candidates, sources=sources)
    refused = [
        Refusal(candidates.poses[row], str(proposed.source[row]), *missed)
        for row, missed in sorted(reached.missed.items())
    ]
    kept = proposed.take(np.unique(reached.pose))
    return replace(kept, refused=(*kept.refused, *refused))


def _volume(volume: KeepOut) -> Mesh:
    """Mesh of a keep-out volume; about a sphere, 1 % larger than it at most."""
    if isinstance(volume, KeepOutBox):
        low, high = np.array(volume.low), np.array(volume.high)
        size = np.maximum(high - low, 1e-9)  # a flat one is a thin one
        solid = shapes.box(tuple(size.tolist()), 1, tuple(((low + high) / 2).tolist()))
        vertices = solid.vertices
    elif isinstance(volume, KeepOutSphere):
        solid = shapes.sphere(3, 1.0)
        planes = dots(solid.normals, solid.centroids)
        vertices = frozen(solid.vertices * (volume.radius / planes.min()) + volume.centre)
    else:
        kind = type(volume).__name__
        raise ConfigError(f"expected a keep-out box or sphere for an arm, got {kind}; give one")
    return Mesh(vertices, solid.faces, [Group(f"{VOLUME} {volume.name}", is_occluder=True)])
