"""What the entries of a plan file are made of: numbers with limits, files, directions, boxes.

Serves `model` and `generators`. Lengths are metres, files are relative to the plan.
"""

import math
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationInfo


class Entry(BaseModel):
    """A table of the plan: unknown entries and values of another type are errors."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


def _file(name: str, info: ValidationInfo) -> str:
    """`name`, when it names a file beside the plan."""
    path = Path((info.context or {}).get("folder", "."), name)
    try:
        found = path.is_file()
    except (OSError, ValueError):  # too long, or with a zero byte
        found = False
    if not found:
        raise ValueError(f"wanted a file, got {name!r}, and there is no {path}; correct the name")
    return name


def ascending(pair: list[float]) -> list[float]:
    """`pair`, when its first number is not above its second."""
    if not pair[0] <= pair[1]:
        raise ValueError(f"wanted [least, greatest] with least <= greatest, got {pair}")
    return pair


def a_direction(triple: list[float]) -> list[float]:
    """`triple`, when it is not zero."""
    if not any(triple):
        raise ValueError("wanted a direction, got [0, 0, 0]")
    return triple


def only_one(entry: BaseModel, names: tuple[str, ...]) -> None:
    """ValueError unless exactly one of these is given."""
    given = [name for name in names if getattr(entry, name) is not None]
    if len(given) != 1:
        got = " and ".join(given) or "none"
        raise ValueError(f"wanted one of {', '.join(names)}, got {got}; give exactly one")


def both_or_none(entry: Any) -> None:
    """ValueError unless low and high are corners of a box, or both left out."""
    if (entry.low is None) != (entry.high is None):
        raise ValueError("low and high come together; give both or neither")
    if entry.low is not None and not all(
        a <= b for a, b in zip(entry.low, entry.high, strict=True)
    ):
        raise ValueError(f"wanted low <= high on every axis, got {entry.low} and {entry.high}")


def among(names: Collection[str]) -> Callable[[str], str]:
    """What lets one of these names pass, and no other string."""

    def check(name: str) -> str:
        if name not in names:
            raise ValueError(f"wanted one of {', '.join(names)}, got {name!r}")
        return name

    return check


Number = Annotated[float, Field(allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0, le=1)]
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
    """Limits as a pair, [0, inf] where none are given."""
    return (0.0, math.inf) if pair is None else (pair[0], pair[1])
