"""Pages of reports: by jinja2 with pictures inline, and the page of the viewer as one file.

The first need nothing else: no script, no request. They follow the light or dark theme of their
reader and fit a phone and a desk. Text is escaped by default. jinja2 is imported with the first.

The exported page of the viewer has its modules and its data inside. It can be looked at, picked and
coloured anew, and not be edited. The viewer describes its scene with the same functions.
"""

import hashlib
import json
import marshal
import math
import re
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from importlib.util import cache_from_source
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike
from PIL import Image

import rastercov
from rastercov.base import (
    TINY,
    BoolArray,
    ByName,
    FloatArray,
    IntArray,
    RastercovError,
    ReadByName,
    ResourceError,
    norm,
    percent,
    plural,
    sampling,
    write_bytes,
)
from rastercov.base.features import FEATURES
from rastercov.base.format import area, base64_of, length, number, percent_of, verb, xml_text
from rastercov.core.area.advice import task_in_words
from rastercov.core.area.union import Covered
from rastercov.core.area.zones import DeadZones, zone_line
from rastercov.core.camera import MODELS, Camera, Cameras, Poses, cameras_of, names_of, upwards
from rastercov.core.camera.camera import shown_of
from rastercov.core.camera.projection import angles_of_view, view_border, view_frame
from rastercov.core.coverage.network import Network, reasons_of
from rastercov.core.coverage.task import REASONS
from rastercov.core.mesh import Mesh
from rastercov.placement.parts import part_rows
from rastercov.report import theme
from rastercov.report.feature import InPhases
from rastercov.report.images import png, png_in_the_dark
from rastercov.report.modes import MODES, Mode, OfCameras, Painted
from rastercov.report.overview import best_covering
from rastercov.report.panorama import front_of, is_inside, scene_box, sides, upright
from rastercov.report.script import texts_script
from rastercov.report.theme import DARK, LIGHT
from rastercov.report.verdict import mark_of, sign_words

if TYPE_CHECKING:
    from jinja2 import Environment


@dataclass(frozen=True)
class Picture:
    """An image of a page as PNG, its description, and its twin for the dark theme."""

    alt: str
    light: bytes
    dark: bytes | None = None

    @classmethod
    def of(cls, alt: str, image: Image.Image) -> "Picture":
        """An image in 255 colours, with its small areas of a colour of their own."""
        return cls(alt, png(image, Image.Quantize.FASTOCTREE))

    @classmethod
    def draw(cls, alt: str, image: Image.Image) -> "Picture":
        """The same with a twin, for a drawing whose greys may be reversed."""
        light = png(image, Image.Quantize.FASTOCTREE)
        return cls(alt, light, png_in_the_dark(light))


def render(template: str, package: str = "rastercov.report", **values: object) -> str:
    """HTML of a template in the folder `templates` of a package, with some values."""
    return xml_text(_environment(package).get_template(template).render(values))


def kept(make: Callable[..., str]) -> Callable[..., str]:
    """Function whose texts are kept beside this file, as Python keeps code.

    They depend on files of the package alone, and on words that are in the name of the file.
    """

    def known(*words: str) -> str:
        path = Path(cache_from_source(Path(__file__).with_name(f"{make.__name__}{words}.py")))
        with suppress(Exception):  # none, or a damaged one
            state, text = marshal.loads(path.read_bytes())
            if state == _state():
                return str(text)
        text = make(*words)
        if not sys.dont_write_bytecode:
            with suppress(OSError, RastercovError):
                write_bytes(path, marshal.dumps((_state(), text)))
        return text

    return known


@cache
def _state() -> str:
    """Version of the package, times and sizes of its files: wheels may give all one time."""
    every = Path(rastercov.__file__).parent.rglob("*.*[!c]")
    known = sorted((str(path), path.stat().st_mtime_ns, path.stat().st_size) for path in every)
    return repr((rastercov.__version__, known))


