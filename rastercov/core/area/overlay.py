"""Partition of faces by the number, or the set, of cameras whose pieces cover each part.

A face here is any polygon with pieces of its own: a face of a mesh, or a face for each of several
groups of cameras, whose counts do not mix. `rastercov/engine/solver/union.hpp` has the memory.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base import (
    BoolArray,
    ConfigError,
    FloatArray,
    Int32Array,
    IntArray,
    check_memory,
    finite_number,
    shown,
)
from rastercov.engine import solver_union
from rastercov.shards import Progress as Progress

FLOOR_REL = 1e-15
"""Least distance of two corners that do not coincide, relative to the diagonal of the mesh."""
MOST_VIEWS = 10_000
"""Cameras up to which they may be counted."""
MOST_PIECES = solver_union.MOST_PIECES
"""Pieces of a part of a face up to which each is compared with all others."""


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
    """

    def __init__(
        self, corners: FloatArray, areas: FloatArray, diagonal: float, views: int | None = None
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
        self.united = solver_union.Union(faces, FLOOR_REL * diagonal, counted, MOST_PIECES)

    @property
    def closed(self) -> BoolArray:
        """(N,) faces that k cameras cover as a whole."""
        mask = np.empty(self._n, np.bool_)
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
        bound, ordered by camera, then by face; `number` is the bit of each camera, for sets.
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
