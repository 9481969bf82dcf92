r"""Our figures against those of outside programs: areas, shares, images, pixels, kinematics.

Each `truth_*.py` beside this file names the programs that it compares with; `compared.py` has the
record of a comparison. A program runs if its package is installed; a missing one is named:

    python -m venv truth
    truth/bin/pip install rastercov pysovist phoebe mitsuba open3d embreex cadquery-ocp \
        ifcopenshell opencv-python-headless pycolmap yourdfpy pin coal
    truth/bin/python benchmarks/truth.py                        all, about 10^7 figures
    truth/bin/python benchmarks/truth.py --quick                a fiftieth of each
    truth/bin/python benchmarks/truth.py --only Mitsuba OpenCV

The exit code is 1 if a difference beyond both bounds has no explanation. `--page docs/truth.md`
writes the table into the page.
"""

import importlib
import sys
import time
from math import isnan
from pathlib import Path

from compared import Compared, Comparison
from pages_of_tables import earlier, write
from rows import Report, arguments

HERE = Path(__file__).parent
QUICK = 0.02
HEADER = [
    "| program | quantity | figures | largest difference | beyond both bounds |",
    "|---|---|---|---|---|",
]
PROGRAM = "benchmarks/truth.py"


def comparisons() -> list[Comparison]:
    """Those of all modules."""
    modules = sorted(path.stem for path in HERE.glob("truth_*.py"))
    return [each for name in modules for each in importlib.import_module(name).COMPARISONS]


def main() -> None:
    known = comparisons()
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", metavar="NAME", choices=[each.name for each in known])
    parser.add_argument("--quick", action="store_true", help="a fiftieth of each")
    parser.add_argument("--page", type=Path, help="rewrite the rows of these programs in this page")
    args = parser.parse_args()
    rows: dict[str, list[str]] = {}
    report, missing, figures = Report(), [], 0
    for each in known:
        if args.only and each.name not in args.only:
            continue
        program = each.version()
        if program is None:
            missing.append(f"{each.name} (pip install {each.package})")
            continue
        started = time.monotonic()
        rows[each.name] = []
        for compared in each.run(QUICK if args.quick else 1.0):
            rows[each.name].append(row(program, compared))
            figures += compared.figures
            what = f"{program}: {compared.quantity}"
            report.add(f"{what}: figures", compared.figures, "")
            if not isnan(compared.largest):
                report.add(f"{what}: largest difference", compared.largest, compared.unit)
            report.check(f"{what}: differences explained", compared.is_explained)
            for fault in compared.faults[:5]:
                print(f"{what}: {fault}", file=sys.stderr)
            print(rows[each.name][-1], flush=True)
        print(f"{program}: {time.monotonic() - started:.0f} s", file=sys.stderr, flush=True)
    print(f"{figures:,} figures; not installed: {', '.join(missing) or 'none'}")
    if args.page and not report.failed:
        write(args.page, PROGRAM, table(args.page, [each.name for each in known], rows))
    if not args.json:  # the table has them
        report.rows = []
    report.finish(args.json)


def table(page: Path, names: list[str], rows: dict[str, list[str]]) -> str:
    """Table of all programs: these rows, and those of the page for the other programs."""
    lines = []
    for name in names:
        lines += rows.get(name) or earlier(page, f"| {name} ")
    figures = sum(int(line.split("|")[3].replace(",", "")) for line in lines)
    return "\n".join([f"{figures:,} figures.", "", *HEADER, *lines])


def row(program: str, compared: Compared) -> str:
    """A line of the table."""
    beyond = [f"{count:,}: {reason}" for reason, count in compared.reasons.items()]
    unexplained = compared.beyond - sum(compared.reasons.values())
    beyond += [f"{unexplained:,}: **faults**"] if unexplained else []
    beyond = beyond or ["0"]
    beyond += [compared.note] if compared.note else []
    largest = f"{compared.largest:.2g} {compared.unit}".strip() if compared.largest else "0"
    largest = "–" if isnan(compared.largest) else largest
    cells = (program, compared.quantity, f"{compared.figures:,}", largest, "; ".join(beyond))
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    main()
