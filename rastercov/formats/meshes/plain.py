"""STL, OBJ, PLY and OFF, which the engine reads: `rastercov/engine/readers`.

The same code reads them for C and for pages, with the same messages.
"""

import numpy as np

from rastercov.base import MeshError
from rastercov.engine import solver_readers as engine_readers
from rastercov.formats.meshes.polygons import Polygons

FORMATS = (".stl", ".obj", ".ply", ".off")
"""Extensions in the order of the engine."""


def read(data: bytes, budget: int, *, extension: str) -> Polygons:
    """Polygons of a file, which may be text of UTF-8 or UTF-16; MeshError or ResourceError."""
    content = np.frombuffer(data, np.uint8)
    try:
        vertices, faces, source_face, face_group, names, notes = engine_readers.read(
            FORMATS.index(extension), content, min(budget, 2**62)
        )
    except ValueError as error:
        raise MeshError(str(error)) from None
    named = [name.decode("utf-8", "replace") or None for name in names]
    return Polygons(vertices, faces, source_face, face_group, named, notes)
