"""Overlay of convex pieces in the planes of faces: number or set of owners of each part.

A face here is any polygon with pieces of its own: a face of a mesh, or a face for each of several
groups of cameras, whose counts do not mix.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.base.checks import finite_number, shown
from rastercov.base.errors import ConfigError
from rastercov.base.memory import FloatArray, IntArray, check_memory
from rastercov.coverage.area.division import (
    NO_PIECES,
    PIECES_A_STEP,
    Cells,
    Pieces,
    Progress,
    joined,
)
from rastercov.coverage.area.frames import Frames
from rastercov.coverage.area.polygons import polygon_areas
from rastercov.native import area_union

FLOOR_REL = 1e-15
"""Least distance of two corners that do not coincide, relative to the diagonal of the mesh."""
MOST_VIEWS = 10_000
"""Cameras up to which they may be counted."""
WHOLE_PAIR_REL = 1e-9
"""Part of the area of a face that a camera may miss and still count as covering all of it."""


class Partition(NamedTuple):
    """Pieces by cell, and number or set of cameras of each, for `native.area_union`.

    Attributes
    ----------
    xy, starts : (C, 2) float64, (N + 1,) int64
    cell : (N,) int64
    tag : (N,) int64
    used : (2,) int64
        Pieces and corners so far.
    """

    xy: FloatArray
    starts: NDArray[np.int64]
    cell: NDArray[np.int64]
    tag: NDArray[np.int64]
    used: NDArray[np.int64]

    @classmethod
    def of_room(cls, n: int, corners: int) -> "Partition":
        """Memory for n pieces."""
        starts, used = np.zeros(n + 1, np.int64), np.zeros(2, np.int64)
        cell, tag = np.empty((2, n), np.int64)
        return cls(np.empty((corners, 2)), starts, cell, tag, used)

    def with_more_room(self) -> "Partition":
        """The same pieces, with room for half as many again."""
        n, corners = self.used.tolist()
        room = self.of_room(len(self.cell) * 3 // 2 + 64, len(self.xy) * 3 // 2 + 512)
        room.xy[:corners], room.starts[: n + 1] = self.xy[:corners], self.starts[: n + 1]
        room.cell[:n], room.tag[:n], room.used[:] = self.cell[:n], self.tag[:n], self.used
        return room


class Overlay:
    """Partition of N faces by the number of cameras, to which pieces are added; or by their sets.

    A face that k cameras cover as a whole is closed: it is one piece from then on, and costs
    nothing more, however many pieces follow.

    Parameters
    ----------
    frames : Frames
        Frames of the mesh.
    face : (N,) int64
        Face of the mesh that each is.
    diagonal : float
        Of the mesh, metres.
    views : int, optional
        k: cameras up to which they are counted. Unless given, tags are sets of up to 64 cameras as
        bits; nothing is closed then, and pieces are added once.

    Attributes
    ----------
    views : int, optional
    """

    def __init__(
        self, frames: Frames, face: IntArray, diagonal: float, views: int | None = None
    ) -> None:
        number = 1.0 if views is None else finite_number(views)
        if not number.is_integer() or not 1 <= number <= MOST_VIEWS:
            raise ConfigError(
                f"views must be a whole number of 1 to {MOST_VIEWS}, got {shown(views)}"
            )
        check_memory(
            f"areas of {int(number)} numbers of views x {len(face):,} faces",
            8 * int(number) * len(face),
            "count fewer views",
        )
        self.views, self._n = None if views is None else int(views), len(face)
        corners = frames.corners[face]
        self._areas, self._bound = frames.areas[face], np.zeros(len(face))
        self._nearest = np.maximum(
            area_union.COINCIDENT_REL * corners[:, 1, 0], FLOOR_REL * diagonal
        )
        self._cells = Cells(corners, self._nearest)
        self._pieces = NO_PIECES

    @property
    def closed(self) -> NDArray[np.bool_]:
        """(N,) faces that k cameras cover as a whole."""
        return self._cells.is_closed[: self._n].copy()

    def begin(self, pieces: Pieces) -> None:
        """Begin with the pieces of a partition, whose tags are their numbers of cameras."""
        self._pieces = pieces

    def add(
        self,
        pieces: Pieces,
        camera: NDArray[np.int32],
        pairs: Any,
        progress: Progress = lambda done, total: None,
        number: IntArray | None = None,
    ) -> None:
        """Take in pieces of cameras, (M,).

        `pairs` are camera, face, area and bound of each pair of them with a piece or a bound,
        ordered by camera, then by face; `number` is that of each camera, for sets.
        """
        of, face, area, own_bound = pairs
        n_faces, is_closed = self._n, self.closed
        is_open = ~is_closed[face]
        is_whole = area >= (1 - WHOLE_PAIR_REL) * self._areas[face]
        all_of = np.flatnonzero(is_whole & is_open)
        if number is None:
            whole = np.bincount(face[all_of], minlength=n_faces)
        else:
            whole, pieces = np.zeros(n_faces, np.int64), pieces._replace(tag=number[camera])
            np.bitwise_or.at(whole, face[all_of], np.int64(1) << number[of[all_of]])
        missing = np.maximum(self._areas[face] - area, 0.0)
        lost = (own_bound + np.where(is_whole, missing, 0.0))[is_open]
        bound = self._bound + np.bincount(face[is_open], lost, minlength=n_faces)
        keys = of.astype(np.int64) * n_faces + face
        is_done = is_closed if self.views is None else is_closed | (whole >= self.views)
        chosen = np.flatnonzero(~is_done[pieces.cell])
        own = camera[chosen].astype(np.int64) * n_faces + pieces.cell[chosen]
        chosen = chosen[~is_whole[np.searchsorted(keys, own)]]
        self.unite(pieces.taken(chosen), whole, bound, progress)

    def unite(
        self,
        new: Pieces,
        whole: NDArray[np.int64],
        bound: FloatArray,
        progress: Progress = lambda done, total: None,
    ) -> None:
        """Take in pieces of faces; and (F,) cameras that cover all of each face, besides.

        The tag of a piece is 0, or, for sets, the number of its camera.
        `bound` is that of the union without what is lost here.
        """
        n_faces, cells = self._n, self._cells.copy()
        pieces = cells.place(joined([self._pieces, new]), bound)
        asked = cells.of_faces(np.flatnonzero(whole))
        used = np.unique(np.concatenate([pieces.cell, asked]))
        used = used[np.lexsort((used, cells.face[used]))]
        place = np.zeros(len(cells.face), np.int64)
        place[used] = np.arange(len(used))
        at = place[pieces.cell]
        is_old = (pieces.tag > 0) & (self.views is not None)
        old_rows, new_rows = np.flatnonzero(is_old), np.flatnonzero(~is_old)
        old = pieces.taken(old_rows[np.argsort(at[old_rows], kind="stable")])
        old = old._replace(cell=place[old.cell])
        areas = polygon_areas(pieces.xy, pieces.starts)
        order = new_rows[np.lexsort((-areas[new_rows], at[new_rows]))]
        xy, starts = cells.polygons(used)
        own_bound, own_closed = np.zeros(len(used)), cells.is_closed[used]
        face = cells.face[used]
        of_cells = xy, starts, polygon_areas(xy, starts), self._nearest[face], whole[face]
        new_pieces = pieces.xy, pieces.starts, at, pieces.tag
        found = self._united(of_cells, old, new_pieces, order, own_closed, own_bound, progress)
        bound += np.bincount(cells.face[used], own_bound, minlength=n_faces)
        cells.is_closed[used] = own_closed
        n, corners = found.used.tolist()
        pieces = Pieces(
            found.xy[:corners].copy(), found.starts[: n + 1].copy(), used[found.cell[:n]],
            found.tag[:n].copy(),
        )  # fmt: skip
        self._pieces = self._without_closed_cells(cells, pieces)
        self._cells, self._bound = cells, np.minimum(bound, self._areas)

    def _united(
        self, cells: Any, old: Pieces, new: Any, order: Any, is_closed: Any, bound: FloatArray,
        progress: Progress,
    ) -> "Partition":  # fmt: skip
        """Partition by `native.area_union`, a few cells at a time: Ctrl-C waits for no more."""
        n_cells, n = len(bound), len(order)
        out = Partition.of_room(2 * (n + len(old.cell)) + 64, 2 * len(new[0]) + 512)
        span = np.zeros(4, np.int64)
        last = np.searchsorted(new[2][order], np.arange(n_cells), side="right")
        while span[0] < n_cells:
            at = max(int(np.searchsorted(last, span[2] + PIECES_A_STEP)), int(span[0])) + 1
            span[3] = min(at, n_cells)
            rest = old, new, order, is_closed, bound, out, span
            if self.views is None:
                state = area_union.unite_sets(cells, *rest)
            else:
                state = area_union.unite_cells(cells, self.views, *rest)
            if state == area_union.PARTITION_TOO_SMALL:
                out = out.with_more_room()
            progress(int(span[2]), n)
        return out

    def _without_closed_cells(self, cells: Cells, pieces: Pieces) -> Pieces:
        """Pieces, where faces of which all cells are closed become one piece and one cell."""
        divided = np.flatnonzero(cells.division[: self._n] >= 0)
        if len(divided) == 0 or self.views is None:
            return pieces
        parts = cells.of_faces(divided)
        is_open = np.zeros(self._n, np.bool_)
        is_open[cells.face[parts[~cells.is_closed[parts]]]] = True
        done = divided[~is_open[divided]]
        rest = pieces.taken(np.flatnonzero(~np.isin(cells.face[pieces.cell], done)))
        cells.close(done)
        xy, starts = cells.polygons(done)
        whole = Pieces(xy, starts, done, np.full(len(done), self.views))
        both = joined([rest, whole])
        return both.taken(np.argsort(cells.face[both.cell], kind="stable"))

    def partition(self) -> Pieces:
        """Pieces so far, by face in `cell`, and the number, up to k, or the set of cameras."""
        xy, starts, cell, views = self._pieces
        return Pieces(xy.copy(), starts.copy(), self._cells.face[cell], views)

    def areas(self, pieces: Pieces, rows: NDArray[np.bool_]) -> FloatArray:
        """(N,) area of some of the pieces of a partition, m^2."""
        areas = polygon_areas(pieces.xy, pieces.starts)
        return np.bincount(pieces.cell[rows], areas[rows], self._n).astype(np.float64)

    @property
    def bound(self) -> FloatArray:
        """(N,) bound of the error of each of these areas, m^2."""
        return self._bound.copy()
