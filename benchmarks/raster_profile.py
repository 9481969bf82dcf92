"""Time of the CPU rasteriser, pass by pass, beside the limits of this machine.

CPU time of one thread, medians over rounds of several poses. All passes are in one compiled loop,
`count_poses`; so it is compiled once more from its source with a question before each pass, whether
to continue, and the time of a pass is by how much longer the poses take with it. The question
is answered while the loop runs, so that what comes before it is the same code with the pass and
without. The processor works on two passes at once where it can, so the figures are good to 10 % or
so, and those of passes that take next to nothing can be below 0. "set up" and filling are known
less well apart than together: with the same code the one moved between 5 and 9 ns a face from one
process to the next, and the other by about as much the other way. "questions" is by how much longer
all passes take with them; the further it is from 0, the less figures say about the loop itself.

"empty counts" are the zeros that a pose begins with, and "clear" the depths. "set up" is of small
faces only: "fill wide" and "clip" do all that they do to their faces. "outside" is what `count`
takes beyond `count_poses`: checking poses, near planes, and the memory of the result. A cluster is
looked at once in each band of rows that it reaches. Samples are covered by all faces that may not
be left out, hidden or not.

The simple loops are what passes must do at the least: `project` streams vertices through a 3 x 3
matrix and a division, `cull and bin` gathers the corners of each face and takes its area, filling
compares and writes a vector of samples at a time.
"""

import importlib.util
import math
import re
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from unittest import mock

import numpy as np
from contest import Cell
from rows import Report, arguments

import rastercov as rc
from rastercov.camera.near_plane import limits
from rastercov.kernels import raster_fill, raster_loops
from rastercov.kernels.jit import compiled
from rastercov.raster.cpu import MAX_BAND, _Scene, _Worker
from rastercov.raster.sample_grid import SampleGrid

CELLS = (
    *(Cell("closed", n, *size) for n in (10_000, 100_000, 1_000_000)
      for size in ((1280, 1024), (256, 256))),
    Cell("open", 10_000, 1280, 1024),
    Cell("interior", 15_000, 1280, 1024),
)  # fmt: skip

SHORTEST = 0.02
"""Seconds that are timed at least, in as many calls as it takes."""

ENOUGH = 100
"""Things in a pose from which on the time of each says something."""


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--poses", type=int, default=4)
    parser.add_argument("--shuffled", action="store_true", help="faces in random order")
    args = parser.parse_args()
    report = Report()
    machine(report)
    profiled = stepped(), counted()
    for cell in CELLS:
        mesh = cell.mesh()
        if args.shuffled:
            faces = np.random.default_rng(1).permutation(mesh.faces)
            mesh = rc.Mesh(vertices=mesh.vertices, faces=faces)
        profile(report, cell, mesh, args.poses, args.rounds, *profiled)
    report.finish(args.json)


# --- the machine ----------------------------------------------------------------------------------


@compiled
def transform(x, y, z, rotation, u, v):
    """Points times a matrix, divided by their depth."""
    for i in range(len(x)):
        w = 1.0 / (x[i] * rotation[0, 2] + y[i] * rotation[1, 2] + z[i] * rotation[2, 2])
        u[i] = (x[i] * rotation[0, 0] + y[i] * rotation[1, 0] + z[i] * rotation[2, 0]) * w
        v[i] = (x[i] * rotation[0, 1] + y[i] * rotation[1, 1] + z[i] * rotation[2, 1]) * w


@compiled
def areas(steps, faces):
    """Number of faces with a positive area in the image."""
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
        points = np.ascontiguousarray((mesh.vertices + np.array((0, 0, 4))).T)
        out = np.empty((2, mesh.n_vertices))
        seconds = _least(lambda p=points, o=out: transform(*p, rotation, *o))
        what = f"simple loop, {mesh.n_faces:,} faces"
        report.add(f"{what}: a vertex to the image", 1e9 * seconds / mesh.n_vertices, "ns/vertex")
        seconds = _least(lambda s=steps, f=faces: areas(s, f))
        report.add(f"{what}: area of a face", 1e9 * seconds / mesh.n_faces, "ns/face")
    for n in (256 * 256, MAX_BAND):
        depth, owner = np.zeros(n, np.float32), np.zeros(n, np.int32)
        what = f"simple loop, {n:,} samples"
        seconds = _least(lambda d=depth, o=owner: compare_and_write(d, o, 100)) / 100
        report.add(f"{what}: compare and write a sample", 1e9 * seconds / n, "ns/sample")
        seconds = _least(lambda d=depth: [d.fill(0) for _ in range(100)]) / 100
        report.add(f"{what}: clear the depth of a sample", 1e9 * seconds / n, "ns/sample")


def _least(work) -> float:
    """Least CPU time of a call, seconds."""
    return min(_seconds(work) for _ in range(9))


def _seconds(work: Callable[[], object], times: int = 1) -> float:
    """Mean CPU time of a call, in seconds."""
    started = time.thread_time()
    for _ in range(times):
        work()
    return (time.thread_time() - started) / times


# --- the loops, with questions --------------------------------------------------------------------


