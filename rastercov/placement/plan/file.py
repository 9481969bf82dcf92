"""Plan files: read `plan.toml` and check it; all its errors are raised at once.

plan.toml -> `read_plan` -> `scene` (mesh, candidates) -> `run` (place), `check`

Errors have a line each with their path, for example `task.min_pixels: expected a number above 0,
got -3`.
"""

import json
import os
import re
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any, Self, get_args

import numpy as np
from pydantic import BaseModel, PrivateAttr, ValidationError, ValidationInfo, model_validator

from rastercov.base import (
    ByName,
    CameraError,
    ConfigError,
    RastercovError,
    ReadByName,
    StrPath,
    UnparsedError,
    UnreadableError,
    errors_as,
    first_of,
    hooks_of,
    printable,
    read_toml,
    shown,
    suffix_of,
)
from rastercov.base.arguments import share_meant
from rastercov.core.area.network import unit_of_result
from rastercov.core.camera import Camera, Poses, Rig, is_joint
from rastercov.core.camera.equipment import Equipment
from rastercov.core.coverage.device import devices
from rastercov.core.coverage.task import Engine, Task
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.bodies import Jointed
from rastercov.core.mesh.files import Site
from rastercov.core.mesh.groups import list_names
from rastercov.formats.meshes import READERS
from rastercov.placement.candidates.rooms import Room
from rastercov.placement.mounts import Mounts
from rastercov.placement.plan.entries import Table, texts_below_fields
from rastercov.placement.plan.sections import ONE_CAMERA, BodyEntry, PlanModel

WORDS = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "a string in quotes",
    "string_unicode": "a string in quotes",
    "bool_type": "true or false",
    "list_type": "a list in [ ]",
    "dict_type": "a table",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "finite_number": "a finite number",
    "greater_than": "a number above {gt:g}",
    "greater_than_equal": "a number of {ge:g} or more",
    "less_than": "a number below {lt:g}",
    "less_than_equal": "a number of {le:g} or less",
    "literal_error": "{expected}",
    "too_short": "{min_length} or more entries",
    "too_long": "at most {max_length} entries",
    "string_too_short": "a string that is not empty",
}
"""Words for the expected value, by the error type of pydantic."""


OF_LISTS = "list_type", "too_short", "too_long"
"""Errors at which the form of a list is named."""


class PlanError(ConfigError):
    """A plan that cannot be used.

    Attributes
    ----------
    lines : tuple of str
        One line for each error, with the name of the file and the path of the key in it.
    """

    def __init__(self, name: str, lines: Sequence[str] | str) -> None:
        every = [lines] if isinstance(lines, str) else lines
        self.lines = tuple(f"{name}: {line}" for line in every)
        more = f"; {len(every) - 1} more in `lines`" if len(every) > 1 else ""
        super().__init__(self.lines[0] + more)


def errors_at(
    name: str, where: str, caught: type[Exception] = RastercovError
) -> AbstractContextManager[None]:
    """Errors within as a `PlanError`: name of the file, path in it."""
    return errors_as(partial(PlanError, name), where, caught)


def lines_of(error: ValidationError, table: ReadByName, model: type[BaseModel]) -> list[str]:
    """Errors of pydantic as lines, one for each path."""
    wanted: dict[str, list[str]] = {}
    lines: dict[str, str] = {}
    for each in error.errors(include_url=False):
        kind, path = each["type"], _path(each["loc"], table, each["type"])
        if kind in WORDS:
            words = wanted.setdefault(path, [])
            text = WORDS[kind].format(**each.get("ctx", {}))
            words += [text] if text not in words else []
            if kind in OF_LISTS and (form := _form_of(each["loc"], model)):
                words = [form]
            lines[path] = f"{path}: expected {' or '.join(words)}, got {shown(each['input'])}"
            if each.get("ctx", {}).get("le") == 1:
                lines[path] += share_meant(each["input"])
        elif kind == "missing":
            lines[path] = f"{path}: expected an entry, got none; add it"
        elif kind == "extra_forbidden":
            *inner, name = each["loc"]
            known = sorted(_entries(inner, model))
            line = _known_name(known, str(name))
            if tags := _entries(inner[:-1], model).get(str(name)):
                line = f"{', '.join(known)} for {inner[-1]}, got {shown(name)}, which goes with "
                line += f"{first_of(tags, 2)}; leave it out"
            lines[path] = f"{path}: expected {line}"
            if not tags and (places := first_of(_tables_with(str(name), model), 2)):
                lines[path] += f", or put it {places}"
        elif kind == "union_tag_not_found":
            tag = each["ctx"]["discriminator"].strip("'")
            lines[f"{path}.{tag}"] = f"{_join_path(path, tag)}: expected an entry, got none; add it"
        elif kind == "union_tag_invalid":
            context = each["ctx"]
            known = context["expected_tags"].replace("'", "").split(", ")
            path = _join_path(path, context["discriminator"].strip("'"))
            lines[path] = f"{path}: expected {_known_name(known, context['tag'])}"
        else:
            text = " ".join(each["msg"].removeprefix("Value error, ").split())
            lines[path] = f"{path}: {text}" if path else text
    return list(lines.values())


