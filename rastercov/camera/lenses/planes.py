"""Ideal planes: pinhole cameras that together see the valid region of a lens.

Straight edges of a mesh are straight in an ideal plane, so visibility is computed there; the lens
then moves the pieces to pixels. A lens that sees up to `ONE_PLANE_DEG` from its axis has one plane,
a wider one the sides of a cube that it reaches.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rastercov.base.checks import LONGEST, MAX_IMAGE_SIDE
from rastercov.camera.camera import Camera
from rastercov.camera.lenses import balls
from rastercov.camera.lenses.region import MARGIN, border_pixels
from rastercov.kernels import lens_formulas
from rastercov.kernels.lens import SECTORS, jacobian_many, unproject_many

FloatArray = NDArray[np.float64]

ONE_PLANE_DEG = 72.0
"""Largest angle from the axis of a lens with one plane, unless its base is a plane itself."""
CELLS = 24
"""Cells of a side of a plane's bounding box over which bounds are taken."""
SAME_CORNER = 1e-9
"""Distance of corners of a region that are one, in units of the plane."""
HOLE_SCALE = 2.0
"""Size of the box that holes are cut to, in that of the region: sides of a hole that are not those
of the valid cone are far from the region, so that no sliver is left between the two."""
DEEPEST_CELL, MOST_CELLS = 6, 20_000
"""Divisions of a cell that is too large for a bound, and cells at which they end."""
RADII = tuple(np.geomspace(1e-3, 1.5, 24).tolist())
"""Radii, in units of the plane, at which bounds are tried."""

CUBE: tuple[tuple[tuple[int, int, int], ...], ...] = (
    ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
    ((0, 0, -1), (0, 1, 0), (1, 0, 0)),
    ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
    ((-1, 0, 0), (0, 1, 0), (0, 0, -1)),
)
"""Rotations of the sides of a cube: front, right, left, down, up, back."""
SQUARE = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))


@dataclass(frozen=True, eq=False)
class IdealPlane:
    """A pinhole camera at the place of a lens, and the part of its plane that the lens maps.

    Attributes
    ----------
    frame : (3, 3) float64
        Axes of the pinhole camera, as columns, in axes of the lens: lens_from_plane.
    camera : Camera
        The pinhole; its image holds all of the region that the image of the lens needs.
    region : (K, 2) float64
        Convex polygon in units of the plane, (X / Z, Y / Z); nothing beyond it has a pixel.
    hole : (K, 2) float64 or None
        Convex polygon to be taken out of the region, as by a face in front of everything; it may
        reach beyond the region.
    code : int
    params : (32,) float64
        The lens for the kernels, with longitudes that are continuous on this plane.
    has_pole : bool
        True where (0, 0) is a pole of an equirectangular image, at the border of the region.
    """

    frame: FloatArray
    camera: Camera
    region: FloatArray
    hole: FloatArray | None
    code: int
    params: FloatArray
    has_pole: bool = False

    def parts(self) -> list[FloatArray]:
        """Convex polygons that are the region without the hole."""
        if self.hole is None:
            return [self.region]
        found, rest = [], self.region
        for i in range(len(self.hole)):
            (x0, y0), (x1, y1) = self.hole[i], self.hole[(i + 1) % len(self.hole)]
            line = y0 - y1, x1 - x0, (y1 - y0) * x0 - (x1 - x0) * y0  # inside is positive
            found.append(keep(rest, *(-value for value in line)))
            rest = keep(rest, *line)
            if len(rest) < 3:
                break
        return [part for part in found if len(part) >= 3]

    def reach(self, radius: float) -> tuple[float, float]:
        """Bounds of |u - u0| and |v - v0|, px, of complex points near a real one of the region.

        Parameters
        ----------
        radius : float
            Both coordinates are within it of those of the real point, in units of the plane; of a
            plane with a pole, in units of the distance of the real point from the pole.

        Returns
        -------
        float, float
            Infinite where the lens has a pole or a branch that near.
        """
        x, y, half = self._cells
        if self.has_pole:
            # Longitude does not change with the distance from the pole, and latitude changes less
            # and less: the ring from 1/2 outwards bounds all smaller ones, and a few are tried.
            size = np.hypot(x, y)
            is_ring = size >= 0.5 - max(half)
            x, y, size = x[is_ring], y[is_ring], size[is_ring]
            x, y, near = (
                np.concatenate([z, z / 2, z / 4, z / 8]) for z in (x, y, radius * size + max(half))
            )
            across, down = balls.reach(self.code, self.params, self.frame, x, y, near)
            return float(across.max(initial=0.0)), float(down.max(initial=0.0))
        most_u = most_v = 0.0
        for depth in range(DEEPEST_CELL + 1):
            across, down = self._reach_at(x, y, radius + max(half))
            is_good = np.maximum(across, down) < math.inf
            most_u = max(most_u, float(across[is_good].max(initial=0.0)))
            most_v = max(most_v, float(down[is_good].max(initial=0.0)))
            if is_good.all():
                return most_u, most_v
            x, y = x[~is_good], y[~is_good]
            # No size of cells helps where the point itself has no bound.
            is_own = self.meets(x, y, (0.0, 0.0))
            is_bound = np.isfinite(self._reach_at(x[is_own], y[is_own], radius)).all()
            if depth == DEEPEST_CELL or not is_bound or len(x) > MOST_CELLS:
                break
            # A cell that meets a pole only for its size is divided into four.
            half = (half[0] / 2, half[1] / 2)
            x = np.concatenate([x + i * half[0] for i in (-1, 1, -1, 1)])
            y = np.concatenate([y + i * half[1] for i in (-1, -1, 1, 1)])
            is_near = self.meets(x, y, half)
            x, y = x[is_near], y[is_near]
        return math.inf, math.inf

    def _reach_at(
        self, x: FloatArray, y: FloatArray, radius: float
    ) -> tuple[FloatArray, FloatArray]:
        return balls.reach(self.code, self.params, self.frame, x, y, radius)

    def bend(self) -> float:
        """Bound of the second derivative of pixels along lines of the plane, px / (plane px)^2.

        An edge of length L px in the pinhole's image leaves its chord by at most bend L^2 / 8 px.
        """
        bounds = [2.0 * math.hypot(u, v) / (r * r) for r, u, v in self.reaches]
        return min(bounds, default=math.inf) / (self.camera.fx * self.camera.fx)

    @cached_property
    def reaches(self) -> tuple[tuple[float, float, float], ...]:
        """Radii with their reach, those at which it is finite."""
        found = []
        for radius in RADII:
            across, down = self.reach(radius)
            if not max(across, down) < math.inf:
                break  # a larger radius meets the same pole
            found.append((radius, across, down))
        return tuple(found)

    @cached_property
    def _cells(self) -> tuple[FloatArray, FloatArray, tuple[float, float]]:
        """Centres of cells that cover the region, and half their sides."""
        low, high = self.region.min(axis=0), self.region.max(axis=0)
        half = (high - low) / (2 * CELLS)
        centre = low[:, None] + half[:, None] * (2 * np.arange(CELLS) + 1)
        x, y = (grid.ravel() for grid in np.meshgrid(*centre))
        own = (float(half[0]), float(half[1]))
        is_near = self.meets(x, y, own)
        return x[is_near], y[is_near], own

    def meets(self, x: FloatArray, y: FloatArray, half: tuple[float, float]) -> NDArray[np.bool_]:
        """True for cells that may have a point of the region, by their centres."""
        is_near: NDArray[np.bool_] = _distance(self.region, x, y) <= math.hypot(*half)
        if self.hole is not None:
            is_near &= _distance(self.hole, x, y) >= -math.hypot(*half)
        return is_near


