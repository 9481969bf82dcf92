"""The form every benchmark reports in: rows of what, value, unit, must, aim, holds.

Where this is imported, modules of `tests/support` can be, too.
"""

import argparse
import json
import os
import platform
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, TextIO

SUPPORT = Path(__file__).parents[1] / "tests" / "support"
sys.path.append(str(SUPPORT))


@dataclass
class Report:
    """Rows of one benchmark, and the correctness checks that failed.

    With `prints`, each row is printed as it is made, otherwise all of them at the end.
    """

    prints: bool = False
    rows: list[dict[str, Any]] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)

    def add(
        self,
        what: str,
        value: float,
        unit: str,
        must: float | None = None,
        aim: float | None = None,
        *,
        at_most: float | None = None,
    ) -> None:
        """One figure; `must` and `aim` are lower limits, `at_most` and `aim` upper ones.

        Where at most 0 is permitted it counts what is wrong, and is a correctness check.
        """
        holds = None if must is None else bool(value >= must)
        if at_most is not None:
            must, holds = at_most, bool(value <= at_most)
            if at_most == 0 and not holds:
                self.failed.append(what)
        self.rows.append(
            {"what": what, "value": value, "unit": unit, "must": must, "aim": aim, "holds": holds}
        )
        if self.prints:
            _print(self.rows[-1])

    def check(self, what: str, passed: bool) -> None:
        """A correctness check: one that fails makes the benchmark exit with 1."""
        self.add(what, float(passed), "passed", must=1.0)
        if not passed:
            self.failed.append(what)

    def finish(self, as_json: bool) -> None:
        """Print everything and leave with 1 when a correctness check failed."""
        if as_json:
            print(json.dumps(self.rows, indent=2), file=_Parser.rows_go_to)
        else:
            print(machine())
            for row in () if self.prints else self.rows:
                _print(row)
        for what in self.failed:
            print(f"error: {what}: wrong", file=sys.stderr)
        sys.exit(1 if self.failed else 0)


def _print(row: dict[str, Any]) -> None:
    """Print one row, at once also where the output is no terminal."""
    limit = "" if row["must"] is None else f"   must {row['must']:g}"
    verdict = {None: "", True: "  holds", False: "  DOES NOT HOLD"}[row["holds"]]
    print(f"{row['what']:<66}{row['value']:>12.4g} {row['unit']}{limit}{verdict}", flush=True)


def machine() -> str:
    """Day, processor, level of the loops, load, and versions, in a line."""
    from rastercov import engine

    lines = Path("/proc/cpuinfo").read_text().splitlines()
    models = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    load = " ".join(f"{value:.1f}" for value in os.getloadavg())
    versions = [f"Python {platform.python_version()}"]
    for name in ("rastercov", "numpy", "trimesh", "moderngl", "embreex", "open3d", "vtk"):
        try:
            versions.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            continue
    return (
        f"{datetime.now(UTC):%Y-%m-%d}; {next(models, platform.machine())}, "
        f"{len(os.sched_getaffinity(0))} cores, {platform.system()}, "
        f"code level {engine.LEVEL}, load {load}; {', '.join(versions)}"
    )


def resident_mib() -> float:
    """Memory that this process has now, MiB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


class _Parser(argparse.ArgumentParser):
    """Parser that sends all but the rows to standard error with --json."""

    rows_go_to: TextIO | None = None

    def parse_args(self, *args: Any, **options: Any) -> Any:
        """As of `ArgumentParser`."""
        result = super().parse_args(*args, **options)
        _Parser.rows_go_to = sys.stdout
        if result.json:
            sys.stdout = sys.stderr
        return result


def arguments(description: str) -> argparse.ArgumentParser:
    """Parser with the options that every benchmark has."""
    parser = _Parser(description=description)
    parser.add_argument("--json", action="store_true", help="print the rows as JSON")
    return parser


def seconds(work: Callable[[], object]) -> float:
    """CPU seconds of this thread that a call takes."""
    start = time.thread_time()
    work()
    return time.thread_time() - start
