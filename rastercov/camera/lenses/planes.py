"""Valid region of a lens, and ideal planes: pinhole cameras that together see it.

The region is a cone around the z axis; the lens is proved to be injective on it, and on one with
SECTORS flat sides around it, to which surfaces are cut before the cone itself is looked at.
A polynomial that was fitted inside the image may fold outside it, and then two rays have one pixel.
So nothing outside the valid region is ever projected. The proof has three parts:

1. The base is injective up to an angle known in closed form (`base_limit`).
2. On the disc of radius s of the plane of the base the distortion is injective. Its derivative
   there has a symmetric part of at least

       min(f / r, f') - t(r),   f the radial part,
       t(r) = 6 r |(P1, P2)| + 2 r |(S1, S3)| + 4 r^3 |(S2, S4)|,

   and a map whose derivative has a positive symmetric part on a convex set is injective on it.
   Where the tangential terms take the radially distorted point, both parts are injective:
   min(f / r, f') > 0 and t(f) < 1. `certified_radius` proves it by their Taylor series, from
   the axis on.
3. The horizon of a tilted sensor is beyond the image of the disc.

The region is then made as small as covers the image, and 2 % more: a lens is known no further.

Straight edges of a mesh are straight in an ideal plane, so visibility is computed there; the lens
then moves the pieces to pixels. A lens that sees up to `ONE_PLANE_DEG` from its axis has one plane,
a wider one the sides of a cube that it reaches.
"""

import math
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import zip_longest

import numpy as np
from numpy.polynomial import Polynomial

from rastercov.base.checks import LONGEST, MAX_IMAGE_SIDE
from rastercov.base.errors import CameraError
from rastercov.base.memory import BoolArray, FloatArray
from rastercov.camera.camera import WIDEST_DEG, Camera, border_of
from rastercov.camera.lenses import balls
from rastercov.camera.lenses import formulas as lens
from rastercov.native.lens_rays import SECTORS, base_points, jacobian_many, rays_of, unproject_many

PLANE_DEG = 89.9
"""Largest angle from the axis of a base on a plane in front of the camera."""
NARROWEST = 1e-12
"""Radians: least angle of a region; a camera of the longest focal length sees 1e-12 rad a pixel."""
BELOW_LIMIT = 1 - 1e-6
"""Share of the limit of a base that is used: at the limit itself a radius has half its digits."""
MARGIN = 1.02
"""Radius of the region over the least that covers the image."""
SPARE = 1.25
"""Radius of the proof over the least that covers the image: derivatives are taken in cells of the
plane, some of which reach beyond the region."""
FIRST_CELL, LEAST_CELL = 1e-12, 1e-7
"""Length of a cell, and over its place, below which a proof fails."""
MOST_CELLS = 20_000
"""Cells after which a proof fails, or divisions end."""
FAR = 1e100
"""Radius beyond all pixels."""
BORDER = 256
"""Places of a side of the image that are looked up to find the least region."""
ROUNDING_REL = 1e-9
"""More than the rounding of a polynomial, relative to the sum of its terms without their signs."""


def base_limit(code: int, params: FloatArray) -> float:
    """Angle from the z axis, radians, below which the base is injective."""
    most = around(math.radians(PLANE_DEG if code in lens.PLANAR else WIDEST_DEG))
    return min(float(lens.limit_of(code, params)) * BELOW_LIMIT, most)


def base_radius(code: int, params: FloatArray, angle: float) -> float:
    """Distance from the axis, in the plane of the base, of rays at an angle from the z axis."""
    x, _ = lens.based(code, params, np.array(math.sin(angle)), np.array(0.0), math.cos(angle))
    return float(x)


def base_angle(code: int, params: FloatArray, radius: float) -> float:
    """Angle from the z axis of rays at a distance from the axis in the plane of the base."""
    ray = np.empty((1, 3))
    rays_of(code, params, np.array([[radius, 0.0]]), ray)
    return math.atan2(math.hypot(ray[0, 0], ray[0, 1]), ray[0, 2])


