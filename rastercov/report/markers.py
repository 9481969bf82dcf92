"""The marker validation for people: one HTML page that needs nothing else, JSON, pictures.

markers.html       verdict, the four tables beside the printed ones, random scenes, failures
markers.json       every figure
experiment_*.png   the photographs, with what was found
wrong_*.png        random scenes that the model foretold wrongly, by each requirement
calibration_*.png  coverage against detection

They take the place of those of an earlier run together, when all are whole.
"""

import platform
import re
from collections.abc import Callable
from dataclasses import asdict, dataclass
from html import escape
from importlib.metadata import version
from pathlib import Path
from typing import Any

from PIL import Image

from rastercov.report.canvas import DARK, LIGHT
from rastercov.report.figures import write_bytes, write_json, write_text
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.report.html import document, picture, png, table
from rastercov.report.marker_pictures import (
    calibration_plot,
    experiment_picture,
    marker_picture,
    sheet,
)
from rastercov.report.marker_words import (
    CALIBRATION_HEADINGS,
    ROW_HEADINGS,
    SCORE_HEADINGS,
    TALLY_HEADINGS,
    calibration_words,
    clear_line,
    experiment_line,
    failure_tally,
    failure_words,
    row_words,
    score_words,
    short_words,
)
from rastercov.validation.markers.detect import opencv
from rastercov.validation.markers.experiments import Experiment
from rastercov.validation.markers.random_scenes import RandomStudy, photograph, random_scene
from rastercov.validation.markers.render import MarkerRenderer
from rastercov.validation.markers.requirement import DETECTOR, THESIS, Requirement
from rastercov.validation.markers.scoring import OURS

VALIDATION = ReportKind(
    "markers",
    re.compile(r"markers\.(json|html)|(experiment|wrong|calibration)_\w+\.png"),
    last="markers.json",
)
MUST_BE_RIGHT = 0.98
"""Share of random scenes that the model must foretell by the detector's requirement."""
REQUIREMENTS = (THESIS, DETECTOR)
CLEAR_CASE = (
    "A clear case is one that no small change would alter: 10 % of resolution or focus, 3 px at "
    "the border, 5 % of area."
)


@dataclass(frozen=True, eq=False)
class Validation:
    """Everything that was found out.

    Attributes
    ----------
    experiments : list of Experiment
        The four of the thesis.
    study : RandomStudy or None
        Random scenes, unless none were wanted.
    renderer : str
        What drew.
    """

    experiments: list[Experiment]
    study: RandomStudy | None
    renderer: str

    @property
    def passed(self) -> bool:
        """Whether the model is right often enough by the detector's requirement."""
        rows = [row for experiment in self.experiments for row in experiment.rows]
        right = sum(row.predicted_by_detector == row.detected for row in rows)
        if right < MUST_BE_RIGHT * len(rows):
            return False
        return self.study is None or self.accuracy(DETECTOR) >= MUST_BE_RIGHT

    def accuracy(self, requirement: Requirement) -> float:
        """Share of right predictions of ours in random scenes; 1 without any."""
        return self.study.score_of(OURS, requirement).accuracy if self.study else 1.0

    def lines(self) -> list[str]:
        """The verdict, a line a check."""
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
        lines.append(f"{verdict}: {100 * MUST_BE_RIGHT:g} % right by the detector requirement")
        return lines


