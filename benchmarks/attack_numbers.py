"""Every number of every file that commands read, replaced by hostile ones, through the command.

Numbers of 400 digits, near the ends of float64, subnormal, not finite, and values that are none: a
result, or one line and exit code 2, with nothing written; never a traceback, a warning or a hang.
"""

import json
import re
import shutil
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

import numpy as np
from attack_inputs import (
    CAMERA,
    EVALUATE,
    EYES,
    LINES,
    command,
    fault_of_command,
    in_valid_folder,
    told,
)  # fmt: skip
from rows import Report

import rastercov as rc

COMMANDS = 4_000
"""Files with one number replaced, each read by a command, of a campaign."""
LONGEST_S = 120
"""Seconds of a command after which it hangs."""
NINES = "9" * 400
NUMBERS = (
    *(NINES, f"-{NINES}", "1" + "0" * 400, "1e400", "1.7e308", "-1.7e308", "1e99", "-1e99"),
    *("1e-320", "-1e-320", "nan", "inf", "-inf", "-0.0", "0", "-1", "true", '"7"', "[]"),
)
IN_JSON = {"nan": "NaN", "inf": "Infinity", "-inf": "-Infinity"}
NUMBER = re.compile(rb"(?<![\w.#\"-])-?\d+(\.\d*)?(e[+-]?\d+)?(?![\w.])")
SCENE = """
[[meshes]]
path = "part.obj"
transform = { translation = [0.1, 0, 0], axis = [0, 0, 1], angle_deg = 5, scale = 1.0 }
[[meshes]]
path = "floor.obj"
[[targets]]
name = "above"
above = "floor"
height = 0.2
[[targets]]
name = "boxes"
box = [[-1, -1, 0], [1, 1, 1]]
spacing = 0.9
size = 0.3
[cameras.wide]
width = 32
height = 24
hfov_deg = 90
near = 0.01
cost = 300
focus_range = [0.1, 20]
[cameras.long]
width = 32
height = 24
fx = 30
fy = 30
cx = 16.5
cy = 12.5
model = "opencv"
distortion = [0.01, -0.001, 0.0, 0.0]
cost = 500
[rigs.pair]
cost = 700
[[rigs.pair.cameras]]
camera = "wide"
name = "left"
angle_deg = -30
translation = [-0.05, 0.0, 0.0]
[[rigs.pair.cameras]]
camera = "long"
name = "right"
angle_deg = 20
[task]
min_pixels = 1
max_incidence_deg = 80
min_pixel_density = 2.5
views = 1
[[candidates]]
generator = "on_sphere"
count = 5
distances = [3.0, 4.0]
margin = 0.1
[[candidates]]
generator = "on_box"
low = [-3, -3, -3]
high = [3, 3, 3]
spacing = 4.0
[constraints]
clearance = 0.1
"""
FEWEST = """[selection]
goal = "fewest_cameras"
coverage = 0.5
time_limit = 2
[selection.tolerance]
position_mm = 5
angle_deg = 0.5
draws = 3
[outputs]
page = false
"""
BEST = """[selection]
goal = "best_coverage"
budget = 1500
seed = 3
refine = true
[selection.optimise]
budget = 24
[outputs]
page = false
"""
CATALOGUE = """[cameras.own]
width = 32
height = 24
pixel_size = 1e-5
focal_length = 3e-4
price = 20
[lenses.tube]
mount = "C"
focal_length = 0.012
f_numbers = [1.4, 16]
image_circle = 0.011
nearest = 0.1
price = 30
"""
OPENCV = """%YAML:1.0
image_width: 32
image_height: 24
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [30., 0., 15.5, 0., 30., 11.5, 0., 0., 1.]
distortion_coefficients: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [0.01, -0.001, 0., 0., 0.]
"""
FLOOR = "v -2 -2 -1\nv 2 -2 -1\nv 2 2 -1\nv -2 2 -1\ng floor\nf 1 2 3\nf 1 3 4\n"
RULED = {"rule": "all", "min_baseline_deg": 2, "max_baseline_deg": 90}
CHECK = "check costs.toml --json --junit checked/junit.xml --summary checked/summary.md -p"
"""Without a page, whose pictures cost ten times the check; these two files say refusals, too."""
OWN: dict[str, tuple[str, str]] = {
    "costs.toml": (SCENE + FEWEST, "place {} -o out"),
    "search.toml": (SCENE + BEST, "place {} -o out"),
    "own.toml": (CATALOGUE, "cameras --catalogue {}"),
    "camera.yaml": (OPENCV, "evaluate part.obj -c {} -p eyes.json --pictures 0 -o out"),
    "camera.toml": (CAMERA, f"{EVALUATE} -o out"),
    "eyes.json": (json.dumps({"world_from_camera": EYES.tolist()}), f"{EVALUATE} -o out"),
    "table.json": ("", EVALUATE + " -o out --motion {}"),
    "table.csv": ("", EVALUATE + " -o out --motion {}"),
    "ruled.json": ("", "evaluate part.obj -p {} --pictures 0 --by area -o out"),
    "base.json": ("", f"{CHECK} six.json --baseline {{}}"),
    "six.json": ("", f"{CHECK} {{}}"),
    "transforms.json": ("", "convert {} out/rig.json --pose-unit 1 --overwrite"),
}
"""Files beside those of `attack_inputs`, and the commands that read them; empty ones are made."""


