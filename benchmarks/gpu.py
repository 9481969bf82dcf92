"""The plan "compute" on a device: counts and bits beside the CPU's, then times, in one command.

Without a network, in at most 150 s on a GPU; what there was no time for is named:

    python benchmarks/gpu.py --device hardware --output gpu.json
    python benchmarks/gpu.py --device surfaceless --quick     all of it in software, on few poses
    python benchmarks/gpu.py --device hardware --only scenes  one part

With `--quick` no time has a limit. Each must is for an H200. With MESA_EXTENSION_OVERRIDE=
+GL_NV_shader_atomic_int64 Mesa has 64-bit atomics, else 32-bit ones. nvdiffrast is timed where it
is installed, with torch.
"""

import importlib.util
import json
import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

import moderngl
import numpy as np
from contest import Cell
from rows import Report, arguments, machine, resident_mib
from scenes_of_devices import FOUND, KINDS, compare_counts, compare_scene, huge

import rastercov as rc
from rastercov.base.arguments import FloatArray
from rastercov.core.coverage.face_pass import FacePass
from rastercov.core.raster import drawer
from rastercov.core.raster.contract import Criteria, area_units
from rastercov.gl import GLRasterizer
from rastercov.gl.context import HeadlessContext, open_context

TURNS, MILLION = 5, 1 << 20
MOST_PAIRS = 3 << 25
"""Pairs of pose and face that a call counts: enough to fill a device, in little memory."""
SECONDS = 150
"""Time of all parts together."""
SCENES, SCENE_SECONDS, N_PAIRS = 17, 45, 40_000_000
"""Random scenes of each kind, and the time of all: a driver may compile programs anew for each;
pairs that are judged by the device and by the host."""


@dataclass(frozen=True)
class Row:
    """A scene and image, and the time of a pose in microseconds that it must take on an H200."""

    name: str
    cell: Cell
    must_us: float | None = None
    is_within: bool = False
    must_s: float | None = None  # for a million poses to bits, areas and views
    must_times: float | None = None  # of nvdiffrast's time

    @property
    def what(self) -> str:
        """Its name and image."""
        return f"{self.name}, {self.cell.width} x {self.cell.height}"

    @property
    def camera(self) -> rc.Camera:
        """Pinhole that has the part in its image."""
        angle = 70 if self.is_within else 50
        return rc.Camera.from_fov(self.cell.width, self.cell.height, hfov_deg=angle)


ROWS = (
    Row("10,000 faces", Cell("closed", 10_000, 256, 256), 2.0, must_s=3.0, must_times=12),
    Row("10,000 faces", Cell("closed", 10_000, 640, 512), 5.0, must_s=6.0, must_times=12),
    Row("10,000 faces", Cell("closed", 10_000, 1280, 1024), 12.0, must_times=12),
    Row("100,000 faces", Cell("closed", 100_000, 1280, 1024), 30.0, must_times=4),
    Row("1,000,000 faces", Cell("closed", 1_000_000, 1280, 1024), 130.0),
    Row("room from within", Cell("interior", 27_216, 1280, 1024), 30.0, is_within=True),
    Row("teapot from within", Cell("open", 6_320, 256, 256), is_within=True),
    Row("large triangles", Cell("aeroplane", 2_000, 640, 512)),
    Row("1,024 faces", Cell("closed", 1_024, 256, 256), must_times=4),
    Row("1,024 faces", Cell("closed", 1_024, 1280, 1024), must_times=4),
)


class Run:
    """A report on a device, for at most some time.

    Parameters
    ----------
    device : HeadlessContext
    report : Report
    quick : bool
        Few poses, and no limit on times.
    """

    def __init__(self, device: HeadlessContext, report: Report, *, quick: bool) -> None:
        self.device, self.report, self.quick = device, report, quick
        self.label = device.info.device.label
        self._ends = time.perf_counter() + SECONDS

    def has_time(self, seconds: float, what: str) -> bool:
        """True if this much time is left; else the part that is left out is named."""
        if self.quick or time.perf_counter() + seconds < self._ends:
            return True
        self.report.add(f"left out, for lack of time: {what}", 0.0, "")
        return False

    def most(self, n: int, few: int) -> int:
        """Number to take of something."""
        return few if self.quick else n

    def limit(self, must: float | None) -> float | None:
        """A must, where times are compared with it."""
        return None if self.quick else must

    def open(self, mesh: rc.Mesh, camera: rc.Camera) -> GLRasterizer:
        """Rasteriser of the plan "compute" on the device."""
        return GLRasterizer(mesh, camera, device=self.device, plan="compute")


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


