"""Files and folders that commands read, altered at random: one line, exit code 2, nothing written.

Files of equipment, bodies, buildings and plans, and folders of results that the viewer opens
again: tokens, lines and bytes of valid ones are exchanged, entries of JSON are replaced. Names that
are pieces of HTML stay texts in every page.
"""

import contextlib
import gc
import html
import io
import json
import os
import re
import shutil
import sys
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
from attack_readers import mutated
from bungalow import bungalow
from lamp_files import area_lamp
from misuse_calls import fault_of
from rows import Report

import rastercov as rc
from rastercov import cli

FILES, COMMANDS, BUILDINGS = 20_000, 2_000, 200
"""Altered files that a function reads, that a command reads, and buildings, of a campaign."""
EVIL = "</script><evil>\"'><!--<script>]]>&lt;{{x}}"
"""A name; no page may hold the element."""
CAMERA = "width = 32\nheight = 24\nfx = 30\nfy = 30\n"
EYES = rc.look_at([(0, -4, 1.5), (3.5, 0, 2)], (0, 0, 0))
URDF = """<?xml version="1.0"?>
<robot name="arm"><link name="base"><collision><origin xyz="0 0 0.1" rpy="0.1 0 0"/><geometry>
<box size="0.3 0.3 0.1"/></geometry></collision></link>
<link name="upper"><collision><geometry><cylinder radius="0.1" length="0.6"/></geometry>
</collision></link>
<link name="hand"><collision><geometry><mesh filename="part.obj" scale="0.1 0.1 0.1"/></geometry>
</collision></link><link name="finger"><visual><geometry><sphere radius="0.1"/></geometry></visual>
</link>
<joint name="pan" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
<origin xyz="0 0 0.5" rpy="0 0.2 0"/><limit lower="-2" upper="2"/></joint>
<joint name="slide" type="prismatic"><parent link="upper"/><child link="hand"/><axis xyz="0 1 1"/>
<limit lower="0" upper="0.5"/></joint>
<joint name="grip" type="continuous"><parent link="hand"/><child link="finger"/>
<mimic joint="pan" multiplier="2" offset="0.1"/></joint></robot>
"""
IES = """IESNA:LM-63-2002
[TEST] a narrow lamp
TILT=NONE
1 1000 2 6 2 1 2 0 0 0 1 1 50
0 15 30 45 60 80
0 90
400 380 240 100 30 0
400 380 240 100 31 0
"""
LAMPS = (
    area_lamp('"5 lx"')
    + """[lamps.spot]
ies = "lamp.ies"
position = [0, 0, 3]
[lamps.ring]
kind = "ring"
size = 0.2
points = 6
intensity_cd = 30
half_angle_deg = 60
rig = true
"""
)
MOTION = """over = 0.5
body = "arm/hand"
[[bodies]]
name = "plate"
groups = ["lid"]
[[bodies]]
name = "arm"
urdf = "arm.urdf"
base = { translation = [0, 0, 1.3], axis = [0, 0, 1], angle_deg = 10 }
[motion]
joints = "path.csv"
"""
PATH = "pan,slide,duration\n0.1,0.2,1\n0.2,0.3,2\n-1.5,0.5,1\n"
TABLE = "time,lid.x,lid.y,lid.qw,lid.qx,lid.present,rest.z\n0,0,0,1,0,1,0\n1,.1,0,.8,.6,1,1\n"
PART = """v -1 -1 -1\nv 1 -1 -1\nv 0 1 -1\nv 0 0 1\ng lid\nf 1 3 2\nf 1 2 4\ng rest\nf 2 3 4
f 3 1 4\n"""
PLAN = """ambient = "5 lx"
existing = "eyes.json"
[[meshes]]
path = "part.obj"
[camera]
file = "camera.toml"
[lamps.key]
kind = "spot"
intensity_cd = 900.0
half_angle_deg = 40.0
cost = 2.0
[lamps.fill]
ies = "lamp.ies"
[lamps.fixed]
intensity_cd = 20
position = [0, 0, 3]
[task]
max_incidence_deg = 75.0
min_illuminance = "25 lx"
gloss = "satin"
[[candidates]]
generator = "on_sphere"
count = 4
distances = [5.0]
lamp = "key"
[[candidates]]
generator = "on_sphere"
count = 3
distances = [3.0]
lamp = "fill"
[selection]
goal = "best_coverage"
lamps = 2
time_limit = 2.0
[outputs]
page = false
"""
HOUSE = """[[meshes]]
path = "a.ifc"
role = "occluder"
[rooms.kitchen]
space = "Kitchen"
[rooms.hall]
space = "Ground/Hall"
[[targets]]
above = "IfcSlab"
height = 1.6
room = "kitchen"
name = "faces"
[[targets]]
above = "IfcSlab"
height = 1.0
room = "hall"
near = ["IfcDoor*"]
within = 1.2
name = "at the doors"
[[candidates]]
generator = "in_room"
room = "kitchen"
spacing = 3.0
heights = [2.2, 2.5]
[camera]
width = 32
height = 24
hfov_deg = 100
[selection]
goal = "best_coverage"
cameras = 2
[outputs]
page = false
"""
SPACES = (
    *(
        "",
        "Hall",
        "Loft/Hall",
        "/",
        "Ground/",
        "/Hall",
        "Ground/Hall/x",
        "kitchen",
        "Kitchen ",
        "*",
    ),
    *("IfcSlab", "IfcDoor*", "Ifc[", "[", "Ground", "Attic", "a" * 5000, "a\nb", "\u202e", EVIL),
    *("0", "1", "2", "hall", "../x", "/dev/zero", "a.ifc", "IfcSlab/Floor", "Küche", "K\u0000"),
)
"""Names that a plan of a building may hold for another."""
POSES = {"poses": np.stack([np.eye(4)] * 2).tolist(), "present": [True, False]}
VALID: dict[str, str] = {
    "part.obj": PART, "arm.urdf": URDF, "lamp.ies": IES, "lamps.toml": LAMPS, "m.toml": MOTION,
    "path.csv": PATH, "table.csv": TABLE, "camera.toml": CAMERA, "plan.toml": PLAN,
    "table.json": json.dumps({"bodies": {"lid": POSES}, "times": [0, 1]}),
    "eyes.json": json.dumps({"world_from_camera": EYES.tolist()}),
}  # fmt: skip
"""Files by name, each beside the others."""
TOKEN = re.compile(rb"[\w.+-]+")
NUMBER = re.compile(rb"(?<![\w.])-?\d+(\.\d+)?(e-?\d+)?")
NUMBERS = (
    *(b"-1", b"0", b"1e-320", b"1e-30", b"1e-9", b"0.5", b"1.5", b"2", b"7", b"90", b"180", b"360"),
    *(b"1e3", b"1e9", b"1e29", b"1e31", b"1e160", b"1e308", b"-1e308", b"-0.0", b"4", b"1", b"12"),
)
TOKENS = (
    *(b"-1", b"0", b"1e400", b"1e-320", b"1e30", b"nan", b"inf", b"true", b"[]", b"{}", b"''"),
    *(b"\xff\xfe", b"\xc3", b"\x00", b"1e160", b"99999999999999999999", b"&#0;", b"<", b'"', b"]"),
    *(b"../x", b"/dev/zero", b"part.obj", b"\xe2\x80\xae", b"-0.0", b"1_0", b"0x1F", b"1.5", b"3"),
)
BOMB = (
    '<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa">'
    + "".join(
        f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in zip("abcdefgh", "bcdefghi", strict=True)
    )
    + "]>"
)
"""Entities that grow to 10^9 characters."""
VALUES: tuple[Any, ...] = (
    *(None, True, -1, 0, 1e308, 10**30, "", "a\nb", EVIL, [], {}, [[]], [1, "a"], {"a": None}),
    *("/dev/zero", "nan", float("nan"), float("inf"), 0.5, "part.obj", [[[]]], 3),
)


