"""Plan sheet of a building: walls cut at a height, cameras and what they see, to scale on paper.

The sheet is a list of shapes and labels in millimetres of the paper, x to the right and y up, each
of a layer; `sheet_files` writes it as SVG, PDF or DXF.

EN 62676-4. Video surveillance systems for use in security applications - Part 4: Application
guidelines. 2015.
"""

import datetime
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from rastercov.base.arguments import check_choice
from rastercov.base.errors import ConfigError
from rastercov.base.format import area, percent, plural, shortened, signed
from rastercov.camera.camera import Camera
from rastercov.camera.pose import Poses
from rastercov.camera.projection import view_border
from rastercov.camera.rig import cameras_of
from rastercov.coverage.area.frames import to_world
from rastercov.coverage.area.network import in_words
from rastercov.coverage.densities import EDITIONS
from rastercov.coverage.evaluation import Evaluation
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.report.plan_geometry import (
    chains,
    edges_below,
    field_of_view,
    noded,
    section,
    solid,
    visible_from,
)
from rastercov.report.tables import heading_and_tilt

FloatArray = NDArray[np.float64]

PAPERS = {"A4": (297, 210), "A3": (420, 297), "A2": (594, 420), "A1": (841, 594), "A0": (1189, 841)}
"""Width and height of landscape sheets, mm."""
STEPS = (1.0, 2.0, 2.5, 5.0)
"""Scales that are taken unless one is given: 1 to these times a power of ten."""
EDITION = "EN 62676-4:2015"
LEVELS = ("detect", "observe", "recognise", "identify")
"""Levels of `EDITION` that have a band, from the farthest."""
MARGIN, PANEL, GAP = 10.0, 142.0, 8.0
"""Border of the sheet, width of the column with tables, and least room around the drawing, mm."""
TEXT, LINE = 2.5, 4.2
"""Height of letters, and distance of lines of text, mm."""
HATCH = 1.6
"""Distance of the lines of a hatching, mm."""
CUT = 1.2
"""Height of the cut above the floor, m; half of the building where that is lower than twice it."""
LOOKS_DOWN = 0.2
"""Length in plan of the axis of a camera below which its symbol is a circle."""
LEVEL = 0.999
"""Least z of the normal of a face of a floor."""
STOREY = 0.1
"""Difference of heights from which one face is drawn above another, m."""
FACES_UP = 0.1
"""Least z of the normal of a face whose dead zones are drawn."""
COLUMNS = (
    ("camera", 0.0, "start"), ("x", 39.0, "end"), ("y", 50.0, "end"), ("height", 61.0, "end"),
    ("heading", 75.0, "end"), ("tilt", 83.0, "end"), ("lens", 86.0, "start"),
    ("hfov", 113.0, "end"), ("I / R / O / D", PANEL - 4, "end"),
)  # fmt: skip
"""Heads of the camera table, their places in it, mm, and the side from which they are written."""


class Layer(NamedTuple):
    """Lines and area of a layer: colours or None, and the width of its lines, mm."""

    stroke: str | None
    width: float
    fill: str | None


LAYERS = {
    "FOV_DETECT": Layer(None, 0, "#dfeaf5"),
    "FOV_OBSERVE": Layer(None, 0, "#cfe8cf"),
    "FOV_RECOGNISE": Layer(None, 0, "#fdebb0"),
    "FOV_IDENTIFY": Layer(None, 0, "#f8c6a8"),
    "BELOW": Layer("#8a939c", 0.13, None),
    "DEAD": Layer("#b8172a", 0.18, None),
    "FOV": Layer("#1f5fa8", 0.18, None),
    "WALLS": Layer("#14181d", 0.5, "#9aa1a9"),
    "CAMERAS": Layer("#14181d", 0.25, "#14181d"),
    "SHEET": Layer("#14181d", 0.25, None),
    "PAPER": Layer(None, 0, "#ffffff"),
    "TEXT": Layer(None, 0, "#14181d"),
}
"""In the order in which they are drawn; PAPER is behind the names of cameras."""


class Shape(NamedTuple):
    """Polylines (N, 2) of a layer, mm; together they bound an area, by even and odd, if filled."""

    layer: str
    lines: list[FloatArray]
    is_filled: bool = False


class Label(NamedTuple):
    """Text at a point of its base line, mm; `anchor` is start, middle or end."""

    x: float
    y: float
    text: str
    anchor: str = "start"
    size: float = TEXT
    is_bold: bool = False


