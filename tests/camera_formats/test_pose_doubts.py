"""Poses in another convention than their own have a line that names theirs."""

import numpy as np
import pytest

import rastercov as rc
from rastercov.camera.formats.conventions import OPENGL_AXES, POSE_CONVENTIONS
from rastercov.camera.formats.doubts import convention_doubts
from rastercov.camera.pose import inverse
from rastercov.mesh import shapes

CAMERA = rc.Camera(width=64, height=48, fx=60, fy=60)


def poses(n=30):
    rng = np.random.default_rng(0)
    eyes = rng.normal(size=(n, 3))
    eyes *= 5 / np.linalg.norm(eyes, axis=1, keepdims=True)
    return rc.look_at(eyes=eyes + np.array([1, 2, 3]), targets=(1, 2, 3))


def mesh():
    return shapes.box((1, 1, 1)).moved(translation=(1, 2, 3))


@pytest.mark.parametrize("name", POSE_CONVENTIONS)
def test_the_convention_of_the_poses_is_named(name):
    has_opengl_axes, is_inverse = POSE_CONVENTIONS[name]
    given = poses() @ OPENGL_AXES if has_opengl_axes else poses()
    given = inverse(given) if is_inverse else given
    found = convention_doubts(mesh(), CAMERA, given)
    if name == "opencv":
        assert found == []
    else:
        assert [f"--pose-convention {name}?" in line for line in found] == [True]


def test_nothing_is_said_where_no_convention_helps_or_most_cameras_look_at_the_mesh():
    away = poses()
    away[:, :3, 3] += 100.0
    assert convention_doubts(mesh(), CAMERA, away) == []
    some = poses()
    some[:15] = some[:15] @ OPENGL_AXES
    assert convention_doubts(mesh(), CAMERA, some) == []
    assert convention_doubts(mesh(), CAMERA, np.zeros((0, 4, 4))) == []
    inside = rc.look_at(eyes=(1, 2, 3), targets=(2, 2, 3))
    assert convention_doubts(mesh(), CAMERA, inside) == []
