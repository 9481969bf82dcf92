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

from rastercov.base import ConfigError, write_bytes, write_json, write_text
from rastercov.base.interrupts import hold_interrupts
from rastercov.report import theme as pages
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.report.images import png
from rastercov.report.pages import Picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class PageTheme(pages.Theme):
    """Colours of a page and of its plots, CSS strings."""

    paper: str  # background of plots
    grid: str
    series: tuple[str, ...]  # curves of a plot, in order
    sizes: tuple[str, str]  # ends of the ramp for classes of face size


LIGHT = PageTheme(
    **vars(pages.LIGHT),
    paper="#ffffff",
    grid="#e3e7ec",
    series=("#0072b2", "#d55e00", "#009e73", "#b0569a", "#8a6d00", "#4a90c2", "#777777"),
    sizes=("#f2b36b", "#5b1a6e"),
)
DARK = PageTheme(
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
    across: str,
    up: str,
    curves: Sequence[Curve],
    theme: PageTheme,
    notes: Sequence[str] = (),
) -> "Figure":
    """Curves over two logarithmic axes, their legend below with some notes above its entries."""
    from matplotlib.ticker import LogFormatter

    names = [curve.name for curve in curves if curve.name]
    columns = max(1, min(len(names), 62 // (max(map(len, names), default=0) + 6)))
    rows = len(notes) + -(-len(names) // columns)
    figure, axes = new_axes(title, theme, HEIGHT + LEGEND_ROW * rows)
    axes.set(xscale="log", yscale="log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(LogFormatter())
        axis.set_minor_formatter(LogFormatter(minor_thresholds=(1.5, 0.4)))
        axis.set_tick_params("minor", labelsize=TICK, labelcolor=theme.soft)
    axes.set_xlabel(across, color=theme.ink, fontsize=LABEL)
    axes.set_ylabel(up, color=theme.ink, fontsize=LABEL)
    axes.grid(color=theme.grid, linewidth=0.8)
    axes.spines[["left", "bottom"]].set_visible(True)
    axes.spines[["left", "bottom"]].set_color(theme.soft)
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
        )
    figure.legend(
        loc="outside lower left",
        ncols=columns,
        title="\n".join(notes) or None,
        title_fontsize=TICK,
        fontsize=TICK,
        labelcolor=theme.ink,
        frameon=False,
        alignment="left",
        handlelength=2.2,
    ).get_title().set_color(theme.soft)
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


def open_browser(
    out: Path | ReportFolder, kind: ReportKind
) -> AbstractContextManager[ReportFolder]:
    """Context manager of a folder: of one that is open already, that one.

    Raises
    ------
    ConfigError
        Without matplotlib, which draws the plots at the end of the work.
    """
    if find_spec("matplotlib") is None:
        raise ConfigError(
            "expected matplotlib for plots, got none; pip install 'rastercov[compare]'"
        )
    return nullcontext(out) if isinstance(out, ReportFolder) else ReportFolder(out, kind)


def publish(
    folder: ReportFolder, page: str, data: object, pictures: Mapping[str, Picture] | None = None
) -> Path:
    """Write the pictures, the page and the JSON of a report, and publish them with signals held.

    The last file of the folder, such as compare.json, names the page, such as compare.html, whose
    path is returned. Pictures are given by the names of their files without ".png".
    """
    name = Path(folder.kind.last).stem
    with hold_interrupts():
        for stem, picture in (pictures or {}).items():
            write_bytes(folder.file(f"{stem}.png"), picture.light)
        write_text(folder.file(f"{name}.html"), page)
        write_json(folder.file(f"{name}.json"), data)
        folder.publish()
    return folder.path / f"{name}.html"


def new_axes(title: str, theme: PageTheme, height: float) -> "tuple[Figure, Axes]":
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
