"""Time of the long steps of `place` and `check`: matrix, check of a rig, cavities, many candidates.

The last is the command `place`, from its file to the certified plan, by samples: `--jobs sampled
--sampled 1000000` for a million. The results are compared with those of slower ways to them.
Printed are seconds by wall clock and CPU seconds of all threads. Each job runs for a small input
first.
"""

import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from rows import Report, arguments
from solids import drilled_part, with_clamps

import rastercov as rc
from rastercov.core.camera.conventions import read_poses, write_poses
from rastercov.core.coverage.coverage import open_observer
from rastercov.core.coverage.network import Network
from rastercov.core.coverage.task import Reason
from rastercov.core.mesh import Mesh
from rastercov.placement.candidates.cavities import Access, openings
from rastercov.placement.candidates.pool import Framing
from rastercov.placement.matrix import VisibilityMatrix
from rastercov.placement.plan.check import check
from rastercov.placement.plan.file import read_plan
from rastercov.placement.plan.run import place
from rastercov.reference.views import covered_faces

CAMERA = rc.Camera(width=1280, height=1024, fx=1152, fy=1152)
SCENE = """
[[meshes]]
path = "mesh.obj"
[camera]
width = 1280
height = 1024
fx = 1152
fy = 1152
"""
MATRIX = """
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
by = "face"
[[candidates]]
generator = "on_sphere"
count = {count}
distances = [4.2]
[selection]
goal = "best_coverage"
cameras = 1
"""
SAMPLED = """
[[meshes]]
built_in = "torus"
[camera]
width = 256
height = 256
fx = 300
fy = 300
[task]
max_incidence_deg = 60
method = "sampled"
[[candidates]]
generator = "on_sphere"
count = {count}
distances = [4.2]
[selection]
goal = "fewest_cameras"
coverage = 0.9
"""
TASK = """
[task]
views = 3
min_angle_deg = 10
max_incidence_deg = 70
"""
N_COMPARED = 40
"""Candidates of the matrix that are measured again."""


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--candidates", type=int, default=10_000)
    parser.add_argument("--sampled", type=int, default=100_000, help="candidates of that job")
    parser.add_argument("--poses", type=int, default=135)
    parser.add_argument("--jobs", nargs="+", choices=JOBS, default=list(JOBS))
    args = parser.parse_args()
    report = Report()
    with tempfile.TemporaryDirectory() as folder:
        for name in args.jobs:
            JOBS[name](report, args, Path(folder, name))
    report.finish(args.json)


def matrix_rows(report: Report, args, folder: Path) -> None:
    """Visibility matrix of a torus of 10,000 faces, as `place` makes it."""
    plan, small = (
        plan_in(folder / name, MATRIX.format(count=count))
        for name, count in (("whole", args.candidates), ("small", 64))
    )
    place(small, small.folder)
    placed, wall, cpu = timed(lambda: place(plan, plan.folder))
    (iterdir,) = (plan.folder / "matrix").iterdir()
    matrix = VisibilityMatrix.load(iterdir)
    name = f"matrix, {matrix.n_poses:,} candidates x {matrix.n_faces:,} faces"
    report.check(f"{name}: pairs of evaluate", is_same_matrix(matrix, plan))
    report.add(name, placed.steps["visibility matrix"], "s", at_most=15, aim=8)
    report.add(f"{name}: all of place but the page", wall, "s")
    report.add(f"{name}: all of place but the page, CPU", cpu, "CPU-s")


def is_same_matrix(matrix: VisibilityMatrix, plan) -> bool:
    """True if some rows have the coverage and the decisions that `evaluate` gives."""
    rows = np.linspace(0, matrix.n_poses - 1, N_COMPARED).astype(np.int64)
    mesh = rc.shapes.torus()
    judged = rc.evaluate(mesh, plan.rig.cameras[0], matrix.poses[rows], matrix.task, by="face")
    for row, coverage, reason in zip(rows, judged.coverage, judged.reason, strict=True):
        part = slice(matrix.indptr[row], matrix.indptr[row + 1])
        faces = np.flatnonzero(coverage > 0)
        if not np.array_equal(matrix.face[part], faces):
            return False
        if not np.allclose(matrix.coverage[part], coverage[faces], rtol=1e-6, atol=0):
            return False
        if not np.array_equal(matrix.covered[part], reason[faces] == Reason.COVERED):
            return False
    return True


