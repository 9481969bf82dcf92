"""Candidate poses of an aerial survey: parallel strips over a polygon, in the order of flight.

Images overlap by at least the given shares at the highest point of the ground, and by more
elsewhere. In the axes of the strips, x across and y along, neighbours are apart by

    (1 - side) 2 H tan(across),  (1 - front) 2 H tan(down)

for the half angles of the image and the height H above the ground. A view tilted by t shows a
trapezoid, whose width grows with its distance D from the camera, from n = cos(down)/cos(t - down)
to f = cos(down)/cos(t + down) times H. Neighbours in a strip then share the part from n on up to
D = sqrt(n^2 + front (f^2 - n^2)), where that makes the step smaller.

Before a facade: rows of a grid parallel to it; around a point: circles. In the order
of flight, too.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    ConfigError,
    FloatArray,
    arctan2,
    cos,
    finite_number,
    finite_points,
    matmul,
    members,
    norm,
    shown,
    sin,
    tan,
)
from rastercov.base.typed import check_fields, typed
from rastercov.core.camera import Camera, look_at
from rastercov.core.camera.viewpoints import half_angles
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.arrays import frozen
from rastercov.core.mesh.groups import names_of_groups
from rastercov.core.mesh.mesh import faces_of_groups, names_of
from rastercov.placement.candidates.ground import heights_at, outline
from rastercov.placement.candidates.pool import (
    DEFAULT,
    Candidates,
    Framing,
    Refusal,
    roll_candidates,
)

if TYPE_CHECKING:
    from shapely import Polygon

MOST_IMAGES = 100_000
"""Images of a pattern."""


def distance_for(camera: Camera, distance: float | None, gsd: float | None, name: str) -> float:
    """Distance of a flight, or that at which a pixel on the axis is `gsd` metres, metres."""
    if (distance is None) == (gsd is None):
        got = "none" if gsd is None else "both"
        raise ConfigError(f"expected {name} or gsd, got {got}; give one")
    if gsd is not None and camera.is_parallel:
        raise ConfigError(
            f"expected {name} with parallel rays, got gsd; it is the same at any distance"
        )
    result = distance if gsd is None else gsd * min(camera.fx, camera.fy)
    assert result is not None
    if not 0 < result < np.inf:
        raise ConfigError(f"expected {name} and gsd above 0 m, got {result:g}; correct it")
    return result


def image_sides(camera: Camera, framing: Framing) -> tuple[float, float]:
    """Width and height of what an image shows at distance 1, upright after the first roll.

    Parallel rays show them at any distance, see `growth`.
    """
    across, down = half_angles(camera)
    turns = framing.rolls_deg[0] % 180
    if turns == 90:
        across, down = down, across
    elif turns:
        across = down = min(across, down)
    return 2 * across, 2 * down


def growth(camera: Camera, distance: float) -> float:
    """Factor by which the sides of what an image shows grow to a distance."""
    return 1.0 if camera.is_parallel else distance


def check_overlap(**shares: float) -> None:
    """Raise ConfigError unless each is a share from 0 to below 1."""
    for name, share in shares.items():
        if not 0 <= share < 1:
            raise ConfigError(f"expected {name} from 0 to below 1, got {share:g}; 0.8 is 80 %")


def check_count(count: float) -> None:
    """Raise ConfigError for too many images."""
    if not count <= MOST_IMAGES:
        raise ConfigError(
            f"expected at most {MOST_IMAGES:,} images of a pattern, got {count:,.0f}; fly higher"
        )


@dataclass(frozen=True, kw_only=True)
class Survey:
    """Parallel strips over a polygon, for `strips`.

    Attributes
    ----------
    height : float, optional
        Flight height above the mean height of the ground in the polygon, metres; give this or
        `gsd`.
    gsd : float, optional
        Ground sampling distance at the mean height of the ground, on the optical axis, metres per
        pixel.
    front, side : float
        Minimum overlap of neighbours along and across the strips, as shares, [0, 1).
    heading_deg : float
        Direction of the first strip, degrees clockwise from +y; the image's upper edge is forward.
    polygon : (N, 2) array_like, optional
        Corners [x, y] in order, metres; the convex outline of the evaluated surface by default.
    follow : bool
        True to keep the flight height above the ground below each image.
    tilt_deg : float
        Tilt of the view forward from straight down, degrees, [0, 90).

    Raises
    ------
    ConfigError
        For a value outside its range.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import Survey, strips
    >>> mesh, camera = rc.shapes.aeroplane(), rc.Camera.preset("dji-mavic3e")
    >>> result = strips(mesh, camera, survey=Survey(height=40, front=0.8, side=0.7))
    >>> len(result), result.sources
    (16, ('strips',))
    """

    height: float | None = None
    gsd: float | None = None
    front: float = 0.8
    side: float = 0.6
    heading_deg: float = 0.0
    polygon: ArrayLike | None = None
    follow: bool = False
    tilt_deg: float = 0.0

    def __post_init__(self) -> None:
        check_fields(self)
        check_overlap(front=self.front, side=self.side)
        if not 0 <= self.tilt_deg < 90:
            raise ConfigError(
                f"expected tilt_deg from 0 to below 90, got {self.tilt_deg:g}; 0 is nadir"
            )
        if math.isnan(finite_number(self.heading_deg)):
            got = shown(self.heading_deg)
            raise ConfigError(f"expected a finite heading_deg, got {got}; give one")
        if (self.height is None) == (self.gsd is None):
            got = "none" if self.gsd is None else "both"
            raise ConfigError(f"expected height or gsd, got {got}; give one")
        if self.polygon is not None:
            finite_points("polygon", self.polygon, (-1, 2), "corners [x, y]")


@typed
def strips(mesh: Mesh, camera: Camera, framing: Framing = DEFAULT, *, survey: Survey) -> Candidates:
    """Views from strips over a polygon, straight down or tilted forward.

    Parameters
    ----------
    mesh : Mesh
        The scene; z is up.
    camera : Camera
        Camera to place.
    framing : Framing, optional
        Only its rolls apply.
    survey : Survey
        The strips.

    Returns
    -------
    Candidates
        In the order of flight, strip by strip, back and forth; `index` counts them.

    Raises
    ------
    ConfigError
        For a polygon that crosses itself, and a height below the highest ground.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import Survey, strips
    >>> mesh, camera = rc.shapes.aeroplane(), rc.Camera.preset("dji-mavic3e")
    >>> result = strips(mesh, camera, survey=Survey(gsd=0.006))
    >>> len(result), result.sources
    (33, ('strips',))
    """
    import shapely

    away = distance_for(camera, survey.height, survey.gsd, "height")
    area = outline(mesh) if survey.polygon is None else _polygon(survey.polygon)
    level, least = _ground(mesh, area)
    nearest = away if survey.follow else away - (least - level)
    if not nearest > 0:
        raise ConfigError(
            f"expected a height above the highest ground, {least - level:.3g} m above its mean, "
            f"got {away:.3g} m; fly higher, or follow the ground"
        )
    across, down = image_sides(camera, framing)
    steps = np.array(((1 - survey.side) * across, (1 - survey.front) * down))
    steps *= growth(camera, nearest)
    tilt = np.radians(survey.tilt_deg)
    half = arctan2(down / 2, 1.0)
    near, far = cos(half) / cos((tilt - half, tilt + half))
    if far > 0 and not camera.is_parallel:  # below the horizon
        shared = np.sqrt(near**2 + survey.front * (far**2 - near**2))
        steps[1] *= min(1.0, 2 * cos(tilt) * (near * far) ** 2 / (far + shared))
    angle = np.radians(survey.heading_deg)
    forward = np.array((sin(angle), cos(angle)))
    right = np.array((forward[1], -forward[0]))
    xy = _lattice(area, np.stack((right, forward)), steps)
    z = np.full(len(xy), level)
    if survey.follow:
        below = heights_at(mesh, xy)
        known = np.isfinite(below)
        if known.any():
            tree = shapely.STRtree(shapely.points(xy[known]))
            z = below[known][tree.nearest(shapely.points(xy))]
    eyes = np.column_stack((xy, z + away))
    ahead = np.append(forward, 0.0)
    view = sin(tilt) * ahead - cos(tilt) * np.array((0.0, 0.0, 1.0))
    up = cos(tilt) * ahead + sin(tilt) * np.array((0.0, 0.0, 1.0))
    poses = look_at(eyes, eyes + view * away, up)
    return roll_candidates(poses, "strips", np.arange(len(poses)), framing)


def mean_level(mesh: Mesh, polygon: ArrayLike | None) -> float:
    """Mean height of the ground in a polygon, or below the evaluated surface, metres."""
    return _ground(mesh, outline(mesh) if polygon is None else _polygon(polygon))[0]


def _polygon(corners: ArrayLike) -> "Polygon":
    import shapely

    points = finite_points("polygon", corners, (-1, 2), "corners [x, y]")
    polygon = shapely.Polygon(points) if len(points) > 2 else shapely.Polygon()
    if not polygon.is_valid or not polygon.area > 0:
        raise ConfigError("expected a polygon without crossings, got another; correct its corners")
    return polygon


def _ground(mesh: Mesh, area: "Polygon") -> tuple[float, float]:
    """Mean and greatest height of the surface in a polygon, at a lattice of points; 0 for none."""
    import shapely

    low_x, low_y, high_x, high_y = shapely.buffer(area, 1e-9).bounds
    x, y = np.meshgrid(np.linspace(low_x, high_x, 64), np.linspace(low_y, high_y, 64))
    xy = np.stack((x.ravel(), y.ravel()), axis=1)
    corners = mesh.opaque.vertices[np.unique(mesh.opaque.faces)]
    xy = xy[shapely.intersects_xy(shapely.buffer(area, 1e-9), *xy.T)]
    z = heights_at(mesh, xy)
    inside = shapely.intersects_xy(area, *corners[:, :2].T)
    highest = np.append(z[~np.isnan(z)], corners[inside, 2])
    if np.isnan(z).all() or not len(highest):
        return 0.0, 0.0
    return float(np.nanmean(z)), float(highest.max())


def _lattice(area: "Polygon", axes: FloatArray, steps: FloatArray) -> FloatArray:
    """(N, 2) places over an area, columns back and forth along the second axis, as needed."""
    import shapely

    area = shapely.transform(area, lambda xy: matmul(xy, axes.T))
    low_x, _, high_x, _ = area.bounds
    columns = int(np.ceil((high_x - low_x) / steps[0] * (1 - 1e-12))) + 1
    check_count(columns)
    middle = (low_x + high_x) / 2
    values: list[FloatArray] = []
    total = 0
    for row in range(columns):
        x = middle + (row - (columns - 1) / 2) * steps[0]
        half = steps[0] / 2
        band = shapely.intersection(area, shapely.box(x - half, -1e30, x + half, 1e30))
        if band.is_empty:
            continue
        _, low_y, _, high_y = band.bounds
        count = np.ceil((high_y - low_y) / steps[1] * (1 - 1e-12)) + 1
        check_count(total + count)
        total += int(count)
        y = (low_y + high_y) / 2 + (np.arange(int(count)) - (count - 1) / 2) * steps[1]
        y = y if len(values) % 2 == 0 else y[::-1]
        values.append(np.column_stack((np.full(len(y), x), y)))
    return matmul(np.concatenate(values), axes)


LEAST_UPRIGHT = 0.1
"""Least length of the mean normal of a facade on the plan."""


@typed
def facade(
    mesh: Mesh,
    camera: Camera,
    framing: Framing = DEFAULT,
    *,
    distance: float | None = None,
    gsd: float | None = None,
    front: float = 0.8,
    side: float = 0.6,
    groups: Sequence[str] = (),
) -> Candidates:
    """Level views perpendicular to a facade, in rows of a grid before the plane of the facade.

    Parameters
    ----------
    mesh : Mesh
        The scene; z is up.
    camera : Camera
        Camera to place.
    framing : Framing, optional
        Only its rolls apply.
    distance : float, optional
        Distance from the part of the facade that protrudes most, metres; give this or `gsd`.
    gsd : float, optional
        Ground sampling distance there, on the optical axis, metres per pixel.
    front, side : float
        Overlap of neighbours in a row, and of neighbouring rows, as shares, [0, 1).
    groups : sequence of str
        Groups of the facade; all evaluated faces by default.

    Returns
    -------
    Candidates
        Row by row from the lowest, back and forth; `index` counts them. None is below the ground:
        see `above_ground`.

    Raises
    ------
    ConfigError
        For a value outside its range, and for faces whose mean normal is not to one side.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import facade
    >>> wall = rc.Mesh([(0, 0, 0), (10, 0, 0), (10, 0, 6), (0, 0, 6)], [(0, 1, 2), (0, 2, 3)])
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> result = facade(wall, camera, distance=8)
    >>> len(result), result.sources
    (28, ('facade',))
    """
    check_overlap(front=front, side=side)
    away = distance_for(camera, distance, gsd, "distance")
    chosen = mesh.task_mask
    if names := members("groups", groups, str, "names of groups", ConfigError):
        wanted = names_of_groups("groups", names, names_of(mesh)) or set()
        chosen = faces_of_groups(mesh, wanted)
    normal = (mesh.areas[chosen, None] * mesh.normals[chosen])[:, :2].sum(axis=0)
    length = norm(normal)
    if not length > LEAST_UPRIGHT * float(mesh.areas[chosen].sum()):
        raise ConfigError(
            "expected faces of one side of a building, got some of all sides; name their groups"
        )
    outward = np.append(normal / length, 0.0)
    right = np.array((-outward[1], outward[0], 0.0))  # for who looks at it
    used = mesh.vertices[np.unique(mesh.faces[chosen])]
    across, down = image_sides(camera, framing)
    reach = growth(camera, away)
    u, v = matmul(used, right), used[:, 2]
    columns = _places(u.min(), u.max(), (1 - front) * across * reach)
    rows = _places(v.min(), v.max(), (1 - side) * down * reach)
    check_count(len(columns) * len(rows))
    grid = [
        np.column_stack((columns[:: 1 - row % 2 * 2], np.full(len(columns), level)))
        for row, level in enumerate(rows.tolist())
    ]
    places = np.concatenate(grid)
    depth = float(matmul(used, outward).max()) + away
    eyes = places[:, :1] * right + depth * outward + places[:, 1:] * np.array((0.0, 0.0, 1.0))
    poses = look_at(eyes, eyes - outward * away)
    return above_ground(mesh, roll_candidates(poses, "facade", np.arange(len(poses)), framing))


def above_ground(mesh: Mesh, candidates: Candidates, clearance: float = 0.0) -> Candidates:
    """Level views raised to a clearance, metres, above the ground below them.

    The ground is the lowest surface there, or the lowest level of the mesh beside it. Of views that
    are raised to the same place, the first stays; the others are refused.
    """
    ground = heights_at(mesh, candidates.poses[:, :2, 3], is_lowest=True)
    ground = np.where(np.isnan(ground), mesh.bounds[0, 2], ground)
    poses = candidates.poses.copy()
    poses[:, 2, 3] = np.maximum(poses[:, 2, 3], ground + clearance)
    kept = np.sort(np.unique(poses, axis=0, return_index=True)[1])
    left_out = candidates.take(np.setdiff1d(np.arange(len(candidates)), kept))
    refused = (
        Refusal(pose, name, "below_ground", "below the ground")
        for pose, name in zip(left_out.poses, left_out.source.tolist(), strict=True)
    )
    return replace(
        candidates.take(kept), poses=frozen(poses[kept]), refused=(*candidates.refused, *refused)
    )


def _places(low: float, high: float, step: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Places at equal steps, the first and the last at the ends or beyond."""
    span = high - low
    count = np.ceil(span / step * (1 - 1e-12)) + 1 if step > span / 1e12 else np.inf
    check_count(count)
    return (low + high) / 2 + (np.arange(int(count)) - (count - 1) / 2) * step