@dataclass(frozen=True, kw_only=True)
class SheetOptions:
    """Choices of a plan sheet; heights are z, metres, and `scale` is auto or 1:N."""

    paper: str = "A3"
    scale: str = "auto"
    floor: float | None = None  # see `floor_of`
    cut: float | None = None  # CUT above the floor
    north: float | None = None  # direction, degrees counter-clockwise from +x; None for no arrow
    project: str = ""
    date: str = ""  # today


@dataclass(frozen=True, eq=False)
class Sheet:
    """A drawing on paper.

    Attributes
    ----------
    size : (float, float)
        Width and height, mm.
    scale : float
        Millimetres of the world in one of the paper.
    origin : (2,) float64
        World coordinates of the lower left corner of the paper, m.
    heights : (float, float)
        z of the floor and of the cut, m.
    title : str
    shapes, labels : list
    """

    size: tuple[float, float]
    scale: float
    origin: FloatArray
    heights: tuple[float, float]
    title: str
    shapes: list[Shape] = field(default_factory=list)
    labels: list[Label] = field(default_factory=list)

    def to_paper(self, points: ArrayLike) -> FloatArray:
        """Points (..., 2) of the world, m, on the paper, mm."""
        return (np.asarray(points, np.float64) - self.origin) * (1e3 / self.scale)

    def add_lines(self, layer: str, lines: Sequence[ArrayLike]) -> None:
        """Add polylines in millimetres."""
        self.shapes.append(Shape(layer, [np.asarray(line, np.float64) for line in lines]))

    def add_area(self, layer: str, found: Any, *, is_filled: bool = True) -> None:
        """Add the polygons of an area of the world, each with its holes, or their outlines."""
        for part in shapely.get_parts(found):
            if part.geom_type == "Polygon" and not part.is_empty:
                rings = [part.exterior, *part.interiors]
                lines = [self.to_paper(shapely.get_coordinates(ring)) for ring in rings]
                self.shapes.append(Shape(layer, lines, is_filled))

    def add_text(self, x: float, y: float, text: str, *style: Any, **more: Any) -> None:
        """Add a label."""
        self.labels.append(Label(x, y, text, *style, **more))


def plan_sheet(
    found: Evaluation,
    names: Sequence[str],
    options: SheetOptions,
    views: Mapping[str, int] | None = None,
) -> Sheet:
    """Plan of what an evaluation is of, with its cameras, what they see, and dead zones.

    Parameters
    ----------
    found : Evaluation
        Mesh, cameras and result.
    names : sequence of str
        Name of each pose.
    options : SheetOptions
    views : mapping of str to int, optional
        Cameras that faces of a group need, 1 for the others; those of the task unless given.

    Raises
    ------
    ConfigError
        For an unknown paper or scale, one at which the drawing does not fit, a cut beyond the mesh,
        and an image of all directions.
    """
    mesh, poses = found.mesh.opaque, found.poses
    sheet = open_sheet(found.mesh, poses, options)
    floor, cut = sheet.heights
    segments, keys = section(mesh.vertices, mesh.welded_faces, cut)
    right = sheet.size[0] - MARGIN - PANEL
    window = np.array(((MARGIN, MARGIN), (right, sheet.size[1] - MARGIN)))
    box = window * sheet.scale / 1e3 + sheet.origin

    walls, lines = noded(segments, box), chains(segments, keys)
    shown = _add_views(sheet, found, cut, walls, box)
    sheet.add_lines("BELOW", list(sheet.to_paper(edges_below(mesh, floor, cut))))
    solids = solid(lines)
    dead_m2 = _add_dead_zones(sheet, found, views, solids)
    sheet.add_area("WALLS", solids)
    sheet.add_lines("WALLS", [sheet.to_paper(line) for line in lines])
    for name, pose in zip(names, poses.world_from_camera, strict=True):
        _add_camera(sheet, name, pose, floor, window)
    _add_marks(sheet, options.north, window)
    _add_panel(sheet, found, names, options, views, shown, dead_m2)
    return sheet


def floor_of(mesh: Mesh) -> float:
    """Height of the lowest floor: with a tenth of all area that is level and faces up, or more."""
    is_level = mesh.normals[:, 2] > LEVEL
    heights, rows = np.unique(np.round(mesh.centroids[is_level, 2], 2), return_inverse=True)
    areas = np.bincount(rows, mesh.areas[is_level], len(heights))
    low = np.asarray(mesh.bounds)[0, 2]
    return float(next(iter(heights[areas >= 0.1 * areas.sum()]), low))


