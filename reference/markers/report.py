"""Report of the marker validation: page, JSON, pictures, and tables for a terminal.

markers.html       verdict, the four tables beside the printed ones, random scenes, failures
markers.json       every figure
experiment_*.png   the photographs with the markers found
wrong_*.png        random scenes that the model predicts wrongly, by requirement
calibration_*.png  coverage against detection

They replace those of an earlier run together, when all are whole.
"""

import platform
import re
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from rich.box import SIMPLE_HEAD
from rich.table import Table

from rastercov.reference.markers.detect import opencv
from rastercov.reference.markers.experiments import Experiment, Row
from rastercov.reference.markers.random_scenes import (
    OURS,
    Outcome,
    RandomStudy,
    Score,
    photograph,
    random_scene,
)
from rastercov.reference.markers.render import MarkerRenderer
from rastercov.reference.markers.requirement import CLEAR, DETECTOR, THESIS, Requirement
from rastercov.reference.pages import (
    DARK,
    LIGHT,
    Axis,
    Curve,
    Theme,
    line_plot,
    opened,
    picture_of,
    publish,
)
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.report.images import contact_sheet
from rastercov.report.pages import Picture, rendered
from rastercov.report.theme import INK, PAPER

if TYPE_CHECKING:
    from matplotlib.figure import Figure

VALIDATION = ReportKind(
    "markers",
    re.compile(r"markers\.(json|html)|(experiment|wrong|calibration)_\w+\.png"),
    last="markers.json",
)
MIN_ACCURACY = 0.98
"""Share of random scenes that the model must predict rightly by the detector's requirement."""
REQUIREMENTS = (THESIS, DETECTOR)
CLEAR_CASE = (
    "A clear case is one that no small change would alter: 10 % of resolution or focus, 3 px at "
    "the border, 5 % of area."
)
FAR_FROM_THRESHOLD = 0.5
"""Slack from which on a criterion does not explain a wrong prediction."""
ROW_HEADINGS = (
    *("marker", "where", "printed", "ours", "predicted, Table 5.1", "predicted, detector"),
    *("found, printed", "found, OpenCV", "verdict"),
)
SCORE_HEADINGS = (
    *("model", "right", "found as predicted", "false alarms", "missed", "lost as predicted"),
    *("right at its best threshold", "that threshold"),
)
CALIBRATION_HEADINGS = ("coverage", "markers", "found")
TALLY_HEADINGS = (
    *("nearest to its threshold", "predicted, not found", "found, not predicted"),
    "of these clear",
)
MIN_MARKERS = 8
"""Markers of a coverage class that has a point in a plot."""
DETECTED, UNDETECTED = (25, 195, 125), (255, 93, 108)
TILE = 240
"""Side of a picture of one marker, px."""


@dataclass(frozen=True, eq=False)
class Validation:
    """All results of the marker validation."""

    experiments: list[Experiment]  # the four of the thesis
    study: RandomStudy | None  # random scenes, if any
    renderer: str  # name of the OpenGL renderer

    @property
    def passed(self) -> bool:
        """True when the model is right often enough by the detector's requirement."""
        rows = [row for experiment in self.experiments for row in experiment.rows]
        right = sum(row.predicted_by_detector == row.detected for row in rows)
        if right < MIN_ACCURACY * len(rows):
            return False
        return self.study is None or self.accuracy(DETECTOR) >= MIN_ACCURACY

    def accuracy(self, requirement: Requirement) -> float:
        """Share of right predictions of ours in random scenes; 1 without any."""
        return self.study.score_of(OURS, requirement).accuracy if self.study else 1.0

    def lines(self) -> list[str]:
        """The verdict, one line a check."""
        lines = [experiment_line(experiment) for experiment in self.experiments]
        if self.study:
            for requirement in REQUIREMENTS:
                lines.append(
                    f"random scenes by the {requirement.name} requirement: "
                    f"{100 * self.accuracy(requirement):.2f} % of "
                    f"{len(self.study.outcomes):,} right"
                )
                lines.append(clear_line(self.study, requirement))
        verdict = "holds" if self.passed else "FAILS"
        lines.append(f"{verdict}: {100 * MIN_ACCURACY:g} % right by the detector requirement")
        return lines


def as_json(found: Validation) -> dict[str, Any]:
    """All figures of a validation."""
    data: dict[str, Any] = {
        "passed": found.passed,
        "must_be_right": MIN_ACCURACY,
        "requirements": [asdict(requirement) for requirement in REQUIREMENTS],
        "experiments": [
            {
                "name": e.name,
                "title": e.title,
                "right": e.right,
                "found_as_printed": e.as_printed,
                "seconds": e.seconds,
                "rows": [asdict(row) for row in e.rows],
            }
            for e in found.experiments
        ],
        "renderer": found.renderer,
        "versions": {
            "python": platform.python_version(),
            "opencv": opencv().__version__,
            **{name: version(name) for name in ("rastercov", "moderngl", "numpy")},
        },
    }
    if found.study:
        study = found.study
        data["random"] = {
            "seed": study.seed,
            "obstacle": study.obstacle,
            "scenes": len(study.outcomes),
            "found": sum(o.detected for o in study.outcomes),
            "seconds": study.seconds,
            "clear": {r.name: study.clear(r) for r in REQUIREMENTS},
            "scores": [asdict(s) | {"accuracy": s.accuracy} for s in study.scores],
            "outcomes": [
                {
                    "scene": o.number,
                    "detected": o.detected,
                    "figures": asdict(o.figures),
                    "coverage": {f"{r}: {model}": c for (r, model), c in o.coverage.items()},
                }
                for o in study.outcomes
            ],
        }
    return data


