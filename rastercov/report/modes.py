"""Ways to colour the faces of a mesh: values, palette, legend and words of each, in one table.

Faces are one byte each, with a palette of 256 and a legend. The page of the viewer gets these
bytes, and pictures of reports are drawn from them. Another way is an entry of `MODES`; it is shown
wherever values of its name are known.
"""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from rastercov.base import (
    ByName,
    ConfigError,
    WholeArray,
    check_choice,
    frozen_record,
    hooks_of,
    percent,
    plural,
)
from rastercov.base.format import number, percent_of
from rastercov.core.area.polygons import quantile
from rastercov.core.area.zones import DeadZones
from rastercov.core.camera import Gate
from rastercov.core.coverage.task import DORI, NAMES, REASONS
from rastercov.core.mesh import Mesh
from rastercov.report import theme
from rastercov.report.images import Key, add_frame
from rastercov.report.panorama import Marks, side_by_side, sides
from rastercov.report.theme import Colour, Pixels

Levels = NDArray[np.uint8]

NOTHING, OCCLUDER, FIRST, LAST = 0, 1, 2, 255
"""Levels of faces without a value and of occluders, and those of values."""
OCCLUDER_OF_REASONS = len(NAMES)
"""Level of occluders beside reasons, whose levels are their rows in `REASONS`."""
MOST_VIEWS = 12
"""Views from which the colour is the same."""
OCCLUDER_LABEL = "occluder"
WEAK_LABELS = ("too few views", "small angle between views", "unusually coarse")
"""Of the kinds of weakness in `rastercov.placement.reconstruction`."""


@frozen_record
class Painted:
    """Faces in their colours.

    Attributes
    ----------
    levels : (F,) uint8
        Row of the palette.
    palette : (256, 3) uint8
        sRGB.
    legend : list of dict
        Classes: level, label, colour, hatch, and the percentage of the task's area, or None.
    scale : dict or None
        Ends of a scale: low, high, unit, is_log, and the rows first ... last of the palette.
    """

    levels: Levels
    palette: Pixels
    legend: list[ByName] = field(default_factory=list)
    scale: ByName | None = None

    @property
    def colours(self) -> Pixels:
        """(F, 3) sRGB of the faces."""
        return self.palette[self.levels]

    @property
    def hatch(self) -> Levels:
        """(F,) hatch of the faces, as in `reasons.Words`."""
        of_level = np.zeros(256, np.uint8)
        for entry in self.legend:
            of_level[entry["level"]] = entry["hatch"]
        return of_level[self.levels]

    def keys(self, name: str) -> list[Key]:
        """Legend of a picture, its scale under a name; without occluders, which views have."""
        keys = []
        if self.scale is not None:
            ends = (f"{number(self.scale[end])} {self.scale['unit']}" for end in ("low", "high"))
            how = ", log scale" if self.scale["is_log"] else ""
            keys.append(Key.scale(name + how, self.palette[FIRST:], *map(str.strip, ends)))
        for entry in sorted(self.legend, key=lambda entry: int(entry["level"])):
            if entry["label"] != OCCLUDER_LABEL:
                share = entry["percent"]
                of_area = "" if share is None else f", {percent(share / 100)}"
                name = entry["label"] + of_area
                keys.append(Key.of(name, entry["colour"], hatch=entry["hatch"]))
        return keys


class OfCameras(NamedTuple):
    """Row of the camera of each face, (F,), -1 for none; name and colour of each camera."""

    row: WholeArray
    names: Sequence[str]
    colours: Pixels


def of_devices(row: WholeArray, names: Sequence[str]) -> OfCameras:
    """Devices, (F,) by words on them: as many as there are for "covered", -1 for none."""
    colours = [*theme.camera_colours(max(1, len(names)))[: len(names)], theme.COVERED]
    return OfCameras(row, [*names, "covered"], np.array(colours, np.uint8))


class OfUnit(NamedTuple):
    """Values of faces, (F,), and the unit to show them with."""

    values: ArrayLike
    unit: str


class Mode(NamedTuple):
    """A way to colour faces.

    Attributes
    ----------
    label, words : str
        In a menu, and in a sentence: the title of a picture.
    paint : callable
        Faces of a mesh in their colours, from the values of the mode.
    panel : str
        Panel of the viewer that offers it: "network", "camera" or "object".
    of : str
        What the viewer has values of: a "rig", its "gates", all "phases" of a scene, or "" for
        none.
    """

    label: str
    words: str
    paint: Callable[[Mesh, Any], Painted]
    panel: str = "network"
    of: str = "rig"


