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
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from textwrap import wrap
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
import shapely

from rastercov.base.arguments import check_choice
from rastercov.base.errors import ConfigError
from rastercov.base.format import area, percent, shortened, signed
from rastercov.base.memory import FloatArray
from rastercov.base.output import write_bytes
from rastercov.base.versions import version_of
from rastercov.camera.camera import Camera
from rastercov.camera.pose import Poses
from rastercov.camera.projection import angles_of_view
from rastercov.camera.rig import cameras_of
from rastercov.coverage.advice import task_in_words
from rastercov.coverage.area.frames import to_world
from rastercov.coverage.area.network import in_words
from rastercov.coverage.area.zones import face_zones
from rastercov.coverage.densities import DORI, DORI_EDITION
from rastercov.coverage.evaluation import Evaluation
from rastercov.mesh import Mesh
from rastercov.mesh.sections import section, solid
from rastercov.report.pages import rendered
from rastercov.report.plan_geometry import edges_between, scene_of_plan, seen_on_plan
from rastercov.report.tables import heading_and_tilt
from rastercov.report.theme import DORI as BANDS

PAPERS = {"A4": (297, 210), "A3": (420, 297), "A2": (594, 420), "A1": (841, 594), "A0": (1189, 841)}
"""Width and height of landscape sheets, mm."""
STEPS = (1.0, 2.0, 2.5, 5.0)
"""Scales that are taken unless one is given: 1 to these times a power of ten."""
INK = "#14181d"
"""Colour of cameras, walls and text in the template."""
LEVELS = tuple(reversed(DORI))
"""Levels that have a band, the nearest first."""
MARGIN, PANEL, GAP = 10.0, 142.0, 8.0
"""Border of the sheet, width of the column with tables, and least room around the drawing, mm."""
LETTERS = 84
"""In a line of the title block."""
LONGEST_BAR = 60.0
"""Length of the scale bar at most, mm."""
HATCH = 1.6
"""Distance of the lines of a hatching, mm."""
CUT = 1.2
"""Height of the cut above the floor, m; half of the building where that is lower than twice it."""
LEVEL, FACES_UP = 0.999, 0.1
"""Least z of the normal of a face of a floor, and of one whose dead zones are drawn."""
SYMBOL = ((-4, 1.3), (-4, -1.3), (-1.2, -1.3), (-1.2, -0.4), (0.6, -1.3), (0.6, 1.3), (-1.2, 0.4))
"""Symbol of a camera that looks to the right, mm."""


class Frame(NamedTuple):
    """Paper with its scale, the place of its upper left corner in the world, and two heights, m."""

    paper: str
    scale: float
    corner: FloatArray
    floor: float
    cut: float

    def path(self, found: object) -> str:
        """Lines, and the borders of areas, of the world as an SVG path."""
        parts = shapely.get_parts(found)
        parts = parts[~shapely.is_empty(parts)]
        lines = [part for part in parts if part.geom_type == "LineString"]
        texts = []
        for line in (*lines, *shapely.get_rings(parts)):
            xy = (shapely.get_coordinates(line) - self.corner) * (1e3, -1e3) / self.scale
            ring = line.geom_type == "LinearRing"
            points = [f"{x:.4f},{y:.4f}" for x, y in (xy[:-1] if ring else xy).tolist()]
            texts.append("M" + "L".join(points) + "Z" * ring)
        return "".join(texts)


def frame_of(
    mesh: Mesh,
    poses: Poses,
    paper: str = "A3",
    scale: str = "auto",
    floor: float | None = None,
    cut: float | None = None,
) -> Frame:
    """Paper with the mesh and the cameras in the middle of its window.

    `scale` is auto or 1:N; the floor is that of `floor_of`, and the cut `CUT` above it, unless
    given.

    Raises
    ------
    ConfigError
        For an unknown paper or scale, one at which the drawing does not fit, and a cut beyond the
        mesh.
    """
    bottom, top = np.asarray(mesh.opaque.bounds)[:, 2].tolist()
    floor = floor_of(mesh.opaque) if floor is None else floor
    cut = floor + min(CUT, (top - floor) / 2) if cut is None else cut
    if not bottom <= cut <= top:
        ends = f"the mesh from {bottom:g} to {top:g} m"
        raise ConfigError(f"the cut is at z = {cut:g} m, and {ends}; give another --cut or --floor")
    corners = np.concatenate((np.asarray(mesh.bounds), poses.world_from_camera[:, :3, 3]))[:, :2]
    low, high = corners.min(axis=0), corners.max(axis=0)
    check_choice("paper", paper, tuple(PAPERS))
    window = np.array(PAPERS[paper]) - (PANEL, 0)
    least = max(float(((high - low) * 1e3 / (window - 2 * MARGIN - 2 * GAP)).max()), 1e-3)
    power = 10.0 ** math.floor(math.log10(least))
    found = next(n * p for p in (power, 10 * power) for n in STEPS if n * p >= least)
    if scale != "auto":
        match = re.fullmatch(r"1:(\d{1,6}(?:\.\d+)?)", scale.strip())
        if match is None or not float(match[1]):
            raise ConfigError(f"scale must be auto or 1:N such as 1:50, got {scale!r}")
        if float(match[1]) < least:
            raise ConfigError(
                f"at {scale} the drawing is larger than {paper}; take --scale "
                f"{scale_text(found)}, or a larger --paper"
            )
        found = float(match[1])
    corner = (low + high) / 2 + window * (-0.5, 0.5) * found / 1e3
    return Frame(paper, found, corner, floor, cut)


