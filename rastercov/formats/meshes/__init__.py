"""Mesh files: the formats, the guards of size and memory, units, and the joining of several files.

A path is checked before it is opened (a regular file, of a known format, not too large), its bytes
are read once and hashed, and one reader turns them into polygons. A reader has to parse the whole
file to check it, so its result is used and no library parses the file a second time.

A new format is a module of this package with a function `read(data, budget) -> Polygons`, and an
entry in `READERS`. Only glTF opens other files, those of its buffers: `_Beside`.
"""

import hashlib
import posixpath
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import TypeVar

import numpy as np

from rastercov.base import (
    ByName,
    MeshError,
    ResourceError,
    StrPath,
    UnreadableError,
    file_bytes,
    offsets_of,
    printable,
)
from rastercov.base.files import PROJECTS
from rastercov.core.mesh.arrays import check_coordinates, places_of, unusable_points
from rastercov.core.mesh.files import LARGEST_FILE, Limits, MeshFiles, Site
from rastercov.core.mesh.groups import names_beside, stem_of
from rastercov.core.mesh.terrain import Raster
from rastercov.engine.solver_readers import cut_concave
from rastercov.formats.meshes.polygons import (
    LONGEST_NAME,
    PEAK_BYTES_PER_FACE,
    Polygons,
    broken,
    check,
    check_indices,
    refuse_broken_files,
)

Value = TypeVar("Value")

READERS = {
    ".3mf": "threemf.read",
    ".asc": "terrain.read",
    ".dae": "dae.read",
    ".glb": "gltf.read_glb",
    ".gltf": "gltf.read_gltf",
    ".ifc": "ifc.read",
    ".obj": "plain.read",
    ".off": "plain.read",
    ".ply": "plain.read",
    ".step": "step.read_step",
    ".stl": "plain.read",
    ".stp": "step.read_step",
    ".tif": "terrain.read",
    ".tiff": "terrain.read",
}
"""Module of this package and its function for each suffix; imported with the first such file."""
MEMORY_BUDGET = 8 << 30
SMALLER = "simplify the mesh, or raise max_bytes"
FREE_FACES = 1 << 20
"""Faces that a short file may be multiplied into without `memory_budget`."""


def read_files(
    paths: Sequence[StrPath], scales: Sequence[float], limits: Limits
) -> tuple[Polygons, list[tuple[str, str, int, Site]]]:
    """Polygons of one file, or of several as one scene, in metres; see `Mesh.load`.

    `scales` are the units of the coordinates in metres, one for each file. Every group has
    a unique name; a space has the row of its file before its product. The list has the name without
    folders, the SHA-256 and the face count of each file.
    """
    parts: list[Polygons] = []
    files: list[tuple[str, str, int, Site]] = []
    names: list[list[str]] = []
    notes: list[str] = []
    for one, metres in zip(paths, scales, strict=True):
        shown = printable(str(one))
        try:
            with np.errstate(all="ignore"):  # an overflow is caught as an invalid coordinate
                polygons, digest = _read_file(one, metres, *limits)
        except (MeshError, ResourceError) as error:
            raise type(error)(f"{shown}: {error}") from error
        parts.append(polygons)
        files.append((printable(Path(one).name), digest, len(polygons.faces), polygons.site))
        stem = stem_of(one)
        names.append([(stem if name is None else name) for name in polygons.group_names])
        notes += [f"{shown}: {note}" for note in polygons.notes]
    storeys = iter(names_beside(paths, [[a.storey for a, _, _ in p.spaces] for p in parts]))
    n_vertices = offsets_of([len(part.vertices) for part in parts])
    n_groups = offsets_of([len(part.group_names) for part in parts])
    scene = Polygons(
        vertices=np.concatenate([part.vertices for part in parts]),
        faces=np.concatenate([p.faces + n for p, n in zip(parts, n_vertices, strict=False)]),
        source_face=np.concatenate([part.source_face for part in parts]),
        face_group=np.concatenate(
            [p.face_group + n for p, n in zip(parts, n_groups, strict=False)]
        ),
        group_names=_unique([name[:LONGEST_NAME] for name in names_beside(paths, names)]),
        notes=notes,
        spaces=[
            ((row, a._replace(storey=next(storeys).rstrip("/"))), b, c)
            for row, part in enumerate(parts)
            for a, b, c in part.spaces
        ],
    )
    return scene, files


