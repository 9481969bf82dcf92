"""Table 4.2 of the thesis: overall coverage of one pose, seven meshes, ten times each; and errors.

Times are wall seconds, as the thesis took them with tic and toc, for (3.6) of all faces of a mesh
that is loaded; one thread. "CPU time" is their mean in CPU seconds, the same on an idle machine,
and what the limits are for. "first" is the first answer for a mesh, with what is worked out once
for it. Zhang's model builds its tree of triangles each time.

Errors are what the thesis could not measure: the visible fraction of each face that has an image,
against exact rational arithmetic on all faces, and (3.6) with that fraction in it, R_min = 100 px
and the resolution capped at 1. "literal" is Algorithm 1 as printed, on meshes of up to 2,000 faces;
"centroid sort" its charitable reading, see docs/appendix/equations.md.

The thesis states neither camera nor poses. Here: the camera of its figure A.3, 0.35 m from the
middle of the mesh, which is scaled to a sphere of 0.16 m, so that all of it is in view and in
focus; from where the spout hides some of the teapot, an engine some of the aeroplane, and ears and
legs some of the bunny, as in its figures 4.2 to 4.6.
"""

import argparse
import statistics
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rows import Report, arguments

import rastercov as rc
from rastercov.base.errors import DeviceError
from rastercov.core.coverage.coverage import evaluate_batches
from rastercov.core.mesh import shapes
from rastercov.reference import rational
from rastercov.reference.algorithm1 import occlusion
from rastercov.reference.coverage import in_focus
from rastercov.reference.coverage import measure_geometry as face_geometry
from rastercov.reference.models import MODELS, zhang

FloatArray = NDArray[np.float64]

PRINTED = {
    # triangles; mean, best, worst and deviation in seconds of the proposed model and of Zhang's
    "Plane1": (1970, (17.776, 17.286, 19.190, 0.5933), (18.396, 16.935, 21.409, 1.851)),
    "Plane2": (9856, (307.995, 298.928, 322.471, 7.427), (426.600, 382.31, 464.805, 29.319)),
    "Teapot1": (1560, (9.029, 8.372, 9.609, 0.447), (7.997, 7.725, 8.469, 0.262)),
    "Teapot2": (6400, (142.892, 136.940, 146.289, 2.521), (163.233, 158.462, 168.545, 3.085)),
    "Teapot3": (9216, (286.261, 272.249, 294.230, 6.411), (325.406, 317.406, 340.909, 8.086)),
    "Bunny1": (1602, (9.181, 8.929, 9.819, 0.311), (11.230, 10.835, 11.972, 0.393)),
    "Bunny2": (5122, (109.563, 106.710, 111.953, 1.649), (168.456, 159.174, 174.744, 6.428)),
}
STATISTICS = ("mean", "best", "worst", "deviation")
COLUMNS = (*STATISTICS, "CPU time", "first")
BUILT_IN = {
    "Plane1": lambda: shapes.aeroplane(1970),
    "Plane2": lambda: shapes.aeroplane(9856),
    "Teapot1": lambda: shapes.teapot(5),
    "Teapot2": lambda: shapes.teapot(10, keep_degenerate=True),
    "Teapot3": lambda: shapes.teapot(12, keep_degenerate=True),
}
BUNNIES = {"Bunny1": "bunny_1602_closed.ply", "Bunny2": "bunny_5122_closed.ply"}
VIEWS = {
    # from where, and what is up
    "Plane": ((0.5, -1.0, -0.2), (0, 0, 1)),
    "Teapot": ((0.9, -0.45, 0.3), (0, 0, 1)),
    "Bunny": ((-0.3, 0.3, 1.0), (0, 1, 0)),
}
CAMERA = rc.Camera.preset("khepra")
RADIUS, DISTANCE = 0.16, 0.35  # metres
TASK = rc.Task.thesis(min_pixels=100, cap_resolution=True)
LITERAL_FACES = 2000
"""As printed, Algorithm 1 takes some ten seconds up to here, and grows with the square."""
HEADLINE = {"exact": 0.1, "certified": 0.1, "sampled, CPU": 0.01}
"""Most CPU seconds for the thesis' 286: means on Teapot3."""
LARGEST_ERROR = 1e-6
"""Of what is proved or computed; a face may be as small as rounding makes it."""
GROSS = (0.01, 0.5)
"""Errors above these are counted."""


