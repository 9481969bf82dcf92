"""PLY files, text and binary.

Every element of the header is read or skipped in the file's order; vertices and faces may have any
other properties.

Source: G. Turk. The PLY Polygon File Format. 1994.
"""

import re
from array import array
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.base.errors import MeshError
from rastercov.base.memory import AnyArray
from rastercov.mesh.formats.polygons import (
    Polygons,
    broken,
    check,
    check_budget,
    check_count,
    fan_polygons,
)
from rastercov.mesh.formats.text import BYTE_ORDER_MARK, CUT_NOTE, Lines, trailing_lines

TYPES = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "float32": "f4",
    "float64": "f8",
}
BYTE_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
LIST_NAMES = ("vertex_indices", "vertex_index")


@dataclass
class Property:
    """Property of an element; `count_type` is "" unless it is a list."""

    name: str
    type: str
    count_type: str = ""


@dataclass
class Element:
    """Element of the header."""

    name: str
    count: int
    properties: list[Property]

    @property
    def lists(self) -> list[int]:
        """Indices of the properties that are lists."""
        return [i for i, p in enumerate(self.properties) if p.count_type]

    def index(self, names: tuple[str, ...], kinds: str, is_list: bool) -> int:
        """Index of the property with one of `names`; MeshError if there is none."""
        for i, p in enumerate(self.properties):
            if p.name in names and p.type[0] in kinds and bool(p.count_type) == is_list:
                return i
        names_of = [p.name for p in self.properties]
        raise broken(f"element {self.name!r}: expected a property {names[0]!r}, got {names_of}")


class Column(NamedTuple):
    """Values of one property in all rows; `counts` has the values of each row of a list."""

    values: AnyArray
    counts: NDArray[np.int64]


Columns = dict[tuple[str, int], Column]
"""Columns by the name of their element and the index of their property."""


def read(data: bytes, budget: int) -> Polygons:
    """Polygons of a PLY file; each triangle of a strip is a polygon."""
    data = data.removeprefix(BYTE_ORDER_MARK)
    end = re.search(rb"[\r\n][ \t]*end_header[ \t]*(\r\n|\r|\n)", data[: 1 << 20])
    if not data.startswith(b"ply") or end is None:
        raise MeshError("expected 'ply' ... 'end_header' at the start, got none; name a PLY file")
    lines = Lines(data[: end.end()], budget)
    order, elements = _header(lines)
    n_left = len(data) - end.end()
    for element in elements.values():
        sizes = [np.dtype(p.count_type or p.type).itemsize for p in element.properties]
        least = max(1, sum(sizes) if order else 2 * len(sizes))
        check_count(element.count, f"elements {element.name!r}", least, n_left)
    surfaces = [name for name in elements if name in SURFACES]
    has_both = "vertex" in elements and surfaces
    check(has_both, f"expected elements vertex and face, got {list(elements)}")
    vertex = elements["vertex"]
    axes = [("vertex", vertex.index((axis,), "iuf", False)) for axis in "xyz"]
    others = [
        each.name[:40]
        for each in elements.values()
        if each.name not in surfaces
        and each.count
        and any(each.properties[i].name in LIST_NAMES for i in each.lists)
    ]
    lists = [(name, elements[name].index(LIST_NAMES, "iu", True)) for name in surfaces]
    n_faces = elements["face"].count if "face" in elements else 0
    check_budget(n_faces, budget, vertex.count)

    if order:
        columns, notes = _binary(data, end.end(), order, elements, [*axes, *lists], budget)
    else:
        body = Lines(data[end.end() :], budget, number=lines.number)
        columns, notes = _text(body, elements, [*axes, *lists], budget)
    if others:
        notes = [
            *notes,
            f"ignored elements {', '.join(map(repr, others[:5]))}, which have vertices",
        ]
    coordinates = np.stack([columns[key].values for key in axes], axis=1)
    polygons = [SURFACES[key[0]](columns[key], budget) for key in lists]
    return fan_polygons(
        coordinates,
        np.concatenate([polygon.values for polygon in polygons]),
        np.concatenate([polygon.counts for polygon in polygons]),
        budget,
        notes,
    )