def _path(location: tuple[int | str, ...], table: object, kind: str) -> str:
    """Path of an error in the table, without the names of union members."""
    path, here = "", table
    for place, part in enumerate(location):
        is_last = place == len(location) - 1
        if isinstance(here, Mapping) and part in here:
            path, here = _join_path(path, str(part)), here[part]
        elif isinstance(here, list) and isinstance(part, int) and part < len(here):
            path, here = f"{path}[{part}]", here[part]
        elif is_last and kind == "missing":
            path = _join_path(path, str(part))
    return path


def _join_path(path: str, part: str) -> str:
    part = printable(part, 40)
    part = part if re.fullmatch("[A-Za-z0-9_-]+", part) else json.dumps(part)
    return f"{path}.{part}" if path else part


def _known_name(names: Sequence[str], name: str) -> str:
    """Known names beside an unknown one, those that are similar if there are many."""
    known = ", ".join(names) if len(names) < 13 else list_names(names, name)
    return f"{f'one of {known}' if names else 'no entry'}, got {shown(name)}; correct the name"


def _entries(location: Sequence[int | str], model: type[BaseModel]) -> dict[str, list[str]]:
    """Tags of the members of a union that have each entry of the table at a location."""
    models = _models_at(location, model)
    return {
        name: [tag for each in models if name in each.model_fields for tag in _tags_of(each)]
        for one in models
        for name in one.model_fields
    }


def _models_at(location: Sequence[int | str], model: type[BaseModel]) -> list[type[BaseModel]]:
    """Members of the table at a location."""
    models = [model]
    for part in location:
        fields = [each.model_fields for each in models]
        if hints := [of[part].annotation for of in fields if part in of]:
            models = [each for hint in hints for each in _models_in(hint)]
        elif tagged := [each for each in models if part in _tags_of(each)]:
            models = tagged
    return models


@cache
def _tables_with(name: str, model: type[BaseModel]) -> list[str]:
    """Places of the tables of a plan that have an entry, from the top."""
    places, level, known = list[str](), {"": [model]}, set[type[BaseModel]]()
    while level:
        below: dict[str, list[type[BaseModel]]] = {}
        for path, models in level.items():
            if any(name in each.model_fields for each in models):
                places.append(f"in [{path}]" if path else "at the top of the plan")
            for each in models:
                for key, field in each.model_fields.items() if each not in known else ():
                    below.setdefault(_join_path(path, key), []).extend(_models_in(field.annotation))
            known |= {*models}
        level = {path: models for path, models in below.items() if models}
    return places


def _form_of(location: Sequence[int | str], model: type[BaseModel]) -> str:
    """Form of a list by the text below its key, such as "[least, greatest]"; "" for none."""
    *inner, name = [part for part in location if isinstance(part, str)] or [""]
    for each in _models_at(inner, model):
        if (match := re.search(r"\[[^\]]+\]", texts_below_fields(each).get(name, ""))) is not None:
            return match[0] if not re.search(r"\d", match[0]) else f"a list such as {match[0]}"
    return ""


def _models_in(hint: object) -> list[type[BaseModel]]:
    """Models that an annotation names."""
    if isinstance(hint, type) and issubclass(hint, BaseModel):
        return [hint]
    return [model for each in get_args(hint) for model in _models_in(each)]


def _tags_of(model: type[BaseModel]) -> list[str]:
    """Names by which a member of a union is chosen."""
    fields = model.model_fields
    return [
        tag
        for name in ("generator", "goal")
        if name in fields
        for tag in get_args(fields[name].annotation)
    ]


