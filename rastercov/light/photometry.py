"""Intensities of luminaires by direction: shares of the largest at the angles of a web.

A web is a grid of angles from its pole and around it; shares are linear in both between them, as in
lighting programs. A profile is of one angle, the same all around. The engine takes the profile as
cubics in the cosine, within `TABLE_TOLERANCE` of it.

Luminaires of photometric files: IES LM-63 of 1986 to 2019, and EULUMDAT.

IES LM-63: IES Standard File Format for the Electronic Transfer of Photometric Data. 1986, 1991,
1995, 2002, 2019. A. W. Stockmar. EULUMDAT. 1990. Planes are mirrored as the files say, to the
whole circle. Angles that a file leaves out are dark, from `LEAST_STEP` beyond its last one on.
"""

import re
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from rastercov.base import (
    TINY,
    CameraError,
    FloatArray,
    IntArray,
    StrPath,
    UnreadableError,
    errors_as,
    file_bytes,
    printable,
    shown,
    sort_order,
    suffix_of,
)

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
LARGEST_FILE = 1 << 23
"""Bytes."""
SAME_REL = 1e-9
"""Difference of planes of a luminaire that is the same around its axis, of the largest."""
END_OF_FILE = "\x1a"
"""Last character of files of DOS programs."""
TYPES = {1: "C", 2: "B", 3: "A"}
_NUMBER = re.compile(r"[\s,]+")
_TILT = re.compile(r"^[ \t]*TILT[ \t]*=(.*)$", re.MULTILINE | re.IGNORECASE)


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
    order = sort_order(-low)  # by ascending cosine
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


class Luminaire(NamedTuple):
    """Largest intensity, cd, and shares of it by direction; see `rastercov.light.photometry`.

    `tilt` has pairs of the angle of the lamp from the vertical and the factor there; none is 1.
    """

    intensity: float
    half_angle_deg: float
    profile: Profile
    planes: Planes = ()
    web: str = "C"
    tilt: Profile = ()

    def tilt_of(self, degrees: float | None) -> float:
        """Factor of the intensity at a tilt; CameraError for one that is not known, None."""
        factors = [factor for _, factor in self.tilt]
        if degrees is None and len(set(factors)) > 1:
            raise CameraError(
                "expected a fixed lamp for a file with TILT data, got one on a rig; give a file "
                "with TILT=NONE"
            )
        if not self.tilt:
            return 1.0
        return float(np.interp(degrees or 0.0, *np.array(self.tilt).T))


def read_luminaire(path: StrPath) -> Luminaire:
    """Luminaire of a file, by its suffix; CameraError for one that has none."""
    with errors_as(CameraError, printable(str(path)), (UnreadableError, CameraError)):
        text = file_bytes(path, LARGEST_FILE).decode("latin-1").partition(END_OF_FILE)[0]
        return READERS.get(suffix_of(path), _read_ies)(re.sub(r"\r\n?", "\n", text))


def _read_ies(text: str) -> Luminaire:
    head = _TILT.search(text)
    if not head:
        raise CameraError(
            "expected an IES LM-63 file, with a line TILT=, got another file; name one, or a .ldt"
        )
    kind, numbers = head[1].strip(), _NUMBER.split(text[head.end() :].strip())
    values = _numbers([each for each in numbers if each])
    tilt: Profile = ()
    if kind.upper() == "INCLUDE":
        tilt, values = _tilt(values)
    elif kind.upper() != "NONE":
        raise CameraError(
            f"expected TILT=NONE or INCLUDE, got TILT={printable(kind[:20])}; copy the content "
            "of that file after TILT=INCLUDE"
        )
    try:
        n_down, n_around, type_number = (int(values[at]) for at in (3, 4, 5))
        factor = float(values[2] * values[10] * (values[11] if _is_old(text) else 1.0))
        if min(n_down, n_around) < 1:
            raise ValueError
        down, around = values[13 : 13 + n_down], values[13 + n_down : 13 + n_down + n_around]
        candela = values[13 + n_down + n_around :].reshape(n_around, n_down)
    except (ValueError, IndexError):
        raise CameraError(
            "expected as many numbers as declared, got fewer or more, or words; correct the file"
        ) from None
    if type_number not in TYPES:
        raise CameraError(f"expected photometric type 1, 2 or 3, got {type_number}; correct it")
    if type_number == 1:
        of_c_planes = _of_c_planes(down, around, candela, factor)
    elif type_number == 2:
        of_c_planes = _of_floodlight(around, down, candela.T, factor, "B")
    else:
        of_c_planes = _of_floodlight(down, around, candela, factor, "A")
    return of_c_planes._replace(tilt=tilt)


