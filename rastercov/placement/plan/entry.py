"""Types of the entries of a plan file: numbers with limits, files, directions, boxes.

`fields_of` makes entries of the fields of a dataclass, so that a threshold and its limits are
declared once. Lengths are metres, files are relative to the plan.
"""

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin

from annotated_types import Le
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationInfo,
    create_model,
)

from rastercov.base.arguments import Reads, annotations_of, documented, reader_of

Value = TypeVar("Value")
Boxed = TypeVar("Boxed", bound=Any)


class Entry(BaseModel):
    """A table of the plan: unknown entries and values of another type are errors."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


def fields_of(
    source: type,
    words: Mapping[str, str] | None = None,
    *,
    base: type[Entry] = Entry,
    is_optional: bool = False,
    leave_out: Collection[str] = (),
) -> Any:
    """Entry with fields of a dataclass: their types, limits, defaults.

    Parameters
    ----------
    source : type
        Dataclass; `Annotated` metadata of its fields are limits.
    words : mapping of str to str
        Fields to take, in this order, and the description of each in the schema; by default those
        that have a `Doc`.
    base : type
        Entry to add them to.
    is_optional : bool
        None is the default of every field, and allowed.
    leave_out : collection of str
        Fields that the section declares itself.
    """
    words = documented(source) if words is None else words
    types, by_name = annotations_of(source), {field.name: field for field in fields(source)}
    columns: dict[str, Any] = {}
    for name in (each for each in words if each not in leave_out):
        field, hint = by_name[name], _plan_type(types[name])
        made = field.default_factory
        default = field.default if made is MISSING else made()
        if is_optional:
            default, hint = None, hint | None
        columns[name] = (hint, Field(default=default, description=words[name]))
    return create_model(f"{source.__name__}Fields", __base__=base, **columns)


def value_of(entry: BaseModel, kind: type[Value], **others: Any) -> Value:
    """Dataclass value from the fields of an entry that have its names, and `others`."""
    names = [field.name for field in fields(kind)]  # type: ignore[arg-type] # a dataclass
    own = {name: getattr(entry, name) for name in names if name in type(entry).model_fields}
    tuples = {name: tuple(value) for name, value in own.items() if isinstance(value, list)}
    return kind(**(own | tuples | others))


def _plan_type(hint: Any) -> Any:
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


def _read(hint: Any, reader: Reads) -> BeforeValidator:
    """Validator that reads text, with names and numbers with units in the schema."""

    def number(value: Any) -> Any:
        try:
            return reader.read(value) if isinstance(value, str) else value
        except ValueError as error:
            raise ValueError(f"wanted {error}") from None

    quantity = Annotated[str, Field(pattern=f"^({reader.pattern})$")]
    shown = hint | Literal[reader.names] | quantity
    return BeforeValidator(number, json_schema_input_type=shown)


def _file(name: str, info: ValidationInfo) -> str:
    """`name`; ValueError unless it is a file, relative to the plan."""
    path = Path((info.context or {}).get("folder", "."), name)
    try:
        found = path.is_file()
    except (OSError, ValueError):  # too long, or with a zero byte
        found = False
    if not found:
        raise ValueError(f"wanted a file, got {name!r}, and there is no {path}; correct the name")
    return name


def ascending(pair: list[float]) -> list[float]:
    """`pair`; ValueError where its first number is above its second."""
    if not pair[0] <= pair[1]:
        raise ValueError(f"wanted [least, greatest] with least <= greatest, got {pair}")
    return pair


def one_or_two(value: Any) -> Any:
    """A number, or a list of it alone, as the pair of both limits."""
    values = value if isinstance(value, list) else [value]
    return values * 2 if len(values) == 1 else value


def a_direction(triple: list[float]) -> list[float]:
    """`triple`; ValueError where it is zero."""
    if not any(triple):
        raise ValueError("wanted a direction, got [0, 0, 0]")
    return triple


def only_one(entry: BaseModel, names: tuple[str, ...]) -> None:
    """ValueError unless exactly one of these is given."""
    given = [name for name in names if getattr(entry, name) is not None]
    if len(given) != 1:
        got = " and ".join(given) or "none"
        raise ValueError(f"wanted one of {', '.join(names)}, got {got}; give exactly one")


def both_or_none(entry: Boxed) -> Boxed:
    """The entry; ValueError unless low and high are corners of a box, or both left out."""
    if (entry.low is None) != (entry.high is None):
        raise ValueError("low and high come together; give both or neither")
    if entry.low is not None and not all(
        a <= b for a, b in zip(entry.low, entry.high, strict=True)
    ):
        raise ValueError(f"wanted low <= high on every axis, got {entry.low} and {entry.high}")
    return entry


def among(names: Collection[str]) -> Callable[[str], str]:
    """Validator that refuses every string but these names."""

    def check(name: str) -> str:
        if name not in names:
            raise ValueError(f"wanted one of {', '.join(names)}, got {name!r}")
        return name

    return check


Number = Annotated[float, Field(allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=1)]
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
