"""Forms of what a page sends: its rig, its questions, and a drawing."""

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from rastercov.base import ByName, ConfigError, ReadByName
from rastercov.page.rig_state import LONGEST_NAME, MOST_STATIONS
from rastercov.placement.plan.file import lines_of

Number = Annotated[float, Field(allow_inf_nan=False)]
Matrix = Annotated[list[Number], Field(min_length=16, max_length=16)]
Point = Annotated[list[Number], Field(min_length=3, max_length=3)]
Name = Annotated[str, Field(min_length=1, max_length=LONGEST_NAME)]
Thresholds = dict[str, Number | int | bool | str | None]


class Action(BaseModel):
    """Request of a page; unknown entries and values of another type are errors."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class Taken(BaseModel):
    """Part of the rig of a page; what only describes it is ignored."""

    model_config = ConfigDict(strict=True, frozen=True)


class TakenStation(Taken):
    """A station."""

    id: int
    name: Name
    camera: Name
    pose: Matrix
    is_on: bool


class TakenCamera(Taken):
    """A camera, as `Camera.from_dict` reads it, and its own thresholds."""

    plain: ByName
    task: Thresholds | None = None


class TakenDevice(Taken):
    """A piece of equipment; one that rides has no pose."""

    id: str
    pose: Matrix | None


class TakenRig(Taken):
    """The rig, see `RigState`."""

    stations: Annotated[list[TakenStation], Field(max_length=MOST_STATIONS)]
    cameras: dict[Name, TakenCamera]
    task: Thresholds
    needed: dict[str, int] | None = None
    devices: list[TakenDevice] = []


class Of(Action):
    """Subject of a question: a rig, the time that is shown, see `Scene.place`, and the goal."""

    rig: TakenRig | None = None
    at: list[Number] = []
    goal: Annotated[str, Field(max_length=LONGEST_NAME)] = ""


class Stored(Action):
    """Changes of what a page has stored: its steps after the first `keep`, and the rest."""

    revision: int
    keep: Annotated[int, Field(ge=0)]
    steps: list[Any]
    rest: ByName


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


def check_entries(form: type[Action], entries: ReadByName) -> Any:
    """Entries in a form; ConfigError in one line, of the first that is not."""
    try:
        return form.model_validate(entries)
    except ValidationError as error:
        raise ConfigError(lines_of(error, entries, form)[0].removeprefix(": ")) from None