def _is_old(text: str) -> bool:
    """True for LM-63 of 1986 and 1991, whose second factor counts; later it has other meanings."""
    first = text.lstrip().partition("\n")[0].strip().upper()
    return not first.startswith("IES") or first.endswith(("91", "86"))


def _numbers(words: list[str]) -> FloatArray:
    """Numbers of words; NaN, which no whole number is, for those beyond the largest."""
    try:
        values = np.array([float(each) for each in words])
    except ValueError:
        raise CameraError(
            "expected numbers after its header, got words; the file is damaged, export it again"
        ) from None
    values[~(np.abs(values) <= LARGEST_NUMBER)] = np.nan
    return values


def _tilt(values: FloatArray) -> tuple[Profile, FloatArray]:
    """Factors by tilt, of TILT=INCLUDE, and the numbers after them."""
    n = int(values[1]) if len(values) > 1 and 1 <= values[1] <= len(values) / 2 else 0
    angles, factors, rest = values[2 : 2 + n], values[2 + n : 2 + 2 * n], values[2 + 2 * n :]
    is_right = n > 0 and (np.diff(angles) > 0).all() and (factors >= 0).all()
    if not is_right or values[0] not in (1, 2, 3):
        raise CameraError(
            "expected lamp geometry 1 to 3, angles and factors after TILT=INCLUDE, got others; "
            "correct the file"
        )
    if values[0] == 2:  # the lamp stays horizontal
        factors = np.full(n, float(np.interp(0, angles, factors)))
    return tuple(zip(angles.tolist(), factors.tolist(), strict=True)), rest


