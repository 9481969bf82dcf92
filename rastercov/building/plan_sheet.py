"""Plan sheet of a building: walls cut at a height, cameras and what they see, to scale on paper.

The sheet is an SVG in millimetres, made by the template `plan_sheet.svg`; PDF by fpdf2 and DXF by
ezdxf are made of that, so that all three show the same.

EN 62676-4. Video surveillance systems for use in security applications - Part 4: Application
guidelines. 2015.
"""

import datetime
import io
import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import chain, islice
from pathlib import Path
from textwrap import wrap
from types import MappingProxyType
from typing import Any
from xml.etree import ElementTree

import numpy as np
import shapely

import rastercov
from rastercov.base import (
    ByName,
    ConfigError,
    FloatArray,
    IntArray,
    check_choice,
    check_place,
    norm,
    owners_of,
    percent,
    plural,
    shorten,
    shown,
    sort_order,
    write_bytes,
)
from rastercov.base.format import area, text_with_sign
from rastercov.core.area.advice import task_in_words
from rastercov.core.area.feature import in_words
from rastercov.core.area.polygons import to_world
from rastercov.core.area.zones import face_zones
from rastercov.core.camera import (
    KEPT,
    Cameras,
    Poses,
    cameras_of,
    equipment_words,
    gates_of,
    heads_of,
    names_of,
)
from rastercov.core.coverage.evaluation import Evaluation
from rastercov.core.coverage.task import DORI, DORI_EDITION
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.sections import polygons_in, section, solid
from rastercov.placement.plan.check import Checked, PlacedCameras, best_change
from rastercov.placement.plan.network import classify_areas
from rastercov.report.drawing import (
    GAP,
    MARGIN,
    PANEL,
    PAPERS,
    SheetDevice,
    SheetFrame,
    crowding,
    devices_of,
    scale_bar,
)
from rastercov.report.pages import render
from rastercov.report.plan_geometry import (
    distances_to_walls,
    edges_between,
    is_foliage,
    plan_lines,
    scene_of_plan,
    views_on_plan,
)
from rastercov.report.tables import camera_words, mounting_angles
from rastercov.report.theme import DORI as BANDS
from rastercov.shards import Progress, silent

STEPS = (1.0, 2.0, 2.5, 5.0)
"""Scales that are taken unless one is given: 1 to these times a power of ten."""
INK = "#14181d"
"""Colour of cameras, walls and text in the template."""
LEVELS = tuple(reversed(DORI))
"""Levels that have a band, the nearest first."""
N_LAYERS = 1 + len(LEVELS)
"""Layers that take time: dead zones, and what is seen at each level."""
TITLE = ("customer", "plan", "author", "revision", "date")
"""Entries of the title block, besides the project."""
MARKS = {
    "SPACES": ("#1a7f37", "permitted camera positions"),
    "KEEP_OUT": ("#c45500", "keep-out volume"),
    "IR": ("#7a3db8", "range of infrared lamps, as stated by the maker"),
    "PRIVATE": ("#00798c", "must not be seen"),
    "GOALS": ("#b8172a", "goals: uncovered, or visible where it must not be seen"),
    "KEPT": (INK, "camera that is kept"),
}
"""Layers that the legend names where there is something in them, with their colours and words."""
OF_DEVICES = "#946200"
"""Colour of equipment."""
NOTHING = "M0,0"
"""Path of nothing: fpdf2 refuses an empty one."""
LETTERS = 84
"""In a line of the title block."""
LEAST_DIMENSION = 3.0
"""Length of a dimension line at least, mm."""
LINE = 4.2
"""Distance of the lines of tables, mm."""
MOST_MEASURED = 24
"""Cameras up to which a sheet has distances to walls."""
ASCENT, DESCENT, TWO_LINES = 2.4, 0.8, 3.9
"""Room of a label above and below its line, and with a second one, mm."""
AROUND = np.radians(np.arange(0, 360, 22.5))
WAYS = np.concatenate(
    [[(0, 0)], *(n * np.stack((np.cos(AROUND), np.sin(AROUND)), axis=1) for n in range(1, 90))]
)
"""Ways from the place of a label that are tried, the shortest first, mm."""
HATCH = 1.6
"""Distance of the lines of a hatching, mm."""
CUT = 1.2
"""Height of the cut above the floor, m; half of the building where that is lower than twice it."""
LEVEL, FACES_UP = 0.999, 0.1
"""Least z of the normal of a face of a floor, and of one whose dead zones are drawn."""
SYMBOL = ((-4, 1.3), (-4, -1.3), (-1.2, -1.3), (-1.2, -0.4), (0.6, -1.3), (0.6, 1.3), (-1.2, 0.4))
"""Symbol of a camera that looks to the right, mm."""


