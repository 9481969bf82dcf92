"""Targets in the exact methods: they hide nothing, and what hides them is measured exactly."""

import numpy as np
import pytest
from exact_cases import AHEAD, WINDOW, hostile
from exact_views import SEEDS, HalfPlanes, look, on_both_paths
from hypothesis import assume, given
from nightly import examples
from scenes import joined, square
from surfaces import surface_of
from target_scenes import beside, only, some_as_targets

from rastercov.core.camera.pose import limits
from rastercov.reference import polygons, rational

FIGURES = ("visible", "area", "area_error", "is_certified")


def figures(mesh, camera, pose, path):
    """Each figure of `FIGURES` in the order of the mesh, as an observer measures them."""
    near, front_only, _ = limits(mesh, camera, pose[None])
    surface = surface_of(mesh)
    view = path(surface, camera)
    view.solve(pose, near[0], front_only[0])
    return {name: getattr(view, name)[surface.rows] for name in FIGURES}


def split(seed):
    """A hostile scene, and which of its faces are targets: some, but not all."""
    case, rng = hostile(seed), np.random.default_rng(seed)
    is_target = rng.random(case.mesh.n_faces) < rng.choice((0.1, 0.5, 0.9))
    assume(is_target.any() and not is_target.all())
    return case, is_target, some_as_targets(case.mesh, is_target)


@pytest.mark.slow
@on_both_paths
@pytest.mark.parametrize("share", [0.0, 0.5])
@given(seed=SEEDS)
@examples(20)
def test_faces_have_the_same_bits_whatever_other_targets_there_are(path, share, seed):
    case, is_target, mesh = split(seed)
    pose = np.asarray(case.pose, np.float64)
    stays = ~is_target | (np.random.default_rng(seed + 1).random(mesh.n_faces) < share)
    result = figures(mesh, case.camera, pose, path)
    expected = figures(only(mesh, stays), case.camera, pose, path)
    for name in FIGURES:
        np.testing.assert_array_equal(result[name][stays], expected[name], err_msg=name)


@pytest.mark.slow
@on_both_paths
@given(seed=SEEDS)
@examples(13)
def test_areas_of_targets_are_within_their_bounds_of_the_exact_ones(path, seed):
    case, is_target, mesh = split(seed)
    pose = np.asarray(case.pose, np.float64)
    rows = np.flatnonzero(is_target)[:12]
    result = figures(mesh, case.camera, pose, path)
    off = np.abs(result["visible"][rows] - rational.visible_area(mesh, case.camera, pose, rows))
    off += np.abs(result["area"][rows] - rational.image_area(mesh, case.camera, pose, rows))
    assert (off <= result["area_error"][rows] + 1e-12).all()


@on_both_paths
@pytest.mark.parametrize("targets_first", [False, True])
def test_a_target_on_a_surface_is_visible_and_so_is_the_surface(path, targets_first):
    wall, sheet = square(1, 3), square(0.5, 3)
    mesh = joined(sheet, wall) if targets_first else joined(wall, sheet)
    is_target = np.arange(4) // 2 == (0 if targets_first else 1)
    result = figures(some_as_targets(mesh, is_target), WINDOW, AHEAD, path)
    assert np.array_equal(result["visible"], result["area"])
    assert (result["area"] > 0).all()


def test_targets_are_never_culled_with_back_faces():
    mesh = beside(square(3, 5), square(0.4, 2), square(0.4, 2))
    faces = mesh.faces.copy()
    faces[2:] = faces[2:, ::-1]  # seen from behind
    mesh = type(mesh)(mesh.vertices, faces, mesh.groups, mesh.face_group)
    view = look(mesh, WINDOW, AHEAD, HalfPlanes, front_only=True)
    visible, area = view.visible[view.surface.rows], view.area[view.surface.rows]
    assert np.array_equal(visible, area)
    assert (area[2:] > 0).all()
    assert np.array_equal(polygons.visible_area(mesh, WINDOW, AHEAD, cull=True) > 0, visible > 0)


def test_the_surface_is_that_of_the_opaque_part():
    mesh = beside(square(3, 5), square(0.4, 2))
    whole, opaque = surface_of(mesh), surface_of(mesh.opaque)
    assert np.array_equal(whole.edges.of_face, opaque.edges.of_face)
    assert np.array_equal(whole.vertices, opaque.vertices)
    assert whole.n_faces == mesh.n_faces
    assert opaque.targets is None