def _read_ldt(text: str) -> Luminaire:
    lines = [line.strip().replace(",", ".") for line in text.split("\n")]

    def numbers(first: int, n: int) -> FloatArray:
        """Numbers of n lines, from 1."""
        own = lines[first - 1 : first - 1 + n]
        if len(own) < n:
            raise CameraError(
                f"expected {first - 1 + n:,} lines or more of EULUMDAT, got {len(lines):,}; "
                "the file is damaged, export it again"
            )
        return _numbers([each or "0" for each in own])

    symmetry, n_around, _, n_down = (_whole(numbers(at, 1)[0]) for at in (3, 4, 5, 6))
    factor, n_sets = float(numbers(24, 1)[0]), _whole(numbers(26, 1)[0])
    if n_sets < 1 or n_around < 1 or n_down < 2 or not 0 <= symmetry <= 4:
        raise CameraError(
            "expected an EULUMDAT file, with symmetry 0 to 4, planes, angles and lamps, got "
            "another; correct lines 3 to 6 and 26"
        )
    lumens = np.array([numbers(29 + 6 * each, 1)[0] for each in range(min(n_sets, len(lines)))])
    if np.ptp(lumens) != 0:
        raise CameraError(
            f"expected lamp sets of equal flux, got {shown(lumens.tolist())} lm; keep one set"
        )
    start = 27 + 6 * n_sets + 10
    around, down = numbers(start, n_around), numbers(start + n_around, n_down)
    first, n = {
        0: (0, n_around),
        1: (0, 1),
        2: (0, n_around // 2 + 1),
        3: (3 * n_around // 4, n_around // 2 + 1),
        4: (0, n_around // 4 + 1),
    }[symmetry]
    rows = np.arange(first, first + n)
    turns = around[rows % n_around] + 360 * (rows // n_around)
    candela = numbers(start + n_around + n_down, n * n_down).reshape(n, n_down)
    return _of_c_planes(down, turns, candela, factor * float(lumens[0]) / 1000)


def _whole(value: float) -> int:
    """Whole number of a file, 0 or more, or -1."""
    return int(value) if 0 <= value <= LARGEST_FILE else -1


READERS: dict[str, Callable[[str], Luminaire]] = {".ies": _read_ies, ".ldt": _read_ldt}
"""Readers of text, by suffix; files of other suffixes are IES."""


def _of_c_planes(
    down: FloatArray, around: FloatArray, candela: FloatArray, factor: float
) -> Luminaire:
    """Luminaire of planes about its axis, which is down; planes are mirrored to a circle."""
    starts = down[0] in (0, 90) and down[-1] <= 180
    if not starts or len(down) < 2 or not (np.diff(down) >= LEAST_STEP).all():
        raise CameraError(
            f"expected vertical angles that {ASCEND}, or from 90, got other angles; correct the "
            "file"
        )
    around, candela = _circle(around, candela)
    largest = _largest(candela, factor)
    lit = np.flatnonzero(candela.max(axis=0) > 0)
    web = "C"
    if down[max(lit[0] - 1, 0)] >= 90:  # from the zenith on
        web, down, candela = "up", (180 - down)[::-1], candela[:, ::-1]
        lit = len(down) - 1 - lit[::-1]
    down, candela = down[: lit[-1] + 2], candela[:, : lit[-1] + 2]  # up to where it is dark
    if down[0] > 0:
        down = np.r_[0, down[0] - LEAST_STEP, down]
        candela = np.pad(candela, ((0, 0), (2, 0)))
    half_angle = float(down[-1])
    if half_angle > 175:
        if half_angle < 180 - LEAST_STEP:
            down, candela = np.r_[down, half_angle + LEAST_STEP], np.pad(candela, ((0, 0), (0, 1)))
        half_angle = 180.0
    return _luminaire(down, around, candela / largest, web, factor * largest, half_angle)


def _of_floodlight(
    down: FloatArray, around: FloatArray, candela: FloatArray, factor: float, web: str
) -> Luminaire:
    """Luminaire of types A and B, whose axis is at V = H = 0; angles from 0 on are mirrored.

    `down` has the angles towards the pole of the web, V of type A and H of type B.
    """
    if around[0] == 0:
        around, candela = np.r_[-around[:0:-1], around], np.r_[candela[:0:-1], candela]
    if down[0] == 0:
        down, candela = np.r_[-down[:0:-1], down], np.c_[candela[:, :0:-1], candela]
    for angles in (down, around):
        is_right = -90 <= angles[0] < angles[-1] <= 90 and (np.diff(angles) >= 3 * LEAST_STEP).all()
        if not is_right:
            raise CameraError(
                "expected angles of type A or B from -90 or 0 up to 90, ascending, got other "
                "angles; correct the file"
            )
    largest = _largest(candela, factor)
    around = np.r_[around[0] - LEAST_STEP, around, around[-1] + LEAST_STEP, around[0] + 360]
    around[-1] -= LEAST_STEP
    candela = np.pad(candela, ((1, 2), (0, 0)))
    down = down + 90
    if down[0] > 0:
        down, candela = np.r_[0, down[0] - LEAST_STEP, down], np.pad(candela, ((0, 0), (2, 0)))
    if down[-1] < 180:
        down, candela = np.r_[down, down[-1] + LEAST_STEP], np.pad(candela, ((0, 0), (0, 1)))
    return _luminaire(down, around, candela / largest, web, factor * largest, 90.0)


def _luminaire(
    down: FloatArray,
    around: FloatArray,
    shares: FloatArray,
    web: str,
    intensity: float,
    half_angle: float,
) -> Luminaire:
    """Luminaire of planes over a circle; without planes where these are the same."""
    profile = tuple(zip(down.tolist(), shares.max(axis=0).tolist(), strict=True))
    planes: Planes = ()
    if float(np.ptp(shares, axis=0).max()) > SAME_REL:
        planes = tuple(map(tuple, np.c_[around, shares].tolist()))
    return Luminaire(intensity, half_angle, profile, planes, web)


def _largest(candela: FloatArray, factor: float) -> float:
    """Largest intensity; CameraError for none, or one below 0."""
    if not (candela >= 0).all() or not factor > 0:
        raise CameraError(
            f"expected intensities of 0 or more, within {LARGEST_NUMBER:g}, got other values; "
            "correct the file"
        )
    if not candela.max() > 0:
        raise CameraError("expected intensities above zero, got all zero; correct the file")
    return float(candela.max())


def _circle(around: FloatArray, candela: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Planes over 360 degrees, of those that a file has; a circle may leave out its end."""
    if len(around) == 1:
        return np.array([0.0, 360.0]), np.repeat(candela, 2, axis=0)
    gaps = np.diff(around)
    is_right = bool((gaps >= LEAST_STEP).all())
    for whole in (90, 180):
        if is_right and abs(np.ptp(around) - whole) <= LEAST_STEP:
            around = np.r_[around, 2 * around[-1] - around[-2::-1]]
            candela = np.r_[candela, candela[-2::-1]]
    rest = 360 - float(np.ptp(around))
    if is_right and LEAST_STEP < rest <= gaps.max() + LEAST_STEP:
        around, candela = np.r_[around, around[0] + 360], np.r_[candela, candela[:1]]
        rest = 0.0
    if not is_right or not abs(rest) <= 4 * LEAST_STEP:
        raise CameraError(
            "expected horizontal angles that ascend over 90, 180 or 360 degrees, each by "
            f"{LEAST_STEP:g} degrees or more, got other angles; correct the file"
        )
    around[-1] = around[0] + 360
    return around, candela
