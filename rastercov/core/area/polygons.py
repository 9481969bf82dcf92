"""Tables of polygons in planes, points that fill an area evenly, and quantiles by area.

Polygon i of a table has the corners xy[starts[i]] ... xy[starts[i + 1] - 1], counter-clockwise.

Also the partition of faces by the number, or the set, of cameras whose pieces cover each part. A
face here is any polygon with pieces of its own: a face of a mesh, or a face for each of several
groups of cameras, whose counts do not mix. `rastercov/engine/solver/union.hpp` has the memory.

Plane coordinates of each face: a fixed frame, and the way to and from space.

The origin of a face's frame is the corner at the start of its longest edge (the first of equals),
x runs along that edge, and y to the third corner, so that the face is the triangle (0, 0), (L, 0),
(x, y) with 0 <= x <= L and y > 0, counter-clockwise seen from the front. x cross y is the normal.
"""

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base import (
    BoolArray,
    ConfigError,
    FloatArray,
    InOneLine,
    Int32Array,
    IntArray,
    check_memory,
    dots,
    finite_number,
    frozen_record,
    matmul,
    norm,
    offsets_of,
    once_each,
    owners_of,
    read_only,
    shown,
    sort_order,
)
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.arrays import frozen
from rastercov.core.mesh.bodies import Moved
from rastercov.engine import area_frames, area_point, mesh_bodies, solver_union
from rastercov.shards import Progress as Progress

FLOOR_REL = 1e-15
"""Least distance of two corners that do not coincide, relative to the diagonal of the mesh."""
MOST_VIEWS = 10_000
"""Cameras up to which they may be counted."""
MOST_PIECES = solver_union.MOST_PIECES
"""Pieces of a part of a face up to which each is compared with all others."""
ALL_TOGETHER = solver_union.ALL_TOGETHER
"""Cameras that are added at once, where all are."""


def choose_polygons(
    xy: FloatArray, starts: IntArray, rows: IntArray
) -> tuple[FloatArray, IntArray]:
    """Corners and starts of some of the polygons, in this order."""
    counts = np.diff(starts)[rows]
    ends = offsets_of(counts)
    corners = np.repeat(starts[rows] - ends[:-1], counts) + np.arange(ends[-1])
    return xy[corners], ends


def following(starts: IntArray) -> IntArray:
    """(C,) the corner after each corner."""
    after = np.arange(1, starts[-1] + 1)
    after[starts[1:] - 1] = starts[:-1]
    return after


def _triangles(xy: FloatArray, starts: IntArray) -> tuple[FloatArray, FloatArray]:
    """Sums of two corners, and twice the area, of the triangle of each side and the first corner.

    Corners are relative to the first.
    """
    away = xy - xy[np.repeat(starts[:-1], np.diff(starts))]
    after = away[following(starts)] if len(xy) else away
    return away + after, away[:, 0] * after[:, 1] - away[:, 1] * after[:, 0]


def polygon_areas(xy: FloatArray, starts: IntArray) -> FloatArray:
    """(N,) areas."""
    twice = _triangles(xy, starts)[1]
    return np.add.reduceat(twice, starts[:-1]) / 2 if len(starts) > 1 else np.zeros(0)


def centroids(xy: FloatArray, starts: IntArray, areas: FloatArray) -> FloatArray:
    """(N, 2) centroids of polygons of areas (N,) > 0."""
    if len(starts) < 2:
        return np.zeros((0, 2))
    sums, twice = _triangles(xy, starts)
    moments = np.add.reduceat(sums * twice[:, None] / 6, starts[:-1])
    return xy[starts[:-1]] + moments / areas[:, None]


def fans(starts: IntArray) -> tuple[IntArray, IntArray]:
    """(T, 3) corners of the triangles that convex polygons are fans of, (T,) polygon of each."""
    counts = np.maximum(np.diff(starts) - 2, 0)
    ends, polygon = offsets_of(counts), owners_of(counts)
    first, side = starts[polygon], np.arange(ends[-1]) - ends[polygon] + 1
    return np.stack((first, first + side, first + side + 1), axis=1), polygon


def quantile(values: FloatArray, weights: FloatArray, mask: BoolArray, share: float = 0.5) -> float:
    """Value below which a share of the weight is, the median unless given; 0 for nothing."""
    chosen = np.flatnonzero(mask & (weights > 0))
    if not len(chosen):
        return 0.0
    order = chosen[sort_order(values[chosen])]
    below = np.cumsum(weights[order])
    return float(values[order[np.searchsorted(below, share * below[-1])]])