@cache
def _environment(package: str) -> "Environment":
    from jinja2 import (
        ChoiceLoader,
        Environment,
        FileSystemBytecodeCache,
        PackageLoader,
        StrictUndefined,
        __version__,
    )
    from jinja2.bccache import Bucket

    class Kept(FileSystemBytecodeCache):
        """Code of templates, kept where there is room."""

        def dump_bytecode(self, bucket: Bucket) -> None:
            """Keep one."""
            if not sys.dont_write_bytecode:
                with suppress(OSError):
                    super().dump_bytecode(bucket)

    version = f"{__version__}-{rastercov.__version__}-{Path(__file__).stat().st_mtime_ns}"
    environment = Environment(
        autoescape=True,
        bytecode_cache=Kept(str(Path(cache_from_source(__file__)).parent), f"%s-{version}.pyc"),
        finalize=lambda value: value.replace("W/m2", "W/m²") if type(value) is str else value,
        keep_trailing_newline=True,
        loader=ChoiceLoader([PackageLoader(package), PackageLoader("rastercov.report")]),
        lstrip_blocks=True,
        trim_blocks=True,
        undefined=StrictUndefined,
    )
    environment.filters |= {
        "area": area,
        "breaks": _with_breaks,
        "column_kinds": _column_kinds,
        "count": "{:,}".format,
        "image": image_name,
        "mark": mark_of,
        "metres": length,
        "number": number,
        "percent": percent,
        "plural": plural,
        "sampling": sampling,
        "srcdoc": _srcdoc,
        "task_in_words": task_in_words,
        "verb": verb,
        "uri": lambda data: f"data:image/png;base64,{base64_of(data)}",
    }
    environment.globals |= {
        "light": LIGHT,
        "dark": DARK,
        "part_rows": part_rows,
        "most_embedded": MOST_EMBEDDED,
        "sign_words": sign_words,
    }
    return environment


def _column_kinds(headings: Sequence[str], rows: Sequence[Sequence[Any]]) -> list[str]:
    """Attribute of the cells of each column: of words, which are not figures, and of long ones."""
    from markupsafe import Markup

    kinds = []
    for column in range(len(headings)):
        cells = [str(row[column]) for row in rows if row[column] != ""]
        has_words = 2 * sum(FIGURE.match(cell) is None for cell in cells) > len(cells)
        is_long = max(map(len, cells), default=0) > LONGEST_WORD
        own = [name for name, has in (("words", has_words), ("long", is_long)) if has]
        kinds.append(Markup(f' class="{" ".join(own)}"') if own else "")
    return kinds


def _with_breaks(text: object) -> str:
    """A cell of a table whose names may be broken after their parts."""
    from markupsafe import Markup, escape

    return Markup(re.sub(r"([/_])(?=\w)", r"\1<wbr>", str(escape(text))))


def image_name(name: str, noun: str = "image") -> str:
    """Name of an image for an audit: "image 1" of a file that calls it "camera 1"; or of a pose."""
    return re.sub(r"^camera (?=\d+(/| \(|$))", f"{noun} ", name)


def _srcdoc(page: str) -> str:
    """A page as the value of an attribute in single quotes, which few of its characters are."""
    from markupsafe import Markup

    return Markup(page.replace("&", "&amp;").replace("'", "&#39;"))


FIGURE = re.compile(r"[-+\d.,]+(\s|°|$)")
"""Begin of a cell of figures, which are aligned at their end."""
LONGEST_WORD = 20
"""Characters of a cell that is in one line."""
MOST_FACES = 1_500_000
"""Faces of an exported page: 36 bytes each, a third more as text."""
MOST_OF_REPORT = 300_000
"""Faces up to which a report has the page: 15 MB."""
MOST_EMBEDDED = 2_200_000
"""Characters of the scene inside a page of a report: 35,000 faces, and 3 MB with all pictures."""
MOST_SIDES = 100_000
"""Faces up to which a page without a front looks for the best first view, in a second."""
MOST_STATIONS = 5_000
"""Cameras that a page shows."""
MOST_FACES_OF_ZONE = 5_000
"""Faces of a dead zone that a page highlights."""
CUT_AT = 0.6
"""Height at which a floor plan is cut, as a part of that of its storey."""
FLOOR_COSINE, LEAST_STOREY, LEAST_FLOOR = 0.94, 1.5, 0.25
"""Least cosine of the slope of a floor, height of a storey, m, and part of the largest floor."""
PARTS_OF_BORDER = 8
"""Rays of the border of a field of view along each side of the image."""
_IMPORT = re.compile(r'^import (\{.*?\}) from "rastercov/(\w+)\.js";$', re.DOTALL | re.MULTILINE)
_EXPORT = re.compile(r"^export ((?:async )?(?:class|function|const) (\w+))", re.MULTILINE)
TYPES = {
    ".html": "text/html",
    ".js": "text/javascript",
    ".css": "text/css",
    ".glsl": "text/plain",
    ".svg": "image/svg+xml",
}