def open_sheet(mesh: Mesh, poses: Poses, options: SheetOptions) -> Sheet:
    """Empty sheet with the mesh and the cameras in the middle; raises as `plan_sheet` does."""
    bottom, top = np.asarray(mesh.opaque.bounds)[:, 2].tolist()
    floor = floor_of(mesh.opaque) if options.floor is None else options.floor
    cut = floor + min(CUT, (top - floor) / 2) if options.cut is None else options.cut
    if not bottom <= cut <= top:
        raise ConfigError(
            f"the cut is at z = {cut:g} m, and the mesh from {bottom:g} to {top:g} m; "
            "give another --cut or --floor"
        )
    corners = np.concatenate((np.asarray(mesh.bounds), poses.world_from_camera[:, :3, 3]))[:, :2]
    low, high = corners.min(axis=0), corners.max(axis=0)
    check_choice("paper", options.paper, tuple(PAPERS))
    width, height = PAPERS[options.paper]
    middle = np.array((width - PANEL, height)) / 2
    room = np.array((width - PANEL, height)) - 2 * MARGIN - 2 * GAP
    least = float(((high - low) * 1e3 / room).max())
    found = re.fullmatch(r"(?:(\d{1,4}):)?(\d{1,6}(?:\.\d+)?)", options.scale.strip())
    power = 10.0 ** math.floor(math.log10(max(least, 1e-3)))
    scale = next(n * p for p in (power, 10 * power) for n in STEPS if n * p >= least)
    if options.scale != "auto":
        wanted = float(found[2]) / float(found[1] or 1) if found and int(found[1] or 1) else 0.0
        if not wanted:
            raise ConfigError(f"scale must be auto or 1:N such as 1:50, got {options.scale!r}")
        if wanted < least:
            needed = " x ".join(f"{each:.0f}" for each in (high - low) * 1e3 / wanted)
            raise ConfigError(
                f"at {scale_text(wanted)} the drawing is {needed} mm, and {options.paper} has "
                f"{room[0]:.0f} x {room[1]:.0f} mm for it; take --scale {scale_text(scale)} or "
                "larger --paper"
            )
        scale = wanted
    origin = (low + high) / 2 - middle * scale / 1e3
    return Sheet((width, height), scale, origin, (floor, cut), options.project)


def scale_text(scale: float) -> str:
    """Scale as text, such as 1:50, or 2:1 where the drawing is larger than the world."""
    return f"1:{scale:g}" if scale >= 1 else f"{1 / scale:g}:1"


def _add_views(
    sheet: Sheet, found: Evaluation, cut: float, walls: FloatArray, box: FloatArray
) -> list[str]:
    """Add the fields of view at the height of the cut, by level; the levels that are there."""
    cameras, poses, window = cameras_of(found.camera), found.poses, shapely.box(*box.ravel())
    seen: dict[str, list[Any]] = {level: [] for level in LEVELS}
    for pose, index in zip(poses.world_from_camera, poses.camera, strict=True):
        visible = visible_from(pose[:2, 3], walls).intersection(window)
        for level in LEVELS:
            view = field_of_view(cameras[index], pose, EDITIONS[EDITION][level], cut)
            seen[level].append(view.intersection(visible))
    for level in LEVELS:
        sheet.add_area(f"FOV_{level.upper()}", shapely.union_all(seen[level]))
    for view in seen[LEVELS[0]]:
        sheet.add_area("FOV", view, is_filled=False)
    return [level for level in LEVELS if any(not each.is_empty for each in seen[level])]


