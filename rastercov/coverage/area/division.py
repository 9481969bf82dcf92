"""Cells of faces with many pieces, for their union: a tree of lines divides each such face.

Pieces of two cells cannot overlap, so that a union within cells takes time in proportion to their
number. A cell with more than `MOST_PIECES` is divided along the line that leaves the fewest pieces
in both halves together, and pieces across it are cut. Cells last as long as the union, so that no
piece is cut twice by the same line; pieces that no line separates, such as equal ones, stay in one.

J. Bentley. Multidimensional Binary Search Trees Used for Associative Searching. 1975.
"""

import copy
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from rastercov.base.memory import FloatArray, IntArray
from rastercov.coverage.area.polygons import chosen, extents, following, starts_of
from rastercov.native import area_union

MOST_PIECES = 256
"""Pieces of a cell up to which each is compared with all others."""
PIECES_A_STEP = 4096
"""Pieces that are added between two signs of progress: less than a second of work."""
Progress = Callable[[int, int], None]
MOST_SIDES = 20
"""Sides of a cell that is divided no more: as many as a piece may have."""
LEAST_GAIN = 0.95
"""Pairs of pieces in both halves, relative to those before, above which a cell is not divided."""
ENOUGH = 0.75
"""The same, below which no further line is tried."""
QUANTILES = (0.5, 0.2, 0.8)
"""Places of lines among the beginnings of pieces: the first, and others where it is no help."""
SAMPLES = (0.25, 0.75)
"""Pieces whose longest side gives the direction of a line, where no axis does: slivers."""


class Pieces(NamedTuple):
    """Convex polygons in the planes of their faces.

    Attributes
    ----------
    xy : (C, 2) float64
    starts : (N + 1,) int64
    cell : (N,) int64
    tag : (N,) int64
        A number that the parts of a piece keep.
    """

    xy: FloatArray
    starts: IntArray
    cell: IntArray
    tag: IntArray

    def taken(self, rows: IntArray) -> "Pieces":
        """Some of the pieces, in this order."""
        return Pieces(*chosen(self.xy, self.starts, rows), self.cell[rows], self.tag[rows])


class Halves(NamedTuple):
    """Parts of pieces on the two sides of lines, for `native.area_union`.

    Attributes
    ----------
    xy, starts : (C, 2) float64, (N + 1,) int64
    row, side : (N,) int64
        Row of the piece, and the side of its line.
    used : (2,) int64
        Parts and corners so far.
    """

    xy: FloatArray
    starts: IntArray
    row: IntArray
    side: IntArray
    used: IntArray

    @classmethod
    def of_room(cls, n: int, corners: int) -> "Halves":
        """Memory for the parts of n pieces: a line adds 4 corners, and a part of too many 2."""
        row, side = np.empty((2, 4 * n), np.int64)
        starts, used = np.zeros(4 * n + 1, np.int64), np.zeros(2, np.int64)
        return cls(np.empty((corners + 8 * n, 2)), starts, row, side, used)


NO_PIECES = Pieces(
    np.empty((0, 2)), np.zeros(1, np.int64), np.empty(0, np.int64), np.empty(0, np.int64)
)


def joined(parts: list[Pieces]) -> Pieces:
    """All pieces of some lists."""
    counts = [np.diff(each.starts) for each in parts]
    xy, _, cell, tag = map(np.concatenate, zip(*parts, strict=True))
    return Pieces(xy, starts_of(np.concatenate(counts)), cell, tag)


