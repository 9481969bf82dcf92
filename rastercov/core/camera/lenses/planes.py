"""Ideal planes of a lens, see `engine/lens/ideal.cpp`: pinhole cameras that together see it.

Straight edges of a mesh are straight in an ideal plane, so visibility is computed there; the lens
then moves the pieces to pixels.
"""

import numpy as np

from rastercov.base import FloatArray, frozen_record, matmul, read_only
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.lenses.records import PlaneRecord, Slopes, Tree
from rastercov.engine import solver_lens
from rastercov.engine.lens_rays import jacobian_many
from rastercov.engine.solver_lens import CELLS, MOST, PARTS

ALMOST_NOTHING = 1e-300
"""Slope of the cone around -z that a lens is not evaluated in."""
BEFORE_PLANES = 3 + solver_lens.SIZE
"""Numbers of a row after that of its planes: size of the image, blind area, parameters."""


@frozen_record
class Proved:
    """An ideal plane with all that is proved of it.

    Attributes
    ----------
    camera : Camera
        The pinhole; its image ends where that of the lens does.
    """

    camera: Camera
    record: PlaneRecord
    field: Tree
    slopes: Slopes


class _Reader:
    """Takes numbers of a row one after another, see `engine/lens/packed.cpp`."""

    def __init__(self, row: FloatArray) -> None:
        self._row, self._at = row, 0

    def take(self, *shape: int) -> FloatArray:
        first, self._at = self._at, self._at + int(np.prod(shape))
        return self._row[first : self._at].reshape(shape)

    def floats(self, n: int) -> list[float]:
        values: list[float] = self.take(n).tolist()
        return values

    def counts(self, n: int) -> list[int]:
        return [int(value) for value in self.floats(n)]

    def plane(self) -> Proved:
        (code,), params, frame = self.counts(1), self.take(solver_lens.SIZE), self.take(3, 3)
        pinhole = self.floats(4)
        polygons = [self.take(n, 2) for n in self.counts(3)]
        longest, (parts_of, is_graded) = self.take(MOST + 1), self.counts(2)
        rules, figures = (longest, parts_of, bool(is_graded)), self.floats(8)
        record = PlaneRecord._make([code, params, frame, *pinhole, *polygons, *rules, *figures])
        fx, fy, cx, cy, width, height = self.floats(6)
        camera = Camera(width=int(width), height=int(height), fx=fx, fy=fy, cx=cx, cy=cy)
        n, root = self.counts(2)
        lines, children, kinds = self.take(n, 3), self.take(n, 2), self.take(n)
        own = read_only(children.astype(np.int32)), read_only(kinds.astype(np.uint8))
        tree = Tree(lines, *own, root)
        grid, side = self.floats(4), CELLS * PARTS
        bounds = self.take(side, side), self.take(side, side), self.take(2, CELLS, CELLS)
        return Proved(camera, record, tree, Slopes._make([*grid, *bounds, self.take(4)]))


def planes_in(row: FloatArray) -> tuple[Proved, ...]:
    """Ideal planes of a lens of the row that `solver_lens.pack` makes."""
    reader = _Reader(row)
    n = reader.counts(4)[3]
    reader.take(BEFORE_PLANES)
    return tuple(reader.plane() for _ in range(n))


def first_derivatives(plane: PlaneRecord, points: FloatArray) -> FloatArray:
    """(N, 4) u_x, u_y, v_x, v_y at points (N, 2) of a plane."""
    everywhere = plane.params.copy()
    everywhere[solver_lens.SLOPE] = -ALMOST_NOTHING  # also a step beyond the region
    rays = matmul(points, plane.frame[:, :2].T) + plane.frame[:, 2]
    out = np.empty((len(points), 2, 3))
    jacobian_many(plane.code, everywhere, np.ascontiguousarray(rays), out)
    return matmul(out, plane.frame[:, :2]).reshape(-1, 4)
