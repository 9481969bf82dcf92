"""Viewsheds: the visible part of every cell of a terrain, from one place or several.

The engine goes over the cells of the raster from the observer outwards, see
`engine/survey/viewshed.cpp`: exact to rounding, with a bound, and without the arrays of a mesh.
"""

from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike

from rastercov.base import (
    ConfigError,
    FloatArray,
    InOneLine,
    IntArray,
    StrPath,
    check_array,
    dots,
    finite_number,
    frozen_record,
    norm,
    shown,
)
from rastercov.base.arguments import own_array
from rastercov.core.camera import near_limit
from rastercov.core.camera.conventions import panorama
from rastercov.core.camera.viewpoints import look_at
from rastercov.core.coverage.job import evaluate
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.files import raster_of
from rastercov.core.mesh.sections import cross
from rastercov.core.mesh.terrain import REFRACTION, Raster
from rastercov.core.mesh.topology import edge_table
from rastercov.engine import survey_viewshed as kernels
from rastercov.shards import Progress, silent

NO_PIECES = np.empty((0, 4, 2))
FARTHEST = 1e9
"""Coordinates and heights of observers, m, are smaller."""
EDGE_ON = 1e-9
"""Sine of the angle to rays up to which a triangle is edge-on."""
MOST_PIECES = 200_000
"""Visible pieces whose outlines are joined: about a minute."""


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
    target, radius : float
        As given; a radius of inf for none.
    share, bound : (H - 1, W - 1) float64
        Visible part of the ground of each cell between four samples, on the map; of several
        observers the sum: the mean number of them that see a point of the cell. `bound` is that
        of its error, up to 1 for a triangle that is seen edge-on to rounding, such as the ground
        below eyes at a height of 0. NaN without ground, and beyond the radius of all.
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
    target: float
    radius: float
    share: FloatArray
    bound: FloatArray
    seen: tuple[Seen, ...]

    def __str__(self) -> str:
        best = max(self.seen, key=lambda each: each.area)
        share = 100 * best.area / best.of_area
        of = "" if len(self.seen) == 1 else f" by the best of {len(self.seen)} observers"
        return f"Viewshed({share:.4g} % of {best.of_area:.6g} m2 visible{of})"


