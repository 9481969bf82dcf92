"""Speed of the main job: judging beside observing, and whole reports beside either.

First, `evaluate` with all figures and for a network only, to the time of `observe` alone: two
meshes of 10,000 faces, seen by one camera of 1280 x 1024 pixels, method "certified". Then reports
of an aeroplane by the khepra camera, as `rastercov evaluate` writes them, pictures left out: to the
rate of `observe`, and with method "sampled" to that of counting. At these distances all faces are
beyond the camera's depth of field, so its table of covered pairs would be empty; the rows are those
of the same camera in focus, except for one of the camera as it is. By area, as reports are unless
asked otherwise, a table has the covered area of every pair, which the sums do not need. `--meshes
DIR` adds reports of the mesh files of a folder. Then method "sampled" on images of 256 x 256: bits
of the covered pairs alone, and all figures, to the time of counting.

Before anything is timed, figures are compared with their numpy twins, and reports with figures.
Each round times the jobs in turn, each from an opened observer on. Printed are medians over the
rounds of ratios and rates, by wall clock and in CPU seconds of all threads: where other programs
use the cores, only the CPU seconds say what a job costs. Each row is printed as it is made. By
default all of it takes about 105 CPU-s, two to three minutes; `--report-poses 2000 --rounds 9`
takes three times as long and varies less.
"""

import math
import statistics
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from rows import Report, arguments

import rastercov as rc
from rastercov.base.threads import thread_count
from rastercov.cli import inputs
from rastercov.core.coverage.coverage import FIGURES, ROLL, batch_size
from rastercov.core.coverage.network import Network
from rastercov.core.mesh import shapes
from rastercov.formats.meshes import READERS
from rastercov.reference.coverage import figures_of_pose, rows_of
from rastercov.report.coverage import Options, run