def view_page(
    title: str,
    mesh: Mesh,
    camera: Cameras,
    poses: Poses,
    names: Sequence[str],
    values: ReadByName,
    summary: ReadByName,
    zones: Sequence[ReadByName] = (),
    *,
    unit: str = "m",
    phases: InPhases | None = None,
    notes: Sequence[str] = (),
) -> str | None:
    """Page of a result that needs no server; None for one too large for a report.

    Parameters
    ----------
    title : str
    mesh, camera, poses, names
        Surface, cameras, their poses, and the name of each pose.
    values : mapping
        Values of modes of `rastercov.report.modes`, by name; the first is shown first.
    summary : mapping
        As of `figures_of`.
    zones : sequence
        As of `zone_entries`.
    unit : {"m", "unit"}
        Of lengths, as of `rastercov.base.format.area`.
    phases : InPhases, optional
        Of the scene.
    notes : sequence of str
        Lines that the page says when it opens.
    """
    if mesh.n_faces > MOST_OF_REPORT or len(poses) > MOST_STATIONS:
        return None
    scene = describe_scene(title, mesh, poses.world_from_camera, unit) | {
        "modes": [describe_mode(name, MODES[name]) for name in values],
        "notes": list(notes),
    }
    frames = {name: _frame(mesh, name, each, summary) for name, each in values.items()}
    if phases is not None:
        scene |= phases.entries
        name = phases.mode
        scene["modes"] += [describe_mode(name, MODES[name])] * (len(phases.values) > 0)
        for row, own in enumerate(phases.values):
            frames[f"{name}@{row}"] = _frame(mesh, name, own, summary)
    state = _still_state(camera, poses, names)
    return embed_scene(
        mesh, {"scene": scene, "state": state, "frames": frames, "zones": list(zones)}
    )


def describe_scene(title: str, mesh: Mesh, poses: FloatArray, unit: str) -> ByName:
    """Everything of a scene that does not change, but its modes, ready for JSON."""
    return describe_mesh(mesh, poses) | {
        "title": title,
        "version": rastercov.__version__,
        "is_room": is_inside(mesh, poses[:, :3, 3]),
        "constraints": {},
        "can_edit": False,
        "result": None,
        "notes": [],
        "unit": unit,
    }


def _frame(mesh: Mesh, name: str, values: object, summary: ReadByName) -> ByName:
    """Values of a mode as a page shows them."""
    painted = MODES[name].paint(mesh, values)
    return describe_frame(name, painted) | {"summary": summary} | levels_of(painted.levels)


def _still_state(camera: Cameras, poses: Poses, names: Sequence[str]) -> ByName:
    """Cameras and poses as the state of a viewer, in which nothing can be changed."""
    sold = (each.product for each in cameras_of(camera))
    cameras = [
        f"{name}: {words}" if words else name
        for name, words in zip(names_of(camera), sold, strict=True)
    ]
    lenses = map(describe_camera, cameras_of(camera))
    known = dict(zip(cameras, lenses, strict=True))
    stations = describe_stations(cameras, poses, names)
    return {"revision": 0, "stations": stations, "cameras": known, "task": {}, "devices": []}


def describe_stations(cameras: Sequence[str], poses: Poses, names: Sequence[str]) -> list[ByName]:
    """Poses with their own names and those of their cameras, ready for JSON."""
    rows = zip(names, poses.camera.tolist(), poses.world_from_camera, strict=True)
    return [
        {
            "id": row,
            "name": name,
            "camera": cameras[index],
            "is_on": True,
            "place": "allowed",
            "pose": pose.ravel().tolist(),
        }
        for row, (name, index, pose) in enumerate(rows)
    ]


