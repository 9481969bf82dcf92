"""Selection from more pairs than the memory holds: bits in a file, lazy greedy, bound of all.

`generated` writes bits of candidates that cover parts of caps of a sphere, a tenth of its faces
each, and selects from the mapped file in a process of its own, by both goals. `small` compares it
with selection from lists. `place` runs a plan of many candidates, measured by worker processes, and
takes the memory of the head. `rates` measures what a larger plan is computed from: time and bytes a
pose of 100,000 faces, the file of bits, and a pass over it.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from rows import Report, arguments

import rastercov as rc
from rastercov.core.mesh import shapes
from rastercov.placement import matrix_folder as bit_file
from rastercov.placement.bits import CoveredBits, n_words, spread_out
from rastercov.placement.matrix import VisibilityMatrix, build_matrix
from rastercov.placement.select import bounds
from rastercov.placement.select.cover import CoverState, LazyCover
from rastercov.placement.select.methods import EFFORT, construct_cover, improve, select_greedy
from rastercov.placement.select.presolve import presolve
from rastercov.placement.select.problem import (
    BestCoverage,
    FewestCameras,
    Goal,
    Problem,
    finish,
    problem_of,
    problem_of_matrix,
)

PARTS = ("generated", "small", "place", "rates")
ROWS_AT_ONCE = 500
GOALS: dict[str, Goal] = {
    "8 cameras": BestCoverage(cameras=8),
    "95 %": FewestCameras(0.95, of_reachable=True),
}


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--only", choices=PARTS, action="append", help="parts; all unless given")
    parser.add_argument("--candidates", type=int, default=20_000, help="of `generated`")
    parser.add_argument("--faces", type=int, default=100_000, help="of `generated`")
    parser.add_argument("--count", type=int, default=100_000, help="candidates of `place`")
    parser.add_argument("--workers", type=int, default=2, help="of `place`; 0 for none")
    parser.add_argument("--select-in", type=Path, help="(for the process that selects)")
    args = parser.parse_args()
    if args.select_in:
        print(json.dumps(_selected(args.select_in, args.candidates, args.faces)))
        return
    report = Report()
    for part in args.only or PARTS:
        if part == "generated":
            generated(report, args.candidates, args.faces)
        elif part == "small":
            small(report)
        elif part == "place":
            placed(report, args.count, args.workers)
        else:
            rates(report)
    report.finish(args.json)


# --- generated bits -------------------------------------------------------------------------------


def caps(n_candidates: int, n_faces: int, seed: int = 0):
    """Rows of candidates, some at a time: parts of caps of a sphere, a tenth of its faces each."""
    rng = np.random.default_rng(seed)
    face = rng.normal(size=(n_faces, 3))
    face /= np.linalg.norm(face, axis=1)[:, None]
    # Neighbours on the sphere are neighbours in number, about as in a mesh.
    order = np.lexsort((face[:, 0], np.floor(8 * face[:, 1]), np.floor(8 * face[:, 2])))
    face = face[order].astype(np.float32)
    for start in range(0, n_candidates, ROWS_AT_ONCE):
        n = min(ROWS_AT_ONCE, n_candidates - start)
        axis = rng.normal(size=(n, 3))
        axis /= np.linalg.norm(axis, axis=1)[:, None]
        cosine = axis.astype(np.float32) @ face.T
        least = rng.uniform(0.64, 0.86, (n, 1)).astype(np.float32)
        phase = rng.uniform(0, 6, (n, 1)).astype(np.float32)
        yield (cosine > least) & (np.sin(20 * cosine + phase) > -0.8)


def generated(report: Report, n_candidates: int, n_faces: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path, n_pairs = Path(folder, "covered.words"), 0
        with path.open("wb") as file:
            for part in caps(n_candidates, n_faces):
                padded = np.zeros((len(part), 64 * n_words(n_faces)), bool)
                padded[:, :n_faces] = part
                file.write(np.packbits(padded, axis=1, bitorder="little").tobytes())
                n_pairs += int(part.sum())
        size = path.stat().st_size
        command = [sys.executable, __file__, "--select-in", str(path)]
        command += ["--candidates", str(n_candidates), "--faces", str(n_faces)]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
    name = f"{n_candidates:,} x {n_faces:,}"
    report.add(f"{name}: pairs", n_pairs, "pairs")
    report.add(f"{name}: covered", 100 * n_pairs / n_candidates / n_faces, "% of the faces")
    report.add(f"{name}: bits", size / 2**20, "MiB")
    content = json.loads(done.stdout)
    report.add(f"{name}: memory of the process at most", content["peak"], "MiB", at_most=2048)
    for goal, figures in content["goals"].items():
        report.check(f"{goal}: the bound holds", figures.pop("holds"))
        for what, (value, unit) in figures.items():
            report.add(f"{goal}: {what}", value, unit)


def _selected(path: Path, n_candidates: int, n_faces: int) -> dict[str, object]:
    """Figures of the selections from a file of bits, and the peak of this process."""
    words = np.memmap(path, "<u8", "r", shape=(n_candidates, n_words(n_faces)))
    bits = CoveredBits.of(words, n_faces)
    weights = np.random.default_rng(1).random(n_faces)
    for goal in (BestCoverage(2), FewestCameras()):  # loads the loops
        select_greedy(_problem(CoveredBits.from_dense(np.eye(4)), np.ones(4), goal), core_pairs=1)
    goals = {name: _steps(_problem(bits, weights, goal)) for name, goal in GOALS.items()}
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {"peak": peak, "goals": goals}


def _problem(bits: CoveredBits, weights: np.ndarray, goal: Goal) -> Problem:
    n = bits.n_faces
    return Problem(
        bits=bits, weights=weights, views=np.ones(n, np.int64), costs=np.ones(bits.n_rows),
        goal=goal, groups=("all",), face_group=np.zeros(n, np.int32),
    )  # fmt: skip


class _Counted(LazyCover):
    """A cover that counts the gains that it computes."""

    n_gains = 0

    def _gains(self, rows: np.ndarray) -> np.ndarray:
        self.n_gains += len(rows)
        return super()._gains(rows)


def _steps(problem: Problem) -> dict[str, object]:
    """Figures of `select_greedy`, step by step."""
    seconds, passes, priced = {}, 0, bounds._prices_of

    def counted(*arguments):
        nonlocal passes
        passes += 1
        return priced(*arguments)

    def step(name, function):
        started, cpu = time.perf_counter(), time.process_time()
        result = function()
        seconds[name] = [time.perf_counter() - started, "s"]
        seconds[f"{name}, CPU"] = [time.process_time() - cpu, "s"]
        return result

    step("reachable faces, 1 pass", lambda: problem.reachable)
    large = step("presolve, 2 passes", lambda: presolve(problem))
    state = step("greedy rule", lambda: construct_cover(lambda: _Counted(large)))
    n_gains = state.n_gains
    bounds._prices_of = counted
    core, rows, bound = step("bound", lambda: bounds.core_and_bound(large, state))
    bounds._prices_of = priced
    better = CoverState(core)
    better.become(np.flatnonzero(np.isin(rows, list(state.chosen))).tolist())
    better = step("local search", lambda: improve(better, bound, EFFORT, 0))
    plain = large.candidates[state.rank()]
    chosen = core.candidates[better.rank()]
    plain, result = (finish("greedy", problem, each, bound, 0.0) for each in (plain, chosen))
    is_best = isinstance(problem.goal, BestCoverage)
    return seconds | {
        "cameras": [len(plain.chosen), "cameras"],
        "passes of the rule": [n_gains / large.n_candidates, "passes"],
        "  for a camera": [
            (n_gains / large.n_candidates - 1) / max(1, len(plain.chosen)),
            "passes",
        ],
        "passes of the bound": [passes, "passes"],
        "core": [len(rows), "candidates"],
        "rule": [plain.objective, "of the weight" if is_best else "cameras"],
        "after local search": [result.objective, "of the weight" if is_best else "cameras"],
        "bound of all candidates": [result.bound, ""],
        "holds": bool(
            max(plain.objective, result.objective) <= bound + 1e-12
            if is_best
            else min(plain.objective, result.objective) >= bound - 1e-12
        ),
    }


def small(report: Report) -> None:
    """Lists against bits with a core of a tenth: objective, bound and time."""
    covers = np.concatenate(list(caps(4000, 6000)))
    rng = np.random.default_rng(1)
    weights, costs = rng.random(6000), rng.uniform(0.5, 2, 4000)
    for goal, views, of in (
        (BestCoverage(5), 1, None), (BestCoverage(10), 2, None),
        (BestCoverage(budget=3.0), 1, costs),
        (FewestCameras(0.95), 1, None), (FewestCameras(1.0, of_reachable=True), 2, costs),
    ):  # fmt: skip
        lists = problem_of_matrix(covers, goal, weights=weights, views=views, costs=of)
        core = int(covers.sum()) // 10
        one, other = select_greedy(lists), select_greedy(lists, core_pairs=core)
        plain = [select_greedy(lists, effort=0, core_pairs=n).chosen for n in (None, core)]
        name = f"4,000 x 6,000, {goal}, views {views}"
        report.check(f"{name}: the same rule", plain[0].tolist() == plain[1].tolist())
        for what, item in (("lists", one), ("bits, core of a tenth", other)):
            report.add(f"  {what}", item.objective, "")
            report.add(f"  {what}: bound", item.bound, "")
            report.add(f"  {what}: time", item.seconds, "s")


# --- a plan ---------------------------------------------------------------------------------------

PLAN = """
[[meshes]]
built_in = "torus"
[camera]
width = 256
height = 256
fx = 300
fy = 300
[task]
by = "face"
max_incidence_deg = 60
[[candidates]]
generator = "on_sphere"
count = {count}
distances = [4.2]
[selection]
goal = "best_coverage"
cameras = 8
"""


def placed(report: Report, count: int, workers: int) -> None:
    """A plan from its file to the page: `rastercov place`, with the memory of the head alone."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "plan.toml").write_text(PLAN.format(count=count), encoding="utf-8")
        command = [sys.executable, "-m", "rastercov", "place", "plan.toml"]
        command += ["--workers", str(workers)] if workers else []
        started = time.perf_counter()
        process = subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - started
        process.returncode = os.waitstatus_to_exitcode(status)
        report.check("plan: the command succeeds", process.returncode == 0)
        content = json.loads(Path(folder, "plan", "plan.json").read_text(encoding="utf-8"))
        passes = _passes(Path(folder, "plan", "matrix"), content["matrix"]["held_as"])
        n_bytes = sum(path.stat().st_size for path in Path(folder).rglob("pairs-*.npz"))
    selection, n_pairs = content["selection"], content["matrix"]["pairs"]
    name = f"{count:,} x {content['network']['faces']:,}"
    report.check(f"{name}: coverage lies below its bound", selection["share"] <= selection["bound"])
    report.check(f"{name}: held as bits", content["matrix"]["held_as"] == "bits")
    report.add(f"{name}: pairs", n_pairs, "pairs")
    for step, took in content["seconds"]["steps"].items():
        report.add(f"{name}: {step}", took, "s")
    report.add(f"{name}: Parquet", n_bytes / 2**20, "MiB")
    report.add("  a pair", n_bytes / n_pairs, "B")
    report.add(f"{name}: {len(selection['chosen'])} cameras cover", 100 * selection["share"], "%")
    report.add(f"{name}: bound", 100 * selection["bound"], "%")
    report.add(f"{name}: all of it", seconds, "s")
    report.add(f"{name}: read by the rule, a camera", passes, "passes")
    # Of the head: worker processes are not counted, as they are children of it.
    report.add(f"{name}: memory of the head at most", usage.ru_maxrss / 1024, "MiB", at_most=1024)


