"""Cameras of the loops: the image of a point, its derivative, and the pixel densities, by numba.

The vertices of a mesh are projected eight at a time by SIMD, and have the columns below.

A `Lens` is a pinhole, whose formulas are closed; a `CurvedLens` is any other lens. The density of
a surface follows from the derivative J (2, 3) of pixels by the point, px/m, and its unit normal n:
its least singular value in the plane of the surface (`along`), its least singular value, which is
that of a target facing the camera (`facing`), and |J_u x J_v . n| (`per_m2`).

T. Duff et al. Building an Orthonormal Basis, Revisited. 2017 (tangents of a normal).
"""

import functools
import math
from collections import namedtuple
from collections.abc import Callable
from typing import Any

import numpy as np
from numba.core import types
from numba.extending import overload
from numpy.typing import NDArray

from rastercov.kernels import lens as kernels
from rastercov.kernels.compiler import PartCompiler
from rastercov.kernels.jit import allocation_free, by_type, called_whole, part_of
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
    """Columns of a projected vertex, see `project_vertices`."""
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


FloatArray = NDArray[np.float64]

MOST_SIDES = 132
"""Room for the sides of a region: a cone of 128 sides cut by a square."""


Lens = namedtuple("Lens", "fx fy cx cy width height")
"""Intrinsics and image size of a pinhole, pixels, float."""


CurvedLens = namedtuple(
    "CurvedLens",
    "code params width height by_distance frames own_params regions region_sides holes "
    "hole_sides longest parts_of is_graded bends tolerance",
)
"""A lens for the loops over faces; arrays read-only, one row for each of its planes.

Attributes
----------
code, params
    The lens.
width, height : float
    Image size, px.
by_distance : bool
    Sharpness depends on the distance, not on the depth.
frames : (N, 3, 3) float64
    lens_from_plane.
own_params : (N, 32) float64
regions, holes : (N, MOST_SIDES, 2) float64
region_sides, hole_sides : (N,) int64
longest : (N, M) float64
parts_of : (N,) int64
is_graded : (N,) bool
bends : (N,) float64
tolerance : float
    See `PlaneRecord` of `lens_planes`.
"""


Slopes = namedtuple("Slopes", "fx fy right down z")
"""Derivative of a pinhole at the point z (right, down, 1).

Its rows are (fx, 0, -fx right) / z and (0, fy, -fy down) / z; z remains a factor, because its
square would underflow for a very small mesh.
"""


CurvedSlopes = namedtuple("CurvedSlopes", "ux uy uz vx vy vz")
"""Derivative of any lens: the rows J_u and J_v, px/m."""


def by_lens(curved: Any) -> Any:
    """Function of a pinhole that is `curved` for other lenses; both have the argument `lens`."""
    return by_type("lens", CurvedLens, curved)


def by_slopes(curved: Any) -> Any:
    """Function of the derivative of a pinhole that is `curved` for that of other lenses."""
    return by_type("slopes", CurvedSlopes, curved)


def or_of_lanes(function: Callable[..., float]) -> Any:
    """Function of numbers in compiled loops, and the method of its name of SIMD vectors."""

    def either(*values: Any) -> Any:
        return getattr(values[0], function.__name__)(*values[1:])

    functools.update_wrapper(either, function)
    options: Any = {
        "forceinline": True, "_nrt": False, "nogil": True, "error_model": "numpy",
        "no_cpython_wrapper": True, "no_cfunc_wrapper": True, "pipeline_class": PartCompiler,
    }  # fmt: skip
    overload(either, jit_options=options, strict=False)(lambda *values: function)
    return either


@or_of_lanes
def sqrt(value):
    """Square root."""
    return math.sqrt(value)


@or_of_lanes
def absolute(value):
    """Absolute value."""
    return abs(value)


@or_of_lanes
def sign(value):
    """1 with the sign of a value, also of -0.0."""
    return math.copysign(1.0, value)


@or_of_lanes
def maximum(value, other):
    """Greater of both; `other` where one is NaN."""
    return value if value > other else other


def place_through_lens(lens, near, x, y, z):
    """The same through a lens, whose near planes are a cube if it has several ideal planes."""
    is_wide = lens.frames.shape[0] > 1
    depth = max(abs(x), abs(y), abs(z)) if is_wide else z
    if not (depth >= near and kernels.is_valid(lens.params, x, y, z)):
        return depth, False
    u, v = _project(lens.code, lens.params, x, y, z)
    return depth, 0.0 <= u <= lens.width and 0.0 <= v <= lens.height


@allocation_free
def _project(code, params, x, y, z):
    """Pixel of a ray of the valid region."""
    return kernels.project(code, params, x, y, z)


@by_lens(place_through_lens)
def place(lens, near, x, y, z):
    """Depth of a point in camera axes; True if it is beyond the near plane and in the image."""
    if not z >= near:
        return z, False
    u, v = lens.fx * (x / z) + lens.cx, lens.fy * (y / z) + lens.cy
    return z, 0.0 <= u <= lens.width and 0.0 <= v <= lens.height


def focus_through_lens(lens, x, y, z):
    """The same through a lens: of a wide one the distance."""
    return math.sqrt(x * x + y * y + z * z) if lens.by_distance else z


