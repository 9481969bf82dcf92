"""Report of a comparison of methods: page, JSON, pictures, and a table for a terminal.

compare.html   verdict, figures, plots, the worst faces; all inline, for phone and desk
compare.json   `Comparison` as it is
plot_*.png     plots of the page
worst_*.png    faces with the greatest errors of each method
missed_*.png   visible faces whose figure is 0

They replace an earlier comparison together, when all are whole.

Close-up of one face of a comparison: its visible and hidden parts, and the samples over it.

The polygons are the truth by `rastercov.reference.polygons`.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import shapely
from numpy.typing import ArrayLike
from rich.table import Table
from rich.text import Text
from shapely.geometry.base import BaseGeometry

from rastercov.base import FloatArray, RastercovError, frozen_record, plural
from rastercov.base.format import number
from rastercov.core.camera import Camera, valid_poses
from rastercov.core.mesh import Mesh
from rastercov.core.raster.contract import KIND_WORDS
from rastercov.reference.methods.convergence import Convergence
from rastercov.reference.methods.error_statistics import (
    MUST_HOLD,
    ROUNDING,
    BoundCheck,
    Check,
    Comparison,
    FaceError,
    Score,
    SizeClass,
)
from rastercov.reference.pages import (
    DARK,
    LABEL,
    LIGHT,
    Curve,
    PageTheme,
    image_of,
    line_plot,
    milliseconds,
    new_axes,
    open_browser,
    percent_of,
    picture_of,
    publish,
)
from rastercov.reference.polygons import images_of, visible_in
from rastercov.reference.samples import grid_points
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.report.pages import Picture, render
from rastercov.shards import Progress, silent

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Box = tuple[float, float, float]
"""Square part of the image: left, top, side, px."""
MAX_FACES = 800
"""Largest number of faces that are drawn around one: more are slow and cannot be read."""
MAX_PIXELS = 40
"""Largest side of a picture, in pixels of the image, with their borders."""
MAX_SAMPLES = 90
"""Largest number of samples across a picture that are drawn."""
HEIGHT = 6.6
"""Of a picture, inches."""


@frozen_record
class Neighbourhood:
    """True polygons of the faces around one face."""

    image: BaseGeometry  # the part of the face inside the image
    seen: BaseGeometry  # its visible part
    hidden: BaseGeometry  # the rest
    others: list[BaseGeometry]  # visible parts of other faces


def neighbourhood(mesh: Mesh, camera: Camera, pose: FloatArray, face: int) -> Neighbourhood | None:
    """True polygons around a face; None where it has no image, or there are no polygons."""
    if camera.is_curved:
        return None
    images = images_of(mesh, camera, pose)
    image = images.polygons[face]
    if image.is_empty:
        return None
    tree = shapely.STRtree(images.polygons)
    left, top, side = square(image.bounds)
    near = np.sort(tree.query(shapely.box(left, top, left + side, top + side)))
    asked = near if len(near) <= MAX_FACES else np.array([face])
    try:
        shapes = dict(zip(asked.tolist(), visible_in(images, tree, asked), strict=True))
    except RastercovError:
        return None
    seen = shapes.pop(face)
    others = [shape for other, shape in shapes.items() if not mesh.target_mask[other]]
    return Neighbourhood(image, seen, image.difference(seen), others)


def square(bounds: Sequence[float]) -> Box:
    """Square about a box (left, top, right, bottom), a third larger."""
    left, top, right, bottom = bounds
    side = 1.35 * max(right - left, bottom - top, 1e-9)
    return (left + right - side) / 2, (top + bottom - side) / 2, side


def face_picture(
    mesh: Mesh,
    camera: Camera,
    pose: FloatArray,
    of_face: FaceError,
    method: str,
    supersample: int = 1,
    roll: float | None = None,
) -> "Figure | None":
    """Picture of a face and the figure of a method; None where nothing can be drawn.

    `supersample` and `roll` give the sample grid of the method, which has none without `roll`.
    """
    around = neighbourhood(mesh, camera, pose, of_face.face)
    if around is None:
        return None
    error = fraction(abs(of_face.value - of_face.truth))
    title = (
        f"{method}: face {of_face.face} in pose {of_face.pose}, {of_face.area:.3g} "
        f"px²{'' if of_face.held else ', BOUND VIOLATED'}\n{fraction(of_face.value)} ± "
        f"{fraction(of_face.bound)}, reference {fraction(of_face.truth)}, error {error}"
    )
    left, top, side = square(around.image.bounds)
    figure, axes = new_axes(title, LIGHT, HEIGHT)
    axes.set(xlim=(left, left + side), ylim=(top + side, top), aspect="equal")
    axes.ticklabel_format(useOffset=False)
    if side <= MAX_PIXELS:
        axes.set_xticks(range(math.ceil(left), math.floor(left + side) + 1), minor=True)
        axes.set_yticks(range(math.ceil(top), math.floor(top + side) + 1), minor=True)
        axes.grid(which="minor", color=LIGHT.soft, linewidth=0.4)
        axes.set_axisbelow(False)
        axes.xaxis.remove_overlapping_locs = axes.yaxis.remove_overlapping_locs = False
    for shape in around.others:
        _add(axes, shape, facecolor=LIGHT.grid, edgecolor=LIGHT.paper)
    _add(axes, around.seen, facecolor="#14a37f", label="visible")
    _add(axes, around.hidden, facecolor="#f0803c", edgecolor="#c2571a", hatch="//", label="hidden")
    _add(axes, around.image, facecolor="none", edgecolor=LIGHT.ink, linewidth=2)
    if roll is not None and side * supersample <= MAX_SAMPLES:
        points = grid_points(camera, supersample, roll, (left, top, left + side, top + side))
        is_seen = shapely.contains_xy(around.seen, *points.T)
        is_hidden = shapely.contains_xy(around.image, *points.T) & ~is_seen
        axes.plot(*points[~is_seen & ~is_hidden].T, ".", color=LIGHT.soft, markersize=2)
        kinds = (is_seen, LIGHT.ink, "visible"), (is_hidden, "white", "hidden")
        for of_kind, fill, name in kinds:
            where = points[of_kind].T
            axes.plot(*where, "o", color=LIGHT.ink, mfc=fill, ms=5, label=f"sample, {name}")
    figure.legend(loc="outside lower left", ncols=4, frameon=False)
    return figure


def _add(axes: "Axes", shape: BaseGeometry, **style: object) -> None:
    """Draw a polygon, or several."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    polygons = [part for part in shapely.get_parts(shape) if part.geom_type == "Polygon"]
    rings = [ring for part in polygons for ring in (part.exterior, *part.interiors)]
    paths = [Path(np.asarray(ring.coords), closed=True) for ring in rings]
    if paths:
        axes.add_patch(PathPatch(Path.make_compound_path(*paths), **style))


