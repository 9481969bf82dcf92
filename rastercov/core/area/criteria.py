"""Smooth criteria of points of a surface, by which `Regions.where` cuts.

A criterion is a function g of the points of a face, with its gradient and a bound of its
nonlinearity, see `rastercov/engine/area/criteria.hpp`; it holds where g >= 0. Those of several
devices take the devices that see each piece from `Regions.devices`, and all of them where it has
none. Occlusion is not tested: give regions that the devices see.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    ConfigError,
    FloatArray,
    InOneLine,
    check_choice,
    cos,
    finite_number,
    finite_points,
    flag,
    frozen_record,
    norm,
    shown,
)
from rastercov.base.arguments import ray_angle

MOST_DEVICES = 64
"""Devices of a criterion, and of a set of them."""


class Cut(NamedTuple):
    """Loops of `native.area_cut`, cut_by_NAME and values_of_NAME, and the record that they take."""

    name: str
    record: tuple[Any, ...]


@runtime_checkable
class AreaCriterion(Protocol):
    """A condition that `Regions.where` takes."""

    def _cuts(self, n_rows: int) -> Sequence[Cut]:
        """Cuts one after another, for regions of that many rows."""


@frozen_record(repr=False)
class RayAngle(InOneLine):
    """Angle between the rays from a point to two camera centres, for `Regions.where`.

    Attributes
    ----------
    eyes : (2, 3) or (P, 2, 3) float64
        The two centres, metres; for all regions, or for each row of them.
    degrees : float
        Limit, degrees, 0 or [0.001, 180].
    is_least : bool
        True if the angle must be at least the limit, False if at most.

    Raises
    ------
    ConfigError
        For a value outside these limits.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> eyes = [(-0.1, 0, 0.6), (0.1, 0, 0.6)]
    >>> both = rc.regions(mesh, camera, rc.look_at(eyes, (0, 0, 0))).at_least(2)
    >>> wide = [both.where(rc.RayAngle(eyes, degrees)) for degrees in (10, 22, 40)]
    >>> [each.areas().sum().round(4).item() for each in wide]  # m^2
    [0.04, 0.0302, 0.0]
    """

    eyes: ArrayLike
    degrees: float
    is_least: bool = True

    def __post_init__(self) -> None:
        set_fields(self, eyes=points_of("eyes", self.eyes, (2, 3)))
        set_fields(self, degrees=ray_angle("degrees", self.degrees))
        set_fields(self, is_least=flag("is_least", self.is_least))

    def _cuts(self, n_rows: int) -> Sequence[Cut]:
        """See `AreaCriterion`."""
        sign = -1.0 if self.is_least else 1.0
        limit = sign * cos(math.radians(self.degrees))
        return [Cut("angle", (_rows("eyes", self.eyes, n_rows), sign, limit))]


@frozen_record(repr=False)
class BeamDensity(InOneLine):
    """Beams per m^2 of a scanner with equal steps in azimuth and elevation, for `Regions.where`.

    The density is h / (d^2 rho D^2) with D the step in radians, h the height of the scanner over
    the plane of the face, d the distance of the point, and rho its distance from the axis.

    Attributes
    ----------
    centres, axes : (3,) or (P, 3) float64
        Centre of the scanner, metres, and its axis of rotation, of any length; for all regions, or
        for each row of them.
    step_deg : float
        Angle between neighbouring beams, degrees, (0, 90].
    limit : float
        Minimum beams per m^2, above 0.

    Raises
    ------
    ConfigError
        For a value outside these limits.

    Examples
    --------
    >>> import rastercov as rc
    >>> scanner = rc.Camera(width=3600, height=1800, fx=573, fy=573, model="equirectangular")
    >>> seen = rc.regions(rc.shapes.box((2, 2, 2)), scanner, rc.look_at((3, 0, 0), (0, 0, 0)))
    >>> dense = seen.where(rc.BeamDensity((3, 0, 0), (0, 0, 1), step_deg=0.1, limit=70_000))
    >>> seen.areas().sum().round(2).item(), dense.areas().sum().round(2).item()  # m^2
    (4.0, 1.74)
    """

    centres: ArrayLike
    axes: ArrayLike
    step_deg: float
    limit: float

    def __post_init__(self) -> None:
        set_fields(self, centres=points_of("centres", self.centres, (3,)))
        axes = unit_axes(points_of("axes", self.axes, (3,)))
        step = above_zero("step_deg", angle_to("step_deg", self.step_deg, 90))
        set_fields(self, axes=axes, step_deg=step, limit=above_zero("limit", self.limit))

    def _cuts(self, n_rows: int) -> Sequence[Cut]:
        """See `AreaCriterion`."""
        arrays = rows_of(self, n_rows, centres=1, axes=1)
        scale = np.full(n_rows, math.radians(self.step_deg) ** -2)
        return [Cut("beams", (*arrays, scale, np.full(n_rows, self.limit)))]


@frozen_record(repr=False)
class Uncertainty(InOneLine):
    """Standard deviation of a point that several sensors measure, for `Regions.where`.

    It follows from one information matrix M.

    M is the sum of (I - u u^T) / (sigma d)^2 for rays, m m^T / (sigma d)^2 for stripes and laser
    sheets of normal m, and cos(i)^2 u u^T / s^2 for ranges as well, with u the unit ray to a sensor
    at distance d, and i the incidence angle; the covariance is the inverse of M. Errors are small,
    independent and without bias.

    Attributes
    ----------
    eyes : (n, 3) or (P, n, 3) float64
        Centres of up to 64 sensors, metres, for all regions or for each row of them. Sensor j
        counts on pieces whose `Regions.devices` have bit j, or on all pieces without `devices`.
    limit : float
        Largest standard deviation, metres, above 0.
    noise : float, or (n,) or (P, n) float64
        sigma: standard deviation of rays or stripes, radians, above 0.
    stripes : (n, 3) or (P, n, 3) float64, optional
        Directions of stripes in space, such as the image columns of a projector, or an axis in a
        laser sheet; (0, 0, 0) for sensors that measure rays.
    ranges : float, or (n,) or (P, n) float64
        s: standard deviation of the range at normal incidence, metres; 0 where none is measured, as
        for stripes.
    along : {"worst", "normal"}
        Direction of the standard deviation: the worst, or the surface normal.

    Raises
    ------
    ConfigError
        For a value outside these limits.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> eyes = [(-0.1, 0, 0.6), (0.1, 0, 0.6)]
    >>> both = rc.regions(mesh, camera, rc.look_at(eyes, (0, 0, 0))).at_least(2)
    >>> for limit in (1e-3, 4e-4, 3e-4):  # metres
    ...     sharp = both.where(rc.Uncertainty(eyes, limit, noise=2e-4))
    ...     print(sharp.areas().sum().round(4).item())  # m^2
    0.04
    0.0399
    0.0
    """

    eyes: ArrayLike
    limit: float
    noise: ArrayLike
    stripes: ArrayLike = (0.0, 0.0, 0.0)
    ranges: ArrayLike = 0.0
    along: str = "worst"

    def __post_init__(self) -> None:
        eyes = device_places("eyes", self.eyes, "devices")
        noise, ranges = (
            broadcast(name, getattr(self, name), eyes.shape[:-1]) for name in ("noise", "ranges")
        )
        if not (noise > 0).all() or not (ranges >= 0).all():
            raise ConfigError(
                "expected noise above 0 and ranges of 0 or more, got other values; give rad and m"
            )
        stripes = broadcast("stripes", self.stripes, eyes.shape)
        lengths = norm(stripes)[..., None]
        if not ((lengths[..., 0] == 0) | (ranges == 0)).all():
            raise ConfigError("expected stripes or ranges of a sensor, got both; leave one out")
        check_choice("along", self.along, ("worst", "normal"))
        set_fields(
            self, eyes=eyes, noise=noise, ranges=ranges, limit=above_zero("limit", self.limit)
        )
        set_fields(self, stripes=stripes / np.where(lengths > 0, lengths, 1.0))

    def _cuts(self, n_rows: int) -> Sequence[Cut]:
        """See `AreaCriterion`."""
        devices = rows_of(self, n_rows, eyes=2, stripes=2, noise=1, ranges=1)
        return [Cut("uncertainty", (devices, self.limit, self.along == "normal"))]


class PixelDensity(NamedTuple):
    """Pixels per m^2 of lenses with a closed form, by row of regions: h / (d^2 rho) and h / d^3.

    Attributes
    ----------
    centres, axes : (P, 3) float64
        Of the panorama; (0, 0, 0) for a lens of equal area.
    scales, limits : (P,) float64
        Pixels per steradian at the horizon; minimum pixels per m^2, 0 for no limit.
    """

    centres: FloatArray
    axes: FloatArray
    scales: FloatArray
    limits: FloatArray

    def _cuts(self, n_rows: int) -> Sequence[Cut]:
        """See `AreaCriterion`."""
        return [Cut("beams", tuple(map(np.ascontiguousarray, self)))]


def set_fields(criterion: object, **values: object) -> None:
    """Set fields of a frozen criterion."""
    for name, value in values.items():
        object.__setattr__(criterion, name, value)


def above_zero(name: str, value: object) -> float:
    """Number above 0."""
    number = finite_number(value)
    if not number > 0:
        raise ConfigError(f"expected {name} above 0, got {shown(value)}; give a number")
    return number


def angle_to(name: str, value: object, most: float) -> float:
    """Angle of 0 to `most` degrees."""
    number = finite_number(value)
    if not 0 <= number <= most:
        raise ConfigError(f"expected {name} from 0 to {most}, got {shown(value)}; give degrees")
    return number


def points_of(name: str, values: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """Coordinates of that shape, or one of them for each row of regions."""
    ndim = np.ndim(values) if isinstance(values, np.ndarray | list | tuple) else len(shape)
    wanted = ", ".join("n" if each < 0 else str(each) for each in shape) + "," * (len(shape) == 1)
    words = f"coordinates ({wanted}) or (P, {wanted})"
    return finite_points(name, values, (-1, *shape) if ndim > len(shape) else shape, words)


def device_places(name: str, values: ArrayLike, noun: str) -> FloatArray:
    """Places of devices of which a set has a bit each."""
    points = points_of(name, values, (-1, 3))
    if not 1 <= points.shape[-2] <= MOST_DEVICES:
        raise ConfigError(
            f"expected 1 to {MOST_DEVICES} {noun} in {name}, got {points.shape[-2]}; leave some out"
        )
    return points


def unit_axes(axes: FloatArray) -> FloatArray:
    """Axes of length 1."""
    lengths = norm(axes)[..., None]
    if not (lengths > 0).all():
        raise ConfigError("expected axes longer than 0, got one of length 0; give a direction")
    return axes / lengths


def broadcast(name: str, values: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """Finite numbers, broadcast to a shape."""
    given = np.asarray(values) if np.ndim(values) <= len(shape) else np.empty(0)
    words = f"finite numbers that fit shape {shape}"
    points = finite_points(name, values, (-1,) * given.ndim, words)
    try:
        return np.broadcast_to(points, shape)
    except ValueError:
        raise ConfigError(
            f"expected {name} as {words}, got shape {points.shape}; give one, or one for each"
        ) from None


def _rows(name: str, values: ArrayLike, n_rows: int, ndim: int = 2) -> Any:
    """Values of each row of regions, contiguous."""
    array = np.asarray(values)
    if array.ndim == ndim:
        array = np.broadcast_to(array, (n_rows, *array.shape))
    if len(array) != n_rows:
        raise ConfigError(
            f"expected {name} of 1 or {n_rows} rows, as the regions, got {len(array)}; change it"
        )
    return np.ascontiguousarray(array)


def rows_of(criterion: object, n_rows: int, **ndims: int) -> tuple[Any, ...]:
    """Fields of a criterion for each row of regions, by their numbers of dimensions in one."""
    return tuple(
        _rows(name, getattr(criterion, name), n_rows, ndim) for name, ndim in ndims.items()
    )
