"""Placement: every method with equal poses, published optima, best coverage, 10,000 x 10,000.

`methods` gives each way to place k cameras the same number of poses to measure: the selections
that many candidates, the searches that budget, and refinement half of it after greedy has had the
other half as candidates. Candidates are square views of segments, views around the part (or from
the walls of the room), and poses at random. `kills` builds a matrix under `kill -9`. `cells`
compares elements of a room of 48 triangles, faces and cells, with greedy selection on exact areas,
and measures 10,000 candidates on cells.
"""

import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rows import SUPPORT, Report, arguments
from set_cover_cases import COVERS, steiner
from surface_cases import room
from union_greedy import area_of, greedy_by_area, room_candidates

import rastercov as rc
from rastercov.core.mesh import shapes
from rastercov.placement.candidates.mounting import on_ceiling, on_sphere, on_walls
from rastercov.placement.candidates.pool import Framing, per_segment
from rastercov.placement.candidates.segments import segment
from rastercov.placement.improve.objective import Objective
from rastercov.placement.improve.pose_space import PoseSpace
from rastercov.placement.improve.refine import optimise, refine
from rastercov.placement.matrix import build_matrix
from rastercov.placement.select.methods import select_greedy, select_integer
from rastercov.placement.select.problem import (
    BestCoverage,
    FewestCameras,
    problem_of,
    problem_of_matrix,
)
from rastercov.reference.thesis import select_thesis

PARTS = ("methods", "published", "best", "large", "kills", "cells")


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument(
        "--only", choices=PARTS, action="append", help="parts to run; all unless given"
    )
    parser.add_argument("--seconds", type=float, default=60.0, help="for each integer program")
    parser.add_argument("--poses", type=int, default=1500, help="poses each method may measure")
    parser.add_argument("--seeds", type=int, default=3, help="of each method")
    parser.add_argument("--count", type=int, default=10_000, help="candidates of the large plan")
    args = parser.parse_args()
    report = Report()
    compile_loops()
    for part in args.only or PARTS:
        if part == "methods":
            methods(report, args.poses, args.seeds)
        elif part == "large":
            large(report, args.count)
        elif part == "best":
            best_coverage(report, args.seconds)
        elif part == "kills":
            kills(report)
        elif part == "cells":
            elements(report, args.count)
        else:
            published(report)
    report.finish(args.json)


CELLS_REL = (0.2, 0.1, 0.05, 0.025)
"""Sizes of cells, relative to the diagonal of the room."""


def elements(report: Report, count: int) -> None:
    """Six cameras in a room by faces, by cells and by exact areas; and a large matrix of cells."""
    mesh, camera, _ = room()
    task, poses = rc.Task(max_incidence_deg=75, min_pixels_per_m2=4000), room_candidates(200)
    diagonal = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
    started = time.perf_counter()
    _, best = greedy_by_area(mesh, camera, poses, task, 6)
    report.add("room, 6 of 200: lazy greedy on exact areas", 100 * best, "% of the area")
    report.add("  its time", time.perf_counter() - started, "s")
    names = [("faces", None)] + [(f"cells of {size:g} diagonals", size) for size in CELLS_REL]
    for name, size in names:
        cells = None if size is None else rc.cells(mesh, size * diagonal)
        started = time.perf_counter()
        matrix = build_matrix((mesh, camera), poses, task, cells=cells)
        seconds = time.perf_counter() - started
        chosen = select_greedy(problem_of(matrix, cells or mesh, BestCoverage(6)), effort=0)
        exact = area_of(mesh, camera, poses[chosen.chosen], task)
        n = mesh.n_faces if cells is None else len(cells)
        report.add(f"room, {n:,} {name}: the matrix says", 100 * chosen.share, "% of the area")
        report.add("  exact", 100 * exact, "% of the area")
        report.add("  a candidate", 1000 * seconds / len(poses), "ms")
        if size is not None and size <= 0.05:
            report.check("  within 0.5 points of exact areas", exact >= best - 0.005)
    with tempfile.TemporaryDirectory() as folder:
        cells = rc.cells(mesh, 0.05 * diagonal)
        started = time.perf_counter()
        matrix = build_matrix((mesh, camera), room_candidates(count, 1), task, folder, cells=cells)
        select_greedy(problem_of(matrix, cells, BestCoverage(6)), effort=0)
        of = f"{count:,} candidates on {len(cells):,} cells"
        report.add(f"room, {of}: matrix and selection", time.perf_counter() - started, "s")
        report.add("  pairs", len(matrix.face), "pairs")
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        report.add("  memory of the process at most", peak, "MiB", at_most=1024)


