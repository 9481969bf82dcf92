"""Cameras: intrinsics, lenses, poses, rigs, rays, the near plane."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
