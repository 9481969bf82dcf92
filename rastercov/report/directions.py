"""Directions of cameras in the words of an installer."""

import math

import numpy as np
from numpy.typing import NDArray


def heading_and_tilt(pose: NDArray[np.float64]) -> tuple[float, float]:
    """Direction of a camera in degrees, z up: counter-clockwise from +x, and down from level.

    The heading of a camera that looks straight up or down has no meaning.
    """
    x, y, z = pose[:3, 2].tolist()
    return math.degrees(math.atan2(y, x)), math.degrees(math.atan2(-z, math.hypot(x, y)))
