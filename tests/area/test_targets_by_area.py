"""Targets by area: their regions are exact, and those of the surface are as without them."""

import numpy as np
import pytest
from exact_cases import hostile
from exact_views import SEEDS
from hypothesis import assume, given
from nightly import examples
from surface_cases import assert_pointwise, room
from target_scenes import beside, only, sheet_at, some_as_targets

import rastercov as rc
from rastercov.core.area.network import AreaNetwork
from rastercov.core.area.union import with_rest

TASK = rc.Task(max_incidence_deg=80)


def room_with_sheet():
    """The room, with a sheet at 1.6 m in the middle of it."""
    mesh, camera, poses = room()
    return beside(mesh, sheet_at((0.5, 0.5), (7.5, 4.5), 1.6)), camera, poses


def split(seed):
    case = hostile(seed)
    rng = np.random.default_rng(seed)
    is_target = rng.random(case.mesh.n_faces) < 0.4
    assume(is_target.any() and not is_target.all())
    mesh = some_as_targets(case.mesh, is_target)
    return mesh, is_target, case.camera, np.asarray(case.pose, float).reshape(-1, 4, 4)


@pytest.mark.slow
@given(seed=SEEDS)
@examples(13, at_night=40)
def test_targets_change_no_region_of_the_surface(seed):
    mesh, is_target, camera, poses = split(seed)
    bare = only(mesh, ~is_target)
    # Lengths that all bounds are relative to are those of the whole mesh.
    assume(np.array_equal(mesh.bounds, bare.bounds))
    regions, expected = (rc.regions(each, camera, poses) for each in (mesh, bare))
    assert regions.areas()[:, ~is_target] == pytest.approx(expected.areas(), rel=1e-9, abs=1e-300)


@pytest.mark.slow
@given(seed=SEEDS)
@examples(8, at_night=25)
def test_regions_of_hostile_targets_hold_their_covered_points(seed):
    mesh, _, camera, poses = split(seed)
    assert_pointwise(mesh, camera, poses, rc.Task(), 1000, seed)


def test_targets_are_scored_by_area_and_have_a_rest():
    mesh, camera, poses = room_with_sheet()
    areas = AreaNetwork(mesh, TASK)
    areas.add(rc.regions(mesh, camera, poses, TASK))
    sheet = mesh.face_group == len(mesh.groups) - 1
    of_faces = areas.of_faces(sheet)
    assert of_faces["of_m2"] == pytest.approx(28)
    assert 50 < of_faces["percent"] < 100
    parts = with_rest(areas.covered)
    assert set(np.flatnonzero(sheet)) <= set(parts.face[parts.views == 0].tolist())
