"""Where the CPU rasteriser spends its time, pass by pass, beside what this machine can do.

CPU time of one thread, medians over rounds of several poses. "outside" is what `count` takes beyond
the compiled passes: checking poses, near planes, scratch memory, and the memory of the result. The
simple loops are the least that each pass must do: `project` streams vertices through a 3 x 3 matrix
and a division, `set_up` gathers the corners of each face and takes its area, `fill` compares and
writes 16 samples at a time in a tile that stays in cache.
"""

import statistics
import time

import numpy as np
from contest import Cell
from rows import Report, arguments

import rastercov as rc
from rastercov.compiled import compiled
from rastercov.raster import kernels
from rastercov.raster.cpu import _Scene, _View
from rastercov.raster.grid import SampleGrid
from rastercov.raster.rules import limits

CELLS = (
    *(Cell("closed", n, *size) for n in (10_000, 100_000, 1_000_000)
      for size in ((1280, 1024), (256, 256))),
    Cell("open", 10_000, 1280, 1024),
    Cell("interior", 15_000, 1280, 1024),
)  # fmt: skip
PASSES = ("project", "set up", "bin", "fill", "drawn, back faces")


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--poses", type=int, default=8)
    parser.add_argument("--shuffled", action="store_true", help="faces in random order")
    args = parser.parse_args()
    report = Report()
    machine(report)
    for cell in CELLS:
        mesh = cell.mesh()
        if args.shuffled:
            faces = np.random.default_rng(1).permutation(mesh.faces)
            mesh = rc.Mesh(vertices=mesh.vertices, faces=faces)
        profile(report, cell, mesh, args.poses, args.rounds)
    report.finish(args.json)


# --- the machine ----------------------------------------------------------------------------------


@compiled
def transform(points, rotation, out):
    """Points times a matrix, divided by their depth."""
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        w = 1.0 / (x * rotation[0, 2] + y * rotation[1, 2] + z * rotation[2, 2])
        out[i, 0] = (x * rotation[0, 0] + y * rotation[1, 0] + z * rotation[2, 0]) * w
        out[i, 1] = (x * rotation[0, 1] + y * rotation[1, 1] + z * rotation[2, 1]) * w


@compiled
def areas(steps, faces):
    """How many faces have a positive area in the image."""
    n = 0
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ab_x, ab_y = np.int64(steps[b, 0] - steps[a, 0]), np.int64(steps[b, 1] - steps[a, 1])
        ac_x, ac_y = np.int64(steps[c, 0] - steps[a, 0]), np.int64(steps[c, 1] - steps[a, 1])
        n += ab_x * ac_y > ac_x * ab_y
    return n


@compiled
def compare_and_write(depth, owner, times):
    """Write what is nearer, over and over."""
    for k in range(times):
        w = np.float32(k)
        for i in range(len(depth)):
            nearer = w > depth[i]
            depth[i] = w if nearer else depth[i]
            owner[i] = np.int32(k) if nearer else owner[i]


def machine(report: Report) -> None:
    """Memory bandwidth, and the simple loops."""
    there, here = np.ones(1 << 25), np.zeros(1 << 25)
    seconds = _least(lambda: np.copyto(here, there))
    report.add("memory, copied with numpy, read and written", 2e-9 * there.nbytes / seconds, "GB/s")
    fault = _least(lambda: np.empty(1 << 23).fill(0)) - _least(lambda: here[: 1 << 23].fill(0))
    report.add("new memory, beyond writing to it", 1e3 * fault / 64, "ms/MiB")
    rotation = np.eye(3)
    for n in (10_000, 1_000_000):
        mesh = Cell("closed", n, 256, 256).mesh()
        faces = mesh.faces.astype(np.int32)
        steps = (1e4 * mesh.vertices[:, :2]).astype(np.int32)
        out, points = np.empty((mesh.n_vertices, 2)), mesh.vertices + np.array((0, 0, 4))
        seconds = _least(lambda p=points, o=out: transform(p, rotation, o))
        what = f"simple loop, {mesh.n_faces:,} faces"
        report.add(f"{what}: a vertex to the image", 1e9 * seconds / mesh.n_vertices, "ns/vertex")
        seconds = _least(lambda s=steps, f=faces: areas(s, f))
        report.add(f"{what}: area of a face", 1e9 * seconds / mesh.n_faces, "ns/face")
    depth = np.zeros(kernels.TILE_WIDTH * kernels.TILE_HEIGHT, np.float32)
    owner = np.zeros(len(depth), np.int32)
    seconds = _least(lambda: compare_and_write(depth, owner, 100)) / 100
    report.add("simple loop: compare and write a sample", 1e9 * seconds / len(depth), "ns/sample")
    seconds = _least(lambda: [depth.fill(0) for _ in range(100)]) / 100
    report.add("simple loop: clear a tile's depth", 1e6 * seconds, "us/tile")


def _least(work) -> float:
    """Least CPU time of a call, seconds."""
    times = []
    for _ in range(9):
        started = time.thread_time()
        work()
        times.append(time.thread_time() - started)
    return min(times)


# --- the passes -----------------------------------------------------------------------------------