class Observed:
    """Overall coverage by an observer, opened here once."""

    def __init__(self, mesh, pose, method, **options) -> None:
        self.observer, self.pose = rc.open_observer(mesh, CAMERA, method, **options), pose
        self.renderer = self.observer.info.renderer

    def coverage(self) -> FloatArray:
        """Overall coverage of each face, (F,)."""
        self.batch = next(iter(evaluate_batches(self.observer, self.pose[None], TASK)))
        return self.batch.coverage[0]

    def seen(self) -> tuple[FloatArray, FloatArray]:
        """Visible fractions, and (3.6) with them."""
        return self.batch.visibility[0], self.batch.coverage[0]


class Zhang:
    """Zhang's model; in (3.6) its bivalent occlusion takes the place of the graded one."""

    def __init__(self, mesh, pose) -> None:
        self.mesh, self.pose = mesh, pose
        self.renderer = "tree of triangles"

    def coverage(self) -> FloatArray:
        """As for `Observed`; of its own making."""
        return MODELS["zhang"](self.mesh, CAMERA, self.pose[None], TASK)[0]

    def seen(self) -> tuple[FloatArray, FloatArray]:
        """As for `Observed`."""
        visible = zhang.visible(self.mesh, CAMERA, self.pose[None])[0]
        return visible, without_visibility(self.mesh, self.pose) * visible


class Algorithm1:
    """The thesis' model by its own algorithm, in one of its readings."""

    def __init__(self, mesh, pose, reading) -> None:
        self.mesh, self.pose, self.reading = mesh, pose, reading
        self.renderer = "shapely"

    def coverage(self) -> FloatArray:
        """As for `Observed`."""
        hidden = occlusion(self.mesh, CAMERA, self.pose, self.reading, clip=False)
        # Faces without an image come out as NaN; nothing of them is seen.
        self.visible = np.where(np.isnan(hidden), 0.0, 1 - hidden)
        self.overall = without_visibility(self.mesh, self.pose) * self.visible
        return self.overall

    def seen(self) -> tuple[FloatArray, FloatArray]:
        """As for `Observed`."""
        return self.visible, self.overall


def main() -> None:
    args = _arguments()
    report = Report()
    with ExitStack() as stack:
        ball = shapes.sphere(1, RADIUS)
        for entrant in _entrants(ball, _pose("Teapot1"), stack, args.literal, say=True).values():
            entrant.coverage()  # compiles, or loads what was compiled
    for name in args.meshes:
        mesh = _mesh(name, args.bunnies)
        if mesh is None:
            print(f"{name} skipped: --bunnies FOLDER wants {BUNNIES[name]} there", file=sys.stderr)
            continue
        table = one_mesh(report, name, mesh, args.runs, args.literal)
        if not args.json:
            print(table, end="\n\n", flush=True)
    if not args.json:
        for line in _headline(report):
            print(line)
        # The rest is in the tables, or passed.
        report.rows = [
            row for row in report.rows if row["must"] is not None and row["unit"] != "passed"
        ]
    report.finish(args.json)


