"""Plots of a comparison: errors by face size, how often and how tightly bounds hold, time.

Part of `page`: from a `Comparison` to `PIL.Image`, in a light or a dark theme.
"""

import math
from collections.abc import Sequence

from PIL import Image, ImageFont

from rastercov.report.canvas import FINE, WIDTH, Axis, Canvas, Curve, Theme, line_plot
from rastercov.validation.methods.convergence import Convergence
from rastercov.validation.methods.error_statistics import ROUNDING
from rastercov.validation.methods.results import MUST_HOLD, Comparison, Score

FLOOR = 1e-6
"""Errors below which a curve is only named, where others are above."""


def plots(comparison: Comparison, theme: Theme) -> dict[str, Image.Image]:
    """Every plot that the comparison has figures for, by the name of its file."""
    scores = comparison.scores
    colours = {s.name: theme.series[i % len(theme.series)] for i, s in enumerate(scores)}
    drawn: dict[str, Image.Image | None] = {"error_by_size": _error_by_size(scores, colours, theme)}
    for score in scores:
        drawn[f"errors_{file_name(score.name)}"] = _errors(score, theme)
    drawn["bounds"] = _bounds(scores, colours, theme)
    drawn["convergence"] = _convergence(comparison.convergence, theme)
    drawn["time"] = _time(comparison, colours, theme)
    return {name: image for name, image in drawn.items() if image}


def file_name(name: str) -> str:
    """Name of a candidate as part of the name of a file."""
    return "".join(c if c.isalnum() else "_" for c in name)


def _error_by_size(
    scores: Sequence[Score], colours: dict[str, str], theme: Theme
) -> Image.Image | None:
    """RMS error of partly hidden faces over the area of their images, and the mean bound."""
    curves, notes, errors = [], [], []
    for score in scores:
        classes = [c for c in score.size_classes if c.partly_hidden >= 5]
        points = [(_middle(c.low, c.high), c.rms_partly_hidden) for c in classes]
        greatest = max((error for _, error in points), default=0.0)
        if greatest < FLOOR:
            notes.append(f"{score.name}: {_least(greatest)}")
            continue
        colour = colours[score.name]
        points = [(x, max(y, FLOOR)) for x, y in points]
        bounds = [(_middle(c.low, c.high), c.mean_bound_partly_hidden) for c in classes]
        curves += [Curve(score.name, points, colour), Curve("", bounds, colour, True, False)]
        errors += [y for _, y in points]
    if not curves:
        return None
    curves.append(Curve("dashed: the bound it gave", (), theme.soft, True, False))
    return line_plot(
        "Error of partly hidden faces, by size",
        Axis("area of the face in the image, px^2", 0.03, 8192),
        Axis("rms error of the visible fraction", min(errors) / 2, 1.2),
        curves,
        theme,
        notes=notes,
    )


def _errors(score: Score, theme: Theme) -> Image.Image | None:
    """Share of faces whose error exceeds x, a curve for each class of size."""
    curves, ends = [], []
    n = len(score.size_classes)
    for i, size in enumerate(score.size_classes):
        points = _share_above(size.errors, size.figures)
        if points:
            name = (
                f"{size.low:g} to {size.high:g}" if size.high < math.inf else f"from {size.low:g}"
            )
            curves.append(Curve(name, points, _blend(theme.sizes, i / max(1, n - 1)), False, False))
            ends += [x for x, _ in points]
    if not curves:
        return None
    low = max(min(ends), 1e-4 if max(ends) > FLOOR else 0) / 2
    lowest = min(y for curve in curves for _, y in curve.points)
    return line_plot(
        f"{score.name}: faces whose error exceeds x",
        Axis("error of the visible fraction", low, max(max(ends), low * 20)),
        Axis("share of faces", min(lowest / 2, 0.1), 1.0, is_percent=True),
        curves,
        theme,
        notes=["by the area of the face in the image, px^2"],
    )


def _bounds(scores: Sequence[Score], colours: dict[str, str], theme: Theme) -> Image.Image | None:
    """Share of partly hidden faces whose |error| / bound exceeds x."""
    curves, ends = [], [1.0]
    for score in scores:
        for bound in score.bounds:
            points = _share_above(bound.ratios, sum(n for _, n in bound.ratios))
            if bound.kind == "statistical" and points:
                curves.append(Curve(score.name, points, colours[score.name], False, False))
                ends += [x for x, _ in points]
    if not curves:
        return None
    lowest = min(y for curve in curves for _, y in curve.points)
    return line_plot(
        "How tight the statistical bounds are",
        Axis("error / bound", 1e-3, max(2.0, 1.5 * max(x for x in ends if x < math.inf))),
        Axis("share of partly hidden faces", min(lowest / 2, 3e-4), 1.0, is_percent=True),
        curves,
        theme,
        marks=(
            ("x", 1.0, "the bound"),
            ("y", 1 - MUST_HOLD, f"allowed: {100 * (1 - MUST_HOLD):.1f} % beyond the bound"),
        ),
    )


