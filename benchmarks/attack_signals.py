"""Attack by signals at random moments: over all commands and methods of visibility.

Each run must end within a second of SIGINT or SIGTERM, with exit code 130 or 143 and the line
"interrupted", with no process of its own left, and in a folder that the next run takes. A run may
have ended before, or not have come as far as its own code, which catches SIGTERM: Python itself
then ends by the signal. Time that a thread of the run waited for a processor is that of others.
"""

import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import planted_links
from commands import ENTRY
from open_doors import family
from rows import Report

RUNS = 200
LATEST_S = 1.0
"""Seconds from the signal to the end."""
LONGEST_S = 12.0
"""Greatest moment of a signal, s from the start."""
FACES = 60_000
COMMANDS = (
    "evaluate soup.obj -c camera.json -p sphere:40 --by face --pictures 0 -o out",
    "evaluate soup.obj -c camera.json -p sphere:40 --pictures 0 -o out",
    "evaluate soup.obj -c camera.json -p sphere:40 --method exact --pictures 0 -o out",
    "evaluate soup.obj -c large.json -p sphere:40 --method sampled --by face --pictures 0 -o out",
    "evaluate torus -c lens.json -p sphere:400 --pictures 4 -o out",
    "evaluate torus -c camera.json -p sphere:4000 --by face --pictures 0 --workers 2 -o out",
    "place many.toml -o out",
    "place integer.toml -o out",
    "check plan.toml -p rig.json -o out",
    "audit model part.obj --pose-unit 1 -o out",
    "check area.toml -p rig.json --tolerance 2mm -o out",
    "evaluate soup.obj -c camera.json -p sphere:40 --table groups --pictures 0 -o out",
    "audit model soup.obj --pose-unit 1 --footprints f.geojson --overlap-map o.png -o out",
    "sun soup.obj --latitude 49.1 --longitude 8.44 --year 2026 -o out",
    "sun torus --latitude 49.1 --longitude 8.44 --day 2026-03-21 --penumbra -o out",
    "place flight.toml -o out",
    "compare teapot -c camera.json -p sphere:20 -o out",
    "render soup.obj -c large.json -p sphere:1 -o out",
    "convert model out.json --pose-unit 1",
    "view soup.obj -c camera.json -p sphere:8 --export page.html",
    "view part.obj -c camera.json -p sphere:8 --no-browser",
    "sheet room -c khepra -p sphere:2 -o plan.svg",
    "demo -o out",
    "doctor",
    "cameras --json",
)
"""Runs of all commands; one that is refused ends before its signal."""
MANY = planted_links.PLAN.replace('path = "part.obj"', 'built_in = "torus"').replace(
    "count = 6", "count = 400"
)
"""A plan with a matrix of 400 candidates."""