NO_PLAN = "expected a plan (TOML), got a mesh file; name it in a plan, under [[meshes]]"
NO_CAMERA = "camera: expected an entry, got none; add it, or cameras as [cameras.NAME]"


class Plan(PlanModel):
    """A plan file; entries as in `sections`."""

    _path: Path = PrivateAttr(default=Path("plan.toml"))
    _mounts: Mounts | None = PrivateAttr(default=None)
    _is_given: bool = PrivateAttr(default=False)
    _stated: tuple[str, ...] = PrivateAttr(default=())
    _rooms: dict[str, Room] = PrivateAttr(default={})
    _site: Site | None = PrivateAttr(default=None)
    _there: Poses = PrivateAttr(default=Poses.of(np.zeros((0, 4, 4))))
    _n_given: int = PrivateAttr(default=0)
    _table: Table | None = PrivateAttr(default=None)

    @property
    def goal_of_groups(self) -> dict[str, str]:
        """Words on the separate goal of each group that has one, of a plan of `name_scene`."""
        return {
            group: f"goal {name}"
            for name, goal in self.goals.items()
            for group in goal.groups or ()
        }

    @property
    def path(self) -> Path:
        """The file."""
        return self._path

    @property
    def name(self) -> str:
        """Name of the file, without folders."""
        return self._path.name

    @property
    def folder(self) -> Path:
        """Folder that relative paths start from."""
        return self._path.parent

    def results(self) -> Path:
        """Folder of the results, below that of the plan; PlanError for another, or a link there."""
        name = self.outputs.folder or self.path.stem
        base, there = (os.path.realpath(each) for each in (self.folder, self.folder / name))
        if not (name.isprintable() and Path(there).is_relative_to(base)):
            raise PlanError(
                self.name,
                f"outputs.folder: expected a folder below that of the plan, got {shown(name)}; "
                "name another one with --out",
            )
        return self.folder / name

    @property
    def has_cameras(self) -> bool:
        """True where there are cameras, in the plan or given to it."""
        return self._mounts is not None or bool(self.camera_names or self.rigs)

    @property
    def mounts(self) -> Mounts:
        """The cameras and the rigs of them with their names.

        Raises
        ------
        PlanError
            For a plan without cameras, and for a rig that cannot be made.
        """
        if self._mounts is None:
            if not self.has_cameras:
                raise PlanError(self.name, NO_CAMERA)
            own = None if self.catalogue is None else self.folder / self.catalogue
            types = dict(self.cameras) if self.camera is None else {ONE_CAMERA: self.camera}
            built = {name: each.build(self.folder, own) for name, each in types.items()}
            rigs: dict[str, Camera | Rig] = {}
            for name, section in self.rigs.items():
                with errors_at(self.name, f"rigs.{name}"):
                    rigs[name] = section.build(self.folder, built, own)
            self._mounts = self._equip(Mounts.of({**built, **rigs}))
        return self._mounts

    @model_validator(mode="after")
    def _check_features(self, info: ValidationInfo) -> Self:
        for each in hooks_of(PlanFeature):
            each.check(self, Path((info.context or {}).get("folder", ".")))
        if self.existing is not None and self.chooses_cameras and not self.is_still:
            raise ValueError("existing: expected a static scene, got another; leave it out")
        return self

    @property
    def is_still(self) -> bool:
        """True where nothing moves, neither a part of the scene nor what carries cameras."""
        return all(each.is_still(self) for each in hooks_of(PlanFeature))

    def _equip(self, mounts: Mounts) -> Mounts:
        """Mounts with the equipment of the plan."""
        equipment = self.build_equipment()
        for word, each in equipment.items():
            with errors_at(self.name, word):
                each.carried_by(mounts.rig.names)
        rig = mounts.rig._with(equipment={**mounts.rig.equipment, **equipment})
        return replace(mounts, rig=rig)

    def build_equipment(self) -> dict[str, Equipment]:
        """Equipment of the cameras; PlanError where there can be none."""
        built: dict[str, Equipment] = {}
        for each in hooks_of(PlanFeature):
            with errors_at(self.name, each.word):
                if (own := each.equipment(self, self.folder)) is not None:
                    built[each.word] = own
        for device in devices():
            if (file := getattr(self, device.word)) is not None:
                with errors_at(self.name, device.word):
                    built[device.word] = device.of(self.folder / file)
        return built

    @property
    def there(self) -> Poses:
        """Mounts beside which others are chosen, first those that stay; none before `with_there`.

        The places of those that may move are candidates.
        """
        return self._there

    @property
    def n_given(self) -> int:
        """Number of those that stay."""
        return self._n_given

    def with_there(self, mounted: Poses, n_given: int) -> Self:
        """The same plan with cameras and rigs, of which the first stay."""
        other = self.model_copy()
        other._there, other._n_given = mounted, n_given
        return other

    @property
    def rig(self) -> Rig:
        """All cameras with their names, those of rigs too."""
        return self.mounts.rig

    @property
    def built_rooms(self) -> dict[str, Room]:
        """Rooms by name; none before `with_rooms`."""
        return self._rooms

    @property
    def site(self) -> Site | None:
        """Place on the earth; None before `with_rooms`."""
        return self._site

    def with_rooms(self, mesh: Mesh) -> Self:
        """The same plan with its rooms in a mesh, and what depends on its place on the earth.

        PlanError for what cannot be made.
        """
        other = self.model_copy()
        other._rooms, other._site = {}, mesh.site
        other.build_equipment()  # refuses what the site contradicts
        if other._mounts is not None:
            for each in hooks_of(PlanFeature):
                rig = each.site(other, other._mounts.rig)
                other._mounts = replace(other._mounts, rig=rig)
        for name, section in self.rooms.items():
            with errors_at(self.name, f"rooms.{name}"):
                other._rooms[name] = section.build(mesh, name)
        return other

    @property
    def table(self) -> Table | None:
        """Turntable below the part before cameras that are carried; None before `with_table`."""
        return self._table

    def with_table(self, table: Table) -> Self:
        """The same plan with its turntable."""
        other = self.model_copy()
        other._table = table
        return other

    def room(self, name: str) -> Room:
        """Room by its name; ConfigError for an unknown one."""
        if name not in self._rooms:
            known = ", ".join(self._rooms) or "none"
            raise ConfigError(f"expected a room, got {name!r}; rooms are {known}")
        return self._rooms[name]

    def with_cameras(self, rig: Rig) -> Self:
        """The same plan with other cameras, each a mount of its own; a rig with a rule is one."""
        other = self.model_copy()
        mounts = Mounts.of({"rig": rig}) if rig.is_one else Mounts.of_cameras(rig)
        other._mounts, other._is_given = self._equip(mounts), True
        return other

    def with_stated(self, row: int, camera: Camera) -> Self:
        """The same plan with a camera that a pose file states, unless the plan was given some."""
        if self._is_given or camera == self.rig.cameras[row]:
            return self
        other, name = self.model_copy(), self.rig.names[row]
        other._mounts = replace(self.mounts, rig=self.rig._with_camera(name, camera))
        other._stated += (f"{name}: the pose file's camera is used; it differs from the plan's",)
        return other

    def without_cameras(self) -> Self:
        """The same plan without cameras of its own, for those that are given to it."""
        other = self.model_copy(update={"camera": None, "cameras": {}, "rigs": {}})
        other._mounts = None
        return other

    def mounts_of(self, names: Sequence[str]) -> list[int]:
        """Mounts of an entry by its names; without names, rigs and cameras that are in no rig."""
        known = self.mounts.names
        if unknown := [name for name in names if name not in known]:  # of other cameras
            raise CameraError(
                f"expected a camera ({', '.join(known)}), got {unknown[0]!r}; correct the name"
            )
        if names:
            return [row for row, name in enumerate(known) if name in names]
        in_rigs = {each.camera for rig in self.rigs.values() for each in rig.cameras or []}
        return [row for row, name in enumerate(known) if name in self.rigs or name not in in_rigs]

    def cost_of(self, mount: str, place: float | None) -> float:
        """Cost of a camera or rig by its name at a place with a cost; 1 where none has one.

        A rig without a cost of its own has that of its cameras together.
        """
        given = [cost for cost in (self._own_cost(mount), place) if cost is not None]
        return sum(given) if given else 1.0

    def _own_cost(self, mount: str) -> float | None:
        if mount not in self.rigs:
            priced = self.cameras.get(mount)
            return None if priced is None else priced.cost
        rig = self.rigs[mount]
        if rig.cost is not None:
            return rig.cost
        if rig.cameras is None:
            return float(np.diff(self.mounts.starts)[self.mounts.names.index(mount)])
        return sum(self.cost_of(each.camera, None) for each in rig.cameras)

    def unit_of_result(self) -> tuple[str, str]:
        """Unit of results, "area" or "face"; and what makes it "face" if the plan does not."""
        rig = self.rig if self.has_cameras else None
        is_gated = rig is not None and is_joint(rig)
        if self.task.by is None and self.task.weight_by == "count" and not is_gated:
            return "face", "weight_by count applies to faces"
        if is_gated and self.task.weight_by == "count":
            raise ConfigError(
                "expected weight by area for a rig with a rule, got weight_by count; leave it out"
            )
        return unit_of_result(self.task.by, self.build_task(), self.engine, rig)

    @property
    def engine(self) -> Engine:
        """Method and samples of the plan."""
        return Engine(self.task.method, supersample=self.task.supersample)

    def build_task(self, views: int | None = None) -> Task:
        """The task; `views` cameras a face for all groups where that is given."""
        own = {name: getattr(self.task, name) for name in Task.__dataclass_fields__}
        # A table by group matters for counting views only, not for what one camera covers.
        by_group = isinstance(self.task.views, dict)
        own["views"] = views or (1 if by_group else self.task.views)
        task = Task(**own)
        for each in hooks_of(PlanFeature):
            task = each.task(self, task)
        return task


