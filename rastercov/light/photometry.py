"""Intensities of luminaires by direction: shares of the largest at the angles of a web.

A web is a grid of angles from its pole and around it; shares are linear in both between them, as in
lighting programs. A profile is of one angle, the same all around. The engine takes the profile as
cubics in the cosine, within `TABLE_TOLERANCE` of it.
"""

from functools import lru_cache

import numpy as np

from rastercov.base import TINY, FloatArray, IntArray

Profile = tuple[tuple[float, float], ...]
"""Angles from the axis, degrees, ascending from 0, and intensities relative to the largest."""
Planes = tuple[tuple[float, ...], ...]
"""Angle around the axis of each plane, degrees, ascending through a full turn (the last is the
first + 360, the same plane), then shares at the angles of a profile."""

LARGEST_NUMBER = 1e12
"""Of a file; products and sums of them are finite."""
LEAST_STEP = 1e-3
"""Degrees between angles of a profile, whose cosines then differ."""
ASCEND = f"ascend from 0 to 180 at most, each {LEAST_STEP:g} degrees or more above the last"
TABLE_TOLERANCE = 1e-6
"""Of shares of a table, relative to the largest; more only within 1e-5 degrees of a pole where
these change by more than the largest in a degree."""
LEAST_FALLOFF = 1e-3
"""Of cosines between full light and none at the border of a spot with a falloff."""
LEAST_WIDTH = 4e-15
"""Cosines between knots of a table that are not divided."""
WEBS = {
    "C": ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)),
    "up": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    "A": ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    "B": ((0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (-1.0, 0.0, 0.0)),
}
"""Directions of 0 and 90 degrees around a web, and of its pole, in the frame of a point of a lamp.

C: planes counterclockwise seen from above where the lamp hangs, whose frame is clockwise. up: those
of one that shines upwards, whose points look up. A: V + 90 from the pole, which is below, and H to
the right of one that looks along H = V = 0. B: H + 90 from the pole, which is to the left, and V
upwards.
"""


def are_angles(degrees: FloatArray) -> bool:
    """True for angles of a profile, which `ASCEND`."""
    is_ascending = len(degrees) >= 2 and (np.diff(degrees) >= LEAST_STEP).all()
    return bool(is_ascending and degrees[0] == 0 and degrees[-1] <= 180)


def are_planes(planes: Planes, n_angles: int) -> bool:
    """True for planes of a profile of that many angles."""
    if {len(plane) for plane in planes} != {n_angles + 1} or len(planes) < 2:
        return False
    around, shares = np.array(planes)[:, 0], np.array(planes)[:, 1:]
    is_circle = (np.diff(around) >= LEAST_STEP / 2).all() and abs(np.ptp(around) - 360) < 1e-9
    return bool(is_circle and ((shares >= 0) & (shares <= LARGEST_NUMBER)).all())


def shares_of(profile: Profile, cosine: FloatArray) -> FloatArray:
    """(N,) shares of a profile at angles from the axis by their cosines, linear in the angle."""
    angle, share = np.array(profile, np.float64).T
    return np.interp(np.degrees(np.arccos(cosine)), angle, share)


def shares_of_planes(profile: Profile, planes: Planes, web: str, rays: FloatArray) -> FloatArray:
    """(N,) shares along rays, (N, 3) in the frame of a point, linear in both angles."""
    grid, angle = np.array(planes), np.array(profile)[:, 0]
    around, grid = grid[:, 0], grid[:, 1:]
    along_0, along_90, along_pole = np.array(WEBS[web]) @ rays.T
    from_pole = np.degrees(np.arctan2(np.hypot(along_0, along_90), along_pole))
    turn = around[0] + (np.degrees(np.arctan2(along_90, along_0)) - around[0]) % 360
    i, u = _between(around, turn)
    j, v = _between(angle, from_pole)
    low = (1 - v) * grid[i, j] + v * grid[i, j + 1]
    high = (1 - v) * grid[i + 1, j] + v * grid[i + 1, j + 1]
    return np.asarray((1 - u) * low + u * high)


def _between(knots: FloatArray, at: FloatArray) -> tuple[IntArray, FloatArray]:
    """Interval of knots that each value is in, and its place there, 0 to 1."""
    row = np.clip(np.searchsorted(knots, at, "right") - 1, 0, len(knots) - 2)
    return row, np.clip((at - knots[row]) / (knots[row + 1] - knots[row]), 0.0, 1.0)


