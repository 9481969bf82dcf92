"""3MF files: a ZIP archive with a model in XML, of objects with triangles and of their instances.

Read are the triangles of the objects that the build names, with the transforms of the components,
one group per instance. Materials and textures are ignored; what may change the shape, such as
beams and slices, is an error or a note.

Source: 3MF Consortium. 3MF Core Specification 1.3. 2021.
"""

import io
import posixpath
import re
import struct
import zipfile
import zlib
from dataclasses import replace
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from rastercov.base import (
    FloatArray,
    MeshError,
    UnknownNames,
    Vocabulary,
    one_line,
    plural,
    printable,
)
from rastercov.formats.meshes.polygons import (
    Assembly,
    PolygonElement,
    Polygons,
    PolygonShape,
    broken,
    check,
    check_budget,
    check_indices,
    refuse_broken_files,
)
from rastercov.formats.meshes.xml_tree import (
    BYTES_PER_XML_BYTE,
    attribute,
    below,
    children,
    local_name,
    look_at_names,
    namespaces,
    parse_xml,
    table,
    transform_numbers,
)

METRES = {
    "micron": 1e-6,
    "millimeter": 1e-3,
    "centimeter": 1e-2,
    "inch": 0.0254,
    "foot": 0.3048,
    "meter": 1.0,
}
RELATIONSHIPS = "_rels/.rels"
MODEL = "/3dmodel"
"""End of the type of the relationship that names the model."""
KNOWN_EXTENSIONS = re.compile(
    "/3dmanufacturing/(material|production|slice|securecontent|trianglesets)/"
)
"""Namespaces of extensions that a file may require, as they leave the triangles as they are."""
SHAPES = ("beamlattice", "balls", "booleanshape", "displacementmesh", "levelset")
"""Elements of other extensions that are surfaces, of an object or its mesh."""
RESOLUTIONS = ("meshresolution", "modelresolution")
"""Attributes of the slice and production extensions of an object that may be a stand-in."""
FULL = "fullres"
DAMAGED = (
    zipfile.BadZipFile,
    zlib.error,
    EOFError,
    OSError,
    NotImplementedError,  # zipfile: a version or a flag that it does not read
    RuntimeError,
    struct.error,
)
"""Errors of the standard library about a damaged or encrypted archive."""
NAMES = Vocabulary(
    "model resources build unit requiredextensions object id mesh vertices triangles trianglesets "
    "components component item objectid transform path",
    "vertex triangle triangleset",
    "metadata metadatagroup pid pindex name partnumber thumbnail UUID type lang printable "
    "recommendedextensions slicestack basematerials texture2d texture2dgroup colorgroup "
    "compositematerials multiproperties slicestackid slicepath meshresolution modelresolution "
    "alternatives",
)
COMPRESSIONS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""Those that the Open Packaging Conventions permit."""

_Key = tuple[str, str]
"""Path of a part, and the id of an object in it."""


def read(data: bytes, budget: int) -> Polygons:
    """Triangles of a 3MF file in metres, one group per instance, in the order of the build."""
    try:
        with refuse_broken_files(), zipfile.ZipFile(io.BytesIO(data)) as archive:
            return _Model(archive, budget).polygons()
    except DAMAGED as error:
        raise broken(f"expected a readable ZIP archive, got: {one_line(error)}") from None


class _Model:
    """Objects of the archive, each part parsed once."""

    def __init__(self, archive: zipfile.ZipFile, budget: int) -> None:
        self._archive, self._budget = archive, budget
        self._bytes_left = budget
        self._parts: dict[str, Element] = {}
        self._objects: dict[_Key, Element] = {}
        self._read: set[_Key] = set()
        self._unknown = UnknownNames(MeshError)

    def polygons(self) -> Polygons:
        """All instances of the build."""
        path = self._model_path()
        root = self._part(path)
        unit = root.get("unit", "millimeter")
        check(unit in METRES, f"expected a unit of {', '.join(METRES)}, got {unit[:40]!r}")
        items = below(root, "build", "item")
        check(items, "expected an object in the build, got none", "put one on the plate")
        roots = [(_transform(item), self._key(item, path)) for item in items]
        polygons = Assembly(self._object, self._budget).polygons(roots, METRES[unit])
        notes = self._notes()
        if n := sum(attribute(item, "printable") in ("0", "false") for item in items):
            notes.append(f"read {plural(n, 'item')} of the build marked as not printable")
        return replace(polygons, notes=notes)

    def _key(self, reference: Element, path: str) -> _Key:
        """Object that an item or a component names, in this part unless it names another one."""
        where = attribute(reference, "path") or path
        return where.lstrip("/"), reference.attrib["objectid"]

    def _notes(self) -> list[str]:
        """Notes on content that is not read."""
        notes = []
        left = [key for key, owner in self._objects.items() if children(owner, "mesh")]
        if n_unused := sum(key not in self._read for key in left):
            notes.append(f"ignored {n_unused} objects, which are not in the build")
        n_supports = sum(self._objects[key].get("type") == "support" for key in self._read)
        if n_supports:
            notes.append(f"read {plural(n_supports, 'support object')}, as part of the mesh")
        return notes + self._unknown.notes()

    def _model_path(self) -> str:
        """Path of the part that the archive names as its model."""
        for each in self._part(RELATIONSHIPS):
            if each.get("Type", "").endswith(MODEL):
                return posixpath.normpath(each.attrib["Target"]).lstrip("/")
        raise broken("expected a 3D model in the archive, got none")

    def _part(self, path: str) -> Element:
        """Root of a part, parsed, its objects known."""
        if path in self._parts:
            return self._parts[path]
        try:
            info = self._archive.getinfo(path)
        except KeyError:
            raise broken(f"expected the part {path[:80]!r} in the archive, got none") from None
        # The size is that of the archive's directory; reading stops there, so it is no promise.
        check_budget(0, self._bytes_left, n_bytes=info.file_size * BYTES_PER_XML_BYTE)
        is_read = info.compress_type in COMPRESSIONS
        check(is_read, f"expected {path[:80]!r} to be deflated or stored, got another compression")
        with self._archive.open(info) as file:
            text = file.read(info.file_size + 1)
        root = self._parts[path] = parse_xml(text, f"its part {path[:80]!r}", self._bytes_left)
        self._bytes_left -= info.file_size * BYTES_PER_XML_BYTE
        if path != RELATIONSHIPS:
            _check_extensions(root, text)
            look_at_names(root, NAMES, self._unknown)
        for each in below(root, "resources", "object"):
            is_new = self._objects.setdefault((path, each.attrib["id"]), each) is each
            check(is_new, f"expected object {each.attrib['id'][:40]!r} once, got it twice")
        return root

    def _object(self, key: tuple[str, str]) -> PolygonElement:
        """An object: its triangles, and the objects that it is made of."""
        path, number = key
        self._part(path)
        title = f"object {number[:40]!r}"
        check(key in self._objects, f"expected {title}, got no object of that id")
        owner = self._objects[key]
        self._read.add(key)
        meshes = children(owner, "mesh")
        check(len(meshes) < 2, f"{title}: expected one mesh, got {len(meshes)}")
        foreign = [each for holder in (owner, *meshes) for each in children(holder, *SHAPES)]
        if foreign:
            name = local_name(foreign[0])
            raise broken(f"{title}: expected triangles, got a {name}", "export it as triangles")
        for name in RESOLUTIONS:
            value = attribute(owner, name) or FULL
            check(
                value == FULL,
                f"{title}: expected full resolution, got a placeholder ({name} {value[:40]!r})",
                "export its mesh in full resolution",
            )
        pieces: list[tuple[FloatArray, Any]] = [(np.eye(4), _shape(m)) for m in meshes]
        for each in below(owner, "components", "component"):
            pieces.append((_transform(each), self._key(each, path)))
        return PolygonElement(owner.get("name") or f"object {number}", title, pieces)


def _check_extensions(root: Element, text: bytes) -> None:
    """Error where a part requires an extension that is not in `KNOWN_EXTENSIONS`."""
    needed = root.get("requiredextensions", "").split()
    declared = namespaces(text) if needed else {}
    foreign = [each for each in needed if not KNOWN_EXTENSIONS.search(declared.get(each, ""))]
    names = [printable(declared.get(each, each), 80) for each in foreign[:5]]
    check(not foreign, f"expected supported extensions, got {names}", "export without them")


def _shape(mesh: Element) -> PolygonShape:
    points = table(below(mesh, "vertices", "vertex"), ("x", "y", "z"), np.float64)
    faces = table(below(mesh, "triangles", "triangle"), ("v1", "v2", "v3"), np.int64)
    check_indices(faces, len(points), "a mesh")
    return PolygonShape(points, faces.ravel(), np.full(len(faces), 3), len(faces))


def _transform(owner: Element) -> FloatArray:
    """(4, 4) matrix of 12 numbers in rows of four, of which 3MF stores the transpose."""
    text = owner.get("transform")
    if text is None:
        return np.eye(4)
    matrix: FloatArray = np.eye(4)
    matrix[:3] = transform_numbers(text, 12).reshape(4, 3).T
    return matrix