def check_rows(report: Report, args, folder: Path) -> None:
    """`check` of a rig around a part with hollows, each face from 3 cameras 10 degrees apart."""
    mesh = drilled_part(58, 14)
    plan = plan_in(folder, SCENE + TASK, mesh)
    poses = around(mesh, args.poses)
    rig, few = folder / "rig.json", folder / "few.json"
    write_poses(rig, poses)
    write_poses(few, poses[:4])
    check(plan, few, {None: 0.9})
    result, wall, cpu = timed(lambda: check(plan, rig, {None: 0.9}))
    task = plan.build_task()
    reasons = rc.evaluate(mesh, CAMERA, poses, task, fields=("reason",), by="face").reason
    expected = covered_faces(
        reasons == Reason.COVERED,
        poses[:, :3, 3],
        mesh.centroids,
        np.full(mesh.n_faces, 3),
        np.cos(np.radians(10)) + 1e-12,
    )
    name = f"check, {len(poses)} poses x {mesh.n_faces:,} faces"
    report.check(f"{name}: faces of the twin", np.array_equal(result.cameras.covered, expected))
    report.add(name, cpu, "CPU-s", at_most=15, aim=8)
    report.add(f"{name}, wall", wall, "s")


def cavity_rows(report: Report, args, folder: Path) -> None:
    """Cavities of a part with its fixture, for the faces that 200 views around it do not cover."""
    mesh = with_clamps(drilled_part(44, 12))
    size = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
    task = rc.Task(max_incidence_deg=75)
    framing = Framing(stand_off=(0.5 * size, 3 * size))
    with open_observer(mesh, CAMERA) as observer:
        network = Network(mesh, task)
        for batch in network.judge(observer, rc.Poses.of(around(mesh, 200))):
            network.add(batch)
    unseen = np.flatnonzero(mesh.task_mask & ~network.covered)
    openings(mesh, CAMERA, framing, faces=unseen[:2], clearance=0.02)
    result, wall, cpu = timed(lambda: openings(mesh, CAMERA, framing, faces=unseen, clearance=0.02))
    name = f"cavities, {mesh.n_faces:,} faces, {len(unseen):,} uncovered"
    few = slice(None, None, 10)
    made, face = result.candidates.poses[few], result.candidates.index[few]
    seen = rc.evaluate(mesh, CAMERA, made, fields=["visibility"], by="face").visibility[
        np.arange(len(made)), face
    ]
    report.check(f"{name}: each candidate sees its face", bool((seen > 0).all()))
    shut = result.face[result.access == Access.ENCLOSED]
    from_afar = rc.evaluate(
        mesh, CAMERA, around(mesh, 20), fields=["visibility"], by="face"
    ).visibility
    report.check(f"{name}: enclosed faces are never seen", bool((from_afar[:, shut] == 0).all()))
    report.add(name, cpu, "CPU-s", at_most=60, aim=20)
    report.add(f"{name}, wall", wall, "s")


def sampled_rows(report: Report, args, folder: Path) -> None:
    """The command, from the file of a plan to the certified area of what it chooses by samples."""
    plan, out = plan_in(folder / "plan", SAMPLED.format(count=args.sampled)), folder / "out"
    command = [sys.executable, "-m", "rastercov", "place", plan.folder / "plan.toml", "--out", out]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    found = json.loads((out / "plan.json").read_text())
    mesh, rig = rc.shapes.torus(), read_poses(out / "poses.json")
    task = rc.Task(max_incidence_deg=60)
    chosen = rc.evaluate(mesh, plan.rig.cameras[0], rig, task, method="sampled")
    share = 100 * mesh.areas[chosen.network.covered].sum() / mesh.areas.sum()
    area = rc.evaluate(mesh, plan.rig.cameras[0], rig, task).covered.share()
    certified = found["certified_area"]
    name = f"place, {args.sampled:,} candidates x {mesh.n_faces:,} faces, sampled"
    wrong = abs(certified["percent"] - 100 * area)
    report.check(f"{name}: share of evaluate, at least 90 %", abs(share - 90) < 1 and share >= 90)
    report.check(f"{name}: certified area of evaluate", wrong <= certified["bound_percent"])
    report.add(f"{name}: area by samples", share, "%")
    report.add(f"{name}: certified area", certified["percent"], "%")
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    # At most 60 for 100,000.
    report.add(f"{name}: the command", seconds, "CPU-s", at_most=60 * args.sampled / 1e5, aim=20)
    report.add(f"{name}: its memory", after.ru_maxrss / 1024, "MiB")


JOBS = {
    "matrix": matrix_rows,
    "check": check_rows,
    "cavities": cavity_rows,
    "sampled": sampled_rows,
}


def plan_in(folder: Path, text: str, mesh: Mesh | None = None):
    """Plan in a new folder, with its mesh."""
    folder.mkdir(parents=True)
    if mesh is not None:
        lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
        lines += [f"f {a} {b} {c}" for a, b, c in (mesh.faces + 1).tolist()]
        (folder / "mesh.obj").write_text("\n".join(lines))
    (folder / "plan.toml").write_text(text)
    return read_plan(folder / "plan.toml")


def around(mesh: Mesh, count: int):
    """Poses on a sphere around a mesh."""
    size = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
    return rc.sphere_of_poses(mesh.bounds.mean(axis=0), 1.2 * size, count)


def timed(job: Callable):
    """Result, wall and CPU seconds of a job."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = job()
    return result, time.perf_counter() - wall, time.process_time() - cpu


if __name__ == "__main__":
    main()
