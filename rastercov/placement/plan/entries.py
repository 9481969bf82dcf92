"""Entries of plan files: tables with limits, and the types of their values.

Types of entries are numbers with limits, files, directions and boxes. `fields_of` makes entries of
the fields of a dataclass, so that a threshold and its limits are declared once. Lengths are metres,
files are relative to the plan.
"""

import ast
import inspect
import math
import sys
from collections.abc import Callable, Collection, Sequence
from dataclasses import MISSING, fields
from functools import cache
from itertools import pairwise
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Literal, NamedTuple, TypeVar, get_args, get_origin

import numpy as np
from annotated_types import Le
from numpy.typing import NDArray
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    ValidationInfo,
    WrapValidator,
    create_model,
)
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema

from rastercov.base import ByName, hooks_of, shown
from rastercov.base.arguments import (
    MOST_POSES,
    Quantity,
    Reads,
    annotations_of,
    document_fields,
    reader_of,
)
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.arrays import matrices_of, rotation_about

Value = TypeVar("Value")
Boxed = TypeVar("Boxed", bound=Any)


class Entry(BaseModel):
    """A table of the plan: unknown entries and values of another type are errors."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, defer_build=True)

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> Any:
        """Schema with the text below each field as its description.

        pydantic can take it, too, but would read the sources at each start, 0.25 s.
        """
        result = handler(core)
        properties = handler.resolve_ref_schema(result).get("properties", {})
        for name, words in texts_below_fields(cls).items():
            properties[name].setdefault("description", words)
        return result


class PlanSections(NamedTuple):
    """Hooks of a feature with entries in sections of a plan: the classes that have these.

    Functions give its generators of candidates, and those that carry the views of others.
    """

    plan: type[Entry] = Entry
    task: type[Entry] = Entry
    best: type[Entry] = Entry  # of goal best_coverage beside cameras
    candidates: type[Entry] = Entry
    counting: type[Entry] = Entry  # of the task beside thresholds
    cameras: type[Entry] = Entry
    bodies: type[Entry] = Entry
    rig: type[Entry] = Entry
    selection: type[Entry] = Entry
    generators: Callable[[], tuple[type[Entry], ...]] = tuple
    carried: Callable[[], tuple[type[Entry], ...]] = tuple


def extend_entry(section: str, base: type[Entry] = Entry) -> Any:
    """Entry with those of all features in a section, by its name in `PlanSections`."""
    own = [getattr(each, section) for each in hooks_of(PlanSections)]
    others = [each for each in own if each is not Entry]
    return create_model(f"{section} of features", __base__=(*others, base))


def texts_below_fields(entry: type) -> dict[str, str]:
    """Text below each field of an entry and of those that it extends."""
    texts: dict[str, str] = {}
    for kind in reversed(entry.__mro__):
        if not issubclass(kind, Entry):
            continue
        for field, below in pairwise(_bodies(kind.__module__).get(kind.__name__, ())):
            match field, below:
                case ast.AnnAssign(target=ast.Name(name)), ast.Expr(ast.Constant(str(words))):
                    texts[name] = inspect.cleandoc(words)
    return texts


@cache
def _bodies(module: str) -> dict[str, list[ast.stmt]]:
    """Statements of each class of a module."""
    tree = ast.parse(inspect.getsource(sys.modules[module]))
    return {node.name: node.body for node in tree.body if isinstance(node, ast.ClassDef)}


def fields_of(
    source: type,
    *,
    base: type[Entry] = Entry,
    is_optional: bool = False,
    leave_out: Collection[str] = (),
) -> Any:
    """Entry with fields of a dataclass: their types, limits, defaults.

    Parameters
    ----------
    source : type
        Dataclass; fields with a `Doc` are taken, whose other `Annotated` metadata are limits.
    base : type
        Entry to add them to.
    is_optional : bool
        None is the default of every field, and allowed.
    leave_out : collection of str
        Fields that the section declares itself.
    """
    types, by_name = annotations_of(source), {field.name: field for field in fields(source)}
    columns: ByName = {}
    for name, words in document_fields(source).items():
        if name in leave_out:
            continue
        made, hint = by_name[name].default_factory, _plan_type(types[name])
        default = by_name[name].default if made is MISSING else made()
        if is_optional:
            default, hint = None, hint | None
        own = {} if default is MISSING else {"default": default}
        columns[name] = (hint, Field(**own, description=words))
    return create_model(f"{source.__name__}Fields", __base__=base, **columns)


def value_of(entry: BaseModel, kind: type[Value], **others: Any) -> Value:
    """Dataclass value from the fields of an entry that have its names, and `others`."""
    names = [field.name for field in fields(kind)]  # type: ignore[arg-type] # a dataclass
    own = {name: getattr(entry, name) for name in names if name in type(entry).model_fields}
    tuples = {name: tuple(value) for name, value in own.items() if isinstance(value, list)}
    return kind(**(own | tuples | others))


def _plan_type(hint: object) -> Any:
    """Annotation of a field in a plan: lists for tuples; no infinity or NaN in a number.

    An upper limit excludes both already.
    """
    if NoneType in get_args(hint):
        return _plan_type(next(each for each in get_args(hint) if each is not NoneType)) | None
    kind, *limits = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    if get_args(kind) == (float, float, float):
        return Triple
    if kind is float and not any(isinstance(limit, Le) for limit in limits):
        hint = Annotated[hint, Field(allow_inf_nan=False)]
    reader = reader_of(hint)
    return hint if reader is None else Annotated[hint, _read(hint, reader)]


def _read(hint: object, reader: Reads) -> WrapValidator:
    """Validator that reads text, with names and numbers with units in the schema."""

    def number(value: object, check: Callable[[Any], Any]) -> Any:
        try:
            given = reader.read(value) if isinstance(value, str) else value
        except ValueError as error:
            raise ValueError(f"expected {error}") from None
        check_result = check(float(given) if isinstance(given, Quantity) else given)
        return given if isinstance(given, Quantity) else check_result

    quantity = Annotated[str, Field(pattern=f"^({reader.pattern})$")]
    shown = hint | quantity
    if reader.names:
        shown |= Literal[reader.names]
    return WrapValidator(number, json_schema_input_type=shown)


def _file(name: str, info: ValidationInfo) -> str:
    """`name`; ValueError unless it is a file, relative to the plan."""
    path = Path((info.context or {}).get("folder", "."), name)
    which = "does not exist"
    try:
        if path.is_file():
            return name
        if path.is_dir():
            which = "is a folder"
    except (OSError, ValueError):  # too long, or with a zero byte
        pass
    raise ValueError(f"expected a file, got {str(path)!r}, which {which}; correct the name")


def ascending(pair: list[float]) -> list[float]:
    """`pair`; ValueError where its first number is above its second."""
    if not pair[0] <= pair[1]:
        raise ValueError(f"expected [least, greatest] in this order, got {pair}; swap them")
    return pair


def one_or_two(value: object) -> object:
    """A number, or a list of it alone, as the pair of both limits."""
    values = value if isinstance(value, list) else [value]
    if len(values) > 2:
        raise ValueError(
            f"expected [lowest, highest] or one number, got {shown(values)}; repeat the entry for "
            "each of several"
        )
    return values * 2 if len(values) == 1 else value


def a_direction(triple: list[float]) -> list[float]:
    """`triple`; ValueError where it is zero."""
    if not any(triple):
        raise ValueError("expected a direction, got [0, 0, 0]; give another")
    return triple


def only_one(entry: BaseModel, names: tuple[str, ...]) -> None:
    """ValueError unless exactly one of these is given."""
    given = [name for name in names if getattr(entry, name) is not None]
    if len(given) != 1:
        got = " and ".join(given) or "none"
        raise ValueError(f"expected one of {', '.join(names)}, got {got}; give exactly one")


def together(entry: BaseModel, one: str, other: str) -> None:
    """ValueError where one of two entries is given and the other is not."""
    if (getattr(entry, one) is None) != (getattr(entry, other) is None):
        raise ValueError(f"expected {one} and {other}, got one of them; give both or neither")


def both_or_none(entry: Boxed) -> Boxed:
    """The entry; ValueError unless low and high are corners of a box, or both left out."""
    together(entry, "low", "high")
    if entry.low is not None and not all(
        a <= b for a, b in zip(entry.low, entry.high, strict=True)
    ):
        raise ValueError(f"expected low <= high, got {entry.low} and {entry.high}; swap them")
    return entry


def among(names: Collection[str]) -> tuple[AfterValidator, FieldInfo]:
    """Metadata of strings that refuse every one but these names, which the schema lists."""

    def check(name: str) -> str:
        if name not in names:
            raise ValueError(f"expected one of {', '.join(names)}, got {name!r}; correct it")
        return name

    return AfterValidator(check), Field(json_schema_extra={"enum": list(names)})


Some = Annotated[list[Value], Field(min_length=1)]
"""A list that is not empty."""
Number = Annotated[float, Field(allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=1, le=MOST_POSES)]
Angle = Annotated[float, Field(ge=0, le=180)]
Name = Annotated[str, Field(min_length=1)]
File = Annotated[str, AfterValidator(_file)]
Triple = Annotated[list[Number], Field(min_length=3, max_length=3)]
Direction = Annotated[Triple, AfterValidator(a_direction)]
Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]
Limits = Annotated[
    list[Annotated[float, Field(ge=0)]],
    Field(min_length=2, max_length=2),
    AfterValidator(ascending),
]


def no_limit(pair: list[float] | None) -> tuple[float, float]:
    """Limits as a pair; (0, inf) for None."""
    return (0.0, math.inf) if pair is None else (pair[0], pair[1])


class BaseEntry(Entry):
    """Pose: rotation about an axis through the origin, then translation."""

    axis: Direction = [0.0, 0.0, 1.0]
    """Axis of the rotation, through the origin."""
    angle_deg: Number = 0.0
    """Angle of the rotation, counter-clockwise when the axis points at you."""
    translation: Triple = [0.0, 0.0, 0.0]
    """Translation after the rotation, m."""

    def matrix(self) -> NDArray[np.float64]:
        """(4, 4) rigid transform."""
        turn = rotation_about(self.axis, math.radians(self.angle_deg))
        return matrices_of(turn, self.translation)


class Table(NamedTuple):
    """Turntable below a part.

    Attributes
    ----------
    axis, centre : (3,) sequence of float
        Axis of its rotation, and a point on it, metres.
    degrees : float
        Range of the rotation.
    stationary : Mesh or None
        Scene that does not turn with the part, as it is when the angle is 0.
    """

    axis: Sequence[float]
    centre: Sequence[float]
    degrees: float
    stationary: Mesh | None