class PlanFeature:
    """Hooks of a feature with entries in plans."""

    word = ""
    """Of its equipment, if any."""
    demand: Any = None
    """`Demand` on checked cameras."""

    def check(self, plan: Plan, folder: Path) -> None:
        """ValueError for entries that do not go together; files are in the folder."""

    def equipment(self, plan: Plan, folder: Path) -> Equipment | None:
        """Equipment of the cameras; ValueError where there can be none."""
        return None

    def is_still(self, plan: Plan) -> bool:
        """False where it moves a part of the scene, or what carries cameras."""
        return True

    def read_joints(self, body: BodyEntry, folder: Path) -> Jointed | None:
        """Joints of a body, where it has some; MeshError for a file that cannot be read."""
        return None

    def task(self, plan: Plan, task: Task) -> Task:
        """The task with thresholds of entries of its own."""
        return task

    def is_chosen(self, plan: Plan) -> bool:
        """True where there are candidates for it."""
        return False

    def site(self, plan: Plan, rig: Rig) -> Rig:
        """The rig at the site of the plan, which is now known."""
        return rig

    def add_choice(self, plan: Plan, rig: Rig | None) -> Plan:
        """The plan with the equipment of a rig; for None without any, and all that needs it."""
        return plan


def moving_bodies(bodies: Sequence[BodyEntry], folder: Path, name: str) -> list[Jointed]:
    """Bodies with joints of those of a file; PlanError for one that cannot be read."""
    result = list[Jointed]()
    for row, body in enumerate(bodies):
        with errors_at(name, f"bodies[{row}]"):
            own = (each.read_joints(body, folder) for each in hooks_of(PlanFeature))
            result += [each for each in own if each is not None]
    return result


