"""Lines, words and numbers of mesh files in text: OBJ, OFF, ASCII STL and text PLY.

Numbers consist of ASCII digits, a sign, a point, an exponent; Python's "1_0" for ten is refused. A
line is read completely, so an unexpected word is an error and is never skipped. `read_obj`,
`read_off` and `read_stl` are here; PLY has a file of its own.

STL repeats every vertex; vertices that are equal bit for bit are merged. Of an ASCII file with
several `solid` sections, each is a group.

Sources: Wavefront Technologies. Advanced Visualizer Manual, appendix B1. 1993. The Geometry Center.
Geomview Manual, section OFF Files. 3D Systems. StereoLithography Interface Specification. 1989.
"""

import codecs
import io
import re
from array import array
from collections import Counter
from collections.abc import Callable, Container, Iterator, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from rastercov.base.errors import MeshError, ResourceError
from rastercov.base.format import plural
from rastercov.base.memory import Float32Array, FloatArray
from rastercov.mesh.formats.polygons import (
    PEAK_BYTES_PER_VERTEX,
    Polygons,
    broken,
    check,
    check_budget,
    check_count,
    fan_polygons,
)
from rastercov.mesh.topology import first_equal_row

T = TypeVar("T", int, float)

BYTE_ORDER_MARK = b"\xef\xbb\xbf"  # UTF-8; Windows programs write it before the first word
BYTES_PER_CHARACTER = 40  # memory of a line's words: 37 measured with one digit a word
JOINT = b"\v"  # separates words, as spaces do, and marks each place where two lines are joined
FREE_CHARACTERS = 1 << 16  # length of a line that is accepted under any budget
CUT_NOTE = "the file ends within a line: its last number may be cut, and lines may be missing"


