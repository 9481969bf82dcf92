"""Targets: surfaces that are scored but hide nothing, made for a scene and added to it.

A sheet above a floor represents faces of people at eye height, a grid of boxes a capture volume.
Both are plain meshes; `with_target` adds one to a scene as a group of its own.
"""

import math
from collections.abc import Sequence
from itertools import pairwise, product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.arguments import finite_points
from rastercov.base.errors import MeshError
from rastercov.base.format import area, shortened
from rastercov.base.memory import FloatArray, IntArray
from rastercov.base.typed import typed
from rastercov.mesh.groups import Group, listed, named
from rastercov.mesh.mesh import Mesh, names_of

Corner = tuple[float, ...]
Piece = list[Corner]
"""Corners (x, y, z) of a convex polygon."""
STEEPEST_DEG = 45.0
"""Slope up to which a face counts as facing up."""
COINCIDENT_REL = 1e-7
"""Distance up to which faces of a sheet coincide, relative to its diagonal."""
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
        out; slopes stay slopes; what coincides counts once, and a note of the sheet says so. In a
        two-sided group faces that face down count, too, and are
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
    sheet = Mesh(mesh.vertices[used] + (0.0, 0.0, height), corners.reshape(-1, 3))
    return _counted_once(sheet, ", ".join(sorted(members)))


def _counted_once(sheet: Mesh, name: str) -> Mesh:
    """The sheet without what lies on another face of it, and with a note that says so.

    Faces coincide up to `COINCIDENT_REL` of the diagonal; the first of the file stays whole. Of the
    others convex pieces are left. Without such faces the sheet is returned as it is.
    """
    corners = sheet.vertices[sheet.faces]
    tolerance = COINCIDENT_REL * sheet.diagonal
    _, first = np.unique(
        np.sort(corners.view("f8,f8,f8")[..., 0], axis=1), axis=0, return_index=True
    )
    is_first = np.zeros(sheet.n_faces, np.bool_)
    is_first[first] = True
    under = _faces_under(corners, np.flatnonzero(is_first), tolerance)
    if is_first.all() and not under:
        return sheet
    kept = [corners[is_first & ~np.isin(np.arange(sheet.n_faces), list(under))]]
    faces: list[Piece] = [[tuple(corner) for corner in face] for face in corners.tolist()]
    rests: list[Piece] = []
    for row, others in under.items():
        pieces = [faces[row]]
        for other in others:
            pieces = [rest for piece in pieces for rest in _outside(piece, faces[other], tolerance)]
        rests += [
            [piece[0], *piece[k : k + 2]] for piece in pieces for k in range(1, len(piece) - 1)
        ]
    kept.append(np.array(rests, np.float64).reshape(-1, 3, 3))
    vertices = np.concatenate(kept).reshape(-1, 3)
    found = Mesh(vertices, np.arange(len(vertices)).reshape(-1, 3))
    lost = area(sheet.areas.sum() - found.areas.sum(), whole=float(sheet.areas.sum()))
    note = f"sheet above {shortened(name, 60)}: faces that coincide count once, {lost} less"
    return Mesh(found.vertices, found.faces, notes=(note,))


def _faces_under(corners: FloatArray, rows: NDArray[Any], tolerance: float) -> dict[int, list[int]]:
    """Faces that coincide with parts of each of some faces, (N, 3, 3), and come before it."""
    import shapely

    flat = corners[rows]
    boxes = shapely.box(*flat[..., :2].min(axis=1).T, *flat[..., :2].max(axis=1).T)
    one, other = shapely.STRtree(boxes).query(boxes)
    one, other = rows[one[other < one]], rows[other[other < one]]
    # Their heights meet, and no side of either has the other beyond it.
    low, high = corners[..., 2].min(axis=1), corners[..., 2].max(axis=1)
    is_near = (low[one] <= high[other] + tolerance) & (low[other] <= high[one] + tolerance)
    for a, b in ((one, other), (other, one)):
        for k in range(3):
            here = corners[a, k, None, :2]
            u, v = np.moveaxis(corners[a, (k + 1) % 3, None, :2] - here, -1, 0)
            x, y = np.moveaxis(corners[b, :, :2] - here, -1, 0)
            beyond = (u * y - v * x).max(axis=1) / np.hypot(u, v)[:, 0]
            is_near &= beyond > tolerance
    one, other = one[is_near], other[is_near]
    here = corners[other, :1]
    normal = np.cross(corners[other, 1] - here[:, 0], corners[other, 2] - here[:, 0])
    up = normal / normal[:, 2:]
    is_flat = np.abs(np.einsum("nkc,nc->nk", corners[one] - here, up)).max(axis=1) <= tolerance
    found: dict[int, list[int]] = {}
    for row, (a, b) in enumerate(zip(one.tolist(), other.tolist(), strict=True)):
        if not is_flat[row]:  # they may be of one height where they overlap
            common, face = ([tuple(each) for each in corners[f].tolist()] for f in (a, b))
            for k in range(3):
                common = _beyond(common, face[k], face[(k + 1) % 3], 1.0)
            if not common or np.abs((np.array(common) - face[0]) @ up[row]).max() > tolerance:
                continue
        found.setdefault(a, []).append(b)
    return found


def _beyond(piece: Piece, start: Corner, end: Corner, sign: float) -> Piece:
    """Part of a convex polygon left of a line of the plane of x and y, or right of it.

    Corners are tuples: arrays of a few numbers take ten times the time.
    """
    x, y = start[:2]
    u, v = end[0] - x, end[1] - y
    side = [sign * (u * (each[1] - y) - v * (each[0] - x)) for each in piece]
    found: Piece = []
    for k, corner in enumerate(piece):
        before, here, there = piece[k - 1], side[k - 1], side[k]
        if here * there < 0:
            t = here / (here - there)
            at = (p + t * (q - p) for p, q in zip(before, corner, strict=True))
            found.append(tuple(at))
        if there >= 0:
            found.append(corner)
    return found


def _outside(piece: Piece, face: Piece, tolerance: float) -> list[Piece]:
    """Convex parts of a convex polygon, seen from above, that lie outside of a triangle."""
    found = []
    for k in range(3):
        start, end = face[k], face[(k + 1) % 3]
        part = _beyond(piece, start, end, -1.0)
        if len(part) >= 3:
            away = [(each[0] - part[0][0], each[1] - part[0][1]) for each in part]
            twice = sum(x * v - u * y for (x, y), (u, v) in pairwise(away))
            if twice > tolerance * max(math.hypot(*each) for each in away):
                found.append(part)
        piece = _beyond(piece, start, end, 1.0)
        if len(piece) < 3:
            break
    return found


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
def count_for(low: ArrayLike, high: ArrayLike, spacing: float) -> IntArray:
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
