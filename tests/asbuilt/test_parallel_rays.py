"""Parallel rays leave the distance open: it is that of the plan, and everything else is decided."""

import numpy as np
import pytest
from test_edges import MESH, off, photograph, pose_of

import rastercov as rc
from rastercov.asbuilt import resection
from rastercov.asbuilt.located import Tolerance

CAMERA = rc.Camera.telecentric(480, 360, magnification=6e-4, pixel_size=5e-6)
WITHIN = Tolerance(place=0.03, turn_deg=0.7)


def verdict(seed: int, degrees: float, points: bool) -> tuple[str, rc.Located, np.ndarray]:
    """Verdict on a camera turned so far, by edges or by points, its pose and the true one."""
    plan = pose_of(seed)
    true = off(plan, seed, degrees, 0)
    photo = photograph(MESH, true, seed, CAMERA)
    corners = MESH.vertices[::9]
    pairs = np.hstack((resection.pixels_of(corners, CAMERA, true), corners)) if points else None
    found = rc.locate(MESH, CAMERA, photo, plan, pairs, pixel_error=0.3)
    return WITHIN.verdict(found), found, true


@pytest.mark.parametrize("points", [False, True])
@pytest.mark.parametrize(("seed", "degrees"), [(1, 0.0), (2, 1.5)])
def test_everything_but_the_distance_is_decided(seed: int, degrees: float, points: bool) -> None:
    said, found, true = verdict(seed, degrees, points)
    assert said == ("moved" if degrees else "as planned"), found
    assert found.is_distance_open
    assert "distance along parallel rays" in found.words()
    step = resection.difference(found.pose, true)
    assert np.degrees(np.linalg.norm(step[:3])) < 0.1
    assert np.linalg.norm(step[3:5]) < 0.01
    along = resection.difference(found.pose, found.near)[5]
    assert abs(along) < (1e-9 if points else 0.01)  # that of the plan
    assert np.isfinite(found.deviations).all()
