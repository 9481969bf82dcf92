"""Folders of commands at every moment: python stop_commands.py FOLDER.

`evaluate`, `place` and `check` put a report where there is one, and where there is none. Before
each operation on files a copy of the folder is made, which is what a kill there leaves. Each is
looked at, opened, looked at before each operation of that, too, and in some the command runs once
more. Prints one line of JSON: for each command, the number of folders found in each state as they
were left, once opened, and after the next run.
"""

import contextlib
import hashlib
import json
import os
import shutil
import sys
from collections import Counter
from pathlib import Path

import numpy as np

from rastercov import look_at
from rastercov.cli import command
from rastercov.report import plan
from rastercov.report.check import CHECK
from rastercov.report.coverage import EVALUATION
from rastercov.report.folder import STAGING, ReportFolder
from rastercov.report.plan import PLACEMENT

PLAN = """
[[meshes]]
built_in = "icosahedron"
[camera]
width = 32
height = 24
hfov_deg = 60
[[candidates]]
generator = "on_sphere"
count = {count}
distances = [5]
[selection]
goal = "best_coverage"
cameras = 1
"""
COMMANDS = {
    "evaluate": (EVALUATION, "evaluate icosahedron -c 32.toml --pictures 0 -p {}.json --out {}"),
    "place": (PLACEMENT, "place {}.toml --out {}"),
    "check": (CHECK, "check 3.toml --poses {}.json --min-coverage 0.1 --out {}"),
}
AGAIN = 24
"""Copies of which the command runs once more in one."""


class Copies:
    """Copies of a folder, before each operation on files of this process that finds it changed."""

    def __init__(self):
        self.folder, self.seen, self.copies = None, None, []
        sys.addaudithook(self._before)

    def _before(self, event, arguments):
        folder = self.folder
        if folder is None or not (event == "open" or event.startswith("os.")):
            return
        if not str(arguments[0]).startswith(
            str(folder)
        ):  # all that is written there is named whole
            return
        self.folder = None  # looking and copying are operations on files, too
        if (seen := stamps(folder)) != self.seen:
            self.seen = seen
            copy = folder.with_name(f"{folder.name}_{len(self.copies)}")
            self.copies.append(shutil.copytree(folder, copy))
        self.folder = folder

    def during(self, folder, work):
        """Different folders during `work`, in their order."""
        self.folder, self.seen, self.copies = folder, None, []
        work()
        self.folder = None
        return self.copies


def stamps(folder):
    """Names, sizes and times of all files of a folder, without reading them."""
    files = [(path, path.lstat()) for path in folder.rglob("*")]
    return {(path, about.st_size, about.st_mtime_ns, about.st_ino) for path, about in files}


def listing(folder):
    return {path.relative_to(folder): hashed(path) for path in folder.rglob("*") if path.is_file()}


def hashed(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def run(line, *words):
    code = command(line.format(*words).split())
    assert code in (0, 1), (line, words)


def state(folder, kind, old):
    """State of a folder by its manifest alone: it lists all files that are there, and no others."""
    here = {str(name): sha for name, sha in listing(folder).items() if len(name.parts) == 1}
    manifest = folder / kind.manifest
    files = json.loads(manifest.read_bytes())["files"] if here.pop(kind.manifest, None) else {}
    if kind.last not in here:
        return "incomplete" if here or old else "old"
    if here != {name: entry["sha256"] for name, entry in files.items()}:
        return "torn"
    if here == old:
        return "old"
    is_part = json.loads((folder / kind.last).read_bytes()).get("interrupted")
    return "unfinished" if is_part else "new"


def open_only(folder, kind):
    with ReportFolder(folder, kind):
        pass


def look(name, base, copies, has_old):
    """Counts of folders as a command leaves them, once they are opened, and after the next run."""
    kind, line = COMMANDS[name]
    folder = base / f"{name}_{has_old}"
    folder.mkdir()
    if has_old:
        run(line, 3, folder)
    old = {str(name): sha for name, sha in listing(folder).items() if len(name.parts) == 1}
    old.pop(kind.manifest, None)
    found, opened, again = Counter(), Counter(), Counter()
    for number, copy in enumerate(copies.during(folder, lambda: run(line, 4, folder))):
        found[state(copy, kind, old)] += 1
        for other in copies.during(copy, lambda copy=copy: open_only(copy, kind)):
            found[state(other, kind, old)] += 1
        opened[state(copy, kind, old)] += 1
        opened["left"] += (copy / STAGING).exists()
        if number % AGAIN == AGAIN // 2:
            run(line, 4, copy)
            again[state(copy, kind, old)] += 1
            again["left"] += (copy / STAGING).exists() or any(copy.rglob("*.part"))
    return found, opened, again


def main():
    base = Path(sys.argv[1])
    os.chdir(base)
    for count in (3, 4):
        Path(f"{count}.toml").write_text(PLAN.format(count=count))
        points = np.random.default_rng(count).normal(size=(count, 3)) * 3
        poses = look_at(points, (0, 0, 0)).tolist()
        Path(f"{count}.json").write_text(json.dumps({"world_from_camera": poses}))
    Path("32.toml").write_text("width = 32\nheight = 24\nhfov_deg = 60\n")
    plan.WORTH_SAVING = 0.0
    copies = Copies()
    with contextlib.redirect_stdout(None):
        table = {
            f"{name} {has_old}": look(name, base, copies, has_old)
            for name in COMMANDS
            for has_old in (False, True)
        }
    print(json.dumps(table))


if __name__ == "__main__":
    main()