def even_points(n: int) -> tuple[FloatArray, FloatArray]:
    """Coordinates x, y >= 0, x + y <= 1 of n points, evenly over the triangle.

    M. Roberts. The Unreasonable Effectiveness of Quasirandom Sequences. 2018 (R2).
    """
    k: FloatArray = np.arange(1.0, n + 1.0)
    x, y = k * 0.7548776662466927 % 1, k * 0.5698402909980532 % 1
    over = x + y > 1
    x[over], y[over] = 1 - x[over], 1 - y[over]
    return x, y


def points_on(mesh: Mesh, face: IntArray) -> FloatArray:
    """(N, 3) points on faces, (N,), by `even_points`."""
    x, y = even_points(len(face))
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces[face]], 1, 0)
    return np.asarray(a + x[:, None] * (b - a) + y[:, None] * (c - a))


def spread_faces(areas: FloatArray, n: int) -> IntArray:
    """Faces, (n,), of points evenly over some areas, (F,)."""
    below = np.cumsum(areas)
    return np.searchsorted(below, (np.arange(n) + 0.5) / n * below[-1])


def clip_polygons(
    xy: FloatArray, starts: IntArray, values: FloatArray
) -> tuple[FloatArray, IntArray, IntArray]:
    """Parts of convex polygons where an affine function, by its (C,) values at corners, is >= 0.

    Returns
    -------
    xy, starts : (D, 2) float64, (M + 1,) int64
        Parts with three corners or more.
    rows : (M,) int64
        Polygon of each.
    """
    n, after = len(starts) - 1, following(starts) if len(xy) else np.zeros(0, np.int64)
    is_kept, other = values >= 0, values[after]
    is_crossed = ((values > 0) & (other < 0)) | ((values < 0) & (other > 0))
    share = np.where(is_crossed, values / np.where(is_crossed, values - other, 1.0), 0.0)
    # Each corner that is kept, then where the side behind it is crossed.
    both = np.stack([xy, xy + share[:, None] * (xy[after] - xy)], axis=1).reshape(-1, 2)
    mask = np.stack([is_kept, is_crossed], axis=1)
    counts = np.bincount(owners_of(np.diff(starts)), mask.sum(axis=1), n)
    result, ends = both[mask.ravel()], offsets_of(counts.astype(np.int64))
    rows = np.flatnonzero(counts >= 3)
    return (*choose_polygons(result, ends, rows), rows)


MOST_CORNERS = 20
"""Corners of a piece of regions."""


def with_few_corners(xy: FloatArray, starts: IntArray) -> tuple[FloatArray, IntArray, IntArray]:
    """Convex polygons in parts of `MOST_CORNERS` corners at most, and the polygon of each part."""
    parts: list[IntArray] = []
    counts = np.diff(starts)
    if counts.max(initial=0) <= MOST_CORNERS:
        return xy, starts, np.arange(len(counts))
    for first, count in zip(
        starts[:-1].tolist(), counts.tolist(), strict=True
    ):  # 1 us each, seldom
        if count <= MOST_CORNERS:
            parts.append(np.arange(first, first + count))
            continue
        for at in range(1, count - 1, MOST_CORNERS - 2):
            own = np.arange(at, min(at + MOST_CORNERS - 1, count))
            parts.append(first + np.append(0, own))
    corners = np.concatenate([*parts, np.zeros(0, np.int64)])
    ends = offsets_of([len(each) for each in parts])
    polygon = np.searchsorted(starts, corners[ends[:-1]], side="right") - 1
    return xy[corners], ends, polygon


class Partition(NamedTuple):
    """Convex polygons in the planes of faces, by face.

    Attributes
    ----------
    xy, starts : (C, 2) float64, (N + 1,) int64
    face : (N,) int32
    tag : (N,) int64
        Number of cameras, up to k, or the set of cameras as bits.
    area : (N,) float64
        m^2.
    """

    xy: FloatArray
    starts: IntArray
    face: Int32Array
    tag: IntArray
    area: FloatArray


DIVIDES, DIVIDES_FIRST = 64, 128
"""Of numbers of cameras that add nothing: they divide what is there, or what no other divided."""
PLACE = 256
"""Of their numbers, times the place among them, which is that of the first in a set."""
FIRST_AT = 48
"""Bit of a set from which on it has this place, and bits of cameras below."""


