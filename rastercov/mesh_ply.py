"""PLY: from the bytes of a file, text or binary, to its polygons.

Serves `mesh_file`, under the rules of `mesh_formats`. Every element of the header is read or
stepped over in the file's order; vertices and faces may have any other properties.

Source: G. Turk. The PLY Polygon File Format. 1994.
"""

import re
import struct
from array import array
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.errors import MeshError
from rastercov.mesh_formats import (
    Lines,
    Polygons,
    check_budget,
    check_count,
    fan_polygons,
    trailing_lines,
)

TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8",
}  # fmt: skip
STRUCT_CODES = dict(zip(("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8"), "bBhHiIfd", strict=True))
BYTE_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
LIST_NAMES = ("vertex_indices", "vertex_index")


@dataclass
class Property:
    """One property of an element; `count_type` is "" unless it is a list."""

    name: str
    type: str
    count_type: str = ""


@dataclass
class Element:
    """One element of the header."""

    name: str
    count: int
    properties: list[Property]

    @property
    def lists(self) -> list[int]:
        """Places of the properties that are lists."""
        return [i for i, p in enumerate(self.properties) if p.count_type]

    def index(self, names: tuple[str, ...], kinds: str, is_list: bool) -> int:
        """Place of the property with one of `names`; MeshError if it is not there."""
        for i, p in enumerate(self.properties):
            if p.name in names and p.type[0] in kinds and bool(p.count_type) == is_list:
                return i
        raise MeshError(
            f"element {self.name!r} wants a property {names[0]!r}, has "
            f"{[p.name for p in self.properties]}; export it again"
        )


class Column(NamedTuple):
    """Values of one property, row after row; how many each row has is filled in for lists."""

    values: NDArray[Any]
    counts: NDArray[np.int64]


def read_ply(data: bytes, budget: int) -> Polygons:
    """Polygons of a PLY file."""
    end = re.search(rb"[\r\n]end_header[ \t]*(\r\n|\r|\n)", data[: 1 << 20])
    if not data.startswith(b"ply") or end is None:
        raise MeshError("'ply' ... 'end_header' wanted at the start, not there; it is no PLY file")
    lines = Lines(data[: end.end()])
    order, elements = _header(lines)
    body = memoryview(data)[end.end() :]
    for element in elements.values():
        sizes = [np.dtype(p.count_type or p.type).itemsize for p in element.properties]
        least = max(1, sum(sizes) if order else 2 * len(sizes))
        check_count(element.count, f"elements {element.name!r}", least, len(body))
    if "vertex" not in elements or "face" not in elements:
        raise MeshError(f"no triangles: elements vertex and face wanted, got {list(elements)}")
    check_budget(elements["face"].count, budget)
    vertex, face = elements["vertex"], elements["face"]
    axes = [vertex.index((axis,), "iuf", False) for axis in "xyz"]
    corner_list = face.index(LIST_NAMES, "iu", True)

    body_lines, offset = Lines(bytes(body) if not order else b"", number=lines.number), 0
    columns: dict[str, list[Column]] = {}
    for element in elements.values():
        if order:
            columns[element.name], offset = _binary_rows(data, offset or end.end(), order, element)
        else:
            columns[element.name] = _text_rows(body_lines, element)
    if not order:
        notes = trailing_lines(body_lines)
    else:
        extra = len(data) - offset
        notes = [f"{extra} trailing bytes after the last element were not read"] if extra else []
    coordinates = np.stack([columns["vertex"][i].values for i in axes], axis=1)
    corners = columns["face"][corner_list]
    few = np.flatnonzero(corners.counts < 3)
    if len(few):
        raise MeshError(
            f"face {few[0]}: 3 or more vertices wanted, got {corners.counts[few[0]]}; "
            "remove points and lines from the faces"
        )
    return fan_polygons(coordinates, corners.values, corners.counts, budget, notes)