def read_plan(path: StrPath) -> Plan:
    """Plan of a TOML file.

    Raises
    ------
    PlanError
        A `ConfigError`, whose `lines` has an entry for each fault: unknown and missing entries,
        values outside their limits, files that are not there.
    """
    try:
        table = read_toml(path)
    except UnreadableError as error:
        name = path
        line = str(error)
        if isinstance(error, UnparsedError):
            name = Path(path).name
            line = NO_PLAN if suffix_of(path) in READERS else line
        raise PlanError(printable(str(name)), line) from None
    return plan_of(table, Path(path))


def plan_of(table: ReadByName, path: Path = Path("plan")) -> Plan:
    """Plan of the entries of a file, or of a mapping with the same; errors as of `read_plan`.

    Files are relative to the folder of `path`, which names the plan.
    """
    own = table.get("catalogue")
    context = {"folder": path.parent, "catalogue": own and path.parent / str(own)}
    try:
        plan = Plan.model_validate(table, context=context)
    except ValidationError as error:
        raise PlanError(path.name, lines_of(error, table, PlanModel)) from None
    plan._path = path
    return plan


def schema() -> ByName:
    """JSON schema of plan files, for editors."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema"} | (
        PlanModel.model_json_schema() | {"title": "rastercov plan"}
    )
