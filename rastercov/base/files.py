"""Files that a person names: read only if they are regular, not too large, and without waiting.

Serves every reader of cameras, poses, plans and meshes, and turns errors of the system into one
line. A pipe without a writer would make it wait for ever, and a device such as /dev/zero has no
end. So a path is looked at before it is opened, and what was opened is looked at again, because the
path may lead elsewhere by then.

`UnknownNames` looks at names of a file that its format does not have. One flipped bit in the name
of an optional entry makes a valid file that says less. So a name that is one slip away from one
that matters, and that is missing, is an error; any other is a note.
"""

import json
import math
import os
import re
import stat
import tomllib
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from difflib import get_close_matches
from functools import lru_cache, partial
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

from rastercov.base.arguments import shown
from rastercov.base.errors import ConfigError, RastercovError
from rastercov.base.format import ByName
from rastercov.base.output import replacing

StrPath = str | os.PathLike[str]

PROJECTS = dict.fromkeys((".psx", ".psz"), "Metashape") | {".mvs": "OpenMVS"}
PROJECTS |= dict.fromkeys((".rcproj", ".rsproj"), "RealityCapture")
"""Programs whose projects are taken for meshes or cameras."""
LARGEST_ARRAY = 2 << 30
"""Bytes of a file of poses: 16 million in .npy."""
LARGEST_TEXT = 10_000_000
"""Bytes of a file that a person writes, such as a camera or a plan."""
MOST_ENTRIES = 10_000
"""Entries of a folder among which one is looked for that resembles a missing name."""
LARGEST_NUMBER = 1e100
"""Magnitude of a finite number in a file, whatever it means: its cube is a float64."""
READING = sum(getattr(os, name, 0) for name in ("O_NONBLOCK", "O_NOCTTY", "O_BINARY"))
"""Flags, as far as the system has them, to read bytes without waiting."""


def path_from(out: Path, folder: Path) -> str:
    """A folder as it is written into files of another: relative, so that both may move together."""
    with suppress(ValueError):  # on another drive
        return os.path.relpath(os.path.realpath(folder), os.path.realpath(out))
    return os.path.realpath(folder)


class UnreadableError(ValueError):
    """A file that is not read; the message says why in one line, without the path.

    Attributes
    ----------
    reason : str
        What was wanted, what came, what to do; or the words of the system.
    is_of_system : bool
        Whether it is the system that refuses the file.
    """

    def __init__(self, reason: str, is_of_system: bool = False) -> None:
        super().__init__(reason)
        self.reason, self.is_of_system = reason, is_of_system


class UnwritableError(ValueError):
    """A file that is not written; the message says why in one line, without the path."""


class UnparsedError(UnreadableError):
    """A file that was read, and is not of its format."""

    def __init__(self, form: str, reason: str) -> None:
        super().__init__(reason)
        got = re.sub(r"^Expect\w+ ", "no ", reason)
        place = r"something else at line \1, column \2; correct the file"
        line = re.sub(": no value: line (.*) column (.*) .char.*", f" {place}", f": {got}")
        self.args = (f"expected valid {form}, got{line}",)


def suffix_of(path: StrPath) -> str:
    """Suffix in lower case; UnreadableError for anything else than a string or a path."""
    return _as_path(path).suffix.lower()


def is_file(path: StrPath) -> bool:
    """True for a file of that name, and no folder; False for a name that is none."""
    try:
        return Path(path).is_file()
    except (OSError, TypeError, ValueError):
        return False


def is_same_file(path: StrPath, other: StrPath) -> bool:
    """True for two names of one file that is there."""
    try:
        return Path(path).samefile(other)
    except (OSError, ValueError):
        return False


def printable(text: str, most: int = 200) -> str:
    """Printable part of `text`, not too long: names end up in terminals, tables and pictures.

    Only its beginning is looked at, as many images may share a long name.
    """
    return "".join(c for c in text[: 20 * most] if c.isprintable()).strip()[:most]


@contextmanager
def open_file(path: StrPath, most: int, advice: str = "check the path") -> Iterator[BinaryIO]:
    """Regular file of at most `most` bytes, open for reading; links are followed.

    UnreadableError for what is no path, a folder, pipe, socket or device, a file that is larger
    (with `advice`) or cannot be opened, and for an error of the disk in the `with` block.
    """
    path = _as_path(path)
    try:
        before = path.stat()
        _check(before, most, advice)
        # Were the file exchanged for a pipe just now, this would still not wait for a writer.
        descriptor = os.open(path, READING)
    except UnreadableError:
        raise
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the path
        raise UnreadableError(reason_of(error), is_of_system=True) from None
    with os.fdopen(descriptor, "rb") as file:
        now = os.fstat(descriptor)
        _check(now, most, advice)
        _check_size(before.st_size, now.st_size)
        try:
            yield file
        except OSError as error:
            raise UnreadableError(reason_of(error), is_of_system=True) from None


