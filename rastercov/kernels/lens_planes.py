"""An ideal plane of a lens as the loops take it."""

from collections import namedtuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


PlaneRecord = namedtuple(
    "PlaneRecord",
    "code params frame fx fy cx cy region hole window longest parts_of is_graded width height "
    "bend stretch speed tolerance",
)
"""An ideal plane for the loops, arrays read-only.

Attributes
----------
code, params : int, (32,) float64
    The lens, see `rastercov.kernels.lens_formulas`.
frame : (3, 3) float64
    lens_from_plane.
fx, fy, cx, cy : float
    Of the pinhole, px.
region, hole : (K, 2) float64
    Convex polygons in units of the plane, counter-clockwise in (x, y); `hole` may be empty.
window : (K, 2) float64
    The same, with few sides: all of the region whose pixels are in the image, and perhaps more.
longest, parts_of, is_graded
    Of an `EdgeTable` of `rastercov.camera.lenses.quadrature`.
width, height : float
    Size of the image of the lens, px.
bend : float
    Bound of the second derivative of pixels along lines of the plane, px.
stretch : float
    Greatest area in the image of the lens, px^2, for each px^2 of the pinhole's.
speed : float
    Greatest length in the image of the lens, px, for each px of the pinhole's.
tolerance : float
    Bound of the error of each edge or part of one, px^2.
"""
