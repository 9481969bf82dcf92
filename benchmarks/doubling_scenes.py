"""Commands whose scenes hold n of something: lamps, zones, goals, groups, parts, positions.

`attack_doubling.py` measures them by size.
"""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import rastercov as rc

LENS = "width = 640, height = 480, hfov_deg = 90"
ABOVE = [(0.0, 0.02, 1.2), (0.3, -0.2, 1.3)]
PLAN = """[camera]
width = 640
height = 480
hfov_deg = 90
[[candidates]]
generator = "on_hemisphere"
count = {count}
distances = [1.2]
[selection]
{goal}
"""
BEST = 'goal = "best_coverage"\ncameras = 3'
FEWEST = 'goal = "fewest_cameras"\ncoverage = 0.5'


class Scene(NamedTuple):
    """A first size, its doublings, and the arguments of a command for n, whose files are made."""

    first: int
    doublings: int
    command: Callable[[int, Path], list[str]]


def _poses(folder: Path, **entries: Any) -> str:
    path = folder / "poses.json"
    path.write_text(json.dumps(entries))
    return str(path)


def _looking(folder: Path, eyes: Sequence[tuple[float, float, float]], at: Sequence[float]) -> str:
    return _poses(folder, world_from_camera=rc.look_at(eyes, at).tolist())


