"""Records of the rasteriser of lenses: samples in ideal planes, what is drawn on them, faces."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

TILE = 4
"""Samples of a side of a tile."""
SAMPLES = TILE * TILE
"""Samples of a tile."""
BLOCK = 8
"""Samples of a side of a block, whose tiles share a centre."""


class Patch(NamedTuple):
    """Samples of an image that one ideal plane sees, in tiles of 4 x 4, arrays read-only.

    The T tiles are those of a rectangle of the canvas, row by row.

    Attributes
    ----------
    frame : (3, 3) float64
        lens_from_plane.
    centres : (T, 2) float64
        Place (x, y) in the block of each tile, in units of the plane.
    x, y : (T, 16) float32
        Places of the samples of each tile from there; NaN for a sample of another plane, or of
        none.
    boxes : (4, T + 16) float32
        Least and greatest x, least and greatest y of each tile, rounded outwards; empty for a tile
        without samples, and for those behind the last.
    cells : (N, 4) int32
        First and last column, first and last row of tiles with samples in each cell of a grid on
        the plane, level by level: a cell of a level is four of the level before. First is after
        last where there is none.
    starts, widths, heights : (L,) int64
        First cell of each level, and its numbers of columns and rows.
    low, high : (2,) float64
        Corners of the box of all samples.
    first_row, first_column : int
        Place of the first tile on the canvas.
    columns : int
        Tiles in a row.
    cells_a_unit : float
        Cells of the first level in a unit of the plane.
    reach : float
        1 + |x| + |y| at most, of any sample.
    half : float
        Largest distance in x or y of a sample from the centre of its block.
    """

    frame: FloatArray
    centres: FloatArray
    x: NDArray[np.float32]
    y: NDArray[np.float32]
    boxes: NDArray[np.float32]
    cells: NDArray[np.int32]
    starts: NDArray[np.int64]
    widths: NDArray[np.int64]
    heights: NDArray[np.int64]
    low: FloatArray
    high: FloatArray
    first_row: int
    first_column: int
    columns: int
    cells_a_unit: float
    reach: float
    half: float


class Samples(NamedTuple):
    """Arrays of a `Patch` that `cover` reads."""

    centres: FloatArray
    x: NDArray[np.float32]
    y: NDArray[np.float32]


class Image(NamedTuple):
    """Image of the tiles of a patch.

    `inverse`, (T, 16) float32, has 1/z and `face`, (T, 16) int32, the face of each sample, 0 and -1
    for none; both are valid only where `is_touched`, (T,).
    """

    inverse: NDArray[np.float32]
    face: NDArray[np.int32]
    is_touched: NDArray[np.bool_]


class Listed(NamedTuple):
    """Memory for the tiles of a face, (T + 16,), and the table that lists the bits of a mask."""

    tiles: NDArray[np.int32]
    bit_indices: NDArray[np.uint8]


class Reach(NamedTuple):
    """Tiles that a face may reach: a box of the plane, and columns and rows, last included."""

    x0: float
    x1: float
    y0: float
    y1: float
    first_column: int
    last_column: int
    first_row: int
    last_row: int


class FacePlanes(NamedTuple):
    """Planes of a face: three through the eye and its edges, inner side positive, and 1/z.

    A sample is inside where e_i = a_i x + b_i y + c_i > d_i for i < 3, and outside where one of
    them is below -d_i: d_i is more than rounding, to float32 within a block. Between them
    `is_inside_exactly` decides, from the corners p, q, r, `side`, and t_i of `least_sum`.

    1/z = a_3 x + b_3 y + c_3 must be above `behind` and not above `cut`. It is then put between
    `least` and `greatest`, its values at the corners: a sample is beyond them by rounding alone.
    """

    a0: float
    b0: float
    c0: float
    d0: float
    a1: float
    b1: float
    c1: float
    d1: float
    a2: float
    b2: float
    c2: float
    d2: float
    a3: float
    b3: float
    c3: float
    behind: float
    cut: float
    least: float
    greatest: float
    px: float
    py: float
    pz: float
    qx: float
    qy: float
    qz: float
    rx: float
    ry: float
    rz: float
    side: float
    t0: float
    t1: float
    t2: float
