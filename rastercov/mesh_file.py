"""Mesh files: what is opened, what is believed, and how several become one scene.

First step into the chain, before `mesh`. A path is looked at before it is opened (a regular file,
of a known format, not too large), its bytes are read once and hashed, and one reader turns them
into polygons. Each reader has to walk its whole file to check it, so meshes are built from that walk
and not parsed a second time by a library.
"""

import hashlib
import math
import os
import re
import stat
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rastercov.errors import MeshError, ResourceError
from rastercov.mesh import Group, Mesh, MeshSource
from rastercov.mesh_arrays import check_coordinates, some, unusable_points
from rastercov.mesh_formats import Polygons, read_obj, read_off, read_stl
from rastercov.mesh_glb import read_glb
from rastercov.mesh_ply import read_ply

READERS = {
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
LONGEST_NAME = 200

StrPath = str | os.PathLike[str]


def load_mesh(
    path: StrPath | Sequence[StrPath],
    unit: str | float = "m",
    *,
    drop_invalid: bool = False,
    max_bytes: int = LARGEST_FILE,
    memory_budget: int = MEMORY_BUDGET,
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
    memory_budget : int
        Bytes that reading may need; an estimate is held against it before memory is taken.

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
    paths = [path] if isinstance(path, (str, os.PathLike)) else list(path)
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
            names.append(_unique(full, names))
        notes += [f"{shown}: {note}" for note in polygons.notes]
    n_vertices = np.cumsum([0] + [len(part.vertices) for part in parts])
    n_names = np.cumsum([0] + [len(part.names) for part in parts])
    return Mesh(
        vertices=np.concatenate([part.vertices for part in parts]),
        faces=np.concatenate([p.faces + n for p, n in zip(parts, n_vertices, strict=False)]),
        groups=[Group(name) for name in names],
        face_group=np.concatenate([p.label + n for p, n in zip(parts, n_names, strict=False)]),
        source_face=np.concatenate([part.source_face for part in parts]),
        sources=sources,
        notes=notes,
    )


def metres_per(unit: str | float) -> float:
    """Metres in one `unit`, a name or a positive number."""
    if isinstance(unit, str) and unit in METRES:
        return METRES[unit]
    if isinstance(unit, (int, float)) and not isinstance(unit, bool):
        if 0 < unit < math.inf:
            return float(unit)
    raise MeshError(
        f"unit must be one of {', '.join(METRES)} or metres per unit as a positive number, "
        f"got {unit!r}; correct it"
    )


def _load_one(
    path: StrPath, scale: float, drop_invalid: bool, max_bytes: int, memory_budget: int
) -> tuple[Polygons, MeshSource]:
    """Polygons of one file, in metres and checked, and its hash."""
    reader, data = _reader_and_bytes(path, max_bytes)
    if not data:
        raise MeshError("no triangles: the file is empty; export it again")
    try:
        polygons = reader(data, memory_budget)
    except (TypeError, ValueError, KeyError, AttributeError, OverflowError) as error:
        # JSON may hold any type anywhere; checking each is longer than this and no clearer.
        if isinstance(error, MeshError):
            raise
        raise MeshError(f"the file contradicts its format ({error!r}); export it again") from error
    _check_polygons(polygons)
    polygons.vertices *= scale
    if drop_invalid:
        _drop_invalid(polygons)
    check_coordinates(polygons.vertices, polygons.faces)
    _tidy_groups(polygons)
    digest = hashlib.sha256(data).hexdigest()
    return polygons, MeshSource(_clean(Path(path).name), digest, len(polygons.faces))