def conditions(params: FloatArray) -> FloatArray:
    """Coefficients (5, N) of polynomials of the radius that must be positive up to it.

    The proof of the module, times powers of the denominator of the radial factor.
    """
    p, r, one = params.tolist(), Polynomial((0.0, 1.0)), Polynomial((1.0,))
    radial = p[lens.K1 : lens.D1], p[lens.D1 : lens.P1]
    above, below = (Polynomial((1.0, *each))(r * r) for each in radial)  # f = r above / below
    across = above * below
    along = across + r * (above.deriv() * below - above * below.deriv())
    tangential = math.hypot(p[lens.P1], p[lens.P2])
    prism, prism4 = math.hypot(p[lens.S1], p[lens.S3]), math.hypot(p[lens.S2], p[lens.S4])
    # The place n / d of the tangential terms, and what they add to the derivative and to f.
    n, d = (r * above, below) if p[lens.LATE] else (r, one)
    turn = (6 * tangential + 2 * prism) * n * d**2 + 4 * prism4 * n**3  # times d^3
    shift = (3 * tangential + prism) * n**2 * d**2 + prism4 * n**4  # times d^4
    horizon = p[lens.T22] * below * d**4
    horizon -= math.hypot(p[lens.T20], p[lens.T21]) * (r * above * d**4 + shift * below)
    if p[lens.LATE]:
        found = across, along, d**3 - turn, below, horizon
    else:
        found = across - turn * below**2, along - turn * below**2, one, below, horizon
    return np.array(list(zip_longest(*(each.coef for each in found), fillvalue=0.0))).T


def are_positive(rows: FloatArray, low: float, high: float) -> bool:
    """True where polynomials (M, N) are proved to be positive from `low` to `high`.

    By their Taylor series in the middle, whose other terms are less than the first.
    """
    order = np.arange(rows.shape[1])
    middle, half = (low + high) / 2, (high - low) / 2
    binomials = np.array([[math.comb(k, j) for j in order] for k in order], float)
    series = rows * middle**order @ binomials * (half / middle) ** order
    most = np.abs(rows) @ high**order * ROUNDING_REL
    return bool((series[:, 0] - np.abs(series[:, 1:]).sum(axis=1) > most).all())


def certified_radius(params: FloatArray, top: float, enough: float = math.inf) -> float:
    """Largest radius, at most `top`, up to which the distortion is proved to be injective.

    0 where it folds at the axis itself. Found to `LEAST_CELL` of its value, unless the image of a
    disc that is `SPARE` times smaller has all points up to the distance `enough` from the axis.
    """
    rows = conditions(params)
    done, cell = 0.0, min(top, 1.0) / 16
    for _ in range(MOST_CELLS):
        if done >= top or cell < max(LEAST_CELL * done, FIRST_CELL * min(top, 1.0)):
            break
        following = min(done + cell, top)
        if are_positive(rows, done, following):
            done, cell = following, 2 * cell
            if forward_radius(params, done / SPARE) >= enough:
                break
        else:
            cell /= 2
    return done


def forward_radius(params: FloatArray, radius: float) -> float:
    """Least distance from the axis of what the distortion makes of the circle of a radius."""
    f = radius * float(lens.radial_factor(params.tolist(), radius * radius))
    at = f if params[lens.LATE] else radius
    tangential = 3.0 * math.hypot(params[lens.P1], params[lens.P2])
    tangential += math.hypot(params[lens.S1], params[lens.S3])
    prism4 = math.hypot(params[lens.S2], params[lens.S4])
    return f - (tangential + prism4 * at * at) * at * at


def border_pixels(width: int, height: int) -> FloatArray:
    """Pixels along the border of the image, (N, 2), around it from the top-left corner."""
    return border_of(width, height, BORDER + 1)[:, :-1].reshape(-1, 2)