def as_json(found: Validation) -> dict[str, Any]:
    """All figures of a validation."""
    data: dict[str, Any] = {
        "passed": found.passed,
        "must_be_right": MUST_BE_RIGHT,
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
    """Write the page, the JSON and the pictures; gives the path of the page.

    Parameters
    ----------
    out : Path or ReportFolder
        Folder, made when it is missing; or one that is open.
    found : Validation
        What to tell.
    renderer : MarkerRenderer
        Draws the scenes that went wrong once more.
    failures : int
        How many of them to show, by each requirement.
    progress : callable
        Called with the pictures drawn and the pictures in all.
    """
    with ReportFolder.opened(out, VALIDATION) as folder:
        drawn: dict[str, bytes] = {}
        for experiment in found.experiments:
            drawn[_name(experiment)] = png(
                experiment_picture(experiment), Image.Quantize.FASTOCTREE
            )
        wrong: dict[str, list[tuple[bytes, str]]] = {}
        for requirement in REQUIREMENTS if found.study else ():
            assert found.study is not None
            _draw_plots(drawn, found.study, requirement)
            shown = found.study.wrong(requirement)[:failures]
            tiles = []
            for done, outcome in enumerate(shown):
                progress(done, len(shown))
                case, rng = random_scene(found.study.seed, outcome.number, found.study.obstacle)
                tiles.append(marker_picture(photograph(renderer, case, rng), outcome.detected))
            captions = [short_words(outcome, requirement) for outcome in shown]
            drawn[f"wrong_{requirement.name}"] = png(
                sheet(list(zip(tiles, captions, strict=True))), Image.Quantize.FASTOCTREE
            )
            wrong[requirement.name] = [
                (png(tile, Image.Quantize.FASTOCTREE), failure_words(outcome, requirement))
                for tile, outcome in zip(tiles, shown, strict=True)
            ]
        for name, data in drawn.items():
            if not name.startswith("dark_"):
                write_bytes(folder.file(f"{name}.png"), data)
        write_text(folder.file("markers.html"), page(found, drawn, wrong))
        write_json(folder.file("markers.json"), as_json(found))
        folder.publish()
        return folder.path / "markers.html"


def _draw_plots(drawn: dict[str, bytes], study: RandomStudy, requirement: Requirement) -> None:
    scores = [s for s in study.scores if s.requirement == requirement.name]
    for theme, prefix in ((LIGHT, ""), (DARK, "dark_")):
        plot = calibration_plot(scores, theme)
        drawn[f"{prefix}calibration_{requirement.name}"] = png(plot, Image.Quantize.MEDIANCUT)


def _name(experiment: Experiment) -> str:
    return f"experiment_{experiment.name.replace(' ', '_')}"


def page(
    found: Validation, drawn: dict[str, bytes], wrong: dict[str, list[tuple[bytes, str]]]
) -> str:
    """HTML of a validation, with PNG by name and the failures with their words."""
    style = "verdict" if found.passed else "verdict bad"
    lines = "".join(f"<li>{escape(line)}</li>" for line in found.lines())
    words = "Passed" if found.passed else "Failed"
    body = [
        "<h1>Does the coverage model foretell what a detector finds?</h1>",
        "<p>ArUco markers of 0.30 m before an iCube NS4133BU with an 8 mm lens, drawn by OpenGL "
        "with the depth of field of the real aperture and the noise of a sensor, and looked for "
        "by OpenCV. The model says beforehand which will be found.</p>",
        f'<div class="{style}"><strong>{words}</strong><ul>{lines}</ul></div>',
        f"<p>{escape(_requirements())}</p>",
    ]
    for experiment in found.experiments:
        words_of = f"{experiment.title}: the photograph, what was found in green"
        image = picture(words_of, drawn[_name(experiment)])
        body += [
            f"<h2>{escape(experiment.title)}</h2>",
            f"<p>{escape(experiment_line(experiment))}.</p>",
            f"<figure>{image}</figure>",
            table(ROW_HEADINGS, [row_words(row) for row in experiment.rows]),
        ]
    if found.study:
        body += _random(found.study, drawn, wrong)
    body.append(
        f'<h2>How it was made</h2><p class="soft">Drawn by {escape(found.renderer)}, detected by '
        f"OpenCV {escape(opencv().__version__)}. All figures are in markers.json.</p>"
    )
    return document(f"rastercov validate markers: {words.lower()}", body)


def _requirements() -> str:
    return (
        "Two requirements. Thesis: Table 5.1 to the letter, 1024 px a marker, blur up to 5.755 px, "
        "all of it visible. Detector: the same in the measures of OpenCV's detector, a contour of "
        f"{DETECTOR.min_contour:g} steps, {DETECTOR.min_cell:g} px a cell, blur up to "
        f"{DETECTOR.max_blur_cells:g} cells, {DETECTOR.min_border:g} px from the border, "
        f"{100 * DETECTOR.min_visibility:g} % visible."
    )


def _random(
    study: RandomStudy, drawn: dict[str, bytes], wrong: dict[str, list[tuple[bytes, str]]]
) -> list[str]:
    found = sum(outcome.detected for outcome in study.outcomes)
    parts = [
        "<h2>Random scenes</h2>",
        f"<p>{len(study.outcomes):,} scenes of seed {study.seed}: distance, place, tilt, roll, "
        f"lens and something in the way at random; {found:,} markers were found. Took "
        f"{study.seconds:.0f} s.</p>",
    ]
    for requirement in REQUIREMENTS:
        scores = [s for s in study.scores if s.requirement == requirement.name]
        ours = study.score_of(OURS, requirement)
        name = f"calibration_{requirement.name}"
        plot = picture(f"Plot: {name}", drawn[name], drawn[f"dark_{name}"])
        parts += [
            f"<h3>By the {requirement.name} requirement</h3>",
            f"<p>{escape(clear_line(study, requirement).capitalize())}. {CLEAR_CASE}</p>",
            table(SCORE_HEADINGS, [score_words(s) for s in scores]),
            f'<div class="grid"><figure>{plot}</figure>'
            f"<div>{table(CALIBRATION_HEADINGS, calibration_words(ours))}</div></div>",
            "<p>Wrong predictions of ours, by the criterion nearest to its threshold:</p>"
            + table(TALLY_HEADINGS, failure_tally(study, requirement)),
        ]
        figures = [
            f"<figure>{picture(words, data)}<figcaption>{escape(words)}</figcaption></figure>"
            for data, words in wrong[requirement.name]
        ]
        parts.append(
            f"<details><summary>The {len(figures)} clearest failures</summary>"
            f'<div class="grid faces">{"".join(figures)}</div></details>'
        )
    return parts
