"""Costs without a peer: `drawn` of the CPU rasteriser, one pose of `evaluate`, starts, memory."""

import statistics
import subprocess
import sys
import time
import tracemalloc
from functools import partial

import numpy as np
from contest import Cell

import rastercov as rc
from rastercov.core.coverage.coverage import FIGURES, evaluate_batches

MOST_ADDED = 40.0
MOST_SECONDS = 1.5
MOST_TIMES = {"face": 1.5, "area": 3.0}
"""Time of `evaluate` of one pose over that of `observe`."""
ROUNDS = 7
FIRST_RESULT = """
import rastercov as rc
from rastercov import shapes
mesh, camera = shapes.torus(), rc.Camera(width=1280, height=1024, fx=1200, fy=1200)
poses = rc.sphere_of_poses((0, 0, 0), 4.2, 1)
"""
STARTS = {
    "counts": "rc.open_rasterizer(mesh, camera, 'cpu').count(poses)",
    "certified visibility": "rc.evaluate(mesh, camera, poses, fields=['visibility'], by='face')",
}


def cost_of_drawn(report) -> None:
    """Time of a pose with `drawn` over its time without, in one thread."""
    for scene, n in (("closed", 10_000), ("closed", 100_000), ("closed", 1_000_000),
                     ("open", 10_000), ("interior", 15_000)):  # fmt: skip
        for width, height in ((1280, 1024), (256, 256)):
            cell = Cell(scene, n, width, height)
            mesh = cell.mesh()
            poses = cell.poses(mesh, max(4, min(64, 2_000_000 // n)))
            with rc.open_rasterizer(mesh, cell.camera, "cpu", threads=1) as rasterizer:
                added = []
                for _ in range(ROUNDS + 1):
                    times = []
                    for drawn in (False, True):
                        started = time.process_time()
                        rasterizer.count(poses, drawn=drawn)
                        times.append(time.process_time() - started)
                    added.append(100 * (times[1] / times[0] - 1))
            what = f"{scene}, {mesh.n_faces:,} faces, {width} x {height}"
            report.add(
                f"{what}: drawn adds to a pose",
                statistics.median(added[1:]),
                "%",
                at_most=MOST_ADDED,
            )


def cost_of_one_pose(report) -> None:
    """Time of `evaluate` of one pose over that of `observe`, in one thread, all fields asked for.

    Figures are first read, and compared with those that are computed at once.
    """
    for n in (1_000, 10_000):
        cell = Cell("closed", n, 1280, 1024)
        mesh, engine = cell.mesh(), rc.Engine("certified", threads=1)
        poses = cell.poses(mesh, 1)
        how = partial(rc.evaluate, mesh, cell.camera, poses, method=engine)
        with rc.open_observer(mesh, cell.camera, engine) as observer:
            ways = {"observe": partial(observer.observe, poses)}
            ways |= {by: partial(how, by=by) for by in MOST_TIMES}
            (expected,) = evaluate_batches(observer, poses)
            for by in MOST_TIMES:
                pairs = ((getattr(ways[by](), each), getattr(expected, each)) for each in FIGURES)
                is_same = all(one.tobytes() == other.tobytes() for one, other in pairs)
                report.check(
                    f"{mesh.n_faces:,} faces, by {by}: figures as if computed at once", is_same
                )
            times = {name: [] for name in ways}
            for _ in range(ROUNDS + 1):
                for name, way in ways.items():
                    started = time.process_time()
                    for _ in range(20):
                        way()
                    times[name].append((time.process_time() - started) / 20)
        for by, most in MOST_TIMES.items():
            ratio = np.median(np.divide(times[by], times["observe"])[1:])
            what = f"{mesh.n_faces:,} faces: evaluate of a pose by {by}, over observe"
            report.add(what, float(ratio), "times", at_most=most)


def later_starts(report) -> None:
    """Seconds from the start of Python to a first result."""
    for what, line in STARTS.items():
        command = [sys.executable, "-c", FIRST_RESULT + line]
        times = []
        for _ in range(5 + 1):
            started = time.perf_counter()
            subprocess.run(command, check=True, stderr=subprocess.DEVNULL)
            times.append(time.perf_counter() - started)
        report.add(
            f"a start, import to first {what}",
            statistics.median(times[1:]),
            "s",
            at_most=MOST_SECONDS,
        )


def memory_of_workers(report) -> None:
    """Memory of counting 10^6 faces: what numpy allocates over the mesh and its own arrays."""
    cell = Cell("closed", 1_000_000, 1280, 1024)
    mesh = cell.mesh()
    poses = cell.poses(mesh, 3)
    arrays = (mesh.vertices.nbytes + mesh.faces.nbytes) / 2**20
    image = cell.width * cell.height * 8 / 2**20
    limit = 3 * arrays + image
    small = Cell("closed", 1000, 128, 128)
    with rc.open_rasterizer(small.mesh(), small.camera, "cpu") as rasterizer:
        rasterizer.count(poses[:1])  # loads the loops, whatever the mesh
    tracemalloc.start()
    counting = {}
    for threads in (1, 3):
        with rc.open_rasterizer(mesh, cell.camera, "cpu", threads=threads) as rasterizer:
            if threads == 1:
                held, opening = (size / 2**20 for size in tracemalloc.get_traced_memory())
            tracemalloc.reset_peak()
            before = tracemalloc.get_traced_memory()[0]
            rasterizer.count(poses[:threads], drawn=False)
            counting[threads] = (tracemalloc.get_traced_memory()[1] - before) / 2**20
    tracemalloc.stop()
    what = "10^6 faces"
    report.add(f"{what}: the mesh's own arrays", arrays, "MiB")
    report.add(f"{what}: one image, face and depth", image, "MiB")
    report.add(f"{what}: counts of a pose", 8 * mesh.n_faces / 2**20, "MiB")
    report.add(f"{what}: one worker while it counts a pose", counting[1], "MiB", at_most=limit)
    each = (counting[3] - counting[1]) / 2
    report.add(f"{what}: each worker more", each, "MiB", at_most=limit)
    report.add(f"{what}: held once for all workers", held, "MiB")
    report.add(f"{what}: peak while it opens, once a mesh", opening, "MiB", at_most=limit)
    most = max(opening, held + counting[1])
    report.add(f"{what}: peak of all, one worker", most, "MiB", at_most=limit)