def _header(lines: Lines) -> tuple[str, dict[str, Element]]:
    """Byte order ("" is text) and elements by name, in the file's order."""
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
        raise MeshError(f"a line 'format' with one of {list(BYTE_ORDERS)} wanted, there is none")
    return order, elements


def _text_rows(lines: Lines, element: Element) -> list[Column]:
    """Columns of an element in text. A walk over the rows: about 2 µs each."""
    values: list[array[Any]] = [array("d" if p.type[0] == "f" else "q") for p in element.properties]
    counts = [array("q") for _ in element.properties]
    if not element.properties:
        return []
    for i in range(element.count):
        words = lines.next(f"{element.name} {i} of {element.count}")
        at = 0
        try:
            for p, value, count in zip(element.properties, values, counts, strict=True):
                n = 1
                if p.count_type:
                    n, at = int(words[at]), at + 1
                    count.append(n)
                if not 0 <= n <= len(words) - at:
                    raise IndexError
                convert: type[float] = float if p.type[0] == "f" else int
                value.extend([convert(word) for word in words[at : at + n]])
                at += n
        except (ValueError, OverflowError, IndexError):
            wanted = " ".join(p.name for p in element.properties)
            raise lines.error(f"values for {wanted}", words) from None
    return [Column(np.asarray(v), np.asarray(n)) for v, n in zip(values, counts, strict=True)]


def _binary_rows(
    data: bytes, offset: int, order: str, element: Element
) -> tuple[list[Column], int]:
    """Columns of a binary element that begins at `offset`, and where it ends."""
    if not element.count or not element.properties:
        return [Column(np.empty(0), np.empty(0, np.int64)) for _ in element.properties], offset
    lengths, after_first = _row_lengths(data, offset, order, element)
    end = offset + (after_first - offset) * element.count
    if end <= len(data):
        # Every row as long as the first: one look at the counts proves it.
        fields: list[tuple[str, str, tuple[int, ...]]] = []
        for i, (p, n) in enumerate(zip(element.properties, lengths, strict=True)):
            if p.count_type:
                fields.append((f"n{i}", order + p.count_type, ()))
            fields.append((f"v{i}", order + p.type, (n,)))
        rows = np.frombuffer(data, np.dtype(fields), element.count, offset)
        if all((rows[f"n{i}"] == lengths[i]).all() for i in element.lists):
            return [
                Column(rows[f"v{i}"].reshape(-1), np.full(element.count, n))
                for i, n in enumerate(lengths)
            ], end
    # Rows of several lengths. A walk over them: about 3 µs each.
    pieces: list[array[Any]] = [array(STRUCT_CODES[p.type]) for p in element.properties]
    counts = [array("q") for _ in element.properties]
    for _ in range(element.count):
        lengths, _ = _row_lengths(data, offset, order, element)
        for i, (p, n) in enumerate(zip(element.properties, lengths, strict=True)):
            if p.count_type:
                offset += int(p.count_type[1])
            counts[i].append(n)
            pieces[i].extend(struct.unpack_from(f"{order}{n}{STRUCT_CODES[p.type]}", data, offset))
            offset += n * int(p.type[1])
    return [
        Column(np.asarray(v), np.asarray(n)) for v, n in zip(pieces, counts, strict=True)
    ], offset


def _row_lengths(data: bytes, offset: int, order: str, element: Element) -> tuple[list[int], int]:
    """Number of values of each property in the row at `offset`, and where that row ends."""
    lengths = []
    for p in element.properties:
        n = 1
        if p.count_type and offset + int(p.count_type[1]) <= len(data):
            (n,) = struct.unpack_from(order + STRUCT_CODES[p.count_type], data, offset)
        offset += int(p.count_type[1:] or 0) + n * int(p.type[1])
        lengths.append(n)
        if n < 0 or offset > len(data):
            raise MeshError(
                f"element {element.name!r} needs {n} values of {p.name!r} up to byte offset "
                f"{offset}, the file has {len(data)} bytes; it is truncated, export it again"
            )
    return lengths, offset
