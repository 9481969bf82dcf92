"""All that the documentation measures, one program after another: `make bench`.

Each prints into a file of --out, under a line about the machine, with its seconds and its peak of
memory below. Programs that time loops beside rays run once for each level of `LEVELS`. One that
fails does not stop the others. Figures are those of the documentation only where nothing else runs.
"""

import os
import subprocess
import sys
import time
from pathlib import Path

from rows import Report, arguments, machine

from rastercov import engine

HERE = Path(__file__).parent
LEVELS = ("v3", "v4")
CONTEST = "throughput.py --contestants cpu embree --parts contest"
PARTS = {
    "contest": CONTEST,
    "contest_of_meshes": f"{CONTEST} --meshes MESHES",
    "engine": "main_job_engine.py --meshes MESHES",
    "peers": "throughput.py --contestants cpu gl-pipeline open3d --parts contest",
    "costs": "throughput.py --parts drawn one start memory",
    "exactness": "exactness.py",
    "regions": "regions.py --points 40000 --meshes MESHES",
    "wide_lenses": "regions.py --points 40000 --wide",
    "lenses": "lenses.py",
    "cost": "cost.py --demo",
    "main_job": "main_job.py",
    "jobs_of_placement": "main_job_placement.py",
    "selection": "placement.py --only published",
    "cells": "placement.py --only cells",
    "large_selection": "large_selection.py --only generated",
    "rates": "large_selection.py --only rates",
    "viewer": "viewer.py",
    "motion": "motion.py",
    "light": "light.py",
    "robots": "arms.py",
    "truth": "truth.py",
    "sensors": "sensors.py --points 100000",
    "streaming": "streaming.py",
    "million": "million.py",
    "contexts": "contexts.py",
    "thesis": "thesis_table_4_2.py --bunnies MESHES",
}
BOTH_LEVELS = ("contest", "contest_of_meshes", "engine")


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--meshes", type=Path, metavar="DIR", help="mesh files to measure, too")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--out", type=Path, default=Path("build/bench"))
    args = parser.parse_args()
    if args.meshes is not None and not args.meshes.is_dir():
        parser.error(f"--meshes must be a folder with mesh files, got {args.meshes}")
    args.out.mkdir(parents=True, exist_ok=True)
    report = Report()
    for name in args.only:
        words = PARTS[name].split()
        if args.meshes is None and "MESHES" in words:
            if name == "contest_of_meshes":
                continue
            words = words[: words.index("MESHES") - 1]
        words = [str(args.meshes) if word == "MESHES" else word for word in words]
        for level in LEVELS if name in BOTH_LEVELS else [engine.LEVEL]:
            if level not in engine.runnable():
                continue
            ended = measured(args.out / f"{name}_{level}.txt", words, level)
            report.check(f"{name}, {level}: exit 0", ended)
    report.finish(args.json)


def measured(file: Path, words: list[str], level: str) -> bool:
    """Run one program into its file; whether it ended well."""
    command = [sys.executable, str(HERE / words[0]), *words[1:]]
    with file.open("w", encoding="utf-8") as out:
        print(f"benchmarks/{' '.join(words)}\n{machine()}", file=out, flush=True)
        began = time.monotonic()
        # Threads of numpy that wait for work would add to CPU times.
        chosen = os.environ | {"RASTERCOV_LEVEL": level, "OPENBLAS_NUM_THREADS": "1"}
        ran = subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT, env=chosen)
        _, status, usage = os.wait4(ran.pid, 0)
        ran.returncode = os.waitstatus_to_exitcode(status)
        last = f"{time.monotonic() - began:.0f} s, peak {usage.ru_maxrss / 1024:.0f} MiB"
        print(f"exit {ran.returncode}, {last}", file=out)
    print(f"{file}: exit {ran.returncode}, {last}", flush=True)
    return ran.returncode == 0


if __name__ == "__main__":
    main()