@dataclass(frozen=True)
class SheetSite:
    """Things that a plan sheet shows besides meshes and cameras, in metres.

    Attributes
    ----------
    rooms : sequence of (str, str, polygon)
        Name, number and outline of each room at the cut.
    spaces : (N, 2, 3) float64
        Boxes that may hold cameras.
    keep_out : sequence of mapping
        Volumes without cameras: name, and box, or centre and radius.
    north : float, optional
        Direction of north, degrees counter-clockwise from +x.
    required : mapping of group name or None to share
        Required shares of groups, and of the whole task.
    """

    rooms: Sequence[tuple[str, str, Any]] = ()
    spaces: FloatArray = field(default_factory=lambda: np.empty((0, 2, 3)))
    keep_out: Sequence[Mapping[str, Any]] = ()
    north: float | None = None
    required: Mapping[str | None, float] = field(default_factory=dict)


def frame_of(
    mesh: Mesh,
    poses: Poses,
    paper: str = "A3",
    scale: str = "auto",
    floor: float | None = None,
    cut: float | None = None,
) -> SheetFrame:
    """Paper with what is planned in the middle of its window; see `plan_geometry.plan_lines`.

    `scale` is auto or 1:N; the floor is that of `floor_of`, and the cut `CUT` above it, unless
    given.

    Raises
    ------
    ConfigError
        For an unknown paper or scale, one at which the drawing does not fit, and a cut beyond the
        mesh.
    """
    bottom, top = np.asarray(mesh.opaque.bounds)[:, 2].tolist()
    option, given = ("--floor", floor) if cut is None else ("--cut", cut)
    floor = floor_of(mesh.opaque) if floor is None else floor
    cut = floor + min(CUT, (top - floor) / 2) if cut is None else cut
    if not bottom <= cut <= top:
        raise ConfigError(
            f"{option}: expected a height within the mesh, {bottom:g} to {top:g} m, got {given:g}"
        )
    low, high = plan_lines(mesh, poses, cut)
    check_choice("paper", paper, tuple(PAPERS))
    window = np.array(PAPERS[paper]) - (PANEL, 0)
    least = max(float(((high - low) * 1e3 / (window - 2 * MARGIN - 2 * GAP)).max()), 1e-3)
    power = 10.0 ** math.floor(math.log10(least))
    item = next(n * p for p in (power, 10 * power) for n in STEPS if n * p >= least)
    if scale != "auto":
        match = re.fullmatch(r"1:(\d{1,6}(?:\.\d+)?)", scale.strip())
        if match is None or not float(match[1]):
            raise ConfigError(f"--scale: expected auto or 1:N, got {shown(scale)}; write 1:50")
        if not float(match[1]) >= least:
            raise ConfigError(
                f"expected a drawing that fits {paper}, got a larger one at {scale}; use --scale "
                f"{scale_text(item)}, or a larger --paper"
            )
        item = float(match[1])
    corner = (low + high) / 2 + window * (-0.5, 0.5) * item / 1e3
    return SheetFrame(paper, item, corner, floor, cut)


def floor_of(mesh: Mesh) -> float:
    """Height of the lowest floor: with a tenth of all area that is level and faces up, or more."""
    level = mesh.normals[:, 2] > LEVEL
    heights, rows = np.unique(np.round(mesh.centroids[level, 2], 2), return_inverse=True)
    areas = np.bincount(rows, mesh.areas[level], len(heights))
    bottom, top = np.asarray(mesh.bounds)[:, 2].tolist()
    lowest = next(iter(heights[areas >= 0.1 * areas.sum()]), bottom)
    return min(max(float(lowest), bottom), top)  # which the rounding may leave


