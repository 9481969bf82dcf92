"""STL, OBJ and OFF: from the bytes of a file to its polygons.

Serves `mesh_file`. A reader believes nothing that a file says about itself: a count is held against
the bytes that are there before anything is allocated, and what cannot be understood is an error
with its line or byte. Readers keep the file's order of vertices and polygons and neither merge nor
drop; only STL, which repeats every vertex, has those merged that are equal bit for bit.

Sources: 3D Systems. StereoLithography Interface Specification. 1989. Wavefront Technologies.
Advanced Visualizer Manual, appendix B1. 1993.
"""

import io
import re
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.errors import MeshError, ResourceError
from rastercov.mesh_arrays import MOST_FACES
from rastercov.topology import first_equal_row

PEAK_BYTES_PER_FACE = 300  # 250 measured while reading a binary STL of 10^7, the greediest


@dataclass
class Polygons:
    """What a file holds.

    Attributes
    ----------
    vertices : (V, 3) float64
        In the file's unit.
    faces : (F, 3) int64
        Indices that the caller has yet to check; polygons are cut into fans.
    source_face : (F,) int64
        Polygon of each face.
    label : (F,) int64
        Index into `names`.
    names : list of str
        Groups; None for faces outside any.
    notes : list of str
        Oddities that a person should know of.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    source_face: NDArray[np.int64]
    label: NDArray[np.int64]
    names: list[str | None] = field(default_factory=lambda: [None])
    notes: list[str] = field(default_factory=list)


def check_budget(n_faces: int, budget: int) -> None:
    """Raise ResourceError, before anything is allocated, when `n_faces` need too much memory."""
    need = n_faces * PEAK_BYTES_PER_FACE
    if n_faces > MOST_FACES or need > budget:
        raise ResourceError(
            f"{n_faces} triangles need about {need} bytes, the budget is {budget} bytes (and "
            f"{MOST_FACES} triangles); simplify the mesh, split it, or raise memory_budget"
        )


def fan_polygons(
    vertices: ArrayLike,
    corners: ArrayLike,
    n_corners: ArrayLike,
    budget: int,
    notes: Sequence[str] = (),
) -> Polygons:
    """Polygons cut into fans about their first corner.

    Parameters
    ----------
    vertices : (V, 3) float
    corners : (N,) int
        Vertex indices, one polygon after the other.
    n_corners : (P,) int
        Corners of each polygon, at least 3; they add up to N.
    budget : int
        Bytes that the triangles may need.
    notes : sequence of str
        Oddities to pass on.
    """
    corners, n_corners = np.asarray(corners, np.int64), np.asarray(n_corners, np.int64)
    n_triangles = n_corners - 2
    check_budget(int(n_triangles.sum()), budget)
    polygon = np.repeat(np.arange(len(n_corners)), n_triangles)
    first = (np.cumsum(n_corners) - n_corners)[polygon]
    step = np.arange(len(polygon)) - (np.cumsum(n_triangles) - n_triangles)[polygon]
    faces = np.stack([corners[first], corners[first + step + 1], corners[first + step + 2]], axis=1)
    points = np.array(vertices, dtype=np.float64).reshape(-1, 3)
    return Polygons(points, faces, polygon, np.zeros_like(polygon), notes=list(notes))


class Lines:
    """Lines of a text with their numbers, split into words; blank ones are left out.

    Parameters
    ----------
    data : bytes
    comment : bytes
        What begins a comment, if there are comments.
    joins : bool
        Whether a backslash at the end of a line continues it.
    number : int
        Lines that went before.
    """

    def __init__(
        self, data: bytes, comment: bytes = b"", *, joins: bool = False, number: int = 0
    ) -> None:
        self.number = number
        self._lines = self._words(data, comment, joins)

    def _words(self, data: bytes, comment: bytes, joins: bool) -> Iterator[list[bytes]]:
        if b"\n" not in data:
            data = data.replace(b"\r", b"\n")
        begun: list[bytes] = []
        for line in io.BytesIO(data):
            self.number += 1
            line = line.partition(comment)[0] if comment else line
            words = begun + line.split()
            begun = []
            if joins and words and words[-1].endswith(b"\\"):
                begun = [*words[:-1], words[-1][:-1]] if words[-1] != b"\\" else words[:-1]
            elif words:
                yield words
        if begun:
            yield begun

    def __iter__(self) -> Iterator[list[bytes]]:
        return self._lines

    def next(self, wanted: str) -> list[bytes]:
        """Words of the next line; MeshError if there is none."""
        for words in self._lines:
            return words
        raise MeshError(f"{wanted} wanted after line {self.number}, the file ends; it is truncated")

    def error(self, wanted: str, words: Sequence[bytes]) -> MeshError:
        """Error that says what this line should have held."""
        text = b" ".join(words)[:60].decode("ascii", "replace")
        return MeshError(f"line {self.number}: {wanted} wanted, got {text!r}; correct the line")

    def floats(self, words: Sequence[bytes]) -> tuple[float, float, float]:
        """Three coordinates at the start of `words`."""
        try:
            return float(words[0]), float(words[1]), float(words[2])
        except (ValueError, IndexError):
            raise self.error("three coordinates", words) from None

    def polygon(self, words: Sequence[bytes]) -> list[int]:
        """Corners of "n i1 ... in ..." (OFF and PLY); words that follow are colours."""
        try:
            corners = [int(word) for word in words[1 : 1 + int(words[0])]]
            array("q", corners)
        except (ValueError, OverflowError, IndexError):
            raise self.error("a corner count and vertex indices", words) from None
        if len(corners) < 3 or len(corners) != int(words[0]):
            raise self.error("a corner count of 3 or more and as many vertex indices", words)
        return corners


def read_stl(data: bytes, budget: int) -> Polygons:
    """Polygons of an STL file, binary or ASCII.

    Many binary files begin with "solid", too, so the size decides first.
    """
    declared = int.from_bytes(data[80:84], "little") if len(data) >= 84 else -1
    fits = len(data) == 84 + 50 * declared
    start = data[:1024].lstrip().lower()
    is_text = start.startswith(b"solid") and b"\0" not in start
    if is_text and not fits:
        corners = _ascii_stl(data).reshape(-1, 3)
        return _indexed(corners, [])
    if len(data) < 84:
        raise MeshError(
            f"a binary STL has 84 bytes before its triangles, got {len(data)}; export it again"
        )
    room = (len(data) - 84) // 50
    if declared > room:
        raise MeshError(
            f"the header promises {declared} triangles ({84 + 50 * declared} bytes), the file has "
            f"{len(data)} bytes and ends in triangle {room} at byte offset {len(data)}; "
            "it is truncated, export it again"
        )
    check_budget(declared, budget)
    extra = len(data) - 84 - 50 * declared
    notes = [f"{extra} trailing bytes after the last triangle were not read"] if extra else []
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    records = np.frombuffer(data, dtype=record, count=declared, offset=84)
    return _indexed(records["corners"].reshape(-1, 3), notes)


def _indexed(corners: NDArray[np.float32] | NDArray[np.float64], notes: Sequence[str]) -> Polygons:
    """Soup of (3 F, 3) corners with those merged that are equal bit for bit."""
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
    vertices = corners[is_first].astype(np.float64)
    faces = number[first].reshape(-1, 3)
    return Polygons(vertices, faces, index, np.zeros(n_faces, np.int64), notes=list(notes))


def _ascii_stl(data: bytes) -> NDArray[np.float64]:
    """Corners, (9 F,). A walk over the lines: about 0.5 µs each, seven lines a triangle."""
    lines, corners, n_left, is_open = Lines(data), array("d"), 0, False
    facet = (b"facet", b"outer", b"vertex", b"vertex", b"vertex", b"endloop", b"endfacet")
    for words in lines:
        word = words[0].lower()
        if n_left:
            if word != facet[-n_left]:
                raise lines.error(f"{facet[-n_left].decode()!r} in a facet of 3 vertices", words)
            if word == b"vertex":
                corners.extend(lines.floats(words[1:]))
            n_left -= 1
        elif is_open and word == b"facet":
            n_left = len(facet) - 1
        elif is_open and word in (b"endsolid", b"end"):
            is_open = False
        elif not is_open and word == b"solid":
            is_open = True
        else:
            raise lines.error("'facet' or 'endsolid'" if is_open else "'solid'", words)
    if is_open:
        lines.next("'endsolid'")
    return np.asarray(corners)


# Keywords of the format that say nothing about the shape of polygons.
OBJ_IGNORED = frozenset(
    b"vt vn vp s p l mg bevel c_interp d_interp lod usemtl mtllib usemap maplib shadow_obj "
    b"trace_obj".split()
)


def read_obj(data: bytes, budget: int) -> Polygons:
    """Polygons of a Wavefront OBJ file; its material libraries are never opened.

    A face belongs to the group or object that was named last before it. A walk over the lines:
    about 1 µs a vertex and 2 µs a face.
    """
    lines = Lines(data, comment=b"#", joins=True)
    coordinates, corners, n_corners = array("d"), array("q"), array("q")
    label, face_line, current = array("q"), array("q"), 0
    number_of: dict[str | None, int] = {None: 0}
    for words in lines:
        keyword = words[0]
        if keyword == b"v":
            coordinates.extend(lines.floats(words[1:]))
        elif keyword == b"f":
            corners.extend(_obj_corners(lines, words, len(coordinates) // 3))
            n_corners.append(len(words) - 1)
            label.append(current)
            face_line.append(lines.number)
        elif keyword in (b"g", b"o"):
            name = b" ".join(words[1:]).decode("utf-8", "replace") or None
            current = number_of.setdefault(name, len(number_of))
        elif keyword not in OBJ_IGNORED:
            raise lines.error("a keyword of polygonal OBJ files", words)
    n_vertices = len(coordinates) // 3
    beyond = np.flatnonzero(np.asarray(corners) >= n_vertices)
    if len(beyond):
        face = int(np.searchsorted(np.cumsum(n_corners), beyond[0], side="right"))
        raise MeshError(
            f"line {face_line[face]}: vertex indices must lie in 1 ... {n_vertices}, "
            f"got {corners[beyond[0]] + 1}; correct the face"
        )
    polygons = fan_polygons(coordinates, corners, n_corners, budget)
    polygons.label = np.asarray(label, dtype=np.int64)[polygons.source_face]
    polygons.names = list(number_of)
    return polygons


def _obj_corners(lines: Lines, words: Sequence[bytes], n_vertices: int) -> list[int]:
    """Corners of "f 1/2/3 ...", from 0; negative ones count back from the last vertex so far."""
    try:
        corners = [int(word.partition(b"/")[0]) for word in words[1:]]
        array("q", corners)
    except (ValueError, OverflowError):
        raise lines.error("whole numbers as vertex indices", words) from None
    if len(corners) < 3:
        raise lines.error("a face of 3 or more vertices", words)
    if min(corners) > 0:
        return [corner - 1 for corner in corners]
    if 0 in corners or min(corners) < -n_vertices:
        raise lines.error(f"vertex indices from 1, or from -1 to -{n_vertices},", words)
    return [corner - 1 if corner > 0 else corner + n_vertices for corner in corners]


def read_off(data: bytes, budget: int) -> Polygons:
    """Polygons of an OFF file in text, with or without colours, normals and texture."""
    lines = Lines(data, comment=b"#")
    words = lines.next("'OFF'")
    if not re.fullmatch(rb"(ST)?C?N?OFF", words[0]) or b"BINARY" in words:
        raise lines.error("'OFF' (in text, three coordinates)", words)
    counts = words[1:] or lines.next("the counts of vertices, faces, edges")
    try:
        n_vertices, n_faces = int(counts[0]), int(counts[1])
    except (ValueError, IndexError):
        raise lines.error("the counts of vertices, faces, edges", counts) from None
    check_count(n_vertices, "vertices", 6, len(data))
    check_count(n_faces, "faces", 8, len(data))
    check_budget(n_faces, budget)
    coordinates, corners, n_corners = array("d"), array("q"), array("q")
    for i in range(n_vertices):
        coordinates.extend(lines.floats(lines.next(f"vertex {i} of {n_vertices}")))
    for i in range(n_faces):
        polygon = lines.polygon(lines.next(f"face {i} of {n_faces}"))
        corners.extend(polygon)
        n_corners.append(len(polygon))
    return fan_polygons(coordinates, corners, n_corners, budget, trailing_lines(lines))


def check_count(count: int, what: str, least_bytes: int, available: int) -> None:
    """Raise MeshError when `count` items of `least_bytes` each cannot be in `available` bytes."""
    if not 0 <= count * least_bytes <= available + least_bytes:  # the last newline may be missing
        raise MeshError(
            f"the header promises {count} {what}, at least {count * least_bytes} bytes, "
            f"{available} bytes are there; the file is truncated or its header is wrong"
        )


def trailing_lines(lines: Lines) -> list[str]:
    """One note if there are more lines."""
    last = lines.number
    return [f"lines after line {last} were not read"] if any(True for _ in lines) else []
