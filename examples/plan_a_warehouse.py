"""Cameras that see people anywhere on the floor of a warehouse, by exact area at eye height.

Builds a hall of 36 x 24 x 8 m with racks, pillars and a dock door (26 nodes), and plans cameras on
its walls and pillars 3 to 4 m above the floor. With a folder as argument it only writes the scene
and the plan there:

    python examples/plan_a_warehouse.py warehouse/
    rastercov place warehouse/plan.toml --out warehouse/report
"""

import sys
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import trimesh

from rastercov.placement.plan.file import read_plan
from rastercov.placement.plan.run import place

SIZE = np.array([36.0, 24.0, 8.0])
RACKS_X, RACKS_Y = (4.0, 19.0), (3.5, 7.1, 10.7, 14.3, 17.9)
PLAN = """
[[meshes]]
path = "warehouse.glb"
role = "occluder"                # the hall only occludes; people are targets

[[targets]]                      # heads of people, at any place on the floor
name = "people"
above = "floor"
height = 1.6

[camera]                         # 1/2.8 inch, 4 mm: 88 degrees
width = 1920
height = 1080
fx = 1000
fy = 1000

[task]
min_facing_density = "observe"   # EN 62676-4: 62.5 px/m
max_incidence_deg = 85

[[candidates]]                   # 0.2 m from the walls, looking along the aisles and across
generator = "on_walls"
low = [0, 0, 0]
high = [36, 24, 8]
inset = 0.2
heights = [3.0, 4.0]
spacing = 2.0
aim = [
    { point = [18, 12, 1.0] }, { point = [9, 12, 1.0] }, { point = [27, 12, 1.0] },
    { direction = [1, 0, -0.3] }, { direction = [-1, 0, -0.3] },
    { direction = [0, 1, -0.3] }, { direction = [0, -1, -0.3] },
]

[selection]
goal = "best_coverage"
cameras = 12
refine = true

[constraints]
clearance = 0.1
"""
ON_A_PILLAR = """
[[candidates]]
generator = "on_box"
low = [{x0}, {y0}, 3.0]
high = [{x1}, {y1}, 3.8]
outward = 0.15
sides = ["-x", "+x", "-y", "+y"]
spacing = 2.0
aim = [
    {{ direction = [1, 0, -0.3] }}, {{ direction = [-1, 0, -0.3] }},
    {{ direction = [0, 1, -0.3] }}, {{ direction = [0, -1, -0.3] }},
]
"""


def grid(origin, across, along, n, m):
    """Rectangle of n x m cells, two triangles each."""
    u, v = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, m + 1), indexing="ij")
    points = np.add(origin, u.reshape(-1, 1) * across + v.reshape(-1, 1) * along)
    row = (np.arange(n)[:, None] * (m + 1) + np.arange(m)).ravel()
    quads = np.stack([row, row + m + 1, row + m + 2, row + 1], axis=1)
    return trimesh.Trimesh(points, quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3), process=False)


def box(low, high):
    """Box between two corners."""
    return trimesh.creation.box(bounds=(low, high))


def rack(x, y, length):
    """Rack along x with three levels of pallets."""
    parts = [box((x, y, z), (x + length, y + 1.1, z + 0.1)) for z in (0.0, 1.5, 2.9)]
    posts = np.linspace(x, x + length - 0.1, 4)
    parts += [box((at, y + dy, 0), (at + 0.1, y + dy + 0.1, 4.2)) for at in posts for dy in (0, 1)]
    pallets = np.linspace(x + 0.3, x + length - 1.5, 5)
    tall = np.random.default_rng(int(97 * x + y)).uniform(0.3, 1.1, (3, 5))
    for level, z in enumerate((0.11, 1.61, 3.01)):
        parts += [
            box((at, y + 0.1, z), (at + 1.2, y + 1.0, z + height))
            for at, height in zip(pallets, tall[level], strict=True)
        ]
    return trimesh.util.concatenate(parts)


def floor():
    """Floor where people walk: between the racks, and not in the office."""
    lines_x = [0, *(edge for at in RACKS_X for edge in (at, at + 11)), 36]
    lines_y = [0, *(edge for at in RACKS_Y for edge in (at, at + 1.1)), 24]
    parts = [
        grid((x0, y0, 0), (x1 - x0, 0, 0), (0, y1 - y0, 0), 1, 1)
        for x0, x1 in pairwise(lines_x)
        for y0, y1 in pairwise(lines_y)
        if not (x0 in RACKS_X and y0 in RACKS_Y) and not (x0 == 30 and y0 == 19)
    ]
    return trimesh.util.concatenate(parts)


def nodes():
    """Name and mesh of the 26 nodes."""
    x, y, z = np.diag(SIZE)
    yield "floor", floor()
    yield "ceiling", grid(z, y, x, 4, 6)
    yield "wall west", grid((0, 0, 0), y, z, 5, 3)
    yield "wall south", grid((0, 0, 0), z, x, 3, 5)
    yield "wall east", grid(x, z, y, 3, 5)
    yield "wall north", grid(y, x, z, 5, 3)
    for row, at in enumerate(RACKS_Y):
        yield f"rack {row} west", rack(RACKS_X[0], at, 11.0)
        yield f"rack {row} east", rack(RACKS_X[1], at, 11.0)
    for row, (at_x, at_y) in enumerate(pillars()):
        yield f"pillar {row}", box((at_x - 0.2, at_y - 0.2, 0), (at_x + 0.2, at_y + 0.2, 8))
    yield "dock door", box((35.95, 9, 0), (36, 13, 4))
    yield "office", box((30, 19, 0), (36, 24, 2.8))
    yield "pallets 1", box((31.5, 2, 0), (33.5, 4, 1.4))
    yield "pallets 2", box((32, 14, 0), (33.2, 16, 1.2))


def pillars():
    """Positions of the pillars."""
    return [(at_x, at_y) for at_x in (2.0, 17.0, 31.0) for at_y in (6.2, 17.0)]


def write(folder):
    """Write the scene and the plan; the path of the plan."""
    scene = trimesh.Scene()
    for name, mesh in nodes():
        scene.add_geometry(mesh, node_name=name, geom_name=name)
    folder.mkdir(parents=True, exist_ok=True)
    scene.export(folder / "warehouse.glb")
    on_pillars = [
        ON_A_PILLAR.format(x0=x - 0.2, x1=x + 0.2, y0=y - 0.2, y1=y + 0.2) for x, y in pillars()
    ]
    (folder / "plan.toml").write_text(PLAN + "".join(on_pillars))
    return folder / "plan.toml"


def report(placement):
    """Print what an installer needs, and what remains uncovered."""
    cameras = placement.cameras
    for row, (pose, so_far) in enumerate(zip(cameras.poses, cameras.curve, strict=True), 1):
        x, y, z = pose[:3, 3]
        heading = np.degrees(np.arctan2(pose[1, 2], pose[0, 2]))
        down = np.degrees(np.arcsin(-pose[2, 2]))
        print(
            f"camera {row} at ({x:.1f}, {y:.1f}, {z:.1f}) m, heading {round(heading)} degrees, "
            f"tilted {round(down)} degrees down: {100 * so_far:.1f} % so far"
        )
    covered = cameras.areas.summary()
    print(f"people are seen on {covered['percent']:.2f} % of the floor, {covered['m2']:.0f} m2")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        print(write(Path(sys.argv[1])))
    else:
        with TemporaryDirectory() as scratch:
            report(place(read_plan(write(Path(scratch))), Path(scratch) / "report"))
