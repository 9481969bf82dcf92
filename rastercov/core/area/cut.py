"""Parts of pieces where a smooth criterion holds for certain, and undecided area as a bound.

See `rastercov/engine/area/cut.hpp`.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import AnyArray, FloatArray, Int32Array, IntArray, read_only
from rastercov.core.area.criteria import Cut
from rastercov.core.area.polygons import FacePolygons, frames_of, polygon_areas
from rastercov.core.mesh import Mesh
from rastercov.engine import area_cut

STRIP_REL = 2e-5
"""Mean width of what is not decided, relative to the diagonal of the mesh."""


class CutParts(NamedTuple):
    """Parts of pieces, for `native.area_cut`; `used` has the parts and their corners."""

    xy: FloatArray
    starts: IntArray
    piece: IntArray
    used: IntArray

    @classmethod
    def of_room(cls, n: int, corners: int) -> "CutParts":
        """Memory for n parts."""
        starts, used = np.zeros(n + 1, np.int64), np.zeros(2, np.int64)
        return cls(np.empty((corners, 2)), starts, np.empty(n, np.int64), used)

    def with_more_room(self) -> "CutParts":
        """The same parts, with twice the room."""
        n, corners = self.used.tolist()
        room = self.of_room(2 * len(self.piece) + 64, 2 * len(self.xy) + 512)
        room.xy[:corners], room.starts[: n + 1] = self.xy[:corners], self.starts[: n + 1]
        room.piece[:n], room.used[:] = self.piece[:n], self.used
        return room


class Kept(NamedTuple):
    """Parts of N pieces: corners, starts, piece and area of each; undecided area, (N,), m^2.

    `cut_short` is the part of it of all pieces that is undecided because their cuts ended.
    """

    xy: FloatArray
    starts: IntArray
    piece: IntArray
    area: FloatArray
    undecided: FloatArray
    cut_short: float = 0.0


def parts_where(
    polygons: FacePolygons, row: Int32Array, devices: IntArray | None, cut: Cut
) -> Kept:
    """Parts where a criterion holds; `row` is that of the criterion of each piece, (N,).

    `devices` are those that count on each piece, as bits; all of them unless given.
    """
    mesh, n = polygons.mesh, len(polygons)
    size = mesh.opaque.diagonal
    loop = getattr(area_cut, f"cut_by_{cut.name}")
    of_pieces: Any = (
        read_only(polygons.xy, np.float64),
        read_only(polygons.starts, np.int64),
        read_only(polygons.face, np.int32),
        read_only(row, np.int32),
        read_only(np.full(n, -1) if devices is None else devices, np.int64),
    )
    out, undecided, done = CutParts.of_room(4 * n + 64, 16 * n + 512), np.zeros((n, 2)), 0
    while True:
        done = loop(
            of_pieces,
            _planes(mesh),
            cut.record,
            STRIP_REL * size,
            area_cut.COINCIDENT_REL * size,
            done,
            undecided,
            out,
        )
        if done == n:
            break
        out = out.with_more_room()
    count, corners = out.used.tolist()
    xy, starts = out.xy[:corners].copy(), out.starts[: count + 1].copy()
    areas, cut_short = polygon_areas(xy, starts), float(undecided[:, 1].sum())
    return Kept(xy, starts, out.piece[:count], areas, undecided[:, 0], cut_short)


def values_of(
    mesh: Mesh,
    cut: Cut,
    face: IntArray,
    xy: FloatArray,
    *,
    row: IntArray | int = 0,
    radius: FloatArray | float = 0.0,
) -> FloatArray:
    """(N, 4) value of a criterion at plane coordinates (N, 2) of faces, its slopes, and doubt.

    Within `radius` of a point the value is off what is linear by the doubt at most. `row` is
    as for `parts_where`.
    """
    n, loop = len(face), getattr(area_cut, f"values_of_{cut.name}")

    def column(values: ArrayLike, kind: type[np.generic]) -> AnyArray:
        return read_only(np.broadcast_to(values, n), kind)

    xyr = np.column_stack([xy, np.broadcast_to(radius, n)])
    result = np.empty((n, 4))
    loop(
        _planes(mesh),
        cut.record,
        column(face, np.int32),
        column(row, np.int32),
        column(-1, np.int64),
        read_only(xyr, np.float64),
        result,
    )
    return result


def _planes(mesh: Mesh) -> Any:
    frames = frames_of(mesh)
    arrays = frames.origin, frames.x_axis, frames.y_axis
    return tuple(read_only(each, np.float64) for each in arrays)
