"""A part under an arm that moves, as a scene of the viewer, and its figures by hand."""

import json
from dataclasses import replace

import numpy as np

import rastercov as rc
from rastercov.core.mesh.arrays import rotation_about
from rastercov.motion.plan_over_time import PlanMotion
from rastercov.page.rig_state import RigState
from rastercov.page.scene import Scene

STEPS = 5
CAMERA = rc.Camera(width=320, height=240, fx=300, fy=300)
PART = rc.shapes.by_name("teapot-5").moved(translation=(0.45, 0.0, 0.0))
CENTRE = PART.bounds.mean(axis=0)
EYES = np.add(CENTRE, [(0.2, -0.5, 0.5), (0.1, 0.3, 0.7)])
POSES = rc.look_at(EYES, PART.bounds.mean(axis=0))
TASK = rc.Task(max_incidence_deg=75)
LINKS = {
    "arm": rc.shapes.box((0.1, 0.1, 0.3), centre=(0.1, 0.1, 0.15)),
    "head": rc.shapes.box((0.3, 0.12, 0.06), centre=(0.35, 0.15, 0.35)),
}
"""Bodies beside the part, at the start."""


def path(steps=STEPS):
    """(steps, 4, 4) poses of each body: the arm turns, and the head turns with it and sinks."""
    values = np.tile(np.eye(4), (2, steps, 1, 1))
    for row, part in enumerate(np.linspace(0, 1, steps)):
        values[:, row, :3, :3] = rotation_about(np.array((0.0, 0.0, 1.0)), -0.6 * part)
        values[1, row, 2, 3] = -0.1 * part
    return dict(zip(LINKS, values, strict=True))


def moving_scene(folder, *, steps=STEPS, **equipment):
    """Scene of a file of motion in a folder; the second camera is on the head of the arm."""
    parts = [
        rc.Mesh(each.vertices, each.faces, groups=[rc.Group(name, is_occluder=True)])
        for name, each in LINKS.items()
    ]
    poses = {name: {"poses": each.tolist()} for name, each in path(steps).items()}
    (folder / "frames.json").write_text(json.dumps({"bodies": poses}))
    (folder / "m.toml").write_text('[motion]\nposes = "frames.json"\n')
    moving = PlanMotion.read(folder / "m.toml", rc.Mesh.joined([PART, *parts]))
    return scene_of(moving, "head", equipment)


def scene_of(moving, body, equipment):
    """Scene of two cameras, of which a body carries the second."""
    moving = replace(moving, body=["world", body], cameras=["fixed", "carried"])
    rig = rc.Rig([CAMERA, CAMERA], ["fixed", "carried"])._with(equipment=equipment)
    state = RigState.of(rig, rc.Poses.of(POSES, camera=[0, 1]), task=TASK)
    return Scene("cell", moving.motion.mesh, state, phases=moving)


def by_hand(row, steps=STEPS):
    """The part and the links in a frame, and poses of both cameras."""
    poses = {name: every[row] for name, every in path(steps).items()}
    links = [
        rc.Mesh(each.vertices @ poses[name][:3, :3].T + poses[name][:3, 3], each.faces,
                groups=[rc.Group(name, is_occluder=True)])
        for name, each in LINKS.items()
    ]  # fmt: skip
    return rc.Mesh.joined([PART, *links]), np.stack([POSES[0], poses["head"] @ POSES[1]])