def altered(data: bytes, rng: np.random.Generator) -> bytes:
    """The file after changes of bytes, lines, numbers, words, or entries of JSON."""
    if data[:1] == b"{" and rng.random() < 0.6:
        return altered_json(data, rng)
    if rng.random() < 0.3:
        return mutated(data, rng)
    # Numbers for numbers, which reach farther into a reader, or any word for another.
    kind, new_ones = ((NUMBER, NUMBERS), (TOKEN, TOKENS))[rng.integers(2)]
    for _ in range(rng.integers(1, 4)):
        words = list(kind.finditer(data))
        if words:
            old, other = (words[int(at)] for at in rng.integers(len(words), size=2))
            new = other[0] if rng.random() < 0.4 else new_ones[int(rng.integers(len(new_ones)))]
            data = data[: old.start()] + new + data[old.end() :]
    return data


def altered_json(data: bytes, rng: np.random.Generator) -> bytes:
    """A JSON file with one or two entries replaced, left out or renamed."""
    content = json.loads(data)
    for _ in range(rng.integers(1, 3)):
        owners = [content]
        for owner in owners:  # grows as it is walked through
            each = owner.values() if isinstance(owner, dict) else owner
            owners += [inner for inner in each if isinstance(inner, dict | list) and inner]
        owner = owners[int(rng.integers(len(owners)))]
        if not owner:
            continue
        at = int(rng.integers(len(owner)))
        key = list(owner)[at] if isinstance(owner, dict) else at
        kind = rng.random()
        if kind < 0.2:
            del owner[key]
        elif kind < 0.3 and isinstance(owner, dict):
            owner[f"{key}x"] = owner.pop(key)
        else:
            owner[key] = deepcopy(VALUES[int(rng.integers(len(VALUES)))])
    return json.dumps(content).encode()


