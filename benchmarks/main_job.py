"""Time of `evaluate`, with all figures and for a network only, to the time of `observe` alone.

Two meshes of 10,000 faces, seen by one camera of 1280 x 1024 pixels, method "certified". First the
figures of all poses are compared with their numpy twins; then each round times the three jobs, in
turn, each from an opened observer on. Printed are medians over the rounds of the ratios, by wall
clock and in CPU seconds of all threads: where other programs use the cores, only the CPU seconds
say what the criteria cost.
"""

import math
import statistics
import time

import numpy as np
from rows import Report, arguments

import rastercov as rc
from rastercov import shapes
from rastercov.coverage import FIGURES
from rastercov.network import Network
from rastercov.reference.coverage import figures_of_pose

CAMERA = rc.Camera(width=1280, height=1024, fx=1152, fy=1152)
TASK = rc.Task(min_pixels=4, max_incidence_deg=75)
ALL_FIGURES, NETWORK_ONLY = (1.8, 1.3), (1.25, 1.1)
"""Largest ratio, and the aim."""
TOLERANCE_REL = 1e-12
"""Of figures whose terms numpy adds in another order, and of its arccosine."""


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--poses", type=int, default=200)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--threads", type=int, default=2)
    args = parser.parse_args()
    report = Report()
    for name, mesh in (
        ("torus, 10,000 faces", shapes.torus()),
        ("aeroplane, 9,856 faces", shapes.aeroplane(9856)),
    ):
        size = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
        poses = rc.sphere_of_poses(mesh.bounds.mean(axis=0), 1.2 * size, args.poses)
        judged = rc.evaluate(mesh, CAMERA, poses, TASK, threads=args.threads)
        with rc.open_observer(mesh, CAMERA, threads=args.threads) as observer:
            same = is_same_as_twin(judged, poses, observer.observe(poses))
        report.check(f"{name}: figures of the twin", same)
        report.check(f"{name}: network of the figures", is_same_network(mesh, poses, judged))
        del judged
        rounds = [measured(mesh, poses, args.threads) for _ in range(args.rounds + 1)][1:]
        for kind, clock in enumerate(("wall", "CPU")):
            ratios = np.array([[job[kind] / jobs[0][kind] for job in jobs] for jobs in rounds])
            for what, column, (most, aim) in (
                ("all fields / observe", 1, ALL_FIGURES),
                ("network only / observe", 2, NETWORK_ONLY),
            ):
                value = statistics.median(ratios[:, column])
                report.add(f"{name}: {what}, {clock}", value, "", aim=aim, at_most=most)
            observed = statistics.median(jobs[0][kind] for jobs in rounds) / len(poses)
            report.add(f"{name}: observe, {clock}", 1e3 * observed, "ms a pose")
    report.finish(args.json)


def measured(mesh, poses, threads) -> list[tuple[float, float]]:
    """Wall and CPU seconds of the three jobs."""

    def observe() -> None:
        step = max(1, min(rc.coverage.POSES_A_BATCH, rc.coverage.PAIRS_A_BATCH // mesh.n_faces))
        with rc.open_observer(mesh, CAMERA, threads=threads) as observer:
            for start in range(0, len(poses), step):
                observer.observe(poses[start : start + step])

    def add_up() -> None:
        with rc.open_observer(mesh, CAMERA, threads=threads) as observer:
            Network(mesh, TASK).add_poses(observer, poses)

    jobs = (observe, lambda: rc.evaluate(mesh, CAMERA, poses, TASK, threads=threads), add_up)
    times = []
    for job in jobs:
        wall, cpu = time.perf_counter(), time.process_time()
        job()
        times.append((time.perf_counter() - wall, time.process_time() - cpu))
    return times


def is_same_as_twin(judged, poses, seen) -> bool:
    """True if the figures are those of the twin; angles at the limit may differ."""
    limit = math.radians(TASK.max_incidence_deg)
    for row, pose in enumerate(poses):
        expected = figures_of_pose(judged.mesh, CAMERA, TASK, pose, seen, row)
        sure = np.abs(expected["incidence"] - limit) > TOLERANCE_REL
        for name in FIGURES:
            one, other = getattr(judged, name)[row], expected[name]
            if name in ("coverage", "reason"):
                one, other = one[sure], other[sure]
            if not np.allclose(one, other, rtol=TOLERANCE_REL, atol=0):
                return False
    return True


def is_same_network(mesh, poses, judged) -> bool:
    """True if `add_poses` gives what adding the figures gives, bit for bit."""
    expected, found = Network(mesh, TASK), Network(mesh, TASK)
    expected.add(judged)
    with rc.open_observer(mesh, CAMERA) as observer:
        found.add_poses(observer, poses)
    same = [
        np.array_equal(getattr(found, name), getattr(expected, name))
        for name in ("views", "best", "best_pose", "reason", "covered_faces", "mean_coverage")
    ]
    return all(same) and found.summary() == expected.summary()


if __name__ == "__main__":
    main()