def seconds_of(call: Callable[[], object], turns: int = TURNS) -> float:
    """Median time of a call, after a first one."""
    call()
    times = []
    for _ in range(turns):
        started = time.perf_counter()
        call()
        times.append(time.perf_counter() - started)
    return median(times)


# --- scenes ---------------------------------------------------------------------------------------


def check_scenes(run: Run) -> None:
    """Check counts and bits of random and hostile scenes, of each kind in turn, as time allows."""
    total = {kind: dict.fromkeys(FOUND, 0) for kind in KINDS}
    ends = time.perf_counter() + SCENE_SECONDS
    for k in range(run.most(SCENES, 1)):
        for kind, sums in total.items():
            if run.quick or time.perf_counter() < ends:
                found = compare_scene(run.device, kind, k, 0)
                sums.update({name: sums[name] + found[name] for name in FOUND})
    for kind, sums in total.items():
        is_same = sums["wrong"] == sums["wrong_bits"] == 0
        run.report.check(f"{sums['scenes']} scenes, {kind}: counts and bits as the CPU's", is_same)
    for name, must in {"scenes": 200, "samples": None, "pairs": None}.items():
        n = sum(sums[name] for sums in total.values())
        run.report.add(f"random and hostile scenes: {name}", n, name, must=run.limit(must))
    if not run.quick and run.has_time(20, "20,000 x 20,000 px"):
        mesh, camera, poses, _ = huge()
        with run.open(mesh, camera) as ours:
            n_samples, n_wrong = compare_counts(ours, poses)
        run.report.add("20,000 x 20,000 px: samples", n_samples, "samples")
        run.report.check("20,000 x 20,000 px: counts as the CPU's", n_wrong == 0)


# --- counts ---------------------------------------------------------------------------------------


class Timed:
    """A program of which each run is timed by itself."""

    def __init__(self, program: moderngl.ComputeShader, finish: Callable[[], None]) -> None:
        self.program, self._finish, self.seconds = program, finish, 0.0

    def __contains__(self, name: str) -> bool:
        return name in self.program

    def __getitem__(self, name: str) -> object:
        return self.program[name]

    def run(self, *groups: int) -> None:
        """Run it, from an idle device to an idle device."""
        self._finish()
        started = time.perf_counter()
        self.program.run(*groups)
        self._finish()
        self.seconds += time.perf_counter() - started


def add_profile(run: Run, what: str, strategy: object, count: Callable[[], None], n: int) -> None:
    """Times of the steps, each by itself; their sum is more than that of all in a row."""
    honest = dict(vars(strategy))
    steps = {name: Timed(honest[f"_{name}"], run.device.gl.finish) for name in STEPS}
    vars(strategy).update({f"_{name}": step for name, step in steps.items()})
    try:
        count()
    finally:
        vars(strategy).update({f"_{name}": honest[f"_{name}"] for name in STEPS})
    for name, step in steps.items():
        run.report.add(f"{what}: step {name}", step.seconds / n * 1e6, "us a pose")


STEPS = ("setup", "list", "scan", "fill")