def profile(report: Report, cell: Cell, mesh: rc.Mesh, n_poses: int, rounds: int) -> None:
    """Time of each pass in this scene, and how much each had to do."""
    poses = cell.poses(mesh, n_poses)
    scene, grid = _Scene(mesh), SampleGrid(cell.camera)
    view = _View(scene, grid)
    near, cull, _ = limits(mesh, cell.camera, poses)
    moved = grid.axes(poses).copy()
    moved[:, :3, 3] -= scene.centre
    visible, drawn = np.zeros((2, mesh.n_faces), np.int64)
    with rc.open_rasterizer(mesh, cell.camera, "cpu", threads=1) as rasterizer:
        rasterizer.count(poses, drawn=False)
        spent, whole, work = [], {False: [], True: []}, {}
        for _ in range(rounds):
            spent.append(np.zeros(len(PASSES)))
            for row in range(n_poses):
                times, work[row] = _passes(view, moved[row], near[row], cull[row], visible, drawn)
                spent[-1] += times
            for with_drawn, times in whole.items():
                started = time.thread_time()
                rasterizer.count(poses, drawn=with_drawn)
                times.append(time.thread_time() - started)
    what = f"{cell.scene}, {mesh.n_faces:,} faces, {cell.width} x {cell.height}"
    per_pose = 1e6 * np.median(spent, axis=0) / n_poses
    triangles, listed, lines, samples, tiles = np.mean(list(work.values()), axis=0)
    elements = (mesh.n_vertices, mesh.n_faces, triangles, triangles, mesh.n_faces)
    units = ("vertex", "face", "triangle", "triangle", "face")
    for name, value, n, unit in zip(PASSES, per_pose, elements, units, strict=True):
        if value:
            report.add(f"{what}: {name}", value, "us/pose")
            report.add(f"{what}: {name}, each", 1e3 * value / n, f"ns/{unit}")
    total = 1e6 * statistics.median(whole[False]) / n_poses
    report.add(f"{what}: outside", total - per_pose[:4].sum(), "us/pose")
    report.add(f"{what}: all, visible only", total, "us/pose")
    both = 1e6 * statistics.median(whole[True]) / n_poses
    report.add(f"{what}: all, drawn too", both, "us/pose")
    report.add(f"{what}: triangles kept", triangles, "a pose")
    report.add(f"{what}: triangles listed by tile", listed, "a pose")
    report.add(f"{what}: rows of triangles", lines, "a pose")
    report.add(f"{what}: samples covered, hidden or not", samples, "a pose")
    report.add(f"{what}: tiles filled", tiles, "a pose")


def _passes(view: _View, pose, near, cull, visible, drawn):
    """CPU seconds of each pass, and how much there was to do in one pose."""
    scene, grid, size = view.scene, view.grid, view.size
    rotation, eye = np.ascontiguousarray(pose[:3, :3]), np.ascontiguousarray(pose[:3, 3])
    columns = -(-int(size[0]) // kernels.TILE_WIDTH)
    none = np.empty((0, 0), np.int32), np.empty((0, 0), np.float32)
    placed = view.u, view.v, view.w, view.steps
    visible[:] = drawn[:] = 0
    clock = [time.thread_time()]
    outside = kernels.project(scene.vertices, rotation, eye, grid.lens, near, *placed)
    clock.append(time.thread_time())
    if outside:
        view._grow()
        placed = view.u, view.v, view.w, view.steps
        kernels.project(scene.vertices, rotation, eye, grid.lens, near, *placed)
        clock = [0.0, clock[1] - clock[0]]
        clock = [time.thread_time() - clock[1], time.thread_time()]

    def set_up(side: int) -> int:
        return kernels.set_up(
            scene.vertices, scene.faces, rotation, eye, grid.lens, near, size, side, *placed,
            view.triangles, view.tiles, view.starts,
        )  # fmt: skip

    n = set_up(-1 if cull else 0)
    clock.append(time.thread_time())
    if view.starts[-1] > len(view.listed):
        view.listed = np.empty(int(view.starts[-1] * 1.25), np.int32)
    view.places[:] = view.starts
    kernels.bin_triangles(n, view.tiles, columns, view.starts, view.places, view.listed)
    clock.append(time.thread_time())
    kernels.fill_tiles(
        *placed, size, grid.first, grid.last, view.triangles, view.starts, view.listed, view.depth,
        view.owner, visible, drawn, *none,
    )  # fmt: skip
    clock.append(time.thread_time())
    tiles = np.count_nonzero(np.diff(view.starts))
    work = n, view.starts[-1], _rows_of(view, n), drawn.sum(), tiles
    back = 0.0
    if cull:
        started = time.thread_time()
        n_back = set_up(1)
        kernels.count_drawn(n_back, view.steps, size, grid.first, grid.last, view.triangles, drawn)
        back = time.thread_time() - started
    return np.append(np.diff(clock), back), work


def _rows_of(view: _View, n: int) -> int:
    """Rows of samples that the boxes of the triangles have in the image."""
    v = view.steps[view.triangles[:n, :3], 1]
    low = (v.min(axis=1) + kernels.HALF - 1) >> kernels.BITS
    high = (v.max(axis=1) - kernels.HALF) >> kernels.BITS
    return int(np.sum(np.minimum(high + 1, view.size[1]) - np.maximum(low, 0)))


if __name__ == "__main__":
    main()
