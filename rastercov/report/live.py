"""Live page: the engine as WebAssembly, the mesh and the rig in one file.

Its modules are those of `page/web/live*.js`; `make wasm` compiles the engine, and a wheel has
it. What the page cannot compute, such as equipment, is shown as it was recorded.
"""

import json
import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import field
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
from numpy.typing import ArrayLike

import rastercov
from rastercov.base import ByName, ReadByName, frozen_record, hooks_of
from rastercov.base.arguments import document_fields, rules_of
from rastercov.base.format import base64_of
from rastercov.core.area.regions import OF_A_FACE
from rastercov.core.camera import (
    MODELS,
    Camera,
    Cameras,
    Poses,
    Rig,
    cameras_of,
    equipment_on,
    gates_of,
    names_of,
)
from rastercov.core.camera.catalogue import catalogue
from rastercov.core.camera.rig import Inputs, are_central
from rastercov.core.camera.viewpoints import CAMERA_SIZE, SPREAD
from rastercov.core.coverage.task import (
    DORI,
    LEVELS,
    NEEDED,
    OF_SURFACE,
    OWN_CRITERIA,
    REASONS,
    Task,
    tasks_of,
)
from rastercov.core.mesh import Mesh, shapes
from rastercov.core.mesh.groups import rows_of
from rastercov.core.mesh.unseeable import unseeable_areas
from rastercov.formats.cameras.own import UNUSED
from rastercov.report import theme
from rastercov.report.modes import (
    FIRST,
    MODES,
    MOST_VIEWS,
    OCCLUDER_LABEL,
    OF_GATES,
    OfUnit,
    of_devices,
    of_gates,
)
from rastercov.report.packed_lens import pack_lens
from rastercov.report.pages import (
    bundle_scripts,
    describe_camera,
    describe_mode,
    describe_scene,
    describe_stations,
    kept,
    plain_of,
    soup_origin,
    with_live_data,
)

if TYPE_CHECKING:
    from rastercov.placement.plan.goals import OwnGoal

MOST_FACES = 300_000
"""Faces of a live page: a drag of one camera takes half a second."""
MOST_PAIRS = 2_000_000
"""Pairs of a face and a camera: the first figures take some seconds."""
UNION_AT_REST = 100_000
"""Faces from which a drag shows the area of its camera, and all of them together when it rests."""
POINTS_OF_FACE = 256
"""Points of a face by which what hides most of it is found."""
PLACEMENT = {
    "is_by_plan": False,
    "cameras": 4,
    "words": "one by one, each where it adds the most",
    "tries": 120,
    "spread": SPREAD,
}
"""The page's way to place cameras, see `page/live_jobs.js`."""
BY_FACE = (*OF_A_FACE, "min_angle_deg")
"""Thresholds that pages without a program do not compute."""
ENGINE, PROVER, READERS = "engine.wasm", "lens.wasm", "readers.wasm"
WITHOUT = "no engine in this installation; run make wasm"
NO_ENGINE = f"recorded figures: {WITHOUT}"
BY_PYTHON = f"figures by Python: {WITHOUT}"
"""Of a page without a server, and of one with it."""
COLOURS = 64
"""Colours of cameras, which begin again after the last."""
LIVE_MODES = (
    "reason",
    "coverage",
    "area",
    "camera",
    "views",
    "density",
    "incidence",
    "level",
    "device",
    *OF_GATES,
)
OF_RULES = ("device", *OF_GATES)
"""Those of cameras that count together."""
LEAST_SITE = 2.0
"""Size of a scene from which it has DORI levels, m."""
PLAY_IMAGE = (1920, 1080)
PLAY_LENSES = (("70° lens", 70.0), ("100° lens", 100.0), ("40° lens", 40.0))
"""Cameras of the playground: names, and horizontal fields of view."""
PLAY_SCENES = (
    ("room", "a room", "a room of 6 x 5 x 2.8 m with crates"),
    ("aeroplane", "a part", "an aeroplane of 1,970 faces"),
)
UNITS = {
    "min_pixels": "px",
    "max_blur": "px",
    "min_pixel_density": "px/m",
    "min_facing_density": "px/m",
    "min_pixels_per_m2": "px/m²",
}
"""Units of thresholds, but of those that end in _deg."""
CAMERA_FIELDS = tuple(
    dict(zip(("name", "low", "high", "unit", "words"), row, strict=True))
    for row in (
        ("hfov_deg", 1.0, 175.0, "deg", "Horizontal field of view."),
        ("fx", 10.0, 20_000.0, "px", "Focal length in pixel widths."),
        ("magnification", 0.001, 10.0, "", "Size in the image over size of the object."),
        ("px_per_m", 1.0, 1e6, "px/m", "Pixels per metre perpendicular to the rays."),
        ("width", 64, 8192, "px", "Image width, at the same field of view."),
        ("focus_distance", 0.02, 100.0, "m", "Focus distance."),
        ("f_number", 0.7, 45.0, "", "F-number: focal length over aperture diameter."),
        ("focus_near", 0.0, 100.0, "m", "Near limit of the depth of field."),
        ("focus_far", 0.01, 1000.0, "m", "Far limit of the depth of field."),
        ("near", 0.0, 10.0, "m", "Near plane: surfaces closer than this are not visible."),
    )
)
"""Values of a camera that can be changed, with the ends of their sliders."""