def by_reason(mesh: Mesh, rows: NDArray[np.uint8]) -> Painted:
    """Rows of `REASONS`, (F,)."""
    levels = np.where(mesh.task_mask, rows, np.uint8(OCCLUDER_OF_REASONS))
    colours = [*theme.REASON_COLOURS.tolist(), theme.OCCLUDER_PALE]
    words = [*(each.label for each in REASONS.values()), OCCLUDER_LABEL]
    return in_classes(mesh, levels, colours, dict(enumerate(words)), theme.REASON_HATCHES.tolist())


def by_share(mesh: Mesh, share: ArrayLike, none: str = "no coverage") -> Painted:
    """Coverage or covered shares, (F,), of which those beyond [0, 1] are shown as the nearer end.

    ConfigError for values of another shape.
    """
    return on_scale(mesh, share, (0.0, 1.0), "", none)


def by_camera(mesh: Mesh, cameras: OfCameras) -> Painted:
    """Cameras, each in its colour."""
    n = LAST - FIRST + 1
    colours: list[Colour] = [theme.UNCOVERED, theme.OCCLUDER_PALE]
    colours += [(r, g, b) for r, g, b in cameras.colours[:n].tolist()]
    words = [NOT_COVERED, OCCLUDER_LABEL, *cameras.names[:n]]
    return in_classes(mesh, _cycle_levels(mesh, cameras.row), colours, dict(enumerate(words)))


def by_views(mesh: Mesh, views: WholeArray) -> Painted:
    """Numbers of cameras, (F,)."""
    capped = np.minimum(views, MOST_VIEWS)
    most = max(1, int(capped[mesh.task_mask].max(initial=0)))
    levels = _cycle_levels(mesh, capped - 1)
    scale = theme.coverage_colours()[theme.level_rows(np.arange(most + 1) / most)].tolist()
    colours = [tuple(scale[0]), theme.OCCLUDER_PALE, *map(tuple, scale[1:])]
    words = {NOTHING: "no view", OCCLUDER: OCCLUDER_LABEL}
    for n in range(1, most + 1):
        words[OCCLUDER + n] = plural(n, "view") + (" or more" if n == MOST_VIEWS else "")
    return in_classes(mesh, levels, colours, words)


def by_density(
    mesh: Mesh, density: ArrayLike | OfUnit, ends: tuple[float, float] = (0.02, 0.98)
) -> Painted:
    """Pixel densities, (F,), in px/m unless they have a unit, 0 for none, by factors.

    The scale ends at the values of two shares of the area.
    """
    given, unit = density if isinstance(density, OfUnit) else OfUnit(density, "px/m")
    values = np.asarray(given, np.float64)
    known = mesh.task_mask & (values > 0)
    low, high = 1.0, 10.0
    if known.any():
        weights = np.maximum(mesh.areas, 1e-300)
        low, high = (quantile(values, weights, known, share) for share in ends)
        high = max(high, low * (1 + 1e-9))
    at = np.log(np.maximum(values, low) / low) / math.log(high / low)
    shares = np.where(values > 0, np.maximum(at, 1e-9), 0.0)
    return on_scale(mesh, shares, (low, high), unit, NOT_COVERED, is_log=True)


def invert(painted: Painted) -> Painted:
    """The same with the other end of the scale in the colour of what is covered."""
    return replace(
        painted, palette=np.concatenate([painted.palette[:FIRST], painted.palette[:1:-1]])
    )


def by_level(mesh: Mesh, density: ArrayLike) -> Painted:
    """Levels of `DORI` by facing densities, (F,) px/m, 0 for none; the legend is in their order."""
    values = np.asarray(density, np.float64)
    row = np.searchsorted(list(DORI.values()), values, "right")
    colours = [theme.UNCOVERED, theme.OCCLUDER_PALE, theme.COARSE, *theme.DORI.values()]
    words = [f"{name}, {least:g} px/m or more" for name, least in DORI.items()]
    words = [NOT_COVERED, OCCLUDER_LABEL, f"below {next(iter(DORI))}", *words]
    levels = _cycle_levels(mesh, np.where(values > 0, row, -1))
    result = in_classes(mesh, levels, colours, dict(enumerate(words)))
    order = sorted(result.legend, key=lambda each: (each["percent"] is None, -each["level"]))
    return replace(result, legend=order)


def by_angle(mesh: Mesh, angle: ArrayLike) -> Painted:
    """Angles between views, (F,) degrees, 0 for fewer than two."""
    return up_to_most(mesh, angle, 90.0, "deg", "fewer than two views")


