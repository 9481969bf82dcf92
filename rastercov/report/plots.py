"""Plots of reports by matplotlib, in a light and a dark theme.

Every plot is a `matplotlib.figure.Figure` of its own; pyplot and its global state are not used.
matplotlib is imported with the first plot.
"""

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from rastercov._format import percent, short
from rastercov.network import Network, share_of_faces
from rastercov.placement.select.problem import BestCoverage, FewestCameras, Goal
from rastercov.placement.select.selection import Selection
from rastercov.report.html import Picture
from rastercov.report.images import png
from rastercov.report.theme import Theme
from rastercov.validation.markers.scoring import Score as MarkerScore
from rastercov.validation.methods.convergence import Convergence
from rastercov.validation.methods.error_statistics import ROUNDING
from rastercov.validation.methods.results import MUST_HOLD, Comparison, Score

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH, HEIGHT = 5.6, 4.0
"""Inches; 100 CSS pixels an inch on a page, twice as many in the picture."""
DPI = 200
FAST = {"compress_level": 1}
TITLE, LABEL, TICK = 13.0, 10.5, 10.0
"""Font sizes, points."""
LEGEND_ROW, BAR_ROW = 0.21, 0.3
"""Heights, inches."""
MAX_NAME = 28
"""Letters of a bar's name."""
NEGLIGIBLE_ERROR = 1e-6
"""Errors below which a curve is only named beside others that are larger."""
MIN_FACES = 5
"""Partly hidden faces of a size class that has a point in a plot."""
MAX_GROUPS = 24
"""Groups in a plot: those of the greatest area."""
MIN_MARKERS = 8
"""Markers of a coverage class that has a point in a plot."""


