"""A small kit for plots: themes, axes, curves with a legend, in pillow.

For `compare` and `placement`. Plots are drawn larger and scaled down, for smooth lines.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

from PIL import Image, ImageDraw, ImageFont

Points = Sequence[tuple[float, float]]

WIDTH, HEIGHT = 560, 400
"""Size of a plot as a page shows it; the picture has twice the pixels."""
FINE = 4
"""Pixels drawn for one of those."""


@dataclass(frozen=True)
class Theme:
    """Colours of a plot: its ground, its letters and lines, and one for each series."""

    paper: str
    ink: str
    soft: str
    grid: str
    series: tuple[str, ...]
    sizes: tuple[str, str]


LIGHT = Theme(
    "#ffffff", "#1b2129", "#5b6673", "#e3e7ec",
    ("#0072b2", "#d55e00", "#009e73", "#b0569a", "#8a6d00", "#4a90c2", "#777777"),
    ("#f2b36b", "#5b1a6e"),
)  # fmt: skip
DARK = Theme(
    "#171c22", "#e6eaef", "#9aa6b3", "#2c343d",
    ("#58a9e8", "#ff9052", "#3ccb9d", "#e59ac9", "#dcc04c", "#9fd0f2", "#aaaaaa"),
    ("#8a4fa0", "#ffd9a0"),
)  # fmt: skip


@dataclass(frozen=True)
class Curve:
    """Points to join, in the units of the axes."""

    name: str
    points: Points
    colour: str
    is_dashed: bool = False
    has_markers: bool = True


@dataclass(frozen=True)
class Axis:
    """A logarithmic axis."""

    label: str
    low: float
    high: float
    is_percent: bool = False

    def place(self, value: float) -> float:
        """0 at the low end, 1 at the high one; values beyond are at the ends."""
        if value <= self.low:
            return 0.0
        return min(1.0, math.log(value / self.low) / math.log(self.high / self.low))

    def ticks(self) -> list[tuple[float, str]]:
        """Powers of ten, not more than seven of them; of a short axis 2 and 5 too."""
        first, last = (
            math.ceil(math.log10(self.low) - 1e-9),
            math.floor(math.log10(self.high) + 1e-9),
        )
        step = max(1, math.ceil((last - first) / 6))
        values = [10.0**power for power in range(first, last + 1, step)]
        if last - first < 1:
            start = math.floor(math.log10(self.low))
            every = [m * 10.0**p for p in range(start, last + 2) for m in (1, 2, 5)]
            values = [v for v in every if self.low * 0.999 <= v <= self.high * 1.001]
        return [(value, self.text(value)) for value in values]

    def text(self, value: float) -> str:
        """A tick's label."""
        if self.is_percent:
            return f"{_short(100 * value)} %"
        return _short(value)


@dataclass(frozen=True)
class LinearAxis:
    """An axis of even steps."""

    label: str
    low: float
    high: float
    is_percent: bool = False
    is_whole: bool = False

    def place(self, value: float) -> float:
        """0 at the low end, 1 at the high one; values beyond are at the ends."""
        return min(1.0, max(0.0, (value - self.low) / (self.high - self.low)))

    def ticks(self) -> list[tuple[float, str]]:
        """Multiples of 1, 2 or 5 times a power of ten, about six of them."""
        rough = (self.high - self.low) / 6
        power = 10.0 ** math.floor(math.log10(rough))
        step = next(m * power for m in (1, 2, 5, 10) if m * power >= rough * 0.999)
        step = max(1.0, step) if self.is_whole else step
        first, last = math.ceil(self.low / step - 1e-9), math.floor(self.high / step + 1e-9)
        values = [step * k for k in range(first, last + 1)]
        if self.is_percent:
            return [(value, f"{_short(round(100 * value, 9))} %") for value in values]
        return [(value, _short(round(value, 12))) for value in values]


class Scale(Protocol):
    """An axis, whatever its steps."""

    @property
    def label(self) -> str:
        """What it measures."""
        ...

    @property
    def low(self) -> float:
        """Where it begins."""
        ...

    def place(self, value: float) -> float:
        """0 at its low end, 1 at its high one."""
        ...

    def ticks(self) -> list[tuple[float, str]]:
        """Values and words to write at it."""
        ...


def _short(value: float) -> str:
    """A number with one digit that counts, such as 0.002, 50 or 2e-7."""
    if value == 0 or 1e-4 <= value < 1e5:
        return f"{value:.10g}"
    digit, power = f"{value:.0e}".split("e")
    return f"{digit}e{int(power)}"