def compare(run: Run, row: Row) -> None:
    """Check all counts of a row against the CPU's, and add times."""
    report, mesh, what = run.report, row.cell.mesh(), row.what
    n = run.most(max(16, min(1024, MOST_PAIRS // mesh.n_faces)), 2)
    poses = poses_of(mesh, n, is_within=row.is_within)
    with run.open(mesh, row.camera) as ours, rc.open_rasterizer(mesh, row.camera, "cpu") as cpu:
        seen, expected = ours.count(poses), cpu.count(poses)
        is_same = all(
            np.array_equal(getattr(seen, name), getattr(expected, name))
            for name in ("visible", "drawn", "background")
        )
        report.check(f"{what}: counts as on the CPU, {n} poses", is_same)
        strategy, scene = ours._strategy, ours._scene
        prepared = strategy.prepare(scene, poses, scene.grid)

        def count_there(*, drawn: bool) -> None:
            for rows in strategy.batches(n):
                strategy.begin(prepared, rows)
                tiles = scene.grid.tiles(strategy.tile)
                number = rows.stop - rows.start
                strategy.fill_counters(scene, number, tiles, drawn=drawn, backs=drawn)
            run.device.gl.finish()

        turns = run.most(TURNS, 1)
        times = {
            "visible, left on the device": lambda: count_there(drawn=False),
            "visible and drawn, left there": lambda: count_there(drawn=True),
            "count(), visible": lambda: ours.count(poses, drawn=False),
            "the CPU, visible": lambda: cpu.count(poses, drawn=False),
        }
        found = {name: seconds_of(call, turns) / n * 1e6 for name, call in times.items()}
        for name, taken in found.items():
            must = run.limit(row.must_us) if name.endswith("on the device") else None
            report.add(f"{what}: {name}", taken, "us a pose", at_most=must)
        own = found["visible, left on the device"]
        report.add(f"{what}: CPU over device", found["the CPU, visible"] / own, "times")
        add_profile(run, what, strategy, lambda: count_there(drawn=True), n)
    add_nvdiffrast(run, row, mesh, poses, own)


def add_nvdiffrast(run: Run, row: Row, mesh: rc.Mesh, poses: FloatArray, own: float) -> None:
    """Time of nvdiffrast with counts, on the first CUDA device."""
    if importlib.util.find_spec("nvdiffrast") is None or importlib.util.find_spec("torch") is None:
        return
    import nvdiffrast.torch as dr
    import torch

    camera, n_faces = row.camera, mesh.n_faces
    context = dr.RasterizeCudaContext()
    faces = torch.tensor(mesh.faces.astype(np.int32), device="cuda")
    points = np.column_stack((mesh.vertices, np.ones(mesh.n_vertices)))
    points = torch.tensor(points.astype(np.float32), device="cuda")
    near, far = 1e-3 * mesh.diagonal, 10 * mesh.diagonal
    w, h = camera.width, camera.height
    to_clip = np.zeros((4, 4))
    to_clip[0, [0, 2]] = 2 * camera.fx / w, 2 * camera.cx / w - 1
    to_clip[1, [1, 2]] = 2 * camera.fy / h, 2 * camera.cy / h - 1
    to_clip[2, 2:] = (far + near) / (far - near), -2 * far * near / (far - near)
    to_clip[3, 2] = 1
    matrices = torch.tensor((to_clip @ np.linalg.inv(poses)).astype(np.float32), device="cuda")
    step = max(1, min(64, (1 << 27) // (w * h)))

    def count() -> torch.Tensor:
        for first in range(0, len(poses), step):
            some = matrices[first : first + step]
            corners = (points @ some.transpose(1, 2)).contiguous()
            image, _ = dr.rasterize(context, corners, faces, (h, w))
            ids = image[..., 3].long().reshape(len(some), -1)
            ids += (n_faces + 1) * torch.arange(len(some), device="cuda")[:, None]
            counts = torch.bincount(ids.ravel(), minlength=(n_faces + 1) * len(some))
        torch.cuda.synchronize()
        return counts

    taken = seconds_of(count) / len(poses) * 1e6
    run.report.add(f"{row.what}: nvdiffrast, with counts", taken, "us a pose")
    must = run.limit(row.must_times)
    run.report.add(f"{row.what}: nvdiffrast over device", taken / own, "times", must=must)


def compare_all(run: Run) -> None:
    """Counts of all rows."""
    if importlib.util.find_spec("nvdiffrast") is None:
        print("nvdiffrast is not installed: it is not timed")
    for row in ROWS:
        if run.quick and row.cell.n_faces > 100_000:
            continue
        if run.has_time(8, row.what):
            compare(run, row)


# --- bits -----------------------------------------------------------------------------------------

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


def judge(run: Run, row: Row, n_pairs: int) -> None:
    """Check the bits of poses of a row by all tasks, then the time of a million poses."""
    report, mesh, camera, what = run.report, row.cell.mesh(), row.camera, row.what
    if row.is_within:
        mesh = mesh.with_groups(two_sided="all")
    nearest, farthest = (0.01, 0.6) if row.is_within else (0.5, 1.4)
    camera = replace(camera, focus_range=(nearest * mesh.diagonal, farthest * mesh.diagonal))
    n = max(4, n_pairs // (mesh.n_faces * len(TASKS)))
    poses = poses_of(mesh, n, is_within=row.is_within)
    with run.open(mesh, camera) as ours, rc.open_rasterizer(mesh, camera, "cpu") as cpu:
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
        if row.must_s is not None:
            judge_a_million(run, row, ours, poses, criteria)


def judge_a_million(
    run: Run, row: Row, ours: GLRasterizer, poses: FloatArray, criteria: Criteria
) -> None:
    """Time of a million poses to bits, and memory that stays after them."""
    many = np.resize(poses, (run.most(MILLION, 8), 4, 4))
    ours._judge(many[:4096], criteria)
    before, started = resident_mib(), time.perf_counter()
    result, _ = ours._judge(many, criteria)
    seconds = time.perf_counter() - started
    what = f"{row.what}: {len(many):,} poses to bits, areas and views"
    run.report.add(what, seconds, "s", at_most=run.limit(row.must_s))
    step = len(poses)
    is_same = all(
        np.array_equal(result.packed[at : at + step], result.packed[: len(many) - at][:step])
        for at in range(0, len(many), step)
    )
    run.report.check(f"{what}: the same at each turn", is_same)
    size = result.packed.nbytes / 2**20
    run.report.add(f"{what}: memory beyond the bits", resident_mib() - before - size, "MiB")


def judge_all(run: Run) -> None:
    """Bits of all rows of few faces."""
    small = [row for row in ROWS if row.cell.n_faces <= 30_000 and row.name != "1,024 faces"]
    for row in small:
        if run.has_time(12, f"bits of {row.what}"):
            judge(run, row, run.most(N_PAIRS, 0) // len(small))


# --- the way through ------------------------------------------------------------------------------

PLAN = """
[[meshes]]
built_in = "torus"
[camera]
width = 256
height = 256
hfov_deg = 50
[task]
method = "sampled"
max_incidence_deg = 65
[[candidates]]
generator = "on_sphere"
count = {count}
stand_off = [2, 4]
[selection]
goal = "fewest_cameras"
coverage = 0.9
"""


def place_many(run: Run) -> None:
    """Time of `place` with a million candidates, by the device that "auto" takes."""
    count = run.most(1_000_000, 200)
    if not run.has_time(25, f"place with {count:,} candidates"):
        return
    with tempfile.TemporaryDirectory() as folder:
        path, out = Path(folder, "plan.toml"), Path(folder, "out")
        path.write_text(PLAN.format(count=count))
        started = time.perf_counter()
        rc.place(path, out=out)
        seconds = time.perf_counter() - started
        made = json.loads(Path(out, "plan.json").read_text())
    backend = made["made_from"]["measured_by"]["backend"]
    what = f"place, {count:,} candidates of 10,000 faces, on {backend}, from file to certified plan"
    run.report.add(what, seconds, "s", at_most=run.limit(60.0), aim=20.0)
    run.report.check(f"{what}: both shares", made["certified_area"]["percent"] > 80)


def find_border(run: Run) -> None:
    """Pairs from which on bits are sooner judged on the device than on the CPU."""
    mesh = rc.shapes.torus()
    camera, task = rc.Camera.from_fov(256, 256, hfov_deg=50), rc.Task(max_incidence_deg=65)
    sizes = (2, 4) if run.quick else (256, 16_384)
    if not run.has_time(15, "border of pairs"):
        return
    taken: dict[str, list[float]] = {}
    for method in ("sampled:cpu", f"sampled:{run.label}"):
        for n in sizes:
            poses = poses_of(mesh, n, is_within=False)

            def evaluate(poses=poses, method=method) -> None:
                rc.evaluate(mesh, camera, poses, task, method=method, fields=("covered",))

            seconds = seconds_of(evaluate, 1)
            taken.setdefault(method, []).append(seconds)
            what = f"evaluate to bits, {n:,} poses of 10,000 faces, {method}"
            run.report.add(what, seconds, "s")
    started = time.perf_counter()
    drawer().find_gpu()
    tested = time.perf_counter() - started
    run.report.add("self-test in a process of its own", tested, "s")
    (few, many), faces = sizes, mesh.n_faces
    rates = [(b - a) / ((many - few) * faces) for a, b in taken.values()]
    fixed = [
        max(0.0, a - rate * few * faces) for (a, _), rate in zip(taken.values(), rates, strict=True)
    ]
    gain = rates[0] - rates[1]
    for name, more in (("opening", 0.0), ("opening and self-test", tested)):
        pairs = max(0.0, fixed[1] + more - fixed[0]) / gain if gain > 0 else float("inf")
        run.report.add(f"the device is faster, with {name}, from", min(pairs, 1e18), "pairs")


def cpu_ratios(run: Run) -> None:
    """Time of `evaluate`, sampled on the CPU, over that of counting with drawn."""
    mesh, camera = rc.shapes.torus(), rc.Camera.from_fov(256, 256, hfov_deg=50)
    poses, task = poses_of(mesh, run.most(1024, 8), is_within=False), rc.Task(max_incidence_deg=65)
    for threads in dict.fromkeys((2, os.cpu_count() or 2)):
        if not run.has_time(8, f"CPU ratios, {threads} threads"):
            continue
        with rc.open_rasterizer(mesh, camera, "cpu", threads=threads, roll=0.4) as cpu:
            counted = seconds_of(lambda cpu=cpu: cpu.count(poses))
        for name, fields, must, aim in (
            ("bits", ("covered",), 1.25 if threads == 2 else 1.5, 1.1 if threads == 2 else 1.2),
            ("default fields", None, 2.0, 1.5),
        ):

            def evaluate(fields=fields, threads=threads) -> None:
                engine = rc.Engine("sampled", "cpu", threads=threads)
                rc.evaluate(mesh, camera, poses, task, method=engine, fields=fields)

            what = f"CPU, {threads} threads: evaluate, {name}, over count with drawn"
            ratio = seconds_of(evaluate) / counted
            run.report.add(what, ratio, "times", at_most=run.limit(must), aim=aim)


PARTS = {
    "counts": compare_all,
    "bits": judge_all,
    "scenes": check_scenes,
    "place": place_many,
    "border": find_border,
    "cpu": cpu_ratios,
}


def main() -> None:
    """Check and time every row on one device."""
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--device", default="auto", help="as of open_rasterizer; auto by default")
    parser.add_argument("--quick", action="store_true", help="few poses, and no limit on times")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS), help="parts")
    parser.add_argument("--output", type=Path, metavar="FILE", help="write the rows as JSON, too")
    args = parser.parse_args()
    report, started = Report(prints=not args.json), time.perf_counter()
    with open_context(args.device) as device:
        about = f"{device.info.renderer}, {device.info.version}"
        atomics = 64 if device.info.has_int64_atomics else 32
        print(f"{about}; {atomics}-bit atomics")
        run = Run(device, report, quick=args.quick)
        for name in args.only:
            PARTS[name](run)
    most = None if args.quick else float(SECONDS)
    report.add("all of it", time.perf_counter() - started, "s", at_most=most)
    if args.output:
        made = {"device": about, "atomics": atomics, "machine": machine(), "rows": report.rows}
        args.output.write_text(json.dumps(made, indent=2))
    report.finish(args.json)


if __name__ == "__main__":
    main()