@dataclass(frozen=True, kw_only=True)
class Circles:
    """Circles around a vertical axis, for `orbit`.

    Attributes
    ----------
    radius : float
        Radius of the circles, metres.
    heights : float or sequence of float
        z of each circle, metres, in the order of flight.
    centre : (3,) array_like, optional
        Point that the cameras look at, through which the axis runs, metres; the middle of the
        bounding box by default.
    tilt_deg : float, optional
        Tilt of all views below the horizontal, degrees, (-90, 90); by default they look at the
        centre.
    front : float
        Overlap of neighbours on a circle, measured at the axis, as a share, [0, 1); it has no
        effect with `count`.
    count : int, optional
        Number of images of a circle.

    Raises
    ------
    ConfigError
        For a value outside its range.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import Circles
    >>> rings = Circles(radius=5, heights=[1, 3], count=12)
    >>> rings.radius, rings.count
    (5, 12)
    """

    radius: float
    heights: float | Sequence[float]
    centre: ArrayLike | None = None
    tilt_deg: float | None = None
    front: float = 0.8
    count: int | None = None

    def __post_init__(self) -> None:
        check_fields(self)
        check_overlap(front=self.front)
        if not 0 < self.radius < np.inf:
            raise ConfigError(f"expected radius above 0 m, got {self.radius:g}; correct it")
        if self.tilt_deg is not None and not abs(self.tilt_deg) < 90:
            raise ConfigError(f"expected tilt_deg within 90, got {self.tilt_deg:g}; 0 is level")
        if self.count is not None and self.count < 1:
            raise ConfigError(f"expected count of 1 or more, got {self.count}; increase it")
        finite_points("heights", np.atleast_1d(self.heights), (-1,), "finite numbers")
        if self.centre is not None:
            finite_points("centre", self.centre, (3,), "three finite numbers")


