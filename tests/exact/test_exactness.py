"""Acceptance of the exact paths: laws of visible area that any method must keep, on both paths.

The numbers in the names of sections are those of the list of acceptance tests that the methods were
designed against; speed, and the critique of Algorithm 1, have tests elsewhere.
"""

import numpy as np
import pytest
from exact_cases import AHEAD, KINDS, hostile, known_cases, slivers, triangles
from exact_views import (
    SEEDS,
    assert_within_bounds,
    for_seeds_on_both_paths,
    fractions,
    look,
    on_both_paths,
    see_again,
    soup,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from nightly import examples
from visible_fractions import visibility

from rastercov.core.camera.camera import Camera
from rastercov.core.camera.viewpoints import look_at
from rastercov.core.mesh import Mesh, shapes
from rastercov.core.raster.contract import BoundKind
from rastercov.reference import rational
from rastercov.reference.coverage import face_geometry

CAMERA = Camera(width=320, height=240, fx=260, fy=270)
KNOWN = known_cases()


# --- 1 to 7, 9, 17: answers known on paper --------------------------------------------------------


@pytest.mark.slow
@on_both_paths
@pytest.mark.parametrize("case", KNOWN, ids=lambda case: case.name)
def test_areas_worked_out_on_paper(case, path):
    expected = np.array([float(area) for area in case.expected])
    view = look(case.mesh, case.camera, case.pose, path)
    assert np.abs(view.visible - expected).max() <= 2e-11


# --- 10: nothing is lost, nothing is counted twice ------------------------------------------------


@pytest.mark.slow
@for_seeds_on_both_paths
def test_a_room_seen_from_within_fills_the_image(path, seed):
    rng = np.random.default_rng(seed)
    mesh = shapes.room(3)
    eye = rng.uniform((-2.5, -2, 1.9), (2.5, 2, 2.7))  # above the crates
    pose = look_at(eye, eye + rng.normal(size=3), rng.normal(size=3))[0]
    view = look(mesh, CAMERA, pose, path)
    assert view.visible.sum() == pytest.approx(CAMERA.width * CAMERA.height, rel=1e-12)


# --- 11, 12: what must not matter -----------------------------------------------------------------


@pytest.mark.slow
@for_seeds_on_both_paths
def test_neither_unused_vertices_nor_seams_matter_nor_their_order_but_by_rounding(path, seed):
    """An edge begins at its vertex of lower index; seed 1248745 moved one figure by 6e-14 px^2."""
    rng = np.random.default_rng(seed)
    mesh = shapes.torus(9, 12) if seed % 2 else shapes.teapot(2)
    pose = look_at(rng.normal(size=3) * 3, mesh.bounds.mean(axis=0))[0]
    order = rng.permutation(mesh.n_vertices)
    place = np.argsort(order)
    shuffled = Mesh(vertices=mesh.vertices[order], faces=place[mesh.faces])
    apart = triangles(*mesh.vertices[mesh.faces])
    more = Mesh(vertices=np.concatenate((mesh.vertices[:1], mesh.vertices)), faces=mesh.faces + 1)
    expected = look(mesh, CAMERA, pose, path)
    for other in (shuffled, apart, more):
        view = look(other, CAMERA, pose, path)
        most = 1e-11 if other is shuffled else 0.0
        assert np.abs(view.visible - expected.visible).max() <= most
        assert np.array_equal(view.is_certified, expected.is_certified)


@pytest.mark.slow
@on_both_paths
@given(seed=SEEDS, power=st.integers(-280, 90))
@settings(max_examples=10)
def test_scaling_everything_by_a_power_of_two_changes_not_one_bit(path, seed, power):
    mesh = soup(np.random.default_rng(seed))
    scaled = Mesh(vertices=mesh.vertices * 2.0**power, faces=mesh.faces)
    one, two = (look(m, CAMERA, AHEAD, path) for m in (mesh, scaled))
    assert np.array_equal(one.visible, two.visible)
    assert np.array_equal(one.is_certified, two.is_certified)


# --- 14: exact arithmetic -------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("kind", range(len(KINDS)), ids=lambda kind: KINDS[kind].__name__)
@given(turn=st.integers(0, 10_000))
@examples(2, at_night=20)
def test_hostile_scenes_come_out_as_in_exact_arithmetic(kind, turn):
    """To 1e-9 px^2, within their bounds, certified ones all or nothing, and never more than all."""
    case = hostile(kind + turn * len(KINDS))
    views = assert_within_bounds(case.mesh, case.camera, case.pose)
    exact = rational.visible_area(case.mesh, case.camera, case.pose)
    for view in views:
        assert np.abs(view.visible - exact).max() <= 1e-9, (case, type(view))
        assert (view.visible >= 0).all()
        assert (view.visible <= view.area).all()
        assert (view.area <= case.camera.width * case.camera.height * (1 + 1e-12)).all()
    # A certified 0 or 1 has no bound to hide behind: where the areas are known to 1e-9 px^2 only,
    # so is the fraction that is compared with.
    expected, whole = fractions(case.mesh, case.camera, case.pose)
    expected[~face_geometry(case.mesh, case.camera, case.pose).is_front] = 0
    has_image = whole > 1e-7
    for method in ("certified", "exact"):
        seen = visibility(case.mesh, case.camera, case.pose, method)
        off = np.abs(seen.visibility[0] - expected)[has_image]
        assert (off <= np.maximum(seen.visibility_bound[0][has_image], 1e-14)).all()
        certified = (seen.visibility_kind[0] == BoundKind.CERTIFIED) & has_image
        assert np.isin(seen.visibility[0][certified], (0, 1)).all()
        assert (seen.visibility_bound[0][certified] == 0).all()
        assert method == "certified" or (seen.visibility_kind == BoundKind.EXACT).all()


# --- 17: what samples cannot see ------------------------------------------------------------------


def test_slivers_between_the_samples_leave_the_face_behind_uncertified():
    case = slivers()
    seen = visibility(case.mesh, case.camera, case.pose)
    assert (seen.visibility_kind[0, :2] == BoundKind.EXACT).all()
    assert np.abs(seen.visibility[0, :2] - 0.1).max() <= 1e-9
    assert (seen.visibility[0, 2:] == 1).all()
    sampled = visibility(case.mesh, case.camera, case.pose, "sampled:cpu")
    assert (sampled.visibility_kind == BoundKind.STATISTICAL).all()


# --- figures --------------------------------------------------------------------------------------


@on_both_paths
def test_views_hold_no_memory_of_other_poses(path):
    # Outside, inside and through the near plane in turn: all scratch memory is used again.
    mesh = shapes.room(4)
    rng = np.random.default_rng(8)
    eyes = rng.uniform(-1, 1, (16, 3)) * np.array((3, 2.5, 1)) + (0, 0, 1.4)
    eyes[::4] *= 9
    view = path(look(mesh, CAMERA, AHEAD, path).surface, CAMERA)
    for pose in look_at(eyes, eyes + rng.normal(size=(16, 3))):
        see_again(view, mesh, CAMERA, pose)
        fresh = look(mesh, CAMERA, pose, path)
        assert np.array_equal(view.visible, fresh.visible)
        assert np.array_equal(view.area, fresh.area)
        assert np.array_equal(view.is_certified, fresh.is_certified)
    see_again(view, mesh, CAMERA, pose)  # once more changes nothing
    assert np.array_equal(view.visible, fresh.visible)
