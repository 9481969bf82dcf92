"""Types of arguments, checked by the annotations of the functions that take them.

Serves the functions of `placement` that a program calls with dozens of options: a mesh where a
camera belongs, a text for a number or NaN is refused by name before anything runs, instead of deep
inside. Limits stay with each function.

`guard` serves all public names: what a call raises that is no error of ours is looked into, and is
a ConfigError where the arguments do not fit the signature or its annotations. A call that succeeds
is not looked at.
"""

import builtins
import dataclasses
import functools
import inspect
import math
import sys
from collections.abc import Callable, Collection, Iterable, Mapping
from enum import Enum
from os import PathLike
from pathlib import Path
from types import ModuleType, NoneType, UnionType
from typing import Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.arguments import as_array, check_room, finite_number, is_inf, is_number, shown
from rastercov.base.errors import CameraError, ConfigError, MeshError, RastercovError
from rastercov.base.format import ByName, ReadByName, first_of

Given = ParamSpec("Given")
Result = TypeVar("Result")
Kind = TypeVar("Kind", bound=type)

ERRORS: dict[str, type[RastercovError]] = {"Mesh": MeshError, "Camera": CameraError}
"""By the name of the type that is wanted; for all others it is a ConfigError."""
ARRAY = get_args(ArrayLike) or (ArrayLike,)
"""Members of an annotation with ArrayLike: a union up to numpy 2.4, an alias from 2.5 on."""
ARRAYS = (np.ndarray, NDArray)
VARIADIC = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
WORDS = {float: "a number", int: "a whole number", bool: "True or False", str: "a string"}
WORDS[PathLike] = "a path"


