"""Shards made by workers against this process: same bytes, CPU a pose, overhead a task, kills.

    python benchmarks/cluster.py                    # a torus of 9,800 faces, 400 poses, 20 shards
    python benchmarks/cluster.py --kills 20

Workers, schedulers and heads are killed with SIGKILL in the middle of a run; each run must end
complete, with the same bytes and at most one shard made twice.
"""

import argparse
import contextlib
import hashlib
import os
import random
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil
from rows import SUPPORT, Report, arguments

import rastercov as rc
from rastercov.core.mesh import shapes
from rastercov.placement.matrix import build_matrix
from rastercov.shards import Made, Workers, make_shards

POSES, A_SHARD, WORKERS = 400, 20, 2
TASKS = 400
"""Empty tasks of the overhead."""
MESH = shapes.torus(140, 35)
CAMERA = rc.Camera.preset("khepra")


def poses() -> np.ndarray:
    return rc.sphere_of_poses(MESH.bounds.mean(axis=0), 1.6 * float(np.ptp(MESH.bounds)), POSES)


def sums(folder: Path) -> dict[str, str]:
    shards = sorted((folder / "pairs").glob("*.npz"))
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in shards}


def build(folder: Path, workers: Workers | None, **options: object) -> None:
    # As many threads as workers: two that compute at a time take more CPU time each than one.
    with rc.open_observer(MESH, CAMERA, threads=WORKERS) as observer:
        build_matrix(observer, poses(), None, folder, poses_a_shard=A_SHARD, workers=workers,
                     note=lambda line: None, **options)  # fmt: skip


def cpu_of_children() -> float:
    """CPU seconds of this process and those it has started."""
    total = 0.0
    for process in [psutil.Process(), *psutil.Process().children(recursive=True)]:
        with contextlib.suppress(psutil.Error):
            times = process.cpu_times()
            total += times.user + times.system
    return total


def empty_task(folder: Path) -> float:
    """CPU milliseconds of head and workers for a task that does nothing."""
    import cluster_job

    job = cluster_job.prepared(folder, TASKS, poses=1)
    first, done, at = TASKS // 10, 0, {}  # starting the workers is not counted

    def count(made: Made) -> None:
        nonlocal done
        if done in (first, TASKS - 1):
            at[done] = cpu_of_children()
        done += 1

    make_shards(Workers(WORKERS), job, count, print)
    return 1e3 * (at[TASKS - 1] - at[first]) / (TASKS - 1 - first)


class Program:
    """A program of Dask, which ends with all processes that it starts."""

    def __init__(self, *words: str) -> None:
        quiet = {"DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "0"}
        path = os.pathsep.join([str(SUPPORT.parents[1]), str(SUPPORT)])
        self.process = subprocess.Popen(
            [sys.executable, "-m", "dask", *words], stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL, start_new_session=True,
            env=os.environ | quiet | {"PYTHONPATH": path},
        )  # fmt: skip

    def kill(self) -> None:
        """End it by SIGKILL."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()


def with_killed_worker(folder: Path, rng: random.Random) -> int:
    """A run one of whose workers is killed; shards that were made more than once."""
    numbers: list[int] = []
    when = rng.randrange(1, POSES // A_SHARD - 2)

    def watch(made: Made) -> None:
        numbers.append(made.number)
        if len(numbers) == when:
            os.kill(int(made.worker.rpartition(":")[2]), signal.SIGKILL)

    build(folder, Workers(WORKERS), watch=watch)
    return len(numbers) - len(set(numbers))


def with_killed_scheduler(folder: Path, rng: random.Random, port: int) -> int:
    """A run whose scheduler is killed, with its workers, and another one started."""

    def start() -> list[Program]:
        address = f"tcp://127.0.0.1:{port}"
        options = ["--host", "127.0.0.1", "--no-dashboard"]
        worker = ["worker", address, *options, "--nthreads", "1", "--memory-limit", "0",
                  "--local-directory", tempfile.mkdtemp(dir=folder.parent)]  # fmt: skip
        programs = [Program("scheduler", *options, "--port", str(port), "--no-show")]
        return programs + [Program(*worker) for _ in range(WORKERS)]

    programs = start()
    numbers: list[int] = []
    when = rng.randrange(1, POSES // A_SHARD - 2)

    def watch(made: Made) -> None:
        nonlocal programs
        numbers.append(made.number)
        if len(numbers) == when:
            for program in programs:
                program.kill()
            programs = start()

    try:
        build(folder, Workers(scheduler=f"tcp://127.0.0.1:{port}"), watch=watch)
    finally:
        for program in programs:
            program.kill()
    return len(numbers) - len(set(numbers))


def with_killed_head(folder: Path, rng: random.Random) -> int:
    """A run that is killed and started again; shards that the second one made twice."""
    head = subprocess.Popen([sys.executable, __file__, "--head", str(folder)])
    wanted = rng.randrange(1, POSES // A_SHARD - 2)
    while len(sums(folder)) < wanted and head.poll() is None:
        time.sleep(0.02)
    head.kill()
    head.wait()
    time.sleep(0.5)  # its workers end with it
    times = {path: path.stat().st_mtime_ns for path in (folder / "pairs").glob("*.npz")}
    build(folder, Workers(WORKERS))
    return sum(path.stat().st_mtime_ns != before for path, before in times.items())


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=4, help="workers killed; half as many others")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--head", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.head:
        build(args.head, Workers(WORKERS))
        return
    report, rng = Report(), random.Random(args.seed)
    with tempfile.TemporaryDirectory() as name:
        base = Path(name)
        build(base / "warm", None)
        plain, inside = [], []
        for turn in range(3):
            before = time.process_time()
            build(base / f"plain{turn}", None)
            plain.append(time.process_time() - before)
            made: list = []
            build(base / f"workers{turn}", Workers(WORKERS), watch=made.append)
            # The first shard of a worker opens the scene, once for any number of shards.
            seen: set[str] = set()
            rest = [each for each in made if each.worker in seen or seen.add(each.worker)]
            cpu = sum(each.cpu_seconds for each in rest)
            inside.append(cpu / sum(each.n_poses for each in rest))
            same = sums(base / f"plain{turn}") == sums(base / f"workers{turn}")
            report.check(f"run {turn}: shards of workers have the same bytes", same)
        ratio = statistics.median(inside) / (statistics.median(plain) / POSES)
        report.add("CPU of a pose in a worker / in one process", ratio, "x", at_most=1.15)
        report.add("CPU of an empty task, head and workers", empty_task(base / "empty"), "ms",
                   at_most=5)  # fmt: skip
        truth = sums(base / "plain0")
        for what, count, run in (
            ("worker", args.kills, with_killed_worker),
            ("scheduler", args.kills // 2, lambda f, r: with_killed_scheduler(f, r, 28786)),
            ("head", args.kills // 2, with_killed_head),
        ):
            twice = 0
            for turn in range(count):
                folder = base / f"{what}-{turn}"
                twice = max(twice, run(folder, rng))
                report.check(
                    f"{what} {turn} killed: complete, the same bytes", sums(folder) == truth
                )
            report.add(
                f"shards made twice, {what} killed {count} times", twice, "shards", at_most=1
            )
    report.finish(args.json)


if __name__ == "__main__":
    main()