def _faces(lists: Column, budget: int) -> Column:
    """Corners of polygons, one list each."""
    few = np.flatnonzero(lists.counts < 3)
    if len(few):
        raise broken(f"face {few[0]}: expected 3 or more vertices, got {lists.counts[few[0]]}")
    return lists


def _strips(lists: Column, budget: int) -> Column:
    """Corners of triangles; -1 ends a strip within its list, odd triangles are reversed."""
    check_budget(len(lists.values), budget)
    corners = np.asarray(lists.values, np.int64)
    i = np.arange(len(corners))
    is_gap = corners == -1
    begins = np.zeros(len(corners) + 1, bool)
    begins[np.cumsum(lists.counts) - lists.counts] = True
    begins = begins[:-1]
    begins[1:] |= is_gap[:-1]
    step = i - np.maximum.accumulate(np.where(begins, i, 0))
    length = (step + 1 - is_gap) * np.append(begins[1:], True)  # at the end of each strip
    short = np.flatnonzero((length > 0) & (length < 3))
    if len(short):
        raise broken(
            f"expected a strip of 3 or more vertices, got one that ends at value {short[0]}"
        )
    last = np.flatnonzero((step >= 2) & ~is_gap)
    odd = step[last] % 2
    triangles = np.stack([corners[last - 2], corners[last - 1 + odd], corners[last - odd]], axis=1)
    return Column(triangles.reshape(-1), np.full(len(triangles), 3))


SURFACES = {"face": _faces, "tristrips": _strips}


def _header(lines: Lines) -> tuple[str, dict[str, Element]]:
    """Byte order ("" for text) and elements by name, in the file's order."""
    order, elements, current = None, {}, Element("", 0, [])
    lines.next("'ply'")
    for words in lines:
        match [word.decode("ascii", "replace") for word in words]:
            case ["format", kind, "1.0"] if kind in BYTE_ORDERS:
                order = BYTE_ORDERS[kind]
            case ["element", name, count] if count.isdecimal() and len(count) < 20:
                if name in elements:
                    raise lines.error("each element once", words)
                elements[name] = current = Element(name, int(count), [])
            case ["property", "list", count_type, kind, name] if current.name and (
                kind in TYPES and TYPES.get(count_type, "f")[0] != "f"
            ):
                current.properties.append(Property(name, TYPES[kind], TYPES[count_type]))
            case ["property", kind, name] if kind in TYPES and current.name:
                current.properties.append(Property(name, TYPES[kind]))
            case ["comment" | "obj_info" | "end_header", *_]:
                pass
            case _:
                raise lines.error("a format, element or property", words)
    if order is None:
        raise broken(f"expected a line 'format' with one of {list(BYTE_ORDERS)}, got none")
    return order, elements


def _text(
    lines: Lines, elements: dict[str, Element], wanted: list[tuple[str, int]], budget: int
) -> tuple[Columns, list[str]]:
    """Wanted columns of a body in text, and notes. A Python loop over the rows: 2 µs per row."""
    columns: Columns = {}
    is_cut = False
    for element in elements.values():
        if not element.properties:
            continue
        names = f"values for {' '.join(p.name for p in element.properties)}"
        # Coordinates are read as floats even if declared as integers, which have 32 bits at most.
        kept: dict[int, tuple[array[Any], array[int]]] = {
            i: (array("q" if element.properties[i].count_type else "d"), array("q"))
            for name, i in wanted
            if name == element.name
        }
        for words in lines.take(element.count, element.name):
            numbers = lines.floats(words, names)
            if not element.lists:
                if len(words) != len(element.properties):
                    raise lines.error(names, words)
                for i, (values, _) in kept.items():
                    values.append(numbers[i])
                continue
            row = _split(lines, element.properties, words, names)
            for i, (values, counts) in kept.items():
                is_list = element.properties[i].count_type
                values.extend((lines.integers if is_list else lines.floats)(row[i], names))
                counts.append(len(row[i]))
                if is_list:
                    check_budget(max(0, len(values) - 2 * len(counts)), budget)
        for i, (values, counts) in kept.items():
            columns[element.name, i] = Column(np.asarray(values), np.asarray(counts))
        if element.count:
            is_cut = bool(kept) and lines.is_cut
    return columns, [CUT_NOTE] if is_cut else trailing_lines(lines)