def typed(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """Check the types of all arguments, by their annotations, before the function runs."""

    @functools.wraps(function)
    def check(*arguments: Given.args, **named: Given.kwargs) -> Result:
        _check_arguments(function, arguments, named)
        return function(*arguments, **named)

    return check


def guard(package: str) -> None:
    """Let all public callables of a package refuse wrong arguments by an error of ours."""
    module = sys.modules[package]
    for name in public_names(module):
        setattr(module, name, guarded_name(module, name))


def guarded_name(module: ModuleType, name: str) -> Any:
    """Function or class of a module that refuses wrong arguments, as `guard` makes of each."""
    thing = getattr(module, name)
    if inspect.isfunction(thing):
        thing = _guard_arguments(thing)
        setattr(sys.modules[thing.__module__], name, thing)  # where a pickle looks for it
    elif inspect.isclass(thing):
        guard_class(thing)
    return thing


def public_names(module: ModuleType) -> list[str]:
    """Names in `__all__`, or those of the functions and classes that a module defines."""
    own = [
        name
        for name, each in vars(module).items()
        if getattr(each, "__module__", "") == module.__name__ and not name.startswith("_")
    ]
    return list(getattr(module, "__all__", own))


def guard_class(kind: Kind) -> Kind:
    """The class, whose constructor and methods refuse wrong arguments by an error of ours."""
    if issubclass(kind, Enum):
        kind._missing_ = classmethod(_no_member)  # type: ignore[assignment] # as documented
    for owner in kind.__mro__:
        if not owner.__module__.startswith("rastercov.") or issubclass(owner, Exception):
            continue
        for name, value in list(vars(owner).items()):
            is_made = name == "__init__" and not getattr(owner, "_is_protocol", False)
            if is_made or not name.startswith("_"):
                if isinstance(value, classmethod | staticmethod):
                    setattr(owner, name, type(value)(_guard_arguments(value.__func__)))
                elif inspect.isfunction(value):
                    setattr(owner, name, _guard_arguments(value))
    return kind


def _guard_arguments(function: Callable[Given, Result]) -> Callable[Given, Result]:
    if hasattr(function, "is_guarded"):
        return function

    @functools.wraps(function)
    def call(*arguments: Given.args, **named: Given.kwargs) -> Result:
        try:
            return function(*arguments, **named)
        except (RastercovError, Warning, OSError):
            raise
        except Exception as error:
            try:
                _check_arguments(function, arguments, named)
            except RastercovError as wrong:
                raise wrong from error
            raise

    call.is_guarded = True  # type: ignore[attr-defined] # a mark of our own
    return call


def _no_member(kind: type[Enum], value: object) -> Enum | None:
    """A member that the class makes itself, by `_combine`, or an error."""
    member: Enum | None = getattr(kind, "_combine", lambda _: None)(value)
    if member is not None:
        return member
    names = ", ".join(kind.__members__)
    name = kind.__name__
    raise ConfigError(f"expected {name} to be one of {names} or its number, got {shown(value)}")


def _check_arguments(
    function: Callable[..., Any], arguments: tuple[Any, ...], named: ReadByName
) -> None:
    """Raise an error of ours where arguments do not fit a signature or its annotations."""
    signature = _signature(function)
    try:
        bound = signature.bind(*arguments, **named)
    except TypeError as error:
        raise ConfigError(_not_bound(function, signature, named, str(error))) from None
    hints = _hints(function)
    for name, value in bound.arguments.items():
        if signature.parameters[name].kind not in VARIADIC:
            check_type(name, value, hints.get(name, Any))


@functools.cache
def _signature(function: Callable[..., Any]) -> inspect.Signature:
    return inspect.signature(function)


def _not_bound(
    function: Callable[..., Any], signature: inspect.Signature, named: ReadByName, fault: str
) -> str:
    """Message for arguments that do not fit a signature, with those that it has."""
    all_of = [each for each in signature.parameters.values() if each.name not in ("self", "cls")]
    name = function.__qualname__.removesuffix(".__init__")
    unknown = [each for each in named if each not in signature.parameters]
    takes = [each.name for each in all_of if each.kind not in VARIADIC]
    if unknown and not any(each.kind == inspect.Parameter.VAR_KEYWORD for each in all_of):
        from difflib import get_close_matches

        fault = f"unknown argument {shown(unknown[0])}"
        if near := get_close_matches(unknown[0], takes, 1):
            return f"{name}: expected argument {near[0]}, got: {fault}; correct the name"
    if fault.startswith("missing"):
        missing = fault.split("'")[1]
        return f"{name}: expected argument {missing}, got none; give it"
    words = f"arguments {first_of(takes, 8)}" if takes else "no arguments"
    return f"{name}: expected {words}, got: {fault}"


def check_fields(value: object) -> None:
    """Check the types of all fields of a dataclass, by their annotations."""
    kind: Any = type(value)
    hints = _hints(kind)
    for field in dataclasses.fields(kind):
        if field.init:
            check_type(field.name, getattr(value, field.name), hints[field.name])


def check_type(name: str, value: object, hint: object) -> None:
    """Raise the error that goes with a type where a value is not of it."""
    if _is_array_like(hint):
        check_room(name, value)
    if not fits(value, hint):
        kinds = [kind.__name__ for kind in (hint, *get_args(hint)) if hasattr(kind, "__name__")]
        error = next((ERRORS[kind] for kind in kinds if kind in ERRORS), ConfigError)
        raise error(f"expected {name} to be {_expected_text(hint)}, got {shown(value)}")


class _Names(ByName):
    """Names of a module; those that only type checkers import mean any type."""

    def __missing__(self, name: str) -> Any:
        return Any


@functools.cache  # resolved at the first call, when all modules are there
def _hints(thing: object) -> ByName:
    known = _Names(vars(builtins) | vars(sys.modules[thing.__module__]))
    return get_type_hints(thing, localns=known)


def fits(value: Any, hint: object) -> bool:
    """True for a value that an annotation asks for."""
    kinds, origin = get_args(hint), get_origin(hint) or hint
    if hint is Any:
        return True
    if isinstance(value, str | PathLike) and "\0" in str(value):  # the system has no such name
        return False
    if _is_array_like(hint):
        others = [kind for kind in kinds if kind not in ARRAY]
        # ArrayLike has texts in it, which are meant only where paths are, too.
        others += [str] if Path in others else []
        if origin in ARRAYS and np.ndim(value if _is_numeric(value) else 0) == 0:
            return False
        return _is_numeric(value) or any(fits(value, kind) for kind in others)
    if origin in (Union, UnionType):
        return any(fits(value, kind) for kind in kinds)
    if origin is Literal:
        return isinstance(value, str) and value in kinds
    if hint is float:
        return is_number(value) and (is_inf(abs(value)) or not math.isnan(finite_number(value)))
    if hint is int:
        return isinstance(value, int | np.integer) and not isinstance(value, bool)
    if hint is bool:
        return isinstance(value, bool | np.bool_)
    if origin is tuple and kinds[-1] is not ...:
        return _is_row(value) and len(value) == len(kinds) and all(map(fits, value, kinds))
    if getattr(origin, "_is_protocol", False) and origin.__module__.startswith("rastercov."):
        names = [name for name in (*vars(origin), *_hints(origin)) if not name.startswith("_")]
        return not isinstance(value, type) and all(hasattr(value, name) for name in names)
    if not isinstance(origin, type):
        return True
    is_bare = not kinds or origin is type
    if is_bare or not issubclass(origin, Iterable | Callable):
        return isinstance(value, origin)
    if issubclass(origin, Mapping):
        return isinstance(value, Mapping) and all(
            fits(key, kinds[0]) and fits(each, kinds[1]) for key, each in value.items()
        )
    if issubclass(origin, Callable):  # type: ignore[arg-type] # an abstract class at run time
        return callable(value)
    is_set = origin is Collection and isinstance(value, set | frozenset)
    return (is_set or _is_row(value)) and all(fits(each, kinds[0]) for each in value)


def _is_array_like(hint: object) -> bool:
    """True for an annotation of ArrayLike, alone or among others, or of arrays."""
    kinds = get_args(hint) or (hint,)
    return (get_origin(hint) or hint) in ARRAYS or all(kind in kinds for kind in ARRAY)


def _is_numeric(value: object) -> bool:
    """True when numpy makes numbers of a value, without reading texts or losing a mask."""
    try:
        array = as_array(value)
    except Exception:  # whatever conversion an object brings
        return False
    is_real = array.dtype.kind in "biuf" and array.dtype.itemsize <= 8  # longer ones overflow
    return (not array.size or is_real) and not np.ma.is_masked(value)


def _is_row(value: object) -> bool:
    """True for a sequence of other values, and no text."""
    return isinstance(value, list | tuple | range) or (
        isinstance(value, np.ndarray) and value.ndim > 0
    )


def _expected_text(hint: Any) -> str:
    """Words for the values that an annotation asks for."""
    kinds, origin = get_args(hint), get_origin(hint) or hint
    if _is_array_like(hint):
        others = [
            _expected_text(kind) for kind in kinds if kind not in ARRAY and origin not in ARRAYS
        ]
        return " or ".join(["real numbers", *others])
    if origin in (Union, UnionType):
        return " or ".join(dict.fromkeys(map(_expected_text, kinds)))
    if origin is Literal:
        return " or ".join(map(str, kinds))
    if origin is tuple:
        each = [_expected_text(kind) for kind in kinds if kind is not ...]
        return f"a tuple ({', '.join(each)}{', ...' if kinds[-1] is ... else ''})"
    if hint is NoneType:
        return "None"
    if origin in WORDS:
        return WORDS[origin]
    name = getattr(origin, "__name__", str(origin))
    if name == "Callable":
        return "a function"
    if kinds and not issubclass(origin, Mapping):
        return f"a sequence, each {_expected_text(kinds[0])}"
    return f"{'an' if name[0] in 'AEIOU' else 'a'} {name}"
