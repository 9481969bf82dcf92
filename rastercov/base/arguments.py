"""Checks of arguments at the public edge: what was expected and what came, in one line.

Serves whatever takes arrays, groups and options. numpy would take the real part of complex numbers,
read texts as numbers, count True as 1, and lose the mask of a masked array: each is refused here.

Fields of a dataclass have their limits in their annotations, each declared once, as
`Annotated[float, Gt(0), Le(90), Doc("...")]`. It serves the constructor (`check_limits`), the
command line (`Doc` is the help of the option) and plan files (pydantic reads the same annotations).

Kinds of arrays, and arrays as loops want them; `Lists` has lists of numbers of any lengths in one.

The memory of results is compared with what is free before any of it is allocated. Linux gives
memory that it does not have and ends the process when it is used, so `MemoryError` comes too late
or never.
"""

import dataclasses
import functools
import math
import operator
import os
import sys
from collections.abc import Callable, Container, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray
from typing_extensions import CapsuleType, Doc, TypeIs

from rastercov.base.errors import CameraError, ConfigError, RastercovError, ResourceError
from rastercov.base.format import ByName
from rastercov.base.format import shown as shown  # others find it here, too

AnyArray = NDArray[Any]
FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
Int32Array = NDArray[np.int32]
ByteArray = NDArray[np.uint8]
Float32Array = NDArray[np.float32]
WholeArray = NDArray[np.integer[Any]]

TINY = float(np.finfo(float).tiny)
"""Least positive number of full precision, in place of a divisor of 0."""
CACHE_LINE = 64
"""Bytes of a cache line."""
UNCHECKED = 1 << 28
"""Bytes up to which free memory is not checked: the check takes 0.1 ms."""
LARGEST_REUSED = 31 << 20
"""Bytes of a freed array that the allocator uses again. glibc gives the pages of a large array back
when it is freed, and maps fresh ones for the next, until it has seen one as large come and go; it
does so below 32 MiB. Fresh pages take a tenth of the time of a pass over poses."""
np.empty(LARGEST_REUSED, np.uint8)
_MEMINFO = Path("/proc/meminfo")
_CONTAINER_LIMITS = (
    Path("/sys/fs/cgroup/memory.max"),
    Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"),
)


def align_array(shape: tuple[int, ...], dtype: DTypeLike) -> AnyArray:
    """Array of any values that starts at a cache line: a row of one line is then in one."""
    n_bytes = math.prod(shape) * np.dtype(dtype).itemsize
    memory = np.empty(n_bytes + CACHE_LINE, np.uint8)
    start = -memory.__array_interface__["data"][0] % CACHE_LINE
    return np.ndarray(shape, dtype, memory, start)


def read_only(array: ArrayLike, dtype: DTypeLike | None = None) -> AnyArray:
    """Contiguous view that is not writable, for what several calls share."""
    view: AnyArray = np.ascontiguousarray(array, dtype).view()
    view.flags.writeable = False
    return view


def check_memory(what: str, n_bytes: int, remedy: str) -> None:
    """Raise `ResourceError` where results take more memory than is free.

    `what` names them, such as "counts of 3 poses x 12 faces"; `remedy` ends the sentence.
    """
    if n_bytes > UNCHECKED and n_bytes > (free := free_memory()):
        raise ResourceError(
            f"expected {what} to fit in {free / 2**30:,.1f} GiB of free memory, got "
            f"{n_bytes / 2**30:,.1f} GiB; {remedy}"
        )


def free_memory() -> int:
    """Bytes that the process can still take: free memory and swap, at most its container's limit.

    All of the machine's memory where the system does not say what is free; no bound on Windows,
    which raises `MemoryError` before it gives memory that it does not have.
    """
    try:
        lines = (line.split() for line in _MEMINFO.read_text(encoding="ascii").splitlines())
        kilobytes = {words[0]: int(words[1]) for words in lines}
        free = 1024 * (kilobytes["MemAvailable:"] + kilobytes.get("SwapFree:", 0))
    except (OSError, ValueError, LookupError):
        if not hasattr(os, "sysconf"):
            return sys.maxsize
        free = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    for path in _CONTAINER_LIMITS:
        try:
            free = min(free, int(path.read_text(encoding="ascii")))
        except (OSError, ValueError):  # no container, or one without a limit: "max"
            continue
    return free


