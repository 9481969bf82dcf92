"""Speed of the engine on the meshes people have, beside packets of rays by Embree.

Certified visibility and counts of the CPU rasteriser, two threads each, to packets of 16 coherent
rays from compiled loops (`embree_packets`), two threads as well, from the same poses at the same
image size: tori of 10^4 to 10^6 faces, and with `--meshes DIR` the mesh files of a folder. And the
CPU time of one certified pose, in one thread.

Before anything is timed, certified areas are compared with those of half planes, and the image of
the rasteriser with that of the rays. Each round times all three in turn. Printed are medians over
the rounds of times and of ratios.
"""

import statistics
import time
from pathlib import Path

import numpy as np
from contest import Cell
from embree_packets import EmbreePackets
from rows import Report, arguments

import rastercov as rc
from rastercov.core.coverage.coverage import batch_size
from rastercov.formats.meshes import READERS

TORI = (10_000, 100_000, 1_000_000)
CPU_MS = {
    "featuretype": (8, 4),
    "ADIS16480": (9, 5),
    "stanford-bunny": (20, 10),
    "warehouse": (25, 12),
    "torus, 1,000,000 faces": (20, 10),
}
"""CPU time of a certified pose at most, and the aim, milliseconds."""
RATIOS = {"counts": (4, 8), "certified": (1, 2)}
CERTIFIED_WAREHOUSE = (0.7, 1.4)
"""Least ratio to Embree packets, and the aim."""
LEAST_ALIKE = 0.98
"""Share of pixels with the same face: coincident surfaces and float32 rays differ."""


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--meshes", type=Path, metavar="DIR", help="measure these mesh files too")
    parser.add_argument("--only", nargs="+", default=(), help="names of scenes, such as warehouse")
    parser.add_argument("--size", type=int, nargs=2, default=(1280, 1024))
    parser.add_argument("--poses", type=int, default=16)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--threads", type=int, default=2)
    args = parser.parse_args()
    cells = {f"torus, {n:,} faces": Cell("closed", n, *args.size) for n in TORI}
    if args.meshes is not None:
        for path in sorted(args.meshes.iterdir()):
            if path.suffix.lower() in READERS:
                cells[path.stem] = Cell(path.stem, 0, *args.size, path=str(path))
    report = Report(prints=not args.json)
    for name, cell in cells.items():
        if not args.only or name in args.only:
            measure(report, name, cell, args)
    report.finish(args.json)


def measure(report: Report, name: str, cell: Cell, args) -> None:
    """Add the rows of one scene."""
    mesh, camera = cell.mesh(), cell.camera
    poses = rc.Poses.of(cell.poses(mesh, args.poses))
    rows, step = np.arange(len(poses)), batch_size(mesh.n_faces, args.threads)
    packets = EmbreePackets(mesh, camera, poses.world_from_camera, args.threads)
    with (
        rc.open_observer(mesh, camera, threads=args.threads) as observer,
        rc.open_observer(mesh, camera, threads=1) as alone,
        rc.open_observer(mesh, camera, "exact", threads=args.threads) as exact,
        rc.open_rasterizer(mesh, camera, "cpu", threads=args.threads) as rasterizer,
    ):
        some = poses[:2]
        certified, computed = observer.observe(some), exact.observe(some)
        off = np.abs(certified.visible_pixels - computed.visible_pixels)
        bound = certified.area_error + computed.area_error
        report.check(f"{name}: certified is exact", bool((off <= bound + 1e-9).all()))
        alike = np.mean(rasterizer.render(poses[:1]).face == packets.faces(0))
        report.check(f"{name}: the image of the rays", bool(alike >= LEAST_ALIKE))

        def in_batches(measured):
            return lambda: [measured(poses[at : at + step]) for at in range(0, len(poses), step)]

        jobs = {
            "Embree packets": lambda: packets.count(rows),
            "certified": in_batches(observer.observe),
            "counts": in_batches(lambda part: rasterizer.count(part, drawn=False)),
        }
        times: dict[str, list[float]] = {job: [] for job in jobs}
        cpu = []
        for _ in range(args.rounds + 1):
            for job, run in jobs.items():
                started = time.perf_counter()
                run()
                times[job].append((time.perf_counter() - started) / len(poses))
            started = time.process_time()
            in_batches(alone.observe)()
            cpu.append((time.process_time() - started) / len(poses))
    for job, seconds in times.items():
        report.add(f"{name}: {job}", 1e3 * statistics.median(seconds[1:]), "ms a pose")
    for job, limits in RATIOS.items():
        pairs = zip(times["Embree packets"][1:], times[job][1:], strict=True)
        ratio = statistics.median(theirs / ours for theirs, ours in pairs)
        is_large = args.size[0] * args.size[1] >= 1280 * 1024
        if (job, name) == ("certified", "warehouse"):
            limits = CERTIFIED_WAREHOUSE
        must, aim = limits if is_large else (None, None)
        report.add(f"{name}: {job} / Embree packets", ratio, "x", must, aim)
    must, aim = CPU_MS.get(name, (None, None))
    spent = 1e3 * statistics.median(cpu[1:])
    report.add(f"{name}: certified, CPU", spent, "ms a pose", at_most=must, aim=aim)


if __name__ == "__main__":
    main()
