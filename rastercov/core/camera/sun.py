"""The sun: its position by place and time, and cameras that see what it lights.

The position follows the low-precision formulae of the Astronomical Almanac, with the parallax of
the sun: within 0.012 degrees (0.0102 in 3 million places and times) of the solar position algorithm
of the NREL from 1950 to 2050, with refraction left out, which lifts
the sun by 0.5 degrees at the horizon and 0.1 degrees from 9 degrees above it. The radius of its
disc is 0.2666 degrees.

J. J. Michalsky. The Astronomical Almanac's Algorithm for Approximate Solar Position (1950-2050).
1988.
"""

import math
from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    CameraError,
    ConfigError,
    FloatArray,
    arcsin,
    arctan2,
    cos,
    finite_points,
    norm,
    shown,
    sin,
)
from rastercov.base.arguments import number
from rastercov.core.camera import Camera
from rastercov.engine import camera_pose

YEARS = 1950, 2050
"""First and last year of the formula."""
EPOCH = datetime(2000, 1, 1, 12, tzinfo=UTC)
"""J2000.0, to a minute between the scales of time: 0.001 degrees of the sun."""
PARALLAX = math.radians(8.794 / 3600)
"""Angle by which the sun is lower at the horizon than seen from the centre of the Earth."""
NORTH_DEG = 90.0
"""Direction of north unless given: +y."""


def angle(name: str, value: object, most: float) -> float:
    """Angle in degrees, at most so far from 0 to either side; CameraError beyond."""
    result = number(name, value)
    if not abs(result) <= most:
        raise CameraError(
            f"expected {name} of -{most:g} to {most:g} degrees, got {result:g}; correct it"
        )
    return result


def towards(azimuth_deg: ArrayLike, elevation_deg: ArrayLike, north_deg: float) -> FloatArray:
    """(..., 3) unit vectors by angles from north, clockwise, and above the horizon; z is up."""
    heading = np.radians(north_deg - np.asarray(azimuth_deg, np.float64))
    height = np.radians(np.asarray(elevation_deg, np.float64))
    across = cos(height)
    x, y, z = across * cos(heading), across * sin(heading), sin(height)
    return np.stack(np.broadcast_arrays(x, y, z), axis=-1)


def sun_directions(
    latitude: float,
    longitude: float,
    times: Sequence[datetime | str],
    north_deg: float = NORTH_DEG,
) -> FloatArray:
    """Directions to the sun by location and time, also below the horizon; z is up.

    Parameters
    ----------
    latitude, longitude : float
        Degrees, north and east positive.
    times : sequence of datetime or str
        With time zone, 1950 to 2050; strings in ISO 8601, such as "2026-06-21T12:00+02:00".
    north_deg : float
        Direction of north in the scene, degrees from +x towards +y; +y unless given.

    Returns
    -------
    (N, 3) float64
        Unit vectors from the scene to the centre of the sun, within 0.012 degrees, without
        refraction.

    Raises
    ------
    CameraError
        For a time without a zone or beyond these years, and angles outside their limits.

    Examples
    --------
    >>> import rastercov as rc
    >>> noon = rc.sun_directions(48.0, 11.5, ["2026-06-21T13:16+02:00"])[0]
    >>> noon.round(3).tolist()  # from the south, 65 degrees high
    [-0.001, -0.416, 0.909]
    """
    moments = [moment("times", each) for each in times]
    lat = math.radians(angle("latitude", latitude, 90.0))
    lon, turned = angle("longitude", longitude, 180.0), angle("north_deg", north_deg, 360.0)
    days = np.array([(each - EPOCH).total_seconds() / 86400 for each in moments]).reshape(-1)
    mean = 280.460 + 0.9856474 * days
    anomaly = np.radians(357.528 + 0.9856003 * days)
    ecliptic = np.radians(mean + 1.915 * sin(anomaly) + 0.020 * sin(2 * anomaly))
    oblique = np.radians(23.439 - 4e-7 * days)
    ascension = arctan2(cos(oblique) * sin(ecliptic), cos(ecliptic))
    declination = arcsin(sin(oblique) * sin(ecliptic))
    sidereal_h = 6.697375 + 0.0657098242 * days + 24 * ((days + 0.5) % 1)
    hour = np.radians(15 * sidereal_h + lon) - ascension
    pole, equator = sin(declination), cos(declination) * cos(hour)
    up = sin(lat) * pole + cos(lat) * equator
    north = cos(lat) * pole - sin(lat) * equator
    azimuth = arctan2(-cos(declination) * sin(hour), north)
    height = arcsin(np.clip(up, -1, 1))
    height -= PARALLAX * cos(height)
    return towards(np.degrees(azimuth), np.degrees(height), turned)


def moment(name: str, value: object) -> datetime:
    """A time with its zone, of a datetime or a text of ISO 8601; CameraError for another."""
    given = value
    if isinstance(value, str):
        try:
            given = datetime.fromisoformat(value)
        except ValueError:
            given = None
    if not isinstance(given, datetime) or given.utcoffset() is None:
        raise CameraError(
            f"expected {name} with a zone, such as 2026-06-21T12:00+02:00, got {shown(value)}; "
            "correct it"
        )
    if not YEARS[0] <= given.year <= YEARS[1]:
        raise CameraError(
            f"expected {name} of the years {YEARS[0]} to {YEARS[1]}, got {given.year}; the formula "
            "holds for these"
        )
    return given


def unit_directions(directions: ArrayLike) -> FloatArray:
    """(N, 3) unit vectors; ConfigError for others than vectors above 0."""
    given = finite_points("directions", directions, (-1, 3), "vectors to the sun, (N, 3)")
    lengths = norm(given)
    if not (lengths > 0).all():
        raise ConfigError("expected directions of a length above 0, got 0; leave these out")
    return given / lengths[:, None]


def views_from(directions: FloatArray, bounds: FloatArray) -> tuple[Camera, FloatArray]:
    """Camera of parallel rays, and its poses (N, 4, 4), that see a box from unit vectors to them.

    The rotations come from the directions alone: the place of the scene rounds none of them.
    """
    poses = np.empty((len(directions), 4, 4))
    px_per_m = camera_pose.see_along(
        np.ascontiguousarray(directions), np.ascontiguousarray(bounds), poses
    )
    side = camera_pose.SUN_SIDE
    return Camera.orthographic(side, side, px_per_m=px_per_m), poses