def _read_file(
    path: StrPath,
    scale: float,
    drop_invalid: bool,
    max_bytes: int,
    memory_budget: int | None,
    deflection_mm: float | None,
) -> tuple[Polygons, str]:
    """Checked polygons of one file, in metres, and the SHA-256 of its bytes."""
    reader, data = _reader_and_bytes(path, max_bytes)
    check(data, "expected triangles, got an empty file")
    if memory_budget is None:
        memory_budget = min(MEMORY_BUDGET, PEAK_BYTES_PER_FACE * max(FREE_FACES, len(data)))
    beside = _Beside(path, max_bytes - len(data))
    options: dict[str, ByName] = {
        "gltf.read_gltf": {"bytes_beside": beside.read},
        "plain.read": {"extension": Path(path).suffix.lower()},
        "step.read_step": {"deflection_mm": deflection_mm},
    }
    module, name = reader.split(".")
    read = getattr(import_module(f"{__name__}.{module}"), name)
    with refuse_broken_files():
        polygons: Polygons = read(data, memory_budget, **options.get(reader, {}))
    faces, n_vertices = polygons.faces, len(polygons.vertices)
    check(len(faces), "expected triangles, got no faces", "export the surface, not points")
    outside = np.any((faces < 0) | (faces >= n_vertices), axis=1)
    face = int(outside.argmax())
    check_indices(faces[face], n_vertices, f"face {polygons.source_face[face]}")
    if not polygons.is_in_metres:
        np.multiply(polygons.vertices, scale, out=polygons.vertices)
    elif scale != 1:
        note = "ignored unit: the file states its own"
        polygons = replace(polygons, notes=[*polygons.notes, note])
    if drop_invalid:
        polygons = _without_invalid(polygons)
    check_coordinates(polygons.vertices, polygons.faces)
    notes = cut_concave(polygons.vertices, polygons.faces, polygons.source_face)
    polygons = _with_tidy_groups(replace(polygons, notes=[*polygons.notes, *notes]))
    digest = hashlib.sha256(data)
    for content in beside.contents.values():
        digest.update(content)
    return polygons, digest.hexdigest()


def of_gltf(path: StrPath, read: Callable[[ByName, Sequence[memoryview], int], Value]) -> Value:
    """Value that a function reads from header and buffers of a .glb or .gltf file, by a budget.

    MeshError has the name of the file.
    """
    from rastercov.formats.meshes import gltf

    try:
        reader, data = _reader_and_bytes(path, LARGEST_FILE)
        with refuse_broken_files():
            if reader == "gltf.read_glb":
                header, buffers, _ = gltf.content_of_glb(data)
            else:
                wanted = "expected a .glb or .gltf file, got another format"
                check(reader == "gltf.read_gltf", wanted, "convert it")
                beside = _Beside(path, LARGEST_FILE - len(data))
                header, buffers, _ = gltf.content_of_gltf(data, beside.read)
            return read(header, buffers, MEMORY_BUDGET)
    except (MeshError, ResourceError) as error:
        raise type(error)(f"{printable(str(path))}: {error}") from error


class _Beside:
    """Files in the folder of a mesh file, or below it, that the mesh file names.

    Attributes
    ----------
    contents : dict of str to bytes
        Each file that was read, in order, by its name.
    """

    def __init__(self, path: StrPath, max_bytes: int) -> None:
        self._folder, self._bytes_left = Path(path).parent, max_bytes
        self.contents: dict[str, bytes] = {}

    def read(self, name: str) -> bytes:
        """Bytes of the file of a relative name; MeshError where it is not in the folder."""
        shown = printable(name)[:80]
        is_outside = name.startswith(("/", "\\")) or ".." in re.split(r"[/\\]", name)
        check(
            not is_outside and not re.match(r"[A-Za-z][A-Za-z0-9+.-]*:", name),
            f"expected a buffer in the folder of the file, got {shown!r}, which is never opened",
            "put it beside the file, or export a self-contained .glb",
        )
        name = posixpath.normpath(name)  # a file is read once, however its name is written
        if name not in self.contents:
            try:
                content = file_bytes(self._folder / name, self._bytes_left, SMALLER)
            except UnreadableError as error:
                got = f"expected the buffer {shown!r}, got: {error.reason}"
                raise broken(got, "put it beside the file") from error
            self.contents[name] = content
            self._bytes_left -= len(content)
        return self.contents[name]


