"""Faces that nobody asks for are left out, and the others have the regions and figures they had."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples
from surface_cases import hostile_scene

import rastercov as rc
from rastercov.core.area.regions import RegionPass
from rastercov.core.camera.pose import Poses
from rastercov.core.coverage.exact_pass import room_for
from rastercov.core.mesh import Group, Mesh
from rastercov.core.raster.contract import BoundKind

ARRAYS = ("xy", "starts", "face", "pair_face", "area")
ROLES = [Group("task"), Group("hides", is_occluder=True), Group("hangs", is_target=True)]
LENSES = {
    "pinhole": {},
    "brown": {"model": "opencv", "distortion": (-0.2, 0.05, 1e-3, -1e-3)},
}


def in_groups(mesh, rng):
    """The mesh with each face in one of three groups, neighbours often in the same."""
    labels = rng.integers(0, 3, max(1, mesh.n_faces // 4)).repeat(4)
    labels = np.resize(labels, mesh.n_faces).astype(np.int32)
    labels[rng.random(mesh.n_faces) < 0.1] = rng.integers(0, 3)
    return Mesh(mesh.vertices, mesh.faces, ROLES, labels)


def measured(finder, poses, **options):
    """Regions with the figures of all faces: visible, area and bound (3, P, F), and their kind."""
    seen = room_for(len(poses), finder.mesh.n_faces)
    result = finder.find(poses, seen=seen, **options)
    return result, np.stack((seen.visible_pixels, seen.drawn_pixels, seen.area_error)), seen.kind


def assert_same_regions(result, others):
    for name in ARRAYS:
        assert np.array_equal(getattr(result, name), getattr(others, name)), name
    assert_close(result.bound, others.bound)


def assert_close(bounds, others):
    """Bounds of rounding differ by the hider that is tried first, which depends on other faces."""
    assert np.abs(bounds - others).max(initial=0.0) < 1e-7


@pytest.mark.slow
@pytest.mark.parametrize("method", ["certified", "exact"])
@pytest.mark.parametrize("lens", LENSES)
@examples(10, at_night=200)
@given(seed=st.integers(0, 10_000), share=st.sampled_from([0.0, 0.3, 1.0]))
def test_regions_are_the_same_with_and_without_figures(method, lens, seed, share):
    rng = np.random.default_rng(seed)
    mesh, camera, pose = hostile_scene(seed)
    camera = rc.Camera(
        width=camera.width, height=camera.height, fx=camera.fx, fy=camera.fy, **LENSES[lens]
    )
    mesh, poses = in_groups(mesh, rng), Poses.of(pose[None])
    closed = rng.random(mesh.n_faces) < share
    finder = RegionPass(mesh, camera, method=method, threads=1)
    whole, areas, kind = measured(finder, poses, closed=closed)
    assert_same_regions(finder.find(poses, closed=closed), whole)
    again, *figures = measured(finder, poses, closed=closed)
    assert_same_regions(again, whole)
    assert np.array_equal(figures[1], kind)

    of_task = RegionPass(mesh, camera, method=method, threads=1, only_task=True)
    measures, part, its_kind = measured(of_task, poses, closed=closed)
    assert_same_regions(measures, whole)
    task = mesh.task_mask
    assert np.array_equal(part[:2, :, task], areas[:2, :, task])
    assert np.array_equal(its_kind[:, task], kind[:, task])
    assert_close(part[2][:, task], areas[2][:, task])
    assert (np.abs(part[0] - areas[0]) <= part[2] + areas[2]).all()


def test_faces_left_out_are_not_measured():
    mesh, camera, pose = hostile_scene(3)
    hidden = Mesh(mesh.vertices, mesh.faces, [Group("hides", is_occluder=True)])
    poses = Poses.of(pose[None])
    _, areas, _ = measured(RegionPass(hidden, camera, threads=1), poses)
    of_task = RegionPass(hidden, camera, threads=1, only_task=True)
    measures, part, its_kind = measured(of_task, poses)
    assert areas[0].any()
    assert len(measures) == 0
    assert not part[0].any()
    assert (its_kind == BoundKind.EXACT).all()
    assert (part[2] >= areas[0]).all()
