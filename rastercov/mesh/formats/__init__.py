"""Mesh files: what is opened, what is believed, and how several become one scene.

First step into the chain, before `mesh`. A path is looked at before it is opened (a regular file,
of a known format, not too large), its bytes are read once and hashed, and one reader turns them
into polygons. Each reader has to walk its whole file to check it, so meshes are built from that
walk and not parsed a second time by a library.
"""

import hashlib
import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from rastercov._arguments import members
from rastercov._checks import finite_number, shown
from rastercov._files import StrPath, UnreadableError, file_bytes
from rastercov.errors import MeshError, ResourceError
from rastercov.mesh import Group, Mesh, MeshSource
from rastercov.mesh.arrays import check_coordinates, some, unusable_points
from rastercov.mesh.ear_clipping import cut_concave
from rastercov.mesh.formats.glb import read_glb
from rastercov.mesh.formats.ply import read_ply
from rastercov.mesh.formats.polygons import (
    PEAK_BYTES_PER_FACE,
    Polygons,
    read_obj,
    read_off,
    read_stl,
)

Reader = Callable[[bytes, int], Polygons]

READERS: dict[str, Reader] = {
    ".glb": read_glb,
    ".obj": read_obj,
    ".off": read_off,
    ".ply": read_ply,
    ".stl": read_stl,
}
METRES = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "um": 1e-6, "µm": 1e-6, "μm": 1e-6}  # two Unicode mus
METRES |= {"in": 0.0254, "inch": 0.0254, "ft": 0.3048}
LARGEST_FILE = 2 << 30
MEMORY_BUDGET = 8 << 30
FREE_FACES = 1 << 20  # that a short file may be multiplied into without memory_budget
LONGEST_NAME = 200


def load_mesh(
    path: StrPath | Sequence[StrPath],
    unit: str | float = "m",
    *,
    drop_invalid: bool = False,
    max_bytes: int = LARGEST_FILE,
    memory_budget: int | None = None,
) -> Mesh:
    """Mesh of one file, or of several as one scene.

    Parameters
    ----------
    path : path or sequence of paths
        STL, OBJ, PLY, OFF or GLB files; regular files (or links to them) on this machine.
    unit : str or float
        Unit of the coordinates: m, mm, cm, um, in, ft, or metres per unit.
    drop_invalid : bool
        Drop faces whose coordinates are not finite, with a warning; `source_face` has the rest.
    max_bytes : int
        Largest file that is read.
    memory_budget : int, optional
        Bytes that reading a file may need; an estimate is held against it before memory is taken.
        8 GiB by default, but no more than 2^20 triangles need, or one a byte of the file: only
        instances and shared data can ask for more than that.

    Returns
    -------
    Mesh
        Faces in the order of the files. Groups are the groups, objects or nodes that have names in
        the file (as "stem/name" if there are several files), otherwise the file's stem.
        `source_face` counts the polygons of each file from 0.

    Raises
    ------
    MeshError
        Not a file that can be used; the message names it, what is wrong, and where.
    ResourceError
        Too many faces for the budget.
    """
    paths = (
        [path]
        if isinstance(path, (str, os.PathLike))
        else members(
            "path", path, (str, os.PathLike), "a path or several, as strings or Paths", MeshError
        )
    )
    if not paths:
        raise MeshError("at least one mesh file wanted, got none; pass a path")
    scale = metres_per(unit)
    parts: list[Polygons] = []
    sources: list[MeshSource] = []
    names: list[str] = []
    notes: list[str] = []
    for one in paths:
        shown = _clean(str(one))
        try:
            with np.errstate(all="ignore"):  # what overflows is caught as a coordinate
                polygons, source = _load_one(one, scale, drop_invalid, max_bytes, memory_budget)
        except (MeshError, ResourceError) as error:
            raise type(error)(f"{shown}: {error}") from error
        parts.append(polygons)
        sources.append(source)
        stem = _clean(Path(one).stem) or "mesh"
        for name in polygons.names:
            full = stem if name is None else f"{stem}/{name}" if len(paths) > 1 else name
            names.append(full[:LONGEST_NAME])
        notes += [f"{shown}: {note}" for note in polygons.notes]
    n_vertices = np.cumsum([0] + [len(part.vertices) for part in parts])
    n_names = np.cumsum([0] + [len(part.names) for part in parts])
    return Mesh(
        vertices=np.concatenate([part.vertices for part in parts]),
        faces=np.concatenate([p.faces + n for p, n in zip(parts, n_vertices, strict=False)]),
        groups=[Group(name) for name in _unique(names)],
        face_group=np.concatenate([p.label + n for p, n in zip(parts, n_names, strict=False)]),
        source_face=np.concatenate([part.source_face for part in parts]),
        sources=sources,
        notes=notes,
    )