def valid_folder(folder: Path) -> None:
    """The valid files, and results of commands on them."""
    for name, text in VALID.items():
        Path(folder, name).write_text(text, encoding="utf-8")
    lamps = rc.load_lamps("lamps.toml")
    Path("lamps.json").write_text(json.dumps(lamps.to_json()), encoding="utf-8")
    rig = rc.Rig([rc.Camera.load("camera.toml")] * 2, ["a", "b"])
    views = rc.Views(rig, rc.Poses.of(EYES, camera=[0, 1]), ("a", "b"))
    rc.write_views("rig.json", views)
    for words in RESULTS:
        code, said = command(words)
        assert code == 0, said  # they are valid


EVALUATE = "evaluate part.obj -c camera.toml -p eyes.json --pictures 0 --table none"
RESULTS = (
    f"{EVALUATE} -o lit --lamps lamps.toml --min-illuminance 1",
    f"{EVALUATE} -o moved --motion m.toml",
    "place plan.toml -o placed",
)
READS: dict[str, Callable[[Path], object]] = {
    "arm.urdf": lambda path: robot_moves(path),
    "lamp.ies": lambda path: lit(rc.Lamp.from_ies(path)),
    "lamps.toml": rc.load_lamps,
    "lamps.json": rc.load_lamps,
    "table.csv": lambda path: rc.load_motion(rc.Mesh.load("part.obj"), path),
    "table.json": lambda path: rc.load_motion(rc.Mesh.load("part.obj"), path),
    "path.csv": lambda path: rc.Robot.load("arm.urdf").read_path(path),
    "rig.json": rc.read_views,
    "placed/poses.json": rc.read_views,
    "camera.toml": rc.Camera.load,
}
"""Functions that read the files."""
LINES = {
    "plan.toml": "place {} -o out",
    "m.toml": f"{EVALUATE} -o out --motion {{}}",
    "path.csv": f"{EVALUATE} -o out --motion m.toml",
    "arm.urdf": f"{EVALUATE} -o out --motion m.toml",
    "lamps.toml": f"{EVALUATE} -o out --lamps {{}} --min-illuminance 1",
    "lamp.ies": f"{EVALUATE} -o out --lamps lamps.toml --min-illuminance 1",
    "rig.json": "evaluate part.obj -p {} --pictures 0 --table none -o out",
    "lit/summary.json": "view lit --export out/a.html",
    "lit/rig.json": "view lit --export out/a.html",
    "moved/summary.json": "view moved --export out/a.html",
    "placed/plan.json": "view placed --export out/a.html",
    "placed/poses.json": "sheet placed -o out/a.svg",
}
"""Commands that read a file, {}, or what it is part of; all write to the folder `out`."""


def robot_moves(path: Path) -> None:
    """Load a robot, move it, and look for joint angles."""
    robot = rc.Robot.load(path)
    robot.poses(robot.rest)
    robot.solve(EYES, robot.links[-1], starts=1, most=1)


