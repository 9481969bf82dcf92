"""Areas of polygons of an ideal plane in the image of a lens, and planes as loops take them.

A plane has a window, few sides around all that the image shows of its region. The border of a
region has 128 sides around a conic, nearly all of whose images are outside the image. A line cuts
off a piece of it. The lens is a homeomorphism, so a piece whose border misses the image has either
all of the image or nothing of it, and nothing if a point of the rest of the region has its pixel in
the image.

Where the image may show the conic itself, areas end at it: its arcs are integrated as edges are, by
the turn around the axis of the cone (`native/lens/polygons.hpp`). For a complex step d of the turn,
|cos(t + d) - cos t| and |sin(t + d) - sin t| are at most sinh |d|, so that a point of the plane is
known to stay within the radii at which the lens is bounded.
"""

import math
from typing import Any

import numpy as np

from rastercov.base.errors import CameraError
from rastercov.base.memory import FloatArray, read_only
from rastercov.camera.lenses import balls, formulas
from rastercov.camera.lenses.planes import IdealPlane, around, keep, sides_of
from rastercov.camera.lenses.quadrature import EdgeBounds, EdgeTable
from rastercov.camera.lenses.records import PlaneRecord
from rastercov.camera.lenses.slopes import slopes_in
from rastercov.native.lens_edges import MOST
from rastercov.native.lens_rays import unproject_many

PARTS = 512
"""Parts of the border of a piece whose images are compared with the image, each with its bend."""
ROUNDING_PX = 1e-9
"""More than the rounding of a pixel."""
TRIMMINGS = 10
"""Halvings in the search for a line that cuts off what the image does not show."""
EIGHTHS = (0, 2, 4, 6, 1, 3, 5, 7)
"""Directions of the lines that cut off what the image does not show, in eighths of a turn."""
FEW_SIDES = 8
"""A window of so few sides is not cut at its corners."""
TURNS = 1024
"""Places of the border of the valid region whose surroundings are compared with the image."""


