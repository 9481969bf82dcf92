"""Records of the rasteriser of lenses: samples in ideal planes, what is drawn on them, faces."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.kernels.lens_lanes import LaneScratch, lane_scratch
from rastercov.kernels.lens_planes import PlaneRecord
from rastercov.kernels.raster_memory import (
    BUFFER_SIZE,
    FACES,
    LANES,
    VERTICES,
    aligned_zeros,
    bit_table,
)

FloatArray = NDArray[np.float64]

TILE_BITS = 2
TILE = 1 << TILE_BITS
"""Samples of a side of a tile, also as a power of 2."""
SAMPLES = TILE * TILE
"""Samples of a tile."""
BLOCK = 8
"""Samples of a side of a block, whose tiles share a centre."""


TILES_AT_A_TIME = 1024
"""Tiles of the faces of a cluster that are listed before they are drawn, so that they can be
requested from memory long before their turn."""
SLOTS = 2 * FACES
"""Slots for the faces of a cluster, and for their twins: faces that are seen from the side, with
their edges the other way round."""

EYE, AXES, NEAR, RADIUS2, CANVAS, BEND, LOW, HIGH = 0, 3, 12, 13, 14, 20, 21, 23
REACH, HALF, SAMPLES_LOW, SAMPLES_HIGH = 25, 26, 27, 29
VIEW_VALUES = 31
"""Values of a pose and a patch: the eye (3) in axes of the mesh, world_from_plane (9, by rows), the
near plane; `Patch.radius2`, `canvas` (6), `bend`, `low` (2), `high` (2), `reach` and `half`; first
column and row of its samples on the canvas, and the last."""
SLOPE_X, SLOPE_Y, VALUE, CORNER, SIDE = 0, 4, 8, 12, 21
N_PLANE_ROWS = 22
"""Rows of `Setup.planes`: a, b and c of three edges and of 1/z, the corners p, q, r (9), and the
sign of the inner side of the edges as the products of corners have it."""
LEAST, GREATEST, BEHIND, CUT, LIMIT, CHORD_X, CHORD_Y, CHORD = 0, 1, 2, 3, 4, 7, 10, 13
N_BOUND_ROWS = 16
"""Rows of `Setup.bounds`, see `FacePlanes`; `LIMIT` (3) is what an edge is above at all samples of
a tile where it is at all corners of its box, computed in float32. At the tile of a column and a
row, chord k is `CHORD_X` column + `CHORD_Y` row + `CHORD`: above 1 where its edge has all samples
of the tile inside, and below -1 where it has all of them outside."""
FIRST_COLUMN, LAST_COLUMN, FIRST_ROW, LAST_ROW, FACE = range(5)
N_TILE_ROWS = 5
"""Rows of `Setup.tiles`: the tiles that a face may reach, and its number."""


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


class Vertices(NamedTuple):
    """Vertices of a cluster in axes of a plane and on the canvas, (VERTICES,) each.

    `x`, `y`, `z` are in axes of the plane; `across` and `along`, float32, the place in it, and `u`
    and `v`, float32, that on the canvas, in samples. Those of a vertex before the near plane or
    beyond `Patch.radius2` are 0 and NaN, and so is `unknown`, which is 0 for others.
    """

    x: FloatArray
    y: FloatArray
    z: FloatArray
    across: NDArray[np.float32]
    along: NDArray[np.float32]
    u: NDArray[np.float32]
    v: NDArray[np.float32]
    unknown: NDArray[np.float32]


class Setup(NamedTuple):
    """Faces of a cluster, in rows of `SLOTS`: see `SLOPE_X`, `LEAST` and `FIRST_COLUMN`."""

    planes: FloatArray
    bounds: NDArray[np.float32]
    tiles: NDArray[np.int32]


class Samples(NamedTuple):
    """Arrays of a `Patch` that `cover` reads."""

    centres: FloatArray
    x: NDArray[np.float32]
    y: NDArray[np.float32]


class Image(NamedTuple):
    """Image of the tiles of a patch.

    `inverse`, (T, 16) float32, has 1/z and `face`, (T, 16) int32, the face of each sample;
    `inverse` is 0 for none, and `face` is then undefined. `bound`, (T,) float32, is not above
    any 1/z of a tile; it is negative for a tile that nothing is drawn on, whose samples are
    undefined. There is room for three rows more.
    """

    inverse: NDArray[np.float32]
    face: NDArray[np.int32]
    bound: NDArray[np.float32]


class Listed(NamedTuple):
    """Faces of a cluster that wait to be drawn, with the tiles that they may cover.

    Attributes
    ----------
    tiles, whole : (N,) int32
        Tiles of all faces, one after the other, of which a face may cover a part, and those that it
        covers; with room for `TILES_AT_A_TIME` and those of one more face.
    slots : (SLOTS,) int64
        Faces.
    ends : (SLOTS, 2) int64
        The ends of their tiles in both lists.
    is_drawn : (SLOTS,) bool
        False for faces that are counted only.
    bit_indices : (256, 8) uint8
        Table that lists the bits of a mask.
    """

    tiles: NDArray[np.int32]
    whole: NDArray[np.int32]
    slots: NDArray[np.int64]
    ends: NDArray[np.int64]
    is_drawn: NDArray[np.bool_]
    bit_indices: NDArray[np.uint8]


class Workspace(NamedTuple):
    """Scratch of one thread.

    `pose` has `VIEW_VALUES`; `lanes` are for the lens; `forward`, (K,) float64, `seen`, (K + 16,)
    int32, and `ordered`, (K,) int32, are of clusters, `bucket_ends` of `order_by_depth`.
    """

    pose: FloatArray
    vertices: Vertices
    setup: Setup
    listed: Listed
    lanes: LaneScratch
    forward: FloatArray
    seen: NDArray[np.int32]
    ordered: NDArray[np.int32]
    bucket_ends: NDArray[np.int32]


def make_workspace(n_clusters: int, n_tiles: int) -> Workspace:
    """Scratch for a mesh of some clusters, up to a multiple of `LANES`, and patches of n tiles."""
    singles, places = (aligned_zeros((k, VERTICES + LANES), np.float32) for k in (3, 2))
    return Workspace(
        pose=np.zeros(VIEW_VALUES),
        vertices=Vertices(*aligned_zeros((3, VERTICES + LANES), np.float64), *places, *singles),
        setup=Setup(
            aligned_zeros(N_PLANE_ROWS * SLOTS, np.float64),
            aligned_zeros(N_BOUND_ROWS * SLOTS, np.float32),
            aligned_zeros(N_TILE_ROWS * SLOTS, np.int32),
        ),
        listed=Listed(
            tiles=np.empty(n_tiles + TILES_AT_A_TIME + LANES, np.int32),
            whole=np.empty(n_tiles + TILES_AT_A_TIME + LANES, np.int32),
            slots=np.empty(SLOTS, np.int64),
            ends=np.empty((SLOTS, 2), np.int64),
            is_drawn=np.empty(SLOTS, np.bool_),
            bit_indices=bit_table(),
        ),
        lanes=lane_scratch(),
        forward=aligned_zeros(n_clusters, np.float64),
        seen=np.empty(n_clusters + LANES, np.int32),
        ordered=np.empty(n_clusters, np.int32),
        bucket_ends=np.empty(BUFFER_SIZE, np.int32),
    )


class FacePlanes(NamedTuple):
    """Planes of a face: three through the eye and its edges, inner side positive, and 1/z.

    e_i = a_i x + b_i y + c_i, i < 3, is in units of its doubt, which is more than rounding, to
    float32 within a block: a sample is inside where each is above 1, and outside where one is below
    -1. Between them `is_inside_exactly` decides, from the corners of the face in its slot.

    1/z = a_3 x + b_3 y + c_3 must be above `behind` and not above `cut`. It is then put between
    `least` and `greatest`, its values at the corners: a sample is beyond them by rounding alone.
    """

    a0: float
    a1: float
    a2: float
    a3: float
    b0: float
    b1: float
    b2: float
    b3: float
    c0: float
    c1: float
    c2: float
    c3: float
    least: float
    greatest: float
    behind: float
    cut: float
    limit0: float
    limit1: float
    limit2: float
    slot: int


class Chords(NamedTuple):
    """Chords of a face on the canvas, see `CHORD_X`: a column + b row + c of each of three."""

    a0: float
    a1: float
    a2: float
    b0: float
    b1: float
    b2: float
    c0: float
    c1: float
    c2: float
