"""Edits that a page asks for: their form, and what each does to a state or to a lens."""

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from typing import Annotated, Any, Literal, Union, get_type_hints

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model

from rastercov.base.checks import image_side, number, positive, shown
from rastercov.base.errors import CameraError, ConfigError
from rastercov.base.files import printable
from rastercov.base.format import ByName, ReadByName, first_of
from rastercov.base.memory import FloatArray
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.viewpoints import look_at
from rastercov.core.coverage.task import Task
from rastercov.page.rig_state import (
    LONGEST_NAME,
    MOST_STATIONS,
    RigState,
    Station,
    checked_pose,
)

Settle = Callable[[FloatArray, FloatArray], FloatArray]
"""Pose that the constraints allow, from the wanted pose and the one before."""

Number = Annotated[float, Field(allow_inf_nan=False)]
Matrix = Annotated[list[Number], Field(min_length=16, max_length=16)]
Point = Annotated[list[Number], Field(min_length=3, max_length=3)]
Name = Annotated[str, Field(min_length=1, max_length=LONGEST_NAME)]
Thresholds = dict[str, Number | int | bool | str | None]


class Action(BaseModel):
    """Request of a page; unknown entries and values of another type are errors."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


Edited = tuple[RigState, str]
"""The state after an edit, and words for the history."""
_EDITS: dict[str, Callable[..., Edited]] = {}
_FORMS: list[type[Action]] = []


def _edit(name: str) -> Callable[[Callable[..., Edited]], Callable[..., Edited]]:
    """Make a function an edit: its arguments after state and `settle` are those of the request."""

    def added(apply: Callable[..., Edited]) -> Callable[..., Edited]:
        hints = get_type_hints(apply, include_extras=True)
        own = {
            n: (hint, ...) for n, hint in hints.items() if n not in ("state", "settle", "return")
        }
        form: Any = create_model(name, __base__=Action, do=(Literal[name], ...), **own)  # type: ignore[call-overload] # fields by name
        _EDITS[name] = apply
        _FORMS.append(form)
        return apply

    return added


def applied(action: Any, state: RigState, settle: Settle) -> Edited:
    """The state after an edit, and words for the history; none for the faces as they are."""
    own = {name: getattr(action, name) for name in type(action).model_fields if name != "do"}
    return _EDITS[action.do](state, settle, **own)


@_edit("none")
def _nothing(state: RigState, settle: Settle) -> Edited:
    return state, ""


@_edit("pose")
def _move(state: RigState, settle: Settle, station: int, pose: Matrix) -> Edited:
    """With the pose of a station, or the nearest one that is allowed."""
    own = state.station(station)
    wanted = np.reshape(pose, (4, 4))
    return state.with_pose(own.id, settle(wanted, own.pose)), f"move {own.name}"


@_edit("device")
def _place(state: RigState, settle: Settle, device: Name, pose: Matrix) -> Edited:
    """With the place of a piece of equipment, by its word and number."""
    for word, own in state.whole.equipment.items():
        for row, name in enumerate(own.names):
            if device == f"{word} {row}" and not own.rides[row]:
                moved = own.at(row, checked_pose(np.reshape(pose, (4, 4))))
                return replace(state, whole=state.whole._equipped(word, moved)), f"move {name}"
    raise ConfigError(f"expected equipment of the scene, got {shown(device)}; choose another")


@_edit("aim")
def _aim(state: RigState, settle: Settle, station: int, point: Point) -> Edited:
    """With a point in the middle of a station's image; its up stays as near as it can."""
    own = state.station(station)
    eye = own.pose[:3, 3]
    if not np.linalg.norm(np.array(point) - eye) >= 1e-9:
        raise ConfigError(
            "expected a point away from the camera, got its centre; choose another point"
        )
    aimed = look_at(eye[None], np.array([point]), tuple(-own.pose[:3, 1]))[0]
    return state.with_pose(own.id, aimed), f"aim {own.name}"


@_edit("add")
def _add(state: RigState, settle: Settle, camera: Name, pose: Matrix) -> Edited:
    wanted = np.reshape(pose, (4, 4))
    return state.with_type(camera).with_new(camera, settle(wanted, wanted)), "add a camera"


@_edit("duplicate")
def _duplicate(state: RigState, settle: Settle, station: int) -> Edited:
    return state.with_copy(station), f"duplicate {state.station(station).name}"


@_edit("delete")
def _delete(state: RigState, settle: Settle, station: int) -> Edited:
    return state.without(station), f"delete {state.station(station).name}"


@_edit("rename")
def _rename(state: RigState, settle: Settle, station: int, name: str) -> Edited:
    before = state.station(station).name
    return state.renamed(station, name), f"rename {before}"


@_edit("switch")
def _switch(state: RigState, settle: Settle, station: int, is_on: bool) -> Edited:
    """With a station that takes part in the network, or does not."""
    own = state.station(station)
    words = f"switch {own.name} {'on' if is_on else 'off'}"
    return state.with_station(replace(own, is_on=is_on)), words


