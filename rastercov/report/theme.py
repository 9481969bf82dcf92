"""All colours of reports: pages in a light and a dark theme, pictures, the scale of coverage.

Colours of pages are CSS strings, those of pictures sRGB triples.
"""

import colorsys
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base import ConfigError, IntArray
from rastercov.core.coverage.task import REASONS
from rastercov.core.mesh import Mesh

Colour = tuple[int, int, int]
Pixels = NDArray[np.uint8]


@dataclass(frozen=True)
class Theme:
    """Colours of a page."""

    page: str  # background
    card: str  # background of boxes
    ink: str  # text
    soft: str  # text of less weight
    line: str
    good: str  # verdicts
    bad: str


LIGHT = Theme(
    page="#ffffff",
    card="#f6f8fa",
    ink="#1b2129",
    soft="#5b6673",
    line="#dfe4ea",
    good="#0b7a55",
    bad="#b8172a",
)
DARK = Theme(
    page="#0f1318",
    card="#171c22",
    ink="#e6eaef",
    soft="#9aa6b3",
    line="#2c343d",
    good="#3ccb9d",
    bad="#ff6b78",
)

# Pictures of the part.
PAPER, INK = (255, 255, 255), (24, 28, 34)
REASON_COLOURS = np.array([each.colour for each in REASONS.values()], np.uint8)
REASON_HATCHES = np.array([each.hatch for each in REASONS.values()], np.uint8)
"""(R, 3) and (R,), by the rows of `REASONS`."""
COVERED, UNCOVERED = REASONS["covered"].colour, (52, 56, 62)
OCCLUDER_PALE = (238, 228, 208)


class Setting(NamedTuple):
    """Colours of a picture around those of its task, and its light."""

    background: Colour
    occluder: Colour
    back: Colour  # of evaluated faces seen from behind
    back_stripe: Colour
    least_light: float  # brightness of a face seen edge-on, relative to one seen along its normal


OUTSIDE = Setting((246, 248, 250), OCCLUDER_PALE, (150, 142, 158), (178, 171, 186), 0.72)
"""Of views of a mesh in which no camera is."""
OF_CAMERA = Setting((160, 190, 219), (176, 140, 90), (132, 96, 140), (158, 122, 166), 0.86)
"""Of the image of a camera: all have a hue, so that every grey means coverage."""
DARKEST, GREY_SPAN = 14, 235
"""Grey of a face: light * (DARKEST + GREY_SPAN * coverage)."""
WEAK: tuple[Colour, ...] = ((204, 62, 68), (226, 142, 44), (112, 92, 176))
"""Of weak parts: too few views, small angle, coarse."""
DORI: dict[str, Colour] = {
    "detect": (223, 234, 245), "observe": (207, 232, 207), "recognise": (253, 235, 176),
    "identify": (248, 198, 168),
}  # fmt: skip
"""Of the levels of `rastercov.core.coverage.task.DORI`, on paper and in the viewer."""
COARSE = (150, 156, 164)
"""Of what is covered at none of these levels."""
CAMERAS: tuple[Colour, ...] = (
    (0, 114, 178), (230, 126, 0), (0, 158, 115), (204, 80, 150), (100, 185, 245), (236, 206, 60),
    (213, 48, 40), (120, 84, 190), (130, 190, 40), (40, 50, 140), (250, 160, 170), (0, 205, 205),
)  # fmt: skip
"""Colours of the first cameras, all vivid: grey, dark and pale have other meanings."""
MORE_CAMERAS = ((0.78, 0.86), (0.5, 0.97), (0.9, 0.62))
"""Saturation and value of those of further cameras, in turn."""
COVERAGE_SCALE = ((62, 18, 96), (57, 82, 140), (32, 144, 140), (116, 203, 83), (253, 231, 37))
"""Dark violet over teal to yellow: lightness rises evenly, so that it is readable in grey too."""
ZERO_COVERAGE, OCCLUDER_3D = (232, 33, 45), (146, 160, 178)
OUTLINE_3D = (110, 120, 130)
NEARLY_GREY, VIVID, DARK_PAPER = 30.0, 80.0, 22.0
"""Spans of the channels of a colour up to which it is a grey in the dark, and from which it is not;
grey of the paper there."""
PALETTE = 256
ZERO_ROW, OCCLUDER_ROW = 0, 1
"""Rows of the palette for no coverage and for occluders."""


def in_the_dark(colours: Pixels) -> Pixels:
    """Colours (N, 3) of a picture for a dark page: greys from dark to pale, all others as they are.

    A colour that is nearly grey keeps its hue, and has the lightness of HSL reversed.
    """
    given = colours.astype(np.float64)
    most, least = given.max(axis=1, keepdims=True), given.min(axis=1, keepdims=True)
    kept = np.clip((most - least - NEARLY_GREY) / (VIVID - NEARLY_GREY), 0.0, 1.0)
    dark = DARK_PAPER + (255 - DARK_PAPER) / 255 * (given + 255 - most - least)
    return np.rint(kept * given + (1 - kept) * dark).astype(np.uint8)


def coverage_colours() -> Pixels:
    """(256, 3) sRGB: coverage 0, occluder, and 254 steps of the scale."""
    at = np.linspace(0, 1, len(COVERAGE_SCALE))
    steps = np.linspace(0, 1, PALETTE - 2)
    scale = np.stack([np.interp(steps, at, c) for c in np.array(COVERAGE_SCALE).T], axis=1)
    return np.rint(np.vstack((ZERO_COVERAGE, OCCLUDER_3D, scale))).astype(np.uint8)


def colour_rows(mesh: Mesh, values: ArrayLike) -> IntArray:
    """(F,) row of `coverage_colours` for each face."""
    levels = np.asarray(values, np.float64)
    if levels.shape != (mesh.n_faces,):
        raise ConfigError(
            f"expected values of shape ({mesh.n_faces},), got {levels.shape}; give one per face"
        )
    return np.where(mesh.task_mask, level_rows(levels), OCCLUDER_ROW)


def level_rows(values: ArrayLike) -> IntArray:
    """(N,) row of `coverage_colours` for each level of coverage, [0, 1]."""
    levels = np.clip(np.nan_to_num(np.asarray(values, np.float64)), 0.0, 1.0)
    entry = 2 + np.rint(levels * (PALETTE - 3)).astype(np.int64)
    return np.where(levels > 0, entry, ZERO_ROW)


def index_colours(indices: ArrayLike) -> Pixels:
    """Colours of face indices, (N,) -> (N, 3), all channels 40 or more.

    Red, green and blue follow the additive sequence of the generalised golden ratio in three
    dimensions, x^4 = x + 1: points near in sequence are far apart in at least one of them.

    M. Roberts. The Unreasonable Effectiveness of Quasirandom Sequences. 2018.
    """
    steps = 1.2207440846057596 ** -np.arange(1.0, 4.0)
    return (40 + 215.99 * (np.asarray(indices)[:, None] * steps % 1.0)).astype(np.uint8)


def camera_colours(count: int) -> Pixels:
    """(K, 3) colours of cameras; the first twelve are easy to tell apart."""
    more = [
        colorsys.hsv_to_rgb(0.618033988749895 * row % 1, *MORE_CAMERAS[row % len(MORE_CAMERAS)])
        for row in range(len(CAMERAS), count)
    ]
    chosen = np.rint(255 * np.array(more).reshape(-1, 3))
    return np.concatenate((np.array(CAMERAS), chosen)).astype(np.uint8)[:count]
