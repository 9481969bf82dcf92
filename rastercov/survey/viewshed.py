"""Viewsheds: the visible part of every cell of a terrain, from one place or several.

The engine goes over the cells of the raster from the observer outwards, see
`engine/survey/viewshed.cpp`: exact to rounding, with a bound, and without the arrays of a mesh.
"""

import os
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    BoolArray,
    ConfigError,
    FloatArray,
    InOneLine,
    StrPath,
    check_array,
    finite_number,
    frozen_record,
    hypot,
    norm,
    shown,
)
from rastercov.core.camera.conventions import panorama
from rastercov.core.camera.viewpoints import look_at
from rastercov.core.coverage.job import evaluate
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.files import mesh_files
from rastercov.core.mesh.terrain import REFRACTION, Raster, raster_of_array
from rastercov.engine import survey_viewshed as kernels

EYE_HEIGHT = 1.7
"""Height of a person's eyes above the ground, m."""
NO_PIECES = np.empty((0, 8))


class Seen(NamedTuple):
    """Areas that an observer sees, and that are within the radius, m^2, with bounds.

    Attributes
    ----------
    area, area_bound, of_area : float
        On the map.
    surface, surface_bound, of_surface : float
        On the slopes.
    """

    area: float
    area_bound: float
    of_area: float
    surface: float
    surface_bound: float
    of_surface: float


@frozen_record(repr=False)
class Viewshed(InOneLine):
    """Parts of a terrain that N observers see.

    Attributes
    ----------
    raster : Raster
        Heights, (H, W), and their place.
    observers : (N, 3) float64
        Map coordinates, and height of the eyes above the ground, metres.
    share, bound : (H - 1, W - 1) float64
        Visible part of the ground of each cell between four samples, on the map; of several
        observers the sum: the mean number of them that see a point of the cell. `bound` is that
        of its error. NaN without ground, and beyond the radius of all.
    seen : tuple of Seen
        Areas of each observer.

    Examples
    --------
    >>> import rastercov as rc
    >>> print(rc.viewshed([[0, 0, 9, 0, 0]] * 3, (0, -30), spacing=30.0))
    Viewshed(50 % of 7200 m2 visible)
    """

    raster: Raster
    observers: FloatArray
    share: FloatArray
    bound: FloatArray
    seen: tuple[Seen, ...]

    def __str__(self) -> str:
        best = max(self.seen, key=lambda each: each.area)
        share = 100 * best.area / max(best.of_area, 1e-300)
        of = "" if len(self.seen) == 1 else f" by the best of {len(self.seen)} observers"
        return f"Viewshed({share:.4g} % of {best.of_area:.6g} m2 visible{of})"


def raster_of(heights: StrPath | ArrayLike, spacing: float | tuple[float, float] | None) -> Raster:
    """Raster of a file or of an array with its spacing, metres."""
    if isinstance(heights, str | os.PathLike):
        return mesh_files().raster(heights)
    return raster_of_array(heights, spacing)


def viewshed(
    heights: StrPath | ArrayLike,
    observers: ArrayLike,
    *,
    spacing: float | tuple[float, float] | None = None,
    height: float = EYE_HEIGHT,
    target: float = 0.0,
    radius: float | None = None,
    refraction: float = REFRACTION,
    curvature: bool = True,
    beside: Mesh | None = None,
) -> Viewshed:
    """Visible part of every cell of a terrain, exact to rounding.

    The surface is that of `Mesh.terrain`. Rays are straight on an earth whose curvature refraction
    lessens, equally for every observer.

    Parameters
    ----------
    heights : path or (H, W) array_like
        As for `Mesh.terrain`.
    observers : (2,), (N, 2) or (N, 3) array_like
        Map coordinates, metres; the third column is the height of the eyes above the ground.
    spacing : float or (float, float), optional
        Distance of columns and of rows of an array, metres; its north-west sample is at (0, 0).
    height : float
        Height of eyes above the ground, metres, where observers have none.
    target : float
        Height above the ground of what is to be seen, metres. It hides nothing.
    radius : float, optional
        Largest distance on the map, to the middle of a cell, metres.
    refraction, curvature
        As for `Mesh.terrain`.
    beside : Mesh, optional
        Buildings and trees in map coordinates, which hide ground. The general engine then answers,
        in some 30 times the time.

    Raises
    ------
    MeshError
        For an unusable raster.
    ConfigError
        For observers beside the raster or over a hole, and for a negative height.

    Examples
    --------
    >>> import rastercov as rc
    >>> ridge = [[0, 0, 9, 0, 0]] * 3
    >>> seen = rc.viewshed(ridge, (0, -30), spacing=30.0)
    >>> seen.share[0].round(3).tolist()
    [1.0, 1.0, 0.0, 0.0]
    """
    raster = raster_of(heights, spacing).curved(refraction, curvature=curvature)
    eyes = observers_of(observers, height)
    return viewshed_of(raster, eyes, target=target, radius=radius, beside=beside)


