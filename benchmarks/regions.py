"""Exact regions: their points and areas against a slow reference, then their cost.

A room of 48 faces seen by six cameras; `--meshes DIR` adds featuretype.STL, ADIS16480.STL and
warehouse.ply of a folder, each seen by 12. First, quasi-random points are judged one by one from
the definitions (`rastercov.reference.regions`): the covered share of the surface must agree with
the regions, and each point must lie in a region of a pose exactly if that pose covers it. Unions
are compared with Clipper2. Then CPU times of one thread: a pose of regions to a certified pose,
pieces and bytes of a camera, unions, and shares of cells; medians over the rounds. `--wide` is of
wide lenses in the room alone, with and without a density.
"""

import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from rows import Report, arguments
from surface_cases import in_regions, off_clipper2, room

import rastercov as rc
from rastercov.core.area.cells import usual_size
from rastercov.core.area.regions import RegionPass
from rastercov.core.area.stages import CentrePass
from rastercov.core.camera.conventions import panorama
from rastercov.core.mesh import shapes
from rastercov.reference.regions import covers_points, points_on

MOST_OFF, SCATTER = 0.02, 25.0
"""Percentage points of all area between regions and n points: the first, or, for few points, the
second over the root of n, which is half of the standard deviation of random points."""
MOST_OF_PINHOLE = 4.0
"""Time of regions through a lens to that of the pinhole."""
UNION_REL = 1e-8
"""Of all area, between unions and Clipper2."""
FILES = {"featuretype.STL": "in", "ADIS16480.STL": "mm", "warehouse.ply": "m"}
"""Units of the files; all but the room of boxes are parts, seen from a sphere."""


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=2_000_000)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--meshes", type=Path, metavar="DIR", help="measure these files, too")
    parser.add_argument("--wide", action="store_true", help="wide lenses alone")
    args = parser.parse_args()
    report = Report()
    mesh, camera, poses = room()
    if args.wide:
        through_wide_lenses(report, mesh, poses[:3], args.rounds)
        report.finish(args.json)
        return
    task = rc.Task(max_incidence_deg=75, min_pixels_per_m2=4000)
    dense = rc.Task(max_incidence_deg=75, min_pixel_density=60)
    compare(report, "room", mesh, camera, poses, task, args.points)
    compare(report, "room, density", mesh, camera, poses, dense, args.points)
    measure(report, "room", mesh, camera, poses, task, args.rounds)
    measure(report, "room, density", mesh, camera, poses, dense, args.rounds, most=10.0)
    lens = rc.Camera(
        width=1280, height=960, fx=700, fy=700, focus_range=(0.3, 8.0), model="opencv",
        distortion=(-0.28, 0.09, 1e-3, -5e-4, -0.01),
    )  # fmt: skip
    compare(report, "room, lens", mesh, lens, poses, task, args.points // 4)
    through_lens(report, "room", mesh, camera, lens, poses, task, args.rounds)
    ring = shapes.torus(100, 50)
    around_it = rc.sphere_of_poses(ring.bounds.mean(axis=0), 1.1 * float(np.ptp(ring.bounds)), 6)
    pinhole, lens = (replace(each, focus_range=None) for each in (camera, lens))
    through_lens(report, "torus", ring, pinhole, lens, around_it, rc.Task(), args.rounds)
    for name, unit in FILES.items() if args.meshes else ():
        mesh = rc.Mesh.load(args.meshes / name, unit)
        camera, poses, task = warehouse(mesh) if name == "warehouse.ply" else around(mesh)
        # Each point is held against every face.
        compare(report, name, mesh, camera, poses, task, args.points // (mesh.n_faces // 400))
        measure(report, name, mesh, camera, poses, task, args.rounds, ratio=1.5)
    report.finish(args.json)


def around(mesh: rc.Mesh) -> tuple[rc.Camera, np.ndarray, rc.Task]:
    """Camera, 12 poses on a sphere, and the task of a part."""
    centre, size = mesh.bounds.mean(axis=0), float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
    focus = (0.65 * size, 1.6 * size)
    camera = rc.Camera(width=1280, height=960, fx=1500, fy=1500, focus_range=focus)
    per_m2 = 0.3 * (1500 / (1.1 * size)) ** 2
    task = rc.Task(max_incidence_deg=70, min_pixels_per_m2=per_m2)
    return camera, rc.sphere_of_poses(centre, 1.1 * size, 12), task


def warehouse(mesh: rc.Mesh) -> tuple[rc.Camera, np.ndarray, rc.Task]:
    """Camera, 12 poses in a ring inside, and the task of the warehouse."""
    camera = rc.Camera(width=1280, height=960, fx=700, fy=700, focus_range=(0.3, 18.0))
    low, high = mesh.bounds
    angles = 2 * np.pi * np.arange(12) / 12
    ring = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    eyes = (low + high) / 2 + ring * (high - low) * 0.38
    eyes[:, 2] = low[2] + 0.55 * (high - low)[2]
    aside = np.random.default_rng(3).normal(0, 2, (12, 2))
    targets = (low + high) / 2 + np.column_stack([aside, np.full(12, -2.5)])
    task = rc.Task(max_incidence_deg=75, min_pixels_per_m2=1500)
    return camera, rc.look_at(eyes=eyes, targets=targets), task


def compare(
    report: Report,
    name: str,
    mesh: rc.Mesh,
    camera: rc.Camera,
    poses: np.ndarray,
    task: rc.Task,
    n_points: int,
) -> None:
    """Regions, by their area and point by point; and their union."""
    regions = rc.regions(mesh, camera, poses, task)
    points, face = points_on(mesh, n_points)
    covers = covers_points(mesh, camera, poses, task, points, face)
    total = mesh.areas.sum()
    union = rc.unite(regions, len(poses))
    views = covers.sum(axis=0)
    off = max(abs(100 * union.share(k) - 100 * (views >= k).mean()) for k in range(1, 4))
    report.add(f"{name}: covered area", 100 * union.share(), "%")
    report.add(f"{name}: bound of it", 100 * union.bound.sum() / total, "%")
    limit = max(MOST_OFF, SCATTER / n_points**0.5)
    report.add(f"{name}: off {n_points:,} points, 1 to 3 views", off, "points", at_most=limit)
    wrong = sum(
        int((in_regions(regions, row, points, face) != covers[row]).sum())
        for row in range(len(poses))
    )
    expected = regions.bound.sum() / total * n_points
    report.add(f"{name}: points on the other side", wrong, f"of {covers.size:,}")
    report.check(f"{name}: no more than the bound", wrong <= 2 + expected + 6 * expected**0.5)
    all_views = float(union.area.sum() - regions.area.sum()) / total
    report.check(f"{name}: areas of all views add up", abs(all_views) <= 1e-9)
    off = float(off_clipper2(regions, rc.unite(regions).area[0]).max()) / total
    report.add(f"{name}: union off Clipper2, largest face", off, "of all area", at_most=UNION_REL)


def measure(
    report: Report,
    name: str,
    mesh: rc.Mesh,
    camera: rc.Camera,
    poses: np.ndarray,
    task: rc.Task,
    rounds: int,
    *,
    ratio: float | None = None,
    most: float = 10.0,
) -> None:
    """Print CPU times of one thread, and memory."""
    finder, chosen = RegionPass(mesh, camera, task, threads=1), rc.Poses.of(poses)
    observer = rc.open_observer(mesh, camera, threads=1)
    result, n = finder.find(chosen), len(poses)
    repeats = max(1, 60 // n) if mesh.n_faces < 1000 else 1
    certified, exact = [], []
    for _ in range(rounds):
        certified.append(seconds(lambda: observer.observe(chosen), repeats) / n)
        exact.append(seconds(lambda: finder.find(chosen), repeats) / n)
    ratios = [one / other for one, other in zip(exact, certified, strict=True)]
    report.add(f"{name}: certified", 1e3 * statistics.median(certified), "ms/pose")
    at_most = most if ratio is None else None
    report.add(f"{name}: regions", 1e3 * statistics.median(exact), "ms/pose", at_most=at_most)
    report.add(f"{name}: regions / certified", statistics.median(ratios), "", at_most=ratio)
    size = result.xy.nbytes + result.starts.nbytes + result.face.nbytes + result.pose.nbytes
    report.add(f"{name}: pieces", len(result) / n, "a camera")
    report.add(f"{name}: memory of pieces", size / n / 1e3, "kB a camera")
    for k in (1, 3):
        rc.unite(result, k)
        taken = [seconds(lambda k=k: rc.unite(result, k)) for _ in range(rounds)]
        report.add(f"{name}: union of {n}, {k} views", 1e3 * statistics.median(taken), "ms")
    cells = rc.cells(mesh, 0.05 * float(np.linalg.norm(np.ptp(mesh.bounds, axis=0))))
    shares = cells.share(result)
    taken = [seconds(lambda: cells.share(result)) / n for _ in range(rounds)]
    report.add(f"{name}: shares of {len(cells):,} cells", 1e3 * statistics.median(taken), "ms/pose")
    pairs = len(shares.cell) / n
    report.add(f"{name}: shares of 10,000 candidates", 12 * 1e4 * pairs / 1e9, "GB", at_most=1.0)
    usual = rc.cells(mesh, usual_size(mesh))
    centres = CentrePass(usual, camera, task, threads=1)
    listed, halves = centres.find(chosen.world_from_camera), usual.share(result)
    taken = [seconds(lambda: centres.find(chosen.world_from_camera)) / n for _ in range(rounds)]
    report.add(
        f"{name}: centres of {len(usual):,} cells", 1e3 * statistics.median(taken), "ms/pose"
    )
    is_listed, is_half = np.zeros((2, n, len(usual)), np.bool_)
    for row in range(n):
        is_listed[row, listed.row(row)] = True
        part = slice(halves.starts[row], halves.starts[row + 1])
        is_half[row, halves.cell[part][halves.share[part] >= 0.5]] = True
    off = ((is_listed != is_half) @ usual.area).sum() / (is_half @ usual.area).sum()
    report.add(f"{name}: cells that centres take wrongly", 100 * off, "% of the covered area")


def through_lens(
    report: Report,
    name: str,
    mesh: rc.Mesh,
    pinhole: rc.Camera,
    lens: rc.Camera,
    poses: np.ndarray,
    task: rc.Task,
    rounds: int,
) -> None:
    """Print the CPU time of a pose through a lens, to that of the pinhole without distortion."""
    finders = [RegionPass(mesh, camera, task, threads=1) for camera in (pinhole, lens)]
    chosen, repeats = rc.Poses.of(poses), max(1, 3000 // mesh.n_faces)
    results = [finder.find(chosen) for finder in finders]
    taken = np.array(
        [
            [seconds(lambda f=finder: f.find(chosen), repeats) / len(poses) for finder in finders]
            for _ in range(rounds)
        ]
    )
    report.add(f"{name}, pinhole: regions", 1e3 * float(np.median(taken[:, 0])), "ms/pose")
    report.add(f"{name}, lens: regions", 1e3 * float(np.median(taken[:, 1])), "ms/pose")
    ratio = float(np.median(taken[:, 1] / taken[:, 0]))
    report.add(f"{name}: lens / pinhole", ratio, "", at_most=MOST_OF_PINHOLE)
    report.add(f"{name}, lens: pieces", len(results[1]) / len(poses), "a camera")
    share = 100 * results[1].bound.sum() / results[1].area.sum()
    report.add(f"{name}, lens: bound", share, "% of the covered area")


def through_wide_lenses(report: Report, mesh: rc.Mesh, poses: np.ndarray, rounds: int) -> None:
    """Print the CPU time and the pieces of a pose through wide lenses, with and without density."""
    fisheye = {"model": "opencv_fisheye", "distortion": (0.01, -0.002, 0.0, 0.0)}
    cameras = {
        "pinhole 77 deg": rc.Camera(width=1280, height=960, fx=800, fy=800),
        "fisheye 115 deg": rc.Camera(width=1280, height=960, fx=800, fy=800, **fisheye),
        "fisheye 229 deg": rc.Camera(width=1280, height=960, fx=400, fy=400, **fisheye),
        "panorama": panorama(2048, 1024),
    }
    for name, camera in cameras.items():
        for density in (0.0, 150.0):
            task = rc.Task(min_pixel_density=density)
            finder, chosen = RegionPass(mesh, camera, task, threads=1), rc.Poses.of(poses)
            result = finder.find(chosen)
            taken = [seconds(partial(finder.find, chosen)) / len(poses) for _ in range(rounds)]
            label = f"{name}, {density:g} px/m"
            report.add(f"{label}: regions", 1e3 * float(np.median(taken)), "ms/pose")
            report.add(f"{label}: pieces", len(result) / len(poses), "a camera")


def seconds(work: Callable[[], object], repeats: int = 1) -> float:
    """CPU seconds of this process that a call takes."""
    start = time.process_time()
    for _ in range(repeats):
        work()
    return (time.process_time() - start) / repeats


if __name__ == "__main__":
    main()
