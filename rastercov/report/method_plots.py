"""Plots of a comparison of methods: errors by face size, bounds, convergence, time."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from rastercov.report.plots import LABEL, Axis, Curve, line_plot, new_axes
from rastercov.report.theme import Theme
from rastercov.validation.methods.convergence import Convergence
from rastercov.validation.methods.error_statistics import ROUNDING
from rastercov.validation.methods.results import MUST_HOLD, Comparison, Score

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NEGLIGIBLE_ERROR = 1e-6
"""Errors below which a curve is only named beside others that are larger."""
MIN_FACES = 5
"""Partly hidden faces of a size class that has a point in a plot."""


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
    figure, axes = new_axes("Time per pose (logarithmic scale)", theme, 1.1 + 0.38 * len(rows))
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
