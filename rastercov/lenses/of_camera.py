"""Lens of a camera, with all that loops over its images need."""

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.camera import Camera
from rastercov.camera_models import lens_terms
from rastercov.lenses.lens import Lens, make_lens
from rastercov.lenses.planes import RADII, IdealPlane
from rastercov.lenses.quadrature import edge_table

FloatArray = NDArray[np.float64]

TOLERANCE = 1e-10
"""Bound of the error of each edge or part of an edge, px^2."""
MOST_LENSES = 1024
"""Lenses that are kept: a reconstruction may have one for each image."""


class PlaneRecord(NamedTuple):
    """An ideal plane for the loops, arrays read-only.

    Attributes
    ----------
    code, params : int, (32,) float64
        The lens, see `rastercov.lenses.formulas`.
    frame : (3, 3) float64
        lens_from_plane.
    fx, fy, cx, cy : float
        Of the pinhole, px.
    region, hole : (K, 2) float64
        Convex polygons in units of the plane, counter-clockwise in (x, y); `hole` may be empty.
    longest, parts_of, is_graded
        Of an `EdgeTable`.
    width, height : float
        Size of the image of the lens, px.
    stretch : float
        Greatest area in the image of the lens, px^2, for each px^2 of the pinhole's.
    tolerance : float
        Bound of the error of each edge or part of one, px^2.
    """

    code: int
    params: FloatArray
    frame: FloatArray
    fx: float
    fy: float
    cx: float
    cy: float
    region: FloatArray
    hole: FloatArray
    longest: FloatArray
    parts_of: int
    is_graded: bool
    width: float
    height: float
    stretch: float
    tolerance: float


@lru_cache(maxsize=MOST_LENSES)
def lens_of(camera: Camera) -> Lens:
    """Lens of a camera, the pinhole's own for one without distortion.

    Raises
    ------
    CameraError
        For coefficients that make no lens, or one that folds at its axis.
    """
    return make_lens(
        width=camera.width,
        height=camera.height,
        fx=camera.fx,
        fy=camera.fy,
        cx=camera.cx,
        cy=camera.cy,
        skew=camera.skew,
        max_angle_deg=camera.max_angle_deg,
        **lens_terms(camera.model, camera.distortion),
    )


@lru_cache(maxsize=MOST_LENSES)
def planes_of(camera: Camera) -> tuple[tuple[IdealPlane, PlaneRecord], ...]:
    """Ideal planes of the lens of a camera, and the same for the loops."""
    return tuple((plane, _record(plane, camera)) for plane in lens_of(camera).planes)


def _record(plane: IdealPlane, camera: Camera) -> PlaneRecord:
    table = edge_table(plane, TOLERANCE)
    pinhole = plane.camera
    return PlaneRecord(
        code=plane.code,
        params=_read_only(plane.params),
        frame=_read_only(plane.frame),
        fx=float(pinhole.fx),
        fy=float(pinhole.fy),
        cx=float(pinhole.cx),
        cy=float(pinhole.cy),
        region=_read_only(plane.region),
        hole=_read_only(np.empty((0, 2)) if plane.hole is None else plane.hole),
        longest=_read_only(table.longest),
        parts_of=table.parts_of,
        is_graded=table.is_graded,
        width=float(camera.width),
        height=float(camera.height),
        stretch=_stretch(plane),
        tolerance=TOLERANCE,
    )


def _stretch(plane: IdealPlane) -> float:
    """Bound of the Jacobian determinant of a plane, px^2 for each px^2 of its pinhole.

    Of an analytic u with |u - u0| <= M within R the derivative is at most M / R, by Cauchy.
    """
    if plane.has_pole:
        return math.inf
    least = math.inf
    for radius in RADII:
        across, down = plane.reach(radius)
        least = min(least, 2.0 * across * down / (radius * radius))
    return least / (plane.camera.fx * plane.camera.fy)


def _read_only(values: Any) -> FloatArray:
    array = np.ascontiguousarray(values, np.float64).copy()
    array.flags.writeable = False
    return array