def fraction(value: float) -> str:
    """A visible fraction or its error in a few digits."""
    if value in (0.0, 1.0):
        return f"{value:.0f}"
    if 5e-4 <= value <= 1 - 5e-5:
        return f"{value:.4f}"
    return f"{value:.10g}" if value > 0.5 else f"{value:.1e}"


COMPARISON = ReportKind(
    "compare",
    re.compile(r"compare\.(json|html)|(plot|worst|missed)_\w+\.png"),
    last="compare.json",
)
NEGLIGIBLE_ERROR = 1e-6
"""Greatest error of a method below which it is only named beside larger curves, and two faces are
shown instead of all that were kept."""
TRUTH = {
    "exact": "the method exact, in floating-point arithmetic",
    "polygons": "polygon Booleans by GEOS, which share no code with the methods compared",
    "rational": "exact rational arithmetic: no rounding anywhere",
}
FACE_TITLES = {
    "worst": "Largest errors: violated bounds first, then values with a bound below 1",
    "missed": "Missed: faces classified as hidden that have the largest visible areas",
}
MIN_FACES = 5
"""Partly hidden faces of a size class that has a point in a plot."""
LEAST_ERROR, LEAST_RATIO = 1e-4, 1e-3
"""Least values in plots of errors, and of errors over their bounds."""


