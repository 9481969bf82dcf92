"""Comparison with other ways to the visible fraction of each face: errors, then times.

One question for all: of the image that a face would have alone, inside the border, the fraction
that is seen. Judged are faces whose front is in view, against half planes ("exact"), which are
themselves checked against exact fractions on some of the faces. Other tools get what is best for
them: areas of faces without occlusion from us, where they count pixels, and no ray to a point of a
face that looks away.

Then all poses of a scene are timed in rounds: one contestant after the other in one process, and
medians over the rounds. A contestant that has spent `MOST_SECONDS` in a scene is timed no more.
Contestants whose package is missing are left out with a line.

`--page FILE` writes the tables between the marks of a page, `docs/comparison.md`.
"""

import json
import statistics
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import thesis_table_4_2
from contest import Cell
from embree_packets import EmbreePackets
from numpy.typing import NDArray
from pages_of_tables import write
from peers import VTK, Open3D, what_is_missing
from rows import Report, arguments, machine
from same_faces import wrong_pixels

import rastercov as rc
from rastercov.formats.meshes import READERS
from rastercov.reference import rational
from rastercov.reference.algorithm1 import occlusion
from rastercov.reference.coverage import measure_geometry as face_geometry
from rastercov.reference.models import zhang

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Figures = dict[str, Any]

SIZE = (1280, 1024)
SCENES = {
    "torus": Cell("closed", 10_000, *SIZE),
    "aeroplane": Cell("part", 10_000, *SIZE),
    "teapot": Cell("open", 10_000, *SIZE),
    "room": Cell("interior", 15_000, *SIZE),
}
AS_PRINTED = {"aeroplane": "Plane2", "teapot": "Teapot3"}
"""Meshes of the thesis' Table 4.2 with the face counts of ours."""
THREADS = 2
SEEN = 0.01
"""A face counts as missed when its figure is 0 and more than this fraction of it is visible."""
HIDDEN = 1e-9
CHECKED_BY_FRACTIONS = 12
MOST_SECONDS = 8.0
REFERENCE, PIXELS = "the reference", "one ray or colour per pixel"
ALIKE = 0.01
"""Largest difference of the mean errors within a kind: edges, and float32."""
ALGORITHM_1 = 10_000
"""Most faces for the thesis' algorithm: it takes seconds a pose, and grows with their square."""
PROGRAM = "benchmarks/comparison.py"


@dataclass
class Scene:
    """A mesh, its poses, and the true answers."""

    mesh: rc.Mesh
    camera: rc.Camera
    poses: FloatArray
    visible: FloatArray
    """(P, F) px^2, from either side, by half planes."""
    area: FloatArray
    """(P, F) px^2 of each face alone, within the border."""
    bound: FloatArray
    judged: NDArray[np.bool_]
    """(P, F) faces whose front is in view."""

    @property
    def fraction(self) -> FloatArray:
        """(P, F) visible fraction, 0 where there is no image."""
        return share(self.visible, self.area)


@dataclass
class Contestant:
    """A way from a pose to the visible fraction of each face."""

    name: str
    kind: str
    """Kind of its errors, which all of a kind share."""
    fractions: Callable[[int], FloatArray]
    """(F,) in a pose."""
    work: Callable[[], object]
    """The same for all poses, which is timed."""
    seconds: list[float] = field(default_factory=list)
    spent: float = 0.0


def share(part: FloatArray, whole: FloatArray) -> FloatArray:
    """Quotient, at most 1, and 0 where the whole is 0."""
    return np.minimum(np.divide(part, whole, out=np.zeros(whole.shape), where=whole > 0), 1.0)


def scene_of(cell: Cell, n_poses: int) -> Scene:
    """The scene with its true answers."""
    mesh, camera = cell.mesh(), cell.camera
    poses = cell.poses(mesh, n_poses)
    with rc.open_observer(mesh, camera, "exact", threads=THREADS) as observer:
        observation = observer.observe(poses)
    front = np.array([face_geometry(mesh, camera, pose).is_front for pose in poses])
    visible, area = observation.visible_pixels, observation.drawn_pixels
    return Scene(mesh, camera, poses, visible, area, observation.area_error, front & (area > 1e-6))


def ours(scene: Scene, name: str, method: str, stack: ExitStack) -> Contestant:
    """One of our methods: both areas of each face."""
    observer = rc.open_observer(scene.mesh, scene.camera, method, threads=THREADS)
    stack.enter_context(observer)

    def fractions(row: int) -> FloatArray:
        seen = observer.observe(scene.poses[row])
        return share(seen.visible_pixels[0], seen.drawn_pixels[0])

    return Contestant(name, name, fractions, lambda: observer.observe(scene.poses))


