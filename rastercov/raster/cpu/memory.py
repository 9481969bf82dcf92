"""How the CPU rasteriser lays out what it works on; for `lane_kernels` and `kernels`.

Small numbers of things live in small arrays, in rows of sixteen that the constants name, so that
they stay in the nearest cache.
"""

import math
from collections import namedtuple
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

BITS = 8
STEPS = 1 << BITS
HALF = STEPS // 2
"""Sub-sample steps, as many as graphics devices have. Shifts divide: `//` would test for zero."""
FAR_OUT = 1 << 29
"""Steps from the origin beyond which a vertex is clipped: edges then fit 64 bits with room."""
CLIPPED, BEHIND = 2**31 - 1, 2**31 - 2
"""Steps of a vertex that is, and of one that is because it lies before the near plane."""
CLIP_CORNERS = 8
"""A triangle cut by five planes has at most this many corners."""
LARGE = 100 * STEPS
"""Steps across a triangle beyond which 32 bits do not hold its edge functions."""

SIDE_BITS = 2
SIDE = 1 << SIDE_BITS
"""Samples across a block; and blocks across a group of them."""
LANES, ALL_LANES = SIDE * SIDE, 0xFFFF
"""Samples of a block, blocks of a group, or faces at once."""
FOURFOLD = 1 << 3 * LANES | 1 << 2 * LANES | 1 << LANES | 1
"""Times bits of sixteen: four times the same."""
LANE_X, LANE_Y = [k % SIDE for k in range(LANES)], [k // SIDE for k in range(LANES)]
PATCH_BITS = 4
"""Blocks in a row that are cleared together, as a power of 2."""

FACES, VERTICES = 64, 64
"""Of a cluster, at most. Corners of clipped faces follow its vertices."""
SAMPLES_A_CLUSTER = 128
"""Samples of an image for each cluster below which all of it is cleared at once."""
FEW = 4
"""Triangles from which on it pays to take sixteen together."""
AHEAD = 2
"""Clusters between the one that is drawn and the one whose vertices and faces are fetched."""
CACHE_LINE = 64
"""Bytes that are fetched together; where it is more, some are asked for twice."""
LINE_BITS = 4
"""Counts in them, as a power of 2."""
ROOM = 256
"""Vertices that a byte can tell apart; and enough for all else that a cluster wants."""
E, ACROSS, DOWN, CORNER, INNER = 0, 3, 6, 9, 12
EDGE_ROWS = 15
"""Rows of `edges`, for each of three edge functions, in units of `STEPS`: its value at the first
sample of the first block that a triangle reaches, its step to the next sample and to the next row.
Then those of one triangle: its values at the first samples of sixteen blocks, and what it gains
from there to the other samples of a block."""
FIRST_X, LAST_X, FIRST_Y, LAST_Y, FACE, OWNED = 0, 1, 2, 3, 4, 5
WHOLE_ROWS = 6
"""Rows of `whole`: the samples that the triangle reaches, its face, and which samples it owns where
it reaches at most 2 x 2."""
ORIGIN, SLOPE_X, SLOPE_Y = 0, 1, 2
EXACT_ROWS = 3
"""Rows of `exact`: 1/z at the first sample of the image, its steps to the next sample and row."""
STEP_X, STEP_Y, LEAST, GREATEST = 0, 1, 2, 3
PLANE_ROWS = 4
"""Rows of `plane`: the steps again, and 1/z of the farthest and of the nearest corner."""
EYE, LENS, NEAR, WIDEST = 9, 12, 16, 17
VIEW = 18
"""Figures of a pose: world_from_camera (9), eye (3), fx, fy, cx, cy in samples, the depth below
which a vertex is cut off, and the most that a length parallel to the image, over its depth, is
magnified to, in samples."""

Shape = namedtuple("Shape", "points corners faces")
"""A mesh in clusters: pointers, as in all of these, to what `clusters` made."""
Placed = namedtuple("Placed", "u v w x y")
"""Vertices of a cluster in the image: exact steps, 1/z, and whole steps."""
Window = namedtuple(
    "Window", "right top bottom hides_back columns height full_x full_y inner first last"
)
"""What of the image is drawn: its last column, the first and the last row; whether faces that turn
their back are hidden; blocks in a row of memory, rows of the image; columns and rows of blocks
before which all blocks are inside (0 where samples are rolled), for each row of blocks the first
one inside and the one after the last, and for each row of samples likewise."""
Batch = namedtuple("Batch", "whole exact plane sample here masks")
"""Sixteen triangles: rows of what the constants above name. Then rows for 2 x 2 samples or blocks
of each, or for sixteen blocks of one: where in memory, 1/z at the first sample, and which of a
block's samples a triangle owns."""
Lists = namedtuple("Lists", "tiny small tiny_hidden hidden large clipped owned")
"""Faces of a cluster, see `sift`."""
Image = namedtuple("Image", "depth owner")
"""Blocks of samples: 1/z, 0 where nothing is; and the face."""
Counts = namedtuple("Counts", "visible drawn with_drawn")
"""Samples of each face to add to; `drawn` only where asked for."""


def aligned_zeros(shape: int | tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Zeros that start with a cache line, so that sixteen words never lie in two."""
    size = np.dtype(dtype).itemsize
    n_bytes = math.prod(np.atleast_1d(shape).tolist()) * size
    octets = np.zeros(n_bytes + CACHE_LINE, np.uint8)
    start = -octets.ctypes.data % CACHE_LINE
    zeros: NDArray[Any] = octets[start : start + n_bytes].view(dtype).reshape(shape)
    return zeros
