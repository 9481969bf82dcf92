"""Cells whose centre a pose covers: against the definition at each centre, and beside regions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples
from surface_cases import building, room

import rastercov as rc
from rastercov.core.area.stages import CentrePass
from rastercov.reference.regions import covers_points

pytestmark = pytest.mark.native

TASKS = [
    rc.Task(),
    rc.Task(max_incidence_deg=60),
    rc.Task(min_pixel_density=150),
    rc.Task(min_pixels_per_m2=20_000, max_incidence_deg=75),
    rc.Task(min_facing_density=200),
]
SCENES = {"room": room(), "building": building()}
SIZES = {"room": 1.0, "building": 12.0}
CELLS = {name: rc.cells(mesh, SIZES[name]) for name, (mesh, _, _) in SCENES.items()}


def listed(cells, camera, task, poses, threads=None):
    """(P, C) mask of the cells whose centre each pose covers."""
    lists = CentrePass(cells, camera, task, threads).find(poses)
    mask = np.zeros((len(poses), len(cells)), np.bool_)
    for row in range(lists.n):
        mask[row, lists.row(row)] = True
    return mask


def expected(cells, camera, task, poses):
    centres = cells.vertices.reshape(-1, 3, 3).mean(axis=1)
    return covers_points(cells.mesh, camera, poses, task, centres, cells.source_face)


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("task", TASKS)
@given(seed=st.integers(0, 2**32 - 1))
@examples(5)
def test_a_centre_is_covered_exactly_where_the_definition_says_so(name, task, seed):
    mesh, camera, poses = SCENES[name]
    rng = np.random.default_rng(seed)
    moved = poses.copy()
    moved[:, :3, 3] += rng.normal(size=(len(poses), 3)) * 0.3
    if seed % 2:  # either side of every face counts, and some hide nothing
        groups = [rc.Group("all", is_two_sided=True), rc.Group("sheets", is_target=True)]
        labels = (rng.random(mesh.n_faces) < 0.2).astype(int)
        mesh = rc.Mesh(mesh.vertices, mesh.faces, groups, labels)
    cells = rc.cells(mesh, SIZES[name]) if seed % 2 else CELLS[name]
    result = listed(cells, camera, task, moved)
    np.testing.assert_array_equal(result, expected(cells, camera, task, moved))


def test_threads_change_nothing():
    _, camera, poses = SCENES["room"]
    one, many = (listed(CELLS["room"], camera, TASKS[3], poses, n) for n in (1, 3))
    np.testing.assert_array_equal(one, many)
    assert one.any()
    assert CentrePass(CELLS["room"], camera, TASKS[0]).find(poses[:0]).n == 0


def test_each_pose_is_judged_by_its_own_camera():
    cells = CELLS["room"]
    cameras = [
        rc.Camera(width=160, height=120, fx=90, fy=90),
        rc.Camera(width=120, height=160, fx=200, fy=210, cx=50, near=0.4, focus_range=(0.5, 4.0)),
    ]
    poses = rc.look_at([(2, 2, 2), (5, 3, 2), (4, 1, 1), (6, 4, 2)], (4, 2.5, 0.5))
    index = np.array([1, 0, 1, 0])
    task = rc.Task(min_pixels_per_m2=200, min_facing_density=20)
    together = CentrePass(cells, cameras, task).find(rc.Poses.of(poses, camera=index))
    for row, camera in enumerate(index):
        alone = CentrePass(cells, cameras[camera], task).find(poses[row : row + 1])
        np.testing.assert_array_equal(together.row(row), alone.row(0))
    other = CentrePass(cells, cameras, task).find(poses)
    assert any(len(together.row(row)) != len(other.row(row)) for row in range(4))
    with pytest.raises(rc.PoseError, match="camera indices below 2, got 2"):
        CentrePass(cells, cameras, task).find(rc.Poses.of(poses, camera=2))


def test_the_estimate_is_near_the_exact_area():
    mesh, camera, poses = SCENES["room"]
    cells = rc.cells(mesh, 0.25)
    estimate = listed(cells, camera, TASKS[3], poses) @ cells.area
    exact = rc.regions(mesh, camera, poses, TASKS[3]).areas().sum(axis=1)
    np.testing.assert_allclose(estimate, exact, atol=0.02 * exact.max())
