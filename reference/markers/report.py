"""Report of the marker validation: page, JSON, pictures, and tables for a terminal.

markers.html       verdict, the four tables beside the printed ones
markers.json       every figure
experiment_*.png   the photographs with the markers found

They replace those of an earlier run together, when all are whole.
"""

import platform
import re
from collections.abc import Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from rich.box import SIMPLE_HEAD
from rich.table import Table

from rastercov.base import ByName
from rastercov.reference.markers.detect import opencv
from rastercov.reference.markers.experiments import DETECTOR, THESIS, Experiment, MarkerRow
from rastercov.reference.pages import publish
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.report.pages import Picture, render
from rastercov.report.theme import INK

VALIDATION = ReportKind(
    "markers",
    re.compile(r"markers\.(json|html)|(experiment|wrong|calibration)_\w+\.png"),
    last="markers.json",
)
MIN_ACCURACY = 0.98
"""Share of markers that the model must predict rightly by the detector's requirement."""
ROW_HEADINGS = (
    *("marker", "where", "printed", "ours", "predicted, Table 5.1", "predicted, detector"),
    *("found, printed", "found, OpenCV", "verdict"),
)
DETECTED = (25, 195, 125)


def do_all_pass(experiments: Sequence[Experiment]) -> bool:
    """True when the model is right often enough by the detector's requirement."""
    rows = [row for experiment in experiments for row in experiment.rows]
    right = sum(row.predicted_by_detector == row.detected for row in rows)
    return right >= MIN_ACCURACY * len(rows)


def verdict_lines(experiments: Sequence[Experiment]) -> list[str]:
    """The verdict, one line per check."""
    verdict = "holds" if do_all_pass(experiments) else "FAILS"
    last = f"{verdict}: {100 * MIN_ACCURACY:g} % or more as predicted by the detector requirement"
    return [*map(experiment_line, experiments), last]


def as_json(experiments: Sequence[Experiment]) -> ByName:
    """All figures of a validation."""
    return {
        "passed": do_all_pass(experiments),
        "must_be_right": MIN_ACCURACY,
        "requirements": [asdict(requirement) for requirement in (THESIS, DETECTOR)],
        "experiments": [
            {
                "name": e.name,
                "title": e.title,
                "right": e.right,
                "found_as_printed": e.as_printed,
                "seconds": e.seconds,
                "rows": [asdict(row) for row in e.rows],
            }
            for e in experiments
        ],
        "renderer": "numpy",
        "versions": {
            "python": platform.python_version(),
            "opencv": opencv().__version__,
            **{name: version(name) for name in ("rastercov", "numpy")},
        },
    }


def write_validation(folder: ReportFolder, experiments: Sequence[Experiment]) -> Path:
    """Write the page, the JSON and the pictures; returns the path of the page."""
    pictures = {
        f"experiment_{each.name.replace(' ', '_')}": Picture.of(
            f"{each.title}: the photograph, detections in green", experiment_picture(each)
        )
        for each in experiments
    }
    answer = "Passed" if do_all_pass(experiments) else "Failed"
    page = render(
        "markers.html",
        "rastercov.reference",
        title=f"rastercov validate markers: {answer.lower()}",
        heading="Does the coverage model predict what a detector finds?",
        answer=answer,
        lines=verdict_lines(experiments),
        passed=do_all_pass(experiments),
        detector=DETECTOR,
        experiments=[
            (each.title, experiment_line(each), picture, map(row_of, each.rows))
            for each, picture in zip(experiments, pictures.values(), strict=True)
        ],
        row_headings=ROW_HEADINGS,
        opencv=opencv().__version__,
    )
    return publish(folder, page, as_json(experiments), pictures)


def row_of(row: MarkerRow) -> tuple[str, ...]:
    """A marker under `ROW_HEADINGS`."""
    answers = (row.predicted, row.predicted_by_detector, row.printed_detected, row.detected)
    return (
        str(row.marker),
        row.setting,
        row.printed,
        row.ours,
        *("yes" if answer else "no" for answer in answers),
        "right" if row.predicted == row.detected else "wrong",
    )


def experiment_line(experiment: Experiment) -> str:
    """Result of an experiment, in one line."""
    count = len(experiment.rows)
    return (
        f"{experiment.title}: {experiment.right} of {count} as predicted by Table 5.1, "
        f"{experiment.as_printed} of {count} detected as printed"
    )


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
