"""Forward and inverse kinematics of a tree of links, for many configurations at once.

Forward: the pose of a link is that of its parent, times the origin of the joint, times the turn or
the way of its value. Inverse: damped least squares from several starts,

    dq = J^T (J J^T + l^2 I)^-1 e,

with the error e of position and rotation, 6 numbers, and a damping l that vanishes with it.

Y. Nakamura and H. Hanafusa. Inverse Kinematic Solutions with Singularity Robustness for Robot
Manipulator Control. 1986. S. R. Buss and J.-S. Kim. Selectively Damped Least Squares for Inverse
Kinematics. 2005, for the limit of a step.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from rastercov.base import BoolArray, FloatArray, IntArray, frozen_record, norm, sort_order
from rastercov.core.mesh.arrays import cross_matrix
from rastercov.robots.urdf import Joint

MET = 1e-6
"""Norm of the error, metres and radians together, at which a pose is met."""
MOST_STEPS = 80
DAMPING = 0.03
"""Damping for an error of 1 or more; in proportion to smaller ones."""
LONGEST_STEP = 0.5
"""Radians, or metres, that a joint moves in a step at most."""
APART = 1e-2
"""Radians, or metres, by which some joint differs in two solutions."""
ROWS_AT_ONCE = 1 << 14
"""Poses times starts that are solved together: a few tens of MB."""


class Solutions(NamedTuple):
    """Joint angles that reach poses.

    Attributes
    ----------
    pose : (S,) int64
        Row of the pose that each reaches, in ascending order.
    joints : (S, J) float64
        Radians, or metres of prismatic joints, within the limits.
    beyond : (N, J) float64
        Radians or metres beyond the limits, of each pose, of the joint angles that lead to it and
        exceed them least: 0 for a pose with a solution, inf where no joint angles were found.
    """

    pose: IntArray
    joints: FloatArray
    beyond: FloatArray


@frozen_record
class Kinematics:
    """Links and joints of a robot; see `rastercov.robots.urdf`."""

    links: tuple[str, ...]
    joints: tuple[Joint, ...]
    limits: FloatArray
    base: FloatArray

    @cached_property
    def _turns(self) -> dict[str, tuple[FloatArray, FloatArray]]:
        """Matrices K and K^2 of Rodrigues' formula, by joint."""
        turns = {}
        for each in self.joints:
            cross = cross_matrix(each.axis)
            turns[each.name] = cross, cross @ cross
        return turns

    def chain(self, tip: str) -> list[Joint]:
        """Joints from the root to a link."""
        of_child, items = {each.child: each for each in self.joints}, []
        while tip in of_child:
            items.append(of_child[tip])
            tip = of_child[tip].parent
        return items[::-1]

    def frames(
        self, joints: FloatArray, along: Sequence[Joint] | None = None
    ) -> dict[str, FloatArray]:
        """(N, 4, 4) world_from_link of (N, J) configurations, of all links or along a chain."""
        n = len(joints)
        root = self.links[0]
        table = {root: np.broadcast_to(self.base, (n, 4, 4))}
        for each in self.joints if along is None else along:
            pose = table[each.parent] @ each.origin
            if each.column >= 0:
                pose = pose @ self._move_joint(
                    each, each.factor * joints[:, each.column] + each.offset
                )
            table[each.child] = pose
        return table

    def _move_joint(self, joint: Joint, value: FloatArray) -> FloatArray:
        """(N, 4, 4) motion of a joint by N values."""
        result = np.zeros((len(value), 4, 4))
        result[:] = np.eye(4)
        if joint.kind == "prismatic":
            result[:, :3, 3] = value[:, None] * joint.axis
        else:
            cross, squared = self._turns[joint.name]
            sine, versine = np.sin(value)[:, None, None], 2 * np.sin(value / 2)[:, None, None] ** 2
            result[:, :3, :3] += sine * cross + versine * squared
        return result

    def solve(
        self,
        poses: FloatArray,
        tip: str,
        link_from_tip: FloatArray,
        starts: Sequence[int],
        seed: int,
        most: int,
    ) -> Solutions:
        """Solutions of (N, 4, 4) poses of a frame that is fixed to a link, up to `most` for each.

        Poses that one round of starts meets beyond the limits alone get the next. Deterministic;
        poses farther away than the links are long are left out at once.
        """
        chain = self.chain(tip)
        left = np.flatnonzero(self._within_reach(poses, chain, link_from_tip))
        low, high = self._range
        seeds = low + (high - low) * np.random.default_rng(seed).random((sum(starts), len(low)))
        others = np.setdiff1d(np.arange(len(low)), [each.column for each in chain])
        seeds[:, others] = np.clip(0.0, low, high)[others]
        rows: list[IntArray] = [np.zeros(0, np.int64)]
        values: list[FloatArray] = [np.zeros((0, len(low)))]
        beyond, worst = np.full((len(poses), len(low)), np.inf), np.full(len(poses), np.inf)
        for some in np.split(seeds, np.cumsum(starts)[:-1]):
            if not len(left):
                break
            at_once = max(1, ROWS_AT_ONCE // len(some))
            for part in np.split(left, range(at_once, len(left), at_once)):
                joints, is_met = self._descend(poses[part], chain, link_from_tip, some)
                over = np.maximum(self.limits[:, 0] - joints, joints - self.limits[:, 1])
                over = np.maximum(over, 0.0)
                most_over = np.where(is_met, over.max(axis=2, initial=0.0), np.inf)
                for row, pose in enumerate(part):
                    least = int(most_over[row].argmin())
                    if most_over[row, least] < worst[pose]:
                        beyond[pose], worst[pose] = over[row, least], most_over[row, least]
                    own = self.distinct(joints[row, most_over[row] <= 0], tip, most)
                    rows.append(np.full(len(own), pose))
                    values.append(own)
            left = left[(worst[left] > 0) & np.isfinite(worst[left])]
        pose = np.concatenate(rows)
        order = sort_order(pose)
        return Solutions(pose[order], np.concatenate(values)[order], beyond)

    @cached_property
    def _range(self) -> tuple[FloatArray, FloatArray]:
        """Least and greatest start of each joint: a turn, or 2 m, where nothing limits it."""
        is_turning = self.is_turning
        far = np.where(is_turning, np.pi, 1.0)
        low, high = self.limits.T
        middle = np.clip(0.0, low, high)
        return np.maximum(low, middle - far), np.minimum(high, middle + far)

    @cached_property
    def is_turning(self) -> BoolArray:
        """(J,) True for joints that a turn brings back to where they are."""
        mask = np.ones(len(self.limits), bool)
        for each in self.joints:
            if each.column >= 0:
                is_whole = float(each.factor).is_integer()
                mask[each.column] &= each.kind != "prismatic" and is_whole
        return mask

    def _within_reach(
        self, poses: FloatArray, chain: Sequence[Joint], link_from_tip: FloatArray
    ) -> BoolArray:
        """(N,) False for poses whose distance from the first joint is longer than all links."""
        moving = [row for row, each in enumerate(chain) if each.column >= 0]
        if not moving:
            return np.ones(len(poses), bool)
        before = self.base
        for each in chain[: moving[0] + 1]:
            before = before @ each.origin
        reach = float(norm(link_from_tip[:3, 3]))
        for row, each in enumerate(chain):
            reach += float(norm(each.origin[:3, 3])) if row > moving[0] else 0.0
            if each.kind == "prismatic":
                values = each.factor * self.limits[each.column] + each.offset
                reach += float(np.abs(values).max())
        away = norm(poses[:, :3, 3] - before[:3, 3])
        return np.asarray(away <= reach * (1 + 1e-9) + MET)

    def jacobian(
        self, joints: FloatArray, chain: Sequence[Joint], link_from_tip: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """(N, 4, 4) poses of the tip and their (N, 6, J) derivatives: velocity, then turn."""
        frames = self.frames(joints, chain)
        last = chain[-1].child if chain else self.links[0]
        tip = frames[last] @ link_from_tip
        values = np.zeros((len(joints), 6, joints.shape[1]))
        for each in chain:
            if each.column < 0:
                continue
            pose = frames[each.child]
            axis = each.factor * (pose[:, :3, :3] @ each.axis)
            if each.kind == "prismatic":
                values[:, :3, each.column] += axis
            else:
                values[:, :3, each.column] += np.cross(axis, tip[:, :3, 3] - pose[:, :3, 3])
                values[:, 3:, each.column] += axis
        return tip, values

    def _descend(
        self,
        poses: FloatArray,
        chain: Sequence[Joint],
        link_from_tip: FloatArray,
        seeds: FloatArray,
    ) -> tuple[FloatArray, BoolArray]:
        """(N, S, J) angles after the descent from S starts, and which meet their poses.

        Limits are not looked at.
        """
        joints = np.tile(seeds, (len(poses), 1))
        goals, live = np.repeat(poses, len(seeds), axis=0), np.arange(len(joints))
        is_met = np.zeros(len(joints), bool)
        identity = np.eye(6)
        for _ in range(MOST_STEPS):
            tip, slope = self.jacobian(joints[live], chain, link_from_tip)
            error = pose_error(tip, goals[live])
            size = norm(error)
            # Steps end below the tolerance, so that wrapping and other orders of sums keep it.
            good = size < 0.1 * MET
            is_met[live[good]] = True
            live, error, slope, size = live[~good], error[~good], slope[~good], size[~good]
            if not len(live):
                break
            damping = (DAMPING * np.minimum(1.0, size))[:, None, None] ** 2
            across = slope.transpose(0, 2, 1)
            step = (
                across
                @ np.linalg.solve(slope @ across + (damping + 1e-15) * identity, error[..., None])
            )[..., 0]
            step *= np.minimum(1.0, LONGEST_STEP / np.maximum(np.abs(step).max(axis=1), 1e-12))[
                :, None
            ]
            joints[live] += step
        shape = len(poses), len(seeds)
        return self._wrap(joints).reshape(*shape, -1), is_met.reshape(shape)

    def _wrap(self, joints: FloatArray) -> FloatArray:
        """Angles within half a turn of 0, or as near to it as the limits allow by whole turns."""
        low, high = self.limits.T
        turn = 2 * np.pi
        wrapped = np.where(self.is_turning, joints - turn * np.round(joints / turn), joints)
        up = self.is_turning & (wrapped < low) & (wrapped + turn <= high)
        down = self.is_turning & (wrapped > high) & (wrapped - turn >= low)
        return wrapped + turn * (up.astype(np.int64) - down)

    def distinct(self, joints: FloatArray, tip: str, most: int) -> FloatArray:
        """Solutions for a link of which no two are alike, in their order."""
        used = sorted({each.column for each in self.chain(tip) if each.column >= 0})
        kept = joints[:0]
        for each in joints:
            if len(kept) == most:
                break
            away = self.difference(each, kept)[:, used].max(axis=1, initial=0)
            if (away > APART).all():
                kept = np.concatenate([kept, each[None]])
        return kept

    def difference(self, one: FloatArray, other: FloatArray) -> FloatArray:
        """(..., J) differences of configurations, less whole turns of joints that turn."""
        way = np.abs(one - other)
        return np.where(self.is_turning, np.abs(way - 2 * np.pi * np.round(way / (2 * np.pi))), way)


def pose_error(poses: FloatArray, goals: FloatArray) -> FloatArray:
    """(N, 6) ways from poses to goals: translations, and rotations as axis times angle."""
    result = np.empty((len(poses), 6))
    result[:, :3] = goals[:, :3, 3] - poses[:, :3, 3]
    turn = goals[:, :3, :3] @ poses[:, :3, :3].transpose(0, 2, 1)
    axis = np.stack([
        turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]
    ], axis=1) / 2  # fmt: skip
    sine, cosine = norm(axis), (np.trace(turn, axis1=1, axis2=2) - 1) / 2
    ratio = np.where(sine > 1e-9, np.arctan2(sine, cosine) / np.maximum(sine, 1e-12), 1.0)
    result[:, 3:] = axis * ratio[:, None]
    return result