def lit(lamp: rc.Lamp) -> None:
    """Cover a part in the light of a lamp."""
    lamps = rc.Lamps([lamp], EYES[:1])
    task, camera = rc.Task(min_illuminance=1), rc.Camera.load("camera.toml")
    area = rc.regions(rc.Mesh.load("part.obj"), camera, EYES, task, lamps=lamps, threads=1).area
    assert np.isfinite(area).all()


def command(line: str) -> tuple[int, str]:
    """Exit code of a command and what it prints on standard error."""
    said = io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        code = cli.command(line.split())
    return code, said.getvalue()


def fault_of_command(line: str) -> str:
    """Fault of a command, empty if there is none.

    It must end with 0 or 1, or with 2, a line or a few that say why, and no file written. Progress
    is printed where a machine is slow.
    """
    shutil.rmtree("out", ignore_errors=True)
    Path("out").mkdir()  # else commands that write one file are refused before they read
    numbers: list[tuple[int, str]] = []
    fault = fault_of(lambda: numbers.append(command(line)))
    if fault or not numbers:
        return fault or "no end"
    code, said = numbers[0]
    errors = [each for each in said.splitlines() if each.startswith("error: ")]
    expected = "(error|warning): |.* (elapsed|left)$"
    if code == 0:
        expected += "|the page shows static results: |.*; print it at 100 %$"
    others = [each for each in said.splitlines() if not re.match(expected, each)]
    if "defect of rastercov" in said or others or code not in (0, 1, 2):
        return f"{code}: {(others or errors)[0][:300] if said else ''}"
    if code == 2 and not 1 <= len(errors) <= 20:
        return f"{len(errors)} lines of error"
    if code == 2 and any(path.is_file() for path in Path("out").rglob("*")):
        return "refused, and files are written"
    return ""


@contextlib.contextmanager
def in_valid_folder() -> Iterator[None]:
    """Work in a folder of the valid files, which is removed."""
    here = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            valid_folder(Path(folder))
            yield
        finally:
            os.chdir(here)


def attack(report: Report, effort: float) -> None:
    """All parts in a folder of their own, each fault printed with its seed."""
    with in_valid_folder():
        files(report, max(2, round(FILES * effort / len(READS))))
        buildings(report, max(1, round(BUILDINGS * effort)))
        commands(report, max(1, round(COMMANDS * effort / len(LINES))))
        names(report)


def files(report: Report, n: int) -> None:
    """Altered files of each kind by the functions that read them."""
    faults, n_read = [], 0
    for number, (name, read) in enumerate(READS.items()):
        data = Path(name).read_bytes()
        own = Path(name).with_name(f"altered{Path(name).suffix}")
        report.check(
            f"{name}: the valid file is read", not fault_of(lambda r=read, p=name: r(Path(p)))
        )
        for seed in range(n):
            rng = np.random.default_rng([seed, number])
            own.write_bytes(BOMB.encode() + data if seed == 0 else altered(data, rng))
            taken: list[object] = []
            if fault := fault_of(lambda r=read, p=own, t=taken: t.append(r(p))):
                faults.append(f"{name}, seed {seed}: {fault}")
            n_read += bool(taken)
        faults += [f"{name}: {left}"] if (left := fault_of(gc.collect)) else []
    told(report, "files altered", n * len(READS), faults)
    report.add("... of which are read", n_read, "files")


def buildings(report: Report, n: int) -> None:
    """Altered IFC files, whose library runs in a process of its own, and plans of their rooms."""
    data, plan, faults = bungalow(), Path("house.toml"), []
    plan.write_text(HOUSE)
    Path("a.ifc").write_bytes(data)
    report.check("the plan of a building holds", not fault_of_command("place house.toml -o out"))
    for seed in range(n):
        rng = np.random.default_rng(seed)
        cut = data[: int(rng.integers(len(data)))] if seed % 4 == 3 else altered(data, rng)
        Path("a.ifc").write_bytes(cut)
        if fault := fault_of(lambda: rc.Mesh.load("a.ifc")) or fault_of_command(
            "place house.toml -o out"
        ):
            faults.append(f"seed {seed}: {fault}")
    Path("a.ifc").write_bytes(data)
    for seed in range(n):
        words = list(re.finditer(r'"[^"]*"', HOUSE))
        rng = np.random.default_rng([seed, 1])
        at, new = words[int(rng.integers(len(words)))], SPACES[int(rng.integers(len(SPACES)))]
        plan.write_text(HOUSE[: at.start()] + json.dumps(new) + HOUSE[at.end() :])
        if fault := fault_of_command("place house.toml -o out"):
            faults.append(f"{new!r} for {at[0]}: {fault}")
    told(report, "buildings altered", 3 * n, faults)