def observers_of(points: ArrayLike, height: float) -> FloatArray:
    """(N, 3) map coordinates and heights above the ground."""
    array = np.atleast_2d(check_array("observers", points, "iuf", "(N, 2)", ConfigError))
    if array.ndim != 2 or array.shape[1] not in (2, 3) or not len(array):
        raise ConfigError(f"expected observers (N, 2) or (N, 3), got shape {array.shape}")
    if array.shape[1] == 2:
        array = np.column_stack((array, np.full(len(array), finite_number(height))))
    if not np.isfinite(array).all() or not (array[:, 2] >= 0).all():
        raise ConfigError(
            "expected finite observers with a height of 0 or more above the ground, got "
            f"{shown(array.tolist())}; correct them"
        )
    return array.astype(np.float64)


def viewshed_of(
    raster: Raster,
    observers: FloatArray,
    *,
    target: float = 0.0,
    radius: float | None = None,
    beside: Mesh | None = None,
    each: Callable[[int], None] = lambda n: None,
) -> Viewshed:
    """`viewshed` of a raster; calls `each` with the number of observers that are done."""
    if not finite_number(target) >= 0:
        raise ConfigError(f"expected a target of 0 m or more above the ground, got {shown(target)}")
    reach = np.inf if radius is None else finite_number(radius)
    if not reach > 0:
        raise ConfigError(f"expected a radius above 0 m, got {shown(radius)}; increase it")
    eyes = [_eye(raster, observer) for observer in observers]  # errors before the work
    slopes = np.where(raster.is_ground, raster.slopes, 0.0)
    part = raster.is_ground.mean(axis=2)
    total, bound = np.zeros((2, *part.shape))
    counts = np.zeros(part.shape, np.bool_)
    seen = []
    for n, eye in enumerate(eyes, 1):
        if beside is None:
            share, error, _ = _solve(raster, eye, target, reach)
        else:
            share, error = _solve_beside(raster, eye, target, beside)
        within = _within(raster, eye, reach)
        share[~within] = 0
        error[~within] = 0
        counts |= within
        ground = np.where(within[..., None] & raster.is_ground, 0.5, 0.0)
        cell = raster.spacing[0] * raster.spacing[1]
        parts = (share, error, ground)
        on_map = [cell * float(each.sum()) for each in parts]
        on_slopes = [cell * float((each * slopes).sum()) for each in parts]
        seen.append(Seen(*on_map, *on_slopes))
        total += share.sum(axis=2)
        bound += error.sum(axis=2)
        each(n)
    part[~counts | (part == 0)] = np.nan
    share = np.minimum(total / part, len(eyes))
    return Viewshed(raster, observers, share, bound / part, tuple(seen))


def _solve(
    raster: Raster, eye: FloatArray, target: float, reach: float, pieces: FloatArray = NO_PIECES
) -> tuple[FloatArray, FloatArray, int]:
    """Visible parts of cells in their two triangles, bounds, and the number of pieces."""
    share, bound = np.zeros((2, *raster.is_ground.shape))
    beyond = reach + float(norm(raster.spacing))
    ground = (raster.heights, np.array(raster.spacing), raster.inverse_radius)
    n = kernels.viewshed(ground, (eye, float(target), beyond), (share, bound, pieces))
    return share, bound, n