def _before(marker: str, *lines: str) -> tuple[str, str]:
    """An edit of a source: these lines before the marker, indented as it is."""
    indent = marker[: len(marker) - len(marker.lstrip())]
    return marker, "".join(f"{indent}{line}\n" for line in lines) + marker


def _unless_wanted(marker: str, leave: str) -> tuple[str, str]:
    """An edit: nothing from the marker on, to the end of the function, unless the pass is done."""
    return _before(marker, "if not WANTED:", f"    {leave}")


CULL = "        cull_pose(\n"
LISTED = "    n_samples = buffers.n_marks"
CLEAR_MARKS = "    for strip in range(buffers.n_marks):\n"
CLEAR_ALL = "    if is_clear:\n        for sample"
PROJECTED = "    if low_x == BEHIND and high_x == BEHIND:"
BIN = "    faces = Faces(mesh, cluster.first_slot, vertices"
FILL = "    filled, n_tried = 0, n.wide * LANES\n"
SAMPLES = "        if small:\n            filled"
FILL_BLOCKS = "            filled += fill_blocks_2x2("
IN_TILES = "        if in_tiles:\n"
WIDE = "    if n.wide:\n"
CLIP = "        filled += fill_any(scratch.identity, n_parts"

PASSES = {
    "empty counts": (),
    "cull clusters": (_unless_wanted(CULL, "continue"),),
    "project": (_unless_wanted(LISTED, "return 0"),),
    "clear": (
        (CLEAR_MARKS, "    for strip in range(buffers.n_marks if WANTED else 0):\n"),
        (CLEAR_ALL, "    if is_clear and WANTED:\n        for sample"),
        _unless_wanted(PROJECTED, "return 0, 0, 0"),
    ),
    "cull and bin": (_unless_wanted(BIN, "return 0, 0, 0"),),
    "set up": (_unless_wanted(FILL, "return 0, 0, 0"),),
    # These are bits, to do without more branches: all are set, or none.
    "fill 2 x 2 samples": ((SAMPLES, "        if small & target.WANTED:\n            filled"),),
    "fill 2 x 2 blocks": (
        (
            "        if count_bits(in_blocks) < ",
            "        if count_bits(in_blocks & target.WANTED) < ",
        ),
    ),
    "fill tiles": ((IN_TILES, "        if in_tiles & target.WANTED:\n"),),
    "fill wide": ((WIDE, "    if n.wide and WANTED:\n"),),
    "clip": (("        if n_clipped:\n", "        if n_clipped and WANTED:\n"),),
}
"""The passes in their order, and edits of the source that ask whether each is WANTED."""

WORK = (
    "clusters looked at",
    "vertices in them",
    "clusters that reach samples",
    "faces in them",
    "faces kept, tiny",
    "faces kept, small",
    "faces kept, large",
    "faces to be clipped",
    "small faces, 16 at once",
    "small faces, one by one",
    "triangles left by clipping",
)
COUNTED = (
    _before(
        PROJECTED,
        "counts.visible[0] += 1",
        "counts.visible[1] += cluster.end_vertex - cluster.first_vertex",
    ),
    _before(
        BIN,
        "counts.visible[2] += 1",
        "for slot in range(cluster.first_slot, cluster.end_slot):",
        "    counts.visible[3] += mesh.corners[slot] != 0",
    ),
    _before(
        FILL,
        "counts.visible[4] += n.samples_2x2",
        "counts.visible[5] += n.larger",
        "counts.visible[6] += n.wide",
        "counts.visible[7] += n.clipped",
    ),
    (SAMPLES, SAMPLES.replace("small", "small < 0")),
    (
        FILL_BLOCKS,
        "            target.counts.visible[8] += count_bits(in_blocks)\n"
        f"            if in_blocks < 0:\n    {FILL_BLOCKS}",
    ),
    (
        IN_TILES,
        "        target.counts.visible[9] += count_bits(in_tiles)\n        if in_tiles < 0:\n",
    ),
    (WIDE, "    if n.wide < 0:\n"),
    (
        CLIP,
        "        target.counts.visible[10] += n_parts\n" + CLIP.replace("n_parts", "0"),
    ),
)
"""Edits that put what there is to do in the place of counts, and fill nothing."""


def stepped() -> Callable[..., None]:
    """`count_poses` that does the passes only for which there is -1, not 0, in `drawn[0]`.

    Where only visible samples are counted, it has no other use.
    """
    edits = []
    for k, questions in enumerate(PASSES.values()):
        edits += [
            (marker, text.replace("WANTED", f"counts.drawn[{k}]")) for marker, text in questions
        ]
    return _edited("stepped", edits)


def counted() -> Callable[..., None]:
    """`count_poses` that puts the figures of `WORK` in the place of counts of faces."""
    return _edited("counted", COUNTED)