class Overlay:
    """Partition of N faces by the number of cameras, to which pieces are added; or by their sets.

    A face that k cameras cover as a whole is closed: it is one piece from then on, and costs
    nothing more, however many pieces follow.

    Parameters
    ----------
    corners, areas : (N, 3, 2), (N,) float64
        Faces in their frames, and their areas.
    diagonal : float
        Of the mesh, metres.
    views : int, optional
        k: cameras up to which they are counted. Unless given, tags are sets of up to 64 cameras as
        bits, and nothing is closed.
    together : int
        Cameras, by their numbers, that are added at once.
    """

    def __init__(
        self,
        corners: FloatArray,
        areas: FloatArray,
        diagonal: float,
        views: int | None = None,
        together: int = ALL_TOGETHER,
    ) -> None:
        number = 1.0 if views is None else finite_number(views)
        if not number.is_integer() or not 1 <= number <= MOST_VIEWS:
            raise ConfigError(
                f"expected views from 1 to {MOST_VIEWS}, got {shown(views)}; give a whole number"
            )
        self._n = len(areas)
        check_memory(
            f"areas of {int(number)} numbers of views x {self._n:,} faces",
            8 * int(number) * self._n,
            "count fewer views",
        )
        faces = np.ascontiguousarray(corners), np.ascontiguousarray(areas)
        counted = 0 if views is None else int(number)
        least = FLOOR_REL * diagonal
        self.united = solver_union.Union(faces, least, counted, MOST_PIECES, together)

    @property
    def closed(self) -> BoolArray:
        """(N,) faces that k cameras cover as a whole."""
        mask = np.empty(self._n, bool)
        self.united.write_closed(mask)
        return mask

    @property
    def bounds(self) -> FloatArray:
        """(2, N) bound and excess of each area, m^2, as of `Regions`."""
        result = np.empty((2, self._n))
        self.united.write_bounds(result)
        return result

    def begin(self, pieces: tuple[ArrayLike, ...], bound: FloatArray, excess: FloatArray) -> None:
        """Begin with a partition: corners, starts, face and cameras of pieces; and its bounds."""
        given: Any = _arrays(pieces, (np.float64, np.int64, np.int32, np.int64))
        xy, starts, face, tags = given
        self.united.begin((xy, starts, face, np.zeros_like(face)), tags, bound, excess)

    def add(
        self,
        pieces: tuple[ArrayLike, ...],
        pairs: tuple[ArrayLike, ...],
        number: IntArray | None = None,
        progress: Progress | None = None,
    ) -> None:
        """Take in pieces of cameras: corners, starts, face and camera, in the order of cameras.

        `pairs` are camera, face, area, bound and excess of each pair of them with a piece or a
        bound, ordered by camera, then by face; `number` is the bit of each camera, for sets, and
        where they add no piece `DIVIDES` or `DIVIDES_FIRST` and their `PLACE` more.
        """
        of_pieces: Any = _arrays(pieces, (np.float64, np.int64, np.int32, np.int32))
        types = np.int32, np.int32, np.float64, np.float64, np.float64
        of_pairs: Any = _arrays(pairs, types)
        bits = np.empty(0, np.int64) if number is None else number
        self.united.add(of_pieces, of_pairs, bits, progress)

    def partition(self) -> Partition:
        """Pieces so far."""
        n, corners = self.united.size()
        partition = Partition(
            np.empty((corners, 2)),
            np.empty(n + 1, np.int64),
            np.empty(n, np.int32),
            np.empty(n, np.int64),
            np.empty(n),
        )
        self.united.write(*partition)
        return partition

    def areas(self, views: int) -> FloatArray:
        """(views, N) area that at least 1 ... views cameras cover, m^2."""
        result = np.empty((views, self._n))
        self.united.write_areas(result)
        return result


def _arrays(
    given: tuple[ArrayLike, ...], types: tuple[type, ...]
) -> tuple[NDArray[np.generic], ...]:
    return tuple(map(np.ascontiguousarray, given, types))


SLACK_REL = 1e-9
"""Distance outside a piece up to which a point counts as inside, relative to the diagonal: rounding
of points that lie on an outline."""
ROUNDING_REL = 1e-15
"""Rounding of the height of an eye over a plane, relative to their distances from the origin."""


class Frames(NamedTuple):
    """Frames of all faces, read-only; 0 for a face without area.

    Attributes
    ----------
    origin, x_axis, y_axis, normal : (F, 3) float64
        Metres; the axes are unit vectors.
    corners : (F, 3, 2) float64
        The face in its frame, metres, from the corner at the origin.
    areas : (F,) float64
        m^2.
    """

    origin: FloatArray
    x_axis: FloatArray
    y_axis: FloatArray
    normal: FloatArray
    corners: FloatArray
    areas: FloatArray


@once_each
def frames_of(mesh: Mesh) -> Frames:
    """Frames of a mesh, made at the first call.

    Those of a mesh whose bodies are moved are chosen at rest, and moved with them.
    """
    moved = mesh.moved_from
    return _build(mesh) if moved is None else _frames_of(moved)


