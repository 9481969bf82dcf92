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
from numpy.typing import ArrayLike, NDArray

from rastercov.base.arguments import check_kind
from rastercov.base.errors import ConfigError
from rastercov.base.memory import FloatArray, IntArray
from rastercov.mesh import Mesh, shapes
from rastercov.mesh.arrays import frozen
from rastercov.mesh.collisions import Collisions
from rastercov.mesh.robot import Robot
from rastercov.placement.candidates.clearance import (
    KeepOut,
    KeepOutBox,
    KeepOutSphere,
    check_clearance,
)
from rastercov.placement.candidates.pool import Candidates

ENOUGH = 0.1
"""Clearance, metres, beyond which solutions of a pose count as equal, unless more is asked."""


class Reached(NamedTuple):
    """Joint angles that bring a camera to poses, without a collision.

    Attributes
    ----------
    pose : (S,) int64
        Row of each pose, ascending; a pose that is not reached has none.
    joints : (S, J) float64
        Of each pose those with the greatest clearance first.
    clearance : (S,) float64
        Metres, up to `ENOUGH` or twice what is asked for.
    """

    pose: IntArray
    joints: FloatArray
    clearance: FloatArray


@dataclass(frozen=True, eq=False)
class Arm:
    """A robot that carries a camera or a rig.

    Attributes
    ----------
    robot : Robot
    link : str
        Link to which the camera is fixed.
    mesh : Mesh
        The scene without the robot.
    link_from_mount : (4, 4) float64, optional
        Pose of the camera or rig on the link; that of the link unless given.
    clearance : float
        Least distance of links from the scene, keep-out volumes and each other, metres.
    keep_out : sequence of KeepOutBox or KeepOutSphere
        Volumes without links.
    allowed : pairs of str
        Links that may touch, beside those that are next to each other.

    Raises
    ------
    ConfigError
        For an unknown link, a negative clearance, keep-out volumes of another kind.
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
            raise ConfigError(f"link {self.link!r} must be one that a joint moves")
        check_clearance(self.clearance)

    @cached_property
    def collisions(self) -> Collisions:
        """Distances of the robot from the scene and the keep-out volumes."""
        around = [_volume(each) for each in self.keep_out]
        return Collisions(self.robot, [self.mesh, *around], list(self.allowed))

    @cached_property
    def _mount(self) -> FloatArray:
        given = np.eye(4) if self.link_from_mount is None else self.link_from_mount
        return np.asarray(given, np.float64)

    def poses(self, joints: ArrayLike) -> FloatArray:
        """(N, 4, 4) world_from_mount in (N, J) configurations."""
        return self.robot.frames(joints)[self.link] @ self._mount

    def clear(self, joints: ArrayLike) -> FloatArray:
        """(N,) clearance of (N, J) configurations, metres; less than is asked for is too little."""
        return self.collisions.clearance(joints, max(ENOUGH, 2 * self.clearance))

    def is_free(self, clearance: FloatArray) -> NDArray[np.bool_]:
        """(N,) True for clearances that are enough."""
        return (clearance > 0) & (clearance >= self.clearance)

    def reach(self, poses: ArrayLike) -> Reached:
        """Joint angles of (N, 4, 4) world_from_mount, without a collision."""
        given = np.asarray(poses)
        if not len(given):
            none = np.zeros((0, len(self.robot.joint_names)))
            return Reached(np.zeros(0, np.int64), none, np.zeros(0))
        found = self.robot.solve(given, self.link, self._mount)
        if not len(found.pose):
            return Reached(found.pose, found.joints, np.zeros(0))
        clearance = self.clear(found.joints)
        order = np.lexsort((-clearance, found.pose))
        order = order[self.is_free(clearance[order])]
        return Reached(found.pose[order], found.joints[order], clearance[order])


def on_arm(candidates: Candidates, arm: Arm) -> Candidates:
    """Candidates that an arm reaches without a collision, in their order.

    Parameters
    ----------
    candidates : Candidates
        Of any other generator; rolls are theirs.
    arm : Arm

    Returns
    -------
    Candidates
        Their source is "SOURCE on ROBOT"; `Arm.reach` has the joint angles of each.
    """
    check_kind("candidates", candidates, Candidates, "Candidates", ConfigError)
    check_kind("arm", arm, Arm, "an Arm", ConfigError)
    kept = candidates.take(np.unique(arm.reach(candidates.poses).pose))
    return replace(kept, sources=tuple(f"{each} on {arm.robot.name}" for each in kept.sources))


def _volume(volume: KeepOut) -> Mesh:
    """Mesh of a keep-out volume; about a sphere, 1 % larger than it at most."""
    if isinstance(volume, KeepOutBox):
        low, high = np.array(volume.low), np.array(volume.high)
        size = np.maximum(high - low, 1e-9)  # a flat one is a thin one
        return shapes.box(tuple(size.tolist()), 1, tuple(((low + high) / 2).tolist()))
    if isinstance(volume, KeepOutSphere):
        ball = shapes.sphere(3, 1.0)
        planes = np.einsum("ij,ij->i", ball.normals, ball.centroids)
        vertices = ball.vertices * (volume.radius / planes.min()) + volume.centre
        return Mesh(frozen(vertices), ball.faces)
    raise ConfigError(f"an arm keeps out of boxes and spheres, got {type(volume).__name__}")