def values_of(
    network: Network,
    covered: BoolArray,
    names: Sequence[str],
    areas: Covered | None,
    need: IntArray,
) -> ByName:
    """Values of the modes that a network has.

    Parameters
    ----------
    network : Network
    covered : (F,) bool
        Faces that enough cameras cover.
    names : sequence of str
        Of the cameras.
    areas : Covered or None
        Exact area, where the result is by area.
    need : (F,) int64
        Cameras that each face needs.
    """
    mesh, count = network.mesh, len(network.pose_ids)
    values = {
        "reason": reasons_of(network, covered),
        "coverage": network.best,
        "camera": OfCameras(best_covering(network), names, theme.camera_colours(max(1, count))),
        "views": network.views,
    }
    if areas is None:
        return values
    area = areas.area[need - 1, np.arange(mesh.n_faces)]
    return {"area": area / np.maximum(mesh.areas, TINY)} | values


def figures_of(
    summary: ReadByName,
    faces: ArrayLike,
    seen_m2: FloatArray | None = None,
    alone_m2: FloatArray | None = None,
    total_m2: float = 0.0,
    stations: Sequence[int] = (),
) -> ByName:
    """Figures of a network for its page, from those of `Network.summary` and of each camera.

    Parameters
    ----------
    summary : mapping
        Of the network, with its exact area where it has one.
    faces : (P,) array_like
        Number of faces that each camera covers.
    seen_m2, alone_m2 : (P,) float64, optional
        Area that it covers, and that no other does.
    total_m2 : float
        Area of the task.
    stations : (P,) sequence of int
        Ids of the cameras; their rows unless given.
    """
    counts = np.asarray(faces, np.int64).tolist()

    def share(part: FloatArray | None, row: int) -> float | None:
        return None if part is None or not total_m2 else percent_of(part[row], total_m2)

    names = ("covered", "covered_area", "by_face_because")
    return {name: summary[name] for name in names if name in summary} | {
        "by_camera": [
            {
                "station": station,
                "faces": counts[row],
                "area_percent": share(seen_m2, row),
                "alone_percent": share(alone_m2, row),
            }
            for row, station in enumerate(stations or range(len(counts)))
        ]
    }


def describe_mesh(mesh: Mesh, poses: ArrayLike = ()) -> ByName:
    """A mesh as a page needs it, ready for JSON; up and the first view are by poses (P, 4, 4)."""
    towards = None
    if mesh.n_faces <= MOST_SIDES or front_of(mesh, poses) is not None:
        towards = (sides(mesh, poses)[0] @ upright(poses)).tolist()
    firsts = dict(zip(*np.unique(mesh.face_group, return_index=True), strict=True))
    counts = np.bincount(mesh.face_group, minlength=len(mesh.groups)).tolist()
    return {
        "n_faces": mesh.n_faces,
        "n_vertices": mesh.n_vertices,
        "bounds": np.asarray(mesh.bounds).tolist(),
        "frame": scene_box(mesh).tolist(),
        "up": upwards(poses).tolist(),
        "cut": plan_cut(mesh, poses),
        "towards": towards,
        "groups": [
            {
                "name": group.name,
                "role": group.role,
                "is_two_sided": group.is_two_sided,
                "faces": counts[row],
                "first": int(firsts.get(row, -1)),
            }
            for row, group in enumerate(mesh.groups)
        ],
        "reasons": {name: words.label for name, words in REASONS.items()},
    }


def plan_cut(mesh: Mesh, poses: ArrayLike = ()) -> float:
    """Coordinate along the axis of up at which a floor plan is cut: above a floor of the task.

    Of several floors it is the one with most cameras of `poses` above it and below the next, and of
    equals the largest. The cut is at `CUT_AT` of the height up to the next floor, or the top.
    """
    up, task = upwards(poses), mesh.task_mask
    if not task.any():
        task = np.ones_like(task)
    heights = np.asarray(mesh.vertices @ up)[mesh.faces[task]]
    top, is_floor = float(heights.max()), mesh.normals[task] @ up > FLOOR_COSINE
    levels, areas = heights.mean(axis=1)[is_floor], np.asarray(mesh.areas)[task][is_floor]
    floors, sizes = _floors(levels, areas)
    if not len(floors):
        return float(up.sum()) * float((1 - CUT_AT) * heights.min() + CUT_AT * top)
    eyes = np.asarray(poses, np.float64).reshape(-1, 4, 4)[:, :3, 3] @ up
    above = np.bincount(np.searchsorted(floors, eyes, "right"), minlength=len(floors) + 1)[1:]
    own = int(np.lexsort((sizes, above))[-1])
    ceiling = floors[own + 1] if own + 1 < len(floors) else max(top, floors[own])
    return float(up.sum()) * float((1 - CUT_AT) * floors[own] + CUT_AT * ceiling)