def floor_of(mesh: Mesh) -> float:
    """Height of the lowest floor: with a tenth of all area that is level and faces up, or more."""
    level = mesh.normals[:, 2] > LEVEL
    heights, rows = np.unique(np.round(mesh.centroids[level, 2], 2), return_inverse=True)
    areas = np.bincount(rows, mesh.areas[level], len(heights))
    return float(next(iter(heights[areas >= 0.1 * areas.sum()]), np.asarray(mesh.bounds)[0, 2]))


def plan_sheet(
    found: Evaluation,
    names: Sequence[str],
    frame: Frame,
    project: str,
    *,
    date: str | None = None,
    north: float | None = None,
    views: Mapping[str, int] | None = None,
) -> str:
    """Plan of what an evaluation is of, with its cameras, what they see, and dead zones; SVG.

    Parameters
    ----------
    found : Evaluation
        Mesh, cameras and result.
    names : sequence of str
        Name of each pose.
    frame : Frame
        Paper, from `frame_of`.
    project : str
        Title.
    date : str, optional
        Date; today unless given.
    north : float, optional
        Direction of an arrow to the north, degrees counter-clockwise from +x.
    views : mapping of str to int, optional
        Cameras that faces of a group need, 1 for the others; those of the task unless given.
    """
    mesh, (width, height) = found.mesh.opaque, PAPERS[frame.paper]
    ends = np.array(((MARGIN, height - MARGIN), (width - MARGIN - PANEL, MARGIN)))
    box = ends * (1, -1) * frame.scale / 1e3 + frame.corner
    segments = section(mesh.vertices, mesh.welded_faces, frame.cut)
    lines, solids = shapely.linestrings(segments), solid(segments)
    walls = shapely.line_merge(shapely.multilinestrings(lines)).simplify(0)
    paths = _views(found, frame, scene_of_plan(segments, box, frame.cut, found.poses))
    paths |= {"WALLS": frame.path(walls), "SOLID": frame.path(solids)}
    below = edges_between(mesh, frame.floor - 0.01, frame.cut)
    paths["BELOW"] = frame.path(shapely.multilinestrings(shapely.linestrings(below)))
    zone = _dead_zone(found, frame, views).difference(solids)
    paths["DEAD"] = frame.path(zone) + frame.path(_hatching(zone, HATCH * frame.scale / 1e3))
    paths = {name: path or "M0,0" for name, path in paths.items()}  # fpdf2 refuses an empty path
    turn = None if north is None else math.radians(north)
    metre = 1e3 / frame.scale
    power = 10.0 ** math.floor(math.log10(LONGEST_BAR / metre))
    bar = max(n * power for n in (1, 2, 5) if n * power * metre <= LONGEST_BAR)
    whole = percent(found.network.summary()["covered"]["area_percent"] / 100)
    words = f"{whole} of the area, by whole faces"
    return rendered(
        "plan_sheet.svg",
        width=width,
        height=height,
        panel_width=PANEL,
        paper=frame.paper,
        scale_text=scale_text(frame.scale),
        floor=frame.floor,
        cut=frame.cut,
        paths=paths,
        rows=_camera_rows(found, names, frame.floor),
        cameras=_symbols(found, names, frame, ends),
        north=None if turn is None else (math.cos(turn), -math.sin(turn)),
        bar_mm=bar * metre,
        bar_text=f"{bar:g} m",
        dead=area(zone.area),
        edition=DORI_EDITION,
        levels=[(level, DORI[level]) for level in LEVELS],
        bands=[(level.upper(), f"#{bytes(colour).hex()}") for level, colour in BANDS.items()],
        mesh=shortened(", ".join(each.name for each in mesh.sources or mesh.groups), 60),
        covered=words if found.areas is None else in_words(found.areas.summary(views)),
        task_rows=[
            ("" if row else "Task", line)
            for row, line in enumerate(wrap(task_in_words(asdict(found.task), views), LETTERS))
        ],
        date=date or datetime.date.today().isoformat(),
        version=version_of("rastercov"),
        project=shortened(project, 44),
    )


def scale_text(scale: float) -> str:
    """Scale as text, such as 1:50, or 2:1 where the drawing is larger than the world."""
    return f"1:{scale:g}" if scale >= 1 else f"{1 / scale:g}:1"


