"""Poses in another convention than their own have a line that names theirs."""

import json

import numpy as np
import pytest

import rastercov as rc
from rastercov.core.camera.conventions import OPENGL_AXES, POSE_CONVENTIONS
from rastercov.core.camera.doubts import convention_warnings
from rastercov.core.mesh import shapes
from rastercov.core.mesh.arrays import inverse

CAMERA = rc.Camera(width=64, height=48, fx=60, fy=60)
MESH = shapes.box((1, 1, 1)).moved(translation=(1, 2, 3))


def poses():
    return rc.sphere_of_poses((1, 2, 3), 5, 30)


@pytest.mark.parametrize("name", POSE_CONVENTIONS)
def test_the_convention_of_the_poses_is_named(name):
    has_opengl_axes, is_inverse = POSE_CONVENTIONS[name]
    given = poses() @ OPENGL_AXES if has_opengl_axes else poses()
    result = convention_warnings(MESH, CAMERA, inverse(given) if is_inverse else given)
    wanted = [] if name == "opencv" else [True]
    assert [f"--pose-convention {name}, or leave" in line for line in result] == wanted


def test_nothing_is_said_where_no_convention_helps_or_most_cameras_look_at_the_mesh():
    away, some = poses(), poses()
    away[:, :3, 3] += 100.0
    some[:15] = some[:15] @ OPENGL_AXES
    inside = rc.look_at(eyes=(1, 2, 3), targets=(2, 2, 3))
    for given in (away, some, np.zeros((0, 4, 4)), inside):
        assert convention_warnings(MESH, CAMERA, given) == []


def test_a_json_list_of_matrices_is_read_as_an_array_is(tmp_path):
    path = tmp_path / "poses.json"
    path.write_text(json.dumps(poses().tolist()))
    np.testing.assert_array_equal(rc.read_poses(path), poses())
    np.testing.assert_array_equal(rc.read_views(path).poses.world_from_camera, poses())
    turned = rc.read_views(path, conventions=rc.Conventions(pose_convention="opengl"))
    np.testing.assert_array_equal(turned.poses.world_from_camera, poses() @ OPENGL_AXES)
    path.write_text("[[1, 2], 3]")
    with pytest.raises(rc.PoseError, match="poses"):
        rc.read_poses(path)


def test_transposed_poses_are_said_to_be_so():
    with pytest.raises(rc.PoseError, match="0 0 0 1, but its transpose does"):
        rc.Poses.of(poses().transpose(0, 2, 1))
