"""A part under an arm that moves, as a scene of the viewer, and its figures by hand."""

from dataclasses import replace
from pathlib import Path

import numpy as np

import rastercov as rc
from rastercov.placement.plan.over_time import PlanMotion
from rastercov.viewer.rig_state import RigState
from rastercov.viewer.scene import Scene

ARM = Path(__file__).parents[2] / "examples" / "arm.urdf"
STEPS = 5
CAMERA = rc.Camera(width=320, height=240, fx=300, fy=300)
PART = rc.shapes.by_name("teapot-5").moved(translation=(0.45, 0.0, 0.0))
CENTRE = PART.bounds.mean(axis=0)
EYES = np.add(CENTRE, [(0.2, -0.5, 0.5), (0.1, 0.3, 0.7)])
POSES = rc.look_at(EYES, PART.bounds.mean(axis=0))
TASK = rc.Task(max_incidence_deg=75)


def moving_scene(folder, *, steps=STEPS, **equipment):
    """Scene of a file of motion in a folder; the second camera is on the head of the arm."""
    robot = rc.Robot.load(ARM, name="arm")
    rows = np.linspace(robot.rest, (0.6, 0.9, 1.0, 0.3, 0.2, 0.5), steps)
    lines = [",".join(robot.joint_names), *(",".join(map(repr, row)) for row in rows.tolist())]
    (folder / "path.csv").write_text("\n".join(lines))
    (folder / "arm.urdf").write_bytes(ARM.read_bytes())
    (folder / "m.toml").write_text(
        '[[bodies]]\nname = "arm"\nurdf = "arm.urdf"\n[motion]\njoints = "path.csv"\n'
    )
    moving = PlanMotion.read(folder / "m.toml", PART)
    moving = replace(moving, body=["world", "arm/head"], cameras=["fixed", "carried"])
    rig = rc.Rig([CAMERA, CAMERA], ["fixed", "carried"])._with(equipment=equipment)
    state = RigState.of(rig, rc.Poses.of(POSES, camera=[0, 1]), task=TASK)
    return Scene("cell", moving.motion.mesh, state, phases=moving), robot, rows


def by_hand(robot, joints):
    """The part and the links in a configuration, and poses of both cameras."""
    frames, rest = robot.frames(joints), robot.frames(robot.rest)
    links = [
        rc.Mesh(shape.vertices @ frames[link][0, :3, :3].T + frames[link][0, :3, 3], shape.faces,
                groups=[rc.Group(f"arm/{link}", is_occluder=True)])
        for link, shape in robot.shapes.items()
    ]  # fmt: skip
    head = frames["head"][0] @ np.linalg.inv(rest["head"][0])
    return rc.Mesh.joined([PART, *links]), np.stack([POSES[0], head @ POSES[1]])