def metres_per(unit: str | float) -> float:
    """Metres in one `unit`, a name or a positive number."""
    if isinstance(unit, str) and unit in METRES:
        return METRES[unit]
    if (metres := finite_number(unit)) > 0:
        return metres
    raise MeshError(
        f"unit must be one of {', '.join(METRES)} or metres per unit as a positive number, "
        f"got {shown(unit)}; correct it"
    )


def _load_one(
    path: StrPath, scale: float, drop_invalid: bool, max_bytes: int, memory_budget: int | None
) -> tuple[Polygons, MeshSource]:
    """Polygons of one file, in metres and checked, and its hash."""
    reader, data = _reader_and_bytes(path, max_bytes)
    if not data:
        raise MeshError("no triangles: the file is empty; export it again")
    if memory_budget is None:
        memory_budget = min(MEMORY_BUDGET, PEAK_BYTES_PER_FACE * max(FREE_FACES, len(data)))
    polygons = reader(data, memory_budget)
    _check_indices(polygons)
    polygons.vertices *= scale
    if drop_invalid:
        _drop_invalid(polygons)
    check_coordinates(polygons.vertices, polygons.faces)
    polygons.notes += cut_concave(polygons.vertices, polygons.faces, polygons.source_face)
    _tidy_groups(polygons)
    digest = hashlib.sha256(data).hexdigest()
    return polygons, MeshSource(_clean(Path(path).name), digest, len(polygons.faces))


def _reader_and_bytes(path: StrPath, max_bytes: int) -> tuple[Reader, bytes]:
    """Reader for the file's format, and the bytes of the file, read once."""
    if not isinstance(path, (str, os.PathLike)):
        raise MeshError(f"a path wanted, got {type(path).__name__}; pass a string or a Path")
    if re.match(r"[A-Za-z][A-Za-z0-9+.-]+:/", str(path)):
        raise MeshError("a file on this machine wanted, got a URL; download it first")
    extension = Path(path).suffix.lower()
    if extension not in READERS:
        raise MeshError(
            f"supported formats are {', '.join(READERS)}, got {extension or 'no extension'!r}; "
            "convert the mesh"
        )
    try:
        data = file_bytes(path, max_bytes, "simplify the mesh, or raise max_bytes")
    except UnreadableError as error:
        if error.is_of_system:
            text = f"a readable file wanted, got: {error.reason}; check the path"
            raise MeshError(text) from error
        raise MeshError(error.reason) from error
    return READERS[extension], data


def _check_indices(polygons: Polygons) -> None:
    faces, n_vertices = polygons.faces, len(polygons.vertices)
    if not len(faces):
        raise MeshError("no triangles: the file has no faces; export the surface, not points")
    outside = np.any((faces < 0) | (faces >= n_vertices), axis=1)
    if outside.any():
        face = int(outside.argmax())
        raise MeshError(
            f"vertex indices must lie in 0 ... {n_vertices - 1}, face "
            f"{polygons.source_face[face]} has {faces[face].tolist()}; correct the face"
        )


def _drop_invalid(polygons: Polygons) -> None:
    """Remove unusable vertices and the faces that need them."""
    unusable = unusable_points(polygons.vertices)
    if not unusable.any():
        return
    is_bad = np.any(unusable[polygons.faces], axis=1)
    if is_bad.all():
        raise MeshError("no triangles left: no face has finite coordinates; export the mesh again")
    polygons.notes.append(f"faces {some(is_bad)} dropped: their coordinates are not finite")
    number = np.cumsum(~unusable) - 1
    polygons.vertices = polygons.vertices[~unusable]
    polygons.faces = number[polygons.faces[~is_bad]]
    polygons.source_face = polygons.source_face[~is_bad]
    polygons.label = polygons.label[~is_bad]


def _tidy_groups(polygons: Polygons) -> None:
    """Drop groups without faces, and clean the names of the others."""
    used, label = np.unique(polygons.label, return_inverse=True)
    names = [polygons.names[i] for i in used]
    polygons.names = [None if name is None else _clean(name) or None for name in names]
    polygons.label = label


def _clean(name: str) -> str:
    """Printable part of `name`, not too long: names end up in terminals, tables and pictures."""
    return "".join(c for c in name if c.isprintable()).strip()[:LONGEST_NAME]


def _unique(names: list[str]) -> list[str]:
    """Names in order, repeated ones with " #2", " #3" ... appended."""
    taken: set[str] = set()
    # How often names with this beginning came: a counter keeps many nodes fast, and so does one for
    # all names that are cut off to the same beginning.
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
