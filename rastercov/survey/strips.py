"""Candidate poses of an aerial survey: parallel strips over a polygon, in the order of flight.

Images overlap by at least the given shares at the highest point of the ground, and by more
elsewhere. In the axes of the strips, x across and y along, neighbours are apart by

    (1 - side) 2 H tan(across),  (1 - front) 2 H tan(down)

for the half angles of the image and the height H above the ground. A view tilted by t shows a
trapezoid, whose width grows with its distance D from the camera, from n = cos(down)/cos(t - down)
to f = cos(down)/cos(t + down) times H. Neighbours in a strip then share the part from n on up to
D = sqrt(n^2 + front (f^2 - n^2)), where that makes the step smaller.
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import ConfigError, FloatArray, finite_number, finite_points, shown
from rastercov.base.typed import check_fields, typed
from rastercov.core.camera import Camera, look_at
from rastercov.core.camera.viewpoints import half_angles
from rastercov.core.mesh import Mesh
from rastercov.placement.candidates.ground import heights_at, outline
from rastercov.placement.candidates.pool import DEFAULT, Candidates, Framing, roll_candidates

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
    half = np.arctan(down / 2)
    near, far = np.cos(half) / np.cos((tilt - half, tilt + half))
    if far > 0 and not camera.is_parallel:  # below the horizon
        shared = np.sqrt(near**2 + survey.front * (far**2 - near**2))
        steps[1] *= min(1.0, 2 * np.cos(tilt) * (near * far) ** 2 / (far + shared))
    angle = np.radians(survey.heading_deg)
    forward = np.array((np.sin(angle), np.cos(angle)))
    right = np.array((forward[1], -forward[0]))
    xy = _lattice(area, np.stack((right, forward)), steps)
    z = np.full(len(xy), level)
    if survey.follow:
        below = heights_at(mesh, xy)
        z = np.where(np.isnan(below), level, below)
    eyes = np.column_stack((xy, z + away))
    ahead = np.append(forward, 0.0)
    view = np.sin(tilt) * ahead - np.cos(tilt) * np.array((0.0, 0.0, 1.0))
    up = np.cos(tilt) * ahead + np.sin(tilt) * np.array((0.0, 0.0, 1.0))
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

    area = shapely.transform(area, lambda xy: xy @ axes.T)
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
    return np.concatenate(values) @ axes