def file_bytes(path: StrPath, most: int, advice: str = "check the path") -> bytes:
    """Bytes of a regular file, at most `most`; UnreadableError as for `open_file`."""
    with open_file(path, most, advice) as file:
        size = os.fstat(file.fileno()).st_size
        data = file.read(size + 1)
    _check_size(size, len(data))
    return data


def file_text(path: StrPath) -> str:
    """Text of a regular file in UTF-8, such as a table; a ValueError says what is wrong."""
    return file_bytes(path, LARGEST_TEXT).decode("utf-8-sig")


@contextmanager
def write_file(path: StrPath) -> Iterator[BinaryIO]:
    """File to write to; UnwritableError where it cannot be opened, or the disk fails or is full."""
    path = _as_path(path)
    try:
        with replacing(path) as part, part.open("wb") as file:
            yield file
    except OSError as error:
        raise UnwritableError(reason_of(error)) from None
    except ConfigError as error:
        raise UnwritableError(str(error).removeprefix(f"{path}: ")) from None


def read_json(path: StrPath, most: int = LARGEST_TEXT) -> Any:
    """Content of a JSON file; UnreadableError for anything else, and where a name comes twice."""
    return parse_json(file_bytes(path, most))


def parse_json(data: bytes, *, is_strict: bool = False) -> Any:
    """Content of JSON, as `read_json` reads it; strictly without NaN and Infinity."""
    constant = _refuse_constant if is_strict else None
    parse = partial(json.loads, parse_constant=constant, object_pairs_hook=unique_names)
    return _parse_data("JSON", parse, data)


def _refuse_constant(text: str) -> None:
    raise ValueError(f"{text} is not JSON")


def read_toml(path: StrPath) -> ByName:
    """Table of a TOML file; UnreadableError for anything else."""
    return _parse_data("TOML", tomllib.loads, file_bytes(path, LARGEST_TEXT))


def one_line(error: Exception) -> str:
    """Message of an error, in one line of at most 200 characters."""
    text = " ".join((str(error) or type(error).__name__).split())
    return text if len(text) <= 200 else text[:197] + "..."


def not_utf_8(error: UnicodeDecodeError) -> str:
    """Words on the byte that is no text."""
    return f"byte {error.object[error.start]:#04x} at {error.start:,}; save it as UTF-8"


def _parse_data(form: str, parse: Callable[[str], Any], data: bytes) -> Any:
    try:
        content = parse(data.decode("utf-8-sig"))  # some editors put a byte order mark first
        check_numbers(content)
        return content
    except UnreadableError:
        raise
    except UnicodeDecodeError as error:
        raise UnparsedError(form, not_utf_8(error)) from None
    except RecursionError:
        raise UnparsedError(form, "tables nested too deeply; flatten them") from None
    except ValueError as error:
        reason = one_line(error).partition("; use sys.")[0]  # advice for code, on long integers
        raise UnparsedError(form, reason) from None


def check_numbers(content: object, name: str = "") -> None:
    """Raise UnreadableError for a number beyond `LARGEST_NUMBER` in tables and lists of a file.

    The line names the entry. Sums, products and conversions of all other numbers are finite.
    """
    if isinstance(content, Mapping):
        for key, each in content.items():
            check_numbers(each, f"{name}.{key}" if name else str(key))
    elif isinstance(content, list):
        # Most numbers of a large file are in such lists. One with NaN first is walked.
        if {*map(type, content)} == {float} and is_within(min(content)) and is_within(max(content)):
            return
        for each in content:
            check_numbers(each, name)
    else:
        check_number(content, name)


def is_within(value: float) -> bool:
    """True for a number within `LARGEST_NUMBER`, of any length; False for NaN."""
    return -LARGEST_NUMBER <= value <= LARGEST_NUMBER


def check_number(value: object, name: str) -> None:
    """Raise UnreadableError for a finite number beyond `LARGEST_NUMBER`."""
    if not isinstance(value, int | float) or is_within(value):
        return
    if isinstance(value, int) or math.isfinite(value):
        raise UnreadableError(
            f"{printable(name) or 'the file'}: expected a number within ±{LARGEST_NUMBER:g}, got "
            f"{shown(value)}; correct the file"
        )


def unique_names(pairs: list[tuple[str, Any]]) -> ByName:
    """Table of names and values of JSON; ValueError for a name that comes twice."""
    table = dict(pairs)
    if len(table) < len(pairs):  # the standard takes the last one, without a word
        [(twice, _)] = Counter(name for name, _ in pairs).most_common(1)
        raise ValueError(f"{twice[:50]!r} twice in one table; remove one")
    return table