class HangsError(BaseException):
    """A command takes too long; no handler of errors takes it for one of its own."""


@contextmanager
def ended_after(seconds: int) -> Iterator[None]:
    """Raise HangsError in a block that takes longer; it ends loops of Python alone."""

    def end(number: int, frame: FrameType | None) -> None:
        raise HangsError

    before = signal.signal(signal.SIGALRM, end)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def own_files() -> None:
    """Write the files of `OWN` beside those of `valid_folder`."""
    for name, (text, _) in OWN.items():
        if text:
            Path(name).write_text(text, encoding="utf-8")
    Path("floor.obj").write_text(FLOOR)
    ends = 3.5 * np.concatenate((np.eye(3), -np.eye(3)))
    rig = rc.Rig([rc.Camera.load("camera.toml")], ["wide"])
    views = rc.Views(rig, rc.Poses.of(rc.look_at(ends, (0, 0, 0))), tuple("abcdef"))
    rc.write_views("six.json", views, overwrite=True)
    rc.write_views("transforms.json", views, overwrite=True)
    pair = rc.Rig([rc.Camera.load("camera.toml")] * 2, ["a", "b"])
    rc.write_views(
        "ruled.json", rc.Views(pair, rc.Poses.of(EYES, camera=[0, 1]), ("a", "b")), overwrite=True
    )
    code, said = command("check costs.toml -p six.json -o checked")
    assert code in (0, 1), said
    Path("base.json").write_bytes(Path("checked/check.json").read_bytes())
    content = json.loads(Path("ruled.json").read_text())
    if isinstance(content, dict):
        Path("ruled.json").write_text(json.dumps(content | RULED))


def commands() -> dict[str, str]:
    """Command that reads each file, by its name, of those that end with 0 or 1 as they are."""
    lines = LINES | {name: line for name, (_, line) in OWN.items()}
    return {name: line for name, line in lines.items() if Path(name).is_file()}


def replaced() -> list[tuple[str, int, str]]:
    """All files with one number replaced: name, place of the number, its new text."""
    items = []
    for name in commands():
        for at, _ in enumerate(NUMBER.finditer(Path(name).read_bytes())):
            values = [IN_JSON.get(v, v) for v in NUMBERS] if name.endswith(".json") else NUMBERS
            items += [(name, at, value) for value in values]
    return items


def fault_with(name: str, at: int, value: str) -> str:
    """Fault of the command that reads a file with one number replaced, empty if there is none."""
    path = Path(name)
    data = path.read_bytes()
    number = list(NUMBER.finditer(data))[at]
    path.write_bytes(data[: number.start()] + value.encode() + data[number.end() :])
    try:
        with ended_after(LONGEST_S):
            fault = fault_of_command(commands()[name].format(name))
    except HangsError:
        fault = f"no end after {LONGEST_S} s"
    finally:
        path.write_bytes(data)
    before = data[max(0, number.start() - 40) : number.end()].decode("utf-8", "replace")
    return fault and f"{name}, {value[:12]} for the last number of {before!r}: {fault}"


def attack(report: Report, effort: float) -> None:
    """A sample of all replacements, at least one a file; all of them from effort 10 on."""
    with in_valid_folder():
        own_files()
        all_of = replaced()
        for name in commands():
            Path("out").mkdir(exist_ok=True)
            code, _ = command(commands()[name].format(name))
            report.check(f"{name}: is read as it is", code in (0, 1))
            shutil.rmtree("out")
        order = np.random.default_rng(0).permutation(len(all_of))
        most = max(len(commands()), round(COMMANDS * effort))
        chosen = [all_of[row] for row in order[:most]]
        faults = [fault for each in chosen if (fault := fault_with(*each))]
        told(report, "commands with a number replaced", len(chosen), faults)
        report.add("... of all replacements", len(all_of), "files")