def _split(
    lines: Lines, properties: list[Property], words: list[bytes], names: str
) -> list[list[bytes]]:
    """Words of each property of a row with lists; MeshError for missing or extra words."""
    row, at = [], 0
    for p in properties:
        n = 1
        if p.count_type:
            (n,) = lines.integers(words[at : at + 1] or [b""], names)
            at += 1
        if not 0 <= n <= len(words) - at:
            raise lines.error(names, words)
        row.append(words[at : at + n])
        at += n
    if at < len(words):
        raise lines.error(names, words)
    return row


def _binary(
    data: bytes,
    offset: int,
    order: str,
    elements: dict[str, Element],
    wanted: list[tuple[str, int]],
    budget: int,
) -> tuple[Columns, list[str]]:
    """Wanted columns of a binary body that begins at `offset`, and notes."""
    columns: Columns = {}
    for element in elements.values():
        kept = [i for name, i in wanted if name == element.name]
        found, offset = _binary_rows(data, offset, order, element, kept, budget)
        columns |= {(element.name, i): column for i, column in found.items()}
    extra = len(data) - offset
    return columns, ([f"ignored {extra} bytes after the last element"] if extra else [])


def _binary_rows(
    data: bytes, offset: int, order: str, element: Element, kept: list[int], budget: int
) -> tuple[dict[int, Column], int]:
    """Columns `kept` of a binary element that begins at `offset`, and the offset of its end."""
    if not element.count or not element.properties:
        return {i: Column(np.empty(0), np.empty(0, np.int64)) for i in kept}, offset
    lengths, after_first = _row_lengths(data, offset, order, element)
    end = offset + (after_first - offset) * element.count
    if end <= len(data):
        # If every row has the lengths of the first one, which the counts prove, no loop is needed.
        fields: list[tuple[str, str, tuple[int, ...]]] = []
        for i, (p, n) in enumerate(zip(element.properties, lengths, strict=True)):
            if p.count_type:
                fields.append((f"n{i}", order + p.count_type, ()))
            fields.append((f"v{i}", order + p.type, (n,)))
        rows = np.frombuffer(data, np.dtype(fields), element.count, offset)
        if all((rows[f"n{i}"] == lengths[i]).all() for i in element.lists):
            check_budget(max([element.count * (lengths[i] - 2) for i in kept], default=0), budget)
            return {
                i: Column(rows[f"v{i}"].reshape(-1), np.full(element.count, lengths[i]))
                for i in kept
            }, end
    # Rows of several lengths: a Python loop over the rows, 3 µs per row.
    pieces = {i: bytearray() for i in kept}
    counts = {i: array("q") for i in kept}
    n_corners = 0
    for k in range(element.count):
        lengths, _ = _row_lengths(data, offset, order, element)
        for i, (p, n) in enumerate(zip(element.properties, lengths, strict=True)):
            size = n * int(p.type[1])
            offset += int(p.count_type[1:] or 0)
            if i in pieces:
                n_corners += n * bool(p.count_type)
                check_budget(max(0, n_corners - 2 * k - 2), budget)
                counts[i].append(n)
                pieces[i] += data[offset : offset + size]
            offset += size
    return {
        i: Column(np.frombuffer(piece, order + element.properties[i].type), np.asarray(counts[i]))
        for i, piece in pieces.items()
    }, offset


def _row_lengths(data: bytes, offset: int, order: str, element: Element) -> tuple[list[int], int]:
    """Number of values of each property in the row at `offset`, and the offset of its end."""
    lengths = []
    for p in element.properties:
        n = 1
        if p.count_type and offset + int(p.count_type[1]) <= len(data):
            n = int(np.frombuffer(data, order + p.count_type, 1, offset)[0])
        offset += int(p.count_type[1:] or 0) + n * int(p.type[1])
        lengths.append(n)
        if n < 0 or offset > len(data):
            raise broken(
                f"expected {n} values of {p.name!r} of element {element.name!r} up to byte "
                f"{offset}, got {len(data)} bytes; truncated"
            )
    return lengths, offset