def _triangles(n: int, folder: Path, group: str = "", *, turned: bool = False) -> str:
    """Triangles apart in a plane, each in a group of its own, every second one turned."""
    side, lines = int(np.ceil(np.sqrt(n))), []
    for row in range(n):
        x, y, s = (row % side) / side - 0.5, (row // side) / side - 0.5, 0.7 / side
        lines += [f"v {a:.9f} {b:.9f} 0" for a, b in ((x, y), (x + s, y), (x, y + s))]
        lines += [group.format(row), "f -3 -1 -2" if turned and row % 2 else "f -3 -2 -1"]
    path = folder / "triangles.obj"
    path.write_text("\n".join(lines) + "\n")
    return str(path)


def _evaluate(folder: Path, mesh: str, poses: str, *more: str, camera: str = LENS) -> list[str]:
    options = ["-c", camera, "-p", poses, "-o", str(folder / "out"), "--pictures", "0"]
    return ["evaluate", mesh, *options, *more]


def _lamps(n: int, folder: Path, *more: str) -> list[str]:
    places = np.random.default_rng(n).uniform((-2.5, -2, 1.5), (2.5, 2, 2.7), (n, 3)).tolist()
    kind = 'kind = "spot"\nhalf_angle_deg = 30\nintensity_cd = 20.0\n'
    lamps = [f"[lamps.l{row}]\n{kind}position = {place}\n" for row, place in enumerate(places)]
    path = folder / "lamps.toml"
    path.write_text("".join(lamps))
    poses = _looking(folder, [(2.5, 2, 2.5), (-2.5, -2, 2.5)], (0, 0, 1))
    return _evaluate(folder, "room", poses, "--lamps", str(path), *more)


def _zones(n: int, folder: Path) -> list[str]:
    mesh = _triangles(2 * n, folder, turned=True)
    return _evaluate(folder, mesh, _looking(folder, ABOVE, (0, 0, 0)))


def _groups(n: int, folder: Path, group: str, *more: str) -> list[str]:
    mesh = _triangles(n, folder, group)
    return _evaluate(folder, mesh, _looking(folder, ABOVE, (0, 0, 0)), *more)


def _sun(n: int, folder: Path) -> list[str]:
    site = ["--latitude", "48", "--longitude", "11", "--year", "2026"]
    return ["sun", "teapot", *site, "--step", str(4000 * 60 // n), "-o", str(folder / "out")]


def _rig(n: int, folder: Path, **rule: Any) -> list[str]:
    mesh = _triangles(400, folder)
    eyes = np.random.default_rng(n).uniform(-0.1, 0.1, (n, 3))
    own, rigs = rc.look_at(eyes, (0, 0, 2.0)), rc.look_at(ABOVE, (0, 0, 0))
    lens = {"width": 640, "height": 480, "fx": 500, "fy": 500, "cx": 320, "cy": 240}
    content: dict[str, Any] = {"cameras": [{"name": f"c{row}"} | lens for row in range(n)]}
    if rule:
        content |= {"rig_from_camera": own.tolist()} | rule
        poses = _poses(folder, world_from_camera=rigs.tolist())
    else:
        every = (rigs[:, None] @ own).reshape(-1, 4, 4).tolist()
        names = [f"c{row}" for row in range(n)] * len(rigs)
        poses = _poses(folder, world_from_camera=every, camera=names)
    path = folder / "rig.json"
    path.write_text(json.dumps(content))
    return _evaluate(folder, mesh, poses, camera=str(path))


def _place(folder: Path, meshes: str, entries: str, goal: str = BEST, count: int = 20) -> list[str]:
    path = folder / "plan.toml"
    path.write_text(meshes + PLAN.format(goal=goal, count=count) + entries)
    return ["place", str(path), "--out", str(folder / "out")]


def _groups_of_plan(n: int, folder: Path, entries: str = "", goal: str = BEST) -> list[str]:
    mesh = _triangles(n + 1, folder, "g part{}")
    return _place(folder, f'[[meshes]]\npath = "{mesh}"\n', entries, goal)


def _goals(n: int, folder: Path) -> list[str]:
    goals = [f'[goals.g{row}]\ngroups = ["part{row}"]\ncoverage = 0.5\n' for row in range(1, n + 1)]
    return _groups_of_plan(n, folder, "".join(goals), FEWEST)


def _goals_of_groups(n: int, folder: Path) -> list[str]:
    goals = [f'"part{row}" = 0.5\n' for row in range(1, n + 1)]
    return _groups_of_plan(n, folder, "[selection.groups]\n" + "".join(goals), FEWEST)


def _keep_out(n: int, folder: Path) -> list[str]:
    low = np.random.default_rng(n).uniform(-3, 3, (n, 3))
    boxes = [
        f'[[constraints.keep_out]]\nname = "k{row}"\nlow = {a}\nhigh = {b}\n'
        for row, (a, b) in enumerate(zip(low.tolist(), (low + 0.1).tolist(), strict=True))
    ]
    return _place(folder, '[[meshes]]\nbuilt_in = "teapot"\n', "".join(boxes), count=200)


def _parts(n: int, folder: Path) -> list[str]:
    mesh, side = _triangles(1, folder, "g one"), int(np.ceil(np.sqrt(n)))
    at = [f"[{row % side / side}, {row // side / side}, 0]" for row in range(n)]
    parts = [f'[[meshes]]\npath = "{mesh}"\ntransform = {{ translation = {own} }}\n' for own in at]
    return _place(folder, "".join(parts), "")


SCENES = {
    "lamps": Scene(16, 2, _lamps),
    "lamps, illuminance": Scene(16, 2, lambda n, out: _lamps(n, out, "--min-illuminance", "50")),
    "dead zones": Scene(2500, 2, _zones),
    "groups": Scene(2500, 2, lambda n, out: _groups(n, out, "g part{}")),
    "groups, --table": Scene(
        2500, 2, lambda n, out: _groups(n, out, "g part{}", "--table", "groups")
    ),
    "groups of a part": Scene(2500, 2, lambda n, out: _groups(n, out, "g a/b{}")),
    "groups of a plan": Scene(2500, 2, _groups_of_plan),
    "positions of the sun": Scene(4000, 1, _sun),
    "cameras": Scene(128, 3, _rig),
    "sensors of a rig": Scene(16, 2, lambda n, out: _rig(n, out, rule="at_least", k=2)),
    "goals": Scene(125, 3, _goals),
    "goals of groups": Scene(125, 3, _goals_of_groups),
    "keep-out volumes": Scene(250, 2, _keep_out),
    "parts of a scene": Scene(250, 2, _parts),
}
"""Sizes up to realistic ones; 64 points are the most of all lamps."""