def _solve_beside(
    raster: Raster, eye: FloatArray, target: float, beside: Mesh
) -> tuple[FloatArray, FloatArray]:
    """Visible parts of cells in their two triangles, and bounds, where a mesh hides ground, too."""
    at = np.array((raster.origin[0] + eye[0], raster.origin[1] - eye[1]))
    points, faces, cells = raster.surface(at)[:3]
    ground = Mesh(points - (*at, 0.0), faces)
    fall = 0.5 * raster.inverse_radius * ((beside.vertices[:, :2] - at) ** 2).sum(axis=1)
    moved = Mesh(
        beside.vertices - np.column_stack((np.tile(at, (len(fall), 1)), fall)), beside.faces
    )
    parts = [Mesh(ground.vertices + np.array((0.0, 0.0, target)), faces), moved]
    scene = Mesh.joined(parts, ["seen", "beside"]).with_groups(occluders=["beside"])
    if target:
        scene = Mesh.joined([*parts, ground], ["seen", "beside", "ground"])
        scene = scene.with_groups(["beside", "ground"], ["seen"], ["seen"])
    pose = look_at([(0.0, 0.0, eye[2])], [(1.0, 0.0, eye[2])])
    covered = evaluate(scene, panorama(2000, 1000), pose).covered
    both = np.zeros((2, raster.is_ground.size))
    both[:, cells] = 0.5 * np.stack((covered.area[0], covered.bound))[:, : len(faces)]
    both[:, cells] /= ground.areas
    share, bound = both.reshape(2, *raster.is_ground.shape)
    return share, bound


def _eye(raster: Raster, observer: FloatArray) -> FloatArray:
    """Place of the eyes from the first sample along columns and rows, and their height."""
    x, y, height = observer.tolist()
    dx, dy = raster.spacing
    along = np.array((x - raster.origin[0], raster.origin[1] - y))
    rows, columns = raster.heights.shape
    if not (0 <= along[0] <= dx * (columns - 1) and 0 <= along[1] <= dy * (rows - 1)):
        xs, ys = raster.xy
        raise ConfigError(
            f"expected an observer on the raster, x from {xs[0]:.10g} to {xs[-1]:.10g} and y from "
            f"{ys[-1]:.10g} to {ys[0]:.10g}, got {x:.10g}, {y:.10g}; correct it"
        )
    j, i = min(int(along[0] / dx), columns - 2), min(int(along[1] / dy), rows - 2)
    u, v = along[0] / dx - j, along[1] / dy - i
    corners = [(i, j, 1 - max(u, v)), (i + 1, j + 1, min(u, v))]
    corners.append((i, j + 1, u - v) if u > v else (i + 1, j, v - u))
    ground = 0.0
    for row, column, weight in corners:
        if weight > 0:
            away = (column * dx - along[0]) ** 2 + (row * dy - along[1]) ** 2
            fall = 0.5 * raster.inverse_radius * away
            ground += weight * (raster.heights[row, column] - fall)
    if not np.isfinite(ground):
        raise ConfigError(
            f"expected an observer over ground, got {x:.10g}, {y:.10g} over a hole; move it"
        )
    return np.array((along[0], along[1], ground + height))


def _within(raster: Raster, eye: FloatArray, reach: float) -> BoolArray:
    """(H - 1, W - 1) cells whose middle is within reach."""
    rows, columns = raster.heights.shape
    x = (np.arange(columns - 1) + 0.5) * raster.spacing[0] - eye[0]
    y = (np.arange(rows - 1) + 0.5) * raster.spacing[1] - eye[1]
    return hypot(x, y[:, None]) <= reach


def pieces_of(
    raster: Raster, observer: FloatArray, *, target: float = 0.0, radius: float | None = None
) -> FloatArray:
    """(N, 4, 2) quadrangles on the map that an observer sees, of the cells within the radius."""
    eye = _eye(raster, observer)
    reach = np.inf if radius is None else radius
    *_, n = _solve(raster, eye, target, reach)
    pieces = np.empty((n, 8))
    _solve(raster, eye, target, reach, pieces)
    corners = pieces.reshape(-1, 4, 2)
    within = _within(raster, eye, reach)
    column, row = (corners.mean(axis=1) / raster.spacing).astype(np.int64).T
    rows, columns = within.shape
    kept = within[np.minimum(row, rows - 1), np.minimum(column, columns - 1)]
    return corners[kept] * (1, -1) + raster.origin
