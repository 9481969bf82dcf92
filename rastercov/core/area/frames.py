"""Plane coordinates of each face: a fixed frame, and the way to and from space.

The origin of a face's frame is the corner at the start of its longest edge (the first of equals),
x runs along that edge, and y to the third corner, so that the face is the triangle (0, 0), (L, 0),
(x, y) with 0 <= x <= L and y > 0, counter-clockwise seen from the front. x cross y is the normal.
"""

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    BoolArray,
    FloatArray,
    InOneLine,
    Int32Array,
    IntArray,
    dots,
    frozen_record,
    matmul,
    norm,
    once_each,
    read_only,
)
from rastercov.core.area.polygons import boxes
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.arrays import frozen
from rastercov.core.mesh.bodies import Moved
from rastercov.engine import area_frames, area_point, mesh_bodies

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
    def _lookup(self) -> tuple[IntArray, IntArray, FloatArray, IntArray, FloatArray]:
        """Rows in the order of their faces, the first of each face, corners, starts and boxes."""
        order = np.argsort(self.face, kind="stable")
        of_face = np.searchsorted(self.face[order], np.arange(self.mesh.n_faces + 1))
        return (
            read_only(order, np.int64),
            read_only(of_face, np.int64),
            read_only(self.xy, np.float64),
            read_only(self.starts, np.int64),
            read_only(boxes(self.xy, self.starts), np.float64),
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
    is_inside = np.zeros((len(faces), n_rows), np.bool_)
    area_point.find_covering(
        read_only(to_plane(mesh, faces, points), np.float64),
        read_only(faces, np.int32),
        polygons._lookup,
        read_only(row, np.int32),
        SLACK_REL * mesh.diagonal,
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