def commands(report: Report, n: int) -> None:
    """Altered files by the commands that read them."""
    faults = []
    for number, (name, line) in enumerate(LINES.items()):
        path, data = Path(name), Path(name).read_bytes()
        for seed in range(n):
            path.write_bytes(altered(data, np.random.default_rng([seed, number, 1])))
            if fault := fault_of_command(line.format(name)):
                faults.append(f"{name}, seed {seed}: {line.format(name)}: {fault}")
        path.write_bytes(data)
    told(report, "commands with altered files", n * len(LINES), faults)


def told(report: Report, what: str, n: int, faults: list[str]) -> None:
    """Rows of a part, its faults printed."""
    print(*faults, sep="\n", end="\n" * bool(faults), file=sys.stderr)
    report.add(what, n, "files")
    report.add(f"{what}: wrong", len(faults), "files", at_most=0)
    report.check(f"{what}: a result, or a line and nothing written", not faults)


def names(report: Report) -> None:
    """Pages and drawings of a scene all of whose names are pieces of HTML."""
    word, text = EVIL.replace(" ", ""), json.dumps(EVIL)
    Path("part.obj").write_text(PART.replace("lid", word).replace("rest", f"{word}2"))
    Path("arm.urdf").write_text(
        re.sub('"(hand|pan|upper|arm)"', lambda result: f'"{result[1]} {html.escape(EVIL)}"', URDF)
    )
    Path("path.csv").write_text(PATH.replace("pan", '"pan ' + EVIL.replace('"', '""') + '"'))
    hand = json.dumps(f"arm/hand {EVIL}")
    Path("m.toml").write_text(
        MOTION.replace('"arm/hand"', hand)
        .replace('"plate"', text)
        .replace('["lid"]', f"[{json.dumps(word)}]")
    )
    Path("lamps.toml").write_text(LAMPS.replace("lamps.key", f"lamps.{text}"))
    Path("plan.toml").write_text(
        PLAN.replace('"key"', text)
        .replace("lamps.key", f"lamps.{text}")
        .replace("page = false", "")
    )
    rig = rc.Rig([rc.Camera.load("camera.toml")] * 2, [EVIL, f"{EVIL}2"])
    views = rc.Views(rig, rc.Poses.of(EYES, camera=[0, 1]), (f"x{EVIL}", f"y{EVIL}"))
    rc.write_views("rig.json", views, overwrite=True)
    lines = (
        "evaluate part.obj -p rig.json -o evil --lamps lamps.toml --min-illuminance 1",
        "evaluate part.obj -p rig.json -o evil_moved --motion m.toml",
        "place plan.toml -o evil_placed",
        "view evil --export evil/export.html",
        "sheet evil -o evil/sheet.svg",
        "audit rig.json part.obj -o evil_audited",
    )
    for line in lines:
        code, said = command(line)
        report.check(f"names of HTML: {line.split()[0]} takes them", code in (0, 1))
        print(said if code not in (0, 1) else "", end="", file=sys.stderr)
    pages = [path for kind in ("html", "svg") for path in sorted(Path().rglob(f"evil*/*.{kind}"))]
    broken = [str(path) for path in pages if holds_the_element(path)]
    print(*broken, sep="\n", end="\n" * bool(broken), file=sys.stderr)
    report.add("pages and drawings with names of HTML", len(pages), "files", must=5)
    report.check("names of HTML stay texts in pages and drawings", not broken)


def holds_the_element(path: Path) -> bool:
    """True for a page, also one inside of it, in which the name has become an element."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".svg":
        return any("evil" in each.tag for each in ET.fromstring(text).iter())
    inner = [html.unescape(each) for each in re.findall(r'srcdoc="([^"]*)"', text)]
    return any("<evil" in each or "<!--<script>" in each for each in (text, *inner))