def web_of(profile: Profile, planes: Planes) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Angles up to 180 degrees, turns, and shares (turns, angles); the last shares stay."""
    grid, angles = np.array(planes), np.array(profile)[:, 0]
    shares = grid[:, 1:]
    if angles[-1] < 180:
        angles, shares = np.append(angles, 180.0), np.c_[shares, shares[:, -1]]
    return angles, grid[:, 0], shares


@lru_cache(maxsize=64)
def table_of(profile: Profile) -> FloatArray:
    """(K, 4) rows of a profile by ascending cosine: cosine, share, and slope before and after.

    Cubics between knots with the shares and slopes of the profile, so dense that they are within
    `TABLE_TOLERANCE` of what is linear in the angle. The slope by the cosine is infinite at the
    poles, where it is a secant's. Beyond the last angle the share stays, and the cone of the lamp
    cuts it.
    """
    angle, share = np.array(profile, np.float64).T
    angle = np.radians(angle)
    if angle[-1] < np.pi:
        angle, share = np.append(angle, np.pi), np.append(share, share[-1])
    slope = np.diff(share) / np.diff(angle)
    tolerance = TABLE_TOLERANCE * max(float(share.max()), TINY)
    low, high, row = angle[:-1], angle[1:], np.arange(len(slope))
    done = []
    while len(low):  # halves, some twenty times at a pole
        is_close = np.abs(slope[row]) * _error(low, high) <= tolerance
        is_close |= np.cos(low) - np.cos(high) < LEAST_WIDTH
        done.append((low[is_close], high[is_close], row[is_close]))
        low, high, row = (each[~is_close] for each in (low, high, row))
        middle = (low + high) / 2
        low, high, row = np.r_[low, middle], np.r_[middle, high], np.r_[row, row]
    low, high, row = (np.concatenate(each) for each in zip(*done, strict=True))
    order = np.argsort(-low)  # by ascending cosine
    low, high, row = low[order], high[order], row[order]
    before, after = _slopes(low, high)  # at `high`, and at `low`
    # Where a share falls to 0, rounding may leave it below.
    value = np.maximum(share[row] + slope[row] * (high - angle[row]), 0)
    cosine = np.append(np.cos(high), 1.0)
    cosine[0] = -1.0
    at_start = np.append(slope[row] * before, slope[row[-1]] * after[-1])
    at_end = np.insert(slope[row] * after, 0, slope[row[0]] * before[0])
    table = np.stack([cosine, np.append(value, share[0]), at_end, at_start], axis=1)
    table.setflags(write=False)
    return table


def falloff(outer_deg: float, inner_deg: float) -> FloatArray:
    """(K, 4) rows as of `table_of`, exact: shares from 1 within a cone to 0 at another one.

    They are clamp((cos t - cos outer) / max(0.001, cos inner - cos outer), 0, 1)^2 at an angle t
    from the axis, as of spots in KHR_lights_punctual.
    """
    end = float(np.cos(np.radians(outer_deg)))
    width = max(LEAST_FALLOFF, float(np.cos(np.radians(inner_deg))) - end)
    full = min(1.0, (1 - end) / width)
    rows = [(-1.0, 0.0, 0.0, 0.0), (end, 0.0, 0.0, 0.0)]
    rows += [(min(end + width, 1.0), full**2, 2 * full / width, 0.0), (1.0, 1.0, 0.0, 0.0)]
    return np.array(rows[:-1] if end + width >= 1 else rows)


def _slopes(low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Slopes of angles by their cosines at the high and low ends; at a pole of secants."""
    secant = (low - high) / (np.cos(low) - np.cos(high))
    sine_high, sine_low = np.sin(high), np.sin(low)
    with np.errstate(divide="ignore"):
        at_high = np.where(high < np.pi, -1 / sine_high, secant)
        at_low = np.where(low > 0, -1 / sine_low, secant)
    return at_high, at_low


def _error(low: FloatArray, high: FloatArray) -> FloatArray:
    """Greatest difference of cubics of angles by their cosines from the angles, radians."""
    first, last = np.cos(high), np.cos(low)
    width = (last - first)[:, None]
    at_high, at_low = (each[:, None] * width for each in _slopes(low, high))
    t = np.linspace(0, 1, 17)[1:-1]
    rest = 1 - t
    cubic = rest**2 * ((1 + 2 * t) * high[:, None] + t * at_high)
    cubic += t**2 * ((1 + 2 * rest) * low[:, None] - rest * at_low)
    angle = np.arccos(np.clip(first[:, None] + t * width, -1, 1))
    return 1.1 * np.abs(cubic - angle).max(axis=1)  # of the greatest between the samples
