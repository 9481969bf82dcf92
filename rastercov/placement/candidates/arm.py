"""Candidates on the arm of a robot: poses that it reaches without a collision, with joint angles.

A pose of another generator is kept where inverse kinematics finds joint angles for it at which no
link touches the scene, a keep-out volume, or another link. Sampling joint angles instead would
leave hardly any candidate that looks at the part.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base.arguments import check_kind
from rastercov.base.checks import shown
from rastercov.base.errors import ConfigError
from rastercov.base.memory import BoolArray, FloatArray, IntArray
from rastercov.mesh import Mesh, shapes
from rastercov.mesh.arrays import frozen
from rastercov.mesh.collisions import Collisions
from rastercov.mesh.groups import Group
from rastercov.mesh.robot import Robot
from rastercov.placement.candidates.clearance import (
    KeepOut,
    KeepOutBox,
    KeepOutSphere,
    check_clearance,
)
from rastercov.placement.candidates.pool import Candidates
from rastercov.placement.candidates.refusals import Refusal

ENOUGH = 0.1
"""Clearance, metres, beyond which solutions of a pose count as equal, unless more is asked."""


MORE_STARTS = 128
"""Of inverse kinematics for poses whose first solutions collide."""
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


@dataclass(frozen=True, eq=False)
class Arm:
    """A robot that carries a camera or a rig.

    Attributes
    ----------
    robot : Robot
        The robot.
    link : str
        Link to which the camera is fixed; a joint must move it.
    mesh : Mesh
        The scene without the robot.
    link_from_mount : (4, 4) float64, optional
        Pose of the camera or rig on the link; the frame of the link unless given.
    clearance : float
        Minimum distance of links from the scene, keep-out volumes and each other, metres.
    keep_out : sequence of KeepOutBox or KeepOutSphere
        Volumes that links must not enter.
    allowed : sequence of (str, str)
        Pairs of links that may touch, in addition to adjacent ones.

    Raises
    ------
    ConfigError
        For an unknown link or one that does not move, and a negative clearance.

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

    def __post_init__(self) -> None:
        check_kind("robot", self.robot, Robot, "a Robot", ConfigError)
        check_kind("mesh", self.mesh, Mesh, "a Mesh", ConfigError)
        if not self.robot.is_moving(self.link):
            raise ConfigError(
                f"expected a link that a joint moves, got {shown(self.link)}; name one"
            )
        check_clearance(self.clearance)

    @cached_property
    def collisions(self) -> Collisions:
        """Distances of the robot from the scene and the keep-out volumes."""
        return Collisions(self.robot, [self.mesh, *self._volumes], list(self.allowed))

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

    def clear(self, joints: ArrayLike) -> FloatArray:
        """(N,) clearance of (N, J) configurations, metres; 0 in collision.

        Computed up to 0.1 m, or twice the required clearance if that is more.
        """
        return self.collisions.clearance(joints, max(ENOUGH, 2 * self.clearance))

    def is_free(self, clearance: FloatArray) -> BoolArray:
        """(N,) True for clearances, metres, that are sufficient."""
        return (clearance > 0) & (clearance >= self.clearance)

    def reach(self, poses: ArrayLike) -> Reached:
        """Joint angles of (N, 4, 4) world_from_mount, without a collision."""
        given = np.asarray(poses)
        if not len(given):
            none = np.zeros((0, len(self.robot.joint_names)))
            return Reached(np.zeros(0, np.int64), none, np.zeros(0), {})
        found = self.robot.solve(given, self.link, self._mount)
        pose, joints, clearance = found.pose, found.joints, self._clear(found.joints)
        hits = np.setdiff1d(pose, pose[self.is_free(clearance)])
        if len(hits):
            own = given[hits], self.link, self._mount
            more = self.robot.kinematics.solve(*own, (MORE_STARTS,), 0, MORE_STARTS)
            pose = np.concatenate([pose, hits[more.pose]])
            joints = np.concatenate([joints, more.joints])
            clearance = np.concatenate([clearance, self._clear(more.joints)])
        order = np.lexsort((-clearance, pose))
        pose, joints, clearance = pose[order], joints[order], clearance[order]
        is_free = self.is_free(clearance)
        hits = np.setdiff1d(pose, pose[is_free])
        missed = self._beyond(found.beyond) | self._hit(hits, pose, joints)
        return Reached(pose[is_free], joints[is_free], clearance[is_free], missed)

    def _clear(self, joints: FloatArray) -> FloatArray:
        return self.clear(joints) if len(joints) else np.zeros(0)

    def _beyond(self, beyond: FloatArray) -> dict[int, Missed]:
        """Poses without a solution, by how far the nearest is beyond the limits of joints."""
        kinds = {each.column: each.kind for each in self.robot.kinematics.joints}
        found = {}
        for row in np.flatnonzero(beyond.max(axis=1, initial=0.0) > 0).tolist():
            joint = int(beyond[row].argmax())
            if not np.isfinite(beyond[row, joint]):
                found[row] = Missed("out_of_reach", "out of reach")
                continue
            words, over = f"{self.robot.joint_names[joint]} beyond its limit", beyond[row, joint]
            is_length = kinds[joint] == "prismatic"
            lack, unit = (over, "m") if is_length else (np.degrees(over), "deg")
            found[row] = Missed("joint_limits", words, float(lack), unit)
        return found

    def _hit(self, hits: IntArray, pose: IntArray, joints: FloatArray) -> dict[int, Missed]:
        """Poses whose solutions all collide, by the bodies of the one that is nearest to free."""
        starts = np.searchsorted(pose, hits)
        ends = np.minimum(np.searchsorted(pose, hits, "right"), starts + EXAMINED)
        rows = [row for ends_of in zip(starts, ends, strict=True) for row in range(*ends_of)]
        found: dict[int, Missed] = {}
        kept_out = [group.name for each in self._volumes for group in each.groups]
        for row, each in zip(
            rows, self.collisions.contacts(joints[rows]) if rows else (), strict=True
        ):
            lack = each.depth
            if each.body in kept_out:
                new = Missed("keep_out", f"{each.link} in {each.body}", lack)
            elif each.distance > 0:
                lack = self.clearance - each.distance
                new = Missed("clearance", f"{each.link} too close to {each.body}", lack)
            else:
                new = Missed("collision", f"{each.link} collides with {each.body}", lack)
            known = found.get(int(pose[row]))
            rank = (new.reason != "clearance", lack)
            if known is None or rank < (known.reason != "clearance", known.lack):
                found[int(pose[row])] = new
        return found


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
    >>> found = from_poses(mesh, camera, poses=poses)
    >>> kept = on_arm(found, Arm(rc.Robot.load("gate.urdf"), "head", mesh))
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
        planes = np.einsum("ij,ij->i", solid.normals, solid.centroids)
        vertices = frozen(solid.vertices * (volume.radius / planes.min()) + volume.centre)
    else:
        kind = type(volume).__name__
        raise ConfigError(f"expected a keep-out box or sphere for an arm, got {kind}; give one")
    return Mesh(vertices, solid.faces, [Group(f"keep-out volume {volume.name}", is_occluder=True)])