LENS_FIELDS = tuple(
    {"name": name, "low": low, "high": high, "unit": unit, "words": words}
    for names, low, high, unit, words in (
        ("cx cy", 0.0, 8192.0, "px", "Principal point."),
        ("k1 k2 k3 k4 k5 k6", -10.0, 10.0, "", "Radial distortion."),
        ("p1 p2", -0.2, 0.2, "", "Tangential distortion."),
        ("s1 s2 s3 s4", -0.2, 0.2, "", "Thin-prism distortion."),
        ("tau_x tau_y", -1.0, 1.0, "rad", "Tilt of the sensor."),
        ("omega", 0.0, 3.0, "rad", "Field-of-view parameter of the lens model."),
        ("k", -2.0, 2.0, "", "Distortion coefficient of the division model."),
        ("xi", -0.99, 3.0, "", "Offset between the centres of the lens model, in sphere radii."),
        ("alpha", 0.0, 1.0, "", "Weight of distance against depth in the lens model."),
        ("beta", 0.01, 10.0, "", "Shape of the ellipsoid of the lens model; 1 is a sphere."),
    )
    for name in names.split()
)
"""Those of a lens with distortion, by the names of `rastercov.core.camera.models.MODELS`."""


@frozen_record
class Goals:
    """Goals of a plan with groups, thresholds and views of their own, and the task beside them.

    Attributes
    ----------
    mesh, task_mesh : Mesh
        The scene with the groups of goals, and that of which those of the task alone are scored.
    goals : sequence of OwnGoal
    """

    mesh: Mesh
    task_mesh: Mesh
    goals: Sequence["OwnGoal"]

    def describe(self) -> list[ByName]:
        """The goals for a page, ready for JSON."""
        from rastercov.placement.plan.network import views_by_group

        return [
            _part(self.mesh, goal.mesh)
            | {
                name: getattr(goal, name)
                for name in ("name", "limit", "is_most", "groups", "asked")
            }
            | {
                "task": as_entries(goal.plan.build_task()),
                "needed": views_by_group(goal.plan, None),
            }
            for goal in self.goals
        ]


@frozen_record
class Asked:
    """Question of a live page of a report.

    Attributes
    ----------
    task : Task
    method : str
        Of visibility.
    needed : mapping, or None
        As of `rastercov.page.rig_state.RigState`.
    limits : mapping
        Required shares of the area, of all (None) and of groups.
    placed : (Poses, sequence of str), or None
        Poses and names of all cameras, where the page of the report has rigs with a rule instead.
    goals : Goals or None
        Those of the plan.
    """

    task: Task
    method: str = "certified"
    needed: Mapping[str, int] | None = None
    limits: Mapping[str | None, float] = field(default_factory=dict)
    placed: tuple[Poses, Sequence[str]] | None = None
    goals: Goals | None = None


@cache
def engine(name: str = ENGINE) -> bytes | None:
    """A module of the page, the engine unless named; None in a checkout without it."""
    place = files("rastercov.page") / "web" / name
    return place.read_bytes() if place.is_file() else None