CAMERA = rc.Camera(width=1280, height=1024, fx=1152, fy=1152)
SMALL = rc.Camera(width=256, height=256, fx=230, fy=230)
TASK = rc.Task(min_pixels=4, max_incidence_deg=75)
ALL_FIGURES, NETWORK_ONLY = (1.8, 1.3), (1.25, 1.1)
BITS_ALONE, SAMPLED_FIGURES = (1.25, 1.1), (2.0, 1.5)
"""Largest ratio, and the aim."""
REPORT_ONLY, SAMPLED_REPORT, REPORTS_PER_SECOND = (0.7, 0.9), (0.5, 0.8), (350, 500)
"""Least rate of reports without a table to `observe`, and to counting; poses per second with the
covered pairs. And the aims."""
BY_AREA = (
    *("covered_area", "covered_of_seeable_percent"),
    *("not_covered_because", "seeable_not_covered_because"),
)
"""Figures of a summary that the exact areas of a report replace."""
TOLERANCE_REL = 1e-12
"""Of figures whose terms numpy adds in another order, and of its arccosine."""


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--poses", type=int, default=200)
    parser.add_argument("--report-poses", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--meshes", type=Path, metavar="DIR", help="report on these mesh files too")
    args = parser.parse_args()
    report = Report(prints=not args.json)
    for name, mesh in (
        ("torus, 10,000 faces", shapes.torus()),
        ("aeroplane, 9,856 faces", shapes.aeroplane(9856)),
    ):
        size = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
        poses = rc.sphere_of_poses(mesh.bounds.mean(axis=0), 1.2 * size, args.poses)
        compare_judging(report, name, mesh, rc.Poses.of(poses), args.rounds, args.threads)
        many = rc.sphere_of_poses(mesh.bounds.mean(axis=0), 1.2 * size, args.report_poses)
        compare_sampled(report, name, mesh, rc.Poses.of(many), args.rounds, args.threads)
    khepra = rc.Camera.preset("khepra")
    in_focus = replace(khepra, focus_range=None)
    aeroplane = shapes.aeroplane(9856)
    compare_reports(report, "aeroplane", aeroplane, in_focus, args.report_poses, args.rounds)
    poses = poses_around(aeroplane, khepra, args.report_poses)
    rate = statistics.median(
        args.report_poses / rounds[0][0]
        for rounds in timed([partial(write, aeroplane, khepra, poses, Options(pictures=0))], 3)
    )
    report.add("aeroplane, out of focus: default report", rate, "poses/s")
    for path in sorted(args.meshes.iterdir()) if args.meshes else ():
        if path.suffix.lower() in READERS:
            mesh = rc.Mesh.load(path)
            compare_reports(report, path.name, mesh, in_focus, args.poses, args.rounds)
    report.finish(args.json)


def compare_judging(report: Report, name, mesh, poses: rc.Poses, n_rounds: int, threads: int):
    """Rows of `evaluate` and of a network, to the time of `observe` alone."""
    engine = rc.Engine(threads=threads)
    judged = rc.evaluate(mesh, CAMERA, poses, TASK, method=engine, by="face")
    with rc.open_observer(mesh, CAMERA, threads=threads) as observer:
        same = is_same_as_twin(judged, poses, observer.observe(poses))
    report.check(f"{name}: figures of the twin", same)
    report.check(f"{name}: network of the figures", is_same_network(mesh, poses, judged))
    del judged

    def add_up() -> None:
        with rc.open_observer(mesh, CAMERA, threads=threads) as observer:
            network = Network(mesh, TASK)
            for batch in network.judge(observer, rc.Poses.of(poses)):
                network.add(batch)

    rounds = timed(
        [
            partial(observe, mesh, CAMERA, poses, threads),
            partial(rc.evaluate, mesh, CAMERA, poses, TASK, method=engine, by="face"),
            add_up,
        ],
        n_rounds,
    )
    for kind, clock in enumerate(("wall", "CPU")):
        for what, job, (most, aim) in (
            ("all fields / observe", 1, ALL_FIGURES),
            ("network only / observe", 2, NETWORK_ONLY),
        ):
            value = statistics.median(times[job][kind] / times[0][kind] for times in rounds)
            report.add(f"{name}: {what}, {clock}", value, "", aim=aim, at_most=most)
        observed = statistics.median(times[0][kind] for times in rounds) / len(poses)
        report.add(f"{name}: observe, {clock}", 1e3 * observed, "ms a pose")


def compare_sampled(report: Report, name, mesh, poses: rc.Poses, n_rounds: int, threads: int):
    """Rows of `evaluate` by samples on small images, to the time of counting alone."""
    engine, run = rc.Engine("sampled", "cpu", threads=threads), (mesh, SMALL, poses, rc.Task())
    both = rc.evaluate(*run, method=engine, fields=("reason", "covered"))
    bits = rc.evaluate(*run, method=engine, fields=("covered",)).bits
    same = np.array_equal(bits.dense(), both.reason == rc.Reason.COVERED)
    report.check(f"{name}: bits of the reasons", same)
    rounds = timed(
        [
            partial(count, mesh, SMALL, poses, threads),
            partial(rc.evaluate, *run, method=engine, fields=("covered",)),
            partial(rc.evaluate, *run, method=engine),
        ],
        n_rounds,
    )
    for kind, clock in enumerate(("wall", "CPU")):
        for what, job, (most, aim) in (
            ("256 x 256: bits / count", 1, BITS_ALONE),
            ("256 x 256: all fields / count", 2, SAMPLED_FIGURES),
        ):
            value = statistics.median(times[job][kind] / times[0][kind] for times in rounds)
            report.add(f"{name}, {what}, {clock}", value, "", aim=aim, at_most=most)
        counted = statistics.median(times[0][kind] for times in rounds) / len(poses)
        report.add(f"{name}, 256 x 256: count, {clock}", 1e3 * counted, "ms a pose")


def compare_reports(report: Report, name, mesh, camera, n_poses: int, n_rounds: int) -> None:
    """Rows of whole reports, to the rates of observing and of counting; a thread for each core."""
    poses = poses_around(mesh, camera, n_poses)
    for method in ("certified", "sampled"):
        report.check(
            f"{name}: {method} figures of the twin, report of the figures",
            is_same_report(mesh, camera, poses[: min(n_poses, 40)], method),
        )
    plain = Options(pictures=0, table="none")
    jobs = {
        "observe": partial(observe, mesh, camera, poses),
        "count": partial(count, mesh, camera, poses),
        "none": partial(write, mesh, camera, poses, plain),
        "covered": partial(write, mesh, camera, poses, replace(plain, table="covered")),
        "covered, by face": partial(
            write, mesh, camera, poses, replace(plain, table="covered", by="face")
        ),
        "seen": partial(write, mesh, camera, poses, replace(plain, table="seen")),
        "sampled": partial(write, mesh, camera, poses, replace(plain, method="sampled")),
    }
    rounds = [dict(zip(jobs, times, strict=True)) for times in timed(list(jobs.values()), n_rounds)]
    for kind, clock in enumerate(("wall", "CPU")):
        for what, of, to, limits in (
            ("table none, rate / observe", "none", "observe", REPORT_ONLY),
            ("sampled, table none, rate / count", "sampled", "count", SAMPLED_REPORT),
        ):
            value = statistics.median(times[to][kind] / times[of][kind] for times in rounds)
            report.add(f"{name}: {what}, {clock}", value, "", *limits)
        for job in jobs:
            seconds = statistics.median(times[job][kind] for times in rounds)
            if clock == "CPU":
                report.add(f"{name}: {job}, CPU", 1e3 * seconds / n_poses, "ms a pose")
            else:
                limits = REPORTS_PER_SECOND if job.startswith("covered") else ()
                report.add(f"{name}: {job}", n_poses / seconds, "poses/s", *limits)


def poses_around(mesh, camera, n_poses: int) -> rc.Poses:
    """Poses of `--poses sphere:N`."""
    return rc.Poses.of(inputs.poses_around(f"sphere:{n_poses}", mesh, camera))


def timed(jobs: Sequence[Callable[[], object]], n_rounds: int) -> list[list[tuple[float, float]]]:
    """Wall and CPU seconds of each job, in each round; a first round warms up and is left out."""
    rounds = []
    for _ in range(n_rounds + 1):
        times = []
        for job in jobs:
            wall, cpu = time.perf_counter(), time.process_time()
            job()
            times.append((time.perf_counter() - wall, time.process_time() - cpu))
        rounds.append(times)
    return rounds[1:]


def observe(mesh, camera, poses: rc.Poses, threads: int | None = None) -> None:
    """Observe all poses, in the batches of `evaluate`."""
    with rc.open_observer(mesh, camera, threads=threads) as observer:
        step = batch_size(mesh.n_faces, thread_count(threads))
        for start in range(0, len(poses), step):
            observer.observe(poses[start : start + step])


def count(mesh, camera, poses: rc.Poses, threads: int | None = None) -> None:
    """Count visible and drawn samples of all poses, on the rolled grid of method "sampled"."""
    step = batch_size(mesh.n_faces, thread_count(threads))
    with rc.open_rasterizer(mesh, camera, "cpu", roll=ROLL, threads=threads) as rasterizer:
        for start in range(0, len(poses), step):
            rasterizer.count(poses[start : start + step])


def write(mesh, camera, poses: rc.Poses, options: Options) -> None:
    """Write a whole report, flushed to the disk."""
    with tempfile.TemporaryDirectory() as folder:
        run(mesh, camera, poses, rc.Task(), Path(folder), options)


def is_same_report(mesh, camera, poses: rc.Poses, method: str) -> bool:
    """True if figures are those of the twin, and summary and table those of the figures."""
    task, network = rc.Task(), Network(mesh, rc.Task())
    judged = rc.evaluate(mesh, camera, poses, task, method=method, by="face")
    network.add(judged)
    with rc.open_observer(mesh, camera, method) as observer:
        if not is_same_as_twin(judged, poses, observer.observe(poses)):
            return False
    rows = rows_of(judged, "covered")
    with tempfile.TemporaryDirectory() as folder:
        options = Options(pictures=0, table="covered", method=method)
        summary = run(mesh, camera, poses, task, Path(folder), options)
        table = pq.read_table(Path(folder) / "coverage.parquet")
    names = [name for name in rows if name not in ("reason", "visibility_kind")]
    return all(np.array_equal(table[name], rows[name]) for name in names) and all(
        _by_face(summary[name]) == _by_face(value)
        for name, value in network.summary().items()
        if name not in BY_AREA
    )


def _by_face(figure: object) -> object:
    """Figure of a summary without those by area of its groups, which a network has not."""
    if isinstance(figure, list):
        return [_by_face(each) for each in figure]
    if isinstance(figure, dict):
        return {name: value for name, value in figure.items() if name not in BY_AREA}
    return figure


def is_same_as_twin(judged, poses, seen) -> bool:
    """True if the figures are those of the twin; angles at the limit may differ."""
    limit = math.radians(judged.task.max_incidence_deg)
    for row, pose in enumerate(poses.world_from_camera):
        expected = figures_of_pose(judged.mesh, judged.camera, judged.task, pose, seen, row)
        sure = np.abs(expected["incidence"] - limit) > TOLERANCE_REL
        for name in FIGURES:
            one, other = getattr(judged, name)[row], expected[name]
            if name in ("coverage", "reason"):
                one, other = one[sure], other[sure]
            if not np.allclose(one, other, rtol=TOLERANCE_REL, atol=0):
                return False
    return True


def is_same_network(mesh, poses, judged) -> bool:
    """True if `judge` gives what adding the figures gives, bit for bit."""
    expected, network = Network(mesh, TASK), Network(mesh, TASK)
    expected.add(judged)
    with rc.open_observer(mesh, CAMERA) as observer:
        for batch in network.judge(observer, rc.Poses.of(poses)):
            network.add(batch)
    same = [
        np.array_equal(getattr(network, name), getattr(expected, name))
        for name in ("views", "best", "best_pose", "reason", "covered_faces", "mean_coverage")
    ]
    return all(same) and network.summary() == expected.summary()


if __name__ == "__main__":
    main()