def offsets_of(counts: ArrayLike) -> NDArray[np.int64]:
    """(N + 1,) sums of the counts before each of N, and of all."""
    return np.concatenate((np.zeros(1, np.int64), np.cumsum(counts, dtype=np.int64)))


def owners_of(counts: Sequence[int] | NDArray[np.integer]) -> NDArray[np.int64]:
    """(M,) which of N each of M items belongs to, the counts of N one after the other."""
    return np.repeat(np.arange(len(counts)), counts)


class Lists(NamedTuple):
    """N lists: list i is `items[starts[i]:starts[i + 1]]`.

    Attributes
    ----------
    starts : (N + 1,) int64
    items : (M,) int32
    """

    starts: NDArray[np.int64]
    items: NDArray[np.int32]

    @classmethod
    def of(cls, rows: Sequence[NDArray[np.integer]]) -> "Lists":
        """Lists of arrays."""
        starts = offsets_of([*map(len, rows)])
        items = np.concatenate(rows) if len(rows) else np.empty(0)
        return cls(starts, items.astype(np.int32))

    @property
    def n(self) -> int:
        """Number of lists."""
        return len(self.starts) - 1

    def row(self, i: int) -> NDArray[np.int32]:
        """List i."""
        return self.items[self.starts[i] : self.starts[i + 1]]

    def part(self, first: int, last: int) -> "Lists":
        """Lists first ... last - 1, copied."""
        begin, end = self.starts[first], self.starts[last]
        return Lists(self.starts[first : last + 1] - begin, self.items[begin:end].copy())


MAX_IMAGE_SIDE = 1 << 17
"""Largest image side in pixels; larger than any sensor, small enough to count samples in int64."""
MOST_COEFFICIENTS = 100
"""OpenCV has 14 at most."""

LONGEST = 1e12
"""Pixels: largest focal length, and farthest principal point. float64 tells directions apart to
some 1e-16 rad, which is 1e-4 px then; beyond, samples would be left to rounding."""
SHORTEST = 1e-12
"""Pixels: least focal length. A pixel next to the principal point then sees all that is more than
1e-12 rad beside the image plane."""


BEYOND = "float64 does not resolve pixels there, check the unit"


def number(
    name: str, value: object, least: float = -math.inf, most: float = math.inf, wanted: str = ""
) -> float:
    """`value` as a finite float; `wanted` says what it must be, where it has limits in pixels."""
    if not is_number(value):
        raise CameraError(f"expected {name} to be a number, got {shown_entry(value)}")
    try:
        result = float(value)
    except OverflowError:
        raise CameraError(f"expected {name} to be below 1e308, got a larger integer") from None
    if not math.isfinite(result):
        raise CameraError(f"expected {name} to be finite, got {result}")
    if not least <= result <= most:
        raise CameraError(f"expected {name} to be {wanted}, got {result:g}; {BEYOND}")
    return result


def positive(name: str, value: object) -> float:
    """`value` as a finite float above 0."""
    result = number(name, value)
    if not result > 0:
        raise CameraError(f"expected {name} to be positive, got {result:g}")
    return result


def focal_length_px(name: str, value: object) -> float:
    """`value` as a focal length in pixels."""
    wanted = f"from {SHORTEST:g} to {LONGEST:g} px"
    return number(name, positive(name, value), SHORTEST, LONGEST, wanted)


def principal_point_px(name: str, value: object) -> float:
    """`value` as a coordinate of the principal point in pixels."""
    return number(name, value, -LONGEST, LONGEST, f"within {LONGEST:g} px of the image")


