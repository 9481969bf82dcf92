"""Pages of comparisons: plots by matplotlib, in a light and a dark theme, and their files.

Every plot is a `matplotlib.figure.Figure` of its own; pyplot and its global state are not used.
matplotlib is imported with the first plot.
"""

import io
import math
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from PIL import Image

from rastercov.base.errors import ConfigError
from rastercov.base.interrupts import interrupts_held
from rastercov.base.output import write_bytes, write_json, write_text
from rastercov.report import theme as pages
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.report.images import png
from rastercov.report.pages import Picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Theme(pages.Theme):
    """Colours of a page and of its plots, CSS strings."""

    paper: str  # background of plots
    grid: str
    series: tuple[str, ...]  # curves of a plot, in order
    sizes: tuple[str, str]  # ends of the ramp for classes of face size


LIGHT = Theme(
    **vars(pages.LIGHT),
    paper="#ffffff",
    grid="#e3e7ec",
    series=("#0072b2", "#d55e00", "#009e73", "#b0569a", "#8a6d00", "#4a90c2", "#777777"),
    sizes=("#f2b36b", "#5b1a6e"),
)
DARK = Theme(
    **vars(pages.DARK),
    paper="#171c22",
    grid="#2c343d",
    series=("#58a9e8", "#ff9052", "#3ccb9d", "#e59ac9", "#dcc04c", "#9fd0f2", "#aaaaaa"),
    sizes=("#8a4fa0", "#ffd9a0"),
)
WIDTH, HEIGHT = 5.6, 4.0
"""Inches; 100 CSS pixels an inch on a page, twice as many in the picture."""
DPI = 200
FAST = {"compress_level": 1}
TITLE, LABEL, TICK = 13.0, 10.5, 10.0
"""Font sizes, points."""
LEGEND_ROW = 0.21
"""Height, inches."""


def percent_of(part: float, whole: float, digits: int = 3) -> str:
    """`part / whole` in percent, rounded down, so that only all of it is 100 %; "" of nothing."""
    if not whole:
        return ""
    if part == whole:
        return "100 %"
    scale = 10**digits
    return f"{math.floor(100 * scale * part / whole) / scale:.{digits}f} %"


def milliseconds(seconds: float) -> str:
    """A time in milliseconds, in two significant digits or to the millisecond."""
    return f"{1e3 * seconds:.2g} ms" if seconds < 0.1 else f"{1e3 * seconds:,.0f} ms"


def short(value: float) -> str:
    """The label of a tick: as many digits as the number has, such as 0.002, 50 or 2e-7."""
    value = float(f"{value:.10g}")
    if value == 0 or 1e-4 <= abs(value) < 1e5:
        return f"{value:.10g}"
    digit, power = f"{value:.0e}".split("e")
    return f"{digit}e{int(power)}"


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
    """Curves over two axes, their legend below with some notes above its entries.

    Marks (axis, value, text) are lines across the plot at a value of axis "x" or "y".
    """
    names = [curve.name for curve in curves if curve.name]
    columns = max(1, min(len(names), 62 // (max(map(len, names), default=0) + 6)))
    rows = len(notes) + -(-len(names) // columns)
    figure, axes = new_axes(title, theme, HEIGHT + LEGEND_ROW * rows)
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
    for mark in marks:
        _mark(axes, across, mark, theme)
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


def _mark(axes: "Axes", across: Axis, mark: tuple[str, float, str], theme: Theme) -> None:
    """Draw a line across the plot, with its text at its end, on the side with more room."""
    name, value, text = mark
    is_x = name == "x"
    draw = axes.axvline if is_x else axes.axhline
    draw(value, color=theme.ink, linewidth=1.0, linestyle=(0, (4, 4)))
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


def opened(out: Path | ReportFolder, kind: ReportKind) -> AbstractContextManager[ReportFolder]:
    """Context manager of a folder: of one that is open already, that one.

    Raises
    ------
    ConfigError
        Without matplotlib, which draws the plots at the end of the work.
    """
    if find_spec("matplotlib") is None:
        raise ConfigError("plots need matplotlib; run: pip install 'rastercov[compare]'")
    return nullcontext(out) if isinstance(out, ReportFolder) else ReportFolder(out, kind)


def publish(
    folder: ReportFolder, page: str, data: object, pictures: Mapping[str, Picture] | None = None
) -> Path:
    """Write the pictures, the page and the JSON of a report, and publish them with signals held.

    The last file of the folder, such as compare.json, names the page, such as compare.html, whose
    path is returned. Pictures are given by the names of their files without ".png".
    """
    name = Path(folder.kind.last).stem
    with interrupts_held():
        for stem, picture in (pictures or {}).items():
            write_bytes(folder.file(f"{stem}.png"), picture.light)
        write_text(folder.file(f"{name}.html"), page)
        write_json(folder.file(f"{name}.json"), data)
        folder.publish()
    return folder.path / f"{name}.html"


def new_axes(title: str, theme: Theme, height: float) -> "tuple[Figure, Axes]":
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
