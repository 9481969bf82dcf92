"""Scene of a viewer: a mesh, the cameras to begin with, and the plan or result they are of.

Opened from a plan, a mesh with cameras, or the folder of a result.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property
from itertools import repeat
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import ValidationError

import rastercov
from rastercov.base import (
    ByName,
    ByteArray,
    ConfigError,
    FloatArray,
    IntArray,
    PoseError,
    RastercovError,
    ReadByName,
    UnreadableError,
    check_choice,
    errors_as,
    frozen_record,
    hooks_of,
    norm,
    percent,
    printable,
    read_json,
    shown,
)
from rastercov.core.area.features import narrow
from rastercov.core.camera import (
    Camera,
    EquipmentKind,
    Poses,
    Rig,
    Views,
    distance_to_keep,
    equipment_on,
)
from rastercov.core.camera.catalogue import catalogue, product_of
from rastercov.core.camera.rig import with_equipment
from rastercov.core.camera.viewpoints import distances_to_try
from rastercov.core.coverage.shards import sha256
from rastercov.core.coverage.task import DORI, Task
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.arrays import inverse
from rastercov.core.mesh.solids import in_solid
from rastercov.formats.cameras import read_views
from rastercov.page.rig_state import RigState, Station
from rastercov.placement.candidates.rooms import KeepOutBox, Place
from rastercov.placement.improve.pose_space import PoseSpace
from rastercov.placement.plan.entries import PlanSections
from rastercov.placement.plan.file import PlanFeature, plan_of, read_plan
from rastercov.placement.plan.generator import BESIDE
from rastercov.placement.plan.goals import OwnGoal, separate_goals
from rastercov.placement.plan.network import limits_of, views_by_group
from rastercov.placement.plan.phases import PlanPhases, hooks, phases_of
from rastercov.placement.plan.scene import candidate_pool, name_scene
from rastercov.placement.plan.sections import (
    OF_DEVICES,
    AllSelection,
    BestSelection,
    Constraints,
    SheetSection,
)
from rastercov.report.live import (
    CAMERA_FIELDS,
    LEAST_SITE,
    PLACEMENT,
    describe_rig,
    task_fields,
)
from rastercov.report.modes import MODES, OF_EQUIPMENT, of_gates
from rastercov.report.pages import describe_mesh, describe_mode
from rastercov.report.panorama import is_inside
from rastercov.report.plan_geometry import rooms_of

if TYPE_CHECKING:
    from rastercov.placement.plan.file import Plan
    from rastercov.placement.plan.scene import CandidatePool

SEGMENT_OPTIONS: tuple[ByName, ...] = tuple(
    {
        "name": name,
        "words": words,
        "kind": "float",
        "low": 0.0,
        "high": 89.0,
        "choices": None,
        "default": default,
        "is_optional": False,
        "unit": "deg",
    }
    for name, default, words in (
        ("alpha_deg", 30.0, "Maximum angle between two normals of a segment, eq. (6.1)."),
        ("beta_deg", 10.0, "Maximum angle between segments to merge, eq. (6.3)."),
    )
)
OF_A_RIG = tuple(name for name, mode in MODES.items() if mode.of)
"""Modes that the viewer has values of."""
MOST_REACH = 100.0
"""Distance of cameras from a part without constraints at most, in sizes of the part."""
PLACES = {
    Place.ALLOWED: "allowed",
    Place.TOO_FAR: "too far from the surface",
    Place.TOO_NEAR: "too near a surface",
    Place.KEPT_OUT: "inside a keep-out volume",
    Place.IN_SOLID: "inside a solid",
    Place.OUTSIDE: "outside the mounting boxes",
}
"""Words on places of cameras."""
OF_CAMERAS = ("catalogue", "camera", "cameras", "rigs")
"""Entries of a plan that its cameras are made of."""
RESULTS = {
    "summary.json": ("evaluate", "rig.json"),
    "plan.json": ("place", "poses.json"),
    "audit.json": ("audit", "rig.json"),
}
"""File that marks the folder of a result; its command, and the file of its cameras."""


@frozen_record
class Scene:
    """Mesh and context of a viewer.

    Attributes
    ----------
    title : str
    mesh : Mesh
    start : RigState
        Cameras and thresholds to begin with.
    plan : Plan or None
    pool : CandidatePool or None
        Candidates of the plan and its constraints, where it has any.
    result : dict or None
        Kind of a result folder that was opened, and words on it.
    notes : tuple of str
        What was read and could not be kept.
    phases : PlanPhases or None
        Where it has several.
    sheet, constraints : SheetSection, Constraints
        Title block and limits of the plan, or of that of a result.
    task_mesh : Mesh or None
        The mesh without the groups of goals, where the plan has goals.
    required : mapping of group name or None to share
        Shares of the area that the plan requires.
    goals : tuple of OwnGoal
    by : {"area", "face"} or None
        Unit of results that was asked for.
    plan_file : str
        Name of the file of the plan, or of that of a result; "" without.
    """

    title: str
    mesh: Mesh
    start: RigState
    plan: "Plan | None" = None
    pool: "CandidatePool | None" = None
    result: dict[str, str] | None = None
    notes: tuple[str, ...] = field(default=())
    phases: PlanPhases | None = None
    sheet: SheetSection = field(default_factory=SheetSection)
    constraints: Constraints = field(default_factory=Constraints)
    task_mesh: Mesh | None = None
    goals: tuple[OwnGoal, ...] = ()
    required: Mapping[str | None, float] = field(default_factory=dict)
    by: str | None = None
    plan_file: str = ""

    @property
    def goal_names(self) -> tuple[str, ...]:
        """Names of what may be shown: "" for the task, and the goals."""
        return ("", *(each.name for each in self.goals))

    def goal(self, name: str) -> OwnGoal | None:
        """A goal by its name, None for ""; ConfigError where there is none."""
        if name and not self.goals:
            raise ConfigError(f"expected a plan with goals for {shown(name)}, got none; open one")
        if name:
            check_choice("goal", name, self.goal_names[1:])
        return next((each for each in self.goals if each.name == name), None)

    def equip(self, given: Mapping[str, Path | None]) -> "Scene":
        """The same with equipment of files; ConfigError for that of a plan, or another unit."""
        words = [word for word, path in given.items() if path is not None]
        if self.plan is not None and words:
            raise ConfigError(
                f"expected the {words[0]} of the plan, [{words[0]}.NAME], got --{words[0]}; leave "
                "it out"
            )
        start = self.start
        rig = start.whole._with(
            equipment=equipment_on(with_equipment(start.whole, given, self.mesh))
        )
        for each in rig.equipment.values():
            each.carried_by(tuple(start.cameras))
        start = replace(start, whole=rig, task=narrow(rig, start.task))
        notes = tuple(each for each in self.notes if each not in map(_answer_of, words))
        return replace(self, start=start, notes=notes)

    def place(
        self, at: Sequence[float], goal: OwnGoal | None = None
    ) -> tuple[Mesh, IntArray, dict[str, FloatArray]]:
        """The mesh in a phase, the face at rest of each of its faces, and poses of bodies by name.

        Phases, and errors, as of `PlanPhases.place`. Of a goal, and of the task beside goals, its
        groups alone are to cover.
        """
        if self.phases is None:
            mesh = goal.mesh if goal else self.task_mesh or self.mesh
            is_there = np.isin(self.mesh.face_group, np.unique(mesh.face_group))
            return mesh, np.flatnonzero(is_there), {}
        return self.phases.place(at)

    def carriers(self, cameras: Iterable[str]) -> dict[str, str]:
        """Body of each camera that is fixed to one."""
        own = {} if self.phases is None else {name: self.phases.body_of(name) for name in cameras}
        return {name: body for name, body in own.items() if body != "world"}

    def phases_with(self, rig: Rig) -> PlanPhases | None:
        """The phases for the cameras of a rig."""
        return None if self.phases is None else self.phases.carrying(rig.names)

    @property
    def has_constraints(self) -> bool:
        """True where a plan limits the places of cameras."""
        if self.plan is None:
            return False
        limits = self.plan.constraints
        return bool(self.has_boxes or limits.keep_out or limits.clearance or limits.stand_off)

    @property
    def has_boxes(self) -> bool:
        """True where a plan has boxes of places, or candidates of cameras that they are around."""
        has_some = self.pool is not None and len(self.pool.proposed) > 0
        return has_some or (self.plan is not None and bool(self.plan.constraints.spaces))

    @property
    def modes(self) -> tuple[str, ...]:
        """Ways to colour the faces; DORI levels are of scenes in which people may be."""
        has_levels = self.mesh.diagonal >= LEAST_SITE and self.start.unit == "m"
        known = {"level": has_levels, **of_gates(self.start.whole.gates.values())}
        equipment = self.start.whole.equipment.values()
        is_there = any(not all(each.rides) for each in equipment)
        known |= dict.fromkeys(OF_EQUIPMENT, is_there)
        known |= {name: self.phases is not None for name in OF_A_RIG if MODES[name].of == "phases"}
        return tuple(name for name in OF_A_RIG if known.get(name, True))

    @property
    def placement(self) -> ByName:
        """Way to place cameras, ready for JSON: by the plan or not, number to propose, words."""
        cameras: int | None = None
        has_some = self.pool is not None and len(self.pool.candidates) > 0
        asked = self.plan.selection if self.plan and has_some else None
        if asked is None:
            words, cameras = "one by one, each where it adds the most", 4
        elif isinstance(asked, BestSelection):
            within = "" if asked.budget is None else f" within a cost of {asked.budget:g}"
            cameras, words = asked.cameras, f"for the best coverage{within}, as in the plan"
        elif isinstance(asked, AllSelection):
            words = "all candidates of the plan"
        else:
            words = f"the fewest that meet the plan's goals (whole task: {percent(asked.coverage)})"
        own = {"is_by_plan": asked is not None, "cameras": cameras, "words": words}
        return PLACEMENT | own

    def cost(self, state: RigState) -> float | None:
        """Cost of the cameras that are on: that of the nearest candidate of the plan for each.

        None where no plan has candidates for all of them, or they are mounted as rigs.
        """
        if self.pool is None or self.plan is None or self.plan.mounts.has_rigs:
            return None
        candidates, total = self.pool.candidates, 0.0
        of_candidate = np.array(self.plan.mounts.names)[candidates.camera]
        for each in state.on:
            own = np.flatnonzero(of_candidate == each.camera)
            if not len(own):
                return None
            away = norm(candidates.poses[own, :3, 3] - each.pose[:3, 3])
            total += float(self.pool.costs[own[away.argmin()]])
        return total

    def places(self, state: RigState) -> list[str]:
        """Constraint of the plan that each station, or its rig, violates, "allowed" for none."""
        if self.pool is None or not state.stations:
            return ["allowed"] * len(state.stations)
        rig, placed = state.rig(), state.poses(all_stations=True)
        eyes = rig._rigs(placed)[:, :3, 3]
        is_still = rig.is_fixed[placed.camera]
        eyes[is_still] = placed.eyes[is_still]
        return place_words(self.space(state).judge(eyes))

    def space(self, state: RigState) -> PoseSpace:
        """Allowed places of cameras: by the plan, around the mesh where it has no boxes."""
        if self.pool is not None and self.has_boxes:
            return self.pool.space
        around = default_space(self.mesh, state, is_room=self.is_room)
        return around if self.pool is None else replace(self.pool.space, boxes=around.boxes)

    def describe(self, *, can_edit: bool = True) -> ByName:
        """Everything of the scene that does not change, ready for JSON."""
        return describe_mesh(self.mesh, [each.pose for each in self.start.stations]) | {
            "title": self.title,
            "unit": self.start.unit,
            "version": rastercov.__version__,
            "is_room": self.is_room,
            "task_fields": task_fields(self.start.whole),
            "levels": DORI if "level" in self.modes else {},
            "camera_fields": CAMERA_FIELDS,
            "catalogue": self._sold() if can_edit else [],
            "modes": [
                describe_mode(name, MODES[name])
                | {"options": list(SEGMENT_OPTIONS if name == "segments" else ())}
                for name in self.modes
            ],
            "constraints": ({"boxes": [], "keep_out": []} if self.pool is None else self.limits)
            | {"is_kept": self.has_constraints},
            "can_edit": can_edit,
            "placement": self.placement,
            "result": self.result,
            "notes": list(self.notes),
            **({} if self.phases is None else self.phases.describe()),
        }

    def _sold(self) -> list[tuple[str, str]]:
        """Name and words of each camera of the catalogue, and of each with a lens that fits."""
        shop, sold = catalogue(self.start.catalogue), []
        for name in shop.names():
            camera, *lens = shop.parts(name)
            words = [product_of([camera, *lens]), f"{camera['width']} × {camera['height']} px"]
            words += [
                f"{each['magnification']:g}x"
                if "magnification" in each
                else f"{each['focal_length'] * 1e3:g} mm"
                for each in lens
            ]
            sold.append((name, ", ".join(filter(None, words))))
        return sold

    @cached_property
    def is_room(self) -> bool:
        """True where most cameras are within the mesh, or its closed surface holds all of it."""
        low, high = np.asarray(self.mesh.bounds)
        beyond = 2 * high - low + 1.0
        return is_inside(self.mesh, self.start.eyes) or bool(in_solid(self.mesh, beyond[None])[0])

    def rooms(self, height: float) -> list[tuple[str, str, Any]]:
        """Name, number and outline of each room at a height, m; of a plan, or of its building."""
        items = rooms_of(self.mesh, height)
        if not items and self.plan is not None:
            rooms = (self.plan.room(name) for name in self.plan.rooms)
            items = [(room.name, "", room.outline(height)) for room in rooms]
        return [each for each in items if not each[2].is_empty]

    @property
    def limits(self) -> ByName:
        """Boxes of cameras and volumes without them, ready for JSON."""
        boxes: Any = [(each.low, each.high) for each in self.constraints.spaces]
        if self.pool is not None:
            boxes = np.asarray(self.pool.space.boxes).tolist() if self.has_boxes else []
        volumes = []
        for entry in self.constraints.keep_out:
            volume = entry.volume()
            if isinstance(volume, KeepOutBox):
                corners = [list(map(float, volume.low)), list(map(float, volume.high))]
                volumes.append({"name": entry.name, "box": corners})
            else:
                centre = list(map(float, volume.centre))
                volumes.append({"name": entry.name, "centre": centre, "radius": volume.radius})
        return {"boxes": boxes, "keep_out": volumes}


def distances(mesh: Mesh, camera: Camera) -> tuple[float, float]:
    """Least and greatest distance from which a camera is tried, metres."""
    size = mesh.diagonal
    whole = size * max(camera.fx, camera.fy) / min(camera.width, camera.height)
    if camera.is_parallel:
        whole = size
    return distances_to_try(
        size, whole, camera.depth_of_field(), camera.near, distance_to_keep([camera])
    )


def default_space(mesh: Mesh, state: RigState, *, is_room: bool = False) -> PoseSpace:
    """Places of cameras where no plan limits them: around the part, or within the room."""
    low, high = np.asarray(mesh.bounds)
    eyes, size = state.eyes, float(norm(high - low))
    reach = 0.0
    if not (is_room or is_inside(mesh, eyes)):
        farthest = max(distances(mesh, each)[1] for each in state.cameras.values())
        reach = min(max(2.0 * size, farthest), MOST_REACH * size)
    box = np.stack((low - reach, high + reach))
    if len(eyes):
        box = np.stack((np.minimum(box[0], eyes.min(axis=0)), np.maximum(box[1], eyes.max(axis=0))))
    return PoseSpace(mesh=mesh, boxes=box, clearance=distance_to_keep(state.cameras.values()))


def describe_state(scene: Scene, state: RigState, shown: RigState | None = None) -> ByName:
    """The state of a rig, ready for JSON, with the poses that are shown; see `Scene.places`."""
    stations = (state if shown is None else shown).stations
    return describe_rig(state.cameras, state.task, state.needed, state.whole) | {
        "stations": describe_stations(stations, scene.places(state)),
        "devices": describe_devices(state.whole),
    }


def describe_stations(stations: Sequence[Station], places: Iterable[str] = ()) -> list[ByName]:
    """Stations with words on their places, ready for JSON."""
    return [
        {
            "id": each.id,
            "name": each.name,
            "camera": each.camera,
            "pose": each.pose.ravel().tolist(),
            "is_on": each.is_on,
            "place": place,
        }
        for each, place in zip(stations, places or repeat("allowed"), strict=False)
    ]


def place_words(judged: ByteArray) -> list[str]:
    """Words on places as `PoseSpace.judge` has them: the constraint that each violates."""
    return [PLACES[code] for code in judged.tolist()]


def describe_devices(rig: Rig) -> list[ByName]:
    """Equipment of a rig, ready for JSON; of pieces that ride, the poses on their cameras."""
    camera_from_rig = inverse(rig.rig_from_camera)
    figures: list[ByName] = []
    for word, own in rig.equipment.items():
        for row, carriers in enumerate(own.carried_by(rig.names)):
            place, on = own.places[row], np.flatnonzero(carriers & ~rig.is_fixed).tolist()
            rides = {rig.names[at]: (camera_from_rig[at] @ place).ravel().tolist() for at in on}
            figures.append(
                {
                    "id": f"{word} {row}",
                    "group": word.capitalize(),
                    "name": own.names[row],
                    **own._describe(row),
                    "pose": None if on else place.ravel().tolist(),
                    "rides": rides,
                }
            )
    return figures


def open_plan(path: Path, rig: Views | None = None) -> Scene:
    """Scene of a plan file, with the cameras of a rig where one is given.

    Raises
    ------
    PlanError
        A `ConfigError`, whose `lines` has an entry for each fault of the plan.
    PoseError
        For a rig of other cameras than the plan's.
    """
    plan = read_plan(path)
    mesh, plan, _ = name_scene(plan)
    chosen = None if rig is None else rig.rig
    notes: tuple[str, ...] = ()
    for each in hooks_of(PlanFeature):
        if each.is_chosen(plan):
            if chosen is None or each.word not in chosen.equipment:
                notes += (
                    f"{each.word} are not chosen yet; give the poses.json of place as --poses",
                )
            plan = each.add_choice(plan, chosen)
    pool = candidate_pool(plan, mesh) if plan.has_cameras else None
    cameras = plan.rig if plan.has_cameras else None
    if rig is not None:
        if rig.rig is None and cameras is None:
            raise ConfigError(
                f"{plan.name}: expected a camera in the plan or the rig, got none; give one"
            )
        start = state_of(rig, plan.build_task(), cameras)
        if cameras is not None:  # those that the rig does not use may be added
            own = RigState.of(cameras, Poses.of(())).whole
            own = own._with(tasks={**own.tasks, **start.whole.tasks})
            for name, camera in start.cameras.items():
                own = own._with_camera(name, camera)
            start = replace(start, whole=own)
    elif cameras is None:
        raise ConfigError(
            f"{plan.name}: expected a camera, got none; add one, or give --poses with cameras"
        )
    else:
        start = RigState.of(cameras, Poses.of(()), task=plan.build_task())
    own_catalogue = plan.folder / plan.catalogue if plan.catalogue else None
    start = replace(start, catalogue=own_catalogue, needed=views_by_group(plan, None))
    phases = phases_of(plan, mesh)
    task_mesh, goals = separate_goals(plan, mesh)
    by = "face" if plan.task.weight_by == "count" else plan.task.by
    of_plan: ByName = {
        "task_mesh": task_mesh,
        "goals": goals,
        "by": by,
        "sheet": plan.sheet,
        "constraints": plan.constraints,
        "plan_file": plan.name,
        "required": required_of(plan),
    }
    return Scene(plan.name, mesh, start, plan, pool, notes=notes, phases=phases, **of_plan)


def open_mesh(mesh: Mesh, views: Views, task: Task, title: str) -> Scene:
    """Scene of a mesh and cameras."""
    return Scene(title, mesh, state_of(views, task), notes=views.notes)


def run_of(folder: Path) -> ReadByName:
    """Provenance of the result in a folder; ConfigError where there is none."""
    name = next((name for name in RESULTS if (folder / name).is_file()), None)
    if name is None:
        raise ConfigError(
            f"{printable(str(folder))}: expected a result with {' or '.join(RESULTS)}, got none; "
            "give its folder"
        )
    content = _read(folder / name)
    run = content.get("run") or content.get("made_from") or {}
    if not isinstance(run, Mapping) or "scene" not in run:
        raise ConfigError(
            f"{folder / name}: expected the entry run.scene, got none; run the command again"
        )
    return run


Shown = tuple[Mesh | PlanPhases, Mapping[str, object]]
"""Mesh of a result, or its phases, and its equipment or their files by word."""


def _answer_of(word: str) -> str:
    """Note on a result with equipment that is not there."""
    return f"the page shows the result without its {word}; give them as --{word}"


def open_result(folder: Path, load: Callable[[list[str]], Shown]) -> Scene:
    """Scene of the folder of a result.

    Parameters
    ----------
    folder : Path
        Of `evaluate`, `place` or `audit`.
    load : callable
        Gives the scene; called with the names of the files of its mesh.

    Raises
    ------
    ConfigError
        For another folder, one without its cameras, a mesh that is not that of the result, and
        entries that no command wrote.
    """
    try:
        return _open_scene(folder, load)
    except (LookupError, TypeError, AttributeError):
        raise ConfigError(
            f"{printable(str(folder))}: expected entries of rastercov, got other entries; run "
            "the command again"
        ) from None


def _open_scene(folder: Path, load: Callable[[list[str]], Shown]) -> Scene:
    """Scene of a result; errors of entries of other types are those of Python."""
    run = run_of(folder)
    name, (kind, rig_name) = next(each for each in RESULTS.items() if (folder / each[0]).is_file())
    rig_file = folder / rig_name
    files = [str(each["name"]) for each in run.get("mesh", ())]
    answer, equipment = load(files)
    phases = None if isinstance(answer, Mesh) else answer
    mesh = _with_roles(answer, run["scene"]) if isinstance(answer, Mesh) else answer.mesh
    if sha256(mesh.vertices, mesh.faces, mesh.face_group) != run["scene"]["sha256"]:
        other = f", or the plan with --poses {quote(str(rig_file))}" if kind == "place" else ""
        raise ConfigError(
            f"expected the mesh of {folder}, {', '.join(files)}, got another; give the unchanged "
            f"files with their --unit and --transform{other}"
        )
    if not rig_file.is_file():
        raise ConfigError(f"expected {rig_file}, got no such file; give --poses")
    task = Task(**{k: v for k, v in run.get("task", {}).items() if k in Task.__dataclass_fields__})
    start = state_of(read_views(rig_file), task, _cameras(run))
    equipment = equipment_on(with_equipment(start.whole._with(equipment={}), equipment, mesh))
    start = replace(start, whole=start.whole._with(equipment=equipment))
    told = _read(folder / name)
    by = "face" if told.get("by") == "face" and not told.get("by_face_because") else None
    needed = (told.get("covered_area") or {}).get("views")
    if isinstance(needed, Mapping):  # by group
        start = replace(start, needed=dict(needed))
    result = {"kind": kind, "words": f"of rastercov {kind}, in {folder}"}
    notes: tuple[str, ...] = ()
    for each in hooks_of(EquipmentKind):
        notes += (
            (_answer_of(each.word),) if each.entry in told and each.word not in equipment else ()
        )
    title, own = folder.resolve().name, told.get("plan")
    own = own if isinstance(own, Mapping) else {}
    try:
        given = own.get("sheet") or (run.get("options") or {}).get("sheet")
        sheet = SheetSection.model_validate(given or {})
        limits = Constraints.model_validate(own.get("constraints") or {})
    except ValidationError as error:
        raise TypeError from error
    return Scene(
        title,
        mesh,
        start,
        result=result,
        notes=notes,
        phases=phases,
        sheet=sheet,
        constraints=limits,
        by=by,
        plan_file=str(told.get("file", "")),
    )


def scene_of_place(folder: Path) -> Shown | None:
    """Scene of the plan in a result of `place`; None elsewhere, and where files were moved."""
    if (placed := _plan_of_place(folder)) is None:
        return None
    plan, mesh = placed
    try:
        chosen = read_views(folder / "poses.json").rig if plan.candidates else None
        equipment = chosen.equipment if chosen else plan.build_equipment()
        return phases_of(plan, mesh) or separate_goals(plan, mesh)[0], equipment
    except RastercovError:
        return None


def goals_of_place(folder: Path) -> tuple[tuple[OwnGoal, ...], Mapping[str | None, float]]:
    """Goals of the plan in a result of `place`, and as of `required_of`; none elsewhere."""
    if (placed := _plan_of_place(folder)) is None:
        return (), {}
    return separate_goals(*placed)[1], required_of(placed[0])


def required_of(plan: "Plan") -> Mapping[str | None, float]:
    """Shares of the area of a still scene that a plan requires."""
    is_of_area = plan.task.weight_by == "area" and plan.is_still
    is_of_whole = is_of_area and not getattr(plan.selection, "of_reachable", False)
    return limits_of(plan.selection) if is_of_whole else {}


def _plan_of_place(folder: Path) -> "tuple[Plan, Mesh] | None":
    """The plan of a result of `place`, without its cameras, and its scene."""
    told = _read(folder / "plan.json") if (folder / "plan.json").is_file() else {}
    if not isinstance(told.get("plan"), Mapping) or not isinstance(told.get("folder"), str):
        return None
    try:
        # Cameras and candidates may have files that are there no more.
        own = [name for each in hooks_of(PlanSections) for name in each.plan.model_fields]
        own += ["goals", "selection", "task"]
        needed = told["plan"].keys() & {"meshes", "targets", "rooms", *own, *OF_DEVICES}
        for phased in hooks():
            if any(map(told["plan"].get, phased.sections[:1])):
                needed |= told["plan"].keys() & {*phased.sections, *OF_CAMERAS}
        beside = [
            each
            for each in told["plan"].get("candidates", ())
            if any(map(each.get, BESIDE.model_fields))
        ]
        entries = {name: told["plan"][name] for name in needed} | {"candidates": beside}
        plan = plan_of(entries, folder.resolve() / told["folder"] / "plan")
        mesh, plan, _ = name_scene(plan)
        return plan, mesh
    except RastercovError:  # such as a file that was moved
        return None


def _read(path: Path) -> ReadByName:
    with errors_as(ConfigError, printable(str(path)), UnreadableError):
        content = read_json(path)
    if not isinstance(content, Mapping):
        raise ConfigError(
            f"{printable(str(path))}: expected a result, got other JSON; run the command again"
        )
    return content


def _with_roles(mesh: Mesh, scene: ReadByName) -> Mesh:
    """The mesh with the groups' roles of a result; as it is where it has other groups."""
    groups = scene.get("groups", ())

    def names_in(role: str) -> list[str]:
        return [str(group["name"]) for group in groups if group.get(role)]

    if [group.name for group in mesh.groups] != [str(group["name"]) for group in groups]:
        return mesh  # another mesh, which its hash tells
    return mesh.with_groups(
        names_in("is_occluder"), names_in("is_two_sided"), names_in("is_target")
    )


def _cameras(run: ReadByName) -> Rig:
    """Cameras that a result was made with."""
    if "camera" in run:
        return Rig([Camera.from_dict(run["camera"])], ["camera"])
    entries = [dict(each) for each in run.get("cameras", ())]
    names = [str(each.pop("name", f"camera {row + 1}")) for row, each in enumerate(entries)]
    return Rig([Camera.from_dict(each) for each in entries], names)


def state_of(views: Views, task: Task, cameras: Rig | None = None) -> RigState:
    """State of views, with some cameras if they have none."""
    if views.rig is None and cameras is not None:
        named = bool(views.camera_names)
        views = views.with_cameras(cameras) if named else replace(views, rig=cameras)
    if views.rig is None:
        raise PoseError("expected cameras with the poses, got none; give --camera")
    state = RigState.of(views.rig, views.poses, views.images, task)
    return state if views.has_unit else replace(state, unit="unit")