def pair(name: str, value: object) -> tuple[float, float]:
    """One or two positive numbers as two."""
    values = value if is_list(value) else (value, value)
    if len(values) != 2:
        raise CameraError(f"expected {name} to be one or two numbers, got {shown_entry(value)}")
    return positive(name, values[0]), positive(name, values[1])


def two(name: str, value: object) -> tuple[Any, Any]:
    """Two values of any kind, from a sequence or an array."""
    values = of_array(value)
    if not is_list(values) or len(values) != 2:
        raise CameraError(f"expected {name} to be two numbers, got {shown_entry(values)}")
    return values[0], values[1]


def image_side(name: str, value: object) -> int:
    """Width or height of an image, in whole pixels."""
    result = number(name, value)
    if result != int(result) or not 1 <= result <= MAX_IMAGE_SIDE:
        wanted = f"a whole number of pixels from 1 to {MAX_IMAGE_SIDE}"
        raise CameraError(f"expected {name} to be {wanted}, got {shown(value)}")
    return int(result)


def coefficients_of(distortion: Any) -> tuple[Any, ...]:
    """Coefficients of a lens, one after the other, from a number, a sequence or an array."""
    try:
        size = np.size(distortion)
        if size <= MOST_COEFFICIENTS:
            return tuple(np.ravel(np.asarray(distortion, object)))
    except Exception:  # whatever conversion an object brings
        raise CameraError(f"expected distortion to be numbers, got {shown(distortion)}") from None
    raise CameraError(f"expected at most {MOST_COEFFICIENTS} distortion coefficients, got {size}")


def is_number(value: object) -> TypeIs[float]:
    """True for a whole or real number of Python or numpy; True and False are none."""
    return not isinstance(value, bool) and isinstance(value, int | float | np.integer | np.floating)


def is_list(value: object) -> TypeIs[Sequence[Any]]:
    """True for a list or a tuple."""
    return isinstance(value, tuple | list)


def is_printable(value: object) -> TypeIs[str]:
    """True for text without line breaks and other signs that are not seen."""
    return isinstance(value, str) and value.isprintable()


def of_array(value: object) -> object:
    """Values of an array of two; all else as it is."""
    return value.tolist() if isinstance(value, np.ndarray) and value.shape == (2,) else value


def shown_entry(value: object) -> str:
    """`shown`, of a tuple as a list, as files have it."""
    return shown([*value] if isinstance(value, tuple) else value)


def is_one_of(value: object, names: Container[str]) -> bool:
    """True for text that is among some names; an array is never compared with them."""
    return isinstance(value, str) and value in names


LEAST_RAY_ANGLE = 1e-3
"""Least limit of an angle between rays, degrees: smaller ones are rounding of its cosine."""


def ray_angle(name: str, value: object, error: type[RastercovError] = ConfigError) -> float:
    """A limit of an angle between rays, degrees: 0, or from `LEAST_RAY_ANGLE` to 180."""
    degrees = finite_number(value)
    if degrees == 0 or LEAST_RAY_ANGLE <= degrees <= 180:
        return degrees
    wanted = f"0, or from {LEAST_RAY_ANGLE} to 180 degrees"
    raise error(f"expected {name} to be {wanted}, got {shown(value)}; change it")


def finite_number(value: object) -> float:
    """`value` as a float, NaN for what is no finite number."""
    try:
        result = float(value) if is_number(value) else math.nan
    except OverflowError:
        return math.nan
    return result if math.isfinite(result) else math.nan


def is_inf(value: object) -> bool:
    """True for positive infinity."""
    return isinstance(value, float | np.floating) and value == math.inf


def share_meant(value: object) -> str:
    """End of a line about a share above 1, which was probably given in percent."""
    if is_number(value) and 1 < value <= 100:
        return f"; pass {value / 100:g} for {value:g} %"
    return ""


MOST_POSES = 10_000_000
"""Poses on a sphere: 1.3 GB of matrices."""

