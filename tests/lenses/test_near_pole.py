"""A rational lens whose denominator comes near 0 without reaching it."""

import cv2
import numpy as np
import pytest

import rastercov as rc
from rastercov.core.camera.lenses.of_camera import blind_area, lens_of
from rastercov.core.mesh import Mesh
from rastercov.engine import lens_proof
from rastercov.engine import solver_lens as formulas
from rastercov.reference.lenses import radial_factor

# Of a narrow lens that was calibrated with too many terms: 1 + k4 q + k5 q^2 + k6 q^3 is 2.5e-4 at
# r = 0.293, and the quotient 0.988 to 1.
DISTORTION = (-13.238113, -98.012135, 0.001444, 0.002849, 1357.782415)
DISTORTION += (-13.050801, -102.363353, 1383.055291)
K = np.array([[1874.63131, 0.0, 647.5], [0.0, 1879.55762, 485.5], [0.0, 0.0, 1.0]])


def test_polynomials_of_balls_hold_all_values_near_a_root():
    rng = np.random.default_rng(0)
    p = np.zeros(formulas.SIZE)
    p[[formulas.K1, formulas.K2, formulas.K3]] = (*DISTORTION[:2], DISTORTION[4])
    p[formulas.D1 : formulas.D3 + 1] = DISTORTION[5:]
    centre = rng.uniform(0, 0.2, 500)
    values = np.empty((len(centre), 3))
    for at, out in zip(centre, values, strict=True):
        lens_proof.radial_ball(p, at, 3e-4, out)
    real, imaginary, radius = values.T
    for angle in np.linspace(0, 2 * np.pi, 16):
        q = centre + 3e-4 * np.exp(1j * angle)
        away = np.abs(radial_factor(p, q) - (real + 1j * imaginary))
        assert (away <= radius * (1 + 1e-9)).all()
    assert np.isfinite(radius).all()


@pytest.mark.slow
def test_the_whole_image_is_measured():
    camera = rc.Camera.from_opencv(K, 1296, 972, DISTORTION)
    assert blind_area(lens_of(camera)) == 0
    corners = np.array([(-0.3, -0.2, 1.0), (0.32, -0.1, 1.0), (0.05, 0.22, 1.0)])
    mesh = Mesh(corners, [(0, 2, 1)])
    result = rc.evaluate(mesh, camera, np.eye(4)[None]).projected_area[0, 0]
    steps = np.linspace(0, 1, 200_000, endpoint=False)[:, None]
    line = np.concatenate(
        [a + steps * (b - a) for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)]
    )
    pixels, _ = cv2.projectPoints(line, np.zeros(3), np.zeros(3), K, np.array(DISTORTION))
    x, y = pixels.reshape(-1, 2).T - pixels.mean(axis=0).T
    wanted = abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))) / 2
    np.testing.assert_allclose(result, wanted, rtol=1e-8)