def plan_sheet(
    evaluation: Evaluation,
    names: Sequence[str],
    frame: SheetFrame,
    title: Mapping[str, str],
    site: SheetSite,
    views: Mapping[str, int] | None = None,
    progress: Progress = silent,
    goals: Mapping[str, Checked] = MappingProxyType({}),
) -> str:
    """Plan of what an evaluation is of, with its cameras, what they see, and dead zones; SVG.

    Parameters
    ----------
    evaluation : Evaluation
        Mesh, cameras and result.
    names : sequence of str
        Name of each pose.
    frame : Frame
        Paper, from `frame_of`.
    title : mapping of str to str
        Title block: "project", and those of `TITLE`; the date is today unless given.
    site : Site
    views : mapping of str to int, optional
        Cameras that faces of a group need, 1 for the others; those of the task unless given.
    progress : callable
        Called with the layers done and their total.
    goals : mapping of str to Checked
        Goals of the plan, with their requirements.
    """
    progress(0, N_LAYERS)
    own = evaluation.camera, evaluation.poses, evaluation.task
    rows, names, noun = heads_of(evaluation.camera, evaluation.poses, names)
    shown = evaluation.poses[rows]
    mesh, (width, height) = evaluation.mesh.opaque, PAPERS[frame.paper]
    walls = section(mesh.vertices, mesh.welded_faces[~is_foliage(mesh)], frame.cut)
    solids = solid(walls)
    zone = _dead_zone(evaluation, frame, views).difference(solids)
    progress(1, N_LAYERS)
    volumes = [_volume(each, frame) for each in site.keep_out]
    paths = _paths(evaluation, frame, walls, solids, progress)
    paths["DEAD"] = frame.path(zone) + frame.path(_hatching(zone, HATCH * frame.scale / 1e3))
    spaces = shapely.union_all(_flat(site.spaces, frame))
    paths["SPACES"] = frame.path(spaces)
    paths["KEEP_OUT"] = "".join(frame.path(v) + frame.path(_cross(v)) for v in volumes)
    private, marked = _private(goals), [_goal_mark(own) for own in goals.values()]
    paths["GOALS"] = frame.path(shapely.union_all(marked))
    paths["PRIVATE"] = frame.path(shapely.union_all([*private.values()]))
    devices = list(islice(devices_of(*own), MOST_MEASURED))
    rooms, dimensions = _room_labels(site.rooms, frame), _dimensions(shown, frame, walls)
    entries, layers = _symbols(shown, names, frame), _layers(devices, frame)
    zones = _zone_labels(private, volumes, site, frame)
    lines = [shapely.multilinestrings(shapely.linestrings(walls)), *marked, *private.values()]
    lines += [each.pop("outline") for each in entries]
    lines += [each.boundary for each in (spaces, *volumes)]
    every = [*dimensions, *rooms, *entries, *zones, *chain.from_iterable(layers.values())]
    _keep_clear(every, frame, lines)
    paths["KEPT"] = "".join(each["symbol"] for each in entries if each["is_kept"])
    paths = {name: path or NOTHING for name, path in paths.items()}
    marks = {name: own for name, own in MARKS.items() if paths[name] != NOTHING}
    marks |= {kind.upper(): (OF_DEVICES, kind.removesuffix("s")) for kind, _ in devices}
    turn = None if site.north is None else math.radians(site.north)
    return render(
        "plan_sheet.svg",
        "rastercov.building",
        width=width,
        height=height,
        panel_width=PANEL,
        line=LINE,
        cut=frame.cut,
        paths=paths,
        table=_tables(evaluation.camera, shown, names, frame, site.north, devices),
        noun=noun,
        cameras=entries,
        rooms=rooms,
        layers=layers,
        dimensions=dimensions,
        keep_out=zones,
        marks=marks,
        device_colour=OF_DEVICES,
        convention=_convention(site.north),
        north=None if turn is None else (math.cos(turn), -math.sin(turn)),
        bar=scale_bar(frame),
        dead=area(zone.area),
        targets=evaluation.mesh.target_mask.any(),
        edition=DORI_EDITION,
        levels=[(level, DORI[level]) for level in LEVELS],
        bands=[(level.upper(), f"#{bytes(colour).hex()}") for level, colour in BANDS.items()],
        title_rows=_title_rows(
            evaluation, frame, title, views, _answer_rows(evaluation, site.required, views, goals)
        ),
        project=shorten(title["project"], 44),
    )


def _zone_labels(
    private: Mapping[str, shapely.Geometry],
    volumes: Sequence[shapely.Geometry],
    site: SheetSite,
    frame: SheetFrame,
) -> list[ByName]:
    """Names of what must not be seen, and of volumes without cameras, in their places."""
    return [
        *(_label(v.centroid, name, frame, above=1.8) for name, v in private.items()),
        *(
            _label(shapely.point_on_surface(part), each["name"] or "keep-out", frame)
            for v, each in zip(volumes, site.keep_out, strict=True)
            for part in _widest(v, frame)
        ),
    ]


def _layers(devices: Sequence[tuple[str, SheetDevice]], frame: SheetFrame) -> dict[str, list[Any]]:
    """Names of devices in their places, by layer."""
    return {
        word.upper(): [
            _label(shapely.Point(each.pose[:2, 3]), shorten(each.name, 24), frame, above=-4.2)
            | {"at": frame.on_paper(each.pose[:2, 3]).tolist()}
            for kind, each in devices
            if kind == word and each.has_position and frame.holds(each.pose[:2, 3])
        ]
        for word in equipment_words()
    }


