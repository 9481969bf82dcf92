"""Poses per second with face counts: our rasterisers against what a user would take instead.

Contestants go from a pose to its visible samples of each face, on the same two cores in the same
run: ours on the CPU in two threads and on OpenGL in its three plans; packets of rays by Embree,
called from compiled code, and Open3D's ray tracer in two threads; trimesh with embreex and VTK's
hardware selector, which use one core, in two processes, as does software OpenGL, with one Mesa
thread each. `--device egl:0` measures a GPU, in one process. A peer that is not installed, or does
not run without a display, is left out with a line.

First, images of a few poses are compared with Open3D's: they may differ only where `same_faces`
excuses it, and our counts must be those of our image. Then rounds alternate; figures are medians
over rounds, ratios too. A ratio counts the making of rays; a second one to Open3D leaves it out.
Memory is the peak of all processes of a contestant, libraries, mesh, images and results included.
`--meshes DIR` measures the mesh files of a folder in place of the built-in scenes.

Then what does not need a peer: `footprint` has what `drawn` costs, one pose of `evaluate`, how soon
a start has a result, and memory. Table, plots and `throughput.json` go to `--out`.
"""

import json
import statistics
import sys
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
from contest import SOFTWARE, Cell, Team, TeamError, contestants
from footprint import cost_of_drawn, cost_of_one_pose, later_starts, memory_of_workers
from peers import what_is_missing
from rows import Report, arguments, machine
from same_faces import wrong_pixels

from rastercov.formats.meshes import READERS
from rastercov.reference.pages import LIGHT, Curve, image_of, line_plot

FACES = (1_000, 10_000, 100_000, 1_000_000)
SIZES = ((128, 128), (256, 256), (512, 512), (1280, 1024), (2048, 2048))
LARGE, SMALL = (1280, 1024), (256, 256)
ROOM = 15_000
DEFAULT = [
    *(Cell("closed", n, *size) for n in FACES for size in (LARGE, SMALL)),
    *(Cell(scene, 10_000, *size) for scene in ("open", "part") for size in (LARGE, SMALL)),
    *(Cell("interior", ROOM, *size) for size in (LARGE, SMALL)),
]
FULL = [
    *(Cell(scene, n, *s) for scene in ("closed", "open", "interior") for n in FACES for s in SIZES),
    *(cell for cell in DEFAULT if cell.scene == "part" or cell.n_faces == ROOM),
]
MUST = {
    ("cpu", "closed", 10_000, LARGE): (80, 150),
    ("cpu", "closed", 10_000, SMALL): (35, 70),
    ("cpu", "closed", 100_000, LARGE): (40, 80),
    ("cpu", "closed", 100_000, SMALL): (16, 40),
    ("cpu", "closed", 1_000_000, LARGE): (20, 40),
    ("cpu", "interior", ROOM, LARGE): (15, 40),
    ("gl-pipeline", "closed", 10_000, LARGE): (15, None),
    ("gl-pipeline", "closed", 10_000, SMALL): (5, None),
}
"""Ratio to Open3D: what it must be and what we aim at."""
POSES, COMPARED = 240, 3
MOST_POSES = 4096
PARTS = {
    "drawn": cost_of_drawn,
    "one": cost_of_one_pose,
    "start": later_starts,
    "memory": memory_of_workers,
}


@dataclass
class Result:
    """One contestant in one cell."""

    contestant: str
    label: str
    is_peer: bool
    n_poses: int = 0
    seconds: list[float] = field(default_factory=list)
    making: list[float] = field(default_factory=list)
    peak_mib: float = 0.0
    pixels_differ: int = 0
    unexcused: int = 0

    @property
    def poses_per_second(self) -> float:
        """Median over the rounds."""
        return self.n_poses / statistics.median(self.seconds)

    def ratio(self, to: "Result", *, rays_for_free: bool = False) -> float:
        """Ratio of speeds, the median over rounds."""
        theirs = np.subtract(to.seconds, to.making) if rays_for_free else np.array(to.seconds)
        return float(np.median((theirs / to.n_poses) / (np.array(self.seconds) / self.n_poses)))


