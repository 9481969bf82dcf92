"""Attacks on rastercov: hostile scenes, files, threads and disks; nothing may be silently wrong.

Each `attack_*.py` beside this file is one campaign with fixed seeds. A figure without a bound that
holds, a foreign exception, a crash or a damaged result that is believed makes the exit code 1.

    python benchmarks/attack.py                      all campaigns, in full: an hour or more
    python benchmarks/attack.py --effort 0.05        a twentieth of each
    python benchmarks/attack.py exact threads        these two
"""

import importlib
import sys
import time
from pathlib import Path

from rows import Report, arguments

CAMPAIGNS = sorted(path.stem[7:] for path in Path(__file__).parent.glob("attack_*.py"))


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("campaign", nargs="*", help=f"of {', '.join(CAMPAIGNS)}; all by default")
    parser.add_argument("--effort", type=float, default=1.0, help="part of each campaign, > 0")
    args = parser.parse_args()
    unknown = set(args.campaign) - set(CAMPAIGNS)
    if unknown or not args.effort > 0:
        parser.error(f"campaigns are {', '.join(CAMPAIGNS)}, effort is greater than 0")
    report = Report()
    for name in args.campaign or CAMPAIGNS:
        started = time.perf_counter()
        importlib.import_module(f"attack_{name}").attack(report, args.effort)
        report.add(f"{name}: time", time.perf_counter() - started, "s")
        print(f"{name}: done", file=sys.stderr, flush=True)
    report.finish(args.json)


if __name__ == "__main__":
    main()