def _paths(
    evaluation: Evaluation,
    frame: SheetFrame,
    walls: FloatArray,
    solids: shapely.Geometry,
    progress: Progress,
) -> dict[str, str]:
    """Paths of what is there, and of what cameras see, by layer."""
    mesh = evaluation.mesh.opaque
    segments = section(mesh.vertices, mesh.welded_faces, frame.cut)
    scene, seen = scene_of_plan(segments, frame.box, frame.cut, evaluation.poses), {}
    for row, level in enumerate(LEVELS):
        cameras = cameras_of(evaluation.camera)
        seen[level] = views_on_plan(scene, cameras, evaluation.poses, DORI[level])
        progress(2 + row, N_LAYERS)
    paths = {level.upper(): frame.path(shapely.union_all(seen[level])) for level in LEVELS}
    lines = shapely.line_merge(shapely.multilinestrings(shapely.linestrings(walls))).simplify(0)
    below = edges_between(mesh, ~is_foliage(mesh), frame.floor - 0.01, frame.cut)
    return paths | {
        "FOV": "".join(map(frame.path, seen["detect"])),
        "IR": _reach(evaluation, frame, seen),
        "WALLS": frame.path(lines),
        "SOLID": frame.path(solids),
        "BELOW": frame.path(shapely.multilinestrings(shapely.linestrings(below))),
    }


def _title_rows(
    evaluation: Evaluation,
    frame: SheetFrame,
    title: Mapping[str, str],
    views: Mapping[str, int] | None,
    answers: Sequence[tuple[str, str]],
) -> list[tuple[str, str]]:
    """Headings and words of the title block, with rows of `_answer_rows`."""
    mesh = evaluation.mesh.opaque
    whole = percent(evaluation.network.summary()["covered"]["area_percent"] / 100)
    words = f"{whole} of the area, by whole faces"
    names = names_of(evaluation.camera)
    rules = [g.in_words(names[at : at + g.n]) for at, g in gates_of(evaluation.camera).items()]
    by_face = evaluation.areas is None
    asked = task_in_words(asdict(evaluation.task), views, by_face=by_face, is_joint=bool(rules))
    task = wrap(" ".join((asked, *rules)), LETTERS)
    storeys = dict.fromkeys(
        product.storey
        for product, inside in evaluation.mesh.spaces
        if inside.bounds[0, 2] <= frame.cut < inside.bounds[1, 2] and product.storey
    )
    storey = "".join(f"{each}, " for each in storeys)
    own = {"date": datetime.date.today().isoformat(), **title}
    return [
        *((name.capitalize(), shorten(own[name], LETTERS - 6)) for name in TITLE if own.get(name)),
        ("Mesh", shorten(", ".join(each.name for each in mesh.sources or mesh.groups), 60)),
        (
            "Covered",
            words if evaluation.areas is None else in_words(evaluation.areas.summary(views)),
        ),
        *answers,
        *(("" if row else "Task", line) for row, line in enumerate(task)),
        ("Heights", f"{storey}floor at z = {frame.floor:.2f} m, cut at z = {frame.cut:.2f} m"),
        ("Scale", f"{scale_text(frame.scale)} on {frame.paper}, lengths in metres"),
        ("Software", f"rastercov {rastercov.__version__}"),
    ]


def _answer_rows(
    evaluation: Evaluation,
    limits: Mapping[str | None, float],
    views: Mapping[str, int] | None,
    goals: Mapping[str, Checked],
) -> list[tuple[str, str]]:
    """Rows of the title block on the best change known, and on what is required.

    Of what must not be seen, with those who see it.
    """
    of_goals = {own.requirements[0]: own for own in goals.values()}
    required, zones = [*of_goals], dict[str, Any]()
    if (areas := evaluation.areas) is not None:
        required = [*classify_areas(areas, limits, views or evaluation.task.views), *required]
        if any(each.lack for each in required if not each.goal):
            areas.allowed = areas.allowed._replace(adds_only=bool(goals))
            zones = areas.dead_zones(evaluation.camera, evaluation.poses, views)
    placed = PlacedCameras(
        evaluation.mesh,
        evaluation.camera,
        evaluation.poses,
        evaluation.task,
        views or evaluation.task.views,
    )
    best = best_change(required, goals, placed, zones)
    said = [] if best is None else [("Change", best.line.removeprefix("change "))]
    for each in required:
        words = [f"{each.status}: {each.words()}"]
        if (own := of_goals.get(each)) is not None:
            by_group = own.views if isinstance(own.views, Mapping) else None
            rule = task_in_words(asdict(own.task), by_group).partition(" is ")[2].rstrip(".")
            words += [rule, *own.zone_lines(each)[:1], *own.lost_lines(each)]
        said.append(("Goal", "; ".join(words)))
    return [
        ("" if row else head, line)
        for head, words in said
        for row, line in enumerate(wrap(words, LETTERS))
    ]