def record_cause(
    mesh: Mesh,
    cameras: Cameras,
    n_poses: int,
    task: Task,
    others: Mapping[str, bool],
    goals: Goals | None = None,
) -> str:
    """Reason for which a page is recorded and does not compute; "" where it does.

    `others` are further things that it cannot compute, and whether it would have to.
    """
    every = goals.goals if goals else ()
    for goal in every:
        plan = goal.plan
        of_goal = {
            "results by face": not goal.is_by_area,
            "goals of the coverable area": plan.task.weight_by == "seeable",
        }
        n_pairs = (1 + len(every)) * n_poses
        if why := record_cause(goal.mesh, cameras, n_pairs, plan.build_task(), of_goal):
            return why
    if engine() is None:
        return NO_ENGINE
    if mesh.n_faces > MOST_FACES:
        return (
            f"the page shows static results: {mesh.n_faces:,} faces; it recomputes at most "
            f"{MOST_FACES:,}"
        )
    if mesh.n_faces * n_poses > MOST_PAIRS:
        return (
            f"the page shows static results: {mesh.n_faces * n_poses:,} pairs of face and camera; "
            f"it recomputes at most {MOST_PAIRS:,}"
        )
    has_own = {
        **dict.fromkeys(equipment_on(cameras), True),
        **others,
        "telecentric lenses": any(each.is_parallel for each in cameras_of(cameras)),
        "criteria of the surface": any(fails(task, mesh).any() for fails in OWN_CRITERIA.values()),
        "angles between views": task.min_angle_deg > 0,
        "parallel rays": not are_central(cameras),
        "pixels per square metre of this lens": task.min_pixels_per_m2 > 0
        and any(each._has_closed_form for each in cameras_of(cameras)),
    }
    item = next((name for name, has_it in has_own.items() if has_it), "")
    return f"the page shows static results: it cannot recompute {item}" if item else ""


def view_of(
    title: str,
    mesh: Mesh,
    cameras: Cameras,
    poses: Poses,
    names: Sequence[str],
    asked: Asked,
    unit: str = "m",
) -> str:
    """Text of a live page of what the cameras of a report cover; see `record_cause`."""
    goals, task_mesh = asked.goals, mesh
    mesh = mesh if goals is None else goals.mesh
    is_site = mesh.diagonal >= LEAST_SITE and unit == "m"
    shown = {"level": is_site, **of_gates(gates_of(cameras).values())}
    modes = [name for name in MODES if name in LIVE_MODES and shown.get(name, True)]
    types = names_of(cameras)
    scene = describe_scene(title, mesh, poses.world_from_camera, unit) | {
        "can_edit": True,
        "task_fields": task_fields(),
        "levels": DORI if is_site else {},
        "camera_fields": CAMERA_FIELDS + LENS_FIELDS,
        "modes": [describe_mode(name, MODES[name]) for name in modes],
        "required": describe_limits(task_mesh, asked.limits),
    }
    known = dict(zip(types, cameras_of(cameras), strict=True))
    state = {
        "stations": describe_stations(types, poses, names),
        **describe_rig(known, asked.task, asked.needed),
        **describe_union(cameras),
    }
    own = cameras.tasks if isinstance(cameras, Rig) else {}
    for name, task in zip(types, tasks_of(cameras, asked.task), strict=True):
        state["cameras"][name]["task"] = as_entries(task) if name in own else None
    return with_live_data(data_of(scene, state, mesh, known, goals=goals))


def describe_rig(
    cameras: Mapping[str, Camera],
    task: Task,
    needed: Mapping[str, int] | None = None,
    rig: Rig | None = None,
) -> ByName:
    """Entries of a state on cameras by their names and on thresholds, ready for JSON.

    Those of cameras are their own, of a rig; `needed` is as of `Asked`.
    """
    tasks = {} if rig is None else rig.tasks
    return {
        "cameras": {
            name: describe_camera(camera)
            | {"task": as_entries(tasks[name]) if name in tasks else None}
            for name, camera in cameras.items()
        },
        "task": {name: getattr(task, name) for name in _task_names(rig)},
        "needed": needed and dict(needed),
    }


def data_of(
    scene: ReadByName,
    state: ReadByName,
    mesh: Mesh,
    cameras: Mapping[str, Camera],
    candidates: Mapping[str, Sequence[Any]] | None = None,
    goals: Goals | None = None,
) -> ByName:
    """Data that a live page computes from, ready for JSON.

    Parameters
    ----------
    scene, state : mapping
        As the viewer describes them, ready for JSON.
    mesh : Mesh
    cameras : mapping
        Of the state, by name.
    candidates : mapping, optional
        Poses that are tried for the next camera, by the name of its camera.
    goals : Goals, optional
    """
    curved = {name: each for name, each in cameras.items() if not each.is_pinhole}
    lenses = {name: _deflate(pack_lens(camera)) for name, camera in curved.items()}
    named = {name: state["cameras"][name] | {"lens": name} for name in curved}
    surface = describe_surface(mesh)
    surface["mesh"] |= _part(mesh, mesh if goals is None else goals.task_mesh)
    return _share_entries(scene, {**state, "cameras": {**state["cameras"], **named}}) | {
        "goals": [] if goals is None else goals.describe(),
        "lenses": lenses,
        "candidates": candidates or {},
        **surface,
    }


