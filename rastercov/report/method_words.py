"""Figures of a comparison in words: numbers, shares, a table and a verdict for a terminal.

Part of `page`.
"""

import math
from collections.abc import Sequence

from rich.table import Table
from rich.text import Text

from rastercov.validation.methods.results import BoundCheck, Check, Comparison, Score, SizeClass

SCORE_HEADINGS = (
    "method",
    "faces",
    "partly hidden",
    "rms error, partly hidden",
    "greatest error",
    "missed",
    "bound held",
    "error / bound",
    "time per pose",
)


def score_row(score: Score) -> tuple[str, ...]:
    """A candidate under `SCORE_HEADINGS`."""
    sizes = score.all_sizes
    ratio = _statistical(score)
    return (
        score.name,
        f"{sizes.figures:,}",
        f"{sizes.partly_hidden:,}",
        number(sizes.rms_partly_hidden),
        number(sizes.greatest),
        f"{score.missed:,}",
        percent(sizes.held, sizes.figures),
        number(ratio.median_ratio) if ratio and ratio.median_ratio is not None else "",
        milliseconds(score.seconds_per_pose),
    )


KIND_HEADINGS = (
    "kind of figure",
    "figures",
    "bound held",
    "partly hidden",
    "bound held",
    "error / bound, median",
    "greatest",
)


def kind_row(bound: BoundCheck) -> tuple[str, ...]:
    """A kind of bound under `KIND_HEADINGS`."""
    return (
        bound.kind,
        f"{bound.figures:,}",
        percent(bound.held, bound.figures),
        f"{bound.partly_hidden:,}",
        percent(bound.partly_hidden_held, bound.partly_hidden),
        "" if bound.median_ratio is None else number(bound.median_ratio),
        "" if bound.greatest_ratio is None else number(bound.greatest_ratio),
    )


SIZE_HEADINGS = (
    "px^2",
    "faces",
    "partly hidden",
    "median error",
    "99 % below",
    "greatest error",
    "rms error, partly hidden",
    "mean bound, partly hidden",
    "missed",
    "bound held",
)


def size_row(size: SizeClass) -> tuple[str, ...]:
    """A class of size under `SIZE_HEADINGS`."""
    every = size.low == 0 and math.isinf(size.high)
    limits = f"{size.low:g} to {size.high:g}" if size.high < math.inf else f"from {size.low:g}"
    return (
        "all" if every else limits,
        f"{size.figures:,}",
        f"{size.partly_hidden:,}",
        number(size.median),
        number(size.percentile_99),
        number(size.greatest),
        number(size.rms_partly_hidden) if size.partly_hidden else "",
        number(size.mean_bound_partly_hidden) if size.partly_hidden else "",
        f"{size.missed:,}",
        percent(size.held, size.figures),
    )


def score_words(score: Score) -> str:
    """What else there is to say about a candidate."""
    words = [
        f"The visible area is off by {number(score.rms_pixels)} px^2 rms, "
        f"{number(score.greatest_pixels)} px^2 at most."
    ]
    if score.missed:
        unsaid = f"all but {score.missed_unsaid:,}" if score.missed_unsaid else "all"
        words.append(
            f"It misses {score.missed:,} faces, of which {score.missed_area:,.3g} px^2 are seen in "
            f"all; its bound allows for that in {unsaid} of them."
        )
    if score.phantoms:
        words.append(f"It calls {score.phantoms:,} hidden faces seen.")
    if score.unjudged:
        words.append(f"{score.unjudged:,} faces are too small in the image for a judgement.")
    return " ".join(words)


def _statistical(score: Score) -> BoundCheck | None:
    return next((bound for bound in score.bounds if bound.kind == "statistical"), None)


def number(value: float) -> str:
    """A number in a few digits."""
    if value == 0 or not math.isfinite(value):
        return f"{value:g}"
    return f"{value:.1e}" if abs(value) < 1e-4 else f"{value:.3g}"


def percent(part: int, whole: int) -> str:
    """A share, never rounded up to all of it."""
    if not whole:
        return ""
    if part == whole:
        return "100 %"
    return f"{math.floor(100_000 * part / whole) / 1000:.3f} %"


def milliseconds(seconds: float) -> str:
    """A time in milliseconds, two digits or more."""
    return f"{1e3 * seconds:.2g} ms" if seconds < 0.1 else f"{1e3 * seconds:,.0f} ms"


def comparison_table(comparison: Comparison) -> Table:
    """Candidates beside the truth, for a terminal of 80 columns.

    "partly" are faces that are partly hidden; their rms error is the one shown.
    """
    done = comparison.poses_done
    title = f"Against {comparison.against}, {done:,} pose{'' if done == 1 else 's'}"
    table = Table(title=title, title_justify="left")
    table.add_column("method", overflow="fold")
    for name in ("faces", "partly", "rms error", "worst", "missed", "held %", "ms"):
        table.add_column(name, justify="right", no_wrap=True)
    for score in comparison.scores:
        row = score_row(score)
        time = row[8].removesuffix(" ms")
        table.add_row(Text(score.name), *row[1:6], row[6].removesuffix(" %"), time)
    seconds = milliseconds(comparison.truth_seconds_per_pose).removesuffix(" ms")
    table.add_row(f"truth: {comparison.against}", "", "", "", "", "", "", seconds, style="dim")
    return table


def check_lines(checks: Sequence[Check]) -> list[str]:
    """The verdict, a line a check."""
    words = {True: "holds ", False: "FAILS ", None: "      "}
    return [words[check.passed] + str(check) for check in checks]