Kinds = type | tuple[type, ...]

HOST = (1, 0)
"""Memory of the host, as DLPack numbers devices."""
LONGEST_CHOICES = 100
"""Characters of the choices that an error lists."""
LARGEST_COORDINATE = 1e30
"""Metres; its sixth power is still a float64, so that areas and volumes never overflow."""


def check_kind(
    name: str, value: object, kind: Kinds, wanted: str, error: type[RastercovError]
) -> None:
    """Raise `error` unless a value is of that kind; `wanted` says what it must be."""
    if not isinstance(value, kind):
        raise error(f"expected {name} to be {wanted}, got {shown(value)}")


def check_choice(name: str, value: object, choices: Sequence[str]) -> None:
    """Raise ConfigError unless a value is one of these words."""
    if not isinstance(value, str) or value not in choices:
        words = f"{', '.join(choices[:-1])} or {choices[-1]}"
        if len(words) > LONGEST_CHOICES:
            near = get_close_matches(str(value), choices, 3) or choices[:3]
            words = f"one of {len(choices)} names, such as {', '.join(near)}"
        raise ConfigError(f"expected {name} to be {words}, got {shown(value)}")


def flag(name: str, value: object) -> bool:
    """True or False, of Python or numpy; else ConfigError."""
    check_kind(name, value, (bool, np.bool_), "True or False", ConfigError)
    return bool(value)


def members(
    name: str, values: Any, kind: Kinds, wanted: str, error: type[RastercovError]
) -> tuple[Any, ...]:
    """Every one of `values`, which are all of that kind, else `error`; `wanted` names them all."""
    items: list[Any] = []
    try:
        if isinstance(values, str):  # a sequence of texts, and never meant as one
            raise TypeError
        each = iter(values)
    except TypeError:
        raise error(f"expected {name} to be {wanted}, got {shown(values)}") from None
    for value in each:
        check_kind(name, value, kind, wanted, error)
        items.append(value)
    return tuple(items)


def distinct(name: str, values: Any, count: int, error: type[RastercovError]) -> tuple[str, ...]:
    """`count` texts, none empty or equal to another, else `error`."""
    wanted = f"{count} distinct strings"
    result = members(name, values, str, wanted, error)
    if len(result) != count or len(set(result)) != count or not all(result):
        raise error(f"expected {name} to be {wanted}, got {shown(list(result))}")
    return result


def check_seed(seed: int) -> None:
    """Raise ConfigError for a seed that numpy does not take."""
    if seed < 0:
        raise ConfigError(f"expected seed to be 0 or more, got {shown(seed)}")


def finite_points(
    name: str,
    values: ArrayLike,
    shape: tuple[int, ...],
    wanted: str,
    error: type[RastercovError] = ConfigError,
) -> FloatArray:
    """Finite coordinates of that shape, -1 for any length, within LARGEST_COORDINATE.

    Anything else is an error; `wanted` says what they must be.
    """
    array = check_array(name, values, "iuf", wanted, error)
    sides = zip(array.shape, shape, strict=False)
    if array.ndim != len(shape) or any(side not in (got, -1) for got, side in sides):
        raise error(f"expected {name} to be {wanted}, got shape {array.shape}")
    points = own_array(name, array, np.float64)
    if not (np.abs(points) <= LARGEST_COORDINATE).all():
        limit = f"within ±{LARGEST_COORDINATE:g}"
        raise error(f"expected {name} to be {wanted}, {limit}, got {shown(values)}")
    return points


def as_array(values: Any) -> AnyArray:
    """Array of `values`; of a tensor that numpy does not convert, through DLPack, also of a GPU."""
    has_dlpack = hasattr(values, "__dlpack__")
    try:
        array = np.asarray(values)
        if array.dtype != object or not has_dlpack:
            return array
    except TypeError:  # what tensors of a GPU raise
        if not has_dlpack:
            raise
    return np.from_dlpack(_OnHost(values))