def _check(status: os.stat_result, most: int, advice: str) -> None:
    mode = status.st_mode
    if not stat.S_ISREG(mode):
        kinds = {stat.S_IFDIR: "a folder", stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket"}
        kind = kinds.get(stat.S_IFMT(mode), "a device")
        raise UnreadableError(f"expected a regular file, got {kind}; pass a file")
    if status.st_size > most:
        raise UnreadableError(f"expected at most {most} bytes, got {status.st_size}; {advice}")


def _check_size(wanted: int, got: int) -> None:
    if got != wanted:
        raise UnreadableError(
            f"expected {wanted} bytes, got {got}: the file changed while it was read; try again"
        )


def reason_of(error: Exception) -> str:
    """Words of the system for an error, such as "no such file or directory"."""
    reason = getattr(error, "strerror", None) or one_line(error)
    reason = reason[:1].lower() + reason[1:]
    if isinstance(error, FileNotFoundError) and error.filename:
        reason += similar(error.filename)
    return reason


def similar(path: StrPath) -> str:
    """Question about the entry of its folder that a missing path resembles; empty without one."""
    place = Path(os.fsdecode(path))
    try:
        some = islice(place.parent.iterdir(), MOST_ENTRIES)
        entries = sorted(each.name for each in some if not place.suffix or each.is_file())
    except OSError:
        return ""
    near = [each for each in entries if Path(each).stem == place.stem]
    near = near or get_close_matches(place.name, entries, 1, 0.8)
    return f"; did you mean {shown(str(place.parent / near[0]))}?" if near else ""


def _as_path(path: StrPath) -> Path:
    try:
        return Path(path)
    except TypeError:
        kind = type(path).__name__
        raise UnreadableError(f"expected a path, got {kind}; pass a str or a Path") from None


SHORTEST = 3
"""Characters of a name in which a slip is looked for: any two shorter ones are a slip apart."""
MOST_LISTED = 5


class Vocabulary:
    """Names of entries, elements and attributes that a format has, wherever they may be.

    Parameters
    ----------
    inner : str
        Words: names that triangles or cameras depend on. Elements of these names are looked into.
    leaves : str
        As `inner`, of elements that have only numbers, or are many.
    harmless : str
        Those that nothing depends on.
    """

    def __init__(self, inner: str, leaves: str, harmless: str) -> None:
        self.inner, self.harmless = frozenset(inner.split()), frozenset(harmless.split())
        self.known = self.inner | self.harmless | frozenset(leaves.split())


class UnknownNames:
    """Unknown names of one file, each with the place where it came first.

    Parameters
    ----------
    error : type
        Error that a slip raises.
    """

    def __init__(self, error: type[RastercovError]) -> None:
        self._error = error
        self._found: dict[str, str] = {}

    def look(
        self,
        where: str,
        names: Collection[str],
        known: frozenset[str],
        harmless: frozenset[str] = frozenset(),
    ) -> None:
        """Look at the names of one table; `harmless` are known ones that nothing depends on."""
        if known.issuperset(names):
            return
        for name in names:
            if name not in known:
                self._add(where, name, names, known - harmless)

    def _add(self, where: str, name: str, names: Collection[str], needed: frozenset[str]) -> None:
        meant = next((other for other in _slips(name, needed) if other not in names), None)
        if meant is not None:
            raise self._error(
                f"{where}: expected {meant!r}, got {shown(name)}, unknown to the format; "
                "correct the name"
            )
        self._found.setdefault(name, where)

    def notes(self) -> list[str]:
        """A note with each name once, the first few by name; none without unknown names."""
        words = [
            f"{printable(name, 40)} of {where}"
            for name, where in list(self._found.items())[:MOST_LISTED]
        ]
        n_more = len(self._found) - len(words)
        words += [f"{n_more} others"] if n_more else []
        return [f"not read: {', '.join(words)}; content may be missing"] if words else []


@lru_cache(maxsize=1 << 12)
def _slips(name: str, needed: frozenset[str]) -> tuple[str, ...]:
    return tuple(sorted(other for other in needed if is_slip(name, other)))


def is_slip(name: str, other: str) -> bool:
    """True for two names that differ in one character, two neighbours' order, or upper case."""
    if min(len(name), len(other)) < SHORTEST or name.casefold() == other.casefold():
        return name.casefold() == other.casefold()
    pairs = enumerate(zip(name, other, strict=False))
    start = next((i for i, (a, b) in pairs if a != b), min(len(name), len(other)))
    a, b = name[start:], other[start:]
    is_turned = a[:2] == b[:2][::-1] and a[2:] == b[2:]
    return is_turned or a[1:] == b[1:] or a[1:] == b or a == b[1:]
