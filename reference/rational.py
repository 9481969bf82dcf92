"""Visible area in exact rational arithmetic: no rounding anywhere.

Every float that goes in (vertices, K, pose, near limit) is taken as the binary fraction it is, and
everything is kept in whole numbers. With K and the pose applied, a vertex is P = (U, V, W), which
appears at u = U/W, v = V/W; a point of the image is a ray r = (u, v, 1). For a face with corners
A, B, C let n = (B - A) x (C - A) and d = n . A, both times the sign of d. Then

    the ray meets the face where r = a A + b B + c C with a, b, c >= 0, that is, where
    (B x C) . r, (C x A) . r and (A x B) . r have the sign of d: three half-planes of the image,
    its depth there is d / (n . r), so that w = 1/depth = (n . r) / d is affine in the image,
    beyond the near limit where  near (n . r) <= d,  and M is nearer than T where
    d_T (n_M . r) >= d_M (n_T . r):  half-planes again.

Nothing is clipped in space: an image is the image rectangle cut by half-planes. What M hides of T
is cut from T half-plane by half-plane, each leaving a convex piece that stays and one to continue
with.

Of parallel rays P = (fx x + cx, fy y + cy, 1), and w = C - z with C beyond all vertices is in place
of 1/depth: with d = A . (B x C) it is (n . r) / d for n = w_A B x C + w_B C x A + w_C A x B.

A convex polygon is kept as the lines around it and its corners, each the product of two
original lines, so that numbers never grow from cut to cut.

Of two faces whose 1/depth differs by 1e-10 of the greater one or less at every corner of their
common part, the lower index is in front there. Targets hide nothing, and nothing at their depth
hides them. Faces seen edge-on or without area see and hide
nothing.

For tests, at about a millisecond per face; gmpy2, where installed, makes it two or three times as
fast. Shares nothing with the fast path but mesh, camera, pose convention and near limit.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import AnyArray, FloatArray
from rastercov.core.camera import Camera
from rastercov.core.mesh import Mesh
from rastercov.reference.polygons import farthest_of, visible_from

try:
    from gmpy2 import gcd, mpq, mpz
except ImportError:
    from math import gcd

    mpq, mpz = Fraction, int

__all__ = ["image_area", "visible_area"]

Vector = tuple[Any, Any, Any]
"""Three whole numbers: a point (U, V, W) with W > 0, or a line, >= 0 on its inner side."""

TIE = 10**10
"""Depths are equal when they differ by 1/TIE or less."""


class Polygon(NamedTuple):
    """Convex, of positive area: corner i is where line i meets the next one."""

    lines: list[Vector]
    corners: list[Vector]


@dataclass(frozen=True)
class Face:
    """A face as the image has it: where it covers it, and 1/depth = n . r / d, d > 0."""

    half_planes: list[Vector]
    n: Vector
    d: Any
    image: Polygon


def visible_area(
    mesh: Mesh,
    camera: Camera,
    pose: ArrayLike,
    faces: ArrayLike | None = None,
    *,
    cull: bool = False,
    near: float | None = None,
    exact: bool = False,
) -> AnyArray:
    """Area of the image in which each face is the nearest surface, px^2, in the order of `faces`.

    Arguments as for `rastercov.reference.polygons.visible_area`. (N,) float64; with `exact` the
    areas as they are, (N,) object of `Fraction`, and not the floats nearest to them.
    """
    view = RationalView(mesh, camera, pose, cull, near)
    return _array([view.visible(face) for face in view.rows_to_evaluate(faces)], exact)


def image_area(
    mesh: Mesh,
    camera: Camera,
    pose: ArrayLike,
    faces: ArrayLike | None = None,
    *,
    cull: bool = False,
    near: float | None = None,
    exact: bool = False,
) -> AnyArray:
    """Area of each face that would be visible were it alone, (N,) px^2; see `visible_area`."""
    view = RationalView(mesh, camera, pose, cull, near)
    images = [view.face(face) for face in view.rows_to_evaluate(faces)]
    return _array([area_of([face.image] if face else []) for face in images], exact)


def _array(areas: Iterable[Any], exact: bool) -> AnyArray:
    if exact:
        return np.array([_fraction(area) for area in areas], object)
    return np.array([float(area) for area in areas], np.float64)


def _fraction(area: Fraction) -> Fraction:
    return Fraction(int(area.numerator), int(area.denominator))


class RationalView:
    """The faces of a mesh as one camera has them, in whole numbers, worked out when asked for."""

    def __init__(
        self, mesh: Mesh, camera: Camera, pose: ArrayLike, cull: bool, near: float | None
    ) -> None:
        matrix, near = visible_from(mesh, camera, pose, near)
        self.mesh = mesh
        self.cull = cull
        self.faces: dict[int, Face | None] = {}
        self.boxes = _boxes(mesh, camera, matrix, near)
        self.rectangle = rectangle(camera.width, camera.height)

        # Everything times a power of two that makes it whole: lengths, rotation, intrinsics.
        lengths = _binary_places(np.append(mesh.vertices, matrix[:3, 3]))
        turns = _binary_places(matrix[:3, :3])
        pixels = _binary_places(camera.K)
        self.camera = camera
        self.length_scale = 1 << lengths
        self.eye = _whole(matrix[:3, 3], self.length_scale)
        K = [_whole(row, 1 << pixels) for row in camera.K]
        # image_from_world: (U, V, W) = K R^T (p - t)
        self.axes = [
            tuple(sum(K[i][k] * int(R) for k, R in enumerate(column)) for column in columns)
            for columns in [[_whole(row, 1 << turns) for row in matrix[:3, :3]]]
            for i in range(3)
        ]
        self.near = Fraction(near) * (1 << (lengths + turns + pixels))
        # Of parallel rays, in the units of (U, V, W): a metre, and C.
        self.metre = 1 << (lengths + turns)
        self.one = self.metre << pixels
        self.shift = [row[2] * self.metre for row in K]
        if camera.is_parallel:
            self.farthest = int(Fraction(farthest_of(mesh, matrix, near)) * self.one)
            self.axes = [
                tuple(K[i][i] * int(R) for R in _whole(matrix[:3, i], 1 << turns)) for i in range(3)
            ]

    def rows_to_evaluate(self, faces: ArrayLike | None) -> Sequence[int]:
        """Face indices as plain integers."""
        if faces is None:
            return range(self.mesh.n_faces)
        indices = [int(face) for face in np.asarray(faces).ravel()]
        if any(not 0 <= face < self.mesh.n_faces for face in indices):
            raise IndexError(
                f"expected faces of 0 to {self.mesh.n_faces - 1}, got {indices}; change it"
            )
        return indices

    def face(self, index: int) -> Face | None:
        """Face `index` as the image has it; None when it covers nothing."""
        if index not in self.faces:
            self.faces[index] = self._face(index)
        return self.faces[index]

    def _face(self, index: int) -> Face | None:
        a, b, c = (self._project(vertex) for vertex in self.mesh.faces[index])
        if self.camera.is_parallel:
            (a, b, c), w = zip(*map(self._along_rays, (a, b, c)), strict=True)
            sums = zip(*map(times, w, (cross(b, c), cross(c, a), cross(a, b))), strict=True)
            x, y, z = map(sum, sums)
            n, d = (x, y, z), dot(a, cross(b, c))
        else:
            n = cross(difference(b, a), difference(c, a))
            d = dot(n, a)
        is_culled = self.cull and d > 0 and not self.mesh.target_mask[index]
        if d == 0 or is_culled:  # edge-on; seen from behind
            return None
        sign = 1 if d > 0 else -1
        n, d = times(sign, n), sign * d
        half_planes = [times(sign, cross(p, q)) for p, q in ((b, c), (c, a), (a, b))]
        if self.camera.is_parallel:
            least = self.farthest - self.near
            if max(w) > least:
                top, bottom = least.numerator, least.denominator * self.one
                half_planes.append(difference((0, 0, top * d), times(bottom, n)))
        elif min(a[2], b[2], c[2]) < self.near:
            top, bottom = self.near.numerator, self.near.denominator
            half_planes.append(difference((0, 0, bottom * d), times(top, n)))
        half_planes = [reduce_line(line) for line in half_planes]
        image = clip(self.rectangle, half_planes)
        return Face(half_planes, n, d, image) if image else None

    def _project(self, vertex: int) -> Vector:
        p = difference(_whole(self.mesh.vertices[vertex], self.length_scale), self.eye)
        u, v, w = (dot(axis, p) for axis in self.axes)
        return u, v, w

    def _along_rays(self, p: Vector) -> tuple[Vector, Any]:
        """The same of parallel rays, and w."""
        return (p[0] + self.shift[0], p[1] + self.shift[1], self.one), self.farthest - p[2]

    def visible(self, index: int) -> Any:
        """Visible area of face `index`, exact."""
        face = self.face(index)
        if face is None:
            return mpq(0)
        occluders = [h for other in self._rivals(index) if (h := self._hides(other, index, face))]
        pieces = [face.image]
        for half_planes in occluders:
            pieces = minus(pieces, half_planes)
        return area_of(pieces)

    def _rivals(self, index: int) -> Iterable[int]:
        """Faces that may hide part of face `index`: boxes that overlap and are not all behind."""
        low, high, least, greatest = self.boxes
        maybe = (low <= high[index]).all(axis=1) & (low[index] <= high).all(axis=1)
        maybe &= greatest >= least[index] * (1 - 10 / TIE)
        maybe &= ~self.mesh.target_mask
        maybe[index] = False
        return map(int, np.flatnonzero(maybe))

    def _hides(self, index: int, hidden: int, face: Face) -> list[Vector] | None:
        """Half-planes that bound what face `index` hides of face `hidden`; None for nothing."""
        other = self.face(index)
        if other is None or (common := clip(face.image, other.half_planes)) is None:
            return None
        # 1/depth of the other over that of this face, times d d'
        theirs = [face.d * dot(other.n, corner) for corner in common.corners]
        ours = [other.d * dot(face.n, corner) for corner in common.corners]
        pairs = list(zip(theirs, ours, strict=True))
        if all(abs(m - t) * TIE <= max(m, t) for m, t in pairs):
            is_before = index < hidden and not self.mesh.target_mask[hidden]
            return other.half_planes if is_before else None
        if all(m >= t for m, t in pairs):
            return other.half_planes
        if all(m <= t for m, t in pairs):
            return None
        is_nearer = reduce_line(difference(times(face.d, other.n), times(other.d, face.n)))
        return [*other.half_planes, is_nearer]


def rectangle(width: int, height: int) -> Polygon:
    """The image: 0 <= u <= width, 0 <= v <= height."""
    # Inward normals turn one way round the polygon, so that products of neighbours have W > 0.
    sides = ((0, 1, 0), (-1, 0, width), (0, -1, height), (1, 0, 0))
    lines: list[Vector] = [(mpz(a), mpz(b), mpz(c)) for a, b, c in sides]
    return Polygon(lines, [cross(lines[i], lines[(i + 1) % 4]) for i in range(4)])


def cut(polygon: Polygon, line: Vector) -> tuple[Polygon | None, Polygon | None]:
    """Two parts of a polygon: on the inner side of `line`, and beyond; None for one of no area."""
    values = [dot(line, corner) for corner in polygon.corners]
    if min(values) >= 0:
        return polygon, None
    if max(values) <= 0:
        return None, polygon
    inner = _part(polygon, line, values)
    return inner, _part(polygon, times(-1, line), [-value for value in values])


def _part(polygon: Polygon, line: Vector, values: list[Any]) -> Polygon:
    """Inner side of a line that crosses the polygon, given its values at the corners."""
    n = len(values)
    # Corners inside follow one another. Line i runs from corner i - 1 to corner i, so that one line
    # more than corners stays.
    first = next(i for i in range(n) if values[i - 1] <= 0 < values[i])
    run = [(first + i) % n for i in range(1 + sum(value > 0 for value in values))]
    lines = [polygon.lines[i] for i in run]
    corners = [polygon.corners[i] for i in run[:-1]]
    corners += [cross(lines[-1], line), cross(line, lines[0])]
    return Polygon([*lines, line], corners)


def clip(polygon: Polygon | None, half_planes: Iterable[Vector]) -> Polygon | None:
    """Intersection of a polygon with all half-planes; None when that has no area."""
    for line in half_planes:
        if polygon is None:
            break
        polygon = cut(polygon, line)[0]
    return polygon


def minus(pieces: list[Polygon], half_planes: list[Vector]) -> list[Polygon]:
    """Convex pieces that remain of convex pieces without what all half-planes have in common."""
    remaining = []
    for piece in pieces:
        slices = []
        inside: Polygon | None = piece
        for line in half_planes:
            if inside is None:
                break
            inside, beyond = cut(inside, line)
            if beyond:
                slices.append(beyond)
        # Nothing in common: the piece stays whole, not in slices.
        remaining += [piece] if inside is None else slices
    return remaining


def area_of(pieces: Iterable[Polygon]) -> Any:
    """Area of polygons together, px^2, as an exact fraction."""
    twice = mpq(0)
    for _, corners in pieces:
        for (x, y, w), (X, Y, W) in zip(corners, corners[1:] + corners[:1], strict=True):
            twice += mpq(x * Y - X * y, w * W)
    return twice / 2


def dot(a: Vector, b: Vector) -> Any:
    """Return a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b: the plane of two points and the eye, or the point where two lines meet."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def difference(a: Vector, b: Vector) -> Vector:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def times(s: object, a: Vector) -> Vector:
    """Return s a."""
    return s * a[0], s * a[1], s * a[2]


