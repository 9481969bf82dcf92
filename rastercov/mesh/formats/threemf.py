"""3MF files: a ZIP archive with a model in XML, of objects with triangles and of their instances.

Read are the triangles of the objects that the build names, with the transforms of the components,
one group an instance. Materials, beams, slices and textures are left out; what may change the shape
is an error or a note.

Source: 3MF Consortium. 3MF Core Specification 1.3. 2021.
"""

import io
import posixpath
import struct
import zipfile
import zlib
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from rastercov.errors import MeshError, ResourceError
from rastercov.mesh.formats.glb import broken_files_refused
from rastercov.mesh.formats.polygons import Polygons, check_budget
from rastercov.mesh.formats.xml_tree import (
    BYTES_PER_XML_BYTE,
    attribute,
    children,
    floats,
    parsed,
    table,
    unknown_children,
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
KNOWN_EXTENSIONS = ("m", "p", "s", "sc")
"""Prefixes of extensions that leave the triangles as they are, where a file requires them."""
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
NO_SHAPE = ("metadatagroup", "metadata")
COMPRESSIONS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""Those that the Open Packaging Conventions permit."""
BYTES_PER_INSTANCE = 1000
"""Memory and work that a component counts for; a short file may ask for many instances."""

_Shape = tuple[NDArray[np.float64], NDArray[np.int64]]


def read(data: bytes, budget: int) -> Polygons:
    """Triangles of a 3MF file in metres, one group an instance, in the order of the build."""
    try:
        with broken_files_refused(), zipfile.ZipFile(io.BytesIO(data)) as archive:
            return _Model(archive, budget).polygons()
    except (MeshError, ResourceError):
        raise
    except RecursionError:
        raise MeshError("components are nested too deeply; export it again") from None
    except DAMAGED as error:
        raise MeshError(f"the ZIP archive cannot be read ({error}); export it again") from None


class _Model:
    """Objects of the archive, each part parsed once."""

    def __init__(self, archive: zipfile.ZipFile, budget: int) -> None:
        self._archive, self._budget = archive, budget
        self._bytes_left = budget
        self._parts: dict[str, Element] = {}
        self._objects: dict[tuple[str, str], Element] = {}
        self._shapes: dict[tuple[str, str], _Shape] = {}
        self._vertices, self._faces = [np.empty((0, 3))], [np.empty((0, 3), np.int64)]
        self._labels: list[NDArray[np.int64]] = []
        self._names: list[str | None] = []
        self._n_vertices = self._n_faces = 0
        self._left_out: list[str] = []

    def polygons(self) -> Polygons:
        """All instances of the build."""
        path = self._model_path()
        root = self._part(path)
        unit = root.get("unit", "millimeter")
        if unit not in METRES:
            raise MeshError(f"a unit of {', '.join(METRES)} wanted, got {unit[:40]!r}; correct it")
        needed = root.get("requiredextensions", "").split()
        if foreign := [name for name in needed if name not in KNOWN_EXTENSIONS]:
            raise MeshError(f"extensions {foreign} are required, not supported; export without")
        for build in children(root, "build"):
            self._left_out += unknown_children(build, "item")
            for item in children(build, "item"):
                where = attribute(item, "path") or path
                self._add((where.lstrip("/"), item.attrib["objectid"]), _transform(item), ())
        labels = np.concatenate(self._labels) if self._labels else np.empty(0, np.int64)
        return Polygons(
            np.concatenate(self._vertices) * METRES[unit],
            np.concatenate(self._faces),
            np.arange(self._n_faces),
            labels,
            self._names or [None],
            self._notes(),
            is_in_metres=True,
        )

    def _notes(self) -> list[str]:
        """Notes on content that is not read."""
        notes = []
        left = [key for key, owner in self._objects.items() if children(owner, "mesh")]
        if n_unused := sum(key not in self._shapes for key in left):
            notes.append(f"{n_unused} objects are not in the build, not read")
        if left_out := sorted(set(self._left_out)):
            notes.append(f"not read: {', '.join(left_out[:5])}; the shape may be incomplete")
        return notes

    def _model_path(self) -> str:
        """Path of the part that the archive names as its model."""
        for each in self._part(RELATIONSHIPS):
            if each.get("Type", "").endswith(MODEL):
                return posixpath.normpath(each.attrib["Target"]).lstrip("/")
        raise MeshError("the archive names no 3D model; export it again")

    def _part(self, path: str) -> Element:
        """Root of a part, parsed, its objects known."""
        if path in self._parts:
            return self._parts[path]
        try:
            info = self._archive.getinfo(path)
        except KeyError:
            raise MeshError(f"the archive has no part {path[:80]!r}; export it again") from None
        # The size is that of the archive's directory; reading stops there, so it is no promise.
        check_budget(0, self._bytes_left, n_bytes=info.file_size * BYTES_PER_XML_BYTE)
        if info.compress_type not in COMPRESSIONS:
            raise MeshError(f"{path[:80]!r} must be deflated or stored; export it again")
        with self._archive.open(info) as file:
            text = file.read(info.file_size + 1)
        root = self._parts[path] = parsed(text, f"its part {path[:80]!r}", self._bytes_left)
        self._bytes_left -= info.file_size * BYTES_PER_XML_BYTE
        for resources in children(root, "resources"):
            for each in children(resources, "object"):
                if self._objects.setdefault((path, each.attrib["id"]), each) is not each:
                    raise MeshError(f"object {each.attrib['id'][:40]!r} comes twice; correct it")
        return root

    def _add(
        self,
        key: tuple[str, str],
        world_from_object: NDArray[np.float64],
        above: tuple[tuple[str, str], ...],
    ) -> None:
        """Take in an object and those that it is made of."""
        path, number = key
        self._part(path)
        if key not in self._objects:
            raise MeshError(f"object {number[:40]!r} is not there; export it again")
        if key in above:
            raise MeshError(f"object {number[:40]!r} is a part of itself; correct it")
        owner = self._objects[key]
        self._left_out += unknown_children(owner, "mesh", "components", *NO_SHAPE)
        for mesh in children(owner, "mesh"):
            if key not in self._shapes:
                self._shapes[key] = self._shape(mesh)
            name = owner.get("name") or f"object {number}"
            self._place(*self._shapes[key], world_from_object, name)
        for components in children(owner, "components"):
            self._left_out += unknown_children(components, "component")
            for each in children(components, "component"):
                where = (attribute(each, "path") or path).lstrip("/")
                # A short file may ask for many instances: each one counts, even without triangles.
                self._bytes_left -= BYTES_PER_INSTANCE
                check_budget(0, self._bytes_left, n_bytes=BYTES_PER_INSTANCE)
                placed = world_from_object @ _transform(each)
                self._add((where, each.attrib["objectid"]), placed, (*above, key))

    def _shape(self, mesh: Element) -> _Shape:
        self._left_out += unknown_children(mesh, "vertices", "triangles", "trianglesets")
        for each in mesh:
            self._left_out += unknown_children(each, "vertex", "triangle", "triangleset")
        vertices = [v for each in children(mesh, "vertices") for v in children(each, "vertex")]
        triangles = [t for each in children(mesh, "triangles") for t in children(each, "triangle")]
        points = table(vertices, ("x", "y", "z"), np.float64)
        faces = table(triangles, ("v1", "v2", "v3"), np.int64)
        if len(faces) and not (faces.min() >= 0 and faces.max() < len(points)):
            raise MeshError(
                f"vertex indices must lie in 0 ... {len(points) - 1}, got {faces.min()} ... "
                f"{faces.max()}; correct the triangles"
            )
        return points, faces

    def _place(
        self,
        points: NDArray[np.float64],
        faces: NDArray[np.int64],
        world_from_object: NDArray[np.float64],
        name: str,
    ) -> None:
        check_budget(self._n_faces + len(faces), self._budget, self._n_vertices + len(points))
        matrix = world_from_object[:3, :3]
        if np.linalg.det(matrix) < 0:  # mirrored: its triangles would face inwards
            faces = faces[:, [0, 2, 1]]
        self._vertices.append(points @ matrix.T + world_from_object[:3, 3])
        self._faces.append(faces + self._n_vertices)
        self._labels.append(np.full(len(faces), len(self._names)))
        self._names.append(name)
        self._n_vertices += len(points)
        self._n_faces += len(faces)


def _transform(owner: Element) -> NDArray[np.float64]:
    """(4, 4) matrix of 12 numbers in rows of four, of which 3MF stores the transpose."""
    text = owner.get("transform")
    if text is None:
        return np.eye(4)
    numbers = floats(text)
    if numbers.shape != (12,) or not np.isfinite(numbers).all():
        raise MeshError(f"a transform of 12 finite numbers wanted, got {text[:60]!r}; correct it")
    matrix: NDArray[np.float64] = np.eye(4)
    matrix[:3] = numbers.reshape(4, 3).T
    return matrix
