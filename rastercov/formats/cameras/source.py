"""Content of a file to be recognised and read: its bytes once, what they parse to, and look-ups."""

import math
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence, Set
from functools import cached_property
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from rastercov.base import (
    ByName,
    CameraError,
    FloatArray,
    MeshError,
    UnparsedError,
    errors_as,
    file_bytes,
    finite_number,
    image_side,
    parse_json,
    read_toml,
    shown,
)
from rastercov.base.files import LARGEST_ARRAY, not_utf_8
from rastercov.formats.meshes.xml_tree import local_name, parse_xml

XML_BUDGET = 8 << 30
"""Bytes of memory that a tree of XML may need."""
LARGEST_YAML = 16 << 20
"""Bytes: 20 s of parsing where PyYAML has no compiled parser."""
MOST_CHOICES = 20
"""Words that an error lists."""


class Source:
    """A file, read when it is asked for."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @cached_property
    def data(self) -> bytes:
        """Its bytes."""
        return file_bytes(self.path, LARGEST_ARRAY)

    @cached_property
    def is_xml(self) -> bool:
        """True for text that begins with "<", in UTF-8 or UTF-16."""
        start = self.data[:4000]
        marks = (b"\xff\xfe<\0", b"\xfe\xff\0<")
        return start.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"<") or start[:4] in marks

    @cached_property
    def text(self) -> str:
        """Its text."""
        try:
            return self.data.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise UnparsedError("text", not_utf_8(error)) from None

    @cached_property
    def json(self) -> Any:
        """Content of JSON; a name that comes twice in a table is an error."""
        return parse_json(self.data)

    @cached_property
    def toml(self) -> ByName:
        """Table of TOML."""
        return read_toml(self.path)

    @cached_property
    def yaml(self) -> Any:
        """Content of YAML."""
        if len(self.data) > LARGEST_YAML:
            raise CameraError(
                f"expected at most {LARGEST_YAML} bytes of YAML, got {len(self.data)}; remove what "
                "is not a camera"
            )
        from rastercov.formats.cameras.yaml_tree import parse_yaml  # loads PyYAML

        return parse_yaml(self.text)

    @cached_property
    def is_json(self) -> bool:
        """True for JSON rather than YAML, by the name or the start."""
        start = self.data[:4000].removeprefix(b"\xef\xbb\xbf").lstrip()
        return self.path.suffix.lower() == ".json" or start.startswith(b"{")

    @cached_property
    def table(self) -> Any:
        """Content of JSON or YAML."""
        return self.json if self.is_json else self.yaml

    @cached_property
    def xml(self) -> Element:
        """Root element of XML."""
        with errors_as(CameraError, caught=MeshError):
            return parse_xml(self.data, "it", XML_BUDGET)


class Entries:
    """A table of a file; `where` names it in errors, and is empty for all of the file."""

    def __init__(self, value: object, where: str = "") -> None:
        self._start = where and f"{where}: "
        if not isinstance(value, Mapping):
            raise CameraError(
                f"{self._start}expected a table of names and values, got {shown(value)}"
            )
        self._table, self.where = value, where

    def __contains__(self, name: str) -> bool:
        return self._table.get(name) is not None

    def names(self) -> list[str]:
        """Names of the table, as texts."""
        return [str(name) for name in self._table]

    def get(self, name: str, default: object = None) -> Any:
        """The value as it came; `default` where it is missing or null."""
        value = self._table.get(name)
        return default if value is None else value

    def any_of(self, *names: str) -> str | None:
        """The first of these names that the table has."""
        return next((name for name in names if name in self), None)

    def need(self, name: str) -> Any:
        """The value, which must be there."""
        if name not in self:
            raise CameraError(f"{self._start}expected {name}, got none; export the file again")
        return self._table[name]

    def wrong(self, name: str, wanted: str, got: object) -> CameraError:
        """Error of an entry that is not what was wanted."""
        return CameraError(
            f"{self._start}expected {name} to be {wanted}, got {shown(got)}; correct it"
        )

    def number(self, name: str, default: float | None = None) -> float:
        """A finite number."""
        value = self.need(name) if default is None else self.get(name, default)
        result = finite_number(value)
        if np.isnan(result):
            raise self.wrong(name, "a finite number", value)
        return result

    def positive(self, name: str, default: float | None = None) -> float:
        """A finite number above 0."""
        number = self.number(name, default)
        if not number > 0:
            raise self.wrong(name, "positive", number)
        return number

    def angle(self, name: str, unit: float = 1.0) -> float:
        """An angle of view in radians, from one in a unit of some radians."""
        result = self.number(name) * unit
        if not 0 < result < math.pi:
            raise self.wrong(name, "above 0 and below 180 degrees", self.number(name))
        return result

    def side(self, name: str) -> int:
        """Width or height of an image; some programs write 640.0."""
        number = self.number(name)
        with errors_as(CameraError, self.where or None):
            return image_side(name, number)

    def text(self, name: str, default: str | None = None) -> str:
        """A text."""
        value = self.need(name) if default is None else self.get(name, default)
        if not isinstance(value, str):
            raise self.wrong(name, "a string", value)
        return value

    def choice(self, name: str, choices: Collection[str], default: str | None = None) -> str:
        """One of some words."""
        value = self.text(name, default)
        if value not in choices:
            words = [word for word in choices if word][:MOST_CHOICES]
            raise self.wrong(name, f"one of {', '.join(words)}", value)
        return value

    def flag(self, name: str) -> bool:
        """A truth value, False where it is missing; 0 and 1 count."""
        value = self.get(name, False)
        if value not in (0, 1):
            raise self.wrong(name, "true or false", value)
        return bool(value)

    def part(self, name: str) -> str:
        """Path of an entry in the file, for messages."""
        return f"{self.where}, {name}".removeprefix(", ")

    def table(self, name: str) -> "Entries":
        """A table within."""
        return Entries(self.need(name), self.part(name))

    def tables(self, name: str) -> Iterator[tuple[str, "Entries"]]:
        """Tables of a list or a table within, with their names or numbers."""
        value = self.need(name)
        if not isinstance(value, Mapping | list):
            raise self.wrong(name, "a list or table", value)
        for key, each in value.items() if isinstance(value, Mapping) else enumerate(value):
            yield str(key), Entries(each, self.part(f"{name} {str(key)[:60]}"))

    def array(self, name: str, *shapes: tuple[int, ...]) -> FloatArray:
        """Finite numbers of one of these shapes, as a list or a list of rows."""
        return check_array_of(self.need(name), f"{self._start}{name}", *shapes)

    def named(self, name: str, names: Sequence[str]) -> dict[str, float]:
        """Numbers of a list, by their names in its order."""
        return dict(zip(names, self.array(name, (len(names),)).tolist(), strict=True))


class Words(Entries):
    """A table of texts, of which numbers are read: an element of XML."""

    def __init__(self, element: Element, where: str) -> None:
        texts = {local_name(each): (each.text or "").strip() for each in reversed(element)}
        table = {name: text for name, text in texts.items() if text} | element.attrib
        super().__init__(table, where)

    def number(self, name: str, default: float | None = None) -> float:
        """A finite number."""
        if default is not None and name not in self:
            return default
        return float(self.array(name, (1,))[0])

    def array(self, name: str, *shapes: tuple[int, ...]) -> FloatArray:
        """Finite numbers, as many as one of these lengths."""
        words = self.text(name).split()[:100]
        return check_array_of([*map(number_of, words)], f"{self._start}{name}", *shapes)


def check_array_of(value: object, what: str, *shapes: tuple[int, ...]) -> FloatArray:
    """Finite numbers of one of these shapes; `what` names them in errors."""
    shape = next((each for each in shapes if _fits(value, each)), None)
    if shape is None:
        words = " or ".join(" x ".join(map(str, each)) for each in shapes)
        where, colon, name = what.rpartition(": ")
        expected = f"expected {name} to be {words} finite numbers"
        raise CameraError(f"{where}{colon}{expected}, got {shown(value)}")
    return np.array(value, np.float64).reshape(shape)


def _fits(value: object, shape: tuple[int, ...]) -> bool:
    """True for lists in lists with finite numbers in that shape."""
    if not shape:
        return not math.isnan(finite_number(value))
    if not isinstance(value, list) or len(value) != shape[0]:
        return False
    return all(_fits(each, shape[1:]) for each in value)


def check_ids(what: str, keys: Sequence[object]) -> None:
    """Raise `CameraError` for a key that comes twice: what has it first would be lost."""
    if twice := [key for key, n in Counter(keys).items() if n > 1]:
        raise CameraError(f"expected each {what} once, got {shown(twice[0])} twice; remove one")


def keys_of(content: object) -> Set[object]:
    """Names of the entries of a table; none of other content."""
    return content.keys() if isinstance(content, Mapping) else frozenset()


def first_in(content: object, name: str) -> object:
    """The first member of a list of a table; None where there is none."""
    entry = content.get(name) if isinstance(content, Mapping) else None
    return entry[0] if isinstance(entry, list) and entry else None


def number_of(word: str) -> float | str:
    """Number of a word, or the word itself where it is none."""
    try:
        return float(word if "_" not in word else "x")  # Python reads 1_0 as ten
    except ValueError:
        return word
