"""STL files, binary and ASCII.

The format repeats every vertex; vertices that are equal bit for bit are merged. Of an ASCII file
with several `solid` sections, each is a group.

Source: 3D Systems. StereoLithography Interface Specification. 1989.
"""

from array import array
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rastercov.base.errors import MeshError
from rastercov.mesh.formats.polygons import Polygons, check_budget
from rastercov.mesh.formats.text import BYTE_ORDER_MARK, CUT_NOTE, Lines
from rastercov.mesh.topology import first_equal_row


def read(data: bytes, budget: int) -> Polygons:
    """Polygons of an STL file, binary or ASCII.

    Many binary files begin with "solid" as well, so the file size is tested first.
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
    """Polygons of an ASCII STL. A Python loop over the lines: 0.5 µs a line, 7 lines a triangle."""
    lines, corners, n_left = Lines(data, budget), array("d"), 0
    is_open, is_cut, name = False, False, list[bytes]()
    names, n_before = list[str | None](), array("q")  # of each solid; triangles before it
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
            names.append(b" ".join(name).decode("utf-8", "replace") or None)
            n_before.append(len(corners) // 9)
        else:
            raise lines.error("'facet' or 'endsolid'" if is_open else "'solid'", words)
    if is_open:
        lines.next("'endsolid'")
    # Many programs write no line end after `endsolid`, and do not repeat the solid's name there.
    notes = [CUT_NOTE] if lines.ends_inside_line and is_cut else []
    polygons = _indexed(np.asarray(corners).reshape(-1, 3), budget, notes)
    if (
        len(names) < 2
    ):  # the name of a lone solid is often that of the program; the file's is better
        return polygons
    solid = np.searchsorted(n_before, polygons.source_face, side="right") - 1
    return replace(polygons, face_group=solid, group_names=names)