def _add_dead_zones(
    sheet: Sheet,
    found: Evaluation,
    views: Mapping[str, int] | None,
    solids: Any,
) -> float:
    """Hatch what is not covered of targets, and of the faces below the cut that are seen from above.

    The result is the hatched area, m^2.
    """
    mesh, heights = found.mesh, sheet.heights
    if found.areas is not None:
        zones = found.areas.zones(views)
        face, starts = zones.face.astype(np.int64), zones.starts
        corners = to_world(mesh, np.repeat(face, np.diff(starts)), zones.xy)
    else:
        face = np.flatnonzero(mesh.task_mask & ~found.network.covered)
        starts = np.arange(len(face) + 1) * 3
        corners = mesh.vertices[mesh.faces[face]].reshape(-1, 3)
    pieces, levels = _seen_from_above(mesh, face, corners, starts, heights)
    of_mesh = mesh.vertices[mesh.faces].reshape(-1, 3), np.arange(mesh.n_faces + 1) * 3
    tops, tops_level = _seen_from_above(mesh, np.arange(mesh.n_faces), *of_mesh, heights)
    zone, above = shapely.Polygon(), solids
    for level in np.unique(levels)[::-1].tolist():  # from the top; some ten
        own = shapely.union_all(pieces[levels == level], grid_size=1e-6)
        is_next = tops_level > level
        above = shapely.union_all([above, *tops[is_next]], grid_size=1e-6)
        tops, tops_level = tops[~is_next], tops_level[~is_next]
        zone = zone.union(own.difference(above))
    sheet.add_area("DEAD", zone, is_filled=False)
    for part in shapely.get_parts(shapely.transform(zone, sheet.to_paper)):
        x0, y0, x1, y1 = part.bounds
        sums = np.arange(math.ceil((x0 + y0) / HATCH), (x1 + y1) / HATCH) * HATCH
        lines = shapely.MultiLineString(
            [((x0, each - x0), (x1, each - x1)) for each in sums.tolist()]
        ).intersection(part)
        kept = [each for each in shapely.get_parts(lines) if each.geom_type == "LineString"]
        sheet.add_lines("DEAD", [shapely.get_coordinates(each) for each in kept])
    return float(zone.area)


def _seen_from_above(
    mesh: Mesh, face: Any, corners: FloatArray, starts: Any, heights: tuple[float, float]
) -> tuple[NDArray[Any], FloatArray]:
    """Polygons in plan of pieces of faces that face up between two heights, and their levels.

    Levels are `STOREY` apart; pieces of targets count at any height, on the topmost one.
    """
    if not len(face):
        return np.zeros(0, object), np.zeros(0)
    top, bottom = (ends.reduceat(corners[:, 2], starts[:-1]) for ends in (np.maximum, np.minimum))
    up, is_target = mesh.normals[face, 2], mesh.target_mask[face]
    up = np.where(mesh.two_sided_mask[face], np.abs(up), up) > FACES_UP
    rows = np.flatnonzero(up & (is_target | ((top <= heights[1]) & (bottom > heights[0] - 0.01))))
    parts = [shapely.Polygon(corners[starts[row] : starts[row + 1], :2]) for row in rows.tolist()]
    levels = np.where(is_target[rows], np.inf, np.round(top[rows] / STOREY))
    return shapely.make_valid(np.array(parts, object)), levels


def _add_camera(
    sheet: Sheet, name: str, pose: FloatArray, floor: float, window: FloatArray
) -> None:
    """Symbol of a camera, with its name and its height above the floor behind it."""
    at, ahead = sheet.to_paper(pose[:2, 3]), pose[:2, 2]
    level = float(np.linalg.norm(ahead))
    ahead = ahead / level if level > 1e-6 else np.array((0.0, 1.0))
    side = np.array((-ahead[1], ahead[0]))
    if level < LOOKS_DOWN:
        turn = np.linspace(0, 2 * math.pi, 25)[:, None]
        outlines = [1.7 * (np.cos(turn) * ahead + np.sin(turn) * side)]
    else:
        outlines = [
            np.array([x * ahead + y * side for x, y in points])
            for points in (
                ((-4.0, 1.3), (-4.0, -1.3), (-1.2, -1.3), (-1.2, 1.3), (-4.0, 1.3)),
                ((-1.2, 0.0), (0.6, 1.3), (0.6, -1.3), (-1.2, 0.0)),
            )
        ]
    for outline in outlines:
        sheet.shapes.append(Shape("CAMERAS", [at + outline], True))
    x, y = at - 5.6 * ahead
    lines = [(shortened(name, 24), TEXT, True), (f"h {signed(pose[2, 3] - floor)} m", 2.0, False)]
    wide = max(0.68 * size * len(text) for text, size, _ in lines)
    x -= wide * (0.5 if abs(ahead[0]) < 0.5 else 1.0 if ahead[0] > 0 else 0.0)
    y -= 2 * TEXT * (0.0 if ahead[1] < -0.5 else 1.0 if ahead[1] > 0.5 else 0.5)
    x, y = np.clip((x, y), window[0] + 1, window[1] - (wide + 1, 2 * TEXT + 1))
    box = ((0.0, -0.6), (wide, -0.6), (wide, 2.1 * TEXT), (0.0, 2.1 * TEXT), (0.0, -0.6))
    sheet.shapes.append(Shape("PAPER", [np.array(box) + np.array((x, y))], True))
    for row, (text, size, is_bold) in enumerate(lines):
        sheet.add_text(x + wide / 2, y + (1 - row) * 1.15 * TEXT, text, "middle", size, is_bold)