def _distance(polygon: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
    """Greatest signed distance of points from the sides of a convex polygon, < 0 inside."""
    start = polygon
    side = np.roll(polygon, -1, axis=0) - start
    size = np.hypot(side[:, 0], side[:, 1])
    side, start = side[size > 0] / size[size > 0, None], start[size > 0]
    # The polygon runs from x to y, so its inside is at the side (-dy, dx) of an edge.
    across = (x[:, None] - start[:, 0]) * side[:, 1] - (y[:, None] - start[:, 1]) * side[:, 0]
    result: FloatArray = across.max(axis=1)
    return result


def keep(polygon: FloatArray, a: float, b: float, c: float) -> FloatArray:
    """Part (K, 2) of a convex polygon with a x + b y + c >= 0."""
    value = polygon @ (a, b) + c
    corners = []
    for i in range(len(polygon)):
        j = (i + 1) % len(polygon)
        if value[i] >= 0:
            corners.append(polygon[i])
        if (value[i] < 0) != (value[j] < 0):
            t = value[i] / (value[i] - value[j])
            corners.append(polygon[i] + t * (polygon[j] - polygon[i]))
    return np.array(corners).reshape(-1, 2)


def _sides() -> FloatArray:
    """Normals (SECTORS, 2) of the sides of the valid cone, around the z axis."""
    turn = 2 * np.pi * (np.arange(SECTORS) + 0.5) / SECTORS
    return np.column_stack((np.cos(turn), np.sin(turn)))


def _on_plane(slope: float, frame: FloatArray, box: FloatArray) -> tuple[FloatArray, bool]:
    """Polygon of a box inside the cone m <= slope Z (True), or inside m <= slope Z around -z."""
    polygon = box
    for n in _sides():
        # slope Z - n . (X, Y) >= 0, with the ray frame @ (x, y, 1)
        a, b, c = slope * frame[2] - n @ frame[:2]
        polygon = keep(polygon, a, b, c)
        if len(polygon) < 3:
            return np.empty((0, 2)), slope > 0
    # Corners of the cone lie on edges of the cube. What rounding makes two corners of would be an
    # edge without a direction.
    size = np.abs(polygon - np.roll(polygon, 1, axis=0)).max(axis=1)
    return polygon[size > SAME_CORNER], slope > 0


def ideal_planes(
    code: int, params: FloatArray, width: int, height: int, angle: float
) -> tuple[IdealPlane, ...]:
    """Planes that hold the valid region of a lens, which ends at `angle` radians from its axis."""
    if code == lens_formulas.PINHOLE or angle <= math.radians(ONE_PLANE_DEG):
        return (_one_plane(code, params, width, height, angle),)
    focal = _central_focal(code, params)
    half = min(focal, MAX_IMAGE_SIDE / 2.0)
    side = max(2, 2 * math.ceil(half))
    camera = Camera(width=side, height=side, fx=side / 2, fy=side / 2)
    planes = []
    for rows in CUBE:
        frame = np.array(rows, np.float64)
        for box, own in _parts(code, params, frame):
            region, hole = box, None
            if code != lens_formulas.EQUIRECT:
                polygon, is_inside = _on_plane(params[lens_formulas.SLOPE], frame, box)
                if is_inside:
                    region = polygon
                elif len(polygon) >= 3:
                    hole = _on_plane(params[lens_formulas.SLOPE], frame, HOLE_SCALE * box)[0]
            is_all = hole is not None and abs(_area(polygon) - _area(region)) < 1e-12
            if len(region) >= 3 and not is_all:
                has_pole = code == lens_formulas.EQUIRECT and frame[1, 2] != 0
                planes.append(IdealPlane(frame, camera, region, hole, code, own, has_pole))
    return tuple(planes)


def _parts(code: int, params: FloatArray, frame: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """Boxes of a side of the cube, each with parameters that are continuous on it.

    Longitude jumps across the half plane X = 0, Z < 0, and at the poles it has no value; the three
    sides of the cube that they meet are divided along X = 0.
    """
    square = np.array(SQUARE)
    if code != lens_formulas.EQUIRECT or not (abs(frame[0, 0]) == 1 and frame[2, 2] <= 0):
        if code == lens_formulas.EQUIRECT and frame[0, 2] != 0:
            return [(square, _turned(params, float(frame[0, 2])))]
        return [(square, params)]
    sign = float(frame[0, 0])  # X = sign x on this side
    return [
        (keep(square, 1.0, 0.0, 0.0), _turned(params, sign)),
        (keep(square, -1.0, 0.0, 0.0), _turned(params, -sign)),
    ]


def _turned(params: FloatArray, sign: float) -> FloatArray:
    """Parameters of an equirectangular lens with longitudes around a quarter turn."""
    own = params.copy()
    own[lens_formulas.B0], own[lens_formulas.B1], own[lens_formulas.B2] = (
        sign * math.pi / 2,
        0.0,
        sign,
    )
    return own


def _area(polygon: FloatArray) -> float:
    x, y = polygon.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def _central_focal(code: int, params: FloatArray) -> float:
    """Pixels of the image to a unit of the plane, on the axis."""
    slopes = np.empty((1, 2, 3))
    jacobian_many(code, params, np.array([[0.0, 0.0, 1.0]]), slopes)
    (a, b), (c, d) = slopes[0, :, :2]
    return min(math.sqrt(abs(float(a * d - b * c))), LONGEST)


def _one_plane(code: int, params: FloatArray, width: int, height: int, angle: float) -> IdealPlane:
    slope = params[lens_formulas.SLOPE]
    # Corners of the cone: its sides are at the distance `slope` from the axis.
    turn = 2 * np.pi * np.arange(SECTORS) / SECTORS
    region = slope / math.cos(math.pi / SECTORS) * np.column_stack((np.cos(turn), np.sin(turn)))
    rays = np.empty((len(border_pixels(width, height)), 3))
    unproject_many(code, params, border_pixels(width, height), rays)
    seen = rays[:, :2] / rays[:, 2:]
    low, high = region.min(axis=0), region.max(axis=0)
    if np.isfinite(seen).all():
        grown = (MARGIN - 1) * np.ptp(seen, axis=0)
        low = np.maximum(low, seen.min(axis=0) - grown)
        high = np.minimum(high, seen.max(axis=0) + grown)
    focal = _central_focal(code, params)
    focal = min(focal, (MAX_IMAGE_SIDE - 1) / float((high - low).max()))
    camera = Camera(
        width=max(1, math.ceil(focal * (high[0] - low[0]))),
        height=max(1, math.ceil(focal * (high[1] - low[1]))),
        fx=focal,
        fy=focal,
        cx=-focal * low[0],
        cy=-focal * low[1],
    )
    return IdealPlane(np.eye(3), camera, region, None, code, params)
