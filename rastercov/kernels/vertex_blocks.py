"""Projected vertices, eight at a time by SIMD, for the loops over faces in one pose.

A projected vertex has the columns below.
"""

from numba.core import types

from rastercov.kernels.simd import joined, load
from rastercov.kernels.simd_kernel import loop, simd

X, Y, Z, RIGHT, DOWN, U, V, STATE = range(8)
"""Camera axes, metres; x/z and y/z, for a pinhole; pixels; and the state of the vertex."""
COLUMNS = 8
"""Columns in all."""
BEHIND, AHEAD, INSIDE = 0.0, 1.0, 2.0
"""States: before the near plane, or outside the valid region of the lens; beyond it; beyond it and
inside the image."""
AT_A_TIME = 8
"""Vertices that are projected at a time: doubles of the longest registers."""


@simd(returns=types.void)
def project_vertices(n, vertices, pose, near, lens, points):
    """Fill the columns of n vertices, see `criteria.project`; arrays are pointers."""
    axes = [[pose.value(4 * row + column) for row in range(3)] for column in range(4)]
    none, whole = n & 0, n & -AT_A_TIME
    for begin, end, step in ((none, whole, AT_A_TIME), (whole, n, 1)):
        with loop(begin, end, step) as first:
            columns = _columns(
                load(n.builder, vertices.at(first * 3).pointer, 3 * step), axes, near, lens
            )
            for k, row in enumerate(transposed(columns)):
                row.store(points.at(first * COLUMNS + k * step).pointer)


def _columns(vertices, axes, near, lens):
    """Columns of a projected vertex, see `vertex_blocks`."""
    *turn, centre = axes
    a, b, c = (vertices.every(3, axis) - centre[axis] for axis in range(3))
    x, y, z = (a * p + b * q + c * r for p, q, r in turn)
    is_ahead = z >= near
    depth = z.where(is_ahead, 1.0)
    right, down = (each.where(is_ahead, 0.0) / depth for each in (x, y))
    u, v = right * lens.fx + lens.cx, down * lens.fy + lens.cy
    is_inside = is_ahead & (u >= 0) & (u <= lens.width) & (v >= 0) & (v <= lens.height)
    state = z.like(INSIDE).where(is_inside, z.like(AHEAD).where(is_ahead, BEHIND))
    return [x, y, z, right, down, u, v, state]


def transposed(columns):
    """Lanes of 2^n columns, row by row, in as many vectors of the same length.

    Each step moves the lowest bit of a lane's place to the top; after as many as a lane's number
    has bits, those of the number are above those of the column.
    """
    for _ in range(len(columns[0]).bit_length() - 1):
        pairs = [joined(*pair) for pair in zip(columns[::2], columns[1::2], strict=True)]
        columns = [pair.every(2, start) for start in (0, 1) for pair in pairs]
    return columns