def _floors(levels: FloatArray, areas: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Heights of floors, rising, and their areas, of the heights and areas of level faces."""
    bins, own = np.unique(np.floor(levels / LEAST_STOREY * 4), return_inverse=True)
    sizes = np.bincount(own, areas, len(bins)).astype(np.float64)
    lowest = np.full(len(bins), np.inf)
    np.minimum.at(lowest, own, levels)
    kept: list[int] = []
    for row in np.flatnonzero(sizes >= LEAST_FLOOR * sizes.max(initial=0.0)).tolist():
        if not kept or lowest[row] - lowest[kept[-1]] >= LEAST_STOREY:
            kept.append(row)
    return lowest[kept], sizes[kept]


def describe_mode(name: str, mode: Mode) -> ByName:
    """A way to colour the faces, ready for JSON."""
    return {"id": name, "label": mode.label, "words": mode.words, "panel": mode.panel}


def describe_frame(mode: str, painted: Painted) -> ByName:
    """Colours of faces without their levels, ready for JSON."""
    palette = base64_of(painted.palette.tobytes())
    return {"mode": mode, "legend": painted.legend, "scale": painted.scale, "palette": palette}


def levels_of(levels: object) -> dict[str, str]:
    """Level of each face, as a frame of an exported page has it."""
    return {"levels": base64_of(levels)}


def plain_of(camera: Camera) -> ByName:
    """Entries of `Camera.from_dict`, ready for JSON; None for no far limit of focus."""
    near, far = camera.focus_range or (None, None)
    far = None if far is None or math.isinf(far) else far
    return camera.to_json() | ({} if near is None else {"focus_range": [near, far]})


def describe_camera(camera: Camera) -> ByName:
    """Values of a camera for the page, ready for JSON; None for what it does not have.

    `border` are rays around its field of view, see `camera.projection.view_border`; where they do
    not start in the camera centre, `origins` has their starts. `plain` is as of `plain_of`.
    """
    plain = plain_of(camera)
    origins, ends = view_frame(camera, PARTS_OF_BORDER, 1.0)
    return shown_of(plain, *map(float, camera.depth_of_field())) | {
        "model": camera.model,
        "fx": None if camera.is_parallel else camera.fx,
        "magnification": camera.magnification,
        "px_per_m": camera.fx if camera.is_parallel and not camera.magnification else None,
        "hfov_deg": angles_of_view(camera)[0] if camera.is_pinhole else None,
        "can_focus": (camera.is_parallel or camera.focal_length is not None)
        and camera.pixel_size is not None
        and MODELS[camera.model].is_planar,
        "plain": plain,
        **(
            {"border": (ends - origins).tolist(), "origins": origins.tolist()}
            if camera.is_parallel
            else {"border": view_border(camera, PARTS_OF_BORDER).tolist(), "origins": None}
        ),
    }


def zone_entries(mesh: Mesh, zones: DeadZones, said: ReadByName) -> list[ByName]:
    """Dead zones, the largest first, ready for JSON; `said` has them as in `summary.json`."""
    items = []
    for row, entry in enumerate(said["dead_zones"]):
        faces = np.unique(zones.face[zones.zone == row])
        normal = (mesh.normals[faces] * mesh.areas[faces, None]).sum(axis=0)
        length = max(float(norm(normal)), 1e-300)
        items.append(
            {
                "area": entry["area_m2"],
                "percent": entry["percent"],
                "centre": list(entry["centroid"]),
                "normal": (normal / length).tolist(),
                "group": entry["groups"][0],
                "reason": entry["reason"],
                "words": zone_line(entry),
                "faces": faces[:MOST_FACES_OF_ZONE].tolist(),
            }
        )
    return items


def soup_origin(mesh: Mesh) -> FloatArray:
    """(3,) point that corners of a page are relative to, metres."""
    return np.asarray(mesh.bounds).mean(axis=0)


def embed_scene(mesh: Mesh, data: ReadByName) -> str:
    """The page with its style, modules, mesh and data inside; its policy lets it load nothing.

    ResourceError for more than `MOST_FACES` faces.
    """
    if mesh.n_faces > MOST_FACES:
        raise ResourceError(
            f"expected up to {MOST_FACES:,} faces in a self-contained page, got {mesh.n_faces:,}; "
            "decimate the mesh, or run rastercov view"
        )
    origin = soup_origin(mesh)
    surface = {
        "origin": origin.tolist(),
        "soup": base64_of((mesh.vertices[mesh.faces] - origin).astype("<f4").tobytes()),
        "groups": base64_of(mesh.face_group.astype("<u2").tobytes()),
    }
    return _one_file("export", {**data, **surface})


def with_live_data(data: ReadByName) -> str:
    """The page with what it computes from inside, see `rastercov.report.live`."""
    return _one_file("live", data, scripts=" 'wasm-unsafe-eval'", workers="worker-src blob:; ")


def _one_file(kind: str, data: ReadByName, scripts: str = "", workers: str = "") -> str:
    """The page with its style, modules and data inside, which may run nothing else."""
    shaders = {
        each.name.removesuffix(".glsl"): each.read_text("utf-8")
        for each in (files("rastercov") / "shaders").iterdir()
        if each.name.startswith("viewer_") and each.name.endswith(".glsl")
    }
    style, script = (static_file("style.css") or b"").decode(), bundle_scripts("main")
    policy = (
        f"default-src 'none'; script-src {digest_of(script)}{scripts}; {workers}"
        f"style-src {digest_of(style)}; "
        "img-src blob: data:; connect-src 'none'; base-uri 'none'; form-action 'none'"
    )
    parts = {"kind": kind, "shaders": _inside(shaders), "data": _inside(data)}
    return page_text("one_file.html", policy=policy, style=style, script=script, **parts)


@kept
def bundle_scripts(name: str) -> str:
    """A module and those that it imports as one script, which a policy can name by its hash.

    A module becomes a function that gives its exports, called once, after those that it imports.
    """
    made: dict[str, str] = {}

    def add(module: str) -> None:
        text = (static_file(f"{module}.js") or b"").decode()
        for imported in _IMPORT.findall(text):
            if imported[1] not in made:
                add(imported[1])
        exports = ", ".join(result[1] for result in _EXPORT.findall(text))
        text = _IMPORT.sub(
            lambda result: f"const {result[1].replace(' as ', ': ')} = {result[2]}_js;", text
        )
        made[module] = (
            f"const {module}_js = (() => {{\n{_EXPORT.sub(lambda result: result[1], text)}\n"
            f"return {{ {exports} }};\n}})();\n"
        )

    add(name)
    return "".join(made.values())


def _inside(data: object) -> str:
    """JSON that no element of a page ends in."""
    return json.dumps(data, allow_nan=False).replace("<", "\\u003c")


def page_text(name: str, **parts: str) -> str:
    """A page, `index.html` or `one_file.html`, with its parts."""
    return (files("rastercov.page") / "web" / name).read_text("utf-8").format(**parts)


def static_file(name: str) -> bytes | None:
    """A module, style or shader of the page by its name; None for anything else."""
    if not re.fullmatch(r"(shaders/viewer_)?[a-z0-9_]+(\.(vert|frag))?\.[a-z]+", name):
        return None
    if Path(name).suffix not in TYPES:
        return None
    if name == "features.js":
        return _features().encode()
    if name == "texts.js":
        return texts_script().encode()
    folder = "rastercov" if name.startswith("shaders/") else "rastercov.page"
    place = files(folder) / name if folder == "rastercov" else files(folder) / "web" / name
    return place.read_bytes() if place.is_file() else None


def _features() -> str:
    """Module of the page with what features add: a function of each, by the name of its module."""
    names = [own["page"] for own in FEATURES.values() if "page" in own]
    imports = [f'import {{ {name} }} from "rastercov/{name}.js";\n' for name in names]
    return "".join(imports) + f"export const FEATURES = [{', '.join(names)}];\n"


def digest_of(text: str) -> str:
    """Source of a content security policy: a text inside the page itself."""
    return f"'sha256-{base64_of(hashlib.sha256(text.encode()).digest())}'"