def window_of(plane: IdealPlane, width: float, height: float, bend: float) -> FloatArray:
    """Convex polygon within the region that holds every point of it whose pixel is in the image.

    Parameters
    ----------
    plane : IdealPlane
    width, height : float
        Size of the image, px.
    bend : float
        Bound of the second derivative of pixels along lines of the plane, px; infinite for a plane
        with a pole.

    Returns
    -------
    (K, 2) float64
        The region, cut by lines; all of it if nothing is proved, or it has a hole. No corner if it
        is proved that the image shows nothing.
    """
    region = plane.region
    if plane.hole is not None or not bend < math.inf:
        return region

    def misses(piece: FloatArray) -> bool:
        """True where the image of the border of a piece is outside the image."""
        end = np.roll(piece, -1, axis=0)
        n = max(PARTS // len(piece), 2)
        t = np.linspace(0.0, 1.0, n + 1)[:, None, None]
        u, v = _pixels(plane, (1 - t) * piece + t * end)
        stray = bend * ((end - piece) ** 2).sum(axis=1) / (8 * n**2) + ROUNDING_PX
        is_out: Any = False
        for value, size in ((u, width), (v, height)):
            low, high = np.minimum(value[1:], value[:-1]), np.maximum(value[1:], value[:-1])
            is_out = is_out | (high < -stray) | (low > size + stray)
        return bool(is_out.all())

    if not _shows(plane, region, width, height):
        is_empty = misses(region) and _is_elsewhere(plane, width / 2, height / 2)
        return np.empty((0, 2)) if is_empty else region
    window = region
    for eighth in EIGHTHS:
        if eighth % 2 and len(window) <= FEW_SIDES:
            break
        a, b = math.cos(eighth * math.pi / 4), math.sin(eighth * math.pi / 4)
        value = window @ (a, b)
        low, high, found = float(value.min()), float(value.max()), window
        # About the least c with nothing shown beyond the line a x + b y = c.
        for _ in range(TRIMMINGS):
            middle = (low + high) / 2
            piece = keep(window, a, b, -middle)
            if len(piece) >= 3 and misses(piece):
                high, found = middle, keep(window, -a, -b, middle)
            else:
                low = middle
        if _shows(plane, found, width, height):
            window = found
    return window


def _is_elsewhere(plane: IdealPlane, u: float, v: float) -> bool:
    """True where a pixel has a ray that is outside the region of a plane."""
    ray = np.empty((1, 3))
    unproject_many(plane.code, plane.params, np.array([[u, v]]), ray)
    x, y, z = ray[0] @ plane.frame
    if not np.isfinite(z):
        return False
    return bool(z <= 0 or (sides_of(plane.region) @ (x, y, z) < 0).any())


def _shows(plane: IdealPlane, window: FloatArray, width: float, height: float) -> bool:
    """True where some point of a polygon has its pixel in the image."""
    if len(window) < 3:
        return False
    middle = window.mean(axis=0)
    u, v = _pixels(plane, middle + np.linspace(0.0, 0.99, 12)[:, None, None] * (window - middle))
    return bool(((u > 1) & (u < width - 1) & (v > 1) & (v < height - 1)).any())


def _pixels(plane: IdealPlane, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pixels u, v (...) of points (..., 2) of a plane."""
    project: Any = formulas.project  # which has no types
    x, y, z = np.moveaxis(points @ plane.frame[:, :2].T + plane.frame[:, 2], -1, 0)
    with np.errstate(all="ignore"):
        u, v = project(plane.code, plane.params, x, y, z)
    return u, v


def record_of(plane: IdealPlane, width: int, height: int, table: EdgeTable) -> PlaneRecord:
    """Record of a plane of a lens with an image of that size, px."""
    pinhole, (speed, bend) = plane.camera, _derivatives(plane)
    arc_half, arc_bend = arc_rule(plane, width, height, table.tolerance)
    return PlaneRecord(
        code=plane.code,
        params=read_only(plane.params),
        frame=read_only(plane.frame),
        fx=float(pinhole.fx),
        fy=float(pinhole.fy),
        cx=float(pinhole.cx),
        cy=float(pinhole.cy),
        region=read_only(plane.region),
        hole=read_only(np.empty((0, 2)) if plane.hole is None else plane.hole),
        window=read_only(window_of(plane, width, height, bend)),
        longest=read_only(table.longest),
        parts_of=table.parts_of,
        is_graded=table.is_graded,
        width=float(width),
        height=float(height),
        bend=bend,
        stretch=speed**2 / 2 / (pinhole.fx * pinhole.fy),
        speed=speed / min(pinhole.fx, pinhole.fy),
        tolerance=table.tolerance,
        arc_half=arc_half,
        arc_bend=arc_bend,
    )


def arc_rule(
    plane: IdealPlane, width: float, height: float, tolerance: float
) -> tuple[float, float]:
    """Rule for arcs of the border of the valid region in a plane; zeros where none is shown.

    Parameters
    ----------
    plane : IdealPlane
    width, height : float
        Size of the image, px.
    tolerance : float
        Largest error of a part of an arc, px^2.

    Returns
    -------
    half, bend : float
        Half the longest part, radians around the axis, by the rule of most nodes, and a bound of
        the second derivative of pixels by the turn, px.
    """
    if plane.code == formulas.EQUIRECT:
        return 0.0, 0.0
    slope = plane.params[formulas.SLOPE]
    angle = math.atan2(abs(slope), math.copysign(1.0, slope))
    across, beside = math.sin(angle), around(angle) - angle
    turn = 2 * np.pi * np.arange(TURNS) / TURNS
    circle = across * np.cos(turn), across * np.sin(turn), np.full(TURNS, math.cos(angle))
    rays = np.column_stack(circle) @ plane.frame
    # A turn d changes coordinates of the ray, and its depth, by at most sinh d times these.
    along_x, along_y, ahead = across * np.hypot(*plane.frame[:2])
    aside = max(along_x, along_y)
    # Places around which all points between the cone and the flat sides next to it are; those that
    # the region of the plane meets.
    step, step_z = (math.sinh(math.pi / TURNS) * each + beside for each in (aside, ahead))
    low, high = plane.region.min(axis=0), plane.region.max(axis=0)
    is_met = rays[:, 2] > step_z
    for limit, sign in ((low, 1), (high, -1)):
        depth = sign * (rays[:, :2] - limit * rays[:, 2:])
        is_met &= (depth >= -(step + np.abs(limit) * step_z)).all(axis=1)
    (x, y), z = rays[is_met, :2].T / rays[is_met, 2], rays[is_met, 2]
    far = np.maximum(np.abs(x), np.abs(y))
    near = (step + far * step_z) / (z - step_z)
    u, v = _pixels(plane, np.column_stack((x, y)))
    by_u, by_v = balls.reach(plane.code, plane.params, plane.frame, x, y, near)
    misses = (u + by_u < 0) | (u - by_u > width) | (v + by_v < 0) | (v - by_v > height)
    if misses.all():
        return 0.0, 0.0
    # What is between the cone and the region changes places besides.
    off = float((beside * (1 + far) / (z - beside)).max())
    found = []
    for radius, most_u, most_v in plane.reaches:
        if (left := radius - off) > 0:
            rise = float((left * z / (aside + (far + left) * ahead)).min())
            found.append((math.asinh(rise), most_u, most_v))
    half = EdgeBounds(found, np.full((2, 2), np.inf)).longest(tolerance, MOST)
    if not half > 0:
        raise CameraError(
            "expected a lens that can be bounded at max_angle_deg, got another; reduce it"
        )
    return half, min(2 * max(u, v) / step**2 for step, u, v in found)


def _derivatives(plane: IdealPlane) -> tuple[float, float]:
    """Bounds of the first and the second derivative of pixels along lines of a plane, px.

    Of an analytic u with |u - u0| <= M within R the first is at most M / R, by Cauchy, and that of
    both coordinates together (x^2 + y^2)^(1/2) times 2^(1/2) at most. The second is that of
    `slopes`, some thirty times less than 2 M / R^2: how many edges are next to the border of the
    image, and how many tiles of samples a face may reach, depends on it.
    """
    if plane.has_pole:
        return math.inf, math.inf
    speeds = (math.sqrt(2) * math.hypot(u, v) / radius for radius, u, v in plane.reaches)
    return min(speeds, default=math.inf), float(slopes_in(plane).second.max())