class Cells:
    """Cells of the faces of a mesh; cell f < F is all of face f.

    Parameters
    ----------
    corners : (F, 3, 2) float64
        Faces in their planes.
    nearest : (F,) float64
        Least distance of two corners that do not coincide, metres.
    """

    def __init__(self, corners: FloatArray, nearest: FloatArray) -> None:
        n = len(corners)
        self._corners, self._nearest = corners, nearest
        self.face = np.arange(n)
        """(C,) face of each cell."""
        self.division = np.full(n, -1)
        """(C,) division of each cell, -1 for none; the halves of i are F + 2 i and F + 2 i + 1."""
        self.is_closed = np.zeros(n, np.bool_)
        """(C,) cells to which nothing is added any more."""
        self._lines = np.empty((0, 3))
        self._polygons: dict[int, FloatArray] = {}
        self._most: dict[int, int] = {}

    def copy(self) -> "Cells":
        """The same cells, to be changed."""
        other = copy.copy(self)
        other.division, other.is_closed = self.division.copy(), self.is_closed.copy()
        other._polygons, other._most = self._polygons.copy(), self._most.copy()
        return other

    def polygons(self, cells: IntArray) -> tuple[FloatArray, IntArray]:
        """Corners and starts of cells."""
        counts = np.full(len(cells), 3)
        divided = np.flatnonzero(cells >= len(self._corners))
        parts = [self._polygons[cell] for cell in cells[divided].tolist()]
        counts[divided] = [len(each) for each in parts]
        starts = starts_of(counts)
        xy, is_own = np.empty((starts[-1], 2)), np.repeat(cells >= len(self._corners), counts)
        whole = cells[cells < len(self._corners)]
        xy[~is_own] = self._corners[whole].reshape(-1, 2)
        if parts:
            xy[is_own] = np.concatenate(parts)
        return xy, starts

    def of_faces(self, faces: IntArray) -> IntArray:
        """All cells of some faces."""
        if len(self.face) == len(self._corners):
            return faces
        is_asked = np.zeros(len(self._corners), np.bool_)
        is_asked[faces] = True
        cells = np.array([*np.flatnonzero(is_asked), *self._polygons], np.int64)
        return np.sort(cells[is_asked[self.face[cells]] & (self.division[cells] < 0)])

    def close(self, faces: IntArray) -> None:
        """Close faces, each as one cell again."""
        chosen = np.zeros(len(self._corners), np.bool_)
        chosen[faces] = True
        for cell in [cell for cell in self._polygons if chosen[self.face[cell]]]:
            del self._polygons[cell]
        self.division[faces], self.is_closed[faces] = -1, True

    def place(self, pieces: Pieces, lost: FloatArray) -> Pieces:
        """Pieces in the cells that they are in, cut where they are in several.

        `cell` of each is where it was before, or its face. Crowded cells are divided, and pieces of
        tag 0 in closed ones left out. What cutting may do to the area of a face is added to `lost`,
        (F,).
        """
        done = []
        while len(pieces.cell):
            at = self.division[pieces.cell]
            if (at < 0).all():
                by_cell = np.argsort(pieces.cell, kind="stable")
                is_wanted = (pieces.tag > 0) | ~self.is_closed[pieces.cell]
                pieces = pieces.taken(by_cell[is_wanted[by_cell]])
                self._divide_crowded(pieces)
                at = self.division[pieces.cell]
                done.append(pieces.taken(np.flatnonzero(at < 0)))
                pieces = pieces.taken(np.flatnonzero(at >= 0))
            else:
                halves = self._halved(pieces.taken(np.flatnonzero(at >= 0)), lost)
                pieces = joined([pieces.taken(np.flatnonzero(at < 0)), halves])
        return joined(done) if done else pieces

    def _halved(self, pieces: Pieces, lost: FloatArray) -> Pieces:
        """Pieces in divided cells, in the halves of these."""
        face, at = self.face[pieces.cell], self.division[pieces.cell]
        n, corners = len(pieces.cell), len(pieces.xy)
        out, change = Halves.of_room(n, corners), np.empty(n)
        area_union.halve_pieces(
            pieces.xy, pieces.starts, self._lines[at], self._nearest[face], change, out
        )
        n, corners = out.used.tolist()
        lost += np.bincount(face, change, minlength=len(lost))
        row, starts = out.row[:n], out.starts[: n + 1]
        cell = len(self._corners) + 2 * at[row] + out.side[:n]
        return Pieces(out.xy[:corners], starts, cell, pieces.tag[row])

    def _divide_crowded(self, pieces: Pieces) -> None:
        """Divide cells with too many pieces, which are ordered by cell, where a line helps."""
        cells, first, counts = np.unique(pieces.cell, return_index=True, return_counts=True)
        lines: list[FloatArray] = []
        divided: list[int] = []
        for row in np.flatnonzero(counts > MOST_PIECES).tolist():  # as many as cells in the end
            cell, count = int(cells[row]), int(counts[row])
            if count <= self._most.get(cell, MOST_PIECES):
                continue
            starts = pieces.starts[first[row] : first[row] + count + 1]
            xy, nearest = pieces.xy[starts[0] : starts[-1]], float(self._nearest[self.face[cell]])
            line = dividing_line(xy, starts - starts[0], nearest)
            halves = None if line is None else self._halves_of(cell, line)
            if line is None or halves is None:
                self._most[cell] = 2 * count  # by then it may have changed
                continue
            half = len(self._corners) + 2 * (len(self._lines) + len(lines))
            self._polygons[half], self._polygons[half + 1] = halves
            lines.append(line)
            divided.append(cell)
        if lines:
            n = 2 * len(lines)
            self.division[divided] = len(self._lines) + np.arange(len(lines))
            self._lines = np.concatenate([self._lines, np.array(lines)])
            self.face = np.concatenate([self.face, np.repeat(self.face[divided], 2)])
            self.division = np.concatenate([self.division, np.full(n, -1)])
            self.is_closed = np.concatenate([self.is_closed, np.zeros(n, np.bool_)])

    def _halves_of(self, cell: int, line: FloatArray) -> list[FloatArray] | None:
        """Corners of the halves of a cell; None where they have too many sides, or no area."""
        xy, starts = self.polygons(np.array([cell]))
        out = Halves.of_room(1, len(xy))
        nearest = self._nearest[self.face[[cell]]]
        area_union.halve_pieces(xy, starts, line[None], nearest, np.empty(1), out)
        if len(xy) >= MOST_SIDES or out.used[0] != 2 or out.side[:2].tolist() != [0, 1]:
            return None
        return [out.xy[out.starts[side] : out.starts[side + 1]].copy() for side in (0, 1)]


def dividing_line(xy: FloatArray, starts: IntArray, nearest: float) -> FloatArray | None:
    """(a, b, c) of a line a x + b y = c that leaves few pieces in both halves together, or None.

    By an axis through the middle where that separates half of them or more; or the best of some
    lines, also along long pieces.
    """
    n, best = len(starts) - 1, None
    most = LEAST_GAIN * n * n
    sides = xy[following(starts)] - xy
    lengths = np.hypot(*sides.T)
    directions = [np.array((1.0, 0.0)), np.array((0.0, 1.0))]
    for number in (int(part * n) for part in SAMPLES):
        longest = starts[number] + lengths[starts[number] : starts[number + 1]].argmax()
        if lengths[longest] > 0:
            x, y = sides[longest] / lengths[longest]
            directions.append(np.array((-y, x)))
    for directions_so_far, quantiles in ((directions[:2], QUANTILES[:1]), (directions, QUANTILES)):
        for direction in directions_so_far:
            along = xy @ direction
            low, high = extents(along, starts)
            ordered = np.sort(low)
            for quantile in quantiles:
                at = ordered[int(quantile * n)]
                n_low, n_high = (low < at - nearest).sum(), (high > at + nearest).sum()
                pairs = float(n_low) ** 2 + float(n_high) ** 2
                if pairs < most:
                    best, most = np.append(direction, at), pairs
        if most <= ENOUGH * n * n:
            break
    return best
