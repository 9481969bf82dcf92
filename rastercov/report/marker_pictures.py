"""Pictures of the marker validation: photographs of experiments and of single markers."""

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from rastercov.report.theme import DETECTED, INK, PAPER, UNDETECTED
from rastercov.validation.markers.experiments import Experiment

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
