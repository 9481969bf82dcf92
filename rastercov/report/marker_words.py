"""The marker validation in words: tables and verdicts for a terminal and a page."""

from collections.abc import Sequence

from rich.box import SIMPLE_HEAD
from rich.table import Table

from rastercov.validation.markers.experiments import Experiment, Row
from rastercov.validation.markers.random_scenes import Outcome, RandomStudy
from rastercov.validation.markers.requirement import CLEAR, Requirement
from rastercov.validation.markers.scoring import Score

ROW_HEADINGS = (
    "marker",
    "where",
    "printed",
    "ours",
    "predicted, Table 5.1",
    "predicted, detector",
    "found, printed",
    "found, OpenCV",
    "verdict",
)
SCORE_HEADINGS = (
    "model",
    "right",
    "found as predicted",
    "false alarms",
    "missed",
    "lost as predicted",
    "right at its best threshold",
    "that threshold",
)
NOT_NEAR = 0.5
"""Slack from which on a criterion has nothing to do with a failure."""
CALIBRATION_HEADINGS = ("coverage", "markers", "found")


def row_words(row: Row) -> tuple[str, ...]:
    """A marker under `ROW_HEADINGS`."""
    return (
        str(row.marker),
        row.setting,
        row.printed,
        row.ours,
        _yes(row.predicted),
        _yes(row.predicted_by_detector),
        _yes(row.printed_detected),
        _yes(row.detected),
        "right" if row.predicted == row.detected else "wrong",
    )


def score_words(score: Score) -> tuple[str, ...]:
    """A model under `SCORE_HEADINGS`."""
    return (
        score.model,
        f"{100 * score.accuracy:.2f} %",
        f"{score.hits:,}",
        f"{score.false_alarms:,}",
        f"{score.misses:,}",
        f"{score.rejections:,}",
        f"{100 * score.best_accuracy:.2f} %",
        f"{score.best_threshold:.3g}",
    )


def calibration_words(score: Score) -> list[tuple[str, str, str]]:
    """Classes of coverage under `CALIBRATION_HEADINGS`."""
    rows = []
    for low, high, found, count in score.calibration:
        limits = "0" if high < 1e-6 else "1" if high > 1 else f"{max(0.0, low):.3g} to {high:.3g}"
        rows.append((limits, f"{count:,}", f"{100 * found:.1f} %"))
    return rows


def experiment_line(experiment: Experiment) -> str:
    """What an experiment came to, in one line."""
    count = len(experiment.rows)
    return (
        f"{experiment.title}: {experiment.right} of {count} as the model predicts, "
        f"{experiment.as_printed} of {count} found as printed"
    )


def clear_line(study: RandomStudy, requirement: Requirement) -> str:
    """How the model does in clear cases, in one line."""
    right, count = study.clear(requirement)
    share = f"{100 * right / count:.2f} %" if count else "none"
    return (
        f"clear cases by the {requirement.name} requirement: {right:,} of {count:,} right, {share}"
    )


def failure_words(outcome: Outcome, requirement: Requirement) -> str:
    """What went wrong with a prediction, by the criterion that is nearest to its threshold."""
    figures = outcome.figures
    name, slack = figures.decisive(requirement)
    limit = requirement.blur_limit(figures.pixels)
    detail = {
        "visibility": f"{100 * figures.visibility:.1f} % visible",
        "focus": f"blur {figures.blur:.1f} px, limit {limit:.1f}",
        "resolution": f"{figures.pixels:.0f} px, contour {figures.contour:.0f}, "
        f"cell {figures.cell:.1f} px",
        "field of view": f"{figures.border:.1f} px from the border",
        "back": "seen from behind",
    }[name]
    happened = f"Scene {outcome.number}: {'found' if outcome.detected else 'not found'}"
    if slack >= NOT_NEAR:
        return f"{happened}; nothing is near its threshold; {detail}"
    clear = "clearly " if abs(slack) >= CLEAR else "narrowly "
    return f"{happened}; {clear}{'fails' if slack < 0 else 'meets'} {name}: {detail}"


def short_words(outcome: Outcome, requirement: Requirement) -> str:
    """The same in a few words: what is nearest to its threshold, and its slack."""
    name, slack = outcome.figures.decisive(requirement)
    name = "nothing near" if slack >= NOT_NEAR else f"{name} {slack:+.2f}"
    return f"{outcome.number}: {'found' if outcome.detected else 'lost'}, {name}"


def failure_tally(study: RandomStudy, requirement: Requirement) -> list[tuple[str, ...]]:
    """Wrong predictions by what was nearest to its threshold: what, false alarms, missed, clear."""
    tally: dict[str, list[int]] = {}
    for outcome in study.wrong(requirement):
        name, slack = outcome.figures.decisive(requirement)
        name = "none" if slack >= NOT_NEAR else name
        counts = tally.setdefault(name, [0, 0, 0])
        counts[outcome.detected] += 1
        counts[2] += outcome.figures.is_clear(requirement)
    return [(name, *map(str, counts)) for name, counts in sorted(tally.items())]


TALLY_HEADINGS = (
    "nearest to its threshold",
    "predicted, not found",
    "found, not predicted",
    "of these clear",
)


def experiment_table(experiment: Experiment) -> Table:
    """An experiment for a terminal: figures as printed and ours, predictions, what was found."""
    title = experiment_line(experiment)
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    headings = ("#", "where", experiment.criterion, "ours", "5.1", "det.", "print")
    for name in (*headings, "here", "model"):
        table.add_column(name)
    for row in experiment.rows:
        table.add_row(*row_words(row), style="" if row.predicted == row.detected else "red")
    return table


def score_table(scores: Sequence[Score]) -> Table:
    """Models by one requirement, for a terminal.

    Hits were predicted and found, false only predicted, missed only found; "best %" is what the
    best threshold on these very scenes would have given.
    """
    title = f"By the {scores[0].requirement} requirement"
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD)
    table.add_column("model", no_wrap=True)
    for name in ("right %", "hits", "false", "missed", "neither", "best %"):
        table.add_column(name, justify="right", no_wrap=True)
    for score in scores:
        table.add_row(*(word.removesuffix(" %") for word in score_words(score)[:-1]))
    return table


def _yes(value: bool) -> str:
    return "yes" if value else "no"
