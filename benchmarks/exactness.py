"""Exact visibility: its cost against the thesis and a ray tracer, its agreement with fractions.

Times are CPU seconds of one thread for one pose, medians over rounds, after the answers have been
checked: "certified" (patches, and half planes where an edge crosses) against "exact" (half planes
for every face). Poses lie on a sphere, from where the mesh fills the image of 1280 x 960 pixels.
The race with Open3D gives both two threads and an image of 1280 x 1024: all faces exactly, against
one ray through each pixel.
"""

import statistics
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
from rows import Report, arguments
from sampled_bound import SUPERSAMPLES, compare, generic, machined, truth
from tracer import Tracer, need_open3d

import rastercov as rc
from rastercov.cli.inputs import poses_around
from rastercov.core.camera.pose import engine_camera, near_limit
from rastercov.core.coverage.coverage import ROLL
from rastercov.core.exact.surface import surface_of
from rastercov.core.mesh import shapes
from rastercov.engine.solver_parts import Solver, contacts
from rastercov.reference import rational
from rastercov.reference.coverage import measure_geometry as face_geometry

CAMERA = rc.Camera(width=1280, height=960, fx=1200, fy=1200)
THREADS = 2
TORI = ((32, 16), (100, 50), (316, 158), (1000, 500))
"""Rings and sectors of tori of about 10^3, 10^4, 10^5 and 10^6 faces."""
START = """
import time
import rastercov as rc
from rastercov import shapes
mesh, camera = shapes.by_name("box"), rc.Camera.preset("khepra")
poses = rc.sphere_of_poses((0, 0, 0), 9, 2)
started = time.process_time()
rc.evaluate(mesh, camera, poses, fields=["visibility"], by="face")
print(time.process_time() - started)
"""


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5, help="rounds of each timing")
    parser.add_argument("--figures", type=float, default=1e7, help="certified figures to check")
    args = parser.parse_args()
    need_open3d()
    report = Report()
    _thesis(report, args.rounds)
    _growth(report)
    _race(report, args.rounds)
    _fractions(report)
    _certificates(report, int(args.figures))
    _statistical(report)
    _starts(report)
    report.finish(args.json)


def _thesis(report: Report, rounds: int) -> None:
    """The thesis' largest teapot: two-sided, as an open mesh must be, and front faces only."""
    mesh = shapes.teapot(12, keep_degenerate=True)
    for front_only, must, aim in ((False, 0.08, 0.02), (True, 0.010, 0.003)):
        sides = "front faces only" if front_only else "two-sided"
        certified, exact = (
            _Run(is_certified, mesh, front_only, poses=6) for is_certified in (True, False)
        )
        what = f"teapot, {mesh.n_faces:,} faces, {sides}"
        report.check(f"{what}: certified is exact", _largest_difference(certified, exact) < 1e-9)
        seconds = _medians((certified, exact), rounds)
        report.add(f"{what}: certified", seconds[0], "CPU-s", at_most=must, aim=aim)
        report.add(f"{what}: exact", seconds[1], "CPU-s", at_most=must)


def _growth(report: Report) -> None:
    """Time and memory from 10^3 to 10^6 faces, each size in a process of its own."""
    for torus in TORI:
        with ProcessPoolExecutor(1, get_context("spawn")) as process:
            cost = process.submit(_cost_of_torus, *torus).result()
        n = 2 * torus[0] * torus[1]
        limits = {"at_most": 1.5, "aim": 0.3} if n == 1_000_000 else {}
        what = f"torus, {n:,} faces, closed"
        report.check(f"{what}: certified is exact", cost["difference"] < 1e-9)
        report.add(f"{what}: certified", cost["certified"], "CPU-s", **limits)
        report.add(f"{what}: exact", cost["exact"], "CPU-s")
        report.add(f"{what}: once for the mesh", cost["once"], "CPU-s")
        report.add(f"{what}: faces computed", cost["computed"], "%")