def write_comparison(
    out: Path | ReportFolder,
    comparison: Comparison,
    mesh: Mesh,
    camera: Camera,
    poses: ArrayLike,
    progress: Progress = silent,
) -> Path:
    """Write the page, the JSON and the pictures; returns the path of the page.

    An interrupt (Ctrl-C) while pictures are drawn leaves out the rest of them: the files are
    written, the JSON says `"interrupted": true`, and then the interrupt is raised. `progress` gets
    the pictures drawn and the pictures in all.
    """
    with open_browser(out, COMPARISON) as folder:
        pictures: dict[str, Picture] = {}
        interrupted = False
        try:
            _draw(pictures, comparison, mesh, camera, poses, progress)
        except KeyboardInterrupt:
            interrupted = True
            comparison = replace(comparison, interrupted=True)
        path = publish(folder, page(comparison, pictures), comparison, pictures)
        if interrupted:
            raise KeyboardInterrupt
        return path


def _draw(
    pictures: dict[str, Picture],
    comparison: Comparison,
    mesh: Mesh,
    camera: Camera,
    poses: ArrayLike,
    progress: Progress,
) -> None:
    """Add the pictures by the names of their files."""
    light, dark = (comparison_plots(comparison, theme) for theme in (LIGHT, DARK))
    for name in light:
        alt = f"Plot: {name.replace('_', ' ')}"
        pictures[f"plot_{name}"] = picture_of(alt, light[name], dark[name])
    matrices = valid_poses(poses)
    wanted = [
        (score, name, face)
        for score in comparison.scores
        for name, face in _errors_to_show(score).items()
    ]
    for done, (score, name, face) in enumerate(wanted):
        progress(done, len(wanted))
        image = face_picture(
            mesh, camera, matrices[face.pose], face, score.name, score.supersample, score.roll
        )
        if image:
            alt = (
                f"Face {face.face} in pose {face.pose}: {fraction(face.value)} ± "
                f"{fraction(face.bound)}, reference {fraction(face.truth)}"
            )
            pictures[name] = Picture.of(alt, image_of(image))
    progress(len(wanted), len(wanted))


def _errors_to_show(score: Score) -> dict[str, FaceError]:
    """Faces of a method to show, by the names of their pictures."""
    is_good = score.all_sizes.greatest < NEGLIGIBLE_ERROR and all(w.held for w in score.worst)
    faces = {"worst": score.worst[: 2 if is_good else None], "missed": score.missed_faces}
    return {
        f"{kind}_{file_name(score.name)}_{rank}": face
        for kind, of_kind in faces.items()
        for rank, face in enumerate(of_kind, start=1)
    }


def page(comparison: Comparison, pictures: dict[str, Picture]) -> str:
    """HTML of a comparison; pictures by name: `plot_*`, `worst_*`, `missed_*`, as far as drawn."""
    done = f"{comparison.poses_done:,}"
    interrupted = f"{done} of {plural(comparison.poses, 'pose')} (interrupted)"
    sections = [
        (
            score,
            score_text(score),
            [kind_row(bound) for bound in score.bounds],
            [size_row(size) for size in (*score.size_classes, score.all_sizes)],
            _face_pictures(score, pictures),
        )
        for score in comparison.scores
    ]
    return render(
        "methods.html",
        "rastercov.reference",
        comparison=comparison,
        poses=interrupted
        if comparison.poses_done < comparison.poses
        else plural(comparison.poses_done, "pose"),
        truth=TRUTH[comparison.against],
        checks=[(str(check), check.passed) for check in comparison.checks],
        score_rows=[score_row(score) for score in comparison.scores],
        plots=[picture for name, picture in pictures.items() if name.startswith("plot_")],
        sections=sections,
    )


