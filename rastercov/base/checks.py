"""Checks of single values of a camera."""

import math
from collections.abc import Container
from typing import Any

import numpy as np
from typing_extensions import TypeIs

from rastercov.base.errors import CameraError
from rastercov.base.format import shown as shown  # others find it here, too

MAX_IMAGE_SIDE = 1 << 17
"""Largest image side in pixels; larger than any sensor, small enough to count samples in int64."""
MOST_COEFFICIENTS = 100
"""OpenCV has 14 at most."""

LONGEST = 1e12
"""Pixels: largest focal length, and farthest principal point. float64 tells directions apart to
some 1e-16 rad, which is 1e-4 px then; beyond, samples would be left to rounding."""
SHORTEST = 1e-12
"""Pixels: least focal length. A pixel next to the principal point then sees all that is more than
1e-12 rad beside the image plane."""


BEYOND = "float64 does not resolve pixels there, check the unit"


def number(
    name: str, value: object, least: float = -math.inf, most: float = math.inf, wanted: str = ""
) -> float:
    """`value` as a finite float; `wanted` says what it must be, where it has limits in pixels."""
    if not is_number(value):
        got = shown([*value] if isinstance(value, tuple) else value)  # as files have it
        raise CameraError(f"expected {name} to be a number, got {got}")
    try:
        result = float(value)
    except OverflowError:
        raise CameraError(f"expected {name} to be below 1e308, got a larger integer") from None
    if not math.isfinite(result):
        raise CameraError(f"expected {name} to be finite, got {result}")
    if not least <= result <= most:
        raise CameraError(f"expected {name} to be {wanted}, got {result:g}; {BEYOND}")
    return result


def positive(name: str, value: object) -> float:
    """`value` as a finite float above 0."""
    result = number(name, value)
    if not result > 0:
        raise CameraError(f"expected {name} to be positive, got {result:g}")
    return result


def focal_length_px(name: str, value: object) -> float:
    """`value` as a focal length in pixels."""
    wanted = f"from {SHORTEST:g} to {LONGEST:g} px"
    return number(name, positive(name, value), SHORTEST, LONGEST, wanted)


def principal_point_px(name: str, value: object) -> float:
    """`value` as a coordinate of the principal point in pixels."""
    return number(name, value, -LONGEST, LONGEST, f"within {LONGEST:g} px of the image")


def pair(name: str, value: object) -> tuple[float, float]:
    """One or two positive numbers as two."""
    values = value if isinstance(value, tuple | list) else (value, value)
    if len(values) != 2:
        raise CameraError(f"expected {name} to be one or two numbers, got {shown(value)}")
    return positive(name, values[0]), positive(name, values[1])


def two(name: str, value: object) -> tuple[Any, Any]:
    """Two values of any kind, from a sequence or an array."""
    if isinstance(value, np.ndarray) and value.shape == (2,):
        value = value.tolist()
    if not isinstance(value, tuple | list) or len(value) != 2:
        raise CameraError(f"expected {name} to be two numbers, got {shown(value)}")
    return value[0], value[1]


def image_side(name: str, value: object) -> int:
    """Width or height of an image, in whole pixels."""
    result = number(name, value)
    if result != int(result) or not 1 <= result <= MAX_IMAGE_SIDE:
        wanted = f"a whole number of pixels from 1 to {MAX_IMAGE_SIDE}"
        raise CameraError(f"expected {name} to be {wanted}, got {shown(value)}")
    return int(result)


def coefficients_of(distortion: Any) -> tuple[Any, ...]:
    """Coefficients of a lens, one after the other, from a number, a sequence or an array."""
    try:
        size = np.size(distortion)
        if size <= MOST_COEFFICIENTS:
            return tuple(np.ravel(np.asarray(distortion, dtype=object)))
    except Exception:  # whatever conversion an object brings
        raise CameraError(f"expected distortion to be numbers, got {shown(distortion)}") from None
    raise CameraError(f"expected at most {MOST_COEFFICIENTS} distortion coefficients, got {size}")


def is_number(value: object) -> TypeIs[float]:
    """True for a whole or real number of Python or numpy; True and False are none."""
    return not isinstance(value, bool) and isinstance(value, int | float | np.integer | np.floating)


def is_one_of(value: object, names: Container[str]) -> bool:
    """True for text that is among some names; an array is never compared with them."""
    return isinstance(value, str) and value in names


def finite_number(value: object) -> float:
    """`value` as a float, NaN for what is no finite number."""
    try:
        result = float(value) if is_number(value) else math.nan
    except OverflowError:
        return math.nan
    return result if math.isfinite(result) else math.nan


def is_inf(value: object) -> bool:
    """True for positive infinity."""
    return isinstance(value, float | np.floating) and value == math.inf


def share_meant(value: object) -> str:
    """End of a line about a share above 1, which was probably given in percent."""
    if is_number(value) and 1 < value <= 100:
        return f"; pass {value / 100:g} for {value:g} %"
    return ""