def describe_surface(mesh: Mesh) -> ByName:
    """A mesh as a page has it, and what the page knows of lens models, ready for JSON."""
    own = {"mesh": _arrays(mesh), "origin": soup_origin(mesh).tolist()}
    return own | _of_files()


def _of_files() -> ByName:
    """Tables by which the page reads files of cameras.

    Names of the coefficients of each lens model; entries of a rig that the page does not need;
    levels by name.
    """
    return {
        "models": {name: each.coefficients.split() for name, each in MODELS.items()},
        "unused": sorted(UNUSED),
        "levels": LEVELS,
    }


def describe_limits(mesh: Mesh, limits: Mapping[str | None, float]) -> list[ByName]:
    """Required shares of the area, of all (None) and of groups or parts; `page/live.js`."""
    names, items = [group.name for group in mesh.groups], []
    for place, limit in limits.items():
        every = range(len(names)) if place is None else rows_of(names, place)
        rows = [row for row in every if not mesh.groups[row].is_occluder]
        kind = "group" if len(every) == 1 else "part"
        name = "whole task" if place is None else f"{kind} {place}"
        items += [{"name": name, "place": place, "limit": limit, "rows": rows}] if rows else []
    return items


def describe_union(cameras: Cameras) -> ByName:
    """Entries on the cameras of a rig together, see `Inputs.describe`, and their places."""
    if not isinstance(cameras, Rig):
        return {}
    own: ByName = {"fixed": list(cameras.fixed)} if cameras.fixed else {}
    if (cameras.rig_from_camera != np.eye(4)).any():
        places = cameras.rig_from_camera.tolist()
        own["rig_from_camera"] = dict(zip(cameras.names, places, strict=True))
    for each in hooks_of(Inputs):
        own |= each.describe(cameras)
    return own


def playground() -> str:
    """Text of a live page, without a scene: its reader opens a mesh or a built-in one."""
    known = {name: Camera.from_fov(*PLAY_IMAGE, hfov_deg=angle) for name, angle in PLAY_LENSES}
    scene = {
        "version": rastercov.__version__,
        "unit": "m",
        "can_edit": True,
        "task_fields": task_fields(),
        "levels": DORI,
        "camera_fields": CAMERA_FIELDS + LENS_FIELDS,
        "reasons": {name: words.label for name, words in REASONS.items()},
        "modes": [
            describe_mode(name, MODES[name])
            for name in MODES
            if name in LIVE_MODES and name not in OF_RULES
        ],
        "result": None,
        "notes": [],
    }
    state: ByName = {"stations": [], **describe_rig(known, Task())}
    samples = [
        {"title": title, "words": words, "names": _groups(mesh), **_arrays(mesh)}
        for name, title, words in PLAY_SCENES
        for mesh in (shapes.by_name(name),)
    ]
    data: ByName = {
        "mesh": None,
        "lenses": {},
        "candidates": {},
        "samples": samples,
        "readers": _deflate_module(READERS),
        **_of_files(),
        "leastSite": LEAST_SITE,
    }
    return with_live_data(_share_entries(scene, state) | data)


def _share_entries(scene: ReadByName, state: ReadByName) -> ByName:
    """Entries that pages of any mesh have."""
    return {
        "scene": {**scene, "catalogue": [], "constraints": {}, "placement": PLACEMENT},
        "state": state,
        "engine": _deflate_module(ENGINE),
        "prover": _deflate_module(PROVER),
        "worker": bundle_scripts("live_worker") + "live_worker_js.listen(self);\n",
        "colours": _colours(scene["unit"]),
        "cameraSize": CAMERA_SIZE,
        "pointsOfFace": POINTS_OF_FACE,
        "advice": {name: words.advice for name, words in REASONS.items()},
        "unionAtRest": UNION_AT_REST,
        "mostPairs": MOST_PAIRS,
        "defaults": as_entries(Task()),
        "ofFaces": BY_FACE,
        "catalogue": _catalogue(),
    }


def as_entries(task: Task) -> ByName:
    """Thresholds by name, ready for JSON."""
    return {name: getattr(task, name) for name in Task.__dataclass_fields__}


def task_fields(rig: Rig | None = None) -> list[ByName]:
    """Thresholds of a task with their limits, for sliders; those that a rig makes known, too."""
    words, names, result, units = (
        document_fields(Task),
        _task_names(rig),
        list[ByName](),
        dict(UNITS),
    )
    for each in () if rig is None else rig.equipment.values():
        units |= each._units
    for rule in (each for each in rules_of(Task) if each.name in names):
        choices, limits = get_args(rule.kind), rule.limits
        result.append(
            {
                "name": rule.name,
                "words": words[rule.name],
                "kind": "choice" if choices else rule.kind.__name__,
                "low": limits.get("ge", limits.get("gt")),
                "is_low_open": "gt" in limits,
                "high": limits.get("le"),
                "choices": choices or None,
                "default": rule.default,
                "is_optional": rule.is_optional,
                "unit": "deg" if rule.name.endswith("_deg") else units.get(rule.name, ""),
            }
        )
    return result