def _face_pictures(score: Score, pictures: dict[str, Picture]) -> list[tuple[str, list[Picture]]]:
    """Titles and pictures of the faces of a method, without empty ones."""
    names = [name for name in _errors_to_show(score) if name in pictures]
    items = [
        (title, [pictures[name] for name in names if name.startswith(kind)])
        for kind, title in FACE_TITLES.items()
    ]
    return [(title, of_kind) for title, of_kind in items if of_kind]


def score_row(score: Score) -> tuple[str, ...]:
    """A method under the headings of the page."""
    sizes = score.all_sizes
    ratios = [bound.median_ratio for bound in score.bounds if bound.kind == "statistical"]
    return (
        score.name,
        f"{sizes.figures:,}",
        f"{sizes.partly_hidden:,}",
        number(sizes.rms_partly_hidden),
        number(sizes.greatest),
        f"{score.missed:,}",
        percent_of(sizes.held, sizes.figures),
        _optional(ratios[0] if ratios else None),
        milliseconds(score.seconds_per_pose),
    )


def kind_row(bound: BoundCheck) -> tuple[str, ...]:
    """A kind of bound under the headings of the page."""
    return (
        KIND_WORDS[bound.kind],
        f"{bound.figures:,}",
        percent_of(bound.held, bound.figures),
        f"{bound.partly_hidden:,}",
        percent_of(bound.partly_hidden_held, bound.partly_hidden),
        _optional(bound.median_ratio),
        _optional(bound.greatest_ratio),
    )


def size_row(size: SizeClass) -> tuple[str, ...]:
    """A size class under the headings of the page."""
    if math.isinf(size.high):
        limits = f"from {size.low:g}" if size.low else "all"
    else:
        limits = f"{size.low:g} to {size.high:g}"
    return (
        limits,
        f"{size.figures:,}",
        f"{size.partly_hidden:,}",
        number(min(size.median, size.greatest)),
        number(min(size.percentile_99, size.greatest)),
        number(size.greatest),
        number(size.rms_partly_hidden) if size.partly_hidden else "",
        number(size.mean_bound_partly_hidden) if size.partly_hidden else "",
        f"{size.missed:,}",
        percent_of(size.held, size.figures),
    )


def _optional(value: float | None) -> str:
    return "" if value is None else number(value)


def score_text(score: Score) -> str:
    """Sentences about a method that no table has."""
    text = [
        f"The error of the visible area is {number(score.rms_pixels)} px² rms, "
        f"{number(score.greatest_pixels)} px² at most."
    ]
    if score.missed:
        unsaid = f"all but {score.missed_unsaid:,}" if score.missed_unsaid else "all"
        text.append(
            f"It misses {plural(score.missed, 'pair')} with {score.missed_area:,.3g} px² of "
            f"visible area in total; its bound covers {unsaid} of them."
        )
    if score.phantoms:
        text.append(f"It classifies {plural(score.phantoms, 'hidden pair')} as visible.")
    if score.unjudged:
        text.append(
            f"{plural(score.unjudged, 'pair', 'are')} too small in the image to be compared."
        )
    return " ".join(text)


def comparison_table(comparison: Comparison) -> Table:
    """Methods beside the reference, for a terminal of 80 columns."""
    title = f"Against {comparison.against}, {plural(comparison.poses_done, 'pose')}"
    words = "errors of the visible fraction; missed: visible faces reported as 0"
    table = Table(title=title, title_justify="left", caption=words, caption_justify="left")
    table.add_column("method", overflow="fold")
    headings = ("pose-\nface\npairs", "partly\nhidden", "rms error", "largest\nerror", "missed")
    for name in (*headings, "bound\nheld", "ms/pose"):
        table.add_column(name, justify="right", no_wrap=True)
    for score in comparison.scores:
        row = score_row(score)
        time = row[8].removesuffix(" ms")
        table.add_row(Text(score.name), *row[1:7], time)
    seconds = milliseconds(comparison.truth_seconds_per_pose).removesuffix(" ms")
    table.add_row(f"{comparison.against}\nreference", "", "", "", "", "", "", seconds, style="dim")
    return table