def _goal_mark(own: Checked) -> shapely.Geometry:
    """Outlines on the plan of what a goal lacks, or of what is seen and must not be."""
    if (areas := own.cameras.areas) is None:
        return shapely.GeometryCollection()
    parts = areas.covered if own.requirements[0].is_most else own.zones
    corner_of = owners_of(np.diff(parts.starts))
    return _outlines(
        to_world(own.mesh, parts.face[corner_of].astype(np.int64), parts.xy), corner_of
    )


def _private(goals: Mapping[str, Checked]) -> dict[str, shapely.Geometry]:
    """Outlines on the plan of what must not be seen, by words on who sees it."""
    shapes = {}
    for own in goals.values():
        (each,), mesh = own.requirements, own.mesh
        if each.is_most:
            corners = mesh.vertices[mesh.faces[mesh.task_mask]]
            corner_of = np.repeat(np.arange(len(corners)), 3)
            words = f"{each.goal}: {own.zone_lines(each)[0]}"
            shapes[words] = _outlines(corners.reshape(-1, 3), corner_of)
    return shapes


def _outlines(corners: FloatArray, corner_of: IntArray) -> shapely.Geometry:
    """Parts (N, 3) of faces on the plan, by the part of each corner; of an upright one a line."""
    points = shapely.multipoints(shapely.points(corners[:, :2]), indices=corner_of)
    return shapely.union_all(shapely.convex_hull(points), grid_size=1e-6)


def scale_text(scale: float) -> str:
    """Scale as text, such as 1:50, or 2:1 where the drawing is larger than the world."""
    return f"1:{scale:g}" if scale >= 1 else f"{1 / scale:g}:1"


def _reach(evaluation: Evaluation, frame: SheetFrame, seen: Mapping[str, Sequence[Any]]) -> str:
    """Path of the reach of infrared lamps of cameras, in what these see."""
    cameras, path = cameras_of(evaluation.camera), ""
    for pose, index, area_seen in zip(
        evaluation.poses.world_from_camera, evaluation.poses.camera, seen["detect"], strict=True
    ):
        if (reach := cameras[index].ir_range) is not None:
            around = shapely.Point(pose[:2, 3]).buffer(reach, quad_segs=32)
            path += frame.path(around.boundary.intersection(area_seen))
    return path


def _flat(boxes: FloatArray, frame: SheetFrame) -> Any:
    """Boxes in plan; one that is flat in plan is as wide as its line on the paper."""
    low, high = np.moveaxis(np.asarray(boxes)[..., :2], -2, 0)
    pad = np.where(high - low < 1e-3, _pen(frame), 0.0)
    return shapely.box(*(low - pad).T, *(high + pad).T)


def _pen(frame: SheetFrame) -> float:
    """Width of a line on the paper, m in the world."""
    return 0.25 * frame.scale / 1e3


def _volume(entry: Mapping[str, Any], frame: SheetFrame) -> Any:
    """A keep-out volume in plan."""
    if "box" in entry:
        return _flat(np.array(entry["box"]), frame)
    return shapely.Point(entry["centre"][:2]).buffer(max(entry["radius"], _pen(frame)))


def _cross(shape: shapely.Geometry) -> shapely.Geometry:
    """Diagonals of the box around a shape, within it."""
    x0, y0, x1, y1 = shape.bounds
    return shape.intersection(shapely.MultiLineString([((x0, y0), (x1, y1)), ((x0, y1), (x1, y0))]))


def _label(point: shapely.Point, text: str, frame: SheetFrame, above: float = 0.0) -> ByName:
    """A text in the middle of a point of the world, or above it, mm."""
    x, y = frame.on_paper(shapely.get_coordinates(point)[0]).tolist()
    return {"x": x, "y": y - above, "half": _half(text), "name": text}


def _half(text: str) -> float:
    """Half of the width of a label, mm."""
    return 0.5 + 0.85 * max(len(text), 6)