def compile_loops() -> None:
    """Load every loop once, so that no row counts compilation."""
    for goal in (FewestCameras(), BestCoverage(3)):
        problem = problem_of_matrix(steiner(9), goal)
        select_integer(problem)
        select_thesis(problem, np.ones(problem.n_candidates))


@dataclass(frozen=True)
class Site:
    """A mesh, the space of camera positions, and the number of cameras."""

    name: str
    cameras: tuple[int, int]
    clearance: float
    stand_off: tuple[float, float]
    boxes: np.ndarray | None = None

    def candidates(self, space: PoseSpace, camera: rc.Camera, count: int, seed: int) -> np.ndarray:
        """(count, 4, 4) poses by rule where positions are allowed, and others at random."""
        mesh, rng = space.mesh, np.random.default_rng(seed)
        framing = Framing(stand_off=self.stand_off, fit="vertices")
        segmentation = segment(mesh, 15, 25, merge="closest")
        segments = per_segment(mesh, camera, framing, segmentation=segmentation)
        if self.boxes is None:
            segments += on_sphere(mesh, camera, framing, count=count // 3)
        else:
            segments += on_walls(mesh, camera, framing, spacing=0.6, inset=0.3)
            segments += on_ceiling(mesh, camera, framing, spacing=0.6, inset=0.3)
        poses = segments.poses[space.allows(segments.poses[:, :3, 3])][:count]
        low, high = space.aim
        more = space.sample(count - len(poses), rng)
        return np.concatenate((poses, rc.look_at(more, rng.uniform(low, high, more.shape))))


SITES = (
    Site("aeroplane", (3, 6), 1.0, (4.0, 40.0)),
    Site("teapot-5", (3, 5), 0.05, (0.1, 0.6)),
    Site("room", (3, 6), 0.2, (0.2, 6.0), np.array([[(-2.7, -2.2, 0.3), (2.7, 2.2, 2.5)]])),
)


def methods(report: Report, budget: int, seeds: int) -> None:
    """All ways to place cameras on three meshes and two camera counts."""
    camera, task = rc.Camera(width=640, height=512, fx=700, fy=700), rc.Task(max_incidence_deg=70)
    for site in SITES:
        mesh = shapes.by_name(site.name)
        space = PoseSpace(
            mesh=mesh, boxes=site.boxes, stand_off=site.stand_off, clearance=site.clearance
        )
        with rc.open_observer(mesh, camera) as observer:
            objective = Objective.of(observer, task)
            for k in site.cameras:
                shares = {
                    name: [place(seed) for seed in range(seeds)]
                    for name, place in ways(site, space, objective, k, budget).items()
                }
                tell(report, f"{site.name}, {k} cameras", shares)


def ways(
    site: Site, space: PoseSpace, objective: Objective, k: int, budget: int
) -> dict[str, Callable[[int], float]]:
    """Share that each method covers for a seed."""
    mesh, camera = objective.observer.mesh, objective.observer.camera
    problems = {}

    def problem(seed: int, count: int):
        if (seed, count) not in problems:
            poses = site.candidates(space, camera, count, seed)
            matrix = build_matrix((mesh, camera), poses, objective.task)
            made = problem_of(matrix, mesh, BestCoverage(k))
            problems[seed, count] = poses, made, matrix.mean_coverage
        return problems[seed, count]

    def refined(seed: int) -> float:
        poses, half, _ = problem(seed, budget // 2)
        start = poses[select_greedy(half, seed=seed).chosen]
        return refine(objective, space, start, budget=budget - budget // 2, seed=seed).share

    return {
        "the thesis' rule": lambda seed: select_thesis(*problem(seed, budget)[1:]).share,
        "greedy + swaps": lambda seed: select_greedy(problem(seed, budget)[1], seed=seed).share,
        "integer program": lambda seed: (
            select_integer(problem(seed, budget)[1], time_limit=20, seed=seed).share
        ),
        "greedy, then refined": refined,
        "search": lambda seed: optimise(objective, space, k, budget=budget, seed=seed).share,
    }


def tell(report: Report, what: str, shares: dict[str, list[float]]) -> None:
    """Mean and spread of each method, and by how much the best beats the next."""
    means = {name: 100 * statistics.mean(of_seeds) for name, of_seeds in shares.items()}
    for name, of_seeds in shares.items():
        spread = f"% ({100 * min(of_seeds):.2f} to {100 * max(of_seeds):.2f})"
        report.add(f"{what}: {name}", means[name], spread)
    first, second = sorted(means, key=means.__getitem__, reverse=True)[:2]
    report.add(f"{what}: {first} wins, before {second}, by", means[first] - means[second], "%")
    report.check(
        f"{what}: the integer program is no worse than greedy",
        all(
            exact >= greedy - 1e-12
            for exact, greedy in zip(
                shares["integer program"], shares["greedy + swaps"], strict=True
            )
        ),
    )


def published(report: Report) -> None:
    """Fewest cameras of triple systems: the published optimum, and the proof."""
    for n, optimum in COVERS.items():
        name, problem = f"Steiner A{n}", problem_of_matrix(steiner(n))
        greedy = select_greedy(problem)
        exact = select_integer(problem, time_limit=600)
        proved = exact.objective == exact.bound == optimum
        report.check(f"{name}: {optimum} reached and proved", proved)
        report.add(f"{name}: time to the proof", exact.seconds, "s")
        report.add(f"{name}: greedy above the optimum", above(greedy, optimum), "%")
        report.check(f"{name}: greedy's bound holds", greedy.bound <= optimum)


def above(selection, optimum: float) -> float:
    return 100 * (selection.objective / optimum - 1)


def scene(n_poses: int) -> tuple[rc.Mesh, rc.Camera, np.ndarray]:
    """A teapot of 5112 faces and cameras near it that see a twentieth each, aimed at random."""
    mesh = shapes.teapot(9)
    centre = mesh.bounds.mean(axis=0)
    radius = np.linalg.norm(mesh.vertices - centre, axis=1).max()
    eyes = rc.sphere_of_poses(centre, 1.6 * radius, n_poses)[:, :3, 3]
    aims = centre + 0.35 * radius * np.random.default_rng(1).normal(size=(n_poses, 3))
    return mesh, rc.Camera(width=256, height=256, fx=500, fy=500), rc.look_at(eyes, aims)


def best_coverage(report: Report, seconds: float) -> None:
    """The best k of 300 candidates for 5000 faces, by every method."""
    mesh, camera, poses = scene(300)
    matrix = build_matrix((mesh, camera), poses, rc.Task(max_incidence_deg=70))
    report.add("300 candidates: faces", mesh.n_faces, "faces")
    for k in (10, 20):
        problem = problem_of(matrix, mesh, BestCoverage(k))
        quick = [select_greedy(problem, seed=seed) for seed in range(5)]
        patient = select_greedy(problem, effort=3_000_000_000, seed=99)
        plain = select_greedy(problem, effort=0)
        exact = select_integer(problem, time_limit=seconds)
        thesis = select_thesis(problem, matrix.mean_coverage)
        best = max(s.objective for s in (*quick, patient, exact))
        bound = min(exact.bound, *(s.bound for s in quick))
        report.check(f"k = {k}: no selection passes the bound", best <= bound + 1e-9)
        short = [100 * (1 - s.objective / best) for s in quick]
        report.add(f"k = {k}: best found covers", 100 * best, "% of the area")
        report.add(
            f"k = {k}: greedy + swaps below it, worst of 5 seeds", max(short), "%", at_most=0.3
        )
        report.add(
            f"k = {k}: greedy + swaps, longest of 5",
            max(s.seconds for s in quick),
            "s",
            at_most=1.0,
        )
        report.add(f"k = {k}: greedy + swaps, gap to its bound", 100 * quick[0].gap, "%")
        report.add(f"k = {k}: plain greedy below the best", 100 * (1 - plain.objective / best), "%")
        report.add(
            f"k = {k}: integer program below the best", 100 * (1 - exact.objective / best), "%"
        )
        report.add(f"k = {k}: integer program, gap", 100 * exact.gap, "%")
        report.add(f"k = {k}: integer program, time", exact.seconds, "s")
        report.add(f"k = {k}: the thesis' rule covers", 100 * thesis.objective, "% of the area")


LARGE = """
[[meshes]]
built_in = "torus"
[camera]
width = 256
height = 256
fx = 300
fy = 300
[task]
views = 4
max_incidence_deg = 60
[[candidates]]
generator = "on_sphere"
count = {count}
distances = [4.2]
[selection]
goal = "best_coverage"
cameras = 20
"""


def large(report: Report, count: int) -> None:
    """10,000 candidates x 10,000 faces, from the plan file to the page: `rastercov place`."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "plan.toml").write_text(LARGE.format(count=count), encoding="utf-8")
        command = [sys.executable, "-m", "rastercov", "place", "plan.toml"]
        started = time.perf_counter()
        process = subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - started
        process.returncode = os.waitstatus_to_exitcode(status)
        report.check("large plan: the command succeeds", process.returncode == 0)
        content = json.loads(Path(folder, "plan", "plan.json").read_text(encoding="utf-8"))
        disk = sum(path.stat().st_size for path in Path(folder).rglob("*") if path.is_file())
    name = f"{count} candidates x {content['network']['faces']} faces"
    selection = content["selection"]
    report.check(f"{name}: coverage lies below its bound", selection["share"] <= selection["bound"])
    report.add(f"{name}: pairs", content["matrix"]["pairs"], "pairs")
    for step, took in content["seconds"]["steps"].items():
        report.add(f"{name}: {step}", took, "s")
    report.add(f"{name}: disk", disk / 2**20, "MiB")
    report.add(f"{name}: 20 cameras cover", 100 * selection["share"], "% of the area")
    report.add(f"{name}: gap", 100 * selection["gap"], "%")
    report.add(f"{name}: all of it", seconds, "s", at_most=300)
    report.add(f"{name}: peak memory", usage.ru_maxrss / 1024, "MiB", at_most=1024)


def kills(report: Report) -> None:
    """A matrix built under 20 kills -9 at random moments."""
    with tempfile.TemporaryDirectory() as folder:
        script = str(SUPPORT / "kill_matrix.py")
        done = subprocess.run(
            [sys.executable, script, "20", "2000", folder],
            check=True,
            capture_output=True,
            text=True,
        )
    result = json.loads(done.stdout)
    report.check("kill -9: the matrix is identical", result["same"])
    report.add("kill -9: hits while it was being built", result["kills"], "kills")
    report.add("kill -9: whole shards written again", result["rewritten"], "shards", at_most=0)
    report.check("kill -9: nothing is left lying about", not result["left"])


if __name__ == "__main__":
    main()