def _views(found: Evaluation, frame: Frame, scene: Mesh) -> dict[str, str]:
    """Paths of what cameras see at the height of the cut, by level, and "FOV", of each camera."""
    cameras = cameras_of(found.camera)
    seen = {level: seen_on_plan(scene, cameras, found.poses, DORI[level]) for level in LEVELS}
    paths = {level.upper(): frame.path(shapely.union_all(seen[level])) for level in LEVELS}
    return paths | {"FOV": "".join(map(frame.path, seen["detect"]))}


def _dead_zone(found: Evaluation, frame: Frame, views: Mapping[str, int] | None) -> Any:
    """Uncovered parts of targets, and of faces that face up from the floor to the cut."""
    mesh, network = found.mesh, found.network
    if found.areas is not None:
        zones = found.areas.zones(views)
    else:
        is_left = mesh.task_mask & ~network.covered
        zones = face_zones(mesh, is_left - 1, network.views)
    face, first = zones.face.astype(np.int64), zones.starts[:-1]
    corner_of = np.repeat(np.arange(len(face)), np.diff(zones.starts))
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


def _hatching(zone: Any, step: float) -> Any:
    """Lines of a hatching within an area of the world, at 45 degrees, a step apart."""
    if zone.is_empty:
        return zone
    x0, y0, x1, y1 = zone.bounds
    sums = np.arange(math.ceil((x0 + y0) / step), (x1 + y1) / step)[:, None] * step
    lines = shapely.linestrings((x0, x1), sums - (x0, x1))  # none, where the zone is small
    return shapely.multilinestrings(lines).intersection(zone)


def _symbols(
    found: Evaluation, names: Sequence[str], frame: Frame, window: FloatArray
) -> list[dict[str, Any]]:
    """Path of each camera, and its name and height with their middle, behind it, in the window."""
    entries: list[dict[str, Any]] = []
    metre = 1e3 / frame.scale
    for name, pose in zip(names, found.poses.world_from_camera, strict=True):
        at, ahead = pose[:2, 3], pose[:2, 2]
        size = float(np.linalg.norm(ahead))
        ahead = ahead / size if size > 1e-6 else np.array((0.0, 1.0))
        outline = at + SYMBOL @ np.array((ahead, (-ahead[1], ahead[0]))) / metre
        text = shortened(name, 24)
        half = 0.5 + 0.85 * max(len(text), 6)
        x, y = ((at - frame.corner) * (1, -1) * metre) + ahead * (-5.5 - half, 8.0)
        x = float(np.clip(x, window[0, 0] + half, window[1, 0] - half))
        y = float(np.clip(y, window[1, 1] + 3, window[0, 1] - 4))
        while any(abs(x - e["x"]) < half + e["half"] and abs(y - e["y"]) < 6.3 for e in entries):
            y += 1.0
        height = f"h {signed(pose[2, 3] - frame.floor)} m"
        symbol = frame.path(shapely.Polygon(outline))
        entry = {"symbol": symbol, "x": x, "y": y, "half": half, "name": text, "height": height}
        entries.append(entry)
    return entries


def _camera_rows(found: Evaluation, names: Sequence[str], floor: float) -> list[list[str]]:
    """Cells of the camera table."""
    cameras, rows = cameras_of(found.camera), []
    for name, pose, index in zip(
        names, found.poses.world_from_camera, found.poses.camera, strict=True
    ):
        camera, place = cameras[index], pose[:3, 3] - (0, 0, floor)
        reach = [min(camera.fx, camera.fy) / DORI[level] for level in LEVELS]
        heading, tilt = (f"{signed(each, 0)}°" for each in heading_and_tilt(pose))
        distances = " / ".join(signed(each, 0 if each >= 9.95 else 1) for each in reach)
        row = [*map(signed, place.tolist()), heading, tilt, lens_text(camera)]
        rows.append(
            [shortened(name, 16), *row, f"{signed(angles_of_view(camera)[0], 0)}°", distances]
        )
    return rows


def lens_text(camera: Camera) -> str:
    """Focal length and f-number of a camera; its field of view where metres are not known."""
    if camera.focal_length is None:
        across, down = angles_of_view(camera)
        return f"{across:.0f} x {down:.0f}°"
    stop = camera.aperture and f" f/{camera.focal_length / camera.aperture:.2g}"
    return f"{1e3 * camera.focal_length:.3g} mm{stop or ''}"


def check_sheet_name(path: Path) -> None:
    """Raise `ConfigError` unless a file is .svg, .pdf or .dxf, and what writes it is there."""
    check_choice("the suffix of the sheet", path.suffix.lower(), (".svg", ".pdf", ".dxf"))
    try:
        import ezdxf  # noqa: F401 - only to say that it is missing
        import fpdf  # noqa: F401
        import matplotlib  # noqa: F401 - its fonts
    except ImportError:
        if path.suffix.lower() != ".svg":
            raise ConfigError(
                f"{path}: PDF and DXF need more; run: pip install 'rastercov[building]', or .svg"
            ) from None


def write_sheet(text: str, frame: Frame, path: Path) -> None:
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


def _dxf(svg: str, frame: Frame) -> bytes:
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
        style: dict[str, Any] = {"layer": group.get("id", "")}
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
        for label in group.iterfind("{*}text"):
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