def _keep_clear(
    entries: Sequence[ByName], frame: SheetFrame, lines: Sequence[shapely.Geometry]
) -> None:
    """Move labels, in turn, the least way in the window off each other and lines of the world.

    Those on a line of their own stay along it: `ways` are from their places, mm.
    """
    (left, bottom), (right, top) = frame.ends.tolist()
    parts = shapely.get_parts(shapely.get_parts(lines))
    tree, taken = shapely.STRtree(shapely.transform(parts, frame.on_paper)), np.empty((0, 4))
    for each in entries:
        half = min(each["half"], (right - left) / 2)
        start = 0 if each.get("anchor") == "start" else -half
        reach = np.array((start, -ASCENT, start + 2 * half, each.get("below", DESCENT)))
        at = np.array((each["x"], each["y"])) + each.pop("ways", WAYS)
        low, high = (left, top) - reach[:2], (right, bottom) - reach[2:]
        at = np.clip(at, low, high)
        boxes = np.tile(at, 2) + reach
        best = np.lexsort(crowding(boxes, taken, tree)[::-1])[0]
        (each["x"], each["y"]), taken = at[best].tolist(), np.vstack((taken, boxes[best]))


def _room_labels(rooms: Sequence[tuple[str, str, Any]], frame: SheetFrame) -> list[ByName]:
    """Name and number of each room that the drawing has, in its widest place."""
    return [
        _label(shapely.get_point(circle, 0), shorten(name, 24), frame)
        | {"number": shorten(number, 24), "below": TWO_LINES if number else DESCENT}
        for name, number, outline in rooms
        for circle in shapely.maximum_inscribed_circle(_widest(outline, frame), tolerance=0.05)
    ]


def _widest(shape: shapely.Geometry, frame: SheetFrame) -> Any:
    """(1,) or (0,) widest part of an area that is in the drawing."""
    parts = polygons_in(shapely.intersection(shape, shapely.box(*frame.box.ravel())))
    return parts[sort_order(-shapely.area(parts))[:1]]


def _dimensions(poses: Poses, frame: SheetFrame, walls: FloatArray) -> list[ByName]:
    """Lines from cameras to walls, along the nearest of these and across, with their lengths."""
    entries = []
    for at in poses.world_from_camera[:MOST_MEASURED, :2, 3]:
        for ends in distances_to_walls(walls, at) if len(poses) <= MOST_MEASURED else ():
            (x0, y0), (x1, y1) = frame.on_paper(ends).tolist()
            size = math.hypot(x1 - x0, y1 - y0)
            if size < LEAST_DIMENSION or not frame.holds(ends):
                continue
            tick = 0.7 * np.array((x1 - x0 - (y1 - y0), y1 - y0 + (x1 - x0))) / size
            middle = np.array((x0 + x1, y0 + y1)) / 2
            is_level = abs(x1 - x0) >= abs(y1 - y0)
            along = np.array((x1 - x0, y1 - y0))
            entries.append(
                {
                    "ticks": [(end, tick.tolist()) for end in ((x0, y0), (x1, y1))],
                    "x": middle[0] + (0 if is_level else 0.7),
                    "y": middle[1] - 0.6 if is_level else middle[1] + 0.7,
                    "half": 2.5,
                    "ways": np.array([[0], [0.2], [-0.2], [0.35], [-0.35]]) * along,
                    "anchor": "middle" if is_level else "start",
                    "text": text_with_sign(float(norm(ends[1] - ends[0]))),
                }
            )
    return entries


def _dead_zone(evaluation: Evaluation, frame: SheetFrame, views: Mapping[str, int] | None) -> Any:
    """Uncovered parts of targets, and of faces that face up from the floor to the cut."""
    mesh, network = evaluation.mesh, evaluation.network
    if evaluation.areas is not None:
        zones = evaluation.areas.zones(evaluation.camera, evaluation.poses, views)
    else:
        is_left = mesh.task_mask & ~network.covered
        zones = face_zones(mesh, is_left - 1, network.views, network.views)
    face, first = zones.face.astype(np.int64), zones.starts[:-1]
    corner_of = owners_of(np.diff(zones.starts))
    corners = to_world(mesh, face[corner_of], zones.xy)
    height = corners[:, 2]
    up = np.where(mesh.two_sided_mask[face], abs(mesh.normals[face, 2]), mesh.normals[face, 2])
    is_shown = mesh.target_mask[face] & (up > FACES_UP)
    if len(face):
        is_low = np.minimum.reduceat(height, first) > frame.floor - 0.01
        is_low &= np.maximum.reduceat(height, first) <= frame.cut
        is_shown |= is_low & (up > FACES_UP)
    parts = shapely.polygons(shapely.linearrings(corners[:, :2], indices=corner_of))
    return shapely.union_all(shapely.make_valid(parts[is_shown]), grid_size=1e-6)


