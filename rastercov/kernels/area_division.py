"""Pieces divided by lines, compiled by numba: for `division`."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.kernels.area_plane import perimeter_of, without_needless
from rastercov.kernels.area_union import SLACK_REL
from rastercov.kernels.exact_polygon import MOST_CORNERS, copy_polygon, split, twice_area
from rastercov.kernels.exact_records import PIECE_ROOM, U, V
from rastercov.kernels.jit import compiled, part_with_arrays


class Halves(NamedTuple):
    """Parts of pieces on the two sides of lines: corners, starts, row of the piece, and side.

    `used` has the parts and their corners.
    """

    xy: NDArray[np.float64]
    starts: NDArray[np.int64]
    row: NDArray[np.int64]
    side: NDArray[np.int64]
    used: NDArray[np.int64]


def room_for_halves(n: int, corners: int) -> Halves:
    """Memory for the parts of n pieces: a line adds 4 corners, and a part of too many 2."""
    row, side = np.empty((2, 4 * n), np.int64)
    return Halves(
        np.empty((corners + 8 * n, 2)), np.zeros(4 * n + 1, np.int64), row, side,
        np.zeros(2, np.int64),
    )  # fmt: skip


@part_with_arrays
def append_half(polygon, n, row, side, nearest, spare, out):
    """Append a part of a piece without needless corners; its area, 0 for a sliver, left out."""
    kept = without_needless(polygon, n, nearest, spare) if n >= 3 else 0
    area = twice_area(spare, kept) / 2 if kept >= 3 else 0.0
    if not area > nearest * perimeter_of(spare, kept):
        return 0.0
    first = 1
    while first + 1 < kept:
        last = min(first + MOST_CORNERS - 2, kept - 1)
        part, at = out.used[0], out.used[1]
        out.xy[at, U], out.xy[at, V] = spare[0, U], spare[0, V]
        for p in range(first, last + 1):
            out.xy[at + 1 + p - first, U] = spare[p, U]
            out.xy[at + 1 + p - first, V] = spare[p, V]
        out.row[part], out.side[part] = row, side
        out.used[0], out.used[1] = part + 1, at + last - first + 2
        out.starts[part + 1] = out.used[1]
        first = last
    return area


@compiled
def halve_pieces(xy, starts, lines, nearest, change, out):
    """Divide pieces, each by a line of its own.

    Parameters
    ----------
    xy, starts : (C, 2) float64, (N + 1,) int64
        The pieces.
    lines : (N, 3) float64
        a, b, c: side 1 is where a x + b y > c.
    nearest : (N,) float64
        Least distance of two corners that do not coincide, metres.
    change : (N,) float64
        Out: bound of what that does to the area of a piece and its overlap with others.
    out : Halves
    """
    values, polygon, spare = (
        np.empty(PIECE_ROOM),
        np.empty((PIECE_ROOM, 2)),
        np.empty((PIECE_ROOM, 2)),
    )
    inside, outside = np.empty((PIECE_ROOM, 2)), np.empty((PIECE_ROOM, 2))
    out.used[:] = 0
    for row in range(starts.shape[0] - 1):
        n, close = starts[row + 1] - starts[row], nearest[row]
        slack = SLACK_REL * close
        a, b, c = lines[row, 0], lines[row, 1], lines[row, 2]
        least = most = 0.0
        for p in range(n):
            polygon[p, U], polygon[p, V] = xy[starts[row] + p, U], xy[starts[row] + p, V]
            value = a * polygon[p, U] + b * polygon[p, V] - c
            values[p] = value if abs(value) > slack else 0.0
            least, most = min(least, values[p]), max(most, values[p])
        change[row] = 0.0
        if least < 0 < most:
            before = twice_area(polygon, n) / 2
            kept, lost = split(polygon, n, values, inside, outside)
            after = append_half(outside, lost, row, 0, close, spare, out)
            after += append_half(inside, kept, row, 1, close, spare, out)
            change[row] = abs(before - after) + 4 * slack * perimeter_of(polygon, n)
            continue
        at = out.used[1]
        copy_polygon(polygon, n, out.xy[at:])
        out.row[out.used[0]], out.side[out.used[0]] = row, 1 if most > 0 else 0
        out.used[0], out.used[1] = out.used[0] + 1, at + n
        out.starts[out.used[0]] = at + n