def with_region(
    code: int, given: FloatArray, width: int, height: int, max_angle: float | None
) -> tuple[FloatArray, float, bool]:
    """Parameters of a lens with LIMIT and SLOPE of its valid region.

    Parameters
    ----------
    code, given
        The lens; its LIMIT and SLOPE are not used.
    width, height : int
        Image size, px.
    max_angle : float, optional
        Largest angle from the z axis, radians.

    Returns
    -------
    params : (32,) float64
    angle : float
        Angle of the region from the z axis, radians.
    is_whole : bool
        True where each pixel has a ray of the region.

    Raises
    ------
    CameraError
        If the lens folds at its axis.
    """
    params = given.copy()
    if code == lens.EQUIRECT:
        params[lens.LIMIT], params[lens.SLOPE] = math.inf, 0.0
        return params, math.pi, bool(np.isfinite(_border_rays(code, params, width, height)).all())
    most = math.pi if max_angle is None else max_angle
    top = min(base_limit(code, params), around(most))
    edge = base_radius(code, params, top)
    reached = _sensor_radius(params, width, height)
    limit = params[lens.LIMIT] = certified_radius(params, edge, reached)
    if not limit > 0.0:
        raise CameraError(
            "expected distortion that is one-to-one near the axis, got a fold; check the order "
            "and size of its coefficients"
        )
    need = _farthest(params, width, height)  # NaN where one has no point
    radius = min(limit, MARGIN * need) if need < math.inf else limit
    angle = min(within(base_angle(code, params, radius)), most)
    if not angle >= NARROWEST:
        raise CameraError(
            f"expected a lens that is valid to {NARROWEST:g} rad from the axis, got {angle:g}; "
            "check the order and size of its coefficients"
        )
    params[lens.SLOPE] = math.tan(angle)
    return params, angle, bool(np.isfinite(_border_rays(code, params, width, height)).all())


def around(angle: float) -> float:
    """Largest angle from the z axis of a cone of SECTORS flat sides around one, radians.

    Around -z, beyond 90 degrees, the flat sides are within the cone that is left out.
    """
    return _flattened(angle, is_along=math.cos(angle) > 0)


def within(angle: float) -> float:
    """Angle of the largest cone whose `around` is at most an angle, radians."""
    return _flattened(angle, is_along=math.cos(angle) <= 0)


def _flattened(angle: float, *, is_along: bool) -> float:
    across, along = math.sin(angle), math.cos(angle)
    flat = math.cos(math.pi / SECTORS)
    return math.atan2(across, along * flat) if is_along else math.atan2(across * flat, along)


def _sensor_radius(params: FloatArray, width: int, height: int) -> float:
    """Distance of the farthest pixel from the axis, in the distorted plane; inf if it has none."""
    undistorted = params.copy()
    undistorted[lens.K1 : lens.T00] = 0.0
    undistorted[lens.LIMIT] = FAR
    farthest = _farthest(undistorted, width, height)
    return farthest if farthest < math.inf else math.inf


def _farthest(params: FloatArray, width: int, height: int) -> float:
    """Greatest distance from the axis of the border of the image, in the plane of the base."""
    points = np.empty((4 * BORDER, 2))
    base_points(params, border_pixels(width, height), points)
    return float(np.hypot(points[:, 0], points[:, 1]).max())


def _border_rays(code: int, params: FloatArray, width: int, height: int) -> FloatArray:
    """Rays (N, 3) of `border_pixels`, NaN where there is none."""
    rays = np.empty((4 * BORDER, 3))
    unproject_many(code, params, border_pixels(width, height), rays)
    return rays