def _cost_of_torus(rings: int, sectors: int) -> dict[str, float]:
    mesh = shapes.torus(rings, sectors)
    _Run(True, shapes.torus(8, 8), True, poses=1).view(0)  # load the loops
    started = time.process_time()
    surface = surface_of(mesh)
    contacts(surface, 1.0)
    once = time.process_time() - started
    certified, exact = (_Run(is_certified, mesh, True, poses=3) for is_certified in (True, False))
    seconds = _medians((certified,), 3)[0]
    live = sum((certified.view(row).state > 0).sum() for row in range(3))
    computed = sum(certified.view(row).counts["n_crossed"] for row in range(3))
    return {
        "certified": seconds,
        "exact": _medians((exact,), 1)[0],
        "once": once,
        "computed": 100 * computed / live,
        "difference": _largest_difference(certified, exact),
    }


def _race(report: Report, rounds: int) -> None:
    """Exact poses a second against a ray tracer's sampled ones, side by side."""
    camera = rc.Camera(width=1280, height=1024, fx=1228.8, fy=1228.8)
    for name in ("torus", "aeroplane-9856"):
        mesh = shapes.by_name(name)
        poses = poses_around("sphere:64", mesh, camera)
        what = f"{name}, {mesh.n_faces:,} closed faces, 1280 x 1024"
        tracer = Tracer(mesh, camera, poses, THREADS)
        with rc.open_observer(mesh, camera, threads=THREADS) as observer:
            seen = observer.observe(poses)
            ids = tracer.faces(0)
            rays = np.bincount(ids[ids >= 0], minlength=mesh.n_faces)
            # Counting a shape's pixels is off by 0.27 times the root of its perimeter, more where
            # its sides run along their rows.
            perimeter = face_geometry(mesh, camera, poses[0]).perimeter
            off = np.abs(rays - seen.visible_pixels[0]) > 4 * 0.27 * np.sqrt(2 * perimeter + 1)
            report.check(f"{what}: both see the same", off.mean() < 0.005)
            ours, theirs, casting = [], [], []
            for _ in range(rounds):
                started = time.perf_counter()
                observer.observe(poses)
                ours.append(time.perf_counter() - started)
                whole, cast = tracer.round()
                theirs.append(whole)
                casting.append(cast)
        rate = len(poses) / statistics.median(ours)
        report.add(f"{what}: exact poses", rate, "poses/s")
        ratios = [statistics.median(times) / statistics.median(ours) for times in (theirs, casting)]
        report.add(f"{what}: ratio to Open3D", ratios[0], "x", 13, 40)
        report.add(f"{what}: ratio, rays for free", ratios[1], "x")


def _fractions(report: Report) -> None:
    """Chosen faces of large meshes against exact rational arithmetic."""
    rng = np.random.default_rng(0)
    worst, held, bounds = 0.0, True, []
    for name in ("torus", "teapot-12", "aeroplane-9856", "room"):
        mesh = shapes.by_name(name)
        run = _Run(False, mesh, False, poses=2)
        for row, pose in enumerate(run.poses):
            view = run.view(row)
            partly = np.flatnonzero((view.visible > 0) & (view.visible < view.area))
            faces = np.concatenate(
                (rng.permutation(partly)[:12], rng.permutation(mesh.n_faces)[:4])
            )
            truth = rational.visible_area(mesh, CAMERA, pose, faces)
            error = np.abs(view.visible[faces] - np.array(truth, dtype=np.float64))
            worst, held = (
                max(worst, float(error.max())),
                held and (error <= view.area_error[faces]).all(),
            )
            bounds += (view.area_error[partly] / view.area[partly])[view.area[partly] > 1].tolist()
    report.add("largest difference from rational arithmetic", worst, "px^2", at_most=1e-9)
    report.check("every bound of rounding holds", held)
    report.add(
        "bound of computed fractions, faces over 1 px^2: median", statistics.median(bounds), ""
    )
    report.add("the same: largest", max(bounds), "")