def _add_marks(sheet: Sheet, north: float | None, window: FloatArray) -> None:
    """Add the border, the axes, the arrow to the north and the scale bar."""
    (x0, y0), (x1, y1) = window
    edge = sheet.size[0] - MARGIN
    sheet.add_lines("SHEET", [((x0, y0), (edge, y0), (edge, y1), (x0, y1), (x0, y0))])
    sheet.add_lines("SHEET", [((x1, y0), (x1, y1))])

    corner = np.array((x0 + 5, y1 - 16))
    arrows = [("x", 0.0, 8.0), ("y", 90.0, 8.0)]
    for name, angle, size in arrows + ([] if north is None else [("N", north, 12.0)]):
        turn = np.array((math.cos(math.radians(angle)), math.sin(math.radians(angle))))
        start = corner if name != "N" else np.array((x0 + 29, y1 - 13)) - turn * size / 2
        tip, side = start + turn * size, np.array((-turn[1], turn[0])) * 0.8
        head = [tip - 2.2 * turn + side, tip, tip - 2.2 * turn - side]
        sheet.add_lines("SHEET", [(start, tip), head])
        x, y = tip + 2.2 * turn
        sheet.add_text(x, y - TEXT / 3, name, "middle", TEXT, name == "N")

    metre = 1e3 / sheet.scale
    power = 10.0 ** math.floor(math.log10(60 / metre))
    length = max(n * power for n in (1, 2, 5) if n * power * metre <= 60)
    x, y = x0 + 5, y0 + 5
    for part in range(5):
        ends = x + np.array((part, part + 1)) * length * metre / 5
        band = [(ends[0], y), (ends[1], y), (ends[1], y + 1.5), (ends[0], y + 1.5), (ends[0], y)]
        sheet.shapes.append(Shape("SHEET", [np.array(band)]))
        if part % 2 == 0:
            sheet.shapes.append(Shape("CAMERAS", [np.array(band)], True))
    for share in (0, 1):
        text = "0" if share == 0 else f"{length:g} m"
        sheet.add_text(x + share * length * metre, y + 2.6, text, "middle", 0.9 * TEXT)


def _add_panel(
    sheet: Sheet,
    found: Evaluation,
    names: Sequence[str],
    options: SheetOptions,
    views: Mapping[str, int] | None,
    levels: Sequence[str],
    dead_m2: float,
) -> None:
    """Add the camera table, the legend and the title block, from the bottom up."""
    floor, cut = sheet.heights
    if found.areas is not None:
        share = in_words(found.areas.summary(views))
    else:
        whole = found.network.summary()["covered"]["area_percent"] / 100
        share = f"{percent(whole)} of the area, by whole faces"
    meshes = ", ".join(source.name for source in found.mesh.sources) or "arrays"
    x0, x1 = sheet.size[0] - MARGIN - PANEL, sheet.size[0] - MARGIN
    block = [
        ("Mesh", shortened(meshes, 60)),
        ("Covered", share),
        ("Wanted", shortened(wanted_text(found.task, views), 80)),
        ("Cameras", plural(len(names), "camera")),
        ("Heights", f"floor at z = {floor:.2f} m, cut at z = {cut:.2f} m"),
        ("Scale", f"{scale_text(sheet.scale)} on {options.paper}, lengths in metres"),
        ("Date", options.date or datetime.date.today().isoformat()),
        ("Made by", f"rastercov {version('rastercov')}"),
    ]
    y = MARGIN + 3
    for head, text in reversed(block):
        sheet.add_text(x0 + 4, y, head, "start", 0.8 * TEXT)
        sheet.add_text(x0 + 22, y, text)
        y += LINE
    sheet.add_text(x0 + 4, y + 1.5, shortened(sheet.title, 44), "start", 1.8 * TEXT, True)
    y += 4 * TEXT
    sheet.add_lines("SHEET", [((x0, y), (x1, y))])

    entries = [
        ("WALLS", f"walls, cut at z = {cut:.2f} m; grey: solid"),
        ("BELOW", "edges between the floor and the cut"),
        *[
            (f"FOV_{level.upper()}", f"{level}: {EDITIONS[EDITION][level]:g} px/m or more")
            for level in reversed(levels)
        ],
        ("FOV", f"view of a camera at the cut, {LEVELS[0]} or better; walls there hide"),
        ("DEAD", f"not covered, as seen from above: {area(dead_m2)} in plan"),
    ]
    y += 3
    for text in (
        "I / R / O / D: depths to which a camera identifies, recognises, observes, detects, m",
        f"Levels of {EDITION}, of a target that faces the camera; white: none, or hidden",
    ):
        sheet.add_text(x0 + 4, y, text, size=0.8 * TEXT)
        y += 0.8 * LINE
    y += 0.3 * LINE
    for layer, text in reversed(entries):
        sheet.shapes.append(_swatch(layer, x0 + 4, y))
        sheet.add_text(x0 + 15, y, text)
        y += LINE
    sheet.add_lines("SHEET", [((x0, y), (x1, y))])

    top = sheet.size[1] - MARGIN - 5
    rows = [[head for head, _, _ in COLUMNS], *_camera_rows(found, names, floor)]
    most = int((top - y) / LINE)
    if len(rows) > most:
        more = len(rows) - most + 1
        rows = [*rows[: most - 1], [f"... {more} more"]]
    for row, cells in enumerate(rows):
        for (_, x, anchor), text in zip(COLUMNS, cells, strict=False):
            sheet.add_text(x0 + 2 + x, top - row * LINE, text, anchor, 0.92 * TEXT, row == 0)
    sheet.add_lines("SHEET", [((x0, top - 1.3), (x1, top - 1.3))])


