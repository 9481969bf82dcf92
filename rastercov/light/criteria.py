"""Criteria of light at points of a surface, by which `Regions.where` cuts."""

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    ConfigError,
    FloatArray,
    InOneLine,
    finite_points,
    flag,
    frozen_record,
    members,
    offsets_of,
    shown,
)
from rastercov.core.area.criteria import (
    MOST_DEVICES,
    Cut,
    above_zero,
    angle_to,
    broadcast,
    device_places,
    points_of,
    rows_of,
    set_fields,
    unit_axes,
)


class Web(NamedTuple):
    """Shares of the intensity of a lamp by two angles, degrees, linear in both between them.

    Attributes
    ----------
    angles : (K,) float64
        From the pole, ascending from 0 to 180.
    turns : (M,) float64
        Around the pole, ascending through a full turn: the last is the first + 360.
    shares : (M, K) float64
        0 or more.
    """

    angles: FloatArray
    turns: FloatArray
    shares: FloatArray


@frozen_record(repr=False)
class Illuminance(InOneLine):
    """Illuminance of a point by lamps: the sum of I h / d^3 over those that see it.

    For `Regions.where`.

    I = I0 cos^m of the angle to the axis of the lamp, where that is below 90 degrees, or I0 for m =
    0; or I0 times a table or a web. h is the height of the lamp over the plane of the face, d its
    distance.

    Attributes
    ----------
    positions : (n, 3) or (P, n, 3) float64
        Centres of up to 64 lamps, metres, for all regions or for each row of them. Lamp j counts on
        pieces whose `Regions.devices` have bit j, or on all pieces without `devices`.
    limit : float
        Limit of the illuminance: lx with intensities in cd, W/m^2 with W/sr; above 0.
    intensities : float, or (n,) or (P, n) float64
        I0, cd or W/sr, 0 or more; 1 unless given.
    axes : (n, 3) or (P, n, 3) float64, optional
        Axes of the lamps, in the direction of the light, of any length; (0, 0, 1) unless given.
    exponents : float, or (n,) or (P, n) float64
        m: 0, the default, or 1 to 1000.
    tables : sequence of (K, 4) float64
        Tables of I / I0 by the cosine of the angle to the axis, cubic in between. Columns: cosine,
        ascending from -1 to 1; value; its derivatives by the cosine below and above it.
    table : int, or (n,) or (P, n) int64
        Index in `tables` of each lamp; -1, the default, for its exponent.
    is_least : bool
        True if the illuminance must be at least the limit, False if at most.
    webs : sequence of (angles, turns, shares)
        I / I0 by two angles, linear in between: `angles` from the pole, (K,) degrees ascending from
        0 to 180; `turns` around it, (M,) degrees ascending through a full turn, the last equal to
        the first + 360; `shares`, (M, K), 0 or more.
    web : int, or (n,) or (P, n) int64
        Index in `webs` of each lamp, instead of its table and exponent; -1, the default, for these.
    frames : (n, 3, 3) or (P, n, 3, 3) float64, optional
        Frame of each web, orthonormal: the directions at 0 and 90 degrees around the pole, and the
        pole.

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
        set_fields(self, positions=device_places("positions", self.positions, "lamps"))
        shape = np.shape(self.positions)
        axes = unit_axes(broadcast("axes", self.axes, shape))
        intensities = broadcast("intensities", self.intensities, shape[:-1])
        exponents = broadcast("exponents", self.exponents, shape[:-1])
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
            values = tuple(map(reader, members(name, given, object, name, ConfigError)))
            one = name[:-1]
            row = broadcast(one, getattr(self, one), shape[:-1])
            if not np.isin(row, np.arange(-1, len(values))).all():
                raise ConfigError(
                    f"expected {one} below {len(values)}, got {shown(getattr(self, one))}; -1 is "
                    "none"
                )
            set_fields(self, **{name: values, one: row.astype(np.int64)})
        set_fields(self, frames=_frames(broadcast("frames", self.frames, (*shape[:-1], 3, 3))))
        set_fields(self, axes=axes, intensities=intensities, exponents=exponents)
        set_fields(
            self, is_least=flag("is_least", self.is_least), limit=above_zero("limit", self.limit)
        )

    def _cuts(self, n_rows: int) -> Sequence[Cut]:
        """See `Criterion`."""
        sign = 1.0 if self.is_least else -1.0
        arrays = rows_of(self, n_rows, positions=2, axes=2, intensities=1, exponents=1, table=1)
        starts = offsets_of([len(np.asarray(each)) for each in self.tables])
        knots = np.concatenate([np.empty((0, 4)), *self.tables])
        of_webs = rows_of(self, n_rows, web=1, frames=3)
        lamps = (
            *arrays,
            knots,
            starts.astype(np.int64),
            *of_webs,
            _join_webs([Web(*map(np.asarray, web)) for web in self.webs]),
        )
        return [Cut("light", (lamps, sign, sign * self.limit))]


@frozen_record(repr=False)
class Highlight(InOneLine):
    """Angle between the normal and the half vector of the rays to a camera and to a lamp.

    For `Regions.where`. It is 0 where a mirror would show the lamp, on the side of the face that
    the camera is on.

    Attributes
    ----------
    eyes : (3,) or (P, 3) float64
        Camera centre, metres: one for all regions, or one for each row of them.
    positions : (n, 3) or (P, n, 3) float64
        Centres of up to 64 lamps, metres; as for `Illuminance`, only those that see a point count.
    degrees : float
        Limit, degrees, [0, 90].
    is_least : bool
        True if the angle to each lamp must be at least the limit, so that there is no highlight;
        False if at most.

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
        set_fields(self, eyes=points_of("eyes", self.eyes, (3,)))
        set_fields(self, positions=device_places("positions", self.positions, "lamps"))
        set_fields(
            self,
            degrees=angle_to("degrees", self.degrees, 90),
            is_least=flag("is_least", self.is_least),
        )

    def _cuts(self, n_rows: int) -> Sequence[Cut]:
        """See `Criterion`."""
        eyes, lamps = rows_of(self, n_rows, eyes=1, positions=2)
        sign, cosine = 1.0 if self.is_least else -1.0, math.cos(math.radians(self.degrees))
        return [
            Cut("highlight", (eyes, lamps[:, at].copy(), at, sign, cosine))
            for at in range(lamps.shape[1])
        ]