@by_lens(focus_through_lens)
def focus_depth(lens, x, y, z):
    """Depth of a point in camera axes that its sharpness depends on, metres."""
    return z


def jacobian_through_lens(lens, x, y, z):
    """The same through a lens."""
    ux, uy, uz, vx, vy, vz = _jacobian(lens.code, lens.params, x, y, z)
    return CurvedSlopes(ux, uy, uz, vx, vy, vz)


@called_whole
def _jacobian(code, params, x, y, z):
    """See `lens.jacobian`, which is long."""
    return kernels.jacobian(code, params, x, y, z)


@by_lens(jacobian_through_lens)
def jacobian(lens, x, y, z):
    """Derivative of the image at a point in camera axes, beyond the near plane and in view."""
    return Slopes(lens.fx, lens.fy, x / z, y / z, z)


@part_of
def _largest(ux, uy, uz, vx, vy, vz):
    """Largest singular value of a derivative, by the products of its rows."""
    uu, vv = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz
    uv = ux * vx + uy * vy + uz * vz
    return math.sqrt(0.5 * (uu + vv + math.sqrt((uu - vv) * (uu - vv) + 4.0 * uv * uv)))


def along_through_lens(slopes, a, b, c):
    """The same of any derivative: the product of both singular values over the greater one."""
    ux, uy, uz, vx, vy, vz = slopes
    det = abs((uy * vz - uz * vy) * a + (uz * vx - ux * vz) * b + (ux * vy - uy * vx) * c)
    # In the plane, without the part along its normal.
    un, vn = ux * a + uy * b + uz * c, vx * a + vy * b + vz * c
    ux, uy, uz = ux - un * a, uy - un * b, uz - un * c
    vx, vy, vz = vx - vn * a, vy - vn * b, vz - vn * c
    largest = _largest(ux, uy, uz, vx, vy, vz)
    return det / largest if largest > 0 else 0.0


def density_along(fx, fy, right, down, z, a, b, c):
    """Pixels a metre of a pinhole along the worst direction, of numbers or lanes; see `along`.

    With tangents e_1, e_2 of the surface column i of the derivative is
    ((fx (e_ix - x/z e_iz))/z, (fy (e_iy - y/z e_iz))/z). Its singular values are the pixels a metre
    along the best and the worst direction on the surface.
    """
    way = sign(c)
    d = absolute(way) / -(way + c)
    e = a * b * d
    first_x, first_y, first_z = way * a * a * d + 1.0, way * e, -way * a
    second_x, second_y, second_z = e, way + b * b * d, -b
    a1, a2 = (first_x - right * first_z) * fx, (second_x - right * second_z) * fx
    b1, b2 = (first_y - down * first_z) * fy, (second_y - down * second_z) * fy
    total = a1 * a1 + a2 * a2 + b1 * b1 + b2 * b2
    det = absolute(a1 * b2 - a2 * b1)
    gap = total * total - (det * det) * 4.0
    return det / (sqrt((total + sqrt(maximum(gap, 0.0))) / 2) * z)


_density_along = part_of(density_along)


@by_slopes(along_through_lens)
def along(slopes, a, b, c):
    """Pixels a metre along the worst direction of a surface with the unit normal (a, b, c)."""
    return _density_along(slopes.fx, slopes.fy, slopes.right, slopes.down, slopes.z, a, b, c)


def facing_through_lens(slopes):
    """The same of any derivative J: J is 0 along the ray, so its least singular value is across."""
    ux, uy, uz, vx, vy, vz = slopes
    a, b, c = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    largest = _largest(ux, uy, uz, vx, vy, vz)
    return math.sqrt(a * a + b * b + c * c) / largest if largest > 0 else 0.0


@by_slopes(facing_through_lens)
def facing(slopes):
    """Pixels a metre along the worst direction of a target that faces the camera.

    The derivative is J = D (1 0 -x/z; 0 1 -y/z) / z, D = diag(fx, fy), and J p = 0 for the ray
    p = (x, y, z): restricted to the plane perpendicular to it, it has the singular values of
    J J^T = D (1 + q q^T) D / z^2 with q = (x/z, y/z), which is at least min(fx, fy)^2 / z^2. The
    result is min(fx, fy) / z: exact for fx = fy, and where q is along the axis of the greater one;
    a lower bound elsewhere.
    """
    return min(slopes.fx, slopes.fy) / slopes.z


def per_m2_through_lens(slopes, a, b, c):
    """The same of any derivative."""
    ux, uy, uz, vx, vy, vz = slopes
    return abs((uy * vz - uz * vy) * a + (uz * vx - ux * vz) * b + (ux * vy - uy * vx) * c)


def density_per_m2(fx, fy, right, down, z, a, b, c):
    """Pixels a square metre of a pinhole, of numbers or lanes: fx fy h / z^3, h = z |n . ray|."""
    return absolute(a * right + b * down + c) / z * fx / z * fy


_density_per_m2 = part_of(density_per_m2)


@by_slopes(per_m2_through_lens)
def per_m2(slopes, a, b, c):
    """Pixels on a square metre of a surface with the unit normal (a, b, c)."""
    return _density_per_m2(slopes.fx, slopes.fy, slopes.right, slopes.down, slopes.z, a, b, c)