def write_validation(
    out: Path | ReportFolder,
    found: Validation,
    renderer: MarkerRenderer,
    failures: int,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Path:
    """Write the page, the JSON and the pictures; returns the path of the page.

    `failures` is the number of wrong predictions to show by each requirement, the clearest first;
    the renderer draws them again. `progress` gets the pictures drawn and the pictures in all.
    """
    with opened(out, VALIDATION) as folder:
        pictures = {
            _file_of(experiment): Picture.of(
                f"{experiment.title}: the photograph, what was found in green",
                experiment_picture(experiment),
            )
            for experiment in found.experiments
        }
        wrong: dict[str, list[Picture]] = {}
        study = found.study
        for requirement in REQUIREMENTS if study else ():
            assert study is not None
            scores = _scores_by(study, requirement)
            name = f"calibration_{requirement.name}"
            plot = [calibration_plot(scores, theme) for theme in (LIGHT, DARK)]
            pictures[name] = picture_of(f"Plot: {name}", *plot)
            shown = study.wrong(requirement)[:failures]
            tiles = []
            for done, outcome in enumerate(shown):
                progress(done, len(shown))
                case, rng = random_scene(study.seed, outcome.number, study.obstacle)
                tiles.append(marker_picture(photograph(renderer, case, rng), outcome.detected))
            progress(len(shown), len(shown))
            if tiles:
                captions = [_short_failure(outcome, requirement) for outcome in shown]
                sheet = contact_sheet(tiles, captions, 6, TILE)
                pictures[f"wrong_{requirement.name}"] = Picture.of("Wrong predictions", sheet)
            wrong[requirement.name] = [
                Picture.of(failure_text(outcome, requirement), tile)
                for tile, outcome in zip(tiles, shown, strict=True)
            ]
        return publish(folder, page(found, pictures, wrong), as_json(found), pictures)


def _file_of(experiment: Experiment) -> str:
    return f"experiment_{experiment.name.replace(' ', '_')}"


def page(found: Validation, pictures: dict[str, Picture], wrong: dict[str, list[Picture]]) -> str:
    """HTML of a validation, with pictures by name and wrong predictions by requirement."""
    answer = "Passed" if found.passed else "Failed"
    study = found.study
    return rendered(
        "markers.html",
        "rastercov.reference",
        title=f"rastercov validate markers: {answer.lower()}",
        heading="Does the coverage model foretell what a detector finds?",
        answer=answer,
        found=found,
        detector=DETECTOR,
        experiments=[
            (each.title, experiment_line(each), pictures[_file_of(each)], map(row_of, each.rows))
            for each in found.experiments
        ],
        row_headings=ROW_HEADINGS,
        n_found=sum(outcome.detected for outcome in study.outcomes) if study else 0,
        requirements=[_requirement(study, each, pictures, wrong) for each in REQUIREMENTS if study],
        clear_case=CLEAR_CASE,
        score_headings=SCORE_HEADINGS,
        calibration_headings=CALIBRATION_HEADINGS,
        tally_headings=TALLY_HEADINGS,
        opencv=opencv().__version__,
    )


def _requirement(
    study: RandomStudy,
    requirement: Requirement,
    pictures: dict[str, Picture],
    wrong: dict[str, list[Picture]],
) -> dict[str, Any]:
    """Section of the page about random scenes by one requirement."""
    return {
        "name": requirement.name,
        "clear_line": clear_line(study, requirement).capitalize(),
        "scores": [score_row(score) for score in _scores_by(study, requirement)],
        "plot": pictures[f"calibration_{requirement.name}"],
        "calibration": calibration_rows(study.score_of(OURS, requirement)),
        "tally": failure_tally(study, requirement),
        "wrong": wrong[requirement.name],
    }


def _scores_by(study: RandomStudy, requirement: Requirement) -> list[Score]:
    return [score for score in study.scores if score.requirement == requirement.name]


def row_of(row: Row) -> tuple[str, ...]:
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


def score_row(score: Score) -> tuple[str, ...]:
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


def calibration_rows(score: Score) -> list[tuple[str, str, str]]:
    """Classes of coverage under `CALIBRATION_HEADINGS`."""
    rows = []
    for low, high, found, count in score.calibration:
        limits = "0" if high < 1e-6 else "1" if high > 1 else f"{max(0.0, low):.3g} to {high:.3g}"
        rows.append((limits, f"{count:,}", f"{100 * found:.1f} %"))
    return rows


def experiment_line(experiment: Experiment) -> str:
    """Result of an experiment, in one line."""
    count = len(experiment.rows)
    return (
        f"{experiment.title}: {experiment.right} of {count} as the model predicts, "
        f"{experiment.as_printed} of {count} found as printed"
    )


def clear_line(study: RandomStudy, requirement: Requirement) -> str:
    """Accuracy of the model in clear cases, in one line."""
    right, count = study.clear(requirement)
    share = f"{100 * right / count:.2f} %" if count else "none"
    return (
        f"clear cases by the {requirement.name} requirement: {right:,} of {count:,} right, {share}"
    )


def failure_text(outcome: Outcome, requirement: Requirement) -> str:
    """A wrong prediction and the criterion that is nearest to its threshold."""
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
    if slack >= FAR_FROM_THRESHOLD:
        return f"{happened}; nothing is near its threshold; {detail}"
    clear = "clearly " if abs(slack) >= CLEAR else "narrowly "
    return f"{happened}; {clear}{'fails' if slack < 0 else 'meets'} {name}: {detail}"


def _short_failure(outcome: Outcome, requirement: Requirement) -> str:
    """`failure_text` in a few words, with the slack of the criterion."""
    name, slack = outcome.figures.decisive(requirement)
    name = "nothing near" if slack >= FAR_FROM_THRESHOLD else f"{name} {slack:+.2f}"
    return f"{outcome.number}: {'found' if outcome.detected else 'lost'}, {name}"


def failure_tally(study: RandomStudy, requirement: Requirement) -> list[tuple[str, ...]]:
    """Wrong predictions by the criterion nearest to its threshold, under `TALLY_HEADINGS`."""
    tally: dict[str, list[int]] = {}
    for outcome in study.wrong(requirement):
        name, slack = outcome.figures.decisive(requirement)
        name = "none" if slack >= FAR_FROM_THRESHOLD else name
        counts = tally.setdefault(name, [0, 0, 0])
        counts[outcome.detected] += 1
        counts[2] += outcome.figures.is_clear(requirement)
    return [(name, *map(str, counts)) for name, counts in sorted(tally.items())]


def experiment_table(experiment: Experiment) -> Table:
    """An experiment for a terminal: printed figures and ours, predictions, markers found."""
    title = experiment_line(experiment)
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    headings = ("#", "where", experiment.criterion, "ours", "5.1", "det.", "print")
    for name in (*headings, "here", "model"):
        table.add_column(name)
    for row in experiment.rows:
        table.add_row(*row_of(row), style="" if row.predicted == row.detected else "red")
    return table


def score_table(scores: Sequence[Score]) -> Table:
    """Models by one requirement, for a terminal.

    Hits were predicted and found, false only predicted, missed only found; "best %" is the
    accuracy at the threshold that is best for these very scenes.
    """
    title = f"By the {scores[0].requirement} requirement"
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD)
    table.add_column("model", no_wrap=True)
    for name in ("right %", "hits", "false", "missed", "neither", "best %"):
        table.add_column(name, justify="right", no_wrap=True)
    for score in scores:
        table.add_row(*(text.removesuffix(" %") for text in score_row(score)[:-1]))
    return table


