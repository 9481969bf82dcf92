"""Attack the folders of reports: kill the command, fill its disk, run two at once.

    python benchmarks/attack.py reports

A folder holds a report, or none, and a file of somebody else. `rastercov evaluate`, or `place`,
puts another report there, and

- is killed (SIGKILL) at a random moment of its run, every other time of the milliseconds in which
  it puts its report there;
- has a disk of its own with a given number of free bytes (a small tmpfs, as root; else a limit on
  the size of a file);
- has another plan's run beside it in the same folder;
- is killed before each of its operations on files (`tests/support/kill_report.py`).

After each, the folder must hold one of the two reports whole, by the hashes in its manifest and by
what its files say of each other, or lack the file that comes last (`place` may leave one that says
it is unfinished where there was none); the other file is untouched; and the next run leaves a whole
report, and nothing of the killed one.
"""

import contextlib
import hashlib
import io
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from rows import SUPPORT, Report

from rastercov import cli
from rastercov.report.coverage import EVALUATION
from rastercov.report.folder import STAGING, ReportFolder
from rastercov.report.plan import PLACEMENT

KILLS, DISKS, PAIRS = 100, 50, 10
RUN_AGAIN = 5
"""Kills after each of which the command runs once more to its end."""
FRESH = 3
"""Kills of which one meets a folder without an earlier report."""
SWAP = 0.05
"""Seconds after the last file is written, in which a report is put in its place."""
KINDS = {"evaluate": EVALUATION, "place": PLACEMENT}
SLOWEST = 120.0
"""Seconds after which a run counts as hung."""
MINE = b"mine"
PLAN = """
[[meshes]]
built_in = "icosahedron"
[camera]
width = 96
height = 72
fx = 90
fy = 90
[[candidates]]
generator = "on_sphere"
count = {count}
distances = [5]
[selection]
goal = "best_coverage"
cameras = 3
refine = true
"""


@dataclass(frozen=True)
class Command:
    """A command that replaces a report.

    Attributes
    ----------
    name : str
    old, new : list of str
        Arguments that make the report before, and the one that is attacked.
    last : str
        File without which a report is not whole.
    """

    name: str
    old: list[str]
    new: list[str]
    last: str


def commands(plans: Path) -> list[Command]:
    """The two commands, with plan files in a folder."""
    for count in (30, 40):
        (plans / f"{count}.toml").write_text(PLAN.format(count=count), encoding="utf-8")
    camera = plans / "camera.toml"
    camera.write_text("width = 96\nheight = 72\nfx = 90\nfy = 90\n", encoding="utf-8")
    evaluate = ["evaluate", "icosahedron", "-c", str(camera), "--pictures", "4"]
    evaluate += ["--table", "seen", "--full", "poses", "-p"]
    return [
        Command("evaluate", [*evaluate, "sphere:3"], [*evaluate, "sphere:60"], "summary.json"),
        Command(
            "place",
            ["place", str(plans / "30.toml")],
            ["place", str(plans / "40.toml")],
            "plan.json",
        ),
    ]


def attack(report: Report, effort: float) -> None:
    """The whole campaign; `effort` 1 is 100 kills, 50 disks and 10 pairs for each command."""
    rng = np.random.default_rng(2026)
    count = {name: max(2, round(effort * n)) for name, n in (("kills", KILLS), ("disks", DISKS))}
    with tempfile.TemporaryDirectory() as name, contextlib.redirect_stdout(None):
        base = Path(name)
        both = commands(base)
        for command in both:
            before = base / f"before_{command.name}"
            seconds = _prepared(command, before)
            killed(report, command, before, base, rng.uniform(0, 1, count["kills"]), seconds)
            full(report, command, before, base, count["disks"])
        at_once(report, both[1], base, max(1, round(effort * PAIRS)), seconds)
        if effort >= 0.05:  # always the same runs, which tests/report has, too
            each_operation(report, base / "operations")


def _prepared(command: Command, before: Path) -> float:
    """Make the report that is there before; seconds that the attacked command takes."""
    assert cli.command([*command.old, "--out", str(before)]) in (0, 1)
    (before / "notes.txt").write_bytes(MINE)
    warm = before.with_name(f"warm_{command.name}")
    assert cli.command([*command.new, "--out", str(warm)]) in (0, 1)
    shutil.rmtree(warm)
    started = time.perf_counter()
    assert _ended(_started(command.new, warm, before.with_name("errors"))) in (0, 1)
    return time.perf_counter() - started


def _started(words: list[str], folder: Path, errors: Path, limit: int | None = None) -> int:
    """Process that runs a command, by its id; forked, so that nothing is loaded again."""
    process = os.fork()
    if process:
        return process
    code = 99
    try:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        if limit is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
        for stream, path in ((1, os.devnull), (2, errors)):
            descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(descriptor, stream)
        sys.stderr = os.fdopen(2, "w")
        code = cli.command([*words, "--out", str(folder)])
        sys.stderr.flush()
    finally:
        os._exit(code)