def _hatching(zone: shapely.Geometry, step: float) -> shapely.Geometry:
    """Lines of a hatching within an area of the world, at 45 degrees, a step apart."""
    if zone.is_empty:
        return zone
    x0, y0, x1, y1 = zone.bounds
    sums = np.arange(math.ceil((x0 + y0) / step), (x1 + y1) / step)[:, None] * step
    lines = shapely.linestrings((x0, x1), sums - (x0, x1))  # none, where the zone is small
    return shapely.multilinestrings(lines).intersection(zone)


def _symbols(poses: Poses, names: Sequence[str], frame: SheetFrame) -> list[ByName]:
    """Path of each camera, and its name and height, behind it."""
    entries: list[ByName] = []
    for name, pose in zip(names, poses.world_from_camera, strict=True):
        at, turn = pose[:2, 3], math.radians(mounting_angles(pose)[0])
        ahead = np.array((math.cos(turn), math.sin(turn)))
        outline = at + SYMBOL @ np.array((ahead, (-ahead[1], ahead[0]))) * frame.scale / 1e3
        symbol, text = shapely.Polygon(outline), shorten(name, 24)
        x, y = frame.on_paper(at) + ahead * (-5.5 - _half(text), 8.0)
        entry: ByName = {"x": x, "y": y, "half": _half(text), "name": text, "below": TWO_LINES}
        entry |= {"outline": symbol, "symbol": frame.path(symbol), "is_kept": name.endswith(KEPT)}
        entries.append(entry | {"height": f"h {text_with_sign(pose[2, 3] - frame.floor)} m"})
    return entries


def _convention(north: float | None) -> ByName:
    """Directions of the drawing of heading and tilt, from where they begin to a camera."""
    begin = math.radians(north or 0.0)
    turns = begin + np.linspace(0, math.radians(40 if north is None else -50), 9)
    tilts = np.linspace(0, math.radians(35), 7)
    return {
        "heading": np.stack((np.cos(turns), -np.sin(turns)), axis=1).tolist(),
        "tilt": np.stack((np.cos(tilts), np.sin(tilts)), axis=1).tolist(),
        "from": "x" if north is None else "N",
    }


