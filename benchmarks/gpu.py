"""The plan "compute" on a device: every count and bit beside the CPU's, then the time of a pose.

Without a network, in at most 150 s on a GPU:

    python benchmarks/gpu.py --device egl:0           a GPU; the must of each row is for an H200
    python benchmarks/gpu.py --quick                  few poses in software: the checks alone
    python benchmarks/gpu.py --bits 10000000          pairs of pose and face, judged on the device
                                                      as on the host; with MESA_EXTENSION_OVERRIDE=
                                                      +GL_NV_shader_atomic_int64 Mesa has 64-bit
                                                      atomics, else 32-bit ones
"""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from statistics import median

import numpy as np
from contest import Cell
from rows import Report, arguments

import rastercov as rc
from rastercov.base.memory import FloatArray
from rastercov.core.coverage.face_pass import FacePass
from rastercov.core.raster.bits import Criteria, area_units
from rastercov.core.raster.contract import Rasterizer
from rastercov.gl import GLRasterizer
from rastercov.gl.context import HeadlessContext, open_context

TURNS, MILLION = 5, 1 << 20
MOST_PAIRS = 3 << 25
"""Pairs of pose and face that a call counts: enough to fill a device, in little memory."""


@dataclass(frozen=True)
class Row:
    """A scene and image, and the time of a pose in microseconds that it must take on an H200."""

    name: str
    cell: Cell
    must_us: float | None = None
    is_within: bool = False
    must_s: float | None = None  # for a million poses to bits, areas and views


ROWS = (
    Row("10,000 faces", Cell("closed", 10_000, 256, 256), 2.0, must_s=3.0),
    Row("10,000 faces", Cell("closed", 10_000, 640, 512), 5.0, must_s=6.0),
    Row("10,000 faces", Cell("closed", 10_000, 1280, 1024), 12.0),
    Row("100,000 faces", Cell("closed", 100_000, 1280, 1024), 30.0),
    Row("1,000,000 faces", Cell("closed", 1_000_000, 1280, 1024), 130.0),
    Row("room from within", Cell("interior", 27_216, 1280, 1024), 30.0, is_within=True),
    Row("teapot from within", Cell("open", 6_320, 256, 256), is_within=True),
    Row("large triangles", Cell("aeroplane", 2_000, 640, 512)),
)


