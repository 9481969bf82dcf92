"""OFF files in text, with or without colours, normals and texture coordinates.

Source: The Geometry Center. Geomview Manual, section OFF Files.
"""

from array import array

from rastercov.mesh.formats.polygons import Polygons, check_budget, check_count, fan_polygons
from rastercov.mesh.formats.text import CUT_NOTE, Lines, trailing_lines

EXTRA_OF_VERTEX = {b"": (0, 3, 4), b"C": (3, 4), b"N": (3,), b"CN": (6, 7)}
EXTRA_OF_VERTEX |= {
    b"ST" + key: tuple(n + 2 for n in more) for key, more in EXTRA_OF_VERTEX.items()
} | {b"ST": (2,)}
"""Numbers after the coordinates of a vertex, by the prefix of OFF: normals, a colour of three or
four numbers, texture coordinates. Some programs write colours into files with a plain OFF."""
EXTRA_OF_FACE = (0, 1, 3, 4)
"""Numbers after the corners of a face: none, an index into a table of colours, or a colour."""


def read(data: bytes, budget: int) -> Polygons:
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
            "a corner count of 3 or more and as many vertex indices, with or without a colour,",
            words,
        )
    lines.floats(words[1 + n :], "a colour after the vertex indices")
    return lines.integers(words[1 : 1 + n], "a corner count and vertex indices")
