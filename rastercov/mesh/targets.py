"""Targets: surfaces that are scored but hide nothing, made for a scene and added to it.

A sheet above a floor represents faces of people at eye height, a grid of boxes a capture volume.
Both are plain meshes; `with_target` adds one to a scene as a group of its own.
"""

import math
from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.arguments import finite_points
from rastercov.base.errors import MeshError
from rastercov.base.memory import FloatArray
from rastercov.base.typed import typed
from rastercov.mesh.groups import Group, listed, named
from rastercov.mesh.mesh import Mesh, names_of

STEEPEST_DEG = 45.0
"""Slope up to which a face counts as facing up."""
MOST_BOXES = 100_000
"""Boxes of one grid."""
BOX_FACES = np.array(
    [
        *[(0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4)],
        *[(2, 6, 7), (2, 7, 3), (0, 4, 6), (0, 6, 2), (1, 3, 7), (1, 7, 5)],
    ]
)
"""Outward faces of a box whose corner k has x, y, z from bits 0, 1, 2 of k."""


@typed
def sheet_above(mesh: Mesh, group: str | Sequence[str], height: float) -> Mesh:
    """Faces of a group that face up, lifted by a height: a sheet that faces up.

    Parameters
    ----------
    mesh : Mesh
        The scene; z is up.
    group : str or sequence of str
        Names of groups or files, a floor for example. Faces steeper than `STEEPEST_DEG` are left
        out; slopes stay slopes. In a two-sided group faces that face down count, too, and are
        turned over.
    height : float
        Metres.

    Raises
    ------
    MeshError
        For an unknown group, one without a face that faces up, or a height that is not finite.
    ConfigError
        For an argument of another type.
    """
    members = named("group", group, names_of(mesh)) or set()
    if not math.isfinite(height):
        raise MeshError(f"height must be finite, got {height} m")
    upward = np.where(mesh.two_sided_mask, abs(mesh.normals[:, 2]), mesh.normals[:, 2])
    is_member = np.array([each.name in members for each in mesh.groups])[mesh.face_group]
    chosen = is_member & (upward >= math.cos(math.radians(STEEPEST_DEG)))
    if not chosen.any():
        own = repr(listed(sorted(members)))
        raise MeshError(f"group {own} has no face that faces up within {STEEPEST_DEG:g} degrees")
    faces = mesh.faces[chosen]
    is_turned = mesh.normals[chosen, 2] < 0
    faces[is_turned] = faces[is_turned, ::-1]
    used, corners = np.unique(faces, return_inverse=True)
    return Mesh(mesh.vertices[used] + (0.0, 0.0, height), corners.reshape(-1, 3))


@typed
def box_grid(
    low: ArrayLike, high: ArrayLike, count: ArrayLike = (1, 1, 1), size: float | None = None
) -> Mesh:
    """Boxes in a regular grid: one in the middle of each cell of a volume, hollow, facing outward.

    Parameters
    ----------
    low, high : (3,) float
        Corners of the volume, metres; low < high.
    count : (3,) int
        Cells along x, y and z; `MOST_BOXES` in all at most.
    size : float, optional
        Edge of a cube, metres, at most that of a cell; by default a box is half as long, wide and
        high as its cell.

    Raises
    ------
    MeshError
        For corners, counts or a size that make no boxes.
    ConfigError
        For an argument of another type, or corners that are not finite.
    """
    lowest, highest = _corners(low, high)
    cells = np.asarray(count)
    if not (lowest < highest).all():
        both = f"{lowest.tolist()} and {highest.tolist()}"
        raise MeshError(f"a volume needs corners low < high on every axis, got {both}")
    if cells.shape != (3,) or cells.dtype.kind not in "iu" or not (cells >= 1).all():
        raise MeshError(f"count must be three whole numbers of 1 or more, got {cells.tolist()}")
    n_boxes = math.prod(cells.tolist())
    if n_boxes > MOST_BOXES:
        raise MeshError(f"a grid must have at most {MOST_BOXES:,} boxes, got {n_boxes:,}")
    cell = (highest - lowest) / cells
    if size is not None and not 0 < size <= cell.min() * (1 + 1e-9):
        most = f"{cell.min():.3g} m"
        raise MeshError(f"size must be above 0 and at most that of a cell, {most}, got {size:g} m")
    half = (cell / 2 if size is None else np.full(3, size)) / 2
    corners = np.array([(k & 1, k >> 1 & 1, k >> 2) for k in range(8)]) * 2.0 - 1
    places = np.array(list(product(*(range(n) for n in cells.tolist()))))
    middles = lowest + (places + 0.5) * cell
    vertices = (middles[:, None] + corners * half).reshape(-1, 3)
    faces = BOX_FACES + 8 * np.arange(n_boxes)[:, None, None]
    return Mesh(vertices, faces.reshape(-1, 3))


@typed
def count_for(low: ArrayLike, high: ArrayLike, spacing: float) -> NDArray[np.int64]:
    """(3,) fewest cells along each axis of a volume that are no longer than `spacing`, metres.

    MeshError for a spacing of 0 or less; ConfigError as for `box_grid`.
    """
    if not spacing > 0:
        raise MeshError(f"spacing must be above 0 m, got {spacing:g}")
    lowest, highest = _corners(low, high)
    extent = highest - lowest
    # Lengths that are multiples of the spacing up to rounding get no extra cell.
    with np.errstate(over="ignore"):
        wanted = np.clip(np.ceil(extent / spacing - 1e-9), 1, 2.0**31)
    return wanted.astype(np.int64)


def _corners(low: ArrayLike, high: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Corners of a volume, (3,) each, or ConfigError."""
    wanted = "three finite numbers"
    return finite_points("low", low, (3,), wanted), finite_points("high", high, (3,), wanted)


@typed
def with_target(mesh: Mesh, target: Mesh, name: str, *, two_sided: bool = False) -> Mesh:
    """Scene with the faces of another mesh as a target, in a group of its own behind the others.

    Groups of `target` are merged, whatever their roles. MeshError for a name that is taken.
    """
    return Mesh(
        vertices=np.concatenate((mesh.vertices, target.vertices)),
        faces=np.concatenate((mesh.faces, target.faces + mesh.n_vertices)),
        groups=[*mesh.groups, Group(name, is_two_sided=two_sided, is_target=True)],
        face_group=np.concatenate(
            (mesh.face_group, np.full(target.n_faces, len(mesh.groups), np.int32))
        ),
        source_face=np.concatenate((mesh.source_face, target.source_face)),
        sources=(*mesh.sources, *target.sources),
        notes=(*mesh.notes, *target.notes),
        spaces=mesh.spaces,
    )
