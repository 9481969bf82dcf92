"""A room with a plan of goals, and sessions of a viewer on it."""

import numpy as np
from edited import Session

import rastercov as rc
from rastercov.page.scene import open_plan
from rastercov.placement.plan.file import read_plan

QUADS = {
    "floor": ((0, 0, 0), (4, 0, 0), (4, 4, 0), (0, 4, 0)),
    "north": ((0, 4, 0), (4, 4, 0), (4, 4, 3), (0, 4, 3)),
    "window": ((1, 3.99, 1), (2, 3.99, 1), (2, 3.99, 2), (1, 3.99, 2)),
    "west": ((0, 0, 0), (0, 4, 0), (0, 4, 3), (0, 0, 3)),
}
PLAN = """
[[meshes]]
path = "room.obj"
[camera]
width = 1920
height = 1080
hfov_deg = 90.0
[task]
min_facing_density = "observe"
[[candidates]]
generator = "on_walls"
spacing = 1.5
aim = [{ middle = true }]
[selection]
goal = "fewest_cameras"
coverage = 0.6
[goals.doors]
groups = ["west"]
coverage = 0.7
min_facing_density = "identify"
views = 2
[goals.window]
groups = ["window"]
at_most = 0.1
min_facing_density = "recognise"
"""


def plan_in(folder, text=PLAN):
    lines, n = [], 0
    for name, corners in QUADS.items():
        lines += [f"v {x} {y} {z}" for x, y, z in corners]
        lines += [f"g {name}", f"f {n + 1} {n + 2} {n + 3}", f"f {n + 1} {n + 3} {n + 4}"]
        n += 4
    (folder / "room.obj").write_text("\n".join(lines))
    (folder / "plan.toml").write_text(text)
    return folder / "plan.toml"


def session_in(folder, eyes=((3.5, 0.5, 2.5), (3.8, 3.0, 1.5)), text=PLAN):
    plan = plan_in(folder, text)
    poses = rc.look_at(np.array(eyes), (1.0, 2.5, 1.0))
    names = tuple(f"camera {row}" for row in range(len(poses)))
    views = rc.Views(read_plan(plan).rig, rc.Poses.of(poses), names)
    return Session(open_plan(plan, views)), plan