def one_mesh(
    report: Report, name: str, mesh: rc.Mesh, runs: int, literal: int = LITERAL_FACES
) -> str:
    """Adds the rows of one mesh; returns its table."""
    n_faces, ours, zhangs = PRINTED[name]
    report.check(f"{name}: {n_faces} faces", mesh.n_faces == n_faces)
    table = [f"{name}, {mesh.n_faces:,} faces; {runs} runs", HEAD]
    for model, seconds in {"proposed model": ours, "Zhang's model": zhangs}.items():
        table.append(_line(f"thesis: {model}", seconds))
        for what, figure in zip(STATISTICS, seconds, strict=True):
            report.add(f"{name}: thesis, {model}: {what}", figure, "s")
    pose = _pose(name)
    *true, judged = truth(mesh, pose)
    report.add(f"{name}: faces with an image", int(judged.sum()), "faces")
    for what, values in zip(("visible", "covered"), true, strict=True):
        report.add(f"{name}: faces {what}, in truth", int((values > 0).sum()), "faces")
    with ExitStack() as stack:
        for method, entrant in _entrants(mesh, pose, stack, literal).items():
            what = f"{name}: {method}"
            seconds = times(report, what, entrant, runs)
            for kind, figure in zip(COLUMNS, seconds, strict=True):
                must = HEADLINE.get(method) if (name, kind) == ("Teapot3", "CPU time") else None
                unit = "CPU-s" if kind == "CPU time" else "s"
                report.add(f"{what}: {kind}", figure, unit, at_most=must)
            figures = accuracy(report, what, entrant, true, judged)
            table.append(_line(method, seconds, figures) + f"  {entrant.renderer}")
    return "\n".join(table)