def _task_names(rig: Rig | None) -> list[str]:
    """Thresholds that a page shows, of cameras or of a rig."""
    left_out, equipment = ((OF_SURFACE, *BY_FACE), ()) if rig is None else ((), rig.equipment)
    return [
        name
        for name in document_fields(Task)
        if name not in left_out and NEEDED.get(name) in (None, *equipment)
    ]


def _part(mesh: Mesh, own: Mesh) -> ByName:
    """Roles of the groups of a scene, and faces that are never seen, for the task or a goal.

    Targets that `own` is without are occluders that hide nothing.
    """
    kept = np.flatnonzero(np.isin(mesh.face_group, np.unique(own.face_group)))
    roles = [
        now.is_occluder + 2 * each.is_target + 4 * now.is_two_sided
        for each, now in zip(mesh.groups, own.groups, strict=True)
    ]
    areas = unseeable_areas(own)
    never = [[int(kept[face]), float(areas[face])] for face in np.flatnonzero(areas).tolist()]
    return {"roles": roles, "unseeable": never}


def _arrays(mesh: Mesh) -> dict[str, str]:
    return {
        "vertices": _deflate(np.asarray(mesh.vertices, "<f8")),
        "faces": _deflate(np.asarray(mesh.faces, "<i4")),
        "groups": _deflate(np.asarray(mesh.face_group, "<u2")),
    }


def _groups(mesh: Mesh) -> list[ByName]:
    return [
        {"name": each.name, "role": each.role, "is_two_sided": each.is_two_sided}
        for each in mesh.groups
    ]


@cache
def _colours(unit: str) -> ByName:
    """Colours, words and scales of the modes that the page paints, by faces with each value."""
    parts = [shapes.torus(16, 8), shapes.box()]
    mesh = Mesh.joined(parts, ["task", "occluder"]).with_groups(occluders=["occluder"])
    each, nothing = np.arange(mesh.n_faces), np.zeros(mesh.n_faces)

    def paint_values(name: str, values: object) -> ByName:
        """Colours, words and hatches by their level, and the scale."""
        paint = MODES[name].paint(mesh, values)
        own = sorted(paint.legend, key=lambda entry: int(entry["level"]))
        words, colours, hatches = (
            [each[key] for each in own] for key in ("label", "colour", "hatch")
        )
        given: ByName = {"words": words, "occluder": words.index(OCCLUDER_LABEL), "first": FIRST}
        if paint.scale is None:
            return given | {"colours": colours, "hatches": hatches}
        return given | {"palette": base64_of(paint.palette.tobytes()), "scale": paint.scale}

    scales = {
        "area": nothing,
        "coverage": nothing,
        "density": OfUnit(nothing, f"px/{unit}"),
        "incidence": nothing + math.inf,
        **dict.fromkeys(OF_GATES, OfUnit(nothing, "um")),
    }
    levels = np.array([0.0, 1.0, *DORI.values()])
    return {
        "scales": {name: paint_values(name, values) for name, values in scales.items()},
        "classes": {
            "reason": paint_values("reason", each % len(REASONS)) | {"first": 0},
            "level": paint_values("level", levels[each % len(levels)]),
            "views": [paint_values("views", each % (n + 2)) for n in range(MOST_VIEWS)],
            "none": paint_values("device", of_devices(0 * each - 1, [])),
        },
        "cameraColours": theme.camera_colours(COLOURS).tolist(),
        "covered": theme.COVERED,
    }


@kept
def _catalogue() -> str:
    """Central cameras of the catalogue, as `Camera.from_dict` reads them: JSON, deflated."""
    cameras = {name: Camera.from_dict({"preset": name}) for name in catalogue(None).names()}
    own = {name: plain_of(camera) for name, camera in cameras.items() if not camera.is_parallel}
    return _deflate(np.frombuffer(json.dumps(own, allow_nan=False).encode(), np.uint8))


@kept
def _deflate_module(name: str) -> str:
    module = engine(name)
    return "" if module is None else _deflate(np.frombuffer(module, np.uint8))


def _deflate(values: ArrayLike) -> str:
    """Bytes of an array as base64 of zlib, whose checksum tells damage."""
    return base64_of(zlib.compress(np.ascontiguousarray(values).tobytes()))