def viewshed(
    heights: StrPath | ArrayLike,
    observers: ArrayLike,
    *,
    spacing: float | tuple[float, float] | None = None,
    height: float = 1.7,
    target: float = 0.0,
    radius: float | None = None,
    refraction: float = REFRACTION,
    curvature: bool = True,
    beside: Mesh | None = None,
    progress: Progress = silent,
) -> Viewshed:
    """Visible part of every cell of a terrain, exact to rounding.

    The surface is that of `Mesh.terrain`. Rays are straight on an earth whose curvature refraction
    lessens, equally for every observer.

    Parameters
    ----------
    heights : path or (H, W) array_like
        As for `Mesh.terrain`.
    observers : (2,), (N, 2) or (N, 3) array_like
        Map coordinates, metres, or longitude and latitude; the third column is the height of the
        eyes above the ground.
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
        in 40 to 50 times the time.
    progress : callable
        Called with the number of observers that are done, and of all.

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
    if not finite_number(target) >= 0:
        raise ConfigError(f"expected a target of 0 m or more above the ground, got {shown(target)}")
    reach = np.inf if radius is None else finite_number(radius)
    if not reach > 0:
        raise ConfigError(f"expected a radius above 0 m, got {shown(radius)}; increase it")
    if beside is not None:
        beside = _over(raster, beside)
    places = [_place(raster, eye) for eye in eyes]  # errors before the work
    on_map, slopes = raster.areas()
    areas, seen = (on_map, np.nan_to_num(slopes)), []
    sums = np.zeros((3, *slopes.shape))
    for n, place in enumerate(places, 1):
        both, _ = _solve(raster, place, target, reach, NO_PIECES)
        ground = np.isfinite(both[0])
        if not ground.any():
            raise ConfigError(f"expected ground within {reach:g} m, got none; increase the radius")
        if beside is not None:
            both = _solve_beside(raster, place, (eyes[n - 1, 2], target), beside, both)
        both[:, ~ground] = 0.0
        parts = (*both, ground)
        seen.append(Seen(*(float((part * area).sum()) for area in areas for part in parts)))
        sums[:2] += both
        sums[2] += ground
        progress(n, len(eyes))
    whole = (np.isfinite(slopes) * on_map).sum(axis=2)
    whole[~sums[2].any(axis=2)] = np.nan
    share, bound = np.minimum((sums[:2] * on_map).sum(axis=3) / whole, len(eyes))
    return Viewshed(raster, eyes, float(target), reach, share, bound, tuple(seen))


def observers_of(points: ArrayLike, height: float) -> FloatArray:
    """(N, 3) map coordinates and heights above the ground."""
    given = check_array("observers", points, "iuf", "(N, 2)", ConfigError)
    array = np.atleast_2d(own_array("observers", given, np.float64))
    if array.shape[1:] == (2,):
        array = np.insert(array, 2, finite_number(height), axis=1)
    is_usable = array.size > 0 and array.shape[1:] == (3,) and (abs(array) < FARTHEST).all()
    if not (is_usable and array[:, 2].min() >= 0):
        raise ConfigError(
            f"expected observers (N, 2) or (N, 3) within {FARTHEST:g} m, of a height of 0 or more "
            f"above the ground, got {shown(array.tolist())}; correct them"
        )
    return array


Place = tuple[float, float, int, int, float]
"""Of an observer on the map from the origin, its row and column, and the height of its eyes."""


def _place(raster: Raster, observer: FloatArray) -> Place:
    """The place of an observer; its triangle is that of the engine, with straight sides."""
    x, y = (observer[:2] - raster.origin).tolist()
    xs, ys = raster.xy
    column = min(max(int(x // raster.spacing[0]), 0), len(xs) - 2)
    points, faces = raster.triangles((x, y), slice(column, column + 2))
    corners = points[faces]
    weights = cross(np.roll(corners, -1, axis=1), np.roll(corners, 1, axis=1))
    parts = np.where(weights > 0, weights * corners[..., 2], 0.0).sum(axis=1)
    heights = np.where((weights >= 0).all(axis=1), parts / weights.sum(axis=1), np.nan)
    known = np.flatnonzero(np.isfinite(heights))
    if not len(known):
        (west, north), (east, south) = raster.origin, np.add(raster.origin, (xs[-1], ys[-1]))
        raise ConfigError(
            f"expected an observer on the raster, over ground, x from {west:.10g} to {east:.10g} "
            f"and y from {south:.10g} to {north:.10g}, got {observer[0]:.10g}, "
            f"{observer[1]:.10g}; move it"
        )
    own = known[np.argmin(known % 2)]
    return x, y, int(own // 2), column, float(heights[own] + observer[2])


def _solve(
    raster: Raster, place: Place, target: float, reach: float, pieces: FloatArray
) -> tuple[FloatArray, int]:
    """Visible parts of triangles and bounds, (2, H - 1, W - 1, 2), and the number of pieces.

    NaN beyond the reach and without ground. Strips of the engine are columns, which are meridians
    on a map in degrees; its x is south.
    """
    _, _, row, column, eye = place
    x, y = raster.xy
    east, north = raster.about(x[:, None], y, place)
    fall = 0.5 * raster.inverse_radius * (east**2 + north**2)
    above = raster.heights.T - eye
    points = np.empty((*above.shape, 4))
    for k, part in enumerate((-north, east, above - fall, abs(above) + fall + target + abs(eye))):
        points[..., k] = part
    both = np.full((2, len(x) - 1, len(y) - 1, 2), np.nan)
    n = kernels.viewshed((points, column, row, float(target), reach, *both, pieces))
    return both.transpose(0, 2, 1, 3)[..., ::-1], n


def _over(raster: Raster, beside: Mesh) -> Mesh:
    """Faces whose box on the map meets that of the raster; only these hide its ground."""
    if raster.is_geographic:
        raise ConfigError(
            "expected a raster in metres with a mesh beside it, got one in degrees; reproject it, "
            "such as gdalwarp -t_srs EPSG:32632"
        )
    corners = beside.vertices[beside.faces, :2] - raster.origin
    x, y = raster.xy
    is_over = (corners.max(axis=1) >= (0, y[-1])) & (corners.min(axis=1) <= (x[-1], 0))
    chosen = is_over.all(axis=1)
    if not chosen.any():
        raise ConfigError("expected a mesh over the raster, got one beside it; move it")
    return beside._of_faces(chosen)


def _solve_beside(
    raster: Raster, place: Place, heights: tuple[float, float], beside: Mesh, alone: FloatArray
) -> FloatArray:
    """Visible parts of triangles, and bounds, where a mesh hides ground, too.

    `heights` are those of the eyes and the target above the ground, `alone` is without the mesh.
    """
    height, target = heights
    points, faces, cells, _ = raster.surface(place)
    away = beside.vertices - (*np.add(place[:2], raster.origin), 0.0)
    away[:, 2] -= 0.5 * raster.inverse_radius * (away[:, :2] ** 2).sum(axis=1)
    seen = Mesh(np.add(points, (0.0, 0.0, target)), faces)
    parts = [seen, Mesh(away, beside.faces), _solid(points, faces, target > 0)]
    names = ["seen", "beside", "ground"]
    raised = names[:1] if target else []
    scene = Mesh.joined(parts, names).with_groups(names[1:], raised, raised)
    pose = look_at([(0.0, 0.0, place[4])], [(1.0, 0.0, place[4])])
    camera = panorama(2000, 1000)
    near = near_limit(camera, scene.bounds, pose)[0]
    if not (height == 0 or height > near):
        raise ConfigError(
            f"expected eyes more than {near:.3g} m above the ground, 1e-6 of the distance to the "
            f"farthest corner of the mesh, got {height:g} m; cut the mesh"
        )
    covered = evaluate(scene, camera, pose).covered
    parts_of = np.stack((covered.area[0], covered.bound))[:, : len(faces)] / seen.areas
    # The image shows nothing of what is edge-on; no more of it is seen than without the mesh.
    corners = seen.vertices[seen.faces] - (0.0, 0.0, place[4])
    is_flat = abs(dots(seen.normals, corners[:, 0])) <= EDGE_ON * norm(corners).max(axis=1)
    most = alone.reshape(2, -1)[:, cells].sum(axis=0) / 2
    both = np.zeros(alone.shape)
    both.reshape(2, -1)[:, cells] = np.where(is_flat, most, parts_of)
    return both


def _solid(points: FloatArray, faces: IntArray, with_ground: bool) -> Mesh:
    """Walls below the borders of the ground, which let no ray pass under it, with or without it."""
    table = edge_table(faces, len(points))
    ends = table.vertices[table.n_uses == 1].astype(np.int64)
    below = np.array(points)
    below[:, 2] = points[:, 2].min() - 1.0
    walls = np.concatenate((ends, ends[:, ::-1] + len(points)), axis=1)
    every = np.concatenate((faces[: len(faces) * with_ground], walls[:, :3], walls[:, [2, 3, 0]]))
    return Mesh(np.concatenate((points, below)), every)


def outlines_of(viewshed: Viewshed) -> list[shapely.Geometry]:
    """Outlines of the ground that each observer sees, on the map.

    ConfigError for more pieces than can be joined.
    """
    raster, outlines = viewshed.raster, []
    for observer in viewshed.observers:
        pieces = np.empty((MOST_PIECES, 4, 2))
        _, n = _solve(raster, _place(raster, observer), viewshed.target, viewshed.radius, pieces)
        if n > MOST_PIECES:
            raise ConfigError(
                f"--outlines: expected at most {MOST_PIECES:,} visible pieces, got {n:,}; give a "
                "--radius"
            )
        corners = raster.origin + pieces[:n] * raster.spacing * (1, -1)
        polygons = shapely.make_valid(shapely.polygons(corners))
        whole = shapely.union_all(polygons, grid_size=raster.spacing[0] * 1e-8)
        pieces = shapely.get_parts(whole)
        outlines.append(shapely.multipolygons(pieces[shapely.area(pieces) > 0]))
    return outlines