@typed
def orbit(
    mesh: Mesh, camera: Camera, framing: Framing = DEFAULT, *, circles: Circles
) -> Candidates:
    """Views inwards from circles around a vertical axis.

    Parameters
    ----------
    mesh : Mesh
        The scene; z is up.
    camera : Camera
        Camera to place.
    framing : Framing, optional
        Only its rolls apply.
    circles : Circles
        The circles.

    Returns
    -------
    Candidates
        Circle by circle, alternately counter-clockwise and clockwise seen from above; `index`
        counts them.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import Circles, orbit
    >>> mesh, camera = rc.shapes.box(), rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> poses = orbit(mesh, camera, circles=Circles(radius=5, heights=[1, 3], count=12))
    >>> len(poses), poses.sources
    (24, ('orbit',))
    """
    radius, tilt_deg = circles.radius, circles.tilt_deg
    levels = np.atleast_1d(np.asarray(circles.heights, np.float64))
    middle = mesh.centre
    if circles.centre is not None:
        middle = np.asarray(circles.centre, np.float64)
    width, _ = image_sides(camera, framing)
    step = (1 - circles.front) * width * (growth(camera, radius) / radius)
    number = np.ceil(2 * np.pi / step * (1 - 1e-12)) if circles.count is None else circles.count
    check_count(number * len(levels))
    angles = 2 * np.pi * np.arange(int(number)) / number
    eyes, targets = [], []
    for row, level in enumerate(levels.tolist()):
        turn = angles if row % 2 == 0 else angles[::-1]
        outward = np.stack((cos(turn), sin(turn), np.zeros(len(turn))), axis=1)
        own = middle * (1, 1, 0) + radius * outward + (0, 0, level)
        eyes.append(own)
        drop = middle[2] - level if tilt_deg is None else -radius * tan(np.radians(tilt_deg))
        targets.append(own - radius * outward + np.array((0, 0, drop)))
    poses = look_at(np.concatenate(eyes), np.concatenate(targets))
    return roll_candidates(poses, "orbit", np.arange(len(poses)), framing)