ONE_PLANE_DEG = 72.0
"""Largest angle from the axis of a lens with one plane, unless its base is a plane itself."""
CELLS = 24
"""Cells of a side of a plane's bounding box over which bounds are taken."""
SAME_CORNER = 1e-9
"""Distance of corners of a region that are one, in units of the plane."""
HOLE_SCALE = 2.0
"""Size of the box that holes are cut to, in that of the region: sides of a hole that are not those
of the valid cone are far from the region, so that no sliver is left between the two."""
DEEPEST_CELL = 6
"""Divisions of a cell that is too large for a bound."""
RADII = tuple(np.geomspace(1e-3, 1.5, 24).tolist())
"""Radii, in units of the plane, at which bounds are tried."""
RADII_NEAR_POLE = tuple(np.geomspace(3e-5, 1e-2, 12).tolist())
"""Those of a rational lens whose denominator comes near 0, where the others give no bound."""
REACH_NEAR_POLE = 1e4
"""Pixels below which its cells are not divided further."""

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
        for line in sides_of(self.hole):
            found.append(keep(rest, *-line))
            rest = keep(rest, *line)
            if len(rest) < 3:
                break
        return [part for part in found if len(part) >= 3]

    def reach(self, radius: float, *, is_near_pole: bool = False) -> tuple[float, float]:
        """Bounds of |u - u0| and |v - v0|, px, of complex points near a real one of the region.

        Parameters
        ----------
        radius : float
            Both coordinates are within it of those of the real point, in units of the plane; of a
            plane with a pole, in units of the distance of the real point from the pole.
        is_near_pole : bool
            As for `balls.reach`.

        Returns
        -------
        float, float
            Infinite where the lens has a pole or a branch that near.
        """
        x, y, half = self.cells(CELLS)
        lens_of_plane = (self.code, self.params, self.frame)
        reach_at = partial(balls.reach, *lens_of_plane, is_near_pole=is_near_pole)
        if self.has_pole:
            # Longitude does not change with the distance from the pole, and latitude changes less
            # and less: the ring from 1/2 outwards bounds all smaller ones, and a few are tried.
            size = np.hypot(x, y)
            is_ring = size >= 0.5 - max(half)
            x, y, size = x[is_ring], y[is_ring], size[is_ring]
            x, y, near = (
                np.concatenate([z, z / 2, z / 4, z / 8]) for z in (x, y, radius * size + max(half))
            )
            across, down = reach_at(x, y, near)
            return float(across.max(initial=0.0)), float(down.max(initial=0.0))
        most_u = most_v = 0.0
        for depth in range(DEEPEST_CELL + 1):
            across, down = reach_at(x, y, radius + max(half))
            most = REACH_NEAR_POLE if is_near_pole and depth < DEEPEST_CELL else math.inf
            is_good = np.maximum(across, down) < most
            most_u = max(most_u, float(across[is_good].max(initial=0.0)))
            most_v = max(most_v, float(down[is_good].max(initial=0.0)))
            if is_good.all():
                return most_u, most_v
            x, y = x[~is_good], y[~is_good]
            # No size of cells helps where the point itself has no bound.
            is_own = self.meets(x, y, (0.0, 0.0))
            is_bound = np.isfinite(reach_at(x[is_own], y[is_own], radius)).all()
            if depth == DEEPEST_CELL or not is_bound or len(x) > MOST_CELLS:
                break
            # A cell that meets a pole only for its size is divided into four.
            half = (half[0] / 2, half[1] / 2)
            x = np.concatenate([x + i * half[0] for i in (-1, 1, -1, 1)])
            y = np.concatenate([y + i * half[1] for i in (-1, -1, 1, 1)])
            is_near = self.meets(x, y, half)
            x, y = x[is_near], y[is_near]
        return math.inf, math.inf

    @cached_property
    def reaches(self) -> tuple[tuple[float, float, float], ...]:
        """Radii with their reach, those at which it is finite."""
        for radii, is_near_pole in ((RADII, False), (RADII_NEAR_POLE, True)):
            found = []
            for radius in radii:
                across, down = self.reach(radius, is_near_pole=is_near_pole)
                if not max(across, down) < math.inf:
                    break  # a larger radius meets the same pole
                found.append((radius, across, down))
            if found or not self.params[lens.D1 : lens.D3 + 1].any():
                break
        return tuple(found)

    def cells(self, counts: int | FloatArray) -> tuple[FloatArray, FloatArray, tuple[float, float]]:
        """Centres of cells that cover the region, and half their sides; see `cells_of`."""
        x, y, half = cells_of(self.region, counts)
        is_near = self.meets(x, y, half)
        return x[is_near], y[is_near], half

    def meets(self, x: FloatArray, y: FloatArray, half: tuple[float, float]) -> BoolArray:
        """True for cells that may have a point of the region, by their centres."""
        is_near: BoolArray = _distance(self.region, x, y) <= math.hypot(*half)
        if self.hole is not None:
            is_near &= _distance(self.hole, x, y) >= -math.hypot(*half)
        return is_near


