"""Valid region of a lens: a cone around the z axis on which it is proved to be injective.

A polynomial that was fitted inside the image may fold outside it, and then two rays have one pixel.
So nothing outside the valid region is ever projected. The proof has three parts:

1. The base is injective up to an angle known in closed form (`base_limit`).
2. On the disc of radius s of the plane of the base the distortion is injective. Its derivative
   there has a symmetric part of at least

       min(f / r, f') - t(r),   f the radial part,
       t(r) = 6 r |(P1, P2)| + 2 r |(S1, S3)| + 4 r^3 |(S2, S4)|,

   and a map whose derivative has a positive symmetric part on a convex set is injective on it.
   Where the tangential terms take the radially distorted point, both parts are injective:
   min(f / r, f') > 0 and t(f) < 1. `certified_radius` proves it by intervals, from the axis on.
3. The horizon of a tilted sensor is beyond the image of the disc.

The region is then made as small as covers the image, and 2 % more: a lens is known no further.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rastercov.base.errors import CameraError
from rastercov.camera.lenses.balls import Interval, Jet
from rastercov.kernels import lens_formulas as lens
from rastercov.kernels.lens import SECTORS, base_points, rays_of, unproject_many

FloatArray = NDArray[np.float64]

WIDEST_DEG = 175.0
"""Largest angle from the axis: the opposite ray has a circle of pixels, and next to it edges bend
without limit. No lens sees that far."""
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
FAR = 1e100
"""Radius beyond all pixels."""
BORDER = 256
"""Places of a side of the image that are looked up to find the least region."""

_BOUND = lens.bound_to({}, given=(lens.radial_factor,))


def base_limit(code: int, params: FloatArray) -> float:
    """Angle from the z axis, radians, below which the base is injective."""
    if code in (lens.EQUIDISTANT, lens.EQUISOLID):
        return math.radians(WIDEST_DEG)
    if code == lens.UNIFIED:
        # z > -w sqrt(B2 r^2 + z^2), w the smaller of B0 and B1 over the larger.
        w = min(params[lens.B0], params[lens.B1]) / max(params[lens.B0], params[lens.B1])
        limit = math.pi - math.atan2(math.sqrt(1.0 - w * w), w * math.sqrt(params[lens.B2]))
    elif code == lens.DOUBLE_SPHERE:
        xi, alpha = params[lens.B0], params[lens.B1]
        w = min(alpha, 1.0 - alpha) / max(alpha, 1.0 - alpha)
        # From the center of the second sphere, xi + c > -w sqrt(1 + 2 xi c + xi^2), c the cosine
        # of the angle. The paper's (w + xi) / sqrt(2 w xi + xi^2 + 1) > -c is beyond the fold
        # where xi < 0 and alpha is near 1.
        rest = 1.0 - w * w
        limit = math.acos(max(-1.0, -xi * rest - w * math.sqrt(1.0 - xi * xi * rest)))
    elif code == lens.DIVISION and params[lens.B0] > 0.0:
        limit = math.atan(0.5 / math.sqrt(params[lens.B0]))
    else:
        return math.radians(PLANE_DEG)
    if code == lens.DIVISION:
        return min(limit * BELOW_LIMIT, math.radians(PLANE_DEG))
    return min(limit * BELOW_LIMIT, math.radians(WIDEST_DEG))


def base_radius(code: int, params: FloatArray, angle: float) -> float:
    """Distance from the axis, in the plane of the base, of rays at an angle from the z axis."""
    x, _ = lens.based(code, params, np.array(math.sin(angle)), np.array(0.0), math.cos(angle))
    return float(x)


def base_angle(code: int, params: FloatArray, radius: float) -> float:
    """Angle from the z axis of rays at a distance from the axis in the plane of the base."""
    ray = np.empty((1, 3))
    rays_of(code, params, np.array([[radius, 0.0]]), ray)
    return math.atan2(math.hypot(ray[0, 0], ray[0, 1]), ray[0, 2])


def is_certified(params: Sequence[float], low: float, high: float) -> bool:
    """True where the distortion is proved to be injective at radii from `low` to `high`.

    It must have been proved below `low`.
    """
    r = Interval(low, high)
    q = r * r
    factor = _BOUND["radial_factor"](params, Jet(q, Interval(1.0, 1.0)))
    along = Interval.of(factor.value) + 2.0 * q * Interval.of(factor.slope)
    across = Interval.of(factor.value)
    least = min(along.low, across.low)
    if not least > 0.0:  # a pole of the factor is within, or the radial part folds
        return False
    f = r * across
    at = f if params[lens.LATE] else r
    tangential = math.hypot(params[lens.P1], params[lens.P2])
    prism = math.hypot(params[lens.S1], params[lens.S3])
    prism4 = math.hypot(params[lens.S2], params[lens.S4])
    turn = (6.0 * tangential + 2.0 * prism) * at + 4.0 * prism4 * at * at * at
    if not (turn.high < 1.0 if params[lens.LATE] else least > turn.high):
        return False
    farthest = f + (3.0 * tangential + prism) * at * at + prism4 * at * at * at * at
    horizon = math.hypot(params[lens.T20], params[lens.T21]) * farthest
    return bool(horizon.high < params[lens.T22])


def certified_radius(params: FloatArray, top: float, enough: float = math.inf) -> float:
    """Largest radius, at most `top`, up to which the distortion is proved to be injective.

    0 where it folds at the axis itself. Found to `LEAST_CELL` of its value, unless the image of a
    disc that is `SPARE` times smaller has all points up to the distance `enough` from the axis.
    """
    numbers = params.tolist()
    done, cell = 0.0, min(top, 1.0) / 16
    for _ in range(MOST_CELLS):
        if done >= top or cell < max(LEAST_CELL * done, FIRST_CELL * min(top, 1.0)):
            break
        following = min(done + cell, top)
        if is_certified(numbers, done, following):
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
    t = np.arange(BORDER) / BORDER
    zero, one = np.zeros(BORDER), np.ones(BORDER)
    sides = ((t, zero), (one, t), (1 - t, one), (zero, 1 - t))
    return np.concatenate([np.column_stack(side) for side in sides]) * (width, height)


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
        rays = np.empty((4 * BORDER, 3))
        unproject_many(code, params, border_pixels(width, height), rays)
        return params, math.pi, bool(np.isfinite(rays).all())
    top = min(base_limit(code, params), math.pi if max_angle is None else max_angle)
    edge = base_radius(code, params, top)
    points = np.empty((4 * BORDER, 2))
    reached = _sensor_radius(params, width, height)
    limit = params[lens.LIMIT] = certified_radius(params, edge, reached)
    if not limit > 0.0:
        raise CameraError(
            "the distortion must keep rays next to the axis apart, and this one folds there: "
            "check the order and the size of its coefficients"
        )
    base_points(params, border_pixels(width, height), points)
    need = float(np.hypot(points[:, 0], points[:, 1]).max())  # NaN where one has no point
    radius = min(limit, MARGIN * need) if need < math.inf else limit
    angle = base_angle(code, params, radius)
    if not angle >= NARROWEST:
        raise CameraError(
            f"the valid region of the lens must reach {NARROWEST:g} rad from the axis, got "
            f"{angle:g}: check the order and the size of its coefficients"
        )
    slope = math.tan(angle)
    params[lens.SLOPE] = slope * math.cos(math.pi / SECTORS) if angle < math.pi / 2 else slope
    rays = np.empty((4 * BORDER, 3))
    unproject_many(code, params, border_pixels(width, height), rays)
    return params, angle, bool(np.isfinite(rays).all())


def _sensor_radius(params: FloatArray, width: int, height: int) -> float:
    """Distance of the farthest pixel from the axis, in the distorted plane; inf if it has none."""
    undistorted = params.copy()
    undistorted[lens.K1 : lens.T00] = 0.0
    undistorted[lens.LIMIT] = FAR
    points = np.empty((4 * BORDER, 2))
    base_points(undistorted, border_pixels(width, height), points)
    farthest = float(np.hypot(points[:, 0], points[:, 1]).max())
    return farthest if farthest < math.inf else math.inf