def _passes(folder: Path, held_as: str) -> float:
    """Passes over the bits of a plan that the greedy rule makes for a camera."""
    if held_as != "bits":
        return 0.0
    matrix = VisibilityMatrix.load(next(folder.iterdir()))
    problem = problem_of(matrix, shapes.by_name("torus"), BestCoverage(8))
    state = construct_cover(lambda: _Counted(presolve(problem)))
    return (state.n_gains / state.large.n_candidates - 1) / max(1, len(state.chosen))


# --- rates ----------------------------------------------------------------------------------------


def rates(report: Report) -> None:
    """CPU time and bytes of a pose of 100,000 faces, of its bits and of a pass over them."""
    mesh, camera = shapes.torus(316, 158), rc.Camera(width=256, height=256, fx=300, fy=300)
    poses, task = rc.sphere_of_poses((0, 0, 0), 4.2, 168), rc.Task(max_incidence_deg=60)
    with rc.open_observer(mesh, camera, threads=1) as observer:
        with tempfile.TemporaryDirectory() as folder:
            build_matrix(observer, poses[:4], task, folder)
        with tempfile.TemporaryDirectory() as folder:
            cpu = time.process_time()
            matrix = build_matrix(observer, poses, task, folder)
            cpu = time.process_time() - cpu
            n_bytes = sum(path.stat().st_size for path in Path(folder).rglob("pairs-*.npz"))
            started = time.process_time()
            bits = matrix.bits()
            derived = time.process_time() - started
    values = spread_out(np.random.default_rng(0).integers(0, 1 << 40, (1, mesh.n_faces)))
    rows = np.tile(np.arange(len(poses)), 20)
    bits.sums(values, rows=rows[:10])
    started = time.process_time()
    bits.sums(values, rows=rows)
    of_pass = time.process_time() - started
    n_covered = int(bits.counts(np.full(bits.n_words, ~np.uint64(0))).sum())
    name = f"{mesh.n_faces:,} faces"
    report.add(f"{name}: CPU of a pose, with its shard", 1000 * cpu / len(poses), "ms")
    report.add(f"{name}: pairs kept", matrix.n_pairs / len(poses), "a pose")
    report.add(f"{name}: pairs covered", n_covered / len(poses), "a pose")
    report.add(f"{name}: Parquet", n_bytes / matrix.n_pairs, "B a pair")
    report.add(f"{name}: bits", 8 * bits.n_words, "B a pose")
    report.add(f"{name}: CPU of bits from shards", 1e9 * derived / matrix.n_pairs, "ns a pair")
    report.add(f"{name}: CPU of a pass", 1e6 * of_pass / len(rows), "us a pose")
    report.add("threads that derive bits at most", bit_file.MOST_THREADS, "threads")


if __name__ == "__main__":
    main()
