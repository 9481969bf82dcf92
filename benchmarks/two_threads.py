"""Rate of two threads, as a part of what two processes of one thread each reach side by side.

Each round times all three in turn: certified visibility of a batch of poses by one observer of one
thread, by one of two, and by two processes that begin together. The part of a cell is the time of
the two processes for a batch each, halved, by the time of two threads for one batch, in medians
over the rounds. Areas must be the same bits whatever the number of threads.
"""

import statistics
import sys
import time
from multiprocessing import get_context
from multiprocessing.connection import Connection

import numpy as np
from rows import Report, arguments

import rastercov as rc
from rastercov.core.mesh import shapes

MATRIX = ((1536, 0, 640), (0, 1536, 512), (0, 0, 1))
SCENES = {
    "torus, 1,024 faces": (32, 16, 1600, False, 0.85),
    "torus, 10,000 faces": (100, 50, 400, False, 0.95),
    "torus, 99,856 faces": (316, 158, 48, False, 0.95),
    "torus, 10,000 faces, fisheye": (100, 50, 64, True, 0.92),
}
"""Segments of the ring and of its section, poses of a batch, fisheye or pinhole, least part."""


def scene(name: str) -> tuple[rc.Mesh, rc.Camera, rc.Poses]:
    """Mesh, camera and poses of a cell."""
    ring, section, n, fisheye, _ = SCENES[name]
    lens = (0.03, -0.012, 0.004, -0.001) if fisheye else ()
    camera = rc.Camera.from_opencv(MATRIX, 1280, 1024, lens, fisheye=fisheye)
    return shapes.torus(ring, section), camera, rc.Poses.of(rc.sphere_of_poses((0, 0, 0), 4.2, n))


def serve(name: str, own: Connection) -> None:
    """Observe the batch of a cell once for each message, and send when it began and ended."""
    mesh, camera, poses = scene(name)
    with rc.open_observer(mesh, camera, threads=1) as observer:
        observer.observe(poses)
        own.send(None)
        while own.recv():
            began = time.perf_counter()
            observer.observe(poses)
            own.send((began, time.perf_counter()))


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=9)
    args = parser.parse_args()
    report = Report(prints=not args.json)
    for name, (*_, least) in SCENES.items():
        measure(report, name, least, args.rounds)
    report.finish(args.json)


def measure(report: Report, name: str, least: float, n_rounds: int) -> None:
    """Add the rows of one cell."""
    mesh, camera, poses = scene(name)
    start = get_context("spawn")
    pipes = [start.Pipe() for _ in range(2)]
    processes = [start.Process(target=serve, args=(name, theirs)) for _, theirs in pipes]
    for process in processes:
        process.start()
    for ours, _ in pipes:
        ours.recv()
    times: dict[str, list[float]] = {"one thread": [], "two threads": [], "two processes": []}
    with (
        rc.open_observer(mesh, camera, threads=1) as one,
        rc.open_observer(mesh, camera, threads=2) as two,
    ):
        items = [each.observe(poses).visible_pixels for each in (one, two)]
        report.check(f"{name}: the same bits", bool((items[0] == items[1]).all()))
        for at in range(n_rounds):
            for label, observer in (("one thread", one), ("two threads", two)):
                began = time.perf_counter()
                observer.observe(poses)
                times[label].append(time.perf_counter() - began)
            for ours, _ in pipes:
                ours.send(True)
            spans = np.array([ours.recv() for ours, _ in pipes])
            times["two processes"].append(float(np.ptp(spans, axis=1).mean()) / 2)
            print(f"{name}: round {at + 1} of {n_rounds}", file=sys.stderr, flush=True)
    for ours, _ in pipes:
        ours.send(False)
    for process in processes:
        process.join()
    medians = {label: statistics.median(own) for label, own in times.items()}
    parts = [p / t for p, t in zip(times["two processes"], times["two threads"], strict=True)]
    for label, seconds in medians.items():
        report.add(f"{name}: {label}", 1e3 * seconds / len(poses), "ms a pose")
    report.add(f"{name}: part", statistics.median(parts), "", must=least)


if __name__ == "__main__":
    main()