@dataclass(frozen=True)
class Axis:
    """Label, limits and scale of an axis."""

    label: str
    low: float
    high: float
    is_log: bool = False
    is_percent: bool = False
    is_whole: bool = False

    def ticks(self) -> list[float]:
        """Positions of ticks.

        Logarithmic: at most seven powers of ten, and their multiples by 2 and 5 on an axis shorter
        than a decade. Linear: about six multiples of 1, 2 or 5 times a power of ten.
        """
        if not self.is_log:
            step = (self.high - self.low) / 6
            power = 10.0 ** math.floor(math.log10(step))
            step = next(m * power for m in (1, 2, 5, 10) if m * power >= step * 0.999)
            step = max(1.0, step) if self.is_whole else step
            first, last = math.ceil(self.low / step - 1e-9), math.floor(self.high / step + 1e-9)
            return [round(step * k, 12) for k in range(first, last + 1)]
        first = math.ceil(math.log10(self.low) - 1e-9)
        last = math.floor(math.log10(self.high) + 1e-9)
        if last - first < 1:
            powers = range(math.floor(math.log10(self.low)), last + 2)
            every = [m * 10.0**power for power in powers for m in (1, 2, 5)]
            return [v for v in every if self.low * 0.999 <= v <= self.high * 1.001]
        return [10.0**power for power in range(first, last + 1, max(1, -(-(last - first) // 6)))]

    def share(self, value: float) -> float:
        """Position of a value: 0 at the low end, 1 at the high one."""
        if self.is_log:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)

    def text(self, value: float) -> str:
        """Label of a tick."""
        return f"{short(100 * value)} %" if self.is_percent else short(value)


@dataclass(frozen=True)
class Curve:
    """Points to join; curves without a name are not in the legend."""

    name: str
    points: Sequence[tuple[float, float]]
    colour: str
    is_dashed: bool = False
    has_markers: bool = True


def line_plot(
    title: str,
    across: Axis,
    up: Axis,
    curves: Sequence[Curve],
    theme: Theme,
    *,
    marks: Sequence[tuple[str, float, str]] = (),
    notes: Sequence[str] = (),
) -> "Figure":
    """Curves over two axes, their legend below.

    Parameters
    ----------
    title, across, up, curves, theme
        Content of the plot.
    marks : sequence of (axis, value, text)
        Lines across the plot at a value of axis "x" or "y".
    notes : sequence of str
        Lines above the entries of the legend.
    """
    names = [curve.name for curve in curves if curve.name]
    columns = max(1, min(len(names), 62 // (max(map(len, names), default=0) + 6)))
    rows = len(notes) + -(-len(names) // columns)
    figure, axes = _axes(title, theme, HEIGHT + LEGEND_ROW * rows)
    for axis, name in ((across, "x"), (up, "y")):
        getattr(axes, f"set_{name}scale")("log" if axis.is_log else "linear")
        getattr(axes, f"set_{name}lim")(axis.low, axis.high)
        ticks = axis.ticks()
        getattr(axes, f"set_{name}ticks")(ticks, [axis.text(value) for value in ticks])
        getattr(axes, f"set_{name}ticks")([], minor=True)
        getattr(axes, f"set_{name}label")(axis.label, color=theme.ink, fontsize=LABEL)
    axes.grid(color=theme.grid, linewidth=0.8)
    for side in ("left", "bottom"):
        axes.spines[side].set_visible(True)
        axes.spines[side].set_color(theme.soft)
    for curve in curves:
        axes.plot(
            [x for x, _ in curve.points],
            [y for _, y in curve.points],
            color=curve.colour,
            label=curve.name or "_",
            linestyle="--" if curve.is_dashed else "-",
            linewidth=1.9,
            marker="o" if curve.has_markers else "",
            markersize=6,
            markeredgecolor=theme.paper,
            clip_on=not curve.has_markers,  # a marker on the border is whole
        )
    for name, value, text in marks:
        is_x = name == "x"
        draw = axes.axvline if is_x else axes.axhline
        draw(value, color=theme.ink, linewidth=1.0, linestyle=(0, (4, 4)))
        # Beside the line at its end, on the side with more room.
        is_left = is_x and across.share(value) > 0.5
        axes.annotate(
            text,
            (value, 1) if is_x else (0, value),
            (-4 if is_left else 4, -3),
            axes.get_xaxis_transform() if is_x else axes.get_yaxis_transform(),
            "offset points",
            color=theme.ink,
            fontsize=TICK,
            ha="right" if is_left else "left",
            va="top",
        )
    if rows:
        legend = figure.legend(
            loc="outside lower left",
            ncols=columns,
            title="\n".join(notes) or None,
            title_fontsize=TICK,
            fontsize=TICK,
            labelcolor=theme.ink,
            frameon=False,
            alignment="left",
            handlelength=2.2,
        )
        legend.get_title().set_color(theme.soft)
    return figure


def bar_plot(
    title: str,
    bars: Sequence[tuple[str, float, str]],
    theme: Theme,
    note: str = "",
    good_from: int = 0,
) -> "Figure":
    """Horizontal bars from 0 to 1 with their names to the left and texts to the right.

    Bars before `good_from` are in the second colour of the theme.
    """
    height = 0.62 + BAR_ROW * len(bars) + (0.26 if note else 0)
    figure, axes = _axes(title, theme, height)
    rows = range(len(bars))
    shares = [min(1.0, max(0.0, share)) for _, share, _ in bars]
    axes.barh(rows, 1.0, 0.54, color=theme.grid)
    colours = [theme.series[0 if row >= good_from else 1] for row in rows]
    axes.barh(rows, shares, 0.54, color=colours)
    axes.set_xlim(0, 1)
    axes.set_ylim(len(bars) - 0.5, -0.5)
    axes.set_xticks([])
    axes.set_yticks(rows, [_shortened(name) for name, _, _ in bars], color=theme.ink)
    for row, (_, _, text) in enumerate(bars):
        axes.annotate(
            text, (1, row), (6, 0), textcoords="offset points", va="center",
            color=theme.ink, fontsize=LABEL,
        )  # fmt: skip
    if note:
        axes.set_xlabel(note, color=theme.soft, fontsize=TICK, loc="left")
    return figure


def image_of(figure: "Figure") -> Image.Image:
    """Picture of a figure, RGB."""
    file = io.BytesIO()
    figure.savefig(file, format="png", facecolor=figure.get_facecolor(), pil_kwargs=FAST)
    return Image.open(file).convert("RGB")


def picture_of(alt: str, light: "Figure", dark: "Figure") -> Picture:
    """A plot in both themes, for a page."""
    light_png, dark_png = (
        png(image_of(figure), Image.Quantize.MEDIANCUT) for figure in (light, dark)
    )
    return Picture(alt, light_png, dark_png)


def _axes(title: str, theme: Theme, height: float) -> "tuple[Figure, Axes]":
    """An empty figure with its title at the left, in the colours of a theme."""
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    figure = Figure(
        (WIDTH, height),
        dpi=DPI,
        facecolor=theme.paper,
        layout=ConstrainedLayoutEngine(w_pad=0.1, h_pad=0.08),
    )
    figure.suptitle(title, x=0.018, ha="left", color=theme.ink, fontsize=TITLE)
    axes = figure.add_subplot()
    axes.set_facecolor(theme.paper)
    axes.set_axisbelow(True)
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0, labelsize=TICK, labelcolor=theme.soft, labelfontfamily="DejaVu Sans")
    return figure, axes


def _shortened(name: str) -> str:
    """A name on one line, of `MAX_NAME` letters at most, without markup or missing glyphs."""
    from matplotlib.font_manager import findfont, get_font

    name = " ".join(name.split())
    name = name if len(name) <= MAX_NAME else name[: MAX_NAME - 1] + "…"
    font = get_font(findfont("DejaVu Sans"))
    return "".join(c if font.get_char_index(ord(c)) else "□" for c in name).replace("$", r"\$")


# --- comparison of methods ------------------------------------------------------------------------


def comparison_plots(comparison: Comparison, theme: Theme) -> "dict[str, Figure]":
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
    scores: Sequence[Score], colours: dict[str, str], theme: Theme
) -> "Figure | None":
    """RMS error of partly hidden faces over the area of their images, and the mean bound."""
    curves, notes, errors = [], [], []
    for score in scores:
        classes = [c for c in score.size_classes if c.partly_hidden >= MIN_FACES]
        points = [(_middle(c.low, c.high), c.rms_partly_hidden) for c in classes]
        greatest = max((error for _, error in points), default=0.0)
        if greatest < NEGLIGIBLE_ERROR:
            notes.append(f"{score.name}: {_negligible(greatest)}")
            continue
        colour = colours[score.name]
        points = [(x, max(y, NEGLIGIBLE_ERROR)) for x, y in points]
        bounds = [(_middle(c.low, c.high), c.mean_bound_partly_hidden) for c in classes]
        curves += [Curve(score.name, points, colour), Curve("", bounds, colour, True, False)]
        errors += [y for _, y in points]
    if not curves:
        return None
    curves.append(Curve("dashed: mean bound", (), theme.soft, True, False))
    return line_plot(
        "Error of partly hidden faces, by size",
        Axis("area of the face in the image, px²", 0.03, 8192, is_log=True),
        Axis("rms error of the visible fraction", min(errors) / 2, 1.2, is_log=True),
        curves,
        theme,
        notes=notes,
    )


def _error_distribution(score: Score, theme: Theme) -> "Figure | None":
    """Share of faces whose error exceeds x, one curve for each size class."""
    curves, ends = [], []
    ramp = _ramp(theme.sizes, len(score.size_classes))
    for size, colour in zip(score.size_classes, ramp, strict=True):
        if points := _share_above(size.errors, size.figures):
            limits = f"{size.low:g} to {size.high:g}"
            name = limits if size.high < math.inf else f"from {size.low:g}"
            curves.append(Curve(name, points, colour, has_markers=False))
            ends += [x for x, _ in points]
    if not curves:
        return None
    low = max(min(ends), 1e-4 if max(ends) > NEGLIGIBLE_ERROR else 0) / 2
    lowest = min(y for curve in curves for _, y in curve.points)
    return line_plot(
        f"{score.name}: faces whose error exceeds x",
        Axis("error of the visible fraction", low, max(max(ends), low * 20), is_log=True),
        Axis("share of faces", min(lowest / 2, 0.1), 1.0, is_log=True, is_percent=True),
        curves,
        theme,
        notes=["by the area of the face in the image, px²"],
    )


def _bound_tightness(
    scores: Sequence[Score], colours: dict[str, str], theme: Theme
) -> "Figure | None":
    """Share of partly hidden faces whose |error| / bound exceeds x."""
    curves, ends = [], [1.0]
    for score in scores:
        for bound in score.bounds:
            points = _share_above(bound.ratios, sum(n for _, n in bound.ratios))
            if bound.kind == "statistical" and points:
                curves.append(Curve(score.name, points, colours[score.name], has_markers=False))
                ends += [x for x, _ in points]
    if not curves:
        return None
    lowest = min(y for curve in curves for _, y in curve.points)
    most = max(2.0, 1.5 * max(x for x in ends if x < math.inf))
    return line_plot(
        "Tightness of the statistical bounds",
        Axis("error / bound", 1e-3, most, is_log=True),
        Axis(
            "share of partly hidden faces", min(lowest / 2, 3e-4), 1.0, is_log=True, is_percent=True
        ),
        curves,
        theme,
        marks=(
            ("x", 1.0, "the bound"),
            ("y", 1 - MUST_HOLD, f"allowed: {100 * (1 - MUST_HOLD):.1f} % beyond the bound"),
        ),
    )


def _convergence(found: Sequence[Convergence], theme: Theme) -> "Figure | None":
    """RMS error of the same faces over the density of samples, with the fitted power law."""
    curves: list[Curve] = []
    points: list[tuple[float, float]] = []
    for i, sweep in enumerate(s for s in found if s.slope is not None):
        colour = theme.series[i % len(theme.series)]
        assert sweep.slope is not None
        error = f" ± {sweep.slope_error:.2f}" if sweep.slope_error else ""
        name = f"{sweep.method}, {sweep.sweep}: slope {sweep.slope:.2f}{error}"
        measured = list(zip(sweep.samples_per_side, sweep.rms, strict=True))
        curves.append(Curve(name, measured, colour))
        # The fitted line goes through the mean of the logarithms.
        x, y = np.log(measured).T
        fit = np.exp(y.mean() + sweep.slope * (x - x.mean())).tolist()
        fitted = list(zip(sweep.samples_per_side, fit, strict=True))
        curves.append(Curve("", fitted, colour, True, False))
        points += measured + fitted
    if not curves:
        return None
    xs, ys = zip(*points, strict=True)
    return line_plot(
        "Error over the density of samples",
        Axis("samples along a side of a camera pixel", min(xs) / 1.2, max(xs) * 1.2, is_log=True),
        Axis("rms error, partly hidden faces", min(ys) / 1.6, max(ys) * 1.6, is_log=True),
        curves,
        theme,
    )


def _time(comparison: Comparison, colours: dict[str, str], theme: Theme) -> "Figure":
    """Time per pose of each method and of the reference, on a logarithmic scale."""
    rows = [(s.name, 1e3 * s.seconds_per_pose, colours[s.name]) for s in comparison.scores]
    truth = f"truth: {comparison.against}"
    rows.append((truth, 1e3 * comparison.truth_seconds_per_pose, theme.soft))
    figure, axes = _axes("Time per pose (logarithmic scale)", theme, 1.1 + 0.38 * len(rows))
    times = [ms for _, ms, _ in rows]
    low, high = math.floor(math.log10(min(times))), math.ceil(math.log10(max(times) * 1.01))
    axis = Axis("ms", 10.0**low, 10.0**high, is_log=True)
    axes.set_xscale("log")
    axes.set_xlim(axis.low, axis.high)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xticks(axis.ticks(), [f"{axis.text(v)} ms" for v in axis.ticks()])
    axes.set_xticks([], minor=True)
    axes.set_yticks(range(len(rows)), [name for name, _, _ in rows], color=theme.ink)
    axes.grid(axis="x", color=theme.grid, linewidth=0.8)
    for row, (_, ms, colour) in enumerate(rows):
        axes.plot([axis.low, ms], [row, row], color=colour, linewidth=2.2)
        axes.plot([ms], [row], "o", color=colour, markersize=8, clip_on=False)
        axes.annotate(
            f"{ms:,.{max(0, 1 - math.floor(math.log10(ms)))}f} ms", (ms, row), (9, 0),
            textcoords="offset points", va="center", color=theme.ink, fontsize=LABEL,
        )  # fmt: skip
    return figure


def _share_above(counts: Sequence[tuple[float, int]], total: int) -> list[tuple[float, float]]:
    """Share of a histogram above the end of each of its bins, while it is above 0."""
    left = total
    points: list[tuple[float, float]] = []
    for end, n in counts:
        if 0 < end < math.inf:
            # The curve is constant up to the start of the first bin.
            points += [] if points else [(end / 10**0.1, left / total)]
            points.append((end, (left - n) / total))
        left -= n
    return [(x, y) for x, y in points if y > 0]


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
    first, last = (np.array([int(text[i : i + 2], 16) for i in (1, 3, 5)]) for text in ends)
    steps = np.linspace(0, 1, count)[:, None]
    colours = np.rint(first + steps * (last - first)).astype(int).tolist()
    return ["#" + "".join(f"{channel:02x}" for channel in colour) for colour in colours]


# --- placement ------------------------------------------------------------------------------------


def group_bars(network: Network, theme: Theme) -> "Figure":
    """Share of each group's area that is covered, the largest groups first."""
    bars = group_shares(network)
    left_out = len(bars) - MAX_GROUPS
    note = f"and {left_out} smaller groups, see the table" if left_out > 0 else ""
    return bar_plot("Covered, by group", bars[:MAX_GROUPS], theme, note)


def group_shares(network: Network) -> list[tuple[str, float, str]]:
    """Name, covered share and its text for each task group, the largest first."""
    mesh = network.mesh
    rows = []
    for index, group in enumerate(mesh.groups):
        members = mesh.face_group == index
        if not group.is_occluder and members.any():
            share = share_of_faces(mesh, members & network.covered, members)["area_percent"] / 100
            rows.append((float(mesh.areas[members].sum()), group.name, share))
    rows.sort(key=lambda row: -row[0])
    return [(name, share, f"{percent(share)} of the area") for _, name, share in rows]


def overlap_histogram(network: Network, theme: Theme) -> "Figure":
    """Share of the task's area by the number of cameras that cover it."""
    need = network.task.views
    note = f"a face is covered from {need} on" if need > 1 else ""
    return bar_plot(
        "Area by number of covering cameras", overlap_shares(network), theme, note, need
    )


def overlap_shares(network: Network) -> list[tuple[str, float, str]]:
    """Number of cameras, share of the task's area that they cover, and its text."""
    mesh, task = network.mesh, network.mesh.task_mask
    most = int(network.views[task].max(initial=0))
    last = min(most, max(network.task.views, 11))
    bars = []
    for count in range(last + 1):
        is_open = count == last and most > last
        faces = task & ((network.views >= count) if is_open else (network.views == count))
        share = share_of_faces(mesh, faces, task)["area_percent"] / 100
        word = "camera" if count == 1 else "cameras"
        bars.append((f"{count}{'+' if is_open else ''} {word}", share, percent(share)))
    return bars


def coverage_curve(selection: Selection, goal: Goal, theme: Theme) -> "Figure":
    """Coverage by the first cameras of a selection, and the bound of any selection."""
    shares = [0.0, *selection.curve.tolist()]
    curves = [Curve("chosen cameras, best first", list(enumerate(shares)), theme.series[0])]
    marks: list[tuple[str, float, str]] = []
    if isinstance(goal, BestCoverage):
        marks.append(("y", selection.bound, f"none covers more than {percent(selection.bound)}"))
    else:
        marks.append(("y", shares[-1], f"{percent(shares[-1])} is covered"))
        if float(selection.bound).is_integer() and selection.cost == len(selection.chosen):
            marks.append(("x", selection.bound, f"fewer than {selection.bound:g} cannot do it"))
    of_all = isinstance(goal, FewestCameras) and goal.of_reachable
    return line_plot(
        "Coverage by number of cameras",
        Axis("cameras", 0, max(len(selection.chosen), 2), is_whole=True),
        Axis("covered (of everything)" if of_all else "covered", 0, 1.04, is_percent=True),
        curves,
        theme,
        marks=marks,
    )


# --- marker validation ----------------------------------------------------------------------------


def calibration_plot(scores: Sequence[MarkerScore], theme: Theme) -> "Figure":
    """Share of markers found over predicted coverage, curves of up to six models, ours on top.

    Classes with fewer than `MIN_MARKERS` markers are left out.
    """
    curves = []
    for colour, score in zip((0, 1, 2, 3, 4, 6), scores, strict=False):
        points = [
            ((low + min(high, 1.0)) / 2, found)
            for low, high, found, count in score.calibration
            if count >= MIN_MARKERS
        ]
        if len(points) > 1:
            curves.append(Curve(score.model, points, theme.series[colour]))
    return line_plot(
        f"Coverage and detection, {scores[0].requirement} requirement",
        Axis("predicted coverage", 0.0, 1.0),
        Axis("markers found", 0.0, 1.0, is_percent=True),
        curves[::-1],
        theme,
    )