def check_lines(checks: Sequence[Check]) -> list[str]:
    """The verdict, one line per check."""
    results = {True: "holds, ", False: "fails, ", None: "undecided, "}
    return [results[check.passed] + str(check) for check in checks]


def comparison_plots(comparison: Comparison, theme: PageTheme) -> "dict[str, Figure]":
    """Plots of a comparison by the name of their file; those without figures are left out."""
    scores = comparison.scores
    colours = {s.name: theme.series[i % len(theme.series)] for i, s in enumerate(scores)}
    plots = {"error_by_size": _error_by_size(scores, colours, theme)}
    for score in scores:
        plots[f"errors_{file_name(score.name)}"] = _error_distribution(score, theme)
    plots["bounds"] = _bound_tightness(scores, colours, theme)
    plots["convergence"] = _convergence(comparison.convergence, theme)
    plots["time"] = _time(comparison, colours, theme)
    return {name: figure for name, figure in plots.items() if figure}


def file_name(name: str) -> str:
    """Name of a method as part of the name of a file."""
    return "".join(c if c.isalnum() else "_" for c in name)


def _error_by_size(
    scores: Sequence[Score], colours: dict[str, str], theme: PageTheme
) -> "Figure | None":
    """RMS error of partly hidden faces over the area of their images, and the mean bound."""
    curves, notes = [], []
    for score in scores:
        classes = [c for c in score.size_classes if c.partly_hidden >= MIN_FACES]
        greatest = max((c.rms_partly_hidden for c in classes), default=0.0)
        if greatest < NEGLIGIBLE_ERROR:
            notes.append(f"{score.name}: {_negligible(greatest)}")
            continue
        colour, sizes = colours[score.name], [_middle(c.low, c.high) for c in classes]
        errors = [max(c.rms_partly_hidden, NEGLIGIBLE_ERROR) for c in classes]
        bounds = [c.mean_bound_partly_hidden for c in classes]
        curves.append(Curve(score.name, list(zip(sizes, errors, strict=True)), colour))
        curves.append(Curve("", list(zip(sizes, bounds, strict=True)), colour, True, False))
    if not curves:
        return None
    curves.append(Curve("dashed: mean bound", (), theme.soft, True, False))
    title, up = "Error of partly hidden faces, by size", "rms error of the visible fraction"
    return line_plot(title, "area of the face in the image, px²", up, curves, theme, notes)


def _error_distribution(score: Score, theme: PageTheme) -> "Figure | None":
    """Share of faces whose error exceeds x, one curve for each size class."""
    curves = []
    least = LEAST_ERROR if score.all_sizes.greatest > NEGLIGIBLE_ERROR else 0.0
    ramp = _ramp(theme.sizes, len(score.size_classes))
    for size, colour in zip(score.size_classes, ramp, strict=True):
        if points := _share_above(size.errors, least):
            limits = f"{size.low:g} to {size.high:g}"
            name = limits if size.high < math.inf else f"from {size.low:g}"
            curves.append(Curve(name, points, colour, has_markers=False))
    if not curves:
        return None
    title, note = f"{score.name}: faces whose error exceeds x", "by area in the image, px²"
    across = "error of the visible fraction"
    return line_plot(title, across, "share of faces", curves, theme, [note])


