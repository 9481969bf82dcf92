"""Pointwise criteria through a lens, for the loops over one of its ideal planes.

An ideal plane is a pinhole of ours at the place of the lens (`rastercov.lenses.planes`). What is
seen in it is cut by the field of view of the lens (`rastercov.lenses.field`) in place of a
rectangle; focus is by depth along the axis of the lens or by distance; densities are those of the
lens. Whichever function of the loops depends on this has a twin here or in `view_kernels`, chosen
by the type of the rules.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov._jit import part_with_arrays
from rastercov.area.plane_kernels import (
    ERROR,
    FAR_LINE,
    FOCUS_LINE,
    HEIGHT,
    LEFT,
    N_LINES,
    NEAR_LINE,
    ORIGIN,
    X_AXIS,
    Y_AXIS,
)
from rastercov.camera import Camera
from rastercov.camera_models import MODELS
from rastercov.exact.records import DU, DV, LINE_ERROR, OFFSET, U, V
from rastercov.lenses.field_kernels import Tree
from rastercov.lenses.planes import IdealPlane
from rastercov.lenses.slopes import Slopes, slopes_of
from rastercov.task import Task

FloatArray = NDArray[np.float64]


class LensRules(NamedTuple):
    """Criteria in one ideal plane of a lens.

    `fx` to `height` are of the pinhole of the plane. `axis` is the axis of the lens in the axes of
    the plane, along which depths from `z_n` to `z_f` are in focus; distances are from `nearest` to
    `farthest`. The next three thresholds are 0 where there is no limit, and so is `tan_incidence`.
    `tree` is the field of view; `code`, `params` and `frame` are the lens, and `slopes` bounds of
    its derivatives. `gap` is the mean width of the strips that are left undecided, metres;
    `arc_gap` the distance of an arc from its chords.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: float
    height: float
    axis: FloatArray
    z_n: float
    z_f: float
    nearest: float
    farthest: float
    min_per_m2: float
    min_density: float
    min_facing: float
    cos_incidence: float
    tan_incidence: float
    gap: float
    strip_gap: float
    pixel_error: float
    tree: Tree
    code: int
    params: FloatArray
    frame: FloatArray
    slopes: Slopes