def _frames_of(moved: Moved) -> Frames:
    rest, poses = moved
    if not len(poses):  # at rest, some bodies of the whole
        return Frames(*(frozen(each[rest.kept]) for each in frames_of(rest.whole)))
    still = frames_of(rest.mesh)
    arrays = np.empty((4, rest.mesh.n_faces, 3))
    mesh_bodies.move_points(still.origin, rest.body, poses, arrays[0], np.empty((2, 3)))
    for axis, out in zip(still[1:4], arrays[1:], strict=True):
        mesh_bodies.turn(axis, rest.body, poses, out)
    arrays[0][still.areas == 0] = 0.0
    origin, *axes = map(frozen, arrays)
    return still._replace(
        origin=origin,
        x_axis=axes[0],
        y_axis=axes[1],
        normal=axes[2],
    )


def to_world(mesh: Mesh, face: ArrayLike, xy: ArrayLike) -> FloatArray:
    """Points in space of plane coordinates.

    Parameters
    ----------
    mesh : Mesh
        Mesh of the faces.
    face : (N,) int array_like
        Face of each point.
    xy : (N, 2) array_like
        Plane coordinates, metres.

    Returns
    -------
    (N, 3) float64
        Metres.
    """
    frames, faces, points = frames_of(mesh), np.asarray(face), np.asarray(xy, np.float64)
    along = points[:, :1] * frames.x_axis[faces] + points[:, 1:] * frames.y_axis[faces]
    return frames.origin[faces] + along


def to_plane(mesh: Mesh, face: ArrayLike, points: ArrayLike) -> FloatArray:
    """Plane coordinates (N, 2) of points in space (N, 3), dropped onto their faces (N,)."""
    frames, faces = frames_of(mesh), np.asarray(face)
    away = np.asarray(points, np.float64) - frames.origin.take(faces, axis=0)
    axes = (axis.take(faces, axis=0) for axis in frames[1:3])
    return np.stack([dots(away, axis) for axis in axes], axis=1)


@frozen_record(repr=False)
class FacePolygons(InOneLine):
    """Convex polygons on the faces of a mesh: N of them, of C corners in all.

    Attributes
    ----------
    xy : (C, 2) float64
        Corners in the plane coordinates of the faces, metres, counter-clockwise from the front.
    starts : (N + 1,) int64
        The corners of piece i are xy[starts[i]] ... xy[starts[i + 1] - 1].
    face : (N,) int32
        Face of each piece.
    """

    mesh: Mesh
    xy: FloatArray
    starts: IntArray
    face: Int32Array

    def __len__(self) -> int:
        return len(self.face)

    def points(self) -> FloatArray:
        """(C, 3) corners in space, metres."""
        return to_world(self.mesh, np.repeat(self.face, np.diff(self.starts)), self.xy)

    @cached_property
    def _lookup(self) -> tuple[IntArray, IntArray, FloatArray, IntArray]:
        """Rows in the order of their faces, the first of each face, corners and starts."""
        order = sort_order(self.face)
        of_face = np.searchsorted(self.face[order], np.arange(self.mesh.n_faces + 1))
        return (
            read_only(order, np.int64),
            read_only(of_face, np.int64),
            read_only(self.xy, np.float64),
            read_only(self.starts, np.int64),
        )


def rows_at(
    polygons: FacePolygons,
    row: Int32Array,
    n_rows: int,
    face: ArrayLike,
    points: ArrayLike,
) -> BoolArray:
    """(N, n_rows) whether points (N, 3) of faces (N,) lie in a polygon of each row.

    `row`, one of each polygon, is below `n_rows`.
    """
    mesh, faces = polygons.mesh, np.asarray(face, np.int64)
    is_inside = np.zeros((len(faces), n_rows), bool)
    area_point.find_covering(
        read_only(to_plane(mesh, faces, points), np.float64),
        read_only(faces, np.int32),
        polygons._lookup,
        read_only(row, np.int32),
        SLACK_REL * mesh.opaque.diagonal,
        is_inside,
    )
    return is_inside


def _build(mesh: Mesh) -> Frames:
    n = mesh.n_faces
    frames = Frames(*(np.zeros((n, *rest)) for rest in ((3,), (3,), (3,), (3,), (3, 2), ())))
    area_frames.build_frames(mesh.vertices, mesh.faces, mesh.degenerate_mask, frames)
    return Frames(*map(frozen, frames))


def sides_of(
    eyes: FloatArray, points: FloatArray, normals: FloatArray
) -> tuple[BoolArray, BoolArray]:
    """(n, N) cameras, by their centres (n, 3), in front of planes of points (N, 3); and behind.

    A camera in a plane, up to rounding, is neither.
    """
    height = matmul(eyes, normals.T) - dots(points, normals)
    size = norm(eyes)[:, None] + norm(points)
    return height > ROUNDING_REL * size, height < -ROUNDING_REL * size


def in_front(eyes: FloatArray, points: FloatArray, normals: FloatArray) -> BoolArray:
    """(n, N) cameras, by their centres (n, 3), in front of the planes of points (N, 3)."""
    height = matmul(eyes, normals.T) - dots(points, normals)
    return height >= 0
