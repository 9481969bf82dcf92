"""Lamps in the plane of a face."""

import numpy as np
import pytest
from exact_cases import box

import rastercov as rc

CUBE = box((0, 0, 0), (1, 1, 1))
CAMERA = rc.Camera.from_fov(640, 480, hfov_deg=60)
IN_PLANE = np.eye(4)
IN_PLANE[:3, 3] = 0, 0.5, -3
"""A place before the front of the cube, exactly in the plane of its side x = 0."""


def test_a_lamp_in_the_plane_of_a_face_lights_nothing_of_it():
    lamps = rc.Lamps([rc.Lamp.point(intensity=5)], IN_PLANE[None])
    pose = rc.look_at((-3.0, 0.5, -2.0), (0.5, 0.5, 0.5), (0, 1, 0))
    summary = rc.evaluate(CUBE, CAMERA, pose, by="area", lamps=lamps).areas.summary()
    assert summary["m2"] == pytest.approx(1.0, abs=1e-3)
    assert summary["bound_m2"] < 1e-3
