"""Smooth criteria of points of a surface, by which `Regions.where` cuts.

A criterion is a function g of the points of a face, with its gradient and a bound of its
nonlinearity, see `rastercov/native/area/criteria.hpp`; it holds where g >= 0. Those of several
devices take the devices that see each piece from `Regions.devices`, and all of them where it has
none. Occlusion is not tested: give regions that the devices see.
"""

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base.arguments import check_choice, finite_points, flag, members
from rastercov.base.checks import finite_number, shown
from rastercov.base.errors import ConfigError
from rastercov.base.format import InOneLine
from rastercov.base.memory import FloatArray

MOST_DEVICES = 64
"""Devices of a criterion, and of a set of them."""


class Web(NamedTuple):
    """Shares of the intensity of a lamp by two angles, degrees, linear in both between them.

    Attributes
    ----------
    angles : (K,) float64
        From the pole, ascending from 0 to 180.
    turns : (M,) float64
        Around the pole, ascending over 360; the first and last coincide.
    shares : (M, K) float64
        0 or more.
    """

    angles: FloatArray
    turns: FloatArray
    shares: FloatArray


class Cut(NamedTuple):
    """Loops of `native.area_cut`, cut_by_NAME and values_of_NAME, and the record that they take."""

    name: str
    record: tuple[Any, ...]


@runtime_checkable
class Criterion(Protocol):
    """A condition that `Regions.where` takes."""

    def _cuts(self, n_rows: int) -> Sequence[Cut]:
        """Cuts one after another, for regions of that many rows."""


