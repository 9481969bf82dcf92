"""Records of the rasteriser of lenses: samples in ideal planes, what is drawn on them, faces."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.lenses.lane_kernels import LaneScratch
from rastercov.lenses.records import PlaneRecord

FloatArray = NDArray[np.float64]

TILE = 4
"""Samples of a side of a tile."""
SAMPLES = TILE * TILE
"""Samples of a tile."""
BLOCK = 8
"""Samples of a side of a block, whose tiles share a centre."""


FACES_AT_A_TIME, TILES_AT_A_TIME = 64, 256
"""Faces that are listed before they are drawn, and tiles of them from which on they are drawn: so
that tiles can be requested from memory long before their turn."""


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
        First column and last column, negated, first row and last row, negated, of tiles with
        samples in each cell of a grid on the plane, level by level: a cell of a level is four of
        the level before. The range of several cells is the least of each; the first is after the
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
    plane : PlaneRecord
        The lens on this plane.
    radius2 : float
        Square of the radius of a disc of the plane, around its origin, on which the lens may be
        evaluated; 0 for none.
    canvas : (2, 3) float64
        Affine map from pixels to the canvas, in samples.
    bend : float
        Samples that the image of a segment leaves its chord by at most, over its squared length.
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
    plane: PlaneRecord
    radius2: float
    canvas: FloatArray
    bend: float


class Seen(NamedTuple):
    """Vertices of a mesh in a plane and on the canvas.

    `points`, (V, 3), are in axes of the plane, `xy`, (V, 2), in units of it, and `uv`, (V, 2), on
    the canvas, in samples: NaN for those before the near plane or beyond `Patch.radius2`, for
    which `is_inside`, (V,), is False. `lanes` is scratch.
    """

    points: FloatArray
    xy: FloatArray
    uv: FloatArray
    is_inside: NDArray[np.bool_]
    lanes: LaneScratch


class Samples(NamedTuple):
    """Arrays of a `Patch` that `cover` reads."""

    centres: FloatArray
    x: NDArray[np.float32]
    y: NDArray[np.float32]


class Image(NamedTuple):
    """Image of the tiles of a patch.

    `inverse`, (T, 16) float32, has 1/z and `face`, (T, 16) int32, the face of each sample;
    `inverse` is 0 for none, and `face` is then undefined. Both are valid only where `is_touched`,
    (T,).
    """

    inverse: NDArray[np.float32]
    face: NDArray[np.int32]
    is_touched: NDArray[np.bool_]


class Listed(NamedTuple):
    """Faces that wait to be drawn, with the tiles that they may cover.

    Attributes
    ----------
    tiles : (N,) int32
        Tiles of all faces, one after the other, with room for `TILES_AT_A_TIME` and those of one
        more face.
    faces, ends : (FACES_AT_A_TIME,) int64
        Faces, and the end of their tiles.
    heights, sides : (FACES_AT_A_TIME,) float64
        n.a of each face, and the sign of its inner side, see `lens_kernels`.
    is_drawn : (FACES_AT_A_TIME,) bool
        False for faces that are counted only.
    bit_indices : (256, 8) uint8
        Table that lists the bits of a mask.
    """

    tiles: NDArray[np.int32]
    faces: NDArray[np.int64]
    ends: NDArray[np.int64]
    heights: FloatArray
    sides: FloatArray
    is_drawn: NDArray[np.bool_]
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
    them is below -d_i: d_i is more than rounding, to float32 within a block, and `scale_i` is 1 /
    d_i. Between them `is_inside_exactly` decides, from the corners p, q, r, `side`, and t_i of
    `least_sum`.

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
    scale0: float
    scale1: float
    scale2: float
