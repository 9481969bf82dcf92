"""Targets are no obstacles: cameras may be within them, and walls are those of other faces."""

import numpy as np
import pytest
from target_scenes import beside, sheet_at

import rastercov as rc
from rastercov.core.mesh import shapes
from rastercov.core.mesh.solids import in_solid
from rastercov.placement import build_matrix, filter_candidates, on_box
from rastercov.placement.candidates.mounting import at_point
from rastercov.placement.candidates.rooms import nearest_obstacle
from rastercov.placement.improve.pose_space import Place, PoseSpace
from rastercov.reference.models.line_of_sight import LineOfSight

ROOM = shapes.room(4)
VOLUME = shapes.box((2, 2, 2))
SCENE = beside(ROOM, VOLUME, sheet_at((-9, -9), (9, 9), 1.4))
CAMERA = rc.Camera(width=80, height=60, fx=50, fy=50)


def test_a_camera_may_be_inside_a_target():
    assert in_solid(VOLUME, [(0, 0, 0.5)]).all()
    assert not in_solid(SCENE, [(0, 0, 0.5), (0.99, 0, 0.5)]).any()
    assert in_solid(SCENE, [(0, 0, 9), (9, 0, 1)]).all()  # beyond the walls of the room


def test_boxes_and_clearance_are_those_of_opaque_faces():
    aim = at_point((0, 0, 0))
    alone, result = (
        on_box(mesh, CAMERA, spacing=0.7, aim=aim, outward=-0.3) for mesh in (ROOM, SCENE)
    )
    np.testing.assert_array_equal(result.poses, alone.poses)
    expected, _ = filter_candidates(alone, ROOM, clearance=0.2)
    left, _ = filter_candidates(result, SCENE, clearance=0.2)
    np.testing.assert_array_equal(left.poses, expected.poses)
    assert len(left)


def test_targets_alone_are_no_obstacle():
    alone = VOLUME.with_groups(targets=["mesh"])
    assert nearest_obstacle(alone) is None
    candidates = on_box(alone, CAMERA, spacing=1.0, aim=at_point((0, 0, 0)))
    assert len(filter_candidates(candidates, alone, clearance=0.5)[0]) == len(candidates)


def test_allowed_positions_are_those_without_the_target():
    boxes = np.array([[(-2, -2, 0.2), (2, 2, 2.5)]])
    points = np.random.default_rng(1).uniform(-2, 2, (200, 3))
    options = {"boxes": boxes, "clearance": 0.2, "stand_off": (0.0, 20.0)}
    result = PoseSpace(mesh=SCENE, **options).judge(points)
    np.testing.assert_array_equal(result, PoseSpace(mesh=ROOM, **options).judge(points))
    assert (result == Place.ALLOWED).any()


def test_lines_of_sight_pass_through_targets():
    points = np.random.default_rng(2).uniform(*ROOM.bounds, (100, 3))
    pose = rc.look_at([(2.5, 2, 2.5)], [(0, 0, 1)])[0]
    seen = points, pose, 1e-6, rc.Camera.from_fov(64, 64, hfov_deg=60)
    hidden = LineOfSight(SCENE).find_hidden(*seen)
    np.testing.assert_array_equal(hidden, LineOfSight(ROOM).find_hidden(*seen))
    assert hidden.any()


@pytest.mark.slow
def test_columns_of_the_matrix_are_those_without_targets(tmp_path):
    poses = on_box(ROOM, CAMERA, spacing=1.5, aim=at_point((0, 0, 1)), outward=-0.3).poses
    task, rows = rc.Task(min_coverage=0.3), {}
    for name, mesh in (("with", SCENE), ("without", ROOM)):
        matrix = build_matrix((mesh, CAMERA), poses, task, tmp_path / name)
        pose = np.repeat(np.arange(len(poses)), np.diff(matrix.indptr))
        kept = matrix.face < ROOM.n_faces
        rows[name] = pose[kept], matrix.face[kept], matrix.coverage[kept]
        assert name == "without" or not kept.all()  # targets have columns, too
    for pair, expected in zip(*rows.values(), strict=True):
        np.testing.assert_array_equal(pair, expected)