def truth(mesh: rc.Mesh, pose: FloatArray) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Visible fraction and coverage of each face by fractions, and which faces have an image."""
    area = rational.image_area(mesh, CAMERA, pose)
    visible = rational.visible_area(mesh, CAMERA, pose)
    has_image = area > 0
    fraction = np.divide(visible, area, out=np.zeros(mesh.n_faces), where=has_image)
    fraction[~face_geometry(mesh, CAMERA, pose).is_front] = 0.0
    return fraction, without_visibility(mesh, pose, area) * fraction, has_image


def without_visibility(mesh, pose, area=None) -> FloatArray:
    """(3.6) without C_V: field of view, capped resolution, focus; of given areas in px^2."""
    view = face_geometry(mesh, CAMERA, pose)
    resolution = (view.projected_area if area is None else area) / TASK.min_pixels
    focus = in_focus(view, CAMERA.depth_of_field(TASK.max_blur), TASK.focus_rule)
    return view.in_view * np.minimum(resolution, 1.0) * focus


def times(report: Report, what: str, entrant, runs: int) -> tuple[float, ...]:
    """Seconds of the first answer and of those after it, in the order of `COLUMNS`."""
    wall, cpu, answers = [], [], set()
    for _ in range(runs + 1):
        started = time.perf_counter(), time.process_time()
        coverage = entrant.coverage()
        wall.append(time.perf_counter() - started[0])
        cpu.append(time.process_time() - started[1])
        answers.add(coverage.tobytes())
    report.check(f"{what}: the same every time", len(answers) == 1)
    first, *rest = wall
    spread = statistics.mean(rest), min(rest), max(rest), statistics.stdev(rest)
    return *spread, statistics.mean(cpu[1:]), first


def accuracy(report: Report, what: str, entrant, true, judged) -> list[str]:
    """Adds the errors over the judged faces, mean, largest, and how many; returns them as words.

    Bounds that are proved or computed must hold; those of samples, nearly always.
    """
    words = []
    observation = entrant.seen()
    for quantity, ours, right in zip(
        ("visible fraction", "coverage"), observation, true, strict=True
    ):
        error = np.abs(ours - right)[judged]
        mean, largest = float(error.mean()), float(error.max())
        limit = LARGEST_ERROR if what.endswith(("exact", "certified")) else None
        report.add(f"{what}: {quantity}, mean error", mean, "")
        report.add(f"{what}: {quantity}, largest error", largest, "", at_most=limit)
        counts = [int((error > gross).sum()) for gross in GROSS]
        for gross, count in zip(GROSS, counts, strict=True):
            report.add(f"{what}: {quantity}, off by more than {gross}", count, "faces")
        words += [f"{mean:.1e}", f"{largest:.1e}", *map(str, counts)]
    if isinstance(entrant, Observed):
        error = np.abs(observation[0] - true[0])
        held = (error <= entrant.batch.visibility_bound[0] + 1e-15)[judged].mean()
        report.check(f"{what}: bounds hold", bool(held >= (0.995 if "sampled" in what else 1.0)))
    return words


def _entrants(mesh: rc.Mesh, pose: FloatArray, stack: ExitStack, literal: int, say: bool = False):
    """Contestants for a mesh, by name; the stack closes them."""

    def observed(method, **options):
        entrant = Observed(mesh, pose, method, **options)
        stack.callback(entrant.observer.close)
        return entrant

    entrants = {"sampled, CPU": observed("sampled:cpu", threads=1)}
    try:
        entrants["sampled, OpenGL"] = observed("sampled:gl")
    except DeviceError as error:
        if say:
            print(f"sampled, OpenGL skipped: {error}", file=sys.stderr)
    for method in ("certified", "exact"):
        entrants[method] = observed(method, threads=1)
    entrants["Zhang's model"] = Zhang(mesh, pose)
    if mesh.n_faces <= literal:
        entrants["Algorithm 1, literal"] = Algorithm1(mesh, pose, "literal")
    entrants["Algorithm 1, centroid sort"] = Algorithm1(mesh, pose, "charitable")
    return entrants


def _mesh(name: str, bunnies: Path | None) -> rc.Mesh | None:
    """Mesh of the table about the origin, as large as `RADIUS`; None where there is none."""
    if name in BUILT_IN:
        mesh = BUILT_IN[name]()
    elif bunnies is None or not (bunnies / BUNNIES[name]).is_file():
        return None
    else:
        mesh = rc.Mesh.load(bunnies / BUNNIES[name])
    points = mesh.vertices - mesh.bounds.mean(axis=0)
    scale = RADIUS / np.linalg.norm(points, axis=1).max()
    return rc.Mesh(vertices=scale * points, faces=mesh.faces)


def _pose(name: str) -> FloatArray:
    direction, up = VIEWS[name.rstrip("123")]
    eye = DISTANCE * np.array(direction) / np.linalg.norm(direction)
    return rc.look_at(eye, (0, 0, 0), up).reshape(4, 4)


def _headline(report: Report) -> list[str]:
    """The largest teapot in a line, where it was measured."""
    means = {row["what"]: row["value"] for row in report.rows}
    table = {method: means.get(f"Teapot3: {method}: CPU time") for method in HEADLINE}
    if None in table.values():
        return []
    n_faces, (thesis, *_), _ = PRINTED["Teapot3"]
    ours = ", ".join(f"{method} {seconds:.3g} CPU-s" for method, seconds in table.items())
    return [f"Teapot3 ({n_faces:,} faces): thesis {thesis:.0f} s; {ours}"]


HEAD = (
    f"{'':<28}" + "".join(f"{what:>11}" for what in COLUMNS)
    + f"{'visible: mean':>15}{'largest':>9}" + "".join(f"{f'> {g}':>7}" for g in GROSS)
    + f"{'coverage: mean':>16}{'largest':>9}" + "".join(f"{f'> {g}':>7}" for g in GROSS)
)  # fmt: skip


def _line(what: str, seconds: tuple[float, ...], figures: list[str] | None = None) -> str:
    line = f"{what:<28}" + "".join(f"{figure:>11.4g}" for figure in seconds)
    if figures:
        widths = (15, 9, 7, 7, 16, 9, 7, 7)
        line += "".join(f"{word:>{width}}" for word, width in zip(figures, widths, strict=True))
    return line


def _arguments() -> argparse.Namespace:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=10, help="timed runs of each, at least 2")
    parser.add_argument(
        "--meshes", nargs="+", choices=PRINTED, default=list(PRINTED), help="columns of the table"
    )
    parser.add_argument(
        "--bunnies", type=Path, help=f"folder with {' and '.join(BUNNIES.values())}"
    )
    parser.add_argument(
        "--literal", type=int, default=LITERAL_FACES, help="most faces for Algorithm 1 as printed"
    )
    args = parser.parse_args()
    if args.runs < 2:
        parser.error(f"--runs must be 2 or more, got {args.runs}; a deviation needs two")
    return args


if __name__ == "__main__":
    main()