def _edited(name: str, edits) -> Callable[..., None]:
    """`count_poses` from `fill` and `loops`, with each marker, which occurs once, replaced."""
    text = Path(raster_fill.__file__).read_text() + Path(raster_loops.__file__).read_text()
    # Not cached on disk.
    text = text.replace(
        "from rastercov.kernels.jit import compiled, part_of\n",
        "import numba\nfrom rastercov.kernels.jit import part_of\n"
        'compiled = numba.njit(nogil=True, error_model="numpy")\n',
    )
    text = re.sub(r"from rastercov\.raster\.cpu\.fill import \([^)]*\)\n", "", text)
    for marker, replacement in edits:
        times = text.count(marker)
        assert times == 1, f"{marker!r} must occur once in the loops, occurs {times} times"
        text = text.replace(marker, replacement)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, f"{name}.py")
        file.write_text(text)
        spec = importlib.util.spec_from_file_location(name, file)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    return module.count_poses


# --- the passes -----------------------------------------------------------------------------------


def profile(
    report: Report,
    cell: Cell,
    mesh: rc.Mesh,
    n_poses: int,
    rounds: int,
    steps: Callable[..., None],
    count_work: Callable[..., None],
) -> None:
    """Time of each pass in this scene, and how much each had to do."""
    poses = cell.poses(mesh, n_poses)
    near, cull, _ = limits(mesh, cell.camera, poses)
    scene, grid = _Scene(mesh), SampleGrid(cell.camera)
    worker = _Worker(scene, grid)
    worker.memory.no_drawn = np.zeros((1, len(PASSES)), np.int32)
    visible, filled = np.empty((n_poses, mesh.n_faces), np.int32), np.empty(n_poses, np.int64)
    given = []
    with mock.patch.object(raster_loops, "count_poses", lambda *arguments: given.extend(arguments)):
        worker.count((poses, near, cull), worker.all_bands, visible, None, filled)

    def first_passes(n: int) -> Callable[[], None]:
        def work() -> None:
            worker.memory.no_drawn[0, :n], worker.memory.no_drawn[0, n:] = -1, 0
            steps(*given)

        return work

    what = f"{cell.scene}, {mesh.n_faces:,} faces, {cell.width} x {cell.height}"
    count_work(*given)
    work = visible[:, : len(WORK)].mean(axis=0)
    with rc.open_rasterizer(mesh, cell.camera, "cpu", threads=1) as rasterizer:
        timed = [first_passes(n + 1) for n in range(len(PASSES))]
        timed += [
            lambda: raster_loops.count_poses(*given),
            lambda: rasterizer.count(poses, drawn=False),
            lambda: rasterizer.count(poses, drawn=True),
        ]
        for call in timed:
            call()
        counts = rasterizer.count(poses)
        timed[len(PASSES) - 1]()
        report.check(f"{what}: as counted without questions", (visible == counts.visible).all())
        times = math.ceil(SHORTEST / _seconds(timed[len(PASSES)]))
        spent = [[_seconds(call, times) for call in timed] for _ in range(rounds)]
    medians = 1e6 * np.median(spent, axis=0) / n_poses
    plain, total, both = medians[len(PASSES) :]
    passes = np.diff(medians[: len(PASSES)], prepend=0.0)
    clusters, vertices, _, faces, tiny, small, large, clipped, together, alone, _ = work
    n_clusters = len(scene.clusters.vertex_starts) - 1
    elements = (
        (mesh.n_faces, "face"),
        (n_clusters, "cluster"),
        (vertices, "vertex"),
        (clusters, "cluster"),
        (faces, "face"),
        (tiny + small, "face"),
        (tiny, "triangle"),
        (together, "triangle"),
        (alone, "triangle"),
        (large, "triangle"),
        (clipped, "face"),
    )
    for name, value, (n, unit) in zip(PASSES, passes, elements, strict=True):
        report.add(f"{what}: {name}", value, "us/pose")
        if n >= ENOUGH:
            report.add(f"{what}: {name}, each", 1e3 * value / n, f"ns/{unit}")
    samples = _samples_covered(mesh, poses, cull, counts)
    filling = passes[list(PASSES).index("fill 2 x 2 samples") :].sum()
    report.add(f"{what}: filling, each sample covered", 1e3 * filling / samples, "ns/sample")
    report.add(f"{what}: questions", medians[len(PASSES) - 1] - plain, "us/pose")
    report.add(f"{what}: outside", total - plain, "us/pose")
    report.add(f"{what}: all, visible only", total, "us/pose")
    report.add(f"{what}: all, drawn too", both, "us/pose")
    report.add(f"{what}: clusters of the mesh", n_clusters, "in all")
    for name, value in zip(WORK, work, strict=True):
        report.add(f"{what}: {name}", value, "a pose")
    report.add(f"{what}: samples covered", samples, "a pose")


def _samples_covered(mesh: rc.Mesh, poses, cull, counts: rc.FaceCounts) -> float:
    """Samples in a pose of the faces that are not left out as they turn their back."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    n = 0
    for pose, hides, drawn in zip(poses, cull, counts.drawn, strict=True):
        is_front = np.einsum("fk,fk->f", normals, pose[:3, 3] - a) > 0
        n += drawn[is_front].sum() if hides else drawn.sum()
    return n / len(poses)


if __name__ == "__main__":
    main()