class Lines:
    """Iterator over the lines of a text, split into words; blank lines are left out.

    A line ends with a line feed, a carriage return or both.

    Parameters
    ----------
    data : bytes
    budget : int
        Bytes that the words of one line may take.
    comment : bytes
        Start of a comment; empty if the format has none.
    joins : bool
        True if a backslash at the end of a line continues it.
    number : int
        Number of lines before the text.

    Attributes
    ----------
    number : int
        Number of the latest line; of its last part, if it was continued.
    ends_inside_line : bool
        True if the last line has no line end, or ends with a backslash.
    """

    def __init__(
        self,
        data: bytes,
        budget: int,
        comment: bytes = b"",
        *,
        joins: bool = False,
        number: int = 0,
    ) -> None:
        data = data.removeprefix(BYTE_ORDER_MARK)
        if b"\r" in data:
            data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        # Words like 1_0 are rare, and their test costs time at every number.
        self._has_underscores = b"_" in data
        self.number = number
        self.ends_inside_line = not data.endswith(b"\n")
        last = number + data.count(b"\n") + 1
        self._is_joined = joins and b"\\" in data
        if self._is_joined:
            if comment:
                data = re.sub(re.escape(comment) + rb"[^\n]*", b"", data)
            self.ends_inside_line |= data.removesuffix(b"\n").rstrip(b" \t\f\v").endswith(b"\\")
            data = data.replace(JOINT, b" ").replace(b"\\\n", JOINT)
            data = re.sub(rb"\\[ \t\f]+\n", JOINT, data).removesuffix(b"\\")
        self._cut_line = last if self.ends_inside_line else -1
        self._lines = self._words(
            data, max(budget // BYTES_PER_CHARACTER, FREE_CHARACTERS), comment
        )

    @property
    def is_cut(self) -> bool:
        """True when the file ends inside the latest line."""
        return self.number == self._cut_line

    def _words(self, data: bytes, longest: int, comment: bytes) -> Iterator[list[bytes]]:
        for line in io.BytesIO(data):
            self.number += 1
            if self._is_joined:
                self.number += line.count(JOINT)
            if len(line) > longest:
                raise ResourceError(
                    f"line {self.number}: expected at most {longest * BYTES_PER_CHARACTER} bytes, "
                    f"got {len(line)} characters of {BYTES_PER_CHARACTER} bytes; split the line, "
                    "or raise memory_budget"
                )
            words = (line.partition(comment)[0] if comment else line).split()
            if words:
                yield words

    def __iter__(self) -> Iterator[list[bytes]]:
        return self._lines

    def next(self, wanted: str) -> list[bytes]:
        """Words of the next line; MeshError if there is none."""
        for words in self._lines:
            return words
        raise MeshError(
            f"expected {wanted} after line {self.number}, got the end of the file; it is truncated"
        )

    def take(self, n: int, what: str) -> Iterator[list[bytes]]:
        """Words of the next n lines, one `what` a line; MeshError if there are fewer."""
        i = 0  # afterwards the number of lines that were there
        for i, words in zip(range(1, n + 1), self._lines, strict=False):  # noqa: B007
            yield words
        if i < n:
            self.next(f"{what} {i} of {n}")

    def error(self, wanted: str, words: Sequence[bytes]) -> MeshError:
        """Error that names the expected and the actual content of the latest line."""
        text = b" ".join(words[:60])[:60].decode("ascii", "replace")
        return MeshError(f"line {self.number}: expected {wanted}, got {text!r}; correct the line")

    def floats(self, words: Sequence[bytes], wanted: str) -> list[float]:
        """Numbers, including nan and inf."""
        return self._numbers(float, words, wanted)

    def integers(self, words: Sequence[bytes], wanted: str) -> list[int]:
        """Integers of 64 bits."""
        return self._numbers(int, words, wanted)

    def _numbers(self, kind: Callable[[bytes], T], words: Sequence[bytes], wanted: str) -> list[T]:
        try:
            if self._has_underscores and b"_" in b"".join(words):
                raise ValueError
            values = list(map(kind, words))
            if kind is int:
                array("q", values)
        except (ValueError, OverflowError):
            raise self.error(wanted, words) from None
        return values

    def point(self, words: Sequence[bytes], n_more: Container[int] = ()) -> list[float]:
        """Three coordinates, optionally followed by `n_more` other numbers."""
        if len(words) == 3:
            return self.floats(words, "three coordinates")
        if len(words) - 3 not in n_more:
            raise self.error("three coordinates", words)
        return self.floats(words, "three coordinates and other numbers")[:3]


def utf_8(data: bytes) -> bytes:
    """A text in UTF-8 of one in UTF-16 with a byte order mark; other data as it is."""
    if not data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return data
    try:
        text = data.decode("utf-16")
    except UnicodeDecodeError:
        return data
    return text.encode() if re.match(r"[\s#\w]", text, re.ASCII) else data


def trailing_lines(lines: Lines) -> list[str]:
    """A note if lines are left over."""
    last = lines.number
    return [f"ignored the lines after line {last}"] if any(True for _ in lines) else []


IGNORED = frozenset(
    b"vt vn vp s mg bevel c_interp d_interp lod usemtl mtllib usemap maplib shadow_obj "
    b"trace_obj".split()
)
"""Keywords of the format without influence on the shape of polygons."""


WITHOUT_SURFACE = {b"l": "polyline", b"p": "point element"}
"""Elements by their keywords."""
FACE = (b"f", b"fo")
"""Keywords of a face; version 2.11 of the format wrote fo, which readers take as f."""
EXTRA_NUMBERS = (1, 3, 4)
"""Numbers that may follow the coordinates of a vertex: a weight, a colour, or both."""
WITH_WEIGHT = 5
"""Words of the line of a vertex with a weight alone."""
CORNERS = re.compile(rb"(?: [+-]?[0-9]+(?:/(?:[+-]?[0-9]+)?){0,2})*")
"""Corners of a face: 1, 1/2, 1//3 or 1/2/3."""


def read_obj(data: bytes, budget: int) -> Polygons:
    """Polygons of an OBJ file.

    A face belongs to the last group or object named before it. A Python loop over the lines: about
    1 µs per vertex and 2 µs per face.
    """
    lines = Lines(data, budget, comment=b"#", joins=True)
    coordinates, corners, n_corners = array("d"), array("q"), array("q")
    groups, face_line, current = array("q"), array("q"), 0
    weighted = array("q")  # lines of vertices with a weight other than 1
    doubtful = array("q")  # lines that are a face with one bit changed
    number_of: dict[str | None, int] = {None: 0}
    n_without: Counter[bytes] = Counter()
    most_coordinates = 3 * (budget // PEAK_BYTES_PER_VERTEX)
    for words in lines:
        keyword = words[0]
        if keyword == b"v":
            if doubtful and doubtful[-1] == lines.number - 1:
                doubtful.pop()  # the first of several vertices, after the faces of an object
            elif face_line and face_line[-1] == lines.number - 1 and _may_be_face(words):
                doubtful.append(lines.number)
            coordinates.extend(lines.point(words[1:], EXTRA_NUMBERS))
            if len(words) == WITH_WEIGHT and float(words[4]) != 1:
                weighted.append(lines.number)
            if len(coordinates) > most_coordinates:
                check_budget(len(n_corners), budget, len(coordinates) // 3)
        elif keyword in FACE:
            corners.extend(_corners(lines, words, len(coordinates) // 3))
            n_corners.append(len(words) - 1)
            groups.append(current)
            face_line.append(lines.number)
            check_budget(len(corners) - 2 * len(n_corners), budget, len(coordinates) // 3)
        elif keyword in (b"g", b"o"):
            if _may_be_face(words):
                doubtful.append(lines.number)
            name = b" ".join(words[1:]).decode("utf-8", "replace") or None
            current = number_of.setdefault(name, len(number_of))
        elif keyword in WITHOUT_SURFACE:
            n_without[keyword] += 1
        elif keyword not in IGNORED:
            raise lines.error("a keyword of polygonal OBJ files", words)
    n_vertices = len(coordinates) // 3
    beyond = np.flatnonzero(np.asarray(corners) >= n_vertices)
    if len(beyond):
        face = int(np.searchsorted(np.cumsum(n_corners), beyond[0], side="right"))
        raise broken(
            f"line {face_line[face]}: expected vertex indices in 1 ... {n_vertices}, got "
            f"{corners[beyond[0]] + 1}"
        )
    notes = [CUT_NOTE] if lines.ends_inside_line else []
    if doubtful:
        more = f" (and {len(doubtful) - 1} others)" if len(doubtful) > 1 else ""
        notes.append(f"ignored line {doubtful[0]}{more}, which may be a face: its keyword is not f")
    if weighted:
        notes.append(
            f"ignored the weights of {plural(len(weighted), 'vertex')}, the first in line "
            f"{weighted[0]}: coordinates are not divided by them"
        )
    for keyword, n in n_without.items():
        notes.append(f"ignored {plural(n, WITHOUT_SURFACE[keyword])}: no surface")
    polygons = fan_polygons(coordinates, corners, n_corners, budget, notes)
    face_group = np.asarray(groups, dtype=np.int64)[polygons.source_face]
    return replace(polygons, face_group=face_group, group_names=list(number_of))


def _may_be_face(words: list[bytes]) -> bool:
    """True for a line of three corners or more, and a keyword that differs by one bit."""
    return len(words) > 3 and CORNERS.fullmatch(b" " + b" ".join(words[1:])) is not None


def _corners(lines: Lines, words: list[bytes], n_vertices: int) -> list[int]:
    """Corners of "f 1/2/3 ...", from 0; negative ones count back from the latest vertex."""
    indices = words[1:]
    text = b" " + b" ".join(indices)
    if b"/" in text:
        if not CORNERS.fullmatch(text):
            raise lines.error("corners of whole numbers, as 1, 1/2, 1//3 or 1/2/3", words)
        indices = [word.partition(b"/")[0] for word in indices]
    corners = lines.integers(indices, "whole numbers as vertex indices")
    if len(corners) < 3:
        raise lines.error("a face of 3 or more vertices", words)
    if min(corners) > 0:
        return [corner - 1 for corner in corners]
    if 0 in corners or min(corners) < -n_vertices:
        raise lines.error(f"vertex indices from 1, or from -1 to -{n_vertices}", words)
    return [corner - 1 if corner > 0 else corner + n_vertices for corner in corners]


EXTRA_OF_VERTEX = {b"": (0, 3, 4), b"C": (3, 4), b"N": (3,), b"CN": (6, 7)}
EXTRA_OF_VERTEX |= {
    b"ST" + key: tuple(n + 2 for n in more) for key, more in EXTRA_OF_VERTEX.items()
} | {b"ST": (2,)}
"""Numbers after the coordinates of a vertex, by the prefix of OFF: normals, a colour of three or
four numbers, texture coordinates. Some programs write colours into files with a plain OFF."""
EXTRA_OF_FACE = (0, 1, 3, 4)
"""Numbers after the corners of a face: none, an index into a table of colours, or a colour."""


def read_off(data: bytes, budget: int) -> Polygons:
    """Polygons of an OFF file in text, with or without colours, normals and texture."""
    lines = Lines(data, budget, comment=b"#")
    words = lines.next("'OFF'")
    if words[0].isdigit():  # the keyword is optional, and some collections lack it
        words = [b"OFF", *words]
    kind = words[0].removesuffix(b"OFF")
    if not words[0].endswith(b"OFF") or kind not in EXTRA_OF_VERTEX or b"BINARY" in words:
        raise lines.error("'OFF' (in text, three coordinates)", words)
    counts = words[1:] or lines.next("the counts of vertices, faces, edges")
    if len(counts) not in (2, 3):
        raise lines.error("the counts of vertices, faces, edges", counts)
    n_vertices, n_faces = lines.integers(counts, "the counts of vertices, faces, edges")[:2]
    check_count(n_vertices, "vertices", 6, len(data))
    check_count(n_faces, "faces", 8, len(data))
    check_budget(n_faces, budget, n_vertices)
    coordinates, corners, n_corners = array("d"), array("q"), array("q")
    more = EXTRA_OF_VERTEX[kind]
    for words in lines.take(n_vertices, "vertex"):
        coordinates.extend(lines.point(words, more))
    for words in lines.take(n_faces, "face"):
        polygon = _polygon(lines, words)
        corners.extend(polygon)
        n_corners.append(len(polygon))
        check_budget(len(corners) - 2 * len(n_corners), budget, n_vertices)
    is_cut = n_faces > 0 and lines.is_cut and len(words) == len(polygon) + 1
    notes = [CUT_NOTE] if is_cut else trailing_lines(lines)
    return fan_polygons(coordinates, corners, n_corners, budget, notes)


def _polygon(lines: Lines, words: list[bytes]) -> list[int]:
    """Corners of "n i1 ... in"; numbers that follow are a colour."""
    (n,) = lines.integers(words[:1], "a corner count and vertex indices")
    if n < 3 or len(words) <= n or len(words) - 1 - n not in EXTRA_OF_FACE:
        raise lines.error(
            "a corner count of 3 or more and as many vertex indices, with or without a colour",
            words,
        )
    lines.floats(words[1 + n :], "a colour after the vertex indices")
    return lines.integers(words[1 : 1 + n], "a corner count and vertex indices")


FACET = ((b"outer", 2), *[(b"vertex", 4)] * 3, (b"endloop", 1), (b"endfacet", 0))
"""First words of the lines after `facet`, and their numbers of words; 0 where a name may follow."""


def read_stl(data: bytes, budget: int) -> Polygons:
    """Polygons of an STL file, binary or ASCII.

    Many binary files begin with "solid" as well, so the file size is tested first.
    """
    declared = int.from_bytes(data[80:84], "little") if len(data) >= 84 else -1
    fits = len(data) == 84 + 50 * declared
    start = data[:1024].removeprefix(BYTE_ORDER_MARK).lstrip().lower()
    is_text = start.startswith(b"solid") and b"\0" not in start
    if is_text and not fits:
        return _ascii_stl(data.rstrip(b"\0\x1a"), budget)  # some writers pad the end
    n = len(data)
    check(n >= 84, f"expected 84 bytes before the triangles of a binary STL, got {n}")
    extra = n - 84 - 50 * declared
    check(
        extra >= 0,
        f"expected {declared} triangles, as declared ({84 + 50 * declared} bytes), got {n} "
        f"bytes, to triangle {(n - 84) // 50}; truncated",
    )
    check(
        declared or extra < 50,
        f"expected {extra // 50} triangles from the file size, got 0 in its header",
    )
    check_budget(declared, budget)
    notes = [f"ignored {extra} bytes after the last triangle"] if extra else []
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    records = np.frombuffer(data, dtype=record, count=declared, offset=84)
    return _indexed(records["corners"].reshape(-1, 3), budget, notes)


def _indexed(corners: Float32Array | FloatArray, budget: int, notes: Sequence[str]) -> Polygons:
    """Triangles of (3 F, 3) corners, where corners that are equal bit for bit become one vertex.

    All are in one group.
    """
    n_faces = len(corners) // 3
    index = np.arange(n_faces)
    if not n_faces:
        return Polygons(np.empty((0, 3)), np.empty((0, 3), np.int64), index, index)
    if corners.dtype == np.float32:
        bits = corners.view(np.uint32)
        rows = np.zeros((len(bits), 2), dtype=np.uint64)
        rows[:, 0] = bits[:, 1]
        rows[:, 0] |= bits[:, 0].astype(np.uint64) << np.uint64(32)
        rows[:, 1] = bits[:, 2]
    else:
        rows = corners.view(np.uint64)
    first = first_equal_row(rows)
    is_first = first == np.arange(len(first))
    number = np.cumsum(is_first) - 1
    check_budget(n_faces, budget, int(number[-1]) + 1)
    vertices = corners[is_first].astype(np.float64)
    faces = number[first].reshape(-1, 3)
    return Polygons(vertices, faces, index, np.zeros(n_faces, np.int64), notes=notes)


def _ascii_stl(data: bytes, budget: int) -> Polygons:
    """Polygons of an ASCII STL. A Python loop: 0.5 µs per line, 7 lines per triangle."""
    lines, corners = Lines(data, budget), array("d")
    is_open, is_cut, name = False, False, list[bytes]()
    names, n_before = list[str | None](), array("q")  # of each solid; triangles before it
    for words in lines:
        word = words[0].lower()
        if is_open and word == b"facet":
            check_budget(len(corners) // 9 + 1, budget)
            for (wanted, n), row in zip(FACET, lines, strict=False):
                if row[0].lower() != wanted or (n and len(row) != n):
                    raise lines.error(f"{wanted.decode()!r} in a facet of 3 vertices", row)
                if wanted == b"vertex":
                    corners.extend(lines.floats(row[1:], "three coordinates"))
        elif is_open and word in (b"endsolid", b"end"):
            is_open, is_cut = False, words[1:] not in ([], name)
        elif not is_open and word == b"solid":
            is_open, name = True, words[1:]
            names.append(b" ".join(name).decode("utf-8", "replace") or None)
            n_before.append(len(corners) // 9)
        else:
            raise lines.error("'facet' or 'endsolid'" if is_open else "'solid'", words)
    if is_open:
        lines.next("'endsolid'")
    # Many programs write no line end after `endsolid`, and do not repeat the solid's name there.
    notes = [CUT_NOTE] if lines.ends_inside_line and is_cut else []
    polygons = _indexed(np.asarray(corners).reshape(-1, 3), budget, notes)
    if len(names) < 2:  # the name of a lone solid is often that of the program
        return polygons
    solid = np.searchsorted(n_before, polygons.source_face, side="right") - 1
    return replace(polygons, face_group=solid, group_names=names)