class Canvas:
    """A plot in the making: title, axes, curves and a legend."""

    def __init__(self, title: str, theme: Theme, height: int = HEIGHT) -> None:
        self.theme, self.height = theme, height
        self.image = Image.new("RGB", (WIDTH * FINE, height * FINE), theme.paper)
        self.draw = ImageDraw.Draw(self.image)
        self.text((14, 22), title, 18, theme.ink, "lm")

    def text(
        self, at: tuple[float, float], words: str, size: int, colour: str, anchor: str = "lm"
    ) -> float:
        """Write a line; gives its width."""
        font = ImageFont.load_default(float(size * FINE))
        self.draw.text((at[0] * FINE, at[1] * FINE), words, colour, font, anchor=anchor)
        return float(font.getlength(words)) / FINE

    def line(self, points: Points, colour: str, width: float = 2.0, dash: float = 0.0) -> None:
        """Join points, with round corners; dashes as long as the gaps between them."""
        fine = [(x * FINE, y * FINE) for x, y in points]
        if not dash:
            self.draw.line(fine, colour, round(width * FINE), "curve")
            return
        run, on = 0.0, True
        for (x0, y0), (x1, y1) in pairwise(fine):
            length, done = math.hypot(x1 - x0, y1 - y0), 0.0
            while done < length:
                part = min(dash * FINE - run, length - done)
                if on:
                    a, b = done / length, (done + part) / length
                    ends = [(x0 + t * (x1 - x0), y0 + t * (y1 - y0)) for t in (a, b)]
                    self.draw.line(ends, colour, round(width * FINE))
                run, done = run + part, done + part
                if run >= dash * FINE - 1e-9:
                    run, on = 0.0, not on

    def box(self, low: tuple[float, float], high: tuple[float, float], colour: str) -> None:
        """A filled rectangle between two corners."""
        self.draw.rectangle([value * FINE for value in (*low, *high)], colour)

    def dot(self, at: tuple[float, float], colour: str, radius: float = 4.0) -> None:
        """A disc with a rim of paper."""
        for r, fill in ((radius + 1.2, self.theme.paper), (radius, colour)):
            box = [(at[0] - r) * FINE, (at[1] - r) * FINE, (at[0] + r) * FINE, (at[1] + r) * FINE]
            self.draw.ellipse(box, fill)

    def done(self) -> Image.Image:
        """The picture, at twice the size that a page shows."""
        return self.image.resize((WIDTH * 2, self.height * 2), Image.Resampling.BOX)

    def legend(self, curves: Sequence[Curve], notes: Sequence[str] = ()) -> float:
        """Names of the curves below the title, in rows; gives where the plot may begin."""
        x, y = 14.0, 48.0
        font = ImageFont.load_default(float(15 * FINE))
        for curve in curves:
            width = 30 + font.getlength(curve.name) / FINE
            if x > 14 and x + width > WIDTH - 10:
                x, y = 14.0, y + 22
            ends = ((x, y), (x + 22, y))
            self.line(ends, curve.colour, 3, 4 if curve.is_dashed else 0)
            self.text((x + 28, y), curve.name, 15, self.theme.ink)
            x += width + 16
        for note in notes:
            x, y = 14.0, y + (22 if curves else 0)
            self.text((x, y), note, 15, self.theme.soft)
        return y + 20


def line_plot(
    title: str,
    across: Scale,
    up: Scale,
    curves: Sequence[Curve],
    theme: Theme,
    *,
    marks: Sequence[tuple[str, float, str]] = (),
    notes: Sequence[str] = (),
) -> Image.Image:
    """Curves over two axes.

    Parameters
    ----------
    title, across, up, curves, theme
        What to draw.
    marks : sequence of (axis, value, words)
        Lines across the plot: axis "x" or "y".
    notes : sequence of str
        Lines below the legend.
    """
    canvas = Canvas(title, theme)
    top = canvas.legend([curve for curve in curves if curve.name], notes)
    left, right, bottom = 84.0, WIDTH - 20.0, HEIGHT - 56.0

    def at(x: float, y: float) -> tuple[float, float]:
        return left + across.place(x) * (right - left), bottom - up.place(y) * (bottom - top)

    for value, words in across.ticks():
        x = at(value, up.low)[0]
        canvas.line(((x, top), (x, bottom)), theme.grid, 1)
        canvas.text((x, bottom + 14), words, 14, theme.soft, "mm")
    for value, words in up.ticks():
        y = at(across.low, value)[1]
        canvas.line(((left, y), (right, y)), theme.grid, 1)
        canvas.text((left - 8, y), words, 14, theme.soft, "rm")
    canvas.line(((left, top), (left, bottom), (right, bottom)), theme.soft, 1.2)
    canvas.text(((left + right) / 2, HEIGHT - 16), across.label, 15, theme.ink, "mm")
    _upright(canvas, up.label, (top + bottom) / 2)
    for axis, value, words in marks:
        if axis == "x":
            x = at(value, up.low)[0]
            canvas.line(((x, top), (x, bottom)), theme.ink, 1.4, 4)
            side = "rt" if x > (left + right) / 2 else "lt"
            canvas.text((x + (-6 if side == "rt" else 6), top + 4), words, 14, theme.ink, side)
        else:
            y = at(across.low, value)[1]
            canvas.line(((left, y), (right, y)), theme.ink, 1.4, 4)
            canvas.text((left + 6, y + 11), words, 14, theme.ink, "lm")
    for curve in curves:
        points = [at(x, y) for x, y in curve.points]
        canvas.line(points, curve.colour, 2.6, 5 if curve.is_dashed else 0)
        if curve.has_markers:
            for point in points:
                canvas.dot(point, curve.colour)
    return canvas.done()


def _upright(canvas: Canvas, words: str, middle: float) -> None:
    """The label of the axis that goes up, turned by a quarter."""
    font = ImageFont.load_default(float(15 * FINE))
    size = (round(font.getlength(words)) + 8, 22 * FINE)
    strip = Image.new("RGB", size, canvas.theme.paper)
    ImageDraw.Draw(strip).text((4, size[1] / 2), words, canvas.theme.ink, font, anchor="lm")
    turned = strip.rotate(90, expand=True)
    canvas.image.paste(turned, (5 * FINE, round(middle * FINE - turned.height / 2)))