def main() -> None:
    args = _arguments()
    say = _printer(args.json)
    field_of = contestants(args.device)
    for key in args.contestants:
        if missing := what_is_missing(field_of[key].packages):
            say(f"{key} is left out: {missing}")
    entered = {
        key: field_of[key]
        for key in args.contestants
        if not what_is_missing(field_of[key].packages)
    }
    header = {"at the start": machine()}
    say(*(f"{name}: {value}" for name, value in header.items()))
    report, measured, about = Report(), [], {}
    for cell in _cells(args) if "contest" in args.parts else ():
        what, n_faces, results = _contest(report, cell, entered, args, say, about)
        measured.append((cell, what, n_faces, results))
    for part in args.parts:
        if part in PARTS:
            PARTS[part](report)
    header |= {"at the end": machine(), "devices": about}
    _write(args.out, header, report, measured, field_of)
    say("", f"{args.out}/throughput.json")
    if not args.json:  # the table has the others
        report.rows = [row for row in report.rows if row["must"] and row["unit"] != "passed"]
    report.finish(args.json)


def _contest(report, cell, entered, args, say, about):
    """Open everyone, compare images, time rounds, and report."""
    mesh = cell.mesh()
    poses = cell.poses(mesh, POSES)
    what = f"{cell.scene}, {mesh.n_faces:,} faces, {cell.width} x {cell.height}"
    say("", what, TABLE_HEAD)
    teams = {key: Team(contestant, cell, POSES) for key, contestant in entered.items()}
    results = {
        key: Result(key, team.contestant.label, team.contestant.is_peer)
        for key, team in teams.items()
    }

    def each(work) -> None:
        """Do this with every team that is still there; one that fails is left out from then on."""
        for key in list(teams):
            try:
                work(teams[key], results[key])
            except TeamError as error:
                say(f"  {results.pop(key).label} is left out: {error}")
                teams.pop(key).close()

    def open_it(team: Team, result: Result) -> None:
        about[result.contestant] = team.wait()

    def find_pace(team: Team, result: Result) -> None:
        n, seconds = 4, 0.0
        while seconds < args.seconds / 4 and n < MOST_POSES:  # the first poses grow buffers
            n = min(4 * n, MOST_POSES) if seconds else n
            seconds = team.count(n)[0]
        result.n_poses = int(np.clip(n * args.seconds / seconds, 4, MOST_POSES)) // 2 * 2

    def race(team: Team, result: Result) -> None:
        spent, making = team.count(result.n_poses)
        result.seconds.append(spent)
        result.making.append(making)

    def weigh(team: Team, result: Result) -> None:
        result.peak_mib = team.peak()

    try:
        each(open_it)
        judge = next(
            (teams[key] for key in ("open3d", "embree", "trimesh", "cpu") if key in teams), None
        )
        for row in range(0, POSES, POSES // COMPARED) if judge else ():
            right = judge.ask("faces", row)
            each(partial(_compare, report, what, mesh, cell.camera, poses[row], row, right))
        each(find_pace)
        for _ in range(args.rounds):
            each(race)
        each(weigh)
    finally:
        for team in teams.values():
            team.close()
    _report(report, cell, what, results, say)
    return what, mesh.n_faces, results


def _compare(report, what, mesh, camera, pose, row, right, team: Team, result: Result) -> None:
    """Check an image against that of a peer, or ours on the CPU; and our counts against it."""
    image = team.ask("faces", row)
    differing, wrong = wrong_pixels(mesh, camera, pose, image, right)
    result.pixels_differ += differing
    result.unexcused += wrong
    if row == 0 and not team.contestant.is_peer:
        from_image = np.bincount(image[image >= 0], minlength=mesh.n_faces)
        name = f"{what}, {result.label}: counts are those of the image"
        report.check(name, np.array_equal(team.ask("counts", row), from_image))


TABLE_HEAD = (
    f"  {'':<32}{'poses/s':>9}{'ms':>8}{'x Embree':>9}{'x Open3D':>9}{'no rays':>9}"
    f"{'MiB':>8}{'differ':>8}{'wrong':>7}"
)


def _report(report, cell, what, results, say) -> None:
    theirs, packets = results.get("open3d"), results.get("embree")
    for key, result in results.items():
        name = f"{what}: {result.label}"
        if result.is_peer:  # errors of peers are reported, and fail no check
            report.add(f"{name}, wrong pixels", result.unexcused, "pixels")
        else:
            report.check(f"{name}, same faces up to ties", result.unexcused == 0)
        report.add(name, result.poses_per_second, "poses/s")
        report.add(f"{name}, peak memory", result.peak_mib, "MiB")
        ratios = [f"{'-':>9}"] * 3
        if packets:
            ratio = result.ratio(packets)
            if result is not packets:
                report.add(f"{name}, ratio to Embree packets", ratio, "x")
            ratios[0] = f"{ratio:>9.3g}"
        if theirs:
            ratio = result.ratio(theirs)
            free = result.ratio(theirs, rays_for_free=True)
            must, aim = MUST.get(
                (key, cell.scene, cell.n_faces, (cell.width, cell.height)), (None,) * 2
            )
            if result is not theirs:
                report.add(f"{name}, ratio to Open3D", ratio, "x", must, aim)
                report.add(f"{name}, ratio, rays for free", free, "x")
            ratios[1:] = f"{ratio:>9.3g}", f"{free:>9.3g}"
        say(
            f"  {result.label:<32}{result.poses_per_second:>9.4g}"
            f"{1e3 / result.poses_per_second:>8.3g}{''.join(ratios)}"
            f"{result.peak_mib:>8.0f}{result.pixels_differ:>8}{result.unexcused:>7}"
        )


def _write(out: Path, header, report, measured, field_of) -> None:
    """The figures as JSON, and a plot for each scene and image size with several face counts."""
    out.mkdir(parents=True, exist_ok=True)
    cells = [
        {
            **asdict(cell), "what": what, "n_faces": n_faces,
            "results": [
                {**asdict(r), "poses_per_second": r.poses_per_second} for r in results.values()
            ],
        }
        for cell, what, n_faces, results in measured
    ]  # fmt: skip
    figures = {"header": header, "cells": cells, "rows": report.rows}
    (out / "throughput.json").write_text(json.dumps(figures, indent=2) + "\n")
    for scene, width, height in dict.fromkeys((c.scene, c.width, c.height) for c, *_ in measured):
        here = sorted(
            (n_faces, results) for cell, _, n_faces, results in measured
            if (cell.scene, cell.width, cell.height) == (scene, width, height)
        )  # fmt: skip
        if len({n for n, _ in here}) < 2:
            continue
        curves = []
        for i, (key, contestant) in enumerate(field_of.items()):
            points = [(n, r[key].poses_per_second) for n, r in here if key in r]
            if points:
                colour = LIGHT.series[i % len(LIGHT.series)]  # peers are dashed
                curves.append(Curve(contestant.name, points, colour, contestant.is_peer))
        title = f"Face counts of {SCENES[scene]}, {width} x {height}"
        figure = line_plot(title, "faces", "poses a second", curves, LIGHT)
        image_of(figure).save(out / f"{scene}_{width}x{height}.png", optimize=True)


SCENES = {
    "closed": "a torus",
    "open": "a teapot",
    "interior": "a room, from inside",
    "part": "an aeroplane",
}


def _cells(args) -> list[Cell]:
    sizes = args.sizes or (LARGE, SMALL)
    of_files = [
        Cell(path.name, 0, *size, path=str(path))
        for path in (sorted(args.meshes.iterdir()) if args.meshes else ())
        if path.suffix.lower() in READERS
        for size in sizes
    ]
    if args.scenes or args.faces or (args.sizes and not args.meshes):
        return of_files + [
            Cell(scene, n, *size)
            for scene in args.scenes or ("closed",)
            for n in args.faces or FACES
            for size in sizes
        ]
    return of_files or (FULL if args.full else DEFAULT)


def _printer(is_json: bool):
    """Print lines at once, beside the JSON when that is what was asked for."""

    def say(*lines: str) -> None:
        print(*lines, sep="\n", file=sys.stderr if is_json else sys.stdout, flush=True)

    return say


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    return int(width), int(height or width)


def _arguments():
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument(
        "--full", action="store_true", help="all scenes, faces and sizes: an hour or two"
    )
    parser.add_argument("--scenes", nargs="+", choices=SCENES)
    parser.add_argument(
        "--meshes", type=Path, metavar="DIR",
        help="measure each mesh file in this folder; built-in scenes only with --scenes or --faces",
    )  # fmt: skip
    parser.add_argument("--faces", nargs="+", type=int, help="about how many, such as 10000")
    parser.add_argument("--sizes", nargs="+", type=_size, help="such as 256 1280x1024")
    names = list(contestants(SOFTWARE))
    parser.add_argument("--contestants", nargs="+", choices=names, default=names)
    parts = ["contest", *PARTS]
    parser.add_argument("--parts", nargs="+", choices=parts, default=parts)
    parser.add_argument("--device", default=SOFTWARE, help="OpenGL device, such as egl:0")
    parser.add_argument("--rounds", type=int, default=5, help="rounds of each contestant")
    parser.add_argument("--seconds", type=float, default=0.3, help="length of a round, about")
    parser.add_argument("--out", type=Path, default=Path("report/throughput"))
    return parser.parse_args()


if __name__ == "__main__":
    main()