@_edit("use")
def _use(state: RigState, settle: Settle, station: int, camera: Name) -> Edited:
    """With another camera at a station, of the rig or of the catalogue."""
    own = state.station(station)
    return state.with_type(camera).using(own.id, camera), f"use {camera} at {own.name}"


@_edit("camera")
def _camera(state: RigState, settle: Settle, camera: Name, changes: dict[str, Number]) -> Edited:
    """With other values of a camera, at all stations that have it."""
    made = changed(state.camera(camera), changes)
    return state.with_camera(camera, made), f"change the lens of {camera}"


@_edit("new_camera")
def _new_camera(state: RigState, settle: Settle, name: Name, source: Name) -> Edited:
    """With a further camera, like another one or one of the catalogue."""
    if name in state.cameras:
        raise ConfigError(f"expected a new name, got {shown(name)}, which is taken; change it")
    made = state.with_type(source).camera(source)
    return state.with_camera(name, made), f"add camera type {name}"


@_edit("task")
def _thresholds(state: RigState, settle: Settle, changes: Thresholds) -> Edited:
    return state.with_task(_task(state.task, changes)), f"change {', '.join(changes)}"


def _task(task: Task, changes: ReadByName) -> Task:
    """The task with other thresholds; ConfigError for an unknown one."""
    known = asdict(task)
    if unknown := [name for name in changes if name not in known]:
        raise ConfigError(
            f"expected one of {first_of(list(known))}, got {shown(unknown[0])}; correct it"
        )
    return Task(**(known | dict(changes)))


class KeptStation(BaseModel):
    """A station as a page has it; what only describes it is ignored."""

    id: int
    name: Name
    camera: Name
    pose: Matrix
    is_on: bool


class KeptCamera(BaseModel):
    """A camera as a page has it."""

    plain: ByName


class KeptRig(BaseModel):
    """A rig that a page kept while the program was gone."""

    stations: Annotated[list[KeptStation], Field(max_length=MOST_STATIONS)]
    cameras: dict[Name, KeptCamera]
    task: Thresholds


@_edit("restore")
def _restore(state: RigState, settle: Settle, rig: KeptRig) -> Edited:
    """The rig that a page kept, in place of the present one."""
    if len({each.id for each in rig.stations}) != len(rig.stations):
        raise ConfigError("expected distinct station ids, got duplicates; correct them")
    made = replace(state, stations=())
    for name, camera in rig.cameras.items():
        made = made.with_camera(name, Camera.from_dict(camera.plain))
    stations = []
    for each in rig.stations:
        made.camera(each.camera)
        pose = checked_pose(np.reshape(each.pose, (4, 4)))
        stations.append(Station(each.id, each.name, each.camera, pose, each.is_on))
    made = replace(made, stations=tuple(stations)).with_task(_task(Task(), rig.task))
    return made, "restore the rig"


class Step(Action):
    """Take back the last edit, or make the one again that was undone last."""

    do: Literal["undo", "redo"]


class Constrain(Action):
    """Keep the constraints of the plan, or only show them."""

    do: Literal["constraints"]
    is_kept: bool


class OfVariant(Action):
    """Keep the present rig as a variant of a name, show a variant, or drop it."""

    do: Literal["keep_variant", "show_variant", "drop_variant"]
    name: Name


class Request(Action):
    """An edit, and the faces to give back after it.

    `at` is the time that is shown, see `Scene.placed`, and `goal` the goal.
    """

    revision: int
    mode: str
    options: dict[str, Number | int | bool | str] = {}
    station: int | None = None
    is_drag: bool = False
    at: list[Number] = []
    goal: Annotated[str, Field(max_length=LONGEST_NAME)] = ""
    # mypy reads no union that is made from a table.
    action: Annotated[Union[(*_FORMS, Step, Constrain, OfVariant)], Field(discriminator="do")]  # type: ignore[valid-type]


MOST_OF_DRAWING = 16 << 20
"""Bytes of the image of a drawing."""
Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]