def _certificates(report: Report, figures: int) -> None:
    """Certified figures against half planes, up to a number of them."""
    names = ("torus", "teapot-12", "aeroplane-9856", "room", "sphere", "box")
    done = wrong = 0
    rng = np.random.default_rng(1)
    runs = []
    for mesh in map(shapes.by_name, names):
        surface = surface_of(mesh)
        runs.append((mesh, Solver(surface, True, False), Solver(surface, False, False)))
    while done < figures:
        for mesh, certified, exact in runs:
            low, high = mesh.bounds
            eye = rng.uniform(low, high) + rng.normal(size=3) * np.linalg.norm(high - low) * (
                10 ** rng.uniform(-2, 0.5)
            )
            pose = rc.look_at(eye, rng.uniform(low, high))
            near = float(near_limit(CAMERA, mesh.bounds, pose)[0])
            for view in (certified, exact):
                view.solve(engine_camera(CAMERA), pose[0], near, False)
            sure = certified.is_certified
            done += int(sure.sum())
            wrong += int((np.abs(certified.visible - exact.visible)[sure] > 1e-9).sum())
    report.add("certified figures checked", done, "figures", figures)
    report.add("wrong certificates", wrong, "figures", at_most=0)
    report.check("no certificate is wrong", wrong == 0)


def _statistical(report: Report) -> None:
    """Share of counted figures whose bound holds; `sampled_bound.py` has the particulars."""
    for kind, make in {"generic meshes": generic, "boxes and bars, frontal": machined}.items():
        held = []
        for mesh, pose in make(np.random.default_rng(2), 8):
            true = truth(mesh, pose)
            for supersample in SUPERSAMPLES:
                _, error, bound = compare(mesh, pose, true, supersample, ROLL)
                held.append(error <= bound)
        share = 100 * np.concatenate(held).mean()
        report.add(f"statistical bound held, partly hidden faces of {kind}", share, "%", 99.9)


def _starts(report: Report) -> None:
    """Time that loading the loops adds to a start."""
    command = [sys.executable, "-c", START]
    starts = [subprocess.run(command, capture_output=True, check=True) for _ in range(6)]
    seconds = statistics.median(float(start.stdout) for start in starts)
    report.add("every start adds", seconds, "CPU-s", at_most=1)


class _Run:
    """Views of a mesh from a few poses on a sphere."""

    def __init__(self, is_certified: bool, mesh: rc.Mesh, front_only: bool, poses: int) -> None:
        self.solver = Solver(surface_of(mesh), is_certified, False)
        self.poses = poses_around(f"sphere:{poses}", mesh, CAMERA)
        self.near = near_limit(CAMERA, mesh.bounds, self.poses)
        self.front_only = front_only

    def view(self, row: int) -> Solver:
        """The view from one pose; the next call takes its place."""
        near = float(self.near[row])
        self.solver.solve(engine_camera(CAMERA), self.poses[row], near, self.front_only)
        return self.solver

    def seconds(self) -> float:
        """CPU seconds a pose."""
        started = time.process_time()
        for row in range(len(self.poses)):
            self.view(row)
        return (time.process_time() - started) / len(self.poses)


def _medians(runs: tuple[_Run, ...], rounds: int) -> list[float]:
    """CPU seconds a pose of each, in turns."""
    turns = [[run.seconds() for run in runs] for _ in range(rounds + 1)][1:]
    return [statistics.median(times) for times in zip(*turns, strict=True)]


def _largest_difference(one: _Run, other: _Run) -> float:
    """Between the visible areas of all faces, px^2."""
    rows = range(len(one.poses))
    return max(float(np.abs(one.view(r).visible - other.view(r).visible).max()) for r in rows)


if __name__ == "__main__":
    main()
