"""STL, OBJ and OFF: from the bytes of a file to its polygons.

Serves `mesh_file`. A reader believes nothing that a file says about itself: a count is held against
the bytes that are there before anything is allocated, and what cannot be understood is an error
with its line or byte. Readers keep the file's order of vertices and polygons and neither merge nor
drop; only STL, which repeats every vertex, has those merged that are equal bit for bit.

Sources: 3D Systems. StereoLithography Interface Specification. 1989. Wavefront Technologies.
Advanced Visualizer Manual, appendix B1. 1993.
"""

import re
from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.errors import MeshError, ResourceError
from rastercov.mesh.arrays import MOST_FACES
from rastercov.mesh.formats.text import BYTE_ORDER_MARK, CUT_NOTE, Lines
from rastercov.mesh.topology import first_equal_row

PEAK_BYTES_PER_FACE = 300  # 250 measured while reading a binary STL of 10^7, the greediest
PEAK_BYTES_PER_VERTEX = 150  # of those beyond one a face, which the figure above has


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


def check_budget(n_faces: int, budget: int, n_vertices: int = 0, n_bytes: int = 0) -> None:
    """Raise ResourceError, before memory is taken, when what is to be read needs too much of it.

    Parameters
    ----------
    n_faces : int
    budget : int
        Bytes.
    n_vertices : int
        As far as they are known; those beyond one a face count.
    n_bytes : int
        What else is held at the same time.
    """
    n_more = max(0, n_vertices - n_faces)
    need = n_faces * PEAK_BYTES_PER_FACE + n_more * PEAK_BYTES_PER_VERTEX + n_bytes
    if n_faces > MOST_FACES or need > budget:
        vertices = f" with {n_vertices} vertices" if n_more or n_bytes else ""
        raise ResourceError(
            f"{n_faces} triangles{vertices} need about {need} bytes, the budget is {budget} bytes "
            f"(and {MOST_FACES} triangles); simplify the mesh, split it, or raise memory_budget"
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
    n_corners = np.asarray(n_corners, np.int64)
    n_triangles = n_corners - 2
    check_budget(int(n_triangles.sum()), budget, np.size(vertices) // 3)
    points = np.array(vertices, dtype=np.float64).reshape(-1, 3)
    corners = np.asarray(corners, np.int64)
    polygon = np.repeat(np.arange(len(n_corners)), n_triangles)
    first = (np.cumsum(n_corners) - n_corners)[polygon]
    step = np.arange(len(polygon)) - (np.cumsum(n_triangles) - n_triangles)[polygon]
    faces = np.stack([corners[first], corners[first + step + 1], corners[first + step + 2]], axis=1)
    return Polygons(points, faces, polygon, np.zeros_like(polygon), notes=list(notes))


def read_stl(data: bytes, budget: int) -> Polygons:
    """Polygons of an STL file, binary or ASCII.

    Many binary files begin with "solid", too, so the size decides first.
    """
    declared = int.from_bytes(data[80:84], "little") if len(data) >= 84 else -1
    fits = len(data) == 84 + 50 * declared
    start = data[:1024].removeprefix(BYTE_ORDER_MARK).lstrip().lower()
    is_text = start.startswith(b"solid") and b"\0" not in start
    if is_text and not fits:
        return _ascii_stl(data, budget)
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
    return _indexed(records["corners"].reshape(-1, 3), budget, notes)


def _indexed(
    corners: NDArray[np.float32] | NDArray[np.float64], budget: int, notes: Sequence[str]
) -> Polygons:
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
    check_budget(n_faces, budget, int(number[-1]) + 1)
    vertices = corners[is_first].astype(np.float64)
    faces = number[first].reshape(-1, 3)
    return Polygons(vertices, faces, index, np.zeros(n_faces, np.int64), notes=list(notes))


def _ascii_stl(data: bytes, budget: int) -> Polygons:
    """Polygons of an ASCII STL. A walk over the lines: about 0.5 µs each, seven a triangle."""
    lines, corners, n_left = Lines(data, budget), array("d"), 0
    is_open, is_cut, name = False, False, list[bytes]()
    facet = (b"facet", b"outer", b"vertex", b"vertex", b"vertex", b"endloop", b"endfacet")
    n_words = {b"outer": 2, b"vertex": 4, b"endloop": 1, b"endfacet": 1}
    for words in lines:
        word = words[0].lower()
        if n_left:
            if word != facet[-n_left]:
                raise lines.error(f"{facet[-n_left].decode()!r} in a facet of 3 vertices", words)
            if word == b"vertex":
                corners.extend(lines.point(words[1:]))
            elif len(words) != n_words[word]:
                raise lines.error(f"{word.decode()!r} on a line of its own", words)
            n_left -= 1
        elif is_open and word == b"facet":
            n_left = len(facet) - 1
            check_budget(len(corners) // 9 + 1, budget)
        elif is_open and word in (b"endsolid", b"end"):
            is_open, is_cut = False, words[1:] not in ([], name)
        elif not is_open and word == b"solid":
            is_open, name = True, words[1:]
        else:
            raise lines.error("'facet' or 'endsolid'" if is_open else "'solid'", words)
    if is_open:
        lines.next("'endsolid'")
    # Many programs end neither the last line nor, in it, repeat the name of the solid.
    notes = [CUT_NOTE] if lines.ends_inside_line and is_cut else []
    return _indexed(np.asarray(corners).reshape(-1, 3), budget, notes)


# Keywords of the format that say nothing about the shape of polygons.
OBJ_IGNORED = frozenset(
    b"vt vn vp s p l mg bevel c_interp d_interp lod usemtl mtllib usemap maplib shadow_obj "
    b"trace_obj".split()
)


MORE_OF_OBJ_VERTEX = (1, 3, 4)  # a weight, a colour, or both
OBJ_CORNERS = re.compile(rb"(?: [+-]?[0-9]+(?:/(?:[+-]?[0-9]+)?){0,2})*")  # 1, 1/2, 1//3, 1/2/3


def read_obj(data: bytes, budget: int) -> Polygons:
    """Polygons of a Wavefront OBJ file; its material libraries are never opened.

    A face belongs to the group or object that was named last before it. A walk over the lines:
    about 1 µs a vertex and 2 µs a face.
    """
    lines = Lines(data, budget, comment=b"#", joins=True)
    coordinates, corners, n_corners = array("d"), array("q"), array("q")
    label, face_line, current = array("q"), array("q"), 0
    number_of: dict[str | None, int] = {None: 0}
    most_coordinates = 3 * (budget // PEAK_BYTES_PER_VERTEX)
    for words in lines:
        keyword = words[0]
        if keyword == b"v":
            coordinates.extend(lines.point(words[1:], MORE_OF_OBJ_VERTEX))
            if len(coordinates) > most_coordinates:
                check_budget(len(n_corners), budget, len(coordinates) // 3)
        elif keyword == b"f":
            corners.extend(_obj_corners(lines, words, len(coordinates) // 3))
            n_corners.append(len(words) - 1)
            label.append(current)
            face_line.append(lines.number)
            check_budget(len(corners) - 2 * len(n_corners), budget, len(coordinates) // 3)
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
    notes = [CUT_NOTE] if lines.ends_inside_line else []
    polygons = fan_polygons(coordinates, corners, n_corners, budget, notes)
    polygons.label = np.asarray(label, dtype=np.int64)[polygons.source_face]
    polygons.names = list(number_of)
    return polygons


def _obj_corners(lines: Lines, words: list[bytes], n_vertices: int) -> list[int]:
    """Corners of "f 1/2/3 ...", from 0; negative ones count back from the last vertex so far."""
    text = b" ".join(words)
    indices = words[1:]
    if b"/" in text:
        if not OBJ_CORNERS.fullmatch(text, 1):
            raise lines.error("corners of whole numbers, as 1, 1/2, 1//3 or 1/2/3,", words)
        indices = [word.partition(b"/")[0] for word in indices]
    corners = lines.integers(indices, "whole numbers as vertex indices")
    if len(corners) < 3:
        raise lines.error("a face of 3 or more vertices", words)
    if min(corners) > 0:
        return [corner - 1 for corner in corners]
    if 0 in corners or min(corners) < -n_vertices:
        raise lines.error(f"vertex indices from 1, or from -1 to -{n_vertices},", words)
    return [corner - 1 if corner > 0 else corner + n_vertices for corner in corners]


# Numbers after the coordinates of a vertex: normals, a colour in three or four numbers, texture.
# Some programs write colours into files that begin with a plain OFF.
MORE_OF_OFF_VERTEX = {b"": (0, 3, 4), b"C": (3, 4), b"N": (3,), b"CN": (6, 7)}
MORE_OF_OFF_VERTEX |= {
    b"ST" + key: tuple(n + 2 for n in more) for key, more in MORE_OF_OFF_VERTEX.items()
} | {b"ST": (2,)}
MORE_OF_OFF_FACE = (0, 1, 3, 4)  # an index into a table of colours, or a colour


def read_off(data: bytes, budget: int) -> Polygons:
    """Polygons of an OFF file in text, with or without colours, normals and texture."""
    lines = Lines(data, budget, comment=b"#")
    words = lines.next("'OFF'")
    kind = words[0].removesuffix(b"OFF")
    if not words[0].endswith(b"OFF") or kind not in MORE_OF_OFF_VERTEX or b"BINARY" in words:
        raise lines.error("'OFF' (in text, three coordinates)", words)
    counts = words[1:] or lines.next("the counts of vertices, faces, edges")
    if len(counts) not in (2, 3):
        raise lines.error("the counts of vertices, faces, edges", counts)
    n_vertices, n_faces = lines.integers(counts, "the counts of vertices, faces, edges")[:2]
    check_count(n_vertices, "vertices", 6, len(data))
    check_count(n_faces, "faces", 8, len(data))
    check_budget(n_faces, budget, n_vertices)
    coordinates, corners, n_corners = array("d"), array("q"), array("q")
    more = MORE_OF_OFF_VERTEX[kind]
    for words in lines.take(n_vertices, "vertex"):
        coordinates.extend(lines.point(words, more))
    for words in lines.take(n_faces, "face"):
        polygon = _off_polygon(lines, words)
        corners.extend(polygon)
        n_corners.append(len(polygon))
        check_budget(len(corners) - 2 * len(n_corners), budget, n_vertices)
    is_cut = n_faces > 0 and lines.is_cut and len(words) == len(polygon) + 1
    notes = [CUT_NOTE] if is_cut else trailing_lines(lines)
    return fan_polygons(coordinates, corners, n_corners, budget, notes)


def _off_polygon(lines: Lines, words: list[bytes]) -> list[int]:
    """Corners of "n i1 ... in"; the numbers that follow are a colour."""
    (n,) = lines.integers(words[:1], "a corner count and vertex indices")
    if n < 3 or len(words) <= n or len(words) - 1 - n not in MORE_OF_OFF_FACE:
        raise lines.error(
            "a corner count of 3 or more and as many vertex indices, with or without a colour,",
            words,
        )
    lines.floats(words[1 + n :], "a colour after the vertex indices")
    return lines.integers(words[1 : 1 + n], "a corner count and vertex indices")


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
