"""Labels and scale bars of pictures: numbers on plates that do not overlap, lengths in metres."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw

from rastercov.base.format import number
from rastercov.report.images import Font
from rastercov.report.theme import INK, PAPER, Colour

FloatArray = NDArray[np.float64]

DIRECTIONS, RINGS = 16, 14
"""Places that are tried around the point of a label: directions, and rings of them."""
UNITS = ((1e3, "km"), (1.0, "m"), (1e-2, "cm"), (1e-3, "mm"))
"""Units of a scale bar, the largest first: metres, and their names; the font has no micro sign."""


def place_labels(anchors: ArrayLike, sizes: ArrayLike, picture: tuple[int, int]) -> FloatArray:
    """Centres of labels that overlap no other and are within the picture, (N, 2).

    Each label is at its point or on the first free place on rings around it; where all are taken,
    at its point.

    Parameters
    ----------
    anchors, sizes : (N, 2) array_like
        Points, and width and height of the labels, pixels.
    picture : (int, int)
        Width and height.
    """
    points, room = np.asarray(anchors, np.float64), np.asarray(sizes, np.float64)
    angles = 2 * np.pi / DIRECTIONS * np.arange(DIRECTIONS)
    ring = np.stack((np.cos(angles), -np.sin(angles)), axis=1)
    placed = np.zeros_like(points)
    for row, (point, size) in enumerate(zip(points, room, strict=True)):
        step = 0.5 * (size + size.min())
        tried = [point + k * step * ring for k in range(1, RINGS + 1)]
        places = np.concatenate((point[None], *tried))
        inside = (places >= size / 2).all(axis=1) & (places <= picture - size / 2).all(axis=1)
        apart = np.abs(places[:, None] - placed[None, :row])
        is_free = (apart >= (room[:row] + size) / 2).any(axis=2).all(axis=1)
        fitting = np.flatnonzero(inside & is_free)
        placed[row] = places[fitting[0]] if len(fitting) else point
    return placed


def write_labels(
    image: Image.Image,
    anchors: ArrayLike,
    names: Sequence[str],
    colours: Sequence[Colour],
    font: Font,
    fine: int,
) -> None:
    """Write each name on a plate with a border of its colour, and a line to its point."""
    if not names:
        return
    draw = ImageDraw.Draw(image)
    boxes = np.array([draw.textbbox((0, 0), name, font, anchor="mm") for name in names])
    sizes = boxes[:, 2:] - boxes[:, :2] + np.array([9, 7]) * fine
    points = np.asarray(anchors, np.float64)
    places = place_labels(points, sizes, image.size)
    for point, place, size, colour in zip(points, places, sizes, colours, strict=True):
        if (np.abs(point - place) > size / 2).any():
            ends = [tuple(point.tolist()), tuple(place.tolist())]
            draw.line(ends, PAPER, 3 * fine)
            draw.line(ends, colour, round(1.5 * fine))
            (x, y), r = point.tolist(), 2.5 * fine
            draw.ellipse((x - r, y - r, x + r, y + r), colour, PAPER, fine)
    for place, size, name, colour in zip(places, sizes, names, colours, strict=True):
        low, high = (place - size / 2 + fine).tolist(), (place + size / 2 - fine).tolist()
        draw.rounded_rectangle((*low, *high), 3 * fine, PAPER, colour, round(1.5 * fine))
        draw.text(tuple(place.tolist()), name, INK, font, anchor="mm")


def draw_scale_bar(
    image: Image.Image, corner: tuple[float, float], scale: float, most: float, font: Font
) -> None:
    """Draw a bar with its length, from its lower left corner; `scale` is in pixels a metre.

    The length is 1, 2 or 5 times a power of ten, and at most `most` pixels.
    """
    power = 10.0 ** math.floor(math.log10(most / scale))
    metres = max(m * power for m in (1, 2, 5) if m * power <= most / scale * (1 + 1e-9))
    draw = ImageDraw.Draw(image)
    (left, bottom), bar = corner, metres * scale
    thick = max(2.0, font.getbbox("0")[3] / 5)
    draw.rectangle((left, bottom - thick, left + bar, bottom), INK)
    draw.text((left + bar + 2 * thick, bottom), length_of_bar(metres), INK, font, anchor="ls")


def length_of_bar(metres: float) -> str:
    """A length of one digit with the unit that suits it: "50 cm"."""
    unit, name = next((u for u in UNITS if metres >= u[0] * (1 - 1e-9)), UNITS[-1])
    return f"{number(metres / unit)} {name}"
