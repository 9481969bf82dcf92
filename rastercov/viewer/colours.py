"""Levels of faces and what they mean: one byte a face, a palette of 256, and a legend.

One function for each way to colour a mesh. A page that shows another state, or another way, needs
the bytes alone.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.checks import shown
from rastercov.base.errors import ConfigError
from rastercov.coverage.task import Reason
from rastercov.mesh import Mesh
from rastercov.report import theme
from rastercov.report.theme import Colour, Pixels
from rastercov.viewer.measurements import NetworkFigures, Row

Levels = NDArray[np.uint8]

NOTHING, OCCLUDER, FIRST = 0, 1, 2
"""Levels of faces without a value and of occluders, and the first that is free."""
LAST = 255
MOST_VIEWS = 12
"""Views from which the colour is the same."""
REASON_WORDS = {
    Reason.COVERED: "covered",
    Reason.OCCLUDED: "hidden",
    Reason.OUTSIDE: "outside the image",
    Reason.BACK_FACING: "seen from behind",
    Reason.TOO_COARSE: "too few pixels",
    Reason.OUT_OF_FOCUS: "out of focus",
    Reason.TOO_OBLIQUE: "seen too flatly",
    Reason.UNSAMPLED: "too small for a sample",
    Reason.DEGENERATE: "without area",
}
TOO_FEW, NO_CAMERAS, OCCLUDER_OF_REASONS = len(Reason), len(Reason) + 1, len(Reason) + 2
"""Levels of the reasons that no `Reason` is for."""


@dataclass(frozen=True, eq=False)
class Painted:
    """Faces as a page shows them.

    Attributes
    ----------
    levels : (F,) uint8
        Row of the palette.
    palette : (256, 3) uint8
        sRGB.
    legend : list of dict
        Classes: level, label, colour, and the percentage of the task's area, or None.
    scale : dict or None
        Ends of a scale: low, high, unit, is_log, and the rows first ... last of the palette.
    """

    levels: Levels
    palette: Pixels
    legend: list[dict[str, Any]] = field(default_factory=list)
    scale: dict[str, Any] | None = None


def by_reason(figures: NetworkFigures) -> Painted:
    """The criterion that each face fails in the camera that comes nearest to covering it."""
    mesh = figures.mesh
    names = figures.reason_names()
    levels = figures.reason.copy()
    levels[levels == Reason.COVERED] = TOO_FEW
    levels[figures.covered] = Reason.COVERED
    if not figures.rows:
        levels[:] = NO_CAMERAS
    levels[~mesh.task_mask] = OCCLUDER_OF_REASONS
    colours: dict[int, Colour] = {
        Reason.COVERED: theme.COVERED,
        TOO_FEW: theme.REASONS["too_few_views"],
        NO_CAMERAS: theme.WALL_LINE,
        OCCLUDER_OF_REASONS: theme.OCCLUDER_PALE,
    }
    colours |= {r: theme.REASONS[r.name.lower()] for r in Reason if r != Reason.COVERED}
    words = {int(reason): text for reason, text in REASON_WORDS.items()}
    few = "too few cameras" if names[-1] == "too_few_views" else ""
    words |= {TOO_FEW: few or "no cameras", NO_CAMERAS: "no cameras"}
    return _classes(mesh, levels, colours, words | {OCCLUDER_OF_REASONS: "occluder"})


def by_coverage(figures: NetworkFigures) -> Painted:
    """Greatest coverage (3.6) of each face by any camera."""
    return _on_scale(figures.mesh, np.minimum(figures.best, 1.0), 0.0, 1.0, "", "not covered")


def by_camera(figures: NetworkFigures) -> Painted:
    """The camera that covers each face best; the first of equals."""
    mesh = figures.mesh
    on = figures.state.on
    places = {each.id: row for row, each in enumerate(figures.state.stations)}
    every = theme.camera_colours(max(1, len(figures.state.stations)))
    n = LAST - FIRST + 1
    row = np.where(figures.views > 0, figures.best_row, -1)
    levels = np.where(row >= 0, FIRST + row % n, NOTHING).astype(np.uint8)
    levels[~mesh.task_mask] = OCCLUDER
    colours: dict[int, Colour] = {NOTHING: theme.UNCOVERED, OCCLUDER: theme.OCCLUDER_PALE}
    words = {NOTHING: "covered by none", OCCLUDER: "occluder"}
    for index, station in enumerate(on[:n]):
        red, green, blue = every[places[station.id]].tolist()
        colours[FIRST + index] = (red, green, blue)
        words[FIRST + index] = station.name
    return _classes(mesh, levels, colours, words)


def by_views(figures: NetworkFigures) -> Painted:
    """Number of cameras that cover each face."""
    mesh = figures.mesh
    capped = np.minimum(figures.views, MOST_VIEWS)
    levels = np.where(capped > 0, FIRST + capped - 1, NOTHING).astype(np.uint8)
    levels[~mesh.task_mask] = OCCLUDER
    most = max(1, int(capped[mesh.task_mask].max(initial=0)))
    scale = theme.coverage_colours()[FIRST:]
    colours: dict[int, Colour] = {NOTHING: theme.ZERO_COVERAGE, OCCLUDER: theme.OCCLUDER_PALE}
    words = {NOTHING: "no camera", OCCLUDER: "occluder"}
    for number in range(1, most + 1):
        at = round((number - 1) / max(1, most - 1) * (len(scale) - 1)) if most > 1 else -1
        red, green, blue = scale[at].tolist()
        colours[FIRST + number - 1] = (red, green, blue)
        more = " or more" if number == MOST_VIEWS else ""
        words[FIRST + number - 1] = f"{number}{more} camera{'s' if number > 1 else ''}"
    return _classes(mesh, levels, colours, words)


def by_density(figures: NetworkFigures) -> Painted:
    """Greatest pixel density by a camera that covers the face, on a logarithmic scale."""
    density = figures.density()
    known = density[figures.mesh.task_mask & (density > 0)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (1.0, 10.0)
    low = max(low, high * 1e-4)
    return _on_scale(figures.mesh, density, low, high, "px/m", "not covered", is_log=True)


def by_angle(figures: NetworkFigures) -> Painted:
    """Widest angle between the rays to two cameras that cover the face."""
    angle = np.degrees(figures.widest_angle())
    angle[figures.views < 2] = 0.0
    known = angle[figures.mesh.task_mask]
    high = float(known.max(initial=0.0)) or 90.0
    return _on_scale(figures.mesh, angle, 0.0, high, "deg", "fewer than two cameras")


def by_share(mesh: Mesh, share: ArrayLike) -> Painted:
    """Share of the exact area of each face, (F,), that is covered."""
    return _on_scale(mesh, np.asarray(share), 0.0, 1.0, "", "not covered")


def by_one_camera(mesh: Mesh, row: Row) -> Painted:
    """Coverage by one camera: grey in proportion to it, black where there is none."""
    levels = np.clip(row.coverage, 0.0, 1.0)
    steps = np.where(levels > 0, FIRST + np.rint(levels * (LAST - FIRST)), NOTHING)
    painted = np.where(mesh.task_mask, steps, OCCLUDER).astype(np.uint8)
    palette = np.zeros((256, 3), np.uint8)
    grey = np.rint(np.linspace(60, 255, LAST - FIRST + 1)).astype(np.uint8)
    palette[FIRST:] = grey[:, None]
    palette[OCCLUDER] = theme.OCCLUDER_PALE
    return _scaled(mesh, painted, palette, "", "not covered", (0.0, 1.0), is_log=False)


def by_segment(mesh: Mesh, labels: ArrayLike) -> Painted:
    """Segments, (F,) labels from 0; -1 for faces in none."""
    label = np.asarray(labels)
    n = LAST - FIRST + 1
    levels = np.where(label >= 0, FIRST + label % n, NOTHING).astype(np.uint8)
    levels[~mesh.task_mask] = OCCLUDER
    palette = np.zeros((256, 3), np.uint8)
    palette[FIRST:] = theme.index_colours(np.arange(n))
    palette[NOTHING], palette[OCCLUDER] = theme.UNCOVERED, theme.OCCLUDER_PALE
    count = int(label.max(initial=-1)) + 1
    words = f"{count:,} segment{'' if count == 1 else 's'}, a colour each"
    entry = {"level": FIRST, "label": words, "colour": palette[FIRST].tolist(), "percent": None}
    return Painted(levels, palette, [entry])


NETWORK_MODES: dict[str, tuple[str, str, Callable[[NetworkFigures], Painted]]] = {
    "reason": ("Reason", "Criterion that each face fails, or that it is covered.", by_reason),
    "coverage": ("Best coverage", "Greatest coverage by any camera.", by_coverage),
    "camera": ("Camera", "Camera that covers each face best.", by_camera),
    "views": ("Views", "Number of cameras that cover each face.", by_views),
    "density": ("Pixel density", "Greatest pixel density, pixels a metre.", by_density),
    "angle": ("Angle", "Widest angle between two views of each face.", by_angle),
}
"""Ways to colour the faces by the whole network: label, words and function of each."""


def _classes(
    mesh: Mesh, levels: Levels, colours: Mapping[int, Colour], words: Mapping[int, str]
) -> Painted:
    """Painted faces of classes; the legend has those that occur, by falling area."""
    palette = np.zeros((256, 3), np.uint8)
    for level, colour in colours.items():
        palette[level] = colour
    areas = np.bincount(levels, weights=mesh.areas, minlength=256)
    counts = np.bincount(levels, minlength=256)
    task = mesh.task_mask
    total = max(float(np.asarray(mesh.areas)[task].sum()), np.finfo(float).tiny)
    scored = np.bincount(levels[task], minlength=256)
    legend = [
        {
            "level": level,
            "label": text,
            "colour": palette[level].tolist(),
            "percent": 100 * float(areas[level]) / total if scored[level] else None,
        }
        for level, text in words.items()
        if counts[level]
    ]
    legend.sort(key=lambda each: -1.0 if each["percent"] is None else each["percent"], reverse=True)
    return Painted(levels, palette, legend)


def _on_scale(
    mesh: Mesh,
    values: ArrayLike,
    low: float,
    high: float,
    unit: str,
    none: str,
    *,
    is_log: bool = False,
) -> Painted:
    """Painted faces on the scale of coverage; those with 0 have none."""
    found = np.nan_to_num(np.asarray(values, np.float64))
    if is_log:
        span = math.log(high / low) if high > low > 0 else 1.0
        at = np.log(np.maximum(found, low) / low) / span
    else:
        at = (found - low) / (high - low if high > low else 1.0)
    steps = FIRST + np.rint(np.clip(at, 0, 1) * (LAST - FIRST))
    levels = np.where(found > 0, steps, NOTHING)
    levels = np.where(mesh.task_mask, levels, OCCLUDER).astype(np.uint8)
    palette = theme.coverage_colours()
    palette[OCCLUDER] = theme.OCCLUDER_PALE
    return _scaled(mesh, levels, palette, unit, none, (low, high), is_log=is_log)


def _scaled(
    mesh: Mesh,
    levels: Levels,
    palette: Pixels,
    unit: str,
    none: str,
    ends: tuple[float, float],
    *,
    is_log: bool,
) -> Painted:
    """Painted faces of a scale, with the classes beside it."""
    words = {NOTHING: none, OCCLUDER: "occluder"}
    legend = _classes(mesh, levels, {level: tuple(palette[level]) for level in words}, words).legend
    scale = {
        "low": ends[0], "high": ends[1], "unit": unit, "is_log": is_log,
        "first": FIRST, "last": LAST,
    }  # fmt: skip
    return Painted(levels, palette, legend, scale)


def mode_of(name: str, known: Sequence[str]) -> str:
    """The name of a mode; ConfigError where there is none of that name."""
    if name not in known:
        raise ConfigError(f"mode must be one of {', '.join(known)}, got {shown(name)}")
    return name
