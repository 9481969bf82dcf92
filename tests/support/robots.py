"""Robots for tests: an arm of seven axes, with the lengths and limits of a KUKA LBR iiwa 7.

And the arm of the examples over a part, as a scene of the viewer.
"""

from pathlib import Path

import numpy as np
from moving_scene import PART, POSES, STEPS, scene_of

import rastercov as rc
from rastercov.motion.plan_over_time import PlanMotion

ARM = Path(__file__).parents[2] / "examples" / "arm.urdf"

LENGTHS = 0.1575, 0.1825, 0.2025, 0.1975, 0.2025, 0.1975, 0.081, 0.045
RADII = 0.09, 0.085, 0.08, 0.075, 0.07, 0.065, 0.05, 0.04
LIMITS = 2.967, 2.094, 2.967, 2.094, 2.967, 2.094, 3.054
AXES = "0 0 1", "0 1 0", "0 0 1", "0 -1 0", "0 0 1", "0 1 0", "0 0 1"


def seven_axes(limits=LIMITS):
    """URDF of links `link_0` to `link_7` on joints `a1` to `a7`."""
    links = [
        f'<link name="link_{row}"><collision><origin xyz="0 0 {length / 2}"/><geometry>'
        f'<cylinder radius="{radius}" length="{0.94 * length}"/></geometry></collision></link>'
        for row, (length, radius) in enumerate(zip(LENGTHS, RADII, strict=True))
    ]
    joints = [
        f'<joint name="a{row + 1}" type="revolute"><parent link="link_{row}"/>'
        f'<child link="link_{row + 1}"/><origin xyz="0 0 {LENGTHS[row]}"/><axis xyz="{axis}"/>'
        f'<limit lower="{-limit}" upper="{limit}"/></joint>'
        for row, (axis, limit) in enumerate(zip(AXES, limits, strict=True))
    ]
    return f'<robot name="seven">{"".join(links + joints)}</robot>'


def robot_scene(folder, *, steps=STEPS):
    """Scene of a file of joints in a folder, with the second camera on the head; and the joints."""
    robot = rc.Robot.load(ARM, name="arm")
    rows = np.linspace(robot.rest, (0.6, 0.9, 1.0, 0.3, 0.2, 0.5), steps)
    lines = [",".join(robot.joint_names), *(",".join(map(repr, row)) for row in rows.tolist())]
    (folder / "path.csv").write_text("\n".join(lines))
    (folder / "arm.urdf").write_bytes(ARM.read_bytes())
    (folder / "m.toml").write_text(
        '[[bodies]]\nname = "arm"\nurdf = "arm.urdf"\n[motion]\njoints = "path.csv"\n'
    )
    return scene_of(PlanMotion.read(folder / "m.toml", PART), "arm/head", {}), robot, rows


def robot_by_hand(robot, joints):
    """The part and the links in a configuration, and poses of both cameras."""
    frames, rest = robot.frames(joints), robot.frames(robot.rest)
    links = [
        rc.Mesh(shape.vertices @ frames[link][0, :3, :3].T + frames[link][0, :3, 3], shape.faces,
                groups=[rc.Group(f"arm/{link}", is_occluder=True)])
        for link, shape in robot.shapes.items()
    ]  # fmt: skip
    head = frames["head"][0] @ np.linalg.inv(rest["head"][0])
    return rc.Mesh.joined([PART, *links]), np.stack([POSES[0], head @ POSES[1]])