@dataclass(frozen=True, eq=False, repr=False)
class RayAngle(InOneLine):
    """Angle between the rays from a point to two centres of cameras.

    Attributes
    ----------
    eyes : (2, 3) or (P, 2, 3) float64
        Metres; those of each row of regions, or of all.
    degrees : float
        Limit, [0, 180].
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
        _set(self, eyes=_points("eyes", self.eyes, (2, 3)))
        _set(self, degrees=_angle("degrees", self.degrees, 180), is_least=_is_least(self))

    def _cuts(self, n_rows: int) -> Sequence[Cut]:
        """See `Criterion`."""
        sign = -1.0 if self.is_least else 1.0
        limit = sign * math.cos(math.radians(self.degrees))
        return [Cut("angle", (_rows("eyes", self.eyes, n_rows), sign, limit))]


@dataclass(frozen=True, eq=False, repr=False)
class Illuminance(InOneLine):
    """Illuminance of a point by lamps, I h / d^3 of each that sees it, added up.

    I = I0 cos^m of the angle to the axis of the lamp, where that is below 90 degrees, or I0 for m =
    0; or I0 times a table or a web. h is the height of the lamp over the plane of the face, d its
    distance.

    Attributes
    ----------
    positions : (n, 3) or (P, n, 3) float64
        Metres; up to 64 lamps, those of each row of regions, or of all. Lamp j counts on pieces
        whose `Regions.devices` have bit j.
    limit : float
        Of the illuminance: lx for cd, W/m^2 for W/sr; above 0.
    intensities : float, or (n,) or (P, n) float64
        I0, cd or W/sr, 0 or more.
    axes : (n, 3) or (P, n, 3) float64, optional
        Directions of light, of any length; (0, 0, 1) unless given.
    exponents : float, or (n,) or (P, n) float64
        m, 0, or 1 to 1000.
    tables : sequence of (K, 4) float64
        Tables of I / I0 by the cosine of the angle to the axis: rows of cosine, ascending from -1
        to 1, value, and slope by the cosine before and after it, cubic in between.
    table : int, or (n,) or (P, n) int64
        Table of each lamp, -1 for its exponent.
    is_least : bool
        True if the illuminance must be at least the limit, False if at most.
    webs : sequence of (angles, turns, shares)
        See `rastercov.coverage.area.criteria.Web`.
    web : int, or (n,) or (P, n) int64
        Web of each lamp, in place of its table and exponent; -1 for these.
    frames : (n, 3, 3) or (P, n, 3, 3) float64, optional
        Directions of turns of 0 and 90 degrees, and of the pole, at right angles, of webs.

    Raises
    ------
    ConfigError
        For a value outside these limits.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> seen = rc.regions(mesh, camera, rc.look_at((0, 0, 0.6), (0, 0, 0)))
    >>> bright = seen.where(rc.Illuminance([(0, 0, 0.6)], limit=380, intensities=100))  # lx, cd
    >>> seen.areas().sum().round(4).item(), bright.areas().sum().round(4).item()  # m^2
    (0.04, 0.0273)
    """

    positions: ArrayLike
    limit: float
    intensities: ArrayLike = 1.0
    axes: ArrayLike = (0.0, 0.0, 1.0)
    exponents: ArrayLike = 0.0
    tables: Sequence[ArrayLike] = field(default=())
    table: ArrayLike = -1
    is_least: bool = True
    webs: Sequence[tuple[ArrayLike, ArrayLike, ArrayLike]] = field(default=())
    web: ArrayLike = -1
    frames: ArrayLike = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

    def __post_init__(self) -> None:
        _set(self, positions=_devices("positions", self.positions, "lamps"))
        shape = np.shape(self.positions)
        axes = _directions(_like("axes", self.axes, shape))
        intensities = _like("intensities", self.intensities, shape[:-1])
        exponents = _like("exponents", self.exponents, shape[:-1])
        if not (intensities >= 0).all():
            raise ConfigError(
                f"expected intensities of 0 or more, got {shown(self.intensities)}; 0 is no light"
            )
        if not ((exponents == 0) | ((exponents >= 1) & (exponents <= 1000))).all():
            raise ConfigError(
                f"expected exponents of 0, or 1 to 1000, got {shown(self.exponents)}; 0 is "
                "isotropic"
            )
        for name, reader in (("tables", _table), ("webs", _web)):
            given = getattr(self, name)
            with suppress(TypeError):  # of no length
                if (n := len(given)) > MOST_DEVICES:
                    raise ConfigError(
                        f"expected at most {MOST_DEVICES} {name}, got {n:,}; share some"
                    )
            found = tuple(map(reader, members(name, given, object, name, ConfigError)))
            one = name[:-1]
            row = _like(one, getattr(self, one), shape[:-1])
            if not np.isin(row, np.arange(-1, len(found))).all():
                raise ConfigError(
                    f"expected {one} below {len(found)}, got {shown(getattr(self, one))}; -1 is "
                    "none"
                )
            _set(self, **{name: found, one: row.astype(np.int64)})
        _set(self, frames=_frames(_like("frames", self.frames, (*shape[:-1], 3, 3))))
        _set(self, axes=axes, intensities=intensities, exponents=exponents)
        _set(self, is_least=_is_least(self), limit=_positive("limit", self.limit))

    def _cuts(self, n_rows: int) -> Sequence[Cut]:
        """See `Criterion`."""
        sign = 1.0 if self.is_least else -1.0
        arrays = _arrays(self, n_rows, positions=2, axes=2, intensities=1, exponents=1, table=1)
        starts = np.cumsum([0, *(len(np.asarray(each)) for each in self.tables)])
        knots = np.concatenate([np.empty((0, 4)), *self.tables])
        of_webs = _arrays(self, n_rows, web=1, frames=3)
        lamps = (
            *arrays,
            knots,
            starts.astype(np.int64),
            *of_webs,
            _joined([Web(*map(np.asarray, web)) for web in self.webs]),
        )
        return [Cut("light", (lamps, sign, sign * self.limit))]


@dataclass(frozen=True, eq=False, repr=False)
class Highlight(InOneLine):
    """Angle between the normal and the half vector of the rays to a camera and to a lamp.

    It is 0 where a mirror would show the lamp, on the side of the face that the camera is on.

    Attributes
    ----------
    eyes : (3,) or (P, 3) float64
        Centres of cameras, metres; that of each row of regions, or of all.
    positions : (n, 3) or (P, n, 3) float64
        Lamps, metres: the angle of each of them that sees a point, by `Regions.devices`.
    degrees : float
        Limit, [0, 90].
    is_least : bool
        True if the angles must be at least the limit, so that there is no highlight; False if at
        most.

    Raises
    ------
    ConfigError
        For a value outside these limits.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> eye, lamp = (0.1, 0, 0.6), (-0.1, 0, 0.6)
    >>> seen = rc.regions(mesh, camera, rc.look_at(eye, (0, 0, 0.1)))
    >>> free = seen.where(rc.Highlight(eye, [lamp], degrees=5))
    >>> seen.areas().sum().round(4).item(), free.areas().sum().round(4).item()  # m^2
    (0.04, 0.0337)
    """

    eyes: ArrayLike
    positions: ArrayLike
    degrees: float
    is_least: bool = True

    def __post_init__(self) -> None:
        _set(self, eyes=_points("eyes", self.eyes, (3,)))
        _set(self, positions=_devices("positions", self.positions, "lamps"))
        _set(self, degrees=_angle("degrees", self.degrees, 90), is_least=_is_least(self))

    def _cuts(self, n_rows: int) -> Sequence[Cut]:
        """See `Criterion`."""
        eyes, lamps = _arrays(self, n_rows, eyes=1, positions=2)
        sign, cosine = 1.0 if self.is_least else -1.0, math.cos(math.radians(self.degrees))
        return [
            Cut("highlight", (eyes, lamps[:, at].copy(), at, sign, cosine))
            for at in range(lamps.shape[1])
        ]


@dataclass(frozen=True, eq=False, repr=False)
class BeamDensity(InOneLine):
    """Beams per m^2 of a scanner with equal steps in azimuth and elevation.

    h / (d^2 rho D^2) for the step D and the distance rho from the axis.

    Attributes
    ----------
    centres, axes : (3,) or (P, 3) float64
        Metres; of each row of regions, or of all. Axes are of any length.
    step_deg : float
        Between two beams, (0, 90].
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
        _set(self, centres=_points("centres", self.centres, (3,)))
        axes = _directions(_points("axes", self.axes, (3,)))
        step = _positive("step_deg", _angle("step_deg", self.step_deg, 90))
        _set(self, axes=axes, step_deg=step, limit=_positive("limit", self.limit))

    def _cuts(self, n_rows: int) -> Sequence[Cut]:
        """See `Criterion`."""
        arrays = _arrays(self, n_rows, centres=1, axes=1)
        scale = np.full(n_rows, math.radians(self.step_deg) ** -2)
        return [Cut("beams", (*arrays, scale, np.full(n_rows, self.limit)))]