def sides_of(polygon: FloatArray) -> FloatArray:
    """Lines (K, 3) along the sides of a convex polygon, positive inside, with unit normals.

    The polygon runs from x to y.
    """
    side = np.roll(polygon, -1, axis=0) - polygon
    size = np.hypot(side[:, 0], side[:, 1])
    side, start = side[size > 0] / size[size > 0, None], polygon[size > 0]
    a, b = -side[:, 1], side[:, 0]
    return np.column_stack((a, b, -(a * start[:, 0] + b * start[:, 1])))


def _distance(polygon: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
    """Greatest signed distance of points from the sides of a convex polygon, < 0 inside."""
    a, b, c = sides_of(polygon)[:, :, None].transpose(1, 0, 2)
    return -(a * x + b * y + c).min(axis=0)


def cells_of(
    region: FloatArray, counts: int | FloatArray
) -> tuple[FloatArray, FloatArray, tuple[float, float]]:
    """Centres of cells of the bounding box of a region, row by row, and half their sides."""
    low, high = region.min(axis=0), region.max(axis=0)
    half = (high - low) / (2 * np.asarray(counts))
    across, down = (
        first + side * (2 * np.arange(n) + 1)
        for first, side, n in zip(low, half, np.broadcast_to(counts, 2), strict=True)
    )
    x, y = (grid.ravel() for grid in np.meshgrid(across, down))
    return x, y, (float(half[0]), float(half[1]))


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
    """Normals (SECTORS, 2) of the flat sides next to the valid cone, around the z axis."""
    turn = 2 * np.pi * (np.arange(SECTORS) + 0.5) / SECTORS
    return np.column_stack((np.cos(turn), np.sin(turn)))


def _on_plane(slope: float, frame: FloatArray, box: FloatArray) -> tuple[FloatArray, bool]:
    """Polygon of a box in flat sides around the cone of a slope, or within that around -z.

    True where it is around z.
    """
    polygon = box
    if not slope > 0:
        slope *= math.cos(math.pi / SECTORS)
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
    if code == lens.PINHOLE or angle <= math.radians(ONE_PLANE_DEG):
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
            if code != lens.EQUIRECT:
                polygon, is_inside = _on_plane(params[lens.SLOPE], frame, box)
                if is_inside:
                    region = polygon
                elif len(polygon) >= 3:
                    hole = _on_plane(params[lens.SLOPE], frame, HOLE_SCALE * box)[0]
            is_all = hole is not None and abs(_area(polygon) - _area(region)) < 1e-12
            if len(region) >= 3 and not is_all:
                has_pole = bool(code == lens.EQUIRECT and frame[1, 2] != 0)
                planes.append(IdealPlane(frame, camera, region, hole, code, own, has_pole))
    return tuple(planes)


def _parts(code: int, params: FloatArray, frame: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """Boxes of a side of the cube, each with parameters that are continuous on it.

    Longitude jumps across the half plane X = 0, Z < 0, and at the poles it has no value; the three
    sides of the cube that they meet are divided along X = 0.
    """
    square = np.array(SQUARE)
    if code != lens.EQUIRECT or not (abs(frame[0, 0]) == 1 and frame[2, 2] <= 0):
        if code == lens.EQUIRECT and frame[0, 2] != 0:
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
    own[lens.B0 : lens.B2 + 1] = sign * math.pi / 2, 0.0, sign
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
    slope = params[lens.SLOPE]
    # Corners of the cone: its sides are at the distance `slope` from the axis.
    turn = 2 * np.pi * np.arange(SECTORS) / SECTORS
    region = slope / math.cos(math.pi / SECTORS) * np.column_stack((np.cos(turn), np.sin(turn)))
    rays = _border_rays(code, params, width, height)
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
