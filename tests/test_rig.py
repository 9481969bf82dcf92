"""Rigs: poses that each have their own camera are measured as by an observer of that camera."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples
from visible_fractions import visibility

from rastercov.base.errors import CameraError, PoseError
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.pose import Poses
from rastercov.core.camera.rig import Rig, cameras_of
from rastercov.core.camera.viewpoints import look_at, sphere_of_poses
from rastercov.core.coverage.coverage import FIGURES, open_observer
from rastercov.core.coverage.evaluation import regions
from rastercov.core.coverage.job import evaluate
from rastercov.core.coverage.network import Network
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import shapes

MESH = shapes.torus(24, 12)
WIDE = Camera(width=160, height=120, fx=90, fy=90)
LONG = Camera(width=240, height=240, fx=400, fy=400, cx=100, near=0.5, focus_range=(2, 6))
TALL = Camera(width=60, height=200, fx=120, fy=130)
CAMERAS = (WIDE, LONG, TALL)
TASK = Task(min_pixels=4)
POSES = sphere_of_poses((0, 0, 0), 4.0, 9)

assignments = st.lists(st.integers(0, 2), min_size=9, max_size=9)
methods = pytest.mark.parametrize("method", ["certified", "exact", "sampled:cpu@2"])


def rows_of(indices, camera):
    return np.flatnonzero(np.array(indices) == camera)


@pytest.mark.slow
@methods
@examples(8)
@given(indices=assignments)
def test_each_pose_has_the_figures_of_its_own_camera(method, indices):
    together = evaluate(
        MESH, CAMERAS, Poses.of(POSES, camera=indices), TASK, method=method, by="face"
    )
    for number, camera in enumerate(CAMERAS):
        rows = rows_of(indices, number)
        alone = evaluate(MESH, camera, POSES[rows], TASK, method=method, by="face")
        for name in (*FIGURES, "clipped"):
            np.testing.assert_array_equal(getattr(together, name)[rows], getattr(alone, name))


@methods
def test_a_network_adds_up_cameras_of_several_kinds(method):
    poses = Poses.of(POSES, camera=[0, 1, 2, 2, 1, 0, 0, 1, 2])
    added, judged = Network(MESH, TASK), Network(MESH, TASK)
    added.add(evaluate(MESH, CAMERAS, poses, TASK, method=method, by="face"))
    with open_observer(MESH, CAMERAS, method) as observer:
        for batch in judged.judge(observer, poses):
            judged.add(batch)
    assert added.summary() == judged.summary()
    np.testing.assert_array_equal(added.best_pose, judged.best_pose)


@pytest.mark.slow
@examples(6)
@given(indices=assignments)
def test_each_pose_has_the_regions_of_its_own_camera(indices):
    together = regions(MESH, CAMERAS, Poses.of(POSES, camera=indices))
    areas, bounds = together.areas(), together.bounds()
    for number, camera in enumerate(CAMERAS):
        rows = rows_of(indices, number)
        alone = regions(MESH, camera, POSES[rows])
        np.testing.assert_array_equal(areas[rows], alone.areas())
        np.testing.assert_array_equal(bounds[rows], alone.bounds())


@pytest.mark.slow
def test_more_cameras_than_open_rasterisers():
    cameras = [Camera(width=20 + k, height=30, fx=40, fy=40) for k in range(20)]
    poses = Poses.of(np.repeat(POSES[:1], 40, axis=0), camera=[*range(20), *reversed(range(20))])
    seen = visibility(MESH, cameras, poses, "sampled:cpu").visibility
    np.testing.assert_array_equal(seen[:20], seen[:19:-1])
    alone = visibility(MESH, cameras[7], POSES[:1], "sampled:cpu")
    np.testing.assert_array_equal(seen[7], alone.visibility[0])


def test_a_slice_of_poses_keeps_their_cameras():
    poses = Poses.of(POSES, camera=np.arange(9) % 3)
    np.testing.assert_array_equal(poses[2:5].camera, [2, 0, 1])
    np.testing.assert_array_equal(poses[np.array([8, 0])].camera, [2, 0])
    assert Poses.of(POSES).camera.tolist() == [0] * 9
    assert Poses.of(poses) is poses
    assert Poses.of(Poses.of(POSES), camera=1).camera.tolist() == [1] * 9


def test_poses_left_out_take_their_cameras_with_them():
    matrices = POSES.copy()
    matrices[4, 0, 0] = 5.0
    poses = Poses.of(matrices, camera=np.arange(9), skip_bad=True)
    assert poses.ids.tolist() == poses.camera.tolist() == [0, 1, 2, 3, 5, 6, 7, 8]


def test_a_rig_carries_its_cameras():
    turned = look_at((0.1, 0, 0), (0.1, 0, 1), (0, -1, 0))[0]
    rig = Rig([WIDE, LONG], ["left", "right"], [np.eye(4), turned])
    poses = rig.poses(POSES[:3])
    assert poses.camera.tolist() == [0, 1] * 3
    np.testing.assert_array_equal(poses.world_from_camera[::2], POSES[:3])
    np.testing.assert_allclose(poses.world_from_camera[3], POSES[1] @ turned, atol=1e-15)
    assert evaluate(MESH, rig, poses, by="face").camera is rig
    assert cameras_of(rig) == (WIDE, LONG)
    assert len(rig) == 2


@pytest.mark.parametrize(
    ("camera", "text"), [([], "1 to"), ([WIDE, "khepra"], "be a Camera"), (3, "be a Camera")]
)
def test_what_is_no_camera_is_refused(camera, text):
    with pytest.raises(CameraError, match=text):
        evaluate(MESH, camera, POSES, by="face")


@pytest.mark.parametrize(
    ("camera", "text"),
    [
        ([0, 1], "one index for each of 9"),
        ([0] * 8 + [-1], "0 or more, got -1"),
        ([0.5] * 9, "9 indices"),
        ([2**40] * 9, "0 or more"),
    ],
)
def test_indices_that_are_none_are_refused(camera, text):
    with pytest.raises(PoseError, match=text):
        Poses.of(POSES, camera=camera)


@methods
def test_a_camera_that_is_not_there_is_refused(method):
    poses = Poses.of(POSES, camera=[0] * 8 + [2])
    for call in (partial(evaluate, method=method), regions):
        with pytest.raises(PoseError, match="expected camera indices below 2, got 2 for pose 8"):
            call(MESH, CAMERAS[:2], poses)


@pytest.mark.parametrize("names", [["a"], ["a", "a"], ["a", ""], ["a", 3]])
def test_names_of_a_rig_are_different_texts(names):
    with pytest.raises(CameraError, match="strings"):
        Rig([WIDE, LONG], names)