def _bound_tightness(
    scores: Sequence[Score], colours: dict[str, str], theme: PageTheme
) -> "Figure | None":
    """Share of partly hidden faces whose |error| / bound exceeds x."""
    curves = []
    for score in scores:
        for bound in score.bounds:
            points = _share_above(bound.ratios, LEAST_RATIO)
            if bound.kind == "statistical" and points:
                curves.append(Curve(score.name, points, colours[score.name], has_markers=False))
    if not curves:
        return None
    allowed = 1 - MUST_HOLD
    name = f"allowed beyond it: {100 * allowed:.1f} %"
    curves.append(Curve("the bound", [(1, allowed), (1, 1)], theme.ink, True, False))
    curves.append(Curve(name, [(1, allowed), (2, allowed)], theme.soft, True, False))
    title = "Tightness of the statistical bounds"
    return line_plot(title, "error / bound", "share of partly hidden faces", curves, theme)


def _convergence(convergences: Sequence[Convergence], theme: PageTheme) -> "Figure | None":
    """RMS error of the same faces over the density of samples, with the fitted power law."""
    curves: list[Curve] = []
    for i, sweep in enumerate(convergences):
        if sweep.slope is None:
            continue
        colour = theme.series[i % len(theme.series)]
        error = f" ± {sweep.slope_error:.2f}" if sweep.slope_error else ""
        words = {"supersampling": "samples per pixel", "resolution": "image size"}[sweep.sweep]
        name = f"{sweep.method}, {words}: slope {sweep.slope:.2f}{error}"
        measured = list(zip(sweep.samples_per_side, sweep.rms, strict=True))
        # The fitted line goes through the mean of the logarithms.
        x, y = np.log(measured).T
        fit = np.exp(y.mean() + sweep.slope * (x - x.mean())).tolist()
        fitted = list(zip(sweep.samples_per_side, fit, strict=True))
        curves += [Curve(name, measured, colour), Curve("", fitted, colour, True, False)]
    if not curves:
        return None
    across, up = "samples along a side of a camera pixel", "rms error, partly hidden faces"
    title, note = "Error against sampling density", "dashed: fitted power law"
    return line_plot(title, across, up, curves, theme, [note])


def _time(comparison: Comparison, colours: dict[str, str], theme: PageTheme) -> "Figure":
    """Time per pose of each method and of the reference, on a logarithmic scale."""
    times = {s.name: 1e3 * s.seconds_per_pose for s in comparison.scores}
    times[f"reference: {comparison.against}"] = 1e3 * comparison.truth_seconds_per_pose
    title = "Time per pose, ms, on a logarithmic scale"
    figure, axes = new_axes(title, theme, 1.1 + 0.38 * len(times))
    axes.set(xscale="log", xlim=(min(times.values()) / 3, max(times.values()) * 3))
    bars = axes.barh(list(times), list(times.values()), 0.3, color=[*colours.values(), theme.soft])
    axes.bar_label(bars, fmt=" %.2g", color=theme.ink, fontsize=LABEL)
    axes.invert_yaxis()
    axes.xaxis.set_visible(False)
    return figure


def _share_above(counts: Sequence[tuple[float, int]], least: float) -> list[tuple[float, float]]:
    """Share of a histogram above the end of each bin, from `least` on, while it is above 0."""
    ends, filled = [end for end, _ in counts], np.array([n for _, n in counts])
    above = (filled.sum() - filled.cumsum()) / max(1, filled.sum())
    points = zip(ends, above.tolist(), strict=True)
    return [(x, y) for x, y in points if max(least, 1e-300) <= x < math.inf and y > 0]


def _middle(low: float, high: float) -> float:
    """Position of a size class on a logarithmic axis."""
    if low == 0:
        return high / 2
    return low * 2 if math.isinf(high) else math.sqrt(low * high)


def _negligible(error: float) -> str:
    """Text for an error that is rounding."""
    if error == 0:
        return "no error at all"
    return f"error below {ROUNDING:g}" if error < ROUNDING else f"error up to {error:.1g}"


def _ramp(ends: tuple[str, str], count: int) -> list[str]:
    """Colours from one end to the other."""
    from matplotlib.colors import LinearSegmentedColormap, to_hex

    ramp = LinearSegmentedColormap.from_list("", ends)
    return [to_hex(ramp(step)) for step in np.linspace(0, 1, count)]