def up_to_most(mesh: Mesh, values: ArrayLike, otherwise: float, unit: str, none: str) -> Painted:
    """Values, (F,), on a scale from 0 to the most of a face of the task, or to another end."""
    given = np.asarray(values, np.float64)
    high = float(given[mesh.task_mask].max(initial=0.0)) or otherwise
    return on_scale(mesh, given / high, (0.0, high), unit, none)


def by_incidence(mesh: Mesh, angle: ArrayLike) -> Painted:
    """Least angles of incidence, (F,) degrees; infinite where no camera covers the face."""
    values = np.asarray(angle, np.float64)
    shares = np.where(np.isfinite(values), np.maximum(values / 90, 1e-9), 0.0)
    return invert(on_scale(mesh, shares, (0.0, 90.0), "deg", NOT_COVERED))


def by_weakness(mesh: Mesh, kind: WholeArray) -> Painted:
    """Kinds of weak parts of a reconstruction, (F,), rows of `WEAK_LABELS`; -1 for none."""
    colours = [theme.COVERED, theme.OCCLUDER_PALE, *theme.WEAK]
    words = ["enough views, angle and resolution", OCCLUDER_LABEL, *WEAK_LABELS]
    return in_classes(mesh, _cycle_levels(mesh, kind), colours, dict(enumerate(words)))


def by_one_camera(mesh: Mesh, coverage: ArrayLike) -> Painted:
    """Coverage by one camera, (F,): grey in proportion to it, black where there is none."""
    result = by_share(mesh, coverage)
    palette = np.zeros((256, 3), np.uint8)
    palette[FIRST:] = np.rint(np.linspace(60, 255, LAST - FIRST + 1))[:, None]
    palette[OCCLUDER] = theme.OCCLUDER_PALE
    legend = [each | {"colour": palette[each["level"]].tolist()} for each in result.legend]
    return Painted(result.levels, palette, legend, result.scale)


def by_segment(mesh: Mesh, labels: ArrayLike) -> Painted:
    """Segments, (F,) from 0; -1 for faces in none. ConfigError for labels of another shape."""
    label = np.asarray(labels)
    if label.shape != (mesh.n_faces,):
        raise ConfigError(
            f"expected a segmentation of {mesh.n_faces} faces, got {len(label)}; segment this mesh"
        )
    palette = np.concatenate(
        (np.array([theme.UNCOVERED, theme.OCCLUDER_PALE]), theme.index_colours(np.arange(254)))
    ).astype(np.uint8)
    words = f"{plural(int(label.max(initial=-1)) + 1, 'segment')}, one colour each"
    result = in_classes(mesh, _cycle_levels(mesh, label), palette, {FIRST: words})
    return replace(result, legend=[each | {"percent": None} for each in result.legend])


def mode_of(name: str) -> Mode:
    """The mode of a name; ConfigError where there is none."""
    check_choice("mode", name, list(MODES))
    return MODES[name]


NOT_COVERED = "not covered"
"""Class of faces that have no value where nothing covers them."""


def mode_picture(
    name: str,
    mesh: Mesh,
    values: object,
    eyes: ArrayLike = (),
    *,
    marks: Marks | None = None,
    left: DeadZones | None = None,
    unit: str = "",
) -> Image.Image:
    """Picture of a mesh coloured by a mode, from two sides, with title and legend.

    `eyes`, `marks` and `unit` are as of `panorama.side_by_side`.

    What is `left` by area has no values, of modes in which faces have none that are not covered.
    """
    mode = mode_of(name)
    painted, zones = mode.paint(mesh, values), None
    if left is not None and any(each["label"] == NOT_COVERED for each in painted.legend):
        share = 100 * float(left.area.sum()) / float(mesh.areas[mesh.task_mask].sum())
        own = {"percent": share}
        legend = [
            {**each, **(own if each["label"] == NOT_COVERED else {})} for each in painted.legend
        ]
        painted = replace(painted, legend=legend)
        zones = left, painted.palette[NOTHING]
    keys = painted.keys(mode.label.lower())
    scene = mesh, painted.colours, painted.hatch, sides(mesh, eyes), eyes
    pixels, more = side_by_side(*scene, marks=marks, left=zones, unit=unit)
    return add_frame(pixels, mode.words.rstrip("."), [*keys, *more])


def _cycle_levels(mesh: Mesh, row: WholeArray) -> Levels:
    """Levels of rows from 0, which begin again after the last; -1 has none."""
    levels = np.where(row >= 0, FIRST + row % (LAST - FIRST + 1), NOTHING)
    return np.where(mesh.task_mask, levels, OCCLUDER).astype(np.uint8)


