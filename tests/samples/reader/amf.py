"""AMF files: objects with triangles in XML, one group for each volume; constellations are refused.

Source: ISO/ASTM 52915. Additive manufacturing file format (AMF), version 1.2. 2020.
"""

import io
import zipfile
import zlib
from dataclasses import replace
from xml.etree.ElementTree import Element

import numpy as np

from rastercov.base.arguments import AnyArray
from rastercov.base.errors import MeshError
from rastercov.base.files import UnknownNames, Vocabulary
from rastercov.formats.meshes.polygons import (
    Polygons,
    broken,
    check,
    check_budget,
    check_indices,
    fan_polygons,
)
from rastercov.formats.meshes.xml_tree import (
    below,
    floats,
    integers,
    local_name,
    look_at_names,
    parse_xml,
)

METRES = {"millimeter": 1e-3, "inch": 0.0254, "feet": 0.3048, "meter": 1.0, "micron": 1e-6}
NAMES = Vocabulary(
    "amf unit object id mesh vertices vertex coordinates volume triangle x y z v1 v2 v3 text",
    "x y z v1 v2 v3",
    "version lang metadata material materialid color texture texmap type normal edge name",
)


def read(data: bytes, budget: int) -> Polygons:
    """Triangles of all objects, in metres."""
    if data.startswith(b"PK"):
        data = _unzip(data, budget)
    root = parse_xml(data, "the AMF file", budget)
    check(local_name(root) == "amf", f"expected an element amf, got {local_name(root)[:40]!r}")
    unit = root.get("unit", "millimeter")
    check(unit in METRES, f"expected a unit of {', '.join(METRES)}, got {unit[:40]!r}")
    check(not below(root, "constellation"), "expected objects, got constellations", "flatten them")
    unknown = UnknownNames(MeshError)
    look_at_names(root, NAMES, unknown)
    points, corners, labels, names = [np.empty((0, 3))], [np.empty((0, 3), np.int64)], [], []
    for owner in below(root, "object", "mesh"):
        own = _columns(below(owner, "vertices", "vertex", "coordinates"), "x y z", floats)
        n_before = sum(map(len, points))
        for volume in below(owner, "volume"):
            rows = _columns(below(volume, "triangle"), "v1 v2 v3", integers)
            check_indices(rows.ravel(), len(own), f"volume {len(names)}")
            corners.append(rows + n_before)
            labels.append(np.full(len(rows), len(names)))
            names.append(next((each.text for each in below(volume, "metadata")), None))
        points.append(own)
    faces = np.concatenate(corners)
    check_budget(len(faces), budget)
    result = fan_polygons(
        np.concatenate(points) * METRES[unit], faces.ravel(), np.full(len(faces), 3), budget
    )
    group = np.concatenate([np.empty(0, np.int64), *labels])
    return replace(
        result,
        face_group=group[result.source_face],
        group_names=names or [None],
        is_in_metres=True,
        notes=unknown.notes(),
    )


def _columns(rows: list[Element], names: str, numbers: object) -> AnyArray:
    """(N, 3) numbers of the children of these names."""
    words = [
        " ".join(each.text or "" for each in below(row, n)) for row in rows for n in names.split()
    ]
    values = numbers(" ".join(words))
    check(len(values) == 3 * len(rows), f"expected {names} in each of {len(rows)} elements")
    return values.reshape(-1, 3)


def _unzip(data: bytes, budget: int) -> bytes:
    """The only file of an archive."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            (entry,) = archive.infolist()
            check_budget(0, budget, n_bytes=entry.file_size)
            return archive.read(entry)
    except (zipfile.BadZipFile, zlib.error, ValueError, RuntimeError, EOFError) as error:
        raise broken(f"expected a ZIP archive with one file, got: {error}") from None