def reduce_line(line: Vector) -> Vector:
    """Return the same half-plane in the smallest whole numbers."""
    divisor = gcd(gcd(line[0], line[1]), line[2])
    return line[0] // divisor, line[1] // divisor, line[2] // divisor


def _binary_places(values: FloatArray) -> int:
    """Digits behind the binary point that hold all of `values` exactly."""
    _, exponents = np.frexp(values[values != 0])
    return max(0, 53 - int(exponents.min(initial=53)))


def _whole(values: FloatArray, scale: int) -> Vector:
    """Three floats times `scale`, which makes them whole, as whole numbers."""
    ratios = (value.as_integer_ratio() for value in values.tolist())
    x, y, z = (mpz(top * (scale // bottom)) for top, bottom in ratios)
    return x, y, z


def _boxes(mesh: Mesh, camera: Camera, pose: FloatArray, near: float) -> tuple[FloatArray, ...]:
    """Bounds of each face's image and 1/depth, in floats but wider than any rounding.

    Pixels low, high (F, 2), the whole plane for faces that reach nearer than `near`; 1/depth (F,).
    """
    local = mesh.vertices - pose[:3, 3]
    slack = 1e-13 * np.abs(local).sum(axis=1) * np.abs(pose[:3, :3]).max()
    x, y, z = (local @ pose[:3, :3]).T
    faces = mesh.faces
    if camera.is_parallel:
        w = farthest_of(mesh, pose, near) - z
        uv = np.stack((x, y), axis=1) * (camera.fx, camera.fy) + (camera.cx, camera.cy)
        error = slack[:, None] * (camera.fx, camera.fy) + 1e-13 * np.abs(uv)
        low, high = (uv - error)[faces].min(axis=1), (uv + error)[faces].max(axis=1)
        error = slack + 1e-13 * np.abs(w)
        return low, high, (w - error)[faces].min(axis=1), (w + error)[faces].max(axis=1)
    far, close = z + slack, z - slack
    is_ahead = close > near
    z, close = np.where(is_ahead, (z, close), 1.0)
    low, high = np.empty((2, len(z), 2))
    for axis, f, c, values in ((0, camera.fx, camera.cx, x), (1, camera.fy, camera.cy, y)):
        tangent = np.where(is_ahead, values, 0.0) / z
        error = f * (1 + np.abs(tangent)) * slack / close + 1e-13 * (f * np.abs(tangent) + abs(c))
        low[:, axis] = np.where(is_ahead, f * tangent + c - error, -np.inf)
        high[:, axis] = np.where(is_ahead, f * tangent + c + error, np.inf)
    greatest = np.where(is_ahead, 1 / close, 1.001 / near)[faces].max(axis=1)
    farthest = far[faces].max(axis=1)
    hidden = farthest < near  # by the near plane: 1/depth of 0 hides nothing
    least = 0.999999 / np.maximum(farthest, near)
    return (
        low[faces].min(axis=1),
        high[faces].max(axis=1),
        least,
        np.where(hidden, 0.0, greatest),
    )