@dataclass(frozen=True, eq=False, repr=False)
class Uncertainty(InOneLine):
    """Standard deviation of a point that several sensors measure, from one information matrix.

    M = sum of (I - u u^T) / (sigma d)^2 for rays, m m^T / (sigma d)^2 for stripes and laser sheets
    of normal m, and cos(i)^2 u u^T / s^2 for ranges as well; the covariance is its inverse. Errors
    are small, independent and without bias.

    Attributes
    ----------
    eyes : (n, 3) or (P, n, 3) float64
        Centres of up to 64 sensors, metres, of each row of regions, or of all. Sensor j counts on
        pieces whose `Regions.devices` have bit j.
    limit : float
        Largest standard deviation, metres, above 0.
    noise : float, or (n,) or (P, n) float64
        sigma: standard deviation of rays or stripes, radians, above 0.
    stripes : (n, 3) or (P, n, 3) float64, optional
        Directions of stripes in space, such as the image columns of a projector, or an axis in a
        laser sheet; (0, 0, 0) for sensors that measure rays.
    ranges : float, or (n,) or (P, n) float64
        s: standard deviation of the range at right angles, metres; 0 where none is measured, as of
        stripes.
    along : {"worst", "normal"}
        Direction of the deviation: the worst, or the normal of the surface.

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
        eyes = _devices("eyes", self.eyes, "devices")
        noise, ranges = (
            _like(name, getattr(self, name), eyes.shape[:-1]) for name in ("noise", "ranges")
        )
        if not (noise > 0).all() or not (ranges >= 0).all():
            raise ConfigError(
                "expected noise above 0 and ranges of 0 or more, got others; give rad and m"
            )
        stripes = _like("stripes", self.stripes, eyes.shape)
        lengths = np.linalg.norm(stripes, axis=-1, keepdims=True)
        if ((lengths[..., 0] > 0) & (ranges > 0)).any():
            raise ConfigError("expected stripes or ranges of a device, got both; leave one out")
        check_choice("along", self.along, ("worst", "normal"))
        _set(self, eyes=eyes, noise=noise, ranges=ranges, limit=_positive("limit", self.limit))
        _set(self, stripes=stripes / np.where(lengths > 0, lengths, 1.0))

    def _cuts(self, n_rows: int) -> Sequence[Cut]:
        """See `Criterion`."""
        devices = _arrays(self, n_rows, eyes=2, stripes=2, noise=1, ranges=1)
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
        """See `Criterion`."""
        return [Cut("beams", tuple(map(np.ascontiguousarray, self)))]


def _set(criterion: object, **values: object) -> None:
    for name, value in values.items():
        object.__setattr__(criterion, name, value)


def _is_least(criterion: "RayAngle | Illuminance | Highlight") -> bool:
    return flag("is_least", criterion.is_least)


def _positive(name: str, value: object) -> float:
    number = finite_number(value)
    if not number > 0:
        raise ConfigError(f"expected {name} above 0, got {shown(value)}; give a number")
    return number


def _angle(name: str, value: object, most: float) -> float:
    number = finite_number(value)
    if not 0 <= number <= most:
        raise ConfigError(f"expected {name} of 0 to {most}, got {shown(value)}; give degrees")
    return number


def _points(name: str, values: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """Coordinates of that shape, or one of them for each row of regions."""
    ndim = np.ndim(values) if isinstance(values, np.ndarray | list | tuple) else len(shape)
    wanted = ", ".join("n" if each < 0 else str(each) for each in shape) + "," * (len(shape) == 1)
    words = f"coordinates ({wanted}) or (P, {wanted})"
    return finite_points(name, values, (-1, *shape) if ndim > len(shape) else shape, words)


def _devices(name: str, values: ArrayLike, noun: str) -> FloatArray:
    """Places of devices of which a set has a bit each."""
    found = _points(name, values, (-1, 3))
    if not 1 <= found.shape[-2] <= MOST_DEVICES:
        raise ConfigError(
            f"expected 1 to {MOST_DEVICES} {noun} in {name}, got {found.shape[-2]}; leave some out"
        )
    return found


def _directions(axes: FloatArray) -> FloatArray:
    lengths = np.linalg.norm(axes, axis=-1, keepdims=True)
    if not (lengths > 0).all():
        raise ConfigError("expected axes longer than 0, got one of length 0; give a direction")
    return axes / lengths


def _like(name: str, values: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """Finite numbers, broadcast to a shape."""
    given = np.asarray(values) if np.ndim(values) <= len(shape) else np.empty(0)
    words = f"finite numbers that fit shape {shape}"
    found = finite_points(name, values, (-1,) * given.ndim, words)
    try:
        return np.broadcast_to(found, shape)
    except ValueError:
        raise ConfigError(
            f"expected {name} as {words}, got shape {found.shape}; give one, or one for each"
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


def _arrays(criterion: object, n_rows: int, **ndims: int) -> tuple[Any, ...]:
    """Fields of a criterion for each row of regions, by their numbers of dimensions in one."""
    return tuple(
        _rows(name, getattr(criterion, name), n_rows, ndim) for name, ndim in ndims.items()
    )


def _frames(frames: FloatArray) -> FloatArray:
    """Frames at right angles."""
    squares = frames @ np.swapaxes(frames, -1, -2)
    if not np.allclose(squares, np.eye(3), rtol=0, atol=1e-6):
        raise ConfigError(
            "expected frames of three unit vectors at right angles, got others; correct them"
        )
    return frames


def _web(values: object) -> Web:
    """Web of its angles, turns and shares."""
    wanted = "angles from 0 up to 180, turns up over 360, and shares of 0 or more of both"
    parts = members("webs", values, object, wanted, ConfigError)
    if len(parts) == 3:
        angles, turns = (finite_points("webs", each, (-1,), wanted) for each in parts[:2])
        shares = finite_points("webs", parts[2], (-1, -1), wanted)
        is_grid = shares.shape == (len(turns), len(angles)) and bool((shares >= 0).all())
        if is_grid and _rises(angles, 180) and angles[0] == 0 and _rises(turns, 360):
            return Web(angles, turns, shares)
    raise ConfigError(f"expected webs of {wanted}, got others; sort and complete them")


def _rises(knots: FloatArray, over: float) -> bool:
    """True for angles that ascend over so many degrees."""
    return bool(
        len(knots) >= 2
        and (np.diff(knots) > 0).all()
        and abs(float(knots[-1] - knots[0]) - over) < 1e-9
    )


def _joined(webs: Sequence[Web]) -> tuple[Any, ...]:
    """Angles and turns of webs, radians, their shares, and where those of each start."""
    sizes = [(len(web.angles), len(web.turns), web.shares.size) for web in webs]
    starts = np.cumsum([(0, 0, 0), *sizes], axis=0).astype(np.int64)
    angles, turns = (
        np.radians(np.r_[np.empty(0), *each])
        for each in ([web.angles for web in webs], [web.turns for web in webs])
    )
    return angles, turns, np.r_[np.empty(0), *(web.shares.ravel() for web in webs)], starts


def _table(values: ArrayLike) -> FloatArray:
    words = "rows of cosine, value, slope before and slope after"
    table = finite_points("tables", values, (-1, 4), words)
    cosines = table[:, 0]
    if len(table) < 2 or not (np.diff(cosines) > 0).all() or cosines[[0, -1]].tolist() != [-1, 1]:
        raise ConfigError(
            f"expected cosines from -1 up to 1 in tables, got {shown(cosines)}; sort the rows"
        )
    if not (table[:, 1] >= 0).all():
        raise ConfigError("expected values of 0 or more in tables, got one below; 0 is no light")
    return table
