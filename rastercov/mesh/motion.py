"""Similarity transformation of a mesh, or of some of its groups."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.arguments import checked_array, owned
from rastercov.base.checks import finite_number, shown
from rastercov.base.errors import MeshError
from rastercov.mesh.arrays import rotation_about


def moved_points(
    points: NDArray[np.float64],
    scale: float,
    axis: ArrayLike,
    angle_deg: float,
    translation: ArrayLike,
) -> NDArray[np.float64]:
    """Points (N, 3) of `Mesh.moved`: scaled, then turned, then translated."""
    factor, angle = finite_number(scale), np.radians(finite_number(angle_deg))
    direction, offset = _triple("axis", axis), _triple("translation", translation)
    length = np.linalg.norm(direction)
    if not factor > 0:
        raise MeshError(f"scale must be a number above 0, got {shown(scale)}; correct it")
    if not np.isfinite(angle):
        raise MeshError(f"angle_deg must be a finite number, got {shown(angle_deg)}")
    if not length > 0:
        raise MeshError(f"axis must be a direction, got {direction.tolist()}; correct it")
    with np.errstate(over="ignore", invalid="ignore"):  # the constructor finds what overflows
        moved = points * factor
        if angle:
            moved = moved @ rotation_about(direction, angle).T
        return moved + offset


def with_moved_faces(
    vertices: NDArray[np.float64],
    moved: NDArray[np.float64],
    faces: NDArray[np.int64],
    is_moved: NDArray[np.bool_],
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices and faces of a mesh of which some faces, `is_moved` (F,), use `moved` vertices.

    Vertices that they share with the others are doubled.
    """
    is_used = np.zeros((2, len(vertices)), bool)
    for row, mask in enumerate((is_moved, ~is_moved)):
        is_used[row, faces[mask]] = True
    shared = np.flatnonzero(is_used.all(axis=0))
    number = np.arange(len(vertices))
    number[shared] = len(vertices) + np.arange(len(shared))
    renumbered = faces.copy()
    renumbered[is_moved] = number[faces[is_moved]]
    moves_alone = is_used[0] & ~is_used[1]
    kept = np.where(moves_alone[:, None], moved, vertices)
    return np.concatenate([kept, moved[shared]]), renumbered


def _triple(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """(3,) finite numbers, or MeshError."""
    wanted = "three finite numbers"
    triple = owned(name, checked_array(name, values, "iuf", wanted, MeshError), np.float64)
    if triple.shape != (3,) or not np.isfinite(triple).all():
        raise MeshError(f"{name} must be {wanted}, got {shown(values)}; correct it")
    return triple