def poses_of(mesh: rc.Mesh, n: int, *, is_within: bool) -> FloatArray:
    """Poses around a mesh, or in its middle, (N, 4, 4)."""
    rng = np.random.default_rng(5)
    directions = rng.normal(size=(n, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    centre, size = mesh.bounds.mean(axis=0), np.linalg.norm(np.ptp(mesh.bounds, axis=0))
    if is_within:
        return rc.look_at(centre + 0.05 * size * directions, centre + size * directions)
    eyes = centre + size * directions * rng.uniform(0.95, 1.3, (n, 1))
    return rc.look_at(eyes, centre + 0.03 * size * rng.normal(size=(n, 3)))


def time_of(call: Callable[[], object], n: int) -> float:
    """Median time of a call over n poses, microseconds a pose."""
    call()
    times = []
    for _ in range(TURNS):
        started = time.perf_counter()
        call()
        times.append(time.perf_counter() - started)
    return median(times) / n * 1e6


def compare(report: Report, row: Row, device: HeadlessContext, quick: bool) -> None:
    """Check all counts of a row against the CPU's, and add times."""
    mesh, cell = row.cell.mesh(), row.cell
    camera = rc.Camera.from_fov(cell.width, cell.height, hfov_deg=70 if row.is_within else 50)
    n = 4 if quick else max(16, min(1024, MOST_PAIRS // mesh.n_faces))
    poses = poses_of(mesh, n, is_within=row.is_within)
    what = f"{row.name}, {cell.width} x {cell.height}"
    with (
        GLRasterizer(mesh, camera, device=device, plan="compute") as ours,
        rc.open_rasterizer(mesh, camera, "cpu") as cpu,
    ):
        seen, expected = ours.count(poses), cpu.count(poses)
        for name in ("visible", "drawn", "background"):
            is_same = np.array_equal(getattr(seen, name), getattr(expected, name))
            report.check(f"{what}: {name} as on the CPU, {n} poses", is_same)
        if quick:
            return

        def counts(rasterizer: Rasterizer, *, drawn: bool) -> float:
            return time_of(lambda: rasterizer.count(poses, drawn=drawn), n)

        own, other = counts(ours, drawn=False), counts(cpu, drawn=False)
        report.add(f"{what}: visible", own, "us a pose", at_most=row.must_us)
        report.add(f"{what}: visible and drawn", counts(ours, drawn=True), "us a pose")
        report.add(f"{what}: the CPU, visible", other, "us a pose")
        report.add(f"{what}: CPU over device", other / own, "times")


TASKS = (
    rc.Task(),
    rc.Task(min_visibility=0.5, max_incidence_deg=60, min_pixels=4),
    rc.Task(min_pixel_density=60, min_coverage=0.8, focus_rule="centroid"),
    rc.Task(min_facing_density=80, min_pixels_per_m2=3000, cap_resolution=False),
)


def criteria_of(mesh: rc.Mesh, camera: rc.Camera, task: rc.Task) -> tuple[FacePass, Criteria]:
    """Judge of the host, and the same criteria for a device."""
    judge = FacePass(mesh, camera, os.cpu_count() or 1, task)
    return judge, judge.criteria()[0]


def judge(report: Report, row: Row, device: HeadlessContext, n_pairs: int) -> None:
    """Check the bits of poses of a row by all tasks, then the time of a million poses."""
    mesh, cell = row.cell.mesh(), row.cell
    if row.is_within:
        mesh = mesh.with_groups(two_sided="all")
    camera = rc.Camera.from_fov(cell.width, cell.height, hfov_deg=70 if row.is_within else 50)
    nearest, farthest = (0.01, 0.6) if row.is_within else (0.5, 1.4)
    camera = replace(camera, focus_range=(nearest * mesh.diagonal, farthest * mesh.diagonal))
    n = max(4, n_pairs // (mesh.n_faces * len(TASKS)))
    poses = poses_of(mesh, n, is_within=row.is_within)
    what = f"{row.name}, {cell.width} x {cell.height}"
    with (
        GLRasterizer(mesh, camera, device=device, plan="compute") as ours,
        rc.open_rasterizer(mesh, camera, "cpu") as cpu,
    ):
        counts, n_wrong, n_covered = cpu.count(poses), 0, 0
        for task in TASKS:
            host, criteria = criteria_of(mesh, camera, task)
            reasons = {"reason": np.empty((n, mesh.n_faces), np.uint8)}
            host.fill(counts, rc.Poses.of(poses), reasons)
            covered = reasons["reason"] == rc.Reason.COVERED
            found, _ = ours._judge(poses, criteria)
            n_wrong += int((found.dense() != covered).sum())
            n_wrong += int((found.views != covered.sum(axis=0)).sum())
            n_wrong += int((found.area_units != covered @ area_units(mesh)).sum())
            n_covered += int(covered.sum())
        pairs = n * mesh.n_faces * len(TASKS)
        report.add(f"{what}: pairs judged", pairs, "pairs")
        report.add(f"{what}: of these covered", n_covered, "pairs")
        report.check(f"{what}: bits, areas and views as on the CPU", n_wrong == 0 < n_covered)
        if row.must_s is not None and not device.info.is_software:
            many = np.resize(poses, (MILLION, 4, 4))
            ours._judge(many[:4096], criteria)
            started = time.perf_counter()
            ours._judge(many, criteria)
            seconds = time.perf_counter() - started
            report.add(f"{what}: a million poses to bits", seconds, "s", at_most=row.must_s)


def main() -> None:
    """Check and time every row on one device."""
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--device", default="auto", help="as of open_rasterizer; auto by default")
    parser.add_argument("--quick", action="store_true", help="four poses of each row, not timed")
    parser.add_argument("--bits", type=int, metavar="N", help="judge N pairs alone")
    args = parser.parse_args()
    report = Report(prints=not args.json)
    with open_context(args.device) as device:
        print(f"{device.info.renderer}, {device.info.version}")
        print(f"{64 if device.info.has_int64_atomics else 32}-bit atomics")
        small = [row for row in ROWS if row.cell.n_faces <= 30_000]
        n_pairs = args.bits or (0 if args.quick else 40_000_000)
        for row in small:
            judge(report, row, device, n_pairs // len(small))
        for row in () if args.bits else ROWS:
            if args.quick and row.cell.n_faces > 100_000 and device.info.is_software:
                continue
            compare(report, row, device, args.quick)
    report.finish(args.json)


if __name__ == "__main__":
    main()