def by_pixels(scene: Scene, name: str, runner) -> Contestant:
    """A ray or a colour for each pixel: hits of a face, over its area."""
    rows = np.arange(len(scene.poses))

    def fractions(row: int) -> FloatArray:
        image = runner.faces(row)
        hits = np.bincount(image[image >= 0], minlength=scene.mesh.n_faces)
        return share(hits.astype(np.float64), scene.area[row])

    return Contestant(name, PIXELS, fractions, lambda: runner.count(rows))


def points_of(mesh: rc.Mesh, side: int) -> FloatArray:
    """Centroids of side^2 equal parts of each face, (F, side^2, 3); one is the centroid."""
    parts = []
    for i in range(side):
        for j in range(side - i):
            parts.append((i + 1 / 3, j + 1 / 3))
            if i + j < side - 1:
                parts.append((i + 2 / 3, j + 2 / 3))
    u, v = np.array(parts).T / side
    weights = np.stack((1 - u - v, u, v), axis=1)
    return np.einsum("kc,fcx->fkx", weights, mesh.vertices[mesh.faces])


def by_points(
    scene: Scene, name: str, side: int, first: Callable[[FloatArray, FloatArray], IntArray]
) -> Contestant:
    """Rays from the camera to points of each face: the share of them that meet it first."""
    points, camera = points_of(scene.mesh, side), scene.camera
    normals = np.cross(*(np.diff(scene.mesh.vertices[scene.mesh.faces], axis=1).swapaxes(0, 1)))

    def fractions(row: int) -> FloatArray:
        turn, eye = scene.poses[row, :3, :3], scene.poses[row, :3, 3]
        facing = ((points[:, 0] - eye) * normals).sum(-1) < 0
        rays = points[facing] - eye
        x, y, z = np.moveaxis(rays @ turn, -1, 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
        inside = (z > 0) & (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height)
        own = np.broadcast_to(np.flatnonzero(facing)[:, None], inside.shape)
        meets = np.zeros(inside.shape, bool)
        meets[inside] = first(eye, rays[inside]) == own[inside]
        result = np.zeros(scene.mesh.n_faces)
        result[facing] = share(meets.sum(1).astype(float), inside.sum(1).astype(float))
        return result

    rows = range(len(scene.poses))
    kind = f"rays to {side * side} points per face" if side > 1 else "one ray to the centroid"
    return Contestant(name, kind, fractions, lambda: [fractions(row) for row in rows])


def contestants(scene: Scene, stack: ExitStack, say: Callable[[str], None]) -> list[Contestant]:
    """All that can run here, ours first."""
    mesh, camera, poses = scene.mesh, scene.camera, scene.poses
    items = [
        ours(scene, "**certified**", "certified", stack),
        replace(ours(scene, "**exact**", "exact", stack), kind=REFERENCE),
        ours(scene, "**sampled**", "sampled:cpu", stack),
        ours(scene, "**sampled**, 16 per pixel", "sampled:cpu@4", stack),
    ]

    def add(packages: tuple[str, ...], make: Callable[[], list[Contestant]]) -> None:
        try:
            if missing := what_is_missing(packages):
                raise ImportError(missing)
            items.extend(make())
        except Exception as error:  # whatever a library raises where it cannot run
            reason = str(error).partition("\n")[0]
            say(f"left out: {', '.join(packages)}: {reason}")

    def packets() -> list[Contestant]:
        runner = EmbreePackets(mesh, camera, poses, THREADS)
        return [by_pixels(scene, "Embree packets", runner)]

    def open3d() -> list[Contestant]:
        runner = Open3D(mesh, camera, poses, THREADS)
        tracer = runner.tracer

        def first(eye: FloatArray, rays: FloatArray) -> IntArray:
            both = np.empty((len(rays), 6), np.float32)
            both[:, :3], both[:, 3:] = eye, rays
            ids = tracer.scene.cast_rays(both, nthreads=THREADS)["primitive_ids"].numpy()
            return np.asarray(ids, np.int64)

        return [
            by_pixels(scene, "Open3D, pixels", runner),
            by_points(scene, "Open3D, centroids", 1, first),
            by_points(scene, "Open3D, 16 points", 4, first),
        ]

    def vtk() -> list[Contestant]:
        return [by_pixels(scene, "VTK on software OpenGL", VTK(mesh, camera, poses))]

    def models() -> list[Contestant]:
        def seen(row: int) -> FloatArray:
            return np.asarray(zhang.visible(mesh, camera, poses[row : row + 1])[0])

        name = "Zhang's model, rays to three vertices"
        return [Contestant(name, name, seen, lambda: zhang.visible(mesh, camera, poses))]

    def of_thesis() -> list[Contestant]:
        def seen(row: int) -> FloatArray:
            return 1 - np.nan_to_num(occlusion(mesh, camera, poses[row], clip=False), nan=1.0)

        rows, name = range(len(poses)), "Algorithm 1 of the thesis"
        return [Contestant(name, name, seen, lambda: [seen(row) for row in rows])]

    add(("embreex",), packets)
    add(("open3d",), open3d)
    add(("vtk",), vtk)
    add((), models)
    if mesh.n_faces <= ALGORITHM_1:
        add(("shapely",), of_thesis)
    return items


def check(report: Report, name: str, scene: Scene, entered: list[Contestant]) -> None:
    """Check everything that must hold before anything is timed."""
    rng = np.random.default_rng(0)
    partly = (scene.fraction[0] > 0) & (scene.fraction[0] < 1) & scene.judged[0]
    some = rng.permutation(np.flatnonzero(partly))[:CHECKED_BY_FRACTIONS]
    true = np.array(rational.visible_area(scene.mesh, scene.camera, scene.poses[0], some), float)
    off = np.abs(scene.visible[0, some] - true)
    report.check(f"{name}: half planes are within their bound of fractions", bool(
        len(some) > 0 and (off <= scene.bound[0, some] + 1e-12).all()))  # fmt: skip
    with (
        rc.open_observer(scene.mesh, scene.camera, threads=THREADS) as certified,
        rc.open_rasterizer(scene.mesh, scene.camera, "cpu", threads=THREADS) as rasterizer,
    ):
        seen = certified.observe(scene.poses)
        off = np.abs(seen.visible_pixels - scene.visible)
        holds = bool((off <= seen.area_error + scene.bound + 1e-9).all())
        report.check(f"{name}: certified is within its bound of half planes", holds)
        mine = rasterizer.render(scene.poses[0]).face
    if any(each.name.startswith("Embree") for each in entered):
        peer = EmbreePackets(scene.mesh, scene.camera, scene.poses, THREADS)
        _, wrong = wrong_pixels(scene.mesh, scene.camera, scene.poses[0], mine, peer.faces(0))
        report.check(f"{name}: packets meet the faces of our image", wrong == 0)


def errors(scene: Scene, contestant: Contestant) -> Figures:
    """Errors of the fraction over the judged faces of all poses, and faces called wrongly."""
    values = np.array([contestant.fractions(row) for row in range(len(scene.poses))])
    values, true, area = (part[scene.judged] for part in (values, scene.fraction, scene.area))
    off = np.abs(values - true)
    return {
        "mean": float(off.mean()),
        "mean by area": float((off * area).sum() / area.sum()),
        "largest": float(off.max()),
        "missed": int(((values == 0) & (true > SEEN)).sum()),
        "false": int(((values > HIDDEN) & (true <= HIDDEN)).sum()),
        "faces": len(off),
    }


def race(entered: list[Contestant], n_poses: int, rounds: int) -> None:
    """Time all in turn; the first round warms up."""
    for each in rounds_of(entered, rounds):
        started = time.perf_counter()
        each.work()
        each.seconds.append((time.perf_counter() - started) / n_poses)
        each.spent += each.seconds[-1] * n_poses
    for each in entered:
        each.seconds = each.seconds[1:] or each.seconds


def rounds_of(entered: list[Contestant], rounds: int):
    """Contestants in turns, round by round."""
    for _ in range(rounds + 1):
        yield from [each for each in entered if each.spent < MOST_SECONDS]


def measure(report: Report, name: str, cell: Cell, args, say) -> dict[str, Figures]:
    """Errors and times of one scene, by contestant."""
    scene = scene_of(cell, args.poses)
    with ExitStack() as stack:
        entered = contestants(scene, stack, say)
        check(report, name, scene, entered)
        table = {each.name: {"kind": each.kind} | errors(scene, each) for each in entered}
        for each in entered:
            first = next(other for other in entered if other.kind == each.kind)
            near = abs(table[each.name]["mean"] - table[first.name]["mean"]) <= ALIKE
            if first is not each:
                report.check(f"{name}: {each.name}: the errors of {first.name}", bool(near))
        race(entered, args.poses, args.rounds)
        base = next((each for each in entered if each.name.startswith("Embree")), entered[0])
        for each in entered:
            pairs = zip(base.seconds, each.seconds, strict=False)
            table[each.name] |= {
                "ms": 1e3 * statistics.median(each.seconds),
                "ratio": statistics.median(theirs / its for theirs, its in pairs),
            }
            for what in ("mean", "largest", "ms"):
                report.add(f"{name}: {each.name}: {what}", table[each.name][what], "")
    if name in AS_PRINTED:
        _, (seconds, *_), _ = thesis_table_4_2.PRINTED[AS_PRINTED[name]]
        table["Khepra, as printed"] = {"ms": 1e3 * seconds}
    return table


def tables(scenes: dict[str, dict[str, Figures]]) -> list[str]:
    """Errors and times of all scenes, as Markdown."""
    kinds: dict[str, str] = {}
    names: dict[str, str] = {}
    for scene in scenes.values():
        for name, figures in scene.items():
            names[name] = name
            if figures.get("kind", REFERENCE) != REFERENCE:
                kinds.setdefault(figures["kind"], name)
    return [*table(scenes, kinds, of_errors), "", *table(scenes, names, of_times)]


def table(
    scenes: dict[str, dict[str, Figures]], rows: dict[str, str], words: Callable[[Figures], str]
) -> list[str]:
    """A column a scene; a row has a title and the contestant whose figures it shows."""
    lines = [f"| | {' | '.join(scenes)} |", "|---" * (len(scenes) + 1) + "|"]
    for title, name in rows.items():
        cells = (words(scene.get(name, {})) for scene in scenes.values())
        lines.append(f"| {title} | {' | '.join(cells)} |")
    return lines


def of_errors(cell: Figures) -> str:
    """Errors over faces and over their areas; missed and false faces."""
    if "mean" not in cell:
        return "-"
    values = ", ".join(percent(cell[what]) for what in ("mean", "mean by area"))
    return f"{values}; {cell['missed']}/{cell['false']}"


def of_times(cell: Figures) -> str:
    """Milliseconds a pose, and the ratio to packets."""
    if "ms" not in cell:
        return "-"
    ratio = f" ({cell['ratio']:.2g}x)" if "ratio" in cell else ""
    return f"{cell['ms']:,.{max(0, 1 - int(np.floor(np.log10(cell['ms']))))}f}{ratio}"


def percent(error: float) -> str:
    """Two digits, and 0 for what is rounding."""
    return "0" if error < 1e-9 else f"{float(f'{100 * error:.2g}'):g}"


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--scenes", nargs="*", choices=SCENES, default=list(SCENES))
    parser.add_argument("--meshes", type=Path, metavar="DIR", help="these mesh files, too")
    parser.add_argument("--size", type=int, nargs=2, default=SIZE, metavar=("W", "H"))
    parser.add_argument("--poses", type=int, default=6)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--page", type=Path, help="rewrite the tables of this page")
    parser.add_argument("--out", type=Path, default=Path("report/comparison"))
    args = parser.parse_args()
    if min(args.poses, args.rounds) < 1:
        parser.error("--poses and --rounds must be 1 or more")
    cells = {
        name: replace(SCENES[name], width=args.size[0], height=args.size[1]) for name in args.scenes
    }
    for path in sorted(args.meshes.iterdir()) if args.meshes else ():
        if path.suffix.lower() in READERS:
            cells[path.stem] = Cell(path.stem, 0, *args.size, path=str(path))
    report, left_out = Report(), []
    scenes = {}
    for name, cell in cells.items():
        scenes[name] = measure(report, name, cell, args, left_out.append)
        print(f"{name}: done", file=sys.stderr, flush=True)
    header = f"{machine()}; {THREADS} threads, {args.poses} poses, {args.rounds} rounds."
    block = "\n".join([header, "", *tables(scenes)])
    for line in dict.fromkeys(left_out):
        print(line, file=sys.stderr)
    args.out.mkdir(parents=True, exist_ok=True)
    figures = {"header": header, "scenes": scenes, "rows": report.rows}
    (args.out / "comparison.json").write_text(json.dumps(figures, indent=2) + "\n")
    if args.page and not report.failed:
        write(args.page, PROGRAM, block)
    if not args.json:
        print(block)
        report.rows = [row for row in report.rows if row["unit"] == "passed"]
    report.finish(args.json)


if __name__ == "__main__":
    main()
