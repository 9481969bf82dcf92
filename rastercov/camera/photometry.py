"""Intensities of luminaires by the angle from their axis, of IES files.

IES LM-63: IES Standard File Format for the Electronic Transfer of Photometric Data. 2019. Type C
with TILT=NONE; vertical angle 0 is along the axis of the lamp, which points down where it hangs. A
luminaire that is not the same around its axis is refused, since a profile is of one angle.
"""

import re

import numpy as np

from rastercov.base.errors import CameraError, errors_as
from rastercov.base.files import StrPath, UnreadableError, file_bytes, printable
from rastercov.base.memory import FloatArray

Profile = tuple[tuple[float, float], ...]
"""Angles from the axis, degrees, ascending from 0, and intensities relative to the largest."""

LARGEST_IES = 1 << 20
"""Bytes of a file."""
LARGEST_NUMBER = 1e12
"""Of a file; products and sums of them are finite."""
LEAST_STEP = 1e-3
"""Degrees between angles of a profile, whose cosines then differ."""
ASCEND = f"ascend from 0 to 180 at most, each {LEAST_STEP:g} degrees or more above the last"
MOST_AROUND = 0.1
"""Difference of intensities around the axis, relative to the largest, that is averaged."""
_NUMBER = re.compile(r"[\s,]+")


def read_ies(path: StrPath) -> tuple[float, Profile]:
    """Largest intensity, cd, and profile of an IES file; CameraError for one that has none."""
    with errors_as(CameraError, printable(str(path)), (UnreadableError, CameraError)):
        text = file_bytes(path, LARGEST_IES).decode("latin-1")
        return _profile(text)


def _profile(text: str) -> tuple[float, Profile]:
    head, tilt, body = text.partition("TILT=")
    kind, _, numbers = body.partition("\n")
    if not tilt or not head.lstrip().upper().startswith("IES"):
        raise CameraError(
            "expected an IES LM-63 file, with IES at its start and a line TILT=, got another file; "
            "name one"
        )
    if kind.strip().upper() != "NONE":
        raise CameraError(
            f"expected TILT=NONE, got TILT={printable(kind.strip()[:20])}; export it without tilt"
        )
    try:
        values = np.array([float(each) for each in _NUMBER.split(numbers.strip()) if each])
        values[~(np.abs(values) <= LARGEST_NUMBER)] = np.nan  # which no whole number is
        n_down, n_around, type_c = (int(values[at]) for at in (3, 4, 5))
        factor = float(values[2] * values[10])
        down, around = values[13 : 13 + n_down], values[13 + n_down : 13 + n_down + n_around]
        candela = values[13 + n_down + n_around :].reshape(n_around, n_down)
    except (ValueError, IndexError):
        raise CameraError(
            "expected as many numbers as declared, got fewer, or words; the file is damaged"
        ) from None
    if type_c != 1:
        raise CameraError(f"expected photometric type C (1), got {type_c}; export it as type C")
    if not are_angles(down):
        raise CameraError(f"expected vertical angles that {ASCEND}, got others; correct the file")
    weights = _weights(around)
    if not (candela >= 0).all() or not factor > 0:
        raise CameraError(
            f"expected intensities of 0 or more, within {LARGEST_NUMBER:g}, got others; correct "
            "the file"
        )
    largest = float(candela.max())
    if not largest > 0:
        raise CameraError("expected intensities above zero, got all zero; correct the file")
    differs = float(np.ptp(candela, axis=0).max()) / largest
    if differs > MOST_AROUND:
        raise CameraError(
            f"expected an intensity that varies by at most {100 * MOST_AROUND:.0f} % around its "
            f"axis, got {100 * differs:.0f} %; use a lamp with size instead"
        )
    mean = weights @ candela
    share = mean / mean.max()
    return factor * float(mean.max()), tuple(zip(down.tolist(), share.tolist(), strict=True))


def _weights(around: FloatArray) -> FloatArray:
    """(N,) shares of planes at horizontal angles, degrees, in the mean around the axis.

    The trapezoidal rule, so that the planes at both ends, which are of a mirror or the same one,
    count half. A circle may leave out its end; CameraError for angles that are none of type C.
    """
    if len(around) == 1:
        return np.ones(1)
    gaps = np.diff(around)
    span = float(around[-1] - around[0])
    rest = 360 - span
    if np.isclose(span, (90, 180, 360), rtol=0, atol=LEAST_STEP).any():
        gaps = np.r_[0.0, gaps, 0.0]
    elif rest <= gaps.max() + LEAST_STEP:
        gaps = np.r_[rest, gaps, rest]
    if len(gaps) <= len(around) or not (np.diff(around) >= LEAST_STEP).all():
        raise CameraError(
            "expected horizontal angles that ascend over 90, 180 or 360 degrees, each by "
            f"{LEAST_STEP:g} degrees or more, got others; correct the file"
        )
    return (gaps[1:] + gaps[:-1]) / (gaps[1:] + gaps[:-1]).sum()


def are_angles(degrees: FloatArray) -> bool:
    """True for angles of a profile, which `ASCEND`."""
    is_ascending = len(degrees) >= 2 and (np.diff(degrees) >= LEAST_STEP).all()
    return bool(is_ascending and degrees[0] == 0 and degrees[-1] <= 180)


def table_of(profile: Profile) -> FloatArray:
    """(K, 4) rows of a profile by ascending cosine: cosine, share, and slope before and after.

    Monotone cubics between, so that no share is negative. F. N. Fritsch, R. E. Carlson. Monotone
    Piecewise Cubic Interpolation. 1980; slopes are harmonic means. Beyond the last angle the share
    stays, and the cone of the lamp cuts it.
    """
    angle, share = np.array(profile, np.float64).T[:, ::-1]
    cosine = np.cos(np.radians(angle))
    cosine[-1] = 1.0
    if cosine[0] > -1:
        cosine, share = np.concatenate([[-1.0], cosine]), np.concatenate([share[:1], share])
    secant = np.diff(share) / np.diff(cosine)
    slope = np.zeros(len(share))
    product = secant[1:] * secant[:-1]
    rises = product > 0
    total = np.where(rises, secant[1:] + secant[:-1], 1.0)
    slope[1:-1] = np.where(rises, 2 * product / total, 0.0)
    slope[0], slope[-1] = secant[0], secant[-1]
    return np.stack([cosine, share, slope, slope], axis=1)


def share_at(table: FloatArray, cosine: FloatArray) -> FloatArray:
    """Shares of a `table_of` at cosines."""
    at = np.clip(np.searchsorted(table[:, 0], cosine, "right") - 1, 0, len(table) - 2)
    low, high = table[at], table[at + 1]
    width = high[..., 0] - low[..., 0]
    t = np.clip((cosine - low[..., 0]) / width, 0.0, 1.0)
    rest = 1 - t
    found: FloatArray = rest**2 * ((1 + 2 * t) * low[..., 1] + t * width * low[..., 3])
    found += t**2 * ((1 + 2 * rest) * high[..., 1] - rest * width * high[..., 2])
    return np.maximum(found, 0.0)
