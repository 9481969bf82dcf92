"""The form every benchmark reports in: rows of what, value, unit, must, aim, holds."""

import argparse
import json
import platform
import sys
from dataclasses import asdict, dataclass, field


@dataclass
class Report:
    """Rows of one benchmark, and the correctness checks that failed."""

    rows: list[dict[str, object]] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)

    def add(
        self,
        what: str,
        value: float,
        unit: str,
        must: float | None = None,
        aim: float | None = None,
        *,
        at_most: bool = False,
    ) -> None:
        """One figure; `must` and `aim` are lower limits, or upper ones with `at_most`."""
        holds = None if must is None else bool(value <= must if at_most else value >= must)
        self.rows.append(asdict(_Row(what, value, unit, must, aim, holds)))

    def check(self, what: str, passed: bool) -> None:
        """A correctness check: one that fails makes the benchmark exit with 1."""
        self.add(what, float(passed), "passed", must=1.0)
        if not passed:
            self.failed.append(what)

    def finish(self, as_json: bool) -> None:
        """Print everything and leave with 1 when a correctness check failed."""
        if as_json:
            print(json.dumps(self.rows, indent=2))
        else:
            print(
                f"{platform.processor() or platform.machine()}, Python {platform.python_version()}"
            )
            for row in self.rows:
                limit = "" if row["must"] is None else f"   must {row['must']:g}"
                verdict = {None: "", True: "  holds", False: "  DOES NOT HOLD"}[row["holds"]]
                print(f"{row['what']:<66}{row['value']:>12.4g} {row['unit']}{limit}{verdict}")
        for what in self.failed:
            print(f"error: {what}: wrong", file=sys.stderr)
        sys.exit(1 if self.failed else 0)


@dataclass(frozen=True)
class _Row:
    what: str
    value: float
    unit: str
    must: float | None
    aim: float | None
    holds: bool | None


def arguments(description: str) -> argparse.ArgumentParser:
    """Parser with the options that every benchmark has."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--json", action="store_true", help="print the rows as JSON")
    return parser
