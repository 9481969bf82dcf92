"""YAML of calibration files: plain values, the dialect of OpenCV, and limits.

PyYAML gives the events of a text, and the values are made here. They are those of YAML 1.2,
whatever the file declares: YAML 1.1 takes 1e-5 for a text and 1:30 for ninety. Aliases are resolved
as long as the whole stays small, tags other than OpenCV's are errors, and a name that comes twice
in a table is one.
"""

import re
from collections.abc import Iterator
from typing import Any

import yaml
from yaml.events import (
    AliasEvent,
    CollectionStartEvent,
    DocumentStartEvent,
    Event,
    MappingEndEvent,
    MappingStartEvent,
    ScalarEvent,
    SequenceEndEvent,
)

from rastercov.base import ByName, UnparsedError, one_line, shown

MOST_VALUES = 2_000_000
"""Values of a file, each alias counted as all that it repeats."""
DEEPEST = 50
MOST_DIRECTIVES = 100
INTEGER = re.compile(r"[-+]?[0-9]{1,40}")
REAL = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
NOT_FINITE = re.compile(r"[-+]?\.inf|\.nan", re.IGNORECASE)
WORDS = {"": None, "~": None, "null": None, "true": True, "false": False}
CLOSE_COLON = re.compile(r"^([ \t]*[A-Za-z_][\w.]*:)(?=[^\s:])", re.MULTILINE)
PREFIX = "tag:yaml.org,2002:"
COLLECTIONS = ("map", "seq", "opencv-matrix", "opencv-nd-matrix", "opencv-sequence-tree")
SCALARS = ("str", "int", "float", "bool", "null")

# The compiled parser, where there is one. Its events are made one by one, whereas its trees are
# built by recursion in C, which a deeply nested text crashes.
_Parser: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def parse_yaml(text: str) -> Any:
    """Content of a YAML text; `UnparsedError` for anything else."""
    # OpenCV writes %YAML:1.0, which is no directive of YAML, and reads names without a space after
    # the colon, as many files of ORB-SLAM2 have them.
    if text.lstrip().startswith("%YAML:"):
        text = CLOSE_COLON.sub(r"\1 ", text)
    text = re.sub(r"\A(\s*%[^\n]*\n)+", "", text)
    text = re.sub(r"\n---\s*\Z", "\n", text)  # with which `rostopic echo` ends a message
    try:
        if text.count("\n%") > MOST_DIRECTIVES:  # libyaml compares each one with all others
            raise _FaultError(f"more than {MOST_DIRECTIVES} directives")
        return _Tree(yaml.parse(text, Loader=_Parser)).document()
    except (yaml.YAMLError, _FaultError) as error:
        raise UnparsedError("YAML", one_line(error)) from None


class _FaultError(Exception):
    """A text that is YAML and no file of plain values."""


class _Tree:
    """Values of the events of a text."""

    def __init__(self, events: Iterator[Event]) -> None:
        self._events = events
        self._n_values = 0
        self._anchors: dict[str, tuple[Any, int]] = {}

    def document(self) -> Any:
        """Value of the only document, None where there is none."""
        value, n_documents = None, 0
        for event in self._events:
            if isinstance(event, DocumentStartEvent):
                n_documents += 1
                if n_documents > 1:
                    raise _FaultError("several documents; keep one")
                value = self._value(next(self._events), 0)
        return value

    def _value(self, event: Event, depth: int) -> Any:
        if isinstance(event, AliasEvent):
            if event.anchor not in self._anchors:
                raise _FaultError(f"an alias {shown(event.anchor)} that repeats nothing before it")
            value, count = self._anchors[event.anchor]
            self._count(count)
            return value
        before = self._n_values
        self._count(1)
        if isinstance(event, ScalarEvent):
            value = _scalar(event)
        else:
            assert isinstance(event, CollectionStartEvent)
            if depth == DEEPEST:
                raise _FaultError(f"more than {DEEPEST} nested levels")
            if (event.tag or "").removeprefix(PREFIX) not in ("", *COLLECTIONS):
                raise _FaultError(f"a value with tag {shown(event.tag)}; remove the tag")
            is_table = isinstance(event, MappingStartEvent)
            value = self._table(depth) if is_table else self._list(depth)
        if event.anchor is not None:
            self._anchors[event.anchor] = value, self._n_values - before
        return value

    def _list(self, depth: int) -> list[Any]:
        items: list[Any] = []
        while not isinstance(event := next(self._events), SequenceEndEvent):
            items.append(self._value(event, depth + 1))
        return items

    def _table(self, depth: int) -> ByName:
        figures: ByName = {}
        while not isinstance(event := next(self._events), MappingEndEvent):
            line = event.start_mark.line + 1 if event.start_mark else 0
            if not isinstance(event, ScalarEvent):
                raise _FaultError(f"a collection as a name, line {line}")
            if event.value in figures:
                raise _FaultError(
                    f"{shown(event.value)} twice in one table, line {line}; remove one"
                )
            figures[event.value] = self._value(next(self._events), depth + 1)
        return figures

    def _count(self, n: int) -> None:
        self._n_values += n
        if self._n_values > MOST_VALUES:
            raise _FaultError(f"more than {MOST_VALUES} values, with those that aliases repeat")


def _scalar(event: ScalarEvent) -> Any:
    text: str = event.value
    tag = (event.tag or "").removeprefix(PREFIX)
    if tag not in ("", "!", *SCALARS):
        raise _FaultError(f"a value with tag {shown(event.tag)}; remove the tag")
    if tag in ("!", "str") or (not tag and not event.implicit[0]):  # or in quotes
        return text
    if text in ("True", "TRUE", "False", "FALSE", "Null", "NULL") or text in WORDS:
        return WORDS[text.lower()]
    if INTEGER.fullmatch(text):
        return int(text)
    if REAL.fullmatch(text):
        return float(text)
    return float(text.replace(".", "")) if NOT_FINITE.fullmatch(text) else text