class _OnHost:
    """A tensor whose values DLPack gives in host memory, also to numpy 1, which does not ask so."""

    def __init__(self, tensor: Any) -> None:
        self.tensor = tensor

    def __dlpack__(self, **options: Any) -> CapsuleType:
        if self.tensor.__dlpack_device__()[0] != HOST[0]:
            options["dl_device"] = HOST
        return self.tensor.__dlpack__(**options)

    def __dlpack_device__(self) -> tuple[int, int]:
        return HOST


def check_array(
    name: str, values: ArrayLike, kinds: str, wanted: str, error: type[RastercovError]
) -> AnyArray:
    """Array of `values` if its dtype is one of `kinds` (or it is empty), else `error`.

    Nothing is copied: an array that repeats one row without storing it stays small.
    """
    expected = f"expected {name} to be {wanted}"
    try:
        array = as_array(values)
    except MemoryError:
        raise ResourceError(
            f"expected {name} to fit in memory, got more than this machine has; pass fewer"
        ) from None
    except ValueError:
        raise error(f"{expected}, got rows of unequal length") from None
    except Exception:  # whatever conversion an object brings
        raise error(f"{expected}, got {type(values).__name__}") from None
    if array.size and array.dtype.kind not in kinds:
        got = "text" if array.dtype.kind == "U" else f"dtype {array.dtype}; convert them first"
        raise error(f"{expected}, got {got}")
    rows = values if isinstance(values, list | tuple) else ()
    if np.ma.is_masked(values) or any(np.ma.is_masked(row) for row in rows):
        raise error(f"{expected}, got masked entries; fill them or leave them out")
    return array


def check_room(name: str, values: object) -> None:
    """Raise ResourceError where an array, each number in 8 bytes, takes more memory than is free.

    An array that repeats one row without storing it can be larger than what it takes.
    """
    if isinstance(values, np.ndarray):
        check_memory(name, 8 * values.size, "pass fewer")


def own_array(name: str, array: AnyArray, kind: type) -> AnyArray:
    """Copy of an array as numbers of that kind, in C order.

    Raises
    ------
    ResourceError
        Before any memory is taken, where the copy takes more than is free.
    """
    check_room(name, array)
    with np.errstate(over="ignore"):  # longer floats become inf, and are found to be
        return np.array(array, dtype=kind, order="C")


class Quantity(float):
    """A number that was given with a unit, where others must have the same.

    Attributes
    ----------
    unit : str
        Empty where none was given.
    """

    unit: str

    def __new__(cls, value: float, unit: str = "") -> "Quantity":
        """Make one of a number."""
        instance = super().__new__(cls, value)
        instance.unit = unit
        return instance


class Reads(NamedTuple):
    """Metadata of a number that may be given as text: a name, or a number with a unit.

    `read` makes the number of the text, or raises ValueError with what is wanted. `names` and the
    regular expression `pattern` are for schemas, `metavar` for the command line.
    """

    read: Callable[[str], float]
    names: tuple[str, ...]
    pattern: str
    metavar: str


def check_limits(value: object) -> None:
    """Check all fields of a frozen dataclass, and replace each by its plain Python value.

    Raises
    ------
    ConfigError
        For the first field that is not of its type or not within its limits.
    """
    # mypy takes a type for unhashable, which the cache asks for.
    for rule in rules_of(type(value)):  # type: ignore[arg-type]
        if (given := getattr(value, rule.name)) is not rule.default:
            object.__setattr__(value, rule.name, rule.check(given))


@functools.cache
def annotations_of(kind: type) -> ByName:
    """Annotations of a dataclass by field, with their metadata."""
    hints = get_type_hints(kind, include_extras=True)
    return {field.name: hints[field.name] for field in dataclasses.fields(kind)}


