"""Fields of a dataclass checked by the limits in their annotations.

A limit is declared once, as `Annotated[float, Gt(0), Le(90), Doc("...")]`. It serves the
constructor (`check_limits`), the command line (`Doc` is the help of the option) and plan files
(pydantic reads the same annotations).
"""

import dataclasses
import functools
import math
from collections.abc import Callable
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

from annotated_types import Ge, Gt, Le
from typing_extensions import Doc

from rastercov.base.arguments import check_choice, flag
from rastercov.base.checks import finite_number, share_meant, shown
from rastercov.base.errors import ConfigError


class Reads(NamedTuple):
    """Metadata of a number that may be given as text: a name, or a number with a unit.

    `read` makes the number of the text, or raises ValueError with what is wanted. `names` and the
    regular expression `pattern` are for schemas, `metavar` for the command line.
    """

    read: Callable[[str], float]
    names: tuple[str, ...]
    pattern: str
    metavar: str


def check_limits(value: Any) -> None:
    """Check all fields of a frozen dataclass, and replace each by its plain Python value.

    Raises
    ------
    ConfigError
        For the first field that is not of its type or not within its limits.
    """
    for name, hint in annotations_of(type(value)).items():  # type: ignore[arg-type] # hashable
        object.__setattr__(value, name, _checked(name, getattr(value, name), hint))


@functools.cache
def annotations_of(kind: type) -> dict[str, Any]:
    """Annotations of a dataclass by field, with their metadata."""
    hints = get_type_hints(kind, include_extras=True)
    return {field.name: hints[field.name] for field in dataclasses.fields(kind)}


def metadata_of(hint: Any) -> tuple[Any, ...]:
    """Metadata of an annotation; of the first member that has any, where it is a union."""
    if get_origin(hint) is Annotated:
        return tuple(get_args(hint)[1:])
    members = get_args(hint) if _is_optional(hint) else ()
    return next((found for member in members if (found := metadata_of(member))), ())


def reader_of(hint: Any) -> Reads | None:
    """`Reads` of an annotation, if it has any."""
    return next((each for each in metadata_of(hint) if isinstance(each, Reads)), None)


def documented(kind: type) -> dict[str, str]:
    """Description of each field of a dataclass that has a `Doc`."""
    return {
        name: each.documentation
        for name, hint in annotations_of(kind).items()
        for each in metadata_of(hint)
        if isinstance(each, Doc)
    }


def _is_optional(hint: Any) -> bool:
    return get_origin(hint) is Union or type(None) in get_args(hint)


def _checked(name: str, value: Any, hint: Any) -> Any:
    if _is_optional(hint):
        if value is None:
            return None
        hint = next(member for member in get_args(hint) if member is not type(None))
    kind = get_args(hint)[0] if get_origin(hint) is Annotated else hint
    if kind is bool:
        return flag(name, value)
    if get_origin(kind) is Literal:
        check_choice(name, value, get_args(kind))
        return value
    given, reader = value, reader_of(hint)
    if reader is not None and isinstance(value, str):
        try:
            value = reader.read(value)
        except ValueError as error:
            raise ConfigError(f"{name} must be {error}") from None
    number, limits = finite_number(value), metadata_of(hint)
    is_whole = kind is not int or number.is_integer()
    is_share = any(isinstance(limit, Le) and limit.le == 1 for limit in limits)
    meant = share_meant(number) if is_share else ""
    if math.isnan(number) or not is_whole or not all(_holds(limit, number) for limit in limits):
        raise ConfigError(f"{name} must be {_words(kind, limits)}, got {shown(given)}{meant}")
    return kind(number)


def _holds(limit: Any, number: float) -> bool:
    # Ignored types: annotated_types declares limits as anything that can be compared.
    if isinstance(limit, Gt):
        return number > float(limit.gt)  # type: ignore[arg-type]
    if isinstance(limit, Ge):
        return number >= float(limit.ge)  # type: ignore[arg-type]
    return number <= float(limit.le) if isinstance(limit, Le) else True  # type: ignore[arg-type]


def _words(kind: type, limits: tuple[Any, ...]) -> str:
    """Words for a type and its limits: "0 to 1", "more than 0, up to 90", "0 or more"."""
    above = next((limit.gt for limit in limits if isinstance(limit, Gt)), None)
    least = next((limit.ge for limit in limits if isinstance(limit, Ge)), None)
    most = next((limit.le for limit in limits if isinstance(limit, Le)), None)
    whole = ["a whole number"] if kind is int else []
    if least is not None and most is not None:
        return ", ".join([*whole, f"{least:g} to {most:g}"])
    low = [f"more than {above:g}"] if above is not None else []
    low += [f"{least:g} or more"] if least is not None else []
    high = [f"up to {most:g}"] if most is not None else []
    return ", ".join([*whole, *low, *high]) or "a number"
