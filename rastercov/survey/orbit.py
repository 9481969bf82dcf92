"""Candidate poses on circles around a point, in the order of flight."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import ConfigError, finite_points
from rastercov.base.typed import check_fields, typed
from rastercov.core.camera import Camera, look_at
from rastercov.core.mesh import Mesh
from rastercov.placement.candidates.pool import DEFAULT, Candidates, Framing, roll_candidates
from rastercov.survey.strips import check_count, check_overlap, growth, image_sides


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
        outward = np.stack((np.cos(turn), np.sin(turn), np.zeros(len(turn))), axis=1)
        own = middle * (1, 1, 0) + radius * outward + (0, 0, level)
        eyes.append(own)
        drop = middle[2] - level if tilt_deg is None else -radius * np.tan(np.radians(tilt_deg))
        targets.append(own - radius * outward + np.array((0, 0, drop)))
    poses = look_at(np.concatenate(eyes), np.concatenate(targets))
    return roll_candidates(poses, "orbit", np.arange(len(poses)), framing)