def _has_ended(process: int) -> bool:
    """True if a process has ended; it can still be killed and waited for."""
    return os.waitid(os.P_PID, process, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None


def _ended(process: int) -> int:
    """Exit code of a process, or minus its signal; one that hangs is killed."""
    until = time.monotonic() + SLOWEST
    while time.monotonic() < until:
        done, status = os.waitpid(process, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.005)
    os.kill(process, signal.SIGKILL)
    os.waitpid(process, 0)
    return -signal.SIGALRM


# --- what a folder holds --------------------------------------------------------------------------


def content(folder: Path) -> dict[str, bytes]:
    """Files of a folder by name."""
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def state(folder: Path, command: Command, old: dict[str, bytes]) -> str:
    """Contents of a folder.

    Returns
    -------
    str
        "old" or "new" for a whole report, "unfinished" for one that says it is, "incomplete" where
        the last file is missing, "torn" for anything else, "foreign" where another file suffered.
    """
    here = content(folder)
    if here == old:
        return "old"
    if here.pop("notes.txt", None) != MINE:
        return "foreign"
    if command.last not in here:
        return "incomplete"
    try:
        manifest = json.loads(here.pop(f".rastercov-{command.name}.json"))["files"]
        hashes = {name: hashlib.sha256(data).hexdigest() for name, data in here.items()}
        if hashes != {name: entry["sha256"] for name, entry in manifest.items()}:
            return "torn"
        told = json.loads(here[command.last])
        judge = _evaluation if command.name == "evaluate" else _placement
        return judge(here, told)
    except (KeyError, ValueError, OSError):
        return "torn"


def _but(text: str, is_fresh: bool) -> str:
    """The same; an unfinished report is allowed only in an empty folder."""
    return "torn" if text == "unfinished" and not is_fresh else text


def _evaluation(here: dict[str, bytes], told: dict[str, object]) -> str:
    table = pq.read_table(io.BytesIO(here["coverage.parquet"]), columns=["pose"])
    pictures = [name for name in here if name.startswith("pose_")]
    is_whole = (
        told["poses"] == 60
        and table["pose"].to_numpy().max() == 59
        and len(pictures) == 4
        and {"network.glb", "contact_sheet.png"} <= here.keys()
    )
    return "new" if is_whole and not told["interrupted"] else "torn"


def _placement(here: dict[str, bytes], told: dict[str, object]) -> str:
    poses = json.loads(here["poses.json"])["world_from_camera"]
    if len(poses) != len(told["cameras"]):  # type: ignore[arg-type] # JSON
        return "torn"
    if told["interrupted"]:
        return "unfinished" if "page.html" not in here else "torn"
    return "new" if "page.html" in here and told["left"] is not None else "torn"


# --- the attacks ----------------------------------------------------------------------------------


def killed(
    report: Report,
    command: Command,
    before: Path,
    base: Path,
    moments: np.ndarray,
    seconds: float,
) -> Counter[str]:
    """Kill a command at each of some moments, as shares of the seconds that it takes.

    Every other of them is of `SWAP` seconds, from when its last file is written.
    """
    folder, errors = base / "out", base / "errors"
    states: Counter[str] = Counter()
    after: Counter[str] = Counter()
    left = again = 0
    for number, moment in enumerate(moments.tolist()):
        shutil.rmtree(folder, ignore_errors=True)
        is_fresh = number % FRESH == 0
        if is_fresh:
            folder.mkdir()
            _with_note(folder)
        else:
            shutil.copytree(before, folder)
        old = content(folder)
        process = _started(command.new, folder, errors)
        if number % 2:
            written = folder / STAGING / "new" / command.last
            while not written.exists() and not _has_ended(process):
                time.sleep(1e-4)
        time.sleep(moment * (SWAP if number % 2 else 1.1 * seconds))
        os.kill(process, signal.SIGKILL)
        os.waitpid(process, 0)
        states[_but(state(folder, command, old), is_fresh)] += 1
        with ReportFolder(folder, KINDS[command.name]):
            after[_but(state(folder, command, old), is_fresh)] += 1
        left += (folder / STAGING).exists()
        if number % RUN_AGAIN == 0:
            code = _ended(_started(command.new, folder, errors))
            again += code in (0, 1) and state(folder, command, old) == "new"
            left += (folder / STAGING).exists() or any(folder.rglob("*.part"))
    for name in ("old", "new", "unfinished", "incomplete"):
        report.add(f"{command.name}, SIGKILL: folders found {name}", states[name], "folders")
    report.add(f"{command.name}, SIGKILL: torn", states["torn"], "folders", at_most=0)
    report.check(f"{command.name}, SIGKILL: no report is torn", not states["torn"])
    report.check(f"{command.name}, SIGKILL: no foreign file is touched", not states["foreign"])
    report.check(
        f"{command.name}, SIGKILL: whole once the next run opens the folder",
        after.keys() <= {"old", "new", "unfinished"},
    )
    report.check(
        f"{command.name}, SIGKILL: the next run leaves a whole report",
        again == -(-len(moments) // RUN_AGAIN),
    )
    report.check(f"{command.name}, SIGKILL: the next run leaves nothing behind", not left)
    return states


def full(report: Report, command: Command, before: Path, base: Path, n_disks: int) -> Counter[str]:
    """Run a command on disks with ever more bytes left, up to those it needs."""
    old, errors = content(before), base / "errors"
    warm = base / f"warm_{command.name}"
    sizes = {path: path.stat().st_size for path in warm.rglob("*") if path.is_file()}
    most = int(1.1 * sum(sizes.values())) + (1 << 15)
    used = sum(path.stat().st_size for path in before.rglob("*") if path.is_file())
    states: Counter[str] = Counter()
    lines = 0
    left = 0
    for free in np.linspace(0, most, n_disks).astype(int).tolist():
        with _disk(base / "disk", 2 * used + 2 * most + (4 << 20)) as disk:
            folder = (disk or base) / "out"
            shutil.rmtree(folder, ignore_errors=True)
            shutil.copytree(before, folder)
            if disk is not None:
                _fill(disk, free)
            limit = None if disk is not None else max(1, free // 8)
            code = _ended(_started(command.new, folder, errors, limit))
            but = _but(state(folder, command, old), False)
            states[but] += 1
            lines_said = errors.read_text(encoding="utf-8").splitlines()
            said = [line for line in lines_said if not line.endswith((" left", " elapsed"))]
            is_named = len(said) == 1 and said[0].startswith(f"error: {folder}/")
            lines += code in (0, 1) if but == "new" else code == 2 and is_named
            left += (folder / STAGING).exists() or any(folder.rglob("*.part"))
    what = f"{command.name}, full disk"
    report.add(f"{what}: folders found old", states["old"], "folders")
    report.add(f"{what}: folders found new", states["new"], "folders")
    report.check(f"{what}: no report is torn", not states["torn"] + states["incomplete"])
    report.check(f"{what}: no foreign file is touched", not states["foreign"])
    report.check(f"{what}: one line names the file, exit code 2", lines == n_disks)
    report.check(f"{what}: nothing is left behind", not left)
    return states


@contextlib.contextmanager
def _disk(path: Path, size: int) -> Iterator[Path | None]:
    """A small disk of its own; None where this process may not mount one."""
    path.mkdir(exist_ok=True)
    words = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(path)]
    if os.geteuid() or subprocess.run(words, capture_output=True, check=False).returncode:
        yield None
        return
    try:
        yield path
    finally:
        subprocess.run(["umount", "--lazy", str(path)], check=True)


def _fill(disk: Path, free: int) -> None:
    """Fill a disk up to the given number of free bytes."""
    about = os.statvfs(disk)
    block = about.f_frsize
    with (disk / "filler").open("wb") as file:
        os.posix_fallocate(file.fileno(), 0, (about.f_bavail - -(-free // block)) * block or 1)


def at_once(report: Report, command: Command, base: Path, n_pairs: int, seconds: float) -> None:
    """Two runs with different plans into one folder, the second in the first half of the first."""
    rng = np.random.default_rng(7)
    refused = whole = kept = 0
    for delay in rng.uniform(0.1, 0.4, n_pairs).tolist():
        folder = base / "out"
        shutil.rmtree(folder, ignore_errors=True)
        first = _started(command.new, folder, base / "errors")
        time.sleep(delay * seconds)
        second = _started(command.old, folder, base / "second")
        codes = _ended(first), _ended(second)
        text = (base / "second").read_text(encoding="utf-8")
        said = text.splitlines()
        refused += codes[1] == 2 and len(said) == 1 and "another process is writing" in said[0]
        whole += state(_with_note(folder), command, {}) == "new"
        kept += len(list((folder / "matrix").iterdir())) == 1
    report.check("place, two at once: one is refused in one line", refused == n_pairs)
    report.check("place, two at once: the other's report is whole", whole == n_pairs)
    report.check("place, two at once: the other's matrix is kept", kept == n_pairs)


def each_operation(report: Report, folder: Path) -> None:
    """Kill the writing of a report before each of its file operations, and what makes up for it."""
    folder.mkdir()
    script = SUPPORT / "kill_report.py"
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, script, folder], env=environment, capture_output=True, check=True
    )
    content = json.loads(done.stdout)
    report.add("operations on files of a report", content["kills"], "operations")
    for name, count in content["killed"].items():
        report.add(f"killed before one of them: folders found {name}", count, "folders")
    report.check("killed before one of them: no report is torn", "torn" not in content["killed"])
    report.check(
        "killed before one of them: whole once the next run opens the folder",
        content["after"].keys() <= {"old", "new"},
    )


def _with_note(folder: Path) -> Path:
    (folder / "notes.txt").write_bytes(MINE)
    return folder