def _reader_and_bytes(path: StrPath, max_bytes: int) -> tuple[str, bytes]:
    """Reader, of `READERS`, of the file's format, and the bytes of the file, read once."""
    is_url = re.match(r"[A-Za-z][A-Za-z0-9+.-]+:/", str(path))
    check(not is_url, "expected a file on this machine, got a URL", "download it first")
    extension = Path(path).suffix.lower()
    got = repr(extension or "no extension")
    formats = ", ".join(READERS)
    project = f"expected a mesh, got a project of {PROJECTS.get(extension)}"
    check(extension not in PROJECTS, project, "export the mesh as PLY or OBJ")
    check(extension in READERS, f"expected a mesh file of {formats}, got {got}", "convert the mesh")
    try:
        data = file_bytes(path, max_bytes, SMALLER)
    except UnreadableError as error:
        if error.is_of_system and "?" not in error.reason:
            raise broken(error.reason, "check the path") from error
        raise MeshError(error.reason) from error
    return READERS[extension], data


def _without_invalid(polygons: Polygons) -> Polygons:
    """Polygons without unusable vertices and the faces on them."""
    unusable = unusable_points(polygons.vertices)
    if not unusable.any():
        return polygons
    is_bad = np.any(unusable[polygons.faces], axis=1)
    check(not is_bad.all(), "expected a face with finite coordinates, got none")
    number = np.cumsum(~unusable) - 1
    dropped = f"dropped {places_of(unusable, polygons.faces)}: their coordinates are not finite"
    return replace(
        polygons,
        vertices=polygons.vertices[~unusable],
        faces=number[polygons.faces[~is_bad]],
        source_face=polygons.source_face[~is_bad],
        face_group=polygons.face_group[~is_bad],
        notes=[*polygons.notes, dropped],
    )


def _with_tidy_groups(polygons: Polygons) -> Polygons:
    """Polygons without empty groups, and with printable names of the others."""
    used, face_group = np.unique(polygons.face_group, return_inverse=True)
    given = [polygons.group_names[i] for i in used]
    names = [None if name is None else printable(name) or None for name in given]
    return replace(polygons, face_group=face_group, group_names=names)


def _unique(names: list[str]) -> list[str]:
    """Names in order, repeated ones with " #2", " #3" ... appended."""
    taken: set[str] = set()
    # Repetitions by the start of a name: a counter keeps many equal names linear, also those that
    # are equal only after they were shortened.
    repeats: dict[str, int] = {}
    for i, name in enumerate(names):
        unique, beginning = name, name[: LONGEST_NAME - 12]
        while unique in taken:
            repeats[beginning] = repeats.get(beginning, 1) + 1
            suffix = f" #{repeats[beginning]}"
            unique = name[: LONGEST_NAME - len(suffix)] + suffix
        taken.add(unique)
        names[i] = unique
    return names


class _MeshFiles(MeshFiles):
    @property
    def suffixes(self) -> tuple[str, ...]:
        """Those of `READERS`."""
        return tuple(READERS)

    def read(
        self, paths: Sequence[StrPath], scales: Sequence[float], limits: Limits
    ) -> tuple[Polygons, list[tuple[str, str, int, Site]]]:
        """See `read_files`."""
        return read_files(paths, scales, limits)

    def raster(self, path: StrPath) -> Raster:
        """Heights of a .tif, .tiff or .asc file."""
        from rastercov.formats.meshes import terrain

        try:
            reader, data = _reader_and_bytes(path, LARGEST_FILE)
            wanted = "expected a GeoTIFF or an ESRI ASCII grid, got a mesh"
            check(reader == "terrain.read", wanted, "name one")
            with refuse_broken_files():
                return terrain.raster_of(data)
        except MeshError as error:
            raise type(error)(f"{printable(str(path))}: {error}") from error


HOOKS = _MeshFiles()
"""Hooks of the readers."""
