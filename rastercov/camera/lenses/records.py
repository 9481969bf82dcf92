"""Ideal planes as the loops take them."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.camera.lenses.planes import IdealPlane
from rastercov.camera.lenses.quadrature import EdgeTable
from rastercov.camera.lenses.slopes import slopes_in
from rastercov.camera.lenses.window import window_of
from rastercov.kernels.lens_planes import PlaneRecord

FloatArray = NDArray[np.float64]


def record_of(plane: IdealPlane, width: int, height: int, table: EdgeTable) -> PlaneRecord:
    """Record of a plane of a lens with an image of that size, px."""
    pinhole, (speed, bend) = plane.camera, _derivatives(plane)
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
        window=_read_only(window_of(plane, width, height, bend)),
        longest=_read_only(table.longest),
        parts_of=table.parts_of,
        is_graded=table.is_graded,
        width=float(width),
        height=float(height),
        bend=bend,
        stretch=speed**2 / 2 / (pinhole.fx * pinhole.fy),
        speed=speed / min(pinhole.fx, pinhole.fy),
        tolerance=table.tolerance,
    )


def _derivatives(plane: IdealPlane) -> tuple[float, float]:
    """Bounds of the first and the second derivative of pixels along lines of a plane, px.

    Of an analytic u with |u - u0| <= M within R the first is at most M / R, and the second 2 M /
    R^2, by Cauchy. Both coordinates together change by (x^2 + y^2)^(1/2) times 2^(1/2) at most.
    Differences tell some thirty times more about the second (`slopes`): how many edges are next to
    the border of the image, and how many tiles of samples a face may reach, depends on it.
    """
    if plane.has_pole:
        return math.inf, math.inf
    speed = bend = math.inf
    for radius, across, down in plane.reaches:
        reach = math.hypot(across, down)
        speed = min(speed, math.sqrt(2) * reach / radius)
        bend = min(bend, 4 * reach / radius**2)
    return speed, min(bend, float(slopes_in(plane).second.max()))


def _read_only(values: Any) -> FloatArray:
    array = np.ascontiguousarray(values, np.float64).copy()
    array.flags.writeable = False
    return array