def _tables(
    camera: Cameras,
    poses: Poses,
    names: Sequence[str],
    frame: SheetFrame,
    north: float | None,
    devices: Sequence[tuple[str, SheetDevice]],
) -> tuple[list[list[str]], list[tuple[str, Sequence[str]]]]:
    """Rows of the table of cameras by their names, and of their types and of devices, by a style.

    Of heads, with each sensor of a type.
    """
    cameras, base, gates = cameras_of(camera), np.array((0, 0, frame.floor)), gates_of(camera)
    kinds = {
        index: chr(65 + row % 26) + "'" * (row // 26)
        for row, index in enumerate(dict.fromkeys(poses.camera.tolist()))
    }

    def row_of(name: str, kind: str, pose: FloatArray, *, has_position: bool = True) -> list[str]:
        at = [text_with_sign(each, 3) for each in (pose[:3, 3] - base).tolist()]
        angles = [f"{text_with_sign(each, 1)}°" for each in mounting_angles(pose, north)]
        return [shorten(name, 20), kind, *(at if has_position else [""] * 3), *angles]

    of_types = [kinds[index] for index in poses.camera.tolist()]
    lines = list(map(row_of, names, of_types, poses.world_from_camera))
    others = list[tuple[str, Sequence[str]]]()
    sensors = [
        (row, kind * (row == index))
        for index, kind in kinds.items()
        for row in range(index, index + (gates[index].n if index in gates else 1))
    ]
    for index, kind in sensors:
        own = cameras[index]
        name = own.product or (names_of(camera)[index] if cameras[1:] else "camera")
        reach = [min(own.fx, own.fy) / DORI[level] for level in LEVELS]
        depths = " / ".join(text_with_sign(each, 0 if each >= 9.95 else 1) for each in reach)
        ir = "" if own.ir_range is None else f", IR {own.ir_range:g} m"
        words = f"{camera_words(replace(own, product=''))}, I / R / O / D {depths} m{ir}"
        others += [("type", (kind, shorten(name, 72))), ("words", (words,))]
    riding = Counter[tuple[str, str, str]]()
    for kind, each in devices:
        word = kind.removesuffix("s")
        if each.rides:
            riding[each.name, f"{word} on", each.words] += 1
        else:
            line = row_of(each.name, word, each.pose, has_position=each.has_position)
            others += [("place", line), ("words", (each.words,))]
    for (name, on, words), count in riding.items():
        others.append(("place", (shorten(name, 20), f"{on} {plural(count, 'camera')}, {words}")))
    return lines, others


def check_sheet_name(path: Path) -> None:
    """Raise `ConfigError` unless a file is .svg, .pdf or .dxf, and what writes it is there."""
    check_choice("the suffix of the sheet", path.suffix.lower(), (".svg", ".pdf", ".dxf"))
    check_place(path)
    try:
        import ezdxf  # noqa: F401 - only to say that it is missing
        import fpdf  # noqa: F401
        import matplotlib  # noqa: F401 - its fonts
    except ImportError:
        if path.suffix.lower() != ".svg":
            raise ConfigError(
                f"{path}: expected packages for PDF and DXF, got none; run: pip install "
                "'rastercov[building]', or write .svg"
            ) from None


def write_sheet(text: str, frame: SheetFrame, path: Path) -> None:
    """Write a sheet, an SVG, as .svg, .pdf or .dxf; see `check_sheet_name`."""
    suffix, content = path.suffix.lower(), text.encode()
    if suffix == ".pdf":
        content = _pdf(content, frame.paper)
    elif suffix == ".dxf":
        content = _dxf(text, frame)
    write_bytes(path, content)


def _pdf(svg: bytes, paper: str) -> bytes:
    """A sheet as one page of PDF in its own size, with its fonts."""
    import matplotlib  # its fonts
    from fpdf import FPDF

    width, height = PAPERS[paper]
    page = FPDF("landscape", "mm", (height, width))
    for style, name in (("", "DejaVuSans"), ("B", "DejaVuSans-Bold")):
        file = Path(matplotlib.get_data_path(), "fonts", "ttf", f"{name}.ttf")
        page.add_font("DejaVu Sans", style, file)
    page.set_auto_page_break(False)
    page.add_page()
    page.image(io.BytesIO(svg), 0, 0, width, height)
    return bytes(page.output())


def _dxf(svg: str, frame: SheetFrame) -> bytes:
    """A sheet as DXF, in metres of the world: the drawing in its place, the paper around it."""
    from ezdxf.colors import RGB, rgb2int
    from ezdxf.document import Drawing
    from ezdxf.enums import TextEntityAlignment
    from ezdxf.tools.standards import setup_drawing
    from ezdxf.units import M

    def colour(code: str | None) -> dict[str, int]:
        """Colour of the SVG; ink is black on white paper and white on black."""
        return {"color": 7} if code == INK else {"true_color": rgb2int(RGB.from_hex(str(code)))}

    drawing: Any = Drawing.new("R2010")
    setup_drawing(drawing)
    drawing.units, space = M, drawing.modelspace()
    for group in ElementTree.fromstring(svg).iterfind("{*}g[@id]"):
        style: ByName = {"layer": group.get("id", "")}
        weight = round(100 * float(group.get("stroke-width", 0.13)))
        own = colour(group.get("stroke") or group.get("fill"))
        drawing.layers.add(style["layer"], **own, lineweight=weight)
        for path in group.iterfind("{*}path"):
            fill, rings = path.get("fill", group.get("fill", "none")), []
            stroke = path.get("stroke", group.get("stroke"))
            outline = style | colour(fill if stroke in (None, "none") else stroke)
            for line in path.get("d", "").split("M")[1:]:
                is_ring, numbers = line.endswith("Z"), line.rstrip("Z").replace("L", ",")
                xy = np.array(numbers.split(","), np.float64).reshape(-1, 2)
                points = (xy * (1, -1) * frame.scale / 1e3 + frame.corner).tolist()
                rings += [points] if is_ring else []
                space.add_lwpolyline(points, close=is_ring, dxfattribs=outline)
            if rings and fill != "none":
                hatch = space.add_hatch(dxfattribs=style | colour(fill) | {"hatch_style": 0})
                for ring in rings:
                    hatch.paths.add_polyline_path(ring, is_closed=True)
        for label in filter(lambda each: each.text, group.iterfind("{*}text")):
            x, y, size = (float(label.get(name, "")) for name in ("x", "y", "font-size"))
            at = np.array((x, -y)) * frame.scale / 1e3 + frame.corner
            # Letters of a drawing are as high as capitals, 0.73 of the size of a font.
            height, own = 0.73 * size * frame.scale / 1e3, style | {"style": "OpenSans"}
            side = {"start": "LEFT", "middle": "CENTER", "end": "RIGHT"}[
                label.get("text-anchor", "")
            ]
            text = space.add_text(label.text, height=height, dxfattribs=own)
            text.set_placement(at.tolist(), align=TextEntityAlignment[side])
    content = io.StringIO()
    drawing.write(content)
    return content.getvalue().encode()
