"""Rooms of a building: what a point reaches, a polygon with heights, or a solid; z is up.

A room limits mounting positions (`mounting.in_room`) and targets above a floor. The space of a
point is flooded over a grid, through places that are as far from every surface as half the width
of an opening: a door separates two rooms, although nothing closes it.

Positions where a camera can be mounted: outside solids and keep-out volumes, clear of surfaces.

`filter_candidates` is applied to the output of the candidate generators, before any step that costs
time for each candidate. A tree of boxes finds nearest surfaces and counts the crossings of rays,
which give winding numbers.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Any, Protocol

import numpy as np
from annotated_types import Gt
from numpy.typing import ArrayLike
from typing_extensions import Doc

from rastercov.base import (
    TINY,
    BoolArray,
    ByteArray,
    ConfigError,
    FloatArray,
    IntArray,
    MeshError,
    dots,
    finite_number,
    finite_points,
    frozen_record,
    norm,
    plural,
    shown,
    sort_order,
)
from rastercov.base.typed import check_fields, typed
from rastercov.core.coverage.doubts import name_places
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.contacts import TriangleTree
from rastercov.core.mesh.groups import quote
from rastercov.core.mesh.mesh import faces_of_groups
from rastercov.core.mesh.solids import in_solid
from rastercov.formats.meshes.ifc import Product
from rastercov.placement.candidates.pool import Candidates


class KeepOut(Protocol):
    """A volume without cameras: any object with a name and `contains`.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import Framing, filter_candidates, on_sphere
    >>> mesh, camera = rc.shapes.box(), rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> result = on_sphere(mesh, camera, Framing(stand_off=(2, 4)), count=12)
    >>> class Floor:
    ...     name = "floor"
    ...     def contains(self, points):
    ...         return points[:, 2] < 0
    >>> kept, _ = filter_candidates(result, mesh, keep_out=[Floor()])
    >>> len(result), len(kept)
    (12, 6)
    """

    @property
    def name(self) -> str:
        """Name in the report."""
        ...

    def contains(self, points: FloatArray) -> BoolArray:
        """(N,) True for each of (N, 3) points in the volume or on its border."""
        ...


@dataclass(frozen=True)
class KeepOutBox:
    """Box along the axes from corner `low` to corner `high`, (3,) metres, without cameras.

    ConfigError for corners that are not low <= high.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import KeepOutBox
    >>> import numpy as np
    >>> press = KeepOutBox((0, 0, 0), (1, 1, 2), "press")
    >>> press.contains(np.array([(0.5, 0.5, 1.0), (2.0, 0.5, 1.0)])).tolist()
    [True, False]
    """

    low: Annotated[tuple[float, float, float], Doc("Lowest corner of a box, m.")]
    high: Annotated[tuple[float, float, float], Doc("Highest corner of a box, m.")]
    name: str = "box"

    def __post_init__(self) -> None:
        check_fields(self)
        low, high = (np.asarray(end, np.float64) for end in (self.low, self.high))
        if low.shape != (3,) or high.shape != (3,) or not np.all(low <= high):
            raise ConfigError(
                f"expected corners low <= high of a keep-out box, got {shown(self.low)} and "
                f"{shown(self.high)}; swap them"
            )

    def contains(self, points: FloatArray) -> BoolArray:
        """(N,) True for each of (N, 3) points in the volume or on its border."""
        low, high = np.asarray(self.low), np.asarray(self.high)
        beyond: FloatArray = np.maximum(low - points, points - high)
        return beyond.max(axis=1) <= 0

    def meets(self, starts: FloatArray, ends: FloatArray) -> BoolArray:
        """(N,) True for each segment, between (N, 3) starts and ends, that meets the volume."""
        low, high, way = np.asarray(self.low), np.asarray(self.high), ends - starts
        is_along = way == 0
        step = np.where(is_along, 1.0, way)
        sides = np.sort(((low - starts) / step, (high - starts) / step), axis=0)
        apart = is_along & ((starts < low) | (starts > high))
        sides[:, is_along] = [[-np.inf], [np.inf]]
        sides[:, apart] = [[np.inf], [-np.inf]]
        return np.asarray(sides[0].max(axis=1, initial=0.0) <= sides[1].min(axis=1, initial=1.0))


@dataclass(frozen=True)
class KeepOutSphere:
    """Ball about `centre`, (3,) metres, of `radius` metres, without cameras.

    ConfigError for a radius of 0 or less.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import KeepOutSphere
    >>> import numpy as np
    >>> bulb = KeepOutSphere((0, 0, 0), 0.5, "bulb")
    >>> bulb.contains(np.array([(0.1, 0.0, 0.0), (1.0, 0.0, 0.0)])).tolist()
    [True, False]
    """

    centre: Annotated[tuple[float, float, float], Doc("Centre of a sphere, m.")]
    radius: Annotated[float, Gt(0), Doc("Radius of a sphere, m.")]
    name: str = "sphere"

    def __post_init__(self) -> None:
        check_fields(self)
        centre = np.asarray(self.centre, np.float64)
        if centre.shape != (3,) or not np.isfinite(centre).all() or not self.radius > 0:
            raise ConfigError(
                "expected a centre and a radius above 0 of a keep-out sphere, got "
                f"{shown(self.centre)} and {self.radius}; give metres"
            )

    def contains(self, points: FloatArray) -> BoolArray:
        """(N,) True for each of (N, 3) points in the volume or on its border."""
        with np.errstate(over="ignore"):  # inf: the sphere contains all points
            reach = np.float64(self.radius) ** 2
        return ((points - self.centre) ** 2).sum(axis=1) <= reach

    def meets(self, starts: FloatArray, ends: FloatArray) -> BoolArray:
        """(N,) True for each segment, between (N, 3) starts and ends, that meets the volume."""
        way = ends - starts
        square = np.maximum(dots(way, way), TINY)
        share = np.clip(dots(self.centre - starts, way) / square, 0, 1)
        return self.contains(starts + share[:, None] * way)


class Place(IntEnum):
    """Constraint that a position violates; if there are several, the one with the highest number.

    TOO_FAR and TOO_NEAR are by the stand-off from the evaluated faces, TOO_NEAR also by the
    clearance from any surface; KEPT_OUT is in a keep-out volume, IN_SOLID within a body or beyond
    the walls of a room, and OUTSIDE in none of the boxes of a `PoseSpace`.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import Place, Framing, KeepOutBox, filter_candidates, on_sphere
    >>> mesh, camera = rc.shapes.box(), rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> points = on_sphere(mesh, camera, Framing(stand_off=(2, 4)), count=12)
    >>> table = KeepOutBox((-9, -9, -9), (9, 9, 0), "table")
    >>> places = filter_candidates(points, mesh, keep_out=[table])[1]
    >>> [Place(each).name for each in places[-2:]]
    ['KEPT_OUT', 'KEPT_OUT']
    """

    ALLOWED = 0
    TOO_FAR = 1
    """Farther from the evaluated faces than the greatest stand-off."""
    TOO_NEAR = 2
    """Nearer to the evaluated faces than the least stand-off, or to any surface than the
    clearance."""
    KEPT_OUT = 3
    """In a keep-out volume."""
    IN_SOLID = 4
    """Within a body, or beyond the walls of a room."""
    OUTSIDE = 5
    """In none of the boxes of a `PoseSpace`."""


@typed
def filter_candidates(
    candidates: Candidates,
    mesh: Mesh,
    clearance: float = 0.0,
    keep_out: Sequence[KeepOut] = (),
) -> tuple[Candidates, ByteArray]:
    """Candidates at positions where a camera can be mounted, in order, and the `Place` of all.

    Only the camera centre is tested; occlusion is not.

    Parameters
    ----------
    candidates : Candidates
        Candidates of any generators.
    mesh : Mesh
        All its faces are surfaces, including occluders, except those of targets, within which a
        camera may be. Closed and consistently wound components are solid: a point is in solid
        material if the sum of their winding numbers is positive; a component that faces inward
        contributes -1. If such a component contains the whole mesh, it is a room, and everything
        outside it is solid, too. So a cavity in a part is air, and the inside of a room is air
        except for crates in it. Open components enclose the points from which most of 32
        directions first meet the back of one of their faces; those of two-sided groups do not.
    clearance : float
        Minimum distance to any surface, metres; 0 or more.
    keep_out : sequence of KeepOut
        Volumes without cameras: `KeepOutBox`, `KeepOutSphere`, or any object with a name and
        `contains`.

    Returns
    -------
    candidates : Candidates
        The kept candidates.
    place : (C,) uint8
        `Place` of each candidate before filtering.

    Raises
    ------
    ConfigError
        For a clearance that is negative or not finite.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import Framing, KeepOutBox, filter_candidates, on_sphere
    >>> mesh, camera = rc.shapes.box(), rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> points = on_sphere(mesh, camera, Framing(stand_off=(2, 4)), count=12)
    >>> table = KeepOutBox((-9, -9, -9), (9, 9, 0), "table")
    >>> kept, places = filter_candidates(points, mesh, clearance=0.1, keep_out=[table])
    >>> len(kept), len(places)
    (6, 12)
    """
    check_clearance(clearance)
    eyes = np.ascontiguousarray(candidates.poses[:, :3, 3])
    surface = nearest_obstacle(mesh) if clearance > 0 and len(eyes) else None
    place = place_of(mesh, eyes, surface, clearance, keep_out)
    return candidates.take(place == Place.ALLOWED), place


def place_of(
    mesh: Mesh | None,
    eyes: FloatArray,
    surface: "NearestSurface | None",
    clearance: float,
    keep_out: Sequence[KeepOut],
) -> ByteArray:
    """(N,) `Place` of (N, 3) camera centres, without stand-off and boxes; see `filter_candidates`.

    `surface` is that of `nearest_obstacle`, for a clearance. Without a mesh nothing is solid.
    """
    place = np.full(len(eyes), Place.ALLOWED, np.uint8)
    if clearance > 0 and surface is not None:
        place[surface.query(eyes).distance < clearance] = Place.TOO_NEAR
    for volume in keep_out:
        place[volume.contains(eyes)] = Place.KEPT_OUT
    if mesh is not None:
        place[in_solid(mesh, eyes)] = Place.IN_SOLID
    return place


@frozen_record
class NearestPoints:
    """Nearest points of a surface: (N,) `distance` in metres, (N,) `face`, (N, 3) `point`."""

    distance: FloatArray
    face: IntArray
    point: FloatArray


class NearestSurface:
    """Search for nearest points of a surface, a few microseconds per query.

    Parameters
    ----------
    mesh : Mesh
        The surface; faces without area are left out.
    faces : (F,) bool, optional
        Mask of the faces to search; all by default.

    Raises
    ------
    ConfigError
        If there is no face with an area to search.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import NearestSurface
    >>> nearest = NearestSurface(rc.shapes.box())
    >>> query = nearest.query([(2, 0, 0), (0, 0, 3)])
    >>> query.distance.round(9).tolist(), query.face.tolist()
    ([1.5, 2.5], [2, 10])
    """

    def __init__(self, mesh: Mesh, faces: BoolArray | None = None) -> None:
        chosen = ~mesh.degenerate_mask if faces is None else ~mesh.degenerate_mask & faces
        self._rows = np.flatnonzero(chosen)
        if not len(self._rows):
            raise ConfigError(
                "expected a face with an area to be near to, got none; choose other faces"
            )
        self._centre = mesh.centre
        self._tree = TriangleTree.over(mesh.vertices - self._centre, mesh.faces[self._rows])

    def query(self, points: ArrayLike) -> NearestPoints:
        """Nearest point of the surface for each of (N, 3) finite points, metres.

        The result has `distance`, (N,) metres, `face`, (N,), and `point`, (N, 3).
        """
        wanted = np.ascontiguousarray(np.asarray(points, np.float64).reshape(-1, 3) - self._centre)
        distance, row, where = self._tree.nearest(wanted)
        return NearestPoints(distance, self._rows[row], where + self._centre)


def nearest_obstacle(mesh: Mesh) -> NearestSurface | None:
    """Search among all faces but those of targets; None for a mesh of targets only."""
    if not mesh.has_targets:
        return NearestSurface(mesh)
    return None if mesh.target_mask.all() else NearestSurface(mesh, ~mesh.target_mask)


def check_clearance(clearance: float) -> None:
    """Raise ConfigError for a clearance that is negative or not finite."""
    if not finite_number(clearance) >= 0:
        raise ConfigError(f"expected clearance of 0 m or more, got {shown(clearance)}; give metres")


STEPS = 2
"""Steps of the grid in the free distance: between free places a step apart nothing is."""
SAFETY = 1.0 / np.sqrt(1 - 1 / (2 * STEPS) ** 2)
"""Free distance in half widths of an opening, from which on no step leads through the opening."""
REACH = 7
"""Steps from a corner of a room to the nearest free place, sqrt(3) (STEPS + 1) + 1 or more."""
BEYOND = STEPS + 2
"""Steps from the last free place to the walls, along an axis, with one to spare for corners."""
MARGIN = 6
"""Steps by which the grid is larger than the mesh."""
SQUARES = 10
"""Squares of an outline in the width of an opening."""
MOST_PLACES = 4_000_000
"""Places of a grid."""
NOT_IN_ROOM = "expected faces in the room and within the distance, got none; increase the distance"
MOST_SPACES = 40
"""Spaces that an error lists."""


@frozen_record
class Room:
    """A room of a building; make it with `Room.at`, `Room.of_polygon` or `Room.of_solid`.

    Attributes
    ----------
    name : str
        Name, which candidates of `in_room` have in their source.
    middle : (3,) float64
        Point in the room, metres; the default aim of its cameras.
    bounds : (2, 3) float64
        Lowest and highest corner of a box that holds the room, metres.
    contains : callable
        Function of (N, 3) points, metres: (N,) True for each that is in the room.
    outline : callable
        Function of a height z, metres: horizontal section of the room there, as shapely polygons.

    Examples
    --------
    >>> import numpy as np
    >>> import rastercov as rc
    >>> from rastercov.placement import Room
    >>> hall = Room.of_polygon([(0, 0), (4, 0), (4, 3), (0, 3)], z=(0, 2.5))
    >>> hall.contains(np.array([(1.0, 1.0, 1.0), (5.0, 1.0, 1.0)])).tolist()
    [True, False]
    """

    name: str
    middle: FloatArray
    bounds: FloatArray
    contains: Callable[[FloatArray], BoolArray]
    outline: Callable[[float], Any]

    @classmethod
    @typed
    def at(cls, mesh: Mesh, inside: ArrayLike, opening: float = 1.0, name: str = "room") -> "Room":
        """Space that a point reaches without crossing the mesh, through no narrow opening.

        A position belongs to the room if the nearest free place in sight is reached from the point,
        so that the border between two rooms is in their door. Targets are no surfaces.

        Parameters
        ----------
        mesh : Mesh
            The building.
        inside : (3,) array_like
            The point, metres.
        opening : float
            Width up to which openings, such as doors and windows, count as closed, metres.
        name : str
            Name of the room.

        Raises
        ------
        ConfigError
            If a wider opening leads out of the mesh, the room is narrower than the opening, or the
            grid of places, whose step is about a quarter of the opening, has more than 4,000,000.
        """
        point = finite_points("inside", inside, (3,), "three finite numbers")
        if not 0 < opening < np.inf:
            raise ConfigError(f"expected opening above 0 m, got {opening}; give metres")
        space = _Space(mesh.opaque, opening, point)
        return cls(name, point, space.bounds, space.contains, space.outline)

    @classmethod
    @typed
    def of_polygon(cls, polygon: ArrayLike, z: tuple[float, float], name: str = "room") -> "Room":
        """Prism above a polygon.

        Parameters
        ----------
        polygon : (N, 2) array_like
            Corners in order, metres; the outline must not cross itself.
        z : (float, float)
            Lowest and highest z, metres.
        name : str
            Name of the room.

        Raises
        ------
        ConfigError
            For corners that make no polygon, or heights that are not ascending.
        """
        import shapely

        corners = finite_points("polygon", polygon, (-1, 2), "finite corners, (N, 2)")
        low, high = finite_points("z", z, (2,), "two finite numbers")
        shape = shapely.Polygon(corners if len(corners) > 2 else None)
        if not low < high or not shape.area > 0 or not shape.is_valid:
            raise ConfigError(
                "expected 3 corners or more in order and z = [lowest, highest], got "
                f"{len(corners)} corners and z = [{low:g}, {high:g}]; remove crossings"
            )

        def contains(points: FloatArray) -> BoolArray:
            x, y, height = points.T
            return np.asarray(shapely.contains_xy(shape, x, y) & (low <= height) & (height <= high))

        def outline(height: float) -> Any:
            return shape if low <= height <= high else shapely.Polygon()

        bounds = np.column_stack((np.reshape(shape.bounds, (2, 2)), (low, high)))
        return cls(name, _middle(shape, (low + high) / 2), bounds, contains, outline)

    @classmethod
    @typed
    def of_solid(cls, solid: Mesh, name: str = "room") -> "Room":
        """Inside of a closed mesh, such as one of `Mesh.load(path).spaces`.

        Raises
        ------
        ConfigError
            For a mesh that is not closed, or not wound outward.
        """
        from rastercov.core.mesh import sections

        if not solid.is_closed_outward:
            raise ConfigError(
                "expected a watertight solid with outward normals, got "
                f"{plural(solid.n_faces, 'other face')}; give inside, or a polygon and z"
            )
        low, high = bounds = solid.bounds
        size = norm(high - low)
        tree = TriangleTree.over((solid.vertices - low) / size, solid.welded_faces)

        def contains(points: FloatArray) -> BoolArray:
            return np.asarray(tree.winding_numbers((points - low) / size) > 0)

        def outline(height: float) -> Any:
            return sections.solid(sections.section(solid.vertices, solid.welded_faces, height))

        middle, levels = (low[2] + high[2]) / 2, np.unique(solid.vertices[:, 2])
        heights = np.append((levels[1:] + levels[:-1]) / 2, middle)
        heights = heights[sort_order(np.abs(heights - middle))]
        # The solid may have a gap at half height, but its volume is at one of these.
        items = ((outline(height), height) for height in heights.tolist())
        place = next(each for each in items if not each[0].is_empty)
        return cls(name, _middle(*place), bounds, contains, outline)


def _middle(outline: Any, height: float) -> FloatArray:
    """Point in the middle of an outline, or in it where that is outside."""
    middle = outline.centroid
    within = middle if outline.contains(middle) else outline.representative_point()
    return np.array([within.x, within.y, height])


def space_of_name(spaces: Sequence[tuple[Product, Mesh]], name: str) -> Mesh:
    """Solid of the space of a name; ConfigError where there is none, or there are several."""
    called = [space for space in spaces if space[0].is_called(name)]
    if len(called) != 1:
        words = [own.label + f" ({own.global_id})" * len(called[:1]) for own, _ in called or spaces]
        words[MOST_SPACES:] = ["..."] if len(words) > MOST_SPACES else []
        raise ConfigError(
            f"expected one space called {quote(name)}, got {len(called) or 'none'}; spaces are "
            f"{', '.join(words) or 'in IFC files, and none is in the meshes'}"
        )
    return called[0][1]


class _Space:
    """Grid of free places around a mesh, and those of them that a point reaches."""

    def __init__(self, mesh: Mesh, opening: float, inside: FloatArray) -> None:
        free = opening / 2 * SAFETY
        self.step, self.square = free / STEPS, opening / SQUARES
        self.low, self.centre = mesh.bounds[0] - MARGIN * self.step, mesh.centre
        extent = np.ptp(mesh.bounds, axis=0)
        shape = np.ceil(extent / self.step) + 2 * MARGIN
        if not np.prod(shape) <= MOST_PLACES:
            raise ConfigError(
                f"inside: expected at most {MOST_PLACES:,} grid cells, got more for "
                f"{mesh.size_in_words} with an opening of {opening:g} m; increase it, or give a "
                "polygon"
            )
        self.shape, self.size = tuple(shape.astype(np.int64).tolist()), norm(extent)
        places = self._position(np.arange(int(np.prod(shape))))
        self.is_free = NearestSurface(mesh).query(places).distance >= free
        rows = mesh.faces[~mesh.degenerate_mask]
        self.tree = TriangleTree.over((mesh.vertices - self.centre) / self.size, rows)
        ways = np.indices((2 * REACH + 1,) * 3).reshape(3, -1).T - REACH
        ways = ways[norm(ways) <= REACH]
        self.ways = ways[sort_order(dots(ways, ways))]
        start = self._place_near(inside[None])
        self.is_room = self._flood(start[start >= 0])
        reached = np.append(self._position(np.flatnonzero(self.is_room)), inside[None], axis=0)
        self.bounds = np.stack((reached.min(axis=0), reached.max(axis=0)))
        is_open = (np.abs(self.bounds - self.centre) > extent / 2 + free).any()
        if is_open or start[0] < 0:
            fault = "a wider opening leads outside" if is_open else "it is narrower"
            raise ConfigError(
                f"inside: expected a room with openings up to {opening:g} m, got none at "
                f"{np.round(inside, 3).tolist()}: {fault}; change either, or give a polygon"
            )
        self.bounds += np.array([[-BEYOND], [BEYOND]]) * self.step

    def contains(self, points: FloatArray) -> BoolArray:
        """(N,) True for each of (N, 3) points whose nearest free place in sight is of the room."""
        place = self._place_near(points)
        return np.logical_and(place >= 0, self.is_room[place])

    def outline(self, height: float) -> Any:
        """Squares at a height whose middle is in the room, as polygons."""
        import shapely

        low, count = self.bounds[0, :2], np.ceil(np.ptp(self.bounds[:, :2], axis=0) / self.square)
        corner = np.indices(count.astype(np.int64)).reshape(2, -1).T
        xy = low + (corner + 0.5) * self.square
        corner = corner[self.contains(np.insert(xy, 2, height, axis=1))]
        # Of whole numbers, so that neighbours have the same corners, bit for bit.
        whole = shapely.union_all(shapely.box(*corner.T, *(corner + 1).T))
        return shapely.transform(whole.simplify(0.0), lambda at: low + at * self.square)

    def _position(self, place: IntArray) -> FloatArray:
        """(N, 3) positions of places of the grid."""
        return self.low + np.stack(np.unravel_index(place, self.shape), 1) * self.step

    def _place_near(self, points: FloatArray) -> IntArray:
        """(N,) nearest free place in sight of each of (N, 3) points, -1 for none near it."""
        place_near, left = np.full(len(points), -1), np.arange(len(points))
        base = np.rint((points - self.low) / self.step).astype(np.int64)
        for way in self.ways:  # nearest first: a few for most points
            cell = base[left] + way
            in_grid = ((cell >= 0) & (cell < self.shape)).all(axis=1)
            place = np.ravel_multi_index(tuple(cell.T), self.shape, mode="clip")
            rows = np.flatnonzero(in_grid & self.is_free[place])
            rows = rows[self._is_in_sight(points[left[rows]], self._position(place[rows]))]
            place_near[left[rows]] = place[rows]
            left = np.delete(left, rows)
            if not len(left):
                break
        return place_near

    def _is_in_sight(self, points: FloatArray, places: FloatArray) -> BoolArray:
        """(N,) True where nothing crosses the way from a point to a place."""
        way = (places - points) / self.size
        length = norm(way)
        unit = way / np.maximum(length, TINY)[:, None]
        starts = (points - self.centre) / self.size
        return self.tree.first_hits(starts, unit, length, np.full(len(way), -1)) < 0

    def _flood(self, front: IntArray) -> BoolArray:
        """Free places that are reached from some, step by step along the axes, up to the border."""
        border = np.ones(self.shape, bool)
        border[1:-1, 1:-1, 1:-1] = False
        reached = border.flatten()
        across = self.shape[1] * self.shape[2], self.shape[2], 1
        while len(front):
            reached[front] = True
            near = (front[:, None] + np.array([*across, *(-step for step in across)])).ravel()
            front = np.unique(near[self.is_free[near] & ~reached[near]])
        return np.logical_and(reached, ~border.ravel())


def around_faces(mesh: Mesh, groups: Sequence[str], distance: float) -> Any:
    """Area within a horizontal distance of the faces of some groups, m, as polygons of shapely."""
    import shapely

    faces = mesh.faces[faces_of_groups(mesh, groups)]
    shapes = shapely.convex_hull(shapely.multipoints(mesh.vertices[faces, :2]))
    return shapely.buffer(shapely.union_all(shapes), distance, quad_segs=8)


def between_heights(sheet: Mesh, low: float, high: float) -> Mesh:
    """Faces of a sheet whose middle is between two heights, m, as those of a storey."""
    height = sheet.vertices[sheet.faces, 2].mean(axis=1)
    faces = sheet.faces[(low <= height) & (height <= high)]
    if not len(faces):
        raise MeshError(NOT_IN_ROOM)
    used, faces = np.unique(faces, return_inverse=True)
    return Mesh(sheet.vertices[used], faces.reshape(-1, 3), notes=sheet.notes)


def clip_sheet(sheet: Mesh, outlines: Iterable[Any]) -> Mesh:
    """Part of a surface that faces up, within all of some outlines; MeshError for none."""
    import shapely

    corners = sheet.vertices[sheet.faces]
    pieces = shapely.polygons(corners[..., :2])
    for outline in outlines:
        pieces = shapely.intersection(pieces, outline)
    parts, of = shapely.get_parts(shapely.constrained_delaunay_triangles(pieces), return_index=True)
    if not len(parts):
        raise MeshError(NOT_IN_ROOM)
    xy = shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, 2::-1]  # counter-clockwise
    normal, origin = sheet.normals[of], corners[of, 0]
    slope = dots(xy - origin[:, None, :2], normal[:, None, :2]) / normal[:, 2:]
    vertices = np.dstack((xy, origin[:, 2:] - slope)).reshape(-1, 3)
    return Mesh(vertices, np.arange(len(vertices)).reshape(-1, 3), notes=sheet.notes)


def wrong_side(rooms: Sequence[Room], eyes: FloatArray) -> list[str]:
    """A line on (P, 3) camera centres that are in none of the rooms, metres; often none."""
    if not rooms:
        return []
    is_in = np.any([room.contains(eyes) for room in rooms], axis=0)
    of = ", ".join(room.name for room in rooms)
    return name_places(f"outside of the rooms ({of}) or behind a wall", eyes, ~is_in)