def metadata_of(hint: object) -> tuple[Any, ...]:
    """Metadata of an annotation; of the first member that has any, where it is a union."""
    if get_origin(hint) is Annotated:
        return tuple(get_args(hint)[1:])
    members = get_args(hint) if _is_optional(hint) else ()
    return next((metadata for member in members if (metadata := metadata_of(member))), ())


def reader_of(hint: object) -> Reads | None:
    """`Reads` of an annotation, if it has any."""
    return next((each for each in metadata_of(hint) if isinstance(each, Reads)), None)


def document_fields(kind: type) -> dict[str, str]:
    """Description of each field of a dataclass that has a `Doc`."""
    return {
        name: each.documentation
        for name, hint in annotations_of(kind).items()
        for each in metadata_of(hint)
        if isinstance(each, Doc)
    }


def _is_optional(hint: object) -> bool:
    return get_origin(hint) is Union or type(None) in get_args(hint)


@dataclasses.dataclass(frozen=True)
class _Rule:
    """Limits of a field: its `kind`, `limits` of a number, and text that `reader` reads.

    The `default`, a plain value within the limits, is not checked.
    """

    name: str
    default: Any
    is_optional: bool
    kind: Any
    reader: Reads | None
    limits: dict[str, float]

    @classmethod
    def of(cls, name: str, default: object, hint: object) -> "_Rule":
        """The rule of an annotation."""
        is_optional = _is_optional(hint)
        if is_optional:
            hint = next(member for member in get_args(hint) if member is not type(None))
        kind = get_args(hint)[0] if get_origin(hint) is Annotated else hint
        return cls(name, default, is_optional, kind, reader_of(hint), _limits(hint))

    def check(self, value: object) -> Any:
        """The plain value; ConfigError for one that is not allowed."""
        if value is None and self.is_optional:
            return None
        name, kind, limits = self.name, self.kind, self.limits
        if kind is bool:
            return flag(name, value)
        if get_origin(kind) is Literal:
            check_choice(name, value, get_args(kind))
            return value
        given = value
        if self.reader is not None and isinstance(value, str):
            try:
                value = self.reader.read(value)
            except ValueError as error:
                raise ConfigError(f"expected {name} to be {error}") from None
        number = finite_number(value)
        is_whole = kind is not int or number.is_integer()
        is_within = all(IS_WITHIN[name](number, limit) for name, limit in limits.items())
        if math.isnan(number) or not is_whole or not is_within:
            meant = share_meant(number) if limits.get("le") == 1 else ""
            words = _words(kind, limits)
            raise ConfigError(f"expected {name} to be {words}, got {shown(given)}{meant}")
        return value if isinstance(value, Quantity) else kind(number)


@functools.cache
def rules_of(kind: type) -> tuple[_Rule, ...]:
    """Rules of all fields of a dataclass."""
    hints = annotations_of(kind)
    return tuple(
        _Rule.of(field.name, field.default, hints[field.name]) for field in dataclasses.fields(kind)
    )


IS_WITHIN = {"gt": operator.gt, "ge": operator.ge, "lt": operator.lt, "le": operator.le}
"""Comparisons with limits, by their names in `annotated_types`."""


def _limits(hint: object) -> dict[str, float]:
    """Limits of an annotation by their names."""
    metadata = metadata_of(hint)
    return {name: getattr(m, name) for name in IS_WITHIN for m in metadata if hasattr(m, name)}


def _words(kind: type, limits: Mapping[str, float]) -> str:
    """Words for a type and its limits: "from 0 to 1", "greater than 0 and at most 90"."""
    words = ["a whole number"] if kind is int else []
    if {"ge", "le"} <= limits.keys():
        return ", ".join([*words, f"from {limits['ge']:g} to {limits['le']:g}"])
    forms = {
        "gt": "greater than {:g}",
        "ge": "{:g} or more",
        "lt": "less than {:g}",
        "le": "at most {:g}",
    }
    words.append(" and ".join(forms[name].format(limit) for name, limit in limits.items()))
    return ", ".join(filter(None, words)) or "a number"