class Drawing(Action):
    """A drawing under the floor plan.

    Attributes
    ----------
    name : str
        Of its file.
    place : two pairs of floats
        a and b of its place in the plan, see `page/drawing.js`.
    opacity : float
    image : str
        PNG, JPEG or SVG, in base64; the page judges it before it is decoded.
    """

    name: Name
    place: Annotated[list[Pair], Field(min_length=2, max_length=2)]
    opacity: Annotated[float, Field(ge=0, le=1)]
    image: Annotated[
        str, Field(pattern="^[A-Za-z0-9+/]+=*$", max_length=4 * (MOST_OF_DRAWING // 3 + 1))
    ]


def request_of(entries: ReadByName) -> Request:
    """Request of a page; ConfigError in one line for what is none."""
    return checked(Request, entries)


def checked(form: type[Action], entries: ReadByName) -> Any:
    """Entries in a form; ConfigError in one line where they are not."""
    try:
        return form.model_validate(entries)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(printable(str(each), 40) for each in first["loc"])
        got = shown(first.get("input"))
        wanted = first["msg"].removeprefix("Input should be ")
        if first["type"] == "union_tag_invalid":  # whose message has the whole tag
            tag = first["ctx"]["discriminator"].strip("'")
            wanted = f"{tag} to be one of {first['ctx']['expected_tags']}"
        raise ConfigError(
            f"{place or 'request'}: expected {wanted}, got {got}; correct it"
        ) from None


Change = Callable[[Camera, Any], Camera]


def changed(camera: Camera, changes: ReadByName) -> Camera:
    """The camera with some of its values changed; see `_CHANGES`.

    Another field of view or focal length keeps the ratio of pixels and the coefficients of the
    lens; another width keeps the field of view.

    Raises
    ------
    CameraError
        For an unknown value, one outside its limits, or one that the camera cannot have.
    """
    for name, value in changes.items():
        if name not in _CHANGES:
            known = ", ".join(_CHANGES)
            raise CameraError(f"expected one of {known}, got {shown(name)}; correct it")
        camera = _CHANGES[name](camera, value)
    return camera


def _with_angle(camera: Camera, value: object) -> Camera:
    wanted = number("hfov_deg", value)
    if not camera.is_pinhole:
        raise CameraError(
            f"expected a pinhole for hfov_deg, got lens model {camera.model}; change fx"
        )
    if not 0.01 <= wanted <= 179:
        raise CameraError(f"expected hfov_deg of 0.01 to 179, got {shown(value)}; correct it")
    # cot of the sum of the angles on both sides of the centre c: (f^2 - c (w - c)) / (w f).
    half = 0.5 * camera.width / math.tan(math.radians(wanted))
    apart = camera.cx * (camera.width - camera.cx)
    return _scaled(camera, (half + math.sqrt(max(0.0, half**2 + apart))) / camera.fx)


def _scaled(camera: Camera, factor: float) -> Camera:
    """With focal lengths times a factor; the aperture keeps its diameter."""
    f = None if camera.focal_length is None else camera.focal_length * factor
    scaled = {name: getattr(camera, name) * factor for name in ("fx", "fy", "skew")}
    return replace(camera, **scaled, focal_length=f, product="")


def _with_magnification(camera: Camera, value: object) -> Camera:
    if camera.magnification is None:
        raise CameraError(
            f"expected a telecentric lens for magnification, got model {camera.model}; change fx"
        )
    return _scaled(camera, positive("magnification", value) / camera.magnification)


def _with_focus(camera: Camera, value: object) -> Camera:
    distance = positive("focus_distance", value)
    if camera.is_parallel:
        around, before = camera.focus_range, camera.focus_distance
        if around is not None:
            shift = 0.0 if before is None else distance - before
            around = (max(0.0, around[0] + shift), around[1] + shift)
        return replace(camera, focus_distance=distance, focus_range=around)
    aperture = camera.aperture
    if aperture is None:
        aperture = _focal_length(camera) / 2.8
    return replace(camera, focus_distance=distance, aperture=aperture, focus_range=None)


def _with_f_number(camera: Camera, value: object) -> Camera:
    if camera.is_parallel:
        return replace(camera, f_number=positive("f_number", value), focus_range=None)
    aperture = _focal_length(camera) / positive("f_number", value)
    distance = camera.focus_distance or max(1.0, 2 * _focal_length(camera))
    return replace(camera, focus_distance=distance, aperture=aperture, focus_range=None)


def _focal_length(camera: Camera) -> float:
    if camera.focal_length is None or camera.pixel_size is None:
        raise CameraError(
            "expected focal_length and pixel_size for the focus, got none; give both, or change "
            "focus_near and focus_far"
        )
    return camera.focal_length


def _with_range(camera: Camera, low: object, high: object) -> Camera:
    near, far = camera.focus_range or (0.0, math.inf)
    near = near if low is None else number("focus_near", low)
    far = far if high is None else number("focus_far", high)
    own: ByName = dict.fromkeys(("aperture", "focus_distance", "f_number"))
    return replace(camera, focus_range=(near, far), **own)


_CHANGES: Mapping[str, Change] = {
    "hfov_deg": _with_angle,
    **dict.fromkeys(
        ("fx", "px_per_m"),
        lambda camera, value: _scaled(camera, positive("fx", value) / camera.fx),
    ),
    "magnification": _with_magnification,
    "width": lambda camera, value: camera.resized(image_side("width", value) / camera.width),
    "focus_distance": _with_focus,
    "f_number": _with_f_number,
    "focus_near": lambda camera, value: _with_range(camera, value, None),
    "focus_far": lambda camera, value: _with_range(camera, None, value),
    "near": lambda camera, value: replace(camera, near=value),
}
"""Functions of the values of `rastercov.report.live.CAMERA_FIELDS`."""
