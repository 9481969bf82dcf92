"""Images of points along parallel rays through a lens with distortion or skew, formula by formula.

A point (x, y) across the rays has the ideal place p = M (x, y) on the sensor, in metres from the
principal point, with the magnification M. Brown's model moves it to

    p' = p (1 + k1 q + k2 q^2 + k3 q^3) + (2 p1 a b + p2 (q + 2 a^2), p1 (q + 2 b^2) + 2 p2 a b)

with p = (a, b) and q = a^2 + b^2; the division model to p' = 2 p / (1 + sqrt(1 - 4 kappa q)). Then
u = cx + (fx p'_x + skew p'_y) / M and v = cy + fy p'_y / M. Derivatives are by a complex step.

D. C. Brown. Close-range camera calibration. 1971. A. Fitzgibbon. Simultaneous linear estimation of
multiple view geometry and lens distortion. 2001. MVTec. HALCON operator reference. 2024.
W. Squire, G. Trapp. Using complex variables to estimate derivatives of real functions. 1998.
"""

import numpy as np

from rastercov.base import AnyArray, FloatArray
from rastercov.core.camera import Camera
from rastercov.core.camera.models import coefficients_by_name

STEP = 1e-100
"""Of a derivative, relative to nothing: its square is 0 beside any number."""


def image_of(camera: Camera, x: AnyArray, y: AnyArray) -> AnyArray:
    """Pixels (2, ...) of points across the rays, metres, real or complex."""
    scale = camera.magnification or 1.0
    c = coefficients_by_name(camera.model, camera.distortion)
    a, b = scale * x, scale * y
    q = a * a + b * b
    if "kappa" in c:
        g = 2 / (1 + np.sqrt(1 - 4 * c["kappa"] * q))
        across, down = a * g, b * g
    else:
        g = 1 + q * (c["k1"] + q * (c["k2"] + q * c["k3"]))
        across = a * g + 2 * c["p1"] * a * b + c["p2"] * (q + 2 * a * a)
        down = b * g + c["p1"] * (q + 2 * b * b) + 2 * c["p2"] * a * b
    u = camera.cx + (camera.fx * across + camera.skew * down) / scale
    return np.stack((u, camera.cy + camera.fy * down / scale))


def slopes_of(camera: Camera, x: FloatArray, y: FloatArray) -> FloatArray:
    """Derivatives (N, 2, 2) of pixels by x and by y, px/m."""
    steps = (image_of(camera, x + 1j * STEP, y), image_of(camera, x, y + 1j * STEP))
    return np.stack([each.imag.T / STEP for each in steps], axis=-1)
