"""Checks of arguments at the public edge: what was wanted, what came, in one line.

Serves whatever takes arrays, groups and options. numpy would take the real part of complex numbers,
read texts as numbers, count True as 1, and lose the mask of a masked array: each is refused here.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.checks import shown
from rastercov.base.errors import ConfigError, RastercovError, ResourceError
from rastercov.base.memory import check_memory

MOST_POSES = 10_000_000
"""Poses on a sphere: 1.3 GB of matrices."""

Kinds = type | tuple[type, ...]

LARGEST_COORDINATE = 1e30
"""Metres; its sixth power is still a float64, so that areas and volumes never overflow."""


def check_kind(
    name: str, value: Any, kind: Kinds, wanted: str, error: type[RastercovError]
) -> None:
    """Raise `error` unless a value is of that kind; `wanted` says what it must be."""
    if not isinstance(value, kind):
        raise error(f"{name} must be {wanted}, got {shown(value)}")


def check_choice(name: str, value: Any, choices: Sequence[str]) -> None:
    """Raise ConfigError unless a value is one of these words."""
    if not isinstance(value, str) or value not in choices:
        words = f"{', '.join(choices[:-1])} or {choices[-1]}"
        raise ConfigError(f"{name} must be {words}, got {shown(value)}")


def flag(name: str, value: Any) -> bool:
    """True or False, of Python or numpy; else ConfigError."""
    check_kind(name, value, (bool, np.bool_), "True or False", ConfigError)
    return bool(value)


def members(
    name: str, values: Any, kind: Kinds, wanted: str, error: type[RastercovError]
) -> tuple[Any, ...]:
    """Every one of `values`, which are all of that kind, else `error`; `wanted` names them all."""
    found: list[Any] = []
    try:
        if isinstance(values, str):  # a sequence of texts, and never meant as one
            raise TypeError
        each = iter(values)
    except TypeError:
        raise error(f"{name} must be {wanted}, got {shown(values)}") from None
    for value in each:
        check_kind(name, value, kind, wanted, error)
        found.append(value)
    return tuple(found)


def check_seed(seed: int) -> None:
    """Raise ConfigError for a seed that numpy does not take."""
    if seed < 0:
        raise ConfigError(f"seed must be 0 or more, got {shown(seed)}")


def finite_points(
    name: str, values: ArrayLike, shape: tuple[int, ...], wanted: str
) -> NDArray[np.float64]:
    """Finite coordinates of that shape, -1 for any length, within LARGEST_COORDINATE.

    Anything else is a ConfigError; `wanted` says what they must be.
    """
    array = checked_array(name, values, "iuf", wanted, ConfigError)
    sides = zip(array.shape, shape, strict=False)
    if array.ndim != len(shape) or any(side not in (got, -1) for got, side in sides):
        raise ConfigError(f"{name} must be {wanted}, got shape {array.shape}")
    points = owned(name, array, np.float64)
    if not (np.abs(points) <= LARGEST_COORDINATE).all():
        limit = f"within ±{LARGEST_COORDINATE:g}"
        raise ConfigError(f"{name} must be {wanted}, {limit}, got {shown(values)}")
    return points


def checked_array(
    name: str, values: ArrayLike, kinds: str, wanted: str, error: type[RastercovError]
) -> NDArray[Any]:
    """Array of `values` if its dtype is one of `kinds` (or it is empty), else `error`.

    Nothing is copied: an array that repeats one row without storing it stays small.
    """
    try:
        array = np.asarray(values)
    except MemoryError:
        raise ResourceError(
            f"{name} take more than the memory of this machine; pass fewer"
        ) from None
    except ValueError:
        raise error(f"{name} must be {wanted}, got rows of unequal length") from None
    except Exception:  # whatever conversion an object brings
        raise error(f"{name} must be {wanted}, got {type(values).__name__}") from None
    if array.size and array.dtype.kind not in kinds:
        raise error(f"{name} must be {wanted}, got dtype {array.dtype}; convert them first")
    rows = values if isinstance(values, list | tuple) else ()
    if np.ma.is_masked(values) or any(np.ma.is_masked(row) for row in rows):
        raise error(f"{name} must be {wanted}, got masked entries; fill them or leave them out")
    return array


def check_room(name: str, values: Any) -> None:
    """Raise ResourceError where an array, each number in 8 bytes, takes more memory than is free.

    An array that repeats one row without storing it can be larger than what it takes.
    """
    if isinstance(values, np.ndarray):
        check_memory(name, 8 * values.size, "pass fewer")


def owned(name: str, array: NDArray[Any], kind: type) -> NDArray[Any]:
    """Copy of an array as numbers of that kind, in C order.

    Raises
    ------
    ResourceError
        Before any memory is taken, where the copy takes more than is free.
    """
    check_room(name, array)
    with np.errstate(over="ignore"):  # longer floats become inf, and are found to be
        return np.array(array, dtype=kind, order="C")