def _yes(value: bool) -> str:
    return "yes" if value else "no"


def experiment_picture(experiment: Experiment) -> Image.Image:
    """The photograph of an experiment, found markers outlined in green with their numbers."""
    image = Image.fromarray(experiment.image).convert("RGB")
    draw = ImageDraw.Draw(image)
    font = ImageFont.load_default(26.0)
    for number, corners in experiment.found.items():
        points = [(float(x), float(y)) for x, y in corners]
        draw.line([*points, points[0], points[1]], DETECTED, 3, "curve")
        x, y = float(np.mean(corners[:, 0])), float(np.min(corners[:, 1])) - 22
        box = draw.textbbox((x, y), str(number), font, anchor="mm")
        draw.rectangle((box[0] - 5, box[1] - 4, box[2] + 5, box[3] + 4), INK)
        draw.text((x, y), str(number), DETECTED, font, anchor="mm")
    return image.resize((960, 768), Image.Resampling.BOX)


def marker_picture(photograph: NDArray[np.uint8], detected: bool) -> Image.Image:
    """A photograph of one marker as a tile, framed green where it was found, else red."""
    image = Image.fromarray(photograph).convert("RGB")
    scale = (TILE - 12) / max(image.size)
    way = Image.Resampling.NEAREST if scale > 1 else Image.Resampling.BOX
    size = (max(1, round(image.width * scale)), max(1, round(image.height * scale)))
    tile = Image.new("RGB", (TILE, TILE), DETECTED if detected else UNDETECTED)
    tile.paste(PAPER, (6, 6, TILE - 6, TILE - 6))
    tile.paste(image.resize(size, way), ((TILE - size[0]) // 2, (TILE - size[1]) // 2))
    return tile


def calibration_plot(scores: Sequence[Score], theme: Theme) -> "Figure":
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
