"""Attack on the processes of a run: by another user, by modules in the folder, by damaged notes.

`ports` looks for whatever the processes of `--workers` leave open, `modules` runs commands in a
folder of modules that must not be executed, `notes` damages files of a matrix with a pose left out,
`ends` ends commands by signals, and by a disk that is full.
"""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import killing_shards
import matrix_damage
import numpy as np
from attack_reports import _disk, _fill
from hostile_folder import COMMANDS, SCRIPT, command, executed, fill
from open_doors import family, listening, opened_by_others
from rows import Report

import rastercov as rc
from rastercov.base.errors import ConfigError
from rastercov.core.mesh import shapes
from rastercov.formats.cameras import write_views
from rastercov.placement.matrix import VisibilityMatrix, build_matrix
from rastercov.shards import Workers

NOTES, SIGNALS, DISKS, LOOKS = 400, 20, 20, 20
"""Damaged folders, ended runs, full disks and looks at a run of the whole campaign."""
DAMAGE = (
    matrix_damage.one_bit, matrix_damage.cut, matrix_damage.longer, matrix_damage.zeros,
    matrix_damage.garbage, matrix_damage.deleted,
)  # fmt: skip
CAMERA = rc.Camera(width=64, height=64, fx=70, fy=70)
POSES = rc.sphere_of_poses((0, 0, 0), 4.2, 6)
RUN = "evaluate torus -c camera.toml -p sphere:4000 --by face --pictures 0 --workers 2 -o"


def attack(report: Report, effort: float) -> None:
    """All of it; `effort` 1 is the whole campaign."""
    with tempfile.TemporaryDirectory() as name:
        base = Path(name)
        folder = base / "hostile"
        folder.mkdir()
        fill(folder)
        views = rc.Views(rc.Rig([CAMERA], ["one"]), rc.Poses.of(POSES), tuple("abcdef"))
        write_views(folder / "model", views)
        ports(report, folder, max(2, round(effort * LOOKS)))
        modules(report, folder, COMMANDS if effort >= 0.05 else COMMANDS[:3])
        ends(report, folder, max(2, round(effort * SIGNALS)))
        full(report, folder, base / "disk", max(2, round(effort * DISKS)))
        notes(report, base, max(len(DAMAGE), round(effort * NOTES)))


def ports(report: Report, folder: Path, looks: int) -> None:
    """Look at the processes of a run again and again, from its start on."""
    texts: set[str] = set()
    n_processes = 0
    with _started(folder, "ports") as head:
        while looks > 0 and head.poll() is None:
            time.sleep(0.25)
            pids = family(head.pid)
            n_processes = max(n_processes, len(pids))
            looks -= n_processes >= 3  # the workers are there
            texts |= set(listening(pids))
            if os.geteuid() == 0:
                texts |= set(opened_by_others(pids))
        head.kill()
    print("\n".join(sorted(texts)), end="", file=sys.stderr)
    report.add("processes of a run", n_processes, "processes", must=3)
    report.add("doors of a run that others find open", len(texts), "doors", at_most=0)
    report.check("nothing of a run by workers is open to other users", not texts)


def modules(report: Report, folder: Path, commands: tuple[str, ...]) -> None:
    """Run commands in a folder with a file for every module."""
    wrong = 0
    for line in commands:
        done = command(folder, line.split())
        is_well = done.returncode in ((2,) if "part.step" in line else (0, 1))
        wrong += not is_well or "Traceback" in done.stderr
    report.add("commands in a folder of modules", len(commands), "commands")
    report.add("modules of it that were executed", len(executed(folder)), "modules", at_most=0)
    report.check("no module of the working folder is executed", not executed(folder) and not wrong)


def ends(report: Report, folder: Path, count: int) -> None:
    """End runs by SIGTERM, from their start on."""
    rng = np.random.default_rng(0)
    wrong = 0
    for turn in range(count):
        with _started(folder, f"end-{turn}") as head:
            time.sleep(rng.uniform(2, 12))
            head.send_signal(signal.SIGTERM)
            said = head.communicate(timeout=300)[1].decode().splitlines()
        ended = head.returncode in (143, -signal.SIGTERM) or head.returncode in (0, 1)
        if not ended or any("defect" in line or "Traceback" in line for line in said):
            print(f"end {turn}: {head.returncode}: {said}", file=sys.stderr)
            wrong += 1
    report.add("runs ended by SIGTERM", count, "runs")
    report.check("a run that is ended says so, and nothing of defects", not wrong)


def full(report: Report, folder: Path, disk: Path, count: int) -> None:
    """Runs by workers on disks with little room."""
    wrong = n_disks = 0
    for free in np.geomspace(4e3, 4e5, count).astype(int).tolist():
        with _disk(disk, 1 << 23) as place:
            if place is None:
                continue
            _fill(place, free)
            n_disks += 1
            done = command(folder, [*RUN.split(), str(place / "out")])
            lines = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
            named = len(lines) == 1 and lines[0].startswith(f"error: {place}/out")
            if done.returncode != 2 or not named:
                print(f"{free} bytes free: {done.returncode}: {done.stderr}", file=sys.stderr)
                wrong += 1
    report.add("runs by workers on full disks", n_disks, "runs")
    report.check("a full disk under workers is one line with the file", not wrong)


def notes(report: Report, base: Path, count: int) -> None:
    """Damage any file of a matrix with a pose left out; read it, and build it again."""
    view, whole = (shapes.torus(12, 8), CAMERA), base / "whole"
    plain = build_matrix(view, POSES)
    killing_shards.build(view, POSES, None, whole, workers=Workers(1))
    rng, wrong = np.random.default_rng(1), 0
    for trial in range(count):
        folder = base / "damaged"
        shutil.copytree(whole, folder)
        what = DAMAGE[trial % len(DAMAGE)](folder, None, rng)
        if fault := _fault(folder, view, plain):
            print(f"note {trial}, {what}: {fault}", file=sys.stderr)
            wrong += 1
        shutil.rmtree(folder)
    report.add("damaged matrices with a pose left out", count, "folders")
    report.add("of these believed, or ended by a defect", wrong, "folders", at_most=0)
    report.check("a damaged matrix with a pose left out is refused, or made again", not wrong)


def _fault(folder: Path, view: tuple[rc.Mesh, rc.Camera], plain: VisibilityMatrix) -> str:
    try:
        if not _is_right(VisibilityMatrix.load(folder), plain):
            return "read, and wrong"
    except ConfigError as error:
        if "\n" in str(error) or str(folder) not in str(error):
            return f"no clear line: {error}"
    again = build_matrix(view, POSES, None, folder, poses_a_shard=killing_shards.SMALL,
                         note=lambda line: None)  # fmt: skip
    return "" if _is_right(again, plain) else "built again, and wrong"


def _is_right(visibility_matrix: VisibilityMatrix, plain: VisibilityMatrix) -> bool:
    """True if each pose has its pairs, or none and a note."""
    for pose in range(plain.n_poses):
        rows, others = (slice(*each.indptr[pose : pose + 2]) for each in (visibility_matrix, plain))
        wanted = plain.face[others] if pose not in visibility_matrix.quarantined else []
        if not np.array_equal(visibility_matrix.face[rows], wanted):
            return False
    return set(visibility_matrix.quarantined) <= {killing_shards.POISONED}


def _started(folder: Path, out: str, **environment: str) -> "subprocess.Popen[bytes]":
    """A run by two workers."""
    words = [sys.executable, folder / SCRIPT, *RUN.split(), out]
    return subprocess.Popen(
        words, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
        env=os.environ | environment,
    )  # fmt: skip