def _frames(frames: FloatArray) -> FloatArray:
    """Frames at right angles."""
    squares = frames @ np.swapaxes(frames, -1, -2)
    if not np.allclose(squares, np.eye(3), rtol=0, atol=1e-6):
        raise ConfigError(
            "expected frames of three unit vectors at right angles, got other vectors; correct them"
        )
    return frames


def _web(values: object) -> Web:
    """Web of its angles, turns and shares."""
    wanted = "angles that ascend from 0 to 180, planes to the first + 360, and shares of 0 or more"
    parts = members("webs", values, object, wanted, ConfigError)
    if len(parts) == 3:
        angles, turns = (finite_points("webs", each, (-1,), wanted) for each in parts[:2])
        shares = finite_points("webs", parts[2], (-1, -1), wanted)
        is_grid = shares.shape == (len(turns), len(angles)) and bool((shares >= 0).all())
        if is_grid and _rises(angles, 180) and angles[0] == 0 and _rises(turns, 360):
            return Web(angles, turns, shares)
    raise ConfigError(f"expected webs of {wanted}, got other values; sort and complete them")


def _rises(knots: FloatArray, over: float) -> bool:
    """True for angles that ascend over a range, degrees."""
    return bool(
        len(knots) >= 2
        and (np.diff(knots) > 0).all()
        and abs(float(knots[-1] - knots[0]) - over) < 1e-9
    )


def _join_webs(webs: Sequence[Web]) -> tuple[Any, ...]:
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
