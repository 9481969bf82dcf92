"""Cost of what every user runs: help, version, an evaluation, and `make demo` from nothing.

CPU seconds of a process, the least of some rounds after one that warms the files: an evaluation of
12 poses of the teapot, with pictures and pages, until its answer is on the screen and in all; and
`--help` and `--version`. `--demo` also clones this checkout, as it is committed, and runs `make
demo` there, without ccache: CPU seconds of all processes, nearly all of the compiler, and seconds
by the clock, which mean something only where nothing else runs.
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rows import Report, arguments

ROOT = Path(__file__).parents[1]
COMMAND = [sys.executable, "-m", "rastercov"]
EVALUATE = ["evaluate", "teapot", "-c", "khepra", "-p", "sphere:12", "-o"]
FILES = {"report.html", "view.html", "summary.json", "rig.json", "network.glb"} | {
    f"{name}.png" for name in ("overview", "zones", "contact_sheet")
}
ANSWER_S, EVALUATE_S, HELP_S, VERSION_TO_HELP = 1.0, 1.6, 0.1, 1.3
DEMO_S, DEMO_WALL_S = 200.0, 120.0
"""The most of each."""


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--demo", action="store_true", help="make demo in a clone, too")
    args = parser.parse_args()
    report = Report(prints=not args.json)
    evaluations(report, args.rounds)
    words(report, args.rounds)
    if args.demo:
        demo(report)
    report.finish(args.json)


def evaluations(report: Report, rounds: int) -> None:
    """Rows of an evaluation with all its files."""
    answers, wholes = [], []
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder, "report")
        for _ in range(1 + rounds):
            line, at_answer, in_all = ran([*COMMAND, *EVALUATE, str(out)])
            answers.append(at_answer)
            wholes.append(in_all)
        items = {path.name for path in out.iterdir()}
    report.check("evaluate: the answer is its first line", line.startswith("covered: "))
    report.check("evaluate: the files of a report, and no table", not_hidden(items) == FILES)
    what = "evaluate, 12 poses of the teapot: CPU"
    report.add(f"{what} until the answer", min(answers[1:]), "s", at_most=ANSWER_S)
    report.add(f"{what} in all", min(wholes[1:]), "s", at_most=EVALUATE_S)


def not_hidden(names: set[str]) -> set[str]:
    return {name for name in names if not name.startswith(".")}


def words(report: Report, rounds: int) -> None:
    """Rows of help and version."""
    least = {
        option: min(ran([*COMMAND, option])[2] for _ in range(1 + rounds))
        for option in ("--help", "--version")
    }
    report.add("--help: CPU", least["--help"], "s", at_most=HELP_S)
    ratio = least["--version"] / least["--help"]
    report.add("--version to --help: CPU", ratio, "", at_most=VERSION_TO_HELP)


def ran(command: list[str]) -> tuple[str, float, float]:
    """First line of a process, and its CPU seconds until then and in all."""
    env = {name: own for name, own in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=env
    ) as child:
        assert child.stdout is not None
        line = child.stdout.readline()
        fields = Path(f"/proc/{child.pid}/stat").read_text().rpartition(")")[2].split()
        at_line = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
        child.stdout.read()
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        raise subprocess.CalledProcessError(child.returncode, command)
    return line, at_line, usage.ru_utime + usage.ru_stime


def demo(report: Report) -> None:
    """Rows of `make demo` in a clone."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(["git", "clone", "-q", str(ROOT), folder], check=True)
        before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
        without = os.environ | {"CCACHE_DISABLE": "1"}
        ended = subprocess.run(
            ["make", "demo"], cwd=folder, env=without, stdout=sys.stderr, check=False
        )
        wall = time.monotonic() - began
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        report.check("make demo: exit 0", ended.returncode == 0)
        cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        report.add("make demo: CPU of all processes", cpu, "s", at_most=DEMO_S)
        report.add("make demo: by the clock", wall, "s", at_most=DEMO_WALL_S)


if __name__ == "__main__":
    main()
