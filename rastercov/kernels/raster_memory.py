"""Data layout of the CPU rasteriser: constants, and the records that its stages read and write.

Scratch arrays are short and hold rows of `LANES` values, which the row constants name, so that they
stay in the level-1 cache.
"""

import math
from collections import namedtuple
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

STEP_BITS = 8
STEPS = 1 << STEP_BITS
HALF_SAMPLE = STEPS // 2
"""Fixed-point steps in a sample, as many as graphics devices have, and in half a sample. Shifts
divide by it: `//` would test for zero."""
GUARD_BAND = 1 << 29
"""Steps from the image origin beyond which a vertex is clipped: edge functions then fit 64 bits."""
NEEDS_CLIPPING, BEHIND = 2**31 - 1, 2**31 - 2
"""Image position of a vertex beyond the guard band, and of one before the near plane."""
CLIP_CORNERS = 8
"""Most corners of a triangle that is cut by five planes."""
LARGE = 100 * STEPS
"""Steps across a triangle beyond which 32 bits do not hold its edge functions."""

SIDE_BITS = 2
SIDE = 1 << SIDE_BITS
"""Samples along the side of a block, and blocks along the side of a tile."""
LANES, ALL_LANES = SIDE * SIDE, 0xFFFF
"""Values in a vector: the samples of a block, the blocks of a tile, or as many faces."""
FOURFOLD = 1 << 3 * LANES | 1 << 2 * LANES | 1 << LANES | 1
"""Multiplier that repeats a mask of `LANES` bits four times in a 64-bit word."""
LANE_X, LANE_Y = [k % SIDE for k in range(LANES)], [k // SIDE for k in range(LANES)]
"""Column and row of each lane in a block or tile."""
STRIP_BITS = 4
"""Blocks in a row that are cleared together, as a power of 2."""
MOST_WEIGHT = 255
"""Largest weight of a sample, a byte."""
CELL_BITS = 2 * SIDE_BITS
"""Samples along the side of a cell, a tile whose depth is bounded, as a power of 2."""

FACES, VERTICES = 64, 64
"""Most faces and vertices of a cluster. Corners of clipped faces follow its vertices."""
BUFFER_SIZE = 256
"""Values of each scratch array of a cluster; a byte can number as many vertices."""
CLEAR_ALL_SAMPLES = 128
"""Samples of an image for each cluster below which the whole image is cleared at once."""
MIN_VECTOR_FACES = 4
"""Faces of a vector from which on the 2 x 2-block path is faster than the tile path."""
FACES_IN_VAIN = 192
"""Faces of clusters that filled no sample after which the depth of the cells is bounded again."""
DEPTH_BUCKETS = 64
"""Ranges of depth by which the clusters of a band are ordered; at most `BUFFER_SIZE`."""
PREFETCH_DISTANCE = 2
"""Clusters between the one that is drawn and the one whose vertices and faces are prefetched."""
CACHE_LINE = 64
"""Bytes of a cache line; where lines are longer, some are prefetched twice."""
LINE_BITS = 4
"""Face counts in a cache line, as a power of 2."""

EDGE, EDGE_DX, EDGE_DY, TILE_EDGE, BLOCK_EDGE = 0, 3, 6, 9, 12
"""Rows of `edges`, three each (one an edge function, in units of `STEPS`). Of each triangle of a
vector: the value at the first sample of its first block, the step to the next column, and to the
next row. Of one triangle: the values at the first samples of the blocks of a tile, and the
differences between the samples of a block and its first sample."""
FIRST_X, LAST_X, FIRST_Y, LAST_Y, FACE, COVERAGE = 0, 1, 2, 3, 4, 5
"""Rows of `Setup.bounds`: the samples that a triangle reaches, its face index, and its coverage
mask where it reaches at most 2 x 2 samples."""
ORIGIN, SLOPE_X, SLOPE_Y = 0, 1, 2
"""Rows of `Setup.plane64`: 1/z at the first sample of the image, its steps to the next column and
row."""
STEP_X, STEP_Y, LEAST, GREATEST = 0, 1, 2, 3
"""Rows of `Setup.plane32`: the steps of 1/z again, and its least and greatest value at a corner."""
EYE, INTRINSICS, NEAR, MAGNIFICATION = 9, 12, 16, 17
CAMERA_VALUES = 18
"""Values of a camera: rotation world_from_camera (9, by rows), camera centre (3), fx, fy, cx, cy in
samples, depth of the near plane in metres, and the greatest magnification of a length parallel to
the image over its depth, in samples."""
LEFT, RIGHT, TOP, BOTTOM, FORWARD = range(5)
PLANE, NORMAL_LENGTH, FRUSTUM_PLANES = 4, 3, 5
"""Values of a plane of a frustum: the inward normal (3) of a side or the camera axis, and its
length."""
CENTRE, RADIUS, CONE_AXIS, CONE_COS, CONE_SIN, PLANE_OFFSET, ALTITUDE = 0, 3, 4, 7, 8, 9, 10
BOUNDS_OF_CLUSTER = 11
"""Rows of `Clusters.bounds`."""

Mesh = namedtuple("Mesh", "points corners faces lines")
"""Pointers to the arrays of `Clusters` that are read for each face or vertex."""
Cluster = namedtuple(
    "Cluster", "first_vertex end_vertex first_slot end_slot first_line end_line is_safe"
)
"""Ranges of one cluster in `Mesh`; `is_safe` is not 0 where no vertex can need clipping."""
Vertices = namedtuple("Vertices", "u v w x y")
"""Pointers to the projected vertices of a cluster: u, v in steps, not rounded; 1/z; u, v rounded to
whole steps, or `NEEDS_CLIPPING` or `BEHIND`."""
Bins = namedtuple(
    "Bins", "samples_2x2 larger hidden_samples_2x2 hidden_larger wide clipped coverage_2x2"
)
"""Pointers to lists of face slots, see `cull_and_bin`, and to the coverage mask of each slot."""
BinSizes = namedtuple(
    "BinSizes", "samples_2x2 larger hidden_samples_2x2 hidden_larger wide clipped"
)
"""Lengths of the lists of `Bins`."""
Faces = namedtuple("Faces", "mesh first_slot vertices coverage_2x2")
"""Faces in slots: `Mesh`, the index of slot 0 there, `Vertices`, and the masks of `Bins`."""
Setup = namedtuple("Setup", "edges bounds plane64 plane32 sample depth masks")
"""Pointers to the set-up of a vector of triangles, in rows: edge functions, sample bounds, plane of
1/z in float64, and in float32. Then one row for each of 2 x 2 samples or blocks of each triangle,
or one for the blocks of a tile: memory index and 1/z of the first sample, and coverage mask."""
Plane = namedtuple("Plane", "origin slope_x slope_y")
"""Plane of 1/z of a face: rows of `Setup.plane64`."""
Workspace = namedtuple(
    "Workspace", "camera frustum vertices bins setup setup_64_bit bit_indices bucket_ends"
)
"""Pointers to the scratch arrays of one thread, by stage."""

Window = namedtuple(
    "Window", "right top bottom hides_back columns height full_x full_y inner first last"
)
"""Band of the image that is drawn: last column, first row, last row; 1 where back faces are hidden;
blocks in a row of memory; rows of the image; columns and rows of blocks below which every block is
wholly inside the image (0 where samples are rolled and a cluster may reach beyond the image); for
each row of blocks the first one that is wholly inside, and the one after the last; for each row of
samples the first one inside, and the one after the last."""
Image = namedtuple("Image", "depth face cell_depth marks is_clear")
"""Pointers to blocks of samples: 1/z, 0 where empty, and the index of the nearest face; to lower
bounds of 1/z in each cell; to marks of strips that are cleared; and whether all are."""
Counts = namedtuple("Counts", "visible drawn with_drawn weights")
"""Pointers to the samples of each face, added to; `drawn` only `with_drawn`; and to how often each
sample of the band counts, in its order, or None where each counts once."""
Target = namedtuple("Target", "window image counts tests_cells")
"""`Window`, `Image` and `Counts` that a band is drawn to, and whether faces are compared with the
bounds of depth in cells before they are filled."""

Poses = namedtuple("Poses", "world_from_camera near cull")
Canvas = namedtuple("Canvas", "magnification intrinsics size inner first last is_rolled")
Buffers = namedtuple("Buffers", "marks depth face cell_depth n_marks kept centres seen ordered")
Output = namedtuple("Output", "visible drawn filled with_drawn weights cell_bounds")
"""Arguments of `count_poses`, which documents them."""
Scratch = namedtuple(
    "Scratch",
    "u v w x y samples_2x2 larger hidden_samples_2x2 hidden_larger wide clipped coverage_2x2 "
    "edges edges_64_bit bounds plane64 plane32 sample depth masks fan_corners fan_faces identity "
    "camera frustum bit_indices bucket_ends polygon polygon_out",
)
"""Scratch arrays of `count_poses` that are as long for any image and mesh."""


def aligned_zeros(shape: int | tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Zeros that start at a cache line, so that no aligned vector crosses into a second one."""
    size = np.dtype(dtype).itemsize
    n_bytes = math.prod(np.atleast_1d(shape).tolist()) * size
    memory = np.zeros(n_bytes + CACHE_LINE, np.uint8)
    start = -memory.ctypes.data % CACHE_LINE
    zeros: NDArray[Any] = memory[start : start + n_bytes].view(dtype).reshape(shape)
    return zeros


def bit_table() -> NDArray[np.uint8]:
    """For each byte the indices of its set bits, in order: stream compaction without a branch."""
    indices = [sorted(range(8), key=lambda k: not bits >> k & 1) for bits in range(256)]
    return np.array(indices, np.uint8).ravel()


def make_scratch() -> Scratch:
    """Scratch arrays of one thread."""
    dtypes: dict[str, DTypeLike] = dict.fromkeys(("u", "v", "w", "plane64", "camera"), np.float64)
    dtypes |= {"plane32": np.float32, "depth": np.float32, "edges_64_bit": np.int64}
    arrays = {
        name: aligned_zeros(BUFFER_SIZE, dtypes.get(name, np.int32)) for name in Scratch._fields
    }
    return Scratch(**arrays)._replace(
        identity=np.arange(LANES, dtype=np.int32),
        bit_indices=bit_table(),
        polygon=np.zeros(3 * CLIP_CORNERS),
        polygon_out=np.zeros(3 * CLIP_CORNERS),
        frustum=np.zeros(FRUSTUM_PLANES * PLANE),
    )