def attack(report: Report, effort: float) -> None:
    """All of it; `effort` 1 is the whole campaign."""
    rng, wrong = np.random.default_rng(0), 0
    delays: list[float] = []
    walls: list[float] = []
    signal.signal(signal.SIGINT, signal.default_int_handler)  # what is ignored here is in children
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name, "work")
        fill(folder)
        for row in range(max(2, round(effort * RUNS))):
            line = COMMANDS[row % len(COMMANDS)]
            number = (signal.SIGINT, signal.SIGTERM)[row // len(COMMANDS) % 2]
            after = float(rng.uniform(0.3, LONGEST_S) if row % 4 else rng.uniform(0.0, 2.0))
            delay, fault = outcome(line, folder, number, after)
            if delay is not None:
                delays.append(delay.own)
                walls.append(delay.wall)
            if fault:
                print(f"{line}: {number.name} after {after:.2f} s: {fault}", file=sys.stderr)
                wrong += 1
    report.add("runs with a signal", max(2, round(effort * RUNS)), "runs")
    report.add("of these ended by it", len(delays), "runs")
    if delays:
        report.add("median time to the end", float(np.median(delays)), "s")
        report.add("longest time to the end", max(delays), "s", at_most=LATEST_S)
        report.add("... with waits for a processor", max(walls), "s")
    report.check("a signal ends each command within a second, in one line", not wrong)


def fill(folder: Path) -> None:
    """Inputs of the commands."""
    planted_links.fill(folder)
    rng = np.random.default_rng(0)
    corners = rng.uniform(-1, 1, (FACES, 1, 3)) + rng.normal(0, 0.05, (FACES, 3, 3))
    with (folder / "soup.obj").open("w") as file:
        file.writelines("v {} {} {}\n".format(*point) for point in corners.reshape(-1, 3).tolist())
        file.writelines(f"f {3 * f + 1} {3 * f + 2} {3 * f + 3}\n" for f in range(FACES))
    camera = '"width": {0}, "height": {0}, "fx": {0}, "fy": {0}, "cx": {1}, "cy": {1}'
    for name, side, more in (("camera", 1000, ""), ("large", 8000, ""), ("lens", 1000, LENS)):
        text = "{" + camera.format(side, side / 2) + more + "}"
        (folder / f"{name}.json").write_text(text)
    (folder / "many.toml").write_text(MANY)
    integer = MANY.replace("[selection]", '[selection]\nmethod = "integer"\ntime_limit = 600')
    (folder / "integer.toml").write_text(integer)
    flight = planted_links.FLIGHT.replace('path = "part.obj"', 'built_in = "torus"')
    (folder / "flight.toml").write_text(flight.replace("count = 4", "count = 900"))


LENS = ', "distortion": [-0.2, 0.03, 0.0, 0.0]'


@dataclass
class Delay:
    """Time from a signal to the end of a process, s.

    Attributes
    ----------
    wall : float
        All of it.
    own : float
        Without the time that one of its threads was ready to run, and had no processor.
    """

    wall: float
    own: float


def outcome(
    line: str, folder: Path, number: signal.Signals, after: float
) -> tuple[Delay | None, str]:
    """Time from a signal to the end, None where the command had ended; and its fault, if any."""
    with subprocess.Popen(
        [sys.executable, "-c", ENTRY, *line.split()], cwd=folder, stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
    ) as child:  # fmt: skip
        with suppress(subprocess.TimeoutExpired):
            child.wait(after)
        if child.poll() is not None:
            said = child.stderr.read() if child.stderr else ""
            return None, said if "Traceback" in said or child.returncode not in (0, 1, 2) else ""
        own = family(child.pid)
        is_ready = catches(child.pid, signal.SIGTERM)
        delay = signalled(child, number, own)
        said = child.stderr.read() if child.stderr and delay else ""
    if delay is None:
        return Delay(60.0, 60.0), "it goes on"
    if not is_ready and child.returncode in (-number, 1, 128 + number):
        return delay, ""  # Python had not come to our code; in its site it ends with 1
    if child.returncode in (0, 1, 2) and "interrupted" not in said:  # it was about to end
        return delay, "" if "Traceback" not in said else said
    lines = said.splitlines()
    if child.returncode != 128 + number or lines[-1:] != ["interrupted"] or "Traceback" in said:
        return delay, f"exit code {child.returncode}: {said[-300:]}"
    time.sleep(0.3)
    left = [pid for pid in own if pid != child.pid and is_running(pid)]
    if left:
        for pid in left:
            with suppress(OSError):
                os.kill(pid, signal.SIGKILL)
        return delay, f"left {len(left)} processes"
    return delay, "" if delay.own <= LATEST_S else f"{delay}"


def signalled(
    child: "subprocess.Popen[str]", number: signal.Signals, own: set[int]
) -> Delay | None:
    """Send a signal, and wait for the end; None, and an end by force, after a minute."""
    before = waits(own)
    began = time.monotonic()
    child.send_signal(number)
    last: dict[str, float] = {}
    while child.poll() is None:
        last |= waits(own)
        if time.monotonic() - began > 60:
            child.kill()
            return None
        time.sleep(0.005)
    wall = time.monotonic() - began
    waited = max((last[task] - before.get(task, 0.0) for task in last), default=0.0)
    return Delay(wall, max(0.0, wall - waited))


def waits(pids: set[int]) -> dict[str, float]:
    """Seconds that each thread of processes was ready, and had no processor, since it began."""
    table = {}
    for pid in pids:
        for path in Path(f"/proc/{pid}/task").glob("*/schedstat"):
            with suppress(OSError):
                table[str(path)] = int(path.read_text().split()[1]) / 1e9
    return table


def is_running(pid: int) -> bool:
    """True for a process that has not ended, whether or not another has taken note of its end."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


def catches(pid: int, number: signal.Signals) -> bool:
    """True where a process has a handler of a signal."""
    with suppress(OSError):
        caught = re.search(r"SigCgt:\s*(\w+)", Path(f"/proc/{pid}/status").read_text())
        return bool(caught and int(caught[1], 16) >> (number - 1) & 1)
    return False
