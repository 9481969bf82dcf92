"""Robots in tests of all public names."""

import numpy as np
from misuse_values import FOLDER, MESH

import rastercov as rc
from rastercov import placement
from rastercov.robots import urdf

URDF = """<robot name="arm"><link name="base"/><link name="hand"><collision><geometry>
<box size="1 1 1"/></geometry></collision></link><joint name="q" type="continuous">
<parent link="base"/><child link="hand"/><axis xyz="0 0 1"/></joint></robot>"""
(FOLDER / "arm.urdf").write_text(URDF)
(FOLDER / "path.csv").write_text("q\n0.1\n")
ROBOT = rc.Robot.load(FOLDER / "arm.urdf")
NAMES = ["Collisions", "Robot"]
OBJECTS = [ROBOT, rc.Collisions(ROBOT)]
SHOWN = OBJECTS
COMPARED = [("Arm", "clearance"), ("Robot.is_moving", "link")]
EARLY = {"Collisions.clearance": "most"}
CALLS = {
    "Robot": {"description": urdf.read(FOLDER / "arm.urdf", "collision"), "base": np.eye(4)},
    "Robot.load": {"path": FOLDER / "arm.urdf", "rest": (0.1,), "name": "own"},
    "Collisions": {"robot": ROBOT, "scene": [MESH]} | {"allowed": [("hand", "base")]},
    "Collisions.clearance": {"joints": [[0.1]], "most": 1.0},
    "Collisions.contacts": {"joints": [[0.1]]},
    "Robot.on_turntable": {"axis": (0, 0, 1), "centre": (0, 0, 0), "degrees": 90.0},
    "Robot.frames": {"joints": [[0.1]]},
    "Robot.poses": {"joints": [0.1]},
    "Robot.is_moving": {"link": "hand"},
    "Robot.read_path": {"path": FOLDER / "path.csv"},
    "Robot.solve": {"link": "hand", "starts": 2, "most": 2},
    "Arm": {"robot": ROBOT, "link": "hand"},
    "on_arm": {"arm": placement.Arm(ROBOT, "hand", MESH)},
}
PAGES = {"robot": "inspect.toml"}
