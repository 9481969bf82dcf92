"""Pictures of the marker validation: photographs of experiments and markers, calibration plot."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from rastercov.report.plots import Axis, Curve, line_plot
from rastercov.report.theme import DETECTED, INK, PAPER, UNDETECTED, Theme
from rastercov.validation.markers.experiments import Experiment
from rastercov.validation.markers.scoring import Score

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MIN_MARKERS = 8
"""Markers of a coverage class that has a point in a plot."""
TILE = 240
"""Side of a picture of one marker, px."""


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