def _swatch(layer: str, x: float, y: float) -> Shape:
    """Sample of a layer in the legend."""
    at = np.array((x, y - 0.4))
    box = at + np.array([(0, 0), (8, 0), (8, 2.4), (0, 2.4), (0, 0)])
    if layer == "DEAD":
        return Shape(layer, [box, *(at + np.array([(n, 2.4), (n + 2.4, 0)]) for n in (0, 2, 4))])
    if layer in ("BELOW", "FOV"):
        return Shape(layer, [box[:2] + np.array((0, 1.2))])
    return Shape(layer, [box], True)


def _camera_rows(found: Evaluation, names: Sequence[str], floor: float) -> list[list[str]]:
    """Cells of the camera table under `COLUMNS`."""
    cameras, rows = cameras_of(found.camera), []
    for name, pose, index in zip(
        names, found.poses.world_from_camera, found.poses.camera, strict=True
    ):
        camera, place = cameras[index], pose[:3, 3].tolist()
        heading, tilt = heading_and_tilt(pose)
        reach = [min(camera.fx, camera.fy) / EDITIONS[EDITION][level] for level in LEVELS[::-1]]
        rows.append(
            [
                shortened(name, 16), signed(place[0]), signed(place[1]), signed(place[2] - floor),
                f"{signed(heading, 0)}\N{DEGREE SIGN}", f"{signed(tilt, 0)}\N{DEGREE SIGN}",
                lens_text(camera), f"{signed(horizontal_view(camera), 0)}\N{DEGREE SIGN}",
                " / ".join(signed(each, 0 if each >= 9.95 else 1) for each in reach),
            ]
        )  # fmt: skip
    return rows


def wanted_text(task: Task, views: Mapping[str, int] | None = None) -> str:
    """Thresholds of a task that are not the usual ones, and the cameras that groups need."""
    usual, own = asdict(Task()), asdict(task)
    texts = [
        f"{name.replace('_', ' ')} {value:g}" if isinstance(value, float) else f"{name} {value}"
        for name, value in own.items()
        if value != usual[name] and not (name == "views" and views)
    ]
    texts += [f"{plural(n, 'camera')} for {group}" for group, n in (views or {}).items()]
    return ", ".join(texts) or "seen by a camera"


def lens_text(camera: Camera) -> str:
    """Focal length and f-number of a camera; in pixels where metres are not known."""
    if camera.focal_length is None:
        return f"f {min(camera.fx, camera.fy):.0f} px"
    text = f"{1e3 * camera.focal_length:.3g} mm"
    if camera.aperture is not None:
        text += f" f/{camera.focal_length / camera.aperture:.2g}"
    return text


def horizontal_view(camera: Camera) -> float:
    """Angle between the rays in the middle of the left and the right side of the image, degrees."""
    border = view_border(camera, 2)
    rays = border[[3, 7]] / np.linalg.norm(border[[3, 7]], axis=1, keepdims=True)
    angles = np.arctan2(rays[:, 0], rays[:, 2])  # right, then left
    return math.degrees(float(angles[0] - angles[1]))
