"""Wavefront OBJ files; material libraries are never opened.

Source: Wavefront Technologies. Advanced Visualizer Manual, appendix B1. 1993.
"""

import re
from array import array
from dataclasses import replace

import numpy as np

from rastercov.base.errors import MeshError
from rastercov.mesh.formats.polygons import (
    PEAK_BYTES_PER_VERTEX,
    Polygons,
    check_budget,
    fan_polygons,
)
from rastercov.mesh.formats.text import CUT_NOTE, Lines

IGNORED = frozenset(
    b"vt vn vp s p l mg bevel c_interp d_interp lod usemtl mtllib usemap maplib shadow_obj "
    b"trace_obj".split()
)
"""Keywords of the format without influence on the shape of polygons."""


FACE = (b"f", b"fo")
"""Keywords of a face; version 2.11 of the format wrote fo, which readers take as f."""
EXTRA_NUMBERS = (1, 3, 4)
"""Numbers that may follow the coordinates of a vertex: a weight, a colour, or both."""
CORNERS = re.compile(rb"(?: [+-]?[0-9]+(?:/(?:[+-]?[0-9]+)?){0,2})*")
"""Corners of a face: 1, 1/2, 1//3 or 1/2/3."""


def read(data: bytes, budget: int) -> Polygons:
    """Polygons of an OBJ file.

    A face belongs to the last group or object named before it. A Python loop over the lines: about
    1 µs a vertex and 2 µs a face.
    """
    lines = Lines(data, budget, comment=b"#", joins=True)
    coordinates, corners, n_corners = array("d"), array("q"), array("q")
    groups, face_line, current = array("q"), array("q"), 0
    doubtful = array("q")  # lines that are a face with one bit changed
    number_of: dict[str | None, int] = {None: 0}
    most_coordinates = 3 * (budget // PEAK_BYTES_PER_VERTEX)
    for words in lines:
        keyword = words[0]
        if keyword == b"v":
            if face_line and face_line[-1] == lines.number - 1 and _may_be_face(words):
                doubtful.append(lines.number)
            coordinates.extend(lines.point(words[1:], EXTRA_NUMBERS))
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
        elif keyword not in IGNORED:
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
    if doubtful:
        more = f" (and {len(doubtful) - 1} others)" if len(doubtful) > 1 else ""
        notes.append(
            f"line {doubtful[0]}{more} may be a face, its keyword is not f: not read as one"
        )
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
