"""Positions where a camera can be mounted: outside solids and keep-out volumes, clear of surfaces.

`filter_candidates` is applied to the output of the candidate generators, before any step that costs
time for each candidate. A tree of boxes finds nearest surfaces and counts the crossings of rays,
which give winding numbers.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Protocol

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
    finite_number,
    frozen_record,
    shown,
)
from rastercov.base.typed import check_fields, typed
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.contacts import TriangleTree
from rastercov.core.mesh.solids import in_solid
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
        square = np.maximum((way**2).sum(axis=1), TINY)
        share = np.clip(((self.centre - starts) * way).sum(axis=1) / square, 0, 1)
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
