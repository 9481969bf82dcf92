"""Commands in a folder where a symbolic link lies under a name that they use.

Which names these are is seen from a run without links, by Python's audit events: all that it opens,
makes, renames or removes. A link leads to a folder that has all names of that run, to a file, or to
nothing. After the command all outside must be as it was.
"""

import contextlib
import io
import os
import re
import shutil
import sys
from pathlib import Path

import numpy as np
from commands import write_part

import rastercov as rc
from rastercov import cli
from rastercov.base.output import PART
from rastercov.formats.cameras import write_views

PLAN = """
meshes = [{ path = "part.obj" }]
camera = { width = 96, height = 72, fx = 90, fy = 90 }
[task]
min_pixels = 2
[[candidates]]
generator = "on_sphere"
count = 6
distances = [3.5]
[selection]
goal = "fewest_cameras"
coverage = 0.5
[outputs]
page = false
"""
FLIGHT = """
meshes = [{ path = "part.obj" }]
camera = { width = 96, height = 72, fx = 90, fy = 90 }
[task]
max_incidence_deg = 80
[[candidates]]
generator = "orbit"
radius = 20
heights = [10]
count = 4
[selection]
goal = "all"
[flight]
crs = "EPSG:32632"
origin = [500000, 5300000, 400]
[outputs]
page = false
"""
EVALUATE = "evaluate part.obj -c camera.json -p poses.json"
COMMANDS = (
    f"{EVALUATE} --pictures 1 -o out",
    f"{EVALUATE} --pictures 0 --by face --table all --workers 1 -o deep/out",
    f"{EVALUATE} --pictures 0 --table groups -o out",
    "demo --shape box --poses 1 -o out",
    "render part.obj -c camera.json -p poses.json -o out",
    "place plan.toml -o out",
    "check plan.toml -p rig.json -o out --junit out/result.xml --summary out/result.md",
    "check plan.toml -p rig.json --junit results/junit.xml",
    "check area.toml -p rig.json --tolerance 2mm -o out",
    "place flight.toml -o out",
    "audit model part.obj --pose-unit 1 -o out",
    "audit model part.obj --pose-unit 1 --footprints out/f.geojson --overlap-map out/o.png -o out",
    "sun part.obj --latitude 48 --longitude 11 --day 2026-06-21 --step 60 -o out",
    "compare part.obj -c camera.json -p poses.json -o out",
    "convert model out/cameras.json --pose-unit 1",
    "convert poses.json out/poses.npy",
    "convert model out",
    "convert model out --to colmap --overwrite",
    "view part.obj -c camera.json -p poses.json --export out/page.html",
    "sheet room -c khepra -p sphere:2 -o out/sheet.svg",
    "sheet room -c khepra -p sphere:2 -o out/sheet.pdf",
)
"""Every command that writes, with what it takes; one that is refused writes nothing either."""
MADE = ("out", "deep")
"""Folders that are made beforehand where a file in them is named."""
KINDS = ("folder", "file", "nothing")
FOLDER = re.compile(r"-o (\S+)(?<!svg)(?<!pdf)|convert \S+ (out)(?: |$)")


class Watched:
    """Paths of a folder that this process opens, makes, renames or removes in a `with` block."""

    events = ("open", "os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.listdir", "os.scandir")
    active: "Watched | None" = None
    is_hooked = False

    def __init__(self, folder):
        self.folder, self.names = folder, set()

    def __enter__(self):
        if not Watched.is_hooked:
            Watched.is_hooked = True
            sys.addaudithook(Watched.hook)
        Watched.active = self
        return self.names

    def __exit__(self, *error):
        Watched.active = None

    @staticmethod
    def hook(event, arguments):
        watched = Watched.active
        if watched is None or event not in Watched.events:
            return
        for each in arguments[: 1 if event == "open" else 2]:
            if isinstance(each, str | os.PathLike):
                with contextlib.suppress(ValueError):
                    path = Path(os.path.normpath(Path(watched.folder, each)))
                    watched.names.add(path.relative_to(watched.folder))


def fill(folder):
    """Inputs of the commands, and empty folders for those that make none."""
    folder.mkdir(parents=True)
    write_part(folder / "part.obj")
    camera = rc.Camera(width=96, height=72, fx=90, fy=90)
    camera.save(folder / "camera.json")
    ends = np.concatenate((np.eye(3), -np.eye(3)))
    poses = rc.look_at(3.5 * ends, np.zeros(3))
    for name in ("rig.json", "poses.json"):
        rc.write_poses(folder / name, poses)
    rig = rc.Rig([camera], ["one"])
    write = rc.Views(rig, rc.Poses.of(poses), tuple("abcdef"))
    write_views(folder / "model", write)
    (folder / "plan.toml").write_text(PLAN)
    (folder / "area.toml").write_text(PLAN.replace("min_pixels = 2", ""))
    (folder / "flight.toml").write_text(FLIGHT)
    (folder / "results").mkdir()


def run(line, folder):
    """Exit code and standard error of a command in a folder, in this process."""
    out, err, before = io.StringIO(), io.StringIO(), Path.cwd()
    os.chdir(folder)
    try:
        for made in MADE:
            if f"{made}/" in line:
                Path(made).mkdir(exist_ok=True)
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = cli.command(line.split())
    finally:
        os.chdir(before)
    return code, err.getvalue()


def names_of(line, folder):
    """Names that a command uses and that are none of its inputs; the folder it was named apart."""
    fill(folder)
    inputs = {path.relative_to(folder) for path in folder.rglob("*")}
    inputs |= {Path(), *map(Path, MADE), Path("ezdxf.ini")}  # a library looks for the last
    with Watched(folder) as names:
        run(line, folder)
        names |= {path.relative_to(folder) for path in folder.rglob("*")}
        run(line, folder)  # over what is there, which it may remove
    given = FOLDER.search(line)
    asked = Path(given[1] or given[2]) if given else Path()
    shutil.rmtree(folder)
    used = (name for name in names - inputs if not PART.fullmatch(name.name))
    return sorted(
        name for name in used if name not in {asked, *asked.parents} and ".." not in name.parts
    )


def fault_of(line, names, name, kind, base):
    """Fault of a command with a link of a kind under a name; none: an empty text."""
    folder, outside = base / "work", base / "outside"
    shutil.rmtree(base, ignore_errors=True)
    fill(folder)
    within = {parent for each in names for parent in each.parents}
    for each in {*names} - within - {name}:  # files that could be meant are there
        below = each.relative_to(name) if each.is_relative_to(name) else Path(each.name)
        place = outside / "folder" / below
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(b"of somebody else")
    (outside / "folder").mkdir(parents=True, exist_ok=True)
    (outside / "folder/.0123456789ab.part").write_bytes(b"of somebody else")
    (outside / "file").write_bytes(b"")  # empty: may be replaced by the outcome of a check
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    (folder / name).symlink_to(os.path.relpath(outside / kind, (folder / name).parent))
    before = _content(outside)
    code, said = run(line, folder)
    errors = [text for text in said.splitlines() if text.startswith("error: ")]
    if _content(outside) != before:
        return f"touched what is outside, exit code {code}: {said}"
    if "Traceback" in said or "defect" in said or code not in (0, 1, 2):
        return f"exit code {code}: {said}"
    if code == 2 and len(errors) != 1:
        return f"no clear line: {said}"
    return ""


def _content(folder):
    return {path: path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}