def _convergence(found: Sequence[Convergence], theme: Theme) -> Image.Image | None:
    """RMS error of the same faces over the density of samples, with the fitted power."""
    curves: list[Curve] = []
    xs: list[float] = []
    ys: list[float] = []
    for i, sweep in enumerate(s for s in found if s.slope is not None):
        colour = theme.series[i % len(theme.series)]
        assert sweep.slope is not None
        error = f" ± {sweep.slope_error:.2f}" if sweep.slope_error else ""
        name = f"{sweep.method}, {sweep.sweep}: slope {sweep.slope:.2f}{error}"
        points = list(zip(sweep.samples_per_side, sweep.rms, strict=True))
        curves.append(Curve(name, points, colour))
        # The fitted line goes through the mean of the logarithms.
        log_x = [math.log(x) for x, _ in points]
        log_y = [math.log(y) for _, y in points]
        middle = sum(log_x) / len(log_x), sum(log_y) / len(log_y)
        fit = [(math.exp(x), math.exp(middle[1] + sweep.slope * (x - middle[0]))) for x in log_x]
        curves.append(Curve("", fit, colour, True, False))
        xs, ys = xs + [x for x, _ in points], ys + [y for _, y in points + fit]
    if not curves:
        return None
    return line_plot(
        "Error falls with the density of samples",
        Axis("samples along a side of a pixel of the camera", min(xs) / 1.2, max(xs) * 1.2),
        Axis("rms error, partly hidden faces", min(ys) / 1.6, max(ys) * 1.6),
        curves,
        theme,
    )


def _time(comparison: Comparison, colours: dict[str, str], theme: Theme) -> Image.Image:
    """Time per pose of each candidate and of the truth, on a logarithmic scale."""
    rows = [(s.name, 1e3 * s.seconds_per_pose, colours[s.name]) for s in comparison.scores]
    truth = f"truth: {comparison.against}"
    rows.append((truth, 1e3 * comparison.truth_seconds_per_pose, theme.soft))
    height = 96 + 38 * len(rows)
    canvas = Canvas("Time per pose (logarithmic scale)", theme, height)
    least, most = (pick(ms for _, ms, _ in rows) for pick in (min, max))
    axis = Axis("ms", 10 ** math.floor(math.log10(least)), 10 ** math.ceil(math.log10(most * 1.01)))
    font = ImageFont.load_default(float(15 * FINE))
    left = 30 + max(font.getlength(name) for name, _, _ in rows) / FINE
    right, top, bottom = WIDTH - 100.0, 48.0, height - 40.0
    for value, words in axis.ticks():
        x = left + axis.place(value) * (right - left)
        canvas.line(((x, top), (x, bottom)), theme.grid, 1)
        canvas.text((x, bottom + 14), words, 14, theme.soft, "mm")
    canvas.text((right + 16, bottom + 14), "ms", 14, theme.soft)
    for i, (name, ms, colour) in enumerate(rows):
        y = top + 22 + 38 * i
        x = left + axis.place(ms) * (right - left)
        canvas.text((left - 12, y), name, 15, theme.ink, "rm")
        canvas.line(((left, y), (x, y)), colour, 3)
        canvas.dot((x, y), colour, 6)
        canvas.text(
            (x + 12, y), f"{ms:,.{max(0, 1 - math.floor(math.log10(ms)))}f} ms", 15, theme.ink
        )
    return canvas.done()


def _share_above(counts: Sequence[tuple[float, int]], total: int) -> list[tuple[float, float]]:
    """Share of a histogram above the end of each of its bins, while there is any."""
    left = total
    points: list[tuple[float, float]] = []
    for end, n in counts:
        if 0 < end < math.inf:
            # Up to where its first bin begins, nothing of it has been met.
            points += [] if points else [(end / 10**0.1, left / total)]
            points.append((end, (left - n) / total))
        left -= n
    return [(x, y) for x, y in points if y > 0]


def _middle(low: float, high: float) -> float:
    """Where a class of size stands on a logarithmic axis."""
    if low == 0:
        return high / 2
    return low * 2 if math.isinf(high) else math.sqrt(low * high)


def _least(error: float) -> str:
    """Words for an error that is nothing but rounding."""
    if error == 0:
        return "no error at all"
    return f"error below {ROUNDING:g}" if error < ROUNDING else f"error up to {error:.1g}"


def _blend(ends: tuple[str, str], share: float) -> str:
    """A colour between two."""
    one, other = ([int(text[i : i + 2], 16) for i in (1, 3, 5)] for text in ends)
    return "#" + "".join(
        f"{round(a + share * (b - a)):02x}" for a, b in zip(one, other, strict=True)
    )