def in_classes(
    mesh: Mesh,
    levels: Levels,
    colours: ArrayLike,
    words: Mapping[int, str],
    hatches: Sequence[int] = (),
) -> Painted:
    """Painted faces of classes, with colours and hatches from level 0.

    The legend has those with words, by their level, that occur, by falling area.
    """
    palette = np.zeros((256, 3), np.uint8)
    palette[: len(np.asarray(colours))] = colours
    areas = np.bincount(levels, weights=mesh.areas, minlength=256)
    counts = np.bincount(levels, minlength=256)
    task = mesh.task_mask
    total = float(np.asarray(mesh.areas)[task].sum())
    scored = np.bincount(levels[task], minlength=256)
    of_level = [*hatches, *[0] * 256]
    legend: list[ByName] = [
        {
            "level": level,
            "label": text,
            "colour": palette[level].tolist(),
            "percent": percent_of(float(areas[level]), total) if scored[level] else None,
            "hatch": of_level[level],
        }
        for level, text in words.items()
        if counts[level]
    ]
    legend.sort(key=lambda each: -1.0 if each["percent"] is None else each["percent"], reverse=True)
    return Painted(levels, palette, legend)


def on_scale(
    mesh: Mesh,
    shares: ArrayLike,
    ends: tuple[float, float],
    unit: str,
    none: str,
    *,
    is_log: bool = False,
) -> Painted:
    """Painted faces on the scale of coverage, and the classes beside it; those with 0 have none."""
    levels = theme.colour_rows(mesh, shares).astype(np.uint8)
    palette = theme.coverage_colours()
    palette[OCCLUDER] = theme.OCCLUDER_PALE
    legend = in_classes(mesh, levels, palette, {NOTHING: none, OCCLUDER: OCCLUDER_LABEL}).legend
    scale = {
        "low": ends[0],
        "high": ends[1],
        "unit": unit,
        "is_log": is_log,
        "first": FIRST,
        "last": LAST,
    }
    return Painted(levels, palette, legend, scale)


def of_gates(gates: Collection[Gate]) -> dict[str, bool]:
    """Modes of cameras that count together, and whether there are any with its values."""
    table = {name: any(name in gate.modes for gate in gates) for name in OF_GATES}
    return {"device": bool(gates)} | table


class ReportHooks:
    """Hooks of a feature in reports: modes by the names of their values, as of `Feature.values`."""

    pictures: Mapping[str, str] = {}
    """Words on its pictures, which are files of the same names."""
    tables: Sequence[str] = ()
    """Names of its tables."""

    def __init__(self, **modes: Mode) -> None:
        self.modes = modes

    def part(self, areas: object) -> Any:
        """Additions to the page of an `AreaNetwork` or None: a `NetworkPart`, or None."""


REPORTS = hooks_of(ReportHooks)
OF_FEATURES = {name: mode for each in REPORTS for name, mode in each.modes.items()}
OF_EQUIPMENT = tuple(name for name, mode in OF_FEATURES.items() if mode.of == "rig")
"""Modes whose values are those of `Feature.values`."""
OF_GATES = tuple(name for name, mode in OF_FEATURES.items() if mode.of == "gates")
"""Modes of cameras that count together, see `Gate.modes`."""
MODES: dict[str, Mode] = {
    "reason": Mode(
        "Reason", "First criterion that each face fails; covered if it fails none.", by_reason
    ),
    "coverage": Mode("Best coverage", "Best coverage of each face by any camera.", by_share),
    "camera": Mode("Camera", "Camera that covers each face best.", by_camera),
    "views": Mode("Views", "Number of views of each part of the surface.", by_views),
    "density": Mode("Pixel density", "Highest pixel density of each part.", by_density),
    "level": Mode("DORI level", "EN 62676-4 level for a target that faces the camera.", by_level),
    "incidence": Mode(
        "Incidence", "Smallest angle of incidence at which a camera covers each face.", by_incidence
    ),
    "angle": Mode("Angle", "Largest angle between two views of each part.", by_angle),
    "device": Mode(
        "Failing sensor or lamp", "Sensor that fails at each part, or the nearest lamp.", by_camera
    ),
    "weak": Mode(
        "Weak zones",
        "Parts with too few views, small angles between them, or unusually coarse sampling.",
        by_weakness,
        of="",
    ),
    **OF_FEATURES,
    "area": Mode("Covered share", "Exact covered share of the area of each face.", by_share),
    "single": Mode(
        "One camera",
        "Coverage by the selected camera, in grey levels.",
        by_one_camera,
        "camera",
    ),
    "segments": Mode(
        "Segments",
        "Segments by normals, equations (6.1) to (6.3) of E. S. Eissa (2020).",
        by_segment,
        "object",
    ),
}
"""Ways to colour faces by the name of their values, in the order of a menu."""
